// Painted markings in drawn images of a level road: where they are, and what is none.

#include "camber/scale/lane_marking_detection.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/scale/focal_length_by_dashes.h"

namespace camber {
namespace {

constexpr double kHeight = 1.65;  // m
const PinholeCamera kCamera{1242, 375, 720.0, 720.0, 610.0, 172.0};
const LaneMarkingSizes kSizes{3.0, 6.0, 0.12, 0.5, 0.5};
const Eigen::Vector3d kAhead(0, 0, 1);

/// Share of paint at a place of the road: x to the right, z ahead, m.
using Paint = std::function<bool(double, double)>;

double row_of(double z) { return kCamera.cy + kCamera.fy * kHeight / z; }
double column_of(double x, double z) { return kCamera.cx + kCamera.fx * x / z; }

/// Strokes of 3 m every 9 m, the first from `start` on, on a line at x = `offset`.
bool dashed(double x, double z, double offset, double start) {
  const double along = z - start;
  return std::abs(x - offset) < 0.06 && along > 0 && std::fmod(along, 9.0) < 3.0;
}

GrayImage draw(const Paint& paint, double noise = 3.0, std::uint64_t seed = 1) {
  GrayImage out{kCamera.width, kCamera.height, {}};
  out.pixels.assign(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height),
                    180);
  CounterRandom random(seed, 0);
  constexpr int kParts = 6;
  std::uint64_t counter = 0;
  for (int v = 175; v < out.height; ++v) {
    for (int u = 0; u < out.width; ++u) {
      double painted = 0.0;
      for (int a = 0; a < kParts; ++a) {
        const double z = kCamera.fy * kHeight / (v - 0.5 + (a + 0.5) / kParts - kCamera.cy);
        if (!(z > 0) || z > 120.0) continue;
        for (int b = 0; b < kParts; ++b) {
          const double x = (u - 0.5 + (b + 0.5) / kParts - kCamera.cx) / kCamera.fx * z;
          painted += paint(x, z) ? 1.0 / (kParts * kParts) : 0.0;
        }
      }
      const double grey = 90.0 + 100.0 * painted + noise * random.normal(counter++);
      out.pixels[static_cast<std::size_t>(v) * static_cast<std::size_t>(out.width) +
                 static_cast<std::size_t>(u)] =
          static_cast<std::uint8_t>(std::lround(std::clamp(grey, 0.0, 255.0)));
    }
  }
  return out;
}

GroundRaster level_ground(double scale = 1.0) {
  GroundRaster out;
  out.top = 176;
  for (int v = out.top; v < kCamera.height; ++v) {
    for (int u = 0; u < kCamera.width; ++u) {
      out.inverse_depth.push_back(
          static_cast<float>((v - kCamera.cy) / (kCamera.fy * kHeight * scale)));
      out.visible.push_back(1);
    }
  }
  return out;
}

LaneMarkings find(const GrayImage& image, const GroundRaster& ground, double scale_sigma = 0.01) {
  return detect_lane_markings(image, kCamera, ground, kAhead, kSizes, scale_sigma, 1);
}

TEST(LaneMarkings, StrokesOfABrokenLineAreFoundWhereTheyAre) {
  const double offset = -1.2;
  const GrayImage image = draw([&](double x, double z) { return dashed(x, z, offset, 7.0); });
  const LaneMarkings found = find(image, level_ground());
  // At 7, 16, 25 and 34 m; beyond that a stroke has less than four rows.
  ASSERT_GE(found.dashes.size(), 4U);
  for (std::size_t k = 0; k < 4; ++k) {
    const double near = 7.0 + 9.0 * static_cast<double>(k), far = near + 3.0;
    const PaintedDash& dash = found.dashes[k];
    const double middle = 0.5 * (row_of(near) + row_of(far));
    EXPECT_NEAR(dash.centroid.y(), middle, 0.3) << near;
    EXPECT_LT(std::abs(dash.centroid.y() - middle), 4.0 * dash.sigma) << near;
    EXPECT_NEAR(dash.near_end.y(), row_of(near), 0.6) << near;
    EXPECT_NEAR(dash.far_end.y(), row_of(far), 0.6) << near;
    const double depth = kCamera.fy * kHeight / (dash.centroid.y() - kCamera.cy);
    EXPECT_NEAR(dash.centroid.x(), column_of(offset, depth), 0.5) << near;
  }
  EXPECT_TRUE(found.crossings.empty());
}

TEST(LaneMarkings, ALineWithoutGapsAndOneOfOtherStrokesAreNone) {
  const GrayImage whole = draw([](double x, double) { return std::abs(x - 1.0) < 0.06; });
  EXPECT_TRUE(find(whole, level_ground()).dashes.empty());
  const GrayImage longer = draw([](double x, double z) {
    return std::abs(x - 1.0) < 0.06 && std::fmod(z, 12.0) > 6.0 && z < 30.0;
  });
  EXPECT_TRUE(find(longer, level_ground()).dashes.empty());
  const GrayImage wider =
      draw([](double x, double z) { return std::abs(x - 1.0) < 0.6 && std::fmod(z, 9.0) > 6.0; });
  EXPECT_TRUE(find(wider, level_ground()).dashes.empty());
}

TEST(LaneMarkings, BareRoadHasNoneButAShortBarByChance) {
  std::size_t bars = 0;
  for (const std::uint64_t seed : {1, 2, 3}) {
    const LaneMarkings found =
        find(draw([](double, double) { return false; }, 5.0, seed), level_ground());
    for (const PaintedDash& dash : found.dashes) EXPECT_LT(dash.rows, 4);
    bars += found.dashes.size();
    EXPECT_TRUE(found.crossings.empty());
  }
  EXPECT_LE(bars, 2U);  // a line needs more: MarkingStatements
}

TEST(LaneMarkings, AStrokeCutByAVehicleIsLeftOut) {
  const GrayImage image = draw([](double x, double z) { return dashed(x, z, 0.5, 7.0); });
  const std::size_t all = find(image, level_ground()).dashes.size();
  GroundRaster ground = level_ground();
  // Hides the far half of the stroke from 16 to 19 m.
  const int from = static_cast<int>(row_of(17.5));
  for (int v = from - 8; v < from; ++v) {
    for (int u = 0; u < kCamera.width; ++u) {
      ground.visible[static_cast<std::size_t>(v - ground.top) *
                         static_cast<std::size_t>(kCamera.width) +
                     static_cast<std::size_t>(u)] = 0;
    }
  }
  const LaneMarkings found = find(image, ground);
  EXPECT_EQ(found.dashes.size(), all - 1);
  for (const PaintedDash& dash : found.dashes) {
    EXPECT_FALSE(dash.centroid.y() < row_of(15.9) && dash.centroid.y() > row_of(19.1));
  }
}

TEST(LaneMarkings, StripesOfACrossingAreCountedAndMeasured) {
  // Nine stripes from x = -4.5 to 4.5, at 14 to 18 m.
  const GrayImage image = draw([](double x, double z) {
    return z > 14.0 && z < 18.0 && std::abs(x) < 4.5 && std::fmod(x + 4.5, 1.0) < 0.5;
  });
  const LaneMarkings found = find(image, level_ground());
  ASSERT_EQ(found.crossings.size(), 1U);
  const PaintedCrossing& c = found.crossings[0];
  EXPECT_EQ(c.stripes, 9);
  const double depth = kCamera.fy * kHeight / (c.first.y() - kCamera.cy);
  EXPECT_GT(depth, 14.0);
  EXPECT_LT(depth, 18.0);
  EXPECT_NEAR(c.first.x(), column_of(-4.25, depth), 0.35);
  EXPECT_NEAR(c.last.x(), column_of(3.75, depth), 0.35);
  // The other pixel of the first stripe: nearer, on the same line.
  const double other = kCamera.fy * kHeight / (c.along.y() - kCamera.cy);
  EXPECT_NEAR(c.along.x(), column_of(-4.25, other), 1.0);
}

TEST(LaneMarkings, AHiddenStripeIsCountedAllTheSame) {
  const GrayImage image = draw([](double x, double z) {
    return z > 12.0 && z < 16.0 && std::abs(x) < 3.5 && std::fmod(x + 3.5, 1.0) < 0.5 &&
           !(x > 0.5 && x < 1.0);
  });
  const LaneMarkings found = find(image, level_ground());
  ASSERT_EQ(found.crossings.size(), 1U);
  EXPECT_EQ(found.crossings[0].stripes, 7);
}

TEST(LaneMarkings, AWrongScaleHidesThemUnlessItIsSaid) {
  const GrayImage image = draw([](double x, double z) { return dashed(x, z, 0.5, 7.0); });
  EXPECT_TRUE(find(image, level_ground(2.2), 0.01).dashes.empty());
  EXPECT_GE(find(image, level_ground(1.3), 0.2).dashes.size(), 2U);
}

TEST(LaneMarkings, TheSameForAnyNumberOfThreads) {
  const GrayImage image = draw([](double x, double z) { return dashed(x, z, 0.5, 7.0); });
  const LaneMarkings one = find(image, level_ground());
  const LaneMarkings four =
      detect_lane_markings(image, kCamera, level_ground(), kAhead, kSizes, 0.01, 4);
  ASSERT_EQ(one.dashes.size(), four.dashes.size());
  for (std::size_t k = 0; k < one.dashes.size(); ++k) {
    EXPECT_EQ(one.dashes[k].centroid, four.dashes[k].centroid);
  }
}

TEST(LaneMarkings, SizesThatDisagreeAreRefused) {
  GrayImage small{10, 10, std::vector<std::uint8_t>(100)};
  EXPECT_THROW(find(small, level_ground()), std::invalid_argument);
  GroundRaster cut = level_ground();
  cut.visible.pop_back();
  EXPECT_THROW(find(draw([](double, double) { return false; }), cut), std::invalid_argument);
}

TEST(LaneMarkings, AbsurdSizesFindNothing) {
  const GrayImage image = draw([](double x, double z) {
    return dashed(x, z, 0.5, 7.0) || (z > 14.0 && z < 18.0 && std::fmod(x + 50.0, 1.0) < 0.5);
  });
  for (const double size : {1e-300, 1e300}) {
    const LaneMarkings found = detect_lane_markings(image, kCamera, level_ground(), kAhead,
                                                    {size, size, size, size, size}, 0.01, 1);
    EXPECT_TRUE(found.dashes.empty());
    EXPECT_TRUE(found.crossings.empty());
    const LaneMarkings mixed = detect_lane_markings(image, kCamera, level_ground(), kAhead,
                                                    {3.0, size, 0.12, 0.5, size}, 0.01, 1);
    EXPECT_TRUE(mixed.crossings.empty());
  }
}

TEST(LaneMarkings, SizesThatAreNotKnownAreNotLookedFor) {
  const GrayImage image = draw([](double x, double z) { return dashed(x, z, 0.5, 7.0); });
  const LaneMarkings found =
      detect_lane_markings(image, kCamera, level_ground(), kAhead, LaneMarkingSizes{}, 0.01, 1);
  EXPECT_TRUE(found.dashes.empty());
}

/// With the true ground stretched along the view, as a camera with a wrong focal length sees it.
DashFocalLength find_focal_length(const GrayImage& image, double wrong_by, int num_threads = 1,
                                  const LaneMarkingSizes& sizes = kSizes) {
  PinholeCamera camera = kCamera;
  camera.fx *= wrong_by;
  camera.fy *= wrong_by;
  return focal_length_by_dashes(image, camera, level_ground(wrong_by), kAhead, sizes, 0.012,
                                num_threads);
}

TEST(DashFocalLength, BrokenLinesGiveOneThatIsFarOff) {
  const GrayImage image = draw([](double x, double z) { return dashed(x, z, -1.2, 7.0); });
  for (const double wrong_by : {0.52, 0.7, 1.4, 1.6, 2.0}) {
    const DashFocalLength found = find_focal_length(image, wrong_by);
    EXPECT_GE(found.strokes, 2) << wrong_by;
    EXPECT_NEAR(found.factor * wrong_by, 1.0, 0.1) << wrong_by;
    const DashFocalLength again = find_focal_length(image, wrong_by, 4);
    EXPECT_EQ(found.strokes, again.strokes);
    EXPECT_EQ(found.factor, again.factor);
  }
}

TEST(DashFocalLength, AStrokeBetweenTwoMayBeHidden) {
  // Of those from 7 m on the second, and all from the fourth on.
  const GrayImage image = draw([](double x, double z) {
    return dashed(x, z, -1.2, 7.0) && (z < 12.0 || z > 24.0) && z < 30.0;
  });
  for (const double wrong_by : {0.52, 2.0}) {
    const DashFocalLength found = find_focal_length(image, wrong_by);
    EXPECT_EQ(found.strokes, 2) << wrong_by;
    EXPECT_NEAR(found.factor * wrong_by, 1.0, 0.1) << wrong_by;
  }
  EXPECT_EQ(find_focal_length(image, 1.0).strokes, 0);
}

TEST(DashFocalLength, NothingSpeaksAgainstTheTrueOne) {
  EXPECT_EQ(find_focal_length(draw([](double x, double z) { return dashed(x, z, -1.2, 7.0); }), 1.0)
                .strokes,
            0);
  const GrayImage continuous = draw([](double x, double) { return std::abs(x - 1.0) < 0.06; });
  const GrayImage bare = draw([](double, double) { return false; }, 5.0, 2);
  for (const double wrong_by : {0.7, 1.0, 2.0}) {
    EXPECT_EQ(find_focal_length(continuous, wrong_by).strokes, 0) << wrong_by;
    EXPECT_EQ(find_focal_length(bare, wrong_by).strokes, 0) << wrong_by;
  }
}

TEST(DashFocalLength, StrokesOfUnlikeLengthsProveNothing) {
  // Their distance is the period with 0.71 times the focal length, their lengths are it in the
  // mean.
  const GrayImage image = draw([](double x, double z) {
    return std::abs(x + 1.2) < 0.06 && ((z > 8.0 && z < 11.39) || (z > 19.78 && z < 25.08));
  });
  EXPECT_EQ(find_focal_length(image, 1.0).strokes, 0);
  const GrayImage alike = draw([](double x, double z) {
    return std::abs(x + 1.2) < 0.06 && ((z > 7.58 && z < 11.82) || (z > 20.31 && z < 24.55));
  });
  EXPECT_EQ(find_focal_length(alike, 1.0).strokes, 2);
}

TEST(DashFocalLength, OneLongStrokeNearTheCameraGivesOneThatIsTwiceOrHalfAsLong) {
  const auto stroke = [](double from, double length) {
    return draw([=](double x, double z) {
      return std::abs(x + 1.2) < 0.06 && z > from && z < from + length;
    });
  };
  const GrayImage one = stroke(8.0, 3.0);
  for (const double wrong_by : {0.5, 2.0}) {
    const DashFocalLength found = find_focal_length(one, wrong_by);
    EXPECT_EQ(found.strokes, 1) << wrong_by;
    EXPECT_NEAR(found.factor * wrong_by, 1.0, 0.05) << wrong_by;
  }
  EXPECT_EQ(find_focal_length(one, 1.0).strokes, 0);
  // By itself a stroke of twice the length is the same; those of 0.7 to 1.75 times it are none.
  EXPECT_EQ(find_focal_length(stroke(8.0, 6.0), 1.0).strokes, 1);
  for (const double length : {2.2, 4.2, 5.25}) {
    EXPECT_EQ(find_focal_length(stroke(8.0, length), 1.0).strokes, 0) << length;
  }
  // 13 rows of the image.
  EXPECT_EQ(find_focal_length(stroke(15.0, 3.0), 2.0).strokes, 0);
  // 40 and 24 rows of the image.
  const LaneMarkingSizes longer{30.0, 30.0, 0.12, 0.5, 0.5};
  EXPECT_EQ(find_focal_length(stroke(15.0, 30.0), 2.0, 1, longer).strokes, 1);
  EXPECT_EQ(find_focal_length(stroke(26.0, 30.0), 2.0, 1, longer).strokes, 0);
}

TEST(DashFocalLength, OneLongStrokeGivesNoneBesideOneThatFits) {
  const auto strokes = [](double other) {
    return draw([=](double x, double z) {
      return (std::abs(x + 1.2) < 0.06 && z > 8.0 && z < 14.0) ||
             (std::abs(x - 1.2) < 0.06 && z > 9.0 && z < 9.0 + other);
    });
  };
  EXPECT_EQ(find_focal_length(strokes(0.0), 1.0).strokes, 1);
  EXPECT_EQ(find_focal_length(strokes(3.0), 1.0).strokes, 0);
  // The other has the known length with twice the focal length.
  EXPECT_EQ(find_focal_length(strokes(1.5), 1.0).strokes, 0);
}

}  // namespace
}  // namespace camber
