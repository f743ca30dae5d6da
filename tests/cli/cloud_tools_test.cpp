// camber convert, filter, ground, compare and info as a stranger would use them.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "cli/run_program.h"
#include "road/scan_maker.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::ProgramResult;
using test::run_camber;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class CloudTools : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }

  ProgramResult run(const std::vector<std::string>& arguments) const {
    const ProgramResult result = run_camber(arguments);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    return result;
  }
  json run_json(std::vector<std::string> arguments) const {
    arguments.push_back("--json");
    return json::parse(run(arguments).out);
  }
  void write_text(const std::string& name, const std::string& text) const {
    std::ofstream(path(name)) << text;
  }

  /// A level square of 20 m with 30 points a square metre, some high above it.
  RoadCloud make_square(double noise, std::uint64_t seed = 1) const {
    RoadCloud cloud;
    const CounterRandom random(seed);
    for (std::uint64_t i = 0; i < 12000; ++i) {
      cloud.points.push_back(Eigen::Vector3d(random.uniform(4 * i, -10, 10),
                                             random.uniform(4 * i + 1, -10, 10),
                                             noise * random.normal(i))
                                 .cast<float>());
    }
    return cloud;
  }

  test::TemporaryFolder folder_;
};

/// A 16-bit grey PNG.
void write_depth(const fs::path& path, int width, int height, const std::vector<int>& values) {
  std::vector<std::uint8_t> samples;
  for (const int v : values) {
    samples.push_back(static_cast<std::uint8_t>(v >> 8));
    samples.push_back(static_cast<std::uint8_t>(v & 255));
  }
  test::write_png(path, width, height, 0, 16, samples);
}

TEST_F(CloudTools, ThePeersLibraryPrintsNothingOfItsOwn) {
  std::string line = "x y z\n";
  for (int i = 0; i < 200; ++i) line += std::to_string(0.1 * i) + " 0 1\n";
  test::write_bytes(path("line.xyz"), line);
  EXPECT_ONE_SENTENCE(test::run_camber({"plane", path("line.xyz"), "--engine", "pcl"}), 1,
                      "the points lie on a line");
}

TEST_F(CloudTools, ConvertsDepthImagesToClouds) {
  // 3 x 2 pixels; 0 is unknown.
  write_depth(path("depth.png"), 3, 2, {256, 512, 0, 1024, 2560, 256 * 50});
  test::write_png(path("color.png"), 3, 2, 2, 8,
                  {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18});
  test::write_png(path("label.png"), 3, 2, 0, 8, {7, 8, 9, 10, 11, 12});
  run({"convert", path("depth.png"), "--depth", "kitti", "--camera", "2,4,1,0.5", "--image",
       path("color.png"), "--labels", path("label.png"), "--largest-depth", "20", "--out",
       path("cloud.ply")});
  const RoadCloud cloud = read_cloud(path("cloud.ply"));
  ASSERT_EQ(cloud.size(), 4u);
  EXPECT_EQ(cloud.frame, CloudFrame::kCamera);
  // x = (u - cx) z / fx, y = (v - cy) z / fy.
  EXPECT_TRUE(cloud.points[0].isApprox(Eigen::Vector3f(-0.5f, -0.125f, 1.0f)));
  EXPECT_TRUE(cloud.points[1].isApprox(Eigen::Vector3f(0.0f, -0.25f, 2.0f)));
  EXPECT_TRUE(cloud.points[3].isApprox(Eigen::Vector3f(0.0f, 1.25f, 10.0f)));
  EXPECT_EQ(cloud.labels.at("class"), (std::vector<int>{7, 8, 10, 11}));
  EXPECT_EQ(cloud.colors[2], (std::array<std::uint8_t, 3>{10, 11, 12}));

  // Disparity: z = fx * baseline / (value / 256).
  const json converted =
      run_json({"convert", path("depth.png"), "--depth", "kitti-disparity", "--camera", "2,4,1,0.5",
                "--baseline", "0.5", "--largest-depth", "1000", "--out", path("disparity.pcd")});
  EXPECT_EQ(converted["options"]["camera"], "2,4,1,0.5");
  EXPECT_EQ(converted["options"]["baseline"], 0.5);
  EXPECT_EQ(converted["options"]["largest_depth"], 1000.0);
  const RoadCloud disparity = read_cloud(path("disparity.pcd"));
  ASSERT_EQ(disparity.size(), 5u);
  EXPECT_FLOAT_EQ(disparity.points[1].z(), 0.5f);
  EXPECT_FLOAT_EQ(disparity.points[3].z(), 0.1f);

  // SYNTHIA: 24 bits of 1000 m, low byte first; all ones is the sky.
  const int value = static_cast<int>(std::lround(12.5 / 1000.0 * 16777215.0));
  const auto byte = [&](int k) { return static_cast<std::uint8_t>(value >> (8 * k) & 255); };
  test::write_png(path("synthia.png"), 2, 1, 2, 8, {byte(0), byte(1), byte(2), 255, 255, 255});
  run({"convert", path("synthia.png"), "--depth", "synthia", "--camera", "10,10,0,0", "--out",
       path("synthia.ply")});
  const RoadCloud synthia = read_cloud(path("synthia.ply"));
  ASSERT_EQ(synthia.size(), 1u);
  EXPECT_NEAR(synthia.points[0].z(), 12.5, 1e-4);

  EXPECT_ONE_SENTENCE(
      run_camber({"convert", path("depth.png"), "--depth", "kitti", "--out", path("none.ply")}), 2,
      "--depth needs --camera");
  EXPECT_ONE_SENTENCE(run_camber({"convert", path("depth.png"), "--depth", "kitti-disparity",
                                  "--camera", "2,4,1,0.5", "--out", path("none.ply")}),
                      2, "--baseline");
  EXPECT_ONE_SENTENCE(run_camber({"convert", path("depth.png"), "--depth", "synthia", "--camera",
                                  "2,4,1,0.5", "--out", path("none.ply")}),
                      2, "depth.png");
  EXPECT_FALSE(fs::exists(path("none.ply")));
}

