#include "bag_reader.h"

#include <console_bridge/console.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <map>

#include "bag_check.h"
#include "camber/core/errors.h"
#include "camber/core/read_file.h"

namespace camber::tools {
namespace {

class RosBagReader : public BagReader {
 public:
  explicit RosBagReader(const std::filesystem::path& path) : path_(path.string()) {
    check_bag(path);
    console_bridge::noOutputHandler();
    guarded([&]() {
      bag_.open(path_, rosbag::bagmode::Read);
      std::map<std::string, Topic> by_name;
      rosbag::View all(bag_);
      for (const rosbag::ConnectionInfo* connection : all.getConnections()) {
        Topic& topic = by_name[connection->topic];
        topic.name = connection->topic;
        if (topic.type.empty()) topic.type = connection->datatype;
        if (topic.type != connection->datatype) topic.type = "several types";
      }
      for (auto& [name, topic] : by_name) {
        rosbag::View view(bag_, of_topic(name));
        topic.messages = view.size();
        topics_.push_back(topic);
      }
    });
  }

  const std::vector<Topic>& topics() const override { return topics_; }

  void read(const std::string& topic, const std::function<bool(const BagMessage&)>& take) override {
    guarded([&]() {
      rosbag::View view(bag_, of_topic(topic));
      std::vector<std::uint8_t> bytes;
      for (const rosbag::MessageInstance& message : view) {
        bytes.resize(message.size());
        ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
        message.write(stream);
        const ros::Time& time = message.getTime();
        if (!take({bytes.data(), bytes.size(), std::int64_t{time.sec} * 1000000000 + time.nsec})) {
          break;
        }
      }
    });
  }

 private:
  static boost::function<bool(const rosbag::ConnectionInfo*)> of_topic(const std::string& name) {
    return [name](const rosbag::ConnectionInfo* connection) { return connection->topic == name; };
  }

  /// Errors of ROS's library as InputError.
  template <typename Work>
  void guarded(const Work& work) const {
    try {
      work();
    } catch (const ros::Exception& error) {
      throw InputError(path_, "the bag cannot be read: " + printable(error.what(), 120));
    }
  }

  std::string path_;
  rosbag::Bag bag_;
  std::vector<Topic> topics_;
};

}  // namespace

std::unique_ptr<BagReader> open_bag(const std::filesystem::path& path) {
  return std::make_unique<RosBagReader>(path);
}

}  // namespace camber::tools
