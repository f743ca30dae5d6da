#include "camber/import/import_kitti.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"
#include "scene/write_image.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::picture;
using test::write_bytes;
using test::write_png;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr const char* kP2 = "100 0 40 6 0 100 30 1.3 0 0 1 0.01";  // offset (0.056, 0.01, 0.01)
constexpr const char* kIdentity = "1 0 0 0 1 0 0 0 1";
/// Laser x forward, y left, z up to camera x right, y down, z forward; laser 0.08 above, 0.3
/// behind.
constexpr const char* kLaser = "0 -1 0 0 0 0 -1 -0.08 1 0 0 -0.3";

/// A small clip: frames 5, 6, 7 of a colour camera.
class KittiClip : public ::testing::Test {
 protected:
  KittiClip() {
    fs::create_directories(path("image_02"));
    for (const int id : {5, 6, 7}) {
      write_png(path("image_02/00000" + std::to_string(id) + ".png"), 80, 60, 2, 8,
                picture(80, 60, 3));
    }
    write_bytes(path("calib.txt"), std::string("P0: 100 0 40 0 0 100 30 0 0 0 1 0\nP2: ") + kP2 +
                                       "\nR0_rect: " + kIdentity +
                                       "\nTr_velo_to_cam: " + kLaser);  // no newline at the end
    write_bytes(path("labels.txt"),
                "5 -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1\n"
                "5 3 Car 0 2 0.1 10 20 30 40 1.5 1.75 4.25 1 1.6 20 0.5\n"
                "5 4 Pedestrian 0 0 0.1 10 20 30 40 1.8 0.5 0.5 1 1.6 20 0.5\n"
                "6 3 Van 1 0 0.1 11 20 30 40 1.5 1.75 4.25 1 1.6 19 0.5\n"
                "9 3 Car 0 0 0.1 11 20 30 40 1.5 1.75 4.25 1 1.6 19 0.5\n");
    options_.images = path("image_02");
  }
  fs::path path(const std::string& name) const { return folder_.path() / name; }

  std::string error_of(const KittiImportOptions& options) {
    try {
      import_kitti(options);
    } catch (const Error& error) {
      EXPECT_EQ(error.exit_code(), 2);
      const std::string message = error.what();
      const std::string start = folder_.path().string() + "/";
      EXPECT_EQ(message.find('\n'), std::string::npos);
      return message.rfind(start, 0) == 0 ? message.substr(start.size()) : message;
    }
    return "no error";
  }
  std::string error() { return error_of(options_); }

  test::TemporaryFolder folder_;
  KittiImportOptions options_;
};

TEST_F(KittiClip, CameraFramesAndTimes) {
  const Scene scene = import_kitti(options_);  // calib.txt beside the images
  EXPECT_EQ(scene.camera.width, 80);
  EXPECT_EQ(scene.camera.height, 60);
  EXPECT_EQ(scene.camera.fx, 100);
  EXPECT_EQ(scene.camera.cy, 30);
  EXPECT_EQ(scene.height_above_road, 1.65);
  EXPECT_EQ(scene.name, folder_.path().filename().string());
  ASSERT_EQ(scene.frames.size(), 3u);
  EXPECT_EQ(scene.frames[1].id, 6);
  EXPECT_EQ(scene.frames[1].time_s, 0.6);
  EXPECT_EQ(scene.frames[1].image, path("image_02/000006.png"));
  EXPECT_FALSE(scene.truth);
  EXPECT_FALSE(scene.reference_frame);
  EXPECT_EQ(scene.detections_source, "");
  options_.frames = "5:7:2";
  EXPECT_EQ(import_kitti(options_).frames.size(), 2u);
}

