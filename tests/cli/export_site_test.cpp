// camber export CLOUD --to geotiff: the raster of a whole cloud, read back by GDAL.

#include <gdal.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/core/random.h"
#include "run_program.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::run_camber;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr float kNoData = -9999.0f;

/// Height of the made ground, m.
double ground_at(double x, double y) {
  return 100.0 + 0.3 * x + 0.8 * std::sin(x / 9.0) + 0.5 * std::cos(y / 7.0);
}

struct Raster {
  explicit Raster(const fs::path& path) {
    GDALAllRegister();
    const GDALDatasetH file = GDALOpen(path.c_str(), GA_ReadOnly);
    if (file == nullptr) return;
    columns = GDALGetRasterXSize(file);
    rows = GDALGetRasterYSize(file);
    GDALGetGeoTransform(file, corners);
    system = GDALGetProjectionRef(file);
    if (const char* kept = GDALGetMetadataItem(file, "LAYOUT", "IMAGE_STRUCTURE")) layout = kept;
    for (int b = 1; b <= GDALGetRasterCount(file); ++b) {
      const GDALRasterBandH band = GDALGetRasterBand(file, b);
      std::vector<float> values(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
      EXPECT_EQ(GDALRasterIO(band, GF_Read, 0, 0, columns, rows, values.data(), columns, rows,
                             GDT_Float32, 0, 0),
                CE_None);
      names.emplace_back(GDALGetDescription(band));
      units.emplace_back(GDALGetRasterUnitType(band));
      overviews = GDALGetOverviewCount(band);
      bands.push_back(std::move(values));
    }
    GDALClose(file);
  }
  std::size_t index(double x, double y) const {
    const int column = static_cast<int>((x - corners[0]) / corners[1]),
              row = static_cast<int>((y - corners[3]) / corners[5]);
    return static_cast<std::size_t>(row * columns + column);
  }

  int columns = 0, rows = 0, overviews = 0;
  double corners[6] = {};
  std::string system, layout;
  std::vector<std::string> names, units;
  std::vector<std::vector<float>> bands;
};

/// 60 m x 40 m of ground with 2 cm of noise around a house of 10 m x 8 m; classes, if wanted, 2 and
/// 6. Coordinates in units of `unit` m.
class Site : public ::testing::Test {
 protected:
  std::string make(const std::string& name, bool classes, double unit = 1.0) const {
    const std::string text = (folder_.path() / "made.csv").string();
    {
      std::ofstream out(text);
      out.precision(12);
      out << (classes ? "x,y,z,classification\n" : "x,y,z\n");
      const CounterRandom random(4);
      for (std::uint64_t i = 0; i < 24000; ++i) {
        const double x = random.uniform(3 * i, 0.0, 60.0), y = random.uniform(3 * i + 1, 0.0, 40.0);
        const bool house = x > 20.0 && x < 30.0 && y > 15.0 && y < 23.0;
        const double z = house ? 112.0 : ground_at(x, y) + 0.02 * random.normal(i);
        out << (456000.0 + x) / unit << "," << (5428000.0 + y) / unit << "," << z / unit;
        out << (classes ? (house ? ",6\n" : ",2\n") : "\n");
      }
    }
    const std::string path = (folder_.path() / name).string();
    EXPECT_EQ(run_camber({"convert", text, "--out", path}).exit_code, 0);
    return path;
  }
  std::string file(const std::string& name) const { return (folder_.path() / name).string(); }

  /// How far heights are off the made ground, m: root of the mean square; how many are known.
  static double rms(const Raster& raster, double unit, int* known) {
    double sum = 0.0;
    *known = 0;
    for (int row = 0; row < raster.rows; ++row) {
      for (int column = 0; column < raster.columns; ++column) {
        const float z = raster.bands[0][static_cast<std::size_t>(row * raster.columns + column)];
        if (z == kNoData) continue;
        const double x = (raster.corners[0] + (column + 0.5) * raster.corners[1]) * unit - 456000.0,
                     y = (raster.corners[3] + (row + 0.5) * raster.corners[5]) * unit - 5428000.0;
        sum += std::pow(z * unit - ground_at(x, y), 2);
        ++*known;
      }
    }
    return std::sqrt(sum / *known);
  }

