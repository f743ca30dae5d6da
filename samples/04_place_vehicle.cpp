// One vehicle from its box in one image and the road under it: no motion, no cloud.
//   04_place_vehicle
#include <camber/vehicle/fit_vehicle.h>

#include <cmath>
#include <cstdio>

int main() {
  const camber::PinholeCamera camera{1242, 375, 721.5, 721.5, 609.6, 172.9};

  camber::VehicleDetection detection;
  detection.vehicle_class = "car";
  detection.box = {640.0, 150.0, 735.0, 225.0};  // pixels; keypoints would make it sharper

  // The ground under the car climbs 6 degrees and is known to 5 cm and 1 degree.
  const double slope = 6.0 * M_PI / 180.0;
  camber::SupportPlane ground;
  ground.plane.plane =
      camber::Plane::through({0.0, 1.2, 15.0}, {0.0, -std::cos(slope), -std::sin(slope)});
  ground.plane.centroid = {0.0, 1.2, 15.0};
  camber::UncertainPlane::make_axes(ground.plane.plane.normal, {0.0, 0.0, 1.0}, &ground.plane.axis1,
                                    &ground.plane.axis2);
  ground.plane.covariance.diagonal() << 3e-4, 3e-4, 25e-4;  // rad^2, rad^2, m^2
  ground.source = "given";

  const camber::VehicleEstimate car = camber::fit_vehicle(camera, detection, ground, {});
  const Eigen::Vector3d center = car.pose.center();
  std::printf("%s: centre %.1f m to the right, %.2f m down, %.1f m ahead (+- %.1f m)\n",
              std::string(camber::to_string(car.status)).c_str(), center.x(), center.y(),
              center.z(), std::sqrt(car.covariance(2, 2)));
  return car.status == camber::Status::kFailed ? 1 : 0;
}
