// Points compressed by LASzip: the coder, chunks of all point formats and item versions, and the
// survey files of many writers.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>

#include "camber/cloud/detail/laz/arithmetic_encoder.h"
#include "camber/cloud/detail/laz/chunk_codec.h"
#include "camber/cloud/las_file.h"
#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"
#include "camber/core/random.h"
#include "cloud/laz_maker.h"
#include "support/test_data.h"

namespace camber {
namespace {

using laz::ArithmeticDecoder;
using laz::ArithmeticEncoder;
using laz::IntegerModel;
using laz::LazItem;
using nlohmann::json;
using ::testing::HasSubstr;

const unsigned char* bytes_of(const std::string& text) {
  return reinterpret_cast<const unsigned char*>(text.data());
}

TEST(LazCoder, SymbolsBitsAndIntegersComeBack) {
  constexpr int kCount = 30000;
  const CounterRandom random(1, 0);
  // Few symbols often, so that carries run through many bytes; integers of all sizes.
  const auto symbol_at = [&](std::uint64_t i) {
    return static_cast<unsigned>(std::pow(random.uniform(5 * i), 8.0) * 516);
  };
  const auto integer_at = [&](std::uint64_t i) {
    return static_cast<std::int32_t>(
        std::ldexp(random.uniform(5 * i + 1) - 0.5, static_cast<int>(random.bits(5 * i + 2) % 33)));
  };
  const auto number_at = [&](std::uint64_t i) {
    return static_cast<std::uint32_t>(random.bits(5 * i + 3));
  };
  ArithmeticEncoder encoder;
  laz::SymbolModel symbols(516);
  laz::BitModel bits;
  IntegerModel wide(32, 3), narrow(16), bytes(8);
  for (std::uint64_t i = 0; i < kCount; ++i) {
    encoder.symbol(symbols, symbol_at(i));
    encoder.bit(bits, number_at(i) % 7 == 0 ? 1 : 0);
    const std::int32_t x = i % 1000 == 0 ? INT32_MIN : integer_at(i);
    wide.code(encoder, integer_at(i + 1), i % 3, x);
    narrow.code(encoder, static_cast<std::uint16_t>(integer_at(i)), 0,
                static_cast<std::uint16_t>(x));
    bytes.code(encoder, static_cast<std::uint8_t>(integer_at(i)), 0, static_cast<std::uint8_t>(x));
    const unsigned count = 1 + static_cast<unsigned>(i % 32);
    encoder.bits(count, number_at(i) >> (32 - count));
  }
  const std::string coded = encoder.finish();
  ArithmeticDecoder decoder(bytes_of(coded), bytes_of(coded) + coded.size());
  decoder.start();
  laz::SymbolModel symbols2(516);
  laz::BitModel bits2;
  IntegerModel wide2(32, 3), narrow2(16), bytes2(8);
  for (std::uint64_t i = 0; i < kCount; ++i) {
    ASSERT_EQ(decoder.symbol(symbols2), symbol_at(i)) << i;
    ASSERT_EQ(decoder.bit(bits2), number_at(i) % 7 == 0 ? 1u : 0u);
    const std::int32_t x = i % 1000 == 0 ? INT32_MIN : integer_at(i);
    ASSERT_EQ(wide2.code(decoder, integer_at(i + 1), i % 3, 0), x);
    ASSERT_EQ(narrow2.code(decoder, static_cast<std::uint16_t>(integer_at(i)), 0, 0),
              static_cast<std::uint16_t>(x));
    ASSERT_EQ(bytes2.code(decoder, static_cast<std::uint8_t>(integer_at(i)), 0, 0),
              static_cast<std::uint8_t>(x));
    const unsigned count = 1 + static_cast<unsigned>(i % 32);
    ASSERT_EQ(decoder.bits(count), number_at(i) >> (32 - count));
  }
  EXPECT_FALSE(decoder.exhausted());
  EXPECT_FALSE(decoder.damaged());
  // The decoder takes all bytes and no more: so chunks that stand one behind the other are found.
  EXPECT_EQ(decoder.position(), bytes_of(coded) + coded.size());
}

/// Records as a scanner makes them, and with some probability anything.
std::string make_records(const std::vector<LazItem>& items, std::size_t count, double noise) {
  const CounterRandom random(7, items.size());
  std::size_t size = 0;
  for (const LazItem& item : items) size += item.size;
  std::string out(count * size, '\0');
  std::uint64_t draw = 0;
  for (std::size_t i = 0; i < count; ++i) {
    char* const record = out.data() + i * size;
    if (i > 0) std::copy_n(record - size, size, record);
    // A few steps, some of them in the middle of numbers.
    for (int k = 0; k < 5; ++k) {
      const std::size_t at = random.bits(draw++) % size;
      record[at] = static_cast<char>(record[at] + static_cast<int>(random.bits(draw++) % 3) - 1);
    }
    if (random.uniform(draw++) < noise) {
      for (std::size_t at = 0; at < size; ++at) record[at] = static_cast<char>(random.bits(draw++));
    }
  }
  return out;
}

std::string decode(const std::vector<LazItem>& items, const std::string& coded, std::size_t count,
                   std::size_t size, bool* suspicious, std::uint32_t wanted = laz::kWantAll) {
  std::string reason;
  const auto decoder =
      items[0].type >= LazItem::kPoint14
          ? laz::make_layered_decoder(items, coded, count, wanted, &reason)
          : laz::make_pointwise_decoder(items, bytes_of(coded), bytes_of(coded) + coded.size());
  if (!decoder) throw std::runtime_error(reason);
  std::string out(count * size, '\0');
  std::size_t done = 0;
  while (done < count) {
    const std::size_t some = std::min<std::size_t>(count - done, 777);
    const std::size_t found =
        decoder->decode(reinterpret_cast<unsigned char*>(out.data()) + done * size, some);
    done += found;
    if (found < some) break;
  }
  *suspicious = decoder->suspicious();
  out.resize(done * size);
  return out;
}

TEST(LazChunk, RecordsOfAllFormatsAndVersionsComeBack) {
  constexpr std::size_t kCount = 3000;
  for (int format = 0; format <= 10; ++format) {
    for (const int version : format < 6 ? std::vector{1, 2} : std::vector{3, 4}) {
      for (const double noise : {0.0, 0.02, 1.0}) {
        for (const std::size_t extra : {0u, 5u}) {
          std::vector<LazItem> items = laz::items_of(format, extra);
          std::size_t size = 0;
          for (LazItem& item : items) {
            item.version = static_cast<std::uint16_t>(version);
            size += item.size;
          }
          const std::string records = make_records(items, kCount, noise);
          const std::string coded = laz::encode_chunk(items, bytes_of(records), kCount);
          bool suspicious = true;
          ASSERT_EQ(decode(items, coded, kCount, size, &suspicious), records)
              << "format " << format << " version " << version << " noise " << noise;
          EXPECT_FALSE(suspicious);
          if (noise == 0.0) {
            EXPECT_LT(coded.size(), records.size() / 2);
          }
        }
      }
    }
  }
}

TEST(LazChunk, OnePointIsAChunk) {
  for (const int format : {3, 8}) {
    const std::vector<LazItem> items = laz::items_of(format, 0);
    const std::string records = make_records(items, 1, 1.0);
    const std::string coded = laz::encode_chunk(items, bytes_of(records), 1);
    bool suspicious = true;
    EXPECT_EQ(decode(items, coded, 1, records.size(), &suspicious), records);
    EXPECT_FALSE(suspicious);
  }
}

TEST(LazChunk, LayersThatAreNotWantedAreLeftOut) {
  constexpr std::size_t kCount = 500;
  const std::vector<LazItem> items = laz::items_of(7, 2);
  const std::string records = make_records(items, kCount, 0.02);
  const std::string coded = laz::encode_chunk(items, bytes_of(records), kCount);
  bool suspicious = true;
  const std::size_t size = records.size() / kCount;
  const std::string out = decode(items, coded, kCount, size, &suspicious, laz::kWantZ);
  EXPECT_FALSE(suspicious);
  for (std::size_t i = 0; i < kCount; ++i) {
    EXPECT_EQ(out.substr(i * size, 12), records.substr(i * size, 12)) << i;
    EXPECT_EQ(out.substr(i * size + 30, 6), records.substr(30, 6));
  }
}

TEST(LazChunk, EveryCutAndFlipIsSeenOrHarmless) {
  constexpr std::size_t kCount = 40;
  for (const int format : {3, 7}) {
    const std::vector<LazItem> items = laz::items_of(format, 1);
    const std::string records = make_records(items, kCount, 0.05);
    const std::size_t size = records.size() / kCount;
    const std::string coded = laz::encode_chunk(items, bytes_of(records), kCount);
    bool suspicious = false;
    for (std::size_t length = 0; length < coded.size(); ++length) {
      std::string out;
      try {
        out = decode(items, coded.substr(0, length), kCount, size, &suspicious);
      } catch (const std::runtime_error&) {
        continue;  // the head of the chunk
      }
      // Points before the cut are right.
      ASSERT_EQ(out, records.substr(0, out.size())) << length;
      ASSERT_LT(out.size(), records.size()) << length;
    }
    for (std::size_t bit = 0; bit < 8 * coded.size(); ++bit) {
      std::string flipped = coded;
      flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
      try {
        decode(items, flipped, kCount, size, &suspicious);
      } catch (const std::runtime_error&) {
      }
    }
  }
}

// --- files -------------------------------------------------------------------------------------

std::string records_of(PointSource& source) {
  std::string out;
  PointBatch batch;
  while (source.next(batch)) {
    for (std::size_t i = 0; i < batch.count; ++i) {
      out.append(reinterpret_cast<const char*>(batch.records.data + i * batch.records.stride),
                 batch.records.stride);
    }
  }
  return out;
}

std::string records_in(const std::string& bytes, const ReadOptions& options = {},
                       ReadReport* report = nullptr) {
  const auto source = open_point_source(bytes.data(), bytes.size(), "a.laz", options);
  const std::string out = records_of(*source);
  if (report != nullptr) *report = source->report();
  return out;
}

std::string error_of(const std::string& bytes, const ReadOptions& options = {}) {
  try {
    records_in(bytes, options);
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

TEST(LazFile, OfAllKindsOfWritersIsRead) {
  for (int format = 0; format <= 10; ++format) {
    for (const int compressor : format < 6 ? std::vector{1, 2} : std::vector{3}) {
      for (const int version : format < 6 ? std::vector{1, 2} : std::vector{3, 4}) {
        for (const int chunks : {0, 1, 2, 3}) {
          test::MadeLaz what;
          what.point_format = format;
          what.minor = format < 6 ? 2 + format % 3 : 4;
          what.compressor = compressor;
          what.version = version;
          what.extra_bytes = chunks == 1 ? 3 : 0;
          what.variable = chunks == 2;
          if (chunks == 2) what.chunks = {1, 2, 60, 9};
          what.offset_at_end = chunks == 3;
          std::string records;
          const std::string bytes = test::make_laz(what, &records);
          ReadReport report;
          for (const int threads : {1, 3}) {
            ReadOptions options;
            options.num_threads = threads;
            EXPECT_TRUE(records_in(bytes, options, &report) == records)
                << "format " << format << ", compressor " << compressor << ", version " << version
                << ", " << chunks;
          }
          EXPECT_EQ(report.format, CloudFormat::kLaz);
          EXPECT_THAT(report.notes, ::testing::IsEmpty());
        }
      }
    }
  }
}

TEST(LazFile, AMissingTableIsMadeAnewWhereTheChunksSayEnough) {
  for (const int format : {1, 6}) {
    test::MadeLaz what;
    what.point_format = format;
    what.minor = 4;
    what.compressor = format < 6 ? 2 : 3;
    what.table = false;
    std::string records;
    ReadReport report;
    const std::string bytes = test::make_laz(what, &records);
    EXPECT_TRUE(records_in(bytes, {}, &report) == records);
    EXPECT_THAT(report.notes, ::testing::ElementsAre(HasSubstr("it was never written")));
    what.variable = true;
    what.chunks = {7, 30, 5};
    const std::string variable = test::make_laz(what, &records);
    if (format < 6) {
      EXPECT_THAT(error_of(variable), HasSubstr("expected one: the chunks differ in size"));
    } else {
      EXPECT_TRUE(records_in(variable) == records);
    }
  }
}

TEST(LazFile, EveryCutIsRefusedOrLenientlyAPrefix) {
  for (const int format : {0, 3, 7}) {
    for (const bool table : {true, false}) {
      test::MadeLaz what;
      what.point_format = format;
      what.minor = format < 6 ? 2 : 4;
      what.compressor = format < 6 ? 2 : 3;
      what.chunks = {6, 6, 4};
      what.table = table;
      std::string records;
      const std::string bytes = test::make_laz(what, &records);
      ReadOptions lenient;
      lenient.lenient = true;
      for (std::size_t length = 0; length < bytes.size(); ++length) {
        const std::string cut = bytes.substr(0, length);
        const std::string error = error_of(cut);
        // The table alone may be gone.
        if (error.empty()) {
          EXPECT_TRUE(records_in(cut) == records) << length;
        }
        std::string some;
        try {
          some = records_in(cut, lenient);
        } catch (const InputError&) {
        }
        ASSERT_TRUE(some == records.substr(0, some.size())) << "format " << format << " " << length;
      }
    }
  }
}

TEST(LazFile, EveryBitOfItsHeadersFlippedIsRefusedOrRead) {
  test::MadeLaz what;
  what.point_format = 7;
  what.minor = 4;
  what.compressor = 3;
  what.chunks = {6, 6, 4};
  what.copc = true;
  const std::string bytes = test::make_laz(what);
  for (const double resolution : {0.0, 1.0}) {
    ReadOptions options;
    options.resolution = resolution;
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      std::string flipped = bytes;
      flipped[bit / 8] = static_cast<char>(flipped[bit / 8] ^ (1 << bit % 8));
      for (const bool lenient : {false, true}) {
        options.lenient = lenient;
        const std::string error = error_of(flipped, options);
        if (!error.empty()) {
          EXPECT_THAT(error, HasSubstr("a.laz: "));
        }
      }
    }
  }
}

TEST(LazFile, FalseNumbersTakeNeitherMemoryNorTime) {
  test::MadeLaz what;
  what.chunks = {10};
  const std::string bytes = test::make_laz(what);
  std::string many = bytes;
  const std::uint32_t count = 4000000000u;
  std::memcpy(many.data() + 107, &count, sizeof count);
  EXPECT_THAT(error_of(many), HasSubstr("found 4000000000 points, expected 1 to 10 in 1 chunks"));
  // The same with a chunk size that allows it.
  const std::size_t at = bytes.find("laszip encoded") + 52 + 12;
  std::memcpy(many.data() + at, &count, sizeof count);
  EXPECT_THAT(error_of(many), HasSubstr("found the end of the bytes in chunk 1 of 1"));
}

std::int32_t laz_number(const std::string& bytes, std::size_t at) {
  std::int32_t value;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

TEST(LazFile, CopcNodesAreChosenByLevelAndBounds) {
  test::MadeLaz what;
  what.point_format = 6;
  what.minor = 4;
  what.compressor = 3;
  what.copc = true;
  what.chunks = {11, 12, 13, 14};
  std::string records;
  const std::string bytes = test::make_laz(what, &records);
  EXPECT_TRUE(records_in(bytes) == records);
  ReadOptions options;
  options.resolution = 10.0;  // the spacing of the root
  EXPECT_TRUE(records_in(bytes, options) == records.substr(0, 11 * 30));
  options.resolution = 9.0;
  EXPECT_TRUE(records_in(bytes, options) == records);
  // Nodes 1, 2 and 3 are quarters of the plan: low, right of it, and behind it.
  options.resolution = 0.0;
  options.bounds = PlanBounds{60.0, 5.0, 100.0, 45.0};
  const auto source = open_point_source(bytes.data(), bytes.size(), "a.laz", options);
  const std::string some = records_of(*source);
  std::size_t inside = 0;
  for (std::size_t i = 0; i < records.size() / 30; ++i) {
    const double x = 0.001 * laz_number(records, 30 * i),
                 y = 0.001 * laz_number(records, 30 * i + 4);
    inside += options.bounds->contains(x, y) ? 1 : 0;
  }
  EXPECT_GT(inside, 0u);
  EXPECT_EQ(some.size(), 30 * inside);
  EXPECT_LE(inside + source->report().outside, 11u + 13u);  // of the root and one node
  EXPECT_TRUE(source->report().dropped.empty());            // what was not asked for is not missing
}

TEST(LazFile, ATruncatedCopcSaysWhatIsMissingWithBoundsToo) {
  test::MadeLaz what;
  what.point_format = 6;
  what.minor = 4;
  what.compressor = 3;
  what.copc = true;
  what.chunks = {11, 12, 13, 14};
  std::string records;
  const std::string bytes = test::make_laz(what, &records);
  const std::vector<laz::LazChunk> chunks =
      open_point_source(bytes.data(), bytes.size(), "a.laz")->header().las->laz->chunks;
  // Without the index alone, and within the last chunk but one.
  const std::size_t in_chunk = chunks[2].start + chunks[2].size / 2;
  for (const auto& [size, whole] : {std::pair<std::size_t, std::size_t>{bytes.size() - 40, 50},
                                    std::pair<std::size_t, std::size_t>{in_chunk, 23}}) {
    const std::string cut = bytes.substr(0, size);
    ReadOptions options;
    options.bounds = PlanBounds{0.0, 0.0, 100.0, 45.0};
    EXPECT_THAT(error_of(cut, options), HasSubstr("a.laz: "));
    options.lenient = true;
    const auto source = open_point_source(cut.data(), cut.size(), "a.laz", options);
    const std::string some = records_of(*source);
    std::size_t inside = 0;
    for (std::size_t i = 0; i < whole; ++i) {
      inside += options.bounds->contains(0.001 * laz_number(records, 30 * i),
                                         0.001 * laz_number(records, 30 * i + 4));
    }
    EXPECT_EQ(some.size(), 30 * inside);
    EXPECT_EQ(inside + source->report().outside, whole);
    std::uint64_t dropped = 0;
    for (const auto& [reason, count] : source->report().dropped) dropped += count;
    EXPECT_EQ(dropped, 50u - whole);
    EXPECT_THAT(source->report().notes,
                ::testing::Contains(::testing::AllOf(
                    HasSubstr("the COPC index is damaged (byte "),
                    HasSubstr("that it does not name are read as if within the bounds"))));
    if (size == in_chunk) {  // levels need the index
      options.resolution = 10.0;
      EXPECT_THAT(error_of(cut, options), HasSubstr("COPC"));
    }
  }
}

TEST(LazFile, EveryCutOfACopcIsRefusedOrSaysWhatIsMissing) {
  test::MadeLaz what;
  what.point_format = 6;
  what.minor = 4;
  what.compressor = 3;
  what.copc = true;
  what.chunks = {5, 4, 3, 2};
  const std::string bytes = test::make_laz(what);
  std::vector<ReadOptions> queries(2);
  queries[0].resolution = 9.0;
  queries[1].bounds = PlanBounds{0.0, 0.0, 60.0, 60.0};
  for (const ReadOptions& query : queries) {
    const std::size_t all = records_in(bytes, query).size();
    ReadOptions lenient = query;
    lenient.lenient = true;
    for (std::size_t length = 0; length < bytes.size(); ++length) {
      const std::string cut = bytes.substr(0, length);
      EXPECT_THAT(error_of(cut, query), HasSubstr("a.laz: ")) << length;
      try {
        const auto source = open_point_source(cut.data(), cut.size(), "a.laz", lenient);
        EXPECT_LE(records_of(*source).size(), all) << length;
        EXPECT_FALSE(source->report().notes.empty()) << length;
      } catch (const InputError&) {
      }
    }
  }
}

/// What lies in the points of a file, read by levels or bounds, and the notes.
struct NodesRead {
  std::string records;
  std::vector<std::string> notes;
};

NodesRead read_nodes(const std::string& bytes, double resolution,
                     const std::optional<PlanBounds>& bounds) {
  ReadOptions options;
  options.lenient = true;
  options.resolution = resolution;
  options.bounds = bounds;
  const auto source = open_point_source(bytes.data(), bytes.size(), "a.laz", options);
  NodesRead out;
  out.records = records_of(*source);
  out.notes = source->report().notes;
  return out;
}

TEST(LazFile, ACopcIndexWithoutItsLastEntriesIsRefusedOrSaysWhatIsMissing) {
  test::MadeLaz what;
  what.point_format = 6;
  what.minor = 4;
  what.compressor = 3;
  what.copc = true;
  what.chunks = {11, 12, 13, 14};
  std::string records;
  const std::string bytes = test::make_laz(what, &records);
  // The index: nodes 0 and 1 and a page; in the page nodes 2 and 3. Its last entry is zero, as of a
  // download that ended before; cut off; or the root page ends before the page's entry.
  std::string zero = bytes;
  zero.replace(zero.size() - 32, 32, 32, '\0');
  const std::string cut = bytes.substr(0, bytes.size() - 32);
  std::string short_root = bytes;
  const std::uint64_t two_entries = 64;
  std::memcpy(short_root.data() + 375 + 54 + 48, &two_entries, sizeof two_entries);
  const PlanBounds west{0.0, 0.0, 45.0, 100.0};  // without node 2
  for (const auto& [damaged, named] :
       {std::pair<std::string, std::size_t>{zero, 3}, std::pair<std::string, std::size_t>{cut, 3},
        std::pair<std::string, std::size_t>{short_root, 2}}) {
    const std::size_t points_named = named == 3 ? 11 + 12 + 13 : 11 + 12;
    const std::string missing = std::to_string(4 - named) + " of 4 chunks, with " +
                                std::to_string(50 - points_named) + " of 50 points,";
    // All levels, the root alone (its page is whole), and bounds.
    for (const double resolution : {1.0, 10.0}) {
      ReadOptions strict;
      strict.resolution = resolution;
      EXPECT_THAT(error_of(damaged, strict), HasSubstr("a.laz: byte "));
      const NodesRead some = read_nodes(damaged, resolution, {});
      EXPECT_TRUE(some.records == records.substr(0, 30 * (resolution < 10 ? points_named : 11)));
      EXPECT_THAT(some.notes, ::testing::Contains(::testing::AllOf(
                                  HasSubstr("the COPC index is damaged (byte "),
                                  HasSubstr(missing + " that it does not name are left out"))));
    }
    ReadOptions strict;
    strict.bounds = west;
    EXPECT_THAT(error_of(damaged, strict), HasSubstr("a.laz: byte "));
    const NodesRead sound = read_nodes(bytes, 0.0, west), all = read_nodes(damaged, 0.0, west);
    EXPECT_THAT(sound.notes, ::testing::IsEmpty());
    EXPECT_TRUE(all.records == sound.records);  // the chunks without an entry are read, too
    EXPECT_THAT(all.notes, ::testing::Contains(HasSubstr(missing + " that it does not name are "
                                                                   "read as if")));
  }
  // Where the damage is known it is named.
  ReadOptions options;
  options.resolution = 10.0;
  EXPECT_THAT(error_of(zero, options),
              HasSubstr("a.laz: byte " + std::to_string(bytes.size() - 32) +
                        ": found a second entry of a node, and 1 of 4 chunks, with 14 of 50"));
}

TEST(LazFile, AnotherFileOfCopcPointsHasNoIndex) {
  test::MadeLaz what;
  what.point_format = 7;
  what.minor = 4;
  what.compressor = 3;
  what.copc = true;
  std::string records;
  const std::string bytes = test::make_laz(what, &records);
  for (const CloudFormat format : {CloudFormat::kLas, CloudFormat::kLaz}) {
    const auto source = open_point_source(bytes.data(), bytes.size(), "a.laz");
    std::ostringstream out;
    const auto sink = make_point_sink(out, source->header(), format, CloudEncoding::kBinary);
    PointBatch batch;
    while (source->next(batch)) sink->write(batch);
    sink->finish();
    EXPECT_THAT(sink->notes(), ::testing::ElementsAre(HasSubstr("index")));
    const std::string copy = out.str();
    EXPECT_TRUE(records_in(copy) == records);
    const auto again = open_point_source(copy.data(), copy.size(), "b.las");
    for (const LasRecord& record : again->header().las->records) {
      EXPECT_NE(record.user_id, "copc");
    }
  }
}

/// $CAMBER_NODE_MODULES is the folder in which `npm install laz-perf` put the package.
TEST(LazFile, LazPerfReadsWhatIsWritten) {
  const char* const modules = std::getenv("CAMBER_NODE_MODULES");
  if (modules == nullptr || !std::filesystem::exists(std::filesystem::path(modules) / "laz-perf")) {
    GTEST_SKIP() << "no laz-perf: npm install laz-perf, and set CAMBER_NODE_MODULES";
  }
  const test::TemporaryFolder folder;
  for (const int format : {0, 1, 2, 3, 6, 7, 8}) {  // it aborts on others
    test::MadeLaz what;
    what.point_format = format;
    what.minor = format < 6 ? 2 : 4;
    what.compressor = format < 6 ? 2 : 3;
    what.extra_bytes = 3;
    what.chunks = {50000, 20000};
    std::string records;
    const std::string made = test::make_laz(what, &records);
    // Written anew by the writer, in its own chunks.
    const auto source = open_point_source(made.data(), made.size(), "a.laz");
    {
      std::ofstream out(folder.path() / "a.laz", std::ios::binary);
      const auto sink =
          make_point_sink(out, source->header(), CloudFormat::kLaz, CloudEncoding::kBinary);
      PointBatch batch;
      while (source->next(batch)) sink->write(batch);
      sink->finish();
    }
    const std::string command = "NODE_PATH='" + std::string(modules) + "' node '" +
                                (test::source_dir() / "tests/cloud/laz_perf.js").string() + "' '" +
                                (folder.path() / "a.laz").string() + "' '" +
                                (folder.path() / "out").string() + "'";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
    EXPECT_TRUE(test::read_text(folder.path() / "out") == records) << "format " << format;
  }
}

// --- survey files ------------------------------------------------------------------------------

std::string sha256(const std::string& bytes) {
  const test::TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "bytes";
  std::ofstream(path, std::ios::binary)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  FILE* const pipe = ::popen(("sha256sum '" + path.string() + "'").c_str(), "r");
  char hash[65] = {};
  const std::size_t got = pipe == nullptr ? 0 : std::fread(hash, 1, 64, pipe);
  if (pipe != nullptr) ::pclose(pipe);
  return std::string(hash, got);
}

std::string records_of(const std::filesystem::path& path, const ReadOptions& options,
                       std::vector<std::string>* notes = nullptr) {
  const auto source = open_point_source(path, options);
  std::string out = records_of(*source);
  if (notes != nullptr) *notes = source->report().notes;
  return out;
}

class SurveyFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    CAMBER_REQUIRE_DATA("survey-files/expected.json");
    expected_ = json::parse(test::read_text(folder_ / "expected.json"));
  }
  std::filesystem::path folder_ = test::data_dir() / "survey-files";
  json expected_;
};

TEST_F(SurveyFiles, EachHasTheRecordsOfOtherDecoders) {
  for (const char* const kind : {"laz", "copc"}) {
    for (const auto& [name, what] : expected_[kind].items()) {
      if (what.value("expect", "read") != "read") continue;
      ReadOptions options;
      options.num_threads = 2;
      std::vector<std::string> notes;
      const std::string records = records_of(folder_ / name, options, &notes);
      const char* const key =
          what.contains("sha256_points") ? "sha256_points" : "sha256_points_good";
      EXPECT_EQ(sha256(records), what[key]) << name;
      EXPECT_THAT(notes, ::testing::IsEmpty()) << name;
      if (records.size() < 1000000) {
        options.num_threads = 1;
        EXPECT_TRUE(records_of(folder_ / name, options) == records) << name;
      }
    }
  }
}

TEST_F(SurveyFiles, DamagedOnesAreRefusedOrGiveTheirGoodPoints) {
  for (const char* const kind : {"laz", "copc"}) {
    for (const auto& [name, what] : expected_[kind].items()) {
      const std::string expect = what.value("expect", "read");
      if (expect == "read") continue;
      for (const bool lenient : {false, true}) {
        ReadOptions options;
        options.lenient = lenient;
        std::string records;
        bool refused = false;
        try {
          records = records_of(folder_ / name, options);
        } catch (const InputError& error) {
          refused = true;
          EXPECT_THAT(error.what(), HasSubstr("expected")) << name;
        }
        if (refused) continue;
        // item_size_wrong.laz is damaged in its first chunk, not in its record.
        if (expect == "refuse") {
          EXPECT_TRUE(lenient && records.empty()) << name;
          continue;
        }
        if (name == "laz/damaged/cut_in_chunk_pointwise.laz") {
          const std::string whole = records_of(folder_ / "laz/made/pf3_chunk100.laz", {});
          EXPECT_TRUE(lenient);
          EXPECT_EQ(records, whole.substr(0, records.size()));
          EXPECT_EQ(records.size() / 34, 257u);  // as LASzip reads
        } else if (what.contains("sha256_points_good")) {
          EXPECT_EQ(sha256(records), what["sha256_points_good"]) << name << " " << lenient;
        }
      }
    }
  }
}

/// Points compressed as other writers do, and again as they were: what differs is known.
TEST_F(SurveyFiles, TheirChunksCodedAgainAreEqual) {
  std::size_t equal = 0, differing = 0;
  for (const char* const kind : {"laz", "copc"}) {
    for (const auto& [name, what] : expected_[kind].items()) {
      if (what.value("expect", "read") != "read") continue;
      const std::filesystem::path path = folder_ / name;
      const auto source = open_point_source(path);
      const LasFile& las = *source->header().las;
      if (!las.laz || las.laz->sequential) continue;
      const std::string records = records_of(path, {});
      std::uint64_t first = 0;
      for (const laz::LazChunk& chunk : las.laz->chunks) {
        const std::string coded = laz::encode_chunk(
            las.laz->items, bytes_of(records) + first * las.record_length, chunk.points);
        if (coded == las.bytes->read(chunk.start, chunk.size)) {
          ++equal;
        } else {
          ++differing;
          ADD_FAILURE() << name << " chunk of " << chunk.points << " points: " << coded.size()
                        << " bytes, in the file " << chunk.size;
        }
        first += chunk.points;
      }
    }
  }
  RecordProperty("equal_chunks", static_cast<int>(equal));
  EXPECT_EQ(differing, 0u);
}

TEST_F(SurveyFiles, AttributesThatAreNotWantedAreLeftOut) {
  for (const char* const name : {"laz/pdrf8-1.4.laz", "laz/1.2-with-color.laz"}) {
    ReadOptions some;
    some.attributes = {"classification"};
    const CloudFile all = read_cloud_file(folder_ / name),
                    part = read_cloud_file(folder_ / name, some);
    EXPECT_EQ(part.cloud.points, all.cloud.points);
    EXPECT_EQ(part.cloud.labels.size(), 1u);
    EXPECT_EQ(part.cloud.labels.at("classification"), all.cloud.labels.at("classification"));
    EXPECT_TRUE(part.cloud.colors.empty());
    EXPECT_TRUE(part.cloud.scalars.empty());
  }
}

TEST_F(SurveyFiles, CopcLevelsAreReadByResolution) {
  const std::filesystem::path path = folder_ / "copc/simple.copc.laz";
  ReadOptions options;
  const std::size_t all = read_cloud(path).size();
  std::size_t before = 0;
  for (const double resolution : {1e6, 30.0, 10.0, 1e-3}) {
    options.resolution = resolution;
    const std::size_t count = read_cloud(path, options).size();
    EXPECT_GE(count, before);
    EXPECT_GT(count, 0u);
    before = count;
  }
  EXPECT_EQ(before, all);
  EXPECT_EQ(read_cloud(folder_ / "copc/simple_with_page.copc.laz", options).size(), all);
  for (const char* const name : {"node_beyond_end", "node_count_wrong", "page_cycle"}) {
    try {
      read_cloud(folder_ / ("copc/damaged/" + std::string(name) + ".copc.laz"), options);
      ADD_FAILURE() << name;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("of the COPC index")) << name;
    }
  }
  EXPECT_THROW(read_cloud(folder_ / "laz/1815.laz", options), InputError);
}

}  // namespace
}  // namespace camber
