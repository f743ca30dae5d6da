#pragma once

#include <array>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "camber/cloud/detail/laz/adaptive_model.h"

/// What items of several versions have in common.
namespace camber::laz {

template <typename T>
T get(const unsigned char* data) {
  T value;
  std::memcpy(&value, data, sizeof value);
  return value;
}
template <typename T>
void put(unsigned char* data, T value) {
  std::memcpy(data, &value, sizeof value);
}

/// Sums and differences that wrap around.
inline std::int32_t sum(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) + static_cast<std::uint32_t>(b));
}
inline std::int32_t difference(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) - static_cast<std::uint32_t>(b));
}
inline std::int32_t product(std::int32_t a, std::int32_t b) {
  return static_cast<std::int32_t>(static_cast<std::uint32_t>(a) * static_cast<std::uint32_t>(b));
}

/// The middle of five sorted values, of which a new one replaces the highest or the lowest: on the
/// side where the last one did not go.
class RunningMedian {
 public:
  std::int32_t get() const { return sorted_[2]; }
  void add(std::int32_t value) {
    if (replace_highest_) {
      replace_highest_ = value < sorted_[2];
      std::size_t i = 4;
      for (; i > 0 && value < sorted_[i - 1]; --i) sorted_[i] = sorted_[i - 1];
      sorted_[i] = value;
    } else {
      replace_highest_ = value <= sorted_[2];
      std::size_t i = 0;
      for (; i < 4 && sorted_[i + 1] < value; ++i) sorted_[i] = sorted_[i + 1];
      sorted_[i] = value;
    }
  }

 private:
  std::array<std::int32_t, 5> sorted_{};
  bool replace_highest_ = true;
};

/// Contexts by the number of returns (row) and that of the return (column).
inline constexpr unsigned char kReturnContext16[8][8] = {
    {15, 14, 13, 12, 11, 10, 9, 8},  {14, 0, 1, 3, 6, 10, 10, 9},
    {13, 1, 2, 4, 7, 11, 11, 10},    {12, 3, 4, 5, 8, 12, 12, 11},
    {11, 6, 7, 8, 9, 13, 13, 12},    {10, 10, 11, 12, 13, 14, 14, 13},
    {9, 10, 11, 12, 13, 14, 15, 14}, {8, 9, 10, 11, 12, 13, 14, 15}};
inline constexpr char kReturnContext6[16][17] = {
    "0123453445555555", "1013333333333333", "2124444444433333", "3345444444444444",
    "4344544444444444", "5344454444444444", "3344445444444444", "4344444544444444",
    "4344444454444444", "5344444445444444", "5344444444544444", "5334444444455444",
    "5334444444455544", "5334444444445554", "5334444444444555", "5334444444444455"};

/// How many returns are missing to the last one, at most 7.
inline unsigned return_level(unsigned returns, unsigned number) {
  const int level = std::abs(static_cast<int>(returns) - static_cast<int>(number));
  return static_cast<unsigned>(level < 7 ? level : 7);
}

/// The context of y, or of z, by the bits that x, or x and y, took.
inline unsigned width_context(unsigned width, unsigned most, bool single) {
  return (single ? 1 : 0) + (width < most ? width & ~1u : most);
}

/// x, y and z of versions 2 to 4.
class CoordinateModels {
 public:
  CoordinateModels() : x_(32, 2), y_(32, 22), z_(32, 20) {}

  /// Codes the steps to x and y, and counts them in their medians.
  template <typename Coder>
  void code_xy(Coder& coder, RunningMedian& median_x, RunningMedian& median_y, bool single,
               const unsigned char* last, unsigned char* item) {
    std::int32_t step = 0;
    if constexpr (Coder::kEncoding) {
      step = difference(laz::get<std::int32_t>(item), laz::get<std::int32_t>(last));
    }
    step = x_.code(coder, median_x.get(), single ? 1 : 0, step);
    median_x.add(step);
    if constexpr (Coder::kEncoding) {
      step = difference(laz::get<std::int32_t>(item + 4), laz::get<std::int32_t>(last + 4));
    } else {
      put(item, sum(laz::get<std::int32_t>(last), step));
    }
    step = y_.code(coder, median_y.get(), width_context(x_.width(), 20, single), step);
    median_y.add(step);
    if constexpr (!Coder::kEncoding) put(item + 4, sum(laz::get<std::int32_t>(last + 4), step));
  }

