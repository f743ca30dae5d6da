// The functions of the library that call OpenCV's videoio and FFmpeg, as the other plugins have
// them: see late_vtk.cpp.

#include "late_video.h"

#include "plugin.h"

namespace camber {
namespace {

const tools::VideoFunctions& video() {
  using Functions = const tools::VideoFunctions* (*)();
  static const auto* functions =
      reinterpret_cast<Functions>(tools::plugin_symbol("video", "camber_video"))();
  return *functions;
}

}  // namespace

std::unique_ptr<FilmEncoder> open_film_encoder(const std::filesystem::path& path, const char* codec,
                                               double pictures_per_second, int width, int height) {
  return video().open_film_encoder(path, codec, pictures_per_second, width, height);
}

int count_film_pictures(const std::filesystem::path& path, int enough) {
  return video().count_film_pictures(path, enough);
}

void join_film_files(const std::vector<std::filesystem::path>& parts,
                     const std::filesystem::path& out) {
  video().join_film_files(parts, out);
}

std::unique_ptr<VideoReader> open_video(const std::filesystem::path& path) {
  return video().open_video(path);
}

}  // namespace camber