TEST_F(KittiClip, LabelsBecomeTruthInTheColourCamera) {
  options_.labels = path("labels.txt");
  const Scene scene = import_kitti(options_);
  ASSERT_TRUE(scene.truth);
  ASSERT_EQ(scene.truth->frames.size(), 3u);
  ASSERT_EQ(scene.truth->frames[0].vehicles.size(), 1u);  // no DontCare, no pedestrian
  const TruthVehicle& car = scene.truth->frames[0].vehicles[0];
  EXPECT_EQ(car.id, 3);
  EXPECT_EQ(car.vehicle_class, "car");
  // K^-1 (6, 1.3, 0.01) = ((6 - 40 * 0.01) / 100, (1.3 - 30 * 0.01) / 100, 0.01).
  EXPECT_NEAR((car.pose.bottom_center() - Eigen::Vector3d(1.056, 1.61, 20.01)).norm(), 0, 1e-12);
  EXPECT_NEAR(rotation_y(car.pose.camera_from_vehicle.rotation_matrix()), 0.5, 1e-12);
  EXPECT_EQ(car.pose.dimensions.height, 1.5);
  EXPECT_EQ(car.pose.dimensions.width, 1.75);
  EXPECT_EQ(car.pose.dimensions.length, 4.25);
  EXPECT_EQ(car.occlusion, 0.8);
  EXPECT_EQ(car.truncation, 0);
  EXPECT_EQ(scene.truth->frames[1].vehicles[0].vehicle_class, "van");
  // Flagged as truncated, but its box lies wholly in the image.
  EXPECT_EQ(scene.truth->frames[1].vehicles[0].truncation, 0);
  EXPECT_TRUE(scene.truth->frames[2].vehicles.empty());
  EXPECT_TRUE(scene.frames[0].vehicles.empty());  // nothing of the truth among the inputs
  EXPECT_EQ(scene.detections_source, "");
}

TEST_F(KittiClip, TruncationIsAShare) {
  // Cars across the view at z = 10, 4 m long: their pictures reach about 20 px either side of
  // u = 40 + 10 x, a little less for the far side.
  write_bytes(path("labels.txt"),
              "5 1 Car 1 0 0.1 10 20 30 40 1.5 0.01 4 3.944 1 9.99 0\n"  // middle on the edge
              "5 2 Car 2 0 0.1 10 20 30 40 1.5 0.01 4 0 1 9.99 0\n"      // to be ignored
              "5 3 Car 0 0 0.1 10 20 30 40 1.5 0.01 4 3.944 1 9.99 0\n"  // not flagged
              "5 4 Car 1 0 0.1 10 20 30 40 1.5 0.01 4 0 1 0.05 0\n");    // at the camera
  options_.labels = path("labels.txt");
  const Scene scene = import_kitti(options_);
  const std::vector<TruthVehicle>& cars = scene.truth->frames[0].vehicles;
  ASSERT_EQ(cars.size(), 4u);
  EXPECT_NEAR(cars[0].truncation, 0.525, 0.01);  // columns 60 to 100 of 0 to 79
  EXPECT_EQ(cars[1].truncation, 1);
  EXPECT_EQ(cars[2].truncation, 0);
  EXPECT_EQ(cars[3].truncation, 1);
}

TEST_F(KittiClip, BoxesAreTakenFromLabelsOnlyWhenAskedForAndSaySo) {
  options_.labels = path("labels.txt");
  options_.detections_from_labels = true;
  const Scene scene = import_kitti(options_);
  EXPECT_EQ(scene.detections_source, "truth_boxes");
  ASSERT_EQ(scene.frames[0].vehicles.size(), 1u);
  const VehicleDetection& car = scene.frames[0].vehicles[0];
  EXPECT_EQ(car.id, 3);
  EXPECT_EQ(car.track, 3);
  EXPECT_EQ(car.vehicle_class, "car");
  EXPECT_EQ(car.box.x2, 30);
  EXPECT_TRUE(car.keypoints.empty());
  EXPECT_FALSE(car.has_plane);
  for (const SceneFrame& frame : scene.frames) {
    EXPECT_FALSE(frame.ego_plane);
    EXPECT_FALSE(frame.world_from_camera);
  }
}

