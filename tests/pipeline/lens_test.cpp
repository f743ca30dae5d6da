// The embedded scene through lenses: images as a distorting camera would have given them.

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "camber/evaluate/metrics.h"
#include "camber/geometry/lens_map.h"
#include "camber/image/image_io.h"
#include "camber/pipeline/reconstruct.h"
#include "support/test_data.h"

namespace camber {
namespace {

/// Images of the scene's camera as the lens shows them; black where the camera saw nothing.
class ThroughLens {
 public:
  ThroughLens(const PinholeCamera& camera, const LensDistortion& lens)
      : x_(lens.raw.height, lens.raw.width, CV_32FC1), y_(x_.size(), CV_32FC1) {
    const LensMap map(camera, lens);
    for (int v = 0; v < x_.rows; ++v) {
      for (int u = 0; u < x_.cols; ++u) {
        const auto pixel = map.pinhole_from_raw({u, v});
        x_.at<float>(v, u) = pixel ? static_cast<float>(pixel->x()) : -1000.0F;
        y_.at<float>(v, u) = pixel ? static_cast<float>(pixel->y()) : -1000.0F;
      }
    }
  }

  Image operator()(const Image& image, int interpolation) const {
    Image out{x_.cols, x_.rows, image.channels, {}};
    out.data.resize(static_cast<std::size_t>(out.width * out.height * image.channels));
    const int type = CV_8UC(image.channels);
    const cv::Mat from(image.height, image.width, type,
                       const_cast<std::uint8_t*>(image.data.data()));
    cv::Mat to(out.height, out.width, type, out.data.data());
    cv::remap(from, to, x_, y_, interpolation, cv::BORDER_CONSTANT);
    return out;
  }

 private:
  cv::Mat x_, y_;
};

SceneMetrics metrics(const Scene& scene, const Reconstruction& result) {
  return evaluate_scene(scene, result.surface, result.vehicles, result.run);
}

TEST(Lens, TheSceneIsAsRightThroughALens) {
  const Scene scene = read_scene(test::source_dir() / "samples" / "steep_hill");
  const Reconstruction plain = reconstruct(scene, {0, 1}, {});
  for (const LensModel model : {LensModel::kBrown, LensModel::kFisheye}) {
    LensDistortion lens;
    lens.model = model;
    lens.coefficients = model == LensModel::kBrown
                            ? std::vector<double>{-0.25, 0.07, 0.0005, -0.0003, -0.01}
                            : std::vector<double>{0.01, -0.004, 0.001, 0.0};
    lens.raw = scene.camera;
    const ThroughLens through_lens(scene.camera, lens);
    const test::TemporaryFolder folder;
    Scene bent = scene;
    bent.distortion = lens;
    bent.frames.resize(2);
    for (SceneFrame& frame : bent.frames) {
      const std::string id = std::to_string(frame.id);
      const Image image = read_color_image(frame.image);
      const Image labels = read_label_image(frame.segmentation, scene.camera);
      frame.image = folder.path() / (id + ".png");
      frame.segmentation = folder.path() / (id + "_labels.png");
      write_png(through_lens(image, cv::INTER_CUBIC), frame.image);
      write_png(through_lens(labels, cv::INTER_NEAREST), frame.segmentation);
    }
    const Reconstruction result = reconstruct(bent, {0, 1}, {});
    EXPECT_EQ(result.run.scale_status, Status::kOk) << to_string(model);
    const SceneMetrics found = metrics(bent, result);
    EXPECT_LT(std::abs(found.scale_error - metrics(scene, plain).scale_error), 0.01)
        << to_string(model);
    EXPECT_GT(result.cloud.size(), 0.8 * plain.cloud.size());

    if (model == LensModel::kFisheye) continue;
    // Taken as they are the images are of another camera.
    bent.distortion = LensDistortion{};
    const Reconstruction wrong = reconstruct(bent, {0, 1}, {});
    EXPECT_GT(metrics(bent, wrong).rotation_error, 5.0 * found.rotation_error)
        << to_string(model);  // 0.00037 and 0.00002 rad measured
  }
}

// A pincushion's corners lie outside the file; without masks of its own a run must not take them
// for ground.
TEST(Lens, WhatItDoesNotShowIsHiddenFromARun) {
  const test::TemporaryFolder folder;
  Scene scene;
  scene.camera = {160, 100, 100.0, 100.0, 80.0, 50.0};
  scene.distortion.model = LensModel::kBrown;
  scene.distortion.coefficients = {0.3, 0.0, 0.0, 0.0};
  scene.distortion.raw = scene.camera;
  for (int id = 0; id < 2; ++id) {
    Image image{160, 100, 3, std::vector<std::uint8_t>(160 * 100 * 3, std::uint8_t(100 + id))};
    SceneFrame frame;
    frame.id = id;
    frame.image = folder.path() / (std::to_string(id) + ".png");
    write_png(image, frame.image);
    scene.frames.push_back(frame);
  }
  const LoadedFrames frames = stages::load(scene, {0, 1}, {});
  for (const FrameMasks& masks : frames.masks) {
    EXPECT_EQ(masks.ground[0], 0);
    EXPECT_NE(masks.vehicle[0], 0);
    EXPECT_NE(masks.ground[50 * 160 + 80], 0);
    EXPECT_EQ(masks.vehicle[50 * 160 + 80], 0);
  }
  EXPECT_EQ(frames.gray[1].pixels[50 * 160 + 80], 101);
  EXPECT_EQ(frames.gray[1].pixels[0], 0);
}

}  // namespace
}  // namespace camber
