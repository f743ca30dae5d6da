#include "camber/vehicle/fit_vehicle.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "camber/core/random.h"
#include "camber/vehicle/detail/vehicle_answer.h"
#include "support/test_data.h"
#include "vehicle/simulated_vehicle.h"

namespace camber {
namespace {

using test::simulate_vehicle;
using test::SimulatedVehicle;
using test::SimulationOptions;

double center_error(const VehicleEstimate& estimate, const SimulatedVehicle& truth) {
  return (estimate.pose.center() - truth.truth.center()).norm();
}

bool inside_95(const VehicleEstimate& estimate, const SimulatedVehicle& truth) {
  const Eigen::Vector3d d = estimate.pose.center() - truth.truth.center();
  const Eigen::Matrix3d covariance = estimate.covariance.topLeftCorner<3, 3>();
  return d.dot(covariance.inverse() * d) < 7.815;  // chi-square of 3
}

double yaw_error(const VehicleEstimate& estimate, const SimulatedVehicle& truth) {
  const Eigen::Matrix3d turned = truth.truth.camera_from_vehicle.rotation_matrix().transpose() *
                                 estimate.pose.camera_from_vehicle.rotation_matrix();
  return std::abs(std::atan2(turned(2, 0), turned(0, 0)));
}

struct Population {
  double mean = 0.0, median = 0.0, covered = 0.0;  ///< covered: share inside the 95 % ellipsoid
  int flipped = 0, answered = 0;
};

Population fit_population(const SimulationOptions& simulation, int count,
                          const VehicleFitOptions& options = {}) {
  std::vector<double> errors;
  Population out;
  for (int i = 0; i < count; ++i) {
    const SimulatedVehicle s = simulate_vehicle(simulation, i);
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, options);
    if (e.status == Status::kFailed) continue;
    ++out.answered;
    errors.push_back(center_error(e, s));
    out.mean += errors.back() / count;
    out.flipped += yaw_error(e, s) > 1.57 ? 1 : 0;
    out.covered += inside_95(e, s) ? 1.0 / count : 0.0;
  }
  std::sort(errors.begin(), errors.end());
  out.median = errors.empty() ? 0.0 : errors[errors.size() / 2];
  return out;
}

// A network that states its sigmas: three quarters of its keypoints are far off, and it says so.
TEST(FitVehicle, TakesStatedSigmasInPlaceOfItsOwn) {
  SimulationOptions simulation;
  simulation.confidences = false;
  simulation.gross_share = 0.0;
  simulation.occluded_share = 0.0;
  std::vector<double> without, with;
  double covered = 0.0;
  constexpr int kVehicles = 60;
  for (int i = 0; i < kVehicles; ++i) {
    SimulatedVehicle s = simulate_vehicle(simulation, i);
    const double cell = std::max(s.detection.box.width(), s.detection.box.height()) / 64.0;
    const CounterRandom random(7, 3);
    for (std::size_t k = 0; k < kNumKeypoints; ++k) {
      const double sigma = (k % 4 == 0 ? 0.7 : 7.0) * cell;
      const std::uint64_t draw = 2 * (kNumKeypoints * static_cast<std::uint64_t>(i) + k);
      const auto exact = s.camera.project(s.keypoints[k]);
      ASSERT_TRUE(exact);
      s.detection.keypoints[k].pixel =
          *exact + sigma * Eigen::Vector2d(random.normal(2 * draw), random.normal(2 * draw + 2));
    }
    without.push_back(center_error(fit_vehicle(s.camera, s.detection, s.support, {}), s));
    for (std::size_t k = 0; k < kNumKeypoints; ++k) {
      s.detection.keypoints[k].sigma = (k % 4 == 0 ? 0.7 : 7.0) * cell;
      s.detection.keypoints[k].confidence = k % 4 == 0 ? 0.9 : 0.1;
    }
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    with.push_back(center_error(e, s));
    covered += inside_95(e, s) ? 1.0 / kVehicles : 0.0;
  }
  std::sort(without.begin(), without.end());
  std::sort(with.begin(), with.end());
  EXPECT_LT(with[kVehicles / 2], 0.85 * without[kVehicles / 2]);
  EXPECT_GT(covered, 0.85);
}

/// Errors of the centre of vehicles whose right part is beyond the image's border, where a network
/// puts the keypoints that it has to guess at the border.
struct CutVehicles {
  double error = 0.0;    // m, mean
  double farther = 0.0;  // mean, share of the distance
  int inside95 = 0;
};
constexpr int kCutVehicles = 60;

/// @param stated    the network states its sigmas
/// @param at_border whether the image ends there, so that the cut is seen
CutVehicles fit_cut_vehicles(bool stated, bool at_border) {
  constexpr double kGuessed = 2.0;  // cells
  SimulationOptions simulation;
  simulation.confidences = false;
  simulation.gross_share = 0.0;
  simulation.occluded_share = 0.0;
  CutVehicles out;
  for (int i = 0; i < kCutVehicles; ++i) {
    SimulatedVehicle s = simulate_vehicle(simulation, i);
    Box2& box = s.detection.box;
    const double cell = std::max(box.width(), box.height()) / 64.0;
    const double border = std::floor(box.x2 - 0.3 * box.width()) - 1.0;
    s.camera.width = static_cast<int>(border) + (at_border ? 1 : 20);
    box.x2 = border;
    const CounterRandom random(7, 5);
    for (std::size_t k = 0; k < kNumKeypoints; ++k) {
      const std::uint64_t draw = 4 * (kNumKeypoints * static_cast<std::uint64_t>(i) + k);
      Eigen::Vector2d exact = s.camera.project(s.keypoints[k]).value();
      const bool outside = exact.x() > border;
      exact.x() = std::min(exact.x(), border);
      const double sigma = (s.seen[k] && !outside ? 1.0 : kGuessed) * cell;
      KeypointObservation& keypoint = s.detection.keypoints[k];
      keypoint.pixel =
          exact + sigma * Eigen::Vector2d(random.normal(draw), random.normal(draw + 2));
      if (!stated) continue;
      keypoint.sigma = sigma;
      keypoint.confidence = s.seen[k] && !outside ? 0.9 : 0.1;
    }
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    out.error += center_error(e, s) / kCutVehicles;
    out.farther += (e.pose.center().norm() / s.truth.center().norm() - 1.0) / kCutVehicles;
    out.inside95 += inside_95(e, s);
  }
  return out;
}

TEST(FitVehicle, KeypointsBeyondTheImagesBorderDrawNoVehicleInside) {
  for (const bool stated : {false, true}) {
    const CutVehicles cut = fit_cut_vehicles(stated, true);
    const CutVehicles taken_for_whole = fit_cut_vehicles(stated, false);
    EXPECT_LT(cut.error, 0.5 * taken_for_whole.error);
    EXPECT_LT(std::abs(cut.farther), 0.012);
    EXPECT_GE(cut.inside95, 9 * kCutVehicles / 10);
  }
}

TEST(FitVehicle, AnUnknownSigmaAmongTheStatedOnesLeavesThemUnused) {
  SimulatedVehicle s = simulate_vehicle({}, 3);
  const VehicleEstimate without = fit_vehicle(s.camera, s.detection, s.support, {});
  for (std::size_t k = 1; k < kNumKeypoints; ++k) s.detection.keypoints[k].sigma = 0.1;
  const VehicleEstimate with = fit_vehicle(s.camera, s.detection, s.support, {});
  EXPECT_EQ(with.pose.center(), without.pose.center());
  EXPECT_EQ(with.covariance, without.covariance);
}

TEST(FitVehicle, PlacesCarsAndStatesHowWell) {
  const Population p = fit_population({}, 500);
  EXPECT_EQ(p.answered, 500);
  EXPECT_EQ(p.flipped, 0);
  EXPECT_LT(p.mean, 0.60);    // 0.53 measured; 7 to 45 m away
  EXPECT_LT(p.median, 0.40);  // 0.36 measured
  EXPECT_GT(p.covered, 0.93);
  EXPECT_LE(p.covered, 0.97);
}

// Bodies that the prior's family knows nothing of: annotated cars, scaled to sizes of their own.
TEST(FitVehicle, IsHonestAboutRealShapesToo) {
  CAMBER_REQUIRE_DATA("car-keypoints-36");
  const std::vector<AnnotatedShape> shapes =
      read_annotated_shapes(test::data_dir() / "car-keypoints-36" / "annotated_shapes.csv");
  SimulationOptions simulation;
  simulation.shapes = &shapes;
  const Population p = fit_population(simulation, 1000);
  EXPECT_EQ(p.answered, 1000);
  EXPECT_LE(p.flipped, 2);
  EXPECT_LT(p.mean, 0.80);  // 0.69 measured
  EXPECT_GT(p.covered, 0.93);
  EXPECT_LT(p.covered, 0.97);
}

/// A vehicle that is drawn from the prior, standing on a known plane, its keypoints seen with the
/// errors that the fit expects; no confidences.
SimulatedVehicle drawn_from_the_prior(std::uint64_t index) {
  SimulationOptions options;
  options.plane_sigma_height = 1e-3;
  options.plane_sigma_tilt = 5e-4;
  SimulatedVehicle s = simulate_vehicle(options, index);
  const CounterRandom random(77, index);
  std::uint64_t counter = 0;
  const auto normal = [&](double sigma) { return sigma * random.normal(counter++); };
  const auto uniform = [&] { return random.uniform(counter++); };
  const ShapePrior& prior = shipped_vehicle_prior().shape("car");
  const int count = 3 + VehicleFitOptions().num_coefficients;
  const Eigen::MatrixXd factor =
      prior.parameters_covariance.topLeftCorner(count, count).llt().matrixL();
  Eigen::VectorXd draw(count);
  for (double& v : draw) v = normal(1.0);
  draw = prior.parameters_mean.head(count) + factor * draw;
  s.truth.dimensions = {draw[0], draw[1], draw[2]};
  const KeypointMatrix keypoints =
      prior.keypoints(s.truth.dimensions, {draw.data() + 3, draw.data() + count});
  const auto left = prior.residual_sigma(count - 3);
  const double size = draw.head<3>().sum() / prior.parameters_mean.head<3>().sum();
  const SE3& pose = s.truth.camera_from_vehicle;
  const Eigen::Vector3d eye = pose.inverse().translation();

  std::vector<Eigen::Vector3d> body;
  for (int i = 0; i < kNumKeypoints; ++i) body.push_back(keypoints.col(i));
  for (const int i : {0, 1, 18, 19}) body.emplace_back(keypoints(0, i), 0.0, keypoints(2, i));
  for (const Eigen::Vector3d& share :
       {Eigen::Vector3d(0.5, 0.33, 0.0), Eigen::Vector3d(-0.5, 0.33, 0.0),
        Eigen::Vector3d(-0.05, 1.0, 0.0), Eigen::Vector3d(0.0, 0.45, 0.5),
        Eigen::Vector3d(0.0, 0.45, -0.5)}) {
    body.emplace_back(share.x() * draw[0], share.y() * draw[2], share.z() * draw[1]);
  }
  Box2 box{1e9, 1e9, -1e9, -1e9};
  for (const Eigen::Vector3d& p : body) {
    const Eigen::Vector2d pixel = s.camera.project(pose * p).value();
    box = {std::min(box.x1, pixel.x()), std::min(box.y1, pixel.y()), std::max(box.x2, pixel.x()),
           std::max(box.y2, pixel.y())};
  }
  const double du = std::hypot(0.025 * box.width(), 0.02 * box.height(), 1.0);
  const double dv = std::hypot(0.025 * box.height(), 0.02 * box.height(), 1.0);
  box = Box2{box.x1 + normal(du), box.y1 + normal(dv), box.x2 + normal(du), box.y2 + normal(dv)}
            .clipped(s.camera.width, s.camera.height);
  s.detection.box = box;
  for (int i = 0; i < kNumKeypoints; ++i) {
    const Eigen::Vector3d p = keypoints.col(i);
    const bool seen = uniform() < ((i < 18 ? -1.0 : 1.0) * (eye.z() - p.z()) > 0.0 ? 0.80 : 0.12);
    const double cells = seen ? 1.05 : (uniform() < 0.3 ? 6.0 : 2.6);
    const Eigen::Vector3d x = pose * p;
    const double off = size * std::sqrt(left.col(i % 18).squaredNorm() / 3.0) / x.z();
    s.detection.keypoints[i].pixel =
        s.camera.project(x).value() +
        Eigen::Vector2d(std::hypot(off * s.camera.fx, cells * box.width() / 64.0) * normal(1.0),
                        std::hypot(off * s.camera.fy, cells * box.height() / 64.0) * normal(1.0));
    s.detection.keypoints[i].confidence = std::nan("");
  }
  return s;
}

// The maximum over pose and shape together is 0.7 % too near and 1.5 % too high (-0.25 standard
// deviations in the mean).
TEST(FitVehicle, PlacesVehiclesOfThePriorNeitherTooNearNorTooFar) {
  double along = 0.0, height = 0.0;
  constexpr int kCount = 1000;  // the mean of `along` is known to 0.03
  for (int i = 0; i < kCount; ++i) {
    const SimulatedVehicle s = drawn_from_the_prior(i);
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    ASSERT_NE(e.status, Status::kFailed);
    const Eigen::Vector3d ray = s.truth.center().normalized();
    along += ray.dot(e.pose.center() - s.truth.center()) /
             std::sqrt(ray.dot(e.covariance.topLeftCorner<3, 3>() * ray)) / kCount;
    height += (e.pose.dimensions.height / s.truth.dimensions.height - 1.0) / kCount;
  }
  EXPECT_NEAR(along, 0.0, 0.12);
  EXPECT_NEAR(height, 0.0, 0.010);
}

TEST(FitVehicle, WithoutConfidencesAsGood) {
  SimulationOptions simulation;
  simulation.confidences = false;
  const Population p = fit_population(simulation, 150);
  EXPECT_EQ(p.flipped, 0);
  EXPECT_LT(p.mean, 0.65);
}

TEST(FitVehicle, MeaninglessConfidencesDoNoHarm) {
  double with_noise = 0.0, without = 0.0;
  for (int i = 0; i < 100; ++i) {
    SimulatedVehicle s = simulate_vehicle({}, i);
    for (KeypointObservation& k : s.detection.keypoints) k.confidence = std::nan("");
    without += center_error(fit_vehicle(s.camera, s.detection, s.support, {}), s) / 100;
    const CounterRandom random(7, i);
    for (int j = 0; j < kNumKeypoints; ++j) {
      s.detection.keypoints[j].confidence = random.uniform(j, -3.0, 5.0);
    }
    with_noise += center_error(fit_vehicle(s.camera, s.detection, s.support, {}), s) / 100;
  }
  EXPECT_LT(with_noise, 1.1 * without);
}

TEST(FitVehicle, StandsManyGrossErrors) {
  SimulationOptions simulation;
  simulation.gross_share = 0.30;
  const Population p = fit_population(simulation, 150);
  EXPECT_LE(p.flipped, 2);
  EXPECT_LT(p.median, 0.45);
}

TEST(FitVehicle, TwentyGrossErrorsOfThirtySixAreSurvivedOrSaid) {
  int right_or_reported = 0;
  for (int i = 0; i < 60; ++i) {
    SimulatedVehicle s = simulate_vehicle({}, i);
    const CounterRandom random(99, i);
    for (int j = 0; j < 20; ++j) {
      const int k = static_cast<int>((5 * j + i) % kNumKeypoints);
      const Box2& b = s.detection.box;
      s.detection.keypoints[k].pixel = {random.uniform(2 * j, b.x1, b.x2),
                                        random.uniform(2 * j + 1, b.y1, b.y2)};
    }
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    ASSERT_NE(e.status, Status::kFailed);
    const bool right = center_error(e, s) < 0.1 * s.truth.center().norm() && yaw_error(e, s) < 0.35;
    right_or_reported += right || e.status != Status::kOk ? 1 : 0;
  }
  EXPECT_GE(right_or_reported, 55);
}

TEST(FitVehicle, FourteenKeypointsMissing) {
  for (int i = 0; i < 30; ++i) {
    SimulatedVehicle s = simulate_vehicle({}, i);
    for (int j = 0; j < 14; ++j) {
      s.detection.keypoints[(j * 7 + i) % kNumKeypoints].pixel =
          Eigen::Vector2d::Constant(std::nan(""));
    }
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    EXPECT_LT(center_error(e, s), 0.12 * s.truth.center().norm()) << i;
    EXPECT_LT(yaw_error(e, s), 0.3) << i;
  }
}

TEST(FitVehicle, SmallKeypointSet) {
  VehicleFitOptions options;
  options.keypoint_set = KeypointSet::kSmall14;
  const Population p = fit_population({}, 150, options);
  EXPECT_LE(p.flipped, 1);
  EXPECT_LT(p.median, 0.55);
}

TEST(FitVehicle, OneKeypointOrNoneFallsBackToTheBox) {
  std::vector<double> relative;
  for (int i = 0; i < 60; ++i) {
    SimulatedVehicle s = simulate_vehicle({}, i);
    VehicleDetection one = s.detection;
    for (int j = 1; j < kNumKeypoints; ++j) {
      one.keypoints[j].pixel = Eigen::Vector2d::Constant(std::nan(""));
    }
    const VehicleEstimate by_one = fit_vehicle(s.camera, one, s.support, {});
    EXPECT_EQ(by_one.status, Status::kNotObservable);
    EXPECT_FALSE(by_one.reason.empty());
    VehicleDetection none = s.detection;
    none.keypoints.clear();
    const VehicleEstimate by_box = fit_vehicle(s.camera, none, s.support, {});
    EXPECT_EQ(by_box.status, Status::kWeak);
    EXPECT_LT((by_box.pose.center() - by_one.pose.center()).norm(), 1e-9);
    relative.push_back(center_error(by_box, s) / s.truth.center().norm());
    EXPECT_TRUE(by_box.covariance.allFinite());
  }
  std::sort(relative.begin(), relative.end());
  EXPECT_LT(relative[30], 0.06);
  EXPECT_LT(relative[54], 0.15);
}

TEST(FitVehicle, TrucksArePlacedByTheirBoxAndSize) {
  SimulatedVehicle s = simulate_vehicle({}, 3);
  OrientedBox truck;
  truck.dimensions = {8.0, 2.5, 3.3};
  const Eigen::Vector3d foot(-2.0, 1.6, 25.0);
  truck.camera_from_vehicle = SE3(rotation_from_rotation_y(-1.4), foot);
  s.support.plane.plane = {{0.0, -1.0, 0.0}, 1.6};
  s.support.plane.centroid = foot;
  UncertainPlane::make_axes({0.0, -1.0, 0.0}, {0.0, 0.0, 1.0}, &s.support.plane.axis1,
                            &s.support.plane.axis2);
  s.detection.vehicle_class = "Truck";
  Box2 box{1e9, 1e9, -1e9, -1e9};
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector2d p = s.camera.project(truck.corners().col(i)).value();
    box = {std::min(box.x1, p.x()), std::min(box.y1, p.y()), std::max(box.x2, p.x()),
           std::max(box.y2, p.y())};
  }
  s.detection.box = box;
  const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
  EXPECT_EQ(e.status, Status::kWeak);  // its keypoints are not a truck's
  EXPECT_NEAR(e.pose.dimensions.height, 3.3, 0.5);
  EXPECT_LT((e.pose.center() - truck.center()).norm(), 2.5);  // of 25 m
}

