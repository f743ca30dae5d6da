#include "camber/detect/network_description.h"

#include <fmt/format.h>

#include <cmath>
#include <initializer_list>
#include <set>
#include <stdexcept>
#include <utility>

#include "camber/detect/keypoint_crop.h"

namespace camber {
namespace {

void require(bool good, const std::string& name, double value, const char* bound) {
  if (good) return;
  throw std::invalid_argument(fmt::format("{}: {}, must be {}", name, value, bound));
}

void validate_check(const NetworkCheck& check) {
  require(check.tolerance > 0.0, "check.tolerance", check.tolerance, "> 0");
}

constexpr std::pair<DetectorHead, const char*> kDetectorHeads[] = {
    {DetectorHead::kYolox, "yolox"},
    {DetectorHead::kYolov5, "yolov5"},
    {DetectorHead::kYolov8, "yolov8"},
    {DetectorHead::kFastestDet, "fastestdet"}};
constexpr std::pair<SegmenterHead, const char*> kSegmenterHeads[] = {
    {SegmenterHead::kArgmax, "argmax"}, {SegmenterHead::kPairs, "pairs"}};

template <typename Head, std::size_t N>
std::string word_of(const std::pair<Head, const char*> (&words)[N], Head head) {
  for (const auto& [value, word] : words) {
    if (value == head) return word;
  }
  throw std::logic_error("a head without a word");
}

template <typename Head, std::size_t N>
std::optional<Head> head_of(const std::pair<Head, const char*> (&words)[N],
                            const std::string& text) {
  for (const auto& [value, word] : words) {
    if (text == word) return value;
  }
  return std::nullopt;
}

}  // namespace

void NetworkInput::validate() const {
  for (const auto& [name, side] : {std::pair{"input.width", width}, {"input.height", height}}) {
    require(side >= 8 && side <= 8192, name, side, "in [8, 8192]");
  }
  require(padding >= 0 && padding <= 255, "input.padding", padding, "in [0, 255]");
  require(std::isfinite(low) && std::isfinite(high) && low != high, "input.range", high,
          "finite and not the other end");
  for (const double value : mean) require(std::isfinite(value), "input.mean", value, "finite");
  for (const double value : std) {
    require(std::isfinite(value) && value != 0.0, "input.std", value, "finite and not 0");
  }
}

std::string to_string(DetectorHead head) { return word_of(kDetectorHeads, head); }
std::optional<DetectorHead> detector_head_from_string(const std::string& word) {
  return head_of(kDetectorHeads, word);
}
std::string to_string(SegmenterHead head) { return word_of(kSegmenterHeads, head); }
std::optional<SegmenterHead> segmenter_head_from_string(const std::string& word) {
  return head_of(kSegmenterHeads, word);
}

void DetectorDescription::validate() const {
  input.validate();
  validate_check(check);
  for (const int stride : strides) {
    require(stride >= 1 && stride <= 1024, "strides", stride, "in [1, 1024]");
    if (head == DetectorHead::kYolox) {
      require(input.width % stride == 0 && input.height % stride == 0, "strides", stride,
              "a divisor of the input's width and height");
    }
  }
  require(head != DetectorHead::kYolox || !strides.empty(), "strides", 0.0, "at least one");
  const auto count = static_cast<double>(classes.size());
  require(!classes.empty() && classes.size() <= 100000, "classes", count, "in [1, 100000]");
  require(!vehicles.empty(), "vehicles", 0.0, "at least one");
  for (const auto& vehicle : vehicles) {
    const int number = vehicle.first;
    require(number >= 0 && static_cast<std::size_t>(number) < classes.size(), "vehicles", number,
            "the number of a class");
  }
  require(least_score > 0.0 && least_score < 1.0, "score", least_score, "in (0, 1)");
  require(most_overlap > 0.0 && most_overlap < 1.0, "overlap", most_overlap, "in (0, 1)");
  require(tiles.side >= 0.1 && tiles.side <= 4.0, "tiles.side", tiles.side, "in [0.1, 4]");
  require(tiles.overlap >= 0.0 && tiles.overlap <= 0.9, "tiles.overlap", tiles.overlap,
          "in [0, 0.9]");
  require(tiles.most >= 1 && tiles.most <= 1000, "tiles.most", tiles.most, "in [1, 1000]");
  if (box_sigma_px) {
    require(*box_sigma_px > 0.0 && std::isfinite(*box_sigma_px), "box_sigma_px", *box_sigma_px,
            "> 0");
  }
}

void SegmenterDescription::validate() const {
  input.validate();
  validate_check(check);
  require(!classes.road.empty(), "classes.road", 0.0, "at least one");
  std::set<int> seen;
  for (const std::vector<int>* numbers : {&classes.road, &classes.pavement, &classes.vehicle}) {
    for (const int number : *numbers) {
      require(number >= 0 && static_cast<std::size_t>(number) < names.size(), "classes", number,
              "the number of a name");
      require(seen.insert(number).second, "classes", number, "there once");
    }
  }
}

void KeypointsDescription::validate() const {
  input.validate();
  validate_check(check);
  for (const auto& [key, side] :
       {std::pair{"input.width", input.width}, std::pair{"input.height", input.height}}) {
    require(side == kKeypointCropSize || side == 2 * kKeypointCropSize, key, side, "64 or 128");
  }
  require(input.height == input.width, "input.height", input.height, "the input's width");
  require(std::isfinite(spread_weight), "spread_weight", spread_weight, "finite");
  for (const auto& [key, value] : {std::pair{"sigma_scale.visible", visible_sigma_scale},
                                   std::pair{"sigma_scale.hidden", hidden_sigma_scale}}) {
    require(std::isfinite(value) && value > 0.0, key, value, "> 0");
  }
  for (const auto& [key, value] : {std::pair{"visibility.scale", visibility_scale},
                                   std::pair{"visibility.offset", visibility_offset}}) {
    require(std::isfinite(value), key, value, "finite");
  }
}

}  // namespace camber
