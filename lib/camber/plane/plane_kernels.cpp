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

__attribute__((always_inline)) inline double lane_sum(const F8& lanes) {
  double sum = 0.0;
  for (std::size_t i = 0; i < kLanes; ++i) sum += static_cast<double>(lanes[i]);
  return sum;
}

template <Loss kLoss, bool kInfluence, bool kMark>
__attribute__((always_inline)) inline void accumulate_block(const float* x, const float* y,
                                                            const float* z, const float* w,
                                                            std::size_t n, const FloatPlane& plane,
                                                            const Window& window, float limit,
                                                            float inlier_limit, std::int32_t* mask,
                                                            const float* ahead, Moments* moments) {
  const F8 zero = {};
  const F8 one = zero + 1.0f;
  const float inverse = 1.0f / limit;
  const float near = inlier_limit * inverse;
  const float steep_u = 1.0f / window.ramp_u, steep_v = 1.0f / window.ramp_v;
  const float end_u = window.half_u * steep_u, end_v = window.half_v * steep_v;
  F8 s1 = zero, su = zero, sv = zero, suu = zero, suv = zero, svv = zero, sr = zero, sru = zero,
     srv = zero, count = zero;
  F8 i1 = zero, iu = zero, iv = zero, iuu = zero, iuv = zero, ivv = zero, squares = zero;
  I8 inliers = {};
  for (std::size_t i = 0; i < n; i += kLanes) {
    F8 px, py, pz, pw;
    load(x + i, px);
    load(y + i, py);
    load(z + i, pz);
    load(w + i, pw);
    if constexpr (kMark) {
      if (ahead) {
        __builtin_prefetch(ahead + 3 * i);
        __builtin_prefetch(ahead + 3 * i + 16);
      }
    }
    const F8 r = plane.nx * px + plane.ny * py + plane.nz * pz + plane.d;
    const F8 u = window.ax * px + window.ay * py + window.az * pz + window.a0;
    const F8 v = window.bx * px + window.by * py + window.bz * pz + window.b0;
    const F8 r2 = r * r;
    const F8 t = r2 * pw * inverse;
    if constexpr (kMark) {
      const I8 inlier = (t <= near) & (pw > 0.0f);
      squares += inlier ? r2 : zero;
      inliers -= inlier;
      if (mask) std::memcpy(mask + i, &inlier, sizeof(inlier));
    }
    // The window's taper; also 0 for rows without a weight.
    F8 taper_u = end_u - steep_u * (u < zero ? -u : u);
    F8 taper_v = end_v - steep_v * (v < zero ? -v : v);
    taper_u = taper_u < one ? taper_u : one;
    taper_u = taper_u > zero ? taper_u : zero;
    taper_v = taper_v < one ? taper_v : one;
    taper_v = taper_v > zero ? taper_v : zero;
    F8 taper = taper_u * taper_v;
    taper = pw > zero ? taper : zero;
    const F8 weight = pw * taper;
    const I8 core = t < one;
    const F8 rest = one - t;
    F8 omega, matrix;
    if constexpr (kLoss == Loss::kNewton) {
      constexpr float kBalance = 2.0f / 27.0f;
      const F8 lobe = t < 4.0f ? kBalance * rest * (4.0f - t) : zero;
      omega = weight * (core ? rest * rest : lobe);
      matrix = core ? weight * rest * (one - 5.0f * t) : zero;
    } else {
      omega = core ? weight * rest * rest : zero;
      matrix = omega;
    }
    const F8 psi = omega == zero ? zero : omega * r;
    const F8 wu = matrix * u, wv = matrix * v;
    s1 += matrix;
    su += wu;
    sv += wv;
    suu += wu * u;
    suv += wu * v;
    svv += wv * v;
    sr += psi;
    sru += psi * u;
    srv += psi * v;
    count += core ? taper : zero;
    if constexpr (kInfluence) {
      const F8 squared = psi * psi;
      const F8 qu = squared * u, qv = squared * v;
      i1 += squared;
      iu += qu;
      iv += qv;
      iuu += qu * u;
      iuv += qu * v;
      ivv += qv * v;
    }
  }
  moments->weight += lane_sum(s1);
  moments->u += lane_sum(su);
  moments->v += lane_sum(sv);
  moments->uu += lane_sum(suu);
  moments->uv += lane_sum(suv);
  moments->vv += lane_sum(svv);
  moments->r += lane_sum(sr);
  moments->ru += lane_sum(sru);
  moments->rv += lane_sum(srv);
  moments->count += lane_sum(count);
  if constexpr (kInfluence) {
    moments->i1 += lane_sum(i1);
    moments->iu += lane_sum(iu);
    moments->iv += lane_sum(iv);
    moments->iuu += lane_sum(iuu);
    moments->iuv += lane_sum(iuv);
    moments->ivv += lane_sum(ivv);
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
float msac_cost(const float* x, const float* y, const float* z, const float* w, std::size_t n,
                const FloatPlane& plane, float limit, float bound) {
  constexpr std::size_t kStep = 256;
  const F8 cap = F8{} + limit;
  double total = 0.0;
  for (std::size_t begin = 0; begin < n; begin += kStep) {
    const std::size_t end = begin + kStep < n ? begin + kStep : n;
    F8 sum = {};
    for (std::size_t i = begin; i < end; i += kLanes) {
      F8 px, py, pz, pw;
      load(x + i, px);
      load(y + i, py);
      load(z + i, pz);
      load(w + i, pw);
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
float msac_cost_rays(const float* x, const float* y, const float* z, const float* w,
                     const float* floor2, std::size_t n, const FloatPlane& plane, float view2,
                     float limit, float bound) {
  constexpr std::size_t kStep = 256;
  const F8 cap = F8{} + limit;
  double total = 0.0;
  for (std::size_t begin = 0; begin < n; begin += kStep) {
    const std::size_t end = begin + kStep < n ? begin + kStep : n;
    F8 sum = {};
    for (std::size_t i = begin; i < end; i += kLanes) {
      F8 px, py, pz, pw, pf;
      load(x + i, px);
      load(y + i, py);
      load(z + i, pz);
      load(w + i, pw);
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
__attribute__((always_inline)) inline void accumulate_any(
    const float* x, const float* y, const float* z, const float* w, std::size_t n,
    const FloatPlane& plane, const Window& window, float limit, Loss loss, bool influence,
    float inlier_limit, std::int32_t* mask, const float* ahead, Moments* moments) {
  if constexpr (kMark) {
    accumulate_block<Loss::kNewton, false, true>(x, y, z, w, n, plane, window, limit, inlier_limit,
                                                 mask, ahead, moments);
  } else if (loss == Loss::kReweighted) {
    accumulate_block<Loss::kReweighted, false, false>(x, y, z, w, n, plane, window, limit, 0.0f,
                                                      nullptr, nullptr, moments);
  } else if (influence) {
    accumulate_block<Loss::kNewton, true, false>(x, y, z, w, n, plane, window, limit, 0.0f, nullptr,
                                                 nullptr, moments);
  } else {
    accumulate_block<Loss::kNewton, false, false>(x, y, z, w, n, plane, window, limit, 0.0f,
                                                  nullptr, nullptr, moments);
  }
}

#ifdef CAMBER_FUSED
template <bool kMark>
CAMBER_FUSED void accumulate_fused(const float* x, const float* y, const float* z, const float* w,
                                   std::size_t n, const FloatPlane& plane, const Window& window,
                                   float limit, Loss loss, bool influence, float inlier_limit,
                                   std::int32_t* mask, const float* ahead, Moments* moments) {
  accumulate_any<kMark>(x, y, z, w, n, plane, window, limit, loss, influence, inlier_limit, mask,
                        ahead, moments);
}

bool can_fuse() {
  static const bool can = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  return can;
}
#endif

}  // namespace

void accumulate(const float* x, const float* y, const float* z, const float* w, std::size_t n,
                const FloatPlane& plane, const Window& window, float limit, Loss loss,
                bool influence, Moments* moments) {
#ifdef CAMBER_FUSED
  if (can_fuse()) {
    return accumulate_fused<false>(x, y, z, w, n, plane, window, limit, loss, influence, 0.0f,
                                   nullptr, nullptr, moments);
  }
#endif
  accumulate_any<false>(x, y, z, w, n, plane, window, limit, loss, influence, 0.0f, nullptr,
                        nullptr, moments);
}

void accumulate_and_mark(const float* x, const float* y, const float* z, const float* w,
                         std::size_t n, const FloatPlane& plane, const Window& window, float limit,
                         float inlier_limit, std::int32_t* mask, const float* ahead,
                         Moments* moments) {
#ifdef CAMBER_FUSED
  if (can_fuse()) {
    return accumulate_fused<true>(x, y, z, w, n, plane, window, limit, Loss::kNewton, false,
                                  inlier_limit, mask, ahead, moments);
  }
#endif
  accumulate_any<true>(x, y, z, w, n, plane, window, limit, Loss::kNewton, false, inlier_limit,
                       mask, ahead, moments);
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

/// accumulate_and_list in one go from memory to sums, n a multiple of kLanes. Residuals are scaled
/// so that t is their square, u and v so that the tapers' ramps are of length 1; the sums are
/// scaled back at the end.
template <bool kTriples, bool kList>
CAMBER_FUSED std::size_t accumulate_and_list_fused(const float* x, const float* y, const float* z,
                                                   std::size_t n, const float pivot[3],
                                                   float weight, const FloatPlane& plane,
                                                   const Window& window, float limit,
                                                   float inlier_limit, int first, int* list,
                                                   Moments* moments) {
  const float unit = std::sqrt(weight / limit);
  const float steep_u = 1.0f / window.ramp_u, steep_v = 1.0f / window.ramp_v;
  const __m256 ox = _mm256_set1_ps(pivot[0]), oy = _mm256_set1_ps(pivot[1]),
               oz = _mm256_set1_ps(pivot[2]);
  const __m256 nx = _mm256_set1_ps(unit * plane.nx), ny = _mm256_set1_ps(unit * plane.ny),
               nz = _mm256_set1_ps(unit * plane.nz), nd = _mm256_set1_ps(unit * plane.d);
  const __m256 ax = _mm256_set1_ps(steep_u * window.ax), ay = _mm256_set1_ps(steep_u * window.ay),
               az = _mm256_set1_ps(steep_u * window.az), a0 = _mm256_set1_ps(steep_u * window.a0);
  const __m256 bx = _mm256_set1_ps(steep_v * window.bx), by = _mm256_set1_ps(steep_v * window.by),
               bz = _mm256_set1_ps(steep_v * window.bz), b0 = _mm256_set1_ps(steep_v * window.b0);
  const __m256 end_u = _mm256_set1_ps(window.half_u * steep_u),
               end_v = _mm256_set1_ps(window.half_v * steep_v);
  const __m256 zero = _mm256_setzero_ps(), one = _mm256_set1_ps(1.0f), four = _mm256_set1_ps(4.0f),
               five = _mm256_set1_ps(5.0f), balance = _mm256_set1_ps(2.0f / 27.0f);
  const __m256 far = _mm256_set1_ps(1e15f), near = _mm256_set1_ps(inlier_limit / limit);
  const __m256 sign = _mm256_set1_ps(-0.0f);
  __m256 s1 = zero, su = zero, sv = zero, suu = zero, suv = zero, svv = zero, sr = zero, sru = zero,
         srv = zero, count = zero, squares = zero;
  alignas(32) float residual[kBlock], along[kBlock], across[kBlock];
  for (std::size_t i = 0; i < n; i += kLanes) {
    __m256 px, py, pz;
    if constexpr (kTriples) {
      // Eight triples to three vectors.
      const float* from = x + 3 * i;
      const __m256 m03 = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(from)),
                                              _mm_loadu_ps(from + 12), 1);
      const __m256 m14 = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(from + 4)),
                                              _mm_loadu_ps(from + 16), 1);
      const __m256 m25 = _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(from + 8)),
                                              _mm_loadu_ps(from + 20), 1);
      const __m256 xy = _mm256_shuffle_ps(m14, m25, _MM_SHUFFLE(2, 1, 3, 2));
      const __m256 yz = _mm256_shuffle_ps(m03, m14, _MM_SHUFFLE(1, 0, 2, 1));
      px = _mm256_shuffle_ps(m03, xy, _MM_SHUFFLE(2, 0, 3, 0));
      py = _mm256_shuffle_ps(yz, xy, _MM_SHUFFLE(3, 1, 2, 0));
      pz = _mm256_shuffle_ps(yz, m25, _MM_SHUFFLE(3, 0, 3, 1));
    } else {
      px = _mm256_loadu_ps(x + i);
      py = _mm256_loadu_ps(y + i);
      pz = _mm256_loadu_ps(z + i);
    }
    px = _mm256_sub_ps(px, ox);
    py = _mm256_sub_ps(py, oy);
    pz = _mm256_sub_ps(pz, oz);
    const __m256 away =
        _mm256_add_ps(_mm256_add_ps(_mm256_andnot_ps(sign, px), _mm256_andnot_ps(sign, py)),
                      _mm256_andnot_ps(sign, pz));
    // True for NaN; such rows get the residual NaN, which compares false with everything.
    const __m256 useless = _mm256_cmp_ps(away, far, _CMP_NLT_UQ);
    const __m256 r = _mm256_fmadd_ps(nx, px, _mm256_fmadd_ps(ny, py, _mm256_fmadd_ps(nz, pz, nd)));
    const __m256 u = _mm256_fmadd_ps(ax, px, _mm256_fmadd_ps(ay, py, _mm256_fmadd_ps(az, pz, a0)));
    const __m256 v = _mm256_fmadd_ps(bx, px, _mm256_fmadd_ps(by, py, _mm256_fmadd_ps(bz, pz, b0)));
    _mm256_store_ps(residual + i, _mm256_or_ps(r, useless));
    _mm256_store_ps(along + i, _mm256_andnot_ps(useless, u));
    _mm256_store_ps(across + i, _mm256_andnot_ps(useless, v));
  }
  std::size_t inliers = 0;
  for (std::size_t i = 0; i < n; i += kLanes) {
    const __m256 r = _mm256_load_ps(residual + i), u = _mm256_load_ps(along + i),
                 v = _mm256_load_ps(across + i);
    const __m256 t = _mm256_mul_ps(r, r);
    const __m256 inlier = _mm256_cmp_ps(t, near, _CMP_LE_OQ);
    squares = _mm256_add_ps(squares, _mm256_and_ps(inlier, t));
    const auto lanes = static_cast<unsigned>(_mm256_movemask_ps(inlier));
    if constexpr (kList) {
      const __m256i which = _mm256_cvtepu8_epi32(
          _mm_loadl_epi64(reinterpret_cast<const __m128i*>(kLaneLists[lanes].data())));
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(list + inliers),
                          _mm256_add_epi32(which, _mm256_set1_epi32(first + static_cast<int>(i))));
    }
    inliers += static_cast<std::size_t>(__builtin_popcount(lanes));
    const __m256 core = _mm256_cmp_ps(t, one, _CMP_LT_OQ);
    const __m256 taper_u =
        _mm256_max_ps(_mm256_min_ps(_mm256_sub_ps(end_u, _mm256_andnot_ps(sign, u)), one), zero);
    const __m256 taper_v =
        _mm256_max_ps(_mm256_min_ps(_mm256_sub_ps(end_v, _mm256_andnot_ps(sign, v)), one), zero);
    const __m256 taper = _mm256_mul_ps(taper_u, taper_v);
    const __m256 taper_core = _mm256_and_ps(taper, core);
    const __m256 slack = _mm256_sub_ps(one, t);
    const __m256 lobe = _mm256_mul_ps(balance, _mm256_sub_ps(four, t));
    const __m256 part = _mm256_mul_ps(taper, slack);
    const __m256 psi =
        _mm256_and_ps(_mm256_mul_ps(_mm256_mul_ps(part, _mm256_blendv_ps(lobe, slack, core)), r),
                      _mm256_cmp_ps(t, four, _CMP_LT_OQ));
    const __m256 matrix = _mm256_and_ps(_mm256_mul_ps(part, _mm256_fnmadd_ps(five, t, one)), core);
    const __m256 wu = _mm256_mul_ps(matrix, u), wv = _mm256_mul_ps(matrix, v);
    s1 = _mm256_add_ps(s1, matrix);
    su = _mm256_add_ps(su, wu);
    sv = _mm256_add_ps(sv, wv);
    suu = _mm256_fmadd_ps(wu, u, suu);
    suv = _mm256_fmadd_ps(wu, v, suv);
    svv = _mm256_fmadd_ps(wv, v, svv);
    sr = _mm256_add_ps(sr, psi);
    sru = _mm256_fmadd_ps(psi, u, sru);
    srv = _mm256_fmadd_ps(psi, v, srv);
    count = _mm256_add_ps(count, taper_core);
  }
  float lanes[11][kLanes];
  _mm256_storeu_ps(lanes[0], s1);
  _mm256_storeu_ps(lanes[1], su);
  _mm256_storeu_ps(lanes[2], sv);
  _mm256_storeu_ps(lanes[3], suu);
  _mm256_storeu_ps(lanes[4], suv);
  _mm256_storeu_ps(lanes[5], svv);
  _mm256_storeu_ps(lanes[6], sr);
  _mm256_storeu_ps(lanes[7], sru);
  _mm256_storeu_ps(lanes[8], srv);
  _mm256_storeu_ps(lanes[9], count);
  _mm256_storeu_ps(lanes[10], squares);
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
  moments->inliers += static_cast<double>(inliers);
  return inliers;
}

#endif

}  // namespace

