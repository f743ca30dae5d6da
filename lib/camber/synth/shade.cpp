#include "camber/synth/shade.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/synth/noise.h"

namespace camber {
namespace {

using Color = Eigen::Vector3f;
constexpr float kPi = 3.14159265f;

Color mix(const Color& a, const Color& b, float share) { return a + share * (b - a); }

float clamp01(float x) { return std::clamp(x, 0.0f, 1.0f); }

/// x modulo period in [0, period).
float wrap(float x, float period) { return x - period * std::floor(x / period); }

/// Share of a pixel in the rectangle of half sizes (a, b) around the origin.
float rectangle_cover(float u, float v, float a, float b, float pixel) {
  return strip_cover(u, a, pixel) * strip_cover(v, b, pixel);
}

// ---------------------------------------------------------------- ground textures
// u: m along the road's centreline (in space); v: lateral offset, m.

Color asphalt(const MarkingSizes& marks, float half_width, float roughness, Texel p, float w,
              std::uint32_t seed) {
  // Grain of the aggregate, then blotches; the long ones are stretched along the road.
  float tone = 0.30f * octave(p, 0.011f, w, seed + 1) + 0.28f * octave(p, 0.023f, w, seed + 2) +
               0.26f * octave(p, 0.047f, w, seed + 3) + 0.26f * octave(p, 0.095f, w, seed + 4) +
               0.22f * octave(p, 0.19f, w, seed + 5);
  const Texel longer{0.45f * p.u, p.v};
  tone += 0.17f * octave(longer, 0.41f, w, seed + 6) + 0.13f * octave(longer, 0.9f, w, seed + 7) +
          0.11f * octave(longer, 2.3f, w, seed + 8) + 0.11f * octave(p, 7.0f, w, seed + 9);
  // Single light stones, and spots of oil and rubber.
  tone += 0.55f * smooth_step(0.30f, 0.55f, octave(p, 0.060f, w, seed + 11)) -
          0.45f * smooth_step(0.32f, 0.55f, octave(p, 0.13f, w, seed + 12)) -
          0.28f * smooth_step(0.34f, 0.50f, octave(p, 0.55f, w, seed + 13));

  tone *= roughness;

  // Wheel tracks are polished and a little lighter, the middle of the lane has oil on it.
  const float lane = 0.5f * half_width;
  const float in_lane = std::fabs(std::fabs(p.v) - lane);
  const float track = (in_lane - 0.75f) / 0.28f, middle = in_lane / 0.25f;
  tone += 0.05f * std::exp(-track * track) -
          0.07f * std::exp(-middle * middle) * (1.0f + octave(longer, 1.7f, w, seed + 10));

  // Repairs: rectangles of another asphalt with a seam of bitumen.
  float seam = 0.0f;
  for (int row = -1; row <= 1; ++row) {
    const auto cell_u = static_cast<std::int32_t>(std::floor(p.u / 8.0f)) + row;
    for (int side = 0; side < 2; ++side) {
      if (hash_unit(cell_u, side, seed + 20) > 0.34f) continue;
      const float long_half = 0.5f + 2.6f * hash_unit(cell_u, side, seed + 21);
      const float wide_half = 0.3f + 0.9f * hash_unit(cell_u, side, seed + 22);
      const float cu = (static_cast<float>(cell_u) + hash_unit(cell_u, side, seed + 23)) * 8.0f;
      const float room = std::max(0.0f, lane - wide_half - 0.15f);
      const float cv =
          (side == 0 ? lane : -lane) + room * (2.0f * hash_unit(cell_u, side, seed + 24) - 1.0f);
      const float inner = rectangle_cover(p.u - cu, p.v - cv, long_half, wide_half, w);
      const float outer =
          rectangle_cover(p.u - cu, p.v - cv, long_half + 0.03f, wide_half + 0.03f, w);
      tone += inner * (0.34f * hash_unit(cell_u, side, seed + 25) - 0.24f);
      seam = std::max(seam, 0.7f * (outer - inner));
    }
  }

  // Cracks: the zero lines of a warped noise, where a coarser noise allows them; and the joint
  // between the two lanes' pavings.
  const float where = gradient_noise((1.0f / 6.0f) * p, seed + 30);
  if (where > 0.0f) {
    const Texel warp{
        0.10f * octave(p, 0.5f, w, seed + 31) + 0.03f * octave(p, 0.13f, w, seed + 32),
        0.10f * octave(p, 0.5f, w, seed + 33) + 0.03f * octave(p, 0.13f, w, seed + 34)};
    const Texel q = p + warp;
    const float level = gradient_noise((1.0f / 2.6f) * q, seed + 35);
    const float away = level * 2.6f * 0.55f;  // about the distance to the zero line, m
    seam = std::max(seam, 0.75f * smooth_step(0.0f, 0.2f, where) * strip_cover(away, 0.008f, w));
  }
  const float wobble = 0.02f * octave(p, 0.7f, w, seed + 36);
  seam = std::max(seam, 0.5f * strip_cover(p.v - 0.09f + wobble, 0.008f, w));
  const float gutter = smooth_step(half_width - 0.35f, half_width, std::fabs(p.v));
  tone -= 0.12f * gutter * (1.0f + 1.5f * octave(longer, 0.6f, w, seed + 37));

  // Manhole covers, one in some stretches of 22 m.
  float iron = 0.0f, iron_ring = 0.0f;
  {
    const auto cell = static_cast<std::int32_t>(std::floor(p.u / 22.0f));
    if (hash_unit(cell, 0, seed + 40) < 0.55f) {
      const float cu =
          (static_cast<float>(cell) + 0.2f + 0.6f * hash_unit(cell, 1, seed + 40)) * 22.0f;
      const float cv = (hash_unit(cell, 2, seed + 40) < 0.5f ? lane : -lane) +
                       0.8f * (hash_unit(cell, 3, seed + 40) - 0.5f);
      const float r = std::hypot(p.u - cu, p.v - cv);
      iron = below_edge(r - 0.31f, w);
      iron_ring = below_edge(r - 0.37f, w) - iron;
      const float bars = 0.5f + 0.5f * std::sin(2.0f * kPi * (p.u - cu) / 0.08f);
      iron *= 0.85f + 0.3f * bars * octave_weight(0.08f, w);
    }
  }

  Color color = Color(0.118f, 0.116f, 0.113f) * std::exp(tone);
  color = mix(color, Color(0.035f, 0.034f, 0.034f), clamp01(seam));
  color = mix(color, Color(0.075f, 0.07f, 0.066f), clamp01(iron));
  color = mix(color, Color(0.17f, 0.168f, 0.165f), 0.7f * clamp01(iron_ring));

  // Markings, worn.
  const float period = static_cast<float>(marks.dash_length + marks.dash_gap);
  const auto dash = static_cast<float>(marks.dash_length);
  const auto half_line = static_cast<float>(0.5 * marks.line_width);
  const float phase = wrap(p.u + 0.5f * (period - dash), period) - 0.5f * period;
  float paint = strip_cover(phase, 0.5f * dash, w) * strip_cover(p.v, half_line, w);
  if (marks.edge_lines) {
    const float middle_of_edge = half_width - static_cast<float>(marks.edge_inset);
    paint = std::max(paint, strip_cover(std::fabs(p.v) - middle_of_edge, half_line, w));
  }
  if (paint > 0.0f) {
    const float wear = 0.5f * octave(p, 0.05f, w, seed + 50) +
                       0.45f * octave(p, 0.017f, w, seed + 51) +
                       0.35f * octave(p, 0.6f, w, seed + 52);
    const float left = 0.82f - 0.55f * smooth_step(0.05f, 0.4f, wear);
    const Color white = Color(0.56f, 0.56f, 0.54f) * (1.0f + 0.12f * octave(p, 0.3f, w, seed + 53));
    color = mix(color, white, paint * left);
  }
  return color;
}

Color concrete_tone(const Color& base, Texel p, float w, std::uint32_t seed) {
  const float tone =
      0.18f * octave(p, 0.013f, w, seed + 60) + 0.15f * octave(p, 0.03f, w, seed + 61) +
      0.14f * octave(p, 0.08f, w, seed + 62) + 0.12f * octave(p, 0.25f, w, seed + 63) +
      0.12f * octave(p, 0.8f, w, seed + 64) + 0.12f * octave(p, 3.0f, w, seed + 65);
  return base * std::exp(tone);
}

Color kerb(Texel p, float w, std::uint32_t seed) {
  const auto stone = static_cast<std::int32_t>(std::floor(p.u));
  Color color = concrete_tone(
      Color(0.235f, 0.232f, 0.222f) * (0.9f + 0.2f * hash_unit(stone, 7, seed)), p, w, seed);
  const float joint = strip_cover(wrap(p.u + 0.5f, 1.0f) - 0.5f, 0.008f, w);
  return mix(color, Color(0.06f, 0.058f, 0.055f), joint);
}

/// Slabs of a size in running bond, with joints.
Color slabs(Texel p, float w, float length, float width, float joint, const Color& base,
            float spread, std::uint32_t seed) {
  const float row = std::floor(p.v / width);
  const auto iv = static_cast<std::int32_t>(row);
  const float shifted = p.u + 0.5f * length * static_cast<float>(iv & 1);
  const auto iu = static_cast<std::int32_t>(std::floor(shifted / length));
  const float tone =
      spread * (hash_unit(iu, iv, seed + 70) - 0.5f) * octave_weight(2.0f * width, w);
  Color color = concrete_tone(base * (1.0f + tone), p, w, seed);
  const float du = wrap(shifted + 0.5f * length, length) - 0.5f * length;
  const float dv = wrap(p.v + 0.5f * width, width) - 0.5f * width;
  const float line = std::max(strip_cover(du, 0.5f * joint, w), strip_cover(dv, 0.5f * joint, w));
  return mix(color, 0.3f * base, 0.8f * clamp01(line));
}

Color grass(Texel p, float w, std::uint32_t seed) {
  const float patches =
      0.7f * octave(p, 4.0f, w, seed + 80) + 0.5f * octave(p, 1.3f, w, seed + 81) +
      0.4f * octave(p, 0.45f, w, seed + 82) + 0.5f * octave(p, 11.0f, w, seed + 83);
  const float blades =
      0.5f * octave(p, 0.17f, w, seed + 84) + 0.55f * octave(p, 0.07f, w, seed + 85) +
      0.6f * octave(p, 0.03f, w, seed + 86) + 0.5f * octave(p, 0.013f, w, seed + 87);
  const Color green(0.060f, 0.098f, 0.022f), dry(0.155f, 0.135f, 0.062f),
      soil(0.105f, 0.080f, 0.055f);
  Color color = mix(green, dry, clamp01(0.35f + 0.7f * patches));
  color = mix(color, soil, smooth_step(0.35f, 0.8f, patches - 0.3f * blades) * 0.8f);
  return color * std::exp(0.55f * blades);
}

// ---------------------------------------------------------------- walls and things

struct Surface {
  Color albedo = Color::Constant(0.2f);
  float mirror = 0.0f;  ///< share of a mirror's reflection at normal incidence; 0: dull
};

/// u along the wall from its left end, v above the ground floor, m.
Surface facade(const SynthObject& object, Texel p, float w) {
  const std::uint32_t seed = object.seed;
  Surface out;
  const bool brick = hash_unit(0, 1, seed) < 0.3f;
  const float dirt = 0.10f * octave(p, 2.6f, w, seed + 90) + 0.08f * octave(p, 0.7f, w, seed + 91) +
                     0.10f * octave(p, 0.21f, w, seed + 92) +
                     0.10f * octave(p, 0.06f, w, seed + 93);
  Color wall = object.color * std::exp(dirt);
  if (brick) {
    const float row = 0.075f, length = 0.25f;
    const auto iv = static_cast<std::int32_t>(std::floor(p.v / row));
    const float su = p.u + 0.5f * length * static_cast<float>(iv & 1);
    const auto iu = static_cast<std::int32_t>(std::floor(su / length));
    wall *= 1.0f + 0.3f * (hash_unit(iu, iv, seed + 94) - 0.5f) * octave_weight(2 * row, w);
    const float mortar =
        std::max(strip_cover(wrap(su + 0.5f * length, length) - 0.5f * length, 0.006f, w),
                 strip_cover(wrap(p.v + 0.5f * row, row) - 0.5f * row, 0.006f, w));
    wall = mix(wall, Color(0.32f, 0.31f, 0.29f), 0.6f * mortar);
  }
  // Plinth and cornice.
  const float below = below_edge(p.v - 0.55f, w);
  const Color stone(0.17f, 0.165f, 0.155f);
  const float course = 0.32f, block = 0.55f;
  const auto sv = static_cast<std::int32_t>(std::floor(p.v / course));
  const float sw = p.u + 0.5f * block * static_cast<float>(sv & 1);
  const auto su2 = static_cast<std::int32_t>(std::floor(sw / block));
  const float tone = 0.35f * (hash_unit(su2, sv, seed + 96) - 0.5f) * octave_weight(2 * course, w);
  const float joints =
      std::max(strip_cover(wrap(sw + 0.5f * block, block) - 0.5f * block, 0.012f, w),
               strip_cover(wrap(p.v + 0.5f * course, course) - 0.5f * course, 0.012f, w));
  const Color base = mix(stone, 0.5f * object.color, 0.4f) * std::exp(1.5f * dirt + tone);
  wall = mix(wall, base * (1.0f - 0.5f * joints), below);
  wall =
      mix(wall, Color(0.42f, 0.41f, 0.39f), strip_cover(p.v - object.extent[1] + 0.12f, 0.1f, w));

  const float floor_height = 3.0f;
  const float pitch = 2.0f + 1.2f * hash_unit(2, 3, seed);
  const int across = std::max(1, static_cast<int>((object.extent[0] - 0.8f) / pitch));
  const float margin = 0.5f * (object.extent[0] - static_cast<float>(across) * pitch);
  const float cell_u = (p.u - margin) / pitch, cell_v = (p.v - 0.4f) / floor_height;
  const auto iu = static_cast<std::int32_t>(std::floor(cell_u));
  const auto iv = static_cast<std::int32_t>(std::floor(cell_v));
  const int floors = static_cast<int>((object.extent[1] - 0.3f) / floor_height + 0.1f);
  if (iu >= 0 && iu < across && iv >= 0 && iv < floors) {
    const float du = (cell_u - static_cast<float>(iu) - 0.5f) * pitch;
    float dv = (cell_v - static_cast<float>(iv)) * floor_height - 1.35f;
    float half_width = 0.42f + 0.25f * hash_unit(4, 5, seed);
    float half_height = 0.72f;
    const bool door =
        iv == 0 && iu == static_cast<int>(hash_unit(6, 7, seed) * static_cast<float>(across));
    if (door) {
      half_width = 0.55f;
      half_height = 1.15f;
      dv += 0.5f;
    }
    const float frame = rectangle_cover(du, dv, half_width + 0.09f, half_height + 0.09f, w);
    const float pane = rectangle_cover(du, dv, half_width, half_height, w);
    const Color trim =
        hash_unit(8, 9, seed) < 0.6f ? Color(0.55f, 0.54f, 0.52f) : Color(0.16f, 0.11f, 0.08f);
    wall = mix(wall, trim, frame);
    // Sill's shadow below the window, as a hint of depth.
    wall *=
        1.0f - 0.35f * rectangle_cover(du, dv + half_height + 0.14f, half_width + 0.12f, 0.05f, w);
    if (door) {
      const float hue = hash_unit(10, 11, seed);
      const Color leaf = mix(Color(0.16f, 0.05f, 0.03f), Color(0.03f, 0.07f, 0.10f), hue);
      wall = mix(wall, leaf * (0.8f + 0.4f * strip_cover(dv, 0.5f, w)), pane);
    } else {
      const float curtain = hash_unit(iu, iv, seed + 95);
      Color glass = mix(Color(0.025f, 0.030f, 0.036f), Color(0.30f, 0.29f, 0.27f),
                        curtain < 0.35f ? 0.7f * below_edge(-dv + 0.2f * curtain, w) : 0.0f);
      const float cross = std::max(strip_cover(du, 0.03f, w), strip_cover(dv - 0.25f, 0.025f, w));
      glass = mix(glass, trim, cross);
      wall = mix(wall, glass, pane);
      out.mirror = 0.25f * pane * (1.0f - cross);
    }
  }
  out.albedo = wall;
  return out;
}

Color roof(const SynthObject& object, Texel p, float w) {
  const float row = 0.30f, length = 0.22f;
  const auto iv = static_cast<std::int32_t>(std::floor(p.v / row));
  const auto iu = static_cast<std::int32_t>(std::floor(p.u / length));
  const float tile = 0.35f * (hash_unit(iu, iv, object.seed) - 0.5f) * octave_weight(2 * length, w);
  const float edge = 0.5f * strip_cover(wrap(p.v + 0.5f * row, row) - 0.5f * row, 0.02f, w);
  const float moss = 0.3f * octave(p, 1.9f, w, object.seed + 1);
  return object.color * std::exp(tile + moss) * (1.0f - edge);
}

Color sign(const SynthObject& object, Texel p, float w) {
  const float r = std::hypot(p.u, p.v);
  const bool blue = hash_unit(1, 1, object.seed) < 0.4f;
  const Color rim = blue ? Color(0.6f, 0.6f, 0.6f) : Color(0.50f, 0.02f, 0.025f);
  const Color field = blue ? Color(0.02f, 0.08f, 0.36f) : Color(0.62f, 0.62f, 0.60f);
  const Color ink = blue ? Color(0.6f, 0.6f, 0.6f) : Color(0.03f, 0.03f, 0.03f);
  const float radius = object.extent[0];
  Color color = mix(rim, field, below_edge(r - (blue ? 0.94f : 0.78f) * radius, w));
  // Two digits, as bars.
  const float a = rectangle_cover(p.u + 0.085f, p.v, 0.025f, 0.11f, w);
  const float b = rectangle_cover(p.u - 0.085f, p.v, 0.055f, 0.11f, w) -
                  rectangle_cover(p.u - 0.085f, p.v, 0.025f, 0.08f, w);
  return mix(color, ink, clamp01(a + b));
}

/// Light of the surroundings that a car's paint or a window mirrors.
Radiance surroundings(const SynthWorld& world, const Eigen::Vector3d& direction) {
  const Eigen::Vector3d d = direction.normalized();
  const auto up = static_cast<float>(d.z());
  const Color ground(0.13f, 0.13f, 0.12f), far(0.22f, 0.23f, 0.21f);
  if (up < 0.0f) return mix(far, ground, smooth_step(0.0f, 0.15f, -up));
  const Color sky = shade_sky(world, Eigen::Vector3d(d.x(), d.y(), std::max(0.12, d.z())));
  return mix(far, 0.8f * sky, smooth_step(0.04f, 0.30f, up));
}

/// Texture of a car: p are metres in the vehicle's frame, see car_mesh.
Surface car_surface(const SynthObject& object, const Eigen::Vector3f& at,
                    const Eigen::Vector3f& normal, float w) {
  Surface out;
  const float length = object.extent[0], height = object.extent[2], radius = object.extent[3];
  const bool flank = std::fabs(normal.z()) > 0.6f;
  switch (object.kind) {
    case SurfaceKind::kCarPaint: {
      out.albedo = object.color;
      out.mirror = 0.05f;
      // Dirt at the sills, gaps around the doors and the boot's and bonnet's lids.
      out.albedo = mix(out.albedo, Color(0.10f, 0.09f, 0.08f),
                       0.35f * (1.0f - smooth_step(0.25f * height, 0.45f * height, at.y())));
      float gap = 0.0f;
      if (flank && at.y() > 0.2f * height && at.y() < 0.66f * height) {
        for (const float share : {0.21f, -0.045f, -0.25f}) {
          gap = std::max(gap, strip_cover(at.x() - share * length, 0.006f, w));
        }
        // Door handles.
        for (const float share : {-0.015f, -0.22f}) {
          gap = std::max(gap, 0.8f * rectangle_cover(at.x() - share * length - 0.01f,
                                                     at.y() - 0.585f * height, 0.09f, 0.014f, w));
        }
      }
      out.albedo = mix(out.albedo, Color::Constant(0.012f), gap);
      break;
    }
    case SurfaceKind::kCarGlass:
      out.albedo = Color(0.016f, 0.018f, 0.020f);
      out.mirror = 0.10f;
      break;
    case SurfaceKind::kCarTyre:
      out.albedo = Color::Constant(0.022f);
      break;
    case SurfaceKind::kCarLight: {
      const bool front = at.x() > 0.0f;
      out.albedo = front ? Color(0.55f, 0.56f, 0.58f) : Color(0.36f, 0.012f, 0.014f);
      out.mirror = 0.10f;
      break;
    }
    case SurfaceKind::kCarPlate: {
      out.albedo = Color(0.62f, 0.62f, 0.60f);
      const float phase = wrap(at.z(), 0.062f) - 0.031f;
      const auto glyph = static_cast<std::int32_t>(std::floor(at.z() / 0.062f));
      if (hash_unit(glyph, 3, object.seed) < 0.8f && std::fabs(normal.x()) > 0.4f) {
        out.albedo = mix(out.albedo, Color::Constant(0.03f), 0.7f * strip_cover(phase, 0.018f, w));
      }
      break;
    }
    case SurfaceKind::kCarTrim:
      out.albedo = Color::Constant(0.028f);
      out.mirror = 0.02f;
      // Most cars have painted bumpers with a dark lower lip.
      if (std::fabs(normal.x()) > 0.5f && hash_unit(5, 1, object.seed) < 0.7f) {
        const float lip = 0.24f * height;
        if (at.y() > lip && at.y() < 0.42f * height && std::fabs(at.x()) > 0.42f * length) {
          out.albedo = mix(object.color, out.albedo, below_edge(at.y() - lip - 0.03f, w));
          out.mirror = 0.05f;
        }
      }
      break;
    case SurfaceKind::kCarRim: {
      out.albedo = Color(0.34f, 0.34f, 0.35f);
      out.mirror = 0.06f;
      // Five openings between the spokes; extent[0], [1]: the axles' x; [2]: their height.
      const float axle = std::fabs(at.x() - object.extent[0]) < std::fabs(at.x() - object.extent[1])
                             ? object.extent[0]
                             : object.extent[1];
      const float x = at.x() - axle, y = at.y() - object.extent[2];
      const float r = std::hypot(x, y);
      const float around = wrap(std::atan2(y, x) / (2.0f * kPi) * 5.0f, 1.0f) - 0.5f;
      const float open =
          below_edge(0.22f * radius - r, w) * below_edge(r - 0.58f * radius, w) *
          strip_cover(around * 2.0f * kPi / 5.0f * r, 0.30f * 2.0f * kPi / 5.0f * r, w);
      out.albedo = mix(out.albedo, Color::Constant(0.02f), open);
      out.mirror *= 1.0f - open;
      break;
    }
    default:
      break;
  }
  return out;
}

Surface texture_at(const SynthWorld& world, const SynthObject& object, Texel p, float w) {
  Surface out;
  const std::uint32_t seed = object.seed;
  switch (object.kind) {
    case SurfaceKind::kAsphalt:
      out.albedo = asphalt(world.markings, object.extent[0], object.extent[1], p, w, seed);
      break;
    case SurfaceKind::kKerb:
      out.albedo = kerb(p, w, seed);
      break;
    case SurfaceKind::kPavement:
      out.albedo = slabs({p.u, std::fabs(p.v) - object.extent[0] - 0.15f}, w, 0.5f, 0.5f, 0.012f,
                         Color(0.215f, 0.205f, 0.190f), 0.22f, seed);
      break;
    case SurfaceKind::kPad:
      out.albedo = slabs({p.u, std::fabs(p.v) - object.extent[0]}, w, 0.24f, 0.16f, 0.010f,
                         Color(0.200f, 0.170f, 0.150f), 0.35f, seed + 5);
      break;
    case SurfaceKind::kGrass:
      out.albedo = grass(p, w, seed);
      break;
    case SurfaceKind::kFacade:
      return facade(object, p, w);
    case SurfaceKind::kRoof:
      out.albedo = roof(object, p, w);
      break;
    case SurfaceKind::kSign:
      out.albedo = sign(object, p, w);
      break;
    case SurfaceKind::kBark:
      out.albedo = object.color * std::exp(0.5f * octave({p.u, 0.3f * p.v}, 0.06f, w, seed) +
                                           0.4f * octave({p.u, 0.3f * p.v}, 0.2f, w, seed + 1));
      break;
    case SurfaceKind::kLeaf:
      // texture: depth inside the crown (0 middle, 1 shell) and the leaf's own tone
      out.albedo = object.color * (0.35f + 0.65f * p.u) * (0.7f + 0.6f * p.v);
      break;
    default:
      out.albedo = object.color;
      break;
  }
  return out;
}

/// How open the sky is above a point of the ground near the cars: 1 in the open, 0.2 under one.
float openness(const SynthWorld& world, int frame, const Eigen::Vector3d& position) {
  float open = 1.0f;
  for (const SynthCar& car : world.cars) {
    const SE3& pose = car.world_from_vehicle[frame];
    const Eigen::Vector3d away = position - pose.translation();
    if (away.squaredNorm() > 16.0) continue;
    const Eigen::Vector3d local = pose.rotation().conjugate() * away;
    if (std::abs(local.y()) > 0.4) continue;
    const double dx = std::abs(local.x()) - 0.5 * car.model.dimensions.length;
    const double dz = std::abs(local.z()) - 0.5 * car.model.dimensions.width;
    const double outside = std::hypot(std::max(dx, 0.0), std::max(dz, 0.0));
    const double signed_distance = outside > 0.0 ? outside : std::max(dx, dz);
    open *= 0.16f + 0.84f * smooth_step(-0.30f, 0.55f, static_cast<float>(signed_distance));
  }
  return open;
}

bool in_shadow(const SynthWorld& world, int frame, const Eigen::Vector3d& from,
               const Eigen::Vector3d& to_sun) {
  constexpr double kFar = 200.0;
  if (world.shadow_bvh.blocked(from, to_sun, 0.0, kFar)) return true;
  for (const SynthCar& car : world.cars) {
    const SE3& pose = car.world_from_vehicle[frame];
    // The ray's distance from the car's middle first.
    const Eigen::Vector3d middle =
        pose.translation() + pose.rotation() * Eigen::Vector3d(0, 0.7, 0);
    const Eigen::Vector3d away = middle - from;
    const double along = std::max(0.0, away.dot(to_sun));
    if ((away - along * to_sun).squaredNorm() > 9.0) continue;
    const Eigen::Quaterniond back = pose.rotation().conjugate();
    if (car.bvh.blocked(back * (from - pose.translation()), back * to_sun, 0.0, kFar)) return true;
  }
  return false;
}

}  // namespace

Radiance shade_sky(const SynthWorld& world, const Eigen::Vector3d& direction) {
  const Eigen::Vector3f d = direction.normalized().cast<float>();
  const float cloudiness = world.light.cloudiness;
  const Color zenith = mix(Color(0.13f, 0.25f, 0.52f), Color(0.42f, 0.45f, 0.50f), cloudiness);
  const Color horizon = mix(Color(0.50f, 0.57f, 0.66f), Color(0.58f, 0.60f, 0.62f), cloudiness);
  const auto seed = static_cast<std::uint32_t>(world.road.layout().seed) + 900u;

  // Hills all around, one nearer and one farther range.
  const float azimuth = std::atan2(d.y(), d.x());
  const Texel round{4.0f * std::cos(azimuth), 4.0f * std::sin(azimuth)};
  const auto ridge = [&](float base, float rough, std::uint32_t s) {
    return base + rough * (0.6f * gradient_noise(0.5f * round, s) +
                           0.3f * gradient_noise(1.7f * round, s + 1) +
                           0.08f * gradient_noise(7.0f * round, s + 2) +
                           0.04f * gradient_noise(23.0f * round, s + 3));
  };
  const float blur = 0.0012f;  // rad, about one pixel
  const float elevation = std::asin(std::clamp(d.z(), -1.0f, 1.0f));

  Color sky = mix(horizon, zenith, smooth_step(0.0f, 0.9f, std::max(0.0f, d.z())));
  if (d.z() > 0.01f) {
    const float k = 1.0f / (d.z() + 0.08f);
    const Texel plane{d.x() * k, d.y() * k};
    const float near_horizon = smooth_step(0.01f, 0.15f, d.z());
    float cover = 0.55f * gradient_noise(0.7f * plane, seed) +
                  0.30f * gradient_noise(1.9f * plane, seed + 1) +
                  0.16f * gradient_noise(4.3f * plane, seed + 2) +
                  0.08f * near_horizon * gradient_noise(10.0f * plane, seed + 3);
    cover = smooth_step(0.25f - 0.6f * cloudiness, 0.75f - 0.4f * cloudiness, cover + 0.15f);
    const Color cloud = mix(Color(0.80f, 0.80f, 0.80f), Color(0.52f, 0.54f, 0.57f), cloudiness);
    sky = mix(sky, cloud, 0.85f * cover * near_horizon);
  }
  const float far_ridge = ridge(0.045f, 0.05f, seed + 10),
              near_ridge = ridge(0.012f, 0.045f, seed + 20);
  const Color far_hill(0.36f, 0.44f, 0.50f);
  const float woods = 0.15f * gradient_noise({30.0f * azimuth, 60.0f * elevation}, seed + 30) +
                      0.1f * gradient_noise({90.0f * azimuth, 150.0f * elevation}, seed + 31);
  const Color near_hill = Color(0.20f, 0.26f, 0.20f) * std::exp(woods);
  sky = mix(sky, far_hill, below_edge(elevation - far_ridge, blur));
  return mix(sky, near_hill, below_edge(elevation - near_ridge, blur));
}

Radiance shade_hit(const SynthWorld& world, int frame, const ViewRay& ray, const WorldHit& hit) {
  if (hit.triangle < 0) return shade_sky(world, ray.direction);
  const SynthMesh& mesh = hit.car < 0 ? world.ground_and_things : world.cars[hit.car].mesh;
  const SynthTriangle& triangle = mesh.triangles[hit.triangle];
  const SynthObject& object = mesh.objects[triangle.object];

  // The ray in the mesh's own frame.
  Eigen::Vector3d origin = ray.origin, direction = ray.direction;
  Eigen::Vector3d along_x = ray.along_x, along_y = ray.along_y;
  Eigen::Quaterniond world_from_mesh = Eigen::Quaterniond::Identity();
  if (hit.car >= 0) {
    const SE3& pose = world.cars[hit.car].world_from_vehicle[frame];
    world_from_mesh = pose.rotation();
    const Eigen::Quaterniond back = world_from_mesh.conjugate();
    origin = back * (ray.origin - pose.translation());
    direction = back * direction;
    along_x = back * along_x;
    along_y = back * along_y;
  }

  const Eigen::Vector3d e1 = triangle.points[1] - triangle.points[0];
  const Eigen::Vector3d e2 = triangle.points[2] - triangle.points[0];
  const Eigen::Vector3d cross = e1.cross(e2);
  const double facing = cross.dot(direction);
  if (facing == 0.0) return shade_sky(world, ray.direction);
  const double t = cross.dot(triangle.points[0] - origin) / facing;
  const Eigen::Vector3d local = origin + t * direction;

  // Barycentric coordinates, kept inside the triangle: at its border the sample's centre may lie a
  // hair outside.
  const double inverse_square = 1.0 / cross.squaredNorm();
  const auto barycentric = [&](const Eigen::Vector3d& v) -> Eigen::Vector2d {
    return inverse_square * Eigen::Vector2d(v.cross(e2).dot(cross), e1.cross(v).dot(cross));
  };
  Eigen::Vector2d b = barycentric(local - triangle.points[0]);
  b = b.cwiseMax(0.0);
  if (b.sum() > 1.0) b /= b.sum();
  const auto b0 = static_cast<float>(1.0 - b.sum()), b1 = static_cast<float>(b.x()),
             b2 = static_cast<float>(b.y());
  Eigen::Vector3f normal_local =
      (b0 * triangle.normals[0] + b1 * triangle.normals[1] + b2 * triangle.normals[2]).normalized();

  // Footprint of the sample in texture coordinates (Igehy, "Tracing Ray Differentials", 1999).
  const auto footprint = [&](const Eigen::Vector3d& change) {
    const Eigen::Vector3d moved = t * change - t * (cross.dot(change) / facing) * direction;
    const Eigen::Vector2f db = barycentric(moved).cast<float>();
    return Eigen::Vector2f(db.x() * (triangle.texture[1] - triangle.texture[0]) +
                           db.y() * (triangle.texture[2] - triangle.texture[0]));
  };
  const Eigen::Vector2f fx = footprint(along_x), fy = footprint(along_y);

  Surface surface;
  if (hit.car >= 0) {
    const auto width = static_cast<float>(t * std::max(along_x.norm(), along_y.norm()));
    surface = car_surface(object, local.cast<float>(), normal_local, width);
  } else {
    const Eigen::Vector2f uv =
        b0 * triangle.texture[0] + b1 * triangle.texture[1] + b2 * triangle.texture[2];
    const bool x_longer = fx.squaredNorm() > fy.squaredNorm();
    const Eigen::Vector2f major = x_longer ? fx : fy;
    const float longest = major.norm();
    const float area = std::fabs(fx.x() * fy.y() - fx.y() * fy.x());
    float minor = longest > 0.0f ? area / longest : 0.0f;
    const int taps =
        std::clamp(static_cast<int>(std::ceil(longest / std::max(minor, 1e-4f))), 1, 16);
    minor = std::max(minor, longest / static_cast<float>(taps));
    surface.albedo.setZero();
    for (int i = 0; i < taps; ++i) {
      const float share = (static_cast<float>(i) + 0.5f) / static_cast<float>(taps) - 0.5f;
      const Surface one = texture_at(
          world, object, {uv.x() + share * major.x(), uv.y() + share * major.y()}, minor);
      surface.albedo += one.albedo / static_cast<float>(taps);
      surface.mirror += one.mirror / static_cast<float>(taps);
    }
  }

  // Light.
  const Eigen::Vector3d position = ray.origin + t * ray.direction;
  const Eigen::Vector3d face = (world_from_mesh * cross).normalized() *
                               (ray.direction.dot(world_from_mesh * cross) > 0.0 ? -1.0 : 1.0);
  Eigen::Vector3d normal = world_from_mesh * normal_local.cast<double>();
  if (object.kind != SurfaceKind::kLeaf && normal.dot(face) < 0.0) normal = -normal;

  const auto toward_sun = static_cast<float>(normal.dot(world.light.to_sun));
  float sun = 0.0f;
  if (toward_sun > 0.0f &&
      (object.kind == SurfaceKind::kLeaf || face.dot(world.light.to_sun) > 0.0)) {
    // The sun's disc, wider behind thin clouds.
    const float radius = 0.006f + 0.05f * world.light.cloudiness;
    const float angle = 2.0f * kPi * hash_unit(1, 0, ray.random);
    const float away = radius * std::sqrt(hash_unit(2, 0, ray.random));
    const Eigen::Vector3d a = world.light.to_sun.unitOrthogonal();
    const Eigen::Vector3d c = world.light.to_sun.cross(a);
    const Eigen::Vector3d to_sun =
        (world.light.to_sun + away * (std::cos(angle) * a + std::sin(angle) * c)).normalized();
    const double lift = object.kind == SurfaceKind::kLeaf ? 0.25 : 0.004;
    const Eigen::Vector3d from =
        position + lift * (object.kind == SurfaceKind::kLeaf ? to_sun : face);
    if (!in_shadow(world, frame, from, to_sun)) sun = world.light.sun * toward_sun;
  }
  const auto up = static_cast<float>(normal.z());
  float sky = world.light.sky * (0.5f + 0.5f * up);
  if (hit.car < 0 && up > 0.5f) sky *= openness(world, frame, position);
  const float bounce = 0.16f * (world.light.sky + 0.5f * world.light.sun) * (0.5f - 0.5f * up);
  const Color light =
      sun * Color(1.04f, 1.0f, 0.93f) + sky * Color(0.95f, 1.0f, 1.07f) + Color::Constant(bounce);
  Radiance out = surface.albedo.cwiseProduct(light);

  if (surface.mirror > 0.0f) {
    const Eigen::Vector3d view = ray.direction.normalized();
    const double cosine = std::min(1.0, std::max(0.0, -view.dot(normal)));
    const Eigen::Vector3d mirrored = view - 2.0 * view.dot(normal) * normal;
    const float grazing = std::pow(1.0f - static_cast<float>(cosine), 5.0f);
    const float share = surface.mirror + (0.75f - surface.mirror) * grazing;
    out = (1.0f - share) * out + share * surroundings(world, mirrored);
    const double toward = mirrored.dot(world.light.to_sun);
    if (sun > 0.0f && toward > 0.0) {
      out += Color::Constant(2.5f * share * world.light.sun *
                             static_cast<float>(std::pow(toward, 120.0)));
    }
  }

  // Thin haze.
  const auto distance = static_cast<float>(t * ray.direction.norm());
  const float haze = 1.0f - std::exp(-distance / 1500.0f);
  return mix(out, Color(0.50f, 0.54f, 0.58f), haze);
}

}  // namespace camber
