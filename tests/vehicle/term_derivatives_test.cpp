// Hand-written derivatives of the posterior's terms of one view against numeric ones, on the
// manifold of poses.

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "camber/core/random.h"
#include "camber/vehicle/detail/ground_contact.h"
#include "camber/vehicle/detail/projection.h"
#include "camber/vehicle/detail/size_shape_prior.h"
#include "camber/vehicle/detail/vehicle_answer.h"
#include "vehicle/numeric_derivative.h"
#include "vehicle/simulated_vehicle.h"

namespace camber::internal {
namespace {

using test::expect_same_derivatives;
using test::numeric_gradient;
using test::numeric_jacobian;
using test::simulate_vehicle;
using test::SimulatedVehicle;

constexpr int kTrials = 12;
// Extrapolated differences are good to about 1e-9 of a row's largest entry; what is written by hand
// is wrong by far more where it is wrong.
constexpr double kRelative = 1e-6;

struct Scene {
  SimulatedVehicle vehicle;
  ViewPose pose;
  Form form;
};

/// A simulated vehicle and a state a little off its truth.
Scene make_scene(std::uint64_t index, int num_coefficients) {
  Scene out;
  out.vehicle = simulate_vehicle({}, index);
  const CounterRandom random(23, index);
  std::uint64_t counter = 0;
  const auto normal = [&](double sigma) { return sigma * random.normal(counter++); };
  PoseVector step;
  for (int i = 0; i < 3; ++i) step[i] = normal(0.2);
  for (int i = 3; i < 6; ++i) step[i] = normal(0.03);
  const OrientedBox& truth = out.vehicle.truth;
  out.pose.rotation = truth.camera_from_vehicle.rotation_matrix();
  out.pose.translation = truth.bottom_center();
  out.pose = out.pose.moved(step);
  out.form.size = {truth.dimensions.length, truth.dimensions.width, truth.dimensions.height};
  out.form.shape.resize(num_coefficients);
  for (double& c : out.form.shape) c = normal(0.7);
  return out;
}

ViewPose moved(const ViewPose& pose, const Eigen::VectorXd& step) {
  return pose.moved(step.head<kPoseParameters>());
}

Form moved(const Form& form, const Eigen::VectorXd& step) {
  Form out = form;
  out.size += step.segment<kSizeParameters>(kPoseParameters);
  out.shape += step.tail(step.size() - kPoseParameters - kSizeParameters);
  return out;
}

TEST(Derivatives, OfAProjection) {
  const PinholeCamera camera = simulate_vehicle({}, 0).camera;
  for (const Eigen::Vector3d& x : {Eigen::Vector3d(3.0, 1.2, 15.0), Eigen::Vector3d(-7, 0.4, 30)}) {
    const auto f = [&](const Eigen::VectorXd& step) {
      const Eigen::Vector3d y = x + step;
      return Eigen::VectorXd(
          Eigen::Vector3d(camera.project(y)->x(), camera.project(y)->y(), std::log(y.z())));
    };
    expect_same_derivatives(projection_jacobian(camera, x), numeric_jacobian(f, 3), kRelative,
                            "projection");
  }
}

TEST(Derivatives, OfTheBodysPoints) {
  for (int i = 0; i < kTrials; ++i) {
    const int count = i % 3 == 0 ? 0 : 20;
    const bool car_like = i % 4 != 1;
    const Scene s = make_scene(i, count);
    const Body body(shipped_vehicle_prior().shape("car"), count, car_like);
    const BodyView at(body, s.vehicle.camera, s.pose, s.form);
    ASSERT_TRUE(at.in_front());
    for (int point = 0; point < kNumBodyPoints; ++point) {
      const auto f = [&](const Eigen::VectorXd& step) {
        const ViewPose pose = moved(s.pose, step);
        const Form form = moved(s.form, step);
        return Eigen::VectorXd(BodyView(body, s.vehicle.camera, pose, form).pixel(point));
      };
      Eigen::MatrixXd rows(body.num_parameters(), 2), by_shape(count, 2);
      at.jacobian(point, rows.col(0).data(), rows.col(1).data());
      expect_same_derivatives(rows.transpose(), numeric_jacobian(f, body.num_parameters()),
                              kRelative, "point " + std::to_string(point));
      at.shape_jacobian(point, by_shape.col(0).data(), by_shape.col(1).data());
      EXPECT_EQ(by_shape, rows.bottomRows(count));
    }
  }
}

// Of minus the logarithm: the gradient is weight * error, the second derivative along the error is
// weight * share_along where that is not cut at 0, across it weight.
TEST(Derivatives, OfTheErrorDensity) {
  const KeypointNoise noise;
  int uncut = 0;
  for (const double seen : {0.12, 0.8, 0.99}) {
    for (const double r : {0.3, 1.0, 2.0, 2.9, 4.0, 9.0}) {
      const Eigen::Vector2d error = r * Eigen::Vector2d(0.6, -0.8);
      const auto density = [&](const Eigen::Vector2d& e) {
        return error_density(noise, {e.squaredNorm(), e.squaredNorm()}, seen, 1.1, 0.4);
      };
      const auto cost = [&](const Eigen::VectorXd& step) {
        return -std::log(density(error + step).total);
      };
      const ErrorDensity at = density(error);
      expect_same_derivatives((at.weight() * error).transpose(),
                              numeric_gradient(cost, 2).transpose(), kRelative, "gradient");
      const auto gradient = [&](const Eigen::VectorXd& step) {
        const Eigen::Vector2d e = error + step;
        return Eigen::VectorXd(density(e).weight() * e);
      };
      const Eigen::Matrix2d second = numeric_jacobian(gradient, 2);
      const Eigen::Vector2d along = error.normalized(), across(-along.y(), along.x());
      EXPECT_NEAR(across.dot(second * across), at.weight(), kRelative * at.weight());
      const double share = along.dot(second * along) / at.weight();
      EXPECT_NEAR(at.share_along(r * r), std::max(share, 0.0), kRelative) << seen << " " << r;
      uncut += share > 0.0 ? 1 : 0;
    }
  }
  EXPECT_GE(uncut, 9);
}

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr Box2 kUncut = {-kInfinity, -kInfinity, kInfinity, kInfinity};

struct Keypoints {
  Body body;
  KeypointLikelihood likelihood;
  static Keypoints make(const Scene& s, const Box2& cuts = kUncut) {
    const ShapePrior& prior = shipped_vehicle_prior().shape("car");
    const int count = static_cast<int>(s.form.shape.size());
    std::array<double, kNumKeypoints> variance;
    variance.fill(0.03 * 0.03);
    return {Body(prior, count, true),
            KeypointLikelihood(s.vehicle.camera, s.vehicle.detection, KeypointSet::kAll36, {},
                               variance, prior.parameters_mean.head<3>(), cuts)};
  }
};

/// The image's border through a box, on no keypoint: none, on the right, on the left and below.
Box2 cuts_of(const Box2& box, int trial) {
  const Eigen::Vector2d middle = box.center() + Eigen::Vector2d(0.37, 0.41);
  if (trial % 3 == 0) return kUncut;
  if (trial % 3 == 1) return {-kInfinity, -kInfinity, middle.x(), kInfinity};
  return {middle.x(), -kInfinity, kInfinity, middle.y()};
}

TEST(Derivatives, OfTheKeypointLikelihood) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, i % 2 ? 20 : 5);
    Keypoints k = Keypoints::make(s, cuts_of(s.vehicle.detection.box, i));
    const BodyView at(k.body, s.vehicle.camera, s.pose, s.form);
    k.likelihood.prepare(at);
    ShapeErrors errors;
    const CounterRandom random(29, i);
    for (Eigen::Index j = 0; j < errors.size(); ++j) {
      errors.data()[j] = 0.03 * random.normal(static_cast<std::uint64_t>(j));
    }
    for (const bool solved : {false, true}) {  // shape errors
      NormalEquations equations;
      equations.set_zero(k.body.num_parameters());
      ShapeErrorEquations by_errors;
      by_errors.set_zero(k.body.num_parameters());
      k.likelihood.add(at, solved ? &errors : nullptr, false, &equations,
                       solved ? &by_errors : nullptr);
      const auto cost = [&](const Eigen::VectorXd& step) {
        const ViewPose pose = moved(s.pose, step);
        const Form form = moved(s.form, step);
        return k.likelihood.add(BodyView(k.body, s.vehicle.camera, pose, form),
                                solved ? &errors : nullptr, false, nullptr, nullptr);
      };
      expect_same_derivatives(equations.gradient.transpose(),
                              numeric_gradient(cost, k.body.num_parameters()).transpose(),
                              kRelative, solved ? "with shape errors" : "integrated out");
      if (!solved) continue;
      const auto cost_of_errors = [&](const Eigen::VectorXd& step) {
        ShapeErrors e = errors;
        e.reshaped() += step;
        return k.likelihood.add(at, &e, false, nullptr, nullptr);
      };
      expect_same_derivatives(by_errors.gradient.reshaped().transpose(),
                              numeric_gradient(cost_of_errors, errors.size()).transpose(),
                              kRelative, "by the shape errors");
    }
  }
}

