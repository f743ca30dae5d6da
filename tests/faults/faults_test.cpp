// Faults of the machine at each call of each command: a write, an fsync, a rename or an allocation
// that fails, a kill, a clock that jumps, a folder that is read-only, an input that shrinks. The
// old result or the new one stands whole under its name, and the next run leaves nothing else.
// With CAMBER_LONG_TESTS every call; else one kind of them and few, others for each command.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>
#include <sstream>

#include "../../tools/verbs.h"
#include "camber/core/random.h"
#include "faults/work_folder.h"
#include "scene/write_image.h"

namespace camber {
namespace {

using test::is_long_run;
using test::ProgramResult;
using test::same_but_timings;
using test::snapshot;
using test::Surroundings;
using test::VerbCase;
using test::WorkFolder;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;
using Files = std::map<std::string, std::string>;

constexpr int kAllocations = 200;  // values of n in a long run

Surroundings fault(const std::string& kind, int call) {
  Surroundings out;
  out.variables = {std::string("LD_PRELOAD=") + CAMBER_FAULT_SHIM,
                   "CAMBER_FAULT=" + kind + ":" + std::to_string(call),
                   "CAMBER_FAULT_FOLDER=" + WorkFolder::instance().path().string()};
  out.limit_s = 300.0;
  return out;
}

/// The words of a list in a help text: those that start a line after `title`, or "a,b" in braces.
std::vector<std::string> listed(const std::string& help, const std::string& title) {
  std::vector<std::string> out;
  std::istringstream lines(help.substr(std::min(help.size(), help.find(title))));
  std::string line;
  std::getline(lines, line);
  while (std::getline(lines, line) && line.rfind("  ", 0) == 0) {
    std::istringstream words(line);
    out.emplace_back();
    words >> out.back();
  }
  return out;
}

class Faults : public ::testing::Test {
 protected:
  static const WorkFolder& work() { return WorkFolder::instance(); }

  /// What a sound run of a command writes to out/, and how many calls of each kind it makes.
  struct Sound {
    Files files;
    std::map<std::string, int> calls;
  };

  /// A sound run, made once a process.
  static const Sound& sound_run(const VerbCase& verb) {
    static std::map<std::vector<std::string>, Sound> all;
    const auto [at, is_new] = all.try_emplace(verb.arguments);
    Sound& out = at->second;
    if (!is_new) return out;
    const fs::path file = work().path() / "counts";
    Surroundings counted = fault("none", 0);
    counted.variables.push_back("CAMBER_FAULT_COUNTS=" + file.string());
    work().clear_out();
    const ProgramResult result = work().run(verb.arguments, counted);
    EXPECT_EQ(result.exit_code, verb.exit_code) << verb.name() << ": " << result.error;
    std::ifstream in(file);
    for (std::string kind; in >> kind;) in >> out.calls[kind];
    EXPECT_EQ(out.calls.count("write"), 1u) << "the shim was not loaded";
    fs::remove(file);
    out.files = snapshot(work().out());
    return out;
  }

  /// Puts what a sound run writes into out/, and nothing else.
  static Files make_old_result(const VerbCase& verb) {
    const Files& files = sound_run(verb).files;
    work().clear_out();
    for (const auto& [name, bytes] : files) {  // a folder comes before what is in it
      if (bytes == "/") {
        fs::create_directory(work().out() / name);
      } else {
        test::write_bytes(work().out() / name, bytes);
      }
    }
    return files;
  }

  /// The kinds of faults to try that a sound run has calls of: all, or one that differs from
  /// command to command.
  static std::vector<std::string> kinds(const VerbCase& verb, std::vector<std::string> all) {
    const auto& counts = sound_run(verb).calls;
    all.erase(std::remove_if(all.begin(), all.end(),
                             [&](const std::string& kind) { return counts.at(kind) == 0; }),
              all.end());
    if (is_long_run() || all.empty()) return all;
    return {all[std::hash<std::string>()(verb.name()) % all.size()]};
  }

