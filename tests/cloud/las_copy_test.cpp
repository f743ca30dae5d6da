// From LAS to LAS: what is not meant to change stays byte for byte.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/stream_filters.h"
#include "cloud/cloud_files.h"
#include "cloud/memory_meter.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::put;
using test::read_from_memory;
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

std::string vlr(const std::string& user, std::uint16_t id, const std::string& content,
                bool extended = false) {
  std::string out(extended ? 60 : 54, '\0');
  out.replace(2, user.size(), user);
  set(out, 18, id);
  if (extended) {
    set(out, 20, static_cast<std::uint64_t>(content.size()));
  } else {
    set(out, 20, static_cast<std::uint16_t>(content.size()));
  }
  out.replace(out.size() - 32, 4, "what");
  return out + content;
}

struct Made {
  std::string bytes;
  std::size_t start = 0, record = 0, standard = 0, count = 0, end = 0;
};

constexpr std::size_t kSizes[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};

/// A file of random records in a point format, with three undescribed and four described extra
/// bytes, records before the points, a gap, user bytes in the header, and records behind the
/// points.
Made make_file(int minor, int format) {
  Made m;
  const std::uint16_t header = static_cast<std::uint16_t>((minor == 5   ? 393
                                                           : minor == 4 ? 375
                                                           : minor == 3 ? 235
                                                                        : 227) +
                                                          5);
  std::string h(header, '\7');
  for (std::size_t i = 0; i < h.size() - 5; ++i) h[i] = '\0';
  h.replace(0, 4, "LASF");
  h[24] = 1;
  h[25] = static_cast<char>(minor);
  h.replace(26, 5, "SURVY");
  h.replace(58, 5, "other");
  std::string description(192, '\0');
  description[2] = 5;  // uint32
  description.replace(4, 5, "range");
  std::string unknown(192, '\0');
  unknown[3] = 3;
  std::string keys;
  for (const int v : {1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32617}) {
    put(keys, static_cast<std::uint16_t>(v));
  }
  const std::string records = vlr("someone", 77, "abc") +
                              vlr("LASF_Spec", 4, description + unknown) +
                              vlr("LASF_Projection", 34735, keys);
  const std::string gap = "gap bytes";
  m.standard = kSizes[format];
  m.record = m.standard + 7;
  m.count = 50;
  m.start = header + records.size() + gap.size();
  m.end = m.start + m.record * m.count;
  set(h, 94, header);
  set(h, 96, static_cast<std::uint32_t>(m.start));
  set(h, 100, std::uint32_t{3});
  h[104] = static_cast<char>(format);
  set(h, 105, static_cast<std::uint16_t>(m.record));
  if (format < 6) set(h, 107, static_cast<std::uint32_t>(m.count));
  for (std::size_t axis = 0; axis < 3; ++axis) {
    set(h, 131 + 8 * axis, 0.001);
    set(h, 155 + 8 * axis, 1e5 * static_cast<double>(axis));
    set(h, 179 + 16 * axis, 1.0);  // bounds that do not hold: a copy does not judge them
  }
  std::string tail;
  if (minor >= 3) set(h, 227, static_cast<std::uint64_t>(m.end));
  if (minor == 3) set(h, 6, std::uint16_t{2});  // wave packets within
  if (minor >= 3) tail = vlr("LASF_Spec", 65535, "waveform", true);
  if (minor >= 4) {
    set(h, 235, static_cast<std::uint64_t>(m.end));
    set(h, 243, std::uint32_t{2});
    set(h, 247, static_cast<std::uint64_t>(m.count));
    tail += vlr("LASF_Projection", 2112, "not well known", true);
  }
  tail += "rest";
  std::string points;
  const CounterRandom random(static_cast<std::uint64_t>(format));
  for (std::size_t i = 0; i < m.record * m.count; ++i) {
    points += static_cast<char>(random.below(i, 256));
  }
  m.bytes = h + records + gap + points + tail;
  return m;
}

std::unique_ptr<PointSource> open(const std::string& bytes) {
  return open_point_source(bytes.data(), bytes.size(), "a.las");
}

std::string copy(PointSource& source, CloudFormat format = CloudFormat::kLas) {
  std::ostringstream out;
  const auto sink = make_point_sink(out, source.header(), format, CloudEncoding::kBinary);
  PointBatch batch;
  while (source.next(batch)) sink->write(batch);
  sink->finish();
  return out.str();
}

