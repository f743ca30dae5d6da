#include "camber/export/profile_table.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <vector>

#include "camber/core/status.h"
#include "camber/core/version.h"

using nlohmann::json;

namespace camber {
namespace {

constexpr double kDegree = M_PI / 180.0;
constexpr double kBand = 1.96;  // sigmas on either side of a 95 % band

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

/// One number of a cross-section, as it stands in files.
struct Quantity {
  std::string name;
  double CrossSection::*value;
  double CrossSection::*sigma;  ///< nullptr: none
  enum class Kind { kLength, kSlope, kPlain } kind;
  int digits;
};

std::vector<Quantity> quantities(bool crown) {
  using Kind = Quantity::Kind;
  std::vector<Quantity> out = {
      {"height", &CrossSection::height, &CrossSection::sigma_height, Kind::kLength, 4},
      {"grade", &CrossSection::grade, &CrossSection::sigma_grade, Kind::kSlope, 4},
      {"cross_slope", &CrossSection::cross_slope, &CrossSection::sigma_cross_slope, Kind::kSlope,
       4}};
  if (crown) {
    out.push_back({"cross_slope_left", &CrossSection::cross_slope_left,
                   &CrossSection::sigma_cross_slope_left, Kind::kSlope, 4});
    out.push_back({"cross_slope_right", &CrossSection::cross_slope_right,
                   &CrossSection::sigma_cross_slope_right, Kind::kSlope, 4});
    out.push_back({"crest_offset", &CrossSection::crest, nullptr, Kind::kLength, 2});
  }
  out.push_back({"vertical_curvature", &CrossSection::vertical_curvature,
                 &CrossSection::sigma_vertical_curvature, Kind::kPlain, 6});
  out.push_back({"vertical_radius", &CrossSection::vertical_radius, nullptr, Kind::kLength, 2});
  out.push_back({"width_left", &CrossSection::width_left, nullptr, Kind::kLength, 2});
  out.push_back({"width_right", &CrossSection::width_right, nullptr, Kind::kLength, 2});
  return out;
}

/// Names with their units and values of a quantity at a station: the value, its sigma and its band,
/// slopes in per cent and in degrees.
struct Cell {
  std::string name;
  double value;
  int digits;
};
std::vector<Cell> cells(const Quantity& q, const CrossSection& at, bool metric) {
  std::vector<Cell> out;
  const double value = at.*q.value, sigma = q.sigma ? at.*q.sigma : 0.0;
  const auto add = [&](const std::string& unit, int digits, auto convert, double spread) {
    out.push_back({q.name + unit, convert(value), digits});
    if (!q.sigma) return;
    out.push_back({"sigma_" + q.name + unit, spread, digits + 1});
    out.push_back({q.name + "_low" + unit, convert(value - kBand * sigma), digits});
    out.push_back({q.name + "_high" + unit, convert(value + kBand * sigma), digits});
  };
  if (q.kind == Quantity::Kind::kSlope) {
    add(
        "_percent", q.digits, [](double slope) { return 100.0 * slope; }, 100.0 * sigma);
    add(
        "_deg", q.digits, [](double slope) { return std::atan(slope) / kDegree; },
        sigma / (1.0 + value * value) / kDegree);
  } else {
    const bool length = q.kind == Quantity::Kind::kLength;
    add(
        !metric  ? ""
        : length ? "_m"
                 : "_per_m",
        q.digits, [](double plain) { return plain; }, sigma);
  }
  return out;
}

}  // namespace

std::string sections_csv(const CloudProfile& profile, bool metric, bool crown) {
  const std::vector<Quantity> all = quantities(crown);
  std::string text = metric ? "station_m,x,y,z" : "station,x,y,z";
  for (const Quantity& q : all) {
    for (const Cell& cell : cells(q, CrossSection(), metric)) text += "," + cell.name;
  }
  text += metric ? ",measured_left_m,measured_right_m" : ",measured_left,measured_right";
  text += ",points,status,reason\n";
  for (const CrossSection& at : profile.stations) {
    const auto plain = [](double value, int digits) {
      return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : std::string();
    };
    text += fmt::format("{:.3f},{:.4f},{:.4f},", at.station, at.point.x(), at.point.y());
    text += std::isfinite(at.height) ? fmt::format("{:.4f}", at.point.z()) : std::string();
    for (const Quantity& q : all) {
      for (const Cell& cell : cells(q, at, metric)) text += "," + plain(cell.value, cell.digits);
    }
    text += fmt::format(",{:.2f},{:.2f},{},{},\"{}\"\n", at.measured_left, at.measured_right,
                        at.points, to_string(at.status), at.reason);
  }
  return text;
}

namespace {

json stations_json(const CloudProfile& profile, bool crown) {
  json stations = json::array();
  const std::vector<Quantity> all = quantities(crown);
  for (const CrossSection& at : profile.stations) {
    json row = {{"station", at.station},
                {"status", to_string(at.status)},
                {"reason", at.reason},
                {"point",
                 {at.point.x(), at.point.y(),
                  std::isfinite(at.height) ? json(at.point.z()) : json(nullptr)}},
                {"points", at.points},
                {"measured_left", at.measured_left},
                {"measured_right", at.measured_right},
                {"section", {{"offsets", at.offsets}, {"heights", at.heights}}}};
    for (const Quantity& q : all) {
      // Lengths in JSON have no suffix.
      for (const Cell& cell : cells(q, at, false)) row[cell.name] = number(cell.value);
    }
    stations.push_back(std::move(row));
  }
  return stations;
}

}  // namespace

std::size_t answered_stations(const CloudProfile& profile) {
  return static_cast<std::size_t>(
      std::count_if(profile.stations.begin(), profile.stations.end(),
                    [](const CrossSection& at) { return at.status != Status::kFailed; }));
}

json sections_json(const CloudProfile& profile, const CloudProfileOptions& options,
                   const ProfiledPoints& of, std::uint64_t seed) {
  return {{"version", kVersion},
          {"seed", seed},
          {"options",
           {{"step", options.profile.step},
            {"length", options.profile.length},
            {"half_width", options.half_width},
            {"crown", options.crown},
            {"ground_from", of.ground_from},
            {"levelling_sigma_deg", options.profile.levelling_sigma / kDegree},
            {"drift_sigma", options.profile.drift_sigma}}},
          {"file", of.file},
          {"along", of.along},
          {"metric", of.metric},
          {"level", of.level},
          {"ground_from", to_string(of.ground->source)},
          {"ground_points", of.ground->points.size()},
          {"noise", number(profile.noise)},
          {"density", profile.density},
          {"covered_stations", answered_stations(profile)},
          {"stations", stations_json(profile, options.crown)}};
}

}  // namespace camber
