#include "camber/vehicle/paper/joint_fit.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/vehicle/shape_prior.h"
#include "camber/vehicle/support_plane.h"
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
  std::vector<SimulatedVehicle> truth;
};

FrameOfVehicles make_frame(const SimulationOptions& options, int first, int count) {
  FrameOfVehicles out;
  for (int i = first; i < first + count; ++i) {
    const SimulatedVehicle s = simulate_vehicle(options, static_cast<std::uint64_t>(i));
    out.camera = s.camera;
    out.detections.push_back(s.detection);
    out.supports.push_back(s.support);
    out.truth.push_back(s);
  }
  return out;
}

std::vector<VehicleStart> starts_of(const FrameOfVehicles& f) {
  return starts_on_planes(f.camera, f.detections, f.supports, {});
}

double center_error(const VehicleEstimate& e, const SimulatedVehicle& s) {
  return (e.pose.center() - s.truth.center()).norm();
}

JointFit solve(const FrameOfVehicles& f, const JointFitOptions& options) {
  return fit_joint(f.camera, f.supports, starts_of(f), options);
}

/// Cars of the prior's mean shape and size on known planes, with exact keypoints.
FrameOfVehicles exact_frame(const std::vector<SE3>& poses, double unit = 1.0,
                            const VehiclePrior* prior = nullptr) {
  const VehiclePrior& known = prior ? *prior : shipped_vehicle_prior();
  const Dimensions mean = known.shape("car").mean_dimensions();
  const KeypointMatrix shape = known.shape("car").keypoints(mean);
  FrameOfVehicles out;
  out.camera = {1242, 375, 721.5377, 721.5377, 609.5593, 172.854};
  for (const SE3& pose : poses) {
    SimulatedVehicle s;
    s.camera = out.camera;
    s.truth = {pose, mean};
    s.true_plane = Plane::through(pose.translation(), pose.rotation_matrix().col(1));
    s.detection.box = {1e9, 1e9, -1e9, -1e9};
    for (int i = 0; i < kNumKeypoints; ++i) {
      const Eigen::Vector2d pixel = *out.camera.project(pose * shape.col(i));
      s.detection.keypoints.push_back({pixel});
      Box2& box = s.detection.box;
      box = {std::min(box.x1, pixel.x()), std::min(box.y1, pixel.y()), std::max(box.x2, pixel.x()),
             std::max(box.y2, pixel.y())};
    }
    s.detection.given_plane = s.true_plane;
    SupportOptions sigmas;
    sigmas.given_sigma_height *= unit;
    s.support = given_support(out.camera, s.detection, sigmas);
    out.detections.push_back(s.detection);
    out.supports.push_back(s.support);
    out.truth.push_back(s);
  }
  return out;
}

/// Yaw on a road of 8 degrees grade and 4 degrees bank.
SE3 tilted_pose(double yaw, const Eigen::Vector3d& bottom) {
  const Eigen::Quaterniond slope =
      rotation_from_vector({0.14, 0.0, 0.0}) * rotation_from_vector({0.0, 0.0, 0.07});
  return {slope * Eigen::Quaterniond(rotation_from_rotation_y(yaw)), bottom};
}

