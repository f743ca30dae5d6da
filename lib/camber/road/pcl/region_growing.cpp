#include "camber/road/pcl/region_growing.h"

#include <fmt/format.h>
#include <pcl/features/normal_3d.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/region_growing.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/road/detail/patch_kinds.h"
#include "camber/road/plan_polygon.h"
#include "camber/road/unmodelled.h"

namespace camber {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Points = pcl::PointCloud<pcl::PointXYZ>;

/// The least-squares plane of points with its covariance; nothing for points on a line.
std::optional<UncertainPlane> plane_of(const Points& points, const pcl::Indices& indices,
                                       const Vector3d& up, double* noise) {
  Vector3d mean = Vector3d::Zero();
  for (const int i : indices) mean += points[i].getVector3fMap().cast<double>();
  const auto count = static_cast<double>(indices.size());
  mean /= count;
  Matrix3d scatter = Matrix3d::Zero();
  for (const int i : indices) {
    const Vector3d offset = points[i].getVector3fMap().cast<double>() - mean;
    scatter += offset * offset.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(scatter);
  const double thin = solver.eigenvalues()[1], wide = solver.eigenvalues()[2];
  if (!(thin > 1e-8 * wide)) return std::nullopt;
  const double variance = std::max(solver.eigenvalues()[0], 0.0) / std::max(count - 3.0, 1.0);
  *noise = std::sqrt(variance);
  UncertainPlane out;
  out.centroid = mean;
  out.plane = Plane::through(mean, solver.eigenvectors().col(0)).oriented(up);
  UncertainPlane::make_axes(out.plane.normal, solver.eigenvectors().col(2), &out.axis1, &out.axis2);
  // A turn about axis1 raises what lies along axis2, and the other way round.
  out.covariance = Vector3d(variance / thin, variance / wide, variance / count).asDiagonal();
  return out;
}

/// The hull of a region's points in plan, lifted onto its plane along up.
std::vector<Vector3d> boundary_of(const Points& points, const pcl::Indices& indices,
                                  const Plane& plane, const Vector3d& up) {
  const GroundAxes axes(up);
  std::vector<Eigen::Vector2d> places;
  for (const int i : indices) places.push_back(axes(points[i].getVector3fMap().cast<double>()));
  std::vector<Vector3d> out;
  for (const Eigen::Vector2d& corner : convex_hull(std::move(places))) {
    const Vector3d level = corner.x() * axes.e1 + corner.y() * axes.e2;
    out.push_back(level - plane.signed_distance(level) / plane.normal.dot(up) * up);
  }
  return out;
}

std::vector<pcl::PointIndices> grown_regions(const Points::Ptr& points, const Vector3d& up,
                                             const RoadSurfaceOptions& options,
                                             const RegionGrowingOptions& growing) {
  const pcl::search::KdTree<pcl::PointXYZ>::Ptr tree(new pcl::search::KdTree<pcl::PointXYZ>);
  const pcl::PointCloud<pcl::Normal>::Ptr normals(new pcl::PointCloud<pcl::Normal>);
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputCloud(points);
  estimation.setSearchMethod(tree);
  estimation.setKSearch(growing.normal_neighbours);
  const Vector3d far = 1e6 * up;
  estimation.setViewPoint(static_cast<float>(far.x()), static_cast<float>(far.y()),
                          static_cast<float>(far.z()));
  estimation.compute(*normals);
  pcl::RegionGrowing<pcl::PointXYZ, pcl::Normal> regions;
  regions.setInputCloud(points);
  regions.setInputNormals(normals);
  regions.setSearchMethod(tree);
  regions.setSmoothModeFlag(false);  // against the region's first normal, not the neighbour's
  regions.setNumberOfNeighbours(static_cast<unsigned>(growing.neighbours));
  regions.setMinClusterSize(static_cast<pcl::uindex_t>(options.min_patch_points));
  regions.setSmoothnessThreshold(static_cast<float>(growing.max_angle));
  regions.setCurvatureThreshold(static_cast<float>(growing.max_curvature));
  std::vector<pcl::PointIndices> out;
  regions.extract(out);
  std::stable_sort(out.begin(), out.end(), [](const auto& a, const auto& b) {
    return a.indices.size() > b.indices.size();
  });
  return out;
}

/// The frame of the cloud and its level, as fit_road_surface() names them.
RoadSurface empty_surface(const RoadCloud& cloud, const Vector3d& up) {
  RoadSurface out;
  out.up = up;
  out.metric = cloud.metric;
  out.frame = cloud.frame == CloudFrame::kCamera       ? "camera"
              : (up - Vector3d::UnitZ()).norm() < 1e-9 ? "z-up"
                                                       : "other";
  const bool of_camera =
      cloud.frame == CloudFrame::kCamera && (up - cloud.default_up()).norm() < 1e-9;
  out.level = of_camera ? RoadSurface::Level::kCamera : RoadSurface::Level::kGravity;
  return out;
}

}  // namespace

void RegionGrowingOptions::validate() const {
  const auto require = [](bool good, const char* field, double value, const char* bound) {
    if (good) return;
    throw std::invalid_argument(
        fmt::format("RegionGrowingOptions::{} is {}, expected {}", field, value, bound));
  };
  require(normal_neighbours >= 3, "normal_neighbours", normal_neighbours, ">= 3");
  require(neighbours >= 1, "neighbours", neighbours, ">= 1");
  require(max_angle > 0.0, "max_angle", max_angle, "> 0 rad");
  require(max_curvature > 0.0, "max_curvature", max_curvature, "> 0");
}

RoadSurfaceFit fit_road_surface_pcl(const RoadCloud& cloud, const RoadSurfaceOptions& options,
                                    const RegionGrowingOptions& growing) {
  options.validate();
  growing.validate();
  cloud.validate();
  const Vector3d up = options.up ? options.up->normalized() : cloud.default_up();
  RoadSurfaceFit fit;
  fit.surface = empty_surface(cloud, up);
  fit.surface.driven_line = options.driven_line;
  fit.labels.assign(cloud.size(), -1);
  const auto fail = [&](const std::string& reason) {
    fit.status = Status::kFailed;
    fit.reason = reason;
    return fit;
  };
  const Points::Ptr points(new Points);
  std::vector<std::size_t> row;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.points[i];
    if (!p.allFinite()) continue;
    points->push_back(pcl::PointXYZ(p.x(), p.y(), p.z()));
    row.push_back(i);
  }
  if (row.size() < 3)
    return fail(fmt::format("{} usable points, at least 3 are needed", row.size()));

