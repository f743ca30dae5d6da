// Fits an OpenDRIVE road to the ground beside a line; opendrive_file.cpp writes it.

#include "camber/export/opendrive.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/export/crg_strip.h"
#include "camber/export/detail/series.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kStationStep = 0.5;        // m along, of the samples
constexpr double kAcrossStep = 0.25;        // m
constexpr double kPlanTolerance = 0.005;    // m, of a piece of the plan view
constexpr double kStraight = 1e-9;          // rad, of a piece that is written as a line
constexpr double kHeightTolerance = 0.003;  // m, of the elevation's records
constexpr double kLeastLane = 0.25;         // m

Vector2d direction(double heading) { return {std::cos(heading), std::sin(heading)}; }

PlanPiece make_piece(const SmoothLine& line, double from, double to) {
  PlanPiece piece;
  const Vector2d start = line.position(from), end = line.position(to);
  piece.x = start.x();
  piece.y = start.y();
  piece.heading = line.heading(from);
  const double c = std::cos(piece.heading), s = std::sin(piece.heading), l = to - from;
  const Vector2d d = end - start, local(c * d.x() + s * d.y(), -s * d.x() + c * d.y());
  const double turn = std::remainder(line.heading(to) - piece.heading, 2.0 * M_PI);
  piece.straight = std::abs(turn) < kStraight && std::abs(local.y()) < kStraight * l;
  // Hermite: ends and tangents are those of the line, speed its length.
  const Vector2d out = l * direction(turn);
  piece.u[1] = l;
  piece.u[2] = 3.0 * local.x() - 2.0 * l - out.x();
  piece.u[3] = -2.0 * local.x() + l + out.x();
  piece.v[2] = 3.0 * local.y() - out.y();
  piece.v[3] = -2.0 * local.y() + out.y();
  // Gauss-Legendre, five points on each of eight parts.
  constexpr double kAt[5] = {0.0, 0.5384693101056831, -0.5384693101056831, 0.9061798459386640,
                             -0.9061798459386640};
  constexpr double kWeight[5] = {0.5688888888888889, 0.4786286704993665, 0.4786286704993665,
                                 0.2369268850561891, 0.2369268850561891};
  for (int part = 0; part < 8; ++part) {
    for (int k = 0; k < 5; ++k) {
      piece.length += kWeight[k] / 16.0 * piece.direction((part + 0.5 + 0.5 * kAt[k]) / 8.0).norm();
    }
  }
  return piece;
}

double piece_deviation(const PlanPiece& piece, const SmoothLine& line, double from, double to) {
  double most = 0.0;
  for (double p = 0.1; p < 0.95; p += 0.1) {
    most = std::max(most, (piece.at(p) - line.position(from + p * (to - from))).norm());
  }
  return most;
}

/// Pieces as long as the tolerance allows, at most 50 m, each half of one that is too long.
void lay_plan(const SmoothLine& line, double from, double to, OpenDriveRoad* road) {
  const PlanPiece piece = make_piece(line, from, to);
  const double off = piece_deviation(piece, line, from, to);
  const double bend = std::abs(piece.length / (to - from) - 1.0);
  if ((off > kPlanTolerance || bend > 1e-3 || to - from > 50.0) && to - from > 0.2) {
    lay_plan(line, from, 0.5 * (from + to), road);
    lay_plan(line, 0.5 * (from + to), to, road);
    return;
  }
  road->plan.push_back(piece);
  road->plan.back().s = road->length;
  road->length += piece.length;
  road->line_deviation = std::max(road->line_deviation, off);
}

/// The line's own station of the road's s: pieces differ from it by less than a thousandth.
std::vector<double> line_stations(const OpenDriveRoad& road, const SmoothLine& line,
                                  const std::vector<double>& stations) {
  const double share = line.length() / road.length;
  std::vector<double> out;
  for (const double s : stations) out.push_back(std::min(s * share, line.length()));
  return out;
}

/// z = middle + left v (v > 0), middle + right v (v < 0) at one station; NaN: not known.
struct CrossSection {
  double middle = kNaN, left = kNaN, right = kNaN;
};

CrossSection fit_section(const std::vector<Vector2d>& seen) {
  CrossSection out;
  if (seen.size() < 3) return out;
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Vector3d vector = Vector3d::Zero();
  const double middle = seen[seen.size() / 2].y();
  double low = 0.0, high = 0.0;
  for (const Vector2d& p : seen) {
    const Vector3d row(1.0, std::max(p.x(), 0.0), std::min(p.x(), 0.0));
    information += row * row.transpose();
    vector += (p.y() - middle) * row;
    low = std::min(low, p.x());
    high = std::max(high, p.x());
  }
  // Both sides go the same way as far as one of them is too narrow to measure.
  const double tie = 1e-3 * static_cast<double>(seen.size());
  const Vector3d same(0.0, 1.0, -1.0);
  information += tie * same * same.transpose();
  if (high - low < 1.0) return out;
  const Vector3d fit = information.ldlt().solve(vector);
  out.middle = middle + fit[0];
  out.left = fit[1];
  out.right = fit[2];
  return out;
}

