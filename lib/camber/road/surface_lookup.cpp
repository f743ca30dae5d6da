#include "camber/road/surface_lookup.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <tuple>

#include "camber/core/median.h"

namespace camber {

using Eigen::Vector3d;

namespace {

/// Curvature that an unseen continuation of a road may have, 1/m (a vertical curve of 60 m radius,
/// the sharpest that roads are built with). It sets how fast an extrapolation loses its certainty.
constexpr double kUnseenCurvature = 1.0 / 60.0;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kLevelSigmas = 4.0;      // within which heights may be of one level
constexpr double kOnGround = 0.25;        // share of the commonest offset's places that makes it 0
constexpr double kSteepUnseen = 0.1;      // slope that a line without heights may pass over unseen
constexpr double kLeastSlant = 1e-3;      // cosine of a patch's tilt
constexpr double kSteepestOther = 0.82;   // the same of ground that is not road, 35 deg
constexpr double kWithoutHeights = 1e-3;  // m, between highest and lowest point of such a line

double sag(double distance) { return 0.5 * kUnseenCurvature * distance * distance; }

/// @param distance  of the place from the patch's boundary, m; 0: inside.
SurfaceQuery answer(const PlanePatch& patch, const Vector3d& place, double distance,
                    const Vector3d& unit_up) {
  SurfaceQuery out;
  out.status = patch.status;
  out.reason = patch.reason;
  out.patch = patch.id;
  out.plane = patch.plane;
  const Plane& plane = patch.plane.plane;
  out.point = place - plane.signed_distance(place) / plane.normal.dot(unit_up) * unit_up;
  double variance =
      patch.plane.height_variance(out.point) + patch.unmodelled_sigma * patch.unmodelled_sigma;
  if (distance > 0.0) {
    const double tilt = kUnseenCurvature * distance;
    out.plane.covariance(0, 0) += tilt * tilt;
    out.plane.covariance(1, 1) += tilt * tilt;
    out.plane.covariance(2, 2) += sag(distance) * sag(distance);
    variance += sag(distance) * sag(distance);
    if (out.status == Status::kOk) {
      out.status = Status::kWeak;
      out.reason = "extrapolated beyond the patch's boundary";
    }
  }
  out.sigma_height = std::sqrt(std::max(0.0, variance));
  return out;
}

}  // namespace

SurfaceLookup::SurfaceLookup(const RoadSurface& surface, bool any_kind)
    : up_(surface.up.normalized()), axes_(up_), metric_(surface.metric) {
  for (const PlanePatch& patch : surface.patches) {
    if (patch.status == Status::kFailed || patch.status == Status::kNotRun) continue;
    const double slant = std::abs(patch.plane.plane.normal.dot(up_));
    if (!(slant > kLeastSlant)) continue;
    if (patch.kind == PatchKind::kOther && !(any_kind && slant > kSteepestOther)) continue;
    Entry entry;
    entry.patch = &patch;
    for (const Vector3d& corner : patch.boundary) {
      entry.outline.push_back(axes_(corner));
      entry.box.extend(entry.outline.back());
    }
    entries_.push_back(std::move(entry));
  }
}

std::vector<SurfaceLookup::Candidate> SurfaceLookup::within(const Vector3d& place,
                                                            double reach) const {
  const Eigen::Vector2d flat = axes_(place);
  const double farthest = std::max(0.0, reach);
  std::vector<Candidate> out;
  for (const Entry& entry : entries_) {
    if (!(entry.box.squaredExteriorDistance(flat) <= farthest * farthest * (1.0 + 1e-9))) continue;
    const double distance = distance_to_polygon(entry.outline, flat);
    if (!(distance <= farthest)) continue;
    const UncertainPlane& plane = entry.patch->plane;
    const double above = plane.plane.signed_distance(place) / plane.plane.normal.dot(up_);
    out.push_back(
        {entry.patch, distance, above, answer(*entry.patch, place, distance, up_).sigma_height});
  }
  return out;
}

/// Metres in height within which a patch may be of a level.
double SurfaceLookup::gap(const Candidate& candidate) const {
  if (!metric_) return std::numeric_limits<double>::infinity();
  return std::max(kLevelGap, kLevelSigmas * candidate.sigma);
}

SurfaceQuery SurfaceLookup::choose(const std::vector<Candidate>& candidates, const Vector3d& place,
                                   bool of_level) const {
  SurfaceQuery failed;
  failed.status = Status::kFailed;
  failed.reason = "not covered";
  if (candidates.empty()) return failed;
  const auto nearest = std::min_element(
      candidates.begin(), candidates.end(),
      [](const Candidate& l, const Candidate& r) { return std::abs(l.above) < std::abs(r.above); });
  if (of_level && std::abs(nearest->above) > gap(*nearest)) {
    failed.reason = fmt::format("another level: {:.1f} m {}", std::abs(nearest->above),
                                nearest->above < 0.0 ? "above" : "below");
    return failed;
  }
  const Candidate* best = nullptr;
  const auto rank = [](const Candidate& c) {
    return std::make_tuple(c.patch->kind == PatchKind::kOther, c.distance, std::abs(c.above));
  };
  for (const Candidate& candidate : candidates) {
    if (std::abs(candidate.above) - std::abs(nearest->above) > gap(candidate)) continue;
    if (!best || rank(candidate) < rank(*best)) best = &candidate;
  }
  return answer(*best->patch, place, best->distance, up_);
}

SurfaceQuery SurfaceLookup::query(const Vector3d& place, double reach) const {
  return choose(within(place, reach), place, false);
}

SurfaceQuery SurfaceLookup::query_level(const Vector3d& place, double reach) const {
  return choose(within(place, reach), place, true);
}

SurfaceQuery SurfaceLookup::query_ray(const Vector3d& origin, const Vector3d& direction,
                                      double reach) const {
  const Entry* best = nullptr;
  Vector3d place = origin;
  double best_distance = std::max(0.0, reach), best_along = 0.0;
  for (const Entry& entry : entries_) {
    const Plane& plane = entry.patch->plane.plane;
    const double along = -plane.signed_distance(origin) / plane.normal.dot(direction);
    if (!(along > 0.0) || !std::isfinite(along)) continue;
    const Vector3d hit = origin + along * direction;
    const double distance = distance_to_polygon(entry.outline, axes_(hit));
    if (distance > best_distance) continue;
    if (best && distance == best_distance && along >= best_along) continue;
    best = &entry;
    best_distance = distance;
    best_along = along;
    place = hit;
  }
  if (!best) return choose({}, place, false);
  return answer(*best->patch, place, best_distance, up_);
}

namespace {

/// The offset that most of the places have in common, or zero if a good part of them lies on
/// ground.
/// @param above  m, of each place above each patch within its reach
double common_offset(const std::vector<std::vector<double>>& above) {
  std::vector<double> all, on_ground;
  for (const std::vector<double>& of_place : above) {
    for (const double a : of_place) {
      all.push_back(a);
      if (std::abs(a) <= kLevelGap) on_ground.push_back(a);
    }
  }
  std::sort(all.begin(), all.end());
  std::size_t from = 0, best_from = 0, most = 0;
  for (std::size_t to = 0; to < all.size(); ++to) {
    while (all[to] - all[from] > 2.0 * kLevelGap) ++from;
    if (to + 1 - from > most) {
      most = to + 1 - from;
      best_from = from;
    }
  }
  if (static_cast<double>(on_ground.size()) >= kOnGround * static_cast<double>(most)) {
    return upper_median(&on_ground);
  }
  return all[best_from + most / 2];
}

/// Values with those that are missing (NaN) linear between the others; at least one is there.
std::vector<double> between(const std::vector<double>& stations, std::vector<double> values) {
  std::size_t before = values.size();  // none
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (std::isnan(values[k])) continue;
    const std::size_t from = before < values.size() ? before : 0;
    for (std::size_t j = from; j < k; ++j) {
      const double way = stations[k] - stations[from];
      const double share =
          before < values.size() && way > 0.0 ? (stations[j] - stations[from]) / way : 1.0;
      if (std::isnan(values[j])) {
        values[j] = share < 1.0 ? values[from] + share * (values[k] - values[from]) : values[k];
      }
    }
    before = k;
  }
  std::fill(values.begin() + static_cast<long>(before) + 1, values.end(), values[before]);
  return values;
}

}  // namespace

