#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

namespace camber {

/// The plan of one alignment (or plan feature) of a LandXML file, as a polyline.
struct LandXmlAlignment {
  std::string name;
  double first_station = 0.0;  ///< staStart, in the file's unit
  /// East, north in the file's unit; 0.1 mm off arcs and clothoids at most. Heights are those of
  /// the points where all have one, else NaN.
  std::vector<Eigen::Vector3d> points;
};

struct LandXmlFile {
  std::vector<LandXmlAlignment> alignments;
  std::string unit;     ///< linearUnit: "meter", "foot", "USSurveyFoot", ...
  double metres = 1.0;  ///< one of them in metres
  std::string crs;      ///< "EPSG:n" or well-known text where the file states it, else empty
};

/// Reads the alignments of a LandXML file, versions 1.0 to 1.2: lines, arcs, clothoids and
/// irregular lines, whose points are given as northing easting [elevation] or by the names of
/// CgPoints. Elements must follow each other within 5 cm, and clothoids must end at their End.
/// @throws InputError "file: line L: found ..., expected ..."; for files without an alignment, too.
LandXmlFile read_landxml(const std::filesystem::path& path);

/// The same of a file in memory. @param name  for messages
LandXmlFile read_landxml_text(std::string text, const std::string& name);

}  // namespace camber
