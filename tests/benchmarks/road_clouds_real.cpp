// Patches and profiles of real road clouds against measured ground.

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "benchmarks/forest_road.h"
#include "benchmarks/road_clouds.h"
#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "camber/road/road_profile.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber::benchmarks {

using Eigen::Vector3d;

void forest_road(const Bench& bench) {
  std::printf("\n## als-forest-road with camera noise: along the centreline, grade over 10 m\n");
  const fs::path folder = test::data_dir() / "als-forest-road";
  if (!available(folder / "terrain.ply")) return;
  const ForestRoad road(folder);
  const std::vector<double> true_grade = smoothed_grade(road.station, road.height, 10.0);
  bench::Table& table = bench.report.table(
      "forest", "als-forest-road with camera noise: along the centreline, grade over 10 m", "real",
      {bench::label("points"), bench::label("with"), bench::value("patches"),
       bench::higher("covered", "%"), bench::lower("grade, mean", "deg"),
       bench::lower("grade, 95 %", "deg"), bench::lower("grade, worst", "deg"),
       bench::lower("height, mean", "mm"), bench::lower("height, 95 %", "mm"),
       bench::lower("height, worst", "mm")});
  bench::Items& items = bench.report.items(
      "forest", {bench::higher("covered", "%"), bench::lower("grade, mean", "deg"),
                 bench::lower("height, mean", "mm")});
  for (const ForestInput& input : kForestInputs) {
    std::vector<double> grade_errors, height_errors, covered, patch_counts;
    // One scene more or less moves the mean of a few sparse ones by a tenth.
    const std::uint64_t scenes = input.points > 100000 ? 5 : 16;
    for (std::uint64_t seed = 0; seed < scenes; ++seed) {
      const RoadCloud cloud = road.cloud(input, bench.of_cloud(seed));
      RoadSurfaceOptions options = bench.surface_options();
      options.driven_line = road.line;
      const std::size_t grades = grade_errors.size(), heights = height_errors.size(),
                        places = covered.size();
      const RoadSurfaceFit fit = fit_road_surface(cloud, options);
      patch_counts.push_back(static_cast<double>(fit.surface.patches.size()));
      const std::vector<ProfilePoint> profile = road_profile(fit.surface, road.line, {});
      for (const ProfilePoint& point : profile) {
        covered.push_back(point.status != Status::kFailed ? 1.0 : 0.0);
        const auto k = static_cast<std::size_t>(std::lround(point.station));
        if (k >= true_grade.size() || point.status == Status::kFailed) continue;
        height_errors.push_back(std::abs(point.height - road.height_at(point.station)));
        if (std::isfinite(point.grade) && std::isfinite(true_grade[k])) {
          grade_errors.push_back(std::abs(std::atan(point.grade) - std::atan(true_grade[k])) /
                                 kDegree);
        }
      }
      const auto mean_from = [](const std::vector<double>& values, std::size_t first) {
        return mean_of({values.begin() + static_cast<std::ptrdiff_t>(first), values.end()});
      };
      items.add(std::to_string(bench.of_cloud(seed)) + "/" + input.name +
                    (input.sigmas ? ", sigmas" : ", x y z"),
                {100 * mean_from(covered, places), mean_from(grade_errors, grades),
                 1e3 * mean_from(height_errors, heights)});
    }
    table.row({input.name, input.sigmas ? "sigmas" : "x y z", mean_of(patch_counts),
               100 * mean_of(covered), mean_of(grade_errors), quantile_of(grade_errors, 0.95),
               quantile_of(grade_errors, 1.0), 1e3 * mean_of(height_errors),
               1e3 * quantile_of(height_errors, 0.95), 1e3 * quantile_of(height_errors, 1.0)});
    std::printf(
        "%-21s %-6s %5.1f patches, covered %.1f %%; grade error mean %.3f deg (95 %% %.3f, worst "
        "%.3f); height error mean %.1f mm (95 %% %.1f, worst %.1f)\n",
        input.name, input.sigmas ? "sigmas" : "x y z", mean_of(patch_counts),
        100 * mean_of(covered), mean_of(grade_errors), quantile_of(grade_errors, 0.95),
        quantile_of(grade_errors, 1.0), 1e3 * mean_of(height_errors),
        1e3 * quantile_of(height_errors, 0.95), 1e3 * quantile_of(height_errors, 1.0));
  }
}

