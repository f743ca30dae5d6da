#include "camber/render/plot.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/image/image_io.h"
#include "camber/render/base64.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_file.h"

namespace camber {
namespace {

using Eigen::Vector2d;

const Color kPlotInk{40, 40, 40, 1.0}, kGrid{222, 222, 222, 1.0};
constexpr double kLineHeight = 1.35;  // of the text size
constexpr double kLabelPitch = 1.15;  // of labels below one another

/// What plots are drawn on: pixels or SVG.
class Paper {
 public:
  virtual ~Paper() = default;
  virtual void segments(const std::vector<Segment2>& lines, double thickness,
                        const Color& color) = 0;
  virtual void polygon(const std::vector<Vector2d>& corners, const Color& color) = 0;
  virtual void disc(const Vector2d& center, double radius, const Color& color) = 0;
  virtual void picture(const Box2& place, const Image& image) = 0;
  virtual void text(const Vector2d& at, const std::string& line, double size, TextAnchor anchor,
                    bool bold) = 0;
  virtual void text_upwards(const Vector2d& at, const std::string& line, double size) = 0;
};

class PixelPaper : public Paper {
 public:
  explicit PixelPaper(Image& image) : canvas_(image), image_(&image) {}
  void segments(const std::vector<Segment2>& lines, double thickness, const Color& color) override {
    canvas_.segments(lines, thickness, color);
  }
  void polygon(const std::vector<Vector2d>& corners, const Color& color) override {
    canvas_.polygon(corners, color);
  }
  void disc(const Vector2d& center, double radius, const Color& color) override {
    canvas_.disc(center, radius, color);
  }
  void picture(const Box2& place, const Image& image) override {
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
            &image_
                 ->data[3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(image_->width) +
                             static_cast<std::size_t>(x))]);
      }
    }
  }
  void text(const Vector2d& at, const std::string& line, double size, TextAnchor anchor,
            bool bold) override {
    canvas_.text(at, line, size, kPlotInk, anchor, bold);
  }
  void text_upwards(const Vector2d& at, const std::string& line, double size) override {
    canvas_.text_upwards(at, line, size, kPlotInk);
  }

 private:
  Canvas canvas_;
  Image* image_;
};

class SvgPaper : public Paper {
 public:
  std::string body;

