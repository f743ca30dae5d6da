#include "camber/motion/correspondences.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <optional>
#include <stdexcept>
#include <string>

#include "camber/core/target_clones.h"
#include "camber/core/threads.h"
#include "camber/image/detail/cubic_sampling.h"
#include "camber/image/detail/single_threaded_opencv.h"
#include "camber/motion/detail/inverse_search_flow.h"
#include "camber/motion/detail/structure_tensor.h"

namespace camber {
namespace {

using detail::DenseFlow;
using detail::FlowPyramid;

constexpr float kSharpness = -0.75F;               // of cubic sampling: fine texture is matched
constexpr int kWindowWide = 32, kWindowHigh = 11;  // px, compared on their own
constexpr int kReachX = 4, kReachY = 6;            // px, of the search
constexpr int kShiftsX = 2 * kReachX + 1, kShiftsY = 2 * kReachY + 1;

/// Normalised cross-correlation (Lewis, "Fast Normalized Cross-Correlation", 1995) of a window with
/// every shift of another image, rows of kShiftsX.
/// @param window  kWindowHigh rows of kWindowWide, zero mean.
/// @param energy  sum of its squares.
/// @param from    the other image at the window's first pixel for the first shift.
CAMBER_TARGET_CLONES("avx2")
void correlate(const float* window, float energy, const float* from, std::ptrdiff_t stride,
               float* scores) {
  using F8 = float __attribute__((vector_size(32)));
  constexpr int kLanes = 8;
  constexpr float kNoise = 4.0f * kWindowWide * kWindowHigh;  // 2 intensity steps, squared, summed
  for (int dy = 0; dy < kShiftsY; ++dy) {
    for (int dx = 0; dx < kShiftsX; ++dx) {
      F8 sum = {}, squares = {}, products = {};
      for (int y = 0; y < kWindowHigh; ++y) {
        const float* a = window + y * kWindowWide;
        const float* b = from + (y + dy) * stride + dx;
        for (int x = 0; x < kWindowWide; x += kLanes) {
          F8 va, vb;
          std::memcpy(&va, a + x, sizeof(F8));
          std::memcpy(&vb, b + x, sizeof(F8));
          sum += vb;
          squares += vb * vb;
          products += va * vb;
        }
      }
      float s = 0.0f, q = 0.0f, p = 0.0f;
      for (int k = 0; k < kLanes; ++k) {
        s += sum[k];
        q += squares[k];
        p += products[k];
      }
      const float other = std::max(0.0f, q - s * s / (kWindowWide * kWindowHigh));
      scores[dy * kShiftsX + dx] = p / std::sqrt((energy + kNoise) * (other + kNoise));
    }
  }
}

/// Where a window of the reference lies in the other image, or nothing: a clear peak inside the
/// search.
/// @param centre  of the window; it and the search lie inside both images.
std::optional<cv::Point2f> find_window(const cv::Mat& reference, const cv::Mat& other,
                                       const cv::Point& centre) {
  constexpr float kPeak = 0.6f, kLead = 0.06f;
  std::array<float, static_cast<std::size_t>(kWindowWide * kWindowHigh)> window;
  const int x0 = centre.x - kWindowWide / 2, y0 = centre.y - kWindowHigh / 2;
  float mean = 0.0f;
  for (int y = 0; y < kWindowHigh; ++y) {
    const float* row = reference.ptr<float>(y0 + y) + x0;
    for (int x = 0; x < kWindowWide; ++x) {
      window[static_cast<std::size_t>(y * kWindowWide + x)] = row[x];
      mean += row[x];
    }
  }
  mean /= kWindowWide * kWindowHigh;
  float energy = 0.0f;
  for (float& value : window) {
    value -= mean;
    energy += value * value;
  }
  std::array<float, static_cast<std::size_t>(kShiftsX * kShiftsY)> scores;
  correlate(window.data(), energy, other.ptr<float>(y0 - kReachY) + x0 - kReachX,
            static_cast<std::ptrdiff_t>(other.step1()), scores.data());
  const auto best =
      static_cast<int>(std::max_element(scores.begin(), scores.end()) - scores.begin());
  const int bx = best % kShiftsX, by = best / kShiftsX;
  const auto score = [&](int x, int y) {
    return scores[static_cast<std::size_t>(y * kShiftsX + x)];
  };
  if (!(score(bx, by) > kPeak) || bx == 0 || by == 0 || bx == kShiftsX - 1 || by == kShiftsY - 1) {
    return std::nullopt;
  }
  for (int y = 0; y < kShiftsY; ++y) {
    for (int x = 0; x < kShiftsX; ++x) {
      if (std::max(std::abs(x - bx), std::abs(y - by)) < 3) continue;
      if (score(x, y) > score(bx, by) - kLead) return std::nullopt;
    }
  }
  const auto top = [](float before, float at, float after) {
    const float bend = before - 2.0f * at + after;
    return bend < -1e-6f ? std::clamp(0.5f * (before - after) / bend, -0.5f, 0.5f) : 0.0f;
  };
  return cv::Point2f(
      static_cast<float>(bx - kReachX) + top(score(bx - 1, by), score(bx, by), score(bx + 1, by)),
      static_cast<float>(by - kReachY) + top(score(bx, by - 1), score(bx, by), score(bx, by + 1)));
}

cv::Mat view(const GrayImage& image) {
  return {image.height, image.width, CV_8UC1, const_cast<std::uint8_t*>(image.pixels.data())};
}

/// Where no mask bounds the road (lost matches are kept) or the flow is to be smooth, it is
/// OpenCV's.
bool by_opencv(const CorrespondenceOptions& options) { return options.smooth || options.keep_lost; }

/// An image as a flow needs it.
struct FlowImage {
  cv::Mat pixels;                      // bytes, for OpenCV's flow
  std::optional<FlowPyramid> pyramid;  // for our own