std::size_t accumulate_and_list(const float* x, const float* y, const float* z, std::size_t stride,
                                std::size_t n, const float pivot[3], float weight,
                                const FloatPlane& plane, const Window& window, float limit,
                                float inlier_limit, int first, int* list, Moments* moments) {
#ifdef CAMBER_FUSED
  const bool triples = stride == 3 && y == x + 1 && z == x + 2;
  if (can_fuse() && (triples || stride == 1)) {
    const auto fused = triples ? (list ? accumulate_and_list_fused<true, true>
                                       : accumulate_and_list_fused<true, false>)
                               : (list ? accumulate_and_list_fused<false, true>
                                       : accumulate_and_list_fused<false, false>);
    const std::size_t whole = n / kLanes * kLanes;
    std::size_t found = fused(x, y, z, whole, pivot, weight, plane, window, limit, inlier_limit,
                              first, list, moments);
    if (whole < n) {
      // The last few, and rows that are not usable.
      float rest[3 * kLanes];
      for (float& value : rest) value = __builtin_nanf("");
      const std::size_t step = triples ? 1 : kLanes, each = triples ? 3 : 1;
      for (std::size_t k = 0; whole + k < n; ++k) {
        rest[each * k] = x[each * (whole + k)];
        rest[each * k + step] = y[each * (whole + k)];
        rest[each * k + 2 * step] = z[each * (whole + k)];
      }
      found += fused(rest, rest + step, rest + 2 * step, kLanes, pivot, weight, plane, window,
                     limit, inlier_limit, first + static_cast<int>(whole),
                     list ? list + found : nullptr, moments);
    }
    return found;
  }
#endif
  alignas(32) float px[kBlock], py[kBlock], pz[kBlock], pw[kBlock];
  alignas(32) std::int32_t mask[kBlock];
  load_points(x, y, z, stride, n, pivot, weight, px, py, pz, pw);
  const std::size_t rows = padded(n);
  for (std::size_t k = n; k < rows; ++k) px[k] = py[k] = pz[k] = pw[k] = 0.0f;
  accumulate_and_mark(px, py, pz, pw, rows, plane, window, limit, inlier_limit, mask, nullptr,
                      moments);
  std::size_t inliers = 0;
  for (std::size_t k = 0; k < n; ++k) {
    if (list) list[inliers] = first + static_cast<int>(k);
    inliers += mask[k] != 0 ? 1 : 0;
  }
  return inliers;
}

