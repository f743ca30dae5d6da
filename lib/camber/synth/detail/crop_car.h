#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "camber/synth/car_family.h"
#include "camber/synth/detail/crop_mesh.h"
#include "camber/synth/detail/sequence.h"
#include "camber/synth/detail/surface.h"

namespace camber {

/// Materials of a crop's car: those of CarMaterial, and of the parts that are added to its body.
/// What is lamp, grille, glass or plate on the body is decided by place (crop_car_surface()).
enum class CropCarMaterial : std::uint8_t {
  kBody = 0,
  kTyre = static_cast<int>(CarMaterial::kTyre),
  kUnderside = static_cast<int>(CarMaterial::kTrim),
  kRim = static_cast<int>(CarMaterial::kRim),
  kHousing = 20,  ///< of mirrors and spoilers
  kMirror,        ///< the mirror's own face
  kRail,          ///< roof rails, racks, steps
  kBox,           ///< roof box
  kCabin,         ///< seats, dashboard, driver
};

/// How a place of a car takes the light.
struct CropSurface {
  Color albedo = Color::Constant(0.2f);
  float mirror = 0.0f;      ///< share of a mirror's reflection at normal incidence
  float roughness = 0.02f;  ///< of that reflection, rad
  float clear = 0.0f;       ///< share of light from behind that passes (glass)
  Color emission = Color::Zero();
};

/// Shapes of the parts that are drawn onto the body, as shares unless a unit is given.
struct CropCarParts {
  float headlight_height, headlight_inner;  ///< of the nose's height; of the half width
  float headlight_wrap;                     ///< m along the side
  float grille_low, grille_high, grille_width, grille_bars;
  float intake_high, intake_width;
  float front_plate_low, rear_plate_low;
  float tail_low, tail_inner, tail_wrap;
  float tail_pillar;                             ///< tail lights go up along the rear window, m
  float pillar_lamp_low, pillar_lamp_high;       ///< of them there, of the rear window's height
  float tail_round;                              ///< radius of round tail lights, m; 0: not round
  float third_lamp;                              ///< half the width of a third brake light, m
  float reflector;                               ///< half the height of those in the rear bumper, m
  float wiper;                                   ///< length of the rear window's, m
  float bumper_high;                             ///< of nose and tail
  float strip_y, strip_half;                     ///< side moulding, m; half width 0: none
  float cladding_y;                              ///< below it the flanks are plastic, m
  float arch_cladding;                           ///< m around the wheel arches
  float pillar_a, pillar_b, pillar_c, pillar_d;  ///< widths, m
  float pillar_b_at, pillar_c_at;                ///< along the side windows, 0 rear, 1 front
  float window_low, window_high;                 ///< of the greenhouse's height
  float window_slope;                            ///< rise of the windows' lower edge to the rear
  float rear_window_low, rear_window_high, rear_window_width;
  float gap_half;  ///< of the gaps around doors, m
  float rim_share, spoke_share;
  int spokes;
};

/// Colours and finish of one car.
struct CropCarLook {
  Color paint = Color::Zero(), roof = Color::Zero(), trim = Color::Zero(), rim = Color::Zero(),
        interior = Color::Zero(), bumper = Color::Zero();
  float flake = 0.0f;        ///< contrast of metallic paint over the angle of view
  float clear_coat = 0.05f;  ///< mirror reflection of the paint at normal incidence
  float dirt = 0.0f;         ///< 0 to 1
  float tint = 0.0f;         ///< of the rear glass, 0 clear to 1 black
  float clear = 0.0f;        ///< of the front glass
  bool two_tone = false;     ///< bumpers of a colour of their own
  bool clear_tails = false;  ///< tail lights of clear glass with red strips
  bool painted_bumpers = true, painted_sills = true, chrome = false, roof_glass = false;
  bool dark_pillars = true;  ///< between the side windows
  bool panel_sides = false;  ///< no windows behind the front doors
  bool rear_blind = false;   ///< no rear window
  bool lamps = false, brakes = false, indicator = false;
  bool front_plate = true, rear_plate = true, yellow_rear_plate = false, blue_band = false;
  std::uint32_t seed = 0;
  CropCarParts parts{};
};

/// Where the parts drawn onto the body go: read off the car's keypoints, vehicle frame, m.
struct CropCarPlaces {
  float front_axle, rear_axle, wheel_y, wheel_radius, arch_radius, half_width, length, height;
  Eigen::Vector3f rear_bumper, boot, rear_window, roof_rear, roof_front, cowl, headlight,
      front_bumper;  ///< keypoints 28 to 35: the right side's
};

/// One car of the crops.
struct CropCar {
  CarModel model;
  CropMesh mesh;  ///< vehicle frame
  CropCarPlaces places{};
  CropCarLook look;
};

/// A random car, of wider variety than the prior's family: also pick-ups, city cars, panel vans,
/// cars out of proportion and cars whose corners are moved one by one, with mirrors, rails and
/// spoilers. The points of the wheel arches, where
/// a real arch has no corners, sit at the same angles on all of them, so that a network can learn
/// them.
CropCar draw_crop_car(const CounterRandom& random, std::uint64_t index);

/// Another paint and finish for the same body.
CropCarLook draw_crop_car_look(const CropCar& car, Sequence* random);

/// The surface of a car at a place.
/// @param at, normal  vehicle frame; @param width  of the sample there, m
CropSurface crop_car_surface(const CropCarPlaces& places, const CropCarLook& look,
                             std::uint8_t material, const Eigen::Vector3f& at,
                             const Eigen::Vector3f& normal, float width);

}  // namespace camber
