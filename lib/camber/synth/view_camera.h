#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "camber/geometry/box.h"
#include "camber/geometry/lens_map.h"

namespace camber {

/// What a made scene is seen with: a pinhole camera, in whose image truth and detections are, and
/// the image files, which a lens may distort.
class ViewCamera {
 public:
  /// The files are the pinhole camera's image.
  ViewCamera(const PinholeCamera& camera) : camera_(camera), file_(camera) {}
  /// The files are those of the lens, the camera is undistorted_camera(lens).
  /// @throws std::invalid_argument as LensDistortion::validate().
  ViewCamera(const LensDistortion& lens, int num_threads);

  const PinholeCamera& camera() const { return camera_; }
  /// Size of the files; without a lens their rays too.
  const PinholeCamera& file() const { return file_; }
  bool has_lens() const { return map_.has_value(); }

  /// The point with z = 1 on the viewing ray of a pixel of the files, from half a pixel outside
  /// them. Not finite where the lens's model ends. Interpolated between the centres of pixels: 1e-3
  /// px off where the lens stretches four times, less elsewhere.
  Eigen::Vector3d ray(const Eigen::Vector2d& file_pixel) const;

  /// Whether the files show what the camera sees at a pixel of its image.
  bool shows(const Eigen::Vector2d& pixel) const;

  /// What the files show of a box in the camera's image.
  struct Part {
    Box2 box;            ///< around it; empty where nothing is shown
    double share = 0.0;  ///< of the box's area
  };
  Part shown(const Box2& box) const;

 private:
  PinholeCamera camera_, file_;
  std::optional<LensMap> map_;
  /// Slopes x / z, y / z of the files' pixels from (-1, -1) to (width, height), row by row.
  std::vector<Eigen::Vector2d> slopes_;
};

}  // namespace camber
