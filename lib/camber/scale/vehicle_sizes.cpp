#include "camber/scale/vehicle_sizes.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/scale/fusion.h"

namespace camber {
namespace {

/// The change of the logarithm of the scale of the largest likelihood.
struct Mode {
  double log_scale = 0.0;
  double log_likelihood = -std::numeric_limits<double>::infinity();
};

/// Student's distribution of `freedom` degrees of freedom about each measurement; with a prior
/// about no change of the given information (0: none).
class StudentLikelihood {
 public:
  StudentLikelihood(const std::vector<ImpliedLogScale>& scales, const ScaleNoise& noise)
      : scales_(scales),
        freedom_(noise.vehicle_size_freedom),
        variance_share_(noise.vehicle_size_spread * noise.vehicle_size_spread) {}

  Mode mode(double prior_information) const {
    // It may have several maxima: the measurements and no change are near the largest.
    Mode best = climbed(0.0, prior_information);
    for (const ImpliedLogScale& start : scales_) {
      const Mode other = climbed(start.mean, prior_information);
      if (other.log_likelihood > best.log_likelihood) best = other;
    }
    return best;
  }

  /// Fisher's information of one parameter of location (Lange, Little and Taylor 1989).
  double information() const {
    double out = 0.0;
    for (const ImpliedLogScale& s : scales_) out += 1.0 / (variance_share_ * s.variance);
    return (freedom_ + 1.0) / (freedom_ + 3.0) * out;
  }

 private:
  double squared(const ImpliedLogScale& s, double log_scale) const {
    return (s.mean - log_scale) * (s.mean - log_scale) / (variance_share_ * s.variance);
  }

  /// By expectation and maximisation: reweighted means.
  Mode climbed(double log_scale, double prior_information) const {
    constexpr int kIterations = 50;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      double sum = 0.0, information = prior_information;
      for (const ImpliedLogScale& s : scales_) {
        const double weight =
            (freedom_ + 1.0) / (freedom_ + squared(s, log_scale)) / (variance_share_ * s.variance);
        sum += weight * s.mean;
        information += weight;
      }
      log_scale = sum / information;
    }
    double log_likelihood = -0.5 * prior_information * log_scale * log_scale;
    for (const ImpliedLogScale& s : scales_) {
      log_likelihood -= 0.5 * (freedom_ + 1.0) * std::log1p(squared(s, log_scale) / freedom_);
    }
    return {log_scale, log_likelihood};
  }

  const std::vector<ImpliedLogScale>& scales_;
  double freedom_, variance_share_;
};

}  // namespace

std::optional<VehicleSizes> compare_vehicle_sizes(const RoadPosterior& road,
                                                  const std::vector<Constraint>& vehicles,
                                                  const ScaleNoise& noise) {
  std::vector<ImpliedLogScale> scales;
  for (const Constraint& vehicle : vehicles) {
    const auto scale = implied_log_scale(road, vehicle);
    if (scale) scales.push_back(*scale);
  }
  constexpr std::size_t kLeast = 2;  // one alone may be a van
  if (scales.size() < kLeast) return std::nullopt;
  const StudentLikelihood likelihood(scales, noise);
  const double common = noise.compared_population * noise.compared_population;
  const Mode best = likelihood.mode(0.0);
  const Mode right = likelihood.mode(1.0 / (common + std::pow(road.scale_sigma(), 2)));
  VehicleSizes out;
  out.vehicles = static_cast<int>(scales.size());
  out.log_scale = best.log_scale;
  out.sigma = std::sqrt(1.0 / likelihood.information() + common);
  out.sigmas_off = std::sqrt(2.0 * std::max(0.0, best.log_likelihood - right.log_likelihood));
  return out;
}

}  // namespace camber
