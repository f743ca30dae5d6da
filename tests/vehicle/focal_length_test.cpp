#include "camber/vehicle/focal_length.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <stdexcept>

#include "vehicle/simulated_vehicle.h"

namespace camber {
namespace {

/// A street of simulated cars, as it is reconstructed with a focal length that is wrong by a
/// factor: depths are multiplied by it, pixels stay.
FocalLengthEvidence evidence_of_street(double factor, std::uint64_t seed, int threads = 1,
                                       std::optional<double> asked = {}) {
  constexpr std::uint64_t kCars = 6;
  test::SimulationOptions simulation;
  simulation.seed = seed;
  simulation.min_distance = 7.0;
  simulation.max_distance = 17.0;
  PinholeCamera camera;
  std::vector<VehicleDetection> detections;
  std::vector<SupportPlane> supports;
  for (std::uint64_t i = 0; i < kCars; ++i) {
    const test::SimulatedVehicle s = test::simulate_vehicle(simulation, i);
    camera = s.camera;
    detections.push_back(s.detection);
    // n' = (nx, ny, nz / factor): the plane through all points with their depths multiplied.
    SupportPlane support = s.support;
    Plane& plane = support.plane.plane;
    plane.normal.z() /= factor;
    plane.offset /= plane.normal.norm();
    plane.normal.normalize();
    support.plane.centroid.z() *= factor;
    UncertainPlane::make_axes(plane.normal, support.plane.axis1, &support.plane.axis1,
                              &support.plane.axis2);
    supports.push_back(support);
  }
  camera.fx *= factor;
  camera.fy *= factor;
  const std::vector<VehicleEstimate> estimates = fit_vehicles(camera, detections, supports, {}, 1);
  return focal_length_evidence(camera, detections, supports, estimates, {}, threads, asked);
}

TEST(FocalLength, IsFoundWrongByProportions) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const FocalLengthEvidence large = evidence_of_street(2.0, seed);
    EXPECT_GE(large.vehicles, 4);  // twice as far, some are too far with either focal length
    EXPECT_GT(large.gain, 8.8) << seed;
    EXPECT_LT(large.factor, 0.8) << seed;
    const FocalLengthEvidence small = evidence_of_street(0.5, seed);
    EXPECT_GT(small.gain, 8.8) << seed;
    EXPECT_GT(small.factor, 1.25) << seed;
  }
}

TEST(FocalLength, ThatIsRightIsNotContradicted) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    const FocalLengthEvidence sound = evidence_of_street(1.0, seed);
    EXPECT_EQ(sound.vehicles, 6);
    EXPECT_GE(sound.gain, 0.0);
    EXPECT_LT(sound.gain, 6.0) << seed;  // chance alone: 4.5 in one of 370
  }
}

TEST(FocalLength, ThatIsAskedForIsComparedWithTheGivenOne) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    EXPECT_LT(evidence_of_street(1.0, seed, 1, 0.5).log_ratio_of_other, -8.0) << seed;
    EXPECT_GT(evidence_of_street(2.0, seed, 1, 0.5).log_ratio_of_other, 8.0) << seed;
    const FocalLengthEvidence not_asked = evidence_of_street(2.0, seed);
    EXPECT_EQ(not_asked.log_ratio_of_other, 0.0);
  }
}

TEST(FocalLength, OfOneVehicleIsGivenByNoMoreThanAVehicleMay) {
  const test::SimulatedVehicle s = test::simulate_vehicle({}, 0);
  const VehicleEstimate estimate = fit_vehicle(s.camera, s.detection, s.support, {});
  VehicleEstimate unlikely = estimate;
  unlikely.keypoint_cost += 100.0;
  VehicleFitOptions options;
  options.noise.hypotheses.focal_length_farthest = 100.0;
  const FocalLengthEvidence found =
      focal_length_evidence(s.camera, {s.detection}, {s.support}, {unlikely}, options);
  EXPECT_EQ(found.vehicles, 1);
  EXPECT_EQ(found.gain, options.noise.hypotheses.focal_length_most);
}

TEST(FocalLength, IsJudgedAlikeByAnyNumberOfThreads) {
  const FocalLengthEvidence a = evidence_of_street(1.4, 1, 1), b = evidence_of_street(1.4, 1, 4);
  EXPECT_EQ(a.gain, b.gain);
  EXPECT_EQ(a.factor, b.factor);
}

/// What is wrong with the plane under a far vehicle says nothing of the focal length.
TEST(FocalLength, IsNotJudgedByFarVehicles) {
  const test::SimulatedVehicle s = test::simulate_vehicle({}, 0);
  const VehicleEstimate estimate = fit_vehicle(s.camera, s.detection, s.support, {});
  for (const double share : {0.95, 1.05}) {
    VehicleFitOptions options;
    // 0.5 times the focal length brings it to half its depth.
    options.noise.hypotheses.focal_length_farthest = 0.5 * estimate.pose.center().z() / share;
    const FocalLengthEvidence found =
        focal_length_evidence(s.camera, {s.detection}, {s.support}, {estimate}, options);
    EXPECT_EQ(found.vehicles, 0) << share;  // of the factors tried first none brings it so near
    options.noise.hypotheses.focal_length_farthest = estimate.pose.center().z() / share;
    const FocalLengthEvidence near =
        focal_length_evidence(s.camera, {s.detection}, {s.support}, {estimate}, options);
    EXPECT_EQ(near.vehicles, 1) << share;  // 0.7 times it: nearer by as much
  }
}

TEST(FocalLength, IsNotJudgedByKeypointsThatAgreeWithNoPose) {
  const test::SimulatedVehicle s = test::simulate_vehicle({}, 0);
  VehicleDetection mixed_up = s.detection;
  const std::size_t count = mixed_up.keypoints.size();
  for (std::size_t i = 0; i < count; ++i) {
    mixed_up.keypoints[i].pixel = s.detection.keypoints[(7 * i + 5) % count].pixel;
  }
  const VehicleEstimate estimate = fit_vehicle(s.camera, mixed_up, s.support, {});
  EXPECT_TRUE(std::isnan(estimate.keypoint_cost));
  VehicleFitOptions options;
  options.noise.hypotheses.focal_length_farthest = 100.0;
  const FocalLengthEvidence none =
      focal_length_evidence(s.camera, {mixed_up}, {s.support}, {estimate}, options);
  EXPECT_EQ(none.vehicles, 0);
  EXPECT_EQ(none.gain, 0.0);
}

TEST(FocalLength, NeedsVehiclesWithKeypoints) {
  const test::SimulatedVehicle s = test::simulate_vehicle({}, 0);
  VehicleDetection box = s.detection;
  box.keypoints.clear();
  const VehicleEstimate estimate = fit_vehicle(s.camera, box, s.support, {});
  EXPECT_TRUE(std::isnan(estimate.keypoint_cost));
  const FocalLengthEvidence none =
      focal_length_evidence(s.camera, {box}, {s.support}, {estimate}, {});
  EXPECT_EQ(none.vehicles, 0);
  EXPECT_EQ(none.gain, 0.0);
  EXPECT_THROW(focal_length_evidence(s.camera, {box}, {}, {estimate}, {}), std::invalid_argument);
}

}  // namespace
}  // namespace camber
