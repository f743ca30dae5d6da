#include "camber/pipeline/stages/scale.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/median.h"
#include "camber/core/threads.h"
#include "camber/motion/self_calibration.h"
#include "camber/pipeline/stages/detail/ground_steps.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/scale/camera_height_constraint.h"
#include "camber/scale/contradiction.h"
#include "camber/scale/fusion.h"
#include "camber/scale/known_poses_constraint.h"
#include "camber/scale/speed_constraint.h"

namespace camber::stages {
namespace {

RoadPosterior prior_road(const PhotometricGround& ground, double metres_per_baseline,
                         const ScaleOptions& options) {
  const EgoPlane& ego = ground.ground.ego;
  return {ground.field ? ground.field : ground.ground.field,
          ground.motion.covariance,
          options.ground_inflation,
          {ego.plane, ego.by_shared},
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
  if (frames.contradicted_poses.empty()) return std::nullopt;
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

/// Markings, and the road around which their lengths are linearised.
struct FoundMarkings {
  LaneMarkingConstraint markings;
  RoadPosterior around;
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
    found[k].around = prior.conditioned(
        camera_height_constraint(prior, factor * height, kBetween * factor * height));
    GroundRaster rescaled = raster;
    for (float& rho : rescaled.inverse_depth) rho *= static_cast<float>(1.0 / factor);
    found[k].markings = measure_markings(frames, rescaled, travel, found[k].around, one_thread);
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

std::string larger_or_smaller(double log_ratio) {
  return fmt::format("everything is {:.0f} % {}", 100.0 * std::abs(std::expm1(log_ratio)),
                     log_ratio > 0.0 ? "larger" : "smaller");
}

/// What is compared with the result without taking part in it.
struct Check {
  ConstraintReport report;
  double log_ratio = 0.0;  ///< logarithm of what it finds over the result's
};

/// The plane search against the ego plane: both measure the camera's height in baselines, the
/// one on the intensities near the camera, the other by the road ahead.
std::optional<Check> check_search(const LoadedFrames& frames, const PhotometricGround& refined,
                                  const ScaleOptions& options) {
  const Ground& ground = refined.ground;
  const ScaleNoise& noise = options.noise;
  if (!ground.search.informative || ground.search.correlation < noise.search_correlation ||
      !(ground.ego.height > 0.0)) {
    return std::nullopt;
  }
  const double log_ratio = ground.search.best.log_baseline + std::log(ground.ego.height);
  ConstraintReport out{"plane_search", "intensities of the near road", 0.0, true, {}};
  out.residual_sigma =
      std::abs(log_ratio) / std::hypot(noise.searched_height, ground.ego.relative_sigma);
  // A search may have found the wrong one of two maxima: the ego plane's has to be plainly worse.
  if (out.residual_sigma > noise.search_gate) {
    out.accepted = lead_over(frames, refined.motion, ground.search, ground.ego.height,
                             options.num_threads) <= noise.search_lead;
  }
  if (!out.accepted) {
    out.reason = "the near road's intensities agree best if " + larger_or_smaller(log_ratio);
  }
  return Check{std::move(out), log_ratio};
}

/// The focal length against the epipolar geometry of a camera that turns.
std::optional<Check> check_focal_length(const LoadedFrames& frames, const Correspondences& matches,
                                        const MotionEstimate& motion, const ScaleNoise& noise) {
  const FocalLengthEstimate found =
      estimate_focal_length(frames.camera, matches, static_points(frames, matches), motion);
  if (found.status != Status::kOk) return std::nullopt;
  const double log_factor = std::log(found.factor);
  ConstraintReport out{
      "focal_length", fmt::format("{} matches in a turn", found.matches), 0.0, true, {}};
  // Errors that neighbours share bend the one or the other: both have to agree.
  out.residual_sigma = std::min(std::abs(log_factor) / std::hypot(noise.focal_length, found.sigma),
                                std::sqrt(2.0 * found.gain));
  if (out.residual_sigma > noise.turned_focal_length_gate) {
    out.accepted = false;
    out.reason = fmt::format("they fit {:.2f} times the focal length, {:.1f} standard deviations",
                             found.factor, out.residual_sigma);
  }
  return Check{std::move(out), log_factor};
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

void widen(double variance, ScaledRoad* scaled) {
  scaled->contradiction_variance = std::max(scaled->contradiction_variance, variance);
}

void contradict(std::string text, ScaledRoad* scaled) {
  scaled->contradictions.push_back({"scale_contradicted", std::move(text)});
}

/// The sources, each alone, before the ground is conditioned on all of them.
void admit_sources(const RoadPosterior& prior, const std::vector<Constraint>& constraints,
                   const ScaleNoise& noise, ScaledRoad* scaled) {
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    const ConstraintReport& report = scaled->reports[i];
    if (!(report.residual_sigma > noise.contradiction_start)) continue;
    std::vector<const Constraint*> rest;
    for (std::size_t j = 0; j < constraints.size(); ++j) {
      if (j != i && scaled->reports[j].accepted) rest.push_back(&constraints[j]);
    }
    const RoadPosterior by_rest = prior.conditioned(stacked(rest));
    if (by_rest.scale_sigma() > noise.contradicting_scale) continue;  // they know none
    const double others = std::log(by_rest.metres_per_baseline() / prior.metres_per_baseline());
    const auto other = contradicting_scale(prior, constraints[i], report, others, noise);
    if (!other) continue;
    widen(other->variance, scaled);
    if (report.accepted) continue;
    contradict(fmt::format("{} ({}): {}; by it {}", report.name, report.source, report.reason,
                           larger_or_smaller(other->log_scale)),
               scaled);
  }
}

/// A direction of travel that no camera which looks ahead has, also in a turn.
void admit_travel_aside(const MotionEstimate& motion, std::size_t reference,
                        const Eigen::Vector3d& travel, const ScaleNoise& noise,
                        ScaledRoad* scaled) {
  const double aside = std::atan2(travel.x(), travel.z());
  const double turn = noise.most_ahead_of_axle *
                      path_curvature(motion, reference, travel, scaled->road.metres_per_baseline());
  const bool beyond = aside > noise.most_aside + std::max(0.0, turn) ||
                      aside < -noise.most_aside + std::min(0.0, turn);
  if (!beyond) return;
  widen(aside * aside, scaled);
  contradict(
      fmt::format("calibration: the camera travels {:.0f} degrees to the {} of where it "
                  "looks: is its principal point right?",
                  std::abs(aside) * 180.0 / 3.14159265358979323846, aside > 0 ? "right" : "left"),
      scaled);
}

void admit_rejected_intensities(const PhotometricGround& ground, const ScaleNoise& noise,
                                ScaledRoad* scaled) {
  if (!ground.rejected_log_scale) return;
  const double off = *ground.rejected_log_scale;
  widen(off * off, scaled);
  if (std::abs(off) > noise.rejected_intensities_gate * scaled->road.scale_sigma()) {
    contradict(fmt::format("intensities: {}; by them {}", ground.rejection, larger_or_smaller(off)),
               scaled);
  }
}

/// A point over the driven path, camera heights.
struct PathPlace {
  double ahead, up;  ///< up: over the ego plane
};

/// @param half_width  of the path, unit of the points.
std::vector<PathPlace> over_path(const EgoPlane& ego, const TriangulatedPoints& points,
                                 double half_width) {
  std::vector<PathPlace> out;
  const std::vector<Eigen::Vector3d>& line = ego.line;
  if (line.size() < 2) return out;
  const Eigen::Vector3d up = ego.plane.plane.normal;
  const Eigen::Vector3d forward = ego.plane.axis1, right = forward.cross(up);
  const double step = forward.dot(line[1] - line[0]);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = points.point(i);
    const double at = forward.dot(p) / step;
    if (!(at > 0.0) || !(at < static_cast<double>(line.size() - 1))) continue;
    const Eigen::Vector3d off = p - line[static_cast<std::size_t>(std::lround(at))];
    if (std::abs(right.dot(off)) < half_width) {
      out.push_back({forward.dot(p) / ego.height, 1.0 + up.dot(p) / ego.height});
    }
  }
  return out;
}

/// Share of the matches over the driven path, up to where its road is seen well, that stand on it
/// lower than the camera or lie below it; 0 where a mask shows the road.
double contested_share(const Ground& ground, double metres_per_baseline) {
  constexpr double kHalfWidth = 1.2;                  // m
  constexpr double kOff = 0.15, kBelowCamera = 0.95;  // camera heights
  constexpr double kPastMiddle = 1.5;  // of the distance to the middle one of the road's points
  constexpr std::size_t kFewest = 50;  // matches
  const EgoPlane& ego = ground.ego;
  const double half_width = kHalfWidth / metres_per_baseline;
  const std::vector<PathPlace> road = over_path(ego, ground.seen.points, half_width);
  std::vector<double> ahead;  // of the road; where the path shows hardly any, also beside it
  if (road.size() >= kFewest) {
    for (const PathPlace& p : road) ahead.push_back(p.ahead);
  } else {
    const Eigen::Vector3d forward = ego.plane.axis1;
    for (std::size_t i = 0; i < ground.seen.points.size(); ++i) {
      ahead.push_back(forward.dot(ground.seen.points.point(i)) / ego.height);
    }
  }
  const double reach = ahead.empty() ? 0.0 : kPastMiddle * upper_median(&ahead);
  const std::vector<PathPlace> others = over_path(ego, ground.seen.others, half_width);
  const auto contesting =
      static_cast<std::size_t>(std::count_if(others.begin(), others.end(), [&](const PathPlace& p) {
        return p.ahead < reach && std::abs(p.up) > kOff && p.up < kBelowCamera;
      }));
  const std::size_t all = contesting + road.size();
  return all < kFewest ? 0.0 : static_cast<double>(contesting) / static_cast<double>(all);
}

/// A road found without a mask where much else is matched, as the source of the scale.
void admit_contested_road(const PhotometricGround& ground, const ScaleNoise& noise,
                          ScaledRoad* scaled) {
  if (ground.motion.metres_per_baseline) return;
  const double contested = contested_share(ground.ground, scaled->road.metres_per_baseline());
  if (!(contested > noise.most_contested)) return;
  widen(noise.unfound_scale * noise.unfound_scale, scaled);
  contradict(fmt::format("matches: {:.0f} % of those over the driven path are off the road that is "
                         "found there",
                         100.0 * contested),
             scaled);
}

/// Share of the matches of what stands still and is no road by the mask that would stand on the
/// first metres of the driven path.
double obstructing_share(const LoadedFrames& frames, const Correspondences& matches,
                         const PhotometricGround& ground, double metres_per_baseline,
                         int num_threads) {
  constexpr std::size_t kStride = 4, kFewest = 200;    // matches
  constexpr double kHalfWidth = 0.8, kFarthest = 6.0;  // m
  constexpr double kLowest = 0.2, kHighest = 1.2;      // camera heights over the road
  const std::vector<std::uint8_t> still = static_points(frames, matches);
  const std::vector<std::uint8_t>& road = frames.reference_masks().ground_near;
  std::vector<std::uint8_t> wanted(still.size(), 0);
  for (std::size_t i = 0; i < wanted.size(); i += kStride) {
    wanted[i] = still[i] && !road[matches.image_index(i, frames.camera.width)];
  }
  TriangulationOptions options;
  options.with_pose_jacobian = false;
  options.num_threads = num_threads;
  const TriangulatedPoints points =
      triangulate(frames.camera, matches, ground.motion, wanted, options);
  if (points.size() < kFewest) return 0.0;
  const EgoPlane& ego = ground.ground.ego;
  const std::vector<PathPlace> places = over_path(ego, points, kHalfWidth / metres_per_baseline);
  const double reach = kFarthest / (metres_per_baseline * ego.height);
  const auto obstructing = std::count_if(places.begin(), places.end(), [&](const PathPlace& p) {
    return p.ahead < reach && p.up > kLowest && p.up < kHighest;
  });
  return static_cast<double>(obstructing) / static_cast<double>(points.size());
}

/// The road was found at another layer, in steps that are many times too short, where what it
/// passes would obstruct it.
/// @throws NoAnswerError
void require_clear_path(const LoadedFrames& frames, const Correspondences& matches,
                        const PhotometricGround& ground, const ScaleOptions& options,
                        const ScaledRoad& scaled) {
  if (!frames.has_masks() || ground.motion.metres_per_baseline) return;
  const double share = obstructing_share(frames, matches, ground, scaled.road.metres_per_baseline(),
                                         options.num_threads);
  if (share <= options.noise.most_obstructing) return;
  throw NoAnswerError(
      fmt::format("the scale is not known: {:.0f} % of what is matched beside the road would "
                  "obstruct the driven path; the road is likely found at another layer, as what it "
                  "mirrors or a texture that repeats",
                  100.0 * share));
}

/// A masked road that the matches hardly find.
void admit_unfound_road(const LoadedFrames& frames, const Ground& ground, const ScaleNoise& noise,
                        ScaledRoad* scaled) {
  if (!frames.has_masks()) return;
  const double found = found_share(ground.seen);
  widen(std::pow(noise.unfound_share * (1.0 - found) * (1.0 - found), 2), scaled);
  const double least = ground.search.ambiguous     ? noise.least_found_ambiguous
                       : ground.search.informative ? noise.least_found
                                                   : noise.least_found_alone;
  if (found >= least) return;
  widen(noise.unfound_scale * noise.unfound_scale, scaled);
  contradict(fmt::format("matches: only {:.0f} % of the masked road is found in the other images",
                         100.0 * found),
             scaled);
}

void admit_search(std::optional<Check> check, ScaledRoad* scaled) {
  if (!check) return;
  ConstraintReport& report = check->report;
  if (!report.accepted) {
    widen(check->log_ratio * check->log_ratio, scaled);
    contradict(report.name + ": " + report.reason, scaled);
  }
  scaled->reports.push_back(std::move(report));
}

void admit_focal_length(std::optional<Check> check, ScaledRoad* scaled) {
  if (!check) return;
  ConstraintReport& report = check->report;
  if (!report.accepted) {
    widen(check->log_ratio * check->log_ratio, scaled);
    scaled->contradictions.push_back(
        {"focal_length_contradicted", report.source + ": " + report.reason});
  }
  scaled->reports.push_back(std::move(report));
}

void admit_markings(const ScaleNoise& noise, ScaledRoad* scaled) {
  if (!scaled->markings.contradicts) return;
  widen(noise.contradicted_scale * noise.contradicted_scale, scaled);
  contradict("lane_markings: " + scaled->markings.reason, scaled);
}

/// Names what contradicts the result, and widens its scale by as much.
/// @throws NoAnswerError where what is beside the road would obstruct the driven path.
void admit_contradictions(const LoadedFrames& frames, const Correspondences& matches,
                          const PhotometricGround& ground, const GroundRaster& raster,
                          const Eigen::Vector3d& travel, const RoadPosterior& prior,
                          const std::vector<Constraint>& constraints, const ScaleOptions& options,
                          ScaledRoad* scaled) {
  const ScaleNoise& noise = options.noise;
  require_clear_path(frames, matches, ground, options, *scaled);
  admit_sources(prior, constraints, noise, scaled);
  admit_travel_aside(ground.motion, frames.reference, travel, noise, scaled);
  admit_rejected_intensities(ground, noise, scaled);
  admit_unfound_road(frames, ground.ground, noise, scaled);
  widen(std::pow(ground.ground.start_spread, 2), scaled);
  admit_contested_road(ground, noise, scaled);
  admit_search(check_search(frames, ground, options), scaled);
  admit_focal_length(check_focal_length(frames, matches, ground.motion, noise), scaled);
  scaled->dash_focal_length = find_dash_focal_length(frames, raster, travel, *scaled, options);
  admit_markings(noise, scaled);
}

bool accepted(const std::vector<ConstraintReport>& reports, const std::string& name) {
  return std::any_of(reports.begin(), reports.end(),
                     [&](const ConstraintReport& r) { return r.name == name && r.accepted; });
}

}  // namespace

ScaledRoad scale(const LoadedFrames& frames, const Correspondences& matches,
                 const PhotometricGround& ground, const ScaleOptions& options) {
  detail::require_seen(ground.ground.ego);
  detail::require_one_road(ground.ground.ego);
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
    auto [markings, around] =
        find_markings(frames, raster, travel, ground, anchored, given, options);
    RoadWidthConstraint width = measure_width(frames, raster, travel, anchored, options);
    constraints.push_back(prior.relinearised(markings.constraint, around));
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
        std::move(fused.road), metric,      std::move(fused.reports), {}, 0.0, std::move(markings),
        std::move(width),      scale_change};
    if (metric)
      admit_contradictions(frames, matches, ground, raster, travel, prior, constraints, options,
                           &out);
    return out;
  }
}

}  // namespace camber::stages
