#include "camber/synth/synth_world.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <map>

#include "camber/core/random.h"
#include "camber/synth/noise.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegree = kPi / 180.0;
constexpr double kRoadBegin = -16.0, kRoadEnd = 420.0;

Eigen::Vector3f linear(int red, int green, int blue) {
  const auto one = [](int c) { return std::pow(static_cast<float>(c) / 255.0f, 2.2f); };
  return {one(red), one(green), one(blue)};
}

/// Random numbers in the order in which they are asked for.
class Sequence {
 public:
  Sequence(std::uint64_t seed, std::uint64_t stream) : random_(seed, stream) {}
  double uniform(double low, double high) { return random_.uniform(next_++, low, high); }
  bool chance(double probability) { return random_.uniform(next_++) < probability; }
  int below(int count) {
    return static_cast<int>(random_.below(next_++, static_cast<std::uint64_t>(count)));
  }
  std::uint32_t bits() { return static_cast<std::uint32_t>(random_.bits(next_++) >> 32); }
  double normal() { return random_.normal(next_++); }

 private:
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

class MeshBuilder {
 public:
  explicit MeshBuilder(SynthMesh* mesh) : mesh_(mesh) {}

  int add_object(const SynthObject& object) {
    mesh_->objects.push_back(object);
    return static_cast<int>(mesh_->objects.size()) - 1;
  }

  /// Flat triangle.
  void triangle(int object, const TrianglePoints& p, const std::array<Eigen::Vector2f, 3>& uv) {
    const Eigen::Vector3d n = (p[1] - p[0]).cross(p[2] - p[0]);
    if (n.norm() < 1e-9) return;
    const Eigen::Vector3f unit = n.normalized().cast<float>();
    mesh_->triangles.push_back({p, {unit, unit, unit}, uv, object});
  }

  /// Flat quadrilateral a b c d (counter-clockwise from outside).
  void quad(int object, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
            const Eigen::Vector3d& c, const Eigen::Vector3d& d, const Eigen::Vector2f& ua,
            const Eigen::Vector2f& ub, const Eigen::Vector2f& uc, const Eigen::Vector2f& ud) {
    triangle(object, {a, b, c}, {ua, ub, uc});
    triangle(object, {a, c, d}, {ua, uc, ud});
  }

  /// Upright cylinder or cone frustum without ends.
  void post(int object, const Eigen::Vector3d& foot, const Eigen::Vector3d& top, double low_radius,
            double high_radius, int sides) {
    const Eigen::Vector3d axis = (top - foot).normalized();
    const Eigen::Vector3d a = axis.unitOrthogonal();
    const Eigen::Vector3d b = axis.cross(a);
    const auto height = static_cast<float>((top - foot).norm());
    for (int i = 0; i < sides; ++i) {
      const double angle[2] = {2 * kPi * i / sides, 2 * kPi * (i + 1) / sides};
      Eigen::Vector3d low[2], high[2];
      Eigen::Vector3f normal[2];
      Eigen::Vector2f texture[2];
      for (int k = 0; k < 2; ++k) {
        const Eigen::Vector3d out = std::cos(angle[k]) * a + std::sin(angle[k]) * b;
        low[k] = foot + low_radius * out;
        high[k] = top + high_radius * out;
        normal[k] = out.cast<float>();
        texture[k] = {static_cast<float>(angle[k] * low_radius), 0.0f};
      }
      const Eigen::Vector2f up(0.0f, height);
      mesh_->triangles.push_back({{low[0], low[1], high[1]},
                                  {normal[0], normal[1], normal[1]},
                                  {texture[0], texture[1], texture[1] + up},
                                  object});
      mesh_->triangles.push_back({{low[0], high[1], high[0]},
                                  {normal[0], normal[1], normal[0]},
                                  {texture[0], texture[1] + up, texture[0] + up},
                                  object});
    }
  }

  /// Upright box without a bottom.
  void box(int object, const Eigen::Vector3d& foot, const Eigen::Vector2d& along, double length,
           double width, double height) {
    const Eigen::Vector3d a(0.5 * length * along.x(), 0.5 * length * along.y(), 0.0);
    const Eigen::Vector3d b(-0.5 * width * along.y(), 0.5 * width * along.x(), 0.0);
    const Eigen::Vector3d up(0, 0, height);
    const Eigen::Vector3d c[4] = {foot - a - b, foot + a - b, foot + a + b, foot - a + b};
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector3d& p = c[i];
      const Eigen::Vector3d& q = c[(i + 1) % 4];
      const auto w = static_cast<float>((q - p).norm());
      const auto h = static_cast<float>(height);
      quad(object, p, q, q + up, p + up, {0, 0}, {w, 0}, {w, h}, {0, h});
    }
    quad(object, c[0] + up, c[1] + up, c[2] + up, c[3] + up, {0, 0}, {1, 0}, {1, 1}, {0, 1});
  }

 private:
  SynthMesh* mesh_;
};

// ---------------------------------------------------------------- ground

SurfaceKind surface_of(GroundKind kind) {
  switch (kind) {
    case GroundKind::kRoad:
      return SurfaceKind::kAsphalt;
    case GroundKind::kKerb:
      return SurfaceKind::kKerb;
    case GroundKind::kPavement:
      return SurfaceKind::kPavement;
    case GroundKind::kPad:
      return SurfaceKind::kPad;
    case GroundKind::kVerge:
      break;
  }
  return SurfaceKind::kGrass;
}

TruthLabel label_of(GroundKind kind) {
  switch (kind) {
    case GroundKind::kRoad:
      return TruthLabel::kRoad;
    case GroundKind::kKerb:
    case GroundKind::kPavement:
    case GroundKind::kPad:
      return TruthLabel::kPavement;
    case GroundKind::kVerge:
      break;
  }
  return TruthLabel::kTerrain;
}

