#include "camber/scene/vehicle_numbers.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <set>

#include "camber/render/gltf.h"
#include "camber/render/overlay.h"
#include "camber/render/picture_file.h"
#include "camber/render/picture_space.h"
#include "picture_content.h"

namespace camber {
namespace {

using test::make_vehicle;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

/// Two cars over two frames that the detector lists in another order each time.
VehicleDocument reordered() {
  VehicleDocument document;
  for (const int frame : {7, 8}) {
    VehicleFrame f;
    f.id = frame;
    VehicleEstimate near = make_vehicle(frame == 7 ? 0 : 1, {-2.0, 0.53, 14.0}, -M_PI / 2);
    VehicleEstimate far = make_vehicle(frame == 7 ? 1 : 0, {2.0, -0.35, 25.0}, 0.3);
    near.track = 3;
    far.track = 5;
    f.vehicles = {near, far};
    document.frames.push_back(f);
  }
  return document;
}

TEST(VehicleNumbers, AreTracksWhereTheseAreKnown) {
  const VehicleDocument document = reordered();
  const VehicleNumbers numbers(document);
  for (const VehicleFrame& frame : document.frames) {
    EXPECT_EQ(numbers.of(frame.id, frame.vehicles[0]), 3);
    EXPECT_EQ(numbers.of(frame.id, frame.vehicles[1]), 5);
  }
}

TEST(VehicleNumbers, OfVehiclesWithoutATrackAreTheirOwn) {
  VehicleDocument document = reordered();
  for (VehicleFrame& frame : document.frames) {
    frame.vehicles.push_back(make_vehicle(3, {0.0, 1.0, 20.0}, 0.0));  // an id that is a track too
  }
  const VehicleNumbers numbers(document);
  std::multiset<int> all;
  for (const VehicleFrame& frame : document.frames) {
    for (const VehicleEstimate& vehicle : frame.vehicles) {
      all.insert(numbers.of(frame.id, vehicle));
    }
  }
  EXPECT_THAT(all, ElementsAre(3, 3, 5, 5, 6, 7));
}

TEST(VehicleNumbers, AreIdsWhereNoTrackIsKnown) {
  VehicleDocument document = reordered();
  for (VehicleFrame& frame : document.frames) {
    for (VehicleEstimate& vehicle : frame.vehicles) vehicle.track = -1;
  }
  const VehicleNumbers numbers(document);
  EXPECT_EQ(numbers.of(7, document.frames[0].vehicles[1]), 1);
  EXPECT_EQ(numbers.of(8, document.frames[1].vehicles[1]), 0);
}

std::array<int, 3> channels(const Color& color) { return {color.red, color.green, color.blue}; }

/// Whether a picture holds a number's colour as overlays draw it, a quarter brighter.
bool holds(const Image& image, int number) {
  std::array<int, 3> ink = channels(categorical(number));
  for (int& channel : ink) channel += (255 - channel) / 4;
  for (std::size_t i = 0; i + 2 < image.data.size(); i += 3) {
    if (std::equal(ink.begin(), ink.end(), image.data.begin() + static_cast<std::ptrdiff_t>(i))) {
      return true;
    }
  }
  return false;
}

TEST(VehicleNumbers, GiveOneColourInAllFramesAndTools) {
  test::PictureScene scene;
  scene.vehicles = reordered();
  PictureContent content = scene.content();
  content.truth = nullptr;
  for (const int frame : {7, 8}) {
    content.frame = frame;
    // The scene, the view from above and the viewer draw the vehicles of a PictureSpace.
    const PictureSpace space = make_picture_space(content, true, {});
    ASSERT_EQ(space.vehicles.size(), 2u);
    EXPECT_EQ(space.vehicles[0].name, "car 3");
    EXPECT_EQ(space.vehicles[1].name, "car 5");
    EXPECT_EQ(channels(vehicle_color(space.vehicles[0])), channels(categorical(3)));
    EXPECT_EQ(channels(vehicle_color(space.vehicles[1])), channels(categorical(5)));
    const std::string glb = encode_glb(content);
    EXPECT_THAT(glb, HasSubstr("car 3"));
    EXPECT_THAT(glb, Not(HasSubstr("car 0")));
    EXPECT_THAT(glb, Not(HasSubstr("car 1")));
    // The overlay's colour is the same, brighter: of one car alone it is found in both frames.
    OverlayOptions options;
    options.numbers = VehicleNumbers(scene.vehicles);
    VehicleFrame near = scene.vehicles.frames[frame == 7 ? 0 : 1];
    near.vehicles.resize(1);
    const Image picture = draw_overlay(make_picture(1242, 375, 60), scene.camera, near, options);
    EXPECT_TRUE(holds(picture, 3));
    EXPECT_FALSE(holds(picture, 0));
    EXPECT_FALSE(holds(picture, 1));
  }
}

TEST(VehicleNumbers, ADistanceCarriesItsSigmaOnRequest) {
  PlacedVehicle vehicle;
  vehicle.range = 27.74;
  EXPECT_EQ(range_text(vehicle, "m", true), "27.7 m");
  vehicle.range_sigma = 0.31;
  EXPECT_EQ(range_text(vehicle, "m", false), "27.7 m");
  EXPECT_EQ(range_text(vehicle, "m", true), "27.7 ± 0.3 m");
  vehicle.range_sigma = 0.042;
  EXPECT_EQ(range_text(vehicle, "m", true), "27.7 ± 0.04 m");
  VehicleEstimate estimate = make_vehicle(1, {0.0, 0.0, 20.0}, 0.0);
  EXPECT_DOUBLE_EQ(range_sigma(estimate), 0.5);  // straight ahead: sqrt of the variance along z
  estimate.covariance.setConstant(std::nan(""));
  EXPECT_EQ(range_sigma(estimate), 0.0);
}

}  // namespace
}  // namespace camber
