// The main job on real and rendered scenes against their truth: one table for each set of data, and
// where the time goes. Run with no arguments, or the names of parts; --help lists them.
// The seed is that of reconstruct(). Data: $CAMBER_DATA, else ../shared/data.

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "benchmarks/report.h"
#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "camber/core/memory.h"
#include "camber/evaluate/metrics.h"
#include "camber/import/import_kitti.h"
#include "camber/pipeline/detect_frames.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/plane/fit_plane.h"
#include "huge_pages.h"
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

/// A run of the program with one seed.
struct Bench {
  bench::Report& report;
  bool list_cars = false;

  Reconstruction run(const Scene& scene, const std::vector<int>& frames,
                     ReconstructOptions options = {}) const {
    options.seed = report.seed();
    mask_vehicles(scene, frames, {}, &options.load);
    return reconstruct(scene, frames, options);
  }
};

bool available(const fs::path& path) {
  if (fs::exists(path)) return true;
  std::printf("skipped: no %s\n", path.string().c_str());
  return false;
}

/// One way to run the steep scenes.
struct SteepRun {
  std::string key;      ///< of its tables, "steep3"
  std::string section;  ///< of the program
  std::string title;
  int first = 1, last = 3;  ///< indices of the frames
  ReconstructOptions options = {};
};

/// What the steep scenes give together.
struct SteepFigures {
  std::map<int, std::vector<double>> heights, centres;  // by bin of distance
  std::vector<double> normals, scales, directions, inside;
  int counted = 0, found = 0, no_ego = 0, scale_inside = 0, near = 0, covered = 0;
};

const char* const kBins[] = {"<= 15 m", "15-30 m", "> 30 m"};

/// Adds one scene's result; `items` get its raw values.
void add_scene(const std::string& name, const Scene& scene, const Reconstruction& result,
               bool list_cars, bench::Items& scene_items, bench::Items& cover_items,
               bench::Items& car_items, SteepFigures& f) {
  const SceneMetrics metrics = evaluate_scene(scene, result.surface, result.vehicles, result.run);
  const bool scale_inside = std::abs(metrics.scale_error) <= 1.96 * result.surface.scale_sigma;
  f.scales.push_back(std::abs(metrics.scale_error));
  f.scale_inside += scale_inside;
  f.directions.push_back(metrics.direction_error * kDegrees);
  scene_items.add(name, {100 * std::abs(metrics.scale_error), 100 * metrics.scale_error,
                         100 * result.surface.scale_sigma, scale_inside ? 1.0 : 0.0,
                         metrics.direction_error * kDegrees});
  if (list_cars) {
    std::printf("  %s: scale %+.2f %% +- %.2f %%, direction %.3f deg\n", name.c_str(),
                100 * metrics.scale_error, 100 * result.surface.scale_sigma,
                metrics.direction_error * kDegrees);
  }
  for (const TruthFrame& frame : scene.truth->frames) {
    if (frame.id != result.reference_frame) continue;
    for (const TruthVehicle& vehicle : frame.vehicles) {
      if (!is_counted(vehicle, scene.camera)) continue;
      ++f.counted;
      if (vehicle.pose.bottom_center().norm() > 40.0) continue;
      const bool covered =
          result.surface.query(vehicle.pose.bottom_center()).status != Status::kFailed;
      ++f.near;
      f.covered += covered;
      cover_items.add(name + "/" + std::to_string(vehicle.id), {covered ? 1.0 : 0.0});
    }
  }
  for (const VehicleError& error : metrics.vehicles) {
    if (error.frame != result.reference_frame) continue;
    ++f.found;
    const int bin = error.distance <= 15 ? 0 : error.distance <= 30 ? 1 : 2;
    const bool inside = std::abs(error.height_error) <= 1.96 * error.height_sigma;
    f.heights[bin].push_back(std::abs(error.height_error));
    f.centres[bin].push_back(error.center_error);
    f.normals.push_back(error.normal_error * kDegrees);
    f.inside.push_back(inside);
    car_items.add(name + "/" + std::to_string(error.truth_id),
                  {std::abs(error.height_error), error.height_sigma, inside ? 1.0 : 0.0,
                   error.normal_error * kDegrees, error.center_error});
    if (list_cars) {
      std::printf("  %s %2d %5.1f m: height %+.3f +- %.3f (%+.1f), normal %.2f deg, centre %.2f\n",
                  name.c_str(), error.truth_id, error.distance, error.height_error,
                  error.height_sigma, error.height_error / error.height_sigma,
                  error.normal_error * kDegrees, error.center_error);
    }
  }
}

