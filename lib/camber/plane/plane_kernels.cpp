#include "camber/plane/plane_kernels.h"

#include <array>
#include <cmath>
#include <cstring>

#include "camber/core/target_clones.h"

// One clone for machines with AVX2, one for any x86-64, chosen when the program starts; the sums
// also with fused multiplication and addition where the machine has it, so that their last bits
// depend on the type of machine.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define CAMBER_FUSED __attribute__((target("avx2,fma"), noinline))
#include <immintrin.h>
#endif
#define CAMBER_CLONES CAMBER_TARGET_CLONES("avx2")

namespace camber::plane_kernels {
namespace {

using F8 = float __attribute__((vector_size(32)));
using I8 = std::int32_t __attribute__((vector_size(32)));

// Vectors are passed by reference: by value their calling convention would depend on the clone.
__attribute__((always_inline)) inline void load(const float* from, F8& to) {
  std::memcpy(&to, from, sizeof(F8));
}

using D4 = double __attribute__((vector_size(32)));
using F4 = float __attribute__((vector_size(16)));

/// Four of eight lanes, in double precision. @param half  0: the first four
__attribute__((always_inline)) inline void widen(const F8& from, std::size_t half, D4& to) {
  F4 part;
  std::memcpy(&part, reinterpret_cast<const char*>(&from) + half * sizeof(F4), sizeof(F4));
  to = __builtin_convertvector(part, D4);
}

__attribute__((always_inline)) inline double lane_sum(const D4& lanes) {
  return (lanes[0] + lanes[2]) + (lanes[1] + lanes[3]);
}

/// In pairs, so that few additions wait for each other.
__attribute__((always_inline)) inline double lane_sum(const F8& lanes) {
  D4 first, second;
  widen(lanes, 0, first);
  widen(lanes, 1, second);
  const D4 both = first + second;
  return lane_sum(both);
}

#define CAMBER_INLINE __attribute__((always_inline)) inline

/// Residuals and window coordinates of eight points.
CAMBER_INLINE void project_eight(const F8& x, const F8& y, const F8& z, const FloatPlane& p,
                                 const Window& f, F8& r, F8& u, F8& v) {
  r = p.nx * x + p.ny * y + p.nz * z + p.d;
  u = f.ax * x + f.ay * y + f.az * z + f.a0;
  v = f.bx * x + f.by * y + f.bz * z + f.b0;
}

/// A window's edges, in lengths of their ramps.
struct Ramps {
  float steep_u, steep_v, end_u, end_v;

  explicit Ramps(const Window& window)
      : steep_u(1.0f / window.ramp_u),
        steep_v(1.0f / window.ramp_v),
        end_u(window.half_u * steep_u),
        end_v(window.half_v * steep_v) {}
};

/// The window's taper; also 0 for rows without a weight.
CAMBER_INLINE void taper_eight(const Ramps& ramps, const F8& u, const F8& v, const F8& w,
                               F8& taper) {
  const F8 zero = {};
  const F8 one = zero + 1.0f;
  F8 taper_u = ramps.end_u - ramps.steep_u * (u < zero ? -u : u);
  F8 taper_v = ramps.end_v - ramps.steep_v * (v < zero ? -v : v);
  taper_u = taper_u < one ? taper_u : one;
  taper_u = taper_u > zero ? taper_u : zero;
  taper_v = taper_v < one ? taper_v : one;
  taper_v = taper_v > zero ? taper_v : zero;
  taper = taper_u * taper_v;
  taper = w > zero ? taper : zero;
}

/// Weights of the residual (omega) and of the matrix, see Loss.
template <Loss kLoss>
CAMBER_INLINE void weigh_eight(const F8& t, const F8& weight, F8& omega, F8& matrix) {
  const F8 zero = {};
  const F8 one = zero + 1.0f;
  const I8 core = t < one;
  const F8 rest = one - t;
  if constexpr (kLoss == Loss::kNewton) {
    constexpr float kBalance = 2.0f / 27.0f;
    const F8 lobe = t < 4.0f ? kBalance * rest * (4.0f - t) : zero;
    omega = weight * (core ? rest * rest : lobe);
    matrix = core ? weight * rest * (one - 5.0f * t) : zero;
  } else {
    omega = core ? weight * rest * rest : zero;
    matrix = omega;
  }
}

/// Sums {1, u, v, uu, uv, vv} of a factor, in lanes.
struct QuadraticSums {
  F8 s1 = {}, su = {}, sv = {}, suu = {}, suv = {}, svv = {};

