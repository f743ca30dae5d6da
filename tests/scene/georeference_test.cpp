#include "camber/scene/georeference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kDegree = M_PI / 180.0;
const Vector3d kPlace(456123.25, 5428456.75, 112.5);

/// Cameras on a bend that climbs, pitched and rolled against gravity, and the map that they are on.
struct MadeRun {
  Scene scene;
  RunDocument run;
  RoadSurface surface;
  SE3 map_from_reference;

  /// @param apart  m between the frames
  MadeRun(int frames, double apart) {
    const SE3 level_from_camera(Eigen::Quaterniond(Eigen::AngleAxisd(0.03, Vector3d::UnitZ()) *
                                                   Eigen::AngleAxisd(-0.05, Vector3d::UnitX())),
                                Vector3d::Zero());
    // Level: x right, y down, z ahead. Map: x east, y north, z up.
    Eigen::Matrix3d map_from_level;
    map_from_level << 1, 0, 0, 0, 0, 1, 0, -1, 0;
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(heading_of_level, Vector3d::UnitZ()).toRotationMatrix();
    map_from_reference = SE3(Eigen::Matrix3d(turn * map_from_level), kPlace) * level_from_camera;
    surface.up = level_from_camera.rotation_matrix().transpose() * Vector3d(0, -1, 0);
    surface.level = RoadSurface::Level::kGravity;
    surface.level_sigma = 0.002;
    scene.map_crs = "EPSG:32632";
    scene.antenna = {0.4, -0.5, -1.2};
    for (int i = 0; i < frames; ++i) {
      const double s = apart * (i - frames / 2), bend = 0.01 * s;
      const SE3 pose(Eigen::Quaterniond(Eigen::AngleAxisd(bend, Vector3d::UnitY())),
                     {0.5 * s * bend, -0.05 * s, s});
      run.cameras.push_back({i, level_from_camera.inverse() * pose * level_from_camera});
      SceneFrame frame;
      frame.id = i;
      frame.map_position.emplace();
      frame.map_position->position =
          map_from_reference * (run.cameras.back().reference_from_camera * scene.antenna);
      frame.map_position->sigma = 0.5;
      frame.map_position->height_sigma = 0.8;
      scene.frames.push_back(frame);
    }
  }
  double true_heading(int frame) const {
    const Vector3d view =
        map_from_reference.rotation() *
        (run.cameras[static_cast<std::size_t>(frame)].reference_from_camera.rotation() *
         Vector3d::UnitZ());
    return std::atan2(view.y(), view.x());
  }
  GeoReference fit() const { return fit_georeference(scene, run, surface); }

  static constexpr double heading_of_level = 0.7;
};

double angle_between(const SE3& a, const SE3& b) {
  return rotation_to_vector((a.inverse() * b).rotation()).norm();
}

TEST(Georeference, UtmZones) {
  EXPECT_EQ(utm_crs(49.0, 8.4), "EPSG:32632");
  EXPECT_EQ(utm_crs(-33.9, 151.2), "EPSG:32756");
  EXPECT_EQ(utm_crs(60.4, 5.3), "EPSG:32632");   // Bergen
  EXPECT_EQ(utm_crs(78.2, 15.6), "EPSG:32633");  // Svalbard
  EXPECT_EQ(utm_crs(0.0, -180.0), "EPSG:32601");
  EXPECT_EQ(utm_crs(10.0, 179.99), "EPSG:32660");
  EXPECT_EQ(utm_crs(10.0, 183.0), utm_crs(10.0, -177.0));
}

TEST(Georeference, ExactPositionsGiveTheMap) {
  const MadeRun made(7, 3.0);
  const GeoReference fit = made.fit();
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  EXPECT_EQ(fit.crs, "EPSG:32632");
  EXPECT_EQ(fit.positions, 7);
  EXPECT_LT(angle_between(fit.map_from_reference, made.map_from_reference), 1e-7);
  EXPECT_LT(
      (fit.map_from_reference * Vector3d(1, 2, 30) - made.map_from_reference * Vector3d(1, 2, 30))
          .norm(),
      1e-5);
  EXPECT_LT(fit.residual_rms, 1e-6);
  EXPECT_EQ(fit.level, RoadSurface::Level::kGravity);
}

/// Errors of positions in common and of each, m.
void disturb(MadeRun* made, std::uint64_t trial, double common, double independent) {
  const CounterRandom random(31, trial);
  for (std::size_t i = 0; i < made->scene.frames.size(); ++i) {
    Vector3d& position = made->scene.frames[i].map_position->position;
    for (int k = 0; k < 2; ++k) {
      position[k] += common * random.normal(static_cast<std::uint64_t>(k)) +
                     independent * random.normal(10 + 2 * i + static_cast<std::uint64_t>(k));
    }
  }
}

