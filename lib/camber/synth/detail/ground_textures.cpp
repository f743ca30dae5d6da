#include "camber/synth/detail/ground_textures.h"

#include <algorithm>
#include <cmath>

#include "camber/core/target_clones.h"
#include "camber/synth/detail/texel_kernels.h"

#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

// u: m along the street's centreline (in space); v: lateral offset, m.

namespace camber {
namespace {

constexpr int kMost = TexelChunk::kMost;
constexpr float kPi = 3.14159265f;
using Values = float[kMost];

struct Range {
  float low, high;
};

Range range_of(const float* values, int n) {
  const auto [low, high] = std::minmax_element(values, values + n);
  return {*low, *high};
}

/// Where colours go.
struct Rgb {
  float* red;
  float* green;
  float* blue;
};

CAMBER_CLONES void set_color(int n, const Color& base, const float* __restrict tone,
                             float* __restrict red, float* __restrict green,
                             float* __restrict blue) {
  const float r = base[0], g = base[1], b = base[2];
  for (int i = 0; i < n; ++i) {
    const float factor = exp_approximate(tone[i]);
    red[i] = r * factor;
    green[i] = g * factor;
    blue[i] = b * factor;
  }
}

CAMBER_CLONES void mix_color(int n, const Color& other, const float* __restrict share, float factor,
                             float* __restrict red, float* __restrict green,
                             float* __restrict blue) {
  const float r = other[0], g = other[1], b = other[2];
  for (int i = 0; i < n; ++i) {
    float s = share[i];
    s = factor * (s < 0.0f ? 0.0f : (s > 1.0f ? 1.0f : s));
    red[i] += s * (r - red[i]);
    green[i] += s * (g - green[i]);
    blue[i] += s * (b - blue[i]);
  }
}

// ---------------------------------------------------------------- asphalt

/// Aggregate, then blotches, the long ones stretched along the road; light stones, spots of oil and
/// rubber.
void add_varied_grain(const TexelChunk& c, std::uint32_t seed, float* tone) {
  const NoiseLayer layers[] = {{0.30f, 0.011f, seed + 1},      {0.28f, 0.023f, seed + 2},
                               {0.26f, 0.047f, seed + 3},      {0.26f, 0.095f, seed + 4},
                               {0.22f, 0.19f, seed + 5},       {0.17f, 0.41f, seed + 6, 0.45f},
                               {0.13f, 0.9f, seed + 7, 0.45f}, {0.11f, 2.3f, seed + 8, 0.45f},
                               {0.11f, 7.0f, seed + 9}};
  for (const NoiseLayer& layer : layers) add_octave(c, layer, tone);
  add_spots(c, {0.55f, 0.060f, seed + 11}, 0.30f, 0.55f, tone);
  add_spots(c, {-0.45f, 0.13f, seed + 12}, 0.32f, 0.55f, tone);
  add_spots(c, {-0.28f, 0.55f, seed + 13}, 0.34f, 0.50f, tone);
}

/// Equal power in every octave from 8 mm to 20 m: alike at any scale, so that no feature has
/// a size of its own.
void add_self_similar_grain(const TexelChunk& c, std::uint32_t seed, float* tone) {
  float wavelength = 0.008f;
  for (std::uint32_t i = 0; wavelength < 20.0f; ++i, wavelength *= 1.7f) {
    add_octave(c, {0.21f, wavelength, seed + 101 + i}, tone);
  }
}

/// Tiles of one texture side by side, and a weak variation that does not repeat.
void add_repeating_grain(const TexelChunk& c, std::uint32_t seed, float* tone) {
  const float side = 0.45f + 0.9f * hash_unit(3, 1, seed);
  std::uint32_t layer = 0;
  for (int cells = 2; cells <= 64; cells *= 2, ++layer) {
    add_repeating_octave(c, {0.30f, side / static_cast<float>(cells), seed + 121 + layer}, cells,
                         tone);
  }
  add_octave(c, {0.09f, 0.16f, seed + 131}, tone);
  add_octave(c, {0.07f, 1.1f, seed + 132}, tone);
  add_octave(c, {0.07f, 5.0f, seed + 133}, tone);
}

CAMBER_CLONES void wheel_track_loop(int n, const float* __restrict v, const float* __restrict stain,
                                    float lane, float* __restrict tone) {
  for (int i = 0; i < n; ++i) {
    const float in_lane = std::fabs(std::fabs(v[i]) - lane);
    const float track = (in_lane - 0.75f) / 0.28f, middle = in_lane / 0.25f;
    const float a = track * track, b = middle * middle;
    tone[i] += 0.05f * exp_approximate(a < 60.0f ? -a : -60.0f) -
               0.07f * exp_approximate(b < 60.0f ? -b : -60.0f) * (1.0f + stain[i]);
  }
}

CAMBER_CLONES void repair_loop(int n, const float* __restrict u, const float* __restrict v,
                               const float* __restrict width, float cu, float cv, float half_long,
                               float half_wide, float change, float* __restrict tone,
                               float* __restrict seam) {
  for (int i = 0; i < n; ++i) {
    const float du = u[i] - cu, dv = v[i] - cv, w = width[i];
    const float inner = strip_cover(du, half_long, w) * strip_cover(dv, half_wide, w);
    const float outer =
        strip_cover(du, half_long + 0.03f, w) * strip_cover(dv, half_wide + 0.03f, w);
    tone[i] += inner * change;
    const float edge = 0.7f * (outer - inner);
    seam[i] = seam[i] > edge ? seam[i] : edge;
  }
}

/// Repairs: rectangles of another asphalt with a seam of bitumen.
void add_repairs(const TexelChunk& c, float lane, std::uint32_t seed, float* tone, float* seam) {
  const Range along = range_of(c.u, c.n);
  const auto last = static_cast<std::int32_t>(std::floor(along.high / 8.0f)) + 1;
  for (auto cell = static_cast<std::int32_t>(std::floor(along.low / 8.0f)) - 1; cell <= last;
       ++cell) {
    for (int side = 0; side < 2; ++side) {
      if (hash_unit(cell, side, seed + 20) > 0.34f) continue;
      const float half_long = 0.5f + 2.6f * hash_unit(cell, side, seed + 21);
      const float half_wide = 0.3f + 0.9f * hash_unit(cell, side, seed + 22);
      const float cu = (static_cast<float>(cell) + hash_unit(cell, side, seed + 23)) * 8.0f;
      const float reach = half_long + 0.03f + 2.0f;
      if (cu + reach < along.low || cu - reach > along.high) continue;
      const float room = std::max(0.0f, lane - half_wide - 0.15f);
      const float cv =
          (side == 0 ? lane : -lane) + room * (2.0f * hash_unit(cell, side, seed + 24) - 1.0f);
      const float change = 0.34f * hash_unit(cell, side, seed + 25) - 0.24f;
      repair_loop(c.n, c.u, c.v, c.width, cu, cv, half_long, half_wide, change, tone, seam);
    }
  }
}

CAMBER_CLONES void crack_loop(int n, const float* __restrict where, const float* __restrict level,
                              const float* __restrict width, float* __restrict seam) {
  for (int i = 0; i < n; ++i) {
    const float away = level[i] * 2.6f * 0.55f;  // about the distance to the zero line, m
    const float crack =
        0.75f * smooth_step(0.0f, 0.2f, where[i]) * strip_cover(away, 0.008f, width[i]);
    seam[i] = seam[i] > crack ? seam[i] : crack;
  }
}

/// Cracks: the zero lines of a warped noise, where a coarser noise allows them.
void add_cracks(const TexelChunk& c, std::uint32_t seed, float* seam) {
  Values where;
  plain_noise(c, 6.0f, seed + 30, where);
  if (range_of(where, c.n).high <= 0.0f) return;
  Values u, v, level;
  std::copy_n(c.u, c.n, u);
  std::copy_n(c.v, c.n, v);
  add_octave(c, {0.10f, 0.5f, seed + 31}, u);
  add_octave(c, {0.03f, 0.13f, seed + 32}, u);
  add_octave(c, {0.10f, 0.5f, seed + 33}, v);
  add_octave(c, {0.03f, 0.13f, seed + 34}, v);
  TexelChunk warped = c;
  warped.u = u;
  warped.v = v;
  plain_noise(warped, 2.6f, seed + 35, level);
  crack_loop(c.n, where, level, c.width, seam);
}

CAMBER_CLONES void joint_loop(int n, const float* __restrict v, const float* __restrict width,
                              const float* __restrict wobble, const float* __restrict dirt,
                              float half_width, float* __restrict tone, float* __restrict seam) {
  for (int i = 0; i < n; ++i) {
    const float joint = 0.5f * strip_cover(v[i] - 0.09f + wobble[i], 0.008f, width[i]);
    seam[i] = seam[i] > joint ? seam[i] : joint;
    const float gutter = smooth_step(half_width - 0.35f, half_width, std::fabs(v[i]));
    tone[i] -= 0.12f * gutter * (1.0f + dirt[i]);
  }
}

/// Manhole covers, one in some stretches of 22 m: shares of iron and of its ring.
bool add_manholes(const TexelChunk& c, float lane, std::uint32_t seed, float* iron, float* ring) {
  bool any = false;
  const Range along = range_of(c.u, c.n);
  const auto last = static_cast<std::int32_t>(std::floor(along.high / 22.0f));
  for (auto cell = static_cast<std::int32_t>(std::floor(along.low / 22.0f)); cell <= last; ++cell) {
    if (hash_unit(cell, 0, seed + 40) >= 0.55f) continue;
    const float cu =
        (static_cast<float>(cell) + 0.2f + 0.6f * hash_unit(cell, 1, seed + 40)) * 22.0f;
    const float cv = (hash_unit(cell, 2, seed + 40) < 0.5f ? lane : -lane) +
                     0.8f * (hash_unit(cell, 3, seed + 40) - 0.5f);
    for (int i = 0; i < c.n; ++i) {
      const float w = c.width[i], du = c.u[i] - cu, dv = c.v[i] - cv;
      const float r = std::sqrt(du * du + dv * dv);
      if (r > 0.37f + 0.5f * w) continue;
      any = true;
      const float cover = below_edge(r - 0.31f, w);
      ring[i] = below_edge(r - 0.37f, w) - cover;
      const float bars = 0.5f + 0.5f * std::sin(2.0f * kPi * du / 0.08f);
      iron[i] = cover * (0.85f + 0.3f * bars * octave_weight(0.08f, w));
    }
  }
  return any;
}

CAMBER_CLONES void paint_loop(int n, const float* __restrict u, const float* __restrict v,
                              const float* __restrict width, float period, float dash,
                              float half_line, float edge, float center, float* __restrict paint) {
  for (int i = 0; i < n; ++i) {
    const float x = u[i] + 0.5f * (period - dash);
    const float phase = x - period * std::floor(x / period) - 0.5f * period;
    const float dashes =
        center * strip_cover(phase, 0.5f * dash, width[i]) * strip_cover(v[i], half_line, width[i]);
    const float line =
        edge > 0.0f ? strip_cover(std::fabs(v[i]) - edge, half_line, width[i]) : 0.0f;
    paint[i] = dashes > line ? dashes : line;
  }
}

CAMBER_CLONES void white_loop(int n, const float* __restrict paint, const float* __restrict wear,
                              const float* __restrict tint, float* __restrict red,
                              float* __restrict green, float* __restrict blue) {
  for (int i = 0; i < n; ++i) {
    const float left = 0.82f - 0.55f * smooth_step(0.05f, 0.4f, wear[i]);
    const float share = paint[i] * left, white = 1.0f + tint[i];
    red[i] += share * (0.56f * white - red[i]);
    green[i] += share * (0.56f * white - green[i]);
    blue[i] += share * (0.54f * white - blue[i]);
  }
}

/// Lines of worn paint.
void add_markings(const MarkingSizes& marks, float half_width, const TexelChunk& c,
                  std::uint32_t seed, Rgb out) {
  if (!marks.center_line && !marks.edge_lines) return;
  Values paint;
  const auto period = static_cast<float>(marks.dash_length + marks.dash_gap);
  const float edge = marks.edge_lines ? half_width - static_cast<float>(marks.edge_inset) : 0.0f;
  paint_loop(c.n, c.u, c.v, c.width, period, static_cast<float>(marks.dash_length),
             static_cast<float>(0.5 * marks.line_width), edge, marks.center_line ? 1.0f : 0.0f,
             paint);
  if (range_of(paint, c.n).high <= 0.0f) return;
  Values wear{}, tint{};
  add_octave(c, {0.5f, 0.05f, seed + 50}, wear);
  add_octave(c, {0.45f, 0.017f, seed + 51}, wear);
  add_octave(c, {0.35f, 0.6f, seed + 52}, wear);
  add_octave(c, {0.12f, 0.3f, seed + 53}, tint);
  white_loop(c.n, paint, wear, tint, out.red, out.green, out.blue);
}

/// What wear and repair leave on asphalt: tone, seams, wheel tracks.
void add_history(const TexelChunk& c, float half_width, bool marked, std::uint32_t seed,
                 float* tone, float* seam) {
  // Wheel tracks are polished and a little lighter, the middle of the lane has oil on it.
  const float lane = 0.5f * half_width;
  Values values{};
  if (marked) {
    add_octave(c, {1.0f, 1.7f, seed + 10, 0.45f}, values);
    wheel_track_loop(c.n, c.v, values, lane, tone);
  }
  add_repairs(c, lane, seed, tone, seam);
  add_cracks(c, seed, seam);
  if (!marked) return;
  // The joint between the two lanes' pavings, and dirt at the edge.
  Values wobble{}, dirt{};
  add_octave(c, {0.02f, 0.7f, seed + 36}, wobble);
  add_octave(c, {1.5f, 0.6f, seed + 37, 0.45f}, dirt);
  joint_loop(c.n, c.v, c.width, wobble, dirt, half_width, tone, seam);
}

void asphalt(const SynthWorld& world, const SynthObject& object, const TexelChunk& c, Rgb out) {
  const float half_width = object.extent[0], contrast = object.extent[1];
  const bool marked = object.extent[2] > 0.0f;
  const std::uint32_t seed = object.seed;
  Values tone{}, seam{}, iron{}, ring{};
  bool manholes = false;
  switch (world.asphalt.texture) {
    case AsphaltTexture::kVaried:
      add_varied_grain(c, seed, tone);
      break;
    case AsphaltTexture::kSelfSimilar:
      add_self_similar_grain(c, seed, tone);
      break;
    case AsphaltTexture::kRepeating:
      add_repeating_grain(c, seed, tone);
      break;
  }
  for (int i = 0; i < c.n; ++i) tone[i] *= contrast;
  if (world.asphalt.texture == AsphaltTexture::kVaried) {
    add_history(c, half_width, marked, seed, tone, seam);
    manholes = add_manholes(c, 0.5f * half_width, seed, iron, ring);
  }
  set_color(c.n, Color(0.118f, 0.116f, 0.113f), tone, out.red, out.green, out.blue);
  mix_color(c.n, Color(0.035f, 0.034f, 0.034f), seam, 1.0f, out.red, out.green, out.blue);
  if (manholes) {
    mix_color(c.n, Color(0.075f, 0.07f, 0.066f), iron, 1.0f, out.red, out.green, out.blue);
    mix_color(c.n, Color(0.17f, 0.168f, 0.165f), ring, 0.7f, out.red, out.green, out.blue);
  }
  if (marked) add_markings(world.markings, half_width, c, seed, out);
}

// ---------------------------------------------------------------- beside the road

void add_concrete_grain(const TexelChunk& c, std::uint32_t seed, float* tone) {
  const NoiseLayer layers[] = {{0.18f, 0.013f, seed + 60}, {0.15f, 0.03f, seed + 61},
                               {0.14f, 0.08f, seed + 62},  {0.12f, 0.25f, seed + 63},
                               {0.12f, 0.8f, seed + 64},   {0.12f, 3.0f, seed + 65}};
  for (const NoiseLayer& layer : layers) add_octave(c, layer, tone);
}

CAMBER_CLONES void kerb_loop(int n, const float* __restrict u, const float* __restrict width,
                             std::uint32_t seed, float* __restrict brightness,
                             float* __restrict joint) {
  for (int i = 0; i < n; ++i) {
    const auto stone = static_cast<std::int32_t>(std::floor(u[i]));
    brightness[i] = 0.9f + 0.2f * hash_unit(stone, 7, seed);
    const float x = u[i] + 0.5f;
    joint[i] = strip_cover(x - std::floor(x) - 0.5f, 0.008f, width[i]);
  }
}

CAMBER_CLONES void scale_color(int n, const float* __restrict factor, float* __restrict red,
                               float* __restrict green, float* __restrict blue) {
  for (int i = 0; i < n; ++i) {
    red[i] *= factor[i];
    green[i] *= factor[i];
    blue[i] *= factor[i];
  }
}

/// Stones of 1 m with joints.
void kerb(const SynthObject& object, const TexelChunk& c, Rgb out) {
  Values tone{}, brightness, joint;
  add_concrete_grain(c, object.seed, tone);
  kerb_loop(c.n, c.u, c.width, object.seed, brightness, joint);
  set_color(c.n, Color(0.235f, 0.232f, 0.222f), tone, out.red, out.green, out.blue);
  scale_color(c.n, brightness, out.red, out.green, out.blue);
  mix_color(c.n, Color(0.06f, 0.058f, 0.055f), joint, 1.0f, out.red, out.green, out.blue);
}

/// Slabs in running bond.
struct SlabPattern {
  float length, width, joint;  ///< m
  Color base;
  float spread;  ///< of the slabs' brightness
  std::uint32_t seed;
};

CAMBER_CLONES void slab_loop(int n, const float* __restrict u, const float* __restrict v,
                             const float* __restrict pixel, float length, float width, float joint,
                             float spread, std::uint32_t seed, float* __restrict brightness,
                             float* __restrict line) {
  for (int i = 0; i < n; ++i) {
    const auto iv = static_cast<std::int32_t>(std::floor(v[i] / width));
    const float shifted = u[i] + 0.5f * length * static_cast<float>(iv & 1);
    const auto iu = static_cast<std::int32_t>(std::floor(shifted / length));
    brightness[i] = 1.0f + spread * (hash_unit(iu, iv, seed + 70) - 0.5f) *
                               octave_weight(2.0f * width, pixel[i]);
    const float xu = shifted + 0.5f * length, xv = v[i] + 0.5f * width;
    const float du = xu - length * std::floor(xu / length) - 0.5f * length;
    const float dv = xv - width * std::floor(xv / width) - 0.5f * width;
    const float across = strip_cover(du, 0.5f * joint, pixel[i]);
    const float along = strip_cover(dv, 0.5f * joint, pixel[i]);
    line[i] = across > along ? across : along;
  }
}

void slabs(const SlabPattern& p, const TexelChunk& c, Rgb out) {
  Values tone{}, brightness, line;
  add_concrete_grain(c, p.seed, tone);
  slab_loop(c.n, c.u, c.v, c.width, p.length, p.width, p.joint, p.spread, p.seed, brightness, line);
  set_color(c.n, p.base, tone, out.red, out.green, out.blue);
  scale_color(c.n, brightness, out.red, out.green, out.blue);
  mix_color(c.n, 0.3f * p.base, line, 0.8f, out.red, out.green, out.blue);
}

CAMBER_CLONES void grass_loop(int n, const float* __restrict patches,
                              const float* __restrict blades, float* __restrict red,
                              float* __restrict green, float* __restrict blue) {
  for (int i = 0; i < n; ++i) {
    float dry = 0.35f + 0.7f * patches[i];
    dry = dry < 0.0f ? 0.0f : (dry > 1.0f ? 1.0f : dry);
    const float soil = 0.8f * smooth_step(0.35f, 0.8f, patches[i] - 0.3f * blades[i]);
    const float light = exp_approximate(0.55f * blades[i]);
    const float r = 0.060f + dry * (0.155f - 0.060f);
    const float g = 0.098f + dry * (0.135f - 0.098f);
    const float b = 0.022f + dry * (0.062f - 0.022f);
    red[i] = (r + soil * (0.105f - r)) * light;
    green[i] = (g + soil * (0.080f - g)) * light;
    blue[i] = (b + soil * (0.055f - b)) * light;
  }
}

void grass(const SynthObject& object, const TexelChunk& c, Rgb out) {
  const std::uint32_t seed = object.seed;
  Values patches{}, blades{};
  add_octave(c, {0.7f, 4.0f, seed + 80}, patches);
  add_octave(c, {0.5f, 1.3f, seed + 81}, patches);
  add_octave(c, {0.4f, 0.45f, seed + 82}, patches);
  add_octave(c, {0.5f, 11.0f, seed + 83}, patches);
  add_octave(c, {0.5f, 0.17f, seed + 84}, blades);
  add_octave(c, {0.55f, 0.07f, seed + 85}, blades);
  add_octave(c, {0.6f, 0.03f, seed + 86}, blades);
  add_octave(c, {0.5f, 0.013f, seed + 87}, blades);
  grass_loop(c.n, patches, blades, out.red, out.green, out.blue);
}

/// Slabs count from the street's edge.
void paved(const SynthObject& object, const SlabPattern& pattern, float from_edge,
           const TexelChunk& c, Rgb out) {
  Values v;
  for (int i = 0; i < c.n; ++i) v[i] = std::fabs(c.v[i]) - object.extent[0] - from_edge;
  TexelChunk shifted = c;
  shifted.v = v;
  slabs(pattern, shifted, out);
}

}  // namespace

void ground_reflectance(const SynthWorld& world, const SynthObject& object, const TexelChunk& c,
                        float* const channels[3]) {
  const Rgb out{channels[0], channels[1], channels[2]};
  switch (object.kind) {
    case SurfaceKind::kAsphalt:
      asphalt(world, object, c, out);
      break;
    case SurfaceKind::kKerb:
      kerb(object, c, out);
      break;
    case SurfaceKind::kPavement:
      paved(object, {0.5f, 0.5f, 0.012f, Color(0.215f, 0.205f, 0.190f), 0.22f, object.seed}, 0.15f,
            c, out);
      break;
    case SurfaceKind::kPad:
      paved(object, {0.24f, 0.16f, 0.010f, Color(0.200f, 0.170f, 0.150f), 0.35f, object.seed + 5},
            0.0f, c, out);
      break;
    default:
      grass(object, c, out);
      break;
  }
}

WaterFilm water_film(float wetness, const SynthObject& object, Texel place, float width) {
  const std::uint32_t seed = object.seed + 200;
  const float drying = 0.6f * octave(place, 4.0f, width, seed) +
                       0.4f * octave(place, 1.1f, width, seed + 1) +
                       0.25f * octave(place, 0.3f, width, seed + 2);
  const float low_ground = 0.75f * octave({0.5f * place.u, place.v}, 2.4f, width, seed + 3) +
                           0.35f * octave(place, 0.7f, width, seed + 4);
  // Water stands along the edges first.
  const float gutter = smooth_step(object.extent[0] - 0.7f, object.extent[0], std::fabs(place.v));
  WaterFilm out;
  out.film = smooth_step(0.0f, 0.35f, 1.4f * wetness - 0.35f + drying);
  out.puddle =
      out.film * smooth_step(0.0f, 0.06f, low_ground + 0.25f * gutter - 0.62f + 0.42f * wetness);
  return out;
}

}  // namespace camber
