#include "camber/import/import_rosbag.h"

#include <fmt/format.h>

#include <algorithm>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"
#include "camber/image/image_io.h"
#include "camber/image/raw_pixels.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/detail/recorded_motion.h"
#include "camber/import/detail/samples_in_time.h"
#include "camber/import/formats/ros_messages.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr const char* kImage = "sensor_msgs/Image";
constexpr const char* kCompressed = "sensor_msgs/CompressedImage";
constexpr const char* kCameraInfo = "sensor_msgs/CameraInfo";

using Topic = BagReader::Topic;

bool is_image(const Topic& topic) { return topic.type == kImage || topic.type == kCompressed; }

/// "/a/image_raw (120), /b/image_raw (118)"
std::string listed(const std::vector<Topic>& topics) {
  std::string out;
  for (std::size_t i = 0; i < topics.size() && i < 12; ++i) {
    out += fmt::format("{}{} ({})", i > 0 ? ", " : "", printable(topics[i].name, 80),
                       topics[i].messages);
  }
  return topics.size() > 12 ? out + ", ..." : out;
}

/// A bag with the topics that matter here.
class Bag {
 public:
  Bag(std::shared_ptr<BagReader> reader, fs::path file)
      : reader_(std::move(reader)), file_(std::move(file)) {}

  std::string name() const { return file_.string(); }
  BagReader& reader() const { return *reader_; }

  Topic image_topic(const std::string& choice) const {
    const std::vector<Topic> images = topics([](const Topic& t) { return is_image(t); });
    if (images.empty()) {
      throw InputError(name(), fmt::format("found no images among {} topics, expected messages of "
                                           "the type {} or {}",
                                           reader_->topics().size(), kImage, kCompressed));
    }
    if (!choice.empty()) return named(images, choice, "images");
    if (images.size() > 1) {
      throw InputError(name(), fmt::format("found images of {} topics: {}; expected the choice of "
                                           "one with --topic",
                                           images.size(), listed(images)));
    }
    return images.front();
  }

  /// The CameraInfo that belongs to images: the one chosen, or that beside them by name.
  std::optional<Topic> info_topic(const Topic& image, const std::string& choice) const {
    const std::vector<Topic> infos = topics([](const Topic& t) { return t.type == kCameraInfo; });
    if (!choice.empty()) return named(infos, choice, "CameraInfo");
    std::string base = image.name;  // "/cam/image_raw/compressed" has "/cam/camera_info"
    if (image.type == kCompressed) base = base.substr(0, base.rfind('/'));
    const std::string beside = base.substr(0, base.rfind('/') + 1) + "camera_info";
    for (const Topic& info : infos) {
      if (info.name == beside) return info;
    }
    if (infos.empty()) return std::nullopt;
    throw InputError(name(), fmt::format("found no {} but {}; expected the choice of one with "
                                         "--info-topic, or --calib",
                                         printable(beside, 80), listed(infos)));
  }

  /// The topic of a type that a choice names, or the only one.
  /// @param option  that chooses; where there are several a phrase names it
  std::optional<Topic> motion_topic(const char* type, const std::string& choice, const char* what,
                                    const char* option, OwnImport& out) const {
    if (choice == "none") return std::nullopt;
    const std::vector<Topic> found = topics([&](const Topic& t) { return t.type == type; });
    if (!choice.empty()) return named(found, choice, what);
    if (found.size() == 1) return found.front();
    if (!found.empty()) {
      out.missing.push_back(
          fmt::format("{}: there are {} topics of them: {}; {} chooses one, or none", what,
                      found.size(), listed(found), option));
    }
    return std::nullopt;
  }

  /// Hands out the messages of a topic with their numbers, from 0.
  void read(const Topic& topic,
            const std::function<bool(int number, const BagMessage&, const RosBytes&)>& take) const {
    int number = 0;
    reader_->read(topic.name, [&](const BagMessage& message) {
      throw_if_interrupted();
      const RosBytes bytes{message.data, message.size, name(),
                           fmt::format("message {} of {}", number, printable(topic.name, 80)),
                           topic.cdr};
      return take(number++, message, bytes);
    });
  }

 private:
  template <typename Wanted>
  std::vector<Topic> topics(const Wanted& wanted) const {
    std::vector<Topic> out;
    for (const Topic& topic : reader_->topics()) {
      if (topic.messages > 0 && wanted(topic)) out.push_back(topic);
    }
    return out;
  }
  Topic named(const std::vector<Topic>& among, const std::string& choice, const char* what) const {
    for (const Topic& topic : among) {
      if (topic.name == choice || topic.name == "/" + choice) return topic;
    }
    throw InputError(
        name(), fmt::format("found no topic {} with {}, expected {}", printable(choice, 80), what,
                            among.empty() ? "one with messages" : "one of " + listed(among)));
  }

