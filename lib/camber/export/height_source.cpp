#include "camber/export/height_source.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numeric>

#include "camber/core/median.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;

namespace {

constexpr double kLevelGap = 1.5;     // m, points farther up or down belong to another level
constexpr double kLeastScale = 0.01;  // m, of the biweight

class SurfaceHeights : public HeightSource {
 public:
  SurfaceHeights(const RoadSurface& surface, const PlanFrame& frame, double reach)
      : surface_(surface), frame_(frame), reach_(reach) {}

  GroundSample at(const Vector3d& place) const override {
    GroundSample sample;
    const SurfaceQuery answer = surface_.query(frame_.to_surface(place), reach_);
    if (answer.status == Status::kFailed) return sample;
    sample.normal = frame_.turned(answer.plane.plane.normal);
    sample.height = frame_.to_plan(answer.point).z();
    sample.sigma = answer.sigma_height / std::max(sample.normal.z(), 1e-3);
    return sample;
  }
  double resolution() const override { return 0.0; }

 private:
  RoadSurface surface_;
  PlanFrame frame_;
  double reach_;
};

/// Points in square cells of the plan.
class PlanPoints {
 public:
  PlanPoints(const RoadCloud& cloud, const PlanFrame& frame, const std::vector<int>& chosen) {
    for (const int i : chosen) {
      const Vector3d x =
          frame.to_plan(cloud.origin + cloud.points[static_cast<std::size_t>(i)].cast<double>());
      if (!x.allFinite()) continue;
      points_.push_back(x);
      indices_.push_back(i);
    }
    if (points_.empty()) return;
    low_ = high_ = points_.front().head<2>();
    for (const Vector3d& x : points_) {
      low_ = low_.cwiseMin(x.head<2>());
      high_ = high_.cwiseMax(x.head<2>());
    }
    // Occupied area by cells that hold a few points each, then the spacing within it.
    const Vector2d size = (high_ - low_).cwiseMax(1e-3);
    double cell = std::sqrt(size.x() * size.y() / static_cast<double>(points_.size())) * 3.0;
    for (int round = 0; round < 3; ++round) {
      sort_into(cell);
      std::size_t occupied = 0;
      for (std::size_t c = 0; c + 1 < starts_.size(); ++c) occupied += starts_[c + 1] > starts_[c];
      spacing_ = std::sqrt(static_cast<double>(occupied) * cell_ * cell_ /
                           static_cast<double>(points_.size()));
      cell = 3.0 * spacing_;
    }
    sort_into(cell);
  }

  double spacing() const { return spacing_; }

  /// Calls visit(position) for the points of the cells within `radius` of a place.
  template <typename Visit>
  void near(const Vector2d& place, double radius, Visit&& visit) const {
    if (points_.empty()) return;
    const auto column = [&](double value, double low, long count) {
      return std::clamp<long>(static_cast<long>(std::floor((value - low) / cell_)), 0, count - 1);
    };
    if (place.x() < low_.x() - radius || place.x() > high_.x() + radius ||
        place.y() < low_.y() - radius || place.y() > high_.y() + radius) {
      return;
    }
    for (long y = column(place.y() - radius, low_.y(), rows_);
         y <= column(place.y() + radius, low_.y(), rows_); ++y) {
      for (long x = column(place.x() - radius, low_.x(), columns_);
           x <= column(place.x() + radius, low_.x(), columns_); ++x) {
        const auto c = static_cast<std::size_t>(y * columns_ + x);
        for (std::size_t k = starts_[c]; k < starts_[c + 1]; ++k) {
          if ((points_[order_[k]].head<2>() - place).squaredNorm() <= radius * radius) {
            visit(order_[k]);
          }
        }
      }
    }
  }
  const Vector3d& point(std::size_t position) const { return points_[position]; }
  int index(std::size_t position) const { return indices_[position]; }

