#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <vector>

#include "camber/geometry/plane.h"
#include "camber/synth/junction.h"
#include "camber/synth/road_profile.h"

namespace camber {

/// What the ground is made of at a place.
enum class GroundKind { kRoad, kKerb, kPavement, kPad, kVerge };

/// What lies to both sides of the centreline.
struct RoadLayout {
  double half_width = 3.6;               ///< m, centreline to the kerb or edge, > 0
  double crown = 0.05;                   ///< m, centreline above the edges, >= 0
  double undulation = 0.012;             ///< m, amplitude of the unevenness, >= 0
  bool pavement[2] = {false, true};      ///< left, right
  double pavement_width = 2.6;           ///< m, kerb included, > 0.2
  double kerb_height = 0.15;             ///< m, >= 0
  double kerb_width = 0.15;              ///< m
  double verge_slope[2] = {0.05, 0.05};  ///< rise a metre away from the road, left and right
  /// A parking place beside the road, flush with its edge, that climbs or falls away from it.
  struct Pad {
    int side = 0;               ///< 0 left, 1 right
    double begin = 0, end = 0;  ///< stations, m
    double depth = 6.0;         ///< m, away from the edge
    double slope_out = 0;       ///< rise a metre away from the road
    double slope_along = 0;     ///< rise a metre along the road, relative to it
  };
  std::vector<Pad> pads;
  /// Height of a verge above the road's edge, m, left and right, reached within verge_rise_width.
  double verge_rise[2] = {0.0, 0.0};
  double verge_rise_width = 0.3;  ///< m, > 0
  /// A street that meets the road, which then is straight in plan and has no pads; pavements are on
  /// both sides of both streets or nowhere.
  std::optional<Junction> junction;
  std::uint64_t seed = 0;  ///< of undulation and terrain
};

/// The ground of a scene as a height over plan, and what it is made of. World: see RoadProfile.
/// Every place has one height but for the kerb faces at the carriageway's edge, where `height`
/// gives the road's (lower) edge.
class RoadModel {
 public:
  /// @throws std::invalid_argument for a layout out of range.
  RoadModel(RoadProfile profile, RoadLayout layout);

  const RoadProfile& profile() const { return profile_; }
  const RoadLayout& layout() const { return layout_; }

  GroundKind kind(double station, double offset) const;
  /// Signed distance in plan from the carriageway's edge, negative on it; see
  /// Junction::edge_distance.
  double edge_distance(double station, double offset) const;
  double height(double station, double offset) const;
  /// Height of the carriageway's surface, also continued beyond its edge.
  double road_height(double station, double offset) const;
  /// Height on the far side of the edge (kerb top) for edge_distance >= 0.
  double side_height(double station, double offset) const;
  /// Plan position of a station and offset, m.
  Eigen::Vector2d place(double station, double offset) const;
  Eigen::Vector3d point(double station, double offset) const;
  /// Height of the ground at a place in plan; `station` is a guess.
  double height_at(const Eigen::Vector2d& place, double station) const;

  /// Least-squares plane (normal up) of the surface in a rectangle in plan, and the root mean
  /// square of its residuals. @param heading rad, of the rectangle's length in the world
  struct LocalPlane {
    Plane plane;
    double rms = 0.0;  ///< m
  };
  LocalPlane local_plane(const Eigen::Vector2d& middle, double station, double heading,
                         double length, double width) const;

 private:
  double beside_junction(double station, double offset) const;

  RoadProfile profile_;
  RoadLayout layout_;
};

}  // namespace camber
