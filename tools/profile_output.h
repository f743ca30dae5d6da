#pragma once

#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "camber/core/atomic_file.h"
#include "camber/core/stopwatch.h"

namespace camber::tools {

/// What a plot is of, with what its slopes are against. @param level  as results state it
std::string profile_title(const std::string& what, const std::string& level);

/// Where the table of camber profile goes.
struct ProfileOutput {
  std::string out;    ///< FILE.csv or FILE.json; empty: none
  bool json = false;  ///< to stdout

  /// @throws UsageError for a file of another kind, OutputError for one that cannot be written
  void check() const;
  /// check(), and that there is an output at all.
  void require() const;
  /// Stages the file. @param result  but for its timings
  void stage(const std::function<std::string()>& csv, nlohmann::json result, const Timings& timings,
             AtomicFiles* files) const;
  /// Prints, once the files are there. @return whether anything was printed
  bool print(nlohmann::json result, const Timings& timings) const;
  /// stage(), commits and prints.
  void write(const std::function<std::string()>& csv, nlohmann::json result,
             Timings& timings) const;
};

}  // namespace camber::tools
