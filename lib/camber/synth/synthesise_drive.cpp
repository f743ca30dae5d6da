#include "camber/synth/synthesise_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>
#include <ostream>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/core/version.h"
#include "camber/scene/results.h"
#include "camber/synth/detail/drive_road.h"
#include "camber/synth/detail/drive_traffic.h"
#include "camber/synth/detail/ego_motion.h"
#include "camber/synth/detail/frame_writer.h"
#include "camber/synth/detail/ground_mesh.h"
#include "camber/synth/detail/noise.h"
#include "camber/synth/detail/ray_caster.h"
#include "camber/synth/detail/scenery.h"
#include "camber/synth/detail/world_parts.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;
constexpr double kBlockLength = 40.0;  // m that are driven in a block of the world
constexpr int kBlockFrames = 120;      // at most

void check(bool good, const char* name, double value, const char* expected) {
  if (!good) {
    throw std::invalid_argument(fmt::format("{}: found {}, expected {}", name, value, expected));
  }
}

WorldOptions drive_world_options(const SynthDriveOptions& options) {
  WorldOptions out = world_options(options.scene);
  out.profile = RoadProfileKind::kLevel;
  out.num_cars = 0;
  out.farthest_car = 0.0;  // no pads
  return out;
}

/// What is true and not stated.
struct DriveTruth {
  double height = 1.65;      ///< m
  double focal_ratio = 1.0;  ///< true over stated
  PinholeCamera camera;      ///< with the true focal length
};

DriveTruth draw_truth(const SynthDriveOptions& options) {
  const CounterRandom random(options.scene.seed, 0x44545255);
  DriveTruth out;
  const auto draw = [&](std::uint64_t i) { return std::clamp(random.normal(i), -3.0, 3.0); };
  out.height = options.scene.camera_height + options.height_sigma * draw(0);
  if (options.focal_sigma > 0.0 && random.uniform(20) < 0.5) {
    out.focal_ratio = std::exp(options.focal_sigma * draw(1));
  }
  out.camera = options.scene.camera;
  out.camera.fx *= out.focal_ratio;
  out.camera.fy *= out.focal_ratio;
  return out;
}

int draw_standstills(const SynthDriveOptions& options) {
  if (options.path) return 0;
  if (options.standstills) return *options.standstills;
  const CounterRandom random(options.scene.seed, 0x5354414E);
  const double expected = options.scene.num_frames / 300.0;
  // Every other drive of 150 frames stands once.
  return static_cast<int>(expected + random.uniform(0));
}

/// Everything about a drive but its meshes.
class DrivePlan {
 public:
  explicit DrivePlan(const SynthDriveOptions& options)
      : options_(options),
        truth_(draw_truth(options)),
        standstills_(draw_standstills(options)),
        world_options_(drive_world_options(options)),
        layout_(draw_layout(world_options_)),
        followed_(options.path ? std::optional<FollowedRoad>(follow_path(*options.path, lane()))
                               : std::nullopt),
        road_(followed_ ? followed_->profile : drawn_road(options), layout_),
        limits_(road_.profile()),
        states_(drive()),
        traffic_(road_, states_, options.scene.frame_rate, lane(), options.traffic,
                 options.scene.seed) {
    draw_mounting();
    for (int f = 0; f < options.scene.num_frames; ++f) views_.push_back(make_view(f));
  }

  const DriveTruth& truth() const { return truth_; }
  const RoadModel& road() const { return road_; }
  const DriveTraffic& traffic() const { return traffic_; }
  const SynthView& view(int frame) const { return views_[static_cast<std::size_t>(frame)]; }
  const DriveState& state(int frame) const { return states_[static_cast<std::size_t>(frame)]; }
  /// How often the car stands; a short drive may end before it has all that were asked for.
  int standstills() const {
    int out = 0;
    for (std::size_t i = 1; i < states_.size(); ++i) {
      out += states_[i].speed == 0.0 && states_[i - 1].speed > 0.0 ? 1 : 0;
    }
    return out;
  }
  const MarkingSizes& markings() const { return markings_; }

  double length() const {
    double out = 0.0;
    for (std::size_t i = 1; i < views_.size(); ++i) {
      out += (views_[i].world_from_camera.translation() -
              views_[i - 1].world_from_camera.translation())
                 .norm();
    }
    return out;
  }

  /// The last frame of the block that begins at a frame.
  int last_of_block(int first) const {
    int last = first;
    const int end = std::min(first + kBlockFrames, options_.scene.num_frames) - 1;
    while (last < end && state(last + 1).station - state(first).station < kBlockLength) ++last;
    return last;
  }

