#include "camber/image/frame_masks.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <vector>

namespace camber {
namespace {

const PinholeCamera kCamera{40, 20, 30.0, 30.0, 20.0, 10.0};

/// Road (1) with a vehicle (3) of 4 x 3 pixels.
MaskInputs road_with_a_vehicle() {
  MaskInputs inputs;
  Image labels{40, 20, 1, std::vector<std::uint8_t>(800, 1)};
  for (std::size_t v = 10; v < 13; ++v) {
    for (std::size_t u = 5; u < 9; ++u) labels.data[v * 40 + u] = 3;
  }
  inputs.segmentation = labels;
  inputs.classes.road = {1};
  inputs.classes.vehicle = {3};
  return inputs;
}

TEST(FrameMasks, VehiclesOfTheSegmentationAreKeptWithoutTheirMargin) {
  const FrameMasks masks = make_frame_masks(kCamera, road_with_a_vehicle());
  ASSERT_EQ(masks.vehicle_class.size(), 800u);
  EXPECT_EQ(std::count(masks.vehicle_class.begin(), masks.vehicle_class.end(), 1), 4 * 3);
  EXPECT_EQ(std::count(masks.vehicle.begin(), masks.vehicle.end(), 1), 10 * 9);  // 3 px around
  EXPECT_EQ(masks.vehicle_class[10 * 40 + 5], 1);
  EXPECT_EQ(masks.vehicle_class[9 * 40 + 5], 0);
}

TEST(FrameMasks, WhereNoVehicleIsShownBoxesSayWhereTheyAre) {
  MaskInputs inputs = road_with_a_vehicle();
  inputs.vehicle_boxes = {Box2{20.0, 10.0, 23.0, 12.0}};
  for (std::uint8_t& label : inputs.segmentation->data) label = label == 3 ? 0 : label;
  inputs.segmentation->data[11 * 40 + 21] = 0;  // not the road
  const FrameMasks masks = make_frame_masks(kCamera, inputs);
  EXPECT_TRUE(masks.vehicle_class.empty());
  EXPECT_EQ(masks.vehicle[11 * 40 + 21], 1);
  EXPECT_EQ(masks.vehicle[11 * 40 + 6], 0);
}

TEST(FrameMasks, WithoutAClassOfVehiclesNoneIsKnown) {
  MaskInputs inputs = road_with_a_vehicle();
  inputs.vehicle_boxes = {Box2{5.0, 10.0, 8.0, 12.0}};
  inputs.classes.vehicle.clear();
  EXPECT_TRUE(make_frame_masks(kCamera, inputs).vehicle_class.empty());
  inputs.road_mask = inputs.segmentation;
  inputs.segmentation.reset();
  EXPECT_TRUE(make_frame_masks(kCamera, inputs).vehicle_class.empty());
}

}  // namespace
}  // namespace camber
