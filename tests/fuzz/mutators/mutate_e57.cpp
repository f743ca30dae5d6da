#include <algorithm>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

// ASTM E2807: places in the header, and of pages with a checksum (CRC-32C) at their end.
constexpr std::size_t kHeader = 48, kLengthAt = 16, kXmlAt = 24, kXmlLengthAt = 32, kPageAt = 40,
                      kChecksum = 4;

std::uint32_t checksum(std::string_view bytes) {
  std::uint32_t crc = 0xffffffffu;
  for (const char c : bytes) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0x82F63B78u : 0u);
  }
  return ~crc;
}

/// Without checksums, and the place of the XML in that.
struct Logical {
  std::string bytes;
  std::size_t page = 0, xml = 0, xml_length = 0;
};

bool take_apart(std::string_view input, Logical* out) {
  if (input.size() < kHeader || input.substr(0, 8) != "ASTM-E57") return false;
  const std::uint64_t page = get_number(input, kPageAt, 8);
  if (page < 64 || page > 1 << 20 || input.size() % page != 0) return false;
  out->page = page;
  const std::size_t payload = out->page - kChecksum;
  for (std::size_t at = 0; at < input.size(); at += out->page) {
    out->bytes += input.substr(at, payload);
  }
  const std::uint64_t xml = get_number(input, kXmlAt, 8);
  if (xml >= input.size()) return false;
  out->xml = xml / page * payload + xml % page;
  const std::uint64_t length = get_number(input, kXmlLengthAt, 8);
  if (out->xml > out->bytes.size() || length > out->bytes.size() - out->xml) return false;
  out->xml_length = length;
  return true;
}

std::string put_together(std::string logical, std::size_t page) {
  const std::size_t payload = page - kChecksum;
  logical.resize((logical.size() + payload - 1) / payload * payload, '\0');
  std::string out;
  for (std::size_t at = 0; at < logical.size(); at += payload) {
    const std::string_view bytes = std::string_view(logical).substr(at, payload);
    const std::uint32_t crc = checksum(bytes);
    out += bytes;
    for (int k = 3; k >= 0; --k) out += static_cast<char>(crc >> (8 * k));
  }
  return out;
}

}  // namespace

std::string mutate_e57(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  Logical file;
  if (!take_apart(input, &file)) return bytes(input, input.size() + 16);
  std::string before = file.bytes.substr(kHeader, std::max(file.xml, kHeader) - kHeader);
  std::string xml = file.bytes.substr(file.xml, file.xml_length);
  std::string header = file.bytes.substr(0, kHeader);
  switch (dice.below(5)) {
    case 0:  // a number of a section, a packet or of what it holds, mostly where one may stand
      if (before.size() >= 8) {
        const int width = 1 << dice.below(4);
        std::size_t at = dice.below(before.size() - static_cast<std::size_t>(width) + 1);
        if (dice.one_in(2)) at -= at % 4;
        if (dice.one_in(3)) at = std::min<std::size_t>(at % 48, before.size() - 8);
        set_number(&before, at, width, odd_integer(get_number(before, at, width), width, dice));
      }
      break;
    case 1:
      before = bytes(before, before.size() + 64);
      break;
    default:
      xml = mutate_text(xml, dice, bytes);
  }
  std::string logical = header + before + xml;
  const std::size_t payload = file.page - kChecksum, place = kHeader + before.size();
  const std::size_t pages = (logical.size() + payload - 1) / payload;
  set_number(&logical, kLengthAt, 8, pages * file.page);
  set_number(&logical, kXmlAt, 8, place / payload * file.page + place % payload);
  set_number(&logical, kXmlLengthAt, 8, xml.size());
  if (dice.one_in(12)) {
    const std::size_t at = 8 + 8 * dice.below(5);
    set_number(&logical, at, 8, odd_integer(get_number(logical, at, 8), 8, dice));
  }
  return put_together(std::move(logical), file.page);
}

}  // namespace camber::fuzz