TEST(FitVehicle, ABoxOnALampPostIsNotTrusted) {
  for (int i = 0; i < 20; ++i) {
    SimulatedVehicle s = simulate_vehicle({}, i);
    const Eigen::Vector2d c = s.detection.box.center();
    const double h = std::max(s.detection.box.height(), 30.0);
    s.detection.box = {c.x() - 0.06 * h, c.y() - h, c.x() + 0.06 * h, c.y() + 0.5 * h};
    const CounterRandom random(5, i);
    for (int j = 0; j < kNumKeypoints; ++j) {
      const Box2& b = s.detection.box;
      s.detection.keypoints[j] = {
          {random.uniform(3 * j, b.x1, b.x2), random.uniform(3 * j + 1, b.y1, b.y2)},
          random.uniform(3 * j + 2)};
    }
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    EXPECT_EQ(e.status, Status::kNotObservable) << i << " " << e.reason;
  }
}

TEST(FitVehicle, AWrongPlaneIsReported) {
  int right_or_reported = 0;
  for (int i = 0; i < 60; ++i) {
    SimulationOptions simulation;
    simulation.max_distance = 25.0;
    SimulatedVehicle s = simulate_vehicle(simulation, i);
    UncertainPlane& plane = s.support.plane;
    plane.plane = plane.perturbed({0.17, 0.0, 0.3});  // 10 degrees off and a kerb's height up
    UncertainPlane::make_axes(plane.plane.normal, {0, 0, 1}, &plane.axis1, &plane.axis2);
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    const bool right = center_error(e, s) < 0.1 * s.truth.center().norm();
    right_or_reported += right || e.status != Status::kOk ? 1 : 0;
  }
  EXPECT_GE(right_or_reported, 57);
}

