#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/vehicles.h"

namespace camber {

/// Where the paper's metres come from, the camera's height given.
enum class PaperScale {
  kEgo,   ///< once for the whole reconstruction, by the height above the ego patch
  kPatch  ///< as printed: each patch by the median of its points' y, by itself; right on level
          ///< roads
};
std::string to_string(PaperScale scale);  ///< "ego", "patch"
/// Inverse of to_string. @throws std::invalid_argument for another name.
PaperScale paper_scale_from_string(const std::string& name);

/// The dominant plane of some road points, m, reference camera.
struct RansacPlane {
  Status status = Status::kNotRun;  ///< kFailed: too few points, or no plane
  std::string reason;
  UncertainPlane plane;      ///< centroid: of the inliers; covariance by PaperPlaneSigmas
  std::vector<int> inliers;  ///< indices of the triangulated points, ascending
  int points = 0;            ///< that it was sought in
  double metres_per_baseline = 1.0;
};

/// The ground as the paper has it: one plane under the camera, one under each vehicle.
struct PaperGround {
  double metres_per_baseline = 1.0;
  bool metric = true;
  EgoPlane ego;  ///< up to scale, as the ground stage fits it: it gives the metres
  std::vector<RansacPlane> planes;  ///< under vehicles of all frames, those with enough points
  /// [frame][detection]: index into `planes`, of its own or of the nearest vehicle's plane; -1:
  /// ego.
  std::vector<std::vector<int>> under_vehicles;
  std::vector<std::vector<int>> own;  ///< [frame][detection]: of its own; -1: none
};

namespace stages {

/// How far a plane is off at its centroid, by where it is from: weights of the planes' part of
/// L_reg, and the stated covariance. Hand-set.
struct PaperPlaneSigmas {
  double own_height = 0.05, own_tilt = 0.02;             ///< m, rad; of the vehicle's own points
  double own_height_growth = 0.0003;                     ///< m / m^2: and by its squared distance
  double neighbour_height = 0.6, neighbour_tilt = 0.05;  ///< m, rad; of another vehicle's
};

struct PaperGroundOptions {
  PaperScale scale = PaperScale::kEgo;
  double box_expansion = 1.95;          ///< of a detection's box, in which road points are its own
  int least_points = 50;                ///< fewer: the nearest vehicle's plane, then the ego plane
  double inlier_threshold = 0.03;       ///< m, least, of RANSAC; more where the points are noisier
  double max_tilt = 0.6;                ///< rad, of a plane against the camera's level
  double unknown_camera_height = 1.65;  ///< m, taken where none is known: the unit of the result
  PaperPlaneSigmas sigmas;
};

/// The paper's planes (section III-C): under every vehicle the dominant plane of the road points in
/// its expanded box, by RANSAC (PCL), with metres by the camera's height over the ego patch.
/// @param ground  of which the points and the ego plane are taken, not the field.
/// @throws NoAnswerError where no road point of several images carries the ego plane.
PaperGround paper_ground(const LoadedFrames& frames, const Correspondences& matches,
                         const MotionEstimate& motion, const Ground& ground,
                         const PaperGroundOptions& options);

/// What a frame's vehicles stand on.
/// @param frame  index.
FrameGround ground_of_frame(const PaperGround& ground, const LoadedFrames& frames,
                            const MotionEstimate& motion, std::size_t frame,
                            const PaperGroundOptions& options, const SupportOptions& support);

}  // namespace stages
}  // namespace camber
