// The smoother over windows that were measured, with other noise: seconds in place of a drive's
// minutes. Prints a row for every setting: the length against the truth, windows of 50 steps, and
// what the windows' scales are off by themselves.
//
//   bench_replay_drive [-v] LOG... -- TRUTH... [-- KEY=VALUE,KEY=VALUE ...]
//
// LOG is the `windows.log` of a drive (a copy: a drive that ends removes it), TRUTH KITTI's poses
// (row = frame id) or another file of true_trajectory; as many as logs.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "camber/drive/trajectory.h"
#include "camber/drive/window_log.h"
#include "camber/evaluate/trajectory_errors.h"
#include "camber/evaluate/trajectory_files.h"

namespace {

using camber::ComparedPose;
using camber::Trajectory;
using camber::TrajectoryNoise;
using camber::WindowMeasurement;

struct Drive {
  std::string name;
  std::vector<int> ids;
  std::vector<double> times;
  std::vector<WindowMeasurement> windows;
  std::map<int, camber::SE3> truth;
};

Drive read_drive(const std::string& log, const std::string& truth, double rate) {
  Drive out;
  out.name = log;
  const camber::WindowLog held(log, nlohmann::json::object(), true);
  for (const camber::FrameRecord& frame : held.frames()) {
    out.ids.push_back(frame.frame);
    out.times.push_back(frame.frame / rate);
  }
  held.for_each_window([&](WindowMeasurement window) {
    window.road = {};
    out.windows.push_back(std::move(window));
  });
  std::sort(out.windows.begin(), out.windows.end(),
            [](const WindowMeasurement& a, const WindowMeasurement& b) {
              return a.reference < b.reference;
            });
  for (const auto& frame : camber::read_true_trajectory(truth, {}).frames) {
    out.truth[frame.id] = frame.world_from_camera;
  }
  return out;
}

void set(const std::string& key, double value, TrajectoryNoise* noise, double* rate) {
  const std::map<std::string, double*> places = {
      {"motion_inflation", &noise->motion_inflation},
      {"windows_as_stated", &noise->windows_as_stated},
      {"rotation_floor", &noise->rotation_floor},
      {"translation_floor", &noise->translation_floor},
      {"scale_freedom", &noise->scale_freedom},
      {"scale_floor", &noise->scale_floor},
      {"scale_correlation", &noise->scale_correlation},
      {"motion_freedom", &noise->motion_freedom},
      {"acceleration_density", &noise->acceleration_density},
      {"rate", rate}};
  const auto found = places.find(key);
  if (found == places.end()) throw std::invalid_argument("no noise named " + key);
  *found->second = value;
}

/// How far true scales of the windows are from their own, in logarithms: mean, spread, spread over
/// sigma, and correlation of neighbours at 1, 5 and 20 windows.
void print_scales(const Drive& drive) {
  std::vector<double> off, sigmas;
  for (const WindowMeasurement& w : drive.windows) {
    if (!w.log_scale || w.frame_from_reference.size() < 2) continue;
    double length = 0.0, truth = 0.0;
    bool known = true;
    for (std::size_t k = 1; k < w.frames.size(); ++k) {
      const auto a = drive.truth.find(w.frames[k - 1]), b = drive.truth.find(w.frames[k]);
      known = known && a != drive.truth.end() && b != drive.truth.end();
      if (!known) break;
      truth += (a->second.translation() - b->second.translation()).norm();
      length += (w.frame_from_reference[k].inverse().translation() -
                 w.frame_from_reference[k - 1].inverse().translation())
                    .norm();
    }
    if (!known || truth < 0.3 || length <= 0.0) continue;
    off.push_back(*w.log_scale + std::log(length / truth));
    sigmas.push_back(std::hypot(w.scale_sigma, w.common_scale_sigma));
  }
  if (off.empty()) return;
  double mean = 0.0, square = 0.0, normal = 0.0;
  for (const double o : off) mean += o / static_cast<double>(off.size());
  for (std::size_t i = 0; i < off.size(); ++i) {
    square += std::pow(off[i] - mean, 2) / static_cast<double>(off.size());
    normal += std::pow(off[i] / sigmas[i], 2) / static_cast<double>(off.size());
  }
  std::printf("  %zu windows by themselves: mean %+.2f %%, spread %.2f %%, over sigma %.2f;",
              off.size(), 100 * mean, 100 * std::sqrt(square), std::sqrt(normal));
  for (const std::size_t lag : {1U, 2U, 5U, 10U, 20U}) {
    double sum = 0.0;
    for (std::size_t i = lag; i < off.size(); ++i) sum += (off[i] - mean) * (off[i - lag] - mean);
    std::printf(" r%zu %.2f", lag,
                off.size() > lag ? sum / (square * static_cast<double>(off.size() - lag)) : 0.0);
  }
  std::printf("\n");
}

/// What each window measured by itself.
void print_windows(const Drive& drive) {
  for (const WindowMeasurement& w : drive.windows) {
    std::printf("  %d: frames %d to %d (%zu)", w.reference, w.frames.front(), w.frames.back(),
                w.frames.size());
    double length = 0.0;
    for (std::size_t k = 1; k < w.frame_from_reference.size(); ++k) {
      length += (w.frame_from_reference[k].inverse().translation() -
                 w.frame_from_reference[k - 1].inverse().translation())
                    .norm();
    }
    if (w.log_scale) {
      std::printf(", %.3f m a frame +- %.1f %%",
                  std::exp(*w.log_scale) * length / (w.frames.back() - w.frames.front()),
                  100 * std::hypot(w.scale_sigma, w.common_scale_sigma));
    }
    if (w.frame_from_reference.size() > 1) {
      const Eigen::Vector3d way = (w.frame_from_reference.back().inverse().translation() -
                                   w.frame_from_reference.front().inverse().translation())
                                      .normalized();
      std::printf(", way (%.3f %.3f %.3f)", way.x(), way.y(), way.z());
    }
    std::printf(" %s\n", w.reason.c_str());
    for (const camber::VehicleFrame& frame : w.vehicles) {
      for (const camber::VehicleEstimate& v : frame.vehicles) {
        const Eigen::Vector3d at = v.pose.bottom_center();
        std::printf("    vehicle %d %d at %.3f %.3f %.3f, %.2f long, %s\n", frame.id, v.id, at.x(),
                    at.y(), at.z(), v.pose.dimensions.length,
                    std::string(camber::to_string(v.status)).c_str());
      }
    }
  }
}

/// How fast lengths alone drift: windows' scales are left out but the first's.
void print_drift(const Drive& drive, TrajectoryNoise noise) {
  std::vector<WindowMeasurement> windows = drive.windows;
  bool first = true;
  for (WindowMeasurement& w : windows) {
    if (w.log_scale && first) {
      first = false;
      w.scale_sigma = 1e-4;
    } else {
      w.log_scale.reset();
    }
  }
  const Trajectory t = camber::smooth_trajectory(drive.ids, windows, noise);
  std::vector<double> ratio;  // of every ten steps
  for (std::size_t k = 10; k < t.poses.size(); k += 10) {
    double length = 0.0, truth = 0.0;
    for (std::size_t i = k - 9; i <= k; ++i) {
      length += (t.poses[i].world_from_camera.translation() -
                 t.poses[i - 1].world_from_camera.translation())
                    .norm();
      truth += (drive.truth.at(t.poses[i].frame).translation() -
                drive.truth.at(t.poses[i - 1].frame).translation())
                   .norm();
    }
    ratio.push_back(std::log(length / truth));
  }
  std::printf("  motion alone, log ratio of each ten steps:");
  for (const double r : ratio) std::printf(" %+.1f", 100 * (r - ratio.front()));
  std::printf(" %%\n");
}

void print(const Drive& drive, const TrajectoryNoise& noise, double rate) {
  std::vector<double> times;
  for (const int id : drive.ids) times.push_back(id / rate);
  const Trajectory found = camber::smooth_trajectory(drive.ids, drive.windows, noise,
                                                     rate > 0 ? times : std::vector<double>());
  std::vector<ComparedPose> poses;
  for (const auto& pose : found.poses) {
    const auto truth = drive.truth.find(pose.frame);
    if (truth != drive.truth.end()) {
      poses.push_back({pose.frame, truth->second, pose.world_from_camera});
    }
  }
  camber::TrajectoryErrorOptions options;
  options.common_sigma = found.common_sigma;
  for (const auto& w : found.windows) {
    options.windows.push_back({w.first, w.last, w.sigma() / w.length});
  }
  const auto errors = camber::trajectory_errors(poses, options);
  const auto& half = errors.every_nth.half;
  std::printf(
      "  length %+.2f %% (own %.2f, all %.2f); windows mean %+.2f max-dev %.2f %% p95 %.2f close "
      "%.2f in 2 sigma %.2f own spread %.2f; half length %.2f %% %.2f deg/100m\n",
      100 * errors.length_error, 100 * found.whole.own_sigma / found.whole.length,
      100 * found.whole.sigma() / found.whole.length, 100 * errors.windows.mean,
      100 * errors.windows.deviation, 100 * errors.windows.p95, errors.windows.close,
      errors.windows.within_2_sigma, errors.windows.own_spread,
      half ? 100 * half->translation : NAN, half ? half->rotation * 100 * 180 / M_PI : NAN);
}

}  // namespace