class LasCopy : public ::testing::TestWithParam<std::pair<int, int>> {
 protected:
  Made made_ = make_file(GetParam().first, GetParam().second);
  int minor() const { return GetParam().first; }
  int format() const { return GetParam().second; }
  std::string point(const std::string& bytes, std::size_t start, std::size_t size,
                    std::size_t i) const {
    return bytes.substr(start + i * size, size);
  }
};

TEST_P(LasCopy, WholeFilesAreByteEqual) {
  const auto source = open(made_.bytes);
  EXPECT_TRUE(copy(*source) == made_.bytes);
}

TEST_P(LasCopy, CompressedAndBackTheyAreByteEqual) {
  const std::string laz = copy(*open(made_.bytes), CloudFormat::kLaz);
  EXPECT_EQ(static_cast<unsigned char>(laz[104]), format() | 0x80);
  const auto source = open(laz);
  EXPECT_EQ(source->report().format, CloudFormat::kLaz);
  EXPECT_TRUE(copy(*source) == made_.bytes);
  EXPECT_TRUE(copy(*open(laz), CloudFormat::kLaz) == laz);
  // Some points: their extended records move with the end of the points.
  std::size_t index = 0;
  const auto select = [&](const std::string& bytes) {
    index = 0;
    return select_points(open(bytes), [&](const Eigen::Vector3d&) { return index++ % 3 == 0; });
  };
  const std::string some = copy(*select(laz), CloudFormat::kLaz);
  EXPECT_TRUE(copy(*open(some)) == copy(*select(made_.bytes)));
}

TEST_P(LasCopy, SomePointsKeepTheirRecordsAndTheFileItsOthers) {
  std::size_t index = 0;
  auto source =
      select_points(open(made_.bytes), [&](const Eigen::Vector3d&) { return index++ % 3 == 0; });
  const std::string out = copy(*source);
  const std::size_t left = 17;
  ASSERT_EQ(out.size(), made_.bytes.size() - (made_.count - left) * made_.record);
  for (std::size_t i = 0; i < left; ++i) {
    EXPECT_EQ(point(out, made_.start, made_.record, i),
              point(made_.bytes, made_.start, made_.record, 3 * i));
  }
  const std::size_t end = made_.start + left * made_.record;
  EXPECT_EQ(out.substr(end), made_.bytes.substr(made_.end));
  // Records before the points, the gap, and the header but for counts, bounds and places.
  const std::size_t header = get<std::uint16_t>(out, 94);
  EXPECT_EQ(out.substr(header, made_.start - header),
            made_.bytes.substr(header, made_.start - header));
  EXPECT_EQ(out.substr(0, 107), made_.bytes.substr(0, 107));
  EXPECT_EQ(out.substr(131, 48), made_.bytes.substr(131, 48));
  if (format() < 6) {
    EXPECT_EQ(get<std::uint32_t>(out, 107), left);
  }
  if (minor() >= 3) {
    EXPECT_EQ(get<std::uint64_t>(out, 227), end);
  }
  if (minor() >= 4) {
    EXPECT_EQ(get<std::uint64_t>(out, 235), end);
    EXPECT_EQ(get<std::uint64_t>(out, 247), left);
  }
  // Counts by return leave out what has the number 0.
  std::array<std::uint64_t, 16> by_return{};
  double low = 1e300, high = -1e300;
  for (std::size_t i = 0; i < left; ++i) {
    const std::size_t at = made_.start + i * made_.record;
    ++by_return[static_cast<unsigned char>(out[at + 14]) & (format() < 6 ? 7u : 15u)];
    const double x = get<std::int32_t>(out, at) * 0.001;
    low = std::min(low, x);
    high = std::max(high, x);
  }
  std::uint64_t counted = 0;
  for (std::size_t r = 1; r <= (minor() >= 4 ? 15u : 5u); ++r) {
    EXPECT_EQ(
        minor() >= 4 ? get<std::uint64_t>(out, 247 + 8 * r) : get<std::uint32_t>(out, 107 + 4 * r),
        by_return[r])
        << "return " << r;
    counted += by_return[r];
  }
  EXPECT_GT(counted, 0u);
  EXPECT_DOUBLE_EQ(get<double>(out, 179), high);
  EXPECT_DOUBLE_EQ(get<double>(out, 187), low);
}

