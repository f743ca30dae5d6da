// The stages that look at images, each by itself, on small drawn ones.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/image/frame_pixels.h"
#include "camber/image/image_io.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/match.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/pipeline/stages/scale.h"
#include "camber/scale/scale_noise.h"
#include "pipeline/made_drive.h"
#include "scene/write_image.h"
#include "support/drawn_road.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

class LoadStage : public ::testing::Test {
 protected:
  static constexpr int kWidth = 40, kHeight = 20;

  void SetUp() override {
    scene_.camera = {kWidth, kHeight, 30.0, 30.0, 20.0, 8.0};
    scene_.height_above_road = 1.5;
    scene_.height_sigma = 0.03;
    scene_.frame_rate = 5.0;
    scene_.detections_source = "by hand";
    scene_.markings_m = {{"dash_length", 3.0}, {"zebra_gap", 0.5}};
    scene_.segmentation_classes = {{"road", {7}}, {"pavement", {8}}};
    for (int k = 0; k < 3; ++k) {
      SceneFrame frame;
      frame.id = 20 + k;
      frame.image = folder_.path() / ("image" + std::to_string(k) + ".png");
      std::vector<std::uint8_t> gray(static_cast<std::size_t>(kWidth * kHeight),
                                     static_cast<std::uint8_t>(50 + k));
      test::write_png(frame.image, kWidth, kHeight, 0, 8, gray);
      frame.segmentation = folder_.path() / ("labels" + std::to_string(k) + ".png");
      // Sky above row 10; road left of column 25, pavement right of it.
      std::vector<std::uint8_t> labels(gray.size(), 0);
      for (int v = 10; v < kHeight; ++v) {
        for (int u = 0; u < kWidth; ++u) {
          labels[static_cast<std::size_t>(v * kWidth + u)] = u < 25 ? 7 : 8;
        }
      }
      test::write_png(frame.segmentation, kWidth, kHeight, 0, 8, labels);
      scene_.frames.push_back(frame);
    }
  }

  std::string refusal(const std::vector<int>& ids) const {
    try {
      stages::load(scene_, ids, {});
    } catch (const NoAnswerError& error) {
      return error.what();
    }
    return "accepted";
  }

  test::TemporaryFolder folder_;
  Scene scene_;
};

TEST_F(LoadStage, ReadsImagesMasksAndWhatIsKnown) {
  const LoadedFrames found = stages::load(scene_, {20, 21, 22}, {});
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(found.reference, 1u);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(found.frames[k].id, 20 + static_cast<int>(k));
    EXPECT_EQ(found.gray[k].pixels[5], 50 + k);
    EXPECT_EQ(found.color[k].channels, 3);
    EXPECT_EQ(found.color[k].data[5], 50 + k);
  }
  EXPECT_TRUE(found.has_masks());
  const FrameMasks& masks = found.reference_masks();
  const auto at = [](int u, int v) { return static_cast<std::size_t>(v * kWidth + u); };
  EXPECT_FALSE(masks.ground[at(5, 5)]);
  EXPECT_TRUE(masks.ground[at(5, 15)] && masks.roadway[at(5, 15)]);
  EXPECT_TRUE(masks.ground[at(30, 15)] && !masks.roadway[at(30, 15)]);
  EXPECT_EQ(found.known.camera_height, 1.5);
  EXPECT_EQ(found.known.camera_height_sigma, 0.03);
  EXPECT_EQ(found.known.markings.dash_length, 3.0);
  EXPECT_EQ(found.known.markings.stripe_gap, 0.5);
  EXPECT_EQ(found.known.markings.line_width, 0.0);
  EXPECT_EQ(found.frame_rate, 5.0);
  EXPECT_EQ(found.detections_source, "by hand");
  ASSERT_EQ(found.input_hashes.size(), 6u);
  EXPECT_NE(found.input_hashes[0].second, found.input_hashes[2].second);  // two images
  EXPECT_EQ(found.input_hashes[1].second, found.input_hashes[3].second);  // equal labels
}