  CAMBER_INLINE void add(const F8& factor, const F8& u, const F8& v) {
    const F8 fu = factor * u, fv = factor * v;
    s1 += factor;
    su += fu;
    sv += fv;
    suu += fu * u;
    suv += fu * v;
    svv += fv * v;
  }
};

/// @tparam kOpen  the window has no edges: every row with a weight is inside
template <Loss kLoss, bool kInfluence, bool kMark, bool kOpen = false>
CAMBER_INLINE void accumulate_block(const Rows& rows, const Target& target, std::int32_t* mask,
                                    const float* ahead, Moments* moments) {
  const F8 zero = {};
  const F8 one = zero + 1.0f;
  const float inverse = 1.0f / target.limit;
  const float near = target.inlier_limit * inverse;
  const Ramps ramps(target.window);
  QuadraticSums matrices, influences;
  F8 sr = zero, sru = zero, srv = zero, count = zero, squares = zero;
  I8 inliers = {};
  for (std::size_t i = 0; i < rows.n; i += kLanes) {
    F8 px, py, pz, pw;
    load(rows.x + i, px);
    load(rows.y + i, py);
    load(rows.z + i, pz);
    load(rows.w + i, pw);
    if constexpr (kMark) {
      if (ahead) {
        __builtin_prefetch(ahead + 3 * i);
        __builtin_prefetch(ahead + 3 * i + 16);
      }
    }
    F8 r, u, v, taper, omega, matrix;
    project_eight(px, py, pz, target.plane, target.window, r, u, v);
    const F8 r2 = r * r;
    const F8 t = r2 * pw * inverse;
    if constexpr (kMark) {
      const I8 inlier = (t <= near) & (pw > 0.0f);
      squares += inlier ? r2 : zero;
      inliers -= inlier;
      if (mask) std::memcpy(mask + i, &inlier, sizeof(inlier));
    }
    if constexpr (kOpen) {
      taper = pw > zero ? one : zero;
    } else {
      taper_eight(ramps, u, v, pw, taper);
    }
    weigh_eight<kLoss>(t, pw * taper, omega, matrix);
    const F8 psi = omega == zero ? zero : omega * r;
    matrices.add(matrix, u, v);
    sr += psi;
    sru += psi * u;
    srv += psi * v;
    count += t < one ? taper : zero;
    if constexpr (kInfluence) influences.add(psi * psi, u, v);
  }
  moments->weight += lane_sum(matrices.s1);
  moments->u += lane_sum(matrices.su);
  moments->v += lane_sum(matrices.sv);
  moments->uu += lane_sum(matrices.suu);
  moments->uv += lane_sum(matrices.suv);
  moments->vv += lane_sum(matrices.svv);
  moments->r += lane_sum(sr);
  moments->ru += lane_sum(sru);
  moments->rv += lane_sum(srv);
  moments->count += lane_sum(count);
  if constexpr (kInfluence) {
    moments->i1 += lane_sum(influences.s1);
    moments->iu += lane_sum(influences.su);
    moments->iv += lane_sum(influences.sv);
    moments->iuu += lane_sum(influences.suu);
    moments->iuv += lane_sum(influences.suv);
    moments->ivv += lane_sum(influences.svv);
  }
  if constexpr (kMark) {
    moments->squares += lane_sum(squares);
    for (std::size_t i = 0; i < kLanes; ++i) moments->inliers += inliers[i];
  }
}

}  // namespace

Moments& Moments::operator+=(const Moments& other) {
  weight += other.weight;
  u += other.u;
  v += other.v;
  uu += other.uu;
  uv += other.uv;
  vv += other.vv;
  r += other.r;
  ru += other.ru;
  rv += other.rv;
  count += other.count;
  i1 += other.i1;
  iu += other.iu;
  iv += other.iv;
  iuu += other.iuu;
  iuv += other.iuv;
  ivv += other.ivv;
  squares += other.squares;
  inliers += other.inliers;
  return *this;
}

CAMBER_CLONES
float msac_cost(Rows rows, const FloatPlane& plane, float limit, float bound) {
  constexpr std::size_t kStep = 256;
  const F8 cap = F8{} + limit;
  double total = 0.0;
  for (std::size_t begin = 0; begin < rows.n; begin += kStep) {
    const std::size_t end = begin + kStep < rows.n ? begin + kStep : rows.n;
    F8 sum = {};
    for (std::size_t i = begin; i < end; i += kLanes) {
      F8 px, py, pz, pw;
      load(rows.x + i, px);
      load(rows.y + i, py);
      load(rows.z + i, pz);
      load(rows.w + i, pw);
      const F8 r = plane.nx * px + plane.ny * py + plane.nz * pz + plane.d;
      const F8 t = r * r * pw;
      sum += t < cap ? t : cap;
    }
    total += lane_sum(sum);
    if (total > static_cast<double>(bound)) break;
  }
  return static_cast<float>(total);
}

CAMBER_CLONES
float msac_cost_rays(Rows rows, const float* floor2, const FloatPlane& plane, float view2,
                     float limit, float bound) {
  constexpr std::size_t kStep = 256;
  const F8 cap = F8{} + limit;
  double total = 0.0;
  for (std::size_t begin = 0; begin < rows.n; begin += kStep) {
    const std::size_t end = begin + kStep < rows.n ? begin + kStep : rows.n;
    F8 sum = {};
    for (std::size_t i = begin; i < end; i += kLanes) {
      F8 px, py, pz, pw, pf;
      load(rows.x + i, px);
      load(rows.y + i, py);
      load(rows.z + i, pz);
      load(rows.w + i, pw);
      load(floor2 + i, pf);
      const F8 r = plane.nx * px + plane.ny * py + plane.nz * pz + plane.d;
      const F8 t = r * r * pw / (view2 + pf);
      sum += t < cap ? t : cap;
    }
    total += lane_sum(sum);
    if (total > static_cast<double>(bound)) break;
  }
  return static_cast<float>(total);
}

namespace {

template <bool kMark>
CAMBER_INLINE void accumulate_any(const Rows& rows, const Target& target, Loss loss, bool influence,
                                  std::int32_t* mask, const float* ahead, Moments* moments) {
  if constexpr (kMark) {
    accumulate_block<Loss::kNewton, false, true>(rows, target, mask, ahead, moments);
  } else if (loss == Loss::kReweighted) {
    // Half a window of 1e15 m: no coordinate that a cloud may have is near its edge.
    if (target.window.half_u > 1e14f && target.window.half_v > 1e14f) {
      accumulate_block<Loss::kReweighted, false, false, true>(rows, target, nullptr, nullptr,
                                                              moments);
    } else {
      accumulate_block<Loss::kReweighted, false, false>(rows, target, nullptr, nullptr, moments);
    }
  } else if (influence) {
    accumulate_block<Loss::kNewton, true, false>(rows, target, nullptr, nullptr, moments);
  } else {
    accumulate_block<Loss::kNewton, false, false>(rows, target, nullptr, nullptr, moments);
  }
}

#ifdef CAMBER_FUSED
template <bool kMark>
CAMBER_FUSED void accumulate_fused(Rows rows, const Target& target, Loss loss, bool influence,
                                   std::int32_t* mask, const float* ahead, Moments* moments) {
  accumulate_any<kMark>(rows, target, loss, influence, mask, ahead, moments);
}

bool can_fuse() {
  static const bool can = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  return can;
}
#endif

}  // namespace

void accumulate(Rows rows, const Target& target, Loss loss, bool influence, Moments* moments) {
#ifdef CAMBER_FUSED
  if (can_fuse()) {
    return accumulate_fused<false>(rows, target, loss, influence, nullptr, nullptr, moments);
  }
#endif
  accumulate_any<false>(rows, target, loss, influence, nullptr, nullptr, moments);
}

void accumulate_and_mark(Rows rows, const Target& target, std::int32_t* mask, const float* ahead,
                         Moments* moments) {
#ifdef CAMBER_FUSED
  if (can_fuse()) {
    return accumulate_fused<true>(rows, target, Loss::kNewton, false, mask, ahead, moments);
  }
#endif
  accumulate_any<true>(rows, target, Loss::kNewton, false, mask, ahead, moments);
}

namespace {

#ifdef CAMBER_FUSED

/// For each set of lanes the numbers of its lanes, ascending.
constexpr std::array<std::array<std::uint8_t, kLanes>, 256> make_lane_lists() {
  std::array<std::array<std::uint8_t, kLanes>, 256> lists{};
  for (std::size_t set = 0; set < lists.size(); ++set) {
    std::size_t filled = 0;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if ((set >> lane) & 1u) lists[set][filled++] = static_cast<std::uint8_t>(lane);
    }
  }
  return lists;
}
alignas(64) constexpr std::array<std::array<std::uint8_t, kLanes>, 256> kLaneLists =
    make_lane_lists();

#define CAMBER_FUSED_PART __attribute__((target("avx2,fma"), always_inline)) inline

/// Scaled so that t is the square of a residual, and u and v so that the tapers' ramps are of
/// length 1.
struct ScaledTarget {
  FloatPlane plane;
  Window window;  ///< but for the ramps, which are 1
  float near;     ///< largest t of an inlier
  float unit;     ///< factor to residuals
};

CAMBER_FUSED_PART ScaledTarget scale_target(const Target& target, float weight) {
  const FloatPlane& p = target.plane;
  const Window& f = target.window;
  const float unit = std::sqrt(weight / target.limit);
  const float steep_u = 1.0f / f.ramp_u, steep_v = 1.0f / f.ramp_v;
  return {{unit * p.nx, unit * p.ny, unit * p.nz, unit * p.d},
          {steep_u * f.ax, steep_u * f.ay, steep_u * f.az, steep_u * f.a0, steep_v * f.bx,
           steep_v * f.by, steep_v * f.bz, steep_v * f.b0, f.half_u * steep_u, f.half_v * steep_v,
           1.0f, 1.0f},
          target.inlier_limit / target.limit,
          unit};
}

/// A block of points as seen from a scaled target. Rows that are not usable have the residual NaN,
/// which compares false with everything.
struct ScaledBlock {
  alignas(32) float residual[kBlock], u[kBlock], v[kBlock];
};

/// Eight points from i on: three vectors of x y z x y z ... become one each of x, y and z.
CAMBER_FUSED_PART void load_triples(const float* from, __m256& px, __m256& py, __m256& pz) {
  const __m256 m03 =
      _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(from)), _mm_loadu_ps(from + 12), 1);
  const __m256 m14 = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(from + 4)),
                                          _mm_loadu_ps(from + 16), 1);
  const __m256 m25 = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(from + 8)),
                                          _mm_loadu_ps(from + 20), 1);
  const __m256 xy = _mm256_shuffle_ps(m14, m25, _MM_SHUFFLE(2, 1, 3, 2));
  const __m256 yz = _mm256_shuffle_ps(m03, m14, _MM_SHUFFLE(1, 0, 2, 1));
  px = _mm256_shuffle_ps(m03, xy, _MM_SHUFFLE(2, 0, 3, 0));
  py = _mm256_shuffle_ps(yz, xy, _MM_SHUFFLE(3, 1, 2, 0));
  pz = _mm256_shuffle_ps(yz, m25, _MM_SHUFFLE(3, 0, 3, 1));
}

