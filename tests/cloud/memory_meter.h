#pragma once

#include <cstddef>

namespace camber::test {

/// Counts what operator new hands out in this program (the tests of one thread only).
class MemoryMeter {
 public:
  MemoryMeter();
  /// Most bytes that were held at once since the construction, beyond those held then.
  std::size_t peak() const;

 private:
  std::size_t start_;
};

}  // namespace camber::test