// One fault at a time: ten degrees along or across the view, a kerb up or down, a wall taken for
// the ground.
TEST(FitVehicle, AKerbASlopeOrAWallForAPlaneIsRightOrReported) {
  const Eigen::Vector3d faults[] = {
      {0.17, 0.0, 0.0}, {0.0, 0.17, 0.0}, {0.0, 0.0, 0.14}, {0.0, 0.0, -0.14}, {0.0, 1.4, 0.0}};
  for (const Eigen::Vector3d& fault : faults) {
    int right_or_reported = 0;
    for (int i = 0; i < 30; ++i) {
      SimulationOptions simulation;
      simulation.max_distance = 25.0;
      SimulatedVehicle s = simulate_vehicle(simulation, i);
      UncertainPlane& plane = s.support.plane;
      plane.plane = plane.perturbed(fault);
      UncertainPlane::make_axes(plane.plane.normal, {0, 0, 1}, &plane.axis1, &plane.axis2);
      const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
      const bool right = center_error(e, s) < 0.1 * s.truth.center().norm();
      right_or_reported += right || e.status != Status::kOk ? 1 : 0;
    }
    EXPECT_GE(right_or_reported, 27) << fault.transpose();  // 27 to 30 measured
  }
}

// A network that takes the left for the right: every keypoint carries its mirror's place.
TEST(FitVehicle, SwappedLeftAndRightAreRightOrReported) {
  int right_or_reported = 0;
  for (int i = 0; i < 60; ++i) {
    SimulatedVehicle s = simulate_vehicle({}, i);
    for (int j = 0; j < kNumKeypoints / 2; ++j) {
      std::swap(s.detection.keypoints[j], s.detection.keypoints[j + kNumKeypoints / 2]);
    }
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    ASSERT_NE(e.status, Status::kFailed);
    const bool right = center_error(e, s) < 0.1 * s.truth.center().norm() && yaw_error(e, s) < 0.35;
    right_or_reported += right || e.status != Status::kOk ? 1 : 0;
  }
  EXPECT_GE(right_or_reported, 54);
}

