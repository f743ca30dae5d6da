#pragma once

#include <optional>
#include <set>
#include <string>

#include "camber/geometry/pinhole_camera.h"
#include "camber/image/image.h"
#include "camber/import/vehicle_regions.h"
#include "camber/scene/scene.h"

namespace camber {

/// What of a truth vehicle's box was not seen (TruthVehicle::uncertain); empty: all was.
namespace box_flags {
inline constexpr const char* kOneSide = "one_side";     ///< an end or a side alone: size by prior
inline constexpr const char* kOccluded = "occluded";    ///< something hides an edge or the wheels
inline constexpr const char* kTruncated = "truncated";  ///< it leaves the image
inline constexpr const char* kDirection = "direction";  ///< front and rear look alike
inline constexpr const char* kGround = "no_ground";     ///< no road beside it: upright
}  // namespace box_flags

/// A depth image with the classes of its pixels.
struct LabelledDepth {
  const DepthImage* depth = nullptr;
  const Image* classes = nullptr;  ///< 1 channel, of the same size
  std::set<int> ground_classes;    ///< road, pavement: where vehicles stand
};

/// The box of a vehicle from the depth of its pixels: a geometrical fit, no learnt shape.
///
/// The ground beside it gives up, the wheels of the seen side correct height and pitch. The heading
/// is the direction that most surface normals of the body agree with (modulo 90 degrees). Of the
/// two faces the longer one is the side; the end that is seen gives the middle line, since its
/// normals are symmetric about it, and so the hidden side. The far end is the near one mirrored and
/// pushed out until it touches the silhouette's ray. The roof begins later behind a bonnet than
/// before a tail: which separates front from rear.
/// @return the vehicle in the camera's frame (id 0; box of its pixels, or of the projected corners
///         where it is hidden); nothing if its pixels have no steep surface, or
///         more than four fifths of it are hidden.
/// Published sizes of the class stand in for what is not seen; and `uncertain` is then set.
std::optional<TruthVehicle> fit_vehicle_to_depth(const VehicleRegion& region,
                                                 const LabelledDepth& image,
                                                 const PinholeCamera& camera,
                                                 const std::string& vehicle_class);

}  // namespace camber
