#include "camber/photometric/plane_search.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/image/detail/single_threaded_opencv.h"
#include "camber/photometric/detail/corridor_kernels.h"

namespace camber {
namespace {

/// Right, ahead and up of the road under the camera.
struct RoadAxes {
  Eigen::Vector3d right, ahead, up;

  RoadAxes(const Eigen::Vector3d& travel, double roll) {
    ahead = travel;
    const Eigen::Vector3d level(0, -1, 0);
    const Eigen::Vector3d up0 = (level - level.dot(ahead) * ahead).normalized();
    up = std::cos(roll) * up0 + std::sin(roll) * ahead.cross(up0);
    right = ahead.cross(up);
  }
};

/// Inverse depth, 1/camera height, of the bending road on a ray with these components ahead and up;
/// 0: it misses the road.
double inverse_depth_on(double ahead, double up, double curvature) {
  const double under = up * up + 2.0 * curvature * ahead * ahead;
  if (!(ahead > 0.0) || !(under > 0.0)) return 0.0;
  return std::max(0.0, 0.5 * (std::sqrt(under) - up));
}

/// Curvature of the driven path to the right, 1/baseline.
double path_curvature(const MotionEstimate& motion) {
  std::size_t farthest = 0;
  double longest = 0.0;
  for (std::size_t k = 0; k < motion.frame_from_reference.size(); ++k) {
    const double length = motion.frame_from_reference[k].translation().norm();
    if (length > longest) {
      longest = length;
      farthest = k;
    }
  }
  if (!(longest > 0.0)) return 0.0;
  const SE3 there = motion.frame_from_reference[farthest].inverse();
  const Eigen::Vector3d ahead = there.rotation() * Eigen::Vector3d::UnitZ();
  const double turn = std::atan2(ahead.x(), ahead.z());
  return there.translation().z() >= 0.0 ? turn / longest : -turn / longest;
}

constexpr int kMostLevels = 3, kLeastLevels = 2;
constexpr int kLeastColumns = 240;  // of the coarsest: below, a near road has no texture left
constexpr int kWindowWide = 16, kWindowHigh = 6;  // px of the finest level
constexpr double kPixelsPerSample = 9.0;          // one in three columns and rows
constexpr double kLeastShare = 0.25;              // of the windows of a level corridor

/// Where the corridor of a hypothesis lies in one row of an image, and its inverse depths.
struct CorridorRow {
  int from = 0, to = 0;              // compared columns
  std::vector<float> inverse_depth;  // one a compared column; 0: outside
};

/// The corridor row by row: components of the rays are linear in the column.
class Corridor {
 public:
  /// @param stride  px, between the columns that are compared.
  Corridor(const PinholeCamera& camera, int stride, const Eigen::Vector3d& travel,
           const RoadHypothesis& hypothesis, double bend, const PlaneSearchOptions& options)
      : camera_(camera),
        stride_(stride),
        axes_(travel, hypothesis.roll),
        curvature_(hypothesis.curvature),
        bend_(bend),
        options_(options),
        focus_(camera.cx + camera.fx * travel.x() / std::max(0.1, travel.z())) {}

