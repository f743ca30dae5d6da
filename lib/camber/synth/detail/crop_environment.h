#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>

#include "camber/synth/detail/sequence.h"
#include "camber/synth/detail/surface.h"

namespace camber {

/// What surrounds a crop's scene at a distance, and its light: sky, a skyline of houses and trees,
/// ground. Seen behind the scene and, blurred, in paint and glass.
struct CropEnvironment {
  explicit CropEnvironment(Sequence* random);

  /// Light from a direction (unit, world). @param blur  rad, of the view
  Color light(const Eigen::Vector3f& direction, float blur) const;

  /// Light from a distance (m) through the air.
  Color through_air(const Color& light, float distance) const {
    if (!(haze > 0.0f)) return light;
    return mix(horizon_ * 0.9f, light, std::exp(-haze * distance));
  }
  /// Share of the sun's light that passes the leaves of trees out of view.
  /// @param x, y  m, of the place square to the sun's direction
  float below_foliage(float x, float y) const;

  Eigen::Vector3f up{0, 0, 1};      ///< against gravity: the ground of the scene may be inclined
  Eigen::Vector3f to_sun{0, 0, 1};  ///< unit
  float sun = 0.7f;                 ///< irradiance on a surface that faces it
  Color sun_color, sky_color;       ///< tints
  float sky = 0.5f;                 ///< irradiance of the whole sky on a level surface
  float sun_radius = 0.01f;         ///< rad; larger behind clouds
  float haze = 0.0f;                ///< share of the light that air replaces, 1/m
  float foliage = 0.0f;             ///< size of the gaps between leaves, m; 0: open sky
  Color ground;                     ///< light that comes back from it, far away

 private:
  struct Cell {
    float height = 0.0f;  ///< rad
    Color color = Color::Zero();
    bool trees = false;
    float windows = 0.0f;  ///< size, rad; 0: none
  };
  static constexpr int kCells = 48;
  std::array<Cell, kCells> cells_;
  Color zenith_, horizon_, cloud_;
  float cloudiness_ = 0.0f, foliage_cover_ = 0.5f;
  std::uint32_t seed_ = 0;
};

/// A surface's pattern, a function of place.
struct CropTexture {
  enum class Kind {
    kPlain,
    kAsphalt,
    kGrass,
    kBricks,
    kFacade,
    kTiles,
    kStripes,
    kPatches,
    kLeaves
  };
  Kind kind = Kind::kPlain;
  Color a = Color::Zero(), b = Color::Zero(), c = Color::Zero();
  float scale = 1.0f;  ///< m
  float contrast = 0.3f;
  std::uint32_t seed = 0;
  float mirror = 0.0f;

  /// Reflectance at a place of the surface, averaged over a square of `width` m.
  Color at(Texel p, float width) const;
};

CropTexture draw_ground_texture(Sequence* random);
CropTexture draw_wall_texture(Sequence* random);
CropTexture draw_leaf_texture(Sequence* random);

}  // namespace camber
