#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "camber/cloud/cloud_summary.h"
#include "cloud/cloud_files.h"
#include "cloud/memory_meter.h"

namespace camber {
namespace {

using test::read_error;
using test::read_from_memory;
using test::write_to_memory;
using ::testing::HasSubstr;

template <typename T>
void set(std::string& bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}
template <typename T>
T get(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

/// A header for hand-made points, and as many zero bytes as they take.
std::string make_las(int minor, int format, std::uint16_t record_size, std::uint32_t count) {
  const std::uint16_t header_size = minor == 4 ? 375 : minor == 3 ? 235 : 227;
  std::string h(header_size, '\0');
  h.replace(0, 4, "LASF");
  h[24] = 1;
  h[25] = static_cast<char>(minor);
  set(h, 94, header_size);
  set(h, 96, static_cast<std::uint32_t>(header_size));
  h[104] = static_cast<char>(format);
  set(h, 105, record_size);
  set(h, 107, count);
  if (minor == 4) set(h, 247, static_cast<std::uint64_t>(count));
  for (int axis = 0; axis < 3; ++axis) {
    set(h, 131 + 8 * static_cast<std::size_t>(axis), 0.01);
    set(h, 155 + 8 * static_cast<std::size_t>(axis), 10.0 * axis);
  }
  return h + std::string(std::size_t{record_size} * count, '\0');
}

TEST(Las, OldPointFormatsByHand) {
  std::string bytes = make_las(2, 3, 36, 1);  // two extra bytes that nothing describes
  const std::size_t p = 227;
  set(bytes, p, std::int32_t{-100});
  set(bytes, p + 4, std::int32_t{200});
  set(bytes, p + 8, std::int32_t{300});
  set(bytes, p + 12, std::uint16_t{777});
  set(bytes, p + 14, static_cast<std::uint8_t>(2 | 3 << 3 | 1 << 6));
  set(bytes, p + 15, static_cast<std::uint8_t>(9 | 5 << 5));
  set(bytes, p + 16, std::int8_t{-12});
  set(bytes, p + 17, std::uint8_t{200});
  set(bytes, p + 18, std::uint16_t{4321});
  set(bytes, p + 20, 0.5);
  set(bytes, p + 28, std::uint16_t{65535});
  set(bytes, p + 30, std::uint16_t{256});
  set(bytes, p + 32, std::uint16_t{0});
  const CloudFile file = read_from_memory(bytes, "a.las");
  ASSERT_EQ(file.cloud.size(), 1u);
  EXPECT_EQ(file.cloud.points[0], Eigen::Vector3f(-1, 12, 23));
  EXPECT_EQ(file.cloud.colors[0], (std::array<std::uint8_t, 3>{255, 1, 0}));
  const auto label = [&](const char* name) { return file.cloud.labels.at(name).at(0); };
  EXPECT_EQ(label("intensity"), 777);
  EXPECT_EQ(label("return_number"), 2);
  EXPECT_EQ(label("number_of_returns"), 3);
  EXPECT_EQ(label("scan_direction_flag"), 1);
  EXPECT_EQ(label("edge_of_flight_line"), 0);
  EXPECT_EQ(label("classification"), 9);
  EXPECT_EQ(label("class_flags"), 5);
  EXPECT_EQ(label("scan_angle_rank"), -12);
  EXPECT_EQ(label("user_data"), 200);
  EXPECT_EQ(label("point_source_id"), 4321);
  EXPECT_EQ(file.cloud.scalars.at("gps_time"), std::vector<float>({0.5f}));
  ASSERT_EQ(file.report.notes.size(), 1u);
  EXPECT_THAT(file.report.notes[0], HasSubstr("2 extra bytes"));
}

TEST(Las, NewPointFormatsByHand) {
  std::string bytes = make_las(4, 8, 38, 1);
  const std::size_t p = 375;
  set(bytes, p + 14, static_cast<std::uint8_t>(5 | 12 << 4));
  set(bytes, p + 15, static_cast<std::uint8_t>(9 | 2 << 4 | 1 << 7));
  set(bytes, p + 16, std::uint8_t{200});
  set(bytes, p + 18, std::int16_t{-5000});
  set(bytes, p + 22, 1e9 + 0.25);
  set(bytes, p + 36, std::uint16_t{999});
  const CloudFile file = read_from_memory(bytes, "a.las");
  const auto label = [&](const char* name) { return file.cloud.labels.at(name).at(0); };
  EXPECT_EQ(label("return_number"), 5);
  EXPECT_EQ(label("number_of_returns"), 12);
  EXPECT_EQ(label("class_flags"), 9);
  EXPECT_EQ(label("scanner_channel"), 2);
  EXPECT_EQ(label("scan_direction_flag"), 0);
  EXPECT_EQ(label("edge_of_flight_line"), 1);
  EXPECT_EQ(label("classification"), 200);
  EXPECT_EQ(label("nir"), 999);
  EXPECT_FLOAT_EQ(file.cloud.scalars.at("scan_angle")[0], -30.0f);
  // A stream keeps what a float does not hold.
  const CloudSummary summary = summarise(*open_point_source(bytes.data(), bytes.size(), "a.las"));
  for (const AttributeSummary& attribute : summary.attributes) {
    if (attribute.name == "gps_time") {
      EXPECT_EQ(attribute.maximum, 1e9 + 0.25);
    }
  }
}

TEST(Las, EveryPointFormatHasItsSize) {
  const int sizes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
  for (int format = 0; format <= 10; ++format) {
    const int minor = format >= 6 ? 4 : format >= 4 ? 3 : 2;
    const std::uint16_t size = static_cast<std::uint16_t>(sizes[format]);
    EXPECT_EQ(read_from_memory(make_las(minor, format, size, 3), "a.las").cloud.size(), 3u);
    EXPECT_THAT(
        read_error(make_las(minor, format, static_cast<std::uint16_t>(size - 1), 3), "a.las"),
        HasSubstr("expected at least " + std::to_string(size)));
  }
}

TEST(Las, HeadersThatLieAreErrorsBeforeMemoryIsTaken) {
  const auto changed = [](std::size_t at, auto value, int minor = 2) {
    std::string bytes = make_las(minor, 0, 20, 2);
    set(bytes, at, value);
    return bytes;
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const struct {
    std::string bytes;
    const char* message;
  } cases[] = {
      {"LASF", "expected a LAS header of 227 bytes"},
      {changed(107, std::uint32_t{0xffffffff}), "after at most 2 points, expected 4294967295"},
      {changed(24, std::uint8_t{2}), "byte 24: found LAS version 2.2"},
      {changed(25, std::uint8_t{6}), "byte 24: found LAS version 1.6"},
      {changed(94, std::uint16_t{100}), "byte 94: found a header size of 100"},
      {changed(94, std::uint16_t{60000}), "byte 94: found a header size of 60000"},
      {changed(96, std::uint32_t{100}), "byte 96: found points starting at byte 100"},
      {changed(96, std::uint32_t{0xffffffff}), "byte 96: found points starting at byte 4294967295"},
      {changed(100, std::uint32_t{0xffffffff}), "found no room for record 1"},
      {changed(104, std::uint8_t{11}), "byte 104: found point format 11"},
      {changed(104, std::uint8_t{0x80}),
       "byte 104: found compressed points (LAZ) without LASzip's"},
      {changed(131, 0.0), "byte 131: found scale 0"},
      {changed(139, nan), "byte 139: found scale nan"},
      {changed(155, std::numeric_limits<double>::infinity()), "byte 131: found scale"},
      {changed(247, std::uint64_t{1} << 60, 4), "byte 247: found 1152921504606846976 points"},
  };
  for (const auto& c : cases) {
    test::MemoryMeter meter;
    EXPECT_THAT(read_error(c.bytes, "a.las"), HasSubstr(c.message));
    EXPECT_LT(meter.peak(), 100000u) << c.message;
  }
  std::string large = changed(247, std::uint64_t{1} << 60, 4);
  set(large, 107, std::uint32_t{0});
  EXPECT_THAT(read_error(large, "a.las"), HasSubstr("after at most 2 points"));
  ReadOptions lenient;
  lenient.lenient = true;
  EXPECT_EQ(read_from_memory(large, "a.las", lenient).report.declared, std::uint64_t{1} << 60);
}

TEST(Las, ExtraBytesWithScaleArraysAndNames) {
  std::string bytes = make_las(4, 0, 20 + 2 + 6 + 3, 1);
  const auto describe = [](int type, int options, const std::string& name) {
    std::string d(192, '\0');
    d[2] = static_cast<char>(type);
    d[3] = static_cast<char>(options);
    d.replace(4, name.size(), name);
    return d;
  };
  std::string scaled = describe(4, 0x18, "height");  // int16, scale and offset
  set(scaled, 112, 0.5);
  set(scaled, 136, 100.0);
  const std::string descriptions =
      scaled + describe(23, 0, "xyz") + describe(0, 3, "unknown");  // three uint16; three bytes
  std::string record(54, '\0');
  record.replace(2, 9, "LASF_Spec");
  set(record, 18, std::uint16_t{4});
  set(record, 20, static_cast<std::uint16_t>(descriptions.size()));
  bytes.insert(375, record + descriptions);
  set(bytes, 96, static_cast<std::uint32_t>(375 + record.size() + descriptions.size()));
  set(bytes, 100, std::uint32_t{1});
  const std::size_t extra = bytes.size() - 11;
  set(bytes, extra, std::int16_t{-8});
  set(bytes, extra + 2, std::uint16_t{1});
  set(bytes, extra + 4, std::uint16_t{2});
  set(bytes, extra + 6, std::uint16_t{3});
  const RoadCloud cloud = read_from_memory(bytes, "a.las").cloud;
  EXPECT_EQ(cloud.scalars.at("height"), std::vector<float>({96.0f}));
  EXPECT_EQ(cloud.labels.at("xyz_2"), std::vector<int>({3}));
  EXPECT_EQ(cloud.labels.count("unknown"), 0u);
  set(bytes, 105, std::uint16_t{20 + 10});
  EXPECT_THAT(read_error(bytes, "a.las"), HasSubstr("expected the 11 that are described"));
}

TEST(Las, TimesOfAnotherFormatKeepTheirKind) {
  const auto kind = [](double time) {
    PointStreamHeader header;
    for (const char* const name : {"x", "y", "z", "gps_time"}) {
      PointField field;
      field.name = name;
      field.type = ScalarType::kFloat64;
      header.fields.push_back(field);
    }
    const double values[] = {1.0, 2.0, 3.0, time};
    PointBatch batch;
    batch.count = 1;
    for (const double& value : values) {
      batch.fields.push_back({reinterpret_cast<const unsigned char*>(&value), sizeof value});
    }
    std::ostringstream out;
    const auto sink = make_point_sink(out, header, CloudFormat::kLas, CloudEncoding::kBinary);
    sink->write(batch);
    sink->finish();
    EXPECT_EQ(get<double>(out.str(), out.str().size() - 8), time);
    return get<std::uint16_t>(out.str(), 6) & 1;
  };
  EXPECT_EQ(kind(3.9e8), 1);
  EXPECT_EQ(kind(-2.5e8), 1);
  EXPECT_EQ(kind(604799.5), 0);
  EXPECT_EQ(kind(0.0), 0);
}

TEST(Las, WriterFillsTheHeader) {
  RoadCloud cloud;
  cloud.points = {{1.0f, -2.0f, 3.0f}, {4.0f, 5.0f, -6.0f}};
  const std::string bytes = write_to_memory(cloud, CloudFormat::kLas);
  EXPECT_EQ(bytes.size(), 227u + 2 * 20);
  EXPECT_EQ(bytes[25], 2);
  EXPECT_EQ(get<std::uint32_t>(bytes, 107), 2u);
  EXPECT_EQ(get<std::uint32_t>(bytes, 111), 2u);
  EXPECT_DOUBLE_EQ(get<double>(bytes, 179), 4.0);
  EXPECT_DOUBLE_EQ(get<double>(bytes, 187), 1.0);
  EXPECT_DOUBLE_EQ(get<double>(bytes, 211), 3.0);
  EXPECT_DOUBLE_EQ(get<double>(bytes, 219), -6.0);
  cloud.labels["classification"] = {2, 65};
  const std::string extended = write_to_memory(cloud, CloudFormat::kLas);
  EXPECT_EQ(extended[25], 4);
  EXPECT_EQ(extended[104], 6);
  EXPECT_EQ(get<std::uint32_t>(extended, 107), 0u);
  EXPECT_EQ(get<std::uint64_t>(extended, 247), 2u);
  EXPECT_EQ(read_from_memory(extended, "a").cloud.labels.at("classification"),
            std::vector<int>({2, 65}));
  cloud.points[1].x() = 3e5f;
  EXPECT_THROW(write_to_memory(cloud, CloudFormat::kLas), std::invalid_argument);
}

/// Multiples of 1/32 m from 629 km on, half of which lie half-way between two steps of a file, as
/// a file keeps them: whole steps from zero. @param first  m, of the point that chooses the offset
std::vector<std::int64_t> kept_steps(double first) {
  std::string text = std::to_string(first) + " 0 0\n";
  constexpr int kCount = 2000;
  for (int k = 0; k < kCount; ++k) {
    char line[64];
    std::snprintf(line, sizeof line, "%.5f 0 0\n", 629000.0 + k / 32.0);
    text += line;
  }
  const auto source = open_point_source(text.data(), text.size(), "a.xyz");
  std::ostringstream out;
  const auto sink =
      make_point_sink(out, source->header(), CloudFormat::kLas, CloudEncoding::kBinary);
  for (PointBatch batch; source->next(batch);) sink->write(batch);
  sink->finish();
  const std::string bytes = out.str();
  const double scale = get<double>(bytes, 131), offset = get<double>(bytes, 155);
  std::vector<std::int64_t> steps;
  for (int k = 1; k <= kCount; ++k) {
    const std::size_t at = get<std::uint32_t>(bytes, 96) +
                           get<std::uint16_t>(bytes, 105) * static_cast<std::size_t>(k);
    steps.push_back(get<std::int32_t>(bytes, at) + std::llround(offset / scale));
  }
  return steps;
}

TEST(Las, HalvesOfAStepAreRoundedAlikeWithEveryOffset) {
  const std::vector<std::int64_t> near = kept_steps(629000.0);
  EXPECT_EQ(kept_steps(655321.0), near);
  EXPECT_EQ(kept_steps(601000.0), near);
}

TEST(Las, ToLasKeepsTheGridAndEveryAttribute) {
  std::string bytes = make_las(4, 7, 36, 500);
  const CounterRandom random(5);
  for (std::size_t i = 0; i < 500 * 36; ++i) {
    bytes[375 + i] = static_cast<char>(random.below(i, 256));
  }
  for (std::size_t i = 0; i < 500; ++i)
    set(bytes, 375 + 36 * i + 22, 1e8 + 0.125 * static_cast<double>(i));
  std::ostringstream out;
  const auto source = open_point_source(bytes.data(), bytes.size(), "a.las");
  const auto sink =
      make_point_sink(out, source->header(), CloudFormat::kLas, CloudEncoding::kBinary);
  PointBatch batch;
  while (source->next(batch)) sink->write(batch);
  sink->finish();
  // All bytes of the points, but angles beyond +-180 degrees, return to what they were.
  const std::string back = out.str();
  ASSERT_EQ(back.size(), bytes.size());
  for (std::size_t i = 0; i < 500; ++i) {
    for (std::size_t b = 0; b < 36; ++b) {
      const std::size_t at = 375 + 36 * i + b;
      const bool angle = b == 18 || b == 19;
      if (angle && std::abs(get<std::int16_t>(bytes, 375 + 36 * i + 18)) > 30000) continue;
      ASSERT_EQ(back[at], bytes[at]) << "point " << i << " byte " << b;
    }
  }
}

}  // namespace
}  // namespace camber
