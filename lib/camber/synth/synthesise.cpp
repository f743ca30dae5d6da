#include "camber/synth/synthesise.h"

#include <fmt/format.h>

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <ostream>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/core/version.h"
#include "camber/geometry/lens_map.h"
#include "camber/image/image_io.h"
#include "camber/import/import_synthia.h"
#include "camber/scene/results.h"
#include "camber/synth/detail/frame_writer.h"
#include "camber/synth/detail/scene_readme.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

void check(bool good, const char* name, double value, const char* expected) {
  if (!good) {
    throw std::invalid_argument(fmt::format("{}: found {}, expected {}", name, value, expected));
  }
}

/// A data set's files have its camera and no lens.
void validate_layout(const SynthOptions& options) {
  const DataSetLayout& layout = options.layout;
  check(layout.sequence >= 0 && layout.sequence <= 9999, "sequence", layout.sequence, "0 to 9999");
  if (layout.layout == SceneLayout::kCamber) return;
  if (options.lens != LensModel::kNone) {
    throw std::invalid_argument(fmt::format("lens: found {}, expected none in the layout {}",
                                            to_string(options.lens), to_string(layout.layout)));
  }
  if (layout.layout != SceneLayout::kSynthiaSf) return;
  const PinholeCamera &given = options.camera,
                      camera = synthia_sf_camera(given.width, given.height);
  const double difference =
      std::max({std::abs(given.fx - camera.fx), std::abs(given.fy - camera.fy),
                std::abs(given.cx - camera.cx), std::abs(given.cy - camera.cy)});
  if (difference > 1e-6) {
    throw std::invalid_argument(fmt::format(
        "camera: found intrinsics {},{},{},{}, expected those of SYNTHIA-SF, "
        "{},{},{},{}",
        given.fx, given.fy, given.cx, given.cy, camera.fx, camera.fy, camera.cx, camera.cy));
  }
}

/// Random points of the road, its pavements and pads, from station -5 m to 95 m (a junction: 75 m,
/// and 45 m to its sides), uniform in plan; binary PLY with a label (1 road, 2 pavement and kerb).
void write_road_cloud(const SynthWorld& world, int count, std::uint64_t seed,
                      const fs::path& path) {
  const RoadLayout& layout = world.road.layout();
  const SE3 camera_from_world = world.views.front().world_from_camera.inverse();
  double reach = 0.5;
  for (int side = 0; side < 2; ++side) {
    if (layout.pavement[side]) reach = std::max(reach, layout.pavement_width);
  }
  for (const RoadLayout::Pad& pad : layout.pads) reach = std::max(reach, pad.depth);
  const double half = layout.junction ? 45.0 : layout.half_width + reach;
  const double last = layout.junction ? 75.0 : 95.0;
  const CounterRandom random(seed, 0x434C4F55);

  std::string body;
  int written = 0;
  for (std::uint64_t i = 0; written < count; ++i) {
    const double station = random.uniform(2 * i, -5.0, last);
    const double offset = random.uniform(2 * i + 1, -half, half);
    const GroundKind kind = world.road.kind(station, offset);
    if (kind == GroundKind::kVerge) continue;
    const Eigen::Vector3f p = (camera_from_world * world.road.point(station, offset)).cast<float>();
    char bytes[13];
    std::memcpy(bytes, p.data(), 12);
    bytes[12] = kind == GroundKind::kRoad ? 1 : 2;
    body.append(bytes, 13);
    ++written;
  }
  write_file_atomically(path, [&](std::ostream& out) {
    out << "ply\nformat binary_little_endian 1.0\ncomment camber frame camera\n"
        << "comment label 1 road, 2 pavement\nelement vertex " << written
        << "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar label\n"
        << "end_header\n";
    out.write(body.data(), static_cast<std::streamsize>(body.size()));
  });
}

LensDistortion lens_of(const SynthOptions& options) {
  return {options.lens, options.lens_coefficients, options.camera};
}

/// A lens whose polynomials turn back within the images draws nothing in the rest of them.
void validate_lens(const SynthOptions& options) {
  const LensDistortion lens = lens_of(options);
  lens.validate();
  if (lens.model == LensModel::kNone) return;
  const PinholeCamera& raw = options.camera;
  const LensMap map(raw, lens);
  constexpr int kSteps = 16;
  int seen = 0;
  for (int i = 0; i <= kSteps; ++i) {
    for (int k = 0; k <= kSteps; ++k) {
      seen +=
          map.pinhole_from_raw({(raw.width - 1.0) * i / kSteps, (raw.height - 1.0) * k / kSteps})
              .has_value();
    }
  }
  const double share = static_cast<double>(seen) / ((kSteps + 1) * (kSteps + 1));
  check(share >= 0.7, "share of the image that the lens's model reaches", share,
        "at least 0.7 (coefficients of a wider lens, or a longer focal length)");
}

}  // namespace

