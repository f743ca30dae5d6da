// Whether a run's scale is believed is decided in one file: pipeline/stages/judge.cpp.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

#include "package/source_tree.h"
#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::read_text;
using camber::test::SourceTree;
using testing::ElementsAre;
using testing::IsEmpty;

namespace {

constexpr const char* kPipeline = "lib/camber/pipeline";
constexpr const char* kJudge = "lib/camber/pipeline/stages/judge.cpp";
constexpr const char* kItsHeader = "lib/camber/pipeline/stages/judge.h";

/// "FILE: what is decided there" for each place outside the judge.
std::vector<std::string> decisions_outside_the_judge(const fs::path& root) {
  static const std::regex assigned("(scale_sigma|scale_status|scale_reason) *= *[^= ]");
  static const std::regex refused("NoAnswerError\\([^;]*\\bscale\\b");
  std::vector<std::string> out;
  for (const auto& entry : fs::recursive_directory_iterator(root / kPipeline)) {
    const std::string extension = entry.path().extension().string();
    const std::string file = entry.path().lexically_relative(root).generic_string();
    if (!entry.is_regular_file() || (extension != ".h" && extension != ".cpp") || file == kJudge ||
        file == kItsHeader) {
      continue;
    }
    const std::string text = read_text(entry.path());
    if (std::regex_search(text, refused)) out.push_back(file + ": no answer because of the scale");
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) {
      const std::string code = line.substr(0, line.find("//"));
      const bool declared = std::regex_search(code, std::regex("^ *(double|Status) "));
      if (std::regex_search(code, assigned) && !declared) {
        out.push_back(file + ": assigns the scale's sigma or status");
      }
    }
  }
  std::sort(out.begin(), out.end());
  return out;
}

TEST(OneJudge, DecidesAboutTheScale) {
  ASSERT_TRUE(fs::exists(camber::test::source_dir() / kJudge));
  EXPECT_THAT(decisions_outside_the_judge(camber::test::source_dir()), IsEmpty());
}

TEST(OneJudge, ADecisionElsewhereIsFound) {
  const SourceTree tree(
      {{kJudge, "run->scale_sigma = 0.1;\nthrow NoAnswerError(\"the scale is not known\");\n"},
       {"lib/camber/pipeline/a.cpp", "road.run.scale_status = judged.status;\n"},
       {"lib/camber/pipeline/stages/b.cpp",
        "throw NoAnswerError(fmt::format(\n    \"the scale is {}\", 1));\n"},
       {"lib/camber/pipeline/stages/c.cpp",
        "throw NoAnswerError(\"no road\");\nscale_of(x); // scale_sigma = 1\n"
        "if (scale_sigma == 0.0) catch (const NoAnswerError&) { scale; }\n"}});
  EXPECT_THAT(decisions_outside_the_judge(tree.root()),
              ElementsAre("lib/camber/pipeline/a.cpp: assigns the scale's sigma or status",
                          "lib/camber/pipeline/stages/b.cpp: no answer because of the scale"));
}

}  // namespace
