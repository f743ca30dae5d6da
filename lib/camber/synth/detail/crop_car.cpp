#include "camber/synth/detail/crop_car.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "camber/synth/detail/car_body.h"
#include "camber/synth/detail/faceted_body.h"

namespace camber {
namespace {

constexpr float kDegree = 3.14159265f / 180.0f;

std::uint8_t id(CropCarMaterial material) { return static_cast<std::uint8_t>(material); }

float part(Sequence* random, double low, double high) {
  return static_cast<float>(random->uniform(low, high));
}

CropCarPlaces places_of(const CarModel& model) {
  const auto& k = model.keypoints;
  CropCarPlaces p;
  p.front_axle = static_cast<float>(k[1].x());
  p.rear_axle = static_cast<float>(k[0].x());
  p.wheel_y = static_cast<float>(k[0].y());
  p.wheel_radius = static_cast<float>(model.wheel_radius);
  p.arch_radius = static_cast<float>((k[3] - k[1]).head<2>().norm());
  p.half_width = static_cast<float>(0.5 * model.dimensions.width);
  p.length = static_cast<float>(model.dimensions.length);
  p.height = static_cast<float>(model.dimensions.height);
  Eigen::Vector3f* const corners[8] = {&p.rear_bumper, &p.boot, &p.rear_window, &p.roof_rear,
                                       &p.roof_front,  &p.cowl, &p.headlight,   &p.front_bumper};
  for (int i = 0; i < 8; ++i) *corners[i] = k[28 + i].cast<float>();
  return p;
}

/// A city car, a pick-up or a car whose proportions are farther from the mean than the family's.
void vary_proportions(CarClass car_class, Sequence* random, CarProportions* p) {
  // Upper points of an arch: at the class mean's angles. Its ends are where it meets the sill,
  // which is higher or lower.
  const CarProportions mean = mean_proportions(car_class);
  const double lower = random->uniform(-0.25, 0.35);  // [rad]
  p->arch_end_outer = mean.arch_end_outer - lower + random->uniform(-0.08, 0.08);
  p->arch_end_inner = mean.arch_end_inner - lower + random->uniform(-0.08, 0.08);
  p->arch_top_outer = mean.arch_top_outer;
  p->arch_top_inner = mean.arch_top_inner;
  if (car_class == CarClass::kHatchback && random->chance(0.10)) {
    const double shorter = random->uniform(0.3, 1.2);  // city cars, 2.8 to 3.7 m
    p->length -= shorter;
    p->wheelbase -= 0.72 * shorter;
    p->front_overhang -= 0.12 * shorter;
    p->cowl_x += 0.25 * shorter;
    p->roof_front_x += 0.35 * shorter;
    p->height += 0.05 * shorter;
  }
  if (car_class == CarClass::kSaloon && random->chance(0.25)) {
    // A pick-up: the cabin ends in the middle, the bed's rim is level.
    p->length += random->uniform(0.2, 0.7);
    p->wheelbase += random->uniform(0.2, 0.45);
    const double taller = random->uniform(0.10, 0.40);
    p->height += taller;
    for (double* y : {&p->headlight_y, &p->cowl_y, &p->rear_window_y, &p->tail_y}) {
      *y += 0.55 * taller;
    }
    p->wheel_radius += 0.12 * taller;
    p->clearance += 0.25 * taller;
    p->bumper_height += 0.25 * taller;
    p->rear_window_x = random->uniform(1.3, 1.75);
    p->tail_y = p->rear_window_y - random->uniform(0.02, 0.10);
    p->roof_rear_x = random->uniform(0.55, 0.85);
    p->tail_width = p->bumper_width = 0.93;
  } else if (random->chance(0.3)) {
    p->height *= random->uniform(0.95, 1.06);
    p->width *= random->uniform(0.95, 1.05);
    p->cowl_x += random->uniform(-0.15, 0.15);
    p->roof_front_x += random->uniform(-0.15, 0.2);
    p->roof_width += random->uniform(-0.04, 0.06);
    p->bumper_depth += random->uniform(0.0, 0.08);
  }
  if (random->chance(0.4)) p->arch_gap += random->uniform(0.0, 0.06);
  keep_order(p);
}

/// Corners that no car has sharp are put at other places by other annotators: bumpers lower, arches
/// larger, lamps farther out than the family has them (docs/notes/keypoint-crops.md).
void vary_annotation(Sequence* random, CarProportions* p) {
  p->bumper_height = std::max(0.16, p->bumper_height + random->uniform(-0.13, 0.05));
  p->arch_gap += random->uniform(0.0, 0.05);
  const double lower = random->uniform(-0.05, 0.25);  // [rad]
  p->arch_end_outer -= lower;
  p->arch_end_inner -= lower;
  p->tail_width += random->uniform(-0.02, 0.09);
  p->headlight_width += random->uniform(-0.02, 0.08);
  p->headlight_y += random->uniform(-0.02, 0.05);
  p->rear_window_y += random->uniform(-0.02, 0.07);
}

/// Keeps proportions that vary more than the family's those of a body: a roof of some length, no
/// part wider than the car, lamps and windows one above the other.
void keep_body(CarProportions* p) {
  for (double* width : {&p->roof_width, &p->cowl_width, &p->rear_window_width, &p->tail_width,
                        &p->headlight_width, &p->bumper_width}) {
    *width = std::clamp(*width, 0.5, 0.985);
  }
  p->arch_width = std::clamp(p->arch_width, 0.88, 0.99);
  p->bumper_height = std::min(p->bumper_height, 1.5 * p->wheel_radius);
  p->headlight_y = std::max(p->headlight_y, p->bumper_height + 0.12);
  p->cowl_y = std::clamp(p->cowl_y, p->headlight_y + 0.08, p->height - 0.30);
  p->tail_y = std::clamp(p->tail_y, p->bumper_height + 0.15, p->height - 0.40);
  p->rear_window_y = std::clamp(p->rear_window_y, p->tail_y + 0.02, p->height - 0.30);
  keep_order(p);
  p->roof_rear_x = std::min(p->roof_rear_x, p->wheelbase + p->roof_front_x - 0.6);
}

int nearest_vertex(const TriangleMesh& mesh, const Eigen::Vector3d& point) {
  const auto at = std::min_element(mesh.vertices.begin(), mesh.vertices.end(),
                                   [&](const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
                                     return (a - point).squaredNorm() < (b - point).squaredNorm();
                                   });
  return static_cast<int>(at - mesh.vertices.begin());
}

/// Each vertex's mirror image on the car's other side; itself where there is none.
std::vector<int> mirror_images(const std::vector<Eigen::Vector3d>& vertices) {
  // Rounded to a tenth of a millimetre; the two sides are computed alike but for the last digit.
  const auto key = [](const Eigen::Vector3d& p) {
    const auto whole = [](double x) { return static_cast<long>(std::floor(1e4 * x + 0.37)); };
    return std::array<long, 3>{whole(p.x()), whole(p.y()), whole(std::abs(p.z()))};
  };
  std::map<std::array<long, 3>, std::vector<int>> places;
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    places[key(vertices[i])].push_back(static_cast<int>(i));
  }
  std::vector<int> out(vertices.size());
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    out[i] = static_cast<int>(i);
    for (const int other : places[key(vertices[i])]) {
      if (vertices[other].z() * vertices[i].z() < 0.0) out[i] = other;
    }
  }
  return out;
}

