#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string_view>
#include <vector>

#include "camber/core/random.h"
#include "camber/geometry/box.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

/// Body styles of the parametric car family.
enum class CarClass { kHatchback, kSaloon, kEstate, kSuv, kVan };
inline constexpr int kNumCarClasses = 5;
std::string_view to_string(CarClass car_class);  ///< "hatchback", "saloon", "estate", "suv", "van"

/// Surface of one triangle of a car; the values index a renderer's palette.
enum class CarMaterial {
  kPaint,  ///< bodywork
  kGlass,  ///< windows
  kTyre,   ///< rubber
  kLight,  ///< head and tail lights
  kPlate,  ///< number plates
  kTrim,   ///< dark plastic: grille, bumpers' lower parts, arches, underside
  kRim,    ///< wheel discs
};
inline constexpr int kNumCarMaterials = 7;

/// Triangles with outward normals by the right-hand rule.
struct TriangleMesh {
  std::vector<Eigen::Vector3d> vertices;   ///< m
  std::vector<Eigen::Vector3i> triangles;  ///< indices into vertices
  std::vector<int> materials;              ///< one CarMaterial a triangle
};

/// One car. Vehicle frame: x to the front, y up, z to the right; origin at the middle of the full
/// box's bottom face, on the wheels' plane. The mesh fills the box exactly and is made of closed
/// pieces (body, four wheels, axle boxes); every keypoint but the wheel centres is one of its
/// vertices, and a wheel's centre is the middle of its outer disc.
struct CarModel {
  CarClass car_class = CarClass::kHatchback;
  Dimensions dimensions;    ///< m, full box without mirrors
  double wheel_radius = 0;  ///< m
  std::array<Eigen::Vector3d, kNumKeypoints> keypoints{};
  TriangleMesh mesh;
};

/// Dimensions and proportions of one car, m, as car makers publish them. Positions along the car
/// are given from the axle that they belong to, positive to the front; widths as shares of the
/// overall width.
struct CarProportions {
  double length = 0, width = 0, height = 0;  ///< overall, without mirrors and aerials
  double wheelbase = 0;
  double front_overhang = 0;                ///< front axle to the foremost point
  double wheel_radius = 0;                  ///< loaded
  double clearance = 0;                     ///< ground to the lowest part of the skirts
  double arch_gap = 0;                      ///< wheel arch radius beyond the wheel's
  double arch_lift = 0;                     ///< centre of the arches above the wheel's
  double bumper_depth = 0;                  ///< bumper corners behind the foremost (rearmost) point
  double bumper_height = 0;                 ///< front bumper corner above the ground
  double headlight_x = 0, headlight_y = 0;  ///< from the front bumper corner; above the ground
  double cowl_x = 0, cowl_y = 0;            ///< windscreen's lower corner, from the front axle
  double roof_front_x = 0;                  ///< from the front axle
  double roof_rear_x = 0;                   ///< from the rear axle
  double roof_crown = 0;                    ///< roof's corners below the highest point
  double roof_drop = 0;                     ///< rear roof corners below the front ones
  double rear_window_x = 0, rear_window_y = 0;  ///< lower corner, from the rear bumper corner
  double tail_x = 0, tail_y = 0;                ///< upper tail light corner, likewise
  double roof_width = 0, cowl_width = 0, rear_window_width = 0, tail_width = 0;
  double headlight_width = 0, bumper_width = 0, arch_width = 0;
  /// Where along the wheel arches their keypoints sit, rad from the horizontal: a lower end and an
  /// upper point, of the side towards the car's end and of the side towards its middle.
  double arch_end_outer = 0, arch_end_inner = 0, arch_top_outer = 0, arch_top_inner = 0;
};

/// Class mean, from published dimensions of common European models of about 1998 to 2018: overall
/// sizes, wheelbases, overhangs and tyre sizes as in makers' catalogues; the rest read off
/// three-view drawings in round numbers. Nothing here is fitted to annotated shapes.
CarProportions mean_proportions(CarClass car_class);

/// A car with the given proportions.
CarModel make_car(CarClass car_class, const CarProportions& proportions);

/// The class mean.
CarModel make_car(CarClass car_class);

/// Moves parts that a draw has put into the wrong order (a wheel arch beyond a bumper, a roof that
/// ends behind its rear window) to where they are just in order.
void keep_order(CarProportions* proportions);

/// Proportions of a random car of a class, see sample_car().
/// @param breadth  times the family's standard deviations of all but the overall sizes.
CarProportions sample_proportions(CarClass car_class, const CounterRandom& random,
                                  std::uint64_t index, double breadth = 1.0);

/// A random car of a class: sizes correlated as in the catalogues, the rest independent.
/// Depends on (random, index) alone.
CarModel sample_car(CarClass car_class, const CounterRandom& random, std::uint64_t index);

/// A random car of a random class, classes as frequent as on European roads: 45 % hatchbacks, 17 %
/// saloons, 15 % estates, 17 % SUVs, 6 % vans.
CarModel sample_car(const CounterRandom& random, std::uint64_t index);

}  // namespace camber
