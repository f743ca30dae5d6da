#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/cloud/cloud_summary.h"
#include "camber/cloud/detail/e57_pages.h"
#include "camber/cloud/e57_file.h"
#include "cloud/cloud_files.h"
#include "cloud/e57_maker.h"
#include "cloud/memory_meter.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::e57_doubles;
using test::e57_floats;
using test::e57_integers;
using test::e57_scan;
using test::E57Maker;
using test::read_error;
using test::read_from_memory;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const char kDoubles[] =
    "<cartesianX type=\"Float\"/><cartesianY type=\"Float\"/><cartesianZ type=\"Float\"/>";

std::string data3d(const std::string& scans) {
  return "<data3D type=\"Vector\">" + scans + "</data3D>";
}

/// All values of a file by attribute, in double.
struct Values {
  std::map<std::string, std::vector<double>> of;
  std::map<std::string, ScalarType> type;
  PointStreamHeader header;
  ReadReport report;
  std::size_t count = 0;
};

Values read_values(PointSource& source) {
  Values out;
  out.header = source.header();
  PointBatch batch;
  while (source.next(batch)) {
    out.count += batch.count;
    for (std::size_t f = 0; f < batch.fields.size(); ++f) {
      const PointField& field = source.header().fields[f];
      for (std::size_t i = 0; i < batch.count; ++i) {
        out.of[field.name].push_back(batch.fields[f].number(field.type, i));
      }
    }
  }
  for (const PointField& field : source.header().fields) out.type[field.name] = field.type;
  out.report = source.report();
  return out;
}

Values read_values(const std::string& bytes, const ReadOptions& options = {}) {
  return read_values(*open_point_source(bytes.data(), bytes.size(), "a.e57", options));
}

/// A scan of doubles with a pose and one attribute of its own.
std::string small_file() {
  E57Maker maker;
  std::vector<double> x, y, z;
  std::vector<std::uint64_t> rows;
  for (int i = 0; i < 40; ++i) {
    x.push_back(0.25 * i);
    y.push_back(-1.5 * i);
    z.push_back(10.0 + i);
    rows.push_back(static_cast<std::uint64_t>(i % 8));
  }
  const std::uint64_t place = maker.add_points(
      {e57_doubles(x), e57_doubles(y), e57_doubles(z), e57_integers(3, rows)}, 100);
  return maker.finish(data3d(e57_scan(
      "<name type=\"String\">s</name>", place, 40,
      std::string(kDoubles) + "<rowIndex type=\"Integer\" minimum=\"0\" maximum=\"7\"/>")));
}

TEST(E57, ChecksumIsCrc32c) {
  // The check value of CRC-32C (RFC 3720, appendix B.4, has others of it).
  const std::string digits = "123456789";
  EXPECT_EQ(detail::crc32c(reinterpret_cast<const unsigned char*>(digits.data()), digits.size()),
            0xE3069283u);
  const std::string zeros(32, '\0');
  EXPECT_EQ(detail::crc32c(reinterpret_cast<const unsigned char*>(zeros.data()), 32), 0x8A9136AAu);
}