void SynthOptions::validate() const {
  camera.validate();
  check(camera.width >= 16 && camera.width <= 4096, "camera.width", camera.width, "16 to 4096 px");
  check(camera.height >= 16 && camera.height <= 4096, "camera.height", camera.height,
        "16 to 4096 px");
  // Beyond these a ray's direction leaves what the ray tracer computes with.
  const double side = std::max(camera.width, camera.height);
  for (const double focal : {camera.fx, camera.fy}) {
    check(focal >= 0.01 * side && focal <= 1000.0 * side, "camera.fx, fy", focal,
          "0.01 to 1000 times the image's longer side");
  }
  for (const double middle : {camera.cx, camera.cy}) {
    check(std::abs(middle) <= 100.0 * side, "camera.cx, cy", middle,
          "at most 100 times the image's longer side");
  }
  validate_lens(*this);
  validate_layout(*this);
  check(num_frames >= 1 && num_frames <= 1000, "num_frames", num_frames, "1 to 1000");
  check(frame_rate >= 1e-3 && frame_rate <= 100.0, "frame_rate", frame_rate, "0.001 to 100 Hz");
  check(speed >= 0.0 && speed <= 40.0, "speed", speed, "0 to 40 m/s");
  // The road that is made is 420 m long; the view needs the last 200.
  features.validate();
  const CornerOptions& corner = features.corner;
  const double pace = corner.enabled ? corner.radius * corner.yaw_rate : speed;
  const double driven = pace * (num_frames - 1) / frame_rate;
  check(driven <= 200.0, "driven length", driven, "at most 200 m");
  check(!corner.enabled || driven <= 40.0, "driven length at a corner", driven, "at most 40 m");
  check(camera_height >= 0.5 && camera_height <= 4.0, "camera_height", camera_height, "0.5 to 4 m");
  check(num_cars >= 0 && num_cars <= 30, "num_cars", num_cars, "0 to 30");
  check(nearest_car >= 6.0 && nearest_car <= 100.0, "nearest_car", nearest_car, "6 to 100 m");
  check(farthest_car > nearest_car && farthest_car <= 100.0, "farthest_car", farthest_car,
        "more than nearest_car and at most 100 m");
  check(sensor.supersampling >= 1 && sensor.supersampling <= 6, "supersampling",
        sensor.supersampling, "1 to 6");
  check(std::max(camera.width, camera.height) * sensor.supersampling <= 16384, "supersampled side",
        std::max(camera.width, camera.height) * sensor.supersampling, "at most 16384 samples");
  check(sensor.blur >= 0.0 && sensor.blur <= 3.0, "blur", sensor.blur, "0 to 3 px");
  check(sensor.noise >= 0.0 && sensor.noise <= 30.0, "noise", sensor.noise, "0 to 30 grey levels");
  check(sensor.exposure_change >= 0.0 && sensor.exposure_change <= 0.5, "exposure_change",
        sensor.exposure_change, "0 to 0.5");
  check(sensor.vignetting >= 0.0 && sensor.vignetting <= 0.9, "vignetting", sensor.vignetting,
        "0 to 0.9");
  check(detector.keypoint_error >= 0.0 && detector.keypoint_error <= 20.0, "keypoint_error",
        detector.keypoint_error, "0 to 20 px of the crop");
  check(detector.outlier_share >= 0.0 && detector.outlier_share <= 1.0, "outlier_share",
        detector.outlier_share, "0 to 1");
  check(detector.miss_share >= 0.0 && detector.miss_share <= 1.0, "miss_share", detector.miss_share,
        "0 to 1");
  check(detector.false_boxes >= 0.0 && detector.false_boxes <= 1.0, "false_boxes",
        detector.false_boxes, "0 to 1");
  check(cloud_points >= 0 && cloud_points <= 5000000, "cloud_points", cloud_points,
        "0 to 5 million");
}

ViewCamera view_camera(const SynthOptions& options) {
  if (options.lens == LensModel::kNone) return options.camera;
  return {lens_of(options), options.num_threads};
}

