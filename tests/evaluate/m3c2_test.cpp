// M3C2: made pairs whose change is known, and the definition written again in plain loops.

#include "camber/evaluate/m3c2.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/random.h"

namespace camber {
namespace {

using Eigen::Vector3d;

/// A slope of 20 by 20 m with noise, raised by `change` where x > 10.
RoadCloud epoch(double noise, double change, double density, std::uint64_t seed,
                double slope = 0.3) {
  RoadCloud out;
  out.frame = CloudFrame::kZUp;
  out.origin = {500000.0, 4000000.0, 100.0};
  const CounterRandom random(seed, 3);
  const Vector3d normal = Vector3d(-slope, 0.0, 1.0).normalized();
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(density * 400.0); ++i) {
    const double x = random.uniform(2 * i, 0.0, 20.0), y = random.uniform(2 * i + 1, 0.0, 20.0);
    const Vector3d p(x, y, slope * x);
    const double moved = (x > 10.0 ? change : 0.0) + noise * random.normal(i);
    out.points.push_back((p + moved * normal).cast<float>());
  }
  return out;
}

M3c2Options sizes() {
  M3c2Options options;
  options.normal_scale = 2.0;
  options.cylinder = 1.0;
  options.core_spacing = 0.5;
  options.max_depth = 1.0;
  return options;
}

TEST(M3c2, EqualsTheDefinitionInPlainLoops) {
  const RoadCloud before = epoch(0.02, 0.0, 20.0, 1), after = epoch(0.03, 0.1, 15.0, 2);
  M3c2Options options = sizes();
  options.registration_sigma = 0.004;
  const CloudChange change = measure_change(after, before, options);
  ASSERT_GT(change.cores.size(), 1000u);
  for (std::size_t k = 0; k < change.cores.size(); k += 37) {
    const CoreChange& core = change.cores[k];
    const Vector3d at = core.point - before.origin;
    std::vector<Vector3d> around;
    for (const Eigen::Vector3f& p : before.points) {
      if ((p.cast<double>() - at).norm() <= 1.0) around.push_back(p.cast<double>());
    }
    Eigen::MatrixXd rows(static_cast<Eigen::Index>(around.size()), 3);
    for (std::size_t i = 0; i < around.size(); ++i) {
      rows.row(static_cast<Eigen::Index>(i)) = around[i];
    }
    rows.rowwise() -= rows.colwise().mean().eval();
    Vector3d normal = Eigen::JacobiSVD<Eigen::MatrixXd>(rows, Eigen::ComputeThinV).matrixV().col(2);
    if (normal.z() < 0.0) normal = -normal;
    EXPECT_NEAR((normal - core.normal).norm(), 0.0, 1e-9);
    double mean[2] = {}, spread[2] = {}, count[2] = {};
    for (const int which : {0, 1}) {
      std::vector<double> along;
      for (const Eigen::Vector3f& p : (which == 0 ? before : after).points) {
        const Vector3d off = p.cast<double>() - at;
        const double t = normal.dot(off);
        if (std::abs(t) <= 1.0 && (off - t * normal).norm() <= 0.5) along.push_back(t);
      }
      count[which] = static_cast<double>(along.size());
      for (const double t : along) mean[which] += t / count[which];
      for (const double t : along) {
        spread[which] += std::pow(t - mean[which], 2) / (count[which] - 1.0);
      }
    }
    ASSERT_EQ(static_cast<double>(core.earlier), count[0]);
    ASSERT_EQ(static_cast<double>(core.later), count[1]);
    if (std::min(count[0], count[1]) < 4.0) continue;
    EXPECT_NEAR(core.distance, mean[1] - mean[0], 1e-9);
    const double limit = 1.96 * (std::sqrt(spread[0] / count[0] + spread[1] / count[1]) + 0.004);
    EXPECT_NEAR(core.detection_limit, limit, 1e-9);
    EXPECT_EQ(core.significant, std::abs(core.distance) > core.detection_limit);
  }
}

TEST(M3c2, LimitsHoldAndChangesAreFound) {
  // Some 30 points a cylinder of 1 m, 5 mm of noise, 10 mm of change in a half.
  double inside = 0.0, unchanged = 0.0, sum = 0.0, changed = 0.0;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    const RoadCloud before = epoch(0.005, 0.0, 38.0, 10 + seed);
    const RoadCloud after = epoch(0.005, 0.010, 38.0, 20 + seed);
    M3c2Options options = sizes();
    options.core_spacing = 1.0;
    const CloudChange change = measure_change(after, before, options);
    for (const CoreChange& core : change.cores) {
      const double x = core.point.x() - before.origin.x();
      if (!std::isfinite(core.detection_limit) || (x > 9.0 && x < 11.0)) continue;
      if (x < 10.0) {
        unchanged += 1.0;
        inside += !core.significant;
      } else {
        changed += 1.0;
        sum += core.distance;
      }
    }
  }
  EXPECT_GT(inside / unchanged, 0.93);
  EXPECT_LT(inside / unchanged, 0.97);
  EXPECT_NEAR(sum / changed, 0.010, 0.001);
}

