#include "camber/synth/detail/crop_environment.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace camber {
namespace {

constexpr float kPi = 3.14159265f;

float number(Sequence* random, double low, double high) {
  return static_cast<float>(random->uniform(low, high));
}

float log_number(Sequence* random, double low, double high) {
  return static_cast<float>(std::exp(random->uniform(std::log(low), std::log(high))));
}

/// A colour of the given brightness and a random tint.
Color tinted(Sequence* random, float value, float strength) {
  Color out;
  for (int c = 0; c < 3; ++c) out[c] = value * (1.0f + strength * number(random, -1.0, 1.0));
  return out.cwiseMax(0.0f);
}

}  // namespace

CropEnvironment::CropEnvironment(Sequence* random) {
  seed_ = random->bits();
  cloudiness_ = random->chance(0.35) ? number(random, 0.8, 1.0) : number(random, 0.0, 0.8);
  const float azimuth = number(random, -kPi, kPi);
  const float elevation = number(random, 0.12, 1.25);
  to_sun = {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
            std::sin(elevation)};
  // From a clear day (the sun gives most light) to an overcast one.
  sun = cloudiness_ > 0.85f ? number(random, 0.0, 0.2) : log_number(random, 0.6, 3.5);
  sky = number(random, 0.25, 0.6) + 0.25f * cloudiness_;
  sun_radius = 0.006f + (cloudiness_ > 0.8f ? 0.15f : 0.03f * cloudiness_);
  const float warmth = number(random, 0.0, 0.25) * (1.0f - elevation / 1.4f);
  sun_color = Color(1.04f + warmth, 1.0f, 0.93f - warmth);
  sky_color = mix(Color(0.88f, 1.0f, 1.18f), Color(0.98f, 1.0f, 1.03f), cloudiness_);
  zenith_ = mix(Color(0.13f, 0.25f, 0.52f), Color(0.42f, 0.45f, 0.50f), cloudiness_) *
            number(random, 0.7, 1.5);
  horizon_ = mix(Color(0.50f, 0.57f, 0.66f), Color(0.62f, 0.63f, 0.65f), cloudiness_) *
             number(random, 0.8, 2.0);
  cloud_ = Color::Constant(number(random, 0.7, 1.6));
  ground = tinted(random, number(random, 0.06, 0.22), 0.1f);
  if (random->chance(0.25)) haze = log_number(random, 0.0005, 0.015);
  if (random->chance(0.22)) {
    foliage = log_number(random, 0.3, 4.0);
    foliage_cover_ = number(random, -0.25, 0.3);
  }
  const float level = log_number(random, 0.01, 0.5);
  const float trees = number(random, 0.0, 1.0);
  Cell cell;
  int left = 0;
  for (Cell& out : cells_) {
    if (left-- <= 0) {
      left = random->below(5);
      cell.trees = random->chance(static_cast<double>(trees));
      cell.height = level * number(random, 0.2, 1.6);
      cell.color = cell.trees ? Color(number(random, 0.02, 0.16), number(random, 0.04, 0.18),
                                      number(random, 0.01, 0.08))
                              : tinted(random, log_number(random, 0.06, 0.6), 0.25f);
      cell.windows = random->chance(0.6) ? number(random, 0.015, 0.06) : 0.0f;
    }
    out = cell;
  }
}

float CropEnvironment::below_foliage(float x, float y) const {
  const Texel p{x / foliage, y / foliage};
  const float cover = gradient_noise(p, seed_ + 31) + 0.5f * gradient_noise(2.7f * p, seed_ + 32);
  return smooth_step(foliage_cover_ - 0.08f, foliage_cover_ + 0.08f, cover);
}

