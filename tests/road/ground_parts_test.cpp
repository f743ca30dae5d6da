// Ground at the border of a cloud, and of parts of a cloud.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "camber/core/random.h"
#include "camber/road/segment_ground.h"
#include "road/scan_maker.h"

namespace camber {
namespace {

constexpr double kDegree = M_PI / 180.0;

/// Points of a height over a rectangle of the plan, turned about up.
RoadCloud over_plan(double width, double height, double density, double turn,
                    const std::function<double(double, double)>& z) {
  RoadCloud cloud;
  const CounterRandom random(5);
  const auto points = static_cast<std::uint64_t>(width * height * density);
  for (std::uint64_t i = 0; i < points; ++i) {
    const double u = random.uniform(3 * i, 0.0, width), v = random.uniform(3 * i + 1, 0.0, height);
    const double c = std::cos(turn), s = std::sin(turn);
    cloud.points.push_back(
        Eigen::Vector3d(c * u - s * v, s * u + c * v, z(u, v) + 0.03 * random.normal(i))
            .cast<float>());
  }
  return cloud;
}

struct Slope {
  double degrees, turn_deg, level, density;
};

class SlopeAtEdge : public ::testing::TestWithParam<Slope> {};

// 20 m level, then a slope of 30 m up to the border, which is where the grid's is or askew to it.
TEST_P(SlopeAtEdge, IsGroundUpToTheBorder) {
  const Slope& slope = GetParam();
  const double rise = std::tan(slope.degrees * kDegree);
  const RoadCloud cloud =
      over_plan(slope.level + 30.0, 60.0, slope.density, slope.turn_deg * kDegree,
                [&](double u, double) { return rise * std::max(0.0, u - slope.level); });
  const GroundSegmentation found = segment_ground(cloud);
  ASSERT_EQ(found.status, Status::kOk);
  EXPECT_GT(static_cast<double>(found.ground), 0.97 * static_cast<double>(cloud.size()));
  EXPECT_GT(found.ground_area_share, 0.97);
}
INSTANTIATE_TEST_SUITE_P(EveryEdge, SlopeAtEdge,
                         ::testing::Values(Slope{15, 0, 20, 10}, Slope{15, 90, 20, 10},
                                           Slope{15, 180, 20, 10}, Slope{15, 270, 20, 10},
                                           Slope{30, 0, 20, 10}, Slope{30, 90, 20, 10},
                                           Slope{30, 180, 20, 10}, Slope{30, 270, 20, 10},
                                           Slope{30, 45, 20, 10}, Slope{30, 20, 20, 10},
                                           Slope{30, 110, 0, 10}, Slope{30, 0, 20, 2},
                                           Slope{15, 200, 20, 2}));

// What stands on the ground at the border is cut by it: a car, a house of 8 m, a tree.
TEST(GroundAtEdge, ObjectsAreNoGround) {
  for (const double degrees : {0.0, 15.0}) {
    const double rise = std::tan(degrees * kDegree);
    std::vector<int> truth;
    const RoadCloud cloud = over_plan(60.0, 60.0, 20.0, 0.0, [&](double u, double v) {
      const bool car = u > 58.0 && v > 10.0 && v < 14.5;
      const bool house = u > 56.0 && v > 30.0 && v < 38.0;
      const bool tree = std::hypot(u - 20.0, v - 59.0) < 3.0;
      truth.push_back(car || house || tree ? 0 : 1);
      return rise * u + (car ? 1.5 : house ? 5.0 : tree ? 6.0 : 0.0);
    });
    const GroundSegmentation found = segment_ground(cloud);
    const test::GroundScore score = test::score_ground(truth, found.labels);
    EXPECT_GT(score.precision, 0.995) << degrees;
    EXPECT_GT(score.recall, 0.98) << degrees;
  }
}

/// Hills with houses, sheds, hedges, ponds that nothing comes back from, and reflections below;
/// coordinates in 1/256 m.
RoadCloud made_country(double side, double density) {
  RoadCloud cloud;
  const CounterRandom random(17);
  const auto points = static_cast<std::uint64_t>(side * side * density);
  const auto rounded = [](double v) { return static_cast<float>(std::round(256.0 * v) / 256.0); };
  for (std::uint64_t i = 0; i < points; ++i) {
    const double x = random.uniform(4 * i, 0.0, side), y = random.uniform(4 * i + 1, 0.0, side);
    if (std::hypot(std::fmod(x, 130.0) - 60.0, std::fmod(y, 110.0) - 40.0) < 14.0) continue;
    double z = 8.0 * std::sin(x / 40.0) + 5.0 * std::cos(y / 31.0) + 0.03 * random.normal(i);
    const double u = std::fmod(x, 47.0), v = std::fmod(y, 39.0);
    if (u < 9.0 && v < 7.0) {
      z += 6.0;
    } else if (u > 20.0 && u < 22.0 && v > 5.0 && v < 35.0) {
      z += random.uniform(4 * i + 2, 0.0, 0.6);
    } else if (u > 30.0 && u < 34.0 && v > 30.0 && v < 34.0) {
      z += 0.9;
    } else if (random.uniform(4 * i + 3) < 2e-4) {
      z -= 3.0;
    }
    if (rounded(x) < side && rounded(y) < side) {
      cloud.points.emplace_back(rounded(x), rounded(y), rounded(z));
    }
  }
  return cloud;
}

/// Labels of a cloud by four parts, each with the points around it.
std::vector<int> labels_by_parts(const RoadCloud& cloud, const GroundPlan& plan, double side,
                                 double halo) {
  std::vector<int> labels(cloud.size(), -1);
  for (int part = 0; part < 4; ++part) {
    const double x0 = part % 2 * 0.5 * side, y0 = part / 2 * 0.5 * side;
    const auto within = [&](std::size_t i, double margin) {
      const double x = cloud.points[i].x(), y = cloud.points[i].y();
      return x >= x0 - margin && x < x0 + 0.5 * side + margin && y >= y0 - margin &&
             y < y0 + 0.5 * side + margin;
    };
    std::vector<int> chosen;
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      if (within(i, halo)) chosen.push_back(static_cast<int>(i));
    }
    RoadCloud tile = cloud.select(chosen);
    // As a tile has it: coordinates from a corner of its own.
    const double step = plan.alignment();
    const Eigen::Vector3d shift(std::floor(x0 / step) * step, std::floor(y0 / step) * step, 0.0);
    tile.origin += shift;
    for (Eigen::Vector3f& p : tile.points) p -= shift.cast<float>();
    GroundOptions options;
    options.plan = plan;
    const GroundSegmentation found = segment_ground(tile, options);
    for (std::size_t k = 0; k < chosen.size(); ++k) {
      const auto i = static_cast<std::size_t>(chosen[k]);
      if (within(i, 0.0)) labels[i] = found.labels[k];
    }
  }
  return labels;
}

std::size_t differing(const std::vector<int>& a, const std::vector<int>& b) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < a.size(); ++i) count += a[i] != b[i] ? 1 : 0;
  return count;
}