  /// @param image  bytes or floats, which must outlive this.
  /// @param first  false: it is no flow's first image.
  FlowImage(const cv::Mat& image, const CorrespondenceOptions& options, bool first = true) {
    if (by_opencv(options)) {
      image.convertTo(pixels, CV_8U);
    } else {
      pyramid.emplace(image, options.finest_scale, first);
    }
  }
};

/// Whether a patch fits into the images from the finest scale on: into smaller ones OpenCV's flow
/// either throws or reads outside of them.
bool holds_patches(const cv::Size& size, int finest_scale) {
  constexpr int kPatch = 8, kLeast = 12;  // px
  return std::min(size.width, size.height) >= kPatch << finest_scale &&
         std::max(size.width, size.height) >= kLeast;
}

/// @return NaN where the images are too small.
DenseFlow opencv_flow(const cv::Mat& from, const cv::Mat& to, const CorrespondenceOptions& options,
                      const DenseFlow& start) {
  if (!holds_patches(from.size(), options.finest_scale)) {
    return {
        cv::Mat(from.size(), CV_32FC2, cv::Scalar::all(std::numeric_limits<double>::quiet_NaN())),
        0};
  }
  const cv::Ptr<cv::DISOpticalFlow> dis =
      cv::DISOpticalFlow::create(options.finest_scale == 2 ? cv::DISOpticalFlow::PRESET_FAST
                                                           : cv::DISOpticalFlow::PRESET_MEDIUM);
  dis->setFinestScale(options.finest_scale);
  if (options.finest_scale == 0) dis->setPatchStride(4);
  if (!options.smooth) dis->setVariationalRefinementIterations(0);
  cv::Mat flow = start.field().clone();
  dis->calc(from, to, flow);
  return {flow, 0};
}

/// @param start   a first guess of the flow, or empty.
/// @param wanted  see inverse_search_flow(); OpenCV's flow is found everywhere.
DenseFlow dense_flow(const FlowImage& from, const FlowImage& to,
                     const CorrespondenceOptions& options, const DenseFlow& start = {},
                     const std::uint8_t* wanted = nullptr) {
  if (by_opencv(options)) return opencv_flow(from.pixels, to.pixels, options, start);
  detail::InverseSearchOptions search;
  search.patch_stride = options.finest_scale == 1 ? 3 : 4;
  return detail::inverse_search_flow(*from.pyramid, *to.pyramid, search, start, wanted);
}

cv::Point2f sample_flow(const cv::Mat& flow, float x, float y) {
  const int x0 = static_cast<int>(x), y0 = static_cast<int>(y);
  const int x1 = std::min(x0 + 1, flow.cols - 1), y1 = std::min(y0 + 1, flow.rows - 1);
  const float ax = x - static_cast<float>(x0), ay = y - static_cast<float>(y0);
  const auto* r0 = flow.ptr<cv::Point2f>(y0);
  const auto* r1 = flow.ptr<cv::Point2f>(y1);
  return (1 - ay) * ((1 - ax) * r0[x0] + ax * r0[x1]) + ay * ((1 - ax) * r1[x0] + ax * r1[x1]);
}

/// Flow from the reference to another image, and back.
struct FlowPair {
  DenseFlow there, back;
};

/// Follows every grid point there and back; accepted are those that return.
void check_round_trips(const Correspondences& grid, const FlowPair& flow, double most,
                       const cv::Size& image, MatchedImage& match) {
  match.pixels.resize(grid.pixels.size());
  match.round_trip_px.assign(grid.pixels.size(), std::numeric_limits<float>::infinity());
  const auto right = static_cast<float>(image.width - 1);
  const auto bottom = static_cast<float>(image.height - 1);
  for (std::size_t i = 0; i < grid.pixels.size(); ++i) {
    const float x = grid.pixels[i].x(), y = grid.pixels[i].y();
    const cv::Point2f f = flow.there.at(x, y);
    const float tx = x + f.x, ty = y + f.y;
    match.pixels[i] = {tx, ty};
    if (!(tx >= 0 && ty >= 0 && tx <= right && ty <= bottom)) continue;
    const cv::Point2f b = flow.back.at(tx, ty);
    const float error = std::hypot(f.x + b.x, f.y + b.y);
    if (error <= static_cast<float>(most)) match.round_trip_px[i] = error;
  }
}

std::ptrdiff_t accepted(const MatchedImage& match) {
  return std::count_if(match.round_trip_px.begin(), match.round_trip_px.end(),
                       [](float px) { return std::isfinite(px); });
}

/// Whether a flow lost its image: neighbours share nearly as much with the reference.
bool is_lost(const MatchedImage& match, const MatchedImage& nearer) {
  return 2 * accepted(match) < accepted(nearer);
}

/// The images of a window as a flow needs them, prepared where one is asked for, and the flows
/// between them that are kept or found.
class WindowFlows {
 public:
  WindowFlows(const std::vector<GrayImage>& images, const CorrespondenceOptions& options,
              const KeptFlows& kept)
      : images_(images),
        options_(options),
        kept_(kept),
        prepared_(images.size()),
        once_(images.size()) {}

