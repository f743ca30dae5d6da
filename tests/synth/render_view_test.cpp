#include "camber/synth/render_view.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>

#include "camber/image/image_io.h"
#include "camber/scene/scene.h"
#include "camber/synth/synthesise.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;

SynthOptions small_options(RoadProfileKind kind, std::uint64_t seed) {
  SynthOptions options;
  options.profile = kind;
  options.seed = seed;
  options.camera = {414, 125, 240.5, 240.5, 202.85, 57.3};
  options.num_frames = 2;
  options.num_threads = 2;
  options.sensor.supersampling = 2;
  options.cloud_points = 2000;
  return options;
}

std::string bytes_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

TEST(RenderView, ACropIsAPartOfTheWholePicture) {
  SynthOptions options = small_options(RoadProfileKind::kCrest, 4);
  options.sensor.noise = 0.0;
  options.sensor.vignetting = 0.0;
  options.features.weather.cloudiness = 1.0;  // the sun's penumbras are drawn at random
  const SynthWorld world = make_synth_world(world_options(options));
  const auto whole = render_view(world, 0, options.camera, options.sensor, 2);
  PinholeCamera crop = options.camera;
  crop.width = 64;
  crop.height = 48;
  crop.cx -= 200;
  crop.cy -= 60;
  const auto part =
      render_view(world, 0, world.views[0].world_from_camera, crop, options.sensor, 2);
  ASSERT_EQ(part.size(), 3u * 64 * 48);
  double sum = 0.0;
  // The lens's blur reaches two pixels over the crop's border.
  for (int v = 3; v < 45; ++v) {
    for (int u = 3; u < 61; ++u) {
      const int there = whole[3 * ((v + 60) * options.camera.width + u + 200) + 1];
      sum += std::abs(there - part[3 * (v * 64 + u) + 1]);
    }
  }
  EXPECT_LT(sum / (42 * 58), 0.3);
}

TEST(RenderView, ACarMovesWithTheFrameFromAnyPose) {
  SynthOptions options = small_options(RoadProfileKind::kControl, 2);
  options.sensor.noise = 0.0;
  options.sensor.exposure_change = 0.0;
  options.num_cars = 0;
  options.features.lead_car = {true, 6.0};
  WorldOptions bare = world_options(options);
  bare.scenery = false;
  const SynthWorld world = make_synth_world(bare);
  const SE3& pose = world.views[0].world_from_camera;
  const auto first = render_view(world, 0, pose, options.camera, options.sensor, 2);
  const auto second = render_view(world, 1, pose, options.camera, options.sensor, 2);
  int changed = 0;
  for (std::size_t i = 0; i < first.size(); i += 3) changed += std::abs(first[i] - second[i]) > 12;
  EXPECT_GT(changed, 200);
  EXPECT_LT(changed, static_cast<int>(first.size() / 3 / 3));
}