/// Moves the vertices of the body's shell towards the middle of their neighbours: rounds its edges.
/// Hem, skirts, underside and wheels stay; keypoints go with their vertices, both sides alike.
void round_body(float weight, int iterations, CarModel* model) {
  TriangleMesh& mesh = model->mesh;
  const auto count = mesh.vertices.size();
  std::vector<Eigen::Vector3d> sum(count);
  std::vector<int> neighbours(count);
  std::vector<bool> fixed(count, false);
  std::array<int, kNumKeypoints> vertex_of;
  for (int k = 0; k < kNumKeypoints; ++k) vertex_of[k] = nearest_vertex(mesh, model->keypoints[k]);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const Eigen::Vector3i& t = mesh.triangles[i];
    const auto material = static_cast<CarMaterial>(mesh.materials[i]);
    const Eigen::Vector3d& a = mesh.vertices[t[0]];
    const Eigen::Vector3d normal =
        (mesh.vertices[t[1]] - a).cross(mesh.vertices[t[2]] - a).normalized();
    const bool skirt =
        material == CarMaterial::kTrim && (std::abs(normal.z()) > 0.5 || normal.y() < -0.5);
    if (skirt || material == CarMaterial::kTyre || material == CarMaterial::kRim) {
      for (int k = 0; k < 3; ++k) fixed[t[k]] = true;
    }
  }
  // The two halves are not cut into triangles alike, so that neighbours differ: what a vertex is
  // moved by is the mean of its own change and its mirror image's.
  const std::vector<int> images = mirror_images(mesh.vertices);
  const Eigen::Vector3d mirror(1.0, 1.0, -1.0);
  std::vector<Eigen::Vector3d> change(count);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    std::fill(sum.begin(), sum.end(), Eigen::Vector3d::Zero());
    std::fill(neighbours.begin(), neighbours.end(), 0);
    for (const Eigen::Vector3i& t : mesh.triangles) {
      for (int k = 0; k < 3; ++k) {
        sum[t[k]] += mesh.vertices[t[(k + 1) % 3]] + mesh.vertices[t[(k + 2) % 3]];
        neighbours[t[k]] += 2;
      }
    }
    for (std::size_t v = 0; v < count; ++v) {
      change[v].setZero();
      if (fixed[v] || fixed[images[v]] || neighbours[v] == 0) continue;
      change[v] = static_cast<double>(weight) * (sum[v] / neighbours[v] - mesh.vertices[v]);
    }
    for (std::size_t v = 0; v < count; ++v) {
      mesh.vertices[v] += 0.5 * (change[v] + change[images[v]].cwiseProduct(mirror));
    }
  }
  for (int k = 0; k < kNumKeypoints; ++k) {
    model->keypoints[k] = mesh.vertices[vertex_of[k]];
  }
}

