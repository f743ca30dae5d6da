#include "camber/render/detail/film_encoder.h"

#include <opencv2/core/utils/logger.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/videoio.hpp>

namespace camber {
namespace {

/// OpenCV prints the encoders that it lacks on stderr; the callers report what failed.
class QuietOpenCv {
 public:
  QuietOpenCv() : before_(cv::utils::logging::getLogLevel()) {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
  }
  ~QuietOpenCv() { cv::utils::logging::setLogLevel(before_); }

 private:
  cv::utils::logging::LogLevel before_;
};

class OpenCvEncoder : public FilmEncoder {
 public:
  OpenCvEncoder(const std::filesystem::path& path, const char* c, double rate, int width,
                int height)
      : size_(width, height),
        writer_(path.string(), cv::VideoWriter::fourcc(c[0], c[1], c[2], c[3]), rate, size_) {}

  bool is_open() const { return writer_.isOpened(); }

  void write(const std::uint8_t* pixels) override {
    const cv::Mat rgb(size_, CV_8UC3, const_cast<std::uint8_t*>(pixels));
    cv::cvtColor(rgb, bgr_, cv::COLOR_RGB2BGR);
    writer_.write(bgr_);
  }

 private:
  cv::Size size_;
  cv::VideoWriter writer_;
  cv::Mat bgr_;
};

}  // namespace

std::unique_ptr<FilmEncoder> open_film_encoder(const std::filesystem::path& path, const char* codec,
                                               double pictures_per_second, int width, int height) {
  const QuietOpenCv quiet;
  auto encoder = std::make_unique<OpenCvEncoder>(path, codec, pictures_per_second, width, height);
  if (!encoder->is_open()) return nullptr;
  return encoder;
}

int count_film_pictures(const std::filesystem::path& path, int enough) {
  const QuietOpenCv quiet;
  cv::VideoCapture reader(path.string());
  int found = 0;
  while (found < enough && reader.grab()) ++found;
  return found;
}

}  // namespace camber
