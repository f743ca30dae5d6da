#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "camber/export/height_source.h"
#include "camber/export/smooth_line.h"

namespace camber {

/// The ground beside a line in square cells of the plan frame, y (north) up the raster. Values are
/// those at the cells' centres, row by row from the greatest y; NaN: not seen.
struct RoadRaster {
  double west = 0.0, north = 0.0;  ///< m, plan frame: outer corner of the first cell
  double cell = 0.0;               ///< m
  std::size_t columns = 0, rows = 0;
  std::vector<float> heights;  ///< m
  std::vector<float> sigmas;   ///< m, standard deviation of the height
  std::vector<float> slopes;   ///< rad, steepest, against the plan
  std::vector<std::optional<std::array<std::uint8_t, 3>>> colors;  ///< or empty: none are known

  Eigen::Vector2d center(std::size_t row, std::size_t column) const {
    return {west + (static_cast<double>(column) + 0.5) * cell,
            north - (static_cast<double>(row) + 0.5) * cell};
  }
};

struct RoadRasterOptions {
  double cell = 0.0;               ///< m; 0: from the data
  double left = 0.0, right = 0.0;  ///< m to either side, >= 0; 0: as far as is seen
  double widest = 12.0;            ///< m, limit of what is seen
  int num_threads = 0;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// Corners are multiples of the cell, so that rasters of the same cell fit each other.
/// @param colors  or nullptr. @throws NoAnswerError where nothing is seen beside the line.
RoadRaster make_road_raster(const HeightSource& ground, const SmoothLine& line,
                            const ColorSource* colors, const RoadRasterOptions& options);

}  // namespace camber
