// How often the road lies inside the stated 95 % bands of its profile.

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "benchmarks/forest_road.h"
#include "benchmarks/road_clouds.h"
#include "camber/road/road_profile.h"
#include "plane/curved_road_maker.h"
#include "support/test_data.h"

namespace camber::benchmarks {
namespace {

constexpr double kBand = 1.96;  // standard deviations, 95 %

/// Errors of one quantity with their stated standard deviations.
struct Band {
  std::vector<double> errors, ratios, half_widths;  ///< |error|, over sigma; half of the band

  void add(double estimate, double truth, double sigma) {
    if (!std::isfinite(estimate) || !std::isfinite(truth)) return;
    errors.push_back(std::abs(estimate - truth));
    ratios.push_back(errors.back() / sigma);
    half_widths.push_back(kBand * sigma);
  }
  void add(const Band& other) {
    errors.insert(errors.end(), other.errors.begin(), other.errors.end());
    ratios.insert(ratios.end(), other.ratios.begin(), other.ratios.end());
    half_widths.insert(half_widths.end(), other.half_widths.begin(), other.half_widths.end());
  }
  double inside() const { return 100.0 * share_below(ratios, kBand); }
  double error() const { return quantile_of(errors, 0.95); }
  double width() const { return quantile_of(half_widths, 0.5); }
};

struct Bands {
  Band height, grade, cross_slope;
  void add(const Bands& other) {
    height.add(other.height);
    grade.add(other.grade);
    cross_slope.add(other.cross_slope);
  }
};

/// The truth about a line, station by station.
struct TrueLine {
  std::vector<double> station, height, cross_slope;  ///< m, m, rise over run (may be empty)
  double at(const std::vector<double>& values, double s) const {
    if (values.empty()) return std::nan("");
    const auto next = std::upper_bound(station.begin() + 1, station.end() - 1, s);
    const auto a = static_cast<std::size_t>(next - station.begin()) - 1;
    return values[a] +
           (s - station[a]) / (station[a + 1] - station[a]) * (values[a + 1] - values[a]);
  }
};

void add_profile(const RoadCloud& cloud, const std::vector<Eigen::Vector3d>& line,
                 const TrueLine& truth, const Bench& bench, Bands* bands) {
  RoadSurfaceOptions options = bench.surface_options();
  options.driven_line = line;
  const RoadSurfaceFit fit = fit_road_surface(cloud, options);
  const std::vector<ProfilePoint> profile = road_profile(fit.surface, line, {});
  std::vector<double> stations, heights;
  for (const ProfilePoint& point : profile) {
    stations.push_back(point.station);
    heights.push_back(truth.at(truth.height, point.station));
  }
  const std::vector<double> grades = smoothed_grade(stations, heights, 10.0);
  for (std::size_t k = 0; k < profile.size(); ++k) {
    const ProfilePoint& point = profile[k];
    if (point.status == Status::kFailed) continue;
    bands->height.add(point.height, heights[k], point.sigma_height);
    bands->grade.add(point.grade, grades[k], point.sigma_grade);
    bands->cross_slope.add(point.cross_slope, truth.at(truth.cross_slope, point.station),
                           point.sigma_cross_slope);
  }
}

void print(const std::string& name, const Bands& bands, bench::Table* table) {
  table->row({name, bands.height.inside(), bands.grade.inside(), bands.cross_slope.inside(),
              1e3 * bands.height.width(), 1e3 * bands.height.error(), 100 * bands.grade.width(),
              100 * bands.grade.error(), 100 * bands.cross_slope.width(),
              100 * bands.cross_slope.error(), bands.height.ratios.size()});
  std::printf(
      "%-34s height %5.1f %%, grade %5.1f %%, cross slope %5.1f %% inside; half width in the "
      "median, 95 %% of errors: %5.1f, %5.1f mm; %.2f, %.2f %%; %.2f, %.2f %%; %zu stations\n",
      name.c_str(), bands.height.inside(), bands.grade.inside(), bands.cross_slope.inside(),
      1e3 * bands.height.width(), 1e3 * bands.height.error(), 100 * bands.grade.width(),
      100 * bands.grade.error(), 100 * bands.cross_slope.width(), 100 * bands.cross_slope.error(),
      bands.height.ratios.size());
}

}  // namespace

void bands(const Bench& bench) {
  constexpr std::uint64_t kDraws = 16;
  const bool even = bench.report.flag("--even-draws");
  std::printf("\n## Stations of profiles inside their stated 95 %% bands, %llu %s draws each\n",
              static_cast<unsigned long long>(kDraws), even ? "even" : "odd");
  bench::Table& table = bench.report.table(
      "bands", "Stations of profiles inside their stated 95 % bands", "bands",
      {bench::label("cloud"), bench::value("height", "%"), bench::value("grade", "%"),
       bench::value("cross slope", "%"), bench::lower("half width, height", "mm"),
       bench::lower("error, height, 95 %", "mm"), bench::lower("half width, grade", "%"),
       bench::lower("error, grade, 95 %", "%"), bench::lower("half width, cross slope", "%"),
       bench::lower("error, cross slope, 95 %", "%"), bench::value("stations")});
  const auto draw = [&](std::uint64_t k) { return bench.of_cloud(2 * k + (even ? 0 : 1)); };
  Bands all, of_forest, of_made;
  const std::filesystem::path folder = test::data_dir() / "als-forest-road";
  if (available(folder / "terrain.ply")) {
    const ForestRoad road(folder);
    TrueLine truth{road.station, road.height, road.cross_slopes(3.0)};
    for (const ForestInput& input : kForestInputs) {
      Bands bands;
      for (std::uint64_t k = 0; k < kDraws; ++k) {
        add_profile(road.cloud(input, draw(k)), road.line, truth, bench, &bands);
      }
      print(std::string("forest road, ") + input.name + (input.sigmas ? ", sigmas" : ""), bands,
            &table);
      of_forest.add(bands);
    }
    print("forest road, together", of_forest, &table);
  }
  for (const test::RoadNoise noise : test::kRoadNoises) {
    Bands bands;
    for (std::uint64_t k = 0; k < kDraws; ++k) {
      test::CurvedRoadOptions options;
      options.seed = draw(k);
      options.noise = noise;
      const test::CurvedRoad road = test::make_curved_road(options);
      // At a crown the road has two cross slopes.
      TrueLine truth{{0.0}, {}, road.crowned ? std::vector<double>() : road.bank};
      for (std::size_t i = 0; i < road.line.size(); ++i) {
        truth.height.push_back(road.line[i].z());
        if (i > 0) {
          truth.station.push_back(truth.station.back() +
                                  (road.line[i] - road.line[i - 1]).head<2>().norm());
        }
      }
      add_profile(road.cloud, road.line, truth, bench, &bands);
    }
    print(std::string(to_string(noise)), bands, &table);
    of_made.add(bands);
  }
  print("made roads, together", of_made, &table);
  all.add(of_forest);
  all.add(of_made);
  print("all together", all, &table);
}

}  // namespace camber::benchmarks
