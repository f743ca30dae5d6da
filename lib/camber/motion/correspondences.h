#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "camber/image/image.h"
#include "camber/motion/flow_cache.h"

namespace camber {

struct CorrespondenceOptions {
  int step = 2;                      ///< pixels between grid points, >= 1
  double forward_backward_px = 1.0;  ///< largest round-trip error of an accepted match, > 0
  /// refine_matches: true keeps the match before where matching again fails, false drops it.
  bool keep_lost = false;
  int finest_scale = 1;  ///< the flow's finest image has 1 / 2^finest_scale of the size, 0 to 2
  /// Variational refinement of the flow. Without, each patch is by itself: less survives the
  /// round trip, but where the images were carried onto each other nothing of the prediction's
  /// error is kept (a smooth flow keeps up to a third).
  bool smooth = true;
  int num_threads = 0;    ///< <= 0: see resolve_num_threads
  void validate() const;  ///< throws std::invalid_argument
};

/// Where the grid points of the reference image are seen in one other image.
struct MatchedImage {
  int frame = 0;                        ///< index into the images
  std::vector<Eigen::Vector2f> pixels;  ///< one a grid point; undefined where not valid
  std::vector<float> round_trip_px;     ///< forward-backward error; infinity: not valid

  std::size_t count() const;  ///< of the valid ones
};

/// Dense correspondences from a reference image to all others on a regular grid.
struct Correspondences {
  int reference = 0;                    ///< index into the images
  int step = 1;                         ///< pixels
  int columns = 0, rows = 0;            ///< of the grid; point i is at column i % columns
  std::vector<Eigen::Vector2f> pixels;  ///< grid points in the reference image
  /// Structure tensor of the reference image at each grid point: mean of gx^2, gx gy, gy^2 over a
  /// window of 9 x 9 pixels, (intensity / pixel)^2. The noise of a match along a direction e
  /// falls with e' S e.
  std::vector<Eigen::Vector3f> texture;
  std::vector<MatchedImage> matches;  ///< one for every image but the reference, in order

  /// Row-major index of a grid point's pixel in an image of that width.
  std::size_t image_index(std::size_t point, int width) const {
    return static_cast<std::size_t>(pixels[point].y()) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(pixels[point].x());
  }
};

/// @throws std::invalid_argument for images that differ in size or are empty, or if the reference
/// is no index into them.
void check_images(const std::vector<GrayImage>& images, int reference);

/// The grid of a reference image with its texture, for correspondences of one's own: `matches` is
/// empty and takes one MatchedImage, of as many pixels as the grid, for every other image in order.
/// @param reference  index of the image, as in Correspondences.
/// @throws std::invalid_argument for an empty image or a step below 1.
Correspondences correspondence_grid(const GrayImage& image, int reference, int step);

/// Flows that several windows share. @see FlowCache
struct KeptFlows {
  FlowCache* cache = nullptr;  ///< null: nothing is kept
  std::vector<int> ids;        ///< one an image
};

/// Matches the reference image to every other image by dense inverse-search optical flow (Kroeger,
/// Timofte, Dai, van Gool, "Fast Optical Flow using Dense Inverse Search", ECCV 2016) with a
/// forward-backward check. Images in the order of time: where one shares less than half as much
/// with the reference as its neighbour towards it, the flow starts again through that neighbour.
/// All images have the same size (else std::invalid_argument). The same result for any number of
/// threads.
///
/// @param kept  flows of earlier windows, used and added to; its ids are those of the images.
Correspondences match_images(const std::vector<GrayImage>& images, int reference,
                             const CorrespondenceOptions& options, const KeptFlows& kept = {});

/// Where every pixel of the reference image is expected in one other image.
struct PredictedImage {
  int frame = 0;                        ///< index into the images
  std::vector<Eigen::Vector2f> pixels;  ///< row-major, one a pixel; NaN: keep the match before
  /// One byte a pixel of the reference: non-zero where the match is of no interest (something
  /// stands there in this or the other image) and must not bias its neighbours.
  std::vector<std::uint8_t> ignored;
  /// One byte a pixel of the reference, or empty: non-zero where a flow is unreliable (what
  /// moves beside it biases it) and windows are compared one by one instead.
  std::vector<std::uint8_t> searched;
};

/// Matches again with known geometry: each image is first carried onto the reference by the
/// prediction, so that only small differences remain for the flow, which then neither smooths the
/// perspective growth of image motion nor loses track of fast near pixels. Ignored pixels are made
/// equal in both images.
/// @param top  first row of interest, px; points above it keep their match.
/// @return correspondences on the same grid as `before`; round_trip_px holds the magnitude of the
///         flow's local variation.
Correspondences refine_matches(const std::vector<GrayImage>& images, const Correspondences& before,
                               const std::vector<PredictedImage>& predictions, int top,
                               const CorrespondenceOptions& options);

}  // namespace camber