TEST_F(CloudTools, ConvertsBetweenFormatsAndLeavesNothingHalfWritten) {
  RoadCloud cloud = make_square(0.1);
  cloud.scalars["intensity"].assign(cloud.size(), 0.25f);
  write_cloud(cloud, path("in.ply"));
  std::string last = "in.ply";
  for (const char* next : {"a.pcd", "b.las", "c.csv", "d.xyz", "e.bin", "f.ply"}) {
    run({"convert", path(last), "--out", path(next)});
    last = next;
  }
  const RoadCloud back = read_cloud(path("f.ply"));
  ASSERT_EQ(back.size(), cloud.size());
  for (std::size_t i = 0; i < back.size(); i += 100) {
    // LAS keeps steps of a fraction of a millimetre.
    EXPECT_LT((back.points[i] - cloud.points[i]).norm(), 1e-3f);
  }
  EXPECT_ONE_SENTENCE(run_camber({"convert", path("in.ply"), "--out", path("x.unknown")}), 2,
                      "--out: found");
  EXPECT_ONE_SENTENCE(run_camber({"convert", path("missing.ply"), "--out", path("x.ply")}), 2,
                      "missing.ply");
  // A file cut off: the old output stays.
  const std::string whole = test::read_bytes(path("in.ply"));
  test::write_bytes(path("cut.ply"), whole.substr(0, whole.size() - 100));
  const std::string before = test::read_bytes(path("f.ply"));
  EXPECT_ONE_SENTENCE(run_camber({"convert", path("cut.ply"), "--out", path("f.ply")}), 2,
                      "cut.ply");
  EXPECT_EQ(test::read_bytes(path("f.ply")), before);
  const ProgramResult lenient =
      run_camber({"convert", path("cut.ply"), "--lenient", "--out", path("g.ply")});
  EXPECT_EQ(lenient.exit_code, 0);
  EXPECT_THAT(lenient.error, HasSubstr("truncated"));
  EXPECT_GT(read_cloud(path("g.ply")).size(), cloud.size() - 20);
}