  const CorrespondenceOptions& options() const { return options_; }

  const FlowImage& image(std::size_t k) {
    std::call_once(once_[k], [&] { prepared_[k].emplace(view(images_[k]), options_); });
    return *prepared_[k];
  }

  DenseFlow flow(std::size_t from, std::size_t to) {
    if (kept_.cache) {
      DenseFlow flow = kept_.cache->find(kept_.ids[from], kept_.ids[to]);
      if (!flow.empty()) return flow;
    }
    DenseFlow found = dense_flow(image(from), image(to), options_);
    if (kept_.cache) kept_.cache->keep(kept_.ids[from], kept_.ids[to], found);
    return found;
  }

  /// From a first guess; not kept.
  DenseFlow flow(std::size_t from, std::size_t to, const DenseFlow& start) {
    return dense_flow(image(from), image(to), options_, start);
  }

 private:
  const std::vector<GrayImage>& images_;
  const CorrespondenceOptions& options_;
  const KeptFlows& kept_;
  std::vector<std::optional<FlowImage>> prepared_;
  std::vector<std::once_flag> once_;
};

/// Flow to an image that is far from the reference, from a start through the image between;
/// taken where more comes back than without it.
void follow(WindowFlows& flows, std::size_t reference, std::size_t between,
            const FlowPair& to_between, const Correspondences& grid, const cv::Size& size,
            FlowPair& flow, MatchedImage& match) {
  const auto image = static_cast<std::size_t>(match.frame);
  const DenseFlow on = flows.flow(between, image);
  const DenseFlow home = flows.flow(image, between);
  FlowPair found;
  found.there = flows.flow(reference, image, to_between.there.followed_by(on));
  found.back = flows.flow(image, reference, home.followed_by(to_between.back));
  MatchedImage again;
  again.frame = match.frame;
  check_round_trips(grid, found, flows.options().forward_backward_px, size, again);
  if (accepted(again) <= accepted(match)) return;
  match = std::move(again);
  flow = std::move(found);
}

/// Another image carried onto the reference by a prediction.
struct CarriedImage {
  const PredictedImage& prediction;
  int first;          // row of the reference that is row 0 here
  cv::Mat map;        // pixel of the other image, NaN where there is none
  cv::Mat intensity;  // float

