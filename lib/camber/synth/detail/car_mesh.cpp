#include "camber/synth/detail/car_mesh.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <array>
#include <cmath>
#include <map>
#include <vector>

#include "camber/synth/detail/mesh_builder.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kDegree = kPi / 180.0;

SurfaceKind surface_of(CarMaterial material) {
  switch (material) {
    case CarMaterial::kPaint:
      return SurfaceKind::kCarPaint;
    case CarMaterial::kGlass:
      return SurfaceKind::kCarGlass;
    case CarMaterial::kTyre:
      return SurfaceKind::kCarTyre;
    case CarMaterial::kLight:
      return SurfaceKind::kCarLight;
    case CarMaterial::kPlate:
      return SurfaceKind::kCarPlate;
    case CarMaterial::kTrim:
      return SurfaceKind::kCarTrim;
    case CarMaterial::kRim:
      break;
  }
  return SurfaceKind::kCarRim;
}

}  // namespace

Eigen::Vector3f draw_car_paint(Sequence* random) {
  // Silver, white, black and grey are half of all cars.
  static const Eigen::Vector3f kPaints[] = {
      linear_color(178, 182, 186), linear_color(226, 226, 222), linear_color(30, 31, 34),
      linear_color(92, 96, 100),   linear_color(150, 152, 150), linear_color(34, 58, 110),
      linear_color(132, 22, 24),   linear_color(58, 88, 124),   linear_color(60, 82, 66),
      linear_color(178, 160, 124), linear_color(96, 26, 34),    linear_color(200, 196, 180)};
  return kPaints[random->below(12)];
}

SynthMesh make_car_mesh(const CarModel& model, const Eigen::Vector3f& paint, std::uint32_t seed) {
  SynthMesh mesh;
  for (int m = 0; m < kNumCarMaterials; ++m) {
    SynthObject object;
    object.kind = surface_of(static_cast<CarMaterial>(m));
    object.label = TruthLabel::kCar;
    object.color = paint;
    object.seed = seed;
    object.extent = {
        static_cast<float>(model.dimensions.length), static_cast<float>(model.dimensions.width),
        static_cast<float>(model.dimensions.height), static_cast<float>(model.wheel_radius)};
    mesh.objects.push_back(object);
  }
  const TriangleMesh& in = model.mesh;
  const auto count = in.triangles.size();
  std::vector<Eigen::Vector3d> faces(count);
  // Corners of equal position are one vertex for smoothing; edges sharper than 35 degrees stay.
  const auto key = [](const Eigen::Vector3d& p) {
    return std::array<long, 3>{std::lround(p.x() * 1e5), std::lround(p.y() * 1e5),
                               std::lround(p.z() * 1e5)};
  };
  std::map<std::array<long, 3>, std::vector<int>> around;
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Vector3i& t = in.triangles[i];
    faces[i] = (in.vertices[t[1]] - in.vertices[t[0]]).cross(in.vertices[t[2]] - in.vertices[t[0]]);
    for (int k = 0; k < 3; ++k) around[key(in.vertices[t[k]])].push_back(static_cast<int>(i));
  }
  const double sharp = std::cos(35.0 * kDegree);
  for (std::size_t i = 0; i < count; ++i) {
    if (faces[i].norm() < 1e-10) continue;
    SynthTriangle out;
    const Eigen::Vector3d own = faces[i].normalized();
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d& p = in.vertices[in.triangles[i][k]];
      out.points[k] = p;
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (const int other : around[key(p)]) {
        if (faces[other].norm() < 1e-10) continue;
        if (in.materials[other] == in.materials[i] && own.dot(faces[other].normalized()) > sharp) {
          sum += faces[other];
        }
      }
      out.normals[k] = sum.normalized().cast<float>();
      // Seen from the side: x and y; faces that look up or along the car use z instead.
      if (std::abs(own.z()) > 0.5) {
        out.texture[k] = Eigen::Vector2d(p.x(), p.y()).cast<float>();
      } else if (std::abs(own.x()) > 0.5) {
        out.texture[k] = Eigen::Vector2d(p.z(), p.y()).cast<float>();
      } else {
        out.texture[k] = Eigen::Vector2d(p.x(), p.z()).cast<float>();
      }
    }
    out.object = in.materials[i];
    mesh.triangles.push_back(out);
  }
  return mesh;
}

SE3 seat_car(const RoadModel& road, const CarModel& model, const Eigen::Vector2d& place,
             double station, double heading) {
  const int wheels[4] = {0, 1, 18, 19};
  Eigen::Vector3d up(0, 0, 1), origin(place.x(), place.y(), road.height_at(place, station));
  const Eigen::Vector3d ahead(std::cos(heading), std::sin(heading), 0.0);
  Eigen::Matrix3d rotation;
  for (int iteration = 0; iteration < 12; ++iteration) {
    const Eigen::Vector3d front =
        (ahead - up.dot(ahead) / up.z() * Eigen::Vector3d::UnitZ()).normalized();
    rotation.col(0) = front;
    rotation.col(1) = up;
    rotation.col(2) = front.cross(up);
    Eigen::Matrix<double, 4, 3> design;
    Eigen::Vector4d heights;
    for (int i = 0; i < 4; ++i) {
      Eigen::Vector3d wheel = model.keypoints[wheels[i]];
      wheel.y() = 0.0;
      const Eigen::Vector3d p = rotation * wheel + origin;
      design.row(i) << p.x() - place.x(), p.y() - place.y(), 1.0;
      heights[i] = road.height_at(p.head<2>(), station);
    }
    const Eigen::Vector3d plane =
        (design.transpose() * design).ldlt().solve(design.transpose() * heights);
    up = Eigen::Vector3d(-plane[0], -plane[1], 1.0).normalized();
    origin.z() = plane[2];
  }
  return SE3(rotation, origin);
}

}  // namespace camber