TEST(E57, IntegersOfEveryWidthAcrossPackets) {
  for (unsigned bits = 1; bits <= 64; ++bits) {
    const CounterRandom random(bits);
    const std::uint64_t most = bits == 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
    std::vector<std::uint64_t> raw;
    for (std::uint64_t i = 0; i < 70; ++i) raw.push_back(random.bits(i) & most);
    raw.push_back(most);
    const std::vector<double> zeros(raw.size(), 0.0);
    const std::int64_t low = bits == 64 ? INT64_MIN : bits == 63 ? INT64_MIN / 2 : std::int64_t{-7};
    const auto high = static_cast<std::int64_t>(static_cast<std::uint64_t>(low) + most);
    // Packets of a size that no value's is a divisor of.
    for (const std::size_t packet : {std::size_t{7}, std::size_t{64}}) {
      E57Maker maker;
      const std::uint64_t place = maker.add_points(
          {e57_doubles(zeros), e57_doubles(zeros), e57_doubles(zeros), e57_integers(bits, raw)},
          packet);
      const std::string bytes = maker.finish(data3d(
          e57_scan("", place, raw.size(),
                   std::string(kDoubles) + "<n type=\"Integer\" minimum=\"" + std::to_string(low) +
                       "\" maximum=\"" + std::to_string(high) + "\"/>")));
      const auto source = open_point_source(bytes.data(), bytes.size(), "a.e57");
      ASSERT_EQ(source->header().count, raw.size());
      const ScalarType type = source->header().fields[3].type;
      PointBatch batch;
      std::size_t done = 0;
      while (source->next(batch)) {
        for (std::size_t i = 0; i < batch.count; ++i, ++done) {
          const auto expected =
              static_cast<std::int64_t>(static_cast<std::uint64_t>(low) + raw[done]);
          with_type(type, [&](auto tag) {
            ASSERT_EQ(static_cast<std::int64_t>(batch.fields[3].get<decltype(tag)>(i)), expected)
                << bits << " bits, value " << done;
          });
        }
      }
      ASSERT_EQ(done, raw.size()) << bits << " bits";
    }
  }
}

TEST(E57, ScaledIntegersAndConstants) {
  E57Maker maker;
  const std::uint64_t place =
      maker.add_points({e57_integers(10, {0, 500, 1000}), e57_integers(0, {0, 0, 0}),
                        e57_floats({0.5f, 1.5f, -2.5f}), e57_integers(0, {0, 0, 0})});
  const Values values = read_values(maker.finish(data3d(e57_scan(
      "", place, 3,
      "<cartesianX type=\"ScaledInteger\" minimum=\"-500\" maximum=\"500\" scale=\"0.001\" "
      "offset=\"100\"/>"
      "<cartesianY type=\"ScaledInteger\" minimum=\"42\" maximum=\"42\" scale=\"0.5\"/>"
      "<cartesianZ type=\"Float\" precision=\"single\"/>"
      "<returnIndex type=\"Integer\" minimum=\"7\" maximum=\"7\"/>"))));
  EXPECT_THAT(values.of.at("x"), ElementsAre(-500 * 0.001 + 100, 100.0, 500 * 0.001 + 100));
  EXPECT_THAT(values.of.at("y"), ElementsAre(21.0, 21.0, 21.0));
  EXPECT_THAT(values.of.at("z"), ElementsAre(0.5, 1.5, -2.5));
  EXPECT_THAT(values.of.at("returnIndex"), ElementsAre(7, 7, 7));
  EXPECT_EQ(values.type.at("x"), ScalarType::kFloat64);
  EXPECT_EQ(values.type.at("returnIndex"), ScalarType::kUint8);
}

TEST(E57, PosesTurnPointsAndNormals) {
  E57Maker maker;
  const std::uint64_t place =
      maker.add_points({e57_floats({1, 0, 3}), e57_floats({0, 2, 4}), e57_floats({0, 0, 5}),
                        e57_floats({1, 0, 0}), e57_floats({0, 1, 0}), e57_floats({0, 0, 1})});
  // A quarter of a turn about z, then 500 km away.
  const double half = std::sqrt(0.5);
  std::ostringstream head;
  head.precision(17);
  head << "<pose type=\"Structure\"><rotation type=\"Structure\"><w type=\"Float\">" << half
       << "</w><z type=\"Float\">" << half << "</z></rotation><translation type=\"Structure\">"
       << "<x type=\"Float\">500000</x><y type=\"Float\">20</y><z type=\"Float\">-1</z>"
       << "</translation></pose>";
  const std::string bytes =
      maker.finish(data3d(e57_scan(head.str(), place, 3,
                                   "<cartesianX type=\"Float\" precision=\"single\"/>"
                                   "<cartesianY type=\"Float\" precision=\"single\"/>"
                                   "<cartesianZ type=\"Float\" precision=\"single\"/>"
                                   "<nor:normalX type=\"Float\" precision=\"single\"/>"
                                   "<nor:normalY type=\"Float\" precision=\"single\"/>"
                                   "<nor:normalZ type=\"Float\" precision=\"single\"/>")));
  const Values posed = read_values(bytes);
  const double x[3][3] = {{500000, 21, -1}, {499998, 20, -1}, {499996, 23, 4}};
  const double n[3][3] = {{0, 1, 0}, {-1, 0, 0}, {0, 0, 1}};
  const char* const axes[] = {"x", "y", "z"};
  const char* const normals[] = {"nx", "ny", "nz"};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(posed.of.at(axes[axis])[i], x[i][axis], 1e-9);     // rounding at 500 km
      EXPECT_NEAR(posed.of.at(normals[axis])[i], n[i][axis], 1e-7);  // of floats
    }
  }
  EXPECT_EQ(posed.type.at("x"), ScalarType::kFloat64);
  ReadOptions own;
  own.own_frame = true;
  const Values plain = read_values(bytes, own);
  EXPECT_THAT(plain.of.at("x"), ElementsAre(1, 0, 3));
  EXPECT_THAT(plain.of.at("ny"), ElementsAre(0, 1, 0));
  EXPECT_EQ(plain.type.at("x"), ScalarType::kFloat32);
}

