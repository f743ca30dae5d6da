#include "camber/vehicle/paper/joint_fit.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>

#include "vehicle/simulated_vehicle.h"

namespace camber::paper {
namespace {

using test::simulate_vehicle;
using test::SimulatedVehicle;
using test::SimulationOptions;

struct FrameOfVehicles {
  PinholeCamera camera;
  std::vector<VehicleDetection> detections;
  std::vector<SupportPlane> supports;
  std::vector<VehicleEstimate> starts;
  std::vector<SimulatedVehicle> truth;
};

FrameOfVehicles make_frame(const SimulationOptions& options, int first, int count) {
  FrameOfVehicles out;
  for (int i = first; i < first + count; ++i) {
    const SimulatedVehicle s = simulate_vehicle(options, i);
    out.camera = s.camera;
    out.detections.push_back(s.detection);
    out.supports.push_back(s.support);
    out.truth.push_back(s);
  }
  out.starts = fit_vehicles(out.camera, out.detections, out.supports, {}, 1);
  return out;
}

double center_error(const VehicleEstimate& e, const SimulatedVehicle& s) {
  return (e.pose.center() - s.truth.center()).norm();
}

JointFit solve(const FrameOfVehicles& f, const JointFitOptions& options) {
  return fit_joint(f.camera, f.detections, f.supports, f.starts, options);
}

TEST(JointFit, IsAboutAsGoodAsTheSingleFitsAndHonest) {
  // The vehicles stand on planes that have nothing to do with one another.
  JointFitOptions options;
  options.links = PlaneLinks::kNone;
  options.num_coefficients = 20;
  double joint = 0.0, single = 0.0, covered = 0.0;
  constexpr int kFrames = 30, kVehicles = 5;
  for (int k = 0; k < kFrames; ++k) {
    const FrameOfVehicles f = make_frame({}, k * kVehicles, kVehicles);
    const JointFit fit = solve(f, options);
    for (int i = 0; i < kVehicles; ++i) {
      const auto at = static_cast<std::size_t>(i);
      joint += center_error(fit.vehicles[at], f.truth[at]) / (kFrames * kVehicles);
      single += center_error(f.starts[at], f.truth[at]) / (kFrames * kVehicles);
      const Eigen::Vector3d d = fit.vehicles[at].pose.center() - f.truth[at].truth.center();
      const Eigen::Matrix3d c = fit.vehicles[at].covariance.topLeftCorner<3, 3>();
      covered += d.dot(c.inverse() * d) < 7.815 ? 1.0 / (kFrames * kVehicles) : 0.0;
    }
  }
  EXPECT_LT(joint, 1.2 * single);
  EXPECT_GT(covered, 0.88);
}

TEST(JointFit, AnalyticAndAutomaticDerivativesEndAtTheSameCost) {
  const FrameOfVehicles f = make_frame({}, 0, 6);
  JointFitOptions options;
  const JointFit a = solve(f, options);
  options.analytic = false;
  const JointFit b = solve(f, options);
  EXPECT_EQ(a.solved, 6);
  EXPECT_NEAR(a.final_cost, b.final_cost, 1e-6 * b.final_cost);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_LT((a.vehicles[i].pose.center() - b.vehicles[i].pose.center()).norm(), 1e-4);
  }
}

TEST(JointFit, AlternatingComesNearTheSimultaneousSolution) {
  const FrameOfVehicles f = make_frame({}, 0, 6);
  JointFitOptions options;
  const JointFit all = solve(f, options);
  options.alternating = true;
  options.rounds = 12;
  const JointFit turns = solve(f, options);
  EXPECT_LE(all.final_cost, turns.final_cost * 1.01);
  EXPECT_LT(turns.final_cost, turns.initial_cost);
  EXPECT_LT(turns.final_cost, 1.3 * all.final_cost);
}

TEST(JointFit, ThePapersPresetRunsItsOwnProblem) {
  const FrameOfVehicles f = make_frame({}, 10, 6);
  const JointFit fit = solve(f, JointFitOptions::paper());
  EXPECT_EQ(fit.solved, 6);
  EXPECT_LT(fit.final_cost, fit.initial_cost);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_LT(center_error(fit.vehicles[i], f.truth[i]), 0.25 * f.truth[i].truth.center().norm());
  }
}

