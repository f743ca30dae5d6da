// The stages from the motion to the surface, each by itself, on exact correspondences of a plane
// between walls.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "camber/core/errors.h"
#include "camber/pipeline/stages/match.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/pipeline/stages/surface.h"
#include "pipeline/made_drive.h"

namespace camber {
namespace {

using test::exact_ground;
using test::exact_photometric;
using test::exact_scaled;
using test::judged_road;
using test::MadeDrive;
using test::MadeDriveOptions;
using test::make_drive;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

double rotation_error(const SE3& a, const SE3& b) {
  return rotation_to_vector((a.inverse() * b).rotation()).norm();
}

void expect_same_motion(const MotionEstimate& found, const MotionEstimate& truth) {
  ASSERT_EQ(found.frame_from_reference.size(), truth.frame_from_reference.size());
  for (std::size_t k = 0; k < truth.frame_from_reference.size(); ++k) {
    const SE3 &a = found.frame_from_reference[k], &b = truth.frame_from_reference[k];
    EXPECT_LT(rotation_error(a, b), 2e-5) << "image " << k;
    EXPECT_LT((a.translation() - b.translation()).norm(), 5e-4) << "image " << k;
  }
}

/// Matches inside a box as if what is seen there moved by itself.
void move_inside(const Box2& box, const Eigen::Vector3d& shift, MadeDrive* drive) {
  const PinholeCamera& camera = drive->frames.camera;
  for (MatchedImage& match : drive->matches.matches) {
    const auto f = static_cast<std::size_t>(match.frame);
    const SE3 pose = metric_pose(drive->motion, f, drive->metres_per_baseline);
    for (std::size_t i = 0; i < drive->depths.size(); ++i) {
      const Eigen::Vector2d pixel = drive->matches.pixels[i].cast<double>();
      if (!box.contains(pixel)) continue;
      const double direction = f < drive->frames.reference ? -1.0 : 1.0;
      const auto p =
          camera.project(pose * (drive->depths[i] * camera.ray(pixel) + direction * shift));
      match.round_trip_px[i] = p ? 0.0f : std::numeric_limits<float>::infinity();
      if (p) match.pixels[i] = p->cast<float>();
    }
  }
}

TEST(MotionStage, RecoversThePosesFromExactMatches) {
  const MadeDrive drive = make_drive({});
  const MotionEstimate found = stages::motion(drive.frames, drive.matches, {});
  ASSERT_EQ(found.status, Status::kOk) << found.reason;
  expect_same_motion(found, drive.motion);
  EXPECT_FALSE(found.metres_per_baseline);
}

TEST(MotionStage, LeavesOutWhatIsOnVehicles) {
  // Three quarters of the image move by themselves, all alike.
  MadeDriveOptions options;
  VehicleDetection bus;
  bus.box = {0.0, 0.0, 480.0, 239.0};
  options.vehicles = {{}, {bus}, {}};
  MadeDrive drive = make_drive(options);
  move_inside(bus.box, {0.6, 0.0, 0.3}, &drive);
  expect_same_motion(stages::motion(drive.frames, drive.matches, {}), drive.motion);
}

TEST(MotionStage, TakesKnownPosesWithTheirMetres) {
  MadeDrive drive = make_drive({});
  const SE3 world_from_reference(rotation_from_vector({0.1, -0.2, 0.3}), {5.0, 6.0, 7.0});
  for (std::size_t k = 0; k < drive.frames.size(); ++k) {
    drive.frames.frames[k].world_from_camera =
        world_from_reference * metric_pose(drive.motion, k, drive.metres_per_baseline).inverse();
  }
  // Matches have no say in known poses.
  for (MatchedImage& match : drive.matches.matches) {
    std::fill(match.round_trip_px.begin(), match.round_trip_px.end(),
              std::numeric_limits<float>::infinity());
  }
  const MotionEstimate found = stages::motion(drive.frames, drive.matches, {});
  ASSERT_TRUE(found.metres_per_baseline);
  EXPECT_NEAR(*found.metres_per_baseline, 1.2, 1e-9);
  expect_same_motion(found, drive.motion);
  const MotionEstimate again = stages::motion_again(drive.frames, drive.matches, found, {});
  EXPECT_EQ(again.metres_per_baseline, found.metres_per_baseline);
  expect_same_motion(again, drive.motion);
}

TEST(MotionStage, PosesThatTheMatchesContradictAreLeftAsideByName) {
  MadeDrive drive = make_drive({});
  const auto give_poses = [&](double turn_of_last) {
    for (std::size_t k = 0; k < drive.frames.size(); ++k) {
      drive.frames.frames[k].world_from_camera =
          metric_pose(drive.motion, k, drive.metres_per_baseline).inverse();
    }
    SE3& last = *drive.frames.frames.back().world_from_camera;
    last = last * SE3(rotation_from_vector({0.6 * turn_of_last, 0.0, 0.8 * turn_of_last}),
                      Eigen::Vector3d::Zero());
  };
  give_poses(0.0);
  stages::check_poses(drive.matches, {}, &drive.frames);
  EXPECT_TRUE(drive.frames.has_poses());
  EXPECT_EQ(drive.frames.contradicted_poses, "");
  give_poses(0.017);
  stages::check_poses(drive.matches, {}, &drive.frames);
  EXPECT_FALSE(drive.frames.has_poses());
  EXPECT_THAT(drive.frames.contradicted_poses,
              StartsWith("frame " + std::to_string(drive.frames.frames.back().id) + ": "));
  EXPECT_THAT(drive.frames.contradicted_poses, Not(HasSubstr(";")));  // the other one is right
  expect_same_motion(stages::motion(drive.frames, drive.matches, {}), drive.motion);
}

TEST(MotionStage, PosesOfOtherMomentsAreKnownByTheirTurns) {
  MadeDrive drive = make_drive({});
  // Poses that turn by so much more from frame to frame, or all of them in other axes.
  const auto give_poses = [&](double turn, const SE3& axes) {
    drive.frames.poses_of_other_moments = false;
    for (std::size_t k = 0; k < drive.frames.size(); ++k) {
      const SE3 pose = metric_pose(drive.motion, k, drive.metres_per_baseline).inverse();
      drive.frames.frames[k].world_from_camera =
          pose *
          SE3(rotation_from_vector({0.0, turn * static_cast<double>(k), 0.0}),
              Eigen::Vector3d::Zero()) *
          axes;
    }
    stages::check_poses(drive.matches, {}, &drive.frames);
  };
  const SE3 none;
  give_poses(0.0, none);
  EXPECT_FALSE(drive.frames.poses_of_other_moments);
  EXPECT_TRUE(drive.frames.has_poses());
  give_poses(0.021, none);
  EXPECT_FALSE(drive.frames.has_poses());
  EXPECT_TRUE(drive.frames.poses_of_other_moments);
  // A body's axes in place of the camera's: its turns are those of the images, its lengths count.
  give_poses(0.0, SE3(rotation_from_vector({1.2, -1.2, 1.2}), Eigen::Vector3d::Zero()));
  EXPECT_FALSE(drive.frames.has_poses());
  EXPECT_FALSE(drive.frames.poses_of_other_moments);
}

TEST(MotionStage, AStationaryCameraHasNoAnswer) {
  MadeDriveOptions options;
  options.stations = {-1e-4, 0.0, 1e-4};
  const MadeDrive drive = make_drive(options);
  EXPECT_THROW(stages::motion(drive.frames, drive.matches, {}), NoAnswerError);
}

TEST(MotionStage, AgainStartsFromAMotionThatIsNearlyRight) {
  const MadeDrive drive = make_drive({});
  MotionEstimate start = drive.motion;
  start.frame_from_reference[2] =
      SE3(rotation_from_vector({0.002, -0.001, 0.001}), {0.01, -0.01, 0.0}) *
      start.frame_from_reference[2];
  expect_same_motion(stages::motion_again(drive.frames, drive.matches, start, {}), drive.motion);
}

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

PlaneSearchResult searched(double log_baseline, bool informative) {
  PlaneSearchResult out;
  out.best.log_baseline = log_baseline;
  out.correlation = 0.8;
  out.samples = 5000;
  out.informative = informative;
  return out;
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

const ConstraintReport* report_of(const std::vector<ConstraintReport>& reports,
                                  const std::string& name) {
  for (const ConstraintReport& report : reports) {
    if (report.name == name) return &report;
  }
  return nullptr;
}

TEST(ScaleStage, PointsThatAgreeOnNoRoadGiveNoScale) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.ego.points = 400;
  ground.ground.ego.compared = 790;
  EXPECT_NO_THROW(judged_road(drive, ground));
  ground.ground.ego.compared = 810;
  EXPECT_THROW(judged_road(drive, ground), NoAnswerError);
}

TEST(ScaleStage, TheCameraHeightGivesTheMetres) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  const ScaledRoad scaled = stages::scale(drive.frames, drive.matches, ground, {});
  EXPECT_TRUE(scaled.metric);
  EXPECT_NEAR(scaled.road.metres_per_baseline(), 1.2, 1e-3);
  // 10 mm of 1.65 m, and the ego plane's 0.2 %.
  EXPECT_NEAR(scaled.road.scale_sigma(), std::hypot(0.01 / 1.65, 0.002), 3e-4);
  ASSERT_TRUE(report_of(scaled.reports, "camera_height"));
  EXPECT_TRUE(report_of(scaled.reports, "camera_height")->accepted);
  const JudgedRoad judged = judged_road(drive, ground);
  EXPECT_THAT(judged.warnings, IsEmpty());
  EXPECT_EQ(judged.contradiction_variance, 0.0);
  EXPECT_EQ(judged.scale.sigma, scaled.road.scale_sigma());
  const UncertainPlane ego = scaled.road.ego();
  EXPECT_NEAR(ego.plane.offset, 1.65, 0.002);
  EXPECT_LT(angle_between(ego.plane.normal, drive.plane.normal), 1e-3);
  // A wrong first scale of the ground stage is of no consequence.
  ground.ground.metres_per_baseline = 1.1;
  EXPECT_NEAR(stages::scale(drive.frames, drive.matches, ground, {}).road.metres_per_baseline(),
              1.2, 0.005);
}

TEST(ScaleStage, ARoadThatIsHardlyFoundDoesNotGiveTheScale) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  TriangulatedPoints& points = ground.ground.seen.points;
  const auto found = static_cast<long>(points.size());
  points.dropped[0] = 3 * found;  // a quarter is found
  const auto contradictions = [&](bool searched) {
    ground.ground.search.informative = searched;
    return judged_road(drive, ground).warnings;
  };
  EXPECT_THAT(contradictions(true), IsEmpty());
  ASSERT_EQ(contradictions(false).size(), 1u);
  EXPECT_THAT(contradictions(false)[0].text, HasSubstr("only 25 % of the masked road is found"));
  points.dropped[0] = found;
  EXPECT_THAT(contradictions(false), IsEmpty());
  ground.ground.search.ambiguous = true;  // another road may have been found
  ASSERT_EQ(contradictions(false).size(), 1u);
  EXPECT_THAT(contradictions(false)[0].text, HasSubstr("only 50 % of the masked road is found"));
  ground.ground.search.ambiguous = false;
  points.dropped[0] = 9 * found;
  const JudgedRoad judged = judged_road(drive, ground);
  ASSERT_EQ(judged.warnings.size(), 1u);
  EXPECT_EQ(judged.warnings[0].code, "scale_contradicted");
  EXPECT_THAT(judged.warnings[0].text, HasSubstr("only 10 % of the masked road is found"));
  EXPECT_NEAR(std::sqrt(judged.contradiction_variance), 0.3, 1e-9);
  EXPECT_NEAR(judged.road.metres_per_baseline(), 1.2, 1e-3);  // the answer stands
}

