#include "camber/drive/measure_window.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "camber/core/errors.h"
#include "camber/pipeline/estimate_window.h"
#include "camber/pipeline/stages/camera_uncertainty.h"
#include "camber/pipeline/stages/detail/relative_sigma.h"
#include "camber/pipeline/stages/motion.h"

namespace camber {
namespace {

WindowMeasurement of_frames(const LoadedFrames& frames) {
  WindowMeasurement out;
  out.reference = frames.frames[frames.reference].id;
  for (const SceneFrame& frame : frames.frames) out.frames.push_back(frame.id);
  return out;
}

void put_motion(const MotionEstimate& motion, WindowMeasurement* out) {
  out->frame_from_reference = motion.frame_from_reference;
  out->covariance = motion.covariance;
}

/// The ground at the pixels that show it, a sample a cell of the plan.
std::vector<RoadSample> road_samples(const WindowEstimate& window, const UncertainPlane& ego,
                                     const RoadSampleOptions& options) {
  struct Sum {
    Eigen::Vector3d point = Eigen::Vector3d::Zero();
    double sigma = 0.0;
    std::array<double, 3> color{0, 0, 0};
    int roadway = 0, count = 0;
  };
  const LoadedFrames& frames = window.road.frames;
  const RoadPosterior& road = window.judged.road;
  const stages::detail::RelativeSigma sigma(road, frames.camera);
  const TriangulatedPoints& points = window.refined.ground.seen.points;
  const Image& image = frames.color[frames.reference];
  const FrameMasks& masks = frames.reference_masks();
  std::map<std::pair<int, int>, Sum> cells;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto grid = static_cast<std::size_t>(points.grid[i]);
    const Eigen::Vector2d at = window.road.matches.pixels[grid].cast<double>();
    const double rho = road.inverse_depth(at);
    if (!(rho > 0.0)) continue;
    const Eigen::Vector3d x = points.rays[i] / rho;
    const Eigen::Vector3d from_foot = x - ego.centroid;
    const double along = ego.axis1.dot(from_foot), across = ego.axis2.dot(from_foot);
    if (along < 0.0 || along > options.reach || std::abs(across) > options.half_width) continue;
    Sum& sum = cells[{static_cast<int>(std::floor(along / options.cell)),
                      static_cast<int>(std::floor(across / options.cell))}];
    const std::size_t pixel = window.road.matches.image_index(grid, frames.camera.width);
    sum.point += x;
    // Along the ray, seen from the side: what it is off in height.
    sum.sigma += sigma.at(at) * std::abs(ego.plane.normal.dot(x));
    for (std::size_t c = 0; c < 3; ++c) sum.color[c] += image.data[3 * pixel + c];
    sum.roadway += masks.roadway[pixel] != 0 ? 1 : 0;
    ++sum.count;
  }
  std::vector<RoadSample> out;
  out.reserve(cells.size());
  for (const auto& [place, sum] : cells) {
    RoadSample sample;
    sample.point = (sum.point / sum.count).cast<float>();
    sample.sigma = static_cast<float>(sum.sigma / sum.count);
    sample.label = 2 * sum.roadway >= sum.count ? 1 : 2;
    for (std::size_t c = 0; c < 3; ++c) {
      sample.color[c] = static_cast<std::uint8_t>(std::lround(sum.color[c] / sum.count));
    }
    out.push_back(sample);
  }
  return out;
}

/// What contradicts a camera in every window counts in each window's weight, too: it may be this
/// window's alone.
void put_metres(const WindowEstimate& window, WindowMeasurement* out) {
  const RunDocument& run = window.assembled.run;
  out->metric = run.metric;
  out->log_scale = std::log(run.scale);
  double common = 0.0;
  for (const CommonError& error : window.judged.road.shared().common) {
    common += std::pow(error.by[error.by.size() - 1], 2);
  }
  // Beside what was judged: the camera's intrinsics.
  common += std::max(0.0, std::pow(run.scale_sigma, 2) - std::pow(window.judged.scale.sigma, 2));
  out->scale_sigma = std::sqrt(std::max(std::pow(run.scale_sigma, 2) - common, 0.0));
  common += window.judged.common_contradiction_variance;
  out->common_scale_sigma = run.metric ? std::sqrt(common) : 0.0;
  if (run.scale_status != Status::kOk) out->reason = run.scale_reason;
}

void put_vehicles(const WindowEstimate& window, WindowMeasurement* out) {
  for (const VehicleFrame& frame : window.assembled.vehicles.frames) {
    for (const VehicleEstimate& v : frame.vehicles) {
      if (v.track >= 0) out->tracked.push_back({frame.id, v.id, v.track});
    }
    if (!frame.vehicles.empty()) out->vehicles.push_back(frame);
  }
}

}  // namespace

WindowMeasurement measure_motion(
    const Scene& scene, const std::vector<std::shared_ptr<const stages::LoadedFrame>>& frames,
    std::size_t reference, const ReconstructOptions& options, Timings* timings) {
  const Progress silent;
  const StageRunner run(*timings, silent);
  WindowMeasurement out;
  out.reference = frames[reference]->frame.id;
  for (const auto& frame : frames) out.frames.push_back(frame->frame.id);
  try {
    const LoadedFrames window = stages::frame_window(scene, frames, reference);
    const Correspondences matches =
        run("correspondences", 0.0, [&] { return stages::match(window, options.match); });
    const MotionEstimate motion =
        run("motion", 0.0, [&] { return stages::motion(window, matches, options.motion); });
    put_motion(motion, &out);
  } catch (const NoAnswerError& error) {
    out.reason = error.what();
  }
  return out;
}

WindowMeasurement measure_window(
    const Scene& scene, const std::vector<std::shared_ptr<const stages::LoadedFrame>>& frames,
    std::size_t reference, const ReconstructOptions& options, const RoadSampleOptions& samples,
    Timings* timings) {
  const Progress silent;
  const StageRunner run(*timings, silent);
  try {
    WindowEstimate window =
        estimate_window(scene, stages::frame_window(scene, frames, reference), options, run);
    stages::include_camera_sigma(window.road.frames, &window.assembled);
    WindowMeasurement out = of_frames(window.road.frames);
    put_motion(window.refined.motion, &out);
    put_metres(window, &out);
    out.ego = window.assembled.surface.patches.front().plane;
    out.road = road_samples(window, *out.ego, samples);
    put_vehicles(window, &out);
    return out;
  } catch (const NoAnswerError& error) {
    WindowMeasurement out = measure_motion(scene, frames, reference, options, timings);
    if (out.reason.empty()) out.reason = error.what();
    return out;
  }
}

}  // namespace camber
