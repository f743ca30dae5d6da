// Normals, outlier removal, cropping and thinning, against brute force and by hand.

#include "camber/cloud/filters.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <map>
#include <set>

#include "camber/cloud/normals.h"
#include "camber/cloud/voxel_grid.h"
#include "cloud/cloud_files.h"

namespace camber {
namespace {

const float kNan = std::numeric_limits<float>::quiet_NaN();

RoadCloud noisy_hill(std::size_t count) {
  const CounterRandom random(53);
  RoadCloud cloud;
  for (std::size_t i = 0; i < count; ++i) {
    const double x = random.uniform(3 * i, -20, 20), y = random.uniform(3 * i + 1, 0, 60);
    cloud.points.emplace_back(x, y, 0.004 * y * y + 0.01 * random.normal(i));
  }
  return cloud;
}

std::vector<int> nearest_by_brute_force(const RoadCloud& cloud, std::size_t of, int k) {
  std::vector<std::pair<double, int>> all;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!cloud.points[i].allFinite()) continue;
    all.emplace_back((cloud.points[i] - cloud.points[of]).cast<double>().squaredNorm(),
                     static_cast<int>(i));
  }
  std::sort(all.begin(), all.end());
  std::vector<int> out;
  for (int i = 0; i < k && i < static_cast<int>(all.size()); ++i)
    out.push_back(all[static_cast<std::size_t>(i)].second);
  return out;
}

TEST(Normals, AreTheLeastEigenvectorsOfTheNeighbours) {
  RoadCloud cloud = noisy_hill(2000);
  cloud.points[100].z() = kNan;
  NormalOptions options;
  options.neighbors = 15;
  estimate_normals(cloud, options);
  ASSERT_EQ(cloud.normals.size(), cloud.size());
  EXPECT_TRUE(std::isnan(cloud.normals[100].x()));
  for (std::size_t i = 0; i < cloud.size(); i += 37) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    const std::vector<int> near = nearest_by_brute_force(cloud, i, 15);
    for (const int j : near)
      mean += cloud.points[static_cast<std::size_t>(j)].cast<double>() / 15.0;
    Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
    for (const int j : near) {
      const Eigen::Vector3d d = cloud.points[static_cast<std::size_t>(j)].cast<double>() - mean;
      covariance += d * d.transpose();
    }
    const Eigen::Vector3d expected =
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvectors().col(0);
    const Eigen::Vector3d n = cloud.normals[i].cast<double>();
    EXPECT_NEAR(std::abs(n.dot(expected)), 1.0, 1e-6);  // sums in float: 1e-3 rad
    EXPECT_NEAR(n.norm(), 1.0, 1e-6);
    EXPECT_GT(n.z(), 0.0);
  }
}

TEST(Normals, OfAPlaneAreExactAndPointWhereTold) {
  const CounterRandom random(59);
  const Eigen::Vector3f truth = Eigen::Vector3f(0.2f, -0.9f, 0.3f).normalized();
  const Eigen::Vector3f u = truth.unitOrthogonal(), v = truth.cross(u);
  RoadCloud cloud;
  cloud.origin = {5000, 0, 0};
  for (std::uint64_t i = 0; i < 500; ++i) {
    cloud.points.push_back(static_cast<float>(random.uniform(2 * i, -5, 5)) * u +
                           static_cast<float>(random.uniform(2 * i + 1, -5, 5)) * v +
                           10.0f * truth);
  }
  NormalOptions options;
  options.up = {0, -1, 0};
  estimate_normals(cloud, options);
  for (const Eigen::Vector3f& n : cloud.normals) EXPECT_LT((n - truth).norm(), 1e-4f);
  options.viewpoint = {5000, 0, 0};  // below the plane, seen along its normal
  estimate_normals(cloud, options);
  for (const Eigen::Vector3f& n : cloud.normals) EXPECT_LT((n + truth).norm(), 1e-4f);
}

