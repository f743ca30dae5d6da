#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"
#include "camber/synth/car_family.h"
#include "camber/synth/road_model.h"
#include "camber/synth/triangle_bvh.h"

namespace camber {

/// What a surface looks like; see shade.h.
enum class SurfaceKind : std::uint8_t {
  kAsphalt,
  kKerb,
  kPavement,
  kPad,
  kGrass,
  kFacade,
  kRoof,
  kPlain,
  kBark,
  kLeaf,
  kSign,
  kCarPaint,
  kCarGlass,
  kCarTyre,
  kCarLight,
  kCarPlate,
  kCarTrim,
  kCarRim,
};

/// Label values of the true label images (Cityscapes ids).
enum class TruthLabel : std::uint8_t {
  kRoad = 7,
  kPavement = 8,
  kBuilding = 11,
  kPole = 17,
  kSign = 20,
  kVegetation = 21,
  kTerrain = 22,
  kSky = 23,
  kCar = 26,
};

/// A thing in the scene: what its triangles have in common.
struct SynthObject {
  SurfaceKind kind = SurfaceKind::kPlain;
  TruthLabel label = TruthLabel::kTerrain;
  Eigen::Vector3f color = Eigen::Vector3f::Constant(0.5f);  ///< linear reflectance
  std::uint32_t seed = 0;
  std::array<float, 4> extent{};  ///< meaning by kind, see shade.cpp
};

/// One triangle with what shading needs.
struct SynthTriangle {
  TrianglePoints points;                   ///< m
  std::array<Eigen::Vector3f, 3> normals;  ///< unit, for lighting
  std::array<Eigen::Vector2f, 3> texture;  ///< texture coordinates, m
  int object = 0;                          ///< index into its mesh's objects
};

/// Triangles and the objects they belong to.
struct SynthMesh {
  std::vector<SynthObject> objects;
  std::vector<SynthTriangle> triangles;
  TriangleBvh bvh() const;
};

/// Sizes of the road markings, m, along the surface.
struct MarkingSizes {
  double dash_length = 3.0;
  double dash_gap = 6.0;
  double line_width = 0.12;
  double edge_inset = 0.25;  ///< edge line's middle to the road's edge
  bool edge_lines = true;
};

/// A car of a scene.
struct SynthCar {
  int track = 0;  ///< its number, from 1
  CarModel model;
  bool moving = false;
  GroundKind ground = GroundKind::kRoad;
  SynthMesh mesh;                                   ///< vehicle frame
  TriangleBvh bvh;                                  ///< of mesh
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
};

struct WorldOptions {
  std::uint64_t seed = 0;
  RoadProfileKind profile = RoadProfileKind::kSteepHill;
  int num_frames = 3;
  double frame_rate = 10.0;     ///< Hz
  double speed = 9.0;           ///< m/s
  double camera_height = 1.65;  ///< m
  int num_cars = 5;
  double nearest_car = 8.0;    ///< m of station ahead of the camera, reference frame
  double farthest_car = 45.0;  ///< m
  bool scenery = true;         ///< houses, plants and posts; all else is the same without them
};

/// A whole scene: geometry and truth, nothing rendered. World: z up, see RoadProfile.
struct SynthWorld {
  RoadModel road;
  MarkingSizes markings;
  SynthMesh ground_and_things;  ///< all that stands still but the cars
  TriangleBvh bvh;              ///< of ground_and_things
  TriangleBvh shadow_bvh;       ///< of its parts that rise above the ground
  std::vector<SynthCar> cars;
  std::vector<SynthView> views;  ///< one a frame
  SynthLight light;
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

}  // namespace camber
