#include "camber/synth/detail/traffic.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/synth/detail/car_mesh.h"
#include "camber/synth/detail/street.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegree = kPi / 180.0;
constexpr std::uint64_t kCarStream = 0x43415253, kFamilyStream = 0x46414D49;
constexpr std::uint64_t kLeadStream = 0x4C454144, kCornerStream = 0x434F524E;

}  // namespace

SynthCar make_synth_car(const RoadModel& road, const CarChoice& choice,
                        const std::vector<PathPose>& poses, Sequence* random) {
  SynthCar car;
  car.track = choice.track;
  car.model = choice.model;
  car.moving = choice.moving;
  car.ground = choice.ground;
  const std::uint32_t seed = random->bits();
  car.mesh = make_car_mesh(choice.model, draw_car_paint(random), seed);
  const auto& keypoints = choice.model.keypoints;
  const double wheelbase = keypoints[1].x() - keypoints[0].x();
  const double track_width = keypoints[18].z() - keypoints[0].z();
  const double axles = 0.5 * (keypoints[1].x() + keypoints[0].x());
  for (const PathPose& pose : poses) {
    car.world_from_vehicle.push_back(
        seat_car(road, choice.model, pose.place, pose.station, pose.heading));
    const Eigen::Vector2d between =
        pose.place + axles * Eigen::Vector2d(std::cos(pose.heading), std::sin(pose.heading));
    car.ground_plane.push_back(road.local_plane(between, pose.station, pose.heading,
                                                wheelbase + 0.4, std::abs(track_width) + 0.1));
  }
  return car;
}

namespace {

/// A car whose rear axle follows the ego path, its rear end `gap` before the camera.
std::vector<PathPose> lead_poses(const WorldOptions& options, const EgoMotion& motion,
                                 const CarModel& model) {
  const double rear_axle = model.keypoints[0].x();
  const double before = motion.camera_ahead + options.features.lead_car.gap +
                        0.5 * model.dimensions.length + rear_axle;
  std::vector<PathPose> poses;
  for (int f = 0; f < options.num_frames; ++f) {
    PathPose pose = motion.path->at(motion.distance(f, options.frame_rate) + before);
    pose.place -= rear_axle * Eigen::Vector2d(std::cos(pose.heading), std::sin(pose.heading));
    poses.push_back(pose);
  }
  return poses;
}

/// Where a car may be: a rectangle in station and offset at every frame.
struct Slot {
  double station = 0.0, offset = 0.0, heading = 0.0;  ///< heading relative to the road's
  double speed = 0.0;                                 ///< of the station, m/s
  GroundKind ground = GroundKind::kRoad;
};

/// Cars along a road without junction.
class RoadTraffic {
 public:
  RoadTraffic(const WorldOptions& options, const RoadModel& road)
      : options_(options), road_(road), random_(options.seed, kCarStream) {}

  /// Keeps clear of a car that is there already.
  void reserve(const Slot& slot, const Dimensions& size) { slots_.push_back({slot, size}); }

  void place(double reference_station, std::vector<SynthCar>* cars) {
    const int count = options_.num_cars;
    const double reach = options_.farthest_car - options_.nearest_car;
    for (int i = 0; i < count; ++i) {
      // One car in each of `count` stretches, so that all distances are there.
      bool done = false;
      for (int attempt = 0; attempt < 60 && !done; ++attempt) {
        const double share = (i + random_.uniform(0.05, 0.95)) / count;
        const double ahead = options_.nearest_car + reach * share;
        const std::uint64_t index = static_cast<std::uint64_t>(i) * 64 + attempt;
        const CarModel model = sample_car(CounterRandom(options_.seed, kFamilyStream), index);
        const Slot slot = draw_slot(reference_station + ahead, model);
        if (!free(slot, model)) continue;
        slots_.push_back({slot, model.dimensions});
        const CarChoice choice{static_cast<int>(cars->size()) + 1, model, slot.speed != 0.0,
                               slot.ground};
        cars->push_back(make_synth_car(road_, choice, poses_of(slot), &random_));
        done = true;
      }
    }
  }

