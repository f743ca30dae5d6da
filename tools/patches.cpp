// camber patches: a road cloud as planar patches and their consistency graph.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/road/cut_surface.h"
#include "camber/road/fit_road_surface.h"
#include "camber/scene/results.h"
#include "camber/scene/surface_file.h"
#include "cloud_arguments.h"
#include "command.h"
#include "crs.h"
#include "plugins/pcl_plugin.h"
#include "plugins/plugin.h"
#include "road_arguments.h"
#include "unknown_scale.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr double kDegree = M_PI / 180.0;

struct Arguments {
  RoadCloudArguments input;
  std::string out;
  SurfaceArguments surface;
  std::string engine = "camber";
  bool overwrite = false;
  bool las = false;
};

void add_arguments(App& app, Arguments& a) {
  add_road_cloud_arguments(app, a.input, a.surface.options.inlier_threshold);
  app.add_option("--out", a.out,
                 "folder for surface.json, labels.ply (the cloud with an int patch) and run.json")
      ->output_folder()
      ->required();
  app.add_flag("--las", a.las,
               "write labels.las, too: the input as it is, with patch as an extra attribute; of a "
               "LAS input all records stay");
  app.add_flag("--overwrite", a.overwrite, "replace a folder that is not a Camber result");
  add_segment_arguments(app, a.surface);
  add_graph_arguments(app, a.surface);
  app.add_option("--engine", a.engine,
                 "camber, or pcl: the Point Cloud Library's region growing, for comparison (takes "
                 "no threshold, tolerance, sigmas nor consistency)")
      ->check(is_member({"camber", "pcl"}))
      ->capture_default_str();
}

RoadSurfaceFit fit_by_pcl(const RoadCloud& cloud, const RoadSurfaceOptions& options) {
  using Functions = const PclFunctions* (*)();
  static const auto* pcl = reinterpret_cast<Functions>(plugin_symbol("pcl", "camber_pcl"))();
  return pcl->fit_road_surface(cloud, options);
}

json options_json(const Command& command, const Arguments& args,
                  const RoadSurfaceOptions& options) {
  json out = {{"up", {options.up->x(), options.up->y(), options.up->z()}},
              {"max_slope_deg", args.surface.max_slope_deg},
              {"threshold", options.inlier_threshold},
              {"min_points", options.min_patch_points},
              {"tolerance", options.tolerance},
              {"tolerance_sigmas", options.tolerance_sigmas},
              {"consistency", args.engine == "pcl" ? "none" : args.surface.consistency},
              {"engine", args.engine},
              {"link_distance", options.consistency.link_distance}};
  add_other_options(command, &out);
  return out;
}

void print_table(const RoadSurfaceFit& fit, long on_patches, std::size_t points) {
  const bool metric = fit.surface.metric;
  fmt::print("{} patches on {} of {} points, noise {}\n", fit.surface.patches.size(), on_patches,
             points, small_length(fit.noise, metric, 1));
  fmt::print("  id  kind      points    grade     bank   +- height  status\n");
  for (const PlanePatch& patch : fit.surface.patches) {
    fmt::print("{:4}  {:<8}{:8}{:9.2f}{:9.2f}{:>{}}  {}\n", patch.id,
               std::string(to_string(patch.kind)), patch.inliers, patch.grade / kDegree,
               patch.bank / kDegree,
               small_length(std::sqrt(patch.plane.covariance(2, 2)), metric, 1), metric ? 12 : 15,
               std::string(to_string(patch.status)));
  }
}

/// Leaves of the cloud, its labels and its surface what lies within the bounds.
void keep_within(const PlanBounds& of_file, CloudFile* file, RoadSurfaceFit* fit) {
  const PlanBounds bounds = bounds_in_metres(of_file, file->report.crs);
  std::vector<int> inside, labels;
  for (std::size_t i = 0; i < file->cloud.size(); ++i) {
    const Eigen::Vector3d x = file->cloud.origin + file->cloud.points[i].cast<double>();
    if (!bounds.contains(x.x(), x.y())) continue;
    inside.push_back(static_cast<int>(i));
    labels.push_back(fit->labels[i]);
  }
  file->cloud = file->cloud.select(inside);
  fit->labels = std::move(labels);
  constexpr double kUpright = 0.99;
  if (std::abs(fit->surface.up.normalized().z()) > kUpright) {
    cut_surface(bounds, fit->labels, &fit->surface);
  }
}

