// Positions on the earth: import --gnss, and what comes of them in exports and clouds.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/cloud/cloud_io.h"
#include "camber/export/opencrg.h"
#include "camber/export/plan_frame.h"
#include "camber/import/formats/trajectory.h"
#include "camber/scene/scene.h"
#include "export_program.h"
#include "scene/write_image.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Eigen::Vector3d;
using nlohmann::json;
using test::run_camber;
using ::testing::HasSubstr;

/// A result that lies on the map: on the middle meridian of zone 32, turned by 0.5 rad.
class OnTheMap : public test::ExportProgram {
 protected:
  void SetUp() override {
    ExportProgram::SetUp();
    const PlanFrame plan(surface_.up);
    map_ = SE3(Eigen::Matrix3d(Eigen::AngleAxisd(0.5, Vector3d::UnitZ()) * plan.plan_from_surface),
               Vector3d(500000.0, 5427000.0, 250.0));
    RunDocument run;
    run.cameras = {{4, SE3()}, {5, SE3(Eigen::Quaterniond::Identity(), {0.0, 0.0, 1.5})}};
    json matrix = json::array();
    for (int i = 0; i < 16; ++i) matrix.push_back(map_.matrix()(i / 4, i % 4));
    run.extra["georeference"] = {{"status", "ok"},        {"reason", ""},
                                 {"crs", "EPSG:32632"},   {"level", "camera"},
                                 {"positions", 2},        {"heading_sigma_deg", 0.5},
                                 {"residual_rms", 0.1},   {"map_from_reference", matrix},
                                 {"position_sigma", 0.5}, {"height_sigma", 0.8}};
    write_json(to_json(run), folder_.path() / "run.json");
  }
  SE3 map_;
};

TEST_F(OnTheMap, RoadsAreInMapCoordinates) {
  const auto result =
      run_camber({"export", file("surface.json"), "--to", "opencrg", "--out", file("road.crg")});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const CrgRoad road(read_crg(file("road.crg")));
  const SE3 back = map_.inverse();
  std::size_t known = 0;
  for (std::size_t i = 0; i < road.sections(); i += 3) {
    for (std::size_t j = 0; j < road.v().size(); j += 2) {
      if (std::isnan(road.node(i, j))) continue;
      ++known;
      const Eigen::Vector2d place =
          road.position(static_cast<double>(i) * road.increment(), road.v()[j]);
      const SurfaceQuery truth = surface_.query(back * Vector3d(place.x(), place.y(), 250.0), 0.6);
      EXPECT_NEAR(road.node(i, j), (map_ * truth.point).z(), 1e-3);  // the file's digits
    }
  }
  EXPECT_GT(known, 500u);
  const auto drive = run_camber(
      {"export", file("surface.json"), "--to", "opendrive", "--out", file("road.xodr"), "--json"});
  ASSERT_EQ(drive.exit_code, 0) << drive.error;
  EXPECT_EQ(json::parse(drive.out)["geo_reference"], "EPSG:32632");
  EXPECT_THAT(test::read_text(file("road.xodr")), HasSubstr("+proj=utm +zone=32"));
  EXPECT_ONE_SENTENCE(run_camber({"export", file("surface.json"), "--to", "opendrive", "--crs",
                                  "EPSG:25832", "--out", file("other.xodr")}),
                      2, "the map of EPSG:32632");
}

TEST_F(OnTheMap, TrajectoriesToo) {
  const std::string folder = folder_.path().string();
  ASSERT_EQ(
      run_camber({"export", folder, "--to", "trajectory", "--out", file("cameras.csv")}).exit_code,
      0);
  EXPECT_THAT(test::read_text(file("cameras.csv")),
              HasSubstr("4,4.000000,500000.000000000,5427000.000000000,250.000000000"));
  ASSERT_EQ(
      run_camber({"export", folder, "--to", "trajectory", "--out", file("cameras.gpx")}).exit_code,
      0);
  const GeoLog log = read_geo_log(file("cameras.gpx"));
  ASSERT_EQ(log.segments.size(), 1u);
  ASSERT_EQ(log.segments[0].size(), 2u);
  EXPECT_NEAR(log.segments[0][0].longitude, 9.0, 1e-8);  // a millimetre
  EXPECT_NEAR(log.segments[0][0].latitude, 48.9959, 0.0001);
  EXPECT_NEAR(log.segments[0][0].altitude, 250.0, 1e-4);
  EXPECT_NEAR(great_circle_distance(log.segments[0][0], log.segments[0][1]), 1.5, 0.01);
  fs::remove(folder_.path() / "run.json");
  RunDocument nowhere;
  nowhere.cameras = {{4, SE3()}};
  write_json(to_json(nowhere), folder_.path() / "run.json");
  EXPECT_ONE_SENTENCE(run_camber({"export", folder, "--to", "trajectory", "--out", file("no.gpx")}),
                      1, "--gnss");
}

