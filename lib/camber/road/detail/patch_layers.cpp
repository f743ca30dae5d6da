#include "camber/road/detail/patch_layers.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "camber/core/threads.h"
#include "camber/plane/detail/plane_coverage.h"
#include "camber/plane/detail/plane_sample.h"
#include "camber/plane/detail/repeated_values.h"
#include "camber/plane/noise_model.h"
#include "camber/road/detail/patch_labels.h"
#include "camber/road/ground_tree.h"
#include "camber/road/patch_segmentation.h"
#include "camber/road/plan_polygon.h"

namespace camber::detail {

using Eigen::Vector2d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

constexpr double kRoughness = 0.01;      // m, of ground; its points lie on no plane more tightly
constexpr double kCrowded = 0.12;        // share of crowded leaves that shows another layer
constexpr double kFloatRounding = 4e-7;  // of the spread, of coordinates and their sums
const Vector3d kLevelUp = Vector3d::UnitZ();

/// Whether points that lie on a plane but for the ground's roughness lie farther off it than their
/// noise alone carries them.
bool is_rough(PointArrays* points, const PlaneCandidate& candidate, const NoiseModel& rough) {
  constexpr double kMedianOfNormal = 0.6745, kMore = 1.6;
  points->weigh(candidate.noise, candidate.plane);
  const std::vector<float> weights = points->w;
  points->weigh(rough, candidate.plane);
  const kernels::FloatPlane p = candidate.plane.as_float();
  std::vector<float> sizes;
  for (std::size_t k = 0; k < points->size; ++k) {
    const float r = p.nx * points->x[k] + p.ny * points->y[k] + p.nz * points->z[k] + p.d;
    if (!(points->w[k] > 0.0f) || !(r * r * points->w[k] < kInlierSigmas * kInlierSigmas)) continue;
    sizes.push_back(std::abs(r) * std::sqrt(weights[k]));
  }
  return sizes.size() >= 20 && quantile(sizes, 0.5) > kMore * kMedianOfNormal;
}

/// What rounding and copying have done to a cloud.
struct Repetition {
  double step = 0.0;    ///< m, of heights; 0: none
  double copies = 1.0;  ///< see take_copies()
};

Repetition find_repetition(const RoadCloud& cloud, const GroundTree& tree) {
  Repetition out;
  const PointArrays& s = tree.points();
  std::vector<float> heights;
  const std::size_t stride = 1 + tree.size() / kPlaneSample;
  for (const GroundTree::Leaf& leaf : tree.leaves()) {
    for (std::size_t k = leaf.begin; k < leaf.end; k += stride) heights.push_back(s.z[k]);
  }
  out.step = coordinate_step(heights, kFloatRounding * tree.spread());
  std::vector<std::uint32_t> rows;
  for (std::size_t i = 0; i < cloud.size(); i += 1 + cloud.size() / kPlaneSample) {
    // Rays that met nothing lie at zero.
    const Eigen::Vector3f& p = cloud.points[i];
    if (p.allFinite() && !p.isZero(0.0f)) rows.push_back(static_cast<std::uint32_t>(i));
  }
  PointColumns columns;
  columns.x = cloud.points.front().data();
  columns.y = columns.x + 1;
  columns.z = columns.x + 2;
  columns.stride = 3;
  columns.size = cloud.size();
  out.copies = take_copies(columns, &rows);
  return out;
}

/// The sums of a region over the points of a part.
void sum_part(const GroundTree& tree, const std::vector<std::uint32_t>& rows, const CloudPart& part,
              const PlaneCandidate& c, const Repetition& repetition, PatchSums* sums) {
  std::vector<std::uint32_t> own;
  for (const std::uint32_t row : rows) {
    if (part.own[tree.cloud_index()[row]]) own.push_back(row);
  }
  PointArrays points;
  points.take(tree.points(), own);
  points.weigh(c.noise, c.plane);
  constexpr double kLimit = kBiweight * kBiweight;
  PlaneWindow window = c.window;
  align(c.plane, &window);
  sums->fit = sum_moments(points, c.plane, window, kLimit, kernels::Loss::kReweighted, false);
  sums->influence = sum_moments(points, c.plane, window, kLimit, kernels::Loss::kNewton, true);
  count_places_once(repetition.copies, &sums->influence);
  sums->errors.places = sums->influence.count / repetition.copies;
  const Eigen::Matrix3d back = tree.frame().level_from_cloud.transpose();
  sums->center = tree.frame().to_cloud(window.center);
  sums->a = back * window.a;
  sums->b = back * window.b;
  sums->normal = back * c.plane.n;
}

/// Fits one region on the points of its leaves.
/// @param shared  share of the stated deviations that points have in common
/// @param part    as in find_patch_layers(); its sums are written
void refine_region(const GroundTree& tree, double least_noise, double roughness, bool fixed_noise,
                   double shared, const Repetition& repetition, const CloudPart* part,
                   PlanarRegion* region, PatchSums* sums) {
  const PointArrays& s = tree.points();
  std::vector<std::uint32_t> rows;
  for (const int leaf : region->leaves) {
    const GroundTree::Leaf& l = tree.leaves()[static_cast<std::size_t>(leaf)];
    for (std::size_t k = l.begin; k < l.end; ++k) rows.push_back(static_cast<std::uint32_t>(k));
  }
  PointArrays points;
  points.take(s, rows);
  PlaneCandidate& c = region->candidate;
  if (!fixed_noise && roughness > 0.0) {
    NoiseModel rough = c.noise;
    rough.least = std::max(rough.least, roughness);
    if (is_rough(&points, c, rough)) c.noise = rough;
  }
  // Errors in common bend the ground: what they are is stated, and not seen as scatter.
  refine_and_window(&points, kLevelUp, least_noise, fixed_noise || shared > 0.0, &c);
  points.weigh(c.noise, c.plane);
  const kernels::Moments moments =
      sum_moments(points, c.plane, c.window, kBiweight * kBiweight, kernels::Loss::kNewton, true);
  if (!(moments.weight > 0.0)) {
    region->estimate.status = Status::kFailed;
    return;
  }
  std::optional<UnknownRays> rays;
  if (c.noise.kind != NoiseKind::kRays) rays = unknown_rays(points, c.plane, c.window);
  kernels::Moments influence = moments;
  count_places_once(repetition.copies, &influence);
  PlanePointErrors errors;
  errors.noise = measured_noise(points, c.plane, c.window);
  errors.places = moments.count / repetition.copies;
  errors.shared = std::hypot(shared * std::sqrt(moments.count / moments.weight),
                             kFloatRounding * tree.spread());
  region->estimate =
      estimate_covariance(c.plane, c.window, moments, influence, errors, kLevelUp, rays);
  if (!part) return;
  sum_part(tree, rows, *part, c, repetition, sums);
  const double places = sums->errors.places;
  sums->errors = errors;
  sums->errors.places = places;
  sums->rays = rays;
}

/// Outline of a region in plan: the hull of its points in its own leaves, without the strays that
/// noise has carried out at the ends, and half their spacing around it.
/// @param part  nullptr, or the points that count
PlanPolygon outline(const GroundTree& tree, const PlanarRegion& region, int id,
                    const std::vector<int>& row_labels, const CloudPart* part) {
  std::vector<Vector2d> places;
  for (const int leaf : region.leaves) {
    const GroundTree::Leaf& l = tree.leaves()[static_cast<std::size_t>(leaf)];
    for (std::size_t k = l.begin; k < l.end; ++k) {
      if (row_labels[k] != id || (part && !part->own[tree.cloud_index()[k]])) continue;
      const float x = tree.points().x[k], y = tree.points().y[k];
      if (x < l.low[0] || x > l.high[0] || y < l.low[1] || y > l.high[1]) continue;
      places.emplace_back(static_cast<double>(x), static_cast<double>(y));
    }
  }
  const double count = static_cast<double>(places.size());
  const PlanPolygon hull = convex_hull(std::move(places));
  if (hull.size() < 3) return hull;
  // Each point stands for the ground around it, half way to the next.
  const double half = 0.5 * std::sqrt(polygon_area(hull) / count);
  std::vector<Vector2d> around;
  for (std::size_t k = 0; k < hull.size(); ++k) {
    const Vector2d &from = hull[k], &to = hull[(k + 1) % hull.size()];
    const Vector2d out = half * Vector2d(to.y() - from.y(), from.x() - to.x()).normalized();
    around.push_back(from + out);
    around.push_back(to + out);
  }
  return convex_hull(std::move(around));
}

/// Whether a good part of a leaf's points lie off its plane, but at one height above or below it.
bool has_another_sheet(const GroundTree& tree, std::size_t leaf, const PlanarRegion& region,
                       const std::vector<int>& row_labels) {
  const GroundTree::Leaf& l = tree.leaves()[leaf];
  std::vector<double> off;
  for (std::size_t k = l.begin; k < l.end; ++k) {
    if (row_labels[k] < 0) off.push_back(region.candidate.plane.distance(tree.points().point(k)));
  }
  const std::size_t least = (l.end - l.begin) / 4;
  if (off.size() <= least) return false;
  std::sort(off.begin(), off.end());
  constexpr double kWide = 5.75;  // standard deviations of a point
  const double width = kWide * region.estimate.noise;
  std::size_t most = 0, from = 0;
  for (std::size_t to = 0; to < off.size(); ++to) {
    while (off[to] - off[from] > width) ++from;
    most = std::max(most, to - from + 1);
  }
  return most > least && 5 * most >= 2 * off.size();
}

/// A region's plane and outline in the cloud's frame.
PlanePatch make_patch(const GroundTree& tree, const PlanarRegion& region,
                      const PlanPolygon& polygon) {
  const Eigen::Matrix3d back = tree.frame().level_from_cloud.transpose();
  PlanePatch patch;
  patch.status = region.estimate.status;
  patch.reason = region.estimate.reason;
  patch.noise = region.estimate.noise;
  const UncertainPlane& level = region.estimate.plane;
  patch.plane.centroid = tree.frame().to_cloud(level.centroid);
  patch.plane.plane = Plane::through(patch.plane.centroid, back * level.plane.normal);
  patch.plane.axis1 = back * level.axis1;
  patch.plane.axis2 = back * level.axis2;
  patch.plane.covariance = level.covariance;
  const PivotPlane& p = region.candidate.plane;
  for (const Vector2d& corner : polygon) {
    const double z = -(p.n.x() * corner.x() + p.n.y() * corner.y() + p.d) / p.n.z();
    patch.boundary.push_back(tree.frame().to_cloud({corner.x(), corner.y(), z}));
  }
  return patch;
}

/// How the noise of a layer's points is known before it is learnt.
/// @param known  an earlier layer, or nullptr
NoiseModel start_noise(const RoadCloud& cloud, const GroundTree& tree,
                       const std::optional<Vector3d>& viewpoint, bool fixed_noise,
                       const PatchLayer* known) {
  NoiseModel noise;
  if (known) {
    noise = known->model;
    if (noise.kind == NoiseKind::kRays) noise.viewpoint = tree.frame().to_level(*viewpoint);
  } else if (!fixed_noise) {
    if (!cloud.covariances.empty()) {
      noise.kind = NoiseKind::kCovariance;
    } else if (!cloud.sigmas.empty() && viewpoint) {
      noise.kind = NoiseKind::kRays;
      noise.viewpoint = tree.frame().to_level(*viewpoint);
    } else if (!cloud.sigmas.empty()) {
      noise.kind = NoiseKind::kPower;
    }
  }
  return noise;
}

SegmentationOptions segmentation_options_of(const RoadCloud& cloud,
                                            const RoadSurfaceOptions& options,
                                            const PatchLayer* known) {
  SegmentationOptions out;
  out.seed = options.seed;
  out.num_threads = options.num_threads;
  out.max_slope = options.max_slope;
  out.inlier_threshold = options.inlier_threshold;
  out.tolerance_sigmas = options.tolerance_sigmas;
  out.tolerance = cloud.metric ? options.tolerance : 0.0;
  out.roughness = cloud.metric ? kRoughness : 0.0;
  out.min_points = options.min_patch_points;
  out.noise_is_known = known != nullptr;
  out.shared = known ? known->shared : 0.0;
  return out;
}

/// In plan, in the cloud's frame.
Vector2d middle_of(const GroundTree& tree, std::size_t leaf) {
  const GroundTree::Leaf& l = tree.leaves()[leaf];
  const Eigen::Array2d middle = 0.5 * (l.low + l.high).cast<double>();
  return tree.frame().to_cloud({middle[0], middle[1], 0.0}).head<2>();
}

/// The borders of a layer's patches, and how many of their leaves are crowded.
/// @param id_of  patch of each region, or -1
void measure_borders(const GroundTree& tree, const Segmentation& segmentation,
                     const std::vector<int>& row_labels, const std::vector<int>& id_of,
                     const CloudPart* part, PatchLayer* layer) {
  double leaves = 0.0, crowded = 0.0;
  for (std::size_t leaf = 0; leaf < tree.leaves().size(); ++leaf) {
    const int region = segmentation.leaf_region[leaf];
    const int a = region < 0 ? -1 : id_of[static_cast<std::size_t>(region)];
    if (a < 0) continue;
    leaves += 1.0;
    if (has_another_sheet(tree, leaf, segmentation.regions[static_cast<std::size_t>(region)],
                          row_labels)) {
      crowded += 1.0;
    }
    if (part && !part->box.contains(middle_of(tree, leaf))) continue;
    for (const int other : tree.neighbours()[leaf]) {
      const int next = segmentation.leaf_region[static_cast<std::size_t>(other)];
      const int b = next < 0 ? -1 : id_of[static_cast<std::size_t>(next)];
      if (b > a) ++layer->borders[{a, b}];
    }
  }
  layer->crowded = crowded / std::max(leaves, 1.0);
}

PatchLayer find_patches_once(const RoadCloud& cloud, const Vector3d& up,
                             const std::optional<Vector3d>& viewpoint,
                             const RoadSurfaceOptions& options, const PatchLayer* known,
                             const CloudPart* part, const std::function<void(double)>& report) {
  PatchLayer layer;
  layer.labels.assign(cloud.size(), -1);
  GroundTree tree(cloud, up, options.seed, kMostPatchPoints, options.num_threads);
  if (tree.size() < 3) {
    layer.reason = fmt::format("{} usable points, at least 3 are needed", tree.size());
    return layer;
  }
  if (!(tree.spread() > 0.0)) {
    layer.reason = "all points lie at one place";
    return layer;
  }
  report(0.2);

  const bool fixed_noise = options.inlier_threshold > 0.0;
  const Repetition repetition = find_repetition(cloud, tree);
  const double rounding = rounding_deviation(repetition.step);
  NoiseModel noise = start_noise(cloud, tree, viewpoint, fixed_noise, known);
  if (!fixed_noise) noise.least = std::max(noise.least, rounding);
  const SegmentationOptions segmentation_options = segmentation_options_of(cloud, options, known);
  Segmentation segmentation = segment_planes(tree, noise, segmentation_options);
  report(0.6);
  if (segmentation.regions.empty()) {
    const bool by_sigma = cloud.covariances.empty() && !cloud.sigmas.empty();
    layer.reason = by_sigma && !any_usable_sigma(cloud.sigmas) ? "no point has a sigma above 0"
                                                               : "no planar ground was found";
    return layer;
  }

  const double least_noise = std::max({kFloatRounding * tree.spread(), 1e-9, rounding});
  std::vector<PatchSums> sums(segmentation.regions.size());
  parallel_for(segmentation.regions.size(), options.num_threads, [&](std::size_t region) {
    refine_region(tree, least_noise, segmentation_options.roughness, fixed_noise,
                  segmentation.shared, repetition, part, &segmentation.regions[region],
                  &sums[region]);
  });
  layer.model = segmentation.noise;
  layer.shared = segmentation.shared;
  layer.local_noise = segmentation.local_noise;
  layer.typical = segmentation.typical_noise;
  if (known && known->typical > 0.0) {
    // What is left over by another layer may be rubbish: only what is as smooth counts.
    constexpr double kRough = 2.2;
    for (PlanarRegion& region : segmentation.regions) {
      if (region.estimate.noise > kRough * known->typical) region.estimate.status = Status::kFailed;
    }
  }
  report(0.8);

  PatchLabels labels = label_patches(cloud, cloud.size() <= kMostPatchPoints, tree, segmentation,
                                     options.num_threads);
  const std::vector<int>& row_labels = labels.rows;
  layer.labels = std::move(labels.cloud);
  std::vector<int> counts(segmentation.regions.size(), 0);
  for (const int label : layer.labels) {
    if (label >= 0) ++counts[static_cast<std::size_t>(label)];
  }

  std::vector<int> id_of(segmentation.regions.size(), -1);
  for (std::size_t r = 0; r < segmentation.regions.size(); ++r) {
    const PlanarRegion& region = segmentation.regions[r];
    if (region.estimate.status == Status::kFailed || counts[r] < options.min_patch_points) continue;
    const PlanPolygon polygon = outline(tree, region, static_cast<int>(r), row_labels, nullptr);
    if (polygon.size() < 3) continue;
    PlanePatch patch = make_patch(tree, region, polygon);
    patch.id = static_cast<int>(layer.patches.size());
    patch.inliers = counts[r];
    id_of[r] = patch.id;
    layer.noise.push_back(static_cast<float>(region.estimate.noise));
    layer.patches.push_back(std::move(patch));
    if (!part) continue;
    for (const Vector2d& corner : outline(tree, region, static_cast<int>(r), row_labels, part)) {
      sums[r].outline.push_back(tree.frame().to_cloud({corner.x(), corner.y(), 0.0}).head<2>());
    }
    layer.sums.push_back(std::move(sums[r]));
  }
  for (int& label : layer.labels) {
    if (label >= 0) label = id_of[static_cast<std::size_t>(label)];
  }
  if (layer.patches.empty()) layer.reason = "no planar ground was found";

  measure_borders(tree, segmentation, row_labels, id_of, part, &layer);
  return layer;
}

}  // namespace

