// Profiles of made roads whose heights are known everywhere.

#include "camber/road/cloud_profile.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>

#include "camber/core/random.h"
#include "camber/road/detail/line_frame.h"
#include "camber/road/detail/strip_smoother.h"

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kRadius = 80.0, kLength = 70.0;

/// A bend to the left with a crown, a kerb on its left and a ditch on its right.
struct MadeRoad {
  double crown = 0.025, bank = 0.02, kerb = 0.12, noise = 0.02;
  double left = 3.0, right = 3.2;  ///< m to kerb and ditch
  double crest = 0.0;              ///< m to the left of the line

  double height(double s, double v) const {
    const double inside = std::clamp(v, -right, left);
    double z = 5.0 + 0.05 * s - s * s / 2400.0 + bank * inside - crown * std::abs(inside - crest);
    if (v > left) z += std::min(1.0, (v - left) / 0.02) * kerb;
    if (v < -right) z -= 0.5 * std::min(1.0, -right - v);
    return z;
  }
  static Vector3d place(double s, double v, double z) {
    const double turn = s / kRadius, r = kRadius - v;
    return {4000.0 + r * std::sin(turn), 7000.0 + kRadius - r * std::cos(turn), z};
  }
  RoadCloud cloud(double density, std::uint64_t seed,
                  const std::function<bool(double, double)>& hole = {}) const {
    RoadCloud out;
    out.frame = CloudFrame::kZUp;
    out.origin = {4000.0, 7000.0, 0.0};
    const CounterRandom random(seed, 9);
    const auto count = static_cast<std::uint64_t>(density * 14.0 * (kLength + 20.0));
    for (std::uint64_t i = 0; i < count; ++i) {
      const double s = random.uniform(2 * i, -10.0, kLength + 10.0);
      const double v = random.uniform(2 * i + 1, -7.0, 7.0);
      if (hole && hole(s, v)) continue;
      const Vector3d p = place(s, v, height(s, v) + noise * random.normal(i));
      out.points.push_back((p - out.origin).cast<float>());
    }
    return out;
  }
  static std::vector<Vector3d> line() {
    std::vector<Vector3d> out;
    for (double s = 0.0; s <= kLength; s += 1.0) out.push_back(place(s, 0.0, 0.0));
    return out;
  }
  /// Least squares over the road as far as profile_cloud() takes it.
  double cross_slope(double /*s*/, double to_right, double to_left) const {
    Eigen::MatrixX2d rows(21, 2);
    Eigen::VectorXd heights(21);
    for (int i = 0; i <= 20; ++i) {
      const double v = -to_right + (to_left + to_right) * i / 20.0;
      rows.row(i) << 1.0, v;
      // The road alone: an edge that is found a little too far takes nothing from beyond it.
      heights[i] = bank * v - crown * std::abs(v - crest);
    }
    return rows.colPivHouseholderQr().solve(heights)[1];
  }
};

std::vector<int> all_of(const RoadCloud& cloud) {
  std::vector<int> out(cloud.size());
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = static_cast<int>(i);
  return out;
}

CloudProfileOptions without_drift() {
  CloudProfileOptions options;
  options.profile.drift_sigma = options.profile.levelling_sigma = 0.0;
  return options;
}

TEST(CloudProfile, CrownKerbDitchAndHoles) {
  const MadeRoad road;
  const auto hole = [](double s, double v) {
    return (s > 20.0 && s < 24.0 && v > 0.3 && v < 2.5) || (s > 40.0 && s < 43.0 && v < -1.0);
  };
  const RoadCloud cloud = road.cloud(50.0, 1, hole);
  CloudProfileOptions options = without_drift();
  options.crown = true;
  const CloudProfile profile =
      profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), MadeRoad::line(), options);
  ASSERT_EQ(profile.status, Status::kOk);
  ASSERT_EQ(profile.stations.size(), 70u);  // chords are shorter than the bend
  EXPECT_NEAR(profile.noise, 0.02, 0.001);
  double heights = 0.0, slopes = 0.0, grades = 0.0, lefts = 0.0, graded = 0.0;
  for (const CrossSection& at : profile.stations) {
    ASSERT_EQ(at.status, Status::kOk) << at.station << " " << at.reason;
    EXPECT_NEAR(at.width_left, 3.0, 0.3) << at.station;  // a node and a half
    EXPECT_NEAR(at.width_right, 3.2, 0.3) << at.station;
    const double s = at.station;
    heights += std::pow(at.height - road.height(s, 0.0), 2);
    slopes +=
        std::pow(at.cross_slope - road.cross_slope(s, at.measured_right, at.measured_left), 2);
    lefts += std::pow(at.cross_slope_left - (road.bank - road.crown), 2);
    if (!std::isfinite(at.grade)) continue;
    grades += std::pow(at.grade - (0.05 - s / 1200.0), 2);
    EXPECT_NEAR(at.vertical_curvature, -1.0 / 1200.0, 5.0 * at.sigma_vertical_curvature);
    graded += 1.0;
  }
  EXPECT_GE(graded, 68.0);
  // The bars of the issue: 3 mm + noise / 10, 0.3 %, 0.2 %.
  EXPECT_LT(std::sqrt(heights / 70.0), 0.003);
  EXPECT_LT(std::sqrt(slopes / 70.0), 0.001);
  EXPECT_LT(std::sqrt(lefts / 70.0), 0.002);
  EXPECT_LT(std::sqrt(grades / graded), 0.001);
}

