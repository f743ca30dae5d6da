// Hand-written derivatives over several views, and of the whole posterior, against numeric ones, on
// the manifold of poses.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "camber/core/random.h"
#include "camber/vehicle/detail/ground_propagation.h"
#include "camber/vehicle/detail/levenberg_marquardt.h"
#include "vehicle/numeric_derivative.h"
#include "vehicle/simulated_vehicle.h"

namespace camber::internal {
namespace {

using test::expect_same_derivatives;
using test::numeric_gradient;
using test::numeric_jacobian;
using test::seen_again;
using test::simulate_vehicle;
using test::SimulatedVehicle;

// As in term_derivatives_test.cpp.
constexpr double kRelative = 1e-6;
constexpr double kInterval = 0.1;  // s

ViewCamera camera_at(int view) {
  ViewCamera out;
  out.world_from_camera = SE3(rotation_from_vector({0.002, 0.01 * view, -0.003 * view}),
                              Eigen::Vector3d(0.02 * view, 0.01, -0.9 * view))
                              .inverse();
  out.time_s = kInterval * view + 0.01 * (view % 2);
  out.sigma_shift = 0.004;
  return out;
}

/// A vehicle in several views, and a state a little off its truth.
struct Track {
  std::vector<SimulatedVehicle> views;
  std::vector<PosteriorView> inputs;  // of `views`
  VehicleFitOptions options;
  VehicleState state;

  /// @param tilts  false: the planes' tilts are known, so that the contact's information does not
  ///               depend on the pose.
  Track(std::uint64_t index, int count, int num_coefficients, bool tilts) {
    for (int k = 0; k < count; ++k) {
      const SE3 camera_from_first =
          camera_at(k).world_from_camera.inverse() * camera_at(0).world_from_camera;
      views.push_back(seen_again(simulate_vehicle({}, index), {}, index, k, camera_from_first,
                                 5.0 * kInterval * k));
      Eigen::Matrix3d& covariance = views.back().support.plane.covariance;
      if (!tilts) covariance.topRows<2>().setZero();
      if (!tilts) covariance.leftCols<2>().setZero();
    }
    for (int k = 0; k < count; ++k) {
      const auto& v = views[static_cast<std::size_t>(k)];
      inputs.push_back({&v.detection, &v.support, camera_at(k)});
    }
    options.num_coefficients = num_coefficients;
    const CounterRandom random(31, index);
    std::uint64_t counter = 0;
    const auto normal = [&](double sigma) { return sigma * random.normal(counter++); };
    for (const SimulatedVehicle& v : views) {
      const SE3& truth = v.truth.camera_from_vehicle;
      PoseVector step;
      for (int i = 0; i < 3; ++i) step[i] = normal(0.1);
      for (int i = 3; i < 6; ++i) step[i] = normal(0.02);
      state.poses.push_back(ViewPose{truth.rotation_matrix(), truth.translation()}.moved(step));
    }
    const Dimensions& size = views.front().truth.dimensions;
    state.form.size = {size.length, size.width, size.height};
    state.form.shape.resize(num_coefficients);
    for (double& c : state.form.shape) c = normal(0.5);
    state.log_scale = normal(0.02);
    if (count > 1) {
      for (double& e : state.errors.reshaped()) e = normal(0.02);
    }
  }
  Track(const Track&) = delete;

  VehiclePosterior posterior() const {
    VehiclePosterior out(views.front().camera, inputs, "car", options, options.num_coefficients,
                         0.01);
    for (int k = 0; k < out.num_views(); ++k) out.keypoints(k).prepare(out.view(k, state));
    return out;
  }

