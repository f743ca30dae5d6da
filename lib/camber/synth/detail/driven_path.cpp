#include "camber/synth/detail/driven_path.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kTransition = 1.5;  // m
constexpr double kStraight = 60.0;   // m before and after the turn
constexpr double kStep = 0.02;       // m between nodes

Eigen::Vector2d direction(double heading) { return {std::cos(heading), std::sin(heading)}; }

double cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

}  // namespace

PathPose LanePath::at(double distance) const {
  const RoadProfile& profile = road_.profile();
  // A parallel of a curve is shorter by its offset times the angle turned.
  const auto driven = [&](double station) {
    return profile.arc_length(station) -
           offset_ * (profile.heading(station) - profile.heading(0.0));
  };
  double station = distance * std::cos(profile.grade(0.0));
  for (int i = 0; i < 20; ++i) {
    station += (distance - driven(station)) * std::cos(profile.grade(station));
  }
  return {road_.place(station, offset_ + drift_ * station),
          profile.heading(station) + std::atan(drift_), station};
}

CornerPath::CornerPath(const RoadModel& road, const CornerOptions& corner, double road_offset,
                       double street_offset)
    : road_(road) {
  const Junction& junction = *road.layout().junction;
  const bool left = corner.turn == TurnDirection::kLeft;
  const double begin_heading = road.profile().heading(junction.station);
  const double street_heading = begin_heading + junction.angle;
  const double turn = left ? junction.angle : junction.angle - kPi;  // signed
  // Curvature rises over the transition, stays, falls: a trapezium with its area the whole turn.
  const double radius = corner.radius;
  turn_length_ = std::abs(turn) * radius + kTransition;
  const double sign = left ? 1.0 : -1.0;
  const auto curvature = [&](double from_begin) {
    const double from_end = turn_length_ - from_begin;
    return sign / radius * std::clamp(std::min(from_begin, from_end) / kTransition, 0.0, 1.0);
  };

  // The turn's shape from the origin along the entry's heading, in plan.
  const int steps = static_cast<int>(std::ceil(turn_length_ / kStep));
  const double step = turn_length_ / steps;
  std::vector<Node> shape(steps + 1);
  shape[0] = {Eigen::Vector2d::Zero(), begin_heading, 0.0};
  for (int i = 0; i < steps; ++i) {
    const Node& from = shape[i];
    const double heading_step = 0.5 * step * (curvature(i * step) + curvature((i + 1) * step));
    shape[i + 1] = {from.place + step * direction(from.heading + 0.5 * heading_step),
                    from.heading + heading_step, from.distance + step};
  }

  // The lanes that it leaves and enters, each to the right of its axis in the driving direction.
  const Eigen::Vector2d along = direction(begin_heading);
  const Eigen::Vector2d right(along.y(), -along.x());
  const Eigen::Vector2d meeting = road.place(junction.station, 0.0);
  const Eigen::Vector2d out = direction(left ? street_heading : street_heading + kPi);
  const Eigen::Vector2d entry = meeting + road_offset * right;
  const Eigen::Vector2d exit = meeting + street_offset * Eigen::Vector2d(out.y(), -out.x());
  // entry + x * along + the turn's end lies on the exit's line.
  const double x = cross(exit - entry - shape.back().place, out) / cross(along, out);
  const Eigen::Vector2d begin = entry + x * along;

  const int straight = static_cast<int>(kStraight / 0.1);
  for (int i = straight; i > 0; --i) nodes_.push_back({begin - 0.1 * i * along, begin_heading, 0});
  for (const Node& node : shape) nodes_.push_back({begin + node.place, node.heading, 0});
  const Eigen::Vector2d end = nodes_.back().place;
  for (int i = 1; i <= straight; ++i) {
    nodes_.push_back({end + 0.1 * i * out, shape.back().heading, 0});
  }
  // Distances in space, over the carriageway, and zero in the middle of the turn.
  Eigen::Vector3d last;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const Eigen::Vector2d& p = nodes_[i].place;
    const Eigen::Vector3d now(p.x(), p.y(), road.height_at(p, junction.station));
    if (i > 0) nodes_[i].distance = nodes_[i - 1].distance + (now - last).norm();
    last = now;
  }
  const double middle = nodes_[straight + shape.size() / 2].distance;
  for (Node& node : nodes_) node.distance -= middle;
}

PathPose CornerPath::at(double distance) const {
  const auto after = std::upper_bound(nodes_.begin() + 1, nodes_.end() - 1, distance,
                                      [](double d, const Node& n) { return d < n.distance; });
  const Node &a = *(after - 1), &b = *after;
  const double share = (distance - a.distance) / (b.distance - a.distance);
  PathPose out;
  out.place = a.place + share * (b.place - a.place);
  out.heading = a.heading + share * (b.heading - a.heading);
  out.station = road_.layout().junction->station;
  return out;
}

}  // namespace camber
