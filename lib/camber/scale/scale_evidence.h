#pragma once

#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace camber {

/// What is wrong where a source measures a wrong scale.
enum class EvidenceCause {
  kLayer,           ///< what was found is no road, but what it mirrors, or another repetition
  kHeight,          ///< of the camera
  kFocalLength,     ///< its logarithm is what is measured
  kPrincipalPoint,  ///< or the mounting: the camera looks elsewhere
  kPoses,           ///< that were given
  kMarkings,        ///< sizes of paint, or of the road
  kVehicles,        ///< their sizes
  kSpeed,
};
/// "layer", "height", "focal_length", "principal_point", "poses", "markings", "vehicles", "speed".
std::string to_string(EvidenceCause cause);
/// Inverse of to_string. @throws std::invalid_argument for another word.
EvidenceCause evidence_cause_from_string(const std::string& word);

/// A source against the result or against all other sources.
struct Disagreement {
  double log_ratio = 0.0;  ///< logarithm of what the source measures over what the others do
  double sigmas = 0.0;     ///< standard deviations; NaN: nothing was measured
  std::string text;        ///< what the source shows, a sentence for whoever reads a warning
  bool plain = true;       ///< false: something else may explain it
};

/// "everything is 12 % larger".
std::string larger_or_smaller(double log_ratio);

/// What one source knows of a run's scale, or of its focal length, and how it can be wrong.
struct ScaleEvidence {
  std::string name;    ///< "camera_height", "plane_search", ...
  std::string source;  ///< what was measured here, a phrase
  EvidenceCause cause = EvidenceCause::kLayer;
  /// Change of the logarithm of the result's scale (metres per baseline), or, where the cause is
  /// the focal length, of the given one.
  double log_scale = 0.0;
  /// Standard deviation of that, about the road's shape with its scale open: what the fused scale
  /// knows is not in it. NaN: it measures no scale, see `measured`.
  double sigma = std::numeric_limits<double>::quiet_NaN();
  double freedom = std::numeric_limits<double>::infinity();  ///< degrees of freedom (Student), > 0
  double wrong_share = 0.0;         ///< probability that it knows nothing, in [0, 1]
  std::vector<std::string> shares;  ///< errors in common with others and other runs: "height", ...
  std::vector<std::pair<std::string, double>> measured;  ///< statistics by name
  std::optional<Disagreement> against_others;            ///< not in files: what rules decide by
};

/// Evidence of a known name with what is measured of how such a source errs: its cause, degrees of
/// freedom, probability that it knows nothing, and common errors.
/// @throws std::invalid_argument for a name that is none.
ScaleEvidence evidence_of(const std::string& name, std::string source, double log_scale,
                          double sigma);

}  // namespace camber
