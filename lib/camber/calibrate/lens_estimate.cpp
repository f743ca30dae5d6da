#include "camber/calibrate/lens_estimate.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/median.h"
#include "camber/core/threads.h"

namespace camber {
namespace {

using Vector = DriveLens::Vector;
using Matrix = DriveLens::Matrix;

/// All windows with one lens.
class JointBundle {
 public:
  JointBundle(const LensPrior& prior, const LensEstimateOptions& options,
              std::vector<WindowBundle>* windows)
      : prior_(prior), options_(options), windows_(*windows) {
    loss_.width = options.loss_width;
    loss_.correlation = options.correlation;
  }

  /// @param tried  of the windows as they were tried, else as they are.
  double cost(const DriveLens& lens, bool tried = false) const {
    std::vector<double> costs(windows_.size());
    parallel_for(windows_.size(), options_.num_threads, [&](std::size_t w) {
      const WindowBundle& bundle = windows_[w];
      costs[w] = WindowBundle::cost(tried ? bundle.tried() : bundle.window(), lens, loss_);
    });
    double out = prior_cost(lens);
    for (const double c : costs) out += c;
    return out;
  }

  /// What the windows know of the lens, each by itself.
  std::vector<LensInformation> reduce(const DriveLens& lens, double damping) {
    std::vector<LensInformation> out(windows_.size());
    parallel_for(windows_.size(), options_.num_threads,
                 [&](std::size_t w) { out[w] = windows_[w].reduce(lens, loss_, damping); });
    return out;
  }

  /// @return the cost.
  /// @param settled  relative decrease of the cost in one step below which it ends.
  double minimise(DriveLens* lens, double settled) {
    constexpr int kMostIterations = 60;
    double damping = 1e-5, least = cost(*lens);
    for (int iteration = 0; iteration < kMostIterations; ++iteration) {
      bool better = false;
      double gain = 0.0;
      while (!better && damping < 1e8) {
        const Vector step = lens_step(*lens, damping);
        const DriveLens next = lens->with(lens->parameters() + step);
        parallel_for(windows_.size(), options_.num_threads,
                     [&](std::size_t w) { windows_[w].try_step(step); });
        const double now = cost(next, true);
        better = now < least;
        if (!better) {
          damping *= 8.0;
          continue;
        }
        gain = least - now;
        least = now;
        *lens = next;
        for (WindowBundle& bundle : windows_) bundle.accept();
        damping = std::max(1e-9, 0.1 * damping);
      }
      if (!better || gain < settled * least) break;
    }
    return least;
  }

  /// Noise of a coordinate, by the median of the errors' lengths (Rayleigh), with the freedom that
  /// poses and points have.
  double measure_noise(const DriveLens& lens) {
    std::vector<double> lengths;
    double unknowns = 0.0;
    for (const WindowBundle& bundle : windows_) {
      const CalibrationWindow& window = bundle.window();
      for (const Eigen::Vector2d& e : WindowBundle::errors(window, lens)) {
        if (e.allFinite()) lengths.push_back(e.norm());
      }
      unknowns += 3.0 * static_cast<double>(window.points.size()) +
                  6.0 * static_cast<double>(window.frame_from_reference.size()) - 7.0;
    }
    const double equations = 2.0 * static_cast<double>(lengths.size());
    constexpr double kSigmaFromMedianLength = 1.0 / 1.17741;
    const double freedom = std::sqrt(equations / std::max(0.2 * equations, equations - unknowns));
    loss_.pixel_sigma =
        std::max(options_.least_sigma, kSigmaFromMedianLength * upper_median(&lengths) * freedom);
    return loss_.pixel_sigma;
  }

  /// Leaves out tracks that do not stand still, or were lost on something else.
  void trim(const DriveLens& lens) {
    for (WindowBundle& bundle : windows_) {
      CalibrationWindow window = bundle.window();
      const std::vector<Eigen::Vector2d> errors = WindowBundle::errors(window, lens);
      std::vector<WindowPoint> kept;
      std::size_t at = 0;
      for (WindowPoint& point : window.points) {
        double worst = 0.0;
        for (std::size_t k = 0; k < point.seen.size(); ++k, ++at) {
          worst = std::max(worst, errors[at].allFinite() ? errors[at].norm() : 1e9);
        }
        if (worst < options_.trim * loss_.pixel_sigma) kept.push_back(std::move(point));
      }
      window.points = std::move(kept);
      bundle.set_window(std::move(window));
    }
  }

  void set_pixel_sigma(double sigma) { loss_.pixel_sigma = sigma; }
  double correlation() const { return loss_.correlation; }
  void widen(double factor) { loss_.correlation *= std::max(1.0, factor); }

 private:
  double prior_cost(const DriveLens& lens) const {
    return 0.5 * prior_error(prior_, lens).squaredNorm();
  }

  Vector lens_step(const DriveLens& lens, double damping) {
    Matrix information = prior_.sigma.array().square().inverse().matrix().asDiagonal();
    Vector gradient = prior_error(prior_, lens).cwiseQuotient(prior_.sigma);
    for (const LensInformation& part : reduce(lens, damping)) {
      information += part.information;
      gradient += part.gradient;
    }
    information.diagonal() *= 1.0 + damping;
    Vector step = -information.ldlt().solve(gradient);
    constexpr double kLongest = 0.2;  // of the focal length's logarithm and k1, in one step
    const double large = std::max({std::abs(step(0)), std::abs(step(3)), std::abs(step(4))});
    if (large > kLongest) step *= kLongest / large;
    return step;
  }

