#pragma once

#include <optional>
#include <string_view>
#include <vector>

#include "camber/synth/junction.h"

namespace camber {

/// What a drive may have beyond a road with cars; everything is off or drawn from the seed unless
/// it is asked for. Angles in rad, lengths in m.

enum class TurnDirection { kLeft, kRight };

/// The camera's car turns at a corner of streets with kerbs and pavements, or verges.
struct CornerOptions {
  bool enabled = false;
  CornerKind kind = CornerKind::kStem;
  TurnDirection turn = TurnDirection::kRight;
  double radius = 9.0;    ///< of the rear axle's path where it is tightest, [5, 20]
  double yaw_rate = 0.5;  ///< rad/s there, [0.2, 0.9]; with the radius it sets the speed
  double phase = 0.5;     ///< share of the turn that is done in the middle of the drive, [0, 1]
  double angle = 1.57079632679489662;  ///< between the streets, [1.05, 2.09]
  double arm_grade = 0.0;  ///< of the street away from the road, rise a metre, [-0.2, 0.2]
};

/// The road bends under the camera all along the drive.
struct BendOptions {
  double radius = 0.0;  ///< of the centreline, [30, 1000]; 0: the road's own shape
  TurnDirection turn = TurnDirection::kRight;
};

/// A car in the same lane that keeps its distance.
struct LeadCarOptions {
  bool enabled = false;
  double gap = 10.0;  ///< from the camera to its rear end along the path, [4, 60]
};

enum class AsphaltTexture {
  kVaried,       ///< aggregate, stains, cracks, repairs and manhole covers
  kSelfSimilar,  ///< amplitude 1/f over all wavelengths and nothing else: alike at any scale
  kRepeating,    ///< one tile after the other, with a weak variation over them
};
std::string_view to_string(AsphaltTexture texture);  ///< "varied", "self_similar", "repeating"
AsphaltTexture asphalt_texture_from_string(std::string_view word);
const std::vector<AsphaltTexture>& all_asphalt_textures();

struct AsphaltOptions {
  AsphaltTexture texture = AsphaltTexture::kVaried;
  std::optional<double> contrast;  ///< of the texture, (0, 3]; drawn: 0.6 to 1.1
  double wetness = 0.0;            ///< 0 dry to 1 (a film all over, puddles), [0, 1]
};

enum class Pavements { kNone, kLeft, kRight, kBoth };
std::string_view to_string(Pavements pavements);  ///< "none", "left", "right", "both"
Pavements pavements_from_string(std::string_view word);
const std::vector<Pavements>& all_pavements();

struct RoadsideOptions {
  std::optional<Pavements> pavements;
  std::optional<double> kerb_height;    ///< [0, 0.25]; else 0.15
  std::optional<double> edge_distance;  ///< camera to the carriageway's right edge, [0.8, 5]
  std::optional<double> half_width;     ///< of the carriageway, [2, 8]; drawn: 3.3 to 3.9
  double verge_rise = 0.0;              ///< of verges above the road's edge, [-0.2, 0.25]
  double verge_rise_width = 0.3;        ///< over which they rise, [0.1, 1]
};

enum class Markings { kNone, kCenterLine, kAll };
std::string_view to_string(Markings markings);  ///< "none", "center_line", "all"
Markings markings_from_string(std::string_view word);
const std::vector<Markings>& all_markings();

/// How the camera sits in its car; what is not given is drawn, within a degree.
struct MountingOptions {
  std::optional<double> pitch;  ///< positive: looks up, [-0.35, 0.35]
  std::optional<double> yaw;    ///< positive: looks right, [-0.35, 0.35]
  std::optional<double> roll;   ///< positive: its right side is low, [-0.35, 0.35]
  double ahead_of_axle = 0.0;   ///< camera before the rear axle, which follows the path, [0, 4]
};

struct WeatherOptions {
  std::optional<double> cloudiness;     ///< 0 clear to 1 overcast
  std::optional<double> sun_elevation;  ///< [0.1, 1.5]; drawn: 35 to 60 degrees
  double haze_distance = 1500.0;        ///< at which 63 % is haze, [100, 10000]
  bool lights_on = false;               ///< of the cars that drive
};

struct SceneFeatures {
  CornerOptions corner;
  BendOptions bend;
  LeadCarOptions lead_car;
  AsphaltOptions asphalt;
  RoadsideOptions roadside;
  std::optional<Markings> markings;
  MountingOptions mounting;
  WeatherOptions weather;

  /// @throws std::invalid_argument naming the field, its value and the bound.
  void validate() const;
};

}  // namespace camber
