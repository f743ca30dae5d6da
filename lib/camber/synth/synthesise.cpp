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
#include "camber/image/image_io.h"
#include "camber/scene/results.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

void check(bool good, const char* name, double value, const char* expected) {
  if (!good) {
    throw std::invalid_argument(fmt::format("{}: found {}, expected {}", name, value, expected));
  }
}

/// Scenes are made once and kept: the smallest files.
constexpr int kCompression = 9;

void write_image(Image image, const fs::path& path) {
  write_file_atomically(path, encode_png(image, kCompression));
}

/// Metres * 256 in 16 bits, 0 for the sky and beyond 255.9 m.
std::vector<std::uint16_t> kitti_depth(const ViewTruth& truth) {
  std::vector<std::uint16_t> out;
  out.reserve(truth.hits.size());
  for (const WorldHit& hit : truth.hits) {
    out.push_back(
        hit.distance < 255.9 ? static_cast<std::uint16_t>(std::lround(256.0 * hit.distance)) : 0);
  }
  return out;
}

/// Random points of the road, its pavements and pads, from 5 m behind the first camera to 95 m
/// ahead of it, uniform in plan; binary PLY with a label (1 road, 2 pavement and kerb).
void write_road_cloud(const SynthWorld& world, int count, std::uint64_t seed,
                      const fs::path& path) {
  const RoadLayout& layout = world.road.layout();
  const SE3 camera_from_world = world.views.front().world_from_camera.inverse();
  double reach = 0.5;
  for (int side = 0; side < 2; ++side) {
    if (layout.pavement[side]) reach = std::max(reach, layout.pavement_width);
  }
  for (const RoadLayout::Pad& pad : layout.pads) reach = std::max(reach, pad.depth);
  const double half = layout.half_width + reach;
  const CounterRandom random(seed, 0x434C4F55);

  std::string body;
  int written = 0;
  for (std::uint64_t i = 0; written < count; ++i) {
    const double station = random.uniform(2 * i, -5.0, 95.0);
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

std::string readme(const SynthOptions& options, const Scene& scene, const SynthWorld& world) {
  std::string text = fmt::format(
      "# {}\n\nA made scene of a steep road (`{}`): {} frames at {} Hz from one camera that drives "
      "{} m/s, {} m above the road, with {} cars and complete truth. Nothing in it was "
      "photographed.\n\n",
      scene.name, to_string(options.profile), options.num_frames, options.frame_rate, options.speed,
      options.camera_height, world.cars.size());
  if (!options.command.empty()) {
    text +=
        "Made again, bit for bit but for the times in run.json (images: on the same OpenGL "
        "driver), by\n\n```\n" +
        options.command + "\n```\n\n";
  }
  text +=
      "| path | what |\n|---|---|\n"
      "| `scene.json` | the manifest: camera, frames, simulated detections, truth |\n"
      "| `image/` | 8-bit colour images with noise, blur, vignetting and exposure changes |\n"
      "| `segmentation/` | a simulated segmentation: 0 other, 1 road, 2 pavement, 3 vehicle; "
      "ragged edges, some wrong regions |\n"
      "| `truth/depth/` | first and last frame: 16-bit, metres along z * 256, 0 none or beyond "
      "255.9 m |\n"
      "| `truth/label/` | true classes: 7 road, 8 pavement, kerb and parking place, 11 building, "
      "17 "
      "post, 20 sign, 21 plants, 22 grass, 23 sky, 26 car |\n"
      "| `truth/road.ply` | random points on the true road (label 1) and pavements (2), first "
      "camera's frame, seen or not |\n"
      "| `run.json` | options and times |\n\n"
      "Boxes of detections are those of the whole car, clipped to the image, with an error of up "
      "to "
      "2 px; keypoints that are seen are off by about a pixel of the 64 x 64 crop of the box, some "
      "are gross outliers, hidden ones are poor guesses. `plane` of a true car is the "
      "least-squares "
      "plane of the surface between and around its wheels, `ego_plane` that under the camera.\n\n"
      "Road ahead of the first camera (station in plan; grade positive: climbs; bank positive: "
      "left "
      "side up):\n\n| station (m) | grade (deg) | bank (deg) |\n|---|---|---|\n";
  constexpr double kDegrees = 180.0 / 3.14159265358979323846;
  for (int station = 0; station <= 60; station += 10) {
    text += fmt::format("| {} | {:.1f} | {:.1f} |\n", station,
                        kDegrees * world.road.profile().grade(station),
                        kDegrees * world.road.profile().bank(station));
  }
  return text;
}

nlohmann::json options_json(const SynthOptions& o) {
  return {{"profile", to_string(o.profile)},
          {"frames", o.num_frames},
          {"frame_rate", o.frame_rate},
          {"speed", o.speed},
          {"camera",
           {{"width", o.camera.width},
            {"height", o.camera.height},
            {"fx", o.camera.fx},
            {"fy", o.camera.fy},
            {"cx", o.camera.cx},
            {"cy", o.camera.cy}}},
          {"camera_height", o.camera_height},
          {"cars", o.num_cars},
          {"nearest_car", o.nearest_car},
          {"farthest_car", o.farthest_car},
          {"supersampling", o.sensor.supersampling},
          {"blur", o.sensor.blur},
          {"noise", o.sensor.noise},
          {"exposure_change", o.sensor.exposure_change},
          {"vignetting", o.sensor.vignetting},
          {"keypoint_error", o.detector.keypoint_error},
          {"outlier_share", o.detector.outlier_share},
          {"miss_share", o.detector.miss_share},
          {"false_boxes", o.detector.false_boxes},
          {"cloud_points", o.cloud_points}};
}

}  // namespace

void SynthOptions::validate() const {
  camera.validate();
  check(camera.width >= 16 && camera.width <= 4096, "camera.width", camera.width, "16 to 4096 px");
  check(camera.height >= 16 && camera.height <= 4096, "camera.height", camera.height,
        "16 to 4096 px");
  check(num_frames >= 1 && num_frames <= 1000, "num_frames", num_frames, "1 to 1000");
  check(frame_rate > 0.0 && frame_rate <= 100.0, "frame_rate", frame_rate, "0 to 100 Hz");
  check(speed >= 0.0 && speed <= 40.0, "speed", speed, "0 to 40 m/s");
  // The road that is made is 420 m long; the view needs the last 200.
  check(speed * (num_frames - 1) / frame_rate <= 200.0, "driven length",
        speed * (num_frames - 1) / frame_rate, "at most 200 m");
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
  return out;
}

SynthSummary synthesise_scene(const SynthOptions& options, const fs::path& folder, bool overwrite,
                              const Progress& progress) {
  options.validate();
  SynthSummary summary;
  AtomicFolder atomic(folder, overwrite);
  const fs::path& root = atomic.staging();
  for (const char* part : {"image", "segmentation", "truth/depth", "truth/label"}) {
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
  geometry_timer.stop();

  Scene scene;
  scene.name = options.name.empty() ? fmt::format("{}_{}", to_string(options.profile), options.seed)
                                    : options.name;
  scene.camera = options.camera;
  scene.height_above_road = options.camera_height;
  scene.frame_rate = options.frame_rate;
  scene.reference_frame = options.num_frames / 2;
  scene.detections_source = "simulated_network";
  scene.segmentation_classes = {{"road", {static_cast<int>(SegmentationClass::kRoad)}},
                                {"pavement", {static_cast<int>(SegmentationClass::kPavement)}},
                                {"vehicle", {static_cast<int>(SegmentationClass::kVehicle)}}};
  scene.markings_m = {{"dash_length", world.markings.dash_length},
                      {"dash_gap", world.markings.dash_gap},
                      {"line_width", world.markings.line_width}};
  SceneTruth truth;
  truth.cloud = root / "truth/road.ply";
  truth.cloud_frame = 0;

  CameraSensor sensor = options.sensor;
  sensor.seed = options.seed;
  DetectorModel detector = options.detector;
  detector.seed = options.seed;
  const SE3 first_from_world = world.views.front().world_from_camera.inverse();
  for (int f = 0; f < options.num_frames; ++f) {
    report("frames", static_cast<double>(f) / options.num_frames);
    const std::string file = fmt::format("{:06d}.png", f);
    const int width = options.camera.width, height = options.camera.height;

    StageTimer truth_timer(summary.timings, "truth");
    const ViewTruth seen = trace_view(world, f, options.camera, options.num_threads);
    TruthFrame frame_truth;
    frame_truth.id = f;
    frame_truth.world_from_camera = first_from_world * world.views[f].world_from_camera;
    const SE3 camera_from_world = world.views[f].world_from_camera.inverse();
    frame_truth.ego_plane = world.views[f].ego_plane.transformed(camera_from_world);
    frame_truth.vehicles = true_vehicles(world, f, options.camera, seen);
    frame_truth.label = root / "truth/label" / file;
    write_image({width, height, 1, seen.labels}, frame_truth.label);
    if (f == 0 || f == options.num_frames - 1) {
      frame_truth.depth = root / "truth/depth" / file;
      frame_truth.depth_encoding = "kitti";
      write_file_atomically(frame_truth.depth,
                            encode_png16(width, height, kitti_depth(seen), kCompression));
    }

    SceneFrame frame;
    frame.id = f;
    frame.time_s = f / options.frame_rate;
    frame.image = root / "image" / file;
    frame.segmentation = root / "segmentation" / file;
    frame.vehicles = simulate_detections(world, f, options.camera, frame_truth.vehicles, detector);
    summary.detections += static_cast<int>(frame.vehicles.size());
    std::vector<std::uint8_t> segmentation =
        simulate_segmentation(seen, options.camera, options.seed, f);
    write_image({width, height, 1, std::move(segmentation)}, frame.segmentation);
    truth.frames.push_back(std::move(frame_truth));
    truth_timer.stop();

    report("frames", (f + 0.3) / options.num_frames);
    StageTimer render_timer(summary.timings, "render");
    std::vector<std::uint8_t> picture =
        render_view(world, f, options.camera, sensor, options.num_threads);
    write_image({width, height, 3, std::move(picture)}, frame.image);
    scene.frames.push_back(std::move(frame));
  }

  StageTimer write_timer(summary.timings, "write");
  write_road_cloud(world, options.cloud_points, options.seed, truth.cloud);
  scene.truth = std::move(truth);
  write_scene(scene, root / "scene.json");
  write_file_atomically(root / "README.md", readme(options, scene, world));
  write_timer.stop();
  write_json({{"version", kVersion},
              {"seed", options.seed},
              {"options", options_json(options)},
              {"cars", summary.cars},
              {"min_vertical_radius_m", world.road.profile().min_vertical_radius()},
              {"timings_ms",
               [&] {
                 nlohmann::json out = nlohmann::json::object();
                 for (const auto& [stage, ms] : summary.timings.stages()) out[stage] = ms;
                 return out;
               }()}},
             root / "run.json");
  atomic.commit();
  report("frames", 1.0);
  return summary;
}

}  // namespace camber
