#include "camber/render/pictures.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <optional>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_file.h"
#include "camber/render/picture_space.h"
#include "camber/render/scene_camera.h"
#include "picture_content.h"

namespace camber {
namespace {

using test::PictureScene;

bool is_red(const std::uint8_t* p) {
  return std::abs(p[0] - 214) < 30 && std::abs(p[1] - 24) < 45 && std::abs(p[2] - 30) < 45;
}

bool is_white(const std::uint8_t* p) { return p[0] == 255 && p[1] == 255 && p[2] == 255; }

/// Pixels of rows [0, rows) that satisfy `test`, and their extent.
template <typename Test>
int count_pixels(const Image& image, int rows, Test test, Box2* extent = nullptr) {
  int count = 0;
  Box2 box{1e9, 1e9, -1e9, -1e9};
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < image.width; ++x) {
      if (!test(image.row(y) + 3 * x)) continue;
      ++count;
      box = {std::min(box.x1, 1.0 * x), std::min(box.y1, 1.0 * y), std::max(box.x2, 1.0 * x),
             std::max(box.y2, 1.0 * y)};
    }
  }
  if (extent) *extent = box;
  return count;
}

ScenePictureOptions small_scene(SceneView view) {
  ScenePictureOptions options;
  options.width = 800;
  options.height = 500;
  options.view = view;
  return options;
}

BevPictureOptions small_bev() {
  BevPictureOptions options;
  options.width = 800;
  options.height = 500;
  return options;
}

TEST(ScenePicture, SameInputSameBytes) {
  const PictureScene scene;
  for (const SceneView view : {SceneView::kOblique, SceneView::kSide, SceneView::kObliqueAndSide}) {
    RenderRecord record;
    const Image first = render_scene_picture(scene.content(), small_scene(view), &record);
    const Image second = render_scene_picture(scene.content(), small_scene(view));
    EXPECT_EQ(first.width, 800);
    EXPECT_EQ(first.height, 500);
    EXPECT_EQ(encode_png(first), encode_png(second));
    EXPECT_FALSE(record.backend.empty());
    EXPECT_FALSE(record.renderer.empty());
    // A view that shows next to nothing would be mostly paper.
    const int inked = count_pixels(first, first.height, [](auto* p) { return !is_white(p); });
    EXPECT_GT(inked, 800 * 500 / 12);
  }
}

TEST(ScenePicture, TruthIsRedAndOnlyWhereAskedFor) {
  const PictureScene scene;
  ScenePictureOptions options = small_scene(SceneView::kOblique);
  const int with_truth = count_pixels(render_scene_picture(scene.content(), options), 500, is_red);
  options.show_truth = false;
  const int without = count_pixels(render_scene_picture(scene.content(), options), 500, is_red);
  EXPECT_GT(with_truth, 60);  // thin lines: few pixels are fully red
  EXPECT_EQ(without, 0);
}

TEST(ScenePicture, TrueBoxesInMetresAreNotDrawnIntoAResultUpToScale) {
  const PictureScene scene;
  PictureContent content = scene.content();
  RunDocument run = *content.run;
  run.metric = false;
  content.run = &run;
  const Image image = render_scene_picture(content, small_scene(SceneView::kOblique));
  EXPECT_EQ(count_pixels(image, 500, is_red), 0);
}

TEST(ScenePicture, StrayPointsDoNotShrinkTheContent) {
  const PictureScene scene;
  PictureScene strayed;
  for (int i = 0; i < 20; ++i) {
    strayed.cloud.points.emplace_back(1000.0f * i, -5000.0f, 1e5f * (i - 10));
    strayed.cloud.points.emplace_back(std::numeric_limits<float>::quiet_NaN(), 0.0f, 1.0f);
  }
  const ScenePictureOptions options = small_scene(SceneView::kOblique);
  Box2 clean, dirty;
  count_pixels(render_scene_picture(scene.content(), options), 500, is_red, &clean);
  count_pixels(render_scene_picture(strayed.content(), options), 500, is_red, &dirty);
  // The quantiles move by single points; the red boxes stay where they were within some pixels.
  EXPECT_NEAR(clean.x1, dirty.x1, 12.0);
  EXPECT_NEAR(clean.x2, dirty.x2, 12.0);
  EXPECT_NEAR(clean.y1, dirty.y1, 12.0);
}

TEST(ScenePicture, ACloudAloneIsEnough) {
  const PictureScene scene;
  PictureContent content;
  content.cloud = &scene.cloud;
  const Image image = render_scene_picture(content, small_scene(SceneView::kObliqueAndSide));
  EXPECT_GT(count_pixels(image, 300, [](auto* p) { return !is_white(p); }), 800 * 300 / 12);
}

