#include "camber/export/crg_strip.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <sstream>

#include "camber/core/errors.h"
#include "peer_crg.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// A ground of a formula, known within a distance of the x axis' arc of radius 60 m about (0, 60).
class MadeGround : public HeightSource {
 public:
  GroundSample at(const Vector3d& place) const override {
    GroundSample sample;
    const Vector2d arm = place.head<2>() - Vector2d(0.0, 60.0);
    if (std::abs(arm.norm() - 60.0) > 4.1) return sample;
    sample.height = height(place.x(), place.y());
    return sample;
  }
  double resolution() const override { return 0.19; }
  static double height(double x, double y) {
    return 412.0 + 0.12 * x + 0.03 * y + 0.3 * std::sin(0.2 * x) + 0.01 * std::sin(2.0 * y);
  }
};

std::vector<Vector3d> arc_line() {
  std::vector<Vector3d> line;
  for (double a = 0.0; a < 0.8; a += 0.03) {
    line.emplace_back(60.0 * std::sin(a), 60.0 - 60.0 * std::cos(a), 412.0);
  }
  return line;
}

TEST(SmoothLine, FollowsAnArc) {
  const SmoothLine line(arc_line(), 0.005);
  EXPECT_LE(line.deviation(), 0.005);
  for (double s = 3.0; s < line.length() - 3.0; s += 0.7) {
    EXPECT_NEAR((line.position(s) - Vector2d(0.0, 60.0)).norm(), 60.0, 0.01);
    EXPECT_NEAR(line.curvature(s), 1.0 / 60.0, 0.004);
    const Vector2d step = line.position(s + 1e-4) - line.position(s - 1e-4);
    EXPECT_NEAR(std::remainder(std::atan2(step.y(), step.x()) - line.heading(s), 2 * M_PI), 0.0,
                1e-6);
    EXPECT_NEAR(step.norm(), 2e-4, 1e-7);  // s is the arc length
  }
}

TEST(SmoothLine, GoesOnStraight) {
  const SmoothLine line({{0, 0, 1}, {1, 0, 2}}, 0.01, 2.0, 3.0);
  EXPECT_NEAR(line.length(), 6.0, 1e-12);
  EXPECT_NEAR(line.position(0.0).x(), -2.0, 1e-12);
  EXPECT_NEAR(line.position(6.0).x(), 4.0, 1e-12);
  EXPECT_NEAR(line.height(2.5), 1.5, 1e-12);
  EXPECT_THROW(SmoothLine({{0, 0, 0}, {0, 0, 5}}, 0.01), std::invalid_argument);
  // What a damaged file may have, and nobody waits for.
  for (const double far : {2e5, 1e10, 1e200, 1e308}) {
    EXPECT_THROW(SmoothLine({{0, 0, 0}, {far, 0, 0}}, 0.01), std::invalid_argument) << far;
    EXPECT_THROW(SmoothLine({{-far, 0, 0}, {far, 0, 0}}, 0.01), std::invalid_argument) << far;
  }
}

TEST(SmoothLine, ItsScatterIsThatOfThePoints) {
  EXPECT_LT(line_scatter(arc_line()), 1e-5);
  std::vector<Vector3d> roundabout, noisy;
  for (double a = 0.0; a < 6.0; a += 1.0 / 3.0) {  // 5 m apart
    roundabout.emplace_back(15.0 * std::cos(a), 15.0 * std::sin(a), 0.0);
  }
  for (double a = 6.0; a < 12.0; a += 1.0 / 3.0) {
    roundabout.emplace_back(15.0 * std::cos(a), 15.0 * std::sin(a), 0.0);
  }
  EXPECT_LT(line_scatter(roundabout), 0.002);
  EXPECT_EQ(line_scatter({{0, 0, 0}, {5, 1, 0}, {10, 0, 0}}), 0.0);
  std::mt19937 random(4);
  const auto noise = [&] { return 0.0346 * (2.0 * (random() / 4294967296.0) - 1.0); };
  for (double x = 0.0; x < 200.0; x += 0.5) {
    noisy.emplace_back(x + noise(), 0.001 * x * x + noise(), 0.0);
  }
  EXPECT_NEAR(line_scatter(noisy), 0.02, 0.004);  // of 400 points, by a median
}

