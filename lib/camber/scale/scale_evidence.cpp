#include "camber/scale/scale_evidence.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

namespace camber {
namespace {

constexpr std::array<std::pair<EvidenceCause, const char*>, 8> kCauses = {{
    {EvidenceCause::kLayer, "layer"},
    {EvidenceCause::kHeight, "height"},
    {EvidenceCause::kFocalLength, "focal_length"},
    {EvidenceCause::kPrincipalPoint, "principal_point"},
    {EvidenceCause::kPoses, "poses"},
    {EvidenceCause::kMarkings, "markings"},
    {EvidenceCause::kVehicles, "vehicles"},
    {EvidenceCause::kSpeed, "speed"},
}};

/// How a source errs. A new source is a line here.
struct Source {
  const char* name;
  EvidenceCause cause;
  double freedom;      // Student's, of its error over its sigma
  double wrong_share;  // of runs in which it knows nothing
  std::array<const char*, 2> shares;
};

// Assumed until fitted (tests/benchmarks/replay_scale.py): Student's with 4 degrees of freedom,
// 1 % for what was typed in, 5 % for what was found in images.
constexpr std::array<Source, 13> kSources = {{
    {"camera_height", EvidenceCause::kHeight, 4.0, 0.01, {"height", "road_shape"}},
    {"known_poses", EvidenceCause::kPoses, 4.0, 0.01, {}},
    {"speed", EvidenceCause::kSpeed, 4.0, 0.01, {}},
    {"lane_markings", EvidenceCause::kMarkings, 4.0, 0.05, {"paint", "road_shape"}},
    {"unmatched_markings", EvidenceCause::kMarkings, 4.0, 0.05, {"paint"}},
    {"road_width", EvidenceCause::kMarkings, 4.0, 0.05, {"road_shape"}},
    {"plane_search", EvidenceCause::kLayer, 4.0, 0.05, {"height"}},
    {"passing_road", EvidenceCause::kLayer, 4.0, 0.05, {"height"}},
    {"intensities", EvidenceCause::kLayer, 4.0, 0.5, {"height"}},
    {"vehicle", EvidenceCause::kVehicles, 3.0, 0.05, {"size_population", "road_shape"}},
    {"focal_length", EvidenceCause::kFocalLength, 4.0, 0.05, {}},
    {"travel_direction", EvidenceCause::kPrincipalPoint, 4.0, 0.05, {}},
    {"road_layer", EvidenceCause::kLayer, 4.0, 0.0, {}},
}};

}  // namespace

std::string to_string(EvidenceCause cause) {
  return std::find_if(kCauses.begin(), kCauses.end(),
                      [&](const auto& c) { return c.first == cause; })
      ->second;
}

EvidenceCause evidence_cause_from_string(const std::string& word) {
  for (const auto& [cause, name] : kCauses) {
    if (word == name) return cause;
  }
  throw std::invalid_argument(
      fmt::format("cause: \"{}\", must be layer, height, focal_length, principal_point, poses, "
                  "markings, vehicles or speed",
                  word));
}

std::string larger_or_smaller(double log_ratio) {
  return fmt::format("everything is {:.0f} % {}", 100.0 * std::abs(std::expm1(log_ratio)),
                     log_ratio > 0.0 ? "larger" : "smaller");
}

ScaleEvidence evidence_of(const std::string& name, std::string source, double log_scale,
                          double sigma) {
  for (const Source& known : kSources) {
    if (name != known.name) continue;
    ScaleEvidence out;
    out.name = name;
    out.source = std::move(source);
    out.cause = known.cause;
    out.log_scale = log_scale;
    out.sigma = sigma;
    out.freedom = known.freedom;
    out.wrong_share = known.wrong_share;
    for (const char* share : known.shares) {
      if (share) out.shares.emplace_back(share);
    }
    return out;
  }
  throw std::invalid_argument(fmt::format("evidence: there is no source \"{}\"", name));
}

}  // namespace camber
