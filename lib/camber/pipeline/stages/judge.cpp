#include "camber/pipeline/stages/judge.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "camber/pipeline/stages/detail/patch_status.h"
#include "camber/scale/fusion.h"
#include "camber/scale/vehicle_sizes.h"

namespace camber::stages {
namespace {

constexpr double kNever = std::numeric_limits<double>::infinity();
constexpr const char* kScale = "scale_contradicted";
constexpr const char* kFocalLength = "focal_length_contradicted";

/// How the squares of what several findings differ by join.
enum class Joining {
  kLargest,  ///< they may have one cause
  kAdded,    ///< to all before: it knows nothing of them
  kExcess,   ///< what it has more than all before
};

/// Whose error it may be.
enum class Reach {
  kWindow,  ///< of one window: its road
  kCamera,  ///< of all windows: height, focal length, mounting, speeds, sizes
};

/// What follows from a finding that is so many standard deviations off the others.
struct Rule {
  const char* name;
  double widens_from;  ///< from here on the scale is widened, by ever more of the difference
  double all_from;     ///< from here on by all of it
  double named_from;   ///< from here on it is warned of
  const char* code;
  Joining joining;
  Reach reach;
  const char* reported_as;  ///< among the constraints of run.json; null: it is there already
};

/// The rules, in the order in which warnings are given.
std::array<Rule, 17> rules(const ScaleNoise& noise) {
  const double start = noise.contradiction_start, gate = Constraint().gate;
  constexpr auto kLargest = Joining::kLargest;
  constexpr auto kWindow = Reach::kWindow, kCamera = Reach::kCamera;
  const auto source = [&](const char* name, Reach reach) {
    return Rule{name, start, gate, gate, kScale, kLargest, reach, nullptr};
  };
  const auto check = [](const char* name, double from, const char* code, Joining joining,
                        Reach reach, const char* reported_as) {
    return Rule{name, from, from, from, code, joining, reach, reported_as};
  };
  constexpr double kPlainlyOff = 1.0;  // of its limit
  return {{
      source("known_poses", kWindow),
      source("camera_height", kCamera),
      source("speed", kCamera),
      source("lane_markings", kCamera),
      source("road_width", kWindow),
      check("travel_direction", kPlainlyOff, kScale, kLargest, kCamera, nullptr),
      {"intensities", 0.0, 0.0, noise.gate, kScale, kLargest, kWindow, nullptr},
      {"unfound_share", 0.0, 0.0, kNever, kScale, kLargest, kWindow, nullptr},
      check("unfound_road", kPlainlyOff, kScale, kLargest, kWindow, nullptr),
      {"alternative_spread", 0.0, 0.0, kNever, kScale, kLargest, kWindow, nullptr},
      check("off_road", kPlainlyOff, kScale, kLargest, kWindow, nullptr),
      check("plane_search", noise.gate, kScale, kLargest, kWindow, "plane_search"),
      check("turn", noise.gate, kFocalLength, kLargest, kCamera, "focal_length"),
      check("unmatched_markings", kPlainlyOff, kScale, kLargest, kCamera, nullptr),
      {"vehicle_sizes", noise.vehicle_sizes_start, noise.vehicle_sizes_gate,
       noise.vehicle_sizes_gate, kScale, Joining::kAdded, kCamera, "vehicle_sizes"},
      check("dashes", noise.gate, kFocalLength, Joining::kExcess, kCamera, "focal_length"),
      check("proportions", noise.focal_length_gate, kFocalLength, Joining::kExcess, kCamera,
            "focal_length"),
  }};
}

/// What a rule is about.
struct Finding {
  std::string rule, source;
  std::string who;  // before the text of a warning; empty: that stands alone
  Disagreement off;
};

double share_of(const Rule& rule, double sigmas) {
  if (rule.all_from > rule.widens_from) {
    return contradiction_share(sigmas, rule.widens_from, rule.all_from);
  }
  return sigmas > rule.widens_from ? 1.0 : 0.0;
}

/// What the evidence of sources and checks disagrees about.
std::vector<Finding> findings_of(const std::vector<ScaleEvidence>& evidence) {
  std::vector<Finding> out;
  for (const ScaleEvidence& e : evidence) {
    if (!e.against_others) continue;
    if (e.name == "focal_length") {
      out.push_back({"turn", e.source, e.source, *e.against_others});
    } else {
      const bool reported = e.name == "plane_search";
      out.push_back({e.name, e.source, reported ? e.name : "", *e.against_others});
    }
  }
  return out;
}

/// Where a mask's road is hardly found, or much else is matched over the driven path, the road may
/// be another layer.
std::vector<Finding> findings_of(const RoadLayer& layer, const ScaleNoise& noise) {
  std::vector<Finding> out;
  if (layer.masked) {
    const double unfound = 1.0 - layer.found;
    out.push_back({"unfound_share", "", "", {noise.unfound_share * unfound * unfound, 1.0, ""}});
    const double least = layer.search == RoadLayer::Search::kAmbiguous ? noise.least_found_ambiguous
                         : layer.search == RoadLayer::Search::kInformative
                             ? noise.least_found
                             : noise.least_found_alone;
    out.push_back({"unfound_road",
                   "",
                   "",
                   {noise.hardly_known, layer.found < least ? kNever : 0.0,
                    fmt::format("matches: only {:.0f} % of the masked road is found in the other "
                                "images",
                                100.0 * layer.found)}});
  }
  out.push_back({"alternative_spread", "", "", {layer.alternative_spread, 1.0, ""}});
  out.push_back({"off_road",
                 "",
                 "",
                 {noise.hardly_known, layer.off_road / noise.most_off_road,
                  fmt::format("matches: {:.0f} % of those over the driven path are off the road "
                              "that is found there",
                              100.0 * layer.off_road)}});
  return out;
}

/// Why no scale is handed out, by the layer alone; empty: it may be.
std::string unknown_by_layer(const RoadLayer& layer, bool metric, const ScaleNoise& noise) {
  if (layer.agreeing < noise.least_agreeing) {
    return fmt::format(
        "no road plane under the camera: {:.0f} % of the points near the driven path agree with "
        "one road",
        100.0 * layer.agreeing);
  }
  if (metric && layer.obstacles > noise.most_obstacles) {
    return fmt::format(
        "the scale is not known: {:.0f} % of what is matched beside the road would obstruct the "
        "driven path; the road is likely found at another layer, as what it mirrors or a texture "
        "that repeats",
        100.0 * layer.obstacles);
  }
  return {};
}

/// The sizes of several vehicles together.
std::optional<Finding> finding_of(const std::optional<VehicleSizes>& sizes) {
  if (!sizes) return std::nullopt;
  const double change = sizes->log_scale;
  const std::string source = fmt::format("{} vehicles", sizes->vehicles);
  return Finding{"vehicle_sizes",
                 source,
                 source,
                 {change, sizes->sigmas_off,
                  fmt::format("by their sizes {}, {:.1f} standard deviations",
                              larger_or_smaller(change), sizes->sigmas_off)}};
}

/// The focal length by broken lines.
std::optional<Finding> finding_of(const DashFocalLength& dashes,
                                  const FocalLengthEvidence& vehicles, const ScaleNoise& noise) {
  if (dashes.strokes == 0) return std::nullopt;
  const bool one = dashes.strokes == 1;
  const double log_factor = std::log(dashes.factor);
  const double sigmas = std::abs(log_factor) / noise.dash_focal_length;
  const std::string source =
      one ? "a stroke of a broken line" : fmt::format("{} strokes of broken lines", dashes.strokes);
  Finding out{"dashes",
              source,
              source,
              {log_factor, sigmas,
               fmt::format("{} with {:.2f} times the focal length, {:.1f} standard deviations",
                           one ? "it has the known length" : "they have the known sizes",
                           dashes.factor, sigmas)}};
  if (vehicles.log_ratio_of_other <= -noise.vehicles_against_dashes) {
    out.off.plain = false;
    out.off.text += "; vehicles' proportions contradict that, the known sizes may be wrong";
  }
  return out;
}

/// The focal length by the vehicles' proportions.
std::optional<Finding> finding_of(const FocalLengthEvidence& vehicles) {
  if (vehicles.vehicles == 0) return std::nullopt;
  const double sigmas = std::sqrt(2.0 * vehicles.gain);
  const std::string source = vehicles.vehicles == 1
                                 ? "proportions of a vehicle"
                                 : fmt::format("proportions of {} vehicles", vehicles.vehicles);
  return Finding{
      "proportions",
      source,
      source,
      {std::log(vehicles.factor), sigmas,
       fmt::format("they fit {:.1f} standard deviations better with {:.2f} times the focal length",
                   sigmas, vehicles.factor)}};
}

/// Nearly all vehicles contradict the road under them.
/// @return in words; empty: they do not.
std::string contradicting_vehicles(const std::vector<ConstraintReport>& reports,
                                   const ScaleNoise& noise) {
  const auto beyond = [&](double sigmas) {
    return static_cast<std::size_t>(std::count_if(
        reports.begin(), reports.end(),
        [&](const ConstraintReport& r) { return !r.accepted && r.residual_sigma > sigmas; }));
  };
  const std::size_t rejected = beyond(0.0), contradicting = beyond(noise.gate);
  // One may well be beyond what the fusion takes; that all are is the road.
  constexpr std::size_t kLeast = 3, kLeastOfAll = 4;
  const bool most = reports.size() >= kLeast && 3 * contradicting > 2 * reports.size();
  const bool all = reports.size() >= kLeastOfAll && rejected == reports.size();
  if (!most && !all) return {};
  return fmt::format("{} of {} vehicles contradict the road under them",
                     all ? rejected : contradicting, reports.size());
}

/// Of the vehicles, one by one, and of the focal length by them and by broken lines.
void add_vehicles(const ScaledRoad& scaled, const PlacedVehicles& placed, const ScaleNoise& noise,
                  std::vector<ScaleEvidence>* evidence) {
  const double known = std::pow(scaled.road.scale_sigma(), 2);
  for (const VehicleConstraint& v : placed.constraints) {
    const auto implied = implied_log_scale(scaled.road, v.constraint);
    if (!implied) continue;
    // At least a tenth: what the road's shape and its scale leave open together is in both.
    const double own = std::max(implied->variance - known, 0.1 * implied->variance);
    evidence->push_back(evidence_of("vehicle", v.constraint.source, implied->mean, std::sqrt(own)));
  }
  const DashFocalLength& dashes = scaled.dash_focal_length;
  if (dashes.strokes > 0) {
    evidence->push_back(evidence_of("focal_length",
                                    fmt::format("{} strokes of broken lines", dashes.strokes),
                                    std::log(dashes.factor), noise.dash_focal_length));
    evidence->back().measured = {{"vehicles_log_ratio", placed.focal_length.log_ratio_of_other}};
  }
  const FocalLengthEvidence& proportions = placed.focal_length;
  if (proportions.vehicles > 0) {
    const double log_factor = std::log(proportions.factor);
    evidence->push_back(evidence_of(
        "focal_length", fmt::format("proportions of {} vehicles", proportions.vehicles), log_factor,
        proportions.gain > 0.0 ? std::abs(log_factor) / std::sqrt(2.0 * proportions.gain)
                               : std::numeric_limits<double>::quiet_NaN()));
    evidence->back().measured = {{"gain", proportions.gain}};
  }
}

/// Applies the rules to findings: widens the scale, warns, and reports.
class Ruling {
 public:
  explicit Ruling(const ScaleNoise& noise) : rules_(rules(noise)) {}