// However well the keypoints are known, the box's middle is off theirs by a share of its sides.
TEST(FitVehicle, StatesWhatThePriorDoesNotKnowOfTheBoxsMiddle) {
  internal::Form form;
  form.size = {4.5, 1.8, 1.5};
  internal::ViewPose pose;
  pose.rotation = rotation_from_vector({0.2, 0.7, -0.1}).toRotationMatrix();
  const auto c = internal::report_covariance(pose, form, Eigen::MatrixXd::Zero(9, 9), {});
  const Eigen::Matrix3d own = pose.rotation.transpose() * c.topLeftCorner<3, 3>() * pose.rotation;
  EXPECT_LT((own.diagonal().cwiseSqrt() - 0.004 * Eigen::Vector3d(4.5, 1.5, 1.8)).norm(), 1e-12);
  EXPECT_NEAR(c.norm(), own.diagonal().norm(), 1e-12);
}

// Mean shapes alone call one of them mirrored and turn it round.
TEST(FitVehicle, FarVehiclesKeepTheirNamesAndHeadings) {
  SimulationOptions far;
  far.min_distance = 30.0;
  far.max_distance = 60.0;
  far.plane_sigma_height = 0.3;
  for (int i = 0; i < 600; ++i) {
    const SimulatedVehicle s = simulate_vehicle(far, i);
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    if (!std::isfinite(e.reprojection_rmse_px)) continue;
    EXPECT_LT(yaw_error(e, s), 1.5) << i << " " << e.reason;
  }
}