  /// The world around frames [first, last], with its origin moved by -origin.
  SynthWorld block(int first, int last, const Eigen::Vector3d& origin) const {
    SynthWorld world{road_, markings_, {}, {}, {}, {}, {}, {}, {}, {}};
    world.asphalt = {options_.scene.features.asphalt.texture,
                     static_cast<float>(options_.scene.features.asphalt.wetness)};
    world.light = light_;
    const auto whole = [](double x) { return 2.0 * std::floor(0.5 * x); };
    GroundReach reach;
    reach.begin = std::max(whole(state(first).station - 16.0), whole(-kDriveBefore) + 2.0);
    reach.fine_end = whole(state(last).station + 70.0);
    reach.medium_end = whole(state(last).station + 130.0);
    reach.end = state(last).station + kDriveBeyond - 20.0;
    reach.limits = &limits_;
    SynthMesh& mesh = world.ground_and_things;
    build_ground(road_, texture_.seed, texture_.contrast, &mesh, reach);
    world.num_ground = mesh.triangles.size();
    const double stretch = kSceneryStretch;
    for (double s = stretch * std::floor(reach.begin / stretch); s < state(last).station + 260.0;
         s += stretch) {
      build_scenery_stretch(road_, options_.scene.seed, s, state(last).station + 100.0, limits_,
                            &mesh);
    }
    world.cars = traffic_.cars_in(first, last);
    for (int f = first; f <= last; ++f) world.views.push_back(view(f));
    move(&world, -origin);
    world.rays = std::make_shared<RayCaster>(mesh, world.num_ground, world.cars, last - first + 1);
    return world;
  }

 private:
  static RoadProfile drawn_road(const SynthDriveOptions& options) {
    const SynthOptions& scene = options.scene;
    const double length =
        std::max(20.0, 1.3 * scene.speed * scene.num_frames / scene.frame_rate + 20.0);
    return draw_drive_road(scene.seed, length, scene.speed);
  }

  double lane() const {
    const auto& edge = options_.scene.features.roadside.edge_distance;
    return edge ? *edge - layout_.half_width : -0.5 * layout_.half_width;
  }

  std::vector<DriveState> drive() const {
    const SynthOptions& scene = options_.scene;
    if (followed_) {
      std::vector<double> stations = followed_->stations;
      stations.resize(static_cast<std::size_t>(scene.num_frames));
      return drive_by_stations(stations, scene.frame_rate);
    }
    return drive_along(road_.profile(),
                       {scene.seed, scene.num_frames, scene.frame_rate, scene.speed, standstills_});
  }

  void draw_mounting() {
    const CounterRandom random(options_.scene.seed, 0x4D4F554E);
    const MountingOptions& given = options_.scene.features.mounting;
    mounting_.pitch = given.pitch.value_or(random.uniform(0, -1.5, 0.8) * kDegree);
    mounting_.yaw = given.yaw.value_or(random.uniform(1, -0.6, 0.6) * kDegree);
    mounting_.roll = given.roll.value_or(random.uniform(2, -0.6, 0.6) * kDegree);
    mounting_.height = truth_.height;
    const CounterRandom marks(options_.scene.seed, kMarkingStream);
    markings_ = draw_markings(world_options_, marks);
    texture_ = draw_texture(world_options_, marks);
    light_ = draw_light(world_options_);
  }

  /// The camera at a frame: its mounting, the body's pitch, and what the road shakes it by.
  SynthView make_view(int frame) const {
    const DriveState& now = state(frame);
    const double lane_middle = lane();
    const auto offset_at = [&](double station) {
      return lane_offset(station, lane_middle, options_.scene.seed);
    };
    const double slope = (offset_at(now.station + 0.5) - offset_at(now.station - 0.5)) / 1.0;
    const double heading = road_.profile().heading(now.station) + std::atan(slope);
    const double ahead = options_.scene.features.mounting.ahead_of_axle;
    const Eigen::Vector2d place = road_.place(now.station, offset_at(now.station)) +
                                  ahead * Eigen::Vector2d(std::cos(heading), std::sin(heading));
    // Slow sway (a second) and shaking, none of it where the car stands.
    const auto seed = static_cast<std::uint32_t>(options_.scene.seed);
    const auto time = static_cast<float>(frame / options_.scene.frame_rate);
    const double shaken = std::min(1.0, now.speed / 3.0);
    const CounterRandom random(options_.scene.seed, 0x5348414B);
    const auto sway = [&](std::uint32_t axis, double slow, double fast) {
      const std::uint64_t k = 8 * static_cast<std::uint64_t>(frame) + axis;
      return shaken * (3.0 * slow * gradient_noise({time / 0.7f, 7.5f * axis}, seed + axis) +
                       fast * random.normal(k));
    };
    CameraAttitude attitude = mounting_;
    attitude.pitch += now.pitch + kDegree * sway(0, 0.10, 0.03);
    attitude.yaw += kDegree * sway(1, 0.03, 0.01);
    attitude.roll += kDegree * sway(2, 0.08, 0.02);
    attitude.height += sway(3, 0.004, 0.001);
    return view_above_road(road_, place, now.station + ahead, heading, attitude);
  }

