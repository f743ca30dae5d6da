#include "camber/detect/detail/onnx_weights.h"

#include <gtest/gtest.h>

#include <string>

#include "camber/detect/network.h"
#include "detect/made_onnx.h"

namespace camber {
namespace {

using test::MadePrecision;

/// Weights that half precision holds.
std::string made(MadePrecision precision) {
  test::MadeConvolution convolution;
  convolution.channels = {{{1.0, -0.5, 0.0}, 0.1}, {{0.25, 2.0, 1.0}, -3.0}};
  return test::made_onnx(32, 16, 8, {convolution}, precision);
}

TEST(HalfWeights, BecomeFloats) {
  ASSERT_LT(made(MadePrecision::kHalf).size(), made(MadePrecision::kSingle).size());
  EXPECT_EQ(half_weights_to_floats(made(MadePrecision::kHalf)), made(MadePrecision::kSingle));
}

TEST(HalfWeights, AFileOfFloatsStaysAsItIs) {
  EXPECT_EQ(half_weights_to_floats(made(MadePrecision::kSingle)), made(MadePrecision::kSingle));
}

TEST(HalfWeights, WhatIsNoFileStaysAsItIs) {
  const std::string whole = made(MadePrecision::kHalf);
  // The operator set is the last field of the file: without it the rest is a file.
  const std::size_t last_field = whole.size() - 6;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    if (size == last_field) continue;
    const std::string cut = whole.substr(0, size);
    EXPECT_EQ(half_weights_to_floats(cut), cut) << size;
  }
  EXPECT_EQ(half_weights_to_floats("no network at all"), "no network at all");
}

TEST(HalfWeights, ANetworkOfThemGivesWhatTheSameNumbersGive) {
  NetworkInput input;
  input.width = 32;
  input.height = 16;
  const Image picture = check_image(input);
  const Tensor tensor = make_input(input, picture, place_in_input(input, {0, 0, 32, 16}));
  const auto network = open_network({"half", made(MadePrecision::kHalf)}, input, {});
  const auto same = open_network({"single", made(MadePrecision::kSingle)}, input, {});
  EXPECT_EQ(network->run(tensor).at(0).values, same->run(tensor).at(0).values);
  EXPECT_NE(network->hash(), same->hash()) << "the hash is the file's";
}

}  // namespace
}  // namespace camber