TEST(Normals, WhereThereAreNoneAndBadOptions) {
  RoadCloud line;
  for (int i = 0; i < 10; ++i) line.points.emplace_back(static_cast<float>(i), 0.0f, 0.0f);
  estimate_normals(line);
  for (const Eigen::Vector3f& n : line.normals) EXPECT_TRUE(std::isnan(n.x()));
  // Lines askew, whose places are rounded, also away from zero.
  for (const Eigen::Vector3d& way : {Eigen::Vector3d(0.1, 0.2, 0.3), Eigen::Vector3d(3, -1, 0.7)}) {
    for (const double from : {0.0, 40.0}) {
      RoadCloud askew;
      for (int i = 0; i < 200; ++i) askew.points.emplace_back((from * way + i * way).cast<float>());
      for (const int neighbors : {3, 20, 60}) {
        NormalOptions options;
        options.neighbors = neighbors;
        estimate_normals(askew, options);
        int known = 0;
        for (const Eigen::Vector3f& n : askew.normals) known += n.array().isNaN().any() ? 0 : 1;
        EXPECT_EQ(known, 0) << neighbors << " of a line from " << from;
      }
    }
  }
  // A strip of two rows, 0.02 m apart and of 1 m length, is a plane.
  RoadCloud strip;
  for (int i = 0; i < 50; ++i) {
    strip.points.emplace_back(0.02f * static_cast<float>(i), i % 2 ? 0.02f : 0.0f, 0.0f);
  }
  NormalOptions all;
  all.neighbors = 50;
  estimate_normals(strip, all);
  for (const Eigen::Vector3f& n : strip.normals) {
    EXPECT_LT((n - Eigen::Vector3f(0, 0, 1)).norm(), 1e-5f);
  }
  RoadCloud two;
  two.points = {{0, 0, 0}, {1, 0, 0}};
  estimate_normals(two);
  EXPECT_TRUE(std::isnan(two.normals[1].z()));
  RoadCloud same;
  same.points.assign(50, {1, 2, 3});
  estimate_normals(same);
  EXPECT_TRUE(std::isnan(same.normals[7].z()));
  RoadCloud empty;
  estimate_normals(empty);
  EXPECT_TRUE(empty.normals.empty());
  // A radius leaves out the far ones.
  RoadCloud cloud;
  cloud.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 50}, {1, 0, 50}};
  NormalOptions near;
  near.radius = 2.0f;
  estimate_normals(cloud, near);
  EXPECT_LT((cloud.normals[0] - Eigen::Vector3f(0, 0, 1)).norm(), 1e-6f);
  EXPECT_TRUE(std::isnan(cloud.normals[3].x()));
  NormalOptions bad;
  bad.neighbors = 2;
  EXPECT_THROW(estimate_normals(cloud, bad), std::invalid_argument);
  bad = {};
  bad.up.setZero();
  EXPECT_THROW(estimate_normals(cloud, bad), std::invalid_argument);
  bad = {};
  bad.radius = -1.0f;
  EXPECT_THROW(estimate_normals(cloud, bad), std::invalid_argument);
}

TEST(Normals, AreTheSameForAnyNumberOfThreads) {
  RoadCloud one = noisy_hill(20000), many = one;
  NormalOptions options;
  options.num_threads = 1;
  estimate_normals(one, options);
  options.num_threads = 8;
  estimate_normals(many, options);
  EXPECT_EQ(one.normals, many.normals);
}

