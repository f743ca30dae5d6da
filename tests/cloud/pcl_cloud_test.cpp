// To PCL's clouds and back.

#include "camber/cloud/pcl.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <pcl/point_types.h>

#include <limits>
#include <stdexcept>
#include <string>

#include "cloud/cloud_files.h"

namespace camber {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string refusal(const pcl::PCLPointCloud2& cloud) {
  try {
    from_pcl(cloud);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(PclCloud, ABlobKeepsEveryAttribute) {
  const RoadCloud cloud = test::make_full_cloud(10000);  // more than a batch
  const pcl::PCLPointCloud2 blob = to_pcl_blob(cloud);
  EXPECT_EQ(blob.width, 10000u);
  EXPECT_TRUE(blob.is_dense);
  const RoadCloud back = from_pcl(blob);
  EXPECT_EQ(back.points, cloud.points);
  EXPECT_EQ(back.colors, cloud.colors);
  EXPECT_EQ(back.sigmas, cloud.sigmas);
  EXPECT_EQ(back.covariances, cloud.covariances);
  EXPECT_EQ(back.normals, cloud.normals);
  EXPECT_EQ(back.labels, cloud.labels);
  EXPECT_EQ(back.scalars, cloud.scalars);
  EXPECT_TRUE(from_pcl(to_pcl_blob(RoadCloud())).empty());
}

TEST(PclCloud, APointTypeTakesTheFieldsThatItHas) {
  RoadCloud cloud = test::make_full_cloud(5);
  cloud.labels["label"] = {3, -1, 0, 7, 2};
  const auto points = to_pcl<pcl::PointXYZRGBNormal>(cloud);
  ASSERT_EQ(points.size(), 5u);
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_EQ(points[i].getVector3fMap(), cloud.points[i]);
    EXPECT_EQ(points[i].getNormalVector3fMap(), cloud.normals[i]);
    EXPECT_EQ(points[i].r, cloud.colors[i][0]);
    EXPECT_EQ(points[i].g, cloud.colors[i][1]);
    EXPECT_EQ(points[i].b, cloud.colors[i][2]);
    EXPECT_EQ(points[i].data[3], 1.0f);  // PCL's own default is left
  }
  EXPECT_EQ(to_pcl<pcl::PointXYZI>(cloud)[4].intensity, cloud.scalars["intensity"][4]);
  const auto labelled = to_pcl<pcl::PointXYZL>(cloud);
  EXPECT_EQ(labelled[3].label, 7u);
  EXPECT_EQ(labelled[1].label, 0u);  // a number without a sign has no -1
  EXPECT_EQ(to_pcl<pcl::PointXYZRGBA>(cloud)[2].a, 255);
}

TEST(PclCloud, FieldsOfAPointTypeAreKept) {
  pcl::PointCloud<pcl::PointXYZRGBNormal> points(3, 2);
  for (std::size_t i = 0; i < 6; ++i) {
    const auto n = static_cast<float>(i);
    points[i].x = n;
    points[i].z = -n;
    points[i].normal_y = 1.0f;
    points[i].curvature = 0.5f * n;
    points[i].r = static_cast<std::uint8_t>(200 + i);
    points[i].b = 7;
  }
  points[4].x = std::numeric_limits<float>::quiet_NaN();
  const RoadCloud cloud = from_pcl(points);
  ASSERT_EQ(cloud.size(), 6u);
  EXPECT_EQ(cloud.points[5], Eigen::Vector3f(5, 0, -5));
  EXPECT_TRUE(std::isnan(cloud.points[4].x()));
  EXPECT_EQ(cloud.normals[3].y(), 1.0f);
  EXPECT_THAT(cloud.colors[5], ElementsAre(205, 0, 7));
  EXPECT_THAT(cloud.scalars.at("curvature"), ElementsAre(0.0f, 0.5f, 1.0f, 1.5f, 2.0f, 2.5f));
  EXPECT_FALSE(to_pcl<pcl::PointXYZ>(cloud).is_dense);

  pcl::PointCloud<pcl::PointXYZL> labelled(2, 1);
  labelled[1].label = 9;
  EXPECT_THAT(from_pcl(labelled).labels.at("label"), ElementsAre(0, 9));
}

TEST(PclCloud, ABlobMayHaveDoublesPaddedRowsAndSeveralValuesAField) {
  pcl::PCLPointCloud2 blob;
  const auto field = [&](const char* name, std::uint32_t offset, std::uint8_t type,
                         std::uint32_t count) {
    pcl::PCLPointField f;
    f.name = name;
    f.offset = offset;
    f.datatype = type;
    f.count = count;
    blob.fields.push_back(f);
  };
  field("x", 0, pcl::PCLPointField::FLOAT64, 1);
  field("y", 8, pcl::PCLPointField::FLOAT64, 1);
  field("z", 16, pcl::PCLPointField::FLOAT64, 1);
  field("ring", 24, pcl::PCLPointField::UINT16, 2);
  blob.point_step = 28;
  blob.width = 1;
  blob.height = 2;
  blob.row_step = 32;
  blob.data.resize(60);
  for (std::size_t row = 0; row < 2; ++row) {
    const double easting = 691000.25 + static_cast<double>(row);
    const std::uint16_t ring[2] = {static_cast<std::uint16_t>(row), 40};
    std::memcpy(blob.data.data() + 32 * row, &easting, 8);
    std::memcpy(blob.data.data() + 32 * row + 24, ring, 4);
  }
  const RoadCloud cloud = from_pcl(blob);
  ASSERT_EQ(cloud.size(), 2u);
  EXPECT_EQ(cloud.origin.x() + cloud.points[1].x(), 691001.25);
  EXPECT_THAT(cloud.labels.at("ring_0"), ElementsAre(0, 1));
  EXPECT_THAT(cloud.labels.at("ring_1"), ElementsAre(40, 40));

  pcl::PCLPointCloud2 bad = blob;
  bad.data.resize(59);
  EXPECT_THAT(refusal(bad), HasSubstr("found 59 bytes, expected 2 points of 28"));
  bad = blob;
  bad.is_bigendian = !bad.is_bigendian;
  EXPECT_THAT(refusal(bad), HasSubstr("byte order"));
  bad = blob;
  bad.fields[3].offset = 26;
  EXPECT_THAT(refusal(bad), HasSubstr("'ring': found it at byte 26 of points of 28"));
  bad = blob;
  bad.fields[1].name = "height";
  EXPECT_THAT(refusal(bad), HasSubstr("no field 'y'"));
}

}  // namespace
}  // namespace camber