TEST(ScenePicture, SaysWhatCannotBeDrawn) {
  PictureScene scene;
  PictureContent content;
  EXPECT_THROW(render_scene_picture(content), NoAnswerError);
  RoadCloud empty;
  content.cloud = &empty;
  EXPECT_THROW(render_scene_picture(content), NoAnswerError);
  EXPECT_THROW(render_bev_picture(content), NoAnswerError);
  empty.points.assign(100, Eigen::Vector3f::Constant(std::numeric_limits<float>::quiet_NaN()));
  try {
    render_bev_picture(content);
    FAIL() << "drawn from nothing";
  } catch (const NoAnswerError& error) {
    EXPECT_STREQ(error.what(), "nothing to draw: none of the 100 points has finite coordinates");
  }
  ScenePictureOptions options;
  options.width = 0;
  EXPECT_THROW(render_scene_picture(scene.content(), options), std::invalid_argument);
  options = {};
  options.supersampling = 9;
  EXPECT_THROW(render_scene_picture(scene.content(), options), std::invalid_argument);
  BevPictureOptions bev;
  bev.height = -3;
  EXPECT_THROW(render_bev_picture(scene.content(), bev), std::invalid_argument);
}

TEST(BevPicture, SameInputSameBytes) {
  const PictureScene scene;
  EXPECT_EQ(encode_png(render_bev_picture(scene.content(), small_bev())),
            encode_png(render_bev_picture(scene.content(), small_bev())));
}

TEST(BevPicture, TrueFootprintIsDrawnToScaleWhereItIs) {
  PictureScene scene;
  scene.truth.frames[0].vehicles.resize(1);
  scene.vehicles.frames[0].vehicles.clear();
  TruthVehicle& vehicle = scene.truth.frames[0].vehicles[0];
  vehicle.pose.camera_from_vehicle =
      SE3(rotation_from_rotation_y(-M_PI / 2), {0.0, PictureScene::road_y(20.0), 20.0});
  const BevPictureOptions options = small_bev();
  Box2 red;
  const Image image = render_bev_picture(scene.content(), options);
  ASSERT_GT(count_pixels(image, 430, is_red, &red), 50);  // the legend is below
  // Ahead points right: the length of 4.4 m lies along x, the width of 1.8 m along y; the line's
  // own width of one pixel is taken off.
  const double line = 1.0;
  EXPECT_NEAR((red.width() - line) / (red.height() - line), 4.4 / 1.8, 0.25);
  // Moving it 5 m ahead moves it to the right by as many pixels as 5 m take.
  const double pixels_per_metre = (red.width() - line) / 4.4;
  vehicle.pose.camera_from_vehicle.set_translation({0.0, PictureScene::road_y(25.0), 25.0});
  Box2 moved;
  count_pixels(render_bev_picture(scene.content(), options), 430, is_red, &moved);
  EXPECT_NEAR(moved.center().x() - red.center().x(), 5.0 * pixels_per_metre, 3.0);
  EXPECT_NEAR(moved.center().y(), red.center().y(), 1.5);
  // And to the camera's right it moves down.
  vehicle.pose.camera_from_vehicle.set_translation({2.0, PictureScene::road_y(20.0), 20.0});
  count_pixels(render_bev_picture(scene.content(), options), 430, is_red, &moved);
  EXPECT_NEAR(moved.center().y() - red.center().y(), 2.0 * pixels_per_metre, 2.0);
}

TEST(BevPicture, EveryPartHasASwitch) {
  const PictureScene scene;
  const Image whole = render_bev_picture(scene.content(), small_bev());
  for (bool BevPictureOptions::*part :
       {&BevPictureOptions::show_points, &BevPictureOptions::show_patches,
        &BevPictureOptions::show_vehicles, &BevPictureOptions::show_truth,
        &BevPictureOptions::show_cameras}) {
    BevPictureOptions without = small_bev();
    without.*part = false;
    EXPECT_NE(render_bev_picture(scene.content(), without).data, whole.data);
  }
}

TEST(BevPicture, PointsHaveTheColoursOfTheirHeights) {
  const PictureScene scene;
  PictureContent content;
  content.cloud = &scene.cloud;
  BevPictureOptions options = small_bev();
  options.point_size = 8.0;  // closes all gaps, so that the row below is road and nothing else
  const Image image = render_bev_picture(content, options);
  const std::uint8_t* row = image.row(250);
  // The road climbs ahead, so the colours along it run through viridis from dark to light.
  // The median over some columns: grid lines cross the road.
  const auto brightness = [&](int x) {
    std::vector<int> sums;
    for (int i = x - 7; i <= x + 7; ++i) {
      sums.push_back(row[3 * i] + row[3 * i + 1] + row[3 * i + 2]);
    }
    std::nth_element(sums.begin(), sums.begin() + 7, sums.end());
    return sums[7];
  };
  EXPECT_LT(brightness(90), brightness(200));
  EXPECT_LT(brightness(200), brightness(340));
  EXPECT_LT(brightness(340), brightness(500));
}

TEST(PictureFile, UnwritableOutputLeavesNothingBehind) {
  const Image image = make_picture(8, 8, 200);
  EXPECT_THROW(write_png(image, "/nonexistent-folder/picture.png"), OutputError);
  EXPECT_THROW(write_png(Image{}, "picture.png"), std::invalid_argument);
  EXPECT_FALSE(std::filesystem::exists("picture.png"));
  EXPECT_THROW(make_picture(0, 10, 255), std::invalid_argument);
}

