#include "camber/cloud/normals.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "camber/cloud/point_tree.h"
#include "camber/core/threads.h"

namespace camber {
namespace {

using Quad = float __attribute__((vector_size(16)));

/// What the second eigenvalue of a neighbourhood on a line is at most, by the first: sums of floats
/// leave some millionths of it.
constexpr double kLine = 1e-5;

/// Unit eigenvector of the smallest eigenvalue of a symmetric matrix with entries xx, xy, xz, yy,
/// yz, zz; false if it is not unique (a line, a point).
/// Eigenvalues by Smith, "Eigenvalues of a symmetric 3x3 matrix", CACM 1961; the vector as the
/// longest cross product of two rows, which is stable as long as the two smaller eigenvalues are
/// apart.
bool smallest_eigenvector(const double* c, Eigen::Vector3d& out) {
  const double trace = c[0] + c[3] + c[5];
  if (!(trace > 0.0)) return false;
  const double s = 1.0 / trace;
  const double xx = c[0] * s, xy = c[1] * s, xz = c[2] * s, yy = c[3] * s, yz = c[4] * s,
               zz = c[5] * s;
  // The sum of products of two eigenvalues, whose sum is 1: nearly the second one where it is
  // small.
  if (!(xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz > kLine)) return false;
  const double q = 1.0 / 3.0;
  const double a = xx - q, b = yy - q, d = zz - q;
  const double p2 = (a * a + b * b + d * d + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0;
  const double p = std::sqrt(p2);
  double smallest = q;
  if (p > 1e-12) {
    const double determinant =
        a * (b * d - yz * yz) - xy * (xy * d - yz * xz) + xz * (xy * yz - b * xz);
    const double r = std::clamp(determinant / (2.0 * p2 * p), -1.0, 1.0);
    // The smallest one: 2 pi / 3 further round the circle than the largest.
    smallest = q + 2.0 * p * std::cos(std::acos(r) / 3.0 + 2.0943951023931953);
  }
  const Eigen::Vector3d r0(xx - smallest, xy, xz), r1(xy, yy - smallest, yz),
      r2(xz, yz, zz - smallest);
  const Eigen::Vector3d v01 = r0.cross(r1), v02 = r0.cross(r2), v12 = r1.cross(r2);
  const double n01 = v01.squaredNorm(), n02 = v02.squaredNorm(), n12 = v12.squaredNorm();
  const double largest = std::max({n01, n02, n12});
  if (largest < 1e-14) {
    // Two eigenvalues next to each other: the slow solver decides which.
    Eigen::Matrix3d m;
    m << xx, xy, xz, xy, yy, yz, xz, yz, zz;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(m);
    const Eigen::Vector3d values = solver.eigenvalues();
    if (values[1] - values[0] < 1e-12) return false;
    out = solver.eigenvectors().col(0);
    return true;
  }
  out = largest == n01 ? v01 : largest == n02 ? v02 : v12;
  out /= std::sqrt(largest);
  return true;
}

}  // namespace

void NormalOptions::validate() const {
  if (neighbors < 3) {
    throw std::invalid_argument("neighbors = " + std::to_string(neighbors) +
                                ", expected at least 3");
  }
  if (!(radius >= 0.0f)) {
    throw std::invalid_argument("radius = " + std::to_string(radius) + ", expected 0 m or more");
  }
  if (!viewpoint.allFinite() && !(up.allFinite() && up.norm() > 0.0)) {
    throw std::invalid_argument("up is zero or not finite, expected a direction");
  }
}

namespace {

/// The normal of a point from where its neighbours lie, relative to it: small numbers whatever the
/// coordinates, and the same ones wherever the cloud's origin is.
class Neighborhood {
 public:
  explicit Neighborhood(const Eigen::Vector3f& point)
      : point_{point.x(), point.y(), point.z(), 0.0f} {}

  /// Sums four at a time: x y z, xx xy xz yy, yz zz.
  void add(float x, float y, float z) {
    const Quad d = Quad{x, y, z, 0.0f} - point_;
    first_ += d;
    second_ +=
        __builtin_shufflevector(d, d, 0, 0, 0, 1) * __builtin_shufflevector(d, d, 0, 1, 2, 1);
    third_ += __builtin_shufflevector(d, d, 1, 2, 3, 3) * __builtin_shufflevector(d, d, 2, 2, 3, 3);
    ++count_;
  }
  /// Of either sign; false where there is none.
  bool normal(Eigen::Vector3d& out) const {
    if (count_ < 3) return false;
    const double share = 1.0 / count_;
    const auto mean = [share](float sum) { return static_cast<double>(sum) * share; };
    const double mx = mean(first_[0]), my = mean(first_[1]), mz = mean(first_[2]);
    const double covariance[6] = {mean(second_[0]) - mx * mx, mean(second_[1]) - mx * my,
                                  mean(second_[2]) - mx * mz, mean(second_[3]) - my * my,
                                  mean(third_[0]) - my * mz,  mean(third_[1]) - mz * mz};
    return smallest_eigenvector(covariance, out);
  }

 private:
  Quad point_, first_ = {}, second_ = {}, third_ = {};
  int count_ = 0;
};

}  // namespace

void estimate_normals(RoadCloud& cloud, const NormalOptions& options) {
  options.validate();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cloud.normals.assign(cloud.size(), Eigen::Vector3f(nan, nan, nan));
  const PointTree tree(cloud.points, options.num_threads);
  const bool to_viewpoint = options.viewpoint.allFinite();
  const Eigen::Vector3f viewpoint = (options.viewpoint - cloud.origin).cast<float>();
  const Eigen::Vector3f up = options.up.cast<float>();
  const auto set = [&](std::size_t index, const Neighborhood& near) {
    Eigen::Vector3d normal;
    if (!near.normal(normal)) return;
    const Eigen::Vector3f n = normal.cast<float>();
    const float side = n.dot(to_viewpoint ? Eigen::Vector3f(viewpoint - cloud.points[index]) : up);
    cloud.normals[index] = side < 0.0f ? Eigen::Vector3f(-n) : n;
  };
  if (options.radius > 0.0f) {
    // By distance, equal ones by index: what is summed does not hang on the tree.
    constexpr std::size_t kBlock = 1024;
    const std::vector<int>& order = tree.indices();
    parallel_for((order.size() + kBlock - 1) / kBlock, options.num_threads, [&](std::size_t block) {
      std::vector<PointTree::Neighbor> found;
      const std::size_t end = std::min(order.size(), (block + 1) * kBlock);
      for (std::size_t i = block * kBlock; i < end; ++i) {
        const auto index = static_cast<std::size_t>(order[i]);
        tree.within(cloud.points[index], options.radius, found);
        const std::size_t count =
            std::min(found.size(), static_cast<std::size_t>(options.neighbors));
        Neighborhood near(cloud.points[index]);
        for (std::size_t k = 0; k < count; ++k) {
          const Eigen::Vector3f& p = cloud.points[static_cast<std::size_t>(found[k].index)];
          near.add(p.x(), p.y(), p.z());
        }
        set(index, near);
      }
    });
    return;
  }
  const float *const x = tree.x().data(), *const y = tree.y().data(), *const z = tree.z().data();
  tree.for_each_neighborhood(options.neighbors, options.num_threads,
                             [&](const PointTree::Neighborhood& found) {
                               Neighborhood near(found.point);
                               for (int k = 0; k < found.count; ++k) {
                                 const int at = found.positions[k];
                                 near.add(x[at], y[at], z[at]);
                               }
                               set(static_cast<std::size_t>(found.index), near);
                             });
}

}  // namespace camber
