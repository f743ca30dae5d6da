#include "camber/pipeline/stages/ground.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "camber/core/errors.h"
#include "camber/core/threads.h"
#include "camber/pipeline/stages/detail/ground_steps.h"
#include "camber/road/grow_road.h"

namespace camber {

namespace {

/// Index of the block that holds a coordinate.
int block_of(double coordinate, int size, int count) {
  return std::clamp(static_cast<int>(coordinate) / size, 0, count - 1);
}

}  // namespace

bool RejectedBlocks::at(double u, double v) const {
  if (rejected.empty()) return false;
  return rejected[static_cast<std::size_t>(block_of(v, kHigh, rows()) * columns +
                                           block_of(u, kWide, columns))] != 0;
}

double RejectedBlocks::share(const Box2& box) const {
  if (rejected.empty()) return 0.0;
  int all = 0, found = 0;
  for (int r = block_of(box.y1, kHigh, rows()); r <= block_of(box.y2, kHigh, rows()); ++r) {
    for (int c = block_of(box.x1, kWide, columns); c <= block_of(box.x2, kWide, columns); ++c) {
      ++all;
      found += rejected[static_cast<std::size_t>(r * columns + c)] != 0;
    }
  }
  return static_cast<double>(found) / all;
}

namespace stages {

namespace {

/// How far ahead a plane search's hypothesis is taken for the road, camera heights.
constexpr double kReach = 8.0;

/// Of a point, to the right of the line that the camera travels along.
double aside(const Eigen::Vector3d& point, const Eigen::Vector3d& travel) {
  return point.x() - travel.x() / travel.z() * point.z();
}

/// Grid points below the line on which level ground would vanish, with a margin for climbing roads.
std::vector<std::uint8_t> below_horizon(const LoadedFrames& frames, const Correspondences& matches,
                                        const Eigen::Vector3d& travel) {
  const PinholeCamera& camera = frames.camera;
  const double horizon =
      camera.cy + camera.fy * travel.y() / std::max(0.1, travel.z()) - 0.2 * camera.fy;
  std::vector<std::uint8_t> out(matches.pixels.size());
  for (std::size_t i = 0; i < out.size(); ++i) {
    const std::size_t p = matches.image_index(i, camera.width);
    out[i] = !frames.reference_masks().vehicle[p] && matches.pixels[i].y() > horizon;
  }
  return out;
}

/// The road that grows from the near ground, one a grid point.
GrownRoad grown_road(const LoadedFrames& frames, const Correspondences& matches,
                     const TriangulatedPoints& all, const Eigen::Vector3d& travel,
                     const GroundOptions& options) {
  GridInverseDepth grid;
  grid.columns = matches.columns;
  grid.rows = matches.rows;
  grid.step = matches.step;
  grid.inverse_depth.assign(matches.pixels.size(), std::numeric_limits<double>::quiet_NaN());
  grid.sigma.assign(matches.pixels.size(), 0.0);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const auto i = static_cast<std::size_t>(all.grid[k]);
    grid.inverse_depth[i] = all.inverse_depth[k];
    grid.sigma[i] = all.sigma_own[k];
  }
  GrowRoadOptions grow;
  grow.camera_height = frames.known.camera_height.value_or(options.unknown_camera_height);
  return grow_road(frames.camera, grid, travel, grow);
}

}  // namespace

GroundPoints triangulate(const LoadedFrames& frames, const Correspondences& matches,
                         const MotionEstimate& motion, const GroundPoints* before,
                         const GroundOptions& options) {
  TriangulationOptions triangulation;
  triangulation.num_threads = options.num_threads;
  const std::size_t total = matches.pixels.size();
  GroundPoints out;
  if (frames.has_masks()) {
    const FrameMasks& masks = frames.reference_masks();
    out.is_ground.resize(total);
    out.is_roadway.resize(total);
    for (std::size_t i = 0; i < total; ++i) {
      const std::size_t p = matches.image_index(i, frames.camera.width);
      out.is_ground[i] = masks.ground[p];
      out.is_roadway[i] = masks.roadway[p];
    }
    out.points = camber::triangulate(frames.camera, matches, motion, out.is_ground, triangulation);
    return out;
  }
  const Eigen::Vector3d travel = travel_direction(motion, frames.reference);
  const TriangulatedPoints all = camber::triangulate(
      frames.camera, matches, motion, below_horizon(frames, matches, travel), triangulation);
  const GrownRoad grown = grown_road(frames, matches, all, travel, options);
  if (grown.status != Status::kFailed) {
    out.is_ground = out.is_roadway = grown.ground;
  } else if (before) {
    out.is_ground = before->is_ground;
    out.is_roadway = before->is_roadway;
  } else {
    throw NoAnswerError("no road found in the cloud: " + grown.reason);
  }
  out.points = all.chosen(out.is_ground);
  std::vector<std::uint8_t> is_other(total);
  std::transform(out.is_ground.begin(), out.is_ground.end(), is_other.begin(),
                 [](std::uint8_t ground) { return ground == 0; });
  out.others = all.chosen(is_other);
  return out;
}

namespace detail {

ProfilePoints matched_profile(const GroundPoints& seen) {
  constexpr std::size_t kMost = 5000;
  const TriangulatedPoints& points = seen.points;
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (seen.is_roadway[static_cast<std::size_t>(points.grid[i])]) chosen.push_back(i);
  }
  const std::size_t stride = std::max<std::size_t>(1, chosen.size() / kMost);
  std::size_t kept = 0;
  for (std::size_t k = 0; k < chosen.size(); k += stride) chosen[kept++] = chosen[k];
  chosen.resize(kept);
  ProfilePoints out;
  out.correlation = std::max(1.0, EgoPlaneOptions().correlation / static_cast<double>(stride));
  out.road.shared_jacobian.resize(static_cast<Eigen::Index>(chosen.size()),
                                  points.pose_jacobian.cols());
  for (std::size_t k = 0; k < chosen.size(); ++k) {
    const std::size_t i = chosen[k];
    out.road.points.push_back(points.point(i));
    out.road.relative_sigma.push_back(points.sigma_own[i] / points.inverse_depth[i]);
    out.road.shared_jacobian.row(static_cast<Eigen::Index>(k)) =
        points.pose_jacobian.row(static_cast<Eigen::Index>(i)) /
        static_cast<float>(-points.inverse_depth[i]);
  }
  return out;
}

EgoPlane fit_ego(const LoadedFrames& frames, const MotionEstimate& motion, ProfilePoints points,
                 const GroundOptions& options) {
  EgoPlaneOptions ego;
  ego.correlation = points.correlation;
  ego.camera_height = frames.known.camera_height.value_or(options.unknown_camera_height);
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (k == frames.reference) continue;
    const SE3 reference_from_frame = motion.frame_from_reference[k].inverse();
    points.road.camera_path.push_back(reference_from_frame.translation());
    // The optical axes in plan: roads are nearly level in the camera's frame.
    const Eigen::Vector3d axis = reference_from_frame.rotation() * Eigen::Vector3d::UnitZ();
    points.road.camera_turns.push_back(std::atan2(axis.x(), axis.z()));
  }
  return fit_ego_plane(points.road, travel_direction(motion, frames.reference),
                       Eigen::Vector3d(0, -1, 0), motion.covariance, ego);
}

