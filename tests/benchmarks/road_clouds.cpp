// Planes, patches and profiles of road clouds against their truth, and against other libraries in
// the same run. Prints its tables. Run with no arguments, or the names of parts; --help lists them.
// The seed is that of every made cloud and of every fit. Real data: $CAMBER_DATA, else
// ../shared/data.

#include <Eigen/Core>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <functional>
#include <limits>
#include <numeric>
#include <string>
#include <vector>

#include "benchmarks/road_cloud_peers.h"
#include "benchmarks/road_clouds.h"
#include "camber/core/random.h"
#include "camber/render/plot.h"

namespace camber::benchmarks {

using Eigen::Vector2d;
using Eigen::Vector3d;

test::RoadScene Bench::made_scene(int planes, std::size_t points, bool sigmas,
                                  std::uint64_t seed) const {
  test::RoadSceneOptions options;
  options.seed = of_cloud(seed);
  options.planes = planes;
  options.points = points;
  options.outlier_share = planes == 3 ? 0.1 : planes == 12 ? 0.5 : 0.3;
  options.with_sigmas = sigmas;
  return test::make_road_scene(options);
}

double quantile_of(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  const double at = share * static_cast<double>(values.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, values.size() - 1);
  return values[below] + (at - static_cast<double>(below)) * (values[above] - values[below]);
}

double mean_of(const std::vector<double>& values) {
  return values.empty() ? std::nan("")
                        : std::accumulate(values.begin(), values.end(), 0.0) /
                              static_cast<double>(values.size());
}

double share_below(const std::vector<double>& values, double bound) {
  const auto below =
      std::count_if(values.begin(), values.end(), [&](double v) { return v < bound; });
  return static_cast<double>(below) / std::max(static_cast<double>(values.size()), 1.0);
}

double least_ms(int repeats, const std::function<void()>& call) {
  double least = 1e300;
  for (int k = 0; k < repeats; ++k) {
    const double start = cpu_ms();
    call();
    least = std::min(least, cpu_ms() - start);
  }
  return least;
}

double least_wall_ms(int repeats, const std::function<void()>& call) {
  const auto now = [] {
    return std::chrono::duration<double, std::milli>(
               std::chrono::steady_clock::now().time_since_epoch())
        .count();
  };
  double least = 1e300;
  for (int k = 0; k < repeats; ++k) {
    const double start = now();
    call();
    least = std::min(least, now() - start);
  }
  return least;
}

std::string count_name(std::size_t points) {
  const double power = std::log10(static_cast<double>(points));
  return power == std::floor(power) ? "1e" + std::to_string(static_cast<int>(power))
                                    : std::to_string(points);
}

std::vector<Plane> planes_of(const RoadSurface& surface) {
  std::vector<Plane> planes;
  for (const PlanePatch& patch : surface.patches) planes.push_back(patch.plane.plane);
  return planes;
}

/// A camera 1.65 m above a level road that bends to a grade 12 m ahead and to twice that 24 m
/// ahead, reconstructed too small by 10 %: the metric scale of each patch by its own height, and by
/// the ego patch's. The plot, where asked for, is the road in profile.
void hill(const Bench& bench) {
  bench::Table& scales =
      bench.report.table("hill.scale", "Scale of a hill by the ego patch alone", "hill",
                         {bench::label("road"), bench::lower("scale", "%")});
  bench::Table& table = bench.report.table(
      "hill", "Scale on hills: patches by their own heights and by the graph", "hill",
      {bench::label("road"), bench::label("patch"), bench::value("around", "m"),
       bench::value("scale by its median height", "%"), bench::value("middle", "m"),
       bench::value("scale by its plane's height", "%"), bench::value("middle by that", "m"),
       bench::lower("scale by the graph", "%"), bench::lower("middle by the graph", "m")});
  std::printf(
      "\n## Scale on hills: a reconstruction 10 %% too small, camera 1.65 m above the road\n");
  constexpr double kScale = 0.9, kHeight = 1.65, kWidth = 8.0;
  PlotSheet sheet;
  sheet.title = "Metric scale of a road that bends, camera 1.65 m above it";
  for (const double grade_deg : {4.0, -4.0}) {
    // Camera frame: x right, y down, z forward.
    const double bends[] = {12.0, 24.0, 36.0};
    const auto height = [&](double z) {
      const double g = std::tan(grade_deg * kDegree), g2 = std::tan(2 * grade_deg * kDegree);
      return z < bends[0]   ? 0.0
             : z < bends[1] ? g * (z - bends[0])
                            : g * (bends[1] - bends[0]) + g2 * (z - bends[1]);
    };
    RoadCloud cloud;
    cloud.frame = CloudFrame::kCamera;
    const CounterRandom random(5 + bench.report.seed(), 41);
    for (std::uint64_t i = 0; i < 60000; ++i) {
      const double x = random.uniform(2 * i, -0.5 * kWidth, 0.5 * kWidth),
                   z = random.uniform(2 * i + 1, 4.0, bends[2]);
      Vector3d p(x, kHeight - height(z), z);
      const double r = p.norm(), sigma = 0.5 * r * r / 718.0;
      p += sigma * random.normal(3 * i) * p / r;
      p.y() += 0.5 * r / 718.0 * random.normal(3 * i + 1);
      cloud.points.push_back((kScale * p).cast<float>());
      cloud.sigmas.push_back(static_cast<float>(kScale * sigma));
    }
    const RoadSurfaceFit fit = fit_road_surface(cloud, bench.surface_options());
    const PlanePatch* ego = fit.surface.find(fit.surface.ego_patch);
    if (!ego) continue;
    const double ego_scale = kHeight / ego->plane.plane.offset;
    std::printf("grade %+.0f then %+.0f deg; scale by the ego patch alone: %+.2f %% off\n",
                grade_deg, 2 * grade_deg, 100 * (ego_scale * kScale - 1.0));
    const std::string road = grade_deg > 0 ? "uphill" : "downhill";
    scales.row({road, 100 * std::abs(ego_scale * kScale - 1.0)});
    std::vector<const PlanePatch*> order;
    for (const PlanePatch& patch : fit.surface.patches) {
      if (patch.kind == PatchKind::kRoad && patch.inliers > 1000) order.push_back(&patch);
    }
    std::sort(order.begin(), order.end(), [](const PlanePatch* l, const PlanePatch* r) {
      return l->plane.centroid.z() < r->plane.centroid.z();
    });
    PlotSeries truth, graph, own_height;
    truth.name = "true road";
    truth.color = {185, 185, 185, 1.0};
    truth.thickness = 8.0;
    graph.name = "patches scaled by the ego patch and the graph";
    graph.color = plot_color(0);
    own_height.name = "each patch by its own median height";
    own_height.color = plot_color(1);
    own_height.thickness = graph.thickness = 2.5;
    const auto draw = [](PlotSeries* series, const Vector2d& from, const Vector2d& to) {
      constexpr double kGap = std::numeric_limits<double>::quiet_NaN();
      series->x.insert(series->x.end(), {from.x(), to.x(), kGap});
      series->y.insert(series->y.end(), {from.y(), to.y(), kGap});
    };
    truth.x = {0.0, bends[0], bends[1], bends[2]};
    for (const double z : truth.x) truth.y.push_back(height(z));
    int number = 0;
    for (const PlanePatch* patch : order) {
      // Its own height: the median of what its points lie below the camera.
      std::vector<double> below;
      double near = 1e9, far = 0.0;
      for (std::size_t i = 0; i < cloud.size(); ++i) {
        if (fit.labels[i] != patch->id) continue;
        below.push_back(static_cast<double>(cloud.points[i].y()));
        near = std::min(near, static_cast<double>(cloud.points[i].z()));
        far = std::max(far, static_cast<double>(cloud.points[i].z()));
      }
      const double own = kHeight / quantile_of(below, 0.5);
      const double by_plane = kHeight / patch->plane.plane.offset;
      const Vector3d c = patch->plane.centroid;
      // Height of its middle above the road under the camera, against the truth there.
      const auto off = [&](double scale) {
        return kHeight - scale * c.y() - height(c.z() / kScale);
      };
      std::printf(
          "  patch around %4.1f m: scale by its median height %+8.1f %% off, middle %+7.2f m off; "
          "by "
          "its plane's height %+7.1f %%, %+7.2f m; by the graph %+5.2f %%, %+6.3f m\n",
          c.z() / kScale, 100 * (own * kScale - 1.0), off(own), 100 * (by_plane * kScale - 1.0),
          off(by_plane), 100 * (ego_scale * kScale - 1.0), off(ego_scale));
      table.row({road, std::to_string(++number), c.z() / kScale, 100 * (own * kScale - 1.0),
                 off(own), 100 * (by_plane * kScale - 1.0), off(by_plane),
                 100 * std::abs(ego_scale * kScale - 1.0), std::abs(off(ego_scale))});
      const Plane& plane = patch->plane.plane;
      const auto place = [&](double z, double scale) {
        const double y = -(plane.normal.z() * z + plane.offset) / plane.normal.y();
        return Vector2d(scale * z, kHeight - scale * y);
      };
      draw(&graph, place(near, ego_scale), place(far, ego_scale));
      if (own > 0.0 && own * far < 60.0) {
        draw(&own_height, place(near, own), place(far, own));
      } else {
        own_height.name += " (one without meaning left out)";
      }
    }
    Plot plot;
    plot.title = "Grade " + std::string(grade_deg > 0 ? "+" : "-") + "4 deg from 12 m, " +
                 (grade_deg > 0 ? "+" : "-") + "8 deg from 24 m ahead";
    plot.x.title = "distance ahead of the camera, m";
    plot.y.title = "height above the near road, m";
    plot.x.low = 0.0;
    plot.series = {truth, graph, own_height};
    sheet.panels.push_back(plot);
  }
  if (bench.plot.empty()) return;
  std::ofstream(bench.plot) << plots_svg(sheet, {900, 330, 18.0});
  std::printf("plot: %s\n", bench.plot.c_str());
}

namespace {

void run_road_clouds(bench::Report& report) {
  Bench bench{report};
  bench.scenes = report.count("--scenes", bench.scenes);
  bench.largest = report.count("--largest", bench.largest);
  bench.plot = report.option("--plot");
  std::setvbuf(stdout, nullptr, _IOLBF, 0);
  if (report.wanted("plane")) one_plane(bench, "plane", 1, "One plane, 30 % outliers");
  if (report.wanted("largest")) {
    one_plane(bench, "largest", 6, "Largest of six planes, 30 % outliers");
  }
  if (report.wanted("patches")) patches(bench);
  if (report.wanted("threads")) threads(bench);
  if (report.wanted("coverage")) coverage(bench);
  if (report.wanted("repeat")) repeat(bench);
  if (report.wanted("hill")) hill(bench);
  if (report.wanted("bands")) bands(bench);
  if (report.wanted("real")) {
    forest_road(bench);
    city_sweep(bench);
  }
}

}  // namespace
}  // namespace camber::benchmarks

int main(int argc, char** argv) {
  const camber::bench::Program program = {
      "bench_road_clouds",
      "Planes, patches and profiles of road clouds against their truth and other libraries",
      {"plane", "largest", "patches", "threads", "coverage", "repeat", "hill", "bands", "real"},
      {{"--scenes", "N", "Made clouds of a row of the coverage (default: 1000)"},
       {"--largest", "N", "Points of the largest made clouds (default: 10000000)"},
       {"--even-draws", "", "Bands on the draws that constants are decided on"},
       {"--plot", "FILE.svg", "The hill in profile", false}}};
  return camber::bench::run_program(program, argc, argv, camber::benchmarks::run_road_clouds);
}