int run(const Command& command, const Arguments& args) {
  RoadSurfaceOptions options = args.surface.in_force(command.common);
  AtomicFolder folder(args.out, args.overwrite);
  Timings timings;
  StageTimer load(timings, "load");
  // Patches beside the bounds decide with those within them: a few of their lengths.
  constexpr double kMargin = 25.0;  // m
  const std::optional<PlanBounds> bounds = args.input.reading.read_options().bounds;
  ReadOptions reading = args.input.reading.read_options();
  if (bounds) {
    reading.bounds = bounds->grown(in_units_of_file(args.input.cloud, reading, kMargin));
  }
  CloudFile file = args.input.read(command.common, reading, args.las);
  load.stop();
  options.up = args.input.up.up(file.cloud);
  options.viewpoint = args.input.up.viewpoint();
  if (bounds) require_inside(args.input.cloud, file, *bounds);
  throw_if_interrupted();
  StageTimer compute(timings, "compute");
  RoadSurfaceFit fit = args.engine == "pcl"
                           ? fit_by_pcl(file.cloud, options)
                           : fit_road_surface(file.cloud, options, make_progress(command.common));
  compute.stop();
  if (fit.status == Status::kFailed) throw NoAnswerError(args.input.cloud + ": " + fit.reason);
  const LogSink warn = make_warning_sink(command.common);
  if (warn && fit.status == Status::kWeak) warn(args.input.cloud + ": " + fit.reason);

  const std::vector<int> all_labels = fit.labels;
  if (bounds) keep_within(*bounds, &file, &fit);

  StageTimer write(timings, "write");
  write_surface(fit.surface, folder.staging() / "surface.json");
  const long on_patches =
      std::count_if(fit.labels.begin(), fit.labels.end(), [](int label) { return label >= 0; });
  file.cloud.labels["patch"] = fit.labels;
  const auto labelled =
      with_crs(make_point_source(file.cloud), crs_in_use(args.input.cloud, file.report, warn));
  write_points(*labelled, folder.staging() / "labels.ply");
  if (args.las) {
    auto source = open_typed_source(args.input.cloud, reading, CloudFormat::kLas);
    if (reading.lenient) source = drop_bad_points(std::move(source));
    source = add_label(std::move(source), "patch", all_labels);
    if (bounds) source = within_bounds(std::move(source), *bounds);
    write_points(*source, folder.staging() / "labels.las");
  }
  RunDocument document;
  document.seed = options.seed;
  *document.options = options_json(command, args, options);
  document.metric = file.cloud.metric;
  document.points_kept = {{"on_patches", on_patches}};
  document.points_dropped = {{"on_no_patch", static_cast<long>(fit.labels.size()) - on_patches}};
  document.input_hashes = {{args.input.cloud, hash_file(args.input.cloud)}};
  write.stop();
  document.timings = timings;
  write_json(to_json(document), folder.staging() / "run.json");
  folder.commit();

  if (!args.input.as_json) {
    print_table(fit, on_patches, file.cloud.size());
    return 0;
  }
  json surface = to_json(fit.surface);
  surface["version"] = kVersion;
  surface["seed"] = options.seed;
  surface["options"] = *document.options;
  surface["timings_ms"] = cloud_timings(timings);
  surface["file"] = args.input.cloud;
  surface["points"] = file.cloud.size();
  surface["points_on_patches"] = on_patches;
  surface["noise"] = fit.noise;
  fmt::print("{}\n", surface.dump(2, ' ', false, json::error_handler_t::replace));
  return 0;
}

}  // namespace

void register_patches(App& root) {
  Command* command = add_command(
      root, "patches", "Models a road cloud by planar patches and joins them in a graph",
      "  camber patches road.ply --out surface\n"
      "  camber patches scan.pcd --out surface --up 0,0,1 --max-slope-deg 30 --json\n"
      "  camber patches road.ply --out surface --driven-line path.csv --consistency paper\n"
      "  camber patches road.ply --out by_pcl --engine pcl");
  const auto arguments = std::make_shared<Arguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
