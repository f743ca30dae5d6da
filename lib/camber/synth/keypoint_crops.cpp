#include "camber/synth/keypoint_crops.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/random.h"
#include "camber/core/threads.h"
#include "camber/detect/keypoint_crop.h"
#include "camber/synth/detail/crop_labels.h"
#include "camber/synth/detail/crop_render.h"
#include "camber/synth/detail/crop_scene.h"

namespace camber {
namespace {

constexpr std::uint64_t kCarStream = 0x43415253u, kCropStream = 0x43524F50u;

/// Random numbers of a split are a stream of their own.
std::uint64_t split_seed(const KeypointCropOptions& options) {
  const std::uint64_t stream = options.split == CropSplit::kTraining ? 0x5452u : 0x5641u;
  return CounterRandom(options.seed, stream).bits(0);
}

Box2 in_crop(const KeypointCrop& square, const Box2& box) {
  const Eigen::Vector2d low = square.to_crop({box.x1, box.y1}),
                        high = square.to_crop({box.x2, box.y2});
  return {low.x(), low.y(), high.x(), high.y()};
}

/// Whether enough of the car is seen for a detector to find it.
bool is_found(const SynthCrop& crop) {
  int visible = 0, hidden = 0;
  for (const KeypointVisibility v : crop.visibility) {
    visible += v == KeypointVisibility::kVisible;
    hidden += v == KeypointVisibility::kHiddenByOther;
  }
  return visible >= 4 && hidden <= 2 * visible;
}

SynthCrop make_crop(const CropPool& pool, const CropCarTree& car, const CounterRandom& random,
                    std::int64_t number, const KeypointCropOptions& options) {
  constexpr int kAttempts = 8;
  for (int attempt = 0;; ++attempt) {
    Sequence sequence(random.bits(static_cast<std::uint64_t>(number)),
                      static_cast<std::uint64_t>(attempt));
    const auto scene = draw_crop_scene(pool, car, options.end_on, &sequence);
    const KeypointCrop square = keypoint_crop(scene->box, options.size);
    SynthCrop crop;
    label_keypoints(*scene, square, &crop);
    if (!is_found(crop) && attempt + 1 < kAttempts) continue;
    crop.box = in_crop(square, scene->box);
    crop.true_box = in_crop(square, scene->true_box);
    crop.azimuth = static_cast<double>(scene->azimuth);
    crop.elevation = static_cast<double>(scene->elevation);
    crop.distance = static_cast<double>(scene->distance);
    crop.image = render_crop(*scene, options.size);
    return crop;
  }
}

}  // namespace

std::string_view to_string(CropSplit split) {
  return split == CropSplit::kTraining ? "training" : "validation";
}

void KeypointCropOptions::validate() const {
  constexpr std::int64_t kMost = 10000000;
  if (first < 0 || first > 100 * kMost) {
    throw std::invalid_argument(fmt::format("first: {}, must be 0 to {}", first, 100 * kMost));
  }
  if (count < 1 || count > kMost) {
    throw std::invalid_argument(fmt::format("count: {}, must be 1 to {}", count, kMost));
  }
  if (size < 16 || size > 256) {
    throw std::invalid_argument(fmt::format("size: {}, must be 16 to 256", size));
  }
  if (!(end_on >= 0.0 && end_on <= 1.0)) {
    throw std::invalid_argument(fmt::format("end_on: {}, must be 0 to 1", end_on));
  }
}

struct KeypointCropMaker::Impl {
  explicit Impl(const KeypointCropOptions& given)
      : options(given),
        cars(split_seed(given), kCarStream),
        crops(split_seed(given), kCropStream),
        pool(make_crop_pool(CounterRandom(split_seed(given), kCarStream + 1), given.num_threads)) {}

  KeypointCropOptions options;
  CounterRandom cars, crops;
  CropPool pool;
};

KeypointCropMaker::KeypointCropMaker(const KeypointCropOptions& options) {
  options.validate();
  impl_ = std::make_unique<Impl>(options);
}

KeypointCropMaker::~KeypointCropMaker() = default;

std::vector<SynthCrop> KeypointCropMaker::make(std::int64_t first, std::int64_t count) const {
  const std::int64_t last = first + count;
  const std::int64_t first_car = first / kCropsPerCar;
  const std::int64_t num_cars = count > 0 ? (last - 1) / kCropsPerCar - first_car + 1 : 0;
  std::vector<SynthCrop> out(static_cast<std::size_t>(count));
  const auto body = [&](std::size_t i) {
    const std::int64_t number = first_car + static_cast<std::int64_t>(i);
    const CropCarTree car(impl_->pool.device,
                          draw_crop_car(impl_->cars, static_cast<std::uint64_t>(number)));
    const std::int64_t from = std::max(first, number * kCropsPerCar);
    const std::int64_t to = std::min(last, (number + 1) * kCropsPerCar);
    for (std::int64_t n = from; n < to; ++n) {
      SynthCrop crop = make_crop(impl_->pool, car, impl_->crops, n, impl_->options);
      crop.car =
          static_cast<int>(2 * number) + (impl_->options.split == CropSplit::kTraining ? 0 : 1);
      out[static_cast<std::size_t>(n - first)] = std::move(crop);
    }
  };
  parallel_for(static_cast<std::size_t>(num_cars), impl_->options.num_threads, body);
  return out;
}

}  // namespace camber
