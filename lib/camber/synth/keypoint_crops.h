#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "camber/core/progress.h"
#include "camber/core/stopwatch.h"
#include "camber/geometry/box.h"
#include "camber/image/image.h"
#include "camber/vehicle/vehicle_estimate.h"

namespace camber {

/// Sets that share no car, no background and no crop.
enum class CropSplit { kTraining, kValidation };
std::string_view to_string(CropSplit split);  ///< "training", "validation"

/// A car of the parametric family in a made scene, as a detector's box cuts it out of an image.
struct SynthCrop {
  Image image;  ///< size x size, RGB
  /// Pixels of the crop, centres at whole numbers; may be outside.
  std::array<Eigen::Vector2d, kNumKeypoints> keypoints;
  std::array<KeypointVisibility, kNumKeypoints> visibility;
  Box2 box;                ///< as detected, px of the crop
  Box2 true_box;           ///< of the whole car, px of the crop
  double azimuth = 0.0;    ///< rad; 0 seen from the right, pi/2 from behind, pi from the left
  double elevation = 0.0;  ///< rad, of the camera above the car's ground, seen from the car
  double distance = 0.0;   ///< m
  int car = 0;             ///< number of the car; even: training, odd: validation
};

struct KeypointCropOptions {
  std::uint64_t seed = 0;
  CropSplit split = CropSplit::kTraining;
  std::int64_t first = 0;     ///< number of the first crop, >= 0: a set may be made in pieces
  std::int64_t count = 1000;  ///< crops, 1 to 10 million
  int size = 64;              ///< px, 16 to 256
  /// Share of the crops, 0 to 1, that are views of a car's front or rear (8 degrees, 1 sigma, off
  /// its axis), as a camera on the same road has them; the others are as without it.
  double end_on = 0.0;
  int num_threads = 0;    ///< <= 0: all
  void validate() const;  ///< throws std::invalid_argument
};

/// Crop after crop; each is a function of seed, split and number alone, for any number of threads.
/// The cars are those of a wider family than the prior's (detail/crop_car.h), each in
/// kCropsPerCar crops of consecutive numbers.
class KeypointCropMaker {
 public:
  static constexpr int kCropsPerCar = 4;

  explicit KeypointCropMaker(const KeypointCropOptions& options);
  ~KeypointCropMaker();
  KeypointCropMaker(const KeypointCropMaker&) = delete;
  KeypointCropMaker& operator=(const KeypointCropMaker&) = delete;

  /// Crops number first to first + count - 1.
  std::vector<SynthCrop> make(std::int64_t first, std::int64_t count) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

struct KeypointCropSummary {
  std::int64_t crops = 0, cars = 0;
  std::array<std::int64_t, 4> keypoints{};  ///< by KeypointVisibility
  Timings timings;
};

/// Writes a set of crops as arrays (docs/formats.md) into a folder, which appears whole.
/// @param overwrite  replace a folder that is not empty and no result of Camber
/// @param command    for crops.json
/// @throws OutputError, InterruptedError
KeypointCropSummary write_keypoint_crops(const KeypointCropOptions& options,
                                         const std::filesystem::path& folder, bool overwrite,
                                         const std::string& command, const Progress& progress);

/// Crops side by side, each also with its keypoints: visible ones filled, hidden ones as rings,
/// the left side red, the right side green, and the boxes.
Image draw_crop_sheet(const std::vector<SynthCrop>& crops, int columns, int scale);

}  // namespace camber
