#include "camber/vehicle/detail/vehicle_registration.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <vector>

#include "camber/core/random.h"
#include "camber/vehicle/vehicle_tracks.h"
#include "vehicle/simulated_vehicle.h"

namespace camber {
namespace {

using internal::VehicleShift;
using internal::VehicleTemplate;

/// A grey value for every place: waves of a few decimetres.
double texture(const Eigen::Vector3d& x, double phase) {
  double sum = 0.0;
  for (int k = 1; k <= 6; ++k) {
    const Eigen::Vector3d wave(2.1 * k - 3.0, 5.5 - 1.3 * k, 0.9 * k + 1.0);
    sum += std::sin(wave.dot(x) + phase * k);
  }
  return 120.0 + 18.0 * sum;
}

/// Boxes of a texture of their own on a background of another, nearest first.
GrayImage draw(const PinholeCamera& camera, const std::vector<OrientedBox>& boxes, double gain) {
  GrayImage out{camera.width, camera.height, {}};
  out.pixels.resize(static_cast<std::size_t>(camera.width) *
                    static_cast<std::size_t>(camera.height));
  // Plain beyond the neighbourhood of the boxes.
  Box2 region{1e9, 1e9, -1e9, -1e9};
  for (const OrientedBox& box : boxes) {
    const auto corners = box.corners();
    for (int i = 0; i < 8; ++i) {
      const Eigen::Vector2d p = *camera.project(corners.col(i));
      region = {std::min(region.x1, p.x()), std::min(region.y1, p.y()), std::max(region.x2, p.x()),
                std::max(region.y2, p.y())};
    }
  }
  const Box2 drawn = region.grown(25.0);
  for (int v = 0; v < camera.height; ++v) {
    for (int u = 0; u < camera.width; ++u) {
      if (!drawn.contains({u, v})) continue;
      const Eigen::Vector3d ray = camera.ray({u, v});
      double value = texture(8.0 * ray, 1.0), nearest = 1e9;
      for (std::size_t b = 0; b < boxes.size(); ++b) {
        const SE3 vehicle_from_camera = boxes[b].camera_from_vehicle.inverse();
        const Eigen::Vector3d origin = vehicle_from_camera.translation();
        const Eigen::Vector3d along = vehicle_from_camera.rotation() * ray;
        const Dimensions& d = boxes[b].dimensions;
        const Eigen::Vector3d low(-0.5 * d.length, 0.0, -0.5 * d.width),
            high(0.5 * d.length, d.height, 0.5 * d.width);
        double enter = 0.0, leave = 1e9;
        for (int k = 0; k < 3; ++k) {
          const double p = (low[k] - origin[k]) / along[k], q = (high[k] - origin[k]) / along[k];
          enter = std::max(enter, std::min(p, q));
          leave = std::min(leave, std::max(p, q));
        }
        if (enter < leave && enter > 0.0 && enter < nearest) {
          nearest = enter;
          value = texture(origin + enter * along, 2.0 + static_cast<double>(b));
        }
      }
      out.pixels[static_cast<std::size_t>(v) * static_cast<std::size_t>(camera.width) +
                 static_cast<std::size_t>(u)] =
          static_cast<std::uint8_t>(std::clamp(gain * value, 0.0, 255.0));
    }
  }
  return out;
}

/// A vehicle that fills its box.
VehicleEstimate boxed(const PinholeCamera& camera, const OrientedBox& pose) {
  VehicleEstimate out;
  out.pose = pose;
  out.status = Status::kOk;
  out.box = {1e9, 1e9, -1e9, -1e9};
  const auto corners = pose.corners();
  for (int i = 0; i < kNumKeypoints; ++i) {
    out.keypoints[static_cast<std::size_t>(i)] = corners.col(i % 8);
    const Eigen::Vector2d p = *camera.project(corners.col(i % 8));
    out.box = {std::min(out.box.x1, p.x()), std::min(out.box.y1, p.y()),
               std::max(out.box.x2, p.x()), std::max(out.box.y2, p.y())};
  }
  return out;
}

OrientedBox standing(double x, double y, double z, double yaw) {
  Eigen::Matrix3d r;  // columns: front, up, right
  r.col(0) = Eigen::Vector3d(std::sin(yaw), 0.0, std::cos(yaw));
  r.col(1) = Eigen::Vector3d(0.0, -1.0, 0.0);
  r.col(2) = r.col(0).cross(r.col(1));
  OrientedBox out;
  out.camera_from_vehicle = SE3(r, Eigen::Vector3d(x, y, z));
  out.dimensions = {4.3, 1.75, 1.5};
  return out;
}

OrientedBox moved(const SE3& second_from_first, const OrientedBox& box) {
  OrientedBox out = box;
  out.camera_from_vehicle = second_from_first * box.camera_from_vehicle;
  return out;
}

const PinholeCamera kCamera{640, 240, 700.0, 700.0, 320.0, 110.0};

TEST(VehicleTemplate, FindsTheMotionOfAVehicleToATenthOfAPixel) {
  for (const double z : {12.0, 25.0, 45.0}) {
    const OrientedBox box = standing(0.12 * z, 1.6, z, 0.3);
    const VehicleEstimate vehicle = boxed(kCamera, box);
    const SE3 motion(rotation_from_vector({0.002, -0.004, 0.001}),
                     Eigen::Vector3d(0.05, -0.02, -0.06 * z));
    const GrayImage first = draw(kCamera, {box}, 1.0),
                    second = draw(kCamera, {moved(motion, box)}, 0.9);
    const auto cut = VehicleTemplate::cut(kCamera, first, vehicle, {});
    ASSERT_TRUE(cut);
    // A start that is off by two pixels.
    const SE3 start(motion.rotation(),
                    motion.translation() + Eigen::Vector3d(2.0, -1.5, 0.0) * z / kCamera.fx);
    const auto shift = cut->find_in(second, start);
    ASSERT_TRUE(shift) << z;
    const Eigen::Vector3d there = motion * shift->anchor;
    const Eigen::Vector2d expected = *kCamera.project(there) - *kCamera.project(shift->anchor);
    EXPECT_LT((shift->displacement - expected).norm(), 0.1) << z;
    EXPECT_NEAR(shift->log_depth_ratio, std::log(there.z() / shift->anchor.z()), 0.004) << z;
    const Eigen::Matrix3d covariance =
        shift->noise + shift->shared +
        std::pow(shift->depth_sigma, 2) * shift->by_depth * shift->by_depth.transpose();
    Eigen::Vector3d error;
    error << shift->displacement - expected,
        shift->log_depth_ratio - std::log(there.z() / shift->anchor.z());
    EXPECT_LT(error.dot(covariance.inverse() * error), 14.2) << z;  // 99.7 % of three
  }
}

TEST(VehicleTemplate, LeavesOutWhatHidesTheVehicle) {
  const OrientedBox box = standing(2.0, 1.6, 25.0, 0.3), nearer = standing(-0.3, 1.6, 15.0, 0.0);
  const SE3 motion(rotation_from_vector({0.0, -0.003, 0.0}), Eigen::Vector3d(0.0, 0.0, -1.5));
  const SE3 other(rotation_from_vector({0.0, -0.003, 0.0}), Eigen::Vector3d(0.0, 0.0, 0.3));
  const GrayImage first = draw(kCamera, {nearer, box}, 1.0),
                  second = draw(kCamera, {moved(other, nearer), moved(motion, box)}, 1.0);
  const VehicleEstimate vehicle = boxed(kCamera, box), hiding = boxed(kCamera, nearer);
  const auto cut = VehicleTemplate::cut(kCamera, first, vehicle, {&hiding});
  ASSERT_TRUE(cut);
  const auto shift = cut->find_in(second, motion);
  ASSERT_TRUE(shift);
  const Eigen::Vector2d expected =
      *kCamera.project(motion * shift->anchor) - *kCamera.project(shift->anchor);
  EXPECT_LT((shift->displacement - expected).norm(), 0.1);
}

TEST(VehicleTemplate, LeavesOutWhatTheMaskDoesNotShow) {
  const OrientedBox box = standing(2.0, 1.6, 25.0, 1.2), wall = standing(1.9, 1.6, 12.0, 0.0);
  const SE3 motion(rotation_from_vector({0.0, -0.003, 0.0}), Eigen::Vector3d(0.0, 0.0, -1.2));
  const GrayImage first = draw(kCamera, {wall, box}, 1.0),
                  second = draw(kCamera, {moved(motion, wall), moved(motion, box)}, 1.0);
  // Where the wall alone changes the picture, it hides the vehicle.
  const GrayImage empty = draw(kCamera, {}, 1.0), alone = draw(kCamera, {wall}, 1.0);
  std::vector<std::uint8_t> mask(first.pixels.size());
  for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = alone.pixels[i] == empty.pixels[i];
  const VehicleEstimate vehicle = boxed(kCamera, box);
  const auto off = [&](const std::vector<std::uint8_t>* shown) {
    const auto cut = VehicleTemplate::cut(kCamera, first, vehicle, {}, {}, shown);
    const auto shift = cut ? cut->find_in(second, motion) : std::nullopt;
    if (!shift) return std::numeric_limits<double>::quiet_NaN();
    const Eigen::Vector2d expected =
        *kCamera.project(motion * shift->anchor) - *kCamera.project(shift->anchor);
    return (shift->displacement - expected).norm();
  };
  EXPECT_LT(off(&mask), 0.1);
  EXPECT_GT(off(nullptr), 0.3);
  const std::vector<std::uint8_t> nothing(mask.size(), 0);
  EXPECT_FALSE(VehicleTemplate::cut(kCamera, first, vehicle, {}, {}, &nothing));
}

TEST(VehicleTemplate, SaysNothingWhereTheImagesDisagree) {
  const OrientedBox box = standing(2.0, 1.6, 25.0, 0.3);
  const VehicleEstimate vehicle = boxed(kCamera, box);
  const GrayImage first = draw(kCamera, {box}, 1.0), empty = draw(kCamera, {}, 1.0);
  GrayImage grey = first;
  std::fill(grey.pixels.begin(), grey.pixels.end(), std::uint8_t{90});
  const auto cut = VehicleTemplate::cut(kCamera, first, vehicle, {});
  ASSERT_TRUE(cut);
  EXPECT_FALSE(cut->find_in(empty, SE3()));
  EXPECT_FALSE(cut->find_in(grey, SE3()));
  EXPECT_FALSE(cut->find_in(first, SE3(Eigen::Quaterniond::Identity(), {12.0, 0.0, 0.0})));
  EXPECT_FALSE(cut->find_in(first, SE3(Eigen::Quaterniond::Identity(), {0.0, 0.0, -30.0})));
  const VehicleEstimate far = boxed(kCamera, standing(2.0, 1.6, 400.0, 0.0));
  EXPECT_FALSE(VehicleTemplate::cut(kCamera, first, far, {}));
}

/// Tracks of parked, slow and faster vehicles with drawn images: a vehicle that stands is
/// triangulated.
TEST(FitTracks, ImagesTellTheDistanceOfAParkedVehicle) {
  test::SimulationOptions options;
  options.min_distance = 22.0;
  options.max_distance = 40.0;
  options.plane_sigma_height = 0.4;  // the road far away is hardly known
  options.occluded_share = 0.0;
  constexpr int kViews = 4;
  const CounterRandom random(17);
  for (const double speed : {0.0, 2.0, 8.0}) {
    double without = 0.0, with = 0.0, inside = 0.0, used = 0.0;
    const int count = speed > 0.0 ? 24 : 48;
    for (int i = 0; i < count; ++i) {
      PinholeCamera camera;
      std::vector<TrackFrame> frames;
      std::vector<GrayImage> images(kViews);
      std::vector<test::SimulatedVehicle> truth;
      for (int k = 0; k < kViews; ++k) {
        const SE3 camera_from_first(Eigen::Quaterniond::Identity(),
                                    Eigen::Vector3d(0.0, 0.0, -1.0 * k));
        const auto s = test::seen_again(
            test::simulate_vehicle(options, static_cast<std::uint64_t>(i)), options,
            static_cast<std::uint64_t>(i), k, camera_from_first, 0.1 * speed * k);
        camera = s.camera;
        TrackFrame frame;
        frame.world_from_camera = camera_from_first.inverse();
        frame.time_s = 0.1 * k;
        frame.detections = {s.detection};
        frame.supports = {s.support};
        frame.estimates = fit_vehicles(camera, frame.detections, frame.supports, {}, 1);
        // Each image has an error of its own, a tenth of a pixel.
        PinholeCamera shaken = camera;
        shaken.cx += 0.1 * random.normal(static_cast<std::uint64_t>(2 * (kViews * i + k)));
        shaken.cy += 0.1 * random.normal(static_cast<std::uint64_t>(2 * (kViews * i + k) + 1));
        images[static_cast<std::size_t>(k)] = draw(shaken, {s.truth}, 1.0);
        frames.push_back(std::move(frame));
        truth.push_back(s);
      }
      const Eigen::Vector3d center = truth[1].truth.center();
      if (speed == 0.0 && std::abs(center.x()) < 3.0) continue;  // hardly any parallax
      used += 1.0;
      without += (fit_tracks(camera, frames, {}, 1).estimates[1][0].pose.center() - center).norm();
      for (int k = 0; k < kViews; ++k) {
        frames[static_cast<std::size_t>(k)].image = &images[static_cast<std::size_t>(k)];
      }
      const VehicleEstimate e = fit_tracks(camera, frames, {}, 1).estimates[1][0];
      const Eigen::Vector3d d = e.pose.center() - center;
      const Eigen::Matrix3d covariance = e.covariance.topLeftCorner<3, 3>();
      with += d.norm();
      inside += d.dot(covariance.inverse() * d) < 7.815 ? 1.0 : 0.0;
    }
    ASSERT_GT(used, 8.0);
    if (speed == 0.0) {
      // 0.63 measured, of 56; 0.68 where the first image's error is not taken for a common one.
      EXPECT_LT(with, 0.66 * without);
    } else {
      EXPECT_LT(with, 1.15 * without);  // 1.08 measured for both
    }
    // Not taken for parked: 1.10 m measured, 1.31 where a moving vehicle leaves its heading freely.
    if (speed == 2.0) {
      EXPECT_LT(with, 1.2 * used);
    }
    EXPECT_GT(inside, 0.84 * used) << speed;  // 0.96 measured
  }
}

}  // namespace
}  // namespace camber
