// camber profile and lift on GeoTIFFs of heights, along lines of GeoPackage and Shapefile, all of
// them made by GDAL.

#include <fmt/format.h>
#include <gdal.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogr_api.h>
#include <ogr_srs_api.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>

#include "camber/core/random.h"
#include "run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using test::run_camber;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kEast = 432000.0, kNorth = 5400000.0, kNoData = -32768.0;
constexpr int kUtm32 = 25832;

struct System {
  explicit System(int code) : handle(OSRNewSpatialReference(nullptr)) {
    EXPECT_EQ(OSRImportFromEPSG(handle, code), OGRERR_NONE);
    OSRSetAxisMappingStrategy(handle, OAMS_TRADITIONAL_GIS_ORDER);
  }
  ~System() { OSRDestroySpatialReference(handle); }
  OGRSpatialReferenceH handle;
};

/// A band of a made raster, of the place in metres.
struct Band {
  std::string name, unit;
  std::function<double(double x, double y)> value;
  double scale = 1.0, offset = 0.0;
};

/// How a made raster lies: `columns` x `rows` cells of `cell` units of `metres` m each.
struct Layout {
  double cell = 0.5, metres = 1.0, turn = 0.0;
  int columns = 140, rows = 140, code = kUtm32;
  GDALDataType type = GDT_Float32;
  double west = kEast - 10.0, north = kNorth + 50.0;  ///< m
};

class RasterProfiles : public ::testing::Test {
 protected:
  RasterProfiles() {
    GDALAllRegister();
    std::ofstream csv(path("line.csv"));
    csv << "x,y\n";
    for (int s = 0; s <= 40; s += 5) csv << fmt::format("{},{}\n", east(s, 0), north(s, 0));
  }
  /// A road to the north-east, at 4 % along and 2 % across.
  static double east(double s, double v) { return kEast + 0.6 * s - 0.8 * v; }
  static double north(double s, double v) { return kNorth + 0.8 * s + 0.6 * v; }
  static double along(double x, double y) { return 0.6 * (x - kEast) + 0.8 * (y - kNorth); }
  static double across(double x, double y) { return -0.8 * (x - kEast) + 0.6 * (y - kNorth); }
  static double height(double x, double y) {
    return 100.0 + 0.04 * along(x, y) + 0.02 * across(x, y);
  }

  std::string path(const std::string& name) const { return (folder_.path() / name).string(); }

  /// NaN is no data.
  std::string make(const std::string& name, const Layout& layout,
                   const std::vector<Band>& bands) const {
    const GDALDatasetH file =
        GDALCreate(GDALGetDriverByName("GTiff"), path(name).c_str(), layout.columns, layout.rows,
                   static_cast<int>(bands.size()), layout.type, nullptr);
    EXPECT_NE(file, nullptr);
    const double c = std::cos(layout.turn), s = std::sin(layout.turn);
    std::array<double, 6> t = {layout.west / layout.metres,  layout.cell * c, layout.cell * s,
                               layout.north / layout.metres, layout.cell * s, -layout.cell * c};
    GDALSetGeoTransform(file, t.data());
    if (layout.code != 0) GDALSetSpatialRef(file, System(layout.code).handle);
    for (std::size_t b = 0; b < bands.size(); ++b) {
      std::vector<double> values;
      for (int row = 0; row < layout.rows; ++row) {
        for (int column = 0; column < layout.columns; ++column) {
          const double x = t[0] + (column + 0.5) * t[1] + (row + 0.5) * t[2];
          const double y = t[3] + (column + 0.5) * t[4] + (row + 0.5) * t[5];
          const double value = bands[b].value(x * layout.metres, y * layout.metres);
          values.push_back(std::isfinite(value) ? (value - bands[b].offset) / bands[b].scale
                                                : kNoData);
        }
      }
      const GDALRasterBandH band = GDALGetRasterBand(file, static_cast<int>(b) + 1);
      GDALSetDescription(band, bands[b].name.c_str());
      GDALSetRasterUnitType(band, bands[b].unit.c_str());
      if (layout.type != GDT_Byte) GDALSetRasterNoDataValue(band, kNoData);
      if (bands[b].scale != 1.0) GDALSetRasterScale(band, bands[b].scale);
      if (bands[b].offset != 0.0) GDALSetRasterOffset(band, bands[b].offset);
      EXPECT_EQ(GDALRasterIO(band, GF_Write, 0, 0, layout.columns, layout.rows, values.data(),
                             layout.columns, layout.rows, GDT_Float64, 0, 0),
                CE_None);
    }
    GDALClose(file);
    return path(name);
  }

