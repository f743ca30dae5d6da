#include "camber/evaluate/compare.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "camber/cloud/point_tree.h"
#include "camber/cloud/voxel_grid.h"
#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/evaluate/triangle_tree.h"

namespace camber {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kDegree = M_PI / 180.0;

Vector3d move(const Matrix4d& m, const Vector3d& p) {
  return m.topLeftCorner<3, 3>() * p + m.topRightCorner<3, 1>();
}

/// Nearest points of a cloud, exact: the search in float leaves open which of two points is nearer
/// where their distances differ by less than rounding; those are measured again in double.
ShapeDistances distances_to_cloud(const RoadCloud& cloud, const PointTree& tree,
                                  const std::vector<Vector3d>& places, int num_threads) {
  ShapeDistances out;
  out.distance.assign(places.size(), kNaN);
  out.nearest.assign(places.size(), -1);
  std::vector<Eigen::Vector3f> queries(places.size());
  for (std::size_t i = 0; i < places.size(); ++i) {
    queries[i] = (places[i] - cloud.origin).cast<float>();
  }
  const std::vector<PointTree::NearestPair> pairs = tree.nearest_pair_of_all(queries, num_threads);
  const bool with_normals = !cloud.normals.empty();
  if (with_normals) out.along_normal.assign(places.size(), kNaN);
  constexpr std::size_t kBlock = 4096;
  parallel_for((places.size() + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    std::vector<PointTree::Neighbor> near;
    const std::size_t end = std::min(places.size(), (block + 1) * kBlock);
    for (std::size_t i = block * kBlock; i < end; ++i) {
      int index = pairs[i].index;
      if (index < 0) continue;
      const Vector3d place = places[i] - cloud.origin;
      const auto squared = [&](int k) {
        return (cloud.points[static_cast<std::size_t>(k)].cast<double>() - place).squaredNorm();
      };
      double best = squared(index);
      // Rounding of the query's coordinates and of the distance itself.
      const double rounding = 1.2e-7 * (queries[i].cwiseAbs().maxCoeff() + 4.0 * std::sqrt(best));
      const double first = std::sqrt(static_cast<double>(pairs[i].squared_distance)),
                   second = std::sqrt(static_cast<double>(pairs[i].second_squared_distance));
      if (second - first <= 4.0 * rounding) {
        tree.within(queries[i], static_cast<float>((first + 4.0 * rounding) * (1.0 + 1e-6)), near);
        for (const PointTree::Neighbor& other : near) {
          const double d = squared(other.index);
          if (d < best || (d == best && other.index < index)) {
            best = d;
            index = other.index;
          }
        }
      }
      out.nearest[i] = index;
      out.distance[i] = std::sqrt(best);
      if (with_normals) {
        const std::size_t k = static_cast<std::size_t>(index);
        out.along_normal[i] =
            cloud.normals[k].cast<double>().dot(place - cloud.points[k].cast<double>());
      }
    }
  });
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

/// A shape made ready for many searches; the shape must outlive it.
class ShapeSearch {
 public:
  explicit ShapeSearch(const Shape& shape) : shape_(shape) {
    if (shape.is_mesh()) {
      triangles_.emplace(make_triangle_tree(shape));
    } else {
      points_.emplace(shape.cloud.points);
    }
  }
  ShapeDistances distances(const std::vector<Vector3d>& places, int num_threads) const {
    return shape_.is_mesh() ? distances_to_mesh(shape_, *triangles_, places, num_threads)
                            : distances_to_cloud(shape_.cloud, *points_, places, num_threads);
  }

 private:
  const Shape& shape_;
  std::optional<PointTree> points_;
  std::optional<TriangleTree> triangles_;
};

double median_of(std::vector<double> values) {
  if (values.empty()) return kNaN;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// A shape in the frame of the estimate. Meshes and clouds keep their triangles; normals turn.
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

/// Places and normals of what is nearest on a shape.
struct Contact {
  Vector3d place, normal;  // normal: zero if unknown
};

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

/// Normals of the ground's tangent planes at each point: planes through the neighbours in the cloud
/// thinned to 0.25 m, so that they span some metres also where a laser's lines lie far apart; zero
/// where these leave a tilt open.
std::vector<Eigen::Vector3f> tangent_normals(const RoadCloud& cloud, const Vector3d& up,
                                             int num_threads) {
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
  const PointTree tree(points);
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
  const std::vector<PointTree::Neighbor> nearest = tree.nearest_of_all(cloud.points, num_threads);
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (nearest[i].index >= 0) out[i] = normals[static_cast<std::size_t>(nearest[i].index)];
  }
  return out;
}

/// Iterated closest points of a sample of the estimate: along the truth's normals, with a little of
/// the whole distance where those leave a direction open (Chen and Medioni, "Object modelling by
/// registration of multiple range images", IVC 1992). Far pairs are left out by the median.
AlignmentResult iterate_closest(const std::vector<Vector3d>& estimate, const Shape& truth,
                                Alignment alignment, int num_threads) {
  constexpr std::size_t kSample = 20000;
  constexpr double kPointWeight = 0.01;
  AlignmentResult out;
  out.alignment = alignment;
  std::vector<Vector3d> sample;
  const std::size_t stride = std::max<std::size_t>(1, estimate.size() / kSample);
  for (std::size_t i = 0; i < estimate.size(); i += stride) {
    if (estimate[i].allFinite()) sample.push_back(estimate[i]);
  }
  if (sample.size() < 10) {
    throw NoAnswerError("found " + std::to_string(sample.size()) +
                        " points to align, expected at least 10");
  }
  // Scale is about the coordinates' zero, the camera; turns are about the middle of the sample.
  Vector3d middle = Vector3d::Zero();
  if (alignment != Alignment::kScale) {
    for (const Vector3d& p : sample) middle += p / static_cast<double>(sample.size());
  }
  const bool turns = alignment == Alignment::kRigid || alignment == Alignment::kSimilarity;
  const bool scales = alignment == Alignment::kScale || alignment == Alignment::kSimilarity;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Vector3d translation = Vector3d::Zero();
  double scale = 1.0;
  double spread = 0.0;
  for (const Vector3d& p : sample) spread += (p - middle).squaredNorm();
  spread = std::sqrt(spread / static_cast<double>(sample.size()));
  const ShapeSearch search(truth);
  double last_residual = kInfinity;
  for (int iteration = 0; iteration < 100; ++iteration) {
    std::vector<Vector3d> moved(sample.size());
    for (std::size_t i = 0; i < sample.size(); ++i) {
      moved[i] = scale * (rotation * (sample[i] - middle)) + middle + translation;
    }
    const ShapeDistances near = search.distances(moved, num_threads);
    std::vector<double> distances;
    for (const double d : near.distance) {
      if (std::isfinite(d)) distances.push_back(d);
    }
    const double limit = 3.0 * median_of(distances) + 1e-9;
    Eigen::Matrix<double, 7, 7> hessian = Eigen::Matrix<double, 7, 7>::Zero();
    Eigen::Matrix<double, 7, 1> gradient = Eigen::Matrix<double, 7, 1>::Zero();
    double squares = 0.0;
    std::size_t pairs = 0;
    for (std::size_t i = 0; i < moved.size(); ++i) {
      if (!(near.distance[i] <= limit)) continue;
      const Contact c = contact(truth, near.nearest[i], moved[i]);
      const Vector3d arm = moved[i] - middle - translation;
      Eigen::Matrix<double, 3, 7> jacobian;  // of the moved point: turn, shift, log scale
      jacobian << 0, arm.z(), -arm.y(), 1, 0, 0, arm.x(),  //
          -arm.z(), 0, arm.x(), 0, 1, 0, arm.y(),          //
          arm.y(), -arm.x(), 0, 0, 0, 1, arm.z();
      if (!turns) jacobian.leftCols<6>().setZero();
      if (!scales) jacobian.col(6).setZero();
      const Vector3d error = moved[i] - c.place;
      const double weight = c.normal.isZero() ? 1.0 : kPointWeight;
      hessian += weight * jacobian.transpose() * jacobian;
      gradient += weight * jacobian.transpose() * error;
      if (!c.normal.isZero()) {
        const Eigen::Matrix<double, 1, 7> row = c.normal.transpose() * jacobian;
        hessian += row.transpose() * row;
        gradient += row.transpose() * c.normal.dot(error);
        squares += std::pow(c.normal.dot(error), 2);
      } else {
        squares += error.squaredNorm();
      }
      ++pairs;
    }
    const double residual = pairs > 0 ? std::sqrt(squares / static_cast<double>(pairs)) : kNaN;
    if (iteration == 0) out.residual_before = residual;
    out.residual_after = residual;
    out.pairs = pairs;
    out.iterations = iteration;
    if (pairs < 10) {
      throw NoAnswerError("alignment: found " + std::to_string(pairs) +
                          " pairs, expected at least 10");
    }
    for (int k = 0; k < 7; ++k) hessian(k, k) += hessian(k, k) > 0.0 ? 1e-12 * hessian(k, k) : 1.0;
    const Eigen::Matrix<double, 7, 1> step = -hessian.ldlt().solve(gradient);
    if (!step.allFinite()) break;
    const Eigen::Matrix3d turn = rotation_from_vector(Vector3d(step.head<3>())).toRotationMatrix();
    rotation = turn * rotation;
    translation += step.segment<3>(3);
    scale *= std::exp(step[6]);
    const double motion =
        spread * (step.head<3>().norm() + std::abs(step[6])) + step.segment<3>(3).norm();
    if (motion < 1e-6 || (motion < 1e-4 && std::abs(residual - last_residual) < 1e-6 * residual)) {
      break;
    }
    last_residual = residual;
  }
  out.scale = scale;
  out.transform.topLeftCorner<3, 3>() = scale * rotation;
  out.transform.topRightCorner<3, 1>() = middle + translation - scale * (rotation * middle);
  return out;
}

AlignmentResult align_pairs(const CompareOptions& options) {
  AlignmentResult out;
  out.alignment = options.alignment;
  out.from_pairs = true;
  out.pairs = options.pairs.size();
  const Eigen::Index n = static_cast<Eigen::Index>(options.pairs.size());
  Eigen::Matrix3Xd from(3, n), to(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto& [estimate, truth] = options.pairs[static_cast<std::size_t>(i)];
    from.col(i) = estimate;
    to.col(i) = move(options.estimate_from_truth, truth);
  }
  if (options.alignment == Alignment::kScale) {
    const double squares = from.squaredNorm();
    if (!(squares > 0.0)) throw NoAnswerError("alignment: all pairs are at zero");
    out.scale = from.cwiseProduct(to).sum() / squares;
    out.transform.topLeftCorner<3, 3>() *= out.scale;
  } else {
    const Eigen::Matrix3Xd centred = from.colwise() - from.rowwise().mean();
    const Eigen::JacobiSVD<Eigen::Matrix3Xd> svd(centred);
    if (!(svd.singularValues()[1] > 1e-9 * svd.singularValues()[0])) {
      throw NoAnswerError("alignment: the pairs lie on one line, expected three corners");
    }
    const bool scales = options.alignment == Alignment::kSimilarity;
    out.transform = Eigen::umeyama(from, to, scales);
    out.scale = std::cbrt(out.transform.topLeftCorner<3, 3>().determinant());
  }
  const auto residual = [&](const Matrix4d& m) {
    const Eigen::Matrix3Xd moved =
        (m.topLeftCorner<3, 3>() * from).colwise() + Vector3d(m.topRightCorner<3, 1>());
    return std::sqrt((moved - to).squaredNorm() / static_cast<double>(n));
  };
  out.residual_before = residual(Matrix4d::Identity());
  out.residual_after = residual(out.transform);
  return out;
}

/// The longest range of the truth in each direction from where it was seen.
class ObservedSpace {
 public:
  ObservedSpace(const std::vector<Vector3d>& truth, const Vector3d& viewpoint, double slack)
      : viewpoint_(viewpoint),
        slack_(slack),
        ranges_(static_cast<std::size_t>(kColumns) * kRows, -1.0f) {
    for (const Vector3d& p : truth) {
      const Vector3d ray = p - viewpoint;
      if (!ray.allFinite() || ray.isZero()) continue;
      float& range = ranges_[cell(ray, 0, 0)];
      range = std::max(range, static_cast<float>(ray.norm()));
    }
  }

  bool contains(const Vector3d& place) const {
    const Vector3d ray = place - viewpoint_;
    if (!ray.allFinite() || ray.isZero()) return true;
    float longest = -1.0f;
    for (int row = -1; row <= 1; ++row) {
      for (int column = -1; column <= 1; ++column) {
        longest = std::max(longest, ranges_[cell(ray, column, row)]);
      }
    }
    return longest >= 0.0f && ray.norm() <= static_cast<double>(longest) + slack_;
  }

 private:
  static constexpr int kColumns = 720, kRows = 360;  // half a degree

  static std::size_t cell(const Vector3d& ray, int column, int row) {
    const double azimuth = std::atan2(ray.y(), ray.x()) / (2.0 * M_PI) + 0.5;
    const double elevation = std::asin(std::clamp(ray.z() / ray.norm(), -1.0, 1.0)) / M_PI + 0.5;
    const int c = (static_cast<int>(azimuth * kColumns) + column + kColumns) % kColumns;
    const int r = std::clamp(static_cast<int>(elevation * kRows) + row, 0, kRows - 1);
    return static_cast<std::size_t>(r) * kColumns + static_cast<std::size_t>(c);
  }
  Vector3d viewpoint_;
  double slack_;
  std::vector<float> ranges_;
};

bool seen(const std::vector<View>& views, double farthest, const Vector3d& place) {
  for (const View& view : views) {
    const Vector3d p = view.camera_from_estimate * place;
    if (!(p.z() > 0.1 && p.z() <= farthest)) continue;
    const std::optional<Eigen::Vector2d> pixel = view.camera.project(p);
    if (pixel && view.camera.contains(*pixel, -0.5)) {
      return true;
    }
  }
  return false;
}

std::vector<double> counted_values(const OneWay& way, const std::vector<double>& values) {
  std::vector<double> out;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (way.counted[i] != 0 && std::isfinite(values[i])) out.push_back(values[i]);
  }
  return out;
}

double share_within(const std::vector<double>& sorted, double threshold) {
  if (sorted.empty()) return 0.0;
  const auto end = std::upper_bound(sorted.begin(), sorted.end(), threshold);
  return static_cast<double>(end - sorted.begin()) / static_cast<double>(sorted.size());
}

struct SplitError {
  double height, along, across, distance, grade, u, v;
};

RoadErrors summarise_errors(const std::vector<SplitError>& errors, const std::string& by,
                            double from, double to) {
  RoadErrors row;
  row.by = by;
  row.from = from;
  row.to = to;
  std::vector<double> heights;
  double sum = 0.0, squares = 0.0, along = 0.0, across = 0.0;
  for (const SplitError& e : errors) {
    const double key = by == "distance" ? e.distance : by == "grade" ? e.grade / kDegree : from;
    if (!(key >= from && key < to)) continue;
    heights.push_back(std::abs(e.height));
    sum += e.height;
    squares += e.height * e.height;
    along += e.along * e.along;
    across += e.across * e.across;
  }
  row.count = heights.size();
  if (heights.empty()) return row;
  const double n = static_cast<double>(heights.size());
  row.height_mean = sum / n;
  row.height_median = median_of(std::move(heights));
  row.height_rms = std::sqrt(squares / n);
  row.along_rms = std::sqrt(along / n);
  row.across_rms = std::sqrt(across / n);
  return row;
}

HeightErrorMap make_map(const std::vector<SplitError>& errors, double cell) {
  HeightErrorMap map;
  map.cell = cell;
  if (errors.empty()) return map;
  double high_u = -kInfinity, high_v = -kInfinity;
  map.u = map.v = kInfinity;
  for (const SplitError& e : errors) {
    map.u = std::min(map.u, e.u);
    map.v = std::min(map.v, e.v);
    high_u = std::max(high_u, e.u);
    high_v = std::max(high_v, e.v);
  }
  // A map that a picture can hold.
  while (std::max(high_u - map.u, high_v - map.v) / map.cell > 4000.0) map.cell *= 2.0;
  map.u = map.cell * std::floor(map.u / map.cell);
  map.v = map.cell * std::floor(map.v / map.cell);
  map.width = static_cast<int>((high_u - map.u) / map.cell) + 1;
  map.height = static_cast<int>((high_v - map.v) / map.cell) + 1;
  const std::size_t cells =
      static_cast<std::size_t>(map.width) * static_cast<std::size_t>(map.height);
  map.error.assign(cells, std::numeric_limits<float>::quiet_NaN());
  map.count.assign(cells, 0);
  std::vector<std::pair<std::size_t, double>> entries;
  entries.reserve(errors.size());
  for (const SplitError& e : errors) {
    const std::size_t x = static_cast<std::size_t>((e.u - map.u) / map.cell),
                      y = static_cast<std::size_t>((e.v - map.v) / map.cell);
    entries.emplace_back(y * static_cast<std::size_t>(map.width) + x, e.height);
  }
  std::sort(entries.begin(), entries.end());
  for (std::size_t begin = 0, end = 0; begin < entries.size(); begin = end) {
    while (end < entries.size() && entries[end].first == entries[begin].first) ++end;
    map.error[entries[begin].first] = static_cast<float>(entries[(begin + end) / 2].second);
    map.count[entries[begin].first] = static_cast<int>(end - begin);
  }
  return map;
}

nlohmann::json number(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
}

nlohmann::json to_json(const DistanceSummary& s) {
  return {{"count", s.count},
          {"mean", number(s.mean)},
          {"median", number(s.median)},
          {"rms", number(s.rms)},
          {"quantile_90", number(s.quantile_90)},
          {"quantile_95", number(s.quantile_95)},
          {"largest", number(s.largest)}};
}

nlohmann::json to_json(const OneWay& way) {
  nlohmann::json out = to_json(way.summary);
  out["points"] = way.points.size();
  out["not_finite"] = way.not_finite;
  out["outside"] = way.outside;
  out["unobserved"] = way.unobserved;
  if (way.along_normal.count > 0) out["along_normal"] = to_json(way.along_normal);
  return out;
}

}  // namespace

