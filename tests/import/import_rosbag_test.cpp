#include "camber/import/import_rosbag.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "camber/core/errors.h"
#include "camber/image/image_io.h"
#include "scene/write_image.h"
#include "support/ros_messages.h"
#include "support/test_data.h"

namespace camber {
namespace {

using test::picture;
using test::ros_compressed_image;
using test::ros_image;
using test::RosCameraInfo;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
namespace fs = std::filesystem;

/// Messages by topic, in memory: what tools/plugins/bag_reader.h makes of a file.
class MemoryBag : public BagReader {
 public:
  void add(const std::string& topic, const std::string& type, const std::string& bytes) {
    auto at = std::find_if(topics_.begin(), topics_.end(),
                           [&](const Topic& t) { return t.name == topic; });
    if (at == topics_.end())
      at = topics_.insert(topics_.end(), Topic{topic, "sensor_msgs/" + type});
    ++at->messages;
    messages_.emplace_back(topic, bytes);
  }
  const std::vector<Topic>& topics() const override { return topics_; }
  void read(const std::string& topic, const std::function<bool(const BagMessage&)>& take) override {
    std::int64_t recorded = 5000000000;
    for (const auto& [name, bytes] : messages_) {
      recorded += 100000000;
      if (name != topic) continue;
      if (!take({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(), recorded})) {
        return;
      }
    }
  }

 private:
  std::vector<Topic> topics_;
  std::vector<std::pair<std::string, std::string>> messages_;
};

class ImportRosbag : public ::testing::Test {
 protected:
  static constexpr int kWidth = 80, kHeight = 60;

  static std::string pixels(int channels) {
    const auto bytes = picture(kWidth, kHeight, channels);
    return {bytes.begin(), bytes.end()};
  }
  void add_image(double seconds, const std::string& topic = "/cam/image_raw") {
    bag_->add(topic, "Image", ros_image(seconds, kWidth, kHeight, "rgb8", 3 * kWidth, pixels(3)));
  }
  void add_info(const RosCameraInfo& info = {}, const std::string& topic = "/cam/camera_info") {
    bag_->add(topic, "CameraInfo", info.bytes());
  }
  std::string jpeg(int channels) const {
    const fs::path file = folder_.path() / "made.jpg";
    test::write_jpeg(file, kWidth, kHeight, channels, picture(kWidth, kHeight, channels));
    return test::read_bytes(file);
  }
  OwnImport import() {
    return import_rosbag(bag_, "drive.bag", choice_, options_, folder_.path() / "out/scene.json");
  }
  /// Imports and writes; the images as they are then read.
  OwnImport written() {
    fs::create_directories(folder_.path() / "out");
    OwnImport out = import();
    write_own_import(out, folder_.path() / "out/scene.json");
    return out;
  }
  std::string refusal() {
    try {
      written();
    } catch (const InputError& error) {
      EXPECT_FALSE(fs::exists(folder_.path() / "out/image"));
      EXPECT_FALSE(fs::exists(folder_.path() / "out/scene.json"));
      return error.what();
    }
    return "no error";
  }

