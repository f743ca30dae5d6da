// camber profile: height, grade and cross slope along a line on a surface.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/render/result_plots.h"
#include "camber/road/road_profile.h"
#include "camber/scene/results.h"
#include "command.h"
#include "own_inputs.h"
#include "road_arguments.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr double kDegree = M_PI / 180.0;

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }
json percent(double value) { return number(100.0 * value); }

/// Empty for what is not known.
std::string cell(double value, int digits) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : std::string();
}

std::size_t covered_stations(const std::vector<ProfilePoint>& profile) {
  return static_cast<std::size_t>(
      std::count_if(profile.begin(), profile.end(),
                    [](const ProfilePoint& point) { return point.status != Status::kFailed; }));
}

/// The whole result but for its timings.
json profile_json(const Command& command, const RoadSurface& surface,
                  const std::vector<ProfilePoint>& profile, const ProfileOptions& options) {
  json stations = json::array();
  for (const ProfilePoint& p : profile) {
    stations.push_back({{"station", p.station},
                        {"status", to_string(p.status)},
                        {"reason", p.reason},
                        {"patch", p.patch},
                        {"point", {p.point.x(), p.point.y(), p.point.z()}},
                        {"height", number(p.height)},
                        {"grade_percent", percent(p.grade)},
                        {"cross_slope_percent", percent(p.cross_slope)},
                        {"vertical_radius", number(p.vertical_radius)},
                        {"sigma_height", number(p.sigma_height)},
                        {"sigma_grade_percent", percent(p.sigma_grade)},
                        {"sigma_cross_slope_percent", percent(p.sigma_cross_slope)}});
  }
  return {{"version", kVersion},
          {"seed", command.common.seed},
          {"options",
           {{"step", options.step},
            {"length", options.length},
            {"reach", options.reach},
            {"levelling_sigma_deg", options.levelling_sigma / kDegree},
            {"drift_sigma", options.drift_sigma}}},
          {"frame", surface.frame},
          {"metric", surface.metric},
          {"covered_stations", covered_stations(profile)},
          {"stations", std::move(stations)}};
}

}  // namespace

