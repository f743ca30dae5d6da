#pragma once

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/render/canvas.h"
#include "camber/render/color_map.h"
#include "camber/render/pictures.h"

namespace camber {

/// Colours that all pictures share.
inline constexpr Color kInk{38, 42, 48, 1.0};
inline constexpr Color kFaintInk{110, 116, 124, 1.0};
inline constexpr Color kTruthRed{214, 24, 30, 1.0};
inline constexpr Color kTruthGrey{150, 140, 132, 1.0};
inline constexpr Color kPaper{255, 255, 255, 1.0};

/// A vehicle as pictures draw it, picture frame.
struct PlacedVehicle {
  int id = 0;        ///< in its frame
  int number = 0;    ///< over all frames: VehicleNumbers
  std::string name;  ///< "car 3", by the number
  Status status = Status::kOk;
  OrientedBox box;
  bool wireframe = false;
  std::array<Eigen::Vector3d, kNumKeypoints> keypoints{};
  Eigen::Matrix3d center_covariance = Eigen::Matrix3d::Zero();  ///< m^2; zero: not stated
  double range = 0.0;        ///< m from its camera to the bottom centre
  double range_sigma = 0.0;  ///< m; 0: not stated
  /// The ground under it, from half a metre outside its footprint; empty: not known.
  std::vector<Eigen::Vector3d> ground;
};

struct PlacedPatch {
  int id = 0;
  PatchKind kind = PatchKind::kRoad;
  Status status = Status::kOk;
  std::vector<Eigen::Vector3d> boundary;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
};

/// A link of the consistency graph between the middles of two patches.
struct PlacedLink {
  Eigen::Vector3d a = Eigen::Vector3d::Zero(), b = Eigen::Vector3d::Zero();
  bool valid = true;
  double height_step = 0.0;  ///< m, b above a
};

/// A range of values without the stray ones at both ends.
struct RobustRange {
  double low = 0.0, high = 0.0;
  double span() const { return high - low; }
};

/// The values between two quantiles. @param values not empty, finite; is reordered.
RobustRange robust_range(std::vector<float>& values, double low_quantile, double high_quantile);

/// The content in the picture's frame: x right, y ahead, z up, m (or units of the result), z = 0 on
/// the road below the reference camera where that is known. Of a map it starts at the cloud's
/// origin.
struct PictureSpace {
  SE3 picture_from_reference;
  bool map = false;  ///< x, y of a map rather than right and ahead of a camera
  /// What numbers on axes count from: of a map its own zero, whole coordinates being written.
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  std::string right_name, ahead_name;         ///< axis titles without unit
  std::string height_name;                    ///< what z is counted from, for the colour bar
  std::string unit;                           ///< "m", or "units" for a result without scale
  std::vector<Eigen::Vector3f> points;        ///< finite and not far outside of the bulk
  std::size_t stray_points = 0;               ///< finite but left out
  std::vector<std::uint32_t> kept;            ///< index in the cloud of each point
  std::vector<Eigen::Vector3f> truth_points;  ///< dense ground truth near the content
  RobustRange right, ahead, up;               ///< bulk of the points, vehicles and cameras
  RobustRange heights;                        ///< of the bulk of the points; at least 0.1 wide
  std::vector<std::array<std::uint8_t, 3>> colors;  ///< of the points
  bool has_color_bar = false;
  RobustRange color_range;                             ///< of the colour bar
  ColorScale color_scale = viridis;                    ///< of the points and the colour bar
  std::vector<std::string> color_title;                ///< of the colour bar, in short lines
  std::vector<std::pair<Color, std::string>> classes;  ///< that colours stand for, for the legend
  std::vector<PlacedVehicle> vehicles;
  std::vector<PlacedVehicle> truth;
  std::vector<PlacedPatch> patches;
  std::vector<PlacedLink> links;
  RobustRange link_steps;       ///< 0 to the largest height step of a valid link, >= 0.01 m
  std::vector<SE3> cameras;     ///< picture_from_camera
  std::vector<int> camera_ids;  ///< frame ids, one a camera
  int current_camera = -1;      ///< index of the shown frame's camera, -1: not known
};

/// @throws NoAnswerError if there is nothing finite to show or the cloud lacks what colours mean.
PictureSpace make_picture_space(const PictureContent& content, bool show_truth,
                                const PointColor& color);

/// Corners of a camera's image at a depth, camera frame, m: clockwise from the top left.
std::array<Eigen::Vector3d, 4> frustum_corners(const PinholeCamera& camera, double depth);

/// "frame 48: 12,345 road points, 5 patches, 4 vehicles".
std::string content_summary(const PictureContent& content, const PictureSpace& space);

/// The same hue, darker, for lines on white. @param share  of the brightness, [0, 1].
Color darker(const Color& color, double share);

/// By its number; grey where its position is not observable.
Color vehicle_color(Status status, int number);
Color vehicle_color(const PlacedVehicle& vehicle);

/// "27.7 m", with its standard deviation "27.7 ± 0.3 m" where that is wanted and stated.
std::string range_text(const PlacedVehicle& vehicle, const std::string& unit, bool with_sigma);

Color patch_color(PatchKind kind);

/// Throws std::invalid_argument "picture option NAME: found, expected" outside [low, high].
void check_picture_option(const char* name, double value, double low, double high);

}  // namespace camber
