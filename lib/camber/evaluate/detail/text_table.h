#pragma once

#include <string>
#include <vector>

namespace camber::detail {

/// A number with so many digits after the point; "-" where it is not finite.
std::string cell(double value, int digits);

/// A table of cells, the first line its heading: columns to the right but for the first, indented
/// by two blanks, or as a GitHub table.
std::string table_text(const std::vector<std::vector<std::string>>& lines, bool markdown);

}  // namespace camber::detail
