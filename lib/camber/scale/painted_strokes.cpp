#include "camber/scale/painted_strokes.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "camber/core/median.h"
#include "camber/core/threads.h"

namespace camber {
namespace {

constexpr double kLeastContrast = 8.0;  // intensities, of paint
constexpr double kThinnest = 1.5;       // px

/// A bar in one row.
struct Bar {
  double left = 0.0, right = 0.0;  // px
  double contrast = 0.0;           // intensities
  double middle() const { return 0.5 * (left + right); }
  double width() const { return right - left; }
};

/// An edge in one row: a rise of the intensity to the right, or a fall.
struct Edge {
  double column;
  double step;  // intensities, > 0: a rise
};

class RowBars {
 public:
  RowBars(const GrayImage& image, const std::vector<std::uint8_t>& visible)
      : image_(image), visible_(visible) {}

  std::vector<Bar> find(int v) const {
    const std::vector<double> steps = steps_of(v);
    const std::vector<Edge> edges = edges_of(v, steps);
    std::vector<Bar> out;
    const double widest = image_.width / 8.0;
    for (std::size_t i = 0; i < edges.size(); ++i) {
      if (edges[i].step < 0) continue;
      for (std::size_t j = i + 1; j < edges.size(); ++j) {
        const double width = edges[j].column - edges[i].column;
        if (width > widest) break;
        if (edges[j].step > 0) {
          if (edges[j].step > 0.7 * edges[i].step) break;  // another bar begins
          continue;
        }
        const double ratio = -edges[j].step / edges[i].step;
        if (ratio < 0.5) continue;
        if (ratio > 2.0 || width < kThinnest) break;
        const double contrast = contrast_of(v, edges[i].column, edges[j].column);
        if (contrast > 0.5 * std::min(edges[i].step, -edges[j].step)) {
          out.push_back({edges[i].column, edges[j].column, contrast});
        }
        break;
      }
    }
    return out;
  }

  /// Mean between two columns over the brighter of both sides, intensities.
  double contrast_of(int v, double left, double right) const {
    const double width = right - left, inset = std::min(0.2 * width, 2.0);
    const double side = std::clamp(0.5 * width, 2.0, 10.0);
    const double inside = mean(v, left + inset, right - inset);
    return inside - std::max(mean(v, left - 1.0 - side, left - 1.0),
                             mean(v, right + 1.0, right + 1.0 + side));
  }

  bool visible(double u, double v) const {
    const auto x = static_cast<int>(std::lround(u)), y = static_cast<int>(std::lround(v));
    if (x < 0 || y < 0 || x >= image_.width || y >= image_.height) return false;
    return visible_[static_cast<std::size_t>(y) * static_cast<std::size_t>(image_.width) +
                    static_cast<std::size_t>(x)] != 0;
  }

  int height() const { return image_.height; }
  int width() const { return image_.width; }

 private:
  /// Steps of the intensity between x and x + 1, over two pixels to each side.
  std::vector<double> steps_of(int v) const {
    std::vector<double> out(static_cast<std::size_t>(image_.width), 0.0);
    const std::uint8_t* row = image_.row(v);
    for (int x = 1; x + 2 < image_.width; ++x) {
      out[static_cast<std::size_t>(x)] = 0.5 * (row[x + 2] + row[x + 1] - row[x] - row[x - 1]);
    }
    return out;
  }

  std::vector<Edge> edges_of(int v, const std::vector<double>& steps) const {
    std::vector<double> sizes;
    for (std::size_t x = 2; x + 3 < steps.size(); x += 3) {
      if (visible(static_cast<double>(x), v)) sizes.push_back(std::abs(steps[x]));
    }
    std::vector<Edge> out;
    if (sizes.size() < 8) return out;
    const double least = std::max(kLeastContrast, 3.5 * 1.48 * upper_median(std::move(sizes)));
    for (std::size_t x = 3; x + 4 < steps.size(); ++x) {
      const double size = std::abs(steps[x]), sign = steps[x] < 0 ? -1.0 : 1.0;
      if (size < least || size < sign * steps[x - 1] || size <= sign * steps[x + 1]) continue;
      if (!visible(static_cast<double>(x), v)) continue;
      double sum = 0.0, moment = 0.0;
      for (std::size_t k = x - 2; k <= x + 2; ++k) {
        const double weight = std::max(0.0, sign * steps[k]);
        sum += weight;
        moment += weight * (static_cast<double>(k) + 0.5);
      }
      out.push_back({moment / sum, steps[x]});
    }
    return out;
  }

