// Triangulation and ground on exact correspondences of a plane between walls.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/core/errors.h"
#include "camber/pipeline/stages/match.h"
#include "camber/pipeline/stages/road_layer.h"
#include "pipeline/made_drive.h"

namespace camber {
namespace {

using test::exact_ground;
using test::MadeDrive;
using test::MadeDriveOptions;
using test::make_drive;
using test::searched;

/// Largest relative error of the inverse depths of the triangulated points.
double worst_point(const MadeDrive& drive, const TriangulatedPoints& points) {
  double worst = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double truth =
        drive.metres_per_baseline / drive.depths[static_cast<std::size_t>(points.grid[i])];
    worst = std::max(worst, std::abs(points.inverse_depth[i] / truth - 1.0));
  }
  return worst;
}

TEST(TriangulateStage, GivesTheGroundOfTheMasks) {
  const MadeDrive drive = make_drive({});
  const GroundPoints found =
      stages::triangulate(drive.frames, drive.matches, drive.motion, nullptr, {});
  EXPECT_EQ(found.is_ground, drive.is_ground);
  EXPECT_GT(found.points.size(), 4000u);
  EXPECT_LT(worst_point(drive, found.points), 1e-3);  // matches are floats of 640 px
  // The pavements are ground and no roadway.
  const SE3 level(rotation_from_vector({-0.05, 0.0, 0.0}), Eigen::Vector3d::Zero());
  long roadway = 0, pavement = 0;
  for (std::size_t i = 0; i < drive.depths.size(); ++i) {
    if (!drive.is_ground[i]) continue;
    const Eigen::Vector3d x =
        drive.depths[i] * drive.frames.camera.ray(drive.matches.pixels[i].cast<double>());
    const bool on_road = std::abs((level * x).x()) < 3.5;
    EXPECT_EQ(found.is_roadway[i] != 0, on_road);
    ++(on_road ? roadway : pavement);
  }
  EXPECT_GT(roadway, 1000);
  EXPECT_GT(pavement, 300);
}

TEST(TriangulateStage, GrowsTheGroundWithoutMasks) {
  MadeDriveOptions options;
  options.masks = false;
  const MadeDrive drive = make_drive(options);
  const GroundPoints found =
      stages::triangulate(drive.frames, drive.matches, drive.motion, nullptr, {});
  long wrong = 0, missed = 0, near = 0;
  for (std::size_t i = 0; i < drive.depths.size(); ++i) {
    const Eigen::Vector3d x =
        drive.depths[i] * drive.frames.camera.ray(drive.matches.pixels[i].cast<double>());
    wrong += found.is_ground[i] && drive.plane.signed_distance(x) > 0.3;  // but a wall's foot
    if (!drive.is_ground[i] || drive.depths[i] > 20.0) continue;
    ++near;
    missed += !found.is_ground[i];
  }
  EXPECT_EQ(wrong, 0);
  EXPECT_LT(static_cast<double>(missed) / static_cast<double>(near), 0.05);
  EXPECT_LT(worst_point(drive, found.points), 1e-3);
}

TEST(TriangulateStage, WhereNoRoadGrowsTheExtentBeforeStaysOrThereIsNoAnswer) {
  MadeDriveOptions options;
  options.masks = false;
  MadeDrive drive = make_drive(options);
  for (MatchedImage& match : drive.matches.matches) {
    for (std::size_t i = 0; i < drive.depths.size(); ++i) {
      if (!drive.is_ground[i]) continue;
      match.round_trip_px[i] = std::numeric_limits<float>::infinity();
    }
  }
  EXPECT_THROW(stages::triangulate(drive.frames, drive.matches, drive.motion, nullptr, {}),
               NoAnswerError);
  const Ground before = exact_ground(make_drive({}));
  const GroundPoints found =
      stages::triangulate(drive.frames, drive.matches, drive.motion, &before.seen, {});
  EXPECT_EQ(found.is_ground, before.seen.is_ground);
  EXPECT_EQ(found.is_roadway, before.seen.is_roadway);
}

/// Largest relative error of a field's inverse depths where it is nearer than 25 m.
double worst_field(const MadeDrive& drive, const GroundField& field) {
  double worst = 0.0;
  for (std::size_t i = 0; i < drive.depths.size(); ++i) {
    if (!drive.is_ground[i] || drive.depths[i] > 25.0) continue;
    const double truth = drive.metres_per_baseline / drive.depths[i];
    const double found = field.inverse_depth(drive.matches.pixels[i].cast<double>());
    worst = std::max(worst, std::abs(found / truth - 1.0));
  }
  return worst;
}

TEST(RejectedBlocks, ABoxHasTheShareOfTheBlocksItTouches) {
  RejectedBlocks blocks{3, std::vector<std::uint8_t>(6, 0)};  // of 128 x 24 px
  blocks.rejected[1] = 1;
  EXPECT_EQ(blocks.share({0.0, 0.0, 200.0, 20.0}), 0.5);
  EXPECT_EQ(blocks.share({130.0, 0.0, 250.0, 47.0}), 0.5);
  EXPECT_EQ(blocks.share({-20.0, -20.0, 1000.0, 1000.0}), 1.0 / 6.0);
  EXPECT_EQ(RejectedBlocks().share({0.0, 0.0, 200.0, 20.0}), 0.0);
}

TEST(FirstGroundStage, FindsThePlaneUnderTheCameraAndTheField) {
  for (const double pitch : {0.0, 0.05}) {
    MadeDriveOptions options;
    options.pitch = pitch;
    const MadeDrive drive = make_drive(options);
    const Ground found = stages::first_ground(drive.frames, drive.matches, drive.motion,
                                              exact_ground(drive).seen, {}, {});
    EXPECT_LT(angle_between(found.ego.plane.plane.normal, drive.plane.normal), 1e-3);
    EXPECT_NEAR(found.ego.height, 1.65 / 1.2, 0.003 * 1.65 / 1.2);
    EXPECT_NEAR(found.metres_per_baseline, 1.2, 0.003 * 1.2);
    EXPECT_LT(worst_field(drive, *found.field), 0.003);
  }
}

TEST(FirstGroundStage, KnownPosesGiveTheMetres) {
  MadeDrive drive = make_drive({});
  drive.motion.metres_per_baseline = 1.37;
  const Ground found = stages::first_ground(drive.frames, drive.matches, drive.motion,
                                            exact_ground(drive).seen, {}, {});
  EXPECT_EQ(found.metres_per_baseline, 1.37);
}

TEST(FirstGroundStage, AnInformativeSearchIsTheStart) {
  const MadeDrive drive = make_drive({});
  const double log_baseline = std::log(1.1 / 1.65);  // not what the points have
  const Ground found =
      stages::first_ground(drive.frames, drive.matches, drive.motion, exact_ground(drive).seen,
                           searched(log_baseline, true), {});
  EXPECT_EQ(found.ego.status, Status::kWeak);
  EXPECT_NEAR(found.ego.height, 1.65 / 1.1, 1e-9);
  EXPECT_NEAR(found.metres_per_baseline, 1.1, 1e-9);
  EXPECT_LT(angle_between(found.ego.plane.plane.normal, drive.plane.normal), 1e-3);
}

TEST(FirstGroundStage, ManyMatchesOnAnotherLayerDoNotOutweighTheSearch) {
  const MadeDrive drive = make_drive({});
  GroundPoints points = exact_ground(drive).seen;
  for (std::size_t i = 0; i < points.points.size(); ++i) {
    if (i % 4 != 0) points.points.inverse_depth[i] *= 0.4;  // as what a wet road mirrors
  }
  const Ground found = stages::first_ground(drive.frames, drive.matches, drive.motion, points,
                                            searched(std::log(1.2 / 1.65), true), {});
  for (const double z : {6.0, 9.0, 12.0}) {
    const Eigen::Vector3d p = drive.plane.foot({0.0, 0.0, z});
    const double rho = found.field->inverse_depth(*drive.frames.camera.project(p));
    EXPECT_NEAR(1.2 / rho, p.z(), 0.01 * p.z());
  }
}

TEST(FirstGroundStage, WithoutPointsOnlyALikelySearchIsAnAnswer) {
  const MadeDrive drive = make_drive({});
  const auto ground_of = [&](const PlaneSearchResult& search) {
    GroundPoints none;
    none.is_ground = none.is_roadway = drive.is_ground;
    none.points.pose_jacobian.resize(0, drive.motion.covariance.rows());
    return stages::first_ground(drive.frames, drive.matches, drive.motion, none, search, {});
  };
  EXPECT_THROW(ground_of({}), NoAnswerError);
  PlaneSearchResult unlikely = searched(std::log(1.2 / 1.65), false);
  unlikely.correlation = 0.5;
  EXPECT_THROW(ground_of(unlikely), NoAnswerError);
  const Ground found = ground_of(searched(std::log(1.2 / 1.65), false));
  EXPECT_NEAR(found.metres_per_baseline, 1.2, 1e-9);
  // The search's own corridor: 8 camera heights ahead, 1.5 to each side.
  for (const double x : {-2.0, 0.0, 2.0}) {
    for (const double z : {6.0, 9.0, 12.0}) {
      const Eigen::Vector3d p = drive.plane.foot({x, 0.0, z});
      const double rho = found.field->inverse_depth(*drive.frames.camera.project(p));
      EXPECT_NEAR(1.2 / rho, p.z(), 0.01 * p.z());
    }
  }
}

TEST(GroundStage, TakesBetterPointsInPlaceOfTheGroundBefore) {
  MadeDriveOptions higher;
  higher.height = 1.8;
  const Ground before = exact_ground(make_drive(higher));
  const MadeDrive drive = make_drive({});
  ASSERT_GT(worst_field(drive, *before.field), 0.05);
  const Ground found = stages::ground(drive.frames, drive.matches, drive.motion,
                                      exact_ground(drive).seen, before, {});
  EXPECT_NEAR(found.ego.height, 1.65 / 1.2, 0.003 * 1.65 / 1.2);
  EXPECT_NEAR(found.metres_per_baseline, 1.2, 0.003 * 1.2);
  EXPECT_LT(worst_field(drive, *found.field), 0.003);
  // The value before is as it was.
  EXPECT_NEAR(before.ego.height, 1.8 / 1.2, 1e-9);
  // The nearest points of a ground that lies 0.15 m deeper move by several pixels.
  const auto change = [&](const Ground& from) {
    return stages::prediction_change(drive.frames, drive.matches, drive.motion, *from.field, found);
  };
  EXPECT_GT(change(before), 1.5);
  EXPECT_EQ(change(found), 0.0);
  EXPECT_GT(worst_field(drive, *before.field), 0.05);
}

TEST(GroundStage, TheEgoPlaneStaysWhereNoPointIsOnTheRoadway) {
  const MadeDrive drive = make_drive({});
  Ground before = exact_ground(drive);
  before.ego.height *= 1.1;
  GroundPoints points = before.seen;
  std::fill(points.is_roadway.begin(), points.is_roadway.end(), std::uint8_t{0});
  const Ground found =
      stages::ground(drive.frames, drive.matches, drive.motion, points, before, {});
  EXPECT_EQ(found.ego.height, before.ego.height);
  EXPECT_LT(worst_field(drive, *found.field), 0.003);
}

TEST(GroundStage, WithoutPointsThereIsNoAnswer) {
  const MadeDrive drive = make_drive({});
  const Ground before = exact_ground(drive);
  GroundPoints none = before.seen;
  none.points = {};
  EXPECT_THROW(stages::ground(drive.frames, drive.matches, drive.motion, none, before, {}),
               NoAnswerError);
}

TEST(GroundStage, PixelsOfTheGroundAreTheMasksOrTheGridPointsCells) {
  MadeDrive drive = make_drive({});
  const Ground ground = exact_ground(drive);
  EXPECT_EQ(stages::ground_pixels(drive.frames, drive.matches, ground),
            drive.frames.reference_masks().ground);
  drive.frames.masks[drive.frames.reference].has_mask = false;
  const std::vector<std::uint8_t> cells =
      stages::ground_pixels(drive.frames, drive.matches, ground);
  for (std::size_t i = 0; i < drive.is_ground.size(); ++i) {
    const std::size_t p = drive.matches.image_index(i, drive.frames.camera.width);
    EXPECT_EQ(cells[p] != 0, drive.is_ground[i] != 0);
    EXPECT_EQ(cells[p + 640 + 3] != 0, drive.is_ground[i] != 0);
  }
}

TEST(GroundStage, AgreementIsWhatIsFoundAndAgreesWithOneRoad) {
  const MadeDrive drive = make_drive({});
  Ground ground = exact_ground(drive);
  ground.ego.points = ground.ego.compared = 100;
  EXPECT_DOUBLE_EQ(stages::road_agreement(ground), 1.0);
  ground.ego.points = 50;
  EXPECT_DOUBLE_EQ(stages::road_agreement(ground), 0.5);
  ground.seen.points.dropped[0] = 3 * static_cast<long>(ground.seen.points.size());
  EXPECT_DOUBLE_EQ(stages::found_share(ground.seen), 0.25);
  EXPECT_DOUBLE_EQ(stages::road_agreement(ground), 0.125);
  ground.ego.points = ground.ego.compared = 0;
  EXPECT_DOUBLE_EQ(stages::road_agreement(ground), 0.0);
}

}  // namespace
}  // namespace camber
