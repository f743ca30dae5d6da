#include "camber/plane/fit_plane.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/plane/plane_kernels.h"

namespace camber {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

constexpr std::size_t kSubset = 8192;       // points on which the winner is refined
constexpr std::size_t kScored = 2048;       // of them, points that score a hypothesis
constexpr std::size_t kLeaf = 32;           // points of a neighbourhood that tells the noise
constexpr std::size_t kManyPasses = 65536;  // below it all points are iterated to convergence
constexpr double kBiweight = 4.685;         // standard deviations; 95 % efficient for normal noise
constexpr double kInlierSigmas = 2.5;       // standard deviations
constexpr double kGrazingFloor = 0.02;      // least share of a ray's sigma that shows
constexpr double kWeakTilt = 0.02;          // rad
constexpr double kMedianOfNormal = 0.6745;  // median of |N(0, 1)|

/// The input as plain arrays.
struct PointSource {
  const float *x = nullptr, *y = nullptr, *z = nullptr;
  std::size_t stride = 1;
  const float* sigma = nullptr;
  const std::array<float, 6>* covariance = nullptr;
  std::size_t size = 0;
  Vector3d origin = Vector3d::Zero();
};

/// A plane relative to the pivot.
struct LocalPlane {
  Vector3d n = Vector3d::UnitZ();
  double d = 0.0;
  kernels::FloatPlane as_float() const {
    return {static_cast<float>(n.x()), static_cast<float>(n.y()), static_cast<float>(n.z()),
            static_cast<float>(d)};
  }
};

/// Rectangle on a plane, relative to the pivot.
struct PlaneWindow {
  Vector3d center = Vector3d::Zero();
  Vector3d a = Vector3d::UnitX(), b = Vector3d::UnitY();
  double half_u = 1e15, half_v = 1e15;

  kernels::Window as_float() const {
    const auto f = [](double value) { return static_cast<float>(value); };
    return {f(a.x()), f(a.y()), f(a.z()),          f(-a.dot(center)), f(b.x()),
            f(b.y()), f(b.z()), f(-b.dot(center)), f(half_u),         f(half_v)};
  }
};

/// Points in structure-of-arrays form, padded with zero weights.
struct PointArrays {
  std::vector<float> x, y, z, w, sigma, floor2;
  std::vector<std::array<float, 6>> covariance;
  std::size_t size = 0;

  void resize(std::size_t n, bool with_sigma, bool with_rays, bool with_covariance) {
    const std::size_t m = kernels::padded(n);
    for (std::vector<float>* array : {&x, &y, &z, &w}) array->assign(m, 0.0f);
    if (with_sigma) sigma.assign(m, 1.0f);
    if (with_rays) floor2.assign(m, 1.0f);
    if (with_covariance) covariance.assign(m, {});
    size = n;
  }
};

enum class NoiseKind { kSame, kIsotropic, kPower, kRays, kCovariance };

/// Turns what is known about each point into the variance along a plane's normal.
struct NoiseModel {
  NoiseKind kind = NoiseKind::kSame;
  double scale = 1.0;     // the standard deviation itself for kSame, else a factor on the points'
  double exponent = 1.0;  // kPower: standard deviation = scale * sigma ^ exponent
  Vector3d viewpoint = Vector3d::Zero();  // kRays: relative to the pivot
  std::vector<float> table;               // kPower: weight by the sigma's leading bits
  std::uint32_t first = 0;

  static std::uint32_t key(float sigma) {
    std::uint32_t bits;
    std::memcpy(&bits, &sigma, sizeof(bits));
    return bits >> 16;  // sign, exponent, 7 bits of the fraction
  }

  /// Fills the table for sigmas between low and high (each > 0).
  void tabulate(double low, double high) {
    if (kind != NoiseKind::kPower) return;
    first = key(static_cast<float>(std::max(low, 1e-30)));
    const std::uint32_t last = key(static_cast<float>(std::min(high, 1e30)));
    table.resize(last - first + 1);
    for (std::uint32_t i = 0; i < table.size(); ++i) {
      const std::uint32_t bits = ((first + i) << 16) | 0x8000u;
      float sigma;
      std::memcpy(&sigma, &bits, sizeof(sigma));
      const double deviation = scale * std::pow(static_cast<double>(sigma), exponent);
      table[i] = static_cast<float>(1.0 / (deviation * deviation));
    }
  }

