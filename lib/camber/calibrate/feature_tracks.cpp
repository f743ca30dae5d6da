#include "camber/calibrate/feature_tracks.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <stdexcept>
#include <string>

namespace camber {
namespace {

constexpr int kLevels = 4;
constexpr double kLeastCorner = 1e-4;  // smaller eigenvalue of the gradients, OpenCV's units
constexpr double kStill = 0.25;        // px, below which a frame is like the one before

const cv::Size& window() {
  static const cv::Size size(11, 11);  // wider ones mix depths: focal lengths come out short
  return size;
}

cv::TermCriteria criteria() { return {cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.003}; }

using Pyramid = std::vector<cv::Mat>;

Pyramid pyramid_of(const cv::Mat& image) {
  Pyramid out;
  cv::buildOpticalFlowPyramid(image, out, window(), kLevels);
  return out;
}

/// Follows points there and back. @param guess  where they are expected, or empty.
/// @return 0 where a point was lost.
std::vector<std::uint8_t> follow(const Pyramid& from, const Pyramid& to,
                                 const std::vector<cv::Point2f>& points, double round_trip_px,
                                 std::vector<cv::Point2f>* found) {
  const bool guessed = !found->empty();
  const int flags = guessed ? cv::OPTFLOW_USE_INITIAL_FLOW : 0;
  std::vector<std::uint8_t> seen, back_seen;
  std::vector<float> error;
  cv::calcOpticalFlowPyrLK(from, to, points, *found, seen, error, window(), kLevels, criteria(),
                           flags, kLeastCorner);
  std::vector<cv::Point2f> back = points;
  cv::calcOpticalFlowPyrLK(to, from, *found, back, back_seen, error, window(), kLevels, criteria(),
                           cv::OPTFLOW_USE_INITIAL_FLOW, kLeastCorner);
  const cv::Size size = from.front().size();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const cv::Point2f& at = (*found)[i];
    const double trip = std::hypot(back[i].x - points[i].x, back[i].y - points[i].y);
    const bool inside = at.x >= 1.0F && at.y >= 1.0F &&
                        at.x <= static_cast<float>(size.width - 2) &&
                        at.y <= static_cast<float>(size.height - 2);
    if (!back_seen[i] || !inside || !(trip <= round_trip_px)) seen[i] = 0;
  }
  return seen;
}

/// The upper quartile of the motions: far points and the vehicle's own bonnet hardly move.
double upper_motion(const std::vector<cv::Point2f>& a, const std::vector<cv::Point2f>& b) {
  std::vector<double> lengths;
  for (std::size_t i = 0; i < a.size(); ++i) {
    lengths.push_back(std::hypot(a[i].x - b[i].x, a[i].y - b[i].y));
  }
  if (lengths.empty()) return 0.0;
  const auto at = lengths.begin() + static_cast<std::ptrdiff_t>(3 * lengths.size() / 4);
  std::nth_element(lengths.begin(), at, lengths.end());
  return *at;
}

template <class T>
void keep_seen(const std::vector<std::uint8_t>& seen, std::vector<T>* values) {
  std::size_t n = 0;
  for (std::size_t i = 0; i < seen.size(); ++i) {
    if (seen[i]) (*values)[n++] = (*values)[i];
  }
  values->resize(n);
}

}  // namespace

void FeatureTrackOptions::validate() const {
  const auto check = [](bool good, const char* name) {
    if (!good) throw std::invalid_argument(std::string(name) + " is out of its range");
  };
  check(tiles_across >= 1, "tiles_across");
  check(tiles_down >= 1, "tiles_down");
  check(features_a_tile >= 1, "features_a_tile");
  check(largest_width >= 64, "largest_width");
  check(key_motion > 0.0, "key_motion");
  check(round_trip_px > 0.0, "round_trip_px");
}

struct FeatureTracker::State {
  FeatureTrackOptions options;
  int width = 0, height = 0;
  double shrink = 1.0;  // px of the given image a px of the tracked
  Pyramid key, last;
  std::vector<cv::Point2f> at_key, now;  // of the live tracks
  std::vector<std::size_t> live;         // index into tracks
  std::vector<FeatureTrack> tracks;
  std::size_t keys = 0;
  double largest = 0.0;

  cv::Mat prepare(const GrayImage& image) {
    const cv::Mat given(image.height, image.width, CV_8UC1,
                        const_cast<std::uint8_t*>(image.pixels.data()));
    if (image.width <= options.largest_width) return given.clone();
    cv::Mat out;
    shrink = static_cast<double>(image.width) / options.largest_width;
    const int rows = std::max(1, static_cast<int>(std::lround(image.height / shrink)));
    cv::resize(given, out, cv::Size(options.largest_width, rows), 0, 0, cv::INTER_AREA);
    return out;
  }

  Eigen::Vector2d given_pixel(const cv::Point2f& p) const {
    return {(p.x + 0.5) * shrink - 0.5, (p.y + 0.5) * shrink - 0.5};
  }

  /// Whether a track is of what the vehicle carries before the camera (bonnet, dashboard) or of
  /// what is written into the image: above and below the horizon's band, where all that is outside
  /// moves from key frame to key frame, it stands still.
  bool is_own(const FeatureTrack& track) const {
    constexpr double kBand = 0.2;     // of the height, about the middle
    constexpr double kStands = 8e-4;  // of the width
    const Eigen::Vector2d& first = track.pixels.front();
    if (std::abs(first.y() - 0.5 * height) < kBand * height) return false;
    return std::all_of(track.pixels.begin(), track.pixels.end(), [&](const Eigen::Vector2d& p) {
      return (p - first).norm() < kStands * width;
    });
  }