// The least-squares step's second derivatives, weights held: sums over the keypoints of weight J^T
// J, with J by parameters and by shape errors.
TEST(Derivatives, TheKeypointsNormalEquationsAreThoseOfTheirRows) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, 5);
    Keypoints k = Keypoints::make(s, cuts_of(s.vehicle.detection.box, i));
    const BodyView at(k.body, s.vehicle.camera, s.pose, s.form);
    k.likelihood.prepare(at);
    const ShapeErrors errors = ShapeErrors::Constant(0.01);
    const int size = k.body.num_parameters();
    NormalEquations equations;
    equations.set_zero(size);
    ShapeErrorEquations by_errors;
    by_errors.set_zero(size);
    k.likelihood.add(at, &errors, false, &equations, &by_errors);
    const std::vector<Eigen::Vector2d> weights = k.likelihood.weights(at, &errors);
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(size, size);
    for (std::size_t j = 0; j < weights.size(); ++j) {
      const int point = k.likelihood.points()[j];
      Eigen::MatrixXd rows(size, 2);
      at.jacobian(point, rows.col(0).data(), rows.col(1).data());
      rows.col(0) /= k.likelihood.cell_u();
      rows.col(1) /= k.likelihood.cell_v();
      const Eigen::Matrix2d weight = weights[j].asDiagonal();
      expected += rows * weight * rows.transpose();
      const Eigen::Matrix<double, 2, 3>& c = k.likelihood.cells_by_shape_error();
      const Eigen::MatrixXd cross = c.transpose() * weight * rows.transpose();
      EXPECT_LE((by_errors.cross.middleRows<3>(3 * point) - cross).norm(), 1e-10 * cross.norm());
      const Eigen::Matrix3d own = c.transpose() * weight * c;
      EXPECT_LE((by_errors.own[static_cast<std::size_t>(point)] - own).norm(), 1e-10 * own.norm());
    }
    EXPECT_LT((equations.hessian - expected).norm(), 1e-10 * expected.norm());
  }
}