PatchLayer find_patch_layers(const RoadCloud& cloud, const Vector3d& up,
                             const std::optional<Vector3d>& viewpoint,
                             const RoadSurfaceOptions& options, const CloudPart* part,
                             const std::function<void(double)>& report) {
  PatchLayer out = find_patches_once(cloud, up, viewpoint, options, nullptr, part, report);
  if (out.patches.empty()) return out;
  // Ground above ground: where much is left over in the patches' own places, look again there.
  double crowded = out.crowded;
  for (int again = 0; again < 2 && crowded > kCrowded; ++again) {
    std::vector<int> rest;
    for (std::size_t i = 0; i < out.labels.size(); ++i) {
      if (out.labels[i] < 0) rest.push_back(static_cast<int>(i));
    }
    CloudPart rest_part;
    if (part) {
      rest_part.box = part->box;
      for (const int i : rest) rest_part.own.push_back(part->own[static_cast<std::size_t>(i)]);
    }
    PatchLayer next = find_patches_once(cloud.select(rest), up, viewpoint, options, &out,
                                        part ? &rest_part : nullptr, [](double) {});
    if (next.patches.empty()) break;
    const int base = static_cast<int>(out.patches.size());
    for (std::size_t k = 0; k < rest.size(); ++k) {
      if (next.labels[k] >= 0)
        out.labels[static_cast<std::size_t>(rest[k])] = base + next.labels[k];
    }
    for (const PlanePatch& patch : next.patches) {
      out.patches.push_back(patch);
      out.patches.back().id += base;
    }
    for (const auto& [pair, number] : next.borders) {
      out.borders[{pair.first + base, pair.second + base}] = number;
    }
    out.noise.insert(out.noise.end(), next.noise.begin(), next.noise.end());
    std::move(next.sums.begin(), next.sums.end(), std::back_inserter(out.sums));
    crowded = next.crowded;
  }
  return out;
}

}  // namespace camber::detail
