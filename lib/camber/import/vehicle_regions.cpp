#include "camber/import/vehicle_regions.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <utility>

namespace camber {
namespace {

constexpr double kSmallestStep = 0.4;           // m between neighbours that are two things
constexpr double kRelativeStep = 0.03;          // of the depth
constexpr double kLargestFragment = 1.0 / 3.0;  // of its neighbour's pixels
constexpr double kFragmentDistance = 3.0;       // m in depth between the middles

/// Disjoint sets of pixels; the smallest index of a set is its root.
class PixelSets {
 public:
  explicit PixelSets(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  int root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(int a, int b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<int> parent_;
};

struct Component {
  VehicleRegion region;
  double depth = 0.0;  // m, mean
};

/// Calls visit(a, b) for all pairs of neighbours in rows and columns.
template <typename Visit>
void for_neighbours(int width, int height, const Visit& visit) {
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const int at = y * width + x;
      if (x + 1 < width) visit(at, at + 1);
      if (y + 1 < height) visit(at, at + width);
    }
  }
}

std::map<int, Component> components_by_root(const DepthImage& depth, const Image& classes,
                                            const std::vector<bool>& vehicle, PixelSets* sets) {
  std::map<int, Component> out;
  for (std::size_t i = 0; i < vehicle.size(); ++i) {
    if (!vehicle[i]) continue;
    const int index = static_cast<int>(i);
    Component& component = out[sets->root(index)];
    component.region.class_id = classes.data[i];
    component.region.pixels.push_back(index);
    component.depth += depth.metres[i];
  }
  for (auto& [root, component] : out) {
    component.depth /= static_cast<double>(component.region.pixels.size());
  }
  return out;
}

/// Joins what a step inside a vehicle cuts off with the largest neighbour.
void join_fragments(const DepthImage& depth, const Image& classes, const std::vector<bool>& vehicle,
                    PixelSets* sets) {
  const std::map<int, Component> components = components_by_root(depth, classes, vehicle, sets);
  std::map<int, int> host;  // of a fragment's root
  for_neighbours(depth.width, depth.height, [&](int a, int b) {
    if (!vehicle[a] || !vehicle[b] || classes.data[a] != classes.data[b]) return;
    int small = sets->root(a), large = sets->root(b);
    if (small == large) return;
    if (components.at(small).region.pixels.size() > components.at(large).region.pixels.size()) {
      std::swap(small, large);
    }
    const Component &fragment = components.at(small), &whole = components.at(large);
    if (static_cast<double>(fragment.region.pixels.size()) >
        kLargestFragment * static_cast<double>(whole.region.pixels.size())) {
      return;
    }
    if (std::abs(fragment.depth - whole.depth) > kFragmentDistance) return;
    const auto [entry, is_new] = host.emplace(small, large);
    if (!is_new && components.at(entry->second).region.pixels.size() < whole.region.pixels.size()) {
      entry->second = large;
    }
  });
  for (const auto& [fragment, whole] : host) sets->join(fragment, whole);
}

}  // namespace

std::vector<VehicleRegion> vehicle_regions(const DepthImage& depth, const Image& classes,
                                           const std::vector<std::uint16_t>& instances,
                                           const std::set<int>& vehicle_classes,
                                           std::size_t smallest) {
  const std::size_t count = depth.metres.size();
  std::vector<bool> vehicle(count);
  for (std::size_t i = 0; i < count; ++i) {
    vehicle[i] = vehicle_classes.count(classes.data[i]) > 0 && std::isfinite(depth.metres[i]);
  }
  std::vector<VehicleRegion> out;
  const auto take = [&](VehicleRegion region) {
    if (region.pixels.size() >= smallest) out.push_back(std::move(region));
  };
  if (!instances.empty()) {
    std::map<std::pair<int, int>, VehicleRegion> found;
    for (std::size_t i = 0; i < count; ++i) {
      if (!vehicle[i]) continue;
      VehicleRegion& region = found[{instances[i], classes.data[i]}];
      region.class_id = classes.data[i];
      region.instance = instances[i];
      region.pixels.push_back(static_cast<int>(i));
    }
    for (auto& [key, region] : found) take(std::move(region));
    return out;
  }
  PixelSets sets(count);
  for_neighbours(depth.width, depth.height, [&](int a, int b) {
    if (!vehicle[a] || !vehicle[b] || classes.data[a] != classes.data[b]) return;
    const double za = depth.metres[a], zb = depth.metres[b];
    if (std::abs(za - zb) < std::max(kSmallestStep, kRelativeStep * std::min(za, zb))) {
      sets.join(a, b);
    }
  });
  join_fragments(depth, classes, vehicle, &sets);
  for (auto& [root, component] : components_by_root(depth, classes, vehicle, &sets)) {
    take(std::move(component.region));
  }
  return out;
}

}  // namespace camber
