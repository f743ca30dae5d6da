#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace camber::test {

__extension__ typedef unsigned __int128 Wide;

/// SHA-256 (FIPS 180-4), in hexadecimal.
inline std::string sha256(std::string_view bytes) {
  // The fractional parts of the cube and square roots of the first primes, by their definition.
  static const auto roots = [] {
    std::array<std::uint32_t, 72> out{};
    const auto root_bits = [](unsigned prime, int power) {
      // floor(2^32 * frac(prime^(1/power))) by bisection in integers.
      std::uint64_t low = 0, high = std::uint64_t{1} << 37;
      while (high - low > 1) {
        const std::uint64_t middle = (low + high) / 2;
        Wide value = 1;
        // middle^power <= prime * 2^(32 power), in long double where it does not fit.
        bool fits = true;
        if (power == 2) {
          value = static_cast<Wide>(middle) * middle;
          fits = value <= static_cast<Wide>(prime) << 64;
        } else {
          value = static_cast<Wide>(middle) * middle * middle;
          fits = value <= static_cast<Wide>(prime) << 96;
        }
        (fits ? low : high) = middle;
      }
      return static_cast<std::uint32_t>(low);
    };
    std::size_t count = 0;
    for (unsigned n = 2; count < 64; ++n) {
      bool prime = true;
      for (unsigned d = 2; d * d <= n; ++d) prime = prime && n % d != 0;
      if (!prime) continue;
      out[count] = root_bits(n, 3);
      if (count < 8) out[64 + count] = root_bits(n, 2);
      ++count;
    }
    return out;
  }();
  std::vector<std::uint8_t> data(bytes.begin(), bytes.end());
  data.push_back(0x80);
  while (data.size() % 64 != 56) data.push_back(0);
  for (int k = 7; k >= 0; --k) {
    data.push_back(
        static_cast<std::uint8_t>((8 * static_cast<std::uint64_t>(bytes.size())) >> (8 * k)));
  }
  std::array<std::uint32_t, 8> h{};
  for (std::size_t k = 0; k < 8; ++k) h[k] = roots[64 + k];
  const auto turn = [](std::uint32_t x, int n) { return x >> n | x << (32 - n); };
  for (std::size_t block = 0; block < data.size(); block += 64) {
    std::array<std::uint32_t, 64> w{};
    for (std::size_t i = 0; i < 16; ++i) {
      for (std::size_t k = 0; k < 4; ++k) w[i] = w[i] << 8 | data[block + 4 * i + k];
    }
    for (std::size_t i = 16; i < 64; ++i) {
      const std::uint32_t a = w[i - 15], b = w[i - 2];
      w[i] = w[i - 16] + (turn(a, 7) ^ turn(a, 18) ^ a >> 3) + w[i - 7] +
             (turn(b, 17) ^ turn(b, 19) ^ b >> 10);
    }
    std::array<std::uint32_t, 8> v = h;
    for (std::size_t i = 0; i < 64; ++i) {
      const std::uint32_t s1 = turn(v[4], 6) ^ turn(v[4], 11) ^ turn(v[4], 25);
      const std::uint32_t t1 = v[7] + s1 + ((v[4] & v[5]) ^ (~v[4] & v[6])) + roots[i] + w[i];
      const std::uint32_t s0 = turn(v[0], 2) ^ turn(v[0], 13) ^ turn(v[0], 22);
      const std::uint32_t t2 = s0 + ((v[0] & v[1]) ^ (v[0] & v[2]) ^ (v[1] & v[2]));
      for (std::size_t k = 7; k > 0; --k) v[k] = v[k - 1];
      v[4] += t1;
      v[0] = t1 + t2;
    }
    for (std::size_t k = 0; k < 8; ++k) h[k] += v[k];
  }
  std::string out;
  for (const std::uint32_t word : h) {
    for (int k = 7; k >= 0; --k) out += "0123456789abcdef"[word >> (4 * k) & 15];
  }
  return out;
}

}  // namespace camber::test
