#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "camber/cloud/voxel_grid.h"
#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/evaluate/detail/compare_steps.h"

namespace camber {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// Nearest points of a cloud, exact: the search in float leaves open which of two points is nearer
/// where their distances differ by less than rounding; those are measured again in double.
/// @param queries  tree of `count` places, of coordinates in float
/// @param shift    takes these to the cloud's origin
/// @param local    local(i, q): the i-th place relative to that, the q-th of the tree, in double
template <typename Local>
ShapeDistances distances_to_cloud(const RoadCloud& cloud, const PointTree& tree,
                                  const PointTree& queries, const Vector3d& shift,
                                  std::size_t count, const Local& local, int num_threads) {
  ShapeDistances out;
  out.distance.assign(count, kNaN);
  out.nearest.assign(count, -1);
  const bool with_normals = !cloud.normals.empty();
  if (with_normals) out.along_normal.assign(count, kNaN);
  const auto exact = [&](const PointTree::LeafNeighbors& leaf) {
    std::vector<PointTree::Neighbor> near;
    // What belongs to neighbours lies anywhere in memory: asked for together, it comes together.
    for (int j = 0; j < leaf.count; ++j) {
      const std::size_t i =
          static_cast<std::size_t>(queries.indices()[static_cast<std::size_t>(leaf.begin + j)]);
      __builtin_prefetch(&out.distance[i], 1);
      __builtin_prefetch(&out.nearest[i], 1);
      if (!with_normals || leaf.positions[j] < 0) continue;
      __builtin_prefetch(&out.along_normal[i], 1);
      const int index = tree.indices()[static_cast<std::size_t>(leaf.positions[j])];
      __builtin_prefetch(&cloud.normals[static_cast<std::size_t>(index)]);
    }
    for (int j = 0; j < leaf.count; ++j) {
      if (leaf.positions[j] < 0) continue;
      const std::size_t at = static_cast<std::size_t>(leaf.positions[j]),
                        asked = static_cast<std::size_t>(leaf.begin + j),
                        i = static_cast<std::size_t>(queries.indices()[asked]);
      const Vector3d place = local(i, asked);
      const Eigen::Vector3f query(leaf.x[j], leaf.y[j], leaf.z[j]);
      Vector3d found(tree.x()[at], tree.y()[at], tree.z()[at]);
      double best = (found - place).squaredNorm();
      int index = tree.indices()[at];
      // Rounding of the query's coordinates and of the distance itself.
      const double rounding = 1.2e-7 * (query.cwiseAbs().maxCoeff() + 4.0 * std::sqrt(best));
      const double first = std::sqrt(static_cast<double>(leaf.squared_distances[j])),
                   second = std::sqrt(static_cast<double>(leaf.second_squared_distances[j]));
      if (second - first <= 4.0 * rounding) {
        tree.within(query, static_cast<float>((first + 4.0 * rounding) * (1.0 + 1e-6)), near);
        for (const PointTree::Neighbor& other : near) {
          const Vector3d p = cloud.points[static_cast<std::size_t>(other.index)].cast<double>();
          const double d = (p - place).squaredNorm();
          if (d < best || (d == best && other.index < index)) {
            best = d;
            index = other.index;
            found = p;
          }
        }
      }
      out.nearest[i] = index;
      out.distance[i] = std::sqrt(best);
      if (with_normals) {
        out.along_normal[i] =
            cloud.normals[static_cast<std::size_t>(index)].cast<double>().dot(place - found);
      }
    }
  };
  tree.for_each_leaf_of(queries, shift, num_threads, exact);
  return out;
}

/// The triangles of a mesh, relative to its origin, where numbers are small.
TriangleTree make_triangle_tree(const Shape& mesh) {
  std::vector<Vector3d> vertices(mesh.cloud.size());
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    vertices[i] = mesh.cloud.points[i].cast<double>();
  }
  return {std::move(vertices), mesh.triangles};
}

ShapeDistances distances_to_mesh(const Shape& mesh, const TriangleTree& tree,
                                 const std::vector<Vector3d>& places, int num_threads) {
  std::vector<Vector3d> local(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) local[i] = places[i] - mesh.cloud.origin;
  const std::vector<TriangleTree::Nearest> nearest = tree.nearest_of_all(local, num_threads);
  ShapeDistances out;
  out.distance.assign(places.size(), kNaN);
  out.nearest.assign(places.size(), -1);
  out.along_normal.assign(places.size(), kNaN);
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (nearest[i].triangle < 0) continue;
    out.nearest[i] = nearest[i].triangle;
    out.distance[i] = std::sqrt(nearest[i].squared_distance);
    const auto& t = mesh.triangles[static_cast<std::size_t>(nearest[i].triangle)];
    const Vector3d normal = tree.normal(nearest[i].triangle);
    if (normal.isZero()) continue;
    out.along_normal[i] = normal.dot(local[i] - mesh.cloud.points[t[0]].cast<double>());
  }
  return out;
}

}  // namespace

