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

#include "benchmarks/road_clouds.h"
#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "camber/road/road_profile.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber::benchmarks {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::Vector3f;

bool available(const fs::path& path) {
  if (fs::exists(path)) return true;
  std::printf("skipped: no %s\n", path.string().c_str());
  return false;
}

/// Rows of numbers of a CSV file with one header line.
std::vector<std::vector<double>> read_rows(const fs::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  std::vector<std::vector<double>> rows;
  while (std::getline(in, line)) {
    std::stringstream cells(line);
    std::string cell;
    std::vector<double> row;
    while (std::getline(cells, cell, ',')) row.push_back(std::atof(cell.c_str()));
    rows.push_back(std::move(row));
  }
  return rows;
}

/// Heights on a grid of 1 m whose cells may be missing.
class Terrain {
 public:
  explicit Terrain(const RoadCloud& cloud) {
    for (const Vector3f& p : cloud.points) {
      const Vector3d x = cloud.origin + p.cast<double>();
      offset_ = {x.x() - std::floor(x.x()), x.y() - std::floor(x.y())};
      break;
    }
    for (const Vector3f& p : cloud.points) {
      const Vector3d x = cloud.origin + p.cast<double>();
      cells_[key(x.x(), x.y())] = x.z();
    }
  }
  /// Bilinear; NaN outside.
  double height(double x, double y) const {
    const double gx = x - offset_.x(), gy = y - offset_.y();
    const double fx = gx - std::floor(gx), fy = gy - std::floor(gy);
    double sum = 0.0;
    for (int corner = 0; corner < 4; ++corner) {
      const int dx = corner % 2, dy = corner / 2;
      const auto found = cells_.find(key(x - fx + dx, y - fy + dy));
      if (found == cells_.end()) return std::nan("");
      sum += (dx ? fx : 1 - fx) * (dy ? fy : 1 - fy) * found->second;
    }
    return sum;
  }

 private:
  std::pair<long, long> key(double x, double y) const {
    return {std::lround(x - offset_.x()), std::lround(y - offset_.y())};
  }
  Vector2d offset_ = Vector2d::Zero();
  std::map<std::pair<long, long>, double> cells_;
};

/// Slope of heights over `length` around each station, by least squares; NaN at the ends.
std::vector<double> smoothed_grade(const std::vector<double>& station,
                                   const std::vector<double>& height, double length) {
  std::vector<double> out(station.size(), std::nan(""));
  for (std::size_t k = 0; k < station.size(); ++k) {
    if (station[k] - 0.5 * length < station.front() - 1e-6 ||
        station[k] + 0.5 * length > station.back() + 1e-6) {
      continue;
    }
    double n = 0, s = 0, h = 0, ss = 0, sh = 0;
    for (std::size_t j = 0; j < station.size(); ++j) {
      const double d = station[j] - station[k];
      if (std::abs(d) > 0.5 * length + 1e-6) continue;
      n += 1;
      s += d;
      h += height[j];
      ss += d * d;
      sh += d * height[j];
    }
    out[k] = (n * sh - s * h) / (n * ss - s * s);
  }
  return out;
}

/// Noise of a camera that drives along a line, 1.65 m above it, 6 to 30 m before each point.
class CameraNoise {
 public:
  CameraNoise(std::vector<Vector3d> line, std::uint64_t seed)
      : line_(std::move(line)), random_(seed, 31) {}
  Vector3d operator()(const Vector3d& p, double chainage, float* sigma) {
    const double back = random_.uniform(next_++, 6.0, 30.0);
    const double at = std::clamp(chainage - back, 0.0, static_cast<double>(line_.size() - 1));
    Vector3d camera = line_[static_cast<std::size_t>(at)] + Vector3d(0, 0, 1.65);
    // Before the start of the line the camera stands as far behind it.
    if (chainage < back) {
      const Vector3d way = (line_[1] - line_[0]).normalized();
      camera += (chainage - back) * way;
    }
    const Vector3d offset = p - camera;
    const double r = offset.norm();
    const double along = 0.5 * r * r / 718.0, across = 0.5 * r / 718.0;
    Vector3d e1, e2;
    UncertainPlane::make_axes(offset / r, Vector3d::UnitZ(), &e1, &e2);
    *sigma = static_cast<float>(along);
    const double n1 = random_.normal(next_), n2 = random_.normal(next_ + 1),
                 n3 = random_.normal(next_ + 2);
    next_ += 3;
    return p + along * n1 * offset / r + across * (n2 * e1 + n3 * e2);
  }

