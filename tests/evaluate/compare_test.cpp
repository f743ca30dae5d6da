#include "camber/evaluate/compare.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/evaluate/triangle_tree.h"

namespace camber {
namespace {

using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

double road_height(double x, double y) { return 0.8 * std::sin(x / 9.0) + 0.02 * y * y / 5.0; }

/// Points of a rolling road, x along it, with noise along z and a share far off.
RoadCloud make_road(std::size_t count, std::uint64_t seed, double noise, double far_share) {
  RoadCloud cloud;
  const CounterRandom random(seed);
  for (std::uint64_t i = 0; i < count; ++i) {
    const double x = random.uniform(6 * i, -40, 40), y = random.uniform(6 * i + 1, -6, 6);
    double z = road_height(x, y) + noise * random.normal(i);
    if (random.uniform(6 * i + 2) < far_share) z += random.uniform(6 * i + 3, -80, 80);
    cloud.points.emplace_back(static_cast<float>(x), static_cast<float>(y), static_cast<float>(z));
  }
  return cloud;
}

/// The same road as a mesh of squares of `step` metres.
Shape make_mesh(double step) {
  Shape mesh;
  const int nx = static_cast<int>(80.0 / step) + 1, ny = static_cast<int>(12.0 / step) + 1;
  for (int j = 0; j < ny; ++j) {
    for (int i = 0; i < nx; ++i) {
      const double x = -40.0 + i * step, y = -6.0 + j * step;
      mesh.cloud.points.emplace_back(static_cast<float>(x), static_cast<float>(y),
                                     static_cast<float>(road_height(x, y)));
      if (i == 0 || j == 0) continue;
      const auto at = [&](int a, int b) { return static_cast<std::uint32_t>(b * nx + a); };
      mesh.triangles.push_back({at(i - 1, j - 1), at(i, j - 1), at(i, j)});
      mesh.triangles.push_back({at(i - 1, j - 1), at(i, j), at(i - 1, j)});
    }
  }
  return mesh;
}

TEST(NearestOnTriangle, AgreesWithADenseSearch) {
  const CounterRandom random(5);
  for (std::uint64_t k = 0; k < 200; ++k) {
    Vector3d c[4];
    for (std::uint64_t i = 0; i < 12; ++i) {
      c[i / 3][static_cast<Eigen::Index>(i % 3)] = random.uniform(12 * k + i, -1, 1);
    }
    if (k % 7 == 0) c[1] = c[0];                      // an edge
    if (k % 11 == 0) c[1] = c[2] = c[0];              // a point
    if (k % 13 == 0) c[2] = 0.3 * c[0] + 0.7 * c[1];  // three corners on a line
    const Vector3d found = nearest_on_triangle(c[3], c[0], c[1], c[2]);
    double least = 1e9;
    constexpr int kSteps = 200;
    for (int i = 0; i <= kSteps; ++i) {
      for (int j = 0; i + j <= kSteps; ++j) {
        const double s = i / static_cast<double>(kSteps), t = j / static_cast<double>(kSteps);
        least = std::min(least, (c[0] + s * (c[1] - c[0]) + t * (c[2] - c[0]) - c[3]).norm());
      }
    }
    EXPECT_LE((found - c[3]).norm(), least + 1e-12);
    EXPECT_GE((found - c[3]).norm(), least - 0.03);  // the search's grid
  }
}

TEST(DistancesTo, CloudAgreesWithBruteForce) {
  RoadCloud truth = make_road(4000, 1, 0.0, 0.0);
  truth.points.push_back(truth.points[5]);  // one twice
  truth.points.emplace_back(static_cast<float>(kNaN), 0.0f, 0.0f);
  // Map coordinates, and another origin on the other side.
  truth.origin = {512000.0, 5403000.0, 250.0};
  RoadCloud estimate = make_road(3000, 2, 0.1, 0.3);
  estimate.origin = {511990.3, 5403007.7, 251.1};
  estimate.points.emplace_back(0.0f, std::numeric_limits<float>::infinity(), 0.0f);
  const std::vector<Vector3d> places = true_points(estimate);
  const ShapeDistances found = distances_to({truth, {}}, places, 2);
  EXPECT_EQ(distances_to({truth, {}}, places, 1).nearest, found.nearest);
  for (std::size_t i = 0; i < places.size(); ++i) {
    double least = std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3f& p : truth.points) {
      const double d = (truth.origin + p.cast<double>() - places[i]).norm();
      if (d < least) least = d;
    }
    if (std::isfinite(least)) {
      ASSERT_NEAR(found.distance[i], least, 1e-6) << i;
    } else {
      EXPECT_TRUE(std::isnan(found.distance[i]));
      EXPECT_EQ(found.nearest[i], -1);
    }
  }
}

TEST(DistancesTo, MeshAgreesWithBruteForce) {
  Shape mesh = make_mesh(2.0);
  mesh.triangles.push_back({3, 3, 8});  // degenerate
  mesh.cloud.origin = {1000.0, -2000.0, 30.0};
  RoadCloud estimate = make_road(2000, 3, 0.1, 0.3);
  estimate.origin = mesh.cloud.origin + Vector3d(0.25, 0.5, -0.125);
  const std::vector<Vector3d> places = true_points(estimate);
  const ShapeDistances found = distances_to(mesh, places, 2);
  const std::vector<Vector3d> corners = true_points(mesh.cloud);
  for (std::size_t i = 0; i < places.size(); ++i) {
    double least = std::numeric_limits<double>::infinity();
    for (const auto& t : mesh.triangles) {
      least = std::min(
          least,
          (nearest_on_triangle(places[i], corners[t[0]], corners[t[1]], corners[t[2]]) - places[i])
              .norm());
    }
    ASSERT_NEAR(found.distance[i], least, 1e-6) << i;
    const auto& t = mesh.triangles[static_cast<std::size_t>(found.nearest[i])];
    const Vector3d normal =
        (corners[t[1]] - corners[t[0]]).cross(corners[t[2]] - corners[t[0]]).normalized();
    EXPECT_NEAR(found.along_normal[i], normal.dot(places[i] - corners[t[0]]), 1e-6);
  }
}

TEST(CompareShapes, HandComputedNumbers) {
  // Truth: a row of points 1 m apart; the estimate: 0.04 m above half of them, one 0.5 m off.
  Shape truth, estimate;
  for (int i = 0; i < 10; ++i) truth.cloud.points.emplace_back(static_cast<float>(i), 0.0f, 0.0f);
  for (int i = 0; i < 5; ++i) {
    estimate.cloud.points.emplace_back(static_cast<float>(i), 0.0f, 0.04f);
  }
  estimate.cloud.points.emplace_back(2.0f, 0.5f, 0.0f);
  CompareOptions options;
  options.thresholds = {0.05, 0.5, 1.5};
  options.road_frame = false;
  const CloudComparison c = compare_shapes(estimate, truth, options);
  EXPECT_EQ(c.accuracy.summary.count, 6u);
  EXPECT_NEAR(c.accuracy.summary.mean, (5 * 0.04 + 0.5) / 6, 1e-7);
  EXPECT_NEAR(c.accuracy.summary.rms, std::sqrt((5 * 0.0016 + 0.25) / 6), 1e-7);
  EXPECT_NEAR(c.accuracy.summary.largest, 0.5, 1e-9);
  EXPECT_NEAR(c.completeness.summary.largest, std::sqrt(25.0 + 0.0016), 1e-6);
  EXPECT_NEAR(c.scores[0].precision, 5.0 / 6.0, 1e-12);
  EXPECT_NEAR(c.scores[0].recall, 0.5, 1e-12);
  EXPECT_NEAR(c.scores[0].f_score, 2 * (5.0 / 6.0) * 0.5 / (5.0 / 6.0 + 0.5), 1e-12);
  EXPECT_NEAR(c.scores[1].precision, 1.0, 1e-12);
  EXPECT_NEAR(c.scores[2].recall, 0.6, 1e-12);
}

TEST(CompareShapes, RegionViewsAndViewpointTakeOutWhatWasNotObserved) {
  Shape truth{make_road(20000, 4, 0.0, 0.0), {}}, estimate;
  // The estimate has one half of the road, as a camera at x = -40 sees 40 m ahead.
  for (const Eigen::Vector3f& p : make_road(20000, 5, 0.0, 0.0).points) {
    if (p.x() < 0.0f) estimate.cloud.points.push_back(p);
  }
  CompareOptions options;
  options.road_frame = false;
  const CloudComparison all = compare_shapes(estimate, truth, options);
  EXPECT_NEAR(all.scores[2].recall, 0.5, 0.05);
  options.region = CropBox{{-40, -10, -10}, {0, 10, 10}};
  const CloudComparison part = compare_shapes(estimate, truth, options);
  EXPECT_GT(part.scores[2].recall, 0.8);
  EXPECT_NEAR(static_cast<double>(part.completeness.outside), 10000.0, 500.0);
  EXPECT_EQ(part.accuracy.outside, 0u);

  options.region.reset();
  Eigen::Matrix3d turn;  // camera axes in the world's: x right, y down, z forward
  turn << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  View view;
  view.camera = {1200, 400, 700, 700, 600, 200};
  view.camera_from_estimate = SE3(turn, Vector3d(-45, 0, 3)).inverse();
  options.views = {view};
  options.farthest = 45.0;
  const CloudComparison viewed = compare_shapes(estimate, truth, options);
  EXPECT_GT(viewed.completeness.unobserved, 9000u);
  EXPECT_GT(viewed.scores[2].recall, 0.8);

  // Truth seen from a laser at the far end; estimated points far behind and above its reach are in
  // unobserved space.
  options = {};
  options.road_frame = false;
  for (int i = 0; i < 1000; ++i) {
    estimate.cloud.points.emplace_back(static_cast<float>(i % 10), 0.0f, 30.0f);
    estimate.cloud.points.emplace_back(-20.0f, 0.0f, -5.0f - 0.001f * static_cast<float>(i));
  }
  const CloudComparison blind = compare_shapes(estimate, truth, options);
  options.truth_viewpoint = Vector3d(-20, 0, 2);
  const CloudComparison observed = compare_shapes(estimate, truth, options);
  const std::vector<unsigned char>& counted = observed.accuracy.counted;
  EXPECT_EQ(std::count(counted.end() - 2000, counted.end(), 1), 0);
  // A truth of random points leaves gaps near its viewpoint.
  EXPECT_LT(observed.accuracy.unobserved, 4000u);
  EXPECT_LT(blind.scores[2].precision, 0.8);
  EXPECT_GT(observed.scores[2].precision, 0.92);
}

TEST(CompareShapes, RoadFrameSplitsHeightFromTheRest) {
  Shape truth = make_mesh(0.5), estimate;
  const RoadCloud road = make_road(20000, 6, 0.0, 0.0);
  for (const Eigen::Vector3f& p : road.points) {
    // 6 cm too high ahead, 3 cm too low behind.
    estimate.cloud.points.emplace_back(p.x(), p.y(), p.z() + (p.x() > 0.0f ? 0.06f : -0.03f));
  }
  CompareOptions options;
  options.viewpoint = Vector3d(-40, 0, 1.5);
  const CloudComparison c = compare_shapes(estimate, truth, options);
  ASSERT_FALSE(c.road.empty());
  EXPECT_EQ(c.road[0].by, "all");
  EXPECT_TRUE(c.map.of_axes);
  // Chords of 0.5 m on a curve of 100 m radius are off by 0.3 mm.
  EXPECT_NEAR(c.road[0].height_mean, 0.015, 0.002);
  EXPECT_LT(c.road[0].across_rms, 0.005);
  std::size_t by_distance = 0, by_grade = 0;
  for (const RoadErrors& row : c.road) {
    if (row.by == "distance") by_distance += row.count;
    if (row.by == "grade") by_grade += row.count;
    if (row.by == "distance" && row.to <= 30.0 && row.count > 0) {
      EXPECT_NEAR(row.height_mean, -0.03, 0.002);
    }
  }
  EXPECT_EQ(by_distance, c.road[0].count);
  EXPECT_EQ(by_grade, c.road[0].count);
  EXPECT_GT(c.map.width, 150);
  std::size_t high = 0, low = 0;
  for (int y = 0; y < c.map.height; ++y) {
    for (int x = 0; x < c.map.width; ++x) {
      const float e = c.map.error[static_cast<std::size_t>(y * c.map.width + x)];
      const double u = c.map.u + (x + 0.5) * c.map.cell;
      if (!std::isfinite(e) || std::abs(u) < 1.0) continue;
      EXPECT_NEAR(e, u > 0.0 ? 0.06 : -0.03, 0.004);
      (u > 0.0 ? high : low) += 1;
    }
  }
  EXPECT_GT(high, 1500u);
  EXPECT_GT(low, 1500u);
}

class AlignmentTest : public ::testing::TestWithParam<Alignment> {};

TEST_P(AlignmentTest, IsFoundAndReported) {
  const Alignment alignment = GetParam();
  Shape truth{make_road(30000, 7, 0.0, 0.0), {}};
  // Two walls and a post make every direction observable.
  for (int i = 0; i < 8000; ++i) {
    const float u = static_cast<float>(i % 100) * 0.1f, v = static_cast<float>(i / 100) * 0.04f;
    truth.cloud.points.emplace_back(-5.0f + u, 6.0f, v);
    truth.cloud.points.emplace_back(12.0f, -5.0f + u, v);
  }
  Eigen::Matrix4d moved = Eigen::Matrix4d::Identity();  // estimate from truth's frame
  if (alignment != Alignment::kScale) {
    moved.topLeftCorner<3, 3>() =
        Eigen::AngleAxisd(0.02, Vector3d(0.3, -0.2, 1.0).normalized()).toRotationMatrix();
    moved.topRightCorner<3, 1>() = Vector3d(0.15, -0.1, 0.08);
  }
  if (alignment != Alignment::kRigid) moved.topLeftCorner<3, 3>() *= 1.015;
  Shape estimate;
  for (std::size_t i = 0; i < truth.cloud.size(); i += 2) {
    const Vector3d p = truth.cloud.points[i].cast<double>();
    estimate.cloud.points.push_back(
        (moved.topLeftCorner<3, 3>() * p + moved.topRightCorner<3, 1>()).cast<float>());
  }
  CompareOptions options;
  options.alignment = alignment;
  const CloudComparison c = compare_shapes(estimate, truth, options);
  EXPECT_LT((c.alignment.transform - moved.inverse()).cwiseAbs().maxCoeff(), 2e-3);
  EXPECT_LT(c.alignment.residual_after, 0.1 * c.alignment.residual_before);
  EXPECT_LT(c.accuracy.summary.median, 0.01);
  EXPECT_NEAR(c.alignment.scale, alignment == Alignment::kRigid ? 1.0 : 1.0 / 1.015, 1e-4);

  // The closed form on a few pairs.
  for (std::size_t i = 0; i < 40; ++i) {
    options.pairs.emplace_back(estimate.cloud.points[i * 100].cast<double>(),
                               truth.cloud.points[i * 200].cast<double>());
  }
  const CloudComparison p = compare_shapes(estimate, truth, options);
  EXPECT_TRUE(p.alignment.from_pairs);
  EXPECT_LT((p.alignment.transform - moved.inverse()).cwiseAbs().maxCoeff(), 1e-5);
}
INSTANTIATE_TEST_SUITE_P(Kinds, AlignmentTest,
                         ::testing::Values(Alignment::kScale, Alignment::kRigid,
                                           Alignment::kSimilarity));

/// Largest distance between where an alignment takes a cloud's points and where they belong.
double misplaced(const AlignmentResult& alignment, const RoadCloud& estimate,
                 const RoadCloud& truth) {
  const std::vector<Vector3d> from = true_points(estimate), to = true_points(truth);
  const Eigen::Matrix4d& m = alignment.transform;
  double largest = 0.0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Vector3d moved = m.topLeftCorner<3, 3>() * from[i] + m.topRightCorner<3, 1>();
    largest = std::max(largest, (moved - to[i]).norm());
  }
  return largest;
}

