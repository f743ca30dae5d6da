// Dense matching of made images that are shifted by a known amount.

#include "camber/motion/correspondences.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr int kWidth = 320, kHeight = 240;
constexpr int kMargin = 20;  // px; what the flow says of the border is left out

/// Sixty plane waves of 8 to 60 px in length: band-limited, so that any shift is exact.
GrayImage waves(const Eigen::Vector2d& shift, int width = kWidth, int height = kHeight) {
  const CounterRandom random(5);
  struct Wave {
    double x, y, phase;
  };
  std::vector<Wave> all;
  for (std::uint64_t k = 0; k < 60; ++k) {
    const double length = 8.0 * std::pow(7.5, random.uniform(3 * k));
    const double angle = random.uniform(3 * k + 1, 0.0, 2 * M_PI);
    all.push_back({2 * M_PI / length * std::cos(angle), 2 * M_PI / length * std::sin(angle),
                   random.uniform(3 * k + 2, 0.0, 2 * M_PI)});
  }
  GrayImage image;
  image.width = width;
  image.height = height;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      double sum = 0.0;
      for (const Wave& w : all) {
        sum += std::cos(w.x * (x - shift.x()) + w.y * (y - shift.y()) + w.phase);
      }
      image.pixels.push_back(
          static_cast<std::uint8_t>(std::clamp(128.0 + 12.0 * sum, 0.0, 255.0) + 0.5));
    }
  }
  return image;
}

bool inside(const Eigen::Vector2f& p) {
  return p.x() >= kMargin && p.y() >= kMargin && p.x() < kWidth - kMargin &&
         p.y() < kHeight - kMargin;
}

/// Median distance of the valid matches from the true shift.
double median_error(const Correspondences& found, std::size_t image, const Eigen::Vector2d& shift,
                    std::size_t at_least) {
  std::vector<double> errors;
  const MatchedImage& match = found.matches[image];
  for (std::size_t i = 0; i < found.pixels.size(); ++i) {
    if (!std::isfinite(match.round_trip_px[i]) || !inside(found.pixels[i])) continue;
    errors.push_back(((match.pixels[i] - found.pixels[i]).cast<double>() - shift).norm());
  }
  EXPECT_GT(errors.size(), at_least);
  if (errors.empty()) return std::numeric_limits<double>::infinity();
  std::nth_element(errors.begin(), errors.begin() + static_cast<long>(errors.size() / 2),
                   errors.end());
  return errors[errors.size() / 2];
}

const Eigen::Vector2d kFirst(3.3, -1.6), kSecond(-2.7, 0.4);

TEST(MatchImages, FindsAKnownShift) {
  const Correspondences found = match_images({waves(kFirst), waves({0, 0}), waves(kSecond)}, 1, {});
  EXPECT_EQ(found.reference, 1);
  EXPECT_EQ(found.columns, kWidth / 2);
  EXPECT_EQ(found.rows, kHeight / 2);
  ASSERT_EQ(found.pixels.size(), static_cast<std::size_t>(found.columns * found.rows));
  EXPECT_EQ(found.pixels[static_cast<std::size_t>(found.columns + 3)], Eigen::Vector2f(6, 2));
  ASSERT_EQ(found.matches.size(), 2u);
  EXPECT_EQ(found.matches[0].frame, 0);
  EXPECT_EQ(found.matches[1].frame, 2);
  // 140 x 100 grid points lie inside; nearly all must pass the round trip.
  EXPECT_LT(median_error(found, 0, kFirst, 13000), 0.1);
  EXPECT_LT(median_error(found, 1, kSecond, 13000), 0.1);
}

TEST(MatchImages, TextureIsTheMeanOfTheGradientsProducts) {
  // A ramp of 2 grey values a pixel along x and 1 along y.
  GrayImage ramp;
  ramp.width = 64;
  ramp.height = 64;
  for (int y = 0; y < 64; ++y) {
    for (int x = 0; x < 64; ++x) ramp.pixels.push_back(static_cast<std::uint8_t>(2 * x + y));
  }
  const Correspondences found = match_images({ramp, ramp}, 0, {});
  const Eigen::Vector3f& middle = found.texture[static_cast<std::size_t>(16 * found.columns + 16)];
  EXPECT_LT((middle - Eigen::Vector3f(4, 2, 1)).norm(), 1e-4);
}

