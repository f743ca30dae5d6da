// The consistency graph as a factorisation of the road's posterior.

#include "camber/road/plane_graph.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <stdexcept>
#include <vector>

#include "camber/core/random.h"
#include "camber/road/local_plane.h"
#include "support/made_road.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

const PinholeCamera kCamera{640, 240, 400.0, 400.0, 320.0, 100.0};
constexpr double kHeight = 1.65;

/// A level road, better known to the left.
RoadPosterior level_road() {
  const auto field =
      test::level_field(kCamera, kHeight, [](int u) { return u < 320 ? 0.002 : 0.004; });
  return test::road_posterior(field, Eigen::MatrixXd::Constant(1, 1, 1e-4), kHeight, 1.0, 0.02);
}

struct MadeGraph {
  std::vector<PlaneGraphNode> nodes;
  Eigen::MatrixXd joint;
};

/// Planes of the road along its middle, which are the spine, and under six vehicles.
MadeGraph planes_of(const RoadPosterior& road) {
  MadeGraph out;
  std::vector<RoadFunctionals> parts;
  std::vector<LocalPlane> planes;
  const auto add = [&](double u, double z, bool spine) {
    const LocalPlane plane = fit_local_plane(
        road, kCamera, {u, kCamera.cy + kCamera.fy * kHeight / z}, LocalPlaneOptions());
    ASSERT_NE(plane.status, Status::kFailed);
    out.nodes.push_back({plane.plane, true, spine});
    parts.push_back(road.of_inverse_depths(plane.pixels, plane.by_inverse_depth));
  };
  for (double z = 6.0; z < 34.0; z += 5.0) add(320.0, z, true);
  for (const double z : {8.0, 14.0, 22.0}) {
    add(320.0 - 1200.0 / z, z, false);
    add(320.0 + 1100.0 / z, z + 1.0, false);
  }
  parts.push_back(road.of_log_scale());
  out.joint = road.covariance(joined(parts));
  for (Eigen::Index i = 0; i + 1 < out.joint.rows(); ++i) {
    out.joint(i, i) += i % 3 == 2 ? 1e-4 : 1e-6;  // the planes' own unevenness
  }
  return out;
}

/// Largest difference of blocks in units of the standard deviations on the joint's diagonal.
double farthest(const Eigen::MatrixXd& graph, const Eigen::MatrixXd& joint,
                const std::vector<Eigen::Index>& rows) {
  double out = 0.0;
  for (const Eigen::Index i : rows) {
    for (const Eigen::Index j : rows) {
      out =
          std::max(out, std::abs(graph(i, j) - joint(i, j)) / std::sqrt(joint(i, i) * joint(j, j)));
    }
  }
  return out;
}

std::vector<Eigen::Index> rows_of(const std::vector<std::size_t>& nodes, Eigen::Index scale) {
  std::vector<Eigen::Index> out;
  for (const std::size_t node : nodes) {
    for (int a = 0; a < 3; ++a) out.push_back(3 * static_cast<Eigen::Index>(node) + a);
  }
  out.push_back(scale);
  return out;
}

TEST(PlaneGraph, NodesAndLinkedPairsHaveTheDensityOfTheRoad) {
  const RoadPosterior road = level_road();
  const MadeGraph made = planes_of(road);
  const PlaneGraph graph = make_plane_graph(made.nodes, made.joint);
  const Eigen::Index scale = made.joint.rows() - 1;
  ASSERT_EQ(graph.links.size(), made.nodes.size() - 1);  // one tree: the road has no kerb
  for (std::size_t i = 0; i < made.nodes.size(); ++i) {
    EXPECT_LT(farthest(graph.covariance, made.joint, rows_of({i}, scale)), 1e-9) << i;
  }
  for (const PlaneGraphLink& link : graph.links) {
    EXPECT_TRUE(link.valid);
    EXPECT_LT(farthest(graph.covariance, made.joint, rows_of({link.parent, link.child}, scale)),
              1e-9);
  }
  // Of pairs that are not linked it is part of the correlation.
  std::vector<std::size_t> all(made.nodes.size());
  std::iota(all.begin(), all.end(), 0u);
  const double most = farthest(graph.covariance, made.joint, rows_of(all, scale));
  EXPECT_GT(most, 1e-4);  // it is a factorisation, not a copy
  EXPECT_LT(most, 0.5);
  EXPECT_EQ(graph.covariance.ldlt().info(), Eigen::Success);
  EXPECT_TRUE(graph.covariance.ldlt().isPositive());
}

TEST(PlaneGraph, GivenTheScaleANodeDependsOnItsNeighboursAlone) {
  const MadeGraph made = planes_of(level_road());
  const PlaneGraph graph = make_plane_graph(made.nodes, made.joint);
  // The information of two nodes that are not linked is zero between them.
  const Eigen::VectorXd sigma = graph.covariance.diagonal().cwiseSqrt();
  const Eigen::MatrixXd information =
      (sigma.cwiseInverse().asDiagonal() * graph.covariance * sigma.cwiseInverse().asDiagonal())
          .inverse();
  Eigen::MatrixXi linked = Eigen::MatrixXi::Identity(static_cast<Eigen::Index>(made.nodes.size()),
                                                     static_cast<Eigen::Index>(made.nodes.size()));
  for (const PlaneGraphLink& link : graph.links) {
    linked(static_cast<Eigen::Index>(link.parent), static_cast<Eigen::Index>(link.child)) = 1;
    linked(static_cast<Eigen::Index>(link.child), static_cast<Eigen::Index>(link.parent)) = 1;
  }
  for (Eigen::Index i = 0; i < linked.rows(); ++i) {
    for (Eigen::Index j = 0; j < i; ++j) {
      const double between = information.block<3, 3>(3 * i, 3 * j).cwiseAbs().maxCoeff();
      const double own = std::sqrt(information.block<3, 3>(3 * i, 3 * i).trace() *
                                   information.block<3, 3>(3 * j, 3 * j).trace());
      if (linked(i, j) == 0) {
        EXPECT_LT(between, 1e-6 * own) << i << " " << j;
      } else {
        EXPECT_GT(between, 1e-3 * own) << i << " " << j;
      }
    }
  }
}

