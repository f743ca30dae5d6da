#include "camber/pipeline/network_choice.h"

#include <fmt/format.h>

#include <cstdlib>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/pipeline/network_file.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

bool is_file(const std::string& network) {
  return !network.empty() && network != kShippedNetwork && network != kNoNetwork;
}

void require_network(const std::string& config, bool network, const char* name) {
  if (config.empty() || network) return;
  throw std::invalid_argument(
      fmt::format("{0}_config: found '{1}', expected {0} with a network beside it", name, config));
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

fs::path default_network_cache() {
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

void NetworkChoice::validate() const {
  require_network(detector_config, !detector.empty() && detector != kNoNetwork, "detector");
  require_network(segmenter_config, !segmenter.empty(), "segmenter");
  require_network(keypoints_config, is_file(keypoints), "keypoints");
}

DetectFramesOptions detect_options(const NetworkChoice& choice, int num_threads) {
  choice.validate();
  DetectFramesOptions out;
  out.networks = {choice.detector == kNoNetwork ? "" : choice.detector, choice.segmenter,
                  choice.detector_config, choice.segmenter_config};
  out.cache = choice.cache;
  out.num_threads = num_threads;
  return out;
}

FindKeypointsOptions keypoint_options(const NetworkChoice& choice, int num_threads) {
  choice.validate();
  FindKeypointsOptions out;
  out.num_threads = num_threads;
  if (choice.keypoints.empty()) return out;
  out.choice = choice.keypoints == kNoNetwork ? KeypointChoice::kNone : KeypointChoice::kAll;
  if (is_file(choice.keypoints)) out.network = choice.keypoints;
  out.config = choice.keypoints_config;
  return out;
}

std::vector<fs::path> files_of(const NetworkChoice& choice) {
  std::vector<fs::path> out;
  const auto add = [&](const std::string& network, const std::string& config) {
    out.emplace_back(network);
    out.push_back(side_file_of(network, config));
  };
  if (is_file(choice.detector)) add(choice.detector, choice.detector_config);
  if (choice.detector == kShippedNetwork && !choice.detector_config.empty()) {
    add(choice.detector, choice.detector_config);
  }
  if (!choice.segmenter.empty()) add(choice.segmenter, choice.segmenter_config);
  if (is_file(choice.keypoints)) add(choice.keypoints, choice.keypoints_config);
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

}  // namespace camber
