#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

#include "camber/cloud/coordinate_system.h"

/// What the columns of a text file are, from its line of names.
namespace camber::detail {

/// Splits a line at a separator, or at runs of blanks for ' '; words lose blanks and quotes. A
/// separator within quotes does not split.
std::vector<std::string_view> split_line(std::string_view line, char separator);

/// The names in a line: at tabs where there are some and the separator is ' '; a unit in brackets
/// stays with its name ("x [m]"). Text that is not UTF-8 is taken as ISO 8859-1.
std::vector<std::string> split_names(std::string_view line, char separator);

/// Between what the values of a line stand, and whether a comma is their decimal sign.
struct NumberStyle {
  char separator = ' ';
  bool decimal_comma = false;
};

/// ';' or ',' where there is one. A comma is a decimal sign where ';' separates and it stands
/// within a number, or where blanks separate at least three words and it stands only within
/// numbers.
NumberStyle find_number_style(std::string_view line);

/// Whether a word is a number with that decimal sign.
bool is_number(std::string_view word, bool decimal_comma);

/// Which columns are x, y and z, by their names: x y z, else easting northing elevation, else
/// longitude latitude altitude, each with or without a unit ("x_m", "Northing [ft]").
struct AxisColumns {
  std::array<int, 3> column{-1, -1, -1};
  CoordinateUnit horizontal, vertical;  ///< as the names state them
  bool geographic = false;              ///< longitude and latitude

  bool found() const { return column[0] >= 0 && column[1] >= 0; }
};
AxisColumns find_axes(const std::vector<std::string>& names);

/// The code in a text like "EPSG:26917"; 0 without one.
int find_epsg_code(std::string_view text);

/// The text itself if it is UTF-8, else the text from ISO 8859-1.
std::string to_utf8(std::string_view text);

}  // namespace camber::detail
