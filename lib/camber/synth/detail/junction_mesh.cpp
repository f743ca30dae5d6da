#include "camber/synth/detail/junction_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <tuple>
#include <vector>

#include "camber/synth/detail/ground_mesh.h"
#include "camber/synth/detail/ground_objects.h"
#include "camber/synth/detail/mesh_builder.h"

namespace camber {
namespace {

using Polygon = std::vector<Eigen::Vector2d>;  // convex, counter-clockwise, (station, offset)
using Level = std::function<double(const Eigen::Vector2d&)>;

/// Grid lines from `begin` to `end`, `fine` m apart within [fine_begin, fine_end], then each step
/// 1.18 times as wide, up to 8 m.
std::vector<double> grid_lines(double begin, double fine_begin, double fine_end, double end,
                               double fine) {
  std::vector<double> lines;
  double step = fine;
  for (double x = fine_begin - fine; x > begin; x -= step) {
    lines.push_back(x);
    step = std::min(8.0, 1.18 * step);
  }
  std::reverse(lines.begin(), lines.end());
  const int count = static_cast<int>(std::ceil((fine_end - fine_begin) / fine));
  for (int i = 0; i <= count; ++i) lines.push_back(fine_begin + i * fine);
  step = fine;
  for (double x = lines.back() + fine; x < end; x += step) {
    lines.push_back(x);
    step = std::min(8.0, 1.18 * step);
  }
  return lines;
}

/// Where a level changes its sign between two places; the same whichever comes first.
Eigen::Vector2d zero_between(const Level& level, Eigen::Vector2d a, Eigen::Vector2d b) {
  if (a.x() > b.x() || (a.x() == b.x() && a.y() > b.y())) std::swap(a, b);
  const bool a_below = level(a) < 0.0;
  for (int i = 0; i < 30; ++i) {
    const Eigen::Vector2d middle = 0.5 * (a + b);
    ((level(middle) < 0.0) == a_below ? a : b) = middle;
  }
  return 0.5 * (a + b);
}

struct Halves {
  Polygon below, above;
  /// Indices in `below` of the cut's ends: the edge from cut to the next corner is the cut.
  int cut = -1;
};

/// Cuts a convex polygon along the zero line of a level, taken as straight within it.
Halves cut(const Polygon& polygon, const Level& level) {
  Halves out;
  const int n = static_cast<int>(polygon.size());
  std::vector<bool> below(n);
  for (int i = 0; i < n; ++i) below[i] = level(polygon[i]) < 0.0;
  for (int i = 0; i < n; ++i) {
    const int j = (i + 1) % n;
    (below[i] ? out.below : out.above).push_back(polygon[i]);
    if (below[i] == below[j]) continue;
    const Eigen::Vector2d p = zero_between(level, polygon[i], polygon[j]);
    if (below[i]) out.cut = static_cast<int>(out.below.size());
    out.below.push_back(p);
    out.above.push_back(p);
  }
  if (out.below.size() < 3) out.below.clear();
  if (out.above.size() < 3) out.above.clear();
  return out;
}

class JunctionMesh {
 public:
  JunctionMesh(const RoadModel& road, std::uint32_t seed, float contrast, SynthMesh* mesh)
      : road_(road),
        junction_(*road.layout().junction),
        mesh_(mesh),
        builder_(mesh),
        objects_(road.layout().half_width, seed, contrast, &builder_) {
    street_ =
        builder_.add_object(asphalt_object(junction_.half_width, contrast, true, seed + 0x51ED27u));
    middle_ = builder_.add_object(
        asphalt_object(road.layout().half_width, contrast, false, seed + 0x2545F5u));
    // Streets are marked up to where the corners' kerbs begin.
    const double slant = 1.0 / std::sin(junction_.angle);
    clear_ahead_ = junction_.half_width + junction_.kerb_radius + 1.0;
    clear_across_ = slant * (road.layout().half_width + junction_.kerb_radius + 1.0);
  }

