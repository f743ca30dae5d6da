#include "camber/cloud/morton.h"

#include <cstdint>
#include <limits>

#include "camber/core/radix_sort.h"

namespace camber {
namespace {

constexpr std::uint64_t kLast = std::numeric_limits<std::uint64_t>::max();

/// Bits 0 to 20 of v at positions 0, 3, 6, ...
std::uint64_t spread(std::uint64_t v) {
  v &= 0x1fffff;
  v = (v | v << 32) & 0x1f00000000ffffull;
  v = (v | v << 16) & 0x1f0000ff0000ffull;
  v = (v | v << 8) & 0x100f00f00f00f00full;
  v = (v | v << 4) & 0x10c30c30c30c30c3ull;
  return (v | v << 2) & 0x1249249249249249ull;
}

}  // namespace

std::vector<int> morton_order(const std::vector<Eigen::Vector3f>& points) {
  Eigen::Array3f low = Eigen::Array3f::Constant(std::numeric_limits<float>::infinity());
  Eigen::Array3f high = -low;
  for (const Eigen::Vector3f& p : points) {
    if (!p.allFinite()) continue;
    low = low.min(p.array());
    high = high.max(p.array());
  }
  constexpr double kCells = 1 << 21;
  const Eigen::Array3d start = low.cast<double>();
  const double size = (high.cast<double>() - start).maxCoeff();
  const double scale = size > 0.0 ? (kCells - 1.0) / size : 0.0;
  struct Item {
    std::uint64_t code;
    int index;
  };
  std::vector<Item> items(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    items[i].index = static_cast<int>(i);
    items[i].code = kLast;
    if (!points[i].allFinite()) continue;
    std::uint64_t code = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double cell = (static_cast<double>(points[i][axis]) - start[axis]) * scale;
      code |= spread(static_cast<std::uint64_t>(cell)) << axis;
    }
    items[i].code = code;
  }
  radix_sort(&items);
  std::vector<int> order;
  order.reserve(items.size());
  for (const Item& item : items) order.push_back(item.index);
  return order;
}

}  // namespace camber
