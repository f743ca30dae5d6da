#include <algorithm>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

// Places in LAS's header, LASzip's record and the data of its points.
constexpr std::size_t kPointsAt = 96, kPointSizeAt = 105, kLeastHeader = 227, kRecordHeader = 54,
                      kOffsetSize = 8;
constexpr std::string_view kUser = "laszip encoded";

/// A number of LASzip's record: compressor, chunk size, or of an item its type, size or version.
void change_record(std::string* laz, Dice& dice) {
  const std::size_t user = laz->find(kUser);
  if (user == std::string::npos || user < 2) return;
  const std::size_t content = user - 2 + kRecordHeader;
  struct Field {
    std::size_t at;
    int width;
  };
  static const std::array<Field, 8> kFields{
      {{0, 2}, {2, 2}, {12, 4}, {32, 2}, {34, 2}, {36, 2}, {38, 2}, {40, 2}}};
  const Field field = dice.of(kFields);
  const std::size_t at = content + field.at;
  if (at + static_cast<std::size_t>(field.width) > laz->size()) return;
  set_number(laz, at, field.width,
             odd_integer(get_number(*laz, at, field.width), field.width, dice));
}

/// A number near a chunk's head or in the table: sizes of layers, numbers of points and chunks.
void change_number(std::string* laz, std::size_t from, Dice& dice) {
  if (laz->size() < from + 4) return;
  const std::size_t at = from + dice.below(laz->size() - from - 3);
  const std::uint64_t old = get_number(*laz, at, 4);
  set_number(laz, at, 4, dice.one_in(2) ? old + dice.below(5) - 2 : odd_integer(old, 4, dice));
}

}  // namespace

std::string mutate_laz(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  if (input.size() < kLeastHeader || input.substr(0, 4) != "LASF") {
    return bytes(input, input.size() + 16);
  }
  std::string out(input);
  const std::size_t start = get_number(out, kPointsAt, 4);
  if (start + kOffsetSize > out.size()) return mutate_las(input, dice, bytes);
  switch (dice.below(5)) {
    case 0:
      change_record(&out, dice);
      break;
    case 1: {  // a chunk's head begins behind its first record
      const std::size_t head = start + kOffsetSize + get_number(out, kPointSizeAt, 2);
      change_number(&out, dice.one_in(2) ? std::min(head, out.size()) : start, dice);
      break;
    }
    case 2: {  // bytes of the points, as many as before
      const std::size_t from = start + dice.below(out.size() - start);
      const std::size_t size = std::min<std::size_t>(1 + dice.below(16), out.size() - from);
      std::string part = bytes(std::string_view(out).substr(from, size), size);
      part.resize(size);
      out.replace(from, size, part);
      break;
    }
    default: {  // header and records; the place of the table goes along
      const std::uint64_t table = get_number(out, start, kOffsetSize);
      out = mutate_las(input, dice, bytes);
      if (out.size() < kLeastHeader) break;
      const std::size_t now = get_number(out, kPointsAt, 4);
      if (now + kOffsetSize <= out.size() && get_number(out, now, kOffsetSize) == table) {
        set_number(&out, now, kOffsetSize, table + now - start);
      }
    }
  }
  return out;
}

}  // namespace camber::fuzz
