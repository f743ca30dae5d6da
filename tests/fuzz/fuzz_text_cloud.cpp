// Any bytes as points in text, and as PTX.

#include "cloud_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  read_as_cloud(data, size, camber::CloudFormat::kText);
  read_as_cloud(data, size, camber::CloudFormat::kText, "input.ptx");
  return 0;
}
