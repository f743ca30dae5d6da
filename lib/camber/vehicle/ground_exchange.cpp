#include "camber/vehicle/ground_exchange.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>

namespace camber::internal {

std::optional<GroundMessage> ground_message(const Eigen::MatrixXd& hessian,
                                            const Eigen::VectorXd& gradient, Eigen::Index pose_at,
                                            const StanceTerms& stance) {
  const Eigen::Index rest = hessian.rows() - 1;
  const Eigen::MatrixXd weight = stance.variance.cwiseInverse().asDiagonal();
  const Eigen::MatrixXd m = stance.by_plane, j = stance.by_pose;
  // Of (plane, log scale), of all else, and between them.
  Eigen::MatrixXd kept = Eigen::MatrixXd::Zero(4, 4);
  Eigen::VectorXd kept_right(4);
  kept.topLeftCorner(3, 3) = m.transpose() * weight * m;
  kept(3, 3) = hessian(rest, rest);
  kept_right << m.transpose() * (weight * stance.value), -gradient[rest];
  Eigen::MatrixXd inner = hessian.topLeftCorner(rest, rest);
  Eigen::VectorXd inner_right = -gradient.head(rest);
  inner.block(pose_at, pose_at, 6, 6) += j.transpose() * weight * j;
  inner_right.segment(pose_at, 6) -= j.transpose() * (weight * stance.value);
  Eigen::MatrixXd between = Eigen::MatrixXd::Zero(rest, 4);
  between.block(pose_at, 0, 6, 3) = -j.transpose() * weight * m;
  between.col(3) = hessian.col(rest).head(rest);
  const Eigen::LDLT<Eigen::MatrixXd> factors(inner);
  if (factors.info() != Eigen::Success || !factors.isPositive()) return std::nullopt;
  const Eigen::MatrixXd information = kept - between.transpose() * factors.solve(between);
  const Eigen::VectorXd pull = kept_right - between.transpose() * factors.solve(inner_right);
  if (!information.allFinite() || !pull.allFinite()) return std::nullopt;
  GroundMessage out;
  out.information = 0.5 * (information + information.transpose());
  out.pull = pull;
  // A scale that the vehicle says nothing of may have come out a rounding error below nothing.
  const double least = 1e-9 * out.information.trace();
  const Eigen::LDLT<Eigen::MatrixXd> check(
      Eigen::MatrixXd(out.information + least * Eigen::Matrix4d::Identity()));
  if (!check.isPositive()) return std::nullopt;
  return out;
}

std::vector<GroundPrior> exchange_messages(const Eigen::MatrixXd& covariance,
                                           const std::vector<GroundSpeaker>& speakers) {
  const std::size_t count = speakers.size();
  const Eigen::Index scale_row = covariance.rows() - 1;
  // Rows of the joint covariance that the messages speak of: a plane of each vehicle, the scale.
  std::vector<Eigen::Index> rows;
  for (const GroundSpeaker& s : speakers) {
    for (int i = 0; i < 3; ++i) rows.push_back(s.rows[s.lead] + i);
  }
  rows.push_back(scale_row);
  const auto spoken = static_cast<Eigen::Index>(rows.size());
  const auto part = [&](const std::vector<Eigen::Index>& a, const std::vector<Eigen::Index>& b) {
    Eigen::MatrixXd out(a.size(), b.size());
    for (std::size_t i = 0; i < a.size(); ++i) {
      for (std::size_t k = 0; k < b.size(); ++k) {
        out(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(k)) = covariance(a[i], b[k]);
      }
    }
    return out;
  };
  const Eigen::MatrixXd among = part(rows, rows);

  std::vector<double> weight(count, 1.0);
  // What some rows are by the prior and by what all but one said: with the messages' information L
  // on the spoken rows A, covariance C - B (I + L A)^-1 L B^T.
  const auto known = [&](const std::vector<Eigen::Index>& wanted, std::size_t left_out) {
    Eigen::MatrixXd information = Eigen::MatrixXd::Zero(spoken, spoken);
    Eigen::VectorXd pull = Eigen::VectorXd::Zero(spoken);
    for (std::size_t i = 0; i < count; ++i) {
      if (i == left_out || !speakers[i].said) continue;
      const GroundMessage& said = *speakers[i].said;
      const Eigen::Index first = 3 * static_cast<Eigen::Index>(i);
      const Eigen::Index at[4] = {first, first + 1, first + 2, spoken - 1};
      for (int a = 0; a < 4; ++a) {
        pull[at[a]] += weight[i] * said.pull[a];
        for (int b = 0; b < 4; ++b) {
          information(at[a], at[b]) += weight[i] * said.information(a, b);
        }
      }
    }
    const Eigen::MatrixXd between = part(wanted, rows);
    const Eigen::PartialPivLU<Eigen::MatrixXd> lu(
        Eigen::MatrixXd(Eigen::MatrixXd::Identity(spoken, spoken) + information * among));
    GroundPrior out;
    out.mean = between * lu.solve(pull);
    const Eigen::MatrixXd left =
        part(wanted, wanted) -
        between * lu.solve(Eigen::MatrixXd(information * between.transpose()));
    out.covariance = 0.5 * (left + left.transpose());
    return out;
  };

  // Beyond 4 standard deviations a message loses its weight, as planes do in the fits.
  constexpr double kContradiction = 16.0;
  for (int iteration = 0; iteration < 3; ++iteration) {
    std::vector<double> squared(count, 0.0);
    for (std::size_t i = 0; i < count; ++i) {
      if (!speakers[i].said) continue;
      const auto first = rows.begin() + 3 * static_cast<std::ptrdiff_t>(i);
      std::vector<Eigen::Index> own(first, first + 3);
      own.push_back(scale_row);
      const GroundPrior prior = known(own, i);
      // (x - m)^T (L^-1 + C)^-1 (x - m) with L x = pull, for an L that may lack rank.
      const Eigen::MatrixXd l = speakers[i].said->information;
      const Eigen::VectorXd off = speakers[i].said->pull - l * prior.mean;
      Eigen::MatrixXd spread = l + l * prior.covariance * l;
      spread.diagonal().array() += 1e-9 * l.trace();
      squared[i] = off.dot(Eigen::VectorXd(spread.ldlt().solve(off)));
    }
    for (std::size_t i = 0; i < count; ++i) {
      weight[i] = 1.0 / (1.0 + std::max(squared[i], 0.0) / kContradiction);
    }
  }

  std::vector<GroundPrior> out;
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<Eigen::Index> wanted;
    for (const Eigen::Index row : speakers[i].rows) {
      for (int a = 0; a < 3; ++a) wanted.push_back(row + a);
    }
    wanted.push_back(scale_row);
    out.push_back(known(wanted, i));
  }
  return out;
}

}  // namespace camber::internal
