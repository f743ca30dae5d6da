// The main job without a scene's folder: the scene is made here, and a callback gives each frame's
// image, as a camera driver or a decoder of one's own would. Here they are read from the files
// given.
//   07_images_in_memory samples/steep_hill/image/*.png
#include <camber/core/errors.h>
#include <camber/image/image_io.h>
#include <camber/pipeline/reconstruct.h>

#include <cstdio>
#include <vector>

int main(int argc, char** argv) try {
  std::vector<camber::Image> images;
  for (int i = 1; i < argc; ++i) images.push_back(camber::read_color_image(argv[i]));
  if (images.size() < 2)
    return std::fprintf(stderr, "usage: 07_images_in_memory IMAGE IMAGE...\n"), 2;

  camber::Scene scene;
  scene.camera = {1242, 375, 721.5377, 721.5377, 609.5593, 172.854};  // size, fx, fy, cx, cy; px
  scene.height_above_road = 1.65;  // m; without it the result is up to scale
  std::vector<int> ids;
  for (std::size_t i = 0; i < images.size(); ++i) {
    camber::SceneFrame frame;
    frame.id = static_cast<int>(i);
    scene.frames.push_back(frame);
    ids.push_back(frame.id);
  }

  camber::ReconstructOptions options;
  options.vehicles.enabled = false;  // no detections here
  options.load.pixels = [&](int id) {
    camber::FramePixels pixels;
    pixels.image = images[static_cast<std::size_t>(id)];  // 1 or 3 channels of 8 bits
    return pixels;
  };
  const auto result = camber::reconstruct(scene, ids, options);
  std::printf("%zu road points, scale known to %.1f %%\n", result.cloud.size(),
              100.0 * result.surface.scale_sigma);
} catch (const camber::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return error.exit_code();
}
