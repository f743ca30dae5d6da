#include "run_verb.h"

#include <glog/logging.h>

#include <cstdio>
#include <exception>

#include "../own_inputs.h"
#include "../signals.h"
#include "../standard_streams.h"
#include "camber/core/default_threads.h"
#include "camber/core/errors.h"

namespace camber::tools {
namespace {

int report(const std::exception& error) {
  // Whatever an interrupted computation ran into: it was interrupted.
  if (ends_interrupted()) return report_failure(InterruptedError());
  // The message of who printed names no file.
  return std::ferror(stdout) ? finish_standard_output(0) : report_failure(error);
}

}  // namespace

int run_verb(int argc, char** argv,
             const std::vector<std::pair<std::string, void (*)(App&)>>& verbs) {
  watch_signals();
  watch_failures();
  // Ceres logs trial steps that fail; our statuses hold the outcome.
  FLAGS_minloglevel = google::GLOG_FATAL;

  try {
    App root("", "camber");
    root.require_subcommand();
    for (const auto& [name, register_in] : verbs) {
      if (name == argv[1]) register_in(root);
    }
    const int done = root.parse(argc, argv);
    if (done >= 0) return done;

    std::string command_line = "camber";
    for (int i = 1; i < argc; ++i) command_line += std::string(" ") + argv[i];
    Command* command = parsed_command();
    command->common.command_line = command_line;
    refuse_own_inputs(*command);
    set_default_num_threads(command->common.threads);
    const int exit_code = command->run();
    ends_interrupted();  // done: a signal from now on changes nothing
    return exit_code;
  } catch (const std::exception& error) {
    return report(error);
  }
}

}  // namespace camber::tools
