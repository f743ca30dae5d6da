#include "camber/scene/findings.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

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

/// Whether the focal length makes more of what is not known than all else.
bool by_focal_length(const RunDocument& run) {
  return run.calibration &&
         2.0 * std::pow(run.calibration->sigma_of_scale, 2) > std::pow(run.scale_sigma, 2);
}

/// "since the field of view is known to 5 degrees only (70)"; empty where something else counts.
std::string since_field_of_view(const RunDocument& run) {
  constexpr double kDegrees = 57.29577951308232, kCertain = 0.01;  // relative, of the focal length
  if (!by_focal_length(run) || run.calibration->sigma.focal < kCertain) return "";
  return fmt::format(", since the field of view is known to {:.2g} degrees only ({:.0f})",
                     kDegrees * run.calibration->field_of_view_sigma,
                     kDegrees * run.calibration->field_of_view);
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
    out += since_field_of_view(run);
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
        "No vehicles, as the scene has no boxes of them: --detector shipped (or FILE.onnx) of "
        "camber reconstruct finds some, --detections FILE of camber import takes those of any "
        "detector.",
        false};
  }
  return {"No vehicles: the scene's boxes (" + document.detections_source +
              ") are in none of these frames.",
          false};
}

}  // namespace

std::string scale_sentence(const RunDocument& run) {
  if (!run.metric) return "the result is up to scale";
  return fmt::format("distances known to {:.1f} % (1 sigma){}", 100.0 * run.scale_sigma,
                     since_field_of_view(run));
}

namespace {

/// What would show more of the road. @param surface  may be null.
std::string more_road(const RunDocument& run, const RoadSurface* surface) {
  if (surface && surface->frame != "camera") {
    return "points there: a denser scan, or one from another place";
  }
  std::string out = "--frames with more frames, or with frames farther apart";
  const auto from = run.extra->find("road_from");
  if (from == run.extra->end() || *from != "mask") {
    out +=
        "; --segmenter, or road masks in the scene, where the road is not told from what "
        "surrounds it";
  }
  return out;
}

/// What would make the scale better known, by what it is known by now.
std::string more_scale(const RunDocument& run) {
  const auto used = [&](const char* name) {
    return std::any_of(run.constraints.begin(), run.constraints.end(),
                       [&](const ConstraintReport& c) { return c.name == name && c.accepted; });
  };
  if (run.metric && by_focal_length(run)) {
    return "of camber import: --calib, or --fov with a smaller --fov-sigma";
  }
  std::string out = "of camber import: ";
  if (!run.metric || !used("camera_height"))
    out += "--height, the camera's height above the road; ";
  if (!used("speed")) out += "--speed; ";
  if (!used("known_poses")) out += "--poses; ";
  return out + "sources that know nothing of each other make it better known";
}

/// "1, 2, 5", the first dozen of them.
std::string listed(const std::vector<std::string>& names) {
  constexpr std::size_t kMost = 8;
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
    out.push_back(
        {"scale", std::string(to_string(run.scale_status)), run.scale_reason, more_scale(run)});
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
      out.push_back({"road", "failed", "no patch was found", more_road(run, surface)});
    }
    Grouped patches;
    for (const PlanePatch& patch : surface->patches) {
      patches.add(std::to_string(patch.id), patch.status, patch.reason);
    }
    patches.append_to(&out, "patch ", more_road(run, surface));
  }
  if (vehicles) {
    Grouped placed;
    for (const VehicleFrame& frame : vehicles->frames) {
      for (const VehicleEstimate& vehicle : frame.vehicles) {
        placed.add(fmt::format("id {} of frame {}", vehicle.id, frame.id), vehicle.status,
                   vehicle.reason);
      }
    }
    placed.append_to(&out, "vehicle ",
                     "keypoints (--keypoints shipped) place a vehicle better than its box; " +
                         more_road(run, surface));
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
