#include "camber/pipeline/reconstruct.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/core/hash.h"
#include "camber/core/threads.h"
#include "camber/motion/correspondences.h"
#include "camber/motion/lane_markings.h"
#include "camber/motion/motion.h"
#include "camber/motion/road_borders.h"
#include "camber/motion/triangulation.h"
#include "camber/photometric/direct_ground.h"
#include "camber/pipeline/frame_masks.h"
#include "camber/pipeline/marking_statements.h"
#include "camber/pipeline/standing_plane.h"
#include "camber/pipeline/width_statements.h"
#include "camber/road/ego_profile.h"
#include "camber/road/ground_field.h"
#include "camber/road/grow_road.h"
#include "camber/road/local_plane.h"
#include "camber/vehicle/fit_vehicle.h"
#include "camber/vehicle/support_plane.h"
#include "camber/vehicle/vehicle_tracks.h"

namespace camber {
namespace {

/// Height of the camera that an up-to-scale result is fitted with; its unit is then one of these.
constexpr double kNominalHeight = 1.65;
/// Relative standard deviation of that height where nothing is known of the camera: cars to vans.
constexpr double kUnknownHeight = 0.2;
/// A scale from markings alone that is known no better than this is not called metric.
constexpr double kMetricSigma = 0.1;

/// State of a run between its stages.
struct Run {
  const Scene& scene;
  const ReconstructOptions& options;
  std::vector<const SceneFrame*> frames;
  std::size_t reference = 0;  // index into frames
  PinholeCamera camera;
  std::vector<GrayImage> grey;
  std::vector<FrameMasks> masks;
  bool has_masks = false;

  Correspondences matches;
  MotionEstimate motion;
  std::optional<double> known_unit;   // metres per unit from known poses
  std::vector<std::uint8_t> ground;   // one a grid point: triangulated as road
  std::vector<std::uint8_t> roadway;  // one a grid point: carries the ego profile
  TriangulatedPoints points;
  EgoPlane ego;
  std::optional<GroundField> field;   // by the matches alone
  std::optional<GroundField> direct;  // by the matches and the grey values
  DirectEvidence evidence;            // of held-out pixels for the latter
  std::string direct_refused;         // why there is no direct field
  double metres_per_unit = 1.0;
  double scale_sigma = 0.0;    // relative
  MarkingStatements markings;  // what took part in scale and ground
  WidthStatements widths;
  double scale_change = 0.0;  // of its logarithm, by markings
};

int at(const Eigen::Vector2f& pixel, int width) {
  return static_cast<int>(pixel.y()) * width + static_cast<int>(pixel.x());
}

/// Direction of travel at the reference image, its camera frame: derivative of the parabola through
/// the neighbouring positions, or the way to the only neighbour.
Eigen::Vector3d travel_direction(const Run& run) {
  const auto position = [&](std::size_t k) -> Eigen::Vector3d {
    return run.motion.frame_from_reference[k].inverse().translation();
  };
  const std::size_t r = run.reference;
  Eigen::Vector3d direction;
  if (r > 0 && r + 1 < run.frames.size()) {
    const Eigen::Vector3d before = position(r - 1), after = position(r + 1);
    const double l1 = before.norm(), l2 = after.norm();
    direction = after * (l1 / l2) - before * (l2 / l1);
  } else {
    direction = r > 0 ? Eigen::Vector3d(-position(r - 1)) : position(r + 1);
  }
  // A camera that looks back along its way (reversing) still sees the road ahead of it.
  if (direction.z() < 0) direction = -direction;
  return direction.normalized();
}

MotionEstimate motion_from_known_poses(const Run& run, double* metres_per_unit) {
  MotionEstimate out;
  double longest = 0.0;
  for (const SceneFrame* frame : run.frames) {
    const SE3 pose =
        frame->world_from_camera->inverse() * *run.frames[run.reference]->world_from_camera;
    out.frame_from_reference.push_back(pose);
    longest = std::max(longest, pose.translation().norm());
  }
  if (!(longest > 0.02)) {
    throw NoAnswerError("the camera stands still: the given poses are less than 2 cm apart");
  }
  for (SE3& pose : out.frame_from_reference) pose.set_translation(pose.translation() / longest);
  const auto n = static_cast<Eigen::Index>(6 * (run.frames.size() - 1));
  out.covariance = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double sigma = i % 6 < 3 ? 1e-4 : 0.003 / longest;  // rad; 3 mm
    out.covariance(i, i) = sigma * sigma;
  }
  out.pixel_sigma = 0.2;
  out.status = Status::kOk;
  *metres_per_unit = longest;
  return out;
}

std::vector<std::uint8_t> static_points(const Run& run) {
  std::vector<std::uint8_t> usable(run.matches.pixels.size(), 1);
  const FrameMasks& masks = run.masks[run.reference];
  for (std::size_t i = 0; i < usable.size(); ++i) {
    usable[i] =
        !masks.vehicle_near[static_cast<std::size_t>(at(run.matches.pixels[i], run.camera.width))];
  }
  return usable;
}

/// Ground points that carry the ego profile.
struct ProfilePoints {
  RoadPoints road;
  double correlation = 1.0;  // see EgoProfileOptions
};

/// The triangulated ones, thinned: neighbours share their errors, one in a few says as much.
ProfilePoints matched_profile(const Run& run) {
  constexpr std::size_t kMost = 5000;
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < run.points.size(); ++i) {
    if (run.roadway[static_cast<std::size_t>(run.points.grid[i])]) chosen.push_back(i);
  }
  const std::size_t stride = std::max<std::size_t>(1, chosen.size() / kMost);
  std::size_t kept = 0;
  for (std::size_t k = 0; k < chosen.size(); k += stride) chosen[kept++] = chosen[k];
  chosen.resize(kept);
  ProfilePoints out;
  out.correlation = std::max(1.0, EgoProfileOptions().correlation / static_cast<double>(stride));
  for (const std::size_t i : chosen) {
    out.road.points.push_back(run.points.point(i));
    out.road.relative_sigma.push_back(run.points.sigma_own[i] / run.points.inverse_depth[i]);
  }
  out.road.shared_jacobian.resize(static_cast<Eigen::Index>(chosen.size()),
                                  run.points.pose_jacobian.cols());
  for (std::size_t k = 0; k < chosen.size(); ++k) {
    out.road.shared_jacobian.row(static_cast<Eigen::Index>(k)) =
        run.points.pose_jacobian.row(static_cast<Eigen::Index>(chosen[k])) /
        static_cast<float>(-run.points.inverse_depth[chosen[k]]);
  }
  return out;
}

/// What the grey values say, in cells of a few pixels. The nearest road decides how the profile is
/// carried back to the camera, and a flow bends at the lower border of the image.
ProfilePoints grey_profile(const Run& run, const GroundObservations& grey) {
  constexpr int kCellWide = 8, kCellHigh = 4;  // px
  constexpr double kMostRelativeSigma = 0.1;   // of a cell's distance
  struct Cell {
    double weight = 0.0, inverse_depth = 0.0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    Eigen::RowVectorXd jacobian;
  };
  const Eigen::Index shared = grey.shared_jacobian.cols();
  const int columns = run.camera.width / kCellWide + 1;
  std::vector<Cell> cells(static_cast<std::size_t>(columns) *
                          static_cast<std::size_t>(run.camera.height / kCellHigh + 1));
  for (std::size_t i = 0; i < grey.size(); ++i) {
    const int x = static_cast<int>(grey.pixels[i].x()), y = static_cast<int>(grey.pixels[i].y());
    const int step = run.matches.step;
    if (!run.roadway[static_cast<std::size_t>(y / step * run.matches.columns + x / step)]) continue;
    Cell& cell = cells[static_cast<std::size_t>(y / kCellHigh * columns + x / kCellWide)];
    if (cell.weight == 0.0) cell.jacobian.setZero(shared);
    const double weight = 1.0 / (grey.sigma[i] * grey.sigma[i]);
    cell.weight += weight;
    cell.inverse_depth += weight * grey.inverse_depth[i];
    cell.pixel += weight * grey.pixels[i];
    cell.jacobian += weight * grey.shared_jacobian.row(static_cast<Eigen::Index>(i)).cast<double>();
  }
  ProfilePoints out;
  out.correlation = DirectOptions().correlation;
  std::vector<Eigen::RowVectorXf> rows;
  for (const Cell& cell : cells) {
    if (!(cell.inverse_depth > 0.0)) continue;
    const double rho = cell.inverse_depth / cell.weight;
    const double relative_sigma = 1.0 / (std::sqrt(cell.weight) * rho);
    if (!(std::sqrt(out.correlation) * relative_sigma < kMostRelativeSigma)) continue;
    out.road.points.push_back(run.camera.ray(Eigen::Vector2d(cell.pixel / cell.weight)) / rho);
    out.road.relative_sigma.push_back(relative_sigma);
    rows.emplace_back((-cell.jacobian / cell.inverse_depth).cast<float>());
  }
  out.road.shared_jacobian.resize(static_cast<Eigen::Index>(rows.size()), shared);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    out.road.shared_jacobian.row(static_cast<Eigen::Index>(k)) = rows[k];
  }
  return out;
}