void city_sweep(const Bench& bench) {
  std::printf("\n## argoverse2-ground: a sweep against the measured ground\n");
  const fs::path folder = test::data_dir() / "argoverse2-ground" / "adcf7d18";
  const fs::path file = folder / "sweep_315973157959879000.ply";
  if (!available(file)) return;
  const RoadCloud sweep = read_cloud(file);
  const RoadCloud ground = read_cloud(folder / "ground.ply");
  const std::vector<double> pose = read_rows(folder / "sweep_315973157959879000_pose.csv").at(0);
  const Eigen::Quaterniond q(pose[1], pose[2], pose[3], pose[4]);
  const Vector3d t(pose[5], pose[6], pose[7]);
  const std::vector<int>& drivable = ground.labels.at("drivable");
  RoadSurfaceOptions options = bench.surface_options();
  options.num_threads = 1;
  RoadSurfaceFit fit;
  const double ms = least_ms(bench.repeats(5), [&] { fit = fit_road_surface(sweep, options); });
  int road = 0;
  for (const PlanePatch& patch : fit.surface.patches) road += patch.kind == PatchKind::kRoad;
  std::printf("%zu points, %.1f ms, %zu patches, %d of them road\n", sweep.size(), ms,
              fit.surface.patches.size(), road);
  bench::Table& table = bench.report.table(
      "sweep", "argoverse2-ground: a sweep against the measured ground, drivable cells", "real",
      {bench::label("within"), bench::label("patches"), bench::higher("covered", "%"),
       bench::lower("height, median", "mm"), bench::lower("height, 95 %", "mm"),
       bench::lower("height, 99 %", "mm"), bench::value("signed median", "mm")});
  bench.report
      .table("sweep.time", "argoverse2-ground: one sweep", "real",
             {bench::value("points"), bench::timing("CPU"), bench::value("patches"),
              bench::value("of them road")})
      .row({sweep.size(), ms, fit.surface.patches.size(), road});
  for (const double reach : {20.0, 30.0, 45.0}) {
    for (const bool road_only : {true, false}) {
      std::vector<double> errors, signed_errors;
      double cells = 0;
      for (std::size_t i = 0; i < ground.size(); ++i) {
        if (!drivable[i]) continue;
        const Vector3d world = ground.origin + ground.points[i].cast<double>();
        const Vector3d p = q.inverse() * (world - t);
        if (p.head<2>().norm() > reach) continue;
        cells += 1;
        const SurfaceQuery answer = fit.surface.query(p);
        if (answer.status == Status::kFailed) continue;
        if (road_only && fit.surface.find(answer.patch)->kind != PatchKind::kRoad) continue;
        errors.push_back(std::abs(answer.point.z() - p.z()));
        signed_errors.push_back(answer.point.z() - p.z());
      }
      std::printf(
          "within %2.0f m, %-10s %.0f of %.0f drivable cells covered (%.0f %%): height error "
          "median "
          "%.1f mm, 95 %% %.1f mm, 99 %% %.1f mm; signed median %+.1f mm\n",
          reach, road_only ? "road:" : "any patch:", static_cast<double>(errors.size()), cells,
          100 * static_cast<double>(errors.size()) / cells, 1e3 * quantile_of(errors, 0.5),
          1e3 * quantile_of(errors, 0.95), 1e3 * quantile_of(errors, 0.99),
          1e3 * quantile_of(signed_errors, 0.5));
      char within[16];
      std::snprintf(within, sizeof within, "%.0f m", reach);
      table.row({within, road_only ? "road" : "any patch",
                 100 * static_cast<double>(errors.size()) / cells, 1e3 * quantile_of(errors, 0.5),
                 1e3 * quantile_of(errors, 0.95), 1e3 * quantile_of(errors, 0.99),
                 1e3 * quantile_of(signed_errors, 0.5)});
    }
  }
}

}  // namespace camber::benchmarks