 private:
  void sort_into(double cell) {
    // No more cells than a few for each point.
    const Vector2d size = high_ - low_;
    const double most = 4.0 * static_cast<double>(points_.size()) + 16.0;
    cell_ = std::max({cell, 1e-3, std::sqrt(size.x() * size.y() / most), size.maxCoeff() / most});
    columns_ = static_cast<long>(size.x() / cell_) + 1;
    rows_ = static_cast<long>(size.y() / cell_) + 1;
    starts_.assign(static_cast<std::size_t>(columns_ * rows_) + 1, 0);
    const auto cell_of = [&](const Vector3d& x) {
      const long column = std::min(static_cast<long>((x.x() - low_.x()) / cell_), columns_ - 1);
      const long row = std::min(static_cast<long>((x.y() - low_.y()) / cell_), rows_ - 1);
      return static_cast<std::size_t>(row * columns_ + column);
    };
    for (const Vector3d& x : points_) ++starts_[cell_of(x) + 1];
    std::partial_sum(starts_.begin(), starts_.end(), starts_.begin());
    order_.resize(points_.size());
    std::vector<std::size_t> next = starts_;
    for (std::size_t i = 0; i < points_.size(); ++i) order_[next[cell_of(points_[i])]++] = i;
  }

  std::vector<Vector3d> points_;
  std::vector<int> indices_;
  Vector2d low_ = Vector2d::Zero(), high_ = Vector2d::Zero();
  double cell_ = 1.0, spacing_ = 0.0;
  long columns_ = 1, rows_ = 1;
  std::vector<std::size_t> starts_, order_;
};

std::vector<int> ground_points(const RoadCloud& cloud) {
  std::vector<int> chosen;
  const auto ground = cloud.labels.find("ground"), patch = cloud.labels.find("patch");
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    if (ground != cloud.labels.end() && ground->second[i] == 0) continue;
    if (ground == cloud.labels.end() && patch != cloud.labels.end() && patch->second[i] < 0)
      continue;
    chosen.push_back(static_cast<int>(i));
  }
  return chosen;
}

class CloudHeights : public HeightSource {
 public:
  CloudHeights(const RoadCloud& cloud, const PlanFrame& frame)
      : points_(cloud, frame, ground_points(cloud)) {}

  GroundSample at(const Vector3d& place) const override {
    const double radius = 2.5 * points_.spacing();
    std::vector<Vector3d> near;
    points_.near(place.head<2>(), radius, [&](std::size_t k) {
      const Vector3d d = points_.point(k) - place;
      if (std::abs(d.z()) < kLevelGap) near.push_back(d);
    });
    return fit(place, near, radius);
  }
  double resolution() const override { return points_.spacing(); }

 private:
  static GroundSample fit(const Vector3d& place, const std::vector<Vector3d>& near, double radius) {
    GroundSample sample;
    if (near.size() < 4) return sample;
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
    sample.height = place.z() + plane[0];
    sample.sigma = scale * std::sqrt(std::max(information.inverse()(0, 0), 0.0));
    sample.normal = Vector3d(-plane[1], -plane[2], 1.0).normalized();
    return sample;
  }

  PlanPoints points_;
};

}  // namespace

std::unique_ptr<HeightSource> surface_heights(const RoadSurface& surface, const PlanFrame& frame,
                                              double reach) {
  return std::make_unique<SurfaceHeights>(surface, frame, reach);
}

std::unique_ptr<HeightSource> cloud_heights(const RoadCloud& cloud, const PlanFrame& frame) {
  return std::make_unique<CloudHeights>(cloud, frame);
}

struct ColorSource::Points {
  PlanPoints points;
  std::vector<std::array<std::uint8_t, 3>> colors;
};

ColorSource::ColorSource(const RoadCloud& cloud, const PlanFrame& frame) {
  std::vector<int> all(cloud.colors.empty() ? 0 : cloud.size());
  std::iota(all.begin(), all.end(), 0);
  points_ = std::make_unique<Points>(Points{PlanPoints(cloud, frame, all), cloud.colors});
}

ColorSource::~ColorSource() = default;

double ColorSource::resolution() const { return points_->points.spacing(); }

std::optional<std::array<std::uint8_t, 3>> ColorSource::at(const Vector3d& place) const {
  double least = std::numeric_limits<double>::infinity();
  int best = -1;
  points_->points.near(place.head<2>(), 3.0 * resolution(), [&](std::size_t k) {
    const Vector3d d = points_->points.point(k) - place;
    if (std::abs(d.z()) > kLevelGap || d.head<2>().norm() >= least) return;
    least = d.head<2>().norm();
    best = points_->points.index(k);
  });
  if (best < 0) return std::nullopt;
  return points_->colors[static_cast<std::size_t>(best)];
}

}  // namespace camber
