#include "camber/render/contact_sheet.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "camber/render/canvas.h"
#include "camber/render/picture_file.h"
#include "camber/render/picture_space.h"

namespace camber {

void ContactSheetOptions::validate() const {
  check_picture_option("sheet columns", columns, 0, 1000);
  check_picture_option("sheet width", width, 64, 16384);
}

ContactSheet::ContactSheet(int count, const ContactSheetOptions& options)
    : count_(count), options_(options) {
  options.validate();
  if (count < 1) throw std::invalid_argument("contact sheet: found no pictures, expected one");
}

void ContactSheet::add(const Image& picture, const std::string& caption) {
  require_picture(picture, "contact sheet picture");
  if (added_ >= count_) throw std::invalid_argument("contact sheet: found more pictures than told");
  if (added_ == 0) {
    width_ = picture.width;
    height_ = picture.height;
    columns_ = options_.columns;
    if (columns_ == 0) {
      double best = std::numeric_limits<double>::infinity();
      for (int c = 1; c <= count_; ++c) {
        const int rows = (count_ + c - 1) / c;
        const double shape =
            static_cast<double>(c) * width_ / (static_cast<double>(rows) * height_);
        const double empty = static_cast<double>(rows * c - count_) / count_;
        const double cost = std::abs(std::log(shape / 1.5)) + empty;
        if (cost < best) {
          best = cost;
          columns_ = c;
        }
      }
    }
    columns_ = std::min(columns_, count_);
    const int rows = (count_ + columns_ - 1) / columns_;
    gap_ = std::clamp(options_.width / 200, 4, 16);
    cell_width_ = std::min(width_, (options_.width - gap_) / columns_ - gap_);
    if (cell_width_ < 16) {
      throw std::invalid_argument("contact sheet: " + std::to_string(columns_) +
                                  " columns leave no room for a picture, expected fewer");
    }
    cell_height_ = std::max(1, static_cast<int>(std::lround(1.0 * cell_width_ * height_ / width_)));
    text_size_ = std::clamp(0.045 * cell_width_, 12.0, 28.0);
    const int pitch = cell_height_ + static_cast<int>(1.5 * text_size_) + gap_;
    if (rows * pitch + gap_ > 65535) {
      throw std::invalid_argument("contact sheet: found " + std::to_string(count_) +
                                  " pictures, which need more than 65535 rows of pixels");
    }
    sheet_ = make_picture(columns_ * (cell_width_ + gap_) + gap_, rows * pitch + gap_, 255);
  }
  if (picture.width != width_ || picture.height != height_) {
    throw std::invalid_argument("contact sheet: found a picture of " +
                                std::to_string(picture.width) + " x " +
                                std::to_string(picture.height) + " pixels, expected " +
                                std::to_string(width_) + " x " + std::to_string(height_));
  }
  const int pitch = cell_height_ + static_cast<int>(1.5 * text_size_) + gap_;
  const int left = gap_ + (added_ % columns_) * (cell_width_ + gap_),
            top = gap_ + (added_ / columns_) * pitch;
  const cv::Mat from(height_, width_, CV_8UC3, const_cast<std::uint8_t*>(picture.data.data()));
  cv::Mat all(sheet_.height, sheet_.width, CV_8UC3, sheet_.data.data());
  cv::Mat place = all(cv::Rect(left, top, cell_width_, cell_height_));
  if (cell_width_ == width_) {
    from.copyTo(place);
  } else {
    cv::resize(from, place, place.size(), 0.0, 0.0, cv::INTER_AREA);
  }
  Canvas canvas(sheet_);
  double size = text_size_;
  const double needed = Canvas::text_size(caption, size).x();
  if (needed > cell_width_) size = std::max(6.0, size * cell_width_ / needed);
  canvas.text({left + 0.5 * cell_width_, top + cell_height_ + 0.8 * text_size_}, caption, size,
              kInk, TextAnchor::kCenter);
  ++added_;
}

}  // namespace camber
