// The road of a result folder, asked along the driven line and beyond: height, grade, certainty.
//   camber reconstruct samples/steep_hill --out out/steep_hill
//   03_query_road out/steep_hill
#include <camber/core/errors.h>
#include <camber/scene/results.h>

#include <cmath>
#include <cstdio>
#include <filesystem>

int main(int argc, char** argv) try {
  const std::filesystem::path folder = argc > 1 ? argv[1] : "out/steep_hill";
  const camber::RoadSurface surface = camber::read_surface(folder / "surface.json");

  // Places straight ahead, in the reference camera's frame: z forward. Their own height (y) does
  // not matter: the surface is asked above or below them.
  for (double ahead = 5.0; ahead <= 40.0; ahead += 5.0) {
    const camber::SurfaceQuery road = surface.query({0.0, 0.0, ahead});
    if (road.status == camber::Status::kFailed) {
      std::printf("%4.0f m ahead: %s\n", ahead, road.reason.c_str());
      continue;
    }
    const Eigen::Vector3d& normal = road.plane.plane.normal;
    const double grade = std::atan2(-normal.z(), -normal.y());  // rad, positive: climbs
    std::printf("%4.0f m ahead: road %.2f +- %.2f m below the camera, grade %+.1f degrees\n", ahead,
                road.point.y(), road.sigma_height, grade * 180.0 / M_PI);
  }
} catch (const camber::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return error.exit_code();
}
