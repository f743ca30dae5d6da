#include "camber/import/detail/recorded_motion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/read_file.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/detail/samples_in_time.h"
#include "camber/import/formats/ros_messages.h"
#include "camber/scene/camera_up.h"
#include "camber/scene/scene.h"

namespace camber {
namespace {

using Topic = BagReader::Topic;

double seconds(std::int64_t ns) { return 1e-9 * static_cast<double>(ns); }

/// Hands out the messages of a topic. A time of 0 in a header is replaced by that of recording.
template <typename Take>
void each_message(BagReader& bag, const Topic& topic, const std::string& file, Take&& take) {
  int number = 0;
  bag.read(topic.name, [&](const BagMessage& message) {
    throw_if_interrupted();
    const RosBytes bytes{message.data, message.size, file,
                         fmt::format("message {} of {}", number++, printable(topic.name, 80)),
                         topic.cdr};
    take(bytes, message.recorded_ns);
    return true;
  });
}

template <typename Sample>
void sort_by_time(std::vector<Sample>& samples) {
  std::stable_sort(samples.begin(), samples.end(),
                   [](const Sample& a, const Sample& b) { return a.time_s < b.time_s; });
}

struct UpSample {
  double time_s = 0.0;
  Eigen::Vector3d up;  // in the camera
};

}  // namespace

TransformTree read_transforms(BagReader& bag, const std::string& file, bool moving) {
  TransformTree out;
  for (const Topic& topic : bag.topics()) {
    const bool is_tf = topic.type == "tf2_msgs/TFMessage" || topic.type == "tf/tfMessage";
    if (!is_tf || topic.messages == 0) continue;
    const std::string ending = "tf_static";
    const bool fixed =
        topic.name.size() >= ending.size() &&
        topic.name.compare(topic.name.size() - ending.size(), ending.size(), ending) == 0;
    if (!fixed && !moving) continue;
    each_message(bag, topic, file, [&](const RosBytes& bytes, std::int64_t) {
      for (const RosTransform& transform : read_ros_transforms(bytes)) {
        if (fixed) {
          out.add_fixed(transform);
        } else {
          out.add_moving(transform);
        }
      }
    });
  }
  return out;
}

std::vector<GeoPoint> read_fixes(BagReader& bag, const Topic& topic, const std::string& file) {
  std::vector<GeoPoint> out;
  each_message(bag, topic, file, [&](const RosBytes& bytes, std::int64_t recorded) {
    const RosFix fix = read_ros_fix(bytes);
    const bool good =
        fix.status >= 0 && std::abs(fix.latitude) <= 90.0 && std::abs(fix.longitude) <= 180.0;
    if (!good) return;
    GeoPoint point;
    point.latitude = fix.latitude;
    point.longitude = fix.longitude;
    point.altitude = fix.altitude;
    point.time_s = seconds(fix.stamp.ns != 0 ? fix.stamp.ns : recorded);
    const double variance = 0.5 * (fix.covariance[0] + fix.covariance[4]);
    if (fix.covariance_type > 0 && variance > 0.0 && std::isfinite(variance)) {
      point.sigma = std::sqrt(variance);
    }
    out.push_back(point);
  });
  return out;
}

void put_recorded_up(BagReader& bag, const Topic& topic, const std::string& file,
                     const TransformTree& frames, const std::string& camera, double sigma,
                     OwnImport& out) {
  std::vector<UpSample> samples;
  std::string missing;
  each_message(bag, topic, file, [&](const RosBytes& bytes, std::int64_t recorded) {
    if (!missing.empty()) return;
    const RosImu imu = read_ros_imu(bytes);
    if (!imu.has_orientation) {
      missing = "states no orientation";
      return;
    }
    const auto camera_from_imu = frames.fixed_between(camera, imu.stamp.frame);
    if (!camera_from_imu) {
      missing = fmt::format("no fixed transform joins '{}' with the camera's frame '{}'",
                            printable(imu.stamp.frame, 40), printable(camera, 40));
      return;
    }
    UpSample sample;
    sample.time_s = seconds(imu.stamp.ns != 0 ? imu.stamp.ns : recorded);
    const Eigen::Vector3d up = imu.orientation.normalized().conjugate() * Eigen::Vector3d::UnitZ();
    sample.up = camera_from_imu->rotation() * up;
    if (why_not_up(sample.up) != nullptr) {
      missing = "states an up that points down or forward in the camera";
      return;
    }
    samples.push_back(sample);
  });
  sort_by_time(samples);
  std::size_t count = 0;
  for (SceneFrame& frame : out.scene.frames) {
    if (!missing.empty() || !frame.time_s) continue;
    const auto place = place_in(samples, *frame.time_s, 1.0);
    if (!place) continue;
    const auto& [at, share] = *place;
    const Eigen::Vector3d &a = samples[at].up, &b = samples[share > 0.0 ? at + 1 : at].up;
    frame.up = ((1.0 - share) * a + share * b).normalized();
    frame.up_sigma = sigma;
    ++count;
  }
  const std::string name = printable(topic.name, 80);
  if (count > 0) {
    out.found.push_back(
        fmt::format("gravity in {} of {} frames from {}", count, out.scene.frames.size(), name));
  } else {
    out.missing.push_back(fmt::format("gravity: the IMU of {} {}", name,
                                      missing.empty() ? "has no times of the frames" : missing));
  }
}

void put_recorded_speeds(BagReader& bag, const Topic& topic, const std::string& file,
                         OwnImport& out) {
  std::vector<SpeedSample> samples;
  each_message(bag, topic, file, [&](const RosBytes& bytes, std::int64_t recorded) {
    const RosOdometry odometry = read_ros_odometry(bytes);
    SpeedSample sample;
    sample.time_s = seconds(odometry.stamp.ns != 0 ? odometry.stamp.ns : recorded);
    sample.speed = odometry.linear_velocity.norm();
    if (!std::isfinite(sample.speed)) return;
    const double variance = odometry.velocity_covariance[0];
    sample.sigma = default_speed_sigma(sample.speed);
    if (variance > 0.0 && std::isfinite(variance)) {
      sample.sigma = std::max(sample.sigma, std::sqrt(variance));
    }
    samples.push_back(sample);
  });
  sort_by_time(samples);
  const std::size_t count = put_speeds(out.scene, samples, 1.0);
  const std::string name = printable(topic.name, 80);
  if (count > 0) {
    out.found.push_back(
        fmt::format("speeds of {} of {} frames from {}", count, out.scene.frames.size(), name));
  } else {
    out.missing.push_back(fmt::format("speeds: those of {} have no times of the frames", name));
  }
}

std::optional<double> height_over_footprint(const TransformTree& frames,
                                            const std::string& camera) {
  const std::string ground = "base_footprint";
  const auto ground_from_camera = frames.fixed_between(ground, camera);
  if (!ground_from_camera || !frames.knows(camera)) return {};
  const double height = ground_from_camera->translation().z();
  if (!(height > 0.0)) return {};
  return height;
}

}  // namespace camber
