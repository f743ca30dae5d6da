#include "camber/road/segment_ground.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <numeric>
#include <sstream>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/point_tree.h"
#include "camber/core/random.h"
#include "plane/road_scene_maker.h"
#include "road/scan_maker.h"
#include "support/test_data.h"

namespace camber {
namespace {

constexpr double kDegree = M_PI / 180.0;

std::size_t count(const std::vector<int>& labels) {
  return static_cast<std::size_t>(std::count(labels.begin(), labels.end(), 1));
}

class ScanTest : public ::testing::TestWithParam<double> {};

// Street scenes differ in how many feet of walls, hedges and people they show: those points lie on
// the ground by any measure of height. The mean must pass the bar, none may be far below.
TEST_P(ScanTest, GroundOfMadeScansIsFound) {
  double sum = 0.0;
  constexpr int kScans = 2;
  for (int seed = 0; seed < kScans; ++seed) {
    test::ScanOptions made;
    made.seed = 100 + static_cast<std::uint64_t>(seed);
    made.grade = GetParam() * kDegree;
    const test::Scan scan = test::make_scan(made);
    ASSERT_GT(scan.cloud.size(), 110000u);
    const GroundSegmentation found = segment_ground(scan.cloud);
    ASSERT_EQ(found.status, Status::kOk) << found.reason;
    EXPECT_FALSE(found.from_air);
    const test::GroundScore score = test::score_ground(scan.ground, found.labels);
    EXPECT_GT(score.f1, 0.95) << "seed " << made.seed;
    sum += score.f1;
  }
  EXPECT_GE(sum / kScans, 0.965);
}
INSTANTIATE_TEST_SUITE_P(FlatAndHills, ScanTest, ::testing::Values(0.0, 6.0, 12.0));

TEST(SegmentGround, CameraCloudOfSixPlanesWithOutliers) {
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    test::RoadSceneOptions made;
    made.seed = 40 + seed;
    made.planes = 6;
    made.points = 100000;
    made.outlier_share = 0.3;
    const test::RoadScene scene = test::make_road_scene(made);
    const GroundSegmentation found = segment_ground(scene.cloud);
    ASSERT_EQ(found.status, Status::kOk);
    // Pavements, 15 cm above the road, are ground as well; the bar is passed either way.
    std::vector<int> road(scene.truth.size()), ground(scene.truth.size());
    for (std::size_t i = 0; i < road.size(); ++i) {
      road[i] = scene.truth[i] >= 0 ? 1 : 0;
      ground[i] = road[i] == 1 || scene.kinds[i] == test::PointSourceKind::kPavement ? 1 : 0;
    }
    EXPECT_GE(test::score_ground(road, found.labels).f1, 0.92) << "seed " << made.seed;
    EXPECT_GE(test::score_ground(ground, found.labels).f1, 0.92) << "seed " << made.seed;
  }
}

TEST(SegmentGround, AnyUpDirectionAndOrigin) {
  test::ScanOptions made;
  made.azimuths = 720;
  made.grade = 8.0 * kDegree;
  test::Scan scan = test::make_scan(made);
  const GroundSegmentation upright = segment_ground(scan.cloud);
  // The same scan in a camera's frame: x right, y down, z forward.
  RoadCloud camera = scan.cloud;
  for (Eigen::Vector3f& p : camera.points) p = Eigen::Vector3f(-p.y(), -p.z(), p.x());
  camera.origin = {1e5, 2e5, 300.0};
  GroundOptions options;
  options.up = {0.0, -2.0, 0.0};
  const GroundSegmentation turned = segment_ground(camera, options);
  const double a = test::score_ground(scan.ground, upright.labels).f1,
               b = test::score_ground(scan.ground, turned.labels).f1;
  EXPECT_NEAR(a, b, 0.01);  // the grid's axes are others
}

TEST(SegmentGround, OrderOfThePointsDoesNotMatter) {
  test::ScanOptions made;
  made.azimuths = 360;
  const test::Scan scan = test::make_scan(made);
  std::vector<int> order(scan.cloud.size());
  std::iota(order.begin(), order.end(), 0);
  std::reverse(order.begin(), order.end());
  const GroundSegmentation forward = segment_ground(scan.cloud);
  const GroundSegmentation backward = segment_ground(scan.cloud.select(order));
  std::size_t differing = 0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    differing += forward.labels[static_cast<std::size_t>(order[i])] != backward.labels[i] ? 1 : 0;
  }
  // Sums in another order differ in the last bits.
  EXPECT_LT(differing, order.size() / 1000);
  EXPECT_EQ(segment_ground(scan.cloud).labels, forward.labels);
}

