#include "camber/render/overlay.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <limits>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/render/color_map.h"
#include "camber/render/detail/road_grid.h"
#include "camber/render/label_layout.h"
#include "camber/render/picture_file.h"
#include "camber/render/wireframe.h"
#include "picture_content.h"

namespace camber {
namespace {

using test::make_vehicle;
using test::PictureScene;

int changed_pixels(const Image& a, const Image& b) {
  int count = 0;
  for (std::size_t i = 0; i < a.data.size(); i += 3) {
    count +=
        a.data[i] != b.data[i] || a.data[i + 1] != b.data[i + 1] || a.data[i + 2] != b.data[i + 2];
  }
  return count;
}

TEST(Overlay, DrawsWireframeInTheVehiclesColourAtItsPlace) {
  const PictureScene scene;
  const Image photo = make_picture(1242, 375, 60);
  OverlayOptions options;
  options.show_labels = options.show_boxes_2d = options.show_boxes_3d = options.show_planes = false;
  VehicleFrame frame;
  frame.vehicles = {make_vehicle(1, {0.0, 1.65, 9.0}, -M_PI / 2)};
  const Image out = draw_overlay(photo, scene.camera, frame, options);
  // Seen from behind: the middle of the boot's rear edge (bar 11-29) is in sight and in colour.
  const auto& x = frame.vehicles[0].keypoints;
  const Eigen::Vector2d boot = *scene.camera.project(0.5 * (x[11] + x[29]));
  const std::uint8_t* p = out.row(static_cast<int>(std::lround(boot.y()))) +
                          3 * static_cast<int>(std::lround(boot.x()));
  const Color ink = categorical(1);
  EXPECT_NEAR(p[0], ink.red + (255 - ink.red) / 4, 25);
  EXPECT_NEAR(p[1], ink.green + (255 - ink.green) / 4, 25);
  EXPECT_NEAR(p[2], ink.blue + (255 - ink.blue) / 4, 25);
  // The front bumper (bar 17-35) is behind the body: drawn, but thin and pale.
  const Eigen::Vector2d bumper = *scene.camera.project(0.5 * (x[17] + x[35]));
  const std::uint8_t* q = out.row(static_cast<int>(std::lround(bumper.y()))) +
                          3 * static_cast<int>(std::lround(bumper.x()));
  EXPECT_LT(q[1], p[1] - 40);
  // Nothing is drawn far from the vehicle.
  EXPECT_EQ(out.row(20)[3 * 100], 60);
}

TEST(Overlay, SameInputSamePixelsAndEveryPartIsSeen) {
  const PictureScene scene;
  const Image photo = make_picture(1242, 375, 90);
  const VehicleFrame& frame = scene.vehicles.frames[0];
  const Image all = draw_overlay(photo, scene.camera, frame);
  EXPECT_EQ(all.data, draw_overlay(photo, scene.camera, frame).data);
  for (bool OverlayOptions::*part : {&OverlayOptions::show_boxes_3d, &OverlayOptions::show_planes,
                                     &OverlayOptions::show_labels}) {
    OverlayOptions options;
    options.*part = false;
    EXPECT_GT(changed_pixels(all, draw_overlay(photo, scene.camera, frame, options)), 100);
  }
}

/// Two patches of a level road 1.5 m below a camera, 4 to 12 and 10 to 30 m ahead, 4 m wide.
RoadSurface two_patches() {
  RoadSurface surface;
  for (const auto& [from, to] : {std::pair(4.0, 12.0), std::pair(10.0, 30.0)}) {
    PlanePatch patch;
    patch.plane.plane = Plane::through({0.0, 1.5, from}, {0.0, -1.0, 0.0});
    patch.boundary = {{-2.5, 1.5, from}, {2.5, 1.5, from}, {2.5, 1.5, to}, {-2.5, 1.5, to}};
    surface.patches.push_back(patch);
  }
  return surface;
}

TEST(Overlay, TheRoadsGridCountsMetresOnce) {
  const RoadGrid grid = road_grid(two_patches(), SE3());
  // Across: each metre from 4 to 12, then 15 and 25; 10 and 20 are coarse, and so is 30, at the
  // border or not.
  double length = 0.0;
  int ahead = 0;
  for (const auto& [a, b] : grid.fine) {
    EXPECT_NEAR(a.y(), 1.5, 1e-12);
    if (std::abs(a.z() - b.z()) < 1e-9) {
      EXPECT_NEAR(std::abs(b.x() - a.x()), 5.0, 1e-9);
      ++ahead;
    } else {
      length += std::abs(b.z() - a.z());
    }
  }
  EXPECT_GE(ahead, 9);
  EXPECT_LE(ahead, 11);
  EXPECT_NEAR(length, 5 * 26.0, 1e-9);  // x from -2 to 2, each metre of the road once
  ASSERT_GE(grid.labels.size(), 2u);
  EXPECT_EQ(grid.labels[0].first, 10);
  EXPECT_NEAR((grid.labels[0].second - Eigen::Vector3d(2.5, 1.5, 10.0)).norm(), 0.0, 1e-9);
  EXPECT_EQ(grid.labels[1].first, 20);
  // From a camera 1 m ahead of the reference all is a metre nearer, and keeps its number.
  const RoadGrid moved =
      road_grid(two_patches(), SE3(Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.0, 0.0, -1.0)));
  EXPECT_EQ(moved.labels[0].first, 10);
  EXPECT_NEAR(moved.labels[0].second.z(), 9.0, 1e-9);
}

TEST(Overlay, ARoadWithoutVehiclesShowsItsGrid) {
  const PictureScene scene;
  const Image photo = make_picture(1242, 375, 90);
  const RoadSurface surface = two_patches();
  OverlayRoad road;
  road.surface = &surface;
  OverlayOptions options;
  const Image plain = draw_overlay(photo, scene.camera, {}, options, road);
  EXPECT_EQ(plain.data, photo.data);
  options.show_grid = true;
  const Image grid = draw_overlay(photo, scene.camera, {}, options, road);
  EXPECT_GT(changed_pixels(plain, grid), 1000);
  // The line 10 m ahead is bright where it is seen.
  const Eigen::Vector2d at = *scene.camera.project({0.5, 1.5, 10.0});
  EXPECT_GT(grid.row(static_cast<int>(std::lround(at.y())))[3 * std::lround(at.x())], 200);
  options.metric = false;  // numbers without a unit
  EXPECT_GT(changed_pixels(grid, draw_overlay(photo, scene.camera, {}, options, road)), 20);
}

TEST(Overlay, EnlargesThePictureBeforeDrawing) {
  const PictureScene scene;
  const Image photo = make_picture(1242, 375, 90);
  OverlayOptions options;
  options.upscale = 3.0;
  const Image out = draw_overlay(photo, scene.camera, scene.vehicles.frames[0], options);
  EXPECT_EQ(out.width, 3726);
  EXPECT_EQ(out.height, 1125);
}

TEST(Overlay, VehiclesWithoutAnAnswerAreShownAsSuch) {
  const PictureScene scene;
  const Image photo = make_picture(1242, 375, 90);
  VehicleFrame frame;
  VehicleEstimate failed;
  failed.status = Status::kFailed;
  failed.box = {500, 150, 600, 220};
  failed.pose.camera_from_vehicle.set_translation(
      Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN()));
  frame.vehicles = {failed};
  EXPECT_GT(changed_pixels(photo, draw_overlay(photo, scene.camera, frame)), 300);
  // A box that is no box draws nothing and breaks nothing.
  frame.vehicles[0].box.x1 = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(changed_pixels(photo, draw_overlay(photo, scene.camera, frame)), 0);
  // A vehicle beside the camera, partly behind it, must not be smeared over the picture.
  frame.vehicles = {make_vehicle(1, {2.0, 1.65, 0.5}, -M_PI / 2)};
  frame.vehicles[0].box = {1000, 100, 1241, 374};
  EXPECT_NO_THROW(draw_overlay(photo, scene.camera, frame));
}

