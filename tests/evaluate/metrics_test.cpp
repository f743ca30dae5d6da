#include "camber/evaluate/metrics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/evaluate/tables.h"
#include "support/test_data.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

TruthVehicle make_truth(int id, const Box2& box, const Eigen::Vector3d& bottom) {
  TruthVehicle out;
  out.id = id;
  out.box = box;
  out.pose.camera_from_vehicle = SE3(rotation_from_rotation_y(-kPi / 2), bottom);
  out.pose.dimensions = {4.0, 1.7, 1.5};
  out.plane = Plane::through(bottom, Eigen::Vector3d(0.0, -1.0, 0.0));
  return out;
}

VehicleEstimate make_estimate(int id, const TruthVehicle& truth, const Eigen::Vector3d& shift) {
  VehicleEstimate out;
  out.id = id;
  out.box = truth.box;
  out.status = Status::kOk;
  out.pose = truth.pose;
  out.pose.camera_from_vehicle.set_translation(truth.pose.bottom_center() + shift);
  out.plane = Plane::through(out.pose.bottom_center(), Eigen::Vector3d(0.0, -1.0, 0.0));
  out.plane_sigma_height = 0.1;
  out.covariance = 0.04 * Eigen::Matrix<double, 9, 9>::Identity();
  return out;
}

Scene make_scene(std::vector<TruthVehicle> vehicles) {
  Scene scene;
  scene.name = "made";
  scene.camera = {1242, 375, 720.0, 720.0, 620.5, 187.0};
  scene.frames.emplace_back();
  scene.frames[0].id = 4;
  scene.truth.emplace();
  scene.truth->frames.emplace_back();
  scene.truth->frames[0].id = 4;
  scene.truth->frames[0].vehicles = std::move(vehicles);
  return scene;
}

VehicleDocument make_document(std::vector<VehicleEstimate> estimates) {
  VehicleDocument out;
  out.method = "joint";
  out.detections_source = "network";
  out.frames.push_back({4, std::move(estimates)});
  return out;
}

const Box2 kNear{600.0, 180.0, 700.0, 260.0}, kFar{300.0, 180.0, 340.0, 210.0};

TEST(IsCounted, FollowsTheRules) {
  PinholeCamera camera{1242, 375, 720.0, 720.0, 620.0, 187.0};
  TruthVehicle v = make_truth(1, {10, 10, 30, 24}, {0, 1.6, 20});
  EXPECT_TRUE(is_counted(v, camera));
  v.box.y2 = 23.9;
  EXPECT_FALSE(is_counted(v, camera));
  camera.width = 960;
  EXPECT_TRUE(is_counted(v, camera));
  v.box.y2 = 18.9;
  EXPECT_FALSE(is_counted(v, camera));
  v.box.y2 = 60.0;
  v.occlusion = 0.7;
  v.truncation = 0.5;
  EXPECT_TRUE(is_counted(v, camera));
  v.occlusion = 0.71;
  EXPECT_FALSE(is_counted(v, camera));
  v.occlusion = 0.0;
  v.truncation = 0.51;
  EXPECT_FALSE(is_counted(v, camera));
}

TEST(MatchVehicles, TakesTheBestOverlapFirstAndEachOnce) {
  const PinholeCamera camera{1242, 375, 720.0, 720.0, 620.0, 187.0};
  const std::vector<TruthVehicle> truth{make_truth(1, {100, 100, 200, 200}, {0, 1.6, 10}),
                                        make_truth(2, {130, 100, 230, 200}, {0, 1.6, 12}),
                                        make_truth(3, {-40, 100, 100, 200}, {-5, 1.6, 10})};
  std::vector<VehicleEstimate> estimates(3);
  estimates[0].box = {120, 100, 220, 200};  // nearer to truth 2 (IoU 0.82) than to truth 1 (0.67)
  estimates[1].box = {120, 100, 220, 201};
  estimates[2].box = {0, 100, 100, 200};  // the clipped box of truth 3
  const std::vector<Match> matches = match_vehicles(truth, estimates, camera);
  ASSERT_EQ(matches.size(), 3u);
  EXPECT_EQ(matches[0].truth, 2u);
  EXPECT_EQ(matches[0].estimate, 2u);
  EXPECT_DOUBLE_EQ(matches[0].overlap, 1.0);
  EXPECT_EQ(matches[1].truth, 1u);
  EXPECT_EQ(matches[1].estimate, 0u);
  EXPECT_EQ(matches[2].truth, 0u);
  EXPECT_EQ(matches[2].estimate, 1u);
}

