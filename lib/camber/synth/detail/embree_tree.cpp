#include "camber/synth/detail/embree_tree.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <new>

#include "camber/core/errors.h"

namespace camber::embree {

Device new_device() {
  Device device(rtcNewDevice("max_isa=avx2"));
  if (!device.get()) throw MachineError("ray casting by Embree cannot be started");
  return device;
}

void check(RTCDevice device) {
  const RTCError error = rtcGetDeviceError(device);
  if (error == RTC_ERROR_NONE) return;
  if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
  throw MachineError(
      fmt::format("ray casting by Embree failed: its error {}", static_cast<int>(error)));
}

Tree new_tree(RTCDevice device) {
  Tree tree(rtcNewScene(device));
  rtcSetSceneFlags(tree.get(), RTC_SCENE_FLAG_ROBUST);
  return tree;
}

void commit(RTCDevice device, RTCScene scene) {
  oneapi::tbb::task_arena arena(1);
  arena.execute([&] { rtcJoinCommitScene(scene); });
  check(device);
}

}  // namespace camber::embree