void print_steep(const SteepRun& which, const SteepFigures& f, bench::Report& report) {
  bench::Table& by_distance = report.table(
      which.key + ".distance", which.title + ": ground under the cars and their centres",
      which.section,
      {bench::label("distance"), bench::value("cars"), bench::lower("height error, median", "m"),
       bench::lower("height error, 90 %", "m"), bench::lower("centre error, mean", "m"),
       bench::lower("centre error, median", "m")});
  for (int bin = 0; bin < 3; ++bin) {
    const auto of = [&](const std::map<int, std::vector<double>>& values) {
      const auto found = values.find(bin);
      return found == values.end() ? std::vector<double>() : found->second;
    };
    const std::vector<double> heights = of(f.heights), centres = of(f.centres);
    std::printf(
        "%-8s %3zu cars: ground height error median %.3f m, 90 %% %.3f m; centre error "
        "mean %.2f m, median %.2f m\n",
        kBins[bin], heights.size(), quantile(heights, 0.5), quantile(heights, 0.9), mean(centres),
        quantile(centres, 0.5));
    by_distance.row({kBins[bin], heights.size(), quantile(heights, 0.5), quantile(heights, 0.9),
                     mean(centres), quantile(centres, 0.5)});
  }
  std::printf(
      "normals %.2f deg in the median; stated 95 %% intervals of the heights hold for %.0f %%"
      "\n",
      quantile(f.normals, 0.5), 100.0 * mean(f.inside));
  std::printf(
      "counted %d, found by the detections %d; covered within 40 m: %d of %d; scenes without "
      "an ego plane: %d\n",
      f.counted, f.found, f.covered, f.near, f.no_ego);
  std::printf(
      "scale error %.2f %% in the median, %.2f %% at 90 %%, inside its 95 %% interval in %d "
      "of %zu scenes; direction of travel %.3f deg in the median\n",
      100 * quantile(f.scales, 0.5), 100 * quantile(f.scales, 0.9), f.scale_inside, f.scales.size(),
      quantile(f.directions, 0.5));
  report
      .table(
          which.key + ".scenes", which.title + ": scale, motion, coverage", which.section,
          {bench::lower("normals, median", "deg"), bench::value("heights inside their 95 %", "%"),
           bench::value("cars counted"), bench::higher("found by the detections"),
           bench::higher("covered within 40 m"), bench::value("of"),
           bench::lower("scenes without an ego plane"), bench::lower("scale error, median", "%"),
           bench::lower("scale error, 90 %", "%"), bench::value("scales inside their 95 %"),
           bench::value("scenes"), bench::lower("direction of travel, median", "deg")})
      .row({quantile(f.normals, 0.5), 100.0 * mean(f.inside), f.counted, f.found, f.covered, f.near,
            f.no_ego, 100 * quantile(f.scales, 0.5), 100 * quantile(f.scales, 0.9), f.scale_inside,
            f.scales.size(), quantile(f.directions, 0.5)});
}

/// Rendered steep roads: heights under the true cars of the middle frame, scale, motion.
void steep_scenes(const Bench& bench, const fs::path& folder, const SteepRun& which) {
  std::printf("\n## %s\n", which.title.c_str());
  if (!available(folder)) return;
  std::vector<fs::path> scenes;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (fs::exists(entry.path() / "scene.json")) scenes.push_back(entry.path());
  }
  std::sort(scenes.begin(), scenes.end());
  bench::Items& scene_items = bench.report.items(
      which.key + ".scenes",
      {bench::lower("scale error, absolute", "%"), bench::value("scale error", "%"),
       bench::value("its sigma", "%"), bench::value("inside its 95 %"),
       bench::lower("direction of travel", "deg")});
  bench::Items& cover_items =
      bench.report.items(which.key + ".covered", {bench::higher("covered within 40 m")});
  bench::Items& car_items = bench.report.items(
      which.key + ".cars", {bench::lower("height error, absolute", "m"),
                            bench::value("its sigma", "m"), bench::value("inside its 95 %"),
                            bench::lower("normal", "deg"), bench::lower("centre", "m")});
  SteepFigures figures;
  for (const fs::path& path : scenes) {
    const std::string name = path.filename().string();
    const Scene scene = read_scene(path);
    std::vector<int> ids;
    for (int k = which.first; k <= which.last; ++k) {
      ids.push_back(scene.frames[static_cast<std::size_t>(k)].id);
    }
    try {
      add_scene(name, scene, bench.run(scene, ids, which.options), bench.list_cars, scene_items,
                cover_items, car_items, figures);
    } catch (const NoAnswerError& error) {
      ++figures.no_ego;
      std::printf("%s: %s\n", name.c_str(), error.what());
    }
  }
  print_steep(which, figures, bench.report);
}

