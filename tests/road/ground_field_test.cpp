// The ground as a field of inverse depths: planes, bends, noise, outliers, covariance.

#include "camber/road/ground_field.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kHeight = 1.65;  // m
const PinholeCamera kCamera{640, 240, 400.0, 400.0, 320.0, 100.0};

/// Depth (z) at which a pixel's ray meets y = ground(z), camera frame (y down), by bisection; NaN
/// beyond `farthest`.
double depth_on(const Eigen::Vector3d& ray, const std::function<double(double)>& ground,
                double farthest) {
  double low = 0.5, high = farthest;
  if (ray.y() * high < ground(high)) return std::nan("");
  for (int i = 0; i < 80; ++i) {
    const double middle = 0.5 * (low + high);
    (ray.y() * middle < ground(middle) ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

/// Observations of a ground on every fourth pixel of the lower image, sigma as of triangulation:
/// 0.1 px of parallax over a baseline of 1 m ahead.
GroundObservations observe(const std::function<double(double)>& ground, double farthest) {
  GroundObservations out;
  for (int v = 100; v < kCamera.height; v += 2) {
    for (int u = 0; u < kCamera.width; u += 4) {
      const Eigen::Vector2d pixel(u, v);
      const double z = depth_on(kCamera.ray(pixel), ground, farthest);
      if (!std::isfinite(z)) continue;
      out.pixels.push_back(pixel);
      out.inverse_depth.push_back(1.0 / z);
      out.sigma.push_back(0.1 / std::hypot(u - kCamera.cx, v - kCamera.cy + 10.0));
    }
  }
  return out;
}

double flat(double) { return kHeight; }

const Plane kLevel{{0, -1, 0}, kHeight};

TEST(GroundField, ReproducesAPlaneExactly) {
  const Plane truth{Eigen::Vector3d(0.03, -1.0, -0.05).normalized(), kHeight};
  GroundObservations observations;
  const Eigen::Vector3d m = -truth.normal / truth.offset;
  for (int v = 110; v < kCamera.height; v += 3) {
    for (int u = 0; u < kCamera.width; u += 3) {
      const double rho = m.dot(kCamera.ray(Eigen::Vector2d(u, v)));
      if (rho < 1.0 / 60.0) continue;
      observations.pixels.emplace_back(u, v);
      observations.inverse_depth.push_back(rho);
      observations.sigma.push_back(0.002);
    }
  }
  const GroundField field(kCamera, observations, truth, {});
  for (const Eigen::Vector2d& p : observations.pixels) {
    const double rho = m.dot(kCamera.ray(p));
    // A plane has no second differences: only rounding is left, in a system whose condition is that
    // of a bending beam.
    EXPECT_NEAR(field.inverse_depth(p), rho, 1e-6 * rho);
  }
  for (const double w : field.weights()) EXPECT_NEAR(w, 1.0, 1e-6);
}

/// Vertical bend of radius 60 m, up or down, from under the camera on.
double bend_error(double sign, double farthest) {
  const auto ground = [&](double z) { return kHeight - sign * (60.0 - std::sqrt(3600.0 - z * z)); };
  const GroundObservations observations = observe(ground, farthest);
  EXPECT_GT(observations.size(), 3000u);
  GroundFieldOptions options;
  options.correlation = 1.0;  // nothing is wrong with these observations
  const GroundField field(kCamera, observations, kLevel, options);
  double worst = 0.0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Eigen::Vector2d& p = observations.pixels[i];
    const double rho = field.inverse_depth(p);
    if (!(rho > 0)) return std::nan("");
    const Eigen::Vector3d x = kCamera.ray(p) / rho;
    worst = std::max(worst, std::abs(x.y() - ground(x.z())));
  }
  return worst;
}

TEST(GroundField, FollowsABendOf60Metres) {
  // Uphill to 25 m; a crest hides what lies beyond 14 m. Nodes are 6 px apart: at 15 m lie 2 m of
  // road between two, whose sagitta is 0.8 cm, and the bend is sharper than the prior's 1 / 83 m,
  // which flattens it where observations are weak. 4 % of the camera's height is what far cars
  // need.
  EXPECT_LT(bend_error(1.0, 25.0), 0.05);
  EXPECT_LT(bend_error(-1.0, 12.0), 0.02);
}

TEST(GroundField, RejectsAFifthOfOutliers) {
  GroundObservations observations = observe(flat, 40.0);
  const CounterRandom noise(1), wrong(2);
  std::vector<bool> outlier;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    observations.inverse_depth[i] += observations.sigma[i] * noise.normal(i);
    outlier.push_back(wrong.uniform(2 * i) < 0.2);
    if (outlier.back()) observations.inverse_depth[i] *= wrong.uniform(2 * i + 1, 1.3, 3.0);
  }
  GroundFieldOptions options;
  options.correlation = 1.0;
  const GroundField field(kCamera, observations, kLevel, options);
  double mean_right = 0.0, mean_wrong = 0.0;
  int right = 0, wrong_count = 0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Eigen::Vector2d& p = observations.pixels[i];
    const double truth = kCamera.ray(p).y() / kHeight;
    (outlier[i] ? mean_wrong : mean_right) += field.weights()[i];
    ++(outlier[i] ? wrong_count : right);
    if (1.0 / truth < 15.0) {
      // Height error: 3 % of the camera's height, 5 cm. One node of the grid averages some 25
      // observations of at most 3 % each.
      EXPECT_NEAR(field.inverse_depth(p), truth, 0.03 * truth) << p.transpose();
    }
  }
  EXPECT_GT(mean_right / right, 0.75);
  EXPECT_LT(mean_wrong / wrong_count, 0.3);
}

