#pragma once

#include <csignal>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace camber::test {

/// What a program said and how it ended.
struct ProgramResult {
  int exit_code = -1;  ///< 128 + N for signal N
  std::string out;
  std::string error;
  double seconds_after_signal = 0.0;  ///< until it ended
  bool hung = false;                  ///< beyond a limit of Surroundings; it was killed
};

/// What a program is run in.
struct Surroundings {
  std::vector<std::string> variables;  ///< "NAME=VALUE", added to the environment
  std::string standard_output;         ///< a file in place of ProgramResult::out
  std::string shell;                   ///< run before it by sh: "ulimit -v 500000"
  std::filesystem::path folder;        ///< to run in; empty: the current one
  double signal_after_ms = 0.0;        ///< > 0: sends `signal` after that time
  int signal = SIGINT;
  int limit_cpu_s = 0;   ///< > 0: seconds of computing, all threads together
  double limit_s = 0.0;  ///< > 0: seconds until it has ended
};

ProgramResult run_camber_in(const Surroundings& surroundings,
                            const std::vector<std::string>& arguments);

/// Runs the camber program that was just built, with standard input empty.
/// @param interrupt_after_ms > 0: sends it `signal` after that time, SIGINT as Ctrl-C does.
ProgramResult run_camber(const std::vector<std::string>& arguments, int interrupt_after_ms = 0,
                         int signal = SIGINT);

/// Every file below a folder with its content, folders with "/"; to see what a run left behind.
std::map<std::string, std::string> snapshot(const std::filesystem::path& folder);

}  // namespace camber::test

/// The program failed with an exit code, said one sentence on stderr that starts with "camber: "
/// and contains `part`, and nothing on stdout.
#define EXPECT_ONE_SENTENCE(result, code, part)                               \
  do {                                                                        \
    const auto& camber_result = (result);                                     \
    EXPECT_EQ(camber_result.exit_code, (code)) << camber_result.error;        \
    EXPECT_EQ(camber_result.out, "");                                         \
    EXPECT_THAT(camber_result.error, ::testing::StartsWith("camber: "));      \
    EXPECT_THAT(camber_result.error, ::testing::HasSubstr(part));             \
    EXPECT_EQ(camber_result.error.find('\n') + 1, camber_result.error.size()) \
        << "more than one line: " << camber_result.error;                     \
  } while (false)
