#include "bag_clouds.h"

#include <fmt/format.h>

#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>

#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"
#include "camber/import/ros_cloud.h"
#include "camber/import/transform_tree.h"
#include "plugins/recording_plugin.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

using Topic = BagReader::Topic;
constexpr const char* kClouds = "sensor_msgs/PointCloud2";

Topic cloud_topic(const BagReader& bag, const std::string& file, const std::string& choice) {
  std::vector<Topic> found;
  std::string names;
  for (const Topic& topic : bag.topics()) {
    if (topic.type != kClouds || topic.messages == 0) continue;
    if (topic.name == choice || topic.name == "/" + choice) return topic;
    names += fmt::format("{}{} ({})", names.empty() ? "" : ", ", printable(topic.name, 80),
                         topic.messages);
    found.push_back(topic);
  }
  if (choice.empty() && found.size() == 1) return found.front();
  if (found.empty()) {
    throw InputError(file, fmt::format("found no point clouds among {} topics, expected messages "
                                       "of the type {}",
                                       bag.topics().size(), kClouds));
  }
  if (!choice.empty()) {
    throw InputError(file, fmt::format("found no topic {} with point clouds, expected one of {}",
                                       printable(choice, 80), names));
  }
  throw InputError(file, fmt::format("found point clouds of {} topics: {}; expected the choice of "
                                     "one with --topic",
                                     found.size(), names));
}

/// Calls take(number, bytes, cloud, recorded) for the messages until it returns false.
template <typename Take>
void each_cloud(BagReader& bag, const Topic& topic, const std::string& file, Take&& take) {
  int number = 0;
  bag.read(topic.name, [&](const BagMessage& message) {
    throw_if_interrupted();
    const RosBytes bytes{message.data, message.size, file,
                         fmt::format("message {} of {}", number, printable(topic.name, 80)),
                         topic.cdr};
    RosPointCloud cloud = read_ros_point_cloud(bytes);
    if (cloud.stamp.ns == 0) cloud.stamp.ns = message.recorded_ns;
    return take(number++, bytes, cloud);
  });
}

/// Transforms of /tf and /tf_static, and poses of odometry where /tf moves nothing.
TransformTree read_frames(BagReader& bag, const std::string& file) {
  TransformTree out;
  for (const Topic& topic : bag.topics()) {
    const bool tf = topic.type == "tf2_msgs/TFMessage" || topic.type == "tf/tfMessage";
    if (!tf) continue;
    const std::string ending = "tf_static";
    const bool fixed =
        topic.name.size() >= ending.size() &&
        topic.name.compare(topic.name.size() - ending.size(), ending.size(), ending) == 0;
    int number = 0;
    bag.read(topic.name, [&](const BagMessage& message) {
      const RosBytes bytes{message.data, message.size, file,
                           fmt::format("message {} of {}", number++, printable(topic.name, 80)),
                           topic.cdr};
      for (const RosTransform& transform : read_ros_transforms(bytes)) {
        if (fixed) {
          out.add_fixed(transform);
        } else {
          out.add_moving(transform);
        }
      }
      return true;
    });
  }
  if (out.has_moving()) return out;
  for (const Topic& topic : bag.topics()) {
    if (topic.type != "nav_msgs/Odometry" || topic.messages == 0) continue;
    int number = 0;
    bag.read(topic.name, [&](const BagMessage& message) {
      const RosBytes bytes{message.data, message.size, file,
                           fmt::format("message {} of {}", number++, printable(topic.name, 80)),
                           topic.cdr};
      const RosOdometry odometry = read_ros_odometry(bytes);
      RosTransform transform;
      transform.stamp = odometry.stamp;
      if (transform.stamp.ns == 0) transform.stamp.ns = message.recorded_ns;
      transform.child = odometry.child;
      transform.parent_from_child = odometry.pose;
      out.add_moving(transform);
      return true;
    });
    break;  // of several the first by name
  }
  return out;
}

bool same_fields(const std::vector<PointField>& a, const std::vector<PointField>& b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const PointField& x, const PointField& y) {
                      return x.name == y.name && x.type == y.type;
                    });
}

std::string stamp_name(std::int64_t ns) {
  return fmt::format("{}_{:09}", ns / 1000000000, ns % 1000000000);
}

CloudFormat format_of(const fs::path& path, const WriteOptions& options) {
  const auto format = options.format ? options.format : format_from_extension(path);
  return format.value_or(CloudFormat::kPly);
}

