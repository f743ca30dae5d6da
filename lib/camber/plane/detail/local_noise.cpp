#include "camber/plane/detail/local_noise.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "camber/core/random.h"
#include "camber/core/threads.h"

namespace camber::detail {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

/// Deviation of the points near a plane from a quadratic surface over it: curved ground is not
/// noise. That from the plane where there are too few points.
double curved_deviation(const PointArrays& s, std::size_t begin, std::size_t count,
                        const PivotPlane& plane, double deviation, double least) {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;
  Vector3d a, b;
  UncertainPlane::make_axes(plane.n, Vector3d::UnitX(), &a, &b);
  const Vector3d from = s.point(begin);
  double out = deviation;
  Vector6 surface = Vector6::Zero();
  for (int round = 0; round < 2; ++round) {
    Matrix6 normal = Matrix6::Zero();
    Vector6 right = Vector6::Zero();
    double squares = 0.0, used = 0.0;
    for (std::size_t k = 0; k < count; ++k) {
      const Vector3d p = s.point(begin + k) - from;
      const double u = a.dot(p), v = b.dot(p), r = plane.distance(s.point(begin + k));
      Vector6 row;
      row << 1.0, u, v, u * u, u * v, v * v;
      if (!(std::abs(r - row.dot(surface)) < 3.0 * out)) continue;
      normal.selfadjointView<Eigen::Lower>().rankUpdate(row);
      right += r * row;
      squares += r * r;
      used += 1.0;
    }
    if (used < 10.0) return deviation;
    const Matrix6 full = normal.selfadjointView<Eigen::Lower>();
    const Eigen::LDLT<Matrix6> solver(full);
    const Vector6 solution = solver.solve(right);
    if (solver.info() != Eigen::Success || !solution.allFinite()) return deviation;
    surface = solution;
    const double rest = std::max(squares - solution.dot(right), 0.0);
    out = std::max(std::sqrt(rest / (used - 6.0)), least);
  }
  return std::min(out, deviation);
}

/// About the quantile at 0.35: the mean of a range, which no single value decides.
/// @param sorted  not empty
double mean_of_quiet(const std::vector<float>& sorted) {
  const double count = static_cast<double>(sorted.size());
  double sum = 0.0, weight = 0.0;
  for (std::size_t k = 0; k < sorted.size(); ++k) {
    // How much of the k-th of the parts of [0, 1] lies within the range.
    const double share = std::min(static_cast<double>(k + 1), 0.45 * count) -
                         std::max(static_cast<double>(k), 0.25 * count);
    sum += std::max(share, 0.0) * static_cast<double>(sorted[k]);
    weight += std::max(share, 0.0);
  }
  return sum / weight;
}

/// That of the neighbourhoods' deviations. Where most neighbourhoods lie on no plane at all (trees
/// and facades around a scanner) that of the others, which are quieter by far.
/// @param values  not empty
double typical_of(std::vector<float> values) {
  constexpr double kByFar = 4.0;
  constexpr std::size_t kFewest = 3;
  std::sort(values.begin(), values.end());
  for (;;) {
    const double typical = mean_of_quiet(values);
    const auto below = static_cast<std::size_t>(
        std::lower_bound(values.begin(), values.end(), static_cast<float>(typical)) -
        values.begin());
    if (below < kFewest || below == values.size() ||
        !(typical > kByFar * static_cast<double>(values[below / 2]))) {
      return typical;
    }
    values.resize(below);
  }
}

/// The plane of the ground in one neighbourhood, and how far its points scatter about it.
class NeighbourhoodFit {
 public:
  NeighbourhoodFit(const PointArrays& points, const std::vector<std::uint64_t>& keys,
                   const Vector3d& up, double max_tilt, double least, std::uint64_t seed)
      : s_(points),
        keys_(keys),
        up_(up),
        least_cosine_(std::cos(std::min(max_tilt, 1.5))),
        least_(least),
        seed_(seed) {}

  /// The deviation of the points that lie on rows [begin, end)'s plane; none without such a plane.
  /// @param leaf  number of the neighbourhood, for its random numbers
  std::optional<double> fit(std::size_t leaf, std::size_t begin, std::size_t end,
                            PivotPlane* plane) {
    const std::size_t m = end - begin;
    if (m < 6) return std::nullopt;
    const double best_quantile = best_sample(leaf, begin, m, plane);
    if (!std::isfinite(best_quantile)) return std::nullopt;
    // Refit on the points near it; twice, for the first scale comes from a lucky sample.
    double deviation = std::max(best_quantile / 0.5978, least_);  // 45 % of |N(0, 1)|
    for (int round = 0; round < 2; ++round) {
      if (!refit(begin, end, plane, &deviation)) return std::nullopt;
    }
    return curved_deviation(s_, begin, m, *plane, deviation, least_);
  }