TEST(PaperJointFit, TheMinimumOfTheMeantTermsIsTheTruthForAnExactCar) {
  // The mean car's front and rear wheel centres differ by 0.25 mm in height, so that their plane
  // and the ground differ by 1e-4 rad: a prior without that.
  VehiclePrior prior = shipped_vehicle_prior();
  for (ShapePrior& shape : prior.shapes) shape.mean(1, 1) = shape.mean(1, 0);
  for (const double yaw : {-1.4, 0.3, 2.5}) {
    const FrameOfVehicles f = exact_frame({tilted_pose(yaw, {1.5, 1.2, 14.0})}, 1.0, &prior);
    StartOptions start;
    start.prior = &prior;
    std::vector<VehicleStart> starts = starts_on_planes(f.camera, f.detections, f.supports, start);
    // A start that is wrong in every unknown.
    OrientedBox& box = starts[0].vehicle.pose;
    box.camera_from_vehicle =
        SE3(box.camera_from_vehicle.rotation() * rotation_from_vector({0.02, 0.1, -0.02}),
            box.camera_from_vehicle.translation() * 1.05);
    box.dimensions.length += 0.2;
    JointFitOptions options;
    options.prior = &prior;
    options.function_tolerance = 1e-15;
    options.max_iterations = 100;
    const JointFit fit = fit_joint(f.camera, f.supports, starts, options);
    const SE3 off =
        fit.vehicles[0].pose.camera_from_vehicle.inverse() * f.truth[0].truth.camera_from_vehicle;
    EXPECT_LT(off.translation().norm(), 1e-6) << yaw;
    EXPECT_LT(rotation_to_vector(off.rotation()).norm(), 1e-6) << yaw;
    EXPECT_NEAR(fit.vehicles[0].pose.dimensions.length, f.truth[0].truth.dimensions.length, 1e-6);
    EXPECT_NEAR(fit.vehicles[0].pose.dimensions.width, f.truth[0].truth.dimensions.width, 1e-6);
    EXPECT_NEAR(fit.vehicles[0].pose.dimensions.height, f.truth[0].truth.dimensions.height, 1e-6);
    EXPECT_LT(angle_between(fit.planes[0].normal, f.truth[0].true_plane.normal), 1e-6);
    EXPECT_NEAR(fit.planes[0].offset, f.truth[0].true_plane.offset, 1e-6);
    // The printed terms have another minimum: equation 7 draws the bumpers to the wheel centres.
    options.terms = Terms::kPrinted;
    const JointFit printed = fit_joint(f.camera, f.supports, starts, options);
    EXPECT_GT(
        std::abs(printed.vehicles[0].pose.dimensions.height - f.truth[0].truth.dimensions.height) +
            (printed.vehicles[0].pose.center() - f.truth[0].truth.center()).norm(),
        1e-3);
  }
}

TEST(PaperJointFit, MetresAndCentimetresGiveTheSameAnswer) {
  const std::vector<SE3> poses = {tilted_pose(0.4, {-2.0, 1.3, 13.0}),
                                  tilted_pose(0.4, {1.5, 1.2, 17.0})};
  VehiclePrior prior = shipped_vehicle_prior();
  FrameOfVehicles metres = exact_frame(poses);
  for (std::size_t i = 0; i < poses.size(); ++i) {  // noise, so that all terms disagree
    for (int k = 0; k < kNumKeypoints; ++k) {
      metres.detections[i].keypoints[static_cast<std::size_t>(k)].pixel +=
          Eigen::Vector2d(std::sin(7.0 * k + i), std::cos(5.0 * k));
    }
    metres.supports[i].plane.plane = metres.supports[i].plane.perturbed({0.004, -0.003, 0.02});
  }
  constexpr double kUnit = 100.0;
  FrameOfVehicles centimetres = metres;
  for (SupportPlane& s : centimetres.supports) {
    s.plane.plane.offset *= kUnit;
    s.plane.centroid *= kUnit;
    s.plane.covariance.row(2) *= kUnit;
    s.plane.covariance.col(2) *= kUnit;
  }
  for (ShapePrior& shape : prior.shapes) {
    shape.parameters_mean.head<3>() *= kUnit;
    shape.parameters_covariance.topRows<3>() *= kUnit;
    shape.parameters_covariance.leftCols<3>() *= kUnit;
  }
  JointFitOptions small, large;
  small.function_tolerance = large.function_tolerance = 1e-12;
  large.prior = &prior;
  large.link_reach *= kUnit;
  Weights& w = large.weights;
  for (double* length :
       {&w.keypoint_place, &w.ground, &w.base_point, &w.consistency_offset, &w.continuity}) {
    *length *= kUnit;
  }
  // Of the same starts: where a vehicle is looked for is bounded in metres.
  const std::vector<VehicleStart> starts = starts_of(metres);
  std::vector<VehicleStart> scaled = starts;
  for (VehicleStart& s : scaled) {
    SE3& pose = s.vehicle.pose.camera_from_vehicle;
    pose.set_translation(pose.translation() * kUnit);
    Dimensions& d = s.vehicle.pose.dimensions;
    d = {kUnit * d.length, kUnit * d.width, kUnit * d.height};
    s.vehicle.plane.offset *= kUnit;
  }
  const JointFit a = fit_joint(metres.camera, metres.supports, starts, small);
  const JointFit b = fit_joint(metres.camera, centimetres.supports, scaled, large);
  EXPECT_EQ(a.links, 1);
  EXPECT_EQ(b.links, 1);
  EXPECT_NEAR(a.final_cost, b.final_cost, 1e-6 * a.final_cost);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    EXPECT_LT((a.vehicles[i].pose.center() - b.vehicles[i].pose.center() / kUnit).norm(), 1e-4);
  }
}

