#pragma once

#include <cstddef>
#include <string>

namespace camber {

/// The LZF format of PCD's binary_compressed (Marc Lehmann's LibLZF): a byte below 32 is followed
/// by that many plus one literal bytes; else its upper three bits (7: plus a following byte) plus 2
/// are the length of a copy from up to 8192 bytes back.

/// No input of n bytes expands to more than this.
constexpr unsigned long long lzf_largest_output(unsigned long long n) { return n * 88 + 264; }

/// Decompresses into exactly `output_size` bytes.
/// @return nullptr, or what is wrong with the input.
const char* lzf_decompress(const unsigned char* input, std::size_t input_size,
                           unsigned char* output, std::size_t output_size);

std::string lzf_compress(const unsigned char* input, std::size_t size);

}  // namespace camber