/// a x + b y + c z + d.
CAMBER_FUSED_PART __m256 affine(const __m256 (&factors)[4], const __m256& x, const __m256& y,
                                const __m256& z) {
  return _mm256_fmadd_ps(
      factors[0], x, _mm256_fmadd_ps(factors[1], y, _mm256_fmadd_ps(factors[2], z, factors[3])));
}

/// @param points  stride 3, x y z beside one another (kTriples), or 1
template <bool kTriples>
CAMBER_FUSED_PART void project_block(const StridedPoints& points, const float pivot[3],
                                     const ScaledTarget& target, ScaledBlock* block) {
  const FloatPlane& p = target.plane;
  const Window& f = target.window;
  const __m256 ox = _mm256_set1_ps(pivot[0]), oy = _mm256_set1_ps(pivot[1]),
               oz = _mm256_set1_ps(pivot[2]);
  const __m256 to_r[4] = {_mm256_set1_ps(p.nx), _mm256_set1_ps(p.ny), _mm256_set1_ps(p.nz),
                          _mm256_set1_ps(p.d)};
  const __m256 to_u[4] = {_mm256_set1_ps(f.ax), _mm256_set1_ps(f.ay), _mm256_set1_ps(f.az),
                          _mm256_set1_ps(f.a0)};
  const __m256 to_v[4] = {_mm256_set1_ps(f.bx), _mm256_set1_ps(f.by), _mm256_set1_ps(f.bz),
                          _mm256_set1_ps(f.b0)};
  const __m256 far = _mm256_set1_ps(1e15f), sign = _mm256_set1_ps(-0.0f);
  for (std::size_t i = 0; i < points.n; i += kLanes) {
    __m256 px, py, pz;
    if constexpr (kTriples) {
      load_triples(points.x + 3 * i, px, py, pz);
    } else {
      px = _mm256_loadu_ps(points.x + i);
      py = _mm256_loadu_ps(points.y + i);
      pz = _mm256_loadu_ps(points.z + i);
    }
    px = _mm256_sub_ps(px, ox);
    py = _mm256_sub_ps(py, oy);
    pz = _mm256_sub_ps(pz, oz);
    const __m256 away =
        _mm256_add_ps(_mm256_add_ps(_mm256_andnot_ps(sign, px), _mm256_andnot_ps(sign, py)),
                      _mm256_andnot_ps(sign, pz));
    const __m256 useless = _mm256_cmp_ps(away, far, _CMP_NLT_UQ);  // true for NaN
    _mm256_store_ps(block->residual + i, _mm256_or_ps(affine(to_r, px, py, pz), useless));
    _mm256_store_ps(block->u + i, _mm256_andnot_ps(useless, affine(to_u, px, py, pz)));
    _mm256_store_ps(block->v + i, _mm256_andnot_ps(useless, affine(to_v, px, py, pz)));
  }
}

