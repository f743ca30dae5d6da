#include "camber/synth/detail/drive_road.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/synth/detail/sequence.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegree = kPi / 180.0;
constexpr double kWidestHeading = 75.0 * kDegree;

double log_uniform(Sequence* random, double low, double high) {
  return std::exp(random->uniform(std::log(low), std::log(high)));
}

/// Draws bends in plan, with the banks that go with them.
class PlanDrawer {
 public:
  PlanDrawer(Sequence* random, double speed) : random_(random), speed_(speed) {
    crossfall_ = random->uniform(-0.5, 0.5) * kDegree;
    bank.initial = crossfall_;
  }

  void draw(double length) {
    double s = random_->uniform(15.0, 45.0);
    while (s < length) {
      const double kind = random_->uniform(0.0, 1.0);
      const double corners = std::clamp(0.35 - 0.02 * speed_, 0.0, 0.2);  // seldom on fast roads
      if (kind < corners) {
        s = bend(s, random_->uniform(13.0, 22.0), random_->uniform(55.0, 95.0), 6.0);
      } else if (kind < 0.7) {
        const double least = std::clamp(0.35 * speed_ * speed_, 40.0, 400.0);
        s = bend(s, log_uniform(random_, least, 8.0 * least), random_->uniform(8.0, 60.0), 15.0);
      }
      s += random_->uniform(15.0, 90.0);
    }
  }

  ProfileTrack curvature, bank;

 private:
  /// @param ramp  m over which the curvature begins and ends; @return the end's station
  double bend(double start, double radius, double degrees, double ramp) {
    double sign = random_->sign();
    const double turn = degrees * kDegree;
    const double super = random_->uniform(0.5, 1.0);
    if (std::abs(heading_ + sign * turn) > kWidestHeading) sign = -sign;
    const double most = kWidestHeading - sign * heading_;  // > 0: on that side
    const double angle = std::min(turn, most);
    // The ramps turn by half of what a circle as long would.
    const double hold = angle * radius - ramp;
    if (hold < 1.0) return start;
    curvature.changes.push_back({start, ramp, sign / radius});
    curvature.changes.push_back({start + ramp + hold, ramp, 0.0});
    heading_ += sign * angle;
    // The outer side is the higher one.
    const double tilt = super * std::clamp(250.0 / radius, 0.5, 4.5) * kDegree;
    const double banked = crossfall_ - sign * (radius < 30.0 ? 0.3 : 1.0) * tilt;
    bank.changes.push_back({start, ramp, banked});
    bank.changes.push_back({start + ramp + hold, ramp, crossfall_});
    return start + 2.0 * ramp + hold;
  }

  Sequence* random_;
  double speed_, crossfall_ = 0.0, heading_ = 0.0;
};

ProfileTrack draw_grades(Sequence* random, double length, double speed) {
  const double hilliness = log_uniform(random, 1.0, 7.0);  // degrees
  ProfileTrack out;
  const auto draw = [&] { return std::clamp(hilliness * random->normal(), -14.0, 14.0) * kDegree; };
  out.initial = 0.5 * draw();
  double s = random->uniform(0.0, 30.0);
  while (s < length + kDriveBeyond) {
    const double before = out.changes.empty() ? out.initial : out.changes.back().value;
    const double after = draw();
    // No more than 1.5 m/s^2 up or down.
    const double radius = std::max(log_uniform(random, 90.0, 700.0), speed * speed / 1.5);
    const double change = std::max(6.0, 0.5 * kPi * std::abs(after - before) * radius);
    out.changes.push_back({s, change, after});
    s += change + random->uniform(5.0, 120.0);
  }
  return out;
}

/// A number at whole metres, smoothed by a normal distribution; the ends go on straight.
std::vector<double> smoothed(const std::vector<double>& values, double sigma) {
  const int reach = static_cast<int>(std::ceil(3.0 * sigma));
  const int last = static_cast<int>(values.size()) - 1;
  const auto at = [&](int i) {
    if (i < 0) return 2.0 * values.front() - values[std::min(last, -i)];
    if (i > last) return 2.0 * values.back() - values[std::max(0, 2 * last - i)];
    return values[i];
  };
  std::vector<double> out(values.size());
  for (int i = 0; i <= last; ++i) {
    double sum = 0.0, weights = 0.0;
    for (int k = -reach; k <= reach; ++k) {
      const double weight = std::exp(-0.5 * k * k / (sigma * sigma));
      sum += weight * at(i + k);
      weights += weight;
    }
    out[i] = sum / weights;
  }
  return out;
}

/// Linear between the places of an ascending list.
double interpolated(const std::vector<double>& places, const std::vector<double>& values,
                    double at) {
  const auto after = std::upper_bound(places.begin(), places.end(), at);
  if (after == places.begin()) return values.front();
  if (after == places.end()) return values.back();
  const auto i = static_cast<std::size_t>(after - places.begin());
  const double share = (at - places[i - 1]) / (places[i] - places[i - 1]);
  return values[i - 1] + share * (values[i] - values[i - 1]);
}

