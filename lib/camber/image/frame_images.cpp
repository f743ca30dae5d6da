#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/image/video.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

FrameImage of_color(Image image, const fs::path& path, const PinholeCamera& camera) {
  if (image.width != camera.width || image.height != camera.height) {
    throw InputError(path.string(),
                     fmt::format("found an image of {} x {} pixels, expected the camera's {} x {}",
                                 image.width, image.height, camera.width, camera.height));
  }
  FrameImage out;
  Image gray = to_grey(image);
  out.gray = {gray.width, gray.height, std::move(gray.data)};
  out.color = std::move(image);
  return out;
}

}  // namespace

FrameImageReader::FrameImageReader() = default;
FrameImageReader::~FrameImageReader() = default;

FrameImage FrameImageReader::read(const fs::path& path, const PinholeCamera& camera) {
  const auto name = video_frame_name(path);
  if (!name) return read_frame_image(path, camera);
  if (!video_ || file_ != name->file || video_->index() > name->index) {
    video_ = open_video(name->file);
    file_ = name->file;
  }
  while (video_->index() < name->index) {
    if (video_->next()) continue;
    const int count = video_->index() + 1;
    video_.reset();
    throw InputError(
        path.string(),
        fmt::format("found {} whole frames in the video, expected a frame {}", count, name->index));
  }
  return of_color(video_->image(), path, camera);
}

FrameImage FrameImageReader::read(const fs::path& path, const Undistortion& lens) {
  FrameImage out = read(path, lens.raw());
  if (!lens.needed()) return out;
  out.color = lens.image(out.color);
  Image gray = to_grey(out.color);
  out.gray = {gray.width, gray.height, std::move(gray.data)};
  return out;
}

std::vector<FrameImage> read_frame_images(const std::vector<fs::path>& paths,
                                          const Undistortion& lens, int num_threads) {
  std::vector<FrameImage> out(paths.size());
  std::map<fs::path, std::vector<std::size_t>> videos;
  std::vector<std::size_t> files;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    const auto name = video_frame_name(paths[i]);
    if (name) {
      videos[name->file].push_back(i);
    } else {
      files.push_back(i);
    }
  }
  std::vector<std::vector<std::size_t>> jobs;
  for (auto& [file, wanted] : videos) {
    std::sort(wanted.begin(), wanted.end(), [&](std::size_t a, std::size_t b) {
      return video_frame_name(paths[a])->index < video_frame_name(paths[b])->index;
    });
    jobs.push_back(std::move(wanted));
  }
  for (const std::size_t i : files) jobs.push_back({i});
  parallel_for(jobs.size(), num_threads, [&](std::size_t j) {
    FrameImageReader reader;
    for (const std::size_t i : jobs[j]) out[i] = reader.read(paths[i], lens);
  });
  return out;
}

VideoScan scan_video(const fs::path& path) {
  const auto video = open_video(path);
  VideoScan out;
  while (video->next()) out.times.push_back(video->time_s());
  out.info = video->info();
  out.damaged = video->damaged();
  if (out.times.empty()) {
    throw InputError(path.string(), "found no whole frame, expected a video of at least one");
  }
  return out;
}

}  // namespace camber
