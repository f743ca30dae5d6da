#include "camber/render/wireframe.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace camber {
namespace {
constexpr int kMirror = 18;    // row i + 18 mirrors row i
constexpr int kFirstLoop = 2;  // the side's outline is 2 ... 17
constexpr int kLastLoop = 17;
constexpr int kFirstBar = 10;  // cross bars from the rear bumper over the roof to the front bumper
}  // namespace

const std::vector<std::pair<int, int>>& wireframe_edges() {
  static const std::vector<std::pair<int, int>> edges = [] {
    std::vector<std::pair<int, int>> out;
    for (int side = 0; side <= kMirror; side += kMirror) {
      for (int i = kFirstLoop; i <= kLastLoop; ++i) {
        const int next = i == kLastLoop ? kFirstLoop : i + 1;
        out.emplace_back(side + i, side + next);
      }
    }
    for (int i = kFirstBar; i <= kLastLoop; ++i) out.emplace_back(i, i + kMirror);
    return out;
  }();
  return edges;
}

const std::vector<std::array<int, 3>>& wireframe_triangles() {
  static const std::vector<std::array<int, 3>> triangles = [] {
    // The side's outline, cut so that no triangle leaves it: wheel arches stay open.
    const std::vector<std::array<int, 3>> side = {
        {17, 2, 16}, {2, 3, 16},  {3, 15, 16}, {3, 4, 15}, {4, 12, 15}, {4, 5, 12},   {5, 6, 12},
        {6, 7, 12},  {7, 11, 12}, {7, 8, 11},  {8, 9, 11}, {9, 10, 11}, {12, 13, 14}, {12, 14, 15}};
    std::vector<std::array<int, 3>> out = side;
    for (const auto& t : side) out.push_back({t[0] + kMirror, t[1] + kMirror, t[2] + kMirror});
    for (int i = kFirstBar; i <= kLastLoop; ++i) {
      const int next = i == kLastLoop ? kFirstBar : i + 1;  // the last pair closes the underside
      out.push_back({i, next, next + kMirror});
      out.push_back({i, next + kMirror, i + kMirror});
    }
    return out;
  }();
  return triangles;
}

const std::array<std::pair<int, int>, 12>& box_edges() {
  static const std::array<std::pair<int, int>, 12> edges = {{{0, 1},
                                                             {1, 2},
                                                             {2, 3},
                                                             {3, 0},
                                                             {4, 5},
                                                             {5, 6},
                                                             {6, 7},
                                                             {7, 4},
                                                             {0, 4},
                                                             {1, 5},
                                                             {2, 6},
                                                             {3, 7}}};
  return edges;
}

bool has_box(const VehicleEstimate& vehicle) {
  const Dimensions& d = vehicle.pose.dimensions;
  return vehicle.status != Status::kFailed && vehicle.status != Status::kNotRun &&
         vehicle.pose.bottom_center().allFinite() &&
         vehicle.pose.camera_from_vehicle.rotation().coeffs().allFinite() &&
         std::isfinite(d.length) && std::isfinite(d.width) && std::isfinite(d.height) &&
         d.length > 0.0 && d.width > 0.0 && d.height > 0.0;
}

bool has_wireframe(const VehicleEstimate& vehicle) {
  if (!has_box(vehicle)) return false;
  const Dimensions& d = vehicle.pose.dimensions;
  const double reach = 1.5 * Eigen::Vector3d(d.length, d.height, d.width).norm();
  const Eigen::Vector3d center = vehicle.pose.center();
  return std::all_of(
      vehicle.keypoints.begin(), vehicle.keypoints.end(),
      [&](const Eigen::Vector3d& x) { return x.allFinite() && (x - center).norm() < reach; });
}

void Occluders::add(const std::array<Eigen::Vector3d, kNumKeypoints>& keypoints) {
  Body body;
  for (const Eigen::Vector3d& x : keypoints) body.center += x / kNumKeypoints;
  for (const Eigen::Vector3d& x : keypoints) {
    body.radius = std::max(body.radius, (x - body.center).norm());
  }
  for (const auto& t : wireframe_triangles()) {
    body.triangles.push_back({keypoints[t[0]], keypoints[t[1]], keypoints[t[2]]});
  }
  bodies_.push_back(std::move(body));
}

bool Occluders::hides(const Eigen::Vector3d& point, double tolerance) const {
  const double range = point.norm();
  if (!(range > tolerance)) return false;
  const Eigen::Vector3d ray = point / range;
  const double limit = range - tolerance;
  for (const Body& body : bodies_) {
    const double along = ray.dot(body.center);
    if (along - body.radius > limit || along + body.radius < 0.0) continue;
    if ((body.center - along * ray).squaredNorm() > body.radius * body.radius) continue;
    for (const auto& t : body.triangles) {
      // Moeller and Trumbore, from the origin.
      const Eigen::Vector3d e1 = t[1] - t[0], e2 = t[2] - t[0];
      const Eigen::Vector3d p = ray.cross(e2);
      const double det = e1.dot(p);
      if (std::abs(det) < 1e-12) continue;
      const Eigen::Vector3d s = -t[0];
      const double u = s.dot(p) / det;
      if (u < 0.0 || u > 1.0) continue;
      const Eigen::Vector3d q = s.cross(e1);
      const double v = ray.dot(q) / det;
      if (v < 0.0 || u + v > 1.0) continue;
      const double distance = e2.dot(q) / det;
      if (distance > 0.0 && distance < limit) return true;
    }
  }
  return false;
}

}  // namespace camber