  /// After code_xy.
  template <typename Coder>
  void code_z(Coder& coder, std::int32_t* last_z, bool single, unsigned char* item) {
    const unsigned width = (x_.width() + y_.width()) / 2;
    *last_z = z_.code(coder, *last_z, width_context(width, 18, single),
                      Coder::kEncoding ? laz::get<std::int32_t>(item + 8) : 0);
    if constexpr (!Coder::kEncoding) put(item + 8, *last_z);
  }

 private:
  IntegerModel x_, y_, z_;
};

/// The times of versions 2 to 4: four sequences, of each of which the last time and step are known.
/// A time is coded by its step as a multiple of the sequence's.
class TimeModels {
 public:
  /// @param same  version 2: that a time is the last one is coded here; else elsewhere
  explicit TimeModels(bool same)
      : same_(same), first_step_(same ? 6 : 5), multiple_(same ? 516 : 515), steps_(32, 9) {}

  void start(std::int64_t time) { last_[0] = time; }

  template <typename Coder>
  std::int64_t code(Coder& coder, std::int64_t time);

 private:
  static constexpr int kMost = 500, kLeast = -10;
  static constexpr unsigned kSame = kMost - kLeast + 1;

  /// Which of the other sequences a time continues, 1 to 3; 0 for none.
  unsigned other_sequence(std::int64_t time) const {
    for (unsigned i = 1; i < 4; ++i) {
      if (is_step(step_to(time, (current_ + i) & 3))) return i;
    }
    return 0;
  }
  std::int64_t step_to(std::int64_t time, unsigned sequence) const {
    return static_cast<std::int64_t>(static_cast<std::uint64_t>(time) -
                                     static_cast<std::uint64_t>(last_[sequence]));
  }
  static bool is_step(std::int64_t step) { return step == static_cast<std::int32_t>(step); }
  void go(std::int32_t step) {
    last_[current_] = static_cast<std::int64_t>(static_cast<std::uint64_t>(last_[current_]) +
                                                static_cast<std::uint64_t>(std::int64_t{step}));
  }
  /// A step that is out of the range of multiples; the fourth in a row is the new one.
  void count_extreme(std::int32_t step) {
    if (++extremes_[current_] > 3) {
      steps_of_[current_] = step;
      extremes_[current_] = 0;
    }
  }
  template <typename Coder>
  void start_sequence(Coder& coder, std::int64_t time) {
    const std::int32_t high = steps_.code(coder, static_cast<std::int32_t>(last_[current_] >> 32),
                                          8, static_cast<std::int32_t>(time >> 32));
    const std::uint32_t low = coder.bits(32, static_cast<std::uint32_t>(time));
    newest_ = current_ = (newest_ + 1) & 3;
    last_[current_] =
        static_cast<std::int64_t>(std::uint64_t{static_cast<std::uint32_t>(high)} << 32 | low);
    steps_of_[current_] = 0;
    extremes_[current_] = 0;
  }
  template <typename Coder>
  bool code_first_step(Coder& coder, std::int64_t time);
  template <typename Coder>
  bool code_multiple(Coder& coder, std::int64_t time);

  bool same_;
  SymbolModel first_step_, multiple_;
  IntegerModel steps_;
  unsigned current_ = 0, newest_ = 0;
  std::array<std::int64_t, 4> last_{};
  std::array<std::int32_t, 4> steps_of_{};
  std::array<int, 4> extremes_{};
};

