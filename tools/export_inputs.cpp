#include "export_inputs.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"
#include "camber/core/protected_inputs.h"
#include "camber/scene/results.h"
#include "crs.h"
#include "result_map.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

constexpr double kFinest = 0.1;         // m, steps over patches, which are planes
constexpr double kScatters = 5.0;       // standard deviations that no point of a line is off by
constexpr double kMostTolerance = 0.3;  // m, unless more is asked for
constexpr double kSupport = 10.0;       // m beside the road whose points may count for its edge

}  // namespace

bool is_surface(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(path, error) || path.extension() == ".json";
}

namespace {

/// The cloud that a result was made of or holds; empty where there is none.
fs::path cloud_beside(const fs::path& surface) {
  std::error_code error;
  for (const char* const name : {"road.ply", "labels.ply"}) {
    const fs::path path = surface.parent_path() / name;
    if (!fs::exists(path, error)) continue;
    protect_inputs({path});
    return path;
  }
  return {};
}

/// The definition of the system that a result's cloud states; empty where it states none.
std::string system_of_cloud(const fs::path& surface_file) {
  const fs::path cloud = cloud_beside(surface_file);
  if (cloud.empty()) return {};
  const std::optional<CoordinateSystem> crs = open_point_source(cloud)->header().crs;
  return crs ? definition_of(*crs) : std::string();
}

/// Steps for the heights of patches: as fine as their points lie, but not finer than planes need.
double surface_step(const fs::path& surface_file, const PlanFrame& frame) {
  const fs::path cloud = cloud_beside(surface_file);
  if (cloud.empty()) return grid_step(0.0);
  const CloudFile file = read_cloud_file(cloud);
  return std::max(grid_step(cloud_heights(file.cloud, frame)->resolution()), kFinest);
}

/// The frame of a result: the map's where its run has a place there.
void place_on_map(const fs::path& surface_file, const RoadSurface& surface,
                  const ExportArguments& args, ExportInputs* in) {
  const std::optional<GeoReference> map = georeference_beside(surface_file);
  if (map) {
    in->frame = PlanFrame(map->map_from_reference);
    in->geo_reference = map->crs;
  }
  if (args.reading.crs.empty()) {
    if (!map && surface.frame != "camera") in->geo_reference = system_of_cloud(surface_file);
    return;
  }
  if (map) {
    throw UsageError("--crs: the result lies on the map of " + map->crs.substr(0, 80) +
                     ", which import was given; export keeps it");
  }
  if (surface.frame == "camera") {
    throw UsageError(
        "--crs: the result lies in its camera's frame, nowhere on a map; give import --gnss");
  }
  in->geo_reference = definition_of(crs_from_option(args.reading.crs));
}

std::vector<Eigen::Vector3d> in_plan(const PlanFrame& frame, std::vector<Eigen::Vector3d> line) {
  for (Eigen::Vector3d& place : line) place = frame.to_plan(place);
  return line;
}

ExportInputs load_surface(const ExportArguments& args, const CommonOptions& common,
                          ExportArguments* settled) {
  ExportInputs in;
  fs::path file = args.input;
  std::error_code ignored;
  if (fs::is_directory(file, ignored)) file = road_folder(file) / "surface.json";
  RoadSurface surface = read_surface(file);
  if (!surface.metric) {
    throw NoAnswerError(file.string() +
                        ": the result is up to an unknown scale, and roads for other programs are "
                        "in metres");
  }
  in.frame = PlanFrame(surface.up);
  place_on_map(file, surface, args, &in);
  const std::vector<Eigen::Vector3d> line =
      args.line.empty() ? surface.driven_line : read_line(args.line);
  if (!args.line.empty()) {
    take_line_as_road(args.line, line, args.reach, make_warning_sink(common), &surface);
  }
  in.ground = surface_heights(surface, in.frame, args.reach);
  in.line = in_plan(in.frame, line);
  if (in.line.size() < 2) {
    throw NoAnswerError(file.string() + ": holds no driven line; give a line with --along FILE");
  }
  in.line_frame = line_frame(surface);
  for (const PlanePatch& patch : surface.patches) {
    in.outlines.emplace_back();
    for (const Eigen::Vector3d& x : patch.boundary) {
      in.outlines.back().push_back(in.frame.to_plan(x));
    }
  }
  in.files = {file};
  in.level = to_string(surface.level);
  in.described = fmt::format("frame of the result: {}, level: {}",
                             in.geo_reference.empty() ? surface.frame : in.geo_reference,
                             to_string(surface.level));
  const double step = surface_step(file, in.frame);
  if (settled->grid.step_u == 0.0) settled->grid.step_u = step;
  if (settled->grid.step_v == 0.0) settled->grid.step_v = step;
  return in;
}

/// Where an export looks for ground.
PlanCorridor corridor_of(const std::vector<Eigen::Vector3d>& line, const ExportArguments& args) {
  const double widest = std::max({args.grid.widest, args.grid.left, args.grid.right});
  const SmoothLine smooth =
      smooth_line(args, [&] { return SmoothLine(line, args.tolerance, 0.0, args.ahead); });
  return corridor_along(smooth, widest + kSupport);
}

/// The rectangle around a cloud's finite points, plan frame.
std::vector<Eigen::Vector3d> extent_of(const RoadCloud& cloud, const PlanFrame& frame) {
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3f& p : cloud.points) {
    if (p.allFinite()) box.extend(frame.to_plan(cloud.origin + p.cast<double>()));
  }
  if (box.isEmpty()) return {};
  const Eigen::Vector3d a = box.min(), b = box.max();
  return {a, {b.x(), a.y(), a.z()}, b, {a.x(), b.y(), a.z()}};
}