  /// Weights 1 / variance along the plane's normal; rows whose weight is 0 stay out.
  void weigh(const LocalPlane& plane, std::size_t n, const float* x, const float* y, const float* z,
             const float* sigma, const std::array<float, 6>* covariance, float* w) const {
    switch (kind) {
      case NoiseKind::kSame: {
        const float weight = static_cast<float>(1.0 / (scale * scale));
        for (std::size_t i = 0; i < n; ++i) w[i] = w[i] > 0.0f ? weight : 0.0f;
        return;
      }
      case NoiseKind::kIsotropic: {
        const float factor = static_cast<float>(1.0 / (scale * scale));
        for (std::size_t i = 0; i < n; ++i) {
          const bool good = w[i] > 0.0f && sigma[i] > 1e-12f && sigma[i] < 1e12f;
          w[i] = good ? factor / (sigma[i] * sigma[i]) : 0.0f;
        }
        return;
      }
      case NoiseKind::kPower: {
        const std::uint32_t last = first + static_cast<std::uint32_t>(table.size()) - 1;
        for (std::size_t i = 0; i < n; ++i) {
          const bool good = w[i] > 0.0f && sigma[i] > 1e-12f && sigma[i] < 1e12f;
          w[i] = good ? table[std::clamp(key(sigma[i]), first, last) - first] : 0.0f;
        }
        return;
      }
      case NoiseKind::kRays: {
        const float vx = static_cast<float>(viewpoint.x()), vy = static_cast<float>(viewpoint.y()),
                    vz = static_cast<float>(viewpoint.z());
        const double height = plane.n.dot(viewpoint) + plane.d;
        const float view2 = static_cast<float>(height * height);
        const float factor = static_cast<float>(1.0 / (scale * scale));
        constexpr float kFloor2 = static_cast<float>(kGrazingFloor * kGrazingFloor);
        for (std::size_t i = 0; i < n; ++i) {
          const float dx = x[i] - vx, dy = y[i] - vy, dz = z[i] - vz;
          const float s2 = dx * dx + dy * dy + dz * dz;
          const bool good = w[i] > 0.0f && sigma[i] > 1e-12f && sigma[i] < 1e12f && s2 > 0.0f;
          w[i] = good ? factor * s2 / (sigma[i] * sigma[i] * (view2 + kFloor2 * s2)) : 0.0f;
        }
        return;
      }
      case NoiseKind::kCovariance: {
        const float nx = static_cast<float>(plane.n.x()), ny = static_cast<float>(plane.n.y()),
                    nz = static_cast<float>(plane.n.z());
        const float factor = static_cast<float>(1.0 / (scale * scale));
        for (std::size_t i = 0; i < n; ++i) {
          const std::array<float, 6>& c = covariance[i];
          const float variance = nx * nx * c[0] + ny * ny * c[3] + nz * nz * c[5] +
                                 2.0f * (nx * ny * c[1] + nx * nz * c[2] + ny * nz * c[4]);
          const bool good = w[i] > 0.0f && variance > 1e-24f && variance < 1e24f;
          w[i] = good ? factor / variance : 0.0f;
        }
        return;
      }
    }
  }
};

double quantile(std::vector<float>& values, double share) {
  const std::size_t k = std::min(
      values.size() - 1, static_cast<std::size_t>(share * static_cast<double>(values.size())));
  std::nth_element(values.begin(), values.begin() + static_cast<long>(k), values.end());
  return values[k];
}

/// Standard deviation of the normal part of |residuals| over an even background within `reach`:
/// expectation maximisation on a histogram. Returns `start` if hardly anything is there.
double core_deviation(const std::vector<float>& residuals, double start, double reach) {
  constexpr int kBins = 96;
  std::array<double, kBins> counts{};
  const double width = reach / kBins;
  double total = 0.0;
  for (const float r : residuals) {
    const double a = std::abs(static_cast<double>(r));
    if (!(a < reach)) continue;
    counts[static_cast<std::size_t>(a / width)] += 1.0;
    total += 1.0;
  }
  if (total < 20.0) return start;
  double deviation = start, share = 0.8;
  for (int iteration = 0; iteration < 30; ++iteration) {
    double in = 0.0, squares = 0.0;
    for (int k = 0; k < kBins; ++k) {
      const double a = (k + 0.5) * width;
      const double normal = share * std::sqrt(2.0 / M_PI) / deviation *
                            std::exp(-0.5 * a * a / deviation / deviation);
      const double p = normal / (normal + (1.0 - share) / reach) * counts[k];
      in += p;
      squares += p * a * a;
    }
    if (!(in > 0.0)) return start;
    const double next = std::sqrt(std::max(squares / in, width * width / 12.0));
    share = std::clamp(in / total, 0.05, 0.999);
    const bool settled = std::abs(next - deviation) < 1e-3 * deviation;
    deviation = next;
    if (settled) break;
  }
  return deviation;
}

/// Smallest and largest in-plane coordinates between which the points lie evenly and on the plane.
/// Bins along one axis; the run of bins around the fullest that are at least 40 % full and whose
/// mean residual stays below one standard deviation; from its ends inward as far as the edges are
/// washed out.
bool even_run(const std::vector<float>& along, const std::vector<float>& residuals,
              const std::vector<float>& weights, double* low, double* high) {
  const std::size_t n = along.size();
  if (n < 200) return false;
  std::vector<float> sorted = along;
  const double first = quantile(sorted, 0.003), last = quantile(sorted, 0.997);
  if (!(last > first)) return false;
  const int bins = static_cast<int>(std::clamp<std::size_t>(n / 40, 8, 64));
  const double width = (last - first) / bins;
  std::vector<double> count(bins, 0.0), sum(bins, 0.0);
  for (std::size_t i = 0; i < n; ++i) {
    const int k = static_cast<int>(std::floor((along[i] - first) / width));
    if (k < 0 || k >= bins) continue;
    count[k] += 1.0;
    sum[k] += static_cast<double>(residuals[i]) * std::sqrt(static_cast<double>(weights[i]));
  }
  std::vector<double> ordered = count;
  std::nth_element(ordered.begin(), ordered.begin() + bins * 3 / 4, ordered.end());
  const double plateau = ordered[bins * 3 / 4];
  if (!(plateau > 0.0)) return false;
  const auto good = [&](int k) {
    return count[k] >= 0.4 * plateau &&
           std::abs(sum[k] / count[k]) < std::max(1.0, 4.0 / std::sqrt(count[k]));
  };
  // The run with the most points; a single bad bin inside does not end it.
  int best_begin = -1, best_end = -1;
  double best = 0.0;
  for (int k = 0; k < bins;) {
    if (!good(k)) {
      ++k;
      continue;
    }
    int end = k + 1, last_good = k + 1;
    double points = count[k];
    while (end < bins && (good(end) || (end + 1 < bins && good(end + 1)))) {
      points += count[end];
      if (good(end)) last_good = end + 1;
      ++end;
    }
    if (points > best) {
      best = points;
      best_begin = k;
      best_end = last_good;
    }
    k = end;
  }
  if (best_begin < 0) return false;
  std::vector<double> inside(count.begin() + best_begin, count.begin() + best_end);
  std::nth_element(inside.begin(), inside.begin() + static_cast<long>(inside.size() / 2),
                   inside.end());
  const double level = inside[inside.size() / 2];
  const int most = static_cast<int>(0.15 * (best_end - best_begin));
  int begin = best_begin, end = best_end;
  const double floor = level - std::max(2.0 * std::sqrt(level), 0.1 * level);
  while (begin < best_begin + most && count[begin] < floor) ++begin;
  while (end > best_end - most && count[end - 1] < floor) --end;
  // One more bin: the last that is full may still be half washed out.
  if (end - begin >= 10) {
    ++begin;
    --end;
  }
  *low = first + begin * width;
  *high = first + end * width;
  return true;
}

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
  void learn_noise();
  bool search();
  double cost(const LocalPlane& plane, double bound) const;
  bool solve(const kernels::Moments& moments, const PlaneWindow& window, bool newton,
             LocalPlane* plane, double* step) const;
  kernels::Moments subset_moments(const LocalPlane& plane, const PlaneWindow& window, double limit,
                                  bool influence);
  void refine_on_subset();
  void set_window();
  void rescale_noise();
  kernels::Moments all_moments(const LocalPlane& plane, bool finish, PlaneFit* fit);
  void describe(const kernels::Moments& full, const kernels::Moments& influence, PlaneFit* fit);

