#pragma once

#include <vector>

#include "camber/pipeline/network_choice.h"
#include "camber/pipeline/reconstruct.h"

namespace camber {

/// The main job with what goes around it: the choice of frames and the networks.
struct ReconstructSceneOptions {
  /// `run.load.pixels`: images in memory, for the networks, too.
  ReconstructOptions run;
  /// Ids, ascending. Empty: those of choose_frames(), fewer where they give no answer; the frame of
  /// a scene that has one.
  std::vector<int> frames;
  NetworkChoice networks;
  /// Where no detector is chosen and the scene has no boxes: vehicles are what the one that ships
  /// finds. False: it only keeps them out of the road.
  bool places_vehicles = true;
  LogSink notice;  ///< a sentence for whatever was decided; may be empty
  LogSink warn;    ///< what is wrong with networks' descriptions; may be empty
};

/// A result and the scene that it is of: with the boxes and keypoints of the networks.
struct SceneReconstruction {
  Reconstruction result;
  Scene scene;
};

/// What `camber reconstruct` computes of a scene. `run.extra["networks"]` lists the networks.
/// @throws as reconstruct(), choose_frames(), detect_frames() and find_keypoints().
SceneReconstruction reconstruct_scene(const Scene& scene, const ReconstructSceneOptions& options,
                                      const Progress& progress = {});

}  // namespace camber
