#include "camber/plane/fit_plane.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/plane/detail/local_noise.h"
#include "camber/plane/detail/plane_coverage.h"
#include "camber/plane/noise_model.h"
#include "camber/plane/plane_covariance.h"
#include "camber/plane/plane_kernels.h"
#include "camber/plane/plane_solver.h"

namespace camber {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

constexpr std::size_t kSubset = 8192;     // points on which the winner is refined
constexpr std::size_t kOrdered = 4096;    // of them, points in order of neighbourhood
constexpr std::size_t kScored = 2048;     // of those, points that score a hypothesis
constexpr std::size_t kLeaf = 32;         // points of a neighbourhood that shows the noise
constexpr std::size_t kCandidates = 8;    // distinct planes that compete at the end
constexpr double kRival = 0.6;            // share of the best gain that makes a competitor
constexpr std::size_t kCounted = 131072;  // points that decide between competitors
constexpr double kCountSigmas = 4.0;      // within which they count: few that belong are left out
constexpr std::size_t kManyPasses = 262144;  // up to it all points are iterated to convergence
/// The input as plain arrays.
struct PointSource {
  const float *x = nullptr, *y = nullptr, *z = nullptr;
  std::size_t stride = 1;
  const float* sigma = nullptr;
  const std::array<float, 6>* covariance = nullptr;
  std::size_t size = 0;
  Vector3d origin = Vector3d::Zero();
};

/// Everything about one fit.
class Fitter {
 public:
  Fitter(const PointSource& source, const PlaneFitOptions& options)
      : source_(source), options_(options), up_(options.up.normalized()) {}

  PlaneFit run();

 private:
  bool choose_subset();
  void order_by_neighbourhood();
  void split(std::size_t begin, std::size_t end);
  bool search();
  bool take_line();
  double cost(const PivotPlane& plane, double bound) const;
  bool orient(PivotPlane* plane) const;
  bool refine_on_scored(PivotPlane* plane, double* cost_of_plane);
  double count_support(const PlaneCandidate& candidate) const;
  void load_many(PointArrays* many) const;
  void relearn_power_law(PointArrays* points, PlaneCandidate* candidate) const;
  kernels::Moments all_moments(const PlaneCandidate& candidate, bool finish, PlaneFit* fit) const;
  void describe(const PlaneCandidate& candidate, const kernels::Moments& full,
                const kernels::Moments& influence, PlaneFit* fit) const;

  PlaneFit fail(Status status, const std::string& reason) const {
    PlaneFit fit;
    fit.status = status;
    fit.reason = reason;
    fit.hypotheses = hypotheses_;
    return fit;
  }
  PlaneFit no_plane() const {
    return fail(Status::kFailed,
                fmt::format("no plane within {:.3g} rad of the up direction", options_.max_tilt));
  }

  bool fixed_threshold() const { return options_.inlier_threshold > 0.0; }

