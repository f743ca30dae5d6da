#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "camber/calibrate/camera_sources.h"
#include "camber/calibrate/feature_tracks.h"
#include "camber/calibrate/known_sizes.h"
#include "camber/calibrate/lens_estimate.h"
#include "camber/calibrate/mounting.h"
#include "camber/calibrate/window_start.h"
#include "camber/core/progress.h"
#include "camber/core/stopwatch.h"
#include "camber/image/frame_pixels.h"
#include "camber/scene/scene.h"

namespace camber {

/// Puts the boxes and keypoints of vehicles into some frames of a scene, of its camera.
using VehicleFinder = std::function<void(const std::vector<int>& frame_ids, Scene* scene)>;

struct CalibrateOptions {
  FeatureTrackOptions tracks;
  WindowStartOptions start;
  LensEstimateOptions lens;
  /// Key frames of a window, 3 to 16; the last is the next one's first. A short drive has shorter
  /// windows, three of them.
  int window_frames = 8;
  int most_windows = 80;  ///< those with the widest turns and others spread evenly, >= 4
  std::uint64_t seed = 0;
  int num_threads = 0;  ///< <= 0: see resolve_num_threads
  /// What is known before; none: lens_prior_of_cars(). The drive is joined with it once, in one
  /// estimate, which is widened where the two contradict each other.
  std::optional<LensPrior> prior;
  KnownSizesOptions sizes;
  VehicleFinder find_vehicles;  ///< empty: vehicles are those of the scene that have keypoints
  /// Relative sigma of the focal length beyond which what has known sizes is looked at.
  double sizes_from = 0.0;
  bool skip_unreadable = false;  ///< frames whose image cannot be read; false: InputError
  void validate() const;         ///< throws std::invalid_argument
};

/// A camera from its own drive.
struct DriveCalibration {
  LensPrior prior;
  LensEstimate lens;
  Mounting mounting;
  std::size_t frames = 0, key_frames = 0, windows = 0;
  double turn = 0.0;  ///< rad, of all windows together
  std::string focal_decided_by;
  std::vector<CameraSource> sources;  ///< of focal length and height, as they were joined
  CameraJoint joint;
  /// Squared standard deviations between the focal length of the drive and that of
  /// CalibrateOptions::prior; 0 without one.
  double focal_surprise = 0.0;
  std::vector<std::string> notes;  ///< what cannot be seen, a sentence each
  Timings timings;
};

/// What was tracked along a drive.
struct TrackedDrive {
  int width = 0, height = 0;  ///< of the images, px
  std::vector<FeatureTrack> tracks;
  std::vector<int> key_ids;           ///< frame ids of the key frames, ascending
  std::optional<MetresAlong> metres;  ///< of the key frames, by speeds or positions
};

/// Reads the frames one after the other, as the files have them.
/// @param frame_ids  ascending ids of the scene.
/// @param pixels     images in memory in place of files; empty: all are files.
/// @throws InputError, unless such frames are skipped.
TrackedDrive track_drive(const Scene& scene, const std::vector<int>& frame_ids,
                         const CalibrateOptions& options, const FramePixelSource& pixels = {},
                         const Progress& progress = {});

/// The height as one source of the joint measures it, with the joint's focal length.
/// @return nothing where there is none of that name that was accepted.
std::optional<MountingNumber> height_by(const DriveCalibration& calibration,
                                        const std::string& source);

/// The lens and the mounting of a camera by the tracks of its drive, with what the tracks have of
/// metres.
/// @throws NoAnswerError where the camera stands or nothing can be tracked.
DriveCalibration calibrate_tracks(const TrackedDrive& drive, const CalibrateOptions& options,
                                  const Progress& progress = {});

/// Both, joined with what has known sizes (vehicles, the scene's markings) and the height that the
/// scene states. No calibration of the scene is used.
DriveCalibration calibrate_drive(const Scene& scene, const std::vector<int>& frame_ids,
                                 const CalibrateOptions& options,
                                 const FramePixelSource& pixels = {},
                                 const Progress& progress = {});

}  // namespace camber
