// The last two stages, each by itself: vehicles on a road that is known, and what is handed out.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "camber/core/errors.h"
#include "camber/pipeline/stages/assemble.h"
#include "camber/pipeline/stages/surface.h"
#include "camber/pipeline/stages/vehicles.h"
#include "camber/scale/fusion.h"
#include "camber/vehicle/shape_prior.h"
#include "camber/vehicle/support_plane.h"
#include "pipeline/made_drive.h"

namespace camber {
namespace {

using test::exact_ground;
using test::exact_photometric;
using test::exact_scaled;
using test::MadeDrive;
using test::MadeDriveOptions;
using test::make_drive;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const PinholeCamera kCamera{640, 240, 400.0, 400.0, 320.0, 90.0};

SupportPlane support(double height, const std::string& source) {
  SupportPlane out = certain_support({{0.0, -1.0, 0.0}, height}, source);
  out.plane.covariance.diagonal().setConstant(1e-4);
  return out;
}

TEST(ChooseSupports, TakesTheNearestGroundThatIsKnown) {
  std::vector<VehicleDetection> detections(3);
  for (VehicleDetection& d : detections) d.box = {300.0, 80.0, 360.0, 140.0};
  detections[1].has_plane = detections[2].has_plane = true;
  detections[1].given_plane = detections[2].given_plane = {{0.0, -1.0, 0.0}, 1.4};
  FrameGround ground;
  ground.ego = support(1.6, "ego");
  ground.local = {std::nullopt, support(1.5, "patch 3"), std::nullopt};
  const auto chosen = stages::choose_supports(kCamera, detections, ground, 1.7, {});
  ASSERT_EQ(chosen.size(), 3u);
  EXPECT_EQ(chosen[0].source, "ego");
  EXPECT_EQ(chosen[0].plane.plane.offset, 1.6);
  EXPECT_EQ(chosen[1].source, "patch 3");  // found on the images: before a given one
  EXPECT_EQ(chosen[2].source, "given");
  EXPECT_EQ(chosen[2].plane.plane.offset, 1.4);
}

TEST(ChooseSupports, WithoutAnyGroundALevelOneIsKnownAsWellAsTheHeight) {
  std::vector<VehicleDetection> detections(1);
  detections[0].box = {300.0, 80.0, 360.0, 140.0};
  const SupportPlane known = stages::choose_supports(kCamera, detections, {}, 1.7, {})[0];
  const SupportPlane unknown =
      stages::choose_supports(kCamera, detections, {}, std::nullopt, {})[0];
  EXPECT_EQ(known.source, "level");
  EXPECT_EQ(known.plane.plane.offset, 1.7);
  EXPECT_EQ(unknown.plane.plane.offset, 1.65);
  EXPECT_GT(unknown.plane.covariance(2, 2), known.plane.covariance(2, 2));
  EXPECT_GE(std::sqrt(unknown.plane.covariance(2, 2)), 0.33);
}

TEST(ChooseSupports, TheBaselinesTakeOnePlaneForCertain) {
  std::vector<VehicleDetection> detections(1);
  FrameGround ground;
  ground.ego = support(1.6, "ego");
  ground.local = {support(1.5, "patch 3")};
  stages::VehicleOptions options;
  options.method = VehicleMethod::kCoplanar;
  SupportPlane chosen = stages::choose_supports(kCamera, detections, ground, 1.7, options)[0];
  EXPECT_EQ(chosen.source, "ego");
  EXPECT_EQ(chosen.plane.plane.offset, 1.6);
  EXPECT_NEAR(std::sqrt(chosen.plane.covariance(2, 2)), kCertainSigma, 1e-12);
  options.method = VehicleMethod::kFlat;
  chosen = stages::choose_supports(kCamera, detections, ground, 1.7, options)[0];
  EXPECT_EQ(chosen.source, "level");
  EXPECT_EQ(chosen.plane.plane.offset, 1.7);
  EXPECT_NEAR(std::sqrt(chosen.plane.covariance(2, 2)), kCertainSigma, 1e-12);
}

TEST(VehicleMethods, AreNamed) {
  for (const VehicleMethod method : {VehicleMethod::kJoint, VehicleMethod::kCoplanar,
                                     VehicleMethod::kFlat, VehicleMethod::kReprojection}) {
    EXPECT_EQ(vehicle_method_from_string(to_string(method)), method);
  }
  EXPECT_THROW(vehicle_method_from_string("round"), std::invalid_argument);
}

/// A parked car of the prior's mean shape: what an image sees of it.
class ParkedCar : public ::testing::Test {
 protected:
  /// @param lift  m, of the car above the road: none in truth.
  static MadeDrive drive_past(double pitch, double lift = 0.0) {
    MadeDriveOptions options;
    options.pitch = pitch;
    const MadeDrive bare = make_drive(options);
    for (std::size_t k = 0; k < bare.frames.size(); ++k) {
      options.vehicles.push_back({seen(bare, k, lift)});
    }
    return make_drive(options);
  }

