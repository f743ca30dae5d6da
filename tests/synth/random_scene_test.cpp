#include "camber/synth/random_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/scene/scene.h"
#include "support/test_data.h"

namespace camber {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

/// A scene in small, that takes little time.
SynthOptions in_small(SynthOptions options) {
  const double scale = 200.0 / options.camera.width;
  options.camera.width = 200;
  options.camera.height = static_cast<int>(options.camera.height * scale);
  options.camera.fx *= scale;
  options.camera.fy *= scale;
  options.camera.cx = scale * (options.camera.cx + 0.5) - 0.5;
  options.camera.cy = scale * (options.camera.cy + 0.5) - 0.5;
  options.num_frames = 2;
  return options;
}

TEST(RandomScene, SameNumberSameOptionsAnotherNumberOthers) {
  EXPECT_EQ(options_json(random_scene_options(17)).dump(),
            options_json(random_scene_options(17)).dump());
  EXPECT_NE(options_json(random_scene_options(17)).dump(),
            options_json(random_scene_options(18)).dump());
  EXPECT_NE(options_json(random_scene_options(17)).dump(),
            options_json(random_scene_options(17, 1)).dump());
  EXPECT_EQ(random_scene_options(17).name, "random_00017");
}

TEST(RandomScene, DistributionIsTheOneDocumented) {
  constexpr int kCount = 2000;
  int corners = 0, bends = 0, leads = 0, wet = 0, alike = 0, kerbs = 0, unmarked = 0, near_kerb = 0;
  double narrowest = 1e9, widest = 0.0, lowest = 1e9, highest = 0.0, least = 1e9, most = 0.0;
  for (std::uint64_t i = 0; i < kCount; ++i) {
    const SynthOptions options = random_scene_options(i);
    ASSERT_NO_THROW(options.validate()) << i;
    const SceneFeatures& f = options.features;
    corners += f.corner.enabled;
    bends += f.bend.radius > 0.0;
    leads += f.lead_car.enabled;
    wet += f.asphalt.wetness > 0.0;
    alike += f.asphalt.texture != AsphaltTexture::kVaried;
    kerbs += f.roadside.pavements != Pavements::kNone;
    unmarked += f.markings == Markings::kNone;
    near_kerb += f.roadside.pavements != Pavements::kNone && f.roadside.edge_distance.has_value();
    const PinholeCamera& camera = options.camera;
    const double view = 2.0 * std::atan(0.5 * camera.width / camera.fx) / kDegree;
    narrowest = std::min(narrowest, view);
    widest = std::max(widest, view);
    lowest = std::min(lowest, options.camera_height);
    highest = std::max(highest, options.camera_height);
    const double speed = f.corner.enabled ? f.corner.radius * f.corner.yaw_rate : options.speed;
    const double heights = speed / options.frame_rate / options.camera_height;
    least = std::min(least, heights);
    most = std::max(most, heights);
    if (f.corner.enabled) {
      EXPECT_GE(f.corner.radius, 6.0);
      EXPECT_LE(f.corner.radius, 15.0);
      EXPECT_GE(f.corner.yaw_rate, 20.0 * kDegree - 1e-12);
      EXPECT_LE(f.corner.yaw_rate, 40.0 * kDegree + 1e-12);
    }
    // Level road within 10 m in the lowest row.
    const double down = std::atan((camera.height - 1 - camera.cy) / camera.fy) - *f.mounting.pitch;
    EXPECT_LT(options.camera_height / std::tan(down), 10.0) << i;
    if (f.roadside.kerb_height) {
      EXPECT_LE(*f.roadside.kerb_height, 0.20);
    }
  }
  // Four standard deviations of a share: sqrt(p (1 - p) / 2000) is about 1 %.
  const auto near_share = [](int count, double share) {
    EXPECT_NEAR(static_cast<double>(count) / kCount, share,
                4.0 * std::sqrt(share * (1.0 - share) / kCount));
  };
  near_share(corners, 0.20);
  near_share(bends, 0.25);
  near_share(leads, 0.25);
  near_share(wet, 0.20);
  near_share(alike, 0.20);
  near_share(kerbs, 0.8 * 0.50 + 0.2 * 0.80);
  near_share(near_kerb, 0.6 * 0.56);
  EXPECT_GT(unmarked, 0.35 * kCount);
  EXPECT_LT(unmarked, 0.50 * kCount);
  EXPECT_LT(narrowest, 43.0);
  EXPECT_GE(narrowest, 40.0);
  EXPECT_GT(widest, 108.0);
  EXPECT_LE(widest, 110.0);
  EXPECT_LT(lowest, 0.95);
  EXPECT_GE(lowest, 0.9);
  EXPECT_GT(highest, 2.9);
  EXPECT_LE(highest, 3.0);
  EXPECT_LT(least, 0.12);
  EXPECT_GT(least, 0.02);
  EXPECT_GT(most, 1.1);
  EXPECT_LE(most, 1.2 + 1e-9);
}

TEST(RandomScene, CameraIsAtItsNominalHeight) {
  for (std::uint64_t i = 0; i < 12; ++i) {
    WorldOptions options = world_options(random_scene_options(i));
    options.scenery = false;
    const SynthWorld world = make_synth_world(options);
    for (const SynthView& view : world.views) {
      EXPECT_NEAR(view.ego_plane.signed_distance(view.world_from_camera.translation()),
                  options.camera_height, 0.015)
          << i;
    }
  }
}

TEST(RandomScene, SameSceneForOneAndSeveralThreads) {
  for (const std::uint64_t number : {0u, 1u, 4u}) {
    SynthOptions options = in_small(random_scene_options(number));
    const SynthWorld a = make_synth_world(world_options(options));
    const SynthWorld b = make_synth_world(world_options(options));
    CameraSensor sensor = options.sensor;
    sensor.seed = options.seed;
    EXPECT_EQ(render_view(a, 1, options.camera, sensor, 1),
              render_view(b, 1, options.camera, sensor, 5))
        << number;
    const ViewTruth one = trace_view(a, 1, options.camera, 1);
    const ViewTruth five = trace_view(b, 1, options.camera, 5);
    EXPECT_EQ(one.labels, five.labels);
    EXPECT_EQ(one.visible_pixels, five.visible_pixels);
    for (std::size_t i = 0; i < one.hits.size(); ++i) {
      ASSERT_EQ(one.hits[i].distance, five.hits[i].distance);
    }
  }
}

TEST(RandomScene, WritesACompleteSceneWithWhatWasDrawn) {
  const test::TemporaryFolder folder;
  SynthOptions options = in_small(random_scene_options(3));
  options.cloud_points = 500;
  const SynthSummary summary = synthesise_scene(options, folder.path() / "a");
  EXPECT_EQ(summary.name, "random_00003");
  const Scene scene =
      read_scene(folder.path() / "a", [](const std::string& warning) { ADD_FAILURE() << warning; });
  EXPECT_EQ(scene.name, "random_00003");
  EXPECT_EQ(scene.height_above_road, options.camera_height);
  ASSERT_TRUE(scene.truth.has_value());
  for (const TruthFrame& frame : scene.truth->frames) {
    EXPECT_TRUE(frame.ego_plane.has_value());
    EXPECT_TRUE(frame.world_from_camera.has_value());
    EXPECT_TRUE(std::filesystem::exists(frame.label));
    for (const TruthVehicle& vehicle : frame.vehicles) {
      EXPECT_EQ(vehicle.keypoints.size(), 36u);
      EXPECT_TRUE(vehicle.plane.has_value());
    }
  }
  EXPECT_EQ(scene.markings_m.empty(), options.features.markings == Markings::kNone);
}

}  // namespace
}  // namespace camber