  /// @return false: this row and those above it are beyond the reach.
  bool row(int v, CorridorRow* out) const {
    const Eigen::Vector3d middle_ray = camera_.ray({focus_, static_cast<double>(v)});
    const double rho =
        inverse_depth_on(axes_.ahead.dot(middle_ray), axes_.up.dot(middle_ray), curvature_);
    const double ahead = axes_.ahead.dot(middle_ray) / rho;
    out->from = out->to = 0;
    if (!(rho > 0.0) || !(ahead < 1.1 * options_.reach)) return false;
    const int columns = camera_.width / stride_;
    const double middle = focus_ + camera_.fx * rho * 0.5 * bend_ * ahead * ahead;
    const double half = 1.2 * camera_.fx * rho * options_.half_width + 2.0;
    out->from = std::clamp(static_cast<int>((middle - half) / stride_), 0, columns);
    out->to = std::clamp(static_cast<int>((middle + half) / stride_), out->from, columns);
    out->inverse_depth.resize(static_cast<std::size_t>(columns));
    const Eigen::Vector3d first =
        camera_.ray({static_cast<double>(out->from * stride_), static_cast<double>(v)});
    const double step = stride_ / camera_.fx;
    const RowRays rays{
        static_cast<float>(axes_.ahead.dot(first)), static_cast<float>(axes_.ahead.x() * step),
        static_cast<float>(axes_.up.dot(first)),    static_cast<float>(axes_.up.x() * step),
        static_cast<float>(axes_.right.dot(first)), static_cast<float>(axes_.right.x() * step)};
    const CorridorShape shape{static_cast<float>(curvature_), static_cast<float>(0.5 * bend_),
                              static_cast<float>(options_.reach),
                              static_cast<float>(options_.half_width)};
    corridor_inverse_depths(out->to - out->from, rays, shape,
                            out->inverse_depth.data() + out->from);
    return true;
  }

 private:
  const PinholeCamera& camera_;
  int stride_;
  RoadAxes axes_;
  double curvature_, bend_;
  const PlaneSearchOptions& options_;
  double focus_;
};

/// A view of the reference's road at one baseline: p = rotation * ray + inverse depth * shift.
struct WarpedView {
  std::size_t image = 0;
  Eigen::Matrix3f rotation;
  Eigen::Vector3f shift;
  std::vector<float> sums;  // six a compared column, of the rows at hand

  ColumnSums columns(int first) {
    const auto n = static_cast<std::ptrdiff_t>(sums.size() / 6);
    float* at = sums.data() + first;
    return {at, at + n, at + 2 * n, at + 3 * n, at + 4 * n, at + 5 * n};
  }
};

/// The values of every `stride`-th column, row by row without gaps.
std::vector<float> every_column(const cv::Mat& image, int stride) {
  std::vector<float> out;
  out.reserve(static_cast<std::size_t>(image.rows * (image.cols / stride)));
  for (int v = 0; v < image.rows; ++v) {
    const float* row = image.ptr<float>(v);
    for (int u = 0; u + stride <= image.cols; u += stride) out.push_back(row[u]);
  }
  return out;
}

/// See SampledImage; the last column and row have no cells.
/// @param hidden  bytes, non-zero where something hides the image.
std::vector<std::uint32_t> cells_of(const cv::Mat& image, const cv::Mat& hidden) {
  std::vector<std::uint32_t> out(image.total(), 0);
  for (int v = 0; v + 1 < image.rows; ++v) {
    const auto* upper = image.ptr<std::uint8_t>(v);
    const auto* lower = image.ptr<std::uint8_t>(v + 1);
    std::uint32_t* to = &out[static_cast<std::size_t>(v) * static_cast<std::size_t>(image.cols)];
    const auto* covered = hidden.ptr<std::uint8_t>(v);
    for (int u = 0; u + 1 < image.cols; ++u) {
      if (covered[u]) {
        to[u] = kHiddenCell;
        continue;
      }
      to[u] = upper[u] | static_cast<std::uint32_t>(upper[u + 1]) << 8 |
              static_cast<std::uint32_t>(lower[u]) << 16 |
              static_cast<std::uint32_t>(lower[u + 1]) << 24;
    }
  }
  return out;
}

}  // namespace

/// The images at one resolution.
struct PlaneSearch::Level {
  PinholeCamera camera;
  int window_wide = kWindowWide, window_high = kWindowHigh;
  int stride = 1;      // px, between the columns and rows that are compared
  double noise = 4.0;  // intensity squared, of a window without texture
  std::vector<std::vector<std::uint32_t>> cells;  // see SampledImage, of all images
  std::vector<float> here, here_visible;          // the reference's compared columns

  int columns() const { return camera.width / stride; }

