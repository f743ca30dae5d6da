// Any bytes as a LAS file.

#include "cloud_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  read_as_cloud(data, size, camber::CloudFormat::kLas);
  return 0;
}
