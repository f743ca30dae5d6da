// Height, grade and cross slope of clouds along a line against the ground that the clouds were made
// from, by the profile's own definitions: ten made roads, and als-forest-road under a camera's
// noise. Drift and levelling are 0 in the made clouds and in the options.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <numeric>
#include <string>
#include <vector>

#include "benchmarks/forest_road.h"
#include "benchmarks/report.h"
#include "camber/core/random.h"
#include "camber/road/cloud_profile.h"
#include "support/test_data.h"

namespace camber::benchmarks {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kHalfWidth = 3.5, kGradeLength = 10.0;  // m, the profile's defaults

/// The ground beside a line, for the truth at places of the profile.
struct Ground {
  std::function<double(double s, double v)> height;  ///< m along the line, m to its left
  /// Of the road alone, which goes on beyond its edges: an edge that is hidden takes nothing from
  /// beyond it.
  std::function<double(double s, double v)> road;
  std::function<double(const Vector3d& point)> station;
  double length = 0.0;
};

/// A road in a bend of one radius, whose ground is known at every place.
struct MadeRoad {
  double radius;         ///< m, of the line; negative: to the right
  double crown, crest;   ///< rise over run, m to the left of the line
  double bank, bank_to;  ///< left side up; it runs off between 80 and 120 m
  double kerb, ditch;    ///< m, at the left and the right edge; 0: the road goes on
  double grade, bend;    ///< of the line's height: rise over run, 1/m
};
// Radii from nearly straight down to 45 m.
constexpr MadeRoad kRoads[] = {{1e5, 0.025, 0.0, 0.0, 0.0, 0.12, 0.0, 0.02, 0.0},
                               {1e5, 0.0, 0.0, 0.02, 0.02, 0.0, 0.5, 0.05, -1.0 / 3000},
                               {300.0, 0.025, 0.0, 0.0, 0.0, 0.12, 0.5, -0.03, 1.0 / 2000},
                               {150.0, 0.0, 0.0, -0.02, -0.06, 0.0, 0.5, 0.04, 0.0},
                               {80.0, 0.02, 0.0, -0.02, -0.02, 0.08, 0.0, 0.08, -1.0 / 1200},
                               {45.0, 0.0, 0.0, -0.04, -0.05, 0.0, 0.4, 0.03, 0.0},
                               {-80.0, 0.025, 0.0, 0.01, 0.03, 0.15, 0.5, -0.06, 0.0},
                               {1e5, 0.03, 0.8, 0.0, 0.0, 0.12, 0.5, 0.0, 1.0 / 1500},
                               {-200.0, 0.0, 0.0, -0.025, 0.04, 0.1, 0.0, 0.02, 0.0},
                               {400.0, 0.04, 0.0, 0.0, 0.0, 0.0, 0.6, 0.1, -1.0 / 2500}};
constexpr double kLength = 240.0, kLeft = 3.2, kRight = 3.3;  // m; to kerb and ditch

/// From 0 to 1 between 80 and 120 m, its corners rounded over 10 m.
double run_off(double s) {
  const auto ramp = [](double x) {  // integral of a step that takes 10 m
    const double u = std::clamp(x / 10.0 + 0.5, 0.0, 1.0);
    return 5.0 * u * u + std::max(0.0, x - 5.0);
  };
  return (ramp(s - 80.0) - ramp(s - 120.0)) / 40.0;
}

double road_height(const MadeRoad& road, double s, double v) {
  const double bank = road.bank + (road.bank_to - road.bank) * run_off(s);
  return road.grade * s + 0.5 * road.bend * (s - 120.0) * (s - 120.0) + bank * v -
         road.crown * std::abs(v - road.crest);
}

double height_of(const MadeRoad& road, double s, double v) {
  const double inside = std::clamp(v, road.ditch > 0.0 ? -kRight : v, road.kerb > 0.0 ? kLeft : v);
  double z = road_height(road, s, inside);
  if (v > inside) z += std::min(1.0, (v - inside) / 0.02) * road.kerb;
  if (v < inside) z -= road.ditch * std::min(1.0, inside - v);
  return z;
}

Vector3d place_of(const MadeRoad& road, double s, double v, double z) {
  const double turn = s / road.radius, r = road.radius - v;
  return {r * std::sin(turn), road.radius - r * std::cos(turn), z};
}

/// Half of the road is hidden in two places, all of it in a third.
bool hidden(double s, double v) {
  return (s > 40.0 && s < 45.0 && v > 0.2) || (s > 140.0 && s < 144.0 && v < -1.0) ||
         (s > 190.0 && s < 198.0);
}

RoadCloud cloud_of(const MadeRoad& road, double density, double noise, std::uint64_t seed) {
  RoadCloud out;
  out.frame = CloudFrame::kZUp;
  const CounterRandom random(seed, 51);
  const auto count = static_cast<std::uint64_t>(density * 14.0 * (kLength + 20.0));
  for (std::uint64_t i = 0; i < count; ++i) {
    const double s = random.uniform(2 * i, -10.0, kLength + 10.0);
    const double v = random.uniform(2 * i + 1, -7.0, 7.0);
    if (hidden(s, v)) continue;
    const double z = height_of(road, s, v) + noise * random.normal(i);
    out.points.push_back(place_of(road, s, v, z).cast<float>());
  }
  return out;
}

/// Errors of one quantity at the stations of many profiles.
struct Errors {
  double squares = 0.0;
  std::size_t count = 0, inside = 0, pairs = 0, jumps = 0;

