#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/read_file.h"
#include "camber/image/video.h"
#include "camber/import/detail/own_data.h"
#include "camber/import/film_telemetry.h"
#include "camber/import/import_own.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// "1920 x 1080 pixels, H.264, 300 frames, 30 a second", and what is odd about it.
void describe(const VideoScan& scan, OwnImport& out) {
  const VideoInfo& info = scan.info;
  const std::size_t count = scan.times.size();
  const double span = scan.times.back();
  std::string phrase = fmt::format("video of {} whole frames, {}", count, printable(info.codec));
  if (count > 1) {
    const double rate = static_cast<double>(count - 1) / span;
    double shortest = span, longest = 0.0;
    for (std::size_t i = 1; i < count; ++i) {
      shortest = std::min(shortest, scan.times[i] - scan.times[i - 1]);
      longest = std::max(longest, scan.times[i] - scan.times[i - 1]);
    }
    phrase += fmt::format(", {:.2f} s, {:.4g} a second", span, rate);
    // Time stamps are rounded to a millisecond in some containers.
    if (longest - shortest > 0.0025) {
      phrase += fmt::format(" of a variable rate ({:.0f} to {:.0f} ms apart)", 1e3 * shortest,
                            1e3 * longest);
    }
  }
  out.found.push_back(phrase);
  if (info.rotation_deg != 0) {
    out.found.push_back(fmt::format(
        "turned by {} degrees clockwise, as the file asks: a calibration must be of the "
        "turned picture",
        info.rotation_deg));
  }
  if (scan.damaged > 0) {
    out.missing.push_back(
        fmt::format("{} damaged frames or pieces of the video, left out", scan.damaged));
  }
  const auto lacks = info.stated_frames - static_cast<long>(count);
  if (info.stated_frames > 0 && lacks > 0) {
    out.missing.push_back(
        fmt::format("frames {} to {}: the video's header counts {} frames, {} are there and whole",
                    count, info.stated_frames - 1, info.stated_frames, count));
  } else if (info.stated_frames == 0 && count > 1 &&
             info.duration_s > span + 0.5 + 3.0 * span / static_cast<double>(count - 1)) {
    out.missing.push_back(fmt::format(
        "the part from {:.2f} s on: the video's header states {:.2f} s", span, info.duration_s));
  }
}

}  // namespace

void VideoChoice::validate() const {
  if (every < 1) throw std::invalid_argument(fmt::format("every {}, expected at least 1", every));
  for (const std::optional<double>& value : {from, to}) {
    if (value && !(*value >= 0.0 && std::isfinite(*value))) {
      throw std::invalid_argument(
          fmt::format("a time of {} s in the video, expected at least 0", *value));
    }
  }
  if (from && to && *from > *to) {
    throw std::invalid_argument(fmt::format("from {} to {} s, expected from <= to", *from, *to));
  }
}

OwnImport import_video(const fs::path& video, const VideoChoice& choice,
                       const OwnDataOptions& options, const fs::path& manifest) {
  options.validate();
  choice.validate();
  const VideoScan scan = scan_video(video);
  OwnImport out;
  out.ids_of_recording = true;
  Scene& scene = out.scene;
  describe(scan, out);
  scene.name = options.name.empty() ? video.stem().string() : options.name;
  int taken = 0;
  for (std::size_t i = 0; i < scan.times.size(); ++i) {
    if ((choice.from && scan.times[i] < *choice.from) || (choice.to && scan.times[i] > *choice.to))
      continue;
    if (taken++ % choice.every != 0) continue;
    SceneFrame frame;
    frame.id = static_cast<int>(i);
    frame.time_s = scan.times[i];
    frame.image = video.string() + "#" + std::to_string(i);
    scene.frames.push_back(std::move(frame));
  }
  if (scene.frames.empty()) {
    throw InputError(
        video.string(),
        fmt::format("found frames from 0 to {:.3f} s, expected some in the part that was asked for",
                    scan.times.back()));
  }
  if (scan.times.size() > 1 && scan.times.back() > 0.0) {
    scene.frame_rate = static_cast<double>(scan.times.size() - 1) / scan.times.back();
  }
  scene.camera.width = scan.info.width;
  scene.camera.height = scan.info.height;
  put_camera(scene, options.camera, out);
  put_film_telemetry(video, scan.info.rotation_deg == 0, options, out);
  finish_import(options, out);
  if (choice.extract) {
    const fs::path folder =
        (manifest.has_parent_path() ? manifest.parent_path() : fs::path(".")) / "image";
    for (SceneFrame& frame : scene.frames) {
      const fs::path file = folder / fmt::format("{:06}.png", frame.id);
      out.extractions.emplace_back(frame.image, file);
      frame.image = file;
    }
    out.found.push_back(fmt::format("{} frames written to {}", scene.frames.size(),
                                    printable(folder.string(), 120)));
  }
  return out;
}

}  // namespace camber
