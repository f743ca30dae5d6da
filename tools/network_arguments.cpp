#include "network_arguments.h"

#include <fmt/format.h>

#include "camber/core/errors.h"

namespace camber::tools {

void add_network_options(App& app, NetworkArguments& a) {
  app.add_option("--detector", a.choice.detector,
                 "the network that finds vehicles: shipped (comes with Camber), an ONNX file, or "
                 "none. YOLOX, YOLOv5, YOLOv8, YOLO11 and FastestDet are known by their outputs, "
                 "others need a .json of the same name (docs/formats.md). Without it reconstruct "
                 "places what the shipped one finds where the scene has no boxes");
  app.add_option("--detector-config", a.choice.detector_config,
                 "the description, where it is another file");
  app.add_option("--segmenter", a.choice.segmenter,
                 "ONNX file of a network that shows the road, described by a .json of the same "
                 "name");
  app.add_option("--segmenter-config", a.choice.segmenter_config,
                 "the description, where it is another file");
  app.add_option("--keypoints", a.choice.keypoints,
                 "the network that finds the 36 keypoints: shipped, an ONNX file described by a "
                 ".json of the same name, or none; given keypoints are replaced. Default: shipped, "
                 "where no vehicle of the scene has keypoints");
  app.add_option("--keypoints-config", a.choice.keypoints_config,
                 "the description, where it is another file");
  app.add_option("--cache", a.cache,
                 "folder that keeps results of networks by content; default: $CAMBER_CACHE, else "
                 "camber in $XDG_CACHE_HOME or ~/.cache");
  app.add_flag("--no-cache", a.no_cache, "keep no results of networks")->excludes("--cache");
}

NetworkChoice choice_of(const NetworkArguments& a) {
  NetworkChoice out = a.choice;
  if (a.no_cache) {
    out.cache.clear();
  } else if (!a.cache.empty()) {
    out.cache = a.cache;
  }
  const auto check = [](const std::string& config, bool network, const char* name) {
    if (config.empty() || network) return;
    throw UsageError(
        fmt::format("--{0}-config {1}: expected --{0} beside it, with a file", name, config));
  };
  check(out.detector_config, !out.detector.empty() && out.detector != kNoNetwork, "detector");
  check(out.segmenter_config, !out.segmenter.empty(), "segmenter");
  check(out.keypoints_config,
        !out.keypoints.empty() && out.keypoints != kShippedNetwork && out.keypoints != kNoNetwork,
        "keypoints");
  return out;
}

}  // namespace camber::tools
