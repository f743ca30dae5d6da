#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace camber {

/// A message of a bag, serialised. Not owned: it lasts for the call that hands it out.
struct BagMessage {
  const std::uint8_t* data = nullptr;
  std::size_t size = 0;
  std::int64_t recorded_ns = 0;  ///< when it was written to the bag
};

/// A recording of ROS. Those of ROS 2 and MCAP are read by open_recording() (recording.h), bags of
/// ROS 1 by the program, which loads ROS's library for it (tools/plugins/bag_reader.h).
class BagReader {
 public:
  struct Topic {
    std::string name;  ///< "/camera/image_raw"
    std::string type;  ///< "sensor_msgs/Image", without ROS 2's "/msg/"
    std::size_t messages = 0;
    bool cdr = false;  ///< messages are serialised as ROS 2 does, not as ROS 1
  };
  virtual ~BagReader() = default;
  virtual const std::vector<Topic>& topics() const = 0;  ///< in the order of their names
  /// Hands out the messages of a topic in the order of the file until `take` returns false.
  virtual void read(const std::string& topic,
                    const std::function<bool(const BagMessage&)>& take) = 0;
};

}  // namespace camber