  /// Distances of rows [begin, end) from a plane, m; valid until the next call.
  const std::vector<float>& residuals(const PivotPlane& plane, std::size_t begin, std::size_t end) {
    const std::size_t m = end - begin;
    const kernels::FloatPlane p = plane.as_float();
    residuals_.resize(m);
    for (std::size_t k = 0; k < m; ++k) {
      residuals_[k] =
          p.nx * s_.x[begin + k] + p.ny * s_.y[begin + k] + p.nz * s_.z[begin + k] + p.d;
    }
    return residuals_;
  }

 private:
  /// The plane through three rows with the least quantile at 0.45 of |residual|; that quantile, m.
  double best_sample(std::size_t leaf, std::size_t begin, std::size_t m, PivotPlane* best);

  /// The plane of the rows within three deviations of `plane`, and their deviation from it; false,
  /// with both as they were, if there are fewer than 5.
  bool refit(std::size_t begin, std::size_t end, PivotPlane* plane, double* deviation);

  const PointArrays& s_;
  const std::vector<std::uint64_t>& keys_;
  Vector3d up_;
  double least_cosine_, least_;
  std::uint64_t seed_;
  std::vector<float> residuals_, sorted_;
};

double NeighbourhoodFit::best_sample(std::size_t leaf, std::size_t begin, std::size_t m,
                                     PivotPlane* best) {
  constexpr int kSamples = 9;
  const CounterRandom random(seed_, keys_.empty() ? 1000 + leaf : 1000);
  KeyedDraws draws;
  for (std::size_t k = 0; k < m && !keys_.empty(); ++k) {
    draws.add(keys_[begin + k], static_cast<std::uint32_t>(k));
  }
  std::uint64_t counter = 0;
  const auto draw = [&]() -> std::size_t {
    const std::uint64_t index = counter++;
    return keys_.empty() ? random.below(index, m) : draws.draw(random.bits(index));
  };
  double best_quantile = std::numeric_limits<double>::infinity();
  for (int sample = 0; sample < kSamples; ++sample) {
    const std::size_t i = draw(), j = draw(), k = draw();
    const Vector3d p = s_.point(begin + i);
    const Vector3d cross = (s_.point(begin + j) - p).cross(s_.point(begin + k) - p);
    const double norm = cross.norm();
    if (!(norm > 0.0)) continue;
    PivotPlane plane;
    plane.n = cross / norm;
    if (std::abs(plane.n.dot(up_)) < least_cosine_) continue;
    plane.d = -plane.n.dot(p);
    const std::vector<float>& r = residuals(plane, begin, begin + m);
    // No lower quantile with no more residuals below the best so far.
    std::size_t below = 0;
    const float bound = static_cast<float>(best_quantile);
    for (std::size_t q = 0; q < m; ++q) below += std::abs(r[q]) < bound ? 1 : 0;
    if (below <= static_cast<std::size_t>(0.45 * static_cast<double>(m))) continue;
    sorted_.resize(m);
    for (std::size_t q = 0; q < m; ++q) sorted_[q] = std::abs(r[q]);
    const double q = quantile(sorted_, 0.45);
    if (q < best_quantile) {
      best_quantile = q;
      *best = plane;
    }
  }
  return best_quantile;
}

bool NeighbourhoodFit::refit(std::size_t begin, std::size_t end, PivotPlane* plane,
                             double* deviation) {
  const std::vector<float>& r = residuals(*plane, begin, end);
  Vector3d mean = Vector3d::Zero();
  Matrix3d scatter = Matrix3d::Zero();
  std::size_t used = 0;
  for (std::size_t k = 0; k < end - begin; ++k) {
    if (std::abs(static_cast<double>(r[k])) > 3.0 * *deviation) continue;
    const Vector3d p = s_.point(begin + k) - s_.point(begin);
    mean += p;
    scatter += p * p.transpose();
    ++used;
  }
  if (used < 5) return false;
  mean /= static_cast<double>(used);
  scatter -= static_cast<double>(used) * mean * mean.transpose();
  Eigen::SelfAdjointEigenSolver<Matrix3d> solver;
  solver.computeDirect(scatter);
  plane->n = solver.eigenvectors().col(0);
  plane->d = -plane->n.dot(mean + s_.point(begin));
  const double free = static_cast<double>(used) - 3.0;
  *deviation = std::max(std::sqrt(std::max(solver.eigenvalues()[0], 0.0) / free), least_);
  return true;
}

/// What one neighbourhood shows.
struct LeafNoise {
  std::optional<double> deviation;  // m; none without a plane
  std::vector<float> residuals;     // m, of its rows; where a power law is learnt
};

/// Rescales a power law, whose shape is that of all neighbourhoods, to the size of the quiet ones.
void fit_size_to_quiet(const PointArrays& s,
                       const std::vector<std::pair<std::size_t, std::size_t>>& measured,
                       const std::vector<float>& deviations, NoiseModel* model) {
  std::vector<float> ratios;
  for (std::size_t k = 0; k < measured.size(); ++k) {
    const auto [begin, end] = measured[k];
    double squares = 0.0, count = 0.0;
    for (std::size_t row = begin; row < end; ++row) {
      const double sigma = static_cast<double>(s.sigma[row]);
      if (!(sigma > 1e-12 && sigma < 1e12)) continue;
      const double deviation = model->scale * std::pow(sigma, model->exponent);
      squares += deviation * deviation;
      count += 1.0;
    }
    if (squares > 0.0) {
      ratios.push_back(deviations[k] / static_cast<float>(std::sqrt(squares / count)));
    }
  }
  if (ratios.empty()) return;
  std::sort(ratios.begin(), ratios.end());
  model->rescale(mean_of_quiet(ratios));
}

}  // namespace

