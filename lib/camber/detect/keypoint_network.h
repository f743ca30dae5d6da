#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "camber/detect/keypoint_crop.h"
#include "camber/detect/network.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

/// What the network states of one keypoint.
struct PredictedKeypoint {
  Eigen::Vector2d at = Eigen::Vector2d::Zero();  ///< px of a crop of 64 x 64, whatever is taken
  double sigma = 0.0;                            ///< likewise, each axis, > 0
  double visible = 0.0;                          ///< probability, in [0, 1]
};
using PredictedKeypoints = std::array<PredictedKeypoint, kNumKeypoints>;

/// Of one crop's maps, (216, 16, 16) numbers: the mean of each heatmap in a window about its peak.
/// A heatmap that is not finite gives NaN.
PredictedKeypoints decode_keypoints(const float* maps, const KeypointsDescription& description);

/// Turns a crop's maps, (216, 16, 16), into their means with those of its mirror image: columns
/// reversed, left and right keypoints (i and i + 18) exchanged.
void average_with_mirrored(const float* mirrored, float* maps);

/// The keypoints in the image that a crop was cut from: pixels, sigmas in px and, as confidences,
/// the probabilities of being visible.
/// @param crop  of 64 x 64 px.
std::vector<KeypointObservation> to_observations(const PredictedKeypoints& keypoints,
                                                 const KeypointCrop& crop);

/// A network that finds the 36 keypoints of a vehicle in a crop.
class KeypointNetwork {
 public:
  /// Loads the network and checks that its output has the form that KeypointsDescription states.
  /// @throws InputError; std::invalid_argument for a description that is not valid.
  KeypointNetwork(OnnxFile file, const KeypointsDescription& description);

  /// Crops of crop_size() pixels a side and 3 channels, in batches side by side. The same for any
  /// number of threads (<= 0: see resolve_num_threads), and for each crop whatever the others are.
  /// @throws std::invalid_argument for a crop of another form.
  std::vector<PredictedKeypoints> predict(const std::vector<Image>& crops,
                                          int num_threads = 0) const;

  int crop_size() const { return description_.input.width; }  ///< px, 64 or 128
  const KeypointsDescription& description() const { return description_; }
  const Network& network() const { return *network_; }

 private:
  std::string file_;
  KeypointsDescription description_;
  std::unique_ptr<Network> network_;
};

}  // namespace camber
