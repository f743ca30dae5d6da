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
  // ... or have a name that says nothing, and numbers like theirs.
  EXPECT_THAT(error_of("c.json", R"({"mtx": [[500, 0, 320], [0, 510, 240], [0, 0, 1]],
                                    "dst": [[-0.3, 0.1, 0, 0, 0.02]]})"),
              HasSubstr("found 'dst'"));
  for (const char* const lines :
       {"q_cam: [0.5, -0.5, 0.5, -0.5]\n", "errors: [0.2, 0.3, 0.25, 0.4, 0.31]\n",
        "roi: [0, 0, 639, 479]\n", "camera_position: [1, -2, 3, 0.5]\n"}) {
    EXPECT_EQ(only("c.yaml", matrix + lines).lens, LensModel::kNone) << lines;
  }
  // What states that there is none.
  for (const char* const lines :
       {"distortion_model: plumb_bob\nD: []\n", "distortion_model: none\n",
        "distortion_model: ''\n", "distortion_coefficients: none\n", "viewing_distance: 3\n",
        "distortion_model: plumb_bob\nD: [0, 0, 0, 0, 0]\n", "RadialDistortion: [0, 0]\n"}) {
    EXPECT_EQ(only("c.yaml", matrix + lines).lens, LensModel::kNone) << lines;
  }
}

TEST_F(Calibration, OfAutoware) {
  const CameraCalibration camera = only("a.yaml", R"(%YAML:1.0
---
CameraExtrinsicMat: !!opencv-matrix
   rows: 4
   cols: 4
   dt: d
   data: [ 1., 0., 0., 1.5, 0., 1., 0., 0., 0., 0., 1., -0.2, 0., 0., 0., 1. ]
CameraMat: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 910., 0., 582., 0., 911., 357., 0., 0., 1. ]
DistCoeff: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.2, 0.1, 0.001, -0.002, 0.01 ]
ImageSize: [ 1280, 720 ]
ReprojectionError: 0.3
)");
  EXPECT_EQ(camera.fx, 910.0);
  EXPECT_EQ(camera.cy, 357.0);
  EXPECT_EQ(camera.width, 1280);
  EXPECT_EQ(camera.lens_coefficients, (std::vector<double>{-0.2, 0.1, 0.001, -0.002, 0.01}));
}

TEST_F(Calibration, OfMetashape) {
  const std::string lens =
      "<f>3042.5</f><cx>-12.25</cx><cy>8.5</cy><b1>1.5</b1><k1>0.021</k1><k2>-0.055</k2>"
      "<k3>0.031</k3><p1>-0.0004</p1><p2>0.0007</p2>";
  const CameraCalibration one =
      only("c.xml",
           "<?xml version=\"1.0\"?>\n<calibration><projection>frame</projection>"
           "<width>4000</width><height>3000</height>" +
               lens + "<date>2024-05-01T10:00:00Z</date></calibration>");
  EXPECT_EQ(one.width, 4000);
  EXPECT_DOUBLE_EQ(one.fx, 3044.0);
  EXPECT_DOUBLE_EQ(one.fy, 3042.5);
  // Lengths from the middle of the image; pixel centres at integers.
  const LensDistortion lens_of_one = lens_of(one, false, 4000, 3000, "c.xml");
  EXPECT_DOUBLE_EQ(lens_of_one.raw.cx, 1999.5 - 12.25);
  EXPECT_DOUBLE_EQ(lens_of_one.raw.cy, 1499.5 + 8.5);
  EXPECT_THAT(one.lens_coefficients, ElementsAre(0.021, -0.055, 0.0007, -0.0004, 0.031));
  const CameraCalibration sensor = only(
      "d.xml",
      "<document version=\"1.5.0\"><chunk><sensors><sensor id=\"0\" label=\"DJI\" type=\"frame\">"
      "<resolution width=\"4000\" height=\"3000\"/><calibration type=\"frame\" class=\"adjusted\">"
      "<resolution width=\"4000\" height=\"3000\"/>" +
          lens + "</calibration></sensor></sensors></chunk></document>");
  EXPECT_EQ(sensor.name, "DJI");
  EXPECT_DOUBLE_EQ(sensor.cx, one.cx);
  EXPECT_EQ(sensor.lens_coefficients, one.lens_coefficients);
  EXPECT_THAT(only("e.xml",
                   "<calibration><width>40</width><height>30</height><f>30</f><k4>0.1</k4>"
                   "</calibration>")
                  .unsupported,
              HasSubstr("k4"));
  EXPECT_THAT(error_of("f.xml", "<calibration><width>40</width><height>30</height></calibration>"),
              HasSubstr("f"));
  EXPECT_THAT(error_of("g.xml", "<html/>"), HasSubstr("found <html>"));
}

