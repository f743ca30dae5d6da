#include "camber/synth/detail/mesh_builder.h"

#include <Eigen/Geometry>
#include <cmath>

namespace camber {

namespace {
constexpr double kPi = 3.14159265358979323846;
}

Eigen::Vector3f linear_color(int red, int green, int blue) {
  const auto one = [](int c) { return std::pow(static_cast<float>(c) / 255.0f, 2.2f); };
  return {one(red), one(green), one(blue)};
}

int MeshBuilder::add_object(const SynthObject& object) {
  mesh_->objects.push_back(object);
  return static_cast<int>(mesh_->objects.size()) - 1;
}

void MeshBuilder::triangle(int object, const TrianglePoints& p,
                           const std::array<Eigen::Vector2f, 3>& uv) {
  const Eigen::Vector3d n = (p[1] - p[0]).cross(p[2] - p[0]);
  if (n.norm() < 1e-9) return;
  const Eigen::Vector3f unit = n.normalized().cast<float>();
  mesh_->triangles.push_back({p, {unit, unit, unit}, uv, object});
}

void MeshBuilder::quad(int object, const std::array<Eigen::Vector3d, 4>& p,
                       const std::array<Eigen::Vector2f, 4>& uv) {
  triangle(object, {p[0], p[1], p[2]}, {uv[0], uv[1], uv[2]});
  triangle(object, {p[0], p[2], p[3]}, {uv[0], uv[2], uv[3]});
}

void MeshBuilder::post(int object, const Eigen::Vector3d& foot, const Eigen::Vector3d& top,
                       double low_radius, double high_radius, int sides) {
  const Eigen::Vector3d axis = (top - foot).normalized();
  const Eigen::Vector3d a = axis.unitOrthogonal();
  const Eigen::Vector3d b = axis.cross(a);
  const auto height = static_cast<float>((top - foot).norm());
  for (int i = 0; i < sides; ++i) {
    const double angle[2] = {2 * kPi * i / sides, 2 * kPi * (i + 1) / sides};
    Eigen::Vector3d low[2], high[2];
    Eigen::Vector3f normal[2];
    Eigen::Vector2f texture[2];
    for (int k = 0; k < 2; ++k) {
      const Eigen::Vector3d out = std::cos(angle[k]) * a + std::sin(angle[k]) * b;
      low[k] = foot + low_radius * out;
      high[k] = top + high_radius * out;
      normal[k] = out.cast<float>();
      texture[k] = {static_cast<float>(angle[k] * low_radius), 0.0f};
    }
    const Eigen::Vector2f up(0.0f, height);
    mesh_->triangles.push_back({{low[0], low[1], high[1]},
                                {normal[0], normal[1], normal[1]},
                                {texture[0], texture[1], texture[1] + up},
                                object});
    mesh_->triangles.push_back({{low[0], high[1], high[0]},
                                {normal[0], normal[1], normal[0]},
                                {texture[0], texture[1] + up, texture[0] + up},
                                object});
  }
}

void MeshBuilder::box(int object, const Eigen::Vector3d& foot, const Eigen::Vector2d& along,
                      double length, double width, double height) {
  const Eigen::Vector3d a(0.5 * length * along.x(), 0.5 * length * along.y(), 0.0);
  const Eigen::Vector3d b(-0.5 * width * along.y(), 0.5 * width * along.x(), 0.0);
  const Eigen::Vector3d up(0, 0, height);
  const Eigen::Vector3d c[4] = {foot - a - b, foot + a - b, foot + a + b, foot - a + b};
  using Texels = std::array<Eigen::Vector2f, 4>;
  for (int i = 0; i < 4; ++i) {
    const Eigen::Vector3d& p = c[i];
    const Eigen::Vector3d& q = c[(i + 1) % 4];
    const auto w = static_cast<float>((q - p).norm());
    const auto h = static_cast<float>(height);
    quad(object, {p, q, q + up, p + up}, Texels{Eigen::Vector2f(0, 0), {w, 0}, {w, h}, {0, h}});
  }
  quad(object, {c[0] + up, c[1] + up, c[2] + up, c[3] + up},
       Texels{Eigen::Vector2f(0, 0), {1, 0}, {1, 1}, {0, 1}});
}

}  // namespace camber
