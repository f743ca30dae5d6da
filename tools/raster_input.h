#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "camber/core/progress.h"
#include "camber/export/gdal/raster_file.h"
#include "camber/export/height_source.h"
#include "camber/export/plan_frame.h"

namespace camber::tools {

/// Whether a file's first bytes are those of a TIFF.
bool is_raster(const std::string& path);

/// Heights of a GeoTIFF as points of ground, read where they are asked for.
class RasterInput {
 public:
  /// @param crs  in place of what the file states; empty: as it states
  /// @throws InputError for a file that holds no heights or an unknown system; NoAnswerError where
  ///         its cells are in longitude and latitude
  RasterInput(const std::string& path, const std::string& crs);

  /// As the file states it, with its units; none: not known, in metres.
  const std::optional<CoordinateSystem>& system() const { return system_; }
  const RasterHeader& header() const { return header_; }
  double cell() const { return cell_; }  ///< m, the longer side
  Eigen::AlignedBox2d extent() const;    ///< m

  /// Whether read() has points between the middles of cells: those are more than a metre apart.
  bool interpolated() const;

  /// The middles of cells near places, or points a metre or less apart and bilinear between them,
  /// in metres in the file's coordinates; none where a height is not known. Standard deviations of
  /// the file are the points'.
  /// @throws InputError for a damaged file, NoAnswerError for more than 1e8 points.
  RoadCloud read(const PlanCorridor& where) const;

 private:
  struct Cells;
  Eigen::Vector2d place_of(double column, double row) const;  ///< m
  Eigen::Vector2d cell_of(const Eigen::Vector2d& place) const;
  Cells load(const PlanCorridor& where) const;
  void add_cells(const Cells& cells, RoadCloud* out) const;
  void add_between(const Cells& cells, const PlanCorridor& where, RoadCloud* out) const;

  std::string path_;
  RasterHeader header_;
  std::optional<CoordinateSystem> system_;
  double metres_ = 1.0, height_metres_ = 1.0;  ///< of a unit of length in plan, of heights
  Eigen::Matrix2d sides_;                      ///< of a cell, columns, m
  double cell_ = 0.0;
};

/// Where converted units were, for people; empty: all are metres.
std::string remark_on_units(const RasterInput& raster);

/// The surroundings of a polyline, m.
PlanCorridor corridor_along(const std::vector<Eigen::Vector3d>& line, double reach);

/// Ground of a raster near places: as cloud_heights() of its points, with the file's standard
/// deviations beside what heights scatter.
std::unique_ptr<HeightSource> raster_heights(const RasterInput& raster, const PlanCorridor& where);

}  // namespace camber::tools
