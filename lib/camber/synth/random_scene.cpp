#include "camber/synth/random_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "camber/synth/detail/sequence.h"

namespace camber {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

double log_uniform(Sequence* random, double low, double high) {
  return std::exp(random->uniform(std::log(low), std::log(high)));
}

/// Chooses by shares that add up to 1.
template <typename Kind, std::size_t kCount>
Kind choose(Sequence* random, const std::pair<Kind, double> (&shares)[kCount]) {
  double left = random->uniform(0.0, 1.0);
  for (const auto& [kind, share] : shares) {
    if (left < share) return kind;
    left -= share;
  }
  return shares[kCount - 1].first;
}

TurnDirection draw_turn(Sequence* random) {
  return random->chance(0.5) ? TurnDirection::kLeft : TurnDirection::kRight;
}

void draw_drive(Sequence* random, SceneFeatures* features) {
  enum class Drive { kCorner, kBend, kAlong };
  const Drive drive =
      choose<Drive>(random, {{Drive::kCorner, 0.20}, {Drive::kBend, 0.25}, {Drive::kAlong, 0.55}});
  if (drive == Drive::kBend) {
    features->bend.radius = log_uniform(random, 40.0, 150.0);
    features->bend.turn = draw_turn(random);
  }
  if (drive != Drive::kCorner) return;
  CornerOptions& corner = features->corner;
  corner.enabled = true;
  corner.kind = choose<CornerKind>(random, {{CornerKind::kStem, 0.40},
                                            {CornerKind::kCrossing, 0.25},
                                            {CornerKind::kSideStreet, 0.20},
                                            {CornerKind::kBend, 0.15}});
  corner.turn = draw_turn(random);
  corner.radius = random->uniform(6.0, 15.0);
  // No more than 4.5 m/s^2 across, which is hard driving.
  const double fastest = std::min(40.0 * kDegree, std::sqrt(4.5 / corner.radius));
  corner.yaw_rate = random->uniform(20.0 * kDegree, fastest);
  corner.phase = random->uniform(0.15, 0.85);
  corner.angle = random->uniform(75.0, 105.0) * kDegree;
  corner.arm_grade = random->uniform(-0.10, 0.10);
}

RoadProfileKind draw_profile(Sequence* random, const SceneFeatures& features) {
  if (random->chance(0.20)) return RoadProfileKind::kLevel;
  static const RoadProfileKind kSteep[] = {RoadProfileKind::kUphill,  RoadProfileKind::kDownhill,
                                           RoadProfileKind::kCrest,   RoadProfileKind::kSag,
                                           RoadProfileKind::kRolling, RoadProfileKind::kControl,
                                           RoadProfileKind::kBank,    RoadProfileKind::kSteepHill};
  // The banked kind has a plan of its own, the steep hill's is half of it.
  const bool own_plan = features.corner.enabled || features.bend.radius > 0.0;
  return kSteep[random->below(own_plan ? 6 : 8)];
}

void draw_roadside(Sequence* random, SceneFeatures* features) {
  RoadsideOptions& side = features->roadside;
  const bool corner = features->corner.enabled;
  if (random->chance(corner ? 0.80 : 0.50)) {
    side.pavements = choose<Pavements>(
        random, {{Pavements::kBoth, 0.6}, {Pavements::kRight, 0.24}, {Pavements::kLeft, 0.16}});
    if (corner) side.pavements = Pavements::kBoth;
  } else {
    side.pavements = Pavements::kNone;
  }
  side.kerb_height = random->uniform(0.04, 0.20);
  side.verge_rise =
      random->chance(0.5) ? random->uniform(0.05, 0.19) : random->uniform(-0.03, 0.03);
  side.verge_rise_width = random->uniform(0.12, 0.5);
  const double width = random->uniform(0.0, 1.0);
  if (!corner && width < 0.12) side.half_width = random->uniform(2.2, 2.8);
  if (width >= 0.12 && width < 0.22) side.half_width = random->uniform(3.9, 5.5);
  const bool narrow = side.half_width && *side.half_width < 2.8;
  const double edge = random->uniform(0.9, narrow ? 1.6 : 2.0);
  if (random->chance(0.6)) side.edge_distance = edge;
  features->markings = choose<Markings>(
      random, {{Markings::kNone, 0.35}, {Markings::kCenterLine, 0.20}, {Markings::kAll, 0.45}});
  if (narrow) features->markings = Markings::kNone;
}

void draw_camera(Sequence* random, SynthOptions* options) {
  static const int kWidths[] = {640, 800, 960, 1024, 1242, 1280};
  constexpr double kFarthestStart = 10.0;  // m to the road in the lowest row
  PinholeCamera& camera = options->camera;
  MountingOptions& mounting = options->features.mounting;
  for (int attempt = 0; attempt < 50; ++attempt) {
    const double view = random->uniform(40.0, 110.0) * kDegree;
    camera.width = kWidths[random->below(6)];
    camera.height = 2 * static_cast<int>(0.5 * camera.width * random->uniform(0.30, 0.62));
    camera.fx = camera.fy = 0.5 * camera.width / std::tan(0.5 * view);
    camera.cx = 0.5 * camera.width - 0.5 + random->uniform(-8.0, 8.0);
    camera.cy = 0.5 * camera.height - 0.5 + random->uniform(-8.0, 8.0);
    // In millimetres, as one would measure it.
    options->camera_height = 1e-3 * std::round(1e3 * random->uniform(0.9, 3.0));
    mounting.pitch = random->uniform(-6.0, 2.0) * kDegree;
    const double down = std::atan((camera.height - 1 - camera.cy) / camera.fy) - *mounting.pitch;
    if (options->camera_height < kFarthestStart * std::tan(down)) break;
  }
  mounting.yaw = random->uniform(-2.0, 2.0) * kDegree;
  mounting.roll = random->uniform(-4.0, 4.0) * kDegree;
  mounting.ahead_of_axle = random->uniform(0.8, 2.2);
  const double heights_a_frame = log_uniform(random, 0.1, 1.2);
  const double bend = options->features.bend.radius;
  const double fastest = bend > 0.0 ? std::min(22.0, std::sqrt(4.0 * bend)) : 22.0;
  options->speed =
      std::clamp(heights_a_frame * options->camera_height * options->frame_rate, 0.8, fastest);
}

void draw_surface(Sequence* random, SceneFeatures* features) {
  AsphaltOptions& asphalt = features->asphalt;
  asphalt.texture = choose<AsphaltTexture>(random, {{AsphaltTexture::kVaried, 0.80},
                                                    {AsphaltTexture::kSelfSimilar, 0.12},
                                                    {AsphaltTexture::kRepeating, 0.08}});
  const double strength = random->uniform(0.0, 1.0);
  asphalt.contrast = asphalt.texture == AsphaltTexture::kVaried
                         ? 0.3 * std::pow(1.15 / 0.3, strength)
                         : 0.5 + 0.8 * strength;
  const bool wet = random->chance(0.20);
  const double wetness = random->uniform(0.3, 1.0);
  WeatherOptions& weather = features->weather;
  weather.cloudiness = random->uniform(wet ? 0.5 : 0.0, 1.0);
  weather.sun_elevation = random->uniform(25.0, 62.0) * kDegree;
  weather.haze_distance = log_uniform(random, 300.0, 3000.0);
  const bool lights = random->chance(0.7);
  if (!wet) return;
  asphalt.wetness = wetness;
  weather.lights_on = lights;
}

void draw_sensor(Sequence* random, CameraSensor* sensor) {
  sensor->supersampling = 2;
  sensor->noise = log_uniform(random, 0.6, 3.0);
  sensor->blur = random->uniform(0.4, 0.9);
  sensor->exposure_change =
      random->chance(0.3) ? random->uniform(0.06, 0.20) : random->uniform(0.01, 0.06);
  sensor->vignetting = random->uniform(0.0, 0.35);
}

}  // namespace

SynthOptions random_scene_options(std::uint64_t number, std::uint64_t seed) {
  Sequence random(seed + 0x52414E44u, number);
  SynthOptions options;
  options.name = fmt::format("random_{:05d}", number);
  options.seed = random.bits();
  SceneFeatures& features = options.features;
  draw_drive(&random, &features);
  options.profile = draw_profile(&random, features);
  draw_roadside(&random, &features);
  draw_camera(&random, &options);
  draw_surface(&random, &features);
  draw_sensor(&random, &options.sensor);
  features.lead_car.enabled = random.chance(0.25);
  features.lead_car.gap = random.uniform(5.0, 18.0);
  options.num_cars = random.below(8);
  options.nearest_car = random.uniform(7.0, 10.0);
  return options;
}

}  // namespace camber
