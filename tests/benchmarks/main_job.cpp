// The main job on real and rendered scenes against their truth: one table for each set of data, and
// where the time goes. Run with no arguments; data: $CAMBER_DATA, else ../shared/data.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/core/memory.h"
#include "camber/evaluate/metrics.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/plane/fit_plane.h"
#include "camber/scene/import_kitti.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  const double at = share * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return values[below] + (at - static_cast<double>(below)) * (values[above] - values[below]);
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double v : values) sum += v;
  return values.empty() ? std::nan("") : sum / static_cast<double>(values.size());
}

bool list_cars = false;

Reconstruction run(const Scene& scene, const std::vector<int>& frames,
                   const ReconstructOptions& options = {}) {
  return reconstruct(scene, frames, options);
}

bool available(const fs::path& path) {
  if (fs::exists(path)) return true;
  std::printf("skipped: no %s\n", path.string().c_str());
  return false;
}

/// Rendered steep roads: heights under the true cars of the middle frame, scale, motion.
void steep_scenes(const fs::path& folder, int first, int last, const char* title,
                  const ReconstructOptions& options = {}) {
  std::printf("\n## %s\n", title);
  if (!available(folder)) return;
  std::vector<fs::path> scenes;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (fs::exists(entry.path() / "scene.json")) scenes.push_back(entry.path());
  }
  std::sort(scenes.begin(), scenes.end());
  std::map<int, std::vector<double>> heights, centres;
  std::vector<double> normals, scales, directions, inside;
  int counted = 0, found = 0, no_ego = 0, scale_inside = 0, near = 0, covered = 0;
  for (const fs::path& path : scenes) {
    const Scene scene = read_scene(path);
    std::vector<int> ids;
    for (int k = first; k <= last; ++k) ids.push_back(scene.frames[static_cast<std::size_t>(k)].id);
    try {
      const Reconstruction result = run(scene, ids, options);
      const SceneMetrics metrics =
          evaluate_scene(scene, result.surface, result.vehicles, result.run);
      scales.push_back(std::abs(metrics.scale_error));
      if (list_cars) {
        std::printf("  %s: scale %+.2f %% +- %.2f %%, direction %.3f deg\n",
                    path.filename().string().c_str(), 100 * metrics.scale_error,
                    100 * result.surface.scale_sigma, metrics.direction_error * kDegrees);
      }
      scale_inside += std::abs(metrics.scale_error) <= 1.96 * result.surface.scale_sigma;
      directions.push_back(metrics.direction_error * kDegrees);
      for (const TruthFrame& frame : scene.truth->frames) {
        if (frame.id != result.reference_frame) continue;
        for (const TruthVehicle& vehicle : frame.vehicles) {
          if (!is_counted(vehicle, scene.camera)) continue;
          ++counted;
          if (vehicle.pose.bottom_center().norm() > 40.0) continue;
          ++near;
          covered += result.surface.query(vehicle.pose.bottom_center()).status != Status::kFailed;
        }
      }
      for (const VehicleError& error : metrics.vehicles) {
        if (error.frame != result.reference_frame) continue;
        ++found;
        const int bin = error.distance <= 15 ? 0 : error.distance <= 30 ? 1 : 2;
        heights[bin].push_back(std::abs(error.height_error));
        centres[bin].push_back(error.center_error);
        normals.push_back(error.normal_error * kDegrees);
        inside.push_back(std::abs(error.height_error) <= 1.96 * error.height_sigma);
        if (list_cars) {
          std::printf(
              "  %s %2d %5.1f m: height %+.3f +- %.3f (%+.1f), normal %.2f deg, centre %.2f\n",
              path.filename().string().c_str(), error.truth_id, error.distance, error.height_error,
              error.height_sigma, error.height_error / error.height_sigma,
              error.normal_error * kDegrees, error.center_error);
        }
      }
    } catch (const NoAnswerError& error) {
      ++no_ego;
      std::printf("%s: %s\n", path.filename().string().c_str(), error.what());
    }
  }
  const char* const names[] = {"<= 15 m", "15-30 m", "> 30 m"};
  for (int bin = 0; bin < 3; ++bin) {
    std::printf(
        "%-8s %3zu cars: ground height error median %.3f m, 90 %% %.3f m; centre error "
        "mean %.2f m, median %.2f m\n",
        names[bin], heights[bin].size(), quantile(heights[bin], 0.5), quantile(heights[bin], 0.9),
        mean(centres[bin]), quantile(centres[bin], 0.5));
  }
  std::printf(
      "normals %.2f deg in the median; stated 95 %% intervals of the heights hold for %.0f %%"
      "\n",
      quantile(normals, 0.5), 100.0 * mean(inside));
  std::printf(
      "counted %d, found by the detections %d; covered within 40 m: %d of %d; scenes without "
      "an ego plane: %d\n",
      counted, found, covered, near, no_ego);
  std::printf(
      "scale error %.2f %% in the median, %.2f %% at 90 %%, inside its 95 %% interval in %d "
      "of %zu scenes; direction of travel %.3f deg in the median\n",
      100 * quantile(scales, 0.5), 100 * quantile(scales, 0.9), scale_inside, scales.size(),
      quantile(directions, 0.5));
}

