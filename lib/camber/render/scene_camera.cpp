#include "camber/render/scene_camera.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "camber/core/errors.h"

namespace camber {

// With a fixed direction each side of the frustum bounds the eye linearly.
void fit_camera(const std::vector<Eigen::Vector3d>& points, const Box2& free, SceneCamera* view) {
  const double w = view->width, h = view->height;
  // Tangents of the free area's sides, or half heights per unit in a parallel view.
  const double t = view->parallel ? 1.0 : std::tan(view->half_angle);
  const double left = (0.5 * w - free.x1) * 2.0 * t / h, right = (free.x2 - 0.5 * w) * 2.0 * t / h;
  const double top = (0.5 * h - free.y1) * 2.0 * t / h, bottom = (free.y2 - 0.5 * h) * 2.0 * t / h;
  constexpr double kInf = std::numeric_limits<double>::infinity();
  double min_x = kInf, max_x = -kInf, min_y = kInf, max_y = -kInf, min_z = kInf, max_z = -kInf;
  for (const Eigen::Vector3d& x : points) {
    const Eigen::Vector3d c = view->axes * x;
    const double z = view->parallel ? 0.0 : c.z();
    // A point is inside if -left (z + D) <= x - ex <= right (z + D), likewise y.
    min_x = std::min(min_x, c.x() + left * z);
    max_x = std::max(max_x, c.x() - right * z);
    min_y = std::min(min_y, c.y() + bottom * z);
    max_y = std::max(max_y, c.y() - top * z);
    min_z = std::min(min_z, c.z());
    max_z = std::max(max_z, c.z());
  }
  // D: how far the eye stands before z = 0 (perspective), or the half height (parallel).
  const double from_x = (max_x - min_x) / std::max(left + right, 1e-9);
  const double from_y = (max_y - min_y) / std::max(top + bottom, 1e-9);
  double d = std::max({from_x, from_y, 1e-3});
  if (!view->parallel) d = std::max(d, 0.5 - min_z);
  const double ex = 0.5 * ((min_x + left * d) + (max_x - right * d));
  const double ey = 0.5 * ((min_y + bottom * d) + (max_y - top * d));
  double ez = -d;
  if (view->parallel) {
    view->half_height = d;
    ez = min_z - 0.5 * (max_z - min_z) - 10.0;
  }
  view->eye = view->axes.transpose() * Eigen::Vector3d(ex, ey, ez);
  view->distance = 0.5 * (min_z + max_z) - ez;
}

bool side_looks_north(const PictureSpace& space) {
  return space.map && space.right.span() > space.ahead.span();
}

std::vector<Eigen::Vector3d> content_corners(const PictureSpace& space, const SceneGrid& grid,
                                             bool side) {
  std::vector<Eigen::Vector3d> points;
  const auto inside = [&](const Eigen::Vector3d& x) {
    return x.x() >= space.right.low && x.x() <= space.right.high && x.y() >= space.ahead.low &&
           x.y() <= space.ahead.high && x.z() >= space.up.low && x.z() <= space.up.high;
  };
  for (const auto* cloud : {&space.points, &space.truth_points}) {
    const std::size_t stride = std::max<std::size_t>(1, cloud->size() / 20000);
    for (std::size_t i = 0; i < cloud->size(); i += stride) {
      points.emplace_back((*cloud)[i].cast<double>());
    }
  }
  for (const auto* list : {&space.vehicles, &space.truth}) {
    for (const PlacedVehicle& vehicle : *list) {
      if (!inside(vehicle.box.center())) continue;
      const auto corners = vehicle.box.corners();
      for (int i = 0; i < 8; ++i) points.emplace_back(corners.col(i));
    }
  }
  for (const PlacedPatch& patch : space.patches) {
    if (inside(patch.middle)) {
      points.insert(points.end(), patch.boundary.begin(), patch.boundary.end());
    }
  }
  for (const SE3& camera : space.cameras) {
    if (inside(camera.translation())) points.push_back(camera.translation());
  }
  const double middle_x = 0.5 * (grid.x1 + grid.x2), middle_y = 0.5 * (grid.y1 + grid.y2);
  if (!side) {
    for (const double x : {grid.x1, grid.x2}) {
      for (const double y : {grid.y1, grid.y2}) points.emplace_back(x, y, grid.z);
    }
  } else if (side_looks_north(space)) {
    for (const double x : {grid.x1, grid.x2}) points.emplace_back(x, middle_y, grid.z);
  } else {
    for (const double y : {grid.y1, grid.y2}) points.emplace_back(middle_x, y, grid.z);
  }
  return points;
}

std::vector<Eigen::Vector3d> swept_all_around(const std::vector<Eigen::Vector3d>& points,
                                              double top) {
  if (points.empty()) return {};
  Eigen::Vector3d low = points[0], high = points[0];
  for (const Eigen::Vector3d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  const Eigen::Vector2d middle = 0.5 * (low + high).head<2>();
  high.z() = std::max(high.z(), top);
  // The largest radius in each of some layers, at the heights of both ends of the layer.
  constexpr int kLayers = 16, kDirections = 72;
  const double thickness = std::max((high.z() - low.z()) / kLayers, 1e-9);
  std::array<double, kLayers> radius{};
  for (const Eigen::Vector3d& p : points) {
    const int layer = std::clamp(static_cast<int>((p.z() - low.z()) / thickness), 0, kLayers - 1);
    double& largest = radius[static_cast<std::size_t>(layer)];
    largest = std::max(largest, (p.head<2>() - middle).norm());
  }
  std::vector<Eigen::Vector3d> out;
  for (int layer = 0; layer < kLayers; ++layer) {
    const double r = radius[static_cast<std::size_t>(layer)];
    for (int k = 0; k < kDirections; ++k) {
      const double angle = 2.0 * M_PI * k / kDirections;
      for (const int end : {layer, layer + 1}) {
        out.emplace_back(middle.x() + r * std::cos(angle), middle.y() + r * std::sin(angle),
                         low.z() + end * thickness);
      }
    }
  }
  return out;
}

SceneCamera oblique_camera(double azimuth, double elevation, int width, int height) {
  SceneCamera view;
  view.width = width;
  view.height = height;
  view.half_angle = 0.5 * 24.0 * M_PI / 180.0;
  const double ca = std::cos(azimuth), sa = std::sin(azimuth);
  const double ce = std::cos(elevation), se = std::sin(elevation);
  const Eigen::Vector3d along(ce * sa, ce * ca, -se);
  const Eigen::Vector3d right = along.cross(Eigen::Vector3d::UnitZ()).normalized();
  view.axes.row(0) = right;
  view.axes.row(1) = right.cross(along);
  view.axes.row(2) = along;
  return view;
}

SceneCamera driver_camera(const PictureContent& content, const PictureSpace& space, int width,
                          int height) {
  if (space.current_camera < 0 || !content.camera) {
    throw NoAnswerError("the driver's view needs the camera of frame " +
                        std::to_string(content.frame) + ", which is not known");
  }
  const PinholeCamera& camera = *content.camera;
  const SE3& pose = space.cameras[static_cast<std::size_t>(space.current_camera)];
  SceneCamera view;
  view.width = width;
  view.height = height;
  const Eigen::Matrix3d rotation = pose.rotation_matrix();
  view.axes.row(0) = rotation.col(0);
  view.axes.row(1) = -rotation.col(1);
  view.axes.row(2) = rotation.col(2);
  view.eye = pose.translation();
  const double by_width = 0.5 * camera.width / camera.fx * height / width;
  const double by_height = 0.5 * camera.height / camera.fy;
  view.half_angle = std::atan(std::max(by_width, by_height));
  view.distance = 0.5 * std::max(1.0, space.ahead.span());
  return view;
}

SceneCamera free_camera(const PictureSpace& space, const FreeView& given, int width, int height) {
  const SE3& placed = space.picture_from_reference;
  const Eigen::Matrix3d rotation = placed.rotation_matrix();
  SceneCamera view;
  view.width = width;
  view.height = height;
  view.eye = placed * given.eye;
  const Eigen::Vector3d along = rotation * (given.target - given.eye);
  const Eigen::Vector3d right = along.cross(rotation * given.up);
  view.distance = along.norm();
  view.axes.row(2) = along.normalized();
  view.axes.row(0) = right.normalized();
  view.axes.row(1) = right.cross(along).normalized();
  view.half_angle = 0.5 * given.field_of_view;
  return view;
}

SceneCamera side_camera(const PictureSpace& space, int width, int height) {
  SceneCamera view;
  view.width = width;
  view.height = height;
  view.parallel = true;
  view.axes.row(1) = Eigen::Vector3d::UnitZ();
  if (side_looks_north(space)) {
    view.axes.row(0) = Eigen::Vector3d::UnitX();
    view.axes.row(2) = Eigen::Vector3d::UnitY();
  } else {
    view.axes.row(0) = Eigen::Vector3d::UnitY();   // ahead points right
    view.axes.row(2) = -Eigen::Vector3d::UnitX();  // seen from the right
  }
  return view;
}

}  // namespace camber
