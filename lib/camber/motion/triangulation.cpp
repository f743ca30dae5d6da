#include "camber/motion/triangulation.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/threads.h"

namespace camber {
namespace {

/// Standard deviation of a match's coordinate along the unit direction e, px. Optical flow errs by
/// the image noise over the gradient along e (Szeliski, "Computer Vision", 2nd ed., section
/// 9.1.3), plus what the run's own residuals show at well-textured points.
double match_sigma(const Eigen::Vector3f& texture, const Eigen::Vector2d& e, double round_trip,
                   double pixel_sigma, const MatchNoise& noise) {
  const double energy =
      texture.x() * e.x() * e.x() + 2.0 * texture.y() * e.x() * e.y() + texture.z() * e.y() * e.y();
  const double own = noise.round_trip_share * round_trip;
  return std::sqrt(pixel_sigma * pixel_sigma +
                   noise.intensity * noise.intensity / (energy + noise.least_texture) + own * own);
}

enum class Outcome : std::uint8_t { kAccepted, kUnwanted, kDropped };

}  // namespace

std::string to_string(DropReason reason) {
  switch (reason) {
    case DropReason::kNoMatch:
      return "no_match";
    case DropReason::kNearFocusOfExpansion:
      return "near_focus_of_expansion";
    case DropReason::kBehindCamera:
      return "behind_camera";
    case DropReason::kInconsistent:
      return "inconsistent";
  }
  return "unknown";
}

void TriangulationOptions::validate() const {
  if (!(max_relative_sigma > 0)) {
    throw std::invalid_argument("max_relative_sigma = " + std::to_string(max_relative_sigma) +
                                ", expected > 0");
  }
  if (!(max_residual > 0)) {
    throw std::invalid_argument("max_residual = " + std::to_string(max_residual) +
                                ", expected > 0");
  }
}

double TriangulatedPoints::sigma_total(std::size_t i,
                                       const Eigen::MatrixXd& pose_covariance) const {
  const Eigen::VectorXd j =
      pose_jacobian.row(static_cast<Eigen::Index>(i)).cast<double>().transpose();
  return std::sqrt(sigma_own[i] * sigma_own[i] + j.dot(pose_covariance * j));
}

TriangulatedPoints TriangulatedPoints::chosen(const std::vector<std::uint8_t>& wanted) const {
  TriangulatedPoints out;
  out.dropped = dropped;
  std::vector<Eigen::Index> rows;
  for (std::size_t i = 0; i < size(); ++i) {
    if (!wanted.at(static_cast<std::size_t>(grid[i]))) continue;
    out.grid.push_back(grid[i]);
    out.rays.push_back(rays[i]);
    out.inverse_depth.push_back(inverse_depth[i]);
    out.sigma_own.push_back(sigma_own[i]);
    rows.push_back(static_cast<Eigen::Index>(i));
  }
  if (pose_jacobian.size() > 0) out.pose_jacobian = pose_jacobian(rows, Eigen::all);
  return out;
}

TriangulatedPoints triangulate(const PinholeCamera& camera, const Correspondences& matches,
                               const MotionEstimate& motion,
                               const std::vector<std::uint8_t>& wanted,
                               const TriangulationOptions& options) {
  options.validate();
  if (wanted.size() != matches.pixels.size()) {
    throw std::invalid_argument("wanted has " + std::to_string(wanted.size()) +
                                " entries, expected one for each of " +
                                std::to_string(matches.pixels.size()) + " grid points");
  }
  const std::size_t others = matches.matches.size();
  const auto columns = static_cast<Eigen::Index>(6 * others);
  std::vector<Eigen::Matrix3d> rotations;
  std::vector<Eigen::Vector3d> translations;
  for (const MatchedImage& match : matches.matches) {
    const SE3& pose = motion.frame_from_reference.at(static_cast<std::size_t>(match.frame));
    rotations.push_back(pose.rotation_matrix());
    translations.push_back(pose.translation());
  }

  const std::size_t total = matches.pixels.size();
  std::vector<Outcome> outcome(total, Outcome::kUnwanted);
  std::vector<DropReason> reason(total, DropReason::kNoMatch);
  std::vector<double> inverse_depth(total, 0.0), sigma(total, 0.0);

  struct View {
    std::size_t other;
    Eigen::Vector3d a;       // rotated ray
    Eigen::Vector2d pixel;   // observed
    Eigen::Matrix2d weight;  // inverse covariance of the observation, px^-2
  };
  // The projection of a + rho t and its derivative by rho.
  const auto linearise = [&](const View& view, double rho, Eigen::Vector2d* residual,
                             Eigen::Vector2d* by_depth, Eigen::Matrix<double, 2, 3>* projection) {
    const Eigen::Vector3d p = view.a + rho * translations[view.other];
    if (!(p.z() > 1e-4)) return false;
    *projection << camera.fx / p.z(), 0, -camera.fx * p.x() / (p.z() * p.z()), 0, camera.fy / p.z(),
        -camera.fy * p.y() / (p.z() * p.z());
    *residual = Eigen::Vector2d(camera.fx * p.x() / p.z() + camera.cx,
                                camera.fy * p.y() / p.z() + camera.cy) -
                view.pixel;
    *by_depth = *projection * translations[view.other];
    return true;
  };

  const auto solve_point = [&](std::size_t i, std::vector<View>& views,
                               std::vector<float>* jacobians) {
    if (!wanted[i]) return;
    outcome[i] = Outcome::kDropped;
    views.clear();
    const Eigen::Vector3d ray = camera.ray(matches.pixels[i].cast<double>());
    double numerator = 0.0, denominator = 0.0;
    for (std::size_t m = 0; m < others; ++m) {
      const MatchedImage& match = matches.matches[m];
      if (!std::isfinite(match.round_trip_px[i])) continue;
      reason[i] = DropReason::kNearFocusOfExpansion;
      View view;
      view.other = m;
      view.a = rotations[m] * ray;
      view.pixel = match.pixels[i].cast<double>();
      // Epipolar direction at the observed pixel: away from the epipole.
      const Eigen::Vector3d& t = translations[m];
      const Eigen::Vector2d along(camera.fx * t.x() + (camera.cx - view.pixel.x()) * t.z(),
                                  camera.fy * t.y() + (camera.cy - view.pixel.y()) * t.z());
      const double norm = along.norm();
      if (!(norm > 1e-9)) continue;
      const Eigen::Vector2d e = along / norm, across(-e.y(), e.x());
      const double s1 = match_sigma(matches.texture[i], e, match.round_trip_px[i],
                                    motion.pixel_sigma, options.noise);
      const double s2 = match_sigma(matches.texture[i], across, match.round_trip_px[i],
                                    motion.pixel_sigma, options.noise);
      view.weight = e * e.transpose() / (s1 * s1) + across * across.transpose() / (s2 * s2);
      views.push_back(view);
      // Linear start (normalised coordinates, each view by its parallax over depth).
      const Eigen::Vector3d z = camera.ray(view.pixel);
      const double b0 = t.x() - z.x() * t.z(), b1 = t.y() - z.y() * t.z();
      const double e0 = z.x() * view.a.z() - view.a.x(), e1 = z.y() * view.a.z() - view.a.y();
      numerator += (b0 * e0 + b1 * e1) / (s1 * s1);
      denominator += (b0 * b0 + b1 * b1) / (s1 * s1);
    }
    if (views.empty()) return;  // no match, or only on the very focus of expansion
    if (!(denominator > 1e-12)) return;
    double rho = numerator / denominator;
    Eigen::Vector2d residual, by_depth;
    Eigen::Matrix<double, 2, 3> projection;
    double information = 0.0;
    for (int iteration = 0; iteration < 3; ++iteration) {
      double gradient = 0.0;
      information = 0.0;
      for (const View& view : views) {
        if (!linearise(view, rho, &residual, &by_depth, &projection)) {
          reason[i] = DropReason::kBehindCamera;
          return;
        }
        gradient += by_depth.dot(view.weight * residual);
        information += by_depth.dot(view.weight * by_depth);
      }
      if (!(information > 0)) return;
      rho -= gradient / information;
    }
    const double sigma_rho = 1.0 / std::sqrt(information);
    if (!(sigma_rho < options.max_relative_sigma * std::abs(rho))) return;
    if (!(rho > 0)) {
      reason[i] = DropReason::kBehindCamera;
      return;
    }
    double chi2 = 0.0;
    double worst = 0.0;
    const std::size_t own = jacobians ? jacobians->size() : 0;
    if (jacobians) jacobians->resize(own + static_cast<std::size_t>(columns), 0.0f);
    const auto discard = [&] {
      if (jacobians) jacobians->resize(own);
    };
    for (const View& view : views) {
      if (!linearise(view, rho, &residual, &by_depth, &projection)) {
        reason[i] = DropReason::kBehindCamera;
        return discard();
      }
      const double r2 = residual.dot(view.weight * residual);
      chi2 += r2;
      worst = std::max(worst, r2);
      if (jacobians) {
        // d rho / d pose = -(1 / information) by_depth' W d(projection) / d pose.
        const Eigen::RowVector3d left =
            -(by_depth.transpose() * view.weight * projection) / information;
        Eigen::Map<Eigen::Matrix<float, 1, 6>> row(jacobians->data() + own + 6 * view.other);
        row.head<3>() = (-left * skew(view.a)).cast<float>();
        row.tail<3>() = (left * rho).cast<float>();
      }
    }
    if (worst > options.max_residual * options.max_residual) {
      reason[i] = DropReason::kInconsistent;
      return discard();
    }
    // Contradicting matches widen the estimate (reduced chi-square above 1).
    const double freedom = 2.0 * static_cast<double>(views.size()) - 1.0;
    sigma[i] = sigma_rho * std::sqrt(std::max(1.0, chi2 / freedom));
    inverse_depth[i] = rho;
    outcome[i] = Outcome::kAccepted;
  };

  // The accepted points' derivatives, row by row of the grid.
  std::vector<std::vector<float>> jacobians(static_cast<std::size_t>(matches.rows));
  parallel_for(jacobians.size(), options.num_threads, [&](std::size_t row) {
    std::vector<View> views;
    const auto first = row * static_cast<std::size_t>(matches.columns);
    for (std::size_t i = first; i < first + static_cast<std::size_t>(matches.columns); ++i) {
      solve_point(i, views, options.with_pose_jacobian ? &jacobians[row] : nullptr);
    }
  });

  TriangulatedPoints out;
  for (std::size_t i = 0; i < total; ++i) {
    if (outcome[i] == Outcome::kDropped) ++out.dropped[static_cast<std::size_t>(reason[i])];
    if (outcome[i] != Outcome::kAccepted) continue;
    out.grid.push_back(static_cast<int>(i));
    out.rays.push_back(camera.ray(matches.pixels[i].cast<double>()));
    out.inverse_depth.push_back(inverse_depth[i]);
    out.sigma_own.push_back(sigma[i]);
  }
  if (!options.with_pose_jacobian) return out;
  out.pose_jacobian.resize(static_cast<Eigen::Index>(out.size()), columns);
  float* to = out.pose_jacobian.data();
  for (const std::vector<float>& row : jacobians) to = std::copy(row.begin(), row.end(), to);
  return out;
}

}  // namespace camber
