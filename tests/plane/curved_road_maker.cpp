#include "plane/curved_road_maker.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/random.h"

namespace camber::test {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kDegree = M_PI / 180.0;
constexpr double kHalfWidth = 4.0;      // m
constexpr double kCameraHeight = 1.65;  // m
constexpr double kFocal = 718.0;        // px
constexpr double kPixelNoise = 0.5;     // px
constexpr double kBaseline = 1.0;       // m

/// A sum of waves along the road.
class Waves {
 public:
  struct Wave {
    double amplitude, frequency, phase;  ///< frequency in rad/m
  };
  void add(double amplitude, double wavelength, double phase) {
    waves_.push_back({amplitude, 2.0 * M_PI / wavelength, phase});
  }
  /// A Gaussian process with covariance sigma^2 exp(-d^2 / (2 length^2)), by random frequencies.
  static Waves process(double sigma, double length, const CounterRandom& random) {
    constexpr std::uint64_t kCount = 100;
    Waves out;
    for (std::uint64_t k = 0; k < kCount; ++k) {
      // Rayleigh amplitudes with a uniform phase: a Gaussian at every place.
      const double amplitude = sigma / std::sqrt(static_cast<double>(kCount)) *
                               std::hypot(random.normal(4 * k), random.normal(4 * k + 1));
      out.waves_.push_back({amplitude, random.normal(4 * k + 2) / length,
                            random.uniform(4 * k + 3, 0.0, 2.0 * M_PI)});
    }
    return out;
  }
  double operator()(double s) const {
    double sum = 0.0;
    for (const Wave& wave : waves_) {
      sum += wave.amplitude * std::sin(wave.frequency * s + wave.phase);
    }
    return sum;
  }

 private:
  std::vector<Wave> waves_;
};

/// The shape of a road: its height and bank by station, its centreline in plan.
class Shape {
 public:
  Shape(std::uint64_t seed, double length) {
    const CounterRandom random(seed, 51);
    grade_ = std::tan(random.uniform(0, -5.0, 5.0) * kDegree);
    // Amplitudes of the grade of 1 to 5 %: vertical radii from 150 m on.
    for (const std::uint64_t k : {0u, 1u}) {
      const double wavelength =
          random.uniform(10 + 3 * k, k == 0 ? 45.0 : 90.0, k == 0 ? 90.0 : 200.0);
      const double slope = random.uniform(11 + 3 * k, 0.01, k == 0 ? 0.03 : 0.05);
      height_.add(slope * wavelength / (2.0 * M_PI), wavelength,
                  random.uniform(12 + 3 * k, 0.0, 2.0 * M_PI));
    }
    mean_bank_ = random.uniform(20, -0.03, 0.03);
    bank_.add(0.02, random.uniform(21, 80.0, 200.0), random.uniform(22, 0.0, 2.0 * M_PI));
    crown_ = (seed / 2) % 2 == 1 ? 0.02 : 0.0;
    const double heading = random.uniform(30, -M_PI, M_PI),
                 turn = random.uniform(31, -0.008, 0.008);
    Vector2d place = Vector2d::Zero();
    const auto steps = static_cast<std::size_t>(std::lround(length));
    for (std::size_t k = 0; k <= steps; ++k) {
      const double here = heading + turn * static_cast<double>(k);
      const Vector2d ahead(std::cos(here), std::sin(here));
      places_.push_back(place);
      ahead_.push_back(ahead);
      place += ahead;
    }
  }
  double bank(double s) const { return mean_bank_ + bank_(s); }
  double height(double s, double left) const {
    return grade_ * s + height_(s) + bank(s) * left - crown_ * std::abs(left);
  }
  Vector2d ahead(double s) const { return ahead_[piece(s)]; }
  Vector3d at(double s, double left) const {
    const std::size_t k = piece(s);
    const Vector2d to_left(-ahead_[k].y(), ahead_[k].x());
    const Vector2d p = places_[k] + (s - static_cast<double>(k)) * ahead_[k] + left * to_left;
    return {p.x(), p.y(), height(s, left)};
  }
  bool crowned() const { return crown_ > 0.0; }
  std::size_t corners() const { return places_.size(); }

