#include "camber/pipeline/lift_box.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/random.h"
#include "camber/vehicle/shape_prior.h"

namespace camber {
namespace {

using testing::HasSubstr;

constexpr double kPi = 3.14159265358979323846;
const KittiCalibration::Camera kCamera{721.5377, 721.5377, 609.5593, 172.854, {0.06, 0.0, 0.003}};

/// A plane that climbs ahead with `grade` and banks, 1.6 m below the camera, known to `sigma`.
RoadSurface slope(double grade, double bank, double sigma) {
  RoadSurface out;
  PlanePatch patch;
  patch.id = 7;
  patch.status = Status::kOk;
  const Eigen::Vector3d up = Eigen::Vector3d(std::tan(bank), -1.0, -std::tan(grade)).normalized();
  patch.plane.plane = Plane::through({0.0, 1.6, 0.0}, up);
  patch.plane.centroid = patch.plane.plane.intersect_ray({0.0, 1.6 - 30 * std::tan(grade), 30.0})
                             .value_or(Eigen::Vector3d(0, 1.6, 30));
  UncertainPlane::make_axes(up, {0, 0, 1}, &patch.plane.axis1, &patch.plane.axis2);
  patch.plane.covariance = Eigen::Vector3d(1e-6, 1e-6, sigma * sigma).asDiagonal();
  for (const auto& [x, z] : {std::pair{-30.0, 2.0}, std::pair{30.0, 2.0}, std::pair{30.0, 70.0},
                             std::pair{-30.0, 70.0}}) {
    const Eigen::Vector3d n = up;
    const double y = -(n.x() * x + n.z() * z + patch.plane.plane.offset) / n.y();
    patch.boundary.emplace_back(x, y, z);
  }
  out.patches.push_back(patch);
  return out;
}

/// A car by its box's middle in the camera, without a 2D box.
KittiLabel car_at(const Eigen::Vector3d& middle, double rotation_y = -kPi / 2) {
  KittiLabel out;
  out.frame = 3;
  out.track = 1;
  out.truncated = 0;
  out.height = 1.5;
  out.width = 1.7;
  out.length = 4.2;
  out.location = middle + Eigen::Vector3d(0, 0.75, 0) - kCamera.offset;
  out.rotation_y = rotation_y;
  return out;
}

/// The upright 3D box of a row as it is seen.
Box2 seen(const KittiLabel& label) {
  const OrientedBox box{
      SE3(rotation_from_rotation_y(label.rotation_y), label.location + kCamera.offset),
      {label.length, label.width, label.height}};
  const auto corners = box.corners();
  Box2 out{1e9, 1e9, -1e9, -1e9};
  for (int i = 0; i < 8; ++i) {
    const double u = kCamera.fx * corners(0, i) / corners(2, i) + kCamera.cx;
    const double v = kCamera.fy * corners(1, i) / corners(2, i) + kCamera.cy;
    out = {std::min(out.x1, u), std::min(out.y1, v), std::max(out.x2, u), std::max(out.y2, v)};
  }
  return out;
}

/// The row at `factor` times its distance along the ray of its middle; its 2D box stays.
KittiLabel moved(const KittiLabel& label, double factor) {
  const Eigen::Vector3d half(0, 0.5 * label.height, 0);
  KittiLabel out = label;
  out.location = factor * (label.location + kCamera.offset - half) + half - kCamera.offset;
  return out;
}

/// A car that stands on the level road at a distance, with its 2D box.
KittiLabel standing_at(double depth) {
  KittiLabel out = car_at({1.0, 1.6 - 0.75, depth});
  out.box = seen(out);
  return out;
}

double distance(const KittiLabel& label) { return label.location.z() + kCamera.offset.z(); }

TEST(LiftBox, ABoxOnTheRoadTakesItsTiltAndStays) {
  const double grade = 0.12, bank = 0.05;
  const RoadSurface surface = slope(grade, bank, 0.02);
  const Plane& plane = surface.patches[0].plane.plane;
  const Eigen::Vector3d foot = plane.foot({2.0, 0.0, 20.0});
  const KittiLabel label = car_at(foot + 0.75 * plane.normal);  // heads ahead
  LiftOptions options;
  options.size_sigma = 1e-6;
  const LiftedBox lifted = lift_box(label, surface, SE3(), kCamera, options);
  EXPECT_EQ(lifted.status, Status::kOk);
  EXPECT_EQ(lifted.sources(), "detector+surface");
  EXPECT_EQ(lifted.patch, 7);
  EXPECT_NEAR(lifted.depth_factor, 1.0, 1e-6);
  // The tilt's prior draws it to the level by 1e-6 / 0.15^2 of it.
  EXPECT_LT((lifted.label.location + kCamera.offset - foot).norm(), 1e-4);
  EXPECT_NEAR(lifted.tilt.pitch, grade, 2e-3);  // it heads straight up the slope
  EXPECT_NEAR(std::abs(lifted.tilt.roll), bank, 2e-3);
  EXPECT_EQ(lifted.label.rotation_y, label.rotation_y);
  const Eigen::Matrix3d r = rotation_of(label.rotation_y, lifted.tilt);
  EXPECT_LT((r.col(1) - plane.normal).norm(), 1e-4);
}

TEST(LiftBox, SurfaceAndDetectorAreWeighedByTheirVariances) {
  for (const double sigma : {0.01, 0.3, 5.0}) {
    const RoadSurface surface = slope(0.0, 0.0, sigma);
    const Eigen::Vector3d middle(1.0, 1.6 - 0.75, 25.0);
    const KittiLabel label = car_at(1.1 * middle, 0.5);  // 10 % too far along the ray
    LiftOptions options;
    options.height_sigma = options.pixel_sigma = 0.0;
    options.size_sigma = 1e-6;
    const LiftedBox lifted = lift_box(label, surface, SE3(), kCamera, options);
    // By hand: the bottom is 0.1 * 0.85 m below the road and rises by 0.935 m per unit of the
    // logarithm of the distance.
    const double fall = 1.1 * 0.85, r = std::pow(surface.query(1.1 * middle).sigma_height, 2);
    const double p = 0.08 * 0.08, gain = p * fall / (fall * fall * p + r);
    EXPECT_NEAR(lifted.depth_factor, 1.0 - gain * 0.1 * 0.85, 0.01) << sigma;
    EXPECT_NEAR(lifted.sigma_depth, std::sqrt((1.0 - gain * fall) * p) * 1.1 * middle.norm(),
                0.1 * 0.08 * middle.norm())
        << sigma;
    const double above =
        surface.patches[0].plane.plane.signed_distance(lifted.label.location + kCamera.offset);
    if (sigma < 0.02) {
      EXPECT_NEAR(above, 0.0, 0.005);
    }
    // A surface that knows nothing moves nothing, upwards neither.
    if (sigma > 4.0) {
      EXPECT_NEAR(above, -0.085, 0.001);
    }
  }
}

TEST(LiftBox, TheHeightOfThe2dBoxIsWeighedByItsSidesAndTheSize) {
  KittiLabel truth = car_at({1.0, 0.85, 25.0});
  truth.length = truth.width = 0.3;
  truth.box = seen(truth);
  LiftOptions options;
  options.box_share = 0.0;
  options.aspect_tolerance = 0.5;
  options.pixel_sigma = 100.0;  // the row of the middle is free
  for (const double size_sigma : {1e-4, 0.03}) {
    options.size_sigma = size_sigma;
    KittiLabel label = moved(truth, 1.1);
    label.type = "Tram";  // its size prior, 3.45 m, contradicts: the detector's height alone
    const LiftedBox lifted = lift_box(label, {}, std::nullopt, kCamera, options);
    EXPECT_EQ(lifted.sources(), "detector+box");
    EXPECT_EQ(lifted.status, Status::kWeak);
    EXPECT_THAT(lifted.reason, HasSubstr("no frame 3"));
    // By hand: 43.3 px high, so the logarithm of the distance is known to sqrt(2) / 43.3, and the
    // size.
    const double box = std::hypot(std::sqrt(2.0) / (kCamera.fy * 1.5 / 25.0), size_sigma);
    const double share = 0.0064 / (0.0064 + box * box);
    EXPECT_NEAR(lifted.depth_factor, std::pow(1.1, -share), 0.004) << size_sigma;
    EXPECT_NEAR(lifted.sigma_depth, 0.08 * std::sqrt(1.0 - share) * 25.6, 0.08) << size_sigma;
    EXPECT_EQ(lifted.tilt.pitch, 0.0);
  }
}

TEST(LiftBox, TheSizePriorOfTheClassJoinsTheDetectorsHeight) {
  const SizePrior prior = shipped_vehicle_prior().size("car");
  KittiLabel label = standing_at(30.0);
  label.height = prior.mean[2] * 1.1;  // somewhat high
  const double wide = 0.5;             // the detector's height is hardly known
  LiftOptions options;
  options.size_sigma = wide;
  options.depth_sigma = 0.5;
  options.aspect_tolerance = 0.5;
  label.box = seen(label);
  const LiftedBox lifted = lift_box(label, {}, std::nullopt, kCamera, options);
  EXPECT_NEAR(lifted.depth_factor, 1.0 / 1.1, 0.03);  // the car is of the mean height, so nearer
}

TEST(LiftBox, A2dBoxThatContradictsIsLeftOut) {
  const RoadSurface surface = slope(0.0, 0.0, 0.01);
  KittiLabel label = standing_at(20.0);
  const Box2 right = label.box;
  label.box = right.scaled(0.6);
  const LiftedBox lifted = lift_box(label, surface, SE3(), kCamera, {});
  EXPECT_EQ(lifted.sources(), "detector+surface");
  EXPECT_THAT(lifted.reason, HasSubstr("the 2D box contradicts by "));
  EXPECT_NEAR(lifted.depth_factor, 1.0, 0.02);
  // Without a surface nobody decides: the row stays, with a standard deviation up to the box.
  const LiftedBox alone = lift_box(label, surface, std::nullopt, kCamera, {});
  EXPECT_EQ(alone.status, Status::kFailed);
  EXPECT_EQ(alone.label.location, label.location);
  EXPECT_GT(alone.sigma_depth, 0.4 * 20.0);
  // A box that is cut has another form.
  label.box = {right.x1, right.y1, right.x1 + 0.6 * right.width(), right.y2};
  EXPECT_EQ(lift_box(label, surface, SE3(), kCamera, {}).sources(), "detector+surface");
  label.box = right;
  label.truncated = 0.4;
  EXPECT_EQ(lift_box(label, surface, SE3(), kCamera, {}).sources(), "detector+surface");
  label.truncated = 0.0;
  EXPECT_EQ(lift_box(label, surface, SE3(), kCamera, {}).sources(), "detector+box+surface");
}

TEST(LiftBox, TheSurfaceDecidesBetweenDetectorAndBox) {
  const RoadSurface surface = slope(0.0, 0.0, 0.01);
  const LiftedBox lifted = lift_box(moved(standing_at(20.0), 1.6), surface, SE3(), kCamera, {});
  EXPECT_EQ(lifted.sources(), "box+surface");
  EXPECT_NEAR(distance(lifted.label), 20.0, 0.8);
}

TEST(LiftBox, ASurfaceThatContradictsIsLeftOut) {
  RoadSurface surface = slope(0.0, 0.0, 0.01);
  surface.patches[0].plane.plane.offset -= 0.8;  // the road 0.8 m higher
  const LiftedBox lifted = lift_box(moved(standing_at(20.0), 1.08), surface, SE3(), kCamera, {});
  EXPECT_EQ(lifted.sources(), "detector+box");
  EXPECT_EQ(lifted.status, Status::kWeak);
  EXPECT_EQ(lifted.patch, -1);
  EXPECT_THAT(lifted.reason, HasSubstr("the surface contradicts by "));
  EXPECT_NEAR(distance(lifted.label), 20.0, 0.9);
}

TEST(LiftBox, ExtrapolationIsTrustedLess) {
  const RoadSurface surface = slope(0.0, 0.0, 0.01);  // to 70 m ahead, 30 m to each side
  const auto at = [&](double x) {
    return lift_box(car_at({x, 0.85, 25.0}), surface, SE3(), kCamera, {});
  };
  const LiftedBox inside = at(29.0), near = at(31.0), far = at(34.5), beyond = at(36.0);
  EXPECT_EQ(inside.status, Status::kOk);
  EXPECT_EQ(near.status, Status::kWeak);
  EXPECT_THAT(near.reason, HasSubstr("extrapolated"));
  EXPECT_GT(near.sigma_depth, 1.1 * inside.sigma_depth);
  EXPECT_GT(far.sigma_depth, 1.05 * near.sigma_depth);
  EXPECT_EQ(beyond.status, Status::kFailed);
  EXPECT_NEAR(beyond.sigma_depth, 0.08 * Eigen::Vector3d(36.0, 0.85, 25.0).norm(), 0.01);
}

TEST(LiftBox, APatchOfUnknownTiltGivesNone) {
  RoadSurface surface = slope(0.3, 0.0, 0.02);
  const Plane& plane = surface.patches[0].plane.plane;
  const KittiLabel label = car_at(plane.foot({0.0, 0.0, 20.0}) + 0.75 * plane.normal);
  surface.patches[0].plane.covariance.diagonal().head<2>().setConstant(1.0);
  surface.patches[0].plane.centroid = plane.foot({0.0, 0.0, 20.0});
  const LiftedBox lifted = lift_box(label, surface, SE3(), kCamera, {});
  ASSERT_TRUE(lifted.by_surface);
  EXPECT_LT(std::abs(lifted.tilt.pitch), 0.02);  // 0.3 * 0.15^2 / (1 + 0.15^2)
}

// A road whose grade is known and whose roll is not, and the reverse.
TEST(LiftBox, EachTiltIsDrawnToTheLevelByItsOwnSigma) {
  constexpr double kGrade = 0.12;
  RoadSurface surface = slope(kGrade, 0.0, 0.02);
  UncertainPlane& support = surface.patches[0].plane;
  const KittiLabel label =
      car_at(support.plane.foot({0.0, 0.0, 20.0}) + 0.75 * support.plane.normal);
  support.centroid = support.plane.foot({0.0, 0.0, 20.0});
  UncertainPlane::make_axes(support.plane.normal, Eigen::Vector3d::UnitZ(), &support.axis1,
                            &support.axis2);
  const auto pitch = [&](double roll_variance, double grade_variance) {
    support.covariance(0, 0) = roll_variance;  // about axis1, ahead
    support.covariance(1, 1) = grade_variance;
    return std::abs(lift_box(label, surface, SE3(), kCamera, {}).tilt.pitch);
  };
  EXPECT_NEAR(pitch(1.0, 1e-6), std::atan(kGrade), 0.003);
  EXPECT_LT(pitch(1e-6, 1.0), 0.01);
}

TEST(LiftBox, ManyBoxesAreInsideTheirStatedSigma) {
  const CounterRandom random(5);
  constexpr int kRows = 400;
  int inside = 0;
  double before = 0.0, after = 0.0;
  for (int i = 0; i < kRows; ++i) {
    const auto draw = [&](int k) { return random.normal(static_cast<std::uint64_t>(8 * i + k)); };
    const double depth = 10.0 + 40.0 * random.uniform(static_cast<std::uint64_t>(i));
    const double sigma = 0.002 * depth * depth / 10.0;  // 0.02 m at 10 m, 0.5 m at 50 m
    RoadSurface surface = slope(0.0, 0.0, sigma);
    surface.patches[0].plane.plane.offset += sigma * draw(0);
    const KittiLabel truth = standing_at(depth);
    KittiLabel label = moved(truth, 1.0 + 0.08 * draw(1));
    const double side = std::hypot(1.0, 0.025 * truth.box.height());
    label.box.y1 += side * draw(2);
    label.box.y2 += side * draw(3);
    label.height *= 1.0 + 0.04 * draw(4);
    label.location.y() += 0.5 * (label.height - truth.height);
    const LiftedBox lifted = lift_box(label, surface, SE3(), kCamera, {});
    inside += std::abs(distance(lifted.label) - depth) <= 1.96 * lifted.sigma_depth;
    before += std::abs(distance(label) - depth) / depth / kRows;
    after += std::abs(distance(lifted.label) - depth) / depth / kRows;
  }
  EXPECT_GE(inside, 0.92 * kRows);
  EXPECT_LE(inside, 0.995 * kRows);
  EXPECT_NEAR(before, 0.064, 0.006);  // 0.08 sqrt(2 / pi)
  EXPECT_LT(after, 0.035);
}

TEST(LiftBox, WhatCannotBeLiftedStays) {
  const RoadSurface surface = slope(0.0, 0.0, 0.02);
  const KittiLabel far = car_at({100.0, 1.6, 20.0});
  const LiftedBox uncovered = lift_box(far, surface, SE3(), kCamera, {});
  EXPECT_EQ(uncovered.status, Status::kFailed);
  EXPECT_THAT(uncovered.reason, HasSubstr("not covered"));
  EXPECT_THAT(uncovered.reason, HasSubstr("no 2D box"));
  EXPECT_EQ(uncovered.label.location, far.location);
  KittiLabel none;
  none.type = "DontCare";
  const LiftedBox nothing = lift_box(none, surface, SE3(), kCamera, {});
  EXPECT_EQ(nothing.status, Status::kFailed);
  EXPECT_TRUE(std::isnan(nothing.sigma_depth));
  EXPECT_EQ(lift_box(car_at({0, 1.6, -5}), surface, SE3(), kCamera, {}).status, Status::kFailed);
  RoadSurface fallback = surface;
  fallback.patches[0].status = Status::kNotObservable;
  EXPECT_EQ(lift_box(standing_at(20.0), fallback, SE3(), kCamera, {}).sources(), "detector+box");
  LiftOptions bad;
  bad.depth_sigma = 0.0;
  EXPECT_THROW(lift_box(far, surface, SE3(), kCamera, bad), std::invalid_argument);
  bad = {};
  bad.box_pixel_sigma = 0.0;
  EXPECT_THROW(lift_box(far, surface, SE3(), kCamera, bad), std::invalid_argument);
}

TEST(LiftBox, TheSurfaceIsTakenByTheGroundAlone) {
  RoadSurface surface = slope(0.0, 0.0, 0.02);
  surface.patches[0].without_vehicle = surface.patches[0].plane;
  surface.patches[0].without_vehicle->plane.offset = 1.7;
  EXPECT_EQ(surface_without_vehicles(surface).patches[0].plane.plane.offset, 1.7);
  surface.patches[0].without_vehicle.reset();
  EXPECT_EQ(surface_without_vehicles(surface).patches[0].plane.plane.offset,
            surface.patches[0].plane.plane.offset);
}

}  // namespace
}  // namespace camber
