#include "camber/render/film.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <opencv2/core.hpp>
#include <stdexcept>

#include "camber/core/atomic_file.h"
#include "camber/core/errors.h"
#include "camber/render/detail/film_encoder.h"
#include "camber/render/picture_file.h"

namespace camber {

namespace fs = std::filesystem;

namespace {

struct Codec {
  const char* name;
  const char* letters;
};

/// Why a file takes no further byte, as on a full disk; empty: it does. The encoder is silent.
std::string why_not_longer(const fs::path& path) {
  std::error_code error;
  std::uintmax_t size = fs::file_size(path, error);
  if (error) size = 0;  // an encoder that could not begin has removed it
  errno = 0;
  std::ofstream file(path, std::ios::binary | std::ios::app);
  file << '\0' << std::flush;
  const std::string reason = file ? "" : std::strerror(errno);
  file.close();
  fs::resize_file(path, size, error);
  return reason;
}

}  // namespace

struct FilmWriter::Impl {
  fs::path path, temporary;  // of the same extension: OpenCV chooses the container by it
  AtomicFiles files;
  double rate = 10.0;
  int width = 0, height = 0, count = 0;
  std::string codec;
  std::unique_ptr<FilmEncoder> encoder;
  cv::Mat frame;  // red, green, blue
};

bool FilmWriter::knows(const std::string& extension) {
  return extension == ".mp4" || extension == ".avi";
}

FilmWriter::FilmWriter(const fs::path& path, double pictures_per_second)
    : impl_(std::make_unique<Impl>()) {
  if (!knows(path.extension().string())) {
    throw std::invalid_argument("film: found '" + path.extension().string() +
                                "', expected .mp4 or .avi");
  }
  if (!(pictures_per_second > 0.0 && pictures_per_second <= 240.0)) {
    throw std::invalid_argument("film: found " + std::to_string(pictures_per_second) +
                                " pictures a second, expected above 0 and at most 240");
  }
  impl_->path = path;
  impl_->rate = pictures_per_second;
  impl_->temporary = impl_->files.stage(path);
}

FilmWriter::~FilmWriter() {
  impl_->encoder.reset();  // before its file goes
}

const std::string& FilmWriter::codec() const { return impl_->codec; }

void FilmWriter::add(const Image& picture) {
  require_picture(picture, "film picture");
  Impl& film = *impl_;
  if (film.count == 0) {
    film.width = picture.width;
    film.height = picture.height;
    const cv::Size size(film.width + film.width % 2, film.height + film.height % 2);
    film.frame = cv::Mat(size, CV_8UC3, cv::Scalar::all(255));
    const bool mp4 = film.path.extension() == ".mp4";
    const Codec mp4_codecs[] = {{"H.264", "avc1"}, {"MPEG-4", "mp4v"}};
    const Codec avi_codecs[] = {{"Motion JPEG", "MJPG"}, {"Motion JPEG", "MJPG"}};
    for (const Codec& codec : mp4 ? mp4_codecs : avi_codecs) {
      film.encoder =
          open_film_encoder(film.temporary, codec.letters, film.rate, size.width, size.height);
      if (film.encoder) {
        film.codec = codec.name;
        break;
      }
    }
    if (!film.encoder) {
      const std::string reason = why_not_longer(film.temporary);
      if (!reason.empty()) throw OutputError(film.path.string(), "writing failed: " + reason);
      throw MachineError(film.path.string() + ": OpenCV has no encoder for " +
                         film.path.extension().string() + " films of " +
                         std::to_string(size.width) + " x " + std::to_string(size.height) +
                         " pixels here");
    }
  }
  if (picture.width != film.width || picture.height != film.height) {
    throw std::invalid_argument(
        "film picture " + std::to_string(film.count) + ": found " + std::to_string(picture.width) +
        " x " + std::to_string(picture.height) + " pixels, expected " + std::to_string(film.width) +
        " x " + std::to_string(film.height) + " as the first");
  }
  const cv::Mat rgb(picture.height, picture.width, CV_8UC3,
                    const_cast<std::uint8_t*>(picture.data.data()));
  cv::Mat inside = film.frame(cv::Rect(0, 0, film.width, film.height));
  rgb.copyTo(inside);
  film.encoder->write(film.frame.data);
  ++film.count;
}

void FilmWriter::finish() {
  Impl& film = *impl_;
  if (film.count == 0) throw std::invalid_argument("film: found no picture, expected one");
  film.encoder.reset();
  const std::string reason = why_not_longer(film.temporary);
  if (!reason.empty()) throw OutputError(film.path.string(), "writing failed: " + reason);
  const int found = count_film_pictures(film.temporary, film.count + 1);
  if (found != film.count) {
    throw OutputError(film.path.string(), "the film was not written whole: found " +
                                              std::to_string(found) + " pictures, expected " +
                                              std::to_string(film.count));
  }
  film.files.commit();
}

void join_films(const std::vector<fs::path>& parts, const fs::path& path) {
  AtomicFiles files;
  join_film_files(parts, files.stage(path));
  files.commit();
}

}  // namespace camber
