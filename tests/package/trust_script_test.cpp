// tests/benchmarks/trust.py over a stand-in for the program whose errors are known.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>

#include "support/test_data.h"

namespace fs = std::filesystem;
using camber::test::read_text;
using testing::HasSubstr;
using testing::Not;

namespace {

/// `synth`: scenes of five frames at 1.5 m, 0.6 m apart; of number n the images of its folder have
/// 8 x 4 pixels of grey 100 + n. `reconstruct`: number n is n hundredths off, by a logarithm, plus
/// what the height is off, with sigma 0.05; number 4 is refused; a fault of the images is warned
/// of, with what was seen of it. Each run leaves a line in `calls`.
const char* const kStandIn = R"py(#!/usr/bin/env -S python3 -S
import json, math, os, sys
sys.path.insert(0, os.environ["BENCHMARKS"])
import png8
words = sys.argv[1:]
out = words[words.index("--out") + 1]
os.makedirs(out)
with open(os.environ["CALLS"], "a") as calls: calls.write(" ".join(words) + "\n")
if words[0] == "synth":
    n = int(words[words.index("--random") + 1])
    eye = lambda z: [1,0,0,0, 0,1,0,0, 0,0,1,z, 0,0,0,1]
    png8.write(out + "/image.png", png8.Image(8, 4, 8, 0, [bytes([100 + n]) * 8] * 4))
    car = {"bottom_center": [2, 1, 9], "rotation_y": 1.5}
    scene = {"name": str(n), "reference_frame": 2, "markings_m": {"line_width": 0.1},
             "camera": {"width": 8, "height": 4, "fx": 6, "fy": 6, "cx": 4, "cy": 2,
                        "height_above_road": 7.0, "height_sigma": 0.3 if n >= 100 else 1e-6},
             "frames": [{"id": i, "image": "image.png", "segmentation": "image.png",
                         "vehicles": [{"box": [0, 0, i, 1]}]} for i in range(5)],
             "truth": {"frames": [{"id": i, "world_from_camera": eye(0.6 * i),
                       "ego_plane": {"offset": 1.5}, "vehicles": [car] * 3} for i in range(5)]}}
    json.dump(scene, open(out + "/scene.json", "w"))
    sys.exit(0)
scene = json.load(open(words[1]))
n = int(scene["name"])
if n == 4:
    print("camber: " + words[1] + ": 12 points are too few", file=sys.stderr)
    sys.exit(1)
frames = {f["id"]: f for f in scene["frames"]}
seen = []
for i, f in frames.items():
    rows = png8.read(f["image"]).rows
    if rows[0][0] != 100 + n or rows[0][7] != 100 + n: seen.append("%d:%s" % (i, list(rows[3])))
    if f["vehicles"] != [{"box": [0, 0, i, 1]}]: seen.append("%d:%s" % (i, f["vehicles"]))
    if "segmentation" not in f: seen.append("no mask")
    if f.get("world_from_camera", [1])[0] != 1: seen.append("%d turned" % i)
if "world_from_camera" in frames[0]: seen.append("poses")
if "markings_m" not in scene: seen.append("no sizes")
if scene["camera"]["cx"] == 0: seen.append("cx")
if scene["camera"]["fx"] != 6: seen.append("fx %.3g" % scene["camera"]["fx"])
if "focal_sigma" in scene["camera"]: seen.append("+- %.3g" % scene["camera"]["focal_sigma"])
error = 0.01 * n * (n < 100) + math.log(max(scene["camera"]["height_above_road"], 0.01) / 1.5)
car = {"frame": 2, "estimate_id": 0, "distance": 9, "center_error": 0.1 * n,
       "center_mahalanobis": 1.6 * n, "height_error": -0.1 * n, "height_sigma": 0.1,
       "along_error": 0.3 * n}
json.dump({"constraints": [], "markings": {"dashes": n % 2}, "options": {"frames": [1, 2, 3]}, "scale_sigma": 0.05,
           "scale_status": "weak" if n == 3 else "ok",
           "warnings": [{"code": "seen", "text": " ".join(seen)}] if seen else []},
          open(out + "/run.json", "w"))
far = dict(car, estimate_id=1, distance=20, along_error=90)
json.dump({"scale_error": math.expm1(error), "vehicles": [far, car]},
          open(out + "/metrics.json", "w"))
stated = {"center": [0, 3, 4], "covariance": [9.0, 0, 0, 0, 1.0, 0, 0, 0, 0.25]}
json.dump({"frames": [{"id": 2, "vehicles": [dict(stated, id=0), dict(stated, id=1)]}]},
          open(out + "/vehicles.json", "w"))
)py";

