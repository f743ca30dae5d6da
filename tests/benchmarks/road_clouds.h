#pragma once

#include <cmath>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "benchmarks/report.h"
#include "camber/plane/fit_plane.h"
#include "camber/road/fit_road_surface.h"
#include "plane/road_scene_maker.h"

/// What the parts of bench_road_clouds share.
namespace camber::benchmarks {

constexpr double kDegree = M_PI / 180.0;

/// One run of the program.
struct Bench {
  bench::Report& report;
  std::size_t scenes = 1000;       ///< of the coverage
  std::size_t largest = 10000000;  ///< points
  std::string plot = {};           ///< SVG of the hill, empty: none

  /// Of a made cloud: `seed` for seed 0, far from all others for every other one.
  std::uint64_t of_cloud(std::uint64_t seed) const { return seed + 100000 * report.seed(); }
  /// K planes with the outliers that the table asks for.
  test::RoadScene made_scene(int planes, std::size_t points, bool sigmas, std::uint64_t seed) const;
  PlaneFitOptions plane_options() const {
    PlaneFitOptions options;
    options.seed = report.seed();
    return options;
  }
  RoadSurfaceOptions surface_options() const {
    RoadSurfaceOptions options;
    options.seed = report.seed();
    options.largest_is_road = true;  // of clouds without a driven line, to tell it from pavements
    return options;
  }
  int repeats(int times) const { return report.accuracy_only() ? 1 : times; }
};

double quantile_of(std::vector<double> values, double share);  ///< NaN without any
double mean_of(const std::vector<double>& values);             ///< NaN without any
double share_below(const std::vector<double>& values, double bound);
double least_ms(int repeats, const std::function<void()>& call);  ///< CPU, of a few calls
double least_wall_ms(int repeats, const std::function<void()>& call);
std::string count_name(std::size_t points);  ///< "1e5"
std::vector<Plane> planes_of(const RoadSurface& surface);

/// One plane, alone or the largest of several, against PCL.
void one_plane(const Bench& bench, const std::string& section, int planes, const char* title);
/// All planes of a road, against CGAL.
void patches(const Bench& bench);
/// Wall times of both on one thread and on all.
void threads(const Bench& bench);
/// How often truths lie inside the stated 95 % regions.
void coverage(const Bench& bench);
/// The same cloud in another order or place.
void repeat(const Bench& bench);
/// Metric scale of a road that bends, by each patch's own height and by the ego patch's.
void hill(const Bench& bench);
/// Profile of a real forest road under a camera's noise.
void forest_road(const Bench& bench);
/// How often the road lies inside the stated 95 % bands of its profile.
void bands(const Bench& bench);
/// A laser's sweep against the measured ground.
void city_sweep(const Bench& bench);

}  // namespace camber::benchmarks