TEST(Alignment, OfShapesThatLieApartStartsFromTheirCentres) {
  Shape truth{make_road(6000, 21, 0.0, 0.0), {}};
  for (int i = 0; i < 1500; ++i) {  // a wall, for the directions that a road leaves open
    truth.cloud.points.emplace_back(static_cast<float>(i % 50) * 0.2f, 7.0f,
                                    static_cast<float>(i / 50) * 0.1f);
  }
  Shape estimate = truth;
  estimate.cloud.origin = {500000, 5400000, 430};
  CompareOptions options;
  for (const Alignment alignment : {Alignment::kRigid, Alignment::kSimilarity}) {
    options.alignment = alignment;
    const CloudComparison c = compare_shapes(estimate, truth, options);
    EXPECT_LT(misplaced(c.alignment, estimate.cloud, truth.cloud), 1e-3);
    EXPECT_NEAR(c.alignment.scale, 1.0, 1e-6);
    EXPECT_NEAR(c.alignment.residual_before, 5423114.0, 1e3);
    EXPECT_LT(c.accuracy.summary.largest, 1e-3);
  }
  // A shape of another size: nine times as large.
  Shape large = estimate;
  for (Eigen::Vector3f& p : large.cloud.points) p *= 9.0f;
  const CloudComparison c = compare_shapes(large, truth, options);
  EXPECT_LT(misplaced(c.alignment, large.cloud, truth.cloud), 1e-3);
  EXPECT_NEAR(c.alignment.scale, 1.0 / 9.0, 1e-6);
}

