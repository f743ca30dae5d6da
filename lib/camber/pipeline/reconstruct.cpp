#include "camber/pipeline/reconstruct.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "camber/pipeline/estimate_window.h"
#include "camber/pipeline/pose_offset.h"
#include "camber/pipeline/reconstruct_image.h"
#include "camber/pipeline/reconstruct_paper.h"
#include "camber/pipeline/run_details.h"
#include "camber/pipeline/stage_runner.h"
#include "camber/pipeline/stages/level.h"
#include "camber/scene/georeference.h"

namespace camber {
namespace {

Image road_mask_of(const LoadedFrames& frames) {
  if (!frames.masks_by_network || !frames.has_masks()) return {};
  const FrameMasks& masks = frames.reference_masks();
  Image out{frames.camera.width, frames.camera.height, 1, masks.roadway};
  for (std::size_t i = 0; i < out.data.size(); ++i) {
    out.data[i] = masks.roadway[i] ? 1 : masks.ground[i] ? 2 : 0;
  }
  return out;
}

/// Of poses of other moments: by how much their clock is off, where the whole scene shows it.
void name_pose_offset(const Scene& scene, int reference, const FramePixelSource& pixels,
                      RunDocument* run) {
  const std::optional<PoseOffset> offset = find_pose_offset(scene, reference, pixels);
  if (!offset) return;
  run->extra["pose_offset"] = {{"seconds", offset->seconds},
                               {"frames", offset->frames},
                               {"correlation", offset->correlation},
                               {"correlation_without", offset->without}};
  for (RunDocument::Warning& warning : run->warnings) {
    if (warning.code == "poses_contradicted") warning.text += "; " + describe(*offset);
  }
}

}  // namespace

void ReconstructOptions::validate() const {
  if (rounds < 0) {
    throw std::invalid_argument("rounds = " + std::to_string(rounds) + ", expected at least 0");
  }
  if (preset == Preset::kPaper && vehicles.method == VehicleMethod::kReprojection) {
    throw std::invalid_argument(
        "method: reprojection, must be joint, coplanar or flat with preset paper");
  }
  match.flow.validate();
  motion.validate();
  surface.validate();
  vehicles.fit.validate();
  vehicles.support.validate();
  paper.vehicles.weights.validate();
}

Reconstruction reconstruct(const Scene& scene, const std::vector<int>& frame_ids,
                           const ReconstructOptions& options, const Progress& progress) {
  options.validate();
  ReconstructOptions o = handed_down(options);
  if (o.preset == Preset::kPaper) return reconstruct_paper(scene, frame_ids, o, progress);
  if (frame_ids.size() == 1) return reconstruct_image(scene, frame_ids, o, progress);
  Timings timings;
  StageRunner run(timings, progress);

  LoadedFrames loaded = run("load", 0.0, [&] { return stages::load(scene, frame_ids, o.load); });
  WindowEstimate window = estimate_window(scene, std::move(loaded), o, run);
  AssembledRoad& road = window.assembled;
  stages::level_by_gravity(scene, &road.run, &road.surface);
  if (progress) progress("surface", 1.0);

  LoadedFrames& frames = window.road.frames;
  Reconstruction out = handed_out(frame_ids, o, frames, std::move(road));
  if (frames.poses_of_other_moments) {
    name_pose_offset(scene, out.reference_frame, o.load.pixels, &out.run);
  }
  out.ground = std::move(window.vehicles.ground.under_detections);
  out.road_mask = road_mask_of(frames);
  describe_run(options, out.frame_ids, frames, window.refined, window.scaled, &out.run);
  put_georeference(scene, out.surface, &out.run);
  out.run.timings = timings;
  return out;
}

}  // namespace camber