TEST(PaperJointFit, IsBetterThanItsStartsAndHonest) {
  // The vehicles stand on planes that have nothing to do with one another.
  JointFitOptions options;
  options.links = PlaneLinks::kNone;
  double joint = 0.0, start = 0.0, covered = 0.0;
  constexpr int kFrames = 20, kVehicles = 5;
  for (int k = 0; k < kFrames; ++k) {
    const FrameOfVehicles f = make_frame({}, k * kVehicles, kVehicles);
    const std::vector<VehicleStart> starts = starts_of(f);
    const JointFit fit = fit_joint(f.camera, f.supports, starts, options);
    for (std::size_t i = 0; i < kVehicles; ++i) {
      joint += center_error(fit.vehicles[i], f.truth[i]) / (kFrames * kVehicles);
      start += center_error(starts[i].vehicle, f.truth[i]) / (kFrames * kVehicles);
      const Eigen::Vector3d d = fit.vehicles[i].pose.center() - f.truth[i].truth.center();
      const Eigen::Matrix3d c = fit.vehicles[i].covariance.topLeftCorner<3, 3>();
      covered += d.dot(c.inverse() * d) < 7.815 ? 1.0 / (kFrames * kVehicles) : 0.0;
    }
  }
  EXPECT_LT(joint, 0.6 * start);
  EXPECT_GT(covered, 0.8);
}

TEST(PaperJointFit, AnalyticAutomaticAndIterativeSolutionsAreOne) {
  const FrameOfVehicles f = make_frame({}, 0, 6);
  JointFitOptions options;
  options.function_tolerance = 1e-9;
  options.max_iterations = 100;
  const JointFit a = solve(f, options);
  EXPECT_EQ(a.solved, 6);
  JointFitOptions automatic = options, iterative = options;
  automatic.analytic = false;
  iterative.solver = LinearSolver::kConjugateGradients;
  for (const JointFitOptions& other : {automatic, iterative}) {
    const JointFit b = solve(f, other);
    EXPECT_NEAR(a.final_cost, b.final_cost, 1e-4 * b.final_cost);
    for (std::size_t i = 0; i < 6; ++i) {
      EXPECT_LT((a.vehicles[i].pose.center() - b.vehicles[i].pose.center()).norm(), 0.02);
    }
  }
}

TEST(PaperJointFit, AlternatingComesNearTheSimultaneousSolution) {
  const FrameOfVehicles f = make_frame({}, 0, 6);
  JointFitOptions options;
  const JointFit all = solve(f, options);
  options.schedule = Schedule::kAlternating;
  options.rounds = 12;
  const JointFit turns = solve(f, options);
  EXPECT_LE(all.final_cost, turns.final_cost * 1.01);
  EXPECT_LT(turns.final_cost, turns.initial_cost);
  EXPECT_LT(turns.final_cost, 1.3 * all.final_cost);
}