 private:
  std::size_t piece(double s) const {
    return static_cast<std::size_t>(
        std::clamp(std::floor(s), 0.0, static_cast<double>(places_.size() - 2)));
  }
  double grade_ = 0.0, mean_bank_ = 0.0, crown_ = 0.0;
  Waves height_, bank_;
  std::vector<Vector2d> places_, ahead_;
};

/// A camera's or a scanner's errors of points, one after another.
class Errors {
 public:
  Errors(const CurvedRoadOptions& options, const Shape& shape)
      : options_(options),
        shape_(shape),
        random_(options.seed, 53),
        process_(
            Waves::process(process_sigma(), process_length(), CounterRandom(options.seed, 54))),
        pitch_(Waves::process(0.05 * kDegree, 10.0, CounterRandom(options.seed, 55))),
        roll_(Waves::process(0.05 * kDegree, 10.0, CounterRandom(options.seed, 56))),
        lift_(Waves::process(0.005, 10.0, CounterRandom(options.seed, 57))) {
    const CounterRandom whole(options.seed, 58);
    turn_ = 0.02 * kDegree * Vector2d(whole.normal(0), whole.normal(1));
  }

  bool has_sigmas() const {
    return options_.noise == RoadNoise::kUnderstated || options_.noise == RoadNoise::kFrames;
  }

  Vector3d operator()(std::uint64_t i, double s, double left, float* sigma) {
    at_ = 16 * i;
    Vector3d p = shape_.at(s, left);
    p.z() += process_(s);
    switch (options_.noise) {
      case RoadNoise::kCorrelated3m:
      case RoadNoise::kCorrelated10m:
      case RoadNoise::kCorrelated30m:
        return p + Vector3d(0, 0, 0.015 * normal());
      case RoadNoise::kUnderstated:
        return by_camera(p, s - uniform(6.0, 30.0), 3.0, 0.0, 0.0, sigma);
      case RoadNoise::kFrames: {
        // The frame that saw it: its error in scale and in height.
        const double camera = 5.0 * std::round((s - uniform(6.0, 30.0)) / 5.0);
        const CounterRandom frame(options_.seed,
                                  static_cast<std::uint64_t>(1000 + std::lround(camera)));
        return by_camera(p, camera, 1.0, 0.004 * frame.normal(0), 0.015 * frame.normal(1), sigma);
      }
      case RoadNoise::kScanner: {
        const Vector3d from = shape_.at(0.5 * options_.length, 6.0) + Vector3d(0, 0, 2.5);
        const Vector3d ray = p - from;
        const double spread = 0.005 + 0.002 * ray.norm();
        return p + ray.normalized() * (0.005 * normal()) + Vector3d(0, 0, spread * normal());
      }
      case RoadNoise::kHeavyTails: {
        const double chi2 = -2.0 * std::log(1.0 - uniform(0.0, 1.0));  // two degrees of freedom
        return p + Vector3d(0, 0, 0.015 * normal() / std::sqrt(std::max(0.5 * chi2, 1e-4)));
      }
      case RoadNoise::kOneSided: {
        const double above =
            uniform(0.0, 1.0) < 0.25 ? -0.15 * std::log(1.0 - uniform(0.0, 1.0)) : 0.0;
        return p + Vector3d(0, 0, 0.015 * normal() + above);
      }
      case RoadNoise::kFramesLevelled: {
        const double camera = 2.0 * std::round((s - uniform(4.0, 25.0)) / 2.0);
        const double ahead = s - camera;
        return p + Vector3d(0, 0,
                            pitch_(camera) * ahead + roll_(camera) * left + lift_(camera) +
                                0.01 * normal());
      }
      case RoadNoise::kLevelled: {
        const Vector3d offset = p - shape_.at(0.5 * options_.length, 0.0);
        return p + Vector3d(0, 0, turn_.dot(offset.head<2>()) + 0.01 * normal());
      }
    }
    return p;
  }

