#pragma once

#include <Eigen/Core>
#include <vector>

#include "camber/render/picture_space.h"
#include "camber/render/scene_actors.h"

class vtkCamera;

namespace camber {

/// A camera that looks at the picture frame's content; perspective or parallel.
struct SceneCamera {
  Eigen::Matrix3d axes;  // rows: right, up (of the image), along the view; picture frame
  bool parallel = false;
  double half_angle = 0.2;   // rad, vertical, perspective
  double half_height = 1.0;  // m, parallel
  Eigen::Vector3d eye = Eigen::Vector3d::Zero();
  double distance = 1.0;      // m from the eye to the content's middle
  int width = 0, height = 0;  // pixels

  /// Pixel of a point; false behind the eye.
  bool project(const Eigen::Vector3d& x, Eigen::Vector2d* pixel) const {
    const Eigen::Vector3d c = axes * (x - eye);
    double scale = 0.5 * height / half_height;
    if (!parallel) {
      if (c.z() <= 1e-6) return false;
      scale = 0.5 * height / (std::tan(half_angle) * c.z());
    }
    *pixel = {0.5 * width - 0.5 + scale * c.x(), 0.5 * height - 0.5 - scale * c.y()};
    return true;
  }

  /// Pixels a metre takes at a point.
  double pixels_per_metre(const Eigen::Vector3d& x) const {
    if (parallel) return 0.5 * height / half_height;
    const double z = (axes * (x - eye)).z();
    return 0.5 * height / (std::tan(half_angle) * std::max(z, 1e-6));
  }
};

/// Moves the eye so that all points fall into `free` (pixels of the camera's picture), as large as
/// possible, without turning it.
void fit_camera(const std::vector<Eigen::Vector3d>& points, const Box2& free, SceneCamera* camera);

/// Places that a fitted picture must hold, m, picture frame: a sample of the points, the vehicles'
/// boxes, cameras and the grid. @param side  for the side view, which has no grid.
std::vector<Eigen::Vector3d> content_corners(const PictureSpace& space, const SceneGrid& grid,
                                             bool side);

/// What the points sweep when they are turned about the vertical through their middle: fitted to
/// that, a camera keeps its distance and all of the scene in view from every side.
/// @param top  height that shall be seen too, above the points' middle, m
std::vector<Eigen::Vector3d> swept_all_around(const std::vector<Eigen::Vector3d>& points,
                                              double top);

/// Whether the side view of a map looks north, with its x axis to the right.
bool side_looks_north(const PictureSpace& space);

// Cameras of the views; width and height in pixels. The oblique and the side one still have to be
// fitted to the content.

/// @param azimuth    rad, of the direction of looking, from ahead to the right.
/// @param elevation  rad, of the eye above the content, (0, pi / 2].
SceneCamera oblique_camera(double azimuth, double elevation, int width, int height);
SceneCamera side_camera(const PictureSpace& space, int width, int height);
/// Through the shown frame's camera; the picture's narrower side sees all of the image.
/// @throws NoAnswerError if that camera is not known.
SceneCamera driver_camera(const PictureContent& content, const PictureSpace& space, int width,
                          int height);
SceneCamera free_camera(const PictureSpace& space, const FreeView& given, int width, int height);

/// Sets VTK's camera, and its depth range so that stray points do not stretch it.
void apply_camera(const SceneCamera& from, const PictureSpace& space, vtkCamera* to);

}  // namespace camber