template <typename Coder>
std::int64_t TimeModels::code(Coder& coder, std::int64_t time) {
  // A time goes over to another sequence at most once.
  for (int i = 0; i < 2; ++i) {
    if (steps_of_[current_] == 0 ? code_first_step(coder, time) : code_multiple(coder, time)) {
      return last_[current_];
    }
  }
  if constexpr (!Coder::kEncoding) coder.set_damaged();
  return last_[current_];
}

/// @return whether the time is coded; false: the sequence is another one now
template <typename Coder>
bool TimeModels::code_first_step(Coder& coder, std::int64_t time) {
  const unsigned small = same_ ? 1 : 0, large = small + 1;
  const std::int64_t step = step_to(time, current_);
  unsigned kind = 0;
  if constexpr (Coder::kEncoding) {
    kind = same_ && step == 0 ? 0 : is_step(step) ? small : large + other_sequence(time);
  }
  kind = coder.symbol(first_step_, kind);
  if (kind < small) return true;
  if (kind == small) {
    steps_of_[current_] = steps_.code(coder, 0, 0, static_cast<std::int32_t>(step));
    go(steps_of_[current_]);
    extremes_[current_] = 0;
  } else if (kind == large) {
    start_sequence(coder, time);
  } else {
    current_ = (current_ + kind - large) & 3;
    return false;
  }
  return true;
}

template <typename Coder>
bool TimeModels::code_multiple(Coder& coder, std::int64_t time) {
  const unsigned large = same_ ? kSame + 1 : kSame;
  const std::int32_t usual = steps_of_[current_];
  std::int32_t step = 0;
  unsigned kind = 0;
  if constexpr (Coder::kEncoding) {
    const std::int64_t whole_step = step_to(time, current_);
    step = static_cast<std::int32_t>(whole_step);
    if (same_ && whole_step == 0) {
      kind = kSame;
    } else if (is_step(whole_step)) {
      const float multiple = static_cast<float>(step) / static_cast<float>(usual);
      const int whole = !(multiple < kMost) ? kMost
                        : !(multiple > kLeast)
                            ? kLeast
                            : static_cast<int>(multiple < 0 ? multiple - 0.5f : multiple + 0.5f);
      kind = static_cast<unsigned>(whole >= 0 ? whole : kMost - whole);
    } else {
      kind = large + other_sequence(time);
    }
  }
  kind = coder.symbol(multiple_, kind);
  if (same_ && kind == kSame) return true;
  if (kind == large) {
    start_sequence(coder, time);
    return true;
  }
  if (kind > large) {
    current_ = (current_ + kind - large) & 3;
    return false;
  }
  const int multiple = kind <= kMost ? static_cast<int>(kind) : kMost - static_cast<int>(kind);
  const unsigned context = multiple == 1        ? 1
                           : multiple == 0      ? 7
                           : multiple == kMost  ? 4
                           : multiple == kLeast ? 6
                           : multiple < 0       ? 5
                           : multiple < 10      ? 2
                                                : 3;
  step = steps_.code(coder, product(multiple, usual), context, step);
  go(step);
  if (multiple == 1) {
    extremes_[current_] = 0;
  } else if (multiple == 0 || multiple == kMost || multiple == kLeast) {
    count_extreme(step);
  }
  return true;
}

/// Red, green and blue of versions 2 to 4: low and high bytes, green and blue by what red did.
class ColorModels {
 public:
  ColorModels() : changed_(128), bytes_(6, 256) {}

  /// @param last, color  three numbers of 16 bits
  template <typename Coder>
  void code(Coder& coder, const unsigned char* last, unsigned char* color);

 private:
  static int clamp(int value) { return value < 0 ? 0 : value > 255 ? 255 : value; }

  SymbolModel changed_;
  SymbolModels bytes_;
};

