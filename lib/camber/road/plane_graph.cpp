#include "camber/road/plane_graph.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>
#include <utility>

namespace camber {
namespace {

constexpr double kUnlinked = -1.0;  // mutual information of nodes that may not be joined
constexpr double kStepGate = 3.0;   // standard deviations of a height step

Eigen::Index row_of(std::size_t node) { return 3 * static_cast<Eigen::Index>(node); }

/// Twice the logarithm of the product of a factor's diagonal: that of the matrix's determinant.
double log_determinant(const Eigen::Matrix3d& matrix) {
  return 2.0 * Eigen::LLT<Eigen::Matrix3d>(matrix).matrixLLT().diagonal().array().log().sum();
}

class GraphMaker {
 public:
  GraphMaker(const std::vector<PlaneGraphNode>& nodes, const Eigen::MatrixXd& joint,
             const PlaneGraphOptions& options)
      : nodes_(nodes), joint_(joint), options_(options), scale_(joint.rows() - 1) {}

  PlaneGraph make() {
    find_candidates();
    grow_forest();
    out_.links.insert(out_.links.end(), broken_.begin(), broken_.end());
    return std::move(out_);
  }

 private:
  /// Pairs that may be neighbours: near each other, or one of them on the spine.
  void find_candidates() {
    const std::size_t count = nodes_.size();
    std::set<std::pair<std::size_t, std::size_t>> pairs;
    std::vector<std::pair<double, std::size_t>> others;
    for (std::size_t i = 0; i < count; ++i) {
      if (!nodes_[i].on_road) continue;
      others.clear();
      for (std::size_t j = 0; j < count; ++j) {
        if (j == i || !nodes_[j].on_road) continue;
        if (nodes_[j].spine) pairs.insert(std::minmax(i, j));
        others.emplace_back((nodes_[i].plane.centroid - nodes_[j].plane.centroid).squaredNorm(), j);
      }
      const std::size_t nearest =
          std::min(others.size(), static_cast<std::size_t>(options_.neighbours));
      std::partial_sort(others.begin(), others.begin() + static_cast<std::ptrdiff_t>(nearest),
                        others.end());
      for (std::size_t n = 0; n < nearest; ++n) pairs.insert(std::minmax(i, others[n].second));
    }
    candidates_.resize(count);
    for (const auto& [a, b] : pairs) {
      const PlaneGraphLink link = measured(a, b);
      if (!link.valid) {
        broken_.push_back(link);
        continue;
      }
      const double information = mutual_information(a, b);
      candidates_[a].emplace_back(b, information);
      candidates_[b].emplace_back(a, information);
    }
    keep_nearest_broken();
  }

  /// A link of two nodes with the step between them.
  PlaneGraphLink measured(std::size_t a, std::size_t b) const {
    const UncertainPlane &from = nodes_[a].plane, &to = nodes_[b].plane;
    PlaneGraphLink out;
    out.parent = a;
    out.child = b;
    const Eigen::Vector3d between = 0.5 * (from.centroid + to.centroid);
    out.height_step = from.plane.signed_distance(between) - to.plane.signed_distance(between);
    Eigen::Matrix<double, 1, 6> by_both;
    by_both << -from.height_jacobian(between), to.height_jacobian(between);
    Eigen::Matrix<double, 6, 6> both;
    both << joint_.block<3, 3>(row_of(a), row_of(a)), joint_.block<3, 3>(row_of(a), row_of(b)),
        joint_.block<3, 3>(row_of(b), row_of(a)), joint_.block<3, 3>(row_of(b), row_of(b));
    out.step_sigma = std::sqrt(std::max(0.0, (by_both * both * by_both.transpose()).value()));
    if (std::abs(out.height_step) > options_.max_step + kStepGate * out.step_sigma) {
      out.valid = false;
      out.reason = fmt::format("height step of {:.2f} m", std::abs(out.height_step));
    }
    return out;
  }

  /// Of a node's broken links the shortest alone: kerbs are seen from many nodes.
  void keep_nearest_broken() {
    std::map<std::size_t, std::pair<double, std::size_t>> nearest;
    for (std::size_t i = 0; i < broken_.size(); ++i) {
      const double length =
          (nodes_[broken_[i].parent].plane.centroid - nodes_[broken_[i].child].plane.centroid)
              .norm();
      for (const std::size_t node : {broken_[i].parent, broken_[i].child}) {
        const auto found = nearest.find(node);
        if (found == nearest.end() || length < found->second.first) nearest[node] = {length, i};
      }
    }
    std::set<std::size_t> wanted;
    for (const auto& [node, link] : nearest) wanted.insert(link.second);
    std::vector<PlaneGraphLink> left;
    for (const std::size_t i : wanted) left.push_back(broken_[i]);
    broken_ = std::move(left);
  }

