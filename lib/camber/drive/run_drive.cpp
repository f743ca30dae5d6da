#include "camber/drive/run_drive.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include "camber/core/errors.h"
#include "camber/drive/drive_frames.h"
#include "camber/drive/measure_drive.h"
#include "camber/drive/position_scale.h"
#include "camber/pipeline/estimate_vehicles.h"
#include "camber/pipeline/stage_runner.h"

namespace camber {
namespace {

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

/// By how much the smoothed scale of each window is longer than its own, by reference. Windows that
/// the drive contradicts took something else for the road: they have none.
std::map<int, double> scale_factors(const Trajectory& trajectory,
                                    const std::vector<WindowMeasurement>& windows) {
  std::map<int, double> smoothed, out;
  for (const auto& scale : trajectory.scales) {
    if (scale.weight >= kLeastWindowWeight) smoothed[scale.reference] = scale.log_scale;
  }
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
  out.line = laid_onto(out.cells, out.line);
  return out;
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

/// Frames whose vehicles no window has placed, each a window without a road: by their keypoints,
/// boxes and sizes alone.
void add_frames_without_road(const Scene& scene, const std::vector<int>& frame_ids,
                             const ReconstructOptions& options,
                             std::vector<WindowMeasurement>* windows) {
  std::set<int> placed;
  for (const WindowMeasurement& w : *windows) {
    for (const VehicleFrame& frame : w.vehicles) placed.insert(frame.id);
  }
  EstimateVehiclesOptions alone;
  alone.vehicles = options.vehicles;
  alone.vehicles.method = VehicleMethod::kReprojection;
  alone.vehicles.num_threads = options.num_threads;
  std::vector<int> missing;
  for (const int id : frame_ids) {
    if (placed.count(id) == 0 && !scene.find_frame(id)->vehicles.empty()) missing.push_back(id);
  }
  if (missing.empty()) return;
  for (VehicleFrame& frame : estimate_vehicles(scene, missing, alone).frames) {
    for (VehicleEstimate& v : frame.vehicles) v.track = -1;
    WindowMeasurement w;
    w.reference = frame.id;
    w.frames = {frame.id};
    w.vehicles = {std::move(frame)};
    windows->push_back(std::move(w));
  }
}

void require_motion(const std::vector<WindowMeasurement>& windows,
                    const std::vector<FrameRecord>& records) {
  const auto unreadable = [](const FrameRecord& record) {
    return record.kind == FrameRecord::Kind::kUnreadable;
  };
  const auto lost = std::count_if(records.begin(), records.end(), unreadable);
  if (windows.empty() && lost + 1 >= static_cast<std::ptrdiff_t>(records.size())) {
    const auto first = std::find_if(records.begin(), records.end(), unreadable);
    throw NoAnswerError(
        fmt::format("{} of {} frames cannot be read: {}", lost, records.size(), first->reason));
  }
  if (windows.empty()) {
    throw NoAnswerError(
        "the camera does not move: no two frames of the drive show the road from different places");
  }
  for (const WindowMeasurement& w : windows) {
    if (w.frame_from_reference.size() > 1) return;
  }
  throw NoAnswerError("no motion in any window of the drive: " + windows.front().reason);
}

/// The trajectory by the windows, and, where the scene has positions on a map, by these as well.
Trajectory smooth_on_map(const Scene& scene, const std::vector<int>& frame_ids,
                         const std::vector<WindowMeasurement>& windows,
                         const TrajectoryNoise& noise, const std::vector<int>& still,
                         std::optional<DrivePositions>* used) {
  const std::vector<double> times = frame_times(scene, frame_ids);
  Trajectory alone = smooth_trajectory(frame_ids, windows, noise, times, nullptr, still);
  bool by_gravity = false;
  DriveOnMap map;
  map.positions = map_positions(scene, frame_ids, drive_up(scene, alone, windows, &by_gravity));
  const std::optional<PositionScale> scale = scale_by_positions(alone, map.positions);
  if (!scale) return alone;
  const JoinedScale joined = joined_scale(alone, *scale);
  *used = DrivePositions{static_cast<int>(map.positions.at.size()), scale->log_scale, scale->sigma,
                         joined.disagreement_sigmas};
  if (joined.disagreement_sigmas > kMostPositionSigmas) map.positions.at.clear();
  map.log_scale = joined.log_scale;
  map.common_sigma = joined.common_sigma;
  return smooth_trajectory(frame_ids, windows, noise, times, &map, still);
}

std::vector<int> still_frames(const std::vector<FrameRecord>& records) {
  std::vector<int> out;
  for (const FrameRecord& record : records) {
    if (record.still) out.push_back(record.frame);
  }
  return out;
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
  if (every < 1) throw std::invalid_argument(fmt::format("every = {}, expected at least 1", every));
}

DriveResult run_drive(const Scene& scene, const std::vector<int>& frame_ids,
                      const DriveOptions& options, WindowLog* log, const Progress& progress) {
  options.validate();
  if (frame_ids.size() < 2) {
    throw NoAnswerError(
        fmt::format("a drive of {} frame: at least 2 are needed", frame_ids.size()));
  }
  DriveResult out;
  const StageRunner run(out.timings, progress);
  measure_drive(scene, frame_ids, options, log, &out.timings, progress);

  std::vector<WindowMeasurement> windows = windows_without_roads(*log);
  require_motion(windows, log->frames());
  std::optional<DrivePositions> positions;
  out.trajectory = run("motion", 0.95, [&] {
    return smooth_on_map(scene, frame_ids, windows, options.noise, still_frames(log->frames()),
                         &positions);
  });
  name_skipped_frames(log->frames(), &out.trajectory);
  const std::map<int, double> factors = scale_factors(out.trajectory, windows);
  const EgoRoads roads = ego_roads(windows, out.trajectory, factors);
  out.up = drive_up(scene, out.trajectory, windows, &out.level_by_gravity);
  out.document = drive_document(scene, out.trajectory, windows, factors, roads, out.up);
  out.document.positions = positions;
  out.strip = run("surface", 0.97, [&] {
    return strip_of(*log, out.trajectory, factors, out.up,
                    camera_feet(out.trajectory, roads, out.document), options.strip);
  });
  out.tracks = run("vehicles", 0.98, [&] {
    std::map<int, double> times;
    for (const DriveFrame& frame : out.document.frames) times[frame.id] = frame.time_s;
    if (out.trajectory.metric && options.window.vehicles.enabled) {
      add_frames_without_road(scene, frame_ids, options.window, &windows);
    }
    return join_tracks(windows, out.trajectory, times, scene.camera.width,
                       options.window.vehicles.fit.prior);
  });
  out.tracks.vehicles.detections_source = scene.detections_source;
  if (progress) progress("vehicles", 1.0);
  return out;
}

}  // namespace camber
