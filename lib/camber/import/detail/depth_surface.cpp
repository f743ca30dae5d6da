#include "camber/import/detail/depth_surface.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace camber {
namespace {

constexpr double kLargestStep = 0.8;       // m across two pixels of one face
constexpr double kRelativeStep = 0.06;     // of the depth
constexpr double kGroundReach = 2.5;       // m beyond the vehicle
constexpr std::size_t kFewestGround = 30;  // pixels
constexpr double kGroundScatter = 0.02;    // m, least scale of the robust fit
constexpr double kNearer = 0.1;            // m, of what hides a vehicle

Eigen::Vector3d point_at(const DepthImage& depth, const PinholeCamera& camera, int index) {
  const double z = depth.metres[static_cast<std::size_t>(index)];
  const int x = index % depth.width, y = index / depth.width;
  return {(x - camera.cx) / camera.fx * z, (y - camera.cy) / camera.fy * z, z};
}

/// Membership of a region's pixels within its rectangle.
class RegionMask {
 public:
  RegionMask(const VehicleRegion& region, int width) : width_(width) {
    const Box2 box = box_of(region, width);
    x1_ = static_cast<int>(box.x1);
    y1_ = static_cast<int>(box.y1);
    columns_ = static_cast<int>(box.x2) - x1_ + 1;
    rows_ = static_cast<int>(box.y2) - y1_ + 1;
    inside_.assign(static_cast<std::size_t>(columns_) * rows_, false);
    for (const int pixel : region.pixels) inside_[place(pixel % width, pixel / width)] = true;
  }
  bool has(int x, int y) const {
    if (x < x1_ || y < y1_ || x >= x1_ + columns_ || y >= y1_ + rows_) return false;
    return inside_[place(x, y)];
  }
  int first_row() const { return y1_; }
  int rows() const { return rows_; }

 private:
  std::size_t place(int x, int y) const {
    return static_cast<std::size_t>(y - y1_) * columns_ + (x - x1_);
  }
  int width_, x1_ = 0, y1_ = 0, columns_ = 0, rows_ = 0;
  std::vector<bool> inside_;
};

/// Least squares with Geman and McClure's weights, scale by the median residual; normal up.
Plane robust_plane(const std::vector<Eigen::Vector3d>& points) {
  constexpr int kRounds = 12;
  std::vector<double> weights(points.size(), 1.0), residuals(points.size());
  Plane plane;
  for (int round = 0; round < kRounds; ++round) {
    double sum = 0.0;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < points.size(); ++i) {
      mean += weights[i] * points[i];
      sum += weights[i];
    }
    mean /= sum;
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d d = points[i] - mean;
      scatter += weights[i] * d * d.transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
    const Eigen::Vector3d normal = solver.eigenvectors().col(0);
    plane = Plane::through(mean, normal).oriented({0.0, -1.0, 0.0});
    for (std::size_t i = 0; i < points.size(); ++i) {
      residuals[i] = std::abs(plane.signed_distance(points[i]));
    }
    const double scale = std::max(kGroundScatter, 1.5 * take_quantile(residuals, 0.5));
    for (std::size_t i = 0; i < points.size(); ++i) {
      const double r = residuals[i] / scale;
      weights[i] = 1.0 / ((1.0 + r * r) * (1.0 + r * r));
    }
  }
  return plane;
}

/// Corners of the convex outline of points, counter-clockwise in (x, y) (Andrew's chain).
std::vector<Eigen::Vector2d> convex_outline(std::vector<Eigen::Vector2d> points) {
  std::sort(points.begin(), points.end(), [](const auto& a, const auto& b) {
    return a.x() < b.x() || (a.x() == b.x() && a.y() < b.y());
  });
  const auto turn = [](const Eigen::Vector2d& a, const Eigen::Vector2d& b,
                       const Eigen::Vector2d& c) {
    return (b - a).x() * (c - a).y() - (b - a).y() * (c - a).x();
  };
  std::vector<Eigen::Vector2d> out;
  for (int pass = 0; pass < 2; ++pass) {
    const std::size_t start = out.size();
    for (const Eigen::Vector2d& p : points) {
      while (out.size() >= start + 2 && turn(out[out.size() - 2], out.back(), p) <= 0.0) {
        out.pop_back();
      }
      out.push_back(p);
    }
    out.pop_back();
    std::reverse(points.begin(), points.end());
  }
  return out;
}

