#pragma once

#include <Eigen/Core>
#include <vector>

#include "camber/geometry/box.h"

namespace camber {

/// A label that wants a place near the thing that it names.
struct LabelRequest {
  Eigen::Vector2d size = Eigen::Vector2d::Zero();  ///< pixels
  Box2 target;                                     ///< pixels; a point is a box without area
  /// LabelPlace::candidate in the picture before this one: kept unless another is clearly better,
  /// so that labels of a film do not jump. -1: none.
  int preferred = -1;
};

struct LabelPlace {
  bool found = false;  ///< false: no free place of that size is left in the picture
  Box2 box;
  bool leader = false;  ///< the label is so far away that a line to its target helps
  int candidate = -1;   ///< on which side of the target and how far off; -1: anywhere
};

struct LabelLayoutOptions {
  Box2 area;                ///< labels lie inside, pixels
  double gap = 4.0;         ///< pixels between labels and to their targets, >= 0
  std::vector<Box2> taken;  ///< never covered
  std::vector<Box2> avoid;  ///< covered only where nothing better is near
};

/// Places labels one after another, in the given order: above, below or beside the target, else
/// farther off, else anywhere. No label leaves the area or meets another one or a taken box.
std::vector<LabelPlace> place_labels(const std::vector<LabelRequest>& requests,
                                     const LabelLayoutOptions& options);

}  // namespace camber
