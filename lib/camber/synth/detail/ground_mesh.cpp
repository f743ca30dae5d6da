#include "camber/synth/detail/ground_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "camber/synth/detail/ground_objects.h"
#include "camber/synth/detail/junction_mesh.h"
#include "camber/synth/detail/mesh_builder.h"

namespace camber {
namespace {

/// One vertex column of the ground's mesh; the edge has two, below and above the kerb.
struct Column {
  double offset = 0.0;
  bool far_side = false;  ///< height of the side beyond the edge
};

struct Vertex {
  Eigen::Vector3d point;
  Eigen::Vector3f normal;
};

/// How far from the centreline the ground goes on a side: short of the point where the columns of a
/// bend's inner side would meet.
double widest_offset(const RoadModel& road, double sign) {
  double widest = std::numeric_limits<double>::infinity();
  for (double s = kRoadBegin; s <= kRoadEnd; s += 0.5) {
    const double inward = sign * road.profile().curvature(s);
    if (inward > 0.0) widest = std::min(widest, 0.8 / inward);
  }
  return widest;
}

void add_side_columns(const RoadModel& road, int side, double widest, std::vector<Column>* out) {
  const RoadLayout& layout = road.layout();
  const double sign = side == 0 ? 1.0 : -1.0;
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
  if (!layout.pavement[side] && layout.verge_rise[side] != 0.0) {
    for (int i = 1; i <= 6; ++i) beyond.push_back(layout.verge_rise_width * i / 6.0);
  }
  for (double b = layout.pavement_width + 2.2; b < 52.0; b *= b < 12.0 ? 1.16 : 1.3) {
    beyond.push_back(b);
  }
  std::sort(beyond.begin(), beyond.end());
  double last = -1.0;
  for (const double b : beyond) {
    if (b - last < 0.05 || layout.half_width + b > widest) continue;
    out->push_back({sign * (layout.half_width + b), true});
    last = b;
  }
}

/// From right to left.
std::vector<Column> make_columns(const RoadModel& road, bool limited) {
  const double half_width = road.layout().half_width;
  const auto widest = [&](double sign) {
    return limited ? std::numeric_limits<double>::infinity() : widest_offset(road, sign);
  };
  std::vector<Column> right;
  add_side_columns(road, 1, widest(-1.0), &right);
  std::vector<Column> columns(right.rbegin(), right.rend());
  const int strips = 2 * static_cast<int>(std::ceil(half_width / 0.5));
  for (int i = 0; i <= strips; ++i) {
    columns.push_back({half_width * (2.0 * i / strips - 1.0), false});
  }
  add_side_columns(road, 0, widest(1.0), &columns);
  return columns;
}

std::vector<double> make_rows(const RoadModel& road, const GroundReach& reach) {
  std::vector<double> rows;
  for (double s = reach.begin; s < reach.end;) {
    rows.push_back(s);
    s += s < reach.fine_end ? 0.25 : (s < reach.medium_end ? 0.5 : 2.0);
  }
  for (const RoadLayout::Pad& pad : road.layout().pads) {
    rows.push_back(pad.begin);
    rows.push_back(pad.end);
  }
  std::sort(rows.begin(), rows.end());
  rows.erase(std::unique(rows.begin(), rows.end(),
                         [](double a, double b) { return std::abs(a - b) < 1e-6; }),
             rows.end());
  return rows;
}

Vertex make_vertex(const RoadModel& road, double s, const Column& c) {
  const auto at = [&](double station, const Column& column) {
    const Eigen::Vector2d q = road.place(station, column.offset);
    return Eigen::Vector3d(q.x(), q.y(),
                           column.far_side ? road.side_height(station, column.offset)
                                           : road.height(station, column.offset));
  };
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
  const Eigen::Vector3d along = at(s + kStep, c) - at(s - kStep, c);
  const Eigen::Vector3d across = at(s, b) - at(s, a);
  Eigen::Vector3d n = along.cross(across);
  if (n.z() < 0) n = -n;
  return {at(s, c), n.normalized().cast<float>()};
}

/// The ground of a road without junction: strips between columns of constant offset.
class StripMesh {
 public:
  StripMesh(const RoadModel& road, std::uint32_t seed, float contrast, const GroundReach& reach,
            SynthMesh* mesh)
      : road_(road),
        reach_(reach),
        mesh_(mesh),
        builder_(mesh),
        objects_(road.layout().half_width, seed, contrast, &builder_),
        columns_(make_columns(road, reach.limits != nullptr)) {}

