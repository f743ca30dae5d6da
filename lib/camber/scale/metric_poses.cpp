#include "camber/scale/metric_poses.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace camber {
namespace {

constexpr Eigen::Index kPose = 6;

/// What the poses are off where an intrinsic is: the camera's places are points of the world.
std::vector<CommonError> by_intrinsics(const MetricPoses& poses, std::size_t reference,
                                       const CameraUncertainty& camera) {
  static const std::array<const char*, 4> kNames = {"focal_length", "principal_x", "principal_y",
                                                    "distortion"};
  std::vector<CommonError> out;
  for (const char* name : kNames) out.push_back({name, Eigen::VectorXd::Zero(poses.own.rows())});
  Eigen::Index row = 0;
  double longest = 0.0;
  for (std::size_t k = 0; k < poses.frame_from_reference.size(); ++k) {
    if (k == reference) continue;
    const SE3& pose = poses.frame_from_reference[k];
    const Eigen::Vector3d center = pose.inverse().translation();
    const Eigen::Matrix<double, 3, 4> moved = camera.displacements(center);
    const double length = center.norm();
    for (std::size_t i = 0; i < out.size(); ++i) {
      const auto column = static_cast<Eigen::Index>(i);
      out[i].by.segment<3>(row + 3) = -(pose.rotation() * moved.col(column));
      if (length > longest) {
        out[i].by[out[i].by.size() - 1] = center.dot(moved.col(column)) / (length * length);
      }
    }
    longest = std::max(longest, length);
    row += kPose;
  }
  return out;
}

}  // namespace

Eigen::MatrixXd MetricPoses::covariance() const {
  Eigen::MatrixXd out = own;
  for (const CommonError& error : common) out += error.by * error.by.transpose();
  return out;
}

MetricPoses metric_poses(const MotionEstimate& motion, std::size_t reference,
                         const RoadPosterior& road, const CameraUncertainty& camera,
                         const MetricPoseNoise& noise) {
  const std::size_t images = motion.frame_from_reference.size();
  const SharedEstimate shared = road.shared();
  if (images == 0 || reference >= images ||
      shared.change.size() != kPose * (static_cast<Eigen::Index>(images) - 1)) {
    throw std::invalid_argument("metric poses: the road's motion is another one");
  }
  MetricPoses out;
  out.log_scale = std::log(road.metres_per_baseline());
  const double m = road.metres_per_baseline();
  const Eigen::Index rows = shared.covariance.rows();
  // x = (w, m t, log m) of (w, t, log m).
  Eigen::MatrixXd by = Eigen::MatrixXd::Identity(rows, rows);
  Eigen::Index row = 0;
  for (std::size_t k = 0; k < images; ++k) {
    const SE3& pose = motion.frame_from_reference[k];
    if (k == reference) {
      out.frame_from_reference.push_back(pose);
      continue;
    }
    const SE3 moved(rotation_from_vector(shared.change.segment<3>(row)) * pose.rotation(),
                    m * (pose.translation() + shared.change.segment<3>(row + 3)));
    by.block<3, 3>(row + 3, row + 3) *= m;
    by.block<3, 1>(row + 3, rows - 1) = moved.translation();
    out.frame_from_reference.push_back(moved);
    row += kPose;
  }
  out.own = by * shared.covariance * by.transpose();
  for (const CommonError& error : shared.common) {
    out.common.push_back({error.name, by * error.by});
    out.own -= out.common.back().by * out.common.back().by.transpose();
  }
  out.own = 0.5 * (out.own + out.own.transpose()).eval();
  for (Eigen::Index i = 0; i < rows - 1; ++i) {
    if (i % kPose < 3) out.own(i, i) += noise.rotation * noise.rotation;
  }
  if (camera.exact()) return out;
  for (CommonError& error : by_intrinsics(out, reference, camera)) {
    out.common.push_back(std::move(error));
  }
  return out;
}

}  // namespace camber
