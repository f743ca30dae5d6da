#include "camber/road/detail/strip_smoother.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "camber/core/random.h"

namespace camber::detail {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

double StripRoughness::bandwidth(double noise, double density, double width) const {
  const double height = noise * noise / (density * width), slope = 12.0 * height / (width * width);
  return std::min({std::pow(height / along, 0.25), std::pow(slope / twist, 0.25),
                   std::sqrt(height * length / (2.0 * level * level)),
                   std::sqrt(slope * length / (2.0 * tilt * tilt))});
}

StripSmoother::StripSmoother(const StripGrid& grid, const std::vector<StripPoint>& points)
    : grid_(grid), points_(points) {
  const double wide = grid_.left - grid_.right;
  nodes_ = std::max<Index>(3, static_cast<Index>(std::ceil(wide / grid_.across - 1e-9)) + 1);
  grid_.across = wide / static_cast<double>(nodes_ - 1);
  const double long_ = std::max(grid_.last - grid_.first, grid_.along);
  rows_ = static_cast<Index>(std::ceil(long_ / grid_.along - 1e-9)) + 2;
  per_row_ = nodes_ + 2;
}

bool StripSmoother::inside(const StripPoint& point) const {
  return point.s >= grid_.first &&
         point.s < grid_.first + static_cast<double>(rows_ - 2) * grid_.along &&
         point.v >= grid_.right && point.v <= grid_.left && std::isfinite(point.z);
}

StripSmoother::Row StripSmoother::row(double s, double v) const {
  const double at = (s - grid_.first) / grid_.along;
  const Index piece = std::clamp<Index>(static_cast<Index>(std::floor(at)), 0, rows_ - 3);
  const double u = at - static_cast<double>(piece);
  const double basis[kAlong] = {0.5 * (1.0 - u) * (1.0 - u), 0.5 + u * (1.0 - u), 0.5 * u * u};
  const double beside =
      std::clamp((v - grid_.right) / grid_.across, 0.0, static_cast<double>(nodes_ - 1));
  const Index node = std::min<Index>(static_cast<Index>(beside), nodes_ - 2);
  const double share = beside - static_cast<double>(node);
  Row out;
  for (int k = 0; k < kAlong; ++k) {
    const Index start = (piece + k) * per_row_;
    const auto i = static_cast<std::size_t>(4 * k);
    out.index[i] = start;
    out.value[i] = basis[k];
    out.index[i + 1] = start + 1;
    out.value[i + 1] = basis[k] * v;
    out.index[i + 2] = start + 2 + node;
    out.value[i + 2] = basis[k] * (1.0 - share);
    out.index[i + 3] = start + 3 + node;
    out.value[i + 3] = basis[k] * share;
  }
  return out;
}

void StripSmoother::set_data(const std::vector<char>& used, const std::vector<double>& heights) {
  const Index size = rows_ * per_row_;
  normal_.set_zero(size, 3 * per_row_ - 1);
  right_ = VectorXd::Zero(size);
  squares_ = sum_log_weights_ = 0.0;
  used_ = 0;
  for (std::size_t i = 0; i < points_.size(); ++i) {
    if (!used[i]) continue;
    const StripPoint& point = points_[i];
    const Row entry = row(point.s, point.v);
    for (std::size_t a = 0; a < kEntries; ++a) {
      const double weighted = point.weight * entry.value[a];
      right_[entry.index[a]] += weighted * heights[i];
      // Indices ascend.
      for (std::size_t b = a; b < kEntries; ++b) {
        normal_.at(entry.index[b], entry.index[a]) += weighted * entry.value[b];
      }
    }
    squares_ += point.weight * heights[i] * heights[i];
    sum_log_weights_ += std::log(point.weight);
    ++used_;
  }
}

double StripSmoother::bend(const StripRoughness& roughness, Index node) const {
  const auto at = static_cast<std::size_t>(node);
  const double here = roughness.across * (at < roughness.bends.size() ? roughness.bends[at] : 1.0);
  const double v = grid_.right + static_cast<double>(node + 1) * grid_.across;
  return std::abs(v) <= 0.51 * grid_.across ? std::max(here, roughness.crest) : here;
}

MatrixXd StripSmoother::shape_precision(const StripRoughness& roughness) const {
  const double step = grid_.across;
  MatrixXd out = MatrixXd::Zero(nodes_, nodes_);
  for (Index j = 0; j + 2 < nodes_; ++j) {
    const double scale = 1.0 / (bend(roughness, j) * step * step * step);
    const double second[3] = {1.0, -2.0, 1.0};
    for (Index a = 0; a < 3; ++a) {
      for (Index b = 0; b < 3; ++b) out(j + a, j + b) += scale * second[a] * second[b];
    }
  }
  // The shape's mean and slope, which the second differences leave free.
  const double half = 0.5 * (grid_.left - grid_.right);
  const auto add = [&](const VectorXd& direction, double sigma) {
    const double norm2 = direction.squaredNorm();
    out += direction * direction.transpose() / (norm2 * norm2 * sigma * sigma);
  };
  add(VectorXd::Ones(nodes_), roughness.level);
  add(VectorXd::LinSpaced(nodes_, -half, half), roughness.tilt);
  return out;
}

void StripSmoother::add_prior(const StripRoughness& roughness, SymmetricBand* matrix) const {
  const double step = grid_.along, cubed = step * step * step;
  const double second[3] = {1.0, -2.0, 1.0};
  for (Index which = 0; which < 2; ++which) {
    const double scale = 1.0 / ((which == 0 ? roughness.along : roughness.twist) * cubed);
    for (Index i = 0; i + 2 < rows_; ++i) {
      for (Index a = 0; a < 3; ++a) {
        for (Index b = 0; b <= a; ++b) {
          matrix->at((i + a) * per_row_ + which, (i + b) * per_row_ + which) +=
              scale * second[a] * second[b];
        }
      }
    }
  }
  const MatrixXd shape = shape_precision(roughness);
  const double phi = std::exp(-step / roughness.length), rest = 1.0 - phi * phi;
  for (Index i = 0; i < rows_; ++i) {
    const bool end = i == 0 || i + 1 == rows_;
    const double own = (end ? 1.0 : 1.0 + phi * phi) / rest, next = -phi / rest;
    const Index here = i * per_row_ + 2, there = here + per_row_;
    for (Index b = 0; b < nodes_; ++b) {
      for (Index a = b; a < nodes_; ++a) matrix->at(here + a, here + b) += own * shape(a, b);
    }
    if (i + 1 == rows_) continue;
    for (Index b = 0; b < nodes_; ++b) {
      for (Index a = 0; a < nodes_; ++a) matrix->at(there + a, here + b) += next * shape(a, b);
    }
  }
}

double StripSmoother::log_prior_determinant(const StripRoughness& roughness) const {
  const auto count = static_cast<double>(rows_ - 2);
  const double cubed = std::pow(grid_.along, 3);
  double sum = -count * (std::log(roughness.along * cubed) + std::log(roughness.twist * cubed));
  const double phi = std::exp(-grid_.along / roughness.length);
  const auto rows = static_cast<double>(rows_), nodes = static_cast<double>(nodes_);
  sum -= nodes * (rows - 1.0) * std::log(1.0 - phi * phi);
  // But for what the hyperparameters do not change.
  sum -= 2.0 * rows * (std::log(roughness.level) + std::log(roughness.tilt));
  for (Index j = 0; j + 2 < nodes_; ++j) sum -= rows * std::log(bend(roughness, j));
  return sum;
}

bool StripSmoother::solve(const StripRoughness& roughness, double noise) {
  roughness_ = roughness;
  noise_ = noise;
  SymmetricBand matrix = normal_;
  const double information = 1.0 / (noise * noise);
  for (Index j = 0; j < matrix.size(); ++j) {
    double* column = matrix.column(j);
    for (Index k = 0; k <= matrix.band(); ++k) column[k] *= information;
  }
  add_prior(roughness, &matrix);
  if (!factor_.factorise(std::move(matrix))) return false;
  solution_ = factor_.solve_vector(information * right_);
  return solution_.allFinite();
}

double StripSmoother::deviance() const {
  const double information = 1.0 / (noise_ * noise_);
  const double squares = information * (squares_ - right_.dot(solution_));
  return static_cast<double>(used_) * 2.0 * std::log(noise_) + factor_.log_determinant() -
         log_prior_determinant(roughness_) + squares;
}

double StripSmoother::degrees_of_freedom() const {
  constexpr Index kDirections = 4;
  const CounterRandom random(0, 77);
  const Index size = rows_ * per_row_;
  MatrixXd x(size, kDirections), product = MatrixXd::Zero(size, kDirections);
  for (Index c = 0; c < kDirections; ++c) {
    for (Index i = 0; i < size; ++i) {
      x(i, c) = random.bits(static_cast<std::uint64_t>(c * size + i)) & 1u ? 1.0 : -1.0;
    }
  }
  for (Index j = 0; j < size; ++j) {
    const double* column = normal_.column(j);
    product.row(j) += column[0] * x.row(j);
    for (Index k = 1; k <= std::min(normal_.band(), size - 1 - j); ++k) {
      if (column[k] == 0.0) continue;
      product.row(j + k) += column[k] * x.row(j);
      product.row(j) += column[k] * x.row(j + k);
    }
  }
  const MatrixXd solved = factor_.solve(x);
  return solved.cwiseProduct(product).sum() / (static_cast<double>(kDirections) * noise_ * noise_);
}

double StripSmoother::height(double s, double v) const {
  const Row entry = row(s, v);
  double sum = 0.0;
  for (std::size_t a = 0; a < kEntries; ++a) sum += entry.value[a] * solution_[entry.index[a]];
  return sum;
}

double StripSmoother::value(const StripFunctional& functional) const {
  double sum = 0.0;
  for (const StripFunctional::Term& term : functional.terms) {
    sum += term.weight * height(term.s, term.v);
  }
  return sum;
}

VectorXd StripSmoother::row_of(const StripFunctional& functional) const {
  VectorXd out = VectorXd::Zero(rows_ * per_row_);
  for (const StripFunctional::Term& term : functional.terms) {
    const Row entry = row(term.s, term.v);
    for (std::size_t a = 0; a < kEntries; ++a) out[entry.index[a]] += term.weight * entry.value[a];
  }
  return out;
}

void StripSmoother::add_bends(std::vector<double>* energy, double* count) const {
  energy->resize(static_cast<std::size_t>(nodes_ - 2), 0.0);
  const SymmetricBand inverse = factor_.inverse_in_band();
  const double phi = std::exp(-grid_.along / roughness_.length), rest = 1.0 - phi * phi;
  const double scale = 1.0 / (roughness_.across * std::pow(grid_.across, 3));
  const double second[3] = {1.0, -2.0, 1.0};
  const auto covariance = [&](Index a, Index b) {
    return a >= b ? inverse.at(a, b) : inverse.at(b, a);
  };
  for (Index j = 0; j + 2 < nodes_; ++j) {
    double sum = 0.0;
    const auto product = [&](Index row, Index other) {
      double mean[2] = {}, spread = 0.0;
      for (Index a = 0; a < 3; ++a) {
        const Index at = row * per_row_ + 2 + j + a;
        mean[0] += second[a] * solution_[at];
        mean[1] += second[a] * solution_[other * per_row_ + 2 + j + a];
        for (Index b = 0; b < 3; ++b) {
          spread += second[a] * second[b] * covariance(at, other * per_row_ + 2 + j + b);
        }
      }
      return mean[0] * mean[1] + spread;
    };
    for (Index i = 0; i < rows_; ++i) {
      const bool end = i == 0 || i + 1 == rows_;
      sum += (end ? 1.0 : 1.0 + phi * phi) / rest * product(i, i);
      if (i + 1 < rows_) sum -= 2.0 * phi / rest * product(i + 1, i);
    }
    (*energy)[static_cast<std::size_t>(j)] += scale * sum;
  }
  *count += static_cast<double>(rows_);
}

MatrixXd StripSmoother::covariance(const std::vector<StripFunctional>& functionals) const {
  MatrixXd rows(rows_ * per_row_, static_cast<Index>(functionals.size()));
  for (std::size_t k = 0; k < functionals.size(); ++k) {
    rows.col(static_cast<Index>(k)) = row_of(functionals[k]);
  }
  return rows.transpose() * factor_.solve(rows);
}

}  // namespace camber::detail
