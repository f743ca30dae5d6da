#include "camber/plane/detail/plane_hypotheses.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace camber::detail {

using Eigen::Matrix3d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

constexpr std::size_t kCandidates = 8;  // distinct planes that compete at the end
constexpr double kRival = 0.6;          // share of the best gain that makes a competitor

}  // namespace

PlaneHypotheses::PlaneHypotheses(const PlaneFitOptions& options, const NoiseModel& noise,
                                 PlaneSample* sample)
    : options_(options),
      noise_(noise),
      sample_(*sample),
      up_(options.up.normalized()),
      random_(options.seed, 3),
      nothing_(kInlierSigmas * kInlierSigmas * static_cast<double>(sample->scored.size)) {
  // Weights of the scored points: with rays the plane's part is left to the kernel.
  if (noise_.kind == NoiseKind::kRays) {
    PointArrays& s = sample_.scored;
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
    sample_.scored.weigh(noise_, level);
  }
}

bool PlaneHypotheses::search() { return search_samples() || take_line(); }

/// Turns the normal to the up side; whether it is within the largest tilt.
bool PlaneHypotheses::orient(PivotPlane* plane) const {
  if (plane->n.dot(up_) < 0.0) {
    plane->n = -plane->n;
    plane->d = -plane->d;
  }
  return plane->n.dot(up_) >= std::cos(options_.max_tilt) - 1e-12;
}

double PlaneHypotheses::cost(const PivotPlane& plane, double bound) const {
  constexpr float kLimit = static_cast<float>(kInlierSigmas * kInlierSigmas);
  const kernels::Rows rows = {sample_.scored.x.data(), sample_.scored.y.data(),
                              sample_.scored.z.data(), sample_.scored.w.data(),
                              kernels::padded(sample_.scored.size)};
  const float most = static_cast<float>(std::min(bound, 1e30));
  if (noise_.kind == NoiseKind::kRays) {
    const double height = plane.n.dot(noise_.viewpoint) + plane.d;
    return kernels::msac_cost_rays(rows, sample_.scored.floor2.data(), plane.as_float(),
                                   static_cast<float>(height * height), kLimit, most);
  }
  return kernels::msac_cost(rows, plane.as_float(), kLimit, most);
}

/// Refines a plane on the scored points as long as its cost falls.
void PlaneHypotheses::refine(PivotPlane* plane, double* cost_of_plane) const {
  constexpr double kLimit = 2.0 * kInlierSigmas * kInlierSigmas;
  PointArrays rays;
  const PointArrays* s = &sample_.scored;
  if (noise_.kind == NoiseKind::kRays || noise_.kind == NoiseKind::kCovariance) {
    rays = sample_.scored;  // the scored points keep their weights for the cost
    s = &rays;
  }
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
  }
}

/// A minimal sample: three points from all over the cloud, or of a neighbourhood; false where they
/// span no plane, or one that is too steep.
bool PlaneHypotheses::draw(std::uint64_t number, PivotPlane* plane) const {
  const std::size_t n = sample_.ordered.size;
  std::size_t i, j, k;
  if (number % 2 == 0) {
    i = random_.below(4 * number, n);
    j = random_.below(4 * number + 1, n);
    k = random_.below(4 * number + 2, n);
  } else {
    // Rows near each other in this order are near in space.
    const std::size_t near = std::max<std::size_t>(std::min<std::size_t>(n, 16), n / 16);
    const std::size_t begin = random_.below(4 * number + 3, n - near + 1);
    i = begin + random_.below(4 * number, near);
    j = begin + random_.below(4 * number + 1, near);
    k = begin + random_.below(4 * number + 2, near);
  }
  if (i == j || j == k || i == k) return false;
  const Vector3d p = sample_.ordered.point(i), a = sample_.ordered.point(j) - p,
                 b = sample_.ordered.point(k) - p;
  const Vector3d cross = a.cross(b);
  const double norm = cross.norm();
  if (!(norm > 1e-6 * std::max(a.squaredNorm(), b.squaredNorm()))) return false;
  plane->n = cross / norm;
  plane->d = -plane->n.dot(p);
  return orient(plane);
}