  std::shared_ptr<BagReader> reader_;
  fs::path file_;
};

/// A message with an image.
struct Entry {
  int message = 0;  // its number in the topic
  std::int64_t ns = 0;
  bool jpeg = false;  // to be kept as such a file
};

struct Entries {
  std::vector<Entry> all;  // by time
  int width = 0, height = 0;
};

bool is_jpeg(const RosCompressedImage& image) {
  return image.size >= 2 && image.data[0] == 0xff && image.data[1] == 0xd8;
}

std::string file_of(const RosCompressedImage& image) {
  return {reinterpret_cast<const char*>(image.data), image.size};
}

std::string name_of(const RosBytes& bytes) { return bytes.file + ": " + bytes.position; }

/// The pattern where a compressed image is the sensor's mosaic ("bayer_rggb8; jpeg compressed "),
/// which image_transport leaves as it is: one channel. Else empty.
std::string mosaic_of(const RosCompressedImage& image, const ImageInfo& info) {
  const bool mosaic = image.format.compare(0, 6, "bayer_") == 0 && info.channels == 1;
  return mosaic ? image.format.substr(0, image.format.find(';')) : "";
}

/// Sorted by time; what has no time of its own goes.
void put_in_order(std::vector<Entry>& all, OwnImport& out) {
  const auto leave_out = [&](std::vector<Entry>::iterator from, const char* what) {
    if (from == all.end()) return;
    out.missing.push_back(fmt::format("{} images {}, left out", all.end() - from, what));
    all.erase(from, all.end());
  };
  leave_out(std::stable_partition(all.begin(), all.end(), [](const Entry& e) { return e.ns != 0; }),
            "whose header has no time");
  std::stable_sort(all.begin(), all.end(),
                   [](const Entry& a, const Entry& b) { return a.ns < b.ns; });
  leave_out(std::unique(all.begin(), all.end(),
                        [](const Entry& a, const Entry& b) { return a.ns == b.ns; }),
            "with the time of another");
}

/// Times of all images, without their pixels. Where no header has a time, those of recording.
Entries list_images(const Bag& bag, const Topic& topic, OwnImport& out) {
  Entries entries;
  std::vector<std::int64_t> recorded;
  bool stamped = false;
  bag.read(topic, [&](int number, const BagMessage& message, const RosBytes& bytes) {
    Entry entry;
    entry.message = number;
    int width = 0, height = 0;
    if (topic.type == kImage) {
      const RosImage image = read_ros_image(bytes);
      entry.ns = image.stamp.ns;
      width = static_cast<int>(image.width);
      height = static_cast<int>(image.height);
    } else {
      const RosCompressedImage image = read_ros_compressed_image(bytes);
      const ImageInfo info = read_image_info(file_of(image), name_of(bytes));
      entry.ns = image.stamp.ns;
      entry.jpeg = is_jpeg(image) && mosaic_of(image, info).empty();
      width = info.width;
      height = info.height;
    }
    if (number == 0) {
      entries.width = width;
      entries.height = height;
    }
    stamped = stamped || entry.ns != 0;
    recorded.push_back(message.recorded_ns);
    entries.all.push_back(entry);
    return true;
  });
  if (!stamped) {
    for (std::size_t i = 0; i < recorded.size(); ++i) entries.all[i].ns = recorded[i];
    out.found.emplace_back("the images' headers have no times: those of the recording are taken");
  }
  put_in_order(entries.all, out);
  if (entries.all.empty()) {
    throw InputError(bag.name(), fmt::format("found images of {} without any time, expected times",
                                             printable(topic.name, 80)));
  }
  return entries;
}

double seconds_since(const Entries& entries, const Entry& entry) {
  return 1e-9 * static_cast<double>(entry.ns - entries.all.front().ns);
}

/// "120 images of /cam/image_raw over 11.90 s, 10 a second", and the longest gap if there are any.
void describe(const Entries& entries, const Topic& topic, OwnImport& out) {
  const std::vector<Entry>& all = entries.all;
  const double span = seconds_since(entries, all.back());
  std::string phrase =
      fmt::format("{} images of {} over {:.2f} s", all.size(), printable(topic.name, 80), span);
  if (all.size() > 1) {
    std::vector<double> steps;
    for (std::size_t i = 1; i < all.size(); ++i) {
      steps.push_back(1e-9 * static_cast<double>(all[i].ns - all[i - 1].ns));
    }
    std::sort(steps.begin(), steps.end());
    const double usual = steps[steps.size() / 2];
    phrase += fmt::format(", {:.4g} a second", 1.0 / usual);
    const auto gaps = steps.end() - std::upper_bound(steps.begin(), steps.end(), 1.5 * usual);
    if (gaps > 0) {
      out.missing.push_back(
          fmt::format("images in {} gaps of up to {:.3g} s, where others are "
                      "{:.3g} s apart: frames across a gap share less road",
                      gaps, steps.back(), usual));
    }
  }
  out.found.push_back(phrase);
}

