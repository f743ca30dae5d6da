#include "camber/synth/detail/faceted_body.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "camber/synth/detail/car_body.h"

namespace camber {
namespace {

constexpr int kSide = kNumKeypoints / 2;
// Keypoints of the left flank's edges, from the rear to the front.
constexpr std::array<int, 10> kLower{10, 9, 8, 7, 6, 5, 4, 3, 2, 17};
constexpr std::array<int, 4> kUpper{11, 12, 15, 16};
constexpr std::array<int, 8> kAcross{17, 16, 15, 14, 13, 12, 11, 10};  // over the car
constexpr int kLateralCells = 8;

using Keypoints = std::array<Eigen::Vector3d, kNumKeypoints>;

Eigen::Vector3d mirrored(const Eigen::Vector3d& p) { return {p.x(), p.y(), -p.z()}; }

/// Twice the area in the side view, negative where a, b, c run clockwise from the right.
double side_area(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  return (b.x() - a.x()) * (c.y() - a.y()) - (c.x() - a.x()) * (b.y() - a.y());
}

/// The flank between its two edges: triangles of keypoints from the rear to the front, none across
/// an arch.
std::vector<std::array<int, 3>> flank_triangles(const Keypoints& k) {
  std::vector<std::array<int, 3>> out;
  std::size_t low = 0, high = 0;
  while (low + 1 < kLower.size() || high + 1 < kUpper.size()) {
    const int a = kLower[low], b = kUpper[high];
    bool along_lower = high + 1 == kUpper.size();
    if (!along_lower && low + 1 < kLower.size()) {
      const Eigen::Vector3d &lower = k[kLower[low + 1]], &upper = k[kUpper[high + 1]];
      const double by_lower = side_area(k[a], lower, k[b]), by_upper = side_area(k[a], upper, k[b]);
      along_lower = by_lower > 0.0 && by_upper > 0.0 ? lower.x() <= upper.x() : by_lower > by_upper;
    }
    out.push_back({a, along_lower ? kLower[++low] : kUpper[++high], b});
  }
  return out;
}

/// Whether the edges of the flank run from the rear to the front and the parts of the body lie one
/// above the other, so that the polyhedron does not cross itself.
bool is_body(const Keypoints& k, double clearance) {
  for (std::size_t i = 1; i < kLower.size(); ++i) {
    if (k[kLower[i]].x() < k[kLower[i - 1]].x() + 0.01) return false;
  }
  for (std::size_t i = 1; i < kUpper.size(); ++i) {
    if (k[kUpper[i]].x() < k[kUpper[i - 1]].x() + 0.02) return false;
  }
  if (k[14].x() < k[13].x() + 0.3) return false;
  const double belt = std::max(k[12].y(), k[15].y()), roof = std::min(k[13].y(), k[14].y());
  if (roof < belt + 0.15 || k[15].x() < k[12].x() + 0.4) return false;
  const double upper = std::min({k[11].y(), k[12].y(), k[15].y(), k[16].y()});
  const double arches = std::max({k[3].y(), k[4].y(), k[7].y(), k[8].y()});
  if (upper < arches + 0.03) return false;
  for (const int i : {10, 17}) {
    if (k[i].y() < clearance + 0.05 || k[i].y() > upper - 0.05) return false;
  }
  for (const int i : {2, 5, 6, 9}) {
    if (k[i].y() < clearance + 0.01) return false;
  }
  for (const auto& [a, b, c] : flank_triangles(k)) {
    if (side_area(k[a], k[b], k[c]) <= 0.0) return false;
  }
  return std::all_of(k.begin() + 2, k.begin() + kSide,
                     [](const Eigen::Vector3d& p) { return p.z() < -0.3; });
}

/// Moves pairs of keypoints but those of the wheels; less where the body would cross itself.
void move_pairs(double size, double clearance, Sequence* random, Keypoints* keypoints) {
  constexpr int kTries = 8;
  const Keypoints before = *keypoints;
  for (int attempt = 0; attempt < kTries; ++attempt) {
    const double share = attempt + 1 < kTries ? std::pow(0.85, attempt) : 0.0;
    for (int i = 2; i < kSide; ++i) {
      Eigen::Vector3d moved = before[i];
      for (int axis = 0; axis < 3; ++axis) moved[axis] += share * size * random->normal();
      (*keypoints)[i] = moved;
      (*keypoints)[i + kSide] = mirrored(moved);
    }
    if (is_body(*keypoints, clearance)) return;
  }
}

/// Triangles of the left half, each with its mirror image, and strips between both.
class Polyhedron {
 public:
  explicit Polyhedron(TriangleMesh* mesh) : mesh_(mesh) {}

