#include "camber/synth/detail/scenery.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <vector>

#include "camber/synth/detail/mesh_builder.h"
#include "camber/synth/detail/plants.h"
#include "camber/synth/detail/sequence.h"
#include "camber/synth/detail/street.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;

/// A place beside a street, m beyond its edge on one side.
struct Beside {
  int side = 0;  ///< 0 left, 1 right
  double station = 0.0, beyond = 0.0;
};

Eigen::Vector3d at_height(const Eigen::Vector2d& p, double z) { return {p.x(), p.y(), z}; }

/// A building's ground plan and where it stands along its street.
struct Footprint {
  const Street* street;
  int side;
  double begin, end, near, far;
  Eigen::Vector2d corners[4];  ///< counter-clockwise or clockwise
};

/// Whether two convex quadrilaterals overlap (separating axes).
bool overlap(const Eigen::Vector2d* a, const Eigen::Vector2d* b) {
  for (const Eigen::Vector2d* quad : {a, b}) {
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector2d edge = quad[(i + 1) % 4] - quad[i];
      const Eigen::Vector2d axis(-edge.y(), edge.x());
      double low[2] = {1e300, 1e300}, high[2] = {-1e300, -1e300};
      for (int k = 0; k < 4; ++k) {
        for (int j = 0; j < 2; ++j) {
          const double along = axis.dot((j == 0 ? a : b)[k]);
          low[j] = std::min(low[j], along);
          high[j] = std::max(high[j], along);
        }
      }
      if (high[0] < low[1] || high[1] < low[0]) return false;
    }
  }
  return true;
}

/// How far along a street things are put, m of its station.
struct Reach {
  double begin = 0.0, buildings = 190.0, posts = 200.0, markers = 220.0, signs = 180.0,
         plants = 260.0, far_plants = 330.0;
  double simple_from = 120.0;  ///< of trees; bushes 30 m before
  double parking = 0.0;        ///< m beside a road without pavement that are left to parked cars
};

class Scenery {
 public:
  Scenery(const RoadModel& road, std::uint64_t seed, SynthMesh* mesh)
      : road_(road), seed_(seed), random_(seed, 0x5343454E), builder_(mesh) {
    crowded_ = road.layout().junction.has_value() || is_tight(0.0, 100.0);
  }
  /// Of the stretch of a long road from `begin` on.
  Scenery(const RoadModel& road, std::uint64_t seed, double begin, double simple_from,
          const SideLimits& limits, SynthMesh* mesh)
      : road_(road),
        seed_(seed),
        random_(seed, 0x53545243u + static_cast<std::uint64_t>(std::llround(begin))),
        builder_(mesh),
        limits_(&limits) {
    crowded_ = is_tight(begin - 30.0, begin + kSceneryStretch + 30.0);
    const double end = begin + kSceneryStretch;
    // Nothing reaches into the next stretch.
    const Street main = Street::main(road);
    along(main, {begin, end - 30.0, end, end, end, end - 2.0, end - 2.0, simple_from, 2.6});
  }

  void build() {
    const Street main = Street::main(road_);
    along(main, {});
    if (!road_.layout().junction) return;
    const Street crossing = Street::crossing(road_);
    random_ = Sequence(seed_, 0x43524F53);
    along(crossing, {-70.0, 70.0, 70.0, 70.0, 70.0, 90.0, 110.0});
  }

 private:
  /// Whether things beside a bend could meet each other or the carriageway.
  bool is_tight(double begin, double end) const {
    double sharpest = 0.0;
    for (double s = begin; s < end; s += 1.0) {
      sharpest = std::max(sharpest, std::abs(road_.profile().curvature(s)));
    }
    return sharpest > 1.0 / 85.0;
  }

  void along(const Street& street, const Reach& reach) {
    street_ = &street;
    reach_ = reach;
    for (int side = 0; side < 2; ++side) {
      buildings(side);
      posts(side);
      signs(side);
      plants(side);
    }
  }

  double offset(const Beside& b) const {
    return (b.side == 0 ? 1.0 : -1.0) * (street_->half_width() + b.beyond);
  }
  Eigen::Vector3d foot(const Beside& b) const { return street_->point(b.station, offset(b)); }
  Eigen::Vector2d direction(double station) const {
    const double heading = street_->heading(station);
    return {std::cos(heading), std::sin(heading)};
  }

