#pragma once

#include <cstddef>
#include <cstdint>

namespace camber::plane_kernels {

// Inner loops over plain float arrays. The sums are kept in kLanes lanes and added in lane order,
// so that they do not depend on the vector width that the machine offers.

inline constexpr std::size_t kLanes = 8;
/// Points that one call of accumulate() or mark_inliers() may take, so that float sums stay exact
/// to about 1e-6.
inline constexpr std::size_t kBlock = 1024;

/// Rounds up to a multiple of kLanes.
constexpr std::size_t padded(std::size_t n) { return (n + kLanes - 1) / kLanes * kLanes; }

/// Points, m, with a weight each: 1 / variance along the plane's normal, or 0 for a row that is to
/// be skipped. n is a multiple of kLanes (callers pad with zero weights); coordinates are finite.
struct Rows {
  const float *x, *y, *z, *w;
  std::size_t n;
};

/// Points of a cloud as they lie in memory, m: x[stride i] and so on. Any n; not all need be
/// finite.
struct StridedPoints {
  const float *x, *y, *z;
  std::size_t stride;  ///< in floats
  std::size_t n;
};

/// Plane nx x + ny y + nz z + d = 0 with a unit normal.
struct FloatPlane {
  float nx, ny, nz, d;
};

/// MSAC cost: sum of min(r^2 w, limit). Stops early, with a partial sum above it, once `bound` is
/// exceeded. Torr and Zisserman, "MLESAC", CVIU 2000.
float msac_cost(Rows rows, const FloatPlane& plane, float limit, float bound);

/// The same for points seen along rays: w = (s / sigma)^2 for range s, floor2 = (e s)^2, and the
/// variance along the normal is (sigma / s)^2 (view2 + floor2), where view2 is the squared distance
/// of the viewpoint from the plane: sigma is stretched along the ray, which the plane meets at the
/// grazing angle asin(distance / s), and e s / s is the least share of it that counts.
/// @param floor2  rows.n values
float msac_cost_rays(Rows rows, const float* floor2, const FloatPlane& plane, float view2,
                     float limit, float bound);

/// Part of a plane in the coordinates u = a . p + a0, v = b . p + b0. A point counts with
/// min(1, (half_u - |u|) / ramp_u) times the same in v, and not at all where that is negative.
struct Window {
  float ax, ay, az, a0;
  float bx, by, bz, b0;
  float half_u, half_v, ramp_u, ramp_v;
};

/// What points are held against.
struct Target {
  FloatPlane plane;
  Window window;
  float limit;                ///< of the loss: t = r^2 w / limit
  float inlier_limit = 0.0f;  ///< an inlier has r^2 w <= inlier_limit
};

/// Sums of the normal equations of "residual = alpha u + beta v + gamma" inside a window, with
/// t = r^2 w / limit:
///   kReweighted  weights omega = w (1 - t)^2 for t < 1, Tukey's biweight;
///   kNewton      the influence psi = omega r has also a part of the other sign, for t in (1, 4):
///                omega = -w (2 / 27) (t - 1) (4 - t), so that the integral of psi over r > 0
///                vanishes. An even background on one side of the plane alone (the sides of a car,
///                a facade, the next plane behind a crease) then has no influence. The matrix is
///                that of Newton's step, the derivative of psi (of the part t < 1).
enum class Loss { kReweighted, kNewton };

struct Moments {
  double weight = 0, u = 0, v = 0, uu = 0, uv = 0, vv = 0;   ///< matrix
  double r = 0, ru = 0, rv = 0;                              ///< sums of psi {1, u, v}
  double count = 0;                                          ///< window's share of points, t < 1
  double i1 = 0, iu = 0, iv = 0, iuu = 0, iuv = 0, ivv = 0;  ///< sums of psi^2 {1, u, ...}
  double squares = 0;                                        ///< of the inliers, m^2
  double inliers = 0;                                        ///< w > 0 and r^2 w <= inlier_limit

  Moments& operator+=(const Moments& other);
};

/// Adds the sums of at most kBlock points; the psi^2 sums only if asked for.
void accumulate(Rows rows, const Target& target, Loss loss, bool influence, Moments* moments);

/// The same with kNewton, and the inliers of the whole plane, window or not, into the last two
/// sums. Where mask is not null, mask[i] becomes -1 for an inlier, else 0. Where ahead is not null,
/// 3 n floats from there are fetched into the cache: the points that come next.
void accumulate_and_mark(Rows rows, const Target& target, std::int32_t* mask, const float* ahead,
                         Moments* moments);

/// The same straight from a cloud whose usable points all have one weight, at most kBlock of them:
/// points less a pivot; rows that are not finite or farther than 1e15 m do not count. Where list is
/// not null it gets first + i of every inlier, ascending, and has room for n + kLanes entries.
/// @return  number of inliers
std::size_t accumulate_and_list(StridedPoints points, const float pivot[3], float weight,
                                const Target& target, int first, int* list, Moments* moments);

/// Residuals in standard deviations, r sqrt(w), or 1e30 for rows without a weight, and the window's
/// coordinates.
void project(Rows rows, const FloatPlane& plane, const Window& window, float* normalised, float* u,
             float* v);

/// How a piece of a cloud lies on a plane; inliers have r^2 w < limit.
struct PieceStatistics {
  float cost = 0;  ///< MSAC cost, sum of min(r^2 w, limit)
  float inliers = 0;
  float weight = 0;  ///< sum of the inliers' w
  /// Sum of the inliers' r w; over sqrt(weight) it is standard normal on a plane.
  float gradient = 0;
};
PieceStatistics piece_statistics(Rows rows, const FloatPlane& plane, float limit);

/// How the squares t = r^2 w of points on a plane change along a window's axes: sums over the rows
/// with t < limit, each with its share of the window (its taper).
struct SpreadSums {
  struct Axis {
    double one = 0, x = 0, xx = 0, xxx = 0, xxxx = 0;  ///< of share {1, place, ...}
    double v = 0, vx = 0, vxx = 0;                     ///< of share t {1, place, ...}
  };
  Axis u, v;
  double weight = 0;  ///< of share w
};
SpreadSums spread_along(Rows rows, const FloatPlane& plane, const Window& window, float limit);

/// Where load_points() writes.
struct RowColumns {
  float *x, *y, *z, *w;
};

/// Copies points, subtracting a pivot; rows that are not finite or farther than 1e15 m become 0 0 0
/// and get weight 0, the others the given weight.
void load_points(StridedPoints points, const float pivot[3], float weight, RowColumns out);

}  // namespace camber::plane_kernels