  test::ProgramResult profile(const std::string& raster, std::vector<std::string> more) const {
    std::vector<std::string> words = {
        "profile", raster, "--drift-sigma", "0", "--levelling-sigma-deg", "0"};
    words.insert(words.end(), more.begin(), more.end());
    return run_camber(words);
  }
  /// The made road, to half a centimetre and a tenth of a per cent.
  static void expect_road(const test::ProgramResult& run, std::size_t stations = 41) {
    ASSERT_EQ(run.exit_code, 0) << run.error;
    const json all = json::parse(run.out).at("stations");
    EXPECT_NEAR(static_cast<double>(all.size()), static_cast<double>(stations), 1.0);
    for (const json& at : all) {
      ASSERT_NE(at.at("status"), "failed") << at.at("reason");
      EXPECT_NEAR(at.at("height"), 100.0 + 0.04 * at.at("station").get<double>(), 0.005);
      EXPECT_NEAR(at.at("cross_slope_percent"), 2.0, 0.1);
      if (at.at("grade_percent").is_number()) {
        EXPECT_NEAR(at.at("grade_percent"), 4.0, 0.1);
      }
    }
  }
  test::TemporaryFolder folder_;
};

TEST_F(RasterProfiles, HeightsOfEveryLayout) {
  const auto ground = [](double x, double y) {
    static const CounterRandom random(5);
    const auto key = static_cast<std::uint64_t>(std::llround(1e3 * (x - kEast + 500.0)) * 1000003 +
                                                std::llround(1e3 * (y - kNorth + 500.0)));
    return height(x, y) + 0.005 * random.normal(key);
  };
  expect_road(
      profile(make("plain.tif", {}, {{"", "", ground}}), {"--along", path("line.csv"), "--json"}));
  // Bands as camber export writes them go before their order.
  const auto slope = [](double, double) { return 3.0; };
  const auto sigma = [](double, double) { return 0.03; };
  expect_road(profile(make("bands.tif", {},
                           {{"slope", "degree", slope},
                            {"ground height", "m", ground},
                            {"sigma of ground height", "m", sigma}}),
                      {"--along", path("line.csv"), "--json"}));
  // Millimetres above 100 m as short numbers, of cells that are turned.
  Layout turned;
  turned.type = GDT_Int16;
  turned.turn = 0.4;
  turned.west = kEast - 25.0;
  turned.north = kNorth + 20.0;
  expect_road(profile(make("short.tif", turned, {{"", "m", height, 0.001, 100.0}}),
                      {"--along", path("line.csv"), "--json"}));
  // Feet in plan, metres up.
  Layout feet;
  feet.metres = 1200.0 / 3937.0;
  feet.cell = 0.5 / feet.metres;
  feet.code = 2263;
  const auto of_feet = profile(make("feet.tif", feet, {{"", "metre", ground}}),
                               {"--along", path("line.csv"), "--line-crs", "EPSG:2263", "--json"});
  EXPECT_EQ(of_feet.exit_code, 1);  // the line's numbers are feet, too
  std::ofstream csv(path("feet.csv"));
  csv << "x,y\n";
  for (const int s : {0, 40}) {
    csv << fmt::format("{:.6f},{:.6f}\n", east(s, 0) / feet.metres, north(s, 0) / feet.metres);
  }
  csv.close();
  expect_road(profile(path("feet.tif"), {"--along", path("feet.csv"), "--json"}));
  expect_road(profile(
      make("up.tif", {}, {{"", "ft", [&](double x, double y) { return ground(x, y) / 0.3048; }}}),
      {"--along", path("line.csv"), "--json"}));
}