  /// The car's box in an image's camera, m: to the right, 14 m ahead, its front away.
  static OrientedBox truth(const MadeDrive& drive, std::size_t frame, double lift = 0.0) {
    const SE3 pose = metric_pose(drive.motion, frame, drive.metres_per_baseline);
    const Eigen::Vector3d up = drive.plane.normal;
    const Eigen::Vector3d front = drive.travel(), right = front.cross(up);
    Eigen::Matrix3d rotation;
    rotation << front, up, right;
    const Eigen::Vector3d bottom = drive.plane.foot(14.0 * front + 1.8 * right) + lift * up;
    OrientedBox out;
    out.camera_from_vehicle = pose * SE3(rotation, bottom);
    out.dimensions = shipped_vehicle_prior().shape("car").mean_dimensions();
    return out;
  }

  static VehicleDetection seen(const MadeDrive& drive, std::size_t frame, double lift) {
    const OrientedBox box = truth(drive, frame, lift);
    VehicleDetection out;
    out.id = 4;
    out.box = {1e9, 1e9, -1e9, -1e9};
    for (int c = 0; c < 8; ++c) {
      const Eigen::Vector2d p = *drive.frames.camera.project(box.corners().col(c));
      out.box = {std::min(out.box.x1, p.x()), std::min(out.box.y1, p.y()),
                 std::max(out.box.x2, p.x()), std::max(out.box.y2, p.y())};
    }
    const auto points = shipped_vehicle_prior().shape("car").keypoints(box.dimensions, {});
    for (int i = 0; i < kNumKeypoints; ++i) {
      const Eigen::Vector3d x = box.camera_from_vehicle * Eigen::Vector3d(points.col(i));
      out.keypoints.push_back({*drive.frames.camera.project(x), 0.9});
    }
    return out;
  }

  static SurfacePlan plan_of(const MadeDrive& drive, const ScaledRoad& scaled) {
    return stages::surface(drive.frames, drive.matches, drive.motion, exact_ground(drive),
                           scaled.road, {});
  }

