#include "camber/pipeline/stages/marked_ground.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "camber/core/errors.h"
#include "camber/scale/camera_height_constraint.h"
#include "camber/scale/fusion.h"

namespace camber::stages {
namespace {

/// Pixels on which markings may be seen: near the road where a mask shows it, and clear of
/// vehicles.
std::vector<std::uint8_t> visible_pixels(const LoadedFrames& frames) {
  constexpr int kReach = 6;  // px, since masks have holes where there is paint
  const FrameMasks& masks = frames.reference_masks();
  std::vector<std::uint8_t> out = frames.has_masks() ? masks.roadway : masks.ground;
  if (frames.has_masks()) {
    cv::Mat grown;
    cv::dilate(cv::Mat(frames.camera.height, frames.camera.width, CV_8UC1, out.data()), grown,
               cv::getStructuringElement(cv::MORPH_RECT, {2 * kReach + 1, 2 * kReach + 1}));
    std::copy(grown.data, grown.data + out.size(), out.begin());
  }
  for (std::size_t i = 0; i < out.size(); ++i) out[i] = out[i] && !masks.vehicle[i];
  return out;
}

MarkedRoadOptions road_options(const LoadedFrames& frames, const ScaleOptions& options) {
  MarkedRoadOptions out;
  if (frames.frames.front().up) out.up = *frames.frames.front().up;
  out.height = options.noise.unknown_camera_height;
  out.known_height = frames.known.camera_height.value_or(0.0);
  out.known_height_sigma = frames.known.camera_height_sigma;
  out.noise = options.noise;
  out.num_threads = options.num_threads;
  return out;
}

/// The first row that may show road that is worth looking at: 0.25 rad above the level.
int top_row(const PinholeCamera& camera, const Eigen::Vector3d& up) {
  const double level = camera.cy - camera.fy * up.z() / up.y();
  return static_cast<int>(std::max(0.0, level - 0.25 * camera.fy));
}

/// All pixels between the edges of the strokes that take part.
Correspondences marking_pixels(const std::vector<PaintedStroke>& strokes, const MarkedRoad& road,
                               const PinholeCamera& camera) {
  Correspondences out;
  out.step = 1;
  for (const std::size_t i : road.strokes) {
    const PaintedStroke& stroke = strokes[i];
    const int first = static_cast<int>(std::ceil(stroke.far_end.y()));
    const int last = static_cast<int>(std::floor(stroke.near_end.y()));
    for (int v = std::max(0, first); v <= std::min(last, camera.height - 1); ++v) {
      const StrokeRow edges = stroke.at(v);
      for (int u = static_cast<int>(std::ceil(edges.left)); u <= std::floor(edges.right); ++u) {
        if (u < 0 || u >= camera.width) continue;
        if (!(road.inverse_depth(camera, Eigen::Vector2d(u, v)) > 0)) continue;
        out.pixels.emplace_back(static_cast<float>(u), static_cast<float>(v));
      }
    }
  }
  out.columns = static_cast<int>(out.pixels.size());
  out.rows = 1;
  return out;
}

/// How far the ground may be from the shape at a place, m: the unevenness at a marking, and beside
/// and beyond the markings what a road may do there.
class DepartureFromShape {
 public:
  DepartureFromShape(const std::vector<Eigen::Vector2d>& places, double farthest)
      : places_(places), farthest_(farthest) {}

  double sigma(const Eigen::Vector2d& place) const {
    constexpr double kAtMarking = 0.02;        // m
    constexpr double kBeside = 0.02;           // m a metre: crown, kerb
    constexpr double kAheadCurvature = 0.006;  // 1/m: what the road may bend otherwise
    double nearest = 1e9;
    for (const Eigen::Vector2d& p : places_) {
      const Eigen::Vector2d off = place - p;
      nearest = std::min(nearest, std::hypot(off.x(), 0.3 * off.y()));
    }
    const double ahead = std::max(0.0, place.y() - farthest_);
    return kAtMarking + kBeside * nearest + 0.5 * kAheadCurvature * ahead * ahead;
  }

