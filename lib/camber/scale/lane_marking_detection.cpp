#include "camber/scale/lane_marking_detection.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "camber/scale/detail/bar_finder.h"
#include "camber/scale/detail/crossing_finder.h"

namespace camber {
namespace {

using detail::Bar;
using detail::BarFinder;
using detail::find_bars;
using detail::kLeastContrast;

constexpr double kFarthest = 75.0;              // m
constexpr double kLengthTolerance = 1.0 / 6.0;  // share of a stroke's length
constexpr double kGate = 3.0;                   // standard deviations of the scale, beside it

/// A bar followed over rows, from below.
struct Trace {
  std::vector<int> rows;  // descending
  std::vector<double> columns;
  double noise = 0.0;  // of the bars, summed
};

/// Least-squares polynomial u(v) of a trace: a straight line, curved where there are many rows.
struct Curve {
  double v0 = 0.0, a = 0.0, b = 0.0, c = 0.0;
  double at(double v) const { return a + (v - v0) * (b + c * (v - v0)); }
  Eigen::Vector2d pixel(double v) const { return {at(v), v}; }
};

Curve fit_curve(const std::vector<int>& rows, const std::vector<double>& columns,
                std::size_t from) {
  Curve out;
  const std::size_t n = rows.size() - from;
  const int terms = n >= 8 ? 3 : 2;
  out.v0 = 0.5 * (rows[from] + rows.back());
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (std::size_t i = from; i < rows.size(); ++i) {
    const double t = rows[i] - out.v0;
    const Eigen::Vector3d basis(1.0, t, t * t);
    normal += basis * basis.transpose();
    right += basis * columns[i];
  }
  const Eigen::VectorXd x = normal.topLeftCorner(terms, terms).ldlt().solve(right.head(terms));
  out.a = x[0];
  out.b = x[1];
  out.c = terms == 3 ? x[2] : 0.0;
  return out;
}

class DashFinder {
 public:
  DashFinder(const GrayImage& image, const PinholeCamera& camera, const GroundRaster& ground,
             const Eigen::Vector3d& ahead, const LaneMarkingSizes& sizes, double scale_sigma)
      : camera_(camera),
        ground_(ground),
        right_(Eigen::Vector3d(0, 1, 0).cross(ahead).normalized()),
        sizes_(sizes),
        tolerance_(kLengthTolerance + kGate * scale_sigma),
        finder_(image, camera, ground, sizes.line_width) {}

  std::vector<PaintedDash> find(int num_threads) const {
    const std::vector<std::vector<Bar>> rows =
        find_bars(finder_, ground_.top, camera_.height, false, num_threads);
    std::vector<PaintedDash> out;
    for (const Trace& trace : follow(rows)) {
      if (const auto dash = measure(trace)) out.push_back(*dash);
    }
    std::sort(out.begin(), out.end(), [](const PaintedDash& a, const PaintedDash& b) {
      return a.centroid.y() > b.centroid.y();
    });
    return out;
  }

 private:
  std::optional<Eigen::Vector3d> point(double u, double v) const {
    const double rho =
        finder_.inverse_depth(static_cast<int>(std::lround(u)), static_cast<int>(std::lround(v)));
    if (!(rho > 1.0 / kFarthest)) return std::nullopt;
    return Eigen::Vector3d(camera_.ray({u, v}) / rho);
  }

  /// Columns by which a line along the road moves from one row to that above it.
  double slope(double u, double v) const {
    const auto a = point(u, v + 1), b = point(u, v - 1), c = point(u - 2, v), d = point(u + 2, v);
    if (!a || !b || !c || !d) return 0.0;
    const double by_row = 0.5 * (*b - *a).dot(right_), by_column = 0.25 * (*d - *c).dot(right_);
    return std::abs(by_column) > 1e-6 ? std::clamp(-by_row / by_column, -6.0, 6.0) : 0.0;
  }

  /// Columns to a metre sideways, times the metres that a row goes ahead.
  double sideways(double u, double v) const {
    const auto a = point(u, v + 1), b = point(u, v - 1);
    return a && b ? std::min(15.0, 0.5 * (*b - *a).norm() * camera_.fx / a->z()) : 0.0;
  }

