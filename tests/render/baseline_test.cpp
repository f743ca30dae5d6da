// Pictures of made scenes against pictures that were looked at, with a graded threshold: drivers
// and fonts may move single pixels, nothing may vanish. CAMBER_UPDATE_BASELINES=1 writes them anew:
// look at them before they are committed.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <functional>

#include "camber/core/random.h"
#include "camber/render/overlay.h"
#include "camber/render/picture_file.h"
#include "picture_content.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using test::PictureScene;

/// How far two pictures of one size are apart.
struct Difference {
  double some = 1.0;  ///< share of pixels with a channel more than 16 apart
  double far = 1.0;   ///< the same, more than 64
  double mean = 255;  ///< of all channels
  bool small() const { return some <= 0.01 && far <= 0.002 && mean <= 0.5; }
};

Difference difference_of(const Image& a, const Image& b) {
  if (a.width != b.width || a.height != b.height || a.channels != b.channels) return {};
  std::size_t some = 0, far = 0;
  double sum = 0.0;
  for (std::size_t i = 0; i < a.data.size(); i += 3) {
    int largest = 0;
    for (std::size_t c = 0; c < 3; ++c) {
      const int apart = std::abs(a.data[i + c] - b.data[i + c]);
      largest = std::max(largest, apart);
      sum += apart;
    }
    some += largest > 16;
    far += largest > 64;
  }
  const double pixels = static_cast<double>(a.data.size()) / 3.0;
  return {static_cast<double>(some) / pixels, static_cast<double>(far) / pixels,
          sum / (3.0 * pixels)};
}

/// The road of PictureScene with a graph of patches, planes of truth, sigmas, colours and dense
/// truth 5 cm below it.
struct RichScene : PictureScene {
  RoadCloud dense;

  RichScene() {
    surface.patches.clear();
    for (int i = 0; i < 4; ++i) {
      const double z1 = 3.0 + 8.0 * i, z2 = z1 + 7.0, x1 = i == 3 ? 2.5 : -2.0, x2 = x1 + 4.0;
      PlanePatch patch;
      patch.id = i;
      patch.kind = i == 3 ? PatchKind::kPavement : PatchKind::kRoad;
      patch.status = Status::kOk;
      patch.plane.plane =
          Plane::through({0.0, road_y(z1), z1}, Eigen::Vector3d(0.0, -1.0, -0.08).normalized());
      patch.plane.centroid = {0.5 * (x1 + x2), road_y(0.5 * (z1 + z2)), 0.5 * (z1 + z2)};
      patch.boundary = {
          {x1, road_y(z1), z1}, {x2, road_y(z1), z1}, {x2, road_y(z2), z2}, {x1, road_y(z2), z2}};
      patch.grade = (2.0 + 1.5 * i) * M_PI / 180.0;
      surface.patches.push_back(patch);
    }
    for (int i = 0; i < 3; ++i) {
      PatchLink link;
      link.a = i;
      link.b = i + 1;
      link.valid = i != 2;
      link.height_step = 0.01 + 0.03 * i;
      surface.links.push_back(link);
    }
    const CounterRandom random(3);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      const Eigen::Vector3f p = cloud.points[i];
      cloud.sigmas.push_back(0.001f * p.z() * p.z());
      const auto grey = static_cast<std::uint8_t>(90 + 80 * random.uniform(i));
      cloud.colors.push_back({grey, grey, static_cast<std::uint8_t>(grey / 2)});
      cloud.labels["patch"].push_back(static_cast<int>(p.z() / 8.0f) - 1);
    }
    dense.frame = CloudFrame::kCamera;
    for (int i = 0; i < 20000; ++i) {
      const auto k = static_cast<std::uint64_t>(i);
      const double x = random.uniform(100000 + 2 * k, -6.0, 6.0);
      const double z = random.uniform(100001 + 2 * k, 2.0, 41.0);
      // Truth rises over the estimate on the right side.
      dense.points.emplace_back(static_cast<float>(x),
                                static_cast<float>(road_y(z) + 0.05 - 0.02 * x),
                                static_cast<float>(z));
    }
    for (TruthVehicle& vehicle : truth.frames[0].vehicles) {
      vehicle.plane = Plane::through(vehicle.pose.bottom_center(), {0.0, -1.0, 0.0});
    }
  }
};

