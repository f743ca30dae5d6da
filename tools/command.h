#pragma once

#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/core/progress.h"
#include "options.h"

namespace camber::tools {

/// What every command takes.
struct CommonOptions {
  std::uint64_t seed = 0;
  int threads = 0;  ///< <= 0: all, or OMP_NUM_THREADS
  bool quiet = false;
  std::string config;         ///< a file of options; App::parse reads it
  bool print_config = false;  ///< App::parse does
  std::string command_line;   ///< as typed, for run.json
};

/// One subcommand: its parser, and what to do once everything is parsed. `run` returns the exit
/// code and may throw camber::Error.
struct Command {
  App* app = nullptr;
  CommonOptions common;
  bool foreign_folders = false;  ///< that it reads: no scenes, results or COLMAP models
  std::function<int()> run;
  Option* seed = nullptr;  ///< --seed, whose default a command may have of its own
};

/// Adds a subcommand with the common options, a description and examples for its --help.
/// @param examples whole lines to paste, one each.
Command* add_command(App& root, const std::string& name, const std::string& description,
                     const std::string& examples);

/// The command that the line names, once it is parsed, or nullptr.
Command* parsed_command();

/// Adds the command's own options that `options` lacks, "max-tilt-deg" as "max_tilt_deg", with what
/// is in force; not what is written and where.
void add_other_options(const Command& command, nlohmann::json* options);

/// A progress bar on stderr if that is a terminal and --quiet is not given, else silent. Throws
/// InterruptedError once a signal to stop has arrived.
Progress make_progress(const CommonOptions& options);

/// Prints "camber: warning: SENTENCE" to stderr unless --quiet.
LogSink make_warning_sink(const CommonOptions& options);

// One function a source file of this folder; each registers its subcommand.
void register_reconstruct(App& root);
void register_drive(App& root);
void register_calibrate(App& root);
void register_triangulate(App& root);
void register_import(App& root);
void register_info(App& root);
void register_convert(App& root);
void register_filter(App& root);
void register_render(App& root);
void register_keypoints(App& root);
void register_prior(App& root);
void register_synth(App& root);
void register_vehicles(App& root);
void register_detect(App& root);
void register_evaluate(App& root);
void register_plane(App& root);
void register_patches(App& root);
void register_profile(App& root);
void register_ground(App& root);
void register_compare(App& root);
void register_view(App& root);
void register_lift(App& root);
void register_export(App& root);
void register_tiles(App& root);

}  // namespace camber::tools