TEST(PictureFile, WritesWhatItReads) {
  Image image = make_picture(5, 3, 7);
  for (std::size_t i = 0; i < image.data.size(); ++i) {
    image.data[i] = static_cast<std::uint8_t>(5 * i);
  }
  const std::filesystem::path path =
      std::filesystem::temp_directory_path() / "camber-picture-file-test.png";
  write_png(image, path);
  const Image again = read_color_image(path);
  std::filesystem::remove(path);
  EXPECT_EQ(again.width, 5);
  EXPECT_EQ(again.height, 3);
  EXPECT_EQ(again.data, image.data);
}

TEST(ScenePicture, ATurntableKeepsItsDistanceAndAllInView) {
  const PictureScene scene;
  const PictureSpace space = make_picture_space(scene.content(), true, {});
  const SceneGrid grid = make_scene_grid(space);
  std::vector<Eigen::Vector3d> corners = content_corners(space, grid, false);
  const Box2 free{80.0, 60.0, 500.0, 340.0};
  std::optional<double> distance;
  for (int k = 0; k < 24; ++k) {
    SceneCamera view = oblique_camera(2.0 * M_PI * k / 24, 0.42, 640, 400);
    fit_camera(swept_all_around(corners, space.up.high), free, &view);
    if (!distance) distance = view.distance;
    EXPECT_NEAR(view.distance, *distance, 0.002 * *distance);  // of the ring's 72 places
    for (const Eigen::Vector3d& corner : corners) {
      Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
      ASSERT_TRUE(view.project(corner, &pixel));
      EXPECT_TRUE(free.grown(1.0).contains(pixel)) << k << ": " << pixel.transpose();
    }
  }
}

TEST(BevPicture, EllipsesAreDrawnOnRequestOnly) {
  const PictureScene scene;
  BevPictureOptions options;
  const Image without = render_bev_picture(scene.content(), options);
  options.show_ellipses = true;
  const Image with = render_bev_picture(scene.content(), options);
  EXPECT_NE(with.data, without.data);
  // Without a stated covariance there is no ellipse to draw, and no word of it.
  PictureScene unknown;
  for (VehicleEstimate& vehicle : unknown.vehicles.frames[0].vehicles) {
    vehicle.covariance.setConstant(std::nan(""));
  }
  EXPECT_EQ(render_bev_picture(unknown.content(), options).data,
            render_bev_picture(unknown.content(), {}).data);
}

TEST(MapPictures, WriteWholeCoordinatesOfEastAndNorth) {
  const Ticks ticks = multiples_of(10.0, -452.0, -428.0, 771000.0);
  EXPECT_EQ(ticks.labels, (std::vector<std::string>{"770550", "770560", "770570"}));
  EXPECT_EQ(ticks.values, (std::vector<double>{-450.0, -440.0, -430.0}));
  // Round in whole coordinates where the origin is not.
  EXPECT_EQ(make_ticks(0.0, 100.0, 5, 7.0).labels.front(), "20");
  RoadCloud cloud;
  cloud.origin = {771000.0, 6278000.0, 0.0};
  for (int i = 0; i < 100; ++i) {
    cloud.points.emplace_back(static_cast<float>(-i), static_cast<float>(i % 7), 20.0f);
  }
  PictureContent content;
  content.cloud = &cloud;
  PictureSpace space = make_picture_space(content, false, {});
  EXPECT_EQ(space.right_name, "x");  // nothing states a map
  EXPECT_EQ(space.origin, cloud.origin);
  content.projected = true;
  space = make_picture_space(content, false, {});
  EXPECT_EQ(space.right_name, "east");
  EXPECT_EQ(space.ahead_name, "north");
}

TEST(MapPictures, ClassesAreNamedColours) {
  RoadCloud cloud;
  for (int i = 0; i < 90; ++i) {
    cloud.points.emplace_back(static_cast<float>(i), static_cast<float>(i % 7), 0.0f);
    cloud.labels["classification"].push_back(i % 3 == 0 ? 2 : i % 3 == 1 ? 6 : 70);
    cloud.labels["ground"].push_back(i % 2);
  }
  PictureContent content;
  content.cloud = &cloud;
  PictureSpace space = make_picture_space(content, false, PointColor::parse("classification"));
  ASSERT_EQ(space.classes.size(), 3u);
  EXPECT_FALSE(space.has_color_bar);
  EXPECT_EQ(space.classes[0].second, "ground (2)");
  EXPECT_EQ(space.classes[1].second, "building (6)");
  EXPECT_EQ(space.classes[2].second, "user defined (70)");
  EXPECT_EQ(space.colors[0][0], space.classes[0].first.red);
  EXPECT_NE(space.colors[0], space.colors[1]);
  EXPECT_NE(space.colors[1], space.colors[2]);
  space = make_picture_space(content, false, PointColor::parse("ground"));
  ASSERT_EQ(space.classes.size(), 2u);
  EXPECT_EQ(space.classes[1].second, "ground");
  // Other numbers are no classes.
  cloud.labels["ground"][0] = 5;
  EXPECT_TRUE(make_picture_space(content, false, PointColor::parse("ground")).has_color_bar);
}

}  // namespace
}  // namespace camber
