// Derivatives of the joint problem's terms against numeric ones, on the manifolds of poses and
// planes; values by hand.

#include <ceres/ceres.h>
#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <cmath>
#include <memory>
#include <vector>

#include "camber/core/random.h"
#include "camber/geometry/se3.h"
#include "camber/vehicle/paper/cost_functions/base_point.h"
#include "camber/vehicle/paper/cost_functions/form_regularisers.h"
#include "camber/vehicle/paper/cost_functions/ground_constraint.h"
#include "camber/vehicle/paper/cost_functions/keypoint_reprojection.h"
#include "camber/vehicle/paper/cost_functions/normal_alignment.h"
#include "camber/vehicle/paper/cost_functions/normal_disambiguation.h"
#include "camber/vehicle/paper/cost_functions/plane_consistency.h"
#include "camber/vehicle/paper/cost_functions/plane_regulariser.h"
#include "camber/vehicle/shape_prior.h"

namespace camber::paper {
namespace {

// Extrapolated differences are good to about 1e-9 of the derivative; 1e-6 leaves room for their
// worst cases.
constexpr double kRelative = 1e-6;
constexpr int kTrials = 20;

ceres::NumericDiffOptions small_steps() {
  ceres::NumericDiffOptions options;
  options.ridders_relative_initial_step_size = 1e-4;
  return options;
}

struct Values {
  SE3 pose, other_pose;
  Eigen::VectorXd form;
  Eigen::Vector4d plane, other_plane;
};

/// A car 8 to 40 m ahead on a road of any slope, tilted by a few degrees against its plane.
Values draw(std::uint64_t index, int num_coefficients) {
  const CounterRandom random(17, index);
  std::uint64_t counter = 0;
  auto normal = [&](double sigma) { return sigma * random.normal(counter++); };
  auto pose = [&] {
    const double yaw = normal(2.0);
    const Eigen::Vector3d tilt(normal(0.15), 0.0, normal(0.15));
    const double depth = 8.0 + 32.0 * random.uniform(counter++);
    return SE3(Eigen::Quaterniond(rotation_from_rotation_y(yaw)) * rotation_from_vector(tilt),
               Eigen::Vector3d(normal(3.0), 1.6 + normal(0.5), depth));
  };
  auto plane = [&] {
    Eigen::Vector4d out;  // the paper's convention: n down
    out << Eigen::Vector3d(normal(0.15), 1.0, normal(0.15)).normalized(), 1.6 + normal(0.3);
    return out;
  };
  Values out;
  out.pose = pose();
  out.other_pose = pose();
  out.plane = plane();
  out.other_plane = plane();
  out.form.resize(3 + num_coefficients);
  out.form.head<3>() << 4.2 + normal(0.3), 1.75 + normal(0.1), 1.5 + normal(0.1);
  for (int k = 0; k < num_coefficients; ++k) out.form[3 + k] = normal(1.0);
  return out;
}

void check(const ceres::CostFunction& cost, const std::vector<const ceres::Manifold*>& manifolds,
           const std::vector<const double*>& parameters) {
  ceres::GradientChecker checker(&cost, &manifolds, small_steps());
  ceres::GradientChecker::ProbeResults results;
  checker.Probe(parameters.data(), kRelative, &results);
  ASSERT_TRUE(results.return_value);
  ASSERT_EQ(results.local_jacobians.size(), parameters.size());
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    const auto &a = results.local_jacobians[i], &n = results.local_numeric_jacobians[i];
    // Beside derivatives that are zero the numeric ones are rounding noise.
    const double least = 1e-9 * (1.0 + n.cwiseAbs().maxCoeff());
    for (Eigen::Index k = 0; k < a.size(); ++k) {
      EXPECT_NEAR(a.data()[k], n.data()[k], kRelative * std::abs(n.data()[k]) + least)
          << "block " << i << ", entry " << k;
    }
  }
}

const PoseManifold kPose;
const PlaneManifold kPlane;
const PinholeCamera kCamera{1242, 375, 721.5377, 721.5377, 609.5593, 172.854};

KeypointReprojection keypoint(int row, int num_coefficients) {
  const ShapePrior& prior = shipped_vehicle_prior().shape("car");
  KeypointReprojection out;
  out.camera = kCamera;
  out.point.mean = prior.mean.col(row);
  out.point.basis.resize(3, num_coefficients);
  for (int k = 0; k < num_coefficients; ++k) out.point.basis.col(k) = prior.basis[k].col(row);
  out.pixel = {600.0, 180.0};
  out.sigma = {1.5, 0.8};
  return out;
}

TEST(KeypointReprojection, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 5);
    for (const bool analytic : {true, false}) {
      const KeypointReprojection term = keypoint(i % kNumSideKeypoints, 5);
      const std::unique_ptr<ceres::CostFunction> cost(
          analytic ? KeypointReprojection::create(term)
                   : KeypointReprojection::create_automatic<5>(term));
      check(*cost, {&kPose, nullptr}, {v.pose.data(), v.form.data()});
    }
  }
}