/// All messages in the frame that does not move, one behind the other.
BagCloudsWritten write_merged(BagReader& bag, const Topic& topic, const std::string& file,
                              const std::string& out, const WriteOptions& options) {
  const TransformTree frames = read_frames(bag, file);
  BagCloudsWritten written;
  std::uint64_t unplaced = 0;
  std::string root, frame;
  write_file_atomically(out, [&](std::ostream& stream) {
    std::unique_ptr<PointSink> sink;
    PointStreamHeader header;
    const CloudFormat format = format_of(out, options);
    each_cloud(bag, topic, file, [&](int, const RosBytes& bytes, const RosPointCloud& cloud) {
      frame = cloud.stamp.frame;
      const auto place = frames.in_root(cloud.stamp.frame, cloud.stamp.ns);
      if (!place) {
        ++unplaced;
        return true;
      }
      if (root.empty()) root = place->root;
      if (place->root != root) {
        throw InputError(
            file, bytes.position,
            fmt::format("found a cloud in the frame {}, expected {} as of those before",
                        printable(place->root, 40), printable(root, 40)));
      }
      const auto source = make_ros_cloud_source(bytes, cloud, &place->root_from_frame);
      if (!sink) {
        header = source->header();
        header.count.reset();
        header.bounds.reset();
        sink = make_point_sink(stream, header, format, encoding_for(out, format, options.encoding),
                               out);
      }
      if (!same_fields(header.fields, source->header().fields)) {
        throw InputError(file, bytes.position,
                         "found a cloud with other fields, expected those of the first");
      }
      PointBatch batch;
      while (source->next(batch)) {
        sink->write(batch);
        written.points += batch.count;
      }
      ++written.messages;
      return true;
    });
    if (!sink) {
      throw NoAnswerError(
          fmt::format("{}: no cloud of {} has a place in a fixed frame: /tf or "
                      "odometry joins '{}' with none at their times",
                      file, printable(topic.name, 80), printable(frame, 40)));
    }
    sink->finish();
    written.notes = sink->notes();
  });
  if (unplaced > 0) {
    written.notes.push_back(fmt::format(
        "{} clouds are left out, since /tf or odometry has no place of their times", unplaced));
  }
  written.notes.push_back(fmt::format("the points are in the frame '{}'", printable(root, 40)));
  written.files = {out};
  return written;
}

}  // namespace

BagCloudsWritten write_bag_clouds(const std::string& file, const BagClouds& what,
                                  const std::string& out, const WriteOptions& options,
                                  bool overwrite) {
  std::error_code error;
  const bool folder = (!out.empty() && out.back() == '/') || fs::is_directory(out, error);
  if (folder && (what.merge || what.message >= 0)) {
    throw UsageError("--out: found a folder, expected a file with --merge or --message");
  }
  const std::unique_ptr<BagReader> bag = open_any_bag(file);
  const Topic topic = cloud_topic(*bag, file, what.topic);
  if (what.merge) return write_merged(*bag, topic, file, out, options);
  BagCloudsWritten written;
  const auto write_one = [&](const RosBytes& bytes, const RosPointCloud& cloud,
                             const fs::path& path, const std::string& name) {
    const auto source = make_ros_cloud_source(bytes, cloud);
    WriteOptions wanted = options;
    wanted.format = format_of(path, options);
    written.points +=
        write_points(*source, path, wanted, {}, written.files.empty() ? &written.notes : nullptr);
    written.files.push_back(name);
    ++written.messages;
  };
  if (folder) {
    std::string target = out;
    while (target.size() > 1 && target.back() == '/') target.pop_back();
    AtomicFolder made(target, overwrite, {file});
    const std::string extension =
        std::string(".") +
        (options.format == CloudFormat::kText
             ? "xyz"
             : std::string(to_string(options.format.value_or(CloudFormat::kPly))));
    each_cloud(*bag, topic, file, [&](int, const RosBytes& bytes, const RosPointCloud& cloud) {
      std::string name = stamp_name(cloud.stamp.ns) + extension;
      for (int k = 1; fs::exists(made.staging() / name, error); ++k) {
        name = stamp_name(cloud.stamp.ns) + "_" + std::to_string(k) + extension;
      }
      write_one(bytes, cloud, made.staging() / name, name);
      return true;
    });
    made.commit();
    return written;
  }
  if (what.message < 0 && topic.messages > 1) {
    throw UsageError(
        fmt::format("--out: found a file for {} clouds of {}, expected a folder "
                    "(ending in /), --merge, or the choice of one with --message",
                    topic.messages, printable(topic.name, 80)));
  }
  const int wanted = std::max(0, what.message);
  each_cloud(*bag, topic, file, [&](int number, const RosBytes& bytes, const RosPointCloud& cloud) {
    if (number != wanted) return true;
    write_one(bytes, cloud, out, out);
    return false;
  });
  if (written.messages == 0) {
    throw InputError(file, fmt::format("found {} clouds of {}, expected a message {} (counted "
                                       "from 0)",
                                       topic.messages, printable(topic.name, 80), wanted));
  }
  return written;
}

}  // namespace camber::tools
