#pragma once

#include <cstdint>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/scene/scene.h"
#include "camber/synth/render_view.h"
#include "camber/synth/synth_world.h"
#include "camber/synth/view_camera.h"

namespace camber {

/// How well the simulated networks do.
struct DetectorModel {
  std::uint64_t seed = 0;
  double keypoint_error = 1.0;  ///< px of a 64 x 64 crop of the box, visible keypoints, >= 0
  double outlier_share = 0.04;  ///< of the visible keypoints, [0, 1]
  double miss_share = 0.03;     ///< of the cars; hidden ones are missed more often, [0, 1]
  double false_boxes = 0.08;    ///< mean number a frame, [0, 1]
};

/// Box around a car's whole outline, hidden parts included; may leave the image.
Box2 full_box(const SynthCar& car, int frame, const SE3& world_from_camera,
              const PinholeCamera& camera);

/// Truth of the cars in view: cars ahead of the camera whose box meets what the files show. Ids are
/// the cars' numbers; boxes are in the camera's image.
/// @param truth  of view.camera()
std::vector<TruthVehicle> true_vehicles(const SynthWorld& world, int frame, const ViewCamera& view,
                                        const ViewTruth& truth);

/// Detections of the same cars as networks would give them. A keypoint that is seen has an error of
/// about a pixel of the 64 x 64 crop, rounded to half a crop pixel; a few are gross outliers, half
/// of these the keypoint of the other side; one that is hidden is a poor guess. Confidence is
/// correlated with the error. Some cars are missed (nearly all that are hidden by more than three
/// quarters), now and then a box is false. Ids count from 0 in each frame, in random order; no
/// tracks.
std::vector<VehicleDetection> simulate_detections(const SynthWorld& world, int frame,
                                                  const ViewCamera& view,
                                                  const std::vector<TruthVehicle>& vehicles,
                                                  const DetectorModel& model);

/// Values of the simulated segmentation.
enum class SegmentationClass : std::uint8_t { kOther = 0, kRoad = 1, kPavement = 2, kVehicle = 3 };

/// A segmentation as a network gives it: the true classes with ragged edges (displaced by about a
/// pixel and a half) and a few wrong regions.
/// @param labels  TruthLabel of width * height pixels
std::vector<std::uint8_t> simulate_segmentation(const std::vector<std::uint8_t>& labels, int width,
                                                int height, std::uint64_t seed, int frame);

}  // namespace camber