TEST(PaperJointFit, HeldPlanesStay) {
  const FrameOfVehicles f = make_frame({}, 10, 4);
  JointFitOptions options;
  options.planes_fixed = true;
  for (const Schedule schedule : {Schedule::kTogether, Schedule::kAlternating}) {
    options.schedule = schedule;
    const JointFit fit = solve(f, options);
    EXPECT_EQ(fit.links, 0);
    for (std::size_t i = 0; i < 4; ++i) {
      EXPECT_EQ(fit.planes[i].offset, f.supports[i].plane.plane.offset);
      EXPECT_EQ(fit.vehicles[i].plane_sigma_height, 0.0);
    }
  }
}

TEST(PaperJointFit, LinksJoinAllNeighboursWithinReach) {
  const std::vector<SE3> poses = {
      tilted_pose(0.0, {-2.0, 1.3, 12.0}), tilted_pose(0.0, {2.0, 1.3, 12.0}),
      tilted_pose(0.0, {-2.0, 1.3, 17.0}), tilted_pose(0.0, {2.0, 1.3, 30.0})};
  const FrameOfVehicles f = exact_frame(poses);
  EXPECT_EQ(solve(f, {}).links, 3);  // 4, 5 and 6.4 m
  JointFitOptions options;
  options.link_reach = 5.5;
  EXPECT_EQ(solve(f, options).links, 2);
  options.links = PlaneLinks::kNone;
  EXPECT_EQ(solve(f, options).links, 0);
}

TEST(PaperJointFit, ConsistencyDrawsAnUncertainPlaneToItsNeighbours) {
  const std::vector<SE3> poses = {tilted_pose(0.0, {-2.0, 1.3, 12.0}),
                                  tilted_pose(0.0, {2.0, 1.3, 12.0})};
  FrameOfVehicles f = exact_frame(poses);
  f.supports[1].plane.covariance = Eigen::Vector3d(1.0, 1.0, 1.0).asDiagonal();
  f.supports[1].plane.plane = f.supports[1].plane.perturbed({0.1, 0.0, 0.0});
  // Its vehicle gives it no direction.
  JointFitOptions linked;
  linked.weights.normal = linked.weights.base_point = 10.0;
  linked.weights.consistency_normal = 0.01;
  JointFitOptions none = linked;
  none.links = PlaneLinks::kNone;
  const auto tilt = [&](const JointFitOptions& options) {
    return angle_between(solve(f, options).planes[1].normal, f.truth[1].true_plane.normal);
  };
  EXPECT_GT(tilt(none), 0.07);
  EXPECT_LT(tilt(linked), 0.02);
}

TEST(PaperJointFit, VehiclesWithoutKeypointsKeepTheirStart) {
  FrameOfVehicles f = make_frame({}, 0, 3);
  f.detections[1].keypoints.clear();
  f.detections[2].box = {10, 10, 10, 10};
  const std::vector<VehicleStart> starts = starts_of(f);
  const JointFit fit = fit_joint(f.camera, f.supports, starts, {});
  EXPECT_EQ(fit.solved, 1);
  EXPECT_EQ(fit.vehicles[1].pose.bottom_center(), starts[1].vehicle.pose.bottom_center());
  EXPECT_EQ(fit.vehicles[1].status, Status::kWeak);
  EXPECT_EQ(fit.vehicles[2].status, Status::kFailed);
  EXPECT_EQ(solve({f.camera, {}, {}, {}}, {}).solved, 0);
}

