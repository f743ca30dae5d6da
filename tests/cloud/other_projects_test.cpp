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
    if (file.cloud.empty()) break;
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
                 {-23.759019851685, -52.001140594482, -3.0212898254395},
                 {18.479932785034, 6.5078692436218, 9.1728048324585}},
        Expected{"ply/lidar_target.ply",
                 69088,
                 "",
                 {-23.337478637695, -74.681610107422, -2.9573359489441},
                 {19.024696350098, 8.9195098876953, 10.795935630798}},
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
        Expected{"e57/A_B.e57",
                 6,
                 "",
                 {-44.9522018, -1.3493000, -0.6076999},
                 {-42.6394997, 2.0578001, 0.6667000}},
        Expected{"las/1.0_0.las", 1, "", {470692.44, 4602888.9, 16}, {470692.44, 4602888.9, 16}},
        Expected{"las/1.1_1.las", 1, "", {470692.44, 4602888.9, 16}, {470692.44, 4602888.9, 16}},
        Expected{"las/1.2-with-color.las",
                 1065,
                 "",
                 {635619.85, 848899.7, 406.59},
                 {638982.55, 853535.43, 586.38}},
        Expected{"las/1.2_3.las", 1, "", {470692.44, 4602888.9, 16}, {470692.44, 4602888.9, 16}},
        Expected{"las/autzen_trim.las",
                 110000,
                 "",
                 {636001.76, 848935.2, 406.26},
                 {637179.22, 849497.9, 520.51}},
        Expected{"las/bad_vlr_count.las", -1, "byte 429: found no room for record 3", {}, {}},
        Expected{"las/extrabytes.las",
                 1065,
                 "",
                 {635619.85, 848899.7, 406.59},
                 {638982.55, 853535.43, 586.38}},
        Expected{"las/gps-time-nan.las", 1, "", {0, 0, 0}, {0, 0, 0}},
        Expected{"las/no-points.las", 0, "", {}, {}},
        Expected{"las/simple.las",
                 1065,
                 "",
                 {635619.85, 848899.7, 406.59},
                 {638982.55, 853535.43, 586.38}},
        Expected{"las/simple.laz",
                 1065,
                 "",
                 {635619.85, 848899.7, 406.59},
                 {638982.55, 853535.43, 586.38}},
        Expected{"las/test1_4.las",
                 1000,
                 "",
                 {1694038.4456375, 1816492.7062701, 5592.7499174684},
                 {1694539.6770145, 1816497.9762625, 5599.0696867514}},
        Expected{"text/badheader.txt", -1, "line 1: found column 'X' twice", {}, {}},
        Expected{"text/utm17_1.txt",
                 10,
                 "",
                 {289814.15, 4320978.61, 170.58},
                 {289818.5, 4320980.59, 170.76}},
        Expected{"text/crlf_test.txt",
                 10,
                 "",
                 {289814.15, 4320978.61, 170.58},
                 {289818.5, 4320980.59, 170.76}}),
    [](const auto& instance) {
      std::string name = instance.param.path;
      for (char& c : name) {
        if (!std::isalnum(static_cast<unsigned char>(c))) c = '_';
      }
      return name;
    });

}  // namespace
}  // namespace camber