  const PointSource& source_;
  const PlaneFitOptions& options_;
  Vector3d up_;
  float pivot_[3] = {0, 0, 0};
  double spread_ = 0.0;                      // m, 90 % of the subset lie within it of the pivot
  std::size_t usable_ = 0;                   // points of the subset
  PointArrays subset_;                       // in the order of the input
  PointArrays ordered_;                      // part of it, in order of neighbourhood
  PointArrays scored_;                       // every other of that
  std::vector<std::array<float, 2>> level_;  // level coordinates of the subset
  std::vector<std::uint32_t> rows_;          // of the subset, being ordered
  std::vector<std::pair<std::size_t, std::size_t>> leaves_;
  NoiseModel noise_;
  double least_noise_ = 0.0;  // what float coordinates resolve
  std::vector<PlaneCandidate> candidates_;
  double inlier_share_ = 0.0;
  int hypotheses_ = 0;
};

bool Fitter::choose_subset() {
  const std::size_t n = source_.size;
  const CounterRandom random(options_.seed, 1);
  const auto finite = [&](std::size_t i) {
    const float x = source_.x[source_.stride * i], y = source_.y[source_.stride * i],
                z = source_.z[source_.stride * i];
    return std::abs(x) < 1e15f && std::abs(y) < 1e15f && std::abs(z) < 1e15f;
  };
  std::vector<std::uint32_t> chosen;
  if (n > kSubset) {
    // One from each of equal slices of the input, fetched from memory well ahead of its use.
    constexpr std::size_t kAhead = 24;
    const double slice = static_cast<double>(n) / static_cast<double>(kSubset);
    const auto pick = [&](std::size_t k) {
      return std::min(
          n - 1, static_cast<std::size_t>((static_cast<double>(k) + random.uniform(k)) * slice));
    };
    std::array<std::size_t, kAhead> coming;
    for (std::size_t k = 0; k < kAhead; ++k) coming[k] = pick(k);
    chosen.reserve(kSubset);
    for (std::size_t k = 0; k < kSubset; ++k) {
      const std::size_t i = coming[k % kAhead];
      if (k + kAhead < kSubset) {
        const std::size_t next = coming[k % kAhead] = pick(k + kAhead);
        __builtin_prefetch(source_.x + source_.stride * next);
        if (source_.stride == 1) {
          __builtin_prefetch(source_.y + next);
          __builtin_prefetch(source_.z + next);
        }
      }
      if (finite(i)) chosen.push_back(static_cast<std::uint32_t>(i));
    }
  }
  if (n <= kSubset || chosen.size() < kSubset / 2) {
    // Few points, or few usable ones among many: from all that are usable.
    chosen.clear();
    for (std::size_t i = 0; i < n; ++i) {
      if (finite(i)) chosen.push_back(static_cast<std::uint32_t>(i));
    }
    if (chosen.size() > kSubset) {
      const double slice = static_cast<double>(chosen.size()) / static_cast<double>(kSubset);
      std::vector<std::uint32_t> fewer;
      for (std::size_t k = 0; k < kSubset; ++k) {
        const auto i =
            static_cast<std::size_t>((static_cast<double>(k) + random.uniform(k)) * slice);
        fewer.push_back(chosen[std::min(i, chosen.size() - 1)]);
      }
      chosen = fewer;
    }
  }
  usable_ = chosen.size();
  if (usable_ < 3) return false;

  PointArrays& s = subset_;
  s.resize(usable_, source_.sigma != nullptr, source_.covariance != nullptr);
  for (std::size_t k = 0; k < usable_; ++k) {
    const std::size_t i = source_.stride * chosen[k];
    s.x[k] = source_.x[i];
    s.y[k] = source_.y[i];
    s.z[k] = source_.z[i];
    s.w[k] = 1.0f;
  }
  if (source_.sigma) {
    for (std::size_t k = 0; k < usable_; ++k) s.sigma[k] = source_.sigma[chosen[k]];
  }
  if (source_.covariance) {
    for (std::size_t k = 0; k < usable_; ++k) s.covariance[k] = source_.covariance[chosen[k]];
  }
  // The pivot: medians, which no far point can move.
  const std::size_t step = std::max<std::size_t>(1, usable_ / 1024);
  std::vector<float> values;
  std::vector<float>* coordinates[3] = {&s.x, &s.y, &s.z};
  for (int axis = 0; axis < 3; ++axis) {
    values.clear();
    for (std::size_t k = 0; k < usable_; k += step) values.push_back((*coordinates[axis])[k]);
    pivot_[axis] = static_cast<float>(quantile(values, 0.5));
    for (std::size_t k = 0; k < usable_; ++k) (*coordinates[axis])[k] -= pivot_[axis];
  }
  values.clear();
  for (std::size_t k = 0; k < usable_; k += step) {
    values.push_back(static_cast<float>(s.point(k).norm()));
  }
  spread_ = quantile(values, 0.9);
  if (!(spread_ > 0.0)) {
    for (std::size_t k = 0; k < usable_; ++k) spread_ = std::max(spread_, s.point(k).norm());
  }
  // Rounding of the input, and of the sums in float.
  const double magnitude = static_cast<double>(std::max(
                               {std::abs(pivot_[0]), std::abs(pivot_[1]), std::abs(pivot_[2])})) +
                           spread_;
  least_noise_ = std::max(1.2e-7 * magnitude, 4e-7 * spread_);
  return true;
}

/// Halves at about the median of the wider of two level directions until about kLeaf are left.
void Fitter::split(std::size_t begin, std::size_t end) {
  if (end - begin <= kLeaf * 3 / 2) {
    leaves_.emplace_back(begin, end);
    return;
  }
  // Width and middle from a few points: far strays must not decide.
  constexpr std::size_t kLook = 21;
  std::array<float, kLook> look[2];
  for (std::size_t j = 0; j < kLook; ++j) {
    const std::uint32_t k = rows_[begin + (end - begin) * (2 * j + 1) / (2 * kLook)];
    look[0][j] = level_[k][0];
    look[1][j] = level_[k][1];
  }
  std::sort(look[0].begin(), look[0].end());
  std::sort(look[1].begin(), look[1].end());
  const std::size_t axis =
      look[0][kLook - 2] - look[0][1] >= look[1][kLook - 2] - look[1][1] ? 0 : 1;
  const float middle = look[axis][kLook / 2];
  std::size_t cut = begin;
  for (std::size_t k = begin; k < end; ++k) {
    const std::uint32_t row = rows_[k];
    rows_[k] = rows_[cut];
    rows_[cut] = row;
    cut += level_[row][axis] < middle ? 1 : 0;
  }
  // Many equal coordinates leave one side empty.
  if (cut - begin < (end - begin) / 8 || end - cut < (end - begin) / 8) {
    cut = begin + (end - begin) / 2;
  }
  split(begin, cut);
  split(cut, end);
}

void Fitter::order_by_neighbourhood() {
  Vector3d e1, e2;
  UncertainPlane::make_axes(up_, std::abs(up_.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitY(),
                            &e1, &e2);
  level_.resize(usable_);
  const auto f = [](double value) { return static_cast<float>(value); };
  const float ax = f(e1.x()), ay = f(e1.y()), az = f(e1.z()), bx = f(e2.x()), by = f(e2.y()),
              bz = f(e2.z());
  for (std::size_t k = 0; k < usable_; ++k) {
    level_[k] = {ax * subset_.x[k] + ay * subset_.y[k] + az * subset_.z[k],
                 bx * subset_.x[k] + by * subset_.y[k] + bz * subset_.z[k]};
  }
  const std::size_t step = (usable_ + kOrdered - 1) / kOrdered;
  for (std::size_t k = 0; k < usable_; k += step) rows_.push_back(static_cast<std::uint32_t>(k));
  split(0, rows_.size());
  ordered_.take(subset_, rows_);
  const std::size_t skip = (rows_.size() + kScored - 1) / kScored;
  std::vector<std::uint32_t> rows;
  for (std::size_t k = skip / 2; k < rows_.size(); k += skip) rows.push_back(rows_[k]);
  scored_.take(subset_, rows);
}

double Fitter::cost(const PivotPlane& plane, double bound) const {
  constexpr float kLimit = static_cast<float>(kInlierSigmas * kInlierSigmas);
  const std::size_t n = kernels::padded(scored_.size);
  const float most = static_cast<float>(std::min(bound, 1e30));
  if (noise_.kind == NoiseKind::kRays) {
    const double height = plane.n.dot(noise_.viewpoint) + plane.d;
    return kernels::msac_cost_rays(scored_.x.data(), scored_.y.data(), scored_.z.data(),
                                   scored_.w.data(), scored_.floor2.data(), n, plane.as_float(),
                                   static_cast<float>(height * height), kLimit, most);
  }
  return kernels::msac_cost(scored_.x.data(), scored_.y.data(), scored_.z.data(), scored_.w.data(),
                            n, plane.as_float(), kLimit, most);
}

/// Turns the normal to the up side; whether it is within the largest tilt.
bool Fitter::orient(PivotPlane* plane) const {
  if (plane->n.dot(up_) < 0.0) {
    plane->n = -plane->n;
    plane->d = -plane->d;
  }
  return plane->n.dot(up_) >= std::cos(options_.max_tilt) - 1e-12;
}

bool Fitter::refine_on_scored(PivotPlane* plane, double* cost_of_plane) {
  constexpr double kLimit = 2.0 * kInlierSigmas * kInlierSigmas;
  PointArrays rays;
  PointArrays* s = &scored_;
  if (noise_.kind == NoiseKind::kRays || noise_.kind == NoiseKind::kCovariance) {
    rays = scored_;  // the scored points keep their weights for the cost
    s = &rays;
  }
  bool improved = false;
  for (int round = 0; round < 4; ++round) {
    PivotPlane refined = *plane;
    PlaneWindow window;
    align(refined, &window);
    if (s == &rays) rays.weigh(noise_, refined);
    const kernels::Moments moments =
        sum_moments(*s, refined, window, kLimit, kernels::Loss::kReweighted, false);
    double step = 0.0;
    if (!solve_step(moments, window, &refined, &step) || !orient(&refined)) break;
    const double value = cost(refined, *cost_of_plane);
    if (!(value < *cost_of_plane)) break;
    *cost_of_plane = value;
    *plane = refined;
    improved = true;
  }
  return improved;
}

bool Fitter::search() {
  const CounterRandom random(options_.seed, 3);
  const std::size_t n = ordered_.size;
  const double nothing = kInlierSigmas * kInlierSigmas * static_cast<double>(scored_.size);
  double best_gain = 0.0;
  double needed = options_.max_hypotheses;
  const std::size_t near = std::max<std::size_t>(std::min<std::size_t>(n, 16), n / 16);
  // Whether two planes are the same as far as the points of one of them can show.
  const auto same = [&](const PlaneCandidate& a, const PivotPlane& b) {
    if (a.plane.n.dot(b.n) < std::cos(1.5 * M_PI / 180.0)) return false;
    const double apart = b.n.dot(a.window.center) + b.d;
    return std::abs(apart) < 6.0 * a.window.ramp_u;
  };
  const std::uint64_t most_draws = 20ull * static_cast<std::uint64_t>(options_.max_hypotheses);
  for (std::uint64_t draw = 0; draw < most_draws && hypotheses_ < needed; ++draw) {
    std::size_t i, j, k;
    if (draw % 2 == 0) {
      i = random.below(4 * draw, n);
      j = random.below(4 * draw + 1, n);
      k = random.below(4 * draw + 2, n);
    } else {
      // Three of a neighbourhood: rows near each other in this order are near in space.
      const std::size_t begin = random.below(4 * draw + 3, n - near + 1);
      i = begin + random.below(4 * draw, near);
      j = begin + random.below(4 * draw + 1, near);
      k = begin + random.below(4 * draw + 2, near);
    }
    if (i == j || j == k || i == k) continue;
    const Vector3d p = ordered_.point(i), a = ordered_.point(j) - p, b = ordered_.point(k) - p;
    const Vector3d cross = a.cross(b);
    const double norm = cross.norm();
    if (!(norm > 1e-6 * std::max(a.squaredNorm(), b.squaredNorm()))) continue;
    PivotPlane plane;
    plane.n = cross / norm;
    plane.d = -plane.n.dot(p);
    if (!orient(&plane)) continue;
    ++hypotheses_;
    // A raw sample of a plane reaches about half of what refinement makes of it.
    const double floor = candidates_.size() > 0 ? 0.5 * kRival * best_gain : 0.0;
    double value = cost(plane, nothing - floor);
    if (!(nothing - value > floor)) continue;
    // Known already, and no better: nothing to gain.
    PlaneCandidate* known = nullptr;
    for (PlaneCandidate& other : candidates_) {
      if (same(other, plane)) {
        known = &other;
        break;
      }
    }
    if (known && nothing - value <= known->gain) continue;
    refine_on_scored(&plane, &value);
    const double gain = nothing - value;
    if (gain < kRival * best_gain) continue;
    known = nullptr;
    for (PlaneCandidate& other : candidates_) {
      if (same(other, plane)) {
        known = &other;
        break;
      }
    }
    PlaneCandidate candidate;
    candidate.plane = plane;
    candidate.gain = gain;
    // The middle of its points, and its noise, to distinguish it from others.
    {
      PointArrays rays;
      PointArrays* s = &scored_;
      if (noise_.kind == NoiseKind::kRays) {
        rays = scored_;
        rays.weigh(noise_, plane);
        s = &rays;
      }
      PlaneWindow window;
      align(plane, &window);
      const kernels::Moments m = sum_moments(*s, plane, window, kInlierSigmas * kInlierSigmas,
                                             kernels::Loss::kReweighted, false);
      if (!(m.weight > 0.0)) continue;
      candidate.window = window;
      candidate.window.center += m.u / m.weight * window.a + m.v / m.weight * window.b;
      candidate.window.ramp_u = std::sqrt(m.count / m.weight);
    }
    if (known) {
      if (gain > known->gain) *known = candidate;
    } else {
      candidates_.push_back(candidate);
    }
    if (gain > best_gain) {
      best_gain = gain;
      candidates_.erase(
          std::remove_if(candidates_.begin(), candidates_.end(),
                         [&](const PlaneCandidate& c) { return c.gain < kRival * best_gain; }),
          candidates_.end());
      inlier_share_ = std::clamp(gain / nothing, 0.0, 1.0);
    }
    std::sort(candidates_.begin(), candidates_.end(),
              [](const PlaneCandidate& l, const PlaneCandidate& r) { return l.gain > r.gain; });
    if (candidates_.size() > kCandidates) candidates_.resize(kCandidates);
    // A rival as large as the best must have been hit too. Of three points of a neighbourhood that
    // lies on the plane at least half are on it.
    const double share = inlier_share_;
    const double hit = 0.5 * share * share * share + 0.5 * share * std::max(share * share, 0.25);
    needed = std::min<double>(options_.max_hypotheses, std::log(1.0 - options_.confidence) /
                                                           std::log1p(-std::min(hit, 0.99)));
    needed = std::max(needed, std::min(24.0, static_cast<double>(options_.max_hypotheses)));
  }
  return !candidates_.empty();
}

/// Points on a line span no plane: the candidate is the one through them that is nearest to level.
bool Fitter::take_line() {
  if (hypotheses_ > 0) return false;
  Vector3d mean = Vector3d::Zero();
  for (std::size_t k = 0; k < usable_; ++k) mean += subset_.point(k);
  mean /= static_cast<double>(usable_);
  Matrix3d scatter = Matrix3d::Zero();
  for (std::size_t k = 0; k < usable_; ++k) {
    const Vector3d p = subset_.point(k) - mean;
    scatter += p * p.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(scatter);
  const Vector3d along = solver.eigenvectors().col(2);
  const Vector3d level = up_ - up_.dot(along) * along;
  if (!(solver.eigenvalues()[1] < 1e-8 * solver.eigenvalues()[2]) || !(level.norm() > 1e-9)) {
    return false;
  }
  PlaneCandidate line;
  line.plane.n = level.normalized();
  line.plane.d = -line.plane.n.dot(mean);
  if (!orient(&line.plane)) return false;
  line.noise = noise_;
  candidates_.push_back(line);
  return true;
}

/// Points of the cloud on a candidate inside its window, by a fixed part of the cloud.
double Fitter::count_support(const PlaneCandidate& c) const {
  const std::size_t blocks = (source_.size + kernels::kBlock - 1) / kernels::kBlock;
  const std::size_t most = kCounted / kernels::kBlock;
  const std::size_t step = std::max<std::size_t>(1, blocks / most);
  alignas(32) float x[kernels::kBlock], y[kernels::kBlock], z[kernels::kBlock],
      weight[kernels::kBlock];
  kernels::Window window = c.window.as_float();
  // Its edges, sharp.
  window.half_u *= 0.5f / 0.48f;
  window.half_v *= 0.5f / 0.48f;
  window.ramp_u *= 1e-3f;
  window.ramp_v *= 1e-3f;
  double count = 0.0;
  for (std::size_t block = 0; block < blocks; block += step) {
    const std::size_t begin = block * kernels::kBlock;
    const std::size_t m = std::min(kernels::kBlock, source_.size - begin);
    const std::size_t first = source_.stride * begin;
    kernels::load_points(source_.x + first, source_.y + first, source_.z + first, source_.stride, m,
                         pivot_, 1.0f, x, y, z, weight);
    for (std::size_t k = m; k < kernels::padded(m); ++k) x[k] = y[k] = z[k] = weight[k] = 0.0f;
    c.noise.weigh(c.plane.n, c.plane.d, m, x, y, z, source_.sigma ? source_.sigma + begin : nullptr,
                  source_.covariance ? source_.covariance + begin : nullptr, weight);
    kernels::Moments moments;
    kernels::accumulate(x, y, z, weight, kernels::padded(m), c.plane.as_float(), window,
                        static_cast<float>(kCountSigmas * kCountSigmas), kernels::Loss::kReweighted,
                        false, &moments);
    count += moments.count;
  }
  return count;
}

kernels::Moments Fitter::all_moments(const PlaneCandidate& c, bool finish, PlaneFit* fit) const {
  const std::size_t n = source_.size;
  // Chunks of whole blocks: sums are added in chunk order, whoever computed them.
  constexpr std::size_t kChunk = 32 * kernels::kBlock;
  const std::size_t chunks = (n + kChunk - 1) / kChunk;
  struct Part {
    kernels::Moments moments;
    std::vector<int> inliers;
  };
  std::vector<Part> parts(chunks);
  const kernels::FloatPlane p = c.plane.as_float();
  const kernels::Window w = c.window.as_float();
  constexpr float kLimit = static_cast<float>(kBiweight * kBiweight);
  constexpr float kInlier = static_cast<float>(kInlierSigmas * kInlierSigmas);
  const bool list = finish && options_.list_inliers;
  const int threads = resolve_num_threads(options_.num_threads);
  // One thread writes the list where it belongs; several write lists of their own.
  std::vector<int>* single = threads == 1 ? &fit->inliers : nullptr;
  if (list && single) {
    single->clear();
    single->reserve(static_cast<std::size_t>(std::min(1.0, 1.1 * inlier_share_ + 0.2) *
                                             static_cast<double>(n)));
  }
  const bool same = c.noise.kind == NoiseKind::kSame;
  const float same_weight = same ? static_cast<float>(1.0 / (c.noise.scale * c.noise.scale)) : 1.0f;
  const auto work = [&](std::size_t chunk) {
    alignas(32) float x[kernels::kBlock], y[kernels::kBlock], z[kernels::kBlock],
        weight[kernels::kBlock];
    alignas(32) std::int32_t mask[kernels::kBlock];
    int buffer[kernels::kBlock + kernels::kLanes];
    Part& part = parts[chunk];
    std::vector<int>& inliers = single ? *single : part.inliers;
    const std::size_t chunk_end = std::min(n, (chunk + 1) * kChunk);
    for (std::size_t begin = chunk * kChunk; begin < chunk_end; begin += kernels::kBlock) {
      const std::size_t m = std::min(kernels::kBlock, chunk_end - begin);
      const std::size_t first = source_.stride * begin;
      if (same) {
        const std::size_t filled = kernels::accumulate_and_list(
            source_.x + first, source_.y + first, source_.z + first, source_.stride, m, pivot_,
            same_weight, p, w, kLimit, kInlier, static_cast<int>(begin), list ? buffer : nullptr,
            &part.moments);
        if (list) inliers.insert(inliers.end(), buffer, buffer + filled);
        continue;
      }
      kernels::load_points(source_.x + first, source_.y + first, source_.z + first, source_.stride,
                           m, pivot_, 1.0f, x, y, z, weight);
      const std::size_t rows = kernels::padded(m);
      for (std::size_t k = m; k < rows; ++k) x[k] = y[k] = z[k] = weight[k] = 0.0f;
      c.noise.weigh(c.plane.n, c.plane.d, m, x, y, z,
                    source_.sigma ? source_.sigma + begin : nullptr,
                    source_.covariance ? source_.covariance + begin : nullptr, weight);
      if (!finish) {
        kernels::accumulate(x, y, z, weight, rows, p, w, kLimit, kernels::Loss::kNewton, false,
                            &part.moments);
        continue;
      }
      kernels::accumulate_and_mark(x, y, z, weight, rows, p, w, kLimit, kInlier,
                                   list ? mask : nullptr,
                                   source_.stride == 3 && begin + 2 * kernels::kBlock <= n
                                       ? source_.x + first + 3 * kernels::kBlock
                                       : nullptr,
                                   &part.moments);
      if (!list) continue;
      int filled = 0;
      for (std::size_t k = 0; k < m; ++k) {
        buffer[filled] = static_cast<int>(begin + k);
        filled -= mask[k];
      }
      inliers.insert(inliers.end(), buffer, buffer + filled);
    }
  };
  parallel_for(chunks, threads, work);
  kernels::Moments total;
  for (const Part& part : parts) total += part.moments;
  if (finish) {
    fit->num_inliers = static_cast<std::size_t>(total.inliers);
    if (total.inliers > 0.0) fit->rmse = std::sqrt(total.squares / total.inliers);
    if (list && !single) {
      fit->inliers.clear();
      fit->inliers.reserve(fit->num_inliers);
      for (const Part& part : parts) {
        fit->inliers.insert(fit->inliers.end(), part.inliers.begin(), part.inliers.end());
      }
    }
  }
  return total;
}

/// Many points relative to the pivot: all, or evenly spread over the input.
void Fitter::load_many(PointArrays* many) const {
  constexpr std::size_t kMost = 65536;
  const std::size_t every = (source_.size + kMost - 1) / kMost;
  const std::size_t n = (source_.size + every - 1) / every;
  PointArrays& s = *many;
  s.resize(n, source_.sigma != nullptr, source_.covariance != nullptr);
  kernels::load_points(source_.x, source_.y, source_.z, source_.stride * every, n, pivot_, 1.0f,
                       s.x.data(), s.y.data(), s.z.data(), s.w.data());
  for (std::size_t k = 0; k < n; ++k) {
    // Far from everything, so that no plane holds those that are not usable.
    if (!(s.w[k] > 0.0f)) s.x[k] = s.y[k] = s.z[k] = 1e15f;
    if (source_.sigma) s.sigma[k] = source_.sigma[every * k];
    if (source_.covariance) s.covariance[k] = source_.covariance[every * k];
  }
}

/// The power law of sigmas again, from the points of the candidate's window.
void Fitter::relearn_power_law(PointArrays* points, PlaneCandidate* c) const {
  constexpr std::size_t kMostPairs = 16384;
  if (c->window.half_u > 1e14) return;
  const kernels::FloatPlane p = c->plane.as_float();
  const kernels::Window w = c->window.as_float();
  const PointArrays& s = *points;
  points->weigh(c->noise, c->plane);
  std::vector<std::pair<float, float>> pairs;
  std::vector<float> sizes;
  for (std::size_t k = 0; k < s.size; k += std::max<std::size_t>(1, s.size / kMostPairs)) {
    const float r = p.nx * s.x[k] + p.ny * s.y[k] + p.nz * s.z[k] + p.d;
    // Out to where the points of the plane end, whatever their sigma.
    if (!(r * r * s.w[k] < 25.0f) || !(s.w[k] > 0.0f)) continue;
    const float u = w.ax * s.x[k] + w.ay * s.y[k] + w.az * s.z[k] + w.a0;
    const float v = w.bx * s.x[k] + w.by * s.y[k] + w.bz * s.z[k] + w.b0;
    if (std::abs(u) > w.half_u || std::abs(v) > w.half_v) continue;
    pairs.emplace_back(s.sigma[k], std::abs(r));
    sizes.push_back(std::abs(r));
  }
  if (pairs.size() < 1024) return;
  learn_power_law(pairs, 4.0 * quantile(sizes, 0.5), least_noise_, &c->noise);
}

/// Covariance, condition, status.
void Fitter::describe(const PlaneCandidate& c, const kernels::Moments& full,
                      const kernels::Moments& s, PlaneFit* fit) const {
  std::optional<UnknownRays> rays;  // subset_ is weighed for the plane
  if (c.noise.kind != NoiseKind::kRays) rays = unknown_rays(subset_, c.plane, c.window);
  const PlaneEstimate estimate = estimate_covariance(c.plane, c.window, full, s, up_, rays);
  fit->plane = estimate.plane;
  const Vector3d pivot = Vector3d(pivot_[0], pivot_[1], pivot_[2]) + source_.origin;
  fit->plane.centroid += pivot;
  fit->plane.plane.offset = -fit->plane.plane.normal.dot(fit->plane.centroid);
  // The window's edges, or the extent of the inliers where it is open.
  const kernels::Window w = c.window.as_float();
  double low_u = -c.window.half_u / 0.96, high_u = -low_u, low_v = -c.window.half_v / 0.96,
         high_v = -low_v;
  if (c.window.half_u > 1e14) {
    low_u = low_v = std::numeric_limits<double>::infinity();
    high_u = high_v = -low_u;
    for (std::size_t k = 0; k < subset_.size; ++k) {
      const double r = c.plane.distance(subset_.point(k));
      if (!(r * r * static_cast<double>(subset_.w[k]) < kInlierSigmas * kInlierSigmas)) continue;
      const Vector3d p = subset_.point(k);
      const double u = static_cast<double>(w.ax) * p.x() + static_cast<double>(w.ay) * p.y() +
                       static_cast<double>(w.az) * p.z() + static_cast<double>(w.a0);
      const double v = static_cast<double>(w.bx) * p.x() + static_cast<double>(w.by) * p.y() +
                       static_cast<double>(w.bz) * p.z() + static_cast<double>(w.b0);
      low_u = std::min(low_u, u);
      high_u = std::max(high_u, u);
      low_v = std::min(low_v, v);
      high_v = std::max(high_v, v);
    }
  }
  if (high_u >= low_u && high_v >= low_v) {
    const double corners[4][2] = {
        {low_u, low_v}, {high_u, low_v}, {high_u, high_v}, {low_u, high_v}};
    for (const auto& corner : corners) {
      const Vector3d x = c.window.center + corner[0] * c.window.a + corner[1] * c.window.b + pivot;
      fit->extent.push_back(fit->plane.plane.foot(x));
    }
  }
  fit->noise = estimate.noise;
  fit->condition = estimate.condition;
  fit->status = estimate.status;
  fit->reason = estimate.reason;
}

PlaneFit Fitter::run() {
  if (!choose_subset()) {
    return fail(Status::kFailed, fmt::format("{} usable points, at least 3 are needed", usable_));
  }
  if (!(spread_ > 0.0)) return fail(Status::kFailed, "all points lie at one place");
  const std::size_t n = source_.size;

  if (fixed_threshold()) {
    noise_.kind = NoiseKind::kSame;
    noise_.scale = options_.inlier_threshold / kInlierSigmas;
  } else if (source_.covariance) {
    noise_.kind = NoiseKind::kCovariance;
  } else if (source_.sigma && options_.viewpoint) {
    noise_.kind = NoiseKind::kRays;
    noise_.viewpoint =
        *options_.viewpoint - source_.origin - Vector3d(pivot_[0], pivot_[1], pivot_[2]);
  } else {
    noise_.kind = source_.sigma ? NoiseKind::kPower : NoiseKind::kSame;
  }
  order_by_neighbourhood();
  if (!fixed_threshold() && (noise_.kind == NoiseKind::kSame || noise_.kind == NoiseKind::kPower)) {
    detail::learn_local_noise(ordered_, leaves_, {}, up_, options_.max_tilt, least_noise_,
                              options_.seed, &noise_);
  }
  // Weights of the scored points: with rays the plane's part is left to the kernel.
  if (noise_.kind == NoiseKind::kRays) {
    PointArrays& s = scored_;
    s.floor2.assign(s.x.size(), 1.0f);
    for (std::size_t k = 0; k < s.size; ++k) {
      const double s2 = (s.point(k) - noise_.viewpoint).squaredNorm();
      const double sigma = s.sigma[k];
      const bool good = sigma > 1e-12 && sigma < 1e12 && s2 > 0.0;
      s.w[k] = good ? static_cast<float>(s2 / (sigma * sigma)) : 0.0f;
      s.floor2[k] = static_cast<float>(std::max(kGrazingFloor * kGrazingFloor * s2, 1e-12));
    }
  } else {
    PivotPlane level;
    level.n = up_;
    scored_.weigh(noise_, level);
  }
  if (!search() && !take_line()) return no_plane();

  for (PlaneCandidate& c : candidates_) {
    c.window = PlaneWindow();
    c.noise = noise_;
    detail::refine_and_window(&subset_, up_, least_noise_, fixed_threshold(), &c);
    if (candidates_.size() > 1) c.support = count_support(c);
  }
  const auto best = std::max_element(
      candidates_.begin(), candidates_.end(),
      [](const PlaneCandidate& l, const PlaneCandidate& r) { return l.support < r.support; });
  PlaneCandidate c = *best;

  // The part of the plane that is covered, and the noise, by many more points: which of them the
  // subset holds depends on their order.
  if (n > kSubset && n <= kManyPasses) {
    PointArrays many;
    load_many(&many);
    if (c.noise.kind == NoiseKind::kPower) relearn_power_law(&many, &c);
    detail::refine_and_window(&many, up_, least_noise_, fixed_threshold(), &c, true);
  }
  PlaneFit fit;
  fit.hypotheses = hypotheses_;
  kernels::Moments full;
  const int passes = n <= kManyPasses ? 8 : 1;
  for (int pass = 0; pass < passes; ++pass) {
    align(c.plane, &c.window);
    const bool last = pass + 1 == passes;
    full = all_moments(c, last, &fit);
    PivotPlane next = c.plane;
    double step = 0.0;
    const double unit = std::sqrt(full.count / std::max(full.weight, 1e-300));
    const bool solved = solve_step(full, c.window, &next, &step) && step < unit;
    const bool settled = !solved || step < 1e-3 * unit / std::sqrt(std::max(full.count, 1.0));
    if (settled && !last) full = all_moments(c, true, &fit);
    if (solved) c.plane = next;
    if (settled) break;
  }
  orient(&c.plane);
  align(c.plane, &c.window);
  if (!(full.weight > 0.0)) return fail(Status::kFailed, "no points lie on a common plane");
  if (c.plane.n.dot(up_) < std::cos(options_.max_tilt) - 1e-6) return no_plane();
  subset_.weigh(c.noise, c.plane);
  const kernels::Moments influence =
      sum_moments(subset_, c.plane, c.window, kBiweight * kBiweight, kernels::Loss::kNewton, true);
  describe(c, full, influence, &fit);
  return fit;
}

PlaneFit run_fit(const PointSource& source, const PlaneFitOptions& options) {
  options.validate();
  return Fitter(source, options).run();
}

}  // namespace

void PlaneFitOptions::validate() const {
  const auto require = [](bool good, const char* field, double value, const char* bound) {
    if (!good) {
      throw std::invalid_argument(
          fmt::format("PlaneFitOptions::{} is {}, expected {}", field, value, bound));
    }
  };
  require(up.allFinite() && up.norm() > 0.0, "up (its length)", up.norm(), "a direction");
  require(max_tilt > 0.0 && max_tilt <= M_PI / 2, "max_tilt", max_tilt, "(0, pi / 2] rad");
  require(inlier_threshold >= 0.0 && std::isfinite(inlier_threshold), "inlier_threshold",
          inlier_threshold, ">= 0 m");
  require(max_hypotheses > 0, "max_hypotheses", max_hypotheses, "> 0");
  require(confidence > 0.0 && confidence < 1.0, "confidence", confidence, "(0, 1)");
}

PlaneFit fit_plane(const RoadCloud& cloud, const PlaneFitOptions& options) {
  const auto same_length = [&](std::size_t length, const char* name) {
    if (length != 0 && length != cloud.size()) {
      throw std::invalid_argument(
          fmt::format("RoadCloud::{} has {} entries, expected {}", name, length, cloud.size()));
    }
  };
  same_length(cloud.sigmas.size(), "sigmas");
  same_length(cloud.covariances.size(), "covariances");
  PointSource source;
  source.size = cloud.size();
  source.origin = cloud.origin;
  static const float kNone[3] = {0, 0, 0};
  const float* data = cloud.empty() ? kNone : cloud.points.front().data();
  source.x = data;
  source.y = data + 1;
  source.z = data + 2;
  source.stride = 3;
  if (!cloud.covariances.empty()) {
    source.covariance = cloud.covariances.data();
  } else if (!cloud.sigmas.empty()) {
    source.sigma = cloud.sigmas.data();
  }
  PlaneFitOptions local = options;
  if (!local.viewpoint && cloud.frame == CloudFrame::kCamera) local.viewpoint = Vector3d::Zero();
  return run_fit(source, local);
}

PlaneFit fit_plane(const float* x, const float* y, const float* z, const float* sigma,
                   std::size_t n, const PlaneFitOptions& options) {
  PointSource source;
  source.x = x;
  source.y = y;
  source.z = z;
  source.sigma = sigma;
  source.size = n;
  return run_fit(source, options);
}

}  // namespace camber
