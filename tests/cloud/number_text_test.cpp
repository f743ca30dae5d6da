#include "camber/cloud/number_text.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "camber/cloud/lzf.h"
#include "camber/core/random.h"

namespace camber {
namespace {

ParsedNumber parse(const std::string& text) {
  return parse_number(text.data(), text.data() + text.size());
}

TEST(ParseNumber, AgreesWithTheStandardLibraryBitForBit) {
  const CounterRandom random(7);
  std::vector<std::string> texts = {"0",
                                    "-0",
                                    "+5",
                                    "1e22",
                                    "1e23",
                                    "123456789012345678",
                                    "9007199254740993",
                                    "0.1",
                                    "1e-22",
                                    "1e-23",
                                    "4.9e-324",
                                    "1.7976931348623157e308",
                                    "00012.500",
                                    ".5",
                                    "5.",
                                    "-.25e+3",
                                    "1234567890123456789012345678901234567890",
                                    "1e400",
                                    "-1e400",
                                    "1e-400",
                                    "0.000000000000000000000000000000000000001e39",
                                    "0e999999999999",
                                    "1E5"};
  for (std::uint64_t i = 0; i < 20000; ++i) {
    char text[64];
    const double value = std::ldexp(random.uniform(3 * i, -1.0, 1.0),
                                    static_cast<int>(random.below(3 * i + 1, 200)) - 100);
    std::snprintf(text, sizeof text, i % 3 == 0 ? "%.17g" : i % 3 == 1 ? "%.6f" : "%.9e", value);
    texts.emplace_back(text);
  }
  for (const std::string& text : texts) {
    const ParsedNumber number = parse(text);
    ASSERT_EQ(number.end, text.data() + text.size()) << text;
    const double expected = std::strtod(text.c_str(), nullptr);
    EXPECT_EQ(number.value, expected) << text;
    EXPECT_EQ(std::signbit(number.value), std::signbit(expected)) << text;
  }
}

TEST(ParseNumber, KnowsTheWordsAndStopsWhereTheNumberEnds) {
  EXPECT_TRUE(std::isnan(parse("nan").value));
  EXPECT_TRUE(std::isnan(parse("-NaN(ind)").value));
  EXPECT_EQ(parse("Inf").value, std::numeric_limits<double>::infinity());
  EXPECT_EQ(parse("-infinity").value, -std::numeric_limits<double>::infinity());
  for (const char* const text : {"", "-", ".", "e5", "x", "+-1", "--1", "na", "in"}) {
    EXPECT_EQ(parse(text).end, nullptr) << text;
  }
  const std::string text = "12e,5";
  EXPECT_EQ(parse_number(text.data(), text.data() + text.size()).end, text.data() + 2);
  EXPECT_TRUE(parse("12").whole);
  EXPECT_FALSE(parse("12.").whole);
  EXPECT_FALSE(parse("1e1").whole);
}

TEST(AppendNumber, ReadsBackTheSame) {
  const CounterRandom random(3);
  for (std::uint64_t i = 0; i < 10000; ++i) {
    const std::uint32_t bits = static_cast<std::uint32_t>(random.bits(i));
    float value;
    std::memcpy(&value, &bits, 4);
    if (!std::isfinite(value)) continue;
    std::string text;
    append_number(text, value);
    EXPECT_EQ(static_cast<float>(parse(text).value), value) << text;
  }
  std::string text;
  append_number(text, -std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(text, "nan");
}

TEST(ParseUnsigned, TakesWholeNumbersBelowTwoToThe64) {
  std::uint64_t value = 0;
  EXPECT_TRUE(parse_unsigned("18446744073709551615", value));
  EXPECT_EQ(value, UINT64_MAX);
  for (const char* const text : {"18446744073709551616", "", "-1", "+1", "1.0", "1 ", "0x1"}) {
    EXPECT_FALSE(parse_unsigned(text, value)) << text;
  }
}

TEST(Lzf, RoundTripsAnyBytes) {
  const CounterRandom random(11);
  for (std::uint64_t trial = 0; trial < 300; ++trial) {
    std::string bytes;
    const std::uint64_t size = random.below(3 * trial, 30000);
    const std::uint64_t alphabet = 1 + random.below(3 * trial + 1, 256);
    const CounterRandom content(13, trial);
    for (std::uint64_t i = 0; i < size; ++i) {
      // Runs, repeats from afar and noise.
      const std::uint64_t kind = trial % 3;
      bytes += static_cast<char>(content.below(kind == 0   ? i
                                               : kind == 1 ? i / 50
                                                           : i % 9000,
                                               alphabet));
    }
    const auto* const data = reinterpret_cast<const unsigned char*>(bytes.data());
    const std::string packed = lzf_compress(data, bytes.size());
    EXPECT_LE(bytes.size(), lzf_largest_output(packed.size()));
    std::string back(bytes.size(), '\0');
    auto* const out = reinterpret_cast<unsigned char*>(back.data());
    const auto* const in = reinterpret_cast<const unsigned char*>(packed.data());
    ASSERT_EQ(lzf_decompress(in, packed.size(), out, back.size()), nullptr);
    ASSERT_EQ(back, bytes);
    if (bytes.empty()) continue;
    EXPECT_NE(lzf_decompress(in, packed.size(), out, back.size() - 1), nullptr);
    EXPECT_NE(lzf_decompress(in, packed.size() - 1, out, back.size()), nullptr);
  }
}

TEST(Lzf, ReadsWhatTheFormatSays) {
  // Two plain bytes, a copy of 3 from 2 back, a long copy of 9 + 1 from 1 back.
  const unsigned char packed[] = {1, 'a', 'b', 0x20, 1, 0xe0, 1, 0};
  unsigned char out[15];
  ASSERT_EQ(lzf_decompress(packed, sizeof packed, out, 15), nullptr);
  EXPECT_EQ(std::string(reinterpret_cast<char*>(out), 15), "ababaaaaaaaaaaa");
  const unsigned char before_start[] = {0, 'a', 0x20, 1};
  EXPECT_STREQ(lzf_decompress(before_start, 4, out, 4), "the data are damaged");
}

// The library does not clear its table of places seen; its header promises no more than that the
// result can be read.
TEST(Lzf, GivesTheSameBytesWhateverWasCompressedBefore) {
  const CounterRandom random(17);
  std::string bytes(100000, '\0'), other = bytes;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    bytes[i] = static_cast<char>(random.below(i, 5) == 0 ? random.below(i + bytes.size(), 3) : 0);
  }
  const auto pack = [](const std::string& text) {
    return lzf_compress(reinterpret_cast<const unsigned char*>(text.data()), text.size());
  };
  const std::string first = pack(bytes);
  for (std::uint64_t trial = 0; trial < 20; ++trial) {
    const CounterRandom content(19, trial);
    for (std::size_t i = 0; i < other.size(); ++i) {
      other[i] = static_cast<char>(content.below(i, 1 + trial));
    }
    pack(other);
    EXPECT_EQ(pack(bytes), first);
  }
}

}  // namespace
}  // namespace camber