class TrustScript : public testing::Test {
 protected:
  void SetUp() override {
    if (std::system("python3 -c '' >/dev/null 2>&1") != 0) GTEST_SKIP() << "no python3";
    fs::create_directories(folder_.path() / "bin");
    const fs::path program = folder_.path() / "bin" / "camber";
    std::ofstream(program) << kStandIn;
    fs::permissions(program, fs::perms::owner_all);
  }

  static std::string benchmarks() {
    return (camber::test::source_dir() / "tests" / "benchmarks").string();
  }

  int python(const std::string& arguments) {
    const std::string line = "cd '" + folder_.path().string() +
                             "' && CALLS=\"$PWD/calls\" PYTHONDONTWRITEBYTECODE=1 BENCHMARKS='" +
                             benchmarks() + "' PYTHONPATH='" + benchmarks() + "' python3 " +
                             arguments + " >out 2>err";
    const int status = std::system(line.c_str());
    out_ = read_text(folder_.path() / "out");
    err_ = read_text(folder_.path() / "err");
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  int trust(const std::string& arguments) {
    fs::remove(folder_.path() / "report.json");
    const int status = python("'" + benchmarks() + "/trust.py' --camber bin/camber --scenes made " +
                              "--out runs --json report.json " + arguments);
    const std::string text = read_text(folder_.path() / "report.json");
    report_ = text.empty() ? nlohmann::json() : nlohmann::json::parse(text);
    return status;
  }

  /// What one run with a fault was warned of.
  std::string seen_with(const std::string& fault, const std::string& more = "") {
    EXPECT_EQ(trust("--numbers 1:2 --faults none," + fault + " " + more), 0) << err_;
    std::istringstream lines(read_text(folder_.path() / "runs" / "runs.jsonl"));
    std::string seen = "not run";
    for (std::string line; std::getline(lines, line);) {
      const nlohmann::json run = nlohmann::json::parse(line);
      if (run["number"] != 1 || run["definition"]["fault"] != fault) continue;
      const nlohmann::json& warnings = run["result"]["warnings"];
      seen = warnings.empty() ? "" : warnings[0][1].get<std::string>();
    }
    return seen;
  }

  long calls() {
    const std::string text = read_text(folder_.path() / "calls");
    return std::count(text.begin(), text.end(), '\n');
  }

  camber::test::TemporaryFolder folder_;
  std::string out_, err_;
  nlohmann::json report_;
};

TEST_F(TrustScript, SharesQuantilesAndTheWorst) {
  ASSERT_EQ(trust("--numbers 0:7,14,21 --frames 1:3 --jobs 2"), 0) << err_;
  const nlohmann::json& row = report_["rows"][0];
  EXPECT_EQ(row["runs"], 10);
  EXPECT_EQ(row["refused"], 1);
  EXPECT_EQ(row["weak"], 1);
  EXPECT_EQ(row["warned"], 0);
  // Without number 4: 0, 1, 2, 3, 5, 6, 7, 14 and 21 % at a sigma of 5 %.
  EXPECT_NEAR(row["error"]["median"], 0.05, 1e-5);
  EXPECT_NEAR(row["error"]["p90"], 0.14 + 0.2 * 0.07, 1e-5);
  EXPECT_NEAR(row["error"]["worst"], 0.21, 1e-5);
  EXPECT_NEAR(row["sigma"]["median"], 0.05, 1e-9);
  EXPECT_NEAR(row["inside_2_sigma"], 7.0 / 9.0, 1e-9);
  EXPECT_NEAR(row["inside_3_sigma"], 8.0 / 9.0, 1e-9);
  EXPECT_EQ(row["beyond_4_sigma"], 1);
  EXPECT_NEAR(row["largest_z"], 4.2, 1e-3);
  const nlohmann::json& cars = row["vehicles"];
  EXPECT_NEAR(cars["mean"], 5.9 / 9.0, 1e-9);
  EXPECT_NEAR(cars["median"], 0.5, 1e-9);
  EXPECT_NEAR(cars["centers_inside_95"], 4.0 / 9.0, 1e-9);  // 1.6 times 0 to 3
  EXPECT_NEAR(cars["heights_inside_95"], 2.0 / 9.0, 1e-9);  // 0 and 1 sigma
  EXPECT_EQ(report_["refusals"], (nlohmann::json{{"camber: scene.json: # points are too few", 1}}));
  EXPECT_THAT(out_, HasSubstr("  synth_000003 1:3: weak\n  synth_000004 1:3: refused\n"));
  EXPECT_EQ(report_["worst_by_z"][0]["scene"], "synth_000021");
  EXPECT_EQ(report_["worst_by_error"][1]["number"], 14);
  EXPECT_THAT(out_,
              HasSubstr("synth_000021 1:3: error +23.37 sigma 5.00 % z 4.2 ok, 0.40 heights"));
}

TEST_F(TrustScript, WhatIsThereIsNotRunAgain) {
  ASSERT_EQ(trust("--numbers 0:3 --odd --frames 1:3,none"), 0) << err_;
  EXPECT_EQ(calls(), 2 + 4);
  const nlohmann::json first = report_["rows"];
  // A line that was cut off is one run more, and a crash in it harms none.
  std::ofstream(folder_.path() / "runs" / "runs.jsonl", std::ios::app) << R"({"key": "ab)";
  ASSERT_EQ(trust("--numbers 0:3 --odd --frames 1:3,none"), 0) << err_;
  EXPECT_EQ(calls(), 6);
  EXPECT_EQ(report_["rows"], first);
  ASSERT_EQ(trust("--numbers 1 --frames 1:3,0:4"), 0) << err_;
  EXPECT_EQ(calls(), 7);
  ASSERT_EQ(trust("--numbers 1 --frames 1:3 --seed 1"), 0) << err_;
  EXPECT_EQ(calls(), 8);
  // Another program is another run; the scenes stay.
  std::ofstream(folder_.path() / "bin" / "camber", std::ios::app) << "\n";
  ASSERT_EQ(trust("--numbers 1 --frames 1:3 --report-only"), 0) << err_;
  EXPECT_TRUE(report_["rows"].empty());
  ASSERT_EQ(trust("--numbers 1 --frames 1:3"), 0) << err_;
  EXPECT_EQ(calls(), 9);
  EXPECT_THAT(read_text(folder_.path() / "calls"), HasSubstr("--threads 1 --quiet --no-pictures"));
}