TEST_F(KittiClip, DetectorsFilesOfBothForms) {
  write_bytes(path("detections.txt"),
              "5 -1 Car -1 -1 -10 12 22 32 42 -1 -1 -1 -1000 -1000 -1000 -10 0.25\n"
              "5 -1 Truck -1 -1 -10 50 22 60 42 -1 -1 -1 -1000 -1000 -1000 -10 0.5\n");
  options_.detections = path("detections.txt");
  Scene scene = import_kitti(options_);
  EXPECT_EQ(scene.detections_source, "network");
  EXPECT_FALSE(scene.truth);
  ASSERT_EQ(scene.frames[0].vehicles.size(), 2u);
  EXPECT_EQ(scene.frames[0].vehicles[0].id, 0);  // no tracks: ids by row
  EXPECT_EQ(scene.frames[0].vehicles[1].id, 1);
  EXPECT_EQ(scene.frames[0].vehicles[1].track, -1);
  EXPECT_EQ(scene.frames[0].vehicles[1].vehicle_class, "truck");
  EXPECT_EQ(scene.frames[0].vehicles[1].score, 0.5);

  fs::create_directories(path("detections"));
  write_bytes(path("detections/000006.txt"),
              "Car -1 -1 -10 12 22 32 42 -1 -1 -1 -1000 -1000 -1000 -10 0.25\n");
  options_.detections = path("detections");
  scene = import_kitti(options_);
  EXPECT_TRUE(scene.frames[0].vehicles.empty());
  ASSERT_EQ(scene.frames[1].vehicles.size(), 1u);
  EXPECT_EQ(scene.frames[1].vehicles[0].score, 0.25);
}

TEST_F(KittiClip, PosesBecomeTruthOfTheColourCamera) {
  // Camera 0 turned by 90 degrees about y, at (0, 0, i).
  std::string poses;
  for (int i = 0; i < 3; ++i) poses += "0 0 1 0 0 1 0 0 -1 0 0 " + std::to_string(i) + "\n";
  write_bytes(path("poses.txt"), poses);
  options_.poses = path("poses.txt");
  options_.frames = "6,7";
  const Scene scene = import_kitti(options_);
  ASSERT_TRUE(scene.truth);
  ASSERT_EQ(scene.truth->frames.size(), 2u);
  // Row 1 is the second image, frame 6, although only two frames were taken.
  const SE3 world_from_camera = *scene.truth->frames[0].world_from_camera;
  // A point at the colour camera's origin is at -offset in camera 0.
  const Eigen::Vector3d center = world_from_camera.translation();
  EXPECT_NEAR((center - Eigen::Vector3d(-0.01, -0.01, 1.056)).norm(), 0, 1e-12);
  EXPECT_FALSE(scene.frames[0].world_from_camera);

  // Eight rows: row i is frame i.
  poses.clear();
  for (int i = 0; i < 8; ++i) poses += "1 0 0 0 0 1 0 0 0 0 1 " + std::to_string(i) + "\n";
  write_bytes(path("poses.txt"), poses);
  EXPECT_NEAR(import_kitti(options_).truth->frames[0].world_from_camera->translation().z(),
              6 - 0.01, 1e-12);
  write_bytes(path("poses.txt"), poses.substr(0, poses.find('\n') + 1));
  EXPECT_EQ(error(),
            "poses.txt: found 1 poses, expected one for each of the 3 images, or at least "
            "8 so that row i is frame i");
}

TEST_F(KittiClip, PosesMayBeThoseOfTheImagesCamera) {
  write_bytes(path("poses.txt"),
              "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 0 0 1 0 0 0 0 1 1\n"
              "1 0 0 0 0 1 0 0 0 0 1 2\n");
  options_.poses = path("poses.txt");
  options_.poses_camera = 2;
  const Scene scene = import_kitti(options_);
  EXPECT_NEAR(
      (scene.truth->frames[1].world_from_camera->translation() - Eigen::Vector3d::UnitZ()).norm(),
      0, 1e-12);
  options_.poses_camera = 4;
  EXPECT_THROW(import_kitti(options_), std::invalid_argument);
}

