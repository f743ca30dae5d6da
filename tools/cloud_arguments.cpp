#include "cloud_arguments.h"

#include <fmt/format.h>

#include "camber/core/errors.h"

namespace camber::tools {

CloudFormat format_from_name(const std::string& name) {
  if (name == "pcd") return CloudFormat::kPcd;
  if (name == "ply") return CloudFormat::kPly;
  if (name == "bin") return CloudFormat::kKittiBin;
  if (name == "las") return CloudFormat::kLas;
  if (name == "text" || name == "xyz" || name == "csv") return CloudFormat::kText;
  throw UsageError("found format '" + name + "', expected pcd, ply, bin, las or text");
}

ReadOptions CloudArguments::read_options() const {
  ReadOptions options;
  options.lenient = lenient;
  options.columns = columns;
  if (!format.empty()) options.format = format_from_name(format);
  if (!columns.empty() && !options.format) options.format = CloudFormat::kText;
  return options;
}

void add_cloud_arguments(CLI::App& app, CloudArguments& arguments) {
  app.add_flag("--lenient", arguments.lenient,
               "keep what can be read of a damaged file and say what was dropped");
  app.add_option("--input-format", arguments.format,
                 "pcd, ply, bin, las or text; default: by content, then by extension");
  app.add_option("--columns", arguments.columns,
                 "columns of a text file without a header line: x,y,z,intensity (_ skips one)")
      ->delimiter(',');
}

void warn_about(const std::string& path, const ReadReport& report, const LogSink& warn) {
  if (!warn) return;
  for (const auto& [reason, count] : report.dropped) {
    warn(fmt::format("{}: dropped {}: {}", path, reason, count));
  }
  for (const std::string& note : report.notes) warn(path + ": " + note);
}

}  // namespace camber::tools
