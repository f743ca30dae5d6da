#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/import/kitti_labels.h"
#include "camber/scene/scene.h"

namespace camber {

// What the importers share.

/// The frame number that a file is named by ("000048.png" is 48); nothing for other names.
std::optional<int> frame_number(const std::filesystem::path& file);

/// Files of a folder that are named by frame number.
/// @param extensions in lower case, with the dot; the first is named in messages.
/// @param what       what the files are, in words.
/// @throws InputError if the folder is missing, has no such file, or two for one number.
std::map<int, std::filesystem::path> numbered_files(const std::filesystem::path& folder,
                                                    const std::vector<std::string>& extensions,
                                                    const char* what);

/// Keeps the frames of a --frames list. @return their ids. @throws UsageError as select_frames.
std::vector<int> keep_frames(Scene& scene, const std::string& list);

/// Sets the camera's size from the headers of the frames' images, which must agree.
/// @throws InputError otherwise.
void measure_images(Scene& scene);

/// The rectangle around a box's projected corners, not clipped; nothing for a box that reaches
/// behind the camera.
std::optional<Box2> projected_box(const OrientedBox& box, const PinholeCamera& camera);

/// Share of a box's picture that lies outside the image: of projected_box() the part outside; 1 for
/// a box that reaches behind the camera.
double projected_truncation(const OrientedBox& box, const PinholeCamera& camera);

/// KITTI label rows of one frame and the file that they come from.
struct FrameLabels {
  std::filesystem::path file;
  std::vector<KittiLabel> labels;
};

/// Label rows of the given frames from a tracking file, a folder of object files (named by frame
/// number), or a single object file. @throws InputError.
std::map<int, FrameLabels> read_frame_labels(const std::filesystem::path& path,
                                             const std::vector<SceneFrame>& frames,
                                             const char* what, const LogSink& warn);

/// The rows whose type (in lower case) is one of the classes; never DontCare.
std::vector<KittiLabel> vehicles_among(const std::vector<KittiLabel>& labels,
                                       const std::set<std::string>& classes);

/// An id for each label that no other has: the tracks where they all differ, else the row numbers.
std::vector<int> ids_of(const std::vector<KittiLabel>& labels);

std::vector<VehicleDetection> detections_of(const std::vector<KittiLabel>& labels);

/// Reads a detector's boxes in KITTI's form into the frames; detections_source "network".
void put_detections(Scene& scene, const std::filesystem::path& path,
                    const std::set<std::string>& classes, const LogSink& warn);

}  // namespace camber