  static void move(SynthWorld* world, const Eigen::Vector3d& by) {
    for (SynthTriangle& triangle : world->ground_and_things.triangles) {
      for (Eigen::Vector3d& point : triangle.points) point += by;
    }
    const SE3 shift(Eigen::Quaterniond::Identity(), by);
    for (SynthCar& car : world->cars) {
      for (SE3& pose : car.world_from_vehicle) pose = shift * pose;
      for (RoadModel::LocalPlane& plane : car.ground_plane) {
        plane.plane = plane.plane.transformed(shift);
      }
    }
    for (SynthView& view : world->views) {
      view.world_from_camera = shift * view.world_from_camera;
      view.ego_plane = view.ego_plane.transformed(shift);
    }
  }

  const SynthDriveOptions& options_;
  DriveTruth truth_;
  int standstills_ = 0;
  WorldOptions world_options_;
  RoadLayout layout_;
  std::optional<FollowedRoad> followed_;
  RoadModel road_;
  SideLimits limits_;
  std::vector<DriveState> states_;
  DriveTraffic traffic_;
  CameraAttitude mounting_;
  MarkingSizes markings_;
  GroundTexture texture_;
  SynthLight light_;
  std::vector<SynthView> views_;
};

/// Random points of the road and its pavements from 5 m before the drive to 40 m beyond, as
/// synthesise_scene() writes them.
int write_strip_cloud(const DrivePlan& plan, const SynthDriveOptions& options,
                      const fs::path& path) {
  const RoadModel& road = plan.road();
  const RoadLayout& layout = road.layout();
  const double begin = -5.0, end = plan.state(options.scene.num_frames - 1).station + 40.0;
  const double reach = layout.pavement[0] || layout.pavement[1] ? layout.pavement_width : 0.5;
  const double half = layout.half_width + reach;
  const SE3 camera_from_world = plan.view(0).world_from_camera.inverse();
  const CounterRandom random(options.scene.seed, 0x434C4F55);
  const auto draws = static_cast<std::uint64_t>(options.cloud_density * (end - begin));
  const auto point_of = [&](std::uint64_t i, double* station, double* offset) {
    // Along the road in order, so that a part of the file is a part of the road.
    *station = begin + (static_cast<double>(i) + random.uniform(2 * i)) / options.cloud_density;
    *offset = random.uniform(2 * i + 1, -half, half);
    return road.kind(*station, *offset);
  };
  int count = 0;
  double station = 0.0, offset = 0.0;
  for (std::uint64_t i = 0; i < draws; ++i) {
    count += point_of(i, &station, &offset) != GroundKind::kVerge ? 1 : 0;
  }
  write_file_atomically(path, [&](std::ostream& out) {
    out << "ply\nformat binary_little_endian 1.0\ncomment camber frame camera\n"
        << "comment label 1 road, 2 pavement\nelement vertex " << count
        << "\nproperty float x\nproperty float y\nproperty float z\nproperty uchar label\n"
        << "end_header\n";
    for (std::uint64_t i = 0; i < draws; ++i) {
      const GroundKind kind = point_of(i, &station, &offset);
      if (kind == GroundKind::kVerge) continue;
      const Eigen::Vector3f p = (camera_from_world * road.point(station, offset)).cast<float>();
      char bytes[13];
      std::memcpy(bytes, p.data(), 12);
      bytes[12] = kind == GroundKind::kRoad ? 1 : 2;
      out.write(bytes, sizeof bytes);
    }
  });
  return count;
}