// By how much the pixel of a keypoint moves, in cells, for an error of its place on a body of the
// mean size; where the keypoint is off the bottom centre's ray it is approximate.
TEST(Derivatives, OfAPixelByAShapeError) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, 0);
    Keypoints k = Keypoints::make(s);
    const BodyView at(k.body, s.vehicle.camera, s.pose, s.form);
    k.likelihood.update_visibility(at);
    const Eigen::Vector3d mean = shipped_vehicle_prior().shape("car").parameters_mean.head<3>();
    const double size = s.form.size.sum() / mean.sum();
    const auto f = [&](const Eigen::VectorXd& error) {  // of a point at the bottom centre
      const Eigen::Vector3d x = s.pose.translation + size * (s.pose.rotation * error);
      const Eigen::Vector2d pixel = *s.vehicle.camera.project(x);
      return Eigen::VectorXd(
          Eigen::Vector2d(pixel.x() / k.likelihood.cell_u(), pixel.y() / k.likelihood.cell_v()));
    };
    expect_same_derivatives(k.likelihood.cells_by_shape_error(), numeric_jacobian(f, 3), kRelative,
                            "cells by shape error");
  }
}

TEST(Derivatives, OfTheBoxLikelihood) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, 20);
    const Body body(shipped_vehicle_prior().shape("car"), 20, true);
    const BoxLikelihood box(s.vehicle.camera, s.vehicle.detection.box, {}, 1 + i % 3);
    const BodyView at(body, s.vehicle.camera, s.pose, s.form);
    NormalEquations equations;
    equations.set_zero(body.num_parameters());
    box.add(at, &equations);
    const auto cost = [&](const Eigen::VectorXd& step) {
      const ViewPose pose = moved(s.pose, step);
      const Form form = moved(s.form, step);
      return box.add(BodyView(body, s.vehicle.camera, pose, form), nullptr);
    };
    // Steps that leave each side to the same point of the body.
    expect_same_derivatives(equations.gradient.transpose(),
                            numeric_gradient(cost, body.num_parameters(), 1e-6).transpose(), 1e-5,
                            "box " + std::to_string(i));
  }
}

