#include "camber/drive/detail/moving_path.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "camber/road/detail/banded_ldlt.h"

namespace camber::internal {
namespace {

constexpr Eigen::Index kPlace = 3;
constexpr double kFreedom = 4.0;  // of Student's distribution of a view

/// Residuals of a view, standard deviations (two slopes, logarithm of the distance), and how they
/// hang on the place in the world. Nothing where that is not before the camera.
bool linearise(const MovingView& view, const Eigen::Vector3d& position, Eigen::Vector3d* residual,
               Eigen::Matrix3d* by) {
  constexpr double kNearest = 0.1;  // m
  const SE3 camera_from_world = view.world_from_camera.inverse();
  const Eigen::Vector3d here = camera_from_world * position;
  if (!(here.z() > kNearest)) return false;
  const Eigen::Vector3d& seen = view.place;
  const double z = here.z(), range = here.norm();
  *residual << (here.x() / z - seen.x() / seen.z()) / view.direction_sigma,
      (here.y() / z - seen.y() / seen.z()) / view.direction_sigma,
      std::log(range / seen.norm()) / view.range_sigma;
  Eigen::Matrix3d by_here;
  by_here.row(0) = Eigen::RowVector3d(1.0, 0.0, -here.x() / z) / (z * view.direction_sigma);
  by_here.row(1) = Eigen::RowVector3d(0.0, 1.0, -here.y() / z) / (z * view.direction_sigma);
  by_here.row(2) = here.transpose() / (range * range * view.range_sigma);
  *by = by_here * camera_from_world.rotation_matrix();
  return true;
}

}  // namespace

std::optional<std::vector<MovingPlace>> moving_path(const std::vector<MovingView>& views,
                                                    const MovingPathNoise& noise) {
  constexpr int kLeast = 3, kIterations = 15;
  const auto count = static_cast<Eigen::Index>(views.size());
  const auto measured =
      std::count_if(views.begin(), views.end(), [](const MovingView& v) { return v.measured; });
  if (measured < kLeast) return std::nullopt;
  std::vector<MovingPlace> out;
  for (const MovingView& view : views) {
    out.push_back({view.world_from_camera * view.place, Eigen::Matrix3d::Zero()});
  }
  for (std::size_t k = 1; k < views.size(); ++k) {
    if (!(views[k].time_s > views[k - 1].time_s)) return std::nullopt;
  }
  const double alike = std::min(noise.alike, static_cast<double>(measured));
  camber::detail::BandedLdlt factor;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    camber::detail::SymmetricBand normal(kPlace * count, 3 * kPlace - 1);
    Eigen::VectorXd right = Eigen::VectorXd::Zero(kPlace * count);
    for (Eigen::Index k = 0; k < count; ++k) {
      const MovingView& view = views[static_cast<std::size_t>(k)];
      Eigen::Vector3d r;
      Eigen::Matrix3d by;
      if (!view.measured || !linearise(view, out[static_cast<std::size_t>(k)].position, &r, &by)) {
        continue;
      }
      const double weight = (kFreedom + 3.0) / (kFreedom + r.squaredNorm()) / alike;
      const Eigen::Matrix3d block = weight * by.transpose() * by;
      for (Eigen::Index i = 0; i < kPlace; ++i) {
        for (Eigen::Index j = 0; j <= i; ++j) {
          normal.at(kPlace * k + i, kPlace * k + j) += block(i, j);
        }
      }
      right.segment<kPlace>(kPlace * k) -= weight * by.transpose() * r;
    }
    for (Eigen::Index k = 1; k + 1 < count; ++k) {
      const auto at = static_cast<std::size_t>(k);
      const double before = views[at].time_s - views[at - 1].time_s;
      const double after = views[at + 1].time_s - views[at].time_s;
      const double information = 2.0 / (noise.acceleration_density * (before + after));
      // Of the change of velocity, by the three places.
      const double by[3] = {1.0 / before, -1.0 / before - 1.0 / after, 1.0 / after};
      Eigen::Vector3d change = Eigen::Vector3d::Zero();
      for (std::size_t i = 0; i < 3; ++i) change += by[i] * out[at - 1 + i].position;
      for (Eigen::Index i = 0; i < 3; ++i) {
        for (Eigen::Index axis = 0; axis < kPlace; ++axis) {
          for (Eigen::Index j = 0; j <= i; ++j) {
            normal.at(kPlace * (k - 1 + i) + axis, kPlace * (k - 1 + j) + axis) +=
                information * by[i] * by[j];
          }
          right[kPlace * (k - 1 + i) + axis] -= information * by[i] * change[axis];
        }
      }
    }
    if (!factor.factorise(std::move(normal))) return std::nullopt;
    const Eigen::VectorXd step = factor.solve_vector(right);
    if (!step.allFinite()) return std::nullopt;
    for (Eigen::Index k = 0; k < count; ++k) {
      out[static_cast<std::size_t>(k)].position += step.segment<kPlace>(kPlace * k);
    }
  }
  const camber::detail::SymmetricBand inverse = factor.inverse_in_band();
  for (Eigen::Index k = 0; k < count; ++k) {
    Eigen::Matrix3d& covariance = out[static_cast<std::size_t>(k)].covariance;
    for (Eigen::Index i = 0; i < kPlace; ++i) {
      for (Eigen::Index j = 0; j <= i; ++j) {
        covariance(i, j) = covariance(j, i) = inverse.at(kPlace * k + i, kPlace * k + j);
      }
    }
  }
  return out;
}

}  // namespace camber::internal
