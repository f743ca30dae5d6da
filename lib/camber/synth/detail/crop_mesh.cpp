#include "camber/synth/detail/crop_mesh.h"

#include <Eigen/Geometry>
#include <cmath>

namespace camber {

void CropMesh::add_triangle(const Eigen::Vector3f& a, const Eigen::Vector3f& b,
                            const Eigen::Vector3f& c, std::uint8_t material) {
  const Eigen::Vector3f cross = (b - a).cross(c - a);
  const float norm = cross.norm();
  if (!(norm > 1e-9f)) return;
  const int first = static_cast<int>(vertices.size());
  vertices.insert(vertices.end(), {a, b, c});
  triangles.emplace_back(first, first + 1, first + 2);
  const Eigen::Vector3f normal = cross / norm;
  normals.push_back({normal, normal, normal});
  materials.push_back(material);
}

void CropMesh::add_quad(const std::array<Eigen::Vector3f, 4>& p, std::uint8_t material) {
  add_triangle(p[0], p[1], p[2], material);
  add_triangle(p[0], p[2], p[3], material);
}

void CropMesh::add_box(const Eigen::Vector3f& middle, const Eigen::Matrix3f& axes,
                       const Eigen::Vector3f& half, std::uint8_t material) {
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3f n = half[axis] * axes.col(axis);
    const Eigen::Vector3f a = half[(axis + 1) % 3] * axes.col((axis + 1) % 3);
    const Eigen::Vector3f b = half[(axis + 2) % 3] * axes.col((axis + 2) % 3);
    add_quad({middle + n - a - b, middle + n + a - b, middle + n + a + b, middle + n - a + b},
             material);
    add_quad({middle - n - a - b, middle - n - a + b, middle - n + a + b, middle - n + a - b},
             material);
  }
}

void CropMesh::add_post(const Eigen::Vector3f& foot, const Eigen::Vector3f& top, float low_radius,
                        float high_radius, int sides, std::uint8_t material) {
  const Eigen::Vector3f axis = (top - foot).normalized();
  const Eigen::Vector3f a = axis.unitOrthogonal();
  const Eigen::Vector3f b = axis.cross(a);
  for (int i = 0; i < sides; ++i) {
    Eigen::Vector3f out[2];
    for (int k = 0; k < 2; ++k) {
      const float angle = 6.2831853f * static_cast<float>(i + k) / static_cast<float>(sides);
      out[k] = std::cos(angle) * a + std::sin(angle) * b;
    }
    const std::size_t first = triangles.size();
    add_quad({foot + low_radius * out[0], foot + low_radius * out[1], top + high_radius * out[1],
              top + high_radius * out[0]},
             material);
    if (triangles.size() != first + 2) continue;
    normals[first] = {out[0], out[1], out[1]};
    normals[first + 1] = {out[0], out[1], out[0]};
  }
}

CropMesh smooth_mesh(const TriangleMesh& mesh, float sharp) {
  CropMesh out;
  const std::size_t count = mesh.triangles.size();
  out.vertices.reserve(mesh.vertices.size());
  for (const Eigen::Vector3d& v : mesh.vertices) out.vertices.push_back(v.cast<float>());
  // Triangles around each vertex: those of vertex v are around[begin[v]] to around[begin[v + 1]].
  std::vector<int> begin(out.vertices.size() + 1, 0);
  for (const Eigen::Vector3i& t : mesh.triangles) {
    for (int k = 0; k < 3; ++k) ++begin[t[k] + 1];
  }
  for (std::size_t v = 1; v < begin.size(); ++v) begin[v] += begin[v - 1];
  std::vector<int> around(3 * count), next(begin.begin(), begin.end() - 1);
  std::vector<Eigen::Vector3f> area(count), unit(count);
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3i& t = mesh.triangles[i];
    for (int k = 0; k < 3; ++k) around[next[t[k]]++] = static_cast<int>(i);
    const Eigen::Vector3f& a = out.vertices[t[0]];
    area[i] = (out.vertices[t[1]] - a).cross(out.vertices[t[2]] - a);
    unit[i] = area[i] / std::max(area[i].norm(), 1e-12f);
  }
  for (std::size_t i = 0; i < count; ++i) {
    if (area[i].norm() < 1e-10f) continue;
    const Eigen::Vector3i& t = mesh.triangles[i];
    std::array<Eigen::Vector3f, 3> normals;
    for (int k = 0; k < 3; ++k) {
      Eigen::Vector3f sum = Eigen::Vector3f::Zero();
      for (int j = begin[t[k]]; j < begin[t[k] + 1]; ++j) {
        if (unit[i].dot(unit[around[j]]) > sharp) sum += area[around[j]];
      }
      normals[k] = sum.normalized();
    }
    out.triangles.push_back(t);
    out.normals.push_back(normals);
    out.materials.push_back(static_cast<std::uint8_t>(mesh.materials[i]));
  }
  return out;
}

}  // namespace camber
