#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/image/frame_masks.h"
#include "camber/image/frame_pixels.h"
#include "camber/image/image.h"
#include "camber/scale/lane_marking_detection.h"
#include "camber/scene/scene.h"
#include "camber/scene/travelled.h"

namespace camber {

/// What is known of a run's metres beside its images.
struct KnownMetres {
  std::optional<double> camera_height;  ///< m, above the road under the camera
  double camera_height_sigma = 0.01;    ///< m
  LaneMarkingSizes markings;            ///< of painted markings
  /// From each frame to the next by the speeds of the scene's frames, also of those between that
  /// are not used, m; nothing where one of the two has none. One between without a speed is passed
  /// over.
  std::vector<std::optional<double>> travelled;
  DistanceSigma travelled_sigma;  ///< of the known ones together

  /// Whether some stretch is known by its speed.
  bool has_speed() const;
};

/// The images of a run with what is known of their pixels, one entry a frame, ascending ids.
struct LoadedFrames {
  PinholeCamera camera;
  CameraSigma camera_sigma;
  std::vector<SceneFrame> frames;
  std::size_t reference = 0;      ///< index of the frame whose camera is the world of the run
  std::vector<GrayImage> gray;    ///< intensities
  std::vector<Image> color;       ///< 3 channels
  std::vector<FrameMasks> masks;  ///< of every image
  bool masks_by_network = false;  ///< the scene's segmentation is a network's
  /// The contradicted poses (below) turn by other angles than the images, which hang on no choice
  /// of axes: they are of other moments, and so are the lengths between them.
  bool poses_of_other_moments = false;
  KnownMetres known;
  std::string detections_source;       ///< as the scene declares it
  std::optional<double> box_sigma_px;  ///< of the detections, as the scene states it
  double frame_rate = 10.0;            ///< Hz, for frames without a time
  /// Why of the poses that the scene gives only the lengths between positions are used; empty: the
  /// poses are the motion.
  std::string contradicted_poses;
  /// Path as the scene gives it and hash of its content, of all files that were read; "frame 7:
  /// image" and the like for what came from memory.
  std::vector<std::pair<std::string, std::string>> input_hashes;

  std::size_t size() const { return frames.size(); }
  const FrameMasks& reference_masks() const { return masks[reference]; }
  bool has_poses() const;  ///< whether the scene gives the pose of every frame, uncontradicted
  /// Whether a segmentation or road mask shows the road of the reference image.
  bool has_masks() const { return masks[reference].has_mask; }
};

namespace stages {

/// All frames are matched with one reference frame and solved together, in memory and time that
/// grow with their number.
constexpr std::size_t kMostFrames = 64;

/// For work that comes before load().
/// @throws std::invalid_argument for more than kMostFrames.
void check_frame_count(std::size_t count);

struct LoadOptions {
  bool use_masks = true;      ///< false: segmentations and road masks are not read
  bool single_image = false;  ///< one frame is accepted
  int num_threads = 0;        ///< <= 0: see resolve_num_threads
  /// By frame id, as the image files are, in place of the scene's files: a segmenter's.
  std::map<int, Image> labels;
  /// By frame id, px: what may be vehicles beside the scene's. They mask the road and the matches
  /// for the motion as those do, and are not estimated.
  std::map<int, std::vector<Box2>> vehicle_boxes;
  /// Images and masks in memory, in place of the scene's files; asked once for each frame.
  FramePixelSource pixels;
};

/// Decodes the images and masks of the frames, or takes them from `options.pixels`.
/// @param frame_ids  two ids of the scene to kMostFrames, ascending; else std::invalid_argument.
/// @throws InputError for missing, damaged or mismatching images (std::invalid_argument for those
///         in memory); NoAnswerError for one frame, for a frame without an image and for two frames
///         with the same image.
LoadedFrames load(const Scene& scene, const std::vector<int>& frame_ids,
                  const LoadOptions& options);

/// One frame of a drive, read once for all windows that show it.
struct LoadedFrame {
  SceneFrame frame;
  GrayImage gray;
  Image color;
  FrameMasks masks;
  std::vector<std::pair<std::string, std::string>> input_hashes;  ///< as LoadedFrames's
};

/// Reads frames one after the other: the lens's map is made once, a video is read on as long as the
/// ids ascend.
class FrameLoader {
 public:
  /// @param scene  kept by reference; validated, else std::invalid_argument.
  FrameLoader(const Scene& scene, LoadOptions options);
  ~FrameLoader();
  /// @throws InputError for an image that is missing, damaged or of another size; NoAnswerError for
  ///         a frame without an image; std::invalid_argument for an id that the scene does not
  ///         have.
  std::shared_ptr<const LoadedFrame> load(int frame_id);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// A window of frames as load() gives it. @param reference  index into `frames`.
LoadedFrames frame_window(const Scene& scene,
                          const std::vector<std::shared_ptr<const LoadedFrame>>& frames,
                          std::size_t reference);

/// Indices of frames, both ends included.
struct FrameRange {
  std::size_t first = 0, last = 0;
  std::size_t size() const { return last - first + 1; }
};

/// The frames of a range that holds the reference, else std::invalid_argument.
LoadedFrames frames_within(const FrameRange& range, const Scene& scene, LoadedFrames frames);

}  // namespace stages
}  // namespace camber
