#include "camber/import/formats/calibration.h"

#include <gmock/gmock.h>

#include "camber/core/errors.h"
#include "import/formats/expected_values.h"
#include "scene/write_image.h"

namespace camber {
namespace {

using nlohmann::json;
using test::write_bytes;
using testing::ElementsAre;
using testing::HasSubstr;
namespace fs = std::filesystem;

class Calibration : public ::testing::Test {
 protected:
  fs::path file(const std::string& name, const std::string& text) {
    write_bytes(folder_.path() / name, text);
    return folder_.path() / name;
  }
  CameraCalibration only(const std::string& name, const std::string& text) {
    const CalibrationFile read = read_calibration(file(name, text));
    EXPECT_EQ(read.cameras.size(), 1u);
    return read.cameras.at(0);
  }
  std::string error_of(const std::string& name, const std::string& text) {
    try {
      read_calibration(file(name, text));
    } catch (const InputError& error) {
      return error.what();
    }
    return "no error";
  }
  test::TemporaryFolder folder_;
};

void expect_numbers(const json& expected, const std::vector<double>& found) {
  ASSERT_EQ(expected.size(), found.size());
  for (std::size_t i = 0; i < found.size(); ++i) EXPECT_EQ(expected[i].get<double>(), found[i]);
}

void expect_camera(const json& expected, const CameraCalibration& found) {
  const json& name = expected["name"];
  EXPECT_EQ(name.is_null()     ? ""
            : name.is_number() ? name.dump()
                               : name.get<std::string>(),
            found.name);
  EXPECT_EQ(expected["model"], found.model);
  EXPECT_EQ(expected["width"], found.width ? json(*found.width) : json());
  EXPECT_EQ(expected["height"], found.height ? json(*found.height) : json());
  // A focal length as a share of the image's side is multiplied by it.
  EXPECT_DOUBLE_EQ(expected["fx"], found.fx);
  EXPECT_DOUBLE_EQ(expected["fy"], found.fy);
  EXPECT_DOUBLE_EQ(expected["cx"], found.cx);
  EXPECT_DOUBLE_EQ(expected["cy"], found.cy);
  expect_numbers(expected["coefficients"], found.coefficients);
  if (expected.contains("projection")) expect_numbers(expected["projection"], found.projection);
  if (expected.contains("T_cam_imu")) {
    ASSERT_TRUE(found.camera_from_imu);
    for (int i = 0; i < 16; ++i) {
      EXPECT_EQ(expected["T_cam_imu"][i / 4][i % 4], (*found.camera_from_imu)(i / 4, i % 4));
    }
  }
  if (expected.contains("rotation_wxyz")) {
    ASSERT_TRUE(found.rotation_wxyz && found.translation);
    for (int i = 0; i < 4; ++i) EXPECT_EQ(expected["rotation_wxyz"][i], (*found.rotation_wxyz)[i]);
    for (int i = 0; i < 3; ++i) EXPECT_EQ(expected["translation"][i], (*found.translation)[i]);
  }
}

TEST(CalibrationFiles, HoldWhatIndependentParsersFound) {
  CAMBER_REQUIRE_DATA("format-files/calibration/expected.json");
  int files = 0;
  const json all = test::expected_values("calibration");
  for (const auto& [name, expected] : all.items()) {
    if (!expected.contains("cameras")) continue;  // images and points of COLMAP
    SCOPED_TRACE(name);
    const CalibrationFile found = read_calibration(test::format_file("calibration", name));
    ASSERT_EQ(expected["cameras"].size(), found.cameras.size());
    for (std::size_t i = 0; i < found.cameras.size(); ++i) {
      SCOPED_TRACE(i);
      expect_camera(expected["cameras"][i], found.cameras[i]);
    }
    const json matrices = expected.value("matrices", json::object());
    for (const auto& [key, values] : matrices.items()) {
      ASSERT_TRUE(found.matrices.count(key)) << key;
      expect_numbers(values, found.matrices.at(key));
    }
    ++files;
  }
  EXPECT_EQ(files, 18);
}

TEST(CalibrationFiles, OfADoubleSphereAreRefused) {
  CAMBER_REQUIRE_DATA("format-files/calibration/basalt_euroc_ds.json");
  const fs::path path = test::format_file("calibration", "basalt_euroc_ds.json");
  const CalibrationFile read = read_calibration(path);
  try {
    lens_of(choose_camera(read, "1", path), false, 752, 480, path);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(),
                HasSubstr("camera model \"ds\" is not supported; expected a pinhole"));
  }
}

TEST_F(Calibration, OfOpenCvByTheNamesInUse) {
  for (const char* matrix :
       {"camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "intrinsic_matrix"}) {
    for (const char* distortion :
         {"distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "D"}) {
      const std::string text =
          std::string("%YAML:1.0\n---\nimage_width: 640\nimage_height:480\n") + matrix +
          ": !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
          "   data: [ 5.0e+02, 0., 320., 0., 510., 240.5,\n       0., 0., 1. ]\n" +
          distortion +
          ": !!opencv-matrix\n   rows: 1\n   cols: 5\n   dt: d\n"
          "   data: [ -.2, 1e-01, 1.0e-003, 0., 5. ]\n";
      const CameraCalibration camera = only("c.yaml", text);
      EXPECT_EQ(camera.width, 640);
      EXPECT_EQ(camera.height, 480);
      EXPECT_EQ(camera.fy, 510.0);
      EXPECT_EQ(camera.cy, 240.5);
      EXPECT_THAT(camera.coefficients, ElementsAre(-0.2, 0.1, 0.001, 0.0, 5.0));
      EXPECT_EQ(camera.lens, LensModel::kBrown);
    }
  }
}

TEST_F(Calibration, OfOpenCvInJsonAndXmlAndAsAStereoPair) {
  const CameraCalibration json_camera =
      only("c.json",
           R"({"image_size": [640, 480], "camera_matrix": {"type_id": "opencv-matrix", "rows": 3,
      "cols": 3, "dt": "d", "data": [500, 0, 320, 0, 510, 240, 0, 0, 1]}, "fisheye_model": 1,
      "dist_coeffs": [[0.1, 0.2, 0.3, 0.4]]})");
  EXPECT_EQ(json_camera.width, 640);
  EXPECT_EQ(json_camera.lens, LensModel::kFisheye);
  EXPECT_THAT(json_camera.lens_coefficients, ElementsAre(0.1, 0.2, 0.3, 0.4));
  const CameraCalibration xml = only(
      "c.xml",
      "<?xml version=\"1.0\"?>\n<opencv_storage>\n<Camera_Matrix "
      "type_id=\"opencv-matrix\"><rows>3</rows>"
      "<cols>3</cols><dt>d</dt><data> 500. 0. 320. 0. 510. 240. 0. 0. 1.</data></Camera_Matrix>"
      "<image_Width>640</image_Width><image_Height>480</image_Height></opencv_storage>");
  EXPECT_EQ(xml.fx, 500.0);
  EXPECT_EQ(xml.height, 480);
  EXPECT_EQ(xml.lens, LensModel::kNone);
  const CalibrationFile pair = read_calibration(
      file("intrinsics.yml",
           "%YAML:1.0\nM1: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
           "   data: [ 1, 0, 2, 0, 3, 4, 0, 0, 1 ]\nD1: !!opencv-matrix\n   rows: 1\n"
           "   cols: 4\n   dt: d\n   data: [ 1, 2, 3, 4 ]\nM2: !!opencv-matrix\n   rows: 3\n"
           "   cols: 3\n   dt: d\n   data: [ 5, 0, 6, 0, 7, 8, 0, 0, 1 ]\n"));
  ASSERT_EQ(pair.cameras.size(), 2u);
  EXPECT_EQ(pair.cameras[0].lens_coefficients.size(), 4u);
  EXPECT_EQ(pair.cameras[1].cy, 8.0);
  EXPECT_EQ(choose_camera(pair, "2", "x").fx, 5.0);
}

TEST_F(Calibration, CoefficientsThatAreNotFoundAreNotTakenForNone) {
  const std::string matrix =
      "image_width: 640\nimage_height: 480\ncamera_matrix: {rows: 3, cols: 3, data: [500, 0, 320, "
      "0, 510, 240, 0, 0, 1]}\n";
  // A model without coefficients, however their key is misspelt.
  for (const char* const key : {"distortion_coefficents", "distorsion_coeficients", "foo"}) {
    for (const char* const model : {"plumb_bob", "equidistant", "rational_polynomial"}) {
      EXPECT_THAT(error_of("c.yaml", matrix + "distortion_model: " + model + "\n" + key +
                                         ": {rows: 1, cols: 4, data: [-0.3, 0.1, 0, 0]}\n"),
                  HasSubstr("expected distortion_coefficients"))
          << key << " " << model;
    }
  }
  // Keys beside a matrix that are called like coefficients.
  EXPECT_THAT(error_of("c.json", R"({"IntrinsicMatrix": [[500, 0, 320], [0, 510, 240], [0, 0, 1]],
                                    "RadialDistortion": [-0.3, 0.1], "TangentialDistortion": [0, 0]})"),
              HasSubstr("found 'RadialDistortion'"));
  EXPECT_THAT(
      error_of("c.yaml", "fx: 500\nfy: 510\ncx: 320\ncy: 240\nlens_distortion: [-0.3, 0.1]\n"),
      HasSubstr("found 'lens_distortion'"));
  EXPECT_THAT(error_of("c.json", R"({"front": {"K": [500, 0, 320, 0, 510, 240, 0, 0, 1],
                                     "distort_coef": [-0.3, 0.1, 0, 0]}})"),
              HasSubstr("found 'distort_coef'"));
  EXPECT_THAT(error_of("c.yaml",
                       "%YAML:1.0\n---\nmodel_type: PINHOLE\nimage_width: 640\nimage_height: 480\n"
                       "distortion_parameter:\n   k1: -0.3\nprojection_parameters:\n"
                       "   fx: 500\n   fy: 510\n   cx: 320\n   cy: 240\n"),
              HasSubstr("found 'distortion_parameter'"));
  // What states that there is none.
  for (const char* const lines :
       {"distortion_model: plumb_bob\nD: []\n", "distortion_model: none\n",
        "distortion_model: ''\n", "distortion_coefficients: none\n", "viewing_distance: 3\n",
        "distortion_model: plumb_bob\nD: [0, 0, 0, 0, 0]\n", "RadialDistortion: [0, 0]\n"}) {
    EXPECT_EQ(only("c.yaml", matrix + lines).lens, LensModel::kNone) << lines;
  }
}

