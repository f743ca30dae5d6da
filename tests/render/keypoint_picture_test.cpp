#include "camber/render/keypoint_picture.h"

#include <gtest/gtest.h>

namespace camber {
namespace {

TEST(KeypointPicture, IsTheSameEveryTime) {
  const ShapePrior& prior = shipped_vehicle_prior().shapes.front();
  const Image picture = draw_keypoint_picture(prior);
  EXPECT_EQ(picture.channels, 3);
  EXPECT_EQ(picture.data, draw_keypoint_picture(prior).data);
}

TEST(KeypointPicture, ShowsEveryPoint) {
  const ShapePrior& prior = shipped_vehicle_prior().shapes.front();
  const Image picture = draw_keypoint_picture(prior);
  for (int i = 0; i < kNumSideKeypoints; ++i) {
    ShapePrior moved = prior;
    moved.mean(1, i) += 0.05;
    EXPECT_NE(draw_keypoint_picture(moved).data, picture.data) << i;
  }
}

}  // namespace
}  // namespace camber
