#include "cloud_arguments.h"

#include <nlohmann/json.hpp>

#include <fmt/format.h>

#include "camber/cloud/stream_filters.h"
#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "crs.h"

namespace camber::tools {

CloudFormat format_from_name(const std::string& name) {
  if (name == "pcd") return CloudFormat::kPcd;
  if (name == "ply") return CloudFormat::kPly;
  if (name == "bin") return CloudFormat::kKittiBin;
  if (name == "las") return CloudFormat::kLas;
  if (name == "e57") return CloudFormat::kE57;
  if (name == "laz") return CloudFormat::kLaz;
  if (name == "text" || name == "xyz" || name == "csv") return CloudFormat::kText;
  if (name == "colmap") return CloudFormat::kColmap;
  throw UsageError("found format '" + name + "', expected pcd, ply, bin, las, laz or text");
}

ReadOptions CloudArguments::read_options() const {
  ReadOptions options;
  options.lenient = lenient;
  options.columns = columns;
  if (!format.empty()) options.format = format_from_name(format);
  if (!crs.empty()) options.crs = crs_from_option(crs);
  if (scan >= 0) options.scan = static_cast<std::size_t>(scan);
  options.own_frame = own_frame;
  if (!bounds.empty()) {
    options.bounds = PlanBounds{bounds[0], bounds[1], bounds[2], bounds[3]};
    if (!(bounds[0] < bounds[2] && bounds[1] < bounds[3])) {
      throw UsageError(
          fmt::format("--bounds: found {:.12g},{:.12g},{:.12g},{:.12g}, expected x0,y0,x1,y1 with "
                      "x0 < x1 and y0 < y1",
                      bounds[0], bounds[1], bounds[2], bounds[3]));
    }
  }
  options.resolution = resolution;
  return options;
}

void add_cloud_arguments(App& app, CloudArguments& arguments) {
  app.add_flag("--lenient", arguments.lenient,
               "keep what can be read of a damaged file and say what was dropped");
  app.add_option("--input-format", arguments.format,
                 "pcd, ply, bin, las, laz, e57 or text; default: by content, then by extension")
      ->no_name();
  app.add_option(
         "--resolution", arguments.resolution,
         "of a COPC file its levels down to the first whose points are no farther apart, in "
         "its units; default: all")
      ->check(positive_number());
  app.add_option("--columns", arguments.columns,
                 "columns of a text file without a header line, or of a .bin: x,y,z,intensity (_ "
                 "skips one)")
      ->no_name()
      ->delimiter(',');
  app.add_option("--crs", arguments.crs,
                 "coordinate system of the input, in place of the one that it states: EPSG:n, "
                 "well-known text, a PROJ string, or a file with one of them");
  app.add_option("--scan", arguments.scan,
                 "of an E57 file: this scan alone, counted from 0 (info lists them); default: all, "
                 "as one cloud")
      ->no_name()
      ->check(in_range(0, 1000000));
  app.add_flag("--own-frame", arguments.own_frame,
               "of an E57 file: the scan in its own frame, without its pose");
  app.add_option("--bounds", arguments.bounds,
                 "x0,y0,x1,y1: only points with x0 <= x < x1 and y0 <= y < y1, in the file's "
                 "coordinates and units")
      ->check(finite_number())
      ->delimiter(',')
      ->expected(4);
}

WriteOptions OutputArguments::write_options() const {
  WriteOptions options;
  if (!format.empty()) options.format = format_from_name(format);
  if (format == "csv") options.encoding = CloudEncoding::kCommas;
  if (encoding == "ascii") options.encoding = CloudEncoding::kAscii;
  if (encoding == "big-endian") options.encoding = CloudEncoding::kBigEndian;
  if (encoding == "compressed") options.encoding = CloudEncoding::kCompressed;
  if (encoding == "commas") options.encoding = CloudEncoding::kCommas;
  return options;
}

void add_output_arguments(App& app, OutputArguments& arguments) {
  app.add_option("--format", arguments.format,
                 "of the output: pcd, ply, bin, las, laz, text or csv; default: by its extension")
      ->no_name();
  app.add_option("--encoding", arguments.encoding,
                 "binary (default), ascii, big-endian (PLY), compressed (PCD) or commas (text)")
      ->check(is_member({"binary", "ascii", "big-endian", "compressed", "commas"}));
}

void add_rewrite_arguments(App& app, RewriteArguments& arguments, const char* input_help) {
  app.add_option("input", arguments.input, input_help)->required();
  app.add_option("--out", arguments.out,
                 "file to write: .ply, .pcd, .bin, .las, .laz, .copc.laz, .xyz or .csv")
      ->output_file()
      ->required();
  add_cloud_arguments(app, arguments.cloud);
  add_output_arguments(app, arguments.output);
  app.add_flag("--json", arguments.as_json, "one JSON object on stdout");
}

void require_known_output(const std::string& path, const WriteOptions& options) {
  const std::optional<CloudFormat> format =
      options.format ? options.format : format_from_extension(path);
  if (format) return;
  throw UsageError("--out: found '" + path +
                   "', expected a name that ends in .ply, .pcd, .bin, .las, .laz, .xyz or .csv, "
                   "or --format");
}

CloudFile read_labelled_points(const std::string& path, const ReadOptions& options) {
  if (!options.lenient) return read_cloud_file(path, options);
  const std::unique_ptr<PointSource> source = drop_bad_points(open_point_source(path, options));
  CloudBuilder builder(source->header(), false, options);
  for (PointBatch batch; source->next(batch);) {
    throw_if_interrupted();
    builder.add(batch);
  }
  CloudFile file;
  file.report = source->report();
  file.cloud = builder.finish(file.report);
  file.report.crs = source->header().crs;
  return file;
}

nlohmann::json cloud_timings(const Timings& timings) {
  nlohmann::json out = {{"load", 0.0}, {"compute", 0.0}, {"write", 0.0}};
  for (const auto& [stage, milliseconds] : timings.stages()) out[stage] = milliseconds;
  return out;
}

void warn_about(const std::string& path, const ReadReport& report, const LogSink& warn) {
  if (!warn) return;
  for (const auto& [reason, count] : report.dropped) {
    warn(fmt::format("{}: dropped {}: {}", path, reason, count));
  }
  for (const std::string& note : report.notes) warn(path + ": " + note);
}

void warn_about_losses(const std::string& path, const PointStreamHeader& header,
                       const ReadReport& report, const WriteOptions& output, const std::string& out,
                       const LogSink& warn) {
  if (!warn) return;
  const std::optional<CloudFormat> format =
      output.format ? output.format : format_from_extension(out);
  const bool las = is_las(format);
  if (!las || !header.records) {
    for (const std::string& what : report.las_only) {
      warn(fmt::format("{}: {} are not kept", path, what));
    }
  }
  const bool turned =
      header.viewpoint && *header.viewpoint != std::array<double, 7>{0, 0, 0, 1, 0, 0, 0};
  if (format != CloudFormat::kPcd && (header.height > 1 || turned)) {
    const std::string rows =
        fmt::format("that the points are in rows ({} x {})", header.width, header.height);
    const std::string place = "where the sensor stood (VIEWPOINT)";
    warn(fmt::format("{}: {} has no place in the output, which only PCD has", path,
                     header.height <= 1 ? place
                     : turned           ? rows + " and " + place
                                        : rows));
  }
  const CoordinateSystem* const crs = header.crs ? &*header.crs : nullptr;
  const bool copied = las && header.records;
  if (crs && crs->horizontal.angle && crs->wkt.empty() && crs->epsg == 0 && !copied) {
    warn(path +
         ": that the coordinates are longitude and latitude has no place in the output without "
         "their coordinate system; state it with --crs");
  }
  if (format != CloudFormat::kKittiBin) return;
  if (header.frame == CloudFrame::kCamera) {
    warn(path + ": the frame (a camera's: x right, y down) has no place in the output");
  }
  if (!header.metric) {
    warn(path + ": that its lengths are up to scale has no place in the output");
  }
  if (!header.crs) return;
  if (header.crs->stated() || header.crs->epsg > 0) {
    warn(fmt::format("{}: the coordinate system ({}) has no place in the output", path,
                     describe(*header.crs)));
  } else if (!header.crs->metric()) {
    warn(path + ": " + unit_remark(*header.crs));
  }
}

}  // namespace camber::tools