// What a box holds of a vehicle ends at the image's border, whatever the vehicle is beyond.
TEST(BoxLikelihood, TheBorderMakesTheSideOfAVehicleThatReachesBeyondIt) {
  constexpr double kSeen = 3.5;  // px from the border, where the detector has the upper side
  Scene s = make_scene(2, 20);
  const Body body(shipped_vehicle_prior().shape("car"), 20, true);
  PinholeCamera& camera = s.vehicle.camera;
  const auto seen = [&](double beyond, double y1) {
    camera.cy -= outline(BodyView(body, camera, s.pose, s.form)).y1 + beyond;
    const BodyView at(body, camera, s.pose, s.form);
    Box2 box = outline(at);
    box.y1 = y1;
    return BoxLikelihood(camera, box, {}, 1).sides(at);
  };
  const std::size_t upper = 2;
  const BoxLikelihood::Side little = seen(1.0, kSeen)[upper], far = seen(15.0, kSeen)[upper];
  EXPECT_EQ(little.residual, -kSeen);
  EXPECT_EQ(far.residual, -kSeen);
  EXPECT_EQ(little.information, 0.0);
  EXPECT_EQ(far.information, 0.0);
  const BoxLikelihood::Side inside = seen(-2.0, kSeen)[upper];
  EXPECT_NEAR(inside.residual, 2.0 - kSeen, 1e-9);
  EXPECT_GT(inside.information, 0.0);
  EXPECT_LT(inside.squared, little.squared);
  // A side that is seen far inside says that the vehicle ends there.
  const BoxLikelihood::Side ends = seen(40.0, 30.0)[upper];
  EXPECT_NEAR(ends.residual, -70.0, 1e-9);
  EXPECT_GT(ends.information, 0.0);
}

