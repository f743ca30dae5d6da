#include "camber/synth/junction.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

struct KindName {
  CornerKind kind;
  std::string_view name;
};
constexpr KindName kNames[] = {
    {CornerKind::kStem, "stem"},
    {CornerKind::kSideStreet, "side_street"},
    {CornerKind::kCrossing, "crossing"},
    {CornerKind::kBend, "bend"},
};

/// Distance inside a block x > 0, y > 0 whose corner is rounded with radius r.
double rounded_block(double x, double y, double r) {
  const double u = std::max(r - x, 0.0), v = std::max(r - y, 0.0);
  return std::max(r, std::min(x, y)) - std::hypot(u, v);
}

/// Distance outside the region x < 0, y < 0 whose corner is rounded with radius r.
double rounded_corner(double x, double y, double r) {
  const double u = std::max(x + r, 0.0), v = std::max(y + r, 0.0);
  return std::min(-r, std::max(x, y)) + std::hypot(u, v);
}

}  // namespace

std::string_view to_string(CornerKind kind) {
  for (const KindName& entry : kNames) {
    if (entry.kind == kind) return entry.name;
  }
  throw std::invalid_argument("corner: unknown kind");
}

CornerKind corner_kind_from_string(std::string_view word) {
  std::string known;
  for (const KindName& entry : kNames) {
    if (entry.name == word) return entry.kind;
    known += (known.empty() ? "" : ", ") + std::string(entry.name);
  }
  throw std::invalid_argument(fmt::format("corner: found \"{}\", expected one of {}", word, known));
}

const std::vector<CornerKind>& all_corner_kinds() {
  static const std::vector<CornerKind> all = [] {
    std::vector<CornerKind> kinds;
    for (const KindName& entry : kNames) kinds.push_back(entry.kind);
    return kinds;
  }();
  return all;
}

Eigen::Vector2d Junction::street_coordinates(double s, double t) const {
  const double c = std::cos(angle), n = std::sin(angle), x = s - station;
  return {c * x + n * t, c * t - n * x};
}

Eigen::Vector2d Junction::from_street(double station_on_street, double offset) const {
  const double c = std::cos(angle), n = std::sin(angle);
  return {station + c * station_on_street - n * offset, n * station_on_street + c * offset};
}

double Junction::edge_distance(double s, double t, double road_half_width) const {
  // Beyond the street's axis, and to the left of the road's.
  const double ahead = -street_coordinates(s, t).y();
  const auto block = [&](double side_sign, double ahead_sign) {
    return rounded_block(side_sign * t - road_half_width, ahead_sign * ahead - half_width,
                         kerb_radius);
  };
  const double toward = side == 0 ? 1.0 : -1.0;
  switch (kind) {
    case CornerKind::kStem:
      return std::max({block(1, -1), block(-1, -1), ahead - half_width});
    case CornerKind::kSideStreet:
      return std::max({block(toward, -1), block(toward, 1), -toward * t - road_half_width});
    case CornerKind::kCrossing:
      return std::max({block(1, -1), block(-1, -1), block(1, 1), block(-1, 1)});
    case CornerKind::kBend:
      break;
  }
  return std::max(block(toward, -1), outside_bend(t, ahead, road_half_width));
}

double Junction::outside_bend(double t, double ahead, double road_half_width) const {
  const double toward = side == 0 ? 1.0 : -1.0;
  return rounded_corner(-toward * t - road_half_width, ahead - half_width, outer_radius);
}

double Junction::along_edge(double s, double t, double road_half_width) const {
  // Steps along the road and along the street. An edge that comes along the road goes away along
  // the street; beyond the street's axis it comes along the street.
  const double along_street = t / std::sin(angle);
  const double along_road = s - station - along_street * std::cos(angle);
  const double ahead = -street_coordinates(s, t).y();
  const double half = road_half_width / std::sin(angle);
  if (kind != CornerKind::kBend) {
    return along_road + (ahead > 0.0 ? -1.0 : 1.0) * (std::abs(along_street) - half);
  }
  const double toward = (side == 0 ? 1.0 : -1.0) * along_street;
  const bool outside =
      outside_bend(t, ahead, road_half_width) >= edge_distance(s, t, road_half_width);
  return along_road + toward + (outside ? half : -half);
}

double Junction::arm_rise(double t) const {
  const double x = std::abs(t) - level_reach;
  if (x <= 0.0) return 0.0;
  const double grade = arm_grade[t > 0.0 ? 0 : 1];
  if (x >= grade_change) return grade * (x - 0.5 * grade_change);
  return grade * 0.5 * (x - grade_change / kPi * std::sin(kPi * x / grade_change));
}

}  // namespace camber
