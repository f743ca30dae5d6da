#include "camber/evaluate/strip_errors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"

namespace camber {
namespace {

/// A straight drive along x over z = 0.04 x + 0.001 x^2 + 0.03 y, and what a drive left of it. True
/// and estimated world are turned, by different rotations.
struct MadeRoad {
  static constexpr int kFrames = 60;
  static constexpr double kStep = 0.8, kCell = 0.5;  // m
  Scene scene;
  RoadCloud truth;
  DriveDocument drive;
  RoadStrip strip;

  static double height(double x, double y) { return 0.04 * x + 0.001 * x * x + 0.03 * y; }
  static double slope(double x) { return 0.04 + 0.002 * x; }

  /// @param scale  of the estimate
  /// @param bend   per m, of the estimate: its heights gain bend x^2, its poses turn with them
  explicit MadeRoad(double scale = 1.0, double bend = 0.0) {
    scene.camera = {1000, 600, 500.0, 500.0, 499.5, 299.5};
    scene.truth.emplace();
    for (int i = 0; i < kFrames; ++i) {
      const double x = kStep * i;
      TruthFrame frame;
      frame.id = i;
      const Eigen::Vector3d foot(x, 0.0, height(x, 0.0));
      const Eigen::Vector3d normal = Eigen::Vector3d(-slope(x), -0.03, 1.0).normalized();
      const SE3 level = camera_at(foot + 1.5 * normal, 0.0);
      frame.world_from_camera = true_world() * level;
      frame.ego_plane = Plane{level.rotation().conjugate() * normal, 1.5};
      scene.truth->frames.push_back(frame);
      DriveFrame driven;
      driven.id = i;
      const Eigen::Vector3d lifted = scale * (foot + 1.5 * normal + bend * x * x * up());
      driven.world_from_camera = world() * camera_at(lifted, std::atan(2.0 * bend * x));
      driven.grade = {std::atan(slope(x) + 2.0 * bend * x), 0.001};
      drive.frames.push_back(driven);
    }
    for (double x = -3.0; x < kStep * kFrames + 30.0; x += 0.25) {
      for (double y = -6.0; y < 6.0; y += 0.25) {
        const Eigen::Vector3d p = true_world() * Eigen::Vector3d(x, y, height(x, y));
        truth.points.push_back(p.cast<float>());
      }
    }
    strip.strip_from_world = world().inverse();
    std::vector<Eigen::Vector3d> feet;
    const auto bent = [&](double x, double y) {
      return Eigen::Vector3d(scale * x, scale * y, scale * (height(x, y) + bend * x * x));
    };
    for (int i = 0; i < kFrames; ++i) feet.push_back(bent(kStep * i, 0.0));
    strip.line = DrivenLine(feet);
    for (int i = 0; i < 140; ++i) {
      for (int j = -12; j < 12; ++j) {
        StripCell cell;
        cell.s = (i + 0.5) * kCell;
        cell.lateral = (j + 0.5) * kCell;
        cell.point = bent(cell.s / scale, cell.lateral / scale);
        cell.sigma = 0.01;
        strip.cells.push_back(cell);
      }
    }
  }

  static Eigen::Vector3d up() { return Eigen::Vector3d::UnitZ(); }
  static SE3 turned(double angle) {
    const Eigen::Vector3d axis = Eigen::Vector3d(1.0, -2.0, 0.7).normalized();
    return {Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis)), Eigen::Vector3d::Zero()};
  }
  static SE3 true_world() { return turned(1.1); }
  static SE3 world() { return turned(-0.4); }
  static SE3 camera_at(const Eigen::Vector3d& place, double pitch) {
    Eigen::Matrix3d axes;
    axes << 0, 0, 1, -1, 0, 0, 0, -1, 0;  // right, down, ahead
    const Eigen::AngleAxisd nose_up(-pitch, Eigen::Vector3d::UnitY());
    return {Eigen::Matrix3d(nose_up * axes), place};
  }
  StripErrors errors() const { return strip_errors(scene, drive, strip, truth, SE3()); }
};

TEST(StripErrors, OfTheTrueRoadAreNone) {
  const StripErrors e = MadeRoad().errors();
  // 8 m wide, from where the first camera's lower edge meets the road to 20 m beyond the last.
  EXPECT_GT(e.cells, 16 * 2 * 55);
  EXPECT_EQ(e.answered, e.cells);
  // A plane through points within 0.6 m: half the curvature times their mean square, 0.1 mm; the
  // line's pieces of 0.8 m: 0.2 mm.
  EXPECT_LT(e.height.p95, 5e-4);
  EXPECT_LT(e.joined.p95, 5e-4);
  EXPECT_LT(e.beside.p95, 5e-4);
  EXPECT_EQ(e.beside.with_sigma, e.beside.count);
  EXPECT_EQ(e.beside.within_95, 1.0);
  EXPECT_LT(e.grade_rms, 1e-4);
  EXPECT_EQ(e.frame_grade.count, MadeRoad::kFrames);
  EXPECT_LT(e.frame_grade_rms, 1e-6);
}

