#include "camber/detect/detail/onnx_weights.h"

#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <optional>
#include <string_view>
#include <utility>

#include "camber/detect/detail/protobuf_reader.h"

namespace camber {
namespace {

using internal::Field;
using internal::MessageReader;
using internal::WireType;
constexpr WireType kVarint = internal::kVarint, kBytes = internal::kBytes;

// Numbers of fields and values of onnx.proto (ONNX 1.12).
constexpr std::uint64_t kModelGraph = 7, kGraphInitializer = 5;
constexpr std::uint64_t kTensorDataType = 2, kTensorInt32Data = 5, kTensorRawData = 9;
constexpr std::uint64_t kFloat = 1, kFloat16 = 10;

void append_varint(std::uint64_t value, std::string* out) {
  for (; value >= 0x80; value >>= 7) out->push_back(static_cast<char>(value | 0x80));
  out->push_back(static_cast<char>(value));
}

void append_bytes(std::uint64_t number, std::string_view value, std::string* out) {
  append_varint(number << 3 | kBytes, out);
  append_varint(value.size(), out);
  out->append(value);
}

/// @return the tensor with floats in place of halves; nothing if it holds no raw halves.
std::optional<std::string> to_floats(std::string_view tensor) {
  MessageReader reader(tensor);
  std::string out;
  bool halves = false;
  std::string_view raw;
  while (const std::optional<Field> field = reader.next()) {
    if (field->number == kTensorDataType && field->type == kVarint) {
      halves = field->varint == kFloat16;
      append_varint(kTensorDataType << 3 | kVarint, &out);
      append_varint(kFloat, &out);
    } else if (field->number == kTensorRawData && field->type == kBytes) {
      raw = field->bytes;
    } else if (field->number == kTensorInt32Data) {
      return std::nullopt;  // halves one by one: not what exporters write for weights
    } else {
      out.append(field->whole);
    }
  }
  if (!reader.whole() || !halves || raw.size() % 2 != 0 || raw.empty()) return std::nullopt;
  const auto count = static_cast<int>(raw.size() / 2);
  cv::Mat half(1, count, CV_16F), values;
  std::memcpy(half.data, raw.data(), raw.size());
  half.convertTo(values, CV_32F);
  append_bytes(kTensorRawData,
               {reinterpret_cast<const char*>(values.data), static_cast<std::size_t>(count) * 4},
               &out);
  return out;
}

/// A message whose fields of one number are replaced by what `change` makes of them.
/// @return nothing if it makes nothing of any, or the message is broken.
template <typename Change>
std::optional<std::string> with_changed(std::string_view message, std::uint64_t number,
                                        const Change& change) {
  MessageReader reader(message);
  std::string out;
  bool changed = false;
  while (const std::optional<Field> field = reader.next()) {
    std::optional<std::string> other;
    if (field->number == number && field->type == kBytes) other = change(field->bytes);
    if (other) {
      append_bytes(number, *other, &out);
      changed = true;
    } else {
      out.append(field->whole);
    }
  }
  if (!changed || !reader.whole()) return std::nullopt;
  return out;
}

}  // namespace

std::string half_weights_to_floats(std::string onnx) {
  // cv::Mat counts in int.
  if (onnx.size() > 0x7fffffffU) return onnx;
  std::optional<std::string> changed = with_changed(onnx, kModelGraph, [](std::string_view graph) {
    return with_changed(graph, kGraphInitializer, to_floats);
  });
  return changed ? std::move(*changed) : std::move(onnx);
}

}  // namespace camber
