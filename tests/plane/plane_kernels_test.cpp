// The kernel that goes straight from a cloud to sums and inliers, against sums in double.

#include "camber/plane/plane_kernels.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "camber/core/random.h"

namespace camber {
namespace {

namespace kernels = plane_kernels;

constexpr float kWeight = 2500.0f, kLimit = 21.9f, kInlier = 6.25f;
constexpr kernels::FloatPlane kPlane{0.1f, -0.2f, 0.9746794f, 0.3f};
constexpr kernels::Window kWindow{1, 0, 0, 0.5f, 0, 1, 0, -0.2f, 4.0f, 3.0f, 1.0f, 0.7f};
constexpr float kPivot[3] = {100.0f, -50.0f, 7.0f};

/// Points on and around the plane, some of them useless.
std::vector<float> triples(std::size_t n) {
  const CounterRandom random(3, 9);
  std::vector<float> out;
  for (std::size_t i = 0; i < n; ++i) {
    const double x = random.uniform(8 * i, -6, 6), y = random.uniform(8 * i + 1, -6, 6);
    double z = -(0.1 * x - 0.2 * y + 0.3) / 0.9746794;
    z += i % 3 == 0 ? random.uniform(8 * i + 2, -0.4, 0.4) : 0.02 * random.normal(2 * i);
    out.push_back(static_cast<float>(x) + kPivot[0]);
    out.push_back(static_cast<float>(y) + kPivot[1]);
    out.push_back(static_cast<float>(z) + kPivot[2]);
  }
  const float bad[] = {std::numeric_limits<float>::quiet_NaN(),
                       std::numeric_limits<float>::infinity(), 1e30f, 3e38f};
  for (std::size_t i = 5; i < n; i += 37) out[3 * i + i % 3] = bad[i % 4];
  return out;
}

/// The sums as plane_kernels.h defines them.
kernels::Moments reference(const std::vector<float>& p, std::size_t n, std::vector<int>* list) {
  kernels::Moments m;
  for (std::size_t i = 0; i < n; ++i) {
    double c[3];
    bool good = true;
    for (std::size_t k = 0; k < 3; ++k) {
      c[k] = static_cast<double>(p[3 * i + k]) - static_cast<double>(kPivot[k]);
      good = good && std::abs(c[k]) < 1e15;
    }
    if (!good) continue;
    const double r = 0.1 * c[0] - 0.2 * c[1] + 0.9746794 * c[2] + 0.3;
    const double u = c[0] + 0.5, v = c[1] - 0.2;
    const double t = r * r * static_cast<double>(kWeight) / static_cast<double>(kLimit);
    if (r * r * static_cast<double>(kWeight) <= static_cast<double>(kInlier)) {
      list->push_back(static_cast<int>(i) + 11);
      m.squares += r * r;
      m.inliers += 1;
    }
    const double taper = std::clamp((4.0 - std::abs(u)) / 1.0, 0.0, 1.0) *
                         std::clamp((3.0 - std::abs(v)) / 0.7, 0.0, 1.0);
    const double w = static_cast<double>(kWeight) * taper;
    const double omega = t < 1   ? w * (1 - t) * (1 - t)
                         : t < 4 ? -w * 2.0 / 27.0 * (t - 1) * (4 - t)
                                 : 0.0;
    const double matrix = t < 1 ? w * (1 - t) * (1 - 5 * t) : 0.0;
    m.weight += matrix;
    m.u += matrix * u;
    m.v += matrix * v;
    m.uu += matrix * u * u;
    m.uv += matrix * u * v;
    m.vv += matrix * v * v;
    m.r += omega * r;
    m.ru += omega * r * u;
    m.rv += omega * r * v;
    m.count += t < 1 ? taper : 0.0;
  }
  return m;
}

TEST(PlaneKernels, FromTheCloudToSumsAndInliers) {
  for (const std::size_t n : {0u, 1u, 7u, 8u, 1000u, 1024u}) {
    const std::vector<float> p = triples(n);
    std::vector<float> x, y, z;
    for (std::size_t i = 0; i < n; ++i) {
      x.push_back(p[3 * i]);
      y.push_back(p[3 * i + 1]);
      z.push_back(p[3 * i + 2]);
    }
    std::vector<int> expected;
    const kernels::Moments truth = reference(p, n, &expected);
    for (const int way : {0, 1, 2}) {
      SCOPED_TRACE(testing::Message() << n << " points, way " << way);
      std::vector<int> list(n + kernels::kLanes, -1);
      kernels::Moments m;
      const float* none = nullptr;
      const float* from = n > 0 ? p.data() : none;
      const kernels::Target target = {kPlane, kWindow, kLimit, kInlier};
      const std::size_t found =
          way == 2 ? kernels::accumulate_and_list({x.data(), y.data(), z.data(), 1, n}, kPivot,
                                                  kWeight, target, 11, list.data(), &m)
                   : kernels::accumulate_and_list({from, from + 1, from + 2, 3, n}, kPivot, kWeight,
                                                  target, 11, way == 0 ? list.data() : nullptr, &m);
      // A residual within rounding of the threshold may fall on either side.
      EXPECT_NEAR(static_cast<double>(found), static_cast<double>(expected.size()), 1.0);
      EXPECT_EQ(m.inliers, static_cast<double>(found));
      if (way != 1 && found == expected.size()) {
        list.resize(found);
        EXPECT_EQ(list, expected);
      }
      // Floats: 1e-7 of the largest coordinate (100 m) in a residual, 2 % of a standard deviation.
      const double most = static_cast<double>(n) * static_cast<double>(kWeight) + 1.0;
      for (const auto& [sum, exact] : {std::pair{m.weight, truth.weight},
                                       {m.u, truth.u},
                                       {m.v, truth.v},
                                       {m.uu, truth.uu},
                                       {m.uv, truth.uv},
                                       {m.vv, truth.vv}}) {
        EXPECT_NEAR(sum, exact, 1e-4 * most);
      }
      for (const auto& [sum, exact] :
           {std::pair{m.r, truth.r}, {m.ru, truth.ru}, {m.rv, truth.rv}}) {
        EXPECT_NEAR(sum, exact, 2e-6 * most);
      }
      EXPECT_NEAR(m.count, truth.count, 1e-4 * static_cast<double>(n));
      EXPECT_NEAR(m.squares, truth.squares, 1e-3 * (1e-3 + truth.squares));
    }
  }
}

TEST(PlaneKernels, SpreadAlongTheWindowsAxes) {
  constexpr std::size_t kCount = 1000;
  const std::vector<float> p = triples(kCount);
  std::vector<float> x(kCount), y(kCount), z(kCount), w(kCount);
  kernels::load_points({p.data(), p.data() + 1, p.data() + 2, 3, kCount}, kPivot, kWeight,
                       {x.data(), y.data(), z.data(), w.data()});
  x[17] = 1e14f;  // far rows have no part, and no infinite squares
  kernels::SpreadSums::Axis u, v;
  double weight = 0.0;
  for (std::size_t i = 0; i < kCount; ++i) {
    const double r = 0.1 * x[i] - 0.2 * y[i] + 0.9746794 * z[i] + 0.3;
    const double at_u = x[i] + 0.5, at_v = y[i] - 0.2, t = r * r * static_cast<double>(w[i]);
    if (!(w[i] > 0.0f) || !(t < 6.25)) continue;
    const double share = std::clamp((4.0 - std::abs(at_u)) / 1.0, 0.0, 1.0) *
                         std::clamp((3.0 - std::abs(at_v)) / 0.7, 0.0, 1.0);
    weight += share * static_cast<double>(w[i]);
    for (auto& [axis, at] : {std::pair<kernels::SpreadSums::Axis*, double>{&u, at_u}, {&v, at_v}}) {
      axis->one += share;
      axis->xx += share * at * at;
      axis->xxxx += share * at * at * at * at;
      axis->v += share * t;
      axis->vxx += share * t * at * at;
    }
  }
  const kernels::SpreadSums sums = kernels::spread_along(
      {x.data(), y.data(), z.data(), w.data(), kCount}, kPlane, kWindow, 6.25f);
  EXPECT_GT(u.one, 100.0);
  // Floats in places and squares; a point at the limit may fall on either side.
  const auto near = [](double sum, double exact) { EXPECT_NEAR(sum, exact, 0.005 * exact); };
  near(sums.weight, weight);
  for (const auto& [sum, exact] : {std::pair{sums.u, u}, {sums.v, v}}) {
    near(sum.one, exact.one);
    near(sum.xx, exact.xx);
    near(sum.xxxx, exact.xxxx);
    near(sum.v, exact.v);
    near(sum.vxx, exact.vxx);
  }
}

}  // namespace
}  // namespace camber
