#include "camber/scene/georeference.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/scene/detail/own_data.h"
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

/// A map whose metres are plain to compute with, turned by 0.1 rad against true north.
std::vector<MapPlace> plain_map(const std::string&, const std::vector<GeoPoint>& points) {
  std::vector<MapPlace> out;
  for (const GeoPoint& p : points) out.push_back({1e5 * p.longitude, 1e5 * p.latitude, 0.1});
  return out;
}

class Gnss : public ::testing::Test {
 protected:
  Gnss() {
    for (int i = 0; i < 4; ++i) {
      SceneFrame frame;
      frame.id = 10 + i;
      frame.time_s = 100.0 + 0.5 * i;
      import_.scene.frames.push_back(frame);
    }
    options_.file = folder_.path() / "log";
    options_.projection = plain_map;
  }
  const MapPosition& at(std::size_t i) const { return *import_.scene.frames[i].map_position; }
  void put(const std::string& text, const char* name = "log") {
    options_.file = folder_.path() / name;
    std::ofstream(options_.file) << text;
    put_gnss(import_.scene, options_, import_);
  }

  test::TemporaryFolder folder_;
  OwnImport import_;
  GnssOptions options_;
};

TEST_F(Gnss, TablesByTimeAreInterpolated) {
  options_.offset = "1000";
  options_.antenna = {0, -1, 0};
  put("time,latitude,longitude,altitude,sigma\n"
      "-900,49.00001,8.00001,100,0.5\n"
      "-899,49.00002,8.00003,102,0.7\n");
  EXPECT_EQ(import_.scene.map_crs, "EPSG:32632");
  EXPECT_EQ(import_.scene.antenna, Vector3d(0, -1, 0));
  EXPECT_LT((at(0).position - Vector3d(800001, 4900001, 100)).norm(), 1e-6);
  EXPECT_LT((at(1).position - Vector3d(800002, 4900001.5, 101)).norm(), 1e-6);
  EXPECT_DOUBLE_EQ(at(1).sigma, 0.7);
  EXPECT_FALSE(at(1).heading);
  EXPECT_TRUE(import_.scene.frames[2].map_position);
  EXPECT_FALSE(import_.scene.frames[3].map_position);  // beyond the log
}

TEST_F(Gnss, TablesByFrame) {
  options_.sigma = 1.25;
  options_.crs = "EPSG:25833";
  put("frame,lat,lon\n11,49.1,8.1\n12,49.2,8.2\n");
  EXPECT_EQ(import_.scene.map_crs, "EPSG:25833");
  EXPECT_FALSE(import_.scene.frames[0].map_position);
  EXPECT_LT((at(1).position.head<2>() - Eigen::Vector2d(810000, 4910000)).norm(), 1e-6);
  EXPECT_TRUE(std::isnan(at(1).position.z()));
  EXPECT_DOUBLE_EQ(at(2).sigma, 1.25);
}

TEST_F(Gnss, GpxFromItsFirstPoint) {
  options_.offset = "first";
  put("<gpx version=\"1.1\"><trk><trkseg>"
      "<trkpt lat=\"49\" lon=\"8\"><ele>5</ele><time>2020-01-01T00:00:00Z</time></trkpt>"
      "<trkpt lat=\"49.001\" lon=\"8\"><ele>7</ele><time>2020-01-01T00:00:02Z</time></trkpt>"
      "</trkseg></trk></gpx>");
  EXPECT_LT((at(3).position - Vector3d(800000, 4900075, 6.5)).norm(), 1e-6);
}

TEST_F(Gnss, OxtsHasHeadingsAgainstTheMapsNorth) {
  std::string row = "49.01 8.43 112.8 0.02 0.01 0.5";
  for (int i = 6; i < 30; ++i) row += i == 23 ? " 0.25" : " 0";
  std::string rows;
  for (int i = 0; i < 12; ++i) rows += row + "\n";
  put(rows, "oxts.txt");
  EXPECT_FALSE(import_.scene.frames[2].map_position);  // rows are frames 0 to 11
  EXPECT_DOUBLE_EQ(at(0).sigma, 0.25);
  ASSERT_TRUE(at(0).heading);
  EXPECT_NEAR(*at(0).heading, 0.5 + 0.1, 1e-12);
  EXPECT_LT((at(1).position - Vector3d(843000, 4901000, 112.8)).norm(), 1e-6);
}

TEST_F(Gnss, Refusals) {
  EXPECT_THROW(put("time,latitude,longitude\n1,49,8\n2,49,8\n"), InputError);  // other times
  EXPECT_THROW(put("frame,latitude,longitude\n1,49,8\n2,49,8\n"), InputError);
  EXPECT_THROW(put("latitude,longitude\n49,8\n49,8\n"), InputError);
  EXPECT_THROW(put("frame,latitude,longitude,sigma\n10,49,8,-1\n"), InputError);
  options_.offset = "soon";
  EXPECT_THROW(put("time,latitude,longitude\n100,49,8\n102,49,8\n"), UsageError);
}

TEST_F(Gnss, StandsInTheManifest) {
  put("frame,lat,lon\n10,49.1,8.1\n13,49.2,8.2\n");
  Scene& scene = import_.scene;
  scene.camera = {64, 48, 50, 50, 32, 24};
  scene.frames[0].map_position->heading = 0.25;
  write_scene(scene, folder_.path() / "scene.json");
  const Scene back = read_scene(folder_.path());
  EXPECT_EQ(back.map_crs, scene.map_crs);
  ASSERT_TRUE(back.frames[0].map_position);
  EXPECT_EQ(back.frames[0].map_position->position.head<2>(), at(0).position.head<2>());
  EXPECT_TRUE(std::isnan(back.frames[0].map_position->position.z()));
  EXPECT_NEAR(*back.frames[0].map_position->heading, 0.25, 1e-12);
  EXPECT_FALSE(back.frames[1].map_position);
}

}  // namespace
}  // namespace camber