/// @return whether there is a new plane; without one the last is kept.
/// @throws NoAnswerError if there has been none yet.
bool fit_ego(Run& run, ProfilePoints points) {
  EgoProfileOptions options;
  options.correlation = points.correlation;
  options.camera_height = run.scene.height_above_road.value_or(kNominalHeight);
  for (std::size_t k = 0; k < run.frames.size(); ++k) {
    if (k == run.reference) continue;
    points.road.camera_path.push_back(run.motion.frame_from_reference[k].inverse().translation());
  }
  EgoPlane ego = fit_ego_plane(points.road, travel_direction(run), Eigen::Vector3d(0, -1, 0),
                               run.motion.covariance, options);
  if (ego.status == Status::kFailed) {
    if (run.ego.status == Status::kOk || run.ego.status == Status::kWeak) return false;
    throw NoAnswerError("no road plane under the camera: " + ego.reason);
  }
  run.ego = std::move(ego);
  run.metres_per_unit = run.known_unit.value_or(run.ego.metres_per_unit);
  return true;
}

GroundObservations ground_observations(const Run& run) {
  GroundObservations out;
  out.pixels.reserve(run.points.size());
  for (std::size_t i = 0; i < run.points.size(); ++i) {
    out.pixels.push_back(
        run.matches.pixels[static_cast<std::size_t>(run.points.grid[i])].cast<double>());
  }
  out.inverse_depth = run.points.inverse_depth;
  out.sigma = run.points.sigma_own;
  out.shared_jacobian = run.points.pose_jacobian;
  return out;
}

/// Triangulates below the horizon; without masks the road is then found by growing.
void triangulate_ground(Run& run, bool first) {
  TriangulationOptions options;
  options.num_threads = run.options.num_threads;
  const FrameMasks& masks = run.masks[run.reference];
  const std::size_t total = run.matches.pixels.size();
  if (run.has_masks) {
    if (first) {
      run.ground.assign(total, 0);
      run.roadway.assign(total, 0);
      for (std::size_t i = 0; i < total; ++i) {
        const auto p = static_cast<std::size_t>(at(run.matches.pixels[i], run.camera.width));
        run.ground[i] = masks.ground[p];
        run.roadway[i] = masks.roadway[p];
      }
    }
    run.points = triangulate(run.camera, run.matches, run.motion, run.ground, options);
    return;
  }
  // Below the line on which level ground would vanish, with a margin for climbing roads.
  const Eigen::Vector3d travel = travel_direction(run);
  const double horizon =
      run.camera.cy + run.camera.fy * travel.y() / std::max(0.1, travel.z()) - 0.2 * run.camera.fy;
  std::vector<std::uint8_t> wanted(total, 0);
  for (std::size_t i = 0; i < total; ++i) {
    const auto p = static_cast<std::size_t>(at(run.matches.pixels[i], run.camera.width));
    wanted[i] = !masks.vehicle[p] && run.matches.pixels[i].y() > horizon;
  }
  const TriangulatedPoints all = triangulate(run.camera, run.matches, run.motion, wanted, options);
  GrowRoadOptions grow;
  grow.camera_height = run.scene.height_above_road.value_or(kNominalHeight);
  GridInverseDepth grid;
  grid.columns = run.matches.columns;
  grid.rows = run.matches.rows;
  grid.step = run.matches.step;
  grid.inverse_depth.assign(total, std::numeric_limits<double>::quiet_NaN());
  grid.sigma.assign(total, 0.0);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const auto i = static_cast<std::size_t>(all.grid[k]);
    grid.inverse_depth[i] = all.inverse_depth[k];
    grid.sigma[i] = all.sigma_own[k];
  }
  const GrownRoad grown = grow_road(run.camera, grid, travel, grow);
  if (grown.status != Status::kFailed) {
    run.ground = grown.ground;
    run.roadway = grown.ground;
  } else if (first) {
    throw NoAnswerError("no road found in the cloud: " + grown.reason);
  }
  run.points = all.chosen(run.ground);
}

/// Ground seen in the reference image, one byte a pixel.
std::vector<std::uint8_t> ground_pixels(const Run& run) {
  if (run.has_masks) return run.masks[run.reference].ground;
  const auto width = static_cast<std::size_t>(run.camera.width);
  std::vector<std::uint8_t> out(width * static_cast<std::size_t>(run.camera.height), 0);
  for (std::size_t i = 0; i < run.ground.size(); ++i) {
    if (!run.ground[i]) continue;
    const int x = static_cast<int>(run.matches.pixels[i].x());
    const int y = static_cast<int>(run.matches.pixels[i].y());
    for (int v = y; v < std::min(run.camera.height, y + run.matches.step); ++v) {
      for (int u = x; u < std::min(run.camera.width, x + run.matches.step); ++u) {
        out[static_cast<std::size_t>(v) * width + static_cast<std::size_t>(u)] = 1;
      }
    }
  }
  return out;
}

/// Carries every ground pixel of the reference into the other images by the field.
std::vector<PredictedImage> predict(const Run& run, int top) {
  const auto width = static_cast<std::size_t>(run.camera.width);
  const auto height = static_cast<std::size_t>(run.camera.height);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const double least = run.metres_per_unit / 200.0;
  const FrameMasks& here = run.masks[run.reference];

  // Where a prediction is wanted: the ground and what stands on it, with a margin for context.
  std::vector<std::uint8_t> region;
  if (run.has_masks) {
    region = here.ground_near;
  } else {
    region.assign(width * height, 0);
    const int reach = 12 * run.matches.step;  // the road may go on where it was lost
    for (std::size_t i = 0; i < run.ground.size(); ++i) {
      if (!run.ground[i]) continue;
      const int x = static_cast<int>(run.matches.pixels[i].x());
      const int y = static_cast<int>(run.matches.pixels[i].y());
      for (int v = std::max(0, y - reach); v <= std::min(run.camera.height - 1, y + reach); ++v) {
        std::fill(region.begin() +
                      static_cast<std::ptrdiff_t>(v * run.camera.width + std::max(0, x - reach)),
                  region.begin() +
                      static_cast<std::ptrdiff_t>(v * run.camera.width +
                                                  std::min(run.camera.width - 1, x + reach) + 1),
                  std::uint8_t{1});
      }
    }
  }
  // The corridor ahead too: what a moving shadow cuts off is found again from there, by windows of
  // its own, since the shadow pulls at the flow beside it.
  std::vector<std::uint8_t> searched;
  if (!run.has_masks) {
    searched.assign(width * height, 0);
    for (std::size_t v = static_cast<std::size_t>(top); v < height; ++v) {
      for (std::size_t u = 0; u < width; ++u) {
        const Eigen::Vector2d pixel(static_cast<double>(u), static_cast<double>(v));
        const double depth = run.metres_per_unit / run.field->inverse_depth(pixel);
        if (depth > 0 && depth < 15.0 && std::abs(run.camera.ray(pixel).x() * depth) < 5.0 &&
            !here.vehicle[v * width + u]) {
          region[v * width + u] = 1;
          searched[v * width + u] = 1;
        }
      }
    }
    const std::vector<std::uint8_t> found = ground_pixels(run);
    for (std::size_t p = 0; p < found.size(); ++p) searched[p] = searched[p] && !found[p];
  }
  std::vector<PredictedImage> out(run.matches.matches.size());
  for (std::size_t k = 0; k < out.size(); ++k) {
    out[k].searched = searched;
    out[k].frame = run.matches.matches[k].frame;
    out[k].pixels.assign(width * height, Eigen::Vector2f(nan, nan));
    out[k].ignored.assign(width * height, 0);
  }
  parallel_for(height - static_cast<std::size_t>(top), run.options.num_threads, [&](std::size_t r) {
    const std::size_t v = r + static_cast<std::size_t>(top);
    for (std::size_t u = 0; u < width; ++u) {
      const std::size_t p = v * width + u;
      if (!region[p]) continue;
      const Eigen::Vector2d pixel(static_cast<double>(u), static_cast<double>(v));
      const double rho = std::max(least, run.field->inverse_depth(pixel));
      const Eigen::Vector3d ray = run.camera.ray(pixel);
      for (PredictedImage& image : out) {
        const auto f = static_cast<std::size_t>(image.frame);
        const SE3& pose = run.motion.frame_from_reference[f];
        const auto q = run.camera.project(pose.rotation() * ray + rho * pose.translation());
        if (!q) continue;
        image.pixels[p] = q->cast<float>();
        bool ignored = here.vehicle[p] != 0;
        if (run.camera.contains(*q, 1.0)) {
          ignored |= run.masks[f].vehicle[static_cast<std::size_t>(std::lround(q->y())) * width +
                                          static_cast<std::size_t>(std::lround(q->x()))] != 0;
        }
        image.ignored[p] = ignored;
      }
    }
  });
  return out;
}

