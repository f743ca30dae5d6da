#include "camber/scale/lane_marking_detection.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "camber/core/threads.h"

namespace camber {
namespace {

constexpr double kNearest = 2.0, kFarthest = 75.0;  // m
constexpr double kWidest = 15.0;                    // m to each side
constexpr float kLeastContrast = 8.0F;              // intensities

struct Bar {
  float u = 0.0F;         // middle, px
  float contrast = 0.0F;  // over the brighter side, intensities
  float noise = 0.0F;     // standard deviation of contrasts around it
};

/// Bars of one width, row by row.
class BarFinder {
 public:
  BarFinder(const GrayImage& image, const PinholeCamera& camera, const GroundRaster& ground,
            double width)
      : image_(image), camera_(camera), ground_(ground), width_(width) {}

  /// Running sums of one row.
  std::vector<float> sums(int v) const {
    std::vector<float> out(static_cast<std::size_t>(image_.width) + 1);
    const std::uint8_t* row = image_.row(v);
    float sum = 0.0F;
    for (int u = 0; u < image_.width; ++u) {
      out[static_cast<std::size_t>(u)] = sum;
      sum += row[u];
    }
    out.back() = sum;
    return out;
  }

  double inverse_depth(int u, int v) const {
    if (v < ground_.top || v >= camera_.height || u < 0 || u >= camera_.width) return 0.0;
    return ground_.inverse_depth[index(u, v)];
  }

  bool visible(int u, int v) const {
    if (v < ground_.top || v >= camera_.height || u < 0 || u >= camera_.width) return false;
    return ground_.visible[index(u, v)] != 0;
  }

  double width_px(double rho) const { return std::max(1.2, width_ * camera_.fx * rho); }

  /// Contrast of a bar centred on u against the brighter of its sides; NaN beyond the image.
  float contrast(const std::vector<float>& sum, double u, double bar) const {
    const double half = 0.5 * bar, gap = half + 0.75, side = std::max(1.5, 0.75 * bar);
    if (u - gap - side < 0 || u + gap + side > image_.width - 1) {
      return std::numeric_limits<float>::quiet_NaN();
    }
    const double middle = mean(sum, u - half, u + half);
    const double left = mean(sum, u - gap - side, u - gap);
    const double right = mean(sum, u + gap, u + gap + side);
    return static_cast<float>(middle - std::max(left, right));
  }

  /// Local maxima of the contrast in one row that stand out of the texture around them; of many
  /// bars side by side, which are their own texture, all.
  std::vector<Bar> row(int v, bool repeated) const {
    const std::vector<float> sum = sums(v);
    std::vector<float> contrasts(static_cast<std::size_t>(image_.width),
                                 std::numeric_limits<float>::quiet_NaN());
    for (int u = 0; u < image_.width; ++u) {
      const double rho = inverse_depth(u, v);
      if (rho > 1.0 / kFarthest && rho < 1.0 / kNearest && visible(u, v) &&
          std::abs(u - camera_.cx) < kWidest * camera_.fx * rho) {
        contrasts[static_cast<std::size_t>(u)] = contrast(sum, u, width_px(rho));
      }
    }
    std::vector<Bar> out;
    std::vector<float> around;
    for (std::size_t u = 1; u + 1 < contrasts.size(); ++u) {
      const float before = contrasts[u - 1], here = contrasts[u], next = contrasts[u + 1];
      if (!(here >= kLeastContrast && here > before && here >= next)) continue;
      // The spread of contrasts within two metres of the quieter side: on the other may be a car.
      const double reach = std::max(16.0, 2.0 * camera_.fx * inverse_depth(static_cast<int>(u), v));
      const auto step = static_cast<int>(std::max(1.0, reach / 40.0));
      // A bar's own edges reach into the contrasts beside it.
      const int flank = 2 + static_cast<int>(2.0 * width_px(inverse_depth(static_cast<int>(u), v)));
      float noise = std::numeric_limits<float>::infinity();
      for (const int side : {-1, 1}) {
        around.clear();
        for (int k = flank; k <= static_cast<int>(reach); k += step) {
          const int x = static_cast<int>(u) + side * k;
          if (x < 0 || x >= image_.width) break;
          const float c = contrasts[static_cast<std::size_t>(x)];
          if (std::isfinite(c)) around.push_back(c);
        }
        if (around.size() < 8) continue;
        const auto at = [&](double share) {
          const auto k =
              static_cast<std::ptrdiff_t>(share * static_cast<double>(around.size() - 1));
          std::nth_element(around.begin(), around.begin() + k, around.end());
          return around[static_cast<std::size_t>(k)];
        };
        noise = std::min(noise, std::max(1.0F, (at(0.75) - at(0.25)) / 1.35F));
      }
      if (here < (repeated ? 2.0F * kLeastContrast : 3.5F * noise)) continue;
      const float bend = before - 2.0F * here + next;
      const float shift = bend < 0 ? std::clamp(0.5F * (before - next) / bend, -0.5F, 0.5F) : 0.0F;
      out.push_back({static_cast<float>(u) + shift, here, noise});
    }
    return out;
  }

