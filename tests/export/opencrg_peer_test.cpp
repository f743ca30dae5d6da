// Against ASAM's C reader 1.2 and its 17 sample files, where they are present.

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <regex>

#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "camber/export/opencrg.h"
#include "peer_crg.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using test::CrgPlace;

std::vector<fs::path> samples() {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(test::crg_samples())) {
    if (entry.path().extension() == ".crg") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Random places on the grid of a road and `margin` times its size beyond, every other one by x and
/// y; the latter not beyond the inner side of a curve's centre, where u and v have no sense.
std::vector<CrgPlace> random_places(const CrgRoad& road, std::size_t count, double margin,
                                    std::uint64_t seed) {
  const CounterRandom random(seed);
  const double length = road.last_u() - road.first_u(), width = road.left() - road.right();
  std::vector<CrgPlace> places;
  for (std::size_t i = 0; i < count; ++i) {
    const double u = road.first_u() + length * random.uniform(2 * i, -margin, 1.0 + margin);
    const double v = road.right() + width * random.uniform(2 * i + 1, -margin, 1.0 + margin);
    if (i % 2 == 0) {
      places.push_back({false, u, v});
    } else {
      const Eigen::Vector2d xy = road.position(u, v);
      places.push_back({true, xy.x(), xy.y()});
    }
  }
  return places;
}

/// The greatest difference to the peer, over places where both give a height; they agree on where.
double compare(const fs::path& file, const std::vector<CrgPlace>& places, const CrgRoad& road,
               bool apply) {
  const std::vector<double> theirs = test::crg_peer_heights(file, places, apply);
  EXPECT_EQ(theirs.size(), places.size()) << file;
  double worst = 0.0;
  std::size_t heights = 0;
  for (std::size_t i = 0; i < theirs.size(); ++i) {
    const CrgPlace& place = places[i];
    const double ours =
        place.by_xy ? road.height_at(place.a, place.b) : road.height(place.a, place.b);
    EXPECT_EQ(std::isnan(ours), std::isnan(theirs[i]))
        << file << " " << (place.by_xy ? "xy " : "uv ") << place.a << " " << place.b << ": " << ours
        << " against " << theirs[i];
    if (std::isnan(ours) || std::isnan(theirs[i])) continue;
    ++heights;
    EXPECT_NEAR(ours, theirs[i], 1e-6)
        << file << " " << (place.by_xy ? "xy " : "uv ") << place.a << " " << place.b;
    worst = std::max(worst, std::abs(ours - theirs[i]));
  }
  EXPECT_GT(heights, 0u) << file;
  return worst;
}

/// The sample with further blocks before its definition.
fs::path with_blocks(const fs::path& sample, const std::string& blocks, const fs::path& folder) {
  std::string text = test::read_text(sample);
  // Its own block of that kind goes.
  text = std::regex_replace(text, std::regex("\\$ROAD_CRG_(OPTS|MODS)[^$]*\\$!\\*+\r?\n"), "");
  const std::size_t at = text.find("$KD_D");
  EXPECT_NE(at, std::string::npos) << sample;
  text.insert(at, blocks + "$!**********\n");
  const fs::path file = folder / sample.filename();
  std::ofstream(file, std::ios::binary) << text;
  return file;
}

TEST(OpenCrgPeer, SamplesGiveTheHeightsOfTheirReader) {
  CAMBER_REQUIRE_CRG_PEER();
  const test::TemporaryFolder folder;
  std::size_t accepted = 0;
  double worst = 0.0;
  for (const fs::path& file : samples()) {
    if (file.filename() == "testOptionBorderMode.crg") continue;
    const CrgData data = read_crg(file);
    for (const double margin : {0.0, 0.5}) {
      const CrgRoad stored(data, false), road(data);
      const std::vector<CrgPlace> places = random_places(stored, 1000, margin, accepted);
      worst = std::max(worst, compare(file, places, stored, false));
      // Without modifiers in a file theirs also moves the road to the origin, so that it is told
      // what is left of them here.
      fs::path theirs = file;
      if (!data.modifiers) {
        if (data.files.size() > 1) continue;
        theirs = with_blocks(file, "$ROAD_CRG_MODS\nGRID_NAN_MODE = 2\n", folder.path());
      }
      worst = std::max(worst, compare(theirs, places, road, true));
    }
    ++accepted;
  }
  EXPECT_EQ(accepted, 16u);
  RecordProperty("worst_m", fmt::format("{:.3g}", worst));
}

TEST(OpenCrgPeer, TheSampleWithoutItsFileIsRefusedByThatName) {
  CAMBER_REQUIRE_CRG_PEER();
  try {
    read_crg(test::crg_samples() / "testOptionBorderMode.crg");
    FAIL() << "read without the file that it names";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), ::testing::HasSubstr("handmade_sloped_opt.crg"));
  }
}

