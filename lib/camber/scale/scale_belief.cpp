#include "camber/scale/scale_belief.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <stdexcept>
#include <utility>

namespace camber {
namespace {

/// A value with its weight.
struct Node {
  double value, weight;
};

/// Standard deviations and weights that integrate a normal distribution (Gauss and Hermite, seven
/// nodes; Abramowitz and Stegun, table 25.10, times the square root of two).
constexpr std::array<Node, 7> kNormal = {{{-3.750439717725742, 0.000548268855972},
                                          {-2.366759410734541, 0.030757123967586},
                                          {-1.154405394739968, 0.240123178605013},
                                          {0.0, 0.457142857142857},
                                          {1.154405394739968, 0.240123178605013},
                                          {2.366759410734541, 0.030757123967586},
                                          {3.750439717725742, 0.000548268855972}}};

// Errors that sources share.
constexpr const char* kHeight = "height";
constexpr const char* kShape = "road_shape";
constexpr const char* kSizes = "size_population";

double log_student(double deviation, double sigma, double freedom) {
  const double z = deviation / sigma;
  if (!std::isfinite(freedom)) return -0.5 * z * z - std::log(sigma * std::sqrt(2.0 * M_PI));
  return std::lgamma(0.5 * (freedom + 1.0)) - std::lgamma(0.5 * freedom) -
         0.5 * std::log(freedom * M_PI) - std::log(sigma) -
         0.5 * (freedom + 1.0) * std::log1p(z * z / freedom);
}

/// Density of one source where its value is off by `deviation`.
double source_density(const ScaleEvidence& source, double deviation,
                      const ScaleBeliefNoise& noise) {
  // A distribution narrower than the grid would be missed by it.
  const double sigma = std::max(source.sigma, noise.step);
  return (1.0 - source.wrong_share) * std::exp(log_student(deviation, sigma, source.freedom)) +
         source.wrong_share / (2.0 * noise.reach);
}

bool is_shared(const ScaleEvidence& source, const char* error) {
  return std::find(source.shares.begin(), source.shares.end(), error) != source.shares.end();
}

/// How much of a change of the focal length's logarithm a source's scale follows: metres by the
/// camera's height do, since a wrong one stretches the road and the motion along the view and
/// leaves the height as it is; lengths along the road do not.
double by_focal_length(const ScaleEvidence& source, const ScaleBeliefNoise& noise) {
  if (source.cause == EvidenceCause::kVehicles) return noise.vehicles_by_focal_length;
  return source.cause == EvidenceCause::kHeight || source.cause == EvidenceCause::kLayer ? 1.0
                                                                                         : 0.0;
}

/// Whether a source measures the road that was found, or lengths that do not hang on it.
bool hangs_on_road(const ScaleEvidence& source) {
  return source.cause != EvidenceCause::kPoses && source.cause != EvidenceCause::kSpeed;
}

void check(const std::vector<ScaleEvidence>& evidence,
           const std::vector<ScaleAlternative>& alternatives, const ScaleBeliefNoise& noise) {
  if (!(noise.step > 0.0) || !(noise.reach >= 10.0 * noise.step)) {
    throw std::invalid_argument(
        "scale_belief: the grid's step must be > 0 and much below its reach");
  }
  for (const ScaleEvidence& e : evidence) {
    if (std::isnan(e.sigma)) continue;
    if (!(e.sigma >= 0.0) || !std::isfinite(e.log_scale) || !(e.freedom > 0.0) ||
        !(e.wrong_share >= 0.0) || !(e.wrong_share <= 1.0)) {
      throw std::invalid_argument(
          fmt::format("evidence {}: {} +- {}, {} degrees of freedom, wrong share {}", e.name,
                      e.log_scale, e.sigma, e.freedom, e.wrong_share));
    }
  }
  double sum = 0.0;
  for (const ScaleAlternative& a : alternatives) {
    if (!(a.weight >= 0.0) || !std::isfinite(a.log_scale)) {
      throw std::invalid_argument("an alternative's weight must be >= 0 and its scale finite");
    }
    sum += a.weight;
  }
  if (!alternatives.empty() && !(sum > 0.0)) {
    throw std::invalid_argument("the alternatives' weights must have a positive sum");
  }
}

/// The focal length's logarithm over the given one, with what the evidence knows of it.
std::vector<Node> focal_lengths(const std::vector<ScaleEvidence>& evidence,
                                const ScaleBeliefNoise& noise) {
  std::vector<Node> out = {{0.0, 1.0 - noise.wrong_focal_length}};
  constexpr int kEachSide = 20;
  const double step = 2.0 * noise.focal_length_spread / kEachSide;
  for (int i = -kEachSide; i <= kEachSide; ++i) {
    const double f = i * step;
    out.push_back({f, noise.wrong_focal_length * step *
                          std::exp(log_student(f, noise.focal_length_spread, INFINITY))});
  }
  for (Node& node : out) {
    for (const ScaleEvidence& e : evidence) {
      if (e.cause != EvidenceCause::kFocalLength || std::isnan(e.sigma)) continue;
      node.weight *= source_density(e, node.value - e.log_scale, noise);
    }
  }
  const double sum = std::accumulate(out.begin(), out.end(), 0.0,
                                     [](double s, const Node& n) { return s + n.weight; });
  std::vector<Node> likely;
  for (const Node& node : out) {
    if (node.weight > 1e-5 * sum) likely.push_back({node.value, node.weight / sum});
  }
  return likely;
}

/// The sources of the scale on a grid that reaches twice as far as the belief's to each side, so
/// that they can be shifted.
class Sources {
 public:
  Sources(const std::vector<ScaleEvidence>& evidence, const ScaleBeliefNoise& noise)
      : noise_(noise),
        half_(static_cast<int>(std::ceil(noise.reach / noise.step))),
        margin_(2 * half_) {
    for (const ScaleEvidence& e : evidence) {
      if (e.cause == EvidenceCause::kFocalLength || std::isnan(e.sigma)) continue;
      Source source{&e, by_focal_length(e, noise), {}};
      for (int i = -half_ - margin_; i <= half_ + margin_; ++i) {
        source.density.push_back(source_density(e, i * noise.step - e.log_scale, noise));
      }
      sources_.push_back(std::move(source));
    }
  }

