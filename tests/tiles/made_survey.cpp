#include "tiles/made_survey.h"

#include <cmath>
#include <fstream>
#include <sstream>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"

namespace fs = std::filesystem;

namespace camber::test {

RoadCloud made_survey(double side, double density) {
  RoadCloud cloud;
  cloud.origin = {651000.0, 6270000.0, 100.0};
  const CounterRandom random(17);
  const auto points = static_cast<std::uint64_t>(side * side * density);
  std::vector<int> ids, classes;
  for (std::uint64_t i = 0; i < points; ++i) {
    const double x = random.uniform(4 * i, 0.0, side), y = random.uniform(4 * i + 1, 0.0, side);
    if (std::hypot(std::fmod(x, 130.0) - 60.0, std::fmod(y, 110.0) - 40.0) < 14.0) continue;
    double z = 8.0 * std::sin(x / 40.0) + 5.0 * std::cos(y / 31.0) + 0.03 * random.normal(i);
    const double u = std::fmod(x, 47.0), v = std::fmod(y, 39.0);
    int kind = 0;
    if (u < 9.0 && v < 7.0) {
      z += 6.0;
      kind = i % 3 == 0 ? 6 : 1;
    } else if (u > 20.0 && u < 22.0 && v > 5.0 && v < 35.0) {
      z += random.uniform(4 * i + 2, 0.0, 0.6);
    } else if (u > 30.0 && u < 34.0 && v > 30.0 && v < 34.0) {
      z += 0.9;
    } else if (random.uniform(4 * i + 3) < 2e-4) {
      z -= 3.0;
      kind = i % 2 == 0 ? 7 : 0;
    }
    cloud.points.push_back(Eigen::Vector3d(x, y, z).cast<float>());
    ids.push_back(static_cast<int>(i));
    classes.push_back(kind);
  }
  cloud.labels["id"] = std::move(ids);
  cloud.labels["classification"] = std::move(classes);
  return cloud;
}

RoadCloud strip_of(const RoadCloud& cloud, double from, double to) {
  std::vector<int> chosen;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    const double x = cloud.points[i].x();
    if (x >= from && x < to) chosen.push_back(static_cast<int>(i));
  }
  return cloud.select(chosen);
}

std::map<int, std::vector<int>> classes_by_id(const std::vector<fs::path>& files) {
  std::map<int, std::vector<int>> out;
  for (const fs::path& file : files) {
    const RoadCloud cloud = read_cloud(file);
    for (std::size_t i = 0; i < cloud.size(); ++i) {
      out[cloud.labels.at("id")[i]].push_back(cloud.labels.at("classification")[i]);
    }
  }
  return out;
}

std::map<std::string, std::string> files_below(const fs::path& folder) {
  std::map<std::string, std::string> out;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    std::ifstream in(entry.path(), std::ios::binary);
    std::ostringstream bytes;
    bytes << in.rdbuf();
    out[entry.path().lexically_relative(folder).generic_string()] = bytes.str();
  }
  return out;
}

}  // namespace camber::test
