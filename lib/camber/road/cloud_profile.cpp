#include "camber/road/cloud_profile.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "camber/core/median.h"
#include "camber/core/threads.h"
#include "camber/road/detail/line_frame.h"
#include "camber/road/detail/process_variance.h"
#include "camber/road/detail/strip_fit.h"
#include "camber/road/detail/strip_smoother.h"
#include "camber/road/plan_polygon.h"
#include "camber/road/segment_ground.h"

namespace camber {

using detail::LineFrame;
using detail::LinePlace;
using detail::StripFit;
using detail::StripFunctional;
using detail::StripGrid;
using detail::StripPoint;
using detail::StripRoughness;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMost = 1e6;           // stations or heights
constexpr double kLeastCover = 0.6;     // share of the length that must be covered
constexpr double kLeastSamples = 10.0;  // of the length over which grades are measured
constexpr double kStraight = 1e-5;      // 1/m, curvatures below it are called straight
constexpr double kBeyond = 2.0;         // m beyond the half width in which edges are looked for
constexpr double kStretch = 60.0;       // m of line that are fitted at a time
constexpr double kMargin = 25.0;        // m before and behind it
constexpr int kAcross = 10;             // heights of a section to either side
constexpr double kWeakHeight = 0.05;    // m
constexpr double kWeakSlope = 0.01;     // rise over run
constexpr double kStanding = 0.3;       // m, what is higher stands on the ground or is a wall
constexpr double kEdgeAlong = 1.5;      // m of road whose points show where an edge is

void require(bool good, const char* field, double value, const char* bound) {
  if (!good) {
    throw std::invalid_argument(
        fmt::format("CloudProfileOptions::{} is {}, expected {}", field, value, bound));
  }
}

/// How far from the line the road goes, at stations a metre apart.
struct Edges {
  std::vector<double> left, right;  ///< m; NaN: not seen
  double noise = 0.0;               ///< m, of the points that show them

  /// m of road before an edge that are left out: banks are seen the later the more noise there is.
  double margin() const { return 0.1 + 2.0 * noise; }
  double sigma() const { return 0.05 + noise; }  ///< m, how well an edge is known

  double limit(bool to_left, double s, double most) const {
    const std::vector<double>& edges = to_left ? left : right;
    const double at = std::clamp(s, 0.0, static_cast<double>(edges.size() - 1));
    const auto k = std::min(static_cast<std::size_t>(at), edges.size() - 1);
    const std::size_t next = std::min(k + 1, edges.size() - 1);
    const double share = at - static_cast<double>(k);
    const auto value = [&](std::size_t i) {
      return std::isfinite(edges[i]) ? std::min(most, edges[i] - margin()) : most;
    };
    return value(k) + share * (value(next) - value(k));
  }
};

/// 0 where none is known.
double median_of_known(std::vector<double> values) {
  values.erase(std::remove_if(values.begin(), values.end(),
                              [](double value) { return !std::isfinite(value); }),
               values.end());
  return values.empty() ? 0.0 : upper_median(&values);
}

/// The whole computation's state: points beside the line, and what has been found of the road.
class Profiler {
 public:
  Profiler(const RoadCloud& cloud, const std::vector<int>& ground, const Vector3d& up,
           const std::vector<Vector3d>& line, const CloudProfileOptions& options);
  CloudProfile run();

 private:
  std::size_t count_stations() const;
  void collect();
  std::vector<StripPoint> slice(double from, double to, const Edges* edges) const;
  StripGrid grid(double from, double to, double beyond) const;
  StripRoughness estimate_roughness(const StripRoughness* start, double* noise) const;
  void find_edges();
  void measure(std::size_t begin, std::size_t end, std::vector<CrossSection>* stations,
               double* noise) const;
  StripFunctional section_slope(double s, double right, double left) const;
  double find_crest(const StripFit& fit, double s, double right, double left) const;
  LinePlace beside(double s, double v) const {
    const Vector2d ahead = frame_.ahead(s);
    return frame_.place_near(frame_.position(s) + v * Vector2d(-ahead.y(), ahead.x()), s);
  }
  LinePlace on_line(double s) const { return beside(s, 0.0); }
  void measure_grade(const std::vector<char>& covered, CrossSection* out, StripFunctional* slope,
                     StripFunctional* second) const;
  Vector3d at(double s, double height) const;
  bool near_ground(double s) const;
  double shared_sigma(double s) const;
  void judge(CrossSection* out) const;
  void name_gaps(std::vector<CrossSection>* stations) const;