/// Bends the body above the wheels by a smooth random field, both sides alike, keypoints with it:
/// shapes that no choice of the family's proportions gives.
/// @param size  of the displacements, m
void warp_body(double size, Sequence* random, CarModel* model) {
  struct Wave {
    double amplitude, per_x, per_y, phase;
  };
  std::array<std::array<Wave, 2>, 3> waves;  // of x, y and the width
  for (auto& axis : waves) {
    for (Wave& w : axis) {
      w.amplitude = size * random->normal();
      w.per_x = random->uniform(0.5, 2.2);
      w.per_y = random->uniform(-3.0, 3.0);
      w.phase = random->uniform(0.0, 6.28);
    }
  }
  const double low = 2.1 * model->wheel_radius, half_width = 0.5 * model->dimensions.width;
  const auto moved = [&](const Eigen::Vector3d& p) {
    // Nothing moves at the height of the wheels and their arches.
    const double share = std::clamp((p.y() - low) / 0.4, 0.0, 1.0);
    Eigen::Vector3d change = Eigen::Vector3d::Zero();
    for (int axis = 0; axis < 3; ++axis) {
      for (const Wave& w : waves[axis]) {
        change[axis] += w.amplitude * std::sin(w.per_x * p.x() + w.per_y * p.y() + w.phase);
      }
    }
    change.z() *= p.z() / half_width;
    return Eigen::Vector3d(p + share * change);
  };
  for (Eigen::Vector3d& v : model->mesh.vertices) v = moved(v);
  for (Eigen::Vector3d& k : model->keypoints) k = moved(k);
}

