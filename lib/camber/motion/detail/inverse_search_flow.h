#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "camber/image/image.h"

namespace camber::detail {

/// An image at the resolutions that a flow is sought at, the finest first.
class FlowPyramid {
 public:
  /// Intensities and their derivatives (Sobel, intensity / px), rows without gaps but for a border
  /// of kBorder pixels that repeats the rim.
  struct Level {
    int width = 0, height = 0;
    cv::Mat intensity, by_x, by_y;  // float
    const float* pixels(const cv::Mat& of) const { return of.ptr<float>() + at(0, 0); }
    std::ptrdiff_t pitch() const { return width + 2 * kBorder; }
    std::ptrdiff_t at(int x, int y) const { return (y + kBorder) * pitch() + x + kBorder; }
  };
  static constexpr int kBorder = 16;

  /// @param image         CV_8UC1 or CV_32FC1; smaller than a patch (8 px) it has no levels.
  /// @param finest_scale  the finest level has 1 / 2^finest_scale of the size, >= 0; larger where
  ///                      that would be smaller than a patch.
  /// @param gradients     false: it is no flow's first image and has no derivatives.
  FlowPyramid(const cv::Mat& image, int finest_scale, bool gradients = true);

  int finest_scale() const { return finest_scale_; }
  cv::Size size() const { return size_; }  ///< of the image
  const std::vector<Level>& levels() const { return levels_; }

 private:
  cv::Size size_;
  int finest_scale_;
  std::vector<Level> levels_;
};

/// A flow at the finest resolution it was sought at.
class DenseFlow {
 public:
  DenseFlow() = default;
  /// @param field  CV_32FC2, px of its own resolution.
  DenseFlow(cv::Mat field, int scale) : field_(std::move(field)), scale_(scale) {}
  bool empty() const { return field_.empty(); }
  const cv::Mat& field() const { return field_; }

  /// px, at a pixel of the image; that of the rim outside.
  cv::Point2f at(float x, float y) const;

  /// One flow after another: x -> this(x) + second(x + this(x)).
  DenseFlow followed_by(const DenseFlow& second) const;

 private:
  cv::Mat field_;
  int scale_ = 0;
};

struct InverseSearchOptions {
  int patch_stride = 3;  ///< px, between patches of 8 x 8, 1 to 8
  int most_steps = 8;    ///< Gauss-Newton, of each patch in each of two passes, >= 1
};

/// Dense inverse search (Kroeger, Timofte, Dai, van Gool, "Fast Optical Flow using Dense Inverse
/// Search", ECCV 2016), from coarse to fine: every patch starts from the coarser level or from what
/// its neighbours found, is aligned by Gauss-Newton steps with its mean taken out, and the patches
/// over a pixel are averaged by how well they fit there.
/// @param start   a first guess, or empty.
/// @param wanted  one byte a pixel of the image: where the flow is of interest; null: everywhere.
///                Elsewhere it is what coarser levels give.
DenseFlow inverse_search_flow(const FlowPyramid& from, const FlowPyramid& to,
                              const InverseSearchOptions& options, const DenseFlow& start = {},
                              const std::uint8_t* wanted = nullptr);

}  // namespace camber::detail
