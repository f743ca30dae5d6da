#include "camber/road/fit_road_surface.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numeric>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/plane/detail/plane_coverage.h"
#include "camber/road/ground_tree.h"
#include "camber/road/patch_segmentation.h"
#include "camber/road/plan_polygon.h"
#include "camber/road/unmodelled.h"

namespace camber {

using Eigen::Vector2d;
using Eigen::Vector3d;
namespace kernels = plane_kernels;

namespace {

constexpr std::size_t kMostPoints = 262144;  // that take part in finding the patches
// A point belongs to a patch as far from its plane as points of the patch are more frequent than
// others; at least and at most this many standard deviations.
constexpr double kLeastLabelSigmas = 2.5, kMostLabelSigmas = 6.0;
constexpr double kRoughness = 0.01;    // m, of ground; its points lie on no plane more tightly
constexpr double kDrivenOn = 0.5;      // m, between the driven line and the patch it lies on
constexpr double kSharedBorder = 0.1;  // share of a patch's borders that joins it to the road
constexpr double kHighestKerb = 0.35, kLevel = 0.25;  // m and rad, of a pavement to its neighbours
constexpr int kFewInliers = 12;                       // whose spread does not show the noise
constexpr double kCrowded = 0.12;  // share of crowded leaves that shows another layer
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

/// Fits one region on the points of its leaves.
/// @param shared  share of the stated deviations that points have in common
void refine_region(const GroundTree& tree, double least_noise, double roughness, bool fixed_noise,
                   double shared, PlanarRegion* region) {
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
  detail::refine_and_window(&points, kLevelUp, least_noise, fixed_noise || shared > 0.0, &c);
  points.weigh(c.noise, c.plane);
  const kernels::Moments moments =
      sum_moments(points, c.plane, c.window, kBiweight * kBiweight, kernels::Loss::kNewton, true);
  if (!(moments.weight > 0.0)) {
    region->estimate.status = Status::kFailed;
    return;
  }
  std::optional<UnknownRays> rays;
  if (c.noise.kind != NoiseKind::kRays) rays = unknown_rays(points, c.plane, c.window);
  const double in_common = shared * std::sqrt(moments.count / moments.weight);
  region->estimate =
      estimate_covariance(c.plane, c.window, moments, moments, kLevelUp, rays, in_common);
}

/// How far above and below its plane a region's points reach, in standard deviations.
struct LabelGate {
  double below = kLeastLabelSigmas, above = kLeastLabelSigmas;
};

/// From the residuals in a region's leaves: outwards until there are no more than twice as many
/// points as farther out, or until there are more again (a pavement).
LabelGate measure_gate(const GroundTree& tree, const PlanarRegion& region) {
  constexpr double kBin = 0.5, kReach = 10.0;
  constexpr std::size_t kBins = 20;
  std::array<double, kBins> above{}, below{};
  const PointArrays& s = tree.points();
  const PlaneCandidate& c = region.candidate;
  std::array<float, 64> weights;
  for (const int leaf : region.leaves) {
    const GroundTree::Leaf& l = tree.leaves()[static_cast<std::size_t>(leaf)];
    const std::size_t b = l.begin, n = l.end - b;
    weights.fill(1.0f);
    c.noise.weigh(c.plane.n, c.plane.d, n, &s.x[b], &s.y[b], &s.z[b],
                  s.sigma.empty() ? nullptr : &s.sigma[b],
                  s.covariance.empty() ? nullptr : &s.covariance[b], weights.data());
    const kernels::FloatPlane p = c.plane.as_float();
    for (std::size_t k = 0; k < n; ++k) {
      if (!(weights[k] > 0.0f)) continue;
      const float r = p.nx * s.x[b + k] + p.ny * s.y[b + k] + p.nz * s.z[b + k] + p.d;
      const double t = static_cast<double>(r) * std::sqrt(static_cast<double>(weights[k]));
      if (!(std::abs(t) < kReach)) continue;
      const auto bin = static_cast<std::size_t>(std::abs(t) / kBin);
      (t > 0.0 ? above : below)[std::min(bin, kBins - 1)] += 1.0;
    }
  }
  const auto reach = [&](const std::array<double, kBins>& counts) {
    // Background: what lies between 7 and 10 standard deviations.
    double background = 0.0;
    for (std::size_t k = 14; k < kBins; ++k) background += counts[k] / 6.0;
    const auto first = static_cast<std::size_t>(kLeastLabelSigmas / kBin),
               last = static_cast<std::size_t>(kMostLabelSigmas / kBin);
    // A bin that is nearly too full or too empty counts in part, so that no single point decides.
    double sum = static_cast<double>(first), share = 1.0;
    for (std::size_t k = first; k < last && share > 0.0; ++k) {
      const double least = 2.0 * background + 1.0,
                   most = 0.9 * counts[k - 1] + 2.0 * std::sqrt(counts[k - 1]);
      const double slack = 0.5 * std::sqrt(std::max(counts[k], 4.0));
      share *= std::clamp((counts[k] - least) / slack + 0.5, 0.0, 1.0) *
               std::clamp((most - counts[k]) / slack + 0.5, 0.0, 1.0);
      sum += share;
    }
    return sum * kBin;
  };
  return {reach(below), reach(above)};
}

/// Which side of creases a place is on.
class CreaseCuts {
 public:
  explicit CreaseCuts(const std::vector<PlanarRegion>& regions) : regions_(regions) {}