TEST(ScaleStage, AMaskedRoadOnWhichTheCameraWouldRunIntoTheWallsIsNone) {
  const MadeDrive drive = make_drive({});
  // Matched in steps that are a tenth as long as they are: the walls, 5 m aside, come to 0.5 m.
  const auto at = [&](double times) {
    MadeDriveOptions options;
    options.height = times * 1.65;
    PhotometricGround ground = exact_photometric(make_drive(options));
    ground.ground.metres_per_baseline /= times;
    ground.ground.ego.metres_per_baseline /= times;
    return ground;
  };
  try {
    judged_road(drive, at(10.0));
    FAIL() << "a scale";
  } catch (const NoAnswerError& error) {
    EXPECT_THAT(error.what(), HasSubstr("would obstruct the driven path"));
  }
  EXPECT_NO_THROW(judged_road(drive, at(3.0)));
  // With poses the lengths do not come from the road.
  PhotometricGround known = at(10.0);
  known.motion.metres_per_baseline = 0.12;
  known.motion.baseline_sigma = 0.001;
  EXPECT_NO_THROW(judged_road(drive, known));
}

TEST(ScaleStage, TheLessOfTheRoadIsFoundTheLessTheScaleIsKnown) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  TriangulatedPoints& points = ground.ground.seen.points;
  const auto widened_where = [&](double share) {
    points.dropped = {};
    points.dropped[0] = std::lround(static_cast<double>(points.size()) * (1.0 / share - 1.0));
    const JudgedRoad judged = judged_road(drive, ground);
    EXPECT_THAT(judged.warnings, IsEmpty());
    return std::sqrt(judged.contradiction_variance);
  };
  EXPECT_NEAR(widened_where(1.0), 0.0, 1e-9);
  EXPECT_NEAR(widened_where(0.9), 0.08 * 0.01, 1e-4);
  EXPECT_NEAR(widened_where(0.4), 0.08 * 0.36, 1e-4);
}

