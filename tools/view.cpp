// camber view: starts the interactive viewer that lies beside this program.

#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <memory>
#include <system_error>

#include "../viewers/view_arguments.h"
#include "camber/core/errors.h"
#include "command.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

int run(const CommonOptions& common, const ViewArguments& arguments) {
  std::error_code error;
  if (!fs::exists(arguments.input, error)) {
    throw InputError(arguments.input,
                     "no such file or folder, expected a result folder or a cloud");
  }
  const fs::path self = fs::read_symlink("/proc/self/exe", error);
  const fs::path viewer = self.parent_path() / "camber-view";
  if (error || ::access(viewer.c_str(), X_OK) != 0) {
    throw MachineError(
        "the interactive viewer camber-view is not beside this program: cmake --build --preset "
        "release builds it; camber render draws pictures without it");
  }
  std::vector<std::string> words = arguments.words();
  words.insert(words.begin(), viewer.string());
  words.insert(words.end(), {"--seed", std::to_string(common.seed)});
  if (common.quiet) words.emplace_back("--quiet");
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  ::execv(viewer.c_str(), argv.data());
  throw MachineError(viewer.string() + " cannot be started: " + std::strerror(errno));
}

}  // namespace

void register_view(App& root) {
  Command* command = add_command(
      root, "view",
      "Opens a result folder or a cloud in a window: turn it, switch its parts on and off, click "
      "for facts, step through the frames. The key h shows all keys. Without a display: camber "
      "render.",
      "  camber view out/steep_hill --scene samples/steep_hill\n"
      "  camber view out/steep_hill --scene samples/steep_hill --truth scene --color error\n"
      "  camber view scan.las --color intensity\n"
      "  camber view scan.las --picture window.png --json");
  auto arguments = std::make_shared<ViewArguments>();
  arguments->add_to(*command->app);
  command->run = [command, arguments] { return run(command->common, *arguments); };
}

}  // namespace camber::tools