  const RoadCloud& cloud_;
  const std::vector<int>& ground_;
  Vector3d up_;
  GroundAxes axes_;
  const CloudProfileOptions& options_;
  double margin_;  ///< m before and behind a stretch that are fitted with it
  LineFrame frame_;
  double drift_ = 0.0;
  double reach_along_ = 1.0;                      ///< m in which a station's ground lies
  std::vector<StripPoint> points_;                ///< by station
  std::vector<std::pair<double, float>> sigmas_;  ///< of points on the section, by station
  double density_ = 0.0;
  Edges edges_;
  StripRoughness roughness_;
  double along_ = StripGrid().along;  ///< m between nodes
};

std::vector<Vector2d> corners_of(const std::vector<Vector3d>& line, const GroundAxes& axes) {
  std::vector<Vector2d> corners;
  for (const Vector3d& place : line) {
    const Vector2d corner = axes(place);
    if (!corner.allFinite()) continue;
    if (!corners.empty() && !((corner - corners.back()).norm() > 1e-9)) continue;
    corners.push_back(corner);
  }
  if (corners.size() < 2) {
    throw std::invalid_argument(fmt::format(
        "profile_cloud: the line has {} different places, expected at least 2", corners.size()));
  }
  return corners;
}

Profiler::Profiler(const RoadCloud& cloud, const std::vector<int>& ground, const Vector3d& up,
                   const std::vector<Vector3d>& line, const CloudProfileOptions& options)
    : cloud_(cloud),
      ground_(ground),
      up_(up.normalized()),
      axes_(up_),
      options_(options),
      margin_(std::max(kMargin, 0.5 * options.profile.length + 15.0)),
      frame_(corners_of(line, axes_), 0.5 * options.half_width, margin_) {
  const double total = frame_.length();
  const auto long_enough = [&](const char* field, double value, double least) {
    if (value > least) return;
    throw std::invalid_argument(
        fmt::format("{}: found {:g} m, expected more than {:g} m for a line of {:g} m", field,
                    value, least, total));
  };
  long_enough("step", options.profile.step, total / kMost);
  long_enough("length", options.profile.length, total / kMost);
  drift_ = cloud.metric ? options.profile.drift_sigma : 0.0;
}

std::size_t Profiler::count_stations() const {
  return static_cast<std::size_t>(std::floor(frame_.length() / options_.profile.step + 1e-6)) + 1;
}

/// The points beside the line, by their stations.
void Profiler::collect() {
  const double reach = options_.half_width + kBeyond;
  frame_.prepare(reach + 1.0);
  constexpr std::size_t kBlock = 1 << 14;
  const std::size_t blocks = (ground_.size() + kBlock - 1) / kBlock;
  std::vector<std::vector<StripPoint>> parts(blocks);
  std::vector<std::vector<std::pair<double, float>>> sigmas(blocks);
  const bool shared = options_.sigmas != PointSigmas::kOfNoise && !cloud_.sigmas.empty();
  parallel_for(blocks, options_.num_threads, [&](std::size_t block) {
    std::vector<LinePlace> places;
    const std::size_t end = std::min(ground_.size(), (block + 1) * kBlock);
    for (std::size_t k = block * kBlock; k < end; ++k) {
      const auto i = static_cast<std::size_t>(ground_[k]);
      const Vector3d point = cloud_.origin + cloud_.points[i].cast<double>();
      if (!point.allFinite()) continue;
      frame_.places(axes_(point), reach, &places);
      for (const LinePlace& place : places) {
        StripPoint out;
        out.s = place.s;
        out.v = place.v;
        out.z = point.dot(up_);
        parts[block].push_back(out);
        if (shared && std::abs(place.v) <= options_.half_width && cloud_.sigmas[i] >= 0.0f) {
          sigmas[block].emplace_back(place.s, cloud_.sigmas[i]);
        }
      }
    }
  });
  for (const std::vector<StripPoint>& part : parts) {
    points_.insert(points_.end(), part.begin(), part.end());
  }
  for (const auto& part : sigmas) sigmas_.insert(sigmas_.end(), part.begin(), part.end());
  std::sort(sigmas_.begin(), sigmas_.end());
  // Points at one station, too, in an order of their own.
  std::sort(points_.begin(), points_.end(), [](const StripPoint& a, const StripPoint& b) {
    return std::tie(a.s, a.v, a.z) < std::tie(b.s, b.v, b.z);
  });
  // Of the squares of a metre that have points.
  std::size_t squares = 0;
  const auto wide = static_cast<std::size_t>(std::ceil(2.0 * reach));
  std::vector<char> seen(wide, 0);
  double row = -1e9;
  for (const StripPoint& point : points_) {
    if (std::floor(point.s) != row) {
      row = std::floor(point.s);
      std::fill(seen.begin(), seen.end(), 0);
    }
    char& here = seen[std::min(wide - 1, static_cast<std::size_t>(point.v + reach))];
    squares += here == 0;
    here = 1;
  }
  density_ = squares > 0 ? static_cast<double>(points_.size()) / static_cast<double>(squares) : 0.0;
  const double spacing = density_ > 0.0 ? 1.0 / std::sqrt(density_) : 1.0;
  reach_along_ = std::max({0.5 * options_.profile.step, 1.0, 2.0 * spacing});
}

std::vector<StripPoint> Profiler::slice(double from, double to, const Edges* edges) const {
  const auto before = [](const StripPoint& point, double s) { return point.s < s; };
  const auto first = std::lower_bound(points_.begin(), points_.end(), from, before);
  const auto last = std::lower_bound(first, points_.end(), to, before);
  if (!edges) return {first, last};
  std::vector<StripPoint> out;
  const double most = options_.half_width + 0.5;
  for (auto point = first; point != last; ++point) {
    if (point->v < edges->limit(true, point->s, most) &&
        -point->v < edges->limit(false, point->s, most)) {
      out.push_back(*point);
    }
  }
  return out;
}

StripGrid Profiler::grid(double from, double to, double beyond) const {
  StripGrid out;
  out.first = from;
  out.last = to;
  out.left = options_.half_width + beyond;
  out.right = -out.left;
  out.along = along_;
  return out;
}

StripRoughness Profiler::estimate_roughness(const StripRoughness* start, double* noise) const {
  constexpr double kLength = 60.0;
  constexpr std::size_t kPieces = 4;
  const double total = frame_.length();
  const std::size_t pieces =
      std::clamp<std::size_t>(static_cast<std::size_t>(total / kLength), 1, kPieces);
  std::vector<StripFit> fits;
  std::vector<std::vector<StripPoint>> points(pieces);
  for (std::size_t i = 0; i < pieces; ++i) {
    const double middle = (static_cast<double>(i) + 0.5) * total / static_cast<double>(pieces);
    const double half = 0.5 * std::min(kLength, total);
    points[i] = slice(middle - half, middle + half, &edges_);
    fits.emplace_back(grid(middle - half, middle + half, 0.5), points[i]);
  }
  const StripRoughness out = detail::estimate_roughness(&fits, start, options_.num_threads);
  std::vector<double> noises;
  for (const StripFit& fit : fits) noises.push_back(fit.noise());
  *noise = upper_median(&noises);
  return out;
}

StripFunctional Profiler::section_slope(double s, double right, double left) const {
  const double step = options_.half_width / kAcross, middle = 0.5 * (left + right);
  const int count = std::max(2, static_cast<int>(std::lround((left - right) / step)));
  StripFunctional out;
  double squares = 0.0;
  for (int i = 0; i <= count; ++i) {
    const double v = right + (left - right) * i / count;
    const LinePlace place = beside(s, v);
    out.terms.push_back({place.s, place.v, v - middle});
    squares += (v - middle) * (v - middle);
  }
  for (StripFunctional::Term& term : out.terms) term.weight /= squares;
  return out;
}

/// Where the section bends most, m to the left of the line, of the mean section over 20 m of road;
/// the line itself where no other place explains the section better.
double Profiler::find_crest(const StripFit& fit, double s, double right, double left) const {
  constexpr double kAround = 10.0, kApart = 2.5;  // m along
  constexpr double kLeastBend = 0.005;            // change of slope
  constexpr double kBetter = 0.7;                 // share of the squares that are left
  Eigen::Matrix<double, 2 * kAcross + 1, 1> offsets, heights;
  for (int i = 0; i <= 2 * kAcross; ++i) {
    offsets[i] = -right + (left + right) * i / (2 * kAcross);
    heights[i] = 0.0;
    double count = 0.0;
    for (double along = -kAround; along <= kAround; along += kApart) {
      const double at = s + along;
      if (at < 0.0 || at > frame_.length()) continue;
      const LinePlace place = beside(at, offsets[i]), line = on_line(at);
      heights[i] += fit.smoother().height(place.s, place.v) - fit.smoother().height(line.s, line.v);
      count += 1.0;
    }
    heights[i] /= count;
  }
  const auto squares = [&](double crest, double* bend) {
    Eigen::Matrix<double, 2 * kAcross + 1, 3> rows;
    for (int i = 0; i <= 2 * kAcross; ++i) {
      rows.row(i) << 1.0, offsets[i], std::abs(offsets[i] - crest);
    }
    const Vector3d fitted = rows.colPivHouseholderQr().solve(heights);
    *bend = 2.0 * std::abs(fitted[2]);
    return (heights - rows * fitted).squaredNorm();
  };
  double bend = 0.0, best = 0.0;
  const double at_line = squares(0.0, &bend);
  double least = kBetter * at_line;
  for (int k = -kAcross; k <= kAcross; ++k) {
    const double crest = 0.5 * (k < 0 ? right : left) * k / kAcross;
    const double here = squares(crest, &bend);
    if (here < least && bend > kLeastBend) {
      least = here;
      best = crest;
    }
  }
  return best;
}

bool Profiler::near_ground(double s) const {
  const auto first =
      std::lower_bound(points_.begin(), points_.end(), s - reach_along_,
                       [](const StripPoint& point, double at) { return point.s < at; });
  for (auto point = first; point != points_.end() && point->s <= s + reach_along_; ++point) {
    if (std::abs(point->v) <= options_.half_width) return true;
  }
  return false;
}

/// Of the points beside a station, by PointSigmas: the median; NaN where none has one.
double Profiler::shared_sigma(double s) const {
  std::vector<double> here;
  for (auto at = std::lower_bound(sigmas_.begin(), sigmas_.end(), s - reach_along_,
                                  [](const auto&entry, double from) { return entry.first < from; });
       at != sigmas_.end() && at->first <= s + reach_along_; ++at) {
    here.push_back(double{at->second});
  }
  return here.empty() ? kNaN : upper_median(&here);
}

CloudProfile Profiler::run() {
  CloudProfile out;
  collect();
  out.density = density_;
  if (points_.size() < 10) {
    out.status = Status::kFailed;
    out.reason = fmt::format("{} points of the ground lie within {:g} m of the line, expected 10",
                             points_.size(), options_.half_width + kBeyond);
    return out;
  }
  find_edges();
  double noise = 0.0;
  roughness_ = estimate_roughness(nullptr, &noise);
  // Nodes no farther apart than the equivalent kernel is wide.
  constexpr double kLeastApart = 0.5;  // m
  const double bandwidth = roughness_.bandwidth(noise, density_, 2.0 * options_.half_width);
  if (bandwidth < along_) {
    along_ = std::max(kLeastApart, bandwidth);
    const StripRoughness coarse = roughness_;
    roughness_ = estimate_roughness(&coarse, &noise);
  }
  const std::size_t count = count_stations();
  out.stations.resize(count);
  const auto per_stretch =
      static_cast<std::size_t>(std::max(1.0, std::floor(kStretch / options_.profile.step)));
  const std::size_t stretches = (count + per_stretch - 1) / per_stretch;
  std::vector<double> noises(stretches, kNaN);
  parallel_for(stretches, options_.num_threads, [&](std::size_t i) {
    measure(i * per_stretch, std::min(count, (i + 1) * per_stretch), &out.stations, &noises[i]);
  });
  out.noise = median_of_known(noises);
  name_gaps(&out.stations);
  const bool any = std::any_of(out.stations.begin(), out.stations.end(), [](const auto& station) {
    return station.status != Status::kFailed;
  });
  out.status = any ? Status::kOk : Status::kFailed;
  if (!any) out.reason = "no station of the line has ground near it";
  return out;
}

/// Edges at stations a metre apart, first each by itself on the ground as far as it is seen.
void Profiler::find_edges() {
  const auto count = static_cast<std::size_t>(std::floor(frame_.length() + 1e-9)) + 1;
  edges_.left.assign(count, kNaN);
  edges_.right.assign(count, kNaN);
  // Rough enough for a kerb.
  StripRoughness rough;
  rough.along = 1e-3;
  rough.twist = 1e-4;
  rough.across = 0.1;
  rough.length = 10.0;
  const auto per_stretch = static_cast<std::size_t>(kStretch);
  const std::size_t stretches = (count + per_stretch - 1) / per_stretch;
  std::vector<double> noises(stretches, kNaN);
  parallel_for(stretches, options_.num_threads, [&](std::size_t stretch) {
    const std::size_t begin = stretch * per_stretch, end = std::min(count, begin + per_stretch);
    const double from = static_cast<double>(begin) - margin_;
    const double to = static_cast<double>(end) + margin_;
    const std::vector<StripPoint> points = slice(from, to, nullptr);
    StripFit fit(grid(from, to, kBeyond), points, kStanding);
    if (!fit.fit(rough)) return;
    noises[stretch] = fit.noise();
    const std::vector<double> farthest = fit.seen_across(static_cast<double>(begin), end - begin);
    for (std::size_t k = begin; k < end; ++k) {
      const double s = static_cast<double>(k);
      const auto edge = [&](double side, double seen) {
        const detail::Edge found = detail::find_edge(
            [&](double v) { return fit.smoother().height(s, side * v); }, seen, fit.noise());
        if (!std::isfinite(found.distance)) return found.distance;
        std::vector<detail::SidePoint> beside;
        const auto first =
            std::lower_bound(points.begin(), points.end(), s - kEdgeAlong,
                             [](const StripPoint& point, double at) { return point.s < at; });
        for (auto point = first; point != points.end() && point->s <= s + kEdgeAlong; ++point) {
          // Heights as they would be at the station.
          const double along = fit.smoother().height(point->s, 0.0) - fit.smoother().height(s, 0.0);
          if (side * point->v > 0.0) beside.push_back({side * point->v, point->z - along});
        }
        return detail::refine_edge(found, beside, fit.noise());
      };
      edges_.left[k] = edge(1.0, farthest[2 * (k - begin) + 1]);
      edges_.right[k] = edge(-1.0, farthest[2 * (k - begin)]);
    }
  });
  edges_.noise = median_of_known(noises);
  detail::smooth_edges(&edges_.left);
  detail::smooth_edges(&edges_.right);
}

Vector3d Profiler::at(double s, double height) const {
  const Vector2d place = frame_.position(s);
  return place.x() * axes_.e1 + place.y() * axes_.e2 + height * up_;
}

/// The functionals of slope and second derivative of the parabola around a station.
void Profiler::measure_grade(const std::vector<char>& covered, CrossSection* out,
                             StripFunctional* slope, StripFunctional* second) const {
  const double step = options_.profile.step, length = options_.profile.length;
  const double per_step = std::max(1.0, std::ceil(step * kLeastSamples / length - 1e-9));
  const double spacing = step / per_step;
  const int half = std::max(1, static_cast<int>(std::lround(0.5 * length / spacing)));
  std::vector<Vector3d> rows;
  std::vector<double> stations;
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  for (int i = -half; i <= half; ++i) {
    const double off = spacing * i, s = out->station + off;
    if (s < -1e-9 || s > frame_.length() + 1e-9) continue;
    if (!covered[static_cast<std::size_t>(
            std::clamp(std::lround(s), 0L, static_cast<long>(covered.size()) - 1))]) {
      continue;
    }
    rows.emplace_back(1.0, off, 0.5 * off * off);
    stations.push_back(s);
    normal += rows.back() * rows.back().transpose();
  }
  if (static_cast<double>(rows.size()) < kLeastCover * (2 * half + 1) || rows.size() < 3) return;
  const Eigen::FullPivLU<Eigen::Matrix3d> lu(normal);
  const Vector3d to_slope = lu.solve(Vector3d::UnitY()), to_second = lu.solve(Vector3d::UnitZ());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const LinePlace place = on_line(stations[i]);
    slope->terms.push_back({place.s, place.v, to_slope.dot(rows[i])});
    second->terms.push_back({place.s, place.v, to_second.dot(rows[i])});
  }
}

