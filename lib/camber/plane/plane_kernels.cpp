#include "camber/plane/plane_kernels.h"

#include <cstring>

// One clone for machines with AVX2, one for any x86-64, chosen when the program starts. The
// arithmetic is the same in both: ISO C++ mode forbids fusing multiplications with additions.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(__SANITIZE_THREAD__)
#define CAMBER_CLONES __attribute__((target_clones("arch=haswell", "default")))
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

template <bool kInfluence>
__attribute__((always_inline)) inline void accumulate_block(const float* x, const float* y,
                                                            const float* z, const float* w,
                                                            std::size_t n, const FloatPlane& plane,
                                                            const Window& window, float limit,
                                                            Moments* moments) {
  const F8 zero = {};
  const float inverse = 1.0f / limit;
  F8 s1 = zero, su = zero, sv = zero, suu = zero, suv = zero, svv = zero, sr = zero, sru = zero,
     srv = zero, slope = zero, count = zero;
  F8 i1 = zero, iu = zero, iv = zero, iuu = zero, iuv = zero, ivv = zero;
  const F8 one = zero + 1.0f;
  for (std::size_t i = 0; i < n; i += kLanes) {
    F8 px, py, pz, pw;
    load(x + i, px);
    load(y + i, py);
    load(z + i, pz);
    load(w + i, pw);
    const F8 r = plane.nx * px + plane.ny * py + plane.nz * pz + plane.d;
    const F8 u = window.ax * px + window.ay * py + window.az * pz + window.a0;
    const F8 v = window.bx * px + window.by * py + window.bz * pz + window.b0;
    const F8 t = r * r * pw * inverse;
    const I8 inside = (t < 1.0f) & (u <= window.half_u) & (u >= -window.half_u) &
                      (v <= window.half_v) & (v >= -window.half_v) & (pw > 0.0f);
    const F8 rest = inside ? 1.0f - t : zero;
    const F8 weighted = pw * rest;
    const F8 omega = weighted * rest;
    const F8 wu = omega * u, wv = omega * v, wr = omega * r;
    s1 += omega;
    su += wu;
    sv += wv;
    suu += wu * u;
    suv += wu * v;
    svv += wv * v;
    sr += wr;
    sru += wr * u;
    srv += wr * v;
    slope += weighted * (1.0f - 5.0f * t);
    count += inside ? one : zero;
    if constexpr (kInfluence) {
      const F8 squared = wr * wr;
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
  moments->slope += lane_sum(slope);
  moments->count += lane_sum(count);
  if constexpr (kInfluence) {
    moments->i1 += lane_sum(i1);
    moments->iu += lane_sum(iu);
    moments->iv += lane_sum(iv);
    moments->iuu += lane_sum(iuu);
    moments->iuv += lane_sum(iuv);
    moments->ivv += lane_sum(ivv);
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
  slope += other.slope;
  count += other.count;
  i1 += other.i1;
  iu += other.iu;
  iv += other.iv;
  iuu += other.iuu;
  iuv += other.iuv;
  ivv += other.ivv;
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

CAMBER_CLONES
void accumulate(const float* x, const float* y, const float* z, const float* w, std::size_t n,
                const FloatPlane& plane, const Window& window, float limit, bool influence,
                Moments* moments) {
  if (influence) {
    accumulate_block<true>(x, y, z, w, n, plane, window, limit, moments);
  } else {
    accumulate_block<false>(x, y, z, w, n, plane, window, limit, moments);
  }
}

CAMBER_CLONES
int mark_inliers(const float* x, const float* y, const float* z, const float* w, std::size_t n,
                 const FloatPlane& plane, float limit, std::int32_t* mask, double* squares) {
  const F8 zero = {};
  F8 sum = zero;
  I8 number = {};
  for (std::size_t i = 0; i < n; i += kLanes) {
    F8 px, py, pz, pw;
    load(x + i, px);
    load(y + i, py);
    load(z + i, pz);
    load(w + i, pw);
    const F8 r = plane.nx * px + plane.ny * py + plane.nz * pz + plane.d;
    const F8 r2 = r * r;
    const I8 inside = (r2 * pw <= limit) & (pw > 0.0f);
    sum += inside ? r2 : zero;
    number -= inside;
    std::memcpy(mask + i, &inside, sizeof(inside));
  }
  *squares += lane_sum(sum);
  int total = 0;
  for (std::size_t i = 0; i < kLanes; ++i) total += number[i];
  return total;
}

CAMBER_CLONES
void load_points(const float* x, const float* y, const float* z, std::size_t stride, std::size_t n,
                 const float pivot[3], float* out_x, float* out_y, float* out_z, float* out_w) {
  const float px = pivot[0], py = pivot[1], pz = pivot[2];
  if (stride == 3 && y == x + 1 && z == x + 2) {
    for (std::size_t i = 0; i < n; ++i) {
      out_x[i] = x[3 * i] - px;
      out_y[i] = x[3 * i + 1] - py;
      out_z[i] = x[3 * i + 2] - pz;
    }
  } else {
    for (std::size_t i = 0; i < n; ++i) {
      out_x[i] = x[stride * i] - px;
      out_y[i] = y[stride * i] - py;
      out_z[i] = z[stride * i] - pz;
    }
  }
  constexpr float kFar2 = 1e30f;
  for (std::size_t i = 0; i < n; ++i) {
    const float d2 = out_x[i] * out_x[i] + out_y[i] * out_y[i] + out_z[i] * out_z[i];
    const bool usable = d2 < kFar2;  // false for NaN
    out_w[i] = usable ? 1.0f : 0.0f;
    out_x[i] = usable ? out_x[i] : 0.0f;
    out_y[i] = usable ? out_y[i] : 0.0f;
    out_z[i] = usable ? out_z[i] : 0.0f;
  }
}

}  // namespace camber::plane_kernels
