#pragma once

#include "camber/image/video.h"
#include "camber/render/detail/film_encoder.h"

namespace camber::tools {

/// What the plugin video exports as camber_video(): the functions of the library that call OpenCV's
/// videoio and FFmpeg's libraries.
struct VideoFunctions {
  decltype(&camber::open_film_encoder) open_film_encoder;
  decltype(&camber::count_film_pictures) count_film_pictures;
  decltype(&camber::join_film_files) join_film_files;
  decltype(&camber::open_video) open_video;
};

}  // namespace camber::tools