TEST_F(KittiClip, TimesAreThoseBesideTheImages) {
  std::vector<std::string> warnings;
  const auto times = [&] {
    std::vector<double> out;
    const Scene scene =
        import_kitti(options_, [&](const std::string& text) { warnings.push_back(text); });
    for (const SceneFrame& frame : scene.frames) out.push_back(*frame.time_s);
    return out;
  };
  EXPECT_THAT(times(), ElementsAre(0.5, 0.6, 0.7));  // 10 a second
  write_bytes(path("times.txt"), "0\n0.11\n0.19\n");
  EXPECT_THAT(times(), ElementsAre(0.0, 0.11, 0.19));  // one for each image
  write_bytes(path("times.txt"), "0\n1\n2\n3\n4\n5.5\n6.5\n7.6\n8\n");
  EXPECT_THAT(times(), ElementsAre(5.5, 6.5, 7.6));  // row i is frame i
  EXPECT_TRUE(warnings.empty());
  write_bytes(path("times.txt"), "0\n1\n");
  EXPECT_THAT(times(), ElementsAre(0.5, 0.6, 0.7));
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("times.txt: found 2 times"));
  options_.times = path("times.txt");
  EXPECT_THAT(error(), HasSubstr("times.txt: found 2 times, expected one for each of the 3"));
  write_bytes(path("stamps.txt"),
              "2011-09-26 13:02:25.50\n2011-09-26 13:02:25.61\n"
              "2011-09-26 13:02:25.70\n");
  options_.times = path("stamps.txt");
  const std::vector<double> stamped = times();
  EXPECT_NEAR(stamped[0], 0.0, 1e-6);
  EXPECT_NEAR(stamped[1], 0.11, 1e-6);
  write_bytes(path("stamps.txt"), "0\n2\n1\n");
  EXPECT_THAT(error(), HasSubstr("expected ascending times"));
}

TEST_F(KittiClip, CalibrationForms) {
  const auto offset = [&](const std::string& text) {
    write_bytes(path("other.txt"), text);
    return read_kitti_calibration({path("other.txt")});
  };
  const std::string p2 = kP2;
  for (const std::string& text :
       {"P2: " + p2, "P2:" + p2 + "\n", "P2 " + p2, "P_rect_02: " + p2 + "\r\n",
        "calib_time: 09-Jan-2012 13:57:47\nP_rect_02: " + p2, p2 + "\n" + p2 + "\n" + p2}) {
    const KittiCalibration::Camera camera = offset(text).camera(2);
    EXPECT_EQ(camera.cx, 40) << text;
    EXPECT_NEAR(camera.offset.x(), 0.056, 1e-15) << text;
    EXPECT_NEAR(camera.offset.y(), 0.01, 1e-15) << text;
  }
  // The laser: tracking, object, odometry and raw forms say the same.
  const std::string r = kIdentity;
  const Eigen::Matrix4d expected =
      offset("P2: " + p2 + "\nR0_rect: " + r + "\nTr_velo_to_cam: " + kLaser).camera_from_laser(2);
  EXPECT_EQ(expected(0, 1), -1);
  EXPECT_NEAR(expected(0, 3), 0.056, 1e-15);
  EXPECT_NEAR(expected(2, 3), -0.29, 1e-15);
  EXPECT_EQ(offset("P2: " + p2 + "\nR_rect " + r + "\nTr_velo_cam " + kLaser).camera_from_laser(2),
            expected);
  EXPECT_EQ(offset("P2: " + p2 + "\nTr: " + kLaser).camera_from_laser(2), expected);
  write_bytes(path("velo.txt"), "R: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.08 -0.3\ndelta_f: 0 0\n");
  write_bytes(path("cam.txt"), "S_02: 1392 512\nR_rect_00: " + r + "\nP_rect_02: " + p2 + "\n");
  EXPECT_EQ(read_kitti_calibration({path("cam.txt"), path("velo.txt")}).camera_from_laser(2),
            expected);
}

