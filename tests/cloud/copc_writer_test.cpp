// COPC files that are written: read by a second description of the format, and by Camber's own
// reader.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <map>
#include <set>
#include <sstream>

#include "camber/cloud/detail/las_format.h"
#include "camber/cloud/detail/laz/copc_index.h"
#include "camber/cloud/detail/laz/octree_sort.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "cloud/laz_maker.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

template <typename T>
T number_at(const std::string& bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

std::string written(PointSource& source, CloudFormat format, CloudEncoding encoding,
                    std::vector<std::string>* notes = nullptr) {
  std::ostringstream out;
  const auto sink = make_point_sink(out, source.header(), format, encoding);
  PointBatch batch;
  while (source.next(batch)) sink->write(batch);
  sink->finish();
  if (notes != nullptr) *notes = sink->notes();
  return out.str();
}

std::string copc_of(const std::string& las, std::vector<std::string>* notes = nullptr) {
  const auto source = open_point_source(las.data(), las.size(), "a.las");
  return written(*source, CloudFormat::kLaz, CloudEncoding::kOctree, notes);
}

/// The records of a file, as many as it has.
std::vector<std::string> records_in(const std::string& bytes, const ReadOptions& options = {}) {
  const auto source = open_point_source(bytes.data(), bytes.size(), "a.laz", options);
  std::vector<std::string> out;
  PointBatch batch;
  while (source->next(batch)) {
    for (std::size_t i = 0; i < batch.count; ++i) {
      out.emplace_back(reinterpret_cast<const char*>(batch.records.data + i * batch.records.stride),
                       source->header().las->record_length);
    }
  }
  return out;
}

std::vector<std::string> sorted(std::vector<std::string> records) {
  std::sort(records.begin(), records.end());
  return records;
}

/// Hills of 1000 m by 700 m, in the grid of a map, denser in one corner, with trees.
RoadCloud make_terrain(std::size_t count) {
  const CounterRandom random(11);
  RoadCloud cloud;
  cloud.origin = Eigen::Vector3d(432000.0, 5410000.0, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    const auto draw = [&](std::uint64_t k) { return random.uniform(10 * i + k); };
    const bool dense = draw(0) < 0.3;
    const double x = (dense ? 100.0 : 1000.0) * draw(1), y = (dense ? 100.0 : 700.0) * draw(2);
    const bool tree = draw(3) < 0.1;
    const double z = 300.0 + 20.0 * std::sin(x / 150.0) * std::cos(y / 200.0) +
                     (tree ? 15.0 * draw(4) : 0.02 * draw(4));
    cloud.points.push_back(Eigen::Vector3d(x, y, z).cast<float>());
    cloud.colors.push_back({static_cast<std::uint8_t>(255 * draw(5)), 90, 7});
    cloud.labels["classification"].push_back(tree ? 5 : 2);
    cloud.labels["return_number"].push_back(1 + (draw(6) < 0.2 ? 1 : 0));
    cloud.labels["number_of_returns"].push_back(2);
    cloud.scalars["gps_time"].push_back(static_cast<float>(i) / 1024.0f);
  }
  return cloud;
}

std::string las_of(const RoadCloud& cloud) {
  const auto source = make_point_source(cloud);
  return written(*source, CloudFormat::kLas, CloudEncoding::kBinary);
}

/// The nodes of a COPC file, by the text of the specification.
struct Copc {
  struct Node {
    std::array<std::int32_t, 4> key{};  // level, x, y, z
    std::uint64_t start = 0;
    std::int32_t size = 0, points = 0;
  };
  std::array<double, 3> centre{};
  double half_size = 0.0, spacing = 0.0, first_time = 0.0, last_time = 0.0;
  std::map<std::array<std::int32_t, 4>, Node> nodes;
  std::size_t pages = 0;
};

void read_page(const std::string& bytes, std::uint64_t start, std::uint64_t size, Copc* out) {
  ++out->pages;
  ASSERT_LE(start + size, bytes.size());
  ASSERT_EQ(size % 32, 0u);
  for (std::uint64_t at = start; at < start + size; at += 32) {
    Copc::Node node;
    for (std::size_t k = 0; k < 4; ++k) node.key[k] = number_at<std::int32_t>(bytes, at + 4 * k);
    node.start = number_at<std::uint64_t>(bytes, at + 16);
    node.size = number_at<std::int32_t>(bytes, at + 24);
    node.points = number_at<std::int32_t>(bytes, at + 28);
    if (node.points < 0) {
      read_page(bytes, node.start, static_cast<std::uint64_t>(node.size), out);
    } else {
      EXPECT_TRUE(out->nodes.emplace(node.key, node).second) << "two nodes of one key";
    }
  }
}

Copc read_copc(const std::string& bytes) {
  Copc out;
  EXPECT_EQ(bytes.substr(0, 4), "LASF");
  EXPECT_EQ(bytes[24], 1);
  EXPECT_EQ(bytes[25], 4);
  EXPECT_EQ(number_at<std::uint16_t>(bytes, 94), 375);
  const int format = static_cast<unsigned char>(bytes[104]);
  EXPECT_GE(format, 0x86);
  EXPECT_LE(format, 0x88);
  EXPECT_EQ(bytes.substr(375 + 2, 5), std::string("copc\0", 5));
  EXPECT_EQ(number_at<std::uint16_t>(bytes, 375 + 18), 1);
  EXPECT_EQ(number_at<std::uint16_t>(bytes, 375 + 20), 160);
  const std::size_t info = 375 + 54;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    out.centre[axis] = number_at<double>(bytes, info + 8 * axis);
  }
  out.half_size = number_at<double>(bytes, info + 24);
  out.spacing = number_at<double>(bytes, info + 32);
  out.first_time = number_at<double>(bytes, info + 56);
  out.last_time = number_at<double>(bytes, info + 64);
  for (std::size_t at = info + 72; at < info + 160; ++at) EXPECT_EQ(bytes[at], 0);
  // The root page begins the content of a record behind the points.
  const auto extended = number_at<std::uint64_t>(bytes, 235);
  EXPECT_GE(number_at<std::uint32_t>(bytes, 243), 1u);
  EXPECT_EQ(bytes.substr(extended + 2, 5), std::string("copc\0", 5));
  EXPECT_EQ(number_at<std::uint16_t>(bytes, extended + 18), 1000);
  EXPECT_EQ(number_at<std::uint64_t>(bytes, info + 40), extended + 60);
  read_page(bytes, number_at<std::uint64_t>(bytes, info + 40),
            number_at<std::uint64_t>(bytes, info + 48), &out);
  return out;
}

