// Any bytes as an MCAP file or a database of rosbag2: all messages of all topics.

#include "camber/import/recording.h"
#include "memory_file.h"
#include "read_or_refuse.h"

namespace {

void read_all(camber::BagReader& bag) {
  for (const camber::BagReader::Topic& topic : bag.topics()) {
    std::size_t count = 0, bytes = 0;
    bag.read(topic.name, [&](const camber::BagMessage& message) {
      ++count;
      for (std::size_t i = 0; i < message.size; ++i) bytes += message.data[i];
      return true;
    });
    if (count > topic.messages + 1000000 || bytes == SIZE_MAX) __builtin_trap();
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size > 6 && data[0] == 'S') {
    const MemoryFile file(data, size);
    read_or_refuse([&] { read_all(*camber::open_recording(file.path())); });
  } else {
    read_or_refuse([&] { read_all(*camber::open_mcap(data, size, "input.mcap")); });
  }
  return 0;
}