bool PlaneHypotheses::search_samples() {
  double needed = options_.max_hypotheses;
  const std::uint64_t most_draws = 20ull * static_cast<std::uint64_t>(options_.max_hypotheses);
  for (std::uint64_t number = 0; number < most_draws && hypotheses_ < needed; ++number) {
    PlaneCandidate candidate;
    PivotPlane& plane = candidate.plane;
    if (!draw(number, &plane)) continue;
    ++hypotheses_;
    // A raw sample of a plane reaches about half of what refinement makes of it.
    const double floor = candidates_.size() > 0 ? 0.5 * kRival * best_gain_ : 0.0;
    double value = cost(plane, nothing_ - floor);
    if (!(nothing_ - value > floor)) continue;
    // Known already, and no better: nothing to gain.
    const PlaneCandidate* known = find(plane);
    if (known && nothing_ - value <= known->gain) continue;
    refine(&plane, &value);
    candidate.gain = nothing_ - value;
    if (candidate.gain < kRival * best_gain_) continue;
    if (!describe(&candidate)) continue;
    insert(candidate);
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

/// Adds a candidate, or puts it in the place of one that is the same plane, and prunes the rest.
void PlaneHypotheses::insert(const PlaneCandidate& candidate) {
  if (PlaneCandidate* known = find(candidate.plane)) {
    if (candidate.gain > known->gain) *known = candidate;
  } else {
    candidates_.push_back(candidate);
  }
  if (candidate.gain > best_gain_) {
    best_gain_ = candidate.gain;
    candidates_.erase(
        std::remove_if(candidates_.begin(), candidates_.end(),
                       [&](const PlaneCandidate& c) { return c.gain < kRival * best_gain_; }),
        candidates_.end());
    inlier_share_ = std::clamp(candidate.gain / nothing_, 0.0, 1.0);
  }
  std::sort(candidates_.begin(), candidates_.end(),
            [](const PlaneCandidate& l, const PlaneCandidate& r) { return l.gain > r.gain; });
  if (candidates_.size() > kCandidates) candidates_.resize(kCandidates);
}

/// The candidate that is the same plane as far as its points can show.
PlaneCandidate* PlaneHypotheses::find(const PivotPlane& plane) {
  for (PlaneCandidate& other : candidates_) {
    if (other.plane.n.dot(plane.n) < std::cos(1.5 * M_PI / 180.0)) continue;
    const double apart = plane.n.dot(other.window.center) + plane.d;
    if (std::abs(apart) < 6.0 * other.window.ramp_u) return &other;
  }
  return nullptr;
}

/// Finds the middle of a candidate's points, and their noise (as the window's ramp), which
/// distinguish it from others; false if it has no points.
bool PlaneHypotheses::describe(PlaneCandidate* candidate) const {
  PointArrays rays;
  const PointArrays* s = &sample_.scored;
  if (noise_.kind == NoiseKind::kRays) {
    rays = sample_.scored;
    rays.weigh(noise_, candidate->plane);
    s = &rays;
  }
  PlaneWindow window;
  align(candidate->plane, &window);
  const kernels::Moments m =
      sum_moments(*s, candidate->plane, window, kInlierSigmas * kInlierSigmas,
                  kernels::Loss::kReweighted, false);
  if (!(m.weight > 0.0)) return false;
  candidate->window = window;
  candidate->window.center += m.u / m.weight * window.a + m.v / m.weight * window.b;
  candidate->window.ramp_u = std::sqrt(m.count / m.weight);
  return true;
}

/// Points on a line span no plane: the candidate is the one through them that is nearest to level.
bool PlaneHypotheses::take_line() {
  if (hypotheses_ > 0) return false;
  Vector3d mean = Vector3d::Zero();
  for (std::size_t k = 0; k < sample_.usable; ++k) mean += sample_.subset.point(k);
  mean /= static_cast<double>(sample_.usable);
  Matrix3d scatter = Matrix3d::Zero();
  for (std::size_t k = 0; k < sample_.usable; ++k) {
    const Vector3d p = sample_.subset.point(k) - mean;
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

}  // namespace camber::detail