  LensPrior prior_;
  LensEstimateOptions options_;
  std::vector<WindowBundle>& windows_;
  BundleLoss loss_;
};

/// How much more the windows' scores spread than the curvature lets expect, in the mean over the
/// directions that the windows know better than the prior.
/// @param parts  of each window at the estimate.
double spread_of_scores(const LensPrior& prior, const std::vector<LensInformation>& parts) {
  const auto count = static_cast<double>(parts.size());
  if (count < 3.0) return 1.0;
  Matrix information = Matrix::Zero(), scores = Matrix::Zero();
  Vector mean = Vector::Zero();
  for (const LensInformation& part : parts) {
    information += part.information;
    mean += part.gradient / count;
  }
  for (const LensInformation& part : parts) {
    scores += (part.gradient - mean) * (part.gradient - mean).transpose();
  }
  scores *= count / (count - 1.0);
  const Matrix of_prior = prior.sigma.array().square().inverse().matrix().asDiagonal();
  const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix> solver(information, of_prior);
  double sum = 0.0;
  int directions = 0;
  for (int i = 0; i < DriveLens::kSize; ++i) {
    const Vector v = solver.eigenvectors().col(i);
    if (!(solver.eigenvalues()(i) > 1.0)) continue;
    sum += v.dot(scores * v) / v.dot(information * v);
    ++directions;
  }
  return directions > 0 ? sum / directions : 1.0;
}

Matrix covariance_of(const LensPrior& prior, const std::vector<LensInformation>& parts) {
  Matrix information = prior.sigma.array().square().inverse().matrix().asDiagonal();
  for (const LensInformation& part : parts) information += part.information;
  return information.inverse();
}

}  // namespace

DriveLens::Vector prior_error(const LensPrior& prior, const DriveLens& lens) {
  return (lens.parameters() - prior.mean.parameters()).cwiseQuotient(prior.sigma);
}

LensPrior lens_prior_of_cars(int width, int height) {
  if (width <= 0 || height <= 0) throw std::invalid_argument("the image has no size");
  constexpr double kFocal = 0.56, kFocalSigma = 0.49;  // widths; of the logarithm
  LensPrior out;
  out.mean.width = width;
  out.mean.height = height;
  out.mean.f = kFocal * width;
  out.mean.cx = 0.5 * (width - 1);
  out.mean.cy = 0.5 * (height - 1);
  constexpr double kMounted = 0.09;  // rad
  out.sigma << kFocalSigma, 0.025 * width, 0.025 * width, 0.2, 0.03, kMounted, kMounted;
  return out;
}

double LensEstimate::sigma(int parameter) const {
  return std::sqrt(covariance(parameter, parameter));
}

LensEstimate estimate_lens(const DriveLens& start, const LensPrior& prior,
                           const LensEstimateOptions& options, std::vector<WindowBundle>* windows) {
  if (windows->empty()) throw std::invalid_argument("there are no windows");
  JointBundle joint(prior, options, windows);
  LensEstimate out;
  out.lens = start;
  joint.set_pixel_sigma(std::max(1.0, joint.measure_noise(out.lens)));
  constexpr double kRough = 1e-4, kFine = 1e-6;
  joint.minimise(&out.lens, kRough);
  for (int round = 0; round < options.rounds; ++round) {
    joint.measure_noise(out.lens);
    if (round > 0) joint.trim(out.lens);
    joint.minimise(&out.lens, kRough);
  }
  out.pixel_sigma = joint.measure_noise(out.lens);
  out.cost = joint.minimise(&out.lens, options.rounds > 0 ? kFine : kRough);
  if (options.rounds > 0) {
    joint.widen(spread_of_scores(prior, joint.reduce(out.lens, 0.0)));
    out.cost = joint.minimise(&out.lens, kFine);
    // What contradicts the prior is less well known than it seems.
    constexpr double kPlausible = 9.0;  // squared standard deviations, of all parameters
    for (int round = 0; round < 3; ++round) {
      const double contradiction = prior_error(prior, out.lens).squaredNorm() / kPlausible;
      if (contradiction < 1.0) break;
      joint.widen(contradiction);
      out.cost = joint.minimise(&out.lens, kFine);
    }
  }
  for (const WindowBundle& bundle : *windows) {
    out.points += bundle.window().points.size();
    out.observations += bundle.observations();
  }
  out.inflation = joint.correlation();
  out.covariance = covariance_of(prior, joint.reduce(out.lens, 0.0));
  out.covariance(0, 0) += std::pow(options.focal_floor, 2);
  const double principal = std::pow(options.principal_floor * out.lens.width, 2);
  const double by_angle = 1.0 / (out.lens.f * out.lens.f);
  out.covariance(1, 1) += principal;
  out.covariance(2, 2) += principal;
  out.covariance(3, 3) += std::pow(options.distortion_floor, 2);
  // The direction of travel keeps its pixel.
  out.covariance(5, 5) += principal * by_angle;
  out.covariance(6, 6) += principal * by_angle;
  return out;
}

}  // namespace camber