TEST_F(Calibration, OfNerfstudio) {
  const std::string numbers =
      R"("fl_x": 912.5, "fl_y": 911.0, "cx": 641.2, "cy": 358.9, "w": 1280, "h": 720, )";
  const CameraCalibration camera =
      only("t.json", R"({"camera_model": "OPENCV", )" + numbers +
                         R"("k1": -0.21, "k2": 0.05, "p1": 0.0003, "p2": -0.0002, "frames": []})");
  EXPECT_EQ(camera.fx, 912.5);
  EXPECT_EQ(camera.height, 720);
  EXPECT_EQ(camera.first_pixel, 0.5);
  EXPECT_THAT(camera.lens_coefficients, ElementsAre(-0.21, 0.05, 0.0003, -0.0002));
  const CameraCalibration fisheye =
      only("u.json", R"({"camera_model": "OPENCV_FISHEYE", )" + numbers +
                         R"("k1": 0.021, "k2": 0.005, "k3": 0.001, "k4": -0.0002, "frames": []})");
  EXPECT_EQ(fisheye.lens, LensModel::kFisheye);
  EXPECT_THAT(fisheye.lens_coefficients, ElementsAre(0.021, 0.005, 0.001, -0.0002));
  // A camera a frame: those that differ.
  const CalibrationFile frames = read_calibration(
      file("v.json", R"({"camera_model": "PINHOLE", "frames": [{"file_path": "a.jpg", )" + numbers +
                         R"("t": 0}, {"file_path": "b.jpg", )" + numbers + R"("t": 0}]})"));
  EXPECT_EQ(frames.cameras.size(), 1u);
  EXPECT_DOUBLE_EQ(
      only("w.json", R"({"camera_angle_x": 1.5707963267948966, "w": 800, "h": 600})").fx, 400.0);
}

TEST_F(Calibration, OfZedByTheImagesSize) {
  const std::string text =
      "[LEFT_CAM_FHD]\nfx=1399.5\nfy=1399\ncx=975.1\ncy=560.2\nk1=-0.171\nk2=0.0254\np1=0.0003\n"
      "p2=0.0001\nk3=0\n\n[LEFT_CAM_HD]\nfx=699.75\nfy=699.5\ncx=652.3\ncy=370.1\nk1=-0.171\n"
      "[RIGHT_CAM_HD]\nfx=699.1\nfy=699.2\ncx=650.3\ncy=371.1\n[STEREO]\nBaseline=120.0\n";
  const CalibrationFile read = read_calibration(file("SN1.conf", text));
  ASSERT_EQ(read.cameras.size(), 3u);
  EXPECT_EQ(choose_camera(read, "", "SN1.conf", 1280, 720).fx, 699.75);
  EXPECT_EQ(choose_camera(read, "", "SN1.conf", 1920, 1080).fx, 1399.5);
  EXPECT_EQ(choose_camera(read, "RIGHT_CAM_HD", "SN1.conf", 1280, 720).fx, 699.1);
  EXPECT_THROW(choose_camera(read, "", "SN1.conf", 640, 480), InputError);
  EXPECT_THAT(read.cameras[0].lens_coefficients, ElementsAre(-0.171, 0.0254, 0.0003, 0.0001, 0.0));
  EXPECT_THAT(error_of("b.conf", "[LEFT_CAM_HD]\nfx=699.75\nfy=699.5\ncx=652.3\n"),
              HasSubstr("found no cy"));
}

