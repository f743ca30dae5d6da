// camber profile of a cloud along lines of every format, and camber compare --method m3c2.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "cli/run_program.h"
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

constexpr double kEast = 432000.0, kNorth = 5400000.0;

/// A road to the north-east at 4 %, 2 % across, in UTM zone 32.
class CloudProfiles : public ::testing::Test {
 protected:
  CloudProfiles() {
    write_cloud(road(0.0, 1), path("road.ply"));
    write_cloud(road(0.03, 2), path("later.ply"));
    std::ofstream csv(path("line.csv"));
    csv << "x,y,z\n";
    for (int s = 0; s <= 40; ++s) {
      const Vector3d p = place(s, 0.0);
      csv << fmt::format("{:.4f},{:.4f},{:.4f}\n", p.x(), p.y(), p.z());
    }
  }
  static Vector3d place(double s, double v) {
    return {kEast + 0.6 * s - 0.8 * v, kNorth + 0.8 * s + 0.6 * v, 100.0 + 0.04 * s + 0.02 * v};
  }
  static RoadCloud road(double raised, std::uint64_t seed) {
    RoadCloud out;
    out.frame = CloudFrame::kZUp;
    out.origin = {kEast, kNorth, 100.0};
    const CounterRandom random(seed);
    for (std::uint64_t i = 0; i < 12000; ++i) {
      const double s = random.uniform(2 * i, -5.0, 45.0), v = random.uniform(2 * i + 1, -6.0, 6.0);
      Vector3d p = place(s, v);
      p.z() += raised * (s > 20.0) + 0.01 * random.normal(i);
      out.points.push_back((p - out.origin).cast<float>());
    }
    return out;
  }
  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }
  test::ProgramResult profile(std::vector<std::string> more) const {
    std::vector<std::string> words = {"profile", path("road.ply"),        "--drift-sigma",
                                      "0",       "--levelling-sigma-deg", "0"};
    words.insert(words.end(), more.begin(), more.end());
    return run_camber(words);
  }
  /// The stations of a run with --json are those of the road.
  void expect_road(const test::ProgramResult& run) const {
    ASSERT_EQ(run.exit_code, 0) << run.error;
    const json stations = json::parse(run.out).at("stations");
    // A line that was transformed may end a hair before its last metre.
    ASSERT_GE(stations.size(), 40u);
    ASSERT_LE(stations.size(), 41u);
    for (const json& at : stations) {
      const double s = at.at("station");
      EXPECT_NEAR(at.at("height"), 100.0 + 0.04 * s, 0.005);
      EXPECT_NEAR(at.at("cross_slope_percent"), 2.0, 0.15);
      EXPECT_LT(at.at("cross_slope_low_percent"), at.at("cross_slope_high_percent"));
      if (at.at("grade_percent").is_number()) {
        EXPECT_NEAR(at.at("grade_percent"), 4.0, 0.15);
      }
    }
  }
  test::TemporaryFolder folder_;
};

TEST_F(CloudProfiles, AlongPointsToEveryOutput) {
  expect_road(profile({"--along", path("line.csv"), "--json"}));
  const auto run = profile({"--along", path("line.csv"), "--crown", "--out", path("p.csv"),
                            "--plot", path("p.svg"), "--sections", path("s.png")});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_THAT(run.out, HasSubstr("41 of 41 stations"));
  std::ifstream svg(path("p.svg"));
  EXPECT_THAT(std::string(std::istreambuf_iterator<char>(svg), {}),
              HasSubstr("slopes against gravity"));
  std::ifstream in(path("p.csv"));
  std::string header;
  std::getline(in, header);
  for (const char* name :
       {"station_m,x,y,z,height_m,sigma_height_m,height_low_m,height_high_m,grade_percent",
        "grade_deg", "cross_slope_left_percent", "cross_slope_right_deg", "width_left_m"}) {
    EXPECT_THAT(header, HasSubstr(name));
  }
  const auto columns = std::count(header.begin(), header.end(), ',');
  for (std::string line; std::getline(in, line);) {
    EXPECT_EQ(std::count(line.begin(), line.end(), ','), columns) << line;
  }
  EXPECT_THAT(test::read_bytes(path("p.svg")), HasSubstr("cross slope, %"));
  EXPECT_GT(fs::file_size(path("s.png")), 5000u);
}