TEST_F(TrustScript, HeightIsDrawnByItsSigma) {
  ASSERT_EQ(trust("--numbers 100:119 --jobs 2"), 0) << err_;
  // A fifth of 1.5 m: the median of |log| is near 0.67 x 0.2, with 20 draws to a third or so.
  EXPECT_NEAR(report_["rows"][0]["error"]["median"], 0.135, 0.06);
  const nlohmann::json first = report_["worst_by_error"];
  ASSERT_EQ(trust("--numbers 100:104 --jobs 2 --seed 1"), 0) << err_;
  EXPECT_NE(report_["worst_by_error"][0]["error"], first[0]["error"]);
}

TEST_F(TrustScript, TheNearestCarOfAGuessedCamera) {
  ASSERT_EQ(trust("--numbers 0:3 --faults fov-15,none"), 0) << err_;
  // The nearer of two, along its ray: 0.3 m a number, the covariance's 0.72 m there.
  const nlohmann::json& cars = report_["faults"][0]["nearest_cars"];
  EXPECT_EQ(cars["count"], 4);
  EXPECT_NEAR(cars["error"], 0.45 / 9.0, 1e-9);
  EXPECT_NEAR(cars["sigma"], std::sqrt(0.52) / 9.0, 1e-9);
  EXPECT_NEAR(cars["inside_2_sigma"], 1.0, 1e-9);
  ASSERT_EQ(trust("--numbers 0:9 --faults fov-15"), 0) << err_;
  EXPECT_NEAR(report_["faults"][0]["nearest_cars"]["inside_2_sigma"], 4.0 / 9.0,
              1e-9);  // 4 refused
}

