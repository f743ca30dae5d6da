// Ranges, ticks and places of a panel; plot_panel_drawing.cpp draws it.

#include "camber/render/detail/plot_panel.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/render/picture_file.h"

namespace camber::detail {

using Eigen::Vector2d;

namespace {

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

}  // namespace

Ticks ticks_of(const PlotAxis& axis, const PlotRange& range, int count) {
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

double fitted_size(const std::string& line, double size, double room, bool bold) {
  const double needed = 1.03 * Canvas::text_size(line, size, bold).x();
  return needed <= room ? size : std::max(4.0, size * room / needed);
}

Panel::Panel(const Plot& plot, const PlotStyle& style) : plot_(plot), text_(style.text_size) {
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
  labels_inside_ =
      static_cast<double>(labels) * kPlotLabelPitch * text_ > 0.65 * style.panel_height;
}

double Panel::left_margin(const PlotStyle& style) const {
  const Ticks ticks = ticks_of(plot_.y, y_, y_count(style.panel_height));
  double widest = 0.0;
  for (const std::string& label : ticks.labels) widest = std::max(widest, width(label));
  return 0.6 * text_ + widest + 0.5 * text_ + (plot_.y.title.empty() ? 0.0 : 1.5 * text_);
}

double Panel::right_margin() const {
  double widest = 0.0;
  for (const PlotSeries& s : plot_.series) {
    if (!labels_inside_) widest = std::max(widest, width(s.label));
  }
  return std::max(1.6 * text_, widest > 0.0 ? widest + 1.8 * text_ : 0.0);
}

void Panel::place(const Box2& area) {
  area_ = area;
  legend_rows_ = plan_legend(area.x1, area.x2);
  const double top = area.y1 + (plot_.title.empty() ? 0.4 : kPlotLineHeight + 0.3) * text_ +
                     kPlotLineHeight * text_ * static_cast<double>(legend_rows_.size());
  const double bottom =
      area.y2 - (plot_.x.hidden ? 0.6 : 1.6) * text_ - (plot_.x.title.empty() ? 0.0 : 1.5 * text_);
  axes_ = {area.x1, top, area.x2, std::max(bottom, top + 2.0 * text_)};
}

double Panel::scale() const {
  return std::min(axes_.width() / (x_.high - x_.low), axes_.height() / (y_.high - y_.low));
}

void Panel::set_scale(double pixels) {
  const auto lengthen = [](PlotRange* range, double length) {
    const double middle = 0.5 * (range->low + range->high);
    *range = {middle - 0.5 * length, middle + 0.5 * length};
  };
  lengthen(&x_, axes_.width() / pixels);
  lengthen(&y_, axes_.height() / pixels);
}

double Panel::width(const std::string& line) const {
  return line.empty() ? 0.0 : 1.03 * Canvas::text_size(line, text_).x();
}

int Panel::y_count(double height) const {
  return std::clamp(static_cast<int>(height / (1.8 * text_)), 2, 8);
}

int Panel::x_count() const {
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

PlotRange Panel::range(const PlotAxis& axis, bool along_x) const {
  PlotRange out;
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

void Panel::widen(const PlotAxis& axis, PlotRange* range, double share) {
  if (axis.logarithmic) {
    if (!(range->low > 0.0)) {
      throw std::invalid_argument("plot axis '" + axis.title + "': a logarithmic axis begins at " +
                                  format_number(range->low, 3) + ", expected > 0");
    }
    if (!(range->high > range->low)) range->high = 10.0 * range->low;
    return;
  }
  const double least = 1e-6 * std::max(1.0, std::max(std::abs(range->low), std::abs(range->high)));
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

double Panel::pixel_x(double x) const {
  const double share = plot_.x.logarithmic ? std::log(x / x_.low) / std::log(x_.high / x_.low)
                                           : (x - x_.low) / (x_.high - x_.low);
  return axes_.x1 + share * axes_.width();
}

double Panel::pixel_y(double y) const {
  const double share = plot_.y.logarithmic ? std::log(y / y_.low) / std::log(y_.high / y_.low)
                                           : (y - y_.low) / (y_.high - y_.low);
  return axes_.y2 - share * axes_.height();
}

Vector2d Panel::clamped(double x, double y) const {
  return {std::clamp(pixel_x(x), axes_.x1, axes_.x2), std::clamp(pixel_y(y), axes_.y1, axes_.y2)};
}

std::vector<std::vector<const PlotSeries*>> Panel::plan_legend(double left, double right) const {
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

}  // namespace camber::detail