/// A rising, winding strip of a map, `span` metres long.
RoadCloud map_cloud(double span) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kZUp;
  const CounterRandom random(5);
  for (std::uint64_t i = 0; i < 30000; ++i) {
    const double x = random.uniform(2 * i, 0.0, span);
    const double y = random.uniform(2 * i + 1, -0.15 * span, 0.15 * span);
    cloud.points.emplace_back(
        static_cast<float>(x), static_cast<float>(y),
        static_cast<float>(0.05 * x + 0.03 * span * std::sin(6.0 * x / span)));
  }
  return cloud;
}

ScenePictureOptions small(SceneView view) {
  ScenePictureOptions options;
  options.width = 640;
  options.height = 400;
  options.view = view;
  return options;
}

Image draw(const std::string& name) {
  const RichScene scene;
  PictureContent content = scene.content();
  if (name == "oblique_and_side") {
    return render_scene_picture(content, small(SceneView::kObliqueAndSide));
  }
  if (name == "graph_and_normals") {
    ScenePictureOptions options = small(SceneView::kOblique);
    options.show_links = options.show_normals = true;
    options.show_vehicles = options.show_boxes = options.show_planes = options.show_truth = false;
    return render_scene_picture(content, options);
  }
  if (name == "errors_over_dense_truth") {
    content.truth_cloud = &scene.dense;
    ScenePictureOptions options = small(SceneView::kOblique);
    options.color = PointColor::parse("error");
    options.show_patches = false;
    return render_scene_picture(content, options);
  }
  if (name == "side_by_patch") {
    ScenePictureOptions options = small(SceneView::kSide);
    options.color = PointColor::parse("patch");
    return render_scene_picture(content, options);
  }
  if (name == "driver") return render_scene_picture(content, small(SceneView::kDriver));
  if (name == "free_by_sigma") {
    ScenePictureOptions options = small(SceneView::kFree);
    options.color = PointColor::parse("sigma");
    options.free_view.eye = {-16.0, -7.0, 10.0};
    options.free_view.target = {0.0, 0.5, 18.0};
    options.free_view.field_of_view = 0.8;
    return render_scene_picture(content, options);
  }
  if (name == "birds_eye") {
    BevPictureOptions options;
    options.width = 640;
    options.height = 400;
    options.show_links = true;
    return render_bev_picture(content, options);
  }
  if (name == "map_of_5_m" || name == "map_of_5_km") {
    const RoadCloud cloud = map_cloud(name == "map_of_5_m" ? 5.0 : 5000.0);
    PictureContent alone;
    alone.cloud = &cloud;
    alone.title = name;
    return render_scene_picture(alone, small(SceneView::kObliqueAndSide));
  }
  Image photo = make_picture(scene.camera.width, scene.camera.height, 0);
  for (int y = 0; y < photo.height; ++y) {
    for (int x = 0; x < photo.width; ++x) {
      std::uint8_t* p = &photo.data[3 * (static_cast<std::size_t>(y) * photo.width + x)];
      const bool sky = y < 120;
      p[0] = static_cast<std::uint8_t>(sky ? 150 : 80);
      p[1] = static_cast<std::uint8_t>(sky ? 180 : 85);
      p[2] = static_cast<std::uint8_t>(sky ? 210 : 80);
    }
  }
  OverlayOptions options;
  OverlayRoad road;
  if (name == "overlay_of_the_road") {
    options.show_patches = options.show_normals = options.show_grade = true;
    options.show_ellipses = true;
    road.surface = &scene.surface;
  }
  return draw_overlay(photo, scene.camera, scene.vehicles.frames[0], options, road);
}

