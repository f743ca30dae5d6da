#include "network_arguments.h"

#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/pipeline/network_file.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

constexpr const char* kNoNetwork = "none";

/// Where results of networks are kept: $CAMBER_CACHE, $XDG_CACHE_HOME/camber, ~/.cache/camber;
/// empty where none is known.
fs::path cache_folder() {
  const auto variable = [](const char* name) -> fs::path {
    const char* text = std::getenv(name);
    return text ? text : "";
  };
  if (const fs::path own = variable("CAMBER_CACHE"); !own.empty()) return own / "networks";
  if (const fs::path user = variable("XDG_CACHE_HOME"); user.is_absolute()) {
    return user / "camber/networks";
  }
  if (const fs::path home = variable("HOME"); home.is_absolute()) {
    return home / ".cache/camber/networks";
  }
  return {};
}

nlohmann::json use_json(const std::optional<NetworkUse>& use) {
  if (!use) return nullptr;
  return {{"file", use->file},     {"hash", use->hash},         {"name", use->name},
          {"layers", use->layers}, {"computed", use->computed}, {"cached", use->cached}};
}

std::string unfused_note(const std::optional<NetworkUse>& use) {
  if (!use || use->layers != "unfused") return {};
  return fmt::format(
      "  {}: joining its layers changes its result in this OpenCV; it is run without\n", use->file);
}

}  // namespace

void add_network_options(App& app, NetworkArguments& a) {
  app.add_option("--detector", a.detector,
                 "the network that finds vehicles: shipped (comes with Camber), an ONNX file, or "
                 "none. YOLOX, YOLOv5, YOLOv8, YOLO11 and FastestDet are known by their outputs, "
                 "others need a .json of the same name (docs/formats.md). Without it reconstruct "
                 "places what the shipped one finds where the scene has no boxes");
  app.add_option("--detector-config", a.detector_config,
                 "the description, where it is another file");
  app.add_option("--segmenter", a.segmenter,
                 "ONNX file of a network that shows the road, described by a .json of the same "
                 "name");
  app.add_option("--segmenter-config", a.segmenter_config,
                 "the description, where it is another file");
  app.add_option("--keypoints", a.keypoints,
                 "the network that finds the 36 keypoints: shipped, an ONNX file described by a "
                 ".json of the same name, or none; given keypoints are replaced. Default: shipped, "
                 "where no vehicle of the scene has keypoints");
  app.add_option("--keypoints-config", a.keypoints_config,
                 "the description, where it is another file");
  app.add_option("--cache", a.cache,
                 "folder that keeps results of networks by content; default: $CAMBER_CACHE, else "
                 "camber in $XDG_CACHE_HOME or ~/.cache");
  app.add_flag("--no-cache", a.no_cache, "keep no results of networks")->excludes("--cache");
}

DetectFramesOptions detect_options(const NetworkArguments& a, int num_threads) {
  if (!a.detector_config.empty() && a.detector.empty()) {
    throw UsageError("--detector-config " + a.detector_config + ": expected --detector beside it");
  }
  if (!a.segmenter_config.empty() && a.segmenter.empty()) {
    throw UsageError("--segmenter-config " + a.segmenter_config +
                     ": expected --segmenter beside it");
  }
  if (a.detector == kNoNetwork && !a.detector_config.empty()) {
    throw UsageError("--detector-config " + a.detector_config +
                     ": expected --detector with a file beside it");
  }
  DetectFramesOptions out;
  out.networks = {a.detector == kNoNetwork ? "" : a.detector, a.segmenter, a.detector_config,
                  a.segmenter_config};
  if (!a.no_cache) out.cache = a.cache.empty() ? cache_folder() : fs::path(a.cache);
  out.num_threads = num_threads;
  return out;
}

FindKeypointsOptions keypoint_options(const NetworkArguments& a, int num_threads) {
  const bool file =
      !a.keypoints.empty() && a.keypoints != kShippedNetwork && a.keypoints != kNoNetwork;
  if (!a.keypoints_config.empty() && !file) {
    throw UsageError("--keypoints-config " + a.keypoints_config +
                     ": expected --keypoints with a file beside it");
  }
  FindKeypointsOptions out;
  out.num_threads = num_threads;
  if (a.keypoints.empty()) return out;
  out.choice = a.keypoints == kNoNetwork ? KeypointChoice::kNone : KeypointChoice::kAll;
  if (file) out.network = a.keypoints;
  out.config = a.keypoints_config;
  return out;
}

std::vector<fs::path> files_of(const FindKeypointsOptions& keypoints) {
  if (keypoints.network == kShippedNetwork) return {};
  return {keypoints.network, side_file_of(keypoints.network, keypoints.config)};
}

std::vector<fs::path> files_of(const NetworkFiles& networks) {
  std::vector<fs::path> out;
  if (!networks.detector.empty() && !networks.detector_ships()) {
    out.push_back(networks.detector);
    out.push_back(side_file_of(networks.detector, networks.detector_config));
  }
  if (!networks.segmenter.empty()) {
    out.push_back(networks.segmenter);
    out.push_back(side_file_of(networks.segmenter, networks.segmenter_config));
  }
  return out;
}

nlohmann::json network_json(const NetworkView& view, const std::optional<NetworkUse>& keypoints,
                            const std::optional<NetworkUse>& masking) {
  return {{"detector", use_json(view.detector)},
          {"segmenter", use_json(view.segmenter)},
          {"keypoints", use_json(keypoints)},
          {"vehicle_masks", use_json(masking)}};
}

std::string describe(const NetworkView& view, const std::optional<NetworkUse>& keypoints) {
  std::string out;
  if (view.detector) {
    std::size_t boxes = 0;
    for (const auto& [id, vehicles] : view.vehicles) boxes += vehicles.size();
    out += fmt::format("  {} vehicles in {} frames ({} from the cache)\n", boxes,
                       view.vehicles.size(), view.detector->cached);
  }
  if (view.segmenter) {
    out += fmt::format("  masks of {} frames ({} from the cache)\n", view.labels.size(),
                       view.segmenter->cached);
  }
  if (keypoints) {
    out += fmt::format("  keypoints of {} vehicles ({})\n", keypoints->computed, keypoints->file);
  }
  return out + unfused_note(view.detector) + unfused_note(view.segmenter) + unfused_note(keypoints);
}

}  // namespace camber::tools
