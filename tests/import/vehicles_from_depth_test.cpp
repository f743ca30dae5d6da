#include "camber/import/vehicles_from_depth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace camber {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;
constexpr std::uint8_t kRoad = 1, kCar = 14, kPost = 6;

/// Half a SYNTHIA-SF image.
const PinholeCamera kCamera{960, 540, 423.8, 423.8, 479.5, 269.5};

/// A block in the frame of a vehicle (x front, y up, z right), m.
struct Block {
  Eigen::Vector3d least, most;
};

/// A car of two blocks, 4.4 x 1.8 x 1.5 m: a bonnet of 1.7 m before the cabin.
const std::vector<Block> kCarBlocks = {{{-2.2, 0.0, -0.9}, {2.2, 0.9, 0.9}},
                                       {{-2.2, 0.9, -0.8}, {0.5, 1.5, 0.8}}};

/// Where a ray from `origin` enters a block; infinite if it misses.
double entry(const Block& block, const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) {
  double from = 0.0, to = std::numeric_limits<double>::infinity();
  for (int k = 0; k < 3; ++k) {
    const double a = (block.least[k] - origin[k]) / direction[k],
                 b = (block.most[k] - origin[k]) / direction[k];
    from = std::max(from, std::min(a, b));
    to = std::min(to, std::max(a, b));
  }
  return from < to ? from : std::numeric_limits<double>::infinity();
}

/// A road 1.65 m below the camera, turned by a grade, with cars on it.
struct Street {
  Plane road{{0.0, -1.0, 0.0}, 1.65};
  std::vector<SE3> cars;  // camera_from_vehicle
  std::vector<std::pair<SE3, Block>> posts;
  DepthImage depth;
  Image classes;

  /// @param yaw  of the car's front from the camera's right axis, about up.
  void add_car(double x, double z, double yaw) {
    const Eigen::Vector3d up = road.normal;
    Eigen::Vector3d forward(std::cos(yaw), 0.0, std::sin(yaw));
    forward = (forward - forward.dot(up) * up).normalized();
    Eigen::Matrix3d rotation;
    rotation << forward, up, forward.cross(up);
    cars.emplace_back(rotation, road.foot({x, 1.65, z}));
  }

  void draw() {
    depth = {kCamera.width, kCamera.height, {}};
    classes = {kCamera.width, kCamera.height, 1, {}};
    for (int y = 0; y < kCamera.height; ++y) {
      for (int x = 0; x < kCamera.width; ++x) {
        const Eigen::Vector3d ray((x - kCamera.cx) / kCamera.fx, (y - kCamera.cy) / kCamera.fy, 1);
        double nearest = std::numeric_limits<double>::infinity();
        std::uint8_t label = 0;
        const auto meet = [&](double distance, std::uint8_t what) {
          if (!(distance < nearest)) return;
          nearest = distance;
          label = what;
        };
        if (const auto ground = road.intersect_ray(ray)) meet(ground->z(), kRoad);
        const auto meet_block = [&](const SE3& pose, const Block& block, std::uint8_t what) {
          const SE3 inverse = pose.inverse();
          meet(entry(block, inverse.translation(), inverse.rotation() * ray), what);
        };
        for (const SE3& car : cars) {
          for (const Block& block : kCarBlocks) meet_block(car, block, kCar);
        }
        for (const auto& [pose, block] : posts) meet_block(pose, block, kPost);
        depth.metres.push_back(std::isfinite(nearest) ? static_cast<float>(nearest)
                                                      : std::numeric_limits<float>::quiet_NaN());
        classes.data.push_back(label);
      }
    }
  }

  std::vector<TruthVehicle> fit() {
    draw();
    std::vector<TruthVehicle> out;
    const LabelledDepth image{&depth, &classes, {kRoad}};
    for (const VehicleRegion& region : vehicle_regions(depth, classes, {}, {kCar})) {
      const auto vehicle = fit_vehicle_to_depth(region, image, kCamera, "car");
      if (vehicle) out.push_back(*vehicle);
    }
    return out;
  }
};

double rotation_between(const SE3& a, const SE3& b) {
  return rotation_to_vector(a.rotation().conjugate() * b.rotation()).norm();
}

