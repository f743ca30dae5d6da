// camber plane, camber patches and camber profile on a made road cloud.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "cli/run_program.h"
#include "plane/road_scene_maker.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using Eigen::Vector3d;
using nlohmann::json;
using test::run_camber;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

constexpr double kDegree = M_PI / 180.0;

class RoadClouds : public ::testing::Test {
 protected:
  RoadClouds() {
    test::RoadSceneOptions made;
    made.seed = 4;
    made.planes = 3;
    made.points = 20000;
    made.outlier_share = 0.1;
    scene_ = test::make_road_scene(made);
    write_cloud(scene_.cloud, path("cloud.ply"));
    std::ofstream(path("nan.xyz")) << "x y z\nnan nan nan\nnan nan nan\nnan nan nan\nnan nan nan\n";
    std::ofstream(path("two.xyz")) << "x y z\n0 0 0\n1 0 0\n";
    const std::string bytes = test::read_bytes(path("cloud.ply"));
    test::write_bytes(path("cut.ply"), bytes.substr(0, bytes.size() / 2));
  }
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  json read(const std::string& name) const { return json::parse(std::ifstream(path(name))); }
  /// The road's axis, and beyond its last point by `more` metres.
  void write_axis(const std::string& name, double more) const {
    std::ofstream out(path(name));
    out << "x,y,z\n";
    for (const Vector3d& p : scene_.axis) out << p.x() << ',' << p.y() << ',' << p.z() << '\n';
    const std::size_t n = scene_.axis.size();
    const Vector3d way = (scene_.axis[n - 1] - scene_.axis[n - 2]).normalized();
    const Vector3d end = scene_.axis[n - 1] + more * way;
    if (more > 0.0) out << end.x() << ',' << end.y() << ',' << end.z() << '\n';
  }
  /// A result folder with the surface of the cloud.
  void make_surface(const std::string& name) const {
    const auto run = run_camber({"patches", path("cloud.ply"), "--out", path(name), "--quiet"});
    ASSERT_EQ(run.exit_code, 0) << run.error;
  }

  test::TemporaryFolder folder_;
  test::RoadScene scene_;
};

void expect_common_keys(const json& said) {
  EXPECT_TRUE(said["version"].is_string());
  EXPECT_TRUE(said["seed"].is_number());
  EXPECT_TRUE(said["options"].is_object());
  for (const char* stage : {"load", "compute", "write"}) {
    EXPECT_TRUE(said["timings_ms"][stage].is_number()) << stage;
  }
}