TEST_F(LoadStage, PixelsInMemoryAreAsThoseOfFiles) {
  const LoadedFrames read = stages::load(scene_, {20, 21, 22}, {});
  std::map<int, FramePixels> pixels;
  for (SceneFrame& frame : scene_.frames) {
    if (frame.id == 21) continue;  // this one stays a file
    FramePixels& held = pixels[frame.id];
    held.image = read_gray_image(frame.image);
    held.segmentation = read_label_image(frame.segmentation, scene_.camera);
    frame.image.clear();
    frame.segmentation.clear();
  }
  stages::LoadOptions options;
  options.pixels = pixels_in_memory(pixels);
  const LoadedFrames held = stages::load(scene_, {20, 21, 22}, options);
  ASSERT_EQ(held.size(), 3u);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(held.gray[k].pixels, read.gray[k].pixels) << k;
    EXPECT_EQ(held.color[k].data, read.color[k].data) << k;
    EXPECT_EQ(held.masks[k].ground, read.masks[k].ground) << k;
    EXPECT_EQ(held.masks[k].roadway, read.masks[k].roadway) << k;
    EXPECT_TRUE(held.masks[k].has_mask) << k;
  }
  ASSERT_EQ(held.input_hashes.size(), 6u);
  EXPECT_EQ(held.input_hashes[0].first, "frame 20: image");
  EXPECT_EQ(held.input_hashes[2], read.input_hashes[2]);
  EXPECT_EQ(held.input_hashes[5].first, "frame 22: segmentation");
  EXPECT_NE(held.input_hashes[0].second, held.input_hashes[4].second);
}

TEST_F(LoadStage, ARoadMaskInMemoryIsRead) {
  std::vector<int> asked;
  stages::LoadOptions options;
  for (SceneFrame& frame : scene_.frames) frame.segmentation.clear();
  options.pixels = [&](int id) {
    asked.push_back(id);
    FramePixels out;  // the images are the files'
    out.road_mask = {kWidth, kHeight, 1, {}};
    out.road_mask.data.assign(static_cast<std::size_t>(kWidth * kHeight), 0);
    out.road_mask.data.back() = 255;
    return out;
  };
  const LoadedFrames found = stages::load(scene_, {20, 22}, options);
  EXPECT_THAT(asked, ElementsAre(20, 22));
  EXPECT_TRUE(found.has_masks());
  EXPECT_TRUE(found.reference_masks().roadway.back());
  EXPECT_EQ(std::count(found.masks[0].ground.begin(), found.masks[0].ground.end(), 1), 1);
}

