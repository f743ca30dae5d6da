#include "camber/detect/keypoint_network.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/image/detail/single_threaded_opencv.h"
#include "camber/vehicle/shape_prior.h"

namespace camber {
namespace {

constexpr int kMapsGrid = 16;                                // cells of the output
constexpr int kMapsArea = kMapsGrid * kMapsGrid;             // along no axis
constexpr int kGrid = 2 * kMapsGrid;                         // cells of a heatmap
constexpr double kCell = kKeypointCropSize / double{kGrid};  // px
constexpr int kChannels = 6 * kNumKeypoints;
constexpr int kWindow = 3;                           // cells about the peak
constexpr double kMinLogSigma = -2.302585092994046;  // of 0.1 px
constexpr double kMaxLogSigma = 5.298317366548036;   // of 200 px
/// Images that the network takes at once: beyond, it is no faster.
constexpr std::size_t kBatch = 16;

double cell_center(int cell) { return (cell + 0.5) * kCell - 0.5; }

/// The probabilities of a heatmap's cells.
struct Heatmap {
  std::array<double, kGrid * kGrid> probability;
  int peak_column = 0, peak_row = 0;
  bool finite = true;

  /// @param maps  of the keypoint: 4 x 16 x 16, channel 2 * (row mod 2) + column mod 2.
  explicit Heatmap(const float* maps) {
    double highest = -std::numeric_limits<double>::infinity();
    for (int row = 0; row < kGrid; ++row) {
      for (int column = 0; column < kGrid; ++column) {
        const int channel = 2 * (row % 2) + column % 2;
        const double value = maps[channel * kMapsArea + row / 2 * kMapsGrid + column / 2];
        finite = finite && std::isfinite(value);
        probability[static_cast<std::size_t>(row * kGrid + column)] = value;
        if (value > highest) {
          highest = value;
          peak_row = row;
          peak_column = column;
        }
      }
    }
    double sum = 0.0;
    for (double& p : probability) sum += p = std::exp(p - highest);
    for (double& p : probability) p /= sum;
  }

