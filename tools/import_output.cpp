#include "import_output.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cstdio>
#include <nlohmann/json.hpp>

#include "camber/core/version.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

/// Counts of what a scene holds.
struct Counts {
  std::size_t frames = 0, detections = 0, masks = 0, poses = 0, speeds = 0, ups = 0, positions = 0;
  std::size_t truth_vehicles = 0, truth_poses = 0, truth_depth = 0;
  bool truth_cloud = false;
};

Counts counts_of(const Scene& scene) {
  Counts out;
  out.frames = scene.frames.size();
  for (const SceneFrame& frame : scene.frames) {
    out.detections += frame.vehicles.size();
    out.masks += frame.segmentation.empty() && frame.road_mask.empty() ? 0 : 1;
    out.poses += frame.world_from_camera ? 1 : 0;
    out.speeds += frame.speed ? 1 : 0;
    out.ups += frame.up ? 1 : 0;
    out.positions += frame.map_position ? 1 : 0;
  }
  if (!scene.truth) return out;
  for (const TruthFrame& frame : scene.truth->frames) {
    out.truth_vehicles += frame.vehicles.size();
    out.truth_poses += frame.world_from_camera ? 1 : 0;
    out.truth_depth += frame.depth.empty() ? 0 : 1;
  }
  out.truth_cloud = !scene.truth->cloud.empty();
  return out;
}

/// "1 frame", "2 frames".
std::string counted(std::size_t count, const std::string& one) {
  return fmt::format("{} {}{}", count, one, count == 1 ? "" : "s");
}

std::string describe(const Scene& scene, const Counts& counts) {
  std::string out = counted(counts.frames, "frame");
  if (counts.frames > 1) {
    out += fmt::format(" ({} to {})", scene.frames.front().id, scene.frames.back().id);
  }
  out += fmt::format(" of {} x {} pixels, ", scene.camera.width, scene.camera.height);
  out += counted(counts.detections, "detection");
  if (counts.detections > 0 && !scene.detections_source.empty()) {
    out += " (" + scene.detections_source + ")";
  }
  if (counts.masks > 0) out += ", " + counted(counts.masks, "mask");
  if (counts.poses > 0) out += ", " + counted(counts.poses, "pose");
  if (counts.speeds > 0) out += ", " + counted(counts.speeds, "speed");
  if (counts.ups > 0) out += ", " + counted(counts.ups, "direction") + " of gravity";
  std::vector<std::string> truth;
  const auto add = [&](std::size_t count, const char* one) {
    if (count > 0) truth.push_back(counted(count, one));
  };
  add(counts.truth_vehicles, "vehicle");
  add(counts.truth_poses, "pose");
  add(counts.truth_depth, "depth image");
  if (counts.truth_cloud) truth.emplace_back("a cloud");
  return out + "; truth: " + (truth.empty() ? "none" : fmt::format("{}", fmt::join(truth, ", ")));
}

}  // namespace

fs::path folder_of(const fs::path& manifest) {
  return manifest.has_parent_path() ? manifest.parent_path() : fs::path(".");
}

void report_import(const Command& command, const Scene& scene, const fs::path& manifest,
                   const ImportNotes& notes, json options, bool as_json, const Timings& timings) {
  const Counts counts = counts_of(scene);
  if (!command.common.quiet) {
    fmt::print(stderr, "camber: {}: {}\n", manifest.string(), describe(scene, counts));
    for (const std::string& note : notes.found) fmt::print(stderr, "  {}\n", note);
    for (const std::string& note : notes.missing) fmt::print(stderr, "  missing: {}\n", note);
  }
  if (!as_json) return;
  json ids = json::array();
  for (const SceneFrame& frame : scene.frames) ids.push_back(frame.id);
  json out = {{"version", kVersion},
              {"seed", command.common.seed},
              {"options", std::move(options)},
              {"scene", manifest.string()},
              {"name", scene.name},
              {"frames", std::move(ids)},
              {"width", scene.camera.width},
              {"height", scene.camera.height},
              {"detections", counts.detections},
              {"detections_source", scene.detections_source},
              {"masks", counts.masks},
              {"poses", counts.poses},
              {"speeds", counts.speeds},
              {"ups", counts.ups},
              {"positions", counts.positions},
              {"map", scene.map_crs},
              {"found", notes.found},
              {"missing", notes.missing},
              {"truth",
               {{"vehicles", counts.truth_vehicles},
                {"poses", counts.truth_poses},
                {"depth", counts.truth_depth},
                {"cloud", counts.truth_cloud}}}};
  out["timings_ms"] = json::object();
  for (const auto& [stage, ms] : timings.stages()) out["timings_ms"][stage] = ms;
  fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
}

}  // namespace camber::tools
