#include "camber/drive/run_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/median.h"
#include "camber/pipeline/estimate_window.h"
#include "camber/pipeline/near_parallax.h"

namespace camber {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

using stages::LoadedFrame;
using FramePtr = std::shared_ptr<const LoadedFrame>;

/// The last frames that were read.
class FrameCache {
 public:
  FrameCache(const Scene& scene, const stages::LoadOptions& options) : loader_(scene, options) {}

  FramePtr get(int id) {
    for (const FramePtr& frame : held_) {
      if (frame->frame.id == id) return frame;
    }
    held_.push_back(loader_.load(id));
    if (held_.size() > kHeld) held_.erase(held_.begin());
    return held_.back();
  }

 private:
  static constexpr std::size_t kHeld = 12;
  stages::FrameLoader loader_;
  std::vector<FramePtr> held_;
};

/// Reads a drive frame by frame and measures its windows.
class Measurer {
 public:
  Measurer(const Scene& scene, const std::vector<int>& ids, const DriveOptions& options,
           const ReconstructOptions& window_options, WindowLog* log, Timings* timings,
           const Progress& progress)
      : scene_(scene),
        ids_(ids),
        options_(options),
        window_options_(window_options),
        log_(*log),
        timings_(*timings),
        progress_(progress),
        cache_(scene, window_options.load) {}

  void run() {
    for (std::size_t i = 0; i < ids_.size(); ++i) {
      if (progress_)
        progress_("windows", static_cast<double>(i) / static_cast<double>(ids_.size()));
      throw_if_interrupted();
      const FrameRecord record = i < log_.frames().size() ? log_.frames()[i] : look_at(ids_[i]);
      if (i >= log_.frames().size()) log_.append(record);
      if (record.kind == FrameRecord::Kind::kKey) {
        keys_.push_back(record.frame);
        measure_between(keys_.size() - 2);
        between_.clear();
        const auto side = static_cast<std::size_t>(options_.each_side);
        if (keys_.size() > side) measure(keys_.size() - 1 - side);
      } else if (record.kind == FrameRecord::Kind::kBetween) {
        between_.push_back(record.frame);
      }
      log_.flush();
    }
    const auto side = static_cast<std::size_t>(options_.each_side);
    for (std::size_t k = keys_.size() > side ? keys_.size() - side : 0; k < keys_.size(); ++k) {
      measure(k);
    }
    measure_after_the_last_key();
    log_.flush();
  }

 private:
  FrameRecord look_at(int id) {
    FramePtr frame;
    try {
      const StageTimer timer(timings_, "load");
      frame = cache_.get(id);
    } catch (const InputError& error) {
      return {id, FrameRecord::Kind::kUnreadable, error.what()};
    } catch (const NoAnswerError& error) {
      return {id, FrameRecord::Kind::kUnreadable, error.what()};
    }
    if (last_ && last_->gray.pixels == frame->gray.pixels) {
      return {id, FrameRecord::Kind::kRepeated,
              fmt::format("the picture of frame {}", last_->frame.id)};
    }
    last_ = frame;
    if (keys_.empty()) return {id, FrameRecord::Kind::kKey, ""};
    const StageTimer timer(timings_, "correspondences");
    if (!last_key_ || last_key_->frame.id != keys_.back()) last_key_ = cache_.get(keys_.back());
    const auto parallax = near_parallax(scene_.camera, shrunk(last_key_->gray), shrunk(frame->gray),
                                        kLeastNearMatched);
    const double enough = kEnoughNearParallax * scene_.camera.fx;
    const bool key = !parallax || *parallax >= enough;
    return {id, key ? FrameRecord::Kind::kKey : FrameRecord::Kind::kBetween, ""};
  }

  std::vector<FramePtr> frames_of(const std::vector<int>& ids) {
    const StageTimer timer(timings_, "load");
    std::vector<FramePtr> out;
    for (const int id : ids) out.push_back(cache_.get(id));
    return out;
  }

  /// The window about a key frame.
  void measure(std::size_t key) {
    const int reference = keys_[key];
    if (log_.has_window(reference)) return;
    const auto side = static_cast<std::size_t>(options_.each_side);
    const std::size_t first = key > side ? key - side : 0;
    const std::size_t last = std::min(keys_.size() - 1, key + side);
    if (first == last) return;  // one frame has no motion
    const std::vector<int> ids(keys_.begin() + static_cast<std::ptrdiff_t>(first),
                               keys_.begin() + static_cast<std::ptrdiff_t>(last) + 1);
    log_.append(measure_window(scene_, frames_of(ids), key - first, window_options_,
                               options_.samples, &timings_));
  }

  /// Frames between a key frame and the next.
  void measure_between(std::size_t key) {
    if (keys_.size() < 2) return;
    for (const int id : between_) measure_beside(id, {keys_[key], id, keys_[key + 1]}, 1);
  }

