#include <algorithm>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

// COPC 1.0: its record is the first one, directly behind LAS's header of 375 bytes.
constexpr std::size_t kInfo = 375 + 54, kInfoSize = 160, kRootAt = 40, kRootSizeAt = 48,
                      kEntry = 32, kStartAt = 16, kPointsAt = 28;

struct Field {
  std::size_t at;
  int width;
};

void change_number(std::string* copc, std::size_t at, int width, Dice& dice) {
  const std::uint64_t old = get_number(*copc, at, width);
  set_number(copc, at, width,
             dice.one_in(2) ? old + dice.below(5) - 2 : odd_integer(old, width, dice));
}

/// A length of the cube or the spacing, or the root page.
void change_info(std::string* copc, Dice& dice) {
  const std::size_t at = kInfo + 8 * dice.below(kRootSizeAt / 8 + 1);
  if (dice.one_in(2)) {
    change_number(copc, at, 8, dice);
  } else {  // of a double: sign, exponent and the first digits
    change_number(copc, at + 6, 2, dice);
  }
}

}  // namespace

std::string mutate_copc(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  std::string out(input);
  if (out.size() < kInfo + kInfoSize || out.compare(kInfo - 52, 4, "copc") != 0) {
    return mutate_laz(input, dice, bytes);
  }
  const std::uint64_t root = get_number(out, kInfo + kRootAt, 8);
  const std::size_t from = std::min<std::uint64_t>(root, out.size());
  const std::size_t entries = (out.size() - from) / kEntry;
  const std::size_t way = dice.below(6);
  if (way == 0) return mutate_laz(input, dice, bytes);
  if (way == 1 || entries == 0) {
    change_info(&out, dice);
    return out;
  }
  const std::size_t at = from + kEntry * dice.below(entries);
  const std::string entry = out.substr(at, kEntry);
  switch (way) {
    case 2: {  // an entry in another's place
      const std::size_t other = from + kEntry * dice.below(entries);
      if (dice.one_in(2)) out.replace(at, kEntry, out, other, kEntry);
      out.replace(other, kEntry, entry);
      break;
    }
    case 3: {  // an entry goes to a page of its own, behind all others
      const std::size_t page = out.size();
      out += entry;
      set_number(&out, at + kStartAt, 8, page);
      set_number(&out, at + kStartAt + 8, 4, kEntry * (1 + dice.below(2)));
      set_number(&out, at + kPointsAt, 4, UINT32_MAX);
      break;
    }
    case 4:  // the root page has another number of entries
      set_number(&out, kInfo + kRootSizeAt, 8, kEntry * dice.below(entries + 2));
      break;
    default: {
      static const std::array<Field, 7> kFields{
          {{0, 4}, {4, 4}, {8, 4}, {12, 4}, {kStartAt, 8}, {24, 4}, {kPointsAt, 4}}};
      const Field field = dice.of(kFields);
      change_number(&out, at + field.at, field.width, dice);
    }
  }
  return out;
}

}  // namespace camber::fuzz