TEST_F(CloudTools, LazIsTakenWhereLasIs) {
  write_cloud(make_square(0.02), path("a.las"));
  run({"convert", path("a.las"), "--out", path("a.laz")});
  run({"convert", path("a.laz"), "--out", path("back.las"), "--threads", "1"});
  EXPECT_TRUE(test::read_text(path("back.las")) == test::read_text(path("a.las")));
  EXPECT_LT(fs::file_size(path("a.laz")), fs::file_size(path("a.las")) / 2);
  const json info = run_json({"info", path("a.laz")});
  EXPECT_EQ(info["files"][0]["format"], "laz") << info;
  EXPECT_EQ(info["files"][0]["points"], 12000);
  // What is told by the content needs no extension.
  fs::copy_file(path("a.laz"), path("a.unknown"));
  EXPECT_EQ(run_json({"info", path("a.unknown")})["files"][0]["points"], 12000);
  for (const char* const kind : {"las", "laz"}) {
    run({"ground", path(std::string("a.") + kind), "--out", path(std::string("ground.") + kind)});
  }
  run({"convert", path("ground.laz"), "--out", path("ground_of_laz.las")});
  EXPECT_TRUE(test::read_text(path("ground_of_laz.las")) == test::read_text(path("ground.las")));
  // The name alone asks for an octree.
  run({"convert", path("a.laz"), "--out", path("a.copc.laz"), "--threads", "2"});
  run({"convert", path("a.las"), "--out", path("b.copc.laz"), "--threads", "1"});
  EXPECT_TRUE(test::read_text(path("a.copc.laz")) == test::read_text(path("b.copc.laz")));
  EXPECT_EQ(run_json({"info", path("a.copc.laz")})["files"][0]["points"], 12000);
  run({"convert", path("a.copc.laz"), "--out", path("level.ply"), "--resolution", "1000"});
  EXPECT_GT(read_cloud(path("level.ply")).size(), 0u);
  run({"ground", path("a.copc.laz"), "--out", path("ground.copc.laz")});
  EXPECT_EQ(read_cloud(path("ground.copc.laz")).labels.at("classification").size(), 12000u);
  run({"filter", path("a.copc.laz"), "--class", "0", "--out", path("some.copc.laz")});
  EXPECT_EQ(read_cloud(path("some.copc.laz")).size(), 12000u);
  EXPECT_ONE_SENTENCE(
      run_camber({"convert", path("a.laz"), "--out", path("b.ply"), "--resolution", "1"}), 2,
      "found a file without levels of detail, expected COPC");
  const std::string bytes = test::read_text(path("a.laz"));
  write_text("cut.laz", bytes.substr(0, bytes.size() / 2));
  EXPECT_ONE_SENTENCE(run_camber({"info", path("cut.laz")}), 2, "in chunk 1, behind");
}

TEST_F(CloudTools, FilterTakesItsStepsInOrder) {
  RoadCloud cloud = make_square(0.02);
  for (int i = 0; i < 50; ++i) {
    cloud.points.emplace_back(0.1f * static_cast<float>(i), 0.0f, 30.0f + static_cast<float>(i));
  }
  write_cloud(cloud, path("in.pcd"));
  const json thinned =
      run_json({"filter", path("in.pcd"), "--voxel", "0.5", "--out", path("thin.ply")});
  for (const char* key : {"version", "seed", "options", "timings_ms"}) {
    EXPECT_TRUE(thinned.contains(key)) << key;
  }
  const std::size_t left = read_cloud(path("thin.ply")).size();
  EXPECT_LT(left, 3500u);
  EXPECT_GT(left, 1600u);
  run({"filter", path("in.pcd"), "--box", "-5,-5,-1,5,5,1", "--statistical", "20,3", "--normals",
       "20", "--out", path("clean.ply")});
  const RoadCloud clean = read_cloud(path("clean.ply"));
  EXPECT_GT(clean.size(), 2500u);
  ASSERT_EQ(clean.normals.size(), clean.size());
  for (std::size_t i = 0; i < clean.size(); i += 50) {
    EXPECT_LE(clean.points[i].cwiseAbs().maxCoeff(), 5.0f);
    EXPECT_GT(clean.normals[i].z(), 0.9f);
  }
  EXPECT_EQ(
      run_camber({"filter", path("in.pcd"), "--voxel", "-1", "--out", path("x.ply")}).exit_code, 2);
  EXPECT_ONE_SENTENCE(
      run_camber({"filter", path("in.pcd"), "--box", "5,5,5,-5,-5,-5", "--out", path("x.ply")}), 2,
      "--box");
  EXPECT_FALSE(fs::exists(path("x.ply")));
}

