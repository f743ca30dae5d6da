#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <pugixml.hpp>
#include <sstream>

#include "camber/core/version.h"
#include "camber/export/opendrive.h"

namespace camber {

std::string proj_string_of(const std::string& definition) {
  const std::string code = "EPSG:";
  if (definition.rfind(code, 0) != 0) return definition;
  const std::string digits = definition.substr(code.size());
  const bool number = digits.size() == 5 && std::all_of(digits.begin(), digits.end(), [](char c) {
                        return c >= '0' && c <= '9';
                      });
  const int epsg = number ? std::stoi(digits) : 0, zone = epsg % 100;
  const bool north = epsg / 100 == 326, south = epsg / 100 == 327;
  if (!(north || south) || zone < 1 || zone > 60) return definition;
  return fmt::format("+proj=utm +zone={}{} +datum=WGS84 +units=m +no_defs", zone,
                     south ? " +south" : "");
}
namespace {

using pugi::xml_node;

/// Numbers that read back as they are, without an exponent's surprises.
void put(xml_node node, const char* name, double value) {
  node.append_attribute(name).set_value(fmt::format("{:.15g}", value == 0.0 ? 0.0 : value).c_str());
}

void put(xml_node node, const char* name, const std::string& value) {
  node.append_attribute(name).set_value(value.c_str());
}

void put_cubic(xml_node node, const char* station, const CubicRecord& record) {
  put(node, station, record.s);
  put(node, "a", record.a);
  put(node, "b", record.b);
  put(node, "c", record.c);
  put(node, "d", record.d);
}

void put_plan(xml_node road, const std::vector<PlanPiece>& pieces) {
  xml_node plan = road.append_child("planView");
  for (const PlanPiece& piece : pieces) {
    xml_node geometry = plan.append_child("geometry");
    put(geometry, "s", piece.s);
    put(geometry, "x", piece.x);
    put(geometry, "y", piece.y);
    put(geometry, "hdg", piece.heading);
    put(geometry, "length", piece.length);
    if (piece.straight) {
      geometry.append_child("line");
      continue;
    }
    xml_node cubic = geometry.append_child("paramPoly3");
    const char* const names[2][4] = {{"aU", "bU", "cU", "dU"}, {"aV", "bV", "cV", "dV"}};
    for (int k = 0; k < 4; ++k) put(cubic, names[0][k], piece.u[k]);
    for (int k = 0; k < 4; ++k) put(cubic, names[1][k], piece.v[k]);
    put(cubic, "pRange", "normalized");
  }
}

void put_lane(xml_node side, int id, const std::vector<CubicRecord>& width,
              const std::vector<CubicRecord>& height) {
  xml_node lane = side.append_child("lane");
  put(lane, "id", std::to_string(id));
  put(lane, "type", id == 0 ? "none" : "driving");
  put(lane, "level", "false");
  for (const CubicRecord& record : width) put_cubic(lane.append_child("width"), "sOffset", record);
  const bool raised = std::any_of(height.begin(), height.end(), [](const CubicRecord& record) {
    return std::abs(record.a) > 5e-4;
  });
  if (!raised) return;
  const auto put_height = [&](double s, double outer) {
    xml_node node = lane.append_child("height");
    put(node, "sOffset", s);
    put(node, "inner", 0.0);
    put(node, "outer", outer);
  };
  for (const CubicRecord& record : height) put_height(record.s, record.a);
}

/// Station and offset of a place: the nearest one of the plan view.
void locate(const OpenDriveRoad& road, const Eigen::Vector2d& place, double* s, double* t,
            double* heading) {
  double least = std::numeric_limits<double>::infinity();
  for (const PlanPiece& piece : road.plan) {
    const int parts = std::max(4, static_cast<int>(piece.length / 0.05));
    for (int k = 0; k <= parts; ++k) {
      const double p = static_cast<double>(k) / parts;
      const Eigen::Vector2d d = place - piece.at(p), ahead = piece.direction(p).normalized();
      if (d.norm() >= least) continue;
      least = d.norm();
      // The rest of a part along the tangent.
      *s = std::clamp(piece.s + p * piece.length + d.dot(ahead), 0.0, road.length);
      *t = ahead.x() * d.y() - ahead.y() * d.x();
      *heading = std::atan2(ahead.y(), ahead.x());
    }
  }
}

double elevation_at(const OpenDriveRoad& road, double s, double t) {
  const auto at = [&](const std::vector<CubicRecord>& records) -> const CubicRecord& {
    std::size_t i = 0;
    while (i + 1 < records.size() && records[i + 1].s <= s) ++i;
    return records[i];
  };
  const CubicRecord& level = at(road.elevation);
  const double tilt = at(road.superelevation).value(s), grade = level.slope(s);
  return level.value(s) + t * std::tan(tilt) * std::sqrt(1.0 + grade * grade);
}

void put_vehicles(xml_node road_node, const OpenDriveRoad& road) {
  if (road.vehicles.empty()) return;
  xml_node objects = road_node.append_child("objects");
  for (const RoadsideVehicle& vehicle : road.vehicles) {
    double s = 0.0, t = 0.0, heading = 0.0;
    locate(road, vehicle.bottom.head<2>(), &s, &t, &heading);
    xml_node object = objects.append_child("object");
    put(object, "id", std::to_string(vehicle.id));
    put(object, "name", vehicle.name);
    put(object, "type", "obstacle");
    put(object, "s", s);
    put(object, "t", t);
    put(object, "zOffset", vehicle.bottom.z() - elevation_at(road, s, t));
    put(object, "orientation", "none");
    put(object, "hdg", std::remainder(vehicle.heading - heading, 2.0 * M_PI));
    put(object, "pitch", vehicle.pitch);
    put(object, "roll", vehicle.roll);
    put(object, "length", vehicle.length);
    put(object, "width", vehicle.width);
    put(object, "height", vehicle.height);
    put(object, "validLength", 0.0);
    put(object, "dynamic", "no");
  }
}

}  // namespace

std::string encode_opendrive(const OpenDriveRoad& road) {
  pugi::xml_document document;
  xml_node declaration = document.append_child(pugi::node_declaration);
  put(declaration, "version", "1.0");
  put(declaration, "encoding", "UTF-8");
  xml_node root = document.append_child("OpenDRIVE");
  xml_node header = root.append_child("header");
  put(header, "revMajor", "1");
  put(header, "revMinor", "7");
  put(header, "name", road.name);
  put(header, "version", "1.00");
  put(header, "vendor", std::string("Camber ") + kVersion);
  if (!road.geo_reference.empty()) {
    header.append_child("geoReference")
        .append_child(pugi::node_cdata)
        .set_value(road.geo_reference.c_str());
  }
  xml_node node = root.append_child("road");
  put(node, "name", road.name);
  put(node, "length", road.length);
  put(node, "id", "1");
  put(node, "junction", "-1");
  put_plan(node, road.plan);
  xml_node elevation = node.append_child("elevationProfile");
  for (const CubicRecord& record : road.elevation) {
    put_cubic(elevation.append_child("elevation"), "s", record);
  }
  xml_node lateral = node.append_child("lateralProfile");
  for (const CubicRecord& record : road.superelevation) {
    put_cubic(lateral.append_child("superelevation"), "s", record);
  }
  xml_node section = node.append_child("lanes").append_child("laneSection");
  put(section, "s", 0.0);
  put_lane(section.append_child("left"), 1, road.left_width, road.left_height);
  put_lane(section.append_child("center"), 0, {}, {});
  put_lane(section.append_child("right"), -1, road.right_width, road.right_height);
  put_vehicles(node, road);
  if (!road.crg_file.empty()) {
    xml_node crg = node.append_child("surface").append_child("CRG");
    put(crg, "file", road.crg_file);
    put(crg, "sStart", 0.0);
    put(crg, "sEnd", road.length);
    put(crg, "orientation", "same");
    // Its own reference line and inertial coordinates, those of this file.
    put(crg, "mode", "global");
    put(crg, "purpose", "elevation");
  }
  std::ostringstream out;
  document.save(out, "  ");
  return out.str();
}

}  // namespace camber
