#include "camber/render/detail/report_html.h"

#include <cmath>

#include "camber/render/color_map.h"

namespace camber::detail {

std::string escape(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string number(double value, int decimals) {
  return std::isfinite(value) ? format_number(value, decimals) : "&ndash;";
}

std::string with_margin(double value, double sigma, int decimals) {
  std::string out = number(value, decimals);
  if (std::isfinite(value) && std::isfinite(sigma) && sigma > 0.0) {
    out += " <span class=m>&plusmn; " + number(sigma, decimals) + "</span>";
  }
  return out;
}

std::string status_cell(Status status, const std::string& reason) {
  const std::string word(to_string(status));
  std::string out = "<td class=\"s " + word + "\">" + (status == Status::kOk ? "" : "&#9888; ");
  out += word == "not_observable" ? "not observable" : word;
  if (!reason.empty()) out += "<br><small>" + escape(reason) + "</small>";
  return out + "</td>";
}

std::string row(const std::vector<std::string>& cells) {
  std::string out = "<tr>";
  for (const std::string& cell : cells) {
    out += cell.rfind("<td", 0) == 0 ? cell : "<td>" + cell + "</td>";
  }
  return out + "</tr>\n";
}

std::string table(const std::vector<std::string>& heads, const std::string& rows) {
  std::string out = "<div class=t><table><thead><tr>";
  for (const std::string& head : heads) out += "<th>" + head + "</th>";
  return out + "</tr></thead><tbody>\n" + rows + "</tbody></table></div>\n";
}

}  // namespace camber::detail