/// One vertex column of the ground's mesh; the edge has two, below and above the kerb.
struct Column {
  double offset = 0.0;
  bool far_side = false;  ///< height of the side beyond the edge
};

void build_ground(const RoadModel& road, std::uint32_t seed, SynthMesh* mesh) {
  MeshBuilder builder(mesh);
  const RoadLayout& layout = road.layout();
  std::map<GroundKind, int> objects;
  for (const GroundKind kind : {GroundKind::kRoad, GroundKind::kKerb, GroundKind::kPavement,
                                GroundKind::kPad, GroundKind::kVerge}) {
    SynthObject object;
    object.kind = surface_of(kind);
    object.label = label_of(kind);
    object.seed = seed;
    object.extent[0] = static_cast<float>(layout.half_width);
    object.extent[1] = 0.6f + 0.5f * hash_unit(0, 0, seed);  // how coarse the asphalt is
    objects[kind] = builder.add_object(object);
  }

  std::vector<Column> columns;
  const auto add_side = [&](int side, double sign, std::vector<Column>* out) {
    std::vector<double> beyond = {0.0,
                                  layout.kerb_width,
                                  0.6,
                                  1.1,
                                  1.6,
                                  2.1,
                                  layout.pavement_width,
                                  layout.pavement_width + 0.6,
                                  layout.pavement_width + 1.4};
    for (const RoadLayout::Pad& pad : layout.pads) {
      if (pad.side == side) beyond.push_back(pad.depth);
    }
    for (double b = layout.pavement_width + 2.2; b < 52.0; b *= b < 12.0 ? 1.16 : 1.3) {
      beyond.push_back(b);
    }
    std::sort(beyond.begin(), beyond.end());
    double last = -1.0;
    for (const double b : beyond) {
      if (b - last < 0.05) continue;
      out->push_back({sign * (layout.half_width + b), true});
      last = b;
    }
  };
  std::vector<Column> right;
  add_side(1, -1.0, &right);
  columns.assign(right.rbegin(), right.rend());
  const int strips = 2 * static_cast<int>(std::ceil(layout.half_width / 0.5));
  for (int i = 0; i <= strips; ++i) {
    columns.push_back({layout.half_width * (2.0 * i / strips - 1.0), false});
  }
  add_side(0, 1.0, &columns);

  std::vector<double> rows;
  for (double s = kRoadBegin; s < kRoadEnd;) {
    rows.push_back(s);
    s += s < 90.0 ? 0.25 : (s < 160.0 ? 0.5 : 2.0);
  }
  for (const RoadLayout::Pad& pad : layout.pads) {
    rows.push_back(pad.begin);
    rows.push_back(pad.end);
  }
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end(),
                         [](double a, double b) { return std::abs(a - b) < 1e-6; }),
             rows.end());

  const auto height = [&](double s, const Column& c) {
    return c.far_side ? road.side_height(s, c.offset) : road.height(s, c.offset);
  };
  struct Vertex {
    Eigen::Vector3d point;
    Eigen::Vector3f normal;
  };
  const auto vertex = [&](double s, const Column& c) {
    Vertex out;
    const Eigen::Vector2d p = road.place(s, c.offset);
    out.point = {p.x(), p.y(), height(s, c)};
    // Normal from central differences along the station and, on the own side of the edge, across.
    constexpr double kStep = 0.05;
    const double inward = c.offset > 0 ? -kStep : kStep;
    const bool at_edge = std::abs(std::abs(c.offset) - road.layout().half_width) < kStep;
    Column a = c, b = c;
    if (at_edge) {
      b.offset += c.far_side ? -inward : inward;
    } else {
      a.offset -= kStep;
      b.offset += kStep;
    }
    const auto at = [&](double station, const Column& column) {
      const Eigen::Vector2d q = road.place(station, column.offset);
      return Eigen::Vector3d(q.x(), q.y(), height(station, column));
    };
    const Eigen::Vector3d along = at(s + kStep, c) - at(s - kStep, c);
    const Eigen::Vector3d across = at(s, b) - at(s, a);
    Eigen::Vector3d n = along.cross(across);
    if (n.z() < 0) n = -n;
    out.normal = n.normalized().cast<float>();
    return out;
  };

  std::vector<Vertex> before, now;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    now.clear();
    for (const Column& c : columns) now.push_back(vertex(rows[r], c));
    if (r > 0) {
      const double s0 = rows[r - 1], s1 = rows[r];
      const auto arc0 = static_cast<float>(road.profile().arc_length(s0));
      const auto arc1 = static_cast<float>(road.profile().arc_length(s1));
      for (std::size_t i = 0; i + 1 < columns.size(); ++i) {
        const Column& c0 = columns[i];
        const Column& c1 = columns[i + 1];
        const Vertex &v00 = before[i], &v01 = before[i + 1], &v10 = now[i], &v11 = now[i + 1];
        if (std::abs(c1.offset - c0.offset) < 1e-9) {  // kerb face
          if ((v01.point - v00.point).norm() < 1e-6 && (v11.point - v10.point).norm() < 1e-6) {
            continue;
          }
          const auto h0 = static_cast<float>(std::abs(v01.point.z() - v00.point.z()));
          const auto h1 = static_cast<float>(std::abs(v11.point.z() - v10.point.z()));
          builder.triangle(
              objects[GroundKind::kKerb], {v00.point, v10.point, v11.point},
              {Eigen::Vector2f(arc0, 0), Eigen::Vector2f(arc1, 0), Eigen::Vector2f(arc1, -h1)});
          builder.triangle(
              objects[GroundKind::kKerb], {v00.point, v11.point, v01.point},
              {Eigen::Vector2f(arc0, 0), Eigen::Vector2f(arc1, -h1), Eigen::Vector2f(arc0, -h0)});
          continue;
        }
        const GroundKind kind = road.kind(0.5 * (s0 + s1), 0.5 * (c0.offset + c1.offset));
        const int object = objects[kind];
        const auto t0 = static_cast<float>(c0.offset), t1 = static_cast<float>(c1.offset);
        // From outside (above): counter-clockwise is v00 (right, back), v10 (right, front), v11.
        mesh->triangles.push_back(
            {{v00.point, v10.point, v11.point},
             {v00.normal, v10.normal, v11.normal},
             {Eigen::Vector2f(arc0, t0), Eigen::Vector2f(arc1, t0), Eigen::Vector2f(arc1, t1)},
             object});
        mesh->triangles.push_back(
            {{v00.point, v11.point, v01.point},
             {v00.normal, v11.normal, v01.normal},
             {Eigen::Vector2f(arc0, t0), Eigen::Vector2f(arc1, t1), Eigen::Vector2f(arc0, t1)},
             object});
      }
    }
    std::swap(before, now);
  }
}