/// Moves each pair of keypoints by itself, and the shell of the body with them, so that no place of
/// a car follows from the others: annotated shapes are some 8 cm away from any smooth family
/// (docs/notes/keypoint-crops.md). Between the keypoints the displacement is interpolated over the
/// side view; wheels stay.
/// @param size  standard deviation of a displacement along an axis, m
void move_keypoints(double size, Sequence* random, CarModel* model) {
  constexpr int kFirst = 2, kCount = kNumKeypoints / 2 - kFirst;  // of one side, without wheels
  constexpr int kLastArch = 9;
  constexpr double kReach = 0.35, kSmoothing = 0.05;  // m; of the kernel's diagonal
  constexpr double kArchShare = 0.4;                  // an arch stays about its wheel
  const auto kernel = [](double x, double y) {
    return std::exp(-(x * x + y * y) / (2.0 * kReach * kReach));
  };
  Eigen::Matrix<double, kCount, kCount> gram;
  Eigen::Matrix<double, kCount, 3> moved;
  for (int i = 0; i < kCount; ++i) {
    const Eigen::Vector3d& a = model->keypoints[kFirst + i];
    for (int j = 0; j < kCount; ++j) {
      const Eigen::Vector3d& b = model->keypoints[kFirst + j];
      gram(i, j) = kernel(a.x() - b.x(), a.y() - b.y()) + (i == j ? kSmoothing : 0.0);
    }
    const double share = kFirst + i <= kLastArch ? kArchShare : 1.0;
    for (int axis = 0; axis < 3; ++axis) moved(i, axis) = share * size * random->normal();
  }
  const Eigen::Matrix<double, kCount, 3> coefficients = gram.ldlt().solve(moved);
  std::array<Eigen::Vector2d, kCount> middles;
  for (int i = 0; i < kCount; ++i) middles[i] = model->keypoints[kFirst + i].head<2>();
  const double half_width = 0.5 * model->dimensions.width;
  const auto change_at = [&](const Eigen::Vector3d& p) {
    Eigen::Vector3d change = Eigen::Vector3d::Zero();
    for (int i = 0; i < kCount; ++i) {
      change += kernel(p.x() - middles[i].x(), p.y() - middles[i].y()) * coefficients.row(i);
    }
    change.z() *= p.z() / half_width;
    return change;
  };
  TriangleMesh& mesh = model->mesh;
  std::vector<bool> wheel(mesh.vertices.size(), false);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto material = static_cast<CarMaterial>(mesh.materials[i]);
    if (material != CarMaterial::kTyre && material != CarMaterial::kRim) continue;
    for (int k = 0; k < 3; ++k) wheel[mesh.triangles[i][k]] = true;
  }
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    if (!wheel[i]) mesh.vertices[i] += change_at(mesh.vertices[i]);
  }
  for (const int side : {0, kNumKeypoints / 2}) {
    for (int i = kFirst; i < kFirst + kCount; ++i) {
      Eigen::Vector3d& k = model->keypoints[side + i];
      k += change_at(k);
    }
  }
}

/// Seats with head rests, a dashboard and perhaps a driver, seen through the glass.
void add_cabin(const CropCarPlaces& at, Sequence* random, CropMesh* mesh) {
  const Eigen::Matrix3f level = Eigen::Matrix3f::Identity();
  const auto inside = static_cast<std::uint8_t>(CropCarMaterial::kCabin);
  const float belt = 0.5f * (at.cowl.y() + at.rear_window.y());
  const float front = at.cowl.x() - part(random, 0.95, 1.25);
  const float rear = std::max(at.rear_window.x() + 0.35f, front - part(random, 0.75, 1.0));
  const float top = std::min(belt + part(random, 0.02, 0.14), at.roof_front.y() - 0.35f);
  for (const float x : {front, rear}) {
    for (const float side : {-1.0f, 1.0f}) {
      const float z = side * 0.42f * at.half_width;
      mesh->add_box({x, top - 0.3f, z}, level, {0.06f, 0.30f, 0.23f}, inside);
      if (random->chance(0.8)) {
        mesh->add_box({x - 0.02f, top + 0.10f, z}, level, {0.04f, 0.07f, 0.12f}, inside);
      }
    }
  }
  mesh->add_box({at.cowl.x() - 0.25f, at.cowl.y() - 0.12f, 0.0f}, level,
                {0.15f, 0.10f, 0.75f * at.half_width}, inside);
  if (random->chance(0.4)) {
    const float z = (random->chance(0.75) ? -0.42f : 0.42f) * at.half_width;
    const float head = std::min(belt + 0.22f, at.roof_front.y() - 0.22f);
    mesh->add_box({front + 0.12f, head, z}, level, {0.09f, 0.12f, 0.08f}, inside);
    mesh->add_box({front + 0.12f, head - 0.35f, z}, level, {0.10f, 0.2f, 0.2f}, inside);
  }
}

