#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/pipeline/stages/road_layer.h"
#include "camber/pipeline/stages/scale.h"
#include "camber/pipeline/stages/vehicles.h"
#include "camber/scale/scale_evidence.h"
#include "camber/scene/results.h"

namespace camber {

/// How well the scale is known, in a word.
struct ScaleVerdict {
  double sigma = 0.0;  ///< of the logarithm of the scale
  Status status = Status::kNotRun;
  std::string reason;  ///< unless kOk
};

/// A run's road as it is handed out, and what is to be thought of its scale.
struct JudgedRoad {
  RoadPosterior road;  ///< given the vehicles; its scale as uncertain as the verdict
  bool metric = true;
  ScaleVerdict scale;
  /// Variance of the logarithm of the scale by what contradicts it: in the road, not in what was
  /// placed on it before.
  double contradiction_variance = 0.0;
  /// The part of it by what is wrong in every window of a camera: its height, focal length, speeds,
  /// sizes; not its road.
  double common_contradiction_variance = 0.0;
  std::vector<ConstraintReport> of_vehicles;  ///< in the order of PlacedVehicles::constraints
  std::vector<ConstraintReport> reports;      ///< of all sources and checks
  std::vector<RunDocument::Warning> warnings;
  std::vector<ScaleEvidence> evidence;  ///< about the scale of `road`
};

/// The scale of a run is not known.
class UnknownScaleError : public NoAnswerError {
 public:
  UnknownScaleError(const std::string& reason, std::vector<ScaleEvidence> evidence)
      : NoAnswerError(reason), evidence_(std::move(evidence)) {}
  /// About the scale that was not handed out.
  const std::vector<ScaleEvidence>& evidence() const { return evidence_; }

 private:
  std::vector<ScaleEvidence> evidence_;
};

namespace stages {

struct JudgeOptions {
  ScaleNoise noise;  ///< as that of ScaleOptions
};

/// The only place that decides about a run's scale: how uncertain it is, whether it is weak, what
/// is warned of, and whether there is an answer at all. Conditions the road on what the vehicles
/// measure of it.
/// @param layer  nothing: of one image, whose road is that of its markings.
/// @throws UnknownScaleError
JudgedRoad judge(const ScaledRoad& scaled, const std::optional<RoadLayer>& layer,
                 const PlacedVehicles& vehicles, const JudgeOptions& options);

/// Of a scale that nothing is compared with.
/// @param without_metres  why, where it is not metric.
ScaleVerdict judge_alone(double sigma, bool metric, const std::string& without_metres);

/// Writes it where readers look for it.
void state(const ScaleVerdict& verdict, RunDocument* run, RoadSurface* surface);

}  // namespace stages
}  // namespace camber