TEST_F(OnTheMap, CloudsBecomeSurveyClouds) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kCamera;
  for (int i = 0; i < 50; ++i) {
    cloud.points.emplace_back(0.1f * static_cast<float>(i), 1.5f, 10.0f + static_cast<float>(i));
    cloud.colors.push_back({10, 20, static_cast<std::uint8_t>(i)});
    cloud.labels["patch"].push_back(i % 3);
  }
  write_cloud(cloud, file("road.ply"));
  for (const std::string kind : {"las", "ply"}) {
    const auto result =
        run_camber({"convert", file("road.ply"), "--to-map", "--out", file("map." + kind)});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    const CloudFile back = read_cloud_file(file("map." + kind));
    ASSERT_TRUE(back.report.crs);
    EXPECT_EQ(back.report.crs->epsg, 32632);
    ASSERT_EQ(back.cloud.size(), cloud.size());
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Vector3d place = back.cloud.origin + back.cloud.points[i].cast<double>();
      EXPECT_LT((place - map_ * cloud.points[i].cast<double>()).norm(), 2e-3);  // LAS's millimetres
    }
    EXPECT_EQ(back.cloud.colors[7][2], 7);
    EXPECT_EQ(back.cloud.labels.at("patch")[7], 1);
  }
  EXPECT_ONE_SENTENCE(
      run_camber({"convert", file("map.ply"), "--to-map", "--out", file("twice.las")}), 2,
      "camera's frame");
  fs::remove(folder_.path() / "run.json");
  EXPECT_ONE_SENTENCE(
      run_camber({"convert", file("road.ply"), "--to-map", "--out", file("lost.las")}), 1,
      "run.json");
}

TEST_F(OnTheMap, ImportsTakePositions) {
  for (int i = 0; i < 3; ++i) {
    test::write_png(folder_.path() / ("im_" + std::to_string(i) + ".png"), 64, 48, 2, 8,
                    test::picture(64, 48, 3));
  }
  std::ofstream(file("fixes.csv")) << "frame,latitude,longitude,altitude\n"
                                      "0,49,9,100\n1,49,9.00002,100.5\n2,49,9.00004,101\n";
  const std::vector<std::string> command = {"import",          "images", file("im_*.png"),
                                            "--fov",           "60",     "--gnss",
                                            file("fixes.csv"), "--out",  file("scene.json")};
  auto told = command;
  told.insert(told.end(), {"--antenna", "0,-0.4,-1", "--json"});
  const auto result = run_camber(told);
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_EQ(json::parse(result.out)["positions"], 3);
  const Scene scene = read_scene(file("scene.json"));
  EXPECT_EQ(scene.map_crs, "EPSG:32632");
  EXPECT_EQ(scene.antenna, Vector3d(0, -0.4, -1));
  // PROJ's own programs give 500000 and 5427455.7812 for 49 N, 9 E.
  const Vector3d first = scene.frames[0].map_position->position;
  EXPECT_NEAR(first.x(), 500000.0, 1e-4);
  EXPECT_NEAR(first.y(), 5427455.7812, 1e-3);
  EXPECT_NEAR(scene.frames[2].map_position->position.x() - first.x(), 2.926, 0.01);
  auto other = command;
  other.insert(other.end(), {"--crs", "EPSG:25833"});
  ASSERT_EQ(run_camber(other).exit_code, 0);
  EXPECT_EQ(read_scene(file("scene.json")).map_crs, "EPSG:25833");
  EXPECT_LT(read_scene(file("scene.json")).frames[0].map_position->position.x(), 100000.0);
  for (const char* const crs : {"EPSG:4326", "EPSG:2230", "EPSG:5783", "no such thing", "hill"}) {
    auto wrong = command;
    wrong.insert(wrong.end(), {"--crs", crs});
    EXPECT_ONE_SENTENCE(run_camber(wrong), 2, "--crs");
  }
  // On the web's map a metre in 49 degrees north is one and a half.
  auto stretched = command;
  stretched.insert(stretched.end(), {"--crs", "EPSG:3857"});
  EXPECT_ONE_SENTENCE(run_camber(stretched), 2, "a metre of ground is 1.53 m on the map");
}

}  // namespace
}  // namespace camber
