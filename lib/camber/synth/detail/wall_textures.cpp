#include "camber/synth/detail/wall_textures.h"

#include <algorithm>
#include <cmath>

#include "camber/core/target_clones.h"
#include "camber/synth/detail/surface.h"

#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber {
namespace {

constexpr int kMost = TexelChunk::kMost;
using Values = float[kMost];

/// Blocks in running bond: their brightness around 1, and the share of joints.
CAMBER_CLONES void bond_loop(int n, const float* __restrict u, const float* __restrict v,
                             const float* __restrict width, float row, float length,
                             float half_joint, float spread, std::uint32_t seed,
                             float* __restrict tone, float* __restrict joints) {
  for (int i = 0; i < n; ++i) {
    const auto iv = static_cast<std::int32_t>(std::floor(v[i] / row));
    const float shifted = u[i] + 0.5f * length * static_cast<float>(iv & 1);
    const auto iu = static_cast<std::int32_t>(std::floor(shifted / length));
    tone[i] = spread * (hash_unit(iu, iv, seed) - 0.5f) * octave_weight(2.0f * row, width[i]);
    const float xu = shifted + 0.5f * length, xv = v[i] + 0.5f * row;
    const float du = xu - length * std::floor(xu / length) - 0.5f * length;
    const float dv = xv - row * std::floor(xv / row) - 0.5f * row;
    const float upright = strip_cover(du, half_joint, width[i]);
    const float level = strip_cover(dv, half_joint, width[i]);
    joints[i] = upright > level ? upright : level;
  }
}

/// Plaster or brick of one colour channel.
CAMBER_CLONES void wall_loop(int n, float color, const float* __restrict dirt, float mortar_color,
                             const float* __restrict tone, const float* __restrict mortar,
                             float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    const float wall = color * exp_approximate(dirt[i]) * (1.0f + tone[i]);
    out[i] = wall + 0.6f * mortar[i] * (mortar_color - wall);
  }
}

/// A plinth of stone below, a cornice above; one colour channel.
CAMBER_CLONES void plinth_loop(int n, const float* __restrict v, const float* __restrict width,
                               const float* __restrict dirt, float stone,
                               const float* __restrict tone, const float* __restrict joints,
                               float cornice, float cornice_at, float* __restrict out) {
  for (int i = 0; i < n; ++i) {
    const float base =
        stone * exp_approximate(1.5f * dirt[i] + tone[i]) * (1.0f - 0.5f * joints[i]);
    const float below = below_edge(v[i] - 0.55f, width[i]);
    const float wall = out[i] + below * (base - out[i]);
    out[i] = wall + strip_cover(v[i] - cornice_at, 0.1f, width[i]) * (cornice - wall);
  }
}

/// Plaster or brick over a plinth of stone, below a cornice.
void wall_colors(const SynthObject& object, const TexelChunk& c, float* const out[3]) {
  const std::uint32_t seed = object.seed;
  Values dirt{}, tone{}, joints{};
  add_octave(c, {0.10f, 2.6f, seed + 90}, dirt);
  add_octave(c, {0.08f, 0.7f, seed + 91}, dirt);
  add_octave(c, {0.10f, 0.21f, seed + 92}, dirt);
  add_octave(c, {0.10f, 0.06f, seed + 93}, dirt);
  const bool brick = hash_unit(0, 1, seed) < 0.3f;
  if (brick) {
    bond_loop(c.n, c.u, c.v, c.width, 0.075f, 0.25f, 0.006f, 0.3f, seed + 94, tone, joints);
  }
  const Color mortar(0.32f, 0.31f, 0.29f), cornice(0.42f, 0.41f, 0.39f);
  const Color stone = mix(Color(0.17f, 0.165f, 0.155f), 0.5f * object.color, 0.4f);
  for (int k = 0; k < 3; ++k) {
    wall_loop(c.n, object.color[k], dirt, mortar[k], tone, joints, out[k]);
  }
  bond_loop(c.n, c.u, c.v, c.width, 0.32f, 0.55f, 0.012f, 0.35f, seed + 96, tone, joints);
  for (int k = 0; k < 3; ++k) {
    plinth_loop(c.n, c.v, c.width, dirt, stone[k], tone, joints, cornice[k],
                object.extent[1] - 0.12f, out[k]);
  }
}