TEST_F(CloudTools, FilterRefusesOptionsThatNeedAnother) {
  write_cloud(make_square(0.1), path("in.ply"));
  const std::vector<std::string> base = {"filter", path("in.ply"), "--out", path("x.ply")};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), base.begin(), base.end());
    return run_camber(more);
  };
  EXPECT_ONE_SENTENCE(with({"--outside"}), 2, "--outside requires --box");
  EXPECT_ONE_SENTENCE(with({"--viewpoint", "0,0,2"}), 2, "--viewpoint requires --normals");
  EXPECT_ONE_SENTENCE(with({"--up", "0,0,1"}), 2, "--up requires --normals");
  EXPECT_FALSE(fs::exists(path("x.ply")));
  EXPECT_EQ(with({"--outside", "--box", "0,0,-1,1,1,1"}).exit_code, 0);
  EXPECT_EQ(with({"--viewpoint", "0,0,2", "--normals", "8"}).exit_code, 0);
}

TEST_F(CloudTools, CompareRefusesALargestDepthWithoutACamera) {
  write_cloud(make_square(0.1), path("in.ply"));
  EXPECT_ONE_SENTENCE(run_camber({"compare", path("in.ply"), path("in.ply"), "--farthest", "20"}),
                      2, "--farthest: expected the camera, too");
}

TEST_F(CloudTools, FilterStatesHowManyPointsWereNotFinite) {
  RoadCloud cloud = make_square(0.02);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 0; i < 3; ++i) cloud.points[100 * i].z() = nan;
  write_cloud(cloud, path("in.ply"));
  const std::vector<std::vector<std::string>> steps = {{"--voxel", "0.5"},
                                                       {"--statistical", "20,3"},
                                                       {"--radius", "0.5,2"},
                                                       {"--range", "100"},
                                                       {"--box", "-9,-9,-9,9,9,9", "--morton"}};
  for (const std::vector<std::string>& step : steps) {
    std::vector<std::string> arguments = {"filter", path("in.ply"), "--out", path("x.ply")};
    arguments.insert(arguments.end(), step.begin(), step.end());
    EXPECT_THAT(run_camber(arguments).error, HasSubstr("in.ply: dropped not finite: 3")) << step[0];
    EXPECT_EQ(run_json(arguments)["dropped"]["not finite"], 3) << step[0];
  }
  const json kept = run_json({"filter", path("in.ply"), "--morton", "--out", path("x.ply")});
  EXPECT_TRUE(kept["dropped"].empty());
  EXPECT_EQ(kept["points"], cloud.size());
}

TEST_F(CloudTools, PointsThatAFormatCannotHoldAreNotWritten) {
  test::write_bytes(path("nan.csv"), "x,y,z\n1,2,3\nnan,1,2\n4,5,6\n");
  test::write_bytes(path("far.csv"), "x,y,z\n1,2,3\n4,5,6\n2e6,1,2\n");
  for (const char* name : {"out.bin", "out.las"}) {
    const ProgramResult nan = run_camber({"convert", path("nan.csv"), "--out", path(name)});
    EXPECT_ONE_SENTENCE(nan, 2, path(name) + ": point 1 has the coordinate nan, expected");
    const ProgramResult far = run_camber({"convert", path("far.csv"), "--out", path(name)});
    EXPECT_ONE_SENTENCE(far, 2, path(name) + ": point 2 has the coordinate 2e+06, expected");
    EXPECT_FALSE(fs::exists(path(name)));
    run({"convert", path("nan.csv"), "--lenient", "--out", path(name)});
    EXPECT_EQ(run_json({"info", path(name)})["files"][0]["points"], 2);
  }
}

TEST_F(CloudTools, ColumnsOfInfoStandApart) {
  test::write_bytes(path("long.csv"),
                    "x_usft,y_usft,z_usft,sigma_cross_slope_percent\n"
                    "1,2,3,0.5\n4,5,6,0.5\n");
  const std::string text = run_camber({"info", path("long.csv")}).out;
  EXPECT_THAT(text, HasSubstr("min [US survey foot] 1.000"));
  EXPECT_THAT(text, HasSubstr("sigma_cross_slope_percent float64  0.5"));
}

