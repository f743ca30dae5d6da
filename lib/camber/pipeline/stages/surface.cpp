#include "camber/pipeline/stages/surface.h"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "camber/core/threads.h"

namespace camber::stages {
namespace {

constexpr const char* kEdgeOn = "the road is seen edge-on there and may fall away unseen";

/// Tangent plane of the road at a pixel, m.
std::optional<Plane> tangent_at(const RoadPosterior& road, const PinholeCamera& camera,
                                const Eigen::Vector2d& pixel) {
  // From three inverse depths: rho = m . ray.
  Eigen::Matrix3d rays;
  Eigen::Vector3d rho;
  const Eigen::Vector2d corners[3] = {{-4, 3}, {4, 3}, {0, -3}};
  for (int k = 0; k < 3; ++k) {
    const Eigen::Vector2d p = pixel + corners[k];
    rays.row(k) = camera.ray(p).transpose();
    rho[k] = road.inverse_depth(p);
  }
  const Eigen::Vector3d m = rays.inverse() * rho;
  if (!(m.norm() > 0)) return std::nullopt;
  return Plane{-m / m.norm(), 1.0 / m.norm()};
}

/// Where a ray from another camera of the run meets the ground; reference frame, m.
std::optional<Eigen::Vector3d> meet_ground(const RoadPosterior& road, const PinholeCamera& camera,
                                           const SE3& reference_from_frame,
                                           const Eigen::Vector3d& ray) {
  const Eigen::Vector3d origin = reference_from_frame.translation();
  const Eigen::Vector3d direction = reference_from_frame.rotation() * ray;
  const auto meet = [&](const Plane& plane) -> std::optional<Eigen::Vector3d> {
    const double s = -plane.signed_distance(origin) / plane.normal.dot(direction);
    if (!(s > 0) || !std::isfinite(s)) return std::nullopt;
    return Eigen::Vector3d(origin + s * direction);
  };
  std::optional<Eigen::Vector3d> x = meet(road.ego().plane);
  if (!x) x = origin + direction * 30.0;
  for (int iteration = 0; iteration < 15; ++iteration) {
    const auto pixel = camera.project(*x);
    if (!pixel) return std::nullopt;
    const auto tangent = tangent_at(road, camera, *pixel);
    if (!tangent) return std::nullopt;
    const auto next = meet(*tangent);
    if (!next) return std::nullopt;
    const double change = (*next - *x).norm() / next->norm();
    x = change > 0.5 ? Eigen::Vector3d(*x + 0.5 * (*next - *x)) : *next;
    if (change < 1e-6) break;
  }
  return x;
}

/// What the masks show most of inside a box: road or pavement.
/// @param hidden  the answer where they show ground in less than half of it.
PatchKind kind_of(const LoadedFrames& frames, const Box2& box,
                  std::optional<PatchKind> hidden = std::nullopt) {
  if (!frames.has_masks()) return PatchKind::kRoad;
  const FrameMasks& masks = frames.reference_masks();
  const int width = frames.camera.width;
  const Box2 in = box.clipped(width, frames.camera.height);
  long road = 0, pavement = 0, all = 0;
  for (int v = static_cast<int>(in.y1); v <= static_cast<int>(in.y2); ++v) {
    for (int u = static_cast<int>(in.x1); u <= static_cast<int>(in.x2); ++u) {
      const std::size_t p = static_cast<std::size_t>(v) * static_cast<std::size_t>(width) +
                            static_cast<std::size_t>(u);
      ++all;
      road += masks.roadway[p] != 0;
      pavement += masks.ground[p] != 0 && masks.roadway[p] == 0;
    }
  }
  if (hidden && 2 * (road + pavement) < all) return *hidden;
  return pavement > road ? PatchKind::kPavement : PatchKind::kRoad;
}

/// The row below which the ground at x / z = `slope` is nearer than `depth`; negative: none.
double row_at(const RoadPosterior& road, const PinholeCamera& camera, double slope, double depth) {
  const double column = camera.cx + camera.fx * slope;
  for (double v = camera.height - 1; v > road.top() + 1; v -= 1.0) {
    const double rho = road.inverse_depth({column, v});
    if (!(rho > 0)) return -1.0;
    if (1.0 / rho >= depth) return v;
  }
  return -1.0;
}

/// Depth of the farthest row in which the ground is seen on a column, above `row`; 0: none.
double farthest_seen(const RoadPosterior& road, double column, double row) {
  for (double v = road.top(); v < row; v += 2.0) {
    const Eigen::Vector2d pixel(column, v);
    const double rho = road.inverse_depth(pixel);
    if (road.observed(pixel) > 0.5 && rho > 0) return 1.0 / rho;
  }
  return 0.0;
}

/// Ground points inside a box of the reference image that agree with the field.
int count_points(const Correspondences& matches, const Ground& ground, const Box2& box) {
  int count = 0;
  const std::vector<double>& weights = ground.field->weights();
  for (std::size_t i = 0; i < std::min(ground.seen.points.size(), weights.size()); ++i) {
    const auto at = static_cast<std::size_t>(ground.seen.points.grid[i]);
    if (weights[i] > 0.4 && box.contains(matches.pixels[at].cast<double>())) ++count;
  }
  return count;
}

/// Whether a plane is seen so flatly that the road may fall away behind what is seen of it.
bool is_grazing(const UncertainPlane& plane, const PinholeCamera& camera,
                const SurfaceOptions& options) {
  return std::abs(plane.plane.offset) < options.grazing_px / camera.fx * plane.centroid.norm();
}

std::vector<PatchFootprint> road_ahead(const LoadedFrames& frames, const MotionEstimate& motion,
                                       const RoadPosterior& road, const SurfaceOptions& options) {
  const PinholeCamera& camera = frames.camera;
  std::vector<PatchFootprint> out;
  PatchFootprint patch;
  patch.local = options.under_vehicle;
  patch.local.length = options.patch_length;
  patch.local.half_width = options.patch_half_width;
  const Eigen::Vector3d travel = travel_direction(motion, frames.reference);
  const Eigen::Vector3d foot = road.ego().centroid;
  const double nearest = road.inverse_depth({camera.cx, static_cast<double>(camera.height - 1)});
  const double first = nearest > 0 ? std::clamp(1.0 / nearest + 0.1, 2.0, 15.0) : 5.0;
  for (double station = first; station < options.reach; station += options.patch_length) {
    const Eigen::Vector3d ahead = foot + travel * station;
    const double slope = ahead.x() / ahead.z();
    const double row = row_at(road, camera, slope, ahead.z());
    if (row < 0) break;
    if (row > camera.height - 2) continue;  // nearer than what is seen
    // Beyond a crest several stations lie in the row in which the road comes into view again.
    if (!out.empty() && row >= out.back().contact.y()) continue;
    patch.contact = {camera.cx + camera.fx * slope, row};
    const double half = options.patch_half_width * camera.fx / ahead.z();
    const double end = std::max(road.top(), row - (row - camera.cy) * options.patch_length /
                                                      (options.patch_length + ahead.z()));
    patch.around = {patch.contact.x() - half, std::min(end, row), patch.contact.x() + half, row};
    patch.plane = fit_local_plane(road, camera, patch.contact, patch.local);
    const LocalPlane& fit = patch.plane;
    if (fit.status == Status::kFailed) break;
    if (std::sqrt(fit.plane.covariance(2, 2)) > options.worst_height) break;
    // Not beyond the last row in which the ground is seen: the ground may fall away there.
    const double end_depth = farthest_seen(road, patch.contact.x(), row);
    const double beyond = end_depth > 0 ? end_depth - fit.plane.centroid.z() : 0.0;
    patch.ahead = std::clamp(beyond, 0.5, 0.5 * options.patch_length);
    // Behind a car ahead only its sides are seen: the road goes on as it was.
    patch.kind = kind_of(frames, patch.around, patch.kind);
    patch.inliers = static_cast<int>(std::lround(fit.observed));
    patch.unobserved = fit.observed < 0.5 ? "hardly any road point is seen there"
                       : is_grazing(fit.plane, camera, options) ? kEdgeOn
                                                                : "";
    out.push_back(patch);
  }
  return out;
}

/// The footprint under a detection: in the reference image, where its own frame's ray to the box's
/// bottom meets the ground.
std::optional<PatchFootprint> footprint_under(const LoadedFrames& frames, const RoadPosterior& road,
                                              std::size_t frame, const SE3& reference_from_frame,
                                              const VehicleDetection& detection,
                                              const SurfaceOptions& options) {
  const PinholeCamera& camera = frames.camera;
  PatchFootprint out;
  out.local = options.under_vehicle;
  out.ahead = 0.5 * out.local.length;
  const Eigen::Vector2d bottom(detection.box.center().x(),
                               std::min(detection.box.y2, camera.height - 1.0));
  out.contact = bottom;
  out.around = detection.box.scaled(options.box_expansion);
  if (frame != frames.reference) {
    const auto x = meet_ground(road, camera, reference_from_frame, camera.ray(bottom));
    const auto contact = x ? camera.project(*x) : std::nullopt;
    if (!contact) return std::nullopt;
    const Eigen::Vector2d shift = *contact - bottom;
    out.contact = *contact;
    out.around = {out.around.x1 + shift.x(), out.around.y1 + shift.y(), out.around.x2 + shift.x(),
                  out.around.y2 + shift.y()};
  }
  out.plane = fit_local_plane(road, camera, out.contact, out.local);
  if (out.plane.status == Status::kFailed) return std::nullopt;
  // The ground around the box's lower edge, since the vehicle hides what it stands on.
  const Box2& a = out.around;
  out.kind = kind_of(frames, {a.x1, out.contact.y() - 0.15 * a.height(), a.x2,
                              out.contact.y() + 0.15 * a.height()});
  return out;
}

}  // namespace

void SurfaceOptions::validate() const {
  const auto require_positive = [](const char* name, double value) {
    if (!(value > 0.0)) {
      throw std::invalid_argument(fmt::format("{}: {}, must be greater than 0", name, value));
    }
  };
  require_positive("patch_length", patch_length);
  require_positive("patch_half_width", patch_half_width);
  require_positive("reach", reach);
  require_positive("worst_height", worst_height);
  require_positive("box_expansion", box_expansion);
  if (!(grazing_px >= 0.0)) {
    throw std::invalid_argument(fmt::format("grazing_px: {}, must be at least 0", grazing_px));
  }
  under_vehicle.validate();
}

SurfacePlan surface(const LoadedFrames& frames, const Correspondences& matches,
                    const MotionEstimate& motion, const Ground& ground, const RoadPosterior& road,
                    const SurfaceOptions& options) {
  options.validate();
  constexpr int kFewPoints = 20;
  struct Detection {
    std::size_t frame, at;
  };
  SurfacePlan out;
  std::vector<SE3> reference_from;
  std::vector<Detection> detections;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    const std::size_t count = frames.frames[k].vehicles.size();
    reference_from.push_back(metric_pose(motion, k, road.metres_per_baseline()).inverse());
    out.under_vehicles.emplace_back(count);
    for (std::size_t i = 0; i < count; ++i) detections.push_back({k, i});
  }
  // The first takes longest.
  parallel_for(1 + detections.size(), options.num_threads, [&](std::size_t task) {
    if (task == 0) {
      out.road = road_ahead(frames, motion, road, options);
      return;
    }
    const auto [k, i] = detections[task - 1];
    const VehicleDetection& detection = frames.frames[k].vehicles[i];
    if (!options.under_vehicles || detection.has_plane) return;
    auto patch = footprint_under(frames, road, k, reference_from[k], detection, options);
    if (patch) patch->inliers = count_points(matches, ground, patch->around);
    out.under_vehicles[k][i] = std::move(patch);
  });
  int next = 1;
  for (PatchFootprint& patch : out.road) patch.id = next++;
  for (auto& patches : out.under_vehicles) {
    for (std::optional<PatchFootprint>& patch : patches) {
      if (!patch) continue;
      patch->id = next++;
      if (patch->inliers < kFewPoints) {
        patch->unobserved = fmt::format("only {} road points around the vehicle", patch->inliers);
      } else if (is_grazing(patch->plane.plane, frames.camera, options)) {
        patch->unobserved = kEdgeOn;
      }
    }
  }
  return out;
}

}  // namespace camber::stages
