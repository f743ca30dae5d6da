// Random bad inputs and command lines over all commands: no crash, no hang, the right code, one
// sentence. Input number N is the same everywhere: CAMBER_BAD_INPUT=N runs that one alone, prints
// it and leaves its folder, CAMBER_BAD_INPUTS=FROM:TO those from FROM to before TO. With
// CAMBER_LONG_TESTS 10,000 of them; a run that was cut off goes on.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "faults/bad_inputs.h"
#include "faults/work_folder.h"
#include "scene/write_image.h"

namespace camber {
namespace {

using test::Draws;
using test::ProgramResult;
using test::snapshot;
using test::VerbCase;
using test::WorkFolder;
namespace fs = std::filesystem;

constexpr std::uint64_t kSeed = 22;
constexpr int kLong = 10000, kShort = 200;  // of the short run those of quick commands
constexpr int kSecondsOfComputing = 10;
constexpr double kLongestSeconds = 100.0;  // other programs may have the processor

/// What is run, and what was changed.
struct BadInput {
  VerbCase verb;
  std::vector<std::string> arguments;
  std::vector<std::string> description;
};

class BadInputs : public ::testing::Test {
 protected:
  static const WorkFolder& work() { return WorkFolder::instance(); }

  /// The options of a command, by its --help.
  const std::vector<std::string>& options(const VerbCase& verb) {
    auto [at, is_new] = options_.try_emplace(verb.name());
    if (!is_new) return at->second;
    std::vector<std::string> help = {verb.arguments[0], "--help"};
    if (help[0] == "import" || help[0] == "keypoints" || help[0] == "prior" || help[0] == "tiles") {
      help.insert(help.begin() + 1, verb.arguments[1]);
    }
    std::istringstream lines(work().run(help).out);
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind("  --", 0) != 0) continue;
      at->second.push_back(line.substr(2, line.find_first_of(" ,", 2) - 2));
    }
    EXPECT_GE(at->second.size(), 5u) << verb.name();
    return at->second;
  }

  /// The files that a command reads, relative to the folder.
  static std::vector<std::string> files(const VerbCase& verb) {
    std::vector<std::string> out;
    for (const std::string& input : verb.inputs) {
      if (!fs::is_directory(work().path() / input)) {
        out.push_back(input);
        continue;
      }
      for (const auto& entry : fs::recursive_directory_iterator(work().path() / input)) {
        if (entry.is_regular_file()) {
          out.push_back(entry.path().lexically_relative(work().path()).string());
        }
      }
    }
    std::sort(out.begin(), out.end());
    return out;
  }

  static const VerbCase& verb_of(int number) {
    return Draws(kSeed, static_cast<std::uint64_t>(number)).one_of(work().cases());
  }

  /// Draws an input and changes the files that it damages; `saved` takes what they held.
  BadInput make(int number, std::map<std::string, std::string>* saved) {
    Draws draws(kSeed, static_cast<std::uint64_t>(number));
    BadInput out;
    out.verb = draws.one_of(work().cases());
    out.arguments = out.verb.arguments;
    const std::vector<std::string> names = files(out.verb);
    const bool on_line = names.empty() || draws.chance(0.4);
    if (on_line) out.arguments = mistyped(out.arguments, options(out.verb), draws);
    for (std::size_t i = 0; !on_line && i < 1 + draws.below(2); ++i) {
      const std::string& name = draws.one_of(names);
      const std::string old = test::read_bytes(work().path() / name);
      saved->emplace(name, old);
      const std::string& other = draws.one_of(names);
      const bool swapped = draws.chance(0.05);
      test::write_bytes(work().path() / name,
                        swapped ? test::read_bytes(work().path() / other) : damaged(old, draws));
      out.description.push_back(name + (swapped ? " is " + other : " damaged"));
    }
    return out;
  }

  void expect_one_sentence(const std::string& error) {
    std::istringstream lines(error);
    int sentences = 0;
    for (std::string line; std::getline(lines, line);) {
      if (line.rfind("camber: warning: ", 0) == 0) continue;
      EXPECT_TRUE(line.rfind("camber: ", 0) == 0) << line;
      EXPECT_GT(line.size(), 10u);
      ++sentences;
    }
    EXPECT_EQ(sentences, 1) << error.substr(0, 2000);
  }

