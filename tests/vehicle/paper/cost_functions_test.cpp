// Derivatives of the joint problem's terms against numeric ones, on the manifolds of poses and
// planes; values by hand.

#include <ceres/ceres.h>
#include <ceres/gradient_checker.h>
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "camber/core/random.h"
#include "camber/geometry/se3.h"
#include "camber/vehicle/paper/cost_functions/base_point.h"
#include "camber/vehicle/paper/cost_functions/form_prior.h"
#include "camber/vehicle/paper/cost_functions/ground_contact.h"
#include "camber/vehicle/paper/cost_functions/keypoint_reprojection.h"
#include "camber/vehicle/paper/cost_functions/normal_alignment.h"
#include "camber/vehicle/paper/cost_functions/normal_disambiguation.h"
#include "camber/vehicle/paper/cost_functions/plane_consistency.h"
#include "camber/vehicle/paper/cost_functions/plane_prior.h"
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
    Eigen::Vector4d out;
    out << Eigen::Vector3d(normal(0.15), -1.0, normal(0.15)).normalized(), 1.6 + normal(0.3);
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

TEST(GroundContact, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 0);
    for (const bool printed : {false, true}) {
      const std::unique_ptr<ceres::CostFunction> cost(GroundContact::create(0.02, printed));
      check(*cost, {&kPose, &kPlane}, {v.pose.data(), v.plane.data()});
    }
  }
}

TEST(GroundContact, IsTheHeightOfTheBottomAboveThePlane) {
  const std::unique_ptr<ceres::CostFunction> cost(GroundContact::create(0.1));
  const SE3 pose(rotation_from_rotation_y(1.0), Eigen::Vector3d(2.0, 1.35, 12.0));
  const Eigen::Vector4d plane(0.0, -1.0, 0.0, 1.65);
  const double* parameters[] = {pose.data(), plane.data()};
  double r = 0.0;
  ASSERT_TRUE(cost->Evaluate(parameters, &r, nullptr));
  EXPECT_NEAR(r, 3.0, 1e-9);  // 0.3 m above it
}

TEST(NormalAlignment, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 0);
    const std::unique_ptr<ceres::CostFunction> cost(NormalAlignment::create(0.01));
    check(*cost, {&kPose, &kPlane}, {v.pose.data(), v.plane.data()});
  }
}

TEST(NormalDisambiguation, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    Values v = draw(i, 0);
    for (const bool printed : {false, true}) {
      const std::unique_ptr<ceres::CostFunction> cost(
          NormalDisambiguation::create({0.0, -1.0, 0.0}, 0.1, printed));
      check(*cost, {&kPose}, {v.pose.data()});
      // Nearly on its side, where the one-sided term bites.
      const SE3 fallen(v.pose.rotation() * rotation_from_vector({1.4, 0.0, 0.0}),
                       v.pose.translation());
      check(*cost, {&kPose}, {fallen.data()});
    }
  }
}

TEST(NormalDisambiguation, TellsARoofFromWheelsUnlessAsPrinted) {
  const SE3 upright(rotation_from_rotation_y(0.3), Eigen::Vector3d(0, 1, 10));
  const SE3 on_roof(upright.rotation() * rotation_from_vector({3.14159265358979, 0.0, 0.0}),
                    upright.translation());
  for (const bool printed : {false, true}) {
    const std::unique_ptr<ceres::CostFunction> cost(
        NormalDisambiguation::create({0.0, -1.0, 0.0}, 1.0, printed));
    double up = -1.0, down = -1.0;
    const double *a[] = {upright.data()}, *b[] = {on_roof.data()};
    ASSERT_TRUE(cost->Evaluate(a, &up, nullptr));
    ASSERT_TRUE(cost->Evaluate(b, &down, nullptr));
    EXPECT_NEAR(up, 0.0, 1e-9);
    EXPECT_NEAR(down, printed ? 0.0 : 1.7, 1e-9);  // 0.7 + 1
  }
}

TEST(BasePoint, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 0);
    for (const bool printed : {false, true}) {
      const std::unique_ptr<ceres::CostFunction> cost(
          BasePoint::create({1.9, 0.3, -0.8}, 0.05, printed));
      check(*cost, {&kPose, &kPlane}, {v.pose.data(), v.plane.data()});
    }
  }
}

