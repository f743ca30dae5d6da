#include "camber/plane/fit_plane.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <stdexcept>

#include "camber/plane/detail/cloud_passes.h"
#include "camber/plane/detail/local_noise.h"
#include "camber/plane/detail/plane_coverage.h"
#include "camber/plane/detail/plane_hypotheses.h"
#include "camber/plane/detail/repeated_values.h"
#include "camber/plane/noise_model.h"
#include "camber/plane/plane_covariance.h"

namespace camber {
namespace {

using Eigen::Vector3d;
namespace kernels = plane_kernels;

using detail::PlaneHypotheses;
using detail::PlaneSample;
using detail::PointColumns;

constexpr double kFloatRounding = 4e-7;      // of the spread, in sums of coordinates
constexpr std::size_t kManyPasses = 262144;  // up to it all points are iterated to convergence

/// Everything about one fit.
class Fitter {
 public:
  /// @param shared     m, standard deviation of an error that all points may share
  /// @param may_round  equal steps among the coordinates come from rounding
  Fitter(const PointColumns& source, const PlaneFitOptions& options, double shared = 0.0,
         bool may_round = true)
      : source_(source),
        options_(options),
        up_(options.up.normalized()),
        shared_(shared),
        may_round_(may_round) {}

  PlaneFit run();

  /// After run(): there is no plane since more points leave any than lie on it.
  bool bends() const { return bends_; }
  /// After run(): the plane runs through several of the steps that were taken for rounding, and the
  /// points lie on it as none do that were rounded.
  bool steps_are_exact() const { return steps_are_exact_; }
  double spread() const { return sample_.spread; }  ///< m, of the points
  /// After run() with a threshold: m, of the points about their neighbourhoods' planes.
  double local_noise() const { return local_noise_; }
  /// m, inlier threshold of the noise; 0 where the points state their own.
  double threshold() const {
    return noise_.kind == NoiseKind::kSame ? kInlierSigmas * noise_.scale : 0.0;
  }

 private:
  void find_steps();
  void choose_noise();
  void learn_noise(NoiseModel* model) const;
  PlaneCandidate choose_candidate(std::vector<PlaneCandidate>* candidates);
  void relearn_power_law(PointArrays* points, PlaneCandidate* candidate) const;
  kernels::Moments refine_on_all(double inlier_share, PlaneCandidate* candidate,
                                 PlaneFit* fit) const;
  kernels::Moments all_moments(const PlaneCandidate& candidate, bool finish, double inlier_share,
                               PlaneFit* fit) const;
  std::size_t few_places(const PlaneCandidate& candidate) const;
  void describe(const PlaneCandidate& candidate, const kernels::Moments& full,
                kernels::Moments influence, PlaneFit* fit);

  PlaneFit fail(Status status, const std::string& reason, int hypotheses = 0) const {
    PlaneFit fit;
    fit.status = status;
    fit.reason = reason;
    fit.hypotheses = hypotheses;
    return fit;
  }
  PlaneFit no_plane(int hypotheses) const {
    return fail(Status::kFailed,
                fmt::format("no plane within {:.3g} rad of the up direction", options_.max_tilt),
                hypotheses);
  }

  bool fixed_threshold() const { return options_.inlier_threshold > 0.0; }
  Vector3d pivot() const { return {sample_.pivot[0], sample_.pivot[1], sample_.pivot[2]}; }