/// KITTI tracking 0009: speed and the ground under labelled vehicles, label boxes as detections.
void tracking_clip(const fs::path& folder, int frames) {
  std::printf(
      "\n## KITTI tracking 0009, %d of the frames 48 to 53, label boxes as detections, no masks\n",
      frames);
  if (!available(folder)) return;
  KittiImportOptions import;
  import.images = folder / "image_02";
  import.calibration = {folder / "calib_0009.txt"};
  import.labels = folder / "label_02_0009.txt";
  import.detections_from_labels = true;
  const Scene scene = import_kitti(import);
  std::vector<double> all, far;
  for (int first = 48; first + frames - 1 <= 53; ++first) {
    std::vector<int> ids;
    for (int k = 0; k < frames; ++k) ids.push_back(first + k);
    const Reconstruction result = run(scene, ids);
    const SceneMetrics metrics = evaluate_scene(scene, result.surface, result.vehicles, result.run);
    std::vector<double> errors;
    for (const VehicleError& error : metrics.vehicles) {
      if (error.distance >= 35.0) continue;
      // The label of track 1 is an upright box on a cross slope: its bottom is 0.16 m too low.
      const double off = std::abs(error.height_error - (error.truth_id == 1 ? 0.16 : 0.0));
      far.push_back(off);
      if (error.distance < 25.0) errors.push_back(off);
    }
    all.insert(all.end(), errors.begin(), errors.end());
    const auto& cameras = result.run.cameras;
    std::printf(
        "frames %d-%d: %.4f and %.4f m per frame; height error below 25 m mean %.3f m (%zu "
        "vehicles)\n",
        first, first + frames - 1,
        (cameras[1].reference_from_camera.inverse() * cameras[0].reference_from_camera)
            .translation()
            .norm(),
        (cameras[2].reference_from_camera.inverse() * cameras[1].reference_from_camera)
            .translation()
            .norm(),
        mean(errors), errors.size());
  }
  std::printf("mean below 25 m: %.3f m; below 35 m: %.3f m\n", mean(all), mean(far));
}

