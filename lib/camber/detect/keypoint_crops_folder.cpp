#include <fmt/format.h>

#include <algorithm>

#include "camber/core/errors.h"
#include "camber/detect/detail/npy_reader.h"
#include "camber/detect/keypoint_evaluation.h"

namespace camber {

std::vector<KeypointCropTruth> read_keypoint_crops(const std::filesystem::path& folder, int size,
                                                   std::size_t most) {
  const auto side = static_cast<std::size_t>(size), num_values = side * side * 3;
  const double scale = kKeypointCropSize / static_cast<double>(size);
  const auto images = internal::read_npy_bytes(folder / "images.npy", {side, side, 3}, most);
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
    crop.crop = {size, size, 3, {pixels, pixels + static_cast<std::ptrdiff_t>(num_values)}};
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
