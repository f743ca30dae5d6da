#include "camber/scene/findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

namespace camber {
namespace {

std::string counted(std::size_t count, const char* one, const char* many) {
  return fmt::format("{} {}", count, count == 1 ? one : many);
}

/// ", 2 weak (...)": the statuses other than ok with what they mean, in the order of their names.
std::string explained(const std::map<Status, std::size_t>& counts) {
  static const std::array<std::pair<Status, const char*>, 3> kMeanings = {
      {{Status::kWeak, "weak (answered, with a large standard deviation)"},
       {Status::kNotObservable, "not observable (a fallback stands in: do not rely on it)"},
       {Status::kFailed, "failed (no answer)"}}};
  std::string out;
  for (const auto& [status, meaning] : kMeanings) {
    const auto at = counts.find(status);
    if (at != counts.end()) out += fmt::format(", {} {}", at->second, meaning);
  }
  return out;
}

Finding find_road(const RoadSurface& surface) {
  if (surface.patches.empty()) return {"No road patch was found.", false};
  std::map<Status, std::size_t> counts;
  double farthest = 0.0;
  for (const PlanePatch& patch : surface.patches) {
    ++counts[patch.status];
    if (patch.kind != PatchKind::kRoad && patch.kind != PatchKind::kGround) continue;
    for (const Eigen::Vector3d& corner : patch.boundary) farthest = std::max(farthest, corner.z());
  }
  std::string out = "Road: " + counted(surface.patches.size(), "planar patch", "planar patches");
  if (surface.frame == "camera" && std::isfinite(farthest) && farthest > 0.0) {
    out += fmt::format(", to {:.0f} {} ahead", farthest, surface.metric ? "m" : "units");
  }
  return {out + explained(counts) + ".", counts[Status::kOk] == surface.patches.size()};
}

Finding find_scale(const RunDocument& run) {
  if (!run.metric) {
    std::string out = "Lengths are in units, not in metres";
    if (!run.scale_reason.empty()) out += " (" + run.scale_reason + ")";
    out +=
        ": the camera's height above the road gives them (--height of camber import), or its "
        "speed (--speed), or known poses (--poses).";
    return {out, false};
  }
  std::string sources;
  for (const ConstraintReport& constraint : run.constraints) {
    // The plane search is a check, no source.
    if (!constraint.accepted || constraint.name == "plane_search") continue;
    std::string name = constraint.name;
    std::replace(name.begin(), name.end(), '_', ' ');
    if (sources.find(name) == std::string::npos) sources += (sources.empty() ? "" : ", ") + name;
  }
  std::string out = "Lengths are in metres";
  if (run.scale_sigma > 0.0) {
    out += fmt::format(", known to {:.1f} % (1 sigma)", 100.0 * run.scale_sigma);
  }
  if (!sources.empty()) out += " (" + sources + ")";
  out += ".";
  const bool weak = run.scale_status == Status::kWeak || run.scale_status == Status::kNotObservable;
  if (weak) {
    out += " That is weak";
    out += run.scale_reason.empty() ? "." : ": " + run.scale_reason + ".";
  }
  return {out, !weak};
}

Finding find_vehicles(const VehicleDocument& document) {
  std::size_t all = 0;
  std::map<Status, std::size_t> counts;
  for (const VehicleFrame& frame : document.frames) {
    for (const VehicleEstimate& vehicle : frame.vehicles) {
      ++all;
      ++counts[vehicle.status];
    }
  }
  if (all > 0) {
    return {"Vehicles: " + std::to_string(all) + " in " +
                counted(document.frames.size(), "frame", "frames") + explained(counts) + ".",
            counts[Status::kOk] == all};
  }
  if (document.detections_source.empty()) {
    return {
        "No vehicles, as the scene has no boxes of them: --detections FILE of camber import takes "
        "those of any detector, --detector FILE.onnx of camber reconstruct runs one.",
        false};
  }
  return {"No vehicles: the scene's boxes (" + document.detections_source +
              ") are in none of these frames.",
          false};
}

}  // namespace

namespace {

const char* const kMoreFrames =
    "--frames with more frames, or with frames farther apart; --segmenter, or road masks in the "
    "scene, where the road is not told from what surrounds it";

/// "1, 2, 5", the first dozen of them.
std::string listed(const std::vector<std::string>& names) {
  constexpr std::size_t kMost = 12;
  std::string out;
  for (std::size_t i = 0; i < std::min(names.size(), kMost); ++i) {
    out += (i > 0 ? ", " : "") + names[i];
  }
  if (names.size() > kMost) out += fmt::format(" and {} more", names.size() - kMost);
  return out;
}

/// Things with the same status and reason on one line, by their order.
class Grouped {
 public:
  void add(const std::string& name, Status status, const std::string& reason) {
    if (status == Status::kOk) return;
    const auto found = std::find_if(groups_.begin(), groups_.end(), [&](const Group& group) {
      return group.status == status && group.reason == reason;
    });
    Group& group = found != groups_.end() ? *found : groups_.emplace_back();
    group.status = status;
    group.reason = reason;
    group.names.push_back(name);
  }
  void append_to(std::vector<Shortcoming>* out, const std::string& kind,
                 const std::string& remedy) const {
    for (const Group& group : groups_) {
      out->push_back(
          {kind + listed(group.names), std::string(to_string(group.status)), group.reason, remedy});
    }
  }