TEST(Overlay, RefusesWhatIsNoPicture) {
  const PictureScene scene;
  const VehicleFrame& frame = scene.vehicles.frames[0];
  EXPECT_THROW(draw_overlay(Image{}, scene.camera, frame), std::invalid_argument);
  try {
    draw_overlay(make_picture(640, 480, 0), scene.camera, frame);
    FAIL() << "sizes disagree";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(),
                 "overlay: found an image of 640 x 480 pixels, expected the camera's 1242 x 375");
  }
  OverlayOptions options;
  options.upscale = 0.0;
  EXPECT_THROW(draw_overlay(make_picture(1242, 375, 0), scene.camera, frame, options),
               std::invalid_argument);
}

TEST(Wireframe, HasTheEdgesOfTheLayout) {
  EXPECT_EQ(wireframe_edges().size(), 40u);  // two loops of 16 and 8 cross bars
  for (const auto& [a, b] : wireframe_edges()) {
    EXPECT_GE(a, 2);
    EXPECT_LT(b, 36);
    EXPECT_NE(a % 18, 0);  // wheels carry no edge
    EXPECT_NE(a % 18, 1);
  }
}

TEST(Wireframe, ABodyHidesItsFarSideOnly) {
  const VehicleEstimate car = make_vehicle(1, {0.0, 1.65, 10.0}, -M_PI / 2);  // seen from behind
  Occluders occluders;
  occluders.add(car.keypoints);
  constexpr double kTolerance = 0.06;
  const auto middle = [&](int i) {
    return Eigen::Vector3d(0.5 * (car.keypoints[i] + car.keypoints[i + 18]));
  };
  EXPECT_FALSE(occluders.hides(middle(10), kTolerance));        // rear bumper
  EXPECT_FALSE(occluders.hides(middle(11), kTolerance));        // boot
  EXPECT_FALSE(occluders.hides(middle(13), kTolerance));        // roof, rear
  EXPECT_TRUE(occluders.hides(middle(16), kTolerance));         // bonnet
  EXPECT_TRUE(occluders.hides(middle(17), kTolerance));         // front bumper
  EXPECT_TRUE(occluders.hides({0.0, 1.0, 30.0}, kTolerance));   // something behind the car
  EXPECT_FALSE(occluders.hides({5.0, 1.0, 30.0}, kTolerance));  // beside it
  EXPECT_FALSE(occluders.hides({0.0, 0.5, 5.0}, kTolerance));   // before it
  EXPECT_FALSE(occluders.hides(-middle(17), kTolerance));       // behind the camera
}