 private:
  double ego_offset() const {
    const auto& given = options_.features.roadside.edge_distance;
    return given ? *given - road_.layout().half_width : -0.5 * road_.layout().half_width;
  }
  double last_time() const { return (options_.num_frames - 1) / options_.frame_rate; }

  Slot draw_slot(double station, const CarModel& model) {
    const RoadLayout& layout = road_.layout();
    Slot slot;
    slot.station = station;
    const double lane = 0.5 * layout.half_width;
    const double choice = random_.uniform(0.0, 1.0);
    const double jitter = random_.uniform(-0.25, 0.25);
    const double turn = random_.uniform(-1.5, 1.5) * kDegree;
    // A pad at this station is used half of the time.
    for (const RoadLayout::Pad& pad : layout.pads) {
      const double half = 0.5 * model.dimensions.length + 0.4;
      if (pad.end - pad.begin < 2 * half || !random_.chance(0.7)) continue;
      if (station < pad.begin - 6.0 || station > pad.end + 6.0) continue;
      slot.ground = GroundKind::kPad;
      const double sign = pad.side == 0 ? 1.0 : -1.0;
      slot.station = random_.uniform(pad.begin + half, pad.end - half);
      slot.offset = sign * (layout.half_width + kPadSetback + 0.5 * model.dimensions.width +
                            random_.uniform(0.1, 0.8));
      slot.heading = (random_.chance(0.5) ? 0.0 : kPi) + random_.uniform(-8.0, 8.0) * kDegree;
      return slot;
    }
    if (choice < 0.3) {  // own lane, moving along
      slot.offset = -lane + jitter;
      slot.heading = turn;
      slot.speed = options_.speed * random_.uniform(0.7, 1.1);
    } else if (choice < 0.55) {  // oncoming
      slot.offset = lane + jitter;
      slot.heading = kPi + turn;
      slot.speed = -options_.speed * random_.uniform(0.6, 1.2);
    } else {  // parked on a pavement, else at the road's edge
      const int side = random_.chance(0.5) ? 0 : 1;
      const double sign = side == 0 ? 1.0 : -1.0;
      slot.heading = (side == 0 ? kPi : 0.0) + turn;
      if (layout.pavement[side] && model.dimensions.width + 0.5 < layout.pavement_width) {
        slot.ground = GroundKind::kPavement;
        slot.offset = sign * (layout.half_width + layout.kerb_width + 0.1 +
                              0.5 * model.dimensions.width + random_.uniform(0.0, 0.15));
      } else {
        slot.offset = sign * (layout.half_width - 0.5 * model.dimensions.width - 0.3);
      }
    }
    return slot;
  }

  /// Whether a slot keeps clear of the others, of the camera and of pads' ramps at every frame.
  bool free(const Slot& slot, const CarModel& model) const {
    const double half_length = 0.5 * model.dimensions.length;
    constexpr double kTwoLanes = 2.8;  // m, half width of a road on which cars meet
    if (slot.speed < 0.0 && road_.layout().half_width < kTwoLanes) return false;
    if (slot.ground == GroundKind::kPavement) {
      for (const RoadLayout::Pad& pad : road_.layout().pads) {
        if ((pad.side == 0) != (slot.offset > 0)) continue;
        if (slot.station + half_length > pad.begin - 1.6 &&
            slot.station - half_length < pad.end + 1.6) {
          return false;
        }
      }
    }
    const double last = last_time();
    const double steps = std::max(1.0, std::ceil(last / 0.1));
    for (int i = 0; i <= static_cast<int>(steps); ++i) {
      const double time = last * i / steps;
      const double station = slot.station + slot.speed * (time - 0.5 * last);
      const double ego = options_.speed * time;
      if (std::abs(station - ego) < 6.0 && std::abs(slot.offset - ego_offset()) < 2.4) {
        return false;
      }
      for (const auto& [other, size] : slots_) {
        const double theirs = other.station + other.speed * (time - 0.5 * last);
        if (std::abs(theirs - station) < half_length + 0.5 * size.length + 1.2 &&
            std::abs(other.offset - slot.offset) <
                0.5 * (size.width + model.dimensions.width) + 0.35) {
          return false;
        }
      }
    }
    return true;
  }

