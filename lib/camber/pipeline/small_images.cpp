#include "camber/pipeline/small_images.h"

#include <string>
#include <utility>

#include "camber/core/errors.h"
#include "camber/pipeline/near_parallax.h"

namespace camber {

SmallImages::SmallImages(const Scene& scene, const FramePixelSource& pixels)
    : scene_(scene), pixels_(pixels), lens_(scene.camera, scene.distortion) {}

GrayImage SmallImages::read(std::size_t place) {
  const SceneFrame& frame = scene_.frames[place];
  Image held = pixels_ ? pixels_(frame.id).image : Image();
  if (held.empty() && frame.image.empty()) {
    throw NoAnswerError("frame " + std::to_string(frame.id) +
                        " has no image in the manifest; reconstruction needs images");
  }
  FrameImage image = held.empty() ? images_.read(frame.image, lens_)
                                  : make_frame_image(std::move(held), lens_, frame.id);
  return shrunk(image.gray);
}

}  // namespace camber