// ---------------------------------------------------------------- things beside the road

/// A place beside the road, m beyond its edge on one side.
struct Beside {
  int side = 0;  ///< 0 left, 1 right
  double station = 0.0, beyond = 0.0;
};

class Scenery {
 public:
  Scenery(const RoadModel& road, std::uint64_t seed, SynthMesh* mesh)
      : road_(road), random_(seed, 0x5343454E), builder_(mesh) {}

  void build() {
    for (int side = 0; side < 2; ++side) {
      buildings(side);
      posts(side);
      plants(side);
    }
  }

 private:
  double offset(const Beside& b) const {
    return (b.side == 0 ? 1.0 : -1.0) * (road_.layout().half_width + b.beyond);
  }
  Eigen::Vector3d foot(const Beside& b) const { return road_.point(b.station, offset(b)); }

  bool on_pad(const Beside& b, double margin) const {
    for (const RoadLayout::Pad& pad : road_.layout().pads) {
      if (pad.side == b.side && b.station > pad.begin - margin && b.station < pad.end + margin &&
          b.beyond < pad.depth + margin) {
        return true;
      }
    }
    return false;
  }

  bool taken(const Beside& b, double margin) const {
    for (const auto& [side, begin, end, near, far] : buildings_) {
      if (side == b.side && b.station > begin - margin && b.station < end + margin &&
          b.beyond > near - margin && b.beyond < far + margin) {
        return true;
      }
    }
    return on_pad(b, margin);
  }

  void buildings(int side) {
    static const Eigen::Vector3f kWalls[] = {
        linear(196, 180, 150), linear(172, 120, 96),  linear(205, 200, 190), linear(150, 140, 128),
        linear(188, 160, 118), linear(160, 165, 168), linear(214, 190, 140), linear(140, 92, 76)};
    static const Eigen::Vector3f kRoofs[] = {linear(120, 66, 50), linear(84, 78, 76),
                                             linear(140, 86, 62), linear(66, 66, 72)};
    const double density = random_.uniform(0.35, 0.85);
    double s = random_.uniform(-6.0, 10.0);
    while (s < 190.0) {
      const double length = random_.uniform(9.0, 18.0), depth = random_.uniform(8.0, 11.0);
      const double beyond = random_.uniform(8.5, 14.0);
      const int floors = 1 + random_.below(3) + (random_.chance(0.3) ? 1 : 0);
      const bool built = random_.chance(density);
      const Eigen::Vector3f wall =
          kWalls[random_.below(8)] * static_cast<float>(random_.uniform(0.75, 1.1));
      const Eigen::Vector3f tiles = kRoofs[random_.below(4)];
      const std::uint32_t seed = random_.bits();
      const double gap = random_.uniform(2.0, 9.0), roof = random_.uniform(0.55, 0.9);
      const double begin = s;
      s += length + gap;
      if (!built) continue;
      building(side, begin, length, depth, beyond, floors, wall, tiles, seed, roof);
    }
  }

