// --bounds of the commands on clouds, and what filter selects of survey clouds.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;
using testing::HasSubstr;

/// Level ground of 60 m x 60 m with a hut of 6 m x 6 m in its middle; classes by column.
class PartsOfClouds : public ::testing::Test {
 protected:
  void SetUp() override {
    const CounterRandom random(5);
    std::string text = "x,y,z,classification,return_number,number_of_returns\n";
    for (std::uint64_t i = 0; i < 15000; ++i) {
      const double x = random.uniform(3 * i, 0, 60), y = random.uniform(3 * i + 1, 0, 60);
      const bool hut = std::abs(x - 30) < 3 && std::abs(y - 30) < 3;
      const double z = (hut ? 4.0 : 0.0) + 0.02 * random.normal(3 * i + 2);
      text += std::to_string(x) + "," + std::to_string(y) + "," + std::to_string(z) + "," +
              (x < 20   ? "2"
               : x < 40 ? "6"
                        : "9") +
              "," + std::to_string(1 + i % 2) + ",2\n";
    }
    test::write_bytes(path("cloud.csv"), text);
    const auto made = run_camber({"convert", path("cloud.csv"), "--out", path("cloud.las")});
    ASSERT_EQ(made.exit_code, 0) << made.error;
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  static json run(const std::vector<std::string>& words) {
    std::vector<std::string> all = words;
    all.emplace_back("--json");
    const auto out = run_camber(all);
    EXPECT_EQ(out.exit_code, 0) << out.error;
    return out.exit_code == 0 ? json::parse(out.out) : json();
  }
  test::TemporaryFolder folder_;
};

TEST_F(PartsOfClouds, BoundsOfEveryCommandThatWritesClouds) {
  const std::string cloud = path("cloud.las"), out = path("out.las");
  std::uint64_t total = 0;
  for (const char* const bounds : {"0,0,30,60", "30,0,60,60"}) {
    total += run({"convert", cloud, "--bounds", bounds, "--out", out})["points"].get<int>();
  }
  EXPECT_EQ(total, 15000u);
  const json info = run({"info", cloud, "--bounds", "10,10,20,20"})["files"][0];
  EXPECT_GE(info["bounds"]["min"][0], 10.0);
  EXPECT_LT(info["bounds"]["max"][1], 20.0);
  EXPECT_EQ(info["points"].get<int>() + info["outside_bounds"].get<int>(), 15000);
  EXPECT_EQ(run({"filter", cloud, "--bounds", "10,10,20,20", "--out", out})["points"],
            info["points"]);
  EXPECT_ONE_SENTENCE(run_camber({"convert", cloud, "--bounds", "5,5,5,6", "--out", out}), 2,
                      "x0 < x1");
}

TEST_F(PartsOfClouds, GroundWithinBoundsIsThatOfTheWhole) {
  const std::string cloud = path("cloud.las");
  run({"ground", cloud, "--largest-object", "8", "--out", path("whole.ply")});
  // The border goes through the hut, which a cut cloud of this part would hardly see.
  const json part = run({"ground", cloud, "--largest-object", "8", "--bounds", "28,28,60,60",
                         "--out", path("part.ply")});
  const RoadCloud whole = read_cloud(path("whole.ply")), inside = read_cloud(path("part.ply"));
  EXPECT_EQ(part["points"], inside.size());
  std::size_t k = 0, different = 0;
  const std::vector<int>& all = whole.labels.at("ground");
  for (std::size_t i = 0; i < whole.size(); ++i) {
    const Eigen::Vector3d x = whole.origin + whole.points[i].cast<double>();
    if (x.x() < 28 || x.y() < 28) continue;
    ASSERT_LT(k, inside.size());
    different += all[i] == inside.labels.at("ground")[k++] ? 0 : 1;
  }
  EXPECT_EQ(k, inside.size());
  EXPECT_LE(different, inside.size() / 500);
  EXPECT_ONE_SENTENCE(
      run_camber({"ground", cloud, "--bounds", "100,100,110,110", "--out", path("a.ply")}), 1,
      "no point lies within --bounds");
}

TEST_F(PartsOfClouds, PatchesWithinBounds) {
  const json found =
      run({"patches", path("cloud.las"), "--bounds", "5,5,20,20", "--out", path("out"), "--las"});
  ASSERT_FALSE(found["patches"].empty());
  for (const json& patch : found["patches"]) {
    EXPECT_EQ(patch["kind"], "ground");
    for (const json& corner : patch["boundary"]) {
      EXPECT_GE(corner[0].get<double>(), 5.0 - 1e-9);
      EXPECT_LE(corner[1].get<double>(), 20.0 + 1e-9);
    }
  }
  EXPECT_EQ(read_cloud(path("out/labels.ply")).size(), found["points"]);
  EXPECT_EQ(read_cloud(path("out/labels.las")).size(), found["points"]);
}

TEST_F(PartsOfClouds, FilterByClassReturnAndArea) {
  const std::string cloud = path("cloud.las"), out = path("out.las");
  const json info = run({"info", cloud})["files"][0];
  const auto count_of = [&](const char* value) {
    for (const json& attribute : info["attributes"]) {
      if (attribute["name"] == "classification") return attribute["counts"][value].get<int>();
    }
    return -1;
  };
  EXPECT_EQ(run({"filter", cloud, "--class", "2,9", "--out", out})["points"],
            count_of("2") + count_of("9"));
  EXPECT_EQ(run({"filter", cloud, "--not-class", "6", "--out", out})["points"],
            count_of("2") + count_of("9"));
  EXPECT_EQ(run({"filter", cloud, "--returns", "last", "--out", out})["points"], 7500);
  test::write_bytes(path("area.geojson"),
                    R"({"type": "Feature", "geometry": {"type": "Polygon", "coordinates":
                    [[[0, 0], [60, 0], [60, 60], [0, 60], [0, 0]],
                     [[10, 10], [50, 10], [50, 50], [10, 50], [10, 10]]]}})");
  const int frame =
      run({"filter", cloud, "--polygon", path("area.geojson"), "--out", out})["points"];
  const json hole = run({"info", cloud, "--bounds", "10,10,50,50"})["files"][0];
  EXPECT_EQ(frame + hole["points"].get<int>(), 15000);
  test::write_bytes(path("corners.csv"), "x,y\n0,0\n60,0\n0,60\n");
  const int half = run({"filter", cloud, "--polygon", path("corners.csv"), "--out", out})["points"];
  EXPECT_NEAR(half, 7500, 300);  // 5 standard deviations
  const auto text = run_camber({"info", cloud});
  EXPECT_THAT(text.out, HasSubstr("ground"));
  EXPECT_THAT(text.out, HasSubstr("building"));
  test::write_bytes(path("bad.geojson"), "{\"type\": \"Polygon\"}");
  EXPECT_ONE_SENTENCE(run_camber({"filter", cloud, "--polygon", path("bad.geojson"), "--out", out}),
                      2, "found no list 'coordinates'");
  EXPECT_ONE_SENTENCE(run_camber({"filter", path("corners.csv"), "--class", "2", "--out", out}), 2,
                      "found no attribute 'classification'");
}

