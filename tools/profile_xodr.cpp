#include "profile_xodr.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/export/opendrive_reader.h"

using nlohmann::json;

namespace camber::tools {
namespace {

struct Station {
  double s, x, y, z, heading, curvature, grade, superelevation, left, right;
};

std::vector<Station> stations_along(const XodrRoad& road, double step) {
  const double most = 1e6;
  if (road.length / step > most) {
    throw UsageError(
        fmt::format("--step: found {} m on a road of {:.0f} m, expected at most {:.0f} "
                    "stations",
                    step, road.length, most));
  }
  const XodrSurface surface(road);
  std::vector<Station> out;
  const auto add = [&](double s) {
    const Eigen::Vector2d at = surface.position(s);
    out.push_back({s, at.x(), at.y(), surface.elevation(s), surface.heading(s),
                   surface.curvature(s), surface.grade(s), surface.superelevation(s),
                   surface.left(s), surface.right(s)});
  };
  for (std::size_t i = 0; static_cast<double>(i) * step < road.length - 1e-9; ++i) {
    add(static_cast<double>(i) * step);
  }
  add(road.length);
  return out;
}

std::string csv(const std::vector<Station>& stations) {
  std::string text =
      "station_m,x_m,y_m,height_m,heading_deg,curvature_per_m,grade_percent,"
      "superelevation_percent,width_left_m,width_right_m\n";
  for (const Station& p : stations) {
    text += fmt::format("{:.3f},{:.4f},{:.4f},{:.5f},{:.5f},{:.8f},{:.5f},{:.5f},{:.4f},{:.4f}\n",
                        p.s, p.x, p.y, p.z, p.heading * 180.0 / M_PI, p.curvature, 100.0 * p.grade,
                        100.0 * std::tan(p.superelevation), p.left, p.right);
  }
  return text;
}

/// The road that is asked for, or the only one.
const XodrRoad& road_of(const XodrFile& file, const XodrProfileArguments& args) {
  if (args.road.empty() && file.roads.size() == 1) return file.roads.front();
  try {
    return file.road(args.road);
  } catch (const std::invalid_argument& error) {
    throw UsageError(fmt::format("{}: --{}", args.file, error.what()));
  }
}

}  // namespace

int profile_xodr(const Command& command, const XodrProfileArguments& args) {
  args.output.require();
  Timings timings;
  StageTimer load(timings, "load");
  const XodrFile file = read_xodr(args.file);
  const XodrRoad& road = road_of(file, args);
  load.stop();
  StageTimer compute(timings, "compute");
  const std::vector<Station> stations = stations_along(road, args.step);
  compute.stop();
  const LogSink warn = make_warning_sink(command.common);
  if (road.shapes && warn) {
    warn(args.file +
         ": lateral shapes (<shape>) are not read: the road is level across but for "
         "superelevation, crossfall and lanes' heights");
  }
  json result = {{"version", kVersion},
                 {"seed", command.common.seed},
                 {"options", {{"road", road.id}, {"step", args.step}}},
                 {"file", args.file},
                 {"frame", "plan"},
                 {"level", "map"},
                 {"metric", true},
                 {"geo_reference", file.geo_reference},
                 {"road", road.id},
                 {"length", road.length}};
  json rows = json::array();
  for (const Station& p : stations) {
    rows.push_back({{"station", p.s},
                    {"point", {p.x, p.y, p.z}},
                    {"height", p.z},
                    {"heading_deg", p.heading * 180.0 / M_PI},
                    {"curvature", p.curvature},
                    {"grade_percent", 100.0 * p.grade},
                    {"superelevation_percent", 100.0 * std::tan(p.superelevation)},
                    {"width_left", p.left},
                    {"width_right", p.right}});
  }
  result["stations"] = std::move(rows);
  args.output.write([&] { return csv(stations); }, std::move(result), timings);
  return 0;
}

}  // namespace camber::tools