TEST(E57, SphericalCoordinates) {
  E57Maker maker;
  const std::uint64_t place =
      maker.add_points({e57_doubles({2, 2, 2}), e57_doubles({0, M_PI / 2, M_PI / 4}),
                        e57_doubles({0, 0, M_PI / 6}), e57_integers(2, {0, 0, 0})});
  const Values values = read_values(maker.finish(
      data3d(e57_scan("", place, 3,
                      "<sphericalRange type=\"Float\"/><sphericalAzimuth type=\"Float\"/>"
                      "<sphericalElevation type=\"Float\"/>"
                      "<sphericalInvalidState type=\"Integer\" minimum=\"0\" maximum=\"2\"/>"))));
  const double far = 2 * std::cos(M_PI / 6) * std::sqrt(0.5);
  const double expected[3][3] = {{2, 0, 0}, {0, 2, 0}, {far, far, 1}};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(values.of.at("x")[i], expected[i][0], 1e-15);
    EXPECT_NEAR(values.of.at("y")[i], expected[i][1], 1e-15);
    EXPECT_NEAR(values.of.at("z")[i], expected[i][2], 1e-15);
  }
  EXPECT_EQ(values.of.count("sphericalInvalidState"), 0u);
}

TEST(E57, InvalidPointsAreLeftOutAndCounted) {
  E57Maker maker;
  const std::uint64_t place = maker.add_points(
      {e57_doubles({1, 2, 3, 4}), e57_doubles({1, 2, 3, 4}), e57_doubles({1, 2, 3, 4}),
       e57_integers(2, {0, 1, 2, 0}), e57_integers(5, {9, 8, 7, 6})});
  const std::string bytes = maker.finish(
      data3d(e57_scan("", place, 4,
                      std::string(kDoubles) +
                          "<cartesianInvalidState type=\"Integer\" minimum=\"0\" maximum=\"2\"/>"
                          "<rowIndex type=\"Integer\" minimum=\"0\" maximum=\"31\"/>")));
  const Values values = read_values(bytes);
  EXPECT_THAT(values.of.at("x"), ElementsAre(1, 4));
  EXPECT_THAT(values.of.at("rowIndex"), ElementsAre(9, 6));
  EXPECT_EQ(values.report.points, 2u);
  EXPECT_EQ(values.report.declared, 4u);
  EXPECT_THAT(values.report.dropped,
              ElementsAre(std::make_pair(std::string("invalid in the file"), std::uint64_t{2})));
  EXPECT_THAT(values.report.invalid_by_scan,
              ElementsAre(std::make_pair(std::size_t{0}, std::uint64_t{2})));
  EXPECT_FALSE(values.header.count);
}

