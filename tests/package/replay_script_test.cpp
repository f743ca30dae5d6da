// tests/benchmarks/replay_scale.py over runs that are known and a stand-in for its program.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::read_text;
using nlohmann::json;
using testing::HasSubstr;

namespace {

/// The belief is normal about no change with a sigma of camera_height.spread hundredths.
const char* const kStandIn = R"py(#!/usr/bin/env -S python3 -S
import json, math, sys
cases = json.load(open(sys.argv[1]))
for line in sys.stdin:
    sigma = 0.01 * json.loads(line)["sources"]["camera_height"]["spread"]
    rows = [[-0.5 * (c["truth"] / sigma) ** 2 - math.log(sigma * math.sqrt(2 * math.pi)), 0.0, sigma,
             0.0] for c in cases]
    print(json.dumps(rows), flush=True)
)py";

class ReplayScript : public testing::Test {
 protected:
  void SetUp() override {
    if (std::system("python3 -c '' >/dev/null 2>&1") != 0) GTEST_SKIP() << "no python3";
    const fs::path program = folder_.path() / "program";
    std::ofstream(program) << kStandIn;
    fs::permissions(program, fs::perms::owner_all);
    fs::create_directory(folder_.path() / "runs");
  }

  /// A run of scene n, off by `error`; without evidence where that is NaN.
  void add(int n, double error, const std::string& fault = "none", bool with_evidence = true) {
    const std::string scene = "s" + std::to_string(n);
    json result = {{"exit_code", 1}, {"reason", "no road"}};
    if (!std::isnan(error)) {
      result = {{"exit_code", 0},
                {"error", error},
                {"sigma", 0.04},
                {"status", "ok"},
                {"warnings", json::array()},
                {"vehicles", json::array()}};
      if (with_evidence) {
        result["evidence"] = {{{"name", "camera_height"},
                               {"cause", "height"},
                               {"log_scale", 0.0},
                               {"sigma", 0.01},
                               {"shares", json::array()}}};
      }
    }
    const json definition = {
        {"scene", scene}, {"fault", fault}, {"frames", "1:3"}, {"maker", "synth"}};
    append("runs.jsonl",
           {{"number", n}, {"key", scene + fault}, {"definition", definition}, {"result", result}});
    append("scenes.jsonl",
           {{"scene", scene}, {"motion", 0.5}, {"near_road", nullptr}, {"cars", 3}});
  }

  int replay(const std::string& arguments = "") {
    fs::remove(folder_.path() / "report.json");
    const fs::path script = camber::test::source_dir() / "tests/benchmarks/replay_scale.py";
    const std::string line = "cd '" + folder_.path().string() +
                             "' && PYTHONDONTWRITEBYTECODE=1 python3 '" + script.string() +
                             "' --runs runs --program ./program --json report.json " + arguments +
                             " >out 2>err";
    const int status = std::system(line.c_str());
    err_ = read_text(folder_.path() / "err");
    const std::string text = read_text(folder_.path() / "report.json");
    report_ = text.empty() ? json() : json::parse(text);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  json row(const std::string& name) {
    for (const json& row : report_["rows"]) {
      if (row["name"] == name) return row;
    }
    return {};
  }

  camber::test::TemporaryFolder folder_;
  std::string err_;
  json report_;

 private:
  void append(const std::string& name, const json& line) {
    std::ofstream(folder_.path() / "runs" / name, std::ios::app) << line.dump() << '\n';
  }
};

TEST_F(ReplayScript, ScoresARunWithoutAnAnswerAsUniform) {
  add(1, std::nan(""));
  add(2, 0.01);
  add(3, 0.02);
  ASSERT_EQ(replay(), 0) << err_;
  const double uniform = -std::log(2.0 * std::log(10.0)), at = std::log(1.0 / 0.01 / 2.5066282746);
  EXPECT_NEAR(row("odd, none")["belief"]["score"].get<double>(), 0.5 * (uniform + at - 2.0), 1e-6);
  EXPECT_NEAR(row("even, none")["belief"]["score"].get<double>(), at - 0.5, 1e-6);
  EXPECT_EQ(row("odd, none")["cases"], 2);
  EXPECT_EQ(row("odd, none")["answered"], 1);
  EXPECT_EQ(row("odd, none")["belief"]["weak_or_refused"], 1);
  EXPECT_EQ(row("odd, none")["belief"]["inside_2_sigma"], 1.0);
}

TEST_F(ReplayScript, FitsOnEvenNumbersAlone) {
  for (int n = 0; n < 40; ++n) add(n, n % 2 == 0 ? (n % 4 == 0 ? 0.02 : -0.02) : 0.3);
  ASSERT_EQ(replay("--fit --rounds 6 --parameters fitted.json"), 0) << err_;
  const double spread = report_["parameters"]["camera_height.spread"];
  EXPECT_NEAR(spread, 2.0, 0.25);  // hundredths, what the even numbers are off
  const json kept = json::parse(read_text(folder_.path() / "fitted.json"));
  EXPECT_EQ(kept["camera_height.spread"], report_["parameters"]["camera_height.spread"]);
  EXPECT_EQ(row("odd, none")["belief"]["inside_2_sigma"], 0.0);
}

TEST_F(ReplayScript, OfFaultsThoseCountThatSomethingContradicts) {
  add(2, 0.01);
  add(2, 0.3, "height+20");  // three cars near
  add(2, 0.6, "focal100");   // none seen obliquely, no dashes, no turn
  ASSERT_EQ(replay(), 0) << err_;
  EXPECT_EQ(row("even, height+20")["cases"], 1);
  EXPECT_EQ(row("even, height+20")["belief"]["good"], 0.0);
  EXPECT_TRUE(row("even, focal100").is_null());
}

TEST_F(ReplayScript, RunsWithoutEvidenceAreBadInput) {
  add(2, 0.01, "none", false);
  EXPECT_EQ(replay(), 2);
  EXPECT_THAT(err_, HasSubstr("no runs with evidence"));
}

}  // namespace