TEST(GroundField, CovarianceHoldsAgainstNoisyRepetitions) {
  const GroundObservations exact = observe(flat, 40.0);
  GroundFieldOptions options;
  options.correlation = 1.0;  // the noise made here is independent
  const std::vector<Eigen::Vector2d> pixels = {{320, 220}, {200, 180}, {400, 150}, {320, 130}};
  const auto count = static_cast<Eigen::Index>(pixels.size());
  const Eigen::MatrixXd each = Eigen::MatrixXd::Identity(count, count);
  Eigen::VectorXd stated = Eigen::VectorXd::Zero(count), squares = stated;
  constexpr int kTrials = 60;
  for (int trial = 0; trial < kTrials; ++trial) {
    GroundObservations noisy = exact;
    const CounterRandom random(3, static_cast<std::uint64_t>(trial));
    for (std::size_t i = 0; i < noisy.size(); ++i) {
      noisy.inverse_depth[i] += noisy.sigma[i] * random.normal(i);
    }
    const GroundField field(kCamera, noisy, kLevel, options);
    stated += field.covariance(pixels, each, {}).diagonal() / kTrials;
    for (Eigen::Index k = 0; k < count; ++k) {
      const Eigen::Vector2d& p = pixels[static_cast<std::size_t>(k)];
      squares[k] += std::pow(field.inverse_depth(p) - kCamera.ray(p).y() / kHeight, 2) / kTrials;
    }
  }
  for (Eigen::Index k = 0; k < count; ++k) {
    // The stated variance holds the prior's share too (a road may bend, this one does not), so it
    // may be the larger one; 60 trials know a variance to 18 %.
    EXPECT_GT(stated[k] / squares[k], 0.5) << "pixel " << k;
    EXPECT_LT(std::sqrt(stated[k] / squares[k]), 2.0) << "pixel " << k;
  }
}

TEST(GroundField, SharedErrorsMoveTheWholeField) {
  GroundObservations observations = observe(flat, 40.0);
  // One shared parameter: the logarithm of the scale.
  observations.shared_jacobian.resize(static_cast<Eigen::Index>(observations.size()), 1);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    observations.shared_jacobian(static_cast<Eigen::Index>(i), 0) =
        static_cast<float>(-observations.inverse_depth[i]);
  }
  const GroundField field(kCamera, observations, kLevel, {});
  const std::vector<Eigen::Vector2d> pixels = {{320, 220}, {200, 150}};
  const Eigen::MatrixXd each = Eigen::MatrixXd::Identity(2, 2);
  const Eigen::MatrixXd alone = field.covariance(pixels, each, {});
  const Eigen::MatrixXd with =
      field.covariance(pixels, each, Eigen::MatrixXd::Constant(1, 1, 0.02 * 0.02));
  for (Eigen::Index k = 0; k < 2; ++k) {
    const double rho = field.inverse_depth(pixels[static_cast<std::size_t>(k)]);
    // The Jacobian is stored as floats, and the field bends a little: 1 %.
    EXPECT_NEAR(std::sqrt(with(k, k) - alone(k, k)), 0.02 * rho, 2e-4 * rho);
  }
  EXPECT_GT(with(0, 1) - alone(0, 1), 0.0);
}

