#include "camber/cloud/lzf.h"

#include <liblzf/lzf.h>

#include <cerrno>
#include <limits>
#include <stdexcept>

namespace camber {
namespace {

constexpr std::size_t kMost = std::numeric_limits<unsigned int>::max();

}  // namespace

const char* lzf_decompress(const unsigned char* input, std::size_t input_size,
                           unsigned char* output, std::size_t output_size) {
  if (input_size > kMost || output_size > kMost) return "more than 4 GiB of data";
  if (input_size == 0) return output_size == 0 ? nullptr : "less data than the header states";
  errno = 0;
  const std::size_t found = ::lzf_decompress(input, static_cast<unsigned int>(input_size), output,
                                             static_cast<unsigned int>(output_size));
  if (found == output_size && found > 0) return nullptr;
  if (found > 0) return "less data than the header states";
  return errno == E2BIG ? "more data than the header states" : "the data are damaged";
}

std::string lzf_compress(const unsigned char* input, std::size_t size) {
  if (size >= kMost - kMost / 16 - 64) {
    throw std::invalid_argument("LZF: found " + std::to_string(size) +
                                " bytes to compress, expected less than 4 GiB");
  }
  std::string out;
  if (size == 0) return out;
  // At worst a byte for every 32 plain ones, and room for what the library writes ahead.
  out.resize(size + size / 16 + 64);
  out.resize(::lzf_compress(input, static_cast<unsigned int>(size), out.data(),
                            static_cast<unsigned int>(out.size())));
  return out;
}

}  // namespace camber