  int points() const { return 2 * half_ + 1; }
  double first() const { return -half_ * noise_.step; }

  /// Adds weight times the product of the sources, given focal length and road shape, over the
  /// errors of the height and of the vehicles' sizes: no source has both.
  void add(const ScaleAlternative& road, double focal_length, double shape,
           const std::vector<Node>& heights, const std::vector<Node>& populations, double weight,
           std::vector<double>* sum) const {
    const auto given = [&](const char* error, double value) {
      std::vector<double> product(static_cast<std::size_t>(points()), 1.0);
      for (const Source& source : sources_) {
        const ScaleEvidence& e = *source.evidence;
        const bool has_height = is_shared(e, kHeight), has_sizes = is_shared(e, kSizes);
        if (error ? !is_shared(e, error) : has_height || has_sizes) continue;
        multiply(source, road, focal_length, shape, value, &product);
      }
      return product;
    };
    const auto mean = [&](const char* error, const std::vector<Node>& nodes) {
      std::vector<double> out(static_cast<std::size_t>(points()), 0.0);
      for (const Node& node : nodes) {
        const std::vector<double> product = given(error, node.value);
        for (std::size_t i = 0; i < out.size(); ++i) out[i] += node.weight * product[i];
      }
      return out;
    };
    const std::vector<double> by_height = mean(kHeight, heights),
                              by_sizes = mean(kSizes, populations), rest = given(nullptr, 0.0);
    for (std::size_t i = 0; i < rest.size(); ++i) {
      (*sum)[i] += weight * by_height[i] * by_sizes[i] * rest[i];
    }
  }

  bool any(const char* error) const {
    return std::any_of(sources_.begin(), sources_.end(),
                       [&](const Source& s) { return is_shared(*s.evidence, error); });
  }

  /// Cause of the source that a change of the scale from `mode` to `other` makes the least likely.
  std::optional<EvidenceCause> against(double mode, double other) const {
    std::optional<EvidenceCause> out;
    double least = 0.0;
    for (const Source& source : sources_) {
      const auto log_density = [&](double at) {
        return std::log(source_density(*source.evidence, at - source.evidence->log_scale, noise_));
      };
      const double change = log_density(other) - log_density(mode);
      if (change < least) {
        least = change;
        out = source.evidence->cause;
      }
    }
    return out;
  }

 private:
  struct Source {
    const ScaleEvidence* evidence;
    double by_focal_length;
    std::vector<double> density;
  };

  /// By one source's density, shifted as the errors have it.
  void multiply(const Source& source, const ScaleAlternative& road, double focal_length,
                double shape, double own_error, std::vector<double>* product) const {
    const ScaleEvidence& e = *source.evidence;
    if (!road.is_road && hangs_on_road(e)) {
      for (double& p : *product) p *= 1.0 / (2.0 * noise_.reach);
      return;
    }
    double shift = source.by_focal_length * focal_length + own_error;
    if (hangs_on_road(e)) shift += road.log_scale;
    if (is_shared(e, kShape)) shift += shape;
    const int by =
        std::clamp(static_cast<int>(std::lround(shift / noise_.step)), -margin_, margin_);
    const double* at = source.density.data() + (margin_ - by);
    for (std::size_t i = 0; i < product->size(); ++i) (*product)[i] *= at[i];
  }