/// What the specification asks of the nodes, and the grid of the points in those with others below.
void check_nodes(const std::string& bytes) {
  const Copc copc = read_copc(bytes);
  const auto source = open_point_source(bytes.data(), bytes.size(), "a.laz");
  const LasFile& las = *source->header().las;
  const std::vector<std::string> records = records_in(bytes);
  std::map<std::uint64_t, const Copc::Node*> by_start;
  std::set<std::array<std::int32_t, 4>> with_children;
  std::uint64_t points = 0;
  for (const auto& [key, node] : copc.nodes) {
    by_start[node.start] = &node;
    points += static_cast<std::uint64_t>(node.points);
    if (key[0] == 0) continue;
    const std::array<std::int32_t, 4> parent = {key[0] - 1, key[1] / 2, key[2] / 2, key[3] / 2};
    EXPECT_EQ(copc.nodes.count(parent), 1u);
    with_children.insert(parent);
  }
  EXPECT_EQ(points, number_at<std::uint64_t>(bytes, 247));
  EXPECT_EQ(points, records.size());
  std::size_t next = 0;
  double first_time = HUGE_VAL, last_time = -HUGE_VAL;
  for (const auto& [start, node] : by_start) {  // in the order of the file
    std::set<std::array<int, 3>> cells;
    const double side = 2.0 * copc.half_size / std::ldexp(1.0, node->key[0]);
    const double spacing = copc.spacing / std::ldexp(1.0, node->key[0]);
    for (std::int32_t i = 0; i < node->points; ++i, ++next) {
      std::array<int, 3> cell{};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const double x =
            number_at<std::int32_t>(records[next], 4 * axis) * las.scale[axis] + las.offset[axis];
        const double in_node =
            x - (copc.centre[axis] - copc.half_size + side * node->key[axis + 1]);
        // Coordinates of 5e6 m are doubles to 1e-9 m.
        ASSERT_GE(in_node, -1e-8);
        ASSERT_LE(in_node, side + 1e-8);
        // Points that rounding may put into the next cell are not looked at.
        const double cells_in = in_node / spacing;
        const bool at_edge = std::abs(cells_in - std::round(cells_in)) * spacing < 1e-7;
        cell[axis] = at_edge ? -1 - static_cast<int>(next) : static_cast<int>(cells_in);
      }
      if (with_children.count(node->key) > 0) {
        EXPECT_TRUE(cells.insert(cell).second) << "level " << node->key[0];
      }
      const auto time = number_at<double>(records[next], 22);
      first_time = std::min(first_time, time);
      last_time = std::max(last_time, time);
    }
  }
  if (points > 0) {
    EXPECT_EQ(copc.first_time, first_time);
    EXPECT_EQ(copc.last_time, last_time);
  }
}

