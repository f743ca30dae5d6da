// What $ROAD_CRG_MODS does to a road before anything is asked of it.

#include <cmath>

#include "camber/export/opencrg.h"

namespace camber {

void CrgRoad::modify(const CrgData& data, const CrgModifiers& m) {
  bool use_end = true;
  if (m.scale_heights) {
    for (float& height : heights_) height *= static_cast<float>(*m.scale_heights);
  }
  if (m.scale_slope) {
    for (double& slope : slope_) slope *= *m.scale_slope;
    start_slope_ *= *m.scale_slope;
    has_end_z_ = false;
  }
  if (m.scale_banking) {
    for (double& banking : banking_) banking *= *m.scale_banking;
    start_banking_ *= *m.scale_banking;
  }
  if (m.scale_length) {
    last_u_ = first_u_ + *m.scale_length * (last_u_ - first_u_);
    increment_ *= *m.scale_length;
    use_end = false;
    has_end_z_ = false;
  }
  if (m.scale_width) {
    for (double& v : v_) v *= *m.scale_width;
    v_right_ *= *m.scale_width;
    v_left_ *= *m.scale_width;
  }
  if (m.scale_curvature) {
    for (double& phi : phi_) phi = first_phi_ + *m.scale_curvature * (phi - first_phi_);
    last_phi_ = phi_.empty() ? first_phi_ : phi_.back();
    use_end = false;
  }
  if (m.unknown) fill_unknown(*m.unknown, m.unknown_offset);
  place_line(data, use_end);
  raise_line(has_end_z_);
  find_closure();
  move(m);
}

void CrgRoad::fill_unknown(CrgUnknown mode, double offset) {
  if (mode == CrgUnknown::kKeep) return;
  const std::size_t columns = v_.size();
  for (std::size_t i = 0; i < x_.size(); ++i) {
    if (mode == CrgUnknown::kZero) {
      for (std::size_t j = 0; j < columns; ++j) {
        if (std::isnan(stored(i, j))) stored(i, j) = static_cast<float>(offset);
      }
      continue;
    }
    // From the right neighbour, and what lies right of all that is known from the left.
    bool filled = false;
    for (std::size_t j = 1; j < columns; ++j) {
      const bool unknown = std::isnan(stored(i, j));
      if (unknown) {
        stored(i, j) = stored(i, j - 1) + (filled ? 0.0f : static_cast<float>(offset));
      }
      filled = unknown && !std::isnan(stored(i, j));
    }
    filled = false;
    for (std::size_t j = columns - 1; j > 0; --j) {
      if (!std::isnan(stored(i, j - 1)) || std::isnan(stored(i, j))) continue;
      stored(i, j - 1) = stored(i, j) + (filled ? 0.0f : static_cast<float>(offset));
      filled = true;
    }
  }
}

void CrgRoad::move_heights(double by) {
  if (!z_.empty()) {
    for (double& z : z_) z += by;
  }
  if (!z_.empty() || has_start_z_) {
    first_z_ += by;
    last_z_ += by;
  } else {
    grid_offset_ += by;
  }
}

void CrgRoad::move(const CrgModifiers& m) {
  const bool by_point = m.point_x || m.point_y || m.point_z || m.point_phi || m.point_u ||
                        m.point_u_fraction || m.point_v || m.point_v_fraction;
  const bool by_offset = m.offset_x || m.offset_y || m.offset_z || m.offset_phi;
  if (!by_point && !by_offset) return;
  Eigen::Vector2d centre(first_x_, first_y_), to = Eigen::Vector2d::Zero();
  double turn = 0.0, rise = 0.0;
  if (by_point) {
    double u = m.point_u.value_or(first_u_), v = m.point_v.value_or(0.0);
    if (m.point_u_fraction) {
      u = first_u_ + *m.point_u_fraction * (last_u_ - first_u_) + m.point_u_offset;
    }
    if (m.point_v_fraction) {
      v = v_right_ + *m.point_v_fraction * (v_left_ - v_right_) + m.point_v_offset;
    }
    centre = position(u, v);
    to = Eigen::Vector2d(m.point_x.value_or(0.0), m.point_y.value_or(0.0)) - centre;
    const double height_there = height(u, v);
    rise = m.point_z.value_or(0.0) - (std::isnan(height_there) ? 0.0 : height_there);
    turn = m.point_phi.value_or(0.0) - heading(u);
  } else {
    centre = {m.centre_x.value_or(first_x_), m.centre_y.value_or(first_y_)};
    to = {m.offset_x.value_or(0.0), m.offset_y.value_or(0.0)};
    rise = m.offset_z.value_or(0.0);
    turn = m.offset_phi.value_or(0.0);
  }
  const double c = std::cos(turn), s = std::sin(turn);
  const auto moved = [&](double* x, double* y) {
    const Eigen::Vector2d d = Eigen::Vector2d(*x, *y) - centre;
    *x = centre.x() + c * d.x() - s * d.y() + to.x();
    *y = centre.y() + s * d.x() + c * d.y() + to.y();
  };
  for (std::size_t i = 0; i < x_.size(); ++i) moved(&x_[i], &y_[i]);
  moved(&first_x_, &first_y_);
  moved(&last_x_, &last_y_);
  for (double& phi : phi_) phi += turn;
  first_phi_ += turn;
  last_phi_ += turn;
  move_heights(rise);
}

}  // namespace camber
