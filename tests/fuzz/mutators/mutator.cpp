#include "fuzz/mutators/mutator.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace camber::fuzz {

std::string mutate(std::string_view input, std::size_t max_size, std::uint64_t seed,
                   Mutator mutator, const ByteMutation& bytes) {
  Dice dice(seed);
  std::string out(input);
  for (std::size_t left = 1 + dice.below(4); left > 0; --left) {
    out = dice.one_in(5) || out.empty() ? bytes(out, max_size) : mutator(out, dice, bytes);
    if (out.size() > max_size) out.resize(max_size);
  }
  return out;
}

std::string some_bytes(std::string_view input, std::size_t max_size, Dice& dice) {
  std::string out(input);
  for (std::size_t left = 1 + dice.below(4); left > 0; --left) {
    const std::size_t at = dice.below(out.size() + 1);
    switch (dice.below(4)) {
      case 0:
        if (at < out.size()) out[at] = static_cast<char>(out[at] ^ (1 << dice.below(8)));
        break;
      case 1:
        if (at < out.size()) out[at] = static_cast<char>(dice.bits());
        break;
      case 2:
        out.insert(at, 1 + dice.below(4), static_cast<char>(dice.bits()));
        break;
      default:
        out.erase(at, 1 + dice.below(8));
    }
  }
  if (out.size() > max_size) out.resize(max_size);
  return out;
}

std::uint64_t odd_integer(std::uint64_t old, int width, Dice& dice) {
  const int bits = 8 * width;
  const std::uint64_t all = bits == 64 ? ~0ull : (1ull << bits) - 1;
  const std::uint64_t top = 1ull << (bits - 1);
  switch (dice.below(10)) {
    case 0:
      return 0;
    case 1:
      return all - dice.below(3);
    case 2:
      return (top - 1 + dice.below(3)) & all;
    case 3:
      return (old + 1) & all;
    case 4:
      return (old - 1) & all;
    case 5:
      return (old * 2) & all;
    case 6:
      return old ^ (1ull << dice.below(static_cast<std::size_t>(bits)));
    case 7:
      return dice.below(17);
    case 8:
      return (1ull << dice.below(static_cast<std::size_t>(bits))) & all;
    default:
      return dice.bits() & all;
  }
}

double odd_double(double old, Dice& dice) {
  using Limits = std::numeric_limits<double>;
  switch (dice.below(12)) {
    case 0:
      return 0.0;
    case 1:
      return -old;
    case 2:
      return Limits::quiet_NaN();
    case 3:
      return Limits::infinity();
    case 4:
      return -Limits::infinity();
    case 5:
      return Limits::max();
    case 6:
      return Limits::denorm_min();
    case 7:
      return old * 1e6;
    case 8:
      return old * 1e-6;
    case 9:
      return old + 1.0;
    case 10:
      return std::ldexp(1.0, static_cast<int>(dice.below(70)));
    default:
      return static_cast<double>(static_cast<std::int64_t>(dice.bits())) * 0x1.0p-40;
  }
}

std::string odd_number_text(Dice& dice) {
  static const std::array<const char*, 34> kNumbers{"0",
                                                    "-0",
                                                    "1",
                                                    "-1",
                                                    "2",
                                                    "3",
                                                    "7",
                                                    "255",
                                                    "256",
                                                    "65535",
                                                    "65536",
                                                    "100000",
                                                    "1e9",
                                                    "2147483647",
                                                    "2147483648",
                                                    "-2147483648",
                                                    "4294967295",
                                                    "4294967296",
                                                    "9007199254740993",
                                                    "9223372036854775807",
                                                    "9223372036854775808",
                                                    "18446744073709551616",
                                                    "1e308",
                                                    "1e-308",
                                                    "1e400",
                                                    "-1e400",
                                                    "nan",
                                                    "inf",
                                                    "-inf",
                                                    "0x10",
                                                    "1,5",
                                                    ".5",
                                                    "+3",
                                                    "1e"};
  if (dice.one_in(3)) {
    return std::to_string(static_cast<double>(static_cast<std::int64_t>(dice.bits())) * 0x1.0p-50);
  }
  return dice.of(kNumbers);
}

std::uint64_t get_number(std::string_view bytes, std::size_t at, int width) {
  std::uint64_t value = 0;
  std::memcpy(&value, bytes.data() + at, static_cast<std::size_t>(width));
  return value;
}

void set_number(std::string* bytes, std::size_t at, int width, std::uint64_t value) {
  std::memcpy(bytes->data() + at, &value, static_cast<std::size_t>(width));
}

}  // namespace camber::fuzz