  /// px^2, the mean of the two axes': two peaks far apart are a wide spread.
  double variance() const {
    double by_axis[2] = {0.0, 0.0};
    for (const bool across : {true, false}) {
      double mean = 0.0, square = 0.0;
      for (int row = 0; row < kGrid; ++row) {
        for (int column = 0; column < kGrid; ++column) {
          const double at = cell_center(across ? column : row);
          const double p = probability[static_cast<std::size_t>(row * kGrid + column)];
          mean += p * at;
          square += p * at * at;
        }
      }
      by_axis[across ? 0 : 1] = square - mean * mean;
    }
    return std::max(0.0, 0.5 * (by_axis[0] + by_axis[1]));
  }
};

/// A keypoint's mean and attributes in the window about its peak.
/// @param log_sigma, visible  16 x 16 each.
PredictedKeypoint decode(const Heatmap& heatmap, const float* log_sigma, const float* visible,
                         const KeypointsDescription& d) {
  PredictedKeypoint out;
  double mass = 0.0, sigma = 0.0, logit = 0.0;
  for (int row = std::max(0, heatmap.peak_row - kWindow);
       row <= std::min(kGrid - 1, heatmap.peak_row + kWindow); ++row) {
    for (int column = std::max(0, heatmap.peak_column - kWindow);
         column <= std::min(kGrid - 1, heatmap.peak_column + kWindow); ++column) {
      const double p = heatmap.probability[static_cast<std::size_t>(row * kGrid + column)];
      const int cell = row / 2 * kMapsGrid + column / 2;
      mass += p;
      out.at += p * Eigen::Vector2d(cell_center(column), cell_center(row));
      sigma += p * log_sigma[cell];
      logit += p * visible[cell];
    }
  }
  out.at /= mass;
  // A quarter of a pixel squared: what the cells themselves blur.
  sigma = sigma / mass + d.spread_weight * 0.5 * std::log(heatmap.variance() + 0.25);
  logit = d.visibility_scale * logit / mass + d.visibility_offset;
  out.visible = 1.0 / (1.0 + std::exp(-logit));
  out.sigma = std::exp(std::clamp(sigma, kMinLogSigma, kMaxLogSigma)) *
              (logit > 0.0 ? d.visible_sigma_scale : d.hidden_sigma_scale);
  return out;
}

/// @param values  rows of `width` numbers, which are reversed.
void reverse_rows(std::vector<float>* values, int width) {
  for (auto row = values->begin(); row != values->end(); row += width) {
    std::reverse(row, row + width);
  }
}

/// The channel of a mirrored crop's maps that is this one of the crop's.
int mirrored_channel(int channel) {
  const auto other_side = [](int keypoint) {
    return (keypoint + kNumSideKeypoints) % kNumKeypoints;
  };
  constexpr int kHeat = 4 * kNumKeypoints;
  // The lowest bit is the column in a pair of cells.
  if (channel < kHeat) return 4 * other_side(channel / 4) + (channel % 4 ^ 1);
  return channel - channel % kNumKeypoints + other_side(channel % kNumKeypoints);
}

/// The shape that a batch's output has. @throws InputError.
void require_form(const std::vector<Tensor>& outputs, std::size_t crops, const std::string& file) {
  const std::vector<int> expected = {static_cast<int>(crops), kChannels, kMapsGrid, kMapsGrid};
  if (outputs.size() == 1 && outputs[0].shape == expected) return;
  throw InputError(
      file, fmt::format("found {}, expected {} for the keypoints of {} crop{}", describe(outputs),
                        Tensor{expected, {}}.describe(), crops, crops == 1 ? "" : "s"));
}

}  // namespace

PredictedKeypoints decode_keypoints(const float* maps, const KeypointsDescription& description) {
  PredictedKeypoints out;
  for (int k = 0; k < kNumKeypoints; ++k) {
    PredictedKeypoint& keypoint = out[static_cast<std::size_t>(k)];
    const Heatmap heatmap(maps + 4 * k * kMapsArea);
    if (heatmap.finite) {
      keypoint = decode(heatmap, maps + (4 * kNumKeypoints + k) * kMapsArea,
                        maps + (5 * kNumKeypoints + k) * kMapsArea, description);
    } else {
      const double nan = std::numeric_limits<double>::quiet_NaN();
      keypoint = {Eigen::Vector2d(nan, nan), nan, nan};
    }
  }
  return out;
}

void average_with_mirrored(const float* mirrored, float* maps) {
  for (int channel = 0; channel < kChannels; ++channel) {
    const float* const other = mirrored + mirrored_channel(channel) * kMapsArea;
    float* const map = maps + channel * kMapsArea;
    for (int cell = 0; cell < kMapsArea; ++cell) {
      const int column = cell % kMapsGrid;
      map[cell] = 0.5F * (map[cell] + other[cell - column + kMapsGrid - 1 - column]);
    }
  }
}

std::vector<KeypointObservation> to_observations(const PredictedKeypoints& keypoints,
                                                 const KeypointCrop& crop) {
  std::vector<KeypointObservation> out;
  out.reserve(keypoints.size());
  for (const PredictedKeypoint& k : keypoints) {
    KeypointObservation observation;
    observation.pixel = crop.to_image(k.at);
    observation.confidence = k.visible;
    observation.sigma = k.sigma * crop.scale();
    out.push_back(observation);
  }
  return out;
}

KeypointNetwork::KeypointNetwork(OnnxFile file, const KeypointsDescription& description)
    : file_(file.name), description_(description) {
  description.validate();
  network_ = open_network(std::move(file), description.input, description.check);
  predict({check_image(description.input), check_image(description.input)}, 1);
}

std::vector<PredictedKeypoints> KeypointNetwork::predict(const std::vector<Image>& crops,
                                                         int num_threads) const {
  const NetworkInput& input = description_.input;
  for (const Image& crop : crops) {
    if (crop.width == input.width && crop.height == input.height && crop.channels == 3) continue;
    throw std::invalid_argument(
        fmt::format("a crop of {} x {} pixels and {} channels, expected {} x {} and 3", crop.width,
                    crop.height, crop.channels, input.width, input.height));
  }
  std::vector<PredictedKeypoints> out(crops.size());
  const std::size_t views = description_.mirrored ? 2 : 1;
  const std::size_t at_once = kBatch / views, batches = (crops.size() + at_once - 1) / at_once;
  const SingleThreadedOpenCv one_thread;
  parallel_for(batches, num_threads, [&](std::size_t b) {
    const std::size_t first = b * at_once, count = std::min(at_once, crops.size() - first);
    Tensor batch{{static_cast<int>(views * count), 3, input.height, input.width}, {}};
    for (std::size_t i = first; i < first + count; ++i) {
      const InputPlacement whole = place_in_input(input, {0, 0, input.width, input.height});
      Tensor one = make_input(input, crops[i], whole);
      for (std::size_t view = 0; view < views; ++view) {
        if (view > 0) reverse_rows(&one.values, input.width);
        batch.values.insert(batch.values.end(), one.values.begin(), one.values.end());
      }
    }
    std::vector<Tensor> outputs = network_->run(batch);
    require_form(outputs, views * count, file_);
    const std::size_t size = static_cast<std::size_t>(kChannels) * kMapsArea;
    for (std::size_t i = 0; i < count; ++i) {
      float* const maps = outputs[0].values.data() + views * i * size;
      if (description_.mirrored) average_with_mirrored(maps + size, maps);
      out[first + i] = decode_keypoints(maps, description_);
    }
  });
  return out;
}

}  // namespace camber
