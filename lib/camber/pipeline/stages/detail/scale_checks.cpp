#include "camber/pipeline/stages/detail/scale_checks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "camber/motion/path_curvature.h"
#include "camber/motion/self_calibration.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/scale/fusion.h"

namespace camber::stages::detail {
namespace {

constexpr double kNotMeasured = std::numeric_limits<double>::quiet_NaN();
/// Standard deviations, of what is contradicted altogether.
constexpr double kPlainly = std::numeric_limits<double>::infinity();

/// The plane search against the ego plane: both measure the camera's height in baselines, the
/// one on the intensities near the camera, the other by the road ahead.
std::optional<ScaleEvidence> search_evidence(const LoadedFrames& frames,
                                             const PhotometricGround& refined,
                                             const ScaleOptions& options) {
  const Ground& ground = refined.ground;
  const ScaleNoise& noise = options.noise;
  if (!ground.search.informative || ground.search.correlation < noise.search_correlation ||
      !(ground.ego.height > 0.0)) {
    return std::nullopt;
  }
  const double log_ratio = ground.search.best.log_baseline + std::log(ground.ego.height);
  const double sigma = std::hypot(noise.searched_height, ground.ego.relative_sigma);
  ScaleEvidence out = evidence_of("plane_search", "intensities of the near road", log_ratio, sigma);
  out.measured = {{"correlation", ground.search.correlation}, {"lead", ground.search.lead}};
  Disagreement off;
  off.log_ratio = log_ratio;
  off.sigmas = std::abs(log_ratio) / sigma;
  off.text = "the near road's intensities agree best if " + larger_or_smaller(log_ratio);
  // A search may have found the wrong one of two maxima: the ego plane's has to be plainly worse.
  if (off.sigmas > noise.gate) {
    off.plain = lead_over(frames, refined.motion, ground.search, ground.ego.height,
                          options.num_threads) > noise.search_lead;
  }
  out.against_others = std::move(off);
  return out;
}

/// The focal length by the epipolar geometry of a camera that turns.
std::optional<ScaleEvidence> turn_evidence(const LoadedFrames& frames,
                                           const Correspondences& matches,
                                           const MotionEstimate& motion, const ScaleNoise& noise) {
  const FocalLengthEstimate found =
      estimate_focal_length(frames.camera, matches, static_points(frames, matches), motion);
  if (found.status != Status::kOk) return std::nullopt;
  const double log_factor = std::log(found.factor);
  const double sigma = std::hypot(noise.focal_length, found.sigma);
  ScaleEvidence out = evidence_of(
      "focal_length", fmt::format("{} matches in a turn", found.matches), log_factor, sigma);
  out.measured = {{"gain", found.gain}};
  Disagreement off;
  off.log_ratio = log_factor;
  // Errors that neighbours share bend the one or the other: both have to agree.
  off.sigmas = std::min(std::abs(log_factor) / sigma, std::sqrt(2.0 * found.gain));
  off.text = fmt::format("they fit {:.2f} times the focal length, {:.1f} standard deviations",
                         found.factor, off.sigmas);
  out.against_others = std::move(off);
  return out;
}

/// The focal length by broken lines of known sizes, of which no stroke fits the given one.
DashFocalLength find_dash_focal_length(const LoadedFrames& frames, const GroundRaster& raster,
                                       const Eigen::Vector3d& travel, const ScaledRoad& scaled,
                                       const ScaleOptions& options) {
  if (!options.use_markings || scaled.markings.dashes > 0) return {};
  return focal_length_by_dashes(frames.gray[frames.reference], frames.camera, raster, travel,
                                frames.known.markings, scaled.road.scale_sigma(),
                                options.num_threads);
}

/// What a source alone measures of the scale, the road's shape being known as far as it is.
struct Alone {
  double log_scale;  ///< change of the logarithm of the prior's scale
  double sigma;      ///< without what the prior's own scale leaves open
};

std::optional<Alone> alone(const RoadPosterior& prior, const Constraint& constraint) {
  if (constraint.size() == 0) return std::nullopt;
  const auto implied = implied_log_scale(prior, constraint);
  if (!implied) return std::nullopt;
  const double open = prior.scale_sigma();
  return Alone{implied->mean, std::sqrt(std::max(0.0, implied->variance - open * open))};
}

/// A source against all others, each of which knows the scale.
std::optional<Disagreement> against_others(const RoadPosterior& prior,
                                           const std::vector<Constraint>& constraints,
                                           std::size_t i, const Alone& source,
                                           const std::vector<ConstraintReport>& reports,
                                           const ScaleNoise& noise) {
  const ConstraintReport& report = reports[i];
  if (!(report.residual_sigma > noise.contradiction_start)) return {};
  if (source.sigma > noise.hardly_known) return {};
  std::vector<const Constraint*> rest;
  for (std::size_t j = 0; j < constraints.size(); ++j) {
    if (j != i && reports[j].accepted) rest.push_back(&constraints[j]);
  }
  const RoadPosterior by_rest = prior.conditioned(stacked(rest));
  if (by_rest.scale_sigma() > noise.hardly_known) return {};
  Disagreement out;
  out.log_ratio =
      source.log_scale - std::log(by_rest.metres_per_baseline() / prior.metres_per_baseline());
  out.sigmas = report.residual_sigma;
  out.text = fmt::format("{} ({}): {}; by it {}", report.name, report.source, report.reason,
                         larger_or_smaller(out.log_ratio));
  return out;
}

/// The direction of travel, against those that a camera which looks ahead may have, also in a turn.
ScaleEvidence travel_evidence(const MotionEstimate& motion, std::size_t reference,
                              const Eigen::Vector3d& travel, const ScaleNoise& noise,
                              double metres_per_baseline) {
  const double aside = std::atan2(travel.x(), travel.z());
  const double turn = noise.most_ahead_of_axle *
                      path_curvature(path_places(motion, reference, metres_per_baseline));
  ScaleEvidence out = evidence_of("travel_direction", "", 0.0, kNotMeasured);
  out.measured = {{"aside", aside}, {"by_turn", turn}};
  const double same_side = aside > 0.0 ? turn : -turn;
  out.against_others = Disagreement{
      aside, std::abs(aside) / (noise.most_aside + std::max(0.0, same_side)),
      fmt::format("calibration: the camera travels {:.0f} degrees to the {} of where it looks: is "
                  "its principal point right?",
                  std::abs(aside) * 180.0 / 3.14159265358979323846, aside > 0 ? "right" : "left")};
  return out;
}

ScaleEvidence intensity_evidence(const PhotometricGround& ground, const RoadPosterior& road) {
  const double off = *ground.rejected_log_scale;
  ScaleEvidence out =
      evidence_of("intensities", ground.rejection, off, ground.ground.ego.relative_sigma);
  out.against_others = Disagreement{
      off, std::abs(off) / road.scale_sigma(),
      fmt::format("intensities: {}; by them {}", ground.rejection, larger_or_smaller(off))};
  return out;
}

/// Markings of which none has the known sizes.
ScaleEvidence marking_evidence(const LaneMarkingConstraint& markings, const ScaleNoise& noise) {
  ScaleEvidence out = evidence_of("unmatched_markings", markings.reason, 0.0, kNotMeasured);
  out.against_others =
      Disagreement{noise.hardly_known, kPlainly, "lane_markings: " + markings.reason};
  return out;
}

}  // namespace

void add_sources(const RoadPosterior& prior, const std::vector<Constraint>& constraints,
                 const ScaleNoise& noise, ScaledRoad* scaled) {
  const double change = std::log(scaled->road.metres_per_baseline() / prior.metres_per_baseline());
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    const auto source = alone(prior, constraints[i]);
    if (!source) continue;
    ScaleEvidence evidence = evidence_of(constraints[i].name, constraints[i].source,
                                         source->log_scale - change, source->sigma);
    if (scaled->metric) {
      evidence.against_others =
          against_others(prior, constraints, i, *source, scaled->reports, noise);
    }
    scaled->evidence.push_back(std::move(evidence));
  }
}

void add_checks(const LoadedFrames& frames, const Correspondences& matches,
                const PhotometricGround& ground, const GroundRaster& raster,
                const Eigen::Vector3d& travel, const ScaleOptions& options, ScaledRoad* scaled) {
  const auto add = [&](std::optional<ScaleEvidence> evidence) {
    if (evidence) scaled->evidence.push_back(std::move(*evidence));
  };
  add(travel_evidence(ground.motion, frames.reference, travel, options.noise,
                      scaled->road.metres_per_baseline()));
  if (ground.rejected_log_scale) add(intensity_evidence(ground, scaled->road));
  add(search_evidence(frames, ground, options));
  add(turn_evidence(frames, matches, ground.motion, options.noise));
  if (scaled->markings.contradicts) add(marking_evidence(scaled->markings, options.noise));
  scaled->dash_focal_length = find_dash_focal_length(frames, raster, travel, *scaled, options);
}

}  // namespace camber::stages::detail