TEST_F(KittiClip, AllThreeFilesOfARawDay) {
  write_bytes(path("cam.txt"),
              "R_rect_00: 1 0 0 0 1 0 0 0 1\nP_rect_02: 100 0 40 6 0 100 30 0 0 0 1 0\n");
  write_bytes(path("velo.txt"),
              "calib_time: 01-Jan-2024\nR: 0 -1 0 0 0 -1 1 0 0\nT: 0 -0.08 -0.27\ndelta_f: 0 0\n"
              "delta_c: 0 0\n");
  write_bytes(path("other.txt"),
              "calib_time: 01-Jan-2024\nR: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n");
  write_bytes(path("calib_imu_to_velo.txt"), "R: 1 0 0 0 1 0 0 0 1\nT: -0.8 0.3 -0.8\n");
  for (const std::string imu : {"other.txt", "calib_imu_to_velo.txt"}) {
    for (const bool first : {false, true}) {
      std::vector<fs::path> files = {path("cam.txt"), path("velo.txt")};
      files.insert(first ? files.begin() : files.end(), path(imu));
      const KittiCalibration calibration = read_kitti_calibration(files);
      EXPECT_NEAR(calibration.camera_from_laser(2)(2, 3), -0.27, 1e-12);
      ASSERT_TRUE(calibration.antenna(2));
      // Its origin in the laser is (-0.8, 0.3, -0.8): x is ahead there.
      EXPECT_LT(
          (*calibration.antenna(2) - Eigen::Vector3d(-0.3 + 0.06, 0.8 - 0.08, -0.8 - 0.27)).norm(),
          1e-12);
    }
  }
  EXPECT_FALSE(read_kitti_calibration({path("cam.txt"), path("velo.txt")}).antenna(2));
  write_bytes(path("velo2.txt"), "R: 1 0 0 0 1 0 0 0 1\nT: 0 0 0\ndelta_f: 0 0\n");
  EXPECT_THROW(read_kitti_calibration({path("cam.txt"), path("velo.txt"), path("velo2.txt")}),
               InputError);
}

TEST_F(KittiClip, CalibrationErrors) {
  const auto with = [&](const std::string& text) {
    write_bytes(path("calib.txt"), text);
    return error();
  };
  EXPECT_EQ(with(""), "calib.txt: found no projection, expected P2 (camera 2 of the images)");
  EXPECT_EQ(with("100 0 40 0 0 100 30 0 0 0 1 0\n100 0 40 0 0 100 30 0 0 0 1 0"),
            "calib.txt: found P0, P1, expected P2 (camera 2 of the images)");
  EXPECT_EQ(with("P2: 1 2 3"), "calib.txt: line 1: found 3 numbers for P2, expected 12");
  EXPECT_EQ(with("P0: 1 2 3 4 5 6 7 8 9 10 11 12\nP2: 100 0 nan 0 0 100 30 0 0 0 1 0"),
            "calib.txt: line 2, column 11: found 'nan', expected a number of P2");
  EXPECT_EQ(with(std::string("P2: ") + kP2 + "\nP2: " + kP2),
            "calib.txt: line 2: found P2 a second time, expected it once");
  EXPECT_THAT(with("P2: 100 0.5 40 0 0 100 30 0 0 0 1 0"),
              HasSubstr("calib.txt: P2: found the 3 x 3 part [100 0.5 40;"));
  EXPECT_EQ(with("1 2 3"), "calib.txt: line 1: found 3 numbers for P0, expected 12");
  fs::remove(path("calib.txt"));
  EXPECT_THAT(error(), HasSubstr("no --calib is given and there is no"));
}

