#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/image/video.h"
#include "camber/motion/correspondences.h"
#include "camber/pipeline/reconstruct.h"

namespace camber {
namespace {

constexpr int kShrink = 3;
constexpr double kEnoughAngle = 0.025;  // rad, parallax of the near road
/// Share of the near road that has to be matched between neighbours for its parallax to be taken as
/// it is: what moves fast is lost, and what is left (cars ahead, far road, chance) moves little.
constexpr double kLeastMatched = 0.62;

GrayImage small_image(const Scene& scene, std::size_t index, const Undistortion& lens,
                      FrameImageReader& images, const FramePixelSource& pixels) {
  const SceneFrame& frame = scene.frames[index];
  Image held = pixels ? pixels(frame.id).image : Image();
  if (held.empty() && frame.image.empty()) {
    throw NoAnswerError("frame " + std::to_string(frame.id) +
                        " has no image in the manifest; reconstruction needs images");
  }
  FrameImage image = held.empty() ? images.read(frame.image, lens)
                                  : make_frame_image(std::move(held), lens, frame.id);
  const cv::Mat full(image.gray.height, image.gray.width, CV_8UC1, image.gray.pixels.data());
  GrayImage out;
  out.width = std::max(16, full.cols / kShrink);
  out.height = std::max(16, full.rows / kShrink);
  out.pixels.resize(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height));
  cv::Mat shrunk(out.height, out.width, CV_8UC1, out.pixels.data());
  cv::resize(full, shrunk, shrunk.size(), 0, 0, cv::INTER_AREA);
  return out;
}

/// Median image motion in the lower third, px of the full image, after the rotation that the upper
/// half shows has been taken out; nothing where less than that share of it is matched.
std::optional<double> near_parallax(const Scene& scene, const GrayImage& a, const GrayImage& b,
                                    double least_matched) {
  CorrespondenceOptions options;
  options.step = 4;
  const Correspondences matches = match_images({a, b}, 0, options);
  const double fx = scene.camera.fx * a.width / scene.camera.width;
  const double fy = scene.camera.fy * a.height / scene.camera.height;
  const double cx = scene.camera.cx * a.width / scene.camera.width;
  const double cy = scene.camera.cy * a.height / scene.camera.height;
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
  std::vector<double> sizes;
  std::size_t near = 0;
  for (std::size_t i = 0; i < matches.pixels.size(); ++i) {
    if (matches.pixels[i].y() < 2.0f * static_cast<float>(a.height) / 3.0f) continue;
    ++near;
    if (!std::isfinite(match.round_trip_px[i])) continue;
    const Eigen::Vector2d flow = (match.pixels[i] - matches.pixels[i]).cast<double>();
    sizes.push_back((flow - rotation_rows(matches.pixels[i]) * turn).norm());
  }
  if (static_cast<double>(sizes.size()) < least_matched * static_cast<double>(near) ||
      sizes.empty()) {
    return std::nullopt;
  }
  const std::size_t at = sizes.size() / 2;
  std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(at), sizes.end());
  return sizes[at] * scene.camera.width / a.width;
}

/// The reference and what can stand beside it.
struct Reference {
  std::vector<int> ids;  // of the scene
  std::size_t at = 0;

  explicit Reference(const Scene& scene) {
    const std::size_t count = scene.frames.size();
    if (count < 2) {
      throw NoAnswerError("one frame alone has no parallax: at least 2 frames are needed, " +
                          std::to_string(count) + " given");
    }
    for (const SceneFrame& frame : scene.frames) ids.push_back(frame.id);
    const int id = choose_reference_frame(scene, ids);
    at = static_cast<std::size_t>(std::find(ids.begin(), ids.end(), id) - ids.begin());
  }
  std::size_t behind() const { return at; }
  std::size_t ahead() const { return ids.size() - 1 - at; }

  /// The frame `spacing` away on each side and, for two a side, the one half as far; where there is
  /// none between, the one twice as far.
  std::vector<int> ids_with_spacing(std::size_t spacing, int each_side) const {
    std::vector<std::size_t> away = {spacing};
    if (each_side == 2) away.push_back(spacing == 1 ? 2 : (spacing + 1) / 2);
    std::vector<int> out = {ids[at]};
    for (const std::size_t n : away) {
      if (n <= behind()) out.push_back(ids[at - n]);
      if (n <= ahead()) out.push_back(ids[at + n]);
    }
    std::sort(out.begin(), out.end());
    return out;
  }

  ChosenFrames with_spacing(std::size_t spacing, int each_side) const {
    ChosenFrames out;
    out.spacing = static_cast<int>(spacing);
    out.ids = ids_with_spacing(spacing, each_side);
    for (const std::size_t fewer : {spacing, std::size_t{1}}) {
      std::vector<int> instead = ids_with_spacing(fewer, 1);
      if (instead != out.ids && (out.instead.empty() || instead != out.instead.back())) {
        out.instead.push_back(std::move(instead));
      }
    }
    return out;
  }
};

}  // namespace

ChosenFrames choose_frames(const Scene& scene, const FramePixelSource& pixels, int each_side) {
  if (each_side != 1 && each_side != 2) {
    throw std::invalid_argument("choose_frames: each_side is " + std::to_string(each_side) +
                                ", 1 or 2 expected");
  }
  const Reference reference(scene);
  const std::size_t most = std::max(reference.behind(), reference.ahead());
  if (most == 1) return reference.with_spacing(1, each_side);
  const Undistortion lens(scene.camera, scene.distortion);
  FrameImageReader images;  // goes on through a video as the frames do
  const GrayImage here = small_image(scene, reference.at, lens, images, pixels);
  const double enough = kEnoughAngle * scene.camera.fx;
  double parallax_px = 0.0;
  std::size_t spacing = 1;
  while (true) {
    const std::size_t other =
        spacing <= reference.ahead() ? reference.at + spacing : reference.at - spacing;
    const auto parallax =
        near_parallax(scene, here, small_image(scene, other, lens, images, pixels),
                      spacing == 1 ? kLeastMatched : 0.0);
    // Too fast to be matched at this size is not too slow.
    parallax_px = parallax.value_or(enough);
    if (parallax_px >= enough) break;
    // Twice as far, or what the speed so far calls for; never farther than there are frames.
    const double factor = std::clamp(enough / std::max(parallax_px, 0.1), 1.5, 4.0);
    const auto next = std::min(
        most, std::max(spacing + 1, static_cast<std::size_t>(
                                        std::lround(factor * static_cast<double>(spacing)))));
    if (next == spacing) break;
    spacing = next;
  }
  ChosenFrames out = reference.with_spacing(spacing, each_side);
  out.parallax_px = parallax_px;
  return out;
}

}  // namespace camber
