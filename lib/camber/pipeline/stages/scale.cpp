#include "camber/pipeline/stages/scale.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "camber/core/threads.h"
#include "camber/motion/self_calibration.h"
#include "camber/pipeline/stages/detail/ground_steps.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/scale/camera_height_constraint.h"
#include "camber/scale/fusion.h"
#include "camber/scale/known_poses_constraint.h"
#include "camber/scale/speed_constraint.h"

namespace camber::stages {
namespace {

constexpr double kNotMeasured = std::numeric_limits<double>::quiet_NaN();
/// Standard deviations, of what is contradicted altogether.
constexpr double kPlainly = std::numeric_limits<double>::infinity();

RoadPosterior prior_road(const PhotometricGround& ground, double metres_per_baseline,
                         const ScaleOptions& options) {
  const EgoPlane& ego = ground.ground.ego;
  return {ground.field ? ground.field : ground.ground.field,
          ground.motion.covariance,
          options.ground_inflation,
          {ego.plane, ego.shared_jacobian},
          metres_per_baseline,
          kOpenLogScale};
}

/// The path over the frames by the speed, where the scene has it.
std::optional<Constraint> measure_speed(const RoadPosterior& road, const LoadedFrames& frames,
                                        const MotionEstimate& motion, const ScaleNoise& noise) {
  double metres = 0.0, baselines = 0.0;
  int stretches = 0;
  const auto center = [&](std::size_t k) {
    return motion.frame_from_reference[k].inverse().translation();
  };
  for (std::size_t k = 0; k < frames.known.travelled.size(); ++k) {
    if (!frames.known.travelled[k]) continue;
    metres += *frames.known.travelled[k];
    baselines += (center(k + 1) - center(k)).norm();
    ++stretches;
  }
  if (stretches == 0 || !(frames.known.travelled_sigma > 0.0)) return std::nullopt;
  return speed_constraint(road, {metres, frames.known.travelled_sigma}, baselines, stretches,
                          noise.speed_path);
}

/// The length of the path over the given positions, of poses that the matches contradict.
std::optional<Constraint> measure_positions(const RoadPosterior& road, const LoadedFrames& frames,
                                            const MotionEstimate& motion, const ScaleNoise& noise) {
  if (frames.contradicted_poses.empty() || frames.poses_of_other_moments) return std::nullopt;
  double metres = 0.0, baselines = 0.0;
  for (std::size_t k = 1; k < frames.size(); ++k) {
    const auto step = [](const SE3& before, const SE3& after) {
      return (after.translation() - before.translation()).norm();
    };
    metres += step(*frames.frames[k - 1].world_from_camera, *frames.frames[k].world_from_camera);
    baselines += step(motion.frame_from_reference[k - 1].inverse(),
                      motion.frame_from_reference[k].inverse());
  }
  std::optional<Constraint> out = speed_constraint(
      road,
      {metres, std::hypot(KnownPoseOptions().translation_sigma, noise.contradicted_path * metres)},
      baselines, static_cast<int>(frames.size()) - 1, noise.speed_path);
  if (!out) return out;
  out->name = "known_poses";
  out->source = "positions alone, " + out->source;
  return out;
}

/// What gives a run its metres before the road's own features are looked at.
std::vector<Constraint> anchors(const RoadPosterior& road, const LoadedFrames& frames,
                                const MotionEstimate& motion, const ScaleNoise& noise) {
  std::vector<Constraint> out;
  if (motion.metres_per_baseline) {
    out.push_back(known_poses_constraint(road, *motion.metres_per_baseline, motion.baseline_sigma));
  } else if (frames.known.camera_height) {
    out.push_back(camera_height_constraint(road, *frames.known.camera_height,
                                           frames.known.camera_height_sigma));
  } else if (auto positions = measure_positions(road, frames, motion, noise)) {
    out.push_back(std::move(*positions));
  } else if (auto speed = measure_speed(road, frames, motion, noise)) {
    out.push_back(std::move(*speed));
  } else {
    out.push_back(camera_height_constraint(road, noise.unknown_camera_height,
                                           noise.unknown_camera_height_sigma));
    out.back().source = "not given: " + out.back().source;
  }
  return out;
}

Constraint all_of(const std::vector<Constraint>& constraints) {
  std::vector<const Constraint*> parts;
  for (const Constraint& c : constraints) parts.push_back(&c);
  return stacked(parts);
}

/// The ground in the reference image, with where it is clear of vehicles.
GroundRaster ground_raster(const LoadedFrames& frames, const Correspondences& matches,
                           const Ground& ground, const RoadPosterior& road, int num_threads) {
  GroundRaster out;
  out.top = std::max(0, static_cast<int>(road.top()) + 1);
  const int width = frames.camera.width, height = frames.camera.height;
  const auto stored = static_cast<std::size_t>(width) * static_cast<std::size_t>(height - out.top);
  out.inverse_depth.resize(stored);
  parallel_for(static_cast<std::size_t>(height - out.top), num_threads, [&](std::size_t row) {
    road.inverse_depths(out.top + static_cast<double>(row), width,
                        &out.inverse_depth[row * static_cast<std::size_t>(width)]);
  });
  // Near ground, since masks have holes where there is paint.
  constexpr int kReach = 10;  // px
  std::vector<std::uint8_t> seen = ground_pixels(frames, matches, ground);
  cv::Mat grown;
  cv::dilate(cv::Mat(height, width, CV_8UC1, seen.data()), grown,
             cv::getStructuringElement(cv::MORPH_RECT, {2 * kReach + 1, 2 * kReach + 1}));
  const std::vector<std::uint8_t>& vehicle = frames.reference_masks().vehicle;
  out.visible.resize(stored);
  for (std::size_t i = 0, skipped = vehicle.size() - stored; i < stored; ++i) {
    out.visible[i] = grown.data[skipped + i] != 0 && vehicle[skipped + i] == 0;
  }
  return out;
}

LaneMarkingConstraint measure_markings(const LoadedFrames& frames, const GroundRaster& raster,
                                       const Eigen::Vector3d& travel, const RoadPosterior& road,
                                       const ScaleOptions& options) {
  LaneMarkingConstraint out;
  out.constraint.name = "lane_markings";
  const LaneMarkingSizes& sizes = frames.known.markings;
  if (!options.use_markings) return out;
  if (!sizes.dashes() && !sizes.stripes()) {
    out.reason = "the scene gives no sizes of markings";
    return out;
  }
  const LaneMarkings found =
      detect_lane_markings(frames.gray[frames.reference], frames.camera, raster, travel, sizes,
                           road.scale_sigma(), options.num_threads);
  return lane_marking_constraint(road, frames.camera, found, sizes, options.noise);
}

/// Markings, and the road at which their lengths are linearised.
struct FoundMarkings {
  LaneMarkingConstraint markings;
  RoadPosterior linearised_at;
};

/// The markings at other scales of the road than the given one: those of the scale at which the
/// most lengths fit.
FoundMarkings rescaled_markings(const LoadedFrames& frames, const GroundRaster& raster,
                                const Eigen::Vector3d& travel, const PhotometricGround& ground,
                                const RoadPosterior& given, const ScaleOptions& options) {
  constexpr std::array<double, 4> kFactors = {0.71, 0.84, 1.19, 1.41};
  constexpr double kBetween = 0.05;  // relative, standard deviation of the scale about a factor
  const double height = given.ego().plane.offset;
  ScaleOptions one_thread = options;
  one_thread.num_threads = 1;
  std::vector<FoundMarkings> found(kFactors.size(), {{}, given});
  parallel_for(kFactors.size(), options.num_threads, [&](std::size_t k) {
    const double factor = kFactors[k];
    const RoadPosterior prior = prior_road(ground, factor * given.metres_per_baseline(), options);
    found[k].linearised_at = prior.conditioned(
        camera_height_constraint(prior, factor * height, kBetween * factor * height));
    GroundRaster rescaled = raster;
    for (float& rho : rescaled.inverse_depth) rho *= static_cast<float>(1.0 / factor);
    found[k].markings =
        measure_markings(frames, rescaled, travel, found[k].linearised_at, one_thread);
  });
  return *std::max_element(found.begin(), found.end(),
                           [](const FoundMarkings& a, const FoundMarkings& b) {
                             return a.markings.constraint.size() < b.markings.constraint.size();
                           });
}

constexpr int kLine = 3;  // strokes of a broken line that are no chance

/// @return whether markings explain plainly more of the image than others: a stroke near the camera
/// has a length of its own besides its distance from the next.
bool explain_more(const LaneMarkingConstraint& markings, const LaneMarkingConstraint& than) {
  constexpr int kMoreLengths = 2;
  return markings.dashes >= kLine && markings.rows > than.rows &&
         markings.constraint.size() >= than.constraint.size() + kMoreLengths;
}

/// @param given  whether the road's metres were given. Where they are wrong, far strokes fit a road
///               that bends for them, while those near the camera fit none: a scale at which more
///               of them fit is measured in its place.
FoundMarkings find_markings(const LoadedFrames& frames, const GroundRaster& raster,
                            const Eigen::Vector3d& travel, const PhotometricGround& ground,
                            const RoadPosterior& anchored, bool given,
                            const ScaleOptions& options) {
  FoundMarkings out{measure_markings(frames, raster, travel, anchored, options), anchored};
  if (out.markings.constraint.size() == 0) {
    // What they measure if the scale is not taken for known.
    LaneMarkingConstraint alone = measure_markings(
        frames, raster, travel,
        anchored.with_wider_scale(std::pow(options.noise.contradicted_scale, 2)), options);
    if (alone.constraint.size() > 0) out.markings = std::move(alone);
  }
  const bool fit = out.markings.dashes >= kLine && out.markings.misfit_before < 1.0;
  if (given && !fit && options.use_markings && frames.known.markings.dashes()) {
    FoundMarkings other = rescaled_markings(frames, raster, travel, ground, anchored, options);
    if (explain_more(other.markings, out.markings)) out = std::move(other);
  }
  return out;
}

RoadWidthConstraint measure_width(const LoadedFrames& frames, const GroundRaster& raster,
                                  const Eigen::Vector3d& travel, const RoadPosterior& road,
                                  const ScaleOptions& options) {
  RoadWidthConstraint out;
  out.constraint.name = "road_width";
  if (!options.use_road_width) return out;
  if (!frames.has_masks()) {
    out.reason = "no mask shows where the road ends";
    return out;
  }
  const FrameMasks& masks = frames.reference_masks();
  const RoadEdges edges =
      detect_road_edges(frames.gray[frames.reference], frames.camera, raster, masks.roadway,
                        masks.vehicle, travel, options.num_threads);
  return road_width_constraint(road, frames.camera, edges, options.noise);
}

/// The sources that nothing was measured by keep their reason.
void set_reason(const std::string& name, const std::string& reason,
                std::vector<ConstraintReport>* reports) {
  for (ConstraintReport& report : *reports) {
    if (report.name == name && !report.accepted && report.reason.empty()) report.reason = reason;
  }
}

/// Fuses all sources, of which the first gives the metres. Where markings, or a height beside
/// poses, contradict it nobody knows which is wrong: the given metres stand, and the contradiction
/// is left to widen the scale.
FusedRoad fuse_with_given_metres(const RoadPosterior& prior, std::vector<Constraint> constraints) {
  constexpr std::size_t kGiven = 0;
  std::vector<ConstraintReport> contradicting(constraints.size());
  FusedRoad fused = fuse(prior, constraints);
  while (!fused.reports[kGiven].accepted) {
    std::size_t farthest = kGiven;
    for (std::size_t i = kGiven + 1; i < constraints.size(); ++i) {
      const Constraint& c = constraints[i];
      if (c.size() == 0 || (c.name != "lane_markings" && c.name != "camera_height")) continue;
      if (farthest == kGiven ||
          fused.reports[i].residual_sigma > fused.reports[farthest].residual_sigma) {
        farthest = i;
      }
    }
    if (farthest == kGiven) break;
    ConstraintReport& report = contradicting[farthest];
    report = fused.reports[farthest];
    report.residual_sigma = fused.reports[kGiven].residual_sigma;
    report.accepted = false;
    report.reason =
        fmt::format("{:.1f} standard deviations off the given metres", report.residual_sigma);
    Constraint none;
    none.name = constraints[farthest].name;
    none.source = constraints[farthest].source;
    constraints[farthest] = std::move(none);
    fused = fuse(prior, constraints);
  }
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    if (!contradicting[i].reason.empty()) fused.reports[i] = std::move(contradicting[i]);
  }
  return fused;
}

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
  if (off.sigmas > noise.search_gate) {
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

/// rad per metre by which the camera turns to the right along its path, about the reference frame;
/// 0 where it stands.
double path_curvature(const MotionEstimate& motion, std::size_t reference,
                      const Eigen::Vector3d& travel, double metres_per_baseline) {
  const std::size_t last = motion.frame_from_reference.size() - 1;
  const SE3 before = motion.frame_from_reference[reference > 0 ? reference - 1 : 0].inverse();
  const SE3 after = motion.frame_from_reference[std::min(reference + 1, last)].inverse();
  const double along = metres_per_baseline * travel.dot(after.translation() - before.translation());
  const Eigen::Vector3d axis =
      (before.rotation().conjugate() * after.rotation()) * Eigen::Vector3d::UnitZ();
  return along != 0.0 ? std::atan2(axis.x(), axis.z()) / along : 0.0;
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
  if (source.sigma > noise.contradicting_scale) return {};
  std::vector<const Constraint*> rest;
  for (std::size_t j = 0; j < constraints.size(); ++j) {
    if (j != i && reports[j].accepted) rest.push_back(&constraints[j]);
  }
  const RoadPosterior by_rest = prior.conditioned(stacked(rest));
  if (by_rest.scale_sigma() > noise.contradicting_scale) return {};
  Disagreement out;
  out.log_ratio =
      source.log_scale - std::log(by_rest.metres_per_baseline() / prior.metres_per_baseline());
  out.sigmas = report.residual_sigma;
  out.text = fmt::format("{} ({}): {}; by it {}", report.name, report.source, report.reason,
                         larger_or_smaller(out.log_ratio));
  return out;
}

/// Of the sources, each alone, before the ground is conditioned on all of them.
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

/// The direction of travel, against those that a camera which looks ahead may have, also in a turn.
ScaleEvidence travel_evidence(const MotionEstimate& motion, std::size_t reference,
                              const Eigen::Vector3d& travel, const ScaleNoise& noise,
                              double metres_per_baseline) {
  const double aside = std::atan2(travel.x(), travel.z());
  const double turn =
      noise.most_ahead_of_axle * path_curvature(motion, reference, travel, metres_per_baseline);
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
      Disagreement{noise.contradicted_scale, kPlainly, "lane_markings: " + markings.reason};
  return out;
}

/// What is compared with the result without taking part in it.
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

/// Markings of known sizes may be there and yet not give the metres.
std::string why_up_to_scale(const LoadedFrames& frames, const LaneMarkingConstraint& markings) {
  const LaneMarkingSizes& sizes = frames.known.markings;
  if ((!sizes.dashes() && !sizes.stripes()) || markings.reason.empty()) {
    return "no source of metres";
  }
  return "no source of metres but lane markings: " + markings.reason;
}

/// How the scale follows the focal length: as the source that gives the metres, and as the dashes
/// of broken lines, lengths along the road, by the share that they have in what is known.
double scale_by_focal(const RoadPosterior& prior, const std::vector<Constraint>& constraints,
                      const FusedRoad& fused, const LaneMarkingConstraint& markings) {
  const bool across = constraints.front().name == "camera_height";
  if (!across || markings.dashes == 0) return across ? 1.0 : 0.0;
  std::vector<const Constraint*> others;
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    if (!fused.reports[i].accepted) continue;
    if (constraints[i].name != "lane_markings") others.push_back(&constraints[i]);
  }
  const double without = prior.conditioned(stacked(others)).scale_sigma();
  const double with = fused.road.scale_sigma();
  return std::min(1.0, (with * with) / (without * without));
}

bool accepted(const std::vector<ConstraintReport>& reports, const std::string& name) {
  return std::any_of(reports.begin(), reports.end(),
                     [&](const ConstraintReport& r) { return r.name == name && r.accepted; });
}

}  // namespace