TEST(PaperJointFit, AnAnswerThatTheHeightInTheImageForbidsIsNotTaken) {
  const FrameOfVehicles f = exact_frame({tilted_pose(0.0, {0.0, 1.3, 20.0})});
  std::vector<VehicleStart> starts = starts_of(f);
  EXPECT_EQ(fit_joint(f.camera, f.supports, starts, {}).vehicles[0].status, Status::kOk);
  // By a box of five times the height it is 4 m away; the keypoints say 20 m.
  starts[0].vehicle.box = starts[0].vehicle.box.scaled(5.0);
  const JointFit fit = fit_joint(f.camera, f.supports, starts, {});
  EXPECT_EQ(fit.vehicles[0].status, Status::kNotObservable);
  EXPECT_EQ(fit.vehicles[0].pose.bottom_center(), starts[0].vehicle.pose.bottom_center());
}

TEST(PaperJointFit, SameBitsAgain) {
  const FrameOfVehicles f = make_frame({}, 0, 5);
  const JointFit a = solve(f, {}), b = solve(f, {});
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(a.vehicles[i].pose.bottom_center(), b.vehicles[i].pose.bottom_center());
    EXPECT_EQ(a.vehicles[i].covariance, b.vehicles[i].covariance);
  }
}

TEST(PaperJointFit, BadInputIsRefused) {
  const FrameOfVehicles f = make_frame({}, 0, 2);
  JointFitOptions options;
  options.num_coefficients = 7;
  EXPECT_THROW(solve(f, options), std::invalid_argument);
  options = {};
  options.weights.ground = 0.0;
  EXPECT_THROW(solve(f, options), std::invalid_argument);
  EXPECT_THROW(fit_joint(f.camera, {}, starts_of(f), {}), std::invalid_argument);
  EXPECT_THROW(starts_on_planes(f.camera, f.detections, {}, {}), std::invalid_argument);
  StartOptions start;
  start.num_headings = 2;
  EXPECT_THROW(starts_on_planes(f.camera, f.detections, f.supports, start), std::invalid_argument);
}

TEST(PaperStart, StandsOnItsPlaneWithTheHeadingOfTheKeypoints) {
  int upright = 0, near = 0;
  constexpr int kCars = 60;
  const FrameOfVehicles f = make_frame({}, 0, kCars);
  const std::vector<VehicleStart> starts = starts_of(f);
  for (std::size_t i = 0; i < kCars; ++i) {
    const VehicleEstimate& e = starts[i].vehicle;
    EXPECT_NEAR(f.supports[i].plane.plane.signed_distance(e.pose.bottom_center()), 0.0, 1e-9);
    const Eigen::Matrix3d r = e.pose.camera_from_vehicle.rotation_matrix();
    EXPECT_LT((r.col(1) - f.supports[i].plane.plane.normal).norm(), 1e-9);
    const Eigen::Matrix3d truth = f.truth[i].truth.camera_from_vehicle.rotation_matrix();
    upright += angle_between(r.col(0), truth.col(0)) < 0.26 ? 1 : 0;
    near += center_error(e, f.truth[i]) < 0.3 * f.truth[i].truth.center().norm() ? 1 : 0;
  }
  EXPECT_GE(upright, 54);  // gross outliers and hidden sides leave a few
  EXPECT_GE(near, 54);
}

TEST(PaperStart, WeighsKeypointsByConfidence) {
  FrameOfVehicles f = make_frame({}, 3, 1);
  std::vector<KeypointObservation>& keypoints = f.detections[0].keypoints;
  for (KeypointObservation& k : keypoints) k.confidence = 0.5;
  const auto count = [&] {
    int seen = 0;
    const std::vector<VehicleStart> starts = starts_of(f);
    for (const WeighedKeypoint& k : starts[0].keypoints) seen += k.seen ? 1 : 0;
    return seen;
  };
  const int all = count();
  EXPECT_GT(all, 8);
  EXPECT_LT(all, kNumKeypoints);  // the far side is hidden
  for (KeypointObservation& k : keypoints) k.confidence = std::nan("");
  EXPECT_EQ(count(), all);
  for (std::size_t i = 1; i < keypoints.size(); ++i) keypoints[i].confidence = 0.01;
  keypoints[0].confidence = 0.5;
  EXPECT_LE(count(), 1);
}

}  // namespace
}  // namespace camber::paper
