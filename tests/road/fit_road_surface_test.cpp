#include "camber/road/fit_road_surface.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "camber/core/random.h"
#include "plane/road_scene_maker.h"
#include "road/patch_score.h"

namespace camber {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr double kDegree = M_PI / 180.0;

std::vector<Plane> planes_of(const RoadSurfaceFit& fit) {
  std::vector<Plane> planes;
  for (const PlanePatch& patch : fit.surface.patches) planes.push_back(patch.plane.plane);
  return planes;
}

test::PatchScore score(const test::RoadScene& scene, const RoadSurfaceFit& fit) {
  return test::score_patches(scene, planes_of(fit), fit.labels);
}

/// For clouds without a driven line whose road is to be told from pavements.
RoadSurfaceOptions road_named() {
  RoadSurfaceOptions options;
  options.largest_is_road = true;
  return options;
}

/// Of the points on patches called road, the share that is not.
double not_road(const test::RoadScene& scene, const RoadSurfaceFit& fit) {
  double all = 0.0, wrong = 0.0;
  for (std::size_t i = 0; i < scene.truth.size(); ++i) {
    if (fit.labels[i] < 0) continue;
    const PlanePatch& patch = fit.surface.patches[static_cast<std::size_t>(fit.labels[i])];
    if (patch.kind != PatchKind::kRoad) continue;
    all += 1.0;
    wrong += scene.truth[i] < 0 ? 1.0 : 0.0;
  }
  return wrong / std::max(all, 1.0);
}

class FindsAllPlanes : public testing::TestWithParam<std::tuple<int, double, bool>> {};

TEST_P(FindsAllPlanes, OfAChain) {
  const auto [planes, outliers, sigmas] = GetParam();
  test::RoadSceneOptions made;
  made.seed = 5;
  made.planes = planes;
  made.points = 60000;
  made.outlier_share = outliers;
  made.with_sigmas = sigmas;
  const test::RoadScene scene = test::make_road_scene(made);
  const RoadSurfaceFit fit = fit_road_surface(scene.cloud, road_named());
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  const test::PatchScore result = score(scene, fit);
  EXPECT_EQ(result.found, planes);
  EXPECT_GT(result.mean_overlap, 0.85);
  EXPECT_LT(result.worst_angle, 0.15 * kDegree);  // the mean is to stay below 0.10
  // Pavements and roofs are not road, but for a few at the ends of kerbs; mismatches, and the feet
  // of facades and cars, lie on it by chance.
  EXPECT_LT(not_road(scene, fit), 0.08);
  for (std::size_t a = 0; a < scene.planes.size(); ++a) {
    const PlanePatch& best = fit.surface.patches[static_cast<std::size_t>(result.best[a])];
    EXPECT_EQ(best.kind, PatchKind::kRoad) << a;
  }
}

INSTANTIATE_TEST_SUITE_P(
    RoadClouds, FindsAllPlanes,
    testing::Values(std::make_tuple(1, 0.3, false), std::make_tuple(3, 0.3, false),
                    std::make_tuple(6, 0.1, false), std::make_tuple(6, 0.1, true),
                    std::make_tuple(12, 0.5, false), std::make_tuple(12, 0.5, true)));

TEST(FitRoadSurface, BendingRoadHasNoHoles) {
  // 600 m of road, 8 m wide, 2 % across; grades -3 to 4 % and back to 0, in vertical curves.
  const auto grade = [](double s) {
    const double up = std::clamp((s - 100.0) / 80.0, 0.0, 1.0);
    const double level = std::clamp((s - 220.0) / 80.0, 0.0, 1.0);
    return -0.03 + 0.07 * up - 0.04 * level;
  };
  std::vector<double> heights(6001, 0.0);
  for (std::size_t i = 1; i < heights.size(); ++i) {
    heights[i] = heights[i - 1] + 0.1 * grade(0.1 * (static_cast<double>(i) - 0.5));
  }
  const CounterRandom random(3);
  RoadCloud cloud;
  for (std::uint64_t i = 0; i < 144000; ++i) {
    const double s = random.uniform(2 * i, 0.0, 600.0), v = random.uniform(2 * i + 1, -4.0, 4.0);
    const double z =
        heights[static_cast<std::size_t>(10.0 * s)] + 0.02 * v + 0.01 * random.normal(i);
    cloud.points.push_back(Vector3d(s, v, z).cast<float>());
  }
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    RoadSurfaceOptions options;
    options.seed = seed;
    options.largest_is_road = true;
    const RoadSurfaceFit fit = fit_road_surface(cloud, options);
    const auto left = std::count(fit.labels.begin(), fit.labels.end(), -1);
    EXPECT_LT(left, 144000 / 200) << seed;
    for (const PlanePatch& patch : fit.surface.patches) {
      EXPECT_EQ(patch.kind, PatchKind::kRoad) << seed;
    }
  }
}