int main(int argc, char** argv) try {
  std::vector<std::vector<std::string>> parts(1);
  bool verbose = false;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word == "-v") {
      verbose = true;
    } else if (word == "--") {
      parts.emplace_back();
    } else {
      parts.back().push_back(word);
    }
  }
  if (parts.size() < 2 || parts[0].size() != parts[1].size() || parts[0].empty()) {
    std::fprintf(stderr, "bench_replay_drive [-v] LOG... -- TRUTH... [-- KEY=VALUE,... ...]\n");
    return 2;
  }
  std::vector<std::string> settings = {""};
  if (parts.size() > 2) settings.insert(settings.end(), parts[2].begin(), parts[2].end());
  for (std::size_t d = 0; d < parts[0].size(); ++d) {
    const Drive drive = read_drive(parts[0][d], parts[1][d], 10.0);
    std::printf("%s: %zu frames, %zu windows\n", drive.name.c_str(), drive.ids.size(),
                drive.windows.size());
    if (verbose) print_windows(drive);
    print_scales(drive);
    print_drift(drive, {});
    for (const std::string& setting : settings) {
      TrajectoryNoise noise;
      double rate = 10.0;
      std::istringstream words(setting);
      for (std::string word; std::getline(words, word, ',');) {
        const auto equals = word.find('=');
        set(word.substr(0, equals), std::stod(word.substr(equals + 1)), &noise, &rate);
      }
      std::printf(" %s\n", setting.empty() ? "as it is" : setting.c_str());
      print(drive, noise, rate);
    }
  }
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bench_replay_drive: %s\n", error.what());
  return 2;
}
