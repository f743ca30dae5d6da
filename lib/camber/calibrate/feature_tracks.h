#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

#include "camber/image/image.h"

namespace camber {

/// One point of the scene over successive key frames.
struct FeatureTrack {
  std::size_t first = 0;                ///< key frame in which it was found
  std::vector<Eigen::Vector2d> pixels;  ///< in that one and those after it
};

struct FeatureTrackOptions {
  int tiles_across = 10;     ///< tiles of the image in which features are found apart, >= 1
  int tiles_down = 5;        ///< >= 1
  int features_a_tile = 16;  ///< >= 1
  int largest_width = 1300;  ///< px; wider images are shrunk for tracking, >= 64
  /// Upper quartile of the features' motion after which a frame is a key frame, share of the width,
  /// > 0.
  double key_motion = 0.02;
  double round_trip_px = 0.5;  ///< forward and backward, of the tracked image, > 0
  void validate() const;       ///< throws std::invalid_argument
};

/// Feature tracks over the key frames of a drive: corners (Shi and Tomasi, "Good features to
/// track", CVPR 1994) followed by pyramidal Lucas-Kanade (Bouguet, 2000) there and back. Key frames
/// are chosen by the features' motion; frames between them carry the features on, and each track is
/// measured again from one key frame to the next. One image at a time is kept, in order.
class FeatureTracker {
 public:
  explicit FeatureTracker(const FeatureTrackOptions& options);
  ~FeatureTracker();

  /// @return whether the frame became a key frame.
  /// @throws std::invalid_argument for an image that is empty or of another size than the first.
  bool add(const GrayImage& image);

  /// What was tracked: px of the images as they were given, tracks of at least two key frames, in
  /// the order in which they began.
  std::vector<FeatureTrack> take();
  std::size_t key_frames() const;
  /// Largest motion (upper quartile) of a frame since its last key frame, px: of a camera that
  /// stands about 0.
  double largest_motion() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace camber
