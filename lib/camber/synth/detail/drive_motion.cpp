#include "camber/synth/detail/drive_motion.h"

#include <algorithm>
#include <cmath>

#include "camber/synth/detail/noise.h"
#include "camber/synth/detail/sequence.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kSubsteps = 20.0;  // a frame

/// Pitch of a body on its springs: a damped oscillator after the acceleration along the road.
class PitchSprings {
 public:
  double step(double acceleration, double dt) {
    constexpr double kGain = 0.0029;                // rad a m/s^2: half a degree at 3 m/s^2
    constexpr double kFrequency = 2.0 * kPi * 1.2;  // rad/s
    constexpr double kDamping = 0.5;
    const double force = kFrequency * kFrequency * (kGain * acceleration - pitch_) -
                         2.0 * kDamping * kFrequency * rate_;
    rate_ += dt * force;
    pitch_ += dt * rate_;
    return pitch_;
  }

 private:
  double pitch_ = 0.0, rate_ = 0.0;
};

struct Standstill {
  double station = 0.0, seconds = 0.0;
};

/// The fastest speed along the road, one value a half metre from station 0 on.
class SpeedLimits {
 public:
  static constexpr double kStep = 0.5;

  SpeedLimits(const RoadProfile& road, double speed, double length,
              const std::vector<Standstill>& stops, Sequence* random) {
    constexpr double kAcross = 2.2, kFaster = 1.5;  // m/s^2
    const auto count = static_cast<std::size_t>(length / kStep) + 2;
    double factor = 1.0, until = 0.0;
    std::size_t stop = 0;
    std::vector<double> braking(count);
    double brake = 2.0;
    for (std::size_t i = 0; i < count; ++i) {
      const double s = kStep * static_cast<double>(i);
      if (s >= until) {
        factor = random->uniform(0.65, 1.2);
        until = s + random->uniform(40.0, 200.0);
        brake = random->uniform(2.0, 4.0);
      }
      const double curvature = std::abs(road.curvature(s));
      double most = factor * speed;
      if (curvature > 1e-6) most = std::min(most, std::sqrt(kAcross / curvature));
      if (stop < stops.size() && s >= stops[stop].station) {
        most = kCreep;
        ++stop;
      }
      speeds_.push_back(most);
      braking[i] = brake;
    }
    for (std::size_t i = count - 1; i-- > 0;) {
      speeds_[i] = std::min(speeds_[i],
                            std::sqrt(speeds_[i + 1] * speeds_[i + 1] + 2.0 * braking[i] * kStep));
    }
    for (std::size_t i = 1; i < count; ++i) {
      speeds_[i] =
          std::min(speeds_[i], std::sqrt(speeds_[i - 1] * speeds_[i - 1] + 2.0 * kFaster * kStep));
    }
  }

  double at(double station) const {
    const double x = std::clamp(station / kStep, 0.0, static_cast<double>(speeds_.size()) - 1.001);
    const auto i = static_cast<std::size_t>(x);
    // Evenly faster or slower: the square of the speed is linear in the distance.
    const double share = x - static_cast<double>(i);
    return std::sqrt((1.0 - share) * speeds_[i] * speeds_[i] +
                     share * speeds_[i + 1] * speeds_[i + 1]);
  }

  static constexpr double kCreep = 0.3;  // m/s, at a standstill's place

 private:
  std::vector<double> speeds_;
};

/// @param seconds  of the whole drive: a quarter of it at most is stood in one place
std::vector<Standstill> draw_standstills(int count, double length, double seconds,
                                         Sequence* random) {
  std::vector<Standstill> out;
  for (int i = 0; i < count; ++i) {
    const double place = length * (i + random->uniform(0.15, 0.85)) / count;
    const double longest = random->chance(0.3) ? 10.0 : 4.0;
    out.push_back({place, std::min(random->uniform(1.5, longest), 0.25 * seconds)});
  }
  return out;
}

}  // namespace

std::vector<DriveState> drive_along(const RoadProfile& road, const DriveMotionOptions& options) {
  Sequence random(options.seed, 0x4D4F5649);
  const double seconds = (options.num_frames - 1) / options.frame_rate;
  const double length = std::max(10.0, road.end() - 300.0);
  // Standstills where the drive will surely come by.
  const double expected = std::max(5.0, 0.45 * options.speed * seconds);
  const std::vector<Standstill> stops =
      draw_standstills(options.standstills, std::min(expected, length), seconds, &random);
  const SpeedLimits limits(road, options.speed, length, stops, &random);
  const double dt = 1.0 / (options.frame_rate * kSubsteps);
  std::vector<DriveState> out;
  PitchSprings springs;
  double station = 0.0, speed = limits.at(0.0), waiting = 0.0, pitch = 0.0;
  std::size_t stop = 0;
  for (int frame = 0; frame < options.num_frames; ++frame) {
    out.push_back({station, speed, pitch});
    for (int i = 0; i < static_cast<int>(kSubsteps); ++i) {
      const double before = speed;
      if (waiting > 0.0) {
        waiting -= dt;
        speed = 0.0;
      } else if (stop < stops.size() && station >= stops[stop].station) {
        waiting = stops[stop++].seconds;
        speed = 0.0;
      } else {
        speed = std::min(limits.at(station), before + 1.5 * dt + (before == 0.0 ? 0.05 : 0.0));
      }
      station = std::min(station + speed * dt * std::cos(road.grade(station)), length);
      // A stop from creeping is no jerk that springs would know.
      const double acceleration = std::clamp((speed - before) / dt, -4.0, 3.0);
      pitch = springs.step(acceleration, dt);
    }
  }
  return out;
}

std::vector<DriveState> drive_by_stations(const std::vector<double>& stations, double frame_rate) {
  std::vector<DriveState> out;
  PitchSprings springs;
  double pitch = 0.0, before = 0.0;
  for (std::size_t i = 0; i < stations.size(); ++i) {
    const std::size_t a = i > 0 ? i - 1 : 0, b = std::min(i + 1, stations.size() - 1);
    const double speed =
        b > a ? (stations[b] - stations[a]) * frame_rate / static_cast<double>(b - a) : 0.0;
    const double acceleration = i > 0 ? std::clamp((speed - before) * frame_rate, -4.0, 3.0) : 0.0;
    before = speed;
    out.push_back({stations[i], speed, pitch});
    for (int k = 0; k < static_cast<int>(kSubsteps); ++k) {
      pitch = springs.step(acceleration, 1.0 / (frame_rate * kSubsteps));
    }
  }
  return out;
}

double lane_offset(double station, double lane, std::uint64_t seed) {
  const auto s = static_cast<float>(station);
  return lane + 0.5 * gradient_noise({s / 45.0f, 0.5f}, static_cast<std::uint32_t>(seed) + 51u);
}

}  // namespace camber
