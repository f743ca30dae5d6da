#include "cli/bag_maker.h"

#include <rosbag/bag.h>

namespace {

/// A message of any type, its bytes as they are.
struct Serialised {
  const camber::test::BagContent* content = nullptr;
};

}  // namespace

namespace ros {
namespace message_traits {
template <>
struct MD5Sum<Serialised> {
  static const char* value(const Serialised&) { return "0123456789abcdef0123456789abcdef"; }
};
template <>
struct DataType<Serialised> {
  static const char* value(const Serialised& message) {
    static thread_local std::string type;
    type = "sensor_msgs/" + message.content->type;
    return type.c_str();
  }
};
template <>
struct Definition<Serialised> {
  static const char* value(const Serialised&) { return "# as sensor_msgs has it\n"; }
};
}  // namespace message_traits
namespace serialization {
template <>
struct Serializer<Serialised> {
  template <typename Stream>
  static void write(Stream& stream, const Serialised& message) {
    const std::string& bytes = message.content->bytes;
    std::memcpy(stream.advance(static_cast<std::uint32_t>(bytes.size())), bytes.data(),
                bytes.size());
  }
  static std::uint32_t serializedLength(const Serialised& message) {
    return static_cast<std::uint32_t>(message.content->bytes.size());
  }
};
}  // namespace serialization
}  // namespace ros

namespace camber::test {

void write_bag(const std::filesystem::path& path, const std::vector<BagContent>& messages,
               BagCompression compression, int chunk_bytes) {
  rosbag::Bag bag(path.string(), rosbag::bagmode::Write);
  bag.setCompression(compression == BagCompression::kBz2   ? rosbag::compression::BZ2
                     : compression == BagCompression::kLz4 ? rosbag::compression::LZ4
                                                           : rosbag::compression::Uncompressed);
  bag.setChunkThreshold(static_cast<std::uint32_t>(chunk_bytes));
  double time = 100.0;
  for (const BagContent& content : messages) {
    bag.write(content.topic, ros::Time(time), Serialised{&content});
    time += 0.1;
  }
  bag.close();
}

}  // namespace camber::test
