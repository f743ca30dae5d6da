#include "command.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <list>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "camber/core/interruption.h"
#include "standard_streams.h"

namespace camber::tools {

namespace {

std::list<Command>& commands() {
  static std::list<Command> all;
  return all;
}

template <typename T>
nlohmann::json to_json(const T& value) {
  return value;
}
nlohmann::json to_json(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}
nlohmann::json to_json(const std::optional<int>& value) {
  return value ? nlohmann::json(*value) : nlohmann::json();
}

}  // namespace

Command* parsed_command() {
  for (Command& command : commands()) {
    if (command.app->parsed()) return &command;
  }
  return nullptr;
}

Command* add_command(App& root, const std::string& name, const std::string& description,
                     const std::string& examples) {
  Command& command = commands().emplace_back();
  command.app = root.add_subcommand(name, description);
  command.app->footer("Examples:\n" + examples);
  command.seed =
      command.app->add_option("--seed", command.common.seed, "seed of all random numbers")
          ->check(whole_number())
          ->capture_default_str();
  command.app
      ->add_option("--threads", command.common.threads,
                   "threads to use; default: all, or OMP_NUM_THREADS")
      ->check(positive_number());
  command.app->add_flag("--quiet", command.common.quiet, "no progress and no warnings");
  command.app->add_option("--config", command.common.config,
                          "TOML file with options for what the line leaves open");
  command.app->add_flag("--print-config", command.common.print_config,
                        "print the options in force as such a file, and do nothing else");
  return &command;
}

void add_other_options(const Command& command, nlohmann::json* options) {
  static const std::set<std::string> others = {"seed",         "threads", "quiet", "config",
                                               "print-config", "json",    "out",   "overwrite"};
  for (const auto& [name, value] : command.app->values()) {
    if (others.count(name) > 0) continue;
    std::string key = name;
    std::replace(key.begin(), key.end(), '-', '_');
    if (options->contains(key)) continue;
    (*options)[key] = std::visit([](const auto& in_force) { return to_json(in_force); }, value);
  }
}

Progress make_progress(const CommonOptions& options) {
  const bool draw = !options.quiet && ::isatty(STDERR_FILENO) != 0;
  auto last = std::make_shared<std::string>();
  return [draw, last](const std::string& stage, double share) {
    throw_if_interrupted();
    if (!draw) return;
    constexpr int kWidth = 30;
    const int filled = static_cast<int>(kWidth * std::clamp(share, 0.0, 1.0));
    const std::string line =
        stage + " [" + std::string(filled, '#') + std::string(kWidth - filled, ' ') + "]";
    if (line == *last) return;
    *last = line;
    std::fprintf(stderr, "\r\033[K%s", line.c_str());
    if (share >= 1.0) std::fprintf(stderr, "\r\033[K");
    std::fflush(stderr);
  };
}

LogSink make_warning_sink(const CommonOptions& options) {
  if (options.quiet) return {};
  return [](const std::string& sentence) {
    std::fprintf(stderr, "camber: warning: %s\n", one_line(sentence).c_str());
  };
}

}  // namespace camber::tools
