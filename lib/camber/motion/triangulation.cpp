#include "camber/motion/triangulation.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "camber/core/threads.h"

namespace camber {
namespace {

/// Variance of a match's coordinate along the unit direction e, px^2. Optical flow errs by the
/// image noise over the gradient along e (Szeliski, "Computer Vision", 2nd ed., section 9.1.3),
/// plus what the run's own residuals show at well-textured points.
double match_variance(const Eigen::Vector3f& texture, const Eigen::Vector2d& e, double round_trip,
                      double pixel_sigma, const MatchNoise& noise) {
  const double energy =
      texture.x() * e.x() * e.x() + 2.0 * texture.y() * e.x() * e.y() + texture.z() * e.y() * e.y();
  const double own = noise.round_trip_share * round_trip;
  return pixel_sigma * pixel_sigma +
         noise.intensity * noise.intensity / (energy + noise.least_texture) + own * own;
}

enum class Outcome : std::uint8_t { kAccepted, kUnwanted, kDropped };

/// A reference point as another image sees it.
struct View {
  std::size_t other;       ///< row of Correspondences::matches
  Eigen::Vector3d ray;     ///< of the reference, rotated into that image
  Eigen::Vector2d pixel;   ///< observed
  Eigen::Matrix2d weight;  ///< inverse covariance of the observation, px^-2
};

/// The inverse depth of reference rays by Gauss-Newton over all images that see them.
class PointSolver {
 public:
  struct Point {
    Outcome outcome = Outcome::kUnwanted;
    DropReason reason = DropReason::kNoMatch;
    double inverse_depth = 0.0;
    double sigma = 0.0;  ///< of the inverse depth by the matches' own noise
  };

  PointSolver(const PinholeCamera& camera, const Correspondences& matches,
              const MotionEstimate& motion, const TriangulationOptions& options)
      : camera_(camera), matches_(matches), motion_(motion), options_(options) {
    for (const MatchedImage& match : matches.matches) {
      const SE3& pose = motion.frame_from_reference.at(static_cast<std::size_t>(match.frame));
      rotations_.push_back(pose.rotation_matrix());
      translations_.push_back(pose.translation());
    }
  }

  /// @param views      scratch.
  /// @param jacobians  the derivative by all poses (6 an image) is appended for an accepted point;
  ///                   may be null.
  Point solve(std::size_t i, std::vector<View>& views, std::vector<float>* jacobians) const {
    Point out;
    out.outcome = Outcome::kDropped;
    const auto start = linear_start(i, views, out.reason);
    if (!start) return out;
    double rho = *start;
    double information = 0.0;
    constexpr double kSettled = 1e-3;  // standard deviations
    for (int iteration = 0; iteration < 3; ++iteration) {
      double gradient = 0.0;
      information = 0.0;
      for (const View& view : views) {
        const auto at = linearise(view, rho);
        if (!at) return dropped(out, DropReason::kBehindCamera);
        gradient += at->by_depth.dot(view.weight * at->residual);
        information += at->by_depth.dot(view.weight * at->by_depth);
      }
      if (!(information > 0)) return out;
      rho -= gradient / information;
      // A step far below the point's own standard deviation.
      if (gradient * gradient < kSettled * kSettled * information) break;
    }
    const double sigma = 1.0 / std::sqrt(information);
    if (!(sigma < options_.max_relative_sigma * std::abs(rho))) return out;
    if (!(rho > 0)) return dropped(out, DropReason::kBehindCamera);
    double chi2 = 0.0, worst = 0.0;
    for (const View& view : views) {
      const auto at = linearise(view, rho);
      if (!at) return dropped(out, DropReason::kBehindCamera);
      const double squared = at->residual.dot(view.weight * at->residual);
      chi2 += squared;
      worst = std::max(worst, squared);
    }
    if (worst > options_.max_residual * options_.max_residual) {
      return dropped(out, DropReason::kInconsistent);
    }
    // Contradicting matches widen the estimate (reduced chi-square above 1).
    const double freedom = 2.0 * static_cast<double>(views.size()) - 1.0;
    out.sigma = sigma * std::sqrt(std::max(1.0, chi2 / freedom));
    out.inverse_depth = rho;
    out.outcome = Outcome::kAccepted;
    if (jacobians) append_jacobian(views, rho, information, *jacobians);
    return out;
  }

 private:
  /// A view's reprojection at an inverse depth.
  struct Linearised {
    Eigen::Vector2d residual;  ///< predicted less observed, px
    Eigen::Vector2d by_depth;
    Eigen::Matrix<double, 2, 3> projection;  ///< by the point in that camera
  };

  static Point dropped(Point point, DropReason reason) {
    point.reason = reason;
    return point;
  }

  /// None behind the camera.
  std::optional<Linearised> linearise(const View& view, double rho) const {
    const Eigen::Vector3d p = view.ray + rho * translations_[view.other];
    if (!(p.z() > 1e-4)) return std::nullopt;
    Linearised at;
    const double inverse = 1.0 / p.z(), x = p.x() * inverse, y = p.y() * inverse;
    const double by_x = camera_.fx * inverse, by_y = camera_.fy * inverse;
    at.projection << by_x, 0, -by_x * x, 0, by_y, -by_y * y;
    at.residual =
        Eigen::Vector2d(camera_.fx * x + camera_.cx, camera_.fy * y + camera_.cy) - view.pixel;
    const Eigen::Vector3d& t = translations_[view.other];
    at.by_depth = Eigen::Vector2d(by_x * (t.x() - x * t.z()), by_y * (t.y() - y * t.z()));
    return at;
  }