namespace {

/// @param normalised  holds the square roots of w
__attribute__((always_inline)) inline void project_any(const float* x, const float* y,
                                                       const float* z, const float* w,
                                                       std::size_t n, const FloatPlane& p,
                                                       const Window& f, float* normalised, float* u,
                                                       float* v) {
  for (std::size_t i = 0; i < n; i += kLanes) {
    F8 px, py, pz, pw, root = {};
    load(x + i, px);
    load(y + i, py);
    load(z + i, pz);
    load(w + i, pw);
    load(normalised + i, root);
    const F8 r = p.nx * px + p.ny * py + p.nz * pz + p.d;
    const F8 along = f.ax * px + f.ay * py + f.az * pz + f.a0;
    const F8 across = f.bx * px + f.by * py + f.bz * pz + f.b0;
    const F8 scaled = pw > 0.0f ? r * root : F8{} + 1e30f;
    std::memcpy(u + i, &along, sizeof(F8));
    std::memcpy(v + i, &across, sizeof(F8));
    std::memcpy(normalised + i, &scaled, sizeof(F8));
  }
}

#ifdef CAMBER_FUSED
CAMBER_FUSED void project_fused(const float* x, const float* y, const float* z, const float* w,
                                std::size_t n, const FloatPlane& p, const Window& f,
                                float* normalised, float* u, float* v) {
  for (std::size_t i = 0; i < n; i += kLanes) {
    _mm256_storeu_ps(normalised + i, _mm256_sqrt_ps(_mm256_loadu_ps(w + i)));
  }
  project_any(x, y, z, w, n, p, f, normalised, u, v);
}
#endif

}  // namespace

