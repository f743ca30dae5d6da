#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "camber/cloud/file_reader.h"
#include "camber/cloud/point_stream.h"

namespace camber::detail {

inline constexpr std::size_t kMostPcdFields = 4096;  ///< columns, all elements of all fields

struct PcdField {
  std::string name;         ///< "_": padding
  std::uint64_t size = 4;   ///< bytes of an element: 1, 2, 4 or 8
  char type = 'F';          ///< F, I or U
  std::uint64_t count = 1;  ///< elements
  bool kept = true;         ///< set where the columns are laid out
};

enum class PcdBody { kAscii, kBinary, kCompressed };

/// What a PCD file's header states.
struct PcdHeader {
  std::vector<PcdField> fields;  ///< in the file's order; names may repeat
  std::uint64_t points = 0;      ///< not checked against the file's size
  PcdBody body = PcdBody::kAscii;
  std::optional<std::array<double, 7>> viewpoint;  ///< x y z and a quaternion w x y z
};

/// Reads a PCD header up to and including the DATA line. The report receives encoding, declared
/// points and, of an organised cloud, width and height.
/// @param comment  receives the text of every comment line, behind the sign
/// @throws InputError with the line or byte where the header is not sound.
PcdHeader read_pcd_header(FileReader& file, LineReader& lines,
                          const std::function<void(std::string_view)>& comment, ReadReport* report);

}  // namespace camber::detail
