#include "camber/cloud/detail/e57_pages.h"

#include <algorithm>
#include <array>
#include <cstring>

namespace camber::detail {
namespace {

constexpr std::size_t kChecksum = 4;                       // bytes at the end of a page
constexpr std::uint64_t kWindow = std::uint64_t{1} << 18;  // bytes read at once

using Tables = std::array<std::array<std::uint32_t, 256>, 8>;

/// Of eight bytes at once (Kounavis and Berry, "Novel table lookup-based algorithms for high-
/// performance CRC generation", IEEE Transactions on Computers 2008).
Tables make_tables() {
  Tables tables{};
  for (std::uint32_t i = 0; i < 256; ++i) {
    std::uint32_t crc = i;
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ ((crc & 1) != 0 ? 0x82F63B78u : 0u);
    tables[0][i] = crc;
  }
  for (std::size_t t = 1; t < tables.size(); ++t) {
    for (std::size_t i = 0; i < 256; ++i) {
      const std::uint32_t before = tables[t - 1][i];
      tables[t][i] = (before >> 8) ^ tables[0][before & 0xff];
    }
  }
  return tables;
}

}  // namespace

std::uint32_t crc32c(const unsigned char* data, std::size_t size) {
  static const Tables tables = make_tables();
  std::uint32_t crc = 0xffffffffu;
  for (; size >= 8; data += 8, size -= 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, data, 8);
    word ^= crc;
    crc = 0;
    for (std::size_t t = 0; t < 8; ++t) crc ^= tables[7 - t][word >> (8 * t) & 0xff];
  }
  for (; size > 0; ++data, --size) crc = (crc >> 8) ^ tables[0][(crc ^ *data) & 0xff];
  return ~crc;
}

E57Pages::E57Pages(std::shared_ptr<const FileBytes> file, std::uint64_t page_size,
                   std::uint64_t pages, bool lenient)
    : file_(std::move(file)),
      page_size_(page_size),
      payload_(page_size - kChecksum),
      pages_(pages),
      lenient_(lenient),
      checked_(static_cast<std::size_t>(pages)) {}

bool E57Pages::to_logical(std::uint64_t physical, std::uint64_t* logical) const {
  const std::uint64_t page = physical / page_size_, within = physical % page_size_;
  if (page >= pages_ || within >= payload_) return false;
  *logical = page * payload_ + within;
  return true;
}

void E57Pages::load(std::uint64_t page) {
  first_ = page;
  loaded_ = std::min(pages_ - page, std::max<std::uint64_t>(1, kWindow / page_size_));
  window_ = file_->read(page * page_size_, loaded_ * page_size_);
  const auto payload = static_cast<std::size_t>(payload_);
  for (std::uint64_t i = 0; i < loaded_; ++i) {
    char* const at = window_.data() + i * page_size_;
    const auto* const bytes = reinterpret_cast<const unsigned char*>(at);
    const auto number = static_cast<std::size_t>(page + i);
    if (!checked_[number]) {
      std::uint32_t stored = 0;
      for (std::size_t k = 0; k < kChecksum; ++k) stored = stored << 8 | bytes[payload + k];
      if (crc32c(bytes, payload) != stored) {
        if (!lenient_) {
          file_->fail_at(number * page_size_ + payload,
                         "found a wrong checksum (CRC-32C) of page " + std::to_string(number) +
                             " of " + std::to_string(pages_) + ", expected that of its bytes");
        }
        ++wrong_;
      }
      checked_[number] = true;
    }
    std::memmove(window_.data() + i * payload_, at, payload);
  }
}

void E57Pages::read(std::uint64_t logical, std::size_t size, unsigned char* out) {
  while (size > 0) {
    const std::uint64_t page = logical / payload_;
    if (page < first_ || page >= first_ + loaded_) load(page);
    const std::uint64_t at = logical - first_ * payload_;
    const auto count =
        static_cast<std::size_t>(std::min<std::uint64_t>(size, loaded_ * payload_ - at));
    std::memcpy(out, window_.data() + at, count);
    out += count;
    logical += count;
    size -= count;
  }
}

void E57Pages::check_rest() {
  for (std::uint64_t page = 0; page < pages_; ++page) {
    if (!checked_[static_cast<std::size_t>(page)]) load(page);
  }
}

}  // namespace camber::detail
