#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "camber/plane/plane_covariance.h"
#include "camber/road/detail/patch_kinds.h"
#include "camber/road/fit_road_surface.h"
#include "camber/road/plan_polygon.h"

namespace camber::detail {

/// What of a patch's fit is due to a part of its points, in the frame of the cloud that they are
/// relative to: it can be summed with what other patches on the same plane have.
struct PatchSums {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  ///< m, on the plane; of the window
  Eigen::Vector3d a = Eigen::Vector3d::UnitX(), b = Eigen::Vector3d::UnitY();  ///< its axes
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  plane_kernels::Moments fit;        ///< kReweighted: normal equations about the plane
  plane_kernels::Moments influence;  ///< kNewton with psi^2, copies of a point counted once
  PlanePointErrors errors;           ///< `places` of the part, the rest of all points
  std::optional<UnknownRays> rays;   ///< of all points
  PlanPolygon outline;               ///< of the part, in plan; empty: hardly any points
};

/// Points of a cloud that are segmented at once: larger ones are represented by about so many.
inline constexpr std::size_t kMostPatchPoints = 262144;

/// Patches of one layer of a cloud: at each place at most one.
struct PatchLayer {
  std::string reason;  ///< why there are no patches, if so
  std::vector<PlanePatch> patches;
  std::vector<int> labels;      ///< index of a patch, -1: none
  std::vector<float> noise;     ///< m, of each patch
  PatchBorders borders;         ///< pairs of leaves that touch, by patch index
  double crowded = 0.0;         ///< share of the patches' leaves that hold another sheet as well
  NoiseModel model;             ///< of the whole cloud
  double typical = 0.0;         ///< m
  double shared = 0.0;          ///< as in Segmentation
  double local_noise = 0.0;     ///< as in Segmentation
  std::vector<PatchSums> sums;  ///< of each patch, where a part was asked for
};

/// The part of a cloud that answers are wanted for; the rest lies around it.
struct CloudPart {
  std::vector<std::uint8_t> own;  ///< one a point
  Eigen::AlignedBox2d box;        ///< in plan, in the frame of the cloud
};

/// Finds the patches of a cloud, also where ground lies above ground: layer by layer, all joined
/// into the first. Clouds of more than kMostPatchPoints are represented by about so many.
/// @param part  nullptr: no sums, and borders everywhere; else borders whose leaves begin in it.
///              Level frames with z up only.
PatchLayer find_patch_layers(const RoadCloud& cloud, const Eigen::Vector3d& up,
                             const std::optional<Eigen::Vector3d>& viewpoint,
                             const RoadSurfaceOptions& options, const CloudPart* part,
                             const std::function<void(double)>& report);

}  // namespace camber::detail
