#include "camber/scene/results.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/core/version.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/surface_file.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr double kPi = 3.14159265358979323846;

PlanePatch make_patch() {
  PlanePatch patch;
  patch.id = 3;
  patch.kind = PatchKind::kPavement;
  patch.status = Status::kWeak;
  patch.reason = "few points";
  patch.plane.plane.normal = Eigen::Vector3d(0.1, -0.98, 0.15).normalized();
  patch.plane.plane.offset = -0.25;
  patch.plane.centroid = {1, 2, 30};
  UncertainPlane::make_axes(patch.plane.plane.normal, {0, 0, 1}, &patch.plane.axis1,
                            &patch.plane.axis2);
  patch.plane.covariance << 1e-4, 2e-5, 3e-6, 2e-5, 4e-4, 5e-6, 3e-6, 5e-6, 9e-3;
  patch.inliers = 812;
  patch.boundary = {{0, 1, 2}, {1, 1, 2}, {0.5, 1, 3}};
  patch.grade = kPi / 18;  // 10 degrees
  patch.bank = -kPi / 36;  // -5 degrees
  patch.refinement = "refused: no texture";
  patch.unmodelled_sigma = 0.021;
  return patch;
}

RoadSurface make_surface() {
  RoadSurface surface;
  surface.metric = false;
  surface.scale_sigma = 0.0125;
  surface.ego_patch = 3;
  surface.patches.push_back(make_patch());
  PlanePatch failed;
  failed.id = 4;
  failed.status = Status::kFailed;
  failed.reason = "collinear points";
  failed.plane.plane.normal.setConstant(std::numeric_limits<double>::quiet_NaN());
  failed.plane.plane.offset = std::numeric_limits<double>::infinity();
  surface.patches.push_back(failed);
  surface.links.push_back({3, 4, false, "step of 0.2 m", 0.5, 1.5, 0.2, kPi / 4});
  surface.driven_line = {{0, 1.65, 0}, {0, 1.6, 0.7}};
  return surface;
}