/// A window or the door over the wall; (du, dv) m from the middle of its cell.
void add_opening(const SynthObject& object, float du, float dv, std::int32_t iu, std::int32_t iv,
                 bool door, float w, Surface* out) {
  const std::uint32_t seed = object.seed;
  float half_width = 0.42f + 0.25f * hash_unit(4, 5, seed);
  float half_height = 0.72f;
  if (door) {
    half_width = 0.55f;
    half_height = 1.15f;
    dv += 0.5f;
  }
  Color wall = out->albedo;
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
    out->mirror = 0.25f * pane * (1.0f - cross);
  }
  out->albedo = wall;
}

/// Windows and a door over a wall's colour. u along the wall from its left end, v above the ground
/// floor, m; extent: the wall's length and height.
void add_openings(const SynthObject& object, Texel p, float w, Surface* out) {
  const std::uint32_t seed = object.seed;
  const float floor_height = 3.0f;
  const float pitch = 2.0f + 1.2f * hash_unit(2, 3, seed);
  const int across = std::max(1, static_cast<int>((object.extent[0] - 0.8f) / pitch));
  const float margin = 0.5f * (object.extent[0] - static_cast<float>(across) * pitch);
  const float cell_u = (p.u - margin) / pitch, cell_v = (p.v - 0.4f) / floor_height;
  const auto iu = static_cast<std::int32_t>(std::floor(cell_u));
  const auto iv = static_cast<std::int32_t>(std::floor(cell_v));
  const int floors = static_cast<int>((object.extent[1] - 0.3f) / floor_height + 0.1f);
  if (iu < 0 || iu >= across || iv < 0 || iv >= floors) return;
  const float du = (cell_u - static_cast<float>(iu) - 0.5f) * pitch;
  const float dv = (cell_v - static_cast<float>(iv)) * floor_height - 1.35f;
  const bool door =
      iv == 0 && iu == static_cast<int>(hash_unit(6, 7, seed) * static_cast<float>(across));
  add_opening(object, du, dv, iu, iv, door, w, out);
}

Color roof(const SynthObject& object, Texel p, float w) {
  const float row = 0.30f, length = 0.22f;
  const auto iv = static_cast<std::int32_t>(std::floor(p.v / row));
  const auto iu = static_cast<std::int32_t>(std::floor(p.u / length));
  const float tile = 0.35f * (hash_unit(iu, iv, object.seed) - 0.5f) * octave_weight(2 * length, w);
  const float edge = 0.5f * strip_cover(wrap(p.v + 0.5f * row, row) - 0.5f * row, 0.02f, w);
  const float moss = 0.3f * octave(p, 1.9f, w, object.seed + 1);
  return object.color * exp_approximate(tile + moss) * (1.0f - edge);
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

Color bark(const SynthObject& object, Texel p, float w) {
  const Texel along{p.u, 0.3f * p.v};
  return object.color * exp_approximate(0.5f * octave(along, 0.06f, w, object.seed) +
                                        0.4f * octave(along, 0.2f, w, object.seed + 1));
}

}  // namespace

void wall_reflectance(const SynthObject& object, const TexelChunk& c, float* const out[3],
                      float* mirror) {
  std::fill_n(mirror, c.n, 0.0f);
  if (object.kind == SurfaceKind::kFacade) wall_colors(object, c, out);
  for (int i = 0; i < c.n; ++i) {
    const Texel p{c.u[i], c.v[i]};
    Surface one;
    switch (object.kind) {
      case SurfaceKind::kFacade:
        one.albedo = Color(out[0][i], out[1][i], out[2][i]);
        add_openings(object, p, c.width[i], &one);
        mirror[i] = one.mirror;
        break;
      case SurfaceKind::kRoof:
        one.albedo = roof(object, p, c.width[i]);
        break;
      case SurfaceKind::kSign:
        one.albedo = sign(object, p, c.width[i]);
        break;
      case SurfaceKind::kBark:
        one.albedo = bark(object, p, c.width[i]);
        break;
      default:
        one.albedo = object.color;
        break;
    }
    for (int k = 0; k < 3; ++k) out[k][i] = one.albedo[k];
  }
}

}  // namespace camber
