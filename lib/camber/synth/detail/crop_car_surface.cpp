#include <algorithm>
#include <cmath>

#include "camber/synth/detail/crop_car.h"

namespace camber {
namespace {

constexpr float kPi = 3.14159265f;

/// x in (low, high), smooth over a sample of width w.
float band(float x, float low, float high, float w) {
  return strip_cover(x - 0.5f * (low + high), 0.5f * (high - low), w);
}

void blend(const CropSurface& over, float share, CropSurface* out) {
  if (share <= 0.0f) return;
  out->albedo = mix(out->albedo, over.albedo, share);
  out->emission = mix(out->emission, over.emission, share);
  out->mirror += share * (over.mirror - out->mirror);
  out->roughness += share * (over.roughness - out->roughness);
  out->clear += share * (over.clear - out->clear);
}

/// One place of a body with what all its parts need.
struct Place {
  const CropCarPlaces& c;
  const CropCarLook& l;
  const Eigen::Vector3f &at, &normal;
  float w;
};

CropSurface paint_at(const Place& p, const Color& color) {
  CropSurface s;
  s.albedo = color;
  s.mirror = p.l.clear_coat;
  return s;
}

CropSurface plastic(const Place& p) {
  CropSurface s;
  s.albedo = p.l.trim;
  s.mirror = 0.02f;
  s.roughness = 0.25f;
  return s;
}

CropSurface chrome() {
  CropSurface s;
  s.albedo = Color::Constant(0.1f);
  s.mirror = 0.55f;
  return s;
}

CropSurface glass_at(float clear) {
  CropSurface s;
  s.albedo = Color::Constant(0.006f);
  s.mirror = 0.07f;
  s.clear = clear;
  return s;
}

CropSurface plate_at(const Place& p, float low, float along, bool rear) {
  CropSurface s;
  s.albedo =
      rear && p.l.yellow_rear_plate ? Color(0.70f, 0.50f, 0.04f) : Color(0.68f, 0.68f, 0.66f);
  s.mirror = 0.03f;
  s.roughness = 0.2f;
  const float phase = wrap(along, 0.062f) - 0.031f;
  const auto glyph = static_cast<std::int32_t>(std::floor(along / 0.062f));
  if (hash_unit(glyph, 3, p.l.seed) < 0.8f) {
    const float inside = band(p.at.y(), low + 0.02f, low + 0.09f, p.w);
    s.albedo =
        mix(s.albedo, Color::Constant(0.03f), 0.7f * inside * strip_cover(phase, 0.018f, p.w));
  }
  if (p.l.blue_band) {
    s.albedo = mix(s.albedo, Color(0.02f, 0.06f, 0.4f), band(along, -0.27f, -0.23f, p.w));
  }
  return s;
}

CropSurface headlight(const Place& p, float t, float s) {
  CropSurface lamp;
  // Reflectors behind clear glass: bright and dark spots.
  const float spot = gradient_noise({9.0f * s, 5.0f * t}, p.l.seed + 5);
  lamp.albedo = Color::Constant(0.30f + 0.35f * spot);
  lamp.mirror = 0.14f;
  if (p.l.lamps) lamp.emission = Color(2.6f, 2.5f, 2.2f) * (0.5f + spot);
  return lamp;
}

bool bumpers_differ(const Place& p) { return p.l.two_tone || !p.l.painted_bumpers; }

/// What bumpers are of where they differ from the body.
CropSurface bumper_at(const Place& p) {
  return p.l.two_tone ? paint_at(p, p.l.bumper) : plastic(p);
}

/// A lamp or reflector that is not lit.
CropSurface red_glass(float red) {
  CropSurface s;
  s.albedo = Color(red, 0.012f, 0.014f);
  s.mirror = 0.06f;
  return s;
}

CropSurface tail_light(const Place& p, float t) {
  CropSurface lamp;
  const bool amber = hash_unit(1, 8, p.l.seed) < 0.4f && t > 0.80f;
  const bool white = hash_unit(2, 8, p.l.seed) < 0.5f && t < 0.62f && t > 0.52f;
  lamp.albedo = amber   ? Color(0.55f, 0.16f, 0.01f)
                : white ? Color(0.45f, 0.42f, 0.42f)
                        : Color(0.34f, 0.012f, 0.014f);
  lamp.mirror = 0.08f;
  const float phase = wrap(t, 0.25f);  // of the height, from one red strip to the next
  if (p.l.clear_tails && (phase < 0.08f || phase > 0.18f)) {
    const float spot = gradient_noise({11.0f * p.at.z(), 9.0f * p.at.y()}, p.l.seed + 6);
    lamp.albedo = Color::Constant(0.25f + 0.3f * spot);
    lamp.mirror = 0.12f;
  }
  if (p.l.brakes && !white) lamp.emission = Color(2.2f, 0.10f, 0.06f);
  if (p.l.indicator && amber) lamp.emission = Color(2.0f, 0.9f, 0.05f);
  return lamp;
}

/// Nose: lamps, grille, intake, plate and bumper, by height and distance from the middle.
void nose(const Place& p, CropSurface* out) {
  const CropCarParts& k = p.l.parts;
  const float low = p.c.front_bumper.y(), span = p.c.headlight.y() - low;
  const float t = (p.at.y() - low) / span, s = std::fabs(p.at.z()) / p.c.half_width;
  const float wt = p.w / span, ws = p.w / p.c.half_width;
  if (bumpers_differ(p)) blend(bumper_at(p), band(t, -1.0f, k.bumper_high, wt), out);
  blend(plastic(p), band(t, -1.0f, k.intake_high, wt) * band(s, -1.0f, k.intake_width, ws), out);
  CropSurface grille = plastic(p);
  if (k.grille_bars > 0.0f) {
    const float bar = strip_cover(wrap(p.at.y(), k.grille_bars) - 0.5f * k.grille_bars,
                                  0.22f * k.grille_bars, p.w);
    if (p.l.chrome) {
      blend(chrome(), 0.8f * bar, &grille);
    } else {
      grille.albedo = mix(grille.albedo, Color::Constant(0.09f), bar);
    }
  }
  const float in_grille =
      band(t, k.grille_low, k.grille_high, wt) * band(s, -1.0f, k.grille_width, ws);
  if (p.l.chrome) {
    blend(chrome(),
          band(t, k.grille_low - 0.04f, k.grille_high + 0.03f, wt) *
              band(s, -1.0f, k.grille_width + 0.03f, ws),
          out);
  }
  blend(grille, in_grille, out);
  blend(headlight(p, t, s),
        band(t, 1.0f - k.headlight_height, 1.03f, wt) * band(s, k.headlight_inner, 2.0f, ws), out);
  const float fog = 0.5f * k.intake_high;
  blend(headlight(p, t, s),
        0.7f * band(t, fog - 0.05f, fog + 0.09f, wt) * band(s, 0.68f, 0.80f, ws) *
            (p.l.chrome ? 1.0f : 0.6f),
        out);
  const float badge = std::hypot(p.at.z(), p.at.y() - low - span * (k.grille_high - 0.08f));
  blend(chrome(), below_edge(badge - 0.05f, p.w), out);
  if (p.l.front_plate) {
    const float bottom = low + span * k.front_plate_low;
    blend(plate_at(p, bottom, p.at.z(), false),
          band(p.at.y(), bottom, bottom + 0.11f, p.w) * strip_cover(p.at.z(), 0.26f, p.w), out);
  }
}

void tail(const Place& p, CropSurface* out) {
  const CropCarParts& k = p.l.parts;
  const float low = p.c.rear_bumper.y(), span = p.c.boot.y() - low;
  const float t = (p.at.y() - low) / span, s = std::fabs(p.at.z()) / p.c.half_width;
  const float wt = p.w / span, ws = p.w / p.c.half_width;
  // The gap around the lid, and the bumper below it.
  CropSurface gap = plastic(p);
  gap.albedo = Color::Constant(0.01f);
  blend(gap,
        strip_cover(p.at.y() - low - span * k.bumper_high, k.gap_half, p.w) *
            band(s, -1.0f, k.tail_inner, ws),
        out);
  if (bumpers_differ(p)) {
    blend(bumper_at(p), band(t, -1.0f, k.bumper_high, wt), out);
  } else {
    blend(plastic(p), band(t, -1.0f, 0.10f, wt), out);
    if (k.strip_half > 0.0f)
      blend(plastic(p), strip_cover(t - 0.7f * k.bumper_high, 0.05f, wt), out);
  }
  float lamps = 0.0f;
  if (k.tail_round == 0.0f) {
    lamps = band(t, k.tail_low, 1.02f, wt) * band(s, k.tail_inner, 2.0f, ws);
  } else {  // two a side, one above the other
    const float side = std::fabs(p.at.z()) - p.c.half_width + 1.4f * k.tail_round;
    for (const float row : {0.0f, 2.2f}) {
      const float up = p.at.y() - p.c.boot.y() + (1.2f + row) * k.tail_round;
      lamps = std::max(lamps, below_edge(std::hypot(side, up) - k.tail_round, p.w));
    }
  }
  blend(tail_light(p, t), lamps, out);
  if (k.reflector > 0.0f) {
    blend(red_glass(0.30f),
          strip_cover(p.at.y() - low - 0.6f * k.bumper_high * span, k.reflector, p.w) *
              band(s, 0.58f, 0.84f, ws),
          out);
  }
  if (p.l.chrome) {
    blend(chrome(),
          strip_cover(t - std::min(0.97f, k.rear_plate_low + 0.28f), 0.025f, wt) *
              band(s, -1.0f, 0.4f, ws),
          out);
  }
  if (p.l.rear_plate) {
    const float bottom = low + span * k.rear_plate_low;
    blend(plate_at(p, bottom, -p.at.z(), true),
          band(p.at.y(), bottom, bottom + 0.11f, p.w) * strip_cover(p.at.z(), 0.26f, p.w), out);
  }
}

/// Doors, mouldings, plastic and the lamps that reach round the corners.
void flank(const Place& p, CropSurface* out) {
  const CropCarParts& k = p.l.parts;
  const CropCarPlaces& c = p.c;
  const float x = p.at.x(), y = p.at.y();
  const float cabin = c.cowl.x() - c.rear_axle;
  if (y > 0.2f * c.height) {
    float gap = 0.0f;
    const float edges[3] = {c.cowl.x() - 0.05f, c.rear_axle + (k.pillar_b_at - 0.02f) * cabin,
                            c.rear_axle + 0.30f};
    for (int i = 0; i < 3; ++i) gap = std::max(gap, strip_cover(x - edges[i], k.gap_half, p.w));
    for (int i = 1; i < 3; ++i) {
      gap = std::max(gap, 0.8f * rectangle_cover(x - edges[i] - 0.12f, y - c.cowl.y() + 0.11f,
                                                 0.09f, 0.014f, p.w));
    }
    out->albedo = mix(out->albedo, Color::Constant(0.012f), gap);
  }
  if (k.strip_half > 0.0f) blend(plastic(p), strip_cover(y - k.strip_y, k.strip_half, p.w), out);
  blend(plastic(p), below_edge(y - k.cladding_y, p.w), out);
  if (k.arch_cladding > 0.0f) {
    for (const float axle : {c.front_axle, c.rear_axle}) {
      const float r = std::hypot(x - axle, y - c.wheel_y);
      blend(plastic(p), below_edge(r - c.arch_radius - k.arch_cladding, p.w), out);
    }
  }
  if (bumpers_differ(p)) {
    const float front = c.front_bumper.y() + k.bumper_high * (c.headlight.y() - c.front_bumper.y());
    const float rear = c.rear_bumper.y() + k.bumper_high * (c.boot.y() - c.rear_bumper.y());
    const CropSurface bumper = bumper_at(p);
    if (x > c.front_axle + c.arch_radius) blend(bumper, below_edge(y - front, p.w), out);
    if (x < c.rear_axle - c.arch_radius) blend(bumper, below_edge(y - rear, p.w), out);
  }
  const float nose_span = c.headlight.y() - c.front_bumper.y();
  blend(headlight(p, 0.9f, 0.9f),
        band(x, c.headlight.x() - k.headlight_wrap, 9.0f, p.w) *
            band(y, c.headlight.y() - k.headlight_height * nose_span, c.headlight.y() + 0.03f, p.w),
        out);
  const float tail_span = c.boot.y() - c.rear_bumper.y();
  const float t = (y - c.rear_bumper.y()) / tail_span;
  if (k.tail_round == 0.0f) {
    blend(
        tail_light(p, t),
        band(x, -9.0f, c.boot.x() + k.tail_wrap, p.w) * band(t, k.tail_low, 1.02f, p.w / tail_span),
        out);
  }
}

float lerp(float a, float b, float t) { return a + t * (b - a); }

/// Above the belt line: side windows with pillars, windscreen, rear window, roof.
void greenhouse(const Place& p, CropSurface* out) {
  const CropCarParts& k = p.l.parts;
  const CropCarPlaces& c = p.c;
  const float x = p.at.x(), y = p.at.y(), z = std::fabs(p.at.z());
  const float front_t = clamp01((y - c.cowl.y()) / (c.roof_front.y() - c.cowl.y()));
  const float rear_t = clamp01((y - c.rear_window.y()) / (c.roof_rear.y() - c.rear_window.y()));
  const float front_x = lerp(c.cowl.x(), c.roof_front.x(), front_t);
  const float rear_x = lerp(c.rear_window.x(), c.roof_rear.x(), rear_t);
  const float height = c.roof_front.y() - c.cowl.y();
  const float wt = p.w / height;
  if (std::fabs(p.normal.z()) > 0.55f) {
    const float along = (x - rear_x) / std::max(0.3f, front_x - rear_x);
    const float t = lerp(rear_t, front_t, clamp01(along));
    const float low = k.window_low + k.window_slope * (1.0f - clamp01(along));
    const float open = band(t, low, k.window_high, wt);
    const float length = front_x - rear_x;
    if (p.l.dark_pillars) {
      CropSurface dark = plastic(p);
      dark.mirror = 0.04f;
      blend(dark, open * band(x, rear_x + 0.4f * k.pillar_d, front_x - k.pillar_a, p.w), out);
    }
    float glass = open * band(x, rear_x + k.pillar_d, front_x - k.pillar_a, p.w);
    glass *= 1.0f - strip_cover(x - rear_x - k.pillar_b_at * length, 0.5f * k.pillar_b, p.w);
    glass *= 1.0f - strip_cover(x - rear_x - k.pillar_c_at * length, 0.5f * k.pillar_c, p.w);
    const bool behind = along < k.pillar_b_at;
    if (p.l.panel_sides && behind) glass = 0.0f;
    blend(glass_at(behind ? p.l.clear * (1.0f - p.l.tint) : p.l.clear), glass, out);
    if (p.l.chrome)
      blend(chrome(),
            strip_cover(t - low, 0.012f / height, wt) * band(x, rear_x + 0.1f, front_x, p.w), out);
    return;
  }
  const bool windscreen = p.normal.x() > 0.15f && x > c.roof_front.x() - 0.05f;
  const bool rear = p.normal.x() < -0.15f && x < c.roof_rear.x() + 0.05f;
  if (windscreen) {
    const float half = lerp(c.cowl.z(), c.roof_front.z(), front_t) - 0.5f * k.pillar_a;
    blend(glass_at(p.l.clear), band(front_t, 0.02f, 0.95f, wt) * band(z, -1.0f, half, p.w), out);
  } else if (rear) {
    const float half = lerp(c.rear_window.z(), c.roof_rear.z(), rear_t);
    const float span = std::max(0.05f, c.roof_rear.y() - c.rear_window.y());
    if (!p.l.rear_blind) {
      blend(glass_at(p.l.clear * (1.0f - p.l.tint)),
            band(rear_t, k.rear_window_low, k.rear_window_high, p.w / span) *
                band(z, -1.0f, k.rear_window_width * half, p.w),
            out);
    }
    if (k.tail_pillar > 0.0f) {
      blend(tail_light(p, 0.9f),
            band(z, half - k.tail_pillar, 2.0f, p.w) *
                band(rear_t, k.pillar_lamp_low, k.pillar_lamp_high, p.w / span),
            out);
    }
    if (k.third_lamp > 0.0f) {
      CropSurface lamp = red_glass(0.25f);
      if (p.l.brakes) lamp.emission = Color(2.2f, 0.25f, 0.06f);
      blend(
          lamp,
          strip_cover(z, k.third_lamp, p.w) * strip_cover(y - c.roof_rear.y() + 0.05f, 0.018f, p.w),
          out);
    }
    if (k.wiper > 0.0f && !p.l.rear_blind) {
      CropSurface blade;
      blade.albedo = Color::Constant(0.01f);
      const float foot = y - c.rear_window.y() - span * k.rear_window_low;
      const float side = hash_unit(4, 4, p.l.seed) < 0.5f ? p.at.z() : -p.at.z();
      blend(blade,
            strip_cover(foot - 0.02f - 0.25f * side, 0.012f, p.w) * band(side, 0.0f, k.wiper, p.w),
            out);
    }
  } else if (y > c.roof_front.y() - 0.12f) {
    CropSurface roof = paint_at(p, p.l.roof);
    blend(roof, 1.0f, out);
    if (p.l.roof_glass) {
      blend(glass_at(0.0f),
            band(x, lerp(c.roof_rear.x(), c.roof_front.x(), 0.35f), c.roof_front.x() - 0.12f, p.w) *
                band(z, -1.0f, c.roof_front.z() - 0.12f, p.w),
            out);
    }
  }
}

/// Height of the belt line above the wheels' plane at x.
float belt_at(const CropCarPlaces& c, float x) {
  const Eigen::Vector3f* const line[4] = {&c.boot, &c.rear_window, &c.cowl, &c.headlight};
  int i = 0;
  while (i < 2 && x > line[i + 1]->x()) ++i;
  const float span = std::max(1e-3f, line[i + 1]->x() - line[i]->x());
  return lerp(line[i]->y(), line[i + 1]->y(), clamp01((x - line[i]->x()) / span));
}

CropSurface wheel(const Place& p, std::uint8_t material) {
  const CropCarParts& k = p.l.parts;
  CropSurface s;
  s.albedo = Color::Constant(0.016f + 0.03f * p.l.dirt);
  s.roughness = 0.5f;
  if (std::fabs(p.normal.z()) < 0.5f &&
      material != static_cast<std::uint8_t>(CropCarMaterial::kRim))
    return s;
  const float axle = std::fabs(p.at.x() - p.c.front_axle) < std::fabs(p.at.x() - p.c.rear_axle)
                         ? p.c.front_axle
                         : p.c.rear_axle;
  const float dx = p.at.x() - axle, dy = p.at.y() - p.c.wheel_y;
  const float r = std::hypot(dx, dy), rim = k.rim_share * p.c.wheel_radius;
  CropSurface metal;
  metal.albedo = p.l.rim;
  metal.mirror = 0.12f;
  metal.roughness = 0.15f;
  // Spokes at the same angles on all wheels: at this size nobody sees a difference.
  const float turn = static_cast<float>(k.spokes) / (2.0f * kPi);
  const float phase = wrap((std::atan2(dy, dx) + 7.0f) * turn, 1.0f) - 0.5f;
  const float around = std::max(r, 0.02f) / turn;
  float solid = strip_cover(phase * around, 0.5f * k.spoke_share * around, p.w);
  solid = std::max(solid, below_edge(r - 0.3f * rim, p.w));
  solid = std::max(solid, band(r, 0.88f * rim, rim, p.w));
  CropSurface face;
  face.albedo = Color::Constant(0.02f);
  blend(metal, solid, &face);
  blend(face, below_edge(r - rim, p.w), &s);
  return s;
}

CropSurface body(const Place& p) {
  CropSurface out = paint_at(p, p.l.paint);
  const bool above = p.at.y() > belt_at(p.c, p.at.x()) + 0.005f;
  const bool cabin = p.at.x() > p.c.rear_window.x() - 0.12f && p.at.x() < p.c.cowl.x() + 0.12f;
  if (above && cabin) {
    greenhouse(p, &out);
  } else if (std::fabs(p.normal.z()) > 0.75f) {
    flank(p, &out);
  } else if (p.normal.x() > 0.35f && p.at.x() > p.c.front_axle) {
    nose(p, &out);
  } else if (p.normal.x() < -0.35f && p.at.x() < p.c.rear_axle) {
    tail(p, &out);
  }
  return out;
}

}  // namespace

CropSurface crop_car_surface(const CropCarPlaces& places, const CropCarLook& look,
                             std::uint8_t material, const Eigen::Vector3f& at,
                             const Eigen::Vector3f& normal, float width) {
  const Place p{places, look, at, normal, width};
  CropSurface out;
  switch (static_cast<CropCarMaterial>(material)) {
    case CropCarMaterial::kTyre:
    case CropCarMaterial::kRim:
      out = wheel(p, material);
      break;
    case CropCarMaterial::kUnderside: {
      const bool end =
          std::fabs(normal.x()) > 0.35f && (at.x() > places.front_axle + places.wheel_radius ||
                                            at.x() < places.rear_axle - places.wheel_radius);
      const bool inside = std::fabs(at.z()) < places.half_width - 0.25f;
      if (end && at.y() > std::min(places.front_bumper.y(), places.rear_bumper.y())) {
        out = body(p);
      } else if (look.painted_sills && !inside && at.y() > 0.6f * places.wheel_radius) {
        out = paint_at(p, look.paint);
      } else {
        out = plastic(p);
      }
      break;
    }
    case CropCarMaterial::kHousing:
      out = look.painted_bumpers ? paint_at(p, look.paint) : plastic(p);
      break;
    case CropCarMaterial::kMirror:
      out = chrome();
      break;
    case CropCarMaterial::kRail:
      out = look.chrome ? chrome() : plastic(p);
      break;
    case CropCarMaterial::kBox:
      out = paint_at(
          p, hash_unit(3, 3, look.seed) < 0.5f ? Color::Constant(0.02f) : Color::Constant(0.35f));
      break;
    case CropCarMaterial::kCabin:
      out = plastic(p);
      out.albedo = 2.0f * look.interior;
      break;
    default:
      out = body(p);
  }
  if (look.dirt > 0.0f) {
    const float low = 1.0f - smooth_step(0.15f * places.height, 0.55f * places.height, at.y());
    const float patchy =
        0.6f + gradient_noise({3.0f * at.x(), 3.0f * (at.y() + at.z())}, look.seed);
    out.albedo = mix(out.albedo, Color(0.13f, 0.11f, 0.09f), clamp01(look.dirt * low * patchy));
    out.mirror *= 1.0f - clamp01(look.dirt * low * patchy);
  }
  return out;
}

}  // namespace camber
