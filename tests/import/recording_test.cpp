// Recordings of rosbag2 and MCAP: topics, messages and what they hold.

#include "camber/import/recording.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/image/raw_pixels.h"
#include "camber/import/formats/ros_messages.h"
#include "camber/import/import_rosbag.h"
#include "camber/import/ros_cloud.h"
#include "camber/import/transform_tree.h"
#include "import/sha256.h"
#include "support/test_data.h"

namespace camber {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::HasSubstr;

std::vector<std::string> messages_of(BagReader& bag, const std::string& topic,
                                     std::vector<std::int64_t>* times = nullptr) {
  std::vector<std::string> out;
  bag.read(topic, [&](const BagMessage& message) {
    out.emplace_back(reinterpret_cast<const char*>(message.data), message.size);
    if (times != nullptr) times->push_back(message.recorded_ns);
    return true;
  });
  return out;
}

RosBytes bytes_of(const std::string& message) {
  return {reinterpret_cast<const std::uint8_t*>(message.data()), message.size(), "bag", "message",
          true};
}

void expect_numbers(const json& expected, const std::vector<double>& found) {
  ASSERT_EQ(expected.size(), found.size());
  for (std::size_t i = 0; i < found.size(); ++i)
    EXPECT_EQ(expected[i].get<double>(), found[i]) << i;
}

std::vector<double> of(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
std::vector<double> of(const Eigen::Quaterniond& q) { return {q.x(), q.y(), q.z(), q.w()}; }

std::string pixels_without_padding(const RosImage& image) {
  const auto decoded =
      decode_raw_pixels({static_cast<int>(image.width), static_cast<int>(image.height),
                         image.encoding, image.step, image.data, image.big_endian});
  if (!decoded) return {};
  return {reinterpret_cast<const char*>(decoded->data.data()), decoded->data.size()};
}

/// What expected.json has of the first and last message of a topic.
void expect_message(const std::string& type, const json& right, const std::string& message) {
  const RosBytes bytes = bytes_of(message);
  if (type == "sensor_msgs/Image") {
    const RosImage image = read_ros_image(bytes);
    EXPECT_EQ(image.stamp.ns, right.at("stamp"));
    EXPECT_EQ(image.stamp.frame, right.at("frame_id"));
    EXPECT_EQ(image.width, right.at("width"));
    EXPECT_EQ(image.height, right.at("height"));
    EXPECT_EQ(image.encoding, right.at("encoding"));
    EXPECT_EQ(image.step, right.at("step"));
    EXPECT_EQ(image.big_endian, right.at("is_bigendian") != 0);
    const std::string data(reinterpret_cast<const char*>(image.data), image.size);
    EXPECT_EQ(test::sha256(data), right.at("sha256_data"));
    // Bayer patterns are interpolated, uyvy converted, 16 bits become 8.
    const bool exact = image.encoding.find("8") != std::string::npos &&
                       image.encoding.rfind("bayer", 0) != 0 && right.contains("sha256_decoded");
    if (exact) {
      EXPECT_EQ(test::sha256(pixels_without_padding(image)), right.at("sha256_decoded"));
    } else {
      EXPECT_FALSE(pixels_without_padding(image).empty()) << image.encoding;
    }
  } else if (type == "sensor_msgs/CompressedImage") {
    const RosCompressedImage image = read_ros_compressed_image(bytes);
    EXPECT_EQ(image.stamp.ns, right.at("stamp"));
    EXPECT_EQ(image.format, right.at("format"));
    const std::string data(reinterpret_cast<const char*>(image.data), image.size);
    EXPECT_EQ(test::sha256(data), right.at("sha256_data"));
  } else if (type == "sensor_msgs/CameraInfo") {
    const CameraCalibration camera = read_ros_camera_info(bytes);
    EXPECT_EQ(camera.fx, right.at("k")[0]);
    EXPECT_EQ(camera.cx, right.at("k")[2]);
    EXPECT_EQ(camera.fy, right.at("k")[4]);
    EXPECT_EQ(camera.cy, right.at("k")[5]);
    EXPECT_EQ(camera.width, right.at("width"));
    expect_numbers(right.at("d"), camera.coefficients);
    expect_numbers(right.at("p"), camera.projection);
  } else if (type == "sensor_msgs/NavSatFix") {
    const RosFix fix = read_ros_fix(bytes);
    EXPECT_EQ(fix.stamp.ns, right.at("stamp"));
    EXPECT_EQ(fix.status, right.at("status"));
    EXPECT_EQ(fix.latitude, right.at("latitude"));
    EXPECT_EQ(fix.longitude, right.at("longitude"));
    EXPECT_EQ(fix.altitude, right.at("altitude"));
    EXPECT_EQ(fix.covariance_type, right.at("covariance_type"));
    expect_numbers(right.at("covariance_diagonal"),
                   {fix.covariance[0], fix.covariance[4], fix.covariance[8]});
  } else if (type == "sensor_msgs/Imu") {
    const RosImu imu = read_ros_imu(bytes);
    EXPECT_EQ(imu.stamp.frame, right.at("frame_id"));
    expect_numbers(right.at("orientation_xyzw"), of(imu.orientation));
    expect_numbers(right.at("angular_velocity"), of(imu.angular_velocity));
    expect_numbers(right.at("linear_acceleration"), of(imu.linear_acceleration));
  } else if (type == "nav_msgs/Odometry") {
    const RosOdometry odometry = read_ros_odometry(bytes);
    EXPECT_EQ(odometry.child, right.at("child_frame_id"));
    expect_numbers(right.at("position"), of(odometry.pose.translation()));
    expect_numbers(right.at("linear"), of(odometry.linear_velocity));
  } else if (type == "tf2_msgs/TFMessage") {
    const std::vector<RosTransform> transforms = read_ros_transforms(bytes);
    ASSERT_EQ(transforms.size(), right.at("transforms").size());
    for (std::size_t i = 0; i < transforms.size(); ++i) {
      const json& one = right.at("transforms")[i];
      EXPECT_EQ(transforms[i].stamp.ns, one.at("stamp"));
      EXPECT_EQ(transforms[i].stamp.frame, one.at("parent"));
      EXPECT_EQ(transforms[i].child, one.at("child"));
      expect_numbers(one.at("translation"), of(transforms[i].parent_from_child.translation()));
    }
  } else if (type == "sensor_msgs/PointCloud2") {
    const RosPointCloud cloud = read_ros_point_cloud(bytes);
    EXPECT_EQ(cloud.width, right.at("width"));
    EXPECT_EQ(cloud.point_step, right.at("point_step"));
    ASSERT_EQ(cloud.fields.size(), right.at("fields").size());
    for (std::size_t f = 0; f < cloud.fields.size(); ++f) {
      EXPECT_EQ(cloud.fields[f].name, right.at("fields")[f][0]);
      EXPECT_EQ(cloud.fields[f].offset, right.at("fields")[f][1]);
      EXPECT_EQ(cloud.fields[f].type, right.at("fields")[f][2]);
    }
    if (!right.contains("finite_points") || right.at("finite_points") == 0) return;
    const auto source = make_ros_cloud_source(bytes, cloud);
    PointBatch batch;
    ASSERT_TRUE(source->next(batch));
    std::size_t finite = 0;
    std::array<double, 3> low{1e9, 1e9, 1e9}, high{-1e9, -1e9, -1e9};
    for (std::size_t i = 0; i < batch.count; ++i) {
      std::array<double, 3> x{};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        x[axis] = batch.fields[axis].number(source->header().fields[axis].type, i);
      }
      if (!std::isfinite(x[0] + x[1] + x[2])) continue;
      ++finite;
      for (std::size_t axis = 0; axis < 3; ++axis) {
        low[axis] = std::min(low[axis], x[axis]);
        high[axis] = std::max(high[axis], x[axis]);
      }
    }
    EXPECT_EQ(finite, right.at("finite_points"));
    expect_numbers(right.at("min"), {low.begin(), low.end()});
    expect_numbers(right.at("max"), {high.begin(), high.end()});
  }
}

TEST(Recording, FilesOfOtherProgramsGiveTheirMessages) {
  CAMBER_REQUIRE_DATA("survey-files/expected.json");
  const fs::path root = test::data_dir() / "survey-files";
  const json expected = json::parse(test::read_text(root / "expected.json")).at("rosbag2");
  std::size_t compared = 0, refused = 0;
  for (const auto& [name, file] : expected.items()) {
    SCOPED_TRACE(name);
    EXPECT_TRUE(is_recording(root / name));
    if (file.contains("expect")) {
      ++refused;
      try {
        open_recording(root / name);
        ADD_FAILURE() << "no error";
      } catch (const InputError& error) {
        EXPECT_EQ(error.exit_code(), 2);
        if (name.find("chunk") != std::string::npos) {
          EXPECT_THAT(error.what(), HasSubstr("chunk "));
        }
      }
      continue;
    }
    const auto before =
        fs::is_directory(root / name) ? std::distance(fs::directory_iterator(root / name), {}) : 0;
    const std::unique_ptr<BagReader> bag = open_recording(root / name);
    std::map<std::string, BagReader::Topic> topics;
    for (const BagReader::Topic& topic : bag->topics()) topics[topic.name] = topic;
    ASSERT_EQ(topics.size(), file.at("topics").size());
    for (const json& right : file.at("topics")) {
      const std::string topic_name = right.at("topic");
      SCOPED_TRACE(topic_name);
      ASSERT_EQ(topics.count(topic_name), 1u);
      const BagReader::Topic& topic = topics[topic_name];
      EXPECT_EQ(topic.type, short_message_type(right.at("type")));
      EXPECT_EQ(topic.messages, right.at("messages"));
      EXPECT_TRUE(topic.cdr);
      if (topic.messages == 0) continue;
      std::vector<std::int64_t> times;
      const std::vector<std::string> messages = messages_of(*bag, topic_name, &times);
      ASSERT_EQ(messages.size(), topic.messages);
      EXPECT_EQ(*std::min_element(times.begin(), times.end()), right.at("first_log_time"));
      EXPECT_EQ(*std::max_element(times.begin(), times.end()), right.at("last_log_time"));
      std::string all;
      for (const std::string& message : messages) all += message;
      EXPECT_EQ(test::sha256(all), right.at("sha256_all_cdr_in_file_order"));
      ++compared;
      // Images of a few bytes that state 1920 a row, and the like.
      if (name.find("geocam") != std::string::npos) continue;
      // The first and last of the file are those by stamp, too, but where two are out of order.
      if (right.contains("first") && messages.size() < 3) {
        expect_message(topic.type, right.at("first"), messages.front());
        if (right.contains("last")) expect_message(topic.type, right.at("last"), messages.back());
      } else if (right.contains("first") && times.front() == right.at("first_log_time")) {
        expect_message(topic.type, right.at("first"), messages.front());
      }
    }
    if (fs::is_directory(root / name)) {
      EXPECT_EQ(before, std::distance(fs::directory_iterator(root / name), {}));
    }
  }
  EXPECT_GT(compared, 140u);
  EXPECT_EQ(refused, 3u);
}

TEST(Recording, CutsAndFlippedBitsAreErrors) {
  CAMBER_REQUIRE_DATA("survey-files/rosbag2/array_msgs_0.mcap");
  const std::string whole =
      test::read_text(test::data_dir() / "survey-files/rosbag2/array_msgs_0.mcap");
  const auto open = [](const std::string& bytes) {
    const auto bag = open_mcap(bytes.data(), bytes.size(), "a.mcap");
    for (const BagReader::Topic& topic : bag->topics()) messages_of(*bag, topic.name);
    return bag->topics().size();
  };
  ASSERT_EQ(open(whole), 2u);
  std::size_t refused = 0;
  for (std::size_t length = 0; length < whole.size(); ++length) {
    const std::string cut = whole.substr(0, length);
    try {
      open(cut);  // behind the end of the data only the summary is missing
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, whole.size() / 2);
  for (std::size_t byte = 0; byte < whole.size(); byte += 3) {
    std::string damaged = whole;
    damaged[byte] = static_cast<char>(damaged[byte] ^ (1 << (byte % 8)));
    try {
      open(damaged);
    } catch (const InputError&) {
    }
  }
}

TEST(CdrMessages, InBothByteOrdersAndBothAlignments) {
  // A fix by hand: header of a frame of 4 letters, so that doubles begin behind padding.
  const auto fix = [](bool little, bool xcdr2) {
    std::string out = {0, static_cast<char>((xcdr2 ? 6 : 0) + (little ? 1 : 0)), 0, 0};
    const auto put = [&](auto value) {
      const std::size_t step = std::min<std::size_t>(sizeof value, xcdr2 ? 4 : 8);
      while ((out.size() - 4) % step != 0) out += '\0';
      std::string bytes(reinterpret_cast<const char*>(&value), sizeof value);
      if (!little) std::reverse(bytes.begin(), bytes.end());
      out += bytes;
    };
    put(std::int32_t{1600000000});
    put(std::uint32_t{5});
    put(std::uint32_t{5});
    out += std::string("gnss\0", 5);
    put(std::int8_t{2});
    put(std::uint16_t{1});
    put(49.5);
    put(8.25);
    put(112.0);
    for (int i = 0; i < 9; ++i) put(i % 4 == 0 ? 0.25 : 0.0);
    put(std::uint8_t{2});
    return out;
  };
  for (const bool little : {true, false}) {
    for (const bool xcdr2 : {true, false}) {
      const std::string message = fix(little, xcdr2);
      const RosFix found = read_ros_fix(bytes_of(message));
      EXPECT_EQ(found.stamp.ns, 1600000000000000005);
      EXPECT_EQ(found.stamp.frame, "gnss");
      EXPECT_EQ(found.status, 2);
      EXPECT_EQ(found.latitude, 49.5);
      EXPECT_EQ(found.longitude, 8.25);
      EXPECT_EQ(found.covariance[8], 0.25);
      for (std::size_t length = 0; length < message.size(); ++length) {
        const std::string cut = message.substr(0, length);
        EXPECT_THROW(read_ros_fix(bytes_of(cut)), InputError) << length;
      }
    }
  }
  std::string other = fix(true, false);
  other[1] = 3;  // a parameter list
  EXPECT_THROW(read_ros_fix(bytes_of(other)), InputError);
}

TEST(TransformTree, JoinsFixedAndMovingFrames) {
  const auto transform = [](const char* parent, const char* child, double x, double turn,
                            std::int64_t ns = 0) {
    RosTransform out;
    out.stamp.frame = parent;
    out.stamp.ns = ns;
    out.child = child;
    out.parent_from_child =
        SE3(Eigen::Quaterniond(Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ())),
            Eigen::Vector3d(x, 0, 0));
    return out;
  };
  TransformTree tree;
  tree.add_fixed(transform("base", "lidar", 1.0, 0.0));
  tree.add_fixed(transform("/base", "/camera", 2.0, M_PI / 2));
  tree.add_moving(transform("odom", "base", 10.0, 0.0, 1000));
  tree.add_moving(transform("odom", "base", 20.0, 0.2, 2000));
  const auto middle = tree.in_root("lidar", 1500);
  ASSERT_TRUE(middle);
  EXPECT_EQ(middle->root, "odom");
  EXPECT_NEAR(middle->root_from_frame.translation().x(), 15.0 + std::cos(0.1), 1e-12);
  EXPECT_NEAR(middle->root_from_frame.translation().y(), std::sin(0.1), 1e-12);
  EXPECT_FALSE(tree.in_root("lidar", 999));
  EXPECT_FALSE(tree.in_root("lidar", 2001));
  EXPECT_EQ(tree.in_root("elsewhere", 0)->root, "elsewhere");
  // x of the camera is y of the base.
  const auto lidar_from_camera = tree.fixed_between("lidar", "camera");
  ASSERT_TRUE(lidar_from_camera);
  EXPECT_NEAR(((*lidar_from_camera) * Eigen::Vector3d(3, 0, 0) - Eigen::Vector3d(1, 3, 0)).norm(),
              0.0, 1e-12);
  EXPECT_FALSE(tree.fixed_between("odom", "camera"));
  tree.add_fixed(transform("camera", "base", 0.0, 0.0));  // a circle
  TransformTree circle;
  circle.add_fixed(transform("a", "b", 0.0, 0.0));
  circle.add_fixed(transform("b", "a", 0.0, 0.0));
  EXPECT_FALSE(circle.in_root("a", 0));
}

/// Writes CDR, little-endian.
class Cdr {
 public:
  template <typename T>
  Cdr& put(T value) {
    while ((bytes_.size() - 4) % sizeof(T) != 0) bytes_ += '\0';
    bytes_.append(reinterpret_cast<const char*>(&value), sizeof value);
    return *this;
  }
  Cdr& text(const std::string& value) {
    put(static_cast<std::uint32_t>(value.size() + 1));
    bytes_ += value + '\0';
    return *this;
  }
  Cdr& header(double seconds, const std::string& frame) {
    const double whole = std::floor(seconds);
    put(static_cast<std::int32_t>(whole));
    put(static_cast<std::uint32_t>(std::lround((seconds - whole) * 1e9)));
    return text(frame);
  }
  Cdr& numbers(const std::vector<double>& values) {
    for (const double value : values) put(value);
    return *this;
  }
  Cdr& raw(const std::string& bytes) {
    bytes_ += bytes;
    return *this;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_{0, 1, 0, 0};
};

class MadeBag : public BagReader {
 public:
  void add(const std::string& topic, const std::string& type, const std::string& message) {
    if (messages_[topic].empty()) {
      Topic added;
      added.name = topic;
      added.type = type;
      added.cdr = true;
      topics_.push_back(added);
    }
    messages_[topic].push_back(message);
    for (Topic& one : topics_) one.messages = messages_[one.name].size();
  }
  const std::vector<Topic>& topics() const override { return topics_; }
  void read(const std::string& topic, const std::function<bool(const BagMessage&)>& take) override {
    for (const std::string& message : messages_[topic]) {
      if (!take({reinterpret_cast<const std::uint8_t*>(message.data()), message.size(), 1})) return;
    }
  }

