#include "command.h"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <charconv>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <list>
#include <memory>

#include "camber/core/errors.h"

namespace camber::tools {

namespace {

std::atomic<bool> g_interrupted{false};

std::list<Command>& commands() {
  static std::list<Command> all;
  return all;
}

extern "C" void on_signal(int signal) {
  if (!g_interrupted.exchange(true)) return;
  std::signal(signal, SIG_DFL);
  std::raise(signal);
}

CLI::Validator number_check(bool (*holds)(double), const char* expected, const char* name) {
  return {[holds, expected](std::string& text) {
            double value = 0.0;
            const bool good =
                CLI::detail::lexical_cast(text, value) && std::isfinite(value) && holds(value);
            return good ? std::string() : "found '" + text + "', expected " + expected;
          },
          name};
}

/// Digits alone: the parser takes -1 for 2^64 - 1.
std::string check_seed(std::string& text) {
  std::uint64_t value = 0;
  const char* end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && at == end
             ? ""
             : "found '" + text + "', expected a whole number from 0 to 18446744073709551615";
}

}  // namespace

CLI::Validator finite_number() {
  return number_check([](double) { return true; }, "a number", "");
}
CLI::Validator positive_number() {
  return number_check([](double value) { return value > 0.0; }, "a number above 0", "POSITIVE");
}
CLI::Validator non_negative_number() {
  return number_check([](double value) { return value >= 0.0; }, "a number of at least 0",
                      "NONNEGATIVE");
}

void watch_signals() {
  std::signal(SIGINT, on_signal);
  for (const int signal : {SIGTERM, SIGHUP}) {
    // nohup has them ignored, and so they stay.
    if (std::signal(signal, on_signal) == SIG_IGN) std::signal(signal, SIG_IGN);
  }
}

/// The command that was parsed, or nullptr.
Command* parsed_command() {
  for (Command& command : commands()) {
    if (command.app->parsed()) return &command;
  }
  return nullptr;
}

Command* add_command(CLI::App& root, const std::string& name, const std::string& description,
                     const std::string& examples) {
  Command& command = commands().emplace_back();
  command.app = root.add_subcommand(name, description);
  command.app->footer("Examples:\n" + examples);
  command.app->add_option("--seed", command.common.seed, "seed of all random numbers")
      ->check(CLI::Validator(check_seed, ""))
      ->capture_default_str();
  command.app
      ->add_option("--threads", command.common.threads,
                   "threads to use; default: all, or OMP_NUM_THREADS")
      ->check(positive_number());
  command.app->add_flag("--quiet", command.common.quiet, "no progress and no warnings");
  return &command;
}

Progress make_progress(const CommonOptions& options) {
  const bool draw = !options.quiet && ::isatty(STDERR_FILENO) != 0;
  auto last = std::make_shared<std::string>();
  return [draw, last](const std::string& stage, double share) {
    check_interrupted();
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
    std::fprintf(stderr, "camber: warning: %s\n", sentence.c_str());
  };
}

void check_interrupted() {
  if (g_interrupted) throw InterruptedError();
}

}  // namespace camber::tools
