#include "camber/motion/detail/spread_points.h"

#include <algorithm>
#include <cmath>

namespace camber::detail {

std::vector<int> spread_points(const Correspondences& matches,
                               const std::vector<std::uint8_t>& candidate, int count) {
  const double area = static_cast<double>(matches.columns) * matches.rows;
  const int cell = std::max(1, static_cast<int>(std::sqrt(area / count)));
  std::vector<int> chosen;
  for (int r0 = 0; r0 < matches.rows; r0 += cell) {
    for (int c0 = 0; c0 < matches.columns; c0 += cell) {
      int best = -1;
      float best_texture = 0.5f;  // (intensity / px)^2: below this there is only noise
      for (int r = r0; r < std::min(r0 + cell, matches.rows); ++r) {
        for (int c = c0; c < std::min(c0 + cell, matches.columns); ++c) {
          const int i = r * matches.columns + c;
          if (!candidate[static_cast<std::size_t>(i)]) continue;
          const Eigen::Vector3f& s = matches.texture[static_cast<std::size_t>(i)];
          const float half = 0.5f * (s.x() + s.z());
          const float smallest =
              half - std::sqrt(std::max(0.0f, half * half - (s.x() * s.z() - s.y() * s.y())));
          if (smallest > best_texture) {
            best_texture = smallest;
            best = i;
          }
        }
      }
      if (best >= 0) chosen.push_back(best);
    }
  }
  return chosen;
}

}  // namespace camber::detail
