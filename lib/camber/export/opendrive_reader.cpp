#include "camber/export/opendrive_reader.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/import/formats/detail/xml_file.h"

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kLongest = 1e7;           // m of a road
constexpr std::size_t kMost = 10'000'000;  // points of a mesh

Vector2d turned(const Vector2d& v, double angle) { return Eigen::Rotation2Dd(angle) * v; }

/// The last record that begins at or before s; the first one before all.
template <typename Record>
const Record* record_at(const std::vector<Record>& records, double s) {
  if (records.empty()) return nullptr;
  const auto after = std::upper_bound(records.begin(), records.end(), s,
                                      [](double at, const Record& r) { return at < r.s; });
  return after == records.begin() ? &records.front() : &*std::prev(after);
}

template <typename Record>
double value_at(const std::vector<Record>& records, double s) {
  const Record* record = record_at(records, s);
  return record ? record->value(s) : 0.0;
}

template <typename Record>
double slope_at(const std::vector<Record>& records, double s) {
  const Record* record = record_at(records, s);
  return record ? record->slope(s) : 0.0;
}

template <typename Record>
void sort_by_s(std::vector<Record>* records) {
  std::stable_sort(records->begin(), records->end(),
                   [](const Record& a, const Record& b) { return a.s < b.s; });
}

class Reader {
 public:
  explicit Reader(const XmlFile& xml) : xml_(xml) {}

  XodrFile read() {
    const pugi::xml_node root = xml_.root();
    if (std::string(root.name()) != "OpenDRIVE") {
      xml_.fail(root, fmt::format("found <{}>, expected <OpenDRIVE>", root.name()));
    }
    const pugi::xml_node header = root.child("header");
    if (!header) xml_.fail(root, "found no <header>");
    XodrFile out;
    out.major = static_cast<int>(number(header, "revMajor"));
    out.minor = static_cast<int>(number(header, "revMinor"));
    if (header.attribute("vendor")) out.vendor = header.attribute("vendor").value();
    if (header.attribute("name")) out.name = header.attribute("name").value();
    out.geo_reference = trimmed(header.child("geoReference").text().get());
    for (const pugi::xml_node& node : root.children("road")) out.roads.push_back(road(node));
    for (const pugi::xml_node& node : root.children("junction")) {
      (void)node;
      ++out.junctions;
    }
    if (out.roads.empty()) xml_.fail(root, "found no <road>");
    return out;
  }

 private:
  static std::string trimmed(const std::string& text) {
    const auto first = text.find_first_not_of(" \t\r\n");
    if (first == std::string::npos) return {};
    return text.substr(first, text.find_last_not_of(" \t\r\n") + 1 - first);
  }

  double number(const pugi::xml_node& node, const char* name) const {
    return xml_.attribute_number(node, name);
  }
  /// Numbers that are not written are 0: writers leave zeros out.
  double number_or(const pugi::xml_node& node, const char* name, double otherwise) const {
    return node.attribute(name) ? number(node, name) : otherwise;
  }

  void read_cubic(const pugi::xml_node& node, const char* at, double from, CubicRecord* out) const {
    out->s = from + number_or(node, at, 0.0);
    out->a = number_or(node, "a", 0.0);
    out->b = number_or(node, "b", 0.0);
    out->c = number_or(node, "c", 0.0);
    out->d = number_or(node, "d", 0.0);
  }

  std::vector<CubicRecord> cubics(const pugi::xml_node& parent, const char* name,
                                  const char* at = "s", double from = 0.0) const {
    std::vector<CubicRecord> out;
    for (const pugi::xml_node& node : parent.children(name)) {
      read_cubic(node, at, from, &out.emplace_back());
    }
    sort_by_s(&out);
    return out;
  }

