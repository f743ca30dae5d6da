// Real files, ordinary, odd and damaged, of other projects' test suites: what each must give.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cctype>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

struct Expected {
  const char* path;
  long points;  // -1: an error whose message holds `text`
  const char* text;
  double low[3], high[3];  // true bounds
};

class OtherProjects : public ::testing::TestWithParam<Expected> {};

TEST_P(OtherProjects, GiveTheExpectedOutcome) {
  const Expected& expected = GetParam();
  CAMBER_REQUIRE_DATA("point-cloud-files");
  const std::filesystem::path path = test::data_dir() / "point-cloud-files" / expected.path;
  if (expected.points < 0) {
    try {
      read_cloud(path);
      FAIL() << "no error";
    } catch (const InputError& error) {
      EXPECT_EQ(error.exit_code(), 2);
      EXPECT_THAT(error.what(), HasSubstr(expected.text));
    }
    return;
  }
  const CloudFile file = read_cloud_file(path);
  ASSERT_EQ(file.cloud.size(), static_cast<std::size_t>(expected.points));
  EXPECT_EQ(file.report.non_finite, 0u);
  file.cloud.validate();
  Eigen::Array3d low = Eigen::Array3d::Constant(1e300), high = -low;
  for (const Eigen::Vector3f& p : file.cloud.points) {
    const Eigen::Array3d x = (file.cloud.origin + p.cast<double>()).array();
    low = low.min(x);
    high = high.max(x);
  }
  for (int axis = 0; axis < 3; ++axis) {
    // Floats within 1000 m of the origin resolve 0.06 mm.
    EXPECT_NEAR(low[axis], expected.low[axis], 1e-4) << axis;
    EXPECT_NEAR(high[axis], expected.high[axis], 1e-4) << axis;
  }
}

// The counts and bounds were taken with a reader of its own, in another language.
INSTANTIATE_TEST_SUITE_P(
    PointCloudFiles, OtherProjects,
    ::testing::Values(
        Expected{"pcd/autzen-utm.pcd",
                 1065,
                 "",
                 {493994.87, 4877429.62, 123.93},
                 {494993.68, 4878817.02, 178.73}},
        Expected{"pcd/utm17_space.pcd",
                 10,
                 "",
                 {289814.15, 4320978.61, 170.58},
                 {289818.5, 4320980.59, 170.76}},
        Expected{"pcd/utm17_comma.pcd",
                 10,
                 "",
                 {289814.15, 4320978.61, 170.58},
                 {289818.5, 4320980.59, 170.76}},
        Expected{"pcd/missingheader.pcd", -1, "line 1: found '289814.15", {}, {}},
        Expected{
            "ply/icosahedron_ascii.ply", 12, "", {-0.894425, -0.85064, -1}, {0.894425, 0.85064, 1}},
        Expected{"ply/lidar_source.ply",
                 69792,
                 "",
                 {-23.75901985, -52.00114059, -3.021289825},
                 {18.47993279, 6.507869244, 9.172804832}},
        Expected{"ply/lidar_target.ply",
                 69088,
                 "",
                 {-23.33747864, -74.68161011, -2.957335949},
                 {19.02469635, 8.919509888, 10.79593563}},
        Expected{"ply/mesh.ply", 4, "", {1, 1, 0}, {2, 2, 2}},
        Expected{"ply/no_vertex.ply", -1, "line 3: found no element 'vertex'", {}, {}},
        Expected{"ply/platonic_shelf.ply",
                 50,
                 "",
                 {-6.524307, -1.158087, -1.158087},
                 {6.963232, 1.158087, 1.158086}},
        Expected{"ply/platonic_shelf_ascii.ply",
                 50,
                 "",
                 {-6.524307, -1.158087, -1.158087},
                 {6.963232, 1.158087, 1.158086}},
        Expected{"ply/simple_binary.ply", 3, "", {-1, 0, 0}, {1, 1, 0}},
        Expected{"ply/simple_text.ply", 3, "", {-1, 0, 0}, {1, 1, 0}},
        Expected{"ply/sized_dims.ply", 1, "", {1, 12346, 0}, {1, 12346, 0}},
        Expected{"ply/text_extradim.ply",
                 1,
                 "",
                 {-2.64944, -13.0955, 0.00640115},
                 {-2.64944, -13.0955, 0.00640115}},
        Expected{"e57/A_B.e57", -1, "found an E57 file", {}, {}}),
    [](const auto& instance) {
      std::string name = instance.param.path;
      for (char& c : name) {
        if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
      }
      return name;
    });

}  // namespace
}  // namespace camber
