// Made scenes in the layouts of SYNTHIA-SF and KITTI tracking: read back by the importers, run and
// judged.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/image/image_io.h"
#include "camber/scene/scene.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::run_camber;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

constexpr double kDegree = 3.14159265358979323846 / 180.0;

class DataSetLayouts : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  void run(const std::vector<std::string>& arguments) {
    const auto result = run_camber(arguments);
    ASSERT_EQ(result.exit_code, 0) << result.error;
  }
  test::TemporaryFolder folder_;
};

const TruthFrame& frame_of(const Scene& scene, int id) {
  return *std::find_if(scene.truth->frames.begin(), scene.truth->frames.end(),
                       [&](const TruthFrame& frame) { return frame.id == id; });
}

const TruthVehicle* nearest_to(const TruthVehicle& vehicle, const TruthFrame& frame) {
  const TruthVehicle* best = nullptr;
  for (const TruthVehicle& other : frame.vehicles) {
    const auto distance = [&](const TruthVehicle& v) {
      return (v.pose.bottom_center() - vehicle.pose.bottom_center()).norm();
    };
    if (!best || distance(other) < distance(*best)) best = &other;
  }
  return best;
}

/// Distances and rotations (degrees) of the vehicles of the import that are not uncertain from the
/// maker's own; boxes of at least 40 px.
struct TruthErrors {
  std::vector<double> metres, degrees;
  int uncertain = 0;
};
TruthErrors errors_of(const Scene& imported, const Scene& made) {
  TruthErrors out;
  for (const TruthFrame& frame : imported.truth->frames) {
    for (const TruthVehicle& vehicle : frame.vehicles) {
      if (vehicle.box.height() < 40.0) continue;
      if (!vehicle.uncertain.empty()) {
        ++out.uncertain;
        continue;
      }
      const TruthVehicle* truth = nearest_to(vehicle, frame_of(made, frame.id));
      out.metres.push_back((truth->pose.center() - vehicle.pose.center()).norm());
      out.degrees.push_back(
          rotation_to_vector(truth->pose.camera_from_vehicle.rotation().conjugate() *
                             vehicle.pose.camera_from_vehicle.rotation())
              .norm() /
          kDegree);
    }
  }
  std::sort(out.metres.begin(), out.metres.end());
  std::sort(out.degrees.begin(), out.degrees.end());
  return out;
}

TEST_F(DataSetLayouts, SynthiaSfIsReadBackRunAndJudged) {
  run({"synth", "--layout", "synthia-sf", "--size", "960x540", "--random", "31", "--frames", "3",
       "--supersampling", "2", "--cars", "8", "--cloud-points", "100", "--out", path("made")});
  const Scene made = read_scene(path("made"));
  for (const char* file : {"RGBLeft", "DepthLeft", "GTLeft"}) {
    const ImageInfo info = read_image_info(path(std::string("made/SEQ1/") + file + "/0000002.png"));
    EXPECT_EQ(info.channels, 3) << file;
    EXPECT_EQ(info.bits, 8) << file;
  }
  std::vector<std::string> import = {"import",
                                     "synthia-sf",
                                     "--sequence",
                                     path("made/SEQ1"),
                                     "--detections",
                                     path("made/detections/SEQ1.txt"),
                                     "--segmentation-from-labels",
                                     "--height",
                                     std::to_string(*made.height_above_road),
                                     "--frame-rate",
                                     "10",
                                     "--out",
                                     path("scene")};
  run(import);
  const Scene scene = read_scene(path("scene"));
  EXPECT_EQ(scene.truth->vehicles_source, "depth_fit");
  EXPECT_EQ(scene.frames[1].vehicles.size(), made.frames[1].vehicles.size());
  const TruthErrors errors = errors_of(scene, made);
  ASSERT_GE(errors.metres.size(), 4u);
  EXPECT_GT(errors.uncertain, 0);
  // The bars of docs/notes/synthia-truth.md, where a hundred scenes are behind them.
  EXPECT_LT(errors.metres[errors.metres.size() / 2], 0.10);
  EXPECT_LT(errors.metres[errors.metres.size() * 9 / 10], 0.30);
  EXPECT_LT(errors.degrees[errors.degrees.size() / 2], 2.0);
  // The ids are those of the image: the same vehicle keeps its own.
  for (const TruthVehicle& vehicle : frame_of(scene, 1).vehicles) {
    if (!vehicle.uncertain.empty()) continue;
    EXPECT_EQ(vehicle.id, nearest_to(vehicle, frame_of(made, 1))->id);
  }

  run({"reconstruct", path("scene"), "--out", path("result"), "--no-pictures", "--quiet"});
  run({"compare", path("result"), path("scene"), "--out", path("comparison")});
  const auto compared = nlohmann::json::parse(test::read_text(path("comparison/compare.json")));
  EXPECT_LT(compared["accuracy"]["median"], 0.1);
  const auto judged =
      run_camber({"evaluate", "--truth", path("scene"), "--estimate", path("result"), "--json"});
  ASSERT_EQ(judged.exit_code, 0) << judged.error;
  int counted = 0;
  for (const TruthFrame& frame : scene.truth->frames) {
    for (const TruthVehicle& v : frame.vehicles) {
      counted +=
          v.uncertain.empty() && v.occlusion <= 0.7 && v.truncation <= 0.5 && v.box.height() >= 9.0
              ? 1
              : 0;
    }
  }
  EXPECT_EQ(nlohmann::json::parse(judged.out)["tables"][0]["counted"], counted);
}

