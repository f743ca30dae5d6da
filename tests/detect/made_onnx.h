#pragma once

#include <array>
#include <filesystem>
#include <string>
#include <vector>

namespace camber::test {

/// One convolution over cells of the input that do not overlap: an output (1, channels,
/// height / cell, width / cell) of sums of the cells' mean values of three channels.
struct MadeConvolution {
  struct Channel {
    std::array<double, 3> of_mean = {0.0, 0.0, 0.0};
    double bias = 0.0;
  };
  std::string name = "out";
  std::vector<Channel> channels;
};

enum class MadePrecision { kSingle, kHalf };

/// The bytes of an ONNX file (opset 11): an input "image" (1, 3, height, width) and convolutions
/// side by side. Of half precision are the weights, rounded towards zero, not the biases.
std::string made_onnx(int width, int height, int cell,
                      const std::vector<MadeConvolution>& convolutions,
                      MadePrecision precision = MadePrecision::kSingle);

/// The bytes of an ONNX file without layers that declares one input and one output, and carries
/// `names` as its metadata; empty: none. Sizes of -1 are left open.
std::string declared_onnx(const std::vector<int>& input, const std::vector<int>& output,
                          const std::string& names = {});

void write_file(const std::filesystem::path& path, const std::string& content);

/// Finds red cells of 8 px: head fastestdet with the classes other and car, boxes of `size` px at
/// the cells' middles, the score red^0.6.
std::string red_cell_detector(int width, int height, double size);

/// Head argmax with the classes other, road (red) and pavement (green), by pixels.
std::string color_segmenter(int width, int height);

}  // namespace camber::test