  void build() {
    Row before, now;
    for (const double s : make_rows(road_, reach_)) {
      make_row(s, &now);
      if (!before.vertices.empty()) join(before, now);
      std::swap(before, now);
    }
  }

 private:
  struct Row {
    double station = 0.0, arc = 0.0;
    std::vector<double> offsets;  ///< of the columns, within the limits
    std::vector<Vertex> vertices;
  };

  void make_row(double station, Row* row) const {
    row->station = station;
    row->arc = road_.profile().arc_length(station);
    row->offsets.clear();
    row->vertices.clear();
    constexpr double kUnlimited = std::numeric_limits<double>::infinity();
    const double left = reach_.limits ? reach_.limits->at(station, 0) : kUnlimited;
    const double right = reach_.limits ? reach_.limits->at(station, 1) : kUnlimited;
    for (Column column : columns_) {
      column.offset = std::clamp(column.offset, -right, left);
      row->offsets.push_back(column.offset);
      // Beyond the limit there is nothing: one vertex stands for the rest.
      const bool again = row->offsets.size() > 1 && column.far_side &&
                         column.offset == row->offsets[row->offsets.size() - 2] &&
                         (column.offset == left || column.offset == -right);
      row->vertices.push_back(again ? row->vertices.back() : make_vertex(road_, station, column));
    }
  }

  void join(const Row& before_row, const Row& now_row) {
    const std::vector<Vertex>&before = before_row.vertices, &now = now_row.vertices;
    const double s0 = before_row.station, s1 = now_row.station;
    const auto arc0 = static_cast<float>(before_row.arc), arc1 = static_cast<float>(now_row.arc);
    for (std::size_t i = 0; i + 1 < columns_.size(); ++i) {
      if (std::abs(columns_[i + 1].offset - columns_[i].offset) < 1e-9) {
        kerb_face(arc0, arc1, before[i], before[i + 1], now[i], now[i + 1]);
        continue;
      }
      const double a0 = before_row.offsets[i], a1 = before_row.offsets[i + 1];
      const double b0 = now_row.offsets[i], b1 = now_row.offsets[i + 1];
      if (a1 - a0 < 1e-9 && b1 - b0 < 1e-9) continue;
      const int object =
          objects_.of(road_.kind(0.5 * (s0 + s1), 0.5 * (0.5 * (a0 + b0) + 0.5 * (a1 + b1))));
      const Eigen::Vector2f uv00(arc0, a0), uv01(arc0, a1), uv10(arc1, b0), uv11(arc1, b1);
      const Vertex &v00 = before[i], &v01 = before[i + 1], &v10 = now[i], &v11 = now[i + 1];
      // From outside (above): counter-clockwise is v00 (right, back), v10 (right, front), v11.
      mesh_->triangles.push_back({{v00.point, v10.point, v11.point},
                                  {v00.normal, v10.normal, v11.normal},
                                  {uv00, uv10, uv11},
                                  object});
      mesh_->triangles.push_back({{v00.point, v11.point, v01.point},
                                  {v00.normal, v11.normal, v01.normal},
                                  {uv00, uv11, uv01},
                                  object});
    }
  }

  void kerb_face(float arc0, float arc1, const Vertex& v00, const Vertex& v01, const Vertex& v10,
                 const Vertex& v11) {
    if ((v01.point - v00.point).norm() < 1e-6 && (v11.point - v10.point).norm() < 1e-6) return;
    const auto h0 = static_cast<float>(std::abs(v01.point.z() - v00.point.z()));
    const auto h1 = static_cast<float>(std::abs(v11.point.z() - v10.point.z()));
    const int object = objects_.of(GroundKind::kKerb);
    builder_.triangle(
        object, {v00.point, v10.point, v11.point},
        {Eigen::Vector2f(arc0, 0), Eigen::Vector2f(arc1, 0), Eigen::Vector2f(arc1, -h1)});
    builder_.triangle(
        object, {v00.point, v11.point, v01.point},
        {Eigen::Vector2f(arc0, 0), Eigen::Vector2f(arc1, -h1), Eigen::Vector2f(arc0, -h0)});
  }

  const RoadModel& road_;
  GroundReach reach_;
  SynthMesh* mesh_;
  MeshBuilder builder_;
  GroundObjects objects_;
  std::vector<Column> columns_;
};

}  // namespace

void build_ground(const RoadModel& road, std::uint32_t seed, float contrast, SynthMesh* mesh,
                  const GroundReach& reach) {
  if (road.layout().junction) {
    build_junction_ground(road, seed, contrast, mesh);
  } else {
    StripMesh(road, seed, contrast, reach, mesh).build();
  }
}

}  // namespace camber