  /// Adds one row of the corridor to a view's sums.
  void add_row(const CorridorRow& row, int v, WarpedView* view) const;
};

void PlaneSearch::Level::add_row(const CorridorRow& row, int v, WarpedView* view) const {
  const auto fx = static_cast<float>(camera.fx), fy = static_cast<float>(camera.fy);
  const auto cx = static_cast<float>(camera.cx), cy = static_cast<float>(camera.cy);
  const Eigen::Vector3f step = (static_cast<float>(stride) / fx) * view->rotation.col(0);
  const Eigen::Vector3f first =
      view->rotation * Eigen::Vector3f((static_cast<float>(row.from * stride) - cx) / fx,
                                       (static_cast<float>(v) - cy) / fy, 1.0F);
  const RowWarp warp{
      first.x(),       first.y(),       first.z(), step.x(), step.y(), step.z(), view->shift.x(),
      view->shift.y(), view->shift.z(), fx,        fy,       cx,       cy};
  const auto at = static_cast<std::size_t>(v) * static_cast<std::size_t>(columns()) +
                  static_cast<std::size_t>(row.from);
  add_warped_row(row.to - row.from, row.inverse_depth.data() + row.from, here.data() + at,
                 here_visible.data() + at, warp,
                 {cells[view->image].data(), camera.width, camera.height}, view->columns(row.from));
}

PlaneSearch::~PlaneSearch() = default;

PlaneSearch::PlaneSearch(const PinholeCamera& camera, const std::vector<PlaneSearchImage>& images,
                         std::size_t reference, const PlaneSearchOptions& options)
    : options_(options), reference_(reference) {
  const std::size_t total =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  if (reference >= images.size()) {
    throw std::invalid_argument("plane search: the reference is no index into the images");
  }
  for (const PlaneSearchImage& image : images) {
    if (!image.image || image.image->width != camera.width ||
        image.image->height != camera.height || image.image->pixels.size() != total ||
        (image.ignored && image.ignored->size() != total)) {
      throw std::invalid_argument("plane search: images, masks and camera differ in size");
    }
  }
  const SingleThreadedOpenCv guard;
  for (int k = 0; k < kMostLevels; ++k) {
    if (k >= kLeastLevels && (camera.width >> k) < kLeastColumns) break;
    Level level;
    const int shrink = 1 << k;
    const cv::Size size(camera.width / shrink, camera.height / shrink);
    const cv::Rect whole(0, 0, size.width * shrink, size.height * shrink);
    level.camera = {size.width,
                    size.height,
                    camera.fx / shrink,
                    camera.fy / shrink,
                    (camera.cx + 0.5) / shrink - 0.5,
                    (camera.cy + 0.5) / shrink - 0.5};
    level.window_wide = std::max(8, kWindowWide / shrink);
    level.window_high = std::max(4, kWindowHigh / shrink);
    level.noise /= shrink;
    level.stride = k == 0 ? 2 : 1;
    for (const PlaneSearchImage& image : images) {
      const cv::Mat full(camera.height, camera.width, CV_8UC1,
                         const_cast<std::uint8_t*>(image.image->pixels.data()));
      cv::Mat small;
      cv::resize(full(whole), small, size, 0, 0, cv::INTER_AREA);
      cv::Mat ignored(size, CV_8UC1, cv::Scalar(0));
      if (image.ignored) {
        const cv::Mat mask(camera.height, camera.width, CV_8UC1,
                           const_cast<std::uint8_t*>(image.ignored->data()));
        cv::resize(mask(whole), ignored, size, 0, 0, cv::INTER_NEAREST);
      }
      level.cells.push_back(cells_of(small, ignored));
      if (image.image == images[reference].image) {
        cv::Mat gray, visible(size, CV_32FC1, cv::Scalar(1.0));
        small.convertTo(gray, CV_32F);
        visible.setTo(0.0, ignored);
        level.here = every_column(gray, level.stride);
        level.here_visible = every_column(visible, level.stride);
      }
    }
    levels_.push_back(std::move(level));
  }
}

double PlaneSearch::corridor_windows(const Level& level, const MotionEstimate& motion) const {
  const Corridor corridor(level.camera, 1, travel_direction(motion, reference_), {}, 0.0, options_);
  CorridorRow row;
  double pixels = 0.0;
  for (int v = level.camera.height - 1; v >= 0 && corridor.row(v, &row); --v) {
    for (int u = row.from; u < row.to; ++u) {
      pixels += row.inverse_depth[static_cast<std::size_t>(u)] > 0.0F;
    }
  }
  return pixels / (level.window_wide * level.window_high);
}

double PlaneSearch::correlation_at(const Level& level, const MotionEstimate& motion,
                                   const RoadHypothesis& hypothesis, double level_windows,
                                   int* samples) const {
  const double baseline = std::exp(hypothesis.log_baseline);
  const Corridor corridor(level.camera, level.stride, travel_direction(motion, reference_),
                          hypothesis, path_curvature(motion) / baseline, options_);
  std::vector<WarpedView> views;
  const auto columns = static_cast<std::size_t>(level.columns());
  for (std::size_t k = 0; k < level.cells.size(); ++k) {
    if (k == reference_) continue;
    const SE3& pose = motion.frame_from_reference[k];
    views.push_back({k, pose.rotation_matrix().cast<float>(),
                     (baseline * pose.translation()).cast<float>(),
                     std::vector<float>(6 * columns, 0.0F)});
  }
  const int pixels_each = level.stride * level.stride;
  const double least = 0.6 * level.window_wide * level.window_high / pixels_each;
  double sum = 0.0, total = 0.0, pixels = 0.0;
  const int wide = level.window_wide / level.stride;  // compared columns
  int leftmost = level.columns(), rightmost = 0;      // of the rows at hand
  const auto finish_windows = [&](WarpedView& view) {
    for (int first = leftmost - leftmost % wide; first < rightmost; first += wide) {
      const ColumnSums c = view.columns(first);
      double n = 0.0, a = 0.0, b = 0.0, aa = 0.0, bb = 0.0, ab = 0.0;
      for (int k = 0; k < std::min(wide, level.columns() - first); ++k) {
        n += c.count[k];
        a += c.a[k];
        b += c.b[k];
        aa += c.aa[k];
        bb += c.bb[k];
        ab += c.ab[k];
      }
      if (n < least) continue;
      const double ma = a / n, mb = b / n;
      const double va = std::max(0.0, aa / n - ma * ma), vb = std::max(0.0, bb / n - mb * mb);
      const double weight = va / (va + level.noise);
      sum += weight * (ab / n - ma * mb) / std::sqrt((va + 1e-3) * (vb + 1e-3));
      total += weight;
      pixels += pixels_each * n;
    }
    for (std::size_t k = 0; k < view.sums.size(); k += columns) {
      std::fill(view.sums.begin() + static_cast<std::ptrdiff_t>(k) + leftmost,
                view.sums.begin() + static_cast<std::ptrdiff_t>(k) + std::max(leftmost, rightmost),
                0.0F);
    }
  };
  CorridorRow row;
  for (int v = level.camera.height - 1; v >= 0; --v) {
    const bool compared = (level.camera.height - 1 - v) % level.stride == 0;
    const bool within = !compared || corridor.row(v, &row);
    if (within && compared) {
      for (WarpedView& view : views) level.add_row(row, v, &view);
      leftmost = std::min(leftmost, row.from);
      rightmost = std::max(rightmost, row.to);
    }
    if (!within || v == 0 || (level.camera.height - v) % level.window_high == 0) {
      for (WarpedView& view : views) finish_windows(view);
      leftmost = level.columns();
      rightmost = 0;
    }
    if (!within) break;
  }
  if (samples) *samples = static_cast<int>(pixels / kPixelsPerSample);
  // A hypothesis that leaves but few windows in view proves nothing by them.
  const double least_weight = kLeastShare * static_cast<double>(views.size()) * level_windows;
  return total > 0.0 ? sum / std::max(total, least_weight) : -1.0;
}

double PlaneSearch::correlation(const MotionEstimate& motion, const RoadHypothesis& hypothesis,
                                int* samples) const {
  const Level& fine = levels_.front();
  return correlation_at(fine, motion, hypothesis, corridor_windows(fine, motion), samples);
}

double PlaneSearch::correlation_with_baseline(const MotionEstimate& motion,
                                              double log_baseline) const {
  RoadHypothesis best{log_baseline, 0.0, 0.0};
  double correlation = -1.0;
  const auto scan = [&](const Level& level, int steps, double share) {
    std::vector<RoadHypothesis> tried;
    for (int c = -steps; c <= steps; ++c) {
      for (int r = -steps; r <= steps; ++r) {
        const RoadHypothesis h{log_baseline,
                               best.curvature + share * options_.max_curvature * c / steps,
                               best.roll + share * options_.max_roll * r / steps};
        if (within(h)) tried.push_back(h);
      }
    }
    correlation = correlations(level, motion, {best}).front();
    take_best(level, motion, tried, &best, &correlation);
  };
  scan(levels_[1], 4, 1.0);
  scan(levels_[0], 2, 0.25);
  return correlation;
}

std::vector<double> PlaneSearch::correlations(const Level& level, const MotionEstimate& motion,
                                              const std::vector<RoadHypothesis>& hypotheses) const {
  std::vector<double> out(hypotheses.size());
  const double windows = corridor_windows(level, motion);
  parallel_for(hypotheses.size(), options_.num_threads, [&](std::size_t i) {
    out[i] = correlation_at(level, motion, hypotheses[i], windows, nullptr);
  });
  return out;
}

bool PlaneSearch::within(const RoadHypothesis& h) const {
  return std::abs(h.curvature) <= 1.001 * options_.max_curvature &&
         std::abs(h.roll) <= 1.001 * options_.max_roll;
}

bool PlaneSearch::take_best(const Level& level, const MotionEstimate& motion,
                            const std::vector<RoadHypothesis>& tried, RoadHypothesis* best,
                            double* correlation) const {
  const std::vector<double> found = correlations(level, motion, tried);
  const auto at =
      static_cast<std::size_t>(std::max_element(found.begin(), found.end()) - found.begin());
  if (tried.empty() || !(found[at] > *correlation)) return false;
  *correlation = found[at];
  *best = tried[at];
  return true;
}

/// Steps of half `along` in the logarithm of the baseline, eighths of the largest curvature and
/// tenths of the largest roll.
struct PlaneSearch::Lattice {
  const Level& level;
  const MotionEstimate& motion;
  double windows;
  RoadHypothesis origin, step;
  std::map<Place, double> known;