TEST(FitRoadSurface, SameAnswerForAnyNumberOfThreads) {
  test::RoadSceneOptions made;
  made.planes = 6;
  made.points = 40000;
  const test::RoadScene scene = test::make_road_scene(made);
  RoadSurfaceOptions options;
  options.num_threads = 1;
  const RoadSurfaceFit one = fit_road_surface(scene.cloud, options);
  for (const int threads : {2, 4}) {
    options.num_threads = threads;
    const RoadSurfaceFit many = fit_road_surface(scene.cloud, options);
    EXPECT_EQ(one.labels, many.labels);
    ASSERT_EQ(one.surface.patches.size(), many.surface.patches.size());
    for (std::size_t i = 0; i < one.surface.patches.size(); ++i) {
      const PlanePatch &a = one.surface.patches[i], &b = many.surface.patches[i];
      EXPECT_EQ(a.plane.plane.normal, b.plane.plane.normal);
      EXPECT_EQ(a.plane.plane.offset, b.plane.plane.offset);
      EXPECT_EQ(a.plane.covariance, b.plane.covariance);
      EXPECT_EQ(a.boundary, b.boundary);
      EXPECT_EQ(a.kind, b.kind);
    }
  }
}

TEST(FitRoadSurface, KeepsMapCoordinatesInDouble) {
  test::RoadSceneOptions made;
  made.planes = 3;
  made.points = 20000;
  test::RoadScene scene = test::make_road_scene(made);
  const RoadSurfaceFit near = fit_road_surface(scene.cloud, {});
  const Vector3d origin(4.5e6, 5.1e5, 120.0);
  scene.cloud.origin = origin;
  const RoadSurfaceFit far = fit_road_surface(scene.cloud, {});
  EXPECT_EQ(near.labels, far.labels);
  ASSERT_EQ(near.surface.patches.size(), far.surface.patches.size());
  for (std::size_t i = 0; i < near.surface.patches.size(); ++i) {
    // Doubles hold map coordinates to about 1e-9 m.
    EXPECT_NEAR(far.surface.patches[i].plane.plane.signed_distance(
                    near.surface.patches[i].plane.centroid + origin),
                0.0, 1e-6);
  }
}

/// The same scene in another order, turned and moved; labels and planes compared with the first's.
void expect_same(const test::RoadScene& scene, bool shuffle, const Eigen::Matrix3d& turn,
                 const Vector3d& shift) {
  const std::size_t n = scene.cloud.size();
  std::vector<int> order(n);
  std::iota(order.begin(), order.end(), 0);
  const CounterRandom random(1, 77);
  for (std::size_t i = n - 1; shuffle && i > 0; --i)
    std::swap(order[i], order[random.below(i, i + 1)]);
  RoadCloud other = scene.cloud.select(order);
  for (Vector3f& p : other.points) p = (turn * p.cast<double>() + shift).cast<float>();
  RoadSurfaceOptions options = road_named();
  const RoadSurfaceFit a = fit_road_surface(scene.cloud, options);
  options.up = turn * Vector3d::UnitZ();
  const RoadSurfaceFit b = fit_road_surface(other, options);
  ASSERT_EQ(a.surface.patches.size(), b.surface.patches.size());
  double equal = 0.0;
  for (std::size_t i = 0; i < n; ++i) {
    equal += a.labels[static_cast<std::size_t>(order[i])] == b.labels[i] ? 1.0 : 0.0;
  }
  EXPECT_GE(equal / static_cast<double>(n), 0.995);
  for (std::size_t k = 0; k < a.surface.patches.size(); ++k) {
    if (a.surface.patches[k].kind != PatchKind::kRoad) continue;
    const UncertainPlane& plane = a.surface.patches[k].plane;
    const Plane back = b.surface.patches[k].plane.plane.transformed(
        SE3(Eigen::Matrix3d(turn.transpose()), -(turn.transpose() * shift)));
    const Vector3d tilt = plane.plane.normal.cross(back.normal);
    EXPECT_LT(std::abs(tilt.dot(plane.axis1)), 0.1 * std::sqrt(plane.covariance(0, 0)));
    EXPECT_LT(std::abs(tilt.dot(plane.axis2)), 0.1 * std::sqrt(plane.covariance(1, 1)));
    EXPECT_LT(std::abs(back.signed_distance(plane.centroid)),
              0.1 * std::sqrt(plane.covariance(2, 2)));
  }
}

