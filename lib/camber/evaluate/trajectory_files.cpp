#include "camber/evaluate/trajectory_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>

#include "camber/core/errors.h"
#include "camber/core/median.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/trajectory.h"
#include "camber/import/text_rows.h"
#include "camber/scene/drive_document.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// The share of the truth's frame interval by which the times of one frame may differ.
constexpr double kTimeTolerance = 0.1;

/// A pose of an estimate.
struct EstimatedPose {
  int id = 0;  ///< frame, or row
  double time_s = kNaN;
  std::optional<SE3> world_from_camera;
};

void mark_timed(TrueTrajectory* truth) {
  truth->timed = truth->frames.size() > 1;
  for (std::size_t i = 0; i < truth->frames.size(); ++i) {
    const double time = truth->frames[i].time_s;
    truth->timed =
        truth->timed && std::isfinite(time) && (i == 0 || time > truth->frames[i - 1].time_s);
  }
}

std::vector<double> read_times(const fs::path& path) {
  const TextRows text(path);
  std::vector<double> out;
  for (const TextRow& row : text.rows()) {
    if (row.words.size() != 1) {
      text.fail(row, fmt::format("found {} words, expected one time in s", row.words.size()));
    }
    out.push_back(text.number(row, row.words[0], "a time in s"));
  }
  return out;
}

double median_interval(const TrueTrajectory& truth) {
  std::vector<double> intervals;
  for (std::size_t i = 1; i < truth.frames.size(); ++i) {
    intervals.push_back(truth.frames[i].time_s - truth.frames[i - 1].time_s);
  }
  return upper_median(intervals);
}

/// For each frame of the truth the estimate whose time, moved by `shift`, is the nearest within
/// `tolerance`; the others stay -1. Each estimate goes to one frame.
std::vector<int> by_time(const TrueTrajectory& truth, const std::vector<EstimatedPose>& estimates,
                         double shift, double tolerance) {
  std::vector<int> out(truth.frames.size(), -1);
  std::vector<double> nearest(truth.frames.size(), tolerance);
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    const double time = estimates[i].time_s + shift;
    auto at = std::lower_bound(truth.frames.begin(), truth.frames.end(), time,
                               [](const TrueFrame& f, double value) { return f.time_s < value; });
    if (at == truth.frames.end() ||
        (at != truth.frames.begin() && time - (at - 1)->time_s < at->time_s - time)) {
      --at;
    }
    const auto frame = static_cast<std::size_t>(at - truth.frames.begin());
    const double apart = std::abs(at->time_s - time);
    if (!(apart <= nearest[frame])) continue;
    nearest[frame] = apart;
    out[frame] = static_cast<int>(i);
  }
  return out;
}

int count_matched(const std::vector<int>& matches) {
  return static_cast<int>(matches.size() - std::count(matches.begin(), matches.end(), -1));
}

std::string span_of(double from, double to) { return fmt::format("{:.6g} to {:.6g} s", from, to); }

/// Matches by time, or refuses and states by which shift most would match.
std::vector<int> matched_times(const std::string& file, const TrueTrajectory& truth,
                               const std::vector<EstimatedPose>& estimates, const LogSink& warn) {
  if (!truth.timed) {
    throw UsageError(truth.name + ": has no times to find the poses of " + file +
                     " by, expected --times FILE");
  }
  const double tolerance = kTimeTolerance * median_interval(truth);
  const std::vector<int> matches = by_time(truth, estimates, 0.0, tolerance);
  const int count = count_matched(matches);
  const auto total = static_cast<int>(estimates.size());
  if (count < 2 || 2 * count < std::min<int>(total, static_cast<int>(truth.frames.size()))) {
    double least = estimates[0].time_s, most = least;
    for (const EstimatedPose& pose : estimates) {
      least = std::min(least, pose.time_s);
      most = std::max(most, pose.time_s);
    }
    const double from = truth.frames.front().time_s, to = truth.frames.back().time_s;
    std::string reason = fmt::format(
        "found poses of other times: {} of {} are at a frame of the truth; theirs are {}, the "
        "truth's {}",
        count, total, span_of(least, most), span_of(from, to));
    for (const double shift : {from - least, to - most}) {
      const int shifted = count_matched(by_time(truth, estimates, shift, tolerance));
      if (shifted <= count || 2 * shifted < total) continue;
      reason += fmt::format(" (moved by {:+.6g} s {} would be)", shift, shifted);
      break;
    }
    throw InputError(file, reason);
  }
  if (count < total && warn) {
    warn(fmt::format("{}: {} of {} poses are at no frame of the truth and are left out", file,
                     total - count, total));
  }
  return matches;
}