  /// @param share  of the usual steps of curvature and roll.
  Lattice(const PlaneSearch& search, const Level& of, const MotionEstimate& of_motion,
          const RoadHypothesis& from, double along, double share)
      : level(of),
        motion(of_motion),
        windows(search.corridor_windows(of, of_motion)),
        origin(from),
        step{0.5 * along, 0.125 * share * search.options_.max_curvature,
             0.1 * share * search.options_.max_roll} {}

  RoadHypothesis at(const Place& p) const {
    return {origin.log_baseline + p[0] * step.log_baseline,
            origin.curvature + p[1] * step.curvature, origin.roll + p[2] * step.roll};
  }
};

std::vector<double> PlaneSearch::correlations(const std::vector<Place>& places,
                                              Lattice* lattice) const {
  std::vector<Place> unknown;
  for (const Place& p : places) {
    if (lattice->known.find(p) == lattice->known.end()) unknown.push_back(p);
  }
  std::vector<double> found(unknown.size());
  parallel_for(unknown.size(), options_.num_threads, [&](std::size_t i) {
    found[i] = correlation_at(lattice->level, lattice->motion, lattice->at(unknown[i]),
                              lattice->windows, nullptr);
  });
  for (std::size_t i = 0; i < unknown.size(); ++i) lattice->known[unknown[i]] = found[i];
  std::vector<double> out;
  out.reserve(places.size());
  for (const Place& p : places) out.push_back(lattice->known.at(p));
  return out;
}

bool PlaneSearch::take_best(const std::vector<Place>& tried, Lattice* lattice, Place* best,
                            double* correlation) const {
  const std::vector<double> found = correlations(tried, lattice);
  const auto at =
      static_cast<std::size_t>(std::max_element(found.begin(), found.end()) - found.begin());
  if (tried.empty() || !(found[at] > *correlation)) return false;
  *correlation = found[at];
  *best = tried[at];
  return true;
}

PlaneSearch::Place PlaneSearch::bend(Lattice* lattice) const {
  constexpr int kSteps = 7, kCurvatures = 4;  // to each side
  Place best{};
  double correlation = correlations({best}, lattice).front();
  std::vector<Place> tried;
  for (int c = -kCurvatures; c <= kCurvatures; ++c) {
    for (int i = -kSteps; i <= kSteps; ++i) tried.push_back({2 * i, 2 * c, 0});
  }
  take_best(tried, lattice, &best, &correlation);
  return best;
}

void PlaneSearch::climb(int rounds, Lattice* lattice, Place* best, double* correlation) const {
  *correlation = correlations({*best}, lattice).front();
  for (int round = 0; round < rounds; ++round) {
    std::vector<Place> tried;
    const auto add = [&](int along, int curvature, int roll) {
      const Place p{(*best)[0] + along, (*best)[1] + curvature, (*best)[2] + roll};
      if (within(lattice->at(p))) tried.push_back(p);
    };
    for (const int i : {-4, -2, -1, 1, 2, 4}) add(i, 0, 0);
    // A road that bends up looks like a shorter baseline: both at once.
    for (const int i : {-2, -1, 1, 2}) {
      for (const int k : {-2, -1, 0, 1, 2}) add(2 * k, i, 0);
    }
    for (const int i : {-2, -1, 1, 2}) add(0, 0, i);
    if (!take_best(tried, lattice, best, correlation)) break;
  }
}

std::vector<RoadHypothesis> PlaneSearch::sweep(const MotionEstimate& motion) const {
  constexpr double kStep = 0.04;
  constexpr int kRolls = 2;  // to each side
  constexpr std::size_t kPeaks = 4;
  std::vector<RoadHypothesis> tried;
  for (int r = -kRolls; r <= kRolls; ++r) {
    for (double s = options_.least_log_baseline; s <= options_.greatest_log_baseline; s += kStep) {
      tried.push_back({s, 0.0, options_.max_roll * r / kRolls});
    }
  }
  const std::size_t count = tried.size() / (2 * kRolls + 1);
  const std::vector<double> swept = correlations(levels_.back(), motion, tried);
  struct Peak {
    double correlation;
    std::size_t at;
  };
  std::vector<Peak> best(count);
  for (std::size_t i = 0; i < tried.size(); ++i) {
    Peak& peak = best[i % count];
    if (i < count || swept[i] > peak.correlation) peak = {swept[i], i};
  }
  std::vector<Peak> peaks;
  for (std::size_t i = 0; i < count; ++i) {
    const bool rising = i == 0 || best[i].correlation >= best[i - 1].correlation;
    const bool falling = i + 1 == count || best[i].correlation > best[i + 1].correlation;
    if (rising && falling) peaks.push_back(best[i]);
  }
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const Peak& a, const Peak& b) { return a.correlation > b.correlation; });
  std::vector<RoadHypothesis> out;
  for (std::size_t i = 0; i < std::min(kPeaks, peaks.size()); ++i)
    out.push_back(tried[peaks[i].at]);
  return out;
}