TEST(KeypointReprojection, AnalyticAndAutomaticAreTheSame) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 5);
    const KeypointReprojection term = keypoint(i % kNumSideKeypoints, 5);
    const std::unique_ptr<ceres::CostFunction> a(KeypointReprojection::create(term));
    const std::unique_ptr<ceres::CostFunction> b(KeypointReprojection::create_automatic<5>(term));
    const double* parameters[] = {v.pose.data(), v.form.data()};
    double ra[2], rb[2], pose_a[14], pose_b[14], form_a[16], form_b[16];
    double *ja[] = {pose_a, form_a}, *jb[] = {pose_b, form_b};
    ASSERT_TRUE(a->Evaluate(parameters, ra, ja));
    ASSERT_TRUE(b->Evaluate(parameters, rb, jb));
    for (int k = 0; k < 2; ++k) EXPECT_NEAR(ra[k], rb[k], 1e-9 * (1.0 + std::abs(rb[k])));
    for (int k = 0; k < 14; ++k)
      EXPECT_NEAR(pose_a[k], pose_b[k], 1e-9 * (1 + std::abs(pose_b[k])));
    for (int k = 0; k < 16; ++k)
      EXPECT_NEAR(form_a[k], form_b[k], 1e-9 * (1 + std::abs(form_b[k])));
  }
}

TEST(KeypointReprojection, IsTheDistanceInTheImageInStandardDeviations) {
  KeypointReprojection term = keypoint(0, 0);
  term.point.mean = {0.5, 1.0, -0.5};
  const SE3 pose(rotation_from_rotation_y(0.0), Eigen::Vector3d(0.0, 1.5, 10.0));
  const double form[] = {4.0, 2.0, 1.5};
  // Front (x 2 m right in the image), top, left side: the vehicle heads right, its left is far.
  const Eigen::Vector2d exact = *kCamera.project({2.0, 0.0, 11.0});
  term.pixel = exact - Eigen::Vector2d(3.0, -1.6);
  const std::unique_ptr<ceres::CostFunction> cost(KeypointReprojection::create(term));
  const double* parameters[] = {pose.data(), form};
  double r[2];
  ASSERT_TRUE(cost->Evaluate(parameters, r, nullptr));
  EXPECT_NEAR(r[0], 2.0, 1e-9);   // 3 px over 1.5
  EXPECT_NEAR(r[1], -2.0, 1e-9);  // 1.6 px over 0.8
}

TEST(KeypointReprojection, RefusesPointsBehindTheCamera) {
  const SE3 pose(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, -10));
  const double form[] = {4.0, 2.0, 1.5};
  const double* parameters[] = {pose.data(), form};
  double r[2];
  for (const bool analytic : {true, false}) {
    const std::unique_ptr<ceres::CostFunction> cost(
        analytic ? KeypointReprojection::create(keypoint(0, 0))
                 : KeypointReprojection::create_automatic<0>(keypoint(0, 0)));
    EXPECT_FALSE(cost->Evaluate(parameters, r, nullptr));
  }
}

WireframePoint wireframe(int row, int num_coefficients) {
  return keypoint(row, num_coefficients).point;
}

WheelLine wheels(int num_coefficients) {
  return {wireframe(0, num_coefficients), wireframe(1, num_coefficients)};
}