std::string to_string(Alignment alignment) {
  switch (alignment) {
    case Alignment::kNone:
      return "none";
    case Alignment::kScale:
      return "scale";
    case Alignment::kRigid:
      return "rigid";
    case Alignment::kSimilarity:
      return "similarity";
  }
  return "";
}

ShapeDistances distances_to(const Shape& shape, const std::vector<Vector3d>& places,
                            int num_threads) {
  return ShapeSearch(shape).distances(places, num_threads);
}

std::vector<Vector3d> true_points(const RoadCloud& cloud, const Matrix4d& transform) {
  std::vector<Vector3d> out(cloud.size());
  const bool still = transform.isIdentity(0.0);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const Vector3d p = cloud.origin + cloud.points[i].cast<double>();
    out[i] = still ? p : move(transform, p);
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

void CompareOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* expected) {
    if (good) return;
    throw std::invalid_argument(std::string(name) + " = " + std::to_string(value) + ", expected " +
                                expected);
  };
  require(!thresholds.empty(), "thresholds", 0.0, "at least one");
  for (const double t : thresholds) {
    require(std::isfinite(t) && t > 0.0, "thresholds", t, "positive numbers of metres");
  }
  require(estimate_from_truth.allFinite() &&
              std::abs(estimate_from_truth.topLeftCorner<3, 3>().determinant()) > 0.0,
          "estimate_from_truth", 0.0, "an invertible matrix");
  if (!pairs.empty()) {
    require(alignment != Alignment::kNone, "pairs", static_cast<double>(pairs.size()),
            "an alignment to use them for");
    require(alignment == Alignment::kScale || pairs.size() >= 3, "pairs",
            static_cast<double>(pairs.size()), "at least 3");
    for (const auto& [a, b] : pairs) {
      require(a.allFinite() && b.allFinite(), "pairs", kNaN, "finite numbers");
    }
  }
  require(farthest > 0.0, "farthest", farthest, "a positive number of metres");
  require(up.allFinite() && up.norm() > 0.0, "up", up.norm(), "a direction");
  require(along.allFinite() && along.cross(up).norm() > 1e-9 * along.norm() * up.norm(), "along",
          along.norm(), "a direction that is not upright");
  require(road_limit > 0.0, "road_limit", road_limit, "a positive number of metres");
  require(std::isfinite(map_cell) && map_cell > 0.0, "map_cell", map_cell,
          "a positive number of metres");
  require(std::isfinite(mesh_density) && mesh_density > 0.0, "mesh_density", mesh_density,
          "a positive number");
}

