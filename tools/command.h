#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <string>

#include "camber/core/progress.h"

namespace camber::tools {

/// What every command takes.
struct CommonOptions {
  std::uint64_t seed = 0;
  int threads = 0;  ///< <= 0: all, or OMP_NUM_THREADS
  bool quiet = false;
  std::string command_line;  ///< as typed, for run.json
};

/// One subcommand: its parser, and what to do once everything is parsed. `run` returns the exit
/// code and may throw camber::Error.
struct Command {
  CLI::App* app = nullptr;
  CommonOptions common;
  std::function<int()> run;
};

/// Adds a subcommand with the common options, a description and examples for its --help.
/// @param examples whole lines to paste, one each.
Command* add_command(CLI::App& root, const std::string& name, const std::string& description,
                     const std::string& examples);

/// Checks of an option's value: a finite number, one above 0, or one of at least 0.
CLI::Validator finite_number();
CLI::Validator positive_number();
CLI::Validator non_negative_number();

/// A progress bar on stderr if that is a terminal and --quiet is not given, else silent. Throws
/// InterruptedError once the user has pressed Ctrl-C.
Progress make_progress(const CommonOptions& options);

/// Prints "camber: warning: SENTENCE" to stderr unless --quiet.
LogSink make_warning_sink(const CommonOptions& options);

/// Throws InterruptedError once a signal to stop has arrived.
void check_interrupted();

/// From now on the first signal to stop (SIGINT, SIGTERM, SIGHUP) makes check_interrupted() throw,
/// so that nothing half-written stays; the second ends the program at once.
void watch_signals();

// One function a source file of this folder; each registers its subcommand.
void register_reconstruct(CLI::App& root);
void register_triangulate(CLI::App& root);
void register_import(CLI::App& root);
void register_info(CLI::App& root);
void register_convert(CLI::App& root);
void register_filter(CLI::App& root);
void register_render(CLI::App& root);
void register_prior(CLI::App& root);
void register_synth(CLI::App& root);
void register_vehicles(CLI::App& root);
void register_evaluate(CLI::App& root);
void register_plane(CLI::App& root);
void register_patches(CLI::App& root);
void register_profile(CLI::App& root);
void register_ground(CLI::App& root);
void register_compare(CLI::App& root);
void register_view(CLI::App& root);
void register_lift(CLI::App& root);

}  // namespace camber::tools
