#include "camber/tiles/detail/tile_grid.h"

#include <cmath>

namespace camber::detail {
namespace {

std::uint64_t spread(std::uint64_t v) {
  v = (v | v << 16) & 0x0000ffff0000ffffull;
  v = (v | v << 8) & 0x00ff00ff00ff00ffull;
  v = (v | v << 4) & 0x0f0f0f0f0f0f0f0full;
  v = (v | v << 2) & 0x3333333333333333ull;
  return (v | v << 1) & 0x5555555555555555ull;
}

}  // namespace

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

std::uint64_t plan_code(std::uint32_t x, std::uint32_t y) { return spread(x) | spread(y) << 1; }

}  // namespace camber::detail