  std::vector<PathPose> poses_of(const Slot& slot) const {
    std::vector<PathPose> poses;
    for (int f = 0; f < options_.num_frames; ++f) {
      const double time = f / options_.frame_rate;
      const double station = slot.station + slot.speed * (time - 0.5 * last_time());
      poses.push_back({road_.place(station, slot.offset),
                       road_.profile().heading(station) + slot.heading, station});
    }
    return poses;
  }

  static constexpr double kPadSetback = 1.6;
  const WorldOptions& options_;
  const RoadModel& road_;
  Sequence random_;
  std::vector<std::pair<Slot, Dimensions>> slots_;
};

/// Cars along the two streets of a junction.
class CornerTraffic {
 public:
  CornerTraffic(const WorldOptions& options, const RoadModel& road, const EgoMotion& motion)
      : options_(options),
        road_(road),
        junction_(*road.layout().junction),
        random_(options.seed, kCornerStream) {
    for (int f = 0; f < options.num_frames; ++f) {
      PathPose pose = motion.path->at(motion.distance(f, options.frame_rate));
      const Eigen::Vector2d front(std::cos(pose.heading), std::sin(pose.heading));
      cameras_.push_back(pose.place + motion.camera_ahead * front);
      pose.place += 1.4 * front;
      ego_.push_back(pose);
    }
  }

  /// Keeps clear of a car that is there already.
  void reserve(const std::vector<PathPose>& poses, const Dimensions& size) {
    taken_.push_back({poses, size});
  }

  void place(std::vector<SynthCar>* cars) {
    reserve(ego_, {4.8, 2.0, 1.5});
    for (int i = 0; i < options_.num_cars; ++i) {
      for (int attempt = 0; attempt < 60; ++attempt) {
        const std::uint64_t index = static_cast<std::uint64_t>(i) * 64 + attempt;
        const CarModel model = sample_car(CounterRandom(options_.seed, kFamilyStream), index);
        bool moving = false;
        const std::vector<PathPose> poses = draw_poses(model, &moving);
        if (poses.empty() || !free(poses, model)) continue;
        reserve(poses, model.dimensions);
        const CarChoice choice{static_cast<int>(cars->size()) + 1, model, moving,
                               GroundKind::kRoad};
        cars->push_back(make_synth_car(road_, choice, poses, &random_));
        break;
      }
    }
  }

 private:
  struct Taken {
    std::vector<PathPose> poses;
    Dimensions size;
  };

  /// A stretch of one of the arms, parked or driving in either lane; nothing where the arm is not.
  std::vector<PathPose> draw_poses(const CarModel& model, bool* moving) {
    const bool on_street = random_.chance(junction_.road_goes_on() ? 0.65 : 0.85);
    const int arm = options_.features.corner.turn == TurnDirection::kLeft ? 0 : 1;
    const double sign =
        on_street ? ((random_.chance(0.75) ? arm : 1 - arm) == 0 ? 1.0 : -1.0) : 1.0;
    const double mouth = junction_.kerb_radius + 1.0 +
                         (on_street ? road_.layout().half_width : junction_.half_width);
    const double away = mouth + random_.uniform(3.0, 38.0);
    *moving = random_.chance(0.45);
    const bool toward = random_.chance(0.55);  // drives or faces towards the junction
    const double pace = random_.uniform(4.0, 9.0), jitter = random_.uniform(-0.2, 0.2);
    const double turn = random_.uniform(-1.5, 1.5) * kDegree;

    const Street street = on_street ? Street::crossing(road_) : Street::main(road_);
    const double origin = on_street ? 0.0 : junction_.station;
    if (!street.exists(origin + sign * away)) return {};
    // Cars keep to the right of their own direction.
    const double direction = toward ? -sign : sign;
    const double lane = *moving ? 0.5 * street.half_width() + jitter
                                : street.half_width() - 0.5 * model.dimensions.width - 0.3;
    std::vector<PathPose> poses;
    const double last = (options_.num_frames - 1) / options_.frame_rate;
    for (int f = 0; f < options_.num_frames; ++f) {
      const double time = f / options_.frame_rate - 0.5 * last;
      const double station = origin + sign * away + (*moving ? direction * pace * time : 0.0);
      // A moving car stays on its arm.
      if (sign * (station - origin) < mouth) return {};
      poses.push_back({street.place(station, -direction * lane),
                       street.heading(station) + (direction > 0.0 ? 0.0 : kPi) + turn,
                       junction_.station});
    }
    return poses;
  }

