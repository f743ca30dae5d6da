#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace camber {

using TrianglePoints = std::array<Eigen::Vector3d, 3>;

/// What a surface looks like; see detail/surface.h.
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
  std::array<float, 4> extent{};  ///< meaning by kind, see the textures in detail/
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
};

}  // namespace camber