TEST(CorrespondenceGrid, IsThatOfTheMatches) {
  const GrayImage image = waves({0, 0});
  const Correspondences grid = correspondence_grid(image, 1, 2);
  const Correspondences found = match_images({waves(kFirst), image}, 1, {});
  EXPECT_EQ(grid.reference, 1);
  EXPECT_EQ(grid.step, found.step);
  EXPECT_EQ(grid.columns, found.columns);
  EXPECT_EQ(grid.rows, found.rows);
  EXPECT_EQ(grid.pixels, found.pixels);
  EXPECT_EQ(grid.texture, found.texture);
  EXPECT_TRUE(grid.matches.empty());
  EXPECT_EQ(correspondence_grid(image, 0, 3).columns, (kWidth - 1) / 3 + 1);
  EXPECT_THROW(correspondence_grid(image, 0, 0), std::invalid_argument);
  EXPECT_THROW(correspondence_grid({}, 0, 2), std::invalid_argument);
}

TEST(MatchImages, KeptFlowsGiveTheSameMatches) {
  const std::vector<GrayImage> images = {waves(kFirst), waves({0, 0}), waves(kSecond)};
  FlowCache cache;
  const Correspondences first = match_images(images, 1, {}, {&cache, {7, 8, 9}});
  EXPECT_EQ(cache.size(), 4u);
  const Correspondences again = match_images(images, 1, {}, {&cache, {7, 8, 9}});
  const Correspondences beside = match_images(images, 0, {}, {&cache, {7, 8, 9}});
  EXPECT_EQ(cache.size(), 6u);  // 7 to 9 and back
  const Correspondences anew = match_images(images, 1, {}),
                        anew_beside = match_images(images, 0, {});
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(first.matches[k].pixels, anew.matches[k].pixels);
    EXPECT_EQ(again.matches[k].round_trip_px, anew.matches[k].round_trip_px);
    EXPECT_EQ(beside.matches[k].pixels, anew_beside.matches[k].pixels);
  }
  cache.forget_before(8);
  EXPECT_EQ(cache.size(), 2u);
  EXPECT_THROW(match_images(images, 1, {}, {&cache, {7, 8}}), std::invalid_argument);
}

TEST(MatchImages, IsTheSameForAnyNumberOfThreads) {
  const std::vector<GrayImage> images = {waves(kFirst), waves({0, 0}), waves(kSecond)};
  CorrespondenceOptions one, two;
  one.num_threads = 1;
  two.num_threads = 2;
  const Correspondences a = match_images(images, 1, one);
  const Correspondences b = match_images(images, 1, two);
  EXPECT_EQ(a.texture, b.texture);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(a.matches[k].pixels, b.matches[k].pixels);
    EXPECT_EQ(a.matches[k].round_trip_px, b.matches[k].round_trip_px);
  }
}

/// Two octaves of value noise, of cells 6 and 24 px wide, from column `left` on: nothing repeats.
GrayImage speckles(int left) {
  const CounterRandom random(9);
  const auto noise = [&](int x, int y, int cell, std::uint64_t octave) {
    const int i = x / cell, j = y / cell;
    const double fx = static_cast<double>(x % cell) / cell;
    const double fy = static_cast<double>(y % cell) / cell;
    const auto at = [&](int column, int row) {
      return random.uniform(static_cast<std::uint64_t>(row) * 1000 +
                            static_cast<std::uint64_t>(column) + octave * 1000000);
    };
    return (1 - fy) * ((1 - fx) * at(i, j) + fx * at(i + 1, j)) +
           fy * ((1 - fx) * at(i, j + 1) + fx * at(i + 1, j + 1));
  };
  GrayImage image;
  image.width = kWidth;
  image.height = kHeight;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = left; x < left + kWidth; ++x) {
      image.pixels.push_back(
          static_cast<std::uint8_t>(127.0 * (noise(x, y, 6, 0) + noise(x, y, 24, 1))));
    }
  }
  return image;
}