 private:
  std::size_t index(int u, int v) const {
    return static_cast<std::size_t>(v - ground_.top) * static_cast<std::size_t>(camera_.width) +
           static_cast<std::size_t>(u);
  }
  /// Mean intensity between two columns, pixel u covering [u - 0.5, u + 0.5].
  static double mean(const std::vector<float>& sum, double from, double to) {
    const auto upto = [&](double x) {
      const double y = std::clamp(x + 0.5, 0.0, static_cast<double>(sum.size() - 1));
      const auto i = std::min(static_cast<std::size_t>(y), sum.size() - 2);
      const double f = y - static_cast<double>(i);
      return (1.0 - f) * sum[i] + f * sum[i + 1];
    };
    return (upto(to) - upto(from)) / (to - from);
  }

  const GrayImage& image_;
  const PinholeCamera& camera_;
  const GroundRaster& ground_;
  double width_;
};

std::vector<std::vector<Bar>> find_bars(const BarFinder& finder, int top, int height, bool repeated,
                                        int num_threads) {
  const auto rows = static_cast<std::size_t>(std::max(0, height - top));
  std::vector<std::vector<Bar>> out(rows);
  parallel_for((rows + 15) / 16, num_threads, [&](std::size_t band) {
    for (std::size_t k = 16 * band; k < std::min(rows, 16 * (band + 1)); ++k) {
      out[k] = finder.row(top + static_cast<int>(k), repeated);
    }
  });
  return out;
}

/// A bar followed over rows, from below.
struct Trace {
  std::vector<int> rows;  // descending
  std::vector<double> columns;
  double noise = 0.0;  // of the bars, summed
};

/// Least-squares polynomial u(v) of a trace: a straight line, bent where many rows tell.
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
        tolerance_(1.0 / 6.0 + 3.0 * scale_sigma),
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

class CrossingFinder {
 public:
  CrossingFinder(const GrayImage& image, const PinholeCamera& camera, const GroundRaster& ground,
                 const LaneMarkingSizes& sizes, double scale_sigma)
      : image_(image),
        camera_(camera),
        ground_(ground),
        period_(sizes.stripe_width + sizes.stripe_gap),
        tolerance_(0.15 + 3.0 * scale_sigma),
        finder_(image, camera, ground, sizes.stripe_width) {}

  std::vector<PaintedCrossing> find(int num_threads) const {
    const std::vector<std::vector<Bar>> rows =
        find_bars(finder_, ground_.top, camera_.height, true, num_threads);
    std::vector<Run> runs(rows.size());
    for (std::size_t k = 0; k < rows.size(); ++k) {
      runs[k] = longest_run(rows[k], ground_.top + static_cast<int>(k));
    }
    std::vector<PaintedCrossing> out;
    std::size_t k = 0;
    while (k < runs.size()) {
      if (runs[k].columns.size() < 3) {
        ++k;
        continue;
      }
      std::size_t end = k;
      while (end < runs.size() && runs[end].columns.size() >= 3) ++end;
      if (const auto crossing = join(runs, k, end)) out.push_back(*crossing);
      k = end;
    }
    std::sort(out.begin(), out.end(), [](const PaintedCrossing& a, const PaintedCrossing& b) {
      return a.first.y() > b.first.y();
    });
    return out;
  }

