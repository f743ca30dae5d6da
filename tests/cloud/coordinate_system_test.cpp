#include "camber/cloud/coordinate_system.h"

#include <gtest/gtest.h>

#include <cstring>

#include "camber/cloud/units.h"
#include "cloud/cloud_files.h"

namespace camber {
namespace {

using Kind = CoordinateSystem::Kind;

const char* const kUtm =
    "PROJCS[\"WGS 84 / UTM zone 17N\",GEOGCS[\"WGS 84\",DATUM[\"WGS_1984\",SPHEROID[\"WGS 84\","
    "6378137,298.257223563]],PRIMEM[\"Greenwich\",0],UNIT[\"degree\",0.0174532925199433],"
    "AUTHORITY[\"EPSG\",\"4326\"]],PROJECTION[\"Transverse_Mercator\"],UNIT[\"metre\",1,"
    "AUTHORITY[\"EPSG\",\"9001\"]],AXIS[\"Easting\",EAST],AUTHORITY[\"EPSG\",\"32617\"]]";

TEST(CoordinateSystem, WellKnownTextVersionOne) {
  const CoordinateSystem utm = coordinate_system_from_wkt(kUtm);
  EXPECT_EQ(utm.kind, Kind::kProjected);
  EXPECT_EQ(utm.name, "WGS 84 / UTM zone 17N");
  EXPECT_EQ(utm.epsg, 32617);
  EXPECT_EQ(utm.horizontal.name, "metre");
  EXPECT_TRUE(utm.metric());
  EXPECT_FALSE(utm.vertical_stated);

  const CoordinateSystem compound = coordinate_system_from_wkt(
      std::string("COMPD_CS[\"both\",") + kUtm +
      ",VERT_CS[\"NAVD88 height (ftUS)\",VERT_DATUM[\"x\",2005],UNIT[\"US survey "
      "foot\",0.304800609601219],AUTHORITY[\"EPSG\",\"6360\"]]]");
  EXPECT_EQ(compound.name, "both");
  EXPECT_EQ(compound.epsg, 32617);
  EXPECT_EQ(compound.vertical_epsg, 6360);
  EXPECT_DOUBLE_EQ(compound.vertical.metres, 1200.0 / 3937.0);
  EXPECT_FALSE(compound.metric());

  const CoordinateSystem degrees =
      coordinate_system_from_wkt("GEOGCS[\"WGS 84\",UNIT[\"degree\",0.0174532925199433]]");
  EXPECT_EQ(degrees.kind, Kind::kGeographic);
  EXPECT_TRUE(degrees.horizontal.angle);
  EXPECT_EQ(degrees.vertical.name, "metre");
}

TEST(CoordinateSystem, ANameOfAUnitGoesBeforeAWrongFactor) {
  const CoordinateSystem feet = coordinate_system_from_wkt(
      "PROJCS[\"a\",UNIT[\"Foot_US\",0.3],VERTCS[\"b\",UNIT[\"US survey foot\",1.0]]]");
  EXPECT_DOUBLE_EQ(feet.horizontal.metres, 1200.0 / 3937.0);
  EXPECT_DOUBLE_EQ(feet.vertical.metres, 1200.0 / 3937.0);
  const CoordinateSystem other = coordinate_system_from_wkt("PROJCS[\"a\",UNIT[\"rod\",5.0292]]");
  EXPECT_EQ(other.horizontal.name, "rod");
  EXPECT_DOUBLE_EQ(other.horizontal.metres, 5.0292);
  EXPECT_DOUBLE_EQ(other.vertical.metres, 5.0292);
}

TEST(CoordinateSystem, WellKnownTextVersionTwo) {
  const CoordinateSystem system = coordinate_system_from_wkt(
      "BOUNDCRS[SOURCECRS[PROJCRS[\"OSGB \"\"36\"\"\",BASEGEOGCRS[\"x\"],CONVERSION[\"y\"],"
      "CS[Cartesian,2],AXIS[\"(E)\",east,ORDER[1],LENGTHUNIT[\"foot\",0.3048]],"
      "ID[\"EPSG\",27700]]],TARGETCRS[GEOGCRS[\"z\"]]]");
  EXPECT_EQ(system.kind, Kind::kProjected);
  EXPECT_EQ(system.name, "OSGB \"36\"");
  EXPECT_EQ(system.epsg, 27700);
  EXPECT_DOUBLE_EQ(system.horizontal.metres, 0.3048);
  const CoordinateSystem earth = coordinate_system_from_wkt(
      "GEODCRS[\"a\",CS[Cartesian,3],AXIS[\"x\",geocentricX],LENGTHUNIT[\"metre\",1]]");
  EXPECT_EQ(earth.kind, Kind::kGeocentric);
  EXPECT_TRUE(earth.metric());
}

TEST(CoordinateSystem, TextThatIsNotWellFormedIsNoSystem) {
  std::string deep;
  for (int i = 0; i < 100000; ++i) deep += "A[";
  const std::string whole = kUtm;
  for (const std::string& text :
       {std::string(), std::string("PROJCS"), std::string("PROJCS["), std::string("[]"), deep,
        std::string("EPSG:32617"), whole.substr(0, whole.size() - 1)}) {
    EXPECT_EQ(coordinate_system_from_wkt(text).kind, Kind::kUnknown) << text.substr(0, 40);
  }
  for (std::size_t cut = 0; cut < whole.size(); ++cut) {
    coordinate_system_from_wkt(whole.substr(0, cut));  // sanitizers look on
  }
}

std::string shorts(std::initializer_list<int> values) {
  std::string out;
  for (const int v : values) {
    const std::uint16_t value = static_cast<std::uint16_t>(v);
    out.append(reinterpret_cast<const char*>(&value), 2);
  }
  return out;
}

TEST(CoordinateSystem, GeoTiffKeys) {
  const double size = 0.5;
  std::string doubles(8, '\0');
  std::memcpy(doubles.data(), &size, 8);
  const std::string directory =
      shorts({1, 1, 0,    6, 1024, 0,     1,    1,     3072, 0, 1,    2994, 3073, 34737,
              8, 2, 3076, 0, 1,    32767, 3077, 34736, 1,    0, 4099, 0,    1,    9002});
  const auto keys = read_geotiff_keys(directory, doubles, "ABmy feet|rest");
  const CoordinateSystem system = coordinate_system_from_geotiff(keys);
  EXPECT_EQ(system.kind, Kind::kProjected);
  EXPECT_EQ(system.epsg, 2994);
  EXPECT_EQ(system.name, "my feet");
  EXPECT_DOUBLE_EQ(system.horizontal.metres, 0.5);
  EXPECT_EQ(system.vertical.name, "foot");
  EXPECT_EQ(geotiff_key_name(3076), "ProjLinearUnits");
  EXPECT_EQ(geotiff_key_name(2057), "2057");

  // A code alone: its unit is known for UTM only.
  EXPECT_EQ(coordinate_system_from_geotiff({{1024, 1}, {3072, 32617}}).horizontal.name, "metre");
  EXPECT_FALSE(coordinate_system_from_geotiff({{1024, 1}, {3072, 2994}}).horizontal.known());
  EXPECT_TRUE(coordinate_system_from_geotiff({{1024, 2}, {2048, 4326}}).horizontal.angle);
}

TEST(CoordinateSystem, ACodeOfLongitudeAndLatitudeIsNoProjectedSystem) {
  for (const int code : {4326, 4979, 4258, 7844}) {
    EXPECT_EQ(coordinate_system_from_epsg(code).kind, Kind::kGeographic);
    // As some programs, earlier ones of this among them, write it.
    const CoordinateSystem system = coordinate_system_from_geotiff({{1024, 1}, {3072, code}});
    EXPECT_EQ(system.kind, Kind::kGeographic);
    EXPECT_EQ(system.epsg, code);
    EXPECT_TRUE(system.horizontal.angle);
    EXPECT_EQ(system.vertical.name, "metre");
  }
  EXPECT_EQ(coordinate_system_from_geotiff({{1024, 1}, {3072, 4647}}).kind, Kind::kProjected);
  EXPECT_EQ(coordinate_system_from_epsg(4647).kind, Kind::kUnknown);
  EXPECT_EQ(coordinate_system_from_epsg(32632).kind, Kind::kProjected);
}

TEST(CoordinateSystem, GeoTiffKeysThatPointOutsideAreLeftOut) {
  const auto keys =
      read_geotiff_keys(shorts({1, 1,    0,     900, 1024, 0,    1,     1, 3073,  34737, 9,
                                0, 3077, 34736, 2,   0,    2057, 34736, 1, 65535, 3072,  0}),
                        std::string(8, '\0'), "12345678");
  EXPECT_EQ(keys.size(), 1u);
  EXPECT_TRUE(read_geotiff_keys("", "", "").empty());
  EXPECT_TRUE(read_geotiff_keys("1234567", "", "").empty());
  // Many keys that share a long text: no more than a mebibyte of it.
  std::string many = shorts({1, 1, 0, 8000});
  for (int k = 0; k < 8000; ++k) many += shorts({k + 1, 34737, 65535, 0});
  std::size_t bytes = 0;
  for (const auto& [key, value] : read_geotiff_keys(many, "", std::string(65535, 'a'))) {
    bytes += std::get<std::string>(value).size();
  }
  EXPECT_LE(bytes, std::size_t{1} << 20);
  EXPECT_GT(bytes, 0u);
}

std::string written(const RoadCloud& cloud, const CoordinateSystem& system, CloudFormat format) {
  const auto source = make_point_source(cloud);
  PointStreamHeader header = source->header();
  header.crs = system;
  std::ostringstream out;
  const auto sink = make_point_sink(out, header, format, CloudEncoding::kAscii);
  PointBatch batch;
  while (source->next(batch)) sink->write(batch);
  sink->finish();
  return out.str();
}

TEST(CoordinateSystem, OtherFormatsCarryItInComments) {
  RoadCloud cloud;
  cloud.points = {{1, 2, 3}, {4, 5, 6}};
  CoordinateSystem by_code;
  by_code.epsg = 2994;
  by_code.horizontal = by_code.vertical = unit_from_name("foot");
  CoordinateSystem odd;
  odd.horizontal = unit_from_metres(0.25);
  odd.vertical = unit_from_metres(1.0);
  for (const CloudFormat format : {CloudFormat::kPly, CloudFormat::kPcd, CloudFormat::kText}) {
    for (const CoordinateSystem& system : {coordinate_system_from_wkt(kUtm), by_code, odd}) {
      const std::string text = written(cloud, system, format);
      const CloudFile back =
          test::read_from_memory(text, format == CloudFormat::kText ? "a.xyz" : "a.ply");
      ASSERT_TRUE(back.report.crs.has_value());
      EXPECT_EQ(back.report.crs->wkt, system.wkt);
      EXPECT_EQ(back.report.crs->epsg, system.epsg);
      EXPECT_EQ(back.report.crs->horizontal.metres, system.horizontal.metres);
      EXPECT_EQ(back.report.crs->vertical.metres, system.vertical.metres);
      EXPECT_EQ(back.cloud.metric, system.metric());
    }
  }
  EXPECT_EQ(test::read_error("# camber unit 0 1\n1 2 3\n", "a.xyz").substr(0, 13), "a.xyz: line 1");
}

TEST(CoordinateSystem, LasStatesTheKindOfASystemByCode) {
  RoadCloud cloud;
  cloud.points = {{8, 48, 3}, {9, 49, 6}};
  CoordinateSystem by_code;
  by_code.epsg = 4326;
  const auto source = make_point_source(cloud);
  PointStreamHeader header = source->header();
  header.crs = by_code;
  std::ostringstream out;
  const auto sink = make_point_sink(out, header, CloudFormat::kLas, CloudEncoding::kBinary);
  PointBatch batch;
  while (source->next(batch)) sink->write(batch);
  sink->finish();
  const CoordinateSystem back = *test::read_from_memory(out.str(), "a.las").report.crs;
  EXPECT_EQ(back.kind, Kind::kGeographic);
  EXPECT_EQ(back.geotiff_keys.at(1024), GeoKeyValue(2));
  EXPECT_EQ(back.geotiff_keys.at(2048), GeoKeyValue(4326));
  EXPECT_EQ(back.geotiff_keys.count(3072), 0u);
  // By a comment, without PROJ.
  const CloudFile text = test::read_from_memory("# camber crs EPSG:4326\n8 48 3\n", "a.xyz");
  EXPECT_EQ(text.report.crs->kind, Kind::kGeographic);
  EXPECT_FALSE(text.cloud.metric);
}

TEST(CoordinateSystem, LongTextGoesOnInFurtherComments) {
  RoadCloud cloud;
  cloud.points = {{1, 2, 3}, {4, 5, 6}};
  for (const char* const filling : {"grid  of 1990 ", "\u00df", "x", " "}) {
    std::string name;
    while (name.size() < 2500) name += filling;
    CoordinateSystem system = coordinate_system_from_wkt("COMPD_CS[\"" + name + "\"," + kUtm +
                                                         ",VERT_CS[\"h\",UNIT[\"metre\",1]]]");
    ASSERT_EQ(system.kind, Kind::kProjected);
    for (const CloudFormat format : {CloudFormat::kPly, CloudFormat::kPcd, CloudFormat::kText}) {
      const std::string text = written(cloud, system, format);
      // Readers of PLY that others use (RPly) hold a line in 1,024 bytes.
      std::istringstream lines(text);
      for (std::string line; std::getline(lines, line);) EXPECT_LT(line.size(), 1000u);
      const CloudFile back =
          test::read_from_memory(text, format == CloudFormat::kText ? "a.xyz" : "a.ply");
      ASSERT_TRUE(back.report.crs.has_value());
      if (*filling != ' ') {
        EXPECT_TRUE(back.report.crs->wkt == system.wkt) << back.report.crs->wkt.size();
      }
      EXPECT_EQ(back.report.crs->kind, Kind::kProjected);
      EXPECT_EQ(back.cloud.size(), 2u);
    }
  }
}

TEST(CoordinateSystem, LasKeepsAUnitThatBelongsToNoNamedSystem) {
  RoadCloud cloud;
  cloud.points = {{1, 2, 3}, {4, 5, 6}};
  for (const char* const vertical : {"ft", "m", "US survey foot"}) {
    const auto source = make_point_source(cloud);
    PointStreamHeader header = source->header();
    CoordinateSystem unit;
    unit.horizontal = unit_from_name("ft");
    unit.vertical = unit_from_name(vertical);
    header.crs = unit;
    header.metric = false;
    std::ostringstream out;
    const auto sink = make_point_sink(out, header, CloudFormat::kLas, CloudEncoding::kBinary);
    PointBatch batch;
    while (source->next(batch)) sink->write(batch);
    sink->finish();
    const CloudFile back = test::read_from_memory(out.str(), "a.las");
    ASSERT_TRUE(back.report.crs.has_value());
    EXPECT_EQ(back.report.crs->horizontal.name, unit.horizontal.name);
    EXPECT_EQ(back.report.crs->horizontal.metres, unit.horizontal.metres);
    EXPECT_EQ(back.report.crs->vertical.name, unit.vertical.name);
    EXPECT_EQ(back.report.crs->vertical.metres, unit.vertical.metres);
    EXPECT_FALSE(back.cloud.metric);
    EXPECT_EQ(back.cloud.points, cloud.points);
  }
}

TEST(Units, FeetBecomeMetres) {
  RoadCloud cloud;
  cloud.metric = false;
  cloud.origin = {1000, 2000, 0};
  cloud.points = {{10, -20, 30}};
  cloud.sigmas = {2};
  cloud.covariances = {{{1, 2, 3, 4, 5, 6}}};
  CoordinateSystem system;
  system.horizontal = unit_from_name("ft");
  system.vertical = unit_from_name("metre");
  to_metres(&cloud, system);
  EXPECT_TRUE(cloud.metric);
  EXPECT_TRUE(cloud.origin.isApprox(Eigen::Vector3d(304.8, 609.6, 0)));
  EXPECT_TRUE(cloud.points[0].isApprox(Eigen::Vector3f(3.048f, -6.096f, 30.0f)));
  EXPECT_FLOAT_EQ(cloud.sigmas[0], 0.6096f);
  EXPECT_FLOAT_EQ(cloud.covariances[0][0], 0.3048f * 0.3048f);
  EXPECT_FLOAT_EQ(cloud.covariances[0][2], 3 * 0.3048f);
  EXPECT_FLOAT_EQ(cloud.covariances[0][5], 6.0f);
  system.horizontal = unit_from_name("degree");
  EXPECT_THROW(to_metres(&cloud, system), std::invalid_argument);
}

}  // namespace
}  // namespace camber
