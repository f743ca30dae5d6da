#pragma once

#include <optional>
#include <string>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/road/road_strip.h"
#include "camber/road/road_surface.h"
#include "camber/scene/drive_document.h"
#include "camber/scene/results.h"

namespace camber {

/// One vehicle of a drive over all frames, as plots and tables show it.
struct DriveTrackLine {
  int id = 0;
  std::string vehicle_class;
  bool parked = false;
  Dimensions dimensions;  ///< m
  struct Place {
    int frame = 0;             ///< id
    Eigen::Vector3d in_world;  ///< m, middle of the box's bottom face
  };
  std::vector<Place> places;  ///< by frame
};

/// What pictures, plots and the report of a drive show. What is pointed at is only looked at and
/// must outlive it.
struct DriveContent {
  const DriveDocument* drive = nullptr;       ///< required
  const RoadStrip* strip = nullptr;           ///< required
  const RoadSurface* surface = nullptr;       ///< required: the strip's patches, world of the drive
  const VehicleDocument* vehicles = nullptr;  ///< required; each frame's in its own camera
  std::vector<double> stations;               ///< m, s of the patches, by index into their list
  std::vector<DriveTrackLine> tracks;
  PinholeCamera camera;
  std::string title;
};

}  // namespace camber
