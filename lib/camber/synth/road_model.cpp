#include "camber/synth/road_model.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/synth/detail/noise.h"

namespace camber {
namespace {

constexpr double kPadRamp = 1.5;   // m over which a pad's own slope along the road fades in
constexpr double kPadBlend = 1.4;  // m over which the ground beside a pad meets it

void check(bool good, const char* name, double value, const char* expected) {
  if (!good) {
    throw std::invalid_argument(
        fmt::format("road layout: {}: found {}, expected {}", name, value, expected));
  }
}

/// Rises from 0 to 1 between the middle of a street (x = 0) and its edge (1), level at both.
double crown_shape(double x) {
  const double inside = 1.0 - std::min(1.0, x * x);
  return 1.0 - inside * inside;
}

double noise(double u, double v, double wavelength, std::uint32_t seed) {
  return gradient_noise({static_cast<float>(u / wavelength), static_cast<float>(v / wavelength)},
                        seed);
}

/// Height of pavement, verge and terrain over the road's surface continued, `beyond` m from its
/// edge, without pads.
double rise_beside(const RoadLayout& l, int side, double beyond, double arc, double offset) {
  const auto seed = static_cast<std::uint32_t>(l.seed);
  double rise = 0.0, outside = beyond;
  if (l.pavement[side]) {
    rise = l.kerb_height + 0.015 * std::min(beyond, l.pavement_width);
    outside = std::max(0.0, beyond - l.pavement_width);
  }
  const double ramp = smooth_step(0.0f, 12.0f, static_cast<float>(outside));
  rise +=
      l.verge_slope[side] * outside * smooth_step(0.0f, 4.0f, static_cast<float>(outside)) +
      ramp * (0.8 * noise(arc, offset, 23.0, seed + 3) + 0.3 * noise(arc, offset, 7.0, seed + 4)) +
      0.04 * smooth_step(0.0f, 1.0f, static_cast<float>(outside)) *
          noise(arc, offset, 2.0, seed + 5);
  if (!l.pavement[side] && l.verge_rise[side] != 0.0) {
    rise += l.verge_rise[side] *
            smooth_step(0.0f, static_cast<float>(l.verge_rise_width), static_cast<float>(beyond));
  }
  return rise;
}

void check_junction(const RoadProfile& profile, const RoadLayout& layout) {
  const Junction& j = *layout.junction;
  double sharpest = 0.0;
  for (double s = profile.begin(); s <= profile.end(); s += 1.0) {
    sharpest = std::max(sharpest, std::abs(profile.curvature(s)));
  }
  check(sharpest == 0.0, "curvature of a road with a junction", sharpest, "0");
  check(layout.pads.empty(), "pads of a road with a junction",
        static_cast<double>(layout.pads.size()), "none");
  check(layout.pavement[0] == layout.pavement[1], "pavement[1] of a road with a junction",
        layout.pavement[1], "the same as pavement[0]");
  check(j.station > profile.begin() && j.station < profile.end(), "junction station", j.station,
        "on the road");
  check(j.angle > 0.78 && j.angle < 2.36, "junction angle", j.angle, "0.78 to 2.36 rad");
  check(j.half_width > 1.0 && j.half_width < 20.0, "junction half_width", j.half_width,
        "1 to 20 m");
  check(j.kerb_radius > 0.0 && j.kerb_radius < 30.0, "junction kerb_radius", j.kerb_radius,
        "0 to 30 m");
  check(j.outer_radius > 0.0 && j.outer_radius < 40.0, "junction outer_radius", j.outer_radius,
        "0 to 40 m");
  check(j.side == 0 || j.side == 1, "junction side", j.side, "0 or 1");
  for (const double grade : j.arm_grade) {
    check(std::abs(grade) < 0.4, "junction arm_grade", grade, "-0.4 to 0.4");
  }
  check(j.level_reach >= 0.0, "junction level_reach", j.level_reach, "at least 0 m");
  check(j.grade_change > 0.0, "junction grade_change", j.grade_change, "more than 0 m");
}

}  // namespace

RoadModel::RoadModel(RoadProfile profile, RoadLayout layout)
    : profile_(std::move(profile)), layout_(std::move(layout)) {
  const RoadLayout& l = layout_;
  check(l.half_width > 1.0 && l.half_width < 20.0, "half_width", l.half_width, "1 to 20 m");
  check(l.crown >= 0.0 && l.crown < 0.5, "crown", l.crown, "0 to 0.5 m");
  check(l.undulation >= 0.0 && l.undulation < 0.1, "undulation", l.undulation, "0 to 0.1 m");
  check(l.pavement_width > 0.2 && l.pavement_width < 10.0, "pavement_width", l.pavement_width,
        "0.2 to 10 m");
  check(l.kerb_height >= 0.0 && l.kerb_height < 0.5, "kerb_height", l.kerb_height, "0 to 0.5 m");
  check(l.kerb_width > 0.0 && l.kerb_width < l.pavement_width, "kerb_width", l.kerb_width,
        "0 to pavement_width");
  for (const RoadLayout::Pad& pad : l.pads) {
    check(pad.side == 0 || pad.side == 1, "pad side", pad.side, "0 or 1");
    check(pad.end > pad.begin, "pad end", pad.end, "more than its begin");
    check(pad.depth > 0.0 && pad.depth < 20.0, "pad depth", pad.depth, "0 to 20 m");
    check(std::abs(pad.slope_out) < 0.5, "pad slope_out", pad.slope_out, "-0.5 to 0.5");
    check(std::abs(pad.slope_along) < 0.5, "pad slope_along", pad.slope_along, "-0.5 to 0.5");
  }
  for (const double rise : l.verge_rise) {
    check(std::abs(rise) <= 0.5, "verge_rise", rise, "-0.5 to 0.5 m");
  }
  check(l.verge_rise_width > 0.0, "verge_rise_width", l.verge_rise_width, "more than 0 m");
  if (l.junction) check_junction(profile_, l);
}

double RoadModel::edge_distance(double station, double offset) const {
  return layout_.junction ? layout_.junction->edge_distance(station, offset, layout_.half_width)
                          : std::abs(offset) - layout_.half_width;
}

GroundKind RoadModel::kind(double station, double offset) const {
  const double beyond = edge_distance(station, offset);
  if (beyond < 0.0) return GroundKind::kRoad;
  const int side = offset > 0.0 ? 0 : 1;
  for (const RoadLayout::Pad& pad : layout_.pads) {
    if (pad.side == side && station >= pad.begin && station <= pad.end && beyond <= pad.depth) {
      return GroundKind::kPad;
    }
  }
  if (!layout_.pavement[side] || beyond > layout_.pavement_width) return GroundKind::kVerge;
  return beyond < layout_.kerb_width ? GroundKind::kKerb : GroundKind::kPavement;
}

double RoadModel::road_height(double station, double offset) const {
  const double share = offset / layout_.half_width;
  const double arc = profile_.arc_length(station);
  const auto seed = static_cast<std::uint32_t>(layout_.seed);
  // Long waves carry most of the unevenness, short ones a quarter of it.
  const double uneven =
      noise(arc, offset, 9.0, seed + 1) + 0.25 * noise(arc, offset, 2.6, seed + 2);
  const double even = profile_.center(station).z() + std::tan(profile_.bank(station)) * offset;
  if (!layout_.junction) {
    return even - layout_.crown * share * share + layout_.undulation * uneven;
  }
  const double across = layout_.junction->street_coordinates(station, offset).y();
  return even + layout_.junction->arm_rise(offset) -
         layout_.crown * crown_shape(share) * crown_shape(across / layout_.junction->half_width) +
         layout_.undulation * uneven;
}

double RoadModel::beside_junction(double station, double offset) const {
  const RoadLayout& l = layout_;
  const double beyond = std::max(0.0, edge_distance(station, offset));
  const double along = profile_.arc_length(station);
  return road_height(station, offset) + rise_beside(l, 0, beyond, along, offset);
}

double RoadModel::side_height(double station, double offset) const {
  if (layout_.junction) return beside_junction(station, offset);
  const RoadLayout& l = layout_;
  const int side = offset > 0.0 ? 0 : 1;
  const double sign = offset > 0.0 ? 1.0 : -1.0;
  const double beyond = std::max(0.0, std::abs(offset) - l.half_width);
  const double tangent = std::tan(profile_.bank(station));

  const double banked = l.pavement[side] ? l.pavement_width : 1.0;
  const double edge =
      road_height(station, sign * l.half_width) + tangent * sign * std::min(beyond, banked);
  double rise = rise_beside(l, side, beyond, profile_.arc_length(station), offset);
  for (const RoadLayout::Pad& pad : l.pads) {
    if (pad.side != side) continue;
    const double along = std::max({0.0, pad.begin - station, station - pad.end});
    const double across = std::max(0.0, beyond - pad.depth);
    const double weight = (1.0 - smooth_step(0.0f, kPadBlend, static_cast<float>(along))) *
                          (1.0 - smooth_step(0.0f, 1.8f * kPadBlend, static_cast<float>(across)));
    if (weight <= 0.0) continue;
    const double own = pad.slope_out * beyond + std::min(1.0, beyond / kPadRamp) * pad.slope_along *
                                                    (station - 0.5 * (pad.begin + pad.end));
    rise += weight * (own - rise);
  }
  return edge + rise;
}

double RoadModel::height(double station, double offset) const {
  return edge_distance(station, offset) <= 0.0 ? road_height(station, offset)
                                               : side_height(station, offset);
}

Eigen::Vector2d RoadModel::place(double station, double offset) const {
  const double heading = profile_.heading(station);
  return profile_.center(station).head<2>() +
         offset * Eigen::Vector2d(-std::sin(heading), std::cos(heading));
}

Eigen::Vector3d RoadModel::point(double station, double offset) const {
  const Eigen::Vector2d p = place(station, offset);
  return {p.x(), p.y(), height(station, offset)};
}

double RoadModel::height_at(const Eigen::Vector2d& place_in_plan, double station) const {
  const Eigen::Vector2d found = profile_.locate(place_in_plan, station);
  return height(found.x(), found.y());
}

RoadModel::LocalPlane RoadModel::local_plane(const Eigen::Vector2d& middle, double station,
                                             double heading, double length, double width) const {
  constexpr int kAlong = 15, kAcross = 9;
  const Eigen::Vector2d front(std::cos(heading), std::sin(heading));
  const Eigen::Vector2d left(-front.y(), front.x());
  Eigen::Matrix<double, 3, kAlong * kAcross> points;
  for (int i = 0; i < kAlong; ++i) {
    for (int j = 0; j < kAcross; ++j) {
      const Eigen::Vector2d p = middle +
                                (static_cast<double>(i) / (kAlong - 1) - 0.5) * length * front +
                                (static_cast<double>(j) / (kAcross - 1) - 0.5) * width * left;
      points.col(i * kAcross + j) << p.x(), p.y(), height_at(p, station);
    }
  }
  const Eigen::Vector3d mean = points.rowwise().mean();
  const auto centred = (points.colwise() - mean).eval();
  const Eigen::Matrix3d scatter = centred * centred.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  LocalPlane out;
  out.plane = Plane::through(mean, solver.eigenvectors().col(0)).oriented(Eigen::Vector3d::UnitZ());
  out.rms = std::sqrt(std::max(0.0, solver.eigenvalues()(0)) / (kAlong * kAcross));
  return out;
}

}  // namespace camber
