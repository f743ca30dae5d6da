#include "camber/plane/plane_kernels.h"

#include <cstring>

// One clone for machines with AVX2, one for any x86-64, chosen when the program starts; the sums
// also with fused multiplication and addition where the machine has it, so that their last bits
// depend on the type of machine.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define CAMBER_CLONES __attribute__((target_clones("avx2", "default")))
#define CAMBER_FUSED __attribute__((target("avx2,fma"), noinline))
#else
#define CAMBER_CLONES
#endif

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

CAMBER_CLONES
PieceStatistics piece_statistics(const float* x, const float* y, const float* z, const float* w,
                                 std::size_t n, const FloatPlane& plane, float limit) {
  const F8 zero = {};
  const F8 one = zero + 1.0f, cap = zero + limit;
  F8 cost = zero, inliers = zero, weight = zero, pull = zero;
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
    pull += inside ? rw : zero;
  }
  return {static_cast<float>(lane_sum(cost)), static_cast<float>(lane_sum(inliers)),
          static_cast<float>(lane_sum(weight)), static_cast<float>(lane_sum(pull))};
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
