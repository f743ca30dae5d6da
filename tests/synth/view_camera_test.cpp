// Scenes that are seen through a lens: what is drawn, against the same view without one.

#include "camber/synth/view_camera.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/image/image_io.h"
#include "camber/image/undistortion.h"
#include "camber/synth/synthesise.h"
#include "support/test_data.h"

namespace camber {
namespace {

SynthOptions small_options(LensModel lens) {
  SynthOptions options;
  options.seed = 5;
  options.num_frames = 2;
  options.num_threads = 2;
  options.cloud_points = 100;
  options.camera = {320,
                    180,
                    lens == LensModel::kFisheye ? 153.0 : 190.0,
                    lens == LensModel::kFisheye ? 153.0 : 190.0,
                    158.0,
                    84.0};
  options.lens = lens;
  options.lens_coefficients = lens == LensModel::kBrown
                                  ? std::vector<double>{-0.33, 0.13, 0.001, -0.002, -0.02}
                                  : std::vector<double>{0.01, -0.004, 0.001, 0.0};
  return options;
}

/// Share of the values that differ by more than `most`, where the files show something.
double share_that_differs(const Image& a, const std::vector<std::uint8_t>& b,
                          const Undistortion& lens, int most) {
  std::size_t differ = 0, all = 0;
  const auto channels = static_cast<std::size_t>(a.channels);
  for (std::size_t i = 0; i < a.data.size(); ++i) {
    if (lens.outside()[i / channels] != 0) continue;
    ++all;
    differ += std::abs(int{a.data[i]} - int{b[i]}) > most;
  }
  return static_cast<double>(differ) / static_cast<double>(all);
}

// Taking the lens out of the picture and of the labels gives what a pinhole camera sees; taking
// out another lens does not.
TEST(ViewCamera, ThroughALensIsWhatThePinholeCameraSees) {
  for (const LensModel model : {LensModel::kBrown, LensModel::kFisheye}) {
    SynthOptions options = small_options(model);
    options.sensor = {5, 3, 0.3, 0.0, 0.0, 0.0};
    const SynthWorld world = make_synth_world(world_options(options));
    const ViewCamera view = view_camera(options);
    EXPECT_GT(view.camera().width, view.file().width);
    const LensDistortion lens{model, options.lens_coefficients, options.camera};
    const Undistortion undistortion(view.camera(), lens);
    const Image file{320, 180, 3, render_view(world, 1, view, options.sensor, 2)};
    const auto pinhole = render_view(world, 1, view.camera(), options.sensor, 2);
    const double picture = share_that_differs(undistortion.image(file), pinhole, undistortion, 25);
    const Image labels{320, 180, 1, trace_labels(world, 1, view, 2)};
    const ViewTruth truth = trace_view(world, 1, view.camera(), 2);
    const double classes =
        share_that_differs(undistortion.labels(labels), truth.labels, undistortion, 0);
    // The file's pixels are up to four times as wide as the camera's at its border.
    EXPECT_LT(picture, 0.04) << to_string(model);
    EXPECT_LT(classes, 0.02) << to_string(model);

    LensDistortion other = lens;
    other.coefficients[0] += 0.1;
    const Undistortion wrong(view.camera(), other);
    EXPECT_GT(share_that_differs(wrong.image(file), pinhole, wrong, 25), 3 * picture);
    EXPECT_GT(share_that_differs(wrong.labels(labels), truth.labels, wrong, 0), 2 * classes);
  }
}

TEST(ViewCamera, PicturesAreTheSameForAnyNumberOfThreads) {
  const SynthOptions options = small_options(LensModel::kFisheye);
  const SynthWorld world = make_synth_world(world_options(options));
  const ViewCamera one({options.lens, options.lens_coefficients, options.camera}, 1),
      three({options.lens, options.lens_coefficients, options.camera}, 3);
  EXPECT_EQ(render_view(world, 0, one, options.sensor, 1),
            render_view(world, 0, three, options.sensor, 3));
  EXPECT_EQ(trace_labels(world, 0, one, 1), trace_labels(world, 0, three, 3));
}

TEST(ViewCamera, RaysAreThoseOfTheLens) {
  const SynthOptions options = small_options(LensModel::kBrown);
  const ViewCamera view = view_camera(options);
  const LensMap map(view.camera(), {options.lens, options.lens_coefficients, options.camera});
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(-0.4, -0.4), Eigen::Vector2d(17.3, 170.7), Eigen::Vector2d(158.5, 84.1),
        Eigen::Vector2d(319.3, 90.5), Eigen::Vector2d(300.0, 12.0)}) {
    const Eigen::Vector2d back = view.camera().project(view.ray(pixel)).value();
    const auto raw = map.raw_from_pinhole(back);
    ASSERT_TRUE(raw.has_value());
    EXPECT_LT((*raw - pixel).norm(), 2e-3) << pixel.transpose();  // interpolated over one pixel
  }
}