  const ScaleBeliefNoise& noise_;
  int half_, margin_;  // points of the grid, to each side
  std::vector<Source> sources_;
};

/// Nodes of an error that sources share.
std::vector<Node> nodes(bool shared, double sigma) {
  if (!shared || !(sigma > 0.0)) return {{0.0, 1.0}};
  std::vector<Node> out;
  for (const Node& node : kNormal) out.push_back({sigma * node.value, node.weight});
  return out;
}

/// Where the density's integral reaches a share.
double quantile(const ScaleBelief& belief, double share) {
  double sum = 0.0;
  for (std::size_t i = 0; i < belief.density.size(); ++i) {
    const double more = belief.density[i] * belief.step;
    if (sum + more >= share) {
      const double part = more > 0.0 ? (share - sum) / more : 0.5;
      return belief.first + belief.step * (static_cast<double>(i) - 0.5 + part);
    }
    sum += more;
  }
  return belief.first + belief.step * static_cast<double>(belief.density.size() - 1);
}

/// The mode, and what lies beyond the valleys on its sides.
void find_modes(ScaleBelief* belief) {
  const std::vector<double>& p = belief->density;
  const auto at = [&](std::size_t i) {
    return belief->first + belief->step * static_cast<double>(i);
  };
  const auto mode = static_cast<std::size_t>(std::max_element(p.begin(), p.end()) - p.begin());
  belief->mode = belief->second_mode = at(mode);
  // Wiggles below a thousandth of the mode's density are of the nodes.
  const double flat = 1e-3 * p[mode];
  const auto valley = [&](int direction) {
    std::size_t lowest = mode, i = mode;
    while ((direction < 0 && i > 0) || (direction > 0 && i + 1 < p.size())) {
      i += static_cast<std::size_t>(direction);
      if (p[i] <= p[lowest]) lowest = i;
      if (p[i] > p[lowest] + flat) return lowest;
    }
    return i;  // none: the end
  };
  const std::size_t left = valley(-1), right = valley(1);
  double highest = 0.0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const bool beyond = (left > 0 && i < left) || (right + 1 < p.size() && i > right);
    if (!beyond) continue;
    belief->second_mass += p[i] * belief->step;
    if (p[i] > highest) {
      highest = p[i];
      belief->second_mode = at(i);
    }
  }
}

}  // namespace

std::vector<ScaleAlternative> scale_alternatives(double other_layer, double alternative_spread) {
  if (!(other_layer >= 0.0) || !(other_layer <= 1.0) || !(alternative_spread >= 0.0)) {
    throw std::invalid_argument(
        fmt::format("other layer {}, start spread {}: expected a probability and a spread >= 0",
                    other_layer, alternative_spread));
  }
  std::vector<ScaleAlternative> out;
  if (other_layer > 0.0) out.push_back({other_layer, 0.0, false});
  if (alternative_spread > 0.0) {
    // As well supported: as likely together.
    out.push_back({0.5 * (1.0 - other_layer), 0.0, true});
    for (const double side : {-1.0, 1.0}) {
      out.push_back({0.25 * (1.0 - other_layer), side * alternative_spread, true});
    }
  } else {
    out.push_back({1.0 - other_layer, 0.0, true});
  }
  return out;
}

double ScaleBelief::log_density(double log_scale) const {
  const double at =
      std::clamp((log_scale - first) / step, 0.0, static_cast<double>(density.size()) - 1.0);
  const auto i = std::min(static_cast<std::size_t>(at), density.size() - 2);
  const double part = at - static_cast<double>(i);
  return std::log((1.0 - part) * density[i] + part * density[i + 1]);
}

ScaleBelief scale_belief(const std::vector<ScaleEvidence>& evidence,
                         const std::vector<ScaleAlternative>& alternatives,
                         const ScaleBeliefNoise& noise) {
  check(evidence, alternatives, noise);
  const Sources sources(evidence, noise);
  const std::vector<ScaleAlternative> roads =
      alternatives.empty() ? std::vector<ScaleAlternative>{{}} : alternatives;
  ScaleBelief out;
  out.step = noise.step;
  out.first = sources.first();
  out.density.assign(static_cast<std::size_t>(sources.points()), 0.0);
  const std::vector<Node> focal = focal_lengths(evidence, noise);
  const std::vector<Node> heights = nodes(sources.any(kHeight), noise.height);
  const std::vector<Node> shapes = nodes(sources.any(kShape), noise.road_shape);
  const std::vector<Node> populations = nodes(sources.any(kSizes), noise.size_population);
  for (const ScaleAlternative& road : roads) {
    if (!(road.weight > 0.0)) continue;
    for (const Node& f : focal) {
      for (const Node& shape : shapes) {
        sources.add(road, f.value, shape.value, heights, populations,
                    road.weight * f.weight * shape.weight, &out.density);
      }
    }
  }
  const double sum = std::accumulate(out.density.begin(), out.density.end(), 0.0) * out.step;
  if (!(sum > 0.0)) {
    throw std::invalid_argument(
        "the evidence leaves no scale possible: a source must be wrong with "
        "some probability");
  }
  for (double& p : out.density) p /= sum;
  find_modes(&out);
  // Integrals of a normal distribution to one and two standard deviations.
  constexpr double kOne = 0.15865525393145707, kTwo = 0.022750131948179195;
  out.sigma = std::max(0.5 * (quantile(out, 1.0 - kOne) - quantile(out, kOne)),
                       0.25 * (quantile(out, 1.0 - kTwo) - quantile(out, kTwo)));
  if (out.second_mass > 0.0) out.cause = sources.against(out.mode, out.second_mode);
  return out;
}

}  // namespace camber
