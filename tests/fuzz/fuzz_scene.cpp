// Any bytes as a scene manifest: read and valid, or refused with an InputError.

#include "camber/core/errors.h"
#include "camber/scene/scene.h"
#include "memory_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  try {
    const camber::Scene scene = camber::read_scene(file.path());
    scene.camera.validate();
    camber::choose_reference_frame(scene, camber::select_frames(scene, ""));
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