/// Leaves matches beside vehicles and contradicted pixels nearly without weight: a flow carries
/// what moves there a patch or two out.
void distrust_beside(const Run& run, const std::vector<std::uint8_t>& contradicted,
                     GroundObservations& observations) {
  constexpr int kReachU = 24, kReachV = 12;  // px
  std::vector<std::uint8_t> near = contradicted;
  const std::vector<std::uint8_t>& vehicle = run.masks[run.reference].vehicle;
  for (std::size_t i = 0; i < near.size(); ++i) near[i] |= vehicle[i];
  const cv::Mat in(run.camera.height, run.camera.width, CV_8UC1, near.data());
  cv::Mat grown;
  cv::dilate(in, grown,
             cv::getStructuringElement(cv::MORPH_RECT, {2 * kReachU + 1, 2 * kReachV + 1}));
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const Eigen::Vector2d& p = observations.pixels[i];
    if (grown.at<std::uint8_t>(static_cast<int>(p.y()), static_cast<int>(p.x()))) {
      observations.sigma[i] *= 100.0;
    }
  }
}

/// Refines the motion and the ground on the grey values of all images, and keeps the result where
/// the pixels left out of it agree better than before.
void refine_directly(Run& run) {
  std::vector<DirectImage> images(run.frames.size());
  for (std::size_t k = 0; k < images.size(); ++k) {
    images[k].image = &run.grey[k];
    images[k].ignored = &run.masks[k].vehicle;
  }
  DirectOptions options;
  options.num_threads = run.options.num_threads;
  const DirectGround direct(run.camera, images, run.reference, ground_pixels(run),
                            static_cast<int>(run.field->top()) - 2, options);
  const HeldOutPixels before = direct.judge(run.motion.frame_from_reference, *run.field);
  GroundField refined(*run.field);
  DirectResult result = direct.refine(run.motion, refined);
  if (result.status == Status::kFailed) {
    run.direct_refused = result.reason;
    return;
  }
  if (result.motion_change > 4.0) {
    run.direct_refused = "the motion would change by " +
                         std::to_string(result.motion_change).substr(0, 4) + " standard deviations";
    return;
  }
  const MotionEstimate motion = run.motion;
  const TriangulatedPoints points = run.points;
  const EgoPlane ego = run.ego;
  const double metres_per_unit = run.metres_per_unit;
  const std::vector<std::uint8_t> ground = run.ground, roadway = run.roadway;
  run.motion.frame_from_reference = result.frame_from_reference;
  run.motion.covariance = result.covariance;
  triangulate_ground(run, false);
  if (!fit_ego(run, grey_profile(run, result.observations))) fit_ego(run, matched_profile(run));

  // Matches and grey values together, at the refined motion.
  GroundObservations all = ground_observations(run);
  const GroundObservations matched = all;
  distrust_beside(run, result.contradicted, all);
  const GroundFieldOptions field_options;
  const double unit = std::sqrt(options.correlation / field_options.correlation);
  const auto rows = static_cast<Eigen::Index>(all.size());
  if (run.options.ground == "grey") std::fill(all.sigma.begin(), all.sigma.end(), 1e6);
  all.shared_jacobian.conservativeResize(
      rows + static_cast<Eigen::Index>(result.observations.size()), Eigen::NoChange);
  all.shared_jacobian.bottomRows(static_cast<Eigen::Index>(result.observations.size())) =
      result.observations.shared_jacobian;
  all.pixels.insert(all.pixels.end(), result.observations.pixels.begin(),
                    result.observations.pixels.end());
  all.inverse_depth.insert(all.inverse_depth.end(), result.observations.inverse_depth.begin(),
                           result.observations.inverse_depth.end());
  for (const double sigma : result.observations.sigma) all.sigma.push_back(unit * sigma);
  refined.update(all, 2);
  run.evidence = DirectEvidence(run.camera.width, run.camera.height, before,
                                direct.judge(run.motion.frame_from_reference, refined));
  const DirectEvidence::Costs whole = run.evidence.within(
      Eigen::Vector2d::Zero(), Eigen::Vector2d(run.camera.width, run.camera.height));
  if (!(whole.pixels >= 200) || !(whole.after < whole.before)) {
    run.direct_refused = whole.pixels < 200 ? "too few pixels to judge by"
                                            : "pixels left out agree less than before";
    run.motion = motion;
    run.points = points;
    run.ego = ego;
    run.metres_per_unit = metres_per_unit;
    run.ground = ground;
    run.roadway = roadway;
    return;
  }
  run.field->update(matched, 2);
  run.direct.emplace(std::move(refined));
}

LaneMarkingSizes marking_sizes(const Scene& scene) {
  const auto size = [&](const char* name) {
    const auto found = scene.markings_m.find(name);
    return found == scene.markings_m.end() ? 0.0 : found->second;
  };
  return {size("dash_length"), size("dash_gap"), size("line_width"), size("zebra_stripe_width"),
          size("zebra_gap")};
}

/// The ground in the reference image, metric, with where it is clear of vehicles.
GroundRaster ground_raster(const Run& run, const GroundField& field) {
  GroundRaster out;
  out.top = std::max(0, static_cast<int>(field.top()) + 1);
  const int width = run.camera.width, height = run.camera.height;
  const auto stored = static_cast<std::size_t>(width) * static_cast<std::size_t>(height - out.top);
  out.inverse_depth.resize(stored);
  parallel_for(static_cast<std::size_t>(height - out.top), run.options.num_threads,
               [&](std::size_t row) {
                 const double v = out.top + static_cast<double>(row);
                 float* values = &out.inverse_depth[row * static_cast<std::size_t>(width)];
                 for (int u = 0; u < width; ++u) {
                   values[u] = static_cast<float>(field.inverse_depth({static_cast<double>(u), v}) /
                                                  run.metres_per_unit);
                 }
               });
  // Near ground, since masks have holes where there is paint.
  constexpr int kReach = 10;  // px
  std::vector<std::uint8_t> seen = ground_pixels(run);
  cv::Mat grown;
  cv::dilate(cv::Mat(height, width, CV_8UC1, seen.data()), grown,
             cv::getStructuringElement(cv::MORPH_RECT, {2 * kReach + 1, 2 * kReach + 1}));
  const std::vector<std::uint8_t>& vehicle = run.masks[run.reference].vehicle;
  out.visible.resize(stored);
  for (std::size_t i = 0, skipped = vehicle.size() - stored; i < stored; ++i) {
    out.visible[i] = grown.data[skipped + i] != 0 && vehicle[skipped + i] == 0;
  }
  return out;
}

