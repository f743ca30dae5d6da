#pragma once

#include <array>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "camber/detect/keypoint_network.h"

namespace camber {

/// A crop with its truth.
struct KeypointCropTruth {
  Image crop;                           ///< as the network takes it, 3 channels
  int stored_size = kKeypointCropSize;  ///< px, side of the crop in its folder
  /// px of a crop of 64 x 64 whatever the image has, may lie outside.
  std::array<Eigen::Vector2d, kNumKeypoints> points = {};
  std::array<KeypointVisibility, kNumKeypoints> visibility = {};
  double box_side = 0.0;  ///< likewise, the larger side of the detection's box
  double box_height =
      std::numeric_limits<double>::quiet_NaN();  ///< px of the image; NaN: not known
  /// rad, where the vehicle is seen from: 0 right, pi/2 behind, pi left.
  double azimuth = 0.0;
};

/// The crops of a folder of `camber keypoints synthesise`; how high their boxes would be in an
/// image is not known.
/// @param size  px, to which crops of another size are resampled.
/// @param most  crops, at most: the first ones.
/// @throws InputError.
std::vector<KeypointCropTruth> read_keypoint_crops(
    const std::filesystem::path& folder, int size = kKeypointCropSize,
    std::size_t most = std::numeric_limits<std::size_t>::max());

/// Errors of keypoints that lie inside their crops. NaN where there are none.
struct KeypointErrors {
  std::size_t count = 0;
  double pck_2px = 0.0;    ///< share at most 2 px of 64 off
  double pck_alpha = 0.0;  ///< share at most 0.1 of the box's larger side off
  double median = 0.0;     ///< px of 64
  Eigen::Vector2d offset = Eigen::Vector2d::Zero();  ///< px of 64, median predicted minus true
  /// Shares of the coordinates at most 1, 2 and 3 stated sigmas off.
  std::array<double, 3> inside_sigmas = {};
};

/// Errors of a part of the keypoints.
struct KeypointGroup {
  std::string name;
  KeypointErrors visible, hidden, all;
};

struct KeypointEvaluation {
  std::size_t crops = 0;
  KeypointGroup overall;
  std::vector<KeypointGroup> by_keypoint;  ///< 36
  std::vector<KeypointGroup> by_height;    ///< of the box, px of the image
  std::vector<KeypointGroup> by_heading;   ///< from where the camera sees the vehicle
  /// Average precision of each keypoint (APK: Yang and Ramanan, PAMI 2013; as Tulsiani and Malik,
  /// CVPR 2015): every crop proposes each keypoint once, ranked by its probability of being
  /// visible; a proposal is right if the keypoint is visible and at most 0.1 of the box's larger
  /// side off; all visible keypoints are to be found. Area under the precision's upper envelope
  /// over recall. NaN where no crop shows the keypoint.
  std::array<double, kNumKeypoints> apk = {};
  double mean_apk = 0.0;
  double visibility_right = 0.0;  ///< share whose probability is on the right side of a half
  /// Shares visible among keypoints by their stated probability, in ten bins; NaN: none.
  std::array<double, 10> visible_by_probability = {};
};

/// @param predicted  one a crop.
KeypointEvaluation evaluate_keypoints(const std::vector<KeypointCropTruth>& crops,
                                      const std::vector<PredictedKeypoints>& predicted);

/// A table to read; ends with a line break.
std::string keypoint_table(const KeypointEvaluation& evaluation);

/// Names of the 18 left parts, "rear wheel", ...; a right one is that of row - 18.
const std::array<const char*, kNumKeypoints / 2>& keypoint_part_names();

}  // namespace camber
