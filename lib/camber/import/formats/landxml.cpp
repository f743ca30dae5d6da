#include "camber/import/formats/landxml.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <string_view>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/import/formats/detail/xml_file.h"
#include "camber/import/text_rows.h"

namespace camber {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kSagitta = 1e-4;       // m that a chord may pass an arc by
constexpr double kMiss = 0.05;          // m that an element may miss its end by
constexpr double kLongest = 1e6;        // m of an alignment
constexpr std::size_t kMost = 4000000;  // places of a file

/// A name without the prefix of its namespace.
std::string_view local_name(const pugi::xml_node& node) {
  const std::string_view name = node.name();
  const std::size_t colon = name.rfind(':');
  return colon == std::string_view::npos ? name : name.substr(colon + 1);
}

pugi::xml_node child(const pugi::xml_node& parent, std::string_view name) {
  for (const pugi::xml_node& node : parent.children()) {
    if (local_name(node) == name) return node;
  }
  return {};
}

struct Unit {
  const char* name;
  double metres;
};
constexpr Unit kUnits[] = {{"meter", 1.0},       {"millimeter", 1e-3},
                           {"centimeter", 1e-2}, {"kilometer", 1e3},
                           {"foot", 0.3048},     {"inch", 0.0254},
                           {"mile", 1609.344},   {"USSurveyFoot", 1200.0 / 3937.0}};

class Reader {
 public:
  explicit Reader(const XmlFile& xml) : xml_(xml) {}
  LandXmlFile read();

 private:
  std::vector<double> numbers(const pugi::xml_node& at, std::size_t least, std::size_t most) const;
  Vector3d place(const pugi::xml_node& parent, const char* name) const;
  Vector3d from_numbers(const std::vector<double>& numbers) const;
  void read_units(const pugi::xml_node& root);
  void read_points(const pugi::xml_node& node);
  void read_alignments(const pugi::xml_node& node);
  std::vector<Vector3d> geometry(const pugi::xml_node& coord_geom);
  void add(const pugi::xml_node& at, std::vector<Vector3d>* out, const Vector3d& place);
  void add_line(const pugi::xml_node& at, std::vector<Vector3d>* out);
  void add_list(const pugi::xml_node& at, std::vector<Vector3d>* out);
  void add_curve(const pugi::xml_node& at, std::vector<Vector3d>* out);
  void add_spiral(const pugi::xml_node& at, std::vector<Vector3d>* out);
  double curvature(const pugi::xml_node& at, const char* name) const;
  double turning(const pugi::xml_node& at) const;
  std::size_t pieces(const pugi::xml_node& at, double length, double curvature) const;
  void start(const pugi::xml_node& at, std::vector<Vector3d>* out, const Vector3d& from);

