#include "run_verb.h"

#include <glog/logging.h>

#include <cstdio>
#include <exception>
#include <new>
#include <stdexcept>

#include "../signals.h"
#include "../standard_streams.h"
#include "camber/core/errors.h"

namespace camber::tools {
namespace {

int report(const char* message, int exit_code) {
  // Whatever an interrupted computation ran into: it was interrupted.
  if (ends_interrupted()) {
    const InterruptedError interrupted;
    std::fprintf(stderr, "camber: %s\n", interrupted.what());
    return interrupted.exit_code();
  }
  if (std::ferror(stdout)) {  // the message of who printed names no file
    finish_standard_output(0);
    return 3;
  }
  std::fprintf(stderr, "camber: %s\n", message);
  return exit_code;
}

}  // namespace

int run_verb(int argc, char** argv,
             const std::vector<std::pair<std::string, void (*)(App&)>>& verbs) {
  watch_signals();
  // Ceres logs trial steps that fail; our statuses hold the outcome.
  FLAGS_minloglevel = google::GLOG_FATAL;

  App root("", "camber");
  root.require_subcommand();
  for (const auto& [name, register_in] : verbs) {
    if (name == argv[1]) register_in(root);
  }
  const int done = root.parse(argc, argv);
  if (done >= 0) return done;

  std::string command_line = "camber";
  for (int i = 1; i < argc; ++i) command_line += std::string(" ") + argv[i];
  try {
    Command* command = parsed_command();
    command->common.command_line = command_line;
    const int exit_code = command->run();
    ends_interrupted();  // done: a signal from now on changes nothing
    return exit_code;
  } catch (const Error& error) {
    return report(error.what(), error.exit_code());
  } catch (const std::bad_alloc&) {
    return report("out of memory", 3);
  } catch (const std::invalid_argument& error) {
    return report(error.what(), 2);
  } catch (const std::exception& error) {
    return report(error.what(), 3);
  }
}

}  // namespace camber::tools
