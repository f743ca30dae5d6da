#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

namespace camber {

/// A payload of a track: where it stands in the file, and of which time it is.
struct FilmPayload {
  std::uint64_t offset = 0, size = 0;     ///< bytes
  double time_s = 0.0, duration_s = 0.0;  ///< since the film's first frame
};

/// What an MP4 or QuickTime film states beside its pictures.
struct Mp4Film {
  /// When it was made, s since 1970: in whole seconds, by the camera's clock and time zone.
  std::optional<double> created_s;
  std::vector<FilmPayload> telemetry;  ///< of the track of GoPro's metadata; empty: none
};

/// Reads the boxes of ISO/IEC 14496-12 (sample tables, edit lists), no picture.
/// @return nothing for files of other kinds.
/// @throws InputError where a box, a table or a payload ends behind what holds it.
std::optional<Mp4Film> read_mp4_film(const std::filesystem::path& path);

}  // namespace camber
