#include "camber/render/detail/report_html.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "camber/core/markup.h"
#include "camber/render/color_map.h"

namespace camber::detail {

std::string escape(const std::string& text) { return escaped_markup(text); }

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

std::string folded(const std::string& content, const std::string& summary, bool fold) {
  if (!fold) return content;
  return "<details><summary>" + escape(summary) + "</summary>\n" + content + "</details>\n";
}

void flatten(const nlohmann::json& value, const std::string& name, std::string* rows) {
  if (value.is_object()) {
    for (const auto& [key, inner] : value.items()) {
      flatten(inner, name.empty() ? key : name + "." + key, rows);
    }
    return;
  }
  if (value.is_array() && value.size() > 12) return;
  std::string text;
  if (value.is_number_float()) {
    char digits[40];
    std::snprintf(digits, sizeof(digits), "%.4g", value.get<double>());
    text = digits;
  } else if (value.is_string()) {
    text = value.get<std::string>();
  } else {
    text = value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
  }
  *rows += row({escape(name), escape(text)});
}

std::string plot_figure(const PlotSheet& sheet, int height) {
  return "<div class=answers><div class=wide>" + plots_svg(sheet, {760, height, 16.5}, false) +
         "</div><div class=narrow>" +
         plots_svg(sheet, {380, std::max(120, height * 21 / 23), 15.0}, false) +
         "</div><output class=said></output></div>\n";
}

namespace {

const char* const kStyle = R"(
:root{color-scheme:light}*{box-sizing:border-box}
body{font:16px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif;color:#262a30;background:#fff;margin:0 auto;max-width:1100px;padding:1rem}
h1{font-size:1.7rem;margin:.4em 0 .1em}h2{font-size:1.25rem;margin:2em 0 .5em;border-bottom:1px solid #d5d9de}h3{font-size:1rem;margin:1.2em 0 .3em}
figure{margin:1rem 0}img{max-width:100%;height:auto;display:block;border:1px solid #e3e6ea}figcaption,.n{color:#555c66;font-size:.9rem}
.t{overflow-x:auto}table{border-collapse:collapse;font-size:.87rem;font-variant-numeric:tabular-nums}th,td{padding:.25em .7em;text-align:left;border-bottom:1px solid #e3e6ea;vertical-align:top;white-space:nowrap}td code,td small{white-space:normal}th{color:#555c66;font-weight:600;white-space:normal;vertical-align:bottom}
.m{color:#555c66;white-space:nowrap}code{font-size:.85em;overflow-wrap:anywhere}.s{white-space:nowrap}.s small{white-space:normal}.weak,.not_observable,.failed{color:#8a4b00}
.w{white-space:normal;min-width:12em}.k{display:inline-block;width:.8em;height:.8em;margin-right:.4em;border:1px solid #0004}
.at{position:relative;width:max-content;max-width:100%}.drawn .at{max-width:none;width:auto}.at .hit{position:absolute;border:2px solid transparent;border-radius:2px}.at .hit:hover,.at .hit:focus{border-color:#c0007a;background:#ffffff30;outline:none}svg .hit:hover{fill-opacity:.1}.said,#viewsaid{display:block;min-height:1.5em;font-size:.9rem;white-space:pre-line;font-variant-numeric:tabular-nums}
.bar{width:14em;min-width:6em}.bar i{display:block;height:.9em;margin-top:.25em;background:#3b6ea5;print-color-adjust:exact;-webkit-print-color-adjust:exact}
svg{width:100%;max-width:760px;height:auto;display:block;margin:.5rem 0}.narrow{display:none}.p{overflow-x:auto}
@media screen and (max-width:600px){.wide{display:none}.narrow{display:block}.drawn img{max-width:none;width:max(100%,640px)}}
#viewbar label{margin-right:1em;white-space:nowrap;font-size:.9rem}#view{width:100%;height:min(60vh,560px);border:1px solid #d5d9de;display:none;touch-action:none;cursor:grab}
details{margin:.6rem 0}summary{cursor:pointer}
@media print{body{max-width:none;padding:0;font-size:11pt}#view,#viewbar,#viewnote{display:none!important}figure,tr,svg{break-inside:avoid}h2,h3{break-after:avoid}.wide{break-inside:avoid}details::details-content{content-visibility:visible!important;height:auto!important}table{font-size:8pt}th,td{padding:.15em .45em}.t{overflow:visible}}
)";

}  // namespace

std::string page_head(const std::string& title) {
  return "<!DOCTYPE html>\n<html lang=en><head><meta charset=utf-8>"
         "<meta name=viewport content=\"width=device-width,initial-scale=1\"><title>" +
         escape(title) + " - Camber</title><style>" + kStyle + "</style></head><body>\n<h1>" +
         escape(title) + "</h1>\n";
}

}  // namespace camber::detail
