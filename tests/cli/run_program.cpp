#include "cli/run_program.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <stdexcept>
#include <thread>

#include "scene/write_image.h"
#include "support/test_data.h"

extern char** environ;

namespace camber::test {
namespace {

void limit_computing(pid_t child, int seconds) {
  const rlimit limit = {static_cast<rlim_t>(seconds), static_cast<rlim_t>(seconds + 1)};
  ::prlimit(child, RLIMIT_CPU, &limit, nullptr);
}

/// Waits for the end of a process. @param limit_s > 0: after that time it is killed.
/// @return its status as of waitpid(); `hung`: whether it was killed.
int wait_for(pid_t child, double limit_s, bool* hung) {
  const auto start = std::chrono::steady_clock::now();
  int status = 0;
  for (;;) {
    const pid_t ended = ::waitpid(child, &status, limit_s > 0.0 && !*hung ? WNOHANG : 0);
    if (ended == child) return status;
    if (ended != 0) throw std::runtime_error("waitpid failed");
    const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
    if (elapsed.count() > limit_s) {
      *hung = true;
      ::kill(child, SIGKILL);
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

}  // namespace

ProgramResult run_camber(const std::vector<std::string>& arguments, int interrupt_after_ms,
                         int signal) {
  Surroundings surroundings;
  surroundings.signal_after_ms = interrupt_after_ms;
  surroundings.signal = signal;
  return run_camber_in(surroundings, arguments);
}

ProgramResult run_camber_in(const Surroundings& surroundings,
                            const std::vector<std::string>& arguments) {
  const TemporaryFolder folder;
  const std::string out = folder.path() / "out", error = folder.path() / "error";
  std::vector<std::string> words;
  if (!surroundings.shell.empty()) {
    words = {"/bin/sh", "-c", surroundings.shell + "; exec \"$0\" \"$@\""};
  }
  words.push_back(CAMBER_PROGRAM);
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  std::vector<std::string> variables = surroundings.variables;
  std::vector<char*> environment;
  for (std::string& variable : variables) environment.push_back(variable.data());
  for (char** variable = environ; *variable; ++variable) environment.push_back(*variable);
  environment.push_back(nullptr);

  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  const int mode = O_WRONLY | O_CREAT | O_TRUNC;
  const std::string& standard_output =
      surroundings.standard_output.empty() ? out : surroundings.standard_output;
  posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, standard_output.c_str(), mode, 0600);
  posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, error.c_str(), mode, 0600);
  if (!surroundings.folder.empty()) {
    posix_spawn_file_actions_addchdir_np(&actions, surroundings.folder.c_str());
  }
  pid_t child = 0;
  const int failed =
      ::posix_spawn(&child, argv[0], &actions, nullptr, argv.data(), environment.data());
  posix_spawn_file_actions_destroy(&actions);
  if (failed != 0) throw std::runtime_error("cannot start " + words[0]);
  if (surroundings.limit_cpu_s > 0) limit_computing(child, surroundings.limit_cpu_s);
  if (surroundings.signal_after_ms > 0) {
    std::this_thread::sleep_for(
        std::chrono::duration<double, std::milli>(surroundings.signal_after_ms));
    ::kill(child, surroundings.signal);
  }
  const auto start = std::chrono::steady_clock::now();
  ProgramResult result;
  const int status = wait_for(child, surroundings.limit_s, &result.hung);
  const std::chrono::duration<double> elapsed = std::chrono::steady_clock::now() - start;
  result.seconds_after_signal = elapsed.count();
  result.hung = result.hung || (WIFSIGNALED(status) && WTERMSIG(status) == SIGXCPU);
  result.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  result.out = read_bytes(out);
  result.error = read_bytes(error);
  return result;
}

std::map<std::string, std::string> snapshot(const std::filesystem::path& folder) {
  std::map<std::string, std::string> out;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string name = entry.path().lexically_relative(folder).string();
    out[name] = entry.is_directory() ? "/" : read_bytes(entry.path());
  }
  return out;
}

}  // namespace camber::test
