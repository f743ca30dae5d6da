#include "camber/scale/fusion.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

namespace camber {
namespace {

/// Rows of one source among the stacked measurements.
struct Block {
  std::size_t source;
  Eigen::Index first, size;
};

Eigen::VectorXi rows_of(const std::vector<Block>& blocks) {
  Eigen::Index count = 0;
  for (const Block& b : blocks) count += b.size;
  Eigen::VectorXi out(count);
  Eigen::Index at = 0;
  for (const Block& b : blocks) {
    for (Eigen::Index i = 0; i < b.size; ++i) out[at++] = static_cast<int>(b.first + i);
  }
  return out;
}

/// Root of the mean squared innovation of one block given others, standard deviations.
double innovation_given(const Eigen::MatrixXd& spread, const Eigen::VectorXd& residual,
                        const Block& block, const std::vector<Block>& others) {
  Eigen::VectorXd missing = residual.segment(block.first, block.size);
  Eigen::MatrixXd own = spread.block(block.first, block.first, block.size, block.size);
  if (!others.empty()) {
    const Eigen::VectorXi rows = rows_of(others);
    const Eigen::MatrixXd among = spread(rows, rows);
    const Eigen::MatrixXd between = spread(rows, Eigen::seqN(block.first, block.size));
    const Eigen::LDLT<Eigen::MatrixXd> ldlt(among);
    const Eigen::MatrixXd gain = ldlt.solve(between);
    missing -= gain.transpose() * residual(rows);
    own -= between.transpose() * gain;
  }
  const double squared = missing.dot(own.ldlt().solve(missing));
  return std::sqrt(std::max(0.0, squared) / static_cast<double>(block.size));
}

}  // namespace

Constraint stacked(const std::vector<const Constraint*>& parts) {
  Constraint out;
  Eigen::Index rows = 0, columns = 0;
  for (const Constraint* part : parts) {
    rows += part->size();
    columns += static_cast<Eigen::Index>(part->pixels.size());
  }
  out.by_inverse_depth = Eigen::MatrixXd::Zero(rows, columns);
  out.by_ego = Eigen::MatrixXd::Zero(rows, 3);
  out.by_log_scale = Eigen::VectorXd::Zero(rows);
  out.residual.resize(rows);
  out.covariance = Eigen::MatrixXd::Zero(rows, rows);
  Eigen::Index row = 0, column = 0;
  for (const Constraint* part : parts) {
    const Eigen::Index size = part->size();
    const auto pixels = static_cast<Eigen::Index>(part->pixels.size());
    out.pixels.insert(out.pixels.end(), part->pixels.begin(), part->pixels.end());
    if (pixels > 0) out.by_inverse_depth.block(row, column, size, pixels) = part->by_inverse_depth;
    if (part->by_ego.size() > 0) out.by_ego.middleRows(row, size) = part->by_ego;
    if (part->by_log_scale.size() > 0) out.by_log_scale.segment(row, size) = part->by_log_scale;
    out.residual.segment(row, size) = part->residual;
    out.covariance.block(row, row, size, size) = part->covariance;
    row += size;
    column += pixels;
  }
  return out;
}

std::optional<ImpliedLogScale> implied_log_scale(const RoadPosterior& road,
                                                 const Constraint& constraint) {
  const RoadFunctionals functionals = road.of_constraint(constraint);
  const Eigen::VectorXd by_log_scale = functionals.of_state.bottomRows(1).transpose();
  const Eigen::MatrixXd spread = constraint.covariance + road.covariance(functionals);
  const Eigen::VectorXd weighted = spread.ldlt().solve(by_log_scale);
  const double information = weighted.dot(by_log_scale);
  if (!(information > 0.0)) return std::nullopt;
  return ImpliedLogScale{weighted.dot(constraint.residual) / information, 1.0 / information};
}

FusedRoad fuse(const RoadPosterior& road, const std::vector<Constraint>& constraints) {
  std::vector<ConstraintReport> reports;
  std::vector<const Constraint*> measured;
  std::vector<Block> blocks;
  Eigen::Index rows = 0;
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    const Constraint& c = constraints[i];
    reports.push_back({c.name, c.source, std::numeric_limits<double>::quiet_NaN(), false, {}});
    if (c.size() == 0) continue;
    measured.push_back(&c);
    blocks.push_back({i, rows, c.size()});
    rows += c.size();
  }
  const Constraint all = stacked(measured);
  const Eigen::MatrixXd spread =
      rows > 0 ? Eigen::MatrixXd(road.covariance(road.of_constraint(all)) + all.covariance)
               : Eigen::MatrixXd();
  const auto judge = [&](std::size_t k) {
    std::vector<Block> others = blocks;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(k));
    return innovation_given(spread, all.residual, blocks[k], others);
  };
  while (!blocks.empty()) {
    std::size_t worst = 0;
    double farthest = -std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < blocks.size(); ++k) {
      const double sigma = judge(k);
      reports[blocks[k].source].residual_sigma = sigma;
      const double beyond = sigma - constraints[blocks[k].source].gate;
      if (!(beyond <= farthest)) {
        farthest = beyond;
        worst = k;
      }
    }
    if (farthest <= 0.0) break;
    ConstraintReport& rejected = reports[blocks[worst].source];
    rejected.reason = fmt::format("{:.1f} standard deviations off what the other sources expect",
                                  rejected.residual_sigma);
    blocks.erase(blocks.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  std::vector<const Constraint*> accepted;
  for (const Block& b : blocks) {
    reports[b.source].accepted = true;
    accepted.push_back(&constraints[b.source]);
  }
  return {road.conditioned(stacked(accepted)), std::move(reports)};
}

}  // namespace camber