/// Sums of a scaled block, in lanes; the first eleven of Moments, without the influence.
struct ScaledSums {
  __m256 s1, su, sv, suu, suv, svv, r, ru, rv, count, squares;
};

/// Adds eight points: the loss kNewton.
/// @param end_u, end_v  where the tapers end
CAMBER_FUSED_PART void add_eight(const __m256& r, const __m256& u, const __m256& v,
                                 const __m256& end_u, const __m256& end_v, ScaledSums& sums) {
  const __m256 zero = _mm256_setzero_ps(), one = _mm256_set1_ps(1.0f), four = _mm256_set1_ps(4.0f),
               five = _mm256_set1_ps(5.0f), balance = _mm256_set1_ps(2.0f / 27.0f);
  const __m256 sign = _mm256_set1_ps(-0.0f);
  const __m256 t = _mm256_mul_ps(r, r);
  const __m256 core = _mm256_cmp_ps(t, one, _CMP_LT_OQ);
  const __m256 taper_u =
      _mm256_max_ps(_mm256_min_ps(_mm256_sub_ps(end_u, _mm256_andnot_ps(sign, u)), one), zero);
  const __m256 taper_v =
      _mm256_max_ps(_mm256_min_ps(_mm256_sub_ps(end_v, _mm256_andnot_ps(sign, v)), one), zero);
  const __m256 taper = _mm256_mul_ps(taper_u, taper_v);
  const __m256 slack = _mm256_sub_ps(one, t);
  const __m256 lobe = _mm256_mul_ps(balance, _mm256_sub_ps(four, t));
  const __m256 part = _mm256_mul_ps(taper, slack);
  const __m256 psi =
      _mm256_and_ps(_mm256_mul_ps(_mm256_mul_ps(part, _mm256_blendv_ps(lobe, slack, core)), r),
                    _mm256_cmp_ps(t, four, _CMP_LT_OQ));
  const __m256 matrix = _mm256_and_ps(_mm256_mul_ps(part, _mm256_fnmadd_ps(five, t, one)), core);
  const __m256 wu = _mm256_mul_ps(matrix, u), wv = _mm256_mul_ps(matrix, v);
  sums.s1 = _mm256_add_ps(sums.s1, matrix);
  sums.su = _mm256_add_ps(sums.su, wu);
  sums.sv = _mm256_add_ps(sums.sv, wv);
  sums.suu = _mm256_fmadd_ps(wu, u, sums.suu);
  sums.suv = _mm256_fmadd_ps(wu, v, sums.suv);
  sums.svv = _mm256_fmadd_ps(wv, v, sums.svv);
  sums.r = _mm256_add_ps(sums.r, psi);
  sums.ru = _mm256_fmadd_ps(psi, u, sums.ru);
  sums.rv = _mm256_fmadd_ps(psi, v, sums.rv);
  sums.count = _mm256_add_ps(sums.count, _mm256_and_ps(taper, core));
}

