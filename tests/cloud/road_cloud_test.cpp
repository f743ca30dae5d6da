#include "camber/cloud/road_cloud.h"

#include <gtest/gtest.h>

#include "cloud/cloud_files.h"

namespace camber {
namespace {

TEST(RoadCloud, SelectKeepsOrderRepeatsAndAllAttributes) {
  const RoadCloud cloud = test::make_full_cloud(5);
  const RoadCloud chosen = cloud.select({4, 0, 4});
  chosen.validate();
  ASSERT_EQ(chosen.size(), 3u);
  EXPECT_EQ(chosen.frame, CloudFrame::kCamera);
  for (const auto& [to, from] : {std::pair<std::size_t, std::size_t>{0, 4}, {1, 0}, {2, 4}}) {
    EXPECT_EQ(chosen.points[to], cloud.points[from]);
    EXPECT_EQ(chosen.colors[to], cloud.colors[from]);
    EXPECT_EQ(chosen.sigmas[to], cloud.sigmas[from]);
    EXPECT_EQ(chosen.covariances[to], cloud.covariances[from]);
    EXPECT_EQ(chosen.normals[to], cloud.normals[from]);
    EXPECT_EQ(chosen.labels.at("patch")[to], cloud.labels.at("patch")[from]);
    EXPECT_EQ(chosen.scalars.at("intensity")[to], cloud.scalars.at("intensity")[from]);
  }
  EXPECT_TRUE(cloud.select({}).empty());
  EXPECT_THROW(cloud.select({5}), std::invalid_argument);
  EXPECT_THROW(cloud.select({-1}), std::invalid_argument);
}

TEST(RoadCloud, ValidateNamesTheArrayOfTheWrongLength) {
  const RoadCloud good = test::make_full_cloud(3);
  good.validate();
  const auto message = [](const RoadCloud& cloud) -> std::string {
    try {
      cloud.validate();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  RoadCloud cloud = good;
  cloud.colors.pop_back();
  EXPECT_EQ(message(cloud),
            "cloud attribute 'colors' has 2 entries, expected 3, one for each point");
  cloud = good;
  cloud.labels["patch"].push_back(0);
  EXPECT_EQ(message(cloud),
            "cloud attribute 'patch' has 4 entries, expected 3, one for each point");
  cloud = good;
  cloud.scalars["empty"];
  EXPECT_EQ(message(cloud),
            "cloud attribute 'empty' has 0 entries, expected 3, one for each point");
  cloud = good;
  cloud.sigmas.clear();
  EXPECT_EQ(message(cloud), "");
}

TEST(RoadCloud, UpIsTheCamerasOnlyInACameraFrame) {
  RoadCloud cloud;
  EXPECT_EQ(cloud.default_up(), Eigen::Vector3d(0, 0, 1));
  cloud.frame = CloudFrame::kCamera;
  EXPECT_EQ(cloud.default_up(), Eigen::Vector3d(0, -1, 0));
}

}  // namespace
}  // namespace camber