WorldOptions world_options(const SynthOptions& options) {
  WorldOptions out;
  out.seed = options.seed;
  out.profile = options.profile;
  out.num_frames = options.num_frames;
  out.frame_rate = options.frame_rate;
  out.speed = options.speed;
  out.camera_height = options.camera_height;
  out.num_cars = options.num_cars;
  out.nearest_car = options.nearest_car;
  out.farthest_car = options.farthest_car;
  out.features = options.features;
  return out;
}

namespace {

/// What does not change from frame to frame of the manifest.
Scene begin_scene(const SynthOptions& options, const ViewCamera& view, const SynthWorld& world) {
  Scene scene;
  scene.name = options.name.empty() ? fmt::format("{}_{}", to_string(options.profile), options.seed)
                                    : options.name;
  scene.camera = view.camera();
  if (view.has_lens()) scene.distortion = lens_of(options);
  scene.height_above_road = options.camera_height;
  scene.frame_rate = options.frame_rate;
  scene.reference_frame = options.num_frames / 2;
  scene.detections_source = "simulated_network";
  scene.segmentation_classes = {{"road", {static_cast<int>(SegmentationClass::kRoad)}},
                                {"pavement", {static_cast<int>(SegmentationClass::kPavement)}},
                                {"vehicle", {static_cast<int>(SegmentationClass::kVehicle)}}};
  if (world.markings.center_line) {
    scene.markings_m = {{"dash_length", world.markings.dash_length},
                        {"dash_gap", world.markings.dash_gap},
                        {"line_width", world.markings.line_width}};
  }
  return scene;
}

void write_run(const SynthOptions& options, const SynthWorld& world, const SynthSummary& summary,
               const fs::path& path) {
  nlohmann::json timings = nlohmann::json::object();
  for (const auto& [stage, ms] : summary.timings.stages()) timings[stage] = ms;
  write_json({{"version", kVersion},
              {"seed", options.seed},
              {"options", options_json(options)},
              {"cars", summary.cars},
              {"speed", summary.speed},
              {"min_vertical_radius_m", world.road.profile().min_vertical_radius()},
              {"timings_ms", timings}},
             path);
}

}  // namespace

SynthSummary synthesise_scene(const SynthOptions& options, const fs::path& folder, bool overwrite,
                              const Progress& progress) {
  options.validate();
  SynthSummary summary;
  AtomicFolder atomic(folder, overwrite);
  const fs::path& root = atomic.staging();
  for (const fs::path& part : options.layout.folders()) {
    std::error_code error;
    fs::create_directories(root / part, error);
    if (error) throw OutputError((root / part).string(), error.message());
  }
  const auto report = [&](const std::string& stage, double share) {
    if (progress) progress(stage, share);
  };

  StageTimer geometry_timer(summary.timings, "geometry");
  const SynthWorld world = make_synth_world(world_options(options));
  summary.cars = static_cast<int>(world.cars.size());
  summary.speed = world.speed;
  geometry_timer.stop();

  const ViewCamera view = view_camera(options);
  Scene scene = begin_scene(options, view, world);
  summary.name = scene.name;
  SceneTruth truth;
  truth.cloud = root / "truth/road.ply";
  truth.cloud_frame = 0;
  FrameWriter writer(options, view, world,
                     {0, world.views.front().world_from_camera.inverse(), 0, true}, root, &summary);
  for (int f = 0; f < options.num_frames; ++f) {
    report("frames", static_cast<double>(f) / options.num_frames);
    SceneFrame frame;
    TruthFrame frame_truth;
    writer.write_truth(f, &frame, &frame_truth);
    report("frames", (f + 0.3) / options.num_frames);
    writer.write_image(f, &frame);
    scene.frames.push_back(std::move(frame));
    truth.frames.push_back(std::move(frame_truth));
  }

  StageTimer write_timer(summary.timings, "write");
  write_road_cloud(world, options.cloud_points, options.seed, truth.cloud);
  scene.truth = std::move(truth);
  write_scene(scene, root / "scene.json");
  const fs::path detections = options.layout.detections();
  if (!detections.empty()) write_kitti_detections(scene, root / detections);
  if (options.layout.layout == SceneLayout::kKittiTracking) {
    write_kitti_tracking_files(scene, options.layout.sequence, root);
  }
  write_file_atomically(root / "README.md", scene_readme(options, scene, world));
  write_timer.stop();
  write_run(options, world, summary, root / "run.json");
  atomic.commit();
  report("frames", 1.0);
  return summary;
}

}  // namespace camber