/// The file that an image is written to, as bytes.
std::string image_file(const Topic& topic, const RosBytes& bytes, const PinholeCamera& camera) {
  const auto check = [&](int width, int height) {
    if (width == camera.width && height == camera.height) return;
    throw InputError(bytes.file, bytes.position,
                     fmt::format("found an image of {} x {} pixels, expected {} x {} as of the "
                                 "first",
                                 width, height, camera.width, camera.height));
  };
  const auto encoded = [&](const std::string& encoding, std::size_t step, const std::uint8_t* data,
                           bool big_endian) {
    const auto decoded =
        decode_raw_pixels({camera.width, camera.height, encoding, step, data, big_endian});
    if (!decoded) {
      throw InputError(bytes.file, bytes.position,
                       fmt::format("found the encoding \"{}\" with {} bytes a row, expected {}",
                                   printable(encoding), step, raw_pixel_encodings()));
    }
    return encode_png(*decoded);
  };
  if (topic.type == kImage) {
    const RosImage image = read_ros_image(bytes);
    check(static_cast<int>(image.width), static_cast<int>(image.height));
    return encoded(image.encoding, image.step, image.data, image.big_endian);
  }
  const RosCompressedImage image = read_ros_compressed_image(bytes);
  std::string content = file_of(image);
  const ImageInfo info = read_image_info(content, name_of(bytes));
  check(info.width, info.height);
  // Decoded to see that it is whole; kept as it is unless it is a mosaic.
  const Image decoded = decode_color_image(content, name_of(bytes));
  const std::string mosaic = mosaic_of(image, info);
  if (mosaic.empty()) return content;
  return encoded(mosaic, static_cast<std::size_t>(info.width), to_grey(decoded).data.data(), false);
}

/// The frame that a topic's images state; may be empty.
std::string camera_frame(const Bag& bag, const Topic& topic) {
  std::string out;
  bag.read(topic, [&](int, const BagMessage&, const RosBytes& bytes) {
    out = topic.type == kImage ? read_ros_image(bytes).stamp.frame
                               : read_ros_compressed_image(bytes).stamp.frame;
    return false;
  });
  return out;
}

/// The options with what the recording has: positions, and the camera's height.
OwnDataOptions with_recorded(const Bag& bag, const BagChoice& choice, const TransformTree& frames,
                             const std::string& camera, const OwnDataOptions& options,
                             OwnImport& out) {
  OwnDataOptions all = options;
  if (options.gnss.file.empty() && options.gnss.projection) {
    const auto topic = bag.motion_topic("sensor_msgs/NavSatFix", choice.fix_topic, "positions",
                                        "--fix-topic", out);
    if (topic) {
      std::vector<GeoPoint> points = read_fixes(bag.reader(), *topic, bag.name());
      std::stable_sort(points.begin(), points.end(),
                       [](const GeoPoint& l, const GeoPoint& r) { return l.time_s < r.time_s; });
      constexpr double kLongestGap = 3.0;  // s, as of other logs
      const std::vector<SceneFrame>& all_frames = out.scene.frames;
      const bool of_frames =
          std::any_of(all_frames.begin(), all_frames.end(), [&](const SceneFrame& frame) {
            return place_in(points, *frame.time_s, kLongestGap).has_value();
          });
      if (!of_frames) {
        out.missing.push_back(fmt::format("positions: those of {} have no {}",
                                          printable(topic->name, 80),
                                          points.empty() ? "fix" : "times of the frames"));
      } else {
        all.gnss.points = std::move(points);
        all.gnss.form = "NavSatFix of " + printable(topic->name, 80);
        all.gnss.file = bag.name();
      }
    }
  }
  if (!options.height) {
    all.height = height_over_footprint(frames, camera);
    if (all.height) {
      out.found.emplace_back("the camera's height is that above base_footprint by /tf_static");
    }
  }
  return all;
}