  /// Which of `count` calls to try: all, or `few` of them that differ from command to command.
  static std::vector<int> calls(const VerbCase& verb, const std::string& kind, int count, int few) {
    std::vector<int> out;
    const bool all = is_long_run();
    for (int call = 1; all && call <= count; ++call) out.push_back(call);
    if (all || count == 0) return out;
    const CounterRandom random(std::hash<std::string>()(verb.name() + kind));
    std::set<int> some;
    for (int i = 0; i < few; ++i) {
      some.insert(1 + static_cast<int>(random.below(i, static_cast<std::uint64_t>(count))));
    }
    return {some.begin(), some.end()};
  }

  /// Which allocations to fail, evenly spaced in the logarithm.
  static std::vector<int> allocations(const VerbCase& verb, int count) {
    const int values = is_long_run() ? kAllocations : verb.slow ? 1 : 2;
    const CounterRandom random(std::hash<std::string>()(verb.name()));
    std::set<int> out;
    for (int i = 0; i < values; ++i) {
      const double share = (i + (is_long_run() ? 1.0 : random.uniform(i))) / values;
      out.insert(static_cast<int>(std::lround(std::pow(count, share))));
    }
    return {out.begin(), out.end()};
  }

  static void expect_refusal(const ProgramResult& result, int code) {
    EXPECT_EQ(result.exit_code, code) << result.error;
    EXPECT_FALSE(result.hung);
    std::istringstream lines(result.error);
    int sentences = 0;
    const bool of_library = result.error.find("a library ended the program") != std::string::npos;
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind("camber: warning: ", 0) == 0) continue;
      if (of_library && line.rfind("camber: ", 0) != 0) continue;  // the library's own
      if (line.rfind("\x1B[0m", 0) == 0)
        continue;  // VTK's own, where it has no memory to be loaded
      EXPECT_THAT(line, ::testing::StartsWith("camber: "));
      ++sentences;
    }
    EXPECT_EQ(sentences, 1) << result.error;
    EXPECT_THAT(result.error, Not(HasSubstr(".camber."))) << "a temporary name";
  }
};

TEST_F(Faults, EveryVerbHasARow) {
  std::set<std::string> tested;
  for (const VerbCase& verb : work().cases()) {
    tested.insert(verb.arguments[0]);
    tested.insert(verb.name());
  }
  for (const tools::Verb& verb : tools::kVerbs) EXPECT_EQ(tested.count(verb.name), 1u) << verb.name;
  for (const std::string verb : {"import", "keypoints", "prior"}) {
    const auto kinds = listed(work().run({verb, "--help"}).out, "Subcommands:");
    EXPECT_GE(kinds.size(), 1u);
    for (const std::string& kind : kinds) {
#ifndef CAMBER_HAS_ROSBAG
      if (kind == "rosbag") continue;
#endif
      EXPECT_EQ(tested.count(verb + " " + kind), 1u) << verb << " " << kind;
    }
  }
  const std::string help = work().run({"export", "--help"}).out;
  const std::size_t at = help.find("--to TEXT:{");
  ASSERT_NE(at, std::string::npos);
  std::istringstream kinds(help.substr(at + 11, help.find('}', at) - at - 11));
  for (std::string kind; std::getline(kinds, kind, ',');) {
#ifndef CAMBER_HAS_GDAL
    if (kind == "geotiff") continue;
#endif
    EXPECT_EQ(tested.count("export " + kind), 1u) << kind;
  }
}