  int vertex(const Eigen::Vector3d& p) {
    mesh_->vertices.push_back(p);
    return static_cast<int>(mesh_->vertices.size()) - 1;
  }

  /// a, b, c counter-clockwise from outside.
  void triangle(int a, int b, int c, CarMaterial material) {
    mesh_->triangles.emplace_back(a, b, c);
    mesh_->materials.push_back(static_cast<int>(material));
  }

  /// A triangle of the left side, counter-clockwise from the left, and its mirror image.
  void both_sides(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c,
                  CarMaterial material) {
    triangle(vertex(a), vertex(b), vertex(c), material);
    triangle(vertex(mirrored(a)), vertex(mirrored(c)), vertex(mirrored(b)), material);
  }

  struct Row {
    Eigen::Vector3d left;     // its end on the left side
    Eigen::Vector3d outward;  // m, by which its middle bulges
  };
  /// From the left to the right side; the rows go up, from outside.
  void strip(const std::vector<Row>& rows, CarMaterial (*material)(std::size_t row)) {
    std::vector<std::array<int, kLateralCells + 1>> ids(rows.size());
    for (std::size_t r = 0; r < rows.size(); ++r) {
      for (int i = 0; i <= kLateralCells; ++i) {
        const double w = -1.0 + 2.0 * i / kLateralCells;
        Eigen::Vector3d p = rows[r].left + (1.0 - w * w) * rows[r].outward;
        p.z() = -w * rows[r].left.z();
        ids[r][i] = vertex(p);
      }
    }
    for (std::size_t r = 0; r + 1 < rows.size(); ++r) {
      for (int i = 0; i < kLateralCells; ++i) {
        triangle(ids[r][i], ids[r + 1][i + 1], ids[r][i + 1], material(r));
        triangle(ids[r][i], ids[r + 1][i], ids[r + 1][i + 1], material(r));
      }
    }
  }

