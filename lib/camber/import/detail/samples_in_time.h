#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <utility>

#include "camber/core/errors.h"
#include "camber/scene/scene.h"

namespace camber {

/// A value between two samples of rising time; nothing outside, or in a gap of more than `gap`.
template <typename Samples>
std::optional<std::pair<std::size_t, double>> place_in(const Samples& samples, double time,
                                                       double gap) {
  const auto after =
      std::lower_bound(samples.begin(), samples.end(), time,
                       [](const auto& sample, double t) { return sample.time_s < t; });
  if (after == samples.end()) return std::nullopt;
  if (after->time_s == time)
    return std::make_pair(static_cast<std::size_t>(after - samples.begin()), 0.0);
  if (after == samples.begin()) return std::nullopt;
  const auto before = after - 1;
  const double span = after->time_s - before->time_s;
  if (!(span > 0.0 && span <= gap)) return std::nullopt;
  return std::make_pair(static_cast<std::size_t>(before - samples.begin()),
                        (time - before->time_s) / span);
}

/// What to add to the times of a log in GPS time: what makes them UTC, as frames' times are; 0
/// where only the times as written are those of frames.
/// @param gap  s, as in place_in()
template <typename Samples>
double gps_time_shift(const Samples& samples, const Scene& scene, double leap_seconds, double gap) {
  if (leap_seconds == 0.0) return 0.0;
  std::size_t as_written = 0, as_utc = 0;
  for (const SceneFrame& frame : scene.frames) {
    if (!frame.time_s) continue;
    as_written += place_in(samples, *frame.time_s, gap) ? 1 : 0;
    as_utc += place_in(samples, *frame.time_s + leap_seconds, gap) ? 1 : 0;
  }
  return as_written > 0 && as_utc == 0 ? 0.0 : -leap_seconds;
}

/// Refuses where no frame got anything, with the ranges of both clocks.
template <typename Samples>
void require_some(std::size_t count, const Scene& scene, const Samples& samples,
                  const std::filesystem::path& file, const char* what, const char* offset) {
  if (count > 0) return;
  const bool timed = std::all_of(scene.frames.begin(), scene.frames.end(),
                                 [](const SceneFrame& f) { return f.time_s.has_value(); });
  if (!timed)
    throw UsageError(
        fmt::format("{} are joined by time and the frames have none: expected --rate, --times or "
                    "--times-from-names",
                    what));
  throw InputError(
      file.string(),
      fmt::format(
          "found times from {:.3f} to {:.3f} s, expected those of the frames, {:.3f} to {:.3f} s{}",
          samples.front().time_s, samples.back().time_s, *scene.frames.front().time_s,
          *scene.frames.back().time_s, offset));
}

}  // namespace camber
