#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "camber/evaluate/detail/text_table.h"

namespace camber::detail {

std::string cell(double value, int digits) {
  return std::isfinite(value) ? fmt::format("{:.{}f}", value, digits) : std::string("-");
}

std::string table_text(const std::vector<std::vector<std::string>>& lines, bool markdown) {
  std::string out;
  if (lines.empty()) return out;
  if (markdown) {
    for (std::size_t i = 0; i < lines.size(); ++i) {
      out += "|";
      for (const std::string& text : lines[i]) out += " " + text + " |";
      out += "\n";
      if (i > 0) continue;
      for (std::size_t k = 0; k < lines[0].size(); ++k) out += k == 0 ? "|---|" : "---:|";
      out += "\n";
    }
    return out;
  }
  std::vector<std::size_t> widths(lines[0].size());
  for (const auto& line : lines) {
    for (std::size_t i = 0; i < line.size(); ++i) widths[i] = std::max(widths[i], line[i].size());
  }
  for (const auto& line : lines) {
    out += "  " + fmt::format("{:<{}}", line[0], widths[0]);
    for (std::size_t i = 1; i < line.size(); ++i) {
      out += "  " + fmt::format("{:>{}}", line[i], widths[i]);
    }
    out += "\n";
  }
  return out;
}

}  // namespace camber::detail
