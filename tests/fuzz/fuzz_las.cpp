// Any bytes as a LAS file: read as a cloud, and copied with its records into another LAS file.

#include <sstream>
#include <stdexcept>
#include <vector>

#include "camber/cloud/stream_filters.h"
#include "cloud_input.h"

namespace {

/// A copy with a further attribute: header and records are taken apart and put together again.
void copy_with_attribute(const std::uint8_t* data, std::size_t size, bool lenient) {
  constexpr std::uint64_t kMostPoints = 10000;
  camber::ReadOptions options;
  options.format = camber::CloudFormat::kLas;
  options.lenient = lenient;
  auto source = camber::open_point_source(data, size, "input", options);
  const std::uint64_t count = source->header().count.value_or(0);
  if (count > kMostPoints) return;
  const std::vector<int> values(static_cast<std::size_t>(count), 7);
  source = camber::add_label(std::move(source), "patch", values);
  std::ostringstream out;
  const auto sink = camber::make_point_sink(out, source->header(), camber::CloudFormat::kLas,
                                            camber::CloudEncoding::kBinary);
  camber::PointBatch batch;
  while (source->next(batch)) sink->write(batch);
  sink->finish();
  if (lenient) return;
  // What was written is a sound file with the same points.
  const std::string bytes = out.str();
  const auto again = camber::open_point_source(bytes.data(), bytes.size(), "copy", options);
  if (again->header().count != count) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  read_as_cloud(data, size, camber::CloudFormat::kLas);
  for (const bool lenient : {false, true}) {
    try {
      copy_with_attribute(data, size, lenient);
    } catch (const camber::InputError&) {
      // what a reader of untrusted files answers
    } catch (const std::invalid_argument&) {
      // what cannot be written as LAS
    }
  }
  return 0;
}