TEST(PlanFrame, IsARotationWithUpAsZ) {
  for (const Vector3d& up : {Vector3d(0, -1, 0), Vector3d(0.1, -0.9, -0.2), Vector3d(0, 0, 1),
                             Vector3d(0, 0, -1), Vector3d(1, 0, 0)}) {
    const PlanFrame frame(up);
    EXPECT_NEAR(frame.plan_from_surface.determinant(), 1.0, 1e-12);
    EXPECT_NEAR((frame.to_plan(up.normalized()) - Vector3d::UnitZ()).norm(), 0.0, 1e-12);
  }
  const PlanFrame camera(Vector3d(0, -1, 0));
  EXPECT_NEAR((camera.to_plan({1, 2, 3}) - Vector3d(3, -1, -2)).norm(), 0.0, 1e-12);
}

TEST(RoadStrip, WidthIsWhatIsSeen) {
  const SeenWidth width = seen_width(MadeGround(), SmoothLine(arc_line(), 0.005), 2.0, 12.0, 0);
  for (std::size_t i = 0; i < width.stations.size(); ++i) {
    EXPECT_NEAR(width.left[i], 4.0, 0.3);
    EXPECT_NEAR(width.right[i], 4.0, 0.3);
  }
}

TEST(RoadStrip, GridPointsHaveTheGroundsHeight) {
  for (const CrgEncoding encoding : {CrgEncoding::kText, CrgEncoding::kBinary}) {
    for (const bool in_line : {true, false}) {
      CrgGridOptions options;
      options.encoding = encoding;
      options.slope_in_line = options.banking_in_line = in_line;
      const CrgData made = make_crg(MadeGround(), SmoothLine(arc_line(), 0.005), options);
      EXPECT_DOUBLE_EQ(made.increment, 0.2);
      EXPECT_EQ(made.slope.empty(), !in_line);
      const test::TemporaryFolder folder;
      const fs::path file = folder.path() / "made.crg";
      write_crg(made, file);
      const CrgRoad road(read_crg(file));
      // ASAM's reader takes an end that is not stated for the origin.
      ASSERT_TRUE(made.end_x && made.end_y);
      EXPECT_NEAR(*made.end_x, road.position(road.last_u(), 0.0).x(), 1e-6);
      EXPECT_NEAR(*made.end_y, road.position(road.last_u(), 0.0).y(), 1e-6);
      std::size_t known = 0;
      double largest = 0.0;
      std::vector<test::CrgPlace> places;
      std::vector<double> heights;
      for (std::size_t i = 0; i < road.sections(); ++i) {
        const double u = static_cast<double>(i) * road.increment();
        for (std::size_t j = 0; j < road.v().size(); ++j) {
          const Vector2d place = road.position(u, road.v()[j]);
          const double truth = MadeGround().at({place.x(), place.y(), 412.0}).height;
          EXPECT_EQ(std::isnan(road.node(i, j)), std::isnan(truth));
          if (std::isnan(truth)) continue;
          ++known;
          // Digits of LRFI, or of floats of a few metres.
          EXPECT_NEAR(road.node(i, j), truth, 1e-6);
          largest = std::max(largest,
                             std::abs(static_cast<double>(made.heights[i * road.v().size() + j])));
          places.push_back({false, u, road.v()[j]});
          heights.push_back(truth);
        }
      }
      EXPECT_GT(known, 8000u);
      EXPECT_LT(largest, in_line ? 0.5 : 10.0);  // what is left for 4 bytes
      if (!test::has_crg_peer()) continue;
      const std::vector<double> theirs = test::crg_peer_heights(file, places, true);
      ASSERT_EQ(theirs.size(), places.size());
      double worst = 0.0;
      for (std::size_t i = 0; i < theirs.size(); ++i) {
        // Beside an unknown cell the bilinear formula of a reader knows nothing.
        if (std::isnan(theirs[i])) continue;
        worst = std::max(worst, std::abs(theirs[i] - heights[i]));
      }
      EXPECT_LT(worst, 1e-5);
      RecordProperty(std::string(to_string(encoding)) + (in_line ? "_line" : "_grid"),
                     std::to_string(worst));
    }
  }
}

