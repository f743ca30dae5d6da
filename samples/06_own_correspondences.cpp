// The road from correspondences of one's own: here OpenCV's sparse optical flow on every eighth
// pixel, handed to the stages in place of Camber's dense matches.
//   06_own_correspondences samples/steep_hill
#include <camber/core/errors.h>
#include <camber/pipeline/stages/ground.h>
#include <camber/pipeline/stages/load.h>
#include <camber/pipeline/stages/motion.h>
#include <camber/pipeline/stages/scale.h>
#include <camber/pipeline/stages/surface.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <opencv2/video/tracking.hpp>

namespace stages = camber::stages;

/// Where the points of a grid are seen in another image, by a pyramidal Lucas-Kanade tracker there
/// and back again.
camber::MatchedImage track(const camber::LoadedFrames& frames, const camber::Correspondences& grid,
                           std::size_t other) {
  const auto view = [](const camber::GrayImage& image) {
    return cv::Mat(image.height, image.width, CV_8UC1,
                   const_cast<unsigned char*>(image.pixels.data()));
  };
  const cv::Mat here = view(frames.gray[frames.reference]), there = view(frames.gray[other]);
  std::vector<cv::Point2f> from, to, back;
  for (const Eigen::Vector2f& p : grid.pixels) from.emplace_back(p.x(), p.y());
  std::vector<unsigned char> found, returned;
  std::vector<float> error;
  cv::calcOpticalFlowPyrLK(here, there, from, to, found, error);
  cv::calcOpticalFlowPyrLK(there, here, to, back, returned, error);

  camber::MatchedImage out;
  out.frame = static_cast<int>(other);
  for (std::size_t i = 0; i < from.size(); ++i) {
    const double miss = cv::norm(back[i] - from[i]);
    const bool accepted = found[i] && returned[i] && miss < 0.5;  // px
    out.pixels.emplace_back(to[i].x, to[i].y);
    out.round_trip_px.push_back(accepted ? static_cast<float>(miss)
                                         : std::numeric_limits<float>::infinity());
  }
  return out;
}

int main(int argc, char** argv) try {
  const camber::Scene scene = camber::read_scene(argc > 1 ? argv[1] : "samples/steep_hill");
  const auto frames = stages::load(scene, camber::select_frames(scene, ""), {});

  // Any matcher will do that fills this: a grid over the reference image with its texture, and for
  // every other image in order where each grid point is seen, with an error or infinity.
  camber::Correspondences matches = camber::correspondence_grid(
      frames.gray[frames.reference], static_cast<int>(frames.reference), 8);
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (k != frames.reference) matches.matches.push_back(track(frames, matches, k));
  }

  const auto motion = stages::motion(frames, matches, {});
  const auto points = stages::triangulate(frames, matches, motion, nullptr, {});
  const auto search = stages::search_plane(frames, motion, {});
  auto ground = stages::first_ground(frames, matches, motion, points, search, {});
  // Once more: the search's plane was a start, the tangent plane under the camera is by the points.
  ground = stages::ground(frames, matches, motion, points, ground, {});
  const auto refined = stages::refine_photometrically(frames, matches, motion, ground, {});
  const auto scaled = stages::scale(frames, matches, refined, {});
  stages::SurfaceOptions options;
  options.under_vehicles = false;
  const auto plan =
      stages::surface(frames, matches, refined.motion, refined.ground, scaled.road, options);

  std::printf("%d points for the motion, %zu of the ground, %.3f m a baseline\n", motion.points,
              points.points.size(), scaled.road.metres_per_baseline());
  for (const camber::PatchFootprint& patch : plan.road) {
    const camber::UncertainPlane plane =
        fit_local_plane(scaled.road, frames.camera, patch.contact, patch.local).plane;
    std::printf("patch %d: %5.1f m ahead, grade %+5.1f +- %.1f degrees\n", patch.id,
                plane.centroid.z(), std::asin(-plane.axis1.y()) * 180.0 / M_PI,
                std::sqrt(plane.covariance(1, 1)) * 180.0 / M_PI);
  }
} catch (const camber::Error& error) {
  std::fprintf(stderr, "%s\n", error.what());
  return error.exit_code();
}
