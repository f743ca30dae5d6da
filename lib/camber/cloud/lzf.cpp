#include "camber/cloud/lzf.h"

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

namespace camber {

const char* lzf_decompress(const unsigned char* input, std::size_t input_size,
                           unsigned char* output, std::size_t output_size) {
  std::size_t in = 0, out = 0;
  while (in < input_size) {
    const unsigned control = input[in++];
    if (control < 32) {
      const std::size_t length = control + 1;
      if (length > input_size - in) return "a run of plain bytes reaches beyond the data";
      if (length > output_size - out) return "more data than the header says";
      std::memcpy(output + out, input + in, length);
      in += length;
      out += length;
    } else {
      std::size_t length = control >> 5;
      if (length == 7) {
        if (in == input_size) return "the data end inside a copy";
        length += input[in++];
      }
      length += 2;
      if (in == input_size) return "the data end inside a copy";
      const std::size_t back = ((control & 31u) << 8 | input[in++]) + 1;
      if (back > out) return "a copy from before the start of the data";
      if (length > output_size - out) return "more data than the header says";
      if (back >= length) {
        std::memcpy(output + out, output + out - back, length);
      } else {
        for (std::size_t i = 0; i < length; ++i) output[out + i] = output[out + i - back];
      }
      out += length;
    }
  }
  return out == output_size ? nullptr : "less data than the header says";
}

std::string lzf_compress(const unsigned char* input, std::size_t size) {
  constexpr std::size_t kWindow = 8192, kLongest = 264, kLiterals = 32;
  std::vector<std::size_t> last(std::size_t{1} << 14, SIZE_MAX);  // where a hash was seen last
  std::string out;
  out.reserve(size + size / 32 + 16);
  std::size_t literal_start = 0, i = 0;
  const auto flush = [&](std::size_t until) {
    while (literal_start < until) {
      const std::size_t length = std::min(kLiterals, until - literal_start);
      out += static_cast<char>(length - 1);
      out.append(reinterpret_cast<const char*>(input) + literal_start, length);
      literal_start += length;
    }
  };
  while (i + 3 <= size) {
    const std::uint32_t key = static_cast<std::uint32_t>(input[i]) << 16 |
                              static_cast<std::uint32_t>(input[i + 1]) << 8 | input[i + 2];
    std::size_t& slot = last[(key * 2654435761u) >> 18];
    const std::size_t candidate = slot;
    slot = i;
    if (candidate == SIZE_MAX || i - candidate > kWindow ||
        std::memcmp(input + candidate, input + i, 3) != 0) {
      ++i;
      continue;
    }
    std::size_t length = 3;
    while (length < kLongest && i + length < size &&
           input[candidate + length] == input[i + length]) {
      ++length;
    }
    flush(i);
    const std::size_t back = i - candidate - 1, code = length - 2;
    if (code < 7) {
      out += static_cast<char>(code << 5 | back >> 8);
    } else {
      out += static_cast<char>(7u << 5 | back >> 8);
      out += static_cast<char>(code - 7);
    }
    out += static_cast<char>(back & 255);
    i += length;
    literal_start = i;
  }
  flush(size);
  return out;
}

}  // namespace camber