  /// @param joining  of the rules that are applied.
  void apply(const std::vector<Finding>& findings, Joining joining, JudgedRoad* judged) const {
    const double before = judged->contradiction_variance;
    double largest = joining == Joining::kExcess ? before : 0.0;
    for (const Rule& rule : rules_) {
      if (rule.joining != joining) continue;
      for (const Finding& finding : findings) {
        if (finding.rule != rule.name) continue;
        const double variance = apply(rule, finding, judged);
        if (rule.reach == Reach::kCamera) {
          double& common = judged->common_contradiction_variance;
          common = std::max(common, variance);
        }
        if (joining == Joining::kAdded) judged->contradiction_variance += variance;
        largest = std::max(largest, variance);
      }
    }
    if (joining != Joining::kAdded) judged->contradiction_variance = std::max(before, largest);
  }

 private:
  /// @return variance of the logarithm of the scale by this finding.
  static double apply(const Rule& rule, const Finding& finding, JudgedRoad* judged) {
    const Disagreement& off = finding.off;
    const bool beyond = off.sigmas > rule.named_from;
    const bool named = beyond && off.plain;
    if (named) {
      judged->warnings.push_back(
          {rule.code, finding.who.empty() ? off.text : finding.who + ": " + off.text});
    }
    if (rule.reported_as) {
      const bool accepted = rule.joining == Joining::kExcess ? !beyond : !named;
      judged->reports.push_back(
          {rule.reported_as, finding.source, off.sigmas, accepted, accepted ? "" : off.text});
    }
    if (!off.plain && beyond) return 0.0;
    return share_of(rule, off.sigmas) * off.log_ratio * off.log_ratio;
  }

