#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "camber/geometry/plane.h"

namespace camber {

/// One plane of a road among others.
struct PlaneGraphNode {
  UncertainPlane plane;  ///< m; one frame for all nodes
  bool on_road = true;   ///< false: no function of the road, joined with no other
  bool spine = false;    ///< along the driven line: a candidate neighbour of every node
};

/// Two neighbouring planes with the road's density of the one given the other and the scale.
struct PlaneGraphLink {
  std::size_t parent = 0, child = 0;  ///< nodes
  bool valid = true;                  ///< false: not part of the graph, see `reason`
  std::string reason;
  double height_step = 0.0;  ///< m, child above parent midway between their centroids, before
  double step_sigma = 0.0;   ///< m, by the joint covariance of both
  /// child = by_parent (parent's changes; change of the log scale) + noise of `covariance`.
  Eigen::Matrix<double, 3, 4> by_parent = Eigen::Matrix<double, 3, 4>::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

struct PlaneGraphOptions {
  /// m: a step above it and 3 standard deviations of it is a kerb or a crest, where neighbours do
  /// not continue each other, > 0.
  double max_step = 0.1;
  int neighbours = 8;  ///< nearest nodes that are candidates, beside the spine, >= 0
};

/// The consistency graph of a road's planes: a normal distribution in which, given the scale, each
/// plane depends on its neighbours alone. The neighbours form a forest, the one of greatest mutual
/// information (Chow and Liu, IEEE Transactions on Information Theory 14, 1968) among the pairs
/// that continue each other. So every plane and every linked pair has the very density that the
/// road gives it: no information is added or counted twice; what is lost is the dependence of
/// distant planes beyond what those between them carry.
struct PlaneGraph {
  std::vector<PlaneGraphLink> links;  ///< valid ones from the root on, then those that are not
  /// 3 rows a node, as its plane's covariance, then the logarithm of the scale.
  Eigen::MatrixXd covariance;

  /// How far changes of the planes and of the log scale (rows as in `covariance`) are from what a
  /// link lets expect: root mean square of 3 in standard deviations.
  double residual_sigma(const PlaneGraphLink& link, const Eigen::VectorXd& changes) const;
};

/// @param joint  covariance of all planes, 3 rows a node, and of the log scale, the last row; > 0.
/// @throws std::invalid_argument if it is of another size.
PlaneGraph make_plane_graph(const std::vector<PlaneGraphNode>& nodes, const Eigen::MatrixXd& joint,
                            const PlaneGraphOptions& options = {});

}  // namespace camber