/// KITTI odometry 06: direction and length of the translation over all consecutive triplets.
void odometry(const fs::path& folder) {
  std::printf("\n## KITTI odometry 06, all consecutive triplets, no masks\n");
  if (!available(folder)) return;
  KittiImportOptions import;
  import.images = folder / "image_0";
  import.calibration = {folder / "calib.txt"};
  import.poses = folder / "poses.txt";
  const Scene scene = import_kitti(import);
  std::vector<double> directions, lengths, signed_lengths;
  int inside = 0;
  for (std::size_t k = 1; k + 1 < scene.frames.size(); ++k) {
    const Reconstruction result =
        run(scene, {scene.frames[k - 1].id, scene.frames[k].id, scene.frames[k + 1].id});
    std::vector<SE3> known;
    for (std::size_t j = k - 1; j <= k + 1; ++j) {
      known.push_back(*scene.truth->frames[j].world_from_camera);
    }
    for (std::size_t j = 0; j < 2; ++j) {
      const SE3 truth = known[j].inverse() * known[j + 1];
      const SE3 estimate = result.run.cameras[j].reference_from_camera.inverse() *
                           result.run.cameras[j + 1].reference_from_camera;
      directions.push_back(angle_between(truth.translation(), estimate.translation()) * kDegrees);
      const double ratio = estimate.translation().norm() / truth.translation().norm() - 1.0;
      lengths.push_back(std::abs(ratio));
      signed_lengths.push_back(ratio);
      inside += std::abs(ratio) <= 1.96 * result.surface.scale_sigma;
    }
  }
  std::printf("direction: median %.3f deg, 90 %% %.3f deg\n", quantile(directions, 0.5),
              quantile(directions, 0.9));
  std::printf(
      "length: median %.2f %%, 90 %% %.2f %%; from the 10th to the 90th percentile %+.2f to "
      "%+.2f %%; inside the stated 95 %% interval %d of %zu\n",
      100 * quantile(lengths, 0.5), 100 * quantile(lengths, 0.9),
      100 * quantile(signed_lengths, 0.1), 100 * quantile(signed_lengths, 0.9), inside,
      lengths.size());
}

