#include "camber/export/smooth_line.h"

#include <fmt/format.h>

#include <Eigen/SparseCholesky>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "camber/core/median.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kSamePlace = 1e-3;           // m
constexpr std::size_t kLeastForScatter = 20;  // points
constexpr double kLongestLine = 1e5;          // m; every step along it is looked at

/// Values and second derivatives of the smoothing spline of stiffness lambda through y at t.
struct Spline {
  Eigen::MatrixXd values, bends;  // n x 2
};

Spline smooth(const std::vector<double>& t, const Eigen::MatrixXd& y, double lambda) {
  const auto n = static_cast<Eigen::Index>(t.size());
  Spline out{y, Eigen::MatrixXd::Zero(n, 2)};
  if (n < 3) return out;
  std::vector<Eigen::Triplet<double>> q, r;
  const auto step = [&](Eigen::Index i) {
    return t[static_cast<std::size_t>(i + 1)] - t[static_cast<std::size_t>(i)];
  };
  for (Eigen::Index j = 0; j + 2 < n; ++j) {
    q.emplace_back(j, j, 1.0 / step(j));
    q.emplace_back(j + 1, j, -1.0 / step(j) - 1.0 / step(j + 1));
    q.emplace_back(j + 2, j, 1.0 / step(j + 1));
    r.emplace_back(j, j, (step(j) + step(j + 1)) / 3.0);
    if (j + 3 < n) {
      r.emplace_back(j, j + 1, step(j + 1) / 6.0);
      r.emplace_back(j + 1, j, step(j + 1) / 6.0);
    }
  }
  Eigen::SparseMatrix<double> Q(n, n - 2), R(n - 2, n - 2);
  Q.setFromTriplets(q.begin(), q.end());
  R.setFromTriplets(r.begin(), r.end());
  const Eigen::SparseMatrix<double> system = R + lambda * (Q.transpose() * Q);
  const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> solver(system);
  const Eigen::MatrixXd gamma = solver.solve(Q.transpose() * y);
  out.values = y - lambda * (Q * gamma);
  out.bends.middleRows(1, n - 2) = gamma;
  return out;
}

/// Points in order that lie apart in the plan, without those whose place is not known.
std::vector<Vector3d> different_places(const std::vector<Vector3d>& points) {
  std::vector<Vector3d> kept;
  for (const Vector3d& point : points) {
    if (!point.head<2>().allFinite()) continue;
    if (kept.empty() || (point - kept.back()).head<2>().norm() > kSamePlace) kept.push_back(point);
  }
  return kept;
}

}  // namespace

double line_scatter(const std::vector<Vector3d>& points) {
  const std::vector<Vector3d> kept = different_places(points);
  if (kept.size() < kLeastForScatter) return 0.0;
  std::vector<double> t(1, 0.0);
  for (std::size_t i = 1; i < kept.size(); ++i) {
    t.push_back(t.back() + (kept[i] - kept[i - 1]).head<2>().norm());
  }
  std::vector<double> off;
  for (std::size_t i = 3; i + 3 < kept.size(); ++i) {
    const Vector2d here = kept[i].head<2>();
    const Vector2d ahead = (kept[i + 1] - kept[i - 1]).head<2>().normalized();
    Vector2d between = Vector2d::Zero();
    double variance = 1.0;  // of the distance, in those of a point
    for (std::size_t j = i - 3; j <= i + 3; ++j) {
      if (j == i) continue;
      double weight = 1.0;  // Lagrange's
      for (std::size_t m = i - 3; m <= i + 3; ++m) {
        if (m != i && m != j) weight *= (t[i] - t[m]) / (t[j] - t[m]);
      }
      between += weight * (kept[j].head<2>() - here);
      variance += weight * weight;
    }
    off.push_back(std::abs(ahead.x() * between.y() - ahead.y() * between.x()) /
                  std::sqrt(variance));
  }
  return kSigmaFromMad * upper_median(&off);
}

