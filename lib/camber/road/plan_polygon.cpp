#include "camber/road/plan_polygon.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "camber/geometry/plane.h"

namespace camber {

using Eigen::Vector2d;

namespace {

double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

Vector2d nearest_on_segment(const Vector2d& a, const Vector2d& b, const Vector2d& place) {
  const Vector2d edge = b - a;
  const double length2 = edge.squaredNorm();
  const double share = length2 > 0.0 ? std::clamp((place - a).dot(edge) / length2, 0.0, 1.0) : 0.0;
  return a + share * edge;
}

bool inside(const PlanPolygon& polygon, const Vector2d& place) {
  bool odd = false;
  Vector2d a = polygon.back();
  for (const Vector2d& b : polygon) {
    if ((a.y() > place.y()) != (b.y() > place.y()) &&
        place.x() < a.x() + (b.x() - a.x()) * (place.y() - a.y()) / (b.y() - a.y())) {
      odd = !odd;
    }
    a = b;
  }
  return odd;
}

/// The part of a polygon inside a convex one (Sutherland and Hodgman).
PlanPolygon clip(PlanPolygon subject, const PlanPolygon& convex) {
  for (std::size_t i = 0; i < convex.size() && !subject.empty(); ++i) {
    const Vector2d a = convex[i], edge = convex[(i + 1) % convex.size()] - a;
    PlanPolygon out;
    for (std::size_t k = 0; k < subject.size(); ++k) {
      const Vector2d& p = subject[k];
      const Vector2d& q = subject[(k + 1) % subject.size()];
      const double sp = cross(edge, p - a), sq = cross(edge, q - a);
      if (sp >= 0.0) out.push_back(p);
      if ((sp > 0.0 && sq < 0.0) || (sp < 0.0 && sq > 0.0)) {
        out.push_back(p + sp / (sp - sq) * (q - p));
      }
    }
    subject.swap(out);
  }
  return subject;
}

/// Takes out most points that cannot be corners of the hull: those inside the polygon of the
/// extremes in eight directions (Akl and Toussaint, "A fast convex hull algorithm", IPL 1978).
void leave_out_inner(std::vector<Vector2d>* points) {
  constexpr int kDirections = 8;
  if (points->size() < 64) return;
  std::array<Vector2d, kDirections> directions;
  std::array<double, kDirections> most;
  PlanPolygon extremes(kDirections);
  for (std::size_t d = 0; d < kDirections; ++d) {
    const double angle = 2.0 * M_PI * static_cast<double>(d) / kDirections;
    directions[d] = {std::cos(angle), std::sin(angle)};
    most[d] = -std::numeric_limits<double>::infinity();
  }
  for (const Vector2d& p : *points) {
    for (std::size_t d = 0; d < kDirections; ++d) {
      const double along = directions[d].dot(p);
      if (along > most[d]) {
        most[d] = along;
        extremes[d] = p;
      }
    }
  }
  points->erase(std::remove_if(points->begin(), points->end(),
                               [&](const Vector2d& p) {
                                 bool edge = false;
                                 for (std::size_t d = 0; d < kDirections; ++d) {
                                   const Vector2d& from = extremes[d];
                                   const Vector2d& to = extremes[(d + 1) % kDirections];
                                   if (from == to) continue;
                                   if (!(cross(to - from, p - from) > 0.0)) return false;
                                   edge = true;
                                 }
                                 return edge;
                               }),
                points->end());
}

}  // namespace

GroundAxes::GroundAxes(const Eigen::Vector3d& up) {
  const Eigen::Vector3d along =
      std::abs(up.z()) < 0.9 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX();
  UncertainPlane::make_axes(up, along, &e1, &e2);
}

PlanPolygon convex_hull(std::vector<Vector2d> points) {
  leave_out_inner(&points);
  std::sort(points.begin(), points.end(), [](const Vector2d& l, const Vector2d& r) {
    return l.x() < r.x() || (l.x() == r.x() && l.y() < r.y());
  });
  points.erase(std::unique(points.begin(), points.end()), points.end());
  if (points.size() < 3) return points;
  PlanPolygon hull;
  for (int turn = 0; turn < 2; ++turn) {
    const std::size_t base = hull.size();
    for (const Vector2d& p : points) {
      while (hull.size() >= base + 2 &&
             cross(hull.back() - hull[hull.size() - 2], p - hull.back()) <= 0.0) {
        hull.pop_back();
      }
      hull.push_back(p);
    }
    hull.pop_back();
    std::reverse(points.begin(), points.end());
  }
  return hull;
}

double polygon_area(const PlanPolygon& polygon) {
  double twice = 0.0;
  // From a corner: map coordinates are large.
  for (std::size_t i = 1; i + 1 < polygon.size(); ++i) {
    twice += cross(polygon[i] - polygon[0], polygon[i + 1] - polygon[0]);
  }
  return 0.5 * std::abs(twice);
}

double distance_to_polygon(const PlanPolygon& polygon, const Vector2d& place) {
  if (polygon.empty()) return std::numeric_limits<double>::infinity();
  if (polygon.size() >= 3 && inside(polygon, place)) return 0.0;
  double nearest = std::numeric_limits<double>::infinity();
  Vector2d a = polygon.back();
  for (const Vector2d& b : polygon) {
    nearest = std::min(nearest, (place - nearest_on_segment(a, b, place)).norm());
    a = b;
  }
  return nearest;
}

PolygonGap polygon_gap(const PlanPolygon& a, const PlanPolygon& b) {
  PolygonGap gap;
  gap.distance = std::numeric_limits<double>::infinity();
  if (a.empty() || b.empty()) return gap;
  const PlanPolygon hull_a = convex_hull(a), hull_b = convex_hull(b);
  if (hull_a.size() >= 3 && hull_b.size() >= 3) {
    const PlanPolygon both = clip(hull_a, hull_b);
    gap.overlap_area = polygon_area(both);
    if (gap.overlap_area > 0.0) {
      // Centroid of the area: corners come and go with rounding.
      Vector2d moment = Vector2d::Zero();
      double twice = 0.0;
      for (std::size_t k = 1; k + 1 < both.size(); ++k) {
        const Vector2d p = both[k] - both[0], q = both[k + 1] - both[0];
        moment += cross(p, q) * (p + q) / 3.0;
        twice += cross(p, q);
      }
      const Vector2d middle = both[0] + moment / twice;
      if (distance_to_polygon(a, middle) == 0.0 && distance_to_polygon(b, middle) == 0.0) {
        gap.on_a = gap.on_b = middle;
        gap.distance = 0.0;
        return gap;
      }
    }
  }
  const auto visit = [&](const PlanPolygon& corners, const PlanPolygon& edges, bool swapped) {
    Eigen::AlignedBox2d box;
    for (const Vector2d& p : edges) box.extend(p);
    for (const Vector2d& p : corners) {
      // Most corners are farther from all edges than the nearest one is: beyond rounding.
      constexpr double kRounding = 1e-12;
      const double slack = kRounding * (p.cwiseAbs().maxCoeff() + box.sizes().maxCoeff());
      if (box.exteriorDistance(p) > gap.distance + slack) continue;
      Vector2d from = edges.back();
      for (const Vector2d& to : edges) {
        const Vector2d q = nearest_on_segment(from, to, p);
        const double distance = (p - q).norm();
        if (distance < gap.distance) {
          gap.distance = distance;
          gap.on_a = swapped ? q : p;
          gap.on_b = swapped ? p : q;
        }
        from = to;
      }
    }
  };
  visit(a, b, false);
  visit(b, a, true);
  return gap;
}

}  // namespace camber