TEST(JointFit, AWrongPlaneIsMendedByItsNeighbours) {
  // Three vehicles in a row on one plane; the middle one's own patch is 0.4 m too high and says
  // that it knows little.
  SimulationOptions options;
  options.min_distance = 18.0;
  options.max_distance = 18.5;
  options.plane_sigma_height = 0.01;
  options.plane_sigma_tilt = 0.002;
  int better = 0;
  constexpr int kTrials = 12;
  for (int t = 0; t < kTrials; ++t) {
    FrameOfVehicles f;
    const SimulatedVehicle first = simulate_vehicle(options, t);
    f.camera = first.camera;
    for (int i = 0; i < 3; ++i) {
      // The camera moves back: the same car 18, 24 and 30 m away, on the same plane.
      const SE3 back(Eigen::Quaterniond::Identity(), 6.0 * i * first.support.plane.axis1);
      SimulatedVehicle s = test::seen_again(first, options, t, i, SE3(), 0.0);
      s.truth.camera_from_vehicle =
          SE3(s.truth.camera_from_vehicle.rotation_matrix(),
              s.truth.camera_from_vehicle.translation() + back.translation());
      s = test::seen_again(s, options, t, i, SE3(), 0.0);
      s.support.plane.centroid = s.support.plane.plane.foot(s.truth.bottom_center());
      if (i == 1) {
        s.support.plane.covariance = Eigen::Vector3d(0.03 * 0.03, 0.03 * 0.03, 0.25).asDiagonal();
        s.support.plane.plane = s.support.plane.perturbed({0.0, 0.0, 0.4});
      }
      f.detections.push_back(s.detection);
      f.supports.push_back(s.support);
      f.truth.push_back(s);
    }
    f.starts = fit_vehicles(f.camera, f.detections, f.supports, {}, 1);
    JointFitOptions none, linked;
    none.links = PlaneLinks::kNone;
    const auto height_error = [&](const JointFit& fit) {
      return std::abs(fit.planes[1].signed_distance(
          f.truth[1].true_plane.foot(f.truth[1].truth.bottom_center())));
    };
    better += height_error(solve(f, linked)) < height_error(solve(f, none)) ? 1 : 0;
  }
  EXPECT_GE(better, 10);
}

TEST(JointFit, VehiclesWithoutTrustedKeypointsKeepTheirStart) {
  FrameOfVehicles f = make_frame({}, 0, 3);
  f.detections[1].keypoints.clear();
  f.starts = fit_vehicles(f.camera, f.detections, f.supports, {}, 1);
  const JointFit fit = solve(f, {});
  EXPECT_EQ(fit.solved, 2);
  EXPECT_EQ(fit.vehicles[1].pose.bottom_center(), f.starts[1].pose.bottom_center());
  FrameOfVehicles empty;
  empty.camera = f.camera;
  EXPECT_EQ(solve(empty, {}).solved, 0);
}

TEST(JointFit, SameBitsAgain) {
  const FrameOfVehicles f = make_frame({}, 0, 5);
  const JointFit a = solve(f, {}), b = solve(f, {});
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(a.vehicles[i].pose.bottom_center(), b.vehicles[i].pose.bottom_center());
    EXPECT_EQ(a.vehicles[i].covariance, b.vehicles[i].covariance);
  }
}

TEST(JointFit, BadInputIsRefused) {
  const FrameOfVehicles f = make_frame({}, 0, 2);
  JointFitOptions options;
  options.num_coefficients = 21;
  EXPECT_THROW(solve(f, options), std::invalid_argument);
  options = {};
  options.analytic = false;
  options.num_coefficients = 7;
  EXPECT_THROW(solve(f, options), std::invalid_argument);
  EXPECT_THROW(fit_joint(f.camera, f.detections, {}, f.starts, {}), std::invalid_argument);
}

}  // namespace
}  // namespace camber::paper
