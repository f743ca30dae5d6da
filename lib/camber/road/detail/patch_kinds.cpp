#include "camber/road/detail/patch_kinds.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <set>
#include <utility>
#include <vector>

#include "camber/road/plan_polygon.h"
#include "camber/road/surface_lookup.h"

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

/// Components of patches, and the links between each two of them.
class Components {
 public:
  explicit Components(const RoadSurface& surface) : links_(surface.links) {
    const std::size_t count = surface.patches.size();
    set_of_.resize(count);
    std::iota(set_of_.begin(), set_of_.end(), std::size_t{0});
    label_.resize(count);
    std::iota(label_.begin(), label_.end(), 0);
    members_.resize(count);
    between_.resize(count);
    for (std::size_t i = 0; i < count; ++i) members_[i].push_back(i);
    for (std::size_t k = 0; k < links_.size(); ++k) {
      const auto a = static_cast<std::size_t>(links_[k].a),
                 b = static_cast<std::size_t>(links_[k].b);
      between_[a][b].push_back(k);
      if (a != b) between_[b][a].push_back(k);
    }
  }

  std::size_t set_of(int patch) const { return set_of_[static_cast<std::size_t>(patch)]; }
  /// Numbers of the links between two sets, ascending.
  const std::vector<std::size_t>& between(std::size_t a, std::size_t b) const {
    return between_[a].at(b);
  }

  /// Joins b to a, whose label stays; the smaller one moves.
  void join(std::size_t a, std::size_t b) {
    const int label = label_[a];
    if (between_[a].size() + members_[a].size() < between_[b].size() + members_[b].size()) {
      std::swap(a, b);
    }
    label_[a] = label;
    for (const std::size_t patch : members_[b]) set_of_[patch] = a;
    members_[a].insert(members_[a].end(), members_[b].begin(), members_[b].end());
    members_[b].clear();
    between_[a].erase(b);
    between_[b].erase(a);
    for (auto& [other, list] : between_[b]) {
      between_[other].erase(b);
      std::vector<std::size_t>& here = between_[a][other];
      const auto middle = static_cast<std::ptrdiff_t>(here.size());
      here.insert(here.end(), list.begin(), list.end());
      std::inplace_merge(here.begin(), here.begin() + middle, here.end());
      between_[other][a] = here;
    }
    between_[b].clear();
  }

  /// For each patch the number of one that stands for all.
  std::vector<int> labels() const {
    std::vector<int> out;
    for (const std::size_t set : set_of_) out.push_back(label_[set]);
    return out;
  }

 private:
  const std::vector<PatchLink>& links_;
  std::vector<std::size_t> set_of_;
  std::vector<int> label_;  // of a set
  std::vector<std::vector<std::size_t>> members_;
  std::vector<std::map<std::size_t, std::vector<std::size_t>>> between_;
};

/// Patches that hang together smoothly: for each patch the number of one that stands for all.
std::vector<int> smooth_components(const RoadSurface& surface, const BorderStrength& strength) {
  // Components: the strongest links join first, unless more of the border between the two sides is
  // a step than is smooth. So a pavement does not join the road where its kerb ends at a crease.
  Components components(surface);
  std::vector<std::pair<double, const PatchLink*>> order;
  for (const PatchLink& link : surface.links) {
    if (link.valid) order.emplace_back(strength(link), &link);
  }
  std::stable_sort(order.begin(), order.end(),
                   [](const auto& l, const auto& r) { return l.first > r.first; });
  for (const auto& [unused, joining] : order) {
    const std::size_t a = components.set_of(joining->a), b = components.set_of(joining->b);
    if (a == b) continue;
    double balance = 0.0;
    for (const std::size_t k : components.between(a, b)) {
      const PatchLink& link = surface.links[k];
      balance += link.valid ? strength(link) : -strength(link);
    }
    if (balance > 0.0) components.join(a, b);
  }
  return components.labels();
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
  std::vector<double> votes(count, 0.0);
  std::vector<char> driven_on(count, 0);
  const SurfaceLookup lookup(surface);
  for (const Vector3d& place : surface.driven_line) {
    const SurfaceQuery answer = lookup.query(place, 1.0);
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
      const SurfaceQuery answer = lookup.query({0.0, 1.5, ahead}, 0.5);
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
  std::vector<std::vector<const PatchLink*>> links(count);
  for (const PatchLink& link : surface.links) {
    for (const int end : {link.a, link.b}) {
      border[static_cast<std::size_t>(end)] += strength(link);
      links[static_cast<std::size_t>(end)].push_back(&link);
    }
  }
  // Others that may join, the smoothest first, of equal ones the first.
  std::set<std::pair<double, std::size_t>> waiting;
  const auto join = [&](std::size_t patch) {
    waiting.erase({-smooth[patch], patch});
    is_road[patch] = 1;
    for (const PatchLink* link : links[patch]) {
      const auto ia = static_cast<std::size_t>(link->a), ib = static_cast<std::size_t>(link->b);
      const std::size_t other = ia == patch ? ib : ia;
      waiting.erase({-smooth[other], other});
      smooth[other] += link->valid ? strength(*link) : -strength(*link);
      if (link->valid) shared[other] += strength(*link);
      if (is_road[other] || !(smooth[other] > 0.0)) continue;
      if (shared[other] >= kSharedBorder * border[other]) waiting.insert({-smooth[other], other});
    }
  };
  for (std::size_t i = 0; i < count; ++i) {
    if (component[i] == seed.component || seed.driven_on[i]) join(i);
  }
  // One by one: a component as a whole may have more steps than that.
  while (!waiting.empty()) join(waiting.begin()->second);
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
