#pragma once

#include <Eigen/Core>
#include <string_view>
#include <vector>

namespace camber {

/// How a street meets the road that the camera comes along.
enum class CornerKind {
  kStem,        ///< the road ends at a street that passes across: its far kerb lies straight ahead
  kSideStreet,  ///< the road goes on, the street leaves to one side
  kCrossing,    ///< both go on
  kBend,        ///< the road itself turns into the street
};

/// "stem", "side_street", "crossing", "bend"
std::string_view to_string(CornerKind kind);
/// Inverse of to_string. @throws std::invalid_argument naming the words that exist.
CornerKind corner_kind_from_string(std::string_view word);
const std::vector<CornerKind>& all_corner_kinds();

/// A street that meets a straight road. Lengths in m in plan, in the road's station s and offset t.
struct Junction {
  CornerKind kind = CornerKind::kStem;
  double station = 20.0;  ///< of the road, where the axes meet
  double angle =
      1.57079632679489662;    ///< rad, from the road's direction counter-clockwise, pi/4 to 3 pi/4
  double half_width = 3.5;    ///< of the street, > 0
  double kerb_radius = 6.0;   ///< of the corners' kerbs, > 0
  double outer_radius = 4.0;  ///< of a bend's outer kerb, > 0
  int side = 0;               ///< 0 left, 1 right: of a side street or a bend
  double arm_grade[2] = {0, 0};  ///< rise a metre of the left and right arm away from the road
  double level_reach = 6.0;      ///< m of |t| up to which the street has the road's surface
  double grade_change = 12.0;    ///< m over which an arm takes on its grade, > 0

  /// The street's own station (positive to the left of the road) and offset of a place.
  Eigen::Vector2d street_coordinates(double s, double t) const;
  /// Inverse: (s, t).
  Eigen::Vector2d from_street(double station_on_street, double offset) const;
  /// Whether there is an arm: of the road beyond the junction, of the street to a side.
  bool road_goes_on() const {
    return kind == CornerKind::kSideStreet || kind == CornerKind::kCrossing;
  }
  bool has_arm(int to_side) const {
    return kind == CornerKind::kStem || kind == CornerKind::kCrossing || to_side == side;
  }
  /// Signed distance from the carriageway's edge, negative on it: exact near straight edges and the
  /// corners of square streets, up to a quarter off at the corners of slanted ones, of the right
  /// sign and order elsewhere. @param road_half_width of the road
  double edge_distance(double s, double t, double road_half_width) const;
  /// A coordinate along the edges, m: at least 1 a metre walked along one, 1 where it is straight.
  double along_edge(double s, double t, double road_half_width) const;
  /// What the arms' grades add to the height at an offset t.
  double arm_rise(double t) const;

 private:
  double outside_bend(double t, double ahead, double road_half_width) const;
};

}  // namespace camber
