// Any bytes as an ONNX file: what comes out has no weights of half precision left to change.

#include <cstdint>
#include <cstdlib>
#include <string>

#include "camber/detect/detail/onnx_weights.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  const std::string floats = camber::half_weights_to_floats(bytes);
  if (camber::half_weights_to_floats(floats) != floats) std::abort();
  return 0;
}
