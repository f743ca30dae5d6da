#include "camber/scale/detail/crossing_finder.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "camber/scale/detail/bar_finder.h"

namespace camber::detail {
namespace {

constexpr double kPeriodTolerance = 0.15;  // share of the period
constexpr double kGate = 3.0;              // standard deviations of the scale, beside it

class CrossingFinder {
 public:
  CrossingFinder(const GrayImage& image, const PinholeCamera& camera, const GroundRaster& ground,
                 const LaneMarkingSizes& sizes, double scale_sigma)
      : image_(image),
        camera_(camera),
        ground_(ground),
        period_(sizes.stripe_width + sizes.stripe_gap),
        tolerance_(kPeriodTolerance + kGate * scale_sigma),
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
    // Too fine to distinguish from other patterns, or wider than what is seen.
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

std::vector<PaintedCrossing> find_crossings(const GrayImage& image, const PinholeCamera& camera,
                                            const GroundRaster& ground,
                                            const LaneMarkingSizes& sizes, double scale_sigma,
                                            int num_threads) {
  return CrossingFinder(image, camera, ground, sizes, scale_sigma).find(num_threads);
}

}  // namespace camber::detail
