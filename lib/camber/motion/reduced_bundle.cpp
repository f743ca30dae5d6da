#include "camber/motion/reduced_bundle.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <numeric>

#include "camber/core/threads.h"

namespace camber {
namespace {

/// A projection and its derivatives; false behind the camera.
struct Linearisation {
  Eigen::Vector2d residual;
  Eigen::Matrix<double, 2, 6> by_view;
  Eigen::Vector2d by_depth;
};

struct View {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;
};

std::vector<View> unpacked(const std::vector<SE3>& views) {
  std::vector<View> out;
  out.reserve(views.size());
  for (const SE3& view : views) out.push_back({view.rotation_matrix(), view.translation()});
  return out;
}

bool project(const PinholeCamera& camera, const View& view, const Eigen::Vector3d& ray, double rho,
             const Eigen::Vector2d& pixel, Eigen::Vector3d* turned, Eigen::Vector3d* point,
             Eigen::Vector2d* residual) {
  *turned = view.rotation * ray;
  *point = *turned + rho * view.translation;
  if (!(point->z() > 1e-6)) return false;
  *residual = Eigen::Vector2d(camera.fx * point->x() / point->z() + camera.cx - pixel.x(),
                              camera.fy * point->y() / point->z() + camera.cy - pixel.y());
  return true;
}

bool linearise(const PinholeCamera& camera, const View& view, const Eigen::Vector3d& ray,
               double rho, const Eigen::Vector2d& pixel, Linearisation* out) {
  Eigen::Vector3d a, p;
  if (!project(camera, view, ray, rho, pixel, &a, &p, &out->residual)) return false;
  Eigen::Matrix<double, 2, 3> projection;
  projection << camera.fx / p.z(), 0, -camera.fx * p.x() / (p.z() * p.z()), 0, camera.fy / p.z(),
      -camera.fy * p.y() / (p.z() * p.z());
  out->by_view.leftCols<3>() = -projection * skew(a);
  out->by_view.rightCols<3>() = projection * rho;
  out->by_depth = projection * view.translation;
  return true;
}

double cauchy_loss(double squared, double scale) {
  return scale * scale * std::log1p(squared / (scale * scale));
}

/// Observations of whole points, in pieces of about the same size; the same for any machine.
std::vector<std::size_t> pieces(const BundleProblem& problem) {
  constexpr std::size_t kPiece = 512;
  std::vector<std::size_t> out = {0};
  const std::size_t count = problem.observations.size();
  for (std::size_t at = kPiece; at < count; at += kPiece) {
    while (at < count && problem.observations[at].point == problem.observations[at - 1].point) ++at;
    if (at < count) out.push_back(at);
  }
  out.push_back(count);
  return out;
}

/// What elimination keeps of each point, to put its depth back.
struct Eliminated {
  double information = 0.0, gradient = 0.0;
};

/// One pass: the cost (infinite if a point is behind a camera), the views' system and, if wanted,
/// what is needed to put the depths back.
/// @param damping  Levenberg-Marquardt, on the depths: their information grows by this share.
/// @param crossed  one column a point: the coupling of its depth with all views.
ReducedBundle reduce(const BundleProblem& problem, const std::vector<View>& views,
                     const std::vector<double>& depths, double sigma_px, double damping,
                     std::vector<Eliminated>* eliminated, Eigen::MatrixXd* crossed) {
  const auto n = static_cast<Eigen::Index>(6 * views.size());
  if (eliminated) eliminated->assign(problem.rays.size(), {});
  if (crossed) crossed->setZero(n, static_cast<Eigen::Index>(problem.rays.size()));
  const double c2 = problem.cauchy * problem.cauchy, s2 = sigma_px * sigma_px;
  const auto block = [&](int view) { return static_cast<Eigen::Index>(6 * view); };
  const std::vector<std::size_t> ends = pieces(problem);
  std::vector<ReducedBundle> parts(ends.size() - 1);
  parallel_for(parts.size(), problem.num_threads, [&](std::size_t piece) {
    ReducedBundle& part = parts[piece];
    part.information = Eigen::MatrixXd::Zero(n, n);
    part.gradient = Eigen::VectorXd::Zero(n);
    // Of pairs of views, each with itself and those behind it.
    std::vector<Eigen::Matrix<double, 6, 6>> pairs(views.size() * views.size());
    for (auto& pair : pairs) pair.setZero();
    const auto pair_of = [&](int a, int b) -> Eigen::Matrix<double, 6, 6>& {
      return pairs[static_cast<std::size_t>(a) * views.size() + static_cast<std::size_t>(b)];
    };
    std::vector<int> seen;  // views of a point
    std::vector<Eigen::Matrix<double, 6, 1>> cross;
    for (std::size_t at = ends[piece]; at < ends[piece + 1];) {
      const int point = problem.observations[at].point;
      const auto i = static_cast<std::size_t>(point);
      seen.clear();
      cross.clear();
      double information = 1e-9, gradient = 0.0;
      for (; at < ends[piece + 1] && problem.observations[at].point == point; ++at) {
        const BundleObservation& o = problem.observations[at];
        Linearisation l;
        if (!linearise(problem.camera, views[static_cast<std::size_t>(o.view)], problem.rays[i],
                       depths[i], o.pixel, &l)) {
          part.cost = std::numeric_limits<double>::infinity();
          continue;
        }
        const double squared = l.residual.squaredNorm() / s2;
        part.cost += cauchy_loss(squared, problem.cauchy);
        const double weight = 1.0 / (s2 * (1.0 + squared / c2));
        const Eigen::Matrix<double, 2, 6> weighted = weight * l.by_view;
        pair_of(o.view, o.view).noalias() += weighted.transpose() * l.by_view;
        part.gradient.segment<6>(block(o.view)).noalias() += weighted.transpose() * l.residual;
        information += weight * l.by_depth.squaredNorm();
        gradient += weight * l.by_depth.dot(l.residual);
        seen.push_back(o.view);
        cross.push_back(weighted.transpose() * l.by_depth);
      }
      information *= 1.0 + damping;
      for (std::size_t a = 0; a < seen.size(); ++a) {
        const Eigen::Matrix<double, 6, 1> share = cross[a] / information;
        for (std::size_t b = 0; b < seen.size(); ++b) {
          if (seen[b] >= seen[a]) {
            pair_of(seen[a], seen[b]).noalias() -= share * cross[b].transpose();
          }
        }
        part.gradient.segment<6>(block(seen[a])) -= cross[a] * (gradient / information);
        if (crossed) {
          crossed->col(static_cast<Eigen::Index>(i)).segment<6>(block(seen[a])) += cross[a];
        }
      }
      if (eliminated) (*eliminated)[i] = {information, gradient};
    }
    const auto count = static_cast<int>(views.size());
    for (int a = 0; a < count; ++a) {
      for (int b = a; b < count; ++b) {
        part.information.block<6, 6>(block(a), block(b)) = pair_of(a, b);
        part.information.block<6, 6>(block(b), block(a)) = pair_of(a, b).transpose();
      }
    }
  });
  ReducedBundle out = std::move(parts.front());
  for (std::size_t piece = 1; piece < parts.size(); ++piece) {
    out.information += parts[piece].information;
    out.gradient += parts[piece].gradient;
    out.cost += parts[piece].cost;
  }
  return out;
}

}  // namespace

ReducedBundle reduce_bundle(const BundleProblem& problem, const std::vector<SE3>& views,
                            const std::vector<double>& inverse_depths, double sigma_px) {
  return reduce(problem, unpacked(views), inverse_depths, sigma_px, 0.0, nullptr, nullptr);
}

Eigen::Matrix2Xd bundle_residuals(const BundleProblem& problem, const std::vector<SE3>& views,
                                  const std::vector<double>& inverse_depths) {
  const std::vector<View> all = unpacked(views);
  Eigen::Matrix2Xd out(2, static_cast<Eigen::Index>(problem.observations.size()));
  Eigen::Vector3d a, p;
  Eigen::Vector2d r;
  for (std::size_t k = 0; k < problem.observations.size(); ++k) {
    const BundleObservation& o = problem.observations[k];
    const auto i = static_cast<std::size_t>(o.point);
    if (!project(problem.camera, all[static_cast<std::size_t>(o.view)], problem.rays[i],
                 inverse_depths[i], o.pixel, &a, &p, &r)) {
      r.setConstant(std::numeric_limits<double>::quiet_NaN());
    }
    out.col(static_cast<Eigen::Index>(k)) = r;
  }
  return out;
}

bool solve_bundle(const BundleProblem& problem, std::size_t longest, double sigma_px,
                  std::vector<SE3>& views, std::vector<double>& inverse_depths) {
  constexpr int kMostSteps = 40;
  constexpr double kEnough = 1e-5;  // relative decrease of the cost
  std::vector<View> at = unpacked(views);
  double damping = 1e-4;
  std::vector<Eliminated> eliminated, next_eliminated;
  Eigen::MatrixXd crossed, next_crossed;
  ReducedBundle system =
      reduce(problem, at, inverse_depths, sigma_px, damping, &eliminated, &crossed);
  if (!std::isfinite(system.cost)) return false;
  const double length = views[longest].translation().norm();
  for (int step = 0; step < kMostSteps; ++step) {
    Eigen::MatrixXd information = system.information;
    information.diagonal() *= 1.0 + damping;
    // The gauge: no step along the longest baseline.
    const auto t = static_cast<Eigen::Index>(6 * longest + 3);
    const Eigen::Vector3d axis = at[longest].translation.normalized();
    information.block<3, 3>(t, t) +=
        1e6 * information.diagonal().maxCoeff() * axis * axis.transpose();
    information.diagonal().array() += 1e-9 * information.diagonal().maxCoeff();
    const Eigen::VectorXd change = information.ldlt().solve(-system.gradient);
    std::vector<SE3> moved = views;
    for (std::size_t v = 0; v < views.size(); ++v) {
      const auto block = static_cast<Eigen::Index>(6 * v);
      moved[v] = SE3(rotation_from_vector(change.segment<3>(block)) * views[v].rotation(),
                     views[v].translation() + change.segment<3>(block + 3));
    }
    // Exactly the length: all translations and depths together are free in scale.
    const double stretch = length / moved[longest].translation().norm();
    std::vector<double> depths = inverse_depths;
    for (std::size_t i = 0; i < depths.size(); ++i) {
      if (!(eliminated[i].information > 0)) continue;
      depths[i] -=
          (eliminated[i].gradient + crossed.col(static_cast<Eigen::Index>(i)).dot(change)) /
          eliminated[i].information;
      depths[i] /= stretch;
    }
    for (SE3& view : moved) view.set_translation(view.translation() * stretch);
    std::vector<View> there = unpacked(moved);
    // With the damping of a step that succeeds, so that the next one has its system already.
    const double less_damping = std::max(1e-7, 0.1 * damping);
    ReducedBundle next =
        reduce(problem, there, depths, sigma_px, less_damping, &next_eliminated, &next_crossed);
    if (!(next.cost < system.cost)) {
      damping *= 10.0;
      if (damping > 1e6) break;
      system = reduce(problem, at, inverse_depths, sigma_px, damping, &eliminated, &crossed);
      continue;
    }
    const bool enough = system.cost - next.cost < kEnough * system.cost;
    views = std::move(moved);
    inverse_depths = std::move(depths);
    at = std::move(there);
    damping = less_damping;
    system = std::move(next);
    std::swap(eliminated, next_eliminated);
    std::swap(crossed, next_crossed);
    if (enough) break;
  }
  return true;
}

}  // namespace camber
