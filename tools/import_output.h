#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/core/stopwatch.h"
#include "camber/scene/scene.h"
#include "command.h"

namespace camber::tools {

/// The folder that a manifest stands in.
std::filesystem::path folder_of(const std::filesystem::path& manifest);

/// What an import has to report beside what stands in the scene; a phrase each.
struct ImportNotes {
  std::vector<std::string> found, missing;
};

/// On stderr unless --quiet: the frames, what was found, what is missing and what that costs; with
/// --json the same as JSON on stdout.
void report_import(const Command& command, const Scene& scene,
                   const std::filesystem::path& manifest, const ImportNotes& notes,
                   nlohmann::json options, bool as_json, const Timings& timings);

// One function a source of one's own data (import_own.cpp); each registers its command.
void register_import_images(App& import);
void register_import_video(App& import);
void register_import_colmap(App& import);
void register_import_rosbag(App& import);

}  // namespace camber::tools
