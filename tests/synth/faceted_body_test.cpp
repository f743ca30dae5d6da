#include "camber/synth/detail/faceted_body.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace camber {
namespace {

constexpr int kSide = kNumKeypoints / 2;
constexpr std::uint64_t kCars = 40;

CarModel faceted(std::uint64_t index, double size) {
  CarModel car = sample_car(CounterRandom(3), index);
  Sequence random(4, index);
  facet_body(size, &random, &car);
  return car;
}

/// m^3, by the divergence theorem: of closed pieces with outward triangles, otherwise about that.
double signed_volume(const CarModel& car, bool wheels) {
  double six = 0.0;
  for (std::size_t i = 0; i < car.mesh.triangles.size(); ++i) {
    const auto material = static_cast<CarMaterial>(car.mesh.materials[i]);
    if ((material == CarMaterial::kTyre || material == CarMaterial::kRim) != wheels) continue;
    const Eigen::Vector3i& t = car.mesh.triangles[i];
    six += car.mesh.vertices[t[0]].dot(car.mesh.vertices[t[1]].cross(car.mesh.vertices[t[2]]));
  }
  return six / 6.0;
}

TEST(FacetedBody, KeypointsAreCornersOfTheMeshAndBothSidesAreAlike) {
  for (std::uint64_t i = 0; i < kCars; ++i) {
    const CarModel car = faceted(i, 0.06);
    for (int k = 0; k < kNumKeypoints; ++k) {
      const Eigen::Vector3d& p = car.keypoints[k];
      double nearest = 1e9;
      for (const Eigen::Vector3d& v : car.mesh.vertices)
        nearest = std::min(nearest, (v - p).norm());
      EXPECT_LT(nearest, 1e-9) << "car " << i << ", keypoint " << k;
      const Eigen::Vector3d& other = car.keypoints[(k + kSide) % kNumKeypoints];
      EXPECT_LT((other - Eigen::Vector3d(p.x(), p.y(), -p.z())).norm(), 1e-9);
    }
  }
}

TEST(FacetedBody, TrianglesFaceOutwards) {
  for (std::uint64_t i = 0; i < kCars; ++i) {
    const CarModel car = faceted(i, 0.06);
    const Dimensions& d = car.dimensions;
    const double box = d.length * d.width * d.height;
    EXPECT_GT(signed_volume(car, false), 0.35 * box) << "car " << i;
    EXPECT_LT(signed_volume(car, false), 0.95 * box) << "car " << i;
    EXPECT_GT(signed_volume(car, true), 0.0);
    // Flanks to the sides, the roof upwards.
    int wrong = 0;
    for (std::size_t t = 0; t < car.mesh.triangles.size(); ++t) {
      if (static_cast<CarMaterial>(car.mesh.materials[t]) != CarMaterial::kPaint) continue;
      const Eigen::Vector3i& c = car.mesh.triangles[t];
      const Eigen::Vector3d& a = car.mesh.vertices[c[0]];
      const Eigen::Vector3d& b = car.mesh.vertices[c[1]];
      const Eigen::Vector3d& e = car.mesh.vertices[c[2]];
      const Eigen::Vector3d n = (b - a).cross(e - a).normalized(), middle = (a + b + e) / 3.0;
      if (std::abs(n.z()) > 0.9 && n.z() * middle.z() < 0.0) ++wrong;
      if (std::abs(n.y()) > 0.9 && n.y() < 0.0) ++wrong;
    }
    EXPECT_EQ(wrong, 0) << "car " << i;
  }
}

TEST(FacetedBody, EachPairOfKeypointsMovesByItself) {
  // Heights, which centring the car again leaves alone; moves that are too large are drawn again.
  double squares = 0.0, product = 0.0;
  int count = 0;
  for (std::uint64_t i = 0; i < kCars; ++i) {
    const CarModel before = sample_car(CounterRandom(3), i), after = faceted(i, 0.05);
    double last = 0.0;
    for (int k = 2; k < kSide; ++k) {
      const double up = after.keypoints[k].y() - before.keypoints[k].y();
      squares += up * up;
      if (k > 2) product += up * last;
      last = up;
      ++count;
    }
  }
  const double deviation = std::sqrt(squares / count);
  EXPECT_GT(deviation, 0.02);
  EXPECT_LT(deviation, 0.06);
  EXPECT_LT(std::abs(product / squares), 0.15);  // neighbours have nothing in common
}

TEST(FacetedBody, IsCentredOnItsWheelsPlane) {
  for (std::uint64_t i = 0; i < kCars; ++i) {
    const CarModel car = faceted(i, 0.06);
    Eigen::AlignedBox3d box;
    for (const Eigen::Vector3d& v : car.mesh.vertices) box.extend(v);
    EXPECT_NEAR(box.center().x(), 0.0, 1e-9);
    EXPECT_NEAR(box.center().z(), 0.0, 1e-9);
    EXPECT_NEAR(box.min().y(), 0.0, 1e-9);
    EXPECT_NEAR(box.sizes().x(), car.dimensions.length, 1e-9);
    EXPECT_NEAR(box.sizes().z(), car.dimensions.width, 1e-9);
    EXPECT_NEAR(box.max().y(), car.dimensions.height, 1e-9);
    // Wheels flush with their arches.
    EXPECT_NEAR(car.keypoints[0].z(), 0.5 * (car.keypoints[7].z() + car.keypoints[8].z()) + 0.005,
                1e-9);
  }
}

}  // namespace
}  // namespace camber