TEST(RoadStrip, ABendThatTakesGroundAwayIsFound) {
  class Everywhere : public HeightSource {
   public:
    GroundSample at(const Vector3d&) const override {
      GroundSample sample;
      sample.height = 0.0;
      return sample;
    }
    double resolution() const override { return 0.2; }
  };
  std::vector<Vector3d> points;
  for (double a = 0.0; a < 3.0; a += 0.05) {
    points.emplace_back(5.0 * std::sin(a), 5.0 - 5.0 * std::cos(a), 0.0);
  }
  const SmoothLine line(points, 0.001);
  const auto bend = tight_bend(Everywhere(), line, 0.0, 0.0, 12.0);
  ASSERT_TRUE(bend);
  EXPECT_TRUE(bend->left);
  EXPECT_NEAR(bend->radius, 5.0, 0.3);
  EXPECT_LT(bend->room, bend->radius);
  EXPECT_DOUBLE_EQ(bend->wanted, 12.0);
  EXPECT_FALSE(tight_bend(Everywhere(), line, 3.0, 0.0, 12.0));
  EXPECT_FALSE(tight_bend(MadeGround(), SmoothLine(arc_line(), 0.005), 0.0, 0.0, 12.0));
}

TEST(RoadStrip, NothingSeenIsNoAnswer) {
  const SmoothLine line({{1000, 0, 0}, {1050, 0, 0}}, 0.01);
  EXPECT_THROW(make_crg(MadeGround(), line, {}), NoAnswerError);
  CrgGridOptions options;
  options.step_u = -1.0;
  EXPECT_THROW(make_crg(MadeGround(), line, options), std::invalid_argument);
}

/// Points 0.1 m apart on the plane of CloudPlanesIgnoreOutliers, on a map.
RoadCloud even_cloud() {
  RoadCloud cloud;
  cloud.frame = CloudFrame::kZUp;
  cloud.origin = {500000.0, 5400000.0, 300.0};
  for (int i = 0; i < 60; ++i) {
    for (int k = 0; k < 60; ++k) {
      const float x = 0.1f * static_cast<float>(i), y = 0.1f * static_cast<float>(k);
      cloud.points.emplace_back(x, y, 0.1f * x - 0.05f * y);
    }
  }
  return cloud;
}

TEST(HeightSource, StrayPointsFarAwayChangeNothing) {
  const RoadCloud even = even_cloud();
  RoadCloud cloud = even;
  cloud.points.emplace_back((-cloud.origin).cast<float>());  // the map's 0, 0, 0
  cloud.points.emplace_back(9e4f, -3e5f, 0.0f);
  const PlanFrame frame;
  const auto expected = cloud_heights(even, frame);
  const PlanCorridor corridor =
      corridor_along(SmoothLine({{500000, 5400003, 300}, {500006, 5400003, 300}}, 0.01), 5.0);
  for (const PlanCorridor* where : {static_cast<const PlanCorridor*>(nullptr), &corridor}) {
    const auto ground = cloud_heights(cloud, frame, where);
    EXPECT_NEAR(ground->resolution(), expected->resolution(), where ? 0.0 : 0.005);
    for (double x = 0.5; x < 5.5; x += 0.31) {
      const Vector3d place(500000.0 + x, 5400002.0, 300.0);
      EXPECT_NEAR(ground->at(place).height, expected->at(place).height, 1e-4);
    }
  }
}

TEST(HeightSource, PointsOffTheCorridorDoNotCount) {
  RoadCloud cloud = even_cloud();
  const double spacing = cloud_heights(cloud, PlanFrame())->resolution();
  for (int i = 0; i < 40000; ++i) {  // a wood beside the road, far denser
    cloud.points.emplace_back(0.01f * static_cast<float>(i % 200),
                              100.0f + 0.01f * static_cast<float>(i / 200), 0.0f);
  }
  const PlanCorridor corridor =
      corridor_along(SmoothLine({{500000, 5400003, 300}, {500006, 5400003, 300}}, 0.01), 5.0);
  EXPECT_LT(cloud_heights(cloud, PlanFrame())->resolution(), 0.5 * spacing);
  const auto ground = cloud_heights(cloud, PlanFrame(), &corridor);
  EXPECT_DOUBLE_EQ(ground->resolution(), spacing);
  EXPECT_TRUE(std::isnan(ground->at({500001.0, 5400101.0, 300.0}).height));
}