TEST(FitVehicle, ACarCutByTheImagesEdge) {
  SimulationOptions near;
  near.min_distance = 5.0;
  near.max_distance = 9.0;
  near.occluded_share = 0.0;
  int cut = 0, right_or_reported = 0;
  std::vector<double> relative;
  for (int i = 0; i < 200; ++i) {
    SimulatedVehicle s = simulate_vehicle(near, i);
    // Turn the camera until 25 to 55 % of the car is outside on the left.
    const Box2& b = s.detection.box;
    const double share = 0.25 + 0.3 * (i % 10) / 10.0;
    const double shift = b.x1 + share * b.width();
    if (!(shift > 0.0)) continue;
    const SE3 turned(rotation_from_vector({0.0, -std::atan(shift / s.camera.fx), 0.0}),
                     Eigen::Vector3d::Zero());
    s = test::seen_again(s, near, static_cast<std::uint64_t>(i), 1, turned, 0.0);
    if (!(s.detection.box.x1 <= 1.0) || !(s.detection.box.width() > 30.0)) continue;
    ++cut;
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    relative.push_back(center_error(e, s) / s.truth.center().norm());
    right_or_reported += relative.back() < 0.12 || e.status != Status::kOk ? 1 : 0;
  }
  ASSERT_GE(cut, 60);
  std::sort(relative.begin(), relative.end());
  EXPECT_LT(relative[relative.size() / 2], 0.05);
  EXPECT_GE(right_or_reported, cut * 95 / 100);
}