void project(const float* x, const float* y, const float* z, const float* w, std::size_t n,
             const FloatPlane& plane, const Window& window, float* normalised, float* u, float* v) {
#ifdef CAMBER_FUSED
  if (can_fuse()) return project_fused(x, y, z, w, n, plane, window, normalised, u, v);
#endif
  for (std::size_t i = 0; i < n; ++i) normalised[i] = std::sqrt(w[i]);
  project_any(x, y, z, w, n, plane, window, normalised, u, v);
}

CAMBER_CLONES
PieceStatistics piece_statistics(const float* x, const float* y, const float* z, const float* w,
                                 std::size_t n, const FloatPlane& plane, float limit) {
  const F8 zero = {};
  const F8 one = zero + 1.0f, cap = zero + limit;
  F8 cost = zero, inliers = zero, weight = zero, gradient = zero;
  for (std::size_t i = 0; i < n; i += kLanes) {
    F8 px, py, pz, pw;
    load(x + i, px);
    load(y + i, py);
    load(z + i, pz);
    load(w + i, pw);
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

CAMBER_CLONES
void load_points(const float* x, const float* y, const float* z, std::size_t stride, std::size_t n,
                 const float pivot[3], float weight, float* out_x, float* out_y, float* out_z,
                 float* out_w) {
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
      std::memcpy(out_x + i, &vx, sizeof(vx));
      std::memcpy(out_y + i, &vy, sizeof(vy));
      std::memcpy(out_z + i, &vz, sizeof(vz));
      std::memcpy(out_w + i, &vw, sizeof(vw));
    }
  }
  for (; i < n; ++i) {
    const float vx = x[stride * i] - px, vy = y[stride * i] - py, vz = z[stride * i] - pz;
    const bool usable = vx * vx + vy * vy + vz * vz < kFar2;
    out_x[i] = usable ? vx : 0.0f;
    out_y[i] = usable ? vy : 0.0f;
    out_z[i] = usable ? vz : 0.0f;
    out_w[i] = usable ? weight : 0.0f;
  }
}

}  // namespace camber::plane_kernels