TEST(Alignment, ThatCollapsesOrFindsAPartAloneIsRefused) {
  const auto reason = [](const Shape& estimate, const Shape& truth, Alignment alignment) {
    CompareOptions options;
    options.alignment = alignment;
    try {
      compare_shapes(estimate, truth, options);
    } catch (const NoAnswerError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  const Shape road{make_road(6000, 22, 0.0, 0.0), {}};
  const CounterRandom random(23);
  Shape speck, volume;
  for (std::uint64_t i = 0; i < 3000; ++i) {
    Eigen::Vector3f p;
    for (std::uint64_t k = 0; k < 3; ++k) {
      p[static_cast<Eigen::Index>(k)] = static_cast<float>(random.uniform(3 * i + k, -1, 1));
    }
    speck.cloud.points.push_back(0.3f * p);
    volume.cloud.points.push_back(40.0f * p);
  }
  EXPECT_THAT(reason(volume, speck, Alignment::kSimilarity),
              ::testing::HasSubstr("the scale changed by a factor of 0.0"));
  speck.cloud.origin = {0, 0, 5000};
  EXPECT_THAT(reason(speck, road, Alignment::kRigid),
              ::testing::HasSubstr("of the truth's extent and"));
}

TEST(CompareShapes, NothingMovesUnlessAsked) {
  const Shape truth{make_road(5000, 8, 0.0, 0.0), {}};
  Shape estimate = truth;
  for (Eigen::Vector3f& p : estimate.cloud.points) p.z() += 0.3f;
  const CloudComparison c = compare_shapes(estimate, truth, {});
  EXPECT_TRUE(c.alignment.transform.isIdentity(0.0));
  EXPECT_GT(c.accuracy.summary.mean, 0.1);
  EXPECT_EQ(c.accuracy.points.points, estimate.cloud.points);
}

// Both sides' trees are used for both directions; places one by one are the plain way.
TEST(CompareShapes, DistancesAreThoseOfThePlacesWhateverTheOrigins) {
  Shape estimate{make_road(6000, 3, 0.1, 0.3), {}}, truth{make_road(5000, 4, 0.0, 0.0), {}};
  estimate.cloud.origin = {512003.1, 5403000.2, 250.3};
  truth.cloud.origin = {511990.3, 5403007.7, 251.1};
  truth.cloud.points[17].x() = static_cast<float>(kNaN);
  const CloudComparison c = compare_shapes(estimate, truth, {});
  const ShapeDistances there = distances_to(truth, true_points(estimate.cloud), 1),
                       back = distances_to(estimate, true_points(truth.cloud), 1);
  EXPECT_EQ(c.accuracy.distances.nearest, there.nearest);
  EXPECT_EQ(c.completeness.distances.nearest, back.nearest);
  EXPECT_EQ(c.completeness.not_finite, 1u);
  for (std::size_t i = 0; i < there.distance.size(); ++i) {
    ASSERT_NEAR(c.accuracy.distances.distance[i], there.distance[i], 1e-8);
  }
}

TEST(CompareShapes, OfOtherPlacesAreRefusedAtOnce) {
  const Shape truth{make_road(400, 3, 0.0, 0.0), {}};
  const auto refusal = [](const Shape& estimate, const Shape& other, const CompareOptions& o) {
    try {
      compare_shapes(estimate, other, o);
    } catch (const NoAnswerError& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  Shape far = truth;
  far.cloud.origin = {0, 3210e3, 0};
  EXPECT_THAT(refusal(far, truth, {}), ::testing::HasSubstr("lies 3210 km from the truth"));
  EXPECT_THAT(refusal(truth, far, {}), ::testing::HasSubstr("lies 3210 km from the truth"));
  Shape mesh = make_mesh(4.0);
  EXPECT_NE(refusal(far, mesh, {}), "");
  // Moved back by a matrix, or by pairs: it is no other place.
  CompareOptions options;
  options.estimate_from_truth(1, 3) = 3210e3;
  EXPECT_EQ(refusal(far, truth, options), "");
  options = {};
  options.alignment = Alignment::kRigid;
  for (const Vector3d& p : {Vector3d(0, 0, 0), Vector3d(1, 0, 0), Vector3d(0, 1, 0)}) {
    options.pairs.emplace_back(p + far.cloud.origin, p);
  }
  EXPECT_EQ(refusal(far, truth, options), "");
  // A point far off keeps both in one place, and 9 km are none other.
  Shape astray = far;
  astray.cloud.points.emplace_back(0.0f, -3210e3f, 0.0f);
  EXPECT_EQ(refusal(astray, truth, {}), "");
  Shape near = truth;
  near.cloud.origin = {0, 9e3, 0};
  const CloudComparison c = compare_shapes(near, truth, {});
  const std::vector<Vector3d> places = true_points(truth.cloud);
  for (const std::size_t i : {0u, 99u, 399u}) {
    const Vector3d p = near.cloud.origin + near.cloud.points[i].cast<double>();
    double least = 1e9;
    for (const Vector3d& q : places) least = std::min(least, (p - q).norm());
    EXPECT_NEAR(c.accuracy.distances.distance[i], least, 1e-9);
  }
}

TEST(CompareShapes, ColumnsStandApartHoweverFarTheShapes) {
  CloudComparison c;
  c.accuracy.summary = summarise_distances(std::vector<double>(6000, 5423092.1105));
  c.road.push_back({});
  c.road[0].by = "all";
  c.road[0].count = 6000;
  c.road[0].height_mean = c.road[0].height_median = c.road[0].height_rms = c.road[0].along_rms =
      c.road[0].across_rms = 5423092.1105;
  const std::string text = describe(c);
  EXPECT_THAT(text, ::testing::HasSubstr("6000 5423092.1105 5423092.1105 5423092.1105 "));
  EXPECT_THAT(text, ::testing::HasSubstr("+5423092.1105 5423092.1105 5423092.1105 5423092.1105"));
}

TEST(CompareShapes, UpToScaleNothingIsInMetres) {
  const Shape truth{make_road(2000, 9, 0.0, 0.2), {}};
  Shape estimate{make_road(2000, 9, 0.05, 0.2), {}};
  estimate.cloud.metric = false;
  CloudComparison c = compare_shapes(estimate, truth, {});
  EXPECT_FALSE(c.metric);
  EXPECT_FALSE(c.accuracy.points.metric);
  EXPECT_EQ(to_json(c).at("metric"), false);
  const std::string text = describe(c);
  EXPECT_THAT(text, ::testing::HasSubstr("up to scale"));
  EXPECT_THAT(text, ::testing::HasSubstr("\nunits  "));
  EXPECT_THAT(text, ::testing::HasSubstr("0.050 units"));
  EXPECT_THAT(text, ::testing::Not(::testing::ContainsRegex("metres| m( |\n)")));
  // Scaled to a truth in metres the distances are in metres.
  CompareOptions options;
  options.alignment = Alignment::kScale;
  c = compare_shapes(estimate, truth, options);
  EXPECT_TRUE(c.metric);
  EXPECT_TRUE(c.accuracy.points.metric);
  EXPECT_THAT(describe(c), ::testing::HasSubstr("metres  "));
}

TEST(CompareShapes, ThePrintedMatrixMovesMapCoordinatesToTheMillimetre) {
  CloudComparison c;
  c.alignment.alignment = Alignment::kRigid;
  const Eigen::Matrix3d turn =
      Eigen::AngleAxisd(0.1234567890123, Eigen::Vector3d(0.3, 0.5, 0.8).normalized())
          .toRotationMatrix();
  c.alignment.transform.topLeftCorner<3, 3>() = turn;
  c.alignment.transform.topRightCorner<3, 1>() = Eigen::Vector3d(450000.25, -5420000.5, 113.125);
  std::istringstream text(describe(c));
  std::string line;
  std::getline(text, line);
  Eigen::Matrix4d read;
  for (int i = 0; i < 16; ++i) text >> read(i / 4, i % 4);
  const Eigen::Vector4d place(450000.0, 5420000.0, 113.0, 1.0);
  EXPECT_LT((read * place - c.alignment.transform * place).norm(), 1e-3);
}

TEST(CompareShapes, AnyNumberOfThreadsTheSameNumbers) {
  const Shape truth = make_mesh(1.0), estimate{make_road(20000, 9, 0.05, 0.2), {}};
  CompareOptions options;
  options.alignment = Alignment::kRigid;
  options.num_threads = 1;
  const std::string one = to_json(compare_shapes(estimate, truth, options)).dump();
  options.num_threads = 8;
  EXPECT_EQ(one, to_json(compare_shapes(estimate, truth, options)).dump());
}

TEST(SampleMesh, SpreadsEvenly) {
  const Shape mesh = make_mesh(1.0);
  const RoadCloud points = sample_mesh(mesh, 50.0, 1000000, 3);
  EXPECT_NEAR(static_cast<double>(points.size()), 80.0 * 12.0 * 50.0, 0.02 * 48000);
  std::size_t ahead = 0;
  for (const Eigen::Vector3f& p : points.points) ahead += p.x() > 20.0f ? 1 : 0;
  EXPECT_NEAR(static_cast<double>(ahead) / static_cast<double>(points.size()), 0.25, 0.01);
  for (const double d : distances_to(mesh, true_points(points), 1).distance) EXPECT_LT(d, 1e-5);
  EXPECT_EQ(sample_mesh(mesh, 50.0, 100, 3).size(), 100u);
}

TEST(CompareShapes, RefusesWhatCannotAnswer) {
  const Shape road{make_road(100, 10, 0.0, 0.0), {}};
  EXPECT_THROW(compare_shapes({}, road, {}), NoAnswerError);
  CompareOptions options;
  options.region = CropBox{{900, 900, 900}, {901, 901, 901}};
  EXPECT_THROW(compare_shapes(road, road, options), NoAnswerError);
  options = {};
  options.thresholds = {0.1, -1.0};
  EXPECT_THROW(compare_shapes(road, road, options), std::invalid_argument);
  options = {};
  options.along = options.up;
  EXPECT_THROW(compare_shapes(road, road, options), std::invalid_argument);
  Shape broken = make_mesh(4.0);
  broken.triangles.push_back({0, 1, 100000});
  EXPECT_THROW(compare_shapes(road, broken, {}), std::invalid_argument);
  options = {};
  options.alignment = Alignment::kRigid;
  for (int i = 0; i < 5; ++i) options.pairs.emplace_back(Vector3d(i, 0, 0), Vector3d(i, 0, 0));
  EXPECT_THROW(compare_shapes(road, road, options), NoAnswerError);
}

}  // namespace
}  // namespace camber
