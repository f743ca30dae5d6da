#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <mutex>
#include <numeric>
#include <opencv2/core/utils/logger.hpp>
#include <opencv2/dnn.hpp>
#include <utility>

#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/read_file.h"
#include "camber/detect/detail/onnx_weights.h"
#include "camber/detect/network.h"
#include "camber/image/detail/single_threaded_opencv.h"

namespace camber {
namespace {

/// Outputs differ if some value does by more than this share of the output's largest magnitude:
/// joined layers round otherwise (1e-6 to 1e-5 of it), a corrupted network is off by its whole
/// range.
constexpr double kFusionTolerance = 1e-3;

/// While it lives, OpenCV writes nothing about networks that it cannot load: the reason is in the
/// exception.
class QuietOpenCv {
 public:
  QuietOpenCv() : before_(cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT)) {}
  ~QuietOpenCv() { cv::utils::logging::setLogLevel(before_); }
  QuietOpenCv(const QuietOpenCv&) = delete;
  QuietOpenCv& operator=(const QuietOpenCv&) = delete;

 private:
  cv::utils::logging::LogLevel before_;
};

/// One line of an exception's text, without the place in OpenCV's sources.
std::string reason_of(const cv::Exception& error) {
  const std::string& text = error.err.empty() ? error.msg : error.err;
  return printable(text.substr(0, text.find('\n')), 160);
}

class DnnNetwork final : public Network {
 public:
  DnnNetwork(OnnxFile file, const NetworkInput& input, const NetworkCheck& check)
      : file_(std::move(file.name)),
        hash_(hash_bytes(file.bytes)),
        bytes_(half_weights_to_floats(std::move(file.bytes))) {
    const QuietOpenCv quiet;
    const SingleThreadedOpenCv one_thread;
    const Image picture = check_image(input);
    const Tensor tensor =
        make_input(input, picture, place_in_input(input, {0, 0, input.width, input.height}));
    cv::dnn::Net fused = load(true), unfused = load(false);
    const std::vector<Tensor> by_fused = forward(fused, tensor);
    const std::vector<Tensor> by_unfused = forward(unfused, tensor);
    fuse_ = agree(by_fused, by_unfused);
    const std::vector<Tensor>* outputs = fuse_ ? &by_fused : &by_unfused;
    if (const auto off = off_stored(*outputs, check)) throw InputError(file_, *off);
    layers_ = fuse_ ? "fused" : "unfused";
    idle_.push_back(std::move(fuse_ ? fused : unfused));
  }

  std::vector<Tensor> run(const Tensor& input) const override {
    cv::dnn::Net net;
    {
      const std::lock_guard<std::mutex> lock(mutex_);
      if (!idle_.empty()) {
        net = std::move(idle_.back());
        idle_.pop_back();
      }
    }
    if (net.empty()) net = load(fuse_);
    std::vector<Tensor> out = forward(net, input);
    const std::lock_guard<std::mutex> lock(mutex_);
    idle_.push_back(std::move(net));
    return out;
  }

  const std::string& hash() const override { return hash_; }
  const std::string& layers() const override { return layers_; }

 private:
  cv::dnn::Net load(bool fuse) const {
    return guarded("found no network that OpenCV can load", [&] {
      cv::dnn::Net net = cv::dnn::readNetFromONNX(bytes_.data(), bytes_.size());
      if (net.empty() || net.getUnconnectedOutLayersNames().empty()) {
        throw InputError(file_, "found no layers, expected an ONNX network");
      }
      net.setPreferableBackend(cv::dnn::DNN_BACKEND_OPENCV);
      net.setPreferableTarget(cv::dnn::DNN_TARGET_CPU);
      net.enableFusion(fuse);
      return net;
    });
  }