/// KITTI raw drive 0052, crawling among moving traffic: ego plane and road points against the
/// laser. Without frames the command's own choice among the list.
void crawling(const fs::path& folder, const std::string& list, std::vector<int> frames) {
  std::printf("\n## KITTI raw 2011_09_26 drive 0052, frames %s, no masks, no detections\n",
              list.c_str());
  if (!available(folder)) return;
  test::TemporaryFolder temporary;
  KittiImportOptions import;
  import.images = folder / "image_02";
  import.calibration = {folder / "calib.txt"};
  import.poses = folder / "poses_from_lidar.txt";
  import.velodyne = folder / "velodyne";
  import.frames = list;
  import.camera = 2;
  const fs::path manifest = temporary.path() / "scene.json";
  import_kitti_to(import, manifest);
  if (frames.empty()) {
    // The laser's scan that is compared with belongs to the reference frame.
    frames = choose_frames(read_scene(manifest)).ids;
    std::printf("frames chosen by default: %d, %d, %d\n", frames[0], frames[1], frames[2]);
    import.reference_frame = frames[1];
    import_kitti_to(import, manifest);
  }
  const Scene scene = read_scene(manifest);
  const Reconstruction result = run(scene, frames);
  const RoadCloud laser = read_cloud(scene.truth->cloud);

  // The road ahead up to 15 m, within 3 m to each side.
  RoadCloud ahead;
  for (const Eigen::Vector3f& p : laser.points) {
    if (p.z() > 3 && p.z() < 15 && std::abs(p.x()) < 3 && p.y() > 1.2f && p.y() < 2.1f) {
      ahead.points.push_back(p);
    }
  }
  PlaneFitOptions options;
  options.up = Eigen::Vector3d(0, -1, 0);
  const PlaneFit fit = fit_plane(ahead, options);
  const Plane& ego = result.surface.find(result.surface.ego_patch)->plane.plane;
  std::printf(
      "ego plane: height %+.3f m, normal %.2f deg off the laser's (its camera height %.3f m)"
      "\n",
      ego.offset - fit.plane.plane.offset,
      kDegrees * angle_between(ego.normal, fit.plane.plane.normal), fit.plane.plane.offset);

  // Road points against the laser's surface: median height of the laser points within 0.75 m.
  std::map<std::pair<int, int>, std::vector<float>> grid;
  for (const Eigen::Vector3f& p : laser.points) {
    grid[{static_cast<int>(std::lround(2 * p.x())), static_cast<int>(std::lround(2 * p.z()))}]
        .push_back(p.y());
  }
  std::vector<double> inside, heights;
  for (std::size_t i = 0; i < result.cloud.size(); ++i) {
    const Eigen::Vector3d p = result.cloud.points[i].cast<double>();
    std::vector<float> near;
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dz = -1; dz <= 1; ++dz) {
        const auto cell = grid.find({static_cast<int>(std::lround(2 * p.x())) + dx,
                                     static_cast<int>(std::lround(2 * p.z())) + dz});
        if (cell != grid.end()) near.insert(near.end(), cell->second.begin(), cell->second.end());
      }
    }
    if (near.size() < 4) continue;
    std::sort(near.begin(), near.end());
    if (near.back() - near.front() > 0.15f) continue;  // not the road alone
    const double surface = near[near.size() / 2];
    const double error = (1.0 - surface / p.y()) * p.norm();  // along the viewing ray
    const double sigma = result.cloud.sigmas[i];
    inside.push_back(std::abs(error) <= 1.96 * sigma);
    heights.push_back(std::abs(p.y() - surface));
  }
  std::printf(
      "road points against the laser: %zu of %zu compared; height %.3f m in the median, "
      "%.3f m at 95 %%; stated 95 %% intervals hold for %.1f %%\n",
      inside.size(), result.cloud.size(), quantile(heights, 0.5), quantile(heights, 0.95),
      100 * mean(inside));
  // The surface where it is covered and flat in the laser's cells of half a metre.
  std::vector<double> surface_errors;
  for (const auto& [cell, ys] : grid) {
    const double x = 0.5 * cell.first, z = 0.5 * cell.second;
    if (z < 4.0 || z > 25.0 || ys.size() < 3) continue;
    std::vector<float> sorted = ys;
    std::sort(sorted.begin(), sorted.end());
    if (sorted.back() - sorted.front() > 0.1f) continue;
    const double y = sorted[sorted.size() / 2];
    if (y < 1.2 || y > 2.1) continue;
    const SurfaceQuery found = result.surface.query({x, y, z}, 0.25);
    if (found.status != Status::kFailed) surface_errors.push_back(std::abs(found.point.y() - y));
  }
  std::printf(
      "surface against the laser up to 25 m: %zu cells of 0.5 m; %.3f m in the median, %.3f m at "
      "95 %%\n",
      surface_errors.size(), quantile(surface_errors, 0.5), quantile(surface_errors, 0.95));
  const SceneMetrics metrics = evaluate_scene(scene, result.surface, result.vehicles, result.run);
  std::printf("motion against poses from the laser: length %+.2f %%, direction %.3f deg\n",
              100 * metrics.scale_error, metrics.direction_error * kDegrees);
}