DistanceSummary summarise_distances(const std::vector<double>& values) {
  DistanceSummary out;
  std::vector<double> sizes;
  sizes.reserve(values.size());
  for (const double v : values) {
    if (std::isfinite(v)) sizes.push_back(std::abs(v));
  }
  out.count = sizes.size();
  if (sizes.empty()) return out;
  std::sort(sizes.begin(), sizes.end());
  double sum = 0.0, squares = 0.0;
  for (const double v : sizes) {
    sum += v;
    squares += v * v;
  }
  const double n = static_cast<double>(sizes.size());
  const auto quantile = [&](double share) {
    return sizes[std::min(sizes.size() - 1, static_cast<std::size_t>(share * n))];
  };
  out.mean = sum / n;
  out.rms = std::sqrt(squares / n);
  out.median = quantile(0.5);
  out.quantile_90 = quantile(0.9);
  out.quantile_95 = quantile(0.95);
  out.largest = sizes.back();
  return out;
}

CloudComparison compare_shapes(const Shape& estimate_in, const Shape& truth_in,
                               const CompareOptions& options) {
  options.validate();
  estimate_in.cloud.validate();
  truth_in.cloud.validate();
  constexpr std::size_t kMostSamples = 2000000;
  CloudComparison out;
  Shape truth = transformed(truth_in, options.estimate_from_truth);

  // What is measured of a mesh are points spread over it.
  const auto measured = [&](const Shape& shape) {
    return shape.is_mesh() ? sample_mesh(shape, options.mesh_density, kMostSamples, options.seed)
                           : shape.cloud;
  };
  const bool iterates = options.alignment != Alignment::kNone && options.pairs.empty();
  if ((options.road_frame || iterates) && !truth.is_mesh() && truth.cloud.normals.empty()) {
    truth.cloud.normals = tangent_normals(truth.cloud, options.up, options.num_threads);
  }
  Shape estimate = estimate_in;
  if (options.alignment != Alignment::kNone) {
    out.alignment = options.pairs.empty()
                        ? iterate_closest(true_points(measured(estimate_in)), truth,
                                          options.alignment, options.num_threads)
                        : align_pairs(options);
    estimate = transformed(estimate_in, out.alignment.transform);
  }

  const auto measure = [&](const Shape& from, const Shape& to, OneWay& way) {
    way.points = measured(from);
    const std::vector<Vector3d> places = true_points(way.points);
    way.distances = distances_to(to, places, options.num_threads);
    way.counted.assign(places.size(), 1);
    return places;
  };
  const std::vector<Vector3d> estimated = measure(estimate, truth, out.accuracy);
  const std::vector<Vector3d> true_places = measure(truth, estimate, out.completeness);
  const auto sort_out = [&](const std::vector<Vector3d>& places, OneWay& way, auto&& observed) {
    for (std::size_t i = 0; i < places.size(); ++i) {
      std::size_t* reason = nullptr;
      if (!places[i].allFinite()) {
        reason = &way.not_finite;
      } else if (options.region && !options.region->contains(places[i])) {
        reason = &way.outside;
      } else if (!observed(places[i])) {
        reason = &way.unobserved;
      }
      if (reason == nullptr) continue;
      ++*reason;
      way.counted[i] = 0;
    }
  };
  if (options.truth_viewpoint) {
    const ObservedSpace space(
        true_points(measured(truth_in)), *options.truth_viewpoint,
        *std::max_element(options.thresholds.begin(), options.thresholds.end()));
    const Matrix4d truth_from_estimate = options.estimate_from_truth.inverse();
    sort_out(estimated, out.accuracy,
             [&](const Vector3d& p) { return space.contains(move(truth_from_estimate, p)); });
  } else {
    sort_out(estimated, out.accuracy, [](const Vector3d&) { return true; });
  }
  sort_out(true_places, out.completeness, [&](const Vector3d& p) {
    return options.views.empty() || seen(options.views, options.farthest, p);
  });

  std::vector<double> accuracy = counted_values(out.accuracy, out.accuracy.distances.distance),
                      completeness =
                          counted_values(out.completeness, out.completeness.distances.distance);
  if (accuracy.empty() || completeness.empty()) {
    throw NoAnswerError(accuracy.empty() && completeness.empty()
                            ? "nothing to compare: no points left on either side"
                        : accuracy.empty()
                            ? "nothing to compare: no points of the estimate are left"
                            : "nothing to compare: no points of the truth are left");
  }
  out.accuracy.summary = summarise_distances(accuracy);
  out.completeness.summary = summarise_distances(completeness);
  // Normals that were only estimated here serve the road's frame, not this.
  if (truth_in.is_mesh() || !truth_in.cloud.normals.empty()) {
    out.accuracy.along_normal =
        summarise_distances(counted_values(out.accuracy, out.accuracy.distances.along_normal));
  }
  out.completeness.along_normal = summarise_distances(
      counted_values(out.completeness, out.completeness.distances.along_normal));
  std::sort(accuracy.begin(), accuracy.end());
  std::sort(completeness.begin(), completeness.end());
  for (const double threshold : options.thresholds) {
    ThresholdScore score;
    score.threshold = threshold;
    score.precision = share_within(accuracy, threshold);
    score.recall = share_within(completeness, threshold);
    const double sum = score.precision + score.recall;
    score.f_score = sum > 0.0 ? 2.0 * score.precision * score.recall / sum : 0.0;
    out.scores.push_back(score);
  }
  if (!options.road_frame) return out;

  const Vector3d up = options.up.normalized();
  const Vector3d along = (options.along - up * up.dot(options.along)).normalized(),
                 left = up.cross(along);
  std::vector<SplitError> errors;
  for (std::size_t i = 0; i < estimated.size(); ++i) {
    if (out.accuracy.counted[i] == 0 || out.accuracy.distances.nearest[i] < 0) continue;
    if (!(out.accuracy.distances.distance[i] <= options.road_limit)) continue;
    Contact c = contact(truth, out.accuracy.distances.nearest[i], estimated[i]);
    if (c.normal.dot(up) < 0.0) c.normal = -c.normal;
    const bool level = c.normal.isZero();  // not known
    if (level) c.normal = up;
    const double upright = c.normal.dot(up);
    if (!(upright > 0.5)) continue;  // walls have no height
    const Vector3d offset = estimated[i] - c.place;
    SplitError e;
    e.height = c.normal.dot(offset) / upright;
    e.along = along.dot(offset);
    e.across = left.dot(offset);
    e.distance = options.viewpoint ? (estimated[i] - *options.viewpoint).norm() : kNaN;
    e.grade = level ? kNaN : std::abs(std::atan2(c.normal.dot(along), upright));
    e.u = along.dot(estimated[i]);
    e.v = left.dot(estimated[i]);
    errors.push_back(e);
  }
  out.road.push_back(summarise_errors(errors, "all", 0.0, kInfinity));
  if (options.viewpoint) {
    const double bins[] = {0.0, 10.0, 20.0, 30.0, 50.0, kInfinity};
    for (int k = 0; k < 5; ++k) {
      out.road.push_back(summarise_errors(errors, "distance", bins[k], bins[k + 1]));
    }
  }
  const double grades[] = {0.0, 2.0, 5.0, 10.0, 15.0, 60.0};
  for (int k = 0; k < 5; ++k) {
    out.road.push_back(summarise_errors(errors, "grade", grades[k], grades[k + 1]));
  }
  out.map = make_map(errors, options.map_cell);
  return out;
}

