#include "gnss_arguments.h"

#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "crs.h"

namespace camber::tools {

GnssOptions GnssArguments::take(double up_sigma) const {
  GnssOptions out = options;
  out.file = file;
  if (!crs.empty()) out.crs = map_crs_from_option(crs);
  if (antenna.size() == 3) out.antenna = {antenna[0], antenna[1], antenna[2]};
  out.heading_sigma = up_sigma;
  out.projection = project_to_map;
  return out;
}

void add_gnss_options(App& app, GnssArguments& a) {
  app.add_option("--gnss", a.file,
                 "positions on the earth: GPX, NMEA, RTKLIB's .pos, CSV (latitude, longitude, "
                 "altitude by time or "
                 "frame), or KITTI's oxts, which has headings, too");
  app.add_option("--gnss-offset", a.options.offset,
                 "seconds to add to the times of --gnss; first: the log starts with the first "
                 "frame")
      ->no_name()
      ->needs("--gnss");
  app.add_option("--gnss-sigma", a.options.sigma,
                 "standard deviation of a position east and north, m, where the file states none")
      ->check(positive_number())
      ->capture_default_str()
      ->needs("--gnss");
  app.add_option("--antenna", a.antenna, "place x,y,z of the receiver in the camera's frame, m")
      ->delimiter(',')
      ->expected(3)
      ->needs("--gnss");
  app.add_option(
         "--crs", a.crs,
         "projected coordinate system of the map: EPSG:n, well-known text, a PROJ string or "
         "a file; default: the UTM zone of the first position")
      ->needs("--gnss");
}

TelemetryOptions TelemetryArguments::take() const {
  TelemetryOptions out;
  out.use = !left_out;
  if (!offset.empty()) out.offset = std::stod(offset);
  return out;
}

void add_telemetry_options(App& app, TelemetryArguments& a) {
  app.add_flag("--no-telemetry", a.left_out,
               "leave what was recorded with a film alone: positions, speeds and gravity of "
               "GoPro's track in it, else of the .gpx, .nmea or .srt beside it under its name");
  app.add_option("--telemetry-offset", a.offset,
                 "seconds to add to the times of that track or of subtitles; of a GPX or NMEA log: "
                 "when its first position was, since the first frame; default: by the time at "
                 "which the film says it was made, where the log covers it")
      ->type_name("FLOAT")
      ->check(finite_number())
      ->excludes("--no-telemetry");
}

void add_telemetry_json(const TelemetryArguments& a, nlohmann::json* options) {
  (*options)["no_telemetry"] = a.left_out;
  (*options)["telemetry_offset"] =
      a.offset.empty() ? nlohmann::json() : nlohmann::json(std::stod(a.offset));
}

void check_up_sigma(const App& app, const std::string& up, const GnssArguments& gnss) {
  if (app.count("--up-sigma-deg") == 0 || !up.empty() || !gnss.file.empty()) return;
  throw UsageError("--up-sigma-deg: found neither --up nor --gnss, expected one of them");
}

void add_gnss_json(const GnssArguments& a, nlohmann::json* options) {
  (*options)["gnss"] = a.file;
  (*options)["gnss_offset"] = a.options.offset;
  (*options)["gnss_sigma"] = a.options.sigma;
  (*options)["antenna"] = a.antenna;
  (*options)["crs"] = a.crs;
}

}  // namespace camber::tools
