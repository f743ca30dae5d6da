// Any bytes as a film with a track of GoPro's metadata: payloads within the file, samples with
// finite times, or an InputError.

#include <cmath>

#include "camber/import/formats/gpmf.h"
#include "camber/import/formats/mp4_film.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read_or_refuse([&] {
    const auto film = camber::read_mp4_film(file.path());
    if (!film) return;
    for (const camber::FilmPayload& payload : film->telemetry) {
      if (payload.offset > size || payload.size > size - payload.offset) __builtin_trap();
      if (!std::isfinite(payload.time_s)) __builtin_trap();
    }
    const camber::CameraTelemetry read = camber::read_gpmf(file.path(), film->telemetry);
    for (const camber::GeoPoint& point : read.log.segments.front()) {
      if (!std::isfinite(point.time_s) || !(std::abs(point.latitude) <= 90.0)) __builtin_trap();
    }
  });
  return 0;
}
