#pragma once

#include <cstdint>
#include <memory>
#include <vector>

/// What LASzip's files are coded with: M. Isenburg, "LASzip: lossless compression of LiDAR data",
/// PE&RS 79(2), 2013, and "Introduction to Arithmetic Coding Theory and Practice", HP Labs report
/// HPL-2004-76, 2004. docs/notes/laz.md has the facts of the format with their sources.
namespace camber::laz {

inline constexpr unsigned kSymbolBits = 15;  ///< the frequencies of a model add up to 2^15
inline constexpr unsigned kBitBits = 13;     ///< those of a bit to 2^13

/// Frequencies of 2 to 1024 symbols, adapted to what was coded: decoder and encoder change their
/// own in the same way.
class SymbolModel {
 public:
  SymbolModel() = default;  ///< of no symbols: not made yet
  explicit SymbolModel(unsigned symbols);

  bool made() const { return starts_ != nullptr; }

  unsigned last() const { return symbols_ - 1; }
  /// Where a symbol's interval starts, of 2^15; that of `last() + 1` ends the last one.
  std::uint32_t start(unsigned symbol) const { return starts_[symbol]; }
  /// The symbol whose interval has a place, 0 to 2^15 - 1.
  unsigned find(std::uint32_t place) const {
    unsigned symbol = hints_[place >> hint_shift_];
    while (starts_[symbol + 1] <= place) ++symbol;
    return symbol;
  }
  void count(unsigned symbol) {
    ++counts_[symbol];
    if (--until_update_ == 0) update();
  }

 private:
  void update();

  std::uint16_t* starts_ = nullptr;
  std::uint16_t* counts_ = nullptr;
  std::uint16_t* hints_ = nullptr;  // the first symbol of each of 2^hint_bits parts
  unsigned hint_shift_ = 0;
  std::uint32_t until_update_ = 0;
  std::uint32_t symbols_ = 0, total_ = 0, cycle_ = 0;
  std::unique_ptr<std::uint16_t[]> memory_;
};

/// The frequency of a bit that is 0.
class BitModel {
 public:
  std::uint32_t zero() const { return zero_; }  ///< of 2^13
  void count(unsigned bit) {
    zero_count_ += 1 - bit;
    if (--until_update_ == 0) update();
  }

 private:
  void update();

  std::uint32_t zero_count_ = 1, total_ = 2, zero_ = 1u << (kBitBits - 1);
  std::uint32_t until_update_ = 4, cycle_ = 4;
};

/// Models of one size by number, made when they are first used: most contexts never are.
class SymbolModels {
 public:
  SymbolModels(std::size_t count, unsigned symbols) : symbols_(symbols), models_(count) {}
  SymbolModel& operator[](std::size_t i) {
    if (!models_[i].made()) models_[i] = SymbolModel(symbols_);
    return models_[i];
  }

 private:
  unsigned symbols_;
  std::vector<SymbolModel> models_;
};

/// Codes integers by their difference to a prediction: how many bits the difference has, then its
/// place among the numbers of that many bits.
class IntegerModel {
 public:
  /// @param bits  8, 16 or 32; of the integers, which wrap around
  explicit IntegerModel(unsigned bits, unsigned contexts = 1)
      : bits_(bits), widths_(contexts, bits + 1), places_(bits + 1) {}

  /// Bits of the last difference.
  unsigned width() const { return width_; }

  /// @param actual  what is coded; unused when decoding
  /// @return        the integer; of 8 and 16 bits, not negative
  template <typename Coder>
  std::int32_t code(Coder& coder, std::int32_t predicted, unsigned context, std::int32_t actual);

 private:
  static constexpr unsigned kModelledBits = 8;  // the others are coded as they are
  SymbolModel& place(unsigned width);

  unsigned bits_;
  unsigned width_ = 0;
  SymbolModels widths_;
  BitModel zero_or_one_;
  std::vector<SymbolModel> places_;  // by width
};

inline SymbolModel& IntegerModel::place(unsigned width) {
  SymbolModel& model = places_[width];
  if (!model.made()) model = SymbolModel(1u << (width < kModelledBits ? width : kModelledBits));
  return model;
}

template <typename Coder>
std::int32_t IntegerModel::code(Coder& coder, std::int32_t predicted, unsigned context,
                                std::int32_t actual) {
  const std::int64_t range = std::int64_t{1} << bits_;
  std::int64_t difference = 0;
  unsigned width = 0;
  if constexpr (Coder::kEncoding) {
    difference = std::int64_t{actual} - predicted;
    if (difference < -range / 2) difference += range;
    if (difference >= range / 2) difference -= range;
    const std::uint64_t size =
        static_cast<std::uint64_t>(difference <= 0 ? -difference : difference - 1);
    width = size == 0 ? 0 : 64 - static_cast<unsigned>(__builtin_clzll(size));
  }
  width = coder.symbol(widths_[context], width);
  width_ = width;
  if (width == 0) {
    difference = coder.bit(zero_or_one_, static_cast<unsigned>(difference));
  } else if (width < 32) {
    // -(2^k - 1) to -2^(k-1) come first, then 2^(k-1) + 1 to 2^k.
    const std::int64_t negative = (std::int64_t{1} << width) - 1;
    std::uint32_t number =
        static_cast<std::uint32_t>(difference > 0 ? difference - 1 : difference + negative);
    if (width <= kModelledBits) {
      number = coder.symbol(place(width), number);
    } else {
      const unsigned low_bits = width - kModelledBits;
      const std::uint32_t high = coder.symbol(place(width), number >> low_bits);
      const std::uint32_t low = coder.bits(low_bits, number & ((1u << low_bits) - 1));
      number = high << low_bits | low;
    }
    difference = number >> (width - 1) != 0 ? std::int64_t{number} + 1 : number - negative;
  } else {
    difference = INT32_MIN;
  }
  if (bits_ == 32) {
    return static_cast<std::int32_t>(static_cast<std::uint32_t>(predicted) +
                                     static_cast<std::uint32_t>(difference));
  }
  std::int64_t value = predicted + difference;
  if (value < 0) {
    value += range;
  } else if (value >= range) {
    value -= range;
  }
  return static_cast<std::int32_t>(value & (range - 1));
}

}  // namespace camber::laz