TEST_F(CloudTools, GroundLabelsTheCloudInItsOrder) {
  test::ScanOptions made;
  made.azimuths = 360;
  made.grade = 0.1;
  const test::Scan scan = test::make_scan(made);
  write_cloud(scan.cloud, path("scan.bin"));
  const json out = run_json(
      {"ground", path("scan.bin"), "--sensor-height", "1.73", "--out", path("ground.ply")});
  for (const char* key : {"version", "seed", "options", "timings_ms", "points", "ground"}) {
    EXPECT_TRUE(out.contains(key)) << key;
  }
  const RoadCloud labelled = read_cloud(path("ground.ply"));
  ASSERT_EQ(labelled.size(), scan.cloud.size());
  EXPECT_EQ(labelled.points, scan.cloud.points);
  const std::vector<int>& ground = labelled.labels.at("ground");
  EXPECT_EQ(out.at("ground").get<long>(), std::count(ground.begin(), ground.end(), 1));
  EXPECT_GT(test::score_ground(scan.ground, ground).f1, 0.9);  // a sixth of the points
  // The same bytes again, and with other threads.
  const std::string before = test::read_bytes(path("ground.ply"));
  run({"ground", path("scan.bin"), "--sensor-height", "1.73", "--threads", "4", "--out",
       path("ground.ply")});
  EXPECT_EQ(test::read_bytes(path("ground.ply")), before);

  write_text("empty.xyz", "x y z\n");
  EXPECT_ONE_SENTENCE(run_camber({"ground", path("empty.xyz"), "--out", path("x.ply")}), 1,
                      "empty.xyz");
  EXPECT_ONE_SENTENCE(
      run_camber({"ground", path("scan.bin"), "--cell", "-3", "--out", path("x.ply")}), 2, "cell");
  EXPECT_FALSE(fs::exists(path("x.ply")));
}

TEST_F(CloudTools, LenientGroundCountsTheSamePointsAsItsCopy) {
  RoadCloud cloud = make_square(0.02);
  cloud.points[5].x() = std::numeric_limits<float>::quiet_NaN();
  cloud.points[7].z() = 3e9f;
  write_cloud(cloud, path("odd.pcd"));
  run({"ground", path("odd.pcd"), "--lenient", "--quiet", "--out", path("kept.pcd")});
  EXPECT_EQ(read_cloud(path("kept.pcd")).size(), cloud.size() - 2);
  run({"ground", path("odd.pcd"), "--out", path("all.pcd")});
  const RoadCloud all = read_cloud(path("all.pcd"));
  ASSERT_EQ(all.size(), cloud.size());
  EXPECT_EQ(all.labels.at("ground")[5], 0);
  // Points that stand there twice are kept, each with its label.
  cloud = make_square(0.02);
  cloud.points[9] = cloud.points[8];
  write_cloud(cloud, path("twice.las"));
  run({"ground", path("twice.las"), "--lenient", "--quiet", "--out", path("twice_ground.las")});
  run({"ground", path("twice.las"), "--out", path("ground.las")});
  EXPECT_EQ(test::read_bytes(path("twice_ground.las")), test::read_bytes(path("ground.las")));
}