// As in a turn: the first image and the last share a third of what they show.
TEST(MatchImages, FarImagesAreReachedThroughThoseBetween) {
  constexpr int kStep = 18, kImages = 12;
  std::vector<GrayImage> images;
  for (int k = 0; k < kImages; ++k) images.push_back(speckles(kStep * k));
  const auto right = [](const Correspondences& found, std::size_t image, double shift) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < found.pixels.size(); ++i) {
      const MatchedImage& match = found.matches[image];
      if (!std::isfinite(match.round_trip_px[i])) continue;
      count += (match.pixels[i] - found.pixels[i] - Eigen::Vector2f(shift, 0)).norm() < 0.5f;
    }
    return count;
  };
  const Correspondences alone = match_images({images.front(), images.back()}, 0, {});
  const std::size_t shared =
      alone.pixels.size() * (kWidth - kStep * (kImages - 1)) / static_cast<std::size_t>(kWidth);
  EXPECT_LT(right(alone, 0, -kStep * (kImages - 1)), shared / 10);
  for (const int reference : {0, 3, kImages - 1}) {
    const Correspondences found = match_images(images, reference, {});
    for (std::size_t k = 0; k < found.matches.size(); ++k) {
      const int apart = found.matches[k].frame - reference;
      const auto common =
          alone.pixels.size() * static_cast<std::size_t>(kWidth - kStep * std::abs(apart)) / kWidth;
      EXPECT_GT(right(found, k, -kStep * apart), common / 2) << reference << " to " << apart;
    }
  }
}

TEST(MatchImages, SizesThatDisagreeThrow) {
  EXPECT_THROW(match_images({waves({0, 0}), waves({0, 0}, kWidth, kHeight - 1)}, 0, {}),
               std::invalid_argument);
  EXPECT_THROW(match_images({GrayImage(), GrayImage()}, 0, {}), std::invalid_argument);
  EXPECT_THROW(match_images({waves({0, 0}), waves({0, 0})}, 2, {}), std::invalid_argument);
  EXPECT_THROW(match_images({waves({0, 0}), waves({0, 0})}, -1, {}), std::invalid_argument);
}

TEST(MatchImages, ImagesThatHoldNoPatchHaveNoMatches) {
  const int sizes[][2] = {{8, 6}, {40, 12}, {1, 1}, {15, 200}};
  for (const auto& [width, height] : sizes) {
    for (const bool smooth : {true, false}) {
      CorrespondenceOptions options;
      options.smooth = smooth;
      const GrayImage image = waves({0, 0}, width, height);
      const Correspondences found = match_images({image, image}, 0, options);
      ASSERT_EQ(found.matches.size(), 1u);
      if (!smooth) continue;
      for (const float px : found.matches[0].round_trip_px) EXPECT_FALSE(std::isfinite(px));
    }
  }
}

