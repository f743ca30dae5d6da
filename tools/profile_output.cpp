#include "profile_output.h"

#include <fmt/format.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/scene/results.h"
#include "cloud_arguments.h"
#include "command.h"

namespace camber::tools {

std::string profile_title(const std::string& what, const std::string& level) {
  return what + ", slopes against " +
         (level == "gravity" ? "gravity"
          : level == "map"   ? "the map's level"
                             : "the level of the reference camera");
}

void ProfileOutput::check() const {
  const std::string kind = std::filesystem::path(out).extension().string();
  if (!out.empty() && kind != ".csv" && kind != ".json") {
    throw UsageError("--out: found '" + out + "', expected FILE.csv or FILE.json");
  }
  check_output_file(out);
}

void ProfileOutput::require() const {
  if (out.empty() && !json) {
    throw UsageError("found neither --out nor --json, expected one of them");
  }
  check();
}

void ProfileOutput::stage(const std::function<std::string()>& csv, nlohmann::json result,
                          const Timings& timings, AtomicFiles* files) const {
  const std::string kind = std::filesystem::path(out).extension().string();
  if (kind == ".csv") {
    write_file_atomically(files->stage(out), csv());
  } else if (kind == ".json") {
    result["timings_ms"] = cloud_timings(timings);
    write_json(result, files->stage(out));
  }
}

bool ProfileOutput::print(nlohmann::json result, const Timings& timings) const {
  if (!json) return false;
  result["timings_ms"] = cloud_timings(timings);
  fmt::print("{}\n", result.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
  return true;
}

void ProfileOutput::write(const std::function<std::string()>& csv, nlohmann::json result,
                          Timings& timings) const {
  {
    const StageTimer timer(timings, "write");
    AtomicFiles files;
    stage(csv, result, timings, &files);
    files.commit();
  }
  print(std::move(result), timings);
}

}  // namespace camber::tools