/// Adds a block's points to the sums and lists its inliers.
/// @return  number of inliers
template <bool kList>
CAMBER_FUSED_PART std::size_t add_block(const ScaledBlock& block, std::size_t n,
                                        const ScaledTarget& target, int first, int* list,
                                        ScaledSums& sums) {
  const __m256 near = _mm256_set1_ps(target.near);
  const __m256 end_u = _mm256_set1_ps(target.window.half_u),
               end_v = _mm256_set1_ps(target.window.half_v);
  std::size_t inliers = 0;
  for (std::size_t i = 0; i < n; i += kLanes) {
    const __m256 r = _mm256_load_ps(block.residual + i);
    const __m256 t = _mm256_mul_ps(r, r);
    const __m256 inlier = _mm256_cmp_ps(t, near, _CMP_LE_OQ);
    sums.squares = _mm256_add_ps(sums.squares, _mm256_and_ps(inlier, t));
    const auto lanes = static_cast<unsigned>(_mm256_movemask_ps(inlier));
    if constexpr (kList) {
      const __m256i which = _mm256_cvtepu8_epi32(
          _mm_loadl_epi64(reinterpret_cast<const __m128i*>(kLaneLists[lanes].data())));
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(list + inliers),
                          _mm256_add_epi32(which, _mm256_set1_epi32(first + static_cast<int>(i))));
    }
    inliers += static_cast<std::size_t>(__builtin_popcount(lanes));
    add_eight(r, _mm256_load_ps(block.u + i), _mm256_load_ps(block.v + i), end_u, end_v, sums);
  }
  return inliers;
}