/// A deck of points 6 m above those of even_cloud(), from one x to another.
RoadCloud bridged_cloud(float from, float to) {
  RoadCloud cloud = even_cloud();
  const std::vector<Eigen::Vector3f> below = cloud.points;
  for (const Eigen::Vector3f& p : below) {
    if (p.x() > from && p.x() < to) cloud.points.emplace_back(p + Eigen::Vector3f(0, 0, 6));
  }
  return cloud;
}

TEST(RoadStrip, ALineWithoutHeightsLiesOnTheGround) {
  const auto ground = cloud_heights(bridged_cloud(2.0f, 4.0f), PlanFrame());
  const auto height = [](double x, double y) { return 300.0 + 0.1 * x - 0.05 * y; };
  ASSERT_EQ(ground->levels({500001.0, 5400003.0}).size(), 1u);
  const std::vector<double> both = ground->levels({500003.0, 5400003.0});
  ASSERT_EQ(both.size(), 2u);
  EXPECT_NEAR(both[0], height(3.0, 3.0), 1e-3);
  EXPECT_NEAR(both[1], height(3.0, 3.0) + 6.0, 1e-3);
  EXPECT_TRUE(ground->levels({500020.0, 5400003.0}).empty());
  const auto line_at = [](double z) {
    return std::vector<Vector3d>{{500000.5, 5400003.0, z}, {500005.5, 5400003.0, z}};
  };
  const double unknown = std::numeric_limits<double>::quiet_NaN();
  const SmoothLine line = line_over_ground(*ground, line_at(unknown), 0.01, 0.0, 1);
  for (double s = 0.0; s < 5.0; s += 0.3) {  // under the deck as on either side of it
    EXPECT_NEAR(line.height(s), height(0.5 + s, 3.0), 1e-3);
  }
  EXPECT_EQ(ground_beside(*ground, line, 1).far, 0u);
  const GroundBeside below = ground_beside(*ground, SmoothLine(line_at(303.0), 0.01), 1);
  EXPECT_EQ(below.far, below.stations);
  EXPECT_NEAR(below.above, height(3.0, 3.0) - 303.0, 0.3);  // 0.1 m more or less each metre
  const auto covered = cloud_heights(bridged_cloud(-1.0f, 9.0f), PlanFrame());
  EXPECT_THROW(line_over_ground(*covered, line_at(unknown), 0.01, 0.0, 1), NoAnswerError);
}

TEST(HeightSource, CloudPlanesIgnoreOutliers) {
  RoadCloud cloud = even_cloud();
  for (int i = 0; i < 60; ++i) {
    for (int k = 0; k < 60; ++k) {
      if ((7 * i + 3 * k) % 17 != 0) continue;
      cloud.points[static_cast<std::size_t>(60 * i + k)].z() += 0.6f;
    }
  }
  const auto ground = cloud_heights(cloud, PlanFrame(Vector3d::UnitZ()));
  EXPECT_NEAR(ground->resolution(), 0.1, 0.02);
  for (double x = 0.5; x < 5.5; x += 0.31) {
    for (double y = 0.5; y < 5.5; y += 0.37) {
      const GroundSample sample = ground->at({500000.0 + x, 5400000.0 + y, 300.0});
      EXPECT_NEAR(sample.height, 300.0 + 0.1 * x - 0.05 * y, 1e-3);
      EXPECT_NEAR(sample.normal.x() / sample.normal.z(), -0.1, 5e-3);
    }
  }
  EXPECT_TRUE(std::isnan(ground->at({500010.0, 5400000.0, 300.0}).height));
}

/// A plane that tilts both ways.
double tilted(double x, double y) { return 0.02 * x + 0.01 * y; }

