#include "camber/pipeline/find_keypoints.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "camber/core/errors.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using testing::HasSubstr;

VehicleDetection vehicle(int id, const Box2& box, const std::string& name = "car") {
  VehicleDetection out;
  out.id = id;
  out.box = box;
  out.vehicle_class = name;
  return out;
}

class FindKeypoints : public ::testing::Test {
 protected:
  FindKeypoints() {
    scene_.camera.width = 160;
    scene_.camera.height = 120;
    scene_.camera.fx = scene_.camera.fy = 100.0;
    scene_.camera.cx = 80.0;
    scene_.camera.cy = 60.0;
    scene_.detections_source = "truth_boxes";
    test::write_png(folder_.path() / "0.png", 160, 120, 2, 8, test::picture(160, 120, 3));
    for (int id = 0; id < 2; ++id) {
      SceneFrame frame;
      frame.id = id;
      frame.image = folder_.path() / "0.png";
      scene_.frames.push_back(frame);
    }
    for (int i = 0; i < 20; ++i) {  // more than a batch
      scene_.frames[0].vehicles.push_back(vehicle(i, {5.0 + i, 20.0, 60.0 + 2 * i, 70.0}));
    }
    scene_.frames[1].vehicles = {vehicle(1, {90.0, 30.0, 150.0, 80.0}),
                                 vehicle(2, {10.0, 30.0, 80.0, 80.0}, "truck"),
                                 vehicle(3, {-30.0, 90.0, 50.0, 119.0})};
  }
  test::TemporaryFolder folder_;
  Scene scene_;
  std::vector<int> frames_ = {0, 1};
};

TEST_F(FindKeypoints, FillsBoxesOfCars) {
  const auto use = find_keypoints(&scene_, frames_, {});
  ASSERT_TRUE(use);
  EXPECT_EQ(use->computed, 22);
  EXPECT_EQ(use->file, "shipped");
  EXPECT_EQ(scene_.detections_source, "truth_boxes, keypoints shipped:" + use->hash);
  EXPECT_TRUE(scene_.frames[1].vehicles[1].keypoints.empty()) << "a truck has no keypoint shape";
  for (const int i : {0, 2}) {
    const VehicleDetection& v = scene_.frames[1].vehicles[static_cast<std::size_t>(i)];
    ASSERT_EQ(v.keypoints.size(), 36u);
    for (const KeypointObservation& k : v.keypoints) {
      EXPECT_TRUE(v.box.scaled(1.16 * v.box.width() / v.box.height()).contains(k.pixel));
      EXPECT_GT(k.sigma, 0.0);
      EXPECT_GE(k.confidence, 0.0);
      EXPECT_LE(k.confidence, 1.0);
    }
  }
}

TEST_F(FindKeypoints, TheSameForAnyNumberOfThreadsAndAnyOtherVehicles) {
  Scene one = scene_, many = scene_, few = scene_;
  few.frames[0].vehicles.resize(1);
  FindKeypointsOptions options;
  options.num_threads = 1;
  find_keypoints(&one, frames_, options);
  options.num_threads = 5;
  find_keypoints(&many, frames_, options);
  find_keypoints(&few, frames_, options);
  for (std::size_t k = 0; k < 36; ++k) {
    for (std::size_t i = 0; i < 20; ++i) {
      EXPECT_EQ(one.frames[0].vehicles[i].keypoints[k].pixel,
                many.frames[0].vehicles[i].keypoints[k].pixel);
    }
    EXPECT_EQ(one.frames[1].vehicles[0].keypoints[k].sigma,
              few.frames[1].vehicles[0].keypoints[k].sigma);
    EXPECT_EQ(one.frames[0].vehicles[0].keypoints[k].pixel,
              few.frames[0].vehicles[0].keypoints[k].pixel);
  }
}

TEST_F(FindKeypoints, LeavesGivenOnesUnlessItIsAskedFor) {
  scene_.frames[1].vehicles[0].keypoints.resize(36);
  FindKeypointsOptions options;
  EXPECT_FALSE(find_keypoints(&scene_, frames_, options));
  EXPECT_TRUE(scene_.frames[0].vehicles[0].keypoints.empty());
  EXPECT_EQ(scene_.detections_source, "truth_boxes");
  EXPECT_TRUE(find_keypoints(&scene_, {0}, options)) << "of frames without them";
  options.choice = KeypointChoice::kNone;
  scene_.frames[1].vehicles[0].keypoints.clear();
  EXPECT_FALSE(find_keypoints(&scene_, {1}, options));
  options.choice = KeypointChoice::kAll;
  scene_.frames[1].vehicles[0].keypoints.resize(36);
  EXPECT_TRUE(find_keypoints(&scene_, frames_, options));
  EXPECT_GT(scene_.frames[1].vehicles[0].keypoints[0].sigma, 0.0);
}

TEST_F(FindKeypoints, NeedsImages) {
  scene_.frames[1].image.clear();
  EXPECT_FALSE(find_keypoints(&scene_, frames_, {}));
  FindKeypointsOptions options;
  options.choice = KeypointChoice::kAll;
  EXPECT_THROW(find_keypoints(&scene_, frames_, options), NoAnswerError);
  EXPECT_THROW(find_keypoints(&scene_, {5}, options), std::invalid_argument);
}

TEST_F(FindKeypoints, RefusesFilesThatAreNoKeypointNetwork) {
  FindKeypointsOptions options;
  options.choice = KeypointChoice::kAll;
  options.network = folder_.path() / "own.onnx";
  const auto refused = [&] {
    try {
      find_keypoints(&scene_, frames_, options);
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("taken");
  };
  EXPECT_THAT(refused(), HasSubstr("own.json: no such file"));
  const auto side = [&](const std::string& keys) {
    std::ofstream(folder_.path() / "own.json")
        << R"({"format": "camber-network", "version": 1, "task": "keypoints", )" << keys << "}";
  };
  side(R"("input": {"width": 64, "height": 64}, "head": "other")");
  EXPECT_THAT(refused(), HasSubstr("head: found \"other\", expected one of hourglass"));
  side(R"("input": {"width": 64, "height": 32}, "head": "hourglass")");
  EXPECT_THAT(refused(), HasSubstr("input.height: 32, must be 64"));
  side(R"("input": {"width": 64, "height": 64}, "head": "hourglass",
         "sigma_scale": {"visible": 1, "hidden": 0})");
  EXPECT_THAT(refused(), HasSubstr("sigma_scale.hidden"));
  side(R"("input": {"width": 64, "height": 64}, "head": "hourglass")");
  EXPECT_THAT(refused(), HasSubstr("own.onnx"));
  std::ofstream(folder_.path() / "own.onnx") << "no network";
  EXPECT_THAT(refused(), HasSubstr("own.onnx: found no network"));
}

}  // namespace
}  // namespace camber
