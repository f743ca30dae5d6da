#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "camber/synth/synth_world.h"

namespace camber {

/// Rays against the triangles of a scene, by Embree. Which triangle a ray meets is found in single
/// precision; the distance to its plane is for the caller to compute in double precision. Both
/// sides of a triangle count. Immutable after construction: any number of threads may cast rays,
/// and the answers do not depend on their number (trees are built by one thread; Embree's widest
/// instructions are held at AVX2, so that machines that have it agree).
class RayCaster {
 public:
  struct Hit {
    float distance = 0.0f;  ///< in lengths of the direction
    int car = -1;           ///< -1: ground or thing
    int triangle = -1;      ///< -1: none
  };

  /// @throws MachineError if Embree cannot start or has no memory.
  RayCaster(const SynthMesh& ground_and_things, std::size_t num_ground,
            const std::vector<SynthCar>& cars, int num_frames);
  ~RayCaster();
  RayCaster(const RayCaster&) = delete;
  RayCaster& operator=(const RayCaster&) = delete;

  /// The nearest hits of `count` rays (world).
  /// @param origins  one for all, or one a ray if `own_origins`
  void nearest(int frame, const Eigen::Vector3d* origins, bool own_origins,
               const Eigen::Vector3d* directions, std::size_t count, Hit* hits) const;

  /// Whether anything that rises above the ground (things and cars, not the ground itself) lies
  /// within `farthest` on each of `count` rays.
  void shaded(int frame, const Eigen::Vector3d* origins, const Eigen::Vector3d* directions,
              std::size_t count, double farthest, std::uint8_t* out) const;

  /// Whether a ray (world) meets one car.
  bool meets_car(int frame, int car, const Eigen::Vector3d& origin,
                 const Eigen::Vector3d& direction) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
