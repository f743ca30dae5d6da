#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/progress.h"
#include "camber/pipeline/stages/assemble.h"
#include "camber/pipeline/stages/ground.h"
#include "camber/pipeline/stages/load.h"
#include "camber/pipeline/stages/match.h"
#include "camber/pipeline/stages/motion.h"
#include "camber/pipeline/stages/paper_ground.h"
#include "camber/pipeline/stages/paper_vehicles.h"
#include "camber/pipeline/stages/scale.h"
#include "camber/pipeline/stages/surface.h"
#include "camber/pipeline/stages/vehicles.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

/// The paper's own stages (preset kPaper); load, match, motion, the ground's points and the method,
/// keypoint set and prior of `vehicles` are those of ReconstructOptions.
struct PaperOptions {
  stages::PaperGroundOptions ground;
  stages::PaperVehicleOptions vehicles;
};

/// Options of the main job: those of its stages. Seed and threads are handed down to all of them.
struct ReconstructOptions {
  std::uint64_t seed = 0;
  int num_threads = 0;      ///< <= 0: see resolve_num_threads
  int rounds = 3;           ///< of matching again with the ground known, at most; >= 0
  bool photometric = true;  ///< refine motion and ground on the intensities of all images
  /// What passes on the road is a source of every window, not only where its road is in doubt.
  bool sweep_road = false;
  stages::LoadOptions load;
  stages::MatchOptions match;
  MotionOptions motion;
  stages::GroundOptions ground;
  stages::ScaleOptions scale;
  stages::SurfaceOptions surface;
  stages::VehicleOptions vehicles;
  Preset preset = Preset::kDefault;
  PaperOptions paper;     ///< of preset kPaper
  void validate() const;  ///< throws std::invalid_argument
};

/// Everything that a run finds, in the reference camera's frame.
struct Reconstruction {
  std::vector<int> frame_ids;  ///< of those asked for, the ones within reach of the reference
  int reference_frame = 0;     ///< frame id
  RoadCloud cloud;             ///< road points; labels["patch"]; colours; sigmas
  RoadSurface surface;
  VehicleDocument vehicles;
  /// Of the planes under the vehicles (method joint), before the vehicles were placed.
  SharedGround ground;
  RunDocument run;
  std::vector<Image> images;  ///< colour, one a frame, as read
  /// Of the reference frame where its mask is a network's: 1 road, 2 pavement, 0 neither, after
  /// what lies off the road's surface was taken off. Empty otherwise.
  Image road_mask;
};

/// The main job: a few frames of one moving camera to a metric road surface with vehicles on it.
/// Truth in the scene is not read. Images are read from the scene's files, or come from memory or a
/// callback: `options.load.pixels`.
/// @param frame_ids  ids of the scene, ascending. One alone: the road and its metres by markings of
///                   known size (Scene::markings_m); preset kPaper: planes and metres by the scene
///                   (given planes, or the camera's height).
/// @throws NoAnswerError for a stationary camera, a pure rotation, too little texture or road, and
///         UnknownScaleError (stages/judge.h) where what is known of the scale contradicts itself;
///         InputError for missing, damaged or mismatching images.
Reconstruction reconstruct(const Scene& scene, const std::vector<int>& frame_ids,
                           const ReconstructOptions& options, const Progress& progress = {});

/// Frames for a run that names none: the reference and up to two on each side. One of these is as
/// many frames away as it takes to see the near road move (a slow drive has no parallax between
/// consecutive ones), the other half as many; where neighbours are enough, the next ones.
struct ChosenFrames {
  std::vector<int> ids;  ///< ascending
  int spacing = 1;       ///< frames from the reference to those that show the near road move
  /// Of the near road over that spacing, rotation taken out; 0 where there was nothing to choose
  /// and no image was looked at.
  double parallax_px = 0.0;
  /// Where `ids` give no answer, in turn: one frame on each side, neighbours.
  std::vector<std::vector<int>> instead;
};

/// @param pixels  images in memory, as LoadOptions::pixels; asked for the frames that are looked
/// at.
/// @param each_side  frames on each side of the reference: 2, or 1 for the paper's three views.
/// @throws NoAnswerError for a scene of one frame or without images; InputError as reconstruct;
/// std::invalid_argument.
ChosenFrames choose_frames(const Scene& scene, const FramePixelSource& pixels = {},
                           int each_side = 2);

struct WriteReconstructionOptions {
  bool pictures = true;
  bool overwrite = false;  ///< also replace a foreign folder that is not empty
  int num_threads = 0;     ///< of the pictures, as resolve_num_threads()
  /// What was read, beside the images: no folder that holds any of it is replaced.
  std::vector<std::filesystem::path> inputs;
  /// Adds files of the caller's to the folder before it takes its name; may be empty.
  std::function<void(const std::filesystem::path& staging)> add_files;
};

/// Writes the result folder (road.ply, surface.json, vehicles.json, run.json, metrics.json where
/// the scene has truth; with pictures also overlay_*.png, scene.png, bev.png, scene.glb and
/// report.html), whole or not at all.
/// @return one-line summary of the errors against truth, empty without truth.
/// @throws OutputError, MachineError (no rendering back end).
std::string write_reconstruction(const Scene& scene, Reconstruction& result,
                                 const std::filesystem::path& folder,
                                 const WriteReconstructionOptions& options,
                                 const Progress& progress = {});

}  // namespace camber
