#pragma once

// Adapters between RoadCloud and the Point Cloud Library's clouds; the one header of Camber that
// includes PCL's. Link camber::cloud_pcl.

#include <pcl/PCLPointCloud2.h>
#include <pcl/conversions.h>
#include <pcl/point_cloud.h>

#include <cstddef>
#include <vector>

#include "camber/cloud/road_cloud.h"

namespace camber {

/// A cloud as PCL's untyped one with all that it has: x y z, rgb (packed), normal_x normal_y
/// normal_z, sigma, cov_xx ... cov_zz, labels as INT32 and other attributes as FLOAT32 under their
/// names; one row. PCL's clouds have no origin: the coordinates are those relative to
/// `cloud.origin`, and are to be given back with it.
/// @throws std::invalid_argument if cloud.validate() fails or an attribute's name is there twice.
pcl::PCLPointCloud2 to_pcl_blob(const RoadCloud& cloud);

/// The points of any PCL cloud in their order, row by row, also those that are not finite. Fields
/// are understood by the names above (also rgba, nx, label, intensity ...); those of whole numbers
/// become labels, others scalars; a field of several values becomes NAME_0, NAME_1 ...; "_" is left
/// out. Coordinates of 8 bytes keep their digits: they get an origin.
/// @throws std::invalid_argument for a blob without x, y, z, whose data does not hold its points,
///         or in the other byte order.
RoadCloud from_pcl(const pcl::PCLPointCloud2& cloud);

namespace detail {

/// Points in memory with PCL's description of their fields.
struct PclPoints {
  std::vector<pcl::PCLPointField> fields;
  std::size_t stride = 0;  ///< bytes from one point to the next
  std::size_t count = 0;
};

RoadCloud read_pcl_points(const PclPoints& layout, const void* data);
/// Writes the fields that both have, converted to the type of the point's; others stay.
void fill_pcl_points(const RoadCloud& cloud, const PclPoints& layout, void* data);

template <typename Point>
PclPoints layout_of(const pcl::PointCloud<Point>& cloud) {
  pcl::PCLPointCloud2 described;
  pcl::toPCLPointCloud2(pcl::PointCloud<Point>(), described);
  return {described.fields, sizeof(Point), cloud.size()};
}

}  // namespace detail

/// The same for any registered point type.
template <typename Point>
RoadCloud from_pcl(const pcl::PointCloud<Point>& cloud) {
  return detail::read_pcl_points(detail::layout_of(cloud), cloud.points.data());
}

/// A cloud of a registered point type: the fields that it shares with the cloud, by name. What only
/// the point type has keeps its default; what only the cloud has is left out.
///   pcl::PointCloud<pcl::PointXYZRGBNormal> points = to_pcl<pcl::PointXYZRGBNormal>(cloud);
/// @throws std::invalid_argument as to_pcl_blob().
template <typename Point>
pcl::PointCloud<Point> to_pcl(const RoadCloud& cloud) {
  pcl::PointCloud<Point> out;
  out.resize(cloud.size());
  detail::fill_pcl_points(cloud, detail::layout_of(out), out.points.data());
  out.is_dense = true;
  for (const Eigen::Vector3f& point : cloud.points) out.is_dense &= point.allFinite();
  return out;
}

}  // namespace camber