  void build() {
    const double reach = clear_ahead_ + 14.0;
    const double wide = std::max(26.0, clear_across_ + 12.0);
    const std::vector<double> s =
        grid_lines(kRoadBegin, kRoadBegin + 1.0, junction_.station + reach, 170.0, 0.25);
    const std::vector<double> t = grid_lines(-130.0, -wide, wide, 130.0, 0.25);
    for (std::size_t i = 0; i + 1 < s.size(); ++i) {
      for (std::size_t k = 0; k + 1 < t.size(); ++k) {
        add_cell({{s[i], t[k]}, {s[i + 1], t[k]}, {s[i + 1], t[k + 1]}, {s[i], t[k + 1]}});
      }
    }
  }

 private:
  void add_cell(const Polygon& cell) {
    const RoadLayout& layout = road_.layout();
    const auto edge = [this](const Eigen::Vector2d& p) {
      return road_.edge_distance(p.x(), p.y());
    };
    const Halves halves = cut(cell, edge);
    if (!halves.below.empty()) add_carriageway(halves.below);
    if (halves.above.empty()) return;
    if (halves.cut >= 0) {
      const int n = static_cast<int>(halves.below.size());
      kerb_face(halves.below[halves.cut], halves.below[(halves.cut + 1) % n]);
    }
    if (!layout.pavement[0]) {
      add_verge(halves.above);
      return;
    }
    const Halves kerb =
        cut(halves.above, [&](const Eigen::Vector2d& p) { return edge(p) - layout.kerb_width; });
    if (!kerb.below.empty()) add(kerb.below, true, objects_.of(GroundKind::kKerb), Along::kEdge);
    if (kerb.above.empty()) return;
    const Halves pavement =
        cut(kerb.above, [&](const Eigen::Vector2d& p) { return edge(p) - layout.pavement_width; });
    if (!pavement.below.empty()) {
      add(pavement.below, true, objects_.of(GroundKind::kPavement), Along::kRoad);
    }
    if (!pavement.above.empty())
      add(pavement.above, true, objects_.of(GroundKind::kVerge), Along::kRoad);
  }

  /// A verge that rises within a few decimetres needs vertices there.
  void add_verge(const Polygon& polygon) {
    const RoadLayout& layout = road_.layout();
    Polygon rest = polygon;
    for (int i = 1; i <= 4 && layout.verge_rise[0] != 0.0 && !rest.empty(); ++i) {
      const Halves halves = cut(rest, [&](const Eigen::Vector2d& p) {
        return road_.edge_distance(p.x(), p.y()) - layout.verge_rise_width * i / 4.0;
      });
      if (!halves.below.empty())
        add(halves.below, true, objects_.of(GroundKind::kVerge), Along::kRoad);
      rest = halves.above;
    }
    if (!rest.empty()) add(rest, true, objects_.of(GroundKind::kVerge), Along::kRoad);
  }

  /// Road, street and the middle between them have their own texture coordinates.
  void add_carriageway(const Polygon& polygon) {
    const auto from_street = [this](const Eigen::Vector2d& p) {
      return std::abs(junction_.street_coordinates(p.x(), p.y()).y()) - clear_ahead_;
    };
    const auto from_road = [this](const Eigen::Vector2d& p) {
      return std::abs(junction_.street_coordinates(p.x(), p.y()).x()) - clear_across_;
    };
    const Halves road = cut(polygon, from_street);
    if (!road.above.empty()) add(road.above, false, objects_.of(GroundKind::kRoad), Along::kRoad);
    if (road.below.empty()) return;
    const Halves street = cut(road.below, from_road);
    if (!street.above.empty()) add(street.above, false, street_, Along::kStreet);
    if (!street.below.empty()) add(street.below, false, middle_, Along::kRoad);
  }

  double height(const Eigen::Vector2d& p, bool beside) const {
    return beside ? road_.side_height(p.x(), p.y()) : road_.road_height(p.x(), p.y());
  }

  struct Vertex {
    Eigen::Vector3d point;
    Eigen::Vector3f normal;
  };