TEST_F(CloudTools, CompareMeasuresAlignsAndWritesAFolder) {
  const RoadCloud truth = make_square(0.0);
  RoadCloud estimate = make_square(0.0, 2);
  for (Eigen::Vector3f& p : estimate.points) p.z() += 0.07f;
  write_cloud(truth, path("truth.pcd"));
  write_cloud(estimate, path("estimate.ply"));
  const json out = run_json({"compare", path("estimate.ply"), path("truth.pcd"), "--thresholds",
                             "0.05,0.5", "--out", path("result")});
  for (const char* key : {"version", "seed", "options", "timings_ms", "accuracy", "completeness",
                          "scores", "road", "alignment"}) {
    EXPECT_TRUE(out.contains(key)) << key;
  }
  EXPECT_EQ(out.at("alignment").at("kind"), "none");
  EXPECT_EQ(out.at("scores").at(0).at("precision"), 0.0);
  EXPECT_GT(out.at("scores").at(1).at("f_score"), 0.99);
  EXPECT_NEAR(out.at("road").at(0).at("height_mean").get<double>(), 0.07, 1e-3);
  for (const char* name : {"compare.json", "compare.txt", "scores.csv", "road_errors.csv",
                           "height_error.csv", "height_error.png", "histogram.png",
                           "cumulative.png", "accuracy.ply", "completeness.ply", "run.json"}) {
    EXPECT_GT(fs::file_size(folder_.path() / "result" / name), 20u) << name;
  }
  const RoadCloud colored = read_cloud(path("result/accuracy.ply"));
  ASSERT_EQ(colored.size(), estimate.size());
  EXPECT_GE(colored.scalars.at("error")[0], 0.069f);
  EXPECT_EQ(colored.colors.size(), colored.size());

  const ProgramResult text =
      run({"compare", path("estimate.ply"), path("truth.pcd"), "--align", "rigid"});
  EXPECT_THAT(text.out, HasSubstr("aligned (rigid): scale 1.000000, residual 0.07"));
  // The given transform moves the truth.
  write_text("lift.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0.07\n0 0 0 1\n");
  const json lifted = run_json({"compare", path("estimate.ply"), path("truth.pcd"),
                                "--estimate-from-truth", path("lift.txt")});
  EXPECT_LT(std::abs(lifted.at("road").at(0).at("height_mean").get<double>()), 1e-3);

  fs::create_directory(path("foreign"));
  write_text("foreign/notes.txt", "mine");
  EXPECT_ONE_SENTENCE(
      run_camber({"compare", path("estimate.ply"), path("truth.pcd"), "--out", path("foreign")}), 3,
      "foreign");
  write_text("short.txt", "1 0 0 0\n0 1 0 0\n");
  EXPECT_ONE_SENTENCE(run_camber({"compare", path("estimate.ply"), path("truth.pcd"),
                                  "--estimate-from-truth", path("short.txt")}),
                      2, "found 8 numbers, expected 16");
  EXPECT_ONE_SENTENCE(
      run_camber({"compare", path("estimate.ply"), path("truth.pcd"), "--thresholds", "0.1,-2"}), 2,
      "thresholds");
  EXPECT_ONE_SENTENCE(run_camber({"compare", path("estimate.ply"), path("truth.pcd"), "--region",
                                  "50,50,50,60,60,60"}),
                      1, "nothing to compare");
  EXPECT_ONE_SENTENCE(run_camber({"compare", path("estimate.ply"), path("truth.pcd"), "--pairs",
                                  path("short.txt")}),
                      2, "--pairs needs --align");
}

TEST_F(CloudTools, LengthsUpToScaleAreNoMetres) {
  RoadCloud cloud = make_square(0.02);
  cloud.sigmas.assign(cloud.size(), 0.01f);
  write_cloud(cloud, path("truth.ply"));
  cloud.metric = false;
  write_cloud(cloud, path("cloud.ply"));
  const std::string warning = "cloud.ply: its lengths are in units of unknown size (up to scale)";
  for (const std::vector<std::string>& words : std::vector<std::vector<std::string>>{
           {"ground", path("cloud.ply"), "--out", path("ground.ply"), "--json"},
           {"filter", path("cloud.ply"), "--voxel", "0.5", "--out", path("thin.ply"), "--json"},
           {"compare", path("cloud.ply"), path("truth.ply"), "--json"}}) {
    SCOPED_TRACE(words[0]);
    const ProgramResult result = run(words);
    EXPECT_THAT(result.error, HasSubstr(warning));
    EXPECT_EQ(json::parse(result.out).at("metric"), false);
  }
  // The truth gives the metres of an estimate that is scaled to it.
  const ProgramResult scaled =
      run({"compare", path("cloud.ply"), path("truth.ply"), "--align", "scale", "--json"});
  EXPECT_EQ(scaled.error, "");
  EXPECT_EQ(json::parse(scaled.out).at("metric"), true);
  EXPECT_THAT(run({"compare", path("cloud.ply"), path("truth.ply")}).out,
              ::testing::StartsWith("up to scale: "));
  EXPECT_THAT(run({"ground", path("cloud.ply"), "--out", path("ground.ply")}).out,
              HasSubstr(" units of its surface"));
  EXPECT_THAT(run({"info", path("cloud.ply")}).out, HasSubstr("sigma [units]"));
}