  void measure_after_the_last_key() {
    if (keys_.empty()) return;
    for (const int id : between_) {
      if (keys_.size() > 1) {
        measure_beside(id, {keys_[keys_.size() - 2], keys_.back(), id}, 2);
      } else {
        measure_beside(id, {keys_.back(), id}, 1);
      }
    }
    between_.clear();
  }

  void measure_beside(int id, const std::vector<int>& ids, std::size_t reference) {
    if (log_.has_window(id)) return;
    const bool vehicles = !scene_.find_frame(id)->vehicles.empty();
    const std::vector<FramePtr> frames = frames_of(ids);
    log_.append(vehicles ? measure_window(scene_, frames, reference, window_options_,
                                          options_.samples, &timings_)
                         : measure_motion(scene_, frames, reference, window_options_, &timings_));
  }

  const Scene& scene_;
  const std::vector<int>& ids_;
  const DriveOptions& options_;
  const ReconstructOptions& window_options_;
  WindowLog& log_;
  Timings& timings_;
  const Progress& progress_;
  FrameCache cache_;
  std::vector<int> keys_, between_;
  FramePtr last_, last_key_;
};

/// Camera over the road by one window.
struct OverRoad {
  double height = 0.0, height_sigma = 0.0, pitch = 0.0, roll = 0.0, turn_sigma = 0.0;
};

OverRoad over_road(const UncertainPlane& ego, double scale_sigma) {
  OverRoad out;
  out.height = ego.plane.offset;
  out.height_sigma =
      std::hypot(std::sqrt(std::max(0.0, ego.covariance(2, 2))), scale_sigma * out.height);
  const Eigen::Vector3d& n = ego.plane.normal;
  out.pitch = std::atan2(n.z(), -n.y());  // the optical axis rises against the road
  out.roll = std::atan2(n.x(), -n.y());
  out.turn_sigma = std::sqrt(std::max(ego.covariance(0, 0), ego.covariance(1, 1)));
  return out;
}

CameraMounting mounting_of(const std::vector<DriveWindow>& windows) {
  std::vector<double> height, pitch, roll;
  double common = 0.0;
  for (const DriveWindow& w : windows) {
    if (!w.ego) continue;
    const OverRoad over = over_road(*w.ego, w.scale_sigma);
    height.push_back(over.height);
    pitch.push_back(over.pitch);
    roll.push_back(over.roll);
    common = std::max(common, w.common_scale_sigma);
  }
  CameraMounting out;
  out.windows = static_cast<int>(height.size());
  if (height.empty()) return out;
  const auto middle = [](std::vector<double> values, double* sigma) {
    const double median = upper_median(values);
    for (double& v : values) v = std::abs(v - median);
    *sigma = 1.4826 * upper_median(values);
    return median;
  };
  out.height = middle(height, &out.height_sigma);
  out.pitch = middle(pitch, &out.pitch_sigma);
  out.roll = middle(roll, &out.roll_sigma);
  const double effective = std::sqrt(std::max(1.0, out.windows / 5.0));
  out.height_sigma = std::hypot(out.height_sigma / effective, common * out.height);
  out.pitch_sigma /= effective;
  out.roll_sigma /= effective;
  return out;
}

/// Up in the world: gravity's where frames know it, else the mean of the road's normals.
Eigen::Vector3d up_of(const Scene& scene, const Trajectory& trajectory,
                      const std::vector<DriveWindow>& windows, bool* by_gravity) {
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero(), normals = Eigen::Vector3d::Zero();
  for (const TrajectoryPose& pose : trajectory.poses) {
    const SceneFrame* frame = scene.find_frame(pose.frame);
    if (frame && frame->up) gravity += pose.world_from_camera.rotation() * *frame->up;
  }
  for (const DriveWindow& w : windows) {
    const TrajectoryPose* pose = w.ego ? trajectory.find(w.reference) : nullptr;
    if (pose) normals += pose->world_from_camera.rotation() * w.ego->plane.normal;
  }
  *by_gravity = gravity.norm() > 0.5;
  if (*by_gravity) return gravity.normalized();
  return normals.norm() > 0.5 ? Eigen::Vector3d(normals.normalized()) : Eigen::Vector3d(0, -1, 0);
}

/// The foot of every camera on the road under it, world; where a frame has no road of its own by
/// the one before it.
std::vector<Eigen::Vector3d> feet_of(const Trajectory& trajectory,
                                     const std::map<int, const DriveWindow*>& window_of,
                                     const CameraMounting& mounting) {
  std::vector<Eigen::Vector3d> out;
  Eigen::Vector3d normal(std::sin(mounting.roll), -std::cos(mounting.pitch),
                         std::sin(mounting.pitch));
  normal.normalize();
  const double height = mounting.windows > 0 ? mounting.height : 0.0;
  for (const TrajectoryPose& pose : trajectory.poses) {
    const auto found = window_of.find(pose.frame);
    const Eigen::Vector3d n =
        found != window_of.end() && found->second->ego ? found->second->ego->plane.normal : normal;
    out.push_back(pose.world_from_camera * (-height * n));
  }
  return out;
}

SE3 strip_from_world(const Eigen::Vector3d& up, const std::vector<Eigen::Vector3d>& feet) {
  Eigen::Vector3d ahead = Eigen::Vector3d::UnitZ();
  for (const Eigen::Vector3d& foot : feet) {
    const Eigen::Vector3d way = foot - feet.front();
    if ((way - way.dot(up) * up).norm() > 2.0) {
      ahead = way;
      break;
    }
  }
  Eigen::Matrix3d rows;
  rows.row(2) = up.transpose();
  rows.row(0) = (ahead - ahead.dot(up) * up).normalized().transpose();
  rows.row(1) = up.cross(Eigen::Vector3d(rows.row(0).transpose())).transpose();
  return SE3(rows, Eigen::Vector3d::Zero());
}

double step_time(const std::map<int, double>& times, int from, int to) {
  const auto a = times.find(from), b = times.find(to);
  return a == times.end() || b == times.end() ? 0.0 : b->second - a->second;
}

void put_speeds(const std::map<int, double>& times, double common,
                std::vector<DriveFrame>* frames) {
  for (std::size_t k = 0; k < frames->size(); ++k) {
    DriveFrame& frame = (*frames)[k];
    frame.speed = frame.speed_sigma = kNaN;
    const std::size_t a = k > 0 ? k - 1 : k, b = std::min(k + 1, frames->size() - 1);
    const double span = step_time(times, (*frames)[a].pose.frame, (*frames)[b].pose.frame);
    if (!(span > 0.0)) continue;
    const Eigen::Vector3d from = (*frames)[a].pose.world_from_camera.translation();
    const Eigen::Vector3d here = frame.pose.world_from_camera.translation();
    const Eigen::Vector3d to = (*frames)[b].pose.world_from_camera.translation();
    frame.speed = ((here - from).norm() + (to - here).norm()) / span;
    // Of the step: neighbouring poses differ by what the covariance grows between them.
    const double grown = std::abs((*frames)[b].pose.covariance.bottomRightCorner<3, 3>().trace() -
                                  (*frames)[a].pose.covariance.bottomRightCorner<3, 3>().trace());
    frame.speed_sigma = std::hypot(std::sqrt(grown) / span, common * frame.speed);
  }
}

}  // namespace

