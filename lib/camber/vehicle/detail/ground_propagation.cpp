#include "camber/vehicle/detail/ground_propagation.h"

#include <Eigen/LU>
#include <algorithm>

#include "camber/vehicle/detail/linear_algebra.h"

namespace camber::internal {

namespace {

Eigen::MatrixXd submatrix(const Eigen::MatrixXd& all, const std::vector<Eigen::Index>& rows,
                          const std::vector<Eigen::Index>& columns) {
  Eigen::MatrixXd out(rows.size(), columns.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (std::size_t k = 0; k < columns.size(); ++k) {
      out(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = all(rows[i], columns[k]);
    }
  }
  return out;
}

/// The joint prior of all planes and the scale, with the messages.
class JointGround {
 public:
  JointGround(const Eigen::MatrixXd& covariance, const std::vector<GroundNode>& nodes)
      : covariance_(covariance), nodes_(nodes) {
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      for (int a = 0; a < 3; ++a) measured_.push_back(nodes[i].rows[nodes[i].lead] + a);
    }
    measured_.push_back(covariance.rows() - 1);
    among_ = submatrix(covariance, measured_, measured_);
  }

  /// Rows of a node's planes and of the scale.
  std::vector<Eigen::Index> rows_of(std::size_t node) const {
    std::vector<Eigen::Index> out;
    for (const Eigen::Index row : nodes_[node].rows) {
      for (int a = 0; a < 3; ++a) out.push_back(row + a);
    }
    out.push_back(measured_.back());
    return out;
  }

  /// `wanted` rows by the prior and all messages but one: with the messages' information L on the
  /// measured rows, of covariance A, and B between wanted and measured rows, the covariance is
  /// C - B (I + L A)^-1 L B^T.
  GroundCavity cavity(const std::vector<Eigen::Index>& wanted, std::size_t left_out,
                      const std::vector<double>& weights) const {
    const auto size = static_cast<Eigen::Index>(measured_.size());
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd vector = Eigen::VectorXd::Zero(size);
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      if (i == left_out || !nodes_[i].message) continue;
      const GroundMessage& message = *nodes_[i].message;
      const Eigen::Index first = 3 * static_cast<Eigen::Index>(i);
      const Eigen::Index at[4] = {first, first + 1, first + 2, size - 1};
      for (int a = 0; a < 4; ++a) {
        vector[at[a]] += weights[i] * message.information_vector[a];
        for (int b = 0; b < 4; ++b) {
          information(at[a], at[b]) += weights[i] * message.information(a, b);
        }
      }
    }
    const Eigen::MatrixXd between = submatrix(covariance_, wanted, measured_);
    const Eigen::PartialPivLU<Eigen::MatrixXd> lu(
        Eigen::MatrixXd(Eigen::MatrixXd::Identity(size, size) + product(information, among_)));
    GroundCavity out;
    out.mean = between * lu.solve(vector);
    const Eigen::MatrixXd left =
        submatrix(covariance_, wanted, wanted) -
        product(between, lu.solve(product(information, between.transpose())));
    out.covariance = 0.5 * (left + left.transpose());
    return out;
  }

  /// Squared Mahalanobis distance of a node's message from its cavity: with L x = l,
  /// (x - m)^T (L^-1 + C)^-1 (x - m) for an L that may lack rank.
  double squared_distance(std::size_t node, const std::vector<double>& weights) const {
    const auto first = measured_.begin() + 3 * static_cast<std::ptrdiff_t>(node);
    std::vector<Eigen::Index> own(first, first + 3);
    own.push_back(measured_.back());
    const GroundCavity others = cavity(own, node, weights);
    const Eigen::MatrixXd l = nodes_[node].message->information;
    const Eigen::VectorXd off = nodes_[node].message->information_vector - l * others.mean;
    Eigen::MatrixXd spread = l + l * others.covariance * l;
    spread.diagonal().array() += 1e-9 * l.trace();
    return std::max(off.dot(SymmetricFactors(spread).solve(off)), 0.0);
  }

 private:
  const Eigen::MatrixXd& covariance_;
  const std::vector<GroundNode>& nodes_;
  std::vector<Eigen::Index> measured_;  // rows of every lead plane, then of the scale
  Eigen::MatrixXd among_;               // their covariance
};

}  // namespace

GroundPropagation propagate(const Eigen::MatrixXd& covariance, const std::vector<GroundNode>& nodes,
                            double gate) {
  constexpr int kReweightings = 3;
  const JointGround ground(covariance, nodes);
  GroundPropagation out;
  for (const GroundNode& node : nodes) out.weights.push_back(node.message ? 1.0 : 0.0);
  out.squared_distances.assign(nodes.size(), 0.0);
  for (int iteration = 0; iteration < kReweightings; ++iteration) {
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      if (nodes[i].message) out.squared_distances[i] = ground.squared_distance(i, out.weights);
    }
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      if (nodes[i].message) out.weights[i] = 1.0 / (1.0 + out.squared_distances[i] / (gate * gate));
    }
  }
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    out.cavities.push_back(ground.cavity(ground.rows_of(i), i, out.weights));
  }
  return out;
}

}  // namespace camber::internal