/// Variance of what drift makes of a functional.
double drift_variance(const StripFunctional& functional, double drift, double by = 1.0) {
  detail::ProcessVariance drifting(detail::kDriftLength);
  for (const StripFunctional::Term& term : functional.terms) {
    drifting.add(term.s, by * term.weight * drift);
  }
  return drifting.variance();
}

void Profiler::measure(std::size_t begin, std::size_t end, std::vector<CrossSection>* stations,
                       double* noise) const {
  const double step = options_.profile.step, total = frame_.length();
  const double first = static_cast<double>(begin) * step;
  const double last = std::min(total, static_cast<double>(end - 1) * step);
  const double from = first - margin_, to = last + margin_;
  for (std::size_t k = begin; k < end; ++k) {
    CrossSection& out = (*stations)[k];
    out.station = std::min(total, static_cast<double>(k) * step);
    out.point = at(out.station, 0.0);
    out.status = Status::kFailed;
  }
  const std::vector<StripPoint> points = slice(from, to, &edges_);
  StripFit fit(grid(from, to, 0.5), points);
  if (!fit.fit(roughness_)) return;
  *noise = fit.noise();
  std::vector<char> covered(static_cast<std::size_t>(std::ceil(total)) + 1, 0);
  const double about = options_.profile.length + 2.0;
  for (double s = std::max(0.0, std::floor(first - about));
       s <= std::min(std::ceil(total), last + about); s += 1.0) {
    covered[static_cast<std::size_t>(s)] = near_ground(s);
  }
  const double middle = 0.5 * total;
  for (std::size_t k = begin; k < end; ++k) {
    CrossSection& out = (*stations)[k];
    if (!near_ground(out.station)) continue;
    out.status = Status::kOk;
    const double s = out.station;
    const double width_left = edges_.left[static_cast<std::size_t>(
        std::min<long>(std::lround(s), static_cast<long>(edges_.left.size()) - 1))];
    const double width_right = edges_.right[static_cast<std::size_t>(
        std::min<long>(std::lround(s), static_cast<long>(edges_.right.size()) - 1))];
    out.width_left = width_left;
    out.width_right = width_right;
    out.measured_left = edges_.limit(true, s, options_.half_width);
    out.measured_right = edges_.limit(false, s, options_.half_width);
    for (auto point =
             std::lower_bound(points.begin(), points.end(), s - 0.5 * step,
                              [](const StripPoint&here, double from_s) { return here.s < from_s; });
         point != points.end() && point->s < s + 0.5 * step; ++point) {
      out.points += fit.used()[static_cast<std::size_t>(point - points.begin())] != 0;
    }
    std::vector<StripFunctional> functionals(4);
    const LinePlace here = on_line(s);
    functionals[0].terms.push_back({here.s, here.v, 1.0});
    functionals[1] = section_slope(s, -out.measured_right, out.measured_left);
    measure_grade(covered, &out, &functionals[2], &functionals[3]);
    const bool graded = !functionals[2].terms.empty();
    if (options_.crown) {
      out.crest = find_crest(fit, s, out.measured_right, out.measured_left);
      functionals.push_back(section_slope(s, out.crest, out.measured_left));
      functionals.push_back(section_slope(s, -out.measured_right, out.crest));
    }
    for (int i = -kAcross; i <= kAcross; ++i) {
      const double v = options_.half_width * i / kAcross;
      if (v > out.measured_left + 1e-9 || -v > out.measured_right + 1e-9) continue;
      const LinePlace place = beside(s, v);
      out.offsets.push_back(v);
      out.heights.push_back(fit.smoother().height(place.s, place.v));
    }
    const Eigen::MatrixXd covariance = fit.smoother().covariance(functionals);
    const auto sigma = [&](Eigen::Index i) { return std::sqrt(std::max(0.0, covariance(i, i))); };
    const auto value = [&](std::size_t i) { return fit.smoother().value(functionals[i]); };
    const double levelling = options_.profile.levelling_sigma;
    out.height = value(0);
    out.point = at(s, out.height);
    out.sigma_height =
        std::sqrt(covariance(0, 0) + drift_ * drift_ + std::pow(levelling * (s - middle), 2));
    out.cross_slope = value(1);
    out.sigma_cross_slope = std::hypot(sigma(1), levelling);
    // An edge that is elsewhere takes another part of a section that is not straight.
    for (const double side : {1.0, -1.0}) {
      const double limit = side > 0.0 ? out.measured_left : out.measured_right;
      if (limit >= options_.half_width - 1e-9 || limit < 0.5) continue;
      const double left = out.measured_left - (side > 0.0 ? edges_.sigma() : 0.0);
      const double right = out.measured_right - (side > 0.0 ? 0.0 : edges_.sigma());
      const double other = fit.smoother().value(section_slope(s, -right, left));
      out.sigma_cross_slope = std::hypot(out.sigma_cross_slope, other - out.cross_slope);
    }
    if (graded) {
      out.grade = value(2);
      const double grade2 = 1.0 + out.grade * out.grade;
      const double bend = 1.0 / (grade2 * std::sqrt(grade2));
      out.vertical_curvature = bend * value(3);
      out.vertical_radius = std::abs(out.vertical_curvature) > kStraight
                                ? 1.0 / out.vertical_curvature
                                : std::numeric_limits<double>::infinity();
      out.sigma_grade = std::sqrt(covariance(2, 2) + drift_variance(functionals[2], drift_) +
                                  levelling * levelling);
      const double by_grade = -3.0 * out.grade / grade2 * out.vertical_curvature;
      out.sigma_vertical_curvature =
          std::sqrt(bend * bend * covariance(3, 3) + 2.0 * bend * by_grade * covariance(2, 3) +
                    by_grade * by_grade * (covariance(2, 2) + levelling * levelling) +
                    drift_variance(functionals[3], drift_, bend));
    }
    if (options_.crown) {
      out.cross_slope_left = value(4);
      out.cross_slope_right = value(5);
      out.sigma_cross_slope_left = std::hypot(sigma(4), levelling);
      out.sigma_cross_slope_right = std::hypot(sigma(5), levelling);
    }
    judge(&out);
  }
}