  /// Covariance of two nodes given the scale.
  Eigen::Matrix3d given_scale(std::size_t a, std::size_t b) const {
    return joint_.block<3, 3>(row_of(a), row_of(b)) - joint_.block<3, 1>(row_of(a), scale_) *
                                                          joint_.block<1, 3>(scale_, row_of(b)) /
                                                          joint_(scale_, scale_);
  }

  /// Of two nodes' normal distributions given the scale, in nats.
  double mutual_information(std::size_t a, std::size_t b) const {
    const Eigen::Matrix3d of_a = given_scale(a, a), of_b = given_scale(b, b);
    const Eigen::Matrix3d between = given_scale(a, b);
    const Eigen::Matrix3d left =
        of_b - between.transpose() * Eigen::LLT<Eigen::Matrix3d>(of_a).solve(between);
    const double information = 0.5 * (log_determinant(of_b) - log_determinant(left));
    return std::isfinite(information) ? std::max(0.0, information) : kUnlinked;
  }

  /// Prim's algorithm; a tree that cannot grow leaves the next node as another root.
  void grow_forest() {
    const std::size_t count = nodes_.size();
    constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
    std::vector<double> best(count, kUnlinked);
    std::vector<std::size_t> parent(count, kNone);
    std::vector<char> in(count, 0);
    out_.covariance = Eigen::MatrixXd::Zero(joint_.rows(), joint_.cols());
    out_.covariance(scale_, scale_) = joint_(scale_, scale_);
    std::vector<std::size_t> order;
    for (std::size_t step = 0; step < count; ++step) {
      std::size_t next = kNone;
      for (std::size_t i = 0; i < count; ++i) {
        if (in[i]) continue;
        if (next == kNone || best[i] > best[next]) next = i;
      }
      add_node(next, parent[next] == kNone ? nullptr : &parent[next], order);
      in[next] = 1;
      order.push_back(next);
      for (const auto& [other, information] : candidates_[next]) {
        if (in[other] || information <= best[other]) continue;
        best[other] = information;
        parent[other] = next;
      }
    }
  }

  /// The covariance with all nodes before, by regression on the parent and the scale.
  void add_node(std::size_t node, const std::size_t* parent,
                const std::vector<std::size_t>& before) {
    std::vector<Eigen::Index> given;
    if (parent) given = {row_of(*parent), row_of(*parent) + 1, row_of(*parent) + 2};
    given.push_back(scale_);
    const Eigen::Index row = row_of(node);
    const std::vector<Eigen::Index> own = {row, row + 1, row + 2};
    const Eigen::MatrixXd of_given = joint_(given, given);
    const Eigen::MatrixXd by_given =
        of_given.ldlt().solve(Eigen::MatrixXd(joint_(given, own))).transpose();
    std::vector<Eigen::Index> known;
    for (const std::size_t other : before) {
      for (int a = 0; a < 3; ++a) known.push_back(row_of(other) + a);
    }
    known.push_back(scale_);
    const Eigen::MatrixXd with = by_given * Eigen::MatrixXd(out_.covariance(given, known));
    out_.covariance(own, known) = with;
    out_.covariance(known, own) = with.transpose();
    out_.covariance(own, own) = joint_(own, own);
    if (!parent) return;
    PlaneGraphLink link = measured(*parent, node);
    link.by_parent = by_given;
    const Eigen::Matrix3d left = joint_(own, own) - by_given * Eigen::MatrixXd(joint_(given, own));
    link.covariance = 0.5 * (left + left.transpose());
    out_.links.push_back(std::move(link));
  }

  const std::vector<PlaneGraphNode>& nodes_;
  const Eigen::MatrixXd& joint_;
  const PlaneGraphOptions& options_;
  Eigen::Index scale_;
  std::vector<std::vector<std::pair<std::size_t, double>>> candidates_;  // and mutual information
  std::vector<PlaneGraphLink> broken_;
  PlaneGraph out_;
};

}  // namespace

double PlaneGraph::residual_sigma(const PlaneGraphLink& link,
                                  const Eigen::VectorXd& changes) const {
  Eigen::Vector4d given;
  given << changes.segment<3>(row_of(link.parent)), changes[changes.size() - 1];
  const Eigen::Vector3d off = changes.segment<3>(row_of(link.child)) - link.by_parent * given;
  const double squared = off.dot(link.covariance.ldlt().solve(off));
  return std::sqrt(std::max(0.0, squared) / 3.0);
}

PlaneGraph make_plane_graph(const std::vector<PlaneGraphNode>& nodes, const Eigen::MatrixXd& joint,
                            const PlaneGraphOptions& options) {
  if (joint.rows() != row_of(nodes.size()) + 1 || joint.cols() != joint.rows()) {
    throw std::invalid_argument(fmt::format("joint: {} x {}, must be {} square", joint.rows(),
                                            joint.cols(), row_of(nodes.size()) + 1));
  }
  return GraphMaker(nodes, joint, options).make();
}

}  // namespace camber
