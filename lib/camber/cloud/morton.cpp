#include "camber/cloud/morton.h"

#include <cstdint>
#include <limits>

#include "camber/core/radix_sort.h"

namespace camber {
namespace {

constexpr std::uint64_t kLast = std::numeric_limits<std::uint64_t>::max();

/// Groups of ones, so many bits from one to the next.
constexpr std::uint64_t groups(int apart, int bits) {
  std::uint64_t mask = 0;
  for (int at = 0; at < 64; at += apart) mask |= ((std::uint64_t{1} << bits) - 1) << at;
  return mask;
}

/// The lowest bits of v at positions 0, kAxes, 2 kAxes, ...: all 32 for two axes, 21 for three.
/// Groups of 2 kHalf bits are cut in halves, which move apart, and so on.
template <int kAxes, int kHalf = 16>
std::uint64_t spread(std::uint64_t v) {
  constexpr std::uint64_t kMask = groups(kAxes * kHalf, kHalf);
  v = (v | v << (kAxes - 1) * kHalf) & kMask;
  if constexpr (kHalf > 1) v = spread<kAxes, kHalf / 2>(v);
  return v;
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
      code |= spread<3>(static_cast<std::uint64_t>(cell)) << axis;
    }
    items[i].code = code;
  }
  radix_sort(&items);
  std::vector<int> order;
  order.reserve(items.size());
  for (const Item& item : items) order.push_back(item.index);
  return order;
}

std::uint64_t morton_code(std::uint32_t x, std::uint32_t y) {
  return spread<2>(x) | spread<2>(y) << 1;
}

}  // namespace camber