  XodrPiece piece(const pugi::xml_node& node) const {
    XodrPiece out;
    out.s = number(node, "s");
    out.x = number(node, "x");
    out.y = number(node, "y");
    out.heading = number(node, "hdg");
    out.length = number(node, "length");
    if (!(out.length >= 0.0 && out.length <= kLongest)) {
      xml_.fail(node, fmt::format("length: found {}, expected 0 to {} m", out.length, kLongest));
    }
    const auto read = [&](const pugi::xml_node& at, const char* const(&names)[4], double* to) {
      for (int i = 0; i < 4; ++i) to[i] = number_or(at, names[i], 0.0);
    };
    if (const pugi::xml_node arc = node.child("arc")) {
      out.shape = XodrPiece::Shape::kArc;
      out.first_curvature = out.last_curvature = number(arc, "curvature");
    } else if (const pugi::xml_node spiral = node.child("spiral")) {
      out.shape = XodrPiece::Shape::kSpiral;
      out.first_curvature = number_or(spiral, "curvStart", 0.0);
      out.last_curvature = number_or(spiral, "curvEnd", 0.0);
    } else if (const pugi::xml_node poly = node.child("poly3")) {
      out.shape = XodrPiece::Shape::kPoly3;
      read(poly, {"a", "b", "c", "d"}, out.v);
    } else if (const pugi::xml_node param = node.child("paramPoly3")) {
      out.shape = XodrPiece::Shape::kParamPoly3;
      read(param, {"aU", "bU", "cU", "dU"}, out.u);
      read(param, {"aV", "bV", "cV", "dV"}, out.v);
      const std::string range = param.attribute("pRange").value();
      if (!range.empty() && range != "normalized" && range != "arcLength") {
        xml_.fail(param, "pRange: found '" + range + "', expected arcLength or normalized");
      }
      out.normalized = range != "arcLength";
      // Without any coefficient it is no curve: straight on.
      if (!param.first_attribute()) out.u[1] = out.normalized ? out.length : 1.0;
    } else if (!node.child("line")) {
      xml_.fail(node, "found no line, arc, spiral, poly3 or paramPoly3");
    }
    return out;
  }

  XodrLane lane(const pugi::xml_node& node, double section) const {
    XodrLane out;
    out.id = static_cast<int>(number(node, "id"));
    out.type = node.attribute("type").value();
    const std::string level = node.attribute("level").value();
    out.level = level == "true" || level == "1";
    out.widths = cubics(node, "width", "sOffset", section);
    out.borders = cubics(node, "border", "sOffset", section);
    for (const pugi::xml_node& height : node.children("height")) {
      out.heights.push_back({section + number_or(height, "sOffset", 0.0),
                             number_or(height, "inner", 0.0), number_or(height, "outer", 0.0)});
    }
    sort_by_s(&out.heights);
    return out;
  }

  XodrLaneSection section(const pugi::xml_node& node) const {
    XodrLaneSection out;
    out.s = number_or(node, "s", 0.0);
    for (const pugi::xml_node& at : node.child("left").children("lane")) {
      out.left.push_back(lane(at, out.s));
    }
    for (const pugi::xml_node& at : node.child("right").children("lane")) {
      out.right.push_back(lane(at, out.s));
    }
    const auto outwards = [](const XodrLane& a, const XodrLane& b) {
      return std::abs(a.id) < std::abs(b.id);
    };
    std::stable_sort(out.left.begin(), out.left.end(), outwards);
    std::stable_sort(out.right.begin(), out.right.end(), outwards);
    return out;
  }

  XodrRoad road(const pugi::xml_node& node) const {
    XodrRoad out;
    out.id = node.attribute("id").value();
    out.name = node.attribute("name").value();
    out.length = number(node, "length");
    if (!(out.length > 0.0 && out.length <= kLongest)) {
      xml_.fail(node, fmt::format("length: found {}, expected more than 0 m", out.length));
    }
    for (const pugi::xml_node& at : node.child("planView").children("geometry")) {
      out.plan.push_back(piece(at));
    }
    if (out.plan.empty()) xml_.fail(node, "found no <geometry> in <planView>");
    sort_by_s(&out.plan);
    out.elevation = cubics(node.child("elevationProfile"), "elevation");
    const pugi::xml_node lateral = node.child("lateralProfile");
    out.superelevation = cubics(lateral, "superelevation");
    for (const pugi::xml_node& at : lateral.children("crossfall")) {
      XodrCrossfall& record = out.crossfall.emplace_back();
      read_cubic(at, "s", 0.0, &record);
      const std::string side = lower_case(at.attribute("side").value());
      record.left = side != "right";
      record.right = side != "left";
    }
    sort_by_s(&out.crossfall);
    out.shapes = static_cast<bool>(lateral.child("shape"));
    const pugi::xml_node lanes = node.child("lanes");
    out.lane_offset = cubics(lanes, "laneOffset");
    for (const pugi::xml_node& at : lanes.children("laneSection")) {
      out.sections.push_back(section(at));
    }
    sort_by_s(&out.sections);
    return out;
  }

  const XmlFile& xml_;
};