Color CropEnvironment::light(const Eigen::Vector3f& direction, float blur) const {
  const float z = direction.dot(up);
  const float azimuth = std::atan2(direction.y(), direction.x());
  const float elevation = std::asin(std::clamp(z, -1.0f, 1.0f));
  Color sky_light = mix(horizon_, zenith_, smooth_step(0.0f, 0.8f, std::max(0.0f, z)));
  if (z > 0.0f) {
    const float k = 1.0f / (z + 0.15f);
    const Texel plane{direction.x() * k, direction.y() * k};
    float cover = 0.6f * gradient_noise(0.8f * plane, seed_);
    if (blur < 0.3f) cover += 0.3f * gradient_noise(2.1f * plane, seed_ + 1);
    cover = smooth_step(0.3f - 0.6f * cloudiness_, 0.8f - 0.4f * cloudiness_, cover + 0.15f);
    sky_light = mix(sky_light, cloud_, 0.8f * cover * smooth_step(0.0f, 0.2f, z));
    const float away = std::acos(std::clamp(direction.dot(to_sun), -1.0f, 1.0f));
    sky_light += 0.5f * sun * std::exp(-6.0f * away) * sun_color;
  }
  const float w = std::max(blur, 0.003f);
  // The skyline, one house or group of trees a cell.
  const float place = (azimuth / (2.0f * kPi) + 0.5f) * kCells;
  const int index = std::clamp(static_cast<int>(place), 0, kCells - 1);
  const Cell& cell = cells_[index];
  float top = cell.height;
  Color color = cell.color * (sky + 0.4f * sun);
  if (cell.trees) {
    top *= 1.0f + 0.5f * gradient_noise({25.0f * azimuth, 0.0f}, seed_ + 7);
    color *= std::exp(0.9f * octave({azimuth, elevation}, 0.05f, w, seed_ + 8) +
                      0.7f * octave({azimuth, elevation}, 0.015f, w, seed_ + 9));
  } else if (cell.windows > 0.0f) {
    const float u = wrap(azimuth, 1.6f * cell.windows) - 0.8f * cell.windows;
    const float v = wrap(elevation, 2.0f * cell.windows) - cell.windows;
    color = mix(color, 0.25f * color,
                rectangle_cover(u, v, 0.4f * cell.windows, 0.6f * cell.windows, w));
  }
  Color out = mix(sky_light, color, below_edge(elevation - top, w));
  const Color floor = ground * (sky + sun * std::max(0.0f, to_sun.dot(up)));
  return mix(out, floor, below_edge(elevation + 0.01f, w));
}

Color CropTexture::at(Texel p, float width) const {
  const Texel q = (1.0f / scale) * p;
  const float w = width / scale;
  Color out = a;
  float grain = 0.0f;
  switch (kind) {
    case Kind::kPlain:
      break;
    case Kind::kAsphalt: {
      grain = 0.8f * octave(p, 0.05f, width, seed) + 0.6f * octave(p, 0.02f, width, seed + 1);
      const float patch = gradient_noise(0.4f * p, seed + 2);
      out = mix(a, b, smooth_step(0.15f, 0.2f, patch));
      // Cracks and tar seams.
      const float seam = std::fabs(gradient_noise(0.35f * p, seed + 3));
      out = mix(out, c, 0.7f * below_edge(seam - 0.006f, 0.35f * width));
      break;
    }
    case Kind::kGrass:
      grain = 1.4f * octave(p, 0.25f, width, seed) + 1.4f * octave(p, 0.06f, width, seed + 1);
      out = mix(a, b, clamp01(0.5f + gradient_noise(1.1f * p, seed + 2)));
      break;
    case Kind::kBricks: {
      const float row = std::floor(q.v);
      const float u = q.u + (static_cast<int>(row) & 1 ? 0.5f : 0.0f) * 2.0f;
      const float tone =
          hash_unit(static_cast<int>(std::floor(0.5f * u)), static_cast<int>(row), seed);
      out = a * (0.75f + 0.5f * tone);
      const float joint = std::max(strip_cover(wrap(u, 2.0f) - 1.0f, 0.92f, w) *
                                       strip_cover(wrap(q.v, 1.0f) - 0.5f, 0.42f, w),
                                   0.0f);
      out = mix(b, out, joint);
      break;
    }
    case Kind::kFacade: {
      const float u = wrap(q.u, 1.0f) - 0.5f, v = wrap(q.v, 1.2f) - 0.6f;
      const int iu = static_cast<int>(std::floor(q.u)),
                iv = static_cast<int>(std::floor(q.v / 1.2f));
      out = mix(out, c, rectangle_cover(u, v, 0.33f, 0.42f, w));
      const Color glass = b * (0.3f + 1.4f * hash_unit(iu, iv, seed));
      out = mix(out, glass, rectangle_cover(u, v, 0.27f, 0.36f, w));
      out = mix(out, c, 0.8f * strip_cover(u, 0.02f, w) * strip_cover(v, 0.36f, w));
      break;
    }
    case Kind::kTiles: {
      const int iu = static_cast<int>(std::floor(q.u)), iv = static_cast<int>(std::floor(q.v));
      out = mix(a, b, hash_unit(iu, iv, seed));
      out = mix(c, out,
                rectangle_cover(wrap(q.u, 1.0f) - 0.5f, wrap(q.v, 1.0f) - 0.5f, 0.47f, 0.47f, w));
      break;
    }
    case Kind::kStripes: {
      const float along = q.u * std::cos(contrast * 20.0f) + q.v * std::sin(contrast * 20.0f);
      out = mix(a, b, strip_cover(wrap(along, 1.0f) - 0.5f, 0.25f, w));
      break;
    }
    case Kind::kPatches: {
      // Rectangles of random sizes and colours, one over the other.
      for (int level = 0; level < 3; ++level) {
        const float size = level == 0 ? 2.0f : (level == 1 ? 0.8f : 0.3f);
        const float u = q.u / size, v = q.v / size;
        const int iu = static_cast<int>(std::floor(u)), iv = static_cast<int>(std::floor(v));
        const std::uint32_t s = seed + 11u * static_cast<std::uint32_t>(level);
        if (hash_unit(iu, iv, s) > 0.55f) continue;
        const Color one(hash_unit(iu, iv, s + 1), hash_unit(iu, iv, s + 2),
                        hash_unit(iu, iv, s + 3));
        const float cover = rectangle_cover(wrap(u, 1.0f) - 0.5f, wrap(v, 1.0f) - 0.5f,
                                            0.15f + 0.33f * hash_unit(iu, iv, s + 4),
                                            0.15f + 0.33f * hash_unit(iu, iv, s + 5), w / size);
        out = mix(out, mix(Color(a + contrast * (one - Color::Constant(0.5f))), one, 0.4f), cover);
      }
      break;
    }
    case Kind::kLeaves:
      grain = 1.3f * octave(p, 0.5f, width, seed) + 1.6f * octave(p, 0.12f, width, seed + 1) +
              1.2f * octave(p, 0.04f, width, seed + 2);
      break;
  }
  grain += 0.6f * octave(q, 1.0f, w, seed + 4) + 0.5f * octave(q, 0.22f, w, seed + 5);
  grain += 0.7f * gradient_noise(0.23f * q, seed + 6);
  return (out * std::exp(contrast * grain)).cwiseMax(0.0f).cwiseMin(1.0f);
}