  /// The images that see the point, and its inverse depth by linear least squares in normalised
  /// coordinates; none where no image has parallax.
  std::optional<double> linear_start(std::size_t i, std::vector<View>& views,
                                     DropReason& reason) const {
    views.clear();
    const Eigen::Vector3d ray = camera_.ray(matches_.pixels[i].cast<double>());
    double numerator = 0.0, denominator = 0.0;
    for (std::size_t m = 0; m < matches_.matches.size(); ++m) {
      const MatchedImage& match = matches_.matches[m];
      if (!std::isfinite(match.round_trip_px[i])) continue;
      reason = DropReason::kNearFocusOfExpansion;
      View view;
      view.other = m;
      view.ray = rotations_[m] * ray;
      view.pixel = match.pixels[i].cast<double>();
      // Epipolar direction at the observed pixel: away from the epipole.
      const Eigen::Vector3d& t = translations_[m];
      const Eigen::Vector2d along(camera_.fx * t.x() + (camera_.cx - view.pixel.x()) * t.z(),
                                  camera_.fy * t.y() + (camera_.cy - view.pixel.y()) * t.z());
      const double norm = along.norm();
      if (!(norm > 1e-9)) continue;
      const Eigen::Vector2d e = along / norm, across(-e.y(), e.x());
      const double round_trip = match.round_trip_px[i];
      const double w1 = 1.0 / match_variance(matches_.texture[i], e, round_trip,
                                             motion_.pixel_sigma, options_.noise);
      const double w2 = 1.0 / match_variance(matches_.texture[i], across, round_trip,
                                             motion_.pixel_sigma, options_.noise);
      view.weight = (w1 * e) * e.transpose() + (w2 * across) * across.transpose();
      views.push_back(view);
      // Each view weighs by its parallax over depth.
      const Eigen::Vector3d z = camera_.ray(view.pixel);
      const double b0 = t.x() - z.x() * t.z(), b1 = t.y() - z.y() * t.z();
      const double e0 = z.x() * view.ray.z() - view.ray.x();
      const double e1 = z.y() * view.ray.z() - view.ray.y();
      numerator += w1 * (b0 * e0 + b1 * e1);
      denominator += w1 * (b0 * b0 + b1 * b1);
    }
    if (views.empty() || !(denominator > 1e-12)) return std::nullopt;
    return numerator / denominator;
  }

  /// d rho / d pose = -(1 / information) by_depth' W d(projection) / d pose.
  void append_jacobian(const std::vector<View>& views, double rho, double information,
                       std::vector<float>& jacobians) const {
    const std::size_t own = jacobians.size();
    jacobians.resize(own + 6 * translations_.size(), 0.0f);
    for (const View& view : views) {
      const auto at = linearise(view, rho);
      const Eigen::RowVector3d left =
          -(at->by_depth.transpose() * view.weight * at->projection) / information;
      Eigen::Map<Eigen::Matrix<float, 1, 6>> row(jacobians.data() + own + 6 * view.other);
      row.head<3>() = (-left * skew(view.ray)).cast<float>();
      row.tail<3>() = (left * rho).cast<float>();
    }
  }

  const PinholeCamera& camera_;
  const Correspondences& matches_;
  const MotionEstimate& motion_;
  const TriangulationOptions& options_;
  std::vector<Eigen::Matrix3d> rotations_;
  std::vector<Eigen::Vector3d> translations_;
};

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
  const std::size_t total = matches.pixels.size();
  const PointSolver solver(camera, matches, motion, options);
  std::vector<PointSolver::Point> points(total);
  // The accepted points' derivatives, row by row of the grid.
  std::vector<std::vector<float>> jacobians(static_cast<std::size_t>(matches.rows));
  parallel_for(jacobians.size(), options.num_threads, [&](std::size_t row) {
    std::vector<View> views;
    const auto first = row * static_cast<std::size_t>(matches.columns);
    for (std::size_t i = first; i < first + static_cast<std::size_t>(matches.columns); ++i) {
      if (!wanted[i]) continue;
      points[i] = solver.solve(i, views, options.with_pose_jacobian ? &jacobians[row] : nullptr);
    }
  });

  TriangulatedPoints out;
  for (std::size_t i = 0; i < total; ++i) {
    const PointSolver::Point& point = points[i];
    if (point.outcome == Outcome::kDropped) ++out.dropped[static_cast<std::size_t>(point.reason)];
    if (point.outcome != Outcome::kAccepted) continue;
    out.grid.push_back(static_cast<int>(i));
    out.rays.push_back(camera.ray(matches.pixels[i].cast<double>()));
    out.inverse_depth.push_back(point.inverse_depth);
    out.sigma_own.push_back(point.sigma);
  }
  if (!options.with_pose_jacobian) return out;
  const auto columns = static_cast<Eigen::Index>(6 * matches.matches.size());
  out.pose_jacobian.resize(static_cast<Eigen::Index>(out.size()), columns);
  float* to = out.pose_jacobian.data();
  for (const std::vector<float>& row : jacobians) to = std::copy(row.begin(), row.end(), to);
  return out;
}

}  // namespace camber