TEST(CorrespondenceOptions, ValidateNamesTheField) {
  CorrespondenceOptions options;
  EXPECT_NO_THROW(options.validate());
  options.step = 0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = {};
  options.forward_backward_px = std::nan("");
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

class RefineMatches : public ::testing::Test {
 protected:
  RefineMatches() : images_{waves({0, 0}), waves(kFirst)} {
    before_ = match_images(images_, 0, {});
    prediction_.frame = 1;
    for (int y = 0; y < kHeight; ++y) {
      for (int x = 0; x < kWidth; ++x) {
        prediction_.pixels.push_back((Eigen::Vector2d(x, y) + kFirst + kBias).cast<float>());
      }
    }
    prediction_.ignored.assign(prediction_.pixels.size(), 0);
  }
  const Eigen::Vector2d kBias{1.3, -0.8};
  std::vector<GrayImage> images_;
  Correspondences before_;
  PredictedImage prediction_;
};

TEST_F(RefineMatches, CorrectsABiasedPrediction) {
  const Correspondences found = refine_matches(images_, before_, {prediction_}, 0, {});
  EXPECT_LT(median_error(found, 0, kFirst, 13000), 0.1);
}

/// Share of the inner grid points that have a match, with a prediction off by (8, -6) px.
double found_again(const Eigen::Vector2d& shift) {
  const std::vector<GrayImage> images{waves({0, 0}), waves(shift)};
  PredictedImage prediction;
  prediction.frame = 1;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      prediction.pixels.push_back(
          (Eigen::Vector2d(x, y) + shift + Eigen::Vector2d(8.0, -6.0)).cast<float>());
    }
  }
  prediction.ignored.assign(prediction.pixels.size(), 0);
  const Correspondences found =
      refine_matches(images, match_images(images, 0, {}), {prediction}, 0, {});
  double all = 0.0, right = 0.0;
  for (std::size_t i = 0; i < found.pixels.size(); ++i) {
    const Eigen::Vector2f there = found.pixels[i] + shift.cast<float>();
    if (!inside(found.pixels[i]) || !inside(there)) continue;
    all += 1.0;
    right += std::isfinite(found.matches[0].round_trip_px[i]) &&
             (found.matches[0].pixels[i] - there).norm() < 0.3f;
  }
  return right / all;
}

// Ten pixels off are a tenth of the way of a near pixel on a fast drive, and a mistake elsewhere.
TEST_F(RefineMatches, APredictionMayBeOffByAShareOfTheWay) {
  EXPECT_GT(found_again({-70.0, 40.0}), 0.8);
  EXPECT_LT(found_again({-7.0, 4.0}), 0.05);
}

constexpr float kByWindow = 0.3f;  // px, round trip that a window's match is given

TEST_F(RefineMatches, WindowsFindTheShift) {
  prediction_.searched.assign(prediction_.pixels.size(), 1);
  const Correspondences found = refine_matches(images_, before_, {prediction_}, 0, {});
  EXPECT_LT(median_error(found, 0, kFirst, 12000), 0.2);
  std::size_t by_window = 0;
  for (const float round_trip : found.matches[0].round_trip_px)
    by_window += round_trip == kByWindow;
  EXPECT_GT(by_window, 12000u);
}

// A shadow that moves with the camera lies on ground that does not.
TEST_F(RefineMatches, WindowsInsideAMovingShadowFindTheGround) {
  for (std::size_t k = 0; k < 2; ++k) {
    for (std::uint8_t& grey : images_[k].pixels) {  // asphalt: hardly any contrast
      grey = static_cast<std::uint8_t>(std::lround(140.0 + 0.12 * (grey - 128.0)));
    }
    const int moved = k == 0 ? 0 : 20;
    for (int y = 70 - moved; y < 150 - moved; ++y) {
      for (int x = 100; x < 220; ++x) {
        std::uint8_t& grey = images_[k].pixels[static_cast<std::size_t>(y * kWidth + x)];
        grey = static_cast<std::uint8_t>(grey - 90);
      }
    }
  }
  prediction_.searched.assign(prediction_.pixels.size(), 1);
  const Correspondences found = refine_matches(images_, before_, {prediction_}, 0, {});
  int inside_shadow = 0, right = 0, by_window = 0;
  for (std::size_t i = 0; i < found.pixels.size(); ++i) {
    const Eigen::Vector2f& p = found.pixels[i];
    if (p.x() < 124 || p.x() > 196 || p.y() < 84 || p.y() > 112) continue;
    ++inside_shadow;
    if (found.matches[0].round_trip_px[i] != kByWindow) continue;
    ++by_window;
    right += ((found.matches[0].pixels[i] - p).cast<double>() - kFirst).norm() < 0.3;
  }
  EXPECT_GT(by_window, 0.8 * inside_shadow);
  EXPECT_GT(right, 0.95 * by_window);
}