TEST(FitVehicle, TwoDetectionsOfOneCarAgree) {
  for (int i = 0; i < 30; ++i) {
    const SimulatedVehicle s = simulate_vehicle({}, i);
    const SimulatedVehicle again =
        test::seen_again(s, {}, static_cast<std::uint64_t>(i), 3, SE3(), 0.0);
    const auto both =
        fit_vehicles(s.camera, {s.detection, again.detection}, {s.support, s.support}, {}, 1);
    const Eigen::Vector3d d = both[0].pose.center() - both[1].pose.center();
    const Eigen::Matrix3d c =
        both[0].covariance.topLeftCorner<3, 3>() + both[1].covariance.topLeftCorner<3, 3>();
    EXPECT_LT(d.dot(c.inverse() * d), 21.1) << i;  // 4 sigma, three degrees of freedom
  }
}

// What a plane's covariance leaves out is in what is stated, as far as it moves the answer: the
// change of one that stands on a plane raised by as much.
TEST(FitVehicle, StatesWhatThePlanesCovarianceLeavesOut) {
  SimulationOptions simulation;
  simulation.gross_share = 0.0;
  constexpr double kLeftOut = 0.05;  // m
  int compared = 0, agreed = 0;
  for (int i = 0; i < 40; ++i) {
    const SimulatedVehicle s = simulate_vehicle(simulation, i);
    const VehicleEstimate without = fit_vehicle(s.camera, s.detection, s.support, {});
    SupportPlane support = s.support;
    support.unmodelled_height = kLeftOut;
    const VehicleEstimate with = fit_vehicle(s.camera, s.detection, support, {});
    EXPECT_TRUE(with.pose.center() == without.pose.center()) << i;
    if (without.status != Status::kOk || with.status != Status::kOk) continue;

    constexpr double kStep = 0.002;  // m; beyond it the plane's robust cost is no parabola
    SupportPlane raised = s.support;
    raised.plane.plane = s.support.plane.perturbed({0.0, 0.0, kStep});
    raised.plane.centroid = raised.plane.plane.foot(s.support.plane.centroid);
    const VehicleEstimate moved = fit_vehicle(s.camera, s.detection, raised, {});
    const Eigen::Vector3d change = kLeftOut / kStep * (moved.pose.center() - without.pose.center());
    const Eigen::Matrix3d added = (with.covariance - without.covariance).topLeftCorner<3, 3>();
    EXPECT_GT(with.plane_sigma_height, without.plane_sigma_height) << i;
    if (change.norm() < 0.2) continue;  // the start's own steps are seen
    ++compared;
    const Eigen::Vector3d along = change.normalized();
    const bool as_far = std::abs(std::sqrt(added.trace()) - change.norm()) < 0.2 * change.norm();
    agreed += as_far && along.dot(added * along) > 0.95 * added.trace() ? 1 : 0;
  }
  // A fit decides anew which keypoints were seen, so that a few answers jump.
  EXPECT_GT(compared, 15);
  EXPECT_GT(agreed, 0.8 * compared) << compared;
}

