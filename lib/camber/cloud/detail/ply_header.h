#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "camber/cloud/file_reader.h"
#include "camber/cloud/point_stream.h"

namespace camber::detail {

struct PlyProperty {
  std::string name;
  ScalarType type = ScalarType::kFloat32;  ///< of the values
  bool list = false;
  ScalarType count_type = ScalarType::kUint8;  ///< of a list's length
};

struct PlyElement {
  std::string name;
  std::uint64_t count = 0;
  std::vector<PlyProperty> properties;
  bool has_lists = false;
  std::uint64_t fixed_size = 0;  ///< bytes of a binary record without its lists' values
  std::uint64_t least_size = 0;  ///< bytes of the shortest possible record
};

/// What a PLY file's header states.
struct PlyHeader {
  bool ascii = false;
  bool big_endian = false;           ///< of a binary file
  std::vector<PlyElement> elements;  ///< in the file's order, names unique
  std::size_t vertex = 0;            ///< index of the element that holds the points
};

/// Reads a PLY header up to and including `end_header`, and checks that the elements it declares
/// can be in the rest of the file. The report receives encoding, declared points, faces and notes.
/// @param lenient  properties of one name are renumbered, elements too large are let through
/// @param comment  receives the text of every comment line, behind the word
/// @throws InputError with the line or byte where the header is not sound.
PlyHeader read_ply_header(FileReader& file, LineReader& lines, bool lenient,
                          const std::function<void(std::string_view)>& comment, ReadReport* report);

/// The list property of an element that holds a face's vertices: its index, or -1.
int face_indices(const PlyElement& element);

}  // namespace camber::detail