 private:
  TriangleMesh* mesh_;
};

/// From the keypoints of the sills and bumpers down to the clearance, and the floor between them.
void add_skirts(const Keypoints& k, double clearance, Polyhedron* body) {
  constexpr double kInwards = 0.02;  // m, of the lower edge
  const auto foot = [&](const Eigen::Vector3d& p) {
    return Eigen::Vector3d(p.x(), clearance, p.z() + kInwards);
  };
  for (const auto& [rear, front] : {std::pair{10, 9}, std::pair{6, 5}, std::pair{2, 17}}) {
    const Eigen::Vector3d a = foot(k[rear]), b = foot(k[front]);
    body->both_sides(a, k[front], b, CarMaterial::kTrim);
    body->both_sides(a, k[rear], k[front], CarMaterial::kTrim);
    body->strip({{a, Eigen::Vector3d::Zero()}, {b, Eigen::Vector3d::Zero()}},
                [](std::size_t) { return CarMaterial::kTrim; });
  }
}

/// Nose, bonnet, windscreen, roof, rear window, lid and tail, with the fronts of the skirts.
void add_panels(const Keypoints& k, double clearance, Sequence* random, Polyhedron* body) {
  std::vector<Polyhedron::Row> rows;
  const Eigen::Vector3d front = k[kAcross.front()], rear = k[kAcross.back()];
  rows.push_back({{front.x() - 0.02, clearance, front.z() + 0.02}, Eigen::Vector3d::Zero()});
  for (std::size_t i = 0; i < kAcross.size(); ++i) {
    const Eigen::Vector3d& before = k[kAcross[i == 0 ? 0 : i - 1]];
    const Eigen::Vector3d& after = k[kAcross[std::min(i + 1, kAcross.size() - 1)]];
    const Eigen::Vector2d along = (after - before).head<2>().normalized();
    const double crown = random->uniform(0.0, 0.07);
    rows.push_back({k[kAcross[i]], crown * Eigen::Vector3d(along.y(), -along.x(), 0.0)});
  }
  rows.push_back({{rear.x() + 0.02, clearance, rear.z() + 0.02}, Eigen::Vector3d::Zero()});
  rows.front().outward = rows[1].outward;
  rows.back().outward = rows[rows.size() - 2].outward;
  body->strip(rows, [](std::size_t row) {
    return row == 0 || row == kAcross.size() ? CarMaterial::kTrim : CarMaterial::kPaint;
  });
}

bool of_wheel(int material) {
  return material == static_cast<int>(CarMaterial::kTyre) ||
         material == static_cast<int>(CarMaterial::kRim);
}

/// The wheels' triangles alone, at other distances from the middle.
/// @param outwards  m by which those of the rear and of the front axle come out
TriangleMesh wheels_of(const CarModel& model, const std::array<double, 2>& outwards) {
  TriangleMesh out;
  std::vector<int> renamed(model.mesh.vertices.size(), -1);
  for (std::size_t i = 0; i < model.mesh.triangles.size(); ++i) {
    if (!of_wheel(model.mesh.materials[i])) continue;
    Eigen::Vector3i t = model.mesh.triangles[i];
    for (int c = 0; c < 3; ++c) {
      int& name = renamed[t[c]];
      if (name < 0) {
        Eigen::Vector3d p = model.mesh.vertices[t[c]];
        const bool front =
            std::abs(p.x() - model.keypoints[1].x()) < std::abs(p.x() - model.keypoints[0].x());
        p.z() += std::copysign(1.0, p.z()) * outwards[front ? 1 : 0];
        name = static_cast<int>(out.vertices.size());
        out.vertices.push_back(p);
      }
      t[c] = name;
    }
    out.triangles.push_back(t);
    out.materials.push_back(model.mesh.materials[i]);
  }
  return out;
}

/// Puts the origin below the middle of the mesh's box, and takes the dimensions from it.
void center(CarModel* model) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& v : model->mesh.vertices) box.extend(v);
  const Eigen::Vector3d shift(-box.center().x(), 0.0, 0.0);
  for (Eigen::Vector3d& v : model->mesh.vertices) v += shift;
  for (Eigen::Vector3d& k : model->keypoints) k += shift;
  model->dimensions = {box.sizes().x(), box.sizes().z(), box.max().y()};
}

}  // namespace

void facet_body(double size, Sequence* random, CarModel* model) {
  Keypoints& k = model->keypoints;
  const double clearance = random->uniform(0.10, 0.20);
  move_pairs(size, clearance, random, &k);

  std::array<double, 2> outwards{};
  constexpr std::array<std::array<int, 2>, 2> kTops{{{7, 8}, {3, 4}}};  // of the arches, by axle
  for (int axle = 0; axle < 2; ++axle) {
    const double flush = -0.5 * (k[kTops[axle][0]].z() + k[kTops[axle][1]].z()) - 0.005;
    outwards[axle] = flush + k[axle].z();
    k[axle].z() = -flush;
    k[axle + kSide].z() = flush;
  }
  model->mesh = wheels_of(*model, outwards);
  Polyhedron body(&model->mesh);
  for (const auto& [a, b, c] : flank_triangles(k)) {
    body.both_sides(k[a], k[c], k[b], CarMaterial::kPaint);
  }
  body.both_sides(k[12], k[14], k[15], CarMaterial::kPaint);
  body.both_sides(k[12], k[13], k[14], CarMaterial::kPaint);
  add_panels(k, clearance, random, &body);
  add_skirts(k, clearance, &body);
  for (int axle = 0; axle < 2; ++axle) {
    const double top = std::min(k[kTops[axle][0]].y(), k[kTops[axle][1]].y()) + 0.02;
    add_axle_box(k[axle], model->wheel_radius + 0.07, clearance + 0.01, top, &model->mesh);
  }
  center(model);
}

}  // namespace camber
