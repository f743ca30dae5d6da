#include <algorithm>

#include "camber/render/canvas.h"
#include "camber/synth/keypoint_crops.h"

namespace camber {
namespace {

Box2 enlarged(const Box2& box, double scale, const Eigen::Vector2d& offset) {
  const auto at = [&](double v, double o) { return scale * (v + 0.5) - 0.5 + o; };
  return {at(box.x1, offset.x()), at(box.y1, offset.y()), at(box.x2, offset.x()),
          at(box.y2, offset.y())};
}

void draw_box(const Box2& box, const Color& color, Canvas* canvas) {
  canvas->polyline({{box.x1, box.y1}, {box.x2, box.y1}, {box.x2, box.y2}, {box.x1, box.y2}}, true,
                   1.0, color);
}

void draw_keypoints(const SynthCrop& crop, double scale, const Eigen::Vector2d& offset,
                    Canvas* canvas) {
  const Color left{235, 60, 50}, right{40, 200, 70};
  for (int k = 0; k < kNumKeypoints; ++k) {
    const Eigen::Vector2d at = (scale * (crop.keypoints[k].array() + 0.5) - 0.5).matrix() + offset;
    const double edge = scale * crop.image.width;
    const Eigen::Vector2d inside = at - offset;
    if (inside.minCoeff() < 0.0 || inside.maxCoeff() > edge - 1.0) continue;
    const Color& color = k < kNumKeypoints / 2 ? left : right;
    if (crop.visibility[k] == KeypointVisibility::kVisible) {
      canvas->disc(at, 2.6, color);
      continue;
    }
    std::vector<Eigen::Vector2d> ring;
    for (int i = 0; i < 12; ++i) {
      const double a = 2.0 * 3.14159265358979323846 * i / 12;
      ring.emplace_back(at.x() + 2.4 * std::cos(a), at.y() + 2.4 * std::sin(a));
    }
    canvas->polyline(ring, true, 1.0, color);
  }
}

}  // namespace

Image draw_crop_sheet(const std::vector<SynthCrop>& crops, int columns, int scale) {
  Image sheet;
  if (crops.empty()) return sheet;
  const int size = crops.front().image.width * scale;
  const int gap = 2;
  const int rows = (static_cast<int>(crops.size()) + columns - 1) / columns;
  const int pitch = 2 * size + 3 * gap;
  sheet = {columns * pitch, rows * (size + gap), 3, {}};
  sheet.data.assign(3 * static_cast<std::size_t>(sheet.width) * sheet.height, 255);
  for (std::size_t i = 0; i < crops.size(); ++i) {
    const Image& image = crops[i].image;
    const int x0 = static_cast<int>(i) % columns * pitch;
    const int y0 = static_cast<int>(i) / columns * (size + gap);
    for (int y = 0; y < size; ++y) {
      for (int x = 0; x < size; ++x) {
        const std::uint8_t* from = image.row(y / scale) + 3 * (x / scale);
        for (const int copy : {0, size + gap}) {
          std::copy_n(from, 3,
                      sheet.data.begin() +
                          3 * (static_cast<std::ptrdiff_t>(y0 + y) * sheet.width + x0 + copy + x));
        }
      }
    }
  }
  Canvas canvas(sheet);
  for (std::size_t i = 0; i < crops.size(); ++i) {
    const Eigen::Vector2d offset(static_cast<int>(i) % columns * pitch + size + gap,
                                 static_cast<int>(i) / columns * (size + gap));
    draw_box(enlarged(crops[i].true_box, scale, offset), {240, 220, 40, 0.6}, &canvas);
    draw_box(enlarged(crops[i].box, scale, offset), {255, 255, 255, 0.6}, &canvas);
    draw_keypoints(crops[i], scale, offset, &canvas);
  }
  return sheet;
}

}  // namespace camber
