// libFuzzer's hook: the target's own mutator (CAMBER_MUTATOR, a name in mutators/mutator.h), with
// libFuzzer's mutation for bytes.

#include <algorithm>
#include <cstdint>
#include <cstring>

#include "fuzz/mutators/mutator.h"

extern "C" std::size_t LLVMFuzzerMutate(std::uint8_t* data, std::size_t size, std::size_t max_size);

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t max_size, unsigned int seed) {
  namespace fuzz = camber::fuzz;
  const fuzz::ByteMutation bytes = [](std::string_view input, std::size_t most) {
    std::string out(input.substr(0, most));
    const std::size_t before = out.size();
    out.resize(std::max<std::size_t>(most, 1));
    out.resize(LLVMFuzzerMutate(reinterpret_cast<std::uint8_t*>(out.data()), before, out.size()));
    return out;
  };
  const std::string_view input(reinterpret_cast<const char*>(data), size);
  const std::string out = fuzz::mutate(input, max_size, seed, fuzz::CAMBER_MUTATOR, bytes);
  std::memcpy(data, out.data(), out.size());
  return out.size();
}
