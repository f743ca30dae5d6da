#include "benchmarks/steep_road_clips.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "camber/image/image_io.h"
#include "camber/scene/results.h"
#include "camber/synth/synthesise.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

bool read_road(const fs::path& folder, Road* road) {
  if (!fs::exists(folder / "run.json")) return false;
  road->surface = read_surface(folder / "surface.json");
  road->run = read_run(folder / "run.json");
  road->vehicles = read_vehicles(folder / "vehicles.json");
  std::ifstream in(folder / "ground.json");
  const nlohmann::json numbers = nlohmann::json::parse(in);
  const auto rows = static_cast<Eigen::Index>(std::llround(std::sqrt(numbers.size())));
  road->ground.covariance.resize(rows, rows);
  for (Eigen::Index i = 0; i < rows * rows; ++i) {
    road->ground.covariance(i / rows, i % rows) = numbers[static_cast<std::size_t>(i)];
  }
  return true;
}

Road find_road(const Scene& scene, const std::vector<int>& frames, std::uint64_t seed,
               const fs::path& kept) {
  Road road;
  if (!kept.empty() && read_road(kept, &road)) return road;
  ReconstructOptions options;
  options.seed = seed;
  Reconstruction result = reconstruct(scene, frames, options);
  road.surface = std::move(result.surface);
  road.run = std::move(result.run);
  road.vehicles = std::move(result.vehicles);
  road.ground = std::move(result.ground);
  if (!kept.empty()) {
    fs::create_directories(kept);
    write_json(to_json(road.surface), kept / "surface.json");
    write_json(to_json(road.vehicles), kept / "vehicles.json");
    write_json(to_json(road.run), kept / "run.json");
    nlohmann::json numbers = nlohmann::json::array();
    for (const double v : road.ground.covariance.reshaped()) numbers.push_back(v);
    write_json(numbers, kept / "ground.json");
  }
  return road;
}

}  // namespace

std::vector<Clip> read_clips(const fs::path& folder, std::uint64_t seed, const fs::path& keep) {
  std::vector<fs::path> paths;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (fs::exists(entry.path() / "scene.json")) paths.push_back(entry.path());
  }
  std::sort(paths.begin(), paths.end());
  std::vector<Clip> out;
  for (const fs::path& path : paths) {
    Clip clip;
    clip.scene = read_scene(path);
    const auto id = [&](std::size_t k) { return clip.scene.frames[k].id; };
    clip.middle = id(2);
    const fs::path kept = keep.empty() ? fs::path() : keep / path.filename();
    clip.three =
        find_road(clip.scene, {id(1), id(2), id(3)}, seed, kept.empty() ? kept : kept / "three");
    clip.five = find_road(clip.scene, {id(0), id(1), id(2), id(3), id(4)}, seed,
                          kept.empty() ? kept : kept / "five");
    for (const SceneFrame& f : clip.scene.frames) {
      FrameImage image = read_frame_image(f.image, clip.scene.camera);
      clip.images[f.id] = std::move(image.gray);
    }
    out.push_back(std::move(clip));
  }
  return out;
}

const TruthFrame& truth_of(const Scene& scene, int frame) {
  for (const TruthFrame& t : scene.truth->frames) {
    if (t.id == frame) return t;
  }
  throw std::runtime_error("no truth of the frame");
}

void make_scenes(const fs::path& folder, std::uint64_t seed) {
  const RoadProfileKind kinds[] = {
      RoadProfileKind::kSteepHill, RoadProfileKind::kUphill,  RoadProfileKind::kDownhill,
      RoadProfileKind::kCrest,     RoadProfileKind::kSag,     RoadProfileKind::kBank,
      RoadProfileKind::kRolling,   RoadProfileKind::kControl,
  };
  for (int i = 0; i < 8; ++i) {
    SynthOptions options;
    options.seed = 101 + 100 * seed + static_cast<std::uint64_t>(i);
    options.profile = kinds[i];
    options.speed = 6.0 + i;
    options.num_cars = 6;
    options.farthest_car = 50.0;
    options.cloud_points = 1000;
    options.name = "made_" + std::string(to_string(kinds[i]));
    if (seed > 0) options.name += "_" + std::to_string(seed);
    const fs::path scene = folder / options.name;
    if (!fs::exists(scene / "scene.json")) synthesise_scene(options, scene);
  }
}

}  // namespace camber