TEST(ViewCamera, ShowsOfABoxWhatTheFilesShow) {
  const SynthOptions options = small_options(LensModel::kFisheye);
  const ViewCamera view = view_camera(options);
  const int width = view.camera().width, height = view.camera().height;
  const auto whole = view.shown({200.0, 100.0, 240.0, 120.0});
  EXPECT_NEAR(whole.share, 1.0, 1e-12);
  EXPECT_NEAR(whole.box.x1, 200.0, 1e-9);
  EXPECT_NEAR(whole.box.y2, 120.0, 1e-9);
  const auto half = view.shown({width - 41.0, 100.0, width + 39.0, 120.0});
  EXPECT_NEAR(half.share, 0.5, 1e-9);
  EXPECT_EQ(view.shown({width + 1.0, 100.0, width + 39.0, 120.0}).share, 0.0);
  // The lower border bends up towards the middle: the files end above the camera's lowest row.
  const double middle = view.camera().cx;
  EXPECT_FALSE(view.shows({middle, height - 2.0}));
  const auto low = view.shown({middle - 20.0, height - 141.0, middle + 20.0, height - 1.0});
  EXPECT_GT(low.share, 0.0);
  EXPECT_LT(low.share, 0.9);
  EXPECT_LT(low.box.y2, height - 2.0);
}

TEST(ViewCamera, ASceneThroughALensIsReadAsItWasMade) {
  const test::TemporaryFolder folder;
  const SynthOptions options = small_options(LensModel::kBrown);
  synthesise_scene(options, folder.path() / "scene");
  const Scene scene = read_scene(folder.path() / "scene");
  const PinholeCamera expected =
      undistorted_camera({options.lens, options.lens_coefficients, options.camera});
  EXPECT_EQ(scene.camera.width, expected.width);
  EXPECT_EQ(scene.camera.cx, expected.cx);
  EXPECT_EQ(scene.distortion.model, LensModel::kBrown);
  EXPECT_EQ(scene.distortion.coefficients, options.lens_coefficients);
  EXPECT_EQ(scene.distortion.raw.width, 320);
  EXPECT_EQ(scene.distortion.raw.fx, 190.0);
  // Images and segmentations are the lens's, truth is the camera's.
  const Image image = read_color_image(scene.frames[0].image);
  EXPECT_EQ(image.width, 320);
  EXPECT_EQ(read_label_image(scene.frames[0].segmentation, scene.distortion.raw).width, 320);
  EXPECT_EQ(read_label_image(scene.truth->frames[0].label, scene.camera).width, expected.width);
  for (const TruthVehicle& vehicle : scene.truth->frames[0].vehicles) {
    const auto pixel = scene.camera.project(vehicle.pose.center());
    ASSERT_TRUE(pixel.has_value());
    EXPECT_TRUE(vehicle.box.contains(*pixel));
  }
}

TEST(ViewCamera, ALensThatTurnsBackWithinTheImagesIsRefused) {
  SynthOptions options = small_options(LensModel::kBrown);
  options.lens_coefficients = {-0.9, 0.0, 0.0, 0.0};
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options.lens_coefficients = {-0.3, 0.0, 0.0};
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options.lens_coefficients = {-0.1, 0.0, 0.0, 0.0};
  EXPECT_NO_THROW(options.validate());
}

}  // namespace
}  // namespace camber