  std::vector<Trace> follow(const std::vector<std::vector<Bar>>& rows) const {
    std::vector<Trace> active, done;
    for (int v = camera_.height - 1; v >= ground_.top; --v) {
      const std::vector<Bar>& row = rows[static_cast<std::size_t>(v - ground_.top)];
      std::vector<char> taken(row.size(), 0);
      std::vector<Trace> next;
      for (Trace& trace : active) {
        const int missed = trace.rows.back() - v - 1;
        const std::size_t n = trace.rows.size();
        double expected, reach;
        if (n >= 5) {
          expected = fit_curve(trace.rows, trace.columns, n > 12 ? n - 12 : 0).at(v);
          reach = 1.5;
        } else if (n >= 2) {
          expected = fit_curve(trace.rows, trace.columns, 0).at(v);
          reach = 2.0;
        } else {
          // Along the road, whose direction may differ by 0.3 rad from that ahead.
          const double u = trace.columns.back(), s = slope(u, trace.rows.back());
          expected = u + s * (missed + 1);
          reach = 1.5 + 0.2 * std::abs(s) + 0.3 * sideways(u, trace.rows.back());
        }
        std::size_t best = row.size();
        double least = reach;
        for (std::size_t k = 0; k < row.size(); ++k) {
          const double off = std::abs(row[k].u - expected);
          if (!taken[k] && off < least) {
            least = off;
            best = k;
          }
        }
        if (best < row.size()) {
          taken[best] = 1;
          trace.rows.push_back(v);
          trace.columns.push_back(row[best].u);
          trace.noise += row[best].noise;
          next.push_back(std::move(trace));
        } else if (missed < (n >= 8 ? 1 : 0)) {
          next.push_back(std::move(trace));
        } else if (n >= 2) {
          done.push_back(std::move(trace));
        }
      }
      for (std::size_t k = 0; k < row.size(); ++k) {
        if (!taken[k]) next.push_back({{v}, {row[k].u}, row[k].noise});
      }
      active = std::move(next);
    }
    for (Trace& trace : active) {
      if (trace.rows.size() >= 2) done.push_back(std::move(trace));
    }
    return done;
  }

  /// Whether a length measured on the ground may be that of a stroke: the ground's own error
  /// grows with distance.
  bool plausible(double metres, double depth, double slack) const {
    const double factor = 1.0 + tolerance_ + 0.012 * depth;
    return metres < sizes_.dash_length * factor + slack &&
           metres > sizes_.dash_length / factor - slack;
  }