  test::TemporaryFolder folder_;
  std::shared_ptr<MemoryBag> bag_ = std::make_shared<MemoryBag>();
  BagChoice choice_;
  OwnDataOptions options_;
};

TEST_F(ImportRosbag, FramesInTheOrderOfTheirStampsWithTheCameraOfCameraInfo) {
  for (const double t : {100.2, 100.0, 100.1, 100.5, 100.1}) add_image(t);
  add_info();
  const OwnImport out = written();
  ASSERT_EQ(out.scene.frames.size(), 4u);
  EXPECT_EQ(out.scene.frames[1].id, 1);
  EXPECT_NEAR(*out.scene.frames[1].time_s, 100.1, 1e-6);
  EXPECT_EQ(out.scene.frames[3].image.filename(), "000003.png");
  EXPECT_EQ(out.scene.name, "drive");
  EXPECT_EQ(out.scene.distortion.model, LensModel::kBrown);
  EXPECT_EQ(out.scene.distortion.raw.fy, 101.0);
  EXPECT_EQ(out.scene.distortion.coefficients.at(0), -0.3);
  EXPECT_THAT(out.found, Contains("4 images of /cam/image_raw over 0.50 s, 10 a second"));
  EXPECT_THAT(out.found,
              Contains(HasSubstr("camera /cam/camera_info (CameraInfo): fx 100 fy 101")));
  EXPECT_THAT(out.missing, Contains("1 images with the time of another, left out"));
  EXPECT_THAT(out.missing, Contains(HasSubstr("images in 1 gaps of up to 0.3 s")));
  EXPECT_THAT(out.missing, Contains(HasSubstr("no boxes")));
  EXPECT_THAT(out.missing, Contains(HasSubstr("up to scale")));
  EXPECT_EQ(read_color_image(out.scene.frames[0].image).data, picture(kWidth, kHeight, 3));
  const Scene again = read_scene(folder_.path() / "out/scene.json");
  EXPECT_EQ(again.frames.size(), 4u);
  EXPECT_EQ(again.camera.width, out.scene.camera.width);
}

TEST_F(ImportRosbag, PartOfTheFrames) {
  for (int i = 0; i < 10; ++i) add_image(100.0 + 0.1 * i);
  add_info();
  choice_.frames.from = 0.25;
  choice_.frames.to = 0.85;
  choice_.frames.every = 2;
  std::vector<int> ids;
  for (const SceneFrame& frame : written().scene.frames) ids.push_back(frame.id);
  EXPECT_THAT(ids, ElementsAre(3, 5, 7));
  EXPECT_TRUE(fs::exists(folder_.path() / "out/image/000005.png"));
  EXPECT_FALSE(fs::exists(folder_.path() / "out/image/000004.png"));
  fs::remove_all(folder_.path() / "out");
  choice_.frames.from = 5.0;
  choice_.frames.to.reset();
  EXPECT_THAT(refusal(), HasSubstr("found images from 0 to 0.900 s, expected some in the part"));
}

TEST_F(ImportRosbag, RowsOfMotAreOfTheWholeRecording) {
  for (int i = 0; i < 10; ++i) add_image(100.0 + 0.1 * i);
  add_info();
  choice_.frames.from = 0.25;
  choice_.frames.every = 2;
  options_.detections.file = folder_.path() / "boxes.txt";
  // Frames from 1: 4 and 6 are messages 3 and 5; the second and the fifth are not taken.
  std::ofstream(options_.detections.file) << "4,1,10,20,30,20,1,3,1\n6,1,12,20,30,20,1,3,1\n"
                                          << "2,1,14,20,30,20,1,3,1\n5,1,16,20,30,20,1,3,1\n";
  const Scene scene = written().scene;
  ASSERT_EQ(scene.frames.size(), 4u);
  std::vector<int> with_boxes;
  for (const SceneFrame& frame : scene.frames) {
    if (!frame.vehicles.empty()) with_boxes.push_back(frame.id);
  }
  EXPECT_THAT(with_boxes, ElementsAre(3, 5));
}

TEST_F(ImportRosbag, CompressedImagesStayAsTheyAre) {
  const std::string file = jpeg(3);
  bag_->add("/cam/image_raw/compressed", "CompressedImage",
            ros_compressed_image(1, "rgb8; jpeg compressed bgr8", file));
  test::write_png(folder_.path() / "a.png", kWidth, kHeight, 2, 8, picture(kWidth, kHeight, 3));
  const std::string png = test::read_bytes(folder_.path() / "a.png");
  bag_->add("/cam/image_raw/compressed", "CompressedImage",
            ros_compressed_image(2, "rgb8; png compressed bgr8", png));
  add_info();
  const Scene scene = written().scene;
  EXPECT_EQ(scene.frames.at(0).image.filename(), "000000.jpg");
  EXPECT_EQ(scene.frames.at(1).image.filename(), "000001.png");
  EXPECT_EQ(test::read_bytes(scene.frames[0].image), file);
  EXPECT_EQ(test::read_bytes(scene.frames[1].image), png);
}

TEST_F(ImportRosbag, ACompressedMosaicBecomesColours) {
  std::vector<std::uint8_t> mosaic;
  for (int i = 0; i < kWidth * kHeight; ++i) {
    const bool red = (i / kWidth) % 2 == 0 && i % 2 == 0,
               blue = (i / kWidth) % 2 == 1 && i % 2 == 1;
    mosaic.push_back(red ? 200 : blue ? 40 : 120);
  }
  test::write_png(folder_.path() / "a.png", kWidth, kHeight, 0, 8, mosaic);
  bag_->add("/cam/image_raw/compressed", "CompressedImage",
            ros_compressed_image(1, "bayer_rggb8; png compressed ",
                                 test::read_bytes(folder_.path() / "a.png")));
  add_info();
  const Image image = read_color_image(written().scene.frames.at(0).image);
  EXPECT_EQ(image.data[0], 200);
  EXPECT_EQ(image.data[1], 120);
  EXPECT_EQ(image.data[2], 40);
}

TEST_F(ImportRosbag, TopicsThatLeaveAChoice) {
  add_image(1, "/left/image_raw");
  add_image(1.5, "/right/image_raw");
  add_info({}, "/left/camera_info");
  EXPECT_THAT(refusal(),
              HasSubstr("found images of 2 topics: /left/image_raw (1), /right/image_raw "
                        "(1); expected the choice of one with --topic"));
  choice_.topic = "/front/image_raw";
  EXPECT_THAT(refusal(), HasSubstr("found no topic /front/image_raw with images, expected one of"));
  choice_.topic = "left/image_raw";
  EXPECT_EQ(written().scene.frames.size(), 1u);
  fs::remove_all(folder_.path() / "out");
  // The other camera's calibration is not taken for its own.
  choice_.topic = "/right/image_raw";
  EXPECT_THAT(refusal(),
              HasSubstr("found no /right/camera_info but /left/camera_info (1); expected "
                        "the choice of one with --info-topic, or --calib"));
  choice_.info_topic = "/left/camera_info";
  EXPECT_EQ(written().scene.distortion.raw.fx, 100.0);
}

TEST_F(ImportRosbag, WithoutACameraOrImages) {
  EXPECT_THAT(refusal(), HasSubstr("found no images among 0 topics"));
  add_image(1);
  EXPECT_THAT(refusal(),
              HasSubstr("found no CameraInfo of /cam/image_raw, expected one, or --calib"));
  options_.camera.fov_deg = 90.0;
  const OwnImport out = written();
  EXPECT_NEAR(out.scene.camera.fx, 40.0, 1e-9);
  EXPECT_THAT(out.missing, Contains(HasSubstr("no distortion")));
}

TEST_F(ImportRosbag, LensesOfCameraInfo) {
  add_image(1);
  RosCameraInfo info;
  info.model = "equidistant";
  info.coefficients = {0.05, -0.01, 0.002, 0.0};
  add_info(info);
  const Scene scene = import().scene;
  EXPECT_EQ(scene.distortion.model, LensModel::kFisheye);
  EXPECT_EQ(scene.distortion.coefficients, info.coefficients);
  const auto refused = [&](const RosCameraInfo& changed) {
    bag_ = std::make_shared<MemoryBag>();
    add_image(1);
    add_info(changed);
    return refusal();
  };
  RosCameraInfo changed;
  changed.model = "mystery";
  EXPECT_THAT(refused(changed), HasSubstr("\"mystery\" is not supported"));
  changed = {};
  changed.fx = changed.fy = 0;
  EXPECT_THAT(refused(changed), HasSubstr("focal lengths 0 and 0, as of a camera that was not"));
  changed = {};
  changed.binning = 2;
  EXPECT_THAT(refused(changed), HasSubstr("binned or cut out"));
  changed = {};
  changed.roi_left = 8;
  EXPECT_THAT(refused(changed), HasSubstr("binned or cut out"));
  changed = {};
  changed.width = 640;
  changed.height = 480;
  EXPECT_THAT(refused(changed), HasSubstr("640 x 480"));
  changed = {};
  changed.coefficients = {std::nan("")};
  EXPECT_THAT(refused(changed), HasSubstr("values that are no numbers"));
}

TEST_F(ImportRosbag, RectifiedImagesHaveTheProjectionOfCameraInfo) {
  add_image(1, "/cam/image_rect_color");
  add_info();
  const OwnImport out = import();
  EXPECT_EQ(out.scene.camera.fx, 90.0);
  EXPECT_EQ(out.scene.distortion.model, LensModel::kNone);
  EXPECT_THAT(out.found, Contains(HasSubstr("rectified images by their topic's name")));
}

TEST_F(ImportRosbag, TimesOfTheRecordingWhereHeadersHaveNone) {
  add_image(0);
  add_image(0);
  add_info();
  const OwnImport out = import();
  ASSERT_EQ(out.scene.frames.size(), 2u);
  EXPECT_NEAR(*out.scene.frames[1].time_s, 5.2, 1e-9);
  EXPECT_THAT(out.found, Contains(HasSubstr("those of the recording are taken")));
  add_image(7);  // one header with a time: those without are left out
  const OwnImport mixed = import();
  EXPECT_EQ(mixed.scene.frames.size(), 1u);
  EXPECT_THAT(mixed.missing, Contains("2 images whose header has no time, left out"));
}

TEST_F(ImportRosbag, ImagesThatCannotBeTaken) {
  const auto refused = [&](const std::string& second, const std::string& type = "Image") {
    bag_ = std::make_shared<MemoryBag>();
    if (type == "Image") {
      add_image(1);
    } else {
      bag_->add("/cam/image_raw", type, ros_compressed_image(1, "jpeg", jpeg(3)));
    }
    bag_->add("/cam/image_raw", type, second);
    bag_->add("/cam/camera_info", "CameraInfo", RosCameraInfo().bytes());
    choice_.info_topic = "/cam/camera_info";
    return refusal();
  };
  EXPECT_THAT(refused(ros_image(2, kWidth, kHeight, "32FC1", 4 * kWidth, std::string(19200, 'x'))),
              HasSubstr("drive.bag: message 1 of /cam/image_raw: found the encoding \"32FC1\""));
  EXPECT_THAT(refused(ros_image(2, 40, 30, "mono8", 40, std::string(1200, 'x'))),
              HasSubstr("found an image of 40 x 30 pixels, expected 80 x 60"));
  EXPECT_THAT(refused(ros_image(2, kWidth, kHeight, "mono8", kWidth, "few")),
              HasSubstr("found 3 bytes of pixels, expected 60 rows of 80"));
  EXPECT_THAT(refused(ros_image(2, 70000, 60, "mono8", 70000, "few")),
              HasSubstr("found an image of 70000 x 60 pixels"));
  const std::string whole = ros_image(2, 2, 2, "mono8", 2, "abcd");
  for (std::size_t n = 0; n < whole.size(); ++n) {
    ASSERT_THAT(refused(whole.substr(0, n)), HasSubstr("expected a whole message")) << n;
  }
  EXPECT_THAT(refused(ros_compressed_image(2, "h264", "\x01\x02"), "CompressedImage"),
              HasSubstr("message 1 of /cam/image_raw: found "));
  const std::string cut = jpeg(3).substr(0, 900);
  EXPECT_THAT(refused(ros_compressed_image(2, "jpeg", cut), "CompressedImage"),
              Not(HasSubstr("no error")));
}

}  // namespace
}  // namespace camber