TEST(CloudProfile, ACrestBesideTheLineIsFound) {
  MadeRoad road;
  road.crest = -0.9;
  const RoadCloud cloud = road.cloud(50.0, 6);
  CloudProfileOptions options = without_drift();
  options.crown = true;
  const CloudProfile profile =
      profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), MadeRoad::line(), options);
  double points = 0.0;
  for (const CrossSection& at : profile.stations) {
    EXPECT_NEAR(at.crest, -0.9, 0.35) << at.station;  // two places that are tried
    EXPECT_NEAR(at.cross_slope_left, road.bank - road.crown, 0.004) << at.station;
    EXPECT_NEAR(at.cross_slope_right, road.bank + road.crown, 0.004) << at.station;
    points += static_cast<double>(at.points);
  }
  // Between the edges, every point once.
  EXPECT_NEAR(points / (6.0 * 70.0 * 50.0), 1.0, 0.1);
}

TEST(CloudProfile, BandsHold) {
  MadeRoad road;
  double inside_height = 0.0, inside_slope = 0.0, inside_grade = 0.0, count = 0.0, graded = 0.0;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    road.noise = seed % 2 == 0 ? 0.01 : 0.04;
    const RoadCloud cloud = road.cloud(20.0, seed);
    const CloudProfile profile =
        profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), MadeRoad::line(), without_drift());
    for (const CrossSection& at : profile.stations) {
      const double truth = road.cross_slope(at.station, at.measured_right, at.measured_left);
      count += 1.0;
      inside_height += std::abs(at.height - road.height(at.station, 0.0)) < 1.96 * at.sigma_height;
      inside_slope += std::abs(at.cross_slope - truth) < 1.96 * at.sigma_cross_slope;
      if (!std::isfinite(at.grade)) continue;
      graded += 1.0;
      inside_grade += std::abs(at.grade - (0.05 - at.station / 1200.0)) < 1.96 * at.sigma_grade;
    }
  }
  // Errors of neighbours are alike: some forty independent ones a quantity.
  EXPECT_GT(inside_height / count, 0.88);
  EXPECT_GT(inside_slope / count, 0.88);
  EXPECT_GT(inside_grade / graded, 0.88);
}

TEST(CloudProfile, BandsHoldOnGroundWithKinks) {
  // Heights of a grid of a metre with slopes that break at its lines, askew to the road.
  const auto kinks = [](double s, double v) {
    const double x = 0.8 * s - 0.6 * v + 100.0, y = 0.6 * s + 0.8 * v + 100.0;
    const auto node = [](double i, double j) {
      return 0.02 * CounterRandom(77).normal(static_cast<std::uint64_t>(1000.0 * i + j));
    };
    const double i = std::floor(x), j = std::floor(y), a = x - i, b = y - j;
    return (1.0 - a) * ((1.0 - b) * node(i, j) + b * node(i, j + 1.0)) +
           a * ((1.0 - b) * node(i + 1.0, j) + b * node(i + 1.0, j + 1.0));
  };
  const auto height = [&](double s, double v) { return 0.03 * s + 0.02 * v + kinks(s, v); };
  const std::vector<Vector3d> line = {{0.0, 0.0, 0.0}, {120.0, 0.0, 0.0}};
  double inside_height = 0.0, inside_slope = 0.0, count = 0.0;
  for (std::uint64_t seed = 0; seed < 2; ++seed) {
    RoadCloud cloud;
    cloud.frame = CloudFrame::kZUp;
    const CounterRandom random(seed, 9);
    for (std::uint64_t i = 0; i < 28000; ++i) {
      const double s = random.uniform(2 * i, -10.0, 130.0), v = random.uniform(2 * i + 1, -5, 5);
      cloud.points.push_back(Vector3d(s, v, height(s, v) + 0.02 * random.normal(i)).cast<float>());
    }
    const CloudProfile profile =
        profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), line, without_drift());
    for (const CrossSection& at : profile.stations) {
      ASSERT_NE(at.status, Status::kFailed);
      double slope = 0.0, squares = 0.0;
      const double middle = 0.5 * (at.measured_left - at.measured_right);
      const double wide = at.measured_left + at.measured_right;
      for (int i = -10; i <= 10; ++i) {
        slope += wide * i / 20.0 * height(at.station, middle + wide * i / 20.0);
        squares += std::pow(wide * i / 20.0, 2);
      }
      count += 1.0;
      inside_height += std::abs(at.height - height(at.station, 0.0)) < 1.96 * at.sigma_height;
      inside_slope += std::abs(at.cross_slope - slope / squares) < 1.96 * at.sigma_cross_slope;
    }
  }
  // 91 % less four standard deviations of 242 independent errors; ground that is smooth along the
  // line by assumption gave 84 and 68 %.
  EXPECT_GT(inside_height / count, 0.85);
  EXPECT_GT(inside_slope / count, 0.85);
}