TEST_F(RefineMatches, WindowsWithoutTextureKeepWhatTheFlowSays) {
  for (GrayImage& image : images_) std::fill(image.pixels.begin(), image.pixels.end(), 90);
  const Correspondences flow = refine_matches(images_, before_, {prediction_}, 0, {});
  prediction_.searched.assign(prediction_.pixels.size(), 1);
  const Correspondences found = refine_matches(images_, before_, {prediction_}, 0, {});
  EXPECT_EQ(found.matches[0].pixels, flow.matches[0].pixels);
  EXPECT_EQ(found.matches[0].round_trip_px, flow.matches[0].round_trip_px);
  prediction_.searched.resize(7);
  EXPECT_THROW(refine_matches(images_, before_, {prediction_}, 0, {}), std::invalid_argument);
}

TEST_F(RefineMatches, LeavesRowsAboveTheTopAndPixelsWithoutPrediction) {
  for (int x = 0; x < kWidth / 2; ++x) {  // the left half has no prediction
    for (int y = 0; y < kHeight; ++y) {
      prediction_.pixels[static_cast<std::size_t>(y * kWidth + x)].setConstant(
          std::numeric_limits<float>::quiet_NaN());
    }
  }
  const int top = 100;
  const Correspondences found = refine_matches(images_, before_, {prediction_}, top, {});
  long kept = 0, changed = 0;
  for (std::size_t i = 0; i < found.pixels.size(); ++i) {
    const Eigen::Vector2f& p = found.pixels[i];
    if (p.y() < top || p.x() < kWidth / 2) {
      EXPECT_EQ(found.matches[0].pixels[i], before_.matches[0].pixels[i]);
      EXPECT_EQ(found.matches[0].round_trip_px[i], before_.matches[0].round_trip_px[i]);
      ++kept;
    } else if (found.matches[0].pixels[i] != before_.matches[0].pixels[i]) {
      ++changed;
    }
  }
  EXPECT_GT(kept, 10000);
  EXPECT_GT(changed, 4000);
}

TEST_F(RefineMatches, IgnoredPixelsHaveNoMatch) {
  for (int y = 100; y < 140; ++y) {
    for (int x = 100; x < 160; ++x) {
      prediction_.ignored[static_cast<std::size_t>(y * kWidth + x)] = 1;
    }
  }
  const Correspondences found = refine_matches(images_, before_, {prediction_}, 0, {});
  long ignored = 0;
  for (std::size_t i = 0; i < found.pixels.size(); ++i) {
    const Eigen::Vector2f& p = found.pixels[i];
    if (p.x() < 100 || p.x() >= 160 || p.y() < 100 || p.y() >= 140) continue;
    EXPECT_FALSE(std::isfinite(found.matches[0].round_trip_px[i]));
    ++ignored;
  }
  EXPECT_EQ(ignored, 30 * 20);
  EXPECT_LT(median_error(found, 0, kFirst, 12000), 0.1);
}

TEST_F(RefineMatches, IsTheSameForAnyNumberOfThreads) {
  images_.push_back(waves(kFirst + kBias));
  before_ = match_images(images_, 0, {});
  PredictedImage second = prediction_;
  second.frame = 2;
  CorrespondenceOptions one, two;
  one.num_threads = 1;
  two.num_threads = 2;
  const Correspondences a = refine_matches(images_, before_, {prediction_, second}, 30, one);
  const Correspondences b = refine_matches(images_, before_, {prediction_, second}, 30, two);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(a.matches[k].pixels, b.matches[k].pixels);
    EXPECT_EQ(a.matches[k].round_trip_px, b.matches[k].round_trip_px);
  }
}

TEST_F(RefineMatches, PredictionsThatDoNotFitThrow) {
  PredictedImage bad = prediction_;
  bad.frame = 0;
  EXPECT_THROW(refine_matches(images_, before_, {bad}, 0, {}), std::invalid_argument);
  bad = prediction_;
  bad.pixels.pop_back();
  EXPECT_THROW(refine_matches(images_, before_, {bad}, 0, {}), std::invalid_argument);
  bad = prediction_;
  bad.ignored.pop_back();
  EXPECT_THROW(refine_matches(images_, before_, {bad}, 0, {}), std::invalid_argument);
  EXPECT_THROW(refine_matches(images_, before_, {}, 0, {}), std::invalid_argument);
}

}  // namespace
}  // namespace camber
