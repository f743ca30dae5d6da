#pragma once

#include <map>
#include <string>
#include <vector>

#include "camber/scene/results.h"

namespace camber {

/// The vehicles of one frame in words, the nearest first: "car 0  15.8 ± 0.2 m ahead, 1.2 m left",
/// with one standard deviation and, where it is not ok, the status. Vehicles without a place are
/// left out.
/// @param frame  its id; of a frame without vehicles nothing is returned.
std::vector<std::string> vehicle_lines(const VehicleDocument& document, int frame);

/// All vehicles as CSV, a row each, by frames and rows of vehicles.json: frame, time (s, empty
/// where not known), number (VehicleNumbers), id, track, class, status, the centre ahead, to the
/// right and down with standard deviations, length, width, height, rotation_y_deg, box; empty
/// fields where a number is not known. Lines end in CR LF (RFC 4180).
/// @param times  s, by frame id.
std::string vehicles_csv(const VehicleDocument& document, const std::map<int, double>& times);

}  // namespace camber