TEST_F(TrustScript, FaultsReachTheFrameAfterTheReference) {
  EXPECT_EQ(seen_with("none"), "");
  EXPECT_EQ(seen_with("cx0"), "cx");
  EXPECT_EQ(seen_with("focal100"), "fx 12");
  EXPECT_EQ(seen_with("fov+10"), "fx 4.99 +- 0.0894");  // of 67.4 degrees
  EXPECT_THAT(seen_with("fov"), HasSubstr(" +- 0."));
  EXPECT_EQ(seen_with("repeat"), "3:[{'box': [0, 0, 2, 1]}]");
  EXPECT_EQ(seen_with("other"),
            "3:[102, 102, 102, 102, 102, 102, 102, 102] "
            "3:[{'box': [0.0, 0.0, 2.0, 1.0]}]");
  EXPECT_EQ(seen_with("exposure"), "3:[162, 162, 162, 162, 162, 162, 162, 162]");
  EXPECT_EQ(seen_with("black"), "3:[101, 101, 101, 101, 0, 0, 0, 0]");
  EXPECT_EQ(seen_with("pose"), "3 turned poses");
  EXPECT_EQ(seen_with("none", "--poses --no-masks --no-markings"),
            "no mask no mask no mask no mask no mask poses no sizes");
  EXPECT_THAT(seen_with("none", "--no-detections"), HasSubstr("0:[]"));
}

TEST_F(TrustScript, FaultsAreRefusedWarnedOfInsideOrWrong) {
  ASSERT_EQ(trust("--numbers 0,4,6 --faults none,height+20,black,height-10 --frames none"), 0)
      << err_;
  const nlohmann::json& height = report_["faults"][0];
  EXPECT_EQ(height["fault"], "height+20");
  EXPECT_EQ(height["refused"], 1);
  ASSERT_EQ(height["wrong"], 2);
  EXPECT_EQ(height["contradicted"], 3);  // three cars
  EXPECT_NEAR(height["good_of_these"], 1.0 / 3.0, 1e-9);
  EXPECT_EQ(height["listed"][0]["scene"], "synth_000006");
  EXPECT_EQ(report_["faults"][1]["warned"], 2);
  EXPECT_EQ(report_["faults"][2]["inside_3_sigma"], 2);
  EXPECT_EQ(report_["rows"][0]["runs"], 3);  // those without a fault
  EXPECT_THAT(out_, HasSubstr("synth_000006 none (1 2 3) height+20: error +27.42 sigma 5.00 %"));
}

TEST_F(TrustScript, CalibrationIsContradictedByWhatIsSeenAlone) {
  // Of the cars none is seen obliquely from where they are, no scene turns, odd ones have dashes.
  ASSERT_EQ(trust("--numbers 1:3 --faults none,focal10,black"), 0) << err_;
  EXPECT_EQ(report_["faults"][0]["contradicted"], 2);
  EXPECT_EQ(report_["faults"][1]["contradicted"], 3);
}

TEST_F(TrustScript, CrashesAreReportedAndRunAgain) {
  ASSERT_EQ(trust("--numbers 0"), 0) << err_;
  std::ofstream(folder_.path() / "bin" / "camber") << "#!/bin/sh\necho lost >&2\nexit 3\n";
  EXPECT_EQ(trust("--numbers 0"), 1);
  EXPECT_THAT(out_, HasSubstr("synth_000000 1:3 none: exit code 3, lost"));
  EXPECT_EQ(trust("--numbers 0 --report-only"), 1);
  const std::string runs = read_text(folder_.path() / "runs" / "runs.jsonl");
  EXPECT_EQ(trust("--numbers 0"), 1);
  EXPECT_NE(read_text(folder_.path() / "runs" / "runs.jsonl"), runs);
}

