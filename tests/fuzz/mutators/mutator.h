#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>

#include "camber/core/random.h"

/// Mutations that keep an input's structure whole, so that a reader gets beyond its first check:
/// lengths, counts, offsets and check sums fit again after a change (most of the time), a JSON
/// document stays one.
namespace camber::fuzz {

/// Random choices of one mutation; the same seed, the same choices.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : random_(seed) {}
  /// Uniform in [0, count), count > 0.
  std::size_t below(std::size_t count) {
    return static_cast<std::size_t>(random_.below(next_++, count));
  }
  bool one_in(std::size_t count) { return below(count) == 0; }
  std::uint64_t bits() { return random_.bits(next_++); }
  template <typename Container>
  auto& of(Container& container) {
    return container[below(std::size(container))];
  }

 private:
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

/// Changes bytes without regard to structure, to a length of at most `max_size`: libFuzzer's own
/// mutation (its dictionary included), or some_bytes().
using ByteMutation = std::function<std::string(std::string_view bytes, std::size_t max_size)>;

/// One mutation of `input`; the result may be longer than wanted, the caller cuts it. What is not
/// of the mutator's format comes back as bytes changed by `bytes`.
using Mutator = std::string (*)(std::string_view input, Dice& dice, const ByteMutation& bytes);

std::string mutate_json(std::string_view input, Dice& dice, const ByteMutation& bytes);
/// Lines and words: tables, YAML, XML, TOML; also a header of lines before a binary body (PCD, PLY,
/// OpenCRG).
std::string mutate_text(std::string_view input, Dice& dice, const ByteMutation& bytes);
/// JSON where the input is JSON, else text.
std::string mutate_document(std::string_view input, Dice& dice, const ByteMutation& bytes);
/// E57 by its XML as text and its sections, with checksums that fit.
std::string mutate_e57(std::string_view input, Dice& dice, const ByteMutation& bytes);
std::string mutate_las(std::string_view input, Dice& dice, const ByteMutation& bytes);
/// LAS's header and records, LASzip's record, chunks and their table.
std::string mutate_laz(std::string_view input, Dice& dice, const ByteMutation& bytes);
/// COPC's record and the pages of its index; else as LAZ.
std::string mutate_copc(std::string_view input, Dice& dice, const ByteMutation& bytes);
/// PNG by chunks with their check sums and compressed rows, JPEG by segments.
std::string mutate_image(std::string_view input, Dice& dice, const ByteMutation& bytes);
std::string mutate_bag(std::string_view input, Dice& dice, const ByteMutation& bytes);
/// Little-endian numbers of 1 to 8 bytes, lengths before what they count.
std::string mutate_numbers(std::string_view input, Dice& dice, const ByteMutation& bytes);
/// As text where the input has no control characters, else as numbers.
std::string mutate_text_or_numbers(std::string_view input, Dice& dice, const ByteMutation& bytes);

/// One to four mutations, one in five of them of bytes alone, cut at `max_size`.
std::string mutate(std::string_view input, std::size_t max_size, std::uint64_t seed,
                   Mutator mutator, const ByteMutation& bytes);

/// A mutation of bytes for programs without libFuzzer: flips, insertions, removals.
std::string some_bytes(std::string_view input, std::size_t max_size, Dice& dice);

/// A number at the border of what a field of `width` bytes (1, 2, 4, 8) can hold, or near `old`.
std::uint64_t odd_integer(std::uint64_t old, int width, Dice& dice);
double odd_double(double old, Dice& dice);
/// A number as text.
std::string odd_number_text(Dice& dice);

/// Little-endian; [at, at + width) lies within `bytes`.
std::uint64_t get_number(std::string_view bytes, std::size_t at, int width);
void set_number(std::string* bytes, std::size_t at, int width, std::uint64_t value);

}  // namespace camber::fuzz