  const XmlFile& xml_;
  LandXmlFile out_;
  std::map<std::string, Vector3d> named_;
  std::size_t places_ = 0;
};

std::vector<double> Reader::numbers(const pugi::xml_node& at, std::size_t least,
                                    std::size_t most) const {
  std::vector<double> out;
  const std::string_view text = at.child_value();
  for (std::size_t i = 0; i < text.size();) {
    const auto blank = [&](std::size_t k) { return std::strchr(" \t\r\n,", text[k]) != nullptr; };
    while (i < text.size() && blank(i)) ++i;
    std::size_t end = i;
    while (end < text.size() && !blank(end)) ++end;
    if (end == i) break;
    const std::string word(text.substr(i, end - i));
    double value = 0.0;
    if (!parse_number(word, &value) || !std::isfinite(value)) {
      xml_.fail(at, fmt::format("found '{}' in {}, expected a number", printable(word), at.name()));
    }
    out.push_back(value);
    i = end;
  }
  if (out.size() < least || out.size() > most) {
    xml_.fail(at, fmt::format("found {} numbers in {}, expected northing, easting and perhaps "
                              "elevation",
                              out.size(), printable(at.name())));
  }
  return out;
}

Vector3d Reader::from_numbers(const std::vector<double>& numbers) const {
  return {numbers[1], numbers[0], numbers.size() > 2 ? numbers[2] : kNaN};
}

/// A point of an element: its own numbers or those of the CgPoint that it names.
Vector3d Reader::place(const pugi::xml_node& parent, const char* name) const {
  const pugi::xml_node node = child(parent, name);
  if (!node) {
    xml_.fail(parent,
              fmt::format("found {} without {}, expected one", printable(parent.name()), name));
  }
  const pugi::xml_attribute reference = node.attribute("pntRef");
  if (reference) {
    const auto found = named_.find(reference.value());
    if (found == named_.end()) {
      xml_.fail(node, fmt::format("found pntRef '{}', expected the name of a CgPoint",
                                  printable(reference.value())));
    }
    return found->second;
  }
  return from_numbers(numbers(node, 2, 3));
}

void Reader::read_units(const pugi::xml_node& root) {
  const pugi::xml_node units = child(root, "Units");
  pugi::xml_node lengths = child(units, "Metric");
  if (!lengths) lengths = child(units, "Imperial");
  if (!lengths) {
    xml_.fail(units ? units : root, "found no Metric or Imperial in Units, expected one");
  }
  out_.unit = lengths.attribute("linearUnit").value();
  for (const Unit& unit : kUnits) {
    if (out_.unit != unit.name) continue;
    out_.metres = unit.metres;
    return;
  }
  xml_.fail(lengths, fmt::format("found linearUnit '{}', expected meter, foot, USSurveyFoot or "
                                 "another of LandXML's",
                                 printable(out_.unit)));
}

void Reader::read_points(const pugi::xml_node& node) {
  for (const pugi::xml_node& below : node.children()) {
    const std::string_view name = local_name(below);
    if (name == "CgPoints") {
      read_points(below);
    } else if (name == "CgPoint" && below.attribute("name") && !below.attribute("pntRef")) {
      const std::vector<double> values = numbers(below, 0, 3);
      if (values.size() >= 2) named_[below.attribute("name").value()] = from_numbers(values);
    }
  }
}

void Reader::add(const pugi::xml_node& at, std::vector<Vector3d>* out, const Vector3d& place) {
  if (!place.head<2>().allFinite()) xml_.fail(at, "found a place beyond all numbers, expected one");
  if (++places_ > kMost) {
    xml_.fail(at, fmt::format("found more than {} places, expected the lines of a site", kMost));
  }
  out->push_back(place);
}

/// An element's first point, which must be where the last one has ended.
void Reader::start(const pugi::xml_node& at, std::vector<Vector3d>* out, const Vector3d& from) {
  if (out->empty()) {
    add(at, out, from);
    return;
  }
  const double off = (from - out->back()).head<2>().norm() * out_.metres;
  if (off > kMiss) {
    xml_.fail(at, fmt::format("found a {} that starts {:.3f} m from the end of the one before, "
                              "expected a continuous line",
                              printable(at.name()), off));
  }
}

void Reader::add_line(const pugi::xml_node& at, std::vector<Vector3d>* out) {
  start(at, out, place(at, "Start"));
  add(at, out, place(at, "End"));
}

void Reader::add_list(const pugi::xml_node& at, std::vector<Vector3d>* out) {
  pugi::xml_node list = child(at, "PntList2D");
  const std::size_t wide = list ? 2 : 3;
  if (!list) list = child(at, "PntList3D");
  if (!list) {
    add_line(at, out);
    return;
  }
  const std::vector<double> values = numbers(list, 2 * wide, 3 * kMost);
  if (values.size() % wide != 0) {
    xml_.fail(list, fmt::format("found {} numbers, expected {} a point", values.size(), wide));
  }
  for (std::size_t i = 0; i < values.size(); i += wide) {
    const Vector3d here(values[i + 1], values[i], wide > 2 ? values[i + 2] : kNaN);
    if (i == 0) start(at, out, here);
    if (i > 0 || out->size() == 1) add(at, out, here);
  }
}

/// 1 where it turns to the left, -1 to the right.
double Reader::turning(const pugi::xml_node& at) const {
  const std::string_view rot = at.attribute("rot").value();
  if (rot == "ccw") return 1.0;
  if (rot == "cw") return -1.0;
  xml_.fail(at, fmt::format("found rot '{}', expected cw or ccw", printable(std::string(rot))));
}

/// Chords for a piece of a length and its greatest curvature, both in the file's unit.
std::size_t Reader::pieces(const pugi::xml_node& at, double length, double curvature) const {
  if (!(length > 0.0) || !(length * out_.metres <= kLongest)) {
    xml_.fail(at, fmt::format("found a {} of {:g} m, expected more than 0 and at most {:g} m",
                              printable(at.name()), length * out_.metres, kLongest));
  }
  const double bend = std::abs(curvature) / out_.metres;  // 1/m
  const double chord = std::min(1.0, bend > 0.0 ? std::sqrt(8.0 * kSagitta / bend) : 1.0);
  const double count = std::ceil(length * out_.metres / chord);
  if (!(count < static_cast<double>(kMost))) {
    xml_.fail(at, fmt::format("found a {} too sharp for its length, expected a road's",
                              printable(at.name())));
  }
  return static_cast<std::size_t>(std::max(1.0, count));
}

void Reader::add_curve(const pugi::xml_node& at, std::vector<Vector3d>* out) {
  const Vector3d from = place(at, "Start"), to = place(at, "End"), center = place(at, "Center");
  const double turn = turning(at);
  const Vector2d first = (from - center).head<2>(), last = (to - center).head<2>();
  const double radius = 0.5 * (first.norm() + last.norm());
  if (!(radius > 0.0) || std::abs(first.norm() - last.norm()) * out_.metres > kMiss) {
    xml_.fail(at, fmt::format("found an arc whose ends lie {:.3f} and {:.3f} m from its centre, "
                              "expected one radius",
                              first.norm() * out_.metres, last.norm() * out_.metres));
  }
  const double from_angle = std::atan2(first.y(), first.x());
  double angle = std::atan2(last.y(), last.x()) - from_angle;
  while (turn * angle < 0.0) angle += turn * 2.0 * M_PI;
  start(at, out, from);
  const std::size_t count = pieces(at, std::abs(angle) * radius, 1.0 / radius);
  for (std::size_t i = 1; i <= count; ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(count);
    const double direction = from_angle + share * angle;
    const double r = first.norm() + share * (last.norm() - first.norm());
    add(at, out,
        {center.x() + r * std::cos(direction), center.y() + r * std::sin(direction),
         from.z() + share * (to.z() - from.z())});
  }
}

/// 1 over a radius, which may be INF.
double Reader::curvature(const pugi::xml_node& at, const char* name) const {
  const std::string text = at.attribute(name).value();
  if (text == "INF" || text == "inf" || text == "Infinity") return 0.0;
  const double radius = xml_.attribute_number(at, name);
  if (!(radius > 0.0)) {
    xml_.fail(at, fmt::format("found {} {:g}, expected a radius above 0 or INF", name, radius));
  }
  return 1.0 / radius;
}

void Reader::add_spiral(const pugi::xml_node& at, std::vector<Vector3d>* out) {
  const std::string type = at.attribute("spiType").value();
  if (type != "clothoid") {
    xml_.fail(at, fmt::format("found a spiral of type '{}', expected clothoid", printable(type)));
  }
  const Vector3d from = place(at, "Start"), to = place(at, "End"), corner = place(at, "PI");
  const double turn = turning(at), length = xml_.attribute_number(at, "length");
  const double first = turn * curvature(at, "radiusStart");
  const double last = turn * curvature(at, "radiusEnd");
  const Vector2d tangent = (corner - from).head<2>();
  if (!(tangent.norm() > 0.0)) xml_.fail(at, "found PI at Start, expected the tangents' corner");
  start(at, out, from);
  const std::size_t count = pieces(at, length, std::max(std::abs(first), std::abs(last)));
  const double heading = std::atan2(tangent.y(), tangent.x());
  const double piece = length / static_cast<double>(count);
  // Simpson's rule on each chord.
  const auto ahead = [&](double s) {
    const double angle = heading + first * s + 0.5 * (last - first) * s * s / length;
    return Vector2d(std::cos(angle), std::sin(angle));
  };
  std::vector<Vector2d> places = {from.head<2>()};
  for (std::size_t i = 0; i < count; ++i) {
    const double s = static_cast<double>(i) * piece;
    places.push_back(places.back() +
                     piece / 6.0 * (ahead(s) + 4.0 * ahead(s + 0.5 * piece) + ahead(s + piece)));
  }
  const Vector2d miss = to.head<2>() - places.back();
  if (miss.norm() * out_.metres > kMiss) {
    xml_.fail(at, fmt::format("found a clothoid that ends {:.3f} m from its End, expected it there",
                              miss.norm() * out_.metres));
  }
  for (std::size_t i = 1; i <= count; ++i) {
    const double share = static_cast<double>(i) / static_cast<double>(count);
    const Vector2d here = places[i] + share * miss;
    add(at, out, {here.x(), here.y(), from.z() + share * (to.z() - from.z())});
  }
}

std::vector<Vector3d> Reader::geometry(const pugi::xml_node& coord_geom) {
  std::vector<Vector3d> out;
  for (const pugi::xml_node& element : coord_geom.children()) {
    const std::string_view name = local_name(element);
    if (name == "Line") add_line(element, &out);
    if (name == "IrregularLine") add_list(element, &out);
    if (name == "Curve") add_curve(element, &out);
    if (name == "Spiral") add_spiral(element, &out);
    if (name == "Chain") {
      xml_.fail(element, "found a Chain, expected Line, Curve, Spiral or IrregularLine");
    }
  }
  return out;
}

void Reader::read_alignments(const pugi::xml_node& node) {
  for (const pugi::xml_node& below : node.children()) {
    const std::string_view name = local_name(below);
    if (name == "Alignments" || name == "PlanFeatures") read_alignments(below);
    if (name != "Alignment" && name != "PlanFeature") continue;
    const pugi::xml_node coord_geom = child(below, "CoordGeom");
    if (!coord_geom) continue;
    LandXmlAlignment alignment;
    alignment.name = below.attribute("name").value();
    if (below.attribute("staStart")) {
      alignment.first_station = xml_.attribute_number(below, "staStart");
    }
    alignment.points = geometry(coord_geom);
    const bool heights =
        std::all_of(alignment.points.begin(), alignment.points.end(),
                    [](const Vector3d& place) { return std::isfinite(place.z()); });
    for (Vector3d& place : alignment.points) {
      if (!heights) place.z() = kNaN;
    }
    if (alignment.points.size() >= 2) out_.alignments.push_back(std::move(alignment));
  }
}

LandXmlFile Reader::read() {
  const pugi::xml_node root = xml_.root();
  if (local_name(root) != "LandXML") {
    throw InputError(xml_.file(), fmt::format("found XML of '{}', expected LandXML",
                                              printable(std::string(root.name()))));
  }
  read_units(root);
  const pugi::xml_node system = child(root, "CoordinateSystem");
  const std::string code = system.attribute("epsgCode").value();
  if (!code.empty() && code.find_first_not_of("0123456789") == std::string::npos) {
    out_.crs = "EPSG:" + code;
  } else if (system.attribute("ogcWktCode")) {
    out_.crs = system.attribute("ogcWktCode").value();
  }
  read_points(root);
  read_alignments(root);
  if (out_.alignments.empty()) {
    throw InputError(xml_.file(), "found no Alignment with CoordGeom, expected one");
  }
  return std::move(out_);
}

}  // namespace

LandXmlFile read_landxml(const std::filesystem::path& path) {
  const XmlFile xml = XmlFile::read(path);
  return Reader(xml).read();
}

LandXmlFile read_landxml_text(std::string text, const std::string& name) {
  const XmlFile xml = XmlFile::parse(std::move(text), name);
  return Reader(xml).read();
}

}  // namespace camber