TEST_F(Calibration, OfOtherPrograms) {
  const CameraCalibration euroc =
      only("sensor.yaml",
           "sensor_type: camera\nresolution: [752, 480]\ncamera_model: pinhole\n"
           "intrinsics: [458.654, 457.296, 367.215, 248.375] #fu, fv, cu, cv\n"
           "distortion_model: radial-tangential\n"
           "distortion_coefficients: [-0.28, 0.07, 0.0002, 1.7e-05]\n");
  EXPECT_EQ(euroc.model, "pinhole-radial-tangential");
  EXPECT_EQ(euroc.lens, LensModel::kBrown);
  EXPECT_EQ(euroc.width, 752);
  const CameraCalibration cityscapes =
      only("c.json", R"({"extrinsic": {"pitch": 0.03, "z": 1.22}, "intrinsic": {"fx": 2262.52,
      "fy": 2265.3, "u0": 1096.98, "v0": 513.137}})");
  EXPECT_EQ(cityscapes.cx, 1096.98);
  const CameraCalibration kannala =
      only("k.yaml",
           "%YAML:1.0\n---\nmodel_type: KANNALA_BRANDT\ncamera_name: c\nimage_width: 752\n"
           "image_height: 480\nprojection_parameters:\n   k2: 1e-2\n   k3: 2e-2\n   k4: 3e-2\n"
           "   k5: 4e-2\n   mu: 460.\n   mv: 461.\n   u0: 370.\n   v0: 240.\n");
  EXPECT_EQ(kannala.lens, LensModel::kFisheye);
  EXPECT_EQ(kannala.fy, 461.0);
  EXPECT_THAT(kannala.lens_coefficients, ElementsAre(0.01, 0.02, 0.03, 0.04));
  const CameraCalibration orb = only(
      "o.yaml",
      "%YAML:1.0\nCamera.type: \"KannalaBrandt8\"\nCamera1.fx: 190.9\nCamera1.fy: 190.8\n"
      "Camera1.cx: 254.9\nCamera1.cy: 256.8\nCamera1.k1: 0.1\nCamera1.k2: 0.2\nCamera1.k3: 0.3\n"
      "Camera1.k4: 0.4\nCamera.width: 512\nCamera.height: 512\nViewer.PointSize:2\n");
  EXPECT_EQ(orb.lens, LensModel::kFisheye);
  EXPECT_EQ(orb.width, 512);
  const CameraCalibration open3d = only(
      "i.json",
      R"({"width": 640, "height": 480, "intrinsic_matrix": [525, 0, 0, 0, 526, 0, 319.5, 239.5, 1]})");
  EXPECT_EQ(open3d.cx, 319.5);
  EXPECT_EQ(open3d.fy, 526.0);
  const CameraCalibration echo =
      only("info.yaml",
           "header:\n  frame_id: cam\nheight: 480\nwidth: 640\ndistortion_model: equidistant\n"
           "d: [0.1, 0.2, 0.3, 0.4]\nk: [500, 0, 320, 0, 510, 240, 0, 0, 1]\n"
           "p: [400, 0, 321, 0, 0, 410, 241, 0, 0, 0, 1, 0]\n");
  EXPECT_EQ(echo.lens, LensModel::kFisheye);
  EXPECT_EQ(echo.projection[0], 400.0);
  const CameraCalibration bare = only("K.txt", "500 0 320\n0 510 240\n0 0 1\n");
  EXPECT_EQ(bare.fy, 510.0);
}