  const PointColumns& source_;
  const PlaneFitOptions& options_;
  Vector3d up_;
  double shared_;
  bool may_round_;
  bool bends_ = false, steps_are_exact_ = false;
  Eigen::Index step_axis_ = 2;   // along which rounding is looked for: the nearest to up
  double step_ = 0.0;            // m; 0: none
  double float_rounding_ = 0.0;  // m, of coordinates and sums
  PlaneSample sample_;
  NoiseModel noise_;
  double local_noise_ = 0.0;
};

/// The power law of sigmas again, from the points of the candidate's window.
void Fitter::relearn_power_law(PointArrays* points, PlaneCandidate* c) const {
  constexpr std::size_t kMostPairs = 16384;
  if (c->window.half_u > 1e14) return;
  const kernels::FloatPlane p = c->plane.as_float();
  const kernels::Window w = c->window.as_float();
  const PointArrays& s = *points;
  points->weigh(c->noise, c->plane);
  std::vector<std::pair<float, float>> pairs;
  std::vector<float> sizes;
  for (std::size_t k = 0; k < s.size; k += std::max<std::size_t>(1, s.size / kMostPairs)) {
    const float r = p.nx * s.x[k] + p.ny * s.y[k] + p.nz * s.z[k] + p.d;
    // Out to where the points of the plane end, whatever their sigma.
    if (!(r * r * s.w[k] < 25.0f) || !(s.w[k] > 0.0f)) continue;
    const float u = w.ax * s.x[k] + w.ay * s.y[k] + w.az * s.z[k] + w.a0;
    const float v = w.bx * s.x[k] + w.by * s.y[k] + w.bz * s.z[k] + w.b0;
    if (std::abs(u) > w.half_u || std::abs(v) > w.half_v) continue;
    pairs.emplace_back(s.sigma[k], std::abs(r));
    sizes.push_back(std::abs(r));
  }
  if (pairs.size() < 1024) return;
  learn_power_law(pairs, 4.0 * quantile(sizes, 0.5), sample_.least_noise, &c->noise);
}

/// At how many places the sample's points on a plane lie; not beyond kFewPlaces.
std::size_t Fitter::few_places(const PlaneCandidate& c) const {
  const PointArrays& s = sample_.subset;
  std::set<std::array<float, 3>> places;
  for (std::size_t k = 0; k < s.size && places.size() < kFewPlaces; ++k) {
    const double r = c.plane.distance(s.point(k));
    if (!(r * r * static_cast<double>(s.w[k]) < kBiweight * kBiweight) || !(s.w[k] > 0.0f))
      continue;
    places.insert({s.x[k], s.y[k], s.z[k]});
  }
  return places.size();
}

/// Covariance, condition, status.
void Fitter::describe(const PlaneCandidate& c, const kernels::Moments& full, kernels::Moments s,
                      PlaneFit* fit) {
  std::optional<UnknownRays> rays;  // sample_.subset is weighed for the plane
  if (c.noise.kind != NoiseKind::kRays) rays = unknown_rays(sample_.subset, c.plane, c.window);
  PlanePointErrors errors;
  errors.noise = measured_noise(sample_.subset, c.plane, c.window);
  errors.places = full.count / sample_.copies;
  const std::size_t few = few_places(c);
  if (few < kFewPlaces) errors.places = static_cast<double>(few);
  detail::count_places_once(sample_.copies, &s);
  // How far the points' plane runs along the axis of the steps, as of points spread evenly.
  const double step = step_ * std::abs(c.plane.n[step_axis_]);
  const double mu = full.u / full.weight, mv = full.v / full.weight;
  const double a = c.window.a[step_axis_], b = c.window.b[step_axis_];
  const double variance = a * a * (full.uu / full.weight - mu * mu) +
                          2.0 * a * b * (full.uv / full.weight - mu * mv) +
                          b * b * (full.vv / full.weight - mv * mv);
  const double range = std::sqrt(12.0 * std::max(variance, 0.0));
  const double rounding = detail::shared_rounding(
      step_, std::sqrt(full.count / full.weight) / std::abs(c.plane.n[step_axis_]), range);
  errors.shared = std::hypot(shared_, rounding * std::abs(c.plane.n[step_axis_]), float_rounding_);
  const PlaneEstimate estimate = estimate_covariance(c.plane, c.window, full, s, errors, up_, rays);
  constexpr double kExact = 0.1;  // of a step; rounding gives 0.29
  steps_are_exact_ = step > 0.0 && range > 2.0 * step_ && fit->rmse < kExact * step;
  bends_ = estimate.bends;
  fit->plane = estimate.plane;
  const Vector3d pivot = this->pivot() + source_.origin;
  fit->plane.centroid += pivot;
  fit->plane.plane.offset = -fit->plane.plane.normal.dot(fit->plane.centroid);
  // The window's edges, or the extent of the inliers where it is open.
  const kernels::Window w = c.window.as_float();
  double low_u = -c.window.half_u / 0.96, high_u = -low_u, low_v = -c.window.half_v / 0.96,
         high_v = -low_v;
  if (c.window.half_u > 1e14) {
    low_u = low_v = std::numeric_limits<double>::infinity();
    high_u = high_v = -low_u;
    for (std::size_t k = 0; k < sample_.subset.size; ++k) {
      const double r = c.plane.distance(sample_.subset.point(k));
      if (!(r * r * static_cast<double>(sample_.subset.w[k]) < kInlierSigmas * kInlierSigmas))
        continue;
      const Vector3d p = sample_.subset.point(k);
      const double u = static_cast<double>(w.ax) * p.x() + static_cast<double>(w.ay) * p.y() +
                       static_cast<double>(w.az) * p.z() + static_cast<double>(w.a0);
      const double v = static_cast<double>(w.bx) * p.x() + static_cast<double>(w.by) * p.y() +
                       static_cast<double>(w.bz) * p.z() + static_cast<double>(w.b0);
      low_u = std::min(low_u, u);
      high_u = std::max(high_u, u);
      low_v = std::min(low_v, v);
      high_v = std::max(high_v, v);
    }
  }
  if (high_u >= low_u && high_v >= low_v) {
    const double corners[4][2] = {
        {low_u, low_v}, {high_u, low_v}, {high_u, high_v}, {low_u, high_v}};
    for (const auto& corner : corners) {
      const Vector3d x = c.window.center + corner[0] * c.window.a + corner[1] * c.window.b + pivot;
      fit->extent.push_back(fit->plane.plane.foot(x));
    }
  }
  fit->noise = std::max(errors.noise, float_rounding_);
  if (std::isnan(errors.noise)) fit->noise = errors.noise;
  fit->condition = estimate.condition;
  fit->status = estimate.status;
  fit->reason = estimate.reason;
}

/// The step of rounded coordinates; the noise is no less than theirs.
void Fitter::find_steps() {
  if (!may_round_) return;
  up_.cwiseAbs().maxCoeff(&step_axis_);
  const PointArrays& s = sample_.subset;
  const std::vector<float>& all = step_axis_ == 0 ? s.x : step_axis_ == 1 ? s.y : s.z;
  const std::vector<float> values(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(s.size));
  step_ = detail::coordinate_step(values, sample_.least_noise);
  sample_.least_noise =
      std::max(sample_.least_noise, detail::rounding_deviation(step_ * std::abs(up_[step_axis_])));
}

void Fitter::choose_noise() {
  if (fixed_threshold()) {
    noise_.kind = NoiseKind::kSame;
    noise_.scale = options_.inlier_threshold / kInlierSigmas;
  } else if (source_.covariance) {
    noise_.kind = NoiseKind::kCovariance;
  } else if (source_.sigma && options_.viewpoint) {
    noise_.kind = NoiseKind::kRays;
    noise_.viewpoint = *options_.viewpoint - source_.origin - pivot();
  } else {
    noise_.kind = source_.sigma ? NoiseKind::kPower : NoiseKind::kSame;
  }
  if (noise_.kind != NoiseKind::kSame && step_ > 0.0) noise_.least = sample_.least_noise;
  if (fixed_threshold()) {
    NoiseModel local;
    learn_noise(&local);
    local_noise_ = local.scale;
  } else if (noise_.kind == NoiseKind::kSame || noise_.kind == NoiseKind::kPower) {
    learn_noise(&noise_);
  }
}

void Fitter::learn_noise(NoiseModel* model) const {
  detail::learn_local_noise(sample_.ordered, sample_.leaves, {}, up_, options_.max_tilt,
                            sample_.least_noise, options_.seed, options_.num_threads, model);
}

/// Refines all candidates on the subset; the one that most points of the cloud support.
PlaneCandidate Fitter::choose_candidate(std::vector<PlaneCandidate>* candidates) {
  for (PlaneCandidate& c : *candidates) {
    c.window = PlaneWindow();
    c.noise = noise_;
    detail::refine_and_window(&sample_.subset, up_, sample_.least_noise, fixed_threshold(), &c);
    if (candidates->size() > 1) c.support = detail::count_support(source_, sample_.pivot, c);
  }
  return *std::max_element(
      candidates->begin(), candidates->end(),
      [](const PlaneCandidate& l, const PlaneCandidate& r) { return l.support < r.support; });
}

kernels::Moments Fitter::all_moments(const PlaneCandidate& c, bool finish, double inlier_share,
                                     PlaneFit* fit) const {
  detail::CloudMoments sums = detail::sum_cloud_moments(
      source_, sample_.pivot, c, finish, options_.list_inliers, inlier_share, options_.num_threads);
  const kernels::Moments& total = sums.moments;
  if (finish) {
    fit->num_inliers = static_cast<std::size_t>(total.inliers);
    if (total.inliers > 0.0) fit->rmse = std::sqrt(total.squares / total.inliers);
    fit->inliers = std::move(sums.inliers);
  }
  return total;
}

/// Newton's steps over all points, to convergence where there are not too many.
/// @return the sums at the last plane but one, which the step from there does not change much
kernels::Moments Fitter::refine_on_all(double inlier_share, PlaneCandidate* c,
                                       PlaneFit* fit) const {
  kernels::Moments full;
  const int passes = source_.size <= kManyPasses ? 8 : 1;
  for (int pass = 0; pass < passes; ++pass) {
    align(c->plane, &c->window);
    const bool last = pass + 1 == passes;
    full = all_moments(*c, last, inlier_share, fit);
    PivotPlane next = c->plane;
    double step = 0.0;
    const double unit = std::sqrt(full.count / std::max(full.weight, 1e-300));
    const bool solved = solve_step(full, c->window, &next, &step) && step < unit;
    const bool settled = !solved || step < 1e-3 * unit / std::sqrt(std::max(full.count, 1.0));
    if (settled && !last) full = all_moments(*c, true, inlier_share, fit);
    if (solved) c->plane = next;
    if (settled) break;
  }
  return full;
}

PlaneFit Fitter::run() {
  if (!detail::choose_subset(source_, options_.seed, &sample_)) {
    return fail(Status::kFailed,
                fmt::format("{} usable points, at least 3 are needed", sample_.usable));
  }
  if (!(sample_.spread > 0.0)) return fail(Status::kFailed, "all points lie at one place");
  float_rounding_ = kFloatRounding * sample_.spread;
  find_steps();
  detail::order_by_neighbourhood(up_, &sample_);
  choose_noise();
  PlaneHypotheses hypotheses(options_, noise_, &sample_);
  if (!hypotheses.search()) return no_plane(hypotheses.tried());
  PlaneCandidate c = choose_candidate(&hypotheses.candidates());

  // The part of the plane that is covered, and the noise, by many more points: which of them the
  // subset holds depends on their order.
  const std::size_t n = source_.size;
  if (n > detail::kPlaneSample && n <= kManyPasses) {
    PointArrays many;
    detail::load_many(source_, sample_.pivot, &many);
    if (c.noise.kind == NoiseKind::kPower) relearn_power_law(&many, &c);
    detail::refine_and_window(&many, up_, sample_.least_noise, fixed_threshold(), &c, true);
  }
  PlaneFit fit;
  fit.hypotheses = hypotheses.tried();
  const kernels::Moments full = refine_on_all(hypotheses.inlier_share(), &c, &fit);
  hypotheses.orient(&c.plane);
  align(c.plane, &c.window);
  if (!(full.weight > 0.0)) {
    bends_ = true;
    return fail(Status::kFailed, "no points lie on a common plane", fit.hypotheses);
  }
  if (c.plane.n.dot(up_) < std::cos(options_.max_tilt) - 1e-6) return no_plane(fit.hypotheses);
  sample_.subset.weigh(c.noise, c.plane);
  const kernels::Moments influence = sum_moments(
      sample_.subset, c.plane, c.window, kBiweight * kBiweight, kernels::Loss::kNewton, true);
  describe(c, full, influence, &fit);
  return fit;
}

bool is_plane(const PlaneFit& fit) {
  return fit.status == Status::kOk || fit.status == Status::kWeak;
}

/// One fit, and what is known of why there is none.
struct Attempt {
  PlaneFit fit;
  bool bends = false;        ///< see Fitter
  double threshold = 0.0;    ///< m, of the noise; 0: not known
  double spread = 0.0;       ///< m, of the points
  double local_noise = 0.0;  ///< m, see Fitter
};

Attempt attempt(const PointColumns& source, const PlaneFitOptions& options) {
  const auto result_of = [](const Fitter& fitter, PlaneFit fit) {
    return Attempt{std::move(fit), fitter.bends(), fitter.threshold(), fitter.spread(),
                   fitter.local_noise()};
  };
  Fitter fitter(source, options);
  PlaneFit fit = fitter.run();
  if (!fitter.steps_are_exact()) return result_of(fitter, std::move(fit));
  Fitter exact(source, options, 0.0, false);
  fit = exact.run();
  return result_of(exact, std::move(fit));
}

/// What a plane holds within of a surface that bends away from it by more than its noise: the least
/// of thresholds, each twice the last, within which more points lie on a plane than leave it.
std::optional<PlaneFit> fit_bending(const PointColumns& source, const PlaneFitOptions& options,
                                    const Attempt& bent) {
  constexpr double kFirst = 1e-4, kLast = 0.05;  // of the spread
  constexpr std::size_t kLeastPoints = 12;
  PlaneFitOptions wider = options;
  wider.inlier_threshold = std::max(kFirst * bent.spread, 2.0 * bent.threshold);
  for (; wider.inlier_threshold <= kLast * bent.spread; wider.inlier_threshold *= 2.0) {
    // The bend is an error that all points share.
    PlaneFit fit = Fitter(source, wider, wider.inlier_threshold / kInlierSigmas).run();
    if (!is_plane(fit) || fit.num_inliers < kLeastPoints) continue;
    fit.status = Status::kWeak;
    const std::string more = options.inlier_threshold > 0.0
                                 ? fmt::format("the threshold of {:.2g} m", bent.threshold)
                                 : "their noise";
    fit.reason = fmt::format(
        "the points bend away from any plane by more than {}: this is of those within {:.2g} m of "
        "it",
        more, wider.inlier_threshold);
    return fit;
  }
  return std::nullopt;
}

/// Whether as many points lie within a threshold of a plane as of any that runs through the noise
/// of another's points, or hardly more: the plane is a slice of those.
bool is_slice_of(const PlaneFit& fit, double threshold, const PlaneFit& other) {
  constexpr double kMore = 1.5, kSigmas = 5.0;
  const double inside = std::erf(threshold / (std::sqrt(2.0) * other.noise));
  const double expected = inside * static_cast<double>(other.num_inliers);
  return static_cast<double>(fit.num_inliers) <= kMore * expected + kSigmas * std::sqrt(expected);
}

/// The plane of points that scatter about it by more than the threshold given. Within so little the
/// loss is as flat as their density: what it finds there is a slice anywhere in the noise.
std::optional<PlaneFit> fit_noisier(const PointColumns& source, const PlaneFitOptions& options,
                                    const Attempt& narrow) {
  PlaneFitOptions wider = options;
  wider.inlier_threshold = 0.0;
  const Attempt free = attempt(source, wider);
  if (!is_plane(free.fit) || free.bends || !(free.fit.noise > options.inlier_threshold)) {
    return std::nullopt;
  }
  if (is_plane(narrow.fit) && !is_slice_of(narrow.fit, options.inlier_threshold, free.fit)) {
    return std::nullopt;
  }
  wider.inlier_threshold = kInlierSigmas * free.fit.noise;
  Attempt found = attempt(source, wider);
  if (!is_plane(found.fit)) return std::nullopt;
  found.fit.status = Status::kWeak;
  found.fit.reason = fmt::format(
      "the points scatter about it by {:.2g} m, which the threshold of {:.2g} m cannot show: this "
      "is of those within {:.2g} m of it",
      free.fit.noise, options.inlier_threshold, wider.inlier_threshold);
  return std::move(found.fit);
}

PlaneFit run_fit(const PointColumns& source, const PlaneFitOptions& options) {
  options.validate();
  Attempt first = attempt(source, options);
  const bool noisy = options.inlier_threshold > 0.0 && first.local_noise > options.inlier_threshold;
  if (noisy) {
    if (auto found = fit_noisier(source, options, first)) return std::move(*found);
  }
  if (first.bends) {
    if (auto found = fit_bending(source, options, first)) return std::move(*found);
  }
  return std::move(first.fit);
}

}  // namespace

void PlaneFitOptions::validate() const {
  const auto require = [](bool good, const char* field, double value, const char* bound) {
    if (!good) {
      throw std::invalid_argument(
          fmt::format("PlaneFitOptions::{} is {}, expected {}", field, value, bound));
    }
  };
  require(up.allFinite() && up.norm() > 0.0, "up (its length)", up.norm(), "a direction");
  require(max_tilt > 0.0 && max_tilt <= M_PI / 2, "max_tilt", max_tilt, "(0, pi / 2] rad");
  require(inlier_threshold >= 0.0 && std::isfinite(inlier_threshold), "inlier_threshold",
          inlier_threshold, ">= 0 m");
  require(max_hypotheses > 0, "max_hypotheses", max_hypotheses, "> 0");
  require(confidence > 0.0 && confidence < 1.0, "confidence", confidence, "(0, 1)");
  require(!viewpoint || viewpoint->allFinite(), "viewpoint (its length)",
          viewpoint ? viewpoint->norm() : 0.0, "finite numbers");
}

PlaneFit fit_plane(const RoadCloud& cloud, const PlaneFitOptions& options) {
  const auto same_length = [&](std::size_t length, const char* name) {
    if (length != 0 && length != cloud.size()) {
      throw std::invalid_argument(
          fmt::format("RoadCloud::{} has {} entries, expected {}", name, length, cloud.size()));
    }
  };
  same_length(cloud.sigmas.size(), "sigmas");
  same_length(cloud.covariances.size(), "covariances");
  PointColumns source;
  source.size = cloud.size();
  source.origin = cloud.origin;
  static const float kNone[3] = {0, 0, 0};
  const float* data = cloud.empty() ? kNone : cloud.points.front().data();
  source.x = data;
  source.y = data + 1;
  source.z = data + 2;
  source.stride = 3;
  if (!cloud.covariances.empty()) {
    source.covariance = cloud.covariances.data();
  } else if (!cloud.sigmas.empty()) {
    source.sigma = cloud.sigmas.data();
  }
  PlaneFitOptions local = options;
  if (!local.viewpoint && cloud.frame == CloudFrame::kCamera) local.viewpoint = Vector3d::Zero();
  PlaneFit fit = run_fit(source, local);
  if (fit.status == Status::kFailed && source.sigma && cloud.size() >= 3 &&
      !any_usable_sigma(cloud.sigmas)) {
    fit.reason = "no point has a sigma above 0";
  }
  return fit;
}

PlaneFit fit_plane(const float* x, const float* y, const float* z, const float* sigma,
                   std::size_t n, const PlaneFitOptions& options) {
  PointColumns source;
  source.x = x;
  source.y = y;
  source.z = z;
  source.sigma = sigma;
  source.size = n;
  return run_fit(source, options);
}

}  // namespace camber