/// Two scans: bytes as colours and 16 bits, an intensity in the first alone.
std::string two_scans() {
  E57Maker maker;
  const std::uint64_t first = maker.add_points(
      {e57_floats({1, 2}), e57_floats({3, 4}), e57_floats({5, 6}), e57_integers(8, {0, 255}),
       e57_integers(8, {51, 1}), e57_integers(8, {7, 9}), e57_floats({0.25f, 0.5f}),
       e57_integers(1, {0, 1})});
  const std::uint64_t second = maker.add_points(
      {e57_doubles({10}), e57_doubles({20}), e57_doubles({30}), e57_integers(16, {40000}),
       e57_integers(16, {1}), e57_integers(16, {65535}), e57_integers(16, {8})});
  const auto color = [](const char* most) {
    std::string out;
    for (const char* const channel : {"Red", "Green", "Blue"}) {
      out += std::string("<color") + channel + " type=\"Integer\" minimum=\"0\" maximum=\"" + most +
             "\"/>";
    }
    return out;
  };
  const std::string singles =
      "<cartesianX type=\"Float\" precision=\"single\"/>"
      "<cartesianY type=\"Float\" precision=\"single\"/>"
      "<cartesianZ type=\"Float\" precision=\"single\"/>";
  return maker.finish(
      data3d(e57_scan("<name type=\"String\">near</name>", first, 2,
                      singles + color("255") +
                          "<intensity type=\"Float\" precision=\"single\"/>"
                          "<isIntensityInvalid type=\"Integer\" minimum=\"0\" maximum=\"1\"/>") +
             e57_scan("<name type=\"String\">far</name>", second, 1,
                      std::string(kDoubles) + color("65535") +
                          "<columnIndex type=\"Integer\" minimum=\"0\" maximum=\"65535\"/>")));
}

TEST(E57, ScansBecomeOneCloud) {
  const std::string bytes = two_scans();
  const Values values = read_values(bytes);
  EXPECT_THAT(values.of.at("x"), ElementsAre(1, 2, 10));
  EXPECT_THAT(values.of.at("scan"), ElementsAre(0, 0, 1));
  EXPECT_THAT(values.of.at("red"), ElementsAre(0, 65535, 40000));
  EXPECT_THAT(values.of.at("green"), ElementsAre(51 * 257, 257, 1));
  EXPECT_EQ(values.type.at("red"), ScalarType::kUint16);
  EXPECT_EQ(values.of.at("intensity")[0], 0.25);
  EXPECT_TRUE(std::isnan(values.of.at("intensity")[1]));  // by its flag
  EXPECT_TRUE(std::isnan(values.of.at("intensity")[2]));
  EXPECT_TRUE(std::isnan(values.of.at("columnIndex")[0]));
  EXPECT_EQ(values.of.at("columnIndex")[2], 8.0);

  ReadOptions options;
  options.scan = 0;
  const Values first = read_values(bytes, options);
  EXPECT_THAT(first.of.at("red"), ElementsAre(0, 255));
  EXPECT_EQ(first.type.at("red"), ScalarType::kUint8);
  EXPECT_EQ(first.of.count("scan"), 0u);
  EXPECT_EQ(first.of.count("columnIndex"), 0u);
  options.scan = 1;
  EXPECT_EQ(read_values(bytes, options).type.at("columnIndex"), ScalarType::kUint16);
  options.scan = 2;
  EXPECT_THAT(read_error(bytes, "a.e57", options), HasSubstr("found 2 scans"));
  options.scan.reset();
  options.own_frame = true;
  EXPECT_THAT(read_error(bytes, "a.e57", options), HasSubstr("each with a frame of its own"));
  options.scan = 0;
  EXPECT_EQ(read_error(bytes, "a.e57", options), "");
  EXPECT_THAT(read_error("1 2 3\n", "a.xyz", options), HasSubstr("expected E57"));
}

