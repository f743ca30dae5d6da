#include "camber/export/crg_mesh.h"

#include <algorithm>
#include <cmath>

namespace camber {

CrgMesh crg_mesh(const CrgData& data) {
  const CrgRoad road(data, false);
  const std::size_t columns = data.v.size();
  CrgMesh out;
  out.cloud.frame = CloudFrame::kZUp;
  out.cloud.origin = {data.start_x, data.start_y, data.start_z};
  std::vector<std::int64_t> index(data.heights.size(), -1);
  for (std::size_t i = 0; i < road.sections(); ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      const double z = road.node(i, j);
      if (std::isnan(z)) continue;
      const double u = road.first_u() + static_cast<double>(i) * road.increment();
      const Eigen::Vector2d place = road.position(u, data.v[j]);
      index[i * columns + j] = static_cast<std::int64_t>(out.cloud.size());
      out.cloud.points.push_back(
          (Eigen::Vector3d(place.x(), place.y(), z) - out.cloud.origin).cast<float>());
    }
  }
  for (std::size_t i = 0; i + 1 < road.sections(); ++i) {
    for (std::size_t j = 0; j + 1 < columns; ++j) {
      const std::int64_t corners[4] = {index[i * columns + j], index[(i + 1) * columns + j],
                                       index[(i + 1) * columns + j + 1],
                                       index[i * columns + j + 1]};
      if (*std::min_element(corners, corners + 4) < 0) continue;
      const auto c = [&](int k) { return static_cast<std::uint32_t>(corners[k]); };
      out.triangles.push_back({c(0), c(1), c(2)});
      out.triangles.push_back({c(0), c(2), c(3)});
    }
  }
  return out;
}

}  // namespace camber
