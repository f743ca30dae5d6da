#include "road/scan_maker.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/core/random.h"

namespace camber::test {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kDegree = M_PI / 180.0;
constexpr double kLargestRange = 100.0;  // m
constexpr double kRangeNoise = 0.02;     // m

class Draws {
 public:
  Draws(std::uint64_t seed, std::uint64_t stream) : random_(seed, stream) {}
  double uniform(double low, double high) { return random_.uniform(next_++, low, high); }
  double normal() { return random_.normal(next_++); }
  bool chance(double share) { return uniform(0.0, 1.0) < share; }

 private:
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

double ramp(double value, double from, double to) {
  const double t = std::clamp((value - from) / (to - from), 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

/// Height of the ground over the plan.
class Terrain {
 public:
  Terrain(const ScanOptions& options, Draws& draws) : grade_(std::tan(options.grade)) {
    kind_ = static_cast<int>(draws.uniform(0.0, 3.0));
    start_ = draws.uniform(6.0, 12.0);
    road_ = draws.uniform(3.5, 5.5);
    pavement_ = road_ + draws.uniform(1.5, 3.0);
    ditch_ = draws.uniform(0.3, 0.7);
    bank_ = draws.uniform(0.1, 0.3);
    for (double& phase : phases_) phase = draws.uniform(-M_PI, M_PI);
    base_ = height(0.0, 0.0);
  }
  double road() const { return road_; }
  double pavement() const { return pavement_; }

  /// m above the road under the sensor
  double height(double x, double y) const { return raw(x, y) - base_; }

  bool grass(double y) const { return std::abs(y) > pavement_; }

 private:
  double raw(double x, double y) const {
    double z = 0.0;
    // A hill: the slope comes in over 12 m.
    const double ahead = std::max(0.0, x - start_), behind = std::max(0.0, -x - start_);
    const auto climb = [](double d) { return d < 12.0 ? d * d / 24.0 : d - 6.0; };
    if (kind_ == 0) z += grade_ * (climb(ahead) - climb(behind));
    if (kind_ == 1) z += grade_ * (climb(behind) - climb(ahead));
    if (kind_ == 2) z += grade_ * x;
    z += 0.08 * std::sin(x / 7.0 + phases_[0]) + 0.12 * std::sin(x / 15.0 + y / 19.0 + phases_[1]) +
         0.015 * std::sin(x / 0.9 + phases_[2]) * std::sin(y / 1.1 + phases_[3]);
    const double side = std::abs(y);
    z -= 0.02 * std::min(side, road_);
    if (side > road_) z += 0.13 + 0.02 * (std::min(side, pavement_) - road_);
    if (y > pavement_ + 1.0) z += bank_ * std::min(y - pavement_ - 1.0, 12.0);
    if (y < -pavement_) {
      const double d = -y - pavement_;
      z -= ditch_ * ramp(d, 0.5, 1.4) * (1.0 - ramp(d, 2.0, 3.2));
      z += 0.05 * std::sin(x / 3.0 + phases_[4]) * ramp(d, 3.0, 6.0);
    }
    return z;
  }
  double grade_, start_ = 0.0, road_ = 0.0, pavement_ = 0.0, ditch_ = 0.0, bank_ = 0.0;
  int kind_ = 0;
  double phases_[5];
  double base_ = 0.0;
};

/// An upright box or an elliptic column, turned about the vertical; solid or of leaves.
struct Thing {
  Vector3d center;  // of its foot
  double bottom = 0.0, top = 0.0;
  double half_length = 0.0, half_width = 0.0, yaw = 0.0;
  bool round = false, ellipsoid = false;
  double density = -1.0;  // chance of a return from each metre of leaves; negative: solid
};

/// Distances at which a ray enters and leaves a thing; false if it passes by.
bool cross(const Thing& thing, const Vector3d& direction, double* enter, double* leave) {
  const double c = std::cos(thing.yaw), s = std::sin(thing.yaw);
  const Vector3d o(-(c * thing.center.x() + s * thing.center.y()),
                   -(-s * thing.center.x() + c * thing.center.y()), -thing.center.z());
  const Vector3d d(c * direction.x() + s * direction.y(), -s * direction.x() + c * direction.y(),
                   direction.z());
  *enter = 0.0;
  *leave = kLargestRange;
  const auto slab = [&](double from, double speed, double low, double high) {
    if (std::abs(speed) < 1e-12) return from >= low && from <= high;
    double a = (low - from) / speed, b = (high - from) / speed;
    if (a > b) std::swap(a, b);
    *enter = std::max(*enter, a);
    *leave = std::min(*leave, b);
    return *enter < *leave;
  };
  if (!thing.ellipsoid && !slab(o.z(), d.z(), thing.bottom, thing.top)) return false;
  if (!thing.round) {
    return slab(o.x(), d.x(), -thing.half_length, thing.half_length) &&
           slab(o.y(), d.y(), -thing.half_width, thing.half_width);
  }
  const double middle = 0.5 * (thing.bottom + thing.top), half = 0.5 * (thing.top - thing.bottom);
  const double vertical = thing.ellipsoid ? 1.0 / half : 0.0;
  const Vector3d scale(1.0 / thing.half_length, 1.0 / thing.half_width, vertical);
  const Vector3d p = (o - Vector3d(0, 0, middle)).cwiseProduct(scale), q = d.cwiseProduct(scale);
  const double a = q.squaredNorm(), b = p.dot(q), e = p.squaredNorm() - 1.0;
  const double root = b * b - a * e;
  if (a <= 0.0 || root <= 0.0) return false;
  *enter = std::max(*enter, (-b - std::sqrt(root)) / a);
  *leave = std::min(*leave, (-b + std::sqrt(root)) / a);
  return *enter < *leave;
}

std::vector<Thing> furnish(const Terrain& terrain, Draws& draws) {
  std::vector<Thing> things;
  const auto stand = [&](double x, double y) {
    return Vector3d(x, y, terrain.height(x, y) - kSensorHeight);
  };
  const auto add_box = [&](double x, double y, double length, double width, double bottom,
                           double top, double yaw) {
    things.push_back({stand(x, y), bottom, top, 0.5 * length, 0.5 * width, yaw});
  };
  const auto add_car = [&](double x, double y, double yaw) {
    const double length = draws.uniform(3.8, 4.8), width = draws.uniform(1.65, 1.9);
    const double grade = (terrain.height(x + 1.3, y) - terrain.height(x - 1.3, y)) / 2.6;
    // Cars are upright boxes here; on a slope they are cut into short pieces.
    for (int k = 0; k < 4; ++k) {
      const double at = length * ((k + 0.5) / 4.0 - 0.5);
      Thing piece{stand(x, y), 0.22, k == 1 || k == 2 ? 1.5 : 0.85, length / 8.0, 0.5 * width, yaw};
      piece.center += Vector3d(at * std::cos(yaw), at * std::sin(yaw), grade * at * std::cos(yaw));
      things.push_back(piece);
    }
    for (int k = 0; k < 4; ++k) {
      const double a = (k < 2 ? 0.32 : -0.3) * length, b = (k % 2 == 0 ? 0.42 : -0.42) * width;
      const double wx = x + a * std::cos(yaw) - b * std::sin(yaw),
                   wy = y + a * std::sin(yaw) + b * std::cos(yaw);
      add_box(wx, wy, 0.6, 0.2, 0.0, 0.62, yaw);
    }
  };
  for (int side = -1; side <= 1; side += 2) {
    for (double x = -70.0; x < 70.0; x += draws.uniform(5.5, 14.0)) {
      if (draws.chance(0.55)) add_car(x, side * (terrain.road() - 1.1), draws.uniform(-0.04, 0.04));
    }
    for (double x = -90.0; x < 90.0;) {
      const double length = draws.uniform(8.0, 22.0), depth = draws.uniform(8.0, 12.0);
      const double y = terrain.pavement() + draws.uniform(3.5, 8.0) + 0.5 * depth;
      if (draws.chance(0.7)) {
        add_box(x + 0.5 * length, side * y, length, depth, -3.0, draws.uniform(4.0, 11.0),
                draws.uniform(-0.1, 0.1));
      }
      x += length + draws.uniform(1.0, 15.0);
    }
    for (double x = -60.0; x < 60.0; x += draws.uniform(8.0, 20.0)) {
      const double y = side * (terrain.pavement() + draws.uniform(-0.5, 3.0));
      if (draws.chance(0.5)) {
        Thing trunk{stand(x, y), -0.5, 4.0, 0.18, 0.18, 0.0, true};
        things.push_back(trunk);
        const double r = draws.uniform(1.5, 3.0), bottom = draws.uniform(1.9, 3.0);
        things.push_back({stand(x, y), bottom, bottom + 2.5 * r, r, r, 0.0, true, true, 0.5});
      } else if (draws.chance(0.5)) {
        things.push_back({stand(x, y), -0.5, 6.0, 0.09, 0.09, 0.0, true});
      } else {
        Thing hedge{stand(x, y),
                    -0.3,
                    draws.uniform(0.5, 1.6),
                    draws.uniform(1.0, 5.0),
                    draws.uniform(0.3, 0.6),
                    0.0};
        hedge.density = 3.0;
        things.push_back(hedge);
      }
    }
    for (int k = 0; k < 5; ++k) {
      const double x = draws.uniform(-40.0, 40.0);
      const double y = side * draws.uniform(terrain.road() + 0.3, terrain.pavement());
      things.push_back({stand(x, y), 0.0, 1.75, 0.25, 0.2, 0.0, true});
    }
    if (draws.chance(0.5)) {
      const double x = draws.uniform(-40.0, 20.0);
      add_box(x + 10.0, side * (terrain.pavement() + 3.3), 20.0, 0.3, -2.0, 1.2, 0.0);
    }
  }
  for (int k = 0; k < 6; ++k) {
    const double x = (k % 2 == 0 ? 1.0 : -1.0) * draws.uniform(9.0, 60.0);
    const double y = draws.uniform(0.0, 1.0) < 0.5 ? -1.2 : 1.2;
    if (k < 5) {
      add_car(x, y, 0.0);
    } else {
      add_box(x, y, 2.2, 2.4, 0.5, 3.0, 0.0);
      add_box(x + 5.0, y, 7.5, 2.5, 0.9, 3.8, 0.0);
    }
  }
  return things;
}

}  // namespace

Scan make_scan(const ScanOptions& options) {
  Draws shape(options.seed, 21);
  const Terrain terrain(options, shape);
  Draws place(options.seed, 22);
  const std::vector<Thing> things = furnish(terrain, place);
  Draws draws(options.seed, 23);
  struct Pit {
    double x, y, depth;
  };
  std::vector<Pit> pits;  // puddles that mirror
  for (int k = 0; k < 4; ++k) {
    pits.push_back({draws.uniform(-20.0, 20.0), draws.uniform(-terrain.road(), terrain.road()),
                    draws.uniform(0.4, 2.0)});
  }
  Scan scan;
  scan.cloud.frame = CloudFrame::kZUp;
  for (int column = 0; column < options.azimuths; ++column) {
    const double azimuth = 2.0 * M_PI * column / options.azimuths - M_PI;
    for (int beam = 0; beam < 64; ++beam) {
      const double elevation = kDegree * (beam < 32 ? 2.0 - beam / 3.0 : -8.83 - 0.5 * (beam - 32));
      const Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                         std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      const auto above = [&](double t) {
        return t * ray.z() + kSensorHeight - terrain.height(t * ray.x(), t * ray.y());
      };
      double range = std::numeric_limits<double>::infinity();
      for (double t = 1.0, before = 1.0; t < kLargestRange;) {
        const double h = above(t);
        if (h <= 0.0) {
          double low = before, high = t;
          for (int k = 0; k < 20; ++k) {
            const double middle = 0.5 * (low + high);
            (above(middle) > 0.0 ? low : high) = middle;
          }
          range = high;
          break;
        }
        before = t;
        t += std::max(0.05 + 0.008 * t, h);
      }
      bool ground = range < kLargestRange;
      for (const Thing& thing : things) {
        double enter = 0.0, leave = 0.0;
        if (!cross(thing, ray, &enter, &leave) || enter <= 0.5 || enter >= range) continue;
        if (thing.density > 0.0) {
          enter += -std::log(1.0 - draws.uniform(0.0, 1.0)) / thing.density;
          if (enter >= std::min(leave, range)) continue;
        }
        range = enter;
        ground = false;
      }
      if (!(range < kLargestRange)) continue;
      // Weak echoes at grazing incidence are lost.
      if (draws.chance(0.02 + 0.3 * range / kLargestRange)) continue;
      bool lifted = false;
      if (ground && draws.chance(0.003)) {
        range *= draws.uniform(1.1, 1.6);
        ground = false;
      } else if (draws.chance(0.001)) {
        range *= draws.uniform(0.3, 0.95);
        ground = false;
      } else if (ground) {
        const Vector3d hit = range * ray;
        for (const Pit& pit : pits) {
          if (std::hypot(hit.x() - pit.x, hit.y() - pit.y) < 0.5 && draws.chance(0.15)) {
            range *= 1.0 + pit.depth / kSensorHeight;
            ground = false;
            break;
          }
        }
        lifted = ground && terrain.grass(hit.y());
      }
      Vector3d point = (range + kRangeNoise * draws.normal()) * ray;
      if (lifted) point.z() += draws.uniform(0.0, 0.06);
      scan.cloud.points.push_back(point.cast<float>());
      scan.ground.push_back(ground ? 1 : 0);
      scan.height.push_back(
          static_cast<float>(point.z() + kSensorHeight - terrain.height(point.x(), point.y())));
    }
  }
  return scan;
}

GroundScore score_ground(const std::vector<int>& truth, const std::vector<int>& labels) {
  double both = 0.0, found = 0.0, there = 0.0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    both += truth[i] == 1 && labels[i] == 1 ? 1.0 : 0.0;
    found += labels[i] == 1 ? 1.0 : 0.0;
    there += truth[i] == 1 ? 1.0 : 0.0;
  }
  GroundScore score;
  score.precision = found > 0.0 ? both / found : 0.0;
  score.recall = there > 0.0 ? both / there : 0.0;
  const double sum = score.precision + score.recall;
  score.f1 = sum > 0.0 ? 2.0 * score.precision * score.recall / sum : 0.0;
  return score;
}

}  // namespace camber::test