/// Adds the sums as they are without the scales.
CAMBER_FUSED_PART void add_unscaled(const ScaledSums& scaled, const Window& window, float weight,
                                    float unit, Moments* moments) {
  float lanes[11][kLanes];
  static_assert(sizeof(lanes) == sizeof(scaled), "a row of lanes for each sum");
  std::memcpy(lanes, &scaled, sizeof(lanes));
  double sums[11] = {};
  for (std::size_t k = 0; k < 11; ++k) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      sums[k] += static_cast<double>(lanes[k][lane]);
    }
  }
  const double w = static_cast<double>(weight), fu = static_cast<double>(window.ramp_u),
               fv = static_cast<double>(window.ramp_v), fr = 1.0 / static_cast<double>(unit);
  moments->weight += w * sums[0];
  moments->u += w * fu * sums[1];
  moments->v += w * fv * sums[2];
  moments->uu += w * fu * fu * sums[3];
  moments->uv += w * fu * fv * sums[4];
  moments->vv += w * fv * fv * sums[5];
  moments->r += w * fr * sums[6];
  moments->ru += w * fr * fu * sums[7];
  moments->rv += w * fr * fv * sums[8];
  moments->count += sums[9];
  moments->squares += fr * fr * sums[10];
}

/// accumulate_and_list in one go from memory to sums, n a multiple of kLanes.
template <bool kTriples, bool kList>
CAMBER_FUSED std::size_t accumulate_and_list_fused(StridedPoints points, const float pivot[3],
                                                   float weight, const Target& target, int first,
                                                   int* list, Moments* moments) {
  const ScaledTarget scaled = scale_target(target, weight);
  ScaledBlock block;
  project_block<kTriples>(points, pivot, scaled, &block);
  ScaledSums sums = {};
  const std::size_t inliers = add_block<kList>(block, points.n, scaled, first, list, sums);
  add_unscaled(sums, target.window, weight, scaled.unit, moments);
  moments->inliers += static_cast<double>(inliers);
  return inliers;
}

#endif

}  // namespace