TEST_F(TrustScript, ScenesOfAScriptAreMadeWhereTheyAreMissing) {
  // A maker that takes the scenes of `synth`, and notes what it was asked for.
  std::ofstream(folder_.path() / "make.py") << R"py(
import os, subprocess, sys
open("asked", "a").write(" ".join(sys.argv[1:]) + "\n")
for n in sys.argv[3:]:
    if n == "9": sys.exit("no such road")
    subprocess.run(["bin/camber", "synth", "--random", n, "--out",
                    os.path.join(sys.argv[2], "scene_%06d" % int(n))])
)py";
  const std::string maker = "--maker steep_scenes --steep-scenes make.py ";
  ASSERT_EQ(trust(maker + "--numbers 1:2"), 0) << err_;
  EXPECT_EQ(report_["worst_by_z"][0]["scene"], "scene_000002");
  ASSERT_EQ(trust(maker + "--numbers 1:3"), 0) << err_;
  EXPECT_EQ(read_text(folder_.path() / "asked"), "--out made 1 2\n--out made 3\n");
  EXPECT_EQ(trust(maker + "--numbers 8:9"), 2);
  EXPECT_EQ(err_, "trust.py: make.py: ended with 1: no such road\n");
}

TEST_F(TrustScript, RefusesWhatMeansNothing) {
  EXPECT_EQ(trust("--faults height"), 2);
  EXPECT_EQ(err_, "trust.py: --faults: there is no fault 'height'\n");
  EXPECT_EQ(trust("--frames 1-3"), 2);
  EXPECT_THAT(err_, HasSubstr("--frames: found '1-3', expected"));
  EXPECT_EQ(trust("--numbers 2 --odd"), 2);
  EXPECT_EQ(trust("--maker steep_scenes"), 2);
  EXPECT_THAT(err_, HasSubstr("--steep-scenes: not given"));
  EXPECT_EQ(trust("--maker folder"), 2);
  EXPECT_THAT(err_, HasSubstr("made: no folders with a scene.json"));
  fs::remove(folder_.path() / "bin" / "camber");
  EXPECT_EQ(trust(""), 2);
  EXPECT_THAT(err_, testing::AllOf(HasSubstr("no program to run"), Not(HasSubstr("Traceback"))));
}

TEST_F(TrustScript, ImagesOfAllFiltersAreRead) {
  std::ofstream(folder_.path() / "filters.py") << R"py(
import random, struct, zlib, png8
random.seed(5)
for bits, color, step in ((8, 2, 3), (8, 0, 1), (16, 0, 2), (8, 6, 4)):
    width, height = 7, 10
    rows = [bytes(random.randrange(256) for _ in range(width * step)) for _ in range(height)]
    def paeth(a, b, c):
        return min((abs(a + b - c - x), i, x) for i, x in enumerate((a, b, c)))[2]
    packed, above = b"", bytes(width * step)
    for v, row in enumerate(rows):
        kind = v % 5
        packed += bytes([kind])
        for i, x in enumerate(row):
            a = row[i - step] if i >= step else 0
            c = above[i - step] if i >= step else 0
            b = above[i]
            packed += bytes([(x - (0, a, b, (a + b) // 2, paeth(a, b, c))[kind]) % 256])
        above = row
    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    body = zlib.compress(packed)
    open("a.png", "wb").write(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 7, 10, bits, color, 0, 0, 0)) +
        chunk(b"IDAT", body[:20]) + chunk(b"IDAT", body[20:]) + chunk(b"IEND", b""))
    image = png8.read("a.png")
    assert image.rows == rows, (bits, color)
    png8.write("b.png", image)
    assert png8.read("b.png").rows == rows
    assert png8.resized(image, 7, 10).rows == rows
    double = png8.resized(image, 14, 20)
    assert png8.resized(double, 7, 10).rows == rows and len(double.rows[0]) == 14 * step
assert png8.samples(png8.Image(2, 1, 16, 0, [b"\1\2\3\4"]), 0) == (258, 772)
print("read")
)py";
  EXPECT_EQ(python("filters.py"), 0) << err_;
  EXPECT_EQ(out_, "read\n");
}

}  // namespace