  /// Whether the road's ground ends before a thing.
  bool beyond_limit(const Beside& b, double margin) const {
    return limits_ && street_->half_width() + b.beyond + margin > limits_->at(b.station, b.side);
  }
  bool on_pad(const Beside& b, double margin) const {
    if (street_->is_crossing()) return false;
    for (const RoadLayout::Pad& pad : road_.layout().pads) {
      if (pad.side == b.side && b.station > pad.begin - margin && b.station < pad.end + margin &&
          b.beyond < pad.depth + margin) {
        return true;
      }
    }
    return false;
  }

  /// Whether a thing would stand on a street or its pavement; `margin` m around its foot.
  bool in_the_way(const Beside& b, double margin) const {
    if (!crowded_) return false;
    const double pavement = road_.layout().pavement[b.side] ? road_.layout().pavement_width : 0.3;
    const Eigen::Vector2d p = street_->place(b.station, offset(b));
    return street_->edge_distance(p, b.station) < pavement + margin;
  }

  bool taken(const Beside& b, double margin) const {
    for (const Footprint& f : buildings_) {
      if (f.street == street_ && f.side == b.side && b.station > f.begin - margin &&
          b.station < f.end + margin && b.beyond > f.near - margin && b.beyond < f.far + margin) {
        return true;
      }
      if (!crowded_) continue;
      const Eigen::Vector2d p = street_->place(b.station, offset(b));
      const Eigen::Vector2d x(margin, 0.0), y(0.0, margin);
      const Eigen::Vector2d around[4] = {p - x - y, p + x - y, p + x + y, p - x + y};
      if (overlap(f.corners, around)) return true;
    }
    return on_pad(b, margin) || in_the_way(b, margin) || beyond_limit(b, margin);
  }

  void buildings(int side) {
    static const Eigen::Vector3f kWalls[] = {
        linear_color(196, 180, 150), linear_color(172, 120, 96),  linear_color(205, 200, 190),
        linear_color(150, 140, 128), linear_color(188, 160, 118), linear_color(160, 165, 168),
        linear_color(214, 190, 140), linear_color(140, 92, 76)};
    static const Eigen::Vector3f kRoofs[] = {linear_color(120, 66, 50), linear_color(84, 78, 76),
                                             linear_color(140, 86, 62), linear_color(66, 66, 72)};
    const double density = random_.uniform(0.35, 0.85);
    double s = reach_.begin + (limits_ ? random_.uniform(0.0, 10.0) : random_.uniform(-6.0, 10.0));
    while (s < reach_.buildings) {
      const double length = random_.uniform(9.0, 18.0), depth = random_.uniform(8.0, 11.0);
      const double beyond = random_.uniform(8.5, 14.0);
      const int floors = 1 + random_.below(3) + (random_.chance(0.3) ? 1 : 0);
      const bool built = random_.chance(density);
      const Eigen::Vector3f wall =
          kWalls[random_.below(8)] * static_cast<float>(random_.uniform(0.75, 1.1));
      const Eigen::Vector3f tiles = kRoofs[random_.below(4)];
      const std::uint32_t seed = random_.bits();
      const double gap = random_.uniform(2.0, 9.0), roof = random_.uniform(0.55, 0.9);
      const Footprint footprint = footprint_of({side, s, beyond}, length, depth);
      s += length + gap;
      if (!built || ((crowded_ || limits_) && !buildable(footprint))) continue;
      buildings_.push_back(footprint);
      building(footprint, floors, wall, tiles, seed, roof);
    }
  }

  Footprint footprint_of(const Beside& near, double length, double depth) const {
    Footprint f{
        street_, near.side, near.station, near.station + length, near.beyond, near.beyond + depth,
        {}};
    const double middle = near.station + 0.5 * length;
    const Eigen::Vector3d center = foot({near.side, middle, near.beyond + 0.5 * depth});
    const Eigen::Vector2d along = direction(middle);
    const Eigen::Vector2d out =
        (near.side == 0 ? 1.0 : -1.0) * Eigen::Vector2d(-along.y(), along.x());
    for (int i = 0; i < 4; ++i) {
      const double a = (i == 1 || i == 2) ? 0.5 : -0.5, o = i >= 2 ? 0.5 : -0.5;
      f.corners[i] = center.head<2>() + a * length * along + o * depth * out;
    }
    return f;
  }