  std::array<Rule, 17> rules_;
};

void shift(double log_scale, std::vector<ScaleEvidence>* evidence) {
  for (ScaleEvidence& e : *evidence) {
    if (e.cause != EvidenceCause::kFocalLength && !std::isnan(e.sigma)) e.log_scale -= log_scale;
  }
}

}  // namespace

JudgedRoad judge(const ScaledRoad& scaled, const std::optional<RoadLayer>& layer,
                 const PlacedVehicles& vehicles, const JudgeOptions& options) {
  const ScaleNoise& noise = options.noise;
  std::vector<ScaleEvidence> evidence = scaled.evidence;
  if (layer) evidence.push_back(evidence_of(*layer));
  add_vehicles(scaled, vehicles, noise, &evidence);
  const std::string unknown = layer ? unknown_by_layer(*layer, scaled.metric, noise) : "";
  if (!unknown.empty()) throw UnknownScaleError(unknown, evidence);

  std::vector<Constraint> constraints;
  for (const VehicleConstraint& v : vehicles.constraints) constraints.push_back(v.constraint);
  FusedRoad fused = fuse(scaled.road, constraints, noise.vehicle_population);
  JudgedRoad out{std::move(fused.road),    scaled.metric,  {}, 0.0, 0.0,
                 std::move(fused.reports), scaled.reports, {}, {}};
  if (scaled.near_road != NearRoadSource::kMatches) {
    out.warnings.push_back(
        {"road_repeated",
         fmt::format("the pictures repeat the asphalt, as films do: the road is a plane, by {}",
                     scaled.near_road == NearRoadSource::kSpeed
                         ? "the given speed and the camera's height"
                         : "what passes on it")});
  }
  const Ruling ruling(noise);
  if (scaled.metric) {
    std::vector<Finding> findings = findings_of(scaled.evidence);
    if (layer) {
      for (Finding& finding : findings_of(*layer, noise)) findings.push_back(std::move(finding));
    }
    ruling.apply(findings, Joining::kLargest, &out);
  }
  out.reports.insert(out.reports.end(), out.of_vehicles.begin(), out.of_vehicles.end());
  if (scaled.metric) {
    const auto sizes = compare_vehicle_sizes(scaled.road, constraints, noise);
    const std::string most = contradicting_vehicles(out.of_vehicles, noise);
    if (!most.empty()) {
      // That their sizes fit a scale that is hardly known proves nothing.
      const bool sizes_fit =
          sizes && sizes->sigmas_off <= noise.vehicle_sizes_gate &&
          std::hypot(scaled.road.scale_sigma(), sizes->sigma) < noise.metric_limit;
      if (!sizes_fit) {
        throw UnknownScaleError("the scale is not known: " + most +
                                    ": are the camera's height and focal length right, and is the "
                                    "road near the camera in view?",
                                evidence);
      }
      out.warnings.push_back({"road_contradicted", most + "; their sizes fit the scale"});
    }
    if (auto finding = finding_of(sizes))
      ruling.apply({std::move(*finding)}, Joining::kAdded, &out);
  }
  std::vector<Finding> focal_lengths;
  for (auto& finding : {finding_of(scaled.dash_focal_length, vehicles.focal_length, noise),
                        finding_of(vehicles.focal_length)}) {
    if (finding) focal_lengths.push_back(*finding);
  }
  ruling.apply(focal_lengths, Joining::kExcess, &out);
  if (!scaled.metric) out.contradiction_variance = 0.0;

  if (out.contradiction_variance > 0.0) {
    out.road = out.road.with_wider_scale(out.contradiction_variance);
  }
  double sigma = out.road.scale_sigma();
  if (scaled.by_ego_height) {
    const UncertainPlane ego = out.road.ego();
    sigma = std::sqrt(ego.covariance(2, 2)) / ego.plane.offset;
  }
  std::string without_metres = scaled.without_metres;
  // What contradicts the camera is no doubt about the road.
  const double of_road = sigma * sigma - out.common_contradiction_variance;
  if (out.metric && layer && layer->repeated && of_road > std::pow(noise.metric_limit, 2)) {
    out.metric = false;
    without_metres = fmt::format(
        "the pictures repeat the asphalt, as films do, which would leave the scale known to {:.0f} "
        "% only",
        100.0 * sigma);
  }
  out.scale = judge_alone(sigma, out.metric, without_metres);
  shift(std::log(out.road.metres_per_baseline() / scaled.road.metres_per_baseline()), &evidence);
  out.evidence = std::move(evidence);
  return out;
}

ScaleVerdict judge_alone(double sigma, bool metric, const std::string& without_metres) {
  if (!metric) return {sigma, Status::kNotObservable, without_metres};
  const detail::Judgement judged = detail::scale_status(sigma);
  return {sigma, judged.status, judged.reason};
}

void state(const ScaleVerdict& verdict, RunDocument* run, RoadSurface* surface) {
  run->scale_sigma = surface->scale_sigma = verdict.sigma;
  run->scale_status = verdict.status;
  run->scale_reason = verdict.reason;
}

}  // namespace camber::stages
