#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/road/road_posterior.h"

namespace camber::stages::detail {

/// Standard deviation of the road along the viewing rays over the distance, scale included, from a
/// coarse grid of pixels.
class RelativeSigma {
 public:
  RelativeSigma(const RoadPosterior& road, const PinholeCamera& camera)
      : top_(road.top()),
        du_((camera.width - 1.0) / (kColumns - 1)),
        dv_((camera.height - 1.0 - top_) / (kRows - 1)) {
    std::vector<Eigen::Vector2d> pixels;
    for (int r = 0; r < kRows; ++r) {
      for (int c = 0; c < kColumns; ++c) pixels.emplace_back(c * du_, top_ + r * dv_);
    }
    const auto n = static_cast<Eigen::Index>(pixels.size());
    const Eigen::VectorXd variance =
        road.variances(road.of_inverse_depths(pixels, Eigen::MatrixXd::Identity(n, n)));
    for (std::size_t i = 0; i < pixels.size(); ++i) {
      const double rho = std::max(road.inverse_depth(pixels[i]), 1e-3);
      values_.push_back(std::min(1.0, std::sqrt(variance[static_cast<Eigen::Index>(i)]) / rho));
    }
  }

  double at(const Eigen::Vector2d& pixel) const {
    const double x = std::clamp(pixel.x() / du_, 0.0, kColumns - 1.001);
    const double y = std::clamp((pixel.y() - top_) / dv_, 0.0, kRows - 1.001);
    const int c = static_cast<int>(x), r = static_cast<int>(y);
    const double ax = x - c, ay = y - r;
    const auto value = [&](int row, int column) {
      return values_[static_cast<std::size_t>(row * kColumns + column)];
    };
    return (1 - ay) * ((1 - ax) * value(r, c) + ax * value(r, c + 1)) +
           ay * ((1 - ax) * value(r + 1, c) + ax * value(r + 1, c + 1));
  }

 private:
  static constexpr int kColumns = 12, kRows = 12;
  double top_, du_, dv_;
  std::vector<double> values_;
};

}  // namespace camber::stages::detail
