#include "camber/cloud/las_names.h"

#include <iterator>
#include <string>
#include <utility>

#include "camber/core/lower_case.h"

namespace camber {

std::string_view las_attribute(std::string_view name) {
  static constexpr std::pair<std::string_view, std::string_view> kNames[] = {
      {"intensity", "intensity"},
      {"returnnumber", "return_number"},
      {"returnnum", "return_number"},
      {"numberofreturns", "number_of_returns"},
      {"numreturns", "number_of_returns"},
      {"numofreturns", "number_of_returns"},
      {"classflags", "class_flags"},
      {"scannerchannel", "scanner_channel"},
      {"scanchannel", "scanner_channel"},
      {"scandirectionflag", "scan_direction_flag"},
      {"scandirection", "scan_direction_flag"},
      {"edgeofflightline", "edge_of_flight_line"},
      {"edgeflightline", "edge_of_flight_line"},
      {"flightlineedge", "edge_of_flight_line"},
      {"classification", "classification"},
      {"rawclassification", "classification"},
      {"userdata", "user_data"},
      {"scanangle", "scan_angle"},
      {"scananglerank", "scan_angle_rank"},
      {"pointsourceid", "point_source_id"},
      {"gpstime", "gps_time"},
      {"nir", "nir"},
      {"infrared", "nir"},
      {"nearinfrared", "nir"},
      {"synthetic", "synthetic"},
      {"syntheticflag", "synthetic"},
      {"keypoint", "key_point"},
      {"keypointflag", "key_point"},
      {"withheld", "withheld"},
      {"withheldflag", "withheld"},
      {"overlap", "overlap"},
      {"overlapflag", "overlap"},
  };
  std::string bare;
  for (const char c : lower_case(name)) {
    if (c != '_' && c != ' ' && c != '-') bare += c;
  }
  constexpr std::string_view kScalar = "scalar";  // CloudCompare's scalar fields in PLY files
  if (bare.rfind(kScalar, 0) == 0) bare.erase(0, kScalar.size());
  for (const auto& [known, attribute] : kNames) {
    if (bare == known) return attribute;
  }
  return {};
}

std::string_view las_class_name(int number) {
  static constexpr std::string_view kNames[] = {"never classified",
                                                "unclassified",
                                                "ground",
                                                "low vegetation",
                                                "medium vegetation",
                                                "high vegetation",
                                                "building",
                                                "low noise",
                                                "reserved (model key)",
                                                "water",
                                                "rail",
                                                "road surface",
                                                "reserved (overlap)",
                                                "wire guard",
                                                "wire conductor",
                                                "transmission tower",
                                                "wire connector",
                                                "bridge deck",
                                                "high noise",
                                                "overhead structure",
                                                "ignored ground",
                                                "snow",
                                                "temporal exclusion"};
  if (number >= 0 && static_cast<std::size_t>(number) < std::size(kNames)) return kNames[number];
  return number < 64 ? "reserved" : "user defined";
}

}  // namespace camber
