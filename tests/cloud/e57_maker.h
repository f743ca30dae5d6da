#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace camber::test {

/// Values of one field of an E57 scan, bit by bit as the file has them.
struct E57Stream {
  unsigned bits = 0;                  ///< a value, 0 to 64
  std::vector<std::uint64_t> values;  ///< the lowest bits of each
};

/// Numbers as streams.
E57Stream e57_doubles(const std::vector<double>& values);
E57Stream e57_floats(const std::vector<float>& values);
E57Stream e57_integers(unsigned bits, const std::vector<std::uint64_t>& values);

/// Makes E57 files (ASTM E2807) piece by piece.
class E57Maker {
 public:
  explicit E57Maker(std::size_t page_size = 1024);

  /// Adds a section of points. @param packet_bytes most bytes of each stream in a packet; the
  /// streams then end at different records.
  /// @return its place in the file, for the attribute fileOffset
  std::uint64_t add_points(const std::vector<E57Stream>& streams, std::size_t packet_bytes = 400);
  std::uint64_t add_blob(const std::string& bytes);

  /// The file with this XML (of e57Root's content), checksums and all.
  std::string finish(const std::string& content) const;

  /// The bytes so far, without checksums, header included.
  std::string& logical() { return logical_; }
  std::uint64_t physical(std::size_t logical) const;

 private:
  std::size_t page_size_;
  std::string logical_;
};

/// Puts pages with checksums around bytes.
std::string e57_pages(std::string logical, std::size_t page_size);

/// The element of a scan: content of "vectorChild" with `points` records of `prototype`.
std::string e57_scan(const std::string& head, std::uint64_t place, std::size_t count,
                     const std::string& prototype);

}  // namespace camber::test
