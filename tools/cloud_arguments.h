#pragma once

#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/point_stream.h"
#include "camber/core/stopwatch.h"
#include "command.h"

namespace camber::tools {

/// The options of all commands that read clouds.
struct CloudArguments {
  bool lenient = false;
  std::string format;                ///< empty: by content, then by extension
  std::vector<std::string> columns;  ///< of text without a header line
  std::string crs;                   ///< empty: what the file states
  int scan = -1;                     ///< of E57; -1: all
  bool own_frame = false;
  std::vector<double> bounds;  ///< x0 y0 x1 y1; empty: everywhere
  double resolution = 0.0;     ///< of COPC, in the file's units; 0: all

  ReadOptions read_options() const;
};

/// Adds --lenient, --input-format and --columns. `arguments` must live as long as the app.
void add_cloud_arguments(App& app, CloudArguments& arguments);

/// The options of all commands that write clouds.
struct OutputArguments {
  std::string format;    ///< empty: by the extension
  std::string encoding;  ///< empty: binary

  WriteOptions write_options() const;  ///< @throws UsageError
};

/// Adds --format and --encoding. `arguments` must live as long as the app.
void add_output_arguments(App& app, OutputArguments& arguments);

/// What `convert` and `filter` have in common: a cloud in, a cloud out.
struct RewriteArguments {
  std::string input, out;
  CloudArguments cloud;
  OutputArguments output;
  bool as_json = false;
};

/// Adds the input, which `input_help` describes, --out, how to read and write them, and --json.
/// `arguments` must live as long as the app.
void add_rewrite_arguments(App& app, RewriteArguments& arguments, const char* input_help);

/// Throws a UsageError where neither an option nor the extension gives the output's format.
void require_known_output(const std::string& path, const WriteOptions& options);

/// Reads a cloud whose points are labelled in another pass over its file: lenient reading leaves
/// out what drop_bad_points() does, and not duplicates.
CloudFile read_labelled_points(const std::string& path, const ReadOptions& options);

/// The stages load, compute and write in milliseconds, 0 for those that did not happen.
nlohmann::json cloud_timings(const Timings& timings);

/// The format with a name as --format takes it: pcd, ply, bin, las, text (also xyz, csv).
/// @throws UsageError for another.
CloudFormat format_from_name(const std::string& name);

/// Prints what a reader dropped and remarked, one warning a line.
void warn_about(const std::string& path, const ReadReport& report, const LogSink& warn);

/// Prints what a copy in this format loses of a cloud: what only LAS keeps, the coordinate system.
void warn_about_losses(const std::string& path, const PointStreamHeader& header,
                       const ReadReport& report, const WriteOptions& output, const std::string& out,
                       const LogSink& warn);

}  // namespace camber::tools