  PlaneFit fail(Status status, const std::string& reason) const {
    PlaneFit fit;
    fit.status = status;
    fit.reason = reason;
    fit.hypotheses = hypotheses_;
    return fit;
  }

  bool fixed_threshold() const { return options_.inlier_threshold > 0.0; }

  const PointSource& source_;
  const PlaneFitOptions& options_;
  Vector3d up_;
  float pivot_[3] = {0, 0, 0};
  double spread_ = 0.0;                // m, 90 % of the subset lie within it of the pivot
  std::vector<std::uint32_t> chosen_;  // indices of the subset's points
  PointArrays subset_;                 // in order of neighbourhood
  PointArrays scored_;                 // every few of it
  std::vector<std::pair<std::size_t, std::size_t>> leaves_;
  NoiseModel noise_;
  double least_noise_ = 0.0;  // what float coordinates can tell
  LocalPlane plane_;
  PlaneWindow window_;
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
  if (n <= kSubset) {
    for (std::size_t i = 0; i < n; ++i) {
      if (finite(i)) chosen_.push_back(static_cast<std::uint32_t>(i));
    }
  } else {
    // One from each of equal slices of the input.
    const double slice = static_cast<double>(n) / static_cast<double>(kSubset);
    for (std::size_t k = 0; k < kSubset; ++k) {
      const auto i = static_cast<std::size_t>((static_cast<double>(k) + random.uniform(k)) * slice);
      if (i < n && finite(i)) chosen_.push_back(static_cast<std::uint32_t>(i));
    }
    if (chosen_.size() < kSubset / 2) {
      std::vector<std::uint32_t> usable;
      for (std::size_t i = 0; i < n; ++i) {
        if (finite(i)) usable.push_back(static_cast<std::uint32_t>(i));
      }
      chosen_.clear();
      if (usable.size() <= kSubset) {
        chosen_ = usable;
      } else {
        const double part = static_cast<double>(usable.size()) / static_cast<double>(kSubset);
        for (std::size_t k = 0; k < kSubset; ++k) {
          const auto i =
              static_cast<std::size_t>((static_cast<double>(k) + random.uniform(k)) * part);
          chosen_.push_back(usable[std::min(i, usable.size() - 1)]);
        }
      }
    }
  }
  if (chosen_.size() < 3) return false;

  // The pivot: medians, which no far point can move.
  std::vector<float> values(chosen_.size());
  const float* coordinates[3] = {source_.x, source_.y, source_.z};
  for (int axis = 0; axis < 3; ++axis) {
    for (std::size_t k = 0; k < chosen_.size(); ++k) {
      values[k] = coordinates[axis][source_.stride * chosen_[k]];
    }
    pivot_[axis] = static_cast<float>(quantile(values, 0.5));
  }
  for (std::size_t k = 0; k < chosen_.size(); ++k) {
    const std::size_t i = source_.stride * chosen_[k];
    const double dx = static_cast<double>(source_.x[i]) - pivot_[0],
                 dy = static_cast<double>(source_.y[i]) - pivot_[1],
                 dz = static_cast<double>(source_.z[i]) - pivot_[2];
    values[k] = static_cast<float>(std::sqrt(dx * dx + dy * dy + dz * dz));
  }
  spread_ = quantile(values, 0.9);
  if (!(spread_ > 0.0)) spread_ = *std::max_element(values.begin(), values.end());
  // Rounding of the input, and of the sums in float.
  const double magnitude =
      std::max({std::abs(pivot_[0]), std::abs(pivot_[1]), std::abs(pivot_[2])}) + spread_;
  least_noise_ = std::max(1.2e-7 * magnitude, 4e-7 * spread_);
  return true;
}

void Fitter::split(std::size_t begin, std::size_t end) {
  // Halves at the median of the wider of two level directions until about kLeaf points are left.
  if (end - begin <= kLeaf * 3 / 2) {
    leaves_.emplace_back(begin, end);
    return;
  }
  const Vector3d e1 = window_.a, e2 = window_.b;
  const auto project = [&](std::uint32_t k, const Vector3d& e) {
    const std::size_t i = source_.stride * k;
    return e.x() * (static_cast<double>(source_.x[i]) - pivot_[0]) +
           e.y() * (static_cast<double>(source_.y[i]) - pivot_[1]) +
           e.z() * (static_cast<double>(source_.z[i]) - pivot_[2]);
  };
  // Width by the spread of a few points: far strays must not decide.
  constexpr std::size_t kLook = 15;
  std::array<float, kLook> first{}, second{};
  for (std::size_t j = 0; j < kLook; ++j) {
    const std::uint32_t k = chosen_[begin + (end - begin) * (2 * j + 1) / (2 * kLook)];
    first[j] = static_cast<float>(project(k, e1));
    second[j] = static_cast<float>(project(k, e2));
  }
  std::sort(first.begin(), first.end());
  std::sort(second.begin(), second.end());
  const Vector3d e = first[kLook - 2] - first[1] >= second[kLook - 2] - second[1] ? e1 : e2;
  std::vector<std::pair<float, std::uint32_t>> keyed(end - begin);
  for (std::size_t k = begin; k < end; ++k) {
    keyed[k - begin] = {static_cast<float>(project(chosen_[k], e)), chosen_[k]};
  }
  const std::size_t middle = (end - begin) / 2;
  std::nth_element(keyed.begin(), keyed.begin() + static_cast<long>(middle), keyed.end());
  for (std::size_t k = begin; k < end; ++k) chosen_[k] = keyed[k - begin].second;
  split(begin, begin + middle);
  split(begin + middle, end);
}