  std::vector<Tensor> forward(cv::dnn::Net& net, const Tensor& input) const {
    return guarded("does not take an input of " + input.describe(), [&] {
      net.setInput(cv::Mat(input.shape, CV_32F, const_cast<float*>(input.values.data())));
      std::vector<cv::String> names = net.getUnconnectedOutLayersNames();
      std::sort(names.begin(), names.end());
      std::vector<cv::Mat> blobs;
      net.forward(blobs, names);
      std::vector<Tensor> out;
      for (std::size_t i = 0; i < blobs.size(); ++i) {
        const cv::Mat& blob = blobs[i];
        if (blob.type() != CV_32F || !blob.isContinuous()) {
          throw InputError(file_, "found an output that is no array of floats");
        }
        Tensor tensor;
        tensor.name = names[i];
        tensor.shape.assign(blob.size.p, blob.size.p + blob.dims);
        tensor.values.assign(blob.ptr<float>(), blob.ptr<float>() + blob.total());
        out.push_back(std::move(tensor));
      }
      return out;
    });
  }

  /// Turns OpenCV's exceptions into a sentence about the file.
  template <typename Action>
  auto guarded(const std::string& what, const Action& action) const -> decltype(action()) {
    try {
      return action();
    } catch (const cv::Exception& error) {
      if (error.code == cv::Error::StsNoMem) throw std::bad_alloc();
      throw InputError(file_, fmt::format("{}, expected an ONNX network for its side file: {}",
                                          what, reason_of(error)));
    }
  }

  static bool agree(const std::vector<Tensor>& a, const std::vector<Tensor>& b) {
    if (a.size() != b.size()) return false;
    for (std::size_t i = 0; i < a.size(); ++i) {
      if (a[i].shape != b[i].shape) return false;
      double largest = 0.0, difference = 0.0;
      for (std::size_t k = 0; k < a[i].values.size(); ++k) {
        const double va = a[i].values[k], vb = b[i].values[k];
        if (!std::isfinite(va) || !std::isfinite(vb)) return false;
        largest = std::max(largest, std::abs(vb));
        difference = std::max(difference, std::abs(va - vb));
      }
      if (difference > kFusionTolerance * largest) return false;
    }
    return true;
  }

  /// What is wrong with the outputs by the stored values; nothing if they agree.
  static std::optional<std::string> off_stored(const std::vector<Tensor>& outputs,
                                               const NetworkCheck& check) {
    for (const StoredOutput& stored : check.values) {
      const auto named = std::find_if(outputs.begin(), outputs.end(), [&](const Tensor& output) {
        return stored.output.empty() || output.name == stored.output;
      });
      if (named == outputs.end()) {
        return fmt::format("found {}, expected the output {} of the side file's check",
                           describe(outputs), printable(stored.output));
      }
      const Tensor& output = *named;
      std::size_t at = 0;
      bool inside = stored.index.size() == output.shape.size();
      for (std::size_t d = 0; inside && d < output.shape.size(); ++d) {
        inside = stored.index[d] >= 0 && stored.index[d] < output.shape[d];
        at = at * static_cast<std::size_t>(output.shape[d]) +
             static_cast<std::size_t>(stored.index[d]);
      }
      const std::string place = fmt::format("{} at {} of output {}", stored.value,
                                            Tensor{stored.index, {}}.describe(), output.name);
      if (!inside) {
        return fmt::format("found an output {}, expected {} as the side file's check has it",
                           output.describe(), place);
      }
      if (!(std::abs(output.values[at] - stored.value) <= check.tolerance)) {
        return fmt::format(
            "OpenCV's result for the check image is {}, expected {} within {} as the side file's "
            "check has it",
            output.values[at], place, check.tolerance);
      }
    }
    return std::nullopt;
  }

  std::string file_, hash_;
  std::string bytes_;  // as OpenCV takes them
  std::string layers_;
  bool fuse_ = true;
  mutable std::mutex mutex_;
  mutable std::vector<cv::dnn::Net> idle_;  // each used by one thread at a time
};

}  // namespace

std::unique_ptr<Network> open_network(OnnxFile file, const NetworkInput& input,
                                      const NetworkCheck& check) {
  input.validate();
  return std::make_unique<DnnNetwork>(std::move(file), input, check);
}

}  // namespace camber