CropCarParts draw_parts(const CropCarPlaces& at, CarClass car_class, Sequence* random) {
  CropCarParts p{};
  p.headlight_height = part(random, 0.28, 0.55);
  p.headlight_inner = part(random, 0.45, 0.72);
  p.headlight_wrap = part(random, 0.0, 0.35);
  p.grille_high = part(random, 0.80, 0.98);
  p.grille_low = part(random, 0.40, 0.72);
  p.grille_width = part(random, 0.18, 0.60);
  p.grille_bars = random->chance(0.7) ? part(random, 0.03, 0.08) : 0.0f;
  p.intake_high = part(random, 0.12, 0.36);
  p.intake_width = part(random, 0.35, 0.80);
  p.front_plate_low = part(random, 0.22, 0.48);
  p.rear_plate_low = random->chance(0.65) ? part(random, 0.45, 0.70) : part(random, 0.14, 0.28);
  p.tail_low = part(random, 0.30, 0.74);
  p.tail_inner = random->chance(0.5) ? part(random, 0.72, 0.84) : part(random, 0.45, 0.72);
  p.tail_wrap = part(random, 0.02, 0.28);
  const bool tailgate = car_class != CarClass::kSaloon;
  p.tail_pillar = tailgate && random->chance(0.3) ? part(random, 0.06, 0.12) : 0.0f;
  p.bumper_high = part(random, 0.34, 0.54);
  p.strip_y = part(random, 0.40, 0.60);
  p.strip_half = random->chance(0.4) ? part(random, 0.015, 0.05) : 0.0f;
  const bool rugged = car_class == CarClass::kSuv ? random->chance(0.5) : random->chance(0.06);
  p.cladding_y = rugged ? at.wheel_y + part(random, -0.02, 0.14) : 0.0f;
  p.arch_cladding = rugged ? part(random, 0.03, 0.09) : 0.0f;
  p.pillar_a = part(random, 0.05, 0.12);
  p.pillar_b = part(random, 0.05, 0.13);
  p.pillar_c = random->chance(0.75) ? part(random, 0.05, 0.16) : 0.0f;
  p.pillar_d = part(random, 0.06, 0.30);
  p.pillar_b_at = part(random, 0.46, 0.60);
  p.pillar_c_at = part(random, 0.14, 0.26);
  p.window_low = part(random, 0.03, 0.12);
  p.window_high = part(random, 0.84, 0.95);
  p.window_slope = part(random, -0.02, 0.14);
  p.rear_window_low = part(random, 0.04, 0.25);
  p.rear_window_high = part(random, 0.85, 0.97);
  p.rear_window_width = part(random, 0.76, 0.95);
  p.gap_half = part(random, 0.002, 0.006);
  p.rim_share = part(random, 0.56, 0.80);
  p.spoke_share = part(random, 0.30, 0.75);
  p.spokes = 4 + random->below(9);
  return p;
}

/// Tails as hatchbacks, vans and estates have them, whose rear a network may take for a front.
void vary_tail(CarClass car_class, Sequence* random, CropCarParts* p) {
  const bool tailgate = car_class != CarClass::kSaloon;
  p->pillar_lamp_low = -0.1f;
  p->pillar_lamp_high = 0.8f;
  if (tailgate && random->chance(0.4)) {
    // A column at each side, along the window or below it or both.
    p->tail_inner = part(random, 0.74, 0.92);
    p->tail_pillar = random->chance(0.7) ? part(random, 0.05, 0.15) : 0.0f;
    p->pillar_lamp_low = random->chance(0.5) ? -0.1f : part(random, 0.1, 0.4);
    p->pillar_lamp_high = part(random, 0.5, 1.0);
    if (p->tail_pillar > 0.0f && random->chance(0.5)) p->tail_low = part(random, 0.75, 1.03);
  }
  p->tail_round = random->chance(0.12) ? part(random, 0.05, 0.10) : 0.0f;
  p->third_lamp = random->chance(0.7) ? part(random, 0.08, 0.25) : 0.0f;
  p->reflector = random->chance(0.4) ? part(random, 0.012, 0.035) : 0.0f;
  p->wiper = tailgate && random->chance(0.6) ? part(random, 0.25, 0.5) : 0.0f;
}

