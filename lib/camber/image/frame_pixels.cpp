#include "camber/image/frame_pixels.h"

#include <fmt/format.h>

#include <memory>
#include <stdexcept>
#include <utility>

namespace camber {
namespace {

void require_pixels(const Image& image, const Undistortion& lens, int frame_id, const char* name,
                    bool color) {
  const PinholeCamera& camera = lens.raw();
  const bool channels = image.channels == 1 || (color && image.channels == 3);
  if (image.width != camera.width || image.height != camera.height || !channels) {
    throw std::invalid_argument(
        fmt::format("{} of frame {}: found {} x {} pixels of {} channels, expected the camera's "
                    "{} x {} of {}",
                    name, frame_id, image.width, image.height, image.channels, camera.width,
                    camera.height, color ? "1 or 3" : "1"));
  }
  const std::size_t bytes = static_cast<std::size_t>(image.width) *
                            static_cast<std::size_t>(image.height) *
                            static_cast<std::size_t>(image.channels);
  if (image.data.size() != bytes) {
    throw std::invalid_argument(fmt::format("{} of frame {}: found {} bytes, expected {}", name,
                                            frame_id, image.data.size(), bytes));
  }
}

Image three_channels(const Image& gray) {
  Image out{gray.width, gray.height, 3, {}};
  out.data.resize(3 * gray.data.size());
  for (std::size_t i = 0; i < gray.data.size(); ++i) {
    out.data[3 * i] = out.data[3 * i + 1] = out.data[3 * i + 2] = gray.data[i];
  }
  return out;
}

}  // namespace

FramePixelSource pixels_in_memory(std::map<int, FramePixels> frames) {
  const auto held = std::make_shared<const std::map<int, FramePixels>>(std::move(frames));
  return [held](int frame_id) {
    const auto found = held->find(frame_id);
    return found == held->end() ? FramePixels() : found->second;
  };
}

FrameImage make_frame_image(Image pixels, const Undistortion& lens, int frame_id) {
  require_pixels(pixels, lens, frame_id, "image", true);
  FrameImage out;
  out.color = pixels.channels == 1 ? three_channels(pixels) : std::move(pixels);
  if (lens.needed()) out.color = lens.image(out.color);
  Image gray = to_grey(out.color);
  out.gray = {gray.width, gray.height, std::move(gray.data)};
  return out;
}

Image make_frame_labels(const Image& pixels, const Undistortion& lens, int frame_id,
                        const char* name) {
  require_pixels(pixels, lens, frame_id, name, false);
  return lens.labels(pixels);
}

}  // namespace camber
