// replay_NAME FOLDER... [--places N]
// Runs a fuzzer's function without libFuzzer: over each seed file as it is, cut at every length (at
// most N of them, by default 400), and with single bits flipped. A crash, a sanitizer's report or
// an exception that the function lets through ends the program with an error.

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "fuzz/mutators/mutator.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace fs = std::filesystem;

namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t kLongest = 1 << 16;  // bytes of a mutated seed
std::size_t g_places = 400;                // that are visited of a seed, about

/// Steps through `count` places so that about g_places of them are visited, a quarter from the
/// first on.
std::size_t next_place(std::size_t place, std::size_t count) {
  return place < g_places / 4 ? place + 1
                              : place + std::max<std::size_t>(1, 4 * count / (3 * g_places));
}

long replay(const Bytes& seed) {
  long runs = 0;
  const auto run = [&](const std::uint8_t* data, std::size_t size) {
    // A copy of its own size, so that the address sanitizer sees a read beyond the end.
    const Bytes copy(data, data + size);
    LLVMFuzzerTestOneInput(copy.data(), copy.size());
    ++runs;
  };
  run(seed.data(), seed.size());
  for (std::size_t n = 0; n < seed.size(); n = next_place(n, seed.size())) run(seed.data(), n);
  Bytes changed = seed;
  for (std::size_t i = 0; i < seed.size(); i = next_place(i, seed.size())) {
    for (int bit = 0; bit < 8; ++bit) {
      changed[i] = static_cast<std::uint8_t>(seed[i] ^ (1U << bit));
      run(changed.data(), changed.size());
    }
    changed[i] = seed[i];
  }
  namespace fuzz = camber::fuzz;
  const std::string text(seed.begin(), seed.end());
  for (std::size_t i = 0; i < g_places; ++i) {
    fuzz::Dice dice(i);
    const fuzz::ByteMutation bytes = [&](std::string_view input, std::size_t most) {
      return fuzz::some_bytes(input, most, dice);
    };
    const std::string made = fuzz::mutate(text, kLongest, i, fuzz::CAMBER_MUTATOR, bytes);
    run(reinterpret_cast<const std::uint8_t*>(made.data()), made.size());
  }
  return runs;
}

}  // namespace

int main(int argc, char** argv) {
  std::vector<fs::path> files;
  for (int i = 1; i < argc; ++i) {
    if (std::strcmp(argv[i], "--places") == 0 && i + 1 < argc) {
      g_places = std::strtoul(argv[++i], nullptr, 10);
      continue;
    }
    for (const auto& entry : fs::directory_iterator(argv[i])) {
      if (entry.is_regular_file()) files.push_back(entry.path());
    }
  }
  std::sort(files.begin(), files.end());
  if (files.empty()) {
    std::fprintf(stderr, "no seed files\n");
    return 1;
  }
  long runs = 0;
  for (const fs::path& file : files) {
    std::ifstream in(file, std::ios::binary);
    const Bytes seed{std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
    try {
      runs += replay(seed);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s: an exception came through: %s\n", file.c_str(), error.what());
      return 1;
    }
  }
  std::printf("%ld inputs from %zu seeds\n", runs, files.size());
  return 0;
}
