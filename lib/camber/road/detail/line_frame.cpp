#include "camber/road/detail/line_frame.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace camber::detail {

using Eigen::Vector2d;

namespace {

Vector2d left_of(const Vector2d& ahead) { return {-ahead.y(), ahead.x()}; }

}  // namespace

LineFrame::LineFrame(std::vector<Vector2d> corners, double smoothing, double beyond)
    : corners_(std::move(corners)), smoothing_(smoothing) {
  stations_.push_back(0.0);
  for (std::size_t i = 1; i < corners_.size(); ++i) {
    stations_.push_back(stations_.back() + (corners_[i] - corners_[i - 1]).norm());
  }
  first_ = -beyond;
  const auto count = static_cast<std::size_t>(std::ceil((length() + 2.0 * beyond) / spacing_)) + 1;
  // The running mean, from the polyline's integral.
  std::vector<Vector2d> integral = {Vector2d::Zero()};
  for (std::size_t i = 1; i < corners_.size(); ++i) {
    integral.push_back(integral.back() +
                       0.5 * (stations_[i] - stations_[i - 1]) * (corners_[i] + corners_[i - 1]));
  }
  const auto integral_to = [&](double s) -> Vector2d {
    const double inside = std::clamp(s, 0.0, length());
    const auto next = std::upper_bound(stations_.begin() + 1, stations_.end() - 1, inside);
    const auto i = static_cast<std::size_t>(next - stations_.begin()) - 1;
    Vector2d sum = integral[i] + 0.5 * (inside - stations_[i]) * (corners_[i] + position(inside));
    if (s != inside) sum += 0.5 * (s - inside) * (position(s) + position(inside));
    return sum;
  };
  Vector2d last = (corners_[1] - corners_[0]).normalized();
  for (std::size_t k = 0; k < count; ++k) {
    const double s = station_of(k);
    Node here;
    here.at = (integral_to(s + smoothing_) - integral_to(s - smoothing_)) / (2.0 * smoothing_);
    const Vector2d chord = position(s + smoothing_) - position(s - smoothing_);
    here.ahead = chord.norm() > 1e-9 ? chord.normalized() : last;
    last = here.ahead;
    nodes_.push_back(here);
  }
}

Vector2d LineFrame::position(double s) const {
  const auto next = std::upper_bound(stations_.begin() + 1, stations_.end() - 1, s);
  const auto i = static_cast<std::size_t>(next - stations_.begin()) - 1;
  const double share = (s - stations_[i]) / (stations_[i + 1] - stations_[i]);
  return corners_[i] + share * (corners_[i + 1] - corners_[i]);
}

LineFrame::Node LineFrame::node(double s) const {
  const double at =
      std::clamp((s - first_) / spacing_, 0.0, static_cast<double>(nodes_.size() - 1));
  const auto k = std::min(static_cast<std::size_t>(at), nodes_.size() - 2);
  const double share = at - static_cast<double>(k);
  Node out;
  out.at = nodes_[k].at + share * (nodes_[k + 1].at - nodes_[k].at);
  out.ahead = (nodes_[k].ahead + share * (nodes_[k + 1].ahead - nodes_[k].ahead)).normalized();
  return out;
}

Vector2d LineFrame::ahead(double s) const { return node(s).ahead; }

LinePlace LineFrame::refine(const Vector2d& point, double low, double high) const {
  const auto off = [&](double s) {
    const Node here = node(s);
    return here.ahead.dot(point - here.at);
  };
  double at_low = off(low), at_high = off(high);
  double s = 0.5 * (low + high);
  // What lies ahead of a place becomes less along the line: a zero between the two, by Illinois'
  // rule.
  if (at_low <= 0.0) {
    s = low;
  } else if (at_high >= 0.0) {
    s = high;
  } else {
    int side = 0;
    for (int i = 0; i < 40 && high - low > 1e-9; ++i) {
      s = (low * at_high - high * at_low) / (at_high - at_low);
      const double here = off(s);
      if (std::abs(here) < 1e-9) break;
      if (here > 0.0) {
        low = s;
        at_low = here;
        if (side == 1) at_high *= 0.5;
        side = 1;
      } else {
        high = s;
        at_high = here;
        if (side == -1) at_low *= 0.5;
        side = -1;
      }
    }
  }
  const Node here = node(s);
  return {s, left_of(here.ahead).dot(point - here.at)};
}

