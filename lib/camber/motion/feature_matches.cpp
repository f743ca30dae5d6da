#include "camber/motion/feature_matches.h"

#include <cstdint>
#include <limits>
#include <opencv2/features2d.hpp>
#include <stdexcept>
#include <string>

#include "camber/core/threads.h"
#include "camber/image/detail/single_threaded_opencv.h"
#include "camber/motion/detail/structure_tensor.h"

namespace camber {
namespace {

struct Features {
  std::vector<cv::KeyPoint> keypoints;
  cv::Mat descriptors;
};

Features detect(const GrayImage& image, int most) {
  const cv::Mat view(image.height, image.width, CV_8UC1,
                     const_cast<std::uint8_t*>(image.pixels.data()));
  Features out;
  cv::SIFT::create(most)->detectAndCompute(view, cv::noArray(), out.keypoints, out.descriptors);
  return out;
}

/// Index of each feature's partner in the other image, -1: none.
std::vector<int> mutual_matches(const Features& from, const Features& to, double ratio) {
  std::vector<int> out(from.keypoints.size(), -1);
  if (from.keypoints.size() < 2 || to.keypoints.size() < 2) return out;
  const cv::BFMatcher matcher(cv::NORM_L2);
  std::vector<std::vector<cv::DMatch>> forward, backward;
  matcher.knnMatch(from.descriptors, to.descriptors, forward, 2);
  matcher.knnMatch(to.descriptors, from.descriptors, backward, 1);
  for (const std::vector<cv::DMatch>& pair : forward) {
    if (pair.size() < 2 || !(pair[0].distance < ratio * pair[1].distance)) continue;
    const auto& back = backward[static_cast<std::size_t>(pair[0].trainIdx)];
    if (!back.empty() && back[0].trainIdx == pair[0].queryIdx) {
      out[static_cast<std::size_t>(pair[0].queryIdx)] = pair[0].trainIdx;
    }
  }
  return out;
}

}  // namespace

void FeatureMatchOptions::validate() const {
  if (max_features < 8) {
    throw std::invalid_argument("max_features = " + std::to_string(max_features) +
                                ", expected at least 8");
  }
  if (!(ratio > 0.0 && ratio < 1.0)) {
    throw std::invalid_argument("ratio = " + std::to_string(ratio) + ", expected between 0 and 1");
  }
}

Correspondences match_features(const std::vector<GrayImage>& images, int reference,
                               const FeatureMatchOptions& options) {
  options.validate();
  check_images(images, reference);
  const SingleThreadedOpenCv guard;
  const auto at = static_cast<std::size_t>(reference);
  std::vector<Features> features(images.size());
  parallel_for(images.size(), options.num_threads,
               [&](std::size_t k) { features[k] = detect(images[k], options.max_features); });
  std::vector<std::vector<int>> partners(images.size());
  parallel_for(images.size(), options.num_threads, [&](std::size_t k) {
    if (k != at) partners[k] = mutual_matches(features[at], features[k], options.ratio);
  });

  Correspondences out;
  out.reference = reference;
  out.rows = 1;
  for (std::size_t k = 0; k < images.size(); ++k) {
    if (k != at) out.matches.push_back({static_cast<int>(k), {}, {}});
  }
  for (std::size_t i = 0; i < features[at].keypoints.size(); ++i) {
    bool seen = false;
    for (std::size_t k = 0; k < images.size(); ++k) seen = seen || (k != at && partners[k][i] >= 0);
    if (!seen) continue;
    const cv::Point2f& p = features[at].keypoints[i].pt;
    out.pixels.emplace_back(p.x, p.y);
    for (MatchedImage& match : out.matches) {
      const auto k = static_cast<std::size_t>(match.frame);
      const int partner = partners[k][i];
      const cv::Point2f q =
          partner < 0 ? p : features[k].keypoints[static_cast<std::size_t>(partner)].pt;
      match.pixels.emplace_back(q.x, q.y);
      match.round_trip_px.push_back(partner < 0 ? std::numeric_limits<float>::infinity() : 0.0F);
    }
  }
  out.columns = static_cast<int>(out.pixels.size());
  const StructureTensor texture(images[at]);
  for (const Eigen::Vector2f& p : out.pixels) out.texture.push_back(texture.at(p));
  return out;
}

}  // namespace camber