  /// Whether a place belongs to region a rather than b: the sign of the difference of their heights
  /// is that at a's middle. 0 where the planes do not cross between the middles.
  int side(int a, int b, double x, double y) const {
    const PlanarRegion &ra = regions_[static_cast<std::size_t>(a)],
                       &rb = regions_[static_cast<std::size_t>(b)];
    const Vector3d &ca = ra.estimate.plane.centroid, &cb = rb.estimate.plane.centroid;
    const double at_a = difference(ra, rb, ca.x(), ca.y());
    const double at_b = difference(ra, rb, cb.x(), cb.y());
    if (!(at_a * at_b < 0.0)) return 0;
    return difference(ra, rb, x, y) * at_a >= 0.0 ? 1 : -1;
  }

 private:
  static double height(const PlanarRegion& region, double x, double y) {
    const PivotPlane& p = region.candidate.plane;
    return -(p.n.x() * x + p.n.y() * y + p.d) / p.n.z();
  }
  static double difference(const PlanarRegion& a, const PlanarRegion& b, double x, double y) {
    return height(a, x, y) - height(b, x, y);
  }
  const std::vector<PlanarRegion>& regions_;
};

/// Decides for points of one leaf which region they belong to.
class LeafLabels {
 public:
  LeafLabels(const Segmentation& segmentation, const GroundTree& tree, const CreaseCuts& cuts,
             const std::vector<LabelGate>& gates)
      : cuts_(cuts), gates_(gates) {
    choices_.resize(tree.leaves().size());
    for (std::size_t leaf = 0; leaf < choices_.size(); ++leaf) {
      std::vector<int>& list = choices_[leaf];
      const auto add = [&](int region) {
        if (region >= 0 && std::find(list.begin(), list.end(), region) == list.end()) {
          list.push_back(region);
        }
      };
      add(segmentation.leaf_region[leaf]);
      for (const int other : tree.neighbours()[leaf]) {
        add(segmentation.leaf_region[static_cast<std::size_t>(other)]);
      }
    }
  }
  const std::vector<int>& choices(std::size_t leaf) const { return choices_[leaf]; }

  /// @param distance  of the point above each choice's plane, in standard deviations
  int choose(std::size_t leaf, const Vector3d& p, const std::vector<double>& distance) const {
    const std::vector<int>& list = choices_[leaf];
    int best = -1;
    double best_distance = 0.0;
    for (std::size_t k = 0; k < list.size(); ++k) {
      const LabelGate& gate = gates_[static_cast<std::size_t>(list[k])];
      if (!(distance[k] > -gate.below && distance[k] < gate.above)) continue;
      const double away = std::abs(distance[k]);
      // On several: the crease decides if there is one, else the nearest plane.
      const int side = best < 0 ? 1 : cuts_.side(list[k], best, p.x(), p.y());
      if (side > 0 || (side == 0 && away < best_distance)) {
        best = list[k];
        best_distance = away;
      }
    }
    return best;
  }

