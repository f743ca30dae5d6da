#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "camber/geometry/camera_sigma.h"
#include "camber/geometry/lens_distortion.h"
#include "camber/geometry/pinhole_camera.h"

namespace camber {

/// One camera of a calibration file, as it stands there.
struct CameraCalibration {
  std::string name;                  ///< empty: the file names none
  std::string model;                 ///< the file's own word, "opencv" where it has none
  std::optional<int> width, height;  ///< pixels
  double fx = 0.0, fy = 0.0, cx = 0.0, cy = 0.0;  ///< pixels
  double first_pixel = 0.0;          ///< coordinate of the top-left pixel's centre: 0 or 0.5
  std::vector<double> coefficients;  ///< of the distortion, in the file's order
  std::vector<double> projection;    ///< 3 x 4, row-major, of the rectified image, or empty
  std::optional<Eigen::Matrix4d> camera_from_imu;
  /// Where a camera table gives the mounting on the vehicle: w x y z, and m.
  std::optional<Eigen::Vector4d> rotation_wxyz;
  std::optional<Eigen::Vector3d> translation;

  /// The distortion in OpenCV's order, where Camber has the model.
  LensModel lens = LensModel::kNone;
  std::vector<double> lens_coefficients;
  std::string note;  ///< what a person should know of how it was read; or ""
  /// What the file states of it (focal_sigma, principal_sigma, distortion_sigma); 0: nothing.
  CameraSigma sigma;
  std::string unsupported;  ///< why no pinhole camera with that distortion can stand for it; or ""
};

/// A calibration file.
struct CalibrationFile {
  std::string form;  ///< "OpenCV", "ROS camera_info", "Kalibr", ...
  std::vector<CameraCalibration> cameras;
  std::map<std::string, std::vector<double>> matrices;  ///< others of KITTI, row-major
};

/// Reads a calibration; the content decides the form: OpenCV FileStorage (YAML, XML, JSON), ROS
/// camera_info (YAML, INI), Kalibr, EuRoC, camodocal (VINS), ORB-SLAM 2 and 3, Basalt, COLMAP
/// cameras (.txt, .bin), kapture, KITTI (object, tracking, odometry, raw), nuScenes calibrated
/// sensors, OpenSfM, Cityscapes, Metashape, nerfstudio, ZED, OKVIS, rpg_vikit, Argoverse, a JSON or
/// YAML object with fx fy cx cy or K, by name or not, a 3 x 3 matrix alone, also in brackets.
/// @throws InputError "file: position: found, expected".
CalibrationFile read_calibration(const std::filesystem::path& path);

/// The camera by its name, or by its index in the file; with an empty choice the only one, or the
/// only one of the images' size (of a ZED's file, which has both cameras in four sizes, the left).
/// @param width, height  of the images; 0: not known
/// @throws InputError that names the cameras where there is no such one, or several and no choice.
const CameraCalibration& choose_camera(const CalibrationFile& file, const std::string& choice,
                                       const std::filesystem::path& path, int width = 0,
                                       int height = 0);

/// The camera in Camber's convention (pixel centres at integers) and the lens. The pinhole is that
/// of the image files.
/// @param rectified  the images were rectified by the file's projection matrix.
/// @param width, height  of the images.
/// @throws InputError for a model that cannot be represented, and for a calibration of another
/// size.
LensDistortion lens_of(const CameraCalibration& camera, bool rectified, int width, int height,
                       const std::filesystem::path& path);

}  // namespace camber
