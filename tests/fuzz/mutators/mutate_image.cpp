#include <zlib.h>

#include <algorithm>
#include <vector>

#include "fuzz/mutators/mutator.h"

namespace camber::fuzz {
namespace {

constexpr std::string_view kSignature("\x89PNG\r\n\x1a\n", 8);

struct Chunk {
  std::string type, data;
};

void append_big_endian(std::string* out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) *out += static_cast<char>(value >> shift);
}

std::uint32_t big_endian(std::string_view bytes, std::size_t at, std::size_t width) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < width; ++i) {
    value = value << 8 | static_cast<std::uint8_t>(bytes[at + i]);
  }
  return value;
}

std::vector<Chunk> chunks_of(std::string_view png) {
  std::vector<Chunk> out;
  for (std::size_t at = kSignature.size(); at + 12 <= png.size();) {
    const std::size_t size = big_endian(png, at, 4);
    if (size > png.size() - at - 12) break;
    out.push_back({std::string(png.substr(at + 4, 4)), std::string(png.substr(at + 8, size))});
    at += 12 + size;
  }
  return out;
}

/// The chunks with check sums that are right.
std::string png_of(const std::vector<Chunk>& chunks) {
  std::string out(kSignature);
  for (const Chunk& chunk : chunks) {
    append_big_endian(&out, static_cast<std::uint32_t>(chunk.data.size()));
    const std::string body = chunk.type + chunk.data;
    out += body;
    append_big_endian(
        &out, static_cast<std::uint32_t>(::crc32(0, reinterpret_cast<const Bytef*>(body.data()),
                                                 static_cast<uInt>(body.size()))));
  }
  return out;
}

/// The compressed rows with their bytes changed; as they were where they do not decompress.
std::string changed_rows(const std::string& compressed, const ByteMutation& bytes) {
  constexpr std::size_t kMost = 1 << 16;
  std::string rows(kMost, '\0');
  uLongf size = kMost;
  if (::uncompress(reinterpret_cast<Bytef*>(rows.data()), &size,
                   reinterpret_cast<const Bytef*>(compressed.data()), compressed.size()) != Z_OK) {
    return compressed;
  }
  rows.resize(size);
  rows = bytes(rows, rows.size() + 64);
  std::string out(::compressBound(rows.size()), '\0');
  uLongf packed = out.size();
  ::compress2(reinterpret_cast<Bytef*>(out.data()), &packed,
              reinterpret_cast<const Bytef*>(rows.data()), rows.size(), 1);
  out.resize(packed);
  return out;
}

/// Width, height, depth, colour type, compression, filter or interlace of IHDR: mostly small
/// values, so that an image is decoded.
void change_header(std::string* header, Dice& dice) {
  if (header->size() != 13) return;
  const std::size_t at = dice.below(9);
  if (at >= 2) {
    static const std::array<std::uint8_t, 8> kValues{0, 1, 2, 3, 4, 6, 8, 16};
    (*header)[6 + at - 2] = static_cast<char>(dice.of(kValues));
    if (at == 2) return;
  }
  if (at < 2) {
    const std::uint32_t old = big_endian(*header, 4 * at, 4);
    const auto now =
        static_cast<std::uint32_t>(dice.one_in(4) ? odd_integer(old, 4, dice) : dice.below(40));
    std::string text;
    append_big_endian(&text, now);
    header->replace(4 * at, 4, text);
  }
}

std::string mutate_png(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  std::vector<Chunk> chunks = chunks_of(input);
  if (chunks.empty()) return bytes(input, input.size() + 16);
  const std::size_t at = dice.below(chunks.size());
  switch (dice.below(6)) {
    case 0:
      change_header(&chunks.front().data, dice);
      break;
    case 1:
      chunks.erase(chunks.begin() + static_cast<long>(at));
      break;
    case 2:
      chunks.insert(chunks.begin() + static_cast<long>(at), Chunk(chunks[at]));
      break;
    case 3:
      std::swap(chunks[at], chunks[dice.below(chunks.size())]);
      break;
    case 4: {
      static const std::array<const char*, 9> kTypes{"PLTE", "tRNS", "gAMA", "cHRM", "sBIT",
                                                     "bKGD", "iCCP", "tEXt", "IDAT"};
      Chunk other{dice.of(kTypes), chunks[at].data};
      chunks.insert(chunks.begin() + static_cast<long>(at), std::move(other));
      break;
    }
    default: {
      std::string& data = chunks[at].data;
      data = chunks[at].type == "IDAT" ? changed_rows(data, bytes) : bytes(data, data.size() + 16);
    }
  }
  return png_of(chunks);
}

/// Segments of a JPEG up to the start of the scan; the last is all the rest.
std::string mutate_jpeg(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  std::vector<std::string> segments;
  std::size_t at = 2;
  while (at + 4 <= input.size() && static_cast<std::uint8_t>(input[at]) == 0xFF) {
    const std::size_t size = 2 + big_endian(input, at + 2, 2);
    if (size < 4 || size > input.size() - at) break;
    segments.emplace_back(input.substr(at, size));
    at += size;
    if (static_cast<std::uint8_t>(segments.back()[1]) == 0xDA) break;
  }
  if (segments.empty()) return bytes(input, input.size() + 16);
  std::string rest(input.substr(at));
  const std::size_t i = dice.below(segments.size());
  std::string& segment = segments[i];
  switch (dice.below(6)) {
    case 0:
      segments.erase(segments.begin() + static_cast<long>(i));
      break;
    case 1:
      segments.insert(segments.begin() + static_cast<long>(i), std::string(segment));
      break;
    case 2:
      std::swap(segment, dice.of(segments));
      break;
    case 3:
      rest = bytes(rest, rest.size() + 16);
      break;
    case 4:
      if (segment.size() > 4) {
        segment[4 + dice.below(segment.size() - 4)] = static_cast<char>(odd_integer(8, 1, dice));
      }
      break;
    default: {
      std::string content = bytes(std::string_view(segment).substr(4), segment.size() + 16);
      content.resize(std::min<std::size_t>(content.size(), 65533));
      const auto size = static_cast<std::uint32_t>(content.size() + 2);
      segment = segment.substr(0, 2) + static_cast<char>(size >> 8) + static_cast<char>(size);
      segment += content;
    }
  }
  std::string out(input.substr(0, 2));
  for (const std::string& s : segments) out += s;
  return out + rest;
}

}  // namespace

std::string mutate_image(std::string_view input, Dice& dice, const ByteMutation& bytes) {
  if (input.substr(0, kSignature.size()) == kSignature) return mutate_png(input, dice, bytes);
  if (input.substr(0, 2) == "\xFF\xD8") return mutate_jpeg(input, dice, bytes);
  return bytes(input, input.size() + 16);
}

}  // namespace camber::fuzz
