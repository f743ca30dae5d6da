#include "cloud/e57_maker.h"

#include <algorithm>
#include <cstring>

namespace camber::test {
namespace {

constexpr std::size_t kHeader = 48, kChecksum = 4;

void put_number(std::string& out, std::size_t at, std::uint64_t value, int width) {
  for (int k = 0; k < width; ++k) {
    out[at + static_cast<std::size_t>(k)] = static_cast<char>(value >> (8 * k));
  }
}

/// By its definition, a bit at a time.
std::uint32_t checksum(const std::string& bytes) {
  std::uint32_t crc = 0xffffffffu;
  for (const char c : bytes) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0x82F63B78u : 0u);
  }
  return ~crc;
}

std::string packed(const E57Stream& stream) {
  std::string out((stream.values.size() * stream.bits + 7) / 8, '\0');
  std::size_t place = 0;
  for (const std::uint64_t value : stream.values) {
    for (unsigned bit = 0; bit < stream.bits; ++bit, ++place) {
      if ((value >> bit & 1) != 0) {
        out[place / 8] = static_cast<char>(out[place / 8] | 1 << (place % 8));
      }
    }
  }
  return out;
}

}  // namespace

E57Stream e57_doubles(const std::vector<double>& values) {
  E57Stream out;
  out.bits = 64;
  for (const double value : values) {
    std::uint64_t word = 0;
    std::memcpy(&word, &value, sizeof value);
    out.values.push_back(word);
  }
  return out;
}

E57Stream e57_floats(const std::vector<float>& values) {
  E57Stream out;
  out.bits = 32;
  for (const float value : values) {
    std::uint32_t word = 0;
    std::memcpy(&word, &value, sizeof value);
    out.values.push_back(word);
  }
  return out;
}

E57Stream e57_integers(unsigned bits, const std::vector<std::uint64_t>& values) {
  E57Stream out;
  out.bits = bits;
  out.values = values;
  return out;
}

std::string e57_pages(std::string logical, std::size_t page_size) {
  const std::size_t payload = page_size - kChecksum;
  logical.resize((logical.size() + payload - 1) / payload * payload, '\0');
  std::string out;
  for (std::size_t at = 0; at < logical.size(); at += payload) {
    const std::string page = logical.substr(at, payload);
    const std::uint32_t crc = checksum(page);
    out += page;
    for (int k = 3; k >= 0; --k) out += static_cast<char>(crc >> (8 * k));
  }
  return out;
}

E57Maker::E57Maker(std::size_t page_size) : page_size_(page_size), logical_(kHeader, '\0') {}

std::uint64_t E57Maker::physical(std::size_t logical) const {
  const std::size_t payload = page_size_ - kChecksum;
  return logical / payload * page_size_ + logical % payload;
}

std::uint64_t E57Maker::add_points(const std::vector<E57Stream>& streams,
                                   std::size_t packet_bytes) {
  const std::size_t start = logical_.size();
  logical_ += std::string(32, '\0');
  logical_[start] = 1;
  put_number(logical_, start + 16, physical(start + 32), 8);
  std::vector<std::string> bytes;
  std::size_t longest = 0;
  for (const E57Stream& stream : streams) {
    bytes.push_back(packed(stream));
    longest = std::max(longest, bytes.back().size());
  }
  for (std::size_t at = 0; at < longest; at += packet_bytes) {
    const std::size_t packet = logical_.size();
    logical_ += std::string(6 + 2 * streams.size(), '\0');
    logical_[packet] = 1;
    put_number(logical_, packet + 4, streams.size(), 2);
    for (std::size_t s = 0; s < streams.size(); ++s) {
      const std::string part =
          at < bytes[s].size() ? bytes[s].substr(at, packet_bytes) : std::string();
      put_number(logical_, packet + 6 + 2 * s, part.size(), 2);
      logical_ += part;
    }
    logical_.resize(packet + (logical_.size() - packet + 3) / 4 * 4, '\0');
    put_number(logical_, packet + 2, logical_.size() - packet - 1, 2);
  }
  // An index packet as writers append one: of no entries here.
  const std::size_t index = logical_.size();
  logical_ += std::string(16, '\0');
  put_number(logical_, index + 2, 15, 2);
  put_number(logical_, start + 24, physical(index), 8);
  put_number(logical_, start + 8, logical_.size() - start, 8);
  return physical(start);
}

std::uint64_t E57Maker::add_blob(const std::string& bytes) {
  const std::size_t start = logical_.size();
  logical_ += std::string(16, '\0');
  put_number(logical_, start + 8, 16 + bytes.size(), 8);
  logical_ += bytes;
  logical_.resize((logical_.size() + 3) / 4 * 4, '\0');
  return physical(start);
}

std::string E57Maker::finish(const std::string& content) const {
  const std::string xml =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<e57Root type=\"Structure\" "
      "xmlns=\"http://www.astm.org/COMMIT/E57/2010-e57-v1.0\">" +
      content + "</e57Root>\n";
  std::string logical = logical_ + xml;
  const std::size_t payload = page_size_ - kChecksum;
  const std::size_t pages = (logical.size() + payload - 1) / payload;
  logical.replace(0, 8, "ASTM-E57");
  put_number(logical, 8, 1, 4);
  put_number(logical, 16, pages * page_size_, 8);
  put_number(logical, 24, physical(logical_.size()), 8);
  put_number(logical, 32, xml.size(), 8);
  put_number(logical, 40, page_size_, 8);
  return e57_pages(logical, page_size_);
}

std::string e57_scan(const std::string& head, std::uint64_t place, std::size_t count,
                     const std::string& prototype) {
  return "<vectorChild type=\"Structure\">" + head +
         "<points type=\"CompressedVector\" fileOffset=\"" + std::to_string(place) +
         "\" recordCount=\"" + std::to_string(count) + "\"><prototype type=\"Structure\">" +
         prototype + "</prototype><codecs type=\"Vector\"></codecs></points></vectorChild>";
}

}  // namespace camber::test