TEST_F(KittiClip, TheCameraIsToldByTheFolder) {
  fs::create_directories(path("image_0/0001"));
  write_png(path("image_0/0001/000000.png"), 80, 60, 0, 8, picture(80, 60, 1));
  options_.images = path("image_0/0001/");
  options_.calibration = {path("calib.txt")};
  EXPECT_NO_THROW(import_kitti(options_));
  fs::rename(path("image_0"), path("left"));
  options_.images = path("left/0001");
  EXPECT_THAT(error(), HasSubstr("the path names no camera"));
  options_.camera = 2;
  EXPECT_NO_THROW(import_kitti(options_));
}

TEST_F(KittiClip, ImagesAreCheckedByTheirHeaders) {
  write_png(path("image_02/000007.png"), 81, 60, 2, 8, picture(81, 60, 3));
  EXPECT_EQ(error(),
            "image_02/000007.png: found an image of 81 x 60 pixels, expected 80 x 60 as "
            "000005.png");
  write_bytes(path("image_02/000007.png"), "no image");
  EXPECT_EQ(error(),
            "image_02/000007.png: found a file that is neither PNG nor JPEG, expected an image");
  options_.frames = "5,6";
  EXPECT_NO_THROW(import_kitti(options_));
  options_.frames = "5:8";
  EXPECT_THAT(error(), HasSubstr("frame 8 is not in the scene"));
  options_.frames.clear();
  write_png(path("image_02/7.png"), 80, 60, 2, 8, picture(80, 60, 3));
  EXPECT_THAT(error(), HasSubstr("expected one file for frame 7"));
  options_.images = path("image_03");
  EXPECT_EQ(error(), "image_03: is not a folder, expected a folder of images");
  fs::create_directories(path("image_03"));
  EXPECT_EQ(error(),
            "image_03: found no images named by frame number, expected files like "
            "000048.png");
}

TEST_F(KittiClip, LabelErrors) {
  options_.labels = path("labels.txt");
  write_bytes(path("labels.txt"),
              "5 3 Car 0 2 0.1 10 20 30 40 1.5 1.75 4.25 1 1.6 20 0.5\n"
              "5 3 Car 0 2 0.1 10 20 30 40 1.5 1.75 4.25 1 1.6 20 0.5\n");
  EXPECT_EQ(error(),
            "labels.txt: line 2: found track 3 a second time in frame 5, expected it once");
  write_bytes(path("labels.txt"), "Car 0 2 0.1 10 20 30 40 1.5 1.75 4.25 1 1.6 20 0.5\n");
  EXPECT_THAT(error(), HasSubstr("labels.txt: found object rows (15 columns)"));
  options_.labels = path("none.txt");
  EXPECT_EQ(error(), "none.txt: no such file");
  write_bytes(path("none.txt"), "99 3 Car 0 2 0.1 10 20 30 40 1.5 1.75 4.25 1 1.6 20 0.5\n");
  std::vector<std::string> warnings;
  import_kitti(options_, [&](const std::string& s) { warnings.push_back(s); });
  EXPECT_THAT(warnings, ElementsAre(HasSubstr("none.txt: no row for frames 5 to 7")));
}

TEST_F(KittiClip, OptionsAreChecked) {
  const auto check = [&](const std::function<void(KittiImportOptions&)>& change) {
    KittiImportOptions options = options_;
    change(options);
    EXPECT_THROW(import_kitti(options), std::invalid_argument);
  };
  check([](KittiImportOptions& o) { o.camera_height = 0; });
  check([](KittiImportOptions& o) { o.camera_height = std::nan(""); });
  check([](KittiImportOptions& o) { o.frame_rate = -1; });
  check([](KittiImportOptions& o) { o.camera = 4; });
  check([](KittiImportOptions& o) { o.detections_from_labels = true; });
  check([](KittiImportOptions& o) { o.classes.clear(); });
}