 private:
  std::vector<Topic> topics_;
  std::map<std::string, std::vector<std::string>> messages_;
};

/// Four images, fixes, an IMU that is pitched by 0.1 rad against a level camera, odometry.
std::shared_ptr<MadeBag> made_drive() {
  auto bag = std::make_shared<MadeBag>();
  const double start = 1600000000.0;
  for (int i = 0; i < 4; ++i) {
    Cdr image;
    image.header(start + 0.25 * i, "camera_optical").put(std::uint32_t{48}).put(std::uint32_t{64});
    image.text("mono8").put(std::uint8_t{0}).put(std::uint32_t{64});
    image.put(std::uint32_t{64 * 48}).raw(std::string(64 * 48, 'g'));
    bag->add("/cam/image_raw", "sensor_msgs/Image", image.bytes());
  }
  std::vector<double> covariance(9, 0.0);
  covariance[0] = covariance[4] = 0.04;
  for (int i = -1; i < 5; ++i) {
    const double time = start + 0.3 * i;
    Cdr fix;
    fix.header(time, "gnss").put(std::int8_t{2}).put(std::uint16_t{1});
    fix.numbers({49.0 + 1e-5 * i, 8.0, 100.0}).numbers(covariance).put(std::uint8_t{2});
    bag->add("/fix", "sensor_msgs/NavSatFix", fix.bytes());
    Cdr imu;
    // The vehicle climbs: its x axis points up by 0.1 rad.
    imu.header(time, "imu").numbers({0.0, -std::sin(0.05), 0.0, std::cos(0.05)});
    imu.numbers(std::vector<double>(9, 0.01)).numbers({0, 0, 0});
    imu.numbers(std::vector<double>(9, 0.01)).numbers({0, 0, 9.8});
    imu.numbers(std::vector<double>(9, 0.01));
    bag->add("/imu", "sensor_msgs/Imu", imu.bytes());
    Cdr odometry;
    odometry.header(time, "odom").text("base_link").numbers({0, 0, 0, 0, 0, 0, 1});
    odometry.numbers(std::vector<double>(36, 0.0)).numbers({12.0, 5.0, 0.0, 0, 0, 0});
    odometry.numbers(std::vector<double>(36, 0.0));
    bag->add("/odom", "nav_msgs/Odometry", odometry.bytes());
  }
  const auto add_transform = [](Cdr& out, const char* parent, const char* child,
                                const std::vector<double>& pose) {
    out.header(0.0, parent).text(child).numbers(pose);
  };
  Cdr tf;
  tf.put(std::uint32_t{3});
  add_transform(tf, "base_footprint", "base_link", {0, 0, 0.3, 0, 0, 0, 1});
  add_transform(tf, "base_link", "imu", {0.5, 0, 0, 0, 0, 0, 1});
  // x right, y down, z forward.
  add_transform(tf, "base_link", "camera_optical", {1.5, 0, 1.1, -0.5, 0.5, -0.5, 0.5});
  bag->add("/tf_static", "tf2_msgs/TFMessage", tf.bytes());
  return bag;
}

OwnImport import_made(const std::shared_ptr<MadeBag>& bag, const BagChoice& choice = {}) {
  OwnDataOptions options;
  options.camera.fx = 50.0;
  options.gnss.projection = [](const std::string&, const std::vector<GeoPoint>& points) {
    std::vector<MapPlace> out;
    for (const GeoPoint& point : points)
      out.push_back({1e5 * point.longitude, 1e5 * point.latitude});
    return out;
  };
  const test::TemporaryFolder folder;
  return import_rosbag(bag, "drive.mcap", choice, options, folder.path() / "scene.json");
}

TEST(ImportRecording, TakesPositionsGravitySpeedsAndTheHeight) {
  const OwnImport made = import_made(made_drive());
  const Scene& scene = made.scene;
  ASSERT_EQ(scene.frames.size(), 4u);
  ASSERT_TRUE(scene.height_above_road);
  EXPECT_NEAR(*scene.height_above_road, 1.4, 1e-12);
  for (std::size_t i = 0; i < 4; ++i) {
    const SceneFrame& frame = scene.frames[i];
    ASSERT_TRUE(frame.map_position);
    const double steps = 0.25 * static_cast<double>(i) / 0.3;
    EXPECT_NEAR(frame.map_position->position.y(), 4900000.0 + steps, 1e-5);  // times in doubles
    EXPECT_NEAR(frame.map_position->sigma, 0.2, 1e-12);
    ASSERT_TRUE(frame.speed);
    EXPECT_NEAR(*frame.speed, 13.0, 1e-12);
    ASSERT_TRUE(frame.up);
    // The camera looks up by 0.1 rad: up is tilted towards its back.
    EXPECT_NEAR((*frame.up - Eigen::Vector3d(0.0, -std::cos(0.1), std::sin(0.1))).norm(), 0.0,
                1e-9);
  }
}

TEST(ImportRecording, LeavesOutWhatIsNotWantedAndNamesWhatCannotBe) {
  BagChoice none;
  none.fix_topic = none.imu_topic = none.odometry_topic = "none";
  const OwnImport plain = import_made(made_drive(), none);
  for (const SceneFrame& frame : plain.scene.frames) {
    EXPECT_FALSE(frame.map_position || frame.speed || frame.up);
  }
  const auto two = made_drive();
  two->add("/fix2", "sensor_msgs/NavSatFix", std::string());
  const OwnImport ambiguous = import_made(two);
  EXPECT_THAT(ambiguous.missing, ::testing::Contains(HasSubstr("--fix-topic chooses one")));
  EXPECT_FALSE(ambiguous.scene.frames[0].map_position);
  BagChoice first;
  first.fix_topic = "/fix";
  EXPECT_TRUE(import_made(two, first).scene.frames[0].map_position);
  first.fix_topic = "/other";
  EXPECT_THROW(import_made(two, first), InputError);
}

TEST(ImportRecording, OfARealFileWithoutRos) {
  CAMBER_REQUIRE_DATA("survey-files/rosbag2/made_zstd.mcap");
  const fs::path file = test::data_dir() / "survey-files/rosbag2/made_zstd.mcap";
  BagChoice choice;
  choice.topic = "/camera/front/image_raw";
  OwnDataOptions options;
  options.gnss.projection = [](const std::string&, const std::vector<GeoPoint>& points) {
    return std::vector<MapPlace>(points.size());
  };
  const test::TemporaryFolder folder;
  const OwnImport made =
      import_rosbag(open_recording(file), file, choice, options, folder.path() / "scene.json");
  ASSERT_EQ(made.scene.frames.size(), 6u);
  EXPECT_NEAR(*made.scene.frames[1].time_s, 1700000000.1, 1e-6);
  EXPECT_NEAR(*made.scene.frames[1].speed, 13.0, 1e-9);
  EXPECT_TRUE(made.scene.frames[1].map_position);
  EXPECT_FALSE(made.scene.frames[1].up);  // nothing joins the frames of the IMU and the camera
  EXPECT_EQ(made.scene.distortion.raw.fx, 57.6);
  std::size_t written = 0;
  made.write_images([&](const fs::path&, const std::string& bytes) {
    ++written;
    EXPECT_EQ(bytes.substr(1, 3), "PNG");
  });
  EXPECT_EQ(written, 6u);
}

}  // namespace
}  // namespace camber