// Half as far away and half as large, it looks the same.
TEST(VehicleAnswer, ATooSmallVehicleIsNotUsed) {
  const SimulatedVehicle s = simulate_vehicle({}, 1);
  VehiclePosterior posterior(s.camera, s.detection, s.support, {}, /*num_coefficients=*/0);
  VehicleState state = posterior.mean_state();
  state.poses.front() = {s.truth.camera_from_vehicle.rotation_matrix(), s.truth.bottom_center()};
  state.form.size = {s.truth.dimensions.length, s.truth.dimensions.width,
                     s.truth.dimensions.height};
  posterior.update_visibility(state);
  EXPECT_EQ(unreliable_reason(posterior, 0, state, s.detection.box), "");
  state.poses.front().translation *= 0.5;
  state.form.size *= 0.5;
  EXPECT_EQ(unreliable_reason(posterior, 0, state, s.detection.box),
            "the keypoints ask for too small a vehicle");
}

TEST(Derivatives, OfTheSizeAndShapePrior) {
  const SizeShapePrior prior(shipped_vehicle_prior(), "car", 20);
  const Scene s = make_scene(3, 20);
  NormalEquations equations;
  equations.set_zero(25);
  prior.add(s.form, 2, &equations);
  const auto at = [&](const Eigen::VectorXd& step) {
    Form form = s.form;
    form.size += step.segment<3>(2);
    form.shape += step.tail(20);
    return form;
  };
  const auto cost = [&](const Eigen::VectorXd& step) { return prior.add(at(step), 2, nullptr); };
  expect_same_derivatives(equations.gradient.transpose(), numeric_gradient(cost, 25).transpose(),
                          kRelative, "gradient");
  const auto gradient = [&](const Eigen::VectorXd& step) {
    NormalEquations out;
    out.set_zero(25);
    prior.add(at(step), 2, &out);
    return out.gradient;
  };
  expect_same_derivatives(equations.hessian, numeric_jacobian(gradient, 25), kRelative, "hessian");
}

TEST(Derivatives, OfTheContact) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, 0);
    GroundContact contact(s.vehicle.support, {}, false, 1.0);
    const auto by_pose = [&](const Eigen::VectorXd& step) {
      return Eigen::VectorXd(contact.residual(moved(s.pose, step)));
    };
    expect_same_derivatives(contact.jacobian(s.pose), numeric_jacobian(by_pose, 6), kRelative,
                            "by the pose");
    // A change of the plane moves the residual against its error.
    const UncertainPlane plane = contact.plane();
    const auto by_plane = [&](const Eigen::VectorXd& change) {
      contact.set_plane(changed_plane(plane, change));
      return Eigen::VectorXd(contact.residual(s.pose));
    };
    const Eigen::MatrixXd numeric = numeric_jacobian(by_plane, 3);
    contact.set_plane(plane);
    // The cosine of the vehicle's tilt against the plane is taken for 1.
    const double cosine = s.pose.rotation.col(1).dot(plane.plane.normal);
    Eigen::Matrix3d expected = -contact.by_plane(s.pose);
    expected.topLeftCorner<2, 2>() *= cosine;
    expect_same_derivatives(expected, numeric, kRelative, "by the plane");
    EXPECT_GT(cosine, 0.99);
  }
}

TEST(Derivatives, OfTheContactsCost) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, 0);
    SupportPlane support = s.vehicle.support;
    // The information is held; without tilts it does not depend on the pose.
    support.plane.covariance.topRows<2>().setZero();
    support.plane.covariance.leftCols<2>().setZero();
    for (const bool certain : {false, true}) {
      const GroundContact contact(support, {}, certain, 0.5);
      PoseMatrix hessian;
      PoseVector gradient;
      contact.evaluate(s.pose, &hessian, &gradient);
      const auto cost = [&](const Eigen::VectorXd& step) {
        return contact.evaluate(moved(s.pose, step), nullptr, nullptr);
      };
      expect_same_derivatives(gradient.transpose(), numeric_gradient(cost, 6).transpose(),
                              kRelative, "cost");
      const ContactJacobian j = contact.jacobian(s.pose);
      const double squared = contact.squared_distance(s.pose), gate = ContactNoise().gate;
      const double weight = certain ? 0.5 : 0.5 / (1.0 + squared / (gate * gate));
      const PoseMatrix expected = weight * j.transpose() * contact.information(s.pose) * j;
      EXPECT_LT((hessian - expected).norm(), 1e-12 * expected.norm());
    }
  }
}