  /// Of the carriageway's surface, or of what lies beside it; each place is made once.
  const Vertex& vertex(const Eigen::Vector2d& p, bool beside) {
    const auto [found, added] = vertices_.try_emplace({p.x(), p.y(), beside});
    if (!added) return found->second;
    const Eigen::Vector2d plan = road_.place(p.x(), p.y());
    found->second.point = {plan.x(), plan.y(), height(p, beside)};
    // The road is straight along the world's x, so that the gradient is that over (s, t).
    constexpr double kStep = 0.05;
    const Eigen::Vector2d ds(kStep, 0.0), dt(0.0, kStep);
    const double gs = (height(p + ds, beside) - height(p - ds, beside)) / (2 * kStep);
    const double gt = (height(p + dt, beside) - height(p - dt, beside)) / (2 * kStep);
    found->second.normal = Eigen::Vector3d(-gs, -gt, 1.0).normalized().cast<float>();
    return found->second;
  }

  /// What texture coordinates are along.
  enum class Along { kRoad, kStreet, kEdge };

  Eigen::Vector2f texture(const Eigen::Vector2d& p, Along along) const {
    switch (along) {
      case Along::kStreet:
        return junction_.street_coordinates(p.x(), p.y()).cast<float>();
      case Along::kEdge:
        return Eigen::Vector2d(along_edge(p), road_.edge_distance(p.x(), p.y())).cast<float>();
      case Along::kRoad:
        break;
    }
    return {static_cast<float>(road_.profile().arc_length(p.x())), static_cast<float>(p.y())};
  }
  double along_edge(const Eigen::Vector2d& p) const {
    return junction_.along_edge(p.x(), p.y(), road_.layout().half_width);
  }

  void add(const Polygon& p, bool beside, int object, Along along) {
    for (int i = 1; i + 1 < static_cast<int>(p.size()); ++i) {
      const Eigen::Vector2d a = p[i] - p[0], b = p[i + 1] - p[0];
      if (a.x() * b.y() - a.y() * b.x() < 1e-12) continue;
      SynthTriangle triangle;
      triangle.object = object;
      for (int k = 0; k < 3; ++k) {
        const Eigen::Vector2d& q = p[k == 0 ? 0 : i + k - 1];
        const Vertex& v = vertex(q, beside);
        triangle.points[k] = v.point;
        triangle.normals[k] = v.normal;
        triangle.texture[k] = texture(q, along);
      }
      mesh_->triangles.push_back(triangle);
    }
  }

  void kerb_face(const Eigen::Vector2d& p, const Eigen::Vector2d& q) {
    const Eigen::Vector2d a = road_.place(p.x(), p.y()), b = road_.place(q.x(), q.y());
    const double low_a = height(p, false), low_b = height(q, false);
    const double high_a = height(p, true), high_b = height(q, true);
    if (high_a - low_a < 1e-6 && high_b - low_b < 1e-6) return;
    const auto u = [this](const Eigen::Vector2d& x) { return static_cast<float>(along_edge(x)); };
    builder_.quad(objects_.of(GroundKind::kKerb),
                  {Eigen::Vector3d(a.x(), a.y(), low_a), Eigen::Vector3d(b.x(), b.y(), low_b),
                   Eigen::Vector3d(b.x(), b.y(), high_b), Eigen::Vector3d(a.x(), a.y(), high_a)},
                  {Eigen::Vector2f(u(p), 0), Eigen::Vector2f(u(q), 0),
                   Eigen::Vector2f(u(q), static_cast<float>(low_b - high_b)),
                   Eigen::Vector2f(u(p), static_cast<float>(low_a - high_a))});
  }

  const RoadModel& road_;
  const Junction& junction_;
  SynthMesh* mesh_;
  MeshBuilder builder_;
  GroundObjects objects_;
  int street_ = 0, middle_ = 0;
  double clear_ahead_ = 0.0, clear_across_ = 0.0;
  std::map<std::tuple<double, double, bool>, Vertex> vertices_;
};

}  // namespace

void build_junction_ground(const RoadModel& road, std::uint32_t seed, float contrast,
                           SynthMesh* mesh) {
  JunctionMesh(road, seed, contrast, mesh).build();
}

}  // namespace camber