TEST_F(CloudProfiles, AlongGeoJsonDxfAndLandXml) {
  const Vector3d a = place(0, 0), b = place(40, 0), c = place(40, 30);
  // An old file with its system, a projected one.
  std::ofstream(path("line.geojson")) << fmt::format(
      R"({{"type":"FeatureCollection","crs":{{"type":"name","properties":{{"name":"EPSG:25832"}}}},
      "features":[{{"type":"Feature","properties":{{"name":"axis"}},"geometry":{{"type":
      "LineString","coordinates":[[{:.4f},{:.4f}],[{:.4f},{:.4f}]]}}}},{{"type":"Feature",
      "properties":{{"name":"other"}},"geometry":{{"type":"LineString","coordinates":
      [[{:.4f},{:.4f}],[{:.4f},{:.4f}]]}}}}]}})",
      a.x(), a.y(), b.x(), b.y(), b.x(), b.y(), c.x(), c.y());
  const auto several = profile({"--along", path("line.geojson"), "--json"});
  EXPECT_ONE_SENTENCE(several, 2, "found 2 lines (1 'axis', 2 'other'), expected one");
  EXPECT_ONE_SENTENCE(profile({"--along", path("line.geojson"), "--alignment", "third", "--json"}),
                      2, "found 'third', which is none of the lines");
  for (const char* wanted : {"axis", "1"}) {
    expect_road(profile(
        {"--along", path("line.geojson"), "--alignment", wanted, "--json", "--crs", "EPSG:25832"}));
  }
  std::ofstream(path("line.dxf")) << fmt::format(
      "0\nSECTION\n2\nENTITIES\n0\nLWPOLYLINE\n8\naxis\n90\n2\n70\n0\n10\n{:.4f}\n20\n{:.4f}\n10\n"
      "{:.4f}\n20\n{:.4f}\n0\nENDSEC\n0\nEOF\n",
      a.x(), a.y(), b.x(), b.y());
  expect_road(profile({"--along", path("line.dxf"), "--json"}));
  std::ofstream(path("line.xml")) << fmt::format(
      "<LandXML><Units><Imperial linearUnit=\"foot\"/></Units><Alignments><Alignment "
      "name=\"axis\"><CoordGeom><Line><Start>{:.6f} {:.6f}</Start><End>{:.6f} {:.6f}</End></Line>"
      "</CoordGeom></Alignment></Alignments></LandXML>",
      a.y() / 0.3048, a.x() / 0.3048, b.y() / 0.3048, b.x() / 0.3048);
  expect_road(profile({"--along", path("line.xml"), "--json"}));
}

TEST_F(CloudProfiles, AlongALineOfAnotherSystem) {
  // Longitudes and latitudes as RFC 7946 has them; the cloud's system is given.
  std::ofstream(path("line.geojson")) << R"({"type":"LineString","coordinates":[
      [8.07493692695223,48.7493000837397],[8.07525809323399,48.7495905387054]]})";
  EXPECT_ONE_SENTENCE(profile({"--along", path("line.geojson"), "--json"}), 2,
                      "but the cloud states no coordinate system, expected --crs");
  expect_road(profile({"--along", path("line.geojson"), "--crs", "EPSG:25832", "--json"}));
  std::ofstream(path("utm33.csv"))
      << "x,y,z\n-8890.80213397753,5422761.77612344,0\n-8864.27114137239,5422791.87809966,0\n";
  expect_road(profile(
      {"--along", path("utm33.csv"), "--line-crs", "EPSG:25833", "--crs", "EPSG:25832", "--json"}));
  // Gauss and Krueger on the datum of Potsdam: by a grid that Debian does not install.
  const auto grid = profile(
      {"--along", path("line.csv"), "--line-crs", "EPSG:31467", "--crs", "EPSG:25832", "--json"});
  EXPECT_ONE_SENTENCE(grid, 2, "cannot be transformed from its coordinate system (");
  EXPECT_THAT(grid.error, HasSubstr("31467"));
  EXPECT_THAT(grid.error, HasSubstr("25832"));
}

