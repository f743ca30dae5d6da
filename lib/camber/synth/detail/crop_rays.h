#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "camber/synth/detail/crop_mesh.h"
#include "camber/synth/detail/embree_tree.h"

namespace camber {

/// Embree's tree over one mesh, which any number of scenes may place. Immutable.
class MeshTree {
 public:
  /// @param casts_shadow  false: only rays of view meet it
  MeshTree(const embree::Device& device, const CropMesh& mesh, bool casts_shadow);
  RTCScene scene() const { return tree_.get(); }

 private:
  embree::Tree tree_;
};

/// Where a mesh stands.
struct MeshPlace {
  const CropMesh* mesh = nullptr;
  const MeshTree* tree = nullptr;
  Eigen::Matrix3f rotation = Eigen::Matrix3f::Identity();  ///< world from mesh
  Eigen::Vector3f origin = Eigen::Vector3f::Zero();        ///< in the world, m
};

/// Rays against placed meshes. Both sides of a triangle count.
class CropRays {
 public:
  struct Hit {
    float distance = 0.0f;  ///< in lengths of the direction
    int place = -1;         ///< index; -1: nothing
    int triangle = -1;      ///< of that mesh
  };

  CropRays(const embree::Device& device, const std::vector<MeshPlace>& places);

  /// The nearest hits of `count` rays.
  /// @param origins  one for all, or one a ray if `own_origins`
  void nearest(const Eigen::Vector3f* origins, bool own_origins, const Eigen::Vector3f* directions,
               std::size_t count, Hit* hits) const;
  /// Whether something that casts shadows lies on each of `count` rays.
  void shaded(const Eigen::Vector3f* origins, const Eigen::Vector3f* directions, std::size_t count,
              std::uint8_t* out) const;
  /// Whether one place (or, with -1, any) meets the ray before `farthest` lengths of direction.
  bool blocked(int place, const Eigen::Vector3f& origin, const Eigen::Vector3f& direction,
               float farthest) const;

 private:
  std::vector<MeshPlace> places_;
  embree::Tree tree_;
};

}  // namespace camber