  void add(const std::vector<double>& errors, const std::vector<double>& sigmas) {
    for (std::size_t k = 0; k < errors.size(); ++k) {
      if (!std::isfinite(errors[k])) continue;
      ++count;
      squares += errors[k] * errors[k];
      inside += std::abs(errors[k]) <= 1.96 * sigmas[k];
      if (k == 0 || !std::isfinite(errors[k - 1])) continue;
      ++pairs;
      jumps += std::abs(errors[k] - errors[k - 1]) > 4.0 * std::hypot(sigmas[k], sigmas[k - 1]);
    }
  }
  double rms() const { return std::sqrt(squares / static_cast<double>(count)); }
  double held() const { return 100.0 * static_cast<double>(inside) / static_cast<double>(count); }
};

struct Row {
  Errors height, grade, cross_slope;
  std::vector<double> noises;
  std::size_t stations = 0, with_ground = 0, not_answered = 0;
};

double slope_of(const std::vector<double>& x, const std::vector<double>& y) {
  const auto count = static_cast<double>(x.size());
  const double mean = std::accumulate(x.begin(), x.end(), 0.0) / count;
  double products = 0.0, squares = 0.0;
  for (std::size_t i = 0; i < x.size(); ++i) {
    products += (x[i] - mean) * y[i];
    squares += (x[i] - mean) * (x[i] - mean);
  }
  return products / squares;
}

double true_cross_slope(const Ground& ground, double s, const CrossSection& section) {
  std::vector<double> offsets, heights;
  const double to_right = section.measured_right, to_left = section.measured_left;
  const int count =
      std::max(2, static_cast<int>(std::lround(10.0 * (to_left + to_right) / kHalfWidth)));
  for (int i = 0; i <= count; ++i) {
    offsets.push_back(-to_right + (to_left + to_right) * i / count);
    heights.push_back(ground.road(s, offsets.back()));
  }
  return slope_of(offsets, heights);
}

/// Of the parabola through the heights on the line around a station.
double true_grade(const Ground& ground, double s) {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Vector3d right = Vector3d::Zero();
  for (double off = -0.5 * kGradeLength; off <= 0.5 * kGradeLength + 1e-9; off += 1.0) {
    if (s + off < -1e-6 || s + off > ground.length + 1e-6) continue;
    const Vector3d row(1.0, off, 0.5 * off * off);
    normal += row * row.transpose();
    right += ground.height(s + off, 0.0) * row;
  }
  return normal.ldlt().solve(right)[1];
}

void add_profile(const RoadCloud& cloud, const std::vector<Vector3d>& line, const Ground& ground,
                 const std::function<bool(double s)>& has_ground, Row* row) {
  CloudProfileOptions options;
  options.half_width = kHalfWidth;
  options.profile.length = kGradeLength;
  options.profile.drift_sigma = options.profile.levelling_sigma = 0.0;
  std::vector<int> all(cloud.size());
  std::iota(all.begin(), all.end(), 0);
  const CloudProfile profile = profile_cloud(cloud, all, Vector3d::UnitZ(), line, options);
  row->noises.push_back(profile.noise);
  std::vector<double> errors[3], sigmas[3];
  for (const CrossSection& section : profile.stations) {
    ++row->stations;
    const double s = ground.station(section.point);
    const bool seen = has_ground(s), failed = section.status == Status::kFailed;
    row->with_ground += seen;
    row->not_answered += seen && failed;
    const double nan = std::nan("");
    errors[0].push_back(failed ? nan : section.height - ground.height(s, 0.0));
    sigmas[0].push_back(section.sigma_height);
    errors[1].push_back(failed ? nan : section.cross_slope - true_cross_slope(ground, s, section));
    sigmas[1].push_back(section.sigma_cross_slope);
    // Beside a gap the grade is that of the part that is seen.
    bool whole = !failed;
    for (double off = -0.5 * kGradeLength; off <= 0.5 * kGradeLength; off += 1.0) {
      whole = whole && (s + off < 0.0 || s + off > ground.length || has_ground(s + off));
    }
    errors[2].push_back(whole ? section.grade - true_grade(ground, s) : nan);
    sigmas[2].push_back(section.sigma_grade);
  }
  row->height.add(errors[0], sigmas[0]);
  row->cross_slope.add(errors[1], sigmas[1]);
  row->grade.add(errors[2], sigmas[2]);
}

void print(const std::string& name, const Row& row, bench::Table* table) {
  const double noise = std::accumulate(row.noises.begin(), row.noises.end(), 0.0) /
                       static_cast<double>(row.noises.size());
  const std::size_t jumps = row.height.jumps + row.cross_slope.jumps + row.grade.jumps;
  table->row({name, 1e3 * noise, 1e3 * row.height.rms(), 100.0 * row.cross_slope.rms(),
              100.0 * row.grade.rms(), row.height.held(), row.cross_slope.held(), row.grade.held(),
              jumps, row.not_answered, row.stations});
  std::printf(
      "%-34s noise %4.1f mm; rms height %5.2f mm, cross slope %.3f %%, grade %.3f %%; inside "
      "%5.1f, "
      "%5.1f, %5.1f %%; jumps %zu, %zu, %zu; not answered %zu of %zu with ground, of %zu\n",
      name.c_str(), 1e3 * noise, 1e3 * row.height.rms(), 100.0 * row.cross_slope.rms(),
      100.0 * row.grade.rms(), row.height.held(), row.cross_slope.held(), row.grade.held(),
      row.height.jumps, row.cross_slope.jumps, row.grade.jumps, row.not_answered, row.with_ground,
      row.stations);
  std::fflush(stdout);
}

bench::Table& make_table(bench::Report& report, const char* key, const char* title) {
  return report.table(
      key, title, key,
      {bench::label("cloud"), bench::value("noise", "mm"), bench::lower("height, rms", "mm"),
       bench::lower("cross slope, rms", "%"), bench::lower("grade, rms", "%"),
       bench::value("height inside", "%"), bench::value("cross slope inside", "%"),
       bench::value("grade inside", "%"), bench::lower("jumps"), bench::lower("not answered"),
       bench::value("stations")});
}

struct Points {
  double density, noise;  ///< 1/m^2, m
};

void made_roads(bench::Report& report, const char* key, const std::vector<Points>& all,
                std::size_t draws) {
  const bool even = report.flag("--even-draws");
  bench::Table& table = make_table(report, key, "Profiles of ten made roads against their truth");
  for (const Points& points : all) {
    Row together;
    for (std::size_t k = 0; k < std::size(kRoads); ++k) {
      const MadeRoad& road = kRoads[k];
      std::vector<Vector3d> line;
      for (double s = 0.0; s <= kLength; s += 1.0) line.push_back(place_of(road, s, 0.0, 0.0));
      Ground ground;
      ground.height = [&](double s, double v) { return height_of(road, s, v); };
      ground.road = [&](double s, double v) { return road_height(road, s, v); };
      ground.station = [&](const Vector3d& p) {
        const double side = road.radius > 0.0 ? 1.0 : -1.0;
        const double turn = std::atan2(side * p.x(), side * (road.radius - p.y()));
        const double s = road.radius * turn;
        // Of a bend of more than half a turn.
        return s < -1.0 ? s + 2.0 * M_PI * std::abs(road.radius) : s;
      };
      ground.length = kLength;
      Row row;
      for (std::uint64_t draw = 0; draw < draws; ++draw) {
        const std::uint64_t seed = 1000 * report.seed() + 2 * draw + (even ? 0 : 1);
        add_profile(
            cloud_of(road, points.density, points.noise, 100 * seed + k), line, ground,
            [](double s) { return !(s > 189.0 && s < 199.0); }, &row);
      }
      const auto join = [](const Errors& from, Errors* to) {
        to->squares += from.squares;
        to->count += from.count;
        to->inside += from.inside;
        to->pairs += from.pairs;
        to->jumps += from.jumps;
      };
      join(row.height, &together.height);
      join(row.cross_slope, &together.cross_slope);
      join(row.grade, &together.grade);
      together.noises.insert(together.noises.end(), row.noises.begin(), row.noises.end());
      together.stations += row.stations;
      together.with_ground += row.with_ground;
      together.not_answered += row.not_answered;
      char name[64];
      std::snprintf(name, sizeof name, "%g/m2, %g cm, road %zu", points.density,
                    100.0 * points.noise, k + 1);
      print(name, row, &table);
    }
    char name[64];
    std::snprintf(name, sizeof name, "%g/m2, %g cm, together", points.density,
                  100.0 * points.noise);
    print(name, together, &table);
  }
}

void forest(bench::Report& report, std::size_t draws) {
  const std::filesystem::path folder = test::data_dir() / "als-forest-road";
  if (!available(folder / "terrain.ply")) return;
  const ForestRoad road(folder);
  const bool even = report.flag("--even-draws");
  bench::Table& table =
      make_table(report, "forest", "Profiles of als-forest-road against its terrain");
  const double total = road.station.back();
  const auto on_line = [&](double s) {
    const auto next = std::upper_bound(road.station.begin() + 1, road.station.end() - 1, s);
    const auto a = static_cast<std::size_t>(next - road.station.begin()) - 1;
    const double share = (s - road.station[a]) / (road.station[a + 1] - road.station[a]);
    return Vector2d(road.line[a].head<2>() + share * (road.line[a + 1] - road.line[a]).head<2>());
  };
  Ground ground;
  ground.length = total;
  ground.height = [&](double s, double v) {
    // Across is square to the line over half the half width to either side.
    const Vector2d ahead =
        (on_line(s + 0.5 * kHalfWidth) - on_line(s - 0.5 * kHalfWidth)).normalized();
    const Vector2d place = on_line(s) + v * Vector2d(-ahead.y(), ahead.x());
    return road.grid.height(place.x(), place.y());
  };
  ground.road = ground.height;
  for (const ForestInput& input : kForestInputs) {
    if (input.sigmas) continue;  // sigmas of noise have no part in it
    Row row;
    for (std::uint64_t draw = 0; draw < draws; ++draw) {
      double last = 0.0;  // stations ascend
      ground.station = [&](const Vector3d& p) {
        double best = last, least = 1e30;
        for (double s = last; s <= std::min(total, last + 2.5); s += 0.01) {
          const double off = (on_line(s) - p.head<2>()).norm();
          if (off < least) {
            least = off;
            best = s;
          }
        }
        last = best;
        return best;
      };
      add_profile(
          road.cloud(input, 1000 * report.seed() + 2 * draw + (even ? 0 : 1)), road.line, ground,
          [](double) { return true; }, &row);
    }
    print(input.name, row, &table);
  }
}

void run_cloud_profiles(bench::Report& report) {
  const std::size_t draws = report.count("--draws", 16);
  if (report.wanted("made")) made_roads(report, "made", {{50.0, 0.02}}, draws);
  if (report.wanted("densities")) {
    made_roads(report, "densities",
               {{5.0, 0.01}, {5.0, 0.05}, {20.0, 0.03}, {200.0, 0.01}, {200.0, 0.05}}, draws);
  }
  if (report.wanted("forest")) forest(report, draws);
}

}  // namespace
}  // namespace camber::benchmarks

int main(int argc, char** argv) {
  const camber::bench::Program program = {
      "bench_cloud_profiles",
      "Profiles of clouds along a line against the ground they were made from",
      {"made", "densities", "forest"},
      {{"--draws", "N", "Clouds of a row (default: 16)"},
       {"--even-draws", "", "On the draws that constants are decided on"}}};
  return camber::bench::run_program(program, argc, argv, camber::benchmarks::run_cloud_profiles);
}
