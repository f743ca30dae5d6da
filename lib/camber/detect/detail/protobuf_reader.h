#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace camber::internal {

// https://protobuf.dev/programming-guides/encoding: a message is a row of fields, each a key
// (number and wire type) and its value.
enum WireType { kVarint = 0, kFixed64 = 1, kBytes = 2, kFixed32 = 5 };

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

}  // namespace camber::internal