/// KITTI tracking 0009: speed and the ground under labelled vehicles, label boxes as detections.
void tracking_clip(const Bench& bench, const fs::path& folder, int frames) {
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
  const std::string key = "tracking." + std::to_string(frames);
  const std::string title = "KITTI tracking 0009, " + std::to_string(frames) + " frames";
  bench::Items& items = bench.report.items(key, {bench::lower("height error, absolute", "m")});
  bench::Table& by_frames = bench.report.table(
      key + ".frames", title, "tracking",
      {bench::label("frames"), bench::value("first step", "m"), bench::value("second step", "m"),
       bench::lower("height error below 25 m, mean", "m"), bench::value("vehicles")});
  std::vector<double> all, far;
  for (int first = 48; first + frames - 1 <= 53; ++first) {
    std::vector<int> ids;
    for (int k = 0; k < frames; ++k) ids.push_back(first + k);
    const std::string name = std::to_string(first) + "-" + std::to_string(first + frames - 1);
    const Reconstruction result = bench.run(scene, ids);
    const SceneMetrics metrics = evaluate_scene(scene, result.surface, result.vehicles, result.run);
    std::vector<double> errors;
    for (const VehicleError& error : metrics.vehicles) {
      if (error.distance >= 35.0) continue;
      // The label of track 1 is an upright box on a cross slope: its bottom is 0.16 m too low.
      const double off = std::abs(error.height_error - (error.truth_id == 1 ? 0.16 : 0.0));
      far.push_back(off);
      items.add(name + "/" + std::to_string(error.frame) + "/" + std::to_string(error.truth_id),
                {off});
      if (error.distance < 25.0) errors.push_back(off);
    }
    all.insert(all.end(), errors.begin(), errors.end());
    const auto& cameras = result.run.cameras;
    const auto distance = [&](std::size_t from, std::size_t to) {
      return (cameras[to].reference_from_camera.inverse() * cameras[from].reference_from_camera)
          .translation()
          .norm();
    };
    std::printf(
        "frames %s: %.4f and %.4f m per frame; height error below 25 m mean %.3f m (%zu "
        "vehicles)\n",
        name.c_str(), distance(0, 1), distance(1, 2), mean(errors), errors.size());
    by_frames.row({name, distance(0, 1), distance(1, 2), mean(errors), errors.size()});
  }
  std::printf("mean below 25 m: %.3f m; below 35 m: %.3f m\n", mean(all), mean(far));
  bench.report
      .table(key, title + ", label boxes, no masks", "tracking",
             {bench::lower("height error below 25 m, mean", "m"), bench::lower("below 35 m", "m")})
      .row({mean(all), mean(far)});
}

