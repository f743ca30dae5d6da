#include "camber/synth/road_profile.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "camber/core/random.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegree = kPi / 180.0;
/// Vertical curves are made with at least this radius, a little above the promised 60 m.
constexpr double kSmallestRadius = 62.0;

struct KindName {
  RoadProfileKind kind;
  std::string_view name;
};
constexpr KindName kNames[] = {
    {RoadProfileKind::kSteepHill, "steep_hill"},
    {RoadProfileKind::kUphill, "uphill"},
    {RoadProfileKind::kDownhill, "downhill"},
    {RoadProfileKind::kCrest, "crest"},
    {RoadProfileKind::kSag, "sag"},
    {RoadProfileKind::kBank, "bank"},
    {RoadProfileKind::kRolling, "rolling"},
    {RoadProfileKind::kControl, "control"},
    {RoadProfileKind::kLevel, "level"},
};

void check_track(const ProfileTrack& track, const char* name, double bound) {
  double end = -std::numeric_limits<double>::infinity();
  const auto check = [&](double value) {
    if (!(std::abs(value) < bound)) {
      throw std::invalid_argument(
          fmt::format("{}: found {}, expected a magnitude below {}", name, value, bound));
    }
  };
  check(track.initial);
  for (const ProfileTrack::Change& change : track.changes) {
    check(change.value);
    if (!(change.length > 0.0) || !std::isfinite(change.start) || change.start < end) {
      throw std::invalid_argument(
          fmt::format("{}: the change at station {} has length {} and the one before ends at {}, "
                      "expected a positive length and no overlap",
                      name, change.start, change.length, end));
    }
    end = change.start + change.length;
  }
}

/// Length of a raised-cosine change of grade whose smallest vertical radius is `radius`.
/// The radius of the curve is 1 / (cos(grade) |d grade / d station|), so cos(grade) <= 1 only
/// lengthens it.
double grade_change_length(double from, double to, double radius) {
  return std::max(4.0, 0.5 * kPi * std::abs(to - from) * std::max(radius, kSmallestRadius));
}

}  // namespace

std::string_view to_string(RoadProfileKind kind) {
  for (const KindName& entry : kNames) {
    if (entry.kind == kind) return entry.name;
  }
  throw std::invalid_argument("road profile: unknown kind");
}

RoadProfileKind road_profile_kind_from_string(std::string_view word) {
  std::string known;
  for (const KindName& entry : kNames) {
    if (entry.name == word) return entry.kind;
    known += (known.empty() ? "" : ", ") + std::string(entry.name);
  }
  throw std::invalid_argument(
      fmt::format("profile: found \"{}\", expected one of {}", word, known));
}

const std::vector<RoadProfileKind>& all_road_profile_kinds() {
  static const std::vector<RoadProfileKind> all = [] {
    std::vector<RoadProfileKind> kinds;
    for (const KindName& entry : kNames) kinds.push_back(entry.kind);
    return kinds;
  }();
  return all;
}

namespace {

/// The change that has begun at a station, and the value before it; nullptr: none has.
struct LastChange {
  const ProfileTrack::Change* change = nullptr;
  double before = 0.0;
};

LastChange last_change(const ProfileTrack& track, double station) {
  const auto after =
      std::partition_point(track.changes.begin(), track.changes.end(),
                           [&](const ProfileTrack::Change& c) { return c.start < station; });
  if (after == track.changes.begin()) return {nullptr, track.initial};
  const auto last = after - 1;
  return {&*last, last == track.changes.begin() ? track.initial : (last - 1)->value};
}

}  // namespace

double ProfileTrack::value(double station) const {
  const auto [change, before] = last_change(*this, station);
  if (!change) return initial;
  const double x = (station - change->start) / change->length;
  if (x >= 1.0) return change->value;
  return before + (change->value - before) * 0.5 * (1.0 - std::cos(kPi * x));
}

double ProfileTrack::slope(double station) const {
  const auto [change, before] = last_change(*this, station);
  if (!change) return 0.0;
  const double x = (station - change->start) / change->length;
  if (x >= 1.0) return 0.0;
  return (change->value - before) * 0.5 * kPi / change->length * std::sin(kPi * x);
}

