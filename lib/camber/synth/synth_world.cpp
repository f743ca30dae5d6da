#include "camber/synth/synth_world.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/core/random.h"
#include "camber/synth/detail/ego_motion.h"
#include "camber/synth/detail/ground_mesh.h"
#include "camber/synth/detail/noise.h"
#include "camber/synth/detail/ray_caster.h"
#include "camber/synth/detail/scenery.h"
#include "camber/synth/detail/sequence.h"
#include "camber/synth/detail/traffic.h"
#include "camber/synth/detail/world_parts.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegree = kPi / 180.0;

/// Kerbs, pavements and verges that the options fix, over what was drawn.
void apply_roadside(const RoadsideOptions& given, RoadLayout* layout) {
  if (given.half_width) layout->half_width = *given.half_width;
  if (given.kerb_height) layout->kerb_height = *given.kerb_height;
  if (given.pavements) {
    layout->pavement[0] =
        *given.pavements == Pavements::kLeft || *given.pavements == Pavements::kBoth;
    layout->pavement[1] =
        *given.pavements == Pavements::kRight || *given.pavements == Pavements::kBoth;
  }
  for (double& rise : layout->verge_rise) rise = given.verge_rise;
  layout->verge_rise_width = given.verge_rise_width;
}

/// The street that meets the road, its kerbs along the path that will be driven.
Junction draw_junction(const WorldOptions& options, const RoadLayout& layout) {
  const CounterRandom random(options.seed, 0x4A554E43);
  const CornerOptions& corner = options.features.corner;
  const bool left = corner.turn == TurnDirection::kLeft;
  Junction out;
  out.kind = corner.kind;
  out.angle = corner.angle;
  out.station = 20.0;
  out.half_width = random.uniform(0, 3.0, 4.0);
  out.side = left ? 0 : 1;
  out.arm_grade[out.side] = corner.arm_grade;
  out.arm_grade[1 - out.side] = -corner.arm_grade;
  out.level_reach = layout.half_width + random.uniform(1, 1.0, 3.0);
  out.grade_change = random.uniform(2, 8.0, 14.0);
  const double to_axis = 0.5 * (layout.half_width + out.half_width);  // of a street
  const double to_lane = 0.5 * to_axis;
  const double inner = left ? to_axis + to_lane : to_axis - to_lane;
  if (corner.kind == CornerKind::kBend) {
    out.kerb_radius = std::clamp(corner.radius - inner, 2.0, 14.0);
    out.outer_radius = corner.radius + 2.0 * to_axis - inner;
  } else if (left) {
    out.kerb_radius = std::max(random.uniform(3, 4.0, 9.0), corner.radius - 14.0);
  } else {
    out.kerb_radius = std::clamp(corner.radius - inner, 2.0, 14.0);
  }
  return out;
}

}  // namespace

RoadLayout draw_layout(const WorldOptions& options) {
  Sequence random(options.seed, 0x4C41594F);
  RoadLayout layout;
  layout.seed = options.seed * 7919u + 17u;
  layout.half_width = random.uniform(3.3, 3.9);
  layout.crown = random.uniform(0.03, 0.06);
  layout.undulation = random.uniform(0.006, 0.014);
  layout.pavement[0] = random.chance(0.45);
  layout.pavement[1] = random.chance(0.6) || options.profile == RoadProfileKind::kSteepHill;
  layout.pavement_width = random.uniform(2.5, 3.0);
  for (double& slope : layout.verge_slope) slope = random.uniform(-0.1, 0.16);
  const double reach = options.farthest_car;
  for (int side = 0; side < 2; ++side) {
    double s = random.uniform(8.0, 20.0);
    while (s < reach) {
      RoadLayout::Pad pad;
      pad.side = side;
      // Whole multiples of the mesh's rows.
      pad.begin = std::round(s * 4.0) / 4.0;
      pad.end = pad.begin + std::round(random.uniform(7.0, 14.0) * 4.0) / 4.0;
      pad.depth = random.uniform(4.6, 6.0);
      pad.slope_out = std::tan(random.uniform(-6.0, 7.0) * kDegree);
      pad.slope_along = std::tan(random.uniform(-3.0, 3.0) * kDegree);
      s = pad.end + random.uniform(12.0, 40.0);
      if (random.chance(0.45)) layout.pads.push_back(pad);
    }
  }
  const SceneFeatures& features = options.features;
  if (features.corner.enabled) {
    layout.pads.clear();
    layout.pavement[0] = layout.pavement[1] = true;
    layout.verge_slope[1] = layout.verge_slope[0];
  }
  apply_roadside(features.roadside, &layout);
  if (features.corner.enabled) layout.junction = draw_junction(options, layout);
  return layout;
}

namespace {

RoadProfile draw_profile(const WorldOptions& options) {
  const RoadProfile drawn =
      RoadProfile::sample(options.profile, options.seed, kRoadBegin, kRoadEnd);
  const SceneFeatures& features = options.features;
  if (features.corner.enabled) return drawn.with_curvature({});
  if (features.bend.radius == 0.0) return drawn;
  // Round for about 80 degrees ahead of the camera, then straight.
  ProfileTrack curvature;
  const double sign = features.bend.turn == TurnDirection::kLeft ? 1.0 : -1.0;
  curvature.initial = sign / features.bend.radius;
  curvature.changes.push_back({std::min(1.2 * features.bend.radius, 150.0), 20.0, 0.0});
  return drawn.with_curvature(std::move(curvature));
}

}  // namespace

