#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "camber/geometry/se3.h"

namespace camber {

/// A pose of a file, turned to world_from_body where the file has the inverse.
struct TimedPose {
  double time_s = std::numeric_limits<double>::quiet_NaN();  ///< NaN: by its place or name
  std::string name;  ///< of the image or sensor, where the file has one
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();  ///< as written, unit within 0.01
  Eigen::Vector3d position = Eigen::Vector3d::Zero();

  std::optional<Eigen::Matrix4d> matrix;  ///< as written, where the file has matrices

  SE3 world_from_body() const { return SE3(rotation.normalized(), position); }
};

struct PoseFile {
  std::string form;  ///< "TUM", "KITTI", "EuRoC", "kapture", "COLMAP", "4 x 4 matrices"
  std::vector<TimedPose> poses;
};

/// Reads poses: TUM (time tx ty tz qx qy qz qw), KITTI odometry (12 numbers a row), EuRoC CSV
/// (nanoseconds, p, q w first), kapture trajectories.txt and COLMAP images (.txt, .bin), which have
/// camera_from_world, a 4 x 4 matrix, or a folder of such (NAME.pose.txt), in natural order.
/// @throws InputError "file: position: found, expected".
PoseFile read_poses(const std::filesystem::path& path);

/// A place on the earth.
struct GeoPoint {
  double latitude = 0.0, longitude = 0.0;                          ///< degrees
  double altitude = std::numeric_limits<double>::quiet_NaN();      ///< m
  std::string time_text;                                           ///< as written, or empty
  double time_s = std::numeric_limits<double>::quiet_NaN();        ///< since 1970, or of the day
  double speed = std::numeric_limits<double>::quiet_NaN();         ///< m/s
  int frame = -1;                                                  ///< id; -1: by its time
  double sigma = std::numeric_limits<double>::quiet_NaN();         ///< m, of the place
  double height_sigma = std::numeric_limits<double>::quiet_NaN();  ///< m, of the altitude
};

/// A log of a receiver.
struct GeoLog {
  std::string form;                             ///< "GPX", "NMEA", "RTKLIB", "CSV", "subtitles"
  std::string version, creator;                 ///< of GPX
  std::size_t tracks = 0;                       ///< of GPX
  std::vector<std::vector<GeoPoint>> segments;  ///< of tracks; NMEA and CSV: one
  std::vector<std::vector<GeoPoint>> routes;
  std::vector<GeoPoint> waypoints;
  std::vector<GeoPoint> speeds;          ///< of NMEA's RMC: times and speeds, no places
  std::map<std::string, int> sentences;  ///< of NMEA, with a right checksum, by type
  int wrong_checksums = 0, other_lines = 0, valid_rmc = 0;
  std::vector<std::string> columns;  ///< of CSV
  bool times_of_day = false;         ///< NMEA without a date: seconds since midnight
  bool of_film = false;              ///< times since the first frame of a film
  /// RTKLIB in GPS time: what it is ahead of UTC, s. The points' times are as written.
  double leap_seconds = 0.0;
};

/// Reads GPX 1.0 and 1.1, NMEA 0183 (positions of GGA with a fix, else of RMC, speeds of RMC and
/// VTG; sentences with a wrong checksum are counted and left out; a time stamp in brackets may
/// stand around a sentence, as dash cameras write), RTKLIB's .pos (degrees), CSV with latitude and
/// longitude, by time or frame, or the subtitles (SubRip) of a film that state positions. Fixes
/// that the log calls RTK have sigmas of centimetres.
/// @throws InputError "file: position: found, expected".
GeoLog read_geo_log(const std::filesystem::path& path);

/// m, on a sphere of 6,371,008.8 m.
double great_circle_distance(const GeoPoint& a, const GeoPoint& b);

struct SpeedSample {
  double time_s = 0.0;
  double speed = 0.0;  ///< m/s
  double sigma = 0.0;  ///< m/s
};

/// Speeds in the order of time: CSV (time and speed in m/s; columns speed_kmh and speed_mph are
/// converted; sigma beside them), GPX and NMEA by their speeds or else by positions and times.
/// @throws InputError also where the log has no speed.
struct SpeedLog {
  std::string form;
  std::vector<SpeedSample> samples;
  bool times_of_day = false;
  double leap_seconds = 0.0;  ///< as GeoLog's
};
SpeedLog read_speeds(const std::filesystem::path& path);

/// The speeds that a log states, else those by its positions and times; in its order.
std::vector<SpeedSample> speeds_of_log(const GeoLog& log);

/// One record of KITTI's oxts, of the frame that its file is numbered by.
struct OxtsRecord {
  int number = 0;
  double latitude = 0.0, longitude = 0.0, altitude = 0.0;  ///< degrees, m
  double roll = 0.0, pitch = 0.0, yaw = 0.0;  ///< rad; roll: left side up, pitch: front down
  double forward_speed = 0.0;                 ///< m/s
  double position_accuracy = 0.0;             ///< m; 0: not stated
};

/// A folder of KITTI's oxts (with data/ in it, or that itself), or one file of 30 columns a frame.
std::vector<OxtsRecord> read_oxts(const std::filesystem::path& path);
bool is_oxts(const std::filesystem::path& path);

/// Roll and pitch in the order of time or by frame id.
struct Attitude {
  double time_s = std::numeric_limits<double>::quiet_NaN();
  int frame = -1;
  double roll = 0.0, pitch = 0.0;  ///< rad, as OxtsRecord has them
};

/// CSV with a header line: time (s) or frame, roll and pitch in radians, or roll_deg and pitch_deg.
std::vector<Attitude> read_attitudes(const std::filesystem::path& path);

/// Gravity's up in a camera that looks along the vehicle's axis, for a roll and pitch as above.
Eigen::Vector3d up_in_camera(double roll, double pitch);

}  // namespace camber
