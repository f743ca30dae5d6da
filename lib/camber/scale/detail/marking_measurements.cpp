#include "camber/scale/detail/marking_measurements.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>

namespace camber::detail {
namespace {

constexpr int kBlocks = 3;  // a stroke's width is measured in so many pieces
// px, of a stroke whose width is measured: thinner ones are found up to a seventh too wide
constexpr double kThinnest = 3.5;
constexpr double kGate = 3.0;       // standard deviations
constexpr int kMostHidden = 2;      // strokes of a line in a row
constexpr double kFarthest = 60.0;  // m, of a marking

double azimuth(const RoadShape& road, const Eigen::Vector3d& direction) {
  return std::atan2(direction.dot(road.right()), direction.dot(road.ahead()));
}

/// The row at a share of a stroke's visible length in the image, from the near end.
double row_at(const PaintedStroke& stroke, double share) {
  return stroke.near_end.y() + share * (stroke.far_end.y() - stroke.near_end.y());
}

}  // namespace

Eigen::Vector3d MarkingMeasurements::direction_at(const RoadShape& road,
                                                  const PaintedStroke& stroke, double row) const {
  const double reach = std::max(1.0, 0.25 * (stroke.near_end.y() - stroke.far_end.y()));
  return (point(road, stroke.middle(row - reach)) - point(road, stroke.middle(row + reach)))
      .normalized();
}

double MarkingMeasurements::width_at(const RoadShape& road, const PaintedStroke& stroke,
                                     double row) const {
  const StrokeRow edges = stroke.at(row);
  const Eigen::Vector3d across = point(road, {edges.right, row}) - point(road, {edges.left, row});
  return across.cross(direction_at(road, stroke, row)).norm();
}

StrokeOnRoad MarkingMeasurements::on_road(const RoadShape& road,
                                          const PaintedStroke& stroke) const {
  StrokeOnRoad out;
  out.near = point(road, stroke.near_end);
  out.far = point(road, stroke.far_end);
  const double row = row_at(stroke, 0.5);
  out.middle = point(road, stroke.middle(row));
  out.valid = out.near.allFinite() && out.far.allFinite() && out.middle.allFinite() &&
              out.near.z() < out.far.z() && out.near.z() < kFarthest;
  if (!out.valid) return out;
  out.direction = (out.far - out.near).normalized();
  out.length = (out.far - out.near).norm();
  out.width = width_at(road, stroke, row);
  const StrokeRow edges = stroke.at(row);
  out.width_sigma = std::hypot(noise_.stroke_edge_px * std::sqrt(2.0) / (edges.right - edges.left),
                               noise_.painted_width);
  const auto end_sigma = [&](const Eigen::Vector2d& end) {
    const double by_row =
        (point(road, stroke.middle(end.y() + 0.5)) - point(road, stroke.middle(end.y() - 0.5)))
            .norm();
    return std::hypot(noise_.mark_end_row_px * by_row, noise_.painted_end);
  };
  out.near_sigma = end_sigma(stroke.near_end);
  out.far_sigma = end_sigma(stroke.far_end);
  out.valid = std::isfinite(out.width) && std::isfinite(out.near_sigma + out.far_sigma);
  return out;
}

int MarkingMeasurements::width_group(MarkingAssociation* out) {
  MarkingMeasurement shared;
  shared.kind = MarkingMeasurement::Kind::kSharedWidth;
  shared.group = out->groups++;
  out->measurements.push_back(shared);
  return shared.group;
}

void MarkingMeasurements::add_widths(std::size_t stroke, double expected, int group,
                                     MarkingAssociation* out) const {
  for (int block = 0; block < kBlocks; ++block) {
    MarkingMeasurement m;
    m.kind = MarkingMeasurement::Kind::kWidth;
    m.stroke = stroke;
    m.row = row_at(strokes_[stroke], (block + 0.5) / kBlocks);
    m.expected = expected;
    m.group = group;
    const StrokeRow edges = strokes_[stroke].at(m.row);
    if (edges.right - edges.left >= kThinnest) out->measurements.push_back(m);
  }
}

MarkingAssociation MarkingMeasurements::associate(const RoadShape& road, double slack) const {
  std::vector<StrokeOnRoad> on_road;
  for (const PaintedStroke& stroke : strokes_) on_road.push_back(this->on_road(road, stroke));
  MarkingAssociation out;
  out.kinds.assign(strokes_.size(), StrokeKind::kUnknown);
  if (sizes_.stripes()) find_crossings(on_road, slack, &out);
  const int lines = width_group(&out);
  if (sizes_.dashes()) find_lines(on_road, slack, lines, &out);
  if (sizes_.line_width > 0) find_long_lines(on_road, lines, &out);
  add_parallels(road, on_road, slack, &out);
  return out;
}

void MarkingMeasurements::find_lines(const std::vector<StrokeOnRoad>& on_road, double slack,
                                     int width_group_of_lines, MarkingAssociation* out) const {
  const double dash = sizes_.dash_length, period = sizes_.dash_length + sizes_.dash_gap;
  std::vector<std::size_t> candidates;
  std::vector<char> whole(on_road.size(), 0);
  for (std::size_t i = 0; i < on_road.size(); ++i) {
    const StrokeOnRoad& s = on_road[i];
    const PaintedStroke& stroke = strokes_[i];
    if (!s.valid || out->kinds[i] != StrokeKind::kUnknown) continue;
    if (!stroke.near_seen && !stroke.far_seen) continue;
    const double spread = std::hypot(s.width_sigma, slack);
    if (std::abs(std::log(s.width / sizes_.line_width)) > kGate * spread) continue;
    const double off = kGate * std::hypot(std::hypot(s.near_sigma, s.far_sigma), slack * dash);
    whole[i] = stroke.near_seen && stroke.far_seen;
    if (s.length > dash + off || (whole[i] && s.length < dash - off)) continue;
    if (!whole[i] && s.length < 0.3 * dash) continue;
    candidates.push_back(i);
  }
  // The middle of the whole stroke, from the ends that are seen.
  const auto middle = [&](std::size_t i) -> Eigen::Vector3d {
    const StrokeOnRoad& s = on_road[i];
    if (whole[i]) return 0.5 * (s.near + s.far);
    return strokes_[i].near_seen ? Eigen::Vector3d(s.near + 0.5 * dash * s.direction)
                                 : Eigen::Vector3d(s.far - 0.5 * dash * s.direction);
  };
  std::sort(candidates.begin(), candidates.end(),
            [&](std::size_t a, std::size_t b) { return middle(a).norm() < middle(b).norm(); });
  std::vector<char> used(on_road.size(), 0);
  std::vector<BrokenLine> found;
  for (std::size_t a = 0; a < candidates.size(); ++a) {
    if (used[candidates[a]]) continue;
    std::vector<std::size_t> line = {candidates[a]};
    std::vector<int> numbers = {0};
    for (std::size_t b = a + 1; b < candidates.size(); ++b) {
      const std::size_t i = candidates[b], last = line.back();
      if (used[i]) continue;
      const Eigen::Vector3d step = middle(i) - middle(last);
      const double length = step.norm();
      const int whole_periods = static_cast<int>(std::lround(length / period));
      if (whole_periods < 1 || whole_periods > kMostHidden + 1) continue;
      const double spread =
          std::hypot(std::hypot(on_road[i].far_sigma, on_road[last].near_sigma), slack * length);
      if (std::abs(length - whole_periods * period) > std::min(kGate * spread, 0.35 * period))
        continue;
      // A bend, and what the directions of short strokes are off.
      constexpr double kTurn = 0.1;
      const double turn =
          std::atan2(step.cross(on_road[last].direction).norm(), step.dot(on_road[last].direction));
      if (turn > kTurn + 0.3 / length) continue;
      line.push_back(i);
      numbers.push_back(numbers.back() + whole_periods);
    }
    if (line.size() == 1 && !whole[line[0]]) continue;
    for (const std::size_t i : line) used[i] = 1;
    found.push_back({std::move(line), std::move(numbers)});
  }
  // Beside what cannot be chance, a bar of the right length alone may be a kerb.
  const bool sure = !out->crossings.empty() ||
                    std::any_of(found.begin(), found.end(),
                                [](const BrokenLine& line) { return line.strokes.size() > 1; });
  for (BrokenLine& line : found) {
    if (!sure || line.strokes.size() > 1) add_line(std::move(line), width_group_of_lines, out);
  }
}

void MarkingMeasurements::add_line(BrokenLine line, int width_group_of_lines,
                                   MarkingAssociation* out) const {
  const double dash = sizes_.dash_length, period = sizes_.dash_length + sizes_.dash_gap;
  for (std::size_t k = 0; k < line.strokes.size(); ++k) {
    const std::size_t i = line.strokes[k];
    out->kinds[i] = StrokeKind::kDash;
    MarkingMeasurement end;
    end.kind = MarkingMeasurement::Kind::kEnd;
    end.stroke = i;
    end.group = out->groups;
    if (strokes_[i].near_seen) {
      end.row = 0.0;  // the near one
      end.expected = line.numbers[k] * period;
      out->measurements.push_back(end);
    }
    if (strokes_[i].far_seen) {
      end.row = 1.0;
      end.expected = line.numbers[k] * period + dash;
      out->measurements.push_back(end);
    }
    add_widths(i, sizes_.line_width, width_group_of_lines, out);
  }
  ++out->groups;
  out->lines.push_back(std::move(line.strokes));
}

void MarkingMeasurements::find_crossings(const std::vector<StrokeOnRoad>& on_road, double slack,
                                         MarkingAssociation* out) const {
  const double period = sizes_.stripe_width + sizes_.stripe_gap;
  std::vector<std::size_t> candidates;
  for (std::size_t i = 0; i < on_road.size(); ++i) {
    const StrokeOnRoad& s = on_road[i];
    if (!s.valid) continue;
    const double spread = std::hypot(s.width_sigma, slack);
    if (std::abs(std::log(s.width / sizes_.stripe_width)) > kGate * spread) continue;
    if (s.length < 1.5 * sizes_.stripe_width) continue;
    candidates.push_back(i);
  }
  std::sort(candidates.begin(), candidates.end(), [&](std::size_t a, std::size_t b) {
    return on_road[a].middle.x() < on_road[b].middle.x();
  });
  std::vector<char> used(on_road.size(), 0);
  const int widths = width_group(out);
  for (std::size_t a = 0; a < candidates.size(); ++a) {
    if (used[candidates[a]]) continue;
    std::vector<std::size_t> stripes = {candidates[a]};
    std::vector<int> numbers = {0};
    for (std::size_t b = a + 1; b < candidates.size(); ++b) {
      const std::size_t i = candidates[b], last = stripes.back();
      if (used[i]) continue;
      const StrokeOnRoad &s = on_road[i], &before = on_road[last];
      const Eigen::Vector3d step = s.middle - before.middle;
      // Side by side: they overlap along their direction.
      const double along = step.dot(before.direction);
      if (std::abs(along) > 0.4 * std::max(s.length, before.length)) continue;
      const double turn = std::acos(std::min(1.0, s.direction.dot(before.direction)));
      if (turn > 0.1 + slack + 0.1 / std::min(s.length, before.length)) continue;
      const double across = step.cross(before.direction).norm();
      const int whole = static_cast<int>(std::lround(across / period));
      if (whole < 1 || whole > kMostHidden + 1) continue;
      if (std::abs(across - whole * period) > (0.1 + slack) * whole * period) continue;
      stripes.push_back(i);
      numbers.push_back(numbers.back() + whole);
    }
    if (stripes.size() < 3) continue;
    const int across_group = out->groups++, azimuth_group = out->groups++;
    for (std::size_t k = 0; k < stripes.size(); ++k) {
      const std::size_t i = stripes[k];
      used[i] = 1;
      out->kinds[i] = StrokeKind::kStripe;
      MarkingMeasurement m;
      m.stroke = i;
      m.kind = MarkingMeasurement::Kind::kAcross;
      m.group = across_group;
      m.expected = numbers[k] * period;
      out->measurements.push_back(m);
      m.kind = MarkingMeasurement::Kind::kAzimuth;
      m.group = azimuth_group;
      m.row = row_at(strokes_[i], 0.5);
      m.expected = 0.0;
      out->measurements.push_back(m);
      add_widths(i, sizes_.stripe_width, widths, out);
      if (sizes_.stripe_length > 0 && strokes_[i].near_seen && strokes_[i].far_seen) {
        m.kind = MarkingMeasurement::Kind::kEnd;
        m.group = out->groups++;
        m.row = 0.0;
        m.expected = 0.0;
        out->measurements.push_back(m);
        m.row = 1.0;
        m.expected = sizes_.stripe_length;
        out->measurements.push_back(m);
      }
    }
    out->crossings.push_back(std::move(stripes));
  }
}

void MarkingMeasurements::find_long_lines(const std::vector<StrokeOnRoad>& on_road,
                                          int width_group_of_lines, MarkingAssociation* out) const {
  const double least = sizes_.dash_length > 0 ? 1.3 * sizes_.dash_length : 4.0;
  for (std::size_t i = 0; i < on_road.size(); ++i) {
    const StrokeOnRoad& s = on_road[i];
    if (!s.valid || out->kinds[i] != StrokeKind::kUnknown || s.length < least) continue;
    if (std::abs(std::log(s.width / sizes_.line_width)) > kGate * s.width_sigma) continue;
    out->kinds[i] = StrokeKind::kLine;
    add_widths(i, sizes_.line_width, width_group_of_lines, out);
  }
}

/// Between the middle lines of two strokes, m, across the first one, at a row of both.
double MarkingMeasurements::separation(const RoadShape& road, const PaintedStroke& stroke,
                                       const PaintedStroke& other, double row) const {
  const Eigen::Vector3d between = point(road, other.middle(row)) - point(road, stroke.middle(row));
  return between.cross(direction_at(road, stroke, row)).norm();
}

void MarkingMeasurements::add_parallels(const RoadShape& road,
                                        const std::vector<StrokeOnRoad>& on_road, double slack,
                                        MarkingAssociation* out) const {
  constexpr double kLeastRows = 6.0;
  const auto is_line = [&](std::size_t i) {
    return out->kinds[i] == StrokeKind::kDash || out->kinds[i] == StrokeKind::kLine;
  };
  for (std::size_t i = 0; i < on_road.size(); ++i) {
    if (!is_line(i)) continue;
    for (std::size_t j = i + 1; j < on_road.size(); ++j) {
      if (!is_line(j)) continue;
      const double low = std::min(strokes_[i].near_end.y(), strokes_[j].near_end.y());
      const double high = std::max(strokes_[i].far_end.y(), strokes_[j].far_end.y());
      if (low - high < kLeastRows) continue;
      MarkingMeasurement m;
      m.kind = MarkingMeasurement::Kind::kAzimuth;
      m.group = out->groups++;
      m.row = 0.5 * (low + high);
      m.stroke = i;
      out->measurements.push_back(m);
      m.stroke = j;
      out->measurements.push_back(m);
      if (!(sizes_.lane_width > 0)) continue;
      const double width = separation(road, strokes_[i], strokes_[j], m.row);
      if (!(std::abs(width / sizes_.lane_width - 1.0) <
            kGate * std::hypot(noise_.painted_lane, slack))) {
        continue;
      }
      m.kind = MarkingMeasurement::Kind::kLaneWidth;
      m.group = -1;
      m.stroke = i;
      m.other = j;
      m.expected = sizes_.lane_width;
      out->measurements.push_back(m);
    }
  }
}

double MarkingMeasurements::value(const RoadShape& road, const MarkingMeasurement& m) const {
  const PaintedStroke& stroke = strokes_[m.stroke];
  switch (m.kind) {
    case MarkingMeasurement::Kind::kWidth:
      return std::log(width_at(road, stroke, m.row) / m.expected);
    case MarkingMeasurement::Kind::kAzimuth:
      return azimuth(road, direction_at(road, stroke, m.row));
    case MarkingMeasurement::Kind::kLaneWidth:
      return separation(road, stroke, strokes_[m.other], m.row);
    default:
      return 0.0;
  }
}

/// Places along broken lines: the path over all ends that are seen, from the nearest on; and across
/// crossings, along the common perpendicular of their stripes.
void MarkingMeasurements::place_ends(const RoadShape& road, const MarkingAssociation& association,
                                     Eigen::VectorXd* values) const {
  const std::vector<MarkingMeasurement>& all = association.measurements;
  std::vector<double> travelled(static_cast<std::size_t>(association.groups), 0.0);
  std::vector<Eigen::Vector3d> last(travelled.size());
  std::vector<char> begun(travelled.size(), 0);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const MarkingMeasurement& m = all[k];
    if (m.kind != MarkingMeasurement::Kind::kEnd) continue;
    const auto g = static_cast<std::size_t>(m.group);
    const PaintedStroke& stroke = strokes_[m.stroke];
    const Eigen::Vector3d here = point(road, m.row == 0.0 ? stroke.near_end : stroke.far_end);
    if (begun[g]) travelled[g] += (here - last[g]).norm();
    begun[g] = 1;
    last[g] = here;
    (*values)[static_cast<Eigen::Index>(k)] = travelled[g];
  }
  for (const std::vector<std::size_t>& stripes : association.crossings) {
    Eigen::Vector3d direction = Eigen::Vector3d::Zero();
    std::vector<Eigen::Vector3d> middles;
    for (const std::size_t i : stripes) {
      const PaintedStroke& stroke = strokes_[i];
      direction += (point(road, stroke.far_end) - point(road, stroke.near_end)).normalized();
      middles.push_back(point(road, stroke.middle(row_at(stroke, 0.5))));
    }
    const Eigen::Vector3d across = direction.cross(road.normal()).normalized();
    for (std::size_t k = 0; k < all.size(); ++k) {
      if (all[k].kind != MarkingMeasurement::Kind::kAcross) continue;
      for (std::size_t i = 0; i < stripes.size(); ++i) {
        if (stripes[i] != all[k].stroke) continue;
        (*values)[static_cast<Eigen::Index>(k)] = across.dot(middles[i] - middles[0]);
      }
    }
  }
}

