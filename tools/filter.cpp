// camber filter: crop, thin, clean, sort a cloud, or give it normals.

#include "camber/cloud/filters.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/cloud/morton.h"
#include "camber/cloud/normals.h"
#include "camber/cloud/stream_filters.h"
#include "camber/cloud/voxel_grid.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "cloud_arguments.h"
#include "command.h"
#include "own_inputs.h"

using nlohmann::json;

namespace camber::tools {
namespace {

struct Arguments {
  RewriteArguments files;
  std::vector<double> box;
  bool outside = false;
  double range = 0.0;
  bool drop_non_finite = false;
  double voxel = 0.0;
  std::vector<double> radius, statistical;
  int normals = 0;
  std::vector<double> up, viewpoint;
  bool morton = false;
};

Eigen::Vector3d vector(const std::vector<double>& v) { return {v[0], v[1], v[2]}; }

int whole(double value, const char* option) {
  if (!(value >= 1.0 && value <= 1e6) || std::floor(value) != value) {
    throw UsageError(
        fmt::format("{}: found {} neighbours, expected a whole number from 1", option, value));
  }
  return static_cast<int>(value);
}

RoadCloud collect(PointSource& source) {
  CloudBuilder builder(source.header(), false);
  PointBatch batch;
  while (source.next(batch)) {
    builder.add(batch);
    throw_if_interrupted();
  }
  ReadReport report;
  return builder.finish(report);
}

}  // namespace

void register_filter(App& root) {
  Command* command = add_command(
      root, "filter",
      "Crops, thins, cleans and sorts a cloud, or gives it normals. The steps are taken in the "
      "order in which they are listed here. Cropping and thinning alone stream through: memory is "
      "needed for the thinned points only.",
      "  camber filter scan.ply --voxel 0.2 --out thin.ply\n"
      "  camber filter scan.pcd --box -20,-20,-3,20,20,1 --out near.pcd\n"
      "  camber filter road.ply --statistical 20,2 --normals 20 --out clean.ply\n"
      "  camber filter map.las --radius 1,3 --morton --out sorted.las");
  const auto arguments = std::make_shared<Arguments>();
  Arguments& a = *arguments;
  App& app = *command->app;
  add_rewrite_arguments(app, a.files, "cloud file");
  app.add_flag("--drop-non-finite", a.drop_non_finite,
               "drop points with NaN or infinite coordinates");
  app.add_option("--box", a.box, "keep the inside of a box: min x,y,z, max x,y,z, m")
      ->delimiter(',')
      ->expected(6);
  app.add_flag("--outside", a.outside, "with --box: keep the outside");
  app.add_option("--range", a.range, "keep points at most so far from the coordinates' origin, m")
      ->check(positive_number());
  app.add_option("--voxel", a.voxel, "one point for each cube of this edge, m")
      ->check(positive_number());
  app.add_option("--radius", a.radius, "R,N: drop points with fewer than N others at most R m away")
      ->delimiter(',')
      ->expected(2);
  app.add_option("--statistical", a.statistical,
                 "K,S: drop points whose mean distance to K neighbours is more than S standard "
                 "deviations above the mean")
      ->delimiter(',')
      ->expected(2);
  app.add_option("--normals", a.normals,
                 "estimate normals from so many nearest points, itself included")
      ->check(in_range(3, 100000));
  app.add_option("--up", a.up, "normals point to this side; default: the cloud's up")
      ->delimiter(',')
      ->expected(3);
  app.add_option("--viewpoint", a.viewpoint, "normals point to this place instead, m")
      ->delimiter(',')
      ->expected(3);
  app.add_flag("--morton", a.morton,
               "sort so that near points are near in the file (Morton order)");

  command->run = [command, arguments] {
    const Arguments& args = *arguments;
    const LogSink warn = make_warning_sink(command->common);
    const WriteOptions write = args.files.output.write_options();
    require_known_output(args.files.out, write);
    refuse_own_inputs({args.files.out}, {args.files.input});
    Timings timings;
    json steps = json::array();
    const auto step = [&](const char* name, std::uint64_t left) {
      steps.push_back({{"step", name}, {"points", left}});
    };

    // What streams: selections, then thinning.
    StageTimer load(timings, "load");
    std::unique_ptr<PointSource> source =
        open_typed_source(args.files.input, args.files.cloud.read_options());
    const bool lenient = args.files.cloud.lenient;
    if (lenient) source = drop_bad_points(std::move(source));
    if (args.drop_non_finite || !args.box.empty() || args.range > 0.0) {
      CropBox box;
      if (!args.box.empty()) {
        box.minimum = vector({args.box[0], args.box[1], args.box[2]});
        box.maximum = vector({args.box[3], args.box[4], args.box[5]});
        if (!((box.minimum.array() <= box.maximum.array()).all())) {
          throw UsageError(
              "--box: found a minimum above its maximum, expected min x,y,z, max x,y,z");
        }
      }
      const bool has_box = !args.box.empty();
      const bool outside = args.outside;
      const double range = args.range;
      source = select_points(std::move(source), [=](const Eigen::Vector3d& x) {
        return x.allFinite() && (!has_box || box.contains(x) != outside) &&
               (range <= 0.0 || x.norm() <= range);
      });
    }
    const bool in_memory =
        !args.radius.empty() || !args.statistical.empty() || args.normals > 0 || args.morton;
    std::unique_ptr<PointSource> input;  // keeps the reader and its report
    std::unique_ptr<VoxelGrid> grid;
    if (args.voxel > 0.0) {
      grid = std::make_unique<VoxelGrid>(source->header(), args.voxel);
      PointBatch batch;
      while (source->next(batch)) {
        grid->add(batch);
        throw_if_interrupted();
      }
      input = std::move(source);
      source = grid->points();
    }
    RoadCloud cloud;
    if (in_memory) {
      cloud = collect(*source);
      grid.reset();
    }
    load.stop();

    StageTimer compute(timings, "compute");
    if (in_memory) {
      const int threads = command->common.threads;
      step("read", cloud.size());
      if (!args.radius.empty()) {
        cloud = cloud.select(
            radius_inliers(cloud, args.radius[0], whole(args.radius[1], "--radius"), threads));
        step("radius", cloud.size());
      }
      throw_if_interrupted();
      if (!args.statistical.empty()) {
        cloud = cloud.select(statistical_inliers(cloud, whole(args.statistical[0], "--statistical"),
                                                 args.statistical[1], threads));
        step("statistical", cloud.size());
      }
      throw_if_interrupted();
      if (args.normals > 0) {
        NormalOptions options;
        options.neighbors = args.normals;
        options.num_threads = threads;
        options.up = args.up.empty() ? cloud.default_up() : vector(args.up);
        if (!args.viewpoint.empty()) options.viewpoint = vector(args.viewpoint);
        estimate_normals(cloud, options);
        step("normals", cloud.size());
      }
      throw_if_interrupted();
      if (args.morton) {
        cloud = cloud.select(morton_order(cloud.points));
        step("morton", cloud.size());
      }
      if (!input) input = std::move(source);
      source = make_point_source(cloud);
    }
    compute.stop();

    StageTimer writing(timings, "write");
    const std::uint64_t points =
        write_points(*source, args.files.out, write, make_progress(command->common));
    writing.stop();
    const ReadReport& report = input ? input->report() : source->report();
    warn_about(args.files.input, report, warn);
    if (args.files.as_json) {
      json dropped = json::object();
      for (const auto& [reason, count] : report.dropped) dropped[reason] = count;
      const json options = {{"box", args.box},
                            {"outside", args.outside},
                            {"range", args.range},
                            {"drop_non_finite", args.drop_non_finite},
                            {"voxel", args.voxel},
                            {"radius", args.radius},
                            {"statistical", args.statistical},
                            {"normals", args.normals},
                            {"morton", args.morton},
                            {"lenient", args.files.cloud.lenient}};
      fmt::print("{}\n", json{{"version", kVersion},
                              {"seed", command->common.seed},
                              {"options", options},
                              {"timings_ms", cloud_timings(timings)},
                              {"input", args.files.input},
                              {"out", args.files.out},
                              {"steps", steps},
                              {"points", points},
                              {"dropped", dropped},
                              {"notes", report.notes}}
                             .dump(2, ' ', false, json::error_handler_t::replace));
    }
    return 0;
  };
}

}  // namespace camber::tools