/// The points' own sigmas, and whether a section is known well.
void Profiler::judge(CrossSection* section) const {
  CrossSection& out = *section;
  const double shared = options_.sigmas == PointSigmas::kOfNoise ? kNaN : shared_sigma(out.station);
  if (options_.sigmas == PointSigmas::kInterpolated) {
    out.sigma_height = std::hypot(out.sigma_height, shared);
    out.sigma_grade = out.sigma_cross_slope = out.sigma_vertical_curvature = kNaN;
    out.sigma_cross_slope_left = out.sigma_cross_slope_right = kNaN;
  } else if (std::isfinite(shared)) {
    out.sigma_height = std::hypot(out.sigma_height, shared);
  }
  if (out.sigma_height > kWeakHeight || out.sigma_cross_slope > kWeakSlope) {
    out.status = Status::kWeak;
    out.reason =
        out.sigma_height > kWeakHeight
            ? fmt::format("the height is known to {:.2f} m", out.sigma_height)
            : fmt::format("the cross slope is known to {:.1f} %", 100.0 * out.sigma_cross_slope);
  }
}

void Profiler::name_gaps(std::vector<CrossSection>* stations) const {
  const auto failed = [&](std::size_t k) { return (*stations)[k].status == Status::kFailed; };
  for (std::size_t begin = 0, end = 0; begin < stations->size(); begin = end) {
    end = begin + 1;
    if (!failed(begin)) continue;
    while (end < stations->size() && failed(end)) ++end;
    const std::string reason =
        fmt::format("no ground within {:g} m of the line from station {:.1f} to {:.1f}",
                    options_.half_width, (*stations)[begin].station, (*stations)[end - 1].station);
    for (std::size_t k = begin; k < end; ++k) (*stations)[k].reason = reason;
  }
}

}  // namespace