TEST_F(Faults, AFailingCallLeavesTheOldResultAndNothingElse) {
  std::map<std::string, int> runs;
  for (const VerbCase& verb : work().cases()) {
    if (verb.keeps_its_part) continue;
    make_old_result(verb);
    const auto& counts = sound_run(verb).calls;
    const auto old = snapshot(work().path());
    for (const std::string& kind : kinds(verb, {"write", "fsync", "rename"})) {
      for (const int call : calls(verb, kind, counts.at(kind), 1)) {
        SCOPED_TRACE(verb.name() + " " + kind + " " + std::to_string(call));
        const ProgramResult result = work().run(verb.arguments, fault(kind, call));
        ++runs[kind];
        if (kind == "rename" && result.exit_code == 0) {
          // An exchange that fails is made up for by a rename.
          EXPECT_TRUE(same_but_timings(snapshot(work().path()), old));
          make_old_result(verb);
          continue;
        }
        expect_refusal(result, 3);
        const auto after = snapshot(work().path());
        EXPECT_EQ(after.size(), old.size()) << "a file is lost, or more are there";
        EXPECT_TRUE(same_but_timings(after, old));
      }
    }
  }
  for (const auto& [kind, count] : runs) std::printf("%s: %d failing calls\n", kind.c_str(), count);
  EXPECT_EQ(runs.size(), 3u) << "a kind of which no command was tried";
}

Files without_pictures(Files files) {
  for (auto at = files.begin(); at != files.end();) {
    const std::string kind = fs::path(at->first).extension();
    at = kind == ".png" || kind == ".svg" ? files.erase(at) : std::next(at);
  }
  return files;
}

TEST_F(Faults, AFailingAllocationIsARefusalThatNamesMemory) {
  int refused = 0, recovered = 0, ended = 0;
  for (const VerbCase& verb : work().cases()) {
    if (verb.keeps_its_part) continue;
    if (verb.draws) continue;
    make_old_result(verb);
    const auto old = snapshot(work().path());
    for (const int call : allocations(verb, sound_run(verb).calls.at("alloc"))) {
      SCOPED_TRACE(verb.name() + " alloc " + std::to_string(call));
      const ProgramResult result = work().run(verb.arguments, fault("alloc", call));
      const auto after = snapshot(work().path());
      if (result.exit_code == 127) {
        ++ended;  // by the loader of shared objects
        EXPECT_EQ(result.error, "out of memory\n");
      } else if (verb.writes_pictures() && result.exit_code > 127) {
        ++ended;  // by VTK's text
      } else if (result.exit_code != 0) {
        ++refused;
        expect_refusal(result, 3);
        EXPECT_THAT(result.error, HasSubstr("memory"));
      } else {
        ++recovered;  // it did without
      }
      EXPECT_TRUE(verb.writes_pictures()
                      ? same_but_timings(without_pictures(after), without_pictures(old))
                      : same_but_timings(after, old));
    }
  }
  std::printf("alloc: %d refused, %d did without, %d ended by a library\n", refused, recovered,
              ended);
  EXPECT_LT(ended, 1 + refused / 100);
}

TEST_F(Faults, AKilledRunLeavesAWholeResultAndTheNextOneClearsUp) {
  int kills = 0;
  for (const VerbCase& verb : work().cases()) {
    if (verb.keeps_its_part) continue;
    const Files old = make_old_result(verb);
    const auto& counts = sound_run(verb).calls;
    for (const std::string& kind : kinds(verb, {"kill", "kill-write"})) {
      const int few = verb.slow ? 0 : 1;
      for (const int call : calls(verb, kind, counts.at(kind), few)) {
        const bool only = call % 2 == 0;  // of the two in a short run
        for (const bool exchange : {true, false}) {
          if (!is_long_run() && exchange != only) continue;
          SCOPED_TRACE(verb.name() + " " + kind + " " + std::to_string(call) +
                       (exchange ? "" : " without exchange"));
          Surroundings killed = fault(kind, call);
          if (!exchange) killed.variables.emplace_back("CAMBER_NO_EXCHANGE=1");
          const ProgramResult result = work().run(verb.arguments, killed);
          ++kills;
          if (!verb.writes_apart || result.exit_code != 3) {
            EXPECT_EQ(result.exit_code, 128 + SIGKILL) << result.error;
          }
          const Files left = snapshot(work().out());
          for (const auto& [name, content] : old) {
            // Under its name, or the one that the documentation gives.
            const std::string hidden = "." + name.substr(0, name.find('/')) + ".camber-old" +
                                       name.substr(std::min(name.size(), name.find('/')));
            const auto at = left.count(name) ? left.find(name) : left.find(hidden);
            ASSERT_TRUE(at != left.end()) << name;
            EXPECT_TRUE(same_but_timings({{name, at->second}}, {{name, content}})) << name;
          }
          EXPECT_EQ(work().run(verb.arguments).exit_code, verb.exit_code);
          EXPECT_TRUE(same_but_timings(snapshot(work().out()), old)) << "something is left";
        }
      }
    }
  }
  std::printf("%d kills\n", kills);
}

