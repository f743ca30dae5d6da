#include "camber/plane/dominant_plane_pcl.h"

#include <fmt/format.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/segmentation/sac_segmentation.h>
#include <pcl/segmentation/impl/sac_segmentation.hpp>

#include <algorithm>
#include <stdexcept>

#include "camber/plane/detail/quiet_pcl.h"

namespace camber {

void DominantPlaneOptions::validate() const {
  const auto require = [](bool good, const char* name, double value, const char* bound) {
    if (!good) throw std::invalid_argument(fmt::format("{}: {}, must be {}", name, value, bound));
  };
  require(inlier_threshold > 0.0, "inlier_threshold", inlier_threshold, "> 0");
  require(max_tilt > 0.0 && max_tilt < 1.5707963, "max_tilt", max_tilt, "in (0, pi / 2)");
  require(max_iterations >= 1, "max_iterations", max_iterations, ">= 1");
  require(probability > 0.0 && probability < 1.0, "probability", probability, "in (0, 1)");
}

DominantPlane dominant_plane_pcl(const std::vector<Eigen::Vector3d>& points,
                                 const DominantPlaneOptions& options) {
  options.validate();
  DominantPlane out;
  out.status = Status::kFailed;
  if (points.size() < 3) {
    out.reason = fmt::format("{} points, at least 3 are needed", points.size());
    return out;
  }
  pcl::PointCloud<pcl::PointXYZ>::Ptr cloud(new pcl::PointCloud<pcl::PointXYZ>);
  for (const Eigen::Vector3d& p : points) {
    cloud->push_back(
        {static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())});
  }
  const detail::QuietPcl quiet;
  pcl::SACSegmentation<pcl::PointXYZ> segmentation(/*random=*/false);
  segmentation.setModelType(pcl::SACMODEL_PERPENDICULAR_PLANE);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setAxis(options.up.cast<float>());
  segmentation.setEpsAngle(options.max_tilt);
  segmentation.setOptimizeCoefficients(true);
  segmentation.setMaxIterations(options.max_iterations);
  segmentation.setProbability(options.probability);
  segmentation.setDistanceThreshold(options.inlier_threshold);
  segmentation.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients model;
  segmentation.segment(inliers, model);
  if (model.values.size() != 4 || inliers.indices.size() < 3) {
    out.reason = "no plane near the wanted direction";
    return out;
  }
  const Eigen::Vector3d normal(model.values[0], model.values[1], model.values[2]);
  const double norm = normal.norm();
  out.plane = Plane{normal / norm, model.values[3] / norm}.oriented(options.up);
  out.inliers.assign(inliers.indices.begin(), inliers.indices.end());
  std::sort(out.inliers.begin(), out.inliers.end());
  out.status = Status::kOk;
  return out;
}

}  // namespace camber
