#include "benchmarks/forest_road.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>

#include "camber/cloud/cloud_io.h"
#include "camber/core/random.h"
#include "camber/geometry/plane.h"

namespace fs = std::filesystem;

namespace camber::benchmarks {

using Eigen::Vector3d;
using Eigen::Vector3f;

namespace {

/// Noise of a camera that drives along a line, 1.65 m above it, 6 to 30 m before each point.
class CameraNoise {
 public:
  CameraNoise(std::vector<Vector3d> line, std::uint64_t seed)
      : line_(std::move(line)), random_(seed, 31) {}
  Vector3d operator()(const Vector3d& p, double chainage, float* sigma) {
    const double back = random_.uniform(next_++, 6.0, 30.0);
    const double at = std::clamp(chainage - back, 0.0, static_cast<double>(line_.size() - 1));
    Vector3d camera = line_[static_cast<std::size_t>(at)] + Vector3d(0, 0, 1.65);
    // Before the start of the line the camera stands as far behind it.
    if (chainage < back) {
      const Vector3d ahead = (line_[1] - line_[0]).normalized();
      camera += (chainage - back) * ahead;
    }
    const Vector3d offset = p - camera;
    const double r = offset.norm();
    const double along = 0.5 * r * r / 718.0, across = 0.5 * r / 718.0;
    Vector3d e1, e2;
    UncertainPlane::make_axes(offset / r, Vector3d::UnitZ(), &e1, &e2);
    *sigma = static_cast<float>(along);
    const double n1 = random_.normal(next_), n2 = random_.normal(next_ + 1),
                 n3 = random_.normal(next_ + 2);
    next_ += 3;
    return p + along * n1 * offset / r + across * (n2 * e1 + n3 * e2);
  }

 private:
  std::vector<Vector3d> line_;
  CounterRandom random_;
  std::uint64_t next_ = 0;
};

}  // namespace

bool available(const fs::path& path) {
  if (fs::exists(path)) return true;
  std::printf("skipped: no %s\n", path.string().c_str());
  return false;
}

std::vector<std::vector<double>> read_rows(const fs::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  std::vector<std::vector<double>> rows;
  while (std::getline(in, line)) {
    std::stringstream cells(line);
    std::string cell;
    std::vector<double> row;
    while (std::getline(cells, cell, ',')) row.push_back(std::atof(cell.c_str()));
    rows.push_back(std::move(row));
  }
  return rows;
}

std::vector<double> smoothed_grade(const std::vector<double>& station,
                                   const std::vector<double>& height, double length) {
  std::vector<double> out(station.size(), std::nan(""));
  for (std::size_t k = 0; k < station.size(); ++k) {
    if (station[k] - 0.5 * length < station.front() - 1e-6 ||
        station[k] + 0.5 * length > station.back() + 1e-6) {
      continue;
    }
    double n = 0, s = 0, h = 0, ss = 0, sh = 0;
    for (std::size_t j = 0; j < station.size(); ++j) {
      const double d = station[j] - station[k];
      if (std::abs(d) > 0.5 * length + 1e-6) continue;
      n += 1;
      s += d;
      h += height[j];
      ss += d * d;
      sh += d * height[j];
    }
    out[k] = (n * sh - s * h) / (n * ss - s * s);
  }
  return out;
}

Terrain::Terrain(const RoadCloud& cloud) {
  for (const Vector3f& p : cloud.points) {
    const Vector3d x = cloud.origin + p.cast<double>();
    offset_ = {x.x() - std::floor(x.x()), x.y() - std::floor(x.y())};
    break;
  }
  for (const Vector3f& p : cloud.points) {
    const Vector3d x = cloud.origin + p.cast<double>();
    cells_[key(x.x(), x.y())] = x.z();
  }
}

double Terrain::height(double x, double y) const {
  const double gx = x - offset_.x(), gy = y - offset_.y();
  const double fx = gx - std::floor(gx), fy = gy - std::floor(gy);
  double sum = 0.0;
  for (int corner = 0; corner < 4; ++corner) {
    const int dx = corner % 2, dy = corner / 2;
    const auto found = cells_.find(key(x - fx + dx, y - fy + dy));
    if (found == cells_.end()) return std::nan("");
    sum += (dx ? fx : 1 - fx) * (dy ? fy : 1 - fy) * found->second;
  }
  return sum;
}

std::pair<long, long> Terrain::key(double x, double y) const {
  return {std::lround(x - offset_.x()), std::lround(y - offset_.y())};
}

ForestRoad::ForestRoad(const fs::path& folder)
    : terrain(read_cloud(folder / "terrain.ply")), grid(terrain) {
  for (const std::vector<double>& row : read_rows(folder / "centreline.csv")) {
    line.emplace_back(row[1], row[2], row[3]);
    height.push_back(row[3]);
    station.push_back(line.size() < 2 ? 0.0
                                      : station.back() +
                                            (line.back() - line[line.size() - 2]).head<2>().norm());
  }
}

double ForestRoad::height_at(double at_station) const {
  const auto next = std::upper_bound(station.begin() + 1, station.end() - 1, at_station);
  const auto a = static_cast<std::size_t>(next - station.begin()) - 1;
  const double share = (at_station - station[a]) / (station[a + 1] - station[a]);
  return height[a] + share * (height[a + 1] - height[a]);
}

std::vector<double> ForestRoad::cross_slopes(double half_width) const {
  std::vector<double> slopes;
  for (std::size_t k = 0; k < line.size(); ++k) {
    const Vector3d ahead = line[std::min(k + 1, line.size() - 1)] - line[k > 0 ? k - 1 : 0];
    const Eigen::Vector2d left = Eigen::Vector2d(-ahead.y(), ahead.x()).normalized();
    double squares = 0.0, products = 0.0;
    for (int step = -10; step <= 10; ++step) {
      const double aside = 0.1 * step * half_width;
      const Eigen::Vector2d place = line[k].head<2>() + aside * left;
      squares += aside * aside;
      products += aside * grid.height(place.x(), place.y());
    }
    slopes.push_back(products / squares);
  }
  return slopes;
}

RoadCloud ForestRoad::cloud(const ForestInput& input, std::uint64_t seed) const {
  const std::vector<float>& chainage = terrain.scalars.at("chainage");
  const std::vector<float>& distance = terrain.scalars.at("road_distance");
  RoadCloud out;
  out.frame = CloudFrame::kZUp;
  CameraNoise noise(line, seed);
  const CounterRandom random(seed, 32);
  std::vector<std::size_t> near;
  for (std::size_t i = 0; i < terrain.size(); ++i) {
    if (distance[i] <= input.width) near.push_back(i);
  }
  const std::size_t count = input.points > 0 ? input.points : near.size();
  for (std::size_t k = 0; k < count; ++k) {
    std::size_t i = near[k % near.size()];
    Vector3d p;
    if (input.points > 0) {
      i = near[random.below(3 * k, near.size())];
      p = terrain.origin + terrain.points[i].cast<double>();
      p.x() += random.uniform(3 * k + 1) - 0.5;
      p.y() += random.uniform(3 * k + 2) - 0.5;
      p.z() = grid.height(p.x(), p.y());
      if (!std::isfinite(p.z())) continue;
    } else {
      p = terrain.origin + terrain.points[i].cast<double>();
    }
    float sigma = 0.0f;
    out.points.push_back(noise(p, static_cast<double>(chainage[i]), &sigma).cast<float>());
    if (input.sigmas) out.sigmas.push_back(sigma);
  }
  return out;
}

}  // namespace camber::benchmarks