TEST(VehiclesFromDepth, ACarThatShowsSideAndEndIsFoundInFull) {
  // Rear and front views, either side, on level and on inclined roads.
  for (const double grade : {0.0, 8.0 * kDegree}) {
    for (const double yaw : {62.0, 118.0, -65.0, -120.0, 30.0, 155.0}) {
      Street street;
      street.road.normal = Eigen::Vector3d(0.0, -std::cos(grade), -std::sin(grade));
      street.add_car(1.0, 11.0, yaw * kDegree);
      const std::vector<TruthVehicle> found = street.fit();
      ASSERT_EQ(found.size(), 1u) << yaw;
      const TruthVehicle& car = found.front();
      EXPECT_EQ(car.uncertain, "") << yaw;
      // Pixels are 2.6 cm there, on a face that is seen slantwise 6 cm, and its outermost ones are
      // not told from what lies behind.
      EXPECT_LT((car.pose.bottom_center() - street.cars.front().translation()).norm(), 0.09) << yaw;
      EXPECT_LT(rotation_between(car.pose.camera_from_vehicle, street.cars.front()), 1.0 * kDegree)
          << yaw;
      EXPECT_NEAR(car.pose.dimensions.length, 4.4, 0.1) << yaw;
      EXPECT_NEAR(car.pose.dimensions.width, 1.8, 0.16) << yaw;
      EXPECT_NEAR(car.pose.dimensions.height, 1.5, 0.03) << yaw;
      ASSERT_TRUE(car.plane);
      EXPECT_LT(angle_between(car.plane->normal, street.road.normal), 0.5 * kDegree);
      EXPECT_EQ(car.occlusion, 0.0);
      EXPECT_EQ(car.truncation, 0.0);
    }
  }
}

TEST(VehiclesFromDepth, FlagsWhatIsNotSeen) {
  Street straight;
  straight.add_car(0.0, 12.0, 90.0 * kDegree);
  std::vector<TruthVehicle> found = straight.fit();
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].uncertain, box_flags::kOneSide);
  // The rear is where it is, and the length is its class's.
  EXPECT_NEAR(found[0].pose.bottom_center().z() - 0.5 * found[0].pose.dimensions.length, 9.8, 0.05);
  EXPECT_NEAR(found[0].pose.dimensions.width, 1.8, 0.1);
  EXPECT_LT(rotation_between(found[0].pose.camera_from_vehicle, straight.cars[0]), 2.0 * kDegree);

  Street hidden;
  hidden.add_car(1.5, 11.0, 62.0 * kDegree);
  hidden.posts.push_back({SE3(Eigen::Quaterniond::Identity(), {0.55, 0.0, 7.0}),
                          {{-0.15, -2.0, -0.15}, {0.15, 1.65, 0.15}}});
  found = hidden.fit();
  ASSERT_GE(found.size(), 1u);
  for (const TruthVehicle& car : found) EXPECT_EQ(car.uncertain, box_flags::kOccluded);

  Street cut;
  cut.add_car(10.5, 9.0, 62.0 * kDegree);
  found = cut.fit();
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].uncertain, box_flags::kTruncated);
  EXPECT_GT(found[0].truncation, 0.05);
  EXPECT_GT(found[0].box.x2, kCamera.width);

  Street floating;
  floating.add_car(1.0, 11.0, 62.0 * kDegree);
  floating.draw();
  const LabelledDepth no_ground{&floating.depth, &floating.classes, {99}};
  const auto regions = vehicle_regions(floating.depth, floating.classes, {}, {kCar});
  ASSERT_EQ(regions.size(), 1u);
  const auto car = fit_vehicle_to_depth(regions[0], no_ground, kCamera, "car");
  ASSERT_TRUE(car);
  EXPECT_EQ(car->uncertain, box_flags::kGround);
}

TEST(VehiclesFromDepth, CarsInARowAreToldApartByDepthOrByNumber) {
  Street row;
  row.add_car(2.5, 10.0, 90.0 * kDegree);
  row.add_car(2.6, 16.0, 90.0 * kDegree);
  row.add_car(-2.5, 10.0, -90.0 * kDegree);
  row.draw();
  EXPECT_EQ(vehicle_regions(row.depth, row.classes, {}, {kCar}).size(), 3u);
  EXPECT_EQ(vehicle_regions(row.depth, row.classes, {}, {kPost}).size(), 0u);

  // Numbers win: the two on the right are one vehicle by them.
  std::vector<std::uint16_t> numbers;
  for (int y = 0; y < kCamera.height; ++y) {
    for (int x = 0; x < kCamera.width; ++x) numbers.push_back(x < 480 ? 300 : 7);
  }
  const auto regions = vehicle_regions(row.depth, row.classes, numbers, {kCar});
  ASSERT_EQ(regions.size(), 2u);
  EXPECT_EQ(regions[0].instance, 7);
  EXPECT_EQ(regions[1].instance, 300);
  // Neighbouring classes are never one vehicle.
  for (std::size_t i = 0; i < row.classes.data.size(); ++i) {
    if (row.classes.data[i] == kCar && i % kCamera.width > 480) row.classes.data[i] = 15;
  }
  std::size_t trucks = 0;
  for (const auto& region : vehicle_regions(row.depth, row.classes, {}, {kCar, 15})) {
    trucks += region.class_id == 15 ? 1 : 0;
  }
  EXPECT_EQ(trucks, 2u);
}

}  // namespace
}  // namespace camber
