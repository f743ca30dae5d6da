// camber import images|video|colmap as a person uses it: exit codes, what is found and what is
// missing, nothing half-written.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "camber/render/film.h"
#include "camber/scene/scene.h"
#include "cli/run_program.h"
#include "scene/write_image.h"
#include "support/made_film.h"
#include "support/test_data.h"

namespace camber {
namespace {

using nlohmann::json;
using test::picture;
using test::run_camber;
using test::snapshot;
using test::write_bytes;
using test::write_png;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;
namespace fs = std::filesystem;

class ImportOwn : public ::testing::Test {
 protected:
  ImportOwn() {
    fs::create_directories(path("images"));
    for (const char* name : {"drive 2.png", "drive 10.png", "drive 1.png"}) {
      write_png(path("images") + "/" + name, 80, 60, 2, 8, picture(80, 60, 3));
    }
    write_bytes(path("camera.yaml"),
                "image_width: 80\nimage_height: 60\ncamera_matrix: {rows: 3, cols: 3, data: [100, "
                "0, 40, 0, 101, 30, "
                "0, 0, 1]}\ndistortion_model: plumb_bob\ndistortion_coefficients: {rows: 1, cols: "
                "5, data: [-0.3, "
                "0.1, 0.001, 0.002, 0]}\n");
  }
  std::string path(const std::string& name) const { return folder_.path() / name; }
  test::ProgramResult import(std::vector<std::string> more) {
    std::vector<std::string> all = {"import", "images", path("images"), "--out", path("out")};
    all.insert(all.end(), more.begin(), more.end());
    return run_camber(all);
  }
  Scene imported(const std::vector<std::string>& more) {
    const auto result = import(more);
    EXPECT_EQ(result.exit_code, 0) << result.error;
    error_ = result.error;
    return result.exit_code == 0 ? read_scene(path("out")) : Scene();
  }
  void expect_refused(const std::vector<std::string>& more, const std::string& part) {
    const auto before = snapshot(folder_.path());
    EXPECT_ONE_SENTENCE(import(more), 2, part);
    EXPECT_EQ(snapshot(folder_.path()), before);
  }
  test::TemporaryFolder folder_;
  std::string error_;
};

TEST_F(ImportOwn, ImagesOfAnyNamesInNaturalOrder) {
  const Scene scene = imported(
      {"--calib", path("camera.yaml"), "--height", "1.4", "--height-sigma", "0.03", "--rate", "5"});
  ASSERT_EQ(scene.frames.size(), 3u);
  EXPECT_EQ(scene.frames[0].image.filename(), "drive 1.png");
  EXPECT_EQ(scene.frames[1].image.filename(), "drive 2.png");
  EXPECT_EQ(scene.frames[2].id, 2);
  EXPECT_EQ(scene.frames[2].time_s, 0.4);
  EXPECT_EQ(scene.height_above_road, 1.4);
  EXPECT_EQ(scene.height_sigma, 0.03);
  EXPECT_EQ(scene.camera.fy, 101.0);
  EXPECT_EQ(scene.distortion.model, LensModel::kBrown);
  EXPECT_EQ(scene.distortion.coefficients.size(), 5u);
  EXPECT_THAT(error_, HasSubstr("3 frames (0 to 2) of 85 x 64 pixels, 0 detections"));
  EXPECT_THAT(error_, HasSubstr("natural order of the names, drive 1.png to drive 10.png"));
  EXPECT_THAT(error_, HasSubstr("brown distortion"));
  EXPECT_THAT(error_, HasSubstr("missing: no boxes"));
  EXPECT_THAT(error_, Not(HasSubstr("up to scale")));
  imported({"--fov", "90", "--camera-height", "1.5"});
  EXPECT_THAT(error_, HasSubstr("missing: no distortion"));
  EXPECT_THAT(error_, HasSubstr("missing: no times"));
  const Scene wide = imported({"--fov", "90"});
  EXPECT_NEAR(wide.camera.fx, 40.0, 1e-9);
  EXPECT_EQ(wide.camera.cx, 39.5);
  EXPECT_THAT(
      error_,
      HasSubstr("missing: no camera height, speed or poses: the result is up to scale (--height)"));
}

TEST_F(ImportOwn, PipesAmongTheFilesArePassedOver) {
  for (const char* folder : {"masks", "boxes", "poses"}) fs::create_directories(path(folder));
  write_png(path("masks/drive 2.png"), 80, 60, 0, 8, std::vector<std::uint8_t>(80 * 60, 1));
  write_bytes(path("boxes/drive 2.txt"), "2 0.5 0.5 0.2 0.2\n");
  for (const char* name : {"drive 1", "drive 2", "drive 10"}) {
    write_bytes(path("poses/") + name + ".txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
  }
  // Nobody writes them: opening one never ends by itself.
  for (const char* pipe : {"images/drive 5.png", "masks/drive 1.png", "boxes/drive 1.txt",
                           "poses/drive 0.txt", "pipe.png"}) {
    ASSERT_EQ(::mkfifo(path(pipe).c_str(), 0600), 0);
  }
  test::Surroundings limited;
  limited.limit_s = 60.0;
  for (const std::string& images : {path("images"), path("images") + "/*.png"}) {
    const auto result = test::run_camber_in(
        limited,
        {"import", "images", images, "--fov", "90", "--masks", path("masks"), "--class-map",
         "binary", "--detections", path("boxes"), "--poses", path("poses"), "--out", path("out")});
    ASSERT_EQ(result.exit_code, 0) << result.error;
    const Scene scene = read_scene(path("out"));
    ASSERT_EQ(scene.frames.size(), 3u);
    EXPECT_EQ(scene.frames[1].vehicles.size(), 1u);
    EXPECT_FALSE(scene.frames[1].road_mask.empty() && scene.frames[1].segmentation.empty());
  }
  EXPECT_ONE_SENTENCE(test::run_camber_in(limited, {"import", "images", path("pipe.png"), "--fov",
                                                    "90", "--out", path("other")}),
                      2, "pipe.png: is a pipe or a device, expected an image");
  EXPECT_FALSE(fs::exists(path("other")));
}

TEST_F(ImportOwn, NamesThatAManifestCannotHoldAreRefused) {
  const std::string image = path("images") + "/drive \xfc.png";
  write_png(image, 80, 60, 2, 8, picture(80, 60, 3));
  expect_refused(
      {"--fov", "90"},
      "drive \xfc.png: the name is not valid UTF-8, expected one that a manifest can hold");
  fs::rename(image, path("images") + "/drive \u00fc.png");
  EXPECT_EQ(imported({"--fov", "90"}).frames[3].image.filename(), "drive \u00fc.png");
}

TEST_F(ImportOwn, OptionsThatBelongToAnotherAreRefusedWithoutIt) {
  expect_refused({"--fov", "90", "--pose-scale", "2"}, "--pose-scale requires --poses");
  expect_refused({"--fov", "90", "--gnss-sigma", "2"}, "--gnss-sigma requires --gnss");
  for (const auto& [option, value] :
       std::vector<std::pair<std::string, std::string>>{{"--least-score", "0.5"},
                                                        {"--classes", "car"},
                                                        {"--default-class", "van"},
                                                        {"--detections-source", "network:1"}}) {
    expect_refused({"--fov", "90", option, value}, option + " requires --detections");
  }
  expect_refused({"--fov", "90", "--up-sigma-deg", "2"},
                 "--up-sigma-deg: found neither --up nor --gnss, expected one of them");
  EXPECT_ONE_SENTENCE(run_camber({"import", "synthia-sf", "--sequence", path("images"),
                                  "--height-sigma", "0.1", "--out", path("out")}),
                      2, "--height-sigma requires --height");
  EXPECT_ONE_SENTENCE(run_camber({"import", "synthia-sf", "--sequence", path("images"), "--classes",
                                  "car", "--out", path("out")}),
                      2, "--classes requires --detections");
  // As --print-config has them they are no choice.
  const auto printed = import({"--fov", "90", "--print-config"});
  EXPECT_THAT(printed.out, HasSubstr("\n# up-sigma-deg = 1\n"));
  EXPECT_THAT(printed.out, HasSubstr("\n# pose-scale = 1\n"));
  EXPECT_THAT(printed.out, HasSubstr("\n# least-score = "));
  write_bytes(path("c.toml"), printed.out);
  EXPECT_EQ(import({"--config", path("c.toml")}).exit_code, 0);
}

TEST_F(ImportOwn, HeightsThatNoManifestTakesAreRefused) {
  expect_refused({"--fov", "90", "--height", "1e9"},
                 "--height: found 1e9, expected the camera's height");
}

TEST_F(ImportOwn, BoxesAreClippedAndCounted) {
  write_bytes(path("boxes.json"),
              R"({"images": [{"id": 7, "file_name": "drive 10.png", "width": 80, "height": 60},
      {"id": 8, "file_name": "other.png"}], "categories": [{"id": 3, "name": "Car"}, {"id": 4, "name": "person"}],
      "annotations": [{"image_id": 7, "category_id": 3, "bbox": [10, 20, 30, 20]},
      {"image_id": 7, "category_id": 3, "bbox": [70, 20, 30, 20]}, {"image_id": 7, "category_id": 4, "bbox": [1, 2, 3, 4]},
      {"image_id": 7, "category_id": 3, "bbox": [5, 5, 70, 50], "iscrowd": 1},
      {"image_id": 7, "category_id": 3, "bbox": [200, 20, 30, 20]}]})");
  const Scene scene = imported({"--fov", "90", "--detections", path("boxes.json")});
  ASSERT_EQ(scene.frames[2].vehicles.size(), 2u);
  const Box2 box = scene.frames[2].vehicles[0].box;
  EXPECT_EQ(box.x1, 10);
  EXPECT_EQ(box.y2, 40);
  EXPECT_EQ(scene.frames[2].vehicles[1].box.x2, 80);
  EXPECT_EQ(scene.detections_source, "import");
  EXPECT_THAT(error_, HasSubstr("2 boxes from boxes.json (COCO data set), 1 of other classes left "
                                "out (person), 1 that the file marks to be ignored (crowds, "
                                "DontCare) left out, 1 outside "
                                "the image left out, 1 clipped to the image, 1 images of the file "
                                "are not among the frames"));
  write_bytes(path("out.json"),
              R"([{"image_id": 10, "category_id": 3, "bbox": [200, 20, 30, 20], "score": 0.5}])");
  expect_refused({"--fov", "90", "--detections", path("out.json")},
                 "found 1 boxes wholly outside the images of 80 x 60 pixels");
  write_bytes(path("none.json"),
              R"([{"image_id": 99, "category_id": 3, "bbox": [1, 20, 30, 20], "score": 0.5}])");
  expect_refused({"--fov", "90", "--detections", path("none.json")},
                 "none of which is among the frames");
  write_bytes(path("results.json"),
              R"([{"image_id": 10, "category_id": 8, "bbox": [1, 20, 30, 20], "score": 0.5}])");
  const Scene results =
      imported({"--fov", "90", "--detections", path("results.json"), "--frames", "1:2"});
  ASSERT_EQ(results.frames.size(), 2u);
  EXPECT_EQ(results.frames[1].vehicles.at(0).vehicle_class, "truck");
  EXPECT_EQ(results.frames[1].vehicles.at(0).score, 0.5);
}

TEST_F(ImportOwn, MasksPosesSpeedsAndGravity) {
  fs::create_directories(path("masks"));
  std::vector<std::uint8_t> colors(80 * 60 * 3, 0);
  for (std::size_t i = 0; i < 80 * 30; ++i)
    colors[3 * i] = colors[3 * i + 2] = 255;  // the upper half is road
  write_png(path("masks/drive 2.png"), 80, 60, 2, 8, colors);
  write_bytes(path("poses.txt"), "0 0 0 0 0 0 0 1\n1 0 0 10 0 0 0 1\n");
  write_bytes(path("speed.csv"), "time,speed\n100,10\n101,12\n");
  write_bytes(path("up.csv"), "frame,roll_deg,pitch_deg\n0,0,0\n1,0,5.7295779513\n");
  const Scene scene =
      imported({"--fov", "90", "--rate", "2", "--masks", path("masks"), "--class-map", "kitti-road",
                "--poses", path("poses.txt"), "--speed", path("speed.csv"), "--speed-offset",
                "first", "--up", path("up.csv"), "--up-sigma-deg", "2"});
  ASSERT_EQ(scene.frames.size(), 3u);
  EXPECT_EQ(scene.frames[1].segmentation, path("out/segmentation/000001.png"));
  EXPECT_TRUE(fs::exists(scene.frames[1].segmentation));
  EXPECT_EQ(scene.segmentation_classes.at("road"), std::vector<int>{1});
  EXPECT_EQ(scene.segmentation_classes.size(), 1u);  // the class map has no other
  ASSERT_TRUE(scene.frames[1].world_from_camera);
  EXPECT_NEAR(scene.frames[1].world_from_camera->translation().z(), 5.0, 1e-12);
  EXPECT_EQ(scene.frames[0].speed, 10.0);
  EXPECT_EQ(scene.frames[1].speed, 11.0);
  EXPECT_EQ(scene.frames[2].speed, 12.0);
  EXPECT_EQ(scene.frames[1].speed_sigma, 0.24);
  ASSERT_TRUE(scene.frames[1].up);
  EXPECT_NEAR(scene.frames[1].up->z(), -std::sin(0.1), 1e-6);
  EXPECT_FALSE(scene.frames[2].up);
  EXPECT_THAT(error_, HasSubstr("1 mask, 3 poses, 3 speeds, 2 directions of gravity"));
  expect_refused({"--fov", "90", "--masks", path("masks"), "--class-map", "nothing"},
                 "--class-map nothing: no such file, and none of");
  write_bytes(path("skyward.csv"), "frame,roll_deg,pitch_deg\n0,0,-80\n");
  expect_refused({"--fov", "90", "--up", path("skyward.csv")},
                 "found roll 0.0 and pitch -80.0 degrees for frame 0, by which up points forward");
  expect_refused({"--fov", "90", "--masks", path("masks")}, "expected --class-map");
  expect_refused({"--fov", "90", "--speed", path("speed.csv")},
                 "the frames have none: expected --rate");
  expect_refused({"--fov", "90", "--rate", "2", "--speed", path("speed.csv")},
                 "found times from 100.000 to 101.000 s");
}

TEST_F(ImportOwn, WhatCannotBeIsRefusedInOneSentence) {
  expect_refused({}, "the camera is not given: expected --calib FILE");
  expect_refused({"--fov", "0"}, "--fov");
  expect_refused({"--fx", "1e300"}, "--fx");
  expect_refused({"--fx", "100", "--cy", "1e8"}, "--cy");
  expect_refused({"--fov", "90", "--fx", "100"}, "expected one");
  expect_refused({"--calib", path("none.yaml")}, "none.yaml: no such file");
  write_bytes(path("camera.yaml"),
              "image_width: 640\nimage_height: 480\nK: [1, 0, 2, 0, 3, 4, 0, 0, 1]\n");
  expect_refused({"--calib", path("camera.yaml")},
                 "found a camera of 640 x 480 pixels, expected the images' 80 x 60");
  expect_refused({"--fov", "90", "--times-from-names"}, "found no time in the file's name");
  write_bytes(path("times.txt"), "0\n1\n");
  expect_refused({"--fov", "90", "--times", path("times.txt")},
                 "found 2 times, expected one for each of the 3 images");
  write_bytes(path("times.txt"), "0\n1\n1\n");
  expect_refused({"--fov", "90", "--times", path("times.txt")}, "found the same time 1");
  write_png(path("images/drive 3.png"), 40, 30, 2, 8, picture(40, 30, 3));
  expect_refused({"--fov", "90"}, "found an image of 40 x 30 pixels, expected 80 x 60");
}

TEST_F(ImportOwn, WhatNoImportWroteIsKept) {
  FilmWriter film(path("drive.avi"), 10.0);
  for (int i = 0; i < 3; ++i) film.add(Image{80, 60, 3, picture(80, 60, 3)});
  film.finish();
  fs::create_directories(path("mine/image"));
  write_bytes(path("mine/image/000001.png"), "precious");
  const std::vector<std::string> words = {"import", "video",     path("drive.avi"), "--fov",
                                          "90",     "--extract", "--out",           path("mine")};
  EXPECT_ONE_SENTENCE(run_camber(words), 3, "000001.png: is there already");
  EXPECT_EQ(test::read_bytes(path("mine/image/000001.png")), "precious");
  EXPECT_FALSE(fs::exists(path("mine/scene.json")));
  fs::remove(path("mine/image/000001.png"));
  write_bytes(path("mine/scene.json"), R"({"my": "file"})");
  EXPECT_ONE_SENTENCE(run_camber(words), 3, "scene.json: is there already");
  EXPECT_EQ(test::read_bytes(path("mine/scene.json")), R"({"my": "file"})");
  fs::remove(path("mine/scene.json"));
  EXPECT_EQ(run_camber(words).exit_code, 0);
  EXPECT_EQ(run_camber(words).exit_code, 0);  // its own are replaced
}

TEST_F(ImportOwn, ASignalLeavesNoFolderOfFramesBehind) {
  FilmWriter film(path("drive.avi"), 10.0);
  for (int i = 0; i < 3; ++i) film.add(Image{80, 60, 3, picture(80, 60, 3)});
  film.finish();
  // A pipe that nobody writes: opening it never ends by itself.
  ASSERT_EQ(::mkfifo(path("up.csv").c_str(), 0600), 0);
  test::Surroundings stopped;
  stopped.signal = SIGTERM;
  stopped.signal_after_ms = 3000;  // a loaded machine takes long to load the libraries
  const auto result = test::run_camber_in(
      stopped, {"import", "video", path("drive.avi"), "--fov", "90", "--extract", "--up",
                path("up.csv"), "--out", path("new/scene")});
  EXPECT_ONE_SENTENCE(result, 130, "interrupted");
  EXPECT_GT(result.seconds_after_signal, 0.5) << "it was not waiting";
  EXPECT_FALSE(fs::exists(path("new")));
}

TEST_F(ImportOwn, AVideoIsReferredToOrExtracted) {
  FilmWriter film(path("drive.avi"), 10.0);
  for (int i = 0; i < 12; ++i) {
    Image one{80, 60, 3, picture(80, 60, 3)};
    for (std::size_t k = 0; k < one.data.size() / 2; ++k)
      one.data[k] = static_cast<std::uint8_t>(20 * i);
    film.add(one);
  }
  film.finish();
  const auto result = run_camber({"import", "video", path("drive.avi"), "--fov", "90", "--every",
                                  "2", "--from", "0.2", "--to", "0.85", "--out", path("out")});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_THAT(result.error, HasSubstr("video of 12 whole frames, mjpeg, 1.10 s, 10 a second\n"));
  const Scene scene = read_scene(path("out"));
  ASSERT_EQ(scene.frames.size(), 4u);
  EXPECT_EQ(scene.frames[0].id, 2);
  EXPECT_EQ(scene.frames[3].image, path("drive.avi") + "#8");
  EXPECT_NEAR(*scene.frames[3].time_s, 0.8, 1e-9);
  const auto extracted = run_camber(
      {"import", "video", path("drive.avi"), "--fov", "90", "--extract", "--out", path("out2")});
  ASSERT_EQ(extracted.exit_code, 0) << extracted.error;
  EXPECT_TRUE(fs::exists(path("out2/image/000011.png")));
  EXPECT_EQ(read_scene(path("out2")).frames[11].image, path("out2/image/000011.png"));
  const std::string bytes = test::read_bytes(path("drive.avi"));
  std::size_t at = bytes.find("movi");
  for (int i = 0; i < 8; ++i) at = bytes.find("00dc", at + 4);
  write_bytes(path("cut.avi"), bytes.substr(0, at + 60));
  const auto cut =
      run_camber({"import", "video", path("cut.avi"), "--fov", "90", "--out", path("out3")});
  EXPECT_EQ(cut.exit_code, 0) << cut.error;
  EXPECT_THAT(
      cut.error,
      HasSubstr("missing: frames 7 to 11: the video's header counts 12 frames, 7 are there"));
  EXPECT_EQ(read_scene(path("out3")).frames.size(), 7u);
  write_bytes(path("bad.mp4"), "no video");
  const auto before = snapshot(folder_.path());
  EXPECT_ONE_SENTENCE(
      run_camber({"import", "video", path("bad.mp4"), "--fov", "90", "--out", path("out4")}), 2,
      "found no video that can be read");
  EXPECT_ONE_SENTENCE(run_camber({"import", "video", path("drive.avi"), "--fov", "90", "--from",
                                  "9", "--out", path("out4")}),
                      2, "expected some in the part that was asked for");
  EXPECT_EQ(snapshot(folder_.path()), before);
}

/// A detector that ran on frames which another program had written to files names those.
TEST_F(ImportOwn, BoxesOfAVideoAreFoundByTheNumbersInTheirImagesNames) {
  FilmWriter film(path("drive.avi"), 10.0);
  for (int i = 0; i < 4; ++i) film.add(Image{80, 60, 3, picture(80, 60, 3)});
  film.finish();
  const auto boxes_of = [&](int first, int last) {
    json images = json::array(), boxes = json::array();
    for (int i = first; i <= last; ++i) {
      images.push_back({{"id", 50 + i}, {"file_name", "out_" + std::to_string(i) + ".jpg"}});
    }
    boxes.push_back({{"image_id", 50 + 2}, {"category_id", 3}, {"bbox", {10, 20, 30, 20}}});
    const json file = {
        {"images", images}, {"categories", {{{"id", 3}, {"name", "car"}}}}, {"annotations", boxes}};
    write_bytes(path("boxes.json"), file.dump());
    const auto result = run_camber({"import", "video", path("drive.avi"), "--fov", "90",
                                    "--detections", path("boxes.json"), "--out", path("out")});
    EXPECT_EQ(result.exit_code, 0) << result.error;
    error_ = result.error;
    return read_scene(path("out"));
  };
  const Scene from_zero = boxes_of(0, 3);
  EXPECT_EQ(from_zero.frames[2].vehicles.size(), 1u);
  EXPECT_THAT(error_, HasSubstr("by the numbers in the names of images, from 0 on"));
  const Scene from_one = boxes_of(1, 4);
  EXPECT_EQ(from_one.frames[1].vehicles.size(), 1u);
  EXPECT_EQ(from_one.frames[2].vehicles.size(), 0u);
  EXPECT_THAT(error_, HasSubstr("by the numbers in the names of images, from 1 on"));
  const Scene some = boxes_of(1, 2);  // of a part: their numbers hold
  EXPECT_EQ(some.frames[2].vehicles.size(), 1u);
}

TEST_F(ImportOwn, WhatACameraRecordedWithItsFilmIsTaken) {
  FilmWriter film(path("drive.mp4"), 10.0);
  for (int i = 0; i < 8; ++i) film.add(Image{80, 60, 3, picture(80, 60, 3)});
  film.finish();
  std::vector<std::string> payloads;
  for (int second = 0; second < 2; ++second) {
    std::vector<test::MadeFix> fixes;
    for (int i = 0; i < 18; ++i) {
      fixes.push_back({48.0 + 9e-5 * (second + i / 18.0), 11.0, 520.0, 10.0});
    }
    payloads.push_back(test::payload(test::gps5_stream(fixes, 3, 150)));
  }
  const std::string bytes = test::read_bytes(path("drive.mp4"));
  ASSERT_LT(bytes.find("mdat"), bytes.rfind("moov"));  // what with_telemetry() asks for
  write_bytes(path("drive.mp4"), test::with_telemetry(bytes, payloads));
  const std::vector<std::string> words = {"import", "video", path("drive.mp4"), "--fov",
                                          "90",     "--out", path("out")};
  const auto result = run_camber(words);
  ASSERT_EQ(result.exit_code, 0) << result.error;
  EXPECT_THAT(result.error, HasSubstr("telemetry of drive.mp4: HERO11 Black, GPS at 18 Hz, fix in "
                                      "3 dimensions, dilution of precision 1.5; the frames get "
                                      "its positions, speeds\n"));
  EXPECT_THAT(result.error, HasSubstr("EPSG:32632"));
  const Scene scene = read_scene(path("out"));
  ASSERT_EQ(scene.frames.size(), 8u);
  EXPECT_NEAR(*scene.frames[5].speed, 10.0, 1e-6);
  EXPECT_NEAR((scene.frames[7].map_position->position - scene.frames[0].map_position->position)
                  .head<2>()
                  .norm(),
              7.0, 0.1);
  auto without = words;
  without.emplace_back("--no-telemetry");
  const auto bare = run_camber(without);
  ASSERT_EQ(bare.exit_code, 0) << bare.error;
  EXPECT_THAT(bare.error, testing::Not(HasSubstr("telemetry")));
  EXPECT_FALSE(read_scene(path("out")).frames[5].speed);
  // A track that ends too early is named; the film is imported.
  std::string damaged = test::read_bytes(path("drive.mp4"));
  write_bytes(path("drive.mp4"), damaged.substr(0, damaged.size() - 60));
  const auto cut = run_camber(words);
  ASSERT_EQ(cut.exit_code, 0) << cut.error;
  EXPECT_THAT(cut.error, HasSubstr("telemetry, not used: "));
  auto both = without;
  both.insert(both.end(), {"--telemetry-offset", "1"});
  EXPECT_ONE_SENTENCE(run_camber(both), 2, "--telemetry-offset");
}

/// Boxes by the video's frames, of which an import may take a part.
TEST_F(ImportOwn, RowsOfAVideosBoxesStayWithTheirFrames) {
  FilmWriter film(path("drive.avi"), 10.0);
  for (int i = 0; i < 8; ++i) film.add(Image{80, 60, 3, picture(80, 60, 3)});
  film.finish();
  std::string mot;
  for (int i = 1; i <= 8; ++i)
    mot += std::to_string(i) + ",1," + std::to_string(5 * i) + ",20,30,20,0.9,-1,-1,-1\n";
  write_bytes(path("mot.txt"), mot);
  for (const std::vector<std::string>& part :
       {std::vector<std::string>{"--every", "3"}, {"--from", "0.35"}, {"--frames", "6"}}) {
    std::vector<std::string> arguments = {"import",        "video", path("drive.avi"),
                                          "--fov",         "90",    "--detections",
                                          path("mot.txt"), "--out", path("out")};
    arguments.insert(arguments.end(), part.begin(), part.end());
    const auto result = run_camber(arguments);
    ASSERT_EQ(result.exit_code, 0) << result.error;
    for (const SceneFrame& frame : read_scene(path("out")).frames) {
      ASSERT_EQ(frame.vehicles.size(), 1u);
      EXPECT_EQ(frame.vehicles[0].box.x1, 5.0 * (frame.id + 1)) << part[0];
    }
  }
}

TEST_F(ImportOwn, ARateCountsTheFramesThatAreMissing) {
  fs::create_directories(path("gaps"));
  for (const char* name : {"000010", "000020", "000030", "000050", "000060"}) {
    fs::copy_file(path("images/drive 1.png"), path(std::string("gaps/") + name + ".png"));
  }
  const auto times = [&](const std::string& folder) {
    const auto result = run_camber(
        {"import", "images", path(folder), "--fov", "90", "--rate", "10", "--out", path("out")});
    EXPECT_EQ(result.exit_code, 0) << result.error;
    error_ = result.error;
    std::vector<double> out;
    for (const SceneFrame& frame : read_scene(path("out")).frames) out.push_back(*frame.time_s);
    return out;
  };
  EXPECT_THAT(times("gaps"), ElementsAre(0.0, 0.1, 0.2, 0.4, 0.5));
  EXPECT_THAT(error_, HasSubstr("times by the numbers of the files, which leave out 1 of 6"));
  // Numbers that count something else than frames.
  fs::create_directories(path("milliseconds"));
  for (const char* name : {"1000", "1033", "1067", "1100"}) {
    fs::copy_file(path("images/drive 1.png"), path(std::string("milliseconds/") + name + ".png"));
  }
  EXPECT_THAT(times("milliseconds"), ElementsAre(0.0, 0.1, 0.2, 0.3));
  EXPECT_THAT(error_, Not(HasSubstr("leave out")));
}

TEST_F(ImportOwn, MasksAreOfOneKind) {
  fs::create_directories(path("masks"));
  const std::vector<std::uint8_t> labels(80 * 60, 7), colors(80 * 60 * 3, 128);
  for (const char* name : {"drive 1", "drive 2", "drive 10"}) {
    const std::string mask = path("masks/" + std::string(name));
    write_png(mask + "_gtFine_color.png", 80, 60, 2, 8, colors);
    write_png(mask + "_gtFine_labelIds.png", 80, 60, 0, 8, labels);
    write_png(mask + "_gtFine_labelTrainIds.png", 80, 60, 0, 8,
              std::vector<std::uint8_t>(80 * 60, 0));
  }
  const std::vector<std::string> options = {"--fov", "90", "--masks", path("masks"), "--class-map"};
  const auto with = [&](const char* map) {
    std::vector<std::string> out = options;
    out.emplace_back(map);
    return out;
  };
  for (const SceneFrame& frame : imported(with("cityscapes")).frames) {
    EXPECT_THAT(frame.segmentation.string(), EndsWith("_gtFine_labelIds.png"));
  }
  for (const SceneFrame& frame : imported(with("cityscapes-train")).frames) {
    EXPECT_THAT(frame.segmentation.string(), EndsWith("_gtFine_labelTrainIds.png"));
  }
  EXPECT_EQ(read_scene(path("out")).segmentation_classes.at("road"), std::vector<int>{0});
  fs::remove(path("masks/drive 2_gtFine_labelIds.png"));
  fs::remove(path("masks/drive 2_gtFine_labelTrainIds.png"));
  expect_refused(with("cityscapes"),
                 "drive 2_gtFine_color.png: found a mask in colours beside others of numbers");
  write_png(path("masks/drive 2_mask.png"), 80, 60, 0, 8, labels);
  fs::create_directories(path("train"));
  write_png(path("train/drive 1_gtFine_labelTrainIds.png"), 80, 60, 0, 8, labels);
  expect_refused({"--fov", "90", "--masks", path("train"), "--class-map", "cityscapes"},
                 "found a mask of train ids, expected those of the class map cityscapes");
  expect_refused(with("cityscapes"), "found both drive 2_gtFine_color.png and drive 2_mask.png");
}

TEST_F(ImportOwn, APrincipalPointOfAnotherSizeIsWarnedOf) {
  imported({"--fx", "100", "--cx", "61"});
  EXPECT_THAT(error_,
              HasSubstr("missing: a principal point near the middle: cx 61 in images of 80"));
  imported({"--fx", "100", "--cx", "50"});
  EXPECT_THAT(error_, Not(HasSubstr("principal point")));
}

TEST_F(ImportOwn, PosesWithCommasAreEuroCs) {
  write_bytes(path("tum.csv"), "0.0,0,0,0,0,0,0,1\n0.5,0,0,1,0,0,0,1\n");
  expect_refused({"--fov", "90", "--rate", "2", "--poses", path("tum.csv")},
                 "tum.csv: line 1, field 1: found '0.0', expected whole nanoseconds");
  write_bytes(path("euroc.csv"), "0,0,0,0,1,0,0,0\n1000000000,0,0,4,1,0,0,0\n");
  const Scene scene = imported({"--fov", "90", "--rate", "2", "--poses", path("euroc.csv")});
  EXPECT_NEAR(scene.frames[1].world_from_camera.value().translation().z(), 2.0, 1e-9);
}

TEST_F(ImportOwn, BoxesOfSeveralImagesOfOneNameAreNotJoined) {
  const auto write_boxes = [&](const std::string& a, const std::string& b) {
    const json file = {{"images", {{{"id", 1}, {"file_name", a}}, {{"id", 2}, {"file_name", b}}}},
                       {"categories", {{{"id", 3}, {"name", "car"}}}},
                       {"annotations",
                        {{{"image_id", 1}, {"category_id", 3}, {"bbox", {10, 20, 30, 20}}},
                         {{"image_id", 2}, {"category_id", 3}, {"bbox", {15, 20, 30, 20}}}}}};
    write_bytes(path("boxes.json"), file.dump());
  };
  write_boxes("front/drive 1.png", "rear/drive 1.png");
  expect_refused(
      {"--fov", "90", "--detections", path("boxes.json")},
      "found boxes of both front/drive 1.png and rear/drive 1.png for the image drive 1.png");
  write_boxes("rear/drive 1.png", "images/drive 1.png");
  const Scene scene = imported({"--fov", "90", "--detections", path("boxes.json")});
  ASSERT_EQ(scene.frames[0].vehicles.size(), 1u);
  EXPECT_EQ(scene.frames[0].vehicles[0].box.x1, 15.0);
}

TEST_F(ImportOwn, RowsOfMotCountFromOneAndMayHaveNegativeScores) {
  write_bytes(path("mot.txt"), "1,-1,10,20,30,20,-0.7,-1,-1,-1\n1,-1,50,20,30,20,-1,-1,-1,-1\n");
  const Scene scene = imported({"--fov", "90", "--detections", path("mot.txt")});
  ASSERT_EQ(scene.frames[0].vehicles.size(), 2u);
  EXPECT_EQ(scene.frames[0].vehicles[0].score, -0.7);
  EXPECT_EQ(scene.frames[0].vehicles[1].score, 1.0);
  const Scene better =
      imported({"--fov", "90", "--detections", path("mot.txt"), "--least-score", "0.1"});
  EXPECT_EQ(better.frames[0].vehicles.size(), 1u);  // of which no score is known
  write_bytes(path("mot.txt"), "0,-1,10,20,30,20,0.7,-1,-1,-1\n");
  expect_refused({"--fov", "90", "--detections", path("mot.txt")},
                 "mot.txt: line 1, field 1: found '0', expected a frame number from 1");
}

TEST_F(ImportOwn, AColmapModel) {
  fs::create_directories(path("model"));
  write_bytes(path("model/cameras.txt"), "1 SIMPLE_RADIAL 80 60 100 40 30 -0.1\n");
  write_bytes(path("model/images.txt"), "5 1 0 0 0 0 0 -2 1 drive 10.png\n\n");
  write_bytes(path("model/points3D.txt"), "");
  const auto spaced = run_camber(
      {"import", "colmap", path("model"), "--images", path("images"), "--out", path("out")});
  EXPECT_NE(spaced.exit_code, 3);  // names with blanks are COLMAP's matter
  fs::rename(path("images/drive 1.png"), path("images/a1.png"));
  fs::rename(path("images/drive 10.png"), path("images/a10.png"));
  write_bytes(path("model/images.txt"),
              "5 1 0 0 0 0 0 -2 1 a10.png\n\n7 1 0 0 0 0 0 0 1 a1.png\n\n");
  const auto result = run_camber({"import", "colmap", path("model"), "--images", path("images"),
                                  "--scale", "3", "--out", path("out")});
  ASSERT_EQ(result.exit_code, 0) << result.error;
  const Scene scene = read_scene(path("out"));
  ASSERT_EQ(scene.frames.size(), 2u);
  EXPECT_EQ(scene.frames[1].image.filename(), "a10.png");
  EXPECT_EQ(scene.frames[1].world_from_camera->translation(), Eigen::Vector3d(0, 0, 6));
  EXPECT_EQ(scene.distortion.raw.cx, 39.5);
  EXPECT_EQ(scene.distortion.coefficients[0], -0.1);
  const auto plain = run_camber(
      {"import", "colmap", path("model"), "--images", path("images"), "--out", path("out")});
  EXPECT_THAT(plain.error, HasSubstr("missing: poses: a model is up to scale"));
  EXPECT_FALSE(read_scene(path("out")).frames[0].world_from_camera);
  EXPECT_ONE_SENTENCE(run_camber({"import", "colmap", path("images"), "--images", path("images"),
                                  "--out", path("o")}),
                      2, "found no images.bin and no images.txt");
}

}  // namespace
}  // namespace camber