namespace detail {

ShapeSearch::ShapeSearch(const Shape& shape, int num_threads)
    : shape_(shape), num_threads_(num_threads) {
  if (shape.is_mesh()) {
    triangles_.emplace(make_triangle_tree(shape));
  } else {
    points_.emplace(shape.cloud.points, num_threads);
  }
}

ShapeDistances ShapeSearch::distances(const std::vector<Vector3d>& places) const {
  if (shape_.is_mesh()) return distances_to_mesh(shape_, *triangles_, places, num_threads_);
  const Vector3d& origin = shape_.cloud.origin;
  std::vector<Eigen::Vector3f> rounded(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    rounded[i] = (places[i] - origin).cast<float>();
  }
  return distances_to_cloud(
      shape_.cloud, *points_, PointTree(rounded, num_threads_), Vector3d::Zero(), places.size(),
      [&](std::size_t i, std::size_t) -> Vector3d { return places[i] - origin; }, num_threads_);
}

ShapeDistances ShapeSearch::distances_of(const ShapeSearch& other, const RoadCloud& points) const {
  if (!points_ || !other.points_) return distances(true_points(points));
  const RoadCloud& cloud = other.shape_.cloud;
  const PointTree& tree = *other.points_;
  const Vector3d shift = cloud.origin - shape_.cloud.origin;
  return distances_to_cloud(
      shape_.cloud, *points_, tree, shift, cloud.size(),
      [&](std::size_t, std::size_t q) -> Vector3d {
        return Vector3d(tree.x()[q], tree.y()[q], tree.z()[q]) + shift;
      },
      num_threads_);
}

Shape transformed(const Shape& shape, const Matrix4d& m) {
  if (m.isIdentity(0.0)) return shape;
  Shape out = shape;
  const std::vector<Vector3d> points = true_points(shape.cloud, m);
  Vector3d origin = Vector3d::Zero();
  for (const Vector3d& p : points) {
    if (!p.allFinite()) continue;
    // Small numbers stay as they are.
    if (p.cwiseAbs().maxCoeff() > 1e4) origin = p.array().round();
    break;
  }
  out.cloud.origin = origin;
  const double scale = std::cbrt(std::abs(m.topLeftCorner<3, 3>().determinant()));
  const Eigen::Matrix3f turn = (m.topLeftCorner<3, 3>() / scale).cast<float>();
  for (std::size_t i = 0; i < points.size(); ++i) {
    out.cloud.points[i] = (points[i] - origin).cast<float>();
    if (!out.cloud.normals.empty()) out.cloud.normals[i] = turn * out.cloud.normals[i];
  }
  return out;
}

void fetch_contact(const Shape& shape, int nearest) {
  if (nearest < 0 || shape.is_mesh()) return;
  const std::size_t k = static_cast<std::size_t>(nearest);
  __builtin_prefetch(&shape.cloud.points[k]);
  if (!shape.cloud.normals.empty()) __builtin_prefetch(&shape.cloud.normals[k]);
}

Contact contact(const Shape& shape, int nearest, const Vector3d& place) {
  const RoadCloud& cloud = shape.cloud;
  const auto corner = [&](std::size_t i) {
    return Vector3d(cloud.origin + cloud.points[i].cast<double>());
  };
  if (!shape.is_mesh()) {
    const std::size_t k = static_cast<std::size_t>(nearest);
    Vector3d normal = Vector3d::Zero();
    if (!cloud.normals.empty() && cloud.normals[k].allFinite()) {
      normal = cloud.normals[k].cast<double>();
    }
    return {corner(k), normal};
  }
  const auto& t = shape.triangles[static_cast<std::size_t>(nearest)];
  const Vector3d a = corner(t[0]), b = corner(t[1]), c = corner(t[2]);
  Vector3d normal = (b - a).cross(c - a);
  const double length = normal.norm();
  normal = length > 0.0 ? Vector3d(normal / length) : Vector3d::Zero();
  return {nearest_on_triangle(place, a, b, c), normal};
}

std::vector<Eigen::Vector3f> tangent_normals(const RoadCloud& cloud, const PointTree& own,
                                             const Vector3d& up, int num_threads) {
  constexpr double kSpacing = 0.25;  // m
  constexpr int kNeighbors = 12;
  constexpr double kLeastSpread = 0.03;  // of the variances in the plane
  RoadCloud bare;
  bare.origin = cloud.origin;
  bare.points = cloud.points;
  const RoadCloud thinned = thin(bare, kSpacing);
  std::vector<Eigen::Vector3f> points(thinned.size());
  const Eigen::Vector3f shift = (thinned.origin - cloud.origin).cast<float>();
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = thinned.points[i] + shift;
  const PointTree tree(points, num_threads);
  std::vector<Eigen::Vector3f> normals(points.size(), Eigen::Vector3f::Zero());
  const float *const x = tree.x().data(), *const y = tree.y().data(), *const z = tree.z().data();
  tree.for_each_neighborhood(kNeighbors, num_threads, [&](const PointTree::Neighborhood& near) {
    Vector3d mean = Vector3d::Zero();
    Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
    for (int i = 0; i < near.count; ++i) {
      const int at = near.positions[i];
      const Vector3d d = Vector3d(x[at], y[at], z[at]) - near.point.cast<double>();
      mean += d / near.count;
      squares += d * d.transpose() / near.count;
    }
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
    solver.computeDirect(squares - mean * mean.transpose());
    if (!(solver.eigenvalues()[1] > kLeastSpread * solver.eigenvalues()[2])) return;
    Vector3d normal = solver.eigenvectors().col(0);
    if (normal.dot(up) < 0.0) normal = -normal;
    normals[static_cast<std::size_t>(near.index)] = normal.cast<float>();
  });
  std::vector<Eigen::Vector3f> out(cloud.size(), Eigen::Vector3f::Zero());
  tree.for_each_leaf_of(
      own, Vector3d::Zero(), num_threads, [&](const PointTree::LeafNeighbors& leaf) {
        for (int j = 0; j < leaf.count; ++j) {
          if (leaf.positions[j] < 0) continue;
          const int nearest = tree.indices()[static_cast<std::size_t>(leaf.positions[j])];
          out[static_cast<std::size_t>(own.indices()[static_cast<std::size_t>(leaf.begin + j)])] =
              normals[static_cast<std::size_t>(nearest)];
        }
      });
  return out;
}

}  // namespace detail