void CloudProfileOptions::validate() const {
  profile.validate();
  require(half_width > 0.2 && half_width <= 50.0, "half_width", half_width, "0.2 to 50 m");
}

struct ProfileCorridor::State {
  GroundAxes axes;
  LineFrame frame;
  double reach;
  Eigen::AlignedBox2d bounds;
};

ProfileCorridor::ProfileCorridor(const std::vector<Vector3d>& line, const Vector3d& up,
                                 double half_width) {
  constexpr double kSpare = 0.5;  // m, for what coordinates are rounded to
  const GroundAxes axes(up.normalized());
  state_ =
      std::make_unique<State>(State{axes,
                                    LineFrame(corners_of(line, axes), 0.5 * half_width, kMargin),
                                    half_width + kBeyond + 1.0 + kSpare,
                                    {}});
  state_->frame.prepare(state_->reach);
  for (const Vector3d& place : line) {
    if (axes(place).allFinite()) state_->bounds.extend(Vector2d(place.head<2>()));
  }
  // The line goes on beyond its ends.
  const double more = state_->reach + kMargin + 1.0;
  state_->bounds.min().array() -= more;
  state_->bounds.max().array() += more;
}

ProfileCorridor::~ProfileCorridor() = default;

bool ProfileCorridor::contains(const Vector3d& point) const {
  return state_->frame.near(state_->axes(point), state_->reach);
}

