#include "camber/vehicle/detail/ground_propagation.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
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

/// Whether a posterior's covariance is by more than rounding another without one of its messages:
/// the shares of its information that are not the message's are 1 less the eigenvalues of C^T L C
/// with P = C C^T.
bool leaves_enough(const Eigen::Matrix4d& posterior, const Eigen::Matrix4d& information) {
  constexpr double kLeast = 1e-6;
  const Eigen::LLT<Eigen::Matrix4d> llt(posterior);
  if (llt.info() != Eigen::Success) return false;
  const Eigen::Matrix4d c = llt.matrixL();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> shares(c.transpose() * information * c,
                                                              Eigen::EigenvaluesOnly);
  return 1.0 - shares.eigenvalues().maxCoeff() > kLeast;
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

  /// Weights of the messages from now on.
  void set_weights(const std::vector<double>& weights) {
    weights_ = weights;
    Sum all = sum_but(nodes_.size());
    const Eigen::PartialPivLU<Eigen::MatrixXd> lu(identity_plus(all.information));
    gain_ = lu.solve(all.information);
    vector_ = lu.solve(all.vector);
  }

  /// `wanted` rows, the node's measured ones among them, by the prior and all messages but the
  /// node's own: those by all messages, its own taken away again (a downdate by the matrix
  /// inversion lemma). With P and mu by all, P_o their columns of the measured rows, P_oo the block
  /// of these and the message's information L and vector l, P' = P + P_o L (I - P_oo L)^-1 P_o^T.
  GroundCavity cavity(const std::vector<Eigen::Index>& wanted, std::size_t node) const {
    const Eigen::MatrixXd between = submatrix(covariance_, wanted, measured_);
    GroundCavity out;
    out.mean = between * vector_;
    out.covariance = submatrix(covariance_, wanted, wanted) -
                     product(between, product(gain_, between.transpose()));
    if (nodes_[node].message && weights_[node] > 0.0) {
      const std::vector<Eigen::Index> own = own_rows(node);
      std::vector<Eigen::Index> at;
      for (const Eigen::Index row : own) {
        at.push_back(std::find(wanted.begin(), wanted.end(), row) - wanted.begin());
      }
      const Eigen::MatrixXd columns = out.covariance(Eigen::all, at);
      const Eigen::Matrix4d block = out.covariance(at, at);
      const Eigen::Matrix4d l = weights_[node] * nodes_[node].message->information;
      if (!leaves_enough(block, l)) return cavity_without(wanted, node);
      const Eigen::Matrix4d m = l * (Eigen::Matrix4d::Identity() - block * l).inverse();
      const Eigen::Vector4d vector = weights_[node] * nodes_[node].message->information_vector;
      const Eigen::Vector4d measured = out.mean(at);
      out.mean += columns * (m * measured - vector - m * block * vector);
      out.covariance += columns * m * columns.transpose();
    }
    out.covariance = (0.5 * (out.covariance + out.covariance.transpose())).eval();
    return out;
  }

  /// Squared Mahalanobis distance of a node's message from its cavity: with L x = l,
  /// (x - m)^T (L^-1 + C)^-1 (x - m) for an L that may lack rank.
  double squared_distance(std::size_t node) const {
    const GroundCavity others = cavity(own_rows(node), node);
    const Eigen::MatrixXd l = nodes_[node].message->information;
    const Eigen::VectorXd off = nodes_[node].message->information_vector - l * others.mean;
    Eigen::MatrixXd spread = l + l * others.covariance * l;
    spread.diagonal().array() += 1e-9 * l.trace();
    return std::max(off.dot(SymmetricFactors(spread).solve(off)), 0.0);
  }

 private:
  /// Messages added up, on the measured rows.
  struct Sum {
    Eigen::MatrixXd information;
    Eigen::VectorXd vector;
  };

  Sum sum_but(std::size_t left_out) const {
    const auto size = static_cast<Eigen::Index>(measured_.size());
    Sum out{Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      if (i == left_out || !nodes_[i].message) continue;
      const GroundMessage& message = *nodes_[i].message;
      const Eigen::Index first = 3 * static_cast<Eigen::Index>(i);
      const Eigen::Index at[4] = {first, first + 1, first + 2, size - 1};
      for (int a = 0; a < 4; ++a) {
        out.vector[at[a]] += weights_[i] * message.information_vector[a];
        for (int b = 0; b < 4; ++b) {
          out.information(at[a], at[b]) += weights_[i] * message.information(a, b);
        }
      }
    }
    return out;
  }

  Eigen::MatrixXd identity_plus(const Eigen::MatrixXd& information) const {
    return Eigen::MatrixXd::Identity(information.rows(), information.rows()) +
           product(information, among_);
  }

  std::vector<Eigen::Index> own_rows(std::size_t node) const {
    const auto first = measured_.begin() + 3 * static_cast<std::ptrdiff_t>(node);
    std::vector<Eigen::Index> own(first, first + 3);
    own.push_back(measured_.back());
    return own;
  }

  /// The same as cavity() from the other messages: with their information L on the measured rows,
  /// of covariance A, and B between wanted and measured rows, C - B (I + L A)^-1 L B^T.
  GroundCavity cavity_without(const std::vector<Eigen::Index>& wanted, std::size_t node) const {
    const Sum others = sum_but(node);
    const Eigen::MatrixXd between = submatrix(covariance_, wanted, measured_);
    const Eigen::PartialPivLU<Eigen::MatrixXd> lu(identity_plus(others.information));
    GroundCavity out;
    out.mean = between * lu.solve(others.vector);
    const Eigen::MatrixXd left =
        submatrix(covariance_, wanted, wanted) -
        product(between, lu.solve(product(others.information, between.transpose())));
    out.covariance = 0.5 * (left + left.transpose());
    return out;
  }

  const Eigen::MatrixXd& covariance_;
  const std::vector<GroundNode>& nodes_;
  std::vector<Eigen::Index> measured_;  // rows of every lead plane, then of the scale
  Eigen::MatrixXd among_;               // their covariance
  std::vector<double> weights_;
  Eigen::MatrixXd gain_;    // (I + L A)^-1 L of all messages
  Eigen::VectorXd vector_;  // (I + L A)^-1 l
};

}  // namespace

GroundPropagation propagate(const Eigen::MatrixXd& covariance, const std::vector<GroundNode>& nodes,
                            double gate) {
  constexpr int kReweightings = 3;
  JointGround ground(covariance, nodes);
  GroundPropagation out;
  for (const GroundNode& node : nodes) out.weights.push_back(node.message ? 1.0 : 0.0);
  out.squared_distances.assign(nodes.size(), 0.0);
  for (int iteration = 0; iteration < kReweightings; ++iteration) {
    ground.set_weights(out.weights);
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      if (nodes[i].message) out.squared_distances[i] = ground.squared_distance(i);
    }
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      if (nodes[i].message) out.weights[i] = 1.0 / (1.0 + out.squared_distances[i] / (gate * gate));
    }
  }
  ground.set_weights(out.weights);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    out.cavities.push_back(ground.cavity(ground.rows_of(i), i));
  }
  return out;
}

}  // namespace camber::internal