// The vehicle stands on the ground: the ground below it is known better with it than without.
TEST(FitVehicle, MeasuresTheGroundBelowIt) {
  SimulationOptions options;
  options.plane_sigma_height = 0.15;
  options.plane_sigma_tilt = 0.02;
  std::vector<double> before, after;
  double inside = 0.0;
  constexpr int kCount = 300;
  for (int i = 0; i < kCount; ++i) {
    const SimulatedVehicle s = simulate_vehicle(options, i);
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    const Eigen::Vector3d contact = s.true_plane.foot(s.truth.bottom_center());
    before.push_back(std::abs(s.support.plane.plane.signed_distance(contact)));
    after.push_back(std::abs(e.plane.signed_distance(contact)));
    inside += after.back() < 1.96 * e.plane_sigma_height ? 1.0 / kCount : 0.0;
  }
  std::sort(before.begin(), before.end());
  std::sort(after.begin(), after.end());
  EXPECT_LT(after[kCount / 2], 0.7 * before[kCount / 2]);
  EXPECT_LT(after[kCount * 9 / 10], 0.7 * before[kCount * 9 / 10]);
  EXPECT_GT(inside, 0.90);
}

// The vehicle stands on the plane that is stated: where it truly stands the plane is known no
// better than the vehicle's place across it, however little was known of the ground before.
TEST(FitVehicle, KnowsTheGroundNoBetterThanItsPlaceAcrossIt) {
  SimulationOptions options;
  options.min_distance = 20.0;
  options.plane_sigma_height = 0.4;
  options.plane_sigma_tilt = 0.07;
  for (int i = 0; i < 50; ++i) {
    const SimulatedVehicle s = simulate_vehicle(options, i);
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    const Eigen::Matrix3d place = e.covariance.topLeftCorner<3, 3>();
    const double across = e.plane.normal.dot(place * e.plane.normal);
    EXPECT_GT(e.plane_sigma_height, 0.999 * std::sqrt(across)) << i;
  }
}

TEST(FitVehicle, NearAndFar) {
  SimulationOptions near;
  near.min_distance = 3.0;
  near.max_distance = 4.5;
  for (int i = 0; i < 20; ++i) {
    const SimulatedVehicle s = simulate_vehicle(near, i);
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    EXPECT_TRUE(center_error(e, s) < 0.6 || e.status != Status::kOk)
        << i << " " << center_error(e, s) << " " << e.reason;
  }
  SimulationOptions far;
  far.min_distance = 78.0;
  far.max_distance = 82.0;
  for (int i = 0; i < 20; ++i) {
    const SimulatedVehicle s = simulate_vehicle(far, i);
    const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
    const Eigen::Vector3d d = e.pose.center() - s.truth.center();
    const Eigen::Matrix3d covariance = e.covariance.topLeftCorner<3, 3>();
    EXPECT_LT(d.dot(covariance.inverse() * d), 25.0) << i;
  }
}

