#include "camber/detect/detector.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/detect/detail/detector_heads.h"
#include "camber/image/detail/single_threaded_opencv.h"

namespace camber {
namespace {

/// A box that lies in another one by this share is a part of the same vehicle, seen in a tile.
constexpr double kMostInside = 0.8;
/// px of the image: a box that comes so near to a tile's edge is cut there; another tile or the
/// whole image shows the vehicle.
constexpr double kTileMargin = 3.0;

double share_inside(const Box2& a, const Box2& b) {
  const Box2 common{std::max(a.x1, b.x1), std::max(a.y1, b.y1), std::min(a.x2, b.x2),
                    std::min(a.y2, b.y2)};
  if (common.width() <= 0.0 || common.height() <= 0.0) return 0.0;
  return common.area() / std::min(a.area(), b.area());
}

bool cut_by_tile(const Box2& box, const ImagePart& part, const Image& image) {
  return (part.x > 0 && box.x1 < part.x + kTileMargin) ||
         (part.y > 0 && box.y1 < part.y + kTileMargin) ||
         (part.x + part.width < image.width && box.x2 > part.x + part.width - 1 - kTileMargin) ||
         (part.y + part.height < image.height && box.y2 > part.y + part.height - 1 - kTileMargin);
}

}  // namespace

std::vector<ImagePart> detection_parts(int width, int height, const DetectionTiles& tiles) {
  std::vector<ImagePart> out = {{0, 0, width, height}};
  if (!tiles.enabled) return out;
  double side = std::max(1.0, tiles.side * height);
  const auto needed = [&] {
    return width <= side ? 1.0 : std::ceil((width - side) / (side * (1.0 - tiles.overlap))) + 1.0;
  };
  // As many tiles as are allowed cover n - (n - 1) * overlap sides.
  if (needed() > tiles.most) side = width / (tiles.most - (tiles.most - 1) * tiles.overlap);
  const int count = std::min(static_cast<int>(needed()), tiles.most);
  const int tile_width = std::min(width, static_cast<int>(std::ceil(side)));
  const int tile_height = std::min(height, static_cast<int>(std::ceil(side)));
  if (count <= 1 && tile_width == width && tile_height == height) return out;
  for (int i = 0; i < count; ++i) {
    const double at = count > 1 ? static_cast<double>(i) / (count - 1) : 0.5;
    out.push_back({static_cast<int>(std::lround(at * (width - tile_width))),
                   (height - tile_height) / 2, tile_width, tile_height});
  }
  return out;
}

std::vector<DetectedVehicle> merge_detections(std::vector<DetectedVehicle> boxes,
                                              double most_overlap) {
  std::stable_sort(
      boxes.begin(), boxes.end(),
      [](const DetectedVehicle& a, const DetectedVehicle& b) { return a.score > b.score; });
  std::vector<DetectedVehicle> out;
  for (DetectedVehicle& box : boxes) {
    const bool seen = std::any_of(out.begin(), out.end(), [&](const DetectedVehicle& other) {
      return intersection_over_union(box.box, other.box) > most_overlap ||
             share_inside(box.box, other.box) > kMostInside;
    });
    if (!seen) out.push_back(std::move(box));
  }
  return out;
}

Detector::Detector(const std::filesystem::path& path, const DetectorDescription& description)
    : Detector((description.validate(), read_onnx_file(path)), description) {}

Detector::Detector(OnnxFile file, const DetectorDescription& description)
    : file_(file.name), description_(description) {
  description.validate();
  network_ = open_network(std::move(file), description.input, description.check);
  const SingleThreadedOpenCv one_thread;
  const Image picture = check_image(description.input);
  look_at(picture, {0, 0, picture.width, picture.height});
}

std::vector<DetectedVehicle> Detector::look_at(const Image& image, const ImagePart& part) const {
  const InputPlacement at = place_in_input(description_.input, part);
  std::vector<DetectedVehicle> out;
  for (const internal::HeadBox& found : internal::decode_head(
           description_, network_->run(make_input(description_.input, image, at)), file_)) {
    const Box2 box = Box2{at.to_image_x(found.box.x1), at.to_image_y(found.box.y1),
                          at.to_image_x(found.box.x2), at.to_image_y(found.box.y2)}
                         .clipped(image.width, image.height);
    if (box.width() < 1.0 || box.height() < 1.0 || cut_by_tile(box, part, image)) continue;
    out.push_back({description_.vehicles.at(found.class_number), found.score, box});
  }
  return out;
}

std::vector<ImagePart> Detector::parts(const Image& image) const {
  if (image.channels != 3 || image.empty()) {
    throw std::invalid_argument("image: " + std::to_string(image.channels) +
                                " channels, must be 3");
  }
  return detection_parts(image.width, image.height, description_.tiles);
}

std::vector<DetectedVehicle> Detector::merge(
    const std::vector<std::vector<DetectedVehicle>>& by_part) const {
  std::vector<DetectedVehicle> all;
  for (const std::vector<DetectedVehicle>& boxes : by_part) {
    all.insert(all.end(), boxes.begin(), boxes.end());
  }
  return merge_detections(std::move(all), description_.most_overlap);
}

std::vector<DetectedVehicle> Detector::detect(const Image& image, int num_threads) const {
  const std::vector<ImagePart> seen = parts(image);
  std::vector<std::vector<DetectedVehicle>> by_part(seen.size());
  const SingleThreadedOpenCv one_thread;
  parallel_for(seen.size(), num_threads,
               [&](std::size_t i) { by_part[i] = look_at(image, seen[i]); });
  return merge(by_part);
}

}  // namespace camber