TEST_F(RasterProfiles, NoDataIsAGapThatIsNamed) {
  const auto hole = [](double x, double y) {
    return std::abs(along(x, y) - 20.0) < 6.0 ? std::nan("") : height(x, y);
  };
  const auto run =
      profile(make("hole.tif", {}, {{"", "", hole}}), {"--along", path("line.csv"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_THAT(run.error, HasSubstr("no ground within 3.5 m of the line from station 1"));
  for (const json& at : json::parse(run.out).at("stations")) {
    const double s = at.at("station");
    if (std::abs(s - 20.0) < 4.5) {
      EXPECT_EQ(at.at("status"), "failed") << s;
      EXPECT_TRUE(at.at("height").is_null());
    } else if (std::abs(s - 20.0) > 8.0) {
      EXPECT_NEAR(at.at("height"), 100.0 + 0.04 * s, 0.005);
    }
  }
}

TEST_F(RasterProfiles, StandardDeviationsOfTheFileAreSharedByNeighbours) {
  const auto sigma = [](double, double) { return 0.03; };
  const auto with = profile(make("sigma.tif", {}, {{"height", "m", height}, {"sigma", "m", sigma}}),
                            {"--along", path("line.csv"), "--json"});
  ASSERT_EQ(with.exit_code, 0) << with.error;
  // 3 cm, however many cells there are; the made heights have no noise.
  EXPECT_NEAR(json::parse(with.out)["stations"][20]["sigma_height"], 0.03, 0.003);
  // Of cells farther apart than what is measured nothing is seen between them.
  Layout coarse;
  coarse.cell = 5.0;
  coarse.columns = coarse.rows = 16;
  const auto alone = profile(make("coarse.tif", coarse, {{"", "m", height}}),
                             {"--along", path("line.csv"), "--json"});
  expect_road(alone);
  const json answer = json::parse(alone.out);
  EXPECT_TRUE(answer["interpolated"].get<bool>());
  EXPECT_TRUE(answer["stations"][20]["sigma_height"].is_null());
  EXPECT_TRUE(answer["stations"][20]["sigma_cross_slope_percent"].is_null());
  const auto both =
      profile(make("both.tif", coarse, {{"height", "m", height}, {"sigma", "m", sigma}}),
              {"--along", path("line.csv"), "--json"});
  ASSERT_EQ(both.exit_code, 0) << both.error;
  EXPECT_NEAR(json::parse(both.out)["stations"][20]["sigma_height"], 0.03, 0.003);
}

TEST_F(RasterProfiles, OfWhatExportWrites) {
  std::ofstream cloud(path("road.csv"));
  cloud << "x,y,z,classification\n";
  const CounterRandom random(6);
  for (std::uint64_t i = 0; i < 40000; ++i) {
    const double s = random.uniform(2 * i, -5.0, 45.0), v = random.uniform(2 * i + 1, -8.0, 8.0);
    const double x = east(s, v), y = north(s, v);
    cloud << fmt::format("{:.4f},{:.4f},{:.4f},2\n", x, y, height(x, y) + 0.01 * random.normal(i));
  }
  cloud.close();
  ASSERT_EQ(run_camber({"export", path("road.csv"), "--to", "geotiff", "--step", "0.5", "--crs",
                        "EPSG:25832", "--out", path("site.tif")})
                .exit_code,
            0);
  expect_road(profile(path("site.tif"), {"--along", path("line.csv"), "--json"}));
  ASSERT_EQ(run_camber({"export", path("road.csv"), "--to", "geotiff", "--along", path("line.csv"),
                        "--out", path("strip.tif")})
                .exit_code,
            0);
  const auto strip = profile(
      path("strip.tif"), {"--along", path("line.csv"), "--half-width", "2", "--out", path("p.csv"),
                          "--plot", path("p.svg"), "--sections", path("s.svg")});
  ASSERT_EQ(strip.exit_code, 0) << strip.error;
  EXPECT_THAT(strip.out, HasSubstr("41 of 41 stations"));
}

TEST_F(RasterProfiles, MistakesAreOneSentence) {
  const std::string raster = make("plain.tif", {}, {{"", "", height}});
  EXPECT_ONE_SENTENCE(profile(raster, {"--json"}), 2, "found a GeoTIFF without --along FILE");
  EXPECT_ONE_SENTENCE(
      profile(raster, {"--along", path("line.csv"), "--json", "--ground-from", "class"}), 2,
      "--ground-from: found a GeoTIFF, expected a cloud");
  Layout picture;
  picture.type = GDT_Byte;
  EXPECT_ONE_SENTENCE(
      profile(make("shade.tif", picture, {{"", "", [](double, double) { return 7.0; }}}),
              {"--along", path("line.csv"), "--json"}),
      2, "found Byte (a picture), expected heights");
  EXPECT_ONE_SENTENCE(
      profile(make("slope.tif", {}, {{"slope", "degree", [](double, double) { return 7.0; }}}),
              {"--along", path("line.csv"), "--json"}),
      2, "band slope: found numbers in degree, expected heights");
  Layout degrees;
  degrees.code = 4326;
  EXPECT_ONE_SENTENCE(profile(make("degrees.tif", degrees, {{"", "", height}}),
                              {"--along", path("line.csv"), "--json"}),
                      1, "longitude and latitude");
  std::ofstream(path("far.csv")) << "x,y\n0,0\n50,0\n";
  EXPECT_ONE_SENTENCE(profile(raster, {"--along", path("far.csv"), "--json"}), 1,
                      "the ground lies in x 431990 to 432060");
  // A file that ends early, and one that is none.
  const std::string bytes = test::read_bytes(raster);
  std::ofstream(path("cut.tif"), std::ios::binary) << bytes.substr(0, bytes.size() / 2);
  EXPECT_ONE_SENTENCE(profile(path("cut.tif"), {"--along", path("line.csv"), "--json"}), 2,
                      "cut.tif");
  std::ofstream(path("none.tif"), std::ios::binary) << std::string("II*\0nothing", 11);
  EXPECT_ONE_SENTENCE(profile(path("none.tif"), {"--along", path("line.csv"), "--json"}), 2,
                      "expected a GeoTIFF of heights");
}

TEST_F(RasterProfiles, BoxesStandOnAGeoTiff) {
  const std::string raster = make("plain.tif", {}, {{"height", "m", height}});
  // Two metres above the ground, one far from the raster.
  std::ofstream(path("nu.json")) << fmt::format(
      R"([{{"translation": [{0}, {1}, 104], "size": [1.8, 4, 1.5], "rotation": [1, 0, 0, 0],
      "category_name": "vehicle.car"}}, {{"translation": [0, 0, 104], "size": [1.8, 4, 1.5],
      "rotation": [1, 0, 0, 0], "category_name": "vehicle.car"}}])",
      east(20, 0), north(20, 0));
  const auto run = run_camber(
      {"lift", path("nu.json"), "--surface", raster, "--out", path("lifted.json"), "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.error;
  EXPECT_EQ(json::parse(run.out)["lifted"], 1);
  const json boxes = json::parse(test::read_text(path("lifted.json")));
  EXPECT_EQ(boxes[0]["camber_status"], "ok");
  EXPECT_EQ(boxes[1]["camber_reason"], "no ground is known below");
  EXPECT_NEAR(boxes[0]["translation"][2], 100.8 + 0.75, 0.005);  // cos of the tilt: 1 mm
  // A GeoTIFF lies on a map, KITTI's labels do not.
  std::ofstream(path("labels.txt")) << "Car 0 0 0 1 1 2 2 1.5 1.8 4 0 1.6 20 0\n";
  std::ofstream(path("calib.txt")) << "P2: 700 0 600 0 0 700 180 0 0 0 1 0\n";
  EXPECT_ONE_SENTENCE(run_camber({"lift", path("labels.txt"), "--surface", raster, "--calib",
                                  path("calib.txt"), "--out", path("l.txt")}),
                      2, "lies on a map");
}

// --- Lines of GeoPackage and Shapefile ---

struct MadeLine {
  std::string name;
  std::vector<std::array<double, 2>> places;
};
struct MadeLayer {
  std::string name;
  int code = kUtm32;
  std::vector<MadeLine> lines;
};

void make_vector(const char* driver, const std::string& path,
                 const std::vector<MadeLayer>& layers) {
  GDALAllRegister();
  const GDALDatasetH file =
      GDALCreate(GDALGetDriverByName(driver), path.c_str(), 0, 0, 0, GDT_Unknown, nullptr);
  ASSERT_NE(file, nullptr);
  for (const MadeLayer& made : layers) {
    const System system(made.code == 0 ? kUtm32 : made.code);
    const OGRLayerH layer = GDALDatasetCreateLayer(
        file, made.name.c_str(), made.code == 0 ? nullptr : system.handle, wkbLineString, nullptr);
    ASSERT_NE(layer, nullptr);
    const OGRFieldDefnH field = OGR_Fld_Create("NAME", OFTString);
    OGR_L_CreateField(layer, field, TRUE);
    OGR_Fld_Destroy(field);
    for (const MadeLine& line : made.lines) {
      const OGRFeatureH feature = OGR_F_Create(OGR_L_GetLayerDefn(layer));
      OGR_F_SetFieldString(feature, 0, line.name.c_str());
      const OGRGeometryH geometry = OGR_G_CreateGeometry(wkbLineString);
      for (const auto& place : line.places) OGR_G_AddPoint_2D(geometry, place[0], place[1]);
      OGR_F_SetGeometryDirectly(feature, geometry);
      EXPECT_EQ(OGR_L_CreateFeature(layer, feature), OGRERR_NONE);
      OGR_F_Destroy(feature);
    }
  }
  GDALClose(file);
}

class VectorLines : public RasterProfiles {
 protected:
  VectorLines() { raster_ = make("plain.tif", {}, {{"", "", height}}); }
  static MadeLine axis() {
    return {"axis", {{east(0, 0), north(0, 0)}, {east(40, 0), north(40, 0)}}};
  }
  static MadeLine beside() {
    return {"beside", {{east(0, 3), north(0, 3)}, {east(40, 3), north(40, 3)}}};
  }
  std::string raster_;
};

TEST_F(VectorLines, OfGeoPackageAndShapefile) {
  for (const auto& [driver, name] :
       {std::pair("GPKG", "line.gpkg"), std::pair("ESRI Shapefile", "line.shp")}) {
    make_vector(driver, path(name), {{"line", kUtm32, {axis()}}});
    expect_road(profile(raster_, {"--along", path(name), "--json"}));
  }
  // Of several lines the one that is named, by the field or by its number.
  make_vector("GPKG", path("two.gpkg"), {{"roads", kUtm32, {beside(), axis()}}});
  EXPECT_ONE_SENTENCE(profile(raster_, {"--along", path("two.gpkg"), "--json"}), 2,
                      "found 2 lines (1 'beside', 2 'axis'), expected one");
  for (const char* wanted : {"axis", "2"}) {
    expect_road(profile(raster_, {"--along", path("two.gpkg"), "--alignment", wanted, "--json"}));
  }
  EXPECT_ONE_SENTENCE(
      profile(raster_, {"--along", path("two.gpkg"), "--alignment", "river", "--json"}), 2,
      "--alignment: found 'river', which is none of the lines");
}

TEST_F(VectorLines, OfAnotherCoordinateSystem) {
  // The same two places in zone 33, by the transverse Mercator's own formulas (PROJ).
  const MadeLine in33 = {
      "axis", {{-8890.80213397753, 5422761.77612344}, {-8864.27114137239, 5422791.87809966}}};
  for (const auto& [driver, name] :
       {std::pair("GPKG", "utm33.gpkg"), std::pair("ESRI Shapefile", "utm33.shp")}) {
    make_vector(driver, path(name), {{"line", 25833, {in33}}});
    expect_road(profile(raster_, {"--along", path(name), "--json"}));
  }
  // Stated wrong, the line lies elsewhere; --line-crs goes before what the file states.
  make_vector("GPKG", path("wrong.gpkg"), {{"line", 25833, {axis()}}});
  EXPECT_ONE_SENTENCE(profile(raster_, {"--along", path("wrong.gpkg"), "--json"}), 1,
                      "expected a line in its coordinates");
  expect_road(
      profile(raster_, {"--along", path("wrong.gpkg"), "--line-crs", "EPSG:25832", "--json"}));
  // One that needs a grid that Debian does not install names both.
  make_vector("GPKG", path("gk.gpkg"), {{"line", 31467, {axis()}}});
  const auto grid = profile(raster_, {"--along", path("gk.gpkg"), "--json"});
  EXPECT_ONE_SENTENCE(grid, 2, "cannot be transformed from its coordinate system (");
  EXPECT_THAT(grid.error, HasSubstr("31467"));
  EXPECT_THAT(grid.error, HasSubstr("25832"));
  make_vector("GPKG", path("mixed.gpkg"), {{"a", kUtm32, {axis()}}, {"b", 25833, {in33}}});
  EXPECT_ONE_SENTENCE(profile(raster_, {"--along", path("mixed.gpkg"), "--json"}), 2,
                      "layer b: found another coordinate system");
}

TEST_F(VectorLines, WithoutALayerOrItsFiles) {
  make_vector("GPKG", path("empty.gpkg"), {});
  EXPECT_ONE_SENTENCE(profile(raster_, {"--along", path("empty.gpkg"), "--json"}), 2, "empty.gpkg");
  make_vector("GPKG", path("bare.gpkg"), {{"line", kUtm32, {}}});
  EXPECT_ONE_SENTENCE(profile(raster_, {"--along", path("bare.gpkg"), "--json"}), 2,
                      "found no line, expected one");
  make_vector("ESRI Shapefile", path("line.shp"), {{"line", kUtm32, {axis()}}});
  // Without its .prj a line is in the raster's own system.
  fs::remove(path("line.prj"));
  expect_road(profile(raster_, {"--along", path("line.shp"), "--json"}));
  const std::string bytes = test::read_bytes(path("line.shp"));
  std::ofstream(path("line.shp"), std::ios::binary) << bytes.substr(0, bytes.size() - 20);
  EXPECT_ONE_SENTENCE(profile(raster_, {"--along", path("line.shp"), "--json"}), 2, "line.shp");
}

}  // namespace
}  // namespace camber
