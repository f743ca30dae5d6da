#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

#include "camber/synth/car_family.h"

namespace camber {

/// Triangles of one thing of a crop's scene, in single precision for speed.
struct CropMesh {
  std::vector<Eigen::Vector3f> vertices;                ///< m
  std::vector<Eigen::Vector3i> triangles;               ///< counter-clockwise from outside
  std::vector<std::array<Eigen::Vector3f, 3>> normals;  ///< unit, of each triangle's corners
  std::vector<std::uint8_t> materials;                  ///< of each triangle; meaning by owner

  /// A flat triangle of its own vertices.
  void add_triangle(const Eigen::Vector3f& a, const Eigen::Vector3f& b, const Eigen::Vector3f& c,
                    std::uint8_t material);
  /// Flat quadrilateral, counter-clockwise from outside.
  void add_quad(const std::array<Eigen::Vector3f, 4>& p, std::uint8_t material);
  /// Box with half sizes `half` along its axes (columns of `axes`, right-handed).
  void add_box(const Eigen::Vector3f& middle, const Eigen::Matrix3f& axes,
               const Eigen::Vector3f& half, std::uint8_t material);
  /// Open cone frustum with round normals.
  void add_post(const Eigen::Vector3f& foot, const Eigen::Vector3f& top, float low_radius,
                float high_radius, int sides, std::uint8_t material);
};

/// A car's triangles with normals that are smooth across edges below an angle.
/// @param sharp  cosine of the angle from which an edge stays sharp
CropMesh smooth_mesh(const TriangleMesh& mesh, float sharp);

}  // namespace camber