ScaledRoad scale(const LoadedFrames& frames, const Correspondences& matches,
                 const PhotometricGround& ground, const ScaleOptions& options) {
  detail::require_seen(ground.ground.ego);
  const Eigen::Vector3d travel = travel_direction(ground.motion, frames.reference);
  const bool given = ground.motion.metres_per_baseline || frames.known.camera_height;
  const double start = ground.ground.metres_per_baseline;
  // A guessed scale hides markings: with that of the first ones found, or of the speed, more are.
  constexpr int kMostRounds = 3;
  double m = start;
  for (int round = 0;; ++round) {
    const RoadPosterior prior = prior_road(ground, m, options);
    std::vector<Constraint> constraints = anchors(prior, frames, ground.motion, options.noise);
    const bool by_path = !given && constraints.front().name != "camera_height";
    const bool guessed = !given && !by_path;
    const RoadPosterior anchored = prior.conditioned(all_of(constraints));
    const GroundRaster raster =
        ground_raster(frames, matches, ground.ground, anchored, options.num_threads);
    auto [markings, linearised_at] =
        find_markings(frames, raster, travel, ground, anchored, given, options);
    RoadWidthConstraint width = measure_width(frames, raster, travel, anchored, options);
    constraints.push_back(prior.relinearised(markings.constraint, linearised_at));
    constraints.push_back(prior.relinearised(width.constraint, anchored));
    if (ground.motion.metres_per_baseline && frames.known.camera_height) {
      constraints.push_back(camera_height_constraint(prior, *frames.known.camera_height,
                                                     frames.known.camera_height_sigma));
    }
    if (given) {
      for (auto* measure : {&measure_positions, &measure_speed}) {
        auto path = (*measure)(prior, frames, ground.motion, options.noise);
        if (path) constraints.push_back(std::move(*path));
      }
    }
    FusedRoad fused =
        guessed ? fuse(prior, constraints) : fuse_with_given_metres(prior, constraints);
    const double change = std::log(fused.road.metres_per_baseline() / m);
    const bool moved = by_path || (guessed && accepted(fused.reports, "lane_markings"));
    if (moved && std::abs(change) >= 0.02 && round + 1 < kMostRounds) {
      m *= std::exp(change);
      continue;
    }
    const double sigma = fused.road.scale_sigma();
    const bool metric = !guessed || (accepted(fused.reports, "lane_markings") &&
                                     sigma <= options.noise.metric_limit);
    const double by_focal = scale_by_focal(prior, constraints, fused, markings);
    if (!metric) {
      // Lengths in nominal heights of the camera; only what does not depend on metres is used.
      if (accepted(fused.reports, "lane_markings")) {
        markings.reason =
            fmt::format("they measure the scale to {:.1f} % only, so the result stays up to scale",
                        100.0 * sigma);
      }
      const RoadPosterior nominal = prior_road(ground, start, options);
      const Constraint height = camera_height_constraint(
          nominal, options.noise.unknown_camera_height, options.noise.camera_height);
      std::vector<ConstraintReport> reports = fused.reports;
      fused = fuse(nominal, {height, nominal.relinearised(width.constraint, anchored)});
      for (ConstraintReport& report : reports) {
        if (report.name != "road_width") report.accepted = false;
      }
      set_reason("camera_height", "not given", &reports);
      fused.reports = std::move(reports);
    }
    set_reason("lane_markings", markings.reason, &fused.reports);
    set_reason("road_width", width.reason, &fused.reports);
    const double scale_change = std::log(fused.road.metres_per_baseline() / start);
    ScaledRoad out{
        std::move(fused.road), metric,      std::move(fused.reports), {}, std::move(markings),
        std::move(width),      scale_change};
    out.scale_by_focal = metric ? by_focal : 1.0;
    if (!metric) out.without_metres = why_up_to_scale(frames, out.markings);
    add_sources(prior, constraints, options.noise, &out);
    if (metric) add_checks(frames, matches, ground, raster, travel, options, &out);
    return out;
  }
}

}  // namespace camber::stages