TEST(BasePoint, PullsToTheGroundUnlessAsPrinted) {
  const Values v = draw(3, 0);
  const double* parameters[] = {v.pose.data(), v.plane.data()};
  double mended = 0.0, printed = 1.0;
  const Eigen::Vector3d point(1.9, 0.3, -0.8);
  const std::unique_ptr<ceres::CostFunction> a(BasePoint::create(point, 1.0));
  const std::unique_ptr<ceres::CostFunction> b(BasePoint::create(point, 1.0, true));
  ASSERT_TRUE(a->Evaluate(parameters, &mended, nullptr));
  ASSERT_TRUE(b->Evaluate(parameters, &printed, nullptr));
  const Eigen::Vector3d n = v.plane.head<3>();
  EXPECT_NEAR(mended, n.dot(v.pose * point) + v.plane[3] - 0.3, 1e-12);
  EXPECT_NEAR(printed, 0.0, 1e-12);
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
    Eigen::Vector4d plane;
    plane << up, -up.dot(foot);
    return std::make_pair(SE3(Eigen::Quaterniond::Identity(), foot), plane);
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

TEST(VehiclePlanePrior, DerivativesAgreeWithNumericOnes) {
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 0);
    UncertainPlane known;
    known.plane = {v.other_plane.head<3>(), v.other_plane[3]};
    known.centroid = known.plane.foot({1.0, 1.5, 15.0});
    UncertainPlane::make_axes(known.plane.normal, {0, 0, 1}, &known.axis1, &known.axis2);
    known.covariance << 4e-4, 1e-5, 2e-5, 1e-5, 3e-4, -3e-5, 2e-5, -3e-5, 1e-3;
    const std::unique_ptr<ceres::CostFunction> cost(VehiclePlanePrior::create(known));
    check(*cost, {&kPlane}, {v.plane.data()});
  }
}

TEST(VehiclePlanePrior, IsTheMahalanobisDistance) {
  UncertainPlane known;
  known.plane = {{0.0, -1.0, 0.0}, 1.6};
  known.centroid = {2.0, 1.6, 15.0};
  UncertainPlane::make_axes(known.plane.normal, {0, 0, 1}, &known.axis1, &known.axis2);
  known.covariance << 4e-4, 1e-5, 2e-5, 1e-5, 3e-4, -3e-5, 2e-5, -3e-5, 1e-3;
  const Eigen::Vector3d change(0.002, -0.001, 0.03);  // small: the tilts are linear to 1e-6
  const Plane moved = known.perturbed(change);
  Eigen::Vector4d plane;
  plane << moved.normal, moved.offset;
  const std::unique_ptr<ceres::CostFunction> cost(VehiclePlanePrior::create(known));
  const double* parameters[] = {plane.data()};
  Eigen::Vector3d r;
  ASSERT_TRUE(cost->Evaluate(parameters, r.data(), nullptr));
  const double expected = change.dot(known.covariance.inverse() * change);
  EXPECT_NEAR(r.squaredNorm(), expected, 1e-3 * expected);
}

TEST(FormTerms, DerivativesAgreeWithNumericOnes) {
  const ShapePrior& prior = shipped_vehicle_prior().shape("car");
  const Eigen::VectorXd mean = prior.parameters_mean.head(8);
  const Eigen::MatrixXd covariance = prior.parameters_covariance.topLeftCorner(8, 8);
  for (int i = 0; i < kTrials; ++i) {
    const Values v = draw(i, 5);
    const std::unique_ptr<ceres::CostFunction> terms[] = {
        std::unique_ptr<ceres::CostFunction>(FormPrior::create(mean, covariance)),
        std::unique_ptr<ceres::CostFunction>(
            DimensionRegulariser::create({4.2, 1.75, 1.5}, {0.4, 0.1, 0.1}, 5)),
        std::unique_ptr<ceres::CostFunction>(ShapeRegulariser::create(5, 0.7))};
    for (const auto& term : terms) check(*term, {nullptr}, {v.form.data()});
    double r[8];
    const double* parameters[] = {v.form.data()};
    ASSERT_TRUE(terms[0]->Evaluate(parameters, r, nullptr));
    const Eigen::VectorXd d = v.form - mean;
    const double expected = d.dot(covariance.llt().solve(d));
    EXPECT_NEAR(Eigen::Map<Eigen::VectorXd>(r, 8).squaredNorm(), expected, 1e-6 * expected);
  }
}

}  // namespace
}  // namespace camber::paper