Scene begin_scene(const SynthDriveOptions& options, const DrivePlan& plan) {
  const SynthOptions& given = options.scene;
  Scene scene;
  scene.name = given.name.empty() ? fmt::format("drive_{}", given.seed) : given.name;
  scene.camera = given.camera;
  scene.height_above_road = given.camera_height;
  scene.height_sigma = std::max(options.height_sigma, 1e-3);
  scene.camera_sigma.focal = options.focal_sigma;
  scene.frame_rate = given.frame_rate;
  scene.detections_source = "simulated_network";
  scene.segmentation_classes = {{"road", {static_cast<int>(SegmentationClass::kRoad)}},
                                {"pavement", {static_cast<int>(SegmentationClass::kPavement)}},
                                {"vehicle", {static_cast<int>(SegmentationClass::kVehicle)}}};
  const MarkingSizes& markings = plan.markings();
  if (markings.center_line) {
    scene.markings_m = {{"dash_length", markings.dash_length},
                        {"dash_gap", markings.dash_gap},
                        {"line_width", markings.line_width}};
  }
  return scene;
}

std::string readme(const SynthDriveOptions& options, const SynthDriveSummary& summary,
                   const DrivePlan& plan) {
  std::string text = fmt::format(
      "# {}\n\nA made drive of {:.1f} m: {} frames at {} Hz, {} standstills, {} cars in all, with "
      "complete truth. Nothing in it was photographed.\n\n"
      "The manifest states a camera height of {} +- {} m; the true one is {:.4f} m. The true focal "
      "length is {:.5f} of the stated one.\n\n",
      summary.scene.name, summary.length, options.scene.num_frames, options.scene.frame_rate,
      summary.standstills, summary.scene.cars, options.scene.camera_height, options.height_sigma,
      summary.true_height, summary.true_focal_ratio);
  if (!options.scene.command.empty())
    text += "Made by\n\n```\n" + options.scene.command + "\n```\n\n";
  text +=
      "| path | what |\n|---|---|\n"
      "| `scene.json` | the manifest: camera, frames, simulated detections, truth; ids of true "
      "vehicles are theirs all along |\n"
      "| `image/`, `segmentation/`, `truth/label/` | as in other made scenes |\n"
      "| `truth/road.ply` | random points on the true road (label 1) and pavements (2), first "
      "camera's frame, in the order of the drive |\n"
      "| `run.json` | options, times, what is true |\n\n"
      "| station (m) | grade (deg) | bank (deg) | radius (m; positive: to the left) |\n"
      "|---|---|---|---|\n";
  const RoadProfile& road = plan.road().profile();
  const double end = plan.state(options.scene.num_frames - 1).station;
  for (double s = 0.0; s <= end; s += std::max(10.0, 10.0 * std::round(end / 400.0))) {
    const double curvature = road.curvature(s);
    text += fmt::format(
        "| {:.0f} | {:.1f} | {:.1f} | {} |\n", s, road.grade(s) / kDegree, road.bank(s) / kDegree,
        std::abs(curvature) < 1e-4 ? "straight" : fmt::format("{:.0f}", 1.0 / curvature));
  }
  return text;
}

}  // namespace

void SynthDriveOptions::validate() const {
  SynthOptions one = scene;
  one.num_frames = 1;
  one.validate();
  check(scene.num_frames >= 2 && scene.num_frames <= 100000, "num_frames", scene.num_frames,
        "2 to 100000");
  check(scene.speed > 0.0, "speed", scene.speed, "more than 0 m/s");
  const double length = scene.speed * scene.num_frames / scene.frame_rate;
  check(length <= 50000.0, "length of the drive", length, "at most 50 km");
  check(height_sigma >= 0.0 && height_sigma <= 0.3, "height_sigma", height_sigma, "0 to 0.3 m");
  check(focal_sigma >= 0.0 && focal_sigma <= 0.1, "focal_sigma", focal_sigma, "0 to 0.1");
  check(traffic >= 0.0 && traffic <= 5.0, "traffic", traffic, "0 to 5");
  check(cloud_density >= 0.0 && cloud_density <= 10000.0, "cloud_density", cloud_density,
        "0 to 10000 points a metre");
  if (standstills) {
    check(*standstills >= 0 && *standstills <= 1000, "standstills", *standstills, "0 to 1000");
  }
  if (path) {
    check(path->size() >= static_cast<std::size_t>(scene.num_frames), "poses of the path",
          static_cast<double>(path->size()), "one a frame");
  }
  const SceneFeatures& f = scene.features;
  const bool along = !f.corner.enabled && f.bend.radius == 0.0 && !f.lead_car.enabled;
  if (!along) {
    throw std::invalid_argument(
        "features: found a corner, a bend or a lead car, expected none: a drive draws its own");
  }
  if (scene.lens != LensModel::kNone || scene.layout.layout != SceneLayout::kCamber) {
    throw std::invalid_argument(
        "found a lens or the layout of a data set, expected none: a drive has neither");
  }
}