TEST(LabelLayout, LabelsNeverMeetNorLeaveTheArea) {
  const CounterRandom random(3);
  std::uint64_t k = 0;
  for (int round = 0; round < 30; ++round) {
    LabelLayoutOptions options;
    options.area = {0, 0, 600, 300};
    options.gap = 2.0;
    options.taken = {{0, 0, 200, 30}};
    std::vector<LabelRequest> requests;
    for (int i = 0; i < 25; ++i) {
      const double x = random.uniform(k++, -50, 650), y = random.uniform(k++, -50, 350);
      requests.push_back({{random.uniform(k++, 40, 90), 18.0}, {x, y, x + 30, y + 20}});
    }
    const std::vector<LabelPlace> places = place_labels(requests, options);
    ASSERT_EQ(places.size(), requests.size());
    for (std::size_t i = 0; i < places.size(); ++i) {
      ASSERT_TRUE(places[i].found);
      const Box2& a = places[i].box;
      EXPECT_GE(a.x1, 0.0);
      EXPECT_GE(a.y1, 0.0);
      EXPECT_LE(a.x2, 600.0);
      EXPECT_LE(a.y2, 300.0);
      EXPECT_EQ(intersection_over_union(a, options.taken[0]), 0.0);
      for (std::size_t j = 0; j < i; ++j) {
        EXPECT_EQ(intersection_over_union(a, places[j].box), 0.0) << i << " and " << j;
      }
    }
  }
}

TEST(LabelLayout, SaysWhereNoRoomIsLeft) {
  LabelLayoutOptions options;
  options.area = {0, 0, 50, 20};
  const LabelRequest request{{40, 18}, {10, 5, 20, 10}};
  const std::vector<LabelPlace> places = place_labels({request, request, {{90, 18}, {}}}, options);
  EXPECT_TRUE(places[0].found);
  EXPECT_FALSE(places[1].found);  // the first one takes all the room
  EXPECT_FALSE(places[2].found);  // wider than the area
}

TEST(ColorMap, TicksAreRoundNumbers) {
  const Ticks ticks = make_ticks(-0.31, 1.02, 5);
  EXPECT_DOUBLE_EQ(ticks.step, 0.2);
  EXPECT_EQ(ticks.labels,
            (std::vector<std::string>{"-0.2", "0.0", "0.2", "0.4", "0.6", "0.8", "1.0"}));
  EXPECT_EQ(make_ticks(0.0, 5000.0, 5).labels.back(), "5000");
  EXPECT_EQ(format_number(-0.001, 1), "0.0");
  EXPECT_EQ(format_number(-0.06, 1), "-0.1");
}

TEST(ColorMap, ViridisRunsFromDarkToLight) {
  EXPECT_EQ(viridis(-1.0).blue, viridis(0.0).blue);
  EXPECT_EQ(viridis(0.0).red, 68);  // the map's first colour
  EXPECT_EQ(viridis(0.0).green, 1);
  EXPECT_EQ(viridis(0.0).blue, 84);
  int last = 0;
  for (int i = 0; i <= 10; ++i) {
    const Color c = viridis(0.1 * i);
    const int luminance = 2 * c.red + 7 * c.green + c.blue;
    EXPECT_GT(luminance, last);
    last = luminance;
  }
  const Color grey = viridis(std::numeric_limits<double>::quiet_NaN());
  EXPECT_TRUE(grey.red == grey.green && grey.green == grey.blue);
}

}  // namespace
}  // namespace camber
