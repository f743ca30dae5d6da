#include "camber/render/detail/plot_paper.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "camber/image/image_io.h"
#include "camber/render/base64.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_file.h"

namespace camber::detail {

using Eigen::Vector2d;

void PixelPaper::segments(const std::vector<Segment2>& lines, double thickness,
                          const Color& color) {
  canvas_.segments(lines, thickness, color);
}

void PixelPaper::polygon(const std::vector<Vector2d>& corners, const Color& color) {
  canvas_.polygon(corners, color);
}

void PixelPaper::disc(const Vector2d& center, double radius, const Color& color) {
  canvas_.disc(center, radius, color);
}

void PixelPaper::picture(const Box2& place, const Image& image) {
  const int x1 = static_cast<int>(std::lround(place.x1)),
            x2 = static_cast<int>(std::lround(place.x2)),
            y1 = static_cast<int>(std::lround(place.y1)),
            y2 = static_cast<int>(std::lround(place.y2));
  for (int y = std::max(0, y1); y < std::min(image_->height, y2); ++y) {
    const auto row = static_cast<std::size_t>((y - y1 + 0.5) * image.height / (y2 - y1));
    for (int x = std::max(0, x1); x < std::min(image_->width, x2); ++x) {
      const auto column = static_cast<std::size_t>((x - x1 + 0.5) * image.width / (x2 - x1));
      const std::uint8_t* from =
          &image.data[3 * (row * static_cast<std::size_t>(image.width) + column)];
      std::copy_n(
          from, 3,
          &image_->data[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(image_->width) +
                             static_cast<std::size_t>(x))]);
    }
  }
}

void PixelPaper::text(const Vector2d& at, const std::string& line, double size, TextAnchor anchor,
                      bool bold) {
  canvas_.text(at, line, size, kPlotInk, anchor, bold);
}

void PixelPaper::text_upwards(const Vector2d& at, const std::string& line, double size) {
  canvas_.text_upwards(at, line, size, kPlotInk);
}

void SvgPaper::segments(const std::vector<Segment2>& lines, double thickness, const Color& color) {
  if (lines.empty()) return;
  body += "<path d=\"";
  const Vector2d* last = nullptr;
  for (const Segment2& line : lines) {
    if (!last || *last != line.first) {
      body += "M" + number(line.first.x()) + " " + number(line.first.y());
    }
    body += "L" + number(line.second.x()) + " " + number(line.second.y());
    last = &line.second;
  }
  body +=
      "\" fill=\"none\" stroke=\"" + hex(color) + "\" stroke-width=\"" + number(thickness) + "\"";
  if (color.alpha < 1.0) body += " stroke-opacity=\"" + format_number(color.alpha, 2) + "\"";
  body += "/>\n";
}

void SvgPaper::polygon(const std::vector<Vector2d>& corners, const Color& color) {
  body += "<path d=\"M";
  for (const Vector2d& c : corners) body += number(c.x()) + " " + number(c.y()) + " ";
  body += "Z\"" + fill(color) + "/>\n";
}

void SvgPaper::disc(const Vector2d& center, double radius, const Color& color) {
  body += "<circle cx=\"" + number(center.x()) + "\" cy=\"" + number(center.y()) + "\" r=\"" +
          number(radius) + "\"" + fill(color) + "/>\n";
}

void SvgPaper::picture(const Box2& place, const Image& image) {
  body += "<image x=\"" + number(place.x1) + "\" y=\"" + number(place.y1) + "\" width=\"" +
          number(place.width()) + "\" height=\"" + number(place.height()) +
          "\" preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" "
          "href=\"data:image/png;base64," +
          base64(encode_png(image)) + "\"/>\n";
}

void SvgPaper::text(const Vector2d& at, const std::string& line, double size, TextAnchor anchor,
                    bool bold) {
  body +=
      "<text x=\"" + number(at.x()) + "\" y=\"" + number(at.y()) + "\" dy=\".35em\"" + font(size);
  if (anchor == TextAnchor::kCenter) body += " text-anchor=\"middle\"";
  if (anchor == TextAnchor::kRight) body += " text-anchor=\"end\"";
  if (bold) body += " font-weight=\"bold\"";
  body += ">" + escape(line) + "</text>\n";
}

void SvgPaper::text_upwards(const Vector2d& at, const std::string& line, double size) {
  body += "<text transform=\"translate(" + number(at.x()) + " " + number(at.y()) +
          ") rotate(-90)\" dy=\".35em\" text-anchor=\"middle\"" + font(size) + ">" + escape(line) +
          "</text>\n";
}

std::string SvgPaper::number(double value) {
  const std::string out = format_number(value, 1);
  return out.size() > 2 && out.compare(out.size() - 2, 2, ".0") == 0 ? out.substr(0, out.size() - 2)
                                                                     : out;
}

std::string SvgPaper::hex(const Color& color) {
  char text[8];
  std::snprintf(text, sizeof text, "#%02x%02x%02x", color.red, color.green, color.blue);
  return text;
}

std::string SvgPaper::fill(const Color& color) {
  std::string out = " fill=\"" + hex(color) + "\"";
  if (color.alpha < 1.0) out += " fill-opacity=\"" + format_number(color.alpha, 2) + "\"";
  return out;
}

std::string SvgPaper::font(double size) {
  return " font-size=\"" + number(0.8 * size) + "\" fill=\"" + hex(kPlotInk) + "\"";
}

std::string SvgPaper::escape(const std::string& text) {
  std::string out;
  for (const char c : text) {
    if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else {
      out += c;
    }
  }
  return out;
}

void SvgPaper::hover(const Box2& place, const std::string& text) {
  body += "<rect class=\"hit\" x=\"" + number(place.x1) + "\" y=\"" + number(place.y1) +
          "\" width=\"" + number(place.width()) + "\" height=\"" + number(place.height()) +
          "\" fill-opacity=\"0\"><title>" + escape(text) + "</title></rect>\n";
}

void SvgPaper::axes(const PlotAxes& axes) {
  const auto four = [](double a, double b, double c, double d) {
    return fmt::format("{:.9g} {:.9g} {:.9g} {:.9g}", a, b, c, d);
  };
  body += "<g class=\"axes\" data-box=\"" +
          four(axes.box.x1, axes.box.y1, axes.box.x2, axes.box.y2) + "\" data-range=\"" +
          four(axes.x_low, axes.x_high, axes.y_low, axes.y_high) + "\"></g>\n";
}

}  // namespace camber::detail
