#include <algorithm>
#include <cstring>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

/// A floating-point number at any place, of 4 or 8 bytes.
void put_real(std::string* bytes, Dice& dice) {
  const std::size_t width = dice.one_in(2) ? 4 : 8;
  if (bytes->size() < width) return;
  const std::size_t at = dice.below(bytes->size() - width + 1);
  if (width == 4) {
    float old = 0.0f;
    std::memcpy(&old, bytes->data() + at, width);
    const auto now = static_cast<float>(odd_double(static_cast<double>(old), dice));
    std::memcpy(bytes->data() + at, &now, width);
  } else {
    double old = 0.0;
    std::memcpy(&old, bytes->data() + at, width);
    const double now = odd_double(old, dice);
    std::memcpy(bytes->data() + at, &now, width);
  }
}

/// What looks like a length of 4 or 8 bytes before as many bytes: both change together.
bool change_counted(std::string* bytes, Dice& dice, const ByteMutation& mutation) {
  for (int tries = 0; tries < 16; ++tries) {
    const int width = dice.one_in(4) ? 8 : 4;
    const auto w = static_cast<std::size_t>(width);
    if (bytes->size() < w) return false;
    const std::size_t at = dice.below(bytes->size() - w + 1);
    const std::uint64_t length = get_number(*bytes, at, width);
    if (length == 0 || length > bytes->size() - at - w) continue;
    const std::size_t from = at + w, size = static_cast<std::size_t>(length);
    const std::string now = mutation(std::string_view(*bytes).substr(from, size), size + 16);
    bytes->replace(from, size, now);
    set_number(bytes, at, width, now.size());
    return true;
  }
  return false;
}

}  // namespace

std::string mutate_numbers(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  std::string out(input);
  switch (dice.below(6)) {
    case 0:
      put_real(&out, dice);
      break;
    case 1:
      if (change_counted(&out, dice, bytes)) break;
      [[fallthrough]];
    case 2:
    case 3: {
      const int width = 1 << dice.below(4);
      const auto w = static_cast<std::size_t>(width);
      if (out.size() < w) return bytes(input, input.size() + 16);
      const std::size_t at = dice.below(out.size() - w + 1);
      set_number(&out, at, width, odd_integer(get_number(out, at, width), width, dice));
      break;
    }
    case 4: {
      const std::size_t at = dice.below(out.size() + 1), size = 4 * (1 + dice.below(8));
      out.insert(at, out.substr(std::min(at, out.size() - std::min(out.size(), size)), size));
      break;
    }
    default:
      out.erase(dice.below(out.size() + 1), 4 * (1 + dice.below(8)));
  }
  return out;
}

}  // namespace camber::fuzz