/// Derivatives of a term of pose, form and plane for several numbers of coefficients.
template <class Make>
void check_with_forms(const Make& make) {
  for (const int count : {0, 5, 20}) {
    for (int i = 0; i < kTrials; ++i) {
      const Values v = draw(i, count);
      const std::unique_ptr<ceres::CostFunction> cost(make(count));
      check(*cost, {&kPose, nullptr, &kPlane}, {v.pose.data(), v.form.data(), v.plane.data()});
    }
  }
}

TEST(PaperPlane, ConvertsToNormalsDownAndBack) {
  const Plane plane{Eigen::Vector3d(0.1, -1.0, -0.2).normalized(), 1.65};
  const Eigen::Vector4d block = to_paper(plane);
  EXPECT_GT(block[1], 0.0);
  const Eigen::Vector3d x(2.0, 1.4, 12.0);
  EXPECT_NEAR(block.head<3>().dot(x) - block[3], -plane.signed_distance(x), 1e-12);
  EXPECT_NEAR(height_above<double>(block.data(), x), plane.signed_distance(x), 1e-12);
  EXPECT_EQ(from_paper(block).normal, plane.normal);
  EXPECT_EQ(from_paper(block).offset, plane.offset);
}

TEST(WheelNormal, IsThatOfTheLeastSquaresPlaneOfTheFourWheelCentres) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 5);
    Eigen::Matrix<double, 3, 4> centres;
    for (int k = 0; k < 4; ++k) {
      centres.col(k) = in_vehicle<5>(v.form.data(), wireframe(k % 2, 5));
      if (k >= 2) centres(2, k) *= -1.0;  // the right ones
    }
    const Eigen::Matrix<double, 3, 4> off = centres.colwise() - centres.rowwise().mean();
    const Eigen::JacobiSVD<Eigen::Matrix<double, 3, 4>> svd(off, Eigen::ComputeFullU);
    Eigen::Vector3d fitted = svd.matrixU().col(2);
    if (fitted.y() > 0.0) fitted = -fitted;
    EXPECT_LT((wheel_normal<5>(v.form.data(), wheels(5)) - fitted).norm(), 1e-9);
  }
}

TEST(GroundConstraint, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 0);
    const std::unique_ptr<ceres::CostFunction> cost(GroundConstraint::create(0.02));
    check(*cost, {&kPose, &kPlane}, {v.pose.data(), v.plane.data()});
  }
  check_with_forms([](int count) { return create_printed_ground_constraint(wheels(count), 0.02); });
}

TEST(GroundConstraint, IsTheDepthOfTheBottomBelowThePlane) {
  const std::unique_ptr<ceres::CostFunction> cost(GroundConstraint::create(0.1));
  const SE3 pose(rotation_from_rotation_y(1.0), Eigen::Vector3d(2.0, 1.35, 12.0));
  const Eigen::Vector4d plane(0.0, 1.0, 0.0, 1.65);
  const double* parameters[] = {pose.data(), plane.data()};
  double r = 0.0;
  ASSERT_TRUE(cost->Evaluate(parameters, &r, nullptr));
  EXPECT_NEAR(r, -3.0, 1e-9);  // 0.3 m above it
}

TEST(GroundConstraint, AsPrintedMovesAVehicleThatLeansAgainstItsGround) {
  WheelLine level = wheels(0);
  level.front.mean.y() = level.rear.mean.y();  // n_c is the vehicle's own down
  const std::unique_ptr<ceres::CostFunction> cost(create_printed_ground_constraint(level, 1.0));
  const double form[] = {4.2, 1.75, 1.5};
  const Eigen::Vector4d plane(0.0, 1.0, 0.0, 1.65);
  const auto residual = [&](double tilt) {
    const SE3 pose(rotation_from_vector({tilt, 0.0, 0.0}) *
                       Eigen::Quaterniond(rotation_from_rotation_y(-1.57079632679)),
                   Eigen::Vector3d(0.0, 1.65, 20.0));
    const double* parameters[] = {pose.data(), form, plane.data()};
    double r = 0.0;
    EXPECT_TRUE(cost->Evaluate(parameters, &r, nullptr));
    return r;
  };
  EXPECT_NEAR(residual(0.0), 0.0, 1e-9);
  EXPECT_NEAR(std::abs(residual(0.01)), 20.0 * 0.01, 1e-3);  // on its plane, and 0.2 m off
}

TEST(NormalAlignment, DerivativesAgreeWithNumericOnes) {
  check_with_forms([](int count) { return create_normal_alignment(wheels(count), 0.01); });
}