/// A level floor of 20 points a square metre, with noise.
RoadCloud make_floor(double half) {
  RoadCloud cloud;
  const CounterRandom random(3);
  const auto points = static_cast<std::uint64_t>(80.0 * half * half);
  for (std::uint64_t i = 0; i < points; ++i) {
    cloud.points.emplace_back(static_cast<float>(random.uniform(3 * i, -half, half)),
                              static_cast<float>(random.uniform(3 * i + 1, -half, half)),
                              static_cast<float>(0.01 * random.normal(i)));
  }
  return cloud;
}

TEST(SegmentGround, KerbsDitchesAndPlateausAreGroundLowClustersAreNot) {
  RoadCloud cloud = make_floor(30.0);
  std::vector<int> truth(cloud.size(), 1);
  for (Eigen::Vector3f& p : cloud.points) {
    if (p.y() > 5.0f) p.z() += 0.15f;                      // behind a kerb
    if (p.x() > 10.0f && p.x() < 12.0f) p.z() -= 0.4f;     // a ditch
    if (p.x() < -15.0f) p.z() += 0.2f * (-15.0f - p.x());  // a bank
  }
  const std::size_t ground = cloud.size();
  for (int i = 0; i < 12; ++i) {  // a cluster of reflections below the road
    cloud.points.emplace_back(2.0f + 0.05f * static_cast<float>(i), -3.0f, -1.2f);
    truth.push_back(0);
  }
  for (int i = 0; i < 4000; ++i) {  // a box of 4 m x 2 m x 1.5 m: top and sides
    const float u = static_cast<float>(i % 80) * 0.05f, v = static_cast<float>(i / 80) * 0.04f;
    cloud.points.emplace_back(-5.0f + u, -6.0f + v, 1.5f);
    cloud.points.emplace_back(-5.0f + u, -6.0f, 0.75f * v);
    truth.insert(truth.end(), 2, 0);
  }
  const GroundSegmentation found = segment_ground(cloud);
  std::size_t missed = 0, wrong_low = 0, wrong_box = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (i < ground) {
      missed += found.labels[i] == 0 ? 1 : 0;
    } else if (i < ground + 12) {
      wrong_low += found.labels[i] == 1 ? 1 : 0;
    } else {
      wrong_box += found.labels[i] == 1 && cloud.points[i].z() > 0.2f ? 1 : 0;
    }
  }
  EXPECT_LT(missed, ground / 40);  // cells astride the ditch's upright sides
  EXPECT_EQ(wrong_low, 0u);
  EXPECT_EQ(wrong_box, 0u);
}

TEST(SegmentGround, OddInput) {
  EXPECT_EQ(segment_ground(RoadCloud()).status, Status::kFailed);
  RoadCloud cloud = make_floor(10.0);
  const std::size_t all = cloud.size();
  const float nan = std::numeric_limits<float>::quiet_NaN();
  cloud.points.emplace_back(nan, 0.0f, 0.0f);
  cloud.points.emplace_back(0.0f, std::numeric_limits<float>::infinity(), 0.0f);
  cloud.points.emplace_back(4e8f, -4e8f, 0.0f);  // one point in another country
  cloud.points.emplace_back(0.0f, 0.0f, -1e6f);
  cloud.points.emplace_back(0.0f, 0.0f, 1e6f);
  const GroundSegmentation found = segment_ground(cloud);
  ASSERT_EQ(found.status, Status::kOk);
  EXPECT_GT(count(found.labels), all * 98 / 100);
  for (std::size_t i = all; i < cloud.size(); ++i) EXPECT_EQ(found.labels[i], 0) << i;
  EXPECT_EQ(found.ground, count(found.labels));
  // All points at one place, or in one line.
  RoadCloud one;
  one.points.assign(100, Eigen::Vector3f(1.0f, 2.0f, 3.0f));
  EXPECT_EQ(count(segment_ground(one).labels), 100u);
  for (int i = 0; i < 100; ++i) one.points[static_cast<std::size_t>(i)].x() = static_cast<float>(i);
  EXPECT_EQ(count(segment_ground(one).labels), 100u);
}

