// camber export --to geotiff, read back by GDAL.

#include <gdal.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/export/plan_frame.h"
#include "export_program.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;

constexpr float kNoData = -9999.0f;

/// A raster as GDAL reads it.
struct Raster {
  explicit Raster(const std::string& path) {
    GDALAllRegister();
    const GDALDatasetH file = GDALOpen(path.c_str(), GA_ReadOnly);
    if (file == nullptr) return;
    columns = GDALGetRasterXSize(file);
    rows = GDALGetRasterYSize(file);
    GDALGetGeoTransform(file, corners);
    system = GDALGetProjectionRef(file);
    for (int b = 1; b <= GDALGetRasterCount(file); ++b) {
      const GDALRasterBandH band = GDALGetRasterBand(file, b);
      int known = 0;
      EXPECT_EQ(GDALGetRasterNoDataValue(band, &known), kNoData);
      EXPECT_TRUE(known);
      std::vector<float> values(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows));
      EXPECT_EQ(GDALRasterIO(band, GF_Read, 0, 0, columns, rows, values.data(), columns, rows,
                             GDT_Float32, 0, 0),
                CE_None);
      names.emplace_back(GDALGetDescription(band));
      bands.push_back(std::move(values));
    }
    GDALClose(file);
  }
  float at(std::size_t band, int row, int column) const {
    return bands[band][static_cast<std::size_t>(row * columns + column)];
  }
  Eigen::Vector2d center(int row, int column) const {
    return {corners[0] + (column + 0.5) * corners[1], corners[3] + (row + 0.5) * corners[5]};
  }

  int columns = 0, rows = 0;
  double corners[6] = {};
  std::string system;
  std::vector<std::string> names;
  std::vector<std::vector<float>> bands;
};

/// What gdalinfo prints of a file; empty where it is not installed.
std::string gdalinfo(const std::string& path) {
  std::string out;
  std::FILE* pipe = ::popen(("gdalinfo '" + path + "' 2>/dev/null").c_str(), "r");
  char part[4096];
  for (std::size_t n = 0; pipe && (n = std::fread(part, 1, sizeof part, pipe)) > 0;) {
    out.append(part, n);
  }
  if (pipe) ::pclose(pipe);
  return out;
}

class GeoTiff : public test::ExportProgram {};

