// camber plane: one robust plane of a cloud.

#include "camber/plane/fit_plane.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "camber/plane/fit_plane_pcl.h"
#include "camber/road/consistency_graph.h"
#include "camber/scene/results.h"
#include "cloud_arguments.h"
#include "command.h"
#include "road_arguments.h"
#include "unknown_scale.h"

using nlohmann::json;

namespace camber::tools {
namespace {

constexpr double kDegree = M_PI / 180.0;

json number(double value) { return std::isfinite(value) ? json(value) : json(nullptr); }

struct Arguments {
  RoadCloudArguments input;
  PlaneFitOptions options;
  double max_tilt_deg = PlaneFitOptions().max_tilt / kDegree;
  std::string engine = "camber";
};

/// The fit as a surface of one patch, turned as the road goes.
RoadSurface surface_of(const PlaneFit& fit, const RoadCloud& cloud, const Eigen::Vector3d& up) {
  PlanePatch patch;
  patch.status = fit.status;
  patch.reason = fit.reason;
  patch.plane = fit.plane;
  patch.inliers = static_cast<int>(fit.num_inliers);
  patch.boundary = fit.extent;
  RoadSurface surface;
  surface.frame = cloud.frame == CloudFrame::kCamera ? "camera" : "z-up";
  surface.up = up.normalized();
  const bool of_camera =
      cloud.frame == CloudFrame::kCamera && (surface.up - cloud.default_up()).norm() < 1e-9;
  surface.level = of_camera ? RoadSurface::Level::kCamera : RoadSurface::Level::kGravity;
  surface.metric = cloud.metric;
  surface.patches = {patch};
  align_patches_with_road(&surface);
  return surface;
}

void print_text(const RoadSurface& surface, const PlaneFit& fit, std::size_t points) {
  const PlanePatch& patch = surface.patches[0];
  const Plane& plane = patch.plane.plane;
  const Eigen::Matrix3d& c = patch.plane.covariance;
  fmt::print("status     {}{}{}\n", to_string(patch.status), patch.reason.empty() ? "" : ": ",
             patch.reason);
  fmt::print("normal     {:.6f} {:.6f} {:.6f}\n", plane.normal.x(), plane.normal.y(),
             plane.normal.z());
  fmt::print("offset     {:.4f} {}\n", plane.offset, surface.metric ? "m" : "units");
  fmt::print("centroid   {:.3f} {:.3f} {:.3f}\n", patch.plane.centroid.x(),
             patch.plane.centroid.y(), patch.plane.centroid.z());
  fmt::print("tilt       {:.3f} deg from up\n", angle_between(plane.normal, surface.up) / kDegree);
  fmt::print("sigmas     {:.4f} deg, {:.4f} deg, {}\n", std::sqrt(c(0, 0)) / kDegree,
             std::sqrt(c(1, 1)) / kDegree, small_length(std::sqrt(c(2, 2)), surface.metric, 2));
  fmt::print("inliers    {} of {}, rmse {}\n", fit.num_inliers, points,
             small_length(fit.rmse, surface.metric, 1));
  fmt::print("condition  {:.3g}\n", fit.condition);
}

void print_json(const Command& command, const Arguments& args, const PlaneFitOptions& options,
                const RoadSurface& surface, const PlaneFit& fit, std::size_t points,
                Timings& timings) {
  StageTimer write(timings, "write");
  json plane = to_json(surface.patches[0]);
  plane["condition"] = number(fit.condition);
  plane["noise"] = number(fit.noise);
  plane["rmse"] = number(fit.rmse);
  plane["hypotheses"] = fit.hypotheses;
  json out = {{"version", kVersion},
              {"seed", options.seed},
              {"options",
               {{"engine", args.engine},
                {"up", {options.up.x(), options.up.y(), options.up.z()}},
                {"max_tilt_deg", args.max_tilt_deg},
                {"threshold", options.inlier_threshold},
                {"max_hypotheses", options.max_hypotheses},
                {"confidence", options.confidence}}},
              {"file", args.input.cloud},
              {"points", points},
              {"frame", surface.frame},
              {"level", to_string(surface.level)},
              {"metric", surface.metric},
              {"plane", std::move(plane)}};
  add_other_options(command, &out["options"]);
  write.stop();
  out["timings_ms"] = cloud_timings(timings);
  fmt::print("{}\n", out.dump(2, ' ', false, json::error_handler_t::replace));
}

int run(const Command& command, const Arguments& args) {
  PlaneFitOptions options = args.options;
  options.seed = command.common.seed;
  options.num_threads = command.common.threads;
  options.max_tilt = args.max_tilt_deg * kDegree;
  options.list_inliers = false;
  options.validate();
  Timings timings;
  StageTimer load(timings, "load");
  const CloudFile file = args.input.read(command.common);
  load.stop();
  options.up = args.input.up.up(file.cloud);
  options.viewpoint = args.input.up.viewpoint();
  throw_if_interrupted();
  StageTimer compute(timings, "compute");
  const bool pcl = args.engine == "pcl";
  const PlaneFit fit = pcl ? fit_plane_pcl(file.cloud, options) : fit_plane(file.cloud, options);
  compute.stop();
  if (fit.status == Status::kFailed || fit.status == Status::kNotObservable) {
    throw NoAnswerError(args.input.cloud + ": " + fit.reason);
  }
  const RoadSurface surface = surface_of(fit, file.cloud, options.up);
  if (args.input.as_json) {
    print_json(command, args, options, surface, fit, file.cloud.size(), timings);
  } else {
    print_text(surface, fit, file.cloud.size());
  }
  return 0;
}

void add_arguments(App& app, Arguments& a) {
  add_road_cloud_arguments(app, a.input, a.options.inlier_threshold);
  app.add_option("--max-tilt-deg", a.max_tilt_deg,
                 "largest angle between the normal and up, degrees")
      ->capture_default_str();
  app.add_option("--max-hypotheses", a.options.max_hypotheses,
                 "most minimal samples that are scored")
      ->capture_default_str();
  app.add_option("--confidence", a.options.confidence, "of the adaptive stop")
      ->capture_default_str();
  app.add_option("--engine", a.engine,
                 "camber, or pcl: the Point Cloud Library's MSAC, for comparison (threshold "
                 "0.05 m unless given)")
      ->check(is_member({"camber", "pcl"}))
      ->capture_default_str();
}

}  // namespace

void register_plane(App& root) {
  Command* command = add_command(root, "plane", "Fits one plane to a cloud with outliers",
                                 "  camber plane road.ply\n"
                                 "  camber plane scan.pcd --up 0,0,1 --max-tilt-deg 30 --json\n"
                                 "  camber plane road.ply --threshold 0.05 --engine pcl");
  const auto arguments = std::make_shared<Arguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
