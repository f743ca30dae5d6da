#pragma once

#include <Eigen/Core>
#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/import/import_own.h"
#include "camber/scene/scene.h"

namespace camber {

/// A KITTI calibration, as far as one camera's images need it.
struct KittiCalibration {
  using Projection = Eigen::Matrix<double, 3, 4>;
  std::array<std::optional<Projection>, 4> projections;  ///< P0 to P3, rectified
  std::optional<Eigen::Matrix3d> rectification;          ///< R0_rect
  std::optional<Projection> camera0_from_laser;          ///< Tr_velo_to_cam, before rectification
  std::optional<Projection> rectified_from_laser;        ///< Tr of the odometry files, after it
  std::optional<Projection> laser_from_imu;              ///< Tr_imu_to_velo
  std::string file;                                      ///< for messages

  /// Intrinsics and the offset of a camera: x_in_camera = x_in_rectified_camera0 + offset (m).
  struct Camera {
    double fx = 0, fy = 0, cx = 0, cy = 0;
    Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  };
  /// @throws InputError if the file has no such projection or it is none of a rectified camera.
  Camera camera(int index) const;

  /// The rigid part that takes laser points to a camera. @throws InputError if a key is missing.
  Eigen::Matrix4d camera_from_laser(int index) const;

  /// Where the inertial unit, which the positions of oxts are of, is in a camera, m; nothing where
  /// the files do not state it.
  std::optional<Eigen::Vector3d> antenna(int index) const;
};

/// Reads calibrations of the tracking and object benchmarks ("P2: ...", "R0_rect: ...",
/// "Tr_velo_to_cam: ..."; colons may lack), of the odometry benchmark (also "Tr: ..."), of the raw
/// recordings ("P_rect_02: ...", "R_rect_00: ...", and "R:", "T:" of the laser's file), and bare
/// rows of 12 numbers, which are P0, P1, ... Other keys are passed over.
/// @param files one or more files whose keys are put together; not empty.
/// @throws InputError "file: line L, column C: found, expected".
KittiCalibration read_kitti_calibration(const std::vector<std::filesystem::path>& files);

/// Poses as in the odometry benchmark: 12 numbers a row, 3 x 4 row-major, world_from_camera0.
/// @throws InputError "file: line L, column C: found, expected".
std::vector<SE3> read_kitti_poses(const std::filesystem::path& path);

struct KittiImportOptions {
  std::filesystem::path images;  ///< folder of images named by frame number, all of one camera
  /// Calibration files; empty: calib.txt beside the folder of images.
  std::vector<std::filesystem::path> calibration;
  /// Truth: a tracking file (17 columns), or a folder of object files (15 columns, one an image).
  std::filesystem::path labels;
  std::filesystem::path poses;          ///< truth: one row a frame, or one an image, of camera 0
  std::filesystem::path velodyne;       ///< truth: folder of scans named by frame number
  std::filesystem::path detections;     ///< as labels, any detector's; detections_source "network"
  bool detections_from_labels = false;  ///< boxes of the labels as detections, "truth_boxes"
  /// Keypoints of one's own for the detections (kitti_keypoints.h).
  std::filesystem::path keypoints;
  std::optional<int> sequence;  ///< of the keypoints; none: by a folder of images like 0009
  /// Times, one a row (formats/frame_files.h); empty: times.txt beside the folder of the images, or
  /// timestamps.txt, if it has a row for each of them; else by the frame rate.
  std::filesystem::path times;
  std::optional<int> poses_camera;     ///< whose poses they are, 0 to 3; none: KITTI's, camera 0
  std::string frames;                  ///< list as in select_frames; empty: all
  std::optional<int> camera;           ///< 0 to 3; none: by a folder name like image_02
  std::optional<int> reference_frame;  ///< frame id; none: the manifest names none
  double camera_height = 1.65;         ///< m above the road, > 0
  std::optional<double> height_sigma;  ///< m, > 0; none: the manifest's default
  double frame_rate = 10.0;            ///< Hz, > 0
  /// Types that count as vehicles, in any case.
  std::vector<std::string> classes = {"car", "van", "truck", "bus"};
  GnssOptions gnss;          ///< no truth: positions, and headings of oxts
  std::filesystem::path up;  ///< no truth: roll and pitch, oxts or read_attitudes()
  double up_sigma = 0.0175;  ///< rad, > 0
  std::string name;          ///< empty: the name of the folder above the images'

  void validate() const;  ///< throws std::invalid_argument
};

/// A KITTI clip as a scene, all but the laser scan (options.velodyne).
///
/// Everything is moved from the rectified reference camera to the camera of the images: x_in_camera
/// = x_in_camera0 + K^-1 * (fourth column of its projection). KITTI's occlusion codes 0, 1, 2, 3
/// become the shares 0, 0.3, 0.8, 1 (so that "largely" and "unknown" do not count in tables).
/// Truncation is kept, at most 1, but where the tracking form only states that a vehicle is
/// truncated (1; 2 is "ignore") the share of its projected box outside the image is taken. Rows of
/// other types and DontCare rows are left out. Poses are truth: no frame gets a known pose.
/// @param warn receives remarks, one sentence each; may be empty.
/// @throws InputError, UsageError.
Scene import_kitti(const KittiImportOptions& options, const LogSink& warn = {});

/// import_kitti, then the manifest and, where options.velodyne is given, the laser scan of one
/// frame (the named reference frame, else the middle one, which then becomes the reference frame)
/// in the frame of that camera, beside the manifest as truth/scan_ID.ply. Non-finite points are
/// left out.
/// @param manifest path of the scene.json to write; its folder must exist.
/// @return the scene as written.
/// @throws OutputError besides; then nothing new is left behind.
Scene import_kitti_to(const KittiImportOptions& options, const std::filesystem::path& manifest,
                      const LogSink& warn = {});

}  // namespace camber
