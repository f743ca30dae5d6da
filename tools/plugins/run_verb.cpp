#include "run_verb.h"

#include <glog/logging.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <stdexcept>

#include "camber/core/errors.h"

namespace camber::tools {
namespace {

int report(const char* message, int exit_code) {
  std::fprintf(stderr, "camber: %s\n", message);
  return exit_code;
}

}  // namespace

int run_verb(int argc, char** argv,
             const std::vector<std::pair<std::string, void (*)(App&)>>& verbs) {
  watch_signals();
  std::signal(SIGPIPE, SIG_IGN);
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
    return command->run();
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
