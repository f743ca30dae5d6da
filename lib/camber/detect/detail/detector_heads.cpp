#include "camber/detect/detail/detector_heads.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>

#include "camber/core/errors.h"

namespace camber::internal {
namespace {

/// The values of one candidate, `stride` apart.
struct Row {
  const float* values;
  std::size_t stride;
  double operator[](std::size_t i) const { return values[i * stride]; }
};

double sigmoid(double x) { return 1.0 / (1.0 + std::exp(-x)); }

/// The vehicle class of the largest score among all classes; class_number -1: another class.
HeadBox best_class(const DetectorDescription& description, const Row& row, std::size_t first) {
  std::size_t best = 0;
  for (std::size_t c = 1; c < description.classes.size(); ++c) {
    if (row[first + c] > row[first + best]) best = c;
  }
  const auto number = static_cast<int>(best);
  HeadBox out;
  out.class_number = description.vehicles.count(number) ? number : -1;
  out.score = row[first + best];
  return out;
}

Box2 around(double cx, double cy, double width, double height) {
  return {cx - 0.5 * width, cy - 0.5 * height, cx + 0.5 * width, cy + 0.5 * height};
}

class Boxes {
 public:
  explicit Boxes(const DetectorDescription& description) : description_(description) {}

  bool wanted(const HeadBox& box) const {
    return box.class_number >= 0 && box.score >= description_.least_score;
  }
  void add(HeadBox box, const Box2& at) {
    box.box = at;
    const bool finite = std::isfinite(at.x1) && std::isfinite(at.y1) && std::isfinite(at.x2) &&
                        std::isfinite(at.y2);
    if (finite && at.width() > 0.0 && at.height() > 0.0) out_.push_back(box);
  }
  std::vector<HeadBox> take() { return std::move(out_); }

 private:
  const DetectorDescription& description_;
  std::vector<HeadBox> out_;
};

int cells_of(const DetectorDescription& d) {
  int out = 0;
  for (const int stride : d.strides) out += (d.input.width / stride) * (d.input.height / stride);
  return out;
}

std::vector<HeadBox> decode_yolox(const DetectorDescription& d, const Tensor& output) {
  const std::size_t columns = 5 + d.classes.size();
  Boxes boxes(d);
  const float* values = output.values.data();
  for (const int stride : d.strides) {
    for (int y = 0; y < d.input.height / stride; ++y) {
      for (int x = 0; x < d.input.width / stride; ++x, values += columns) {
        const Row row{values, 1};
        if (row[4] < d.least_score) continue;
        HeadBox box = best_class(d, row, 5);
        box.score *= row[4];
        if (!boxes.wanted(box)) continue;
        boxes.add(box, around((row[0] + x) * stride, (row[1] + y) * stride,
                              std::exp(row[2]) * stride, std::exp(row[3]) * stride));
      }
    }
  }
  return boxes.take();
}

std::vector<HeadBox> decode_yolov5(const DetectorDescription& d, const Tensor& output) {
  const std::size_t columns = 5 + d.classes.size();
  Boxes boxes(d);
  for (std::size_t at = 0; at + columns <= output.values.size(); at += columns) {
    const Row row{output.values.data() + at, 1};
    if (row[4] < d.least_score) continue;
    HeadBox box = best_class(d, row, 5);
    box.score *= row[4];
    if (boxes.wanted(box)) boxes.add(box, around(row[0], row[1], row[2], row[3]));
  }
  return boxes.take();
}

std::vector<HeadBox> decode_yolov8(const DetectorDescription& d, const Tensor& output) {
  const auto channels = 4 + d.classes.size();
  const bool rows_last = output.shape[1] == static_cast<int>(channels);  // (1, 4 + classes, N)
  const auto count = static_cast<std::size_t>(output.shape[rows_last ? 2 : 1]);
  Boxes boxes(d);
  for (std::size_t i = 0; i < count; ++i) {
    const Row row = rows_last ? Row{output.values.data() + i, count}
                              : Row{output.values.data() + i * channels, 1};
    const HeadBox box = best_class(d, row, 4);
    if (boxes.wanted(box)) boxes.add(box, around(row[0], row[1], row[2], row[3]));
  }
  return boxes.take();
}

/// As its authors' evaluation: the score is objectness^0.6 * class^0.4.
std::vector<HeadBox> decode_fastestdet(const DetectorDescription& d, const Tensor& output) {
  const int rows = output.shape[2], columns = output.shape[3];
  const auto plane = static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
  Boxes boxes(d);
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < columns; ++x) {
      const Row row{output.values.data() + static_cast<std::size_t>(y) * columns + x, plane};
      HeadBox box = best_class(d, row, 5);
      box.score = std::pow(row[0], 0.6) * std::pow(box.score, 0.4);
      if (!boxes.wanted(box)) continue;
      boxes.add(box, around((x + std::tanh(row[1])) * d.input.width / columns,
                            (y + std::tanh(row[2])) * d.input.height / rows,
                            sigmoid(row[3]) * d.input.width, sigmoid(row[4]) * d.input.height));
    }
  }
  return boxes.take();
}

bool fits(const std::vector<int>& shape, const std::vector<int>& expected) {
  if (shape.size() != expected.size()) return false;
  for (std::size_t i = 0; i < shape.size(); ++i) {
    if (expected[i] >= 0 ? shape[i] != expected[i] : shape[i] < 1) return false;
  }
  return true;
}

std::string shape_text(const std::vector<int>& shape) {
  std::vector<std::string> parts;
  for (const int size : shape) parts.push_back(size < 0 ? "N" : std::to_string(size));
  return fmt::format("({})", fmt::join(parts, ", "));
}

}  // namespace

std::vector<std::vector<int>> head_shapes(const DetectorDescription& d) {
  const auto classes = static_cast<int>(d.classes.size());
  switch (d.head) {
    case DetectorHead::kYolox:
      return {{1, cells_of(d), 5 + classes}};
    case DetectorHead::kYolov5:
      return {{1, -1, 5 + classes}};
    case DetectorHead::kYolov8:
      return {{1, 4 + classes, -1}, {1, -1, 4 + classes}};
    case DetectorHead::kFastestDet:
      break;
  }
  return {{1, 5 + classes, -1, -1}};
}

std::vector<HeadBox> decode_head(const DetectorDescription& d, const std::vector<Tensor>& outputs,
                                 const std::string& file) {
  const std::vector<std::vector<int>> shapes = head_shapes(d);
  bool known = false;
  for (const std::vector<int>& shape : shapes) {
    known = known || (outputs.size() == 1 && fits(outputs[0].shape, shape));
  }
  if (!known) {
    std::vector<std::string> expected;
    for (const std::vector<int>& shape : shapes) expected.push_back(shape_text(shape));
    throw InputError(file,
                     fmt::format("found {}, expected {} for head {} with {} classes at {} x {} px",
                                 describe(outputs), fmt::join(expected, " or "), to_string(d.head),
                                 d.classes.size(), d.input.width, d.input.height));
  }
  switch (d.head) {
    case DetectorHead::kYolox:
      return decode_yolox(d, outputs[0]);
    case DetectorHead::kYolov5:
      return decode_yolov5(d, outputs[0]);
    case DetectorHead::kYolov8:
      return decode_yolov8(d, outputs[0]);
    case DetectorHead::kFastestDet:
      break;
  }
  return decode_fastestdet(d, outputs[0]);
}

}  // namespace camber::internal
