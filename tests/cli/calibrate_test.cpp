// camber calibrate: the camera of a film by the film, and what it refuses.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "camber/import/formats/calibration.h"
#include "camber/scene/scene.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::run_camber;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Calibrate : public ::testing::Test {
 protected:
  std::string at(const std::string& name) const { return (folder_.path() / name).string(); }
  static std::string film() {
    return (test::source_dir() / "samples/own_drive/drive.mp4").string();
  }
  /// Files of the folder, hidden ones too.
  std::size_t files() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_.path()), fs::directory_iterator()));
  }
  test::TemporaryFolder folder_;
};

TEST_F(Calibrate, AFilmShowsItsCamera) {
  const auto result = run_camber({"calibrate", film(), "--out", at("camera.yaml"), "--scene",
                                  at("scene"), "--height", "1.4", "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const json found = json::parse(result.out);
  const json& camera = found.at("camera");
  // samples/own_drive/camera.yaml: 560, 478.5, 250; k1 -0.3, k2 0.1. Within three sigma, and known.
  const auto within = [&](const char* key, double truth, double known) {
    const double sigma = camera.at(key).at("sigma");
    EXPECT_NEAR(camera.at(key).at("value"), truth, 3.0 * sigma) << key;
    EXPECT_LT(sigma, known) << key;
  };
  within("focal", 560.0, 56.0);
  within("cx", 478.5, 12.0);
  within("cy", 250.0, 12.0);
  within("k1", -0.3, 0.1);
  EXPECT_THAT(camera.at("focal").at("decided_by"), HasSubstr("epipolar"));
  EXPECT_GT(found.at("mounting").at("pitch_deg").at("sigma"), 0.0);

  // The file is read as any calibration, with what it states of itself.
  const CalibrationFile file = read_calibration(at("camera.yaml"));
  ASSERT_EQ(file.cameras.size(), 1U);
  EXPECT_EQ(file.cameras[0].width, 960);
  EXPECT_NEAR(file.cameras[0].fx, camera.at("focal").at("value").get<double>(), 1e-5);
  EXPECT_NEAR(file.cameras[0].sigma.focal, camera.at("focal").at("relative_sigma").get<double>(),
              1e-6);
  EXPECT_GT(file.cameras[0].sigma.principal, 0.0);
  EXPECT_GT(file.cameras[0].sigma.distortion, 0.0);

  const Scene scene = read_scene(at("scene"));
  EXPECT_EQ(scene.distortion.model, LensModel::kBrown);
  EXPECT_NEAR(scene.distortion.raw.fx, file.cameras[0].fx, 1e-5);
  EXPECT_NEAR(scene.camera_sigma.focal, file.cameras[0].sigma.focal, 1e-6);
  EXPECT_EQ(scene.height_above_road, 1.4);
  EXPECT_FALSE(scene.frames.empty());
  EXPECT_EQ(files(), 2U);
}

TEST_F(Calibrate, AScenesOwnCalibrationIsNotUsed) {
  ASSERT_EQ(run_camber({"import", film(), "--fov", "50", "--out", at("narrow")}).exit_code, 0);
  ASSERT_EQ(run_camber({"calibrate", film(), "--out", at("a.yaml")}).exit_code, 0);
  ASSERT_EQ(run_camber({"calibrate", at("narrow"), "--out", at("b.yaml")}).exit_code, 0);
  EXPECT_EQ(read_calibration(at("a.yaml")).cameras[0].fx,
            read_calibration(at("b.yaml")).cameras[0].fx);
  const auto refused =
      run_camber({"calibrate", at("narrow"), "--height", "1.4", "--out", at("c.yaml")});
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_THAT(refused.error, HasSubstr("--height"));
}

TEST_F(Calibrate, ACameraThatStandsHasNoAnswer) {
  fs::create_directories(folder_.path() / "images");
  for (int k = 0; k < 5; ++k) {
    test::write_png(folder_.path() / "images" / (std::to_string(k) + ".png"), 160, 120, 2, 8,
                    test::picture(160, 120, 3));
  }
  const auto result = run_camber({"calibrate", at("images"), "--out", at("camera.yaml"), "--scene",
                                  at("scene"), "--rate", "10"});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.error, HasSubstr("stands"));
  EXPECT_EQ(files(), 1U);
}

/// A made drive with boxes and keypoints: what its vehicles and its height say agrees with its
/// turns.
TEST_F(Calibrate, VehiclesAreSources) {
  const auto made = run_camber({"synth", "--drive", "--seed", "1", "--frames", "60", "--size",
                                "768x240", "--supersampling", "1", "--out", at("drive"), "--json"});
  ASSERT_EQ(made.exit_code, 0) << made.error;
  const double log_height = std::log(json::parse(made.out).at("true_height").get<double>());
  const double log_focal = std::log(read_scene(at("drive")).camera.fx);
  const auto result = run_camber({"calibrate", at("drive"), "--out", at("camera.yaml"), "--json"});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const json found = json::parse(result.out);
  std::vector<std::string> names;
  for (const json& source : found.at("sources")) {
    names.push_back(source.at("name"));
    const double truth = source.at("by_log_focal").get<double>() * log_focal +
                         source.at("by_log_height").get<double>() * log_height;
    if (!source.at("accepted")) continue;
    EXPECT_NEAR(source.at("value"), truth, 3.0 * source.at("sigma").get<double>()) << names.back();
    EXPECT_LE(source.at("common_sigma"), source.at("sigma")) << names.back();
  }
  EXPECT_THAT(names, ::testing::IsSupersetOf(
                         {"epipolar_geometry", "given_height", "vehicle_sizes", "dashes"}));
  const json& focal = found.at("camera").at("focal");
  EXPECT_NEAR(std::log(focal.at("value").get<double>()), log_focal,
              3.0 * focal.at("relative_sigma").get<double>());
  EXPECT_THAT(test::read_text(at("camera.yaml")), HasSubstr("#   sizes of "));
  EXPECT_EQ(
      run_camber({"calibrate", at("drive"), "--out", at("c.yaml"), "--markings", "none"}).exit_code,
      2);
}

TEST_F(Calibrate, RefusesBadInput) {
  EXPECT_EQ(run_camber({"calibrate", at("nothing"), "--out", at("a.yaml")}).exit_code, 2);
  EXPECT_EQ(run_camber({"calibrate", film()}).exit_code, 2);
  std::ofstream(folder_.path() / "no.mp4") << "no film";
  EXPECT_EQ(run_camber({"calibrate", at("no.mp4"), "--out", at("a.yaml")}).exit_code, 2);
  EXPECT_EQ(run_camber({"calibrate", film(), "--frames", "900", "--out", at("a.yaml")}).exit_code,
            2);
  EXPECT_EQ(run_camber({"calibrate", film(), "--out", at("none/a.yaml")}).exit_code, 3);
  EXPECT_EQ(files(), 1U);
}

}  // namespace
}  // namespace camber