/// How much of a strip from one x to another, 7 m wide, is known, and how far it is off the plane.
struct Coverage {
  double known = 0.0;    // share
  double largest = 0.0;  // m
};
Coverage coverage(const HeightSource& ground, double from, double to) {
  Coverage out;
  int count = 0, known = 0;
  for (double x = from; x < to; x += 0.37) {
    for (double y = -3.5; y < 3.6; y += 0.41) {
      ++count;
      const double height = ground.at({x, y, tilted(x, y)}).height;
      if (!std::isfinite(height)) continue;
      ++known;
      out.largest = std::max(out.largest, std::abs(height - tilted(x, y)));
    }
  }
  out.known = static_cast<double>(known) / count;
  return out;
}

TEST(HeightSource, AThinningScanIsCoveredAsFarAsItGoes) {
  std::mt19937 random(1);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * (random() / 4294967296.0);
  };
  RoadCloud cloud;
  for (int i = 0; i < 60000; ++i) {  // 780 points per square metre at first, 5 at last
    const double x = 1.0 / uniform(1.0 / 80.0, 1.0 / 3.0), y = uniform(-4.0, 4.0);
    cloud.points.push_back(
        Vector3d(x, y, tilted(x, y) + uniform(-0.017, 0.017)).cast<float>());  // 1 cm
  }
  const auto ground = cloud_heights(cloud, PlanFrame());
  for (const double from : {3.0, 20.0, 40.0, 60.0}) {
    const Coverage seen = coverage(*ground, from, from + 19.5);
    EXPECT_GT(seen.known, 0.97) << from;
    EXPECT_LT(seen.largest, 0.03) << from;  // the worst of a thousand, of 3 to 5 mm
  }
}

TEST(HeightSource, LinesOfAScannerAreJoined) {
  RoadCloud cloud;
  for (double x = 0.0; x < 20.0; x += 0.5) {
    for (double y = -4.0; y < 4.0; y += 0.02) {
      cloud.points.push_back(Vector3d(x, y, tilted(x, y)).cast<float>());
    }
  }
  const Coverage seen = coverage(*cloud_heights(cloud, PlanFrame()), 1.0, 19.0);
  EXPECT_EQ(seen.known, 1.0);
  EXPECT_LT(seen.largest, 1e-4);
}

TEST(HeightSource, HolesStayOpen) {
  for (const double spacing : {0.1, 0.4}) {  // beside as many points 0.1 m apart
    RoadCloud cloud;
    const double hole = 6.0 * spacing;
    for (double x = -6.0; x < 6.0; x += spacing) {
      for (double y = -6.0; y < 6.0; y += spacing) {
        if (std::hypot(x, y) < hole) continue;
        cloud.points.push_back(Vector3d(x, y, tilted(x, y)).cast<float>());
      }
    }
    for (double x = 6.0; x < 18.0; x += 0.1) {
      for (double y = -6.0; y < 6.0; y += 0.1) {
        cloud.points.push_back(Vector3d(x, y, tilted(x, y)).cast<float>());
      }
    }
    const auto ground = cloud_heights(cloud, PlanFrame());
    for (double a = 0.0; a < 6.3; a += 0.3) {
      for (const double r : {0.0, 0.3 * hole, 0.6 * hole}) {
        const Vector3d place(r * std::cos(a), r * std::sin(a), 0.0);
        EXPECT_TRUE(std::isnan(ground->at(place).height)) << spacing << " " << place.transpose();
      }
      const Vector3d beside(2.0 * hole * std::cos(a), 2.0 * hole * std::sin(a), 0.0);
      EXPECT_NEAR(ground->at(beside).height, tilted(beside.x(), beside.y()), 1e-3);
    }
  }
}

TEST(HeightSource, PointsOnALineGiveNoHeightBesideIt) {
  RoadCloud cloud = even_cloud();
  for (int i = 0; i < 9; ++i) {  // 3 m off, 1 cm of noise
    const float sign = i % 2 == 0 ? 0.01f : -0.01f;
    cloud.points.emplace_back(8.9f + 0.025f * static_cast<float>(i), 3.0f + sign * 0.5f, sign);
  }
  const auto ground = cloud_heights(cloud, PlanFrame());
  for (const double aside : {-0.11, -0.06, 0.06, 0.11}) {
    EXPECT_TRUE(std::isnan(ground->at({500009.0, 5400003.0 + aside, 300.0}).height)) << aside;
  }
}

}  // namespace
}  // namespace camber