TEST_F(CloudTools, CompareTakesAMeshAsTruth) {
  write_text("mesh.ply",
             "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
             "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
             "end_header\n-10 -10 0\n10 -10 0\n10 10 0\n-10 10 0\n4 0 1 2 3\n");
  RoadCloud estimate = make_square(0.0, 3);
  for (Eigen::Vector3f& p : estimate.points) p.z() -= 0.03f;
  write_cloud(estimate, path("estimate.ply"));
  const json out = run_json({"compare", path("estimate.ply"), path("mesh.ply")});
  EXPECT_NEAR(out.at("accuracy").at("mean").get<double>(), 0.03, 1e-6);
  EXPECT_NEAR(out.at("accuracy").at("along_normal").at("median").get<double>(), 0.03, 1e-6);
  EXPECT_NEAR(out.at("road").at(0).at("height_mean").get<double>(), -0.03, 1e-6);
}

TEST_F(CloudTools, WhatKittiFilesHaveNoPlaceForIsNamed) {
  RoadCloud cloud = make_square(0.1);
  cloud.frame = CloudFrame::kCamera;
  cloud.metric = false;
  write_cloud(cloud, path("in.ply"));
  const std::string warnings = run({"convert", path("in.ply"), "--out", path("out.bin")}).error;
  EXPECT_THAT(warnings, HasSubstr("the frame (a camera's: x right, y down) has no place"));
  EXPECT_THAT(warnings, HasSubstr("up to scale has no place in the output"));
  EXPECT_EQ(run({"convert", path("in.ply"), "--out", path("out.ply")}).error, "");
}

TEST_F(CloudTools, InfoTellsCloudsScenesAndResultsApart) {
  RoadCloud cloud = make_square(0.1);
  write_cloud(cloud, path("in.ply"));
  const json one = run_json({"info", path("in.ply")});
  EXPECT_EQ(one.at("files").at(0).at("points"), cloud.size());
  // A made scene keeps the run.json of the command that made it.
  const fs::path sample = test::source_dir() / "samples" / "steep_hill";
  ASSERT_TRUE(fs::exists(sample / "run.json"));
  EXPECT_THAT(run({"info", sample.string()}).out, HasSubstr("scene manifest"));
  EXPECT_ONE_SENTENCE(run_camber({"info", path("missing.ply")}), 2, "missing.ply");
}

// Depth truth of rendered scenes in both encodings against the same scenes' true road surface.
TEST_F(CloudTools, DepthTruthLiesOnTheTrueRoad) {
  CAMBER_REQUIRE_DATA("steep-scenes");
  const std::pair<const char*, const char*> scenes[] = {{"dev_00", "kitti"}, {"dev_01", "synthia"}};
  for (const auto& [name, encoding] : scenes) {
    const fs::path scene = test::data_dir() / "steep-scenes" / name;
    run({"convert", (scene / "truth/depth/000000.png").string(), "--depth", encoding, "--camera",
         (scene / "scene.json").string(), "--largest-depth", "30", "--out", path("depth.ply")});
    const json out =
        run_json({"compare", (scene / "truth/road_cloud.ply").string(), path("depth.ply"), "--up",
                  "0,-1,0", "--along", "0,0,1", "--road-limit", "0.15"});
    EXPECT_GT(out.at("road").at(0).at("count"), 3000);
    EXPECT_LT(out.at("road").at(0).at("height_median"), 0.005) << name;
  }
}

// Ground of rendered views, every visible pixel a point, against their labels.
TEST_F(CloudTools, GroundOfLabelledViews) {
  CAMBER_REQUIRE_DATA("steep-scenes");
  struct View {
    const char *name, *encoding;
    std::vector<int> ground;  // classes: road, pavement, terrain
  };
  for (const View& view :
       {View{"dev_00", "kitti", {7, 8, 22}}, View{"dev_03", "synthia", {1, 2, 10}},
        View{"dev_09", "synthia", {1, 2, 10}}}) {
    const fs::path scene = test::data_dir() / "steep-scenes" / view.name;
    run({"convert", (scene / "truth/depth/000000.png").string(), "--depth", view.encoding,
         "--camera", (scene / "scene.json").string(), "--labels",
         (scene / "truth/label/000000.png").string(), "--largest-depth", "40", "--out",
         path("view.ply")});
    run({"ground", path("view.ply"), "--out", path("ground.ply")});
    const RoadCloud cloud = read_cloud(path("ground.ply"));
    std::vector<int> truth;
    for (const int label : cloud.labels.at("class")) {
      const auto end = view.ground.end();
      truth.push_back(std::find(view.ground.begin(), end, label) != end ? 1 : 0);
    }
    EXPECT_GT(test::score_ground(truth, cloud.labels.at("ground")).f1, 0.95) << view.name;
  }
}

