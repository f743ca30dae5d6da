// Any bytes as points in text.

#include "cloud_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  read_as_cloud(data, size, camber::CloudFormat::kText);
  return 0;
}