 private:
  const CreaseCuts& cuts_;
  const std::vector<LabelGate>& gates_;
  std::vector<std::vector<int>> choices_;
};

/// Labels rows [begin, end) of `s`, which lie in one leaf, into out[0 ...].
class RowLabeller {
 public:
  RowLabeller(const Segmentation& segmentation, const LeafLabels& chooser)
      : segmentation_(segmentation), chooser_(chooser) {}

  void label(const PointArrays& s, std::size_t begin, std::size_t end, std::size_t leaf, int* out) {
    const std::vector<int>& list = chooser_.choices(leaf);
    const std::size_t n = end - begin;
    if (list.empty()) {
      std::fill(out, out + n, -1);
      return;
    }
    if (weights_.size() < list.size()) weights_.resize(list.size());
    for (std::size_t c = 0; c < list.size(); ++c) {
      const PlaneCandidate& candidate = region(list[c]).candidate;
      weights_[c].assign(n, 1.0f);
      candidate.noise.weigh(candidate.plane.n, candidate.plane.d, n, &s.x[begin], &s.y[begin],
                            &s.z[begin], s.sigma.empty() ? nullptr : &s.sigma[begin],
                            s.covariance.empty() ? nullptr : &s.covariance[begin],
                            weights_[c].data());
    }
    distance_.resize(list.size());
    for (std::size_t k = 0; k < n; ++k) {
      const Vector3d p = s.point(begin + k);
      for (std::size_t c = 0; c < list.size(); ++c) {
        const double w = static_cast<double>(weights_[c][k]);
        distance_[c] = w > 0.0 ? region(list[c]).candidate.plane.distance(p) * std::sqrt(w) : 1e30;
      }
      out[k] = chooser_.choose(leaf, p, distance_);
    }
  }