KeyedDraws::KeyedDraws() { clear(); }

void KeyedDraws::clear() {
  key_.fill(~static_cast<std::uint64_t>(0));
  row_.fill(kNone);
}

void KeyedDraws::add(std::uint64_t key, std::uint32_t row) {
  const std::size_t slot = key >> 56;
  if (row_[slot] != kNone && key >= key_[slot]) return;
  key_[slot] = key;
  row_[slot] = row;
}

std::uint32_t KeyedDraws::draw(std::uint64_t bits) const {
  std::size_t slot = bits >> 56;
  while (row_[slot] == kNone) slot = (slot + 1) % kSlots;
  return row_[slot];
}

void learn_local_noise(const PointArrays& s,
                       const std::vector<std::pair<std::size_t, std::size_t>>& leaves,
                       const std::vector<std::uint64_t>& keys, const Vector3d& up, double max_tilt,
                       double least, std::uint64_t seed, int num_threads, NoiseModel* model) {
  constexpr std::size_t kMostLeaves = 36, kLeavesATask = 6;
  const std::size_t step = keys.empty() ? std::max<std::size_t>(1, leaves.size() / kMostLeaves) : 1;
  std::vector<std::size_t> chosen;
  for (std::size_t leaf = step / 2; leaf < leaves.size(); leaf += step) chosen.push_back(leaf);
  const bool power = model->kind == NoiseKind::kPower;
  std::vector<LeafNoise> found(chosen.size());
  parallel_for((chosen.size() + kLeavesATask - 1) / kLeavesATask, num_threads, [&](std::size_t t) {
    NeighbourhoodFit fit(s, keys, up, max_tilt, least, seed);
    const std::size_t last = std::min(chosen.size(), (t + 1) * kLeavesATask);
    for (std::size_t k = t * kLeavesATask; k < last; ++k) {
      const auto [begin, end] = leaves[chosen[k]];
      PivotPlane plane;
      found[k].deviation = fit.fit(chosen[k], begin, end, &plane);
      if (found[k].deviation && power) found[k].residuals = fit.residuals(plane, begin, end);
    }
  });
  std::vector<float> deviations;
  std::vector<std::pair<std::size_t, std::size_t>> measured;  // rows of each
  std::vector<std::pair<float, float>> pairs;                 // sigma, |residual|
  for (std::size_t k = 0; k < chosen.size(); ++k) {
    if (!found[k].deviation) continue;
    deviations.push_back(static_cast<float>(*found[k].deviation));
    measured.push_back(leaves[chosen[k]]);
    for (std::size_t i = 0; i < found[k].residuals.size(); ++i) {
      const float sigma = s.sigma[measured.back().first + i];
      if (sigma > 1e-12f && sigma < 1e12f)
        pairs.emplace_back(sigma, std::abs(found[k].residuals[i]));
    }
  }
  const double typical = deviations.empty() ? least : std::max(typical_of(deviations), least);
  if (model->kind == NoiseKind::kSame) {
    model->scale = typical;
    return;
  }
  model->kind = NoiseKind::kIsotropic;
  model->scale = 1.0;
  if (!learn_power_law(pairs, typical, least, model)) return;
  fit_size_to_quiet(s, measured, deviations, model);
}

}  // namespace camber::detail
