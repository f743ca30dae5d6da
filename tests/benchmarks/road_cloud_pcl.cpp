#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/msac.h>
#include <pcl/sample_consensus/ransac.h>
#include <pcl/sample_consensus/sac_model_plane.h>

#include <ctime>
#include <memory>

#include "benchmarks/road_cloud_peers.h"

namespace camber::benchmarks {

double cpu_ms() {
  timespec now{};
  ::clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

PeerAnswer pcl_plane(const RoadCloud& cloud, bool msac, int max_iterations) {
  constexpr double kThreshold = 0.05;  // m
  PeerAnswer answer;
  answer.name = msac ? "PCL MSAC" : "PCL RANSAC";
  pcl::PointCloud<pcl::PointXYZ>::Ptr input(new pcl::PointCloud<pcl::PointXYZ>);
  input->reserve(cloud.size());
  for (const Eigen::Vector3f& p : cloud.points) input->push_back({p.x(), p.y(), p.z()});
  const double start = cpu_ms();
  using Model = pcl::SampleConsensusModelPlane<pcl::PointXYZ>;
  const Model::Ptr model(new Model(input));
  std::unique_ptr<pcl::SampleConsensus<pcl::PointXYZ>> consensus;
  if (msac) {
    consensus = std::make_unique<pcl::MEstimatorSampleConsensus<pcl::PointXYZ>>(model, kThreshold);
  } else {
    consensus = std::make_unique<pcl::RandomSampleConsensus<pcl::PointXYZ>>(model, kThreshold);
  }
  consensus->setMaxIterations(max_iterations);
  consensus->setProbability(0.99);
  if (!consensus->computeModel()) return answer;
  pcl::Indices inliers;
  Eigen::VectorXf first, refined;
  consensus->getInliers(inliers);
  consensus->getModelCoefficients(first);
  model->optimizeModelCoefficients(inliers, first, refined);
  model->selectWithinDistance(refined, kThreshold, inliers);
  answer.ms = cpu_ms() - start;
  Plane plane{refined.head<3>().cast<double>(), static_cast<double>(refined[3])};
  const double norm = plane.normal.norm();
  plane.normal /= norm;
  plane.offset /= norm;
  answer.planes = {plane.oriented(Eigen::Vector3d::UnitZ())};
  answer.labels.assign(cloud.size(), -1);
  for (const int i : inliers) answer.labels[static_cast<std::size_t>(i)] = 0;
  return answer;
}

}  // namespace camber::benchmarks
