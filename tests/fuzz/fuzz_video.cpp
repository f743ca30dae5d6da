// Any bytes as a video: frames of the stated size in rising time, or an InputError.

#include "camber/core/errors.h"
#include "camber/image/video.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr int kMostFrames = 8;
  constexpr std::size_t kMostPixels = 1 << 20;
  const MemoryFile file(data, size);
  try {
    const auto video = camber::open_video(file.path());
    double last = -1.0;
    for (int i = 0; i < kMostFrames && video->next(); ++i) {
      if (video->index() != i || !(video->time_s() > last)) std::abort();
      last = video->time_s();
      const auto pixels = static_cast<std::size_t>(video->info().width) * video->info().height;
      if (pixels > kMostPixels) break;
      const camber::Image image = video->image();
      if (image.channels != 3 || image.data.size() != 3 * pixels) std::abort();
    }
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