// KITTI's disparity truth against the laser scan of the same moment.
TEST_F(CloudTools, DisparityTruthMeetsTheLaser) {
  CAMBER_REQUIRE_DATA("kitti-stereo2015-scenes");
  const fs::path data = test::data_dir() / "kitti-stereo2015-scenes";
  fs::path scan;
  for (const auto& entry : fs::directory_iterator(data / "velodyne")) {
    if (scan.empty() || entry.path() < scan) scan = entry.path();
  }
  ASSERT_FALSE(scan.empty());
  const std::string id = scan.stem().string();
  run({"convert", (data / "disp_occ_0" / (id + ".png")).string(), "--depth", "kitti-disparity",
       "--baseline", "0.5327", "--camera", "721.5377,721.5377,609.5593,172.854", "--largest-depth",
       "25", "--out", path("disparity.ply")});
  EXPECT_GT(read_cloud(path("disparity.ply")).size(), 10000u);
  // Camera 2 from the laser, out of the calibration file's rows.
  std::map<std::string, std::vector<double>> rows;
  std::ifstream calibration(data / "calib.txt");
  for (std::string line; std::getline(calibration, line);) {
    std::istringstream words(line);
    std::string name;
    words >> name;
    for (double value = 0.0; words >> value;) rows[name].push_back(value);
  }
  const auto matrix = [](const std::vector<double>& n, int columns) {
    Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
    for (int i = 0; i < 3 * columns; ++i) {
      m(i / columns, i % columns) = n.at(static_cast<std::size_t>(i));
    }
    return m;
  };
  Eigen::Matrix4d shift = Eigen::Matrix4d::Identity();
  shift(0, 3) = rows.at("P2:").at(3) / rows.at("P2:").at(0);
  const Eigen::Matrix4d camera_from_laser =
      shift * matrix(rows.at("R0_rect:"), 3) * matrix(rows.at("Tr_velo_to_cam:"), 4);
  std::ostringstream text;
  text.precision(12);
  text << camera_from_laser << "\n";
  write_text("camera_from_laser.txt", text.str());
  const json out = run_json({"compare", path("disparity.ply"), scan.string(),
                             "--estimate-from-truth", path("camera_from_laser.txt"), "--region",
                             "-6,-0.5,6,6,3,18", "--thresholds", "0.1,0.3", "--no-road-frame"});
  EXPECT_GT(out.at("scores").at(1).at("recall"), 0.9);
  EXPECT_LT(out.at("completeness").at("median"), 0.06);
}

TEST_F(CloudTools, EnginesAnswerInOneFormat) {
  const std::string cloud =
      (test::source_dir() / "samples" / "steep_hill" / "truth" / "road.ply").string();
  const auto keys = [](const json& object) {
    std::vector<std::string> out;
    for (const auto& [key, value] : object.items()) out.push_back(key);
    return out;
  };
  for (const std::vector<std::string>& command :
       {std::vector<std::string>{"patches", cloud, "--out", path("patches")},
        std::vector<std::string>{"ground", cloud, "--out", path("ground.ply")}}) {
    SCOPED_TRACE(command[0]);
    const json camber = run_json(command);
    std::vector<std::string> by_pcl = command;
    by_pcl.insert(by_pcl.end(), {"--engine", "pcl"});
    const json pcl = run_json(by_pcl);
    EXPECT_EQ(keys(pcl), keys(camber));
    EXPECT_EQ(pcl.at("options").at("engine"), "pcl");
    EXPECT_EQ(camber.at("options").at("engine"), "camber");
    const char* count = command[0] == "ground" ? "ground" : "points_on_patches";
    EXPECT_NE(pcl.at(count), camber.at(count));  // another method
    EXPECT_GT(pcl.at(count), 35000);             // of 40,000
  }
  EXPECT_EQ(keys(json::parse(test::read_text(path("patches/surface.json"))).at("patches").at(0)),
            keys(run_json({"patches", cloud, "--out", path("other")}).at("patches").at(0)));
}

}  // namespace
}  // namespace camber