TEST(ScaleStage, WhatRoadsFromOtherStartsDifferByIsInItsSigma) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  const JudgedRoad before = judged_road(drive, ground);
  EXPECT_LT(before.contradiction_variance, 1e-6);
  ground.ground.alternative_spread = 0.07;
  const JudgedRoad judged = judged_road(drive, ground);
  EXPECT_NEAR(std::sqrt(judged.contradiction_variance), 0.07, 1e-9);
  EXPECT_THAT(judged.warnings, IsEmpty());
  EXPECT_NEAR(judged.road.metres_per_baseline(), before.road.metres_per_baseline(), 1e-9);
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

TEST(ScaleStage, ARoadWithMuchElseOverItDoesNotGiveTheScaleWithoutAMask) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  const TriangulatedPoints& road = ground.ground.seen.points;
  TriangulatedPoints& others = ground.ground.seen.others;
  // On the same rays, at half and at a third of the distance.
  const auto stand = [&](std::size_t stride) {
    others = {};
    for (std::size_t i = 0; i < road.size(); i += stride) {
      for (const double nearer : {2.0, 3.0}) {
        others.grid.push_back(road.grid[i]);
        others.rays.push_back(road.rays[i]);
        others.inverse_depth.push_back(nearer * road.inverse_depth[i]);
      }
    }
  };
  stand(20);
  EXPECT_THAT(judged_road(drive, ground).warnings, IsEmpty());
  stand(1);
  const JudgedRoad judged = judged_road(drive, ground);
  ASSERT_EQ(judged.warnings.size(), 1u);
  EXPECT_EQ(judged.warnings[0].code, "scale_contradicted");
  EXPECT_THAT(judged.warnings[0].text, HasSubstr("off the road that is found there"));
  EXPECT_NEAR(std::sqrt(judged.contradiction_variance), 0.3, 1e-9);
  // Beside the path they stand on no road that is driven.
  for (Eigen::Vector3d& ray : others.rays) ray.x() += 2.0;
  EXPECT_THAT(judged_road(drive, ground).warnings, IsEmpty());
}