/// Whether the points of a file have a z.
bool has_heights(const fs::path& file) {
  return find_roles(open_point_source(file)->header().fields).position[2] >= 0;
}

ExportInputs load_cloud(const ExportArguments& args, const CommonOptions& common) {
  if (args.line.empty()) {
    throw UsageError("found a cloud without --along FILE, expected a line along which to export");
  }
  ExportInputs in;
  CloudFile file = read_cloud_file(args.input, args.reading.read_options());
  const LogSink warn = make_warning_sink(common);
  warn_about(args.input, file.report, warn);
  use_metres(args.input, &file, warn);
  if (!file.cloud.metric) {
    throw NoAnswerError(args.input +
                        ": the cloud is not in metres, as roads for other programs are");
  }
  in.frame = PlanFrame(args.up.up(file.cloud));
  in.line = in_plan(in.frame, read_line(args.line, file.report.crs));
  const bool level = in.frame.turned(Eigen::Vector3d::UnitZ()).isApprox(Eigen::Vector3d::UnitZ());
  if (level && !has_heights(args.line)) {
    for (Eigen::Vector3d& place : in.line) place.z() = std::nan("");
  }
  const PlanCorridor where = corridor_of(in.line, args);
  in.ground = cloud_heights(file.cloud, in.frame, &where);
  in.level = file.cloud.frame == CloudFrame::kCamera ? "camera" : "map";
  if (const std::optional<CoordinateSystem> crs = crs_in_use(args.input, file.report, warn)) {
    in.geo_reference = definition_of(*crs);
  }
  in.line_frame = "the cloud's coordinates";
  in.outlines = {extent_of(file.cloud, in.frame)};
  in.files = {args.input};
  in.described = "heights of a cloud's points";
  return in;
}

}  // namespace

SmoothLine smooth_line(const ExportArguments& args, const std::function<SmoothLine()>& make) {
  try {
    return make();
  } catch (const std::invalid_argument&) {
    throw NoAnswerError((args.line.empty() ? args.input : args.line) +
                        ": the line does not leave its first point");
  }
}

ExportInputs load_export(const ExportArguments& args, const CommonOptions& common,
                         ExportArguments* settled) {
  ExportInputs in =
      is_surface(args.input) ? load_surface(args, common, settled) : load_cloud(args, common);
  if (!args.tolerance_given) {
    const double scatter = std::min(kScatters * line_scatter(in.line), kMostTolerance);
    settled->tolerance = std::max(args.tolerance, scatter);
  }
  return in;
}

/// Colours of the cloud that an input is or holds, if it has any.
std::unique_ptr<ColorSource> colors_of(const ExportArguments& args, const ExportInputs& in) {
  const bool of_result = is_surface(args.input);
  const fs::path cloud = of_result ? cloud_beside(in.files.front()) : fs::path(args.input);
  if (cloud.empty()) return nullptr;
  // As the heights were read: the same columns, in metres.
  CloudFile file = read_cloud_file(cloud, of_result ? ReadOptions() : args.reading.read_options());
  use_metres(cloud.string(), &file, {});
  if (file.cloud.colors.empty()) return nullptr;
  const PlanCorridor where = corridor_of(in.line, args);
  return std::make_unique<ColorSource>(file.cloud, in.frame, &where);
}

}  // namespace camber::tools