/// KITTI odometry 06: direction and length of the translation over all consecutive triplets.
void odometry(const Bench& bench, const fs::path& folder) {
  std::printf("\n## KITTI odometry 06, all consecutive triplets, no masks\n");
  if (!available(folder)) return;
  KittiImportOptions import;
  import.images = folder / "image_0";
  import.calibration = {folder / "calib.txt"};
  import.poses = folder / "poses.txt";
  const Scene scene = import_kitti(import);
  bench::Items& items =
      bench.report.items("odometry", {bench::lower("direction", "deg"), bench::lower("length", "%"),
                                      bench::value("signed length", "%")});
  std::vector<double> directions, lengths, signed_lengths;
  int inside = 0;
  for (std::size_t k = 1; k + 1 < scene.frames.size(); ++k) {
    const Reconstruction result =
        bench.run(scene, {scene.frames[k - 1].id, scene.frames[k].id, scene.frames[k + 1].id});
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
      items.add(std::to_string(k) + "/" + std::to_string(j),
                {directions.back(), 100 * lengths.back(), 100 * ratio});
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
  bench.report
      .table("odometry", "KITTI odometry 06, all consecutive triplets, no masks", "odometry",
             {bench::lower("direction, median", "deg"), bench::lower("direction, 90 %", "deg"),
              bench::lower("length, median", "%"), bench::lower("length, 90 %", "%"),
              bench::value("signed length, 10 %", "%"), bench::value("signed length, 90 %", "%"),
              bench::value("inside their 95 %"), bench::value("of")})
      .row({quantile(directions, 0.5), quantile(directions, 0.9), 100 * quantile(lengths, 0.5),
            100 * quantile(lengths, 0.9), 100 * quantile(signed_lengths, 0.1),
            100 * quantile(signed_lengths, 0.9), inside, lengths.size()});
}

/// What a crawl is compared with: the laser's scan in the reference camera.
struct LaserFigures {
  double ego_height = 0.0, ego_normal = 0.0;  ///< m, deg, off the plane fitted to the laser
  std::size_t points = 0;                     ///< road points compared
  double points_median = 0.0, points_95 = 0.0, points_inside = 0.0;  ///< m, m, %
  std::size_t cells = 0;                                             ///< of the surface, of 0.5 m
  double cells_median = 0.0, cells_95 = 0.0;                         ///< m
};

/// Heights (camera y) of the laser's points in cells of half a metre.
using LaserGrid = std::map<std::pair<int, int>, std::vector<float>>;

LaserGrid make_grid(const RoadCloud& laser) {
  LaserGrid grid;
  for (const Eigen::Vector3f& p : laser.points) {
    grid[{static_cast<int>(std::lround(2 * p.x())), static_cast<int>(std::lround(2 * p.z()))}]
        .push_back(p.y());
  }
  return grid;
}

/// The ego plane against the laser's road ahead up to 15 m, within 3 m to each side.
void compare_ego_plane(const Reconstruction& result, const RoadCloud& laser, LaserFigures& f) {
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
  f.ego_height = ego.offset - fit.plane.plane.offset;
  f.ego_normal = kDegrees * angle_between(ego.normal, fit.plane.plane.normal);
  std::printf(
      "ego plane: height %+.3f m, normal %.2f deg off the laser's (its camera height %.3f m)"
      "\n",
      f.ego_height, f.ego_normal, fit.plane.plane.offset);
}

/// Road points against the laser's surface: median height of the laser points within 0.75 m.
void compare_points(const Reconstruction& result, const LaserGrid& grid, LaserFigures& f) {
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
  f.points = inside.size();
  f.points_median = quantile(heights, 0.5);
  f.points_95 = quantile(heights, 0.95);
  f.points_inside = 100 * mean(inside);
  std::printf(
      "road points against the laser: %zu of %zu compared; height %.3f m in the median, "
      "%.3f m at 95 %%; stated 95 %% intervals hold for %.1f %%\n",
      inside.size(), result.cloud.size(), f.points_median, f.points_95, f.points_inside);
}

/// The surface where it is covered and flat in the laser's cells of half a metre.
void compare_surface(const Reconstruction& result, const LaserGrid& grid, bench::Items& items,
                     LaserFigures& f) {
  std::vector<double> errors;
  for (const auto& [cell, ys] : grid) {
    const double x = 0.5 * cell.first, z = 0.5 * cell.second;
    if (z < 4.0 || z > 25.0 || ys.size() < 3) continue;
    std::vector<float> sorted = ys;
    std::sort(sorted.begin(), sorted.end());
    if (sorted.back() - sorted.front() > 0.1f) continue;
    const double y = sorted[sorted.size() / 2];
    if (y < 1.2 || y > 2.1) continue;
    const SurfaceQuery found = result.surface.query({x, y, z}, 0.25);
    if (found.status == Status::kFailed) continue;
    errors.push_back(std::abs(found.point.y() - y));
    // Neighbouring cells err alike: they form groups of 2.5 m.
    const auto group = [](int half_metres) {
      return std::to_string(static_cast<int>(std::floor(half_metres / 5.0)));
    };
    items.add(group(cell.first) + " " + group(cell.second) + "/" + std::to_string(cell.first) +
                  " " + std::to_string(cell.second),
              {errors.back()});
  }
  f.cells = errors.size();
  f.cells_median = quantile(errors, 0.5);
  f.cells_95 = quantile(errors, 0.95);
  std::printf(
      "surface against the laser up to 25 m: %zu cells of 0.5 m; %.3f m in the median, %.3f m at "
      "95 %%\n",
      f.cells, f.cells_median, f.cells_95);
}

/// KITTI raw drive 0052, crawling among moving traffic: ego plane and road points against the
/// laser. Without frames the command's own choice among the list.
void crawling(const Bench& bench, const fs::path& folder, const std::string& list,
              std::vector<int> frames, bench::Table* table) {
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
  std::string name = frames.empty() ? "chosen by default" : std::to_string(frames[0]);
  for (std::size_t k = 1; k < frames.size(); ++k) name += "," + std::to_string(frames[k]);
  if (frames.empty()) {
    // The laser's scan that is compared with belongs to the reference frame.
    frames = choose_frames(read_scene(manifest)).ids;
    std::printf("frames chosen by default: %s\n",
                fmt::format("{}", fmt::join(frames, ", ")).c_str());
    import.reference_frame = frames[frames.size() / 2];
    import_kitti_to(import, manifest);
  }
  const Scene scene = read_scene(manifest);
  const Reconstruction result = bench.run(scene, frames);
  const RoadCloud laser = read_cloud(scene.truth->cloud);
  const LaserGrid grid = make_grid(laser);
  LaserFigures f;
  compare_ego_plane(result, laser, f);
  compare_points(result, grid, f);
  compare_surface(result, grid,
                  bench.report.items("crawling." + name + ".cells",
                                     {bench::lower("height of the surface, absolute", "m")}),
                  f);
  const SceneMetrics metrics = evaluate_scene(scene, result.surface, result.vehicles, result.run);
  std::printf("motion against poses from the laser: length %+.2f %%, direction %.3f deg\n",
              100 * metrics.scale_error, metrics.direction_error * kDegrees);
  table->row({name, std::abs(f.ego_height), f.ego_normal, f.points, f.points_median, f.points_95,
              f.points_inside, f.cells, f.cells_median, f.cells_95,
              100 * std::abs(metrics.scale_error), metrics.direction_error * kDegrees});
}

void crawls(const Bench& bench, const fs::path& drive) {
  bench::Table& table = bench.report.table(
      "crawling", "KITTI raw drive 0052 against the laser, no masks, no detections", "crawling",
      {bench::label("frames"), bench::lower("ego plane, height", "m"),
       bench::lower("ego plane, normal", "deg"), bench::value("road points"),
       bench::lower("road points, median", "m"), bench::lower("road points, 95 %", "m"),
       bench::value("road points inside their 95 %", "%"), bench::value("cells of the surface"),
       bench::lower("surface, median", "m"), bench::lower("surface, 95 %", "m"),
       bench::lower("length", "%"), bench::lower("direction", "deg")});
  crawling(bench, drive, "0:11", {}, &table);
  crawling(bench, drive, "0:10:5", {0, 5, 10}, &table);
  crawling(bench, drive, "1:11:5", {1, 6, 11}, &table);
  crawling(bench, drive, "2:10:4", {2, 6, 10}, &table);
  crawling(bench, drive, "0:10:2", {0, 2, 4, 6, 8, 10}, &table);
  crawling(bench, drive, "0:11", {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}, &table);
}

/// What the ground is fitted to, and what else there is.
void ablation(const Bench& bench, const fs::path& steep) {
  const auto row = [&](const std::string& key, const std::string& title, int first, int last,
                       const std::function<void(ReconstructOptions&)>& change) {
    SteepRun which{"ablation." + key, "ablation", "Ablation: " + title, first, last, {}};
    change(which.options);
    steep_scenes(bench, steep, which);
  };
  row("one_plane", "flow and one plane (ego plane for all)", 1, 3, [](ReconstructOptions& o) {
    o.vehicles.method = VehicleMethod::kCoplanar;
    o.rounds = 0;
    o.photometric = false;
  });
  row("smooth", "flow, smooth ground", 1, 3, [](ReconstructOptions& o) {
    o.rounds = 0;
    o.photometric = false;
  });
  row("matched_again", "matched again with the ground known", 1, 3,
      [](ReconstructOptions& o) { o.photometric = false; });
  row("no_markings", "without painted markings", 1, 3,
      [](ReconstructOptions& o) { o.scale.use_markings = false; });
  row("no_road_width", "without the road's width", 1, 3,
      [](ReconstructOptions& o) { o.scale.use_road_width = false; });
  row("joint", "matches, intensities, markings, width and vehicles", 1, 3,
      [](ReconstructOptions&) {});
  row("two_frames", "the same, two frames", 1, 2, [](ReconstructOptions&) {});
  row("five_frames", "the same, five frames", 0, 4, [](ReconstructOptions&) {});
  row("no_masks", "the same, three frames, masks not read", 1, 3,
      [](ReconstructOptions& o) { o.load.use_masks = false; });
  row("five_no_masks", "the same, five frames, masks not read", 0, 4,
      [](ReconstructOptions& o) { o.load.use_masks = false; });
}

/// Computing stages of one triplet, median of five runs.
void timing(const Bench& bench, const Scene& scene, const std::vector<int>& frames,
            const char* name, bench::Table& table) {
  std::map<std::string, std::vector<double>> stages;
  std::vector<double> sums;
  for (int repeat = 0; repeat < 6; ++repeat) {
    const Reconstruction result = bench.run(scene, frames);
    if (repeat == 0) continue;  // warm-up
    double sum = 0.0;
    for (const auto& [stage, milliseconds] : result.run.timings.stages()) {
      stages[stage].push_back(milliseconds);
      sum += milliseconds;
    }
    sums.push_back(sum);
  }
  std::printf("%s: %.0f ms in all;", name, quantile(sums, 0.5));
  table.row({name, "all", quantile(sums, 0.5)});
  for (const auto& [stage, values] : stages) {
    std::printf(" %s %.0f", stage.c_str(), quantile(values, 0.5));
    table.row({name, stage, quantile(values, 0.5)});
  }
  std::printf("\n");
}

void timings(const Bench& bench, const fs::path& data) {
  std::printf("\n## Time of the computing stages, pictures left out, median of five runs\n");
  bench::Table& table =
      bench.report.table("time", "Computing stages of a triplet, median of five runs", "time",
                         {bench::label("input"), bench::label("stage"), bench::timing("time")});
  const Scene sample = read_scene(test::source_dir() / "samples" / "steep_hill");
  timing(bench, sample, select_frames(sample, ""), "samples/steep_hill, three 1242 x 375 frames",
         table);
  if (fs::exists(data / "kitti-tracking-0009-clip")) {
    KittiImportOptions import;
    import.images = data / "kitti-tracking-0009-clip" / "image_02";
    import.calibration = {data / "kitti-tracking-0009-clip" / "calib_0009.txt"};
    timing(bench, import_kitti(import), {48, 49, 50}, "KITTI tracking 0009, frames 48 to 50",
           table);
  }
}

void run_main_job(bench::Report& report) {
  const Bench bench{report, report.flag("--cars")};
  const fs::path data = test::data_dir(), steep = data / "steep-scenes";
  std::printf("# Main job\n");
  ReconstructOptions no_masks, once, joint_planes;
  no_masks.load.use_masks = false;
  joint_planes.vehicles.graph = false;
  once.rounds = 0;
  once.photometric = false;
  const SteepRun runs[] = {
      {"steep3", "steep3", "Steep scenes, triplet around the middle frame", 1, 3, {}},
      {"steep5", "steep5", "Steep scenes, all five frames", 0, 4, {}},
      {"nomasks", "nomasks", "Steep scenes, triplet, masks not read", 1, 3, no_masks},
      {"joint_planes", "joint_planes",
       "Steep scenes, triplet, vehicles by the joint covariance of all planes, not the graph", 1, 3,
       joint_planes},
      {"once", "once", "Steep scenes, triplet, matched once (plain flow, as in the paper's way)", 1,
       3, once},
  };
  for (const SteepRun& which : runs) {
    if (report.wanted(which.section)) steep_scenes(bench, steep, which);
  }
  if (report.wanted("tracking")) {
    tracking_clip(bench, data / "kitti-tracking-0009-clip", 3);
    tracking_clip(bench, data / "kitti-tracking-0009-clip", 5);
  }
  if (report.wanted("odometry")) odometry(bench, data / "kitti-odometry-06");
  if (report.wanted("crawling")) crawls(bench, data / "kitti-raw-2011_09_26-drive_0052");
  if (report.wanted("ablation")) ablation(bench, steep);
  if (report.wanted("time") && !report.accuracy_only()) timings(bench, data);
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using namespace camber;
  tools::start_with_huge_pages(argv);  // as the command does
  keep_freed_memory();
  const bench::Program program = {
      "bench_main_job",
      "The main job on real and rendered scenes against their truth",
      {"steep3", "steep5", "nomasks", "joint_planes", "once", "tracking", "odometry", "crawling",
       "ablation", "time"},
      {{"--cars", "", "List every vehicle of the steep scenes", false}}};
  return bench::run_program(program, argc, argv, run_main_job);
}