LinePlace LineFrame::place_near(const Vector2d& point, double s) const {
  return refine(point, s - 2.0, s + 2.0);
}

long LineFrame::cell_of(double x, double low) const {
  return static_cast<long>(std::floor((x - low) / cell_));
}

void LineFrame::prepare(double reach) {
  cell_ = std::max(reach, spacing_);
  low_ = nodes_.front().at;
  Vector2d high = low_;
  for (const Node& here : nodes_) {
    low_ = low_.cwiseMin(here.at);
    high = high.cwiseMax(here.at);
  }
  low_ -= Vector2d::Constant(1.5 * cell_);
  high += Vector2d::Constant(1.5 * cell_);
  columns_ = cell_of(high.x(), low_.x()) + 1;
  lines_ = cell_of(high.y(), low_.y()) + 1;
  cells_.clear();
  for (std::size_t k = 0; k < nodes_.size(); ++k) {
    const Vector2d& at = nodes_[k].at;
    cells_.emplace_back(cell_of(at.y(), low_.y()) * columns_ + cell_of(at.x(), low_.x()),
                        static_cast<int>(k));
  }
  std::sort(cells_.begin(), cells_.end());
}

bool LineFrame::near(const Vector2d& point, double reach) const {
  const double x = (point.x() - low_.x()) / cell_, y = (point.y() - low_.y()) / cell_;
  if (!(x >= 0.0) || !(y >= 0.0) || x >= static_cast<double>(columns_) ||
      y >= static_cast<double>(lines_)) {
    return false;
  }
  const long column = static_cast<long>(x), row = static_cast<long>(y);
  for (long j = row - 1; j <= row + 1; ++j) {
    const std::pair<long, int> from{j * columns_ + column - 1, -1};
    for (auto cell = std::lower_bound(cells_.begin(), cells_.end(), from);
         cell != cells_.end() && cell->first <= j * columns_ + column + 1; ++cell) {
      if ((nodes_[static_cast<std::size_t>(cell->second)].at - point).norm() <= reach) return true;
    }
  }
  return false;
}

void LineFrame::places(const Vector2d& point, double reach, std::vector<LinePlace>* out) const {
  out->clear();
  const double x = (point.x() - low_.x()) / cell_, y = (point.y() - low_.y()) / cell_;
  if (!(x >= 0.0) || !(y >= 0.0) || x >= static_cast<double>(columns_) ||
      y >= static_cast<double>(lines_)) {
    return;
  }
  const long column = static_cast<long>(x), row = static_cast<long>(y);
  // The nearest node of each stretch that passes the point.
  struct Near {
    int node;
    double squared;
  };
  Near found[8];
  int count = 0;
  const auto apart = static_cast<int>(20.0 / spacing_);
  const double most = std::pow(reach + 2.0 * spacing_, 2);
  for (long j = row - 1; j <= row + 1; ++j) {
    const std::pair<long, int> from{j * columns_ + column - 1, -1};
    for (auto cell = std::lower_bound(cells_.begin(), cells_.end(), from);
         cell != cells_.end() && cell->first <= j * columns_ + column + 1; ++cell) {
      const double squared =
          (nodes_[static_cast<std::size_t>(cell->second)].at - point).squaredNorm();
      if (squared > most) continue;
      int same = 0;
      while (same < count && std::abs(found[same].node - cell->second) > apart) ++same;
      if (same == count) {
        if (count < 8) found[count++] = {cell->second, squared};
      } else if (squared < found[same].squared ||
                 (squared == found[same].squared && cell->second < found[same].node)) {
        found[same] = {cell->second, squared};
      }
    }
  }
  for (int i = 0; i < count; ++i) {
    const double s = station_of(static_cast<std::size_t>(found[i].node));
    const LinePlace place = refine(point, s - 2.0 * spacing_, s + 2.0 * spacing_);
    if (!(std::abs(place.v) < reach)) continue;
    if (std::abs(place.s - s) >= 2.0 * spacing_ - 1e-9) continue;  // beyond an end
    // Beyond the centre of a bend sections cross.
    const Vector2d before = ahead(place.s - 1.0), after = ahead(place.s + 1.0);
    const double turn =
        std::atan2(before.x() * after.y() - before.y() * after.x(), before.dot(after));
    if (0.5 * turn * place.v > 0.8) continue;
    out->push_back(place);
  }
}

}  // namespace camber::detail