std::string describe(const CloudComparison& c) {
  std::string out;
  if (c.alignment.alignment != Alignment::kNone) {
    out += fmt::format(
        "aligned ({}): scale {:.6f}, residual {:.4f} -> {:.4f} m over {} pairs; estimate moved "
        "by\n",
        to_string(c.alignment.alignment), c.alignment.scale, c.alignment.residual_before,
        c.alignment.residual_after, c.alignment.pairs);
    for (int r = 0; r < 4; ++r) {
      out += fmt::format("  {:12.6f} {:12.6f} {:12.6f} {:12.6f}\n", c.alignment.transform(r, 0),
                         c.alignment.transform(r, 1), c.alignment.transform(r, 2),
                         c.alignment.transform(r, 3));
    }
  }
  out += "metres                   points     mean   median      rms      90%      95%      max\n";
  const auto row = [&](const char* name, const DistanceSummary& s) {
    out += fmt::format("{:<21}{:>10}{:9.4f}{:9.4f}{:9.4f}{:9.4f}{:9.4f}{:9.3f}\n", name, s.count,
                       s.mean, s.median, s.rms, s.quantile_90, s.quantile_95, s.largest);
  };
  row("accuracy", c.accuracy.summary);
  if (c.accuracy.along_normal.count > 0) row("  along the normal", c.accuracy.along_normal);
  row("completeness", c.completeness.summary);
  if (c.completeness.along_normal.count > 0) row("  along the normal", c.completeness.along_normal);
  const auto left_out = [&](const char* name, const OneWay& way) {
    if (way.not_finite + way.outside + way.unobserved == 0) return;
    out +=
        fmt::format("not counted of the {}: {} not finite, {} outside the region, {} unobserved\n",
                    name, way.not_finite, way.outside, way.unobserved);
  };
  left_out("estimate", c.accuracy);
  left_out("truth", c.completeness);
  out += "threshold   precision   recall   F-score\n";
  for (const ThresholdScore& s : c.scores) {
    out += fmt::format("{:7.3f} m{:11.2f} %{:7.2f} %{:8.2f} %\n", s.threshold, 100.0 * s.precision,
                       100.0 * s.recall, 100.0 * s.f_score);
  }
  if (!c.road.empty()) {
    out += "road frame            points  height mean  |median|      rms   along rms  across rms\n";
    for (const RoadErrors& r : c.road) {
      if (r.count == 0) continue;
      std::string name = "all";
      if (r.by != "all") {
        const char* unit = r.by == "distance" ? "m" : "deg";
        name = std::isfinite(r.to) ? fmt::format("{} {:g}-{:g} {}", r.by, r.from, r.to, unit)
                                   : fmt::format("{} > {:g} {}", r.by, r.from, unit);
      }
      out += fmt::format("{:<18}{:>10}{:+13.4f}{:10.4f}{:9.4f}{:12.4f}{:12.4f}\n", name, r.count,
                         r.height_mean, r.height_median, r.height_rms, r.along_rms, r.across_rms);
    }
  }
  return out;
}

