#include "plane/road_scene_maker.h"

#include <algorithm>
#include <cmath>

#include "camber/core/random.h"

namespace camber::test {
namespace {

using Eigen::Vector3d;

constexpr double kDegree = M_PI / 180.0;
constexpr double kHalfWidth = 5.0;      // m
constexpr double kCameraHeight = 1.65;  // m
constexpr double kFocal = 718.0;        // px
constexpr double kPixelNoise = 0.5;     // px
constexpr double kBaseline = 1.0;       // m

/// Consecutive random numbers of one stream.
class Draws {
 public:
  Draws(std::uint64_t seed, std::uint64_t stream) : random_(seed, stream) {}
  double uniform(double low, double high) { return random_.uniform(next_++, low, high); }
  double normal() { return random_.normal(next_++); }
  std::uint64_t below(std::uint64_t count) { return random_.below(next_++, count); }

 private:
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

struct Piece {
  Vector3d start, forward, left, normal;
  double length = 0.0, slope = 0.0, bank = 0.0, heading = 0.0;
};

Piece make_piece(const Vector3d& start, double heading, double slope, double bank, double length) {
  Piece piece;
  piece.start = start;
  piece.heading = heading;
  piece.slope = slope;
  piece.bank = bank;
  piece.length = length;
  piece.forward = {std::cos(heading) * std::cos(slope), std::sin(heading) * std::cos(slope),
                   std::sin(slope)};
  const Vector3d level_left(-std::sin(heading), std::cos(heading), 0.0);
  const Vector3d level_normal = piece.forward.cross(level_left);
  piece.left = std::cos(bank) * level_left + std::sin(bank) * level_normal;
  piece.normal = piece.forward.cross(piece.left);
  return piece;
}

}  // namespace

int RoadScene::largest() const {
  std::vector<std::size_t> counts(planes.size(), 0);
  for (const int k : truth) {
    if (k >= 0) ++counts[static_cast<std::size_t>(k)];
  }
  return static_cast<int>(std::max_element(counts.begin(), counts.end()) - counts.begin());
}

RoadScene make_road_scene(const RoadSceneOptions& options) {
  RoadScene scene;
  Draws shape(options.seed, 11);
  std::vector<Piece> pieces;
  Vector3d end = Vector3d::Zero();
  double heading = shape.uniform(-M_PI, M_PI);
  double slope = shape.uniform(-12.0, 12.0) * kDegree, bank = shape.uniform(-5.0, 5.0) * kDegree;
  for (int k = 0; k < options.planes; ++k) {
    if (k > 0) {
      // A break of 4 to 14 degrees between the normals, by trial.
      Piece next;
      const Piece& last = pieces.back();
      for (;;) {
        const double turn = shape.uniform(-6.0, 6.0) * kDegree;
        const double bend = shape.uniform(-14.0, 14.0) * kDegree;
        const double roll = shape.uniform(-2.0, 2.0) * kDegree;
        if (std::abs(last.slope + bend) > 25.0 * kDegree) continue;
        if (std::abs(last.bank + roll) > 5.0 * kDegree) continue;
        if (std::abs(bend) < 3.0 * kDegree) continue;
        next = make_piece(end, last.heading + turn, last.slope + bend, last.bank + roll, 1.0);
        const double angle = angle_between(next.normal, last.normal);
        if (angle >= 4.0 * kDegree && angle <= 14.0 * kDegree) break;
      }
      heading = next.heading;
      slope = next.slope;
      bank = next.bank;
    }
    pieces.push_back(make_piece(end, heading, slope, bank, shape.uniform(15.0, 30.0)));
    scene.axis.push_back(end);
    scene.planes.push_back(Plane::through(end, pieces.back().normal));
    end += pieces.back().length * pieces.back().forward;
  }
  scene.axis.push_back(end);
  double total_length = 0.0;
  for (const Piece& piece : pieces) total_length += piece.length;

  // Which piece holds a place in plan that was drawn on piece k.
  const auto on_piece = [&](const Vector3d& p, int k) {
    const auto height = [&](int j) {
      const Plane& plane = scene.planes[static_cast<std::size_t>(j)];
      return -(plane.normal.x() * p.x() + plane.normal.y() * p.y() + plane.offset) /
             plane.normal.z();
    };
    for (int side = 0; side < 2; ++side) {
      const int other = side == 0 ? k - 1 : k + 1;
      if (other < 0 || other >= options.planes) continue;
      if (!options.cut_at_creases) continue;
      // On this side of the crease the sign of the difference is that at the piece's middle.
      const Piece& piece = pieces[static_cast<std::size_t>(k)];
      const Vector3d middle = piece.start + 0.5 * piece.length * piece.forward;
      const auto height_at = [&](int j, const Vector3d& q) {
        const Plane& plane = scene.planes[static_cast<std::size_t>(j)];
        return -(plane.normal.x() * q.x() + plane.normal.y() * q.y() + plane.offset) /
               plane.normal.z();
      };
      const double here = height(k) - height(other);
      const double there = height_at(k, middle) - height_at(other, middle);
      if (here * there < 0.0) return false;
    }
    return true;
  };

  // A camera that saw the point at station s of the whole chain.
  const auto camera_at = [&](double s, double offset) {
    std::size_t k = 0;
    double rest = s;
    while (k + 1 < pieces.size() && rest > pieces[k].length) rest -= pieces[k++].length;
    const Piece& piece = pieces[k];
    return Vector3d(piece.start + rest * piece.forward + offset * piece.left +
                    kCameraHeight * piece.normal);
  };
  std::vector<double> station_of(pieces.size(), 0.0);
  for (std::size_t k = 1; k < pieces.size(); ++k) {
    station_of[k] = station_of[k - 1] + pieces[k - 1].length;
  }

  Draws draws(options.seed, 12);
  // Cars stand on the road, one to a piece.
  struct Car {
    Vector3d center, front, left, up;
  };
  std::vector<Car> cars;
  for (const Piece& piece : pieces) {
    const double u = draws.uniform(0.25, 0.75) * piece.length;
    const double v = (draws.below(2) == 0 ? 1.0 : -1.0) * draws.uniform(2.0, 3.8);
    cars.push_back({piece.start + u * piece.forward + v * piece.left, piece.forward, piece.left,
                    piece.normal});
  }

  const auto add = [&](const Vector3d& p, double station, PointSourceKind kind, int truth) {
    Vector3d seen = p;
    const double back = draws.uniform(6.0, 30.0);
    const Vector3d camera = camera_at(station - back, draws.uniform(-2.0, 0.0));
    const Vector3d offset = p - camera;
    const double r = offset.norm();
    const double along = kPixelNoise * r * r / (kFocal * kBaseline);
    const double across = kPixelNoise * r / kFocal;
    const Vector3d ray = offset / r;
    Vector3d e1, e2;
    UncertainPlane::make_axes(ray, Vector3d::UnitZ(), &e1, &e2);
    const double n1 = draws.normal(), n2 = draws.normal(), n3 = draws.normal();
    if (options.with_noise && kind != PointSourceKind::kMismatch) {
      seen += along * n1 * ray + across * (n2 * e1 + n3 * e2);
    }
    scene.cloud.points.push_back(seen.cast<float>());
    if (options.with_sigmas) scene.cloud.sigmas.push_back(static_cast<float>(along));
    scene.kinds.push_back(kind);
    scene.truth.push_back(truth);
  };

  scene.cloud.frame = CloudFrame::kZUp;
  scene.cloud.points.reserve(options.points);
  scene.truth.reserve(options.points);
  scene.kinds.reserve(options.points);
  for (std::size_t i = 0; i < options.points; ++i) {
    // Draw a place on the chain, by length.
    double s = 0.0;
    std::size_t k = 0;
    double rest = 0.0, v = 0.0;
    const bool road = draws.uniform(0.0, 1.0) >= options.outlier_share;
    for (;;) {
      s = draws.uniform(0.0, total_length);
      k = 0;
      rest = s;
      while (k + 1 < pieces.size() && rest > pieces[k].length) rest -= pieces[k++].length;
      v = draws.uniform(-kHalfWidth, kHalfWidth);
      const Piece& piece = pieces[k];
      const Vector3d p = piece.start + rest * piece.forward + v * piece.left;
      if (!road || on_piece(p, static_cast<int>(k))) break;
      // Beyond an oblique crease: it belongs to the neighbour there.
    }
    const Piece& piece = pieces[k];
    const auto at = [&](double side, double height) {
      return Vector3d(piece.start + rest * piece.forward + side * piece.left +
                      height * piece.normal);
    };
    if (road) {
      add(at(v, 0.0), s, PointSourceKind::kRoad, static_cast<int>(k));
      continue;
    }
    const double side = v < 0.0 ? -1.0 : 1.0;
    switch (draws.below(4)) {
      case 0:
        add(at(draws.uniform(-12.0, 12.0), draws.uniform(-3.0, 6.0)), s, PointSourceKind::kMismatch,
            -1);
        break;
      case 1:
        add(at(side * 8.0, draws.uniform(0.0, 8.0)), s, PointSourceKind::kFacade, -1);
        break;
      case 2:
        add(at(side * draws.uniform(5.0, 7.5), 0.15), s, PointSourceKind::kPavement, -1);
        break;
      default: {
        const Car& car = cars[k];
        const double l = 4.3, w = 1.8, h = 1.5;
        double a = draws.uniform(-0.5, 0.5) * l, b = draws.uniform(-0.5, 0.5) * w,
               c = draws.uniform(0.0, h);
        switch (draws.below(4)) {
          case 0:
            a = -0.5 * l;
            break;
          case 1:
            b = 0.5 * w;
            break;
          case 2:
            b = -0.5 * w;
            break;
          default:
            c = h;
        }
        add(car.center + a * car.front + b * car.left + c * car.up,
            station_of[k] + (car.center - piece.start).dot(piece.forward), PointSourceKind::kCar,
            -1);
      }
    }
  }
  return scene;
}

}  // namespace camber::test