TEST(E57, ColoursOfOtherLimits) {
  // Of 12 bits, and of fractions.
  E57Maker maker;
  const std::uint64_t ints = maker.add_points(
      {e57_doubles({1, 2}), e57_doubles({1, 2}), e57_doubles({1, 2}), e57_integers(12, {0, 4095}),
       e57_integers(12, {819, 0}), e57_integers(12, {0, 0})});
  const std::uint64_t floats =
      maker.add_points({e57_doubles({1}), e57_doubles({1}), e57_doubles({1}), e57_doubles({0.2}),
                        e57_doubles({1.0}), e57_doubles({7.0})});
  std::string whole = kDoubles, fractions = kDoubles, limits;
  for (const std::string channel : {"colorRed", "colorGreen", "colorBlue"}) {
    whole += "<" + channel + " type=\"Integer\" minimum=\"0\" maximum=\"4095\"/>";
    fractions += "<" + channel + " type=\"Float\"/>";
    limits += "<" + channel + "Minimum type=\"Float\"/><" + channel + "Maximum type=\"Float\">1</" +
              channel + "Maximum>";
  }
  const Values values = read_values(
      maker.finish(data3d(e57_scan("", ints, 2, whole) +
                          e57_scan("<colorLimits type=\"Structure\">" + limits + "</colorLimits>",
                                   floats, 1, fractions))));
  EXPECT_THAT(values.of.at("red"), ElementsAre(0, 65535, 13107));
  EXPECT_THAT(values.of.at("green"), ElementsAre(13107, 0, 65535));
  EXPECT_THAT(values.of.at("blue"), ElementsAre(0, 0, 65535));  // above its limit
}

TEST(E57, EveryTruncationIsRefused) {
  const std::string whole = small_file();
  ASSERT_EQ(read_values(whole).count, 40u);
  ReadOptions lenient;
  lenient.lenient = true;
  for (std::size_t length = 0; length < whole.size(); ++length) {
    const std::string cut = whole.substr(0, length);
    EXPECT_NE(read_error(cut, "a.e57"), "") << length;
    try {
      EXPECT_LE(read_values(cut, lenient).count, 40u);
    } catch (const InputError& error) {
      EXPECT_EQ(error.exit_code(), 2);
    }
  }
}

TEST(E57, EveryFlippedBitIsRefused) {
  const std::string whole = small_file();
  for (std::size_t byte = 0; byte < whole.size(); ++byte) {
    std::string damaged = whole;
    damaged[byte] = static_cast<char>(damaged[byte] ^ (1 << (byte % 8)));
    EXPECT_NE(read_error(damaged, "a.e57"), "") << "byte " << byte;
  }
  for (std::size_t bit = 0; bit < 48 * 8; ++bit) {
    std::string damaged = whole;
    damaged[bit / 8] = static_cast<char>(damaged[bit / 8] ^ (1 << (bit % 8)));
    EXPECT_NE(read_error(damaged, "a.e57"), "") << "bit " << bit;
  }
}

TEST(E57, WrongPlacesAndSizesAreNamed) {
  const auto file = [](const std::string& scan, std::size_t page = 1024) {
    E57Maker maker(page);
    maker.add_points({e57_doubles({1, 2}), e57_doubles({1, 2}), e57_doubles({1, 2})});
    return maker.finish(data3d(scan));
  };
  EXPECT_EQ(read_values(file(e57_scan("", 48, 2, kDoubles))).count, 2u);
  EXPECT_EQ(read_values(file(e57_scan("", 48, 2, kDoubles), 128)).count, 2u);
  EXPECT_THAT(read_error(file(e57_scan("", 48, 3, kDoubles)), "a.e57"),
              HasSubstr("after 2 records, expected 3"));
  EXPECT_THAT(read_error(file(e57_scan("", 1021, 2, kDoubles)), "a.e57"),
              HasSubstr("byte 1021, expected a place within the file"));
  EXPECT_THAT(read_error(file(e57_scan("", 56, 2, kDoubles)), "a.e57"),
              HasSubstr("byte 56: found a section of kind"));
  EXPECT_THAT(read_error(file(e57_scan("", 48, 2, "<cartesianX type=\"Float\"/>")), "a.e57"),
              HasSubstr("/data3D/0: found no coordinates"));
  EXPECT_THAT(read_error(file(e57_scan("", 48, 2, kDoubles + std::string(kDoubles))), "a.e57"),
              HasSubstr("found a packet of 3 streams"));
  EXPECT_THAT(read_error(file(e57_scan("", 48, 2, "<cartesianX type=\"Integer\" minimum=\"x\"/>")),
                         "a.e57"),
              HasSubstr("/data3D/0/points/prototype/cartesianX/@minimum: found 'x'"));
  EXPECT_THAT(
      read_error(file("<vectorChild><points type=\"CompressedVector\"/></vectorChild>"), "a.e57"),
      HasSubstr("/data3D/0/points/@recordCount"));
  EXPECT_THAT(read_error(file("<vectorChild>"), "a.e57"), HasSubstr("damaged XML"));
  ReadOptions lenient;
  lenient.lenient = true;
  const Values values = read_values(file(e57_scan("", 48, 3, kDoubles)), lenient);
  EXPECT_EQ(values.count, 2u);
  EXPECT_THAT(values.report.dropped,
              ElementsAre(std::make_pair(std::string("truncated"), std::uint64_t{1})));
}

