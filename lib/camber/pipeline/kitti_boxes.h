#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/road/road_surface.h"
#include "camber/scene/import_kitti.h"
#include "camber/scene/kitti_labels.h"
#include "camber/scene/results.h"

namespace camber {

/// What a KITTI label does not hold of a box on a slope.
struct BoxTilt {
  double pitch = 0.0;  ///< rad, front axis above the camera's horizontal plane
  double roll = 0.0;   ///< rad, right side down
};

/// Rotation (columns front, up, right in the camera) of KITTI's rotation_y with pitch and roll; its
/// rotation_y() is the one given.
Eigen::Matrix3d rotation_of(double rotation_y, const BoxTilt& tilt);
/// The inverse of rotation_of.
BoxTilt tilt_of(const Eigen::Matrix3d& camera_from_vehicle);

/// One row of a label file put on the road.
struct LiftedBox {
  KittiLabel label;  ///< the row, with the new location (camera 0) and alpha
  BoxTilt tilt;
  Status status = Status::kNotRun;  ///< kFailed: left as it was, see reason
  std::string reason;
  int patch = -1;             ///< id of the patch below
  double depth_factor = 1.0;  ///< new distance over the detector's
  double sigma_depth = 0.0;   ///< m, along the ray, after the correction
};

struct LiftOptions {
  /// Standard deviation of the detector's distance, as a share of it, > 0.
  double depth_sigma = 0.08;
  double pixel_sigma = 1.5;    ///< px, of the box centre's place in the image, >= 0
  double height_sigma = 0.05;  ///< m, of half the box's height, >= 0
  void validate() const;       ///< throws std::invalid_argument
};

/// Puts a yaw-only 3D box on the road below it: distance along the ray of its centre corrected by
/// what the patch says, both weighed by their variances, then height, pitch and roll from the
/// patch; rotation_y and the ray stay.
/// @param camera  of the images; labels are in camera 0: x_in_camera = x_in_camera0 + its offset,
/// m.
/// @param camera_from_reference  takes the surface's frame to that camera.
/// A row without a 3D box, or above no patch, is kept as it was with kFailed.
LiftedBox lift_box(const KittiLabel& label, const RoadSurface& surface,
                   const SE3& camera_from_reference, const KittiCalibration::Camera& camera,
                   const LiftOptions& options);

/// The side file of a label file: its name with ".tilt.csv" in place of the extension. A header,
/// then "row,frame,track,pitch,roll,status,patch,depth_factor,sigma_depth,reason" for each row,
/// from 0.
std::filesystem::path tilt_file(const std::filesystem::path& labels);
void write_tilts(const std::vector<LiftedBox>& boxes, const std::filesystem::path& path);
/// Tilts by row. @throws InputError "file: line: found, expected".
std::vector<BoxTilt> read_tilts(const std::filesystem::path& path, std::size_t rows);

/// A scene whose truth are the vehicles (car, van, truck, bus) of a label file, with no images: for
/// evaluation alone. Occlusion and truncation as import_kitti has them; rows of the object form are
/// frame `frame`.
Scene truth_from_kitti(const KittiLabelFile& labels, const KittiCalibration::Camera& camera,
                       int width, int height, int frame, const std::string& name);

/// A label file as a result: upright boxes, or tilted ones where tilts are given (one a row).
VehicleDocument vehicles_from_kitti(const KittiLabelFile& labels,
                                    const KittiCalibration::Camera& camera, int frame,
                                    const std::vector<BoxTilt>& tilts, const std::string& method);

/// Vehicles as rows of a label file in the tracking form, and their tilts for the side file:
/// rows in the order of the document, those without an answer left out.
/// @param scene   gives the detections' tracks and scores, by frame and id.
/// @param offset  x_in_camera = x_in_camera0 + offset, m; zero: locations in the scene's camera.
std::vector<LiftedBox> kitti_from_vehicles(const VehicleDocument& document, const Scene& scene,
                                           const Eigen::Vector3d& offset);

}  // namespace camber