TEST(M3c2, VolumesAndTheirSigma) {
  const RoadCloud before = epoch(0.005, 0.0, 40.0, 1), after = epoch(0.005, 0.05, 40.0, 2);
  M3c2Options options = sizes();
  options.registration_sigma = 0.002;
  const CloudChange change = measure_change(after, before, options);
  // 200 m2, raised by 5 cm along normals of slope 0.3.
  EXPECT_NEAR(change.gain_area, 200.0, 10.0);
  EXPECT_NEAR(change.gain_volume, 200.0 * 0.05 * std::hypot(1.0, 0.3), 0.4);
  EXPECT_LT(change.loss_volume, 0.2);
  EXPECT_NEAR(change.gain_volume_sigma, 0.002 * change.gain_area, 0.15);
  options.vertical = true;
  const CloudChange plain = measure_change(after, before, options);
  EXPECT_NEAR(plain.gain_volume, change.gain_volume, 0.5);
  EXPECT_NEAR(plain.cores[5].normal.z(), 1.0, 0.0);
}

TEST(M3c2, SigmasOfThePointsCount) {
  RoadCloud before = epoch(0.005, 0.0, 20.0, 1);
  const RoadCloud after = epoch(0.005, 0.0, 20.0, 2);
  const double plain = measure_change(after, before, sizes()).median_limit;
  before.sigmas.assign(before.size(), 0.05f);
  EXPECT_GT(measure_change(after, before, sizes()).median_limit, 4.0 * plain);
}

TEST(M3c2, SizesAreChosenAndThreadsDoNotMatter) {
  const RoadCloud before = epoch(0.01, 0.0, 25.0, 1);
  RoadCloud after = epoch(0.01, 0.05, 25.0, 2);
  // Another origin is another float of the same places.
  for (Eigen::Vector3f& p : after.points) p.x() += 16.0f;
  after.origin.x() -= 16.0;
  M3c2Options options;
  options.num_threads = 1;
  const CloudChange one = measure_change(after, before, options);
  EXPECT_GT(one.used.cylinder, 0.8);
  EXPECT_LT(one.used.cylinder, 1.8);
  std::vector<double> counts;
  for (const CoreChange& core : one.cores) counts.push_back(static_cast<double>(core.later));
  std::sort(counts.begin(), counts.end());
  EXPECT_NEAR(counts[counts.size() / 2], 30.0, 12.0);
  options.num_threads = 3;
  const CloudChange three = measure_change(after, before, options);
  ASSERT_EQ(one.cores.size(), three.cores.size());
  EXPECT_EQ(one.mean, three.mean);
  EXPECT_EQ(one.gain_volume_sigma, three.gain_volume_sigma);
}

TEST(M3c2, WhatCannotBeAnswered) {
  const RoadCloud cloud = epoch(0.01, 0.0, 5.0, 1);
  RoadCloud away = cloud;
  away.origin.x() += 1000.0;
  EXPECT_THROW(measure_change(away, cloud, sizes()), NoAnswerError);
  EXPECT_THROW(measure_change(RoadCloud(), cloud, sizes()), NoAnswerError);
  M3c2Options options;
  options.cylinder = -1.0;
  EXPECT_THROW(measure_change(cloud, cloud, options), std::invalid_argument);
}

}  // namespace
}  // namespace camber
