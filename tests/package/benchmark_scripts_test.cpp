// The scripts over the benchmarks' JSON, on made runs with known differences.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::read_text;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

namespace {

/// One run of a program with one table of two rows and one set of items, as report.h writes it.
struct MadeRun {
  int seed = 0;
  std::string near_error = "0.5", far_error = "2.0", time = "10.0", cars = "7";
  std::vector<std::string> items = {"1.0", "2.0", "3.0", "4.0"};  ///< two a scene
  std::string options = "{}", revision = "abc1234", table = "plane";

  std::string json() const {
    std::ostringstream out;
    out << R"({"format": "camber-benchmark", "version": 1, "program": "bench_road_clouds",
      "revision": ")"
        << revision << R"(", "library_tree": "tree", "date": "2001-02-03T04:05:06Z",
      "machine": {"cpu": "A processor", "cores": 2,
                  "load_average": {"before": [1.5], "after": [0.5]}},
      "seed": )"
        << seed << R"(, "options": )" << options << R"(,
      "tables": [{"key": ")"
        << table << R"(", "name": "One plane", "command": "build/release/bin/bench_x plane",
        "columns": [{"name": "library", "label": true}, {"name": "points", "label": true},
                    {"name": "with", "label": true},
                    {"name": "CPU", "unit": "ms", "timing": true, "better": "lower"},
                    {"name": "normal, mean", "unit": "deg", "better": "lower"},
                    {"name": "cars"}],
        "rows": [["Camber", "1e5", "x y z", )"
        << time << ", " << near_error << ", " << cars << R"(],
                 ["PCL RANSAC", "1e5", "x y z", 4.0, )"
        << far_error << R"(, 7]]}],
      "items": {"cars": {"columns": [{"name": "centre", "unit": "m", "better": "lower"}],
        "values": {)";
    for (std::size_t i = 0; i < items.size(); ++i) {
      out << (i ? ", " : "") << "\"scene" << i / 2 << "/" << i << "\": [" << items[i] << "]";
    }
    out << "}}}}";
    return out.str();
  }
};

class BenchmarkScripts : public testing::Test {
 protected:
  void SetUp() override {
    if (std::system("python3 -c '' >/dev/null 2>&1") != 0) GTEST_SKIP() << "no python3";
  }

  void write(const std::string& side, const MadeRun& run) {
    fs::create_directories(folder_.path() / side);
    std::ofstream(folder_.path() / side / (std::to_string(run.seed) + ".json")) << run.json();
  }

  int run(const std::string& script, const std::string& arguments) {
    const std::string line = "cd '" + folder_.path().string() + "' && python3 -B '" +
                             (camber::test::source_dir() / "tests" / "benchmarks").string() + "/" +
                             script + "' " + arguments + " >out 2>err";
    const int status = std::system(line.c_str());
    out_ = read_text(folder_.path() / "out");
    err_ = read_text(folder_.path() / "err");
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  int compare(const std::string& more = "") {
    return run("compare_revisions.py", "--reference before --now after " + more);
  }

  int run_page(const std::string& arguments) { return run("make_benchmark_md.py", arguments); }

  camber::test::TemporaryFolder folder_;
  std::string out_, err_;
};

TEST_F(BenchmarkScripts, EqualRunsAreIdenticalWhateverTheirTimes) {
  for (int seed = 0; seed < 3; ++seed) {
    MadeRun run;
    run.seed = seed;
    write("before", run);
    run.time = std::to_string(seed);
    run.revision = "def5678";
    write("after", run);
  }
  EXPECT_EQ(compare(), 0) << err_;
  EXPECT_THAT(out_, HasSubstr("reference: revision abc1234, library tree"));
  EXPECT_THAT(out_, HasSubstr("now: revision def5678, library tree"));
  EXPECT_THAT(out_, HasSubstr("5 figures: 5 identical\n"));
  EXPECT_THAT(out_, Not(HasSubstr("CPU")));
}

TEST_F(BenchmarkScripts, RoundingIsNoDifferenceAndIsReported) {
  MadeRun run;
  write("before", run);
  run.near_error = "0.50000000001";
  write("after", run);
  EXPECT_EQ(compare(), 0) << err_;
  EXPECT_THAT(out_, HasSubstr("5 figures: 4 identical, 1 equal\n"));
  EXPECT_THAT(out_, HasSubstr("largest difference 2.0e-11"));
  EXPECT_EQ(compare("--rounding 1e-12 --all"), 0);
  // One pair has no standard error.
  EXPECT_THAT(out_, HasSubstr("changed   Camber | 1e5 | x y z: normal, mean: 0.5 -> 0.5 deg, "
                              "+1e-11 +- ? (1 pairs)"));
}

TEST_F(BenchmarkScripts, MeanAndStandardErrorOfPairedDifferences) {
  const double differences[] = {0.01, 0.02, 0.03};
  for (int seed = 0; seed < 3; ++seed) {
    MadeRun run;
    run.seed = seed;
    run.far_error = std::to_string(2.0 + 0.1 * seed);
    write("before", run);
    // The first row is worse by two hundredths and 0.01 / sqrt(3) of standard error, the second one
    // better by the same; what is neither better nor worse is a change.
    run.near_error = std::to_string(0.5 + differences[seed]);
    run.far_error = std::to_string(2.0 + 0.1 * seed - differences[seed]);
    run.cars = "8";
    write("after", run);
  }
  EXPECT_EQ(compare(), 1) << err_;
  EXPECT_THAT(out_, HasSubstr("WORSE     Camber | 1e5 | x y z: normal, mean: 0.5 -> 0.52 deg, "
                              "+0.02 +- 0.0058 (3 pairs)"));
  EXPECT_THAT(out_, HasSubstr("better    PCL RANSAC | 1e5 | x y z: normal, mean: 2.1 -> 2.08 deg, "
                              "-0.02 +- 0.0058 (3 pairs)"));
  EXPECT_THAT(out_, HasSubstr("changed   Camber | 1e5 | x y z: cars: 7 -> 8, +1 +- 0 (3 pairs)"));
  EXPECT_THAT(out_, HasSubstr("2 identical, 1 better, 1 changed, 1 WORSE\n"));
}

TEST_F(BenchmarkScripts, WithinTwoStandardErrorsIsNotWorse) {
  for (int seed = 0; seed < 3; ++seed) {
    MadeRun run;
    run.seed = seed;
    write("before", run);
    run.near_error = seed == 0 ? "0.49" : "0.53";
    write("after", run);
  }
  EXPECT_EQ(compare(), 0);
  EXPECT_THAT(out_, HasSubstr("within    Camber | 1e5 | x y z: normal, mean"));
}

TEST_F(BenchmarkScripts, ItemsOfOneSceneAreNotIndependent) {
  MadeRun run;
  write("before", run);
  // Differences 0.1, 0.1 in one scene, 0.4, 0.4 in the other: mean 0.25; by scenes its standard
  // error is 0.15, by cars it would be 0.087 and the difference beyond two of them.
  run.items = {"1.1", "2.1", "3.4", "4.4"};
  write("after", run);
  EXPECT_EQ(compare(), 0);
  EXPECT_THAT(out_, HasSubstr("items cars: 0 of 1 figures equal"));
  EXPECT_THAT(out_, HasSubstr("within    centre: 2.5 -> 2.75 m, +0.25 +- 0.15 (4 pairs)"));
}

TEST_F(BenchmarkScripts, LostItemsAndValuesFail) {
  MadeRun run;
  write("before", run);
  run.items.pop_back();
  run.near_error = "null";
  write("after", run);
  EXPECT_EQ(compare(), 1);
  EXPECT_THAT(out_, HasSubstr("LOST      Camber | 1e5 | x y z: normal, mean: no pairs, 1 lost"));
  EXPECT_THAT(out_, HasSubstr("LOST      centre: 2 -> 2 m, +0 +- 0 (3 pairs), 1 lost"));
}

TEST_F(BenchmarkScripts, SeedsThatOneSideLacksAreNamed) {
  MadeRun run;
  write("before", run);
  write("after", run);
  run.seed = 1;
  write("before", run);
  EXPECT_EQ(compare(), 0);
  EXPECT_THAT(out_, HasSubstr("bench_road_clouds: seeds [0, 1] in the reference, [0] now; "
                              "compared: [0]"));
}

TEST_F(BenchmarkScripts, TablesThatOneSideWasNotAskedForWithASeedAreNamedNotLost) {
  for (int seed = 0; seed < 2; ++seed) {
    MadeRun run;
    run.seed = seed;
    write("before", run);
    if (seed == 1) run.table = "another";
    write("after", run);
  }
  EXPECT_EQ(compare("--all"), 0);
  EXPECT_THAT(out_, HasSubstr("not run now, with some or all of these seeds: plane\n"));
  EXPECT_THAT(out_, HasSubstr("cars: 7 -> 7, +0 +- ? (1 pairs)"));
  EXPECT_THAT(out_, HasSubstr("centre: 2.5 -> 2.5 m, +0 +- 0 (8 pairs)"));
}

TEST_F(BenchmarkScripts, RefuseWhatCannotBeCompared) {
  MadeRun run;
  write("before", run);
  EXPECT_EQ(compare(), 2);
  EXPECT_THAT(err_, HasSubstr("compare_revisions.py: after: "));
  run.options = R"({"largest": "1000"})";
  write("after", run);
  EXPECT_EQ(compare(), 2);
  EXPECT_THAT(err_, HasSubstr("run with other options"));
  std::ofstream(folder_.path() / "after" / "0.json") << "{}";
  EXPECT_EQ(compare(), 2);
  EXPECT_THAT(err_, HasSubstr("0.json: not the JSON of a benchmark program"));
  std::ofstream(folder_.path() / "after" / "0.json") << "{";
  EXPECT_EQ(compare(), 2);
  EXPECT_THAT(err_, AllOf(HasSubstr("0.json: "), Not(HasSubstr("Traceback"))));
}

TEST_F(BenchmarkScripts, PageHasTablesCommandsRevisionsAndWhereWeLose) {
  MadeRun run;
  write("runs", run);
  ASSERT_EQ(run_page("runs"), 0) << err_;
  EXPECT_THAT(out_, HasSubstr("| bench_road_clouds | abc1234 | 2001-02-03 | 0 | A processor, 2 "
                              "cores | 0.500 to 1.50 |\n"));
  EXPECT_THAT(out_, HasSubstr("**One plane, 30 % outliers**: `build/release/bin/bench_x plane`\n"));
  EXPECT_THAT(out_, HasSubstr("| Camber | 1e5 | x y z | 10 | 0.500 |"));
  EXPECT_THAT(out_, HasSubstr("Camber loses, 1e5, x y z, CPU: PCL RANSAC 4, Camber 10."));
  EXPECT_THAT(out_, Not(HasSubstr("Camber loses, 1e5, x y z, normal")));
  EXPECT_THAT(out_, HasSubstr("Not measured: "));
}

TEST_F(BenchmarkScripts, PageOfSeveralSeedsShowsMeansAndOfTimesMedians) {
  for (int seed = 0; seed < 3; ++seed) {
    MadeRun run;
    run.seed = seed;
    run.near_error = std::to_string(0.5 + 0.1 * seed);
    run.time = seed == 2 ? "100" : "3";
    write("runs", run);
  }
  ASSERT_EQ(run_page("runs"), 0) << err_;
  EXPECT_THAT(out_, HasSubstr("| 0, 1, 2 |"));
  EXPECT_THAT(out_, HasSubstr("| Camber | 1e5 | x y z | 3 | 0.600 |"));
  EXPECT_THAT(out_, Not(HasSubstr("Camber loses")));
}

TEST_F(BenchmarkScripts, PageIsMadeFromTheTablesThatAreKept) {
  MadeRun run;
  run.near_error = "0.123456789";
  write("runs", run);
  ASSERT_EQ(run_page("runs --store kept --out page.md"), 0) << err_;
  EXPECT_EQ(out_, "");
  const std::string kept = read_text(folder_.path() / "kept" / "0.json");
  EXPECT_THAT(kept, AllOf(HasSubstr("0.123457"), Not(HasSubstr("scene0"))));
  ASSERT_EQ(run_page("kept"), 0) << err_;
  EXPECT_EQ(out_, read_text(folder_.path() / "page.md"));
}

}  // namespace