TEST(Georeference, SigmasAreThoseOfTheErrors) {
  constexpr int kTrials = 400;
  double headings = 0.0, shifts = 0.0;
  for (int trial = 0; trial < kTrials; ++trial) {
    MadeRun scattered(9, 4.0), shifted(9, 4.0);
    disturb(&scattered, static_cast<std::uint64_t>(trial), 0.0, 0.5);
    disturb(&shifted, static_cast<std::uint64_t>(trial), 0.5, 0.0);
    const GeoReference a = scattered.fit(), b = shifted.fit();
    ASSERT_TRUE(a.known()) << a.reason;
    headings += std::pow(
        angle_between(a.map_from_reference, scattered.map_from_reference) / a.heading_sigma, 2);
    const Vector3d off =
        b.map_from_reference.translation() - shifted.map_from_reference.translation();
    shifts += 0.5 * off.head<2>().squaredNorm() / (b.position_sigma * b.position_sigma);
  }
  // Root mean squares in standard deviations; 400 trials know them to 4 %.
  EXPECT_NEAR(std::sqrt(headings / kTrials), 1.0, 0.12);
  EXPECT_NEAR(std::sqrt(shifts / kTrials), 1.0, 0.12);
}

TEST(Georeference, ThreeFramesOverAMetreNeedAHeading) {
  MadeRun made(3, 0.6);
  EXPECT_EQ(made.fit().status, Status::kFailed);
  EXPECT_THAT(made.fit().reason, HasSubstr("span 1.2 m"));
  for (int i = 0; i < 3; ++i) {
    MapPosition& position = *made.scene.frames[static_cast<std::size_t>(i)].map_position;
    position.heading = made.true_heading(i) + 0.5 * kDegree;
    position.heading_sigma = kDegree;
  }
  GeoReference fit = made.fit();
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  EXPECT_NEAR(fit.heading_sigma, kDegree, 0.01 * kDegree);  // in common, not a third of it
  EXPECT_NEAR(angle_between(fit.map_from_reference, made.map_from_reference), 0.5 * kDegree,
              0.01 * kDegree);
  for (SceneFrame& frame : made.scene.frames) frame.map_position->heading_sigma = 4.0 * kDegree;
  fit = made.fit();
  EXPECT_EQ(fit.status, Status::kWeak);
  EXPECT_THAT(fit.reason, HasSubstr("4.0 degrees"));
  made.run.cameras.resize(1);
  made.scene.frames[0].map_position->heading.reset();
  EXPECT_THAT(made.fit().reason, HasSubstr("not at all"));
}

TEST(Georeference, Refusals) {
  MadeRun stretched(7, 10.0);
  for (SceneFrame& frame : stretched.scene.frames) {
    Vector3d& position = frame.map_position->position;
    position = kPlace + 1.3 * (position - kPlace);
  }
  EXPECT_EQ(stretched.fit().status, Status::kFailed);
  EXPECT_THAT(stretched.fit().reason, HasSubstr("standard deviations"));
  MadeRun unscaled(7, 10.0);
  unscaled.surface.metric = false;
  EXPECT_THAT(unscaled.fit().reason, HasSubstr("unknown scale"));
  put_georeference(unscaled.scene, unscaled.surface, &unscaled.run);
  ASSERT_EQ(unscaled.run.warnings.size(), 1u);
  EXPECT_EQ(unscaled.run.warnings[0].code, "no_georeference");
  EXPECT_FALSE(georeference_of(unscaled.run, "run.json"));
  MadeRun nowhere(3, 1.0);
  for (SceneFrame& frame : nowhere.scene.frames) frame.map_position.reset();
  EXPECT_EQ(nowhere.fit().status, Status::kNotRun);
  put_georeference(nowhere.scene, nowhere.surface, &nowhere.run);
  EXPECT_FALSE(nowhere.run.extra->contains("georeference"));
}

TEST(Georeference, HeightsThatAreNotKnownStartAtTheReferenceCamera) {
  MadeRun made(7, 3.0);
  made.scene.frames[2].map_position->position.z() = std::nan("");
  const GeoReference fit = made.fit();
  ASSERT_TRUE(fit.known());
  EXPECT_NEAR(fit.map_from_reference.translation().z(), 0.0, 1e-9);
  EXPECT_NEAR(fit.map_from_reference.translation().x(), kPlace.x(), 1e-5);
  EXPECT_TRUE(std::isnan(fit.height_sigma));
}

TEST(Georeference, StandsInRunJson) {
  MadeRun made(7, 3.0);
  put_georeference(made.scene, made.surface, &made.run);
  const test::TemporaryFolder folder;
  const fs::path file = folder.path() / "run.json";
  write_json(to_json(made.run), file);
  const auto back = georeference_of(read_run(file), file);
  ASSERT_TRUE(back);
  const GeoReference fit = made.fit();
  EXPECT_EQ(back->crs, "EPSG:32632");
  EXPECT_LT((back->map_from_reference.matrix() - fit.map_from_reference.matrix()).norm(), 1e-8);
  EXPECT_DOUBLE_EQ(back->position_sigma, fit.position_sigma);
  EXPECT_NEAR(back->heading_sigma, fit.heading_sigma, 1e-12);
  EXPECT_EQ(back->level, RoadSurface::Level::kGravity);
}

}  // namespace
}  // namespace camber
