// Made scenes through a lens against the same drives without one: the same roads, cars and noise,
// seen by a camera of the same focal length. --seed is that of the first scene's world.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <map>
#include <string>
#include <vector>

#include "benchmarks/report.h"
#include "camber/cloud/cloud_io.h"
#include "camber/core/memory.h"
#include "camber/evaluate/metrics.h"
#include "camber/pipeline/reconstruct.h"
#include "camber/synth/synthesise.h"
#include "support/test_data.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

struct LensCase {
  std::string name;
  PinholeCamera camera;  ///< of the image files
  LensModel model = LensModel::kNone;
  std::vector<double> coefficients;
};

/// What one run gives, by what it is of: pairs of runs are compared where both have a value.
struct Figures {
  double scale = 0.0, direction_deg = 0.0, ego_height = 0.0;
  std::map<int, double> road;                             ///< m, by point of the true cloud
  std::map<std::string, std::pair<double, double>> cars;  ///< m: ground under it, its centre
};

double median(std::vector<double> values) {
  if (values.empty()) return std::nan("");
  std::nth_element(values.begin(), values.begin() + values.size() / 2, values.end());
  return values[values.size() / 2];
}

double mean(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double v : values) sum += v;
  return sum / static_cast<double>(values.size());
}

SynthOptions scene_options(const LensCase& lens, std::uint64_t seed, int index, bool through) {
  const auto& profiles = all_road_profile_kinds();
  SynthOptions options;
  options.seed = seed + static_cast<std::uint64_t>(index);
  options.profile = profiles[static_cast<std::size_t>(index) % profiles.size()];
  options.num_frames = 3;
  options.sensor.supersampling = 2;
  options.camera = lens.camera;
  options.cloud_points = 3000;
  if (through) {
    options.lens = lens.model;
    options.lens_coefficients = lens.coefficients;
  }
  return options;
}

/// Errors of the road's height at true points 4 to 40 m ahead, where the surface answers.
std::map<int, double> road_errors(const Scene& scene, const Reconstruction& result) {
  const auto pose_of = [&](int id) {
    for (const TruthFrame& frame : scene.truth->frames) {
      if (frame.id == id) return *frame.world_from_camera;
    }
    throw std::logic_error("no pose of a frame");
  };
  const RoadCloud cloud = read_cloud(scene.truth->cloud);
  const SE3 reference_from_cloud =
      pose_of(result.reference_frame).inverse() * pose_of(scene.truth->cloud_frame.value_or(0));
  std::map<int, double> out;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (cloud.labels.at("label")[i] != 1) continue;
    const Eigen::Vector3d place = reference_from_cloud * cloud.points[i].cast<double>();
    if (place.z() < 4.0 || place.z() > 40.0) continue;
    const SurfaceQuery query = result.surface.query(place);
    if (query.status == Status::kFailed) continue;
    out[static_cast<int>(i)] = std::abs(query.plane.plane.signed_distance(place));
  }
  return out;
}

Figures run_scene(const SynthOptions& options, std::uint64_t seed) {
  const test::TemporaryFolder folder;
  synthesise_scene(options, folder.path() / "scene");
  const Scene scene = read_scene(folder.path() / "scene");
  ReconstructOptions run;
  run.seed = seed;
  const Reconstruction result = reconstruct(scene, {0, 1, 2}, run);
  const SceneMetrics metrics = evaluate_scene(scene, result.surface, result.vehicles, result.run);
  Figures out;
  out.scale = std::abs(metrics.scale_error);
  out.direction_deg = metrics.direction_error * kDegrees;
  out.ego_height = std::abs(metrics.ego_height_error);
  out.road = road_errors(scene, result);
  for (const VehicleError& error : metrics.vehicles) {
    if (!error.answered) continue;
    out.cars[std::to_string(error.frame) + "/" + std::to_string(error.truth_id)] = {
        std::abs(error.height_error), error.center_error};
  }
  return out;
}

/// Values of what both runs of a scene answer: without the lens, through it.
struct Pairs {
  std::vector<double> plain, lens;
  void add(double without, double through) {
    plain.push_back(without);
    lens.push_back(through);
  }
};

/// Standard error of the mean difference over scenes, from the scenes' means.
double standard_error(const std::vector<double>& differences) {
  const double middle = mean(differences), n = static_cast<double>(differences.size());
  double squares = 0.0;
  for (const double d : differences) squares += (d - middle) * (d - middle);
  return n > 1.0 ? std::sqrt(squares / (n - 1.0) / n) : std::nan("");
}

