// Heights on an OpenCRG road. Where the format leaves something open (the integration of the
// reference line, what border modes do to banking and offsets, how a place is brought to u and v)
// this follows what ASAM's C reader 1.2 computes, so that one file is one road.

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/export/opencrg.h"

namespace camber {

using Eigen::Vector2d;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kEdge = 1e-8;  // m beyond the last long section that still count as on it

/// Brings a value back into [low, low + size) as if the range repeated.
double repeated(double value, double low, double size) {
  const double rest = std::fmod(value - low, size);
  return low + (rest < 0.0 ? rest + size : rest);
}

/// The same as if every other repetition were mirrored.
double reflected(double value, double low, double size) {
  const double rest = repeated(value, low, 2.0 * size) - low;
  return low + (rest > size ? 2.0 * size - rest : rest);
}

Vector2d left_of(const Vector2d& direction) { return {-direction.y(), direction.x()}; }

double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

}  // namespace

CrgRoad::CrgRoad(const CrgData& data, bool apply)
    : options_(data.options),
      first_u_(data.start_u),
      increment_(data.increment),
      v_right_(data.v_right),
      v_left_(data.v_left),
      numbered_(data.numbered),
      v_(data.v),
      phi_(data.phi),
      slope_(data.slope),
      banking_(data.banking),
      first_x_(data.start_x),
      first_y_(data.start_y),
      first_phi_(data.start_phi),
      first_z_(data.start_z),
      has_start_z_(data.has_start_z),
      start_slope_(data.start_slope),
      start_banking_(data.start_banking),
      heights_(data.heights) {
  const std::size_t n = data.sections();
  if (n < 2 || v_.size() < 2) throw std::invalid_argument("CrgData: fewer than 2 x 2 heights");
  if (!phi_.empty()) phi_.front() = first_phi_;
  last_u_ = first_u_ + increment_ * static_cast<double>(n - 1);
  last_phi_ = data.end_phi.value_or(phi_.empty() ? first_phi_ : phi_.back());
  last_z_ = data.end_z.value_or(0.0);
  has_end_z_ = data.end_z.has_value();
  place_line(data, true);
  raise_line(true);
  find_closure();
  if (apply) modify(data, data.modifiers.value_or(CrgModifiers::defaults()));
}

void CrgRoad::place_line(const CrgData& data, bool use_end) {
  const std::size_t n = data.sections();
  x_.assign(n, 0.0);
  y_.assign(n, 0.0);
  const bool has_end = use_end && data.end_x && data.end_y;
  if (phi_.empty()) {
    for (std::size_t i = 0; i < n; ++i) {
      x_[i] = first_x_ + static_cast<double>(i) * increment_ * std::cos(first_phi_);
      y_[i] = first_y_ + static_cast<double>(i) * increment_ * std::sin(first_phi_);
    }
  } else if (!has_end) {
    x_[0] = first_x_;
    y_[0] = first_y_;
    for (std::size_t i = 1; i < n; ++i) {
      x_[i] = x_[i - 1] + increment_ * std::cos(phi_[i]);
      y_[i] = y_[i - 1] + increment_ * std::sin(phi_[i]);
    }
  } else {
    // Back from the end, then forth from the start, the weight of the end growing along the way.
    x_[n - 1] = *data.end_x;
    y_[n - 1] = *data.end_y;
    for (std::size_t i = n - 1; i > 0; --i) {
      x_[i - 1] = x_[i] - increment_ * std::cos(phi_[i]);
      y_[i - 1] = y_[i] - increment_ * std::sin(phi_[i]);
    }
    x_[0] = first_x_;
    y_[0] = first_y_;
    for (std::size_t i = 1; i < n; ++i) {
      const double share = static_cast<double>(i) / static_cast<double>(n - 1);
      x_[i] = (1.0 - share) * (x_[i - 1] + increment_ * std::cos(phi_[i])) + share * x_[i];
      y_[i] = (1.0 - share) * (y_[i - 1] + increment_ * std::sin(phi_[i])) + share * y_[i];
    }
  }
  last_x_ = has_end ? *data.end_x : x_.back();
  last_y_ = has_end ? *data.end_y : y_.back();
}