ShapeDistances distances_to(const Shape& shape, const std::vector<Vector3d>& places,
                            int num_threads) {
  return detail::ShapeSearch(shape, num_threads).distances(places);
}

std::vector<Vector3d> true_points(const RoadCloud& cloud, const Matrix4d& transform) {
  std::vector<Vector3d> out(cloud.size());
  const bool still = transform.isIdentity(0.0);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Vector3d p = cloud.origin + cloud.points[i].cast<double>();
    out[i] = still ? p : detail::move(transform, p);
  }
  return out;
}

RoadCloud sample_mesh(const Shape& mesh, double density, std::size_t most, std::uint64_t seed) {
  std::vector<double> areas;  // up to and with each triangle
  double total = 0.0;
  const auto corner = [&](std::uint32_t i) {
    return Vector3d(mesh.cloud.points[i].cast<double>());
  };
  for (const auto& t : mesh.triangles) {
    const double area =
        0.5 * (corner(t[1]) - corner(t[0])).cross(corner(t[2]) - corner(t[0])).norm();
    if (std::isfinite(area)) total += area;
    areas.push_back(total);
  }
  RoadCloud out;
  out.frame = mesh.cloud.frame;
  out.metric = mesh.cloud.metric;
  out.origin = mesh.cloud.origin;
  if (!(total > 0.0)) return out;
  const double wanted = std::min(std::ceil(total * density), static_cast<double>(most));
  const std::size_t count = static_cast<std::size_t>(std::max(1.0, wanted));
  const CounterRandom random(seed, 0x6D657368);
  out.points.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    // Stratified by area; uniform within a triangle (square-root parametrisation).
    const double at =
        total * (static_cast<double>(i) + random.uniform(3 * i)) / static_cast<double>(count);
    const std::size_t t = std::min<std::size_t>(
        static_cast<std::size_t>(std::upper_bound(areas.begin(), areas.end(), at) - areas.begin()),
        areas.size() - 1);
    const double r = std::sqrt(random.uniform(3 * i + 1)), s = random.uniform(3 * i + 2);
    const auto& c = mesh.triangles[t];
    out.points.push_back(
        ((1.0 - r) * corner(c[0]) + r * (1.0 - s) * corner(c[1]) + r * s * corner(c[2]))
            .cast<float>());
  }
  return out;
}

}  // namespace camber
