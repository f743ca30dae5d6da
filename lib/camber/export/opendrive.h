#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "camber/export/height_source.h"
#include "camber/export/smooth_line.h"

namespace camber {

/// The zones of UTM on WGS 84, "EPSG:32632", as PROJ strings; other definitions stay as they are.
std::string proj_string_of(const std::string& definition);

/// A parked thing on or beside the road, in the plan frame.
struct RoadsideVehicle {
  int id = 0;
  std::string name;                                  ///< "car 3"
  Eigen::Vector3d bottom = Eigen::Vector3d::Zero();  ///< m, middle of the box's bottom face
  double heading = 0.0;                              ///< rad, of its front
  double pitch = 0.0;                                ///< rad, front below level
  double roll = 0.0;                                 ///< rad, right side below level
  double length = 0.0, width = 0.0, height = 0.0;    ///< m

  /// Heading, pitch and roll, in this order about z, y and x, of a box with these axes, unit
  /// vectors of the plan frame.
  void set_axes(const Eigen::Vector3d& front, const Eigen::Vector3d& up);
};

struct OpenDriveOptions {
  std::string name = "road";
  double left = 0.0, right = 0.0;  ///< m to either side, >= 0; 0: as far as is seen
  double widest = 12.0;            ///< m, limit of what is seen
  double smoothing = 2.0;          ///< m of road over which heights are taken
  /// PROJ string, which simulators parse; empty: none. See proj_string_of().
  std::string geo_reference;
  std::string crg_file;  ///< name of an OpenCRG file of the same frame; empty: none
  std::vector<RoadsideVehicle> vehicles;
  int num_threads = 0;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// a + b d + c d^2 + d d^3 for d = s - `s`, until the next record.
struct CubicRecord {
  double s = 0.0, a = 0.0, b = 0.0, c = 0.0, d = 0.0;
  double value(double at) const;
  double slope(double at) const;
};

/// A piece of the plan view: a line, or cubics in p = 0 .. 1 along its own first heading.
struct PlanPiece {
  double s = 0.0, x = 0.0, y = 0.0, heading = 0.0, length = 0.0;
  bool straight = false;
  double u[4] = {0, 0, 0, 0}, v[4] = {0, 0, 0, 0};

  Eigen::Vector2d at(double p) const;         ///< x, y
  Eigen::Vector2d direction(double p) const;  ///< d(x, y) / dp
};

/// A road of one lane a side (ASAM OpenDRIVE 1.7).
struct OpenDriveRoad {
  double length = 0.0;          ///< m
  std::vector<PlanPiece> plan;  ///< line and tangent go on from piece to piece
  std::vector<CubicRecord> elevation, superelevation;
  std::vector<CubicRecord> left_width, right_width;
  /// m of a lane's outer edge above the plane of elevation and superelevation; empty: none.
  std::vector<CubicRecord> left_height, right_height;
  std::vector<RoadsideVehicle> vehicles;
  std::string name, geo_reference, crg_file;
  double line_deviation = 0.0;  ///< m, greatest, of the plan view from the smooth line
  double height_rms = 0.0, height_most = 0.0;  ///< m, of the road from the ground where it is seen
};

/// Fits the road to the ground beside a line. @throws NoAnswerError where nothing of it is seen.
OpenDriveRoad make_opendrive(const HeightSource& ground, const SmoothLine& line,
                             const OpenDriveOptions& options);

/// The file's text.
std::string encode_opendrive(const OpenDriveRoad& road);

}  // namespace camber
