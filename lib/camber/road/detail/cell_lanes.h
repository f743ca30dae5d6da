#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "camber/road/detail/ground_cells.h"

/// Points of a cell eight at a time, for functions that are compiled for several instruction sets.
namespace camber::detail {

inline constexpr std::size_t kLanes = 8;
using F8 = float __attribute__((vector_size(32)));
using I8 = std::int32_t __attribute__((vector_size(32)));

/// Coordinates of eight points, as CellPoint has them; and which of them there are (all bits set).
struct PointLanes {
  F8 u, v, h;
  I8 there;
};

/// @param points  at least one; the last is repeated where they are fewer than eight
inline __attribute__((always_inline)) void load_lanes(const CellPoint* points, std::size_t count,
                                                      PointLanes& out) {
  static_assert(sizeof(CellPoint) == 16, "two points in a vector");
  CellPoint padded[kLanes];
  const I8 lane = {0, 1, 2, 3, 4, 5, 6, 7};
  out.there = lane < static_cast<std::int32_t>(count < kLanes ? count : kLanes);
  if (count < kLanes) {
    for (std::size_t i = 0; i < kLanes; ++i) padded[i] = points[i < count ? i : count - 1];
    points = padded;
  }
  F8 p01, p23, p45, p67;  // an array would be copied through memory
  std::memcpy(&p01, points, sizeof p01);
  std::memcpy(&p23, points + 2, sizeof p23);
  std::memcpy(&p45, points + 4, sizeof p45);
  std::memcpy(&p67, points + 6, sizeof p67);
  const F8 uv0 = __builtin_shufflevector(p01, p23, 0, 4, 8, 12, 1, 5, 9, 13);
  const F8 uv1 = __builtin_shufflevector(p45, p67, 0, 4, 8, 12, 1, 5, 9, 13);
  const F8 h0 = __builtin_shufflevector(p01, p23, 2, 6, 10, 14, 3, 7, 11, 15);
  const F8 h1 = __builtin_shufflevector(p45, p67, 2, 6, 10, 14, 3, 7, 11, 15);
  out.u = __builtin_shufflevector(uv0, uv1, 0, 1, 2, 3, 8, 9, 10, 11);
  out.v = __builtin_shufflevector(uv0, uv1, 4, 5, 6, 7, 12, 13, 14, 15);
  out.h = __builtin_shufflevector(h0, h1, 0, 1, 2, 3, 8, 9, 10, 11);
}

inline __attribute__((always_inline)) float sum_of_lanes(const F8& values) {
  float out = 0.0f;
  for (std::size_t i = 0; i < kLanes; ++i) out += values[i];
  return out;
}

inline __attribute__((always_inline)) float least_of_lanes(const F8& values) {
  float out = values[0];
  for (std::size_t i = 1; i < kLanes; ++i) out = values[i] < out ? values[i] : out;
  return out;
}

}  // namespace camber::detail