TEST(NormalDisambiguation, DerivativesAgreeWithNumericOnes) {
  for (const bool printed : {false, true}) {
    check_with_forms(
        [&](int count) { return create_normal_disambiguation(wheels(count), 0.05, printed); });
  }
}

TEST(NormalDisambiguation, OnlyTheMeantOneTellsARoofFromWheels) {
  const double form[] = {4.2, 1.75, 1.5};
  const Eigen::Vector4d plane(0.0, 1.0, 0.0, 1.65);
  const auto residual = [&](bool printed, double roll) {
    const std::unique_ptr<ceres::CostFunction> cost(
        create_normal_disambiguation(wheels(0), 1.0, printed));
    const SE3 pose(rotation_from_vector({0.0, 0.0, roll}) *
                       Eigen::Quaterniond(rotation_from_rotation_y(-1.57079632679)),
                   Eigen::Vector3d(0.0, 1.65, 12.0));
    const double* parameters[] = {pose.data(), form, plane.data()};
    double r = 0.0;
    return cost->Evaluate(parameters, &r, nullptr) ? r : std::nan("");
  };
  constexpr double kPi = 3.14159265358979323846;
  EXPECT_EQ(residual(false, 0.0), 0.0);
  EXPECT_EQ(residual(false, 0.3), 0.0);
  EXPECT_NEAR(residual(false, kPi), 1.7, 1e-4);
  EXPECT_NEAR(residual(true, 0.0), residual(true, kPi), 1e-9);
  EXPECT_GT(residual(true, 0.4), 0.1);
  EXPECT_TRUE(std::isnan(residual(true, 0.5 * kPi)));  // a pole
}

TEST(BasePoint, DerivativesAgreeWithNumericOnes) {
  check_with_forms([](int count) { return create_base_point(wireframe(17, count), 0.05); });
  for (const int count : {0, 5, 20}) {
    for (int i = 0; i < kTrials; ++i) {
      const Values v = draw(i, count);
      const std::unique_ptr<ceres::CostFunction> cost(
          create_printed_base_point(wireframe(17, count), wheels(count), 0.05));
      check(*cost, {nullptr}, {v.form.data()});
    }
  }
}

TEST(BasePoint, ComparesItsHeightWithThatInTheVehicle) {
  const Values v = draw(3, 0);
  const double* parameters[] = {v.pose.data(), v.form.data(), v.plane.data()};
  double meant = 0.0, printed = 0.0;
  const std::unique_ptr<ceres::CostFunction> a(create_base_point(wireframe(10, 0), 1.0));
  ASSERT_TRUE(a->Evaluate(parameters, &meant, nullptr));
  const Eigen::Vector3d point = in_vehicle<0>(v.form.data(), wireframe(10, 0));
  const double height = from_paper(v.plane).signed_distance(v.pose * point);
  EXPECT_NEAR(meant, point.y() - height, 1e-12);
  // As printed: below the plane of the wheel centres, whatever the ground.
  const std::unique_ptr<ceres::CostFunction> b(
      create_printed_base_point(wireframe(10, 0), wheels(0), 1.0));
  const double* form[] = {v.form.data()};
  ASSERT_TRUE(b->Evaluate(form, &printed, nullptr));
  const Eigen::Vector3d off = point - in_vehicle<0>(v.form.data(), wireframe(0, 0));
  EXPECT_NEAR(printed, wheel_normal<0>(v.form.data(), wheels(0)).dot(off), 1e-12);
}

TEST(VehiclePlaneConsistency, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 0);
    const std::unique_ptr<ceres::CostFunction> cost(VehiclePlaneConsistency::create(0.05, 0.2));
    check(*cost, {&kPlane, &kPlane}, {v.plane.data(), v.other_plane.data()});
  }
}

TEST(PlaneContinuity, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 0);
    const std::unique_ptr<ceres::CostFunction> cost(PlaneContinuity::create(0.1));
    check(*cost, {&kPose, &kPose, &kPlane, &kPlane},
          {v.pose.data(), v.other_pose.data(), v.plane.data(), v.other_plane.data()});
  }
}

