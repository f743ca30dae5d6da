// samples/steep_hill is what its documented command makes: geometry, truth, detections and a
// picture made again and compared with the files.

#include <gtest/gtest.h>

#include <filesystem>

#include "camber/image/image_io.h"
#include "camber/scene/scene.h"
#include "camber/synth/synthesise.h"
#include "support/test_data.h"

namespace camber {
namespace {

SynthOptions sample_options() {
  SynthOptions options;  // camber synth --profile steep_hill --frames 3 --seed 3 ...
  options.profile = RoadProfileKind::kSteepHill;
  options.num_frames = 3;
  options.seed = 3;
  options.cloud_points = 40000;
  options.num_threads = 2;
  return options;
}

TEST(SampleSteepHill, IsWhatItsCommandMakes) {
  const Scene scene = read_scene(test::source_dir() / "samples/steep_hill");
  const SynthOptions options = sample_options();
  const SynthWorld world = make_synth_world(world_options(options));
  ASSERT_TRUE(scene.truth.has_value());
  ASSERT_EQ(scene.frames.size(), 3u);
  EXPECT_EQ(scene.camera.fx, 721.5377);
  for (int f = 0; f < 3; ++f) {
    const ViewTruth traced = trace_view(world, f, options.camera, 2);
    const std::vector<TruthVehicle> vehicles = true_vehicles(world, f, options.camera, traced);
    DetectorModel detector;
    detector.seed = options.seed;
    const auto detections = simulate_detections(world, f, options.camera, vehicles, detector);
    const TruthFrame& truth = scene.truth->frames[f];
    ASSERT_EQ(truth.vehicles.size(), vehicles.size());
    for (std::size_t i = 0; i < vehicles.size(); ++i) {
      EXPECT_EQ(truth.vehicles[i].id, vehicles[i].id);
      // Another machine's sine may differ in the last bit.
      EXPECT_LT((truth.vehicles[i].pose.bottom_center() - vehicles[i].pose.bottom_center()).norm(),
                1e-6);
      EXPECT_NEAR(truth.vehicles[i].plane->offset, vehicles[i].plane->offset, 1e-6);
      EXPECT_NEAR(truth.vehicles[i].occlusion, vehicles[i].occlusion, 1e-3);
    }
    ASSERT_EQ(scene.frames[f].vehicles.size(), detections.size());
    for (std::size_t i = 0; i < detections.size(); ++i) {
      EXPECT_NEAR(scene.frames[f].vehicles[i].box.x1, detections[i].box.x1, 0.02);
      EXPECT_NEAR(scene.frames[f].vehicles[i].keypoints[7].pixel.y(),
                  detections[i].keypoints[7].pixel.y(), 0.02);
    }
    const Image label = read_label_image(truth.label, options.camera);
    std::size_t differ = 0;
    for (std::size_t i = 0; i < traced.labels.size(); ++i) {
      differ += label.data[i] != traced.labels[i];
    }
    EXPECT_LT(differ, traced.labels.size() / 10000);
  }
}

TEST(SampleSteepHill, PictureIsWhatItsCommandMakes) {
  const Scene scene = read_scene(test::source_dir() / "samples/steep_hill");
  const SynthOptions options = sample_options();
  const SynthWorld world = make_synth_world(world_options(options));
  CameraSensor sensor = options.sensor;
  sensor.seed = options.seed;
  const auto picture = render_view(world, 1, options.camera, sensor, 2);
  const Image image = read_color_image(scene.frames[1].image);
  ASSERT_EQ(image.data.size(), picture.size());
  // Bit for bit here; another machine's sine may differ in the last bit.
  std::size_t differ = 0;
  for (std::size_t i = 0; i < picture.size(); ++i) differ += image.data[i] != picture[i];
  EXPECT_LT(differ, picture.size() / 1000);
}

TEST(SampleSteepHill, IsSmallAndAsDescribed) {
  std::uintmax_t size = 0;
  for (const auto& entry :
       std::filesystem::recursive_directory_iterator(test::source_dir() / "samples/steep_hill")) {
    if (entry.is_regular_file()) size += entry.file_size();
  }
  EXPECT_LT(size, 4000000u);
  const Scene scene = read_scene(test::source_dir() / "samples/steep_hill");
  ASSERT_TRUE(scene.truth.has_value());
  const std::vector<TruthVehicle>& vehicles = scene.truth->frames[1].vehicles;
  EXPECT_GE(vehicles.size(), 4u);
  int standing = 0;
  for (const TruthVehicle& vehicle : vehicles) {
    EXPECT_GT(vehicle.pose.bottom_center().norm(), 8.0);
    EXPECT_LT(vehicle.pose.bottom_center().norm(), 48.0);
    standing += !vehicle.moving;
  }
  EXPECT_GE(standing, 2);
  const double driven = (scene.truth->frames[1].world_from_camera->translation() -
                         scene.truth->frames[0].world_from_camera->translation())
                            .norm();
  EXPECT_GT(driven, 0.8);
  EXPECT_LT(driven, 1.0);
}

}  // namespace
}  // namespace camber