/// Cubics through values at stations, equal in value and slope where they meet; nodes as far apart
/// as the tolerance allows.
std::vector<CubicRecord> cubics(const std::vector<double>& stations,
                                const std::vector<double>& values, double tolerance) {
  const std::size_t last = stations.size() - 1;
  for (std::size_t every = 32;; every /= 2) {
    std::vector<std::size_t> nodes;
    for (std::size_t i = 0; i < last; i += every) nodes.push_back(i);
    nodes.push_back(last);
    const auto slope = [&](std::size_t i) {
      const std::size_t a = i == 0 ? 0 : i - 1, b = std::min(i + 1, last);
      return (values[b] - values[a]) / (stations[b] - stations[a]);
    };
    std::vector<CubicRecord> records;
    double off = 0.0;
    for (std::size_t k = 0; k + 1 < nodes.size(); ++k) {
      const std::size_t i = nodes[k], j = nodes[k + 1];
      const double h = stations[j] - stations[i], rise = values[j] - values[i];
      const double m0 = slope(i), m1 = slope(j);
      records.push_back({stations[i], values[i], m0, (3.0 * rise / h - 2.0 * m0 - m1) / h,
                         (m0 + m1 - 2.0 * rise / h) / (h * h)});
      for (std::size_t n = i; n <= j; ++n) {
        off = std::max(off, std::abs(records.back().value(stations[n]) - values[n]));
      }
    }
    if (off <= tolerance || every == 1) return records;
  }
}

const CubicRecord& record_at(const std::vector<CubicRecord>& records, double s) {
  std::size_t i = 0;
  while (i + 1 < records.size() && records[i + 1].s <= s) ++i;
  return records[i];
}

std::vector<CubicRecord> straight_records(const std::vector<double>& stations,
                                          const std::vector<double>& values) {
  std::vector<CubicRecord> records;
  for (std::size_t i = 0; i + 1 < stations.size(); ++i) {
    records.push_back({stations[i], values[i],
                       (values[i + 1] - values[i]) / (stations[i + 1] - stations[i]), 0.0, 0.0});
  }
  return records;
}

/// Samples of the ground across each station of the line: (v, height).
std::vector<std::vector<Vector2d>> look_across(const HeightSource& ground, const SmoothLine& line,
                                               const std::vector<double>& at,
                                               const std::vector<double>& left,
                                               const std::vector<double>& right, int num_threads) {
  std::vector<std::vector<Vector2d>> seen(at.size());
  parallel_for(at.size(), num_threads, [&](std::size_t i) {
    const Vector2d foot = line.position(at[i]), ahead = direction(line.heading(at[i]));
    const Vector2d aside(-ahead.y(), ahead.x());
    for (double v = -right[i]; v <= left[i] + 1e-9; v += kAcrossStep) {
      const Vector2d place = foot + v * aside;
      const double z = ground.at({place.x(), place.y(), line.height(at[i])}).height;
      if (std::isfinite(z)) seen[i].emplace_back(v, z);
    }
  });
  return seen;
}

/// Elevation, superelevation and the lanes' outer heights.
void raise_road(const std::vector<double>& stations, const std::vector<std::vector<Vector2d>>& seen,
                const std::vector<double>& left, const std::vector<double>& right, double smoothing,
                OpenDriveRoad* road) {
  std::vector<double> middle, left_slope, right_slope;
  for (const std::vector<Vector2d>& section : seen) {
    const CrossSection fit = fit_section(section);
    middle.push_back(fit.middle);
    left_slope.push_back(fit.left);
    right_slope.push_back(fit.right);
  }
  const auto half = static_cast<std::size_t>(0.5 * smoothing / kStationStep);
  for (std::vector<double>* series : {&middle, &left_slope, &right_slope}) {
    detail::bridge(series);
    *series = detail::smoothed(*series, half);
  }
  road->elevation = cubics(stations, middle, kHeightTolerance);
  std::vector<double> tilt, left_height, right_height;
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const double grade = record_at(road->elevation, stations[i]).slope(stations[i]);
    const double across = 0.5 * (left_slope[i] + right_slope[i]);
    // Across a line that climbs, the tilt theta about it gives the slope tan(theta) sqrt(1 + g^2).
    tilt.push_back(std::atan(across / std::sqrt(1.0 + grade * grade)));
    left_height.push_back((left_slope[i] - across) * left[i]);
    right_height.push_back(-(right_slope[i] - across) * right[i]);
  }
  road->superelevation = cubics(stations, tilt, 0.0005);
  road->left_height = straight_records(stations, left_height);
  road->right_height = straight_records(stations, right_height);
}