// Tangent planes of a circle meet midway between their feet: continuity holds where equal normals
// and offsets do not.
TEST(PlaneContinuity, HoldsOnACurvedRoad) {
  constexpr double kRadius = 60.0;
  const auto at = [&](double z) {
    const double slope = z / kRadius;
    const Eigen::Vector3d up(0.0, -std::cos(slope), -std::sin(slope));
    const Eigen::Vector3d foot(0.0, 1.6 - kRadius * (1.0 - std::cos(slope)),
                               kRadius * std::sin(slope));
    return std::make_pair(SE3(Eigen::Quaterniond::Identity(), foot),
                          to_paper(Plane::through(foot, up)));
  };
  const auto [pose1, plane1] = at(10.0);
  const auto [pose2, plane2] = at(22.0);
  double gap = 1.0, difference[4];
  const std::unique_ptr<ceres::CostFunction> continuity(PlaneContinuity::create(1.0));
  const double* four[] = {pose1.data(), pose2.data(), plane1.data(), plane2.data()};
  ASSERT_TRUE(continuity->Evaluate(four, &gap, nullptr));
  EXPECT_NEAR(gap, 0.0, 1e-9);
  const std::unique_ptr<ceres::CostFunction> consistency(VehiclePlaneConsistency::create(1.0, 1.0));
  const double* two[] = {plane1.data(), plane2.data()};
  ASSERT_TRUE(consistency->Evaluate(two, difference, nullptr));
  EXPECT_GT(std::abs(difference[2]), 0.15);  // 12 m of a radius of 60 m
  EXPECT_GT(std::abs(difference[3]), 0.5);
}

TEST(PlaneRegulariser, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 0);
    UncertainPlane known;
    known.plane = from_paper(v.other_plane);
    known.centroid = known.plane.foot({1.0, 1.5, 15.0});
    UncertainPlane::make_axes(known.plane.normal, {0, 0, 1}, &known.axis1, &known.axis2);
    known.covariance << 4e-4, 1e-5, 2e-5, 1e-5, 3e-4, -3e-5, 2e-5, -3e-5, 1e-3;
    const std::unique_ptr<ceres::CostFunction> cost(PlaneRegulariser::create(known));
    check(*cost, {&kPlane}, {v.plane.data()});
  }
}

TEST(PlaneRegulariser, IsTheMahalanobisDistance) {
  UncertainPlane known;
  known.plane = {{0.0, -1.0, 0.0}, 1.6};
  known.centroid = {2.0, 1.6, 15.0};
  UncertainPlane::make_axes(known.plane.normal, {0, 0, 1}, &known.axis1, &known.axis2);
  known.covariance << 4e-4, 1e-5, 2e-5, 1e-5, 3e-4, -3e-5, 2e-5, -3e-5, 1e-3;
  const Eigen::Vector3d change(0.002, -0.001, 0.03);  // small: the tilts are linear to 1e-6
  const Eigen::Vector4d plane = to_paper(known.perturbed(change));
  const std::unique_ptr<ceres::CostFunction> cost(PlaneRegulariser::create(known));
  const double* parameters[] = {plane.data()};
  Eigen::Vector3d r;
  ASSERT_TRUE(cost->Evaluate(parameters, r.data(), nullptr));
  const double expected = change.dot(known.covariance.inverse() * change);
  EXPECT_NEAR(r.squaredNorm(), expected, 1e-3 * expected);
}

TEST(FormRegularisers, DerivativesAgreeWithNumericOnes) {
  const ShapePrior& prior = shipped_vehicle_prior().shape("car");
  const Eigen::Vector3d mean = prior.parameters_mean.head<3>(), sigma(0.3, 0.06, 0.05);
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 5);
    const std::unique_ptr<ceres::CostFunction> dimensions(
        DimensionRegulariser::create(mean, sigma, 5));
    const std::unique_ptr<ceres::CostFunction> shape(ShapeRegulariser::create(5, 0.7));
    check(*dimensions, {nullptr}, {v.form.data()});
    check(*shape, {nullptr}, {v.form.data()});
    Eigen::Vector3d r;
    const double* parameters[] = {v.form.data()};
    ASSERT_TRUE(dimensions->Evaluate(parameters, r.data(), nullptr));
    EXPECT_LT((r - (v.form.head<3>() - mean).cwiseQuotient(sigma)).norm(), 1e-12);
  }
}

}  // namespace
}  // namespace camber::paper