TEST_F(RoadClouds, PlaneAsJson) {
  const auto run = run_camber({"plane", path("cloud.ply"), "--json", "--seed", "7"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const json said = json::parse(run.out);
  expect_common_keys(said);
  EXPECT_EQ(said["seed"], 7);
  EXPECT_EQ(said["points"], 20000);
  EXPECT_EQ(said["frame"], "z-up");
  EXPECT_EQ(said["metric"], true);
  const json& plane = said["plane"];
  EXPECT_EQ(plane["status"], "ok");
  for (const char* key : {"normal", "centroid", "axis1", "axis2"}) {
    EXPECT_EQ(plane[key].size(), 3u) << key;
  }
  EXPECT_EQ(plane["covariance"].size(), 9u);
  EXPECT_GE(plane["boundary"].size(), 3u);
  EXPECT_GT(plane["inliers"].get<int>(), 4000);
  EXPECT_GE(plane["condition"].get<double>(), 1.0);
  // It is one of the three: 0.05 degrees is several standard deviations at 6,000 points.
  const Vector3d normal(plane["normal"][0], plane["normal"][1], plane["normal"][2]);
  double nearest = 10.0;
  for (const Plane& truth : scene_.planes) {
    nearest = std::min(nearest, angle_between(normal, truth.normal));
  }
  EXPECT_LT(nearest, 0.05 * kDegree);

  const auto text = run_camber({"plane", path("cloud.ply"), "--seed", "7"});
  EXPECT_EQ(text.exit_code, 0);
  EXPECT_THAT(text.out, HasSubstr("status     ok"));
  EXPECT_EQ(text.error, "");
}

TEST_F(RoadClouds, LengthsUpToScaleAreNoMetres) {
  RoadCloud cloud = scene_.cloud;
  cloud.metric = false;
  write_cloud(cloud, path("unscaled.ply"));
  const std::string warning = "units of unknown size (up to scale), not metres\n";
  const auto plane = run_camber({"plane", path("unscaled.ply")});
  ASSERT_EQ(plane.exit_code, 0) << plane.error;
  EXPECT_EQ(plane.error,
            "camber: warning: " + path("unscaled.ply") + ": its lengths are in " + warning);
  EXPECT_THAT(plane.out, HasSubstr(" units\n"));
  EXPECT_THAT(plane.out, Not(HasSubstr(" m\n")));
  EXPECT_THAT(plane.out, Not(HasSubstr(" mm")));
  const auto patches = run_camber({"patches", path("unscaled.ply"), "--out", path("unscaled")});
  ASSERT_EQ(patches.exit_code, 0) << patches.error;
  EXPECT_THAT(patches.error, HasSubstr(warning));
  EXPECT_THAT(patches.out, Not(HasSubstr(" mm")));
  write_axis("axis.csv", 0.0);
  const auto profile =
      run_camber({"profile", path("unscaled"), "--along", path("axis.csv"), "--json"});
  ASSERT_EQ(profile.exit_code, 0) << profile.error;
  EXPECT_THAT(profile.error, HasSubstr("surface.json: its lengths are in " + warning));
  EXPECT_EQ(json::parse(profile.out)["metric"], false);
}

TEST_F(RoadClouds, AThresholdBelowTheNoiseIsNamed) {
  RoadCloud cloud;
  const CounterRandom random(3);
  for (std::uint64_t i = 0; i < 4000; ++i) {
    cloud.points.push_back(Vector3d(random.uniform(2 * i, -5.0, 5.0),
                                    random.uniform(2 * i + 1, -5.0, 5.0), 0.02 * random.normal(i))
                               .cast<float>());
  }
  write_cloud(cloud, path("noisy.ply"));
  const auto plane = run_camber({"plane", path("noisy.ply"), "--threshold", "0.008"});
  ASSERT_EQ(plane.exit_code, 0) << plane.error;
  EXPECT_THAT(plane.out, HasSubstr("status     weak: the points scatter about it by 0.02 m, which "
                                   "the threshold of 0.008 m cannot show: this is of those "));
  const std::vector<std::string> patches = {"patches",     path("noisy.ply"), "--out",
                                            path("noisy"), "--threshold",     "0.008"};
  const auto warned = run_camber(patches);
  ASSERT_EQ(warned.exit_code, 0) << warned.error;
  EXPECT_THAT(warned.error, HasSubstr("camber: warning: " + path("noisy.ply") +
                                      ": points scatter about their planes by 0.0"));
  EXPECT_EQ(std::count(warned.error.begin(), warned.error.end(), '\n'), 1);
  std::vector<std::string> quiet = patches;
  quiet.push_back("--quiet");
  EXPECT_EQ(run_camber(quiet).error, "");
  quiet = {"patches", path("noisy.ply"), "--out", path("noisy"), "--threshold", "0.05"};
  EXPECT_EQ(run_camber(quiet).error, "");
}

TEST_F(RoadClouds, EnginesAgree) {
  test::RoadSceneOptions made;
  made.points = 20000;
  write_cloud(test::make_road_scene(made).cloud, path("one.ply"));
  const auto ours = run_camber({"plane", path("one.ply"), "--json"});
  const auto pcl = run_camber({"plane", path("one.ply"), "--json", "--engine", "pcl"});
  ASSERT_EQ(ours.exit_code, 0) << ours.error;
  ASSERT_EQ(pcl.exit_code, 0) << pcl.error;
  const json a = json::parse(ours.out)["plane"], b = json::parse(pcl.out)["plane"];
  EXPECT_EQ(json::parse(pcl.out)["options"]["engine"], "pcl");
  const Vector3d na(a["normal"][0], a["normal"][1], a["normal"][2]),
      nb(b["normal"][0], b["normal"][1], b["normal"][2]),
      centroid(a["centroid"][0], a["centroid"][1], a["centroid"][2]);
  // One threshold of 5 cm for all points tilts a plane by 0.1 degrees or so where noise grows with
  // distance.
  EXPECT_LT(angle_between(na, nb), 0.3 * kDegree);
  EXPECT_NEAR(nb.dot(centroid) + b["offset"].get<double>(), 0.0, 0.01);
  EXPECT_NEAR(a["inliers"].get<double>() / b["inliers"].get<double>(), 1.0, 0.15);
}

TEST_F(RoadClouds, FailuresAreOneSentence) {
  for (const char* command : {"plane", "patches"}) {
    const auto run = [&](const std::string& cloud, const std::vector<std::string>& more = {}) {
      std::vector<std::string> words = {command, path(cloud)};
      if (std::string(command) == "patches") {
        words.insert(words.end(), {"--out", path("none")});
      }
      words.insert(words.end(), more.begin(), more.end());
      return run_camber(words);
    };
    EXPECT_ONE_SENTENCE(run("missing.ply"), 2, "missing.ply");
    EXPECT_ONE_SENTENCE(run("cut.ply"), 2, "cut.ply");
    EXPECT_ONE_SENTENCE(run("nan.xyz"), 1, "0 usable points, at least 3 are needed");
    EXPECT_ONE_SENTENCE(run("two.xyz"), 1, "2 usable points, at least 3 are needed");
    EXPECT_ONE_SENTENCE(run("cloud.ply", {"--up", "0,0,0"}), 2, "--up");
    EXPECT_ONE_SENTENCE(run("cloud.ply", {"--viewpoint", "nan,0,0"}), 2, "found 'nan'");
    EXPECT_FALSE(fs::exists(path("none"))) << command;
  }
}

/// A grid of 40 x 40 points 0.25 m apart at a height, as text.
std::string level_sheet(double height) {
  std::string out;
  for (int i = 0; i < 1600; ++i) {
    out += fmt::format("{} {} {}\n", 0.25 * (i % 40), 0.25 * (i / 40), height);
  }
  return out;
}

TEST_F(RoadClouds, DegenerateClouds) {
  const auto write = [&](const char* name, const std::string& rows) {
    std::ofstream(path(name)) << "x y z\n" << rows;
  };
  std::string equal, line;
  for (int i = 0; i < 50; ++i) {
    equal += "1 2 3\n";
    line += fmt::format("{} {} {}\n", 0.5 * i, 0.25 * i, 0.1 * i);
  }
  write("equal.xyz", equal);
  write("line.xyz", line);
  write("flat.xyz", level_sheet(2.0));
  write("sheets.xyz", level_sheet(0.0) + level_sheet(3.0));
  write("far.xyz", level_sheet(2.0) + "1e9 1e9 1e9\n");
  const auto plane = [&](const char* name) { return run_camber({"plane", path(name), "--json"}); };
  const auto patches = [&](const char* name) {
    return run_camber({"patches", path(name), "--json", "--out", path(std::string(name) + ".out")});
  };
  EXPECT_ONE_SENTENCE(plane("equal.xyz"), 1, "all points lie at one place");
  EXPECT_ONE_SENTENCE(patches("equal.xyz"), 1, "all points lie at one place");
  EXPECT_ONE_SENTENCE(plane("line.xyz"), 1, "the points lie on a line");
  EXPECT_ONE_SENTENCE(patches("line.xyz"), 1, "no planar ground was found");
  EXPECT_FALSE(fs::exists(path("line.xyz.out")));
  for (const char* name : {"flat.xyz", "far.xyz"}) {
    const auto one = plane(name), model = patches(name);
    ASSERT_EQ(one.exit_code, 0) << one.error;
    ASSERT_EQ(model.exit_code, 0) << model.error;
    const json fit = json::parse(one.out)["plane"], patch = json::parse(model.out)["patches"][0];
    for (const json& p : {fit, patch}) {
      EXPECT_EQ(p["status"], "ok") << name;
      EXPECT_NEAR(p["normal"][2].get<double>(), 1.0, 1e-9);
      // Floats hold heights of 2 m to 2e-7 m.
      EXPECT_NEAR(p["offset"].get<double>(), -2.0, 1e-5);
      EXPECT_EQ(p["inliers"], 1600);
    }
    EXPECT_EQ(json::parse(model.out)["patches"].size(), 1u) << name;
  }
  const auto one = plane("sheets.xyz"), both = patches("sheets.xyz");
  ASSERT_EQ(one.exit_code, 0) << one.error;
  ASSERT_EQ(both.exit_code, 0) << both.error;
  EXPECT_EQ(json::parse(one.out)["plane"]["inliers"], 1600);
  const json found = json::parse(both.out);
  ASSERT_EQ(found["patches"].size(), 2u);
  EXPECT_NEAR(std::abs(found["patches"][0]["offset"].get<double>() -
                       found["patches"][1]["offset"].get<double>()),
              3.0, 1e-5);
  ASSERT_EQ(found["links"].size(), 1u);
  EXPECT_EQ(found["links"][0]["valid"], false);
  EXPECT_THAT(found["links"][0]["reason"].get<std::string>(), HasSubstr("above the other"));
}

TEST_F(RoadClouds, PatchesWriteAResult) {
  const auto run = run_camber({"patches", path("cloud.ply"), "--out", path("out"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const json said = json::parse(run.out);
  expect_common_keys(said);
  EXPECT_EQ(said["frame"], "z-up");
  EXPECT_EQ(said["metric"], true);
  int ground = 0;
  for (const json& patch : said["patches"]) {
    for (const char* key :
         {"id", "kind", "status", "normal", "offset", "centroid", "axis1", "axis2", "covariance",
          "inliers", "boundary", "grade_deg", "bank_deg"}) {
      EXPECT_TRUE(patch.contains(key)) << key;
    }
    ground += patch["kind"] == "ground" ? 1 : 0;
    EXPECT_NE(patch["kind"], "road");  // which only a driven line would tell
  }
  EXPECT_GE(ground, 3);
  for (const json& link : said["links"]) {
    for (const char* key :
         {"a", "b", "valid", "reason", "weight", "distance", "height_step", "angle_deg"}) {
      EXPECT_TRUE(link.contains(key)) << key;
    }
    EXPECT_TRUE(link["valid"].get<bool>() || link["reason"] != "");
  }
  const json surface = read("out/surface.json");
  EXPECT_EQ(surface["patches"], said["patches"]);
  const json document = read("out/run.json");
  expect_common_keys(document);
  // The labelled cloud is the input in its order.
  const RoadCloud labelled = read_cloud(path("out/labels.ply"));
  ASSERT_EQ(labelled.size(), scene_.cloud.size());
  EXPECT_EQ(labelled.points, scene_.cloud.points);
  const std::vector<int>& labels = labelled.labels.at("patch");
  std::vector<int> counts(said["patches"].size(), 0);
  for (const int label : labels) {
    ASSERT_LT(label, static_cast<int>(counts.size()));
    if (label >= 0) ++counts[static_cast<std::size_t>(label)];
  }
  for (const json& patch : said["patches"]) {
    EXPECT_EQ(counts[patch["id"].get<std::size_t>()], patch["inliers"]);
  }
  // Pictures of the folder show its points.
  const auto drawn = run_camber({"render", path("out"), "--out", path("scene.glb")});
  ASSERT_EQ(drawn.exit_code, 0) << drawn.error;
  EXPECT_NE(test::read_bytes(folder_.path() / "scene.glb").find("\"points\""), std::string::npos);
}

TEST_F(RoadClouds, SameFilesForAnyNumberOfThreads) {
  for (const char* threads : {"1", "2", "4"}) {
    const auto run = run_camber({"patches", path("cloud.ply"), "--out",
                                 path(std::string("t") + threads), "--threads", threads});
    ASSERT_EQ(run.exit_code, 0) << run.error;
  }
  for (const char* file : {"surface.json", "labels.ply"}) {
    const std::string one = test::read_bytes(folder_.path() / "t1" / file);
    EXPECT_EQ(one, test::read_bytes(folder_.path() / "t2" / file)) << file;
    EXPECT_EQ(one, test::read_bytes(folder_.path() / "t4" / file)) << file;
  }
}

TEST_F(RoadClouds, FailuresLeaveTheOldResult) {
  make_surface("out");
  fs::create_directory(path("foreign"));
  std::ofstream(path("foreign/notes.txt")) << "mine\n";
  const auto before = test::snapshot(folder_.path());
  EXPECT_ONE_SENTENCE(run_camber({"patches", path("nan.xyz"), "--out", path("out")}), 1, "usable");
  EXPECT_ONE_SENTENCE(run_camber({"patches", path("cut.ply"), "--out", path("out")}), 2, "cut.ply");
  const auto foreign = run_camber({"patches", path("cloud.ply"), "--out", path("foreign")});
  EXPECT_NE(foreign.exit_code, 0);
  EXPECT_THAT(foreign.error, HasSubstr("--overwrite"));
  EXPECT_EQ(test::snapshot(folder_.path()), before);
}

TEST_F(RoadClouds, ProfileAlongALine) {
  make_surface("out");
  write_axis("axis.csv", 30.0);
  for (const char* name : {"profile.json", "profile.csv"}) {
    const auto run = run_camber(
        {"profile", path("out"), "--along", path("axis.csv"), "--out", path(name), "--quiet"});
    ASSERT_EQ(run.exit_code, 0) << run.error;
    EXPECT_EQ(run.error, "");
  }
  const json profile = read("profile.json");
  expect_common_keys(profile);
  const json& stations = profile["stations"];
  ASSERT_GT(stations.size(), 60u);
  // On the road its height, well inside a piece its grade; beyond its end nothing.
  double from = 0.0;
  for (std::size_t k = 0; k + 1 < scene_.axis.size(); ++k) {
    const Vector3d way = scene_.axis[k + 1] - scene_.axis[k];
    const double length = way.head<2>().norm();
    const auto middle = static_cast<std::size_t>(std::lround(from + 0.5 * length));
    const json& station = stations[middle];
    EXPECT_EQ(station["status"], "ok");
    const double share = (station["station"].get<double>() - from) / length;
    const double height = scene_.axis[k].z() + share * way.z();
    EXPECT_NEAR(station["height"].get<double>(), height, 0.01);
    EXPECT_NEAR(station["grade_percent"].get<double>(), 100.0 * way.z() / length, 0.2);
    EXPECT_GT(station["sigma_height"].get<double>(), 0.0);
    from += length;
  }
  EXPECT_EQ(stations.back()["reason"], "not covered");
  EXPECT_TRUE(stations.back()["height"].is_null());
  EXPECT_TRUE(stations.back()["grade_percent"].is_null());
  // The same in the table.
  // The same on stdout, without a file.
  const auto printed =
      run_camber({"profile", path("out"), "--along", path("axis.csv"), "--json", "--quiet"});
  ASSERT_EQ(printed.exit_code, 0) << printed.error;
  const json on_stdout = json::parse(printed.out);
  expect_common_keys(on_stdout);
  EXPECT_EQ(on_stdout["stations"], stations);
  EXPECT_EQ(on_stdout["covered_stations"], profile["covered_stations"]);
  // The same along a line of a survey's columns.
  {
    std::ofstream line(path("survey.csv"));
    line << "chainage_m,x_m,y_m,z_m\n";
    std::ifstream axis(path("axis.csv"));
    std::string row;
    std::getline(axis, row);
    for (int k = 0; std::getline(axis, row); ++k) line << k << ',' << row << '\n';
  }
  const auto surveyed =
      run_camber({"profile", path("out"), "--along", path("survey.csv"), "--json", "--quiet"});
  ASSERT_EQ(surveyed.exit_code, 0) << surveyed.error;
  EXPECT_EQ(json::parse(surveyed.out)["stations"], stations);
  // What the cloud may be turned by is part of the bands, most of all at the ends.
  const auto turned = run_camber({"profile", path("out"), "--along", path("axis.csv"), "--json",
                                  "--quiet", "--levelling-sigma-deg", "1"});
  ASSERT_EQ(turned.exit_code, 0) << turned.error;
  EXPECT_GT(json::parse(turned.out)["stations"][1]["sigma_height"].get<double>(),
            5.0 * stations[1]["sigma_height"].get<double>());
  std::ifstream csv(path("profile.csv"));
  std::string line, last;
  std::size_t rows = 0;
  std::getline(csv, line);
  EXPECT_THAT(line, HasSubstr("station_m,x,y,z,height_m,grade_percent,cross_slope_percent"));
  EXPECT_THAT(line, testing::EndsWith(",frame,level"));
  const std::string place =
      "," + profile["frame"].get<std::string>() + "," + profile["level"].get<std::string>();
  EXPECT_EQ(place, ",z-up,gravity");
  while (std::getline(csv, line)) {
    last = line;
    ++rows;
    EXPECT_THAT(line, testing::EndsWith(place));
  }
  EXPECT_EQ(rows, stations.size());
  EXPECT_THAT(last, HasSubstr("not covered"));
}

TEST_F(RoadClouds, ProfileUpToScaleNamesNoMetres) {
  make_surface("out");
  write_axis("axis.csv", 30.0);
  json surface = json::parse(test::read_bytes(folder_.path() / "out/surface.json"));
  surface["metric"] = false;
  std::ofstream(path("unscaled.json")) << surface;
  const auto run = run_camber({"profile", path("unscaled.json"), "--along", path("axis.csv"),
                               "--out", path("profile.csv"), "--quiet"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  std::ifstream csv(path("profile.csv"));
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line,
            "station,x,y,z,height,grade_percent,cross_slope_percent,vertical_radius,sigma_height,"
            "sigma_grade_percent,sigma_cross_slope_percent,patch,status,vertical_curvature,"
            "sigma_vertical_curvature,frame,level");
}

TEST_F(RoadClouds, ProfileAsAPlot) {
  make_surface("out");
  write_axis("axis.csv", 0.0);
  for (const char* name : {"profile.svg", "profile.png"}) {
    const auto run = run_camber(
        {"profile", path("out"), "--along", path("axis.csv"), "--plot", path(name), "--quiet"});
    ASSERT_EQ(run.exit_code, 0) << run.error;
  }
  std::ifstream file(path("profile.svg"));
  const std::string svg{std::istreambuf_iterator<char>(file), {}};
  for (const char* word : {"height, m", "grade, %", "cross slope, %", "95 % band", "</svg>"}) {
    EXPECT_THAT(svg, HasSubstr(word));
  }
  EXPECT_GT(fs::file_size(path("profile.png")), 5000u);
}

TEST_F(RoadClouds, ProfileFailuresAreOneSentence) {
  make_surface("out");
  write_axis("axis.csv", 0.0);
  std::ofstream(path("point.xyz")) << "x y z\n0 0 0\n";
  std::ofstream(path("old.csv")) << "old\n";
  fs::create_directory(path("broken"));
  std::ofstream(path("broken/surface.json")) << "{\"frame\": \"z-up\", \"patches\": [{\"id\": ";
  const auto before = test::snapshot(folder_.path());
  const auto run = [&](const std::string& surface, const std::string& line,
                       const std::string& out) {
    return run_camber({"profile", path(surface), "--along", path(line), "--out", path(out)});
  };
  EXPECT_ONE_SENTENCE(run("missing", "axis.csv", "old.csv"), 2, "missing");
  EXPECT_ONE_SENTENCE(run("broken", "axis.csv", "old.csv"), 2, "surface.json");
  EXPECT_ONE_SENTENCE(run_camber({"profile", path("cloud.ply"), "--out", path("old.csv")}), 2,
                      "found a cloud without --along FILE");
  EXPECT_ONE_SENTENCE(run("out", "missing.csv", "old.csv"), 2, "missing.csv");
  EXPECT_ONE_SENTENCE(run("out", "point.xyz", "old.csv"), 1, "at least two points");
  EXPECT_ONE_SENTENCE(run("out", "axis.csv", "old.txt"), 2, "FILE.csv or FILE.json");
  EXPECT_ONE_SENTENCE(run_camber({"profile", path("out"), "--out", path("old.csv")}), 1,
                      "no driven line");
  const std::vector<std::string> along = {"profile", path("out"), "--along", path("axis.csv")};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), along.begin(), along.end());
    return run_camber(more);
  };
  EXPECT_ONE_SENTENCE(with({}), 2, "--plot");
  EXPECT_ONE_SENTENCE(with({"--step", "0", "--json"}), 2,
                      "--step: found '0', expected a number above 0");
  for (const char* option : {"--length", "--reach", "--levelling-sigma-deg", "--drift-sigma"}) {
    const std::string given = option;
    EXPECT_ONE_SENTENCE(with({given + "=-1", "--json"}), 2, given + ": found '-1', expected");
  }
  EXPECT_ONE_SENTENCE(with({"--as-stored", "--json"}), 2, "--as-stored: found");
  EXPECT_ONE_SENTENCE(with({"--plot", path("old.gif")}), 2, "FILE.png or FILE.svg");
  EXPECT_ONE_SENTENCE(with({"--plot", path("missing/plot.png")}), 3, "plot.png");
  std::ofstream(path("elsewhere.csv")) << "x y z\n9000 0 0\n9010 0 0\n";
  EXPECT_ONE_SENTENCE(run_camber({"profile", path("out"), "--along", path("elsewhere.csv"),
                                  "--plot", path("plot.png")}),
                      1, "covered");
  EXPECT_ONE_SENTENCE(run("out", "elsewhere.csv", "old.csv"), 1,
                      "m from the known ground, expected a line in the coordinates of the cloud");
  fs::remove(path("elsewhere.csv"));
  std::ofstream(path("still.csv")) << "x y z\n1 0 0\n1 0 0\n1 0 2\n";
  EXPECT_ONE_SENTENCE(run("out", "still.csv", "old.csv"), 1, "does not leave its first point");
  fs::remove(path("still.csv"));
  EXPECT_ONE_SENTENCE(with({"--out", path("old.csv"), "--step", "1e-9"}), 2,
                      "--step: found 1e-09 m, expected more than 6.25613e-05 m for a line of");
  EXPECT_ONE_SENTENCE(with({"--out", path("old.csv"), "--length", "1e-7"}), 2,
                      "--length: found 1e-07 m, expected more than");
  EXPECT_ONE_SENTENCE(with({"--plot", path("plot.png"), "--out", path("missing/p.csv")}), 3,
                      "missing/p.csv");
  EXPECT_EQ(test::snapshot(folder_.path()), before);
}

}  // namespace
}  // namespace camber