RoadProfile::RoadProfile(ProfileTrack grade, ProfileTrack bank, ProfileTrack curvature,
                         double begin, double end)
    : grade_(std::move(grade)),
      bank_(std::move(bank)),
      curvature_(std::move(curvature)),
      begin_(begin),
      end_(end) {
  if (!(begin <= 0.0) || !(end > 0.0) || !std::isfinite(begin) || !std::isfinite(end)) {
    throw std::invalid_argument(
        fmt::format("road: found stations {} to {}, expected begin <= 0 < end", begin, end));
  }
  check_track(grade_, "grade", 0.6);
  check_track(bank_, "bank", 0.3);
  check_track(curvature_, "curvature", 0.1);

  // Integrated outwards from station 0 in steps of 5 cm by Simpson's rule, so that station 0 is
  // exactly at the origin and heads along +x.
  step_ = 0.05;
  const int before = static_cast<int>(std::ceil(-begin_ / step_));
  const int after = static_cast<int>(std::ceil(end_ / step_));
  begin_ = -before * step_;
  end_ = after * step_;
  nodes_.resize(before + after + 1);
  nodes_[before] = {Eigen::Vector3d::Zero(), 0.0, 0.0};
  const auto advance = [&](const Node& from, double s, double h) {
    const auto heading_to = [&](double a) {
      return from.heading + a / 6.0 *
                                (curvature_.value(s) + 4.0 * curvature_.value(s + 0.5 * a) +
                                 curvature_.value(s + a));
    };
    const double middle = heading_to(0.5 * h), last = heading_to(h);
    const double g0 = grade_.value(s), g1 = grade_.value(s + 0.5 * h), g2 = grade_.value(s + h);
    Node to = from;
    to.heading = last;
    to.position.x() += h / 6.0 * (std::cos(from.heading) + 4.0 * std::cos(middle) + std::cos(last));
    to.position.y() += h / 6.0 * (std::sin(from.heading) + 4.0 * std::sin(middle) + std::sin(last));
    to.position.z() += h / 6.0 * (std::tan(g0) + 4.0 * std::tan(g1) + std::tan(g2));
    to.arc += h / 6.0 * (1.0 / std::cos(g0) + 4.0 / std::cos(g1) + 1.0 / std::cos(g2));
    return to;
  };
  for (int i = before; i > 0; --i) nodes_[i - 1] = advance(nodes_[i], (i - before) * step_, -step_);
  for (int i = before; i + 1 < static_cast<int>(nodes_.size()); ++i) {
    nodes_[i + 1] = advance(nodes_[i], (i - before) * step_, step_);
  }
  steps_.resize(nodes_.size());
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    const double heading = nodes_[i].heading;
    const double slope_angle = grade_.value(begin_ + static_cast<int>(i) * step_);
    steps_[i] =
        Eigen::Vector3d(std::cos(heading), std::sin(heading), std::tan(slope_angle)) * step_;
  }
}

RoadProfile RoadProfile::sample(RoadProfileKind kind, std::uint64_t seed, double begin,
                                double end) {
  const CounterRandom random(seed, 0x50524F46);
  std::uint64_t next = 0;
  const auto uniform = [&](double low, double high) { return random.uniform(next++, low, high); };
  const auto sign = [&] { return random.bits(next++) & 1u ? 1.0 : -1.0; };

  ProfileTrack grade, bank, curvature;
  double at = 0.0;
  const auto change_grade = [&](double start, double to_degrees, double radius) {
    const double from = grade.changes.empty() ? grade.initial : grade.changes.back().value;
    const double to = to_degrees * kDegree;
    const double length = grade_change_length(from, to, radius);
    grade.changes.push_back({start, length, to});
    at = start + length;
  };
  const auto gentle_curve = [&](double strongest) {
    const double start = uniform(15.0, 40.0);
    curvature.changes.push_back({start, uniform(25.0, 40.0), sign() * uniform(0.0, strongest)});
  };

  switch (kind) {
    case RoadProfileKind::kSteepHill:
      grade.initial = uniform(2.0, 4.0) * kDegree;
      change_grade(uniform(5.0, 8.0), uniform(12.0, 14.0), uniform(80.0, 100.0));
      change_grade(at + uniform(25.0, 35.0), uniform(5.0, 7.0), uniform(120.0, 200.0));
      gentle_curve(1.0 / 250.0);
      break;
    case RoadProfileKind::kUphill:
      grade.initial = uniform(-1.0, 5.0) * kDegree;
      change_grade(uniform(2.0, 12.0), uniform(8.0, 20.0), uniform(70.0, 150.0));
      gentle_curve(1.0 / 200.0);
      break;
    case RoadProfileKind::kDownhill:
      grade.initial = uniform(-4.0, 1.0) * kDegree;
      change_grade(uniform(3.0, 12.0), uniform(-16.0, -6.0), uniform(80.0, 160.0));
      gentle_curve(1.0 / 200.0);
      break;
    case RoadProfileKind::kCrest:
      grade.initial = uniform(6.0, 14.0) * kDegree;
      change_grade(uniform(0.0, 10.0), uniform(-4.0, 1.0), uniform(90.0, 200.0));
      gentle_curve(1.0 / 250.0);
      break;
    case RoadProfileKind::kSag:
      grade.initial = uniform(-12.0, -5.0) * kDegree;
      change_grade(uniform(0.0, 10.0), uniform(4.0, 10.0), uniform(75.0, 150.0));
      gentle_curve(1.0 / 250.0);
      break;
    case RoadProfileKind::kBank: {
      grade.initial = uniform(-3.0, 6.0) * kDegree;
      // The outer side is the higher one: a bend to the left has its right side up.
      const double side = sign();
      const double start = uniform(4.0, 14.0), length = uniform(20.0, 30.0);
      curvature.changes.push_back({start, length, side * uniform(1.0 / 140.0, 1.0 / 90.0)});
      bank.initial = -side * uniform(0.0, 2.0) * kDegree;
      bank.changes.push_back({start, length, -side * uniform(6.0, 10.0) * kDegree});
      break;
    }
    case RoadProfileKind::kRolling: {
      double side = sign();
      grade.initial = -side * uniform(3.0, 8.0) * kDegree;
      at = uniform(0.0, 6.0);
      for (int i = 0; i < 4; ++i) {
        change_grade(at, side * uniform(2.0, 8.0), uniform(70.0, 130.0));
        at += uniform(2.0, 10.0);
        side = -side;
      }
      bank.changes.push_back(
          {uniform(5.0, 20.0), uniform(20.0, 40.0), uniform(-4.0, 4.0) * kDegree});
      gentle_curve(1.0 / 250.0);
      break;
    }
    case RoadProfileKind::kControl:
      grade.initial = sign() * uniform(3.0, 12.0) * kDegree;
      break;
    case RoadProfileKind::kLevel:
      grade.initial = uniform(-1.5, 1.5) * kDegree;
      change_grade(uniform(0.0, 15.0), uniform(-1.8, 1.8), uniform(150.0, 800.0));
      bank.initial = uniform(-1.5, 1.5) * kDegree;
      gentle_curve(1.0 / 200.0);
      break;
  }
  return RoadProfile(std::move(grade), std::move(bank), std::move(curvature), begin, end);
}

