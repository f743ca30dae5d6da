#include "camber/synth/detail/car_textures.h"

#include <cmath>

namespace camber {

Surface car_surface(const SynthObject& object, const Eigen::Vector3f& at,
                    const Eigen::Vector3f& normal, float w, bool lamps) {
  Surface out;
  const float length = object.extent[0], height = object.extent[2];
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
      if (lamps) out.emission = front ? Color(2.4f, 2.3f, 2.0f) : Color(1.5f, 0.06f, 0.04f);
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
    case SurfaceKind::kCarRim:
      out.albedo = Color(0.34f, 0.34f, 0.35f);
      out.mirror = 0.06f;
      break;
    default:
      break;
  }
  return out;
}

}  // namespace camber
