#include "camber/synth/detail/street.h"

namespace camber {

double Street::half_width() const {
  return crossing_ ? road_->layout().junction->half_width : road_->layout().half_width;
}

bool Street::exists(double station) const {
  const auto& junction = road_->layout().junction;
  if (!junction) return true;
  if (!crossing_) return station < junction->station || junction->road_goes_on();
  return junction->has_arm(station > 0.0 ? 0 : 1);
}

Eigen::Vector2d Street::place(double station, double offset) const {
  if (!crossing_) return road_->place(station, offset);
  const Eigen::Vector2d st = road_->layout().junction->from_street(station, offset);
  return road_->place(st.x(), st.y());
}

double Street::heading(double station) const {
  return crossing_ ? road_->profile().heading(road_->layout().junction->station) +
                         road_->layout().junction->angle
                   : road_->profile().heading(station);
}

Eigen::Vector3d Street::point(double station, double offset) const {
  if (!crossing_) return road_->point(station, offset);
  const Eigen::Vector2d st = road_->layout().junction->from_street(station, offset);
  return road_->point(st.x(), st.y());
}

double Street::height_at(const Eigen::Vector2d& place, double station) const {
  // A road with a junction is straight: any guess finds the place in one step.
  return road_->height_at(place, crossing_ ? road_->layout().junction->station : station);
}

double Street::edge_distance(const Eigen::Vector2d& place, double station) const {
  const Eigen::Vector2d st =
      road_->profile().locate(place, crossing_ ? road_->layout().junction->station : station);
  return road_->edge_distance(st.x(), st.y());
}

}  // namespace camber