/// Mirrors, rails, box and spoiler. None of them moves a keypoint.
void add_extras(CarClass car_class, const CropCarPlaces& at, Sequence* random, CropMesh* mesh) {
  const Eigen::Matrix3f level = Eigen::Matrix3f::Identity();
  if (random->chance(0.95)) {
    const float size = part(random, 0.8, 1.25);
    const float forward = part(random, 0.15, 0.40), rise = part(random, 0.06, 0.13);
    for (const float side : {-1.0f, 1.0f}) {
      const Eigen::Vector3f middle(at.cowl.x() - forward, at.cowl.y() + rise,
                                   side * (at.half_width + 0.03f));
      mesh->add_box(middle, level, size * Eigen::Vector3f(0.04f, 0.065f, 0.09f),
                    id(CropCarMaterial::kHousing));
      mesh->add_box(middle - Eigen::Vector3f(0.042f * size, 0, 0), level,
                    size * Eigen::Vector3f(0.003f, 0.052f, 0.075f), id(CropCarMaterial::kMirror));
    }
  }
  const bool estate = car_class == CarClass::kEstate || car_class == CarClass::kSuv;
  const bool rails = random->chance(estate ? 0.6 : 0.07);
  const bool bars = random->chance(rails ? 0.2 : 0.04);
  const bool box = bars && random->chance(0.5);
  const float rail_rise = part(random, 0.025, 0.05);
  const float roof_z = std::min(at.roof_front.z(), at.roof_rear.z());
  for (const float side : {-1.0f, 1.0f}) {
    if (!rails) break;
    Eigen::Vector3f a = at.roof_rear, b = at.roof_front;
    a.z() = b.z() = side * (roof_z - 0.05f);
    a.y() += rail_rise, b.y() += rail_rise;
    mesh->add_post(a + 0.08f * (b - a), b - 0.12f * (b - a), 0.018f, 0.018f, 6,
                   id(CropCarMaterial::kRail));
  }
  for (const float share : {0.3f, 0.75f}) {
    if (!bars) break;
    Eigen::Vector3f c = at.roof_rear + share * (at.roof_front - at.roof_rear);
    c.y() = at.height + 0.05f;
    c.z() = 0.0f;
    mesh->add_box(c, level, {0.03f, 0.015f, roof_z - 0.03f}, id(CropCarMaterial::kRail));
  }
  if (box) {
    Eigen::Vector3f c = 0.5f * (at.roof_rear + at.roof_front);
    const float half = 0.4f * (at.roof_front.x() - at.roof_rear.x());
    c.y() = at.height + 0.24f;
    c.z() = part(random, -0.15, 0.15);
    mesh->add_box(c, level, {std::min(half, 0.95f), 0.17f, 0.38f}, id(CropCarMaterial::kBox));
  }
  if (car_class == CarClass::kHatchback && random->chance(0.3)) {
    const Eigen::Vector3f c(at.roof_rear.x() - 0.07f, at.roof_rear.y() + 0.02f, 0.0f);
    mesh->add_box(c, level, {0.10f, 0.015f, at.roof_rear.z() - 0.04f},
                  id(CropCarMaterial::kHousing));
  }
}

Color draw_paint(Sequence* random) {
  // Achromatic colours are two thirds of all cars.
  const double kind = random->uniform(0.0, 1.0);
  const auto grey = [&](double low, double high) {
    const auto v = static_cast<float>(std::exp(random->uniform(std::log(low), std::log(high))));
    const float warm = part(random, -0.06, 0.06);
    return Color(v * (1.0f + warm), v, v * (1.0f - warm));
  };
  if (kind < 0.17) return grey(0.60, 0.85);
  if (kind < 0.36) return grey(0.006, 0.03);
  if (kind < 0.68) return grey(0.03, 0.55);
  // A hue (HSV), more blue and red than others.
  const double hue = random->chance(0.6) ? (random->chance(0.5) ? random->uniform(-0.03, 0.03)
                                                                : random->uniform(0.55, 0.68))
                                         : random->uniform(0.0, 1.0);
  const float saturation = part(random, 0.3, 0.97);
  const auto value = static_cast<float>(std::exp(random->uniform(std::log(0.02), std::log(0.7))));
  Color out;
  for (int c = 0; c < 3; ++c) {
    const double x = std::fmod(hue + (3.0 - c) / 3.0 + 1.0, 1.0);
    const double away = std::min(x, 1.0 - x);  // of the channel from the hue, in turns
    const auto full = static_cast<float>(std::clamp(2.0 - 6.0 * away, 0.0, 1.0));
    out[c] = value * (1.0f - saturation + saturation * full);
  }
  return out;
}

}  // namespace

