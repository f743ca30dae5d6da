#include "drive_progress.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <utility>

#include "camber/drive/measure_drive.h"

namespace camber::tools {
namespace {

using Clock = std::chrono::steady_clock;

/// How fast one stage goes.
struct Pace {
  std::string stage;
  double begin = 0.0;  // frames done when it was first seen: another run's
  Clock::time_point since;

  std::string text(double done, double frames) const {
    const double seconds = std::chrono::duration<double>(Clock::now() - since).count();
    std::string out = fmt::format("{}: {:.0f} of {:.0f} frames", stage, done, frames);
    if (!(done > begin) || !(seconds > 1.0)) return out;
    const double rate = (done - begin) / seconds;
    return out + fmt::format(", {:.{}f} a second, {} left", rate, rate < 10.0 ? 2 : 0,
                             duration_text((frames - done) / rate));
  }
};

}  // namespace

std::string duration_text(double seconds) {
  const long whole = std::lround(seconds);
  if (whole < 60) return fmt::format("{} s", whole);
  if (whole < 3600) return fmt::format("{} min {:02d} s", whole / 60, whole % 60);
  return fmt::format("{} h {:02d} min", whole / 3600, whole % 3600 / 60);
}

Progress drive_progress(const CommonOptions& options, std::size_t frames) {
  const auto pace = std::make_shared<Pace>();
  const auto all = static_cast<double>(frames);
  return [draw = make_progress(options), pace, all](const std::string& stage, double share) {
    const bool windows = stage == "windows";
    if (!windows && stage != "film") {
      draw(stage, share);
      return;
    }
    const double at = (windows ? share / kWindowsShare : share) * all;
    if (pace->stage != stage) *pace = {stage, at, Clock::now()};
    draw(pace->text(std::min(at, all), all), share);
  };
}

}  // namespace camber::tools