TEST(RenderView, EdgeLinesAreDrawnWhereTheTruthHasThem) {
  // Bright lines at a known offset of the road: the centre of brightness across each line against
  // the projection of its middle, in a picture without noise.
  double sum = 0.0, worst = 0.0;
  int count = 0;
  for (std::uint64_t seed = 0; seed < 3; ++seed) {
    SynthOptions options = small_options(RoadProfileKind::kSteepHill, seed);
    options.camera = {828, 250, 481.0, 481.0, 406.2, 115.1};
    options.sensor.supersampling = 3;
    options.sensor.noise = 0.0;
    options.sensor.vignetting = 0.0;
    options.num_cars = 0;
    WorldOptions bare = world_options(options);
    bare.scenery = false;
    const SynthWorld world = make_synth_world(bare);
    ASSERT_TRUE(world.markings.edge_lines);
    const std::vector<std::uint8_t> image =
        render_view(world, 0, options.camera, options.sensor, 2);
    const SE3 camera_from_world = world.views[0].world_from_camera.inverse();
    const RoadLayout& layout = world.road.layout();
    for (const double side : {1.0, -1.0}) {
      for (double s = 6.0; s < 16.0; s += 0.25) {
        const auto project = [&](double offset) {
          return options.camera.project(camera_from_world * world.road.point(s, offset));
        };
        const double middle = layout.half_width - world.markings.edge_inset;
        const auto line = project(side * middle);
        const auto beside = project(side * (middle - 0.5 * world.markings.line_width));
        ASSERT_TRUE(line && beside);
        const int v = static_cast<int>(std::lround(line->y()));
        if (v < 0 || v >= options.camera.height) continue;
        // Where the line's middle meets this row of pixels.
        const auto ahead =
            options.camera.project(camera_from_world * world.road.point(s + 0.05, side * middle));
        const double slope = (ahead->x() - line->x()) / (ahead->y() - line->y());
        const double u = line->x() + slope * (v - line->y());
        const double half = 3.0 * std::abs(beside->x() - line->x()) + 2.0;
        if (u - half < 1 || u + half > options.camera.width - 2) continue;
        double weight = 0.0, moment = 0.0, floor = 255.0;
        const int low = static_cast<int>(std::ceil(u - half)),
                  high = static_cast<int>(std::floor(u + half));
        const auto grey = [&](int x) {
          return image[3 * (static_cast<std::size_t>(v) * options.camera.width + x) + 1];
        };
        double top = 0.0;
        for (int x = low; x <= high; ++x) {
          floor = std::min<double>(floor, grey(x));
          top = std::max<double>(top, grey(x));
        }
        const double threshold = floor + 0.5 * (top - floor);
        if (top - floor < 40.0) continue;  // worn away here
        for (int x = low; x <= high; ++x) {
          const double w = std::max(0.0, grey(x) - threshold);
          weight += w;
          moment += w * x;
        }
        const double error = moment / weight - u;
        sum += error;
        worst = std::max(worst, std::abs(error));
        ++count;
      }
    }
  }
  ASSERT_GT(count, 60);
  // Wear and the texture around the line move single values, not their mean.
  EXPECT_LT(std::abs(sum / count), 0.12);
  EXPECT_LT(worst, 1.5);
}

TEST(RenderView, SamePictureForOneAndTwoThreads) {
  const SynthOptions options = small_options(RoadProfileKind::kBank, 6);
  const SynthWorld world = make_synth_world(world_options(options));
  EXPECT_EQ(render_view(world, 1, options.camera, options.sensor, 1),
            render_view(world, 1, options.camera, options.sensor, 2));
}

TEST(RenderView, NearAsphaltHasTexture) {
  // Optical flow needs something to hold on to: the road just ahead differs from its own blur by
  // a few grey levels, more than the noise alone.
  SynthOptions options = small_options(RoadProfileKind::kControl, 1);
  options.camera = {1242, 375, 721.5377, 721.5377, 609.5593, 172.854};
  options.sensor.noise = 0.0;
  options.num_cars = 0;
  const SynthWorld world = make_synth_world(world_options(options));
  const std::vector<std::uint8_t> image = render_view(world, 0, options.camera, options.sensor, 2);
  double squares = 0.0;
  int count = 0;
  const auto grey = [&](int x, int y) {
    return static_cast<double>(image[3 * (static_cast<std::size_t>(y) * 1242 + x) + 1]);
  };
  for (int y = 310; y < 365; ++y) {
    for (int x = 640; x < 760; ++x) {
      double mean = 0.0;
      for (int dy = -4; dy <= 4; ++dy) {
        for (int dx = -4; dx <= 4; ++dx) mean += grey(x + dx, y + dy) / 81.0;
      }
      squares += (grey(x, y) - mean) * (grey(x, y) - mean);
      ++count;
    }
  }
  const double spread = std::sqrt(squares / count);
  EXPECT_GT(spread, 2.0);
  EXPECT_LT(spread, 15.0);
}