TEST(CompareVehicle, SignsAndNumbers) {
  const TruthVehicle truth = make_truth(1, kNear, {0.0, 1.6, 12.0});
  VehicleEstimate estimate = make_estimate(5, truth, {0.3, -0.1, 0.4});
  estimate.pose.camera_from_vehicle =
      SE3(rotation_from_rotation_y(kPi - 0.1), estimate.pose.bottom_center());
  const VehicleError e = compare_vehicle(truth, estimate);
  EXPECT_NEAR(e.center_error, std::sqrt(0.09 + 0.01 + 0.16), 1e-12);
  EXPECT_NEAR(e.height_error, 0.1, 1e-12);  // the estimate's ground is 10 cm higher
  EXPECT_NEAR(e.normal_error, 0.0, 1e-7);
  // rotation_y from -90 degrees to 180 - 5.7: the short way round is -84.3 degrees.
  EXPECT_NEAR(e.yaw_error, kPi - 0.1 + kPi / 2 - 2 * kPi, 1e-9);
  EXPECT_NEAR(e.center_mahalanobis, 0.26 / 0.04, 1e-9);
  const Eigen::Vector3d ray = truth.pose.center().normalized();
  EXPECT_NEAR(e.along_error, Eigen::Vector3d(0.3, -0.1, 0.4).dot(ray), 1e-12);
  EXPECT_TRUE(std::isnan(e.keypoint_error));
  EXPECT_NEAR(e.distance, std::hypot(1.6, 12.0), 1e-12);
}

TEST(CompareVehicle, HeightOnASlopeIsAlongTheNormal) {
  TruthVehicle truth = make_truth(1, kNear, {1.0, 1.0, 15.0});
  const Eigen::Vector3d up = Eigen::Vector3d(0.05, -1.0, -0.2).normalized();
  truth.plane = Plane::through(truth.pose.bottom_center() - 0.02 * up, up);
  VehicleEstimate estimate = make_estimate(5, truth, {0, 0, 0});
  // 7 cm below the true plane, and turned about the contact point by 2 degrees.
  const Eigen::Vector3d foot = truth.plane->foot(truth.pose.bottom_center());
  const Eigen::Vector3d axis = up.cross(Eigen::Vector3d(1, 0, 0)).normalized();
  const Eigen::Vector3d turned = rotation_from_vector(axis * (2.0 * kPi / 180.0)) * up;
  estimate.plane = Plane::through(foot, turned);
  estimate.plane.offset += 0.07;  // farther from the camera: lower
  const VehicleError e = compare_vehicle(truth, estimate);
  EXPECT_NEAR(e.height_error, -0.07, 1e-12);
  EXPECT_NEAR(e.normal_error, 2.0 * kPi / 180.0, 1e-9);
}

TEST(CompareVehicle, LabelsWithoutAPlaneUseTheCamerasY) {
  TruthVehicle truth = make_truth(1, kNear, {2.0, 1.5, 15.0});
  truth.plane.reset();
  VehicleEstimate estimate = make_estimate(5, truth, {0, 0, 0});
  // A plane that climbs by 0.1: below the label's bottom it lies at y = 1.65 - 0.1 * 15 + ...
  const Eigen::Vector3d up = Eigen::Vector3d(0.0, -1.0, -0.1).normalized();
  estimate.plane = Plane::through({0.0, 3.08, 0.0}, up);  // y = 3.08 - 0.1 z: 1.58 at 15 m
  const VehicleError e = compare_vehicle(truth, estimate);
  EXPECT_NEAR(e.height_error, -0.08, 1e-12);  // 8 cm below the label
  EXPECT_TRUE(std::isnan(e.normal_error));
}