TEST(FitVehicle, SameInputSameBitsForAnyNumberOfThreads) {
  std::vector<VehicleDetection> detections;
  std::vector<SupportPlane> supports;
  PinholeCamera camera;
  for (int i = 0; i < 12; ++i) {
    const SimulatedVehicle s = simulate_vehicle({}, i);
    camera = s.camera;
    detections.push_back(s.detection);
    supports.push_back(s.support);
  }
  const auto one = fit_vehicles(camera, detections, supports, {}, 1);
  const auto four = fit_vehicles(camera, detections, supports, {}, 4);
  ASSERT_EQ(one.size(), four.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].id, detections[i].id);
    EXPECT_EQ(one[i].pose.bottom_center(), four[i].pose.bottom_center());
    EXPECT_EQ(one[i].covariance, four[i].covariance);
  }
}

TEST(FitVehicle, BadInputIsRejectedOrReported) {
  SimulatedVehicle s = simulate_vehicle({}, 0);
  VehicleDetection bad = s.detection;
  bad.keypoints.resize(12);
  EXPECT_THROW(fit_vehicle(s.camera, bad, s.support, {}), std::invalid_argument);
  bad = s.detection;
  bad.box.x2 = bad.box.x1;
  EXPECT_EQ(fit_vehicle(s.camera, bad, s.support, {}).status, Status::kFailed);
  bad.box.x2 = std::nan("");
  EXPECT_EQ(fit_vehicle(s.camera, bad, s.support, {}).status, Status::kFailed);
  VehicleFitOptions options;
  options.keypoint_set = static_cast<KeypointSet>(20);
  EXPECT_THROW(fit_vehicle(s.camera, s.detection, s.support, options), std::invalid_argument);
  options = {};
  options.noise.keypoint.cell_share = 0.0;
  EXPECT_THROW(fit_vehicle(s.camera, s.detection, s.support, options), std::invalid_argument);
  EXPECT_THROW(fit_vehicles(s.camera, {s.detection}, {}, {}), std::invalid_argument);
}

// Every field has its bound, and the message names it.
TEST(VehicleNoise, ImpossibleValuesAreRejectedByName) {
  const std::pair<const char*, void (*)(VehicleNoise*)> faults[] = {
      {"keypoint.cell_share: 1, must be in (0, 1)",
       [](VehicleNoise* n) { n->keypoint.cell_share = 1; }},
      {"keypoint.gross_share: 0", [](VehicleNoise* n) { n->keypoint.gross_share = 0; }},
      {"keypoint.seen: -1, must be > 0", [](VehicleNoise* n) { n->keypoint.seen = -1; }},
      {"keypoint.adapt_max: 0.5, must be >= keypoint.adapt_min",
       [](VehicleNoise* n) { n->keypoint.adapt_max = 0.5; }},
      {"box.side_share: nan", [](VehicleNoise* n) { n->box.side_share = std::nan(""); }},
      {"box.body_share: -0.1, must be >= 0", [](VehicleNoise* n) { n->box.body_share = -0.1; }},
      {"contact.sigma_tilt: 0", [](VehicleNoise* n) { n->contact.sigma_tilt = 0; }},
      {"motion.acceleration: 0", [](VehicleNoise* n) { n->motion.acceleration = 0; }},
      {"registration.min_correlation: 1",
       [](VehicleNoise* n) { n->registration.min_correlation = 1; }},
      {"hypotheses.start_scales[1]: 0", [](VehicleNoise* n) { n->hypotheses.start_scales[1] = 0; }},
      {"answer.relative_sigma: 0", [](VehicleNoise* n) { n->answer.relative_sigma = 0; }},
      {"association.overlap: 0", [](VehicleNoise* n) { n->association.overlap = 0; }},
      {"message.gate: 0", [](VehicleNoise* n) { n->message.gate = 0; }}};
  EXPECT_NO_THROW(VehicleNoise().validate());
  for (const auto& [message, fault] : faults) {
    VehicleFitOptions options;
    fault(&options.noise);
    try {
      options.validate();
      ADD_FAILURE() << message;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).rfind(message, 0), 0u) << error.what();
    }
  }
}

TEST(FitVehicle, AnUnobservablePlaneIsPassedOn) {
  SimulatedVehicle s = simulate_vehicle({}, 1);
  s.support.status = Status::kNotObservable;
  const VehicleEstimate e = fit_vehicle(s.camera, s.detection, s.support, {});
  EXPECT_EQ(e.status, Status::kNotObservable);
  EXPECT_FALSE(e.reason.empty());
}

}  // namespace
}  // namespace camber