 private:
  struct Run {
    std::vector<double> columns;  // ascending
    std::vector<double> widths;   // periods
    std::vector<int> numbers;     // of the stripes, from 0
  };

  /// A stripe in a row: its middle between the half levels of its edges, px, and width, periods.
  struct Stripe {
    double column, width;
  };

  std::optional<Stripe> stripe_at(int v, double u) const {
    const int c = static_cast<int>(std::lround(u));
    const double rho = finder_.inverse_depth(c, v);
    if (!(rho > 0)) return std::nullopt;
    const double px = period_ * camera_.fx * rho;
    // Too fine to tell from other patterns, or wider than what is seen.
    if (px < 8.0 || px > image_.width) return std::nullopt;
    const std::uint8_t* row = image_.row(v);
    const int reach = static_cast<int>(std::lround(0.45 * px));
    if (c - reach < 4 || c + reach > image_.width - 6) return std::nullopt;
    // The steepest rise to one side and fall to the other, each to a fraction of a pixel.
    const auto edge = [&](int from, int to, double sign) -> std::optional<double> {
      int best = from;
      const auto step = [&](int x) {
        return sign * (row[x + 2] + row[x + 1] - row[x] - row[x - 1]);
      };
      for (int x = from; x <= to; ++x) {
        if (step(x) > step(best)) best = x;
      }
      if (!(step(best) > 2.0 * kLeastContrast)) return std::nullopt;
      double sum = 0.0, moment = 0.0;
      for (int x = best - 2; x <= best + 2; ++x) {
        const double weight = std::max(0.0, static_cast<double>(step(x)));
        sum += weight;
        moment += weight * (x + 0.5);
      }
      return moment / sum;
    };
    const auto left = edge(c - reach, c - 1, 1.0), right = edge(c, c + reach, -1.0);
    if (!left || !right) return std::nullopt;
    const double width = (*right - *left) / px;
    if (width < 0.3 || width > 0.7) return std::nullopt;
    return Stripe{0.5 * (*left + *right), width};
  }

  /// Drops outer stripes of another width: those that touch an edge line or are partly hidden.
  static void trim(Run* run) {
    if (run->columns.size() < 4) return;
    std::vector<double> sorted = run->widths;
    std::sort(sorted.begin(), sorted.end());
    const double median = sorted[sorted.size() / 2];
    const auto other = [&](double width) { return std::abs(width / median - 1.0) > 0.2; };
    std::size_t begin = 0, end = run->columns.size();
    while (begin < end && other(run->widths[begin])) ++begin;
    while (end > begin && other(run->widths[end - 1])) --end;
    const auto cut = [&](auto* values) {
      values->erase(values->begin() + static_cast<std::ptrdiff_t>(end), values->end());
      values->erase(values->begin(), values->begin() + static_cast<std::ptrdiff_t>(begin));
    };
    cut(&run->columns);
    cut(&run->widths);
    cut(&run->numbers);
    const int first = run->numbers.empty() ? 0 : run->numbers.front();
    for (int& number : run->numbers) number -= first;
  }

  Run longest_run(const std::vector<Bar>& bars, int v) const {
    Run best, run;
    const auto finish = [&] {
      trim(&run);
      if (run.columns.size() > best.columns.size()) best = run;
      run = {};
    };
    float strongest = 0.0F;
    for (const Bar& bar : bars) strongest = std::max(strongest, bar.contrast);
    for (const Bar& bar : bars) {
      if (bar.contrast < 0.35F * strongest) continue;
      const auto stripe = stripe_at(v, bar.u);
      if (!stripe) continue;
      const double u = stripe->column;
      if (!run.columns.empty()) {
        const double rho =
            finder_.inverse_depth(static_cast<int>(std::lround(0.5 * (u + run.columns.back()))), v);
        const double steps = (u - run.columns.back()) / (period_ * camera_.fx * rho);
        const int whole = static_cast<int>(std::lround(steps));
        // A row cuts slanted stripes farther apart than they are.
        if (whole < 1 || whole > 3 || std::abs(steps / whole - 1.0) > tolerance_) {
          if (steps < 0.5) continue;
          finish();
        } else {
          run.numbers.push_back(run.numbers.back() + whole);
          run.columns.push_back(u);
          run.widths.push_back(stripe->width);
          continue;
        }
      }
      run.columns.push_back(u);
      run.widths.push_back(stripe->width);
      run.numbers.push_back(0);
    }
    finish();
    return best;
  }

