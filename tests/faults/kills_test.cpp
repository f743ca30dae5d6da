// SIGKILL at random moments of a command that replaces a result: the old one or the new one, whole,
// stands under its name, and the next run leaves nothing else.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>

#include "camber/core/random.h"
#include "faults/work_folder.h"

namespace camber {
namespace {

using test::ProgramResult;
using test::snapshot;
using test::Surroundings;
using test::without_timings;
using test::WorkFolder;
using Files = std::map<std::string, std::string>;

constexpr int kLong = 40, kShort = 2;  // moments of each command

struct Replacing {
  std::vector<std::string> old, next;  // commands that write the same
};

const Replacing kCommands[] = {
    {{"reconstruct", "scene", "--frames", "0,1", "--no-pictures", "--method", "flat", "--out",
      "out/result"},
     {"reconstruct", "scene", "--frames", "0,1", "--no-pictures", "--out", "out/result"}},
    {{"vehicles", "scene", "--method", "flat", "--out", "out/v.json"},
     {"vehicles", "scene", "--out", "out/v.json"}},
    {{"patches", "other.ply", "--out", "out/surface"},
     {"patches", "cloud.ply", "--out", "out/surface"}},
    {{"compare", "other.ply", "cloud.ply", "--out", "out/compared"},
     {"compare", "cloud.ply", "other.ply", "--out", "out/compared"}},
    {{"convert", "other.ply", "--out", "out/cloud.csv"},
     {"convert", "cloud.ply", "--out", "out/cloud.csv"}},
};

class Kills : public ::testing::Test {
 protected:
  static const WorkFolder& work() { return WorkFolder::instance(); }
  static Files result() { return without_timings(snapshot(work().out())); }
  static Files made_by(const std::vector<std::string>& command) {
    const ProgramResult run = work().run(command);
    EXPECT_EQ(run.exit_code, 0) << run.error;
    return result();
  }
};

/// Without what a killed run leaves until the next one.
Files without_temporaries(Files files) {
  for (auto at = files.begin(); at != files.end();) {
    at = at->first.find(".camber.") == std::string::npos ? std::next(at) : files.erase(at);
  }
  return files;
}

TEST_F(Kills, TheOldOrTheNewResultIsWholeUnderItsName) {
  std::map<std::string, int> seen;
  for (const Replacing& command : kCommands) {
    work().clear_out();
    const Files old = made_by(command.old);
    const auto start = std::chrono::steady_clock::now();
    const Files next = made_by(command.next);
    const std::chrono::duration<double, std::milli> time = std::chrono::steady_clock::now() - start;
    ASSERT_FALSE(old == next);
    const CounterRandom random(9);
    Files before = next;
    for (int i = 0; i < (test::is_long_run() ? kLong : kShort); ++i) {
      if (!(before == old)) before = made_by(command.old);
      ASSERT_TRUE(before == old);
      Surroundings killed;
      killed.signal = SIGKILL;
      // Half of them at the end, where files take their names.
      killed.signal_after_ms =
          std::max(0.1, random.uniform(i, i % 2 ? 0.7 : 0.0, 1.05)) * time.count();
      SCOPED_TRACE(command.next[0] + " killed after " + std::to_string(killed.signal_after_ms));
      const ProgramResult run = work().run(command.next, killed);
      const Files left = without_temporaries(result());
      EXPECT_TRUE(left == old || left == next);
      ++seen[run.exit_code == 0 ? "ended before" : left == old ? "old result" : "new result"];
      before = made_by(command.next);
      EXPECT_TRUE(before == next) << "something is left";
    }
  }
  for (const auto& [what, count] : seen) std::printf("%s: %d\n", what.c_str(), count);
}

}  // namespace
}  // namespace camber
