// Any bytes as poses, speeds, positions or attitudes of another program: numbers that can be used,
// or an InputError.

#include "camber/core/errors.h"
#include "camber/scene/formats/trajectory.h"
#include "memory_file.h"

namespace {

template <typename Reader>
void read(Reader&& reader) {
  try {
    reader();
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read([&] { camber::read_poses(file.path()); });
  read([&] { camber::read_speeds(file.path()); });
  read([&] { camber::read_geo_log(file.path()); });
  read([&] { camber::read_attitudes(file.path()); });
  read([&] {
    if (camber::is_oxts(file.path())) camber::read_oxts(file.path());
  });
  return 0;
}
