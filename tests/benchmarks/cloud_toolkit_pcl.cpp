#include <pcl/features/normal_3d.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/kdtree/kdtree_flann.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/progressive_morphological_filter.h>

#include <cmath>
#include <flann/flann.hpp>

#include "benchmarks/cloud_toolkit_peers.h"
#include "benchmarks/cpu_time.h"

namespace camber::peers {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

Cloud::Ptr to_pcl(const RoadCloud& cloud) {
  Cloud::Ptr out(new Cloud);
  out->reserve(cloud.size());
  for (const Eigen::Vector3f& p : cloud.points) out->emplace_back(p.x(), p.y(), p.z());
  return out;
}

}  // namespace

PeerDistances flann_nearest(const RoadCloud& from, const RoadCloud& to) {
  PeerDistances out;
  out.name = "FLANN, single k-d tree";
  std::vector<Eigen::Vector3f> data = to.points, queries = from.points;
  std::vector<int> index(queries.size());
  std::vector<float> squared(queries.size());
  const double start = bench::cpu_ms();
  const flann::Matrix<float> points(data[0].data(), data.size(), 3);
  flann::Index<flann::L2_Simple<float>> tree(points, flann::KDTreeSingleIndexParams(15));
  tree.buildIndex();
  flann::SearchParams parameters(flann::FLANN_CHECKS_UNLIMITED, 0.0f, false);
  parameters.cores = 1;
  flann::Matrix<int> indices(index.data(), index.size(), 1);
  flann::Matrix<float> distances(squared.data(), squared.size(), 1);
  tree.knnSearch(flann::Matrix<float>(queries[0].data(), queries.size(), 3), indices, distances, 1,
                 parameters);
  out.milliseconds = bench::cpu_ms() - start;
  for (const float d : squared) out.distances.push_back(std::sqrt(static_cast<double>(d)));
  return out;
}

PeerDistances pcl_nearest(const RoadCloud& from, const RoadCloud& to) {
  PeerDistances out;
  out.name = "PCL, KdTreeFLANN";
  const Cloud::Ptr data = to_pcl(to), queries = to_pcl(from);
  const double start = bench::cpu_ms();
  pcl::KdTreeFLANN<pcl::PointXYZ> tree(false);
  tree.setInputCloud(data);
  pcl::Indices index(1);
  std::vector<float> squared(1);
  out.distances.reserve(queries->size());
  for (const pcl::PointXYZ& p : *queries) {
    tree.nearestKSearch(p, 1, index, squared);
    out.distances.push_back(std::sqrt(static_cast<double>(squared[0])));
  }
  out.milliseconds = bench::cpu_ms() - start;
  return out;
}

double pcl_normals(const RoadCloud& cloud, int k, std::vector<Eigen::Vector3f>& normals) {
  const Cloud::Ptr points = to_pcl(cloud);
  const double start = bench::cpu_ms();
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputCloud(points);
  estimation.setSearchMethod(
      pcl::search::KdTree<pcl::PointXYZ>::Ptr(new pcl::search::KdTree<pcl::PointXYZ>));
  estimation.setKSearch(k);
  estimation.setViewPoint(0.0f, 0.0f, 1e6f);
  pcl::PointCloud<pcl::Normal> out;
  estimation.compute(out);
  const double time = bench::cpu_ms() - start;
  normals.clear();
  for (const pcl::Normal& n : out) normals.emplace_back(n.normal_x, n.normal_y, n.normal_z);
  return time;
}

double pcl_voxel_grid(const RoadCloud& cloud, float size, std::size_t& count) {
  const Cloud::Ptr points = to_pcl(cloud);
  const double start = bench::cpu_ms();
  pcl::VoxelGrid<pcl::PointXYZ> grid;
  grid.setInputCloud(points);
  grid.setLeafSize(size, size, size);
  Cloud out;
  grid.filter(out);
  count = out.size();
  return bench::cpu_ms() - start;
}

double pcl_statistical(const RoadCloud& cloud, int k, double deviations, std::vector<int>& kept) {
  const Cloud::Ptr points = to_pcl(cloud);
  const double start = bench::cpu_ms();
  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> filter;
  filter.setInputCloud(points);
  filter.setMeanK(k);
  filter.setStddevMulThresh(deviations);
  pcl::Indices indices;
  filter.filter(indices);
  const double time = bench::cpu_ms() - start;
  kept.assign(indices.begin(), indices.end());
  return time;
}

double pcl_morphological(const RoadCloud& cloud, std::vector<int>& labels) {
  const Cloud::Ptr points = to_pcl(cloud);
  const double start = bench::cpu_ms();
  pcl::ProgressiveMorphologicalFilter<pcl::PointXYZ> filter;
  filter.setInputCloud(points);
  filter.setMaxWindowSize(20);
  filter.setSlope(1.0f);
  filter.setInitialDistance(0.5f);
  filter.setMaxDistance(3.0f);
  pcl::Indices ground;
  filter.extract(ground);
  const double time = bench::cpu_ms() - start;
  labels.assign(cloud.size(), 0);
  for (const int i : ground) labels[static_cast<std::size_t>(i)] = 1;
  return time;
}

}  // namespace camber::peers