TEST(FitRoadSurface, OrderOfThePointsDoesNotMatter) {
  test::RoadSceneOptions made;
  made.planes = 6;
  made.points = 60000;
  for (const bool sigmas : {false, true}) {
    made.with_sigmas = sigmas;
    expect_same(test::make_road_scene(made), true, Eigen::Matrix3d::Identity(), Vector3d::Zero());
  }
}

TEST(FitRoadSurface, PlaceAndHeadingDoNotMatter) {
  test::RoadSceneOptions made;
  made.seed = 2;
  made.planes = 3;
  made.points = 60000;
  const test::RoadScene scene = test::make_road_scene(made);
  expect_same(scene, false, Eigen::Matrix3d::Identity(), {37.0, -12.0, 5.0});
  expect_same(scene, true, Eigen::AngleAxisd(30 * kDegree, Vector3d::UnitZ()).toRotationMatrix(),
              {-21.0, 9.0, 3.0});
}

TEST(FitRoadSurface, PlaceAndHeadingDoNotMatterForManyPatchesAmongOutliers) {
  // Coordinates in float are rounded otherwise at another place (by up to 8 um here), so a few
  // points fall into other cells: that is to change nothing elsewhere.
  test::RoadSceneOptions made;
  made.planes = 12;
  made.points = 100000;
  made.outlier_share = 0.5;
  for (const std::uint64_t seed : {7000, 7003, 7004, 7005}) {
    made.seed = seed;
    const test::RoadScene scene = test::make_road_scene(made);
    expect_same(scene, false, Eigen::Matrix3d::Identity(), {37.0, -12.0, 5.0});
    expect_same(scene, false,
                Eigen::AngleAxisd(200 * kDegree, Vector3d::UnitZ()).toRotationMatrix(),
                {-210.0, 90.0, 31.0});
  }
}

TEST(FitRoadSurface, StatedRegionsHoldTheTruth) {
  // 95 % regions of tilts and height together; 120 patches at 95 % miss 6 +- 2.4.
  int held = 0, patches = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    test::RoadSceneOptions made;
    made.seed = 400 + seed;
    made.planes = 3;
    made.points = 20000;
    made.outlier_share = 0.1;
    const test::RoadScene scene = test::make_road_scene(made);
    const RoadSurfaceFit fit = fit_road_surface(scene.cloud, {});
    const test::PatchScore result = score(scene, fit);
    for (std::size_t k = 0; k < scene.planes.size(); ++k) {
      if (result.best[k] < 0) continue;
      const UncertainPlane& plane =
          fit.surface.patches[static_cast<std::size_t>(result.best[k])].plane;
      const Plane& truth = scene.planes[k];
      const Vector3d turn = plane.plane.normal.cross(truth.normal);
      const Vector3d error(turn.dot(plane.axis1), turn.dot(plane.axis2),
                           -truth.signed_distance(plane.centroid));
      held += error.dot(plane.covariance.inverse() * error) <= 7.815 ? 1 : 0;  // chi-square, 3
      ++patches;
    }
  }
  EXPECT_EQ(patches, 120);
  EXPECT_GE(held, 107);
  EXPECT_LT(held, 120);
}

TEST(FitRoadSurface, CameraFrameIsServedAlike) {
  // The same road turned into a camera's frame: x right, y down, z forward.
  test::RoadSceneOptions made;
  made.seed = 3;
  made.planes = 3;
  made.points = 30000;
  const test::RoadScene scene = test::make_road_scene(made);
  RoadCloud cloud = scene.cloud;
  cloud.frame = CloudFrame::kCamera;
  Eigen::Matrix3f turn;
  turn << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  for (Vector3f& p : cloud.points) p = turn * p;
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  EXPECT_EQ(fit.surface.frame, "camera");
  test::RoadScene turned = scene;
  for (Plane& plane : turned.planes) plane.normal = turn.cast<double>() * plane.normal;
  const test::PatchScore result = score(turned, fit);
  EXPECT_EQ(result.found, 3);
  EXPECT_LT(result.worst_angle, 0.15 * kDegree);
  for (const PlanePatch& patch : fit.surface.patches) EXPECT_LT(patch.plane.plane.normal.y(), 0.0);
}