TEST(ScaleStage, AHeightKnownBadlyIsSaidToBe) {
  MadeDrive drive = make_drive({});
  drive.frames.known.camera_height_sigma = 0.165;
  const ScaledRoad scaled =
      stages::scale(drive.frames, drive.matches, exact_photometric(drive), {});
  EXPECT_NEAR(scaled.road.scale_sigma(), 0.1, 0.003);
}

TEST(ScaleStage, WithoutASourceOfMetresLengthsAreInNominalHeights) {
  MadeDrive drive = make_drive({});
  drive.frames.known.camera_height.reset();
  const ScaledRoad scaled =
      stages::scale(drive.frames, drive.matches, exact_photometric(drive), {});
  EXPECT_FALSE(scaled.metric);
  EXPECT_NEAR(scaled.road.metres_per_baseline(), 1.2, 2e-3);  // 1.65 m is the nominal height
  ASSERT_TRUE(report_of(scaled.reports, "camera_height"));
  EXPECT_FALSE(report_of(scaled.reports, "camera_height")->accepted);
  EXPECT_EQ(report_of(scaled.reports, "camera_height")->reason, "not given");
}

TEST(ScaleStage, KnownPosesTakeThePlaceOfTheCameraHeight) {
  MadeDrive drive = make_drive({});
  drive.frames.known.camera_height.reset();
  PhotometricGround ground = exact_photometric(drive);
  ground.motion.metres_per_baseline = ground.ground.metres_per_baseline = 1.3;
  ground.motion.baseline_sigma = 0.01;
  const ScaledRoad scaled = stages::scale(drive.frames, drive.matches, ground, {});
  EXPECT_TRUE(scaled.metric);
  EXPECT_NEAR(scaled.road.metres_per_baseline(), 1.3, 1e-3);
  EXPECT_NEAR(scaled.road.scale_sigma(), 0.01, 2e-4);
  ASSERT_TRUE(report_of(scaled.reports, "known_poses"));
  EXPECT_TRUE(report_of(scaled.reports, "known_poses")->accepted);
  EXPECT_FALSE(report_of(scaled.reports, "camera_height"));
}

