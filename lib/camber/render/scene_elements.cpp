#include <algorithm>
#include <cmath>

#include "camber/render/scene_actors.h"

namespace camber {

const std::vector<SceneSwitch>& scene_switches() {
  using O = ScenePictureOptions;
  static const std::vector<SceneSwitch> all = {
      {SceneElement::kGrid, "grid", "level grid", &O::show_grid},
      {SceneElement::kTruthCloud, "truth-cloud", "dense ground truth", &O::show_truth_cloud},
      {SceneElement::kPoints, "points", "road points", &O::show_points},
      {SceneElement::kVehicles, "vehicles", "vehicle wireframes", &O::show_vehicles},
      {SceneElement::kBoxes, "boxes", "vehicle boxes", &O::show_boxes},
      {SceneElement::kPlanes, "planes", "planes under vehicles", &O::show_planes},
      {SceneElement::kTruth, "truth", "true boxes", &O::show_truth},
      {SceneElement::kCameras, "cameras", "cameras and path", &O::show_cameras},
      {SceneElement::kPatches, "patches", "planar patches", &O::show_patches},
      {SceneElement::kNormals, "normals", "patch normals", &O::show_normals},
      {SceneElement::kLinks, "links", "consistency graph", &O::show_links},
  };
  return all;
}

SceneGrid make_scene_grid(const PictureSpace& space) {
  SceneGrid grid;
  const double span = std::max(space.right.span(), space.ahead.span());
  grid.x1 = space.right.low;
  grid.x2 = space.right.high;
  grid.y1 = space.ahead.low;
  grid.y2 = space.ahead.high;
  const double step = make_ticks(0.0, span, 10).step;
  grid.xs = multiples_of(step, grid.x1, grid.x2, space.origin.x());
  grid.ys = multiples_of(step, grid.y1, grid.y2, space.origin.y());
  // Just under the bulk of the points, so that the road rises from it.
  grid.z =
      std::min(space.up.low, space.heights.low) - 0.02 * std::max(space.up.span(), 0.02 * span);
  return grid;
}

Color link_color(const PlacedLink& link, const PictureSpace& space) {
  return plasma(std::abs(link.height_step) / space.link_steps.high);
}

bool ScenePictureOptions::shows(SceneElement element) const {
  return this->*scene_switches()[static_cast<std::size_t>(element)].shown;
}

}  // namespace camber