void Fitter::order_by_neighbourhood() {
  UncertainPlane::make_axes(up_, std::abs(up_.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitY(),
                            &window_.a, &window_.b);
  split(0, chosen_.size());
  const bool rays = noise_.kind == NoiseKind::kRays;
  const auto gather = [&](PointArrays& out, std::size_t begin, std::size_t step) {
    const std::size_t count = (chosen_.size() - begin + step - 1) / step;
    out.resize(count, source_.sigma != nullptr, rays, source_.covariance != nullptr);
    for (std::size_t k = 0; k < count; ++k) {
      const std::size_t i = chosen_[begin + k * step];
      out.x[k] = source_.x[source_.stride * i] - pivot_[0];
      out.y[k] = source_.y[source_.stride * i] - pivot_[1];
      out.z[k] = source_.z[source_.stride * i] - pivot_[2];
      out.w[k] = 1.0f;
      if (source_.sigma) out.sigma[k] = source_.sigma[i];
      if (source_.covariance) out.covariance[k] = source_.covariance[i];
    }
  };
  gather(subset_, 0, 1);
  const std::size_t step = std::max<std::size_t>(1, (chosen_.size() + kScored - 1) / kScored);
  gather(scored_, step / 2, step);
}

/// Noise by neighbourhoods: in each leaf the best of a few minimal samples, least quantile of
/// squares, then the residuals of a refit; the noise of the cloud is a low quantile over leaves, so
/// that leaves with kerbs, cars or creases do not count.
void Fitter::learn_noise() {
  const CounterRandom random(options_.seed, 2);
  constexpr std::size_t kMostLeaves = 96;
  constexpr int kSamples = 12;
  const std::size_t step = std::max<std::size_t>(1, leaves_.size() / kMostLeaves);
  std::vector<float> deviations;
  std::vector<std::pair<float, float>> pairs;  // sigma, |residual|
  std::uint64_t counter = 0;
  std::vector<float> residuals, sorted;
  const double least_cosine = std::cos(std::min(options_.max_tilt, 1.5));
  for (std::size_t leaf = step / 2; leaf < leaves_.size(); leaf += step) {
    const auto [begin, end] = leaves_[leaf];
    const std::size_t m = end - begin;
    if (m < 6) continue;
    const auto point = [&](std::size_t k) {
      return Vector3d(subset_.x[begin + k], subset_.y[begin + k], subset_.z[begin + k]);
    };
    LocalPlane best;
    double best_quantile = std::numeric_limits<double>::infinity();
    const auto measure = [&](const LocalPlane& plane) {
      const kernels::FloatPlane p = plane.as_float();
      residuals.resize(m);
      for (std::size_t k = 0; k < m; ++k) {
        residuals[k] = p.nx * subset_.x[begin + k] + p.ny * subset_.y[begin + k] +
                       p.nz * subset_.z[begin + k] + p.d;
      }
      sorted.resize(m);
      for (std::size_t k = 0; k < m; ++k) sorted[k] = std::abs(residuals[k]);
      return quantile(sorted, 0.45);
    };
    for (int s = 0; s < kSamples; ++s) {
      const std::size_t i = random.below(counter, m), j = random.below(counter + 1, m),
                        k = random.below(counter + 2, m);
      counter += 3;
      const Vector3d p = point(i);
      const Vector3d cross = (point(j) - p).cross(point(k) - p);
      const double norm = cross.norm();
      if (!(norm > 0.0)) continue;
      LocalPlane plane;
      plane.n = cross / norm;
      if (std::abs(plane.n.dot(up_)) < least_cosine) continue;
      plane.d = -plane.n.dot(p);
      const double q = measure(plane);
      if (q < best_quantile) {
        best_quantile = q;
        best = plane;
      }
    }
    if (!std::isfinite(best_quantile)) continue;
    // Refit on the points near it; twice, for the first scale comes from a lucky sample.
    double deviation = std::max(best_quantile / 0.5978, least_noise_);  // 45 % of |N(0, 1)|
    std::size_t used = 0;
    for (int round = 0; round < 2; ++round) {
      measure(best);
      Vector3d mean = Vector3d::Zero();
      used = 0;
      for (std::size_t k = 0; k < m; ++k) {
        if (std::abs(residuals[k]) > 3.0 * deviation) continue;
        mean += point(k);
        ++used;
      }
      if (used < 5) break;
      mean /= static_cast<double>(used);
      Matrix3d scatter = Matrix3d::Zero();
      for (std::size_t k = 0; k < m; ++k) {
        if (std::abs(residuals[k]) > 3.0 * deviation) continue;
        const Vector3d offset = point(k) - mean;
        scatter += offset * offset.transpose();
      }
      Eigen::SelfAdjointEigenSolver<Matrix3d> solver;
      solver.computeDirect(scatter);
      best.n = solver.eigenvectors().col(0);
      best.d = -best.n.dot(mean);
      const double free = static_cast<double>(used) - 3.0;
      deviation = std::max(std::sqrt(std::max(solver.eigenvalues()[0], 0.0) / free), least_noise_);
    }
    if (used < 5) continue;
    measure(best);
    deviations.push_back(static_cast<float>(deviation));
    if (noise_.kind == NoiseKind::kPower) {
      for (std::size_t k = 0; k < m; ++k) {
        const float sigma = subset_.sigma[begin + k];
        if (sigma > 1e-12f && sigma < 1e12f) pairs.emplace_back(sigma, std::abs(residuals[k]));
      }
    }
  }
  double typical = least_noise_;
  if (!deviations.empty()) typical = std::max(quantile(deviations, 0.35), least_noise_);

  if (noise_.kind == NoiseKind::kSame) {
    noise_.scale = typical;
    return;
  }
  // kPower: how the residuals grow with sigma, from groups of equal size.
  noise_.kind = NoiseKind::kIsotropic;
  noise_.scale = 1.0;
  constexpr std::size_t kGroups = 6;
  if (pairs.size() < kGroups * 40) return;
  std::sort(pairs.begin(), pairs.end());
  std::vector<Eigen::Vector2d> knots;
  for (std::size_t g = 0; g < kGroups; ++g) {
    const std::size_t begin = pairs.size() * g / kGroups, end = pairs.size() * (g + 1) / kGroups;
    std::vector<float> sizes;
    for (std::size_t k = begin; k < end; ++k) {
      if (pairs[k].second < 8.0 * typical) sizes.push_back(pairs[k].second);
    }
    if (sizes.size() < 20) continue;
    const double deviation = std::max(quantile(sizes, 0.5) / kMedianOfNormal, least_noise_);
    knots.emplace_back(std::log(static_cast<double>(pairs[(begin + end) / 2].first)),
                       std::log(deviation));
  }
  if (knots.size() < 2) return;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const auto& knot : knots) mean += knot / static_cast<double>(knots.size());
  double xx = 0.0, xy = 0.0;
  for (const auto& knot : knots) {
    xx += (knot.x() - mean.x()) * (knot.x() - mean.x());
    xy += (knot.x() - mean.x()) * (knot.y() - mean.y());
  }
  noise_.kind = NoiseKind::kPower;
  noise_.exponent = xx > 1e-4 ? std::clamp(xy / xx, 0.0, 1.5) : 1.0;
  noise_.scale = std::exp(mean.y() - noise_.exponent * mean.x());
  noise_.tabulate(static_cast<double>(pairs.front().first) / 8.0,
                  static_cast<double>(pairs.back().first) * 8.0);
}

