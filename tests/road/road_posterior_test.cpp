// The road as one Gaussian: conditioning, its views, and their joint covariances.

#include "camber/road/road_posterior.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <vector>

#include "support/made_road.h"

namespace camber {
namespace {

const PinholeCamera kCamera{640, 240, 400.0, 400.0, 320.0, 100.0};
constexpr double kHeight = 1.65;

std::shared_ptr<const GroundField> level_field() {
  return test::level_field(kCamera, kHeight, [](int) { return 0.002; });
}

RoadPosterior level_road(double scale_sigma, double motion_sigma = 0.0) {
  return test::road_posterior(level_field(),
                              Eigen::MatrixXd::Constant(1, 1, motion_sigma * motion_sigma), kHeight,
                              1.0, scale_sigma);
}

/// The metric inverse depth at one pixel, measured.
Constraint depth_constraint(const Eigen::Vector2d& pixel, double residual, double sigma) {
  Constraint out;
  out.name = "depth";
  out.pixels = {pixel};
  out.by_inverse_depth = Eigen::MatrixXd::Identity(1, 1);
  out.residual = Eigen::VectorXd::Constant(1, residual);
  out.covariance = Eigen::MatrixXd::Constant(1, 1, sigma * sigma);
  return out;
}

Eigen::MatrixXd depth_covariance(const RoadPosterior& road,
                                 const std::vector<Eigen::Vector2d>& pixels) {
  const auto n = static_cast<Eigen::Index>(pixels.size());
  return road.covariance(road.of_inverse_depths(pixels, Eigen::MatrixXd::Identity(n, n)));
}

TEST(RoadPosterior, ACertainMeasurementIsMetAndItsNeighboursFollow) {
  const RoadPosterior road = level_road(1e-6);
  const std::vector<Eigen::Vector2d> pixels = {{320, 125}, {320, 130}, {40, 230}};
  const Eigen::MatrixXd before = depth_covariance(road, pixels);
  const double step = 2.0 * std::sqrt(before(0, 0));
  const RoadPosterior after =
      road.conditioned(depth_constraint(pixels[0], step, 1e-3 * std::sqrt(before(0, 0))));
  const auto moved = [&](std::size_t i) {
    return after.inverse_depth(pixels[i]) - road.inverse_depth(pixels[i]);
  };
  EXPECT_NEAR(moved(0), step, 1e-4 * step);
  // Elsewhere by regression on what is measured, and the covariance loses what is explained.
  const double ratio = before(0, 1) / before(0, 0);
  EXPECT_NEAR(moved(1), ratio * step, 1e-4 * step);
  EXPECT_NEAR(moved(2), 0.0, 0.05 * step);
  const Eigen::MatrixXd left = depth_covariance(after, pixels);
  EXPECT_LT(left(0, 0), 1e-4 * before(0, 0));
  EXPECT_NEAR(left(1, 1), before(1, 1) - ratio * before(0, 1), 1e-4 * before(1, 1));
  EXPECT_NEAR(left(2, 2), before(2, 2), 0.01 * before(2, 2));
}

TEST(RoadPosterior, AMeasuredDepthIsSharedBetweenScaleAndGround) {
  const Eigen::Vector2d pixel(320, 170);
  const double own = depth_covariance(level_road(1e-9), {pixel})(0, 0);
  const double sigma = 0.02;
  const RoadPosterior road = level_road(sigma);
  const double rho = road.inverse_depth(pixel);
  const double scale = sigma * sigma * rho * rho;
  EXPECT_NEAR(depth_covariance(road, {pixel})(0, 0), own + scale, 1e-9 * (own + scale));
  const double step = -0.001 * rho;  // a thousandth farther
  const RoadPosterior after =
      road.conditioned(depth_constraint(pixel, step, 1e-4 * std::sqrt(scale)));
  const double share = scale / (own + scale);
  EXPECT_NEAR(std::log(after.metres_per_baseline()), 0.001 * share, 1e-6);
  EXPECT_NEAR(after.scale_sigma(), sigma * std::sqrt(1.0 - share), 1e-4 * sigma);
  EXPECT_NEAR(after.inverse_depth(pixel), 0.999 * rho, 1e-5 * rho);
  EXPECT_LT(depth_covariance(after, {pixel})(0, 0), 1e-4 * (own + scale));
}

TEST(RoadPosterior, OneUpdateWithAllIsTwoUpdatesInTurn) {
  const RoadPosterior road = level_road(0.05, 0.01);
  Constraint first = depth_constraint({300, 140}, 1e-3, 1e-3);
  Constraint second = depth_constraint({340, 180}, -2e-3, 2e-3);
  first.by_log_scale = Eigen::VectorXd::Constant(1, 0.3);
  second.by_ego = Eigen::RowVector3d(0.0, 0.1, 0.5);
  Constraint both = first;
  both.pixels = {first.pixels[0], second.pixels[0]};
  both.by_inverse_depth = Eigen::MatrixXd::Identity(2, 2);
  both.by_ego = Eigen::MatrixXd::Zero(2, 3);
  both.by_ego.row(1) = second.by_ego;
  both.by_log_scale = Eigen::Vector2d(0.3, 0.0);
  both.residual = Eigen::Vector2d(first.residual[0], second.residual[0]);
  both.covariance = Eigen::Vector2d(1e-6, 4e-6).asDiagonal();
  const RoadPosterior at_once = road.conditioned(both);
  const RoadPosterior after_first = road.conditioned(first);
  // The second, linearised where the first has moved the road to.
  const RoadPosterior in_turn = after_first.conditioned(after_first.relinearised(second, road));
  // The functions are linear up to the change of scale, some 3e-3 here.
  EXPECT_NEAR(in_turn.metres_per_baseline(), at_once.metres_per_baseline(), 2e-5);
  EXPECT_NEAR(in_turn.inverse_depth({320, 150}), at_once.inverse_depth({320, 150}), 3e-6);
  EXPECT_NEAR(in_turn.scale_sigma(), at_once.scale_sigma(), 1e-2 * at_once.scale_sigma());
  EXPECT_NEAR(in_turn.ego().plane.offset, at_once.ego().plane.offset, 3e-5);
}

TEST(RoadPosterior, TheEgoPlaneHasTheScaleInItsHeightAndAHeightFixesTheScale) {
  const double sigma = 0.1;
  const RoadPosterior road = level_road(sigma);
  const UncertainPlane ego = road.ego();
  EXPECT_NEAR(ego.plane.offset, kHeight, 1e-12);
  const double own = 0.002 * kHeight;
  EXPECT_NEAR(ego.covariance(2, 2), own * own + std::pow(sigma * kHeight, 2), 1e-9);
  Constraint height;
  height.name = "camera_height";
  height.by_ego = Eigen::RowVector3d(0, 0, -1);
  height.residual = Eigen::VectorXd::Constant(1, 0.05);  // 5 cm higher than thought
  height.covariance = Eigen::MatrixXd::Constant(1, 1, 1e-8);
  const RoadPosterior after = road.conditioned(height);
  EXPECT_NEAR(after.ego().plane.offset, kHeight + 0.05, 2e-3);  // first order: 3 % squared
  EXPECT_NEAR(std::log(after.metres_per_baseline()), 0.05 / kHeight, 1e-4);
  EXPECT_NEAR(after.scale_sigma(), 0.002, 2e-5);  // what the plane itself leaves open
  EXPECT_LT(after.ego().covariance(2, 2), 1e-6);
}

TEST(RoadPosterior, TheMotionsErrorsMoveFieldAndEgoPlaneTogether) {
  // The shared parameter lengthens the field's depths and raises the ego plane in proportion.
  EgoPlaneEstimate estimate;
  estimate.plane.plane = {{0, -1, 0}, kHeight};
  estimate.plane.centroid = {0, kHeight, 0};
  UncertainPlane::make_axes({0, -1, 0}, {0, 0, 1}, &estimate.plane.axis1, &estimate.plane.axis2);
  const double motion = 0.05;
  estimate.shared_jacobian = Eigen::Vector3d(0, 0, kHeight);
  estimate.plane.covariance = Eigen::Vector3d(1e-8, 1e-8, 1e-8).asDiagonal();
  estimate.plane.covariance(2, 2) += std::pow(motion * kHeight, 2);
  const RoadPosterior road(level_field(), Eigen::MatrixXd::Constant(1, 1, motion * motion), 1.0,
                           estimate, 1.0, 1e-6);
  const Eigen::Vector2d pixel(320, 200);
  const RoadFunctionals depth = road.of_inverse_depths({pixel}, Eigen::MatrixXd::Identity(1, 1));
  const Eigen::MatrixXd cross = road.covariance(depth, road.of_ego());
  const double correlation =
      cross(0, 2) / std::sqrt(road.covariance(depth)(0, 0) * road.ego().covariance(2, 2));
  EXPECT_GT(correlation, 0.9);
  // A certain depth then tells the height under the camera.
  const double rho = road.inverse_depth(pixel);
  const RoadPosterior after = road.conditioned(depth_constraint(pixel, 0.02 * rho, 1e-4 * rho));
  EXPECT_LT(after.ego().covariance(2, 2), 0.2 * road.ego().covariance(2, 2));
  EXPECT_NEAR(after.ego().plane.offset, (1.0 - 0.02) * kHeight, 0.003 * kHeight);
}

TEST(RoadPosterior, CovariancesStayPositive) {
  RoadPosterior road = level_road(0.05, 0.02);
  const std::vector<Eigen::Vector2d> pixels = {{100, 130}, {320, 130}, {320, 200}, {500, 220}};
  for (const Eigen::Vector2d& pixel : pixels) {
    road = road.conditioned(depth_constraint(pixel, 1e-4, 1e-4));
  }
  std::vector<RoadFunctionals> parts = {
      road.of_inverse_depths(pixels, Eigen::MatrixXd::Identity(4, 4)), road.of_ego(),
      road.of_log_scale()};
  const Eigen::MatrixXd joint = road.covariance(joined(parts));
  const Eigen::VectorXd scale = joint.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd correlation = scale.asDiagonal() * joint * scale.asDiagonal();
  EXPECT_GT(Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(correlation).eigenvalues().minCoeff(),
            -1e-9);
}

TEST(RoadPosterior, RejectsWhatDoesNotFit) {
  const auto field = level_field();
  EXPECT_THROW(test::road_posterior(field, {}, kHeight, 0.0, 0.1), std::invalid_argument);
  EXPECT_THROW(test::road_posterior(field, {}, kHeight, 1.0, 0.0), std::invalid_argument);
  EXPECT_THROW(test::road_posterior(field, Eigen::MatrixXd::Identity(2, 2), kHeight, 1.0, 0.1),
               std::invalid_argument);
  const RoadPosterior road = level_road(0.1);
  Constraint bad = depth_constraint({320, 150}, 0.0, 1.0);
  bad.residual = Eigen::VectorXd::Zero(2);
  EXPECT_THROW(road.conditioned(bad), std::invalid_argument);
  bad = depth_constraint({320, 150}, 0.0, 1.0);
  bad.by_ego = Eigen::RowVector2d(1, 2);
  EXPECT_THROW(road.conditioned(bad), std::invalid_argument);
  EXPECT_EQ(road.conditioned(Constraint()).metres_per_baseline(), road.metres_per_baseline());
}

}  // namespace
}  // namespace camber
