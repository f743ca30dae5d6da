#pragma once

// Arrays as NumPy writes them (.npy, NumPy enhancement proposal 1).

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace camber::internal {

/// The values of an array in C order, and its shape.
template <typename Value>
struct NpyArray {
  std::vector<std::size_t> shape;
  std::vector<Value> values;
};

constexpr std::size_t kAnySide = 0;

/// @param rows     of the result, at most: the first ones of the array.
/// @param columns  what the shape must be after its first number; kAnySide: any from 1 to 1024.
/// @throws InputError for a file that is missing or damaged, of another type or shape.
NpyArray<std::uint8_t> read_npy_bytes(const std::filesystem::path& path,
                                      const std::vector<std::size_t>& columns, std::size_t rows);
NpyArray<float> read_npy_floats(const std::filesystem::path& path,
                                const std::vector<std::size_t>& columns, std::size_t rows);

}  // namespace camber::internal