TEST(CopcWriter, HasThePointsOfTheLasFileInNodes) {
  const std::string las = las_of(make_terrain(120000));
  const std::string copc = copc_of(las);
  EXPECT_TRUE(sorted(records_in(copc)) == sorted(records_in(las)));
  check_nodes(copc);
  const Copc nodes = read_copc(copc);
  EXPECT_GT(nodes.nodes.size(), 5u);
  EXPECT_GE(nodes.nodes.rbegin()->first[0], 2);  // levels below the root's children
  EXPECT_EQ(nodes.pages, 1u);
  // And back.
  const auto source = open_point_source(copc.data(), copc.size(), "a.laz");
  const std::string back = written(*source, CloudFormat::kLas, CloudEncoding::kBinary);
  EXPECT_TRUE(sorted(records_in(back)) == sorted(records_in(las)));
  for (const std::size_t place : {131, 139, 147, 155, 163, 171, 179, 187, 195, 203, 211, 219}) {
    EXPECT_EQ(number_at<double>(back, place), number_at<double>(las, place)) << place;
  }
  // Written anew it stays as it is but for the order within levels.
  const std::string again = copc_of(copc);
  EXPECT_TRUE(sorted(records_in(again)) == sorted(records_in(las)));
  check_nodes(again);
}

TEST(CopcWriter, IsReadByBoundsAndLevels) {
  const std::string copc = copc_of(las_of(make_terrain(120000)));
  const std::vector<std::string> all = records_in(copc);
  const auto source = open_point_source(copc.data(), copc.size(), "a.laz");
  const LasFile& las = *source->header().las;
  ReadOptions bounds;
  bounds.bounds = PlanBounds{432310.0, 5410200.0, 432390.0, 5410333.0};
  std::vector<std::string> inside;
  for (const std::string& record : all) {
    const double x = number_at<std::int32_t>(record, 0) * las.scale[0] + las.offset[0];
    const double y = number_at<std::int32_t>(record, 4) * las.scale[1] + las.offset[1];
    if (bounds.bounds->contains(x, y)) inside.push_back(record);
  }
  ASSERT_GT(inside.size(), 100u);
  EXPECT_TRUE(records_in(copc, bounds) == inside);
  const auto part = open_point_source(copc.data(), copc.size(), "a.laz", bounds);
  PointBatch batch;
  while (part->next(batch)) {
  }
  EXPECT_LT(part->report().outside + inside.size(), all.size() / 2);  // nodes were left out
  // Each level has more points, the last all.
  const Copc nodes = read_copc(copc);
  std::map<std::int32_t, std::size_t> by_level;
  for (const auto& [key, node] : nodes.nodes) {
    by_level[key[0]] += static_cast<std::size_t>(node.points);
  }
  std::size_t expected = 0;
  for (const auto& [level, points] : by_level) {
    expected += points;
    ReadOptions levels;
    levels.resolution = nodes.spacing / std::ldexp(1.0, level);
    EXPECT_EQ(records_in(copc, levels).size(), expected) << level;
  }
  EXPECT_EQ(expected, all.size());
}