  /// Whether a pixel is seen there, and nothing stands on it.
  bool usable(int x, int y) const {
    const cv::Point2f p = map.at<cv::Point2f>(y, x);
    return p.x >= 0 && p.y >= 0 && p.x <= static_cast<float>(map.cols - 1) &&
           p.y <= static_cast<float>(map.rows + first - 1) &&
           !prediction
                .ignored[static_cast<std::size_t>(y + first) * static_cast<std::size_t>(map.cols) +
                         static_cast<std::size_t>(x)];
  }
};
// A prediction may be off by this much: px, or a share of the distance that a fast near pixel
// moves.
constexpr float kCorrection = 6.0f, kCorrectionShare = 0.3f;

/// Matches the searched grid points by windows, each on its own; marks those that were found.
void match_windows(const cv::Mat& reference, const CarriedImage& other, const Correspondences& grid,
                   MatchedImage& match, std::vector<std::uint8_t>& found) {
  constexpr int kCellWide = 8, kCellHigh = 4;  // px, to one window
  constexpr float kWindowNoise = 0.3f;         // px, as a round trip
  const int width = reference.cols, height = reference.rows, step = grid.step;
  const std::vector<std::uint8_t>& searched = other.prediction.searched;
  const int side = kWindowWide / 2 + kReachX, above = kWindowHigh / 2 + kReachY;
  for (int y = above; y + above + 1 < height; y += kCellHigh) {
    for (int x = side; x + side < width; x += kCellWide) {
      if (!searched[static_cast<std::size_t>(y + other.first) * static_cast<std::size_t>(width) +
                    static_cast<std::size_t>(x)]) {
        continue;
      }
      bool whole = true;
      for (int dy = -above; dy <= above && whole; dy += above / 2) {
        for (const int dx : {-side, -side / 2, 0, side / 2, side - 1}) {
          whole = whole && other.usable(x + dx, y + dy);
        }
      }
      if (!whole) continue;
      const auto f = find_window(reference, other.intensity, {x, y});
      if (!f) continue;
      for (int v = y - kCellHigh / 2; v < y + kCellHigh / 2; ++v) {
        if ((v + other.first) % step != 0) continue;
        for (int u = x - kCellWide / 2; u < x + kCellWide / 2; ++u) {
          if (u % step != 0) continue;
          const auto i = static_cast<std::size_t>((v + other.first) / step) *
                             static_cast<std::size_t>(grid.columns) +
                         static_cast<std::size_t>(u / step);
          const float tx = static_cast<float>(u) + f->x, ty = static_cast<float>(v) + f->y;
          if (!other.usable(static_cast<int>(tx), static_cast<int>(ty))) {
            continue;
          }
          const cv::Point2f p = sample_flow(other.map, tx, ty);
          if (std::isnan(p.x)) continue;
          match.pixels[i] = {p.x, p.y};
          match.round_trip_px[i] = kWindowNoise;
          found[i] = 1;
        }
      }
    }
  }
}

void require_fitting(const PredictedImage& prediction, std::size_t k, int frame,
                     std::size_t pixels) {
  if (prediction.frame != frame || prediction.pixels.size() != pixels ||
      prediction.ignored.size() != pixels ||
      (!prediction.searched.empty() && prediction.searched.size() != pixels)) {
    throw std::invalid_argument("prediction " + std::to_string(k) +
                                " does not fit the images it is for");
  }
}

/// Carries an image onto the reference from a row on.
/// @param reference  float, from row `first` on
/// @param whole      float, all rows of the image
CarriedImage carry(const PredictedImage& prediction, const cv::Mat& reference, int first,
                   const cv::Mat& whole) {
  static_assert(sizeof(Eigen::Vector2f) == sizeof(cv::Point2f));
  const int height = reference.rows;
  const auto width = static_cast<std::size_t>(reference.cols);
  CarriedImage out{prediction, first,
                   cv::Mat(height, reference.cols, CV_32FC2,
                           const_cast<Eigen::Vector2f*>(prediction.pixels.data() +
                                                        static_cast<std::size_t>(first) * width)),
                   cv::Mat(height, reference.cols, CV_32FC1)};
  const detail::FloatImage seen{whole.ptr<float>(), static_cast<std::ptrdiff_t>(whole.step1()),
                                whole.cols, whole.rows};
  std::vector<float> at_x(width), at_y(width);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < reference.cols; ++x) {
      // What is not seen there, or of no interest, is as in the reference.
      const bool shown = out.usable(x, y);
      const cv::Point2f p = out.map.at<cv::Point2f>(y, x);
      at_x[static_cast<std::size_t>(x)] = shown ? p.x : -1.0F;
      at_y[static_cast<std::size_t>(x)] = shown ? p.y : -1.0F;
    }
    detail::sample_cubic(seen, kSharpness, reference.cols, at_x.data(), at_y.data(),
                         reference.ptr<float>(y), out.intensity.ptr<float>(y));
  }
  return out;
}