nlohmann::json to_json(const CloudComparison& c) {
  nlohmann::json out;
  nlohmann::json alignment = {{"kind", to_string(c.alignment.alignment)}};
  if (c.alignment.alignment != Alignment::kNone) {
    std::vector<double> rows;
    for (int i = 0; i < 16; ++i) rows.push_back(c.alignment.transform(i / 4, i % 4));
    alignment["from_pairs"] = c.alignment.from_pairs;
    alignment["aligned_from_estimate"] = rows;
    alignment["scale"] = c.alignment.scale;
    alignment["residual_before"] = number(c.alignment.residual_before);
    alignment["residual_after"] = number(c.alignment.residual_after);
    alignment["pairs"] = c.alignment.pairs;
    alignment["iterations"] = c.alignment.iterations;
  }
  out["alignment"] = alignment;
  out["accuracy"] = to_json(c.accuracy);
  out["completeness"] = to_json(c.completeness);
  out["scores"] = nlohmann::json::array();
  for (const ThresholdScore& s : c.scores) {
    out["scores"].push_back({{"threshold", s.threshold},
                             {"precision", s.precision},
                             {"recall", s.recall},
                             {"f_score", s.f_score}});
  }
  out["road"] = nlohmann::json::array();
  for (const RoadErrors& r : c.road) {
    const char* const from = r.by == "grade" ? "from_deg" : "from";
    const char* const to = r.by == "grade" ? "to_deg" : "to";
    out["road"].push_back({{"by", r.by},
                           {from, r.from},
                           {to, number(r.to)},
                           {"count", r.count},
                           {"height_mean", number(r.height_mean)},
                           {"height_median", number(r.height_median)},
                           {"height_rms", number(r.height_rms)},
                           {"along_rms", number(r.along_rms)},
                           {"across_rms", number(r.across_rms)}});
  }
  return out;
}

