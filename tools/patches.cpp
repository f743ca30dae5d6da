// camber patches: a road cloud as planar patches and their consistency graph.

#include <fmt/format.h>

#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/cloud/stream_filters.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/road/fit_road_surface.h"
#include "camber/scene/results.h"
#include "cloud_arguments.h"
#include "command.h"
#include "road_arguments.h"

namespace fs = std::filesystem;
using nlohmann::json;

namespace camber::tools {
namespace {

constexpr double kDegree = M_PI / 180.0;

const std::map<std::string, Consistency> kConsistencies = {
    {"none", Consistency::kNone},
    {"paper", Consistency::kPaper},
    {"continuity", Consistency::kContinuity}};

}  // namespace

void register_patches(App& root) {
  Command* command = add_command(
      root, "patches", "Models a road cloud by planar patches and joins them in a graph",
      "  camber patches road.ply --out surface\n"
      "  camber patches scan.pcd --out surface --up 0,0,1 --max-slope-deg 30 --json\n"
      "  camber patches road.ply --out surface --driven-line path.csv --consistency paper");
  struct Arguments {
    RoadCloudArguments input;
    std::string out, line;
    RoadSurfaceOptions options;
    double max_slope_deg = RoadSurfaceOptions().max_slope / kDegree;
    std::string consistency = "continuity";
    bool overwrite = false;
    bool las = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  RoadSurfaceOptions& bound = arguments->options;
  App& app = *command->app;
  add_road_cloud_arguments(app, arguments->input, bound.inlier_threshold);
  app.add_option("--out", arguments->out,
                 "folder for surface.json, labels.ply (the cloud with an int patch) and run.json")
      ->required();
  app.add_flag("--las", arguments->las,
               "write labels.las, too: the input as it is, with patch as an extra attribute; of a "
               "LAS input all records stay");
  app.add_flag("--overwrite", arguments->overwrite, "replace a folder that is not a Camber result");
  app.add_option("--max-slope-deg", arguments->max_slope_deg, "steepest ground, degrees from level")
      ->capture_default_str();
  app.add_option("--min-points", bound.min_patch_points, "patches on fewer points are dropped")
      ->capture_default_str();
  app.add_option("--tolerance", bound.tolerance,
                 "metres that ground may bend away from its patch, at least")
      ->capture_default_str();
  app.add_option("--tolerance-sigmas", bound.tolerance_sigmas,
                 "the same in standard deviations of a point, at least")
      ->capture_default_str();
  app.add_option("--driven-line", arguments->line,
                 "points of the driven path in order (any cloud format): tells the road from other "
                 "ground, and ahead from behind");
  app.add_option("--consistency", arguments->consistency,
                 "continuity: neighbours meet at equal heights; paper: equation 8, alike normals "
                 "and offsets; none")
      ->check(is_member({"continuity", "paper", "none"}))
      ->capture_default_str();
  app.add_option("--link-distance", bound.consistency.link_distance,
                 "metres within which patches are neighbours")
      ->capture_default_str();

  command->run = [command, arguments] {
    RoadSurfaceOptions options = arguments->options;
    options.seed = command->common.seed;
    options.num_threads = command->common.threads;
    options.max_slope = arguments->max_slope_deg * kDegree;
    options.consistency.consistency = kConsistencies.at(arguments->consistency);
    options.validate();
    AtomicFolder folder(arguments->out, arguments->overwrite,
                        {arguments->input.cloud, arguments->line});
    Timings timings;
    StageTimer load(timings, "load");
    CloudFile file = arguments->input.read(command->common);
    if (!arguments->line.empty()) options.driven_line = read_line(arguments->line);
    load.stop();
    options.up = arguments->input.up.up(file.cloud);
    options.viewpoint = arguments->input.up.viewpoint();
    throw_if_interrupted();
    StageTimer compute(timings, "compute");
    const RoadSurfaceFit fit =
        fit_road_surface(file.cloud, options, make_progress(command->common));
    compute.stop();
    if (fit.status == Status::kFailed) {
      throw NoAnswerError(arguments->input.cloud + ": " + fit.reason);
    }

    StageTimer write(timings, "write");
    const json surface = to_json(fit.surface);
    write_json(surface, folder.staging() / "surface.json");
    long kept = 0;
    for (const int label : fit.labels) kept += label >= 0 ? 1 : 0;
    file.cloud.labels["patch"] = fit.labels;
    write_cloud(file.cloud, folder.staging() / "labels.ply");
    if (arguments->las) {
      write_labelled_copy(arguments->input.cloud, arguments->input.reading.read_options(), "patch",
                          fit.labels, folder.staging() / "labels.las");
    }
    RunDocument run;
    run.seed = options.seed;
    *run.options = {{"command", "patches"},
                    {"up", {options.up->x(), options.up->y(), options.up->z()}},
                    {"max_slope_deg", arguments->max_slope_deg},
                    {"threshold", options.inlier_threshold},
                    {"min_points", options.min_patch_points},
                    {"tolerance", options.tolerance},
                    {"tolerance_sigmas", options.tolerance_sigmas},
                    {"consistency", arguments->consistency},
                    {"link_distance", options.consistency.link_distance}};
    run.metric = file.cloud.metric;
    run.points_kept = {{"on_patches", kept}};
    run.points_dropped = {{"on_no_patch", static_cast<long>(fit.labels.size()) - kept}};
    run.input_hashes = {{arguments->input.cloud, hash_file(arguments->input.cloud)}};
    write.stop();
    run.timings = timings;
    json document = to_json(run);
    write_json(document, folder.staging() / "run.json");
    folder.commit();

    if (arguments->input.as_json) {
      json out = surface;
      out["version"] = kVersion;
      out["seed"] = options.seed;
      out["options"] = *run.options;
      out["timings_ms"] = cloud_timings(timings);
      out["file"] = arguments->input.cloud;
      out["points"] = file.cloud.size();
      out["points_on_patches"] = kept;
      out["noise"] = fit.noise;
      fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
      return 0;
    }
    fmt::print("{} patches on {} of {} points, noise {:.1f} mm\n", fit.surface.patches.size(), kept,
               file.cloud.size(), 1e3 * fit.noise);
    fmt::print("  id  kind      points    grade     bank   +- height  status\n");
    for (const PlanePatch& patch : fit.surface.patches) {
      fmt::print("{:4}  {:<8}{:8}{:9.2f}{:9.2f}{:9.1f} mm  {}\n", patch.id,
                 std::string(to_string(patch.kind)), patch.inliers, patch.grade / kDegree,
                 patch.bank / kDegree, 1e3 * std::sqrt(patch.plane.covariance(2, 2)),
                 std::string(to_string(patch.status)));
    }
    return 0;
  };
}

}  // namespace camber::tools
