#include "camber/render/plot.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/render/detail/plot_panel.h"
#include "camber/render/detail/plot_paper.h"
#include "camber/render/picture_file.h"

namespace camber {
namespace {

using detail::Panel;
using detail::Paper;
using detail::PixelPaper;
using detail::SvgPaper;

struct Layout {
  std::vector<Panel> panels;
  int height = 0;
};

Layout lay_out(const PlotSheet& sheet, const PlotStyle& style) {
  style.validate();
  if (sheet.panels.empty()) throw std::invalid_argument("plot: found no panels, expected one");
  Layout out;
  double left = 0.0, right = 0.0;
  for (const Plot& plot : sheet.panels) {
    out.panels.emplace_back(plot, style);
    left = std::max(left, out.panels.back().left_margin(style));
    right = std::max(right, out.panels.back().right_margin());
  }
  if (left + right > 0.8 * style.width) {
    throw std::invalid_argument("plot option width: found " + std::to_string(style.width) +
                                ", expected more, the words beside the axes need " +
                                std::to_string(static_cast<int>(left + right)));
  }
  double top = (sheet.title.empty() ? 0.4 : 2.2) * style.text_size;
  for (Panel& panel : out.panels) {
    panel.place({left, top, style.width - right, top + style.panel_height});
    top += style.panel_height + 0.4 * style.text_size;
  }
  double scale = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < out.panels.size(); ++i) {
    if (sheet.panels[i].equal_scale) scale = std::min(scale, out.panels[i].scale());
  }
  for (std::size_t i = 0; i < out.panels.size(); ++i) {
    if (sheet.panels[i].equal_scale) out.panels[i].set_scale(scale);
  }
  out.height = static_cast<int>(std::ceil(top));
  return out;
}

void draw(Paper& paper, const PlotSheet& sheet, const Layout& layout, const PlotStyle& style) {
  if (!sheet.title.empty()) {
    paper.text({0.6 * style.text_size, 1.2 * style.text_size}, sheet.title,
               detail::fitted_size(sheet.title, 1.25 * style.text_size,
                                   style.width - 1.2 * style.text_size, true),
               TextAnchor::kLeft, true);
  }
  for (const Panel& panel : layout.panels) panel.draw(paper);
}

void check_style(const char* name, double value, double low, double high) {
  if (value >= low && value <= high) return;
  throw std::invalid_argument(std::string("plot option ") + name + ": found " +
                              format_number(value, 0) + ", expected " + format_number(low, 0) +
                              " to " + format_number(high, 0));
}

}  // namespace

Color plot_color(int index) {
  static constexpr Color kColors[] = {{0, 114, 178, 1.0},   {230, 159, 0, 1.0},  {0, 158, 115, 1.0},
                                      {204, 121, 167, 1.0}, {86, 180, 233, 1.0}, {90, 90, 90, 1.0}};
  constexpr int kCount = sizeof(kColors) / sizeof(kColors[0]);
  return kColors[((index % kCount) + kCount) % kCount];
}

void PlotStyle::validate() const {
  check_style("width", width, 160, 8192);
  check_style("panel_height", panel_height, 120, 8192);
  check_style("text_size", text_size, 6, 200);
}

Image draw_plots(const PlotSheet& sheet, const PlotStyle& style) {
  const Layout layout = lay_out(sheet, style);
  Image image = make_picture(style.width, layout.height, 255);
  PixelPaper paper(image);
  draw(paper, sheet, layout, style);
  return image;
}

std::vector<PlotAxes> plot_axes(const PlotSheet& sheet, const PlotStyle& style) {
  const Layout layout = lay_out(sheet, style);
  std::vector<PlotAxes> out;
  for (const Panel& panel : layout.panels) out.push_back(panel.axes());
  return out;
}

std::string plots_svg(const PlotSheet& sheet, const PlotStyle& style, bool standalone) {
  const Layout layout = lay_out(sheet, style);
  SvgPaper paper;
  draw(paper, sheet, layout, style);
  for (const Panel& panel : layout.panels) {
    panel.draw_hover(paper);
    if (!standalone) paper.axes(panel.axes());
  }
  const std::string size = std::to_string(style.width) + " " + std::to_string(layout.height);
  return std::string("<svg") + (standalone ? " xmlns=\"http://www.w3.org/2000/svg\"" : "") +
         " viewBox=\"0 0 " + size +
         "\" font-family=\"Arial, Helvetica, sans-serif\">\n<rect width=\"100%\" height=\"100%\" "
         "fill=\"#ffffff\"/>\n" +
         paper.body + "</svg>\n";
}

}  // namespace camber
