#include "camber/render/loaded_result.h"

#include <system_error>

#include "camber/core/errors.h"
#include "camber/core/referred_file.h"
#include "camber/scene/scene_of_run.h"
#include "camber/scene/surface_tiles.h"

namespace camber {

int LoadedResult::reference_frame() const {
  if (run) {
    for (const RunDocument::CameraPose& camera : run->cameras) {
      const SE3& pose = camera.reference_from_camera;
      if (pose.translation().norm() < 1e-12 && rotation_to_vector(pose.rotation()).norm() < 1e-12) {
        return camera.id;
      }
    }
  }
  if (vehicles && !vehicles->frames.empty()) {
    return vehicles->frames[vehicles->frames.size() / 2].id;
  }
  return 0;
}

void LoadedResult::load_scene_truth_cloud(const ReadOptions& options) {
  if (!scene || !scene->truth || scene->truth->cloud.empty()) {
    throw NoAnswerError("there is no dense ground truth: the scene has no truth cloud");
  }
  if (run && !run->metric) {
    throw NoAnswerError(
        "the truth cannot be placed: the result is up to scale, the truth in metres");
  }
  const SceneTruth& truth = *scene->truth;
  const int reference = reference_frame();
  const auto pose = [&](int id) {
    for (const TruthFrame& frame : truth.frames) {
      if (frame.id == id && frame.world_from_camera) return *frame.world_from_camera;
    }
    throw NoAnswerError("the truth cloud cannot be placed: the scene has no true pose of frame " +
                        std::to_string(id));
  };
  reference_from_truth_cloud = SE3();
  if (!truth.cloud_frame || *truth.cloud_frame != reference) {
    const SE3 world_from_cloud = truth.cloud_frame ? pose(*truth.cloud_frame) : SE3();
    reference_from_truth_cloud = pose(reference).inverse() * world_from_cloud;
  }
  const auto read = [&](const LogSink&) { return read_cloud_file(truth.cloud, options).cloud; };
  truth_cloud = read_referred_file(truth.cloud, "a point cloud", {}, read);
}

std::string LoadedResult::load_scene_of_run(const LogSink& warn, ScenePaths paths) {
  if (!run) return {};
  std::string missing;
  if (std::optional<Scene> read = read_scene_of_run(*run, path, warn, paths, &missing)) {
    scene = std::move(*read);
  }
  return missing;
}

PictureContent LoadedResult::content() const {
  PictureContent content;
  if (cloud) content.cloud = &*cloud;
  content.projected = cloud && cloud->frame != CloudFrame::kCamera && cloud_report.crs &&
                      cloud_report.crs->kind == CoordinateSystem::Kind::kProjected;
  if (surface) content.surface = &*surface;
  if (vehicles) content.vehicles = &*vehicles;
  if (run) content.run = &*run;
  if (scene) {
    content.camera = &scene->camera;
    if (scene->truth) content.truth = &*scene->truth;
  }
  if (truth_cloud) {
    content.truth_cloud = &*truth_cloud;
    content.reference_from_truth_cloud = reference_from_truth_cloud;
  }
  content.frame = reference_frame();
  return content;
}

LoadedResult load_result(const std::filesystem::path& path, const ReadOptions& options) {
  namespace fs = std::filesystem;
  LoadedResult result;
  result.path = path;
  std::error_code error;
  if (!fs::exists(path, error)) {
    throw InputError(path.string(), "no such file or folder, expected a result folder or a cloud");
  }
  const auto load_cloud = [&](const fs::path& file) {
    CloudFile read = read_cloud_file(file, options);
    result.cloud = std::move(read.cloud);
    result.cloud_report = std::move(read.report);
  };
  if (!fs::is_directory(path, error)) {
    if (path.extension() == ".json") {
      result.vehicles = read_vehicles(path);
      return result;
    }
    load_cloud(path);
    return result;
  }
  if (!fs::exists(path / "run.json", error)) {
    throw InputError(path.string(), "found no run.json, expected the folder of a Camber result");
  }
  const fs::path road = road_folder(path);
  result.run = read_run(road / "run.json");
  // A reconstruction has the road's cloud, the patches of a cloud have the cloud with their labels.
  for (const char* name : {"road.ply", "labels.ply"}) {
    if (!result.cloud && fs::exists(road / name, error)) load_cloud(road / name);
  }
  if (options.bounds && has_surface_tiles(road)) {
    const PlanBounds& b = *options.bounds;
    result.surface =
        read_surface_within(road, {Eigen::Vector2d(b.x0, b.y0), Eigen::Vector2d(b.x1, b.y1)});
  } else if (fs::exists(road / "surface.json", error)) {
    result.surface = read_surface(road / "surface.json");
  }
  if (fs::exists(path / "vehicles.json", error)) {
    result.vehicles = read_vehicles(path / "vehicles.json");
  }
  return result;
}

}  // namespace camber
