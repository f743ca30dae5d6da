#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/plane.h"
#include "camber/motion/path_curvature.h"

namespace camber {

/// Points of the road ahead in the camera frame, any unit, arrays of equal length.
struct RoadPoints {
  std::vector<Eigen::Vector3d> points;
  /// Standard deviation of the point's distance from the camera over that distance, > 0.
  std::vector<double> relative_sigma;
  /// d(log distance) / d(shared parameters), one row a point; no columns: nothing is shared.
  Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> shared_jacobian;
  /// Other positions of the same camera on its path, same frame and unit, in any order; may be
  /// empty. The road below them is the camera's height lower.
  std::vector<Eigen::Vector3d> camera_path;
  /// How far the camera has turned about up at each of those positions, rad, positive to the right;
  /// empty: not known.
  std::vector<double> camera_turns;
};

struct EgoPlaneOptions {
  double camera_height = 1.65;        ///< m above the road under the camera, > 0
  double camera_height_sigma = 0.01;  ///< m: mounting and suspension, >= 0
  double node_spacing = 1.0;          ///< m, > 0
  double reach = 30.0;                ///< m ahead that is used, > 8
  /// m to each side of the driven path that is used, > 0: between the wheels and no farther, since
  /// kerbs and verges lie beyond.
  double half_width = 1.4;
  double wide_half_width = 2.5;  ///< m, where the narrow strip holds too few points
  /// m, > 0: of the strip that the fit starts from, which grows from there. Between the wheels
  /// there is road; of a kerb beside them a fit of all at once may make a cross slope.
  double start_half_width = 0.7;
  int narrow_points = 150;  ///< fewer are too few
  PathNoise path;           ///< of the driven path
  /// Standard deviation of a road's fall to a side, >= 0: built to 2 to 2.5 % (AASHTO, "A Policy on
  /// Geometric Design of Highways and Streets", cross slope). A path that turns leaves one fall for
  /// another.
  double cross_fall = 0.02;
  double travel_sigma = 0.0042;  ///< rad, between the direction of travel and the road, > 0
  /// m: over longer distances than this, to either side, what the camera rises and falls against
  /// the road is a random walk, > 0.
  double travel_reach = 0.65;
  double heave = 0.0015;           ///< m, of the camera on its springs from frame to frame, >= 0
  double curvature = 0.007;        ///< 1/m, standard deviation of the vertical curvature, > 0
  double curvature_walk = 0.0014;  ///< 1/m per sqrt(m), change of curvature, > 0
  /// A change of curvature beyond so many standard deviations is taken for the begin or end of a
  /// vertical curve, > 0, and its own for at most so many times larger, >= 1; only where the road
  /// is seen from so many camera heights on.
  double curve_begins = 1.5, curve_begins_most = 3.0, near_road = 4.0;
  /// Of what a bend in the road changes, by which its unseen begin leaves the height open, >= 0:
  /// 400 runs of rendered roads.
  double bend_share = 0.2;
  double bank_walk = 0.0028;  ///< rad per sqrt(m), change of the cross slope, > 0
  /// rad, > 0: of the roll against the road of a camera that is mounted level, and of one that is
  /// not.
  double roll_sigma = 0.004, rolled_sigma = 0.04;
  double rolled_share = 0.5;     ///< of cameras that are not, in [0, 1]
  double surface_sigma = 0.015;  ///< m, unevenness of the road, > 0
  double correlation = 16.0;     ///< information of neighbours is divided by this, >= 1
  /// Factor on the covariance, >= 1: roads bend less evenly than a random walk, and their points
  /// share errors over whole stretches. Calibrated on rendered scenes.
  double inflation = 1.5;
  void validate() const;  ///< throws std::invalid_argument
};

/// The road's tangent plane under the camera.
struct EgoPlane {
  Status status = Status::kNotRun;  ///< see reason, unless kOk
  std::string reason;
  UncertainPlane plane;              ///< unit of the points; centroid: the foot under the camera
  double height = 0.0;               ///< of the camera above the plane, unit of the points
  double relative_sigma = 0.0;       ///< standard deviation of height over height
  double metres_per_baseline = 0.0;  ///< camera_height / height
  double near_plane_height = 0.0;    ///< from a plane through the first 6 m seen, or a parabola
  /// The road's centre line ahead (unit of the points): every node from the foot to the reach.
  std::vector<Eigen::Vector3d> line;
  int points = 0;    ///< that agree with it
  int compared = 0;  ///< points near the driven path
  /// d(plane's tilt, tilt, height) / d(shared parameters), columns as RoadPoints::shared_jacobian.
  Eigen::Matrix<double, 3, Eigen::Dynamic> shared_jacobian;
};

/// Estimates the tangent plane of the road under the camera, which is not seen: the road begins 5
/// to 8 m ahead and may bend before that. A profile of heights and cross slopes along the direction
/// of travel is fitted to the points with a random walk in curvature as prior, and carried back to
/// the camera with the direction of travel, along which the road under the wheels lies, or with the
/// camera's path, where it is given: it follows the road that is passed unseen.
/// @param travel  unit vector, the camera's direction of travel at this moment, camera frame.
/// @param up      rough up direction in the camera frame.
EgoPlane fit_ego_plane(const RoadPoints& road, const Eigen::Vector3d& travel,
                       const Eigen::Vector3d& up, const Eigen::MatrixXd& shared_covariance,
                       const EgoPlaneOptions& options);

}  // namespace camber