TEST_F(KittiClip, TheLaserScanOfTheReferenceFrameBecomesTheTrueCloud) {
  fs::create_directories(path("velodyne"));
  const float points[2][4] = {{10, 0, -1.73f, 0.5f}, {5, 2, 1, 0.25f}};
  write_bytes(path("velodyne/000006.bin"),
              std::string(reinterpret_cast<const char*>(points), sizeof(points)));
  options_.velodyne = path("velodyne");
  const fs::path manifest = path("out/scene.json");
  EXPECT_THROW(import_kitti_to(options_, manifest), OutputError);  // no such folder
  fs::create_directories(path("out"));
  import_kitti_to(options_, manifest);
  const Scene scene = read_scene(manifest);
  EXPECT_EQ(scene.reference_frame, 6);
  ASSERT_TRUE(scene.truth);
  EXPECT_EQ(scene.truth->cloud_frame, 6);
  EXPECT_EQ(scene.truth->cloud, path("out/truth/scan_000006.ply"));
  const RoadCloud cloud = read_cloud(scene.truth->cloud);
  EXPECT_EQ(cloud.frame, CloudFrame::kCamera);
  ASSERT_EQ(cloud.size(), 2u);
  // Ten metres ahead of the laser is 10 - 0.3 + 0.01 ahead of the camera, 1.73 - 0.08 + 0.01 below.
  const Eigen::Vector3d first = cloud.origin + cloud.points[0].cast<double>();
  EXPECT_NEAR((first - Eigen::Vector3d(0.056, 1.66, 9.71)).norm(), 0, 1e-6);

  // Without a scan of the reference frame nothing is written.
  options_.reference_frame = 5;
  fs::create_directories(path("empty"));
  EXPECT_THROW(import_kitti_to(options_, path("empty/scene.json")), InputError);
  EXPECT_TRUE(fs::is_empty(path("empty")));
  // A manifest that cannot be written takes its scan with it.
  options_.reference_frame.reset();
  fs::create_directories(path("empty/scene.json"));
  EXPECT_THROW(import_kitti_to(options_, path("empty/scene.json")), OutputError);
  EXPECT_FALSE(fs::exists(path("empty/truth")));
}

TEST(SharedKitti, TrackingClip) {
  CAMBER_REQUIRE_DATA("kitti-tracking-0009-clip");
  const fs::path clip = test::data_dir() / "kitti-tracking-0009-clip";
  KittiImportOptions options;
  options.images = clip / "image_02";
  options.calibration = {clip / "calib_0009.txt"};
  options.labels = clip / "label_02_0009.txt";
  options.detections_from_labels = true;
  const Scene scene = import_kitti(options);
  EXPECT_EQ(scene.name, "kitti-tracking-0009-clip");
  EXPECT_EQ(scene.camera.width, 1242);
  EXPECT_EQ(scene.camera.height, 375);
  ASSERT_EQ(scene.frames.size(), 6u);
  int boxes = 0;
  for (const SceneFrame& frame : scene.frames) boxes += static_cast<int>(frame.vehicles.size());
  EXPECT_EQ(boxes, 77);  // 71 cars and 6 vans in the label file
  const TruthVehicle& parked = scene.truth->frames[0].vehicles[0];
  EXPECT_EQ(parked.id, 1);
  // Label (5.434643, 1.389847, 13.434062) and P2's offset of (0.06, 0.0, 0.003) m.
  EXPECT_NEAR((parked.pose.bottom_center() - Eigen::Vector3d(5.4945, 1.3890, 13.4368)).norm(), 0,
              1e-3);
  // The projected box agrees with the labelled one: the frames are right.
  const auto corners = parked.pose.corners();
  Box2 box{1e9, 1e9, -1e9, -1e9};
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector2d p = *scene.camera.project(corners.col(i));
    box = {std::min(box.x1, p.x()), std::min(box.y1, p.y()), std::max(box.x2, p.x()),
           std::max(box.y2, p.y())};
  }
  EXPECT_GT(intersection_over_union(box, parked.box), 0.95);
}