/// Along a spiral whose curvature changes evenly from k by `rate` a metre, from the origin along x:
/// the integral of its direction (Gauss-Legendre, pieces that turn by little).
Vector2d along_spiral(double k, double rate, double length) {
  constexpr double kNodes[] = {-0.906179845938664, -0.538469310105683, 0.0, 0.538469310105683,
                               0.906179845938664};
  constexpr double kWeights[] = {0.236926885056189, 0.478628670499366, 0.568888888888889,
                                 0.478628670499366, 0.236926885056189};
  const double turn = std::abs(k) * length + 0.5 * std::abs(rate) * length * length;
  const int pieces = std::clamp(static_cast<int>(std::ceil(turn / 0.2)), 1, 100000);
  Vector2d out = Vector2d::Zero();
  const double half = 0.5 * length / pieces;
  for (int i = 0; i < pieces; ++i) {
    const double middle = (2 * i + 1) * half;
    for (int n = 0; n < 5; ++n) {
      const double at = middle + half * kNodes[n];
      const double angle = k * at + 0.5 * rate * at * at;
      out += half * kWeights[n] * Vector2d(std::cos(angle), std::sin(angle));
    }
  }
  return out;
}

double cubic(const double (&c)[4], double p) { return c[0] + p * (c[1] + p * (c[2] + p * c[3])); }
double cubic_slope(const double (&c)[4], double p) {
  return c[1] + p * (2.0 * c[2] + 3.0 * p * c[3]);
}
double cubic_bend(const double (&c)[4], double p) { return 2.0 * c[2] + 6.0 * p * c[3]; }

/// The u of a cubic v(u) whose arc length from 0 is `length`: Newton's steps on Simpson's sums.
double along_cubic(const double (&v)[4], double length) {
  const auto pace = [&](double u) { return std::hypot(1.0, cubic_slope(v, u)); };
  double u = length;
  for (int round = 0; round < 20; ++round) {
    constexpr int kPieces = 64;
    double sum = 0.0;
    const double step = u / kPieces;
    for (int i = 0; i < kPieces; ++i) {
      sum += step / 6.0 * (pace(i * step) + 4.0 * pace((i + 0.5) * step) + pace((i + 1) * step));
    }
    const double change = (length - sum) / pace(u);
    u += change;
    if (std::abs(change) < 1e-9) break;
  }
  return u;
}

/// The outer edges of lanes from the centre outwards, m from the reference line along `side`.
std::vector<double> edges_of(const std::vector<XodrLane>& lanes, double s) {
  std::vector<double> out;
  double at = 0.0;
  for (const XodrLane& lane : lanes) {
    if (lane.widths.empty() && !lane.borders.empty()) {
      at = std::abs(value_at(lane.borders, s));
    } else {
      at += std::max(0.0, value_at(lane.widths, s));
    }
    out.push_back(at);
  }
  return out;
}

}  // namespace

const XodrRoad& XodrFile::road(const std::string& id) const {
  std::string known;
  for (const XodrRoad& road : roads) {
    if (road.id == id) return road;
    if (known.size() < 200) known += (known.empty() ? "" : ", ") + road.id;
  }
  throw std::invalid_argument(fmt::format("road: found '{}', expected one of {}", id, known));
}

XodrFile read_xodr(const std::filesystem::path& path) {
  const XmlFile xml = XmlFile::read(path);
  return Reader(xml).read();
}

XodrSurface::XodrSurface(const XodrRoad& road) : road_(road) {}

XodrSurface::Frame XodrSurface::frame(double s) const {
  const XodrPiece& piece = *record_at(road_.plan, s);
  const double d = s - piece.s;
  Vector2d local = Vector2d::Zero(), direction = Vector2d::UnitX();
  double curvature = 0.0;
  switch (piece.shape) {
    case XodrPiece::Shape::kLine:
      local = {d, 0.0};
      direction = Vector2d::UnitX();
      break;
    case XodrPiece::Shape::kArc:
    case XodrPiece::Shape::kSpiral: {
      const double rate =
          piece.length > 0.0 ? (piece.last_curvature - piece.first_curvature) / piece.length : 0.0;
      local = along_spiral(piece.first_curvature, rate, d);
      const double angle = piece.first_curvature * d + 0.5 * rate * d * d;
      direction = {std::cos(angle), std::sin(angle)};
      curvature = piece.first_curvature + rate * d;
      break;
    }
    case XodrPiece::Shape::kPoly3:
    case XodrPiece::Shape::kParamPoly3: {
      const bool plain = piece.shape == XodrPiece::Shape::kPoly3;
      const double p = plain                                    ? along_cubic(piece.v, d)
                       : piece.normalized && piece.length > 0.0 ? d / piece.length
                                                                : d;
      const Vector2d first(plain ? 1.0 : cubic_slope(piece.u, p), cubic_slope(piece.v, p));
      const Vector2d second(plain ? 0.0 : cubic_bend(piece.u, p), cubic_bend(piece.v, p));
      local = {plain ? p : cubic(piece.u, p), cubic(piece.v, p)};
      const double pace = first.norm();
      direction = pace > 0.0 ? Vector2d(first / pace) : Vector2d(Vector2d::UnitX());
      if (pace > 0.0) {
        curvature = (first.x() * second.y() - first.y() * second.x()) / (pace * pace * pace);
      }
      break;
    }
  }
  return {Vector2d(piece.x, piece.y) + turned(local, piece.heading),
          turned(direction, piece.heading), curvature};
}