// A match looks at the flow around it, too: where that varies quickly it crosses an edge of depth
// or has failed.
constexpr int kAround = 4;  // px

/// One byte a pixel: non-zero where the grid's matches look at the flow.
std::vector<std::uint8_t> wanted_flow(const Correspondences& grid, const CarriedImage& other) {
  const int wide = other.map.cols, height = other.map.rows;
  const auto width = static_cast<std::size_t>(wide);
  std::vector<std::uint8_t> wanted(width * static_cast<std::size_t>(height), 0);
  for (const Eigen::Vector2f& pixel : grid.pixels) {
    const int x = static_cast<int>(pixel.x()), y = static_cast<int>(pixel.y()) - other.first;
    if (y < 0 || !other.usable(x, y)) continue;
    for (const auto& [u, v] : {std::pair{x, y},
                               {x - kAround, y},
                               {x + kAround, y},
                               {x, y - kAround},
                               {x, y + kAround}}) {
      wanted[static_cast<std::size_t>(std::clamp(v, 0, height - 1)) * width +
             static_cast<std::size_t>(std::clamp(u, 0, wide - 1))] = 1;
    }
  }
  return wanted;
}

/// Matches the grid points by the flow from the reference to a carried image.
void match_flow(const DenseFlow& flow, const CarriedImage& other, const Correspondences& grid,
                const CorrespondenceOptions& options, MatchedImage& match) {
  const int width = other.map.cols, height = other.map.rows;
  const auto flow_at = [&](int x, int y) {
    return flow.at(static_cast<float>(x), static_cast<float>(y));
  };
  for (std::size_t i = 0; i < grid.pixels.size(); ++i) {
    const int x = static_cast<int>(grid.pixels[i].x());
    const int y = static_cast<int>(grid.pixels[i].y()) - other.first;
    if (y < 0 || std::isnan(other.map.at<cv::Point2f>(y, x).x)) continue;
    const float before_px = match.round_trip_px[i];
    match.round_trip_px[i] = std::numeric_limits<float>::infinity();
    if (!other.usable(x, y)) continue;
    if (options.keep_lost) match.round_trip_px[i] = before_px;
    const cv::Point2f f = flow_at(x, y);
    const float tx = static_cast<float>(x) + f.x, ty = static_cast<float>(y) + f.y;
    if (!(tx >= 0 && ty >= 0 && tx < static_cast<float>(width - 1) &&
          ty < static_cast<float>(height - 1)) ||
        !other.usable(static_cast<int>(tx), static_cast<int>(ty))) {
      continue;
    }
    const cv::Point2f p = sample_flow(other.map, tx, ty);
    if (std::isnan(p.x)) continue;
    const float moved_x = p.x - static_cast<float>(x);
    const float moved_y = p.y - static_cast<float>(y + other.first);
    const cv::Point2f fx = flow_at(x + kAround, y) - flow_at(x - kAround, y);
    const cv::Point2f fy = flow_at(x, y + kAround) - flow_at(x, y - kAround);
    const float variation = 0.5f * std::sqrt(fx.x * fx.x + fx.y * fx.y + fy.x * fy.x + fy.y * fy.y);
    if (variation <= static_cast<float>(options.forward_backward_px) &&
        std::hypot(f.x, f.y) <
            std::max(kCorrection, kCorrectionShare * std::hypot(moved_x, moved_y))) {
      match.pixels[i] = {p.x, p.y};
      match.round_trip_px[i] = variation;
    }
  }
}

