#include "camber/scene/vehicle_table.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>

#include "camber/core/csv_field.h"
#include "camber/scene/vehicle_numbers.h"

namespace camber {
namespace {

constexpr double kDegrees = 57.29577951308232;

/// Enough digits for the standard deviation to show.
int decimals_for(double sigma) { return sigma > 0.0 && sigma < 0.095 ? 2 : 1; }

std::string described(const VehicleEstimate& vehicle, int number, bool metric) {
  const Eigen::Vector3d center = vehicle.pose.center();
  const char* unit = metric ? "m" : "units";
  const double sigma = std::sqrt(vehicle.covariance(2, 2));
  const bool stated = std::isfinite(sigma) && sigma > 0.0;
  const int digits = decimals_for(stated ? sigma : 1.0);
  std::string out =
      fmt::format("{:<8} {:5.{}f}", vehicle_name(vehicle, number), center.z(), digits);
  if (stated) out += fmt::format(" ± {:.{}f}", sigma, digits);
  out += fmt::format(" {} ahead, {:.1f} {} {}", unit, std::abs(center.x()), unit,
                     center.x() < 0.0 ? "left" : "right");
  if (vehicle.status == Status::kOk) return out;
  out += fmt::format(" ({}", to_string(vehicle.status));
  return out + (vehicle.reason.empty() ? ")" : ": " + vehicle.reason + ")");
}

std::string number_field(double value, int digits = 3) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : std::string();
}

}  // namespace

std::vector<std::string> vehicle_lines(const VehicleDocument& document, int frame) {
  const auto at = std::find_if(document.frames.begin(), document.frames.end(),
                               [&](const VehicleFrame& f) { return f.id == frame; });
  if (at == document.frames.end()) return {};
  const VehicleNumbers numbers(document);
  std::vector<const VehicleEstimate*> placed;
  for (const VehicleEstimate& vehicle : at->vehicles) {
    if (vehicle.pose.center().allFinite() && vehicle.status != Status::kFailed) {
      placed.push_back(&vehicle);
    }
  }
  std::stable_sort(placed.begin(), placed.end(),
                   [](const VehicleEstimate* a, const VehicleEstimate* b) {
                     return a->pose.center().z() < b->pose.center().z();
                   });
  std::vector<std::string> out;
  for (const VehicleEstimate* vehicle : placed) {
    out.push_back(described(*vehicle, numbers.of(frame, *vehicle), document.metric));
  }
  return out;
}

std::string vehicles_csv(const VehicleDocument& document, const std::map<int, double>& times) {
  const char* unit = document.metric ? "m" : "units";
  std::string out = "frame,time_s,number,id,track,class,status";
  for (const char* column : {"ahead", "ahead_sigma", "right", "right_sigma", "down", "down_sigma",
                             "length", "width", "height"}) {
    out += fmt::format(",{}_{}", column, unit);
  }
  out += ",rotation_y_deg,x1_px,y1_px,x2_px,y2_px\r\n";
  const VehicleNumbers numbers(document);
  for (const VehicleFrame& frame : document.frames) {
    const auto time = times.find(frame.id);
    for (const VehicleEstimate& v : frame.vehicles) {
      const Eigen::Vector3d center = v.pose.center();
      const Dimensions& size = v.pose.dimensions;
      std::vector<std::string> row = {std::to_string(frame.id),
                                      time == times.end() ? "" : number_field(time->second),
                                      std::to_string(numbers.of(frame.id, v)),
                                      std::to_string(v.id),
                                      v.track >= 0 ? std::to_string(v.track) : "",
                                      csv_field(v.vehicle_class),
                                      std::string(to_string(v.status))};
      for (const int axis : {2, 0, 1}) {
        row.push_back(number_field(center[axis]));
        row.push_back(number_field(std::sqrt(v.covariance(axis, axis))));
      }
      for (const double value : {size.length, size.width, size.height}) {
        row.push_back(number_field(value));
      }
      row.push_back(
          number_field(kDegrees * rotation_y(v.pose.camera_from_vehicle.rotation_matrix()), 2));
      for (const double value : {v.box.x1, v.box.y1, v.box.x2, v.box.y2}) {
        row.push_back(number_field(value, 1));
      }
      out += fmt::format("{}\r\n", fmt::join(row, ","));
    }
  }
  return out;
}

}  // namespace camber
