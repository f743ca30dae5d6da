#pragma once

#include <array>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace camber {

/// How an image becomes the input of a network: one tensor (1, 3, height, width).
struct NetworkInput {
  enum class Fit {
    kStretch,   ///< the image fills the input, each axis by a factor of its own
    kLetterbox  ///< one factor for both axes; the rest is `padding`
  };
  enum class Align { kTopLeft, kCenter };  ///< of the image in a letterbox

  int width = 0, height = 0;  ///< px, in [8, 8192]
  Fit fit = Fit::kLetterbox;
  Align align = Align::kCenter;
  int padding = 114;  ///< of 0 to 255, all channels
  bool bgr = false;   ///< first channel blue; else red
  /// Values that 0 and 255 become.
  double low = 0.0, high = 1.0;
  /// Taken off the values and divided by, in the order of the channels; of the same range.
  std::array<double, 3> mean = {0.0, 0.0, 0.0}, std = {1.0, 1.0, 1.0};
  void validate() const;  ///< throws std::invalid_argument
};

/// One value that the network gives for the check image (network.h), by another runtime.
struct StoredOutput {
  std::string output;      ///< name of the output; empty: the first one
  std::vector<int> index;  ///< into its shape
  double value = 0.0;
};

/// What every network's description has.
struct NetworkCheck {
  std::vector<StoredOutput> values;
  double tolerance = 0.01;  ///< absolute, > 0
};

/// The form of a detector's output.
enum class DetectorHead {
  /// (1, N, 5 + classes): centre, size, objectness, classes for each cell of each stride; scores
  /// are past their sigmoid, centres in cells from the cell's, sizes as logarithms of cells.
  kYolox,
  /// The same with centres and sizes in px of the input: YOLOv5, YOLOv7, decoded YOLOX.
  kYolov5,
  /// (1, 4 + classes, N) or its transpose: centre and size in px of the input: YOLOv8, YOLO11.
  kYolov8,
  /// (1, 5 + classes, rows, columns): objectness, offset (tanh), size (sigmoid), classes:
  /// FastestDet.
  kFastestDet
};
std::string to_string(DetectorHead head);  ///< "yolox", "yolov5", "yolov8", "fastestdet"
/// Nothing for another word.
std::optional<DetectorHead> detector_head_from_string(const std::string& word);

/// Square tiles of the image that are looked at beside the whole, for vehicles of few pixels.
struct DetectionTiles {
  bool enabled = true;
  /// Side as a share of the image's height, in [0.1, 4]. Tiles stand at the middle of its height.
  double side = 1.3;
  double overlap = 0.2;  ///< of neighbouring tiles at least, as a share of the side, in [0, 0.9]
  int most = 8;          ///< tiles, >= 1; beyond, they are made larger
};

struct DetectorDescription {
  std::string name;  ///< for people
  NetworkInput input;
  NetworkCheck check;
  DetectorHead head = DetectorHead::kYolox;
  std::vector<int> strides = {8, 16, 32};  ///< px, of kYolox
  std::vector<std::string> classes;        ///< names by number, all that the head has
  std::map<int, std::string> vehicles;     ///< class number to the class of Camber's priors
  double least_score = 0.5;                ///< in (0, 1)
  double most_overlap = 0.45;              ///< IoU of two boxes that are two vehicles, in (0, 1)
  DetectionTiles tiles;
  /// Standard deviation of a box's sides, px; nothing: the noise model's own for networks.
  std::optional<double> box_sigma_px;
  void validate() const;  ///< throws std::invalid_argument
};

/// The form of a segmenter's output.
enum class SegmenterHead {
  kArgmax,  ///< one output (1, classes, rows, columns): the class of the largest value
  kPairs    ///< an output (1, 2, rows, columns) a class: the second value above the first is yes
};
std::string to_string(SegmenterHead head);  ///< "argmax", "pairs"
std::optional<SegmenterHead> segmenter_head_from_string(const std::string& word);

/// Numbers of classes.
struct SegmenterClasses {
  std::vector<int> road, pavement, vehicle;
};

struct SegmenterDescription {
  std::string name;
  NetworkInput input;
  NetworkCheck check;
  SegmenterHead head = SegmenterHead::kArgmax;
  /// Names by number: channels (kArgmax), outputs of the network by their names (kPairs).
  std::vector<std::string> names;
  SegmenterClasses classes;  ///< road not empty; no number twice
  void validate() const;     ///< throws std::invalid_argument
};

/// A network that finds the 36 keypoints in a crop (keypoint_crop.h). Its output is
/// (N, 216, 16, 16): four cells of a heatmap of 32 x 32 (row by row) for each keypoint, then the
/// logarithm of each keypoint's standard deviation, then the logit of each one's being visible.
struct KeypointsDescription {
  std::string name;
  NetworkInput input;
  NetworkCheck check;
  /// How much of the heatmap's own spread is in the logarithm of a standard deviation.
  double spread_weight = 0.0;
  /// On the standard deviations of keypoints that are visible, or not, to the network; > 0.
  double visible_sigma_scale = 1.0, hidden_sigma_scale = 1.0;
  /// The logit of being visible is scale * output + offset.
  double visibility_scale = 1.0, visibility_offset = 0.0;
  /// The maps are the means of those of the crop and of its mirror image, at twice the time.
  bool mirrored = false;
  void validate() const;  ///< throws std::invalid_argument
};

}  // namespace camber