TEST(E57, CountsThatLieTakeNoMemory) {
  for (const char* const prototype :
       {kDoubles,
        "<cartesianX type=\"Integer\" minimum=\"1\" maximum=\"1\"/>"
        "<cartesianY type=\"Integer\" minimum=\"1\" maximum=\"1\"/>"}) {
    E57Maker maker;
    const std::uint64_t place =
        maker.add_points({e57_doubles({1, 2}), e57_doubles({1, 2}), e57_doubles({1, 2})});
    const std::string bytes =
        maker.finish(data3d(e57_scan("", place, std::size_t{1} << 50, prototype)));
    const test::MemoryMeter meter;
    EXPECT_THAT(read_error(bytes, "a.e57"), HasSubstr("1125899906842624 records"));
    EXPECT_LT(meter.peak(), std::size_t{1} << 20);
  }
}

TEST(E57, WritingIsRefused) {
  RoadCloud cloud;
  cloud.points.emplace_back(1.0f, 2.0f, 3.0f);
  const test::TemporaryFolder folder;
  EXPECT_THROW(write_cloud(cloud, folder.path() / "a.e57"), std::invalid_argument);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "a.e57"));
}

// --- files of other programs --------------------------------------------------------------------

double sum(const std::vector<double>& values) {
  // As math.fsum does, near enough: sums of up to 30,000 values.
  long double out = 0.0L;
  for (const double value : values) out += static_cast<long double>(value);
  return static_cast<double>(out);
}