bool inside(const std::vector<Eigen::Vector2d>& outline, const Eigen::Vector2d& p) {
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const Eigen::Vector2d &a = outline[i], &b = outline[(i + 1) % outline.size()];
    if ((b - a).x() * (p - a).y() - (b - a).y() * (p - a).x() < 0.0) return false;
  }
  return true;
}

}  // namespace

double take_quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(
                                       std::lround(share * static_cast<double>(values.size() - 1)));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

Box2 box_of(const VehicleRegion& region, int width) {
  Box2 box{1e9, 1e9, -1e9, -1e9};
  for (const int pixel : region.pixels) {
    const double x = pixel % width, y = pixel / width;
    box = {std::min(box.x1, x), std::min(box.y1, y), std::max(box.x2, x), std::max(box.y2, y)};
  }
  return box;
}

DepthSurface surface_of(const VehicleRegion& region, const DepthImage& depth,
                        const PinholeCamera& camera) {
  const RegionMask mask(region, depth.width);
  DepthSurface out;
  out.points.reserve(region.pixels.size());
  for (const int pixel : region.pixels) {
    const int x = pixel % depth.width, y = pixel / depth.width;
    out.points.push_back(point_at(depth, camera, pixel));
    out.normals.emplace_back(Eigen::Vector3d::Zero());
    out.areas.push_back(0.0);
    if (!mask.has(x - 1, y) || !mask.has(x + 1, y) || !mask.has(x, y - 1) || !mask.has(x, y + 1)) {
      continue;
    }
    const Eigen::Vector3d across = point_at(depth, camera, pixel + 1) -
                                   point_at(depth, camera, pixel - 1),
                          down = point_at(depth, camera, pixel + depth.width) -
                                 point_at(depth, camera, pixel - depth.width);
    const double step = std::max(kLargestStep, kRelativeStep * out.points.back().z());
    if (std::abs(across.z()) > step || std::abs(down.z()) > step) continue;
    const Eigen::Vector3d normal = down.cross(across);
    const double area = normal.norm();
    if (!(area > 0.0)) continue;
    out.normals.back() = normal / area;
    out.areas.back() = area;
  }
  return out;
}

std::optional<Plane> ground_beside(const VehicleRegion& region, const DepthSurface& surface,
                                   const LabelledDepth& image, const PinholeCamera& camera) {
  std::vector<double> coordinates[3];
  for (const Eigen::Vector3d& p : surface.points) {
    for (int k = 0; k < 3; ++k) coordinates[k].push_back(p[k]);
  }
  Eigen::Vector3d middle;
  for (int k = 0; k < 3; ++k) middle[k] = take_quantile(coordinates[k], 0.5);
  std::vector<double> distances;
  for (const Eigen::Vector3d& p : surface.points) distances.push_back((p - middle).norm());
  const double reach = kGroundReach + take_quantile(distances, 0.95);

  const DepthImage& depth = *image.depth;
  const Box2 box = box_of(region, depth.width);
  const int x1 = std::max(0, static_cast<int>(box.x1 - 0.8 * box.width())),
            x2 = std::min(depth.width - 1, static_cast<int>(box.x2 + 0.8 * box.width())),
            y1 = static_cast<int>(box.y1),
            y2 = std::min(depth.height - 1, static_cast<int>(box.y2 + 0.6 * box.height()) + 2);
  std::vector<Eigen::Vector3d> ground;
  for (int y = y1; y <= y2; ++y) {
    for (int x = x1; x <= x2; ++x) {
      const int index = y * depth.width + x;
      if (!image.ground_classes.count(image.classes->data[static_cast<std::size_t>(index)])) {
        continue;
      }
      const Eigen::Vector3d p = point_at(depth, camera, index);
      if (p.allFinite() && (p - middle).norm() < reach) ground.push_back(p);
    }
  }
  if (ground.size() < kFewestGround) return std::nullopt;
  return robust_plane(ground);
}