TEST(CopcWriter, TheSameBytesForAnyThreads) {
  const std::string las = las_of(make_terrain(70000));
  ::setenv("OMP_NUM_THREADS", "1", 1);
  const std::string one = copc_of(las);
  ::setenv("OMP_NUM_THREADS", "5", 1);
  const std::string five = copc_of(las);
  ::unsetenv("OMP_NUM_THREADS");
  EXPECT_TRUE(one == five);
}

/// A point of an older format as LAS 1.4 has it: the tables of the specification side by side.
std::string extended(const std::string& from, int format, std::size_t extra) {
  const auto byte = [&](std::size_t at) { return static_cast<unsigned char>(from[at]); };
  std::string to(30, '\0');
  to.replace(0, 14, from, 0, 14);                                       // x y z intensity
  const unsigned number = byte(14) % 8, returns = byte(14) / 8 % 8;     // 3 bits each
  const unsigned direction = byte(14) / 64 % 2, edge = byte(14) / 128;  //
  const unsigned point_class = byte(15) % 32, flags = byte(15) / 32;    // 5 bits, 3 bits
  const bool overlap = point_class == 12;                               //
  to[14] = static_cast<char>(number + 16 * returns);                    // 4 bits each
  to[15] = static_cast<char>(flags + (overlap ? 8 : 0) + 64 * direction + 128 * edge);
  to[16] = static_cast<char>(overlap ? 1 : point_class);
  to[17] = from[17];
  const auto degrees = static_cast<signed char>(from[16]);
  const auto angle = static_cast<std::int16_t>(std::lround(degrees * 1000.0 / 6.0));
  std::memcpy(&to[18], &angle, 2);
  to.replace(20, 2, from, 18, 2);
  const bool has_time = format == 1 || format >= 3;
  if (has_time) to.replace(22, 8, from, 20, 8);
  const std::size_t color_at = format == 2 ? 20 : 28;
  if (format == 2 || format == 3 || format == 5) to += from.substr(color_at, 6);
  return to + from.substr(from.size() - extra);
}

TEST(CopcWriter, OldPointFormatsBecomeThoseFromSixOn) {
  for (int format = 0; format <= 5; ++format) {
    test::MadeLaz what;
    what.point_format = format;
    what.minor = format < 4 ? 2 : 3;
    what.extra_bytes = format % 2 == 0 ? 3 : 0;
    what.chunks = {3000};
    std::string records;
    const std::string laz = test::make_laz(what, &records);
    const std::size_t size = records.size() / 3000;
    std::vector<std::string> expected;
    for (std::size_t i = 0; i < 3000; ++i) {
      expected.push_back(extended(records.substr(i * size, size), format, what.extra_bytes));
    }
    std::vector<std::string> notes;
    const std::string copc = copc_of(laz, &notes);
    EXPECT_TRUE(sorted(records_in(copc)) == sorted(expected)) << format;
    const bool color = format == 2 || format == 3 || format == 5;
    EXPECT_EQ(static_cast<unsigned char>(copc[104]), color ? 0x87 : 0x86);
    EXPECT_THAT(notes, ::testing::Contains(HasSubstr(" points of class 12 (overlap) have the ")));
    EXPECT_EQ(format >= 4,
              ::testing::Matches(::testing::Contains(HasSubstr("wave packets")))(notes));
    check_nodes(copc);
    // The counts of the older header are for formats up to 5.
    EXPECT_EQ(number_at<std::uint32_t>(copc, 107), 0u);
    EXPECT_EQ(number_at<std::uint16_t>(copc, 6) & 16, 16);
    std::array<std::uint64_t, 15> by_return{};
    for (const std::string& record : expected) {
      const unsigned number = static_cast<unsigned char>(record[14]) % 16;
      if (number > 0) ++by_return[number - 1];
    }
    for (std::size_t r = 0; r < 15; ++r) {
      EXPECT_EQ(number_at<std::uint64_t>(copc, 255 + 8 * r), by_return[r]);
    }
  }
}