TEST(ScaleStage, AHeightBesideKnownPosesIsComparedWithThem) {
  MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  ground.motion.metres_per_baseline = ground.ground.metres_per_baseline = 1.2;
  ground.motion.baseline_sigma = 0.01;
  JudgedRoad judged = judged_road(drive, ground);
  EXPECT_THAT(judged.warnings, IsEmpty());
  EXPECT_NEAR(judged.road.metres_per_baseline(), 1.2, 2e-3);
  EXPECT_LT(judged.road.scale_sigma(), 0.007);  // the height's 0.006 and the poses' 0.01
  // 20 % too high: the poses stand, and what contradicts them is stated.
  *drive.frames.known.camera_height *= 1.2;
  judged = judged_road(drive, ground);
  EXPECT_NEAR(judged.road.metres_per_baseline(), 1.2, 2e-3);
  ASSERT_TRUE(report_of(judged.reports, "camera_height"));
  EXPECT_FALSE(report_of(judged.reports, "camera_height")->accepted);
  EXPECT_TRUE(report_of(judged.reports, "known_poses")->accepted);
  ASSERT_EQ(judged.warnings.size(), 1U);
  EXPECT_THAT(judged.warnings[0].text, HasSubstr("camera_height"));
  EXPECT_NEAR(std::sqrt(judged.contradiction_variance), std::log(1.2), 0.02);
}

TEST(ScaleStage, APlaneSearchThatTheImagesDoNotBackIsNoContradiction) {
  const MadeDrive drive = make_drive({});  // blank images
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.search = searched(std::log(1.2 / 1.65) + 0.3, true);
  const JudgedRoad judged = judged_road(drive, ground);
  EXPECT_THAT(judged.warnings, IsEmpty());
  ASSERT_TRUE(report_of(judged.reports, "plane_search"));
  EXPECT_TRUE(report_of(judged.reports, "plane_search")->accepted);
  EXPECT_GT(report_of(judged.reports, "plane_search")->residual_sigma, 3.0);
}

