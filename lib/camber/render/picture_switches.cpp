#include "camber/render/picture_switches.h"

#include <fmt/format.h>

#include <stdexcept>

namespace camber {

const std::vector<PictureSwitch<OverlayOptions>>& overlay_switches() {
  static const std::vector<PictureSwitch<OverlayOptions>> kSwitches = {
      {"boxes-2d", &OverlayOptions::show_boxes_2d}, {"boxes", &OverlayOptions::show_boxes_3d},
      {"planes", &OverlayOptions::show_planes},     {"labels", &OverlayOptions::show_labels},
      {"ellipses", &OverlayOptions::show_ellipses}, {"patches", &OverlayOptions::show_patches},
      {"normals", &OverlayOptions::show_normals},   {"grade", &OverlayOptions::show_grade},
      {"grid", &OverlayOptions::show_grid},         {"mask", &OverlayOptions::show_mask}};
  return kSwitches;
}

const std::vector<PictureSwitch<BevPictureOptions>>& bev_switches() {
  static const std::vector<PictureSwitch<BevPictureOptions>> kSwitches = {
      {"points", &BevPictureOptions::show_points},
      {"truth-cloud", &BevPictureOptions::show_truth_cloud},
      {"patches", &BevPictureOptions::show_patches},
      {"links", &BevPictureOptions::show_links},
      {"vehicles", &BevPictureOptions::show_vehicles},
      {"truth", &BevPictureOptions::show_truth},
      {"cameras", &BevPictureOptions::show_cameras},
      {"ellipses", &BevPictureOptions::show_ellipses}};
  return kSwitches;
}

void refuse_part(const char* option, const std::string& name, const std::string& view,
                 const std::string& known) {
  throw std::invalid_argument(fmt::format(
      "{}: found '{}', which the view {} does not have; expected {}", option, name, view, known));
}

}  // namespace camber
