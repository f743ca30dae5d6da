// camber filter: crop, thin, clean, sort a cloud, or give it normals.

#include "camber/cloud/filters.h"

#include <fmt/format.h>

#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>

#include "camber/cloud/las_file.h"
#include "camber/cloud/morton.h"
#include "camber/cloud/normals.h"
#include "camber/cloud/point_selection.h"
#include "camber/cloud/stream_filters.h"
#include "camber/cloud/voxel_grid.h"
#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/core/stopwatch.h"
#include "camber/core/version.h"
#include "cloud_arguments.h"
#include "command.h"
#include "crs.h"
#include "plan_area.h"
#include "unknown_scale.h"

using nlohmann::json;

namespace camber::tools {
namespace {

struct Arguments {
  RewriteArguments files;
  std::vector<int> classes, without_classes;
  std::string returns, polygon;
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

/// What is held in memory: the points, and of a LAS file their records.
struct Collected {
  RoadCloud cloud;
  std::string records;
  std::vector<int> order;  // of the points that are left, into the records

  void select(const std::vector<int>& indices) {
    cloud = cloud.select(indices);
    std::vector<int> left;
    left.reserve(indices.size());
    for (const int i : indices) left.push_back(order[static_cast<std::size_t>(i)]);
    order = std::move(left);
  }
};

Collected collect(PointSource& source) {
  Collected out;
  CloudBuilder builder(source.header(), false);
  PointBatch batch;
  while (source.next(batch)) {
    builder.add(batch);
    if (batch.records.data != nullptr) {
      out.records.append(reinterpret_cast<const char*>(batch.records.data),
                         batch.count * batch.records.stride);
    }
    throw_if_interrupted();
  }
  ReadReport report;
  out.cloud = builder.finish(report);
  out.order.resize(out.cloud.size());
  std::iota(out.order.begin(), out.order.end(), 0);
  return out;
}

/// Metres in the file's unit of length; warns where that is another one. Degrees stay.
double metres_in(const PointSource& source, const Arguments& args, const LogSink& warn) {
  if (args.range > 0.0 || args.voxel > 0.0 || !args.radius.empty() || !args.box.empty()) {
    warn_of_unknown_scale(args.files.input, source.header().metric, source.header().crs, warn);
  }
  const bool lengths = args.range > 0.0 || args.voxel > 0.0 || !args.radius.empty();
  if (!source.header().crs || !lengths) return 1.0;
  CoordinateSystem crs = *source.header().crs;
  complete_crs(&crs);
  if (crs.metric()) return 1.0;
  if (warn) {
    warn(args.files.input + ": " + unit_remark(crs) +
         (crs.horizontal.angle
              ? std::string()
              : "; the metres of --range, --voxel and --radius were converted, --box is in the "
                "file's units"));
  }
  return 1.0 / crs.horizontal.metres;
}

/// The mean of points has no waveform.
void require_no_waves(const std::string& input, const PointStreamHeader& header) {
  if (!header.las) return;
  const int format = header.las->point_format;
  if (format != 4 && format != 5 && format < 9) return;
  throw InputError(input, "found points with wave packets (point format " + std::to_string(format) +
                              "), which --voxel cannot keep: it writes means of points; expected "
                              "another point format, or other filters");
}

bool works_in_memory(const Arguments& args) {
  return !args.radius.empty() || !args.statistical.empty() || args.normals > 0 || args.morton;
}

/// The points that --drop-non-finite, --box and --range leave.
/// @param not_finite  counts those dropped for it, while the points pass
std::unique_ptr<PointSource> cropped(std::unique_ptr<PointSource> source, const Arguments& args,
                                     double metre,
                                     const std::shared_ptr<std::uint64_t>& not_finite) {
  if (!args.drop_non_finite && args.box.empty() && !(args.range > 0.0)) return source;
  CropBox box;
  if (!args.box.empty()) {
    box.minimum = vector({args.box[0], args.box[1], args.box[2]});
    box.maximum = vector({args.box[3], args.box[4], args.box[5]});
    if (!((box.minimum.array() <= box.maximum.array()).all())) {
      throw UsageError("--box: found a minimum above its maximum, expected min x,y,z, max x,y,z");
    }
  }
  const bool has_box = !args.box.empty();
  const bool outside = args.outside;
  const double range = args.range * metre;
  return select_points(std::move(source), [=](const Eigen::Vector3d& x) {
    if (!x.allFinite()) {
      ++*not_finite;
      return false;
    }
    return (!has_box || box.contains(x) != outside) && (range <= 0.0 || x.norm() <= range);
  });
}

/// The points that --class, --not-class, --returns and --polygon leave.
std::unique_ptr<PointSource> selected(std::unique_ptr<PointSource> source, const Arguments& args) {
  using Returns = PointSelection::Returns;
  PointSelection selection;
  selection.classes = args.classes;
  selection.without_classes = args.without_classes;
  if (args.returns == "first") selection.returns = Returns::kFirst;
  if (args.returns == "last") selection.returns = Returns::kLast;
  if (args.returns == "single") selection.returns = Returns::kSingle;
  if (!args.polygon.empty()) selection.area = read_plan_area(args.polygon, source->header().crs);
  if (!selection.selects()) return source;
  return select_points(std::move(source), selection, args.files.input);
}

std::unique_ptr<VoxelGrid> thinned(PointSource& source, const Arguments& args, double metre) {
  require_no_waves(args.files.input, source.header());
  auto grid = std::make_unique<VoxelGrid>(source.header(), args.voxel * metre);
  PointBatch batch;
  while (source.next(batch)) {
    grid->add(batch);
    throw_if_interrupted();
  }
  return grid;
}

/// The steps that need all points at once. @return the steps taken, for the JSON.
/// @param not_finite  counts the points dropped for it
json clean(const Arguments& args, double metre, int threads, Collected& kept,
           std::uint64_t* not_finite) {
  RoadCloud& cloud = kept.cloud;
  if (!args.radius.empty() || !args.statistical.empty()) {
    *not_finite += cloud.size() - finite_points(cloud).size();
  }
  json steps = json::array();
  const auto step = [&](const char* name) {
    steps.push_back({{"step", name}, {"points", cloud.size()}});
    throw_if_interrupted();
  };
  step("read");
  if (!args.radius.empty()) {
    kept.select(
        radius_inliers(cloud, args.radius[0] * metre, whole(args.radius[1], "--radius"), threads));
    step("radius");
  }
  if (!args.statistical.empty()) {
    kept.select(statistical_inliers(cloud, whole(args.statistical[0], "--statistical"),
                                    args.statistical[1], threads));
    step("statistical");
  }
  if (args.normals > 0) {
    NormalOptions options;
    options.neighbors = args.normals;
    options.num_threads = threads;
    options.up = args.up.empty() ? cloud.default_up() : vector(args.up);
    if (!args.viewpoint.empty()) options.viewpoint = vector(args.viewpoint);
    estimate_normals(cloud, options);
    step("normals");
  }
  if (args.morton) {
    kept.select(morton_order(cloud.points));
    step("morton");
  }
  return steps;
}

/// What is left in memory as a source: a LAS file's own records, else the cloud.
std::unique_ptr<PointSource> source_of(Collected& kept, const PointStreamHeader& header,
                                       bool with_normals, bool same_order) {
  if (kept.records.empty()) {
    return with_layout(with_crs(make_point_source(kept.cloud), header.crs), header, same_order);
  }
  auto source = make_las_rows(header, std::move(kept.records), std::move(kept.order));
  if (with_normals) source = add_normals(std::move(source), kept.cloud.normals);
  return source;
}

/// What was written, for messages and the JSON.
struct Written {
  std::uint64_t points = 0;
  std::vector<std::string> notes;
  json steps = json::array();
};

void print_json(const Command& command, const Arguments& args, const ReadReport& report,
                bool metric, const Written& written, const Timings& timings) {
  json dropped = json::object();
  for (const auto& [reason, count] : report.dropped) dropped[reason] = count;
  json options = {{"class", args.classes},
                  {"not_class", args.without_classes},
                  {"returns", args.returns},
                  {"polygon", args.polygon},
                  {"box", args.box},
                  {"outside", args.outside},
                  {"range", args.range},
                  {"drop_non_finite", args.drop_non_finite},
                  {"voxel", args.voxel},
                  {"radius", args.radius},
                  {"statistical", args.statistical},
                  {"normals", args.normals},
                  {"morton", args.morton},
                  {"lenient", args.files.cloud.lenient}};
  add_other_options(command, &options);
  fmt::print("{}\n", json{{"version", kVersion},
                          {"seed", command.common.seed},
                          {"options", options},
                          {"timings_ms", cloud_timings(timings)},
                          {"input", args.files.input},
                          {"out", args.files.out},
                          {"metric", metric},
                          {"steps", written.steps},
                          {"points", written.points},
                          {"dropped", dropped},
                          {"notes", report.notes},
                          {"output_notes", written.notes}}
                         .dump(2, ' ', false, json::error_handler_t::replace));
}

int run(const Command& command, const Arguments& args) {
  const LogSink warn = make_warning_sink(command.common);
  const WriteOptions write = args.files.output.write_options();
  require_known_output(args.files.out, write);
  check_output_file(args.files.out);
  Timings timings;
  Written written;

  // What streams: selections, then thinning.
  StageTimer load(timings, "load");
  std::unique_ptr<PointSource> source =
      open_typed_source(args.files.input, args.files.cloud.read_options(),
                        write.format ? write.format : format_from_extension(args.files.out));
  const double metre = metres_in(*source, args, warn);
  if (args.files.cloud.lenient) source = drop_bad_points(std::move(source));
  const auto not_finite = std::make_shared<std::uint64_t>(0);  // points dropped for it
  source = selected(std::move(source), args);
  source = cropped(std::move(source), args, metre, not_finite);
  std::unique_ptr<PointSource> input;  // keeps the reader and its report
  std::unique_ptr<VoxelGrid> grid;
  if (args.voxel > 0.0) {
    grid = thinned(*source, args, metre);
    *not_finite += grid->non_finite();
    input = std::move(source);
    source = grid->points();
  }
  Collected kept;
  if (works_in_memory(args)) {
    kept = collect(*source);
    grid.reset();
  }
  load.stop();

  StageTimer compute(timings, "compute");
  if (works_in_memory(args)) {
    written.steps = clean(args, metre, command.common.threads, kept, not_finite.get());
    if (!input) input = std::move(source);
    const bool same_order = !args.morton && args.voxel <= 0.0;
    source = source_of(kept, input->header(), args.normals > 0, same_order);
  }
  compute.stop();

  StageTimer writing(timings, "write");
  source = with_complete_crs(std::move(source), args.files.out, write);
  written.points =
      write_points(*source, args.files.out, write, make_progress(command.common), &written.notes);
  writing.stop();
  ReadReport report = input ? input->report() : source->report();
  report.drop("not finite", *not_finite);
  warn_about(args.files.input, report, warn);
  warn_about_losses(args.files.input, source->header(), report, write, args.files.out, warn);
  for (const std::string& note : written.notes) {
    if (warn) warn(args.files.out + ": " + note);
  }
  if (args.files.as_json)
    print_json(command, args, report, source->header().metric, written, timings);
  return 0;
}

void add_arguments(App& app, Arguments& a) {
  add_rewrite_arguments(app, a.files, "cloud file");
  app.add_option("--class", a.classes, "keep points of these ASPRS classes: 2,9")
      ->check(in_range(0, 255))
      ->delimiter(',');
  app.add_option("--not-class", a.without_classes, "drop points of these classes: 7,18")
      ->check(in_range(0, 255))
      ->delimiter(',');
  app.add_option("--returns", a.returns,
                 "first, last or single: keep these returns of their pulses (single: the only one)")
      ->check(is_member({"first", "last", "single"}));
  app.add_option("--polygon", a.polygon,
                 "keep the inside of an area in plan: polygons of a GeoJSON file, or the points of "
                 "any cloud format as its corners, in the input's coordinates");
  app.add_flag("--drop-non-finite", a.drop_non_finite,
               "drop points with NaN or infinite coordinates");
  app.add_option("--box", a.box, "keep the inside of a box: min x,y,z, max x,y,z, m")
      ->delimiter(',')
      ->expected(6);
  app.add_flag("--outside", a.outside, "with --box: keep the outside")->needs("--box");
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
  app.add_option(
         "--normals", a.normals,
         "estimate normals from so many nearest points, itself included; NaN where these lie "
         "on a line")
      ->check(in_range(3, 100000));
  app.add_option("--up", a.up, "normals point to this side; default: the cloud's up")
      ->delimiter(',')
      ->expected(3)
      ->needs("--normals");
  app.add_option("--viewpoint", a.viewpoint,
                 "normals point to this place instead, in the file's units")
      ->delimiter(',')
      ->expected(3)
      ->needs("--normals");
  app.add_flag("--morton", a.morton,
               "sort so that near points are near in the file (Morton order)");
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
      "  camber filter map.las --class 2,9 --bounds 629000,4850000,629500,4850500 --out part.las\n"
      "  camber filter map.las --returns last --polygon site.geojson --out site.las\n"
      "  camber filter map.las --radius 1,3 --morton --out sorted.las");
  const auto arguments = std::make_shared<Arguments>();
  add_arguments(*command->app, *arguments);
  command->run = [command, arguments] { return run(*command, *arguments); };
}

}  // namespace camber::tools
