// tests/benchmarks/drives.py over a stand-in for the program whose errors are known.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::read_text;
using testing::HasSubstr;

namespace {

/// `synth`: drives of 30 frames at 1.5 m, each with a near and a far car. `drive`: number n is n
/// per cent too long, sigma 1 %, and its cars are 0.1 n and 0.2 n m off; number 4 is refused.
/// `reconstruct` about a frame: 0.2 n and 0.3 n m; about frame 20 it misses the far car. Each run
/// leaves a line in `calls`.
const char* const kStandIn = R"py(#!/usr/bin/env -S python3 -S
import json, math, os, sys
words = sys.argv[1:]
def after(word): return words[words.index(word) + 1]
out = after("--out")
os.makedirs(out)
with open(os.environ["CALLS"], "a") as calls: calls.write(" ".join(words) + "\n")
if words[0] == "synth":
    car = {"bottom_center": [2, 1, 9], "rotation_y": 1.5}
    json.dump({"name": after("--seed"),
               "camera": {"width": 8, "height": 4, "fx": 6, "fy": 6, "cx": 4, "cy": 2,
                          "height_above_road": 7.0, "height_sigma": 1e-6},
               "frames": [{"id": i, "image": "x.png"} for i in range(30)],
               "truth": {"cloud": "road.ply", "frames": [
                   {"id": i, "ego_plane": {"offset": 1.5}, "vehicles": [dict(car, id=7)]}
                   for i in range(30)]}}, open(out + "/scene.json", "w"))
    sys.exit(0)
scene = json.load(open(words[1] if words[0] != "evaluate" else after("--truth")))
n = int(scene["name"])
if n == 4:
    print("camber: " + words[1] + ": the camera does not move", file=sys.stderr)
    sys.exit(1)
if not os.path.isabs(scene["truth"]["cloud"]) or abs(scene["camera"]["height_above_road"] - 1.5) > 1e-4:
    sys.exit(3)
if words[0] == "drive":
    json.dump({"warnings": []}, open(out + "/run.json", "w"))
elif words[0] == "reconstruct":
    k = scene["reference_frame"]
    cars = [(7, 9, 0.2 * n, 1.0), (8, 40, 0.3 * n, 9.0)][:1 if k == 20 else 2]
    json.dump({"vehicles": [{"frame": f, "truth_id": i, "distance": d, "center_error": e + f - k,
                             "center_mahalanobis": m, "along_error": e}
                            for f in (k - 1, k) for i, d, e, m in cars]},
              open(out + "/metrics.json", "w"))
else:
    kitti = {"half": {"translation_percent": n, "rotation_deg_per_100m": 0.1 * n}}
    windows = {"count": 10 * n, "within_2_percent": 1.0 if n < 2 else 0.5, "within_2_sigma": 1.0,
               "own_spread": 1.0, "p95_abs_log_error": 0.01}
    road = {"cells": 100 * n, "share_answered": 0.9, "height_error": {"median": 0.01 * n, "p95": 0.02 * n},
            "height_error_joined": {"median": 0.01, "p95": 0.02},
            "height_error_beside": {"p95": 0.02, "within_95": 0.95},
            "grade_error_deg": {"rms": 0.1}, "frame_grade_error_deg": {"rms": 0.3 * n, "within_95": 1.0}}
    json.dump({"trajectories": [{"true_length": 100, "length_log_error": 0.01 * n,
                                 "length_error_sigma": n, "length_sigma": 0.01, "share_with_pose": 1.0,
                                 "windows": windows, "kitti_every_frame": kitti}],
               "strips": [road], "tracks": [{"id_switches": n, "fragmentations": 0, "split": 0,
                                             "true_vehicles": 60}]}, open(out + "/tables.json", "w"))
    with open(out + "/vehicles.csv", "w") as file:
        file.write("frame,truth_id,distance,center_error,along_error,center_mahalanobis\n")
        for i in range(30):
            file.write("%d,7,9,%g,0.09,1\n%d,8,40,%g,,9\n" % (i, 0.1 * n, i, 0.2 * n))
)py";

class DrivesScript : public testing::Test {
 protected:
  void SetUp() override {
    if (std::system("python3 -c '' >/dev/null 2>&1") != 0) GTEST_SKIP() << "no python3";
    fs::create_directories(folder_.path() / "bin");
    const fs::path program = folder_.path() / "bin" / "camber";
    std::ofstream(program) << kStandIn;
    fs::permissions(program, fs::perms::owner_all);
  }

