#include "camber/road/road_strip.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "camber/core/random.h"

namespace camber {
namespace {

std::vector<Eigen::Vector3d> quarter_circle(double radius, double step) {
  std::vector<Eigen::Vector3d> out;
  for (double a = 0.0; a < 0.5 * M_PI; a += step / radius) {
    out.emplace_back(radius * std::sin(a), radius * (1.0 - std::cos(a)), 0.01 * radius * a);
  }
  return out;
}

TEST(DrivenLine, MeasuresAlongAndToTheLeft) {
  const DrivenLine line({{0, 0, 0}, {10, 0, 1}, {10, 0, 1}, {20, 0, 1}});
  EXPECT_DOUBLE_EQ(line.length(), 20.0);
  ASSERT_EQ(line.lengths().size(), 4U);
  EXPECT_DOUBLE_EQ(line.lengths()[2], 10.0);  // standing adds nothing
  const auto place = line.project({5, 2, 7}, 0, 20);
  ASSERT_TRUE(place);
  EXPECT_DOUBLE_EQ(place->s, 5.0);
  EXPECT_DOUBLE_EQ(place->lateral, 2.0);
  EXPECT_DOUBLE_EQ(place->height, 0.5);
  EXPECT_DOUBLE_EQ(line.project({5, -2, 7}, 0, 20)->lateral, -2.0);
  // The last piece goes on straight.
  EXPECT_DOUBLE_EQ(line.project({26, 1, 0}, 0, 40)->s, 26.0);
  EXPECT_NEAR(line.at(30.0).x(), 30.0, 1e-12);
}

TEST(DrivenLine, IsLaidOntoTheCells) {
  // Feet that shake by 2 cm over a crest that falls 3 % to the left; no cells before 3 m.
  const CounterRandom random(9);
  const auto height = [](double x) { return 0.05 * x - 0.004 * x * x; };
  std::vector<Eigen::Vector3d> feet;
  for (int i = 0; i < 60; ++i) {
    feet.emplace_back(0.4 * i, 0.0, height(0.4 * i) + 0.02 * random.normal(i) + 0.1);
  }
  std::vector<StripCell> cells;
  for (double s = 3.25; s < 40.0; s += 0.5) {
    for (double lateral = -3.75; lateral < 4.0; lateral += 0.5) {
      StripCell cell;
      cell.s = s;
      cell.lateral = lateral;
      cell.sigma = 0.01;
      cell.point << s, lateral, height(s) - 0.03 * lateral;
      cells.push_back(cell);
    }
  }
  const DrivenLine before(feet), after = laid_onto(cells, before);
  ASSERT_EQ(after.points().size(), before.points().size());
  for (std::size_t i = 0; i < after.points().size(); ++i) {
    const DrivenPoint& p = after.points()[i];
    EXPECT_EQ(p.s, before.points()[i].s);
    if (p.s < 4.0) continue;
    EXPECT_NEAR(p.foot.z(), height(p.s), 1e-9) << p.s;  // a parabola and a slope, as it is fitted
  }
  // Before the cells as it was, moved as a whole.
  EXPECT_NEAR(after.points()[1].foot.z() - after.points()[0].foot.z(), feet[1].z() - feet[0].z(),
              1e-12);
  EXPECT_NEAR(laid_onto({}, before).points()[5].foot.z(), feet[5].z(), 1e-12);
  DrivenLine line(feet);
  EXPECT_THROW(line.raise({0.1}), std::invalid_argument);
}

TEST(DrivenLine, KeepsToThePieceThatIsAskedFor) {
  // Out and back 3 m apart: a place between belongs to the part that is driven.
  const DrivenLine line({{0, 0, 0}, {50, 0, 0}, {50, 3, 0}, {0, 3, 0}});
  EXPECT_NEAR(line.project({10, 1, 0}, 0, 40)->s, 10.0, 1e-9);
  EXPECT_NEAR(line.project({10, 1, 0}, 60, 103)->s, 93.0, 1e-9);
}

TEST(RoadStrip, FusesWhatWindowsSeeRobustly) {
  const DrivenLine line(quarter_circle(60.0, 1.0));
  RoadStripOptions options;
  options.correlation = 1.0;
  RoadStripBuilder builder(line, options);
  const CounterRandom random(4);
  std::uint64_t draw = 0;
  // A road that falls 3 % to the left, seen by windows with errors of 2 cm, one in ten of them a
  // layer 0.4 m below.
  for (double s = 0.0; s < 90.0; s += 1.0) {
    const double wrong = random.uniform(draw++) < 0.1 ? -0.4 : 0.0;
    for (double ahead = 2.25; ahead < 12.0; ahead += 0.5) {
      for (double lateral = -3.25; lateral < 3.5; lateral += 0.5) {
        Eigen::Vector2d direction;
        const Eigen::Vector3d on = line.at(s + ahead, &direction);
        Eigen::Vector3d x = on;
        x.head<2>() += lateral * Eigen::Vector2d(-direction.y(), direction.x());
        x.z() += -0.03 * lateral + wrong + 0.02 * random.normal(draw++);
        builder.add(x, 0.02, 1, {10, 20, 30}, s);
      }
    }
  }
  double squares = 0.0, stated = 0.0;
  int cells = 0;
  for (const StripCell& cell : builder.finish()) {
    if (cell.s < 15.0 || cell.s > 80.0) continue;
    const double height = cell.point.z() - line.at(cell.s).z();
    squares += std::pow(height + 0.03 * cell.lateral, 2);
    stated += cell.sigma * cell.sigma;
    EXPECT_EQ(cell.label, 1);
    EXPECT_EQ(cell.color[2], 30);
    ++cells;
  }
  ASSERT_GT(cells, 1000);
  EXPECT_LT(std::sqrt(squares / cells), 0.015);  // 10 observations: 0.0063 by the noise alone
  EXPECT_LT(squares, 2.0 * stated);
  EXPECT_GT(squares, 0.5 * stated);
}

TEST(RoadStrip, RefusesOptionsThatCannotBe) {
  RoadStripOptions options;
  options.cell = 0.0;
  EXPECT_THROW(RoadStripBuilder(DrivenLine(), options), std::invalid_argument);
}

}  // namespace
}  // namespace camber
