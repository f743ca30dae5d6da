#include "camber/scale/camera_uncertainty.h"

#include <gtest/gtest.h>

#include <cmath>

namespace camber {
namespace {

const PinholeCamera kCamera{1200, 400, 700.0, 700.0, 599.5, 180.0};

/// The world as a camera that moves without turning shows it through another camera: the same
/// pixels, and the same lengths where the scale is measured.
Eigen::Vector3d seen_through(const Eigen::Vector3d& p, const PinholeCamera& truth,
                             const PinholeCamera& used, double scale) {
  const Eigen::Vector3d pixel = truth.matrix() * p;
  return scale * used.matrix().inverse() * pixel;
}

PinholeCamera with_focal(double factor) {
  PinholeCamera out = kCamera;
  out.fx *= factor;
  out.fy *= factor;
  return out;
}

TEST(CameraUncertainty, OfAnExactCameraIsNone) {
  const CameraUncertainty camera(kCamera, {}, 1.0);
  EXPECT_TRUE(camera.exact());
  EXPECT_EQ(camera.position_covariance({1, 2, 20}).norm(), 0.0);
  EXPECT_EQ(camera.log_length_variance({0, 0, 1}), 0.0);
}

TEST(CameraUncertainty, MovesAPointAsAnotherFocalLengthDoes) {
  const double step = 1e-5;
  const Eigen::Vector3d p(-3.0, 1.4, 25.0);
  // The height across the view is known: points stay where they are beside and below the axis.
  // Along it: the path is known, and they stay where they are ahead.
  for (const double by_focal : {1.0, 0.0}) {
    const Eigen::Vector3d moved =
        seen_through(p, kCamera, with_focal(std::exp(step)), std::exp(by_focal * step));
    const Eigen::Vector3d change = (moved - p) / step;
    const CameraUncertainty camera(kCamera, {0.04, 0.0, 0.0}, by_focal);
    const Eigen::Matrix3d expected = 0.04 * 0.04 * change * change.transpose();
    EXPECT_NEAR((camera.position_covariance(p) - expected).norm(), 0.0, 1e-4 * expected.norm());
    const double along = change.dot(p.normalized());
    EXPECT_NEAR(std::sqrt(camera.distance_variance(p)), 0.04 * std::abs(along),
                1e-4 * 0.04 * p.norm());
    EXPECT_NEAR(std::sqrt(camera.log_length_variance({0.0, 0.0, 2.0})), 0.04 * by_focal, 1e-12);
  }
}

TEST(CameraUncertainty, MovesAPointAsAnotherPrincipalPointDoes) {
  const Eigen::Vector3d p(4.0, 1.0, 30.0);
  const CameraUncertainty camera(kCamera, {0.0, 2.0, 0.0}, 1.0);
  Eigen::Matrix3d expected = Eigen::Matrix3d::Zero();
  for (const auto& [x, y] : {std::pair{2.0, 0.0}, std::pair{0.0, 2.0}}) {
    PinholeCamera other = kCamera;
    other.cx += x;
    other.cy += y;
    const Eigen::Vector3d change = seen_through(p, kCamera, other, 1.0) - p;
    expected += change * change.transpose();
  }
  EXPECT_NEAR((camera.position_covariance(p) - expected).norm(), 0.0, 1e-9);
}

TEST(CameraUncertainty, MovesAPointAsADistortionThatIsLeftInDoes) {
  const double k1 = 1e-5;
  const CameraUncertainty camera(kCamera, {0.0, 0.0, 0.1}, 0.0);  // by a length along the axis
  const Eigen::Vector3d p(6.0, 1.4, 10.0);
  const double r2 = (p.x() * p.x() + p.y() * p.y()) / (p.z() * p.z());
  // What is seen at r came from r (1 - k1 r^2), to first order.
  const Eigen::Vector3d change = Eigen::Vector3d(-r2 * p.x(), -r2 * p.y(), 0.0) * k1 / k1;
  const Eigen::Matrix3d expected = 0.01 * change * change.transpose();
  EXPECT_NEAR((camera.position_covariance(p) - expected).norm(), 0.0, 1e-12);
}

/// A grade 30 m ahead: what the camera makes of it by moving three of its points.
TEST(CameraUncertainty, TiltsAPlaneAsItsPointsMove) {
  UncertainPlane plane;
  plane.plane.normal = Eigen::Vector3d(0.02, -1.0, -0.08).normalized();
  plane.centroid = {-2.0, 1.1, 30.0};
  plane.plane = Plane::through(plane.centroid, plane.plane.normal);
  UncertainPlane::make_axes(plane.plane.normal, Eigen::Vector3d::UnitZ(), &plane.axis1,
                            &plane.axis2);
  const double step = 1e-5, sigma = 0.05;
  const PinholeCamera used = with_focal(std::exp(step));
  Eigen::Vector3d moved[3];
  const Eigen::Vector3d at[3] = {plane.centroid, plane.centroid + plane.axis1,
                                 plane.centroid + plane.axis2};
  for (int i = 0; i < 3; ++i) moved[i] = seen_through(at[i], kCamera, used, std::exp(step));
  Eigen::Vector3d normal = (moved[1] - moved[0]).cross(moved[2] - moved[0]).normalized();
  if (normal.dot(plane.plane.normal) < 0.0) normal = -normal;
  // The tilts of UncertainPlane's own parameters, and its height where the centroid was.
  const Eigen::Vector3d turn = (normal - plane.plane.normal) / step;
  const Eigen::Vector3d change(
      -turn.dot(plane.axis2), turn.dot(plane.axis1),
      -Plane::through(moved[0], normal).signed_distance(plane.centroid) / step);
  const CameraUncertainty camera(kCamera, {sigma, 0.0, 0.0}, 1.0);
  const Eigen::Matrix3d expected = sigma * sigma * change * change.transpose();
  EXPECT_NEAR((camera.plane_covariance(plane) - expected).norm(), 0.0, 1e-3 * expected.norm());
  // The grade is wrong by the focal length's share of it, the height by that of its rise.
  EXPECT_NEAR(std::sqrt(camera.plane_covariance(plane)(2, 2)), sigma * 0.08 * 30.0, 0.002);
}

}  // namespace
}  // namespace camber