double Fitter::cost(const LocalPlane& plane, double bound) const {
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

/// Solves the weighted normal equations for (slope along a, slope along b, height) and applies
/// them.
bool Fitter::solve(const kernels::Moments& m, const PlaneWindow& window, bool newton,
                   LocalPlane* plane, double* step) const {
  if (!(m.weight > 0.0) || m.count < 3.0) return false;
  const double su = std::sqrt(std::max(m.uu / m.weight, 1e-300)),
               sv = std::sqrt(std::max(m.vv / m.weight, 1e-300));
  Matrix3d h;
  h << m.uu / (su * su), m.uv / (su * sv), m.u / su, m.uv / (su * sv), m.vv / (sv * sv), m.v / sv,
      m.u / su, m.v / sv, m.weight;
  h /= m.weight;
  const Vector3d g(m.ru / su / m.weight, m.rv / sv / m.weight, m.r / m.weight);
  const Eigen::LDLT<Matrix3d> ldlt(h);
  if (!(ldlt.vectorD().minCoeff() > 1e-9)) return false;
  Vector3d x = ldlt.solve(g);
  if (newton) {
    // Reweighting shrinks the error to (1 - kappa) of itself, with kappa = sum psi' / sum omega.
    const double kappa = std::clamp(m.slope / m.weight, 0.5, 1.2);
    x /= kappa;
  }
  const double alpha = x[0] / su, beta = x[1] / sv, gamma = x[2];
  if (!std::isfinite(alpha + beta + gamma)) return false;
  const double before = plane->n.dot(window.center) + plane->d;
  const Vector3d anchor = window.center + (gamma - before) * plane->n;
  plane->n = (plane->n - alpha * window.a - beta * window.b).normalized();
  plane->d = -plane->n.dot(anchor);
  if (step) *step = std::max({std::abs(x[0]), std::abs(x[1]), std::abs(x[2])});
  return true;
}

/// Puts a window's axes on a plane.
void align(const LocalPlane& plane, PlaneWindow* window) {
  const Vector3d along = window->a;
  UncertainPlane::make_axes(plane.n, along, &window->a, &window->b);
  window->center -= (plane.n.dot(window->center) + plane.d) * plane.n;
}

bool Fitter::search() {
  const CounterRandom random(options_.seed, 3);
  const double least_cosine = std::cos(options_.max_tilt);
  const std::size_t n = chosen_.size(), m = scored_.size;
  constexpr double kLimit = kInlierSigmas * kInlierSigmas;
  double best = std::numeric_limits<double>::infinity();
  bool found = false;
  double needed = options_.max_hypotheses;
  const std::size_t near = std::max<std::size_t>(16, n / 16);
  const auto orient = [&](LocalPlane& plane) {
    if (plane.n.dot(up_) < 0.0) {
      plane.n = -plane.n;
      plane.d = -plane.d;
    }
    return plane.n.dot(up_) >= least_cosine - 1e-12;
  };
  const auto point = [&](std::size_t k) {
    return Vector3d(subset_.x[k], subset_.y[k], subset_.z[k]);
  };
  PointArrays& s = scored_;
  std::vector<float> weights = s.w;
  const std::uint64_t most_draws = 20ull * static_cast<std::uint64_t>(options_.max_hypotheses);
  for (std::uint64_t draw = 0; draw < most_draws && hypotheses_ < needed; ++draw) {
    std::size_t i, j, k;
    if (draw % 2 == 0) {
      i = random.below(4 * draw, n);
      j = random.below(4 * draw + 1, n);
      k = random.below(4 * draw + 2, n);
    } else {
      // Three of a neighbourhood: positions in the order of neighbourhoods are near each other.
      const std::size_t begin = random.below(4 * draw + 3, n - std::min(n - 1, near) + 1);
      const std::size_t length = std::min(near, n - begin);
      i = begin + random.below(4 * draw, length);
      j = begin + random.below(4 * draw + 1, length);
      k = begin + random.below(4 * draw + 2, length);
    }
    if (i == j || j == k || i == k) continue;
    const Vector3d p = point(i), a = point(j) - p, b = point(k) - p;
    const Vector3d cross = a.cross(b);
    const double norm = cross.norm();
    if (!(norm > 1e-6 * std::max(a.squaredNorm(), b.squaredNorm()))) continue;
    LocalPlane plane;
    plane.n = cross / norm;
    plane.d = -plane.n.dot(p);
    if (!orient(plane)) continue;
    ++hypotheses_;
    double value = cost(plane, best);
    if (!(value < best)) continue;
    // Local refinement on the scored points.
    for (int round = 0; round < 4; ++round) {
      LocalPlane refined = plane;
      PlaneWindow window;
      window.a = window_.a;
      align(refined, &window);
      weights.assign(s.w.size(), 0.0f);
      std::fill(weights.begin(), weights.begin() + static_cast<long>(m), 1.0f);
      noise_.weigh(refined, m, s.x.data(), s.y.data(), s.z.data(), s.sigma.data(),
                   s.covariance.data(), weights.data());
      kernels::Moments moments;
      for (std::size_t begin = 0; begin < kernels::padded(m); begin += kernels::kBlock) {
        kernels::accumulate(
            s.x.data() + begin, s.y.data() + begin, s.z.data() + begin, weights.data() + begin,
            std::min(kernels::kBlock, kernels::padded(m) - begin), refined.as_float(),
            window.as_float(), static_cast<float>(2.0 * kLimit), false, &moments);
      }
      if (!solve(moments, window, false, &refined, nullptr) || !orient(refined)) break;
      const double improved = cost(refined, value);
      if (!(improved < value)) break;
      value = improved;
      plane = refined;
    }
    best = value;
    plane_ = plane;
    found = true;
    const double share = std::clamp(1.0 - best / (kLimit * static_cast<double>(m)), 0.0, 1.0);
    inlier_share_ = share;
    const double hit = share * share * share;
    if (hit > 0.999999) {
      needed = 0.0;
    } else if (hit > 0.0) {
      needed = std::min<double>(options_.max_hypotheses,
                                std::log(1.0 - options_.confidence) / std::log1p(-hit));
    }
    needed = std::max(needed, std::min(24.0, static_cast<double>(options_.max_hypotheses)));
  }
  return found;
}

kernels::Moments Fitter::subset_moments(const LocalPlane& plane, const PlaneWindow& window,
                                        double limit, bool influence) {
  PointArrays& s = subset_;
  std::fill(s.w.begin(), s.w.begin() + static_cast<long>(s.size), 1.0f);
  noise_.weigh(plane, s.size, s.x.data(), s.y.data(), s.z.data(), s.sigma.data(),
               s.covariance.data(), s.w.data());
  kernels::Moments moments;
  const std::size_t n = kernels::padded(s.size);
  for (std::size_t begin = 0; begin < n; begin += kernels::kBlock) {
    kernels::accumulate(s.x.data() + begin, s.y.data() + begin, s.z.data() + begin,
                        s.w.data() + begin, std::min(kernels::kBlock, n - begin), plane.as_float(),
                        window.as_float(), static_cast<float>(limit), influence, &moments);
  }
  return moments;
}

void Fitter::refine_on_subset() {
  constexpr double kLimit = kBiweight * kBiweight;
  for (int round = 0; round < 12; ++round) {
    align(plane_, &window_);
    const kernels::Moments moments = subset_moments(plane_, window_, kLimit, false);
    LocalPlane next = plane_;
    double step = 0.0;
    if (!solve(moments, window_, round > 2, &next, &step)) return;
    plane_ = next;
    const double unit = std::sqrt(std::max(moments.count, 1.0) / std::max(moments.weight, 1e-300));
    if (step < 1e-3 * unit / std::sqrt(std::max(moments.count, 1.0))) break;
  }
  align(plane_, &window_);
}

/// Re-estimates the noise from the residuals of the refined plane inside its window.
void Fitter::rescale_noise() {
  if (fixed_threshold() || noise_.kind == NoiseKind::kCovariance) return;
  subset_moments(plane_, window_, 1.0, false);  // refreshes the weights
  const PointArrays& s = subset_;
  std::vector<float> normalised;
  normalised.reserve(s.size);
  const kernels::FloatPlane p = plane_.as_float();
  const kernels::Window w = window_.as_float();
  for (std::size_t k = 0; k < s.size; ++k) {
    const float u = w.ax * s.x[k] + w.ay * s.y[k] + w.az * s.z[k] + w.a0;
    const float v = w.bx * s.x[k] + w.by * s.y[k] + w.bz * s.z[k] + w.b0;
    if (std::abs(u) > w.half_u || std::abs(v) > w.half_v || !(s.w[k] > 0.0f)) continue;
    const float r = p.nx * s.x[k] + p.ny * s.y[k] + p.nz * s.z[k] + p.d;
    normalised.push_back(r * std::sqrt(s.w[k]));
  }
  if (normalised.size() < 30) return;
  const double factor = core_deviation(normalised, 1.0, 6.0);
  if (noise_.kind == NoiseKind::kSame) {
    noise_.scale = std::max(noise_.scale * std::clamp(factor, 0.3, 3.0), least_noise_);
  } else if (normalised.size() >= 200) {
    noise_.scale *= std::clamp(factor, 0.3, 4.0);
    if (noise_.kind == NoiseKind::kPower) {
      const double squared = factor * factor;
      if (squared > 0.09 && squared < 16.0) {
        for (float& weight : noise_.table) weight = static_cast<float>(weight / squared);
      }
    }
  }
}

/// Finds the part of the plane that the points cover evenly.
void Fitter::set_window() {
  const PointArrays& s = subset_;
  for (int round = 0; round < 2; ++round) {
    const PlaneWindow wide = window_;
    const kernels::Window w = wide.as_float();
    const kernels::FloatPlane p = plane_.as_float();
    // Axes: the principal directions of the inliers.
    std::vector<float> u, v, residuals, weights;
    double su = 0, sv = 0, suu = 0, suv = 0, svv = 0;
    for (std::size_t k = 0; k < s.size; ++k) {
      if (!(s.w[k] > 0.0f)) continue;
      const float r = p.nx * s.x[k] + p.ny * s.y[k] + p.nz * s.z[k] + p.d;
      if (!(r * r * s.w[k] < 9.0f)) continue;
      const float a = w.ax * s.x[k] + w.ay * s.y[k] + w.az * s.z[k] + w.a0;
      const float b = w.bx * s.x[k] + w.by * s.y[k] + w.bz * s.z[k] + w.b0;
      if (round > 0 && (std::abs(a) > 1.3f * w.half_u || std::abs(b) > 1.3f * w.half_v)) continue;
      u.push_back(a);
      v.push_back(b);
      residuals.push_back(r);
      weights.push_back(s.w[k]);
      su += a;
      sv += b;
      suu += static_cast<double>(a) * a;
      suv += static_cast<double>(a) * b;
      svv += static_cast<double>(b) * b;
    }
    if (u.size() < 400) return;
    const double count = static_cast<double>(u.size());
    const double cuu = suu - su * su / count, cuv = suv - su * sv / count,
                 cvv = svv - sv * sv / count;
    const double angle = 0.5 * std::atan2(2.0 * cuv, cuu - cvv);
    const double c = std::cos(angle), sn = std::sin(angle);
    std::vector<float> along(u.size()), across(u.size());
    for (std::size_t k = 0; k < u.size(); ++k) {
      along[k] = static_cast<float>(c * u[k] + sn * v[k]);
      across[k] = static_cast<float>(-sn * u[k] + c * v[k]);
    }
    double low, high, left, right;
    if (!even_run(along, residuals, weights, &low, &high)) return;
    // Across: only of the points within the run along.
    std::vector<float> across_in, residuals_in, weights_in;
    for (std::size_t k = 0; k < along.size(); ++k) {
      if (along[k] < low || along[k] > high) continue;
      across_in.push_back(across[k]);
      residuals_in.push_back(residuals[k]);
      weights_in.push_back(weights[k]);
    }
    if (!even_run(across_in, residuals_in, weights_in, &left, &right)) return;
    window_.a = c * wide.a + sn * wide.b;
    window_.b = -sn * wide.a + c * wide.b;
    window_.center =
        wide.center + 0.5 * (low + high) * window_.a + 0.5 * (left + right) * window_.b;
    window_.half_u = 0.5 * (high - low);
    window_.half_v = 0.5 * (right - left);
    refine_on_subset();
    rescale_noise();
    refine_on_subset();
  }
}

kernels::Moments Fitter::all_moments(const LocalPlane& plane, bool finish, PlaneFit* fit) {
  const std::size_t n = source_.size;
  // Chunks of whole blocks: sums are added in chunk order, whoever computed them.
  constexpr std::size_t kChunk = 32 * kernels::kBlock;
  const std::size_t chunks = (n + kChunk - 1) / kChunk;
  struct Part {
    kernels::Moments moments;
    std::vector<int> inliers;
    std::size_t count = 0;
    double squares = 0.0;
  };
  std::vector<Part> parts(chunks);
  const kernels::FloatPlane p = plane.as_float();
  const kernels::Window w = window_.as_float();
  constexpr float kLimit = static_cast<float>(kBiweight * kBiweight);
  constexpr float kInlier = static_cast<float>(kInlierSigmas * kInlierSigmas);
  const bool list = finish && options_.list_inliers;
  const auto work = [&](std::size_t c) {
    alignas(32) float x[kernels::kBlock], y[kernels::kBlock], z[kernels::kBlock],
        weight[kernels::kBlock];
    alignas(32) std::int32_t mask[kernels::kBlock];
    int buffer[kernels::kBlock];
    Part& part = parts[c];
    const std::size_t chunk_end = std::min(n, (c + 1) * kChunk);
    if (list) {
      part.inliers.reserve(static_cast<std::size_t>(std::min(1.0, 1.1 * inlier_share_ + 0.05) *
                                                    static_cast<double>(chunk_end - c * kChunk)));
    }
    for (std::size_t begin = c * kChunk; begin < chunk_end; begin += kernels::kBlock) {
      const std::size_t m = std::min(kernels::kBlock, chunk_end - begin);
      const std::size_t first = source_.stride * begin;
      kernels::load_points(source_.x + first, source_.y + first, source_.z + first, source_.stride,
                           m, pivot_, x, y, z, weight);
      for (std::size_t k = m; k < kernels::padded(m); ++k) x[k] = y[k] = z[k] = weight[k] = 0.0f;
      noise_.weigh(plane, m, x, y, z, source_.sigma ? source_.sigma + begin : nullptr,
                   source_.covariance ? source_.covariance + begin : nullptr, weight);
      const std::size_t rows = kernels::padded(m);
      kernels::accumulate(x, y, z, weight, rows, p, w, kLimit, false, &part.moments);
      if (!finish) continue;
      const int found =
          kernels::mark_inliers(x, y, z, weight, rows, p, kInlier, mask, &part.squares);
      part.count += static_cast<std::size_t>(found);
      if (!list) continue;
      int filled = 0;
      for (std::size_t k = 0; k < m; ++k) {
        buffer[filled] = static_cast<int>(begin + k);
        filled -= mask[k];
      }
      part.inliers.insert(part.inliers.end(), buffer, buffer + filled);
    }
  };
  parallel_for(chunks, options_.num_threads, work);
  kernels::Moments total;
  std::size_t count = 0;
  double squares = 0.0;
  for (const Part& part : parts) {
    total += part.moments;
    count += part.count;
    squares += part.squares;
  }
  if (finish) {
    fit->num_inliers = count;
    fit->rmse = count > 0 ? std::sqrt(squares / static_cast<double>(count)) : fit->rmse;
    if (list) {
      if (chunks == 1) {
        fit->inliers = std::move(parts[0].inliers);
      } else {
        fit->inliers.reserve(count);
        for (const Part& part : parts) {
          fit->inliers.insert(fit->inliers.end(), part.inliers.begin(), part.inliers.end());
        }
      }
    }
  }
  return total;
}

/// Covariance at the weighted centroid, condition, status.
void Fitter::describe(const kernels::Moments& full, const kernels::Moments& s, PlaneFit* fit) {
  // Everything about the weighted centroid (mu, mv) of the window's coordinates.
  const double mu = full.u / full.weight, mv = full.v / full.weight;
  const auto about = [&](double m1, double m_u, double m_v, double uu, double uv, double vv) {
    Matrix3d h;
    h(0, 0) = uu - 2.0 * mu * m_u + mu * mu * m1;
    h(0, 1) = h(1, 0) = uv - mu * m_v - mv * m_u + mu * mv * m1;
    h(1, 1) = vv - 2.0 * mv * m_v + mv * mv * m1;
    h(0, 2) = h(2, 0) = m_u - mu * m1;
    h(1, 2) = h(2, 1) = m_v - mv * m1;
    h(2, 2) = m1;
    return h;
  };
  const Matrix3d hessian = about(full.weight, full.u, full.v, full.uu, full.uv, full.vv);
  const double share = full.weight / std::max(s.weight, 1e-300);  // the subset's sums to all points
  const Matrix3d spread = share * about(s.i1, s.iu, s.iv, s.iuu, s.iuv, s.ivv);
  const double kappa = std::clamp(full.slope / full.weight, 0.2, 1.2);

  UncertainPlane& out = fit->plane;
  const Vector3d pivot = Vector3d(pivot_[0], pivot_[1], pivot_[2]) + source_.origin;
  Vector3d centroid = window_.center + mu * window_.a + mv * window_.b;
  centroid -= (plane_.n.dot(centroid) + plane_.d) * plane_.n;
  out.plane.normal = plane_.n;
  out.centroid = centroid + pivot;
  out.plane.offset = -plane_.n.dot(out.centroid);

  // In-plane scatter decides what is observable.
  const Eigen::Matrix2d scatter = hessian.topLeftCorner<2, 2>() / full.weight;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> in_plane;
  in_plane.computeDirect(scatter);
  const double thin = std::max(in_plane.eigenvalues()[0], 0.0), wide = in_plane.eigenvalues()[1];
  fit->condition = thin > 0.0 ? wide / thin : std::numeric_limits<double>::infinity();
  out.axis1 = window_.a * in_plane.eigenvectors()(0, 1) + window_.b * in_plane.eigenvectors()(1, 1);
  out.axis1 = (out.axis1 - out.axis1.dot(plane_.n) * plane_.n).normalized();
  // The sign of an eigenvector is free: point along the axis' largest component.
  int largest = 0;
  out.axis1.cwiseAbs().maxCoeff(&largest);
  if (out.axis1[largest] < 0.0) out.axis1 = -out.axis1;
  out.axis2 = plane_.n.cross(out.axis1);

  // Covariance of (alpha, beta, gamma): sandwich, with the small-sample factor.
  const double points = std::max(full.count, 1.0);
  const double small = points > 3.5 ? points / (points - 3.0) : 1e6;
  const Matrix3d inverse = hessian.inverse();
  Matrix3d covariance = inverse * spread * inverse.transpose() * small / (kappa * kappa);
  if (points < 12.0) {
    // Too few residuals to tell their spread: take the points' own noise.
    covariance = covariance.cwiseMax(inverse.cwiseAbs().cwiseProduct(Matrix3d::Identity()));
  }
  // The surface n . x + d = 0 raised by alpha u + beta v + gamma has the normal n - alpha a - beta
  // b; a turn (t1, t2) about the axes gives n + t1 axis1 x n + t2 axis2 x n = n - t1 axis2 + t2
  // axis1.
  Eigen::Matrix3d turn = Matrix3d::Zero();
  turn(0, 0) = out.axis2.dot(window_.a);
  turn(0, 1) = out.axis2.dot(window_.b);
  turn(1, 0) = -out.axis1.dot(window_.a);
  turn(1, 1) = -out.axis1.dot(window_.b);
  turn(2, 2) = 1.0;
  out.covariance = turn * covariance * turn.transpose();
  out.covariance = 0.5 * (out.covariance + out.covariance.transpose()).eval();
  const double one = std::sqrt(full.count / std::max(full.weight, 1e-300));
  fit->noise = one;

  const bool line = !(thin > 1e-8 * wide) || !out.covariance.allFinite() ||
                    std::sqrt(thin) < 3.0 * one / std::sqrt(points);
  if (line) {
    // The plane through the line that is nearest to level.
    const Vector3d along = out.axis1;
    const Vector3d level = up_ - up_.dot(along) * along;
    fit->status = Status::kNotObservable;
    fit->reason = "the points lie on a line";
    if (level.norm() > 1e-9) {
      out.plane.normal = level.normalized();
      out.plane.offset = -out.plane.normal.dot(out.centroid);
      out.axis2 = out.plane.normal.cross(along);
    }
    out.covariance =
        Vector3d(1.0, one * one / points / std::max(wide, 1e-300), one * one).asDiagonal();
    return;
  }
  const double tilt = std::sqrt(std::max(out.covariance(0, 0), out.covariance(1, 1)));
  if (points < 12.0) {
    fit->status = Status::kWeak;
    fit->reason = fmt::format("only {} points lie on the plane", static_cast<long>(points));
  } else if (tilt > kWeakTilt) {
    fit->status = Status::kWeak;
    fit->reason = fmt::format("the tilt's standard deviation is {:.3g} rad", tilt);
  } else {
    fit->status = Status::kOk;
  }
}

PlaneFit Fitter::run() {
  if (!choose_subset()) {
    return fail(Status::kFailed, fmt::format("{} usable points, at least 3 are needed",
                                             static_cast<long>(chosen_.size())));
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
    learn_noise();
  }
  // Weights of the scored points: with rays the plane's part is left to the kernel.
  {
    LocalPlane level;
    level.n = up_;
    PointArrays& s = scored_;
    if (noise_.kind == NoiseKind::kRays) {
      for (std::size_t k = 0; k < s.size; ++k) {
        const double s2 = (Vector3d(s.x[k], s.y[k], s.z[k]) - noise_.viewpoint).squaredNorm();
        const double sigma = s.sigma[k];
        const bool good = sigma > 1e-12 && sigma < 1e12 && s2 > 0.0;
        s.w[k] = good ? static_cast<float>(s2 / (sigma * sigma)) : 0.0f;
        s.floor2[k] = static_cast<float>(std::max(kGrazingFloor * kGrazingFloor * s2, 1e-12));
      }
    } else {
      noise_.weigh(level, s.size, s.x.data(), s.y.data(), s.z.data(), s.sigma.data(),
                   s.covariance.data(), s.w.data());
    }
  }
  if (!search()) {
    return fail(Status::kFailed,
                fmt::format("no plane within {:.3g} rad of the up direction", options_.max_tilt));
  }

  window_.center = Vector3d::Zero();
  refine_on_subset();
  rescale_noise();
  refine_on_subset();
  set_window();

  PlaneFit fit;
  fit.hypotheses = hypotheses_;
  LocalPlane plane = plane_;
  kernels::Moments full;
  const int passes = n <= kManyPasses ? 8 : 1;
  for (int pass = 0; pass < passes; ++pass) {
    align(plane, &window_);
    const bool last = pass + 1 == passes;
    full = all_moments(plane, last, &fit);
    LocalPlane next = plane;
    double step = 0.0;
    if (!solve(full, window_, true, &next, &step)) {
      if (!last) full = all_moments(plane, true, &fit);
      break;
    }
    plane = next;
    const double unit = std::sqrt(full.count / full.weight);
    if (!last && step < 1e-3 * unit / std::sqrt(std::max(full.count, 1.0))) {
      full = all_moments(plane, true, &fit);
      break;
    }
  }
  plane_ = plane;
  align(plane_, &window_);
  if (!(full.weight > 0.0)) {
    return fail(Status::kFailed, "no points lie on a common plane");
  }
  if (plane_.n.dot(up_) < std::cos(options_.max_tilt) - 1e-6) {
    return fail(Status::kFailed,
                fmt::format("no plane within {:.3g} rad of the up direction", options_.max_tilt));
  }
  const kernels::Moments influence = subset_moments(plane_, window_, kBiweight * kBiweight, true);
  describe(full, influence, &fit);
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