/// Painted markings of known size in the reference image and what they say of a field.
LaneMarkings look_for_markings(Run& run, const GroundField& field) {
  const LaneMarkingSizes sizes = marking_sizes(run.scene);
  if (!sizes.dashes() && !sizes.stripes()) {
    run.markings.reason = "the scene gives no sizes of markings";
    return {};
  }
  const bool guessed = !run.known_unit && !run.scene.height_above_road;
  const double unit_before = run.metres_per_unit;
  LaneMarkings found;
  // A guessed scale hides markings: with that of the first ones found more are.
  for (int round = 0; round < (guessed ? 3 : 1); ++round) {
    found =
        find_lane_markings(run.grey[run.reference], run.camera, ground_raster(run, field),
                           travel_direction(run), sizes, run.scale_sigma, run.options.num_threads);
    run.markings =
        marking_statements(field, run.camera, found, sizes, run.metres_per_unit, run.scale_sigma,
                           run.motion.covariance, LocalPlaneOptions().inflation);
    if (run.markings.statements.values.size() == 0) break;
    if (!guessed || round == 2 || std::abs(run.markings.scale_change) < 0.02) break;
    run.metres_per_unit *= std::exp(run.markings.scale_change);
  }
  if (run.markings.statements.values.size() == 0) run.metres_per_unit = unit_before;
  return found;
}

/// Statements of which each kind knows nothing of the other's, as one.
GroundField::MetricStatements joined(const GroundField::MetricStatements& a,
                                     const GroundField::MetricStatements& b) {
  GroundField::MetricStatements out;
  out.pixels = a.pixels;
  out.pixels.insert(out.pixels.end(), b.pixels.begin(), b.pixels.end());
  const Eigen::Index m = a.values.size(), n = b.values.size();
  out.coefficients = Eigen::MatrixXd::Zero(m + n, static_cast<Eigen::Index>(out.pixels.size()));
  out.coefficients.topLeftCorner(m, a.coefficients.cols()) = a.coefficients;
  out.coefficients.bottomRightCorner(n, b.coefficients.cols()) = b.coefficients;
  out.values.resize(m + n);
  out.values << a.values, b.values;
  out.noise = Eigen::MatrixXd::Zero(m + n, m + n);
  out.noise.topLeftCorner(m, m) = a.noise;
  out.noise.bottomRightCorner(n, n) = b.noise;
  return out;
}

/// Scale and far ground from what is known of the road in the reference image: painted markings of
/// known size, a width that hardly changes.
void use_known_lengths(Run& run) {
  GroundField& best = run.direct ? *run.direct : *run.field;
  const double inflation = LocalPlaneOptions().inflation;
  const double unit_before = run.metres_per_unit;
  LaneMarkings painted;
  if (run.options.use_markings) painted = look_for_markings(run, best);
  RoadBorders borders;
  if (run.options.use_road_width) {
    if (run.has_masks) {
      borders =
          find_road_borders(run.grey[run.reference], run.camera, ground_raster(run, best),
                            run.masks[run.reference].roadway, run.masks[run.reference].vehicle,
                            travel_direction(run), run.options.num_threads);
      run.widths = width_statements(best, run.camera, borders, run.metres_per_unit, run.scale_sigma,
                                    run.motion.covariance, inflation);
    } else {
      run.widths.reason = "no mask shows where the road ends";
    }
  }
  const auto said = [](const auto& of) { return of.statements.values.size() > 0; };
  const auto both = [&](const MarkingStatements& markings, const WidthStatements& widths) {
    if (!said(markings)) return widths.statements;
    return said(widths) ? joined(markings.statements, widths.statements) : markings.statements;
  };
  if (!said(run.markings) && !said(run.widths)) return;
  const double m = run.metres_per_unit;
  if (run.direct) {
    // The ground by matches alone hears the same, so that the two can still be compared.
    MarkingStatements markings;
    WidthStatements widths;
    if (said(run.markings)) {
      markings = marking_statements(*run.field, run.camera, painted, marking_sizes(run.scene), m,
                                    run.scale_sigma, run.motion.covariance, inflation);
    }
    if (said(run.widths)) {
      widths = width_statements(*run.field, run.camera, borders, m, run.scale_sigma,
                                run.motion.covariance, inflation);
    }
    double sigma = run.scale_sigma;
    if (said(markings) || said(widths)) {
      run.field->condition(both(markings, widths), run.motion.covariance, inflation, &sigma);
    }
  }
  const double change = best.condition(both(run.markings, run.widths), run.motion.covariance,
                                       inflation, &run.scale_sigma);
  run.metres_per_unit = m * std::exp(change);
  run.scale_change = std::log(run.metres_per_unit / unit_before);
  // What is conditioned is metric in the unit before; the other is in units, which are new ones.
  for (GroundField* field : {&*run.field, run.direct ? &*run.direct : nullptr}) {
    if (field && field->conditioned()) field->rescale(std::exp(change));
  }
}

/// A plane of the ground by the best field, and what became of the direct refinement there.
struct JudgedPlane {
  LocalPlane fit;
  const GroundField* field = nullptr;  // of the fit
  std::string refinement;
};

JudgedPlane judged_plane(const Run& run, const Eigen::Vector2d& contact, const Box2& around,
                         const LocalPlaneOptions& options) {
  JudgedPlane out;
  out.fit = fit_local_plane(*run.field, run.camera, contact, run.motion.covariance, options);
  out.field = &*run.field;
  if (!run.direct) {
    if (!run.direct_refused.empty()) out.refinement = "refused: " + run.direct_refused;
    return out;
  }
  LocalPlane direct =
      fit_local_plane(*run.direct, run.camera, contact, run.motion.covariance, options);
  if (direct.status == Status::kFailed) {
    out.refinement = "refused: " + direct.reason;
    return out;
  }
  if (out.fit.status == Status::kFailed) {
    out.refinement = "refused: the triangulated points show no plane there";
    return out;
  }
  const DirectEvidence::Costs costs =
      run.evidence.within({around.x1, around.y1}, {around.x2, around.y2});
  // Chance alone changes the mean of n costs by about their mean over sqrt(n).
  if (costs.pixels >= 20 && costs.after > costs.before * (1.0 + 1.0 / std::sqrt(costs.pixels))) {
    out.refinement = "refused: pixels left out agree less than before";
    return out;
  }
  const Eigen::Vector3d& at = out.fit.plane.centroid;
  const double moved = direct.plane.plane.signed_distance(at);
  const double sigma =
      std::sqrt(out.fit.plane.height_variance(at) + direct.plane.height_variance(at));
  if (std::abs(moved) > 3.0 * sigma) {
    out.refinement = "refused: " + std::to_string(std::abs(moved) / sigma).substr(0, 4) +
                     " standard deviations off the triangulated points";
    return out;
  }
  out.fit = std::move(direct);
  out.field = &*run.direct;
  out.refinement = "accepted";
  return out;
}

/// Joint covariance of the planes under all detections, metres: those of one field by that field,
/// others each by itself, and the scale of the run, which they share.
/// @param found  [frame][detection]; field null: not a plane of a field.
SharedGround shared_ground(const Run& run, const std::vector<std::vector<JudgedPlane>>& found,
                           const std::vector<TrackFrame>& views, double metres_per_unit,
                           double scale_sigma) {
  SharedGround out;
  Eigen::Index count = 0;
  for (const TrackFrame& view : views) count += static_cast<Eigen::Index>(view.supports.size());
  out.covariance = Eigen::MatrixXd::Zero(3 * count + 1, 3 * count + 1);
  Eigen::VectorXd by_scale = Eigen::VectorXd::Zero(3 * count + 1);
  by_scale[3 * count] = 1.0;
  struct Member {
    std::size_t frame, detection;
    Eigen::Index row;
  };
  std::vector<Member> own;
  Eigen::Index row = 0;
  for (std::size_t k = 0; k < views.size(); ++k) {
    for (std::size_t j = 0; j < views[k].supports.size(); ++j, row += 3) {
      if (found[k][j].field) {
        own.push_back({k, j, row});
      } else {
        out.covariance.block<3, 3>(row, row) = views[k].supports[j].plane.covariance;
      }
    }
  }
  LocalPlaneOptions local;
  local.metres_per_unit = metres_per_unit;
  const Eigen::Vector3d unit(1.0, 1.0, metres_per_unit);
  for (const GroundField* field : {&*run.field, run.direct ? &*run.direct : nullptr}) {
    std::vector<LocalPlane> planes;
    std::vector<Eigen::Index> rows;
    for (const Member& m : own) {
      const JudgedPlane& judged = found[m.frame][m.detection];
      if (!field || judged.field != field) continue;
      planes.push_back(judged.fit);
      rows.push_back(m.row);
      if (field->conditioned()) {
        // By its own field, which has the scale's share in its covariance.
        const Eigen::Vector3d with_scale =
            unit.cwiseProduct(field->scale_covariance(judged.fit.pixels, judged.fit.by_field));
        out.covariance.block<3, 1>(m.row, 3 * count) = with_scale;
        out.covariance.block<1, 3>(3 * count, m.row) = with_scale.transpose();
      } else {
        // A larger scale takes a plane below the camera farther down.
        by_scale[m.row + 2] = -metres_per_unit * judged.fit.plane.plane.offset;
      }
    }
    if (planes.empty()) continue;
    const Eigen::MatrixXd joint = joint_covariance(*field, planes, run.motion.covariance, local);
    for (std::size_t a = 0; a < rows.size(); ++a) {
      for (std::size_t b = 0; b < rows.size(); ++b) {
        out.covariance.block<3, 3>(rows[a], rows[b]) =
            unit.asDiagonal() *
            joint.block<3, 3>(3 * static_cast<Eigen::Index>(a), 3 * static_cast<Eigen::Index>(b)) *
            unit.asDiagonal();
      }
    }
  }
  out.covariance += scale_sigma * scale_sigma * by_scale * by_scale.transpose();
  return out;
}

