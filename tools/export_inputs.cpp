#include "export_inputs.h"

#include <fmt/format.h>

#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"
#include "camber/core/protected_inputs.h"
#include "camber/scene/results.h"
#include "crs.h"

namespace fs = std::filesystem;

namespace camber::tools {
bool is_surface(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(path, error) || path.extension() == ".json";
}

namespace {

RoadExtent extent_of(const ExportArguments& args) {
  return {args.tolerance, args.ahead, args.grid.left, args.grid.right, args.grid.widest};
}

/// The system of --crs for a result that states none.
void take_crs(const ExportArguments& args, const RoadSurface& surface, ExportInputs* in) {
  if (args.reading.crs.empty()) return;
  if (in->on_map) {
    throw UsageError("--crs: the result lies on the map of " + in->geo_reference.substr(0, 80) +
                     ", which import was given; export keeps it");
  }
  if (surface.frame == "camera") {
    throw UsageError(
        "--crs: the result lies in its camera's frame, nowhere on a map; give import --gnss");
  }
  in->geo_reference = definition_of(crs_from_option(args.reading.crs));
  in->described = fmt::format("frame of the result: {}, level: {}", in->geo_reference, in->level);
}

ExportInputs load_surface(const ExportArguments& args, const CommonOptions& common,
                          ExportArguments* settled) {
  fs::path file;
  std::vector<Eigen::Vector3d> line;
  if (!args.line.empty()) line = read_line(args.line);
  RoadSurface surface = read_surface_along(args.input, line, args.reach, &file);
  if (args.line.empty()) line = surface.driven_line;
  if (!args.line.empty() && surface.metric) {
    take_line_as_road(args.line, line, args.reach, make_warning_sink(common), &surface);
  }
  ExportInputs in = road_of_surface(file, surface, line, args.reach);
  protect_inputs(in.files);
  take_crs(args, surface, &in);
  if (settled->grid.step_u == 0.0) settled->grid.step_u = in.step;
  if (settled->grid.step_v == 0.0) settled->grid.step_v = in.step;
  return in;
}

/// Whether the points of a file have a z.
bool has_heights(const fs::path& file) {
  return find_roles(open_point_source(file)->header().fields).position[2] >= 0;
}

ExportInputs load_cloud(const ExportArguments& args, const CommonOptions& common) {
  if (args.line.empty()) {
    throw UsageError("found a cloud without --along FILE, expected a line along which to export");
  }
  CloudFile file = read_cloud_file(args.input, args.reading.read_options());
  const LogSink warn = make_warning_sink(common);
  warn_about(args.input, file.report, warn);
  use_metres(args.input, &file, warn);
  if (!file.cloud.metric) {
    throw NoAnswerError(args.input +
                        ": the cloud is not in metres, as roads for other programs are");
  }
  const std::vector<Eigen::Vector3d> line = read_line(args.line, file.report.crs);
  ExportInputs in = leading_somewhere(args, [&] {
    return road_of_cloud(file.cloud, args.up.up(file.cloud), line, has_heights(args.line),
                         extent_of(args));
  });
  if (const std::optional<CoordinateSystem> crs = crs_in_use(args.input, file.report, warn)) {
    in.geo_reference = definition_of(*crs);
  }
  in.files = {args.input};
  return in;
}

}  // namespace

ExportInputs load_export(const ExportArguments& args, const CommonOptions& common,
                         ExportArguments* settled) {
  ExportInputs in =
      is_surface(args.input) ? load_surface(args, common, settled) : load_cloud(args, common);
  if (!args.tolerance_given) {
    settled->tolerance = line_tolerance(in.line, args.tolerance);
  }
  return in;
}

/// Colours of the cloud that an input is or holds, if it has any.
std::unique_ptr<ColorSource> colors_of(const ExportArguments& args, const ExportInputs& in) {
  const bool of_result = is_surface(args.input);
  const fs::path cloud = of_result ? cloud_of_result(in.files.front()) : fs::path(args.input);
  if (cloud.empty()) return nullptr;
  // As the heights were read: the same columns, in metres.
  CloudFile file = read_cloud_file(cloud, of_result ? ReadOptions() : args.reading.read_options());
  use_metres(cloud.string(), &file, {});
  if (file.cloud.colors.empty()) return nullptr;
  const PlanCorridor where = corridor_of(in.line, extent_of(args));
  return std::make_unique<ColorSource>(file.cloud, in.frame, &where);
}

}  // namespace camber::tools