TEST_F(Calibration, OfKittiRawHasRawAndRectifiedCameras) {
  const fs::path path =
      file("calib_cam_to_cam.txt",
           "calib_time: 09-Jan-2012 13:57:47\ncorner_dist: 9.95e-02\nS_02: 1392 512\n"
           "K_02: 960 0 700 0 961 230 0 0 1\nD_02: -0.37 0.2 0.001 0.002 -0.07\nR_02: 1 0 0 0 1 0 "
           "0 0 1\n"
           "S_rect_02: 1242 375\nP_rect_02: 721.5 0 609.6 44.9 0 721.5 172.9 0.2 0 0 1 0.003\n");
  const CalibrationFile read = read_calibration(path);
  ASSERT_EQ(read.cameras.size(), 2u);
  EXPECT_EQ(choose_camera(read, "K_02", path).lens, LensModel::kBrown);
  EXPECT_EQ(choose_camera(read, "K_02", path).width, 1392);
  EXPECT_EQ(choose_camera(read, "P_rect_02", path).height, 375);
  EXPECT_EQ(lens_of(read.cameras[1], true, 1242, 375, path).raw.cx, 609.6);
}

TEST_F(Calibration, PixelCentresAreAtIntegers) {
  const fs::path path = file("cameras.txt",
                             "1 SIMPLE_RADIAL 1600 1200 1469.2 800 600 -0.035\n"
                             "2 FOV 10 10 5 5 5 5 0.9\n");
  const CalibrationFile read = read_calibration(path);
  const LensDistortion lens = lens_of(choose_camera(read, "1", path), false, 1600, 1200, path);
  EXPECT_EQ(lens.raw.cx, 799.5);
  EXPECT_EQ(lens.raw.cy, 599.5);
  EXPECT_THAT(lens.coefficients, ElementsAre(-0.035, 0.0, 0.0, 0.0));
  EXPECT_NO_THROW(lens.validate());
  EXPECT_THROW(lens_of(choose_camera(read, "2", path), false, 10, 10, path), InputError);
  EXPECT_THROW(choose_camera(read, "", path), InputError);
  EXPECT_THROW(choose_camera(read, "3", path), InputError);
  EXPECT_THROW(lens_of(read.cameras[0], true, 1600, 1200, path), InputError);
  try {
    lens_of(read.cameras[0], false, 1242, 375, path);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(),
                HasSubstr("found a camera of 1600 x 1200 pixels, expected the images' 1242 x 375"));
  }
}