void measure_errors(const std::vector<double>& stations,
                    const std::vector<std::vector<Vector2d>>& seen, const std::vector<double>& left,
                    const std::vector<double>& right, OpenDriveRoad* road) {
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const double s = stations[i];
    const CubicRecord& level = record_at(road->elevation, s);
    const double grade = level.slope(s);
    const double across =
        std::tan(record_at(road->superelevation, s).value(s)) * std::sqrt(1.0 + grade * grade);
    for (const Vector2d& p : seen[i]) {
      const bool on_left = p.x() > 0.0;
      const double outer = record_at(on_left ? road->left_height : road->right_height, s).value(s);
      const double share = std::abs(p.x()) / (on_left ? left[i] : right[i]);
      const double off = level.value(s) + across * p.x() + outer * share - p.y();
      sum += off * off;
      ++count;
      road->height_most = std::max(road->height_most, std::abs(off));
    }
  }
  road->height_rms = count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0.0;
}

}  // namespace

void RoadsideVehicle::set_axes(const Vector3d& front, const Vector3d& up) {
  const Vector3d left = up.cross(front);
  heading = std::atan2(front.y(), front.x());
  pitch = std::asin(std::clamp(-front.z(), -1.0, 1.0));
  roll = std::atan2(left.z(), up.z());
}

void OpenDriveOptions::validate() const {
  const auto require = [](bool good, const char* field, double value, const char* bound) {
    if (!good) {
      throw std::invalid_argument(
          fmt::format("OpenDriveOptions::{} is {}, expected {}", field, value, bound));
    }
  };
  require(left >= 0.0 && left <= 1000.0, "left", left, "0 to 1000 m");
  require(right >= 0.0 && right <= 1000.0, "right", right, "0 to 1000 m");
  require(widest > 0.0 && widest <= 1000.0, "widest", widest, "> 0, at most 1000 m");
  require(smoothing >= 0.0 && std::isfinite(smoothing), "smoothing", smoothing, ">= 0 m");
}

double CubicRecord::value(double at) const {
  const double t = at - s;
  return a + t * (b + t * (c + t * d));
}

double CubicRecord::slope(double at) const {
  const double t = at - s;
  return b + t * (2.0 * c + t * 3.0 * d);
}

Vector2d PlanPiece::at(double p) const {
  const double du = p * (u[1] + p * (u[2] + p * u[3])), dv = p * (v[1] + p * (v[2] + p * v[3]));
  const double cosine = std::cos(heading), sine = std::sin(heading);
  return {x + cosine * du - sine * dv, y + sine * du + cosine * dv};
}

Vector2d PlanPiece::direction(double p) const {
  const double du = u[1] + p * (2.0 * u[2] + p * 3.0 * u[3]);
  const double dv = v[1] + p * (2.0 * v[2] + p * 3.0 * v[3]);
  const double cosine = std::cos(heading), sine = std::sin(heading);
  return {cosine * du - sine * dv, sine * du + cosine * dv};
}

OpenDriveRoad make_opendrive(const HeightSource& ground, const SmoothLine& line,
                             const OpenDriveOptions& options) {
  options.validate();
  if (line.length() < 2.0 * kStationStep) {
    throw NoAnswerError(fmt::format("the line is {:.3g} m long, expected at least {} m",
                                    line.length(), 2.0 * kStationStep));
  }
  OpenDriveRoad road;
  road.name = options.name;
  road.geo_reference = options.geo_reference;
  road.crg_file = options.crg_file;
  road.vehicles = options.vehicles;
  lay_plan(line, 0.0, line.length(), &road);
  const auto steps = static_cast<std::size_t>(std::ceil(road.length / kStationStep - 1e-9));
  std::vector<double> stations;
  for (std::size_t i = 0; i <= steps; ++i) {
    stations.push_back(road.length * static_cast<double>(i) / static_cast<double>(steps));
  }
  const std::vector<double> at = line_stations(road, line, stations);
  SeenWidth width = seen_width(ground, line, line.length() / static_cast<double>(steps),
                               options.widest, options.num_threads);
  width.left.resize(stations.size(), width.left.back());
  width.right.resize(stations.size(), width.right.back());
  const auto settle = [&](std::vector<double>* side, double given) {
    const double most = *std::max_element(side->begin(), side->end());
    // A lane does not end in every gap of what is seen.
    for (double& w : *side) w = w < kLeastLane ? kNaN : w;
    detail::bridge(side);
    *side = detail::smoothed(*side, static_cast<std::size_t>(2.0 / kStationStep));
    for (double& w : *side)
      w = given > 0.0 ? given : std::clamp(w, kLeastLane, std::max(most, kLeastLane));
  };
  settle(&width.left, options.left);
  settle(&width.right, options.right);
  const auto seen = look_across(ground, line, at, width.left, width.right, options.num_threads);
  if (std::none_of(seen.begin(), seen.end(), [](const auto& s) { return s.size() >= 3; })) {
    throw NoAnswerError("no ground is seen beside the line");
  }
  raise_road(stations, seen, width.left, width.right, options.smoothing, &road);
  road.left_width = straight_records(stations, width.left);
  road.right_width = straight_records(stations, width.right);
  measure_errors(stations, seen, width.left, width.right, &road);
  return road;
}

}  // namespace camber