  void building(int side, double begin, double length, double depth, double beyond, int floors,
                const Eigen::Vector3f& wall, const Eigen::Vector3f& tiles, std::uint32_t seed,
                double roof_slope) {
    const Beside middle{side, begin + 0.5 * length, beyond + 0.5 * depth};
    const Eigen::Vector3d center = foot(middle);
    const double heading = road_.profile().heading(middle.station);
    const Eigen::Vector2d along(std::cos(heading), std::sin(heading));
    const Eigen::Vector2d out = (side == 0 ? 1.0 : -1.0) * Eigen::Vector2d(-along.y(), along.x());
    // The ground floor lies at the highest ground at the front, the walls go down below the lowest.
    double low = 1e9, high = -1e9;
    Eigen::Vector2d corner[4];
    for (int i = 0; i < 4; ++i) {
      const double a = (i == 1 || i == 2) ? 0.5 : -0.5, o = i >= 2 ? 0.5 : -0.5;
      corner[i] = center.head<2>() + a * length * along + o * depth * out;
      const double z = road_.height_at(corner[i], middle.station);
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
    const auto at = [&](const Eigen::Vector2d& p, double z) {
      return Eigen::Vector3d(p.x(), p.y(), z);
    };
    for (int i = 0; i < 4; ++i) {
      const Eigen::Vector2d& p = corner[i];
      const Eigen::Vector2d& q = corner[(i + 1) % 4];
      const auto w = static_cast<float>((q - p).norm());
      const auto v0 = static_cast<float>(bottom - ground), v1 = static_cast<float>(eaves - ground);
      builder_.quad(i % 2 == 0 ? front : flank, at(p, bottom), at(q, bottom), at(q, eaves),
                    at(p, eaves), {0, v0}, {w, v0}, {w, v1}, {0, v1});
    }
    // Gable roof, its ridge along the road, eaves 0.4 m over.
    const double over = 0.4;
    const double ridge = eaves + roof_slope * 0.5 * depth;
    const double eave = eaves - roof_slope * over;
    const Eigen::Vector2d front0 = corner[0] - over * along - over * out;
    const Eigen::Vector2d front1 = corner[1] + over * along - over * out;
    const Eigen::Vector2d back1 = corner[2] + over * along + over * out;
    const Eigen::Vector2d back0 = corner[3] - over * along + over * out;
    const Eigen::Vector2d ridge0 = 0.5 * (front0 + back0), ridge1 = 0.5 * (front1 + back1);
    const auto run = static_cast<float>(length + 2 * over);
    const auto up = static_cast<float>(std::hypot(0.5 * depth + over, ridge - eave));
    builder_.quad(roof, at(front0, eave), at(front1, eave), at(ridge1, ridge), at(ridge0, ridge),
                  {0, 0}, {run, 0}, {run, up}, {0, up});
    builder_.quad(roof, at(back1, eave), at(back0, eave), at(ridge0, ridge), at(ridge1, ridge),
                  {0, 0}, {run, 0}, {run, up}, {0, up});
    const auto gable = static_cast<float>(ridge - ground), wide = static_cast<float>(depth);
    const auto top = static_cast<float>(eaves - ground);
    const Eigen::Vector2d peak0 = 0.5 * (corner[0] + corner[3]);
    const Eigen::Vector2d peak1 = 0.5 * (corner[1] + corner[2]);
    builder_.triangle(
        flank, {at(corner[3], eaves), at(corner[0], eaves), at(peak0, ridge)},
        {Eigen::Vector2f(0, top), Eigen::Vector2f(wide, top), Eigen::Vector2f(0.5f * wide, gable)});
    builder_.triangle(
        flank, {at(corner[1], eaves), at(corner[2], eaves), at(peak1, ridge)},
        {Eigen::Vector2f(0, top), Eigen::Vector2f(wide, top), Eigen::Vector2f(0.5f * wide, gable)});
    buildings_.push_back({side, begin, begin + length, beyond, beyond + depth});
  }

  void posts(int side) {
    const RoadLayout& layout = road_.layout();
    const bool pavement = layout.pavement[side];
    // Street lamps on one side, marker posts where there is no pavement, now and then a sign.
    SynthObject steel;
    steel.label = TruthLabel::kPole;
    steel.color = linear(105, 110, 112);
    const int lamp = builder_.add_object(steel);
    SynthObject white = steel;
    white.color = linear(222, 222, 216);
    const int marker = builder_.add_object(white);
    SynthObject black = steel;
    black.color = linear(30, 30, 32);
    const int band = builder_.add_object(black);
    if (pavement) {
      for (double s = random_.uniform(4.0, 20.0); s < 200.0; s += random_.uniform(24.0, 30.0)) {
        const Beside b{side, s, layout.pavement_width + 0.25};
        if (on_pad(b, 0.5)) continue;
        const Eigen::Vector3d p = foot(b);
        const Eigen::Vector3d top = p + Eigen::Vector3d(0, 0, 6.2);
        builder_.post(lamp, p - Eigen::Vector3d(0, 0, 0.3), top, 0.075, 0.05, 10);
        Beside over = b;
        over.beyond -= 1.5;
        Eigen::Vector3d arm = foot(over);
        arm.z() = top.z() + 0.25;
        builder_.post(lamp, top, arm, 0.04, 0.04, 6);
        const double heading = road_.profile().heading(s);
        builder_.box(lamp, arm - Eigen::Vector3d(0, 0, 0.06),
                     {-std::sin(heading), std::cos(heading)}, 0.6, 0.22, 0.12);
      }
    } else {
      for (double s = random_.uniform(3.0, 12.0); s < 220.0; s += 18.0) {
        const Beside b{side, s, 0.9};
        if (on_pad(b, 0.5)) continue;
        const Eigen::Vector3d p = foot(b);
        const double heading = road_.profile().heading(s);
        const Eigen::Vector2d along(std::cos(heading), std::sin(heading));
        builder_.box(marker, p - Eigen::Vector3d(0, 0, 0.1), along, 0.09, 0.12, 1.05);
        builder_.box(band, p + Eigen::Vector3d(0, 0, 0.68), along, 0.095, 0.125, 0.16);
      }
    }
    for (double s = random_.uniform(14.0, 45.0); s < 180.0; s += random_.uniform(30.0, 70.0)) {
      const Beside b{side, s, (pavement ? layout.pavement_width : 0.6) + 0.5};
      const std::uint32_t seed = random_.bits();
      if (on_pad(b, 0.8)) continue;
      const Eigen::Vector3d p = foot(b);
      builder_.post(lamp, p - Eigen::Vector3d(0, 0, 0.2), p + Eigen::Vector3d(0, 0, 2.75), 0.035,
                    0.035, 8);
      const double heading = road_.profile().heading(s) + (side == 0 ? kPi : 0.0);
      const Eigen::Vector3d right(std::sin(heading), -std::cos(heading), 0.0);
      const Eigen::Vector3d up(0, 0, 1);
      const Eigen::Vector3d front(std::cos(heading), std::sin(heading), 0.0);
      SynthObject plate;
      plate.kind = SurfaceKind::kSign;
      plate.label = TruthLabel::kSign;
      plate.seed = seed;
      plate.extent[0] = 0.33f;
      const int face = builder_.add_object(plate);
      SynthObject grey = steel;
      grey.label = TruthLabel::kSign;
      grey.color = linear(120, 122, 124);
      const int back = builder_.add_object(grey);
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
  }

  void plants(int side) {
    const RoadLayout& layout = road_.layout();
    const double inner = layout.pavement[side] ? layout.pavement_width + 0.9 : 1.8;
    double s = random_.uniform(2.0, 12.0);
    while (s < 260.0) {
      const double size = random_.uniform(0.75, 1.25);
      const bool tree = random_.chance(0.55);
      Beside b{side, s, inner + (tree ? random_.uniform(0.8, 5.0) : random_.uniform(0.2, 4.0))};
      const std::uint32_t seed = random_.bits();
      s += random_.uniform(3.0, 14.0);
      if (taken(b, tree ? 1.6 : 0.9)) continue;
      if (tree) {
        plant_tree(b, size, seed);
      } else {
        plant_bush(b, size, seed);
      }
    }
    // Farther away, beyond the first row of houses.
    for (double far = random_.uniform(0.0, 10.0); far < 330.0; far += random_.uniform(5.0, 16.0)) {
      const Beside b{side, far, random_.uniform(22.0, 46.0)};
      const double size = random_.uniform(0.9, 1.6);
      const std::uint32_t seed = random_.bits();
      if (!taken(b, 2.0)) plant_tree(b, size, seed);
    }
  }

  /// Leaves on the shell of an ellipsoid, each a small rhomb.
  void crown(const Eigen::Vector3d& middle, const Eigen::Vector3d& radii, int count, double leaf,
             int object, Sequence& random) {
    for (int i = 0; i < count; ++i) {
      const double z = random.uniform(-1.0, 1.0), a = random.uniform(0.0, 2 * kPi);
      const double r = std::sqrt(1.0 - z * z);
      const double shell = std::cbrt(random.uniform(0.25, 1.0));
      const Eigen::Vector3d out(r * std::cos(a), r * std::sin(a), z);
      const Eigen::Vector3d p = middle + shell * radii.cwiseProduct(out);
      Eigen::Vector3d n(random.normal(), random.normal(), random.normal());
      n = (n.normalized() + 1.2 * out).normalized();
      const Eigen::Vector3d u = n.unitOrthogonal();
      const Eigen::Vector3d w = n.cross(u);
      const double turn = random.uniform(0.0, 2 * kPi);
      const double half = leaf * random.uniform(0.6, 1.2);
      const Eigen::Vector3d x = half * (std::cos(turn) * u + std::sin(turn) * w);
      const Eigen::Vector3d y = 0.6 * half * (-std::sin(turn) * u + std::cos(turn) * w);
      // Lit as the crown as a whole; the texture coordinate keeps the depth inside it.
      const Eigen::Vector3f normal = out.cast<float>();
      const auto shade = static_cast<float>(shell);
      const auto tone = static_cast<float>(random.uniform(0.0, 1.0));
      const Eigen::Vector2f texture(shade, tone);
      mesh().triangles.push_back(
          {{p - x, p + y, p + x}, {normal, normal, normal}, {texture, texture, texture}, object});
      mesh().triangles.push_back(
          {{p - x, p + x, p - y}, {normal, normal, normal}, {texture, texture, texture}, object});
    }
  }

  int leaf_object(std::uint32_t seed) {
    SynthObject leaves;
    leaves.kind = SurfaceKind::kLeaf;
    leaves.label = TruthLabel::kVegetation;
    const float warm = hash_unit(1, 2, seed), bright = 0.7f + 0.6f * hash_unit(3, 4, seed);
    leaves.color = bright * Eigen::Vector3f(0.060f + 0.045f * warm, 0.110f, 0.026f);
    leaves.seed = seed;
    return builder_.add_object(leaves);
  }

  void plant_tree(const Beside& b, double size, std::uint32_t seed) {
    Sequence random(seed, 0x54524545);
    const Eigen::Vector3d p = foot(b);
    SynthObject bark;
    bark.kind = SurfaceKind::kBark;
    bark.label = TruthLabel::kVegetation;
    bark.color = linear(92, 76, 60);
    bark.seed = seed;
    const double height = size * random.uniform(5.0, 8.0);
    const Eigen::Vector3d lean(random.uniform(-0.2, 0.2), random.uniform(-0.2, 0.2), 0.0);
    const double trunk = 0.38 * height;
    builder_.post(builder_.add_object(bark), p - Eigen::Vector3d(0, 0, 0.3),
                  p + lean + Eigen::Vector3d(0, 0, 0.62 * height), 0.03 * height, 0.015 * height,
                  9);
    const int leaves = leaf_object(seed);
    const int blobs = 5;
    const int share = b.station > 120.0 ? 90 : 420;
    const double leaf = b.station > 120.0 ? 0.32 : 0.15;
    for (int i = 0; i < blobs; ++i) {
      const double spread = 0.17 * height;
      const Eigen::Vector3d middle =
          p + lean +
          Eigen::Vector3d(random.uniform(-spread, spread), random.uniform(-spread, spread),
                          trunk + (height - trunk) * random.uniform(0.25, 0.75));
      const double r = height * random.uniform(0.15, 0.22);
      crown(middle, {r, r, 0.9 * r}, share, leaf, leaves, random);
    }
  }

  void plant_bush(const Beside& b, double size, std::uint32_t seed) {
    Sequence random(seed, 0x42555348);
    const Eigen::Vector3d p = foot(b);
    const int leaves = leaf_object(seed);
    const int blobs = 3;
    for (int i = 0; i < blobs; ++i) {
      const double r = size * random.uniform(0.4, 0.65);
      const Eigen::Vector3d middle = p + Eigen::Vector3d(random.uniform(-0.6, 0.6) * size,
                                                         random.uniform(-0.6, 0.6) * size, 0.7 * r);
      crown(middle, {r, r, r}, b.station > 90.0 ? 60 : 170, 0.11, leaves, random);
    }
  }

  SynthMesh& mesh() { return *builder_mesh_; }

 public:
  void set_mesh(SynthMesh* mesh) { builder_mesh_ = mesh; }

 private:
  struct Taken {
    int side;
    double begin, end, near, far;
  };
  const RoadModel& road_;
  Sequence random_;
  MeshBuilder builder_;
  SynthMesh* builder_mesh_ = nullptr;
  std::vector<Taken> buildings_;
};

// ---------------------------------------------------------------- cars

SurfaceKind surface_of(CarMaterial material) {
  switch (material) {
    case CarMaterial::kPaint:
      return SurfaceKind::kCarPaint;
    case CarMaterial::kGlass:
      return SurfaceKind::kCarGlass;
    case CarMaterial::kTyre:
      return SurfaceKind::kCarTyre;
    case CarMaterial::kLight:
      return SurfaceKind::kCarLight;
    case CarMaterial::kPlate:
      return SurfaceKind::kCarPlate;
    case CarMaterial::kTrim:
      return SurfaceKind::kCarTrim;
    case CarMaterial::kRim:
      break;
  }
  return SurfaceKind::kCarRim;
}

Eigen::Vector3f paint_color(Sequence& random) {
  // Silver, white, black and grey are half of all cars.
  static const Eigen::Vector3f kPaints[] = {
      linear(178, 182, 186), linear(226, 226, 222), linear(30, 31, 34),  linear(92, 96, 100),
      linear(150, 152, 150), linear(34, 58, 110),   linear(132, 22, 24), linear(58, 88, 124),
      linear(60, 82, 66),    linear(178, 160, 124), linear(96, 26, 34),  linear(200, 196, 180)};
  return kPaints[random.below(12)];
}

SynthMesh car_mesh(const CarModel& model, const Eigen::Vector3f& paint, std::uint32_t seed) {
  SynthMesh mesh;
  for (int m = 0; m < kNumCarMaterials; ++m) {
    SynthObject object;
    object.kind = surface_of(static_cast<CarMaterial>(m));
    object.label = TruthLabel::kCar;
    object.color = paint;
    object.seed = seed;
    object.extent = {
        static_cast<float>(model.dimensions.length), static_cast<float>(model.dimensions.width),
        static_cast<float>(model.dimensions.height), static_cast<float>(model.wheel_radius)};
    mesh.objects.push_back(object);
  }
  const TriangleMesh& in = model.mesh;
  const auto count = in.triangles.size();
  std::vector<Eigen::Vector3d> faces(count);
  // Corners of equal position are one vertex for smoothing; edges sharper than 35 degrees stay.
  const auto key = [](const Eigen::Vector3d& p) {
    return std::array<long, 3>{std::lround(p.x() * 1e5), std::lround(p.y() * 1e5),
                               std::lround(p.z() * 1e5)};
  };
  std::map<std::array<long, 3>, std::vector<int>> around;
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3i& t = in.triangles[i];
    faces[i] = (in.vertices[t[1]] - in.vertices[t[0]]).cross(in.vertices[t[2]] - in.vertices[t[0]]);
    for (int k = 0; k < 3; ++k) around[key(in.vertices[t[k]])].push_back(static_cast<int>(i));
  }
  const double sharp = std::cos(35.0 * kDegree);
  for (std::size_t i = 0; i < count; ++i) {
    if (faces[i].norm() < 1e-10) continue;
    SynthTriangle out;
    const Eigen::Vector3d own = faces[i].normalized();
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d& p = in.vertices[in.triangles[i][k]];
      out.points[k] = p;
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const int other : around[key(p)]) {
        if (faces[other].norm() < 1e-10) continue;
        if (in.materials[other] == in.materials[i] && own.dot(faces[other].normalized()) > sharp) {
          sum += faces[other];
        }
      }
      out.normals[k] = sum.normalized().cast<float>();
      // Seen from the side: x and y; faces that look up or along the car use z instead.
      if (std::abs(own.z()) > 0.5) {
        out.texture[k] = Eigen::Vector2d(p.x(), p.y()).cast<float>();
      } else if (std::abs(own.x()) > 0.5) {
        out.texture[k] = Eigen::Vector2d(p.z(), p.y()).cast<float>();
      } else {
        out.texture[k] = Eigen::Vector2d(p.x(), p.z()).cast<float>();
      }
    }
    out.object = in.materials[i];
    mesh.triangles.push_back(out);
  }
  return mesh;
}