LineOverGround SurfaceLookup::follow(const std::vector<Vector3d>& line, double reach) const {
  LineOverGround out;
  const std::size_t count = line.size();
  out.above.assign(count, 0.0);
  std::vector<std::vector<double>> above(count);
  std::vector<double> stations(count, 0.0);
  double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
  bool any = false;
  for (std::size_t k = 0; k < count; ++k) {
    for (const Candidate& c : within(line[k], reach)) above[k].push_back(c.above);
    any = any || !above[k].empty();
    lowest = std::min(lowest, line[k].dot(up_));
    highest = std::max(highest, line[k].dot(up_));
    if (k > 0) stations[k] = stations[k - 1] + (axes_(line[k]) - axes_(line[k - 1])).norm();
  }
  if (!any) return out;
  out.offset = common_offset(above);
  // Steps that the ground under the line may make between places, away from the line's own.
  const double unseen_slope = highest - lowest > kWithoutHeights ? 0.0 : kSteepUnseen;
  std::vector<double> found(count, kNaN);
  const auto accept = [&](std::size_t k, double expected, double most) {
    for (const double a : above[k]) {
      const double off = std::abs(a - expected);
      if (off <= most && !(off >= std::abs(found[k] - expected))) found[k] = a;
    }
  };
  const double level = metric_ ? kLevelGap : std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < count; ++k) accept(k, out.offset, level);
  std::size_t last = count;  // none
  const auto spread = [&](std::size_t k) {
    if (std::isnan(found[k]) && last < count) {
      accept(k, found[last], level + unseen_slope * std::abs(stations[k] - stations[last]));
    }
    if (!std::isnan(found[k])) last = k;
  };
  for (std::size_t k = 0; k < count; ++k) spread(k);
  last = count;
  for (std::size_t k = count; k-- > 0;) spread(k);
  out.above = between(stations, found);
  return out;
}

