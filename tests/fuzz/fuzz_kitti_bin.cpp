// Any bytes as a KITTI laser scan.

#include "cloud_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  read_as_cloud(data, size, camber::CloudFormat::kKittiBin);
  return 0;
}