template <typename Coder>
void ColorModels::code(Coder& coder, const unsigned char* last, unsigned char* color) {
  constexpr unsigned kNotGrey = 1u << 6;
  unsigned changed = 0;
  if constexpr (Coder::kEncoding) {
    for (unsigned i = 0; i < 6; ++i) changed |= (last[i] != color[i] ? 1u : 0u) << i;
    const bool grey =
        std::memcmp(color, color + 2, 2) == 0 && std::memcmp(color, color + 4, 2) == 0;
    if (!grey) changed |= kNotGrey;
  }
  changed = coder.symbol(changed_, changed);
  /// Byte i of the colour by its prediction.
  const auto code_byte = [&](unsigned i, int predicted) {
    if ((changed & 1u << i) == 0) {
      if constexpr (!Coder::kEncoding) color[i] = last[i];
      return;
    }
    const unsigned correction =
        coder.symbol(bytes_[i], Coder::kEncoding ? (color[i] - predicted) & 255 : 0);
    if constexpr (!Coder::kEncoding) {
      color[i] = static_cast<unsigned char>(correction + static_cast<unsigned>(predicted));
    }
  };
  code_byte(0, last[0]);
  code_byte(1, last[1]);
  if ((changed & kNotGrey) == 0) {
    if constexpr (!Coder::kEncoding) {
      std::memcpy(color + 2, color, 2);
      std::memcpy(color + 4, color, 2);
    }
    return;
  }
  for (unsigned high = 0; high < 2; ++high) {
    int step = color[high] - last[high];
    code_byte(2 + high, clamp(step + last[2 + high]));
    step = (step + color[2 + high] - last[2 + high]) / 2;
    code_byte(4 + high, clamp(step + last[4 + high]));
  }
}

/// A wave packet: index, place in the waveforms, size, and four floats, 29 bytes.
class WavePacketModels {
 public:
  WavePacketModels() : index_(256), place_(4, 4), steps_(32), size_(32), point_(32), xyz_(32, 3) {}

  template <typename Coder>
  void code(Coder& coder, const unsigned char* last, unsigned char* packet);

 private:
  SymbolModel index_;
  SymbolModels place_;
  IntegerModel steps_, size_, point_, xyz_;
  std::int32_t last_step_ = 0;
  unsigned last_kind_ = 0;
};

template <typename Coder>
void WavePacketModels::code(Coder& coder, const unsigned char* last, unsigned char* packet) {
  enum Kind : unsigned { kSame, kBehind, kStep, kAnywhere };
  packet[0] = static_cast<unsigned char>(coder.symbol(index_, packet[0]));
  const std::uint64_t last_place = get<std::uint64_t>(last + 1);
  const std::int32_t last_size = get<std::int32_t>(last + 9);
  std::uint64_t place = 0;
  std::int64_t step = 0;
  unsigned kind = 0;
  if constexpr (Coder::kEncoding) {
    place = get<std::uint64_t>(packet + 1);
    step = static_cast<std::int64_t>(place - last_place);
    kind = step != static_cast<std::int32_t>(step) ? kAnywhere
           : step == 0                             ? kSame
           : step == last_size && step > 0         ? kBehind
                                                   : kStep;
  }
  last_kind_ = kind = coder.symbol(place_[last_kind_], kind);
  if (kind == kSame) {
    place = last_place;
  } else if (kind == kBehind) {
    place = last_place + static_cast<std::uint32_t>(last_size);
  } else if (kind == kStep) {
    last_step_ = steps_.code(coder, last_step_, 0, static_cast<std::int32_t>(step));
    place = last_place + static_cast<std::uint64_t>(std::int64_t{last_step_});
  } else {
    place = coder.bits64(place);
  }
  if constexpr (!Coder::kEncoding) put(packet + 1, place);
  const auto code_number = [&](IntegerModel& model, std::size_t at, unsigned context) {
    const std::int32_t value = model.code(coder, get<std::int32_t>(last + at), context,
                                          Coder::kEncoding ? get<std::int32_t>(packet + at) : 0);
    if constexpr (!Coder::kEncoding) put(packet + at, value);
  };
  code_number(size_, 9, 0);
  code_number(point_, 13, 0);
  for (unsigned axis = 0; axis < 3; ++axis) code_number(xyz_, 17 + 4 * axis, axis);
}

}  // namespace camber::laz