  test::TemporaryFolder folder_;
};

TEST_F(Site, OfJoinedTilesIsThatOfTheWhole) {
  const std::string cloud = make("cloud.laz", false), plan = file("plan");
  const auto must = [](const std::vector<std::string>& words) {
    const auto result = run_camber(words);
    ASSERT_EQ(result.exit_code, 0) << result.error;
  };
  must({"tiles", "plan", cloud, "--tile", "17", "--out", plan});
  must({"tiles", "run", plan, "--job", "ground"});
  EXPECT_ONE_SENTENCE(
      run_camber({"export", plan + "/ground", "--to", "geotiff", "--out", file("tiles.tif")}), 2,
      "surface.json");  // not joined yet
  must({"tiles", "join", plan, "--job", "ground"});
  must({"ground", cloud, "--plan", plan, "--out", file("whole.laz")});
  for (const auto& [input, out] : {std::pair{plan + "/ground", file("tiles.tif")},
                                   std::pair{file("whole.laz"), file("whole.tif")}}) {
    must({"export", input, "--to", "geotiff", "--step", "1", "--out", out});
  }
  const Raster tiles(file("tiles.tif")), whole(file("whole.tif"));
  ASSERT_EQ(tiles.columns, whole.columns);
  ASSERT_EQ(tiles.rows, whole.rows);
  EXPECT_EQ(tiles.bands, whole.bands);

  // Tile by tile, by several processes, with holes that are wider than what a cell sees: the same.
  must({"export", file("whole.laz"), "--to", "geotiff", "--step", "0.5", "--fill-holes", "6",
        "--out", file("filled.tif")});
  for (const char* const shard : {"2/2", "1/2"}) {
    must({"tiles", "run", plan, "--job", "export", "--step", "0.5", "--fill-holes", "6", "--shard",
          shard, "--threads", shard[0] == '1' ? "1" : "2"});
  }
  must({"tiles", "join", plan, "--job", "export", "--cog", file("joined.tif")});
  const Raster filled(file("filled.tif")), mosaic(plan + "/export/mosaic.vrt"),
      joined(file("joined.tif"));
  EXPECT_EQ(joined.layout, "COG");
  for (const Raster* const raster : {&mosaic, &joined}) {
    EXPECT_EQ(raster->columns, filled.columns);
    EXPECT_EQ(raster->rows, filled.rows);
    for (std::size_t k = 0; k < 6; ++k) EXPECT_EQ(raster->corners[k], filled.corners[k]);
    EXPECT_EQ(raster->names, filled.names);
    EXPECT_EQ(raster->units, filled.units);
    EXPECT_EQ(raster->bands, filled.bands);
  }
  // A raster is no cloud.
  EXPECT_ONE_SENTENCE(
      run_camber({"export", plan + "/export", "--to", "geotiff", "--out", file("no.tif")}), 2,
      "export");
}

TEST_F(Site, OfASurveysOwnTilesIsThatOfTheWhole) {
  const std::string cloud = make("classed.laz", true), plan = file("plan");
  const auto must = [](const std::vector<std::string>& words) {
    const auto result = run_camber(words);
    ASSERT_EQ(result.exit_code, 0) << result.error;
  };
  // Neither side is a multiple of the cell.
  must(
      {"convert", cloud, "--bounds", "455000,5427000,456023.3,5429000", "--out", file("west.laz")});
  must(
      {"convert", cloud, "--bounds", "456023.3,5427000,457000,5429000", "--out", file("east.laz")});
  must({"tiles", "plan", file("west.laz"), file("east.laz"), "--in-place", "--out", plan});
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "run", plan, "--job", "export"}), 2, "joined ground");
  must({"tiles", "run", plan, "--job", "export", "--ground-from", "class", "--step", "1", "--crs",
        "EPSG:25832"});
  must({"tiles", "join", plan, "--job", "export"});
  must({"export", cloud, "--to", "geotiff", "--ground-from", "class", "--step", "1", "--crs",
        "EPSG:25832", "--out", file("whole.tif")});
  const Raster whole(file("whole.tif")), mosaic(plan + "/export/mosaic.vrt");
  EXPECT_THAT(mosaic.system, HasSubstr("25832"));
  EXPECT_EQ(mosaic.bands, whole.bands);
  // Other cells are another job.
  EXPECT_ONE_SENTENCE(run_camber({"tiles", "run", plan, "--job", "export", "--ground-from", "class",
                                  "--step", "2", "--crs", "EPSG:25832"}),
                      2, "'step'");
}

TEST_F(Site, HasGroundSurfaceSlopeSigmaAndPoints) {
  for (const bool classes : {true, false}) {
    const std::string cloud = make("site.laz", classes);
    const auto result =
        run_camber({"export", cloud, "--to", "geotiff", "--step", "0.5", "--crs", "EPSG:25832",
                    "--hillshade", file("shade.tif"), "--out", file("site.tif"), "--json"});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    const json out = json::parse(result.out);
    EXPECT_EQ(out["ground_from"], classes ? "class" : "compute");
    const Raster raster(file("site.tif"));
    EXPECT_THAT(raster.names, ElementsAre("ground height", "surface height", "slope",
                                          "sigma of ground height", "points"));
    EXPECT_THAT(raster.units, ElementsAre("m", "m", "degree", "m", ""));
    EXPECT_EQ(raster.layout, "COG");
    EXPECT_THAT(raster.system, HasSubstr("25832"));
    EXPECT_EQ(raster.columns, 120);
    EXPECT_EQ(raster.rows, 80);
    EXPECT_DOUBLE_EQ(raster.corners[0], 456000.0);
    EXPECT_DOUBLE_EQ(raster.corners[3], 5428040.0);
    int known = 0;
    EXPECT_LT(rms(raster, 1.0, &known), 0.019);  // a point has noise of 2 cm
    EXPECT_GT(known, 9000);                      // of 9600, without the house's inside
    const std::size_t house = raster.index(456025.0, 5428019.0),
                      field = raster.index(456045.0, 5428010.0);
    EXPECT_EQ(raster.bands[0][house], kNoData);
    EXPECT_NEAR(raster.bands[1][house], 112.0, 1e-4);
    EXPECT_NEAR(raster.bands[1][field], raster.bands[0][field], 0.4);
    const double rise = 0.3 + 0.8 / 9.0 * std::cos(45.0 / 9.0),
                 aside = -0.5 / 7.0 * std::sin(10.0 / 7.0);
    EXPECT_NEAR(raster.bands[2][field], std::atan(std::hypot(rise, aside)) * 180.0 / M_PI, 3.0);
    EXPECT_GT(raster.bands[3][field], 0.002);
    EXPECT_LT(raster.bands[3][field], 0.03);
    double points = 0.0;
    for (const float n : raster.bands[4]) points += n;
    EXPECT_EQ(points, 24000.0);
    EXPECT_EQ(out["unknown"].get<int>(), 9600 - known);
    // The slope goes up to the east: light from the north-west falls on it.
    const Raster shade(file("shade.tif"));
    EXPECT_EQ(shade.bands[0][house], 0.0f);
    EXPECT_GT(shade.bands[0][field], 180.0f);
  }
}

