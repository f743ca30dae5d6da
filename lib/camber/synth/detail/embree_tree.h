#pragma once

#include <embree3/rtcore.h>

#include <utility>

namespace camber::embree {

/// Owns a handle of Embree.
template <typename Handle, void (*kRelease)(Handle)>
class Owned {
 public:
  Owned() = default;
  explicit Owned(Handle handle) : handle_(handle) {}
  Owned(Owned&& other) noexcept : handle_(std::exchange(other.handle_, nullptr)) {}
  Owned& operator=(Owned&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }
  ~Owned() {
    if (handle_) kRelease(handle_);
  }
  Handle get() const { return handle_; }

 private:
  Handle handle_ = nullptr;
};
using Device = Owned<RTCDevice, rtcReleaseDevice>;
using Tree = Owned<RTCScene, rtcReleaseScene>;

/// Its widest instructions are held at AVX2, so that machines that have it agree.
/// @throws MachineError if Embree cannot start.
Device new_device();

/// @throws std::bad_alloc, MachineError after an error of Embree on this thread.
void check(RTCDevice device);

Tree new_tree(RTCDevice device);

/// Builds on the calling thread alone: the order of triangles in a tree then never changes.
void commit(RTCDevice device, RTCScene scene);

}  // namespace camber::embree