TEST(SynthesiseScene, WritesACompleteScene) {
  const test::TemporaryFolder folder;
  const SynthOptions options = small_options(RoadProfileKind::kSteepHill, 3);
  const SynthSummary summary = synthesise_scene(options, folder.path() / "a");
  EXPECT_GT(summary.cars, 0);
  const Scene scene =
      read_scene(folder.path() / "a", [](const std::string& warning) { ADD_FAILURE() << warning; });
  ASSERT_EQ(scene.frames.size(), 2u);
  EXPECT_EQ(scene.reference_frame, 1);
  EXPECT_EQ(scene.height_above_road, 1.65);
  ASSERT_TRUE(scene.truth.has_value());
  ASSERT_EQ(scene.truth->frames.size(), 2u);
  EXPECT_TRUE(fs::exists(scene.truth->cloud));
  for (const SceneFrame& frame : scene.frames) {
    EXPECT_TRUE(fs::exists(frame.image));
    EXPECT_TRUE(fs::exists(frame.segmentation));
    for (const VehicleDetection& detection : frame.vehicles) {
      EXPECT_EQ(detection.keypoints.size(), 36u);
      EXPECT_FALSE(detection.has_plane);
    }
  }
  const SynthWorld world = make_synth_world(world_options(options));
  for (int f = 0; f < 2; ++f) {
    const TruthFrame& truth = scene.truth->frames[f];
    EXPECT_TRUE(fs::exists(truth.label));
    const DepthImage depth = read_depth_image(truth.depth, truth.depth_encoding, options.camera);
    const ViewTruth traced = trace_view(world, f, options.camera, 2);
    for (std::size_t i = 0; i < traced.hits.size(); ++i) {
      const double expected = traced.hits[i].distance;
      if (expected < 255.0) {
        ASSERT_NEAR(depth.metres[i], expected, 0.5 / 256.0 + 1e-6);
      }
    }
    // Poses: the world is the first frame's camera.
    ASSERT_TRUE(truth.world_from_camera.has_value());
    const SE3 expected =
        world.views[0].world_from_camera.inverse() * world.views[f].world_from_camera;
    EXPECT_LT((truth.world_from_camera->matrix() - expected.matrix()).norm(), 1e-6);
    ASSERT_TRUE(truth.ego_plane.has_value());
    EXPECT_NEAR(truth.ego_plane->offset, 1.65, 0.012);
    EXPECT_LT(truth.ego_plane->normal.y(), -0.99);
    for (const TruthVehicle& vehicle : truth.vehicles) {
      ASSERT_TRUE(vehicle.plane.has_value());
      EXPECT_LT(std::abs(vehicle.plane->signed_distance(vehicle.pose.bottom_center())), 0.02);
      EXPECT_EQ(vehicle.keypoints.size(), 36u);
    }
  }
}

TEST(SynthesiseScene, SameSeedSameFiles) {
  const test::TemporaryFolder folder;
  SynthOptions options = small_options(RoadProfileKind::kUphill, 12);
  options.num_threads = 1;
  synthesise_scene(options, folder.path() / "a");
  options.num_threads = 2;
  synthesise_scene(options, folder.path() / "b");
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder.path() / "a")) {
    if (!entry.is_regular_file() || entry.path().filename() == "run.json") continue;
    const fs::path other = folder.path() / "b" / fs::relative(entry.path(), folder.path() / "a");
    EXPECT_EQ(bytes_of(entry.path()), bytes_of(other)) << entry.path();
    ++files;
  }
  EXPECT_EQ(files, 11);  // 2 x (image, segmentation, label, depth), cloud, manifest, README
}

TEST(SynthesiseScene, LeavesNothingBehindWhenItFails) {
  const test::TemporaryFolder folder;
  SynthOptions options = small_options(RoadProfileKind::kUphill, 12);
  options.num_frames = 0;
  EXPECT_THROW(synthesise_scene(options, folder.path() / "a"), std::invalid_argument);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

}  // namespace
}  // namespace camber