void require_found(const GroundObservations& observed) {
  constexpr std::size_t kFewest = 3;
  if (observed.size() < kFewest) {
    throw NoAnswerError(
        fmt::format("no road plane under the camera: {} points of the road are found in the other "
                    "images",
                    observed.size()));
  }
}

void require_seen(const EgoPlane& ego) {
  if (ego.points == 0) {
    throw NoAnswerError("no road plane under the camera: no match shows the road near it");
  }
}

bool set_ego(const MotionEstimate& motion, EgoPlane ego, Ground* ground) {
  if (ego.status == Status::kFailed) return false;
  ground->ego = std::move(ego);
  ground->metres_per_baseline =
      motion.metres_per_baseline.value_or(ground->ego.metres_per_baseline);
  return true;
}

EgoPlane ego_of(const LoadedFrames& frames, const MotionEstimate& motion,
                const RoadHypothesis& hypothesis, const GroundOptions& options) {
  EgoPlane out;
  out.height = std::exp(-hypothesis.log_baseline);
  out.near_plane_height = out.height;
  out.metres_per_baseline =
      frames.known.camera_height.value_or(options.unknown_camera_height) / out.height;
  const Eigen::Vector3d travel = travel_direction(motion, frames.reference);
  const Eigen::Vector3d normal = road_normal(travel, hypothesis.roll);
  out.plane.plane = {normal, out.height};
  out.plane.centroid = -out.height * normal;
  UncertainPlane::make_axes(normal, travel, &out.plane.axis1, &out.plane.axis2);
  out.status = Status::kWeak;
  out.reason = "by the plane search alone";
  return out;
}