/// Poses without times: a row a frame, or rows by frame id.
std::vector<int> matched_rows(const std::string& file, const TrueTrajectory& truth,
                              const std::vector<EstimatedPose>& estimates) {
  std::vector<int> out;
  const auto rows = static_cast<int>(estimates.size());
  const bool by_place = estimates.size() == truth.frames.size();
  if (!by_place && truth.frames.back().id >= rows) {
    throw InputError(file, fmt::format("found {} poses without times, expected one for each of the "
                                       "truth's {} frames, or a row for each frame up to {}",
                                       rows, truth.frames.size(), truth.frames.back().id));
  }
  for (std::size_t i = 0; i < truth.frames.size(); ++i) {
    out.push_back(by_place ? static_cast<int>(i) : truth.frames[i].id);
  }
  return out;
}

void take(const TrueTrajectory& truth, const std::vector<EstimatedPose>& estimates,
          const std::vector<int>& matches, bool only_matched, ComparedTrajectory* out) {
  for (std::size_t i = 0; i < truth.frames.size(); ++i) {
    if (matches[i] < 0 && only_matched) continue;
    ComparedPose pose;
    pose.id = truth.frames[i].id;
    pose.truth = truth.frames[i].world_from_camera;
    if (matches[i] >= 0) {
      pose.estimate = estimates[static_cast<std::size_t>(matches[i])].world_from_camera;
    }
    out->poses.push_back(pose);
  }
}

double relative_sigma(double sigma, double length) { return length > 0.0 ? sigma / length : kNaN; }

void take_drive(const fs::path& path, const TrueTrajectory& truth, const LogSink& warn,
                ComparedTrajectory* out) {
  const DriveDocument drive = read_drive(path);
  out->method = "drive";
  out->metric = drive.metric;
  out->frames_taken = static_cast<int>(drive.frames.size());
  std::vector<EstimatedPose> estimates;
  for (const DriveFrame& frame : drive.frames) {
    estimates.push_back({frame.id, frame.time_s, frame.world_from_camera});
  }
  if (estimates.empty()) throw NoAnswerError(path.string() + ": the drive has no frame");
  std::vector<int> matches;
  if (truth.numbered) {
    std::map<int, int> index;
    for (std::size_t i = 0; i < estimates.size(); ++i) index[estimates[i].id] = static_cast<int>(i);
    for (const TrueFrame& frame : truth.frames) {
      const auto at = index.find(frame.id);
      matches.push_back(at == index.end() ? -1 : at->second);
    }
    if (count_matched(matches) == 0) {
      throw InputError(path.string(),
                       fmt::format("found frames {} to {}, expected those of the truth, {} to {}",
                                   estimates.front().id, estimates.back().id,
                                   truth.frames.front().id, truth.frames.back().id));
    }
  } else {
    for (const EstimatedPose& pose : estimates) {
      if (std::isfinite(pose.time_s)) continue;
      throw InputError(path.string(),
                       fmt::format("frame {} has no time, expected one to find it in {} by",
                                   pose.id, truth.name));
    }
    matches = matched_times(path.string(), truth, estimates, warn);
  }
  take(truth, estimates, matches, true, out);
  // The windows name the drive's frames.
  if (!truth.numbered) {
    std::size_t k = 0;
    for (const int match : matches) {
      if (match >= 0) out->poses[k++].id = estimates[static_cast<std::size_t>(match)].id;
    }
  }
  out->options.length_sigma = relative_sigma(drive.length_sigma, drive.length);
  out->options.common_sigma = drive.common_sigma;
  for (const DriveWindow& window : drive.windows) {
    out->options.windows.push_back(
        {window.first, window.last, relative_sigma(window.length_sigma, window.length)});
  }
  double length = 0.0;
  const SE3* before = nullptr;
  for (const DriveFrame& frame : drive.frames) {
    if (!frame.world_from_camera) continue;
    if (before) length += (frame.world_from_camera->translation() - before->translation()).norm();
    before = &*frame.world_from_camera;
  }
  if (warn && std::abs(drive.length - length) > 0.01 * length) {
    warn(fmt::format("{}: states a length of {:.2f} m, the steps of its poses have {:.2f} m",
                     path.string(), drive.length, length));
  }
}