TEST(FitRoadSurface, ErrorsInCommonAreNoReliefOfTheRoad) {
  // A level road before a camera 1.65 m up. Errors along the rays are as large as stated but either
  // each point's own, or waves of 9 m that all points near each other share, as those of a
  // reconstruction from one camera are.
  for (const bool in_common : {false, true}) {
    RoadCloud cloud;
    cloud.frame = CloudFrame::kCamera;
    const CounterRandom random(6, 13);
    for (std::uint64_t i = 0; i < 30000; ++i) {
      Vector3d p(random.uniform(2 * i, -4.0, 4.0), 1.65, random.uniform(2 * i + 1, 4.0, 30.0));
      const double r = p.norm(), sigma = 0.5 * r * r / 200.0;
      const double wave = std::sin(2.0 * M_PI * p.z() / 9.0 + 0.6 * p.x());
      p += sigma * (in_common ? wave + 0.02 * random.normal(i) : random.normal(i)) * p / r;
      cloud.points.push_back(p.cast<float>());
      cloud.sigmas.push_back(static_cast<float>(sigma));
    }
    const RoadSurfaceFit fit = fit_road_surface(cloud, {});
    ASSERT_EQ(fit.status, Status::kOk);
    std::size_t road = 0;
    double on_road = 0.0;
    for (const PlanePatch& patch : fit.surface.patches) {
      if (patch.kind != PatchKind::kRoad) continue;
      ++road;
      on_road += patch.inliers;
      const Vector3d& c = patch.plane.centroid;
      const double sigma = std::sqrt(patch.plane.covariance(2, 2));
      EXPECT_LT(std::abs(c.y() - 1.65), 3.0 * sigma);
      // 0.9 to 3.5 cm across the road is stated; 30,000 independent errors average out.
      if (in_common) {
        EXPECT_GT(sigma, 0.004);
      } else {
        EXPECT_LT(sigma, 0.001);
      }
    }
    EXPECT_LE(road, in_common ? 4u : 1u);
    EXPECT_GT(on_road / static_cast<double>(cloud.size()), 0.95);
  }
}

TEST(FitRoadSurface, TooFewPoints) {
  EXPECT_EQ(fit_road_surface(RoadCloud{}, {}).status, Status::kFailed);
  RoadCloud cloud;
  cloud.points = {Vector3f(0, 0, 0), Vector3f(1, 0, 0)};
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  EXPECT_EQ(fit.status, Status::kFailed);
  EXPECT_EQ(fit.reason, "2 usable points, at least 3 are needed");
  EXPECT_EQ(fit.labels, std::vector<int>(2, -1));
}

TEST(FitRoadSurface, AllEqualCollinearAndNaNFail) {
  RoadCloud equal, line, nothing;
  equal.points.assign(500, Vector3f(1, 2, 3));
  for (int i = 0; i < 500; ++i) line.points.emplace_back(0.1f * i, 0.2f * i, 0.0f);
  nothing.points.assign(500, Vector3f::Constant(std::numeric_limits<float>::quiet_NaN()));
  for (const RoadCloud* cloud : {&equal, &line, &nothing}) {
    const RoadSurfaceFit fit = fit_road_surface(*cloud, {});
    EXPECT_EQ(fit.status, Status::kFailed);
    EXPECT_FALSE(fit.reason.empty());
    EXPECT_TRUE(fit.surface.patches.empty());
  }
}

/// n points on a level square of 20 m, at a height.
RoadCloud sheet(std::size_t n, double height, double noise, std::uint64_t seed) {
  RoadCloud cloud;
  const CounterRandom random(seed, 5);
  for (std::size_t i = 0; i < n; ++i) {
    cloud.points.push_back(Vector3d(random.uniform(2 * i, -10, 10),
                                    random.uniform(2 * i + 1, -10, 10),
                                    height + noise * random.normal(i))
                               .cast<float>());
  }
  return cloud;
}

TEST(FitRoadSurface, PointsWithoutAUsableSigmaAreNamed) {
  RoadCloud cloud = sheet(2000, 1.0, 0.01, 1);
  cloud.sigmas.assign(cloud.size(), 0.0f);
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  EXPECT_EQ(fit.status, Status::kFailed);
  EXPECT_EQ(fit.reason, "no point has a sigma above 0");
}

