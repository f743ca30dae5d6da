#include "camber/plane/fit_plane_pcl.h"

#include <fmt/format.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/msac.h>
#include <pcl/sample_consensus/sac_model_perpendicular_plane.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>

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

constexpr double kFloatRounding = 1.2e-7;  // of a coordinate
constexpr double kOnALine = 1e-8;          // variance across a line's points, of that along it

/// Sums of points' squares about their middle, m^2, along the axes of which they are largest.
struct PointScatter {
  Vector3d mean = Vector3d::Zero(), along = Vector3d::UnitX();
  double thin = 0.0, wide = 0.0;
  double size = 0.0;  ///< m, of the coordinates
};

PointScatter scatter_of(const pcl::PointCloud<pcl::PointXYZ>& cloud, const pcl::Indices& rows) {
  PointScatter out;
  const auto point = [&](int i) -> Vector3d {
    return cloud[static_cast<std::size_t>(i)].getVector3fMap().cast<double>();
  };
  for (const int i : rows) {
    out.mean += point(i) / static_cast<double>(rows.size());
    out.size = std::max(out.size, point(i).cwiseAbs().maxCoeff());
  }
  Matrix3d sum = Matrix3d::Zero();
  for (const int i : rows) sum += (point(i) - out.mean) * (point(i) - out.mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(sum);
  out.along = solver.eigenvectors().col(2);
  out.thin = solver.eigenvalues()[1];
  out.wide = solver.eigenvalues()[2];
  return out;
}

/// At how many places points lie; not beyond `most`.
std::size_t count_places(const pcl::PointCloud<pcl::PointXYZ>& cloud, const pcl::Indices& rows,
                         std::size_t most) {
  std::set<std::array<float, 3>> places;
  for (std::size_t k = 0; k < rows.size() && places.size() < most; ++k) {
    const pcl::PointXYZ& p = cloud[static_cast<std::size_t>(rows[k])];
    places.insert({p.x, p.y, p.z});
  }
  return places.size();
}

/// Why no three of the points span any plane, if so.
std::optional<std::string> why_no_plane(const pcl::PointCloud<pcl::PointXYZ>& cloud) {
  pcl::Indices all(cloud.size());
  std::iota(all.begin(), all.end(), 0);
  if (count_places(cloud, all, 2) < 2) return "all points lie at one place";
  const PointScatter scatter = scatter_of(cloud, all);
  if (!(scatter.thin > kOnALine * scatter.wide)) return "the points lie on a line";
  return std::nullopt;
}

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
  const auto no_plane = [&] {
    const std::optional<std::string> degenerate = why_no_plane(*input);
    return fail(degenerate ? *degenerate
                           : fmt::format("no plane within {:.3g} rad of the up direction",
                                         options.max_tilt));
  };
  if (!consensus.computeModel()) return no_plane();
  pcl::Indices inliers;
  consensus.getInliers(inliers);
  Eigen::VectorXf first, coefficients;
  consensus.getModelCoefficients(first);
  model->optimizeModelCoefficients(inliers, first, coefficients);
  model->selectWithinDistance(coefficients, threshold, inliers);
  if (coefficients.size() != 4 || inliers.size() < 3) return no_plane();
  fit.hypotheses = consensus.iterations_;
  Plane plane{{coefficients[0], coefficients[1], coefficients[2]}, coefficients[3]};
  const double norm = plane.normal.norm();
  plane.normal /= norm;
  plane.offset /= norm;
  plane = plane.oriented(up);

  // Least squares over the inliers, for the covariance.
  const PointScatter scatter = scatter_of(*input, inliers);
  const Vector3d& mean = scatter.mean;
  const double count = static_cast<double>(inliers.size());
  double squares = 0.0;
  for (const int i : inliers) {
    const Vector3d p = input->points[static_cast<std::size_t>(i)].getVector3fMap().cast<double>();
    squares += std::pow(plane.normal.dot(p) + plane.offset, 2);
    fit.inliers.push_back(index[static_cast<std::size_t>(i)]);
  }
  UncertainPlane& out = fit.plane;
  out.centroid = plane.foot(mean) + cloud.origin;
  out.plane = Plane::through(out.centroid, plane.normal);
  UncertainPlane::make_axes(plane.normal, scatter.along, &out.axis1, &out.axis2);
  fit.num_inliers = fit.inliers.size();
  fit.rmse = std::sqrt(squares / count);
  fit.noise = noise_about(*input, plane.foot(mean), plane.normal, threshold);
  const double wide = scatter.wide, thin = scatter.thin;
  fit.condition = wide / std::max(thin, 1e-300);
  const double variance =
      std::max(squares / std::max(count - 3.0, 1.0), std::pow(kFloatRounding * scatter.size, 2));
  const std::size_t places = count_places(*input, inliers, kFewPlaces);
  // A turn about axis1 raises what lies along axis2, and the other way round.
  out.covariance = Vector3d(variance / std::max(thin, 1e-300), variance / std::max(wide, 1e-300),
                            variance / count)
                       .asDiagonal();
  if (places < kFewPlaces) {
    // Too few residuals to measure their spread.
    out.covariance = Vector3d(1.0, 1.0, std::max(variance, wide / count)).asDiagonal();
    if (places <= 3) fit.noise = std::numeric_limits<double>::quiet_NaN();
    fit.status = Status::kWeak;
    fit.reason = fmt::format("only {} points lie on the plane", places);
  }
  if (!(thin > kOnALine * wide)) {
    fit.status = Status::kNotObservable;
    fit.reason = "the points lie on a line";
  } else if (fit.status == Status::kNotRun) {
    fit.status = Status::kOk;
  }
  return fit;
}

}  // namespace camber