  bool free(const std::vector<PathPose>& poses, const CarModel& model) const {
    for (std::size_t f = 0; f < poses.size(); ++f) {
      if ((poses[f].place - cameras_[f]).norm() < 6.5) return false;
      for (const Taken& other : taken_) {
        if (rectangles_meet(poses[f], model.dimensions, other.poses[f], other.size)) return false;
      }
    }
    return true;
  }

  /// With 0.6 m between them.
  static bool rectangles_meet(const PathPose& a, const Dimensions& size_a, const PathPose& b,
                              const Dimensions& size_b) {
    const Eigen::Vector2d apart = b.place - a.place;
    for (const double heading : {a.heading, b.heading}) {
      for (const double quarter : {0.0, 0.5 * kPi}) {
        const Eigen::Vector2d axis(std::cos(heading + quarter), std::sin(heading + quarter));
        const auto reach = [&](const PathPose& pose, const Dimensions& size) {
          const double c = std::abs(std::cos(pose.heading - heading - quarter));
          const double s = std::abs(std::sin(pose.heading - heading - quarter));
          return 0.5 * (size.length * c + size.width * s);
        };
        if (std::abs(axis.dot(apart)) > reach(a, size_a) + reach(b, size_b) + 0.6) return false;
      }
    }
    return true;
  }

  const WorldOptions& options_;
  const RoadModel& road_;
  const Junction& junction_;
  Sequence random_;
  std::vector<PathPose> ego_;
  std::vector<Eigen::Vector2d> cameras_;
  std::vector<Taken> taken_;
};

}  // namespace

std::vector<SynthCar> place_cars(const WorldOptions& options, const RoadModel& road,
                                 const EgoMotion& motion) {
  std::vector<SynthCar> cars;
  std::vector<PathPose> lead;
  if (options.features.lead_car.enabled) {
    Sequence random(options.seed, kLeadStream);
    const CarModel model = sample_car(CounterRandom(options.seed, kLeadStream), 0);
    lead = lead_poses(options, motion, model);
    cars.push_back(make_synth_car(road, {1, model, true, GroundKind::kRoad}, lead, &random));
  }
  if (road.layout().junction) {
    CornerTraffic traffic(options, road, motion);
    if (!lead.empty()) traffic.reserve(lead, cars.front().model.dimensions);
    traffic.place(&cars);
    return cars;
  }
  const double last = (options.num_frames - 1) / options.frame_rate;
  RoadTraffic traffic(options, road);
  if (!lead.empty()) {
    const PathPose& middle = lead[lead.size() / 2];
    const double offset = road.profile().locate(middle.place, middle.station).y();
    const Slot slot{middle.station + 1.3, offset, 0.0, options.speed, GroundKind::kRoad};
    traffic.reserve(slot, cars.front().model.dimensions);
  }
  traffic.place(0.5 * options.speed * last, &cars);
  return cars;
}

}  // namespace camber
