#include "camber/core/random.h"

#include <cmath>

namespace camber {

double CounterRandom::normal(std::uint64_t index) const {
  constexpr std::uint64_t kNormalStream = 0xA0761D6478BD642Full;
  CounterRandom own = *this;
  own.key_ = mix(key_ ^ kNormalStream);
  constexpr double kTwoPi = 6.283185307179586;
  const double u = 1.0 - own.uniform(2 * index);  // (0, 1]
  const double v = own.uniform(2 * index + 1);
  return std::sqrt(-2.0 * std::log(u)) * std::cos(kTwoPi * v);
}

}  // namespace camber