CropCarLook draw_crop_car_look(const CropCar& car, Sequence* random) {
  CropCarLook l;
  const CarClass car_class = car.model.car_class;
  l.seed = random->bits();
  l.parts = car.look.parts;
  l.paint = draw_paint(random);
  l.roof = random->chance(0.08) ? draw_paint(random) : l.paint;
  if (random->chance(0.04)) l.roof = Color::Constant(0.015f);
  l.roof_glass = random->chance(0.06);
  l.trim = Color::Constant(part(random, 0.012, 0.06));
  l.rim = random->chance(0.15) ? Color(Color::Constant(0.02f))
                               : Color(Color::Constant(part(random, 0.2, 0.6)));
  l.interior = Color::Constant(part(random, 0.01, 0.07));
  l.flake = random->chance(0.6) ? part(random, 0.2, 0.9) : 0.0f;
  l.clear_coat = part(random, 0.02, 0.08);
  l.dirt = random->chance(0.4) ? part(random, 0.1, 0.7) : part(random, 0.0, 0.1);
  l.clear = part(random, 0.25, 0.75);
  l.tint = random->chance(0.3) ? part(random, 0.6, 1.0) : part(random, 0.0, 0.4);
  l.painted_bumpers = random->chance(0.75);
  l.painted_sills = random->chance(0.6);
  l.chrome = random->chance(0.25);
  l.dark_pillars = random->chance(0.7);
  const bool van = car_class == CarClass::kVan;
  l.panel_sides = van && random->chance(0.4);
  l.rear_blind = van && random->chance(0.15);
  if (van && random->chance(0.4)) l.paint = l.roof = Color::Constant(part(random, 0.6, 0.85));
  l.lamps = random->chance(0.15);
  l.brakes = random->chance(0.12);
  l.indicator = random->chance(0.04);
  l.front_plate = random->chance(0.9);
  l.rear_plate = random->chance(0.96);
  l.yellow_rear_plate = random->chance(0.15);
  l.blue_band = random->chance(0.6);
  l.two_tone = random->chance(0.15);
  l.bumper =
      random->chance(0.7) ? Color(Color::Constant(part(random, 0.05, 0.6))) : draw_paint(random);
  l.clear_tails = random->chance(0.15);
  return l;
}

CropCar draw_crop_car(const CounterRandom& random, std::uint64_t index) {
  Sequence own(random.bits(index), 0x43415253u);
  // More vans and saloons than on the road: all shapes are to be learnt.
  constexpr double kShares[kNumCarClasses] = {0.34, 0.20, 0.16, 0.18, 0.12};
  double u = own.uniform(0.0, 1.0);
  int chosen = 0;
  while (chosen + 1 < kNumCarClasses && u >= kShares[chosen]) u -= kShares[chosen++];
  const auto car_class = static_cast<CarClass>(chosen);
  // Half of them shaped as no maker would: what a network learns of them holds for more cars.
  const double breadth = own.chance(0.5) ? own.uniform(1.0, 2.2) : 1.0;
  CarProportions proportions =
      sample_proportions(car_class, CounterRandom(random.bits(index), 0x50524F50u), 0, breadth);
  vary_proportions(car_class, &own, &proportions);
  // Of its own numbers: all else about the cars is as it was without.
  Sequence local(random.bits(index), 0x4C4F4341u);
  const bool moved = local.chance(0.4);
  const double moved_by = local.uniform(0.02, 0.09);
  const bool otherwise = local.chance(0.7);
  if (otherwise) vary_annotation(&local, &proportions);
  if (otherwise || breadth > 1.0) keep_body(&proportions);
  CropCar car;
  car.model = make_car(car_class, proportions);
  if (own.chance(0.6)) warp_body(own.uniform(0.0, 0.035), &own, &car.model);
  if (moved) move_keypoints(moved_by, &local, &car.model);
  const float weight = part(&own, 0.2, 0.6);
  const int iterations = own.below(4);
  float smooth_below = part(&own, 25.0, 60.0);  // [deg]
  Sequence facets(random.bits(index), 0x46414345u);
  if (facets.chance(0.4)) {
    facet_body(facets.uniform(0.01, 0.09), &facets, &car.model);
    smooth_below = part(&facets, 1.0, 35.0);
  } else {
    round_body(weight, iterations, &car.model);
  }
  car.places = places_of(car.model);
  car.mesh = smooth_mesh(car.model.mesh, std::cos(smooth_below * kDegree));
  for (std::uint8_t& material : car.mesh.materials) {
    const auto m = static_cast<CarMaterial>(material);
    if (m == CarMaterial::kGlass || m == CarMaterial::kLight || m == CarMaterial::kPlate) {
      material = id(CropCarMaterial::kBody);
    }
  }
  add_extras(car_class, car.places, &own, &car.mesh);
  add_cabin(car.places, &own, &car.mesh);
  car.look.parts = draw_parts(car.places, car_class, &own);
  // Of numbers of its own, as above.
  Sequence tails(random.bits(index), 0x5441494Cu);
  vary_tail(car_class, &tails, &car.look.parts);
  car.look = draw_crop_car_look(car, &own);
  return car;
}

}  // namespace camber
