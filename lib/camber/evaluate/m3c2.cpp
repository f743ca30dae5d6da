#include "camber/evaluate/m3c2.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <tuple>

#include "camber/cloud/point_tree.h"
#include "camber/core/errors.h"
#include "camber/core/median.h"
#include "camber/core/threads.h"

namespace camber {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr double kNormal95 = 1.96;
constexpr std::size_t kLeastPoints = 4;  // of either cloud for a detection limit
constexpr double kPerCylinder = 30.0;    // points that a chosen cylinder holds

/// A cloud's points in the frame of the earlier one's origin.
struct Epoch {
  std::vector<Vector3f> points;
  const RoadCloud& cloud;
  PointTree tree;

  Epoch(const RoadCloud& given, const Vector3d& origin, int threads)
      : points(moved(given, given.origin - origin)), cloud(given), tree(points, threads) {}

  static std::vector<Vector3f> moved(const RoadCloud& cloud, const Vector3d& shift) {
    if (shift.isZero(0.0)) return cloud.points;
    std::vector<Vector3f> out;
    out.reserve(cloud.size());
    for (const Vector3f& p : cloud.points) {
      out.push_back((p.cast<double>() + shift).cast<float>());
    }
    return out;
  }

  /// Points a square metre of surface, the median around a thousand of them.
  double density() const {
    constexpr int kNeighbors = 8;
    std::vector<double> densities;
    std::vector<PointTree::Neighbor> near;
    const std::size_t step = std::max<std::size_t>(1, points.size() / 1000);
    for (std::size_t i = 0; i < points.size(); i += step) {
      if (!points[i].allFinite()) continue;
      tree.nearest(points[i], kNeighbors + 1, near);
      if (near.size() <= kNeighbors || !(near.back().squared_distance > 0.0f)) continue;
      densities.push_back(kNeighbors / (M_PI * near.back().squared_distance));
    }
    return densities.empty() ? 0.0 : upper_median(&densities);
  }
};

/// The points of an epoch in a cylinder: their mean along the axis and what is known of its error.
struct CylinderMean {
  std::size_t count = 0;
  double mean = 0.0;      ///< m along the axis from the core point
  double variance = 0.0;  ///< m^2, of the mean
};

CylinderMean cylinder_mean(const Epoch& epoch, const Vector3d& core, const Vector3d& axis,
                           double radius, double depth, std::vector<PointTree::Neighbor>* near) {
  // A float's search may miss what rounding takes beyond it.
  const double reach = std::hypot(radius, depth) * (1.0 + 1e-6) + 1e-6;
  epoch.tree.within(core.cast<float>(), static_cast<float>(reach), *near);
  std::sort(near->begin(), near->end(),
            [](const auto& a, const auto& b) { return a.index < b.index; });
  CylinderMean out;
  double sum = 0.0, squares = 0.0, own = 0.0;
  std::vector<double> along;
  for (const PointTree::Neighbor& neighbor : *near) {
    const auto i = static_cast<std::size_t>(neighbor.index);
    const Vector3d offset = epoch.points[i].cast<double>() - core;
    const double at = axis.dot(offset);
    if (std::abs(at) > depth || (offset - at * axis).squaredNorm() > radius * radius) continue;
    along.push_back(at);
    sum += at;
    if (!epoch.cloud.sigmas.empty()) own += std::pow(double{epoch.cloud.sigmas[i]}, 2);
  }
  out.count = along.size();
  if (along.empty()) return out;
  const auto n = static_cast<double>(out.count);
  out.mean = sum / n;
  for (const double at : along) squares += (at - out.mean) * (at - out.mean);
  const double roughness = out.count > 1 ? squares / (n - 1.0) : 0.0;
  out.variance = std::max(roughness, own / n) / n;
  return out;
}

/// The same of the plane through an epoch's points in a vertical cylinder, at its axis: on a slope
/// what points rise within a cylinder is no roughness.
CylinderMean plane_height(const Epoch& epoch, const Vector3d& core, const Vector3d& up,
                          double radius, double depth, std::vector<PointTree::Neighbor>* near) {
  const double reach = std::hypot(radius, depth) * (1.0 + 1e-6) + 1e-6;
  epoch.tree.within(core.cast<float>(), static_cast<float>(reach), *near);
  std::sort(near->begin(), near->end(),
            [](const auto& a, const auto& b) { return a.index < b.index; });
  const Vector3d e1 = up.unitOrthogonal(), e2 = up.cross(e1);
  CylinderMean out;
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  double squares = 0.0, own = 0.0;
  for (const PointTree::Neighbor& neighbor : *near) {
    const auto i = static_cast<std::size_t>(neighbor.index);
    const Vector3d offset = epoch.points[i].cast<double>() - core;
    const double at = up.dot(offset);
    if (std::abs(at) > depth || (offset - at * up).squaredNorm() > radius * radius) continue;
    const Vector3d row(1.0, e1.dot(offset), e2.dot(offset));
    normal += row * row.transpose();
    right += at * row;
    squares += at * at;
    if (!epoch.cloud.sigmas.empty()) own += std::pow(double{epoch.cloud.sigmas[i]}, 2);
    ++out.count;
  }
  if (out.count < kLeastPoints) return out;
  const Eigen::LDLT<Eigen::Matrix3d> solver(normal);
  const Vector3d plane = solver.solve(right);
  const auto n = static_cast<double>(out.count);
  const double roughness = std::max(0.0, squares - right.dot(plane)) / (n - 3.0);
  out.mean = plane[0];
  out.variance = std::max(roughness, own / n) * solver.solve(Vector3d::UnitX())[0];
  // Points on one line show no plane.
  if (!(out.variance >= 0.0) || !plane.allFinite() || !(out.variance < 1e6)) out.count = 0;
  return out;
}

/// One point a cube, the nearest to its middle, in the order of the cubes.
std::vector<std::size_t> core_points(const Epoch& epoch, double spacing) {
  using Cube = std::tuple<long, long, long>;
  std::map<Cube, std::pair<double, std::size_t>> nearest;
  for (std::size_t i = 0; i < epoch.points.size(); ++i) {
    if (!epoch.points[i].allFinite()) continue;
    const Vector3d at = epoch.points[i].cast<double>() / spacing;
    const Vector3d low = at.array().floor();
    const double off = (at - low - Vector3d::Constant(0.5)).squaredNorm();
    const Cube cube{static_cast<long>(low.x()), static_cast<long>(low.y()),
                    static_cast<long>(low.z())};
    const auto found = nearest.find(cube);
    if (found == nearest.end()) {
      nearest.emplace(cube, std::pair(off, i));
    } else if (off < found->second.first) {
      found->second = {off, i};
    }
  }
  std::vector<std::size_t> out;
  for (const auto& [cube, point] : nearest) out.push_back(point.second);
  return out;
}

/// Of the plane through the points around a core point; zero where there is none.
Vector3d normal_at(const Epoch& epoch, const Vector3d& core, double radius, const Vector3d& up,
                   std::vector<PointTree::Neighbor>* near) {
  const double reach = radius * (1.0 + 1e-6) + 1e-6;
  epoch.tree.within(core.cast<float>(), static_cast<float>(reach), *near);
  std::sort(near->begin(), near->end(),
            [](const auto& a, const auto& b) { return a.index < b.index; });
  std::vector<Vector3d> offsets;
  Vector3d mean = Vector3d::Zero();
  for (const PointTree::Neighbor& neighbor : *near) {
    const Vector3d offset =
        epoch.points[static_cast<std::size_t>(neighbor.index)].cast<double>() - core;
    if (offset.squaredNorm() > radius * radius) continue;
    offsets.push_back(offset);
    mean += offset;
  }
  if (offsets.size() < 3) return Vector3d::Zero();
  mean /= static_cast<double>(offsets.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Vector3d& offset : offsets) scatter += (offset - mean) * (offset - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  if (!(solver.eigenvalues()[1] > 1e-12 * solver.eigenvalues()[2])) return Vector3d::Zero();
  Vector3d normal = solver.eigenvectors().col(0);
  if (normal.dot(up) < 0.0) normal = -normal;
  return normal;
}

M3c2Options with_sizes(M3c2Options options, const Epoch& later, const Epoch& earlier) {
  if (!(options.cylinder > 0.0)) {
    const double density = std::min(later.density(), earlier.density());
    if (!(density > 0.0)) {
      throw NoAnswerError(
          "a cloud has fewer than nine different points, from which no cylinder "
          "follows; give one");
    }
    options.cylinder = 2.0 * std::sqrt(kPerCylinder / (M_PI * density));
  }
  if (!(options.normal_scale > 0.0)) options.normal_scale = 3.0 * options.cylinder;
  if (!(options.core_spacing > 0.0)) options.core_spacing = 0.5 * options.cylinder;
  if (!(options.max_depth > 0.0)) options.max_depth = std::max(2.0, 4.0 * options.cylinder);
  return options;
}

void require(bool good, const char* field, double value, const char* bound) {
  if (!good) {
    throw std::invalid_argument(
        fmt::format("M3c2Options::{} is {}, expected {}", field, value, bound));
  }
}

/// Areas and volumes of the cells that have changed.
void add_volumes(CloudChange* change, const Vector3d& up) {
  const double side = change->used.core_spacing, cell = side * side;
  // Cells in plan, of core points over one another the one with the largest change.
  Vector3d e1 = up.cross(std::abs(up.x()) < 0.9 ? Vector3d::UnitX() : Vector3d::UnitY());
  e1.normalize();
  if (up.isApprox(Vector3d::UnitZ(), 1e-12)) e1 = Vector3d::UnitX();
  const Vector3d e2 = up.cross(e1);
  std::map<std::pair<long, long>, const CoreChange*> cells;
  for (const CoreChange& core : change->cores) {
    if (!core.significant) continue;
    const std::pair<long, long> key{std::lround(std::floor(core.point.dot(e1) / side)),
                                    std::lround(std::floor(core.point.dot(e2) / side))};
    const CoreChange*& here = cells[key];
    if (!here || std::abs(core.distance) > std::abs(here->distance)) here = &core;
  }
  // Cylinders that are wider than a cell share points.
  const double shared = std::max(1.0, M_PI * std::pow(0.5 * change->used.cylinder, 2) / cell);
  double variance[2] = {}, leaning[2] = {};  // of gain and loss; of registration, in m^2 of area
  for (const auto& [key, core] : cells) {
    const double slant = std::max(0.1, std::abs(core->normal.dot(up)));
    const double vertical = core->distance / slant;
    const int loss = vertical < 0.0;
    (loss ? change->loss_area : change->gain_area) += cell;
    (loss ? change->loss_volume : change->gain_volume) += std::abs(vertical) * cell;
    variance[loss] += shared * std::pow(core->sigma / slant * cell, 2);
    leaning[loss] += cell / slant;
  }
  const double registration = change->used.registration_sigma;
  const auto sigma = [&](double of_points, double area) {
    return std::hypot(std::sqrt(of_points), registration * area);
  };
  change->gain_volume_sigma = sigma(variance[0], leaning[0]);
  change->loss_volume_sigma = sigma(variance[1], leaning[1]);
  change->net_volume = change->gain_volume - change->loss_volume;
  change->net_volume_sigma = sigma(variance[0] + variance[1], leaning[0] + leaning[1]);
}

}  // namespace

void M3c2Options::validate() const {
  require(normal_scale >= 0.0 && std::isfinite(normal_scale), "normal_scale", normal_scale,
          ">= 0 m (0: chosen)");
  require(cylinder >= 0.0 && std::isfinite(cylinder), "cylinder", cylinder, ">= 0 m (0: chosen)");
  require(core_spacing >= 0.0 && std::isfinite(core_spacing), "core_spacing", core_spacing,
          ">= 0 m (0: chosen)");
  require(max_depth >= 0.0 && std::isfinite(max_depth), "max_depth", max_depth,
          ">= 0 m (0: chosen)");
  require(registration_sigma >= 0.0 && std::isfinite(registration_sigma), "registration_sigma",
          registration_sigma, ">= 0 m");
  require(up.allFinite() && up.norm() > 0.0, "up's length", up.norm(), "> 0");
}

CloudChange measure_change(const RoadCloud& later, const RoadCloud& earlier,
                           const M3c2Options& options) {
  options.validate();
  const Epoch before(earlier, earlier.origin, options.num_threads);
  const Epoch after(later, earlier.origin, options.num_threads);
  if (before.tree.size() == 0 || after.tree.size() == 0) {
    throw NoAnswerError(
        fmt::format("the {} cloud has no points", before.tree.size() == 0 ? "earlier" : "later"));
  }
  CloudChange out;
  out.metric = later.metric && earlier.metric;
  out.used = with_sizes(options, after, before);
  const Vector3d up = options.up.normalized();
  const std::vector<std::size_t> cores = core_points(before, out.used.core_spacing);
  out.cores.resize(cores.size());
  constexpr std::size_t kBlock = 64;
  parallel_for((cores.size() + kBlock - 1) / kBlock, options.num_threads, [&](std::size_t block) {
    std::vector<PointTree::Neighbor> near;
    for (std::size_t k = block * kBlock; k < std::min(cores.size(), (block + 1) * kBlock); ++k) {
      const Vector3d core = before.points[cores[k]].cast<double>();
      CoreChange& change = out.cores[k];
      change.point = earlier.origin + core;
      change.normal =
          options.vertical ? up : normal_at(before, core, 0.5 * out.used.normal_scale, up, &near);
      if (change.normal.isZero(0.0)) continue;
      const auto mean = [&](const Epoch& epoch) {
        if (options.vertical) {
          return plane_height(epoch, core, up, 0.5 * out.used.cylinder, out.used.max_depth, &near);
        }
        return cylinder_mean(epoch, core, change.normal, 0.5 * out.used.cylinder,
                             out.used.max_depth, &near);
      };
      const CylinderMean first = mean(before), second = mean(after);
      change.earlier = first.count;
      change.later = second.count;
      const std::size_t least = options.vertical ? kLeastPoints : 1;
      if (std::min(first.count, second.count) < least) continue;
      change.distance = second.mean - first.mean;
      if (std::min(first.count, second.count) < kLeastPoints) continue;
      change.sigma = std::sqrt(first.variance + second.variance);
      change.detection_limit = kNormal95 * (change.sigma + options.registration_sigma);
      change.significant = std::abs(change.distance) > change.detection_limit;
    }
  });
  std::vector<double> distances, limits;
  double sum = 0.0;
  for (const CoreChange& core : out.cores) {
    if (!std::isfinite(core.detection_limit)) continue;
    distances.push_back(core.distance);
    limits.push_back(core.detection_limit);
    sum += core.distance;
    out.significant += core.significant;
  }
  out.measured = distances.size();
  if (distances.empty()) {
    throw NoAnswerError(
        fmt::format("none of {} core points has {} points of either cloud in its cylinder of "
                    "{:.3g} m and {:.3g} m to either side: do the clouds lie on each other?",
                    out.cores.size(), kLeastPoints, out.used.cylinder, out.used.max_depth));
  }
  out.mean = sum / static_cast<double>(out.measured);
  out.median = upper_median(&distances);
  out.median_limit = upper_median(&limits);
  add_volumes(&out, up);
  return out;
}

std::string describe(const CloudChange& change) {
  const char* const m = change.metric ? "m" : "units";
  const auto share = [&](std::size_t count, std::size_t of) {
    return of > 0 ? 100.0 * static_cast<double>(count) / static_cast<double>(of) : 0.0;
  };
  std::string out = fmt::format(
      "change, later less earlier: mean {:+.4f} {}, median {:+.4f} {}; detection limit at 95 % "
      "{:.4f} {} (median)\n",
      change.mean, m, change.median, m, change.median_limit, m);
  out +=
      fmt::format("significant: {} of {} core points ({:.1f} %); {} more are not measured\n",
                  change.significant, change.measured, share(change.significant, change.measured),
                  change.cores.size() - change.measured);
  out += fmt::format(
      "gain: {:.2f} {}2, {:.3f} ± {:.3f} {}3; loss: {:.2f} {}2, {:.3f} ± {:.3f} {}3; "
      "net {:+.3f} ± {:.3f} {}3 (1 sigma)\n",
      change.gain_area, m, change.gain_volume, change.gain_volume_sigma, m, change.loss_area, m,
      change.loss_volume, change.loss_volume_sigma, m, change.net_volume, change.net_volume_sigma,
      m);
  out += fmt::format(
      "normals from {:.3g} {}, cylinders of {:.3g} {} to {:.3g} {} of depth, core "
      "points every {:.3g} {}, registration {:.3g} {}\n",
      change.used.vertical ? 0.0 : change.used.normal_scale, m, change.used.cylinder, m,
      change.used.max_depth, m, change.used.core_spacing, m, change.used.registration_sigma, m);
  return out;
}

nlohmann::json to_json(const CloudChange& change) {
  const auto number = [](double value) {
    return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json(nullptr);
  };
  return {{"metric", change.metric},
          {"core_points", change.cores.size()},
          {"measured", change.measured},
          {"significant", change.significant},
          {"change_mean", number(change.mean)},
          {"change_median", number(change.median)},
          {"detection_limit_95", number(change.median_limit)},
          {"gain",
           {{"area", change.gain_area},
            {"volume", change.gain_volume},
            {"sigma_volume", change.gain_volume_sigma}}},
          {"loss",
           {{"area", change.loss_area},
            {"volume", change.loss_volume},
            {"sigma_volume", change.loss_volume_sigma}}},
          {"net", {{"volume", change.net_volume}, {"sigma_volume", change.net_volume_sigma}}},
          {"used",
           {{"normal_scale", change.used.normal_scale},
            {"cylinder", change.used.cylinder},
            {"core_spacing", change.used.core_spacing},
            {"max_depth", change.used.max_depth},
            {"registration_sigma", change.used.registration_sigma}}}};
}

}  // namespace camber
