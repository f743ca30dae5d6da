#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "camber/image/image.h"
#include "camber/scene/scene.h"
#include "camber/synth/render_view.h"

namespace camber {

/// How the files of a made scene are laid out. All but the first add the files of a data set, in
/// its own names and encodings, and the manifest's images are those files.
enum class SceneLayout {
  kCamber,         ///< image/, truth/depth/, truth/label/
  kSynthiaSf,      ///< SEQ1/RGBLeft, DepthLeft and GTLeft
  kKittiTracking,  ///< image_02/0000, label_02/0000.txt, calib/0000.txt
};

std::vector<SceneLayout> all_scene_layouts();
std::string_view to_string(SceneLayout layout);
/// @throws std::invalid_argument for another word.
SceneLayout scene_layout_from_string(std::string_view word);

/// A layout and the number of its sequence.
struct DataSetLayout {
  SceneLayout layout = SceneLayout::kCamber;
  int sequence = 0;  ///< SYNTHIA-SF's SEQ1 is 1
  /// SYNTHIA-SF: green + 256 * blue of a vehicle's pixels are the number of the vehicle, from 1 on;
  /// else 0: some releases have classes alone.
  bool instance_ids = true;

  /// Folders below the scene's, to be made before files are written.
  std::vector<std::filesystem::path> folders() const;
  /// Paths below the scene's folder. An empty one: the layout has none such.
  std::filesystem::path image(int frame) const;
  std::filesystem::path depth(int frame) const;
  std::filesystem::path label(int frame) const;
  std::filesystem::path detections() const;  ///< of all frames, KITTI's tracking form
};

/// The z of each pixel as SYNTHIA-SF stores it: red + 256 green + 65536 blue of 2^24 - 1 are
/// 1000 m; farther is 1000 m.
Image synthia_depth_image(const ViewTruth& truth, int width, int height);

/// SYNTHIA-SF's classes in the red channel; green and blue: see DataSetLayout::instance_ids.
Image synthia_label_image(const ViewTruth& truth, int width, int height, bool instance_ids);

/// The frames' detections as KITTI tracking rows without 3D boxes. @throws OutputError.
void write_kitti_detections(const Scene& scene, const std::filesystem::path& path);

/// calib/NNNN.txt (the camera's projection is P2, 6 cm beside camera 0 as KITTI's is),
/// label_02/NNNN.txt (true vehicles, upright as KITTI's: pitch and roll are lost) and
/// keypoints.json (simulated keypoints of the true vehicles that were detected, with track ids).
/// @param scene with its truth. @param root folder of the scene. @throws OutputError.
void write_kitti_tracking_files(const Scene& scene, int sequence,
                                const std::filesystem::path& root);

}  // namespace camber