std::vector<int> take_as_road(const std::vector<Vector3d>& line, double reach,
                              RoadSurface* surface) {
  constexpr double kStep = 1.0, kMost = 1e5;  // m; places
  const Vector3d up = surface->up.normalized();
  std::vector<double> lengths;
  double total = 0.0;
  for (std::size_t k = 0; k + 1 < line.size(); ++k) {
    lengths.push_back((line[k + 1] - line[k]).norm());
    total += lengths.back();
  }
  const double step = std::max(kStep, total / kMost);
  std::vector<Vector3d> places;
  for (std::size_t k = 0; k < lengths.size(); ++k) {
    const double parts = std::max(1.0, std::ceil(lengths[k] / step));
    for (double i = 0.0; i < parts; i += 1.0) {
      places.emplace_back(line[k] + i / parts * (line[k + 1] - line[k]));
    }
  }
  if (!line.empty()) places.push_back(line.back());
  const SurfaceLookup lookup(*surface, true);
  const LineOverGround over = lookup.follow(places, reach);
  std::set<int> taken;
  for (std::size_t k = 0; k < places.size(); ++k) {
    const SurfaceQuery answer = lookup.query_level(places[k] - over.above[k] * up, reach);
    const PlanePatch* const patch = surface->find(answer.patch);
    if (patch && patch->kind == PatchKind::kOther) taken.insert(patch->id);
  }
  for (PlanePatch& patch : surface->patches) {
    if (taken.count(patch.id) > 0) patch.kind = PatchKind::kRoad;
  }
  return {taken.begin(), taken.end()};
}

}  // namespace camber