TEST(CopcWriter, NewPointFormatsStayAsTheyAre) {
  for (const int format : {6, 7, 8}) {
    test::MadeLaz what;
    what.point_format = format;
    what.minor = 4;
    what.compressor = 3;
    what.extra_bytes = 5;
    what.chunks = {2000, 900};
    const std::string laz = test::make_laz(what);
    std::vector<std::string> notes;
    const std::string copc = copc_of(laz, &notes);
    EXPECT_TRUE(sorted(records_in(copc)) == sorted(records_in(laz))) << format;
    EXPECT_EQ(static_cast<unsigned char>(copc[104]), 0x80 | format);
    EXPECT_THAT(notes, IsEmpty());
    check_nodes(copc);
  }
}

TEST(CopcWriter, NoPointsOnePointAndManyAtOnePlace) {
  const std::string none = copc_of(las_of(RoadCloud()));
  EXPECT_THAT(records_in(none), IsEmpty());
  check_nodes(none);
  RoadCloud cloud;
  cloud.points.emplace_back(1.0f, 2.0f, 3.0f);
  const std::string one = copc_of(las_of(cloud));
  EXPECT_EQ(records_in(one).size(), 1u);
  check_nodes(one);
  cloud.points.resize(2 * laz::kMostInLeaf, cloud.points[0]);
  cloud.points.emplace_back(90.0f, 2.0f, 3.0f);
  const std::string many = copc_of(las_of(cloud));
  EXPECT_EQ(records_in(many).size(), cloud.size());
  check_nodes(many);
}

TEST(CopcWriter, LeavesNothingBesideTheFile) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "a.copc.laz";
  const RoadCloud cloud = make_terrain(1000);
  write_cloud(cloud, path);
  EXPECT_EQ(read_cloud(path).size(), cloud.size());
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
  check_nodes(test::read_text(path));
  // The name alone makes it one.
  write_cloud(cloud, folder.path() / "a.laz");
  EXPECT_NE(test::read_text(folder.path() / "a.laz").substr(377, 4), "copc");
}

// --- sorting and the index ----------------------------------------------------------------------

using Nodes = std::vector<std::pair<std::array<std::int32_t, 4>, std::string>>;

Nodes sort_into_nodes(const std::string& records, std::size_t memory) {
  laz::OctreeOptions options;
  options.record_length = 14;
  options.scale = {0.01, 0.01, 0.01};
  options.cube.low = {0.0, 0.0, 0.0};
  options.cube.side = 1000.0;
  options.memory = memory;
  Nodes nodes;
  laz::OctreeSort sort(options, [&](const laz::OctreeKey& key, std::string own) {
    nodes.push_back({{key.level, key.cell[0], key.cell[1], key.cell[2]}, std::move(own)});
  });
  sort.sort(records.size() / 14, [&](const auto& use) {
    constexpr std::size_t kSome = 1000;
    for (std::size_t at = 0; at < records.size(); at += 14 * kSome) {
      use(records.data() + at, std::min(kSome, (records.size() - at) / 14));
    }
  });
  return nodes;
}

TEST(OctreeSort, GivesTheSameNodesForAnyMemory) {
  const CounterRandom random(5);
  std::string records;
  for (std::uint64_t i = 0; i < 400000; ++i) {
    std::string record(14, '\0');
    for (std::size_t axis = 0; axis < 2; ++axis) {
      // Denser towards one corner.
      const double x = 99999.0 * std::pow(random.uniform(3 * i + axis), 2.0);
      detail::store(record, 4 * axis, static_cast<std::int32_t>(x));
    }
    detail::store(record, 8, static_cast<std::int32_t>(500 + random.below(3 * i + 2, 5)));
    detail::store(record, 12, static_cast<std::uint16_t>(i));
    records += record;
  }
  const Nodes whole = sort_into_nodes(records, records.size());
  // Of a third and of a fortieth of the points: then through files.
  for (const std::size_t part : {3, 40}) {
    EXPECT_TRUE(sort_into_nodes(records, records.size() / part) == whole) << part;
  }
  std::size_t bytes = 0;
  for (const auto& [key, own] : whole) bytes += own.size();
  EXPECT_EQ(bytes, records.size());
}

