#pragma once

#include <cstdint>
#include <string>

#include "camber/cloud/detail/laz/adaptive_model.h"

namespace camber::laz {

/// Puts symbols into bytes, from which ArithmeticDecoder takes them in the same order.
class ArithmeticEncoder {
 public:
  static constexpr bool kEncoding = true;

  /// Bytes as they are; before the first symbol.
  void copy(const unsigned char* data, std::size_t size) {
    out_.append(reinterpret_cast<const char*>(data), size);
  }

  unsigned symbol(SymbolModel& model, unsigned symbol) {
    const std::uint32_t unit = length_ >> kSymbolBits;
    const std::uint32_t low = model.start(symbol) * unit;
    const std::uint32_t high = symbol == model.last() ? length_ : model.start(symbol + 1) * unit;
    narrow(low, high - low);
    model.count(symbol);
    return symbol;
  }

  unsigned bit(BitModel& model, unsigned bit) {
    const std::uint32_t low = model.zero() * (length_ >> kBitBits);
    if (bit == 0) {
      narrow(0, low);
    } else {
      narrow(low, length_ - low);
    }
    model.count(bit);
    return bit;
  }

  std::uint32_t bits(unsigned count, std::uint32_t number) {
    if (count > kMostBitsAtOnce) {
      bits(16, number & 0xffff);
      bits(count - 16, number >> 16);
    } else {
      const std::uint32_t unit = length_ >> count;
      narrow(number * unit, unit);
    }
    return number;
  }

  std::uint64_t bits64(std::uint64_t number) {
    bits(32, static_cast<std::uint32_t>(number));
    bits(32, static_cast<std::uint32_t>(number >> 32));
    return number;
  }

  /// The bytes of all symbols. The encoder must not be used after it.
  std::string finish() {
    // A short number within the interval, then as many bytes as a decoder takes.
    const bool wide = length_ > 2 * kShortest;
    narrow(wide ? kShortest : kShortest / 2, wide ? kShortest / 2 : kShortest / 512);
    out_.append(wide ? 3 : 2, '\0');
    return std::move(out_);
  }

 private:
  static constexpr unsigned kMostBitsAtOnce = 19;
  static constexpr std::uint32_t kShortest = 1u << 24;

  void narrow(std::uint32_t low, std::uint32_t length) {
    const std::uint32_t before = base_;
    base_ += low;
    length_ = length;
    if (base_ < before) carry();
    while (length_ < kShortest) {
      out_ += static_cast<char>(base_ >> 24);
      base_ <<= 8;
      length_ <<= 8;
    }
  }
  void carry() {
    std::size_t at = out_.size() - 1;
    while (out_[at] == '\xff') out_[at--] = '\0';
    ++out_[at];
  }

  std::string out_;
  std::uint32_t base_ = 0, length_ = UINT32_MAX;
};

}  // namespace camber::laz