TEST(SharedKitti, OdometryClip) {
  CAMBER_REQUIRE_DATA("kitti-odometry-06");
  const fs::path clip = test::data_dir() / "kitti-odometry-06";
  KittiImportOptions options;
  options.images = clip / "image_0";
  options.poses = clip / "poses.txt";
  const Scene scene = import_kitti(options);
  ASSERT_EQ(scene.frames.size(), 31u);
  EXPECT_NEAR(scene.camera.fx, 707.0912, 1e-9);
  EXPECT_EQ(scene.camera.width, 1226);
  const SE3 last = *scene.truth->frames.back().world_from_camera;
  EXPECT_NEAR(last.translation().z(), 35.81256, 1e-9);
  EXPECT_NEAR(last.translation().y(), -0.8182722, 1e-9);
}

TEST(SharedKitti, WholeDrives) {
  CAMBER_REQUIRE_DATA("drives/kitti-odometry-03");
  CAMBER_REQUIRE_DATA("drives/kitti-raw-0095");
  KittiImportOptions options;
  const fs::path grey = test::data_dir() / "drives/kitti-odometry-03";
  options.images = grey / "image_0";
  options.poses = grey / "poses.txt";
  options.height_sigma = 0.02;
  const Scene drive = import_kitti(options);
  ASSERT_EQ(drive.frames.size(), 220u);
  ASSERT_EQ(drive.truth->frames.size(), 220u);
  EXPECT_NEAR(*drive.frames[1].time_s, 0.103391, 1e-9);
  EXPECT_EQ(drive.height_sigma, 0.02);
  EXPECT_EQ(drive.name, "kitti-odometry-03");

  options = {};
  const fs::path raw = test::data_dir() / "drives/kitti-raw-0095";
  options.images = raw / "image_02";
  options.poses = raw / "poses.txt";
  options.poses_camera = 2;
  options.labels = raw / "label_02";
  options.detections_from_labels = true;
  const Scene street = import_kitti(options);
  ASSERT_EQ(street.frames.size(), 110u);
  EXPECT_NEAR(*street.frames[2].time_s, 0.206984, 1e-9);
  EXPECT_NEAR(street.truth->frames[0].world_from_camera->translation().norm(), 0.0, 1e-9);
  EXPECT_FALSE(street.frames[2].vehicles.empty());
}

TEST(SharedKitti, RawClipWithItsScan) {
  CAMBER_REQUIRE_DATA("kitti-raw-2011_09_26-drive_0052");
  const fs::path clip = test::data_dir() / "kitti-raw-2011_09_26-drive_0052";
  const test::TemporaryFolder out;
  KittiImportOptions options;
  options.images = clip / "image_02";
  options.poses = clip / "poses_from_lidar.txt";
  options.velodyne = clip / "velodyne";
  options.frames = "0:10:5";
  const Scene scene = import_kitti_to(options, out.path() / "scene.json");
  EXPECT_EQ(scene.reference_frame, 5);
  EXPECT_EQ(scene.truth->frames.size(), 3u);
  const RoadCloud cloud = read_cloud(scene.truth->cloud);
  EXPECT_GT(cloud.size(), 100000u);
  // The road two to eight metres ahead lies about 1.65 m below the camera.
  std::vector<float> heights;
  for (const Eigen::Vector3f& p : cloud.points) {
    if (std::abs(p.x()) < 1.0f && p.z() > 6.0f && p.z() < 9.0f && p.y() > 1.0f) {
      heights.push_back(p.y());
    }
  }
  ASSERT_GT(heights.size(), 100u);
  std::nth_element(heights.begin(), heights.begin() + heights.size() / 2, heights.end());
  EXPECT_NEAR(heights[heights.size() / 2], 1.65, 0.1);
}

}  // namespace
}  // namespace camber