 private:
  std::vector<Vector3d> line_;
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

}  // namespace

void forest_road(const Bench& bench) {
  std::printf("\n## als-forest-road with camera noise: along the centreline, grade over 10 m\n");
  const fs::path folder = test::data_dir() / "als-forest-road";
  if (!available(folder / "terrain.ply")) return;
  const RoadCloud terrain = read_cloud(folder / "terrain.ply");
  const Terrain grid(terrain);
  std::vector<Vector3d> line;
  std::vector<double> station, truth;
  for (const std::vector<double>& row : read_rows(folder / "centreline.csv")) {
    station.push_back(row[0]);
    line.emplace_back(row[1], row[2], row[3]);
    truth.push_back(row[3]);
  }
  // Stations in plan, as profiles have them.
  std::vector<double> way(1, 0.0);
  for (std::size_t k = 1; k < line.size(); ++k) {
    way.push_back(way.back() + (line[k] - line[k - 1]).head<2>().norm());
  }
  const std::vector<double> true_grade = smoothed_grade(way, truth, 10.0);
  const std::vector<float>& chainage = terrain.scalars.at("chainage");
  const std::vector<float>& distance = terrain.scalars.at("road_distance");
  struct Input {
    const char* name;
    std::size_t points;  ///< 0: every grid cell once
    float width;         ///< cells this near to the centreline
    bool sigmas;
  };
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
  const Input inputs[] = {
      {"every cell once", 0, 25.0f, false},     {"every cell once", 0, 25.0f, true},
      {"road and verge, once", 0, 6.0f, false}, {"20000 places", 20000, 25.0f, false},
      {"200000 places", 200000, 25.0f, false},  {"200000 places", 200000, 25.0f, true}};
  for (const Input& input : inputs) {
    std::vector<double> grade_errors, height_errors, covered, patch_counts;
    // One scene more or less moves the mean of a few sparse ones by a tenth.
    const std::uint64_t scenes = input.points > 100000 ? 5 : 16;
    for (std::uint64_t seed = 0; seed < scenes; ++seed) {
      RoadCloud cloud;
      cloud.frame = CloudFrame::kZUp;
      CameraNoise noise(line, bench.of_cloud(seed));
      const CounterRandom random(bench.of_cloud(seed), 32);
      const std::size_t cells = terrain.size();
      std::vector<std::size_t> near;
      for (std::size_t i = 0; i < cells; ++i) {
        if (distance[i] <= input.width) near.push_back(i);
      }
      const std::size_t count = input.points > 0 ? input.points : near.size();
      for (std::size_t k = 0; k < count; ++k) {
        std::size_t i = near[k % near.size()];
        Vector3d p;
        if (input.points > 0) {
          i = near[random.below(3 * k, near.size())];
          p = terrain.origin + terrain.points[i].cast<double>();
          p.x() += random.uniform(3 * k + 1) - 0.5;
          p.y() += random.uniform(3 * k + 2) - 0.5;
          p.z() = grid.height(p.x(), p.y());
          if (!std::isfinite(p.z())) continue;
        } else {
          p = terrain.origin + terrain.points[i].cast<double>();
        }
        float sigma = 0.0f;
        cloud.points.push_back(noise(p, static_cast<double>(chainage[i]), &sigma).cast<float>());
        if (input.sigmas) cloud.sigmas.push_back(sigma);
      }
      RoadSurfaceOptions options = bench.surface_options();
      options.driven_line = line;
      const std::size_t grades = grade_errors.size(), heights = height_errors.size(),
                        places = covered.size();
      const RoadSurfaceFit fit = fit_road_surface(cloud, options);
      patch_counts.push_back(static_cast<double>(fit.surface.patches.size()));
      const std::vector<ProfilePoint> profile = road_profile(fit.surface, line, {});
      for (const ProfilePoint& point : profile) {
        covered.push_back(point.status != Status::kFailed ? 1.0 : 0.0);
        const auto k = static_cast<std::size_t>(std::lround(point.station));
        if (k >= way.size() || point.status == Status::kFailed) continue;
        // The truth at this very station.
        const std::size_t a = std::min(k, way.size() - 2);
        const double share = (point.station - way[a]) / (way[a + 1] - way[a]);
        const double z = truth[a] + share * (truth[a + 1] - truth[a]);
        height_errors.push_back(std::abs(point.height - z));
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
