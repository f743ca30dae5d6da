#include "camber/drive/run_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <stdexcept>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/median.h"
#include "camber/pipeline/estimate_window.h"
#include "camber/pipeline/near_parallax.h"
#include "camber/pipeline/stage_runner.h"

namespace camber {
namespace {

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
        progress_("windows", 0.95 * static_cast<double>(i) / static_cast<double>(ids_.size()));
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

/// The camera over the road by one window: pitch is positive where the optical axis rises against
/// the road, roll where its right side is down.
struct OverRoad {
  DriveNumber height, pitch, roll;
};

OverRoad over_road(const UncertainPlane& ego, double scale_sigma) {
  const Eigen::Vector3d& n = ego.plane.normal;
  const double height = ego.plane.offset;
  const double turn = std::sqrt(std::max(ego.covariance(0, 0), ego.covariance(1, 1)));
  const double own = std::sqrt(std::max(0.0, ego.covariance(2, 2)));
  return {{height, std::hypot(own, scale_sigma * height)},
          {std::atan2(n.z(), -n.y()), turn},
          {std::atan2(n.x(), -n.y()), turn}};
}

/// The median over all windows. Neighbouring windows' errors are alike: the spread counts for a
/// fifth of their number.
DriveNumber middle(std::vector<double> values) {
  constexpr double kAlike = 5.0;
  if (values.empty()) return {};
  const double effective = std::max(1.0, static_cast<double>(values.size()) / kAlike);
  const double median = upper_median(values);
  for (double& v : values) v = std::abs(v - median);
  return {median, kSigmaFromMad * upper_median(&values) / std::sqrt(effective)};
}

void put_mounting(const std::vector<WindowMeasurement>& windows, double common,
                  DriveDocument* out) {
  std::vector<double> height, pitch, roll;
  for (const WindowMeasurement& w : windows) {
    if (!w.ego) continue;
    const OverRoad over = over_road(*w.ego, w.scale_sigma);
    height.push_back(over.height.value);
    pitch.push_back(over.pitch.value);
    roll.push_back(over.roll.value);
  }
  out->height = middle(std::move(height));
  out->height.sigma = std::hypot(out->height.sigma, common * out->height.value);
  out->pitch = middle(std::move(pitch));
  out->roll = middle(std::move(roll));
}

/// Up in the world: gravity's where frames know it, else the mean of the road's normals.
Eigen::Vector3d up_of(const Scene& scene, const Trajectory& trajectory,
                      const std::vector<WindowMeasurement>& windows, bool* by_gravity) {
  Eigen::Vector3d gravity = Eigen::Vector3d::Zero(), normals = Eigen::Vector3d::Zero();
  for (const TrajectoryPose& pose : trajectory.poses) {
    const SceneFrame* frame = scene.find_frame(pose.frame);
    if (frame && frame->up) gravity += pose.world_from_camera.rotation() * *frame->up;
  }
  for (const WindowMeasurement& w : windows) {
    const TrajectoryPose* pose = w.ego ? trajectory.find(w.reference) : nullptr;
    if (pose) normals += pose->world_from_camera.rotation() * w.ego->plane.normal;
  }
  *by_gravity = gravity.norm() > 0.5;
  if (*by_gravity) return gravity.normalized();
  return normals.norm() > 0.5 ? Eigen::Vector3d(normals.normalized()) : Eigen::Vector3d(0, -1, 0);
}

using WindowOfFrame = std::map<int, const WindowMeasurement*>;

const UncertainPlane* ego_of(const WindowOfFrame& window_of, int frame) {
  const auto found = window_of.find(frame);
  return found != window_of.end() && found->second->ego ? &*found->second->ego : nullptr;
}

/// The foot of every camera on the road under it, world. The height is the mounting's: what single
/// windows are off is no bump of the road.
std::vector<Eigen::Vector3d> feet_of(const Trajectory& trajectory, const WindowOfFrame& window_of,
                                     const DriveDocument& mounting) {
  const bool known = std::isfinite(mounting.height.value);
  const double height = known ? mounting.height.value : 0.0;
  const Eigen::Vector3d mounted =
      known ? Eigen::Vector3d(std::tan(mounting.roll.value), -1.0, std::tan(mounting.pitch.value))
                  .normalized()
            : Eigen::Vector3d(0, -1, 0);
  std::vector<Eigen::Vector3d> out;
  for (const TrajectoryPose& pose : trajectory.poses) {
    const UncertainPlane* ego = ego_of(window_of, pose.frame);
    out.push_back(pose.world_from_camera * (-height * (ego ? ego->plane.normal : mounted)));
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

DriveFrame frame_of(const TrajectoryPose& pose, const WindowOfFrame& window_of,
                    const Eigen::Vector3d& up, double common) {
  DriveFrame out;
  out.id = pose.frame;
  out.world_from_camera = pose.world_from_camera;
  out.covariance = pose.covariance;
  out.status = pose.status;
  out.reason = pose.reason;
  const UncertainPlane* ego = ego_of(window_of, pose.frame);
  if (!ego) return out;
  const OverRoad over = over_road(*ego, window_of.at(pose.frame)->scale_sigma);
  out.height = {over.height.value, std::hypot(over.height.sigma, common * over.height.value)};
  out.pitch = over.pitch;
  out.roll = over.roll;
  const Eigen::Quaterniond turn = pose.world_from_camera.rotation();
  const auto slope = [&](const Eigen::Vector3d& axis) {
    return std::asin(std::clamp((turn * axis).dot(up), -1.0, 1.0));
  };
  out.grade = {slope(ego->axis1), std::sqrt(ego->covariance(1, 1) + pose.covariance(0, 0))};
  out.bank = {slope(ego->axis2), std::sqrt(ego->covariance(0, 0) + pose.covariance(2, 2))};
  return out;
}

/// Speeds by the steps to the frames beside, m/s.
void put_speeds(double common, std::vector<DriveFrame>* frames) {
  for (std::size_t k = 0; k < frames->size(); ++k) {
    const DriveFrame& before = (*frames)[k > 0 ? k - 1 : k];
    const DriveFrame& after = (*frames)[std::min(k + 1, frames->size() - 1)];
    const double span = after.time_s - before.time_s;
    if (!(span > 0.0)) continue;
    DriveFrame& frame = (*frames)[k];
    const double way = after.s.value - before.s.value;
    // Neighbouring poses differ by what the covariance grows between them.
    const double grown = std::abs(after.covariance->bottomRightCorner<3, 3>().trace() -
                                  before.covariance->bottomRightCorner<3, 3>().trace());
    frame.speed = {way / span, std::hypot(std::sqrt(grown), common * way) / span};
  }
}

DriveDocument document_of(const Scene& scene, const Trajectory& trajectory,
                          const std::vector<WindowMeasurement>& windows,
                          const WindowOfFrame& window_of, const Eigen::Vector3d& up) {
  DriveDocument out;
  out.metric = trajectory.metric;
  out.length = trajectory.whole.length;
  out.length_sigma = trajectory.whole.sigma();
  out.common_sigma = trajectory.common_sigma;
  put_mounting(windows, trajectory.common_sigma, &out);
  for (const Trajectory::Stretch& w : trajectory.windows) {
    out.windows.push_back({w.first, w.last, w.length, w.sigma()});
  }
  const double rate = scene.frame_rate.value_or(10.0);
  double s = 0.0;
  for (std::size_t k = 0; k < trajectory.poses.size(); ++k) {
    const TrajectoryPose& pose = trajectory.poses[k];
    DriveFrame frame = frame_of(pose, window_of, up, trajectory.common_sigma);
    if (k > 0) {
      s += (pose.world_from_camera.translation() -
            trajectory.poses[k - 1].world_from_camera.translation())
               .norm();
    }
    frame.s.value = s;
    frame.time_s = time_of(*scene.find_frame(pose.frame), rate);
    out.frames.push_back(std::move(frame));
  }
  put_speeds(trajectory.common_sigma, &out.frames);
  return out;
}

/// By how much the smoothed scale of each window is longer than its own, by reference.
std::map<int, double> scale_factors(const Trajectory& trajectory,
                                    const std::vector<WindowMeasurement>& windows) {
  std::map<int, double> smoothed, out;
  for (const auto& scale : trajectory.scales) smoothed[scale.reference] = scale.log_scale;
  for (const WindowMeasurement& w : windows) {
    const auto found = smoothed.find(w.reference);
    if (w.log_scale && found != smoothed.end()) {
      out[w.reference] = std::exp(found->second - *w.log_scale);
    }
  }
  return out;
}

RoadStrip strip_of(const WindowLog& log, const Trajectory& trajectory,
                   const std::map<int, double>& factors, const Eigen::Vector3d& up,
                   const std::vector<Eigen::Vector3d>& feet, const RoadStripOptions& options) {
  RoadStrip out;
  out.strip_from_world = strip_from_world(up, feet);
  std::vector<Eigen::Vector3d> turned;
  for (const Eigen::Vector3d& foot : feet) turned.push_back(out.strip_from_world * foot);
  out.line = DrivenLine(turned);
  RoadStripBuilder builder(out.line, options);
  log.for_each_window([&](const WindowMeasurement& w) {
    const auto factor = factors.find(w.reference);
    const TrajectoryPose* pose = trajectory.find(w.reference);
    if (w.road.empty() || factor == factors.end() || !pose) return;
    const SE3 strip_from_camera = out.strip_from_world * pose->world_from_camera;
    const double s = out.line.lengths()[static_cast<std::size_t>(pose - trajectory.poses.data())];
    for (const RoadSample& sample : w.road) {
      builder.add(strip_from_camera * (factor->second * sample.point.cast<double>()),
                  factor->second * sample.sigma, sample.label, sample.color, s);
    }
  });
  out.cells = builder.finish();
  return out;
}

/// Vehicles keep their sizes, which the prior holds, and move along their rays.
void move_along_rays(double factor, std::vector<VehicleEstimate>* vehicles) {
  for (VehicleEstimate& v : *vehicles) {
    const Eigen::Vector3d shift = (factor - 1.0) * v.pose.bottom_center();
    v.pose.camera_from_vehicle.set_translation(v.pose.bottom_center() + shift);
    for (Eigen::Vector3d& k : v.keypoints) k += shift;
  }
}

/// What is light of all windows, by reference.
std::vector<WindowMeasurement> windows_without_roads(const WindowLog& log) {
  std::vector<WindowMeasurement> out;
  log.for_each_window([&](WindowMeasurement window) {
    window.road = {};
    out.push_back(std::move(window));
  });
  std::sort(out.begin(), out.end(), [](const WindowMeasurement& a, const WindowMeasurement& b) {
    return a.reference < b.reference;
  });
  return out;
}

void require_motion(const std::vector<WindowMeasurement>& windows) {
  if (windows.empty()) {
    throw NoAnswerError(
        "the camera does not move: no two frames of the drive show the road from different places");
  }
  for (const WindowMeasurement& w : windows) {
    if (w.frame_from_reference.size() > 1) return;
  }
  throw NoAnswerError("no motion in any window of the drive: " + windows.front().reason);
}

void name_skipped_frames(const std::vector<FrameRecord>& records, Trajectory* trajectory) {
  std::map<int, const FrameRecord*> skipped;
  for (const FrameRecord& record : records) {
    if (!record.reason.empty()) skipped[record.frame] = &record;
  }
  for (TrajectoryPose& pose : trajectory->poses) {
    const auto found = skipped.find(pose.frame);
    if (found == skipped.end()) continue;
    pose.status = Status::kWeak;
    pose.reason = found->second->reason;
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
  const StageRunner run(out.timings, progress);
  Measurer(scene, frame_ids, options, window_options, log, &out.timings, progress).run();

  std::vector<WindowMeasurement> windows = windows_without_roads(*log);
  require_motion(windows);
  out.trajectory =
      run("motion", 0.95, [&] { return smooth_trajectory(frame_ids, windows, options.noise); });
  name_skipped_frames(log->frames(), &out.trajectory);
  WindowOfFrame window_of;
  for (const WindowMeasurement& w : windows) window_of[w.reference] = &w;
  out.up = up_of(scene, out.trajectory, windows, &out.level_by_gravity);
  out.document = document_of(scene, out.trajectory, windows, window_of, out.up);
  const std::map<int, double> factors = scale_factors(out.trajectory, windows);
  out.strip = run("surface", 0.97, [&] {
    return strip_of(*log, out.trajectory, factors, out.up,
                    feet_of(out.trajectory, window_of, out.document), options.strip);
  });
  out.tracks = run("vehicles", 0.98, [&] {
    for (WindowMeasurement& w : windows) {
      const auto factor = factors.find(w.reference);
      if (factor != factors.end()) move_along_rays(factor->second, &w.vehicles.vehicles);
    }
    std::map<int, double> times;
    for (const DriveFrame& frame : out.document.frames) times[frame.id] = frame.time_s;
    return join_tracks(windows, out.trajectory, times);
  });
  out.tracks.vehicles.detections_source = scene.detections_source;
  if (progress) progress("vehicles", 1.0);
  return out;
}

}  // namespace camber