TEST_F(LoadStage, PixelsThatDoNotFitTheCameraAreNamed) {
  const auto message = [&](const FramePixels& pixels) -> std::string {
    stages::LoadOptions options;
    options.pixels = pixels_in_memory({{21, pixels}});
    try {
      stages::load(scene_, {20, 21}, options);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "accepted";
  };
  FramePixels pixels;
  pixels.image = {kWidth, kHeight - 1, 3, std::vector<std::uint8_t>(kWidth * (kHeight - 1) * 3)};
  EXPECT_EQ(message(pixels),
            "image of frame 21: found 40 x 19 pixels of 3 channels, expected the camera's 40 x 20 "
            "of 1 or 3");
  pixels.image.height = kHeight;
  EXPECT_EQ(message(pixels), "image of frame 21: found 2280 bytes, expected 2400");
  pixels.image = {};
  pixels.segmentation = {kWidth, kHeight, 3, std::vector<std::uint8_t>(kWidth * kHeight * 3)};
  EXPECT_THAT(message(pixels), HasSubstr("segmentation of frame 21: found 40 x 20 pixels of 3"));
  scene_.frames[1].image.clear();
  EXPECT_THAT(refusal({20, 21}), HasSubstr("frame 21 has no image"));
}

TEST_F(LoadStage, LeavesMasksUnreadIfAsked) {
  scene_.frames[1].segmentation = folder_.path() / "missing.png";
  EXPECT_THROW(stages::load(scene_, {20, 21}, {}), InputError);
  stages::LoadOptions options;
  options.use_masks = false;
  EXPECT_FALSE(stages::load(scene_, {20, 21}, options).has_masks());
}

TEST_F(LoadStage, BoxesBesideTheScenesAreMaskedAndNotEstimated) {
  stages::LoadOptions options;
  options.use_masks = false;
  options.vehicle_boxes[21] = {{5.0, 12.0, 14.0, 17.0}};
  const LoadedFrames frames = stages::load(scene_, {20, 21, 22}, options);
  const std::size_t inside = 14 * kWidth + 10;
  EXPECT_TRUE(frames.masks[1].vehicle[inside]);
  EXPECT_FALSE(frames.masks[1].ground[inside]);
  EXPECT_FALSE(frames.masks[0].vehicle[inside]);
  EXPECT_TRUE(frames.masks[0].ground[inside]);
  EXPECT_TRUE(frames.frames[1].vehicles.empty());
}

TEST_F(LoadStage, SaysWhyItHasNoAnswer) {
  EXPECT_THAT(refusal({20}), HasSubstr("at least 2 frames are needed, 1 given"));
  scene_.frames[2].image = scene_.frames[0].image;
  EXPECT_THAT(refusal({20, 21, 22}), HasSubstr("frames 20 and 22 have the same image"));
  scene_.frames[2].image.clear();
  EXPECT_THAT(refusal({20, 21, 22}), HasSubstr("frame 22 has no image"));
  EXPECT_THROW(stages::load(scene_, {20, 23}, {}), std::invalid_argument);
}

/// Three drawn images of a level street, 0.9 m apart, with their true motion and ground.
class DrawnStreet : public ::testing::Test {
 protected:
  static constexpr double kStep = 0.9, kHeight = 1.65;  // m

  static void SetUpTestSuite() {
    test::MadeDriveOptions options;
    options.pitch = 0.0;
    options.stations = {-kStep, 0.0, kStep};
    drive_ = std::make_unique<test::MadeDrive>(test::make_drive(options));
    test::DrawnRoad road;
    for (const double side : {-1.0, 1.0}) {
      for (int i = 0; i < 5; ++i) {  // houses
        const double z = 12.0 + 6.0 * i;
        road.boards.push_back({z, std::min(5.0 * side, 14.0 * side),
                               std::max(5.0 * side, 14.0 * side), -4.0, 3.0, 0.0});
      }
    }
    for (std::size_t k = 0; k < 3; ++k) {
      const SE3 pose = metric_pose(drive_->motion, k, kStep).inverse();
      drive_->frames.gray[k].pixels =
          test::draw_road(road, drive_->frames.camera, pose, static_cast<int>(k));
    }
  }
  static void TearDownTestSuite() { drive_.reset(); }

  /// Median and 90th percentile of how far matches on the road miss where its points are seen, px.
  static std::pair<double, double> misses(const Correspondences& found) {
    std::vector<double> errors;
    for (const MatchedImage& match : found.matches) {
      const SE3 pose = metric_pose(drive_->motion, static_cast<std::size_t>(match.frame), kStep);
      for (std::size_t i = 0; i < found.pixels.size(); ++i) {
        const Eigen::Vector2d pixel = found.pixels[i].cast<double>();
        const double rho = drive_->inverse_depth(pixel);
        if (!(rho > 1.0 / 25.0) || !std::isfinite(match.round_trip_px[i])) continue;
        const Eigen::Vector3d p = drive_->frames.camera.ray(pixel) / rho;
        const auto seen = drive_->frames.camera.project(pose * p);
        if (std::abs(p.x()) > 4.0 || !seen || !drive_->frames.camera.contains(*seen, 8.0)) continue;
        errors.push_back((match.pixels[i].cast<double>() - *seen).norm());
      }
    }
    std::sort(errors.begin(), errors.end());
    if (errors.size() < 1000) return {1e9, 1e9};
    return {errors[errors.size() / 2], errors[errors.size() * 9 / 10]};
  }

  static std::unique_ptr<test::MadeDrive> drive_;
};
std::unique_ptr<test::MadeDrive> DrawnStreet::drive_;

TEST_F(DrawnStreet, MatchFindsWhereTheRoadIsSeen) {
  stages::MatchOptions options;
  options.flow.step = 4;
  const Correspondences found = stages::match(drive_->frames, options);
  EXPECT_EQ(found.reference, 1);
  EXPECT_EQ(found.columns, 160);
  EXPECT_EQ(found.rows, 60);
  ASSERT_EQ(found.matches.size(), 2u);
  EXPECT_EQ(found.matches[1].frame, 2);
  const auto [median, most] = misses(found);
  // A patch of the flow moves as a whole, the fast near road grows within it.
  EXPECT_LT(median, 0.7);  // 0.50 measured
  EXPECT_LT(most, 2.0);    // 1.53 measured
}

TEST_F(DrawnStreet, MotionComesFromFeaturesWhereTheFlowIsLost) {
  // A flow that follows another motion, a turn by 3 degrees, and in part nothing at all.
  const PinholeCamera& camera = drive_->frames.camera;
  Correspondences lost = drive_->matches;
  const Eigen::Quaterniond turn = rotation_from_vector({0.0, 0.052, 0.0});
  for (MatchedImage& match : lost.matches) {
    const CounterRandom random(5, static_cast<std::uint64_t>(match.frame));
    for (std::size_t i = 0; i < match.pixels.size(); ++i) {
      const auto seen = camera.project(turn * camera.ray(match.pixels[i].cast<double>()));
      if (!seen || random.uniform(2 * i) < 0.3) {
        match.pixels[i] += 40.0F * Eigen::Vector2f(static_cast<float>(random.uniform(2 * i)),
                                                   static_cast<float>(random.uniform(2 * i + 1)));
      } else {
        match.pixels[i] = seen->cast<float>();
      }
    }
  }
  const auto worst_turn = [&](const MotionEstimate& found) {
    double worst = 0.0;
    for (const std::size_t k : {std::size_t{0}, std::size_t{2}}) {
      const SE3 off =
          found.frame_from_reference[k] * drive_->motion.frame_from_reference[k].inverse();
      worst = std::max(worst, rotation_to_vector(off.rotation()).norm());
    }
    return worst;
  };
  const MotionEstimate by_flow =
      estimate_motion(camera, lost, std::vector<std::uint8_t>(lost.pixels.size(), 1), {});
  EXPECT_GT(worst_turn(by_flow), 0.04);
  EXPECT_LT(worst_turn(stages::motion(drive_->frames, lost, {})), 0.004);

  // With a sound flow the features change nothing.
  const MotionEstimate sound = stages::motion(drive_->frames, drive_->matches, {});
  EXPECT_GT(sound.inlier_ratio, 0.85);
  EXPECT_LT(worst_turn(sound), 1e-3);
}

TEST_F(DrawnStreet, MatchAgainUsesTheGroundAndTheMotion) {
  stages::MatchOptions options;
  options.flow.step = 4;
  // Without a flow of its own: from nothing but the prediction.
  Correspondences before = drive_->matches;
  for (MatchedImage& match : before.matches) {
    std::fill(match.pixels.begin(), match.pixels.end(), Eigen::Vector2f(0.0f, 0.0f));
  }
  const auto again = [&](double height, bool last = false) {
    test::MadeDriveOptions other;
    other.pitch = 0.0;
    other.height = height;
    other.stations = {-kStep, 0.0, kStep};
    return misses(stages::match_again(drive_->frames, before, drive_->motion,
                                      exact_ground(test::make_drive(other)), last, options));
  };
  const auto [median, most] = again(kHeight);
  EXPECT_LT(median, 0.3);  // 0.22 measured
  EXPECT_LT(most, 0.8);    // 0.60 measured
  // A ground that is 10 % too low predicts the near road some pixels wrong.
  const double off = again(1.1 * kHeight).first, off_last = again(1.1 * kHeight, true).first;
  EXPECT_GT(off, 1.2 * median);
  // Of the prediction's error the smooth flow keeps 0.08 px, the full resolution 0.01 (measured).
  EXPECT_LT(off_last - again(kHeight, true).first, 0.5 * (off - median));
}

TEST_F(DrawnStreet, PlaneSearchFindsTheBaselineFromNoStart) {
  const PlaneSearchResult found = stages::search_plane(drive_->frames, drive_->motion, {});
  EXPECT_TRUE(found.informative);
  EXPECT_NEAR(found.best.log_baseline, std::log(kStep / kHeight),
              2.0 * ScaleNoise().searched_height);
  EXPECT_NEAR(found.best.curvature, 0.0, 0.01);
  EXPECT_NEAR(found.best.roll, 0.0, 0.01);
}

TEST_F(DrawnStreet, PlaneSearchLooksBesideAVehicleThatHidesTheDrivenCorridor) {
  LoadedFrames frames = drive_->frames;
  const PinholeCamera& camera = frames.camera;
  for (FrameMasks& masks : frames.masks) {
    for (int v = 0; v < camera.height; ++v) {
      for (int u = 0; u < camera.width; ++u) {
        const double below = (v - camera.cy) / camera.fy;
        const bool ahead = std::abs((u - camera.cx) / camera.fx) * kHeight < 1.2 * below;
        masks.vehicle[static_cast<std::size_t>(v * camera.width + u)] |= ahead;
      }
    }
  }
  const PlaneSearchResult found = stages::search_plane(frames, drive_->motion, {});
  EXPECT_TRUE(found.informative);
  EXPECT_GT(found.half_width, PlaneSearchOptions().half_width);
  EXPECT_NEAR(found.best.log_baseline, std::log(kStep / kHeight),
              2.0 * ScaleNoise().searched_height);
}

TEST_F(DrawnStreet, PlaneSearchOnBlankImagesIsNotInformative) {
  const test::MadeDrive blank = test::make_drive({});
  EXPECT_FALSE(stages::search_plane(blank.frames, blank.motion, {}).informative);
}

TEST_F(DrawnStreet, AnEgoPlaneThatThePlaneSearchContradictsWidensTheScale) {
  const auto judged_with = [&](double height) {
    test::MadeDriveOptions options;
    options.pitch = 0.0;
    options.height = height;
    options.stations = {-kStep, 0.0, kStep};
    const test::MadeDrive found = test::make_drive(options);
    PhotometricGround ground = exact_photometric(found);
    ground.ground.metres_per_baseline = kStep * kHeight / height;  // by the camera's height
    ground.ground.search = stages::search_plane(drive_->frames, drive_->motion, {});
    return test::judged_road(drive_->frames, found.matches, ground);
  };
  EXPECT_TRUE(judged_with(kHeight).warnings.empty());
  // By an ego plane that is 30 % too low the same camera height gives a scale 30 % too small.
  const JudgedRoad judged = judged_with(1.3 * kHeight);
  EXPECT_NEAR(judged.road.metres_per_baseline(), kStep / 1.3, 0.01);  // the given metres stand
  ASSERT_EQ(judged.warnings.size(), 1u);
  EXPECT_THAT(judged.warnings[0].text, HasSubstr("plane_search"));
  EXPECT_THAT(judged.warnings[0].text, HasSubstr("larger"));
  EXPECT_NEAR(std::sqrt(judged.contradiction_variance), std::log(1.3),
              2.0 * ScaleNoise().searched_height);
}

TEST_F(DrawnStreet, PhotometricRefinementHandsOnHowManyPointsAgreedBefore) {
  Ground before = exact_ground(*drive_);
  before.ego.points = 195;
  before.ego.compared = 752;
  EXPECT_DOUBLE_EQ(
      stages::refine_photometrically(drive_->frames, drive_->matches, drive_->motion, before, {})
          .agreeing_before,
      195.0 / 752.0);
}

TEST_F(DrawnStreet, PhotometricRefinementMovesAWrongGroundToTheRightOne) {
  // A ground 2 % too low, by matches that are known no better than that.
  test::MadeDriveOptions options;
  options.pitch = 0.0;
  options.height = 1.02 * kHeight;
  options.stations = {-kStep, 0.0, kStep};
  test::MadeDrive low = test::make_drive(options);
  Ground before = exact_ground(low);
  const PhotometricGround found =
      stages::refine_photometrically(drive_->frames, low.matches, drive_->motion, before, {});
  ASSERT_TRUE(found.field) << found.rejection;
  EXPECT_EQ(found.rejection, "");
  const DirectEvidence::Costs costs = found.evidence.within({0.0, 0.0}, {640.0, 240.0});
  EXPECT_GT(costs.pixels, 200.0);
  EXPECT_LT(costs.after, costs.before);
  double wrong_before = 0.0, wrong_after = 0.0;
  for (double z = 6.0; z <= 14.0; z += 2.0) {
    const Eigen::Vector2d pixel = *drive_->frames.camera.project({0.5, kHeight, z});
    wrong_before =
        std::max(wrong_before, std::abs(kStep / before.field->inverse_depth(pixel) / z - 1.0));
    wrong_after =
        std::max(wrong_after, std::abs(kStep / found.field->inverse_depth(pixel) / z - 1.0));
  }
  EXPECT_GT(wrong_before, 0.019);
  EXPECT_LT(wrong_after, 0.008);
  EXPECT_NEAR(found.ground.ego.height, kHeight / kStep, 0.008 * kHeight / kStep);
}

TEST_F(DrawnStreet, PhotometricRefinementLeavesBlankImagesAlone) {
  const test::MadeDrive blank = test::make_drive({});
  const Ground before = exact_ground(blank);
  const PhotometricGround found =
      stages::refine_photometrically(blank.frames, blank.matches, blank.motion, before, {});
  EXPECT_FALSE(found.field);
  EXPECT_NE(found.rejection, "");
  EXPECT_EQ(found.ground.field, before.field);
  EXPECT_EQ(found.ground.ego.height, before.ego.height);
}

}  // namespace
}  // namespace camber
