// Strokes of paint in drawn images: where they are, without any ground.

#include "camber/scale/painted_strokes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "support/drawn_markings.h"

namespace camber {
namespace {

const PinholeCamera kCamera{800, 300, 600.0, 600.0, 400.0, 110.0};
const Plane kRoad{{0.0, -1.0, 0.0}, 1.5};

std::vector<std::uint8_t> all_visible() {
  return std::vector<std::uint8_t>(static_cast<std::size_t>(kCamera.width * kCamera.height), 1);
}

std::vector<PaintedStroke> find(const test::Paint& paint, int threads = 1) {
  return detect_painted_strokes(test::draw_markings(kCamera, kRoad, paint, 3.0, 1), all_visible(),
                                115, threads);
}

TEST(PaintedStrokes, EndsAndWidthsAreThoseOfThePaint) {
  const std::vector<PaintedStroke> found =
      find([](double x, double z) { return test::dashed(x, z, -1.0, 7.0); });
  // At 7, 16 and 25 m.
  ASSERT_GE(found.size(), 3U);
  for (std::size_t k = 0; k < 3; ++k) {
    const double near = 7.0 + 9.0 * static_cast<double>(k);
    const PaintedStroke& s = found[k];
    EXPECT_TRUE(s.near_seen && s.far_seen);
    // Half of the contrast, to a third of a row with this noise.
    EXPECT_NEAR(s.near_end.y(), test::pixel_on_plane(kCamera, kRoad, {-1.0, near}).y(), 0.35);
    EXPECT_NEAR(s.far_end.y(), test::pixel_on_plane(kCamera, kRoad, {-1.0, near + 3.0}).y(), 0.35);
    const double row = 0.5 * (s.near_end.y() + s.far_end.y());
    const StrokeRow edges = s.at(row);
    const double width = 0.12 * (row - kCamera.cy) / kRoad.offset;  // px, of a level road
    if (width > 3.5) {  // thinner ones are found too wide
      EXPECT_NEAR(edges.right - edges.left, width, 0.25) << near;
    }
  }
}

TEST(PaintedStrokes, AnEndThatTheImageOrAVehicleCutsIsNotSeen) {
  const test::Paint line = [](double x, double) { return std::abs(x - 0.3) < 0.06; };
  const std::vector<PaintedStroke> whole = find(line);
  ASSERT_FALSE(whole.empty());
  EXPECT_FALSE(whole[0].near_seen);
  std::vector<std::uint8_t> visible = all_visible();
  for (int v = 200; v < 240; ++v) {
    std::fill_n(visible.begin() + v * kCamera.width, kCamera.width, std::uint8_t{0});
  }
  const std::vector<PaintedStroke> cut =
      detect_painted_strokes(test::draw_markings(kCamera, kRoad, line, 3.0, 1), visible, 115, 1);
  ASSERT_GE(cut.size(), 2U);
  for (const PaintedStroke& s : cut) {
    EXPECT_FALSE(s.near_end.y() < 236 && s.near_end.y() > 204);
    EXPECT_FALSE(s.near_end.y() > 240 && s.far_seen);
    EXPECT_FALSE(s.near_end.y() < 205 && s.near_seen);
  }
}

TEST(PaintedStrokes, BareRoadHasNoLongOnes) {
  for (const PaintedStroke& s : find([](double, double) { return false; })) {
    EXPECT_LT(s.rows.size(), 8U) << "noise alone";
  }
}

TEST(PaintedStrokes, TheSameForAnyNumberOfThreads) {
  const test::Paint paint = [](double x, double z) { return test::dashed(x, z, 1.0, 6.0); };
  const std::vector<PaintedStroke> one = find(paint, 1), four = find(paint, 4);
  ASSERT_EQ(one.size(), four.size());
  for (std::size_t k = 0; k < one.size(); ++k) {
    EXPECT_EQ(one[k].near_end, four[k].near_end);
    EXPECT_EQ(one[k].left_fit, four[k].left_fit);
  }
}

TEST(PaintedStrokes, SizesThatDisagreeAreACallersMistake) {
  const GrayImage image = test::draw_markings(
      kCamera, kRoad, [](double, double) { return false; }, 0.0, 1);
  EXPECT_THROW(detect_painted_strokes(image, {1, 1}, 0), std::invalid_argument);
}

}  // namespace
}  // namespace camber
