#include "camber/render/surface_map.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/interruption.h"
#include "camber/render/canvas.h"
#include "camber/render/color_map.h"
#include "camber/render/picture_file.h"
#include "camber/render/picture_space.h"
#include "camber/render/picture_switches.h"
#include "camber/scene/results.h"
#include "camber/scene/surface_tiles.h"

namespace camber {
namespace {

/// From metres in plan to pixels.
struct MapView {
  double scale = 1.0;          // pixels a metre
  Eigen::Vector2d zero{0, 0};  // pixel of (0, 0)

  Eigen::Vector2d operator()(double x, double y) const {
    return {zero.x() + scale * x, zero.y() - scale * y};
  }
};

/// Outlines in 1/16 pixels; one that is smaller than a pixel paints that one.
void fill_patches(const RoadSurface& surface, const MapView& view,
                  const std::array<double, 2>& heights, Image* image) {
  constexpr int kShift = 4;
  constexpr double kSteps = 1 << kShift, kFar = 1e5;  // pixels
  cv::Mat paper(image->height, image->width, CV_8UC3, image->data.data());
  std::vector<cv::Point> rim;
  for (const PlanePatch& patch : surface.patches) {
    rim.clear();
    for (const Eigen::Vector3d& corner : patch.boundary) {
      const Eigen::Vector2d at = view(corner.x(), corner.y()).cwiseMax(-kFar).cwiseMin(kFar);
      rim.emplace_back(static_cast<int>(std::lround(kSteps * at.x())),
                       static_cast<int>(std::lround(kSteps * at.y())));
    }
    if (rim.empty()) continue;
    const double span = std::max(heights[1] - heights[0], 1e-9);
    const Color ink = viridis((patch.plane.centroid.z() - heights[0]) / span);
    cv::fillPoly(paper, std::vector<std::vector<cv::Point>>{rim},
                 cv::Scalar(ink.red, ink.green, ink.blue), cv::LINE_8, kShift);
  }
}

}  // namespace

void SurfaceMapOptions::validate() const {
  check_picture_option("width", width, 64, 8192);
  check_picture_option("height", height, 64, 8192);
}

Image render_surface_map(const std::filesystem::path& folder, const SurfaceMapOptions& options) {
  options.validate();
  const std::vector<SurfaceTile> tiles = read_surface_tiles(folder);
  Eigen::AlignedBox2d all;
  std::array<double, 2> heights{std::numeric_limits<double>::infinity(),
                                -std::numeric_limits<double>::infinity()};
  std::size_t patches = 0;
  for (const SurfaceTile& tile : tiles) {
    all.extend(tile.bounds);
    heights[0] = std::min(heights[0], tile.heights[0]);
    heights[1] = std::max(heights[1], tile.heights[1]);
    patches += tile.patches;
  }
  if (patches == 0 || all.isEmpty())
    throw NoAnswerError(folder.string() + ": there are no patches");
  const double w = options.width, h = options.height;
  const double unit = std::max(0.5, std::min(w / 1600.0, h / 900.0)), text = 20.0 * unit;
  const auto digits = [&](double value) {
    return Canvas::text_size(format_number(value, 0), text).x();
  };
  const Box2 frame{std::max(digits(all.min().y()), digits(all.max().y())) + 2.6 * text, 3.8 * text,
                   w - 10.5 * text, h - 3.3 * text};
  const Eigen::Vector2d extent = all.sizes().cwiseMax(1e-3), middle = all.center();
  MapView view;
  view.scale = std::min(std::max(frame.width() - 2.0 * text, 1.0) / extent.x(),
                        std::max(frame.height() - 2.0 * text, 1.0) / extent.y());
  view.zero = {frame.center().x() - view.scale * middle.x(),
               frame.center().y() + view.scale * middle.y()};
  Image image = make_picture(options.width, options.height, 255);
  for (const SurfaceTile& tile : tiles) {
    throw_if_interrupted();
    fill_patches(read_surface(tile.file), view, heights, &image);
  }
  Canvas canvas(image);
  canvas.polyline(
      {{frame.x1, frame.y1}, {frame.x2, frame.y1}, {frame.x2, frame.y2}, {frame.x1, frame.y2}},
      true, std::max(1.0, unit), kFaintInk);
  const double columns = frame.width() / std::max(5.0 * text, 2.0 * digits(all.max().x()));
  const double west = (frame.x1 - view.zero.x()) / view.scale,
               east = (frame.x2 - view.zero.x()) / view.scale;
  const Ticks xs = make_ticks(west, east, std::max(2, static_cast<int>(columns)));
  for (std::size_t i = 0; i < xs.values.size(); ++i) {
    const double x = view(xs.values[i], 0.0).x();
    canvas.segments({{{x, frame.y2}, {x, frame.y2 + 0.3 * text}}}, unit, kInk);
    canvas.text({x, frame.y2 + 0.95 * text}, xs.labels[i], text, kInk, TextAnchor::kCenter);
  }
  const Ticks ys = multiples_of(xs.step, (view.zero.y() - frame.y2) / view.scale,
                                (view.zero.y() - frame.y1) / view.scale);
  for (std::size_t i = 0; i < ys.values.size(); ++i) {
    const double y = view(0.0, ys.values[i]).y();
    canvas.segments({{{frame.x1 - 0.3 * text, y}, {frame.x1, y}}}, unit, kInk);
    canvas.text({frame.x1 - 0.5 * text, y}, ys.labels[i], text, kInk, TextAnchor::kRight);
  }
  canvas.text({frame.center().x(), frame.y2 + 2.1 * text}, "x (m)", text, kInk,
              TextAnchor::kCenter);
  canvas.text_upwards({1.2 * text, frame.center().y()}, "y (m)", text, kInk);
  if (!options.title.empty()) {
    canvas.text({text, 1.1 * text}, options.title, 1.25 * text, kInk, TextAnchor::kLeft, true);
  }
  canvas.text({text, 2.6 * text},
              fmt::format("{} patches in {} {}", patches, tiles.size(),
                          tiles.size() == 1 ? "tile" : "tiles"),
              text, kFaintInk);
  const double left = w - 9.2 * text;
  draw_color_bar(canvas, {left, frame.y1 + 1.2 * text, left + 1.2 * text, frame.y2}, heights[0],
                 heights[1], {"height (m)"}, text, kInk);
  return image;
}

}  // namespace camber