std::string scores_csv(const CloudComparison& c) {
  std::string out = "threshold,precision,recall,f_score\n";
  for (const ThresholdScore& s : c.scores) {
    out += fmt::format("{},{},{},{}\n", s.threshold, s.precision, s.recall, s.f_score);
  }
  return out;
}

std::string road_errors_csv(const CloudComparison& c) {
  std::string out = "by,from,to,count,height_mean,height_median,height_rms,along_rms,across_rms\n";
  for (const RoadErrors& r : c.road) {
    out += fmt::format("{},{},{},{},{},{},{},{},{}\n", r.by, r.from, r.to, r.count, r.height_mean,
                       r.height_median, r.height_rms, r.along_rms, r.across_rms);
  }
  return out;
}

std::string height_map_csv(const HeightErrorMap& map) {
  std::string out = "u,v,height_error,count\n";
  for (int y = 0; y < map.height; ++y) {
    for (int x = 0; x < map.width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * static_cast<std::size_t>(map.width) +
                             static_cast<std::size_t>(x);
      if (map.count[at] == 0) continue;
      out += fmt::format("{:.4f},{:.4f},{:.5f},{}\n", map.u + (x + 0.5) * map.cell,
                         map.v + (y + 0.5) * map.cell, map.error[at], map.count[at]);
    }
  }
  return out;
}

}  // namespace camber
