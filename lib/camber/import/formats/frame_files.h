#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace camber {

/// Whether a stands before b where runs of digits compare as numbers: "f2" before "f10".
bool natural_less(const std::string& a, const std::string& b);

/// The PNG and JPEG files that the given folders, glob patterns and files stand for, in natural
/// order of their paths, each once.
/// @throws InputError where one of them gives no image.
std::vector<std::filesystem::path> list_images(const std::vector<std::string>& places);

/// A time that stands in a list, for an image by its name (without folders) or for the next one.
struct ListedTime {
  double time_s = 0.0;
  std::string name;  ///< empty: by its place in the list
};

/// Times in seconds, one a line: a number (TUM, KITTI times.txt), a date with a time of day (KITTI
/// timestamps.txt), or one of these and a file name in two columns (TUM rgb.txt, EuRoC data.csv,
/// whose whole numbers of 16 digits and more are nanoseconds, as its header line states).
/// @throws InputError "file: line L: found, expected".
std::vector<ListedTime> read_frame_times(const std::filesystem::path& path);

/// The time that a file name states: a number (of 10 digits before the point: seconds; whole
/// numbers of 13, 16 and 19 digits: ms, us, ns; of other lengths none), or a date and time of day
/// ("2024-05-01_12-00-00.250", "20240501T120000"). The last such in the name; nothing without one.
std::optional<double> time_from_name(const std::string& name);

/// Seconds since 1970 of a date and time of day as ISO 8601 has it, with the usual liberties in the
/// separators; a zone at its end is taken. Nothing for other text.
std::optional<double> parse_date_time(const std::string& text);

}  // namespace camber
