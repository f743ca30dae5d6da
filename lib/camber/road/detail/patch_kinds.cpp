#include "camber/road/detail/patch_kinds.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "camber/road/plan_polygon.h"

namespace camber::detail {

using Eigen::Vector3d;

namespace {

constexpr double kDrivenOn = 0.5;      // m, between the driven line and the patch it lies on
constexpr double kSharedBorder = 0.1;  // share of a patch's borders that joins it to the road
constexpr double kHighestKerb = 0.35, kLevel = 0.25;  // m and rad, of a pavement to its neighbours

/// How long the border of two patches is, in pairs of leaves; little without any.
class BorderStrength {
 public:
  explicit BorderStrength(const PatchBorders& borders) : borders_(borders) {}
  double operator()(const PatchLink& link) const {
    const auto found = borders_.find({std::min(link.a, link.b), std::max(link.a, link.b)});
    return found == borders_.end() ? 0.1 * link.weight : static_cast<double>(found->second);
  }

 private:
  const PatchBorders& borders_;
};

std::vector<double> plan_areas(const RoadSurface& surface) {
  const std::size_t count = surface.patches.size();
  const GroundAxes axes(surface.up);
  std::vector<double> areas(count);
  for (std::size_t i = 0; i < count; ++i) {
    PlanPolygon polygon;
    for (const Vector3d& corner : surface.patches[i].boundary) polygon.push_back(axes(corner));
    areas[i] = polygon_area(polygon);
  }
  return areas;
}

/// Patches that hang together smoothly: for each patch the number of one that stands for all.
std::vector<int> smooth_components(const RoadSurface& surface, const BorderStrength& strength) {
  // Components: the strongest links join first, unless more of the border between the two sides is
  // a step than is smooth. So a pavement does not join the road where its kerb ends at a crease.
  std::vector<int> component(surface.patches.size());
  std::iota(component.begin(), component.end(), 0);
  std::vector<std::pair<double, const PatchLink*>> order;
  for (const PatchLink& link : surface.links) {
    if (link.valid) order.emplace_back(strength(link), &link);
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& l, const auto& r) { return l.first > r.first; });
  for (const auto& [unused, joining] : order) {
    const int a = component[static_cast<std::size_t>(joining->a)],
              b = component[static_cast<std::size_t>(joining->b)];
    if (a == b) continue;
    double balance = 0.0;
    for (const PatchLink& link : surface.links) {
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
  return component;
}

/// The component that is driven on, or lies ahead of a camera, or is the largest; and the patches
/// that the driven line lies on.
struct RoadSeed {
  int component = -1;
  std::vector<char> driven_on;
};

RoadSeed find_road(const RoadSurface& surface, const std::vector<int>& component) {
  const std::size_t count = surface.patches.size();
  const std::vector<double> areas = plan_areas(surface);
  std::vector<double> weight(count, 0.0);
  for (std::size_t i = 0; i < count; ++i)
    weight[static_cast<std::size_t>(component[i])] += areas[i];
  // The driven line decides, else the area; what is driven on is road in any case.
  std::vector<double> votes(weight.size(), 0.0);
  std::vector<char> driven_on(count, 0);
  for (const Vector3d& place : surface.driven_line) {
    const SurfaceQuery answer = surface.query(place, 1.0);
    if (answer.patch < 0) continue;
    votes[static_cast<std::size_t>(component[static_cast<std::size_t>(answer.patch)])] += 1.0;
    const PlanePatch& patch = surface.patches[static_cast<std::size_t>(answer.patch)];
    if (std::abs(patch.plane.plane.signed_distance(place)) < kDrivenOn) {
      driven_on[static_cast<std::size_t>(answer.patch)] = 1;
    }
  }
  if (surface.driven_line.empty() && surface.frame == "camera" && surface.metric) {
    // A camera that drives looks along the road: what lies ahead of it, in the middle and near.
    for (double ahead = 3.0; ahead <= 12.0; ahead += 0.5) {
      const SurfaceQuery answer = surface.query({0.0, 1.5, ahead}, 0.5);
      if (answer.patch < 0) continue;
      votes[static_cast<std::size_t>(component[static_cast<std::size_t>(answer.patch)])] += 1.0;
    }
  }
  const bool driven = *std::max_element(votes.begin(), votes.end()) > 0.0;
  const std::vector<double>& score = driven ? votes : weight;
  const int road = static_cast<int>(std::max_element(score.begin(), score.end()) - score.begin());
  return {road, std::move(driven_on)};
}

/// The seed, and patches beside it whose border with the road is smooth rather than a step.
std::vector<char> join_smooth(const RoadSurface& surface, const BorderStrength& strength,
                              const std::vector<int>& component, const RoadSeed& seed) {
  const std::size_t count = surface.patches.size();
  std::vector<char> is_road(count, 0);
  // How much of a patch's border with the road is smooth, less what is a step.
  std::vector<double> smooth(count, 0.0), shared(count, 0.0), border(count, 0.0);
  for (const PatchLink& link : surface.links) {
    border[static_cast<std::size_t>(link.a)] += strength(link);
    border[static_cast<std::size_t>(link.b)] += strength(link);
  }
  const auto join = [&](std::size_t patch) {
    is_road[patch] = 1;
    for (const PatchLink& link : surface.links) {
      const auto ia = static_cast<std::size_t>(link.a), ib = static_cast<std::size_t>(link.b);
      if (ia != patch && ib != patch) continue;
      const std::size_t other = ia == patch ? ib : ia;
      smooth[other] += link.valid ? strength(link) : -strength(link);
      if (link.valid) shared[other] += strength(link);
    }
  };
  for (std::size_t i = 0; i < count; ++i) {
    if (component[i] == seed.component || seed.driven_on[i]) join(i);
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
  return is_road;
}

/// Ground a kerb's height above or below the road, and what hangs together with it so.
void find_pavements(const ConsistencyOptions& options, RoadSurface* surface) {
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

}  // namespace

void classify_patches(const ConsistencyOptions& options, const PatchBorders& borders,
                      RoadSurface* surface) {
  const std::size_t count = surface->patches.size();
  if (count == 0) return;
  const BorderStrength strength(borders);
  const std::vector<int> component = smooth_components(*surface, strength);
  const RoadSeed seed = find_road(*surface, component);
  const std::vector<char> is_road = join_smooth(*surface, strength, component, seed);
  for (std::size_t i = 0; i < count; ++i) {
    surface->patches[i].kind = is_road[i] ? PatchKind::kRoad : PatchKind::kOther;
  }
  find_pavements(options, surface);
}

void name_ground(RoadSurface* surface) {
  for (PlanePatch& patch : surface->patches) {
    if (patch.kind != PatchKind::kOther) patch.kind = PatchKind::kGround;
  }
}

}  // namespace camber::detail
