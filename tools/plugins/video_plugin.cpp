#include "late_video.h"
#include "plugin.h"

CAMBER_EXPORT const camber::tools::VideoFunctions* camber_video();
CAMBER_EXPORT const camber::tools::VideoFunctions* camber_video() {
  static const camber::tools::VideoFunctions functions = {
      camber::open_film_encoder, camber::count_film_pictures, camber::join_film_files,
      camber::open_video};
  return &functions;
}
