#include "camber/calibrate/mounting.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/core/median.h"
#include "camber/core/random.h"
#include "camber/scene/travelled.h"

namespace camber {
namespace {

/// A point before the vehicle: x, y of its ray with z = 1, and the inverse of its depth.
struct RoadSample {
  double x, y, inverse_depth;
};

constexpr int kLeastRoad = 12;
constexpr double kFrameRate = 10.0;  // Hz, of frames without times, as everywhere

std::vector<RoadSample> samples_of(const CalibrationWindow& window) {
  std::vector<RoadSample> out;
  for (const WindowPoint& point : window.points) {
    const Eigen::Vector3d& d = point.direction;
    if (!(d.z() > 0.2) || !(point.inverse_distance > 0.0)) continue;
    const double x = d.x() / d.z(), y = d.y() / d.z();
    // Below the view straight on, and not far to its sides: within about two heights.
    if (y < 0.04 || std::abs(x) > 2.0 * y + 0.05) continue;
    out.push_back({x, y, point.inverse_distance / d.z()});
  }
  return out;
}

Eigen::Vector3d plane_through(const std::vector<RoadSample>& samples,
                              const std::vector<double>& weights) {
  Eigen::Matrix3d a = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const Eigen::Vector3d row(samples[i].x, samples[i].y, 1.0);
    a += weights[i] * row * row.transpose();
    b += weights[i] * samples[i].inverse_depth * row;
  }
  a.diagonal().array() += 1e-12;
  return a.ldlt().solve(b);
}

MountingNumber robust_mean(std::vector<double> values, double alike) {
  MountingNumber out;
  out.windows = static_cast<int>(values.size());
  out.value = upper_median(values);
  for (double& v : values) v = std::abs(v - out.value);
  const double effective = std::max(1.0, static_cast<double>(values.size()) / alike);
  constexpr double kOfMedian = 1.2533;  // the median's over the mean's standard deviation
  out.sigma = kOfMedian * kSigmaFromMad * upper_median(&values) / std::sqrt(effective);
  return out;
}

}  // namespace

std::optional<WindowRoad> road_of_window(const CalibrationWindow& window) {
  const std::vector<RoadSample> samples = samples_of(window);
  if (static_cast<int>(samples.size()) < kLeastRoad) return std::nullopt;
  constexpr int kDraws = 400;
  constexpr double kTolerance = 0.08;  // relative, of the inverse depth
  const auto off = [&](const Eigen::Vector3d& plane, const RoadSample& s) {
    const double expected = plane.x() * s.x + plane.y() * s.y + plane.z();
    return std::abs(s.inverse_depth - expected) / std::max(1e-9, s.inverse_depth);
  };
  const auto plausible = [](const Eigen::Vector3d& plane) {
    constexpr double kMostRoll = 0.25, kMostPitch = 0.35;  // tangents
    return plane.y() > 0.0 && std::abs(plane.x()) < kMostRoll * plane.y() &&
           std::abs(plane.z()) < kMostPitch * plane.y();
  };
  const CounterRandom random(window.first, 7);
  Eigen::Vector3d best = Eigen::Vector3d::Zero();
  int most = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    std::vector<RoadSample> three;
    for (int k = 0; k < 3; ++k) {
      three.push_back(
          samples[random.below(static_cast<std::uint64_t>(3 * draw + k), samples.size())]);
    }
    const Eigen::Vector3d plane = plane_through(three, {1.0, 1.0, 1.0});
    if (!plane.allFinite() || !plausible(plane)) continue;
    int agree = 0;
    for (const RoadSample& s : samples) agree += off(plane, s) < kTolerance ? 1 : 0;
    if (agree > most) {
      most = agree;
      best = plane;
    }
  }
  if (most < kLeastRoad) return std::nullopt;
  int agree = 0;
  for (int round = 0; round < 5; ++round) {
    std::vector<double> weights;
    agree = 0;
    for (const RoadSample& s : samples) {
      const double e = off(best, s) / kTolerance;
      weights.push_back(e < 1.0 ? std::pow((1.0 - e * e) / s.inverse_depth, 2) : 0.0);
      agree += e < 1.0 ? 1 : 0;
    }
    best = plane_through(samples, weights);
  }
  if (agree < kLeastRoad || !plausible(best)) return std::nullopt;
  std::vector<double> depths;
  for (const RoadSample& s : samples) {
    if (off(best, s) < kTolerance) depths.push_back(1.0 / s.inverse_depth);
  }
  return WindowRoad{-best.normalized(), 1.0 / best.norm(), agree, upper_median(&depths)};
}

