#include "camber/synth/view_camera.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/core/threads.h"

namespace camber {

ViewCamera::ViewCamera(const LensDistortion& lens, int num_threads)
    : camera_(undistorted_camera(lens)), file_(lens.raw), map_(LensMap(camera_, lens)) {
  const int width = file_.width + 2, height = file_.height + 2;
  slopes_.resize(static_cast<std::size_t>(width) * height);
  parallel_for(height, num_threads, [&](std::size_t row) {
    for (int column = 0; column < width; ++column) {
      const auto pixel = map_->pinhole_from_raw({column - 1.0, static_cast<double>(row) - 1.0});
      slopes_[row * width + column] =
          pixel ? Eigen::Vector2d(camera_.ray(*pixel).head<2>())
                : Eigen::Vector2d::Constant(std::numeric_limits<double>::quiet_NaN());
    }
  });
}

Eigen::Vector3d ViewCamera::ray(const Eigen::Vector2d& pixel) const {
  if (!map_) return file_.ray(pixel);
  const int width = file_.width + 2, height = file_.height + 2;
  const double x = pixel.x() + 1.0, y = pixel.y() + 1.0;
  const int left = std::clamp(static_cast<int>(x), 0, width - 2);
  const int top = std::clamp(static_cast<int>(y), 0, height - 2);
  const double right_share = x - left, lower_share = y - top;
  const Eigen::Vector2d* upper = slopes_.data() + static_cast<std::size_t>(top) * width + left;
  const Eigen::Vector2d* lower = upper + width;
  const Eigen::Vector2d slope =
      (1.0 - lower_share) * ((1.0 - right_share) * upper[0] + right_share * upper[1]) +
      lower_share * ((1.0 - right_share) * lower[0] + right_share * lower[1]);
  return {slope.x(), slope.y(), 1.0};
}

bool ViewCamera::shows(const Eigen::Vector2d& pixel) const {
  if (!camera_.contains(pixel, -0.5)) return false;
  if (!map_) return true;
  const auto raw = map_->raw_from_pinhole(pixel);
  return raw && file_.contains(*raw, -0.5);
}

ViewCamera::Part ViewCamera::shown(const Box2& box) const {
  const double area = box.area();
  const Box2 inside = box.clipped(camera_.width, camera_.height);
  if (!(area > 0.0) || !(inside.area() > 0.0)) return {};
  if (!map_) return {inside, inside.area() / area};
  // Cells of the part inside the camera's image, each shown or not by its middle.
  constexpr int kCells = 24;
  const double cell_x = inside.width() / kCells, cell_y = inside.height() / kCells;
  int left = kCells, right = -1, top = kCells, bottom = -1, count = 0;
  for (int row = 0; row < kCells; ++row) {
    for (int column = 0; column < kCells; ++column) {
      if (!shows({inside.x1 + (column + 0.5) * cell_x, inside.y1 + (row + 0.5) * cell_y})) continue;
      ++count;
      left = std::min(left, column);
      right = std::max(right, column);
      top = std::min(top, row);
      bottom = std::max(bottom, row);
    }
  }
  if (count == 0) return {};
  return {Box2{inside.x1 + left * cell_x, inside.y1 + top * cell_y,
               inside.x1 + (right + 1) * cell_x, inside.y1 + (bottom + 1) * cell_y},
          inside.area() / area * count / (kCells * kCells)};
}

}  // namespace camber
