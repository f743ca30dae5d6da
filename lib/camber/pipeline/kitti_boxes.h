#pragma once

#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/import/import_kitti.h"
#include "camber/import/kitti_labels.h"
#include "camber/road/road_surface.h"
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

/// One row of a label file whose distance was estimated anew (lift_box.h).
struct LiftedBox {
  KittiLabel label;  ///< the row, with the new location (camera 0) and alpha
  BoxTilt tilt;      ///< of the surface; zero where it was not used
  /// kOk: on the surface. kWeak: on its extrapolation, or by the 2D box alone, see reason.
  /// kFailed: left as it was.
  Status status = Status::kNotRun;
  std::string reason;
  /// What the distance was estimated from.
  bool by_detector = false, by_box = false, by_surface = false;
  int patch = -1;             ///< id of the patch below; -1: not on the surface
  double depth_factor = 1.0;  ///< new distance over the detector's
  /// m, standard deviation along the ray; NaN: the row has no 3D box.
  double sigma_depth = std::numeric_limits<double>::quiet_NaN();

  std::string sources() const;  ///< "detector+box+surface" or fewer; empty: none
};

/// The side file of a label file: its name with ".tilt.csv" in place of the extension. A header,
/// then "row,frame,track,pitch,roll,status,patch,depth_factor,sigma_depth,reason,sources" for each
/// row, from 0.
std::filesystem::path tilt_file(const std::filesystem::path& labels);
void write_tilts(const std::vector<LiftedBox>& boxes, const std::filesystem::path& path);
/// Tilts by row. @throws InputError "file: line: found, expected".
std::vector<BoxTilt> read_tilts(const std::filesystem::path& path, std::size_t rows);

/// A scene whose truth are the vehicles (car, van, truck, bus) of a label file, with no images: for
/// evaluation alone. Occlusion and truncation as import_kitti has them; rows of the object form are
/// frame `frame`.
Scene truth_from_kitti(const KittiLabelFile& labels, const KittiCalibration::Camera& camera,
                       int width, int height, int frame, const std::string& name);

/// A label file as a result: upright boxes, or tilted ones where tilts are given (one a row). Every
/// frame with a row is in it, also one whose rows are no vehicles.
VehicleDocument vehicles_from_kitti(const KittiLabelFile& labels,
                                    const KittiCalibration::Camera& camera, int frame,
                                    const std::vector<BoxTilt>& tilts, const std::string& method);

/// Adds the truth's frames in which a label file has no row, from its first frame to its last (all
/// of them, if it has no row at all): a detector that found nothing there writes none.
void add_empty_frames(const KittiLabelFile& labels, int frame, const SceneTruth& truth,
                      VehicleDocument* document);

/// Vehicles as rows of a label file in the tracking form, and their tilts for the side file:
/// rows in the order of the document, those without an answer left out.
/// @param scene   gives the detections' scores, by frame and id, and the tracks of vehicles that
///                have none in the document.
/// @param offset  x_in_camera = x_in_camera0 + offset, m; zero: locations in the scene's camera.
std::vector<LiftedBox> kitti_from_vehicles(const VehicleDocument& document, const Scene& scene,
                                           const Eigen::Vector3d& offset);

}  // namespace camber