SilhouetteEnds silhouette_ends(const VehicleRegion& region, const DepthImage& depth,
                               const std::vector<bool>& low) {
  const Box2 box = box_of(region, depth.width);
  const int first = static_cast<int>(box.y1);
  const std::size_t count = static_cast<std::size_t>(box.height()) + 1;
  std::vector<int> left(count, depth.width), right(count, -1);
  std::vector<bool> looked_at(count);
  for (std::size_t i = 0; i < region.pixels.size(); ++i) {
    const int x = region.pixels[i] % depth.width;
    const auto row = static_cast<std::size_t>(region.pixels[i] / depth.width - first);
    left[row] = std::min(left[row], x);
    right[row] = std::max(right[row], x);
    if (low[i]) looked_at[row] = true;
  }
  SilhouetteEnds out;
  int rows = 0;
  for (std::size_t row = 0; row < count; ++row) {
    if (!looked_at[row] || right[row] <= left[row]) continue;
    ++rows;
    const int start = (first + static_cast<int>(row)) * depth.width;
    const auto judge = [&](int x, int beside, double* hidden, double* cut) {
      if (beside < 0 || beside >= depth.width) {
        *cut += 1.0;
      } else if (depth.metres[static_cast<std::size_t>(start + beside)] <
                 depth.metres[static_cast<std::size_t>(start + x)] - kNearer) {
        *hidden += 1.0;
      }
    };
    judge(left[row], left[row] - 1, &out.hidden_left, &out.cut_left);
    judge(right[row], right[row] + 1, &out.hidden_right, &out.cut_right);
  }
  for (double* share : {&out.hidden_left, &out.hidden_right, &out.cut_left, &out.cut_right}) {
    *share /= std::max(rows, 1);
  }
  return out;
}

double hidden_share(const VehicleRegion& region, const OrientedBox& box, const LabelledDepth& image,
                    const PinholeCamera& camera) {
  const auto corners = box.corners();
  if (!(corners.row(2).minCoeff() > 0.1)) return 0.0;
  std::vector<Eigen::Vector2d> projected;
  Box2 bounds{1e9, 1e9, -1e9, -1e9};
  for (Eigen::Index i = 0; i < corners.cols(); ++i) {
    projected.push_back(*camera.project(corners.col(i)));
    const Eigen::Vector2d& p = projected.back();
    bounds = {std::min(bounds.x1, p.x()), std::min(bounds.y1, p.y()), std::max(bounds.x2, p.x()),
              std::max(bounds.y2, p.y())};
  }
  const std::vector<Eigen::Vector2d> outline = convex_outline(std::move(projected));
  bounds = bounds.clipped(camera.width, camera.height);
  const double nearest = corners.row(2).minCoeff() - kNearer;
  std::size_t hidden = 0;
  for (int y = static_cast<int>(bounds.y1); y <= static_cast<int>(bounds.y2); ++y) {
    for (int x = static_cast<int>(bounds.x1); x <= static_cast<int>(bounds.x2); ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * camera.width + x;
      if (!(image.depth->metres[at] < nearest)) continue;
      if (image.ground_classes.count(image.classes->data[at])) continue;
      hidden += inside(outline, {x, y}) ? 1 : 0;
    }
  }
  return static_cast<double>(hidden) / static_cast<double>(hidden + region.pixels.size());
}

}  // namespace camber
