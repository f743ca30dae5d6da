#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace camber {

/// A line of a file of vectors; parts that join end to end are one.
struct VectorLine {
  std::string name;  ///< of the feature's field "name" (any case), else empty
  std::string layer;
  std::vector<Eigen::Vector3d> points;  ///< in the file's coordinates, x east; z NaN: not known
};

struct VectorLines {
  std::vector<VectorLine> lines;
  std::string crs;  ///< well-known text; empty: not stated
};

/// Lines of GeoJSON, GeoPackage, Shapefile and DXF by GDAL's drivers; arcs as chords. Points and
/// areas are left out.
/// @throws InputError for what cannot be read, holds no line, holds lines of several coordinate
/// systems or more than 4 million places.
VectorLines read_vector_lines(const std::string& path);

}  // namespace camber