TEST_F(CloudProfiles, AlongTheStripOfADrive) {
  // Two stretches of cells of half a metre, with 1 cm of noise and 2 cm that they share.
  fs::create_directories(path("strip"));
  const CounterRandom random(8);
  std::uint64_t next = 0;
  for (int part = 0; part < 2; ++part) {
    RoadCloud cells;
    cells.frame = CloudFrame::kZUp;
    cells.origin = {30.0 * part, 0.0, 0.0};
    for (int i = 0; i < 60; ++i) {
      for (int j = -10; j <= 10; ++j) {
        const double s = 30.0 * part + 0.5 * i, v = 0.5 * j;
        const Vector3d p(s, v, 0.04 * s + 0.02 * v + 0.01 * random.normal(next++));
        cells.points.push_back((p - cells.origin).cast<float>());
        cells.sigmas.push_back(0.02f);
        cells.labels["label"].push_back(1);
      }
    }
    write_cloud(cells, path(fmt::format("strip/00000{}.ply", part)));
  }
  json index = {
      {"format", "camber-strip"},
      {"version", 1},
      {"metric", true},
      {"level", "camera"},
      {"strip_from_world", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}},
      {"driven_line_s_xyz", {{0, 0, 0, 0}, {50, 50, 0, 2}}},
      {"stretches",
       {{{"file", "000000.ply"}, {"from_s", 0}}, {{"file", "000001.ply"}, {"from_s", 30}}}}};
  std::ofstream(path("strip/index.json")) << index;
  const auto run = run_camber(
      {"profile", path("strip"), "--drift-sigma", "0", "--levelling-sigma-deg", "0", "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  const json profile = json::parse(run.out);
  EXPECT_EQ(profile["level"], "camera");
  EXPECT_EQ(profile["stations"].size(), 51u);
  for (const json& at : profile["stations"]) {
    EXPECT_NEAR(at.at("height"), 0.04 * at.at("station").get<double>(), 0.012);
    EXPECT_NEAR(at.at("cross_slope_percent"), 2.0, 0.4);
    EXPECT_NEAR(at.at("sigma_height"), 0.02, 0.003);
  }
  EXPECT_EQ(run_camber({"profile", path("strip"), "--along", path("line.csv"), "--json"}).exit_code,
            1);  // a line elsewhere
  EXPECT_ONE_SENTENCE(run_camber({"profile", path("strip"), "--line-crs", "EPSG:25832", "--json"}),
                      2, "--line-crs: found the strip of a drive, expected a cloud");
  index["stretches"][1]["file"] = "gone.ply";
  std::ofstream(path("strip/index.json")) << index;
  EXPECT_ONE_SENTENCE(run_camber({"profile", path("strip"), "--json"}), 2, "gone.ply");
  index["format"] = "other";
  std::ofstream(path("strip/index.json")) << index;
  EXPECT_ONE_SENTENCE(run_camber({"profile", path("strip"), "--json"}), 2,
                      "format: found \"other\", expected \"camber-strip\"");
}

TEST_F(CloudProfiles, MistakesAreOneSentence) {
  const auto before = test::snapshot(folder_.path());
  EXPECT_ONE_SENTENCE(profile({"--json"}), 2, "--along FILE");
  EXPECT_ONE_SENTENCE(profile({"--along", path("line.csv")}), 2, "--sections");
  EXPECT_ONE_SENTENCE(profile({"--along", path("line.csv"), "--json", "--reach", "1"}), 2,
                      "--reach: found points");
  EXPECT_ONE_SENTENCE(profile({"--along", path("none.geojson"), "--json"}), 2, "none.geojson");
  EXPECT_ONE_SENTENCE(profile({"--along", path("line.csv"), "--alignment", "1", "--json"}), 2,
                      "--alignment");
  EXPECT_ONE_SENTENCE(profile({"--along", path("line.csv"), "--ground-from", "class", "--json"}), 1,
                      "the points have no classes");
  EXPECT_EQ(test::snapshot(folder_.path()), before);
  std::ofstream(path("far.csv")) << "x,y\n0,0\n50,0\n";
  EXPECT_ONE_SENTENCE(profile({"--along", path("far.csv"), "--json"}), 1,
                      "expected a line in its coordinates");
}

TEST_F(CloudProfiles, ChangeBetweenEpochs) {
  const auto run = run_camber({"compare", path("later.ply"), path("road.ply"), "--method", "m3c2",
                               "--cylinder", "1", "--normal-scale", "2", "--core-spacing", "0.5",
                               "--registration-sigma", "0.002", "--out", path("change")});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_THAT(run.out, HasSubstr("change, later less earlier: mean +"));
  const json change = json::parse(std::ifstream(path("change/change.json")));
  // 25 by 12 m are raised by 3 cm.
  EXPECT_NEAR(change.at("gain").at("volume"), 25.0 * 12.0 * 0.03, 1.0);
  EXPECT_LT(change.at("loss").at("volume"), 0.2);
  EXPECT_NEAR(change.at("detection_limit_95"), 1.96 * (0.01 * std::sqrt(2.0 / 15.7) + 0.002),
              0.003);
  const RoadCloud cores = read_cloud(path("change/change.ply"));
  EXPECT_EQ(cores.size(), change.at("core_points"));
  EXPECT_EQ(cores.labels.count("significant"), 1u);
  for (const char* name : {"change.png", "histogram.png", "run.json", "change.txt"}) {
    EXPECT_GT(fs::file_size(path(std::string("change/") + name)), 100u);
  }
  EXPECT_ONE_SENTENCE(
      run_camber({"compare", path("later.ply"), path("road.ply"), "--cylinder", "1"}), 2,
      "--cylinder: found with --method none");
  EXPECT_ONE_SENTENCE(run_camber({"compare", path("later.ply"), path("road.ply"), "--method", "dz",
                                  "--align", "rigid"}),
                      2, "--align: found with --method dz");
}

}  // namespace
}  // namespace camber