MarkingSizes draw_markings(const WorldOptions& options, const CounterRandom& random) {
  MarkingSizes out;
  out.dash_length = random.uniform(0) < 0.5 ? 3.0 : 4.0;
  out.dash_gap = out.dash_length == 3.0 ? 6.0 : 8.0;
  out.line_width = random.uniform(1) < 0.6 ? 0.12 : 0.15;
  out.edge_lines = random.uniform(2) < 0.8 || options.profile == RoadProfileKind::kSteepHill;
  if (const auto& given = options.features.markings) {
    out.center_line = *given != Markings::kNone;
    out.edge_lines = *given == Markings::kAll;
  }
  return out;
}

SynthLight draw_light(const WorldOptions& options) {
  const CounterRandom random(options.seed, 0x4C494748);
  const WeatherOptions& given = options.features.weather;
  SynthLight light;
  light.haze_distance = static_cast<float>(given.haze_distance);
  light.lamps = given.lights_on;
  const double azimuth = random.uniform(0, 0.0, 2 * kPi),
               elevation = given.sun_elevation.value_or(random.uniform(1, 35.0, 60.0) * kDegree);
  light.to_sun = {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                  std::sin(elevation)};
  light.cloudiness = static_cast<float>(given.cloudiness.value_or(random.uniform(2)));
  // An overcast sky gives more of the light itself.
  light.sun = 1.0f - 0.85f * light.cloudiness;
  light.sky = 0.45f + 0.35f * light.cloudiness;
  return light;
}

GroundTexture draw_texture(const WorldOptions& options, const CounterRandom& random) {
  const auto seed = static_cast<std::uint32_t>(random.bits(3));
  return {seed, static_cast<float>(options.features.asphalt.contrast.value_or(
                    0.6f + 0.5f * hash_unit(0, 0, seed)))};
}

SynthWorld make_synth_world(const WorldOptions& options) {
  options.features.validate();
  SynthWorld world{
      RoadModel(draw_profile(options), draw_layout(options)), {}, {}, {}, {}, {}, {}, {}, {}, {}};
  const CounterRandom random(options.seed, kMarkingStream);
  world.markings = draw_markings(options, random);
  world.asphalt = {options.features.asphalt.texture,
                   static_cast<float>(options.features.asphalt.wetness)};
  const GroundTexture texture = draw_texture(options, random);
  build_ground(world.road, texture.seed, texture.contrast, &world.ground_and_things);
  world.num_ground = world.ground_and_things.triangles.size();
  if (options.scenery) build_scenery(world.road, options.seed, &world.ground_and_things);
  const EgoMotion motion = plan_ego_motion(options, world.road);
  world.speed = motion.speed;
  world.views = drive_camera(options, world.road, motion);
  world.light = draw_light(options);
  world.cars = place_cars(options, world.road, motion);
  world.rays = std::make_shared<RayCaster>(world.ground_and_things, world.num_ground, world.cars,
                                           options.num_frames);
  return world;
}

void cast_rays(const SynthWorld& world, int frame, const Eigen::Vector3d* origins, bool own_origins,
               const Eigen::Vector3d* directions, std::size_t count, WorldHit* hits) {
  constexpr std::size_t kBatch = 256;
  RayCaster::Hit found[kBatch];
  for (std::size_t first = 0; first < count; first += kBatch) {
    const std::size_t n = std::min(kBatch, count - first);
    world.rays->nearest(frame, origins + (own_origins ? first : 0), own_origins, directions + first,
                        n, found);
    for (std::size_t i = 0; i < n; ++i) {
      WorldHit& hit = hits[first + i];
      hit = {};
      if (found[i].triangle < 0) continue;
      hit = {found[i].distance, found[i].car, found[i].triangle};
      // The triangle's plane in double precision; where the ray grazes it, the single one is safer.
      Eigen::Vector3d o = origins[own_origins ? first + i : 0], d = directions[first + i];
      const SynthMesh* mesh = &world.ground_and_things;
      if (hit.car >= 0) {
        const SE3& pose = world.cars[hit.car].world_from_vehicle[frame];
        const Eigen::Quaterniond back = pose.rotation().conjugate();
        o = back * (o - pose.translation());
        d = back * d;
        mesh = &world.cars[hit.car].mesh;
      }
      const TrianglePoints& p = mesh->triangles[hit.triangle].points;
      const Eigen::Vector3d normal = (p[1] - p[0]).cross(p[2] - p[0]);
      const double distance = normal.dot(p[0] - o) / normal.dot(d);
      if (std::abs(distance - hit.distance) < 1e-3 * hit.distance) hit.distance = distance;
    }
  }
}

WorldHit cast_ray(const SynthWorld& world, int frame, const Eigen::Vector3d& origin,
                  const Eigen::Vector3d& direction) {
  WorldHit hit;
  cast_rays(world, frame, &origin, false, &direction, 1, &hit);
  return hit;
}

}  // namespace camber