TEST_F(Faults, AClockThatJumpsChangesNothing) {
  for (const VerbCase& verb : work().cases()) {
    if (!is_long_run() && verb.slow) continue;
    const Files old = make_old_result(verb);
    const int count = sound_run(verb).calls.at("clock");
    for (const int call : {1, count / 2, count}) {
      if (!is_long_run() && call != count / 2) continue;
      SCOPED_TRACE(verb.name() + " clock " + std::to_string(call));
      const ProgramResult result = work().run(verb.arguments, fault("clock", call));
      EXPECT_EQ(result.exit_code, verb.exit_code) << result.error;
      EXPECT_TRUE(same_but_timings(snapshot(work().out()), old));
    }
  }
}

TEST_F(Faults, AReadOnlyFolderIsARefusal) {
  for (const VerbCase& verb : work().cases()) {
    if (!is_long_run() && verb.slow) continue;
    const Files made = make_old_result(verb);
    if (made.empty()) continue;         // it writes to stdout
    if (verb.keeps_its_part) continue;  // what is whole is not written again
    SCOPED_TRACE(verb.name());
    const auto old = snapshot(work().path());
    expect_refusal(work().run(verb.arguments, fault("read-only", 1)), 3);
    EXPECT_TRUE(snapshot(work().path()) == old);
  }
}

TEST_F(Faults, AnInputThatShrinksIsRefusedOrHadBeenRead) {
  std::map<int, int> codes;
  for (const VerbCase& verb : work().cases()) {
    if (verb.inputs.empty() || (!is_long_run() && verb.slow)) continue;
    const int count = sound_run(verb).calls.at("shrink");
    make_old_result(verb);
    auto old = snapshot(work().path());
    for (const int call : calls(verb, "shrink", count, 2)) {
      SCOPED_TRACE(verb.name() + " shrink " + std::to_string(call));
      const ProgramResult result = work().run(verb.arguments, fault("shrink", call));
      ++codes[result.exit_code];
      if (result.exit_code == 0) {
        EXPECT_EQ(result.error.find("camber: out of"), std::string::npos);
      } else {
        // Without a display `view` ends with 3, if it comes so far.
        const bool display = (verb.exit_code == 3 || verb.writes_apart) && result.exit_code == 3;
        expect_refusal(result, result.exit_code == 1 ? 1 : display ? 3 : 2);
      }
      auto after = snapshot(work().path());
      for (const auto& [name, content] : old) {
        if (name.rfind("out", 0) == 0) {
          EXPECT_TRUE(result.exit_code == 0 || after[name] == content) << name;
        } else if (after[name] != content) {
          test::write_bytes(work().path() / name, content);
        }
      }
      EXPECT_EQ(after.size(), old.size()) << "something is left";
      if (result.exit_code != 0) continue;
      make_old_result(verb);
      old = snapshot(work().path());
    }
  }
  for (const auto& [code, count] : codes) std::printf("shrink: %d ended with %d\n", count, code);
}

}  // namespace
}  // namespace camber
