#include "camber/vehicle/detail/ground_propagation.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "camber/core/random.h"

namespace camber::internal {
namespace {

Eigen::MatrixXd random_matrix(std::uint64_t stream, Eigen::Index rows, Eigen::Index columns) {
  const CounterRandom random(3, stream);
  Eigen::MatrixXd out(rows, columns);
  for (Eigen::Index i = 0; i < rows; ++i) {
    for (Eigen::Index k = 0; k < columns; ++k) {
      out(i, k) = random.normal(static_cast<std::uint64_t>(i * columns + k));
    }
  }
  return out;
}

Eigen::MatrixXd random_covariance(std::uint64_t stream, Eigen::Index size) {
  const Eigen::MatrixXd root = random_matrix(stream, size, 2 * size);
  return root * root.transpose() / static_cast<double>(size);
}

// A vehicle with its plane in one dense problem: the message times the plane's prior must be the
// same posterior.
TEST(GroundMessage, IsThatOfTheDenseProblem) {
  constexpr Eigen::Index kParameters = 9, kPose = 2;  // the last: log scale
  const Eigen::MatrixXd hessian = random_covariance(1, kParameters);
  const Eigen::VectorXd gradient = random_matrix(2, kParameters, 1);
  ContactTerms contact;
  contact.residual = random_matrix(3, 3, 1);
  contact.variance = {0.2, 0.3, 0.1};
  contact.by_pose = random_matrix(4, 3, 6);
  contact.by_plane = random_matrix(5, 3, 3);
  const auto message = eliminate_to_ground({hessian, gradient}, kPose, contact);
  ASSERT_TRUE(message);

  // Dense: parameters, then the plane; a prior on (plane, log scale).
  const Eigen::MatrixXd prior = random_covariance(6, 4).inverse();
  Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(3, kParameters + 3);
  rows.block(0, kPose, 3, 6) = contact.by_pose;
  rows.rightCols(3) = -contact.by_plane;
  const Eigen::MatrixXd weight = contact.variance.cwiseInverse().asDiagonal();
  Eigen::MatrixXd dense = rows.transpose() * weight * rows;
  Eigen::VectorXd right = -rows.transpose() * (weight * contact.residual);
  dense.topLeftCorner(kParameters, kParameters) += hessian;
  right.head(kParameters) -= gradient;
  const Eigen::Index at[4] = {kParameters, kParameters + 1, kParameters + 2, kParameters - 1};
  for (int a = 0; a < 4; ++a) {
    for (int b = 0; b < 4; ++b) dense(at[a], at[b]) += prior(a, b);
  }
  const Eigen::MatrixXd covariance = dense.inverse();
  const Eigen::VectorXd mean = covariance * right;
  const Eigen::MatrixXd joined = (message->information + prior).inverse();
  const Eigen::VectorXd joined_mean = joined * message->information_vector;
  for (int a = 0; a < 4; ++a) {
    EXPECT_NEAR(joined_mean[a], mean[at[a]], 1e-9);
    for (int b = 0; b < 4; ++b) EXPECT_NEAR(joined(a, b), covariance(at[a], at[b]), 1e-9);
  }
}

TEST(GroundMessage, NothingFromAProblemWithoutAMinimum) {
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Identity(9, 9);
  hessian(8 - 1, 8 - 1) = -1.0;
  ContactTerms contact;
  contact.residual.setZero();
  contact.variance.setOnes();
  contact.by_pose.setZero();
  contact.by_plane.setIdentity();
  EXPECT_FALSE(eliminate_to_ground({hessian, Eigen::VectorXd::Zero(9)}, 0, contact));
}

constexpr double kGate = 4.0;

struct Scene {
  Eigen::MatrixXd covariance;  // of four planes and the scale
  std::vector<GroundNode> nodes;
};

/// Three vehicles; the last has two planes and measures the second.
Scene make_scene() {
  Scene out;
  out.covariance = random_covariance(7, 13);
  out.nodes.resize(3);
  out.nodes[0].rows = {0};
  out.nodes[1].rows = {3};
  out.nodes[2].rows = {6, 9};
  out.nodes[2].lead = 1;
  for (std::uint64_t i = 0; i < 3; ++i) {
    GroundMessage message;
    message.information = random_covariance(20 + i, 4);
    message.information_vector = message.information * (0.3 * random_matrix(30 + i, 4, 1));
    out.nodes[i].message = message;
  }
  return out;
}

TEST(GroundPropagation, IsDenseInferenceWithoutOnesOwnMessage) {
  const Scene scene = make_scene();
  const auto priors = propagate(scene.covariance, scene.nodes, kGate).cavities;
  ASSERT_EQ(priors.size(), 3u);
  const Eigen::MatrixXd inverse = scene.covariance.inverse();
  for (std::size_t i = 0; i < 3; ++i) {
    // The weights of messages that nothing contradicts are near 1; here they are not to matter.
    Eigen::MatrixXd dense = inverse;
    Eigen::VectorXd right = Eigen::VectorXd::Zero(13);
    for (std::size_t j = 0; j < 3; ++j) {
      if (j == i) continue;
      const GroundNode& s = scene.nodes[j];
      const Eigen::Index first = s.rows[s.lead];
      const Eigen::Index at[4] = {first, first + 1, first + 2, 12};
      for (int a = 0; a < 4; ++a) {
        right[at[a]] += s.message->information_vector[a];
        for (int b = 0; b < 4; ++b) dense(at[a], at[b]) += s.message->information(a, b);
      }
    }
    const Eigen::MatrixXd covariance = dense.inverse();
    const Eigen::VectorXd mean = covariance * right;
    std::vector<Eigen::Index> wanted;
    for (const Eigen::Index row : scene.nodes[i].rows) {
      for (int a = 0; a < 3; ++a) wanted.push_back(row + a);
    }
    wanted.push_back(12);
    for (std::size_t a = 0; a < wanted.size(); ++a) {
      const auto at = static_cast<Eigen::Index>(a);
      const double sigma = std::sqrt(covariance(wanted[a], wanted[a]));
      EXPECT_NEAR(priors[i].mean[at], mean[wanted[a]], 0.1 * sigma) << i << " " << a;
      EXPECT_NEAR(priors[i].covariance(at, at), sigma * sigma, 0.1 * sigma * sigma);
    }
  }
}

// The cavity is found by taking a message away from the sum: however strong it is.
TEST(GroundPropagation, TheOnlyMessageLeavesThePriorAtAnyStrength) {
  for (const double strength : {1e-6, 1.0, 1e3, 1e6, 1e9, 1e12}) {
    SCOPED_TRACE(strength);
    Scene scene = make_scene();
    scene.nodes[0].message.reset();
    scene.nodes[1].message.reset();
    scene.nodes[2].message->information *= strength;
    scene.nodes[2].message->information_vector *= strength;
    const GroundCavity own = propagate(scene.covariance, scene.nodes, kGate).cavities[2];
    const Eigen::MatrixXd prior = scene.covariance.bottomRightCorner(7, 7);
    EXPECT_LT((own.covariance - prior).norm(), 1e-7 * prior.norm());
    EXPECT_LT(own.mean.norm(), 1e-7);
  }
}

TEST(GroundPropagation, NodesWithoutMessageAndPlanesOfTheirOwnChangeNothing) {
  Scene scene = make_scene();
  // Nothing in common with the others, not even the scale.
  scene.covariance.block(0, 3, 3, 10).setZero();
  scene.covariance.block(3, 0, 10, 3).setZero();
  const auto before = propagate(scene.covariance, scene.nodes, kGate).cavities;
  EXPECT_LT(before[0].mean.head(3).norm(), 1e-12);
  EXPECT_LT(
      (before[0].covariance.topLeftCorner(3, 3) - scene.covariance.topLeftCorner(3, 3)).norm(),
      1e-12);
  for (GroundNode& s : scene.nodes) s.message.reset();
  const auto alone = propagate(scene.covariance, scene.nodes, kGate).cavities;
  EXPECT_LT((alone[2].covariance.topLeftCorner(6, 6) - scene.covariance.block(6, 6, 6, 6)).norm(),
            1e-12);
}

// Three vehicles on one plane; one of them contradicts the two others.
TEST(GroundPropagation, AMessageThatContradictsTheRestIsDownWeighted) {
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(10, 10);
  for (int i = 0; i < 3; ++i) {
    for (int k = 0; k < 3; ++k) covariance(3 * i + 2, 3 * k + 2) = 0.04;
    covariance.diagonal().segment<3>(3 * i) += Eigen::Vector3d(1e-4, 1e-4, 4e-4);
  }
  covariance(9, 9) = 1e-4;
  std::vector<GroundNode> nodes(3);
  const auto measures = [&](int i, double height) {
    nodes[static_cast<std::size_t>(i)].rows = {3 * i};
    GroundMessage message;
    message.information(2, 2) = 1.0 / (0.03 * 0.03);
    message.information_vector[2] = height / (0.03 * 0.03);
    nodes[static_cast<std::size_t>(i)].message = message;
  };
  measures(0, 0.10);
  measures(1, 0.12);
  measures(2, 0.90);
  const GroundPropagation result = propagate(covariance, nodes, kGate);
  const auto& cavities = result.cavities;
  EXPECT_NEAR(cavities[0].mean[2], 0.12, 0.06);  // 0.5 if both counted alike
  EXPECT_NEAR(cavities[2].mean[2], 0.11, 0.03);
  EXPECT_LT(cavities[2].covariance(2, 2), 0.05 * 0.05);  // from 0.2
  // The third is 0.79 m off a cavity and a message of 0.03 m each: beyond 15 standard deviations.
  EXPECT_GT(result.squared_distances[2], 15.0 * 15.0);
  EXPECT_LT(result.weights[2], 0.07);
  for (int i = 0; i < 2; ++i) {
    EXPECT_LT(result.squared_distances[static_cast<std::size_t>(i)], 9.0);
    EXPECT_GT(result.weights[static_cast<std::size_t>(i)], 0.6);
  }
}

}  // namespace
}  // namespace camber::internal