namespace {

/// How far what was matched may be off a hypothesis' road, kerbs and banks included.
class AboutHypothesis {
 public:
  AboutHypothesis(const PinholeCamera& camera, const Eigen::Vector3d& travel,
                  const RoadHypothesis& hypothesis)
      : camera_(camera),
        travel_(travel),
        hypothesis_(hypothesis),
        per_height_(std::exp(hypothesis.log_baseline)) {}

  /// 1/camera height; 0: the ray misses the road.
  double inverse_depth(const Eigen::Vector2d& pixel) const {
    return road_inverse_depth(camera_, travel_, hypothesis_, pixel);
  }

  /// @param expected  inverse_depth() at the pixel, > 0.
  /// @param matched   inverse depth, 1/baseline.
  bool holds(const Eigen::Vector2d& pixel, double expected, double matched) const {
    // Camera heights: near the path, and more per height aside, and per height farther than 4.
    constexpr double kOff = 0.3, kOffAside = 0.15, kOffAhead = 0.1, kNear = 4.0;
    const Eigen::Vector3d point = camera_.ray(pixel) / expected;
    const double allowed = kOff + kOffAside * std::abs(aside(point, travel_)) +
                           kOffAhead * std::max(0.0, point.z() - kNear);
    const double in_heights = matched / per_height_;
    return std::abs(in_heights - expected) <= allowed * std::max(in_heights, 0.0);
  }

 private:
  const PinholeCamera& camera_;
  Eigen::Vector3d travel_;
  RoadHypothesis hypothesis_;
  double per_height_;
};

}  // namespace

void down_weight_off(const LoadedFrames& frames, const MotionEstimate& motion,
                     const RoadHypothesis& hypothesis, GroundObservations* observed) {
  const AboutHypothesis about(frames.camera, travel_direction(motion, frames.reference),
                              hypothesis);
  for (std::size_t i = 0; i < observed->size(); ++i) {
    const Eigen::Vector2d& pixel = observed->pixels[i];
    const double expected = about.inverse_depth(pixel);
    if (!(expected > 1.0 / kReach)) continue;
    if (!about.holds(pixel, expected, observed->inverse_depth[i])) observed->sigma[i] *= 100.0;
  }
}

void add_hypothesis(const LoadedFrames& frames, const MotionEstimate& motion,
                    const RoadHypothesis& hypothesis, GroundObservations* observed) {
  constexpr int kStep = 4;                 // px
  constexpr double kHalfWidth = 1.5;       // camera heights
  constexpr double kRelativeSigma = 0.03;  // of the hypothesis' inverse depths
  const Eigen::Vector3d travel = travel_direction(motion, frames.reference);
  const double per_height = std::exp(hypothesis.log_baseline);
  const std::vector<std::uint8_t>& ground = frames.reference_masks().ground;
  const auto width = static_cast<std::size_t>(frames.camera.width);
  for (int v = frames.camera.height - 1; v >= 0; v -= kStep) {
    for (int u = 0; u < frames.camera.width; u += kStep) {
      if (!ground[static_cast<std::size_t>(v) * width + static_cast<std::size_t>(u)]) continue;
      const Eigen::Vector2d pixel(u, v);
      const double rho = road_inverse_depth(frames.camera, travel, hypothesis, pixel);
      if (!(rho > 1.0 / kReach)) continue;
      const Eigen::Vector3d point = frames.camera.ray(pixel) / rho;
      if (std::abs(aside(point, travel)) > kHalfWidth) continue;
      observed->pixels.push_back(pixel);
      observed->inverse_depth.push_back(rho * per_height);
      observed->sigma.push_back(kRelativeSigma * rho * per_height);
    }
  }
  const auto rows = observed->shared_jacobian.rows();
  const auto more = static_cast<Eigen::Index>(observed->size()) - rows;
  observed->shared_jacobian.conservativeResize(rows + more, Eigen::NoChange);
  observed->shared_jacobian.bottomRows(more).setZero();
}

