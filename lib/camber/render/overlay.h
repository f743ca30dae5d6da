#pragma once

#include <map>
#include <optional>
#include <utility>

#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image_io.h"
#include "camber/road/road_surface.h"
#include "camber/scene/results.h"
#include "camber/scene/vehicle_numbers.h"

namespace camber {

/// Where the labels of the picture before stood, by the vehicles' numbers: in a series of pictures
/// they keep their sides.
struct LabelMemory {
  std::map<int, int> candidates;  ///< LabelPlace::candidate
};

struct OverlayOptions {
  double upscale = 1.0;     ///< the picture is enlarged before drawing, [0.1, 16]
  double line_scale = 1.0;  ///< factor on line widths and text beyond what the size asks, [0.2, 5]
  bool metric = true;       ///< false: distances are labelled without a unit
  bool show_boxes_2d = true;  ///< detection boxes
  bool show_boxes_3d = true;
  bool show_planes = true;  ///< a metre grid on the plane under each vehicle
  bool show_labels = true;  ///< id and distance
  /// The position's ellipse of 1 sigma on the ground and the distance's sigma, where stated.
  bool show_ellipses = false;
  // Of the road that is given beside the vehicles.
  bool show_patches = false;  ///< outlines
  bool show_normals = false;  ///< an arrow of one metre on each patch
  bool show_grade = false;    ///< patches coloured by their slope along the road, with a colour bar
  /// Metres ahead and to the side on the patches, with numbers every ten.
  bool show_grid = false;
  bool show_mask = false;  ///< tints the pixels that are road

  /// rad, slopes at the ends of the colour scale of show_grade; none: those of the patches in view.
  std::optional<std::pair<double, double>> grade_range;
  LabelMemory* label_memory = nullptr;  ///< of a series of pictures; is brought up to date

  VehicleNumbers numbers;  ///< of the result that the frame is part of

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// The road that an overlay may show; parts may be absent.
struct OverlayRoad {
  const RoadSurface* surface = nullptr;  ///< reference camera's frame
  SE3 reference_from_camera;             ///< of the image
  const Image* mask = nullptr;           ///< 1 channel, size of the photo; non-zero: road
};

/// Draws the vehicles of one frame onto its image: wireframe of the 36 estimated keypoints (visible
/// edges solid, those behind a body thin), 3D box, detection box, the plane under the vehicle as a
/// perspective grid of one metre, on request the position's uncertainty as an ellipse on the ground
/// and the road's patches, and a label with the number and the distance of the bottom centre.
/// Labels are never cut off and never cover each other; a vehicle without an answer gets its dashed
/// box and labelled. Same input, same pixels.
/// @param photo   the frame's image, size of the camera's.
/// @param camera  pixels of `photo`.
/// @throws std::invalid_argument for an empty photo, a size that is not the camera's, a mask of
///         another size, bad options.
Image draw_overlay(const Image& photo, const PinholeCamera& camera, const VehicleFrame& frame,
                   const OverlayOptions& options = {}, const OverlayRoad& road = {});

}  // namespace camber
