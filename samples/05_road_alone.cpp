// The road without vehicles: only the stages up to the surface, each a function of its own.
//   05_road_alone samples/steep_hill
#include <camber/core/errors.h>
#include <camber/pipeline/stages/find_road.h>
#include <camber/pipeline/stages/scale.h>
#include <camber/pipeline/stages/surface.h>

#include <cmath>
#include <cstdio>
#include <utility>

namespace stages = camber::stages;

int main(int argc, char** argv) try {
  const camber::Scene scene = camber::read_scene(argc > 1 ? argv[1] : "samples/steep_hill");

  // Images and masks; the road by matches alone, then on the intensities.
  auto loaded = stages::load(scene, camber::select_frames(scene, ""), {});
  const auto [frames, matches, motion, ground] = stages::find_road(scene, std::move(loaded), {});
  const auto refined = stages::refine_photometrically(frames, matches, motion, ground, {});

  // Metres, and which patches there are; their planes are read off the road's posterior.
  const auto scaled = stages::scale(frames, matches, refined, {});
  stages::SurfaceOptions options;
  options.under_vehicles = false;
  const auto plan =
      stages::surface(frames, matches, refined.motion, refined.ground, scaled.road, options);

  const double degrees = 180.0 / M_PI;
  std::printf("scale: %.3f m a baseline, known to %.1f %%\n", scaled.road.metres_per_baseline(),
              100.0 * scaled.road.scale_sigma());
  for (const camber::PatchFootprint& patch : plan.road) {
    const camber::UncertainPlane plane =
        fit_local_plane(scaled.road, frames.camera, patch.contact, patch.local).plane;
    // Against the camera's level. axis1 points ahead; a tilt about axis2 changes the grade.
    std::printf("patch %d: %5.1f m ahead, grade %+5.1f +- %.1f degrees, height %+5.2f +- %.2f m\n",
                patch.id, plane.centroid.z(), degrees * std::asin(-plane.axis1.y()),
                degrees * std::sqrt(plane.covariance(1, 1)), -plane.centroid.y(),
                std::sqrt(plane.covariance(2, 2)));
  }
} catch (const camber::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return error.exit_code();
}