Vector2d XodrSurface::position(double s) const { return frame(s).place; }
double XodrSurface::heading(double s) const {
  const Vector2d d = frame(s).direction;
  return std::atan2(d.y(), d.x());
}
double XodrSurface::curvature(double s) const { return frame(s).curvature; }
double XodrSurface::elevation(double s) const { return value_at(road_.elevation, s); }
double XodrSurface::grade(double s) const { return slope_at(road_.elevation, s); }
double XodrSurface::superelevation(double s) const { return value_at(road_.superelevation, s); }

const XodrLaneSection* XodrSurface::section(double s) const { return record_at(road_.sections, s); }

double XodrSurface::left(double s) const {
  const XodrLaneSection* lanes = section(s);
  if (!lanes || lanes->left.empty()) return std::max(0.0, value_at(road_.lane_offset, s));
  return std::max(0.0, edges_of(lanes->left, s).back() + value_at(road_.lane_offset, s));
}

double XodrSurface::right(double s) const {
  const XodrLaneSection* lanes = section(s);
  if (!lanes || lanes->right.empty()) return std::max(0.0, -value_at(road_.lane_offset, s));
  return std::max(0.0, edges_of(lanes->right, s).back() - value_at(road_.lane_offset, s));
}

double XodrSurface::lane_height(double s, double t, double superelevation) const {
  const double offset = value_at(road_.lane_offset, s);
  const bool left = t >= offset;
  double fall = 0.0;
  if (const XodrCrossfall* record = record_at(road_.crossfall, s)) {
    if (left ? record->left : record->right) fall = std::tan(record->value(s));
  }
  double height = -fall * std::abs(t);
  const XodrLaneSection* lanes = section(s);
  if (!lanes) return height;
  const std::vector<XodrLane>& side = left ? lanes->left : lanes->right;
  const std::vector<double> edges = edges_of(side, s);
  const double aside = std::abs(t - offset);
  constexpr double kOnEdge = 1e-9;  // m
  for (std::size_t i = 0; i < side.size(); ++i) {
    if (aside > edges[i] + kOnEdge) continue;
    const double inner = i > 0 ? edges[i - 1] : 0.0;
    const double inner_t = offset + (left ? inner : -inner);
    if (side[i].level) {
      // What the superelevation tilts is turned back, from the lane's inner edge on.
      height = -fall * std::abs(inner_t) - std::tan(superelevation) * (t - inner_t);
    }
    const std::vector<XodrLaneHeight>& records = side[i].heights;
    if (!records.empty()) {
      const XodrLaneHeight& at = *record_at(records, s);
      const auto next = std::next(records.begin() + (&at - records.data()));
      double inside = at.inner, outside = at.outer;
      if (next != records.end() && next->s > at.s && s > at.s) {
        const double share = (s - at.s) / (next->s - at.s);
        inside += share * (next->inner - at.inner);
        outside += share * (next->outer - at.outer);
      }
      const double across = edges[i] > inner ? (aside - inner) / (edges[i] - inner) : 0.0;
      height += inside + across * (outside - inside);
    }
    break;
  }
  return height;
}

Vector3d XodrSurface::point(double s, double t) const {
  const Frame at = frame(s);
  const double tilt = superelevation(s);
  const Vector3d along = Vector3d(at.direction.x(), at.direction.y(), grade(s)).normalized();
  const Vector3d level(-at.direction.y(), at.direction.x(), 0.0);
  // The road's plane across: level, turned about the direction along.
  const Vector3d across = std::cos(tilt) * level + std::sin(tilt) * along.cross(level);
  const Vector3d up = along.cross(across);
  return Vector3d(at.place.x(), at.place.y(), elevation(s)) + t * across +
         lane_height(s, t, tilt) * up;
}