Eigen::VectorXd MarkingMeasurements::sigmas(const RoadShape& road,
                                            const MarkingAssociation& association) const {
  Eigen::VectorXd out(static_cast<Eigen::Index>(association.measurements.size()));
  for (std::size_t k = 0; k < association.measurements.size(); ++k) {
    const MarkingMeasurement& m = association.measurements[k];
    const PaintedStroke& stroke = strokes_[m.stroke];
    const StrokeOnRoad s = on_road(road, stroke);
    const double by_column = s.middle.z() / camera_.fx;  // m a pixel, across the view
    double sigma = 0.0;
    switch (m.kind) {
      case MarkingMeasurement::Kind::kWidth: {
        const StrokeRow edges = stroke.at(m.row);
        sigma = std::hypot(
            noise_.stroke_edge_px * std::sqrt(2.0) / std::max(edges.right - edges.left, 1.0),
            noise_.painted_width);
        break;
      }
      case MarkingMeasurement::Kind::kSharedWidth:
        sigma = noise_.painted_width;
        break;
      case MarkingMeasurement::Kind::kEnd:
        sigma = m.row == 0.0 ? s.near_sigma : s.far_sigma;
        break;
      case MarkingMeasurement::Kind::kAcross:
        sigma = std::hypot(noise_.stroke_edge_px * by_column, noise_.painted_end);
        break;
      case MarkingMeasurement::Kind::kLaneWidth:
        sigma = std::hypot(noise_.stroke_edge_px * by_column, noise_.painted_lane * m.expected);
        break;
      case MarkingMeasurement::Kind::kAzimuth:
        sigma = std::hypot(2.0 * noise_.stroke_edge_px * by_column / std::max(s.length, 0.5),
                           noise_.stroke_turn);
        break;
    }
    out[static_cast<Eigen::Index>(k)] = std::isfinite(sigma) ? sigma : 1.0;
  }
  return out;
}

