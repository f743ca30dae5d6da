#include "drive_batch.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "camber/core/atomic_file.h"
#include "camber/core/csv_field.h"
#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/core/version.h"
#include "camber/scene/results.h"

namespace fs = std::filesystem;

namespace camber::tools {
namespace {

using nlohmann::json;

/// One drive of a batch.
struct Row {
  std::string name, scene;
  int exit_code = 0;
  std::string reason;  // of an exit code that is not 0
  json run;            // run.json, where there is a result
  double seconds = 0.0;
  bool was_there = false;
};

/// What a drive's folder is called: after the film, or the folder of the manifest.
std::string name_of(const std::string& scene) {
  fs::path path = fs::absolute(scene).lexically_normal();
  if (!path.has_filename()) path = path.parent_path();
  if (path.filename() == "scene.json") path = path.parent_path();
  return path.extension() == ".json" || path.extension() == ".mp4" ? path.stem().string()
                                                                   : path.filename().string();
}

/// @throws UsageError where two drives would share a folder.
std::vector<Row> rows_of(const std::vector<std::string>& scenes) {
  std::map<std::string, std::string> taken;
  std::vector<Row> out;
  for (const std::string& scene : scenes) {
    Row row;
    row.scene = scene;
    row.name = name_of(scene);
    const auto [other, is_new] = taken.emplace(row.name, scene);
    if (!is_new) {
      throw UsageError(fmt::format(
          "{} and {} are both called {}: expected scenes whose folders have different names",
          other->second, scene, row.name));
    }
    out.push_back(std::move(row));
  }
  return out;
}

std::string cell(const Row& row, const char* key, int digits) {
  if (row.run.is_null()) return {};
  const json& value = row.run.at("drive").at(key);
  return value.is_number() ? fmt::format("{:.{}f}", value.get<double>(), digits) : std::string();
}

std::string relative_sigma(const Row& row) {
  if (row.run.is_null()) return {};
  const json& drive = row.run.at("drive");
  if (!drive.at("length").is_number() || !drive.at("length_sigma").is_number()) return {};
  const double length = drive.at("length");
  if (!(length > 0.0)) return {};
  return fmt::format("{:.2f}", 100.0 * drive.at("length_sigma").get<double>() / length);
}

std::string summary_csv(const std::vector<Row>& rows) {
  std::string out =
      "name,scene,exit_code,frames,weak_frames,metric,length,length_sigma,sigma_percent,"
      "camera_height,camera_height_sigma,cells,tracks,warnings,seconds,reason\n";
  for (const Row& row : rows) {
    const bool there = !row.run.is_null();
    out += fmt::format(
        "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{:.1f},{}\n", csv_field(row.name),
        csv_field(row.scene), row.exit_code, cell(row, "frames", 0), cell(row, "weak_frames", 0),
        !there                           ? ""
        : row.run.value("metric", false) ? "1"
                                         : "0",
        cell(row, "length", 3), cell(row, "length_sigma", 3), relative_sigma(row),
        cell(row, "camera_height", 4), cell(row, "camera_height_sigma", 4), cell(row, "cells", 0),
        cell(row, "tracks", 0), there ? std::to_string(row.run.at("warnings").size()) : "",
        row.seconds, csv_field(row.reason));
  }
  return out;
}

/// The same for people.
void print_table(const std::vector<Row>& rows) {
  std::size_t widest = 4;
  for (const Row& row : rows) widest = std::max(widest, row.name.size());
  fmt::print("{:<{}}  {:>6} {:>5} {:>10} {:>6} {:>7} {:>6}\n", "name", widest, "frames", "weak",
             "length", "+- %", "cells", "tracks");
  for (const Row& row : rows) {
    if (row.run.is_null()) {
      fmt::print("{:<{}}  {}\n", row.name, widest, row.reason);
      continue;
    }
    const char* unit = row.run.value("metric", false) ? "m" : "u";
    fmt::print("{:<{}}  {:>6} {:>5} {:>8} {} {:>6} {:>7} {:>6}{}\n", row.name, widest,
               cell(row, "frames", 0), cell(row, "weak_frames", 0), cell(row, "length", 1), unit,
               relative_sigma(row), cell(row, "cells", 0), cell(row, "tracks", 0),
               row.was_there ? "  (was there)" : "");
  }
}

json batch_json(const Command& command, const std::vector<Row>& rows, bool complete) {
  json drives = json::array();
  for (const Row& row : rows) {
    drives.push_back({{"name", row.name},
                      {"scene", row.scene},
                      {"exit_code", row.exit_code},
                      {"reason", row.reason},
                      {"seconds", row.seconds},
                      {"drive", row.run.is_null() ? json(nullptr) : row.run.at("drive")}});
  }
  return {{"version", kVersion},
          {"seed", command.common.seed},
          {"command", command.common.command_line},
          {"complete", complete},
          {"drives", drives}};
}

void run_row(const Command& command, const DriveArguments& arguments, Row* row) {
  DriveArguments own = arguments;
  own.input.path = row->scene;
  own.out = (fs::path(arguments.out) / row->name).string();
  const auto begin = std::chrono::steady_clock::now();
  try {
    DriveOutcome outcome = run_drive_job(command, own);
    row->run = *outcome.run;
    row->was_there = outcome.was_there;
    for (const json& warning : row->run.value("warnings", json::array())) {
      std::fprintf(stderr, "camber: warning: %s: %s\n", row->name.c_str(),
                   warning.at("text").get<std::string>().c_str());
    }
  } catch (const InterruptedError&) {
    throw;
  } catch (const OutputError&) {
    throw;
  } catch (const MachineError&) {
    throw;
  } catch (const Error& error) {
    row->exit_code = error.exit_code();
    row->reason = error.what();
    std::fprintf(stderr, "camber: %s: %s\n", row->name.c_str(), error.what());
  }
  row->seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

}  // namespace

std::vector<std::string> scenes_of(const std::vector<std::string>& given, const std::string& list) {
  std::vector<std::string> out = given;
  if (!list.empty()) {
    std::istringstream lines(read_whole_file(list));
    for (std::string line; std::getline(lines, line);) {
      const auto end = line.find_last_not_of(" \t\r");
      const auto begin = line.find_first_not_of(" \t");
      if (end == std::string::npos || line[begin] == '#') continue;
      out.push_back(line.substr(begin, end + 1 - begin));
    }
  }
  if (out.empty()) throw UsageError("found no scene, expected one or more, or --list FILE");
  return out;
}

int run_drive_batch(const Command& command, const DriveArguments& arguments,
                    const std::vector<std::string>& scenes, bool as_json) {
  if (!arguments.film.empty()) {
    throw UsageError("--film: found several scenes, whose films are film.mp4 in their folders");
  }
  std::vector<Row> rows = rows_of(scenes);
  const fs::path folder = arguments.out;
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw OutputError(folder.string(), error.message());
  check_output_folder(folder, arguments.overwrite || arguments.resume);
  write_json(batch_json(command, rows, false), folder / "run.json");
  for (Row& row : rows) {
    if (!command.common.quiet) std::fprintf(stderr, "camber: %s\n", row.name.c_str());
    run_row(command, arguments, &row);
  }
  write_file_atomically(folder / "summary.csv", summary_csv(rows));
  const json run = batch_json(command, rows, true);
  write_json(run, folder / "run.json");
  if (as_json) {
    std::printf("%s\n", run.dump(2).c_str());
  } else if (!command.common.quiet) {
    print_table(rows);
  }
  return std::any_of(rows.begin(), rows.end(), [](const Row& row) { return row.exit_code != 0; })
             ? 1
             : 0;
}

}  // namespace camber::tools
