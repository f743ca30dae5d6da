// Where patches are laid, on a plane between walls.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>
#include <string>

#include "camber/pipeline/stages/surface.h"
#include "pipeline/made_drive.h"

namespace camber {
namespace {

using test::exact_ground;
using test::exact_scaled;
using test::MadeDrive;
using test::MadeDriveOptions;
using test::make_drive;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// The box of a detection whose bottom edge's middle is where a ground point of the drive is seen.
VehicleDetection standing_at(const MadeDrive& drive, std::size_t frame, double x, double z) {
  const SE3 reference_from_world =
      SE3(rotation_from_vector({-0.05, 0.0, 0.0}), Eigen::Vector3d::Zero()).inverse();
  const SE3 pose = metric_pose(drive.motion, frame, drive.metres_per_baseline);
  const Eigen::Vector3d foot = pose * (reference_from_world * Eigen::Vector3d(x, 1.65, z));
  const Eigen::Vector2d p = *drive.frames.camera.project(foot);
  const double size = drive.frames.camera.fx / foot.z();
  VehicleDetection out;
  out.box = {p.x() - 0.9 * size, p.y() - 1.5 * size, p.x() + 0.9 * size, p.y()};
  return out;
}

SurfacePlan plan_of(const MadeDrive& drive, const stages::SurfaceOptions& options = {}) {
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  return stages::surface(drive.frames, drive.matches, drive.motion, exact_ground(drive),
                         scaled.road, options);
}

TEST(SurfaceStage, LaysPatchesOnThePlaneAlongTheTravel) {
  const MadeDrive drive = make_drive({});
  const ScaledRoad scaled = exact_scaled(drive, 0.01);
  const SurfacePlan plan = plan_of(drive);
  ASSERT_GE(plan.road.size(), 6u);
  ASSERT_LE(plan.road.size(), 12u);  // 60 m
  double last = 0.0;
  for (std::size_t i = 0; i < plan.road.size(); ++i) {
    const PatchFootprint& patch = plan.road[i];
    EXPECT_EQ(patch.id, static_cast<int>(i) + 1);
    EXPECT_EQ(patch.kind, PatchKind::kRoad);
    const LocalPlane fit =
        fit_local_plane(scaled.road, drive.frames.camera, patch.contact, patch.local);
    EXPECT_LT(std::abs(drive.plane.signed_distance(fit.plane.centroid)), 0.02) << patch.id;
    EXPECT_LT(angle_between(fit.plane.plane.normal, drive.plane.normal), 3e-3) << patch.id;
    const double along = fit.plane.centroid.dot(drive.travel());
    if (i > 0) {
      // A contact is a row, which is so many metres.
      EXPECT_NEAR(along - last, 5.0, along * along / (400.0 * 1.65) + 0.2) << patch.id;
    }
    last = along;
    EXPECT_NEAR(patch.contact.x(), drive.frames.camera.cx, 1.0);
  }
  EXPECT_THAT(plan.road[0].unobserved, IsEmpty());
  EXPECT_GT(plan.road[0].inliers, 5);
}

TEST(SurfaceStage, EndsWhereTheRoadIsKnownTooBadly) {
  const MadeDrive drive = make_drive({});
  stages::SurfaceOptions options;
  options.reach = 25.0;
  const std::size_t near = plan_of(drive, options).road.size();
  EXPECT_GE(near, 3u);
  EXPECT_LE(near, 5u);
  options.worst_height = 1e-6;
  EXPECT_EQ(plan_of(drive, options).road.size(), 0u);
}

TEST(SurfaceStage, ValidateNamesTheField) {
  stages::SurfaceOptions options;
  EXPECT_NO_THROW(options.validate());
  const auto refused = [&] {
    try {
      options.validate();
    } catch (const std::invalid_argument& e) {
      return std::string(e.what());
    }
    return std::string();
  };
  options.grazing_px = 0.0;
  EXPECT_NO_THROW(options.validate());
  options.grazing_px = -1.0;
  EXPECT_THAT(refused(), HasSubstr("grazing_px: -1"));
  options = {};
  options.reach = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THAT(refused(), HasSubstr("reach"));
  options = {};
  options.patch_length = 0.0;
  EXPECT_THAT(refused(), HasSubstr("patch_length: 0"));
  EXPECT_THROW(plan_of(make_drive({}), options), std::invalid_argument);
  options = {};
  options.under_vehicle.half_width = 0.0;
  EXPECT_THAT(refused(), HasSubstr("half_width: 0, must be greater than 0"));
  options = {};
  options.under_vehicle.uneven_height = -0.01;
  EXPECT_THAT(refused(), HasSubstr("uneven_height: -0.01"));
  options = {};
  options.under_vehicle.bumper_overhang = std::numeric_limits<double>::infinity();
  EXPECT_THAT(refused(), HasSubstr("bumper_overhang"));
}

TEST(SurfaceStage, LaysAPatchUnderEveryDetectionThatTouchesGround) {
  const MadeDrive bare = make_drive({});
  VehicleDetection flying = standing_at(bare, 1, 0.0, 12.0);
  flying.box = {100.0, 0.0, 130.0, 20.0};
  VehicleDetection with_plane = standing_at(bare, 1, 0.0, 12.0);
  with_plane.has_plane = true;
  with_plane.given_plane = bare.plane;
  MadeDriveOptions options;
  options.vehicles = {
      {standing_at(bare, 0, 1.5, 12.0)},
      {standing_at(bare, 1, 1.5, 12.0), standing_at(bare, 1, -4.3, 14.0), flying, with_plane},
      {}};
  const MadeDrive drive = make_drive(options);
  const SurfacePlan plan = plan_of(drive);
  ASSERT_EQ(plan.under_vehicles.size(), 3u);
  ASSERT_EQ(plan.under_vehicles[0].size(), 1u);
  ASSERT_EQ(plan.under_vehicles[1].size(), 4u);
  ASSERT_TRUE(plan.under_vehicles[0][0]);
  ASSERT_TRUE(plan.under_vehicles[1][0]);
  ASSERT_TRUE(plan.under_vehicles[1][1]);
  EXPECT_FALSE(plan.under_vehicles[1][2]);
  EXPECT_FALSE(plan.under_vehicles[1][3]);
  // The same place by way of another image.
  const Eigen::Vector2d contact = plan.under_vehicles[1][0]->contact;
  EXPECT_LT((plan.under_vehicles[0][0]->contact - contact).norm(), 0.2);
  EXPECT_EQ(plan.under_vehicles[1][0]->kind, PatchKind::kRoad);
  EXPECT_EQ(plan.under_vehicles[1][1]->kind, PatchKind::kPavement);
  EXPECT_EQ(plan.under_vehicles[0][0]->id, static_cast<int>(plan.road.size()) + 1);

  stages::SurfaceOptions road_alone;
  road_alone.under_vehicles = false;
  for (const auto& frame : plan_of(drive, road_alone).under_vehicles) {
    for (const auto& patch : frame) EXPECT_FALSE(patch);
  }
}

}  // namespace
}  // namespace camber
