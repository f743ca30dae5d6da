#include "camber/export/height_source.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <utility>

#include "camber/core/median.h"
#include "camber/export/detail/plan_points.h"
#include "camber/road/surface_lookup.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kSupport = 2.5;         // of the spacing, radius of the points of a node's plane
constexpr double kLocalSupport = 3.0;    // of the least spacing of a few points next to the node
constexpr double kWidestSupport = 2.5;   // m, of the same
constexpr double kMostTimes = 8.0;       // the support elsewhere, of the same
constexpr double kWider = 1.2;           // times the support before, or it is not worth while
constexpr std::size_t kLeastPoints = 4;  // of a plane
constexpr std::size_t kNeighbours = 8, kFew = 5;
constexpr double kLeastSpread =
    0.05;                             // product of neighbours' two variances over their sum squared
constexpr double kLeastScale = 0.01;  // m, of the biweight

class SurfaceHeights : public HeightSource {
 public:
  SurfaceHeights(const RoadSurface& surface, const PlanFrame& frame, double reach)
      : surface_(surface), lookup_(surface_), frame_(frame), reach_(reach) {}

  GroundSample at(const Vector3d& place) const override {
    GroundSample sample;
    const SurfaceQuery answer = lookup_.query_level(frame_.to_surface(place), reach_);
    if (answer.status == Status::kFailed) return sample;
    sample.normal = frame_.turned(answer.plane.plane.normal);
    sample.height = frame_.to_plan(answer.point).z();
    sample.sigma = answer.sigma_height / std::max(sample.normal.z(), 1e-3);
    return sample;
  }
  std::vector<double> levels_along(const std::vector<Vector3d>& line) const override {
    std::vector<Vector3d> places;
    places.reserve(line.size());
    for (const Vector3d& place : line) places.push_back(frame_.to_surface(place));
    std::vector<double> levels = lookup_.follow(places, reach_).above;
    for (std::size_t k = 0; k < line.size(); ++k) levels[k] = line[k].z() - levels[k];
    return levels;
  }
  double resolution() const override { return 0.0; }

 private:
  RoadSurface surface_;
  SurfaceLookup lookup_;
  PlanFrame frame_;
  double reach_;
};

/// Points of a cloud in the plan.
struct Chosen {
  std::vector<Vector3d> points;
  std::vector<std::size_t> indices;
};

/// The finite points within a corridor, and no farther from it than three times its reach.
template <typename Wanted>
Chosen choose(const RoadCloud& cloud, const PlanFrame& frame, const PlanCorridor* where,
              Wanted&& wanted) {
  std::optional<detail::PlanCells> cells;
  if (where != nullptr && !where->places.empty()) {
    cells.emplace(where->places.front(), where->reach);
    for (const Vector2d& place : where->places) {
      const detail::PlanCells::Cell middle = cells->cell_of(place);
      for (int k = 0; k < 9; ++k) cells->add({middle.x + k % 3 - 1, middle.y + k / 3 - 1});
    }
  }
  Chosen out;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (!wanted(i)) continue;
    const Vector3d x = frame.to_plan(cloud.origin + cloud.points[i].cast<double>());
    if (!x.allFinite()) continue;
    if (cells && cells->find(cells->cell_of(x.head<2>())) == detail::PlanCells::kNone) continue;
    out.points.push_back(x);
    out.indices.push_back(i);
  }
  return out;
}

std::vector<Vector3d> ground_points(const RoadCloud& cloud, const PlanFrame& frame,
                                    const PlanCorridor* where) {
  const auto ground = cloud.labels.find("ground"), patch = cloud.labels.find("patch");
  return choose(cloud, frame, where,
                [&](std::size_t i) {
                  if (ground != cloud.labels.end()) return ground->second[i] != 0;
                  return patch == cloud.labels.end() || patch->second[i] >= 0;
                })
      .points;
}

class CloudHeights : public HeightSource {
 public:
  explicit CloudHeights(const std::vector<Vector3d>& points)
      : points_(points),
        radius_(kSupport * points_.spacing()),
        widest_(std::clamp(kWidestSupport, radius_, kMostTimes * radius_)),
        spacings_(std::make_unique<std::atomic<float>[]>(points.size())) {}