/// A track through given values every `step` metres.
ProfileTrack track_through(const std::vector<double>& values, double step) {
  ProfileTrack out;
  out.initial = values.front();
  for (std::size_t i = 1; i < values.size(); ++i) {
    out.changes.push_back({static_cast<double>(i - 1) * step, step, values[i]});
  }
  return out;
}

}  // namespace

RoadProfile draw_drive_road(std::uint64_t seed, double length, double speed) {
  Sequence random(seed, 0x44524956);
  PlanDrawer plan(&random, speed);
  plan.draw(length);
  return RoadProfile(draw_grades(&random, length, speed), std::move(plan.bank),
                     std::move(plan.curvature), -kDriveBefore, length + kDriveBeyond);
}

FollowedRoad follow_path(const std::vector<SE3>& poses, double lane) {
  constexpr double kLeastStep = 0.25;  // m: shorter ones are noise
  constexpr double kSmoothing = 3.0;   // m
  constexpr double kNodes = 4.0;       // m between nodes of grade and curvature
  constexpr double kTightest = 1.0 / 11.0, kSteepest = 0.6;  // 1/m, rad
  // World of the first camera turned to x ahead, y left, z up.
  std::vector<Eigen::Vector3d> places;
  for (const SE3& pose : poses) {
    const Eigen::Vector3d p = poses.front().inverse() * pose.translation();
    places.emplace_back(p.z(), -p.x(), -p.y());
  }
  std::vector<double> frame_arc, arcs{0.0}, x{0.0}, y{0.0}, z{0.0};
  Eigen::Vector3d node = places.front();
  for (const Eigen::Vector3d& p : places) {
    const double away = (p - node).head<2>().norm();
    frame_arc.push_back(arcs.back() + away);
    if (away < kLeastStep) continue;
    arcs.push_back(arcs.back() + away);
    x.push_back(p.x());
    y.push_back(p.y());
    z.push_back(p.z());
    node = p;
  }
  const double length = arcs.back();
  if (length < 5.0) {
    throw NoAnswerError(fmt::format("path: found {:.1f} m, expected at least 5 m", length));
  }
  std::vector<double> even[3], metres;
  for (double a = 0.0; a <= length; a += 1.0) {
    metres.push_back(a);
    even[0].push_back(interpolated(arcs, x, a));
    even[1].push_back(interpolated(arcs, y, a));
    even[2].push_back(interpolated(arcs, z, a));
  }
  for (auto& coordinate : even) coordinate = smoothed(coordinate, kSmoothing);
  const std::size_t count = metres.size();
  // From the lane to the road's centreline.
  std::vector<Eigen::Vector2d> shifts;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t a = i > 0 ? i - 1 : 0, b = std::min(i + 1, count - 1);
    const Eigen::Vector2d along =
        Eigen::Vector2d(even[0][b] - even[0][a], even[1][b] - even[1][a]).normalized();
    shifts.emplace_back(lane * along.y(), -lane * along.x());
  }
  for (std::size_t i = 0; i < count; ++i) {
    even[0][i] += shifts[i].x();
    even[1][i] += shifts[i].y();
  }
  std::vector<double> stations{0.0}, headings, grades;
  for (std::size_t i = 0; i + 1 < count; ++i) {
    const double dx = even[0][i + 1] - even[0][i], dy = even[1][i + 1] - even[1][i];
    const double step = std::hypot(dx, dy);
    stations.push_back(stations.back() + step);
    double heading = std::atan2(dy, dx);
    if (!headings.empty()) {
      heading = headings.back() + std::remainder(heading - headings.back(), 2.0 * kPi);
    }
    headings.push_back(heading);
    grades.push_back(std::atan2(even[2][i + 1] - even[2][i], std::max(step, 1e-6)));
  }
  std::vector<double> middles;
  for (std::size_t i = 0; i + 1 < count; ++i) {
    middles.push_back(0.5 * (stations[i] + stations[i + 1]));
  }
  std::vector<double> node_curvature, node_grade;
  for (double s = 0.0; s <= stations.back() + kNodes; s += kNodes) {
    const double turn = interpolated(middles, headings, s + 0.5 * kNodes) -
                        interpolated(middles, headings, s - 0.5 * kNodes);
    node_curvature.push_back(std::clamp(turn / kNodes, -kTightest, kTightest));
    const double grade = interpolated(middles, grades, s);
    if (!(std::abs(grade) < kSteepest)) {
      throw std::invalid_argument(
          fmt::format("path: found a grade of {:.2f} rad, expected less than 0.6", grade));
    }
    node_grade.push_back(grade);
  }
  node_curvature.push_back(0.0);
  node_grade.push_back(0.0);
  FollowedRoad out{
      RoadProfile(track_through(node_grade, kNodes), {}, track_through(node_curvature, kNodes),
                  -kDriveBefore, stations.back() + kDriveBeyond),
      {}};
  for (const double arc : frame_arc) {
    out.stations.push_back(interpolated(metres, stations, std::min(arc, length)));
  }
  return out;
}

}  // namespace camber
