// Poses in metres: what road and motion share, and what windows of one camera share.

#include "camber/scale/metric_poses.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <memory>
#include <stdexcept>

#include "camber/scale/camera_height_constraint.h"
#include "camber/scale/known_poses_constraint.h"

namespace camber {
namespace {

const PinholeCamera kCamera{640, 240, 400.0, 400.0, 320.0, 100.0};
constexpr double kHeight = 1.65, kOpen = 1.0;
constexpr std::size_t kReference = 1;

/// Two baselines, of which the last is the longest.
MotionEstimate made_motion() {
  MotionEstimate out;
  out.frame_from_reference = {SE3(rotation_from_vector({0.01, -0.02, 0.0}), {0.02, 0.0, 0.6}),
                              SE3(),
                              SE3(rotation_from_vector({0.0, 0.03, 0.01}), {0.0, 0.1, -1.0})};
  Eigen::VectorXd sigma(12);
  sigma << 1e-3, 1e-3, 2e-3, 0.01, 0.01, 0.02, 1e-3, 2e-3, 1e-3, 0.01, 0.02, 0.01;
  Eigen::MatrixXd mixing = Eigen::MatrixXd::Identity(12, 12);
  for (Eigen::Index i = 1; i < 12; ++i) mixing(i, i - 1) = 0.4;
  out.covariance = sigma.asDiagonal() * mixing * mixing.transpose() * sigma.asDiagonal();
  return out;
}

/// Of the ego plane by the motion.
Eigen::Matrix<double, 3, Eigen::Dynamic> ego_by_motion() {
  Eigen::Matrix<double, 3, Eigen::Dynamic> out(3, 12);
  for (Eigen::Index i = 0; i < 12; ++i) {
    const auto k = static_cast<double>(i);
    out.col(i) << 0.1 * std::sin(k), 0.2 * std::cos(k), kHeight * std::sin(0.7 * k);
  }
  return out;
}

const Eigen::Vector3d kOwnEgoSigma(2e-3, 2e-3, 0.004 * kHeight);

/// A level road whose depths and whose plane under the camera hang on the motion.
RoadPosterior made_road(const MotionEstimate& motion) {
  GroundObservations observations;
  for (int v = 110; v < kCamera.height; v += 3) {
    for (int u = 0; u < kCamera.width; u += 8) {
      observations.pixels.emplace_back(u, v);
      observations.inverse_depth.push_back((v - kCamera.cy) / kCamera.fy / kHeight);
      observations.sigma.push_back(0.002);
    }
  }
  const auto count = static_cast<Eigen::Index>(observations.pixels.size());
  observations.shared_jacobian.resize(count, 12);
  for (Eigen::Index i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    for (Eigen::Index c = 0; c < 12; ++c) {
      observations.shared_jacobian(i, c) = static_cast<float>(
          observations.inverse_depth[at] * std::sin(0.7 * static_cast<double>(c)) *
          (1.0 + 1e-3 * observations.pixels[at].x()));
    }
  }
  EgoPlaneEstimate ego;
  ego.plane.plane = {{0.0, -1.0, 0.0}, kHeight};
  ego.plane.centroid = {0.0, kHeight, 0.0};
  UncertainPlane::make_axes({0, -1, 0}, {0, 0, 1}, &ego.plane.axis1, &ego.plane.axis2);
  ego.shared_jacobian = ego_by_motion();
  ego.plane.covariance = kOwnEgoSigma.cwiseAbs2().asDiagonal();
  ego.plane.covariance += ego.shared_jacobian * motion.covariance * ego.shared_jacobian.transpose();
  return {std::make_shared<GroundField>(kCamera, observations, Plane{{0, -1, 0}, kHeight},
                                        GroundFieldOptions()),
          motion.covariance,
          4.0,
          ego,
          1.0,
          kOpen};
}

/// What two estimates of the same poses differ by, in the rows of MetricPoses.
Eigen::VectorXd difference(const MetricPoses& a, const MetricPoses& b) {
  Eigen::VectorXd out(a.own.rows());
  Eigen::Index row = 0;
  for (std::size_t k = 0; k < a.frame_from_reference.size(); ++k) {
    if (k == kReference) continue;
    const SE3 &x = a.frame_from_reference[k], &y = b.frame_from_reference[k];
    out.segment<3>(row) = rotation_to_vector(x.rotation() * y.rotation().inverse());
    out.segment<3>(row + 3) = x.translation() - y.translation();
    row += 6;
  }
  out[row] = a.log_scale - b.log_scale;
  return out;
}

TEST(MetricPoses, AHeightJoinsScaleAndMotionAsTheRoadUnderTheCameraHangsOnIt) {
  const MotionEstimate motion = made_motion();
  const RoadPosterior road = made_road(motion);
  constexpr double kSigma = 0.02;
  const MetricPoses poses =
      metric_poses(motion, kReference,
                   road.conditioned(camera_height_constraint(road, kHeight, kSigma)), {}, {0.0});
  // The same by hand: unknowns are the motion, the height's own error and the scale; the height is
  // measured, which falls as the plane is raised.
  Eigen::MatrixXd prior = Eigen::MatrixXd::Zero(14, 14);
  prior.topLeftCorner(12, 12) = motion.covariance;
  prior(12, 12) = std::pow(kOwnEgoSigma.z(), 2);
  prior(13, 13) = kOpen * kOpen;
  Eigen::RowVectorXd by(14);
  by << -ego_by_motion().row(2), -1.0, kHeight;
  const Eigen::VectorXd gain =
      prior * by.transpose() / ((by * prior * by.transpose())(0) + kSigma * kSigma);
  const Eigen::MatrixXd left = prior - gain * by * prior;
  Eigen::MatrixXd metric = Eigen::MatrixXd::Zero(13, 14);
  metric.topLeftCorner(12, 12).setIdentity();
  metric(12, 13) = 1.0;
  for (const auto& [row, k] : {std::pair<Eigen::Index, std::size_t>{3, 0}, {9, 2}}) {
    metric.block<3, 1>(row, 13) = motion.frame_from_reference[k].translation();
  }
  const Eigen::MatrixXd expected = metric * left * metric.transpose();
  const Eigen::VectorXd scale = expected.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd off =
      scale.asDiagonal() * (poses.covariance() - expected) * scale.asDiagonal();
  EXPECT_LT(off.cwiseAbs().maxCoeff(), 1e-6);
  ASSERT_EQ(poses.common.size(), 1u);
  EXPECT_EQ(poses.common[0].name, "camera_height");
  EXPECT_LT((poses.common[0].by - metric * gain * kSigma).norm(), 1e-9);
  // They are not independent here, and the window's own part is what remains.
  EXPECT_GT(std::abs(expected(12, 11)) * scale[12] * scale[11], 0.2);
  EXPECT_LT(poses.own(12, 12), poses.covariance()(12, 12));
}

TEST(MetricPoses, CommonErrorsAreWhatAnotherHeightWouldChange) {
  const MotionEstimate motion = made_motion();
  const RoadPosterior road = made_road(motion);
  constexpr double kSigma = 1e-3;
  const auto with_height = [&](double height) {
    RoadPosterior out = road.conditioned(camera_height_constraint(road, height, kSigma));
    // Another source, that corrects a part of what the height is off.
    Constraint scale = known_poses_constraint(road, 1.0, 2e-3);
    scale = out.relinearised(scale, road);
    return metric_poses(motion, kReference, out.conditioned(scale));
  };
  const MetricPoses poses = with_height(kHeight);
  const Eigen::VectorXd by = poses.common.at(0).by;
  const Eigen::VectorXd changed = difference(with_height(kHeight + kSigma), poses);
  EXPECT_GT(by.norm(), 1e-4);
  EXPECT_LT((changed - by).norm(), 2e-3 * by.norm());  // first order
}

TEST(MetricPoses, AFocalLengthThatIsNotKnownIsCommon) {
  const MotionEstimate motion = made_motion();
  const RoadPosterior road = made_road(motion);
  const RoadPosterior scaled = road.conditioned(camera_height_constraint(road, kHeight, 0.01));
  CameraSigma sigma;
  sigma.focal = 0.02;
  const MetricPoses poses =
      metric_poses(motion, kReference, scaled, CameraUncertainty(kCamera, sigma, 1.0));
  const MetricPoses exact = metric_poses(motion, kReference, scaled);
  EXPECT_EQ(poses.own, exact.own);
  ASSERT_EQ(poses.common.size(), 5u);
  EXPECT_EQ(poses.common[1].name, "focal_length");
  // A camera's height gives the metres: lengths along the axis are longer by the focal length's
  // error, the longest baseline is nearly along it.
  EXPECT_NEAR(poses.common[1].by[12], 0.02, 0.001);
  EXPECT_NEAR(poses.covariance()(12, 12), exact.covariance()(12, 12) + 0.0004, 2e-5);
}

TEST(MetricPoses, RejectsTheRoadOfAnotherMotion) {
  MotionEstimate motion = made_motion();
  const RoadPosterior road = made_road(motion);
  EXPECT_THROW(metric_poses(motion, 3, road), std::invalid_argument);
  motion.frame_from_reference.pop_back();
  EXPECT_THROW(metric_poses(motion, kReference, road), std::invalid_argument);
}

}  // namespace
}  // namespace camber