void CrgRoad::raise_line(bool use_end) {
  z_.clear();
  if (slope_.empty() && start_slope_ == 0.0) return;
  const std::size_t n = x_.size();
  const auto rise = [&](std::size_t i) {
    return (slope_.empty() ? start_slope_ : slope_[i]) * increment_;
  };
  z_.assign(n, 0.0);
  if (use_end && has_end_z_) {
    z_[n - 1] = last_z_;
    for (std::size_t i = n - 1; i > 0; --i) z_[i - 1] = z_[i] - rise(i);
    z_[0] = first_z_;
    for (std::size_t i = 1; i + 1 < n; ++i) {
      const double share = static_cast<double>(i - 1) / static_cast<double>(n - 1);
      z_[i] = (1.0 - share) * (z_[i - 1] + rise(i)) + share * z_[i];
    }
  } else {
    z_[0] = first_z_;
    for (std::size_t i = 1; i < n; ++i) z_[i] = z_[i - 1] + rise(i);
    last_z_ = z_.back();
  }
}

void CrgRoad::find_closure() {
  // A track is closed where the tangents at its ends meet, or pass each other, in the gap.
  closed_ = false;
  const Vector2d start(first_x_, first_y_), end(last_x_, last_y_);
  const Vector2d m(std::cos(first_phi_), std::sin(first_phi_));
  const Vector2d n(std::cos(last_phi_), std::sin(last_phi_));
  const double along = m.dot(n);
  if (along <= 0.5) return;  // more than 60 degrees between them
  const double beyond_end = (start - end).dot(m) / along;
  const double before_start = (end - start).dot(n) / along;
  if (!(beyond_end > 0.0) || !(before_start < 0.0)) return;
  closed_ = true;
  close_min_ = first_u_ + 0.5 * before_start * along;
  close_max_ = last_u_ + 0.5 * beyond_end * along;
  const double turn = cross(m, n);
  if (std::abs(turn) <= 1e-6) return;
  const double l = cross(m, start - end) / turn, k = cross(n, start - end) / turn;
  if (l >= 0.0 && k <= 0.0) {
    close_min_ = first_u_ + k;
    close_max_ = last_u_ + l;
  }
}

double CrgRoad::wrapped(double u) const {
  if (!closed_ || !options_.close_track || (u >= close_min_ && u <= close_max_)) return u;
  const double rest = std::fmod(u - close_min_, close_max_ - close_min_);
  return rest > 0.0 ? close_min_ + rest : close_max_ + rest;
}

CrgRoad::Cell CrgRoad::cell_of_v(double v) const {
  Cell cell;
  if (numbered_) {
    const double step = (v_.back() - v_.front()) / static_cast<double>(v_.size() - 1);
    const double at = std::max((v - v_.front()) / step, 0.0);
    if (at >= static_cast<double>(v_.size() - 1)) return {v_.size() - 2, 1.0};
    cell.index = static_cast<std::size_t>(at);
    cell.share = at - static_cast<double>(cell.index);
    return cell;
  }
  const auto above = std::upper_bound(v_.begin() + 1, v_.end() - 1, v);
  cell.index = static_cast<std::size_t>(above - v_.begin()) - 1;
  cell.share = std::clamp((v - v_[cell.index]) / (v_[cell.index + 1] - v_[cell.index]), 0.0, 1.0);
  return cell;
}

CrgRoad::Side CrgRoad::side_u(double u) const {
  Side side;
  const std::size_t n = x_.size();
  const double size = last_u_ - first_u_;
  side.at = u;
  if (u < first_u_ || u > last_u_) {
    side.offset = options_.offset_u;
    switch (options_.border_u) {
      case CrgBorder::kNone:
        side.nothing = true;
        return side;
      case CrgBorder::kZero:
        side.zero = true;
        [[fallthrough]];
      case CrgBorder::kKeep:
        side.inside = false;
        break;
      case CrgBorder::kRepeat:
        side.at = repeated(u, first_u_, size);
        break;
      case CrgBorder::kReflect:
        side.at = reflected(u, first_u_, size);
        break;
    }
  }
  const double at = std::max((side.at - first_u_) / increment_, 0.0);
  if (at >= static_cast<double>(n - 1)) {
    side.cell = {n - 2, 1.0};
  } else {
    side.cell.index = static_cast<std::size_t>(at);
    side.cell.share = at - static_cast<double>(side.cell.index);
  }
  return side;
}

