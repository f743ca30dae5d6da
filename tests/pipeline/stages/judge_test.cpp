// Whether a run's scale is believed, on a plane between walls.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>

#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "pipeline/made_drive.h"

namespace camber {
namespace {

using test::exact_photometric;
using test::judged_road;
using test::MadeDrive;
using test::MadeDriveOptions;
using test::make_drive;
using test::paint_markings;
using test::report_of;
using test::searched;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(JudgeStage, WhatNothingContradictsStaysAsItIs) {
  const MadeDrive drive = make_drive({});
  const PhotometricGround ground = exact_photometric(drive);
  const ScaledRoad scaled = stages::scale(drive.frames, drive.matches, ground, {});
  const JudgedRoad judged = judged_road(drive, ground);
  EXPECT_THAT(judged.warnings, IsEmpty());
  EXPECT_EQ(judged.contradiction_variance, 0.0);
  EXPECT_EQ(judged.scale.sigma, scaled.road.scale_sigma());
}

TEST(JudgeStage, PointsThatAgreeOnNoRoadGiveNoScale) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.ego.points = 400;
  ground.ground.ego.compared = 790;
  EXPECT_NO_THROW(judged_road(drive, ground));
  ground.ground.ego.compared = 810;
  EXPECT_THROW(judged_road(drive, ground), NoAnswerError);
}

TEST(JudgeStage, ARoadThatIsHardlyFoundDoesNotGiveTheScale) {
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
  EXPECT_EQ(judged.scale.status, Status::kWeak);
  EXPECT_GT(judged.scale.sigma, 0.2);                         // it may be off by half
  EXPECT_NEAR(judged.road.metres_per_baseline(), 1.2, 1e-3);  // the answer stands
}

TEST(JudgeStage, AMaskedRoadOnWhichTheCameraWouldRunIntoTheWallsIsNone) {
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

TEST(JudgeStage, TheLessOfTheRoadIsFoundTheLessTheScaleIsKnown) {
  const MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  TriangulatedPoints& points = ground.ground.seen.points;
  const double scale_sigma = judged_road(drive, ground).scale.sigma;
  const auto widened_where = [&](double share) {
    points.dropped = {};
    points.dropped[0] = std::lround(static_cast<double>(points.size()) * (1.0 / share - 1.0));
    const JudgedRoad judged = judged_road(drive, ground);
    EXPECT_THAT(judged.warnings, IsEmpty());
    return std::sqrt(judged.contradiction_variance);
  };
  EXPECT_NEAR(widened_where(1.0), 0.0, 1e-9);
  EXPECT_GT(widened_where(0.9), 0.0);
  EXPECT_GT(widened_where(0.6), widened_where(0.9));
  // A road that is found as most are is known as well as before.
  EXPECT_LT(widened_where(0.9), 0.2 * scale_sigma);
  // A wet road of which 0.4 was found was 7.7 % off at a stated 1.4 %.
  EXPECT_GT(2.5 * std::hypot(0.014, widened_where(0.4)), 0.077);
}

TEST(JudgeStage, WhatRoadsFromOtherStartsDifferByIsInItsSigma) {
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

TEST(JudgeStage, AScaleThatIsHardlyKnownIsNoneWhereThePicturesRepeatTheRoad) {
  MadeDrive drive = make_drive({});
  PhotometricGround ground = exact_photometric(drive);
  const auto textured = [&](std::uint64_t differs) {  // 0: all pictures alike
    for (std::size_t k = 0; k < drive.frames.size(); ++k) {
      const CounterRandom random(differs * k);
      std::uint64_t i = 0;
      for (std::uint8_t& pixel : drive.frames.gray[k].pixels) {
        pixel = static_cast<std::uint8_t>(random.below(i++, 200));
      }
    }
  };
  textured(0);
  ground.ground.alternative_spread = 0.04;
  EXPECT_TRUE(judged_road(drive, ground).metric);
  ground.ground.alternative_spread = 0.3;
  const JudgedRoad none = judged_road(drive, ground);
  EXPECT_FALSE(none.metric);
  EXPECT_EQ(none.scale.status, Status::kNotObservable);
  EXPECT_THAT(none.scale.reason, HasSubstr("repeat the asphalt"));
  textured(1);
  const JudgedRoad weak = judged_road(drive, ground);
  EXPECT_TRUE(weak.metric);
  EXPECT_EQ(weak.scale.status, Status::kWeak);
}

TEST(JudgeStage, ARoadWithMuchElseOverItDoesNotGiveTheScaleWithoutAMask) {
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
  EXPECT_EQ(judged.scale.status, Status::kWeak);
  EXPECT_GT(judged.scale.sigma, 0.2);  // it may be off by half
  // Beside the path they stand on no road that is driven.
  for (Eigen::Vector3d& ray : others.rays) ray.x() += 2.0;
  EXPECT_THAT(judged_road(drive, ground).warnings, IsEmpty());
}

TEST(JudgeStage, AHeightBesideKnownPosesIsComparedWithThem) {
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

TEST(JudgeStage, APlaneSearchThatTheImagesDoNotBackIsNoContradiction) {
  const MadeDrive drive = make_drive({});  // blank images
  PhotometricGround ground = exact_photometric(drive);
  ground.ground.search = searched(std::log(1.2 / 1.65) + 0.3, true);
  const JudgedRoad judged = judged_road(drive, ground);
  EXPECT_THAT(judged.warnings, IsEmpty());
  ASSERT_TRUE(report_of(judged.reports, "plane_search"));
  EXPECT_TRUE(report_of(judged.reports, "plane_search")->accepted);
  EXPECT_GT(report_of(judged.reports, "plane_search")->residual_sigma, 3.0);
}

TEST(JudgeStage, WhatRejectedIntensitiesDifferByWidensTheScale) {
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

TEST(JudgeStage, ACameraThatLooksAsideIsNamed) {
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

TEST(JudgeStage, MarkingsThatContradictTheHeightAreNamedAndTheHeightStands) {
  MadeDrive drive = make_drive({});
  paint_markings(&drive);
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

}  // namespace
}  // namespace camber