TEST_P(LasCopy, ANewAttributeIsAppended) {
  std::vector<int> patches;
  for (std::size_t i = 0; i < made_.count; ++i) patches.push_back(static_cast<int>(i) - 7);
  const auto source = add_label(open(made_.bytes), "patch", patches);
  const std::string out = copy(*source);
  const auto again = open(out);
  const LasFile& las = *again->header().las;
  ASSERT_EQ(las.record_length, made_.record + 4);
  EXPECT_EQ(las.described_length(), las.extra_length());
  for (std::size_t i = 0; i < made_.count; ++i) {
    const std::string row = point(out, las.points_start, las.record_length, i);
    EXPECT_EQ(row.substr(0, made_.record), point(made_.bytes, made_.start, made_.record, i));
    EXPECT_EQ(get<std::int32_t>(row, made_.record), patches[i]);
  }
  EXPECT_EQ(out.substr(las.points_end), made_.bytes.substr(made_.end));
  EXPECT_EQ(read_from_memory(out, "a.las").cloud.labels.at("patch"), patches);
  // A second time it is written over.
  for (int& patch : patches) patch = 5 - patch;
  const auto relabelled = add_label(open(out), "patch", patches);
  const std::string third = copy(*relabelled);
  EXPECT_EQ(third.size(), out.size());
  EXPECT_EQ(read_from_memory(third, "a.las").cloud.labels.at("patch"), patches);
}

TEST_P(LasCopy, ClassesOfTheGroundAreAllThatChanges) {
  std::vector<int> ground;
  for (std::size_t i = 0; i < made_.count; ++i) ground.push_back(static_cast<int>(i % 3) - 1);
  const auto source = classify_ground(open(made_.bytes), ground);
  const std::string out = copy(*source);
  ASSERT_EQ(out.size(), made_.bytes.size());
  const std::size_t place = format() < 6 ? 15 : 16;
  std::string expected = made_.bytes;
  for (std::size_t i = 0; i < made_.count; ++i) {
    char& byte = expected[made_.start + i * made_.record + place];
    const unsigned mask = format() < 6 ? 31u : 255u;
    const unsigned before = static_cast<unsigned char>(byte) & mask;
    const unsigned after = ground[i] < 0                  ? before
                           : ground[i] > 0                ? 2u
                           : before == 0u || before == 2u ? 1u
                                                          : before;
    byte = static_cast<char>((static_cast<unsigned char>(byte) & ~mask) | after);
  }
  EXPECT_TRUE(out == expected);
}

TEST_P(LasCopy, AGivenCoordinateSystemTakesThePlaceOfTheOldOne) {
  ReadOptions options;
  CoordinateSystem given = coordinate_system_from_wkt(
      "PROJCS[\"mine\",UNIT[\"foot\",0.3048],AUTHORITY[\"EPSG\",\"2994\"]]");
  given.given = true;
  options.crs = given;
  const auto source = open_point_source(made_.bytes.data(), made_.bytes.size(), "a.las", options);
  EXPECT_FALSE(source->header().metric);
  const std::string out = copy(*source);
  const auto again = open(out);
  const CoordinateSystem& crs = again->header().las->crs;
  EXPECT_EQ(crs.epsg, 2994);
  EXPECT_EQ(crs.horizontal.name, "foot");
  EXPECT_EQ(crs.wkt.empty(), format() < 6);
  EXPECT_EQ(out.substr(again->header().las->points_start, made_.end - made_.start),
            made_.bytes.substr(made_.start, made_.end - made_.start));
}

TEST_P(LasCopy, DamagedRecordsAreErrorsOrNotes) {
  // Cut at every length: a sentence, or all points.
  for (std::size_t cut = 0; cut < made_.bytes.size(); cut += 13) {
    const std::string bytes = made_.bytes.substr(0, cut);
    ReadOptions lenient;
    lenient.lenient = true;
    try {
      EXPECT_EQ(read_from_memory(bytes, "a.las").cloud.size(), made_.count) << cut;
    } catch (const InputError&) {
    }
    try {
      read_from_memory(bytes, "a.las", lenient);
    } catch (const InputError&) {
    }
  }
  if (minor() < 4) return;
  std::string bytes = made_.bytes;
  set(bytes, made_.end + 20, ~std::uint64_t{0});
  EXPECT_THAT(test::read_error(bytes, "a.las"), HasSubstr("found extended record 1 with 1844674"));
  bytes = made_.bytes;
  set(bytes, 243, std::uint32_t{0xffffffff});
  EXPECT_THAT(test::read_error(bytes, "a.las"), HasSubstr("no room for extended record 3"));
  bytes = made_.bytes;
  set(bytes, 235, std::uint64_t{10});
  EXPECT_THAT(test::read_error(bytes, "a.las"), HasSubstr("no room for extended record 1"));
}

