#pragma once

#include <array>
#include <limits>
#include <string>
#include <vector>

namespace camber {

/// What a GeoTIFF of heights states.
struct RasterHeader {
  std::string crs;   ///< well-known text; empty: not stated
  std::string unit;  ///< of the heights, as the band states it; empty: not stated
  std::string band;  ///< its name, or its number
  int height_band = 1;
  int sigma_band = 0;  ///< standard deviations of the heights; 0: none
  int columns = 0, rows = 0;
  /// x = t[0] + column t[1] + row t[2], y = t[3] + column t[4] + row t[5], of a cell's corner; its
  /// middle half a cell on. In the file's units.
  std::array<double, 6> place{};
};

/// A part of a raster, row by row.
struct RasterWindow {
  int column = 0, row = 0;     ///< of its first cell
  int columns = 0, rows = 0;   ///< > 0, within the raster
  std::vector<double> values;  ///< heights, in the band's unit; NaN: none is known
  std::vector<float> sigmas;   ///< of them, or empty
};

/// The header of a GeoTIFF. Heights are the band named "ground height", else "height", as camber
/// export writes them, else the first.
/// @throws InputError for what is no GeoTIFF, states no place of its cells, or holds a picture in
///         place of heights.
RasterHeader read_raster_header(const std::string& path);

/// Fills windows whose places are set. Cells of the value for no data, or outside the file's mask,
/// are NaN; a band's scale and offset are applied.
/// @throws InputError where the file is damaged.
void read_raster(const std::string& path, const RasterHeader& header,
                 std::vector<RasterWindow>* windows);

}  // namespace camber