TEST(OctreeSort, RefusesMorePointsAtOnePlaceThanMemoryHolds) {
  const std::string records(14 * 200000, '\1');
  EXPECT_THROW(sort_into_nodes(records, 14 * 100000), std::invalid_argument);
  EXPECT_NO_THROW(sort_into_nodes(records, records.size()));
}

TEST(CopcIndex, OfManyNodesHasPages) {
  // A quadtree of eight levels, in the order of a walk, numbers of points that tell them apart.
  std::vector<laz::CopcNode> nodes;
  const std::function<void(const laz::OctreeKey&)> add = [&](const laz::OctreeKey& key) {
    laz::CopcNode node;
    node.key = key;
    node.chunk.start = 1000 * nodes.size();
    node.chunk.size = 1000;
    node.chunk.points = nodes.size() + 1;
    nodes.push_back(node);
    if (key.level == 7) return;
    for (int child = 0; child < 4; ++child) {
      add({key.level + 1, {2 * key.cell[0] + child % 2, 2 * key.cell[1] + child / 2, 0}});
    }
  };
  add({});
  ASSERT_GT(nodes.size(), laz::kMostEntriesOfPage);
  const std::uint64_t place = 77;
  const laz::CopcIndex index = laz::make_copc_index(nodes, place);
  Copc read;
  read_page(std::string(place, '\0') + index.pages, place, index.root_size, &read);
  EXPECT_GT(read.pages, 4u);
  EXPECT_LT(index.root_size, 32 * laz::kMostEntriesOfPage);
  ASSERT_EQ(read.nodes.size(), nodes.size());
  for (const laz::CopcNode& node : nodes) {
    const Copc::Node& found =
        read.nodes.at({node.key.level, node.key.cell[0], node.key.cell[1], node.key.cell[2]});
    EXPECT_EQ(found.start, node.chunk.start);
    EXPECT_EQ(found.points, static_cast<std::int32_t>(node.chunk.points));
  }
}

// --- survey files ------------------------------------------------------------------------------

TEST(CopcWriter, SurveyFilesKeepTheirPoints) {
  CAMBER_REQUIRE_DATA("survey-files/expected.json");
  const std::filesystem::path folder = test::data_dir() / "survey-files";
  for (const char* const name :
       {"laz/tiles/test_data_77050_627755_LA93_IGN69.laz", "laz/tiles/bcts_1.laz",
        "laz/extra-bytes.laz", "laz/1_4_w_evlr.laz", "laz/pdrf10-1.5.laz",
        "copc/simple.copc.laz"}) {
    const std::string bytes = test::read_text(folder / name);
    const std::string copc = copc_of(bytes);
    check_nodes(copc);
    // By value: attributes of the same name, of all points, whatever their order.
    const CloudFile from = read_cloud_memory(bytes.data(), bytes.size(), "a.laz"),
                    to = read_cloud_memory(copc.data(), copc.size(), "b.laz");
    ASSERT_EQ(to.cloud.size(), from.cloud.size()) << name;
    for (const char* const label :
         {"intensity", "return_number", "number_of_returns", "user_data", "point_source_id"}) {
      std::vector<int> a = from.cloud.labels.at(label), b = to.cloud.labels.at(label);
      std::sort(a.begin(), a.end());
      std::sort(b.begin(), b.end());
      EXPECT_TRUE(a == b) << name << " " << label;
    }
    const auto places = [](const RoadCloud& cloud) {
      std::vector<std::array<double, 3>> out;
      for (const Eigen::Vector3f& p : cloud.points) {
        const Eigen::Vector3d x = cloud.origin + p.cast<double>();
        out.push_back({std::round(x[0] * 1e3), std::round(x[1] * 1e3), std::round(x[2] * 1e3)});
      }
      std::sort(out.begin(), out.end());
      return out;
    };
    if (from.cloud.origin == to.cloud.origin) {
      EXPECT_TRUE(places(from.cloud) == places(to.cloud)) << name;
    }
  }
}

}  // namespace
}  // namespace camber
