#pragma once

#include <cstdint>

/// The squares of a plan along one axis, in the integers that LAS files hold coordinates as.
namespace camber::detail {

/// Tile k holds the integers from edge(k) to below edge(k + 1): those whose coordinates are at
/// least origin + k * side and below the next one's.
class TileAxis {
 public:
  /// @param scale, offset  of the files: a coordinate is integer * scale + offset
  /// @param side, origin   of the tiles, in the unit of the coordinates
  TileAxis(double scale, double offset, double side, double origin);

  std::int64_t edge(std::int64_t tile) const;
  std::int64_t tile_of(std::int32_t value);
  double coordinate(std::int64_t value) const {
    return static_cast<double>(value) * scale_ + offset_;
  }

 private:
  double scale_, offset_, side_, origin_;
  std::int64_t tile_ = 0, low_ = 0, high_ = 0;  // of the last one
};

}  // namespace camber::detail