 private:
  const std::vector<Eigen::Vector2d>& places_;  // m, right and ahead
  double farthest_;
};

/// @return whether the road is seen there.
bool observe(const MarkedRoad& road, const PinholeCamera& camera, const Eigen::Vector2d& pixel,
             const DepartureFromShape& departure, GroundObservations* out,
             std::vector<Eigen::Matrix<double, 1, MarkedRoad::kShape>>* jacobian) {
  const double rho = road.inverse_depth(camera, pixel);
  constexpr double kFarthest = 100.0;  // m
  if (!(rho > 1.0 / kFarthest)) return false;
  const Eigen::Matrix<double, 1, MarkedRoad::kShape> by_shape = road.by_shape(camera, pixel);
  if (!by_shape.allFinite()) return false;
  const Eigen::Vector3d p = camera.ray(pixel) / rho;
  const double height = std::exp(road.shape[2]);
  out->pixels.push_back(pixel);
  out->inverse_depth.push_back(rho);
  out->sigma.push_back(rho * departure.sigma({p.x(), p.z()}) / height);
  jacobian->push_back(by_shape);
  return true;
}

/// The shape as a field: the markings' points first, then a corridor around them.
/// @param pixels  of the markings; those at which no road is seen are taken out.
GroundObservations observations(const MarkedRoad& road, const PinholeCamera& camera,
                                Correspondences* pixels) {
  std::vector<Eigen::Vector2d> places;
  for (const SeenMarking& m : road.markings) {
    const Eigen::Vector3d p = camera.ray(m.pixel) / road.inverse_depth(camera, m.pixel);
    places.emplace_back(p.x(), p.z());
  }
  const DepartureFromShape departure(places, road.farthest);
  GroundObservations out;
  std::vector<Eigen::Matrix<double, 1, MarkedRoad::kShape>> jacobian;
  std::vector<Eigen::Vector2f> marked;
  for (const Eigen::Vector2f& pixel : pixels->pixels) {
    if (observe(road, camera, pixel.cast<double>(), departure, &out, &jacobian)) {
      marked.push_back(pixel);
    }
  }
  pixels->pixels = std::move(marked);
  pixels->columns = static_cast<int>(pixels->pixels.size());
  constexpr int kColumns = 12, kRows = 3;  // px
  constexpr double kHalfWidth = 12.0;      // m
  for (int v = camera.height - 1; v >= 0; v -= kRows) {
    for (int u = 0; u < camera.width; u += kColumns) {
      const Eigen::Vector2d pixel(u, v);
      const double rho = road.inverse_depth(camera, pixel);
      if (!(rho > 0) || std::abs(camera.ray(pixel).x()) > kHalfWidth * rho) continue;
      observe(road, camera, pixel, departure, &out, &jacobian);
    }
  }
  out.shared_jacobian.resize(static_cast<Eigen::Index>(jacobian.size()), MarkedRoad::kShape);
  for (std::size_t i = 0; i < jacobian.size(); ++i) {
    out.shared_jacobian.row(static_cast<Eigen::Index>(i)) = jacobian[i].cast<float>();
  }
  return out;
}

EgoPlane ego_plane(const MarkedRoad& road, const PinholeCamera& camera, int points) {
  EgoPlane out;
  out.status = Status::kOk;
  Eigen::Matrix<double, 3, MarkedRoad::kShape> by_shape;
  out.plane = road.ego(&by_shape);
  out.shared_jacobian = by_shape;
  out.height = out.near_plane_height = out.plane.plane.offset;
  out.relative_sigma = std::sqrt(out.plane.covariance(2, 2)) / out.height;
  out.metres_per_baseline = 1.0;
  out.points = points;
  out.line.push_back(out.plane.centroid);
  double last = out.plane.centroid.z();
  for (int v = camera.height - 1; v >= 0; --v) {
    const Eigen::Vector2d pixel(camera.cx, v);
    const double depth = 1.0 / road.inverse_depth(camera, pixel);
    if (!(depth < road.farthest + 10.0)) break;
    if (depth < last + 1.0) continue;
    last = depth;
    out.line.push_back(depth * camera.ray(pixel));
  }
  return out;
}

std::string missing_text(const LoadedFrames& frames, const std::string& reason) {
  return fmt::format(
      "one frame alone has no parallax: frame {} needs painted markings of known size, and {}; "
      "give "
      "at least 2 frames, or sizes (markings_m) of dashes or crossings that it shows",
      frames.frames.front().id, reason);
}

}  // namespace

MarkedGround marked_ground(const LoadedFrames& frames, const ScaleOptions& options) {
  const MarkedRoadOptions road = road_options(frames, options);
  const std::vector<PaintedStroke> strokes =
      detect_painted_strokes(frames.gray.front(), visible_pixels(frames),
                             top_row(frames.camera, road.up), options.num_threads);
  MarkedGround out;
  out.road = find_marked_road(frames.camera, strokes, frames.known.markings, road);
  if (out.road.status != Status::kOk) throw NoAnswerError(missing_text(frames, out.road.reason));
  out.pixels = marking_pixels(strokes, out.road, frames.camera);
  MotionEstimate& motion = out.ground.motion;
  motion.status = Status::kOk;
  motion.frame_from_reference = {SE3()};
  motion.covariance = out.road.covariance;
  Ground& ground = out.ground.ground;
  const GroundObservations seen = observations(out.road, frames.camera, &out.pixels);
  const std::size_t count = out.pixels.pixels.size();
  if (seen.size() < count + 3) throw NoAnswerError(missing_text(frames, "they show no road"));
  ground.seen.is_ground.assign(count, 1);
  ground.seen.is_roadway.assign(count, 1);
  TriangulatedPoints& points = ground.seen.points;
  points.pose_jacobian = seen.shared_jacobian.topRows(static_cast<Eigen::Index>(count));
  for (std::size_t i = 0; i < count; ++i) {
    points.grid.push_back(static_cast<int>(i));
    points.rays.push_back(frames.camera.ray(seen.pixels[i]));
    points.inverse_depth.push_back(seen.inverse_depth[i]);
    points.sigma_own.push_back(seen.sigma[i]);
  }
  ground.ego = ego_plane(out.road, frames.camera, static_cast<int>(count));
  ground.metres_per_baseline = 1.0;
  GroundFieldOptions field;
  field.num_threads = options.num_threads;
  ground.field = std::make_shared<GroundField>(frames.camera, seen, ground.ego.plane.plane, field);
  return out;
}

ScaledRoad scale_by_markings(const LoadedFrames& frames, const MarkedGround& marked,
                             const ScaleOptions& options) {
  const Ground& ground = marked.ground.ground;
  const auto prior = [&](double log_scale_sigma) {
    return RoadPosterior(ground.field, marked.ground.motion.covariance, options.ground_inflation,
                         {ground.ego.plane, ground.ego.shared_jacobian}, 1.0, log_scale_sigma);
  };
  const MarkedRoad& road = marked.road;
  LaneMarkingConstraint markings;
  markings.dashes = road.dashes;
  markings.crossings = road.crossings;
  markings.farthest = road.farthest;
  markings.misfit_before = markings.misfit_after = road.misfit;
  ConstraintReport by_markings{"lane_markings",
                               fmt::format("{} dashes, {} crossings to {:.0f} m", road.dashes,
                                           road.crossings, road.farthest),
                               0.0,
                               true,
                               {}};
  ScaledRoad out{prior(options.noise.painted_size), true, {}, {}, std::move(markings), {}, 0.0};
  out.by_ego_height = true;
  if (!frames.known.camera_height) {
    out.reports = {by_markings, {"camera_height", "", 0.0, false, "not given"}};
    return out;
  }
  const double given = *frames.known.camera_height;
  const Constraint height =
      camera_height_constraint(out.road, given, frames.known.camera_height_sigma);
  const double off = std::log(given / ground.ego.height);
  FusedRoad fused = fuse(out.road, {height});
  ConstraintReport by_height = fused.reports.front();
  by_markings.residual_sigma = by_height.residual_sigma;
  if (by_height.accepted) {
    out.road = std::move(fused.road);
  } else {
    by_markings.accepted = false;
    by_markings.reason =
        fmt::format("{:.1f} standard deviations off the given metres", by_height.residual_sigma);
    by_height.accepted = true;
    by_height.reason.clear();
    const RoadPosterior open = prior(kOpenLogScale);
    out.road =
        open.conditioned(camera_height_constraint(open, given, frames.known.camera_height_sigma));
  }
  const double to_result = std::log(out.road.metres_per_baseline());
  const double shape = ground.ego.relative_sigma;
  ScaleEvidence paint =
      evidence_of("lane_markings", by_markings.source, -to_result, options.noise.painted_size);
  paint.against_others =
      Disagreement{-off, by_markings.residual_sigma,
                   fmt::format("lane_markings ({}): {}; by them {}", by_markings.source,
                               by_markings.reason, larger_or_smaller(-off))};
  out.evidence = {evidence_of("camera_height", by_height.source, off - to_result,
                              std::hypot(frames.known.camera_height_sigma / given, shape)),
                  std::move(paint)};
  out.scale_change = std::log(out.road.metres_per_baseline());
  out.reports = {by_height, by_markings};
  return out;
}

}  // namespace camber::stages
