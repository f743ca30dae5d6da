#include "camber/synth/car_family.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <map>
#include <utility>

namespace camber {
namespace {

// Each directed edge must appear once, and its reverse once: closed and consistently oriented.
void expect_closed(const CarModel& car) {
  std::map<std::pair<int, int>, int> edges;
  for (const Eigen::Vector3i& t : car.mesh.triangles) {
    for (int i = 0; i < 3; ++i) ++edges[{t[i], t[(i + 1) % 3]}];
  }
  int bad = 0;
  for (const auto& [edge, count] : edges) {
    const auto reverse = edges.find({edge.second, edge.first});
    if (count != 1 || reverse == edges.end()) ++bad;
  }
  EXPECT_EQ(bad, 0) << "edges without their reverse";
}

double volume(const CarModel& car) {
  double sum = 0.0;
  for (const Eigen::Vector3i& t : car.mesh.triangles) {
    const auto& v = car.mesh.vertices;
    sum += v[t[0]].dot(v[t[1]].cross(v[t[2]])) / 6.0;
  }
  return sum;
}

void expect_sound(const CarModel& car) {
  ASSERT_EQ(car.mesh.triangles.size(), car.mesh.materials.size());
  for (int material : car.mesh.materials) {
    EXPECT_GE(material, 0);
    EXPECT_LT(material, kNumCarMaterials);
  }
  expect_closed(car);
  Eigen::AlignedBox3d box;
  for (const Eigen::Vector3d& v : car.mesh.vertices) box.extend(v);
  const Dimensions& d = car.dimensions;
  EXPECT_NEAR(box.min().x(), -0.5 * d.length, 1e-9);
  EXPECT_NEAR(box.max().x(), 0.5 * d.length, 1e-9);
  EXPECT_NEAR(box.min().y(), 0.0, 1e-9);
  EXPECT_NEAR(box.max().y(), d.height, 1e-9);
  EXPECT_NEAR(box.min().z(), -0.5 * d.width, 1e-9);
  EXPECT_NEAR(box.max().z(), 0.5 * d.width, 1e-9);
  // A car fills a bit over half of its box; inside-out triangles would make this negative.
  const double share = volume(car) / (d.length * d.width * d.height);
  EXPECT_GT(share, 0.45);
  EXPECT_LT(share, 0.85);
  for (int i = 0; i < kNumKeypoints; ++i) {
    double nearest = 1e9;
    for (const Eigen::Vector3d& v : car.mesh.vertices) {
      nearest = std::min(nearest, (v - car.keypoints[i]).norm());
    }
    EXPECT_LT(nearest, 1e-9) << "keypoint " << i;
  }
  for (int i = 0; i < 18; ++i) {
    const Eigen::Vector3d mirrored = car.keypoints[i + 18].cwiseProduct(Eigen::Vector3d(1, 1, -1));
    EXPECT_LT((mirrored - car.keypoints[i]).norm(), 1e-12) << "keypoint " << i;
    EXPECT_LT(car.keypoints[i].z(), 0.0) << "left side";
  }
  EXPECT_NEAR(car.keypoints[0].y(), car.wheel_radius, 1e-12);
  EXPECT_NEAR(car.keypoints[1].y(), car.wheel_radius, 1e-12);
  EXPECT_GT(car.keypoints[1].x(), car.keypoints[0].x());
}

TEST(CarFamily, ClassMeansAreClosedAndFillTheirBox) {
  for (int c = 0; c < kNumCarClasses; ++c) {
    SCOPED_TRACE(std::string(to_string(static_cast<CarClass>(c))));
    expect_sound(make_car(static_cast<CarClass>(c)));
  }
}

TEST(CarFamily, SampledCarsAreClosedAndFillTheirBox) {
  const CounterRandom random(5);
  for (std::uint64_t i = 0; i < 300; ++i) {
    SCOPED_TRACE(i);
    expect_sound(sample_car(random, i));
  }
}

TEST(CarFamily, SamplesDependOnSeedAndIndexAlone) {
  const CarModel a = sample_car(CounterRandom(3), 17), b = sample_car(CounterRandom(3), 17);
  EXPECT_EQ(a.car_class, b.car_class);
  EXPECT_EQ(a.mesh.vertices, b.mesh.vertices);
  const CarModel other = sample_car(CounterRandom(4), 17);
  EXPECT_NE(a.dimensions.length, other.dimensions.length);
}

TEST(CarFamily, SizesHaveTheMeansOfTheirClass) {
  const CounterRandom random(11);
  for (int c = 0; c < kNumCarClasses; ++c) {
    const auto car_class = static_cast<CarClass>(c);
    const CarProportions mean = mean_proportions(car_class);
    double length = 0.0, width = 0.0, height = 0.0;
    constexpr int kCount = 400;
    for (int i = 0; i < kCount; ++i) {
      const Dimensions d = sample_car(car_class, random, i).dimensions;
      length += d.length / kCount;
      width += d.width / kCount;
      height += d.height / kCount;
    }
    // 4 standard errors of the widest class: 4 * 0.33 / 20, 4 * 0.06 / 20, 4 * 0.11 / 20.
    EXPECT_NEAR(length, mean.length, 0.066);
    EXPECT_NEAR(width, mean.width, 0.012);
    EXPECT_NEAR(height, mean.height, 0.022);
  }
}

}  // namespace
}  // namespace camber
