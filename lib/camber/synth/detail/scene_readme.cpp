#include "camber/synth/detail/scene_readme.h"

#include <fmt/format.h>

#include <vector>

namespace camber {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;

/// One sentence on the features that are on; empty if none is.
std::string features_text(const SceneFeatures& features) {
  std::vector<std::string> parts;
  if (features.corner.enabled) {
    parts.push_back(
        fmt::format("turns {} at a corner ({}, radius {:.1f} m, {:.0f} degrees a second)",
                    features.corner.turn == TurnDirection::kLeft ? "left" : "right",
                    to_string(features.corner.kind), features.corner.radius,
                    kDegrees * features.corner.yaw_rate));
  }
  if (features.bend.radius > 0.0) {
    parts.push_back(fmt::format("a bend to the {} of {:.0f} m radius",
                                features.bend.turn == TurnDirection::kLeft ? "left" : "right",
                                features.bend.radius));
  }
  if (features.lead_car.enabled) {
    parts.push_back(
        fmt::format("a car {:.1f} m ahead that keeps its distance", features.lead_car.gap));
  }
  if (features.asphalt.wetness > 0.0) {
    parts.push_back(fmt::format("wet asphalt ({:.2f})", features.asphalt.wetness));
  }
  if (features.asphalt.texture != AsphaltTexture::kVaried) {
    parts.push_back(fmt::format("`{}` asphalt", to_string(features.asphalt.texture)));
  }
  if (parts.empty()) return "";
  return fmt::format("It has: {}.\n\n", fmt::join(parts, "; "));
}

/// What a data set's layout adds; empty for Camber's own.
std::string layout_text(const DataSetLayout& layout) {
  switch (layout.layout) {
    case SceneLayout::kSynthiaSf:
      return fmt::format(
          "Laid out as SYNTHIA-SF: `SEQ{0}/RGBLeft`, `SEQ{0}/DepthLeft` (red + 256 green + 65536 "
          "blue of 2^24 - 1 are 1000 m along z), `SEQ{0}/GTLeft` (class in red{1}). "
          "`detections/SEQ{0}.txt` are the simulated boxes in KITTI's tracking form. The manifest "
          "has what the data set has not: the true vehicles and poses.\n\n",
          layout.sequence,
          layout.instance_ids ? ", number of the vehicle in green + 256 blue" : "");
    case SceneLayout::kKittiTracking:
      return fmt::format(
          "Laid out as KITTI tracking: `image_02/{0:04d}/`, `label_02/{0:04d}.txt`, "
          "`calib/{0:04d}.txt`. Labels are upright boxes: pitch and roll of the vehicles are in "
          "the manifest only. `detections_02/{0:04d}.txt` are the simulated boxes, "
          "`keypoints.json` the simulated keypoints of those that meet a true vehicle.\n\n",
          layout.sequence);
    default:
      return "";
  }
}

/// Rows of the table of files on images, segmentation, depth and labels.
std::string picture_rows(const DataSetLayout& layout) {
  std::string out = fmt::format(
      "| `{}/` | 8-bit colour images with noise, blur, vignetting and exposure changes |\n"
      "| `segmentation/` | a simulated segmentation: 0 other, 1 road, 2 pavement, 3 vehicle; "
      "ragged edges, some wrong regions |\n",
      layout.image(0).parent_path().string());
  if (layout.layout == SceneLayout::kSynthiaSf) return out;
  return out +
         "| `truth/depth/` | first and last frame: 16-bit, metres along z * 256, 0 none or beyond "
         "255.9 m |\n"
         "| `truth/label/` | true classes: 7 road, 8 pavement, kerb and parking place, 11 "
         "building, 17 post, 20 sign, 21 plants, 22 grass, 23 sky, 26 car |\n";
}

}  // namespace

std::string scene_readme(const SynthOptions& options, const Scene& scene, const SynthWorld& world) {
  std::string text = fmt::format(
      "# {}\n\nA made scene of a steep road (`{}`): {} frames at {} Hz from one camera that drives "
      "{:.3g} m/s, {} m above the road, with {} cars and complete truth. Nothing in it was "
      "photographed.\n\n",
      scene.name, to_string(options.profile), options.num_frames, options.frame_rate, world.speed,
      options.camera_height, world.cars.size());
  text += features_text(options.features);
  if (scene.distortion.model != LensModel::kNone) {
    text += fmt::format(
        "Images and segmentations are seen through a lens ({} {:g}); all else is in the manifest's "
        "camera, without it.\n\n",
        to_string(scene.distortion.model), fmt::join(scene.distortion.coefficients, " "));
  }
  if (!options.command.empty()) {
    text +=
        "Made again, on a machine of the same type bit for bit but for the times in run.json, "
        "by\n\n```\n" +
        options.command + "\n```\n\n";
  }
  text += layout_text(options.layout);
  text +=
      "| path | what |\n|---|---|\n"
      "| `scene.json` | the manifest: camera, frames, simulated detections, truth |\n" +
      picture_rows(options.layout) +
      "| `truth/road.ply` | random points on the true road (label 1) and pavements (2), first "
      "camera's frame, seen or not |\n"
      "| `run.json` | options and times |\n\n"
      "Boxes of detections are those of the whole car, clipped to the image, with an error of up "
      "to "
      "2 px; keypoints that are seen are off by about a pixel of the 64 x 64 crop of the box, some "
      "are gross outliers, hidden ones are poor guesses. `plane` of a true car is the "
      "least-squares "
      "plane of the surface between and around its wheels, `ego_plane` that under the camera.\n\n"
      "Road ahead of the first camera (station in plan; grade positive: climbs; bank positive: "
      "left "
      "side up):\n\n| station (m) | grade (deg) | bank (deg) |\n|---|---|---|\n";

  for (int station = 0; station <= 60; station += 10) {
    text += fmt::format("| {} | {:.1f} | {:.1f} |\n", station,
                        kDegrees * world.road.profile().grade(station),
                        kDegrees * world.road.profile().bank(station));
  }
  return text;
}

}  // namespace camber