void register_profile(App& root) {
  Command* command =
      add_command(root, "profile", "Height, grade and cross slope along a road",
                  "  camber profile results --out profile.csv\n"
                  "  camber profile results --plot profile.png\n"
                  "  camber profile results --json > profile.json\n"
                  "  camber profile surface --along centreline.csv --step 5 --out profile.json");
  struct Arguments {
    std::string surface, out, plot, line;
    ProfileOptions options;
    double levelling_sigma_deg = options.levelling_sigma / kDegree;
    bool json = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  App& app = *command->app;
  app.add_option("surface", arguments->surface, "result folder, or its surface.json")->required();
  app.add_option("--out", arguments->out, "FILE.csv or FILE.json");
  app.add_option("--plot", arguments->plot,
                 "FILE.png or FILE.svg: height, grade and cross slope with bands of 95 %");
  app.add_option("--along", arguments->line,
                 "points of a line in order (any cloud format; CSV: columns x, y, z or x_m, y_m, "
                 "z_m); default: the driven line of the result");
  app.add_option("--step", arguments->options.step, "metres between stations")
      ->capture_default_str();
  app.add_option("--length", arguments->options.length,
                 "metres of road over which grade and vertical radius are measured")
      ->capture_default_str();
  app.add_option("--reach", arguments->options.reach,
                 "metres that a station may lie beyond a patch's boundary")
      ->capture_default_str();
  app.add_option("--levelling-sigma-deg", arguments->levelling_sigma_deg,
                 "how well the cloud's up is known, degrees: part of the bands")
      ->capture_default_str();
  app.add_option("--drift-sigma", arguments->options.drift_sigma,
                 "metres by which the cloud's heights may drift along the road: part of the bands")
      ->capture_default_str();
  app.add_flag("--json", arguments->json, "print the stations as JSON to stdout");

  command->run = [command, arguments] {
    ProfileOptions options = arguments->options;
    options.levelling_sigma = arguments->levelling_sigma_deg * kDegree;
    options.validate();
    const fs::path out_path = arguments->out;
    const std::string extension = out_path.extension().string();
    const fs::path plot_path = arguments->plot;
    const std::string plot_kind = plot_path.extension().string();
    if (arguments->out.empty() && arguments->plot.empty() && !arguments->json) {
      throw UsageError("found neither --out, --plot nor --json, expected one of them");
    }
    if (!arguments->plot.empty() && plot_kind != ".png" && plot_kind != ".svg") {
      throw UsageError("--plot: found '" + arguments->plot + "', expected FILE.png or FILE.svg");
    }
    if (!arguments->out.empty() && extension != ".csv" && extension != ".json") {
      throw UsageError("--out: found '" + arguments->out + "', expected FILE.csv or FILE.json");
    }
    Timings timings;
    StageTimer load(timings, "load");
    fs::path surface_path = arguments->surface;
    std::error_code ignored;
    refuse_own_inputs({out_path, plot_path}, {surface_path, arguments->line});
    if (fs::is_directory(surface_path, ignored)) surface_path /= "surface.json";
    const RoadSurface surface = read_surface(surface_path);
    std::vector<Eigen::Vector3d> line = surface.driven_line;
    if (!arguments->line.empty()) line = read_line(arguments->line);
    load.stop();
    if (line.size() < 2) {
      throw NoAnswerError(surface_path.string() +
                          ": holds no driven line; give a line with --along FILE");
    }
    const bool moves = std::any_of(line.begin(), line.end(), [&](const Eigen::Vector3d& place) {
      return surface.up.cross(place - line.front()).norm() > 1e-9;
    });
    if (!moves) {
      throw NoAnswerError((arguments->line.empty() ? surface_path.string() : arguments->line) +
                          ": the line does not leave its first point");
    }
    StageTimer compute(timings, "compute");
    const std::vector<ProfilePoint> profile = road_profile(surface, line, options);
    compute.stop();
    const std::size_t covered = covered_stations(profile);
    if (covered == 0) {
      throw NoAnswerError(fmt::format("{}: none of the line's {} stations is covered",
                                      surface_path.string(), profile.size()));
    }

    // Drawn before the first file is written: without an answer nothing is.
    std::string svg;
    Image picture;
    if (!arguments->plot.empty()) {
      const StageTimer draw(timings, "draw");
      const PlotSheet sheet = profile_plots(profile, surface.metric, "Profile of the road");
      if (plot_kind == ".svg") {
        svg = plots_svg(sheet);
      } else {
        picture = draw_plots(sheet, {1200, 360, 20.0});
      }
    }

    StageTimer write(timings, "write");
    AtomicFiles files;
    if (!svg.empty()) {
      write_file_atomically(files.stage(plot_path), svg);
    } else if (!arguments->plot.empty()) {
      write_png(picture, files.stage(plot_path));
    }
    if (extension == ".csv") {
      std::string text =
          "station_m,x,y,z,height_m,grade_percent,cross_slope_percent,vertical_radius_m,"
          "sigma_height_m,sigma_grade_percent,sigma_cross_slope_percent,patch,status\n";
      for (const ProfilePoint& p : profile) {
        text += fmt::format(
            "{:.3f},{:.4f},{:.4f},{:.4f},{},{},{},{},{},{},{},{},{}\n", p.station, p.point.x(),
            p.point.y(), p.point.z(), cell(p.height, 4), cell(100.0 * p.grade, 4),
            cell(100.0 * p.cross_slope, 4), cell(p.vertical_radius, 2), cell(p.sigma_height, 5),
            cell(100.0 * p.sigma_grade, 5), cell(100.0 * p.sigma_cross_slope, 5), p.patch,
            p.status == Status::kFailed ? p.reason : std::string(to_string(p.status)));
      }
      write_file_atomically(files.stage(out_path), text);
    } else if (extension == ".json") {
      json out = profile_json(*command, surface, profile, options);
      out["timings_ms"] = cloud_timings(timings);
      write_json(out, files.stage(out_path));
    }
    files.commit();
    write.stop();
    if (arguments->json) {
      json out = profile_json(*command, surface, profile, options);
      out["timings_ms"] = cloud_timings(timings);
      fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
    }
    if (!command->common.quiet && covered < profile.size()) {
      make_warning_sink(command->common)(fmt::format("{} of {} stations are not covered",
                                                     profile.size() - covered, profile.size()));
    }
    return 0;
  };
}

}  // namespace camber::tools