/// Stands a car with its four wheels on the ground: the plane of the wheels' feet is fitted to the
/// heights of the surface below them.
SE3 seat_car(const RoadModel& road, const CarModel& model, const Eigen::Vector2d& place,
             double station, double heading) {
  const int wheels[4] = {0, 1, 18, 19};
  Eigen::Vector3d up(0, 0, 1), origin(place.x(), place.y(), road.height_at(place, station));
  const Eigen::Vector3d ahead(std::cos(heading), std::sin(heading), 0.0);
  Eigen::Matrix3d rotation;
  for (int iteration = 0; iteration < 12; ++iteration) {
    const Eigen::Vector3d front =
        (ahead - up.dot(ahead) / up.z() * Eigen::Vector3d::UnitZ()).normalized();
    rotation.col(0) = front;
    rotation.col(1) = up;
    rotation.col(2) = front.cross(up);
    Eigen::Matrix<double, 4, 3> design;
    Eigen::Vector4d heights;
    for (int i = 0; i < 4; ++i) {
      Eigen::Vector3d wheel = model.keypoints[wheels[i]];
      wheel.y() = 0.0;
      const Eigen::Vector3d p = rotation * wheel + origin;
      design.row(i) << p.x() - place.x(), p.y() - place.y(), 1.0;
      heights[i] = road.height_at(p.head<2>(), station);
    }
    const Eigen::Vector3d plane =
        (design.transpose() * design).ldlt().solve(design.transpose() * heights);
    up = Eigen::Vector3d(-plane[0], -plane[1], 1.0).normalized();
    origin.z() = plane[2];
  }
  return SE3(rotation, origin);
}