CrgRoad::Side CrgRoad::side_v(double v) const {
  Side side;
  const double size = v_left_ - v_right_;
  side.at = v;
  double place = v;  // in the grid; `at` keeps what banking counts from
  if (v < v_right_ || v > v_left_) {
    side.offset = options_.offset_v;
    CrgBorder mode = options_.border_v;
    if (!numbered_ && (std::abs(v - v_right_) < kEdge || std::abs(v - v_left_) < kEdge)) {
      mode = CrgBorder::kKeep;
    }
    switch (mode) {
      case CrgBorder::kNone:
        side.nothing = true;
        return side;
      case CrgBorder::kZero:
        side.zero = true;
        [[fallthrough]];
      case CrgBorder::kKeep:
        side.inside = false;
        break;
      case CrgBorder::kRepeat:
        place = repeated(v, v_right_, size);
        break;
      case CrgBorder::kReflect:
        place = reflected(v, v_right_, size);
        break;
    }
    if (numbered_) side.at = place;
  }
  side.cell = cell_of_v(place);
  return side;
}

double CrgRoad::end_height(bool last) const {
  if (z_.empty()) return last ? last_z_ : first_z_;
  return last ? z_.back() : z_.front();
}

double CrgRoad::smoothed(double height, double u) const {
  double base = 0.0, scale = 1.0;
  bool fades = false;
  if (options_.smooth_begin && u - first_u_ <= *options_.smooth_begin) {
    scale = u < first_u_ ? 0.0 : (u - first_u_) / *options_.smooth_begin;
    base = end_height(false);
    fades = true;
  }
  if (options_.smooth_end && last_u_ - u <= *options_.smooth_end) {
    scale = u > last_u_ ? 0.0 : (last_u_ - u) / *options_.smooth_end;
    base = end_height(true);
    fades = true;
  }
  return fades ? base + (height - base) * scale : height;
}

double CrgRoad::height(double u, double v) const {
  if (!std::isfinite(u) || !std::isfinite(v)) return kNaN;
  u = wrapped(u);
  const Side along = side_u(u), across = side_v(v);
  if (along.nothing || across.nothing) return kNaN;
  const std::size_t i = along.cell.index, j = across.cell.index;
  double height = 0.0;
  if (!along.zero && !across.zero) {
    const double z00 = stored(i, j), z10 = stored(i + 1, j), z01 = stored(i, j + 1),
                 z11 = stored(i + 1, j + 1);
    const double s = along.cell.share, t = across.cell.share;
    height = ((z11 - z10 - z01 + z00) * t + (z10 - z00)) * s + (z01 - z00) * t + z00;
    height += grid_offset_;
  }
  const double share = along.cell.share;
  height += z_.empty() ? first_z_ : z_[i] + share * (z_[i + 1] - z_[i]);
  const bool banked = !banking_.empty() || start_banking_ != 0.0;
  if (banked && !along.zero) {
    const double banking =
        banking_.empty() ? start_banking_ : banking_[i] + share * (banking_[i + 1] - banking_[i]);
    height += banking * std::clamp(across.at, v_right_, v_left_);
  }
  const double offset = along.offset + across.offset;
  if (!along.inside) {
    height = along.zero ? offset : height + offset;
  } else if (!across.inside) {
    height = across.zero ? offset : height + offset;
  }
  return smoothed(height, along.at);
}

double CrgRoad::height_at(double x, double y) const {
  const Vector2d uv = coordinates(x, y);
  return height(uv.x(), uv.y());
}

Vector2d CrgRoad::position(double u, double v) const {
  u = wrapped(u);
  const std::size_t n = x_.size();
  const double at = (u - first_u_) / increment_;
  const auto index = static_cast<std::size_t>(std::clamp(at, 0.0, static_cast<double>(n - 2)));
  const double share = at - static_cast<double>(index);
  const auto beyond = [&](double x, double y, double phi, double by) -> Vector2d {
    const Vector2d ahead(std::cos(phi), std::sin(phi));
    return Vector2d(x, y) + by * increment_ * ahead + v * left_of(ahead);
  };
  if (share < 0.0) return beyond(first_x_, first_y_, first_phi_, share);
  if (share > 1.0) return beyond(last_x_, last_y_, last_phi_, share - 1.0);
  const auto place = [&](std::size_t i) { return Vector2d(x_[i], y_[i]); };
  const Vector2d p1 = place(index), p2 = place(index + 1);
  const Vector2d normal = left_of(p2 - p1).normalized();
  // Across a corner of the line the two sides share the mitre.
  const auto mitre = [&](std::size_t before, std::size_t after) -> Vector2d {
    const Vector2d m = left_of(place(after) - place(before)).normalized();
    const double slant = m.dot(normal);
    return std::abs(slant) > 1e-10 ? Vector2d(m / slant) : m;
  };
  const Vector2d a = p1 + v * (index > 0 ? mitre(index - 1, index + 1) : normal);
  const Vector2d b = p2 + v * (index + 2 < n ? mitre(index, index + 2) : normal);
  return a + share * (b - a);
}

