#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camber/export/opendrive.h"

namespace camber {

/// A piece of a read road's plan view.
struct XodrPiece {
  enum class Shape { kLine, kArc, kSpiral, kPoly3, kParamPoly3 };
  Shape shape = Shape::kLine;
  double s = 0.0, x = 0.0, y = 0.0, heading = 0.0, length = 0.0;  ///< m, rad
  double first_curvature = 0.0, last_curvature = 0.0;             ///< 1/m: arcs (equal) and spirals
  /// Cubics along the first heading and to its left: kParamPoly3 in p, kPoly3 v in u.
  double u[4] = {0, 1, 0, 0}, v[4] = {0, 0, 0, 0};
  bool normalized = false;  ///< p from 0 to 1; else from 0 to `length`
};

/// What a lane's surface lies above the road's, m along its normal, until the next record.
struct XodrLaneHeight {
  double s = 0.0, inner = 0.0, outer = 0.0;
};

struct XodrLane {
  int id = 0;
  std::string type;
  bool level = false;                ///< stays level across where the road is superelevated
  std::vector<CubicRecord> widths;   ///< by s of the road
  std::vector<CubicRecord> borders;  ///< of the outer one from the centre, instead of widths
  std::vector<XodrLaneHeight> heights;
};

struct XodrLaneSection {
  double s = 0.0;
  std::vector<XodrLane> left, right;  ///< from the centre outwards
};

struct XodrCrossfall : CubicRecord {  ///< rad, falling outwards
  bool left = true, right = true;     ///< sides that it is of
};

struct XodrRoad {
  std::string id, name;
  double length = 0.0;  ///< m
  std::vector<XodrPiece> plan;
  std::vector<CubicRecord> elevation;       ///< m
  std::vector<CubicRecord> superelevation;  ///< rad, left side up
  std::vector<XodrCrossfall> crossfall;
  std::vector<CubicRecord> lane_offset;  ///< m, of the centre lane to the left
  std::vector<XodrLaneSection> sections;
  bool shapes = false;  ///< has lateral shapes, which are not read
};

/// A road network, as far as its surface goes (ASAM OpenDRIVE 1.1 to 1.8).
struct XodrFile {
  int major = 0, minor = 0;
  std::optional<std::string> vendor, name;
  std::string geo_reference;  ///< as it stands there; empty: none
  std::vector<XodrRoad> roads;
  std::size_t junctions = 0;

  /// @throws std::invalid_argument for an id that there is not, naming those that there are.
  const XodrRoad& road(const std::string& id) const;
};

/// @throws InputError "file: line L: found, expected".
XodrFile read_xodr(const std::filesystem::path& path);

/// The surface of a read road. Kept by reference; any number of threads may ask.
class XodrSurface {
 public:
  explicit XodrSurface(const XodrRoad& road);

  Eigen::Vector2d position(double s) const;  ///< x, y of the reference line
  double heading(double s) const;            ///< rad
  double curvature(double s) const;          ///< 1/m, to the left
  double elevation(double s) const;          ///< m
  double grade(double s) const;              ///< rise over run
  double superelevation(double s) const;     ///< rad
  double left(double s) const;               ///< m to the outer edge of the lanes, >= 0
  double right(double s) const;              ///< m, positive, too
  /// A point of the surface, t m to the left of the reference line; of places beside the lanes the
  /// surface goes on.
  Eigen::Vector3d point(double s, double t) const;

 private:
  struct Frame {
    Eigen::Vector2d place, direction;  ///< direction: unit
    double curvature = 0.0;
  };
  Frame frame(double s) const;
  const XodrLaneSection* section(double s) const;
  double lane_height(double s, double t, double superelevation) const;

  const XodrRoad& road_;
};

/// The lanes of a road as triangles: at every change of what describes it, and so close between
/// that they pass it by less than `tolerance`.
struct XodrMesh {
  std::vector<Eigen::Vector3d> points;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};
/// @param types  of lanes that are taken; empty: all.
XodrMesh xodr_mesh(const XodrRoad& road, double tolerance = 0.005,
                   const std::vector<std::string>& types = {});

}  // namespace camber