VehicleDocument make_vehicles() {
  VehicleEstimate vehicle;
  vehicle.id = 5;
  vehicle.vehicle_class = "van";
  vehicle.box = {10, 20, 30, 45.5};
  vehicle.status = Status::kOk;
  vehicle.pose.camera_from_vehicle = SE3(rotation_from_rotation_y(0.7), {1, 1.5, 12});
  vehicle.pose.dimensions = {4.5, 1.9, 2.1};
  for (int i = 0; i < kNumKeypoints; ++i) vehicle.keypoints[i] = {0.1 * i, 1, 12};
  vehicle.plane = {Eigen::Vector3d(0, -1, 0), 1.5};
  vehicle.plane_sigma_height = 0.04;
  vehicle.plane_source = "patch 3";
  vehicle.shape = {0.5, -0.25};
  for (int r = 0; r < 9; ++r) {
    for (int c = 0; c < 9; ++c) vehicle.covariance(r, c) = 1.0 / (1 + r + c);
  }
  vehicle.reprojection_rmse_px = 1.25;
  VehicleEstimate failed;
  failed.id = 6;
  failed.status = Status::kFailed;
  failed.reason = "plane behind the camera";
  failed.pose.camera_from_vehicle.set_translation(
      Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  failed.pose.dimensions.length = std::numeric_limits<double>::infinity();
  VehicleDocument document;
  document.method = "joint";
  document.detections_source = "network";
  document.frames.push_back({49, {vehicle, failed}});
  document.frames.push_back({50, {}});
  return document;
}

RunDocument make_run() {
  RunDocument run;
  run.seed = 18446744073709551615ull;  // does not fit a double
  *run.options = {{"method", "joint"}, {"frames", "48:50"}};
  run.timings.add("load", 12.5);
  run.timings.add("motion", 100);
  run.cameras.push_back({48, SE3(rotation_from_vector({0, 0.1, 0}), {0, 0, -0.64})});
  run.cameras.push_back({49, SE3()});
  run.scale = 0.64;
  run.scale_sigma = 0.01;
  run.points_kept = {{"road", 12000}};
  run.points_dropped = {{"near the focus of expansion", 77}};
  run.gl_backend = "EGL surfaceless";
  run.input_hashes = {{"scene.json", "00ff"}};
  run.extra["reference_frame"] = 49;
  return run;
}

std::string slurp(const fs::path& path) {
  std::ostringstream out;
  out << std::ifstream(path, std::ios::binary).rdbuf();
  return out.str();
}

TEST(SurfaceJson, HasTheDocumentedKeysAndUnits) {
  const json surface = to_json(make_surface());
  EXPECT_EQ(surface["frame"], "camera");
  EXPECT_EQ(surface["metric"], false);
  EXPECT_EQ(surface["scale_sigma"], 0.0125);
  EXPECT_EQ(surface["up"], json({0.0, -1.0, 0.0}));
  EXPECT_EQ(surface["driven_line"].size(), 2u);
  const json& patch = surface["patches"][0];
  EXPECT_EQ(patch["kind"], "pavement");
  EXPECT_EQ(patch["status"], "weak");
  EXPECT_EQ(patch["reason"], "few points");
  EXPECT_NEAR(patch["grade_deg"].get<double>(), 10.0, 1e-12);
  EXPECT_NEAR(patch["bank_deg"].get<double>(), -5.0, 1e-12);
  EXPECT_EQ(patch["covariance"].size(), 9u);
  EXPECT_EQ(patch["covariance"][5], 5e-6);
  EXPECT_EQ(patch["boundary"][2], json({0.5, 1.0, 3.0}));
  EXPECT_EQ(patch["inliers"], 812);
  EXPECT_EQ(patch["refinement"], "refused: no texture");
  EXPECT_EQ(patch["unmodelled_sigma"], 0.021);
  const json& link = surface["links"][0];
  EXPECT_NEAR(link["angle_deg"].get<double>(), 45.0, 1e-12);
  EXPECT_EQ(link["height_step"], 0.2);
  EXPECT_EQ(link["valid"], false);
  // What is not finite is null.
  EXPECT_EQ(surface["patches"][1]["normal"], json({nullptr, nullptr, nullptr}));
  EXPECT_EQ(surface["patches"][1]["offset"], nullptr);
}

TEST(SurfaceJson, IsWrittenPieceByPieceAsWhole) {
  const test::TemporaryFolder folder;
  RoadSurface without = make_surface();
  without.patches.clear();
  without.links.clear();
  RoadSurface many = make_surface();
  many.patches.resize(2500, many.patches.front());
  many.links.resize(1001, many.links.front());
  for (const RoadSurface& surface : {make_surface(), without, many}) {
    write_surface(surface, folder.path() / "surface.json");
    // Not EXPECT_EQ, which would look for the least difference of megabytes.
    EXPECT_TRUE(test::read_text(folder.path() / "surface.json") == format_json(to_json(surface)));
  }
}

TEST(SurfaceJson, SurvivesWritingAndReading) {
  const test::TemporaryFolder folder;
  const RoadSurface surface = make_surface();
  write_surface(surface, folder.path() / "surface.json");
  const RoadSurface read = read_surface(folder.path() / "surface.json");
  ASSERT_EQ(read.patches.size(), 2u);
  EXPECT_EQ(read.patches[0].plane.plane.normal, surface.patches[0].plane.plane.normal);
  EXPECT_EQ(read.patches[0].plane.plane.offset, -0.25);
  EXPECT_EQ(read.patches[0].plane.covariance, surface.patches[0].plane.covariance);
  EXPECT_EQ(read.patches[0].plane.axis1, surface.patches[0].plane.axis1);
  EXPECT_EQ(read.patches[0].status, Status::kWeak);
  EXPECT_NEAR(read.patches[0].grade, surface.patches[0].grade, 1e-15);
  EXPECT_EQ(read.patches[1].status, Status::kFailed);
  EXPECT_TRUE(std::isnan(read.patches[1].plane.plane.offset));
  EXPECT_NEAR(read.links[0].angle, kPi / 4, 1e-15);
  EXPECT_EQ(read.ego_patch, 3);
  EXPECT_FALSE(read.metric);
  // Degrees are rounded once; after that nothing changes any more.
  write_json(to_json(read), folder.path() / "again.json");
  write_json(to_json(read_surface(folder.path() / "again.json")), folder.path() / "third.json");
  EXPECT_EQ(slurp(folder.path() / "again.json"), slurp(folder.path() / "third.json"));
}

TEST(VehiclesJson, HasTheDocumentedKeys) {
  const json document = to_json(make_vehicles());
  EXPECT_EQ(document["method"], "joint");
  EXPECT_EQ(document["detections_source"], "network");
  EXPECT_EQ(document["metric"], true);
  ASSERT_EQ(document["frames"].size(), 2u);
  const json& vehicle = document["frames"][0]["vehicles"][0];
  EXPECT_EQ(vehicle["class"], "van");
  EXPECT_EQ(vehicle["box"], json({10.0, 20.0, 30.0, 45.5}));
  EXPECT_NEAR(vehicle["rotation_y"].get<double>(), 0.7, 1e-12);
  // The vehicle stands upright: its middle is half its height above the bottom, towards -y.
  EXPECT_NEAR(vehicle["center"][1].get<double>(), 1.5 - 1.05, 1e-12);
  EXPECT_EQ(vehicle["bottom_center"], json({1.0, 1.5, 12.0}));
  EXPECT_EQ(vehicle["dimensions"]["height"], 2.1);
  EXPECT_EQ(vehicle["keypoints"].size(), 36u);
  EXPECT_EQ(vehicle["plane"]["source"], "patch 3");
  EXPECT_EQ(vehicle["plane"]["sigma_height"], 0.04);
  EXPECT_EQ(vehicle["covariance"].size(), 81u);
  EXPECT_EQ(vehicle["covariance"][9 + 2], 0.25);  // row 1, column 2
  EXPECT_EQ(vehicle["shape"], json({0.5, -0.25}));
  EXPECT_EQ(vehicle["reprojection_rmse_px"], 1.25);
  EXPECT_EQ(vehicle["status"], "ok");
  const json& failed = document["frames"][0]["vehicles"][1];
  EXPECT_EQ(failed["bottom_center"], json({nullptr, nullptr, nullptr}));
  EXPECT_EQ(failed["dimensions"]["length"], nullptr);
  EXPECT_EQ(failed["reprojection_rmse_px"], nullptr);
}

TEST(VehiclesJson, SurvivesWritingAndReading) {
  const test::TemporaryFolder folder;
  const VehicleDocument document = make_vehicles();
  write_json(to_json(document), folder.path() / "vehicles.json");
  const VehicleDocument read = read_vehicles(folder.path() / "vehicles.json");
  ASSERT_EQ(read.frames.size(), 2u);
  EXPECT_EQ(read.frames[0].id, 49);
  const VehicleEstimate& a = document.frames[0].vehicles[0];
  const VehicleEstimate& b = read.frames[0].vehicles[0];
  EXPECT_TRUE(
      a.pose.camera_from_vehicle.matrix().isApprox(b.pose.camera_from_vehicle.matrix(), 1e-14));
  EXPECT_EQ(a.covariance, b.covariance);
  EXPECT_EQ(a.keypoints[35], b.keypoints[35]);
  EXPECT_EQ(a.shape, b.shape);
  EXPECT_EQ(b.plane_source, "patch 3");
  EXPECT_EQ(b.plane_sigma_height, 0.04);
  EXPECT_EQ(b.box.y2, 45.5);
  EXPECT_EQ(read.frames[0].vehicles[1].status, Status::kFailed);
  EXPECT_EQ(read.frames[0].vehicles[1].reason, "plane behind the camera");
  EXPECT_TRUE(std::isnan(read.frames[0].vehicles[1].pose.bottom_center().x()));
}

TEST(RunJson, SurvivesWritingAndReading) {
  const test::TemporaryFolder folder;
  const RunDocument run = make_run();
  write_json(to_json(run), folder.path() / "run.json");
  const json document = json::parse(slurp(folder.path() / "run.json"));
  EXPECT_EQ(document["version"], kVersion);
  EXPECT_EQ(document["timings_ms"], json({{"load", 12.5}, {"motion", 100.0}}));
  EXPECT_EQ(document["cameras"][0]["reference_from_camera"][11], -0.64);
  EXPECT_EQ(document["reference_frame"], 49);
  const RunDocument read = read_run(folder.path() / "run.json");
  EXPECT_EQ(read.seed, run.seed);
  EXPECT_EQ(*read.options, *run.options);
  EXPECT_EQ(*read.extra, *run.extra);
  EXPECT_EQ(read.points_kept, run.points_kept);
  EXPECT_EQ(read.points_dropped, run.points_dropped);
  EXPECT_EQ(read.input_hashes, run.input_hashes);
  EXPECT_EQ(read.scale, 0.64);
  EXPECT_TRUE(read.cameras[0].reference_from_camera.matrix().isApprox(
      run.cameras[0].reference_from_camera.matrix(), 1e-14));
}

std::string error_of(const std::string& text, const std::function<void(const fs::path&)>& read) {
  const test::TemporaryFolder folder;
  const fs::path path = folder.path() / "file.json";
  std::ofstream(path) << text;
  try {
    read(path);
  } catch (const InputError& error) {
    return std::string(error.what()).substr(path.string().size() + 2);
  }
  return "no error";
}

TEST(ResultReaders, NameThePlaceOfAnError) {
  json surface = to_json(make_surface());
  surface["patches"][0]["normal"] = {0, -2, 0};
  EXPECT_EQ(error_of(surface.dump(), [](const fs::path& p) { read_surface(p); }),
            "patches[0].normal: found a vector of length 2, expected a unit vector (within 0.001)");
  surface = to_json(make_surface());
  surface["patches"][0]["status"] = "fine";
  EXPECT_EQ(error_of(surface.dump(), [](const fs::path& p) { read_surface(p); }),
            "patches[0].status: found \"fine\", expected \"ok\", \"weak\", \"not_observable\", "
            "\"failed\" or \"not_run\"");
  json vehicles = to_json(make_vehicles());
  vehicles["frames"][0]["vehicles"][0]["bottom_center"][2] = nullptr;
  EXPECT_EQ(error_of(vehicles.dump(), [](const fs::path& p) { read_vehicles(p); }),
            "frames[0].vehicles[0].bottom_center[2]: found null, expected a number");
  vehicles = to_json(make_vehicles());
  vehicles["frames"][0]["vehicles"][0]["covariance"].erase(0);
  EXPECT_EQ(error_of(vehicles.dump(), [](const fs::path& p) { read_vehicles(p); }),
            "frames[0].vehicles[0].covariance: found 80 numbers, expected 81 numbers");
  json run = to_json(make_run());
  run["cameras"][0]["reference_from_camera"][0] = 3;
  EXPECT_THAT(error_of(run.dump(), [](const fs::path& p) { read_run(p); }),
              HasSubstr("cameras[0].reference_from_camera: found a matrix whose 3 x 3 part is no "
                        "rotation"));
  EXPECT_THAT(error_of("{\"seed\": -1}", [](const fs::path& p) { read_run(p); }),
              HasSubstr("seed: found -1, expected an integer of at least 0"));
}

TEST(ResultReaders, IdsStandOnceAndVariancesAreNotNegative) {
  const auto surface_error = [](const json& surface) {
    return error_of(surface.dump(), [](const fs::path& p) { read_surface(p); });
  };
  const auto vehicles_error = [](const json& vehicles) {
    return error_of(vehicles.dump(), [](const fs::path& p) { read_vehicles(p); });
  };
  const json surface = to_json(make_surface()), vehicles = to_json(make_vehicles());
  json changed = surface;
  changed["patches"].push_back(surface["patches"][0]);
  EXPECT_THAT(surface_error(changed), HasSubstr("a second time, expected ids that differ among the "
                                                "patches"));
  changed = surface;
  changed["patches"][0]["covariance"][4] = -1e-9;
  EXPECT_EQ(surface_error(changed),
            "patches[0].covariance: found the variance -1e-09, expected numbers of at least 0 on "
            "the diagonal");
  changed = vehicles;
  changed["frames"].push_back(vehicles["frames"][0]);
  EXPECT_THAT(vehicles_error(changed), HasSubstr("expected ids that differ among the frames"));
  changed = vehicles;
  json& list = changed["frames"][0]["vehicles"];
  list.push_back(vehicles["frames"][0]["vehicles"][0]);
  EXPECT_THAT(vehicles_error(changed),
              HasSubstr("expected ids that differ among the vehicles of a frame"));
  changed = vehicles;
  changed["frames"][0]["vehicles"][0]["covariance"][80] = -1;
  EXPECT_THAT(vehicles_error(changed), HasSubstr("covariance: found the variance -1"));
  json run = to_json(make_run());
  run["cameras"].push_back(run["cameras"][0]);
  EXPECT_THAT(error_of(run.dump(), [](const fs::path& p) { read_run(p); }),
              HasSubstr("expected ids that differ among the cameras"));
}

TEST(VehiclesJson, WithoutAnAnswerThereAreNoKeypoints) {
  VehicleDocument document;
  document.frames.push_back({0, {VehicleEstimate()}});
  const json out = to_json(document);
  for (const json& row : out["frames"][0]["vehicles"][0]["keypoints"]) {
    EXPECT_EQ(row, json({nullptr, nullptr, nullptr}));
  }
}

TEST(ResultReaders, AnyCutOfAFileIsAnInputError) {
  const std::string texts[3] = {to_json(make_surface()).dump(), to_json(make_vehicles()).dump(),
                                to_json(make_run()).dump()};
  for (const std::string& text : texts) {
    for (std::size_t length = 0; length < text.size(); length += 13) {
      const std::string cut = text.substr(0, length);
      EXPECT_NE(error_of(cut, [](const fs::path& p) { read_surface(p); }), "no error");
      EXPECT_NE(error_of(cut, [](const fs::path& p) { read_vehicles(p); }), "no error");
      EXPECT_NE(error_of(cut, [](const fs::path& p) { read_run(p); }), "no error");
    }
  }
}

}  // namespace
}  // namespace camber
