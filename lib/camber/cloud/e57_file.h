#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/cloud/file_reader.h"

namespace camber {

namespace detail {
class E57Pages;
}

/// One value of a record of an E57 scan.
struct E57Field {
  enum class Kind { kInteger, kScaledInteger, kFloat32, kFloat64, kString };
  std::string name;  ///< as in the file, with its prefix: "nor:normalX"
  Kind kind = Kind::kFloat64;
  std::int64_t minimum = INT64_MIN, maximum = INT64_MAX;  ///< of integers, unscaled
  double scale = 1.0, offset = 0.0;                       ///< value = integer * scale + offset

  /// Bits a record takes, from 0 (all values are the minimum) to 64; of strings 0.
  unsigned bits() const;
};

/// Takes points of a scan to the file's frame: x_file = R x_scan + t, metres.
struct E57Pose {
  std::array<double, 4> rotation{1.0, 0.0, 0.0, 0.0};  ///< w x y z, as in the file
  std::array<double, 3> translation{};
};

using E57Numbers = std::vector<std::pair<std::string, double>>;

struct E57Scan {
  std::string guid, name, description, sensor_vendor, sensor_model, sensor_serial;
  std::optional<E57Pose> pose;
  /// As the file has them (whether of the scan's own frame or the file's differs between writers):
  /// "xMinimum", "rowMaximum", "rangeMinimum", ...
  E57Numbers bounds;
  E57Numbers limits;          ///< "intensityMaximum", "colorRedMinimum", ...
  std::uint64_t points = 0;   ///< records, invalid ones included
  std::uint64_t section = 0;  ///< where their section starts, physical
  std::vector<E57Field> fields;

  std::optional<double> limit(const std::string& limit_name) const;
};

struct E57Image {
  std::string guid, name, description, scan_guid;  ///< the scan that it belongs to, if any
  std::optional<E57Pose> pose;
  /// "visual reference", "pinhole", "spherical", "cylindrical"
  std::string representation;
  std::string media;         ///< "jpeg", "png"
  std::uint64_t length = 0;  ///< bytes of the coded picture
  E57Numbers numbers;        ///< "imageWidth", "focalLength", "pixelWidth", ...
};

/// What an E57 file (ASTM E2807) has beside its points.
struct E57File {
  int version_major = 1, version_minor = 0;
  std::string guid, library, coordinate_metadata;
  std::vector<std::pair<std::string, std::string>> extensions;  ///< prefix, name
  std::uint64_t bytes = 0, page_size = 1024, pages = 0;
  std::vector<E57Scan> scans;
  std::vector<E57Image> images;
};

/// Reads header and XML. @param pages is set for reading the points.
/// @param notes gets what a lenient reader passed over.
/// @throws InputError "file: byte N / element path: found, expected".
E57File read_e57_file(std::shared_ptr<const FileBytes> bytes, bool lenient,
                      std::unique_ptr<detail::E57Pages>* pages, std::vector<std::string>* notes);

}  // namespace camber
