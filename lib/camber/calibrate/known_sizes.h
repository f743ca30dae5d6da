#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "camber/calibrate/camera_sources.h"
#include "camber/calibrate/mounting.h"
#include "camber/calibrate/window_bundle.h"
#include "camber/image/frame_pixels.h"
#include "camber/scene/scene.h"
#include "camber/vehicle/fit_vehicle.h"

namespace camber {

/// A frame of a drive and the road before it.
struct RoadView {
  int frame_id = 0;
  WindowRoad road;        ///< in this frame's camera
  Eigen::Vector3d ahead;  ///< unit, direction of travel, camera frame
  double along = 0.0;     ///< heights of the camera driven since the drive's start, about
};

/// How far the road bends between the camera and where it is seen: between its plane there and the
/// way travelled, rad, >= 0. That plane, extended, misses the road under the camera by as much
/// times the distance or by less.
double bend_of_road(const RoadView& view);

/// Of the windows that see the road the reference frames, at most so many, spread evenly.
/// @param key_ids  frame ids of the drive's key frames.
std::vector<RoadView> road_views(const std::vector<WindowBundle>& windows,
                                 const std::vector<int>& key_ids, std::size_t most);

/// What is not known of known sizes. "Assumed": by nothing measured.
struct KnownSizesNoise {
  /// Of the focal length by vehicles' proportions over what their likelihood states: the three
  /// largest of focal_length_gate's 564 (ScaleNoise) over those of as many normal draws.
  double proportions_spread = 1.2;
  /// Relative, what all vehicles of a drive have in common of it: the prior of shapes, the
  /// keypoints' own bias (assumed).
  double proportions_common = 0.03;
  /// Relative, what they have in common of the height by their sizes (seven made drives, boxes and
  /// keypoints of the shipped networks: 13, 17, 1, 1, 1 and 19 % too large in the six that had
  /// any).
  double sizes_common = 0.1;
  /// Of the camera's height, standard deviation of the plane under a vehicle whose distance is
  /// measured by its size (assumed).
  double free_ground_share = 0.5;
  double window_road_tilt = 0.01;  ///< rad, of a window's plane under a vehicle (assumed)
  /// Of the logarithm, lengths of one view's broken lines on a plane by the window's points
  /// (assumed; the spread over the views takes its place where it is more).
  double dashes_of_a_view = 0.03;
  /// Relative, what all broken lines of a drive have in common of focal length times height: how
  /// they are painted, what was taken for a stroke (seven made drives: 12 % too small in one, 3 to
  /// 8 % off in the others).
  double dashes_common = 0.06;
};

struct KnownSizesOptions {
  KnownSizesNoise noise;
  std::size_t most_views = 16;     ///< frames that are looked at, >= 1
  std::size_t most_vehicles = 32;  ///< those that are largest in the image, >= 1
  VehicleFitOptions fit;
  int num_threads = 0;    ///< <= 0: see resolve_num_threads
  void validate() const;  ///< throws std::invalid_argument
};

/// Focal length and height as they are known without what has known sizes.
struct CameraSoFar {
  double log_focal = 0.0, focal_sigma = 0.0;    ///< px; of the logarithm, > 0
  double log_height = 0.0, height_sigma = 0.0;  ///< m; likewise
};

/// The focal length by vehicles' proportions ("vehicle_proportions": seen obliquely with a wrong
/// one they are too long for their width) and the height by their sizes ("vehicle_sizes": how far
/// they are, against how far the ground on which they stand is in heights). Each vehicle counts
/// once, however many frames show it.
/// @param scene  with the camera so far; its vehicles have keypoints, others are passed over.
std::vector<CameraSource> vehicle_sources(const Scene& scene, const std::vector<RoadView>& views,
                                          const CameraSoFar& so_far,
                                          const KnownSizesOptions& options);

/// Focal length and height by broken lines of known sizes: lengths along the view are those of a
/// product of both ("dashes"), those across of the height alone ("lane_widths").
/// @param scene  with the camera so far; its markings_m are the known sizes.
/// @param image  a view's image, of the scene's camera.
/// @throws InputError as `image` does.
std::vector<CameraSource> marking_sources(const Scene& scene, const std::vector<RoadView>& views,
                                          const std::function<FrameImage(const RoadView&)>& image,
                                          const CameraSoFar& so_far,
                                          const KnownSizesOptions& options);

}  // namespace camber