RoadProfile RoadProfile::with_curvature(ProfileTrack curvature) const {
  return RoadProfile(grade_, bank_, std::move(curvature), begin_, end_);
}

RoadProfile::Interval RoadProfile::interval(double station) const {
  Interval out;
  out.inside = std::clamp(station, begin_, end_);
  out.beyond = station - out.inside;
  const double x = (out.inside - begin_) / step_;
  const int first = std::clamp(static_cast<int>(x), 0, static_cast<int>(nodes_.size()) - 2);
  out.first = static_cast<std::size_t>(first);
  out.share = x - first;
  return out;
}

Eigen::Vector3d RoadProfile::center(double station) const {
  const Interval at = interval(station);
  // Cubic Hermite of the position with its exact derivatives: continuous slopes between nodes.
  const double f = at.share, f2 = f * f, f3 = f2 * f;
  const Eigen::Vector3d inside =
      (2 * f3 - 3 * f2 + 1) * nodes_[at.first].position + (f3 - 2 * f2 + f) * steps_[at.first] +
      (3 * f2 - 2 * f3) * nodes_[at.first + 1].position + (f3 - f2) * steps_[at.first + 1];
  if (at.beyond == 0.0) return inside;
  const double heading = this->heading(station);
  return inside + at.beyond * Eigen::Vector3d(std::cos(heading), std::sin(heading),
                                              std::tan(grade_.value(at.inside)));
}

double RoadProfile::heading(double station) const {
  const Interval at = interval(station);
  const double from = nodes_[at.first].heading;
  return from + at.share * (nodes_[at.first + 1].heading - from);
}

double RoadProfile::arc_length(double station) const {
  const Interval at = interval(station);
  const double from = nodes_[at.first].arc;
  const double inside = from + at.share * (nodes_[at.first + 1].arc - from);
  return at.beyond == 0.0 ? inside : inside + at.beyond / std::cos(grade_.value(at.inside));
}

Eigen::Vector2d RoadProfile::locate(const Eigen::Vector2d& place, double start) const {
  double s = start, t = 0.0;
  for (int i = 0; i < 20; ++i) {
    const double heading = this->heading(s);
    const Eigen::Vector2d along(std::cos(heading), std::sin(heading));
    const Eigen::Vector2d left(-along.y(), along.x());
    const Eigen::Vector2d away = place - center(s).head<2>();
    t = left.dot(away);
    const double stretch = std::max(0.1, 1.0 - curvature_.value(s) * t);
    const double change = along.dot(away) / stretch;
    s += change;
    if (std::abs(change) < 1e-10) break;
  }
  return {s, t};
}

double RoadProfile::min_vertical_radius() const {
  double sharpest = 0.0;
  for (double s = begin_; s <= end_; s += 0.25) {
    sharpest = std::max(sharpest, std::abs(grade_.slope(s)) * std::cos(grade_.value(s)));
  }
  return sharpest > 0.0 ? 1.0 / sharpest : std::numeric_limits<double>::infinity();
}

}  // namespace camber
