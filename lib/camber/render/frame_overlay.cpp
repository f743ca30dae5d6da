#include "camber/render/frame_overlay.h"

#include <algorithm>
#include <string>

#include "camber/core/errors.h"
#include "camber/image/video.h"

namespace camber {
namespace {

/// The frame's road as a mask of 0 and 255, from its mask or its labels.
Image read_road_mask(const Scene& scene, const SceneFrame& frame, const Undistortion& lens) {
  if (!frame.road_mask.empty()) {
    return lens.labels(read_label_image(frame.road_mask, lens.raw()));
  }
  const auto road = scene.segmentation_classes.find("road");
  if (frame.segmentation.empty() || road == scene.segmentation_classes.end()) {
    throw NoAnswerError("frame " + std::to_string(frame.id) +
                        " has no road mask and no labels of roads");
  }
  Image mask = lens.labels(read_label_image(frame.segmentation, lens.raw()));
  for (std::uint8_t& value : mask.data) {
    value = std::count(road->second.begin(), road->second.end(), value) > 0 ? 255 : 0;
  }
  return mask;
}

}  // namespace

Image draw_frame_overlay(const LoadedResult& result, int id, OverlayOptions options) {
  if (!result.scene) throw NoAnswerError("there is no scene whose images could be drawn onto");
  const Scene& scene = *result.scene;
  const SceneFrame* frame = scene.find_frame(id);
  if (!frame || frame->image.empty()) {
    throw NoAnswerError("the scene has no image of frame " + std::to_string(id));
  }
  const Undistortion lens(scene.camera, scene.distortion);
  const Image photo = FrameImageReader().read(frame->image, lens).color;
  VehicleFrame none;
  const VehicleFrame* vehicles = &none;
  if (result.vehicles) {
    options.metric = result.vehicles->metric;
    options.numbers = VehicleNumbers(*result.vehicles);
    for (const VehicleFrame& candidate : result.vehicles->frames) {
      if (candidate.id == id) vehicles = &candidate;
    }
  }
  OverlayRoad road;
  Image mask;
  if (options.show_mask) {
    mask = read_road_mask(scene, *frame, lens);
    road.mask = &mask;
  }
  if (options.show_patches || options.show_normals || options.show_grade || options.show_grid) {
    if (!result.surface) throw NoAnswerError("there are no patches to draw: no surface.json");
    const RunDocument::CameraPose* pose = nullptr;
    if (result.run) {
      for (const RunDocument::CameraPose& camera : result.run->cameras) {
        if (camera.id == id) pose = &camera;
      }
    }
    if (!pose) {
      throw NoAnswerError("the camera of frame " + std::to_string(id) + " is not known");
    }
    road.surface = &*result.surface;
    road.reference_from_camera = pose->reference_from_camera;
  }
  return draw_overlay(photo, scene.camera, *vehicles, options, road);
}

}  // namespace camber
