#include <algorithm>
#include <cmath>

#include "camber/render/detail/plot_panel.h"

namespace camber::detail {

using Eigen::Vector2d;

namespace {

const Color kGrid{222, 222, 222, 1.0};

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

}  // namespace

void Panel::draw(Paper& paper) const {
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
  paper.segments(
      {{{axes_.x1, axes_.y1}, {axes_.x1, axes_.y2}}, {{axes_.x1, axes_.y2}, {axes_.x2, axes_.y2}}},
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
               plot_.x.title, fitted_size(plot_.x.title, text_, axes_.width()), TextAnchor::kCenter,
               false);
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

void Panel::draw_series(Paper& paper, const PlotSeries& s) const {
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

void Panel::marker(Paper& paper, const Vector2d& p, const PlotSeries& s) const {
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
      paper.polygon({p + Vector2d(0, -1.3 * r), p + Vector2d(1.3 * r, 0), p + Vector2d(0, 1.3 * r),
                     p + Vector2d(-1.3 * r, 0)},
                    color);
  }
}

void Panel::draw_legend(Paper& paper) const {
  double y = area_.y1 + (plot_.title.empty() ? 0.8 : kPlotLineHeight + 0.65) * text_;
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
          paper.polygon({{a.x(), y - h}, {b.x(), y - h}, {b.x(), y + h}, {a.x(), y + h}}, s->color);
        }
      }
      paper.text({x + 2.1 * text_, y}, s->name,
                 fitted_size(s->name, text_, area_.width() - 2.2 * text_), TextAnchor::kLeft,
                 false);
      x += entry_width(*s) + 1.2 * text_;
    }
    y += kPlotLineHeight * text_;
  }
}

void Panel::draw_labels(Paper& paper) const {
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
        const Box2 box{at.x() - half.x(), at.y() - half.y(), at.x() + half.x(), at.y() + half.y()};
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
  const double pitch = kPlotLabelPitch * text_;
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

void Panel::draw_hover(SvgPaper& paper) const {
  for (const PlotSeries& s : plot_.series) {
    for (std::size_t i = 0; i < s.hover.size(); ++i) {
      if (!std::isfinite(s.x[i]) || !std::isfinite(s.y[i])) continue;
      const double before = i > 0 ? 0.5 * (s.x[i - 1] + s.x[i]) : s.x[i];
      const double after = i + 1 < s.x.size() ? 0.5 * (s.x[i] + s.x[i + 1]) : s.x[i];
      const double left = clamped(before, s.y[i]).x(), right = clamped(after, s.y[i]).x();
      if (right > left) paper.hover({left, axes_.y1, right, axes_.y2}, s.hover[i]);
    }
  }
}

}  // namespace camber::detail