TEST_F(DataSetLayouts, SynthiaSfWithoutNumbersOfVehicles) {
  run({"synth", "--layout", "synthia-sf", "--size", "960x540", "--random", "31", "--frames", "1",
       "--supersampling", "1", "--cars", "8", "--classes-only", "--cloud-points", "100", "--out",
       path("made")});
  run({"import", "synthia-sf", "--sequence", path("made/SEQ1"), "--out", path("scene")});
  const TruthErrors errors = errors_of(read_scene(path("scene")), read_scene(path("made")));
  ASSERT_GE(errors.metres.size(), 1u);
  EXPECT_LT(errors.metres[errors.metres.size() / 2], 0.10);
  EXPECT_LT(errors.degrees[errors.degrees.size() / 2], 2.0);
}

TEST_F(DataSetLayouts, KittiTrackingIsReadBack) {
  run({"synth", "--layout", "kitti-tracking", "--sequence", "3", "--frames", "2", "--supersampling",
       "1", "--size", "621x188", "--cloud-points", "100", "--seed", "4", "--out", path("made")});
  run({"import", "kitti", "--images", path("made/image_02/0003"), "--calib",
       path("made/calib/0003.txt"), "--labels", path("made/label_02/0003.txt"),
       "--detections-from-labels", "--keypoints", path("made/keypoints.json"), "--out",
       path("scene")});
  const Scene made = read_scene(path("made")), scene = read_scene(path("scene"));
  EXPECT_NEAR(scene.camera.fx, made.camera.fx, 1e-9);
  EXPECT_EQ(scene.camera.width, 621);
  std::size_t vehicles = 0, keypoints = 0;
  for (const TruthFrame& frame : made.truth->frames) {
    const TruthFrame& read = frame_of(scene, frame.id);
    ASSERT_EQ(read.vehicles.size(), frame.vehicles.size());
    for (std::size_t i = 0; i < frame.vehicles.size(); ++i) {
      const TruthVehicle &a = frame.vehicles[i], &b = read.vehicles[i];
      ++vehicles;
      EXPECT_EQ(a.id, b.id);
      // Six decimals in the label file.
      EXPECT_LT((a.pose.bottom_center() - b.pose.bottom_center()).norm(), 2e-6);
      EXPECT_NEAR(a.pose.dimensions.length, b.pose.dimensions.length, 1e-6);
      EXPECT_NEAR(rotation_y(a.pose.camera_from_vehicle.rotation_matrix()),
                  rotation_y(b.pose.camera_from_vehicle.rotation_matrix()), 2e-6);
    }
  }
  EXPECT_GT(vehicles, 4u);
  for (const SceneFrame& frame : scene.frames) {
    for (const VehicleDetection& detection : frame.vehicles) {
      keypoints += detection.keypoints.empty() ? 0 : 1;
    }
  }
  EXPECT_GT(keypoints, 3u);
}