Eigen::VectorXd MarkingMeasurements::residuals(const RoadShape& road,
                                               const MarkingAssociation& association,
                                               const Eigen::VectorXd& sigmas) const {
  const std::vector<MarkingMeasurement>& all = association.measurements;
  const auto n = static_cast<Eigen::Index>(all.size());
  Eigen::VectorXd out(n);
  for (Eigen::Index k = 0; k < n; ++k) out[k] = value(road, all[static_cast<std::size_t>(k)]);
  place_ends(road, association, &out);
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(association.groups), weights = sum;
  for (Eigen::Index k = 0; k < n; ++k) {
    const MarkingMeasurement& m = all[static_cast<std::size_t>(k)];
    if (m.kind != MarkingMeasurement::Kind::kWidth) out[k] -= m.expected;
    if (m.group < 0 || !std::isfinite(out[k])) continue;
    const double weight = m.weight / (sigmas[k] * sigmas[k]);
    sum[m.group] += weight * out[k];
    weights[m.group] += weight;
  }
  for (Eigen::Index k = 0; k < n; ++k) {
    const MarkingMeasurement& m = all[static_cast<std::size_t>(k)];
    if (m.group >= 0 && weights[m.group] > 0) out[k] -= sum[m.group] / weights[m.group];
    out[k] = std::isfinite(out[k]) ? std::clamp(out[k] / sigmas[k], -1e3, 1e3) : kLost;
  }
  return out;
}

}  // namespace camber::detail
