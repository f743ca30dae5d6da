#include "camber/pipeline/recognise_detector.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/lower_case.h"
#include "camber/core/read_file.h"
#include "camber/detect/detail/onnx_graph.h"
#include "camber/import/formats/detections.h"

namespace camber {
namespace {

using internal::OnnxGraph;
using internal::OnnxValue;

constexpr long kAnyAxis = -1;
constexpr int kUsualSide = 640;  // px, where the export leaves the size open

std::string shape_text(const std::vector<long>& shape) {
  std::vector<std::string> parts;
  for (const long size : shape) parts.push_back(size < 0 ? "N" : std::to_string(size));
  return fmt::format("({})", fmt::join(parts, ", "));
}

/// "{0: 'person', 1: 'bicycle'}", as Ultralytics' exports have it, in the order of the numbers;
/// empty where the text is no such list.
std::vector<std::string> names_of_metadata(const std::string& text) {
  std::vector<std::string> out;
  for (std::size_t at = 0; (at = text.find_first_of("'\"", at)) != std::string::npos;) {
    const std::size_t end = text.find(text[at], at + 1);
    if (end == std::string::npos) return {};
    out.push_back(text.substr(at + 1, end - at - 1));
    at = end + 1;
  }
  return out;
}

/// Cells of the grids of 8, 16 and 32 px.
long cells(int width, int height) {
  long out = 0;
  for (const int stride : {8, 16, 32}) out += static_cast<long>(width / stride) * (height / stride);
  return out;
}

struct Form {
  DetectorHead head;
  long classes;
  const char* name;
};

/// @param names  of the metadata; 0: none.
std::optional<Form> form_of(const std::vector<long>& s, int width, int height, std::size_t names) {
  if (s.size() == 4) {
    // Objectness, box and classes on a grid that is coarser than the image.
    const bool grid = s[1] > 5 && s[2] > 0 && s[3] > 0 && s[2] * 4 <= height && s[3] * 4 <= width;
    return grid ? std::optional<Form>({DetectorHead::kFastestDet, s[1] - 5, "FastestDet"})
                : std::nullopt;
  }
  if (s.size() != 3 || s[1] <= 0 || s[2] <= 0) return std::nullopt;
  const long one = cells(width, height);
  const auto classes = static_cast<long>(names);
  if (s[2] == one && s[1] > 4) return Form{DetectorHead::kYolov8, s[1] - 4, "YOLOv8 or 11"};
  if (s[1] == 3 * one && s[2] > 5) return Form{DetectorHead::kYolov5, s[2] - 5, "YOLOv5"};
  if (s[1] != one || s[2] <= 5) return std::nullopt;
  constexpr long kCoco = 80;
  if (s[2] == 4 + classes || (classes == 0 && s[2] == 4 + kCoco)) {
    return Form{DetectorHead::kYolov8, s[2] - 4, "YOLOv8 or 11"};
  }
  return Form{DetectorHead::kYolox, s[2] - 5, "YOLOX"};
}

NetworkInput input_of(DetectorHead head, int width, int height) {
  NetworkInput out;
  out.width = width;
  out.height = height;
  if (head == DetectorHead::kYolox) {
    out.align = NetworkInput::Align::kTopLeft;
    out.bgr = true;
    out.high = 255.0;
  } else if (head == DetectorHead::kFastestDet) {
    out.fit = NetworkInput::Fit::kStretch;
    out.bgr = true;
  }
  return out;
}

std::map<int, std::string> vehicles_among(const std::vector<std::string>& classes) {
  std::map<int, std::string> out;
  for (std::size_t i = 0; i < classes.size(); ++i) {
    const std::string name = lower_case(classes[i]);
    for (const char* known : {"car", "van", "truck", "bus"}) {
      if (name == known) out[static_cast<int>(i)] = known;
    }
  }
  return out;
}

}  // namespace

RecognisedDetector recognise_detector(const OnnxFile& file) {
  const OnnxGraph graph = internal::read_onnx_graph(file.bytes);
  if (graph.inputs.size() != 1 || graph.outputs.empty()) {
    return {std::nullopt, fmt::format("found {} inputs and {} outputs, which no known detector has",
                                      graph.inputs.size(), graph.outputs.size())};
  }
  const std::vector<long>& in = graph.inputs[0].shape;
  const OnnxValue& output = graph.outputs[0];
  std::string found = fmt::format("input {}, output {} {}", shape_text(in),
                                  printable(output.name, 40), shape_text(output.shape));
  const bool image = in.size() == 4 && (in[1] == 3 || in[1] == kAnyAxis);
  if (!image || graph.outputs.size() != 1) {
    if (graph.outputs.size() > 1) found += fmt::format(" and {} more", graph.outputs.size() - 1);
    return {std::nullopt, "found " + found};
  }
  const int height = in[2] > 0 ? static_cast<int>(in[2]) : kUsualSide;
  const int width = in[3] > 0 ? static_cast<int>(in[3]) : kUsualSide;
  const auto listed = graph.metadata.find("names");
  std::vector<std::string> names = listed == graph.metadata.end()
                                       ? std::vector<std::string>()
                                       : names_of_metadata(listed->second);
  const std::optional<Form> form = form_of(output.shape, width, height, names.size());
  if (!form) return {std::nullopt, "found " + found};
  constexpr long kCoco = 80;
  if (static_cast<long>(names.size()) != form->classes) {
    if (form->classes != kCoco) {
      return {std::nullopt, fmt::format("found {}, a {} of {} classes without their names", found,
                                        form->name, form->classes)};
    }
    names = coco_class_names();
  }
  DetectorDescription out;
  out.name = form->name;
  out.head = form->head;
  out.input = input_of(form->head, width, height);
  out.classes = std::move(names);
  out.vehicles = vehicles_among(out.classes);
  if (out.vehicles.empty()) {
    return {std::nullopt, fmt::format("found {}, a {} without a class car, van, truck or bus",
                                      found, form->name)};
  }
  try {
    out.validate();
  } catch (const std::invalid_argument& error) {
    return {std::nullopt, fmt::format("found {}: {}", found, error.what())};
  }
  return {out,
          fmt::format("taken for a {} of {} classes by its {}", form->name, form->classes, found)};
}

}  // namespace camber