// A dense airborne scan: roofs far wider than any vehicle, trees that let some pulses through.
TEST(SegmentGround, DenseScanFromTheAir) {
  RoadCloud cloud;
  std::vector<int> truth;
  const CounterRandom random(8);
  for (std::uint64_t i = 0; i < 150000; ++i) {
    const double x = random.uniform(8 * i, 0, 150), y = random.uniform(8 * i + 1, 0, 120);
    double z = 0.12 * x + 3.0 * std::sin(y / 30.0);
    const double u = std::fmod(x, 50.0), v = std::fmod(y, 60.0);
    bool ground = true;
    if (u > 10 && u < 32 && v > 10 && v < 28) {
      z = 0.12 * (x - u + 20.0) + 3.0 * std::sin((y - v + 20.0) / 30.0) + 9.0;  // a flat roof
      ground = false;
    } else if (std::hypot(u - 42.0, v - 45.0) < 5.0 && random.uniform(8 * i + 2) < 0.7) {
      z += random.uniform(8 * i + 3, 2.0, 8.0);
      ground = false;
    }
    cloud.points.push_back(Eigen::Vector3d(x, y, z + 0.03 * random.normal(i)).cast<float>());
    truth.push_back(ground ? 1 : 0);
  }
  const GroundSegmentation found = segment_ground(cloud);
  EXPECT_TRUE(found.from_air);
  EXPECT_GT(test::score_ground(truth, found.labels).f1, 0.99);
}

TEST(SegmentGround, ExtremeOptionsEnd) {
  const RoadCloud cloud = make_floor(10.0);
  GroundOptions options;
  options.largest_object = 1e30;
  EXPECT_GT(segment_ground(cloud, options).ground, cloud.size() / 2);
  options = {};
  options.cell = 1e-9;  // grows until the grid fits the points
  const GroundSegmentation fine = segment_ground(cloud, options);
  EXPECT_GT(fine.cell, 0.01);
  options.cell = 1e6;
  EXPECT_EQ(segment_ground(cloud, options).cell, 1e6);
}

TEST(SegmentGround, SensorHeightSaysWhatTheGroundIsUnderTheSensor) {
  // Ground from 12 m on, and a wide vehicle below the sensor.
  const RoadCloud cloud = make_floor(20.0);
  RoadCloud seen;
  for (const Eigen::Vector3f& p : cloud.points) {
    if (p.head<2>().norm() > 12.0f) seen.points.emplace_back(p.x(), p.y(), p.z() - 1.7f);
  }
  const std::size_t ground = seen.size();
  for (int i = 0; i < 400; ++i) {
    seen.points.emplace_back(-2.4f + 0.24f * static_cast<float>(i % 20),
                             -2.4f + 0.24f * static_cast<float>(i / 20), -0.5f);
  }
  const auto on_vehicle = [&](const GroundSegmentation& found) {
    return std::count(found.labels.begin() + static_cast<std::ptrdiff_t>(ground),
                      found.labels.end(), 1);
  };
  GroundOptions options;
  EXPECT_GT(on_vehicle(segment_ground(seen, options)), 0);
  options.sensor_height = 1.7;
  const GroundSegmentation found = segment_ground(seen, options);
  EXPECT_EQ(on_vehicle(found), 0);
  EXPECT_GT(found.ground, ground * 98 / 100);
}

/// Boxes on a slope.
RoadCloud boxes_on_slope(std::uint64_t points) {
  RoadCloud cloud;
  const CounterRandom random(11);
  for (std::uint64_t i = 0; i < points; ++i) {
    const double x = random.uniform(3 * i, -90, 90), y = random.uniform(3 * i + 1, -90, 90);
    const bool box = std::fmod(x + 100.0, 20.0) < 3.0 && std::fmod(y + 100.0, 15.0) < 4.0;
    const double z = 0.05 * x + 0.02 * random.normal(i) + (box ? random.uniform(3 * i + 2) : 0.0);
    cloud.points.emplace_back(Eigen::Vector3d(x, y, z).cast<float>());
  }
  return cloud;
}

TEST(SegmentGround, SameLabelsForAnyNumberOfThreads) {
  // Threads take parts of the points where these are few, slices of the grid where they are many.
  for (const std::uint64_t points : {150000, 700000}) {
    const RoadCloud cloud = boxes_on_slope(points);
    GroundOptions options;
    options.num_threads = 1;
    const GroundSegmentation one = segment_ground(cloud, options);
    EXPECT_GT(one.ground, points * 5 / 7);
    for (const int threads : {2, 3, 8}) {
      options.num_threads = threads;
      const GroundSegmentation several = segment_ground(cloud, options);
      EXPECT_EQ(several.labels, one.labels) << threads;
      EXPECT_EQ(several.ground, one.ground) << threads;
      EXPECT_EQ(several.tolerance, one.tolerance) << threads;
    }
  }
}

TEST(SegmentGround, RefusesBadOptions) {
  GroundOptions options;
  options.up = Eigen::Vector3d::Zero();
  EXPECT_THROW(segment_ground({}, options), std::invalid_argument);
  options = {};
  options.cell = -1.0;
  EXPECT_THROW(segment_ground({}, options), std::invalid_argument);
  options = {};
  options.tolerance = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(segment_ground({}, options), std::invalid_argument);
}