TEST_F(GeoTiff, HasTheSurfacesHeights) {
  const auto result = run_camber(
      {"export", file("surface.json"), "--to", "geotiff", "--out", file("road.tif"), "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const Raster raster(file("road.tif"));
  ASSERT_EQ(raster.names, (std::vector<std::string>{"height", "sigma", "slope"}));
  EXPECT_EQ(raster.system, "");  // a camera's frame is nowhere on the earth
  const PlanFrame frame(surface_.up);
  int known = 0, unknown = 0;
  for (int row = 0; row < raster.rows; ++row) {
    for (int column = 0; column < raster.columns; ++column) {
      const Eigen::Vector2d place = raster.center(row, column);
      const SurfaceQuery truth =
          surface_.query(frame.to_surface({place.x(), place.y(), -1.0}), 0.5);
      if (raster.at(0, row, column) == kNoData) {
        ++unknown;
        EXPECT_EQ(raster.at(1, row, column), kNoData);
        // Within the road, away from its ends, every cell is seen.
        EXPECT_TRUE(place.x() < 1.1 || place.x() > 39.0 || std::abs(place.y()) > 3.3);
        continue;
      }
      ++known;
      ASSERT_NE(truth.status, Status::kFailed);
      const Eigen::Vector3d up = frame.to_plan(truth.plane.plane.normal);
      EXPECT_NEAR(raster.at(0, row, column), frame.to_plan(truth.point).z(), 1e-6);
      EXPECT_NEAR(raster.at(1, row, column), truth.sigma_height / up.z(), 1e-6);
      EXPECT_NEAR(raster.at(2, row, column), std::acos(up.z()) * 180.0 / M_PI, 1e-4);
    }
  }
  EXPECT_GT(known, 4500);
  EXPECT_EQ(json::parse(result.out)["unknown"].get<int>(), unknown);
}

TEST_F(GeoTiff, CloudsOfMapsKeepTheirSystem) {
  {
    std::ofstream cloud(file("cloud.csv")), line(file("line.csv"));
    cloud.precision(12);
    line.precision(12);
    cloud << "x,y,z,red,green,blue\n";
    line << "x,y,z\n";
    for (int i = 0; i <= 150; ++i) {
      for (int k = -20; k <= 20; ++k) {
        cloud << 456000.1 + 0.2 * i << "," << 5428000.1 + 0.2 * k << ","
              << 110.0 + 0.02 * i + 0.01 * k << ",200,100," << 50 << "\n";
      }
    }
    for (int i = 1; i < 29; ++i) line << 456000 + i << ",5428000," << 110.0 + 0.1 * i << "\n";
  }
  const std::vector<std::string> command = {
      "export",  file("cloud.csv"), "--along",       file("line.csv"), "--to",
      "geotiff", "--out",           file("map.tif"), "--crs"};
  auto metres = command;
  metres.insert(metres.end(), {"EPSG:25832", "--json"});
  const auto result = run_camber(metres);
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const Raster raster(file("map.tif"));
  ASSERT_EQ(raster.names,
            (std::vector<std::string>{"height", "sigma", "slope", "red", "green", "blue"}));
  EXPECT_THAT(raster.system, ::testing::HasSubstr("ETRS89 / UTM zone 32N"));
  EXPECT_DOUBLE_EQ(raster.corners[1], 0.2);
  int known = 0;
  for (int row = 0; row < raster.rows; ++row) {
    for (int column = 0; column < raster.columns; ++column) {
      if (raster.at(0, row, column) == kNoData) continue;
      ++known;
      const Eigen::Vector2d place = raster.center(row, column);
      const double truth = 110.0 + 0.1 * (place.x() - 456000.1) + 0.05 * (place.y() - 5428000.1);
      EXPECT_NEAR(raster.at(0, row, column), truth, 1e-4);  // 4-byte floats and text
      EXPECT_EQ(raster.at(3, row, column), 200.0f);
      EXPECT_EQ(raster.at(5, row, column), 50.0f);
    }
  }
  EXPECT_GT(known, 4000);
  const std::string shown = gdalinfo(file("map.tif"));
  if (!shown.empty()) {
    for (const std::string& part : std::vector<std::string>{
             "Size is " + std::to_string(raster.columns) + ", " + std::to_string(raster.rows),
             std::string("ID[\"EPSG\",25832]"), std::string("NoData Value=-9999"),
             std::string("Description = height"), std::string("Description = sigma"),
             std::string("Description = slope"), std::string("ColorInterp=Red")}) {
      EXPECT_THAT(shown, ::testing::HasSubstr(part));
    }
  }
  auto feet = command;
  feet.push_back("EPSG:2230");  // US survey feet
  const auto converted = run_camber(feet);
  ASSERT_EQ(converted.exit_code, 0) << converted.error;
  EXPECT_THAT(converted.error, ::testing::HasSubstr("the coordinate system is left out"));
  const Raster in_metres(file("map.tif"));
  EXPECT_EQ(in_metres.system, "");
  EXPECT_LT(in_metres.corners[0], 0.31 * 456000.0);
  ASSERT_EQ(in_metres.names.size(), 6u);
  int colored = 0;
  for (std::size_t i = 0; i < in_metres.bands[0].size(); ++i) {
    if (in_metres.bands[0][i] == kNoData) continue;
    ++colored;
    ASSERT_EQ(in_metres.bands[3][i], 200.0f);
  }
  EXPECT_GT(colored, 300);
  // GeoTIFF has no keys for this projection: not a file that names none.
  auto unnamed = command;
  unnamed.push_back("+proj=airy +lat_0=50");
  std::filesystem::remove(file("map.tif"));
  const auto refused = run_camber(unnamed);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_THAT(refused.error, ::testing::HasSubstr("cannot name the coordinate system"));
  EXPECT_FALSE(std::filesystem::exists(file("map.tif")));
}

TEST_F(GeoTiff, ColorsAreReadAsTheHeightsAre) {
  {
    std::ofstream cloud(file("cloud.txt")), line(file("line.csv"));
    line << "x,y,z\n";
    for (int i = 0; i <= 100; ++i) {
      for (int k = -20; k <= 20; ++k) {
        cloud << 0.2 * i << " " << 0.2 * k << " " << 0.02 * i << " 7 200 100 50\n";
      }
    }
    for (int i = 1; i < 20; ++i) line << i << ",0," << 0.1 * i << "\n";
  }
  const auto result =
      run_camber({"export", file("cloud.txt"), "--columns", "x,y,z,_,red,green,blue", "--along",
                  file("line.csv"), "--to", "geotiff", "--out", file("map.tif")});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const Raster raster(file("map.tif"));
  ASSERT_EQ(raster.names.size(), 6u);
  const std::vector<float>& red = raster.bands[3];
  EXPECT_GT(std::count(red.begin(), red.end(), 200.0f), 1000);
}

TEST_F(GeoTiff, ASystemOfAResultNamesNoFile) {
  std::ofstream(file("system.txt")) << "EPSG:32632";
  RunDocument run;
  run.extra["georeference"] = {
      {"status", "ok"},
      {"crs", file("system.txt")},
      {"map_from_reference", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}};
  write_json(to_json(run), folder_.path() / "run.json");
  EXPECT_ONE_SENTENCE(
      run_camber({"export", file("surface.json"), "--to", "geotiff", "--out", file("road.tif")}), 1,
      "does not know the coordinate system");
}

TEST_F(GeoTiff, SameBytesForAnyNumberOfThreads) {
  std::string first;
  for (const char* const threads : {"1", "8"}) {
    ASSERT_EQ(run_camber({"export", file("surface.json"), "--to", "geotiff", "--out",
                          file("road.tif"), "--threads", threads})
                  .exit_code,
              0);
    const std::string bytes = test::read_text(file("road.tif"));
    if (first.empty()) first = bytes;
    EXPECT_TRUE(bytes == first);
  }
}

}  // namespace
}  // namespace camber
