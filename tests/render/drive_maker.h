#pragma once

#include <vector>

#include "camber/render/drive_content.h"

namespace camber::test {

/// A made drive: 60 frames of 320 x 120 pixels, 0.7 m apart, along a bend to the left that climbs
/// 5 %, its strip and surface, a parked car (track 2) and one that drives ahead (track 5).
struct PicturedDrive {
  PicturedDrive();
  DriveContent content() const;  ///< refers to this

  DriveDocument drive;
  RoadStrip strip;
  RoadSurface surface;
  std::vector<double> stations;
  VehicleDocument vehicles;
  std::vector<DriveTrackLine> tracks;
  PinholeCamera camera;
};

}  // namespace camber::test