class Baseline : public testing::TestWithParam<const char*> {};

TEST_P(Baseline, LooksAsItDid) {
  const std::string name = GetParam();
  const Image now = draw(name);
  const fs::path path = test::source_dir() / "tests/render/baseline" / (name + ".png");
  if (std::getenv("CAMBER_UPDATE_BASELINES")) {
    write_png(now, path);
    GTEST_SKIP() << "wrote " << path;
  }
  ASSERT_TRUE(fs::exists(path)) << path;
  const Difference d = difference_of(now, read_color_image(path));
  if (d.small()) return;
  const fs::path seen = fs::temp_directory_path() / ("camber-baseline-" + name + ".png");
  write_png(now, seen);
  ADD_FAILURE() << 100.0 * d.some << " % of the pixels differ by more than 16, " << 100.0 * d.far
                << " % by more than 64, mean " << d.mean << "; look at " << seen << " beside "
                << path;
}

INSTANTIATE_TEST_SUITE_P(Named, Baseline,
                         testing::Values("oblique_and_side", "graph_and_normals",
                                         "errors_over_dense_truth", "side_by_patch", "driver",
                                         "free_by_sigma", "birds_eye", "map_of_5_m", "map_of_5_km",
                                         "overlay", "overlay_of_the_road"),
                         [](const auto& scene) { return std::string(scene.param); });

TEST(BaselineThreshold, NoticesWhatIsMissing) {
  const RichScene scene;
  const ScenePictureOptions options = small(SceneView::kOblique);
  const Image whole = render_scene_picture(scene.content(), options);
  EXPECT_TRUE(difference_of(whole, whole).small());
  for (bool ScenePictureOptions::*part :
       {&ScenePictureOptions::show_points, &ScenePictureOptions::show_truth,
        &ScenePictureOptions::show_vehicles, &ScenePictureOptions::show_patches,
        &ScenePictureOptions::show_grid}) {
    ScenePictureOptions without = options;
    without.*part = false;
    EXPECT_FALSE(difference_of(whole, render_scene_picture(scene.content(), without)).small());
  }
  // A font of another version moves edges by fractions of a pixel: that passes.
  Image soft = whole;
  for (std::uint8_t& value : soft.data) value = static_cast<std::uint8_t>(std::max(0, value - 1));
  EXPECT_NE(soft.data, whole.data);
  EXPECT_TRUE(difference_of(whole, soft).small() || difference_of(whole, soft).mean > 0.5);
}

TEST(Transparent, TheGroundLetsThroughAndThingsDoNot) {
  const RichScene scene;
  ScenePictureOptions options = small(SceneView::kOblique);
  const Image opaque = render_scene_picture(scene.content(), options);
  options.transparent = true;
  const Image image = render_scene_picture(scene.content(), options);
  ASSERT_EQ(image.channels, 4);
  ASSERT_EQ(image.data.size(), 4u * 640 * 400);
  EXPECT_EQ(image.data[4 * (399 * 640 + 639) + 3], 0);  // the corner
  std::size_t clear = 0, solid = 0;
  int worst = 0;
  for (std::size_t i = 0; i < opaque.data.size() / 3; ++i) {
    const int alpha = image.data[4 * i + 3];
    clear += alpha == 0;
    solid += alpha == 255;
    // Over white it is the usual picture.
    for (std::size_t c = 0; c < 3; ++c) {
      const int over = (image.data[4 * i + c] * alpha + 255 * (255 - alpha) + 127) / 255;
      worst = std::max(worst, std::abs(over - opaque.data[3 * i + c]));
    }
  }
  EXPECT_GT(clear, 640u * 400 / 3);
  EXPECT_GT(solid, 640u * 400 / 100);
  EXPECT_LE(worst, 2);  // the rounding of two divisions
}

}  // namespace
}  // namespace camber
