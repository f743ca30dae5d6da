#include "camber/scale/fusion.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

namespace camber {
namespace {

/// Rows of one source among the stacked measurements.
struct Block {
  std::size_t source;
  Eigen::Index first, size;
};

/// Root of the mean squared innovation of one block given all others, standard deviations: with Q
/// the inverse of the joint covariance, the residual less its expectation is Q_bb^-1 (Q r)_b, of
/// covariance Q_bb^-1 (block inversion).
double innovation_given_others(const Eigen::MatrixXd& inverse, const Eigen::VectorXd& residual,
                               const Block& block) {
  const auto rows = Eigen::seqN(block.first, block.size);
  const Eigen::VectorXd weighted = inverse(rows, Eigen::all) * residual;
  const Eigen::MatrixXd own = inverse(rows, rows);
  const double squared = weighted.dot(own.ldlt().solve(weighted));
  return std::sqrt(std::max(0.0, squared) / static_cast<double>(block.size));
}

/// The inverse of the covariance without the block's rows, which become zeros.
void leave_out(const Block& block, Eigen::MatrixXd* inverse) {
  const auto rows = Eigen::seqN(block.first, block.size);
  const Eigen::MatrixXd columns = (*inverse)(Eigen::all, rows);
  const Eigen::MatrixXd own = columns(rows, Eigen::all);
  *inverse -= columns * own.ldlt().solve(columns.transpose());
  (*inverse)(Eigen::all, rows).setZero();
  (*inverse)(rows, Eigen::all).setZero();
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
    for (const CommonError& error : part->common) {
      auto whole = std::find_if(out.common.begin(), out.common.end(),
                                [&](const CommonError& e) { return e.name == error.name; });
      if (whole == out.common.end()) {
        whole = out.common.insert(whole, {error.name, Eigen::VectorXd::Zero(rows)});
      }
      whole->by.segment(row, size) = error.by;
    }
    row += size;
    column += pixels;
  }
  return out;
}

Eigen::VectorXd by_whole_scale(const RoadPosterior& road, const Constraint& constraint) {
  return road.of_constraint(constraint).of_state.bottomRows(1).transpose();
}

std::optional<ImpliedLogScale> implied_log_scale(const RoadPosterior& road,
                                                 const Constraint& constraint) {
  const Eigen::VectorXd by_log_scale = by_whole_scale(road, constraint);
  const Eigen::MatrixXd spread =
      constraint.covariance + road.covariance(road.of_constraint(constraint));
  const Eigen::VectorXd weighted = spread.ldlt().solve(by_log_scale);
  const double information = weighted.dot(by_log_scale);
  if (!(information > 0.0)) return std::nullopt;
  return ImpliedLogScale{weighted.dot(constraint.residual) / information, 1.0 / information};
}

double contradiction_share(double sigmas, double start, double gate) {
  return std::clamp((sigmas - start) / (gate - start), 0.0, 1.0);
}

FusedRoad fuse(const RoadPosterior& road, const std::vector<Constraint>& constraints,
               double common_scale_sigma) {
  const auto joined = [&](const std::vector<const Constraint*>& parts) {
    Constraint out = stacked(parts);
    if (common_scale_sigma > 0.0 && out.size() > 0) {
      const Eigen::VectorXd by_scale = common_scale_sigma * by_whole_scale(road, out);
      out.covariance += by_scale * by_scale.transpose();
      out.common.push_back({"size_population", by_scale});
    }
    return out;
  };
  std::vector<ConstraintReport> reports;
  std::vector<const Constraint*> measured;
  std::vector<Block> blocks;
  Eigen::Index rows = 0;
  for (std::size_t i = 0; i < constraints.size(); ++i) {
    const Constraint& c = constraints[i];
    reports.push_back({c.name, c.source, std::numeric_limits<double>::quiet_NaN(), false, {}});
    if (c.size() == 0) continue;
    if (!c.residual.allFinite() || !c.covariance.allFinite()) {
      reports.back().reason = "its measurements are not finite";
      continue;
    }
    measured.push_back(&c);
    blocks.push_back({i, rows, c.size()});
    rows += c.size();
  }
  const Constraint all = joined(measured);
  const Eigen::MatrixXd spread =
      rows > 0 ? Eigen::MatrixXd(road.covariance(road.of_constraint(all)) + all.covariance)
               : Eigen::MatrixXd();
  Eigen::MatrixXd inverse =
      rows > 0 ? Eigen::MatrixXd(spread.ldlt().solve(Eigen::MatrixXd::Identity(rows, rows)))
               : Eigen::MatrixXd();
  while (!blocks.empty()) {
    std::size_t worst = 0;
    double farthest = -std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < blocks.size(); ++k) {
      const double sigma = innovation_given_others(inverse, all.residual, blocks[k]);
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
    leave_out(blocks[worst], &inverse);
    blocks.erase(blocks.begin() + static_cast<std::ptrdiff_t>(worst));
  }
  std::vector<const Constraint*> accepted;
  for (const Block& b : blocks) {
    reports[b.source].accepted = true;
    accepted.push_back(&constraints[b.source]);
  }
  return {road.conditioned(joined(accepted)), std::move(reports)};
}

}  // namespace camber
