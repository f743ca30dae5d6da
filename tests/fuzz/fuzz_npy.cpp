// Any bytes as the arrays of a folder of crops: rows of the shape that was asked for, as many as
// the header states or fewer, or an InputError.

#include <cstdlib>

#include "camber/detect/detail/npy_reader.h"
#include "memory_file.h"
#include "read_or_refuse.h"

namespace {

template <typename Value>
void check(const camber::internal::NpyArray<Value>& array, std::size_t row, std::size_t rows) {
  if (array.shape.at(0) > rows || array.values.size() != array.shape[0] * row) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::size_t kRows = 100;
  const MemoryFile file(data, size);
  read_or_refuse([&] {
    check(camber::internal::read_npy_bytes(file.path(), {2, 2, 3}, kRows), 12, kRows);
  });
  read_or_refuse(
      [&] { check(camber::internal::read_npy_bytes(file.path(), {4}, kRows), 4, kRows); });
  read_or_refuse([&] {
    check(camber::internal::read_npy_floats(file.path(), {36, 2}, kRows), 72, kRows);
  });
  read_or_refuse(
      [&] { check(camber::internal::read_npy_floats(file.path(), {}, kRows), 1, kRows); });
  return 0;
}