  std::vector<double> noise;
  for (const pcl::PointIndices& region : grown_regions(points, up, options, growing)) {
    double sigma = 0.0;
    const auto plane = plane_of(*points, region.indices, up, &sigma);
    if (!plane || angle_between(plane->plane.normal, up) > options.max_slope) continue;
    PlanePatch patch;
    patch.boundary = boundary_of(*points, region.indices, plane->plane, up);
    if (patch.boundary.size() < 3) continue;
    patch.id = static_cast<int>(fit.surface.patches.size());
    patch.status = Status::kOk;
    patch.plane = *plane;
    patch.inliers = static_cast<int>(region.indices.size());
    patch.noise = sigma;
    // True coordinates from here on.
    patch.plane.centroid += cloud.origin;
    patch.plane.plane = Plane::through(patch.plane.centroid, plane->plane.normal);
    for (Vector3d& corner : patch.boundary) corner += cloud.origin;
    for (const int i : region.indices) fit.labels[row[static_cast<std::size_t>(i)]] = patch.id;
    noise.push_back(sigma);
    fit.surface.patches.push_back(std::move(patch));
  }
  if (noise.empty()) return fail("no planar ground was found");
  std::nth_element(noise.begin(), noise.begin() + static_cast<long>(noise.size() / 2), noise.end());
  fit.noise = noise[noise.size() / 2];
  fit.surface.links = find_links(fit.surface, options.consistency);
  detail::classify_patches(options.consistency, {}, &fit.surface);
  align_patches_with_road(&fit.surface);
  measure_unmodelled(cloud, fit.labels, &fit.surface);
  fit.status = Status::kOk;
  return fit;
}

}  // namespace camber
