// Any bytes as a COPC file: its index is read for levels and for bounds, strictly and leniently.

#include <cstdlib>
#include <optional>
#include <string>

#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"

namespace {

/// A few bytes can stand for very many equal points, which take their time.
constexpr std::uint64_t kMostPoints = 20000;

struct Points {
  std::string records;
  std::uint64_t count = 0, outside = 0;
};

/// @return the points; nothing where they are refused or too many
std::optional<Points> read(const std::uint8_t* data, std::size_t size,
                           const camber::ReadOptions& options) {
  Points out;
  try {
    const auto source = camber::open_point_source(data, size, "input", options);
    camber::PointBatch batch;
    while (source->next(batch)) {
      for (std::size_t i = 0; i < batch.count && batch.records.data != nullptr; ++i) {
        out.records.append(
            reinterpret_cast<const char*>(batch.records.data + i * batch.records.stride),
            batch.records.stride);
      }
      out.count += batch.count;
      if (out.count > kMostPoints) return {};
    }
    out.outside = source->report().outside;
    return out;
  } catch (const camber::InputError&) {
    return {};  // what a reader of untrusted files answers
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  camber::ReadOptions options;
  options.format = camber::CloudFormat::kLaz;
  options.num_threads = 1;
  const std::optional<Points> whole = read(data, size, options);
  for (const bool by_bounds : {false, true}) {
    if (by_bounds) options.bounds = camber::PlanBounds{40.0, -1.0, 200.0, 45.0};
    options.resolution = by_bounds ? 0.0 : 5.0;
    options.lenient = false;
    const std::optional<Points> part = read(data, size, options);
    if (whole && part && part->count + part->outside > whole->count) std::abort();
    options.lenient = true;
    const std::optional<Points> some = read(data, size, options);
    // What is read strictly is read leniently, too.
    if (part && (!some || some->records != part->records)) std::abort();
  }
  return 0;
}
