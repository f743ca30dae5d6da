#pragma once

#include <Eigen/Core>
#include <array>

#include "camber/synth/synth_mesh.h"

namespace camber {

/// Linear reflectance of an sRGB colour, 0 to 255 a channel (gamma 2.2).
Eigen::Vector3f linear_color(int red, int green, int blue);

/// Adds simple bodies to a mesh, in metres.
class MeshBuilder {
 public:
  explicit MeshBuilder(SynthMesh* mesh) : mesh_(mesh) {}

  SynthMesh& mesh() { return *mesh_; }
  /// Index of the new object.
  int add_object(const SynthObject& object);

  /// Flat triangle, counter-clockwise from outside; nothing where it is degenerate.
  void triangle(int object, const TrianglePoints& p, const std::array<Eigen::Vector2f, 3>& uv);

  /// Flat quadrilateral (counter-clockwise from outside) with its texture coordinates.
  void quad(int object, const std::array<Eigen::Vector3d, 4>& p,
            const std::array<Eigen::Vector2f, 4>& uv);

  /// Upright cylinder or cone frustum without ends.
  void post(int object, const Eigen::Vector3d& foot, const Eigen::Vector3d& top, double low_radius,
            double high_radius, int sides);

  /// Upright box without a bottom; `along` is the unit direction of its length in plan.
  void box(int object, const Eigen::Vector3d& foot, const Eigen::Vector2d& along, double length,
           double width, double height);

 private:
  SynthMesh* mesh_;
};

}  // namespace camber
