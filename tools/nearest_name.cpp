#include "nearest_name.h"

#include <algorithm>
#include <limits>

namespace camber::tools {
namespace {

std::size_t distance(const std::string& a, const std::string& b) {
  std::vector<std::vector<std::size_t>> steps(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) steps[i][0] = i;
  for (std::size_t j = 0; j <= b.size(); ++j) steps[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t differ = a[i - 1] == b[j - 1] ? 0 : 1;
      steps[i][j] =
          std::min({steps[i - 1][j] + 1, steps[i][j - 1] + 1, steps[i - 1][j - 1] + differ});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        steps[i][j] = std::min(steps[i][j], steps[i - 2][j - 2] + 1);
      }
    }
  }
  return steps[a.size()][b.size()];
}

}  // namespace

std::string nearest_name(const std::string& typed, const std::vector<std::string>& names) {
  std::string nearest;
  std::size_t least = std::numeric_limits<std::size_t>::max();
  for (const std::string& name : names) {
    const std::size_t d = distance(typed, name);
    if (d < least && 3 * d <= std::max(typed.size(), name.size())) {
      least = d;
      nearest = name;
    }
  }
  if (!nearest.empty() || typed.size() < 3) return nearest;
  const auto begun = std::find_if(names.begin(), names.end(), [&](const std::string& name) {
    return name.compare(0, typed.size(), typed) == 0;
  });
  return begun == names.end() ? "" : *begun;
}

}  // namespace camber::tools
