#include "camber/road/road_strip.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace camber {
namespace {

constexpr double kShortest = 0.05;  // m, between points of a driven line

}  // namespace

void RoadStripOptions::validate() const {
  for (const auto& [name, value] : {std::pair("cell", cell),
                                    {"half_width", half_width},
                                    {"stretch", stretch},
                                    {"surface_sigma", surface_sigma},
                                    {"freedom", freedom}}) {
    if (!(value > 0.0)) {
      throw std::invalid_argument(fmt::format("road strip: {} = {}, expected > 0", name, value));
    }
  }
  if (!(correlation >= 1.0)) {
    throw std::invalid_argument(
        fmt::format("road strip: correlation = {}, expected at least 1", correlation));
  }
}

DrivenLine::DrivenLine(const std::vector<Eigen::Vector3d>& feet) {
  for (const Eigen::Vector3d& foot : feet) {
    if (points_.empty()) {
      points_.push_back({foot, 0.0});
    } else {
      const double step = (foot - points_.back().foot).head<2>().norm();
      if (step >= kShortest) points_.push_back({foot, points_.back().s + step});
    }
    lengths_.push_back(points_.back().s);
  }
}

Eigen::Vector3d DrivenLine::at(double s, Eigen::Vector2d* direction) const {
  if (points_.size() < 2) {
    if (direction) *direction = Eigen::Vector2d::UnitX();
    return points_.empty() ? Eigen::Vector3d::Zero() : points_.front().foot;
  }
  auto after = std::upper_bound(points_.begin() + 1, points_.end() - 1, s,
                                [](double value, const DrivenPoint& p) { return value < p.s; });
  const DrivenPoint& a = *(after - 1);
  const DrivenPoint& b = *after;
  const double share = (s - a.s) / (b.s - a.s);
  if (direction) *direction = (b.foot - a.foot).head<2>().normalized();
  return a.foot + share * (b.foot - a.foot);
}

std::optional<DrivenLine::Place> DrivenLine::project(const Eigen::Vector3d& point, double from_s,
                                                     double to_s) const {
  if (points_.size() < 2) return std::nullopt;
  auto first = std::lower_bound(points_.begin() + 1, points_.end() - 1, from_s,
                                [](const DrivenPoint& p, double value) { return p.s < value; });
  std::optional<Place> best;
  double least = std::numeric_limits<double>::infinity();
  for (auto b = first; b != points_.end(); ++b) {
    const auto a = b - 1;
    if (a->s > to_s) break;
    const Eigen::Vector2d piece = (b->foot - a->foot).head<2>();
    const double length = b->s - a->s;
    double along = piece.dot((point - a->foot).head<2>()) / length;
    const bool begin = a == points_.begin(), end = b + 1 == points_.end();
    along = std::clamp(along, begin ? from_s - a->s : 0.0,
                       end ? std::max(to_s - a->s, length) : length);
    const Eigen::Vector2d off = (point - a->foot).head<2>() - along / length * piece;
    const double distance = off.norm();
    if (distance >= least) continue;
    least = distance;
    const double side = piece.x() * off.y() - piece.y() * off.x();
    best = Place{a->s + along, side >= 0.0 ? distance : -distance,
                 a->foot.z() + along / length * (b->foot.z() - a->foot.z())};
  }
  return best;
}

void DrivenLine::raise(const std::vector<double>& rise) {
  if (rise.size() != points_.size()) {
    throw std::invalid_argument(
        fmt::format("driven line: {} rises, expected {}", rise.size(), points_.size()));
  }
  for (std::size_t i = 0; i < rise.size(); ++i) points_[i].foot.z() += rise[i];
}

DrivenLine laid_onto(const std::vector<StripCell>& cells, DrivenLine line) {
  constexpr double kReach = 1.5;  // m, along and across
  constexpr int kLeast = 12;      // cells
  const std::vector<DrivenPoint>& points = line.points();
  std::vector<double> rise(points.size());
  std::vector<std::size_t> known;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto from = std::lower_bound(cells.begin(), cells.end(), points[i].s - kReach,
                                       [](const StripCell& c, double s) { return c.s < s; });
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    int count = 0;
    double low = 0.0, high = 0.0;
    for (auto c = from; c != cells.end() && c->s <= points[i].s + kReach; ++c) {
      if (std::abs(c->lateral) > kReach) continue;
      const double ahead = c->s - points[i].s;
      low = std::min(low, ahead);
      high = std::max(high, ahead);
      const Eigen::Vector4d row(1.0, ahead, ahead * ahead, c->lateral);
      normal += row * row.transpose() / (c->sigma * c->sigma);
      right += (c->point.z() - points[i].foot.z()) * row / (c->sigma * c->sigma);
      ++count;
    }
    if (count < kLeast || low > -0.5 * kReach || high < 0.5 * kReach) continue;
    rise[i] = normal.ldlt().solve(right)[0];
    known.push_back(i);
  }
  if (known.empty()) return line;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto after = std::lower_bound(known.begin(), known.end(), i);
    if (after == known.end()) {
      rise[i] = rise[known.back()];
    } else if (*after != i && after == known.begin()) {
      rise[i] = rise[known.front()];
    } else if (*after != i) {
      const std::size_t a = *(after - 1), b = *after;
      const double share = (points[i].s - points[a].s) / (points[b].s - points[a].s);
      rise[i] = rise[a] + share * (rise[b] - rise[a]);
    }
  }
  line.raise(rise);
  return line;
}

