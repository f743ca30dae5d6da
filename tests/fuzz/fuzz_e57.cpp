// Any bytes as an E57 file: all scans, each alone, and in its own frame.

#include "camber/cloud/point_stream.h"
#include "cloud_input.h"

namespace {

/// The points that a stream hands out are as many as it says.
void read_scan(const std::uint8_t* data, std::size_t size, const camber::ReadOptions& options) {
  try {
    const auto source = camber::open_point_source(data, size, "input", options);
    camber::PointBatch batch;
    std::uint64_t count = 0;
    while (source->next(batch)) {
      if (batch.fields.size() != source->header().fields.size()) std::abort();
      count += batch.count;
    }
    if (source->report().points != count) std::abort();
    if (source->header().count.value_or(count) != count) std::abort();
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  read_as_cloud(data, size, camber::CloudFormat::kE57);
  camber::ReadOptions options;
  options.format = camber::CloudFormat::kE57;
  for (const std::size_t scan : {0, 1}) {
    for (const bool own_frame : {false, true}) {
      options.scan = scan;
      options.own_frame = own_frame;
      options.lenient = scan == 0;
      read_scan(data, size, options);
    }
  }
  return 0;
}