TEST_F(Site, HolesAreFilledUpToAWidth) {
  const std::string cloud = make("site.laz", true);
  for (const double width : {3.0, 14.0}) {
    const auto result =
        run_camber({"export", cloud, "--to", "geotiff", "--step", "0.5", "--fill-holes",
                    std::to_string(width), "--out", file("site.tif")});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    const Raster raster(file("site.tif"));
    const float middle = raster.bands[0][raster.index(456025.0, 5428019.0)];
    if (width < 8.0) {
      EXPECT_EQ(middle, kNoData);
    } else {
      EXPECT_NEAR(middle, ground_at(25.25, 19.25), 0.8);
      EXPECT_GT(raster.bands[3][raster.index(456025.0, 5428019.0)], 0.0f);
    }
  }
}

TEST_F(Site, FeetStayFeet) {
  constexpr double kFoot = 1200.0 / 3937.0;  // m, US survey foot
  const std::string cloud = make("feet.las", true, kFoot);
  const auto result = run_camber({"export", cloud, "--to", "geotiff", "--step", "0.6096012192",
                                  "--crs", "EPSG:2264+6360", "--out", file("feet.tif"), "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const Raster raster(file("feet.tif"));
  EXPECT_THAT(raster.units[0], HasSubstr("foot"));
  EXPECT_NEAR(raster.corners[1], 2.0, 1e-9);
  EXPECT_THAT(raster.system, HasSubstr("VERT"));
  int known = 0;
  EXPECT_LT(rms(raster, kFoot, &known), 0.019);
  EXPECT_GT(known, 5000);
}

TEST_F(Site, RefusesWhatItCannotDo) {
  const std::string cloud = make("site.laz", true);
  const auto degrees = run_camber(
      {"export", cloud, "--to", "geotiff", "--crs", "EPSG:4326", "--out", file("site.tif")});
  EXPECT_EQ(degrees.exit_code, 1);
  EXPECT_THAT(degrees.error, HasSubstr("longitude and latitude"));
  const auto label = run_camber(
      {"export", cloud, "--to", "geotiff", "--ground-from", "label", "--out", file("site.tif")});
  EXPECT_EQ(label.exit_code, 1);
  EXPECT_THAT(label.error, HasSubstr("no point of the ground"));
  const auto fine = run_camber(
      {"export", cloud, "--to", "geotiff", "--step", "0.001", "--out", file("site.tif")});
  EXPECT_NE(fine.exit_code, 0);
  const auto mesh =
      run_camber({"export", cloud, "--to", "mesh", "--fill-holes", "2", "--out", file("site.glb")});
  EXPECT_EQ(mesh.exit_code, 2);
  const auto nowhere = run_camber(
      {"export", cloud, "--to", "geotiff", "--bounds", "0,0,1,1", "--out", file("site.tif")});
  EXPECT_EQ(nowhere.exit_code, 1);
  EXPECT_FALSE(fs::exists(file("site.tif")));
  for (const auto& entry : fs::directory_iterator(folder_.path())) {
    EXPECT_EQ(entry.path().filename().string().find("raw"), std::string::npos) << entry;
  }
}

TEST_F(Site, IsTheSameForAnyNumberOfThreads) {
  const std::string cloud = make("site.laz", false);
  std::vector<std::string> bytes;
  for (const char* threads : {"1", "3"}) {
    ASSERT_EQ(run_camber({"export", cloud, "--to", "geotiff", "--threads", threads, "--out",
                          file("site.tif")})
                  .exit_code,
              0);
    std::ifstream in(file("site.tif"), std::ios::binary);
    bytes.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  EXPECT_EQ(bytes[0], bytes[1]);
}

}  // namespace
}  // namespace camber
