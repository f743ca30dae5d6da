#include "camber/core/median.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/core/csv_field.h"
#include "camber/core/lower_case.h"

namespace camber {
namespace {

TEST(UpperMedian, OfTwoInTheMiddleIsTheLarger) {
  EXPECT_EQ(upper_median({3.0, 1.0, 2.0}), 2.0);
  EXPECT_EQ(upper_median({4.0, 1.0, 3.0, 2.0}), 3.0);
  EXPECT_TRUE(std::isnan(upper_median(std::vector<double>())));
}

TEST(CsvField, IsInQuotesWhereACommaOrAQuoteWouldEndIt) {
  EXPECT_EQ(csv_field("z-up"), "z-up");
  EXPECT_EQ(csv_field("a,\"b\"\n"), "\"a,\"\"b\"\"\n\"");
}

TEST(LowerCase, ChangesAsciiLettersAlone) { EXPECT_EQ(lower_case("KITTI Ä_09"), "kitti Ä_09"); }

}  // namespace
}  // namespace camber