TEST(ScaleStage, WhatRejectedIntensitiesDifferByWidensTheScale) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  ground.rejection = "the motion would change by 5.00 standard deviations";
  ground.rejected_log_scale = 0.01;  // 1.5 sigma of the scale
  JudgedRoad judged = judged_road(drive, ground);
  EXPECT_THAT(judged.warnings, IsEmpty());
  EXPECT_NEAR(std::sqrt(judged.contradiction_variance), 0.01, 1e-9);
  ground.rejected_log_scale = std::log(0.6);
  judged = judged_road(drive, ground);
  ASSERT_EQ(judged.warnings.size(), 1u);
  EXPECT_THAT(judged.warnings[0].text,
              HasSubstr("5.00 standard deviations; by them everything is 40 % smaller"));
  EXPECT_NEAR(std::sqrt(judged.contradiction_variance), -std::log(0.6), 1e-9);
}

TEST(ScaleStage, ACameraThatLooksAsideIsNamed) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  // The same poses with the travel 0.3 rad to the right of the optical axis.
  const SE3 turn(rotation_from_vector({0.0, 0.3, 0.0}), Eigen::Vector3d::Zero());
  for (SE3& pose : ground.motion.frame_from_reference) pose = turn * pose * turn.inverse();
  const JudgedRoad judged = judged_road(drive, ground);
  ASSERT_EQ(judged.warnings.size(), 1u);
  EXPECT_THAT(judged.warnings[0].text, HasSubstr("17 degrees to the right"));
  EXPECT_NEAR(std::sqrt(judged.contradiction_variance), 0.3, 0.01);
}

TEST(ScaleStage, WithoutAPlaneUnderTheCameraThereIsNoAnswer) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.ego.points = 0;
  EXPECT_THROW(stages::scale(drive.frames, drive.matches, ground, {}), NoAnswerError);
}

/// Paints a broken line (strokes of 3 m, gaps of 6 m, 12 cm wide) and a crossing (stripes and gaps
/// of 50 cm) on the road of the reference image.
void paint(MadeDrive* drive) {
  constexpr int kSub = 4;  // samples a pixel, each way
  GrayImage& image = drive->frames.gray[drive->frames.reference];
  const SE3 level(rotation_from_vector({-0.05, 0.0, 0.0}), Eigen::Vector3d::Zero());
  for (int v = 0; v < image.height; ++v) {
    for (int u = 0; u < image.width; ++u) {
      int painted = 0;
      for (int s = 0; s < kSub * kSub; ++s) {
        const Eigen::Vector2d at(u + (s % kSub + 0.5) / kSub - 0.5,
                                 v + (s / kSub + 0.5) / kSub - 0.5);
        const double rho = drive->inverse_depth(at);
        if (!(rho > 1.0 / 44.0)) continue;
        const Eigen::Vector3d p = level * Eigen::Vector3d(drive->frames.camera.ray(at) / rho);
        const double x = p.x(), z = p.z();
        const bool stroke = std::abs(x + 1.0) < 0.06 && z > 5.0 && std::fmod(z - 5.0, 9.0) < 3.0;
        const bool stripe =
            z > 11.0 && z < 15.0 && x > -0.5 && x < 3.5 && std::fmod(x + 0.5, 1.0) < 0.5;
        painted += stroke || stripe;
      }
      image.pixels[static_cast<std::size_t>(v * image.width + u)] =
          static_cast<std::uint8_t>(90 + 110 * painted / (kSub * kSub));
    }
  }
}

TEST(ScaleStage, MarkingsOfKnownSizeGiveMetresWithoutACameraHeight) {
  MadeDrive drive = make_drive({});
  paint(&drive);
  drive.frames.known.camera_height.reset();
  drive.frames.known.markings = {3.0, 6.0, 0.12, 0.5, 0.5};
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.metres_per_baseline = 1.1;  // all that is known is that a car carries the camera
  const ScaledRoad scaled = stages::scale(drive.frames, drive.matches, ground, {});
  EXPECT_TRUE(scaled.metric);
  ASSERT_TRUE(report_of(scaled.reports, "lane_markings"));
  EXPECT_TRUE(report_of(scaled.reports, "lane_markings")->accepted)
      << report_of(scaled.reports, "lane_markings")->reason;
  EXPECT_NEAR(scaled.road.metres_per_baseline(), 1.2, 0.03 * 1.2);
  EXPECT_LT(scaled.road.scale_sigma(), 0.05);
}

