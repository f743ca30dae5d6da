#include "camber/cloud/point_selection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camber/cloud/stream_filters.h"
#include "cloud/cloud_files.h"

namespace camber {
namespace {

using test::read_error;
using test::read_from_memory;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// A grid of points at (i, j), 0 <= i, j < 4, with classes and returns.
std::string grid() {
  std::string text = "x,y,z,classification,return_number,number_of_returns,id\n";
  for (int j = 0; j < 4; ++j) {
    for (int i = 0; i < 4; ++i) {
      const int id = 4 * j + i;
      text += std::to_string(i) + "," + std::to_string(j) + ",7," + std::to_string(i) + "," +
              std::to_string(1 + j % 3) + "," + std::to_string(1 + i % 3) + "," +
              std::to_string(id) + "\n";
    }
  }
  return text;
}

std::vector<int> ids(PointSource& source) {
  CloudBuilder builder(source.header(), false);
  PointBatch batch;
  while (source.next(batch)) builder.add(batch);
  ReadReport report = source.report();
  return builder.finish(report).labels.at("id");
}

std::vector<int> ids_of(const PointSelection& selection) {
  const std::string text = grid();
  return ids(
      *select_points(open_point_source(text.data(), text.size(), "a.csv"), selection, "a.csv"));
}

TEST(Bounds, AreHalfOpen) {
  ReadOptions options;
  options.bounds = PlanBounds{1, 1, 3, 2};
  const CloudFile file = read_from_memory(grid(), "a.csv", options);
  EXPECT_THAT(file.cloud.labels.at("id"), ElementsAre(5, 6));
  EXPECT_EQ(file.report.outside, 14u);
  EXPECT_EQ(file.report.points, 2u);
  // Neighbours share no point and miss none.
  std::size_t total = 0;
  for (const double x : {0.0, 1.5, 3.0}) {
    for (const double y : {0.0, 2.0}) {
      options.bounds = PlanBounds{x, y, x + 1.5, y + 2.0};
      total += read_from_memory(grid(), "a.csv", options).cloud.size();
    }
  }
  EXPECT_EQ(total, 16u);
}

TEST(Bounds, WithoutAPointTellWhereThePointsAre) {
  ReadOptions options;
  options.bounds = PlanBounds{10, 10, 20, 20};
  const CloudFile file = read_from_memory(grid(), "a.csv", options);
  EXPECT_EQ(file.cloud.size(), 0u);
  ASSERT_FALSE(file.report.notes.empty());
  EXPECT_THAT(file.report.notes.back(), HasSubstr("x is from 0 to 3, y from 0 to 3"));
  options.bounds = PlanBounds{3, 0, 3, 1};
  EXPECT_THROW(read_from_memory(grid(), "a.csv", options), std::invalid_argument);
  options.bounds = PlanBounds{0, 0, std::nan(""), 1};
  EXPECT_THROW(read_from_memory(grid(), "a.csv", options), std::invalid_argument);
}

TEST(Bounds, KeepRecordsOfLasAndRefuseMeshes) {
  RoadCloud cloud = test::make_full_cloud(200);
  const std::string las = test::write_to_memory(cloud, CloudFormat::kLas);
  ReadOptions options;
  options.bounds = PlanBounds{-20, -20, 20, 20};
  std::size_t inside = 0;
  for (const Eigen::Vector3f& p : cloud.points) {
    inside += std::abs(p.x()) < 20 && std::abs(p.y()) < 20 ? 1 : 0;
  }
  const auto source = open_point_source(las.data(), las.size(), "a.las", options);
  PointBatch batch;
  std::size_t count = 0;
  while (source->next(batch)) {
    EXPECT_NE(batch.records.data, nullptr);
    count += batch.count;
  }
  EXPECT_EQ(count, inside);
  const std::string mesh =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
      "z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 "
      "0\n3 0 1 2\n";
  options.triangles = true;
  EXPECT_THAT(read_error(mesh, "a.ply", options), HasSubstr("found a mesh"));
}

TEST(PointSelection, ByClassAndReturn) {
  PointSelection selection;
  EXPECT_FALSE(selection.selects());
  selection.classes = {1, 3};
  EXPECT_THAT(ids_of(selection), ElementsAre(1, 3, 5, 7, 9, 11, 13, 15));
  selection.without_classes = {3};
  EXPECT_THAT(ids_of(selection), ElementsAre(1, 5, 9, 13));
  selection.classes.clear();
  EXPECT_EQ(ids_of(selection).size(), 12u);
  // Number of return by row: 1 2 3 1; of returns by column: 1 2 3 1.
  PointSelection last;
  last.returns = PointSelection::Returns::kLast;
  EXPECT_THAT(ids_of(last), ElementsAre(0, 3, 4, 5, 7, 8, 9, 10, 11, 12, 15));
  PointSelection first;
  first.returns = PointSelection::Returns::kFirst;
  EXPECT_THAT(ids_of(first), ElementsAre(0, 1, 2, 3, 12, 13, 14, 15));
  PointSelection single;
  single.returns = PointSelection::Returns::kSingle;
  EXPECT_THAT(ids_of(single), ElementsAre(0, 3, 4, 7, 8, 11, 12, 15));
  const std::string plain = "x,y,z\n1,2,3\n";
  EXPECT_THROW(select_points(open_point_source(plain.data(), plain.size(), "a.csv"), last, "a.csv"),
               InputError);
}

TEST(PointSelection, ByAnAreaWithAHole) {
  PointSelection selection;
  selection.area = {{{-0.5, -0.5}, {3.5, -0.5}, {3.5, 3.5}, {-0.5, 3.5}},
                    {{0.5, 0.5}, {2.5, 0.5}, {2.5, 2.5}, {0.5, 2.5}}};
  EXPECT_THAT(ids_of(selection), ElementsAre(0, 1, 2, 3, 4, 7, 8, 11, 12, 13, 14, 15));
  // A triangle whose border goes through points: with its other half it covers each once.
  PointSelection lower, upper;
  lower.area = {{{0, 0}, {3, 0}, {3, 3}}};
  upper.area = {{{0, 0}, {3, 3}, {0, 3}}};
  std::vector<int> both = ids_of(lower);
  const std::vector<int> others = ids_of(upper);
  both.insert(both.end(), others.begin(), others.end());
  std::sort(both.begin(), both.end());
  EXPECT_EQ(std::adjacent_find(both.begin(), both.end()), both.end());
  EXPECT_EQ(both, ids_of([] {
              PointSelection square;
              square.area = {{{0, 0}, {3, 0}, {3, 3}, {0, 3}}};
              return square;
            }()));
}

}  // namespace
}  // namespace camber
