#pragma once

#include <Eigen/Core>
#include <vector>

namespace camber {

/// Two unit directions that span the ground plan across `up`, and coordinates in it, m.
struct GroundAxes {
  Eigen::Vector3d e1, e2;
  explicit GroundAxes(const Eigen::Vector3d& up);
  Eigen::Vector2d operator()(const Eigen::Vector3d& x) const { return {e1.dot(x), e2.dot(x)}; }
};

using PlanPolygon = std::vector<Eigen::Vector2d>;

/// Corners of the convex hull, counterclockwise, without collinear ones (Andrew's monotone chain).
/// Fewer than 3 points, or collinear ones, come back as they are spanned: 0, 1 or 2 corners.
PlanPolygon convex_hull(std::vector<Eigen::Vector2d> points);

double polygon_area(const PlanPolygon& polygon);  ///< m^2, positive

/// Distance from a place to a polygon, m; 0 inside; infinite for an empty polygon.
double distance_to_polygon(const PlanPolygon& polygon, const Eigen::Vector2d& place);

/// Shortest way between two polygons: its ends, and its length (0 if they overlap; the ends are
/// then one place inside both).
struct PolygonGap {
  Eigen::Vector2d on_a = Eigen::Vector2d::Zero(), on_b = Eigen::Vector2d::Zero();
  double distance = 0.0;
  double overlap_area = 0.0;  ///< m^2, of the two convex hulls
};
PolygonGap polygon_gap(const PlanPolygon& a, const PlanPolygon& b);

}  // namespace camber
