#include "vehicle/simulated_vehicle.h"

#include <algorithm>
#include <cmath>

#include "camber/core/random.h"

namespace camber::test {

namespace {

/// A body round an annotated shape, scaled along each axis to a size drawn for compact to large
/// cars: bumpers and roof reach 3 to 7 cm beyond the keypoints, the wheels stand on the ground.
CarModel car_from(const AnnotatedShape& shape, const Eigen::Vector3d& draw) {
  const KeypointMatrix& k = shape.keypoints;
  CarModel out;
  const double common = 0.05 * draw.x();
  out.dimensions = {4.27 * (1.0 + common + 0.045 * draw.y()), 1.755 * (1.0 + common),
                    1.475 * (1.0 + 0.6 * common + 0.045 * draw.z())};
  out.wheel_radius = 0.075 * out.dimensions.length;
  constexpr double kFront = 0.065, kRear = 0.055, kRoof = 0.032;  // m
  const double low = k.row(0).minCoeff(), high = k.row(0).maxCoeff();
  const double sx = (out.dimensions.length - kFront - kRear) / (high - low);
  const double sz = 0.5 * out.dimensions.width / k.row(2).cwiseAbs().maxCoeff();
  const double axle = 0.5 * (k(1, 0) + k(1, 1));
  const double sy =
      (out.dimensions.height - kRoof - out.wheel_radius) / (k.row(1).maxCoeff() - axle);
  for (int i = 0; i < kNumKeypoints; ++i) {
    out.keypoints[i] = {sx * (k(0, i) - low) - 0.5 * out.dimensions.length + kRear,
                        sy * (k(1, i) - axle) + out.wheel_radius, sz * k(2, i)};
    out.mesh.vertices.push_back(out.keypoints[i]);
  }
  for (const int i : {0, 1, 18, 19}) {
    const Eigen::Vector3d& p = out.keypoints[i];
    out.mesh.vertices.emplace_back(p.x(), 0.0, p.z());
  }
  const double w = 0.35 * out.dimensions.width, l = 0.5 * out.dimensions.length;
  for (const double z : {-w, w}) {
    out.mesh.vertices.emplace_back(l, 0.45, z);
    out.mesh.vertices.emplace_back(-l, 0.45, z);
    out.mesh.vertices.emplace_back(-0.2, out.dimensions.height, 0.5 * z);
  }
  return out;
}

/// Box and keypoints of a vehicle whose pose and car are known.
void observe(const SimulationOptions& options, std::uint64_t index, const CounterRandom& random,
             std::uint64_t* counter, SimulatedVehicle* vehicle) {
  auto uniform = [&](double low, double high) { return random.uniform((*counter)++, low, high); };
  auto normal = [&](double sigma) { return sigma * random.normal((*counter)++); };
  SimulatedVehicle& out = *vehicle;
  out.detection = {};
  Box2 box{1e9, 1e9, -1e9, -1e9};
  for (const Eigen::Vector3d& v : out.car.mesh.vertices) {
    const auto pixel = out.camera.project(out.truth.camera_from_vehicle * v);
    if (!pixel) continue;
    box = {std::min(box.x1, pixel->x()), std::min(box.y1, pixel->y()), std::max(box.x2, pixel->x()),
           std::max(box.y2, pixel->y())};
  }
  const double noise = std::clamp(0.035 * box.height(), 0.8, 2.5);
  box = Box2{box.x1 + normal(noise), box.y1 + normal(noise), box.x2 + normal(noise),
             box.y2 + normal(noise)}
            .clipped(out.camera.width, out.camera.height);
  out.detection.id = static_cast<int>(index);
  out.detection.box = box;
  // Another vehicle in front of part of it.
  const CounterRandom hiding(options.seed ^ 0x5bd1e995u, index);
  const bool hidden = hiding.uniform(0) < options.occluded_share;
  const double hidden_share = hiding.uniform(1, 0.15, 0.6);
  const bool hidden_left = hiding.uniform(2) < 0.5;
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
    const double across = (exact.x() - box.x1) / box.width();
    if (hidden) seen &= hidden_left ? across > hidden_share : across < 1.0 - hidden_share;
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
}

}  // namespace

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
  if (options.shapes) {
    const auto which = static_cast<std::size_t>(cars.uniform(3 * index) * options.shapes->size());
    out.car = car_from(options.shapes->at(std::min(which, options.shapes->size() - 1)),
                       {std::clamp(cars.normal(3 * index), -2.0, 2.0),
                        std::clamp(cars.normal(3 * index + 1), -2.0, 2.0),
                        std::clamp(cars.normal(3 * index + 2), -2.0, 2.0)});
  }
  // Cars that no catalogue has, and keypoints where another annotator would put them.
  const bool family = !options.shapes;
  const double size_sigma = family ? options.size_sigma : 0.0;
  const double box_sigma = family ? options.box_sigma : 0.0;
  const double annotation_sigma = family ? options.annotation_sigma : 0.0;
  const Eigen::Vector3d scale(1.0 + normal(size_sigma), 1.0 + normal(size_sigma),
                              1.0 + normal(size_sigma));
  for (Eigen::Vector3d& v : out.car.mesh.vertices) v = scale.cwiseProduct(v);
  for (Eigen::Vector3d& v : out.car.keypoints) {
    v = scale.cwiseProduct(v) + Eigen::Vector3d(normal(annotation_sigma), normal(annotation_sigma),
                                                normal(annotation_sigma));
  }
  out.car.dimensions = {out.car.dimensions.length * scale.x() * (1.0 + normal(box_sigma)),
                        out.car.dimensions.width * scale.z() * (1.0 + normal(box_sigma)),
                        out.car.dimensions.height * scale.y() * (1.0 + normal(box_sigma))};

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

  observe(options, index, random, &counter, &out);

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

SimulatedVehicle seen_again(const SimulatedVehicle& vehicle, const SimulationOptions& options,
                            std::uint64_t index, int view, const SE3& camera_from_first,
                            double driven) {
  SimulatedVehicle out = vehicle;
  const SE3& before = vehicle.truth.camera_from_vehicle;
  const SE3 now(before.rotation_matrix(), before * Eigen::Vector3d(driven, 0.0, 0.0));
  out.truth.camera_from_vehicle = camera_from_first * now;
  out.true_plane = vehicle.true_plane.transformed(camera_from_first);
  out.support.plane = vehicle.support.plane.transformed(camera_from_first);
  const CounterRandom random(options.seed + 7919u * static_cast<unsigned>(view), index);
  std::uint64_t counter = 1u << 16;
  observe(options, index, random, &counter, &out);
  return out;
}

}  // namespace camber::test