 private:
  struct Group {
    Status status = Status::kOk;
    std::string reason;
    std::vector<std::string> names;
  };
  std::vector<Group> groups_;
};

}  // namespace

std::vector<Shortcoming> shortcomings(const RunDocument& run, const RoadSurface* surface,
                                      const VehicleDocument* vehicles) {
  std::vector<Shortcoming> out;
  if (!run.metric || run.scale_status == Status::kWeak ||
      run.scale_status == Status::kNotObservable || run.scale_status == Status::kFailed) {
    out.push_back({"scale", std::string(to_string(run.scale_status)), run.scale_reason,
                   "of camber import: --height, the camera's height above the road; --speed; "
                   "--poses. Sources that know nothing of each other make it better known."});
  }
  for (const ConstraintReport& constraint : run.constraints) {
    // A source of which nothing was measured is no shortcoming: few scenes have all.
    const double residual = constraint.residual_sigma;
    if (constraint.accepted || !std::isfinite(residual) || residual == 0.0) continue;
    std::string name = constraint.name;
    std::replace(name.begin(), name.end(), '_', ' ');
    const std::string reason =
        fmt::format("{}{}{:.1f} sigma from the others", constraint.reason,
                    constraint.reason.empty() ? "" : "; ", std::abs(residual));
    out.push_back({"source of scale or road: " + name, "not used", reason, ""});
  }
  if (surface) {
    if (surface->patches.empty()) {
      out.push_back({"road", "failed", "no patch was found", kMoreFrames});
    }
    Grouped patches;
    for (const PlanePatch& patch : surface->patches) {
      patches.add(std::to_string(patch.id), patch.status, patch.reason);
    }
    patches.append_to(&out, "patch ", kMoreFrames);
  }
  if (vehicles) {
    Grouped placed;
    for (const VehicleFrame& frame : vehicles->frames) {
      for (const VehicleEstimate& vehicle : frame.vehicles) {
        placed.add(fmt::format("id {} of frame {}", vehicle.id, frame.id), vehicle.status,
                   vehicle.reason);
      }
    }
    placed.append_to(
        &out, "vehicle ",
        "keypoints (camber detect --keypoints shipped) place a vehicle better than its "
        "box; " +
            std::string(kMoreFrames));
  }
  for (const RunDocument::Warning& warning : run.warnings) {
    std::string code = warning.code;
    std::replace(code.begin(), code.end(), '_', ' ');
    out.push_back({"warning: " + code, "", warning.text, ""});
  }
  return out;
}

std::vector<Finding> findings(const RunDocument& run, const RoadSurface* surface,
                              const VehicleDocument* vehicles) {
  std::vector<Finding> out;
  if (surface) out.push_back(find_road(*surface));
  out.push_back(find_scale(run));
  if (vehicles) out.push_back(find_vehicles(*vehicles));
  return out;
}

}  // namespace camber
