#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/road_cloud.h"
#include "camber/core/status.h"
#include "camber/road/road_profile.h"

namespace camber {

/// What the points' own standard deviations (RoadCloud::sigmas) are.
enum class PointSigmas {
  kOfNoise,       ///< of noise, which is estimated from the points in any case
  kShared,        ///< of an error that neighbours share: a part of the heights' sigmas
  kInterpolated,  ///< the same, of heights between measured ones, whose noise is not seen: of
                  ///< slopes and curvature no sigma is known, nor of heights without one
};

struct CloudProfileOptions {
  ProfileOptions profile;   ///< `reach` is not used
  double half_width = 3.5;  ///< m to either side over which cross slopes are measured, > 0
  bool crown = false;       ///< cross slopes left and right of the crest, too
  PointSigmas sigmas = PointSigmas::kOfNoise;
  int num_threads = 0;    ///< <= 0: see resolve_num_threads
  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// A cross-section of the ground at a station; NaN where it is not known.
struct CrossSection : ProfilePoint {
  double width_left = std::numeric_limits<double>::quiet_NaN();   ///< m to the edge, where seen
  double width_right = std::numeric_limits<double>::quiet_NaN();  ///< m, positive, too
  double crest = std::numeric_limits<double>::quiet_NaN();  ///< m of it to the left of the line
  /// Cross slopes left and right of the crest, rise over run, both positive if the left is up.
  double cross_slope_left = std::numeric_limits<double>::quiet_NaN();
  double cross_slope_right = std::numeric_limits<double>::quiet_NaN();
  double sigma_cross_slope_left = std::numeric_limits<double>::quiet_NaN();   ///< rise over run
  double sigma_cross_slope_right = std::numeric_limits<double>::quiet_NaN();  ///< rise over run
  std::size_t points = 0;       ///< of the ground that count, nearer to it than other stations
  double measured_left = 0.0;   ///< m to the left to which the cross slope was measured
  double measured_right = 0.0;  ///< m to the right, positive
  std::vector<double> offsets;  ///< m to the left, ascending, of the heights that follow
  std::vector<double> heights;  ///< m, of the smooth ground
};

struct CloudProfile {
  Status status = Status::kNotRun;  ///< kOk, or kFailed with a reason
  std::string reason;
  std::vector<CrossSection> stations;
  double noise = std::numeric_limits<double>::quiet_NaN();  ///< m, of a point's height, median
  double density = 0.0;  ///< points of the ground per m^2 beside the line
};

/// Where points lie near enough to a line to have a part in its profile.
class ProfileCorridor {
 public:
  /// @param up          in the cloud's frame, need not be unit
  /// @param half_width  m, as of CloudProfileOptions
  /// @throws std::invalid_argument for a line of fewer than two places.
  ProfileCorridor(const std::vector<Eigen::Vector3d>& line, const Eigen::Vector3d& up,
                  double half_width);
  ~ProfileCorridor();
  ProfileCorridor(const ProfileCorridor&) = delete;
  ProfileCorridor& operator=(const ProfileCorridor&) = delete;

  /// All that ground_beside_line() may take (of any source but kCompute), and a little more.
  /// @param point  m; by several threads at once
  bool contains(const Eigen::Vector3d& point) const;
  /// Of x and y, m: no point beyond it is within. For up = z.
  const Eigen::AlignedBox2d& bounds() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Where the ground of a cloud comes from.
enum class GroundSource {
  kAuto,     ///< the first of the next two that the cloud has beside the line, else kCompute
  kClasses,  ///< ASPRS classes 2, ground, and 11, road surface (label "classification")
  kLabels,   ///< label "ground" of 1, as segment_ground() has them
  kCompute,  ///< segment_ground() on what lies within 30 m of the strip
  kAll,      ///< every point
};

/// "auto", "class", "label", "compute", "all"
const char* to_string(GroundSource source);

/// Ground of a cloud beside a line.
struct GroundBesideLine {
  Status status = Status::kNotRun;  ///< kOk, or kFailed with a reason
  std::string reason;
  GroundSource source = GroundSource::kAuto;  ///< that was used, not kAuto
  std::vector<int> points;                    ///< ascending indices
};

/// Points that a survey has withdrawn (flag withheld), noise (7 and 18) and water (9) are never
/// ground.
/// @throws std::invalid_argument for a line of fewer than two places.
GroundBesideLine ground_beside_line(const RoadCloud& cloud, const Eigen::Vector3d& up,
                                    const std::vector<Eigen::Vector3d>& line, double half_width,
                                    GroundSource source, int num_threads);

/// Height, grade and cross slope of the ground of a cloud along a polyline in plan, by
/// cross-sections of its points. The ground beside the line is a smooth function of the place along
/// and across, whose roughness and noise are estimated from the points (restricted maximum
/// likelihood, over the whole line); heights, slopes and their covariance are those of its
/// posterior. Points far off it do not count (they stand on the ground). The order of the points
/// has no part in it.
///
/// At each station: the height on the line; the cross slope, the least-squares slope of heights
/// every tenth of the half width across, as far as the edges; the grade and the vertical curvature,
/// of the least-squares parabola through the heights on the line over `length` (every tenth of it
/// or closer), at the station, where 60 % of that length are covered. An edge is where the ground
/// leaves the section's line by a kerb, a ditch or a bank, seen up to 2 m beyond the half width;
/// points beyond it do not count. The direction across is that of the line over half the half width
/// to either side. A station without ground near it is kFailed, one whose height or cross slope is
/// known to no better than 5 cm or 1 % kWeak.
///
/// Standard deviations hold noise and what the smoothing leaves out, drift and levelling as
/// road_profile() has them, and the points' own by PointSigmas.
/// @param ground  indices of the points that are ground, ascending
/// @param up      in the cloud's frame, need not be unit
/// @throws std::invalid_argument for a line of fewer than two places, one of more than a million
/// stations or heights, or if options.validate() fails. The same for any number of threads.
/// Wood, "Generalized Additive Models", 2nd edition 2017.
CloudProfile profile_cloud(const RoadCloud& cloud, const std::vector<int>& ground,
                           const Eigen::Vector3d& up, const std::vector<Eigen::Vector3d>& line,
                           const CloudProfileOptions& options);

}  // namespace camber