std::vector<TravelStep> travel_steps(const CalibrationWindow& window) {
  std::vector<TravelStep> out;
  double mean = 0.0;
  std::vector<Eigen::Vector3d> ways;
  for (std::size_t k = 0; k + 1 < window.frame_from_reference.size(); ++k) {
    const SE3 &a = window.frame_from_reference[k], &b = window.frame_from_reference[k + 1];
    const Eigen::Vector3d way = b.inverse().translation() - a.inverse().translation();
    const Eigen::Quaterniond half = a.rotation().slerp(0.5, b.rotation());
    const Eigen::Vector3d turn = rotation_to_vector(b.rotation() * a.rotation().inverse());
    ways.push_back(half * way);
    // A camera that turns to the right turns what it sees to the left: about -y.
    out.push_back({(half * way).normalized(), -turn.y()});
    mean += way.norm();
  }
  mean /= static_cast<double>(std::max<std::size_t>(1, out.size()));
  std::vector<TravelStep> moving;
  for (std::size_t k = 0; k < out.size(); ++k) {
    if (ways[k].norm() > 0.3 * mean && out[k].direction.z() > 0.5) moving.push_back(out[k]);
  }
  return moving;
}

Mounting estimate_mounting(const std::vector<WindowBundle>& windows, const DriveLens& lens,
                           const DriveLens::Matrix& covariance) {
  constexpr double kStraight = 0.006;  // rad a step
  constexpr double kAlike = 4.0;       // neighbouring steps err alike
  Mounting out;
  std::vector<double> pitch, yaw, roll;
  std::vector<TravelStep> steps;
  for (const WindowBundle& bundle : windows) {
    for (const TravelStep& step : travel_steps(bundle.window())) steps.push_back(step);
    if (const auto road = road_of_window(bundle.window())) {
      roll.push_back(std::atan2(-road->normal.x(), -road->normal.y()));
    }
  }
  for (const TravelStep& step : steps) {
    pitch.push_back(std::atan2(step.direction.y(), step.direction.z()));
    if (std::abs(step.turn) < kStraight) {
      yaw.push_back(-std::atan2(step.direction.x(), step.direction.z()));
    }
  }
  if (pitch.size() >= 5) {
    out.pitch = robust_mean(pitch, kAlike);
    out.pitch->sigma = std::hypot(out.pitch->sigma, std::sqrt(covariance(2, 2)) / lens.f);
  }
  if (yaw.size() >= 5) {
    out.yaw = robust_mean(yaw, kAlike);
    out.yaw->sigma = std::hypot(out.yaw->sigma, std::sqrt(covariance(1, 1)) / lens.f);
  }
  if (roll.size() >= 3) {
    constexpr double kCrossFall = 0.01;  // rad: roads lean, and all windows with them
    out.roll = robust_mean(roll, 2.0);
    out.roll->sigma = std::hypot(out.roll->sigma, kCrossFall);
  }
  return out;
}

std::optional<MetresAlong> metres_by_speed(const Scene& scene, const std::vector<int>& key_ids) {
  const double rate = scene.frame_rate.value_or(kFrameRate);
  MetresAlong out;
  SpeedWeights weights;
  double metres = 0.0;
  for (std::size_t k = 1; k < key_ids.size(); ++k) {
    const auto step = travelled_between(scene, key_ids[k - 1], key_ids[k], rate, &weights);
    out.steps.push_back(step.value_or(std::numeric_limits<double>::quiet_NaN()));
    metres += step.value_or(0.0);
  }
  if (!(metres > 0.0)) return std::nullopt;
  out.sigma = travelled_sigma(scene, rate, weights).together() / metres;
  return out;
}