/// Computing stages of one triplet, median of five runs.
void timing(const Scene& scene, const std::vector<int>& frames, const char* name) {
  std::map<std::string, std::vector<double>> stages;
  std::vector<double> sums;
  for (int repeat = 0; repeat < 6; ++repeat) {
    const Reconstruction result = run(scene, frames);
    if (repeat == 0) continue;  // warm-up
    double sum = 0.0;
    for (const auto& [stage, milliseconds] : result.run.timings.stages()) {
      stages[stage].push_back(milliseconds);
      sum += milliseconds;
    }
    sums.push_back(sum);
  }
  std::printf("%s: %.0f ms in all;", name, quantile(sums, 0.5));
  for (const auto& [stage, values] : stages) {
    std::printf(" %s %.0f", stage.c_str(), quantile(values, 0.5));
  }
  std::printf("\n");
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using namespace camber;
  keep_freed_memory();  // as the command does
  // Arguments name the sections to run; none: all. --cars lists every vehicle of the steep scenes.
  std::set<std::string> sections;
  for (int i = 1; i < argc; ++i) {
    if (std::string(argv[i]) == "--cars") {
      list_cars = true;
    } else {
      sections.insert(argv[i]);
    }
  }
  const auto wanted = [&](const char* name) { return sections.empty() || sections.count(name); };
  const fs::path data = test::data_dir();
  std::printf("# Main job\n");
  ReconstructOptions no_masks, once;
  no_masks.use_masks = false;
  once.rounds = 0;
  once.ground = "matches";
  const fs::path steep = data / "steep-scenes";
  if (wanted("steep3")) steep_scenes(steep, 1, 3, "Steep scenes, triplet around the middle frame");
  if (wanted("steep5")) steep_scenes(steep, 0, 4, "Steep scenes, all five frames");
  if (wanted("nomasks")) {
    steep_scenes(steep, 1, 3, "Steep scenes, triplet, masks not read", no_masks);
  }
  if (wanted("once")) {
    steep_scenes(steep, 1, 3,
                 "Steep scenes, triplet, matched once (plain flow, as in the paper's way)", once);
  }
  if (wanted("tracking")) {
    tracking_clip(data / "kitti-tracking-0009-clip", 3);
    tracking_clip(data / "kitti-tracking-0009-clip", 5);
  }
  if (wanted("odometry")) odometry(data / "kitti-odometry-06");
  if (wanted("crawling")) {
    const fs::path drive = data / "kitti-raw-2011_09_26-drive_0052";
    crawling(drive, "0:11", {});
    crawling(drive, "0:10:5", {0, 5, 10});
    crawling(drive, "1:11:5", {1, 6, 11});
    crawling(drive, "2:10:4", {2, 6, 10});
    crawling(drive, "0:10:2", {0, 2, 4, 6, 8, 10});
    crawling(drive, "0:11", {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11});
  }
  if (wanted("ablation")) {
    const auto row = [&](const char* title, int first, int last,
                         const std::function<void(ReconstructOptions&)>& change) {
      ReconstructOptions options;
      change(options);
      steep_scenes(steep, first, last, title, options);
    };
    row("Ablation: flow and one plane (ego plane for all)", 1, 3, [](ReconstructOptions& o) {
      o.vehicles.method = VehicleMethod::kCoplanar;
      o.rounds = 0;
      o.photometric = false;
    });
    row("Ablation: flow, smooth ground", 1, 3, [](ReconstructOptions& o) {
      o.rounds = 0;
      o.photometric = false;
    });
    row("Ablation: matched again with the ground known", 1, 3,
        [](ReconstructOptions& o) { o.photometric = false; });
    row("Ablation: without painted markings", 1, 3,
        [](ReconstructOptions& o) { o.scale.use_markings = false; });
    row("Ablation: without the road's width", 1, 3,
        [](ReconstructOptions& o) { o.scale.use_road_width = false; });
    row("Ablation: matches, intensities, markings, width and vehicles", 1, 3,
        [](ReconstructOptions&) {});
    row("Ablation: the same, two frames", 1, 2, [](ReconstructOptions&) {});
    row("Ablation: the same, five frames", 0, 4, [](ReconstructOptions&) {});
    row("Ablation: the same, three frames, masks not read", 1, 3,
        [](ReconstructOptions& o) { o.load.use_masks = false; });
    row("Ablation: the same, five frames, masks not read", 0, 4,
        [](ReconstructOptions& o) { o.load.use_masks = false; });
  }
  if (!wanted("time")) return 0;
  std::printf("\n## Time of the computing stages, pictures left out, median of five runs\n");
  const Scene sample = read_scene(test::source_dir() / "samples" / "steep_hill");
  timing(sample, select_frames(sample, ""), "samples/steep_hill, three 1242 x 375 frames");
  if (fs::exists(data / "kitti-tracking-0009-clip")) {
    KittiImportOptions import;
    import.images = data / "kitti-tracking-0009-clip" / "image_02";
    import.calibration = {data / "kitti-tracking-0009-clip" / "calib_0009.txt"};
    timing(import_kitti(import), {48, 49, 50}, "KITTI tracking 0009, frames 48 to 50");
  }
  return 0;
}
