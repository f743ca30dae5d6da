#pragma once

#include <string>

#include "camber/core/status.h"
#include "camber/export/height_source.h"
#include "camber/import/formats/map_boxes.h"

namespace camber {

/// A box on the ground.
struct LiftedMapBox {
  MapBox box;
  /// kOk; kWeak: the ground is known to no better than 0.1 m; kFailed: left as it was, see reason.
  Status status = Status::kNotRun;
  std::string reason;
  double rise = 0.0;  ///< m, of the bottom
  /// m, of the ground below it; NaN: not known.
  double height_sigma = std::numeric_limits<double>::quiet_NaN();
};

/// Puts a box of a detector that gives its place in plan (laser, map) on the ground: the middle of
/// its bottom onto the ground below, its up along the ground's normal, its heading as it was. Place
/// in plan and sizes stay.
/// @param box     in the ground's plan frame (z up).
/// @param ground  of levels above one another the one nearest to the box's bottom counts.
LiftedMapBox lift_map_box(const MapBox& box, const HeightSource& ground);

}  // namespace camber
