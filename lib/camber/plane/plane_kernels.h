#pragma once

#include <cstddef>
#include <cstdint>

namespace camber::plane_kernels {

// Inner loops over four plain float arrays: x, y, z and a weight, which is 1 / variance along the
// plane's normal, or 0 for a row that is to be skipped. Lengths are multiples of kLanes (callers
// pad with zero weights) and coordinates are finite. The sums are kept in kLanes lanes and added
// in lane order, so that they do not depend on the vector width that the machine offers.

inline constexpr std::size_t kLanes = 8;
/// Points that one call of accumulate() or mark_inliers() may take, so that float sums stay exact
/// to about 1e-6.
inline constexpr std::size_t kBlock = 1024;

/// Rounds up to a multiple of kLanes.
constexpr std::size_t padded(std::size_t n) { return (n + kLanes - 1) / kLanes * kLanes; }

/// Plane nx x + ny y + nz z + d = 0 with a unit normal.
struct FloatPlane {
  float nx, ny, nz, d;
};

/// MSAC cost: sum of min(r^2 w, limit). Stops early, with a partial sum above it, once `bound` is
/// exceeded. Torr and Zisserman, "MLESAC", CVIU 2000.
float msac_cost(const float* x, const float* y, const float* z, const float* w, std::size_t n,
                const FloatPlane& plane, float limit, float bound);

/// The same for points seen along rays: w = (s / sigma)^2 for range s, floor2 = (e s)^2, and the
/// variance along the normal is (sigma / s)^2 (view2 + floor2), where view2 is the squared distance
/// of the viewpoint from the plane: sigma is stretched along the ray, which the plane meets at the
/// grazing angle asin(distance / s), and e s / s is the least share of it that counts.
float msac_cost_rays(const float* x, const float* y, const float* z, const float* w,
                     const float* floor2, std::size_t n, const FloatPlane& plane, float view2,
                     float limit, float bound);

/// Part of a plane in the coordinates u = a . p + a0, v = b . p + b0, |u| <= half_u, |v| <= half_v.
struct Window {
  float ax, ay, az, a0;
  float bx, by, bz, b0;
  float half_u, half_v;
};

/// Sums of the normal equations of "residual = alpha u + beta v + gamma" under Tukey's biweight
/// omega = w (1 - r^2 w / limit)^2 inside the window. The influence sums are those of (omega r)^2.
struct Moments {
  double weight = 0, u = 0, v = 0, uu = 0, uv = 0, vv = 0;
  double r = 0, ru = 0, rv = 0;
  double slope = 0;  ///< sum of the derivative of omega r, which Newton's step takes
  double count = 0;  ///< points with a positive omega
  double i1 = 0, iu = 0, iv = 0, iuu = 0, iuv = 0, ivv = 0;

  Moments& operator+=(const Moments& other);
};

/// Adds the sums of n <= kBlock points; the influence sums only if asked for.
void accumulate(const float* x, const float* y, const float* z, const float* w, std::size_t n,
                const FloatPlane& plane, const Window& window, float limit, bool influence,
                Moments* moments);

/// Sets mask[i] to -1 where w > 0 and r^2 w <= limit, else 0; adds the inliers' r^2 to *squares and
/// returns their number. n <= kBlock.
int mark_inliers(const float* x, const float* y, const float* z, const float* w, std::size_t n,
                 const FloatPlane& plane, float limit, std::int32_t* mask, double* squares);

/// Copies n points with a stride (in floats), subtracting a pivot; rows that are not finite or
/// farther than 1e15 m become 0 0 0 and get weight 0, the others weight 1.
void load_points(const float* x, const float* y, const float* z, std::size_t stride, std::size_t n,
                 const float pivot[3], float* out_x, float* out_y, float* out_z, float* out_w);

}  // namespace camber::plane_kernels
