// Any bytes as the small files beside a person's images: class maps, class names, times of frames,
// and as the names of frames of videos and of files that carry times.

#include "camber/image/video.h"
#include "camber/import/formats/class_map.h"
#include "camber/import/formats/detections.h"
#include "camber/import/formats/frame_files.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read_or_refuse([&] { camber::read_class_map(file.path()); });
  read_or_refuse([&] { camber::read_class_names(file.path()); });
  read_or_refuse([&] { camber::read_key_values(file.path()); });
  read_or_refuse([&] { camber::read_frame_times(file.path()); });
  const std::string text(reinterpret_cast<const char*>(data), size);
  if (text.find('\0') == std::string::npos) {
    camber::video_frame_name(text);
    camber::time_from_name(text);
    camber::parse_date_time(text);
    const std::string half = text.substr(0, size / 2);
    if (camber::natural_less(text, half) && camber::natural_less(half, text)) __builtin_trap();
  }
  return 0;
}