TEST(CloudProfile, NodesFollowWhatThePointsCanTell) {
  detail::StripRoughness roughness;
  const double apart = roughness.bandwidth(0.02, 10.0, 7.0);
  EXPECT_NEAR(roughness.bandwidth(0.02, 160.0, 7.0), 0.5 * apart, 1e-9);
  EXPECT_NEAR(roughness.bandwidth(0.08, 10.0, 7.0), 2.0 * apart, 1e-9);
  roughness.tilt = 0.02;  // kinks need closer nodes
  EXPECT_LT(roughness.bandwidth(0.02, 10.0, 7.0), 0.5 * apart);
}

TEST(CloudProfile, WhatStandsOnTheRoadDoesNotCount) {
  const MadeRoad road;
  RoadCloud cloud = road.cloud(50.0, 2);
  const std::size_t ground = cloud.size();
  // A car's side and roof over a third of the width, its ground still seen between the wheels.
  const CounterRandom random(5);
  for (std::uint64_t i = 0; i < 150; ++i) {
    const double s = random.uniform(3 * i, 30.0, 34.0), v = random.uniform(3 * i + 1, 0.5, 2.3);
    const double z = road.height(s, v) + random.uniform(3 * i + 2, 0.2, 1.5);
    cloud.points.push_back((MadeRoad::place(s, v, z) - cloud.origin).cast<float>());
  }
  const CloudProfile profile =
      profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), MadeRoad::line(), without_drift());
  ASSERT_GT(cloud.size(), ground);
  for (const CrossSection& at : profile.stations) {
    const double truth = road.cross_slope(at.station, at.measured_right, at.measured_left);
    EXPECT_NEAR(at.height, road.height(at.station, 0.0), 0.01) << at.station;
    EXPECT_NEAR(at.cross_slope, truth, 0.006) << at.station;
  }
}

TEST(CloudProfile, GapsAreNamedAndTheRestAnswered) {
  const MadeRoad road;
  const RoadCloud cloud = road.cloud(20.0, 3, [](double s, double) { return s > 30 && s < 45; });
  const CloudProfile profile =
      profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), MadeRoad::line(), without_drift());
  for (const CrossSection& at : profile.stations) {
    if (at.station > 31.5 && at.station < 43.5) {
      EXPECT_EQ(at.status, Status::kFailed) << at.station;
      EXPECT_THAT(at.reason, testing::HasSubstr("no ground within 3.5 m of the line from station"));
      EXPECT_FALSE(std::isfinite(at.height));
    } else if (at.station < 30.0 || at.station > 45.0) {
      EXPECT_NE(at.status, Status::kFailed) << at.station;
    }
  }
}

TEST(CloudProfile, AnyNumberOfThreadsAnyFrame) {
  const MadeRoad road;
  const RoadCloud cloud = road.cloud(10.0, 4);
  CloudProfileOptions options = without_drift();
  options.num_threads = 1;
  const CloudProfile one =
      profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), MadeRoad::line(), options);
  options.num_threads = 3;
  const CloudProfile three =
      profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), MadeRoad::line(), options);
  ASSERT_EQ(one.stations.size(), three.stations.size());
  for (std::size_t k = 0; k < one.stations.size(); ++k) {
    EXPECT_EQ(one.stations[k].height, three.stations[k].height);
    EXPECT_EQ(one.stations[k].sigma_cross_slope, three.stations[k].sigma_cross_slope);
  }
  // A camera's frame: y down.
  Eigen::Matrix3d turn;
  turn << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  RoadCloud turned = cloud;
  turned.origin = turn * cloud.origin;
  for (Eigen::Vector3f& p : turned.points) p = turn.cast<float>() * p;
  std::vector<Vector3d> line = MadeRoad::line();
  for (Vector3d& p : line) p = turn * p;
  const CloudProfile other =
      profile_cloud(turned, all_of(turned), Vector3d(0, -1, 0), line, options);
  for (std::size_t k = 0; k < one.stations.size(); k += 10) {
    EXPECT_NEAR(other.stations[k].height, one.stations[k].height, 1e-3);
    EXPECT_NEAR(other.stations[k].cross_slope, one.stations[k].cross_slope, 1e-4);
    EXPECT_NEAR((turn.transpose() * other.stations[k].point - one.stations[k].point).norm(), 0.0,
                1e-3);
  }
}