TEST(FitRoadSurface, FlatAndFreeOfNoiseIsOnePatch) {
  const RoadSurfaceFit fit = fit_road_surface(sheet(5000, 1.0, 0.0, 1), {});
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  ASSERT_EQ(fit.surface.patches.size(), 1u);
  EXPECT_NEAR(fit.surface.patches[0].plane.plane.normal.z(), 1.0, 1e-9);
  EXPECT_NEAR(fit.surface.patches[0].plane.plane.offset, -1.0, 1e-6);
  EXPECT_EQ(std::count(fit.labels.begin(), fit.labels.end(), 0), 5000);
}

TEST(FitRoadSurface, TwoParallelSheetsAreTwoPatchesOneAboveTheOther) {
  RoadCloud cloud = sheet(5000, 0.0, 0.01, 1);
  const RoadCloud upper = sheet(5000, 5.0, 0.01, 2);
  cloud.points.insert(cloud.points.end(), upper.points.begin(), upper.points.end());
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  ASSERT_EQ(fit.status, Status::kOk) << fit.reason;
  ASSERT_EQ(fit.surface.patches.size(), 2u);
  ASSERT_EQ(fit.surface.links.size(), 1u);
  EXPECT_FALSE(fit.surface.links[0].valid);
}

TEST(FitRoadSurface, OnePointABillionMetresAwayChangesNothingMuch) {
  RoadCloud cloud = sheet(5000, 1.0, 0.02, 1);
  const RoadSurfaceFit clean = fit_road_surface(cloud, {});
  cloud.points[7] = Vector3f(1e9f, 0.0f, 0.0f);
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  ASSERT_EQ(fit.surface.patches.size(), clean.surface.patches.size());
  EXPECT_EQ(fit.labels[7], -1);
  const PlanePatch &a = clean.surface.patches[0], &b = fit.surface.patches[0];
  EXPECT_NEAR(b.plane.plane.signed_distance(a.plane.centroid), 0.0,
              0.5 * std::sqrt(a.plane.covariance(2, 2)));
}

TEST(FitRoadSurface, CliffsAndWallsAreLeftOut) {
  RoadCloud cloud = sheet(5000, 0.0, 0.01, 1);
  const CounterRandom random(9, 5);
  for (std::uint64_t i = 0; i < 3000; ++i) {
    cloud.points.emplace_back(static_cast<float>(random.uniform(2 * i, -10, 10)), 10.0f,
                              static_cast<float>(random.uniform(2 * i + 1, 0, 6)));
  }
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  ASSERT_EQ(fit.surface.patches.size(), 1u);
  const auto on_wall = std::count(fit.labels.begin() + 5000, fit.labels.end(), 0);
  EXPECT_LT(on_wall, 60);  // the wall's foot: 3 sigma of 6 m, and a margin
}

TEST(FitRoadSurface, WithoutADrivenLineNothingTellsRoadFromOtherGround) {
  // A road and a pavement a kerb above it, seen from the air.
  RoadCloud cloud;
  cloud.frame = CloudFrame::kZUp;
  const CounterRandom random(22, 5);
  for (std::uint64_t i = 0; i < 24000; ++i) {
    const double y = random.uniform(3 * i, -6, 6);
    cloud.points.emplace_back(
        static_cast<float>(random.uniform(3 * i + 2, 0, 30)), static_cast<float>(y),
        static_cast<float>((y > 3 ? 0.15 : 0.0) + 0.01 * random.normal(3 * i + 1)));
  }
  const auto kinds_at = [](const RoadSurfaceFit& fit) {
    const SurfaceQuery road = fit.surface.query({15.0, 0.0, 0.0}, 0.5);
    const SurfaceQuery beside = fit.surface.query({15.0, 4.5, 0.15}, 0.5);
    return std::pair(fit.surface.find(road.patch)->kind, fit.surface.find(beside.patch)->kind);
  };
  RoadSurfaceOptions options;
  EXPECT_EQ(kinds_at(fit_road_surface(cloud, options)),
            std::pair(PatchKind::kGround, PatchKind::kGround));
  options.driven_line = {{1.0, 0.0, 0.0}, {29.0, 0.0, 0.0}};
  EXPECT_EQ(kinds_at(fit_road_surface(cloud, options)),
            std::pair(PatchKind::kRoad, PatchKind::kPavement));
  options.driven_line.clear();
  options.largest_is_road = true;
  EXPECT_EQ(kinds_at(fit_road_surface(cloud, options)),
            std::pair(PatchKind::kRoad, PatchKind::kPavement));
}

