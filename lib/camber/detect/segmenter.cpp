#include "camber/detect/segmenter.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/image/detail/single_threaded_opencv.h"

namespace camber {
namespace {

/// The output of a name; nullptr: none.
const Tensor* find(const std::vector<Tensor>& outputs, const std::string& name) {
  const auto at = std::find_if(outputs.begin(), outputs.end(),
                               [&](const Tensor& output) { return output.name == name; });
  return at == outputs.end() ? nullptr : &*at;
}

bool is_map(const Tensor* output, std::size_t channels) {
  return output && output->shape.size() == 4 && output->shape[0] == 1 &&
         output->shape[1] == static_cast<int>(channels) && output->shape[2] > 0 &&
         output->shape[3] > 0;
}

/// Checks the outputs' shapes. @throws InputError.
void require_form(const SegmenterDescription& d, const std::vector<Tensor>& outputs,
                  const std::string& file) {
  if (d.head == SegmenterHead::kArgmax) {
    if (outputs.size() == 1 && is_map(&outputs[0], d.names.size())) return;
    throw InputError(file, fmt::format("found {}, expected one (1, {}, rows, columns) for head {}",
                                       describe(outputs), d.names.size(), to_string(d.head)));
  }
  for (const std::string& name : d.names) {
    if (is_map(find(outputs, name), 2)) continue;
    throw InputError(file, fmt::format("found {}, expected an output {} (1, 2, rows, columns) for "
                                       "head {}",
                                       describe(outputs), printable(name), to_string(d.head)));
  }
}

/// One channel of an output at every pixel of the image.
cv::Mat at_pixels(const Tensor& output, int channel, const InputPlacement& at,
                  const NetworkInput& input) {
  const int rows = output.shape[2], columns = output.shape[3];
  const std::size_t plane = static_cast<std::size_t>(rows) * static_cast<std::size_t>(columns);
  const cv::Mat values(
      rows, columns, CV_32F,
      const_cast<float*>(output.values.data() + plane * static_cast<std::size_t>(channel)));
  // input = scale * (pixel + 1/2) + offset; output likewise by the ratio of the sizes; centres at
  // whole numbers on both sides.
  const double by_x = static_cast<double>(columns) / input.width;
  const double by_y = static_cast<double>(rows) / input.height;
  cv::Mat x(at.part.height, at.part.width, CV_32F), y(at.part.height, at.part.width, CV_32F);
  for (int v = 0; v < at.part.height; ++v) {
    const auto row = static_cast<float>(by_y * (at.scale_y * (v + 0.5) + at.offset_y) - 0.5);
    for (int u = 0; u < at.part.width; ++u) {
      x.at<float>(v, u) = static_cast<float>(by_x * (at.scale_x * (u + 0.5) + at.offset_x) - 0.5);
      y.at<float>(v, u) = row;
    }
  }
  cv::Mat out;
  cv::remap(values, out, x, y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return out;
}

struct LabelledClass {
  SegmentationLabel label;
  const std::vector<int>* numbers;
};

/// In the order of the labels' precedence where several outputs of pairs agree: a vehicle hides the
/// ground.
std::vector<LabelledClass> labelled(const SegmenterClasses& classes) {
  return {{kRoadLabel, &classes.road},
          {kPavementLabel, &classes.pavement},
          {kVehicleLabel, &classes.vehicle}};
}

Image labels_by_argmax(const SegmenterDescription& d, const Tensor& output,
                       const InputPlacement& at) {
  std::vector<std::uint8_t> label_of(d.names.size(), kOtherLabel);
  for (const LabelledClass& c : labelled(d.classes)) {
    for (const int number : *c.numbers) label_of[static_cast<std::size_t>(number)] = c.label;
  }
  Image out{at.part.width, at.part.height, 1, {}};
  const auto total = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  out.data.assign(total, label_of[0]);
  cv::Mat best = at_pixels(output, 0, at, d.input);
  for (int channel = 1; channel < output.shape[1]; ++channel) {
    const cv::Mat values = at_pixels(output, channel, at, d.input);
    auto* top = best.ptr<float>();
    const auto* now = values.ptr<float>();
    for (std::size_t i = 0; i < total; ++i) {
      if (!(now[i] > top[i])) continue;
      top[i] = now[i];
      out.data[i] = label_of[static_cast<std::size_t>(channel)];
    }
  }
  return out;
}

Image labels_by_pairs(const SegmenterDescription& d, const std::vector<Tensor>& outputs,
                      const InputPlacement& at) {
  Image out{at.part.width, at.part.height, 1, {}};
  const auto total = static_cast<std::size_t>(out.width) * static_cast<std::size_t>(out.height);
  out.data.assign(total, kOtherLabel);
  for (const LabelledClass& c : labelled(d.classes)) {
    for (const int number : *c.numbers) {
      const Tensor& output = *find(outputs, d.names[static_cast<std::size_t>(number)]);
      const cv::Mat no = at_pixels(output, 0, at, d.input), yes = at_pixels(output, 1, at, d.input);
      for (std::size_t i = 0; i < total; ++i) {
        if (yes.ptr<float>()[i] > no.ptr<float>()[i]) out.data[i] = c.label;
      }
    }
  }
  return out;
}

}  // namespace

Segmenter::Segmenter(const std::filesystem::path& path, const SegmenterDescription& description)
    : Segmenter((description.validate(), read_onnx_file(path)), description) {}

Segmenter::Segmenter(OnnxFile file, const SegmenterDescription& description)
    : file_(file.name), description_(description) {
  description.validate();
  network_ = open_network(std::move(file), description.input, description.check);
  const SingleThreadedOpenCv one_thread;
  segment(check_image(description.input));
}

Image Segmenter::segment(const Image& image) const {
  const InputPlacement at = place_in_input(description_.input, {0, 0, image.width, image.height});
  const std::vector<Tensor> outputs = network_->run(make_input(description_.input, image, at));
  require_form(description_, outputs, file_);
  return description_.head == SegmenterHead::kArgmax
             ? labels_by_argmax(description_, outputs[0], at)
             : labels_by_pairs(description_, outputs, at);
}

}  // namespace camber