TEST(E57, FilesOfOtherProgramsGiveTheirValues) {
  CAMBER_REQUIRE_DATA("survey-files/expected.json");
  const std::filesystem::path root = test::data_dir() / "survey-files";
  const json expected = json::parse(test::read_text(root / "expected.json")).at("e57");
  std::size_t scans = 0, refused = 0;
  for (const auto& [name, file] : expected.items()) {
    SCOPED_TRACE(name);
    if (file.contains("expect")) {
      ++refused;
      try {
        const Values values = read_values(*open_point_source(root / name));
        EXPECT_NE(file.at("expect"), "refuse");
        EXPECT_EQ(values.count, 0u);
      } catch (const InputError& error) {
        EXPECT_EQ(error.exit_code(), 2);
        for (const json& page : file.at("bad_crc_pages")) {
          if (name.find("length") != std::string::npos) continue;
          EXPECT_THAT(error.what(), HasSubstr("page " + std::to_string(page.get<int>())));
        }
      }
      continue;
    }
    std::size_t valid = 0;
    for (std::size_t s = 0; s < file.at("scans").size(); ++s) {
      SCOPED_TRACE(s);
      ++scans;
      const json& scan = file.at("scans")[s];
      ReadOptions options;
      options.scan = s;
      const Values posed = read_values(*open_point_source(root / name, options));
      options.own_frame = true;
      const Values own = read_values(*open_point_source(root / name, options));
      const auto count = scan.at("valid_points").get<std::size_t>();
      valid += count;
      ASSERT_EQ(posed.count, count);
      ASSERT_EQ(own.count, count);
      const std::uint64_t invalid = posed.report.invalid_by_scan.at(0).second;
      EXPECT_EQ(count + invalid, scan.at("points").get<std::size_t>());
      const char* const axes[] = {"x", "y", "z"};
      for (std::size_t axis = 0; axis < 3 && count > 0; ++axis) {
        SCOPED_TRACE(axes[axis]);
        const std::vector<double>& a = own.of.at(axes[axis]);
        const std::vector<double>& b = posed.of.at(axes[axis]);
        const double low = scan.at("own_min")[axis], high = scan.at("own_max")[axis];
        if (scan.value("from_spherical", false)) {
          EXPECT_NEAR(*std::min_element(a.begin(), a.end()), low, 1e-12);
          EXPECT_NEAR(*std::max_element(a.begin(), a.end()), high, 1e-12);
        } else {
          EXPECT_EQ(*std::min_element(a.begin(), a.end()), low);
          EXPECT_EQ(*std::max_element(a.begin(), a.end()), high);
        }
        // Products and sums of coordinates of millions of metres.
        EXPECT_NEAR(b.front(), scan.at("first_point_posed")[axis].get<double>(), 2e-9);
        EXPECT_NEAR(b.back(), scan.at("last_point_posed")[axis].get<double>(), 2e-9);
        EXPECT_NEAR(*std::min_element(b.begin(), b.end()), scan.at("posed_min")[axis].get<double>(),
                    2e-9);
        EXPECT_NEAR(*std::max_element(b.begin(), b.end()), scan.at("posed_max")[axis].get<double>(),
                    2e-9);
        const double total = scan.at("posed_sum")[axis];
        EXPECT_NEAR(sum(b), total, 1e-12 * std::abs(total) + 1e-9);
      }
      if (invalid > 0 || count == 0) continue;  // values of the file are of all points
      static const std::map<std::string, std::string> kNames = {
          {"intensity", "intensity"},     {"colorRed", "red"},
          {"colorGreen", "green"},        {"colorBlue", "blue"},
          {"rowIndex", "rowIndex"},       {"columnIndex", "columnIndex"},
          {"returnIndex", "returnIndex"}, {"returnCount", "returnCount"},
          {"nor:normalX", "nx"},          {"las:pointSourceId", "point_source_id"}};
      for (const auto& [field, right] : scan.at("values").items()) {
        const auto found = kNames.find(field);
        if (found == kNames.end()) continue;
        SCOPED_TRACE(field);
        const std::vector<double>& values = own.of.at(found->second);
        EXPECT_EQ(*std::min_element(values.begin(), values.end()), right.at("min"));
        EXPECT_EQ(*std::max_element(values.begin(), values.end()), right.at("max"));
        EXPECT_NEAR(sum(values), right.at("sum").get<double>(), 1e-9);
      }
    }
    const Values all = read_values(*open_point_source(root / name));
    EXPECT_EQ(all.count, valid);
    const E57File& e57 = *all.header.e57;
    EXPECT_EQ(e57.guid, file.at("guid"));
    EXPECT_EQ(e57.pages, file.at("pages"));
    if (!file.contains("images")) continue;
    ASSERT_EQ(e57.images.size(), file.at("images").size());
    for (std::size_t i = 0; i < e57.images.size(); ++i) {
      const json& image = file.at("images")[i];
      EXPECT_EQ(e57.images[i].name, image.at("name"));
      EXPECT_EQ(e57.images[i].pose.has_value(), image.contains("pose"));
      const json& representation = image.at("representations")[0];
      std::map<std::string, double> numbers(e57.images[i].numbers.begin(),
                                            e57.images[i].numbers.end());
      for (const auto& [key, value] : representation.items()) {
        if (value.is_number()) {
          EXPECT_EQ(numbers.at(key), value.get<double>()) << key;
        }
        if (value.is_object()) {
          EXPECT_EQ(e57.images[i].length, value.at("length"));
          EXPECT_EQ(e57.images[i].media + "Image", key);
        }
      }
    }
  }
  EXPECT_GE(scans, 14u);
  EXPECT_EQ(refused, 5u);
}

}  // namespace
}  // namespace camber
