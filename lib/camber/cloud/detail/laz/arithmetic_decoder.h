#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "camber/cloud/detail/laz/adaptive_model.h"

namespace camber::laz {

/// Where a decoder gets further bytes from.
class ByteFeed {
 public:
  virtual ~ByteFeed() = default;
  /// The bytes that follow; false where there are none.
  virtual bool more(const unsigned char** begin, const unsigned char** end) = 0;
};

/// Takes symbols out of bytes. Damaged bytes give wrong symbols, never undefined behaviour; what
/// can be seen of it is in `exhausted` and `damaged`.
class ArithmeticDecoder {
 public:
  static constexpr bool kEncoding = false;

  ArithmeticDecoder() = default;
  ArithmeticDecoder(const unsigned char* begin, const unsigned char* end, ByteFeed* feed = nullptr)
      : at_(begin), end_(end), feed_(feed) {}

  /// The next bytes as they are; before start(), and the zeros of an end that came too early.
  void copy(unsigned char* out, std::size_t size) {
    for (std::size_t i = 0; i < size; ++i) out[i] = byte();
  }
  /// Takes the four bytes that go before the first symbol.
  void start() {
    length_ = UINT32_MAX;
    value_ = 0;
    for (int i = 0; i < 4; ++i) value_ = value_ << 8 | byte();
    damaged_ = damaged_ || value_ == UINT32_MAX;
  }

  unsigned symbol(SymbolModel& model, unsigned /*unused*/ = 0) {
    const std::uint32_t unit = length_ >> kSymbolBits;
    const std::uint32_t place = value_ / unit;
    constexpr std::uint32_t kLast = (1u << kSymbolBits) - 1;
    const unsigned symbol = model.find(place < kLast ? place : kLast);
    const std::uint32_t low = model.start(symbol) * unit;
    const std::uint32_t high = symbol == model.last() ? length_ : model.start(symbol + 1) * unit;
    value_ -= low;
    length_ = high - low;
    renormalise();
    model.count(symbol);
    return symbol;
  }

  unsigned bit(BitModel& model, unsigned /*unused*/ = 0) {
    const std::uint32_t low = model.zero() * (length_ >> kBitBits);
    const unsigned bit = value_ >= low ? 1 : 0;
    if (bit == 0) {
      length_ = low;
    } else {
      value_ -= low;
      length_ -= low;
    }
    renormalise();
    model.count(bit);
    return bit;
  }

  /// 1 to 32 bits that no model describes.
  std::uint32_t bits(unsigned count, std::uint32_t /*unused*/ = 0) {
    if (count > kMostBitsAtOnce) {
      const std::uint32_t low = bits(16);
      return bits(count - 16) << 16 | low;
    }
    length_ >>= count;
    std::uint32_t number = value_ / length_;
    if (number >> count != 0) {  // no encoder leaves this part of an interval
      damaged_ = true;
      number = (1u << count) - 1;
    }
    value_ -= number * length_;
    renormalise();
    return number;
  }

  std::uint64_t bits64(std::uint64_t /*unused*/ = 0) {
    const std::uint64_t low = bits(32);
    return std::uint64_t{bits(32)} << 32 | low;
  }

  /// Bytes were asked for behind the last one: what was decoded since is wrong.
  bool exhausted() const { return exhausted_; }
  bool damaged() const { return damaged_; }
  void set_damaged() { damaged_ = true; }
  const unsigned char* position() const { return at_; }  ///< behind the last byte that was taken

 private:
  static constexpr unsigned kMostBitsAtOnce = 19;
  static constexpr std::uint32_t kShortest = 1u << 24;

  unsigned char byte() {
    if (at_ == end_ && !refill()) return 0;
    return *at_++;
  }
  bool refill() {
    if (feed_ != nullptr && feed_->more(&at_, &end_)) return true;
    exhausted_ = true;
    return false;
  }
  void renormalise() {
    // How many bytes come next cannot be foretold, so there is no branch for each of them.
    if (end_ - at_ >= 4 && length_ != 0) {
      std::uint32_t next;
      std::memcpy(&next, at_, sizeof next);
      const int bytes = __builtin_clz(length_) / 8;
      const std::uint64_t shifted = (std::uint64_t{value_} << 32 | __builtin_bswap32(next))
                                    << 8 * bytes;
      value_ = static_cast<std::uint32_t>(shifted >> 32);
      length_ <<= 8 * bytes;
      at_ += bytes;
      return;
    }
    while (length_ < kShortest) {
      // Damaged bytes can leave an interval of nothing.
      if (length_ == 0) {
        damaged_ = true;
        length_ = kShortest;
      } else {
        length_ <<= 8;
      }
      value_ = value_ << 8 | byte();
    }
  }

  const unsigned char* at_ = nullptr;
  const unsigned char* end_ = nullptr;
  ByteFeed* feed_ = nullptr;
  std::uint32_t value_ = 0, length_ = UINT32_MAX;
  bool exhausted_ = false, damaged_ = false;
};

}  // namespace camber::laz