/// Where a car may be: a rectangle in station and offset at every frame.
struct Slot {
  double station = 0.0, offset = 0.0, heading = 0.0;  ///< heading relative to the road's
  double speed = 0.0;                                 ///< of the station, m/s
  GroundKind ground = GroundKind::kRoad;
};

class Traffic {
 public:
  Traffic(const WorldOptions& options, const RoadModel& road)
      : options_(options), road_(road), random_(options.seed, 0x43415253) {}

  std::vector<SynthCar> place(double reference_station) {
    std::vector<SynthCar> cars;
    const int count = options_.num_cars;
    const double reach = options_.farthest_car - options_.nearest_car;
    for (int i = 0; i < count; ++i) {
      // One car in each of `count` stretches, so that all distances are there.
      bool done = false;
      for (int attempt = 0; attempt < 60 && !done; ++attempt) {
        const double share = (i + random_.uniform(0.05, 0.95)) / count;
        const double ahead = options_.nearest_car + reach * share;
        const std::uint64_t index = static_cast<std::uint64_t>(i) * 64 + attempt;
        const CarModel model = sample_car(CounterRandom(options_.seed, 0x46414D49), index);
        const Slot slot = draw_slot(reference_station + ahead, model);
        if (!free(slot, model)) continue;
        slots_.push_back({slot, model.dimensions});
        cars.push_back(make_car_at(slot, model, static_cast<int>(cars.size()) + 1));
        done = true;
      }
    }
    return cars;
  }

