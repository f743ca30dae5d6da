// Any bytes as poses, speeds, positions or attitudes of another program: numbers that can be used,
// or an InputError.

#include "camber/import/formats/trajectory.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read_or_refuse([&] { camber::read_poses(file.path()); });
  read_or_refuse([&] { camber::read_speeds(file.path()); });
  read_or_refuse([&] { camber::read_geo_log(file.path()); });
  read_or_refuse([&] { camber::read_attitudes(file.path()); });
  read_or_refuse([&] {
    if (camber::is_oxts(file.path())) camber::read_oxts(file.path());
  });
  return 0;
}