/// Where one image shows by a window that the flow was wrong the others' is dropped too.
/// @param found  an image, one byte a grid point; empty: no windows were compared.
void drop_contradicted(const std::vector<std::vector<std::uint8_t>>& found,
                       std::vector<MatchedImage>& matches) {
  for (std::size_t k = 0; k < found.size(); ++k) {
    for (std::size_t i = 0; i < found[k].size(); ++i) {
      if (!found[k][i]) continue;
      for (std::size_t other = 0; other < found.size(); ++other) {
        if (!found[other].empty() && !found[other][i]) {
          matches[other].round_trip_px[i] = std::numeric_limits<float>::infinity();
        }
      }
    }
  }
}

/// See correspondence_grid(); OpenCV must run on one thread.
Correspondences grid_of(const GrayImage& image, int reference, int step) {
  Correspondences out;
  out.reference = reference;
  out.step = step;
  out.columns = (image.width - 1) / step + 1;
  out.rows = (image.height - 1) / step + 1;
  const StructureTensor texture(image);
  const auto count = static_cast<std::size_t>(out.columns) * static_cast<std::size_t>(out.rows);
  out.pixels.reserve(count);
  out.texture.reserve(count);
  for (int y = 0; y < image.height; y += step) {
    for (int x = 0; x < image.width; x += step) {
      out.pixels.emplace_back(static_cast<float>(x), static_cast<float>(y));
      out.texture.push_back(texture.at(out.pixels.back()));
    }
  }
  return out;
}

}  // namespace

std::size_t MatchedImage::count() const {
  return static_cast<std::size_t>(std::count_if(round_trip_px.begin(), round_trip_px.end(),
                                                [](float px) { return std::isfinite(px); }));
}

void check_images(const std::vector<GrayImage>& images, int reference) {
  if (reference < 0 || reference >= static_cast<int>(images.size())) {
    throw std::invalid_argument("reference = " + std::to_string(reference) +
                                ", expected an index into " + std::to_string(images.size()) +
                                " images");
  }
  const GrayImage& base = images[static_cast<std::size_t>(reference)];
  for (const GrayImage& image : images) {
    if (image.width != base.width || image.height != base.height || image.empty()) {
      throw std::invalid_argument("images differ in size or are empty");
    }
  }
}

void CorrespondenceOptions::validate() const {
  if (step < 1) {
    throw std::invalid_argument("step = " + std::to_string(step) + ", expected at least 1 pixel");
  }
  if (!(forward_backward_px > 0)) {
    throw std::invalid_argument("forward_backward_px = " + std::to_string(forward_backward_px) +
                                ", expected a positive number of pixels");
  }
  if (finest_scale < 0 || finest_scale > 2) {
    throw std::invalid_argument("finest_scale = " + std::to_string(finest_scale) +
                                ", expected 0 to 2");
  }
}

Correspondences correspondence_grid(const GrayImage& image, int reference, int step) {
  if (image.empty() || step < 1) {
    throw std::invalid_argument("a grid of step " + std::to_string(step) + " in an image of " +
                                std::to_string(image.width) + " x " + std::to_string(image.height) +
                                " pixels");
  }
  const SingleThreadedOpenCv guard;
  return grid_of(image, reference, step);
}

