#pragma once

#include <filesystem>

#include "camber/scene/scene.h"
#include "camber/synth/synthesise.h"

namespace camber {

/// Where a world's frames stand in the scene that they are of.
struct FramePlace {
  int first = 0;             ///< number of the world's frame 0
  SE3 truth_from_world;      ///< of the poses that are written
  std::uint64_t random = 0;  ///< another one, other noise
  bool depth = true;         ///< of the first and the last frame of the scene
};

/// Makes the files of a world's frames, one after the other.
class FrameWriter {
 public:
  /// All must outlive it. @param view  what the images are seen with
  FrameWriter(const SynthOptions& options, const ViewCamera& view, const SynthWorld& world,
              const FramePlace& place, const std::filesystem::path& root, SynthSummary* summary);

  /// Depth, labels, poses and vehicles; the segmentation and detections that follow from them.
  /// @param f  of the world
  void write_truth(int f, SceneFrame* frame, TruthFrame* truth);
  void write_image(int f, SceneFrame* frame);

 private:
  const SynthOptions& options_;
  const ViewCamera& view_;
  const SynthWorld& world_;
  FramePlace place_;
  const std::filesystem::path& root_;
  SynthSummary* summary_;
  CameraSensor sensor_;
  DetectorModel detector_;
};

}  // namespace camber