  void segments(const std::vector<Segment2>& lines, double thickness, const Color& color) override {
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
  void polygon(const std::vector<Vector2d>& corners, const Color& color) override {
    body += "<path d=\"M";
    for (const Vector2d& c : corners) body += number(c.x()) + " " + number(c.y()) + " ";
    body += "Z\"" + fill(color) + "/>\n";
  }
  void disc(const Vector2d& center, double radius, const Color& color) override {
    body += "<circle cx=\"" + number(center.x()) + "\" cy=\"" + number(center.y()) + "\" r=\"" +
            number(radius) + "\"" + fill(color) + "/>\n";
  }
  void picture(const Box2& place, const Image& image) override {
    body += "<image x=\"" + number(place.x1) + "\" y=\"" + number(place.y1) + "\" width=\"" +
            number(place.width()) + "\" height=\"" + number(place.height()) +
            "\" preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\" "
            "href=\"data:image/png;base64," +
            base64(encode_png(image)) + "\"/>\n";
  }
  void text(const Vector2d& at, const std::string& line, double size, TextAnchor anchor,
            bool bold) override {
    body +=
        "<text x=\"" + number(at.x()) + "\" y=\"" + number(at.y()) + "\" dy=\".35em\"" + font(size);
    if (anchor == TextAnchor::kCenter) body += " text-anchor=\"middle\"";
    if (anchor == TextAnchor::kRight) body += " text-anchor=\"end\"";
    if (bold) body += " font-weight=\"bold\"";
    body += ">" + escape(line) + "</text>\n";
  }
  void text_upwards(const Vector2d& at, const std::string& line, double size) override {
    body += "<text transform=\"translate(" + number(at.x()) + " " + number(at.y()) +
            ") rotate(-90)\" dy=\".35em\" text-anchor=\"middle\"" + font(size) + ">" +
            escape(line) + "</text>\n";
  }

 private:
  static std::string number(double value) {
    const std::string out = format_number(value, 1);
    return out.size() > 2 && out.compare(out.size() - 2, 2, ".0") == 0
               ? out.substr(0, out.size() - 2)
               : out;
  }
  static std::string hex(const Color& color) {
    char text[8];
    std::snprintf(text, sizeof text, "#%02x%02x%02x", color.red, color.green, color.blue);
    return text;
  }
  static std::string fill(const Color& color) {
    std::string out = " fill=\"" + hex(color) + "\"";
    if (color.alpha < 1.0) out += " fill-opacity=\"" + format_number(color.alpha, 2) + "\"";
    return out;
  }
  /// Canvas draws letters of 0.8 of a line's height.
  static std::string font(double size) {
    return " font-size=\"" + number(0.8 * size) + "\" fill=\"" + hex(kPlotInk) + "\"";
  }
  static std::string escape(const std::string& text) {
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
};

struct Range {
  double low = std::numeric_limits<double>::infinity();
  double high = -std::numeric_limits<double>::infinity();

  void add(double value) {
    if (!std::isfinite(value)) return;
    low = std::min(low, value);
    high = std::max(high, value);
  }
  void add(const std::vector<double>& values) {
    for (const double value : values) add(value);
  }
  bool empty() const { return !(low <= high); }
};

void check_series(const PlotSeries& s) {
  const auto expect = [&](const char* name, const std::vector<double>& values, bool optional) {
    if (values.size() == s.x.size() || (optional && values.empty())) return;
    throw std::invalid_argument("plot series '" + s.name + "': found " +
                                std::to_string(values.size()) + " values of " + name +
                                ", expected " + std::to_string(s.x.size()));
  };
  using Kind = PlotSeries::Kind;
  if (s.kind == Kind::kImage) {
    require_picture(s.image, "plot image");
    if (s.x.size() == 2 && s.y.size() == 2 && s.x[0] < s.x[1] && s.y[0] < s.y[1]) return;
    throw std::invalid_argument("plot image '" + s.name +
                                "': expected two ascending values of x and of y");
  }
  if (s.kind == Kind::kLine || s.kind == Kind::kPoints) expect("y", s.y, false);
  const bool needs_both = s.kind == Kind::kBand || s.kind == Kind::kBoxes;
  expect("low", s.low, !needs_both);
  expect("high", s.high, !needs_both);
  if (s.kind == Kind::kBoxes) expect("right", s.right, false);
}

/// 1, 2 and 5 times powers of ten.
Ticks logarithmic_ticks(double low, double high) {
  Ticks ticks;
  const bool wide = std::log10(high / low) > 3.5;
  for (int power = static_cast<int>(std::floor(std::log10(low))); power <= 12; ++power) {
    for (const double factor : {1.0, 2.0, 5.0}) {
      if (wide && factor != 1.0) continue;
      const double value = factor * std::pow(10.0, power);
      if (value < low * (1.0 - 1e-9)) continue;
      if (value > high * (1.0 + 1e-9)) return ticks;
      ticks.values.push_back(value);
      ticks.labels.push_back(format_number(value, std::max(0, -power)));
    }
  }
  return ticks;
}

Ticks ticks_of(const PlotAxis& axis, const Range& range, int count) {
  Ticks ticks;
  if (axis.hidden) return ticks;
  if (!axis.names.empty()) {
    for (const auto& [value, name] : axis.names) {
      if (value < range.low || value > range.high) continue;
      ticks.values.push_back(value);
      ticks.labels.push_back(name);
    }
    return ticks;
  }
  if (axis.logarithmic) return logarithmic_ticks(range.low, range.high);
  ticks = make_ticks(range.low, range.high, count);
  if (axis.whole && ticks.step < 1.0) ticks = multiples_of(1.0, range.low, range.high);
  return ticks;
}

/// Connected lines cut into dashes that go on from one to the next.
std::vector<Segment2> dashes_along(const std::vector<Segment2>& lines, double dash, double gap) {
  std::vector<Segment2> out;
  double phase = 0.0;  // since the last dash began
  const Vector2d* last = nullptr;
  for (const Segment2& line : lines) {
    if (!last || (*last - line.first).norm() > 1e-6) phase = 0.0;
    last = &line.second;
    const double length = (line.second - line.first).norm();
    if (!(length > 0.0)) continue;
    const Vector2d along = (line.second - line.first) / length;
    double s = 0.0;
    while (s < length) {
      const bool drawn = phase < dash - 1e-6;
      const double step = std::min(length - s, (drawn ? dash : dash + gap) - phase);
      if (drawn) out.emplace_back(line.first + s * along, line.first + (s + step) * along);
      s += std::max(step, 1e-6);
      phase += std::max(step, 1e-6);
      if (phase > dash + gap - 1e-6) phase = 0.0;
    }
  }
  return out;
}

/// The text size at which a line is no longer than there is room.
double fitted_size(const std::string& line, double size, double room, bool bold = false) {
  const double needed = 1.03 * Canvas::text_size(line, size, bold).x();
  return needed <= room ? size : std::max(4.0, size * room / needed);
}

/// One panel: data ranges, ticks and the place of its axes.
class Panel {
 public:
  Panel(const Plot& plot, const PlotStyle& style) : plot_(plot), text_(style.text_size) {
    for (const PlotSeries& s : plot.series) check_series(s);
    x_ = range(plot.x, true);
    y_ = range(plot.y, false);
    if (x_.empty() || y_.empty()) {
      throw NoAnswerError("plot" + (plot.title.empty() ? "" : " '" + plot.title + "'") +
                          ": there is no finite value to show");
    }
    widen(plot.x, &x_, 0.0);
    widen(plot.y, &y_, 0.05);
    std::size_t labels = 0;
    for (const PlotSeries& s : plot.series) labels += s.label.empty() ? 0 : 1;
    labels_inside_ = static_cast<double>(labels) * kLabelPitch * text_ > 0.65 * style.panel_height;
  }

  /// Space left of the axes that labels and title need.
  double left_margin(const PlotStyle& style) const {
    const Ticks ticks = ticks_of(plot_.y, y_, y_count(style.panel_height));
    double widest = 0.0;
    for (const std::string& label : ticks.labels) widest = std::max(widest, width(label));
    return 0.6 * text_ + widest + 0.5 * text_ + (plot_.y.title.empty() ? 0.0 : 1.5 * text_);
  }

  double right_margin() const {
    double widest = 0.0;
    for (const PlotSeries& s : plot_.series) {
      if (!labels_inside_) widest = std::max(widest, width(s.label));
    }
    return std::max(1.6 * text_, widest > 0.0 ? widest + 1.8 * text_ : 0.0);
  }

  void place(const Box2& area) {
    area_ = area;
    legend_rows_ = plan_legend(area.x1, area.x2);
    const double top = area.y1 + (plot_.title.empty() ? 0.4 : kLineHeight + 0.3) * text_ +
                       kLineHeight * text_ * static_cast<double>(legend_rows_.size());
    const double bottom = area.y2 - (plot_.x.hidden ? 0.6 : 1.6) * text_ -
                          (plot_.x.title.empty() ? 0.0 : 1.5 * text_);
    axes_ = {area.x1, top, area.x2, std::max(bottom, top + 2.0 * text_)};
  }

  /// Pixels for a unit at which both ranges fit.
  double scale() const {
    return std::min(axes_.width() / (x_.high - x_.low), axes_.height() / (y_.high - y_.low));
  }
  /// Lengthens the ranges around their middles.
  void set_scale(double pixels) {
    const auto lengthen = [](Range* range, double length) {
      const double middle = 0.5 * (range->low + range->high);
      *range = {middle - 0.5 * length, middle + 0.5 * length};
    };
    lengthen(&x_, axes_.width() / pixels);
    lengthen(&y_, axes_.height() / pixels);
  }

  void draw(Paper& paper) const {
    const Ticks xs = ticks_of(plot_.x, x_, x_count()),
                ys = ticks_of(plot_.y, y_, y_count(axes_.height()));
    const double fine = std::max(1.0, std::floor(text_ / 24.0));
    using Kind = PlotSeries::Kind;
    for (const PlotSeries& s : plot_.series) {
      if (s.kind == Kind::kImage) draw_series(paper, s);  // below the grid
    }
    std::vector<Segment2> grid;
    for (const double value : xs.values) {
      const double at = std::round(pixel_x(value));
      grid.push_back({{at, axes_.y1}, {at, axes_.y2}});
    }
    for (const double value : ys.values) {
      const double at = std::round(pixel_y(value));
      grid.push_back({{axes_.x1, at}, {axes_.x2, at}});
    }
    if (plot_.y.names.empty()) {
      paper.segments(grid, fine, kGrid);
    } else {
      grid.resize(xs.values.size());
      paper.segments(grid, fine, kGrid);
    }
    for (const Kind kind : {Kind::kBand, Kind::kBoxes, Kind::kLine, Kind::kPoints}) {
      for (const PlotSeries& s : plot_.series) {
        if (s.kind == kind) draw_series(paper, s);
      }
    }
    paper.segments({{{axes_.x1, axes_.y1}, {axes_.x1, axes_.y2}},
                    {{axes_.x1, axes_.y2}, {axes_.x2, axes_.y2}}},
                   1.4 * fine, kPlotInk);
    double last_end = -1e9;
    for (std::size_t i = 0; i < xs.values.size(); ++i) {
      const double at = pixel_x(xs.values[i]), half = 0.5 * width(xs.labels[i]);
      if (at - half < last_end + 0.4 * text_) continue;  // logarithmic ticks may stand close
      last_end = at + half;
      paper.text({at, axes_.y2 + 0.9 * text_}, xs.labels[i], text_, TextAnchor::kCenter, false);
    }
    for (std::size_t i = 0; i < ys.values.size(); ++i) {
      paper.text({axes_.x1 - 0.5 * text_, pixel_y(ys.values[i])}, ys.labels[i], text_,
                 TextAnchor::kRight, false);
    }
    if (!plot_.x.title.empty()) {
      paper.text({0.5 * (axes_.x1 + axes_.x2), axes_.y2 + (plot_.x.hidden ? 1.0 : 2.25) * text_},
                 plot_.x.title, fitted_size(plot_.x.title, text_, axes_.width()),
                 TextAnchor::kCenter, false);
    }
    if (!plot_.y.title.empty()) {
      paper.text_upwards({1.0 * text_, 0.5 * (axes_.y1 + axes_.y2)}, plot_.y.title,
                         fitted_size(plot_.y.title, text_, area_.height()));
    }
    if (!plot_.title.empty()) {
      paper.text({axes_.x1, area_.y1 + 0.75 * text_}, plot_.title,
                 fitted_size(plot_.title, 1.05 * text_, area_.width(), true), TextAnchor::kLeft,
                 true);
    }
    draw_legend(paper);
    draw_labels(paper);
    for (const PlotNote& note : plot_.notes) {
      paper.text(at(note.x, note.y), note.text, text_, note.anchor, false);
    }
  }

 private:
  double width(const std::string& line) const {
    return line.empty() ? 0.0 : 1.03 * Canvas::text_size(line, text_).x();
  }
  int y_count(double height) const {
    return std::clamp(static_cast<int>(height / (1.8 * text_)), 2, 8);
  }
  int x_count() const {
    // Labels of the ticks must not touch.
    int count = std::clamp(static_cast<int>(axes_.width() / (4.5 * text_)), 2, 14);
    for (; count > 2; --count) {
      const Ticks ticks = ticks_of(plot_.x, x_, count);
      double widest = 0.0;
      for (const std::string& label : ticks.labels) widest = std::max(widest, width(label));
      const double apart =
          ticks.values.size() < 2 ? 1e9 : axes_.width() / (x_.high - x_.low) * ticks.step;
      if (plot_.x.logarithmic || apart > widest + 0.8 * text_) break;
    }
    return count;
  }

  Range range(const PlotAxis& axis, bool along_x) const {
    Range out;
    for (const PlotSeries& s : plot_.series) {
      if (along_x) {
        out.add(s.x);
        out.add(s.right);
      } else {
        out.add(s.y);
        out.add(s.low);
        out.add(s.high);
      }
    }
    if (out.empty()) return out;
    if (axis.low) out.low = *axis.low;
    if (axis.high) out.high = *axis.high;
    return out;
  }

  static void widen(const PlotAxis& axis, Range* range, double share) {
    if (axis.logarithmic) {
      if (!(range->low > 0.0)) {
        throw std::invalid_argument("plot axis '" + axis.title +
                                    "': a logarithmic axis begins at " +
                                    format_number(range->low, 3) + ", expected > 0");
      }
      if (!(range->high > range->low)) range->high = 10.0 * range->low;
      return;
    }
    const double least =
        1e-6 * std::max(1.0, std::max(std::abs(range->low), std::abs(range->high)));
    const double span = range->high - range->low;
    if (span < least) {
      if (!axis.low) range->low -= 0.5;
      if (!axis.high) range->high += 0.5;
      if (!(range->high > range->low)) range->high = range->low + 1.0;
      return;
    }
    if (!axis.low) range->low -= share * span;
    if (!axis.high) range->high += share * span;
    if (!(range->high > range->low)) range->high = range->low + 1.0;
  }

  double pixel_x(double x) const {
    const double share = plot_.x.logarithmic ? std::log(x / x_.low) / std::log(x_.high / x_.low)
                                             : (x - x_.low) / (x_.high - x_.low);
    return axes_.x1 + share * axes_.width();
  }
  double pixel_y(double y) const {
    const double share = plot_.y.logarithmic ? std::log(y / y_.low) / std::log(y_.high / y_.low)
                                             : (y - y_.low) / (y_.high - y_.low);
    return axes_.y2 - share * axes_.height();
  }
  Vector2d at(double x, double y) const { return {pixel_x(x), pixel_y(y)}; }
  Vector2d clamped(double x, double y) const {
    return {std::clamp(pixel_x(x), axes_.x1, axes_.x2), std::clamp(pixel_y(y), axes_.y1, axes_.y2)};
  }

  void draw_series(Paper& paper, const PlotSeries& s) const {
    const double thickness = s.thickness * text_ / 18.0;
    const std::size_t n = s.x.size();
    switch (s.kind) {
      case PlotSeries::Kind::kImage: {
        const Vector2d a = at(s.x[0], s.y[1]), b = at(s.x[1], s.y[0]);
        paper.picture({a.x(), a.y(), b.x(), b.y()}, s.image);
        break;
      }
      case PlotSeries::Kind::kLine: {
        std::vector<Segment2> lines;
        for (std::size_t i = 0; i + 1 < n; ++i) {
          Vector2d a = at(s.x[i], s.y[i]), b = at(s.x[i + 1], s.y[i + 1]);
          if (a.allFinite() && b.allFinite() && clip_segment(axes_, &a, &b)) {
            lines.emplace_back(a, b);
          }
        }
        if (s.dashed) {
          paper.segments(dashes_along(lines, 0.5 * text_, 0.4 * text_), thickness, s.color);
        } else {
          paper.segments(lines, thickness, s.color);
        }
        break;
      }
      case PlotSeries::Kind::kPoints: {
        std::vector<Segment2> bars;
        const double cap = 0.22 * text_ * s.marker_size;
        for (std::size_t i = 0; i < n; ++i) {
          if (s.low.empty() || s.high.empty() || !std::isfinite(s.low[i] + s.high[i])) continue;
          const Vector2d ends[2] = {at(s.x[i], s.low[i]), at(s.x[i], s.high[i])};
          Vector2d a = ends[0], b = ends[1];
          if (!a.allFinite() || !b.allFinite() || !clip_segment(axes_, &a, &b)) continue;
          bars.emplace_back(a, b);
          for (const Vector2d& end : ends) {  // no cap where the bar leaves the panel
            if (!axes_.contains(end)) continue;
            bars.push_back({{end.x() - cap, end.y()}, {end.x() + cap, end.y()}});
          }
        }
        paper.segments(bars, std::max(1.0, 0.7 * thickness), s.color);
        for (std::size_t i = 0; i < n; ++i) {
          const Vector2d p = at(s.x[i], s.y[i]);
          if (p.allFinite() && axes_.grown(0.5).contains(p)) marker(paper, p, s);
        }
        break;
      }
      case PlotSeries::Kind::kBand: {
        for (std::size_t begin = 0; begin < n;) {
          std::size_t end = begin;
          std::vector<Vector2d> ring;
          while (end < n && std::isfinite(s.x[end] + s.low[end] + s.high[end])) {
            ring.push_back(clamped(s.x[end], s.high[end]));
            ++end;
          }
          for (std::size_t i = end; i-- > begin;) ring.push_back(clamped(s.x[i], s.low[i]));
          if (end > begin + 1) paper.polygon(ring, s.color);
          begin = std::max(end, begin + 1);
        }
        break;
      }
      case PlotSeries::Kind::kBoxes: {
        for (std::size_t i = 0; i < n; ++i) {
          if (!std::isfinite(s.x[i] + s.right[i] + s.low[i] + s.high[i])) continue;
          const Vector2d a = clamped(s.x[i], s.low[i]), b = clamped(s.right[i], s.high[i]);
          if (std::abs(b.x() - a.x()) < 1e-6 || std::abs(b.y() - a.y()) < 1e-6) continue;
          paper.polygon({a, {b.x(), a.y()}, b, {a.x(), b.y()}}, s.color);
        }
        break;
      }
    }
  }

  void marker(Paper& paper, const Vector2d& p, const PlotSeries& s) const {
    const double r = 0.24 * text_ * s.marker_size;
    const Color& color = s.color;
    switch (((s.marker % 4) + 4) % 4) {
      case 0:
        paper.disc(p, r, color);
        break;
      case 1: {
        const double h = 0.86 * r;
        paper.polygon(
            {p + Vector2d(-h, -h), p + Vector2d(h, -h), p + Vector2d(h, h), p + Vector2d(-h, h)},
            color);
        break;
      }
      case 2:
        paper.polygon({p + Vector2d(0, -1.2 * r), p + Vector2d(1.1 * r, 0.8 * r),
                       p + Vector2d(-1.1 * r, 0.8 * r)},
                      color);
        break;
      default:
        paper.polygon({p + Vector2d(0, -1.3 * r), p + Vector2d(1.3 * r, 0),
                       p + Vector2d(0, 1.3 * r), p + Vector2d(-1.3 * r, 0)},
                      color);
    }
  }

  double entry_width(const PlotSeries& s) const { return 2.2 * text_ + width(s.name); }

  std::vector<std::vector<const PlotSeries*>> plan_legend(double left, double right) const {
    std::vector<std::vector<const PlotSeries*>> rows;
    double x = 0.0;
    for (const PlotSeries& s : plot_.series) {
      if (s.name.empty()) continue;
      if (rows.empty() || x + entry_width(s) > right - left) {
        rows.emplace_back();
        x = 0.0;
      }
      rows.back().push_back(&s);
      x += entry_width(s) + 1.2 * text_;
    }
    return rows;
  }

  void draw_legend(Paper& paper) const {
    double y = area_.y1 + (plot_.title.empty() ? 0.8 : kLineHeight + 0.65) * text_;
    for (const auto& row : legend_rows_) {
      double x = axes_.x1;
      for (const PlotSeries* s : row) {
        const double thickness = s->thickness * text_ / 18.0;
        const Vector2d a(x, y), b(x + 1.6 * text_, y);
        switch (s->kind) {
          case PlotSeries::Kind::kLine:
            if (s->dashed) {
              paper.segments(dashes_along({{a, b}}, 0.5 * text_, 0.4 * text_), thickness, s->color);
            } else {
              paper.segments({{a, b}}, thickness, s->color);
            }
            break;
          case PlotSeries::Kind::kPoints:
            marker(paper, 0.5 * (a + b), *s);
            break;
          default: {
            const double h = 0.36 * text_;
            paper.polygon({{a.x(), y - h}, {b.x(), y - h}, {b.x(), y + h}, {a.x(), y + h}},
                          s->color);
          }
        }
        paper.text({x + 2.1 * text_, y}, s->name,
                   fitted_size(s->name, text_, area_.width() - 2.2 * text_), TextAnchor::kLeft,
                   false);
        x += entry_width(*s) + 1.2 * text_;
      }
      y += kLineHeight * text_;
    }
  }

  /// Words beside the right ends, pushed apart where they would meet.
  void draw_labels(Paper& paper) const {
    struct Label {
      const PlotSeries* series;
      Vector2d end;
      double y;
    };
    std::vector<Label> labels;
    for (const PlotSeries& s : plot_.series) {
      if (s.label.empty()) continue;
      for (std::size_t i = s.x.size(); i-- > 0;) {
        const double y = s.y.size() == s.x.size() ? s.y[i] : s.high[i];
        const Vector2d p = at(s.x[i], y);
        if (!p.allFinite()) continue;
        const Vector2d end = clamped(s.x[i], y);
        labels.push_back({&s, end, end.y()});
        break;
      }
    }
    if (labels_inside_) {
      // Too many for a column: beside their ends, where there is room.
      std::vector<Box2> taken;
      const double size = 0.8 * text_;
      for (const Label& label : labels) {
        const Vector2d half =
            0.5 * Vector2d(1.03 * Canvas::text_size(label.series->label, size).x(), size);
        for (const Vector2d& way :
             {Vector2d(1, 0), Vector2d(0, -1), Vector2d(0, 1), Vector2d(-1, 0)}) {
          const Vector2d at = label.end + way.cwiseProduct(half + Vector2d::Constant(0.45 * text_));
          const Box2 box{at.x() - half.x(), at.y() - half.y(), at.x() + half.x(),
                         at.y() + half.y()};
          if (box.x1 < axes_.x1 || box.y1 < axes_.y1 || box.x2 > axes_.x2 || box.y2 > axes_.y2) {
            continue;
          }
          const bool free = std::none_of(taken.begin(), taken.end(), [&](const Box2& t) {
            return box.x1 < t.x2 && t.x1 < box.x2 && box.y1 < t.y2 && t.y1 < box.y2;
          });
          if (!free) continue;
          taken.push_back(box);
          paper.polygon({{box.x1, box.y1}, {box.x2, box.y1}, {box.x2, box.y2}, {box.x1, box.y2}},
                        {255, 255, 255, 0.75});
          paper.text(at, label.series->label, size, TextAnchor::kCenter, false);
          break;
        }
      }
      return;
    }
    std::stable_sort(labels.begin(), labels.end(),
                     [](const Label& a, const Label& b) { return a.end.y() < b.end.y(); });
    // From the top down as close as may be, then back up from the lower edge.
    const double pitch = kLabelPitch * text_;
    double limit = axes_.y1;
    for (Label& label : labels) {
      label.y = std::max(label.y, limit);
      limit = label.y + pitch;
    }
    limit = axes_.y2;
    for (std::size_t i = labels.size(); i-- > 0;) {
      labels[i].y = std::min(labels[i].y, limit);
      limit = labels[i].y - pitch;
    }
    for (const Label& label : labels) {
      const double x = axes_.x2 + 1.1 * text_;
      paper.segments({{{label.end.x() + 0.3 * text_, label.end.y()}, {x - 0.25 * text_, label.y}}},
                     1.0, label.series->color.with_alpha(0.7));
      paper.text({x, label.y}, label.series->label, text_, TextAnchor::kLeft, false);
    }
  }

  const Plot& plot_;
  double text_;
  bool labels_inside_ = false;
  Range x_, y_;
  Box2 area_, axes_;
  std::vector<std::vector<const PlotSeries*>> legend_rows_;
};

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
    paper.text(
        {0.6 * style.text_size, 1.2 * style.text_size}, sheet.title,
        fitted_size(sheet.title, 1.25 * style.text_size, style.width - 1.2 * style.text_size, true),
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

std::string plots_svg(const PlotSheet& sheet, const PlotStyle& style, bool standalone) {
  const Layout layout = lay_out(sheet, style);
  SvgPaper paper;
  draw(paper, sheet, layout, style);
  const std::string size = std::to_string(style.width) + " " + std::to_string(layout.height);
  return std::string("<svg") + (standalone ? " xmlns=\"http://www.w3.org/2000/svg\"" : "") +
         " viewBox=\"0 0 " + size +
         "\" font-family=\"Arial, Helvetica, sans-serif\">\n<rect width=\"100%\" height=\"100%\" "
         "fill=\"#ffffff\"/>\n" +
         paper.body + "</svg>\n";
}

}  // namespace camber