Correspondences match_images(const std::vector<GrayImage>& images, int reference,
                             const CorrespondenceOptions& options, const KeptFlows& kept) {
  options.validate();
  check_images(images, reference);
  if (kept.cache && kept.ids.size() != images.size()) {
    throw std::invalid_argument("found " + std::to_string(kept.ids.size()) +
                                " ids of kept flows, expected one for each of " +
                                std::to_string(images.size()) + " images");
  }
  const GrayImage& base = images[static_cast<std::size_t>(reference)];
  const SingleThreadedOpenCv guard;
  std::vector<std::size_t> others;
  const auto at_reference = static_cast<std::size_t>(reference);
  for (std::size_t k = 0; k < images.size(); ++k) {
    if (k != at_reference) others.push_back(k);
  }
  WindowFlows window(images, options, kept);
  Correspondences out;
  std::vector<FlowPair> flows(others.size());
  parallel_for(2 * flows.size() + 1, options.num_threads, [&](std::size_t task) {
    if (task == 2 * flows.size()) {
      out = grid_of(base, reference, options.step);
    } else if (task % 2 == 0) {
      flows[task / 2].there = window.flow(at_reference, others[task / 2]);
    } else {
      flows[task / 2].back = window.flow(others[task / 2], at_reference);
    }
  });

  const cv::Size size(base.width, base.height);
  out.matches.resize(others.size());
  parallel_for(others.size(), options.num_threads, [&](std::size_t k) {
    out.matches[k].frame = static_cast<int>(others[k]);
    check_round_trips(out, flows[k], options.forward_backward_px, size, out.matches[k]);
  });
  // Outwards on both sides of the reference, each image after its neighbour. A list of others has
  // the image before the reference at reference - 1, the one after it at reference.
  const auto count = static_cast<int>(others.size());
  parallel_for(2, options.num_threads, [&](std::size_t side) {
    const int step = side == 0 ? -1 : 1;
    for (int k = side == 0 ? reference - 2 : reference + 1; k >= 0 && k < count; k += step) {
      const auto at = static_cast<std::size_t>(k), nearer = static_cast<std::size_t>(k - step);
      if (!is_lost(out.matches[at], out.matches[nearer])) continue;
      follow(window, at_reference, others[nearer], flows[nearer], out, size, flows[at],
             out.matches[at]);
    }
  });
  return out;
}

Correspondences refine_matches(const std::vector<GrayImage>& images, const Correspondences& before,
                               const std::vector<PredictedImage>& predictions, int top,
                               const CorrespondenceOptions& options) {
  options.validate();
  if (predictions.size() != before.matches.size()) {
    throw std::invalid_argument("found " + std::to_string(predictions.size()) +
                                " predictions, expected one for each of " +
                                std::to_string(before.matches.size()) + " matched images");
  }
  Correspondences out = before;
  const GrayImage& base = images.at(static_cast<std::size_t>(before.reference));
  const int first = std::clamp(top, 0, std::max(0, base.height - 16));
  std::vector<cv::Mat> intensities(images.size());
  parallel_for(images.size(), options.num_threads,
               [&](std::size_t k) { view(images[k]).convertTo(intensities[k], CV_32F); });
  const cv::Mat reference =
      intensities[static_cast<std::size_t>(before.reference)].rowRange(first, base.height);
  const SingleThreadedOpenCv guard;
  const FlowImage here(reference, options);
  std::vector<std::vector<std::uint8_t>> found(out.matches.size());  // by a window of its own
  parallel_for(out.matches.size(), options.num_threads, [&](std::size_t k) {
    MatchedImage& match = out.matches[k];
    const PredictedImage& prediction = predictions[k];
    require_fitting(prediction, k, match.frame, base.pixels.size());
    const CarriedImage other =
        carry(prediction, reference, first, intensities[static_cast<std::size_t>(match.frame)]);
    const std::vector<std::uint8_t> wanted = wanted_flow(out, other);
    const DenseFlow flow =
        dense_flow(here, FlowImage(other.intensity, options, false), options, {}, wanted.data());
    match_flow(flow, other, out, options, match);
    if (!prediction.searched.empty()) {
      found[k].assign(out.pixels.size(), 0);
      match_windows(reference, other, out, match, found[k]);
    }
  });
  drop_contradicted(found, out.matches);
  return out;
}

}  // namespace camber