TEST(StatisticalInliers, FollowTheRuleOfMeanDistances) {
  RoadCloud cloud = noisy_hill(1500);
  const CounterRandom random(61);
  for (std::uint64_t i = 0; i < 60; ++i) {
    cloud.points.emplace_back(random.uniform(3 * i, -100, 100),
                              random.uniform(3 * i + 1, -100, 100),
                              random.uniform(3 * i + 2, 5, 50));
  }
  cloud.points.emplace_back(kNan, 0.0f, 0.0f);
  std::vector<double> means;
  for (std::size_t i = 0; i + 1 < cloud.size(); ++i) {
    double sum = 0.0;
    for (const int j : nearest_by_brute_force(cloud, i, 9)) {
      sum += (cloud.points[static_cast<std::size_t>(j)] - cloud.points[i]).norm();
    }
    means.push_back(sum / 8.0);
  }
  double mean = 0.0, variance = 0.0;
  for (const double m : means) mean += m / static_cast<double>(means.size());
  for (const double m : means)
    variance += (m - mean) * (m - mean) / static_cast<double>(means.size() - 1);
  std::vector<int> expected;
  for (std::size_t i = 0; i < means.size(); ++i) {
    if (means[i] <= mean + 1.5 * std::sqrt(variance)) expected.push_back(static_cast<int>(i));
  }
  EXPECT_EQ(statistical_inliers(cloud, 8, 1.5, 1), expected);
  EXPECT_EQ(statistical_inliers(cloud, 8, 1.5, 8), expected);
  EXPECT_LT(expected.size(), 1520u);
  EXPECT_THROW(statistical_inliers(cloud, 0, 1.0), std::invalid_argument);
  EXPECT_THROW(statistical_inliers(cloud, 5, std::nan("")), std::invalid_argument);
  RoadCloud one;
  one.points = {{1, 2, 3}};
  EXPECT_TRUE(statistical_inliers(one, 5, 1.0).empty());
  EXPECT_TRUE(statistical_inliers(RoadCloud{}, 5, 1.0).empty());
  one.points.assign(10, {1, 2, 3});
  EXPECT_EQ(statistical_inliers(one, 5, 1.0).size(), 10u);
}

TEST(RadiusInliers, CountTheOtherPoints) {
  RoadCloud cloud;
  cloud.points = {{0, 0, 0}, {0.5f, 0, 0}, {0, 0.5f, 0}, {9, 0, 0}, {9.5f, 0, 0}, {kNan, 0, 0}};
  EXPECT_EQ(radius_inliers(cloud, 0.6, 2), std::vector<int>({0}));
  EXPECT_EQ(radius_inliers(cloud, 0.75, 2), std::vector<int>({0, 1, 2}));
  EXPECT_EQ(radius_inliers(cloud, 0.6, 1), std::vector<int>({0, 1, 2, 3, 4}));
  EXPECT_THROW(radius_inliers(cloud, 0.0, 1), std::invalid_argument);
  EXPECT_THROW(radius_inliers(cloud, 1.0, 0), std::invalid_argument);
  const RoadCloud hill = noisy_hill(3000);
  std::vector<int> expected;
  for (std::size_t i = 0; i < hill.size(); ++i) {
    int others = -1;
    for (const Eigen::Vector3f& p : hill.points)
      others += (p - hill.points[i]).norm() <= 0.9f ? 1 : 0;
    if (others >= 3) expected.push_back(static_cast<int>(i));
  }
  EXPECT_EQ(radius_inliers(hill, 0.9, 3, 1), expected);
  EXPECT_EQ(radius_inliers(hill, 0.9, 3, 8), expected);
}

TEST(Crop, KeepsInsideOrOutsideInTrueCoordinates) {
  RoadCloud cloud;
  cloud.origin = {1000, 0, 0};
  cloud.points = {{0, 0, 0}, {1, 1, 1}, {2, 0, 0}, {kNan, 0, 0}};
  CropBox box;
  box.minimum = {1000.5, -10, -10};
  box.maximum.x() = 1002.0;
  EXPECT_EQ(crop(cloud, box), std::vector<int>({1, 2}));
  EXPECT_EQ(crop(cloud, box, true), std::vector<int>({0}));
  EXPECT_EQ(crop(cloud, {}), std::vector<int>({0, 1, 2}));
  EXPECT_EQ(finite_points(cloud), std::vector<int>({0, 1, 2}));
}

