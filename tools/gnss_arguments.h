#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "camber/import/import_own.h"
#include "options.h"

namespace camber::tools {

/// --gnss and what goes with it, of all imports.
struct GnssArguments {
  std::string file, crs;
  std::vector<double> antenna;
  GnssOptions options;

  /// The library's options. @param up_sigma  rad; headings are as good as roll and pitch.
  /// @throws UsageError for a --crs that is no map in metres.
  GnssOptions take(double up_sigma) const;
};

/// --no-telemetry and --telemetry-offset, of what makes a scene of a film.
struct TelemetryArguments {
  bool left_out = false;
  std::string offset;  ///< s; empty: not given

  TelemetryOptions take() const;
};

/// `arguments` must live as long as the app.
void add_telemetry_options(App& app, TelemetryArguments& arguments);

/// Adds them to the options that --json repeats.
void add_telemetry_json(const TelemetryArguments& arguments, nlohmann::json* options);

/// `arguments` must live as long as the app.
void add_gnss_options(App& app, GnssArguments& arguments);

/// @param up  --up. @throws UsageError where --up-sigma-deg is given without what it belongs to.
void check_up_sigma(const App& app, const std::string& up, const GnssArguments& gnss);

/// Adds them to the options that --json repeats.
void add_gnss_json(const GnssArguments& arguments, nlohmann::json* options);

}  // namespace camber::tools
