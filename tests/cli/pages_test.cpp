// docs/dashcam.md, docs/survey.md and docs/paper.md: every command on them runs.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <regex>
#include <sstream>

#include "camber/cloud/cloud_io.h"
#include "cli/run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;

/// The commands of a page, as their words without "camber".
std::vector<std::vector<std::string>> commands_of(const std::string& page) {
  const std::string text = test::read_text(test::source_dir() / "docs" / page);
  std::vector<std::vector<std::string>> out;
  for (std::size_t at = 0; (at = text.find("```sh\n", at)) != std::string::npos;) {
    const std::size_t begin = at + 6, end = text.find("```\n", begin);
    std::istringstream lines(
        std::regex_replace(text.substr(begin, end - begin), std::regex("\\\\\n"), " "));
    for (std::string line; std::getline(lines, line);) {
      std::istringstream words(line);
      std::vector<std::string> command;
      for (std::string word; words >> word;) command.push_back(word);
      if (command.empty()) continue;
      EXPECT_EQ(command[0], "camber") << line;
      command.erase(command.begin());
      out.push_back(command);
    }
    at = end;
  }
  return out;
}

/// Runs a page's commands in a folder, where the names that they read stand.
void run_page(const std::string& page, const fs::path& folder, std::size_t fewest) {
  const auto commands = commands_of(page);
  ASSERT_GE(commands.size(), fewest);
  test::Surroundings here;
  here.folder = folder;
  for (std::vector<std::string> words : commands) {
    std::string line;
    for (std::string& word : words) {
      if (word.rfind("samples/", 0) == 0) word = (test::source_dir() / word).string();
      line += " " + word;
    }
    if (words[0] == "reconstruct")
      words.emplace_back("--no-pictures");  // the pages say no more of them
    const auto result = test::run_camber_in(here, words);
    ASSERT_EQ(result.exit_code, 0) << page << ":" << line << "\n" << result.error;
  }
}

TEST(Pages, Dashcam) {
  const test::TemporaryFolder folder;
  for (const char* file : {"drive.mp4", "camera.yaml", "boxes.json"}) {
    fs::copy(test::source_dir() / "samples/own_drive" / file, folder.path() / file);
  }
  run_page("dashcam.md", folder.path(), 8);
}

TEST(Pages, Survey) {
  const test::TemporaryFolder folder;
  // A road on a grade, with a ditch beside it.
  RoadCloud scan;
  std::ofstream line(folder.path() / "line.csv");
  line << "x,y,z\n";
  for (int i = 0; i <= 300; ++i) {
    const double x = 0.2 * i;
    if (i % 25 == 0) line << x << ",0," << 0.05 * x << "\n";
    for (int j = -30; j <= 30; ++j) {
      const double y = 0.2 * j, rough = 0.004 * std::sin(37.0 * i + 11.0 * j * j);
      const double down = std::max(0.0, std::abs(y) - 4.0);
      scan.points.emplace_back(
          static_cast<float>(x), static_cast<float>(y),
          static_cast<float>(0.05 * x - 0.02 * std::abs(y) - 0.4 * down + rough));
    }
  }
  line.close();
  scan.frame = CloudFrame::kUnknown;
  write_cloud(scan, folder.path() / "scan.ply");
  write_cloud(scan, folder.path() / "truth.ply");
  run_page("survey.md", folder.path(), 12);
}

TEST(Pages, Paper) {
  const test::TemporaryFolder folder;
  run_page("paper.md", folder.path(), 4);
}

}  // namespace
}  // namespace camber