 private:
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
    } else {  // parked on a pavement, else standing at the road's edge
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
    if (slot.ground == GroundKind::kPavement) {
      for (const RoadLayout::Pad& pad : road_.layout().pads) {
        if ((pad.side == 0) != (slot.offset > 0)) continue;
        if (slot.station + half_length > pad.begin - 1.6 &&
            slot.station - half_length < pad.end + 1.6) {
          return false;
        }
      }
    }
    const double last = (options_.num_frames - 1) / options_.frame_rate;
    const double steps = std::max(1.0, std::ceil(last / 0.1));
    for (int i = 0; i <= static_cast<int>(steps); ++i) {
      const double time = last * i / steps;
      const double station = slot.station + slot.speed * (time - 0.5 * last);
      const double ego = options_.speed * time;
      if (std::abs(station - ego) < 6.0 &&
          std::abs(slot.offset + 0.5 * road_.layout().half_width) < 2.4) {
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

  SynthCar make_car_at(const Slot& slot, const CarModel& model, int track) {
    SynthCar car;
    car.track = track;
    car.model = model;
    car.moving = slot.speed != 0.0;
    car.ground = slot.ground;
    const std::uint32_t seed = random_.bits();
    car.mesh = car_mesh(model, paint_color(random_), seed);
    car.bvh = car.mesh.bvh();
    const double last = (options_.num_frames - 1) / options_.frame_rate;
    const double wheelbase = model.keypoints[1].x() - model.keypoints[0].x();
    const double track_width = model.keypoints[18].z() - model.keypoints[0].z();
    const double axles = 0.5 * (model.keypoints[1].x() + model.keypoints[0].x());
    for (int f = 0; f < options_.num_frames; ++f) {
      const double time = f / options_.frame_rate;
      const double station = slot.station + slot.speed * (time - 0.5 * last);
      const Eigen::Vector2d at = road_.place(station, slot.offset);
      const double heading = road_.profile().heading(station) + slot.heading;
      car.world_from_vehicle.push_back(seat_car(road_, model, at, station, heading));
      const Eigen::Vector2d between =
          at + axles * Eigen::Vector2d(std::cos(heading), std::sin(heading));
      car.ground_plane.push_back(road_.local_plane(between, station, heading, wheelbase + 0.4,
                                                   std::abs(track_width) + 0.1));
    }
    return car;
  }

  static constexpr double kPadSetback = 1.6;
  WorldOptions options_;
  const RoadModel& road_;
  Sequence random_;
  std::vector<std::pair<Slot, Dimensions>> slots_;
};

// ---------------------------------------------------------------- layout and camera

RoadLayout draw_layout(const WorldOptions& options) {
  Sequence random(options.seed, 0x4C41594F);
  RoadLayout layout;
  layout.seed = options.seed * 7919u + 17u;
  layout.half_width = random.uniform(3.3, 3.9);
  layout.crown = random.uniform(0.03, 0.06);
  layout.undulation = random.uniform(0.006, 0.014);
  layout.pavement[0] = random.chance(0.45);
  layout.pavement[1] = random.chance(0.6) || options.profile == RoadProfileKind::kSteepHill;
  layout.pavement_width = random.uniform(2.5, 3.0);
  for (double& slope : layout.verge_slope) slope = random.uniform(-0.1, 0.16);
  const double reach = options.farthest_car;
  for (int side = 0; side < 2; ++side) {
    double s = random.uniform(8.0, 20.0);
    while (s < reach) {
      RoadLayout::Pad pad;
      pad.side = side;
      // Whole multiples of the mesh's rows.
      pad.begin = std::round(s * 4.0) / 4.0;
      pad.end = pad.begin + std::round(random.uniform(7.0, 14.0) * 4.0) / 4.0;
      pad.depth = random.uniform(4.6, 6.0);
      pad.slope_out = std::tan(random.uniform(-6.0, 7.0) * kDegree);
      pad.slope_along = std::tan(random.uniform(-3.0, 3.0) * kDegree);
      s = pad.end + random.uniform(12.0, 40.0);
      if (random.chance(0.45)) layout.pads.push_back(pad);
    }
  }
  return layout;
}

std::vector<SynthView> drive(const WorldOptions& options, const RoadModel& road) {
  const CounterRandom random(options.seed, 0x45474F00);
  const double lane = -0.5 * road.layout().half_width + random.uniform(0, -0.2, 0.2);
  const double mount_pitch = random.uniform(1, -0.8, 0.8) * kDegree;
  const double mount_yaw = random.uniform(2, -0.6, 0.6) * kDegree;
  const double mount_roll = random.uniform(3, -0.4, 0.4) * kDegree;
  const double drift = random.uniform(4, -0.004, 0.004);  // m sideways a metre
  std::vector<SynthView> views;
  double station = 0.0;
  for (int f = 0; f < options.num_frames; ++f) {
    if (f > 0) {
      // The way in space, not in plan.
      const double arc = road.profile().arc_length(station) + options.speed / options.frame_rate;
      for (int i = 0; i < 20; ++i) {
        station +=
            (arc - road.profile().arc_length(station)) * std::cos(road.profile().grade(station));
      }
    }
    const double offset = lane + drift * station;
    const Eigen::Vector2d at = road.place(station, offset);
    const double heading = road.profile().heading(station) + std::atan(drift);
    SynthView view;
    view.ego_plane = road.local_plane(at, station, heading, 2.0, 1.5).plane;
    const Eigen::Vector3d up = view.ego_plane.normal;
    const Eigen::Vector3d ahead(std::cos(heading), std::sin(heading), 0.0);
    const Eigen::Vector3d front =
        (ahead - up.dot(ahead) / up.z() * Eigen::Vector3d::UnitZ()).normalized();
    Eigen::Matrix3d level;  // camera axes right, down, forward along the road
    level.col(0) = front.cross(up);
    level.col(1) = -up;
    level.col(2) = front;
    // The body moves on its springs by a tenth of a degree and a few millimetres.
    const std::uint64_t k = 100 + 8 * static_cast<std::uint64_t>(f);
    const double pitch = mount_pitch + 0.10 * kDegree * random.normal(k);
    const double yaw = mount_yaw + 0.04 * kDegree * random.normal(k + 1);
    const double roll = mount_roll + 0.06 * kDegree * random.normal(k + 2);
    const double height = options.camera_height + 0.003 * random.normal(k + 3);
    const Eigen::Matrix3d mount = (Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitY()) *
                                   Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitX()) *
                                   Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()))
                                      .toRotationMatrix();
    const Eigen::Vector3d foot = view.ego_plane.foot({at.x(), at.y(), road.height_at(at, station)});
    view.world_from_camera =
        SE3(Eigen::Matrix3d(level * mount), Eigen::Vector3d(foot + height * up));
    views.push_back(view);
  }
  return views;
}