TEST(FitRoadSurface, ACamerasRoadLiesAheadOfItEvenBesideALargerSquare) {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kCamera;
  const CounterRandom random(21, 5);
  for (std::uint64_t i = 0; i < 24000; ++i) {
    const double x = random.uniform(3 * i, -3, 20);
    const double level = x < 3 ? 1.65 : 1.50;  // beyond a kerb
    cloud.points.emplace_back(static_cast<float>(x),
                              static_cast<float>(level + 0.01 * random.normal(3 * i + 1)),
                              static_cast<float>(random.uniform(3 * i + 2, 4, 24)));
  }
  const RoadSurfaceFit fit = fit_road_surface(cloud, {});
  const SurfaceQuery road = fit.surface.query({0.0, 1.65, 10.0}, 0.5);
  const SurfaceQuery square = fit.surface.query({12.0, 1.5, 10.0}, 0.5);
  ASSERT_GE(road.patch, 0);
  ASSERT_GE(square.patch, 0);
  EXPECT_EQ(fit.surface.find(road.patch)->kind, PatchKind::kRoad);
  EXPECT_EQ(fit.surface.find(square.patch)->kind, PatchKind::kPavement);
}

/// 20,000 points of a level plane of 20 x 10 m. @param noise  m
RoadCloud noisy_plane(double noise) {
  RoadCloud cloud;
  const CounterRandom places(7), errors(8);
  for (std::uint64_t i = 0; i < 20000; ++i) {
    cloud.points.push_back(Vector3d(places.uniform(2 * i, 0.0, 20.0),
                                    places.uniform(2 * i + 1, -5.0, 5.0), noise * errors.normal(i))
                               .cast<float>());
  }
  return cloud;
}

TEST(FitRoadSurface, AThresholdBelowTheNoiseIsNamed) {
  constexpr double kNoise = 0.02;
  const RoadCloud cloud = noisy_plane(kNoise);
  RoadSurfaceOptions options;
  options.inlier_threshold = 0.4 * kNoise;
  const RoadSurfaceFit narrow = fit_road_surface(cloud, options);
  EXPECT_EQ(narrow.status, Status::kWeak);
  EXPECT_EQ(narrow.reason.find("points scatter about their planes by 0.0"), 0u) << narrow.reason;
  EXPECT_GT(narrow.surface.patches.size(), 1u);
  // As the reason advises.
  options.inlier_threshold = 2.5 * kNoise;
  const RoadSurfaceFit wide = fit_road_surface(cloud, options);
  EXPECT_EQ(wide.status, Status::kOk) << wide.reason;
  EXPECT_EQ(wide.surface.patches.size(), 1u);
}

TEST(FitRoadSurface, NoiseIsThePointsStandardDeviation) {
  constexpr double kTrue = 0.03;
  RoadCloud cloud = noisy_plane(kTrue);
  for (const double threshold : {0.0, 2.5 * kTrue, 5.0 * kTrue}) {
    RoadSurfaceOptions options;
    options.inlier_threshold = threshold;
    const RoadSurfaceFit fit = fit_road_surface(cloud, options);
    ASSERT_EQ(fit.surface.patches.size(), 1u) << threshold;
    EXPECT_NEAR(fit.noise, kTrue, 0.03 * kTrue) << threshold;
    EXPECT_NEAR(fit.surface.patches[0].noise, kTrue, 0.03 * kTrue) << threshold;
  }
  const float variance = static_cast<float>(kTrue * kTrue);
  cloud.covariances.assign(cloud.size(), {variance, 0, 0, variance, 0, variance});
  EXPECT_NEAR(fit_road_surface(cloud, {}).noise, kTrue, 0.03 * kTrue);
}

TEST(FitRoadSurface, OptionsAreChecked) {
  RoadSurfaceOptions options;
  options.max_slope = 2.0;
  EXPECT_THROW(fit_road_surface(RoadCloud{}, options), std::invalid_argument);
  options = {};
  options.min_patch_points = 1;
  EXPECT_THROW(fit_road_surface(RoadCloud{}, options), std::invalid_argument);
  options = {};
  options.tolerance = -0.1;
  EXPECT_THROW(fit_road_surface(RoadCloud{}, options), std::invalid_argument);
  options = {};
  options.viewpoint = Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THROW(fit_road_surface(RoadCloud{}, options), std::invalid_argument);
}

}  // namespace
}  // namespace camber