/// The pose moved onto the plane, its up axis along the normal: no residual.
ViewPose on_the_plane(const GroundContact& contact, const ViewPose& pose) {
  ViewPose out = pose;
  const Plane& plane = contact.plane().plane;
  const Eigen::Vector3d up = plane.normal;
  Eigen::Vector3d ahead = pose.rotation.col(0) - pose.rotation.col(0).dot(up) * up;
  ahead.normalize();
  out.rotation << ahead, up, ahead.cross(up);
  out.translation = plane.foot(pose.translation);
  return out;
}

// How the posterior plane follows the pose. The gain depends on the pose as well, times the
// residual: exact where there is none.
TEST(Derivatives, OfThePosteriorPlane) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, 0);
    const GroundContact contact(s.vehicle.support, {}, i % 2 == 0, 1.0);
    const ViewPose pose = on_the_plane(contact, s.pose);
    ASSERT_LT(contact.residual(pose).norm(), 1e-12);
    const auto f = [&](const Eigen::VectorXd& step) {
      return Eigen::VectorXd(contact.posterior(moved(pose, step), PoseMatrix::Zero()).change);
    };
    expect_same_derivatives(contact.posterior(pose, PoseMatrix::Zero()).change_by_pose,
                            numeric_jacobian(f, 6), kRelative, "posterior plane");
  }
}

// For a known pose the plane is that of the normal equations of prior and contact.
TEST(Derivatives, ThePosteriorPlaneIsThatOfTheDenseProblem) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, 0);
    const GroundContact contact(s.vehicle.support, {}, true, 1.0);
    const ContactTerms terms = contact.terms(s.pose);
    const Eigen::Matrix3d weight = terms.variance.cwiseInverse().asDiagonal();
    const Eigen::Matrix3d information =
        contact.plane().covariance.inverse() + terms.by_plane.transpose() * weight * terms.by_plane;
    const Eigen::Matrix3d covariance = information.inverse();
    const Eigen::Vector3d mean =
        covariance * (terms.by_plane.transpose() * (weight * terms.residual));
    const auto posterior = contact.posterior(s.pose, PoseMatrix::Zero());
    EXPECT_LT((posterior.change - mean).norm(), 1e-9 * mean.norm());
    EXPECT_LT((posterior.covariance - covariance).norm(), 1e-9 * covariance.norm());
    // The pose's own covariance comes on top, through change_by_pose.
    const PoseMatrix pose = 1e-4 * PoseMatrix::Identity();
    const Eigen::Matrix3d more =
        posterior.change_by_pose * pose * posterior.change_by_pose.transpose();
    EXPECT_LT((contact.posterior(s.pose, pose).covariance - covariance - more).norm(),
              1e-9 * covariance.norm());
  }
}

TEST(Derivatives, OfWhatIsReported) {
  for (int i = 0; i < kTrials; ++i) {
    const Scene s = make_scene(i, 5);
    const auto f = [&](const Eigen::VectorXd& step) {
      const ViewPose pose = moved(s.pose, step);
      const Form form = moved(s.form, step);
      Eigen::VectorXd out(9);
      out << pose.translation + 0.5 * form.size[2] * pose.rotation.col(1),
          rotation_to_vector(
              Eigen::Quaterniond(Eigen::Matrix3d(s.pose.rotation.transpose() * pose.rotation))),
          form.size[0], form.size[2], form.size[1];  // length, height, width
      return out;
    };
    expect_same_derivatives(report_jacobian(s.pose, s.form, 14), numeric_jacobian(f, 14), kRelative,
                            "report");
  }
}

}  // namespace
}  // namespace camber::internal