TEST(EvaluateVehicles, AZeroCovarianceIsCertaintyAndNotNone) {
  const Scene scene =
      make_scene({make_truth(1, kNear, {0.0, 1.6, 12.0}), make_truth(2, kFar, {-9.0, 1.6, 33.0}),
                  make_truth(3, {1000, 180, 1100, 260}, {6, 1.6, 12})});
  const auto& truth = scene.truth->frames[0].vehicles;
  VehicleEstimate certain = make_estimate(1, truth[0], {0, 0, 0.5});
  certain.covariance.setZero();
  VehicleEstimate silent = make_estimate(2, truth[1], {0, 0, 0.5});
  silent.covariance = VehicleEstimate().covariance;
  VehicleEstimate level = make_estimate(3, truth[2], {0.1, 0, 0.1});
  level.covariance.row(1).setZero();  // its height is stated as certain, and is right
  level.covariance.col(1).setZero();
  const VehicleDocument document = make_document({certain, silent, level});
  const SceneMetrics m = evaluate_vehicles(scene, document);
  ASSERT_EQ(m.vehicles.size(), 3u);
  const auto of = [&](int id) {
    return *std::find_if(m.vehicles.begin(), m.vehicles.end(),
                         [&](const VehicleError& e) { return e.truth_id == id; });
  };
  EXPECT_TRUE(std::isinf(of(1).center_mahalanobis));
  EXPECT_TRUE(of(1).singular_covariance);
  EXPECT_EQ(of(1).depth_sigma, 0.0);
  EXPECT_TRUE(std::isnan(of(2).center_mahalanobis));
  EXPECT_FALSE(of(2).singular_covariance);
  EXPECT_TRUE(std::isnan(of(2).depth_sigma));
  EXPECT_NEAR(of(3).center_mahalanobis, 0.02 / 0.04, 1e-9);
  EXPECT_EQ(m.without_covariance, 1);
  EXPECT_EQ(m.singular_covariance, 2);
  // One of the two that state anything is inside.
  EXPECT_EQ(to_json(m)["center_within_95"], 0.5);
  EXPECT_EQ(to_json(m)["singular_covariance"], 2);
  EXPECT_NE(describe(m).find("2 state a singular covariance"), std::string::npos) << describe(m);
  const std::vector<MethodTables> tables = make_tables({{"made", "joint", "network", m}});
  EXPECT_EQ(tables[0].rows[0].center_within_95, 0.5);
  const std::string text = tables_text(tables);
  EXPECT_NE(text.find("; 1 without a covariance; 2 with a singular covariance"), std::string::npos)
      << text;

  // A document keeps the difference.
  test::TemporaryFolder folder;
  write_json(to_json(document), folder.path() / "vehicles.json");
  const SceneMetrics again =
      evaluate_vehicles(scene, read_vehicles(folder.path() / "vehicles.json"));
  EXPECT_EQ(again.without_covariance, 1);
  EXPECT_EQ(again.singular_covariance, 2);
  nlohmann::json absent = to_json(document);
  for (auto& vehicle : absent["frames"][0]["vehicles"]) vehicle.erase("covariance");
  write_json(absent, folder.path() / "vehicles.json");
  EXPECT_EQ(
      evaluate_vehicles(scene, read_vehicles(folder.path() / "vehicles.json")).without_covariance,
      3);
}

