// One robust plane from a cloud: its slope and how well it is known.
//   02_fit_plane samples/steep_hill/truth/road.ply
#include <camber/cloud/cloud_io.h>
#include <camber/core/errors.h>
#include <camber/plane/fit_plane.h>

#include <cmath>
#include <cstdio>

int main(int argc, char** argv) try {
  const char* path = argc > 1 ? argv[1] : "samples/steep_hill/truth/road.ply";
  const camber::RoadCloud cloud = camber::read_cloud(path);

  camber::PlaneFitOptions options;
  options.up = cloud.default_up();
  const camber::PlaneFit fit = camber::fit_plane(cloud, options);
  if (fit.status != camber::Status::kOk && fit.status != camber::Status::kWeak) {
    throw camber::NoAnswerError(fit.reason);
  }

  // A plane's parameters are two tilts and a height at its centroid, with a 3 x 3 covariance.
  const double degrees = 180.0 / M_PI;
  const Eigen::Vector3d& normal = fit.plane.plane.normal;
  std::printf("%zu of %zu points lie on the plane\n", fit.num_inliers, cloud.size());
  std::printf("slope %.2f degrees, standard deviations %.4f degrees and %.1f mm\n",
              degrees * camber::angle_between(normal, options.up),
              degrees * std::sqrt(fit.plane.covariance.topLeftCorner<2, 2>().trace()),
              1000.0 * std::sqrt(fit.plane.covariance(2, 2)));
  if (!fit.reason.empty()) std::printf("weak: %s\n", fit.reason.c_str());
} catch (const camber::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return error.exit_code();
}