TEST(CloudProfile, MistakesAreNamed) {
  const MadeRoad road;
  const RoadCloud cloud = road.cloud(1.0, 4);
  const auto profile = [&](const std::vector<Vector3d>& line, const CloudProfileOptions& options) {
    return profile_cloud(cloud, all_of(cloud), Vector3d::UnitZ(), line, options);
  };
  CloudProfileOptions options;
  EXPECT_THROW(profile({Vector3d::Zero()}, options), std::invalid_argument);
  options.half_width = 0.0;
  EXPECT_THROW(profile(MadeRoad::line(), options), std::invalid_argument);
  options = {};
  options.profile.step = 1e-6;
  EXPECT_THROW(profile(MadeRoad::line(), options), std::invalid_argument);
  const CloudProfile away = profile({{0, 0, 0}, {50, 0, 0}}, {});
  EXPECT_EQ(away.status, Status::kFailed);
  EXPECT_THAT(away.reason, testing::HasSubstr("0 points of the ground lie within"));
}

TEST(GroundBesideLine, TakesTheFirstSourceThatThereIs) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kZUp;
  for (int i = 0; i < 400; ++i) {
    cloud.points.emplace_back(0.5f * static_cast<float>(i % 40), static_cast<float>(i / 40) - 5.0f,
                              0.0f);
  }
  cloud.points.emplace_back(10.0f, 0.0f, 2.0f);
  const std::vector<Vector3d> line = {{0, 0, 0}, {20, 0, 0}};
  const auto ground = [&](GroundSource source) {
    return ground_beside_line(cloud, Vector3d::UnitZ(), line, 3.5, source, 1);
  };
  EXPECT_EQ(ground(GroundSource::kAuto).source, GroundSource::kCompute);
  EXPECT_EQ(ground(GroundSource::kAll).points.size(), 401u);
  EXPECT_EQ(ground(GroundSource::kClasses).status, Status::kFailed);
  std::vector<int>& marks = cloud.labels["ground"];
  marks.assign(cloud.size(), 1);
  marks.back() = 0;
  EXPECT_EQ(ground(GroundSource::kAuto).source, GroundSource::kLabels);
  EXPECT_EQ(ground(GroundSource::kAuto).points.size(), 400u);
  std::vector<int>& classes = cloud.labels["classification"];
  classes.assign(cloud.size(), 1);
  EXPECT_EQ(ground(GroundSource::kAuto).source, GroundSource::kLabels);
  classes[200] = 2;
  classes[201] = 11;
  EXPECT_EQ(ground(GroundSource::kAuto).source, GroundSource::kClasses);
  EXPECT_THAT(ground(GroundSource::kAuto).points, testing::ElementsAre(200, 201));
  cloud.labels["class_flags"].assign(cloud.size(), 4);
  EXPECT_TRUE(ground(GroundSource::kAll).points.empty());
}

TEST(LineFrame, PlacesAreSmoothAcrossCorners) {
  std::vector<Vector2d> corners;
  for (int i = 0; i <= 60; ++i) {
    corners.emplace_back(40.0 * std::sin(i / 40.0), 40.0 * (1.0 - std::cos(i / 40.0)));
  }
  detail::LineFrame frame(corners, 1.75, 25.0);
  frame.prepare(8.0);
  std::vector<detail::LinePlace> places;
  double last = std::nan("");
  for (double turn = 0.2; turn < 1.2; turn += 0.001) {
    for (const double v : {-5.0, 5.0}) {
      frame.places(Vector2d((40.0 - v) * std::sin(turn), 40.0 - (40.0 - v) * std::cos(turn)), 6.0,
                   &places);
      ASSERT_EQ(places.size(), 1u) << turn;
      EXPECT_NEAR(places[0].s, 40.0 * turn, 0.02);
      EXPECT_NEAR(places[0].v, v, 0.03);  // the mean lies inside the bend by 1.3 cm
    }
    if (std::isfinite(last)) {
      EXPECT_NEAR(places[0].s - last, 0.04, 0.01);
    }
    last = places[0].s;
  }
  // Inside the bend beyond its centre nothing is answered.
  frame.places(Vector2d(0.0, 41.0), 6.0, &places);
  EXPECT_TRUE(places.empty());
}

}  // namespace
}  // namespace camber