RoadStripBuilder::RoadStripBuilder(DrivenLine line, const RoadStripOptions& options)
    : line_(std::move(line)), options_(options) {
  options_.validate();
}

void RoadStripBuilder::add(const Eigen::Vector3d& point, double sigma, std::uint8_t label,
                           const std::array<std::uint8_t, 3>& color, double near_s) {
  constexpr double kBehind = 5.0, kAhead = 40.0;  // m, of the camera
  if (!(sigma > 0.0) || !point.allFinite()) return;
  const auto place = line_.project(point, near_s - kBehind, near_s + kAhead);
  if (!place || std::abs(place->lateral) >= options_.half_width) return;
  if (place->s > line_.length() + options_.beyond) return;
  cells_[{static_cast<int>(std::floor(place->s / options_.cell)),
          static_cast<int>(std::floor(place->lateral / options_.cell))}]
      .push_back(
          {static_cast<float>(point.z() - place->height), static_cast<float>(sigma), label, color});
}

std::vector<StripCell> RoadStripBuilder::finish() const {
  constexpr int kIterations = 8;
  std::vector<StripCell> out;
  out.reserve(cells_.size());
  for (const auto& [index, observations] : cells_) {
    const auto variance = [&](const Observation& o) {
      return static_cast<double>(o.sigma) * o.sigma +
             options_.surface_sigma * options_.surface_sigma;
    };
    // Starts at the weighted median: neither one far window nor one that took another layer for
    // the road decides.
    std::vector<std::pair<double, double>> sorted;  // height, weight
    double all = 0.0;
    for (const Observation& o : observations) {
      sorted.emplace_back(o.above, 1.0 / variance(o));
      all += sorted.back().second;
    }
    std::sort(sorted.begin(), sorted.end());
    double height = sorted.back().first, below = 0.0;
    for (const auto& [value, weight] : sorted) {
      below += weight;
      if (2.0 * below < all) continue;
      height = value;
      break;
    }
    double information = 0.0, spread = 0.0;
    for (int iteration = 0; iteration < kIterations; ++iteration) {
      double sum = 0.0;
      information = spread = 0.0;
      for (const Observation& o : observations) {
        const double v = variance(o), off = o.above - height;
        const double weight = (options_.freedom + 1.0) / (options_.freedom + off * off / v) / v;
        sum += weight * o.above;
        information += weight;
        spread += weight * off * off;
      }
      height = sum / information;
    }
    const auto count = static_cast<double>(observations.size());
    // Of what the observations scatter more than they state.
    const double misfit = count > 2.0 ? std::max(1.0, spread / (count - 1.0)) : 1.0;
    StripCell cell;
    cell.observations = static_cast<int>(observations.size());
    cell.s = (index.first + 0.5) * options_.cell;
    cell.lateral = (index.second + 0.5) * options_.cell;
    Eigen::Vector2d direction;
    const Eigen::Vector3d on_line = line_.at(cell.s, &direction);
    cell.point << on_line.head<2>() + cell.lateral * Eigen::Vector2d(-direction.y(), direction.x()),
        on_line.z() + height;
    cell.sigma = std::sqrt(std::min(count, options_.correlation) * misfit / information);
    std::array<double, 3> color{0, 0, 0};
    int road = 0;
    for (const Observation& o : observations) {
      road += o.label == 1 ? 1 : 0;
      for (std::size_t c = 0; c < 3; ++c) color[c] += o.color[c];
    }
    cell.label = 2 * road >= cell.observations ? 1 : 2;
    for (std::size_t c = 0; c < 3; ++c) {
      cell.color[c] = static_cast<std::uint8_t>(std::lround(color[c] / count));
    }
    out.push_back(cell);
  }
  return out;
}

}  // namespace camber