  /// Runs one input. @return its exit code.
  int run(int number) {
    std::map<std::string, std::string> saved;
    const BadInput bad = make(number, &saved);
    std::string line = "camber";
    for (const std::string& word : bad.arguments) line += " '" + word.substr(0, 100) + "'";
    for (const std::string& what : bad.description) line += "; " + what;
    SCOPED_TRACE("CAMBER_BAD_INPUT=" + std::to_string(number) + ": " + line);
    if (number_ >= 0) {
      fs::copy(work().path(), "bad_input_" + std::to_string(number),
               fs::copy_options::recursive | fs::copy_options::overwrite_existing);
    }
    test::Surroundings surroundings;
    surroundings.limit_cpu_s = kSecondsOfComputing;
    surroundings.limit_s = kLongestSeconds;
    const ProgramResult result = work().run(bad.arguments, surroundings);
    if (number_ >= 0) {
      std::printf("%s\nexit code %d: %s\n", line.c_str(), result.exit_code, result.error.c_str());
    }
    EXPECT_FALSE(result.hung);
    EXPECT_GE(result.exit_code, 0);
    EXPECT_LE(result.exit_code, 3) << result.error;
    if (result.exit_code != 0) expect_one_sentence(result.error);
    // The machine refuses to write or has no display; a bad input is not the machine's matter.
    if (result.exit_code == 3 && bad.verb.exit_code != 3) {
      EXPECT_THAT(result.error,
                  ::testing::AnyOf(::testing::HasSubstr("cannot be written"),
                                   ::testing::HasSubstr("cannot be created"),
                                   ::testing::HasSubstr("folder"),
                                   ::testing::HasSubstr("a file of that name is there")));
    }
    clear_up(saved, result.exit_code != 0);
    return result.exit_code;
  }

  /// Restores the folder; nothing half-written may be there.
  void clear_up(const std::map<std::string, std::string>& saved, bool failed) {
    for (const auto& [name, bytes] : saved) test::write_bytes(work().path() / name, bytes);
    const auto now = snapshot(work().path());
    for (const auto& [name, bytes] : now) {
      EXPECT_EQ(name.find(".camber."), std::string::npos) << name << " is left";
      if (original_.count(name)) continue;
      EXPECT_TRUE(!failed || bytes == "/") << name << " was written by a run that failed";
    }
    for (const auto& [name, bytes] : original_) {
      const auto at = now.find(name);
      if (at != now.end() && at->second == bytes) continue;
      EXPECT_FALSE(failed) << name << " was changed by a run that failed";
      if (bytes != "/") test::write_bytes(work().path() / name, bytes);
    }
    for (const auto& [name, bytes] : now) {
      if (!original_.count(name)) fs::remove_all(work().path() / name);
    }
  }

  std::map<std::string, std::vector<std::string>> options_;
  std::map<std::string, std::string> original_ = snapshot(WorkFolder::instance().path());
  int number_ = -1;  ///< that alone is run
};

/// Where a long run stands, in the folder that it is started in.
class Progress {
 public:
  explicit Progress(bool is_kept) : is_kept_(is_kept) {
    std::ifstream in(kFile);
    if (!is_kept_ || !(in >> next)) return;
    for (int code = 0, count = 0; in >> code >> count;) codes[code] = count;
  }
  void save() const {
    if (!is_kept_) return;
    std::ofstream out(kFile);
    out << next << "\n";
    for (const auto& [code, count] : codes) out << code << " " << count << "\n";
  }
  void end() const {
    if (is_kept_) fs::remove(kFile);
  }
  int next = 0;
  std::map<int, int> codes;

 private:
  static constexpr const char* kFile = "bad_inputs.progress";
  bool is_kept_;
};

TEST_F(BadInputs, EndWithTheRightCodeAndOneSentence) {
  if (const char* number = std::getenv("CAMBER_BAD_INPUT")) {
    number_ = std::atoi(number);
    run(number_);
    return;
  }
  int first = 0, end = test::is_long_run() ? kLong : kShort;
  const char* const range = std::getenv("CAMBER_BAD_INPUTS");
  if (range) {
    ASSERT_EQ(std::sscanf(range, "%d:%d", &first, &end), 2) << "found " << range;
  }
  const bool is_long = range || test::is_long_run();
  Progress progress(is_long);
  for (progress.next = std::max(progress.next, first); progress.next < end; ++progress.next) {
    if (progress.next % 50 == 0) progress.save();
    if (!is_long && verb_of(progress.next).slow) continue;
    ++progress.codes[run(progress.next)];
  }
  for (const auto& [code, count] : progress.codes) {
    std::printf("%d inputs ended with %d\n", count, code);
  }
  if (!HasFailure()) progress.end();
  EXPECT_GT(progress.codes[2], (is_long ? 0.3 * (end - first) : 0.0)) << "the inputs are not bad";
}

}  // namespace
}  // namespace camber