namespace {

/// Places along a road at which something begins, and so many between that lines from one to the
/// next pass its surface by less than a tolerance.
std::vector<double> stations_of(const XodrRoad& road, const XodrSurface& surface,
                                double tolerance) {
  std::set<double> places = {0.0, road.length};
  const auto add = [&](double s) {
    if (s > 0.0 && s < road.length) places.insert(s);
  };
  for (const XodrPiece& r : road.plan) add(r.s);
  for (const auto* list : {&road.elevation, &road.superelevation, &road.lane_offset}) {
    for (const CubicRecord& r : *list) add(r.s);
  }
  for (const XodrLaneSection& section : road.sections) {
    add(section.s);
    for (const auto* side : {&section.left, &section.right}) {
      for (const XodrLane& lane : *side) {
        for (const CubicRecord& r : lane.widths) add(r.s);
        for (const XodrLaneHeight& r : lane.heights) add(r.s);
      }
    }
  }
  const auto off = [&](double from, double to) {
    const double middle = 0.5 * (from + to);
    double most = 0.0;
    for (const double side : {-1.0, 0.0, 1.0}) {
      const auto t = [&](double s) {
        return side < 0.0 ? -surface.right(s) : side > 0.0 ? surface.left(s) : 0.0;
      };
      const Vector3d chord = 0.5 * (surface.point(from, t(from)) + surface.point(to, t(to)));
      most = std::max(most, (surface.point(middle, t(middle)) - chord).norm());
    }
    return most;
  };
  std::vector<double> out = {0.0};
  for (auto at = std::next(places.begin()); at != places.end(); ++at) {
    // At least every five metres: an S passes the middle of its chord.
    const double begin = out.back();
    int pieces = std::max(1, static_cast<int>(std::ceil((*at - begin) / 5.0)));
    const auto fine = [&] {
      for (int i = 0; i < pieces; ++i) {
        const double from = begin + (*at - begin) * i / pieces;
        if (off(from, begin + (*at - begin) * (i + 1) / pieces) > tolerance) return false;
      }
      return true;
    };
    while (!fine() && (*at - begin) / pieces > 0.05) pieces *= 2;
    for (int i = 1; i <= pieces; ++i) {
      out.push_back(i == pieces ? *at : begin + (*at - begin) * i / pieces);
    }
  }
  return out;
}

}  // namespace

XodrMesh xodr_mesh(const XodrRoad& road, double tolerance, const std::vector<std::string>& types) {
  const XodrSurface surface(road);
  const std::vector<double> stations = stations_of(road, surface, tolerance);
  XodrMesh out;
  for (std::size_t n = 0; n < road.sections.size(); ++n) {
    const XodrLaneSection& section = road.sections[n];
    const double end = n + 1 < road.sections.size() ? road.sections[n + 1].s : road.length;
    for (const bool left : {true, false}) {
      const std::vector<XodrLane>& lanes = left ? section.left : section.right;
      for (std::size_t i = 0; i < lanes.size(); ++i) {
        if (!types.empty() && std::count(types.begin(), types.end(), lanes[i].type) == 0) continue;
        const auto base = static_cast<std::uint32_t>(out.points.size());
        std::uint32_t rows = 0;
        for (const double at : stations) {
          if (at < section.s || at > end) continue;
          // At the end the section that follows begins.
          const double s = at == end && end < road.length ? std::nextafter(at, 0.0) : at;
          const double offset = value_at(road.lane_offset, s);
          const std::vector<double> edges = edges_of(lanes, s);
          const double inner = i > 0 ? edges[i - 1] : 0.0, outer = edges[i];
          // The inner edge as this lane has it, which may have a height of its own.
          const double inside = inner + std::min(1e-6, 0.5 * (outer - inner));
          for (const double edge : {inside, outer}) {
            out.points.push_back(surface.point(s, offset + (left ? edge : -edge)));
          }
          ++rows;
          if (out.points.size() > kMost) {
            throw NoAnswerError(fmt::format("the road's mesh has more than {} points", kMost));
          }
        }
        for (std::uint32_t r = 0; r + 1 < rows; ++r) {
          const std::uint32_t a = base + 2 * r;
          const std::array<std::uint32_t, 4> corner =
              left ? std::array<std::uint32_t, 4>{a, a + 2, a + 3, a + 1}
                   : std::array<std::uint32_t, 4>{a, a + 1, a + 3, a + 2};
          out.triangles.push_back({corner[0], corner[1], corner[2]});
          out.triangles.push_back({corner[0], corner[2], corner[3]});
        }
      }
    }
  }
  return out;
}

}  // namespace camber
