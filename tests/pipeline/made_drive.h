#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/judge.h"
#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/scale.h"

namespace camber::test {

struct MadeDriveOptions {
  double pitch = 0.05;  ///< rad, by which the camera looks down on the road: the road's grade in it
  double height = 1.65;                                 ///< m, of the camera above the road
  std::vector<double> stations = {-1.2, 0.0, 1.0};      ///< m along the road, one a frame
  std::size_t reference = 1;                            ///< index of the frame at station 0
  bool masks = true;                                    ///< of road and pavement
  std::vector<std::vector<VehicleDetection>> vehicles;  ///< one list a frame, or none at all
};

/// A camera on a plane between two walls, with everything known exactly and no images drawn:
/// inputs for the stages that need none. The road is 7 m wide, pavements on both sides reach to the
/// walls 5 m from the middle; a wall closes the street
/// 45 m ahead.
struct MadeDrive {
  LoadedFrames frames;      ///< their images are of one grey each
  Correspondences matches;  ///< exact, every 4 pixels
  MotionEstimate motion;    ///< exact, the longest baseline 1
  Plane plane;              ///< of the road, reference camera, m
  double metres_per_baseline = 1.0;
  std::vector<double> depths;           ///< m, of the grid points
  std::vector<std::uint8_t> is_ground;  ///< one a grid point: road or pavement

  /// Unit direction of travel, reference camera.
  Eigen::Vector3d travel() const;
  double inverse_depth(const Eigen::Vector2d& pixel) const;  ///< of the road's plane, 1/m
};

MadeDrive make_drive(const MadeDriveOptions& options);

/// The plane of a drive as the ground stage would find it: points, ego plane, field, up to scale.
Ground exact_ground(const MadeDrive& drive);

/// The same as refine_photometrically() hands it on where the images add nothing.
PhotometricGround exact_photometric(const MadeDrive& drive);

/// The drive's road in metres, its scale known to `log_scale_sigma`.
ScaledRoad exact_scaled(const MadeDrive& drive, double log_scale_sigma);

/// A road as it is found, scaled and judged, without vehicles.
JudgedRoad judged_road(const LoadedFrames& frames, const Correspondences& matches,
                       const PhotometricGround& ground);
inline JudgedRoad judged_road(const MadeDrive& drive, const PhotometricGround& ground) {
  return judged_road(drive.frames, drive.matches, ground);
}

/// A plane search that found a road with so long baselines, in camera heights.
PlaneSearchResult searched(double log_baseline, bool informative);

/// Paints a broken line (strokes of 3 m, gaps of 6 m, 12 cm wide) and a crossing (stripes and gaps
/// of 50 cm) on the road of the reference image.
void paint_markings(MadeDrive* drive);

/// The first report of that name; null: there is none.
const ConstraintReport* report_of(const std::vector<ConstraintReport>& reports,
                                  const std::string& name);

}  // namespace camber::test
