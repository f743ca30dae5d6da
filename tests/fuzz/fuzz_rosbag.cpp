// Any bytes as a bag of ROS 1: what the check lets through is read to its end by ROS's library.

#include "bag_reader.h"
#include "camber/core/errors.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const auto bag = camber::tools::open_bag(file.path());
    std::size_t read = 0;
    for (const auto& topic : bag->topics()) {
      bag->read(topic.name, [&](const camber::BagMessage& message) {
        read += message.size > 0 ? message.data[message.size - 1] : 0;
        return true;
      });
    }
    volatile std::size_t sink = read;  // so that the bytes are read
    (void)sink;
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