/// Gravity and speeds of the recording, where no files give them.
void put_recorded(const Bag& bag, const BagChoice& choice, const TransformTree& frames,
                  const std::string& camera, const OwnDataOptions& options, OwnImport& out) {
  if (options.up.empty()) {
    const auto topic =
        bag.motion_topic("sensor_msgs/Imu", choice.imu_topic, "gravity", "--imu-topic", out);
    if (topic) {
      put_recorded_up(bag.reader(), *topic, bag.name(), frames, camera, options.up_sigma, out);
    }
  }
  if (options.speed.empty()) {
    const auto topic = bag.motion_topic("nav_msgs/Odometry", choice.odometry_topic, "speeds",
                                        "--odometry-topic", out);
    if (topic) put_recorded_speeds(bag.reader(), *topic, bag.name(), out);
  }
}

/// "/cam/image_rect_color", by ROS's convention.
bool is_rectified(const Topic& topic) {
  return topic.name.find("/image_rect") != std::string::npos;
}

void put_bag_camera(const Bag& bag, const Topic& images, const BagChoice& choice,
                    const OwnCamera& options, OwnImport& out) {
  if (!options.calibration.empty() || options.fx || options.fov_deg) {
    put_camera(out.scene, options, out);
    return;
  }
  const std::optional<Topic> topic = bag.info_topic(images, choice.info_topic);
  if (!topic) {
    throw InputError(bag.name(), fmt::format("found no CameraInfo of {}, expected one, or --calib "
                                             "FILE, or --fx --fy --cx --cy, or --fov",
                                             printable(images.name, 80)));
  }
  CameraCalibration camera;
  bag.read(*topic, [&](int, const BagMessage&, const RosBytes& bytes) {
    camera = read_ros_camera_info(bytes);
    return false;
  });
  camera.name = topic->name;
  const bool by_name = is_rectified(images) && camera.projection[0] > 0.0;
  if (by_name && !options.rectified) {
    out.found.emplace_back("rectified images by their topic's name: CameraInfo's P is taken");
  }
  put_calibration(out.scene, camera, "CameraInfo", options.rectified || by_name, bag.name(), out);
}

}  // namespace

OwnImport import_rosbag(const std::shared_ptr<BagReader>& reader, const fs::path& file,
                        const BagChoice& choice, const OwnDataOptions& options,
                        const fs::path& manifest) {
  options.validate();
  choice.frames.validate();
  const Bag bag(reader, file);
  const Topic topic = bag.image_topic(choice.topic);
  OwnImport out;
  out.ids_of_recording = true;
  Scene& scene = out.scene;
  const Entries entries = list_images(bag, topic, out);
  describe(entries, topic, out);
  scene.name = options.name.empty() ? file.stem().string() : options.name;
  const fs::path folder =
      (manifest.has_parent_path() ? manifest.parent_path() : fs::path(".")) / "image";
  const VideoChoice& part = choice.frames;
  int in_part = 0;
  for (std::size_t i = 0; i < entries.all.size(); ++i) {
    const Entry& entry = entries.all[i];
    const double since = seconds_since(entries, entry);
    if ((part.from && since < *part.from) || (part.to && since > *part.to)) continue;
    if (in_part++ % part.every != 0) continue;
    SceneFrame frame;
    frame.id = static_cast<int>(i);
    frame.time_s = 1e-9 * static_cast<double>(entry.ns);
    frame.image = folder / fmt::format("{:06}.{}", i, entry.jpeg ? "jpg" : "png");
    scene.frames.push_back(std::move(frame));
  }
  if (scene.frames.empty()) {
    throw InputError(
        bag.name(),
        fmt::format("found images from 0 to {:.3f} s, expected some in the part that was asked for",
                    seconds_since(entries, entries.all.back())));
  }
  scene.camera.width = entries.width;
  scene.camera.height = entries.height;
  put_bag_camera(bag, topic, choice, options.camera, out);
  const TransformTree frames = read_transforms(bag.reader(), bag.name(), false);
  const std::string camera = camera_frame(bag, topic);
  put_recorded(bag, choice, frames, camera, options, out);
  finish_import(with_recorded(bag, choice, frames, camera, options, out), out);

  std::vector<std::pair<int, fs::path>> wanted;  // message, file
  for (const SceneFrame& frame : scene.frames) {
    wanted.emplace_back(entries.all[static_cast<std::size_t>(frame.id)].message, frame.image);
  }
  std::sort(wanted.begin(), wanted.end());
  out.write_images = [bag, topic, wanted, camera = file_camera(scene)](const ImageSink& write) {
    auto next = wanted.begin();
    bag.read(topic, [&](int number, const BagMessage&, const RosBytes& bytes) {
      if (next != wanted.end() && number == next->first) {
        write(next->second, image_file(topic, bytes, camera));
        ++next;
      }
      return next != wanted.end();
    });
  };
  out.found.push_back(
      fmt::format("{} images written to {}", scene.frames.size(), printable(folder.string(), 120)));
  return out;
}

}  // namespace camber