std::size_t CrgRoad::nearest_step(double x, double y) const {
  const std::size_t n = x_.size();
  const Vector2d p(x, y);
  const auto place = [&](std::size_t i) { return Vector2d(x_[i], y_[i]); };
  // A coarse look at every tenth point, then from corner to corner.
  std::size_t at = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0;; i = i + 10 < n ? i + 10 : n - 1) {
    const double distance = (p - place(i)).squaredNorm();
    if (distance < least) least = distance, at = i;
    if (i == n - 1) break;
  }
  at = std::max<std::size_t>(at, 1);
  // The step that leads to point `at`, forward while the place lies ahead of that point's mitre.
  double seam = 0.0;
  for (std::size_t steps = 0; steps < 2 * n; ++steps) {
    const std::size_t next = std::min(at + 1, n - 1);
    if (!((p - place(at)).dot(place(next) - place(at - 1)) > 0.0)) break;
    if (at + 1 < n) {
      ++at;
    } else if (closed_) {
      seam = (p - place(0)).dot(place(1) - place(0));
      if (seam <= 0.0) break;
      at = 1;
    } else {
      break;
    }
  }
  // And back while it lies behind the mitre at the step's start.
  for (std::size_t steps = 0; steps < 2 * n; ++steps) {
    const std::size_t before = at > 1 ? at - 2 : 0;
    if (!((p - place(at - 1)).dot(place(at) - place(before)) < 0.0)) break;
    if (at > 1) {
      --at;
    } else if (closed_ && seam == 0.0) {
      seam = (p - place(n - 1)).dot(place(n - 1) - place(n - 2));
      if (seam >= 0.0) break;
      at = n - 1;
    } else {
      break;
    }
  }
  return at;
}

Vector2d CrgRoad::coordinates(double x, double y) const {
  const std::size_t n = x_.size(), at = nearest_step(x, y);
  const Vector2d p(x, y);
  const auto place = [&](std::size_t i) { return Vector2d(x_[i], y_[i]); };
  const Vector2d p0 = place(at > 1 ? at - 2 : 0), p1 = place(at - 1), p2 = place(at),
                 p3 = place(std::min(at + 1, n - 1));
  const Vector2d step = p2 - p1;
  const double v = cross(step, p - p1) / step.norm();
  const double ta = (p2 - p0).dot(p - p1) / (p2 - p0).dot(step);
  const double tb = (p3 - p1).dot(p2 - p) / (p3 - p1).dot(step);
  const double u = first_u_ + (static_cast<double>(at - 1) + ta / (ta + tb)) * increment_;
  const auto straight = [&](double from_u, double from_x, double from_y, double phi) {
    const Vector2d ahead(std::cos(phi), std::sin(phi)), d = p - Vector2d(from_x, from_y);
    return Vector2d(from_u + d.dot(ahead), cross(ahead, d));
  };
  // The C reader asks BORDER_MODE_U = 1 here for what REFLINE_CONTINUATION = 1 means.
  if (closed_ && options_.border_u == CrgBorder::kZero) {
    if (u > close_max_) return straight(first_u_, first_x_, first_y_, first_phi_);
    if (u < close_min_) return straight(last_u_, last_x_, last_y_, last_phi_);
    return {u, v};
  }
  if (u < first_u_) return straight(first_u_, first_x_, first_y_, first_phi_);
  if (u > last_u_) return straight(last_u_, last_x_, last_y_, last_phi_);
  return {u, v};
}

double CrgRoad::heading(double u) const {
  u = wrapped(u);
  const std::size_t n = x_.size();
  const double at = (u - first_u_) / increment_;
  const auto index = static_cast<std::size_t>(std::clamp(at, 0.0, static_cast<double>(n - 2)));
  const auto span =
      static_cast<std::size_t>(std::clamp(0.5 / increment_, 1.0, static_cast<double>(n)));
  if (span > index) return first_phi_;
  if (phi_.empty() || index + span >= n) return last_phi_;
  return phi_[index];
}

double CrgRoad::reference_height(std::size_t section) const {
  return z_.empty() ? first_z_ : z_.at(section);
}

double CrgRoad::banking(std::size_t section) const {
  return banking_.empty() ? start_banking_ : banking_.at(section);
}

double CrgRoad::node(std::size_t section, std::size_t column) const {
  return stored(section, column) + grid_offset_ + reference_height(section) +
         banking(section) * v_.at(column);
}

}  // namespace camber
