#pragma once

#include <cstddef>
#include <optional>
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
  /// A camera that is guessed (camera_is_guessed()) is calibrated by the frames about the
  /// reference.
  bool calibrates = true;
  LogSink notice;  ///< a sentence for whatever was decided; may be empty
  LogSink warn;    ///< what is wrong with networks' descriptions; may be empty
};

/// Frames about the reference, some ten a second, that calibrate a guessed camera.
inline constexpr std::size_t kMostCalibrationFrames = 150;

/// A result and the scene that it is of: with the boxes and keypoints of the networks.
struct SceneReconstruction {
  Reconstruction result;
  Scene scene;
  /// The scene as given but for its camera, where that was calibrated on the way.
  std::optional<Scene> calibrated;
};

/// What `camber reconstruct` computes of a scene. `run.extra["networks"]` lists the networks,
/// `run.extra["camera_by_drive"]` what the drive showed of a guessed camera
/// (to_json(CameraByDrive)).
/// @throws as reconstruct(), choose_frames(), detect_frames() and find_keypoints().
SceneReconstruction reconstruct_scene(const Scene& scene, const ReconstructSceneOptions& options,
                                      const Progress& progress = {});

}  // namespace camber
