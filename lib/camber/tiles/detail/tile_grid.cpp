#include "camber/tiles/detail/tile_grid.h"

#include <cmath>

namespace camber::detail {

TileAxis::TileAxis(double scale, double offset, double side, double origin)
    : scale_(scale), offset_(offset), side_(side), origin_(origin) {}

std::int64_t TileAxis::edge(std::int64_t tile) const {
  // Coordinates that round numbers are an integer away from are that integer.
  constexpr double kRounding = 1e-6;
  const double place = static_cast<double>(tile) * side_ + origin_;
  return static_cast<std::int64_t>(std::ceil((place - offset_) / scale_ - kRounding));
}

std::int64_t TileAxis::tile_of(std::int32_t value) {
  if (value >= low_ && value < high_) return tile_;
  tile_ = static_cast<std::int64_t>(std::floor((coordinate(value) - origin_) / side_));
  while (edge(tile_) > value) --tile_;
  while (edge(tile_ + 1) <= value) ++tile_;
  low_ = edge(tile_);
  high_ = edge(tile_ + 1);
  return tile_;
}

}  // namespace camber::detail