std::size_t accumulate_and_list(StridedPoints points, const float pivot[3], float weight,
                                const Target& target, int first, int* list, Moments* moments) {
  const std::size_t n = points.n;
#ifdef CAMBER_FUSED
  const bool triples = points.stride == 3 && points.y == points.x + 1 && points.z == points.x + 2;
  if (can_fuse() && (triples || points.stride == 1)) {
    const auto fused = triples ? (list ? accumulate_and_list_fused<true, true>
                                       : accumulate_and_list_fused<true, false>)
                               : (list ? accumulate_and_list_fused<false, true>
                                       : accumulate_and_list_fused<false, false>);
    const std::size_t whole = n / kLanes * kLanes;
    const StridedPoints body = {points.x, points.y, points.z, points.stride, whole};
    std::size_t found = fused(body, pivot, weight, target, first, list, moments);
    if (whole < n) {
      // The last few, and rows that are not usable.
      float rest[3 * kLanes];
      for (float& value : rest) value = __builtin_nanf("");
      const std::size_t step = triples ? 1 : kLanes, each = triples ? 3 : 1;
      for (std::size_t k = 0; whole + k < n; ++k) {
        rest[each * k] = points.x[each * (whole + k)];
        rest[each * k + step] = points.y[each * (whole + k)];
        rest[each * k + 2 * step] = points.z[each * (whole + k)];
      }
      found += fused({rest, rest + step, rest + 2 * step, each, kLanes}, pivot, weight, target,
                     first + static_cast<int>(whole), list ? list + found : nullptr, moments);
    }
    return found;
  }
#endif
  alignas(32) float px[kBlock], py[kBlock], pz[kBlock], pw[kBlock];
  alignas(32) std::int32_t mask[kBlock];
  load_points(points, pivot, weight, {px, py, pz, pw});
  const std::size_t rows = padded(n);
  for (std::size_t k = n; k < rows; ++k) px[k] = py[k] = pz[k] = pw[k] = 0.0f;
  accumulate_and_mark({px, py, pz, pw, rows}, target, mask, nullptr, moments);
  std::size_t inliers = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (list) list[inliers] = first + static_cast<int>(k);
    inliers += mask[k] != 0 ? 1 : 0;
  }
  return inliers;
}

namespace {

/// @param normalised  holds the square roots of w
CAMBER_INLINE void project_any(const Rows& rows, const FloatPlane& plane, const Window& window,
                               float* normalised, float* u, float* v) {
  for (std::size_t i = 0; i < rows.n; i += kLanes) {
    F8 px, py, pz, pw, root = {}, r, along, across;
    load(rows.x + i, px);
    load(rows.y + i, py);
    load(rows.z + i, pz);
    load(rows.w + i, pw);
    load(normalised + i, root);
    project_eight(px, py, pz, plane, window, r, along, across);
    const F8 scaled = pw > 0.0f ? r * root : F8{} + 1e30f;
    std::memcpy(u + i, &along, sizeof(F8));
    std::memcpy(v + i, &across, sizeof(F8));
    std::memcpy(normalised + i, &scaled, sizeof(F8));
  }
}

#ifdef CAMBER_FUSED
CAMBER_FUSED void project_fused(Rows rows, const FloatPlane& plane, const Window& window,
                                float* normalised, float* u, float* v) {
  for (std::size_t i = 0; i < rows.n; i += kLanes) {
    _mm256_storeu_ps(normalised + i, _mm256_sqrt_ps(_mm256_loadu_ps(rows.w + i)));
  }
  project_any(rows, plane, window, normalised, u, v);
}
#endif

}  // namespace

void project(Rows rows, const FloatPlane& plane, const Window& window, float* normalised, float* u,
             float* v) {
#ifdef CAMBER_FUSED
  if (can_fuse()) return project_fused(rows, plane, window, normalised, u, v);
#endif
  for (std::size_t i = 0; i < rows.n; ++i) normalised[i] = std::sqrt(rows.w[i]);
  project_any(rows, plane, window, normalised, u, v);
}

CAMBER_CLONES
PieceStatistics piece_statistics(Rows rows, const FloatPlane& plane, float limit) {
  const F8 zero = {};
  const F8 one = zero + 1.0f, cap = zero + limit;
  F8 cost = zero, inliers = zero, weight = zero, gradient = zero;
  for (std::size_t i = 0; i < rows.n; i += kLanes) {
    F8 px, py, pz, pw;
    load(rows.x + i, px);
    load(rows.y + i, py);
    load(rows.z + i, pz);
    load(rows.w + i, pw);
    const F8 r = plane.nx * px + plane.ny * py + plane.nz * pz + plane.d;
    const F8 rw = r * pw;
    const F8 t = r * rw;
    const I8 inside = (t < cap) & (pw > zero);
    cost += t < cap ? t : cap;
    inliers += inside ? one : zero;
    weight += inside ? pw : zero;
    gradient += inside ? rw : zero;
  }
  return {static_cast<float>(lane_sum(cost)), static_cast<float>(lane_sum(inliers)),
          static_cast<float>(lane_sum(weight)), static_cast<float>(lane_sum(gradient))};
}

namespace {

/// The sums along one axis, in lanes.
struct AxisLanes {
  D4 one = {}, x = {}, xx = {}, xxx = {}, xxxx = {}, v = {}, vx = {}, vxx = {};

