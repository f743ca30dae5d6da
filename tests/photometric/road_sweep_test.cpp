#include "camber/photometric/road_sweep.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <stdexcept>
#include <vector>

namespace camber {
namespace {

constexpr double kTravel = 0.7;  // camera heights from image to image
constexpr int kImages = 5, kReference = 2;

PinholeCamera camera() { return {640, 240, 500.0, 500.0, 320.0, 90.0}; }

/// Grain of some rms at a cell, the same wherever it is asked for.
double grain(long a, long b, double rms) {
  auto bits = static_cast<std::uint64_t>(a) * 0x9E3779B97F4A7C15U ^
              static_cast<std::uint64_t>(b) * 0xC2B2AE3D27D4EB4FU;
  bits = (bits ^ bits >> 29) * 0xBF58476D1CE4E5B9U;
  bits ^= bits >> 32;
  return rms * std::sqrt(12.0) * (static_cast<double>(bits & 0xFFFF) / 65535.0 - 0.5);
}

/// Broken lines as on motorways, at both sides of the lane.
double dashes(double ahead, double right) {
  constexpr double kPeriod = 9.0, kLong = 2.3;  // camera heights
  const double from = ahead - kPeriod * std::floor(ahead / kPeriod);
  return std::abs(std::abs(right) - 1.3) < 0.06 && from < kLong ? 110.0 : 0.0;
}

double rough(double ahead, double right) {
  return grain(std::lround(ahead * 20.0), std::lround(right * 12.0), 14.0);
}

/// What a level camera sees that drives straight ahead, over what stands still in its pictures.
std::vector<GrayImage> film(const std::function<double(double, double)>& road, double still_rms) {
  const PinholeCamera c = camera();
  std::vector<GrayImage> out;
  for (int k = 0; k < kImages; ++k) {
    GrayImage image{c.width, c.height,
                    std::vector<std::uint8_t>(static_cast<std::size_t>(c.width * c.height), 150)};
    for (int v = static_cast<int>(c.cy) + 3; v < c.height; ++v) {
      for (int u = 0; u < c.width; ++u) {
        const double ahead = c.fy / (v - c.cy), right = (u - c.cx) / c.fx * ahead;
        const double value = 80.0 + road(ahead + kTravel * k, right) + grain(u, v, still_rms);
        image.pixels[static_cast<std::size_t>(v * c.width + u)] =
            static_cast<std::uint8_t>(std::lround(std::clamp(value, 0.0, 255.0)));
      }
    }
    out.push_back(std::move(image));
  }
  return out;
}

MotionEstimate straight() {
  MotionEstimate out;
  for (int k = 0; k < kImages; ++k) {
    out.frame_from_reference.emplace_back(Eigen::Quaterniond::Identity(),
                                          Eigen::Vector3d(0.0, 0.0, -0.5 * (k - kReference)));
  }
  return out;
}

RoadSweepResult sweep(const std::vector<GrayImage>& images) {
  std::vector<const GrayImage*> pointers;
  for (const GrayImage& image : images) pointers.push_back(&image);
  return sweep_road(camera(), pointers, straight(), kReference, {});
}

const double kTrue = std::log(kTravel / 0.5);

TEST(RoadSweep, DashesThatPassOverAsphaltThatStandsStillFixTheBaseline) {
  const RoadSweepResult found = sweep(film(dashes, 6.0));
  EXPECT_TRUE(found.informative);
  EXPECT_NEAR(found.log_baseline, kTrue, 0.03);
}

TEST(RoadSweep, SoDoesTheTextureOfARoadThatIsSeen) {
  const RoadSweepResult found = sweep(film(rough, 0.0));
  EXPECT_TRUE(found.informative);
  EXPECT_NEAR(found.log_baseline, kTrue, 0.03);
}

TEST(RoadSweep, WhereNothingPassesItIsNotInformative) {
  const auto lines = [](double, double right) { return std::abs(right) < 0.1 ? 90.0 : 0.0; };
  EXPECT_FALSE(sweep(film(lines, 6.0)).informative);
}

TEST(RoadSweep, ThreeImagesAreTooFew) {
  const std::vector<GrayImage> images = film(dashes, 6.0);
  MotionEstimate motion;
  for (int k = 1; k < 4; ++k) {
    motion.frame_from_reference.push_back(
        straight().frame_from_reference[static_cast<std::size_t>(k)]);
  }
  EXPECT_FALSE(
      sweep_road(camera(), {&images[1], &images[2], &images[3]}, motion, 1, {}).informative);
}

TEST(RoadSweep, TheSameForAnyNumberOfThreads) {
  const std::vector<GrayImage> images = film(dashes, 6.0);
  std::vector<const GrayImage*> pointers;
  for (const GrayImage& image : images) pointers.push_back(&image);
  RoadSweepOptions one, three;
  one.num_threads = 1;
  three.num_threads = 3;
  const RoadSweepResult a = sweep_road(camera(), pointers, straight(), kReference, one);
  const RoadSweepResult b = sweep_road(camera(), pointers, straight(), kReference, three);
  EXPECT_EQ(a.log_baseline, b.log_baseline);
  EXPECT_EQ(a.correlation, b.correlation);
}

TEST(RoadSweep, SizesThatDisagreeAreRefused) {
  const std::vector<GrayImage> images = film(dashes, 6.0);
  EXPECT_THROW(sweep_road(camera(), {&images[0], &images[1]}, straight(), 0, {}),
               std::invalid_argument);
  const GrayImage small{4, 4, std::vector<std::uint8_t>(16)};
  EXPECT_THROW(
      sweep_road(camera(), {&images[0], &small, &small, &small, &small}, straight(), 0, {}),
      std::invalid_argument);
}

}  // namespace
}  // namespace camber