  double mean(int v, double from, double to) const {
    const std::uint8_t* row = image_.row(v);
    const int a = std::clamp(static_cast<int>(std::lround(from)), 0, image_.width - 1);
    const int b = std::clamp(static_cast<int>(std::lround(to)), a, image_.width - 1);
    double sum = 0.0;
    for (int x = a; x <= b; ++x) sum += row[x];
    return sum / (b - a + 1);
  }

  const GrayImage& image_;
  const std::vector<std::uint8_t>& visible_;
};

/// A bar followed over rows, from below.
struct Trace {
  std::vector<int> rows;  // descending
  std::vector<Bar> bars;

  /// Middle expected in another row, and how far off a bar of this trace may be, px.
  void expect(int v, double* middle, double* reach) const {
    const std::size_t n = rows.size();
    *middle = bars.back().middle();
    *reach = 2.5 + 0.15 * bars.back().width();
    if (n == 2) {
      *middle += (bars[1].middle() - bars[0].middle()) / (rows[1] - rows[0]) * (v - rows[1]);
      *reach = 2.0 + 0.05 * bars.back().width();
    } else if (n > 2) {
      double sv = 0, su = 0, svv = 0, svu = 0;
      const std::size_t from = n > 10 ? n - 10 : 0;
      const auto count = static_cast<double>(n - from);
      for (std::size_t i = from; i < n; ++i) {
        const double t = rows[i] - v, u = bars[i].middle();
        sv += t;
        su += u;
        svv += t * t;
        svu += t * u;
      }
      const double slope = (count * svu - sv * su) / (count * svv - sv * sv);
      *middle = (su - slope * sv) / count;
      *reach = 1.0 + 0.15 * std::abs(slope) + 0.02 * bars.back().width();
    }
  }
};

std::vector<Trace> follow(const std::vector<std::vector<Bar>>& rows, int top) {
  std::vector<Trace> active, done;
  for (int v = top + static_cast<int>(rows.size()) - 1; v >= top; --v) {
    const std::vector<Bar>& row = rows[static_cast<std::size_t>(v - top)];
    std::vector<char> taken(row.size(), 0);
    std::vector<Trace> next;
    for (Trace& trace : active) {
      double middle, reach;
      trace.expect(v, &middle, &reach);
      const double width = trace.bars.back().width();
      std::size_t best = row.size();
      for (std::size_t k = 0; k < row.size(); ++k) {
        const double off = std::abs(row[k].middle() - middle);
        if (taken[k] || off > reach) continue;
        if (std::abs(row[k].width() - width) > std::max(1.2, 0.15 * width)) continue;
        reach = off;
        best = k;
      }
      const int missed = trace.rows.back() - v;
      const std::size_t n = trace.rows.size();
      if (best < row.size()) {
        taken[best] = 1;
        trace.rows.push_back(v);
        trace.bars.push_back(row[best]);
        next.push_back(std::move(trace));
      } else if (missed <= (n >= 8 ? 2 : n >= 4 ? 1 : 0)) {
        next.push_back(std::move(trace));
      } else if (n >= PaintedStroke::kLeastRows) {
        done.push_back(std::move(trace));
      }
    }
    for (std::size_t k = 0; k < row.size(); ++k) {
      if (!taken[k]) next.push_back({{v}, {row[k]}});
    }
    active = std::move(next);
  }
  for (Trace& trace : active) {
    if (trace.rows.size() >= PaintedStroke::kLeastRows) done.push_back(std::move(trace));
  }
  return done;
}

/// Least-squares polynomial of one edge, twice: what is far off the first does not count.
Eigen::Vector3d fit_edge(const std::vector<StrokeRow>& rows, double StrokeRow::*edge, double v0) {
  const int terms = rows.size() >= 10 ? 3 : 2;
  Eigen::Vector3d x = Eigen::Vector3d::Zero();
  for (int round = 0; round < 3; ++round) {
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const StrokeRow& r : rows) {
      const double t = r.row - v0;
      const Eigen::Vector3d basis(1.0, t, t * t);
      const double off = round == 0 ? 0.0 : r.*edge - x.dot(basis);
      const double weight = 1.0 / (1.0 + off * off / 0.25);  // Cauchy, half a pixel
      normal += weight * basis * basis.transpose();
      right += weight * r.*edge * basis;
    }
    x.setZero();
    x.head(terms) = normal.topLeftCorner(terms, terms).ldlt().solve(right.head(terms));
  }
  return x;
}

/// An end of a stroke: the row at which its contrast falls to half, and whether that is seen.
struct End {
  double row;
  bool seen;
};

End find_end(const RowBars& bars, const PaintedStroke& stroke, int from, int step) {
  constexpr int kBeyond = 3;    // rows without paint
  constexpr int kFarthest = 6;  // rows that the paint may go on after its edges are lost
  const auto contrast = [&](int v) -> std::optional<double> {
    if (v < 0 || v >= bars.height()) return std::nullopt;
    const StrokeRow edges = stroke.at(v);
    if (!bars.visible(edges.left, v) || !bars.visible(edges.right, v)) return std::nullopt;
    if (!(edges.right > edges.left)) return std::nullopt;
    return bars.contrast_of(v, edges.left, edges.right);
  };
  const double half = 0.5 * stroke.contrast;
  int v = from - 2 * step;
  std::optional<double> here = contrast(v);
  for (; here && std::abs(v + step - from) <= kFarthest; v += step) {
    const std::optional<double> next = contrast(v + step);
    if (!next) break;
    if (*next < half && *here >= half) {
      const double row = v + step * (*here - half) / std::max(*here - *next, 1e-6);
      for (int k = 2; k <= kBeyond; ++k) {
        const std::optional<double> beyond = contrast(v + k * step);
        if (!beyond || *beyond > half) return {row, false};
      }
      return {row, true};
    }
    here = next;
  }
  return {static_cast<double>(from), false};
}

std::optional<PaintedStroke> measure(const RowBars& bars, const Trace& trace) {
  PaintedStroke out;
  std::vector<double> contrasts;
  for (std::size_t i = 0; i < trace.rows.size(); ++i) {
    out.rows.push_back({trace.rows[i], trace.bars[i].left, trace.bars[i].right});
    contrasts.push_back(trace.bars[i].contrast);
  }
  out.contrast = upper_median(std::move(contrasts));
  out.fit_row = 0.5 * (trace.rows.front() + trace.rows.back());
  out.left_fit = fit_edge(out.rows, &StrokeRow::left, out.fit_row);
  out.right_fit = fit_edge(out.rows, &StrokeRow::right, out.fit_row);
  const End near = find_end(bars, out, trace.rows.front(), 1);
  const End far = find_end(bars, out, trace.rows.back(), -1);
  if (!(near.row > far.row + 2.0)) return std::nullopt;
  out.near_end = out.middle(near.row);
  out.far_end = out.middle(far.row);
  out.near_seen = near.seen;
  out.far_seen = far.seen;
  return out;
}

}  // namespace