  /// Whether the stripes lie where a row would cut equal ones: a homography of their numbers, here
  /// to second order.
  bool even(const Run& run) const {
    const auto n = static_cast<Eigen::Index>(run.columns.size());
    const Eigen::Index terms = n >= 5 ? 3 : 2;
    Eigen::MatrixXd a(n, terms);
    Eigen::VectorXd b(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const double number = run.numbers[static_cast<std::size_t>(i)];
      for (Eigen::Index k = 0; k < terms; ++k) a(i, k) = std::pow(number, static_cast<double>(k));
      b[i] = run.columns[static_cast<std::size_t>(i)];
    }
    const Eigen::VectorXd x = (a.transpose() * a).ldlt().solve(a.transpose() * b);
    const double rms = std::sqrt((a * x - b).squaredNorm() / static_cast<double>(n - terms));
    const double period = (run.columns.back() - run.columns.front()) / run.numbers.back();
    return rms < 0.06 * period;
  }

  /// Stripes as a pattern on the ground: number = by_place . (1, x, y) at a place (x, y) of the
  /// ground's frame, whose first axis joins the stripes of one row.
  struct StripePattern {
    Eigen::Matrix3d frame;     ///< camera to ground, rows are its axes
    Eigen::Vector3d by_place;  ///< stripes, stripes a metre, stripes a metre
    double angle_sigma = 0.0;  ///< rad, of the stripes' direction on the ground
    double misfit = 0.0;       ///< periods, root mean square of a stripe off its place
  };

  Eigen::Vector3d ground_point(double u, double v) const {
    const double rho =
        finder_.inverse_depth(static_cast<int>(std::lround(u)), static_cast<int>(std::lround(v)));
    return rho > 0.0 ? Eigen::Vector3d(camera_.ray({u, v}) / rho) : Eigen::Vector3d::Zero();
  }

