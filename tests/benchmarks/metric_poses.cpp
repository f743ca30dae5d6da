// Whether the joint covariance of a window's poses in metres holds: windows of made drives, what
// their poses are off against the truth, as a chi-square. Prints a row for each of: poses and
// scale, rotations, translations, the logarithm of the scale.
//
//   bench_metric_poses SCENE... [--windows 4] [--size 5] [--dump FILE]
//
// SCENE is a folder of `camber synth --drive`. The windows are spread over the drive and share no
// frame. With --dump a line of JSON a window: what is off, own covariance, common errors.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "camber/core/errors.h"
#include "camber/evaluate/trajectory_files.h"
#include "camber/pipeline/estimate_window.h"
#include "camber/scale/metric_poses.h"

namespace {

using camber::MetricPoses;
using camber::SE3;

struct Window {
  std::string scene;
  int first = 0;
  Eigen::VectorXd off;  // estimate against truth, rows as MetricPoses's
  MetricPoses poses;
  double sigma = 0.0,
         verdict = 0.0;  // of the logarithm of the scale, by the poses and by the judge
};

Eigen::VectorXd off_by(const MetricPoses& poses, const std::vector<SE3>& truth,
                       std::size_t reference, std::size_t longest) {
  Eigen::VectorXd out(poses.own.rows());
  Eigen::Index row = 0;
  for (std::size_t k = 0; k < truth.size(); ++k) {
    if (k == reference) continue;
    const SE3 true_pose = truth[k].inverse() * truth[reference];
    const SE3& pose = poses.frame_from_reference[k];
    out.segment<3>(row) =
        camber::rotation_to_vector(pose.rotation() * true_pose.rotation().inverse());
    out.segment<3>(row + 3) = pose.translation() - true_pose.translation();
    if (k == longest) {
      out[out.size() - 1] = poses.log_scale - std::log(true_pose.translation().norm());
    }
    row += 6;
  }
  return out;
}

void add_windows(const std::string& path, int count, int size, std::vector<Window>* out) {
  const camber::Scene scene = camber::read_scene(path);
  std::map<int, SE3> truth;
  for (const auto& frame : camber::true_trajectory(scene, path).frames) {
    truth[frame.id] = frame.world_from_camera;
  }
  camber::ReconstructOptions options;
  options.num_threads = 1;
  options = camber::handed_down(options);
  const auto frames = static_cast<int>(scene.frames.size());
  for (int w = 0; w < count; ++w) {
    const int first = count > 1 ? w * (frames - size) / (count - 1) : 0;
    std::vector<int> ids;
    std::vector<SE3> true_poses;
    for (int k = 0; k < size; ++k) {
      ids.push_back(scene.frames[static_cast<std::size_t>(first + k)].id);
      true_poses.push_back(truth.at(ids.back()));
    }
    try {
      camber::LoadedFrames loaded = camber::stages::load(scene, ids, options.load);
      loaded.reference = ids.size() / 2;
      camber::Timings timings;
      const camber::Progress silent;
      const camber::StageRunner run(timings, silent);
      const camber::WindowEstimate window =
          camber::estimate_window(scene, std::move(loaded), options, run);
      const camber::LoadedFrames& used = window.road.frames;
      if (used.size() != ids.size()) {
        std::printf("%s %d: only %zu frames within reach\n", path.c_str(), first, used.size());
        continue;
      }
      const camber::MotionEstimate& motion = window.refined.motion;
      std::size_t longest = 0;
      for (std::size_t k = 0; k < ids.size(); ++k) {
        const auto length = [&](std::size_t i) {
          return motion.frame_from_reference[i].translation().norm();
        };
        if (length(k) > length(longest)) longest = k;
      }
      Window result;
      result.scene = path;
      result.first = first;
      result.poses = camber::metric_poses(
          motion, used.reference, window.judged.road,
          camber::CameraUncertainty(used.camera, used.camera_sigma, window.scaled.scale_by_focal));
      result.off = off_by(result.poses, true_poses, used.reference, longest);
      const Eigen::Index last = result.off.size() - 1;
      result.sigma = std::sqrt(result.poses.covariance()(last, last));
      result.verdict = window.judged.scale.sigma;
      out->push_back(std::move(result));
    } catch (const camber::NoAnswerError& error) {
      std::printf("%s %d: %s\n", path.c_str(), first, error.what());
    }
  }
}

/// What chi-square of so many degrees of freedom is below with a probability of 0.95 (Wilson and
/// Hilferty, 1931).
double upper_95(double freedom) {
  const double v = 2.0 / (9.0 * freedom);
  return freedom * std::pow(1.0 - v + 1.6448536 * std::sqrt(v), 3);
}

void print(const char* what, const std::vector<Window>& windows,
           const std::vector<Eigen::Index>& rows_of_pose, bool with_scale) {
  double sum = 0.0;
  int inside = 0;
  for (const Window& w : windows) {
    std::vector<Eigen::Index> rows;
    const Eigen::Index last = w.off.size() - 1;
    for (Eigen::Index pose = 0; pose < last; pose += 6) {
      for (const Eigen::Index r : rows_of_pose) rows.push_back(pose + r);
    }
    if (with_scale) rows.push_back(last);
    const Eigen::MatrixXd covariance = w.poses.covariance()(rows, rows);
    const Eigen::VectorXd off = w.off(rows);
    const double squared = off.dot(covariance.ldlt().solve(off));
    const auto freedom = static_cast<double>(rows.size());
    sum += squared / freedom;
    inside += squared < upper_95(freedom) ? 1 : 0;
  }
  const auto count = static_cast<double>(windows.size());
  std::printf("%s: chi-square over its freedom %.2f, inside 95 %%: %.1f %% of %zu windows\n", what,
              sum / count, 100.0 * inside / count, windows.size());
}

nlohmann::json rows_of(const Eigen::MatrixXd& m) {
  nlohmann::json out = nlohmann::json::array();
  for (Eigen::Index i = 0; i < m.rows(); ++i) {
    out.push_back(std::vector<double>());
    for (Eigen::Index j = 0; j < m.cols(); ++j) out.back().push_back(m(i, j));
  }
  return out;
}

}  // namespace

