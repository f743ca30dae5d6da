// Any bytes as a configuration file of the program.

#include "camber/core/errors.h"
#include "config_file.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  for (const auto& command : {std::vector<std::string>{"reconstruct"}, {"import", "video"}}) {
    try {
      for (const auto& item : camber::tools::read_config(file.path(), command)) {
        camber::tools::to_toml(item.values, item.values.size() != 1);
      }
    } catch (const camber::InputError&) {
      // what a reader of untrusted files answers
    }
  }
  return 0;
}
