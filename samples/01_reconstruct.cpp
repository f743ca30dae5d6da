// The main job in ten lines: a few frames of one moving camera to a road and the cars on it.
//   01_reconstruct samples/steep_hill
#include <camber/core/errors.h>
#include <camber/pipeline/reconstruct.h>

#include <cstdio>

int main(int argc, char** argv) try {
  const camber::Scene scene = camber::read_scene(argc > 1 ? argv[1] : "samples/steep_hill");
  const auto result = camber::reconstruct(scene, camber::select_frames(scene, ""), {});
  std::printf("%zu road points in %zu patches\n", result.cloud.size(),
              result.surface.patches.size());
  for (const camber::VehicleFrame& frame : result.vehicles.frames) {
    for (const camber::VehicleEstimate& vehicle : frame.vehicles) {
      const Eigen::Vector3d center = vehicle.pose.center();
      std::printf("frame %d, %s %d: %.1f m ahead, %.2f m down\n", frame.id,
                  vehicle.vehicle_class.c_str(), vehicle.id, center.z(), center.y());
    }
  }
} catch (const camber::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return error.exit_code();
}
