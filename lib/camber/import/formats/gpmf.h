#pragma once

#include <Eigen/Core>
#include <filesystem>
#include <string>
#include <vector>

#include "camber/import/formats/mp4_film.h"
#include "camber/import/formats/trajectory.h"

namespace camber {

/// What a camera recorded of its own motion, on the film's clock.
struct CameraTelemetry {
  std::string device;  ///< as it names itself; may be empty
  /// Positions with a fix, with their speeds and standard deviations.
  GeoLog log;
  std::size_t without_fix = 0;  ///< positions that were left out
  int fix = 0;                  ///< dimensions of the worst that was taken; 0: not stated
  double dilution = 0.0;        ///< of precision, median; 0: not stated
  struct Gravity {
    double time_s = 0.0;
    Eigen::Vector3d vector;  ///< of length 1; right, down and forward in the camera; see below
  };
  /// The track has the axes x, -z and -y of GoPro's drawing of the camera, in which z points up and
  /// y back. Whether the vector points up or down, and x to the right or the left, is not
  /// published.
  std::vector<Gravity> gravity;
};

/// Reads the payloads of GoPro's metadata format (items of key, type, size and repeat, big-endian,
/// aligned to 32 bits; github.com/gopro/gpmf-parser): positions (GPS9, else GPS5 with GPSF and
/// GPSP) and gravity (GRAV). Cameras that state no gravity write zeros, which are left out.
/// @throws InputError "file: payload N, byte B: found, expected".
CameraTelemetry read_gpmf(const std::filesystem::path& film,
                          const std::vector<FilmPayload>& payloads);

}  // namespace camber