 private:
  double normal() { return random_.normal(at_++); }
  double uniform(double low, double high) { return random_.uniform(at_++, low, high); }
  /// m, of the heights that neighbours have in common, and along how much road.
  double process_sigma() const {
    switch (options_.noise) {
      case RoadNoise::kCorrelated3m:
      case RoadNoise::kCorrelated10m:
      case RoadNoise::kCorrelated30m:
        return 0.015;
      case RoadNoise::kFramesLevelled:
      case RoadNoise::kLevelled:
        return 0.0;
      default:
        return 0.01;
    }
  }
  double process_length() const {
    return options_.noise == RoadNoise::kCorrelated3m    ? 3.0
           : options_.noise == RoadNoise::kCorrelated10m ? 10.0
           : options_.noise == RoadNoise::kCorrelated30m ? 30.0
                                                         : 15.0;
  }
  /// @param times  the noise over what is stated
  Vector3d by_camera(const Vector3d& p, double camera_station, double times, double scale,
                     double lift, float* sigma) {
    Vector3d camera = shape_.at(std::clamp(camera_station, 0.0, options_.length), 0.0);
    if (camera_station < 0.0) camera.head<2>() += camera_station * shape_.ahead(0.0);
    camera.z() += kCameraHeight;
    const Vector3d offset = p - camera;
    const double r = offset.norm(), along = kPixelNoise * r * r / (kFocal * kBaseline),
                 across = kPixelNoise * r / kFocal;
    *sigma = static_cast<float>(along);
    const Vector3d aside(normal(), normal(), normal());
    return p + (times * along * normal() / r + scale) * offset + times * across * aside +
           Vector3d(0, 0, lift);
  }

  CurvedRoadOptions options_;
  const Shape& shape_;
  CounterRandom random_;
  Waves process_, pitch_, roll_, lift_;
  Vector2d turn_;
  std::uint64_t at_ = 0;
};

}  // namespace

std::string_view to_string(RoadNoise noise) {
  switch (noise) {
    case RoadNoise::kCorrelated3m:
      return "in common along 3 m";
    case RoadNoise::kCorrelated10m:
      return "in common along 10 m";
    case RoadNoise::kCorrelated30m:
      return "in common along 30 m";
    case RoadNoise::kUnderstated:
      return "camera, sigmas 3 times too small";
    case RoadNoise::kFrames:
      return "camera, in common by frames";
    case RoadNoise::kScanner:
      return "scanner, by distance";
    case RoadNoise::kHeavyTails:
      return "heavy tails";
    case RoadNoise::kOneSided:
      return "outliers above";
    case RoadNoise::kFramesLevelled:
      return "frames levelled badly";
    case RoadNoise::kLevelled:
      break;
  }
  return "cloud levelled badly";
}

CurvedRoad make_curved_road(const CurvedRoadOptions& options) {
  if (!(options.length >= 20.0)) {
    throw std::invalid_argument("CurvedRoadOptions::length is " + std::to_string(options.length) +
                                ", expected >= 20 m");
  }
  CurvedRoad road;
  const Shape shape(options.seed, options.length);
  for (std::size_t k = 0; k < shape.corners(); ++k) {
    const auto s = static_cast<double>(k);
    road.line.push_back(shape.at(s, 0.0));
    road.bank.push_back(shape.bank(s));
  }
  road.crowned = shape.crowned();
  const CounterRandom random(options.seed, 52);
  Errors errors(options, shape);
  road.cloud.frame = CloudFrame::kZUp;
  for (std::uint64_t i = 0; i < options.points; ++i) {
    const double s = random.uniform(2 * i, 0.0, options.length),
                 left = random.uniform(2 * i + 1, -kHalfWidth, kHalfWidth);
    float sigma = 0.0f;
    road.cloud.points.push_back(errors(i, s, left, &sigma).cast<float>());
    if (errors.has_sigmas()) road.cloud.sigmas.push_back(sigma);
  }
  return road;
}

}  // namespace camber::test
