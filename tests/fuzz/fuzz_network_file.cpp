// Any bytes as the side file of a network: a description that can be used, or an InputError.

#include "camber/pipeline/network_file.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read_or_refuse([&] {
    const camber::DetectorDescription detector = camber::read_detector_description(file.path());
    if (detector.input.width < 8 || detector.input.height < 8) std::abort();
  });
  read_or_refuse([&] {
    const camber::SegmenterDescription segmenter = camber::read_segmenter_description(file.path());
    if (segmenter.input.width < 8 || segmenter.input.height < 8) std::abort();
  });
  return 0;
}
