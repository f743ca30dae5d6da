#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace camber {

/// The shapes of road that can be made.
enum class RoadProfileKind {
  kSteepHill,  ///< climbs, then gets much steeper ahead (the embedded sample)
  kUphill,     ///< nearly level, then climbs
  kDownhill,   ///< nearly level, then falls
  kCrest,      ///< climbs, then levels off or falls
  kSag,        ///< falls, then climbs
  kBank,       ///< a curve with up to 10 degrees of bank
  kRolling,    ///< several grade changes after one another
  kControl,    ///< straight, evenly inclined, no bank
  kLevel,      ///< within two degrees of level, as most roads are
};

/// "steep_hill", "uphill", ...
std::string_view to_string(RoadProfileKind kind);
/// Inverse of to_string. @throws std::invalid_argument naming the words that exist.
RoadProfileKind road_profile_kind_from_string(std::string_view word);
/// All of them, in the order of the enumeration.
const std::vector<RoadProfileKind>& all_road_profile_kinds();

/// A quantity along the road: a first value and smooth changes (raised cosines) that do not
/// overlap.
struct ProfileTrack {
  struct Change {
    double start = 0.0;   ///< m of station
    double length = 1.0;  ///< m, > 0
    double value = 0.0;   ///< after the change
  };
  double initial = 0.0;
  std::vector<Change> changes;  ///< ascending, not overlapping

  double value(double station) const;
  double slope(double station) const;  ///< d value / d station
};

/// The centreline of a road in space: grade, bank and curvature as functions of the station.
///
/// World: z up, the centreline starts at station 0 at the origin and heads along +x; y is to its
/// left. The station is the length of the centreline's plan (its projection on the x-y plane), m.
/// Lateral offsets are in plan, positive to the left.
class RoadProfile {
 public:
  /// @param grade      rad, positive: climbs ahead; magnitude below 0.6
  /// @param bank       rad, positive: left side up; magnitude below 0.3
  /// @param curvature  1/m of the plan, positive: to the left
  /// @param begin, end stations between which the road is defined, begin <= 0 < end
  /// @throws std::invalid_argument for values out of range or changes that overlap.
  RoadProfile(ProfileTrack grade, ProfileTrack bank, ProfileTrack curvature, double begin,
              double end);

  /// A random road of a kind; the same seed gives the same road. Every vertical curve has a radius
  /// of at least 60 m.
  static RoadProfile sample(RoadProfileKind kind, std::uint64_t seed, double begin, double end);

  /// The same grades and banks over another plan.
  RoadProfile with_curvature(ProfileTrack curvature) const;

  double begin() const { return begin_; }
  double end() const { return end_; }
  double grade(double station) const { return grade_.value(station); }
  double bank(double station) const { return bank_.value(station); }
  double curvature(double station) const { return curvature_.value(station); }

  /// Point of the centreline, m; stations outside [begin, end] are continued straight.
  Eigen::Vector3d center(double station) const;
  /// Direction in plan, rad, counter-clockwise from +x.
  double heading(double station) const;
  /// Length of the centreline in space from station 0, m; negative before it.
  double arc_length(double station) const;
  /// Station and lateral offset of a place given in plan; start is a guess of the station.
  Eigen::Vector2d locate(const Eigen::Vector2d& place, double start) const;
  /// Smallest radius of the centreline's vertical curves, m; infinite for a constant grade.
  double min_vertical_radius() const;

 private:
  struct Node {
    Eigen::Vector3d position;
    double heading;
    double arc;
  };
  /// Where a station lies among the nodes.
  struct Interval {
    std::size_t first;  ///< node before it
    double share;       ///< of the step after that node
    double inside;      ///< the station, clamped to the road
    double beyond;      ///< of the road's end, m; signed
  };
  Interval interval(double station) const;

  ProfileTrack grade_, bank_, curvature_;
  double begin_, end_, step_;
  std::vector<Node> nodes_;
  std::vector<Eigen::Vector3d> steps_;  ///< derivative of the position at each node, times step_, m
};

}  // namespace camber
