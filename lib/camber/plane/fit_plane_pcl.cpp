#include "camber/plane/fit_plane_pcl.h"

#include <fmt/format.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/msac.h>
#include <pcl/sample_consensus/sac_model_perpendicular_plane.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <cstdint>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/plane/detail/quiet_pcl.h"
#include "camber/plane/plane_covariance.h"
#include "camber/plane/plane_solver.h"

namespace camber {

using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

/// Perpendicular planes whose samples are within the largest tilt, too, as msac.hpp needs them: a
/// first sample that is steeper leaves no distances, whose sum of 0 no later plane is below, and
/// later ones are not counted as trials.
class PerpendicularPlanes : public pcl::SampleConsensusModelPerpendicularPlane<pcl::PointXYZ> {
 public:
  PerpendicularPlanes(const pcl::PointCloud<pcl::PointXYZ>::ConstPtr& points, std::uint64_t seed)
      : SampleConsensusModelPerpendicularPlane(points) {
    rng_alg_.seed(static_cast<std::uint32_t>(CounterRandom(seed).bits(0)));
  }

 protected:
  bool isSampleGood(const pcl::Indices& sample) const override {
    Eigen::VectorXf coefficients;
    return computeModelCoefficients(sample, coefficients) && isModelValid(coefficients);
  }
};

/// See measured_noise(). @param normal  unit, of the plane through `middle`
double noise_about(const pcl::PointCloud<pcl::PointXYZ>& cloud, const Vector3d& middle,
                   const Vector3d& normal, double threshold) {
  PointArrays points;
  points.resize(cloud.size(), false, false);
  for (std::size_t k = 0; k < cloud.size(); ++k) {
    const Eigen::Vector3f p = (cloud[k].getVector3fMap().cast<double>() - middle).cast<float>();
    points.x[k] = p.x();
    points.y[k] = p.y();
    points.z[k] = p.z();
  }
  PivotPlane plane;
  plane.n = normal;
  NoiseModel noise;
  noise.scale = threshold / kInlierSigmas;
  points.weigh(noise, plane);
  PlaneWindow window;
  align(plane, &window);
  return measured_noise(points, plane, window);
}

}  // namespace

PlaneFit fit_plane_pcl(const RoadCloud& cloud, const PlaneFitOptions& options,
                       double default_threshold) {
  options.validate();
  const double threshold =
      options.inlier_threshold > 0.0 ? options.inlier_threshold : default_threshold;
  if (!(threshold > 0.0)) {
    throw std::invalid_argument(
        fmt::format("fit_plane_pcl: default_threshold is {}, expected > 0 m", default_threshold));
  }
  PlaneFit fit;
  const auto fail = [&](const std::string& reason) {
    fit.status = Status::kFailed;
    fit.reason = reason;
    return fit;
  };
  pcl::PointCloud<pcl::PointXYZ>::Ptr input(new pcl::PointCloud<pcl::PointXYZ>);
  std::vector<int> index;
  input->reserve(cloud.size());
  index.reserve(cloud.size());
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const Eigen::Vector3f& p = cloud.points[i];
    if (!p.allFinite()) continue;
    input->push_back(pcl::PointXYZ(p.x(), p.y(), p.z()));
    index.push_back(static_cast<int>(i));
  }
  if (index.size() < 3) {
    return fail(fmt::format("{} usable points, at least 3 are needed", index.size()));
  }
  const detail::QuietPcl quiet;
  const Vector3d up = options.up.normalized();
  const auto model = pcl::make_shared<PerpendicularPlanes>(input, options.seed);
  model->setAxis(up.cast<float>());
  model->setEpsAngle(options.max_tilt);
  pcl::MEstimatorSampleConsensus<pcl::PointXYZ> consensus(model, threshold);
  consensus.setMaxIterations(options.max_hypotheses);
  consensus.setProbability(options.confidence);
  if (!consensus.computeModel()) {
    return fail(fmt::format("no plane within {:.3g} rad of the up direction", options.max_tilt));
  }
  pcl::Indices inliers;
  consensus.getInliers(inliers);
  Eigen::VectorXf first, coefficients;
  consensus.getModelCoefficients(first);
  model->optimizeModelCoefficients(inliers, first, coefficients);
  model->selectWithinDistance(coefficients, threshold, inliers);
  if (coefficients.size() != 4 || inliers.size() < 3) {
    return fail(fmt::format("no plane within {:.3g} rad of the up direction", options.max_tilt));
  }
  fit.hypotheses = consensus.iterations_;
  Plane plane{{coefficients[0], coefficients[1], coefficients[2]}, coefficients[3]};
  const double norm = plane.normal.norm();
  plane.normal /= norm;
  plane.offset /= norm;
  plane = plane.oriented(up);

  // Least squares over the inliers, for the covariance.
  Vector3d mean = Vector3d::Zero();
  for (const int i : inliers) {
    mean += input->points[static_cast<std::size_t>(i)].getVector3fMap().cast<double>();
  }
  const double count = static_cast<double>(inliers.size());
  mean /= count;
  Matrix3d scatter = Matrix3d::Zero();
  double squares = 0.0;
  for (const int i : inliers) {
    const Vector3d offset =
        input->points[static_cast<std::size_t>(i)].getVector3fMap().cast<double>() - mean;
    scatter += offset * offset.transpose();
    const double r = plane.normal.dot(offset + mean) + plane.offset;
    squares += r * r;
    fit.inliers.push_back(index[static_cast<std::size_t>(i)]);
  }
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(scatter);
  UncertainPlane& out = fit.plane;
  out.centroid = plane.foot(mean) + cloud.origin;
  out.plane = Plane::through(out.centroid, plane.normal);
  UncertainPlane::make_axes(plane.normal, solver.eigenvectors().col(2), &out.axis1, &out.axis2);
  fit.num_inliers = fit.inliers.size();
  fit.rmse = std::sqrt(squares / count);
  fit.noise = noise_about(*input, plane.foot(mean), plane.normal, threshold);
  const double wide = solver.eigenvalues()[2], thin = solver.eigenvalues()[1];
  fit.condition = wide / std::max(thin, 1e-300);
  const double variance = squares / std::max(count - 3.0, 1.0);
  // A turn about axis1 raises what lies along axis2, and the other way round.
  out.covariance = Vector3d(variance / std::max(thin, 1e-300), variance / std::max(wide, 1e-300),
                            variance / count)
                       .asDiagonal();
  if (!(thin > 1e-8 * wide)) {
    fit.status = Status::kNotObservable;
    fit.reason = "the points lie on a line";
  } else {
    fit.status = Status::kOk;
  }
  return fit;
}

}  // namespace camber