TEST(EvaluateVehicles, CountsMissesAndUnanswered) {
  TruthVehicle hidden = make_truth(3, {800, 180, 900, 260}, {4, 1.6, 12});
  hidden.occlusion = 0.9;
  const Scene scene =
      make_scene({make_truth(1, kNear, {0.0, 1.6, 12.0}), make_truth(2, kFar, {-9.0, 1.6, 33.0}),
                  make_truth(4, {1000, 180, 1100, 260}, {6, 1.6, 12}), hidden});
  VehicleEstimate failed = make_estimate(7, scene.truth->frames[0].vehicles[1], {0, 0, 0});
  failed.status = Status::kFailed;
  VehicleEstimate doubtful = make_estimate(6, scene.truth->frames[0].vehicles[0], {0, 0, 0.5});
  doubtful.status = Status::kNotObservable;  // judged all the same
  const SceneMetrics m = evaluate_vehicles(scene, make_document({doubtful, failed}));
  EXPECT_EQ(m.counted, 3);
  EXPECT_EQ(m.missed, 1);
  EXPECT_EQ(m.unanswered, 1);
  ASSERT_EQ(m.vehicles.size(), 2u);
  EXPECT_NEAR(m.vehicles[0].center_error, 0.5, 1e-12);
  EXPECT_FALSE(m.vehicles[1].answered);
  EXPECT_TRUE(std::isnan(m.vehicles[1].center_error));
  EXPECT_THROW(evaluate_vehicles(Scene{}, {}), std::invalid_argument);
}

TEST(EvaluateVehicles, FramesWithoutResultsAreStated) {
  Scene scene = make_scene({make_truth(1, kNear, {0.0, 1.6, 12.0})});
  TruthFrame second = scene.truth->frames[0];
  second.id = 5;
  second.vehicles.push_back(make_truth(2, kFar, {-9.0, 1.6, 33.0}));
  scene.truth->frames.push_back(second);
  const SceneMetrics m =
      evaluate_vehicles(scene, make_document({make_estimate(1, second.vehicles[0], {0, 0, 0.1})}));
  EXPECT_EQ(m.counted, 1);
  EXPECT_EQ(m.unjudged, 2);
  EXPECT_EQ(to_json(m)["unjudged"], 2);
  const std::vector<MethodTables> tables = make_tables({{"made", "joint", "network", m}});
  EXPECT_NE(tables_text(tables).find("; 2 more in frames without results are not counted"),
            std::string::npos)
      << tables_text(tables);
  EXPECT_EQ(tables_json(tables)[0]["unjudged"], 2);
}

TEST(EvaluateVehicles, HeightsAreThoseOfStatedPlanesAndSigmas) {
  const Scene scene =
      make_scene({make_truth(1, kNear, {0.0, 1.6, 12.0}), make_truth(2, kFar, {-9.0, 1.6, 33.0})});
  const auto& truth = scene.truth->frames[0].vehicles;
  VehicleEstimate without_sigma = make_estimate(1, truth[0], {0, 0, 0.1});
  without_sigma.plane_sigma_height = std::numeric_limits<double>::quiet_NaN();
  nlohmann::json document =
      to_json(make_document({without_sigma, make_estimate(2, truth[1], {0, 0, 0.1})}));
  test::TemporaryFolder folder;
  const auto file = folder.path() / "vehicles.json";
  write_json(document, file);
  // The one that states a sigma is inside.
  EXPECT_EQ(to_json(evaluate_vehicles(
                scene, read_vehicles(file)))["by_distance"]["all"]["height_within_95"],
            1.0);
  document["frames"][0]["vehicles"][1].erase("plane");
  write_json(document, file);
  const VehicleDocument read = read_vehicles(file);
  const SceneMetrics m = evaluate_vehicles(scene, read);
  ASSERT_EQ(m.vehicles.size(), 2u);
  const nlohmann::json all = to_json(m)["by_distance"]["all"];
  EXPECT_EQ(all["height_error"]["count"], 1);
  EXPECT_EQ(all["normal_error_deg"]["count"], 1);
  EXPECT_EQ(all["center_error"]["count"], 2);
  EXPECT_TRUE(all["height_within_95"].is_null());
  // What is written again can be read.
  write_json(to_json(read), file);
  EXPECT_TRUE(std::isnan(read_vehicles(file).frames[0].vehicles[1].plane.offset));
}