CropTexture draw_ground_texture(Sequence* random) {
  using Kind = CropTexture::Kind;
  CropTexture t;
  t.seed = random->bits();
  const double kind = random->uniform(0.0, 1.0);
  t.contrast = number(random, 0.1, 0.7);
  const float value = log_number(random, 0.04, 0.30);
  t.a = tinted(random, value, 0.12f);
  t.b = t.a * number(random, 0.6, 1.5);
  t.c = t.a * number(random, 0.2, 0.6);
  t.scale = log_number(random, 0.3, 2.0);
  if (kind < 0.62) {
    t.kind = Kind::kAsphalt;
  } else if (kind < 0.76) {
    t.kind = Kind::kTiles;
    t.scale = log_number(random, 0.12, 1.0);
  } else if (kind < 0.90) {
    t.kind = Kind::kGrass;
    t.a =
        Color(number(random, 0.04, 0.14), number(random, 0.07, 0.17), number(random, 0.015, 0.05));
    t.b = Color(number(random, 0.05, 0.25), number(random, 0.06, 0.22), number(random, 0.02, 0.08));
  } else {
    t.kind = random->chance(0.5) ? Kind::kPlain : Kind::kPatches;
  }
  return t;
}

CropTexture draw_wall_texture(Sequence* random) {
  using Kind = CropTexture::Kind;
  CropTexture t;
  t.seed = random->bits();
  t.contrast = number(random, 0.1, 0.7);
  t.a = tinted(random, log_number(random, 0.04, 0.75), 0.3f);
  t.b = tinted(random, log_number(random, 0.02, 0.6), 0.3f);
  t.c = tinted(random, log_number(random, 0.05, 0.8), 0.15f);
  const double kind = random->uniform(0.0, 1.0);
  if (kind < 0.30) {
    t.kind = Kind::kFacade;
    t.scale = log_number(random, 1.0, 3.5);
    t.b = Color::Constant(number(random, 0.01, 0.15));
  } else if (kind < 0.42) {
    t.kind = Kind::kBricks;
    t.scale = log_number(random, 0.07, 0.4);
  } else if (kind < 0.55) {
    t.kind = Kind::kStripes;
    t.scale = log_number(random, 0.08, 1.5);
  } else if (kind < 0.75) {
    t.kind = Kind::kPatches;
    t.scale = log_number(random, 0.4, 3.0);
  } else if (kind < 0.9) {
    t = draw_leaf_texture(random);
  }
  return t;
}

CropTexture draw_leaf_texture(Sequence* random) {
  CropTexture t;
  t.kind = CropTexture::Kind::kLeaves;
  t.seed = random->bits();
  t.contrast = number(random, 0.4, 1.0);
  t.a = Color(number(random, 0.03, 0.12), number(random, 0.05, 0.14), number(random, 0.01, 0.05));
  if (random->chance(0.15)) t.a = Color(0.16f, number(random, 0.05, 0.12), 0.03f);  // autumn
  return t;
}

}  // namespace camber