 private:
  const PlanarRegion& region(int index) const {
    return segmentation_.regions[static_cast<std::size_t>(index)];
  }
  const Segmentation& segmentation_;
  const LeafLabels& chooser_;
  std::vector<std::vector<float>> weights_;
  std::vector<double> distance_;
};

/// Region of every row of the tree, -1: none.
std::vector<int> label_rows(const GroundTree& tree, const Segmentation& segmentation,
                            const LeafLabels& chooser, int num_threads) {
  std::vector<int> labels(tree.cloud_index().size(), -1);
  constexpr std::size_t kBatch = 256;
  const std::size_t leaves = tree.leaves().size();
  parallel_for((leaves + kBatch - 1) / kBatch, num_threads, [&](std::size_t batch) {
    RowLabeller labeller(segmentation, chooser);
    for (std::size_t leaf = batch * kBatch; leaf < std::min(leaves, (batch + 1) * kBatch); ++leaf) {
      const GroundTree::Leaf& l = tree.leaves()[leaf];
      labeller.label(tree.points(), l.begin, l.end, leaf, labels.data() + l.begin);
    }
  });
  return labels;
}

/// Region of every point of a cloud of which the tree holds only a part.
std::vector<int> label_cloud(const RoadCloud& cloud, const GroundTree& tree,
                             const Segmentation& segmentation, const LeafLabels& chooser,
                             int num_threads) {
  std::vector<int> labels(cloud.size(), -1);
  constexpr std::size_t kBatch = 65536;
  const Eigen::Matrix3d turn = tree.frame().level_from_cloud;
  const Vector3d shift = tree.frame().pivot - cloud.origin;
  const bool sigmas = !cloud.sigmas.empty(), covariances = !cloud.covariances.empty();
  parallel_for((cloud.size() + kBatch - 1) / kBatch, num_threads, [&](std::size_t batch) {
    RowLabeller labeller(segmentation, chooser);
    PointArrays one;
    one.resize(1, sigmas, covariances);
    const std::size_t end = std::min(cloud.size(), (batch + 1) * kBatch);
    for (std::size_t i = batch * kBatch; i < end; ++i) {
      const Vector3d p = turn * (cloud.points[i].cast<double>() - shift);
      if (!(p.squaredNorm() < 1e30)) continue;
      one.x[0] = static_cast<float>(p.x());
      one.y[0] = static_cast<float>(p.y());
      one.z[0] = static_cast<float>(p.z());
      if (sigmas) one.sigma[0] = cloud.sigmas[i];
      if (covariances) one.covariance[0] = cloud.covariances[i];
      const int leaf = tree.locate(one.x[0], one.y[0]);
      if (leaf >= 0) labeller.label(one, 0, 1, static_cast<std::size_t>(leaf), &labels[i]);
    }
  });
  return labels;
}

/// Outline of a region in plan: the hull of its points in its own leaves, without the strays that
/// noise has carried out at the ends, and half their spacing around it.
PlanPolygon outline(const GroundTree& tree, const PlanarRegion& region, int id,
                    const std::vector<int>& row_labels) {
  std::vector<Vector2d> places;
  for (const int leaf : region.leaves) {
    const GroundTree::Leaf& l = tree.leaves()[static_cast<std::size_t>(leaf)];
    for (std::size_t k = l.begin; k < l.end; ++k) {
      if (row_labels[k] != id) continue;
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

/// Which patches are road: those that hang together smoothly with the one under the driven line,
/// for a camera's cloud without one with what lies ahead of the camera, else with the largest one.
/// Patches a kerb's height beside them are pavement.
/// @param borders  how many pairs of leaves of two patches touch, by id
void classify(const ConsistencyOptions& options, const std::map<std::pair<int, int>, int>& borders,
              RoadSurface* surface) {
  const std::size_t count = surface->patches.size();
  if (count == 0) return;
  const GroundAxes axes(surface->up);
  std::vector<double> areas(count);
  std::vector<PlanPolygon> polygons(count);
  for (std::size_t i = 0; i < count; ++i) {
    for (const Vector3d& corner : surface->patches[i].boundary) {
      polygons[i].push_back(axes(corner));
    }
    areas[i] = polygon_area(polygons[i]);
  }
  // Components: the strongest links join first, unless more of the border between the two sides is
  // a step than is smooth. So a pavement does not join the road where its kerb ends at a crease.
  std::vector<int> component(count);
  std::iota(component.begin(), component.end(), 0);
  std::vector<std::pair<double, const PatchLink*>> order;
  const auto strength = [&](const PatchLink& link) {
    const auto found = borders.find({std::min(link.a, link.b), std::max(link.a, link.b)});
    return found == borders.end() ? 0.1 * link.weight : static_cast<double>(found->second);
  };
  for (const PatchLink& link : surface->links) {
    if (link.valid) order.emplace_back(strength(link), &link);
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& l, const auto& r) { return l.first > r.first; });
  for (const auto& [unused, joining] : order) {
    const int a = component[static_cast<std::size_t>(joining->a)],
              b = component[static_cast<std::size_t>(joining->b)];
    if (a == b) continue;
    double balance = 0.0;
    for (const PatchLink& link : surface->links) {
      const int ca = component[static_cast<std::size_t>(link.a)],
                cb = component[static_cast<std::size_t>(link.b)];
      if ((ca == a && cb == b) || (ca == b && cb == a)) {
        balance += link.valid ? strength(link) : -strength(link);
      }
    }
    if (!(balance > 0.0)) continue;
    for (int& id : component) {
      if (id == b) id = a;
    }
  }
  std::vector<double> weight(count, 0.0);
  for (std::size_t i = 0; i < count; ++i)
    weight[static_cast<std::size_t>(component[i])] += areas[i];
  // The driven line decides, else the area; what is driven on is road in any case.
  std::vector<double> votes(weight.size(), 0.0);
  std::vector<char> driven_on(count, 0);
  for (const Vector3d& place : surface->driven_line) {
    const SurfaceQuery answer = surface->query(place, 1.0);
    if (answer.patch < 0) continue;
    votes[static_cast<std::size_t>(component[static_cast<std::size_t>(answer.patch)])] += 1.0;
    const PlanePatch& patch = surface->patches[static_cast<std::size_t>(answer.patch)];
    if (std::abs(patch.plane.plane.signed_distance(place)) < kDrivenOn) {
      driven_on[static_cast<std::size_t>(answer.patch)] = 1;
    }
  }
  if (surface->driven_line.empty() && surface->frame == "camera" && surface->metric) {
    // A camera that drives looks along the road: what lies ahead of it, in the middle and near.
    for (double ahead = 3.0; ahead <= 12.0; ahead += 0.5) {
      const SurfaceQuery answer = surface->query({0.0, 1.5, ahead}, 0.5);
      if (answer.patch < 0) continue;
      votes[static_cast<std::size_t>(component[static_cast<std::size_t>(answer.patch)])] += 1.0;
    }
  }
  const bool driven = *std::max_element(votes.begin(), votes.end()) > 0.0;
  const std::vector<double>& score = driven ? votes : weight;
  const int road = static_cast<int>(std::max_element(score.begin(), score.end()) - score.begin());
  std::vector<char> is_road(count, 0);
  // How much of a patch's border with the road is smooth, less what is a step.
  std::vector<double> smooth(count, 0.0), shared(count, 0.0), border(count, 0.0);
  for (const PatchLink& link : surface->links) {
    border[static_cast<std::size_t>(link.a)] += strength(link);
    border[static_cast<std::size_t>(link.b)] += strength(link);
  }
  const auto join = [&](std::size_t patch) {
    is_road[patch] = 1;
    for (const PatchLink& link : surface->links) {
      const auto ia = static_cast<std::size_t>(link.a), ib = static_cast<std::size_t>(link.b);
      if (ia != patch && ib != patch) continue;
      const std::size_t other = ia == patch ? ib : ia;
      smooth[other] += link.valid ? strength(link) : -strength(link);
      if (link.valid) shared[other] += strength(link);
    }
  };
  for (std::size_t i = 0; i < count; ++i) {
    if (component[i] == road || driven_on[i]) join(i);
  }
  // Others one by one, the smoothest first: a component as a whole may have more steps than that.
  for (;;) {
    std::size_t next = count;
    for (std::size_t i = 0; i < count; ++i) {
      if (is_road[i] || !(smooth[i] > 0.0) || shared[i] < kSharedBorder * border[i]) continue;
      if (next == count || smooth[i] > smooth[next]) next = i;
    }
    if (next == count) break;
    join(next);
  }
  for (std::size_t i = 0; i < count; ++i) {
    surface->patches[i].kind = is_road[i] ? PatchKind::kRoad : PatchKind::kOther;
  }
  // Ground a kerb's height above or below those, and what hangs together with it so.
  for (bool more = true; more;) {
    more = false;
    for (const PatchLink& link : surface->links) {
      PlanePatch &a = surface->patches[static_cast<std::size_t>(link.a)],
                 &b = surface->patches[static_cast<std::size_t>(link.b)];
      if ((a.kind == PatchKind::kOther) == (b.kind == PatchKind::kOther)) continue;
      if (link.distance > 0.5 * options.link_distance || link.angle > kLevel ||
          std::abs(link.height_step) > kHighestKerb) {
        continue;
      }
      (a.kind == PatchKind::kOther ? a : b).kind = PatchKind::kPavement;
      more = true;
    }
  }
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
  const double width = 5.0 * region.estimate.noise;
  std::size_t most = 0, from = 0;
  for (std::size_t to = 0; to < off.size(); ++to) {
    while (off[to] - off[from] > width) ++from;
    most = std::max(most, to - from + 1);
  }
  return most > least && 5 * most >= 2 * off.size();
}

/// Patches of one layer of a cloud: at each place at most one.
struct PatchLayer {
  std::string reason;  ///< why there are no patches, if so
  std::vector<PlanePatch> patches;
  std::vector<int> labels;                     ///< index of a patch, -1: none
  std::vector<float> noise;                    ///< m, of each patch
  std::map<std::pair<int, int>, int> borders;  ///< pairs of leaves that touch, by patch index
  double crowded = 0.0;  ///< share of the patches' leaves that hold another sheet as well
  NoiseModel model;      ///< of the whole cloud
  double typical = 0.0;  ///< m
  double shared = 0.0;   ///< as in Segmentation
};

/// @param known  the noise, if an earlier layer has measured it already
PatchLayer find_patches(const RoadCloud& cloud, const Vector3d& up,
                        const std::optional<Vector3d>& viewpoint, const RoadSurfaceOptions& options,
                        const PatchLayer* known, const std::function<void(double)>& report) {
  PatchLayer layer;
  layer.labels.assign(cloud.size(), -1);
  GroundTree tree(cloud, up, options.seed, kMostPoints);
  if (tree.size() < 3) {
    layer.reason = fmt::format("{} usable points, at least 3 are needed", tree.size());
    return layer;
  }
  if (!(tree.spread() > 0.0)) {
    layer.reason = "all points lie at one place";
    return layer;
  }
  report(0.2);

  NoiseModel noise;
  const bool fixed_noise = options.inlier_threshold > 0.0;
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
  SegmentationOptions segmentation_options;
  segmentation_options.seed = options.seed;
  segmentation_options.num_threads = options.num_threads;
  segmentation_options.max_slope = options.max_slope;
  segmentation_options.inlier_threshold = options.inlier_threshold;
  segmentation_options.tolerance_sigmas = options.tolerance_sigmas;
  segmentation_options.tolerance = cloud.metric ? options.tolerance : 0.0;
  segmentation_options.roughness = cloud.metric ? kRoughness : 0.0;
  segmentation_options.min_points = options.min_patch_points;
  segmentation_options.noise_is_known = known != nullptr;
  segmentation_options.shared = known ? known->shared : 0.0;
  Segmentation segmentation = segment_planes(tree, noise, segmentation_options);
  report(0.6);
  if (segmentation.regions.empty()) {
    layer.reason = "no planar ground was found";
    return layer;
  }

  const double least_noise = std::max(4e-7 * tree.spread(), 1e-9);
  parallel_for(segmentation.regions.size(), options.num_threads, [&](std::size_t region) {
    refine_region(tree, least_noise, segmentation_options.roughness, fixed_noise,
                  segmentation.shared, &segmentation.regions[region]);
  });
  layer.model = segmentation.noise;
  layer.shared = segmentation.shared;
  layer.typical = segmentation.typical_noise;
  if (known && known->typical > 0.0) {
    // What is left over by another layer may be rubbish: only what is as smooth counts.
    for (PlanarRegion& region : segmentation.regions) {
      if (region.estimate.noise > 2.5 * known->typical) region.estimate.status = Status::kFailed;
    }
  }
  report(0.8);

  const CreaseCuts cuts(segmentation.regions);
  std::vector<LabelGate> gates(segmentation.regions.size());
  parallel_for(gates.size(), options.num_threads, [&](std::size_t region) {
    gates[region] = measure_gate(tree, segmentation.regions[region]);
  });
  const LeafLabels chooser(segmentation, tree, cuts, gates);
  const std::vector<int> row_labels = label_rows(tree, segmentation, chooser, options.num_threads);
  std::vector<int> counts(segmentation.regions.size(), 0);
  if (cloud.size() <= kMostPoints) {
    for (std::size_t k = 0; k < row_labels.size(); ++k) {
      const std::uint32_t index = tree.cloud_index()[k];
      if (index != GroundTree::kPadding) layer.labels[index] = row_labels[k];
    }
  } else {
    layer.labels = label_cloud(cloud, tree, segmentation, chooser, options.num_threads);
  }
  for (const int label : layer.labels) {
    if (label >= 0) ++counts[static_cast<std::size_t>(label)];
  }

  // Patches in the cloud's frame.
  const Eigen::Matrix3d back = tree.frame().level_from_cloud.transpose();
  std::vector<int> id_of(segmentation.regions.size(), -1);
  for (std::size_t r = 0; r < segmentation.regions.size(); ++r) {
    const PlanarRegion& region = segmentation.regions[r];
    if (region.estimate.status == Status::kFailed || counts[r] < options.min_patch_points) continue;
    const PlanPolygon polygon = outline(tree, region, static_cast<int>(r), row_labels);
    if (polygon.size() < 3) continue;
    PlanePatch patch;
    patch.id = static_cast<int>(layer.patches.size());
    id_of[r] = patch.id;
    patch.status = region.estimate.status;
    patch.reason = region.estimate.reason;
    patch.inliers = counts[r];
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
    layer.noise.push_back(static_cast<float>(region.estimate.noise));
    layer.patches.push_back(std::move(patch));
  }
  for (int& label : layer.labels) {
    if (label >= 0) label = id_of[static_cast<std::size_t>(label)];
  }
  if (layer.patches.empty()) layer.reason = "no planar ground was found";

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
    for (const int other : tree.neighbours()[leaf]) {
      const int next = segmentation.leaf_region[static_cast<std::size_t>(other)];
      const int b = next < 0 ? -1 : id_of[static_cast<std::size_t>(next)];
      if (b > a) ++layer.borders[{a, b}];
    }
  }
  layer.crowded = crowded / std::max(leaves, 1.0);
  return layer;
}

void require(bool good, const char* field, double value, const char* bound) {
  if (!good) {
    throw std::invalid_argument(
        fmt::format("RoadSurfaceOptions::{} is {}, expected {}", field, value, bound));
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
  RoadSurface& surface = fit.surface;
  const Vector3d up = options.up ? options.up->normalized() : cloud.default_up();
  surface.up = up;
  surface.metric = cloud.metric;
  surface.frame = cloud.frame == CloudFrame::kCamera       ? "camera"
                  : (up - Vector3d::UnitZ()).norm() < 1e-9 ? "z-up"
                                                           : "other";
  surface.driven_line = options.driven_line;
  std::optional<Vector3d> viewpoint = options.viewpoint;
  if (!viewpoint && cloud.frame == CloudFrame::kCamera) viewpoint = Vector3d::Zero();

  PatchLayer first = find_patches(cloud, up, viewpoint, options, nullptr, report);
  fit.labels = std::move(first.labels);
  if (first.patches.empty()) {
    fit.status = Status::kFailed;
    fit.reason = first.reason;
    return fit;
  }
  surface.patches = std::move(first.patches);
  std::map<std::pair<int, int>, int> borders = std::move(first.borders);
  std::vector<float> noise = std::move(first.noise);
  // Ground above ground: where much is left over in the patches' own places, look again there.
  double crowded = first.crowded;
  for (int again = 0; again < 2 && crowded > kCrowded; ++again) {
    std::vector<int> rest;
    for (std::size_t i = 0; i < fit.labels.size(); ++i) {
      if (fit.labels[i] < 0) rest.push_back(static_cast<int>(i));
    }
    const PatchLayer next =
        find_patches(cloud.select(rest), up, viewpoint, options, &first, [](double) {});
    if (next.patches.empty()) break;
    const int base = static_cast<int>(surface.patches.size());
    for (std::size_t k = 0; k < rest.size(); ++k) {
      if (next.labels[k] >= 0)
        fit.labels[static_cast<std::size_t>(rest[k])] = base + next.labels[k];
    }
    for (const PlanePatch& patch : next.patches) {
      surface.patches.push_back(patch);
      surface.patches.back().id += base;
    }
    for (const auto& [pair, number] : next.borders) {
      borders[{pair.first + base, pair.second + base}] = number;
    }
    noise.insert(noise.end(), next.noise.begin(), next.noise.end());
    crowded = next.crowded;
  }
  fit.noise = quantile(noise, 0.5);

  surface.links = find_links(surface, options.consistency);
  classify(options.consistency, borders, &surface);
  align_patches_with_road(&surface);
  optimise_surface(options.consistency, &surface);
  measure_unmodelled(cloud, fit.labels, &surface);
  // What a patch alone leaves open its neighbours may fix.
  for (PlanePatch& patch : surface.patches) {
    const Eigen::Vector3d variance = patch.plane.covariance.diagonal();
    if (patch.status == Status::kWeak && patch.inliers >= kFewInliers &&
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
  fit.status = Status::kOk;
  report(1.0);
  return fit;
}

}  // namespace camber
