#include "camber/scene/vehicle_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace camber {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

VehicleEstimate vehicle_at(int id, double right, double ahead, double sigma) {
  VehicleEstimate out;
  out.id = id;
  out.vehicle_class = "car";
  out.status = Status::kOk;
  out.pose.dimensions = {4.2, 1.8, 1.5};
  out.pose.camera_from_vehicle =
      SE3(rotation_from_rotation_y(-1.5707963267948966), Eigen::Vector3d(right, 1.3, ahead));
  out.covariance.setZero();
  out.covariance(2, 2) = sigma * sigma;
  return out;
}

VehicleDocument two_vehicles() {
  VehicleDocument out;
  VehicleFrame frame;
  frame.id = 7;
  frame.vehicles = {vehicle_at(0, 2.04, 31.26, 1.2), vehicle_at(4, -1.2, 15.84, 0.21)};
  frame.vehicles[0].status = Status::kWeak;
  frame.vehicles[0].reason = "far";
  out.frames = {frame};
  return out;
}

TEST(VehicleTable, SaysWhereTheVehiclesAreTheNearestFirst) {
  const std::vector<std::string> lines = vehicle_lines(two_vehicles(), 7);
  ASSERT_EQ(lines.size(), 2u);
  EXPECT_EQ(lines[0], "car 4     15.8 ± 0.2 m ahead, 1.2 m left");
  EXPECT_EQ(lines[1], "car 0     31.3 ± 1.2 m ahead, 2.0 m right (weak: far)");
  EXPECT_TRUE(vehicle_lines(two_vehicles(), 8).empty());
}

TEST(VehicleTable, IsUpToScaleWhereTheResultIs) {
  VehicleDocument document = two_vehicles();
  document.metric = false;
  EXPECT_THAT(vehicle_lines(document, 7)[0], HasSubstr("units ahead"));
  EXPECT_THAT(vehicles_csv(document, {}), HasSubstr("ahead_units"));
}

TEST(VehicleTable, HasARowAVehicle) {
  VehicleDocument document = two_vehicles();
  document.frames[0].vehicles[1].vehicle_class = "car, white";
  const std::string text = vehicles_csv(document, {{7, 0.7}});
  EXPECT_THAT(text, StartsWith("frame,time_s,number,id,track,class,status,ahead_m,ahead_sigma_m,"));
  EXPECT_THAT(text, HasSubstr("\r\n7,0.700,0,0,,car,weak,31.260,1.200,2.040,0.000,"));
  EXPECT_THAT(text, HasSubstr("\r\n7,0.700,4,4,,\"car, white\",ok,15.840,0.210,-1.200,"));
  EXPECT_THAT(vehicles_csv(document, {}), HasSubstr("\r\n7,,4,4,"));
}

}  // namespace
}  // namespace camber