StrokeRow PaintedStroke::at(double row) const {
  const double t = row - fit_row;
  const Eigen::Vector3d basis(1.0, t, t * t);
  return {static_cast<int>(std::lround(row)), left_fit.dot(basis), right_fit.dot(basis)};
}

std::vector<PaintedStroke> detect_painted_strokes(const GrayImage& image,
                                                  const std::vector<std::uint8_t>& visible, int top,
                                                  int num_threads) {
  if (image.empty() || visible.size() != image.pixels.size()) {
    throw std::invalid_argument("painted strokes: the image and its visible pixels differ in size");
  }
  const RowBars finder(image, visible);
  top = std::clamp(top, 0, image.height - 1);
  std::vector<std::vector<Bar>> rows(static_cast<std::size_t>(image.height - top));
  constexpr std::size_t kPiece = 16;
  parallel_for((rows.size() + kPiece - 1) / kPiece, num_threads, [&](std::size_t piece) {
    for (std::size_t k = kPiece * piece; k < std::min(rows.size(), kPiece * (piece + 1)); ++k) {
      rows[k] = finder.find(top + static_cast<int>(k));
    }
  });
  std::vector<PaintedStroke> out;
  for (const Trace& trace : follow(rows, top)) {
    if (auto stroke = measure(finder, trace)) out.push_back(std::move(*stroke));
  }
  std::stable_sort(out.begin(), out.end(), [](const PaintedStroke& a, const PaintedStroke& b) {
    return a.near_end.y() > b.near_end.y();
  });
  return out;
}

}  // namespace camber