TEST(GroundOfParts, IsThatOfTheWhole) {
  for (const double density : {1.0, 6.0}) {
    const bool sparse = density < 4.0;
    const double side = sparse ? 640.0 : 400.0;
    RoadCloud cloud = made_country(side, density);
    cloud.origin = {651000.0, 6270000.0, 120.0};
    const GroundPlan plan = [&] {
      GroundPlan chosen = segment_ground(cloud).plan();
      if (!sparse) {
        GroundOptions street;
        street.plan = GroundPlan();
        chosen = *street.plan;
      }
      return chosen;
    }();
    EXPECT_EQ(plan.from_air, sparse);
    EXPECT_LT(plan.reach(), 0.5 * side);  // else each part would be the whole
    GroundOptions options;
    options.plan = plan;
    const GroundSegmentation whole = segment_ground(cloud, options);
    ASSERT_EQ(whole.status, Status::kOk);
    EXPECT_GT(whole.ground, cloud.size() / 2);
    EXPECT_EQ(differing(whole.labels, labels_by_parts(cloud, plan, side, plan.reach())), 0u);
    // Without the points around it a part is answered otherwise.
    EXPECT_GT(differing(whole.labels, labels_by_parts(cloud, plan, side, 0.0)), 0u);
  }
}

TEST(GroundOfParts, APlanIsWhatTheWholeDecides) {
  const RoadCloud cloud = made_country(150.0, 2.0);
  const GroundSegmentation free = segment_ground(cloud);
  GroundOptions options;
  options.plan = free.plan();
  const GroundSegmentation planned = segment_ground(cloud, options);
  EXPECT_EQ(planned.labels, free.labels);
  EXPECT_EQ(planned.tolerance, free.tolerance);
  options.plan->cell = 0.3;  // no multiple of 1/64
  EXPECT_THROW(segment_ground(cloud, options), std::invalid_argument);
  options.plan = free.plan();
  options.plan->largest_object = 300.0 * options.plan->cell;
  EXPECT_THROW(segment_ground(cloud, options), std::invalid_argument);
  // A grid over two countries is not begun.
  RoadCloud far = cloud;
  far.points.emplace_back(3e7f, 3e7f, 0.0f);
  options.plan = free.plan();
  const GroundSegmentation none = segment_ground(far, options);
  EXPECT_EQ(none.status, Status::kFailed);
  EXPECT_NE(none.reason.find("too far apart"), std::string::npos);
}

TEST(GroundArea, ShareIsSmallUnderAWideRoof) {
  const RoadCloud cloud = over_plan(30.0, 30.0, 20.0, 0.0, [](double u, double v) {
    return u > 3.0 && u < 27.0 && v > 3.0 && v < 27.0 ? 6.0 : 0.0;
  });
  GroundOptions options;
  options.largest_object = 40.0;
  EXPECT_LT(segment_ground(cloud, options).ground_area_share, 0.5);
}

}  // namespace
}  // namespace camber
