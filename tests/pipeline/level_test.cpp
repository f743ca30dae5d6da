#include "camber/pipeline/stages/level.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "camber/pipeline/reconstruct.h"
#include "support/test_data.h"

namespace camber {
namespace {

constexpr double kDegree = M_PI / 180.0;

Eigen::Matrix3d about_x(double angle) {
  return Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitX()).toRotationMatrix();
}

/// A road that the camera sees level, by two frames; the second camera looks 2 degrees further up.
struct Case {
  Scene scene;
  RunDocument run;
  RoadSurface surface;
  Case() {
    PlanePatch patch;
    patch.plane.plane = Plane::through({0.0, 1.5, 8.0}, {0.0, -1.0, 0.0});
    patch.plane.axis1 = {0.0, 0.0, 1.0};
    patch.plane.axis2 = {-1.0, 0.0, 0.0};
    surface.patches.push_back(patch);
    for (int id = 0; id < 2; ++id) {
      SceneFrame frame;
      frame.id = id;
      scene.frames.push_back(frame);
      run.cameras.push_back({id, SE3(about_x(id * 2.0 * kDegree), Eigen::Vector3d(0, 0, id))});
    }
  }
};

TEST(LevelByGravity, WithoutGravityTheCamerasLevelStays) {
  Case c;
  stages::level_by_gravity(c.scene, &c.run, &c.surface);
  EXPECT_EQ(c.surface.level, RoadSurface::Level::kCamera);
  EXPECT_EQ(c.surface.up, Eigen::Vector3d(0.0, -1.0, 0.0));
  EXPECT_EQ(c.surface.patches[0].grade, 0.0);
}

TEST(LevelByGravity, GradesAreAgainstGravity) {
  Case c;
  // The car stands with its nose 5 degrees up: gravity's up leans back in the camera.
  const Eigen::Vector3d up = about_x(-5.0 * kDegree) * Eigen::Vector3d(0.0, -1.0, 0.0);
  ASSERT_GT(up.z(), 0.0);  // ahead is uphill
  c.scene.frames[0].up = up;
  c.scene.frames[1].up = about_x(-2.0 * kDegree) * up;  // the same, in the second camera
  stages::level_by_gravity(c.scene, &c.run, &c.surface);
  EXPECT_EQ(c.surface.level, RoadSurface::Level::kGravity);
  EXPECT_NEAR((c.surface.up - up).norm(), 0.0, 1e-12);
  EXPECT_NEAR(c.surface.patches[0].grade, 5.0 * kDegree, 1e-12);
  EXPECT_NEAR(c.surface.patches[0].bank, 0.0, 1e-12);
  EXPECT_NEAR(c.surface.level_sigma, 0.0035, 1e-12);
  EXPECT_TRUE(c.run.warnings.empty());
}

TEST(LevelByGravity, TheBetterKnownFrameWeighsMore) {
  Case c;
  const Eigen::Vector3d level(0.0, -1.0, 0.0);
  c.scene.frames[0].up = about_x(-1.0 * kDegree) * level;
  c.scene.frames[0].up_sigma = 1.0 * kDegree;
  c.scene.frames[1].up = about_x(-2.0 * kDegree) * level;  // level in the reference camera
  c.scene.frames[1].up_sigma = 0.1 * kDegree;
  stages::level_by_gravity(c.scene, &c.run, &c.surface);
  EXPECT_NEAR(c.surface.patches[0].grade, 1.0 * kDegree / 101.0, 1e-6);
}

TEST(LevelByGravity, FramesThatContradictEachOtherAreNamed) {
  Case c;
  c.scene.frames[0].up = Eigen::Vector3d(0.0, -1.0, 0.0);
  c.scene.frames[1].up = about_x(4.0 * kDegree) * Eigen::Vector3d(0.0, -1.0, 0.0);
  stages::level_by_gravity(c.scene, &c.run, &c.surface);
  EXPECT_EQ(c.surface.level, RoadSurface::Level::kCamera);
  ASSERT_EQ(c.run.warnings.size(), 1u);
  EXPECT_EQ(c.run.warnings[0].code, "gravity_contradicted");
}

/// The embedded scene with gravity as an attitude sensor of 0.2 degrees would give it, from the
/// truth of its world: grades against it are those of the made road.
TEST(LevelByGravity, OfTheEmbeddedScene) {
  Scene scene = read_scene(test::source_dir() / "samples/steep_hill");
  const Reconstruction plain = reconstruct(scene, {0, 1, 2}, {});
  EXPECT_EQ(plain.surface.level, RoadSurface::Level::kCamera);
  // The camera as it would be mounted with its nose 3 degrees down on a slope of 7 degrees.
  const Eigen::Vector3d up = about_x(-4.0 * kDegree) * Eigen::Vector3d(0.0, -1.0, 0.0);
  const int reference = plain.reference_frame;
  for (SceneFrame& frame : scene.frames) {
    for (const RunDocument::CameraPose& camera : plain.run.cameras) {
      if (camera.id != frame.id) continue;
      frame.up = camera.reference_from_camera.rotation().conjugate() * up;
    }
  }
  const Reconstruction levelled = reconstruct(scene, {0, 1, 2}, {});
  EXPECT_EQ(levelled.reference_frame, reference);
  EXPECT_EQ(levelled.surface.level, RoadSurface::Level::kGravity);
  ASSERT_EQ(levelled.surface.patches.size(), plain.surface.patches.size());
  for (std::size_t i = 0; i < plain.surface.patches.size(); ++i) {
    const PlanePatch &a = plain.surface.patches[i], &b = levelled.surface.patches[i];
    // Nothing but the level changes; along the road the grade is 4 degrees more.
    EXPECT_EQ(a.plane.plane.offset, b.plane.plane.offset);
    if (a.kind != PatchKind::kRoad || std::abs(a.plane.axis1.x()) > 0.05) continue;
    EXPECT_NEAR(b.grade - a.grade, 4.0 * kDegree, 0.1 * kDegree);
  }
}

}  // namespace
}  // namespace camber