TEST(EvaluateScene, CountsCoverageAndMotion) {
  Scene scene =
      make_scene({make_truth(1, kNear, {0.0, 1.6, 12.0}), make_truth(2, kFar, {-9.0, 1.6, 33.0}),
                  make_truth(5, {400, 180, 430, 200}, {-9.0, 1.6, 60.0})});
  scene.truth->frames[0].world_from_camera = SE3();
  scene.truth->frames[0].ego_plane = Plane{{0, -1, 0}, 1.6};
  TruthFrame second;
  second.id = 5;
  second.world_from_camera = SE3(Eigen::Matrix3d::Identity().eval(), Eigen::Vector3d(0, 0, 1.0));
  scene.truth->frames.push_back(second);
  RoadSurface surface;
  PlanePatch patch;
  patch.plane.plane = {{0, -1, 0}, 1.63};
  patch.status = Status::kOk;
  patch.boundary = {{-4, 1.63, 3}, {4, 1.63, 3}, {4, 1.63, 20}, {-4, 1.63, 20}};
  surface.patches = {patch};
  surface.ego_patch = 0;
  RunDocument run;
  run.cameras = {{4, SE3()},
                 {5, SE3(Eigen::Matrix3d::Identity().eval(), Eigen::Vector3d(0, 0, 1.02))}};
  const SceneMetrics m = evaluate_scene(scene, surface, make_document({}), run);
  EXPECT_EQ(m.within_40, 2);
  EXPECT_EQ(m.covered_within_40, 1);
  EXPECT_NEAR(m.scale_error, 0.02, 1e-12);
  EXPECT_NEAR(m.direction_error, 0.0, 1e-9);
  EXPECT_NEAR(m.ego_height_error, -0.03, 1e-12);
  EXPECT_EQ(m.missed, 3);
}

TEST(Summarise, QuantilesByHand) {
  const ErrorSummary s = summarise({4.0, 1.0, 3.0, 2.0});
  EXPECT_EQ(s.count, 4);
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.median, 2.5);
  EXPECT_NEAR(s.p90, 3.7, 1e-12);
  EXPECT_NEAR(s.deviation, std::sqrt(5.0 / 3.0), 1e-12);
  EXPECT_TRUE(std::isnan(summarise({}).mean));
}

std::vector<EvaluatedScene> two_methods() {
  const Scene scene =
      make_scene({make_truth(1, kNear, {0.0, 1.6, 12.0}), make_truth(2, kFar, {-9.0, 1.6, 33.0})});
  const auto& truth = scene.truth->frames[0].vehicles;
  EvaluatedScene joint{
      "made", "joint", "network",
      evaluate_vehicles(scene, make_document({make_estimate(1, truth[0], {0, 0, 0.2}),
                                              make_estimate(2, truth[1], {0, 0, 1.0})}))};
  VehicleEstimate failed = make_estimate(2, truth[1], {0, 0, 0});
  failed.status = Status::kFailed;
  EvaluatedScene flat{
      "made", "flat", "truth_boxes",
      evaluate_vehicles(scene, make_document({make_estimate(1, truth[0], {0, 0, 2.0}), failed}))};
  return {joint, flat};
}