  bool buildable(const Footprint& f) const {
    for (const double station : {f.begin, 0.5 * (f.begin + f.end), f.end}) {
      if (beyond_limit({f.side, station, f.far}, 0.5)) return false;
    }
    for (const Footprint& other : buildings_) {
      if (overlap(f.corners, other.corners)) return false;
    }
    const double pavement = road_.layout().pavement[f.side] ? road_.layout().pavement_width : 0.3;
    constexpr int kSteps = 8;
    for (int i = 0; i < 4; ++i) {
      for (int k = 0; k < kSteps; ++k) {
        const Eigen::Vector2d p = f.corners[i] + static_cast<double>(k) / kSteps *
                                                     (f.corners[(i + 1) % 4] - f.corners[i]);
        if (street_->edge_distance(p, f.begin) < pavement + 0.8) return false;
      }
    }
    return true;
  }

  void building(const Footprint& f, int floors, const Eigen::Vector3f& wall,
                const Eigen::Vector3f& tiles, std::uint32_t seed, double roof_slope) {
    const double length = f.end - f.begin, depth = f.far - f.near;
    // The ground floor lies at the highest ground at the front, the walls go down below the lowest.
    double low = 1e9, high = -1e9;
    for (int i = 0; i < 4; ++i) {
      const double z = street_->height_at(f.corners[i], 0.5 * (f.begin + f.end));
      low = std::min(low, z);
      if (i < 2) high = std::max(high, z);
    }
    const double ground = high + 0.2;
    const double eaves = ground + 3.0 * floors + 0.3;
    SynthObject object;
    object.kind = SurfaceKind::kFacade;
    object.label = TruthLabel::kBuilding;
    object.color = wall;
    object.seed = seed;
    object.extent = {static_cast<float>(length), static_cast<float>(eaves - ground), 0, 0};
    const int front = builder_.add_object(object);
    object.extent[0] = static_cast<float>(depth);
    object.seed = seed + 1;
    const int flank = builder_.add_object(object);
    object.kind = SurfaceKind::kRoof;
    object.color = tiles;
    const int roof = builder_.add_object(object);
    const double bottom = low - 1.5;
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector2d& p = f.corners[i];
      const Eigen::Vector2d& q = f.corners[(i + 1) % 4];
      const auto w = static_cast<float>((q - p).norm());
      const auto v0 = static_cast<float>(bottom - ground), v1 = static_cast<float>(eaves - ground);
      builder_.quad(
          i % 2 == 0 ? front : flank,
          {at_height(p, bottom), at_height(q, bottom), at_height(q, eaves), at_height(p, eaves)},
          {Eigen::Vector2f(0, v0), {w, v0}, {w, v1}, {0, v1}});
    }
    gable_roof(f, roof, flank, eaves, ground, roof_slope);
  }

  /// Its ridge runs along the street; the eaves are 0.4 m over.
  void gable_roof(const Footprint& f, int roof, int flank, double eaves, double ground,
                  double slope) {
    const double length = f.end - f.begin, depth = f.far - f.near;
    const Eigen::Vector2d along = (f.corners[1] - f.corners[0]) / length;
    const Eigen::Vector2d out = (f.corners[3] - f.corners[0]) / depth;
    const double over = 0.4;
    const double ridge = eaves + slope * 0.5 * depth;
    const double eave = eaves - slope * over;
    const Eigen::Vector2d front0 = f.corners[0] - over * along - over * out;
    const Eigen::Vector2d front1 = f.corners[1] + over * along - over * out;
    const Eigen::Vector2d back1 = f.corners[2] + over * along + over * out;
    const Eigen::Vector2d back0 = f.corners[3] - over * along + over * out;
    const Eigen::Vector2d ridge0 = 0.5 * (front0 + back0), ridge1 = 0.5 * (front1 + back1);
    const auto run = static_cast<float>(length + 2 * over);
    const auto up = static_cast<float>(std::hypot(0.5 * depth + over, ridge - eave));
    const std::array<Eigen::Vector2f, 4> texture = {
        Eigen::Vector2f(0, 0), {run, 0}, {run, up}, {0, up}};
    builder_.quad(roof,
                  {at_height(front0, eave), at_height(front1, eave), at_height(ridge1, ridge),
                   at_height(ridge0, ridge)},
                  texture);
    builder_.quad(roof,
                  {at_height(back1, eave), at_height(back0, eave), at_height(ridge0, ridge),
                   at_height(ridge1, ridge)},
                  texture);
    const auto gable = static_cast<float>(ridge - ground), wide = static_cast<float>(depth);
    const auto top = static_cast<float>(eaves - ground);
    const Eigen::Vector2d peak0 = 0.5 * (f.corners[0] + f.corners[3]);
    const Eigen::Vector2d peak1 = 0.5 * (f.corners[1] + f.corners[2]);
    const std::array<Eigen::Vector2f, 3> triangle = {
        Eigen::Vector2f(0, top), {wide, top}, {0.5f * wide, gable}};
    builder_.triangle(
        flank,
        {at_height(f.corners[3], eaves), at_height(f.corners[0], eaves), at_height(peak0, ridge)},
        triangle);
    builder_.triangle(
        flank,
        {at_height(f.corners[1], eaves), at_height(f.corners[2], eaves), at_height(peak1, ridge)},
        triangle);
  }

  int plain_object(TruthLabel label, const Eigen::Vector3f& color) {
    SynthObject object;
    object.label = label;
    object.color = color;
    return builder_.add_object(object);
  }

  /// Street lamps where there is a pavement, else marker posts.
  void posts(int side) {
    const RoadLayout& layout = road_.layout();
    lamp_ = plain_object(TruthLabel::kPole, linear_color(105, 110, 112));
    const int marker = plain_object(TruthLabel::kPole, linear_color(222, 222, 216));
    const int band = plain_object(TruthLabel::kPole, linear_color(30, 30, 32));
    if (layout.pavement[side]) {
      for (double s = reach_.begin + random_.uniform(4.0, 20.0); s < reach_.posts;
           s += random_.uniform(24.0, 30.0)) {
        const Beside b{side, s, layout.pavement_width + 0.25};
        if (street_->exists(s) && !on_pad(b, 0.5) && !in_the_way(b, 0.1) && !beyond_limit(b, 0.3)) {
          street_lamp(b);
        }
      }
      return;
    }
    for (double s = reach_.begin + random_.uniform(3.0, 12.0); s < reach_.markers; s += 18.0) {
      const Beside b{side, s, 0.9 + reach_.parking};
      if (!street_->exists(s) || on_pad(b, 0.5) || in_the_way(b, 0.3) || beyond_limit(b, 0.3)) {
        continue;
      }
      const Eigen::Vector3d p = foot(b);
      builder_.box(marker, p - Eigen::Vector3d(0, 0, 0.1), direction(s), 0.09, 0.12, 1.05);
      builder_.box(band, p + Eigen::Vector3d(0, 0, 0.68), direction(s), 0.095, 0.125, 0.16);
    }
  }

  void street_lamp(const Beside& b) {
    const Eigen::Vector3d p = foot(b);
    const Eigen::Vector3d top = p + Eigen::Vector3d(0, 0, 6.2);
    builder_.post(lamp_, p - Eigen::Vector3d(0, 0, 0.3), top, 0.075, 0.05, 10);
    Beside over = b;
    over.beyond -= 1.5;
    Eigen::Vector3d arm = foot(over);
    arm.z() = top.z() + 0.25;
    builder_.post(lamp_, top, arm, 0.04, 0.04, 6);
    const Eigen::Vector2d along = direction(b.station);
    builder_.box(lamp_, arm - Eigen::Vector3d(0, 0, 0.06), {-along.y(), along.x()}, 0.6, 0.22,
                 0.12);
  }

  void signs(int side) {
    const RoadLayout& layout = road_.layout();
    for (double s = reach_.begin + random_.uniform(14.0, 45.0); s < reach_.signs;
         s += random_.uniform(30.0, 70.0)) {
      const Beside b{side, s,
                     (layout.pavement[side] ? layout.pavement_width : 0.6 + reach_.parking) + 0.5};
      const std::uint32_t seed = random_.bits();
      if (street_->exists(s) && !on_pad(b, 0.8) && !in_the_way(b, 0.2) && !beyond_limit(b, 0.5)) {
        sign(b, seed);
      }
    }
  }

  void sign(const Beside& b, std::uint32_t seed) {
    const Eigen::Vector3d p = foot(b);
    builder_.post(lamp_, p - Eigen::Vector3d(0, 0, 0.2), p + Eigen::Vector3d(0, 0, 2.75), 0.035,
                  0.035, 8);
    const double heading = street_->heading(b.station) + (b.side == 0 ? kPi : 0.0);
    const Eigen::Vector3d right(std::sin(heading), -std::cos(heading), 0.0);
    const Eigen::Vector3d up(0, 0, 1);
    const Eigen::Vector3d front(std::cos(heading), std::sin(heading), 0.0);
    SynthObject plate;
    plate.kind = SurfaceKind::kSign;
    plate.label = TruthLabel::kSign;
    plate.seed = seed;
    plate.extent[0] = 0.33f;
    const int face = builder_.add_object(plate);
    const int back = plain_object(TruthLabel::kSign, linear_color(120, 122, 124));
    const Eigen::Vector3d c = p + 2.4 * up - 0.06 * front;
    constexpr int kSides = 24;
    for (int i = 0; i < kSides; ++i) {
      const auto rim = [&](int k) {
        const double a = 2 * kPi * k / kSides;
        return Eigen::Vector2d(0.33 * std::cos(a), 0.33 * std::sin(a));
      };
      const Eigen::Vector2d q0 = rim(i), q1 = rim(i + 1);
      const Eigen::Vector3d w0 = q0.x() * right + q0.y() * up, w1 = q1.x() * right + q1.y() * up;
      builder_.triangle(face, {c, c + w0, c + w1},
                        {Eigen::Vector2f(0, 0), q0.cast<float>(), q1.cast<float>()});
      const Eigen::Vector3d behind = c + 0.02 * front;
      builder_.triangle(back, {behind, behind + w1, behind + w0},
                        {Eigen::Vector2f(0, 0), q1.cast<float>(), q0.cast<float>()});
    }
  }

  void plants(int side) {
    const RoadLayout& layout = road_.layout();
    const double inner = layout.pavement[side] ? layout.pavement_width + 0.9 : 1.8 + reach_.parking;
    double s = reach_.begin + random_.uniform(2.0, 12.0);
    while (s < reach_.plants) {
      const double size = random_.uniform(0.75, 1.25);
      const bool tree = random_.chance(0.55);
      const Beside b{side, s,
                     inner + (tree ? random_.uniform(0.8, 5.0) : random_.uniform(0.2, 4.0))};
      const std::uint32_t seed = random_.bits();
      s += random_.uniform(3.0, 14.0);
      if (taken(b, tree ? 1.6 : 0.9)) continue;
      if (tree) {
        plant_tree(foot(b), size, b.station > reach_.simple_from, seed, &builder_);
      } else {
        plant_bush(foot(b), size, b.station > reach_.simple_from - 30.0, seed, &builder_);
      }
    }
    // Farther away, beyond the first row of houses.
    for (double far = reach_.begin + random_.uniform(0.0, 10.0); far < reach_.far_plants;
         far += random_.uniform(5.0, 16.0)) {
      const Beside b{side, far, random_.uniform(22.0, 46.0)};
      const double size = random_.uniform(0.9, 1.6);
      const std::uint32_t seed = random_.bits();
      const bool fewer = street_->is_crossing() || b.station > reach_.simple_from;
      if (!taken(b, 2.0)) plant_tree(foot(b), size, fewer, seed, &builder_);
    }
  }

  const RoadModel& road_;
  std::uint64_t seed_;
  Sequence random_;
  MeshBuilder builder_;
  const Street* street_ = nullptr;
  Reach reach_;
  const SideLimits* limits_ = nullptr;
  bool crowded_ = false;
  int lamp_ = 0;
  std::vector<Footprint> buildings_;
};

}  // namespace

void build_scenery(const RoadModel& road, std::uint64_t seed, SynthMesh* mesh) {
  Scenery(road, seed, mesh).build();
}

void build_scenery_stretch(const RoadModel& road, std::uint64_t seed, double begin,
                           double simple_from, const SideLimits& limits, SynthMesh* mesh) {
  Scenery(road, seed, begin, simple_from, limits, mesh);
}

}  // namespace camber
