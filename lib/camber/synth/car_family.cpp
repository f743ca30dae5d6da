#include "camber/synth/car_family.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/synth/detail/car_body.h"

namespace camber {

namespace {

constexpr std::uint64_t kNumbersPerCar = 64;

/// Spread of the overall sizes in a class: standard deviations, m, and correlations.
struct SizeSpread {
  double length, width, height;
  double length_width, length_height, width_height;
};

SizeSpread size_spread(CarClass car_class) {
  switch (car_class) {
    case CarClass::kHatchback:
      return {0.22, 0.055, 0.035, 0.70, -0.10, -0.05};  // superminis (3.9) to compacts (4.35)
    case CarClass::kSaloon:
      return {0.19, 0.045, 0.025, 0.65, 0.05, 0.05};  // 4.4 (compact) to 4.95 (executive)
    case CarClass::kEstate:
      return {0.18, 0.045, 0.030, 0.65, 0.05, 0.05};
    case CarClass::kSuv:
      return {0.22, 0.050, 0.065, 0.85, 0.45, 0.45};  // 4.1 (small) to 4.85
    case CarClass::kVan:
      return {0.33, 0.060, 0.110, 0.80, 0.65, 0.60};  // 4.3 (leisure van) to 5.3 (long transporter)
  }
  throw std::invalid_argument("car class: unknown value");
}

/// Standard deviations of the proportions other than the overall sizes, m or shares.
CarProportions proportion_spread(CarClass car_class) {
  CarProportions s;
  const bool van = car_class == CarClass::kVan;
  s.wheelbase = 0.060;
  s.front_overhang = 0.055;
  s.wheel_radius = 0.014;
  s.clearance = 0.015;
  s.arch_gap = 0.020;
  s.arch_lift = 0.020;
  s.bumper_depth = 0.045;
  s.bumper_height = 0.055;
  s.headlight_x = 0.045;
  s.headlight_y = 0.055;
  s.cowl_x = 0.090;
  s.cowl_y = 0.040;
  s.roof_front_x = 0.110;
  s.roof_rear_x = van ? 0.07 : 0.17;
  s.roof_crown = 0.025;
  s.roof_drop = 0.025;
  s.rear_window_x = van ? 0.03 : 0.09;
  s.rear_window_y = 0.050;
  s.tail_x = 0.030;
  s.tail_y = 0.090;
  s.roof_width = 0.035;
  s.cowl_width = 0.030;
  s.rear_window_width = 0.035;
  s.tail_width = 0.035;
  s.headlight_width = 0.035;
  s.bumper_width = 0.035;
  s.arch_width = 0.018;
  // An arch has no corners: where its points are put varies from car to car.
  s.arch_end_outer = 0.14;
  s.arch_end_inner = 0.14;
  s.arch_top_outer = 0.14;
  s.arch_top_inner = 0.14;
  return s;
}

constexpr double CarProportions::*kFreeProportions[] = {
    &CarProportions::front_overhang, &CarProportions::wheel_radius,
    &CarProportions::clearance,      &CarProportions::arch_gap,
    &CarProportions::arch_lift,      &CarProportions::bumper_depth,
    &CarProportions::bumper_height,  &CarProportions::headlight_x,
    &CarProportions::headlight_y,    &CarProportions::cowl_x,
    &CarProportions::cowl_y,         &CarProportions::roof_front_x,
    &CarProportions::roof_rear_x,    &CarProportions::roof_crown,
    &CarProportions::roof_drop,      &CarProportions::rear_window_x,
    &CarProportions::rear_window_y,  &CarProportions::tail_x,
    &CarProportions::tail_y,         &CarProportions::roof_width,
    &CarProportions::cowl_width,     &CarProportions::rear_window_width,
    &CarProportions::tail_width,     &CarProportions::headlight_width,
    &CarProportions::bumper_width,   &CarProportions::arch_width,
    &CarProportions::arch_end_outer, &CarProportions::arch_end_inner,
    &CarProportions::arch_top_outer, &CarProportions::arch_top_inner,
};

}  // namespace

std::string_view to_string(CarClass car_class) {
  switch (car_class) {
    case CarClass::kHatchback:
      return "hatchback";
    case CarClass::kSaloon:
      return "saloon";
    case CarClass::kEstate:
      return "estate";
    case CarClass::kSuv:
      return "suv";
    case CarClass::kVan:
      return "van";
  }
  return "unknown";
}

CarProportions mean_proportions(CarClass car_class) {
  CarProportions p;
  // What the classes share; overridden below.
  p.wheel_radius = 0.315;
  p.clearance = 0.17;
  p.arch_gap = 0.060;
  p.arch_lift = 0.020;
  p.bumper_depth = 0.13;
  p.bumper_height = 0.30;
  p.headlight_x = -0.09;
  p.roof_crown = 0.075;
  p.roof_drop = 0.02;
  p.cowl_width = 0.86;
  p.rear_window_width = 0.80;
  p.tail_width = 0.82;
  p.headlight_width = 0.84;
  p.bumper_width = 0.88;
  p.arch_width = 0.955;
  p.arch_end_outer = -0.13;
  p.arch_end_inner = -0.16;
  p.arch_top_outer = 0.80;
  p.arch_top_inner = 0.80;
  switch (car_class) {
    case CarClass::kHatchback:  // superminis (3.75 x 1.65 to 4.0 x 1.70), compacts (4.15 to 4.3
                                // x 1.78)
      p.length = 4.03, p.width = 1.72, p.height = 1.47;
      p.wheelbase = 2.52, p.front_overhang = 0.82;
      p.wheel_radius = 0.308;
      p.headlight_y = 0.72;
      p.cowl_x = -0.42, p.cowl_y = 0.95;
      p.roof_front_x = -1.05, p.roof_rear_x = -0.22;
      p.rear_window_x = 0.14, p.rear_window_y = 0.99;
      p.tail_x = 0.03, p.tail_y = 0.88;
      p.roof_width = 0.68;
      break;
    case CarClass::kSaloon:  // 4.45 to 4.80 x 1.73 to 1.84 x 1.41 to 1.48
      p.length = 4.61, p.width = 1.785, p.height = 1.445;
      p.wheelbase = 2.73, p.front_overhang = 0.86;
      p.headlight_y = 0.70;
      p.cowl_x = -0.52, p.cowl_y = 0.95;
      p.roof_front_x = -1.18, p.roof_rear_x = 0.22;
      p.rear_window_x = 0.52, p.rear_window_y = 1.02;
      p.tail_x = 0.03, p.tail_y = 0.93;
      p.roof_width = 0.65;
      break;
    case CarClass::kEstate:  // 4.45 to 4.80 x 1.73 to 1.83 x 1.44 to 1.52
      p.length = 4.58, p.width = 1.77, p.height = 1.475;
      p.wheelbase = 2.67, p.front_overhang = 0.88;
      p.headlight_y = 0.71;
      p.cowl_x = -0.48, p.cowl_y = 0.95;
      p.roof_front_x = -1.12, p.roof_rear_x = -0.52;
      p.rear_window_x = 0.13, p.rear_window_y = 1.01;
      p.tail_x = 0.03, p.tail_y = 0.92;
      p.roof_width = 0.66;
      break;
    case CarClass::kSuv:  // 4.20 to 4.70 x 1.78 to 1.90 x 1.58 to 1.74
      p.length = 4.42, p.width = 1.82, p.height = 1.655;
      p.wheelbase = 2.64, p.front_overhang = 0.88;
      p.wheel_radius = 0.345;
      p.clearance = 0.22;
      p.bumper_height = 0.38;
      p.headlight_y = 0.86;
      p.cowl_x = -0.44, p.cowl_y = 1.10;
      p.roof_front_x = -1.02, p.roof_rear_x = -0.40;
      p.rear_window_x = 0.13, p.rear_window_y = 1.15;
      p.tail_x = 0.03, p.tail_y = 1.00;
      p.roof_width = 0.67;
      break;
    case CarClass::kVan:  // leisure vans (4.40 x 1.80 x 1.82) and transporters (4.90 x 1.90 x 1.97)
      p.length = 4.75, p.width = 1.87, p.height = 1.93;
      p.wheelbase = 2.92, p.front_overhang = 0.92;
      p.wheel_radius = 0.330;
      p.bumper_height = 0.34;
      p.headlight_x = -0.12;
      p.headlight_y = 0.86;
      p.cowl_x = -0.18, p.cowl_y = 1.12;
      p.roof_front_x = -0.80, p.roof_rear_x = -0.66;
      p.rear_window_x = 0.03, p.rear_window_y = 1.14;
      p.tail_x = 0.01, p.tail_y = 1.05;
      p.roof_width = 0.80;
      p.rear_window_width = 0.86;
      p.tail_width = 0.88;
      p.cowl_width = 0.88;
      break;
  }
  return p;
}

CarModel make_car(CarClass car_class, const CarProportions& proportions) {
  return build_car_body(car_class, proportions);
}

CarModel make_car(CarClass car_class) { return make_car(car_class, mean_proportions(car_class)); }

void keep_order(CarProportions* proportions) {
  CarProportions& p = *proportions;
  p.bumper_depth = std::max(p.bumper_depth, 0.04);
  p.arch_gap = std::max(p.arch_gap, 0.025);
  p.arch_lift = std::clamp(p.arch_lift, -0.02, 0.06);
  const double rear_overhang_min = p.wheel_radius + p.arch_gap + p.bumper_depth + 0.04;
  p.front_overhang =
      std::max(p.front_overhang, p.wheel_radius + p.arch_gap + p.bumper_depth + 0.04);
  p.wheelbase = std::min(p.wheelbase, p.length - p.front_overhang - rear_overhang_min);
  p.headlight_x = std::min(p.headlight_x, -0.01);
  p.tail_x = std::max(p.tail_x, 0.0);
  p.rear_window_x = std::max(p.rear_window_x, p.tail_x + 0.015);
  p.rear_window_y = std::max(p.rear_window_y, p.tail_y + 0.02);
  p.arch_width = std::min(p.arch_width, 0.99);
  p.roof_crown = std::max(p.roof_crown, 0.03);
  p.roof_drop = std::max(p.roof_drop, 0.0);
  p.bumper_height = std::max(p.bumper_height, p.clearance + 0.05);
  const double rear_axle_to_corner = p.length - p.wheelbase - p.front_overhang - p.bumper_depth;
  p.roof_rear_x = std::max(p.roof_rear_x, p.rear_window_x - rear_axle_to_corner + 0.02);
  p.roof_front_x = std::min(p.roof_front_x, p.cowl_x - 0.25);
}

CarProportions sample_proportions(CarClass car_class, const CounterRandom& random,
                                  std::uint64_t index, double breadth) {
  std::uint64_t counter = index * kNumbersPerCar;
  auto draw = [&] { return std::clamp(random.normal(counter++), -2.5, 2.5); };
  const CarProportions mean = mean_proportions(car_class);
  const CarProportions spread = proportion_spread(car_class);
  CarProportions p = mean;

  const SizeSpread s = size_spread(car_class);
  Eigen::Matrix3d correlation;
  correlation << 1.0, s.length_width, s.length_height, s.length_width, 1.0, s.width_height,
      s.length_height, s.width_height, 1.0;
  const Eigen::Matrix3d root = correlation.llt().matrixL();
  Eigen::Vector3d z;
  for (int i = 0; i < 3; ++i) z[i] = draw();
  const Eigen::Vector3d size = root * z;
  p.length += s.length * size[0];
  p.width += s.width * size[1];
  p.height += s.height * size[2];

  // Larger cars have longer wheelbases and larger wheels; heights follow the car's.
  const double longer = p.length / mean.length, taller = p.height / mean.height;
  p.wheelbase = mean.wheelbase * (1.0 + 0.85 * (longer - 1.0)) + spread.wheelbase * draw();
  p.front_overhang = mean.front_overhang * (1.0 + 0.8 * (longer - 1.0));
  p.wheel_radius = mean.wheel_radius * (1.0 + 0.35 * (longer - 1.0) + 0.35 * (taller - 1.0));
  p.cowl_x *= longer;
  p.roof_front_x *= longer;
  p.roof_rear_x *= longer;
  p.rear_window_x *= longer;
  p.cowl_y *= taller;
  p.headlight_y *= taller;
  p.rear_window_y *= taller;
  p.tail_y *= taller;
  for (double CarProportions::*field : kFreeProportions) {
    p.*field += breadth * spread.*field * draw();
  }

  keep_order(&p);
  return p;
}

CarModel sample_car(CarClass car_class, const CounterRandom& random, std::uint64_t index) {
  return make_car(car_class, sample_proportions(car_class, random, index));
}

CarModel sample_car(const CounterRandom& random, std::uint64_t index) {
  constexpr double kShares[kNumCarClasses] = {0.45, 0.17, 0.15, 0.17, 0.06};
  // uniform() and normal() never share a number, so the class does not depend on the sizes.
  double u = random.uniform(index);
  int chosen = 0;
  while (chosen + 1 < kNumCarClasses && u >= kShares[chosen]) u -= kShares[chosen++];
  return sample_car(static_cast<CarClass>(chosen), random, index);
}

}  // namespace camber