  /// New features in the tiles that have fewer than they should.
  void find_features(const cv::Mat& image) {
    const int across = options.tiles_across, down = options.tiles_down;
    const double apart = 0.35 * std::sqrt(static_cast<double>(image.cols) / across * image.rows /
                                          down / options.features_a_tile);
    cv::Mat free(image.size(), CV_8UC1, cv::Scalar(255));
    std::vector<int> count(static_cast<std::size_t>(across * down), 0);
    const auto tile_of = [&](const cv::Point2f& p) {
      const int column = std::clamp(static_cast<int>(p.x * across / image.cols), 0, across - 1);
      const int row = std::clamp(static_cast<int>(p.y * down / image.rows), 0, down - 1);
      return static_cast<std::size_t>(row * across + column);
    };
    for (const cv::Point2f& p : now) {
      ++count[tile_of(p)];
      cv::circle(free, cv::Point(cvRound(p.x), cvRound(p.y)), cvCeil(apart), cv::Scalar(0), -1);
    }
    for (int row = 0; row < down; ++row) {
      for (int column = 0; column < across; ++column) {
        const int wanted =
            options.features_a_tile - count[static_cast<std::size_t>(row * across + column)];
        if (wanted <= 0) continue;
        const int x0 = image.cols * column / across, x1 = image.cols * (column + 1) / across;
        const int y0 = image.rows * row / down, y1 = image.rows * (row + 1) / down;
        if (x1 - x0 < 8 || y1 - y0 < 8) continue;
        const cv::Rect tile(x0, y0, x1 - x0, y1 - y0);
        std::vector<cv::Point2f> found;
        cv::goodFeaturesToTrack(image(tile), found, wanted, 0.02, apart, free(tile), 5);
        for (const cv::Point2f& p : found) {
          const cv::Point2f at(p.x + static_cast<float>(x0), p.y + static_cast<float>(y0));
          live.push_back(tracks.size());
          tracks.push_back({keys - 1, {given_pixel(at)}});
          now.push_back(at);
        }
      }
    }
    at_key = now;
  }

  void become_key(const cv::Mat& image, Pyramid pyramid) {
    ++keys;
    for (std::size_t i = 0; i < live.size(); ++i) {
      tracks[live[i]].pixels.push_back(given_pixel(now[i]));
    }
    key = std::move(pyramid);
    last = key;
    find_features(image);
  }

  void keep(const std::vector<std::uint8_t>& seen) {
    keep_seen(seen, &live);
    keep_seen(seen, &at_key);
    keep_seen(seen, &now);
  }
};

FeatureTracker::FeatureTracker(const FeatureTrackOptions& options)
    : state_(std::make_unique<State>()) {
  options.validate();
  state_->options = options;
}

FeatureTracker::~FeatureTracker() = default;

bool FeatureTracker::add(const GrayImage& given) {
  State& s = *state_;
  if (given.empty()) throw std::invalid_argument("the image is empty");
  if (s.keys == 0) {
    s.width = given.width;
    s.height = given.height;
  } else if (given.width != s.width || given.height != s.height) {
    throw std::invalid_argument("the images differ in size");
  }
  const cv::Mat image = s.prepare(given);
  Pyramid pyramid = pyramid_of(image);
  if (s.keys == 0) {
    s.become_key(image, std::move(pyramid));
    return true;
  }
  std::vector<cv::Point2f> found;
  if (!s.now.empty()) {
    s.keep([&] {
      std::vector<std::uint8_t> seen =
          follow(s.last, pyramid, s.now, 2.0 * s.options.round_trip_px, &found);
      keep_seen(seen, &found);
      return seen;
    }());
  }
  const double step = upper_motion(s.now, found) * s.shrink;
  s.now = found;
  const double motion = upper_motion(s.at_key, s.now) * s.shrink;
  s.largest = std::max(s.largest, motion);
  const bool few = s.now.size() < 60;
  if (!few && (motion < s.options.key_motion * s.width || step < kStill)) {
    s.last = std::move(pyramid);
    return false;
  }
  // Measured again from the key frame: small errors of the frames between do not add up.
  if (!s.now.empty()) {
    std::vector<cv::Point2f> again = s.now;
    const std::vector<std::uint8_t> seen =
        follow(s.key, pyramid, s.at_key, s.options.round_trip_px, &again);
    s.now = again;
    s.keep(seen);
  }
  s.become_key(image, std::move(pyramid));
  return true;
}

std::vector<FeatureTrack> FeatureTracker::take() {
  std::vector<FeatureTrack> out;
  for (FeatureTrack& track : state_->tracks) {
    if (track.pixels.size() < 2 || state_->is_own(track)) continue;
    out.push_back(std::move(track));
  }
  state_->tracks.clear();
  state_->live.clear();
  state_->now.clear();
  state_->at_key.clear();
  return out;
}

std::size_t FeatureTracker::key_frames() const { return state_->keys; }
double FeatureTracker::largest_motion() const { return state_->largest; }

}  // namespace camber
