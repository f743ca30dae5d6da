#pragma once

#include <cstdint>

namespace camber {

/// Counter-based random numbers: the value depends on (seed, stream, index) alone, so that any
/// number of threads draws the same numbers in any order. The mixer is SplitMix64's finaliser
/// (Steele, Lea, Flood, "Fast Splittable Pseudorandom Number Generators", OOPSLA 2014), applied
/// twice. Portable: no standard-library distribution is involved.
class CounterRandom {
 public:
  explicit CounterRandom(std::uint64_t seed, std::uint64_t stream = 0)
      : key_(mix(mix(seed + 0x9E3779B97F4A7C15ull) ^ (stream * 0xD1B54A32D192ED03ull))) {}

  /// 64 random bits for `index`.
  std::uint64_t bits(std::uint64_t index) const {
    return mix(mix(key_ + index * 0x9E3779B97F4A7C15ull) ^ key_);
  }

  /// Uniform in [0, 1).
  double uniform(std::uint64_t index) const {
    return static_cast<double>(bits(index) >> 11) * 0x1.0p-53;
  }

  /// Uniform in [low, high).
  double uniform(std::uint64_t index, double low, double high) const {
    return low + (high - low) * uniform(index);
  }

  /// Uniform integer in [0, count), count > 0 (multiply-shift; bias below count / 2^64).
  std::uint64_t below(std::uint64_t index, std::uint64_t count) const {
    __extension__ using Wide = unsigned __int128;
    return static_cast<std::uint64_t>((static_cast<Wide>(bits(index)) * count) >> 64);
  }

  /// Standard normal (Box and Muller); consumes the counters 2 * index and 2 * index + 1 of a
  /// stream of its own, so it never repeats a number of uniform().
  double normal(std::uint64_t index) const;

 private:
  static std::uint64_t mix(std::uint64_t z) {
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9ull;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBull;
    return z ^ (z >> 31);
  }
  std::uint64_t key_;
};

}  // namespace camber