/// Where a ray from another camera of the run meets the ground; reference frame, units.
std::optional<Eigen::Vector3d> meet_ground(const Run& run, const SE3& reference_from_frame,
                                           const Eigen::Vector3d& ray) {
  const Eigen::Vector3d origin = reference_from_frame.translation();
  const Eigen::Vector3d direction = reference_from_frame.rotation() * ray;
  const auto meet = [&](const Plane& plane) -> std::optional<Eigen::Vector3d> {
    const double along = plane.normal.dot(direction);
    const double s = -plane.signed_distance(origin) / along;
    if (!(s > 0) || !std::isfinite(s)) return std::nullopt;
    return Eigen::Vector3d(origin + s * direction);
  };
  std::optional<Eigen::Vector3d> x = meet(run.ego.plane.plane);
  if (!x) x = origin + direction * (30.0 / run.metres_per_unit);
  for (int iteration = 0; iteration < 15; ++iteration) {
    const auto pixel = run.camera.project(*x);
    if (!pixel) return std::nullopt;
    // Tangent plane of the field at that pixel, from three inverse depths (rho = m . ray).
    Eigen::Matrix3d rays;
    Eigen::Vector3d rho;
    const Eigen::Vector2d corners[3] = {{-4, 3}, {4, 3}, {0, -3}};
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector2d p = *pixel + corners[k];
      rays.row(k) = run.camera.ray(p).transpose();
      rho[k] = run.field->inverse_depth(p);
    }
    const Eigen::Vector3d m = rays.inverse() * rho;
    if (!(m.norm() > 0)) return std::nullopt;
    const auto next = meet(Plane{-m / m.norm(), 1.0 / m.norm()});
    if (!next) return std::nullopt;
    const double change = (*next - *x).norm() / next->norm();
    x = change > 0.5 ? Eigen::Vector3d(*x + 0.5 * (*next - *x)) : *next;
    if (change < 1e-6) break;
  }
  return x;
}

Plane scaled(const Plane& plane, double metres_per_unit) {
  return {plane.normal, plane.offset * metres_per_unit};
}

/// In metres, with the scale's share in the height: a scaling about the camera moves a plane by its
/// offset.
UncertainPlane scaled(const UncertainPlane& plane, double metres_per_unit, double scale_sigma) {
  UncertainPlane out = plane;
  out.plane = scaled(plane.plane, metres_per_unit);
  out.centroid *= metres_per_unit;
  const double m = metres_per_unit;
  const Eigen::Vector3d unit(1.0, 1.0, m);
  out.covariance = unit.asDiagonal() * plane.covariance * unit.asDiagonal();
  out.covariance(2, 2) += std::pow(out.plane.offset * scale_sigma, 2);
  return out;
}

SE3 scaled(const SE3& pose, double metres_per_unit) {
  return {pose.rotation(), pose.translation() * metres_per_unit};
}

void set_slopes(PlanePatch& patch, const Eigen::Vector3d& up) {
  // Rise of the plane along a direction, over its level run.
  const auto slope = [&](const Eigen::Vector3d& along) {
    const double rise = along.dot(up);
    return std::atan2(rise, (along - rise * up).norm());
  };
  patch.grade = slope(patch.plane.axis1);
  patch.bank = slope(patch.plane.axis2);
}

void set_rectangle(PlanePatch& patch, double ahead, double behind, double half_width) {
  for (const auto& [a, b] : {std::pair{ahead, half_width}, std::pair{ahead, -half_width},
                             std::pair{-behind, -half_width}, std::pair{-behind, half_width}}) {
    patch.boundary.emplace_back(patch.plane.centroid + a * patch.plane.axis1 +
                                b * patch.plane.axis2);
  }
}

void set_status(PlanePatch& patch, const std::string& too_few) {
  const double sigma = std::sqrt(patch.plane.covariance(2, 2));
  if (!too_few.empty()) {
    patch.status = Status::kNotObservable;
    patch.reason = too_few + "; carried by the road around it";
  } else if (sigma > 0.3) {
    patch.status = Status::kWeak;
    patch.reason = "height known to " + std::to_string(sigma).substr(0, 4) + " m";
  } else {
    patch.status = Status::kOk;
  }
}

/// Road points inside a box of the reference image that agree with the field.
int count_points(const Run& run, const Box2& box) {
  int count = 0;
  const std::vector<double>& weights = run.field->weights();
  for (std::size_t i = 0; i < run.points.size(); ++i) {
    const Eigen::Vector2d p =
        run.matches.pixels[static_cast<std::size_t>(run.points.grid[i])].cast<double>();
    if (box.contains(p) && i < weights.size() && weights[i] > 0.4) ++count;
  }
  return count;
}

PatchLink make_link(const PlanePatch& a, const PlanePatch& b) {
  PatchLink link;
  link.a = a.id;
  link.b = b.id;
  const Eigen::Vector3d between = 0.5 * (a.plane.centroid + b.plane.centroid);
  link.distance = (a.plane.centroid - b.plane.centroid).norm();
  link.height_step =
      a.plane.plane.signed_distance(between) - b.plane.plane.signed_distance(between);
  link.angle = angle_between(a.plane.plane.normal, b.plane.plane.normal);
  const double variance =
      a.plane.height_variance(between) + b.plane.height_variance(between) + 1e-6;
  link.weight = 1.0 / variance;
  // Continuity is contradicted by a step beyond both planes' uncertainty and a road's unevenness.
  if (std::abs(link.height_step) > 0.1 + 3.0 * std::sqrt(variance)) {
    link.valid = false;
    link.reason =
        "height step of " + std::to_string(std::abs(link.height_step)).substr(0, 4) + " m";
  }
  return link;
}

}  // namespace

void ReconstructOptions::validate() const {
  if (method != "joint" && method != "coplanar" && method != "flat") {
    throw std::invalid_argument("method = '" + method + "', expected joint, coplanar or flat");
  }
  if (ground != "matches" && ground != "grey" && ground != "both") {
    throw std::invalid_argument("ground = '" + ground + "', expected matches, grey or both");
  }
  if (rounds < 0) {
    throw std::invalid_argument("rounds = " + std::to_string(rounds) + ", expected at least 0");
  }
}

