#include <fmt/format.h>

#include <algorithm>

#include "camber/core/errors.h"
#include "camber/detect/detail/npy_reader.h"
#include "camber/detect/keypoint_evaluation.h"

namespace camber {

std::vector<KeypointCropTruth> read_keypoint_crops(const std::filesystem::path& folder, int size,
                                                   std::size_t most) {
  const auto images = internal::read_npy_bytes(folder / "images.npy",
                                               {internal::kAnySide, internal::kAnySide, 3}, most);
  const int side = static_cast<int>(images.shape[1]);
  if (images.shape[2] != images.shape[1]) {
    throw InputError((folder / "images.npy").string(),
                     fmt::format("found crops of {} x {} px, expected squares", images.shape[2],
                                 images.shape[1]));
  }
  const std::size_t num_values = images.shape[1] * images.shape[2] * 3;
  const KeypointCrop whole{Eigen::Vector2d::Constant(0.5 * (side - 1)), static_cast<double>(side),
                           size};
  const double scale = kKeypointCropSize / static_cast<double>(side);
  const auto points = internal::read_npy_floats(folder / "keypoints.npy", {kNumKeypoints, 2}, most);
  const auto hidden = internal::read_npy_bytes(folder / "visibility.npy", {kNumKeypoints}, most);
  const auto boxes = internal::read_npy_floats(folder / "boxes.npy", {4}, most);
  const auto heading = internal::read_npy_floats(folder / "heading.npy", {3}, most);
  const std::size_t count = images.shape[0];
  for (const std::size_t rows :
       {points.shape[0], hidden.shape[0], boxes.shape[0], heading.shape[0]}) {
    if (rows == count) continue;
    throw InputError(folder.string(), "its arrays do not have one row a crop");
  }
  std::vector<KeypointCropTruth> out(count);
  for (std::size_t i = 0; i < count; ++i) {
    KeypointCropTruth& crop = out[i];
    const auto pixels = images.values.begin() + static_cast<std::ptrdiff_t>(i * num_values);
    crop.crop = {side, side, 3, {pixels, pixels + static_cast<std::ptrdiff_t>(num_values)}};
    crop.stored_size = side;
    if (side != size) crop.crop = cut_crop(crop.crop, whole);
    for (std::size_t k = 0; k < kNumKeypoints; ++k) {
      const std::size_t at = i * kNumKeypoints + k;
      const Eigen::Array2d point(points.values[2 * at], points.values[2 * at + 1]);
      crop.points[k] = (scale * (point + 0.5) - 0.5).matrix();
      if (hidden.values[at] > static_cast<std::uint8_t>(KeypointVisibility::kOutside)) {
        throw InputError((folder / "visibility.npy").string(),
                         fmt::format("row {}: found {}, expected 0 to 3", i, hidden.values[at]));
      }
      crop.visibility[k] = static_cast<KeypointVisibility>(hidden.values[at]);
    }
    const float* box = boxes.values.data() + 4 * i;
    crop.box_side = scale * std::max(box[2] - box[0], box[3] - box[1]);
    crop.azimuth = heading.values[3 * i];
  }
  return out;
}

}  // namespace camber