const Eigen::AlignedBox2d& ProfileCorridor::bounds() const { return state_->bounds; }

const char* to_string(GroundSource source) {
  switch (source) {
    case GroundSource::kClasses:
      return "class";
    case GroundSource::kLabels:
      return "label";
    case GroundSource::kCompute:
      return "compute";
    case GroundSource::kAll:
      return "all";
    case GroundSource::kAuto:
      break;
  }
  return "auto";
}

GroundBesideLine ground_beside_line(const RoadCloud& cloud, const Vector3d& up_given,
                                    const std::vector<Vector3d>& line, double half_width,
                                    GroundSource source, int num_threads) {
  constexpr double kAround = 30.0;  // m of surroundings in which ground is found
  constexpr int kWithheld = 4, kGround = 2, kRoad = 11;
  const Vector3d up = up_given.normalized();
  const GroundAxes axes(up);
  LineFrame frame(corners_of(line, axes), 0.5 * half_width, kMargin);
  const double strip = half_width + kBeyond, widest = strip + kAround;
  frame.prepare(widest);
  const auto labels = [&](const char* name) -> const std::vector<int>* {
    const auto found = cloud.labels.find(name);
    return found == cloud.labels.end() ? nullptr : &found->second;
  };
  const std::vector<int>*const classes = labels("classification"), *const marks = labels("ground"),
                               *const flags = labels("class_flags");
  const auto is_ground = [&](int k) { return k == kGround || k == kRoad; };
  const auto counts = [&](std::size_t i) {
    if (flags && ((*flags)[i] & kWithheld) != 0) return false;
    return !classes || ((*classes)[i] != 7 && (*classes)[i] != 18 && (*classes)[i] != 9);
  };
  // 1: near, 2: in the strip.
  std::vector<char> where(cloud.size(), 0);
  constexpr std::size_t kBlock = 1 << 14;
  parallel_for((cloud.size() + kBlock - 1) / kBlock, num_threads, [&](std::size_t block) {
    for (std::size_t i = block * kBlock; i < std::min(cloud.size(), (block + 1) * kBlock); ++i) {
      if (!cloud.points[i].allFinite() || !counts(i)) continue;
      const Vector2d place = axes(cloud.origin + cloud.points[i].cast<double>());
      if (frame.near(place, widest)) where[i] = frame.near(place, strip + 1.0) ? 2 : 1;
    }
  });
  GroundBesideLine out;
  out.source = source;
  if (source == GroundSource::kAuto) {
    bool classified = false;
    for (std::size_t i = 0; classes && i < cloud.size() && !classified; ++i) {
      classified = where[i] == 2 && is_ground((*classes)[i]);
    }
    out.source = classified ? GroundSource::kClasses
                 : marks    ? GroundSource::kLabels
                            : GroundSource::kCompute;
  }
  const auto fail = [&](const std::string& reason) {
    out.status = Status::kFailed;
    out.reason = reason;
    return out;
  };
  if (out.source == GroundSource::kClasses && !classes) return fail("the points have no classes");
  if (out.source == GroundSource::kLabels && !marks) return fail("the points have no label ground");
  out.status = Status::kOk;
  if (out.source == GroundSource::kCompute) {
    std::vector<int> near;
    for (std::size_t i = 0; i < where.size(); ++i) {
      if (where[i]) near.push_back(static_cast<int>(i));
    }
    if (near.empty()) return fail("no point lies near the line");
    GroundOptions options;
    options.up = up;
    options.num_threads = num_threads;
    const GroundSegmentation found = segment_ground(cloud.select(near), options);
    if (found.status == Status::kFailed) return fail(found.reason);
    for (std::size_t k = 0; k < near.size(); ++k) {
      if (found.labels[k] == 1 && where[static_cast<std::size_t>(near[k])] == 2) {
        out.points.push_back(near[k]);
      }
    }
    return out;
  }
  for (std::size_t i = 0; i < where.size(); ++i) {
    if (where[i] != 2) continue;
    const bool ground =
        out.source == GroundSource::kAll ||
        (out.source == GroundSource::kClasses ? is_ground((*classes)[i]) : (*marks)[i] == 1);
    if (ground) out.points.push_back(static_cast<int>(i));
  }
  return out;
}

CloudProfile profile_cloud(const RoadCloud& cloud, const std::vector<int>& ground,
                           const Vector3d& up, const std::vector<Vector3d>& line,
                           const CloudProfileOptions& options) {
  options.validate();
  return Profiler(cloud, ground, up, line, options).run();
}

}  // namespace camber