TEST_F(Calibration, OfOkvisVikitAndArgoverse) {
  const CameraCalibration okvis =
      only("okvis.yaml",
           "cameras:\n  - {T_SC: [1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0, 0, 0, 0, 0, 1.0], "
           "image_dimension: [752, 480], distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002], "
           "distortion_type: radialtangential, focal_length: [458.6, 457.3], principal_point: "
           "[367.2, 248.4]}\n");
  EXPECT_EQ(okvis.width, 752);
  EXPECT_EQ(okvis.fy, 457.3);
  EXPECT_EQ(okvis.cx, 367.2);
  EXPECT_THAT(okvis.lens_coefficients, ElementsAre(-0.28, 0.07, 0.0002, 0.00002));
  const CameraCalibration vikit =
      only("v.yaml",
           "cam_model: Pinhole\ncam_width: 1280\ncam_height: 1024\nscale: 1.0\n"
           "cam_fx: 1290.5\ncam_fy: 1290.3\ncam_cx: 626.9\ncam_cy: 522.8\n"
           "cam_d0: -0.076\ncam_d1: 0.12\ncam_d2: -0.001\ncam_d3: 0.0002\n");
  EXPECT_EQ(vikit.cy, 522.8);
  EXPECT_EQ(vikit.height, 1024);
  EXPECT_THAT(vikit.lens_coefficients, ElementsAre(-0.076, 0.12, -0.001, 0.0002));
  const CameraCalibration argoverse =
      only("a.json",
           R"({"camera_data_": [{"key": "image_raw_ring_front_center", "value": {
          "focal_length_x_px_": 1392.1, "focal_length_y_px_": 1392.2, "focal_center_x_px_": 980.2,
          "focal_center_y_px_": 604.3, "skew_": 0, "distortion_coefficients_": [-0.172, 0.12, -0.028],
          "vehicle_SE3_camera_": {"rotation": {"coefficients": [0.5, -0.5, 0.5, -0.5]},
          "translation": [1.6, 0, 1.4]}}}]})");
  EXPECT_EQ(argoverse.name, "ring_front_center");
  EXPECT_EQ(argoverse.fy, 1392.2);
  EXPECT_THAT(argoverse.lens_coefficients, ElementsAre(-0.172, 0.12, 0.0, 0.0, -0.028));
}

TEST_F(Calibration, MatricesInBrackets) {
  for (const char* const text :
       {"[[910, 0, 582],\n [0, 911, 437],\n [0,   0,   1]]\n",
        "[[910.   0. 582.]\n [  0. 911. 437.]\n [  0.   0.   1.]]\n",
        "K = np.array([[910, 0, 582], [0, 911, 437], [0, 0, 1]])\n",
        "K = [910 0 582; 0 911 437; 0 0 1];\n", "[910, 0, 582, 0, 911, 437, 0, 0, 1]"}) {
    const CameraCalibration camera = only("k.txt", text);
    EXPECT_EQ(camera.fx, 910.0) << text;
    EXPECT_EQ(camera.fy, 911.0) << text;
    EXPECT_EQ(camera.cx, 582.0) << text;
    EXPECT_EQ(camera.cy, 437.0) << text;
  }
  EXPECT_NE(error_of("k.txt", "[[910, 0, 582], [0, 911, 437]]"), "");
}

TEST_F(Calibration, ASkewOfAPixelIsLeftOutAndSaid) {
  const auto ros = [](const char* skew) {
    return std::string(
               "image_width: 1640\nimage_height: 1232\ncamera_matrix: {rows: 3, cols: 3, "
               "data: [410.5, ") +
           skew +
           ", 860.25, 0, 411.25, 598.5, 0, 0, 1]}\ncamera_model: fisheye\n"
           "distortion_coefficients: {rows: 1, cols: 4, data: [0.17, -0.03, 0.0004, -0.0007]}\n";
  };
  const CameraCalibration small = only("a.yaml", ros("-0.9"));
  EXPECT_EQ(small.unsupported, "");
  EXPECT_THAT(small.note, HasSubstr("skew of -0.9"));
  EXPECT_EQ(small.lens, LensModel::kFisheye);
  EXPECT_EQ(only("b.yaml", ros("0.0")).note, "");
  EXPECT_THAT(only("c.yaml", ros("25")).unsupported, HasSubstr("skewed"));
}

TEST_F(Calibration, OfSeveralMatricesTheOneThatCountsIsNamed) {
  const CalibrationFile read = read_calibration(
      file("a.json", R"({"camera_matrix": [[500, 0, 320], [0, 510, 240], [0, 0, 1]],
                         "dist_coeffs": [-0.3, 0.1, 0, 0],
                         "new_camera_matrix": [[450, 0, 320], [0, 460, 240], [0, 0, 1]]})"));
  EXPECT_THAT(read.form, HasSubstr("the camera of 'camera_matrix', not of new_camera_matrix"));
  EXPECT_EQ(read.cameras.at(0).fx, 500.0);
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
