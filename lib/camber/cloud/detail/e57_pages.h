#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/file_reader.h"

namespace camber::detail {

/// CRC-32C (Castagnoli) of bytes: reflected polynomial 0x82F63B78, start and end inverted.
std::uint32_t crc32c(const unsigned char* data, std::size_t size);

/// The bytes of an E57 file without the checksums at the ends of its pages (ASTM E2807). Places in
/// the XML and in section headers are physical, within the file; lengths are logical, without
/// checksums.
class E57Pages {
 public:
  /// @param page_size bytes of a page with its checksum, a power of two from 64
  /// @param pages     that the file holds whole
  /// @param lenient   wrong checksums are counted, not refused
  E57Pages(std::shared_ptr<const FileBytes> file, std::uint64_t page_size, std::uint64_t pages,
           bool lenient);

  std::uint64_t logical_size() const { return pages_ * payload_; }
  std::uint64_t physical(std::uint64_t logical) const {
    return logical / payload_ * page_size_ + logical % payload_;
  }
  /// @return false for a place in a checksum or behind the end.
  bool to_logical(std::uint64_t physical, std::uint64_t* logical) const;

  /// Copies bytes whose range must lie within logical_size().
  /// @throws InputError naming the page whose checksum is wrong, unless lenient.
  void read(std::uint64_t logical, std::size_t size, unsigned char* out);

  /// Checks the pages that nothing has read so far.
  void check_rest();

  std::uint64_t wrong_pages() const { return wrong_; }
  const FileBytes& file() const { return *file_; }

 private:
  void load(std::uint64_t page);

  std::shared_ptr<const FileBytes> file_;
  std::uint64_t page_size_, payload_, pages_;
  bool lenient_;
  std::uint64_t first_ = 0, loaded_ = 0;  // pages in the window
  std::string window_;                    // their payloads
  std::vector<bool> checked_;
  std::uint64_t wrong_ = 0;
};

}  // namespace camber::detail