Reconstruction reconstruct(const Scene& scene, const std::vector<int>& frame_ids,
                           const ReconstructOptions& options, const Progress& progress) {
  options.validate();
  if (frame_ids.size() < 2) {
    throw NoAnswerError("one frame alone has no parallax: at least 2 frames are needed, " +
                        std::to_string(frame_ids.size()) + " given");
  }
  const auto report = [&](const std::string& stage, double share) {
    if (progress) progress(stage, share);
  };
  Reconstruction out;
  out.frame_ids = frame_ids;
  out.reference_frame = choose_reference_frame(scene, frame_ids);
  Timings& timings = out.run.timings;
  Run run{scene, options, {}, 0,  scene.camera, {}, {}, false, {},  {}, {}, {},
          {},    {},      {}, {}, {},           {}, {}, 1.0,   0.0, {}, {}, 0.0};
  for (const int id : frame_ids) {
    const SceneFrame* frame = scene.find_frame(id);
    if (!frame) throw std::invalid_argument("the scene has no frame " + std::to_string(id));
    if (id == out.reference_frame) run.reference = run.frames.size();
    run.frames.push_back(frame);
  }
  const std::size_t count = run.frames.size();

  {
    report("load", 0.0);
    const StageTimer timer(timings, "load");
    run.grey.resize(count);
    out.images.resize(count);
    run.masks.resize(count);
    std::vector<std::vector<std::pair<std::string, std::string>>> hashes(count);
    parallel_for(count, options.num_threads, [&](std::size_t k) {
      const SceneFrame& frame = *run.frames[k];
      if (frame.image.empty()) {
        throw NoAnswerError("frame " + std::to_string(frame.id) +
                            " has no image in the manifest; reconstruction needs images");
      }
      FrameImage image = read_frame_image(frame.image, scene.camera);
      run.grey[k] = {image.grey.width, image.grey.height, std::move(image.grey.data)};
      out.images[k] = std::move(image.color);
      run.masks[k] = make_frame_masks(scene, frame, options.use_masks);
      for (const auto& path : {frame.image, frame.segmentation, frame.road_mask}) {
        if (!path.empty()) hashes[k].emplace_back(path.string(), hash_file(path));
      }
    });
    for (auto& list : hashes) {
      out.run.input_hashes.insert(out.run.input_hashes.end(), list.begin(), list.end());
    }
    run.has_masks = run.masks[run.reference].has_mask;
    for (std::size_t a = 0; a < count; ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        if (run.grey[a].pixels == run.grey[b].pixels) {
          throw NoAnswerError("frames " + std::to_string(run.frames[b]->id) + " and " +
                              std::to_string(run.frames[a]->id) +
                              " have the same image: no parallax between them");
        }
      }
    }
  }

  CorrespondenceOptions matching;
  matching.num_threads = options.num_threads;
  matching.keep_lost = !run.has_masks;
  {
    report("correspondences", 0.1);
    const StageTimer timer(timings, "correspondences");
    run.matches = match_images(run.grey, static_cast<int>(run.reference), matching);
  }
  const std::vector<std::uint8_t> usable = static_points(run);
  MotionOptions motion_options;
  motion_options.seed = options.seed;
  motion_options.num_threads = options.num_threads;
  const bool known_poses = std::all_of(run.frames.begin(), run.frames.end(),
                                       [](const SceneFrame* f) { return f->world_from_camera; });
  {
    report("motion", 0.3);
    const StageTimer timer(timings, "motion");
    if (known_poses) {
      double unit = 1.0;
      run.motion = motion_from_known_poses(run, &unit);
      run.known_unit = unit;
    } else {
      run.motion = estimate_motion(scene.camera, run.matches, usable, motion_options);
      if (run.motion.status == Status::kFailed) throw NoAnswerError(run.motion.reason);
    }
  }
  {
    report("triangulation", 0.4);
    const StageTimer timer(timings, "triangulation");
    triangulate_ground(run, true);
  }
  GroundFieldOptions field_options;
  {
    report("surface", 0.5);
    const StageTimer timer(timings, "surface");
    fit_ego(run, matched_profile(run));
    field_options.metres_per_unit = run.metres_per_unit;
    field_options.num_threads = options.num_threads;
    run.field.emplace(scene.camera, ground_observations(run), run.ego.plane.plane, field_options);
  }
  for (int round = 0; round < options.rounds; ++round) {
    const double share = 0.5 + 0.3 * (round + 1.0) / options.rounds;
    {
      report("correspondences", share);
      const StageTimer timer(timings, "correspondences");
      const int top = std::max(0, static_cast<int>(run.field->top()) - 12);
      run.matches = refine_matches(run.grey, run.matches, predict(run, top), top, matching);
    }
    if (!known_poses) {
      report("motion", share);
      const StageTimer timer(timings, "motion");
      motion_options.max_bundle_points = 2000;
      MotionEstimate refined =
          refine_motion(scene.camera, run.matches, usable, run.motion, motion_options);
      if (refined.status == Status::kOk) run.motion = std::move(refined);
    }
    {
      report("triangulation", share);
      const StageTimer timer(timings, "triangulation");
      triangulate_ground(run, false);
    }
    report("surface", share);
    const StageTimer timer(timings, "surface");
    fit_ego(run, matched_profile(run));
    run.field->update(ground_observations(run), 2);
  }

  if (options.ground != "matches") {
    report("surface", 0.8);
    const StageTimer timer(timings, "surface");
    refine_directly(run);
  }
  const GroundField& ground = run.direct ? *run.direct : *run.field;

  run.scale_sigma = run.known_unit                        ? 0.003 / *run.known_unit
                    : scene.height_above_road.has_value() ? run.ego.relative_sigma
                                                          : kUnknownHeight;
  if (options.use_markings || options.use_road_width) {
    report("surface", 0.83);
    const StageTimer timer(timings, "surface");
    use_known_lengths(run);
  }
  const bool marked = run.markings.statements.values.size() > 0;

  // Results, in metres and in the reference camera's frame.
  if (marked && run.scale_sigma > kMetricSigma) {
    run.markings.reason = "they tell the scale to " +
                          std::to_string(100.0 * run.scale_sigma).substr(0, 4) +
                          " % only: the result stays up to scale";
  }
  const bool metric = scene.height_above_road.has_value() || run.known_unit.has_value() ||
                      (marked && run.scale_sigma <= kMetricSigma);
  const double m = run.metres_per_unit;
  const double scale_sigma = metric ? run.scale_sigma : run.ego.relative_sigma;
  // A field that knows metric lengths has the scale's share in its covariance.
  const auto plane_scale_sigma = [&](const JudgedPlane& judged) {
    return judged.field->conditioned() ? 0.0 : scale_sigma;
  };
  std::vector<SE3> frame_from_reference, reference_from_frame;
  for (const SE3& pose : run.motion.frame_from_reference) {
    frame_from_reference.push_back(scaled(pose, m));
    reference_from_frame.push_back(frame_from_reference.back().inverse());
  }
  RoadSurface& surface = out.surface;
  {
    report("surface", 0.85);
    const StageTimer timer(timings, "surface");
    surface.metric = metric;
    surface.scale_sigma = scale_sigma;

    PlanePatch ego;
    ego.id = 0;
    ego.plane = scaled(run.ego.plane, m, 0.0);
    // The scale is what makes this height the camera's: only the mounting is uncertain.
    ego.plane.covariance.row(2).setZero();
    ego.plane.covariance.col(2).setZero();
    ego.plane.covariance(2, 2) = run.known_unit
                                     ? std::pow(run.ego.relative_sigma * run.ego.height * m, 2)
                                     : std::pow(EgoProfileOptions().camera_height_sigma, 2);
    if (marked && !run.known_unit) {
      if (scene.height_above_road) {
        // The camera height fixes this patch; what the markings say against it is the road's bend.
        ego.plane.plane.offset = *scene.height_above_road;
        ego.plane.centroid = ego.plane.plane.foot(Eigen::Vector3d::Zero());
      } else {
        ego.plane.covariance(2, 2) =
            std::pow(std::hypot(run.ego.relative_sigma, scale_sigma) * run.ego.height * m, 2);
      }
    }
    ego.inliers = run.ego.points;
    ego.status = run.ego.status;
    ego.reason = run.ego.reason;
    set_rectangle(ego, 5.0, 2.0, 2.0);
    set_slopes(ego, surface.up);
    surface.ego_patch = 0;
    surface.patches.push_back(ego);
    for (const Eigen::Vector3d& p : run.ego.line) surface.driven_line.push_back(m * p);

    // Patches of 5 m along the direction of travel while the ground is seen.
    LocalPlaneOptions local;
    local.metres_per_unit = m;
    local.length = 5.0;
    local.half_width = 2.0;
    const Eigen::Vector3d travel = travel_direction(run);
    const double nearest =
        ground.inverse_depth({scene.camera.cx, static_cast<double>(scene.camera.height - 1)});
    const double first = nearest > 0 ? std::clamp(m / nearest + 0.1, 2.0, 15.0) : 5.0;
    for (double station = first; station < 60.0; station += local.length) {
      // The line ahead, at the height of the ground there.
      const Eigen::Vector3d ahead = run.ego.plane.centroid + travel * (station / m);
      const Eigen::Vector3d ray(ahead.x() / ahead.z(), 0.0, 1.0);
      double row = -1.0;
      for (double v = scene.camera.height - 1; v > ground.top() + 1; v -= 1.0) {
        const double rho = ground.inverse_depth({scene.camera.cx + scene.camera.fx * ray.x(), v});
        if (!(rho > 0)) break;
        if (1.0 / rho >= ahead.z()) {
          row = v;
          break;
        }
      }
      if (row < 0) break;
      if (row > scene.camera.height - 2) continue;  // nearer than what is seen
      const Eigen::Vector2d start(scene.camera.cx + scene.camera.fx * ray.x(), row);
      const double half = local.half_width / m * scene.camera.fx / ahead.z();
      const double end = std::max(ground.top(), row - (row - scene.camera.cy) * local.length /
                                                          (local.length + m * ahead.z()));
      const JudgedPlane judged = judged_plane(
          run, start, {start.x() - half, std::min(end, row), start.x() + half, row}, local);
      const LocalPlane& fit = judged.fit;
      if (fit.status == Status::kFailed) break;
      PlanePatch patch;
      patch.id = static_cast<int>(surface.patches.size());
      patch.plane = scaled(fit.plane, m, plane_scale_sigma(judged));
      patch.inliers = static_cast<int>(std::lround(fit.support));
      patch.refinement = judged.refinement;
      if (std::sqrt(patch.plane.covariance(2, 2)) > 0.5) break;
      set_status(patch, fit.support < 0.5 ? "hardly any road point is seen there" : "");
      // Not beyond the last row in which the ground is seen: the ground may fall away there.
      double end_depth = 0.0;
      for (double v = ground.top(); v < row && !(end_depth > 0); v += 2.0) {
        const Eigen::Vector2d pixel(start.x(), v);
        const double rho = ground.inverse_depth(pixel);
        if (ground.support(pixel) > 0.5 && rho > 0) end_depth = m / rho;
      }
      const double beyond = end_depth > 0 ? end_depth - patch.plane.centroid.z() : 0.0;
      set_rectangle(patch, std::clamp(beyond, 0.5, 0.5 * local.length), 0.5 * local.length,
                    local.half_width);
      set_slopes(patch, surface.up);
      surface.patches.push_back(patch);
    }
    for (std::size_t k = 1; k < surface.patches.size(); ++k) {
      surface.links.push_back(make_link(surface.patches[k - 1], surface.patches[k]));
    }
  }
  const std::size_t road_patches = surface.patches.size();

  out.vehicles.method = options.method;
  out.vehicles.detections_source = scene.detections_source;
  out.vehicles.metric = metric;
  if (options.with_vehicles) {
    report("vehicles", 0.9);
    const StageTimer timer(timings, "vehicles");
    VehicleFitOptions fit_options;
    fit_options.seed = options.seed;
    // The baselines take their plane for certain.
    fit_options.trust_plane = options.method != "joint";
    std::vector<TrackFrame> views(count);
    std::vector<std::vector<int>> own_patches(count);
    std::vector<std::vector<JudgedPlane>> local_planes(count);
    for (std::size_t k = 0; k < count; ++k) {
      const SceneFrame& frame = *run.frames[k];
      std::vector<SupportPlane> supports;
      std::vector<int> own_patch(frame.vehicles.size(), -1);  // index into surface.patches
      local_planes[k].resize(frame.vehicles.size());
      for (const VehicleDetection& detection : frame.vehicles) {
        SupportPlane support;
        const UncertainPlane ego_here =
            surface.patches[0].plane.transformed(frame_from_reference[k]);
        if (options.method == "flat") {
          support = certain_support(
              {Eigen::Vector3d(0, -1, 0), scene.height_above_road.value_or(kNominalHeight)},
              "level");
          supports.push_back(support);
          continue;
        }
        if (detection.has_plane) {
          support.plane.plane = detection.given_plane.oriented(Eigen::Vector3d(0, -1, 0));
          support.plane.centroid = support.plane.plane.foot(Eigen::Vector3d::Zero());
          UncertainPlane::make_axes(support.plane.plane.normal, Eigen::Vector3d(0, 0, 1),
                                    &support.plane.axis1, &support.plane.axis2);
          support.plane.covariance = Eigen::Vector3d(1e-4, 1e-4, 1e-4).asDiagonal();
          support.source = "given";
          supports.push_back(support);
          continue;
        }
        if (options.method == "coplanar") {
          support = certain_support(ego_here.plane, "ego");
        } else {
          support.plane = ego_here;
          support.source = "ego";
        }
        support.status = surface.patches[0].status;
        if (options.method == "joint") {
          const Eigen::Vector2d bottom(detection.box.center().x(),
                                       std::min(detection.box.y2, scene.camera.height - 1.0));
          std::optional<Eigen::Vector2d> contact = bottom;
          Box2 around = detection.box.scaled(1.95);  // paper, section III-C: 1.9 to 2.0 times
          if (k != run.reference) {
            const auto x = meet_ground(run, run.motion.frame_from_reference[k].inverse(),
                                       scene.camera.ray(bottom));
            contact = x ? scene.camera.project(*x) : std::nullopt;
            if (contact) {
              const Eigen::Vector2d shift = *contact - bottom;
              around = {around.x1 + shift.x(), around.y1 + shift.y(), around.x2 + shift.x(),
                        around.y2 + shift.y()};
            }
          }
          LocalPlaneOptions local;
          local.metres_per_unit = m;
          JudgedPlane judged;
          judged.fit.status = Status::kFailed;
          if (contact) judged = judged_plane(run, *contact, around, local);
          const LocalPlane& fit = judged.fit;
          if (fit.status == Status::kFailed) {
            // Beyond what is seen: the last road patch, known to a metre and a few degrees.
            support.plane =
                surface.patches[road_patches - 1].plane.transformed(frame_from_reference[k]);
            support.plane.covariance.diagonal() += Eigen::Vector3d(0.05 * 0.05, 0.05 * 0.05, 1.0);
            support.source = "patch " + std::to_string(surface.patches[road_patches - 1].id);
            support.status = Status::kNotObservable;
          } else {
            PlanePatch patch;
            patch.id = static_cast<int>(surface.patches.size());
            patch.plane = scaled(fit.plane, m, plane_scale_sigma(judged));
            patch.inliers = count_points(run, around);
            patch.refinement = judged.refinement;
            set_status(patch, patch.inliers < 20 ? "only " + std::to_string(patch.inliers) +
                                                       " road points around the vehicle"
                                                 : "");
            set_rectangle(patch, 0.5 * local.length, 0.5 * local.length, local.half_width);
            set_slopes(patch, surface.up);
            const PlanePatch* nearest = &surface.patches[0];
            for (std::size_t j = 1; j < road_patches; ++j) {
              const PlanePatch& other = surface.patches[j];
              if ((other.plane.centroid - patch.plane.centroid).norm() <
                  (nearest->plane.centroid - patch.plane.centroid).norm()) {
                nearest = &other;
              }
            }
            surface.links.push_back(make_link(*nearest, patch));
            support.plane = patch.plane.transformed(frame_from_reference[k]);
            support.source = "patch " + std::to_string(patch.id);
            support.status = patch.status;
            own_patch[supports.size()] = static_cast<int>(surface.patches.size());
            local_planes[k][supports.size()] = std::move(judged);
            surface.patches.push_back(std::move(patch));
          }
        }
        supports.push_back(support);
      }
      views[k].world_from_camera = reference_from_frame[k];
      views[k].time_s = frame.time_s.value_or(frame.id / scene.frame_rate.value_or(10.0));
      views[k].image = &run.grey[k];
      const Eigen::Index at_pose = 6 * static_cast<Eigen::Index>(k - (k > run.reference ? 1 : 0));
      const Eigen::VectorXd variances = run.motion.covariance.diagonal();
      const bool moved = k != run.reference && at_pose + 6 <= variances.size();
      views[k].pose_sigma_turn = moved ? std::sqrt(variances.segment(at_pose, 3).mean()) : 0.0;
      views[k].pose_sigma_shift =
          moved ? m * std::sqrt(variances.segment(at_pose + 3, 3).mean()) : 0.0;
      views[k].detections = frame.vehicles;
      views[k].estimates =
          fit_vehicles(scene.camera, frame.vehicles, supports, fit_options, options.num_threads);
      views[k].supports = std::move(supports);
      own_patches[k] = std::move(own_patch);
    }
    std::vector<std::vector<VehicleEstimate>> found;
    if (options.method == "joint") {
      out.ground = shared_ground(run, local_planes, views, m, scale_sigma);
      found = fit_tracks(scene.camera, views, fit_options, options.num_threads, scale_sigma,
                         &out.ground)
                  .estimates;
    } else {
      for (const TrackFrame& view : views) found.push_back(view.estimates);
    }
    for (std::size_t k = 0; k < count; ++k) {
      const std::vector<SupportPlane>& supports = views[k].supports;
      const std::vector<int>& own_patch = own_patches[k];
      VehicleFrame vehicles;
      vehicles.id = run.frames[k]->id;
      vehicles.vehicles = std::move(found[k]);
      // The plane under a vehicle and the vehicle on it were solved together: what the vehicle says
      // of its ground goes back into the surface.
      for (std::size_t j = 0; j < vehicles.vehicles.size(); ++j) {
        VehicleEstimate& vehicle = vehicles.vehicles[j];
        if (own_patch[j] < 0 || !options.joint_planes) continue;
        PlanePatch& patch = surface.patches[static_cast<std::size_t>(own_patch[j])];
        // By this frame's view alone: the views of a track share the errors of the surface.
        const std::optional<UncertainPlane> standing =
            standing_plane(views[k].estimates[j], fit_options);
        if (!standing) continue;
        const UncertainPlane& before = supports[j].plane;
        const double step = before.plane.signed_distance(standing->centroid);
        const double variance =
            before.height_variance(standing->centroid) + standing->covariance(2, 2);
        if (std::abs(step) > 4.0 * std::sqrt(variance)) {
          // One of the two is wrong: the plane stays, with a spread that holds both.
          patch.status = Status::kWeak;
          patch.reason = "the vehicle on it stands " + std::to_string(std::abs(step)).substr(0, 4) +
                         " m " + (step > 0 ? "above" : "below");
          const double tilt = angle_between(before.plane.normal, standing->plane.normal);
          patch.plane.covariance.diagonal() +=
              Eigen::Vector3d(tilt * tilt, tilt * tilt, step * step);
          vehicle.plane_sigma_height = std::hypot(vehicle.plane_sigma_height, step);
          continue;
        }
        vehicle.plane = standing->plane;
        vehicle.plane_sigma_height = std::sqrt(standing->covariance(2, 2));
        patch.without_vehicle = patch.plane;
        patch.plane = standing->transformed(reference_from_frame[k]);
        patch.boundary.clear();
        set_rectangle(patch, 0.5 * LocalPlaneOptions().length, 0.5 * LocalPlaneOptions().length,
                      LocalPlaneOptions().half_width);
        set_slopes(patch, surface.up);
      }
      out.vehicles.frames.push_back(std::move(vehicles));
    }
  }

  // The road cloud.
  {
    const StageTimer timer(timings, "surface");
    RoadCloud& cloud = out.cloud;
    cloud.frame = CloudFrame::kCamera;
    cloud.metric = metric;
    const Image& image = out.images[run.reference];
    std::vector<int>& labels = cloud.labels["patch"];
    const std::vector<double>& weights = run.field->weights();
    std::vector<double> total(run.points.size());
    parallel_for((run.points.size() + 2047) / 2048, options.num_threads, [&](std::size_t chunk) {
      for (std::size_t i = 2048 * chunk; i < std::min(run.points.size(), 2048 * (chunk + 1)); ++i) {
        total[i] = run.points.sigma_total(i, run.motion.covariance);
      }
    });
    for (std::size_t i = 0; i < run.points.size(); ++i) {
      const Eigen::Vector3d p = m * run.points.point(i);
      cloud.points.emplace_back(p.cast<float>());
      const double relative = std::hypot(total[i] / run.points.inverse_depth[i], scale_sigma);
      cloud.sigmas.push_back(static_cast<float>(p.norm() * relative));
      const auto pixel = static_cast<std::size_t>(
          at(run.matches.pixels[static_cast<std::size_t>(run.points.grid[i])], run.camera.width));
      cloud.colors.push_back(
          {image.data[3 * pixel], image.data[3 * pixel + 1], image.data[3 * pixel + 2]});
      int label = -1;
      if (i < weights.size() && weights[i] > 0.1) {
        double best = 4.0;  // m along the road
        for (std::size_t j = 0; j < road_patches; ++j) {
          const PlanePatch& patch = surface.patches[j];
          const double along = std::abs((p - patch.plane.centroid).dot(patch.plane.axis1));
          if (along < best) {
            best = along;
            label = patch.id;
          }
        }
      }
      labels.push_back(label);
    }
  }

  RunDocument& document = out.run;
  document.seed = options.seed;
  document.options = {{"method", options.method},
                      {"frames", frame_ids},
                      {"rounds", options.rounds},
                      {"ground", options.ground},
                      {"joint_planes", options.joint_planes},
                      {"use_masks", options.use_masks},
                      {"use_markings", options.use_markings},
                      {"use_road_width", options.use_road_width}};
  for (std::size_t k = 0; k < count; ++k) {
    document.cameras.push_back({run.frames[k]->id, reference_from_frame[k]});
  }
  document.metric = metric;
  document.scale = m;
  document.scale_sigma = scale_sigma;
  document.points_kept.emplace_back("road", static_cast<long>(run.points.size()));
  document.points_kept.emplace_back("motion", run.motion.points);
  for (std::size_t r = 0; r < kNumDropReasons; ++r) {
    document.points_dropped.emplace_back(to_string(static_cast<DropReason>(r)),
                                         run.points.dropped[r]);
  }
  document.extra["reference_frame"] = out.reference_frame;
  document.extra["motion"] = {{"pixel_sigma", run.motion.pixel_sigma},
                              {"inlier_ratio", run.motion.inlier_ratio},
                              {"known_poses", known_poses}};
  document.extra["direct"] = {{"status", options.ground == "matches" ? "not run"
                                         : run.direct                ? "accepted"
                                                                     : "refused"},
                              {"reason", run.direct_refused}};
  if (run.direct) {
    const DirectEvidence::Costs costs = run.evidence.within(
        Eigen::Vector2d::Zero(), Eigen::Vector2d(run.camera.width, run.camera.height));
    document.extra["direct"]["held_out_pixels"] = costs.pixels;
    document.extra["direct"]["held_out_cost_before"] = costs.before;
    document.extra["direct"]["held_out_cost_after"] = costs.after;
  }
  document.extra["markings"] = {{"status", marked                 ? "used"
                                           : options.use_markings ? "not used"
                                                                  : "not run"},
                                {"reason", run.markings.reason}};
  if (marked) {
    document.extra["markings"]["dashes"] = run.markings.dashes;
    document.extra["markings"]["crossings"] = run.markings.crossings;
    document.extra["markings"]["farthest"] = run.markings.farthest;
    document.extra["markings"]["misfit_before"] = run.markings.misfit_before;
    document.extra["markings"]["misfit_after"] = run.markings.misfit_after;
    document.extra["markings"]["scale_change"] = std::expm1(run.scale_change);
  }
  const bool wide = run.widths.statements.values.size() > 0;
  document.extra["road_width"] = {{"status", wide                     ? "used"
                                             : options.use_road_width ? "not used"
                                                                      : "not run"},
                                  {"reason", run.widths.reason}};
  if (wide) {
    document.extra["road_width"]["places"] = run.widths.places;
    document.extra["road_width"]["refused"] = run.widths.refused;
    document.extra["road_width"]["width"] = run.widths.width;
    document.extra["road_width"]["farthest"] = run.widths.farthest;
    document.extra["road_width"]["misfit_before"] = run.widths.misfit_before;
    document.extra["road_width"]["misfit_after"] = run.widths.misfit_after;
  }
  if (!run.known_unit) {
    // How far the road bends before it is seen, and what that does to the scale.
    const double mounting =
        EgoProfileOptions().camera_height_sigma / scene.height_above_road.value_or(kNominalHeight);
    document.extra["scale_from"] = {
        {"source", !marked                   ? "camera height over the ego plane"
                   : scene.height_above_road ? "camera height over the ego plane, and markings"
                                             : "markings"},
        {"sigma_camera_height", mounting},
        {"sigma_road_shape",
         std::sqrt(std::max(0.0, std::pow(run.ego.relative_sigma, 2) - mounting * mounting))},
        {"bend_correction", run.ego.height / run.ego.near_plane_height - 1.0}};
  }
  document.extra["road_from"] = run.has_masks ? "mask" : "geometry";
  report("surface", 1.0);
  return out;
}

}  // namespace camber