  static AssembledRoad assembled(const MadeDrive& drive, const ScaledRoad& scaled,
                                 const SurfacePlan& plan, const PlacedVehicles& placed,
                                 const stages::JudgeOptions& options = {}) {
    const JudgedRoad judged = stages::judge(scaled, RoadLayer(), placed, options);
    return stages::assemble(drive.frames, drive.matches, exact_photometric(drive), scaled, plan,
                            placed, judged, VehicleMethod::kJoint, {});
  }
};

TEST_F(ParkedCar, StandsWhereItIsOnItsOwnPatch) {
  const MadeDrive drive = drive_past(0.05);
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  const PlacedVehicles placed = stages::vehicles(drive.frames, drive.motion, scaled, plan, {});
  ASSERT_EQ(placed.estimates.size(), 3u);
  for (std::size_t k = 0; k < 3; ++k) {
    ASSERT_EQ(placed.estimates[k].size(), 1u);
    const VehicleEstimate& car = placed.estimates[k][0];
    const OrientedBox box = truth(drive, k);
    ASSERT_EQ(car.status, Status::kOk) << car.reason;
    // 2 % of the distance; 0.19 m measured.
    EXPECT_LT((car.pose.center() - box.center()).norm(), 0.28) << "image " << k;
    EXPECT_NEAR(car.pose.dimensions.length, box.dimensions.length, 0.1);
    ASSERT_TRUE(plan.under_vehicles[k][0]);
    EXPECT_EQ(car.plane_source, "patch " + std::to_string(plan.under_vehicles[k][0]->id));
    EXPECT_EQ(placed.tracks[k][0], placed.tracks[0][0]);
  }
  // One track of three views measures the road once.
  ASSERT_EQ(placed.constraints.size(), 1u);
  const VehicleConstraint& found = placed.constraints[0];
  EXPECT_EQ(found.constraint.name, "vehicle");
  EXPECT_THAT(found.constraint.source, HasSubstr("car 4 of frame 12 in 3 images"));
  EXPECT_EQ(found.views.size(), 3u);
  EXPECT_NO_THROW(found.constraint.validate());
  // It agrees with a road that is right.
  EXPECT_LT(scaled.road.squared_innovation(found.constraint) /
                static_cast<double>(found.constraint.size()),
            1.0);
}

TEST_F(ParkedCar, TheBaselinesPutItOnTheirPlane) {
  const MadeDrive drive = drive_past(0.05);
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  stages::VehicleOptions options;
  options.method = VehicleMethod::kCoplanar;
  const PlacedVehicles coplanar =
      stages::vehicles(drive.frames, drive.motion, scaled, plan, options);
  EXPECT_EQ(coplanar.estimates[1][0].plane_source, "ego");
  EXPECT_LT(angle_between(coplanar.estimates[1][0].plane.normal, drive.plane.normal), 3e-3);
  EXPECT_THAT(coplanar.constraints, IsEmpty());
  options.method = VehicleMethod::kFlat;
  const PlacedVehicles flat = stages::vehicles(drive.frames, drive.motion, scaled, plan, options);
  EXPECT_EQ(flat.estimates[1][0].plane_source, "level");
  // A level road under a camera that looks down 0.05 rad: 14 m ahead it is 0.7 m too low.
  EXPECT_NEAR(angle_between(flat.estimates[1][0].plane.normal, drive.plane.normal), 0.05, 5e-3);
  // By its keypoints alone its depth is known far worse than on any plane.
  options.method = VehicleMethod::kReprojection;
  const PlacedVehicles free = stages::vehicles(drive.frames, drive.motion, scaled, plan, options);
  EXPECT_EQ(free.estimates[1][0].plane_source, "none");
  const auto depth_sigma = [](const PlacedVehicles& placed) {
    return std::sqrt(placed.estimates[1][0].covariance(5, 5));
  };
  EXPECT_GT(depth_sigma(free), 2.0 * depth_sigma(coplanar));
  options.enabled = false;
  EXPECT_THAT(stages::vehicles(drive.frames, drive.motion, scaled, plan, options).estimates,
              IsEmpty());
}

TEST_F(ParkedCar, AssembleWritesThePlanesOfThePosterior) {
  const MadeDrive drive = make_drive({});
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  const AssembledRoad out = assembled(drive, scaled, plan, {});
  const RoadPosterior& road = scaled.road;

  ASSERT_EQ(out.surface.patches.size(), plan.road.size() + 1);
  EXPECT_TRUE(out.surface.metric);
  EXPECT_EQ(out.surface.scale_sigma, road.scale_sigma());
  const PlanePatch* ego = out.surface.find(out.surface.ego_patch);
  ASSERT_TRUE(ego);
  EXPECT_EQ(ego->plane.plane.offset, road.ego().plane.offset);
  EXPECT_EQ(ego->plane.plane.normal, road.ego().plane.normal);
  EXPECT_EQ(ego->plane.covariance, road.ego().covariance);
  for (const PatchFootprint& footprint : plan.road) {
    const PlanePatch* patch = out.surface.find(footprint.id);
    ASSERT_TRUE(patch);
    const UncertainPlane plane =
        fit_local_plane(road, drive.frames.camera, footprint.contact, footprint.local).plane;
    EXPECT_EQ(patch->plane.plane.normal, plane.plane.normal);
    EXPECT_EQ(patch->plane.plane.offset, plane.plane.offset);
    EXPECT_EQ(patch->plane.covariance, plane.covariance);
    EXPECT_NEAR(patch->grade, 0.05, 3e-3) << patch->id;
    EXPECT_NEAR(patch->bank, 0.0, 3e-3) << patch->id;
  }
  for (const PatchLink& link : out.surface.links) {
    EXPECT_TRUE(link.valid) << link.reason;
    EXPECT_LT(std::abs(link.height_step), 0.02);
  }
  ASSERT_EQ(out.surface.links.size(), plan.road.size());

  // The cloud in metres on the plane, the cameras along the road, the scale.
  ASSERT_EQ(out.cloud.size(), exact_ground(drive).seen.points.size());
  for (std::size_t i = 0; i < out.cloud.size(); ++i) {
    const Eigen::Vector3d p = out.cloud.points[i].cast<double>();
    ASSERT_LT(std::abs(drive.plane.signed_distance(p)), 0.005 * p.norm());
  }
  const std::vector<int>& labels = out.cloud.labels.at("patch");
  EXPECT_GT(std::count(labels.begin(), labels.end(), 2), 50);
  ASSERT_EQ(out.run.cameras.size(), 3u);
  EXPECT_EQ(out.run.cameras[0].id, 10);
  EXPECT_NEAR(out.run.cameras[0].reference_from_camera.translation().norm(), 1.2, 1e-9);
  EXPECT_NEAR(out.run.cameras[2].reference_from_camera.translation().dot(drive.travel()), 1.0,
              1e-4);
  EXPECT_EQ(out.run.scale, road.metres_per_baseline());
  EXPECT_EQ(out.run.scale_sigma, road.scale_sigma());
  EXPECT_EQ(out.run.scale_status, Status::kOk);
  EXPECT_THAT(out.run.warnings, IsEmpty());
}

TEST_F(ParkedCar, AssembleWidensTheScaleByWhatContradictsIt) {
  const MadeDrive drive = make_drive({});
  ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  scaled.evidence = {evidence_of("plane_search", "", 0.2, 0.05)};
  scaled.evidence[0].against_others = Disagreement{0.2, 4.0, "off"};
  const AssembledRoad out = assembled(drive, scaled, plan, {});
  EXPECT_NEAR(out.run.scale_sigma, std::hypot(0.01, 0.2), 1e-9);
  EXPECT_EQ(out.surface.scale_sigma, out.run.scale_sigma);
  EXPECT_EQ(out.run.scale_status, Status::kWeak);
  ASSERT_EQ(out.run.warnings.size(), 1u);
  EXPECT_EQ(out.run.warnings[0].code, "scale_contradicted");
  EXPECT_EQ(out.run.warnings[0].text, "plane_search: off");

  scaled.metric = false;
  const AssembledRoad nominal = assembled(drive, scaled, plan, {});
  EXPECT_FALSE(nominal.run.metric || nominal.surface.metric || nominal.cloud.metric ||
               nominal.vehicles.metric);
  EXPECT_EQ(nominal.run.scale_status, Status::kNotObservable);
}

TEST_F(ParkedCar, AssembleStatesOnePlaneForTheCarAndItsPatch) {
  const MadeDrive drive = drive_past(0.05);
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  const PlacedVehicles placed = stages::vehicles(drive.frames, drive.motion, scaled, plan, {});
  const AssembledRoad out = assembled(drive, scaled, plan, placed);
  ASSERT_EQ(out.surface.patches.size(), plan.road.size() + 4);
  ASSERT_EQ(out.vehicles.frames.size(), 3u);
  for (std::size_t k = 0; k < 3; ++k) {
    const VehicleEstimate& car = out.vehicles.frames[k].vehicles[0];
    const PlanePatch* patch = out.surface.find(plan.under_vehicles[k][0]->id);
    ASSERT_TRUE(patch);
    const SE3 pose = metric_pose(drive.motion, k, drive.metres_per_baseline);
    const Plane stated = patch->plane.plane.transformed(pose);
    EXPECT_LT((stated.normal - car.plane.normal).norm(), 1e-9);
    EXPECT_NEAR(stated.offset, car.plane.offset, 1e-9);
    ASSERT_TRUE(patch->without_vehicle);
    EXPECT_LT(std::abs(drive.plane.signed_distance(patch->plane.centroid)), 0.03);
  }
  ASSERT_FALSE(out.run.constraints.empty());
  EXPECT_EQ(out.run.constraints[0].name, "vehicle");
  EXPECT_TRUE(out.run.constraints[0].accepted);
  // The car knows something of the scale: the road is known better with it.
  EXPECT_LT(out.run.scale_sigma, scaled.road.scale_sigma());
}

TEST_F(ParkedCar, AssembleStatesACarOnGroundThatIsHardlyKnownAsWeak) {
  const MadeDrive drive = drive_past(0.05);
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  PlacedVehicles placed = stages::vehicles(drive.frames, drive.motion, scaled, plan, {});
  ASSERT_EQ(placed.estimates[0][0].status, Status::kOk) << placed.estimates[0][0].reason;
  placed.estimates[0][0].plane_sigma_height = 0.95;
  const AssembledRoad out = assembled(drive, scaled, plan, placed);
  const VehicleEstimate& car = out.vehicles.frames[0].vehicles[0];
  EXPECT_EQ(car.status, Status::kWeak);
  EXPECT_EQ(car.reason, "the plane below it is known to 0.95 m");
  EXPECT_EQ(out.vehicles.frames[1].vehicles[0].status, placed.estimates[1][0].status);
}

TEST_F(ParkedCar, AssembleRejectsACarThatContradictsItsGround) {
  const MadeDrive drive = drive_past(0.05, 0.5);  // on a loader, half a metre up
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  const PlacedVehicles placed = stages::vehicles(drive.frames, drive.motion, scaled, plan, {});
  const AssembledRoad out = assembled(drive, scaled, plan, placed);
  ASSERT_FALSE(out.run.constraints.empty());
  EXPECT_FALSE(out.run.constraints[0].accepted);
  EXPECT_GT(out.run.constraints[0].residual_sigma, 2.0);
  // The road is as it was; the patch under the car holds both possibilities.
  EXPECT_NEAR(out.run.scale, scaled.road.metres_per_baseline(), 1e-12);
  const PlanePatch* patch = out.surface.find(plan.under_vehicles[1][0]->id);
  ASSERT_TRUE(patch);
  EXPECT_EQ(patch->status, Status::kWeak);
  EXPECT_THAT(patch->reason, HasSubstr("contradicts"));
}

TEST_F(ParkedCar, AssembleNamesAFocalLengthThatProportionsContradict) {
  const MadeDrive drive = drive_past(0.05);
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  PlacedVehicles placed = stages::vehicles(drive.frames, drive.motion, scaled, plan, {});
  EXPECT_EQ(placed.focal_length.vehicles, 1);
  EXPECT_LT(placed.focal_length.gain, 4.5);
  const AssembledRoad sound = assembled(drive, scaled, plan, placed);
  EXPECT_EQ(sound.run.constraints.back().name, "focal_length");
  EXPECT_TRUE(sound.run.constraints.back().accepted);
  EXPECT_TRUE(sound.run.warnings.empty());

  placed.focal_length = {4, 0.5, 12.5, 0.0};
  const AssembledRoad wrong = assembled(drive, scaled, plan, placed);
  EXPECT_FALSE(wrong.run.constraints.back().accepted);
  EXPECT_NEAR(wrong.run.constraints.back().residual_sigma, 5.0, 1e-12);
  ASSERT_EQ(wrong.run.warnings.size(), 1u);
  EXPECT_EQ(wrong.run.warnings[0].code, "focal_length_contradicted");
  EXPECT_THAT(wrong.run.warnings[0].text, HasSubstr("0.50 times the focal length"));
  EXPECT_NEAR(wrong.run.scale_sigma, std::hypot(sound.run.scale_sigma, std::log(2.0)), 1e-9);
  EXPECT_EQ(wrong.run.scale_status, Status::kWeak);
  // What was placed with these metres is known no better than they are.
  for (std::size_t k = 0; k < 3; ++k) {
    const VehicleEstimate& before = sound.vehicles.frames[k].vehicles[0];
    const VehicleEstimate& car = wrong.vehicles.frames[k].vehicles[0];
    const Eigen::Vector3d center = car.pose.center(), ray = center.normalized();
    const Eigen::Matrix3d wider = (car.covariance - before.covariance).topLeftCorner<3, 3>();
    const double sigma = std::log(2.0) * center.norm();
    EXPECT_NEAR(ray.dot(wider * ray), sigma * sigma, 1e-6 * sigma * sigma);
    EXPECT_NEAR(wider.trace(), sigma * sigma, 1e-6 * sigma * sigma);
    const double height = std::log(2.0) * car.plane.offset;
    EXPECT_NEAR(car.plane_sigma_height, std::hypot(before.plane_sigma_height, height),
                0.05 * height);
  }

  stages::JudgeOptions later;
  later.noise.focal_length_gate = 100.0;
  EXPECT_TRUE(assembled(drive, scaled, plan, placed, later).run.warnings.empty());
}

TEST_F(ParkedCar, AssembleComparesBrokenLinesAndProportionsBeforeItNamesAFocalLength) {
  const MadeDrive drive = drive_past(0.05);
  ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  const AssembledRoad sound = assembled(
      drive, scaled, plan, stages::vehicles(drive.frames, drive.motion, scaled, plan, {}));

  scaled.dash_focal_length = {0.5, 2};
  PlacedVehicles placed = stages::vehicles(drive.frames, drive.motion, scaled, plan, {});
  EXPECT_NE(placed.focal_length.log_ratio_of_other, 0.0);  // the car was asked

  // Cars with the proportions of the given focal length: it is the strokes that are longer.
  placed.focal_length.log_ratio_of_other = -2.1;
  const AssembledRoad vetoed = assembled(drive, scaled, plan, placed);
  EXPECT_TRUE(vetoed.run.warnings.empty());
  EXPECT_EQ(vetoed.run.scale_sigma, sound.run.scale_sigma);
  const auto by_strokes = std::find_if(
      vetoed.run.constraints.begin(), vetoed.run.constraints.end(),
      [](const ConstraintReport& r) { return r.source == "2 strokes of broken lines"; });
  ASSERT_NE(by_strokes, vetoed.run.constraints.end());
  EXPECT_FALSE(by_strokes->accepted);
  EXPECT_THAT(by_strokes->reason, HasSubstr("the known sizes may be wrong"));

  // Cars that say little leave them their say.
  placed.focal_length.log_ratio_of_other = -1.0;
  const AssembledRoad named = assembled(drive, scaled, plan, placed);
  ASSERT_EQ(named.run.warnings.size(), 1u);
  EXPECT_EQ(named.run.warnings[0].code, "focal_length_contradicted");
  EXPECT_THAT(named.run.warnings[0].text, HasSubstr("2 strokes of broken lines"));
  EXPECT_NEAR(named.run.scale_sigma, std::hypot(sound.run.scale_sigma, std::log(2.0)), 1e-9);
  // One that is nearer than their ground may be off says nothing.
  ScaledRoad near = scaled;
  near.dash_focal_length.factor = 0.8;
  const AssembledRoad unnamed = assembled(drive, near, plan, placed);
  EXPECT_TRUE(unnamed.run.warnings.empty());
  EXPECT_EQ(unnamed.run.scale_sigma, sound.run.scale_sigma);
  // Both at once count once.
  placed.focal_length.factor = 0.6;
  placed.focal_length.gain = 12.5;
  const AssembledRoad both = assembled(drive, scaled, plan, placed);
  EXPECT_EQ(both.run.warnings.size(), 2u);
  EXPECT_NEAR(both.run.scale_sigma, named.run.scale_sigma, 1e-12);
  // And so does what another source, as a turn, has contradicted by as much.
  scaled.evidence = {evidence_of("focal_length", "", std::log(2.0), 0.1)};
  scaled.evidence[0].against_others = Disagreement{std::log(2.0), 6.9, "off"};
  EXPECT_NEAR(assembled(drive, scaled, plan, placed).run.scale_sigma, named.run.scale_sigma, 1e-9);
}

TEST_F(ParkedCar, AssembleNamesARoadThatMostCarsContradict) {
  const MadeDrive drive = drive_past(0.05, 0.8);
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive, scaled);
  PlacedVehicles placed = stages::vehicles(drive.frames, drive.motion, scaled, plan, {});
  ASSERT_EQ(placed.constraints.size(), 1u);
  placed.constraints.resize(3, placed.constraints[0]);
  // A car that is not where the road lets expect it looks too large or too small as well.
  const AssembledRoad sizes = assembled(drive, scaled, plan, placed);
  ASSERT_EQ(sizes.run.warnings.size(), 1u);
  EXPECT_EQ(sizes.run.warnings[0].code, "scale_contradicted");
  EXPECT_THAT(sizes.run.warnings[0].text, HasSubstr("by their sizes everything is"));
  EXPECT_EQ(sizes.run.scale_status, Status::kWeak);