  /// The pattern of all rows of a crossing, from the chosen one outwards: each row's stripes take
  /// the numbers that those before it let expect.
  std::optional<StripePattern> fit_pattern(const std::vector<Run>& runs, std::size_t from,
                                           std::size_t to, std::size_t chosen) const {
    const auto row_of = [&](std::size_t k) { return ground_.top + static_cast<double>(k); };
    const Run& middle = runs[chosen];
    const double v = row_of(chosen);
    const Eigen::Vector3d first = ground_point(middle.columns.front(), v);
    const Eigen::Vector3d across = ground_point(middle.columns.back(), v) - first;
    const Eigen::Vector3d ahead =
        ground_point(middle.columns.front(), v - 1) - ground_point(middle.columns.front(), v + 1);
    if (!(across.cross(ahead).norm() > 0.0)) return std::nullopt;
    StripePattern out;
    out.frame.row(0) = across.normalized();
    out.frame.row(2) = across.cross(ahead).normalized();
    out.frame.row(1) = out.frame.row(2).transpose().cross(out.frame.row(0).transpose());
    // Sums of the fit; the direction along the stripes is at first only known to lie ahead.
    constexpr double kUnknownSlope = 1.0;  // stripes a metre
    Eigen::Matrix3d normal =
        Eigen::Vector3d(1e-9, 1e-9, 1.0 / (kUnknownSlope * kUnknownSlope)).asDiagonal();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    double square = 0.0;
    int rows = 0, count = 0;
    const auto take = [&](std::size_t k) {
      const Run& run = runs[k];
      if (run.columns.size() < 3) return false;
      std::vector<Eigen::Vector3d> places;
      double offset = 0.0;
      for (std::size_t i = 0; i < run.columns.size(); ++i) {
        const Eigen::Vector3d p = out.frame * (ground_point(run.columns[i], row_of(k)) - first);
        places.emplace_back(1.0, p.x(), p.y());
        offset += out.by_place.dot(places.back()) - run.numbers[i];
      }
      offset /= static_cast<double>(run.columns.size());
      const double whole = rows == 0 ? 0.0 : std::round(offset);
      constexpr double kSameStripes = 0.3;  // of a period
      if (rows > 0 && std::abs(offset - whole) > kSameStripes) return false;
      for (std::size_t i = 0; i < places.size(); ++i) {
        const double number = run.numbers[i] + whole;
        normal += places[i] * places[i].transpose();
        right += number * places[i];
        square += number * number;
      }
      ++rows;
      count += static_cast<int>(places.size());
      out.by_place = normal.ldlt().solve(right);
      return true;
    };
    out.by_place.setZero();
    take(chosen);
    for (std::size_t k = chosen + 1; k < to && take(k); ++k) {
    }
    for (std::size_t k = chosen; k > from && take(k - 1); --k) {
    }
    if (rows < 3) return std::nullopt;
    const double misfit = std::max(0.0, square - right.dot(out.by_place)) / std::max(1, count - 3);
    out.misfit = std::sqrt(misfit);
    // A stripe's middle is off by the same in neighbouring rows.
    constexpr double kRowsWithOneError = 4.0;
    const Eigen::Matrix3d covariance = kRowsWithOneError * misfit * normal.inverse();
    const double squared = out.by_place.tail<2>().squaredNorm();
    if (!(squared > 0.0)) return std::nullopt;
    const Eigen::Vector2d turn = Eigen::Vector2d(-out.by_place.z(), out.by_place.y()) / squared;
    out.angle_sigma = std::sqrt(turn.dot(covariance.bottomRightCorner<2, 2>() * turn));
    return out;
  }

  /// One measurement from the rows of a crossing: that with most stripes, of several the middle
  /// one.
  std::optional<PaintedCrossing> join(const std::vector<Run>& runs, std::size_t from,
                                      std::size_t to) const {
    if (to - from < 3) return std::nullopt;
    std::size_t most = 0;
    for (std::size_t k = from; k < to; ++k) {
      if (runs[k].columns.size() >= 4 && even(runs[k])) {
        most = std::max(most, runs[k].columns.size());
      }
    }
    if (most == 0) return std::nullopt;
    std::vector<std::size_t> full;
    for (std::size_t k = from; k < to; ++k) {
      if (runs[k].columns.size() == most && even(runs[k])) full.push_back(k);
    }
    const std::size_t chosen = full[full.size() / 2];
    const Run& run = runs[chosen];
    const double v = ground_.top + static_cast<double>(chosen);
    const auto pattern = fit_pattern(runs, from, to, chosen);
    constexpr double kMostMisfit = 0.1;  // periods; beyond it, not all stripes are of one crossing
    if (!pattern || pattern->misfit > kMostMisfit) return std::nullopt;
    PaintedCrossing out;
    out.first = {run.columns.front(), v};
    out.last = {run.columns.back(), v};
    const Eigen::Vector3d on_stripe =
        pattern->frame.transpose() *
        Eigen::Vector3d(-pattern->by_place.z(), pattern->by_place.y(), 0);
    const Eigen::Vector3d along =
        ground_point(run.columns.front(), v) + 0.5 * on_stripe.normalized();
    const auto along_pixel = camera_.project(along);
    if (!along_pixel) return std::nullopt;
    out.along = *along_pixel;
    out.angle_sigma = pattern->angle_sigma;
    out.stripes = run.numbers.back() + 1;
    const double period_px = (run.columns.back() - run.columns.front()) / run.numbers.back();
    out.sigma = std::max(0.25, pattern->misfit * period_px);
    return out;
  }

  const GrayImage& image_;
  const PinholeCamera& camera_;
  const GroundRaster& ground_;
  double period_, tolerance_;
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
    out.crossings = CrossingFinder(image, camera, ground, sizes, scale_sigma).find(num_threads);
  }
  return out;
}

}  // namespace camber
