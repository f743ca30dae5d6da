#pragma once

// The vehicle's body: points that are linear in the shape coefficients, and where an image has
// them.

#include <Eigen/Core>
#include <array>

#include "camber/geometry/pinhole_camera.h"
#include "camber/vehicle/shape_prior.h"

namespace camber::internal {

constexpr int kMaxCoefficients = 20;
constexpr int kPoseParameters = 6;  // translation in the camera, rotation in the vehicle's frame
constexpr int kSizeParameters = 3;  // length, width, height
constexpr int kNumExtraPoints = 10;
constexpr int kNumBodyPoints = kNumKeypoints + kNumExtraPoints;

/// Where a vehicle is in one view.
struct ViewPose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();  ///< camera_from_vehicle
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();   ///< bottom centre, m

  /// Moved by (translation, rotation vector in the vehicle's frame).
  ViewPose moved(const Eigen::Matrix<double, kPoseParameters, 1>& step) const;
};

/// Size and shape of a vehicle.
struct Form {
  Eigen::Vector3d size = Eigen::Vector3d::Ones();  ///< length, width, height, m
  Eigen::VectorXd shape;                           ///< coefficients of the prior
  Eigen::Vector3d along_axes() const { return {size[0], size[2], size[1]}; }  ///< x, y, z
};

/// Points as shares of the box: the keypoints, then what else makes the outline.
class Body {
 public:
  /// @param car_like  false: the vehicle fills its box (trucks, buses).
  Body(const ShapePrior& prior, int num_coefficients, bool car_like);

  int num_coefficients() const { return static_cast<int>(basis_.rows()); }
  /// Of a view: pose, size, coefficients.
  int num_parameters() const { return kPoseParameters + kSizeParameters + num_coefficients(); }
  Eigen::Vector3d mean(int point) const { return mean_.col(point); }  ///< x / l, y / h, z / w
  Eigen::Matrix3Xd basis(int point) const;                            ///< 3 x K, same unit

 private:
  friend class BodyView;
  Eigen::Matrix3Xd mean_;  // a column a point
  Eigen::MatrixXd basis_;  // K x 3 for each point, side by side
};

/// The body in one view at one state.
class BodyView {
 public:
  BodyView(const Body& body, const PinholeCamera& camera, const ViewPose& pose, const Form& form);

  const ViewPose& pose() const { return pose_; }
  const Form& form() const { return form_; }
  int num_parameters() const { return body_.num_parameters(); }
  int num_coefficients() const { return body_.num_coefficients(); }
  /// Whether all points, or one, are in front of the camera; pixels are of such only.
  bool in_front() const { return in_front_; }
  bool in_front(int point) const {
    return camera_points_[static_cast<std::size_t>(point)].z() > kNearest;
  }
  const Eigen::Vector3d& in_vehicle(int point) const {
    return vehicle_points_[static_cast<std::size_t>(point)];
  }
  const Eigen::Vector2d& pixel(int point) const { return pixels_[static_cast<std::size_t>(point)]; }
  /// d pixel / d(translation, rotation, size, coefficients): num_parameters() numbers for u and for
  /// v. The point must be in front of the camera.
  void jacobian(int point, double* du, double* dv) const;
  /// The part of it by the coefficients alone.
  void shape_jacobian(int point, double* du, double* dv) const;

 private:
  static constexpr double kNearest = 0.3;  // m
  void write_shape_part(int point, const Eigen::Matrix<double, 2, 3>& turned, double* du,
                        double* dv) const;

  const Body& body_;
  const PinholeCamera& camera_;
  const ViewPose& pose_;
  const Form& form_;
  Eigen::Vector3d size_;  // along x, y, z
  std::array<Eigen::Vector3d, kNumBodyPoints> shares_, vehicle_points_, camera_points_;
  std::array<Eigen::Vector2d, kNumBodyPoints> pixels_;
  bool in_front_ = true;
};

}  // namespace camber::internal