TEST(Thin, CombinesEachAttributeInItsOwnWay) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kCamera;
  cloud.points = {{0.1f, 0.1f, 0.1f},
                  {-0.1f, 0.1f, 0.1f},
                  {0.3f, 0.1f, 0.1f},
                  {0.2f, 0.4f, 0.1f},
                  {kNan, 0, 0}};
  cloud.colors = {{10, 0, 0}, {99, 99, 99}, {20, 1, 0}, {31, 1, 0}, {0, 0, 0}};
  cloud.sigmas = {0.3f, 1.0f, 0.6f, 0.6f, 0.1f};
  cloud.covariances.assign(5, {9, 0, 0, 9, 0, 9});
  cloud.normals = {{0, 0, 1}, {1, 0, 0}, {0, 0, 1}, {0, 1, 0}, {0, 0, 1}};
  cloud.labels["patch"] = {7, 5, -1, 7, 3};
  cloud.scalars["intensity"] = {1.0f, 9.0f, 2.0f, 6.0f, 0.0f};
  const RoadCloud thinned = thin(cloud, 0.5);
  thinned.validate();
  ASSERT_EQ(thinned.size(), 2u);
  EXPECT_EQ(thinned.frame, CloudFrame::kCamera);
  EXPECT_LT((thinned.points[0] - Eigen::Vector3f(0.2f, 0.2f, 0.1f)).norm(), 1e-7f);
  EXPECT_EQ(thinned.points[1], cloud.points[1]);
  EXPECT_EQ(thinned.colors[0], (std::array<std::uint8_t, 3>{20, 1, 0}));
  EXPECT_FLOAT_EQ(thinned.sigmas[0], 0.3f);  // sqrt(0.09 + 0.36 + 0.36) / 3
  EXPECT_FLOAT_EQ(thinned.covariances[0][0], 3.0f);
  EXPECT_LT((thinned.normals[0] - Eigen::Vector3f(0, 1, 2).normalized()).norm(), 1e-6f);
  EXPECT_EQ(thinned.labels.at("patch"), std::vector<int>({7, 5}));
  EXPECT_FLOAT_EQ(thinned.scalars.at("intensity")[0], 3.0f);
  // A point without a normal leaves that of the others.
  cloud.normals[2] = {kNan, kNan, kNan};
  EXPECT_LT((thin(cloud, 0.5).normals[0] - Eigen::Vector3f(0, 1, 1).normalized()).norm(), 1e-6f);
  EXPECT_THROW(thin(cloud, 0.0), std::invalid_argument);
  EXPECT_THROW(thin(cloud, std::nan("")), std::invalid_argument);
  EXPECT_TRUE(thin(RoadCloud{}, 1.0).empty());
}

TEST(Thin, AgreesWithAMapOfCubes) {
  RoadCloud cloud = test::make_full_cloud(30000);
  cloud.origin = {3000, -7000, 0};
  constexpr double kSize = 4.0;
  std::map<std::array<long, 3>, std::pair<Eigen::Vector3d, int>> cubes;
  for (const Eigen::Vector3f& p : cloud.points) {
    const Eigen::Vector3d x = cloud.origin + p.cast<double>();
    auto& [sum, count] =
        cubes[{std::lround(std::floor(x.x() / kSize)), std::lround(std::floor(x.y() / kSize)),
               std::lround(std::floor(x.z() / kSize))}];
    if (count == 0) sum.setZero();
    sum += x;
    ++count;
  }
  const RoadCloud thinned = thin(cloud, kSize);
  thinned.validate();
  ASSERT_EQ(thinned.size(), cubes.size());
  EXPECT_EQ(thinned.origin, cloud.origin);
  std::set<std::array<long, 3>> seen;
  for (const Eigen::Vector3f& p : thinned.points) {
    const Eigen::Vector3d x = cloud.origin + p.cast<double>();
    const std::array<long, 3> cube = {std::lround(std::floor(x.x() / kSize)),
                                      std::lround(std::floor(x.y() / kSize)),
                                      std::lround(std::floor(x.z() / kSize))};
    const auto found = cubes.find(cube);
    ASSERT_NE(found, cubes.end());
    EXPECT_TRUE(seen.insert(cube).second);
    EXPECT_LT((found->second.first / found->second.second - x).norm(), 1e-5);  // a float near 50
  }
}

}  // namespace
}  // namespace camber
