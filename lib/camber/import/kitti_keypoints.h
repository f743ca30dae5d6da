#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/scene/scene.h"

namespace camber {

/// Keypoints of one car in one frame of a KITTI tracking sequence.
struct KittiKeypoints {
  std::optional<int> sequence;  ///< none: of any
  int frame = 0;
  std::optional<int> track;  ///< KITTI's track id
  std::optional<Box2> box;   ///< px
  std::vector<KeypointObservation> keypoints;
};

/// Reads a JSON list of objects with `frame`, `keypoints_uv_confidence` (36 rows u, v, confidence
/// or null, in the order of docs/keypoints.md), `track_id` or `bbox_xyxy` or both, and `sequence`.
/// Other keys are passed over.
/// @throws InputError "file: JSON path: found, expected".
std::vector<KittiKeypoints> read_kitti_keypoints(const std::filesystem::path& path);

/// How many keypoint sets met a detection.
struct KeypointMatches {
  int placed = 0, left_over = 0;  ///< of the scene's frames and the sequence
};

/// Gives the scene's detections their keypoints: by track where both have one, else to the box of
/// largest overlap, at least one half.
/// @param sequence  sets of other sequences are passed over; none: sets that name one are refused
///                  by an InputError (@param file for its message).
KeypointMatches put_kitti_keypoints(const std::vector<KittiKeypoints>& sets,
                                    const std::optional<int>& sequence,
                                    const std::filesystem::path& file, Scene* scene);

}  // namespace camber