  /// Ends and centroid of a trace, if it has the length of a stroke and ends in view.
  std::optional<PaintedDash> measure(const Trace& trace) const {
    const double noise = trace.noise / static_cast<double>(trace.rows.size());
    const Curve curve = fit_curve(trace.rows, trace.columns, 0);
    const int near_row = trace.rows.front(), far_row = trace.rows.back();
    const auto near = point(curve.at(near_row + 0.5), near_row + 0.5);
    const auto far = point(curve.at(far_row - 0.5), far_row - 0.5);
    if (!near || !far) return std::nullopt;
    const int seen = near_row - far_row + 1;
    const double metres = (*far - *near).norm(), per_row = metres / seen;
    const double gap_rows = std::min(sizes_.dash_gap / per_row, 1e3);
    if (gap_rows < 2.0) return std::nullopt;  // strokes run into each other
    if (!plausible(metres, near->z(), 1.5 * per_row)) return std::nullopt;
    // Contrast along the line, with a margin into the gaps.
    const int margin = std::clamp(static_cast<int>(std::floor(0.4 * gap_rows)), 1, 2);
    std::vector<double> profile;
    const int first = near_row + margin, last = far_row - margin;
    for (int v = first; v >= last; --v) {
      const double u = curve.at(v);
      const int at_u = static_cast<int>(std::lround(u));
      if (!finder_.visible(at_u, v)) return std::nullopt;  // cut by something, or by the image
      const double rho = finder_.inverse_depth(at_u, v);
      if (!(rho > 1.0 / kFarthest)) return std::nullopt;
      const float c = finder_.contrast(finder_.sums(v), u, finder_.width_px(rho));
      if (!std::isfinite(c)) return std::nullopt;
      profile.push_back(c);
    }
    // Between the bars the contrast over the brighter side is a little below zero.
    double ground = 0.0;
    for (int k = 0; k < margin; ++k) {
      ground += profile[static_cast<std::size_t>(k)] + profile[profile.size() - 1 - k];
    }
    ground = std::clamp(ground / (2.0 * margin), -3.0 * noise, 3.0 * noise);
    double full = 0.0;
    for (const double c : profile) full = std::max(full, c - ground);
    if (seen >= 4) {  // the mean of what lies well inside
      full = 0.0;
      for (int v = near_row - 1; v > far_row; --v) {
        full += profile[static_cast<std::size_t>(first - v)] - ground;
      }
      full /= seen - 2;
    }
    // Among so many places two or three rows that stand out a little are chance.
    if (full < std::max<double>(kLeastContrast, (seen < 4 ? 5.5 : 4.0) * noise))
      return std::nullopt;
    double mass = 0.0, moment = 0.0;
    for (std::size_t k = 0; k < profile.size(); ++k) {
      const double c = std::clamp(profile[k] - ground, 0.0, full);
      mass += c;
      moment += c * (first - static_cast<double>(k));
    }
    // No paint halfway into the gaps, as far as they are seen: else it is a piece of a longer
    // line.
    for (const int step : {1, -1}) {
      const int from = step > 0 ? first + 1 : last - 1;
      for (int k = 0; k < std::min(15, static_cast<int>(0.5 * gap_rows) - margin); ++k) {
        const int v = from + step * k, u = static_cast<int>(std::lround(curve.at(v)));
        if (!finder_.visible(u, v)) break;
        const double rho = finder_.inverse_depth(u, v);
        if (!(rho > 1.0 / kFarthest)) break;
        const float c = finder_.contrast(finder_.sums(v), curve.at(v), finder_.width_px(rho));
        if (!std::isfinite(c)) break;
        if (c - ground > 0.5 * full) return std::nullopt;
      }
    }
    PaintedDash out;
    out.rows = seen;
    const double rows = mass / full;
    double centre = moment / mass;
    double near_v = centre + 0.5 * rows, far_v = centre - 0.5 * rows;
    const double n = static_cast<double>(profile.size());
    out.sigma = std::hypot(0.12, noise / full * std::sqrt(n * n * n / 12.0) / rows);
    if (seen >= 5) {
      // Where the contrast falls below half, from inside outwards.
      const auto crossing = [&](int from, int step) -> std::optional<double> {
        for (int v = from; v - step <= first && v - step >= last; v -= step) {
          const double a = profile[static_cast<std::size_t>(first - v)] - ground;
          const double b = profile[static_cast<std::size_t>(first - (v - step))] - ground;
          if (b < 0.5 * full) return v - step * (a - 0.5 * full) / std::max(a - b, 1e-6);
        }
        return std::nullopt;
      };
      const auto low = crossing(near_row - 1, -1), high = crossing(far_row + 1, 1);
      if (!low || !high) return std::nullopt;
      near_v = *low;
      far_v = *high;
      centre = 0.5 * (near_v + far_v);
      out.sigma = 0.2;
    }
    out.near_end = curve.pixel(near_v);
    out.far_end = curve.pixel(far_v);
    out.centroid = curve.pixel(centre);
    const auto a = point(out.near_end.x(), near_v), b = point(out.far_end.x(), far_v);
    if (!a || !b) return std::nullopt;
    const double length = (*b - *a).norm();
    if (!plausible(length, a->z(), (seen >= 5 ? 0.5 : 1.2) * per_row)) return std::nullopt;
    return out;
  }

  const PinholeCamera& camera_;
  const GroundRaster& ground_;
  Eigen::Vector3d right_;
  LaneMarkingSizes sizes_;
  double tolerance_;
  BarFinder finder_;
};

}  // namespace

LaneMarkings detect_lane_markings(const GrayImage& image, const PinholeCamera& camera,
                                  const GroundRaster& ground, const Eigen::Vector3d& ahead,
                                  const LaneMarkingSizes& sizes, double scale_sigma,
                                  int num_threads) {
  const int rows = camera.height - ground.top;
  const std::size_t size =
      rows > 0 ? static_cast<std::size_t>(rows) * static_cast<std::size_t>(camera.width) : 0;
  if (image.width != camera.width || image.height != camera.height ||
      ground.inverse_depth.size() != size || ground.visible.size() != size) {
    throw std::invalid_argument(
        "lane markings: the image, its camera and the ground differ in size");
  }
  LaneMarkings out;
  if (sizes.dashes()) {
    out.dashes = DashFinder(image, camera, ground, ahead, sizes, scale_sigma).find(num_threads);
  }
  if (sizes.stripes()) {
    out.crossings = detail::find_crossings(image, camera, ground, sizes, scale_sigma, num_threads);
  }
  return out;
}

}  // namespace camber
