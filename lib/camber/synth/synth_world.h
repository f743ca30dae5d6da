#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"
#include "camber/synth/car_family.h"
#include "camber/synth/road_model.h"
#include "camber/synth/scene_features.h"
#include "camber/synth/synth_mesh.h"

namespace camber {

class RayCaster;

/// Sizes of the road markings, m, along the surface.
struct MarkingSizes {
  double dash_length = 3.0;
  double dash_gap = 6.0;
  double line_width = 0.12;
  double edge_inset = 0.25;  ///< edge line's middle to the road's edge
  bool edge_lines = true;
  bool center_line = true;
};

/// A car of a scene.
struct SynthCar {
  int track = 0;  ///< its number, from 1
  CarModel model;
  bool moving = false;
  GroundKind ground = GroundKind::kRoad;
  SynthMesh mesh;                                   ///< vehicle frame
  std::vector<SE3> world_from_vehicle;              ///< one a frame
  std::vector<RoadModel::LocalPlane> ground_plane;  ///< world, one a frame
};

/// The camera at one frame.
struct SynthView {
  SE3 world_from_camera;
  Plane ego_plane;  ///< world: the surface's plane under the camera
};

struct SynthLight {
  Eigen::Vector3d to_sun{0.3, 0.4, 0.8};  ///< unit
  float sun = 0.7f;                       ///< irradiance on a surface that faces it
  float sky = 0.5f;                       ///< irradiance of the whole sky on a level surface
  float cloudiness = 0.4f;                ///< 0 clear, 1 overcast
  float haze_distance = 1500.0f;          ///< m, at which 63 % is haze
  bool lamps = false;                     ///< lights of the cars that drive are on
};

/// What the carriageway is covered with.
struct AsphaltLook {
  AsphaltTexture texture = AsphaltTexture::kVaried;
  float wetness = 0.0f;  ///< 0 to 1
};

struct WorldOptions {
  std::uint64_t seed = 0;
  RoadProfileKind profile = RoadProfileKind::kSteepHill;
  int num_frames = 3;
  double frame_rate = 10.0;     ///< Hz
  double speed = 9.0;           ///< m/s; at a corner its radius and yaw rate give the speed
  double camera_height = 1.65;  ///< m
  int num_cars = 5;
  double nearest_car = 8.0;    ///< m of station ahead of the camera, reference frame
  double farthest_car = 45.0;  ///< m
  bool scenery = true;         ///< houses, plants and posts; all else is the same without them
  SceneFeatures features;
};

/// A whole scene: geometry and truth, nothing rendered. World: z up, see RoadProfile.
struct SynthWorld {
  RoadModel road;
  MarkingSizes markings;
  AsphaltLook asphalt;
  SynthMesh ground_and_things;  ///< all that stands still but the cars; the ground first
  std::size_t num_ground = 0;   ///< triangles of the ground
  std::vector<SynthCar> cars;
  std::vector<SynthView> views;  ///< one a frame
  double speed = 0.0;            ///< m/s of the camera's car
  SynthLight light;
  std::shared_ptr<const RayCaster> rays;  ///< over the meshes and the cars' poses
};

/// Makes a scene. Same options, same scene.
SynthWorld make_synth_world(const WorldOptions& options);

/// Where a viewing ray first meets something.
struct WorldHit {
  double distance = std::numeric_limits<double>::infinity();  ///< in lengths of the direction
  int car = -1;       ///< index into cars, -1: ground or thing
  int triangle = -1;  ///< of that mesh, -1: sky
};
WorldHit cast_ray(const SynthWorld& world, int frame, const Eigen::Vector3d& origin,
                  const Eigen::Vector3d& direction);
/// The same for `count` rays, faster where neighbours have similar directions.
/// @param origins  one for all, or one a ray if `own_origins`
void cast_rays(const SynthWorld& world, int frame, const Eigen::Vector3d* origins, bool own_origins,
               const Eigen::Vector3d* directions, std::size_t count, WorldHit* hits);

}  // namespace camber