TEST(Tables, RowsByDistanceAndMethod) {
  const std::vector<MethodTables> tables = make_tables(two_methods(), {{"made", 4, 2}});
  ASSERT_EQ(tables.size(), 2u);
  EXPECT_EQ(tables[0].method, "joint");
  EXPECT_DOUBLE_EQ(tables[0].recall, 1.0);
  ASSERT_EQ(tables[0].rows.size(), 6u);
  EXPECT_NEAR(tables[0].rows[0].center.mean, 0.6, 1e-12);
  EXPECT_NEAR(tables[0].rows[1].center.mean, 0.2, 1e-12);  // <= 15 m
  EXPECT_NEAR(tables[0].rows[2].center.mean, 1.0, 1e-12);  // > 15 m
  EXPECT_NEAR(tables[0].rows[3].center.mean, 0.2, 1e-12);  // <= 30 m
  EXPECT_NEAR(tables[0].rows[4].center.mean, 1.0, 1e-12);  // > 30 m
  EXPECT_EQ(tables[0].rows[5].name, "subset");
  EXPECT_NEAR(tables[0].rows[5].center.mean, 1.0, 1e-12);
  // 0.2 m at sigma 0.2 m is inside the ellipsoid, 1.0 m is not.
  EXPECT_NEAR(tables[0].rows[0].center_within_95, 0.5, 1e-12);
  EXPECT_EQ(tables[1].unanswered, 1);
  EXPECT_DOUBLE_EQ(tables[1].recall, 0.5);
  EXPECT_EQ(tables[1].detections_sources, std::vector<std::string>{"truth_boxes"});
}

TEST(Tables, TextMarkdownAndCsvSayWhatCounts) {
  const std::vector<EvaluatedScene> scenes = two_methods();
  const std::vector<MethodTables> tables = make_tables(scenes);
  const std::string text = tables_text(tables);
  EXPECT_NE(text.find("joint: 1 scenes, 2 vehicles counted, 2 found, recall 100.0 %"),
            std::string::npos)
      << text;
  EXPECT_NE(text.find("MARKED: 50.0 % of the detections are unanswered"), std::string::npos);
  EXPECT_NE(text.find("detections: truth_boxes"), std::string::npos);
  const std::string markdown = tables_markdown(tables);
  EXPECT_NE(markdown.find("| <= 15 m | 1 | 0.200 (-) | 0.200 |"), std::string::npos) << markdown;
  const std::string csv = vehicles_csv(scenes);
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 5);
  EXPECT_NE(csv.find("made,flat,truth_boxes,4,2,2,failed,"), std::string::npos) << csv;
  const nlohmann::json json = tables_json(tables);
  EXPECT_EQ(json[1]["marked"], true);
  EXPECT_TRUE(json[1]["rows"][4]["center_error"]["mean"].is_null());
}

TEST(Tables, FieldsWithCommasAreQuoted) {
  std::vector<EvaluatedScene> scenes = two_methods();
  scenes[0].scene = "a \"steep\" road, wet";
  scenes[0].detections_source = "truth_boxes, keypoints shipped:12";
  const std::string csv = vehicles_csv(scenes);
  EXPECT_NE(csv.find("\n\"a \"\"steep\"\" road, wet\",joint,"
                     "\"truth_boxes, keypoints shipped:12\",4,1,1,ok,"),
            std::string::npos)
      << csv;
}

TEST(Tables, ResultsUpToScaleAreMarked) {
  std::vector<EvaluatedScene> scenes = two_methods();
  scenes[0].metric = false;
  const std::vector<MethodTables> tables = make_tables(scenes);
  EXPECT_NE(tables_text(tables).find("MARKED: 1 of 1 results are up to scale"), std::string::npos);
  const nlohmann::json json = tables_json(tables);
  EXPECT_EQ(json[0]["up_to_scale"], 1);
  EXPECT_EQ(json[0]["marked"], true);
  EXPECT_EQ(json[1]["up_to_scale"], 0);
}

TEST(ReadSubset, LinesAndErrors) {
  test::TemporaryFolder folder;
  const auto path = folder.path() / "subset.txt";
  std::ofstream(path) << "# steep ones\ndev_00\ndev_01 2\ndev_02 2 5  # the far one\n";
  const auto subset = read_subset(path);
  ASSERT_EQ(subset.size(), 3u);
  EXPECT_EQ(subset[1].frame, 2);
  EXPECT_EQ(subset[1].vehicle, -1);
  EXPECT_EQ(subset[2].vehicle, 5);
  std::ofstream(path) << "dev_00 x\n";
  EXPECT_THROW(read_subset(path), InputError);
  EXPECT_THROW(read_subset(folder.path() / "none"), InputError);
}

}  // namespace
}  // namespace camber