  GroundSample at(const Vector3d& place) const override {
    const GroundSample sample = fit(place, near(place, radius_), radius_);
    if (std::isfinite(sample.height) || widest_ <= radius_) return sample;
    const double wider = std::min(kLocalSupport * spacing_at(place), widest_);
    if (!(wider > kWider * radius_)) return sample;
    return fit(place, near(place, wider), wider);
  }
  std::vector<double> levels(const Vector2d& place) const override {
    std::vector<double> heights;
    points_.near(place, radius_, [&](std::size_t k) { heights.push_back(points_.point(k).z()); });
    std::sort(heights.begin(), heights.end());
    std::vector<double> out;
    for (std::size_t from = 0, i = 0; i < heights.size(); ++i) {
      if (i + 1 < heights.size() && heights[i + 1] - heights[i] < kPointLevelGap) continue;
      const double height = at({place.x(), place.y(), heights[(from + i) / 2]}).height;
      if (std::isfinite(height)) out.push_back(height);
      from = i + 1;
    }
    return out;
  }
  double resolution() const override { return points_.spacing(); }

 private:
  /// Points of a place's level, relative to it.
  std::vector<Vector3d> near(const Vector3d& place, double radius) const {
    std::vector<Vector3d> out;
    points_.near(place.head<2>(), radius, [&](std::size_t k) {
      const Vector3d d = points_.point(k) - place;
      if (std::abs(d.z()) < kPointLevelGap) out.push_back(d);
    });
    return out;
  }

  /// m, of the points next to a place, the least of a few: beside a hole that of its rim, whose own
  /// is too large, and in a sparse part of the cloud its own. 0: no points are next to it.
  double spacing_at(const Vector3d& place) const {
    std::vector<std::pair<double, std::size_t>> next;
    points_.near(place.head<2>(), widest_ / kSupport, [&](std::size_t k) {
      const Vector3d d = points_.point(k) - place;
      if (std::abs(d.z()) < kPointLevelGap) next.emplace_back(d.head<2>().squaredNorm(), k);
    });
    const std::size_t few = std::min(kFew, next.size());
    std::partial_sort(next.begin(), next.begin() + static_cast<long>(few), next.end());
    double least = few > 0 ? widest_ : 0.0;
    for (std::size_t i = 0; i < few; ++i) least = std::min(least, spacing_of(next[i].second));
    return least;
  }

  /// m, around a point: of as many neighbours as it takes to have them on no line.
  double spacing_of(std::size_t k) const {
    // Threads that meet here find the same value.
    const float known = spacings_[k].load(std::memory_order_relaxed);
    if (known > 0.0f) return known;
    double radius = radius_;
    std::vector<Vector3d> around = near(points_.point(k), radius);
    double spacing = spacing_by(&around);
    while (!(spacing > 0.0) && radius < widest_) {
      radius *= kWider;
      around = near(points_.point(k), radius);
      spacing = spacing_by(&around);
    }
    const auto found = static_cast<float>(spacing > 0.0 ? spacing : widest_ / kSupport);
    spacings_[k].store(found, std::memory_order_relaxed);
    return found;
  }

  /// The same by points around the origin; 0: they are too few, or on a line.
  static double spacing_by(std::vector<Vector3d>* around) {
    std::sort(around->begin(), around->end(), [](const Vector3d& a, const Vector3d& b) {
      return a.head<2>().squaredNorm() < b.head<2>().squaredNorm();
    });
    double xx = 0.0, xy = 0.0, yy = 0.0;
    for (std::size_t i = 0; i < around->size(); ++i) {  // the first is the point itself
      const Vector3d& d = (*around)[i];
      xx += d.x() * d.x(), xy += d.x() * d.y(), yy += d.y() * d.y();
      // The lesser of the eigenvalues is at least their product over their sum.
      const double trace = xx + yy;
      if (i < kNeighbours || xx * yy - xy * xy < kLeastSpread * trace * trace) continue;
      return d.head<2>().norm() * std::sqrt(M_PI / static_cast<double>(kNeighbours));
    }
    return 0.0;
  }