INSTANTIATE_TEST_SUITE_P(Formats, LasCopy,
                         ::testing::Values(std::pair(0, 0), std::pair(1, 1), std::pair(2, 2),
                                           std::pair(2, 3), std::pair(3, 4), std::pair(3, 5),
                                           std::pair(4, 6), std::pair(4, 7), std::pair(4, 8),
                                           std::pair(4, 9), std::pair(4, 10), std::pair(4, 3),
                                           std::pair(5, 7)),
                         [](const auto& instance) {
                           return "Version" + std::to_string(instance.param.first) + "Format" +
                                  std::to_string(instance.param.second);
                         });

/// A file whose extra bytes two programs have described, each in a record of its own.
/// @param second  descriptions of the second record
/// @param behind  the second record is one behind the points
std::string two_descriptions(const std::string& second, bool behind) {
  constexpr std::size_t kPoints = 5, kRecord = 20 + 3, kHeader = 375;
  const auto record = [](const std::string& content, bool extended) {
    std::string out(extended ? 60 : 54, '\0');
    out.replace(2, 9, "LASF_Spec");
    out[18] = 4;
    set(out, 20, static_cast<std::uint16_t>(content.size()));
    return out + content;
  };
  const std::string first = detail::describe_extra_bytes("Deviation", ScalarType::kUint16);
  std::string h(kHeader, '\0');
  h.replace(0, 4, "LASF");
  h[24] = 1;
  h[25] = 4;
  set(h, 94, static_cast<std::uint16_t>(kHeader));
  h[100] = behind ? 1 : 2;
  set(h, 105, static_cast<std::uint16_t>(kRecord));
  set(h, 107, static_cast<std::uint32_t>(kPoints));
  set(h, 247, static_cast<std::uint64_t>(kPoints));
  for (std::size_t axis = 0; axis < 3; ++axis) set(h, 131 + 8 * axis, 0.01);
  std::string records = record(first, false), points(kPoints * kRecord, '\0'), tail;
  (behind ? tail : records) += record(second, behind);
  for (std::size_t i = 0; i < kPoints; ++i) {
    set(points, i * kRecord, static_cast<std::int32_t>(100 * i));
    set(points, i * kRecord + 20, static_cast<std::uint16_t>(1000 + i));
    points[i * kRecord + 22] = static_cast<char>(50 + i);
  }
  set(h, 96, static_cast<std::uint32_t>(kHeader + records.size()));
  if (behind) {
    set(h, 235, static_cast<std::uint64_t>(kHeader + records.size() + points.size()));
    h[243] = 1;
  }
  return h + records + points + tail;
}

TEST(LasExtraBytes, OfTwoRecordsAreAllThereAndOneDescribesThemWhereOneIsAdded) {
  const std::string confidence = detail::describe_extra_bytes("confidence", ScalarType::kUint8);
  const std::string both =
      detail::describe_extra_bytes("Deviation", ScalarType::kUint16) + confidence;
  for (const std::string& second : {confidence, both}) {
    for (const bool behind : {false, true}) {
      const std::string bytes = two_descriptions(second, behind);
      const CloudFile file = read_from_memory(bytes, "a.las");
      EXPECT_EQ(file.cloud.labels.at("Deviation"),
                (std::vector<int>{1000, 1001, 1002, 1003, 1004}));
      EXPECT_EQ(file.cloud.labels.at("confidence"), (std::vector<int>{50, 51, 52, 53, 54}));
      EXPECT_EQ(copy(*open(bytes)), bytes);
      const std::vector<int> patches = {3, 1, 4, 1, 5};
      const std::string out = copy(*add_label(open(bytes), "patch", patches));
      const auto again = open(out);
      const LasFile& las = *again->header().las;
      EXPECT_EQ(las.record_length, 20u + 3u + 4u);
      int describing = 0;
      for (const LasRecord& r : las.records) {
        if (r.user_id != "LASF_Spec" || r.record_id != 4) continue;
        ++describing;
        EXPECT_EQ(r.length, 3u * 192u);
        EXPECT_FALSE(r.extended);
      }
      EXPECT_EQ(describing, 1);
      EXPECT_EQ(las.described_length(), las.extra_length());
      const CloudFile labelled = read_from_memory(out, "a.las");
      EXPECT_EQ(labelled.cloud.labels.at("confidence"), file.cloud.labels.at("confidence"));
      EXPECT_EQ(labelled.cloud.labels.at("patch"), patches);
    }
  }
}

