#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "camber/core/status.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/plane.h"

namespace camber {

/// Inverse depths on a regular pixel grid: point i is at pixel (i % columns, i / columns) * step.
struct GridInverseDepth {
  int columns = 0, rows = 0;
  int step = 1;                       ///< pixels
  std::vector<double> inverse_depth;  ///< 1 / unit; NaN: none
  std::vector<double> sigma;          ///< standard deviation, where there is one
};

struct GrowRoadOptions {
  double camera_height = 1.65;  ///< m, > 0
  int cell_columns = 6;         ///< grid points to a cell, >= 2
  int cell_rows = 3;            ///< grid points to a cell, >= 2
  double step_height = 0.05;    ///< m, a rise between neighbours that is no road any more, > 0
  double max_tilt = 0.45;       ///< rad, of the road against the ego plane, > 0
  double max_sigma = 0.25;      ///< m, of a cell's height; less certain cells end the road, > 0
  void validate() const;        ///< throws std::invalid_argument
};

struct GrownRoad {
  Status status = Status::kNotRun;  ///< kFailed: no ego patch; see reason
  std::string reason;
  Plane ego;                         ///< the seed's plane, camera frame, unit of the input
  std::vector<std::uint8_t> ground;  ///< one a grid point; non-zero: road
};

/// Finds the road without a mask: the plane along the direction of travel that explains most of the
/// near lower image is the ego patch; from there the road grows over neighbouring cells of the
/// image as long as they continue the local plane, nearest first. Kerbs, walls and vehicles end it.
/// Deterministic.
GrownRoad grow_road(const PinholeCamera& camera, const GridInverseDepth& grid,
                    const Eigen::Vector3d& travel, const GrowRoadOptions& options);

}  // namespace camber
