#pragma once

#include <limits>

#include "camber/geometry/box.h"

namespace camber::internal {

/// The smallest box that holds the pixels given to include().
struct PixelBounds {
  Box2 box{std::numeric_limits<double>::infinity(), std::numeric_limits<double>::infinity(),
           -std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  void include(const Eigen::Vector2d& p) {
    box = {std::min(box.x1, p.x()), std::min(box.y1, p.y()), std::max(box.x2, p.x()),
           std::max(box.y2, p.y())};
  }
};

}  // namespace camber::internal