int main(int argc, char** argv) try {
  std::vector<std::string> scenes;
  int count = 4, size = 5;
  std::string dump;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const bool more = i + 1 < argc;
    if (word == "--windows" && more) {
      count = std::stoi(argv[++i]);
    } else if (word == "--size" && more) {
      size = std::stoi(argv[++i]);
    } else if (word == "--dump" && more) {
      dump = argv[++i];
    } else {
      scenes.push_back(word);
    }
  }
  if (scenes.empty() || count < 1 || size < 2) {
    std::fprintf(stderr, "bench_metric_poses SCENE... [--windows 4] [--size 5] [--dump FILE]\n");
    return 2;
  }
  std::vector<Window> windows;
  for (const std::string& scene : scenes) add_windows(scene, count, size, &windows);
  if (windows.empty()) return 1;
  if (!dump.empty()) {
    std::ofstream out(dump);
    for (const Window& w : windows) {
      nlohmann::json row = {{"scene", w.scene},      {"first", w.first},
                            {"off", rows_of(w.off)}, {"own", rows_of(w.poses.own)},
                            {"sigma", w.sigma},      {"verdict", w.verdict}};
      for (const auto& error : w.poses.common) row["common"][error.name] = rows_of(error.by);
      out << row.dump() << "\n";
    }
  }
  // The scale is that of the longest baseline: among the poses it is known already.
  print("poses", windows, {0, 1, 2, 3, 4, 5}, false);
  print("rotations", windows, {0, 1, 2}, false);
  print("translations", windows, {3, 4, 5}, false);
  print("scale", windows, {}, true);
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "bench_metric_poses: %s\n", error.what());
  return 2;
}