TEST(ScaleStage, MarkingsThatContradictTheHeightAreNamedAndTheHeightStands) {
  MadeDrive drive = make_drive({});
  paint(&drive);
  drive.frames.known.markings = {3.0, 6.0, 0.12, 0.5, 0.5};
  const JudgedRoad right = judged_road(drive, exact_photometric(drive));
  EXPECT_THAT(right.warnings, IsEmpty());
  EXPECT_NEAR(right.road.metres_per_baseline(), 1.2, 0.01 * 1.2);
  drive.frames.known.markings = {3.75, 7.5, 0.15, 0.625, 0.625};
  const JudgedRoad wrong = judged_road(drive, exact_photometric(drive));
  EXPECT_NEAR(wrong.road.metres_per_baseline(), 1.2, 0.01 * 1.2);
  ASSERT_EQ(wrong.warnings.size(), 1u);
  EXPECT_THAT(wrong.warnings[0].text, HasSubstr("lane_markings"));
  EXPECT_GT(std::sqrt(wrong.contradiction_variance), 0.15);
}

const ScaleEvidence* evidence_named(const std::vector<ScaleEvidence>& evidence,
                                    const std::string& name) {
  for (const ScaleEvidence& e : evidence) {
    if (e.name == name) return &e;
  }
  return nullptr;
}

TEST(JudgeStage, TheEvidenceIsWhatEachSourceMeasuresByItself) {
  MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  ground.motion.metres_per_baseline = ground.ground.metres_per_baseline = 1.2;
  ground.motion.baseline_sigma = 0.01;
  *drive.frames.known.camera_height *= 1.2;
  const JudgedRoad judged = judged_road(drive, ground);
  const ScaleEvidence* height = evidence_named(judged.evidence, "camera_height");
  ASSERT_TRUE(height);
  // Over the scale of the poses, which stands; to first order.
  EXPECT_NEAR(height->log_scale, std::log(1.2), 0.02);
  EXPECT_NEAR(height->sigma, std::hypot(0.01 / 1.65 / 1.2, 0.002), 1e-3);
  EXPECT_EQ(height->cause, EvidenceCause::kHeight);
  const ScaleEvidence* poses = evidence_named(judged.evidence, "known_poses");
  ASSERT_TRUE(poses);
  EXPECT_NEAR(poses->log_scale, 0.0, 1e-6);
  EXPECT_NEAR(poses->sigma, 0.01, 1e-4);
  const ScaleEvidence* layer = evidence_named(judged.evidence, "road_layer");
  ASSERT_TRUE(layer);
  EXPECT_TRUE(std::isnan(layer->sigma));
  EXPECT_FALSE(layer->measured.empty());
}

TEST(JudgeStage, AnotherLayerIsTheLikelierTheLessOfTheRoadIsFoundAndAgrees) {
  RoadLayer layer;
  layer.masked = true;
  layer.search = RoadLayer::Search::kInformative;
  const double sound = layer.log_odds();
  EXPECT_LT(sound, -3.0);
  RoadLayer unfound = layer, disagreeing = layer, elsewhere = layer, blocked = layer;
  unfound.found = 0.1;
  disagreeing.agreeing = 0.3;
  elsewhere.off_road = 0.7;
  blocked.obstacles = 0.2;
  for (const RoadLayer& other : {unfound, disagreeing, elsewhere, blocked}) {
    EXPECT_GT(other.log_odds(), 0.0);
  }
  EXPECT_NEAR(evidence_of(layer).wrong_share, 1.0 / (1.0 + std::exp(-sound)), 1e-12);
}

TEST(JudgeStage, WhereThereIsNoAnswerTheErrorHasTheEvidence) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.ego.points = 100;
  ground.ground.ego.compared = 400;
  try {
    judged_road(drive, ground);
    FAIL() << "an answer";
  } catch (const UnknownScaleError& error) {
    EXPECT_THAT(error.what(), HasSubstr("25 % of the points near the driven path agree"));
    EXPECT_TRUE(evidence_named(error.evidence(), "camera_height"));
    EXPECT_TRUE(evidence_named(error.evidence(), "road_layer"));
  }
}

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