SynthLight draw_light(const WorldOptions& options) {
  const CounterRandom random(options.seed, 0x4C494748);
  SynthLight light;
  const double azimuth = random.uniform(0, 0.0, 2 * kPi),
               elevation = random.uniform(1, 35.0, 60.0) * kDegree;
  light.to_sun = {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                  std::sin(elevation)};
  light.cloudiness = static_cast<float>(random.uniform(2));
  // An overcast sky gives more of the light itself.
  light.sun = 1.0f - 0.85f * light.cloudiness;
  light.sky = 0.45f + 0.35f * light.cloudiness;
  return light;
}

}  // namespace

TriangleBvh SynthMesh::bvh() const {
  std::vector<TrianglePoints> points;
  points.reserve(triangles.size());
  for (const SynthTriangle& triangle : triangles) points.push_back(triangle.points);
  return TriangleBvh(std::move(points));
}

SynthWorld make_synth_world(const WorldOptions& options) {
  const RoadLayout layout = draw_layout(options);
  SynthWorld world{
      RoadModel(RoadProfile::sample(options.profile, options.seed, kRoadBegin, kRoadEnd), layout),
      {},
      {},
      {},
      {},
      {},
      {},
      {}};
  const CounterRandom random(options.seed, 0x4D41524B);
  world.markings.dash_length = random.uniform(0) < 0.5 ? 3.0 : 4.0;
  world.markings.dash_gap = world.markings.dash_length == 3.0 ? 6.0 : 8.0;
  world.markings.line_width = random.uniform(1) < 0.6 ? 0.12 : 0.15;
  world.markings.edge_lines =
      random.uniform(2) < 0.8 || options.profile == RoadProfileKind::kSteepHill;

  const auto seed = static_cast<std::uint32_t>(random.bits(3));
  build_ground(world.road, seed, &world.ground_and_things);
  const std::size_t ground_triangles = world.ground_and_things.triangles.size();
  if (options.scenery) {
    Scenery scenery(world.road, options.seed, &world.ground_and_things);
    scenery.set_mesh(&world.ground_and_things);
    scenery.build();
  }
  world.bvh = world.ground_and_things.bvh();
  std::vector<TrianglePoints> risen;
  for (std::size_t i = ground_triangles; i < world.ground_and_things.triangles.size(); ++i) {
    risen.push_back(world.ground_and_things.triangles[i].points);
  }
  world.shadow_bvh = TriangleBvh(std::move(risen));
  world.views = drive(options, world.road);
  world.light = draw_light(options);

  const double last = (options.num_frames - 1) / options.frame_rate;
  const double reference_station = 0.5 * options.speed * last;
  world.cars = Traffic(options, world.road).place(reference_station);
  return world;
}

WorldHit cast_ray(const SynthWorld& world, int frame, const Eigen::Vector3d& origin,
                  const Eigen::Vector3d& direction) {
  constexpr double kNearest = 1e-6, kFarthest = 1e4;
  WorldHit out;
  const RayHit still = world.bvh.cast(origin, direction, kNearest, kFarthest);
  if (still.triangle >= 0) out = {still.distance, -1, still.triangle};
  for (std::size_t i = 0; i < world.cars.size(); ++i) {
    const SE3 vehicle_from_world = world.cars[i].world_from_vehicle[frame].inverse();
    const RayHit hit = world.cars[i].bvh.cast(vehicle_from_world * origin,
                                              vehicle_from_world.rotation() * direction, kNearest,
                                              std::min(kFarthest, out.distance));
    if (hit.triangle >= 0 && hit.distance < out.distance) {
      out = {hit.distance, static_cast<int>(i), hit.triangle};
    }
  }
  return out;
}

}  // namespace camber