void run_case(bench::Report& report, const LensCase& lens, int scenes) {
  static const std::array<const char*, 5> kNames = {"scale, per cent", "direction of travel, deg",
                                                    "road height, m", "ground under cars, m",
                                                    "centres of cars, m"};
  std::array<Pairs, 5> of_scene, pooled;  // means a scene; every value
  bench::Items& items = report.items(
      "lens." + lens.name, {bench::lower("scale without", "%"), bench::lower("scale through", "%"),
                            bench::lower("road without", "m"), bench::lower("road through", "m")});
  for (int i = 0; i < scenes; ++i) {
    const SynthOptions plain = scene_options(lens, report.seed(), i, false);
    const Figures a = run_scene(plain, report.seed());
    const Figures b = run_scene(scene_options(lens, report.seed(), i, true), report.seed());
    std::array<Pairs, 5> here;
    here[0].add(100.0 * a.scale, 100.0 * b.scale);
    here[1].add(a.direction_deg, b.direction_deg);
    for (const auto& [key, value] : a.road) {
      if (const auto other = b.road.find(key); other != b.road.end()) {
        here[2].add(value, other->second);
      }
    }
    for (const auto& [key, value] : a.cars) {
      const auto other = b.cars.find(key);
      if (other == b.cars.end()) continue;
      here[3].add(value.first, other->second.first);
      here[4].add(value.second, other->second.second);
    }
    for (std::size_t k = 0; k < here.size(); ++k) {
      if (here[k].plain.empty()) continue;
      of_scene[k].add(mean(here[k].plain), mean(here[k].lens));
      for (std::size_t n = 0; n < here[k].plain.size(); ++n) {
        pooled[k].add(here[k].plain[n], here[k].lens[n]);
      }
    }
    items.add(std::string(to_string(plain.profile)) + "_" + std::to_string(i),
              {100.0 * a.scale, 100.0 * b.scale, mean(here[2].plain), mean(here[2].lens)});
  }
  bench::Table& table =
      report.table("lens." + lens.name, "Made scenes through a lens: " + lens.name, lens.name,
                   {bench::label("error"), bench::value("values"), bench::lower("without, mean"),
                    bench::lower("through, mean"), bench::lower("ratio"),
                    bench::value("standard error of the ratio"), bench::lower("without, median"),
                    bench::lower("through, median")});
  std::printf("\n## %s, %d scenes: mean errors (medians) without and through the lens\n",
              lens.name.c_str(), scenes);
  for (std::size_t k = 0; k < kNames.size(); ++k) {
    const Pairs& all = pooled[k];
    if (all.plain.empty()) continue;
    std::vector<double> differences;
    for (std::size_t n = 0; n < of_scene[k].plain.size(); ++n) {
      differences.push_back(of_scene[k].lens[n] - of_scene[k].plain[n]);
    }
    const double without = mean(all.plain), through = mean(all.lens);
    const double ratio = through / without;
    const double error = standard_error(differences) / mean(of_scene[k].plain);
    std::printf("%-26s %5zu values: %.4f (%.4f) and %.4f (%.4f), ratio %.2f +- %.2f\n", kNames[k],
                all.plain.size(), without, median(all.plain), through, median(all.lens), ratio,
                error);
    table.row({kNames[k], all.plain.size(), without, through, ratio, error, median(all.plain),
               median(all.lens)});
  }
}

void run_lenses(bench::Report& report) {
  const LensCase cases[] = {{"brown",
                             {1242, 375, 721.5377, 721.5377, 609.5593, 172.854},
                             LensModel::kBrown,
                             {-0.35, 0.15, 0.0005, -0.0005, -0.03}},
                            // 120 degrees from border to border: 480 px at 60 degrees.
                            {"fisheye",
                             {960, 540, 458.0, 458.0, 479.5, 255.0},
                             LensModel::kFisheye,
                             {0.002, -0.001, 0.0, 0.0}}};
  const auto scenes = static_cast<int>(report.count("--scenes", 10));
  for (const LensCase& lens : cases) {
    if (report.wanted(lens.name)) run_case(report, lens, scenes);
  }
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using namespace camber;
  keep_freed_memory();  // as the command does
  const bench::Program program = {
      "bench_lens",
      "Made scenes through a lens against the same drives without one",
      {"brown", "fisheye"},
      {{"--scenes", "N", "Number of scenes a lens (default 10)", true}}};
  return bench::run_program(program, argc, argv, run_lenses);
}