TEST_F(PartsOfClouds, ScansOfE57) {
  CAMBER_REQUIRE_DATA("survey-files/e57/made_three_scans_posed.e57");
  const std::string file = test::data_dir() / "survey-files/e57/made_three_scans_posed.e57";
  const json info = run({"info", file})["files"][0];
  EXPECT_EQ(info["format"], "e57");
  EXPECT_EQ(info["points"], 633 + 320 + 250);
  EXPECT_EQ(info["dropped"]["invalid in the file"], 67 + 80);
  ASSERT_EQ(info["e57"]["scans"].size(), 3u);
  EXPECT_EQ(info["e57"]["scans"][0]["name"], "street 1");
  EXPECT_EQ(info["e57"]["scans"][1]["invalid"], 80);
  EXPECT_EQ(run({"convert", file, "--scan", "2", "--out", path("a.las")})["points"], 250);
  const json own = run({"convert", file, "--scan", "0", "--own-frame", "--out", path("a.ply")});
  EXPECT_EQ(own["points"], 633);
  EXPECT_LT(std::abs((read_cloud(path("a.ply")).points[0].x())), 30.0f);
  EXPECT_ONE_SENTENCE(run_camber({"convert", file, "--scan", "3", "--out", path("a.ply")}), 2,
                      "found 3 scans");
  EXPECT_ONE_SENTENCE(run_camber({"convert", path("cloud.las"), "--out", path("a.e57")}), 2,
                      "read only");
  const std::string damaged = test::data_dir() / "survey-files/e57/damaged/crc_data_page.e57";
  EXPECT_ONE_SENTENCE(run_camber({"convert", damaged, "--out", path("a.ply")}), 2, "page 3");
}

}  // namespace
}  // namespace camber