Ground ground_of(const LoadedFrames& frames, const Correspondences& matches,
                 const MotionEstimate& motion, const RoadHypothesis& hypothesis,
                 double relative_sigma, const GroundOptions& options) {
  // rad: of the road against the travel, and of a camera that is not mounted level with its fall.
  constexpr double kPitch = 0.005, kRoll = 0.03;
  const Eigen::Vector3d travel = travel_direction(motion, frames.reference);
  const FrameMasks& masks = frames.reference_masks();
  TriangulationOptions triangulation;
  triangulation.num_threads = options.num_threads;
  const TriangulatedPoints all = camber::triangulate(
      frames.camera, matches, motion, below_horizon(frames, matches, travel), triangulation);
  const AboutHypothesis about(frames.camera, travel, hypothesis);
  Ground out;
  GroundPoints& seen = out.seen;
  seen.is_ground.assign(matches.pixels.size(), 0);
  for (std::size_t k = 0; k < all.size(); ++k) {
    const auto i = static_cast<std::size_t>(all.grid[k]);
    const Eigen::Vector2d pixel = matches.pixels[i].cast<double>();
    const double expected = about.inverse_depth(pixel);
    seen.is_ground[i] = masks.ground[matches.image_index(i, frames.camera.width)] != 0 &&
                        expected > 0.0 && about.holds(pixel, expected, all.inverse_depth[k]);
  }
  seen.is_roadway = seen.is_ground;
  for (std::size_t i = 0; i < seen.is_roadway.size(); ++i) {
    if (!masks.roadway[matches.image_index(i, frames.camera.width)]) seen.is_roadway[i] = 0;
  }
  seen.points = all.chosen(seen.is_ground);
  out.ego = ego_of(frames, motion, hypothesis, options);
  out.ego.reason = "by what passes on the road";
  out.ego.relative_sigma = relative_sigma;
  out.ego.plane.covariance =
      Eigen::Vector3d(kRoll, kPitch, relative_sigma * out.ego.height).cwiseAbs2().asDiagonal();
  out.ego.shared_jacobian.setZero(3, motion.covariance.cols());
  for (int k = 0; k <= static_cast<int>(kReach); ++k) {
    out.ego.line.emplace_back(out.ego.plane.centroid + k * out.ego.height * travel);
  }
  out.metres_per_baseline = motion.metres_per_baseline.value_or(out.ego.metres_per_baseline);
  GroundObservations observed = ground_observations(matches, seen.points);
  add_hypothesis(frames, motion, hypothesis, &observed);
  require_found(observed);
  GroundFieldOptions field;
  field.metres_per_baseline = out.metres_per_baseline;
  field.num_threads = options.num_threads;
  out.field = std::make_shared<GroundField>(frames.camera, observed, out.ego.plane.plane, field);
  return out;
}

GroundObservations ground_observations(const Correspondences& matches,
                                       const TriangulatedPoints& points) {
  GroundObservations out;
  out.pixels.reserve(points.size());
  for (const int i : points.grid) {
    out.pixels.push_back(matches.pixels[static_cast<std::size_t>(i)].cast<double>());
  }
  out.inverse_depth = points.inverse_depth;
  out.sigma = points.sigma_own;
  out.shared_jacobian = points.pose_jacobian;
  return out;
}

}  // namespace detail

namespace {

/// The reference and the images next to it, which the search compares.
struct Neighbours {
  std::vector<PlaneSearchImage> images;
  MotionEstimate motion;
  std::size_t reference = 0;

  Neighbours(const LoadedFrames& frames, const MotionEstimate& all) {
    for (std::size_t k = 0; k < frames.size(); ++k) {
      if (k + 1 < frames.reference || k > frames.reference + 1) continue;
      if (k == frames.reference) reference = images.size();
      images.push_back({&frames.gray[k], &frames.masks[k].vehicle});
      motion.frame_from_reference.push_back(all.frame_from_reference[k]);
    }
  }

  PlaneSearch searcher(const PinholeCamera& camera, const PlaneSearchOptions& options) const {
    return {camera, images, reference, options};
  }
};

}  // namespace

PlaneSearchResult search_plane(const LoadedFrames& frames, const MotionEstimate& motion,
                               const GroundOptions& options) {
  const Neighbours neighbours(frames, motion);
  PlaneSearchOptions corridor;
  corridor.num_threads = options.num_threads;
  const PlaneSearchResult narrow =
      neighbours.searcher(frames.camera, corridor).search(neighbours.motion);
  if (narrow.informative) return narrow;
  // The lanes beside it, where a vehicle ahead hides what is driven over. Rendered roads: all leads
  // of 0.1 and more were those of a baseline that is right to 10 %.
  corridor.half_width = 1.5;
  corridor.least_lead = 0.1;
  const PlaneSearchResult wide =
      neighbours.searcher(frames.camera, corridor).search(neighbours.motion);
  return wide.informative || wide.lead > narrow.lead ? wide : narrow;
}

