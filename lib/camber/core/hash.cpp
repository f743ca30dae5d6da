#include "camber/core/hash.h"

#include <xxhash.h>

#include <array>
#include <fstream>
#include <memory>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"

namespace camber {
namespace {

std::string hexadecimal(const XXH128_hash_t& hash) {
  XXH128_canonical_t digest;
  XXH128_canonicalFromHash(&digest, hash);
  static const char* const kDigits = "0123456789abcdef";
  std::string text;
  for (const unsigned char byte : digest.digest) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

}  // namespace

std::string hash_bytes(std::string_view bytes) {
  return hexadecimal(XXH3_128bits(bytes.data(), bytes.size()));
}

std::string hash_file(const std::filesystem::path& path) {
  std::ifstream in = open_file(path);
  const std::unique_ptr<XXH3_state_t, XXH_errorcode (*)(XXH3_state_t*)> state(XXH3_createState(),
                                                                              XXH3_freeState);
  XXH3_128bits_reset(state.get());
  std::array<char, 1 << 16> buffer;
  while (in.read(buffer.data(), buffer.size()), in.gcount() > 0) {
    XXH3_128bits_update(state.get(), buffer.data(), static_cast<std::size_t>(in.gcount()));
  }
  if (in.bad()) throw InputError(path.string(), "reading failed");
  return hexadecimal(XXH3_128bits_digest(state.get()));
}

}  // namespace camber