TEST(OpenCrgPeer, BorderModesAndSmoothing) {
  CAMBER_REQUIRE_CRG_PEER();
  const test::TemporaryFolder folder;
  std::uint64_t seed = 0;
  for (const char* const name :
       {"handmade_curved_banked_sloped.crg", "handmade_straight.crg", "handmade_circle.crg"}) {
    for (int u = 0; u <= 4; ++u) {
      for (int v = 0; v <= 4; ++v) {
        for (const char* const smooth :
             {"", "BORDER_SMOOTH_UBEG = 2.5\nBORDER_SMOOTH_UEND = 3.5\n"}) {
          const std::string options =
              "$ROAD_CRG_OPTS\nBORDER_MODE_U = " + std::to_string(u) +
              "\nBORDER_OFFSET_U = 0.25\nBORDER_MODE_V = " + std::to_string(v) +
              "\nBORDER_OFFSET_V = -0.125\n" + smooth;
          const fs::path file = with_blocks(test::crg_samples() / name, options, folder.path());
          const CrgRoad road(read_crg(file));
          std::vector<CrgPlace> places = random_places(road, 200, 1.7, seed++);
          // By x and y only where there is one answer: on a closed track the way to u is open.
          if (road.closed()) {
            for (CrgPlace& place : places) place.by_xy = false;
          }
          compare(file, places, road, true);
        }
      }
    }
  }
}

TEST(OpenCrgPeer, Modifiers) {
  CAMBER_REQUIRE_CRG_PEER();
  const test::TemporaryFolder folder;
  std::uint64_t seed = 100;
  for (const char* const name :
       {"handmade_curved_banked_sloped.crg", "handmade_platform.crg", "handmade_arc.crg"}) {
    for (const char* const modifiers :
         {"", "GRID_NAN_MODE = 0\n", "GRID_NAN_MODE = 1\n", "GRID_NAN_MODE = 2\n",
          "SCALE_Z_GRID = 1.5\nSCALE_SLOPE = 0.5\nSCALE_BANKING = -2\n",
          "SCALE_LENGTH = 1.25\nSCALE_WIDTH = 2\nSCALE_CURVATURE = 0.5\n",
          "REFPOINT_U_FRACTION = 0.5\nREFPOINT_V = 0.5\nREFPOINT_X = 100\nREFPOINT_Y = -50\n"
          "REFPOINT_Z = 7\nREFPOINT_PHI = 0.3\n",
          "REFLINE_OFFSET_X = 10\nREFLINE_OFFSET_Y = 20\nREFLINE_OFFSET_Z = 3\n"
          "REFLINE_OFFSET_PHI = 1\nREFLINE_ROTCENTER_X = 5\n"}) {
      const fs::path file = with_blocks(test::crg_samples() / name,
                                        std::string("$ROAD_CRG_MODS\n") + modifiers, folder.path());
      const CrgRoad road(read_crg(file));
      SCOPED_TRACE(modifiers);
      compare(file, random_places(road, 400, 0.3, seed++), road, true);
    }
  }
}

TEST(OpenCrgPeer, ClosedTrackComesRoundAgain) {
  CAMBER_REQUIRE_CRG_PEER();
  const test::TemporaryFolder folder;
  const fs::path file = with_blocks(test::crg_samples() / "handmade_circle.crg",
                                    "$ROAD_CRG_OPTS\nREFLINE_CONTINUATION = 1\n", folder.path());
  const CrgRoad road(read_crg(file));
  ASSERT_TRUE(road.closed());
  std::vector<CrgPlace> places = random_places(road, 400, 1.5, 5);
  for (CrgPlace& place : places) place.by_xy = false;
  compare(file, places, road, true);
}

}  // namespace
}  // namespace camber
