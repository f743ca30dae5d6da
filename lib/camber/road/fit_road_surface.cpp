#include "camber/road/fit_road_surface.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>

#include "camber/road/detail/patch_blocks.h"
#include "camber/road/detail/patch_kinds.h"
#include "camber/road/detail/patch_layers.h"
#include "camber/road/unmodelled.h"

namespace camber {

using Eigen::Vector3d;

namespace {

void require(bool good, const char* field, double value, const char* bound) {
  if (!good) {
    throw std::invalid_argument(
        fmt::format("RoadSurfaceOptions::{} is {}, expected {}", field, value, bound));
  }
}

RoadSurface start_surface(CloudFrame frame, bool metric, const Vector3d& default_up,
                          const RoadSurfaceOptions& options) {
  RoadSurface surface;
  const Vector3d up = options.up ? options.up->normalized() : default_up;
  surface.up = up;
  surface.metric = metric;
  surface.frame = frame == CloudFrame::kCamera             ? "camera"
                  : (up - Vector3d::UnitZ()).norm() < 1e-9 ? "z-up"
                                                           : "other";
  // A map's up is gravity's; a camera's own is its level, another one was measured.
  const bool of_camera = frame == CloudFrame::kCamera && (up - default_up).norm() < 1e-9;
  surface.level = of_camera ? RoadSurface::Level::kCamera : RoadSurface::Level::kGravity;
  surface.driven_line = options.driven_line;
  return surface;
}

std::optional<Vector3d> viewpoint_of(CloudFrame frame, const RoadSurfaceOptions& options) {
  if (!options.viewpoint && frame == CloudFrame::kCamera) return Vector3d::Zero();
  return options.viewpoint;
}

/// Links, kinds and the graph of a surface whose patches are there; the fit's status.
/// @param measure  sets the patches' unmodelled_sigma
void finish_surface(const RoadSurfaceOptions& options, const detail::PatchBorders& borders,
                    const std::optional<Vector3d>& viewpoint, double local_noise,
                    const std::function<void(RoadSurface*)>& measure, RoadSurfaceFit* fit) {
  RoadSurface& surface = fit->surface;
  surface.links = find_links(surface, options.consistency);
  detail::classify_patches(options.consistency, borders, &surface);
  align_patches_with_road(&surface);
  optimise_surface(options.consistency, &surface);
  measure(&surface);
  // What a patch alone leaves open its neighbours may fix.
  for (PlanePatch& patch : surface.patches) {
    const Eigen::Vector3d variance = patch.plane.covariance.diagonal();
    if (patch.status == Status::kWeak && patch.inliers >= static_cast<int>(kFewPlaces) &&
        std::max(variance[0], variance[1]) <= kWeakTilt * kWeakTilt) {
      patch.status = Status::kOk;
      patch.reason.clear();
    }
  }
  // The ego patch: the road under the camera or at the start of the driven line.
  std::optional<Vector3d> ego = viewpoint;
  if (!surface.driven_line.empty()) ego = surface.driven_line.front();
  if (ego) {
    const SurfaceQuery answer = surface.query(*ego, 15.0);
    const PlanePatch* patch = surface.find(answer.patch);
    if (patch && patch->kind == PatchKind::kRoad) surface.ego_patch = patch->id;
  }
  const bool road_is_known = !surface.driven_line.empty() || surface.frame == "camera";
  if (!road_is_known && !options.largest_is_road) detail::name_ground(&surface);
  fit->status = Status::kOk;
  if (local_noise > options.inlier_threshold && options.inlier_threshold > 0.0) {
    fit->status = Status::kWeak;
    fit->reason = fmt::format(
        "points scatter about their planes by {:.2g} m, more than the threshold of {:.2g} m, "
        "within "
        "which planes break into many patches; with {:.2g} m they do not",
        local_noise, options.inlier_threshold, kInlierSigmas * local_noise);
  }
}

}  // namespace

void RoadSurfaceOptions::validate() const {
  if (up)
    require(up->allFinite() && up->norm() > 0.0, "up (its length)", up->norm(), "a direction");
  require(max_slope > 0.0 && max_slope <= 1.4, "max_slope", max_slope, "(0, 1.4] rad");
  require(inlier_threshold >= 0.0 && std::isfinite(inlier_threshold), "inlier_threshold",
          inlier_threshold, ">= 0 m");
  require(min_patch_points >= 3, "min_patch_points", min_patch_points, ">= 3");
  require(tolerance_sigmas > 0.0, "tolerance_sigmas", tolerance_sigmas, "> 0");
  require(tolerance >= 0.0, "tolerance", tolerance, ">= 0 m");
  require(!viewpoint || viewpoint->allFinite(), "viewpoint (its length)",
          viewpoint ? viewpoint->norm() : 0.0, "finite numbers");
  consistency.validate();
}

RoadSurfaceFit fit_road_surface(const RoadCloud& cloud, const RoadSurfaceOptions& options,
                                const Progress& progress) {
  options.validate();
  cloud.validate();
  const auto report = [&](double share) {
    if (progress) progress("patches", share);
  };
  report(0.0);
  RoadSurfaceFit fit;
  fit.surface = start_surface(cloud.frame, cloud.metric, cloud.default_up(), options);
  // A survey: its patches hang on what lies around them alone, however far it goes on.
  if (cloud.size() > detail::kMostPatchPoints && cloud.metric && fit.surface.frame == "z-up") {
    detail::PatchBlocks found = detail::fit_patch_blocks(cloud, {}, options, progress);
    std::vector<int> patch_of_piece;
    fit = detail::surface_of_blocks(found.blocks, options, &patch_of_piece);
    fit.labels = std::move(found.labels);
    for (int& label : fit.labels) {
      if (label >= 0) label = patch_of_piece[static_cast<std::size_t>(label)];
    }
    report(1.0);
    return fit;
  }
  const std::optional<Vector3d> viewpoint = viewpoint_of(cloud.frame, options);
  detail::PatchLayer found =
      detail::find_patch_layers(cloud, fit.surface.up, viewpoint, options, nullptr, report);
  fit.labels = std::move(found.labels);
  if (found.patches.empty()) {
    fit.status = Status::kFailed;
    fit.reason = found.reason;
    return fit;
  }
  fit.surface.patches = std::move(found.patches);
  fit.noise = quantile(found.noise, 0.5);
  finish_surface(
      options, found.borders, viewpoint, found.local_noise,
      [&](RoadSurface* surface) { measure_unmodelled(cloud, fit.labels, surface); }, &fit);
  report(1.0);
  return fit;
}

RoadSurfaceFit detail::surface_of_blocks(const std::vector<PatchBlock>& blocks,
                                         const RoadSurfaceOptions& options,
                                         std::vector<int>* patch_of_piece) {
  RoadSurfaceFit fit;
  fit.surface = start_surface(CloudFrame::kZUp, true, Vector3d::UnitZ(), options);
  JoinedPieces joined = join_patch_blocks(blocks, options);
  *patch_of_piece = std::move(joined.patch_of_piece);
  if (joined.patches.empty()) {
    fit.status = Status::kFailed;
    fit.reason = joined.reason;
    return fit;
  }
  fit.surface.patches = std::move(joined.patches);
  fit.noise = quantile(joined.noise, 0.5);
  finish_surface(
      options, joined.borders, options.viewpoint, joined.local_noise,
      [&](RoadSurface* surface) { measure_unmodelled(blocks, *patch_of_piece, surface); }, &fit);
  return fit;
}

}  // namespace camber
