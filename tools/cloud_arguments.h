#pragma once

#include <string>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "command.h"

namespace camber::tools {

/// The options of all commands that read clouds.
struct CloudArguments {
  bool lenient = false;
  std::string format;                ///< empty: by content, then by extension
  std::vector<std::string> columns;  ///< of text without a header line

  ReadOptions read_options() const;
};

/// Adds --lenient, --input-format and --columns. `arguments` must live as long as the app.
void add_cloud_arguments(CLI::App& app, CloudArguments& arguments);

/// The format with a name as --format takes it: pcd, ply, bin, las, text (also xyz, csv).
/// @throws UsageError for another.
CloudFormat format_from_name(const std::string& name);

/// Prints what a reader dropped and remarked, one warning a line.
void warn_about(const std::string& path, const ReadReport& report, const LogSink& warn);

}  // namespace camber::tools
