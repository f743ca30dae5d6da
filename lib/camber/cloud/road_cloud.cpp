#include "camber/cloud/road_cloud.h"

#include <stdexcept>

namespace camber {
namespace {

void require_length(std::size_t length, std::size_t points, const std::string& name,
                    bool may_be_empty) {
  if (length == points || (may_be_empty && length == 0)) return;
  throw std::invalid_argument("cloud attribute '" + name + "' has " + std::to_string(length) +
                              " entries, expected " + std::to_string(points) +
                              ", one for each point");
}

template <typename T>
std::vector<T> pick(const std::vector<T>& all, const std::vector<int>& indices) {
  std::vector<T> out;
  if (all.empty()) return out;
  out.reserve(indices.size());
  for (const int i : indices) out.push_back(all[static_cast<std::size_t>(i)]);
  return out;
}

}  // namespace

void RoadCloud::validate() const {
  require_length(colors.size(), size(), "colors", true);
  require_length(sigmas.size(), size(), "sigmas", true);
  require_length(covariances.size(), size(), "covariances", true);
  require_length(normals.size(), size(), "normals", true);
  for (const auto& [name, values] : labels) require_length(values.size(), size(), name, false);
  for (const auto& [name, values] : scalars) require_length(values.size(), size(), name, false);
}

RoadCloud RoadCloud::select(const std::vector<int>& indices) const {
  for (const int i : indices) {
    if (i < 0 || static_cast<std::size_t>(i) >= size()) {
      throw std::invalid_argument("point index " + std::to_string(i) + ", expected one in [0, " +
                                  std::to_string(size()) + ")");
    }
  }
  RoadCloud out;
  out.frame = frame;
  out.metric = metric;
  out.origin = origin;
  out.points = pick(points, indices);
  out.colors = pick(colors, indices);
  out.sigmas = pick(sigmas, indices);
  out.covariances = pick(covariances, indices);
  out.normals = pick(normals, indices);
  for (const auto& [name, values] : labels) out.labels[name] = pick(values, indices);
  for (const auto& [name, values] : scalars) out.scalars[name] = pick(values, indices);
  return out;
}

}  // namespace camber
