#include "camber/road/pcl/morphological_ground.h"

#include <fmt/format.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/approximate_progressive_morphological_filter.h>

#include <Eigen/Geometry>
#include <cmath>

namespace camber {
namespace {

constexpr double kMostCells = 4e6;
constexpr float kMostHeight = 2.5f;  // m, that a window may cut off

}  // namespace

GroundSegmentation segment_ground_pcl(const RoadCloud& cloud, const GroundOptions& options) {
  options.validate();
  GroundSegmentation out;
  out.cell = options.cell > 0.0 ? options.cell : 0.5;
  out.largest_object = options.largest_object > 0.0 ? options.largest_object : 12.0;
  out.slope = options.slope > 0.0 ? options.slope : 0.3;
  out.tolerance = options.tolerance > 0.0 ? options.tolerance : 0.2;
  out.labels.assign(cloud.size(), 0);
  const auto fail = [&](const std::string& reason) {
    out.status = Status::kFailed;
    out.reason = reason;
    return out;
  };
  const Eigen::Quaternionf level =
      Eigen::Quaterniond::FromTwoVectors(options.up, Eigen::Vector3d::UnitZ()).cast<float>();
  const pcl::PointCloud<pcl::PointXYZ>::Ptr points(new pcl::PointCloud<pcl::PointXYZ>);
  std::vector<std::size_t> row;
  Eigen::AlignedBox3f box;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!cloud.points[i].allFinite()) continue;
    const Eigen::Vector3f p = level * cloud.points[i];
    points->push_back(pcl::PointXYZ(p.x(), p.y(), p.z()));
    row.push_back(i);
    box.extend(p);
  }
  if (row.empty()) return fail("no finite points");
  const Eigen::Vector2d cells =
      (box.sizes().head<2>().cast<double>() / out.cell).array().floor() + 1.0;
  if (cells.prod() > kMostCells) {
    return fail(
        fmt::format("a grid of {:.0f} x {:.0f} cells of {} m, at most {:.0f} cells are "
                    "filtered: a larger cell is needed",
                    cells.x(), cells.y(), out.cell, kMostCells));
  }
  pcl::ApproximateProgressiveMorphologicalFilter<pcl::PointXYZ> filter;
  filter.setInputCloud(points);
  filter.setNumberOfThreads(1);  // its threads race for the lowest point of a cell
  filter.setCellSize(static_cast<float>(out.cell));
  filter.setMaxWindowSize(static_cast<int>(std::ceil(out.largest_object / out.cell)));
  filter.setSlope(static_cast<float>(out.slope));
  filter.setInitialDistance(static_cast<float>(out.tolerance));
  filter.setMaxDistance(kMostHeight);
  pcl::Indices ground;
  filter.extract(ground);
  for (const int i : ground) out.labels[row[static_cast<std::size_t>(i)]] = 1;
  out.ground = ground.size();
  if (ground.empty()) return fail("no ground was found");
  out.status = Status::kOk;
  return out;
}

}  // namespace camber
