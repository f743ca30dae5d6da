#include "benchmarks/report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <limits>
#include <stdexcept>

#include "camber/core/errors.h"
#include "support/test_data.h"

namespace camber::bench {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;

Program program() {
  return {"bench_example",
          "An example",
          {"near", "far"},
          {{"--cars", "", "list them", false},
           {"--scenes", "N", "how many"},
           {"--keep", "DIR", "where", false}}};
}

Settings parse(const std::vector<std::string>& words) { return parse_settings(program(), words); }

int run(const std::vector<std::string>& words, const std::function<void(Report&)>& body) {
  std::vector<std::string> all = words;
  all.insert(all.begin(), "bench_example");
  std::vector<char*> argv;
  for (std::string& word : all) argv.push_back(word.data());
  return run_program(program(), static_cast<int>(argv.size()), argv.data(), body);
}

json read(const std::filesystem::path& path) {
  std::ifstream in(path);
  return json::parse(in);
}

TEST(BenchmarkSettings, CommonOptionsSectionsAndOwnOptions) {
  const Settings none = parse({});
  EXPECT_TRUE(none.json.empty());
  EXPECT_EQ(none.first_seed, 0u);
  EXPECT_EQ(none.last_seed, 0u);
  EXPECT_FALSE(none.accuracy_only);
  const Settings s = parse({"far", "--json", "out.json", "--seed", "3", "--cars", "--scenes", "20",
                            "--accuracy-only", "--resume"});
  EXPECT_EQ(s.json, "out.json");
  EXPECT_EQ(s.first_seed, 3u);
  EXPECT_EQ(s.last_seed, 3u);
  EXPECT_TRUE(s.accuracy_only);
  EXPECT_TRUE(s.resume);
  EXPECT_THAT(s.sections, ElementsAre("far"));
  const Report report(program(), s, 3);
  EXPECT_TRUE(report.wanted("far"));
  EXPECT_FALSE(report.wanted("near"));
  EXPECT_TRUE(report.flag("--cars"));
  EXPECT_FALSE(report.flag("--keep"));
  EXPECT_EQ(report.count("--scenes", 7), 20u);
  EXPECT_TRUE(Report(program(), none, 0).wanted("near"));
  EXPECT_EQ(Report(program(), none, 0).count("--scenes", 7), 7u);
}

TEST(BenchmarkSettings, RangesOfSeedsHaveAFileEach) {
  const Settings s = parse({"--seeds", "8:10", "--json", "folder/out.json"});
  EXPECT_TRUE(s.range);
  EXPECT_EQ(s.first_seed, 8u);
  EXPECT_EQ(s.last_seed, 10u);
  EXPECT_EQ(json_path(s, 9), "folder/out-9.json");
  EXPECT_EQ(json_path(parse({"--json", "out.json", "--seed", "9"}), 9), "out.json");
}

TEST(BenchmarkSettings, RefuseWhatMeansNothing) {
  for (const char* range : {"3", "3:", ":3", "5:4", "0:1000", "a:b", "1:2:3", "-1:2"}) {
    SCOPED_TRACE(range);
    EXPECT_THROW(parse({std::string("--seeds=") + range}), UsageError);
  }
  EXPECT_THROW(parse({"middle"}), UsageError);
  EXPECT_THROW(parse({"--no-such-option"}), UsageError);
  EXPECT_THROW(parse({"--seed", "1", "--seeds", "1:2"}), UsageError);
  for (const char* seed : {"-1", "1.5", "", "x", "1234567890123456789"}) {
    SCOPED_TRACE(seed);
    EXPECT_THROW(parse({std::string("--seed=") + seed}), UsageError);
  }
  for (const char* count : {"0", "-3", "many", "3.5"}) {
    SCOPED_TRACE(count);
    EXPECT_THROW(
        Report(program(), parse({std::string("--scenes=") + count}), 0).count("--scenes", 1),
        UsageError);
  }
}

TEST(BenchmarkReport, HoldsTablesItemsAndWhatTheyWereMadeBy) {
  Report report(program(), parse({"--seed", "4", "--scenes", "20", "--keep", "/a/folder"}), 4);
  report
      .table(
          "near.errors", "Errors", "near",
          {label("distance"), lower("error", "m"), higher("found"), value("cars"), timing("time")})
      .row({"<= 15 m", 0.1 + 0.2, std::nan(""), 12, 3.5});
  report.items("near.cars", {lower("error", "m"), value("sigma", "m")})
      .add("dev_00/3", {0.25, std::numeric_limits<double>::infinity()});
  const json out = json::parse(report.json().dump());
  EXPECT_EQ(out["format"], "camber-benchmark");
  EXPECT_EQ(out["version"], 1);
  EXPECT_EQ(out["program"], "bench_example");
  EXPECT_EQ(out["seed"], 4);
  EXPECT_EQ(out["revision"], revision());
  EXPECT_FALSE(out["library_tree"].get<std::string>().empty());
  EXPECT_GT(out["machine"]["cores"], 0);
  EXPECT_FALSE(out["machine"]["cpu"].get<std::string>().empty());
  EXPECT_EQ(out["date"].get<std::string>().size(), std::string("2000-01-01T00:00:00Z").size());
  // What only says where things lie on this machine is not kept.
  EXPECT_EQ(out["options"]["scenes"], "20");
  EXPECT_FALSE(out["options"].contains("keep"));
  const json& table = out["tables"].at(0);
  EXPECT_EQ(table["key"], "near.errors");
  EXPECT_EQ(table["name"], "Errors");
  EXPECT_EQ(table["command"], "build/release/bin/bench_example near --scenes 20 --seed 4");
  EXPECT_EQ(table["columns"][0], json({{"name", "distance"}, {"label", true}}));
  EXPECT_EQ(table["columns"][1], json({{"name", "error"}, {"unit", "m"}, {"better", "lower"}}));
  EXPECT_EQ(table["columns"][2], json({{"name", "found"}, {"better", "higher"}}));
  EXPECT_EQ(table["columns"][4],
            json({{"name", "time"}, {"unit", "ms"}, {"timing", true}, {"better", "lower"}}));
  EXPECT_EQ(table["rows"].size(), 1u);
  EXPECT_EQ(table["rows"][0][1].get<double>(), 0.1 + 0.2);  // to the last bit
  EXPECT_TRUE(table["rows"][0][2].is_null());
  EXPECT_EQ(table["rows"][0][4], 3.5);
  const json& cars = out["items"]["near.cars"];
  EXPECT_EQ(cars["columns"].size(), 2u);
  EXPECT_EQ(cars["values"]["dev_00/3"][0], 0.25);
  EXPECT_TRUE(cars["values"]["dev_00/3"][1].is_null());
}

TEST(BenchmarkReport, RunsForAccuracyKeepNoTimes) {
  Report report(program(), parse({"--accuracy-only"}), 0);
  report.table("t", "T", "", {lower("error"), timing("time")}).row({1.0, 2.0});
  report.items("i", {timing("time"), value("error")}).add("a", {3.0, 4.0});
  const json out = report.json();
  EXPECT_EQ(out["tables"][0]["rows"][0], json({1.0, nullptr}));
  EXPECT_EQ(out["items"]["i"]["values"]["a"], json({nullptr, 4.0}));
  EXPECT_EQ(out["tables"][0]["command"], "build/release/bin/bench_example");
}

TEST(BenchmarkReport, RefusesWhatCouldNotBePaired) {
  Report report(program(), parse({}), 0);
  Table& table = report.table("t", "T", "", {label("a"), label("b"), value("c")});
  table.row({"x", "y", 1});
  table.row({"x", "z", 1});
  EXPECT_THROW(table.row({"x", "y", 2}), std::logic_error);
  EXPECT_THROW(table.row({"x", "w"}), std::logic_error);
  EXPECT_THROW(table.row({1, "w", 1}), std::logic_error);
  EXPECT_THROW(table.row({"x", "w", "1"}), std::logic_error);
  EXPECT_THROW(report.table("t", "T", "", {}), std::logic_error);
  Items& items = report.items("i", {value("a")});
  items.add("x", {1.0});
  EXPECT_THROW(items.add("x", {1.0}), std::logic_error);
  EXPECT_THROW(items.add("y", {}), std::logic_error);
  EXPECT_THROW(report.items("i", {}), std::logic_error);
}

TEST(BenchmarkProgram, WritesAFileASeedAndResumes) {
  const test::TemporaryFolder folder;
  const std::string out = (folder.path() / "out.json").string();
  std::vector<std::uint64_t> seeds;
  const auto body = [&](Report& report) {
    seeds.push_back(report.seed());
    report.table("t", "T", "", {value("seed")}).row({report.seed()});
  };
  EXPECT_EQ(run({"--seeds", "2:4", "--json", out}, body), 0);
  EXPECT_THAT(seeds, ElementsAre(2, 3, 4));
  EXPECT_EQ(read(folder.path() / "out-3.json")["tables"][0]["rows"][0][0], 3.0);
  std::filesystem::remove(folder.path() / "out-3.json");
  seeds.clear();
  EXPECT_EQ(run({"--seeds", "2:4", "--json", out, "--resume"}, body), 0);
  EXPECT_THAT(seeds, ElementsAre(3));
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "out-3.json"));
}

TEST(BenchmarkProgram, FailsWithTheExitCodesOfTheProgram) {
  const test::TemporaryFolder folder;
  const std::string out = (folder.path() / "out.json").string();
  testing::internal::CaptureStderr();
  EXPECT_EQ(run({"middle"}, [](Report&) {}), 2);
  EXPECT_THAT(testing::internal::GetCapturedStderr(), HasSubstr("bench_example: "));
  // What failed leaves no file.
  EXPECT_EQ(run({"--json", out}, [](Report&) { throw NoAnswerError("no parallax"); }), 1);
  EXPECT_FALSE(std::filesystem::exists(out));
  EXPECT_EQ(run({"--json", "/proc/no/such.json"}, [](Report&) {}), 3);
}

}  // namespace
}  // namespace camber::bench