  CAMBER_INLINE void add(const D4& share, const D4& square, const D4& place) {
    const D4 first = share * place, second = first * place, varied = share * square;
    one += share;
    x += first;
    xx += second;
    xxx += second * place;
    xxxx += second * place * place;
    v += varied;
    vx += varied * place;
    vxx += varied * place * place;
  }
  CAMBER_INLINE SpreadSums::Axis sums() const {
    return {lane_sum(one),  lane_sum(x), lane_sum(xx), lane_sum(xxx),
            lane_sum(xxxx), lane_sum(v), lane_sum(vx), lane_sum(vxx)};
  }
};

}  // namespace

CAMBER_CLONES
SpreadSums spread_along(Rows rows, const FloatPlane& plane, const Window& window, float limit) {
  const F8 zero = {};
  const F8 cap = zero + limit;
  const Ramps ramps(window);
  AxisLanes along, across;
  D4 weight = {};
  for (std::size_t i = 0; i < rows.n; i += kLanes) {
    F8 px, py, pz, pw, r, u, v, share;
    load(rows.x + i, px);
    load(rows.y + i, py);
    load(rows.z + i, pz);
    load(rows.w + i, pw);
    project_eight(px, py, pz, plane, window, r, u, v);
    taper_eight(ramps, u, v, pw, share);
    F8 t = r * r * pw;
    share = t < cap ? share : zero;
    // Far rows must not become infinite.
    t = share > zero ? t : zero;
    u = share > zero ? u : zero;
    v = share > zero ? v : zero;
    for (std::size_t half = 0; half < 2; ++half) {
      D4 shares, squares, weights, places;
      widen(share, half, shares);
      widen(t, half, squares);
      widen(pw, half, weights);
      weight += shares * weights;
      widen(u, half, places);
      along.add(shares, squares, places);
      widen(v, half, places);
      across.add(shares, squares, places);
    }
  }
  return {along.sums(), across.sums(), lane_sum(weight)};
}

CAMBER_CLONES
void load_points(StridedPoints points, const float pivot[3], float weight, RowColumns out) {
  const float *x = points.x, *y = points.y, *z = points.z;
  const std::size_t stride = points.stride, n = points.n;
  const float px = pivot[0], py = pivot[1], pz = pivot[2];
  constexpr float kFar2 = 1e30f;
  std::size_t i = 0;
  if (stride == 3 && y == x + 1 && z == x + 2) {
    // Eight points at a time: three vectors of x y z x y z ... become one each of x, y and z.
    const F8 zero = {};
    for (; i + kLanes <= n; i += kLanes) {
      F8 a, b, c;
      load(x + 3 * i, a);
      load(x + 3 * i + 8, b);
      load(x + 3 * i + 16, c);
      const F8 x1 = __builtin_shufflevector(a, b, 0, 3, 6, 9, 12, 15, 0, 0);
      const F8 y1 = __builtin_shufflevector(a, b, 1, 4, 7, 10, 13, 0, 0, 0);
      const F8 z1 = __builtin_shufflevector(a, b, 2, 5, 8, 11, 14, 0, 0, 0);
      F8 vx = __builtin_shufflevector(x1, c, 0, 1, 2, 3, 4, 5, 10, 13) - px;
      F8 vy = __builtin_shufflevector(y1, c, 0, 1, 2, 3, 4, 8, 11, 14) - py;
      F8 vz = __builtin_shufflevector(z1, c, 0, 1, 2, 3, 4, 9, 12, 15) - pz;
      const I8 usable = (vx * vx + vy * vy + vz * vz) < kFar2;  // false for NaN
      vx = usable ? vx : zero;
      vy = usable ? vy : zero;
      vz = usable ? vz : zero;
      const F8 vw = usable ? zero + weight : zero;
      std::memcpy(out.x + i, &vx, sizeof(vx));
      std::memcpy(out.y + i, &vy, sizeof(vy));
      std::memcpy(out.z + i, &vz, sizeof(vz));
      std::memcpy(out.w + i, &vw, sizeof(vw));
    }
  }
  for (; i < n; ++i) {
    const float vx = x[stride * i] - px, vy = y[stride * i] - py, vz = z[stride * i] - pz;
    const bool usable = vx * vx + vy * vy + vz * vz < kFar2;
    out.x[i] = usable ? vx : 0.0f;
    out.y[i] = usable ? vy : 0.0f;
    out.z[i] = usable ? vz : 0.0f;
    out.w[i] = usable ? weight : 0.0f;
  }
}

}  // namespace camber::plane_kernels