void take_file(const fs::path& path, const TrueTrajectory& truth, const LogSink& warn,
               ComparedTrajectory* out) {
  const PoseFile file = read_poses(path);
  out->method = file.form;
  out->frames_taken = static_cast<int>(file.poses.size());
  std::vector<EstimatedPose> estimates;
  bool timed = true;
  for (const TimedPose& pose : file.poses) {
    estimates.push_back({static_cast<int>(estimates.size()), pose.time_s, pose.world_from_body()});
    timed = timed && std::isfinite(pose.time_s);
  }
  take(truth, estimates,
       timed ? matched_times(path.string(), truth, estimates, warn)
             : matched_rows(path.string(), truth, estimates),
       false, out);
  const std::string remark = remark_on_frame(out->poses);
  if (!remark.empty()) throw InputError(path.string(), remark);
}

}  // namespace

TrueTrajectory true_trajectory(const Scene& scene, const std::string& name) {
  TrueTrajectory out;
  out.name = name;
  if (scene.truth) {
    for (const TruthFrame& frame : scene.truth->frames) {
      if (!frame.world_from_camera) continue;
      const SceneFrame* of = scene.find_frame(frame.id);
      double time = kNaN;
      if (of && (of->time_s || scene.frame_rate)) time = time_of(*of, scene.frame_rate.value_or(1));
      out.frames.push_back({frame.id, time, *frame.world_from_camera});
    }
  }
  if (out.frames.size() < 2) {
    throw NoAnswerError(name +
                        fmt::format(": {} frames of the truth have a pose, expected at least 2",
                                    out.frames.size()));
  }
  std::sort(out.frames.begin(), out.frames.end(),
            [](const TrueFrame& a, const TrueFrame& b) { return a.id < b.id; });
  mark_timed(&out);
  return out;
}

TrueTrajectory read_true_trajectory(const fs::path& path, const fs::path& times) {
  const PoseFile file = read_poses(path);
  TrueTrajectory out;
  out.name = path.string();
  for (const TimedPose& pose : file.poses) {
    out.frames.push_back(
        {static_cast<int>(out.frames.size()), pose.time_s, pose.world_from_body()});
  }
  if (!times.empty()) {
    const std::vector<double> given = read_times(times);
    if (given.size() != out.frames.size()) {
      throw InputError(times.string(),
                       fmt::format("found {} times, expected one for each of the {} "
                                   "poses of {}",
                                   given.size(), out.frames.size(), path.string()));
    }
    for (std::size_t i = 0; i < given.size(); ++i) out.frames[i].time_s = given[i];
  }
  if (out.frames.size() < 2) {
    throw NoAnswerError(path.string() + ": found one pose, expected at least 2");
  }
  mark_timed(&out);
  out.numbered = !out.timed || !times.empty();
  return out;
}

bool is_trajectory(const fs::path& path) {
  std::error_code error;
  if (fs::is_directory(path, error)) return fs::exists(path / "drive.json", error);
  if (path.filename() == "drive.json" || path.extension() == ".tum") return true;
  if (path.extension() == ".json") return false;
  std::ifstream in(path);
  std::string line;
  while (std::getline(in, line)) {
    if (line.find_first_not_of(" \t\r") == std::string::npos || line[0] == '#') continue;
    if (line.size() > 4096) return false;
    std::istringstream words(line);
    int count = 0;
    double value = 0.0;
    for (std::string word; words >> word; ++count) {
      if (!parse_number(word, &value)) return false;
    }
    return count == 8 || count == 12;
  }
  return false;
}

ComparedTrajectory read_compared_trajectory(const fs::path& path, const TrueTrajectory& truth,
                                            const LogSink& warn) {
  ComparedTrajectory out;
  std::error_code error;
  const bool folder = fs::is_directory(path, error);
  if (folder || path.extension() == ".json") {
    take_drive(folder ? path / "drive.json" : path, truth, warn, &out);
  } else {
    take_file(path, truth, warn, &out);
  }
  return out;
}

}  // namespace camber
