// Any bytes as drive.json: a drive that can be written again, or refused with an InputError.

#include <nlohmann/json.hpp>

#include "camber/scene/drive_document.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read_or_refuse([&] { camber::to_json(camber::read_drive(file.path())); });
  return 0;
}
