#include "profile_crg.h"

#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/export/opencrg.h"
#include "crg_road.h"
#include "own_inputs.h"

using nlohmann::json;

namespace camber::tools {
namespace {

/// The road at one place.
struct CrgHeight {
  Eigen::Vector2d uv, xy;
  double height = 0.0;  ///< m; NaN: none
  std::string status;   ///< ok, beyond, unknown, filled
};

std::string status_of(const CrgRoad& road, const CrgRoad& stored, const CrgHeight& at) {
  const bool inside = at.uv.x() >= road.first_u() && at.uv.x() <= road.last_u() &&
                      at.uv.y() >= road.right() && at.uv.y() <= road.left();
  if (!inside) return "beyond";
  if (std::isnan(at.height)) return "unknown";
  return is_filled(road, stored, at.uv) ? "filled" : "ok";
}

/// The nodes of the reference line, where no places are given.
CrgPlaces reference_line(const CrgRoad& road) {
  CrgPlaces out;
  for (std::size_t i = 0; i < road.sections(); ++i) {
    out.places.emplace_back(road.first_u() + static_cast<double>(i) * road.increment(), 0.0);
  }
  return out;
}

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

std::string csv(const std::vector<CrgHeight>& heights) {
  std::string text = "u_m,v_m,x_m,y_m,height_m,status\n";
  for (const CrgHeight& h : heights) {
    text += fmt::format("{},{},{},{},{},{}\n", h.uv.x(), h.uv.y(), h.xy.x(), h.xy.y(),
                        std::isfinite(h.height) ? fmt::format("{}", h.height) : std::string(),
                        h.status);
  }
  return text;
}

}  // namespace

int profile_crg(const Command& command, const CrgProfileArguments& args) {
  args.output.require();
  Timings timings;
  StageTimer load(timings, "load");
  const CrgData data = read_crg(args.file);
  refuse_own_inputs({args.output.out}, data.files);
  const LogSink warn = make_warning_sink(command.common);
  for (const std::string& remark : data.remarks) {
    if (warn) warn(args.file + ": " + remark);
  }
  const CrgRoad road(data, !args.as_stored), stored(data, false);
  const CrgPlaces places = args.line.empty() ? reference_line(road) : read_crg_places(args.line);
  load.stop();
  StageTimer compute(timings, "compute");
  std::vector<CrgHeight> heights;
  std::size_t known = 0;
  for (const Eigen::Vector2d& place : places.places) {
    CrgHeight at;
    at.uv = places.by_uv ? place : road.coordinates(place.x(), place.y());
    at.xy = places.by_uv ? road.position(place.x(), place.y()) : place;
    at.height = road.height(at.uv.x(), at.uv.y());
    at.status = status_of(road, stored, at);
    known += std::isfinite(at.height);
    heights.push_back(std::move(at));
  }
  compute.stop();
  if (known == 0) {
    throw NoAnswerError(
        fmt::format("{}: no height at any of {} places", args.file, heights.size()));
  }
  json result = {{"version", kVersion},
                 {"seed", command.common.seed},
                 {"options", {{"as_stored", args.as_stored}}},
                 {"file", args.file},
                 {"frame", "plan"},
                 {"metric", true},
                 {"known", known}};
  json rows = json::array();
  for (const CrgHeight& h : heights) {
    rows.push_back({{"u", h.uv.x()},
                    {"v", h.uv.y()},
                    {"x", h.xy.x()},
                    {"y", h.xy.y()},
                    {"height", number(h.height)},
                    {"status", h.status}});
  }
  result["places"] = std::move(rows);
  args.output.write([&] { return csv(heights); }, std::move(result), timings);
  if (known < heights.size() && warn) {
    warn(fmt::format("{} of {} places have no height", heights.size() - known, heights.size()));
  }
  return 0;
}

}  // namespace camber::tools