PlaneSearchResult PlaneSearch::search(const MotionEstimate& motion) const {
  constexpr double kStep = 0.015;
  PlaneSearchResult out;
  out.half_width = options_.half_width;
  out.correlation = -1.0;
  std::vector<std::pair<double, RoadHypothesis>> ends;
  std::vector<RoadHypothesis> climbed;
  for (const RoadHypothesis& peak : sweep(motion)) {
    Lattice lattice(*this, levels_.back(), motion, peak, kStep, 1.0);
    for (Place place : {Place{}, bend(&lattice)}) {
      double correlation = 0.0;
      climb(3, &lattice, &place, &correlation);
      const RoadHypothesis h = lattice.at(place);
      const bool again = std::any_of(climbed.begin(), climbed.end(), [&](const RoadHypothesis& o) {
        return std::abs(o.log_baseline - h.log_baseline) < 2.0 * kStep &&
               std::abs(o.curvature - h.curvature) < 0.15 * options_.max_curvature &&
               std::abs(o.roll - h.roll) < 0.15 * options_.max_roll;
      });
      if (again) continue;
      climbed.push_back(h);
      ends.emplace_back(correlation, h);
    }
  }
  std::stable_sort(ends.begin(), ends.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  constexpr std::size_t kClimbed = 3;
  if (ends.size() > kClimbed) ends.resize(kClimbed);
  const auto climb_from = [&](const Level& level, int rounds, double along, double share,
                              RoadHypothesis* h, double* correlation) {
    Lattice lattice(*this, level, motion, *h, along, share);
    Place place{};
    climb(rounds, &lattice, &place, correlation);
    *h = lattice.at(place);
  };
  for (auto& [correlation, h] : ends) {
    climb_from(levels_[1], 3, 0.5 * kStep, 0.7, &h, &correlation);
    if (correlation > out.correlation) {
      out.correlation = correlation;
      out.best = h;
    }
  }
  std::stable_sort(ends.begin(), ends.end(),
                   [](const auto& a, const auto& b) { return a.first > b.first; });
  for (const auto& [correlation, h] : ends) {
    if (std::abs(h.log_baseline - out.best.log_baseline) > 0.1) {
      out.rival = std::max(out.rival, correlation);
      out.others.push_back(h);
    }
  }
  out.lead = out.correlation - out.rival;
  const Level& fine = levels_.front();
  climb_from(fine, 2, 0.25 * kStep, 0.5, &out.best, &out.correlation);
  out.correlation = correlation(motion, out.best, &out.samples);
  // How far the logarithm may go.
  constexpr double kLoss = 0.05, kFineStep = 0.02;
  constexpr int kFarthest = 8;
  std::vector<RoadHypothesis> around;
  for (int i = -kFarthest; i <= kFarthest; ++i) {
    around.push_back(out.best);
    around.back().log_baseline += i * kFineStep;
  }
  const std::vector<double> near = correlations(fine, motion, around);
  int low = kFarthest, high = kFarthest;
  const auto close = [&](int i) {
    return near[static_cast<std::size_t>(i)] > out.correlation - kLoss;
  };
  while (low > 0 && close(low - 1)) --low;
  while (high < 2 * kFarthest && close(high + 1)) ++high;
  out.interval = (high - low) * kFineStep;
  out.informative = out.correlation > options_.least_correlation &&
                    out.lead > options_.least_lead && out.samples > options_.least_samples &&
                    out.interval < options_.widest_interval;
  out.ambiguous = out.correlation > options_.road_correlation && out.lead <= options_.least_lead;
  return out;
}

Eigen::Vector3d road_normal(const Eigen::Vector3d& travel, double roll) {
  return RoadAxes(travel, roll).up;
}

double road_inverse_depth(const PinholeCamera& camera, const Eigen::Vector3d& travel,
                          const RoadHypothesis& hypothesis, const Eigen::Vector2d& pixel) {
  const RoadAxes axes(travel, hypothesis.roll);
  const Eigen::Vector3d ray = camera.ray(pixel);
  return inverse_depth_on(axes.ahead.dot(ray), axes.up.dot(ray), hypothesis.curvature);
}

}  // namespace camber
