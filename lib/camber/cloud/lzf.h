#pragma once

#include <cstddef>
#include <string>

namespace camber {

// The LZF format of PCD's binary_compressed, by Marc Lehmann's LibLZF.

/// No input of n bytes expands to more than this: a copy of 264 bytes takes three.
constexpr unsigned long long lzf_largest_output(unsigned long long n) { return n * 88 + 264; }

/// Decompresses into exactly `output_size` bytes.
/// @return nullptr, or what is wrong with the input.
const char* lzf_decompress(const unsigned char* input, std::size_t input_size,
                           unsigned char* output, std::size_t output_size);

/// @throws std::invalid_argument for 4 GiB and more, which the format's users cannot name.
std::string lzf_compress(const unsigned char* input, std::size_t size);

}  // namespace camber