void DriveOptions::validate() const {
  window.validate();
  strip.validate();
  if (each_side < 1 || each_side > 4) {
    throw std::invalid_argument(fmt::format("each_side = {}, expected 1 to 4", each_side));
  }
}

DriveResult run_drive(const Scene& scene, const std::vector<int>& frame_ids,
                      const DriveOptions& options, WindowLog* log, const Progress& progress) {
  options.validate();
  if (frame_ids.size() < 2) {
    throw NoAnswerError(
        fmt::format("a drive of {} frame: at least 2 are needed", frame_ids.size()));
  }
  const ReconstructOptions window_options = handed_down(options.window);
  DriveResult out;
  Measurer(scene, frame_ids, options, window_options, log, &out.timings, progress).run();
  if (progress) progress("trajectory", 0.0);

  std::vector<DriveWindow> windows;
  log->for_each_window([&](DriveWindow window) {
    window.road.clear();
    window.road.shrink_to_fit();
    windows.push_back(std::move(window));
  });
  std::sort(windows.begin(), windows.end(),
            [](const DriveWindow& a, const DriveWindow& b) { return a.reference < b.reference; });
  const bool moved = std::any_of(windows.begin(), windows.end(), [](const DriveWindow& w) {
    return w.frame_from_reference.size() > 1;
  });
  if (!moved) {
    throw NoAnswerError(windows.empty()
                            ? "the camera does not move: no two frames of the drive "
                              "show the road from different places"
                            : "no motion in any window of the drive: " + windows.front().reason);
  }
  {
    const StageTimer timer(out.timings, "motion");
    out.trajectory = smooth_trajectory(frame_ids, windows, options.noise);
  }
  Trajectory& trajectory = out.trajectory;
  for (TrajectoryPose& pose : trajectory.poses) {
    for (const FrameRecord& record : log->frames()) {
      if (record.frame != pose.frame || record.reason.empty()) continue;
      pose.status = Status::kWeak;
      pose.reason = record.reason;
    }
  }
  std::map<int, double> times;
  const double rate = scene.frame_rate.value_or(10.0);
  for (const int id : frame_ids) times[id] = time_of(*scene.find_frame(id), rate);

  std::map<int, const DriveWindow*> window_of;
  for (const DriveWindow& w : windows) window_of[w.reference] = &w;
  out.mounting = mounting_of(windows);
  out.up = up_of(scene, trajectory, windows, &out.level_by_gravity);
  const std::vector<Eigen::Vector3d> feet = feet_of(trajectory, window_of, out.mounting);
  out.strip.strip_from_world = strip_from_world(out.up, feet);
  std::vector<Eigen::Vector3d> strip_feet;
  for (const Eigen::Vector3d& foot : feet) {
    strip_feet.push_back(out.strip.strip_from_world * foot);
  }
  out.strip.line = DrivenLine(strip_feet);
  double s = 0.0;
  for (std::size_t k = 0; k < trajectory.poses.size(); ++k) {
    DriveFrame frame;
    frame.pose = trajectory.poses[k];
    if (k > 0) {
      s += (frame.pose.world_from_camera.translation() -
            trajectory.poses[k - 1].world_from_camera.translation())
               .norm();
    }
    frame.s = s;
    frame.height = frame.height_sigma = frame.pitch = frame.pitch_sigma = frame.roll =
        frame.roll_sigma = frame.grade = frame.grade_sigma = frame.bank = frame.bank_sigma = kNaN;
    const auto found = window_of.find(frame.pose.frame);
    if (found != window_of.end() && found->second->ego) {
      const UncertainPlane& ego = *found->second->ego;
      const OverRoad over = over_road(ego, found->second->scale_sigma);
      frame.height = over.height;
      frame.height_sigma = std::hypot(over.height_sigma, trajectory.common_sigma * over.height);
      frame.pitch = over.pitch;
      frame.roll = over.roll;
      frame.pitch_sigma = frame.roll_sigma = over.turn_sigma;
      const Eigen::Quaterniond turn = frame.pose.world_from_camera.rotation();
      const Eigen::Matrix3d turned = frame.pose.covariance.topLeftCorner<3, 3>();
      frame.grade = std::asin(std::clamp((turn * ego.axis1).dot(out.up), -1.0, 1.0));
      frame.bank = std::asin(std::clamp((turn * ego.axis2).dot(out.up), -1.0, 1.0));
      frame.grade_sigma = std::sqrt(ego.covariance(1, 1) + turned(0, 0));
      frame.bank_sigma = std::sqrt(ego.covariance(0, 0) + turned(2, 2));
    }
    out.frames.push_back(std::move(frame));
  }
  put_speeds(times, trajectory.common_sigma, &out.frames);

  {
    const StageTimer timer(out.timings, "surface");
    RoadStripBuilder builder(out.strip.line, options.strip);
    std::map<int, std::size_t> place;
    for (std::size_t k = 0; k < frame_ids.size(); ++k) place[frame_ids[k]] = k;
    std::map<int, double> log_scale;
    for (const auto& scale : trajectory.scales) log_scale[scale.reference] = scale.log_scale;
    log->for_each_window([&](const DriveWindow& w) {
      if (w.road.empty() || !w.log_scale) return;
      const std::size_t k = place.at(w.reference);
      const SE3 strip_from_camera =
          out.strip.strip_from_world * trajectory.poses[k].world_from_camera;
      const auto smoothed = log_scale.find(w.reference);
      const double factor =
          smoothed == log_scale.end() ? 1.0 : std::exp(smoothed->second - *w.log_scale);
      for (const RoadSample& sample : w.road) {
        builder.add(strip_from_camera * (factor * sample.point.cast<double>()),
                    factor * sample.sigma, sample.label, sample.color, out.strip.line.lengths()[k]);
      }
    });
    out.strip.cells = builder.finish();
  }
  if (progress) progress("vehicles", 0.95);
  {
    const StageTimer timer(out.timings, "vehicles");
    for (DriveWindow& w : windows) {
      const auto scale =
          std::find_if(trajectory.scales.begin(), trajectory.scales.end(),
                       [&](const auto& entry) { return entry.reference == w.reference; });
      if (scale == trajectory.scales.end() || !w.log_scale) continue;
      const double factor = std::exp(scale->log_scale - *w.log_scale);
      // Vehicles keep their sizes, which the prior holds, and move along their rays.
      for (VehicleEstimate& v : w.vehicles.vehicles) {
        const Eigen::Vector3d shift = (factor - 1.0) * v.pose.bottom_center();
        v.pose.camera_from_vehicle.set_translation(v.pose.bottom_center() + shift);
        for (Eigen::Vector3d& k : v.keypoints) k += shift;
      }
    }
    out.tracks = join_tracks(windows, trajectory, times);
    out.tracks.vehicles.detections_source = scene.detections_source;
  }
  if (progress) progress("vehicles", 1.0);
  return out;
}

}  // namespace camber