TEST(LasRows, InAnotherOrderWithNormals) {
  const Made made = make_file(4, 7);
  const auto source = open(made.bytes);
  const std::string records = made.bytes.substr(made.start, made.end - made.start);
  const std::vector<Eigen::Vector3f> normals = {{0, 0, 1}, {1, 0, 0}};
  const auto rows = add_normals(make_las_rows(source->header(), records, {49, 3}), normals);
  const std::string out = copy(*rows);
  const auto again = open(out);
  const LasFile& las = *again->header().las;
  EXPECT_EQ(las.points, 2u);
  EXPECT_EQ(out.substr(las.points_start, made.record),
            made.bytes.substr(made.start + 49 * made.record, made.record));
  EXPECT_EQ(read_from_memory(out, "a.las").cloud.normals, normals);
}

TEST(LasCopyStream, LargeFilesNeedLittleMemory) {
  // 48 MB of points, with 20 MB behind them.
  Made made = make_file(4, 6);
  const std::size_t times = 26000;
  const std::string block = made.bytes.substr(made.start, made.end - made.start);
  const std::string head = made.bytes.substr(0, made.start);
  std::string tail = vlr("LASF_Spec", 65535, std::string(20 << 20, 'w'), true);
  std::string bytes = head;
  for (std::size_t i = 0; i < times; ++i) bytes += block;
  const std::uint64_t end = bytes.size();
  bytes += tail;
  set(bytes, 247, static_cast<std::uint64_t>(times * made.count));
  set(bytes, 227, end);
  set(bytes, 235, end);
  set(bytes, 243, std::uint32_t{1});
  const test::TemporaryFolder folder;
  const std::filesystem::path in = folder.path() / "in.las", out = folder.path() / "out.las";
  std::ofstream(in, std::ios::binary) << bytes;
  {
    test::MemoryMeter meter;
    write_points(*open_point_source(in), out);
    EXPECT_LT(meter.peak(), std::size_t{6} << 20);
  }
  EXPECT_TRUE(test::read_text(out) == bytes);
}

TEST(LasWriter, OtherCloudsGetTheirCoordinateSystem) {
  RoadCloud cloud;
  cloud.points = {{1, 2, 3}};
  for (const bool extended : {false, true}) {
    if (extended) cloud.labels["classification"] = {2};
    const auto source = make_point_source(cloud);
    PointStreamHeader header = source->header();
    header.crs = coordinate_system_from_wkt(
        "PROJCS[\"mine\",UNIT[\"metre\",1],AUTHORITY[\"EPSG\",\"32617\"]]");
    std::ostringstream out;
    const auto sink = make_point_sink(out, header, CloudFormat::kLas, CloudEncoding::kBinary);
    PointBatch batch;
    while (source->next(batch)) sink->write(batch);
    sink->finish();
    const std::string bytes = out.str();
    const auto again = open(bytes);
    EXPECT_EQ(again->header().las->crs.epsg, 32617);
    EXPECT_EQ(again->header().las->crs.wkt.empty(), !extended);
    EXPECT_EQ((get<std::uint16_t>(bytes, 6) & 16) != 0, extended);
  }
}

TEST(KittiBin, MapCoordinatesAreShiftedAndItIsSaid) {
  RoadCloud cloud;
  cloud.origin = {405000, 3276000, 0};
  cloud.points = {{101.375f, 400.0625f, 37.5f}, {199.25f, 498.125f, 55.25f}};
  std::ostringstream out;
  const auto source = make_point_source(cloud);
  const auto sink =
      make_point_sink(out, source->header(), CloudFormat::kKittiBin, CloudEncoding::kBinary);
  PointBatch batch;
  while (source->next(batch)) sink->write(batch);
  sink->finish();
  ASSERT_EQ(sink->notes().size(), 1u);
  EXPECT_THAT(sink->notes()[0], HasSubstr("relative to 405000 3276000 0"));
  const std::string bytes = out.str();
  EXPECT_EQ(get<float>(bytes, 0), 101.375f);
  EXPECT_EQ(get<float>(bytes, 16 + 4), 498.125f);
  EXPECT_EQ(get<float>(bytes, 16 + 8), 55.25f);
  // Scans stay as they are.
  cloud.origin.setZero();
  EXPECT_EQ(get<float>(test::write_to_memory(cloud, CloudFormat::kKittiBin), 0), 101.375f);
}

}  // namespace
}  // namespace camber