namespace {

/// A frame's place on the map.
struct Fix {
  int id = 0;
  double time_s = 0.0;
  Eigen::Vector2d at;
  double sigma = 0.0;
};

std::vector<Fix> fixes_of(const Scene& scene, double rate) {
  std::vector<Fix> out;
  for (const SceneFrame& frame : scene.frames) {
    if (!frame.map_position) continue;
    const double time = time_of(frame, rate);
    if (!out.empty() && !(time > out.back().time_s)) continue;
    out.push_back(
        {frame.id, time, frame.map_position->position.head<2>(), frame.map_position->sigma});
  }
  return out;
}

}  // namespace

std::optional<MetresAlong> metres_by_positions(const Scene& scene,
                                               const std::vector<int>& key_ids) {
  constexpr double kHalf = 0.5, kLongest = 2.0;  // s, to each side
  constexpr double kDifferenceSigma = 0.5;       // m, of two fixes near in time
  constexpr double kPlainly = 3.0;               // standard deviations
  const std::vector<Fix> fixes = fixes_of(scene, scene.frame_rate.value_or(kFrameRate));
  Scene moved;
  moved.frame_rate = scene.frame_rate;
  for (std::size_t i = 0; i < fixes.size(); ++i) {
    std::size_t before = i, after = i;
    while (before > 0 && fixes[i].time_s - fixes[before].time_s < kHalf) --before;
    while (after + 1 < fixes.size() && fixes[after].time_s - fixes[i].time_s < kHalf) ++after;
    const Fix &a = fixes[before], &b = fixes[after];
    const double span = b.time_s - a.time_s;
    if (!(span >= kHalf) || fixes[i].time_s - a.time_s > kLongest ||
        b.time_s - fixes[i].time_s > kLongest) {
      continue;
    }
    const double way = (fixes[i].at - a.at).norm() + (b.at - fixes[i].at).norm();
    const double sigma = std::min(std::hypot(a.sigma, b.sigma), kDifferenceSigma);
    if (!(way > kPlainly * sigma)) continue;
    SceneFrame frame;
    frame.id = fixes[i].id;
    frame.time_s = fixes[i].time_s;
    frame.speed = way / span;
    frame.speed_sigma = std::hypot(default_speed_sigma(*frame.speed), sigma / span);
    moved.frames.push_back(std::move(frame));
  }
  std::optional<MetresAlong> out = metres_by_speed(moved, key_ids);
  if (out) out->by_positions = true;
  return out;
}

std::optional<MountingNumber> estimate_height(const std::vector<WindowBundle>& windows,
                                              const MetresAlong& metres, double focal_sigma) {
  std::vector<double> heights;
  for (const WindowBundle& bundle : windows) {
    const CalibrationWindow& window = bundle.window();
    const auto road = road_of_window(window);
    if (!road) continue;
    double units = 0.0, known = 0.0;
    for (std::size_t k = 0; k + 1 < window.frame_from_reference.size(); ++k) {
      units += (window.frame_from_reference[k + 1].inverse().translation() -
                window.frame_from_reference[k].inverse().translation())
                   .norm();
      known += metres.steps.at(window.first + k);  // NaN: so is the sum
    }
    if (known > 0.0 && units > 0.0) heights.push_back(road->height * known / units);
  }
  constexpr std::size_t kLeastWindows = 5;
  if (heights.size() < kLeastWindows) return std::nullopt;
  MountingNumber out = robust_mean(heights, 2.0);
  out.sigma = std::hypot(out.sigma, out.value * std::hypot(metres.sigma, focal_sigma));
  return out;
}

}  // namespace camber
