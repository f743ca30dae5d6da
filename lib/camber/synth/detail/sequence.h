#pragma once

#include <cstdint>

#include "camber/core/random.h"

namespace camber {

/// Random numbers in the order in which they are asked for.
class Sequence {
 public:
  Sequence(std::uint64_t seed, std::uint64_t stream) : random_(seed, stream) {}
  double uniform(double low, double high) { return random_.uniform(next_++, low, high); }
  bool chance(double probability) { return random_.uniform(next_++) < probability; }
  int below(int count) {
    return static_cast<int>(random_.below(next_++, static_cast<std::uint64_t>(count)));
  }
  std::uint32_t bits() { return static_cast<std::uint32_t>(random_.bits(next_++) >> 32); }
  double normal() { return random_.normal(next_++); }
  double sign() { return chance(0.5) ? 1.0 : -1.0; }

 private:
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

}  // namespace camber
