// Parts of LAZ files that are read alone.

#include "camber/cloud/las_chunks.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "camber/cloud/las_file.h"
#include "camber/core/errors.h"
#include "cloud/laz_maker.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// The records that a source hands out, one behind the other.
std::string records_of(PointSource& source) {
  std::string out;
  for (PointBatch batch; source.next(batch);) {
    for (std::size_t i = 0; i < batch.count; ++i) {
      out.append(reinterpret_cast<const char*>(batch.records.data + i * batch.records.stride),
                 source.header().las->record_length);
    }
  }
  return out;
}

TEST(LasChunks, AreReadWithoutTheOthers) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "made.laz";
  for (const bool variable : {false, true}) {
    for (const bool layered : {false, true}) {
      test::MadeLaz what;
      what.variable = variable;
      if (layered) {
        what.point_format = 7;
        what.minor = 4;
        what.compressor = 3;
      }
      if (variable) what.chunks = {7, 61, 32};
      std::string all;
      const std::string bytes = test::make_laz(what, &all);
      std::ofstream(path, std::ios::binary) << bytes;
      const std::unique_ptr<PointSource> whole = open_point_source(path);
      const LasFile& las = *whole->header().las;
      ASSERT_EQ(las_chunks(las),
                std::vector<std::uint64_t>(what.chunks.begin(), what.chunks.end()));
      const std::size_t size = las.record_length;
      const std::size_t first = what.chunks[0] * size, second = what.chunks[1] * size;
      const auto some = open_las_chunks(path, {}, {0, 2});
      EXPECT_EQ(some->header().count, what.chunks[0] + what.chunks[2]);
      EXPECT_EQ(records_of(*some), all.substr(0, first) + all.substr(first + second));
      EXPECT_EQ(records_of(*open_las_chunks(path, {}, {1})), all.substr(first, second));
      EXPECT_THAT(records_of(*open_las_chunks(path, {}, {})), IsEmpty());
      try {
        open_las_chunks(path, {}, {3});
        FAIL();
      } catch (const InputError& error) {
        EXPECT_THAT(error.what(), HasSubstr("found 3 chunks"));
      }
    }
  }
}

TEST(LasChunks, AreNotThereWhereNothingIsCodedApart) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "made.laz";
  test::MadeLaz what;
  what.compressor = 1;  // one stream
  std::ofstream(path, std::ios::binary) << test::make_laz(what);
  EXPECT_THAT(las_chunks(*open_point_source(path)->header().las), IsEmpty());
  EXPECT_THROW(open_las_chunks(path, {}, {0}), InputError);
}

}  // namespace
}  // namespace camber