/// Level planes in a row, each a step of a random walk from the one before: a chain.
MadeGraph chain(int count, double rise) {
  MadeGraph out;
  const Eigen::Index size = 3 * count + 1;
  Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(size, size);
  for (int i = 0; i < count; ++i) {
    PlaneGraphNode node;
    node.spine = true;
    node.plane.centroid = {0.0, -rise * (i >= count / 2 ? 1.0 : 0.0) + 1.65, 5.0 * i};
    node.plane.plane = Plane::through(node.plane.centroid, {0.0, -1.0, 0.0});
    UncertainPlane::make_axes(node.plane.plane.normal, {0.0, 0.0, 1.0}, &node.plane.axis1,
                              &node.plane.axis2);
    for (int k = 0; k <= i; ++k) {
      for (int a = 0; a < 3; ++a) factor(3 * i + a, 3 * k + a) = a == 2 ? 0.005 : 0.001;
    }
    factor.block<3, 1>(3 * i, size - 1) << 0.0, 0.0, 0.01;  // by the scale
    out.nodes.push_back(node);
  }
  factor(size - 1, size - 1) = 0.02;
  out.joint = factor * factor.transpose();
  for (int i = 0; i < count; ++i) {
    out.nodes[static_cast<std::size_t>(i)].plane.covariance = out.joint.block<3, 3>(3 * i, 3 * i);
  }
  return out;
}

TEST(PlaneGraph, AChainIsFoundAndNothingIsLost) {
  const MadeGraph made = chain(7, 0.0);
  const PlaneGraph graph = make_plane_graph(made.nodes, made.joint);
  ASSERT_EQ(graph.links.size(), 6u);
  for (const PlaneGraphLink& link : graph.links) EXPECT_EQ(link.child, link.parent + 1);
  EXPECT_LT((graph.covariance - made.joint).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(PlaneGraph, AKerbBreaksALinkAndWhatLiesBeyondKeepsTheScale) {
  const MadeGraph made = chain(6, 0.4);
  const PlaneGraph graph = make_plane_graph(made.nodes, made.joint);
  int broken = 0;
  for (const PlaneGraphLink& link : graph.links) {
    const bool across = (link.parent < 3) != (link.child < 3);
    EXPECT_EQ(link.valid, !across);
    if (link.valid) continue;
    ++broken;
    EXPECT_THAT(link.reason, HasSubstr("height step of 0.40 m"));
    EXPECT_NEAR(std::abs(link.height_step), 0.4, 1e-12);
  }
  EXPECT_GE(broken, 1);
  // Across it planes have their scale in common, nothing else.
  const Eigen::Index scale = made.joint.rows() - 1;
  const Eigen::MatrixXd across = graph.covariance.block(0, 9, 9, 9);
  const Eigen::MatrixXd by_scale = graph.covariance.block(0, scale, 9, 1) *
                                   graph.covariance.block(scale, 9, 1, 9) /
                                   graph.covariance(scale, scale);
  EXPECT_LT((across - by_scale).cwiseAbs().maxCoeff(), 1e-12);
  EXPECT_LT((graph.covariance - made.joint).block(9, 9, 10, 10).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(PlaneGraph, ResidualsAreInStandardDeviationsOfTheLink) {
  const MadeGraph made = chain(3, 0.0);
  const PlaneGraph graph = make_plane_graph(made.nodes, made.joint);
  const Eigen::LLT<Eigen::MatrixXd> factor(made.joint);
  double squares = 0.0;
  constexpr int kDraws = 2000;
  for (int draw = 0; draw < kDraws; ++draw) {
    const CounterRandom random(41, static_cast<std::uint64_t>(draw));
    Eigen::VectorXd white(made.joint.rows());
    for (Eigen::Index i = 0; i < white.size(); ++i) {
      white[i] = random.normal(static_cast<std::uint64_t>(i));
    }
    const Eigen::VectorXd changes = factor.matrixL() * white;
    squares += std::pow(graph.residual_sigma(graph.links[0], changes), 2);
  }
  EXPECT_NEAR(squares / kDraws, 1.0, 4.0 * std::sqrt(2.0 / (3.0 * kDraws)));
}

TEST(PlaneGraph, PlanesThatAreNoFunctionsOfTheRoadStandByThemselves) {
  MadeGraph made = chain(4, 0.0);
  made.nodes[3].on_road = made.nodes[3].spine = false;
  made.joint.block(0, 9, 9, 3).setZero();
  made.joint.block(9, 0, 3, 9).setZero();
  made.joint.block(9, 12, 3, 1).setZero();
  made.joint.block(12, 9, 1, 3).setZero();
  const PlaneGraph graph = make_plane_graph(made.nodes, made.joint);
  EXPECT_EQ(graph.links.size(), 2u);
  EXPECT_LT((graph.covariance - made.joint).cwiseAbs().maxCoeff(), 1e-12);
}

TEST(PlaneGraph, ACovarianceOfAnotherSizeIsRejected) {
  const MadeGraph made = chain(3, 0.0);
  EXPECT_THROW(make_plane_graph(made.nodes, made.joint.topLeftCorner(9, 9)), std::invalid_argument);
}

}  // namespace
}  // namespace camber
