#include "detect/made_onnx.h"

#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>

namespace camber::test {
namespace {

/// A message of protobuf's wire format.
class Message {
 public:
  Message& number(int field, std::int64_t value) {
    varint(static_cast<std::uint64_t>(field) << 3);
    varint(static_cast<std::uint64_t>(value));
    return *this;
  }
  Message& bytes(int field, const std::string& value) {
    varint(static_cast<std::uint64_t>(field) << 3 | 2);
    varint(value.size());
    bytes_ += value;
    return *this;
  }
  Message& message(int field, const Message& value) { return bytes(field, value.bytes_); }
  const std::string& str() const { return bytes_; }

 private:
  void varint(std::uint64_t value) {
    for (; value >= 128; value >>= 7) bytes_ += static_cast<char>((value & 127) | 128);
    bytes_ += static_cast<char>(value);
  }
  std::string bytes_;
};

constexpr int kFloat = 1, kInts = 7, kFloat16 = 10;

Message tensor(const std::string& name, const std::vector<int>& shape,
               const std::vector<float>& values) {
  Message out;
  for (const int size : shape) out.number(1, size);
  std::string raw(values.size() * sizeof(float), '\0');
  std::memcpy(raw.data(), values.data(), raw.size());
  return out.number(2, kFloat).bytes(8, name).bytes(9, raw);
}

/// Of normal numbers of half precision and zero.
Message half_tensor(const std::string& name, const std::vector<int>& shape,
                    const std::vector<float>& values) {
  Message out;
  for (const int size : shape) out.number(1, size);
  std::string raw;
  for (const float value : values) {
    std::uint32_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    const std::uint32_t exponent = bits >> 23 & 0xff, sign = bits >> 16 & 0x8000;
    const std::uint32_t half =
        exponent == 0 ? sign : sign | (exponent - 112) << 10 | (bits >> 13 & 0x3ff);
    raw += static_cast<char>(half & 0xff);
    raw += static_cast<char>(half >> 8);
  }
  return out.number(2, kFloat16).bytes(8, name).bytes(9, raw);
}

Message value_info(const std::string& name, const std::vector<int>& shape) {
  Message dimensions;
  for (const int size : shape) dimensions.message(1, Message().number(1, size));
  const Message type = Message().number(1, kFloat).message(2, dimensions);
  return Message().bytes(1, name).message(2, Message().message(1, type));
}

Message attribute(const std::string& name, const std::vector<int>& values) {
  Message out;
  out.bytes(1, name);
  for (const int value : values) out.number(8, value);
  return out.number(20, kInts);
}

}  // namespace

std::string made_onnx(int width, int height, int cell,
                      const std::vector<MadeConvolution>& convolutions, MadePrecision precision) {
  Message graph;
  for (const MadeConvolution& c : convolutions) {
    graph.message(1, Message()
                         .bytes(1, "image")
                         .bytes(1, c.name + "_weights")
                         .bytes(1, c.name + "_bias")
                         .bytes(2, c.name)
                         .bytes(3, c.name + "_node")
                         .bytes(4, "Conv")
                         .message(5, attribute("kernel_shape", {cell, cell}))
                         .message(5, attribute("strides", {cell, cell})));
  }
  graph.bytes(2, "made");
  for (const MadeConvolution& c : convolutions) {
    const auto count = static_cast<int>(c.channels.size());
    std::vector<float> weights, bias;
    for (const MadeConvolution::Channel& channel : c.channels) {
      bias.push_back(static_cast<float>(channel.bias));
      for (const double share : channel.of_mean) {
        weights.insert(weights.end(), static_cast<std::size_t>(cell * cell),
                       static_cast<float>(share / (cell * cell)));
      }
    }
    const auto stored = precision == MadePrecision::kHalf ? half_tensor : tensor;
    graph.message(5, stored(c.name + "_weights", {count, 3, cell, cell}, weights));
    graph.message(5, tensor(c.name + "_bias", {count}, bias));
  }
  graph.message(11, value_info("image", {1, 3, height, width}));
  for (const MadeConvolution& c : convolutions) {
    graph.message(12, value_info(c.name, {1, static_cast<int>(c.channels.size()), height / cell,
                                          width / cell}));
  }
  return Message()
      .number(1, 7)
      .message(7, graph)
      .message(8, Message().bytes(1, "").number(2, 11))
      .str();
}

std::string declared_onnx(const std::vector<int>& input, const std::vector<int>& output,
                          const std::string& names) {
  Message graph;
  graph.message(11, value_info("images", input)).message(12, value_info("output", output));
  Message model;
  model.number(1, 7).message(7, graph);
  if (!names.empty()) model.message(14, Message().bytes(1, "names").bytes(2, names));
  return model.str();
}

void write_file(const std::filesystem::path& path, const std::string& content) {
  std::ofstream(path, std::ios::binary) << content;
}

std::string red_cell_detector(int width, int height, double size) {
  const auto logit = [](double share) { return std::log(share / (1.0 - share)); };
  const double middle = std::atanh(0.5);
  MadeConvolution out;
  out.channels = {{{1.0, 0.0, 0.0}, 0.0},     {{}, middle}, {{}, middle}, {{}, logit(size / width)},
                  {{}, logit(size / height)}, {{}, 0.0},    {{}, 1.0}};
  return made_onnx(width, height, 8, {out});
}

std::string color_segmenter(int width, int height) {
  MadeConvolution out;
  out.channels = {{{}, 0.5}, {{1.0, 0.0, 0.0}, 0.0}, {{0.0, 1.0, 0.0}, 0.0}};
  return made_onnx(width, height, 1, {out});
}

}  // namespace camber::test
