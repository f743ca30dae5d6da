#include "camber/detect/detail/onnx_weights.h"

#include <cstdint>
#include <cstring>
#include <opencv2/core.hpp>
#include <optional>
#include <string_view>
#include <utility>

namespace camber {
namespace {

// https://protobuf.dev/programming-guides/encoding: a message is a row of fields, each a key
// (number and wire type) and its value.
enum WireType { kVarint = 0, kFixed64 = 1, kBytes = 2, kFixed32 = 5 };

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

struct Field {
  std::uint64_t number = 0;
  std::uint64_t type = 0;
  std::uint64_t varint = 0;  ///< of kVarint
  std::string_view bytes;    ///< of kBytes
  std::string_view whole;    ///< with its key
};

class MessageReader {
 public:
  explicit MessageReader(std::string_view message) : left_(message) {}

  /// The next field; nothing at the end and where there is none, see whole().
  std::optional<Field> next() {
    if (left_.empty()) return std::nullopt;
    const std::string_view from = left_;
    Field field;
    const std::optional<std::uint64_t> key = varint();
    if (!key) return broken();
    field.number = *key >> 3;
    field.type = *key & 7;
    std::size_t size = 0;
    if (field.type == kVarint) {
      const std::optional<std::uint64_t> value = varint();
      if (!value) return broken();
      field.varint = *value;
    } else if (field.type == kBytes) {
      const std::optional<std::uint64_t> length = varint();
      if (!length || *length > left_.size()) return broken();
      size = static_cast<std::size_t>(*length);
      field.bytes = left_.substr(0, size);
    } else if (field.type == kFixed64 || field.type == kFixed32) {
      size = field.type == kFixed64 ? 8 : 4;
    } else {
      return broken();
    }
    if (size > left_.size()) return broken();
    left_.remove_prefix(size);
    field.whole = from.substr(0, from.size() - left_.size());
    return field;
  }

  /// Whether all up to here was a message.
  bool whole() const { return whole_; }

 private:
  std::optional<Field> broken() {
    whole_ = false;
    left_ = {};
    return std::nullopt;
  }

  std::optional<std::uint64_t> varint() {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < 10 && i < left_.size(); ++i) {
      const auto byte = static_cast<std::uint8_t>(left_[i]);
      value |= static_cast<std::uint64_t>(byte & 0x7f) << (7 * i);
      if (byte < 0x80) {
        left_.remove_prefix(i + 1);
        return value;
      }
    }
    return std::nullopt;
  }

  std::string_view left_;
  bool whole_ = true;
};

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