  // That three are beyond what the road takes may be chance; that each of four is, is not.
  PlacedVehicles nearer = placed;
  for (VehicleConstraint& v : nearer.constraints) v.constraint.residual *= 0.8;
  for (const ConstraintReport& report : assembled(drive, scaled, plan, nearer).run.constraints) {
    if (report.name != "vehicle") continue;
    EXPECT_FALSE(report.accepted);
    EXPECT_LT(report.residual_sigma, ScaleNoise().gate);
  }
  nearer.constraints.resize(4, nearer.constraints[0]);
  try {
    assembled(drive, scaled, plan, nearer);
    FAIL() << "an answer";
  } catch (const NoAnswerError& error) {
    EXPECT_THAT(error.what(), HasSubstr("4 of 4 vehicles contradict the road"));
  }

  // Farther off, each of them contradicts the road, and their sizes the scale.
  PlacedVehicles farther = placed;
  for (VehicleConstraint& v : farther.constraints) v.constraint.residual *= 3.0;
  try {
    assembled(drive, scaled, plan, farther);
    FAIL() << "an answer";
  } catch (const NoAnswerError& error) {
    EXPECT_THAT(error.what(), HasSubstr("3 of 3 vehicles contradict the road"));
  }

  // Without what their sizes are off by, and the rest many times: the road is wrong, not its scale.
  for (VehicleConstraint& v : placed.constraints) {
    const auto scale = implied_log_scale(scaled.road, v.constraint);
    ASSERT_TRUE(scale);
    const RoadFunctionals by = scaled.road.of_constraint(v.constraint);
    v.constraint.residual -= by.of_state.bottomRows(1).transpose() * scale->mean;
    v.constraint.residual *= 6.0;
  }
  const AssembledRoad road = assembled(drive, scaled, plan, placed);
  ASSERT_EQ(road.run.warnings.size(), 1u);
  EXPECT_EQ(road.run.warnings[0].code, "road_contradicted");
  EXPECT_THAT(road.run.warnings[0].text, HasSubstr("their sizes fit the scale"));
  EXPECT_NEAR(road.run.scale_sigma, 0.01, 1e-3);
  EXPECT_EQ(road.run.scale_status, Status::kOk);
}

}  // namespace
}  // namespace camber