  static GroundSample fit(const Vector3d& place, const std::vector<Vector3d>& near, double radius) {
    GroundSample sample;
    if (near.size() < kLeastPoints) return sample;
    // Points to one side only would extrapolate.
    Vector2d middle = Vector2d::Zero();
    for (const Vector3d& d : near) middle += d.head<2>() / static_cast<double>(near.size());
    if (middle.norm() > 0.5 * radius) return sample;
    std::vector<double> weights(near.size(), 1.0), off(near.size());
    Vector3d plane = Vector3d::Zero();
    Eigen::Matrix3d information;
    double scale = 0.0;
    for (int round = 0; round < 4; ++round) {
      information.setZero();
      Vector3d right = Vector3d::Zero();
      for (std::size_t i = 0; i < near.size(); ++i) {
        const Vector3d row(1.0, near[i].x(), near[i].y());
        const double share = near[i].head<2>().norm() / radius;
        const double w = weights[i] * std::max(1.0 - share * share * share, 0.0);
        information += w * row * row.transpose();
        right += w * near[i].z() * row;
      }
      const Eigen::LDLT<Eigen::Matrix3d> solver(information);
      if (!(solver.rcond() > 1e-9)) return sample;
      plane = solver.solve(right);
      for (std::size_t i = 0; i < near.size(); ++i) {
        off[i] = std::abs(near[i].z() - plane.dot(Vector3d(1.0, near[i].x(), near[i].y())));
      }
      std::vector<double> sorted = off;
      std::nth_element(sorted.begin(), sorted.begin() + static_cast<long>(sorted.size() / 2),
                       sorted.end());
      scale = std::max(kSigmaFromMad * sorted[sorted.size() / 2], kLeastScale);
      for (std::size_t i = 0; i < near.size(); ++i) {
        const double t = off[i] / (4.685 * scale);
        weights[i] = t < 1.0 ? (1.0 - t * t) * (1.0 - t * t) : 0.0;
      }
    }
    // Worse than a single point at the place: extrapolated, or from too few.
    const double variance = information.inverse()(0, 0);
    if (!(variance > 0.0 && variance <= 1.0)) return sample;
    sample.height = place.z() + plane[0];
    sample.sigma = scale * std::sqrt(variance);
    sample.normal = Vector3d(-plane[1], -plane[2], 1.0).normalized();
    return sample;
  }

  detail::PlanPoints points_;
  double radius_, widest_;                          // m, of a plane's support
  std::unique_ptr<std::atomic<float>[]> spacings_;  // 0: not known yet
};

}  // namespace

std::vector<double> HeightSource::levels_along(const std::vector<Vector3d>& /*line*/) const {
  return {};
}

std::unique_ptr<HeightSource> surface_heights(const RoadSurface& surface, const PlanFrame& frame,
                                              double reach) {
  return std::make_unique<SurfaceHeights>(surface, frame, reach);
}

PlanCorridor corridor_along(const SmoothLine& line, double reach) {
  PlanCorridor corridor;
  corridor.reach = reach;
  const auto steps = static_cast<std::size_t>(std::ceil(line.length() / (0.5 * reach)));
  for (std::size_t i = 0; i <= steps; ++i) {
    corridor.places.push_back(
        line.position(std::min(static_cast<double>(i) * 0.5 * reach, line.length())));
  }
  return corridor;
}

std::unique_ptr<HeightSource> cloud_heights(const RoadCloud& cloud, const PlanFrame& frame,
                                            const PlanCorridor* where) {
  return std::make_unique<CloudHeights>(ground_points(cloud, frame, where));
}

struct ColorSource::Points {
  detail::PlanPoints points;
  std::vector<std::array<std::uint8_t, 3>> colors;
};

ColorSource::ColorSource(const RoadCloud& cloud, const PlanFrame& frame,
                         const PlanCorridor* where) {
  const Chosen chosen =
      choose(cloud, frame, where, [&](std::size_t) { return !cloud.colors.empty(); });
  points_ = std::make_unique<Points>();
  points_->points = detail::PlanPoints(chosen.points);
  for (const std::size_t i : chosen.indices) points_->colors.push_back(cloud.colors[i]);
}

ColorSource::~ColorSource() = default;

double ColorSource::resolution() const { return points_->points.spacing(); }

std::optional<std::array<std::uint8_t, 3>> ColorSource::at(const Vector3d& place) const {
  double least = std::numeric_limits<double>::infinity();
  std::optional<std::size_t> best;
  points_->points.near(place.head<2>(), 3.0 * resolution(), [&](std::size_t k) {
    const Vector3d d = points_->points.point(k) - place;
    if (std::abs(d.z()) > kPointLevelGap || d.head<2>().norm() >= least) return;
    least = d.head<2>().norm();
    best = points_->points.index(k);
  });
  if (!best) return std::nullopt;
  return points_->colors[*best];
}

}  // namespace camber
