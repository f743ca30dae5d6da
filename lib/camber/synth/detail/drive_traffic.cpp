#include "camber/synth/detail/drive_traffic.h"

#include <algorithm>
#include <cmath>

#include "camber/synth/detail/noise.h"
#include "camber/synth/detail/traffic.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegree = kPi / 180.0;
constexpr double kAhead = 115.0, kBehind = 12.0;  // m of station in which cars are there

enum class Driving { kParked, kOncoming, kAheadOfCamera };

struct DriveCar {
  Driving driving = Driving::kParked;
  double station = 0.0;  ///< parked: its own; oncoming: at frame 0; ahead: where it is closest from
  double offset = 0.0, heading = 0.0;  ///< heading relative to the road's
  GroundKind ground = GroundKind::kRoad;
  // Of a car ahead: gap over the camera's station.
  double gap = 0.0, closing = 0.0, following = 0.0;
};

double smooth(double x) {
  const double t = std::clamp(x, 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

}  // namespace

struct DriveTraffic::Impl {
  const RoadModel& road;
  const std::vector<DriveState>& states;
  double frame_rate, lane, oncoming_speed = 0.0;
  std::uint64_t seed;
  std::vector<DriveCar> cars;

  CarModel model(std::size_t i) const { return sample_car(CounterRandom(seed, 0x44434152), i); }
  double last_station() const { return states.back().station; }

  /// Of a car at a frame; false where it is out of sight.
  bool pose_at(const DriveCar& car, int frame, double* station) const {
    const double ego = states[static_cast<std::size_t>(frame)].station;
    switch (car.driving) {
      case Driving::kParked:
        *station = car.station;
        break;
      case Driving::kOncoming:
        *station = car.station - oncoming_speed * frame / frame_rate;
        break;
      case Driving::kAheadOfCamera: {
        // Caught up with from 130 m on, lost again: slower than the camera by less than half.
        const double driven = ego - car.station;
        const double away = 130.0 - car.gap, run = 3.0 * away;
        const double before = smooth((run - driven) / run);
        const double after = smooth((driven - run - car.following) / run);
        *station = ego + car.gap + away * std::max(before, after);
        break;
      }
    }
    return *station > ego - kBehind && *station < ego + kAhead;
  }

  PathPose pose_of(const DriveCar& car, double station) const {
    PathPose pose;
    double offset = car.offset;
    if (car.driving == Driving::kAheadOfCamera) offset = lane_offset(station, lane, seed + 7);
    pose.place = road.place(station, offset);
    pose.heading = road.profile().heading(station) + car.heading;
    pose.station = station;
    return pose;
  }
};

DriveTraffic::~DriveTraffic() = default;

DriveTraffic::DriveTraffic(const RoadModel& road, const std::vector<DriveState>& states,
                           double frame_rate, double lane, double density, std::uint64_t seed)
    : impl_(std::make_unique<Impl>(
          Impl{road, states, frame_rate, lane, 0.0, seed, std::vector<DriveCar>()})) {
  Impl& in = *impl_;
  Sequence random(seed, 0x44545246);
  const RoadLayout& layout = road.layout();
  const double last = in.last_station() + kAhead;
  double mean_speed = 0.0;
  for (const DriveState& state : states) mean_speed += state.speed / states.size();
  in.oncoming_speed = std::max(4.0, mean_speed) * random.uniform(0.7, 1.2);
  if (density <= 0.0) return;

  // Parked: rows of cars, with gaps. None in tight bends.
  for (int side = 0; side < 2; ++side) {
    const double share = random.uniform(0.2, 0.9);
    for (double s = random.uniform(5.0, 25.0); s < last;) {
      const bool there = random.chance(share);
      const double jitter = random.uniform(0.0, 0.3), turn = random.uniform(-1.5, 1.5) * kDegree;
      const bool against = random.chance(side == 0 ? 0.75 : 0.1);
      const CarModel model = in.model(in.cars.size());
      const double half = 0.5 * model.dimensions.length;
      s += half;
      double sharpest = 0.0;
      for (double x = -15.0; x <= 15.0; x += 5.0) {
        sharpest = std::max(sharpest, std::abs(road.profile().curvature(s + x)));
      }
      if (there && sharpest < 1.0 / 30.0) {
        const bool pavement = layout.pavement[side];
        const double beside = pavement ? layout.kerb_width + 0.1 : 0.35;
        DriveCar car;
        car.station = s;
        car.offset = (side == 0 ? 1.0 : -1.0) *
                     (layout.half_width + beside + 0.5 * model.dimensions.width + jitter);
        car.heading = (against ? kPi : 0.0) + turn;
        car.ground = pavement ? GroundKind::kPavement : GroundKind::kVerge;
        in.cars.push_back(car);
      }
      s += half + 0.8 + random.uniform(0.0, 1.5) +
           (random.chance(0.2) ? random.uniform(10.0, 50.0) / density : 0.0);
    }
  }
  // Cars ahead, one after the other.
  for (double s = random.uniform(-500.0, 100.0); s < last;) {
    DriveCar car;
    car.driving = Driving::kAheadOfCamera;
    car.station = s;
    car.gap = random.uniform(9.0, 28.0);
    car.following = random.uniform(20.0, 150.0);
    in.cars.push_back(car);
    s += 6.0 * (130.0 - car.gap) + car.following + random.uniform(10.0, 400.0) / density;
  }
  // Oncoming: all as fast, so that none meets another.
  const double seconds = (states.size() - 1) / frame_rate;
  for (double s = random.uniform(20.0, 120.0); s < last + in.oncoming_speed * seconds;) {
    DriveCar car;
    car.driving = Driving::kOncoming;
    car.station = s;
    car.offset = 0.5 * layout.half_width + random.uniform(-0.2, 0.2);
    car.heading = kPi;
    in.cars.push_back(car);
    s += 12.0 + in.oncoming_speed * 1.5 + random.uniform(0.0, 260.0) / density;
  }
}

int DriveTraffic::count() const { return static_cast<int>(impl_->cars.size()); }

std::vector<SynthCar> DriveTraffic::cars_in(int first, int last) const {
  const Impl& in = *impl_;
  std::vector<SynthCar> out;
  for (std::size_t i = 0; i < in.cars.size(); ++i) {
    const DriveCar& car = in.cars[i];
    bool seen = false;
    std::vector<double> stations;
    for (int f = first; f <= last; ++f) {
      stations.push_back(0.0);
      seen = in.pose_at(car, f, &stations.back()) || seen;
    }
    if (!seen) continue;
    std::vector<PathPose> poses;
    for (const double station : stations) poses.push_back(in.pose_of(car, station));
    Sequence random(in.seed, 0x5041494Eu + 1009u * i);
    out.push_back(make_synth_car(
        in.road,
        {static_cast<int>(i) + 1, in.model(i), car.driving != Driving::kParked, car.ground}, poses,
        &random));
  }
  return out;
}

}  // namespace camber