// A real sweep on a city street, against the map's measured ground raster.
TEST(SegmentGround, RealSweepAgainstMeasuredGround) {
  CAMBER_REQUIRE_DATA("argoverse2-ground/adcf7d18");
  const auto folder = test::data_dir() / "argoverse2-ground/adcf7d18";
  std::filesystem::path sweep_file;
  std::string stamp;
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    const std::string name = entry.path().filename().string();
    if (name.rfind("sweep_", 0) == 0 && entry.path().extension() == ".ply") {
      sweep_file = entry.path();
    }
  }
  ASSERT_FALSE(sweep_file.empty());
  const RoadCloud sweep = read_cloud(sweep_file), raster = read_cloud(folder / "ground.ply");
  std::ifstream in(folder / (sweep_file.stem().string() + "_pose.csv"));
  std::string row, word;
  for (std::string line; std::getline(in, line);) {
    if (!line.empty()) row = line;
  }
  std::vector<double> pose;
  for (std::istringstream words(row); std::getline(words, word, ',');) {
    pose.push_back(std::stod(word));
  }
  ASSERT_GE(pose.size(), 7u);
  const double* const v = pose.data() + pose.size() - 7;
  const Eigen::Quaterniond turn(v[0], v[1], v[2], v[3]);
  const Eigen::Vector3d shift(v[4], v[5], v[6]);
  std::vector<Eigen::Vector3f> plan;
  for (const Eigen::Vector3f& p : raster.points) plan.emplace_back(p.x(), p.y(), 0.0f);
  const PointTree tree(plan);
  const GroundSegmentation found = segment_ground(sweep);
  ASSERT_EQ(found.status, Status::kOk);
  // A street full of vehicles: less than a tenth of the points are ground.
  double road = 0.0, missed = 0.0, above = 0.0, taken = 0.0;
  for (std::size_t i = 0; i < sweep.size(); ++i) {
    const Eigen::Vector3d p = turn * sweep.points[i].cast<double>() + shift - raster.origin;
    const auto near = tree.nearest(
        Eigen::Vector3f(static_cast<float>(p.x()), static_cast<float>(p.y()), 0.0f), 0.3f);
    if (near.index < 0) continue;
    const std::size_t at = static_cast<std::size_t>(near.index);
    if (raster.labels.at("drivable")[at] == 0) continue;
    const double height = p.z() - static_cast<double>(raster.points[at].z());
    if (std::abs(height) < 0.1) {
      road += 1.0;
      missed += found.labels[i] == 0 ? 1.0 : 0.0;
    } else if (height > 0.3) {
      above += 1.0;
      taken += found.labels[i] == 1 ? 1.0 : 0.0;
    }
  }
  ASSERT_GT(road, 5000.0);
  EXPECT_LT(missed, 0.015 * road);
  EXPECT_LT(taken, 0.01 * above);
}

// Airborne scans of hills, towns and a quarry with ground marked by hand.
TEST(SegmentGround, AirborneTerrain) {
  CAMBER_REQUIRE_DATA("isprs-filter-terrain");
  double sum = 0.0;
  for (const char* sample : {"11", "21", "23", "41", "51", "53", "61"}) {
    const std::string base =
        (test::data_dir() / "isprs-filter-terrain" / ("samp" + std::string(sample) + "-utm"))
            .string();
    const RoadCloud all = read_cloud(base + ".pcd"), marked = read_cloud(base + "-ground.pcd");
    using Place = std::array<double, 3>;
    const auto place = [](const RoadCloud& cloud, std::size_t i) {
      const Eigen::Vector3d p = cloud.origin + cloud.points[i].cast<double>();
      return Place{p.x(), p.y(), p.z()};
    };
    std::vector<Place> ground;
    for (std::size_t i = 0; i < marked.size(); ++i) ground.push_back(place(marked, i));
    std::sort(ground.begin(), ground.end());
    const GroundSegmentation found = segment_ground(all);
    EXPECT_TRUE(found.from_air);
    double wrong = 0.0;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const bool truth = std::binary_search(ground.begin(), ground.end(), place(all, i));
      wrong += truth != (found.labels[i] == 1) ? 1.0 : 0.0;
    }
    const double total = wrong / static_cast<double>(all.size());
    EXPECT_LT(total, 0.12) << sample;  // 9 % on the two steepest
    sum += total;
  }
  EXPECT_LT(sum / 7.0, 0.065);
}

}  // namespace
}  // namespace camber
