// The camber program: parses first, touching no file; then runs one command.

#include <glog/logging.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>

#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "command.h"

namespace camber::tools {
Command* parsed_command();
}  // namespace camber::tools

namespace {

int report(const char* message, int exit_code) {
  std::fprintf(stderr, "camber: %s\n", message);
  return exit_code;
}

}  // namespace

int main(int argc, char** argv) {
  using namespace camber::tools;
  watch_signals();
  std::signal(SIGPIPE, SIG_IGN);
  // Ceres tells of trial steps that lead nowhere; what it makes of them is in our statuses.
  FLAGS_minloglevel = google::GLOG_FATAL;

  App root("Camber: metric road surfaces and vehicles from one moving camera", "camber");
  root.set_version(std::string("camber ") + camber::kVersion);
  root.require_subcommand();
  register_reconstruct(root);
  register_triangulate(root);
  register_import(root);
  register_info(root);
  register_convert(root);
  register_filter(root);
  register_render(root);
  register_view(root);
  register_prior(root);
  register_synth(root);
  register_vehicles(root);
  register_evaluate(root);
  register_lift(root);
  register_plane(root);
  register_patches(root);
  register_profile(root);
  register_ground(root);
  register_compare(root);

  std::string command_line = "camber";
  for (int i = 1; i < argc; ++i) command_line += std::string(" ") + argv[i];
  const int done = root.parse(argc, argv);
  if (done >= 0) return done;
  try {
    Command* command = parsed_command();
    command->common.command_line = command_line;
    return command->run();
  } catch (const camber::Error& error) {
    return report(error.what(), error.exit_code());
  } catch (const std::bad_alloc&) {
    return report("out of memory", 3);
  } catch (const std::invalid_argument& error) {
    return report(error.what(), 2);
  } catch (const std::exception& error) {
    return report(error.what(), 3);
  }
}