  /// Registrations of the true motion, `off` px off.
  RegistrationLikelihood registration(int lead, double off = 0.8) const {
    const SimulatedVehicle& first = views[static_cast<std::size_t>(lead)];
    const SE3& lead_pose = first.truth.camera_from_vehicle;
    std::vector<RegisteredView> out;
    for (int k = 0; k < static_cast<int>(views.size()); ++k) {
      if (k == lead) continue;
      const SimulatedVehicle& other = views[static_cast<std::size_t>(k)];
      VehicleShift shift;
      const Eigen::Vector3d place(0.4, 0.8, 0.3);
      shift.anchor = lead_pose * place;
      const Eigen::Vector3d there = other.truth.camera_from_vehicle * place;
      shift.displacement = *other.camera.project(there) - *first.camera.project(shift.anchor) +
                           off * Eigen::Vector2d(0.9, -0.4 * k);
      shift.log_depth_ratio = std::log(there.z() / shift.anchor.z()) + 0.003 * off;
      shift.shared = Eigen::Vector3d(0.1, 0.1, 0.002).cwiseAbs2().asDiagonal();
      shift.noise = 2.0 * shift.shared;
      shift.noise(0, 1) = shift.noise(1, 0) = 0.004;
      shift.by_depth = {20.0, 5.0, 0.05};
      shift.depth_sigma = 0.01;
      out.push_back({k, shift});
    }
    const ViewPose& pose = state.poses[static_cast<std::size_t>(lead)];
    return {first.camera, {}, lead, pose, state.form, out};
  }
};

VehicleState moved(const VehiclePosterior& posterior, const VehicleState& state,
                   const Eigen::VectorXd& step) {
  return posterior.moved(state, step);
}

// Shift, turn: by both poses and the scale of the baseline. Turns up to 0.2 rad.
TEST(Derivatives, OfAStepBetweenViews) {
  for (std::uint64_t i = 0; i < 8; ++i) {
    const Track track(i, 2, 0, true);
    VehicleState s = track.state;
    const CounterRandom random(37, i);
    s.poses[1].rotation *=
        rotation_from_vector({random.uniform(0, -0.1, 0.1), random.uniform(1, -0.1, 0.1),
                              random.uniform(2, -0.1, 0.1)})
            .toRotationMatrix();
    const auto f = [&](const Eigen::VectorXd& x) {
      return Eigen::VectorXd(step_between(camera_at(0), camera_at(1), s.poses[0].moved(x.head<6>()),
                                          s.poses[1].moved(x.segment<6>(6)), s.log_scale + x[12],
                                          nullptr));
    };
    StepJacobian written;
    const Step step =
        step_between(camera_at(0), camera_at(1), s.poses[0], s.poses[1], s.log_scale, &written);
    EXPECT_GT(step.tail<3>().norm(), 0.01);
    expect_same_derivatives(written, numeric_jacobian(f, 13), kRelative, "step");
  }
}

TEST(Derivatives, OfTheMotionPrior) {
  for (const Motion motion : {Motion::kMoving, Motion::kParked}) {
    const Track track(5, 4, 3, true);
    const VehiclePosterior posterior = track.posterior();
    VehicleState s = track.state;
    s.motion = motion;
    NormalEquations equations;
    equations.set_zero(posterior.layout().total());
    posterior.motion().add(s, posterior.layout(), &equations);
    const auto cost = [&](const Eigen::VectorXd& x) {
      return posterior.motion().add(moved(posterior, s, x), posterior.layout(), nullptr);
    };
    expect_same_derivatives(equations.gradient.transpose(),
                            numeric_gradient(cost, posterior.layout().total(), 1e-5).transpose(),
                            kRelative, "motion");
  }
}

TEST(Derivatives, OfARegistration) {
  for (std::uint64_t i = 0; i < 6; ++i) {
    const Track track(i, 3, 2, true);
    const VehiclePosterior posterior = track.posterior();
    const ParameterLayout& layout = posterior.layout();
    const RegistrationLikelihood registration = track.registration(1);
    ASSERT_EQ(registration.count(), 2);
    const int others[] = {0, 2};
    for (int r = 0; r < 2; ++r) {
      RegistrationLikelihood::Jacobian own;
      ASSERT_TRUE(registration.residual(track.state, r, &own));
      Eigen::MatrixXd written = Eigen::MatrixXd::Zero(3, layout.total());
      written.middleCols<6>(layout.pose(1)) = own.leftCols<6>();
      written.middleCols<6>(layout.pose(others[r])) = own.middleCols<6>(6);
      written.middleCols<3>(layout.size()) = own.rightCols<3>();
      const auto f = [&](const Eigen::VectorXd& x) {
        return Eigen::VectorXd(
            *registration.residual(moved(posterior, track.state, x), r, nullptr));
      };
      expect_same_derivatives(written, numeric_jacobian(f, layout.total()), kRelative, "residual");
    }
    // With the errors in common eliminated the gradient stays that of the cost.
    NormalEquations equations;
    equations.set_zero(layout.total());
    ASSERT_TRUE(registration.add(track.state, layout, &equations));
    const auto cost = [&](const Eigen::VectorXd& x) {
      return *registration.add(moved(posterior, track.state, x), layout, nullptr);
    };
    // They are iterated until they change by 1e-5 standard deviations.
    expect_same_derivatives(equations.gradient.transpose(),
                            numeric_gradient(cost, layout.total(), 1e-5).transpose(), 1e-4, "cost");
  }
}

// All terms together. The steps that eliminate the shape errors are taken first: where they are at
// their optimum, the gradient of the others is that of the cost.
TEST(Derivatives, OfTheWholePosterior) {
  for (const int views : {1, 2, 4}) {
    for (const Motion motion : {Motion::kMoving, Motion::kParked}) {
      const Track track(11, views, 6, /*tilts=*/false);
      VehiclePosterior posterior = track.posterior();
      if (views > 1) posterior.set_registration(track.registration(0));
      VehicleState s = track.state;
      s.motion = motion;
      PosteriorEquations equations;
      for (int i = 0; i < 60; ++i) {
        posterior.evaluate(s, &equations);
        if (views > 1) s.errors.reshaped() -= equations.errors_at;
      }
      posterior.evaluate(s, &equations);
      if (views > 1) {
        ASSERT_LT(equations.errors_at.norm(), 1e-9);
      }
      const auto cost = [&](const Eigen::VectorXd& x) {
        return posterior.evaluate(moved(posterior, s, x), nullptr);
      };
      expect_same_derivatives(equations.gradient.transpose(),
                              numeric_gradient(cost, posterior.layout().total(), 1e-6).transpose(),
                              1e-5, "posterior of " + std::to_string(views) + " views");
    }
  }
}

/// The coefficients' information with all weights held, the shape errors eliminated.
Eigen::MatrixXd shape_information(const VehiclePosterior& posterior, const VehicleState& state,
                                  const std::vector<std::vector<Eigen::Vector2d>>& weights,
                                  const std::vector<BoxLikelihood::Sides>& sides) {
  const int count = posterior.num_coefficients();
  Eigen::MatrixXd out = Eigen::MatrixXd::Zero(count, count);
  std::array<Eigen::Matrix3d, kNumKeypoints> own;
  std::vector<Eigen::MatrixXd> cross(kNumKeypoints, Eigen::MatrixXd::Zero(3, count));
  const ShapePrior& prior = shipped_vehicle_prior().shape("car");
  const auto left = prior.residual_sigma(count);
  for (int i = 0; i < kNumKeypoints; ++i) {
    const double variance = left.col(i % kNumSideKeypoints).squaredNorm() / 3.0;
    own[static_cast<std::size_t>(i)] = Eigen::Matrix3d::Identity() / variance;
  }
  for (int k = 0; k < posterior.num_views(); ++k) {
    const auto at_view = static_cast<std::size_t>(k);
    const KeypointLikelihood& keypoints = posterior.keypoints(k);
    const BodyView at = posterior.view(k, state);
    const auto by_shape = [&](int point) {
      Eigen::MatrixXd j(count, 2);
      at.shape_jacobian(point, j.col(0).data(), j.col(1).data());
      return j;
    };
    for (std::size_t j = 0; j < keypoints.points().size(); ++j) {
      const int point = keypoints.points()[j];
      const auto i = static_cast<std::size_t>(point);
      Eigen::MatrixXd rows = by_shape(point);
      rows.col(0) /= keypoints.cell_u();
      rows.col(1) /= keypoints.cell_v();
      const Eigen::Matrix2d weight = weights[at_view][j].asDiagonal();
      out += rows * weight * rows.transpose();
      const Eigen::Matrix<double, 2, 3>& c = keypoints.cells_by_shape_error();
      own[i] += c.transpose() * weight * c;
      cross[i] += c.transpose() * weight * rows.transpose();
    }
    for (const BoxLikelihood::Side& side : sides[at_view]) {
      const Eigen::VectorXd row = by_shape(side.point).col(side.axis);
      out += side.information * row * row.transpose();
    }
  }
  if (posterior.num_views() > 1) {
    for (std::size_t i = 0; i < own.size(); ++i) {
      out -= cross[i].transpose() * own[i].inverse() * cross[i];
    }
  }
  const Eigen::MatrixXd covariance =
      prior.parameters_covariance.topLeftCorner(3 + count, 3 + count).inverse();
  return out + covariance.bottomRightCorner(count, count);
}

// What integrating out the coefficients adds: half the logarithm of their information's
// determinant, weights held.
TEST(Derivatives, OfTheShapesMarginal) {
  for (const int views : {1, 3}) {
    const Track track(7, views, 6, true);
    const VehiclePosterior posterior = track.posterior();
    const VehicleState& s = track.state;
    PosteriorEquations equations;
    posterior.evaluate(s, &equations);
    std::vector<std::vector<Eigen::Vector2d>> weights;
    std::vector<BoxLikelihood::Sides> sides;
    for (int k = 0; k < views; ++k) {
      const BodyView at = posterior.view(k, s);
      weights.push_back(posterior.keypoints(k).weights(at, views > 1 ? &s.errors : nullptr));
      sides.push_back(posterior.box(k).sides(at));
    }
    const ParameterLayout& layout = posterior.layout();
    const Eigen::MatrixXd information = shape_information(posterior, s, weights, sides);
    EXPECT_LT((information - equations.hessian.block(layout.shape(), layout.shape(), 6, 6)).norm(),
              1e-9 * information.norm());
    const auto half_log_determinant = [&](const Eigen::VectorXd& x) {
      const Eigen::LDLT<Eigen::MatrixXd> factors(
          shape_information(posterior, moved(posterior, s, x), weights, sides));
      return 0.5 * factors.vectorD().array().log().sum();
    };
    Eigen::VectorXd numeric = numeric_gradient(half_log_determinant, layout.total());
    // Of poses and size alone.
    numeric.tail(layout.num_coefficients + 1).setZero();
    expect_same_derivatives(posterior.shape_marginal_gradient(s, equations).transpose(),
                            numeric.transpose(), kRelative, "shape marginal");
    EXPECT_GT(numeric.norm(), 0.1);
  }
}

/// A vehicle whose posterior is nearly quadratic: nothing is robust, and detections are what the
/// mean vehicle at the state shows, but for a tenth of their errors, on planes that it stands on.
void make_quadratic(Track* track) {
  VehicleNoise& noise = track->options.noise;
  track->options.plane_is_exact = true;
  noise.box.gate = 1e3;
  noise.keypoint.gross_share = 1e-9;
  noise.keypoint.far_share = 1e-9;
  noise.keypoint.guessed = 1.1;
  const VehiclePosterior posterior = track->posterior();
  track->state.form = posterior.mean_state().form;
  const CounterRandom random(41, 0);
  std::uint64_t counter = 0;
  for (int k = 0; k < posterior.num_views(); ++k) {
    VehicleDetection& detection = track->views[static_cast<std::size_t>(k)].detection;
    UncertainPlane& plane = track->views[static_cast<std::size_t>(k)].support.plane;
    const ViewPose& pose = track->state.poses[static_cast<std::size_t>(k)];
    plane.plane = Plane::through(pose.translation, pose.rotation.col(1));
    plane.axis1 = pose.rotation.col(0);
    plane.axis2 = -pose.rotation.col(2);
    plane.centroid = pose.translation + 0.7 * plane.axis1 - 0.4 * plane.axis2;
    const BodyView at = posterior.view(k, track->state);
    detection.box = outline(at);
    for (int i = 0; i < kNumKeypoints; ++i) {
      const double u = random.normal(counter++), v = random.normal(counter++);
      detection.keypoints[static_cast<std::size_t>(i)].pixel =
          at.pixel(i) +
          0.1 / 64.0 * Eigen::Vector2d(u * detection.box.width(), v * detection.box.height());
    }
  }
}

/// Entries of two information matrices agree within `share` of the two parameters' own.
void expect_same_information(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b, double share) {
  for (Eigen::Index r = 0; r < a.rows(); ++r) {
    for (Eigen::Index c = 0; c < a.cols(); ++c) {
      EXPECT_NEAR(a(r, c), b(r, c), share * std::sqrt(a(r, r) * a(c, c))) << r << " " << c;
    }
  }
}

/// Refined to the last digits.
double minimise(const VehiclePosterior& posterior, VehicleState* state) {
  double cost = 0.0;
  for (int round = 0; round < 3; ++round) cost = refine(posterior, state, 100, 1e-13);
  return cost;
}

// A message is the profile of the vehicle's posterior over its plane: minus its gradient is the
// information vector, its second derivatives are the information. Those of a least-squares step
// leave out the projection's own, times residuals.
TEST(Derivatives, OfAGroundMessageByThePlane) {
  for (std::uint64_t i = 0; i < 6; ++i) {
    Track track(i, 1, 0, true);
    make_quadratic(&track);
    VehiclePosterior posterior = track.posterior();
    const UncertainPlane plane = posterior.contact(0).plane();
    VehicleState state = track.state;
    const auto set = [&](const Eigen::VectorXd& change) {
      UncertainPlane known = changed_plane(plane, change);
      known.covariance.setZero();
      posterior.set_plane(0, known);
    };
    set(Eigen::Vector3d::Zero());
    minimise(posterior, &state);
    const auto message = ground_message(posterior, state, 0, plane);
    ASSERT_TRUE(message);
    const auto gradient = [&](const Eigen::VectorXd& change) {
      const auto profile = [&](const Eigen::VectorXd& x) {
        set(change + x);
        VehicleState s = state;
        return minimise(posterior, &s);
      };
      return numeric_gradient(profile, 3, 1e-3);
    };
    // A score's standard deviation is the root of its information.
    const Eigen::VectorXd slope = gradient(Eigen::Vector3d::Zero());
    for (int a = 0; a < 3; ++a) {
      EXPECT_NEAR(-message->information_vector[a], slope[a],
                  2e-3 * std::sqrt(message->information(a, a)));
    }
    expect_same_information(message->information.topLeftCorner<3, 3>(),
                            numeric_jacobian(gradient, 3, 1e-3), 0.05);
    EXPECT_LT(message->information.col(3).norm(), 1e-9);  // one view shows no scale
  }
}

// The same by the scale, with nothing known of the planes.
TEST(Derivatives, OfAGroundMessageByTheScale) {
  for (std::uint64_t i = 0; i < 6; ++i) {
    Track track(i, 3, 0, true);
    for (std::size_t k = 0; k < track.views.size(); ++k) {
      const SE3& truth = track.views[k].truth.camera_from_vehicle;
      track.state.poses[k] = {truth.rotation_matrix(), truth.translation()};
    }
    make_quadratic(&track);
    VehiclePosterior posterior = track.posterior();
    posterior.set_registration(track.registration(0, 0.05));
    const UncertainPlane plane = posterior.contact(0).plane();
    for (int k = 0; k < 3; ++k) {
      UncertainPlane unknown = posterior.contact(k).plane();
      unknown.covariance = 1e8 * Eigen::Matrix3d::Identity();
      posterior.set_plane(k, unknown);
    }
    VehicleState state = track.state;
    state.motion = Motion::kMoving;
    const auto set = [&](double log_scale) { posterior.set_scale(log_scale, 1e-10); };
    set(0.0);
    minimise(posterior, &state);
    const auto message = ground_message(posterior, state, 0, plane);
    ASSERT_TRUE(message);
    const Eigen::Matrix3d by_plane = message->information.topLeftCorner<3, 3>();
    const Eigen::Vector3d cross = message->information.topRightCorner<3, 1>();
    const Eigen::Vector3d follows = by_plane.ldlt().solve(cross);
    const double information = message->information(3, 3) - cross.dot(follows);
    const double vector =
        message->information_vector[3] - follows.dot(message->information_vector.head<3>());
    const auto gradient = [&](const Eigen::VectorXd& at) {
      const auto profile = [&](const Eigen::VectorXd& x) {
        set(at[0] + x[0]);
        VehicleState s = state;
        return minimise(posterior, &s);
      };
      return numeric_gradient(profile, 1, 1e-3);
    };
    const double slope = gradient(Eigen::VectorXd::Zero(1))[0];
    EXPECT_NEAR(-vector, slope, 2e-3 * std::sqrt(information)) << i;
    EXPECT_NEAR(information, numeric_jacobian(gradient, 1, 1e-3)(0, 0), 0.1 * information) << i;
  }
}

}  // namespace
}  // namespace camber::internal
