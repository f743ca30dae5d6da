#include "camber/pipeline/near_parallax.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "camber/motion/correspondences.h"

namespace camber {

GrayImage shrunk(const GrayImage& image) {
  constexpr int kShrink = 3;
  const cv::Mat full(image.height, image.width, CV_8UC1,
                     const_cast<std::uint8_t*>(image.pixels.data()));  // only read
  GrayImage out;
  out.width = std::max(16, full.cols / kShrink);
  out.height = std::max(16, full.rows / kShrink);
  out.pixels.resize(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height));
  cv::Mat small(out.height, out.width, CV_8UC1, out.pixels.data());
  cv::resize(full, small, small.size(), 0, 0, cv::INTER_AREA);
  return out;
}

ImageParallax image_parallax(const PinholeCamera& camera, const GrayImage& a, const GrayImage& b,
                             double least_matched, int num_threads) {
  CorrespondenceOptions options;
  options.num_threads = num_threads;
  options.step = 4;
  const Correspondences matches = match_images({a, b}, 0, options);
  const double fx = camera.fx * a.width / camera.width;
  const double fy = camera.fy * a.height / camera.height;
  const double cx = camera.cx * a.width / camera.width;
  const double cy = camera.cy * a.height / camera.height;
  const MatchedImage& match = matches.matches[0];
  // Flow of a small rotation w at normalised (x, y): rows of (xy, -(1 + x^2), y), (1 + y^2, -xy,
  // -x).
  const auto rotation_rows = [&](const Eigen::Vector2f& p) {
    const double x = (p.x() - cx) / fx, y = (p.y() - cy) / fy;
    Eigen::Matrix<double, 2, 3> rows;
    rows << fx * x * y, -fx * (1 + x * x), fx * y, fy * (1 + y * y), -fy * x * y, -fy * x;
    return rows;
  };
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  for (int iteration = 0; iteration < 6; ++iteration) {
    Eigen::Matrix3d normal = 1e-3 * Eigen::Matrix3d::Identity();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < matches.pixels.size(); ++i) {
      if (matches.pixels[i].y() > cy || !std::isfinite(match.round_trip_px[i])) continue;
      const Eigen::Matrix<double, 2, 3> rows = rotation_rows(matches.pixels[i]);
      const Eigen::Vector2d flow = (match.pixels[i] - matches.pixels[i]).cast<double>();
      const Eigen::Vector2d r = flow - rows * turn;
      const double w = 1.0 / (1.0 + r.squaredNorm());
      normal += w * rows.transpose() * rows;
      right += w * rows.transpose() * flow;
    }
    turn = normal.ldlt().solve(right);
  }
  std::vector<double> sizes, below;
  std::size_t near = 0;
  for (std::size_t i = 0; i < matches.pixels.size(); ++i) {
    const bool is_near = matches.pixels[i].y() >= 2.0f * static_cast<float>(a.height) / 3.0f;
    near += is_near ? 1 : 0;
    if (matches.pixels[i].y() < cy || !std::isfinite(match.round_trip_px[i])) continue;
    const Eigen::Vector2d flow = (match.pixels[i] - matches.pixels[i]).cast<double>();
    below.push_back((flow - rotation_rows(matches.pixels[i]) * turn).norm());
    if (is_near) sizes.push_back(below.back());
  }
  const auto quantile = [&](std::vector<double>& of, double share) {
    const auto at =
        of.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(of.size()));
    std::nth_element(of.begin(), at, of.end());
    return *at * camera.width / a.width;
  };
  ImageParallax out;
  out.turn = turn;
  if (!below.empty()) out.most = quantile(below, 0.9);
  if (!sizes.empty() &&
      static_cast<double>(sizes.size()) >= least_matched * static_cast<double>(near)) {
    out.near = quantile(sizes, 0.5);
  }
  return out;
}

std::optional<double> near_parallax(const PinholeCamera& camera, const GrayImage& a,
                                    const GrayImage& b, double least_matched) {
  return image_parallax(camera, a, b, least_matched).near;
}

}  // namespace camber