TEST_F(Calibration, NumbersThatAreNotFiniteAreRefusedWithTheirPosition) {
  const std::string matrix = "K_02: 960 0 696 0 957 224 0 0 1\n";
  EXPECT_THAT(error_of("c.txt", "S_02: 1242 375\n" + matrix + "D_02: nan 0.2 0.001 0.001 -0.07\n"),
              HasSubstr("c.txt: line 3, column 7: found 'nan', expected a number"));
  EXPECT_THAT(error_of("c.txt", "S_02: nan 375\n" + matrix + "D_02: 0.1 0.2 0.001 0.001 -0.07\n"),
              HasSubstr("c.txt: line 1, column 7: found 'nan', expected a number"));
}

TEST_F(Calibration, ThatIsBrokenIsRefusedWithItsPosition) {
  EXPECT_THAT(error_of("c.yaml", ""), HasSubstr("empty file"));
  EXPECT_THAT(error_of("c.yaml", "a: [1, 2\nb: }"), HasSubstr("c.yaml: line "));
  EXPECT_THAT(error_of("c.yaml", "a: 1\nb: 2\n"),
              HasSubstr("found no camera, expected a calibration"));
  EXPECT_THAT(error_of("c.yaml", "camera_matrix: [1, 2, 3]\n"),
              HasSubstr("line 1, column 16: found 3 numbers"));
  EXPECT_THAT(
      error_of("c.yaml",
               "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, x, 0, 1, 0, 0, 0, 1]\n"),
      HasSubstr("line 4, column 16: found 'x', expected a 3 x 3 camera matrix"));
  EXPECT_THAT(
      error_of("c.yaml",
               "camera_matrix:\n  rows: 3\n  cols: 4\n  data: [1, 0, 2, 0, 1, 0, 0, 0, 1]\n"),
      HasSubstr("expected rows * cols = 12"));
  EXPECT_THAT(error_of("c.yaml", "K: [-5, 0, 2, 0, 1, 0, 0, 0, 1]\n"),
              HasSubstr("found fx = -5, expected"));
  EXPECT_THAT(
      error_of("c.yaml", "image_width: 70000\nimage_height: 2\nK: [5, 0, 2, 0, 1, 0, 0, 0, 1]\n"),
      HasSubstr("found '70000', expected a number of pixels from 1 to 65535"));
  EXPECT_THAT(error_of("c.txt", "P2: 1 2 3\n"),
              HasSubstr("c.txt: line 1: found 3 numbers for P2, expected 12"));
  EXPECT_THAT(error_of("c.txt", "P2: 1 0 a 0 0 1 0 0 0 0 1 0\n"),
              HasSubstr("line 1, column 9: found 'a'"));
  EXPECT_THAT(error_of("c.xml", "<opencv_storage><a></opencv_storage>"), HasSubstr("damaged XML"));
  EXPECT_THAT(error_of("c.xml", "<annotations/>"),
              HasSubstr("found <annotations>, expected <opencv_storage>"));
  EXPECT_THAT(error_of("c.ini", "[image]\nwidth\n640\nheight\n480\n[n]\ncamera matrix\n1 0\n"),
              HasSubstr("found 2 numbers for the camera matrix, expected 9"));
  std::string deep = "{\"a\": ";
  for (int i = 0; i < 100000; ++i) deep += "[";
  EXPECT_THAT(error_of("c.json", deep), HasSubstr("c.json: "));
  // Anchors that would multiply to 10^9 values cost nothing.
  std::string bomb = "a: &a [1,1,1,1,1,1,1,1,1,1]\n";
  for (char c = 'b'; c < 'k'; ++c) {
    bomb += std::string(1, c) + ": &" + c + " [";
    for (int i = 0; i < 10; ++i) bomb += std::string(i ? "," : "") + "*" + static_cast<char>(c - 1);
    bomb += "]\n";
  }
  EXPECT_THAT(error_of("c.yaml", bomb + "camera_matrix: *j\n"),
              HasSubstr("found 10 values, expected a 3 x 3"));
}

}  // namespace
}  // namespace camber