TEST(StripErrors, OfAnotherScaleAreNone) {
  const StripErrors e = MadeRoad(1.02).errors();
  // The same slopes; over 10 m a curvature of 0.002 per m that is 2 % less: 2 mm. Beyond the last
  // camera places are by metres, 0.2 m off at 10 m: times 10 m and the curvature 4 mm.
  EXPECT_LT(e.height.p95, 6e-3);
  EXPECT_GT(e.height.median, 5e-4);
  EXPECT_LT(e.grade_rms, 1e-4);
}

TEST(StripErrors, AreThoseOfTheCells) {
  MadeRoad made;
  const int cells = made.errors().cells;
  std::vector<StripCell> kept;
  int missing = 0;
  for (StripCell& c : made.strip.cells) {
    if (c.lateral > 0.0) c.point.z() += 0.03;
    if (c.s > 20.0 && c.s < 30.0 && c.lateral < -3.0 && c.lateral > -4.0) {
      ++missing;
    } else {
      kept.push_back(c);
    }
  }
  made.strip.cells = kept;
  const StripErrors e = made.errors();
  EXPECT_EQ(missing, 40);
  EXPECT_EQ(e.cells, cells);
  EXPECT_EQ(e.answered, cells - missing);
  EXPECT_NEAR(e.height.p95, 0.03, 1e-3);
  EXPECT_NEAR(e.beside.p95, 0.03, 1e-3);
  EXPECT_NEAR(e.beside.mean, 0.015, 1e-3);
  EXPECT_NEAR(e.beside.within_95, 0.5, 0.02);  // 3 cm for a sigma of 1 cm
  EXPECT_LT(e.grade_rms, 2e-4);
}

TEST(StripErrors, DriftOfTheRotationCountsUnlessTheFramesAreJoined) {
  const double bend = 2e-4;
  const StripErrors e = MadeRoad(1.0, bend).errors();
  // Over 10 m from x on the heights gain bend (20 x + 100), less the mean turn's 20 bend 23.6;
  // joined at x what is left is bend 100.
  EXPECT_NEAR(e.height.p95, bend * (20.0 * (44.8 - 23.6) + 100.0), 0.015);
  EXPECT_NEAR(e.joined.median, 100.0 * bend, 2e-3);
  EXPECT_LT(e.joined.p95, 100.0 * bend + 4e-3);
  EXPECT_LT(e.beside.p95, 2e-3);
  // 2 bend (x - 23.6) of frames 0 to 47.2 m.
  EXPECT_NEAR(e.grade_rms, 2.0 * bend * 47.2 / std::sqrt(12.0), 5e-4);
  EXPECT_NEAR(e.frame_grade_rms, e.grade_rms, 5e-4);
  EXPECT_LT(e.frame_grade.within_95, 0.5);
}

TEST(StripErrors, WhatAVehicleHidesIsNotCounted) {
  MadeRoad made;
  const int cells = made.errors().cells;
  for (TruthFrame& frame : made.scene.truth->frames) {
    TruthVehicle vehicle;  // on the left, before all that lies there
    vehicle.box = {0.0, 0.0, 499.5, 599.0};
    vehicle.pose.camera_from_vehicle = SE3(Eigen::Quaterniond::Identity(), {-1.0, 1.5, 2.0});
    vehicle.pose.dimensions = {0.5, 1.7, 1.5};
    frame.vehicles.push_back(vehicle);
  }
  const StripErrors e = made.errors();
  EXPECT_LT(e.cells, 0.55 * cells);
  EXPECT_GT(e.cells, 0.45 * cells);
}

TEST(StripErrors, PointsWithALabelCountWhereTheyAreRoad) {
  MadeRoad made;
  for (const Eigen::Vector3f& p : made.truth.points) {
    const Eigen::Vector3d level = MadeRoad::true_world().inverse() * p.cast<double>();
    made.truth.labels["label"].push_back(level.y() > 0.0 ? 2 : 1);
  }
  const int cells = MadeRoad().errors().cells;
  EXPECT_LT(made.errors().cells, 0.6 * cells);
  EXPECT_GT(made.errors().cells, 0.45 * cells);
}

TEST(StripErrors, NeedPosesAndMotion) {
  MadeRoad made;
  for (DriveFrame& frame : made.drive.frames) frame.id += 1000;
  EXPECT_THROW(made.errors(), NoAnswerError);
  MadeRoad standing;
  for (int i = 0; i < MadeRoad::kFrames; ++i) {
    const auto k = static_cast<std::size_t>(i);
    standing.scene.truth->frames[k].world_from_camera =
        standing.scene.truth->frames[0].world_from_camera;
    standing.scene.truth->frames[k].ego_plane = standing.scene.truth->frames[0].ego_plane;
  }
  EXPECT_THROW(standing.errors(), NoAnswerError);
  made.scene.truth.reset();
  EXPECT_THROW(made.errors(), std::invalid_argument);
  StripErrorOptions options;
  options.view = 0.0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

TEST(StripErrors, AsText) {
  EvaluatedStrip one{"truth", "estimate", MadeRoad().errors()};
  EXPECT_NE(strips_text({one}, false).find("estimate"), std::string::npos);
  EXPECT_EQ(to_json(one)["share_answered"], 1.0);
  EXPECT_TRUE(to_json({"truth", "estimate", {}})["share_answered"].is_null());
  EXPECT_TRUE(strips_text({}, false).empty());
}

}  // namespace
}  // namespace camber