double lead_over(const LoadedFrames& frames, const MotionEstimate& motion,
                 const PlaneSearchResult& search, double height, int num_threads) {
  const Neighbours neighbours(frames, motion);
  PlaneSearchOptions corridor;
  corridor.half_width = search.half_width;
  corridor.num_threads = num_threads;
  const PlaneSearch searcher = neighbours.searcher(frames.camera, corridor);
  return searcher.correlation_with_baseline(neighbours.motion, search.best.log_baseline) -
         searcher.correlation_with_baseline(neighbours.motion, -std::log(height));
}

Ground first_ground(const LoadedFrames& frames, const Correspondences& matches,
                    const MotionEstimate& motion, GroundPoints points,
                    const PlaneSearchResult& search, const GroundOptions& options,
                    const std::optional<RoadHypothesis>& start) {
  Ground out;
  out.seen = std::move(points);
  out.search = search;
  GroundObservations observed = detail::ground_observations(matches, out.seen.points);
  constexpr int kLeastSamples = 1000;
  const auto start_from = [&](const RoadHypothesis& road) {
    out.ego = detail::ego_of(frames, motion, road, options);
    out.metres_per_baseline = motion.metres_per_baseline.value_or(out.ego.metres_per_baseline);
    detail::down_weight_off(frames, motion, road, &observed);
    detail::add_hypothesis(frames, motion, road, &observed);
  };
  if (start) {
    start_from(*start);
  } else if (search.informative) {
    start_from(search.best);
  } else {
    EgoPlane ego = detail::fit_ego(frames, motion, detail::matched_profile(out.seen), options);
    const std::string reason = ego.reason;
    if (!detail::set_ego(motion, std::move(ego), &out)) {
      // Where no match shows the road, its likeliest place is better than none: what follows has
      // to find it there.
      if (!(search.correlation > options.searched_correlation) || search.samples < kLeastSamples) {
        throw NoAnswerError("no road plane under the camera: " + reason);
      }
      start_from(search.best);
    }
  }
  detail::require_found(observed);
  GroundFieldOptions field;
  field.metres_per_baseline = out.metres_per_baseline;
  field.num_threads = options.num_threads;
  out.field = std::make_shared<GroundField>(frames.camera, observed, out.ego.plane.plane, field);
  return out;
}

Ground ground(const LoadedFrames& frames, const Correspondences& matches,
              const MotionEstimate& motion, GroundPoints points, const Ground& before,
              const GroundOptions& options) {
  Ground out = before;
  out.seen = std::move(points);
  const GroundObservations observed = detail::ground_observations(matches, out.seen.points);
  detail::require_found(observed);
  auto field = std::make_shared<GroundField>(*before.field);
  EgoPlane ego;
  parallel_for(2, options.num_threads, [&](std::size_t task) {
    if (task == 0) {
      field->update(observed, 2);
    } else {
      ego = detail::fit_ego(frames, motion, detail::matched_profile(out.seen), options);
    }
  });
  detail::set_ego(motion, std::move(ego), &out);
  out.field = std::move(field);
  return out;
}

std::vector<std::uint8_t> ground_pixels(const LoadedFrames& frames, const Correspondences& matches,
                                        const Ground& ground) {
  if (frames.has_masks()) return frames.reference_masks().ground;
  const PinholeCamera& camera = frames.camera;
  const auto width = static_cast<std::size_t>(camera.width);
  std::vector<std::uint8_t> out(width * static_cast<std::size_t>(camera.height), 0);
  for (std::size_t i = 0; i < ground.seen.is_ground.size(); ++i) {
    if (!ground.seen.is_ground[i]) continue;
    const int x = static_cast<int>(matches.pixels[i].x());
    const int y = static_cast<int>(matches.pixels[i].y());
    for (int v = y; v < std::min(camera.height, y + matches.step); ++v) {
      for (int u = x; u < std::min(camera.width, x + matches.step); ++u) {
        out[static_cast<std::size_t>(v) * width + static_cast<std::size_t>(u)] = 1;
      }
    }
  }
  return out;
}

}  // namespace stages
}  // namespace camber
