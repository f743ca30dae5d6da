#include "vehicle/simulated_vehicle.h"

#include <algorithm>
#include <cmath>

#include "camber/core/random.h"

namespace camber::test {

SimulatedVehicle simulate_vehicle(const SimulationOptions& options, std::uint64_t index) {
  const CounterRandom random(options.seed, index);
  std::uint64_t counter = 0;
  auto uniform = [&](double low, double high) { return random.uniform(counter++, low, high); };
  auto normal = [&](double sigma) { return sigma * random.normal(counter++); };

  SimulatedVehicle out;
  out.camera = {1242, 375, 721.5377, 721.5377, 609.5593, 172.854};
  const CounterRandom cars(options.seed, 1u << 20);
  for (std::uint64_t i = 0;; ++i) {  // vans are a class of their own
    out.car = sample_car(cars, index * 16 + i);
    if (out.car.car_class != CarClass::kVan) break;
  }

  // The ground under the car: up to 10 degrees of grade and bank, a camera 1.2 to 2.2 m above it.
  const double distance = uniform(options.min_distance, options.max_distance);
  const double grade = uniform(-0.17, 0.17), bank = uniform(-0.1, 0.1);
  const Eigen::Vector3d up = Eigen::Vector3d(std::sin(bank), -1.0, -std::tan(grade)).normalized();
  const double bearing = uniform(-0.35, 0.35);
  const double below = uniform(1.2, 2.2);
  const Eigen::Vector3d bottom(distance * std::sin(bearing),
                               below - distance * std::tan(grade) * 0.5,
                               distance * std::cos(bearing));
  out.true_plane = Plane::through(bottom, up);
  const double yaw = uniform(-3.14159265, 3.14159265);
  Eigen::Vector3d ahead(0.0, 0.0, 1.0);
  ahead = (ahead - ahead.dot(up) * up).normalized();
  Eigen::Matrix3d rotation;
  rotation.col(0) = std::cos(yaw) * ahead + std::sin(yaw) * ahead.cross(up);
  rotation.col(1) = up;
  rotation.col(2) = rotation.col(0).cross(up);
  // Suspension and unevenness.
  const Eigen::Vector3d lean(normal(0.006), 0.0, normal(0.006));
  rotation = rotation * rotation_from_vector(lean).toRotationMatrix();
  out.truth.camera_from_vehicle = SE3(rotation, bottom + normal(0.01) * up);
  out.truth.dimensions = out.car.dimensions;

  // Box and keypoints.
  Box2 box{1e9, 1e9, -1e9, -1e9};
  for (const Eigen::Vector3d& v : out.car.mesh.vertices) {
    const auto pixel = out.camera.project(out.truth.camera_from_vehicle * v);
    if (!pixel) continue;
    box = {std::min(box.x1, pixel->x()), std::min(box.y1, pixel->y()), std::max(box.x2, pixel->x()),
           std::max(box.y2, pixel->y())};
  }
  const double noise = std::clamp(0.02 * box.height(), 0.5, 2.0);
  box = Box2{box.x1 + normal(noise), box.y1 + normal(noise), box.x2 + normal(noise),
             box.y2 + normal(noise)}
            .clipped(out.camera.width, out.camera.height);
  out.detection.id = static_cast<int>(index);
  out.detection.box = box;
  const double cell_u = box.width() / 64.0, cell_v = box.height() / 64.0;
  const Eigen::Vector3d eye = out.truth.camera_from_vehicle.inverse().translation();
  for (int i = 0; i < kNumKeypoints; ++i) {
    const Eigen::Vector3d& p = out.car.keypoints[i];
    out.keypoints[i] = out.truth.camera_from_vehicle * p;
    const int row = i % 18;
    const double side = i < 18 ? -1.0 : 1.0;
    bool seen = side * (eye.z() - p.z()) > 0.0;
    if (row >= 10 && row <= 13) seen |= eye.x() < p.x() - 0.3;
    if (row >= 14) seen |= eye.x() > p.x() + 0.3;
    const Eigen::Vector2d exact = out.camera.project(out.keypoints[i]).value();
    seen &= exact.x() > 0 && exact.y() > 0 && exact.x() < out.camera.width - 1 &&
            exact.y() < out.camera.height - 1;
    out.seen[i] = seen;
    KeypointObservation k;
    const double gross = uniform(0.0, 1.0), far = uniform(0.0, 1.0);
    const double sigma = seen ? options.keypoint_sigma_cells : (far < 0.25 ? 6.0 : 2.5);  // cells
    k.pixel = exact + Eigen::Vector2d(normal(sigma * cell_u), normal(sigma * cell_v));
    const Eigen::Vector2d anywhere(uniform(box.x1, box.x2), uniform(box.y1, box.y2));
    if (gross < options.gross_share) k.pixel = anywhere;
    if (options.confidences) k.confidence = seen ? uniform(0.02, 0.9) : uniform(0.0, 0.05);
    out.detection.keypoints.push_back(k);
  }

  // The plane that the fit is given.
  out.support.source = "given";
  UncertainPlane exact;
  exact.plane = out.true_plane;
  exact.centroid = out.true_plane.foot(bottom);
  UncertainPlane::make_axes(up, ahead, &exact.axis1, &exact.axis2);
  exact.covariance =
      Eigen::Vector3d(std::pow(options.plane_sigma_tilt, 2), std::pow(options.plane_sigma_tilt, 2),
                      std::pow(options.plane_sigma_height, 2))
          .asDiagonal();
  out.support.plane = exact;
  out.support.plane.plane =
      exact.perturbed({normal(options.plane_sigma_tilt), normal(options.plane_sigma_tilt),
                       normal(options.plane_sigma_height)});
  UncertainPlane::make_axes(out.support.plane.plane.normal, ahead, &out.support.plane.axis1,
                            &out.support.plane.axis2);
  out.support.plane.centroid = out.support.plane.plane.foot(bottom);
  return out;
}

}  // namespace camber::test