  int drives(const std::string& arguments) {
    const std::string benchmarks = (camber::test::source_dir() / "tests" / "benchmarks").string();
    fs::remove(folder_.path() / "report.json");
    const std::string line =
        "cd '" + folder_.path().string() + "' && CALLS=\"$PWD/calls\" python3 " + "-B '" +
        benchmarks + "/drives.py' --camber bin/camber --scenes made " +
        "--out runs --json report.json --tables tables/t.json " + arguments + " >out 2>err";
    const int status = std::system(line.c_str());
    out_ = read_text(folder_.path() / "out");
    err_ = read_text(folder_.path() / "err");
    const std::string text = read_text(folder_.path() / "report.json");
    report_ = text.empty() ? nlohmann::json() : nlohmann::json::parse(text);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  long calls() {
    const std::string text = read_text(folder_.path() / "calls");
    return std::count(text.begin(), text.end(), '\n');
  }

  nlohmann::json summary(const std::string& measure) {
    for (const nlohmann::json& row : report_["summary"]) {
      if (row[0] == measure) return {row[1], row[2]};
    }
    return {};
  }

  camber::test::TemporaryFolder folder_;
  std::string out_, err_;
  nlohmann::json report_;
};

TEST_F(DrivesScript, ShareMeansAndTheWorst) {
  ASSERT_EQ(drives("--numbers 1:4"), 0) << err_;
  EXPECT_EQ(summary("drives")[0], 3);
  EXPECT_NEAR(summary("length within 1 %, %")[0], 100.0 / 3.0, 1e-9);
  EXPECT_NEAR(summary("length error, %")[0], 2.0, 1e-9);
  EXPECT_NEAR(summary("length error, %")[1], 3.0, 1e-9);
  EXPECT_NEAR(summary("length inside 2 sigma, %")[0], 200.0 / 3.0, 1e-9);
  // 10, 20 and 30 windows.
  EXPECT_NEAR(summary("windows within 2 %, %")[0], 100.0 * (10.0 + 25.0) / 60.0, 1e-9);
  EXPECT_NEAR(summary("rotation, deg a 100 m")[0], 0.2, 1e-9);
  EXPECT_NEAR(summary("height, median, m")[0], 0.01 * (1.0 + 4.0 + 9.0) / 6.0, 1e-9);
  EXPECT_NEAR(summary("height, median, m")[1], 0.03, 1e-9);
  EXPECT_NEAR(summary("grade of frames, rms, deg")[0], 0.3 * std::sqrt(14.0 / 3.0), 1e-9);
  EXPECT_EQ(summary("id switches"), (nlohmann::json{6, 3}));
  ASSERT_EQ(report_["refused"].size(), 1u);
  EXPECT_EQ(report_["refused"][0]["scene"], "drive_000004");
  EXPECT_THAT(out_, HasSubstr("exit code 1, drive: camber: scene.json: the camera does not move"));
  EXPECT_THAT(read_text(folder_.path() / "tables" / "t.json"), HasSubstr("drives.vehicles"));
}

TEST_F(DrivesScript, VehiclesOfTheSameFramesAreCompared) {
  ASSERT_EQ(drives("--numbers 1:3 --odd"), 0) << err_;
  // Frames 0, 10 and 20 of two drives, the far car not in frame 20.
  const nlohmann::json& all = report_["vehicles"][0];
  EXPECT_EQ(all["vehicles"], 10);
  EXPECT_EQ(all["only_drive"], 2);
  EXPECT_EQ(all["only_frame"], 0);
  const nlohmann::json& near = report_["vehicles"][1];
  EXPECT_EQ(near["distance"], "<= 15 m");
  EXPECT_NEAR(near["frame_mean"], 0.4, 1e-9);
  EXPECT_NEAR(near["drive_mean"], 0.2, 1e-9);
  EXPECT_NEAR(near["too_far"], 0.01, 1e-9);
  EXPECT_EQ(near["drive_inside"], 1.0);
  const nlohmann::json& far = report_["vehicles"][2];
  EXPECT_EQ(far["distance"], "> 30 m");
  EXPECT_NEAR(far["frame_median"], 0.6, 1e-9);
  EXPECT_NEAR(far["drive_median"], 0.4, 1e-9);
  EXPECT_EQ(far["drive_inside"], 0.0);
}

TEST_F(DrivesScript, WhatIsThereIsNotRunAgain) {
  ASSERT_EQ(drives("--numbers 1 --keep kept"), 0) << err_;
  EXPECT_EQ(calls(), 1 + 2 + 3);  // synth, drive and evaluate, three frames
  EXPECT_FALSE(fs::is_empty(folder_.path() / "kept"));
  const nlohmann::json first = report_["summary"];
  std::ofstream(folder_.path() / "runs" / "runs.jsonl", std::ios::app) << R"({"key": "ab)";
  ASSERT_EQ(drives("--numbers 1"), 0) << err_;
  EXPECT_EQ(calls(), 6);
  EXPECT_EQ(report_["summary"], first);
  std::ofstream(folder_.path() / "bin" / "camber", std::ios::app) << "\n";
  ASSERT_EQ(drives("--numbers 1 --every 0"), 0) << err_;
  EXPECT_EQ(calls(), 8);
  EXPECT_TRUE(report_["vehicles"].empty());
}

TEST_F(DrivesScript, CrashesAndBadInput) {
  ASSERT_EQ(drives("--numbers 0 --every 0"), 0) << err_;
  std::ofstream(folder_.path() / "bin" / "camber") << "#!/bin/sh\necho lost >&2\nexit 3\n";
  EXPECT_EQ(drives("--numbers 0 --every 0"), 1);
  EXPECT_THAT(out_, HasSubstr("drive_000000 none: exit code 3, drive: lost"));
  EXPECT_EQ(drives("--numbers 0 --every -1"), 2);
  EXPECT_THAT(err_, HasSubstr("--every: found -1, expected 0 or more"));
  EXPECT_EQ(drives("--numbers 9 --maker steep_scenes"), 2);
  EXPECT_THAT(err_, HasSubstr("--steep-scenes"));
}

}  // namespace