SmoothLine::SmoothLine(const std::vector<Vector3d>& points, double tolerance, double before,
                       double after) {
  const std::vector<Vector3d> kept = different_places(points);
  if (kept.size() < 2) {
    throw std::invalid_argument("SmoothLine: the line has fewer than 2 different places");
  }
  const Vector2d start = kept.front().head<2>();
  std::vector<double> t;
  Eigen::MatrixXd y(static_cast<Eigen::Index>(kept.size()), 2);
  for (std::size_t i = 0; i < kept.size(); ++i) {
    t.push_back(i == 0 ? 0.0 : t.back() + (kept[i] - kept[i - 1]).head<2>().norm());
    // Map coordinates are large: relative to the start they keep their digits.
    y.row(static_cast<Eigen::Index>(i)) = (kept[i].head<2>() - start).transpose();
  }
  if (!(t.back() + before + after <= kLongestLine)) {
    throw std::invalid_argument(fmt::format("the line is {:.6g} m long, expected at most {:.0f} m",
                                            t.back() + before + after, kLongestLine));
  }
  // The stiffest spline that keeps to the points; lambda = 0 passes through them.
  Spline spline = smooth(t, y, 0.0);
  for (int k = 8; k >= -8; --k) {
    const Spline tried = smooth(t, y, std::pow(10.0, k));
    const double off = (tried.values - y).rowwise().norm().maxCoeff();
    if (!(off <= tolerance)) continue;
    spline = tried;
    deviation_ = off;
    break;
  }
  for (std::size_t i = 0; i < kept.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    knots_.push_back(t[i]);
    values_.push_back(start + spline.values.row(row).transpose());
    bends_.push_back(spline.bends.row(row).transpose());
    heights_.push_back(kept[i].z());
  }
  // A natural spline is straight at its ends: going on is one more piece.
  const auto extend = [&](bool at_end, double by) {
    if (!(by > 0.0)) return;
    const std::size_t n = knots_.size();
    const Place end = at_end ? Place{n - 2, knots_[n - 1] - knots_[n - 2]} : Place{0, 0.0};
    const Vector2d ahead = at(end, 1).normalized();
    if (at_end) {
      values_.push_back(values_.back() + by * ahead);
      knots_.push_back(knots_.back() + by);
      bends_.emplace_back(0.0, 0.0);
      heights_.push_back(heights_.back());
    } else {
      values_.insert(values_.begin(), values_.front() - by * ahead);
      knots_.insert(knots_.begin(), knots_.front() - by);
      bends_.insert(bends_.begin(), Vector2d(0.0, 0.0));
      heights_.insert(heights_.begin(), heights_.front());
    }
  };
  extend(false, before);
  extend(true, after);
  // Arc length by Simpson's rule on eight parts of each piece.
  arc_ = {0.0};
  arc_knot_ = {knots_.front()};
  for (std::size_t i = 0; i + 1 < knots_.size(); ++i) {
    const double h = (knots_[i + 1] - knots_[i]) / 8.0;
    for (int part = 0; part < 8; ++part) {
      const auto speed = [&](double share) { return at({i, (part + share) * h}, 1).norm(); };
      arc_.push_back(arc_.back() + h / 6.0 * (speed(0.0) + 4.0 * speed(0.5) + speed(1.0)));
      arc_knot_.push_back(knots_[i] + (part + 1) * h);
    }
  }
  for (std::size_t i = 0; i < knots_.size(); ++i) height_stations_.push_back(arc_[8 * i]);
}

SmoothLine::Place SmoothLine::place(double s) const {
  const auto next = std::upper_bound(arc_.begin() + 1, arc_.end() - 1, s);
  const auto i = static_cast<std::size_t>(next - arc_.begin());
  const double share = (s - arc_[i - 1]) / (arc_[i] - arc_[i - 1]);
  const double t = arc_knot_[i - 1] + share * (arc_knot_[i] - arc_knot_[i - 1]);
  Place out;
  out.piece = (i - 1) / 8;
  out.t = t - knots_[out.piece];
  return out;
}

Vector2d SmoothLine::at(const Place& place, int derivative) const {
  const std::size_t i = place.piece;
  const double h = knots_[i + 1] - knots_[i], a = place.t, b = h - place.t;
  const Vector2d &y0 = values_[i], &y1 = values_[i + 1], &m0 = bends_[i], &m1 = bends_[i + 1];
  if (derivative == 2) return (m0 * b + m1 * a) / h;
  if (derivative == 1) {
    return (y1 - y0) / h - (3.0 * b * b - h * h) / (6.0 * h) * m0 +
           (3.0 * a * a - h * h) / (6.0 * h) * m1;
  }
  return (y0 * b + y1 * a) / h + (b * b * b / h - h * b) / 6.0 * m0 +
         (a * a * a / h - h * a) / 6.0 * m1;
}

Vector2d SmoothLine::position(double s) const { return at(place(s), 0); }

double SmoothLine::heading(double s) const {
  const Vector2d d = at(place(s), 1);
  return std::atan2(d.y(), d.x());
}

double SmoothLine::curvature(double s) const {
  const Place here = place(s);
  const Vector2d d = at(here, 1), dd = at(here, 2);
  return (d.x() * dd.y() - d.y() * dd.x()) / std::pow(d.norm(), 3);
}

double SmoothLine::height(double s) const {
  if (!(s > height_stations_.front())) return heights_.front();
  const auto next = std::upper_bound(height_stations_.begin(), height_stations_.end(), s);
  if (next == height_stations_.end()) return heights_.back();
  const auto i = static_cast<std::size_t>(next - height_stations_.begin());
  const double from = height_stations_[i - 1], share = (s - from) / (height_stations_[i] - from);
  return heights_[i - 1] + share * (heights_[i] - heights_[i - 1]);
}

void SmoothLine::set_heights(std::vector<double> stations, std::vector<double> heights) {
  height_stations_ = std::move(stations);
  heights_ = std::move(heights);
}

}  // namespace camber