// Far nodes lie metres apart: what is seen at the road's borders must still tell of its middle.
TEST(GroundField, AFarCrossSectionBendsLittle) {
  GroundObservations all = observe(flat, 90.0), seen;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const bool middle = std::abs(all.pixels[i].x() - kCamera.cx) < 70.0;
    if (middle && all.inverse_depth[i] < 1.0 / 40.0) continue;
    seen.pixels.push_back(all.pixels[i]);
    seen.inverse_depth.push_back(all.inverse_depth[i]);
    seen.sigma.push_back(0.05 * all.sigma[i]);
  }
  const GroundField field(kCamera, seen, kLevel, {});
  const double z = 75.0;
  const Eigen::Vector2d pixel(kCamera.cx, kCamera.cy + kCamera.fy * kHeight / z);
  const double sigma =
      std::sqrt(field.covariance({pixel}, Eigen::MatrixXd::Identity(1, 1), {})(0, 0));
  EXPECT_LT(sigma * z * kHeight, 0.35);  // m; 0.25 measured, 0.49 by the curvature alone
}

TEST(GroundField, UpdateTakesNewObservations) {
  const GroundObservations first = observe(flat, 40.0);
  GroundField field(kCamera, first, kLevel, {});
  GroundObservations second = first;
  for (double& rho : second.inverse_depth) rho *= 1.01;
  field.update(second, 3);
  for (std::size_t i = 0; i < second.size(); i += 50) {
    EXPECT_NEAR(field.inverse_depth(second.pixels[i]), second.inverse_depth[i],
                1e-3 * second.inverse_depth[i]);
  }
}

TEST(GroundField, SupportSaysWhereItWasSeen) {
  GroundObservations observations = observe(flat, 40.0), left;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (observations.pixels[i].x() > 320) continue;
    left.pixels.push_back(observations.pixels[i]);
    left.inverse_depth.push_back(observations.inverse_depth[i]);
    left.sigma.push_back(observations.sigma[i]);
  }
  const GroundField field(kCamera, left, kLevel, {});
  EXPECT_GT(field.observed({160, 180}), 5.0);
  EXPECT_EQ(field.observed({500, 180}), 0.0);
  // Yet the plane goes on there.
  EXPECT_NEAR(field.inverse_depth({500, 180}), kCamera.ray({500, 180}).y() / kHeight, 1e-4);
}

TEST(GroundField, BadInputThrows) {
  GroundObservations two;
  two.pixels = {{1, 200}, {100, 200}};
  two.inverse_depth = {0.1, 0.1};
  two.sigma = {0.01, 0.01};
  EXPECT_THROW(GroundField(kCamera, two, kLevel, {}), std::invalid_argument);
  GroundObservations uneven = observe(flat, 40.0);
  uneven.sigma.pop_back();
  EXPECT_THROW(GroundField(kCamera, uneven, kLevel, {}), std::invalid_argument);
  const GroundObservations good = observe(flat, 40.0);
  GroundField field(kCamera, good, kLevel, {});
  EXPECT_THROW(field.update(two, 1), std::invalid_argument);
  EXPECT_THROW(field.covariance({{1, 1}}, Eigen::MatrixXd::Identity(2, 2), {}),
               std::invalid_argument);
  GroundFieldOptions options;
  options.correlation = 0.9;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = {};
  options.iterations = 0;
  EXPECT_THROW(GroundField(kCamera, good, kLevel, options), std::invalid_argument);
}

}  // namespace
}  // namespace camber