nlohmann::json options_json(const SynthDriveOptions& options) {
  nlohmann::json out = options_json(options.scene);
  for (const char* key : {"profile", "cars", "nearest_car", "farthest_car", "cloud_points"}) {
    out.erase(key);
  }
  out["drive"] = true;
  out["follows_path"] = options.path.has_value();
  out["standstills"] =
      options.standstills ? nlohmann::json(*options.standstills) : nlohmann::json(nullptr);
  out["height_sigma"] = options.height_sigma;
  out["focal_sigma"] = options.focal_sigma;
  out["traffic"] = options.traffic;
  out["cloud_density"] = options.cloud_density;
  return out;
}

SynthDriveSummary synthesise_drive(const SynthDriveOptions& options, const fs::path& folder,
                                   bool overwrite, const Progress& progress) {
  options.validate();
  const SynthOptions& given = options.scene;
  SynthDriveSummary summary;
  AtomicFolder atomic(folder, overwrite);
  const fs::path& root = atomic.staging();
  for (const char* part : {"image", "segmentation", "truth/label"}) {
    std::error_code error;
    fs::create_directories(root / part, error);
    if (error) throw OutputError((root / part).string(), error.message());
  }
  const auto report = [&](double frame) {
    if (progress) progress("frames", frame / given.num_frames);
  };
  StageTimer plan_timer(summary.scene.timings, "geometry");
  const DrivePlan plan(options);
  plan_timer.stop();
  summary.length = plan.length();
  summary.true_height = plan.truth().height;
  summary.true_focal_ratio = plan.truth().focal_ratio;
  summary.standstills = plan.standstills();
  summary.scene.cars = plan.traffic().count();
  summary.scene.speed = summary.length * given.frame_rate / std::max(1, given.num_frames - 1);
  Scene scene = begin_scene(options, plan);
  summary.scene.name = scene.name;
  SceneTruth truth;
  truth.cloud = root / "truth/road.ply";
  truth.cloud_frame = 0;

  const ViewCamera view(plan.truth().camera);
  const SE3 first_from_world = plan.view(0).world_from_camera.inverse();
  std::uint64_t block = 0;
  for (int first = 0; first < given.num_frames; ++block) {
    const int last = plan.last_of_block(first);
    StageTimer geometry_timer(summary.scene.timings, "geometry");
    const Eigen::Vector3d origin = plan.view(first).world_from_camera.translation();
    const SynthWorld world = plan.block(first, last, origin);
    geometry_timer.stop();
    const FramePlace place{first, first_from_world * SE3(Eigen::Quaterniond::Identity(), origin),
                           100003u * block, false};
    FrameWriter writer(given, view, world, place, root, &summary.scene);
    for (int f = first; f <= last; ++f) {
      report(f);
      SceneFrame frame;
      TruthFrame frame_truth;
      writer.write_truth(f - first, &frame, &frame_truth);
      report(f + 0.3);
      writer.write_image(f - first, &frame);
      scene.frames.push_back(std::move(frame));
      truth.frames.push_back(std::move(frame_truth));
    }
    first = last + 1;
  }

  StageTimer write_timer(summary.scene.timings, "write");
  write_strip_cloud(plan, options, truth.cloud);
  scene.truth = std::move(truth);
  write_scene(scene, root / "scene.json");
  write_file_atomically(root / "README.md", readme(options, summary, plan));
  write_timer.stop();
  nlohmann::json timings = nlohmann::json::object();
  for (const auto& [stage, ms] : summary.scene.timings.stages()) timings[stage] = ms;
  write_json({{"version", kVersion},
              {"seed", given.seed},
              {"options", options_json(options)},
              {"cars", summary.scene.cars},
              {"length", summary.length},
              {"speed", summary.scene.speed},
              {"standstills", summary.standstills},
              {"true_height", summary.true_height},
              {"true_focal_ratio", summary.true_focal_ratio},
              {"timings_ms", timings}},
             root / "run.json");
  atomic.commit();
  report(given.num_frames);
  return summary;
}

}  // namespace camber