/// The script that runs the paper's sequences, by its exit code and what it prints.
class PaperKitti : public DataSetLayouts {
 protected:
  int script(const std::string& arguments, std::string* printed) {
    const std::string out = path("printed.txt");
    const std::string command = "'" + (test::source_dir() / "samples/paper_kitti.sh").string() +
                                "' " + arguments + " --camber '" CAMBER_PROGRAM "' >'" + out +
                                "' 2>&1";
    const int status = std::system(command.c_str());
    *printed = test::read_text(out);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
};

TEST_F(PaperKitti, RunsWhatIsThereNamesWhatIsNotAndPrintsOneTable) {
  run({"synth",
       "--layout",
       "kitti-tracking",
       "--sequence",
       "9",
       "--frames",
       "5",
       "--size",
       "621x188",
       "--supersampling",
       "1",
       "--cars",
       "4",
       "--farthest",
       "25",
       "--cloud-points",
       "100",
       "--seed",
       "3",
       "--out",
       path("kitti")});
  fs::remove(path("kitti/image_02/0009/000003.png"));  // three neighbours are left
  std::string printed;
  const std::string root = "'" + path("kitti") + "'", out = " --out '" + path("out") + "'";
  ASSERT_EQ(script(root + out, &printed), 0) << printed;
  EXPECT_THAT(printed, HasSubstr("sequence 0009: 4 frames, 0 to 4, 1 of these absent; 1 times"));
  EXPECT_THAT(printed, HasSubstr("absent: 0001 (no image_02/0001, no calib/0001.txt, no "
                                 "label_02/0001.txt); 0003 ("));
  EXPECT_THAT(printed, HasSubstr("2 runs, 0 without an answer"));
  // The captions are of what was used: the shipped network, where no file is given.
  EXPECT_THAT(printed, HasSubstr("Keypoints: those that the shipped network finds."));
  EXPECT_THAT(printed, Not(HasSubstr("Boxes alone")));
  EXPECT_THAT(printed, HasSubstr("| joint (paper) | all |"));
  EXPECT_THAT(printed, HasSubstr("| joint | all |"));
  // One table: one row of headings.
  EXPECT_EQ(printed.find("| distance |"), printed.rfind("| distance |"));
  EXPECT_THAT(test::read_text(path("out/table.md")), HasSubstr("| joint | all |"));

  ASSERT_EQ(script(root + " '" + path("kitti/keypoints.json") + "'" + out, &printed), 0) << printed;
  EXPECT_THAT(printed, HasSubstr("Keypoints: keypoints.json;"));
  EXPECT_THAT(printed, Not(HasSubstr("Boxes alone, no keypoints")));
  EXPECT_THAT(printed, HasSubstr("| joint (paper) | all |"));

  // Keypoints of other frames are none of these.
  nlohmann::json others = nlohmann::json::parse(test::read_text(path("kitti/keypoints.json")));
  for (nlohmann::json& one : others) one["frame"] = one["frame"].get<int>() + 900;
  std::ofstream(path("others.json")) << others.dump();
  EXPECT_EQ(script(root + " '" + path("others.json") + "'" + out, &printed), 1) << printed;
  EXPECT_THAT(printed, HasSubstr("no keypoints for a box of these sequences"));

  EXPECT_EQ(script(root + out + " --sequences 1,20", &printed), 1);
  EXPECT_THAT(printed, HasSubstr("nothing to judge"));
  EXPECT_EQ(script("'" + path("none") + "'", &printed), 2);
  EXPECT_THAT(printed, HasSubstr("found no image_02"));
  EXPECT_EQ(script(root + " --sequences nine", &printed), 2);
  EXPECT_THAT(printed, HasSubstr("--sequences: found 'nine'"));
  EXPECT_EQ(script(root + " --every 0", &printed), 2);
  EXPECT_THAT(printed, HasSubstr("--every: found '0'"));
}

TEST_F(DataSetLayouts, WhatALayoutCannotHoldIsRefused) {
  const auto refused = [&](const std::vector<std::string>& more, const char* part) {
    std::vector<std::string> arguments = {"synth", "--out", path("made")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto result = run_camber(arguments);
    EXPECT_EQ(result.exit_code, 2) << part;
    EXPECT_THAT(result.error, HasSubstr(part));
    EXPECT_FALSE(fs::exists(path("made")));
  };
  refused({"--layout", "cityscapes"}, "--layout");
  refused({"--layout", "synthia-sf", "--size", "640x400"}, "the shape of SYNTHIA-SF's");
  refused({"--layout", "synthia-sf", "--size", "960x540", "--intrinsics", "500,500,480,270"},
          "expected those of SYNTHIA-SF");
  refused({"--layout", "kitti-tracking", "--distortion", "brown,-0.1,0,0,0"}, "expected none");
  refused({"--layout", "kitti-tracking", "--sequence", "10000"}, "sequence");
}

TEST_F(DataSetLayouts, KeypointsThatFitNothingAreRefused) {
  run({"synth", "--layout", "kitti-tracking", "--frames", "1", "--supersampling", "1", "--size",
       "310x94", "--cloud-points", "10", "--out", path("made")});
  const auto import = [&](const std::string& keypoints) {
    test::write_bytes(path("k.json"), keypoints);
    return run_camber({"import", "kitti", "--images", path("made/image_02/0000"), "--calib",
                       path("made/calib/0000.txt"), "--labels", path("made/label_02/0000.txt"),
                       "--detections-from-labels", "--keypoints", path("k.json"), "--out",
                       path("scene")});
  };
  EXPECT_THAT(import("{}").error, HasSubstr("expected a list of keypoints"));
  EXPECT_THAT(import("[{\"frame\": 0, \"keypoints_uv_confidence\": []}]").error,
              HasSubstr("track_id"));
  const auto rows = import("[{\"frame\": 0, \"track_id\": 1, \"keypoints_uv_confidence\": []}]");
  EXPECT_EQ(rows.exit_code, 2);
  EXPECT_THAT(rows.error, HasSubstr("found 0 rows, expected 36 rows"));
  const auto none = import("[]");
  EXPECT_EQ(none.exit_code, 0);
  EXPECT_THAT(none.error, HasSubstr("no keypoints for a detection of these frames"));
}

}  // namespace
}  // namespace camber
