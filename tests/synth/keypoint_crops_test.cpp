#include "camber/synth/keypoint_crops.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <iterator>
#include <set>

#include "camber/core/errors.h"
#include "camber/detect/keypoint_crop.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/synth/detail/crop_labels.h"
#include "camber/synth/detail/crop_scene.h"
#include "camber/synth/detail/noise.h"
#include "camber/synth/detail/npy_file.h"
#include "support/test_data.h"

namespace camber {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kSide = kNumKeypoints / 2;
using Visibility = KeypointVisibility;

KeypointCropOptions few(std::int64_t count, std::uint64_t seed = 5) {
  KeypointCropOptions options;
  options.seed = seed;
  options.count = count;
  return options;
}

std::vector<SynthCrop> make(const KeypointCropOptions& options) {
  return KeypointCropMaker(options).make(options.first, options.count);
}

/// A few scenes with their cars; the pool of other cars is made once.
class CropScenes : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    pool_ = new CropPool(make_crop_pool(CounterRandom(11), 0));
    for (std::uint64_t i = 0; i < kScenes; ++i) {
      cars_.push_back(
          std::make_unique<CropCarTree>(pool_->device, draw_crop_car(CounterRandom(12), i)));
      Sequence random(13, i);
      scenes_.push_back(draw_crop_scene(*pool_, *cars_.back(), 0.0, &random));
    }
  }
  static void TearDownTestSuite() {
    scenes_.clear();
    cars_.clear();
    delete pool_;
    pool_ = nullptr;
  }

  static constexpr std::uint64_t kScenes = 24;
  static CropPool* pool_;
  static std::vector<std::unique_ptr<CropCarTree>> cars_;
  static std::vector<std::unique_ptr<CropScene>> scenes_;
};
CropPool* CropScenes::pool_ = nullptr;
std::vector<std::unique_ptr<CropCarTree>> CropScenes::cars_;
std::vector<std::unique_ptr<CropScene>> CropScenes::scenes_;

TEST_F(CropScenes, KeypointsAreWhereAPinholeCameraSeesThem) {
  // By the library's camera and poses in double precision, from the car's frame.
  Eigen::Matrix3d world_from_car;
  world_from_car << 1, 0, 0, 0, 0, -1, 0, 1, 0;  // front x, right -y, up z
  for (const auto& scene : scenes_) {
    const CropCamera& c = scene->camera;
    PinholeCamera camera;
    camera.width = c.width, camera.height = c.height;
    camera.fx = camera.fy = c.focal;
    camera.cx = c.cx, camera.cy = c.cy;
    const SE3 world_from_camera(c.world_from_camera.cast<double>(), c.eye.cast<double>());
    SynthCrop crop;
    const KeypointCrop square = keypoint_crop(scene->box, 64);
    label_keypoints(*scene, square, &crop);
    for (int k = 0; k < kNumKeypoints; ++k) {
      const Eigen::Vector3d& in_car = scene->cars[0]->model.keypoints[k];
      const auto pixel = camera.project(world_from_camera.inverse() * (world_from_car * in_car));
      ASSERT_TRUE(pixel.has_value());
      const double side = 1.15 * std::max(scene->box.width(), scene->box.height());
      const Eigen::Vector2d expected =
          ((*pixel - scene->box.center()) / side * 64.0).array() + 31.5;
      EXPECT_LT((crop.keypoints[k] - expected).norm(), 0.01);  // single precision of the pixel
    }
  }
}

/// First meeting of a ray with the triangles of a place, in lengths of the direction, without any
/// tree (Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997).
double first_meeting(const MeshPlace& place, const Eigen::Vector3d& origin,
                     const Eigen::Vector3d& direction) {
  double nearest = 1e9;
  const Eigen::Matrix3d rotation = place.rotation.cast<double>();
  const auto vertex = [&](int i) -> Eigen::Vector3d {
    return rotation * place.mesh->vertices[i].cast<double>() + place.origin.cast<double>();
  };
  for (const Eigen::Vector3i& t : place.mesh->triangles) {
    const Eigen::Vector3d a = vertex(t[0]), e1 = vertex(t[1]) - a, e2 = vertex(t[2]) - a;
    const Eigen::Vector3d p = direction.cross(e2);
    const double determinant = e1.dot(p);
    if (std::abs(determinant) < 1e-12) continue;
    const Eigen::Vector3d s = origin - a, q = s.cross(e1);
    const double u = s.dot(p) / determinant, v = direction.dot(q) / determinant;
    const double at = e2.dot(q) / determinant;
    if (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && at > 1e-4) nearest = std::min(nearest, at);
  }
  return nearest;
}

TEST_F(CropScenes, VisibilityIsThatOfEveryTriangleTriedInTurn) {
  int compared = 0, others = 0, hidden = 0;
  for (std::size_t i = 0; i < 8; ++i) {
    const CropScene& scene = *scenes_[i];
    SynthCrop crop;
    label_keypoints(scene, keypoint_crop(scene.box, 64), &crop);
    const auto points = scene.keypoints();
    for (int k = 0; k < kNumKeypoints; ++k) {
      if (crop.visibility[k] == Visibility::kOutside) continue;
      const Eigen::Vector3d eye = scene.camera.eye.cast<double>();
      const Eigen::Vector3d direction = points[k].cast<double>() - eye;
      const double reach = 1.0 - static_cast<double>(kKeypointTolerance) / direction.norm();
      Visibility expected = Visibility::kVisible;
      for (std::size_t p = 1; p < scene.places.size(); ++p) {
        if (first_meeting(scene.places[p], eye, direction) < reach) {
          expected = Visibility::kHiddenByOther;
        }
      }
      if (first_meeting(scene.places[0], eye, direction) < reach) {
        expected = Visibility::kHiddenByCar;
      }
      ++compared;
      others += crop.visibility[k] != expected;
      hidden += expected == Visibility::kHiddenByOther;
    }
  }
  EXPECT_GT(compared, 150);
  EXPECT_GT(hidden, 3);
  // A ray that grazes an edge may be decided differently in single precision.
  EXPECT_LE(others, compared / 100);
}

TEST_F(CropScenes, KeypointsAreVerticesOfTheMeshThatIsSeen) {
  for (const auto& car : cars_) {
    for (const Eigen::Vector3d& keypoint : car->car.model.keypoints) {
      float nearest = 1e9f;
      for (const Eigen::Vector3f& vertex : car->car.mesh.vertices) {
        nearest = std::min(nearest, (vertex - keypoint.cast<float>()).norm());
      }
      EXPECT_LT(nearest, 1e-5f);
    }
  }
}

TEST_F(CropScenes, AMirroredViewSwapsLeftAndRight) {
  int compared = 0, others = 0;
  for (const auto& scene : scenes_) {
    const CropRays alone(pool_->device, {scene->places[0]});
    const auto points = scene->keypoints();
    Eigen::Vector3f mirrored_eye = scene->camera.eye;
    mirrored_eye.y() = -mirrored_eye.y();
    for (int k = 0; k < kNumKeypoints; ++k) {
      const int m = (k + kSide) % kNumKeypoints;
      const Eigen::Vector3f mirrored(points[k].x(), -points[k].y(), points[k].z());
      EXPECT_LT((points[m] - mirrored).norm(), 1e-5f);
      const auto hidden = [&](const Eigen::Vector3f& eye, int of) {
        const Eigen::Vector3f direction = points[of] - eye;
        return alone.blocked(0, eye, direction, 1.0f - kKeypointTolerance / direction.norm());
      };
      ++compared;
      others += hidden(scene->camera.eye, k) != hidden(mirrored_eye, m);
    }
  }
  // The two sides' strips across the body are cut into triangles differently, and the driver sits
  // on one of them.
  EXPECT_LE(others, compared / 50);
}

TEST_F(CropScenes, VisibleKeypointsLieOnTheRenderedCar) {
  int visible = 0, on_car = 0;
  for (const auto& scene : scenes_) {
    const KeypointCrop square = keypoint_crop(scene->box, 64);
    SynthCrop crop;
    label_keypoints(*scene, square, &crop);
    for (int k = 0; k < kNumKeypoints; ++k) {
      if (crop.visibility[k] != Visibility::kVisible) continue;
      ++visible;
      // The pixels of the crop around it, as the renderer casts them: one shows the car.
      bool met = false;
      for (int dy = -1; dy <= 1; ++dy) {
        for (int dx = -1; dx <= 1; ++dx) {
          const Eigen::Vector2d pixel = crop.keypoints[k] + Eigen::Vector2d(dx, dy);
          const Eigen::Vector3f ray =
              scene->camera.ray(square.to_image(pixel.array().round()).cast<float>());
          CropRays::Hit hit;
          scene->rays->nearest(&scene->camera.eye, false, &ray, 1, &hit);
          met = met || hit.place == 0;
        }
      }
      on_car += met;
    }
  }
  EXPECT_GT(visible, 200);
  EXPECT_GE(on_car, visible - visible / 50);
}

/// A car's body as it is seen from behind, its lamps neither lit nor with amber or white parts.
class CropCarTail : public ::testing::Test {
 protected:
  void SetUp() override {
    look_.dirt = 0.0f;
    look_.paint = look_.trim = Color::Constant(0.3f);
    look_.brakes = look_.indicator = look_.clear_tails = look_.rear_blind = look_.chrome = false;
    look_.two_tone = look_.rear_plate = false;
    while (hash_unit(1, 8, look_.seed) < 0.4f || hash_unit(2, 8, look_.seed) < 0.5f) ++look_.seed;
    parts_.tail_round = parts_.tail_pillar = 0.0f;
    parts_.third_lamp = parts_.reflector = parts_.wiper = 0.0f;
    parts_.tail_low = 0.5f;
    parts_.tail_inner = 0.7f;
    parts_.bumper_high = 0.4f;
  }

  Color color(const Eigen::Vector3f& place) const {
    return crop_car_surface(at_, look_, static_cast<std::uint8_t>(CropCarMaterial::kBody), place,
                            Eigen::Vector3f(-1.0f, 0.0f, 0.0f), 0.001f)
        .albedo;
  }
  bool is_red(const Eigen::Vector3f& place) const {
    const Color c = color(place);
    return c[0] > 0.2f && c[0] > 10.0f * c[1];
  }
  /// Of the lid and bumper, by shares of its height and of the half width.
  Eigen::Vector3f tail(float up, float out) const {
    Eigen::Vector3f place = at_.rear_bumper + up * (at_.boot - at_.rear_bumper);
    place.z() = out * at_.half_width;
    return place;
  }
  /// Of the rear window, by the share of its height, at its edge or in its middle.
  Eigen::Vector3f window(float up, bool edge) const {
    Eigen::Vector3f place = at_.rear_window + up * (at_.roof_rear - at_.rear_window);
    place.z() = edge ? place.z() - 0.05f : 0.0f;
    return place;
  }

  CropCar car_ = draw_crop_car(CounterRandom(12), 0);
  CropCarLook& look_ = car_.look;
  CropCarParts& parts_ = look_.parts;
  const CropCarPlaces& at_ = car_.places;
};

TEST_F(CropCarTail, LightsAreBelowTheWindowOrBesideIt) {
  EXPECT_TRUE(is_red(tail(0.7f, 0.9f)));
  EXPECT_FALSE(is_red(window(0.4f, true)));
  parts_.tail_pillar = 0.10f;
  parts_.pillar_lamp_low = 0.2f;
  parts_.pillar_lamp_high = 0.8f;
  EXPECT_TRUE(is_red(tail(0.7f, 0.9f)));
  EXPECT_TRUE(is_red(window(0.4f, true)));
  EXPECT_FALSE(is_red(window(0.9f, true)));
  EXPECT_FALSE(is_red(window(0.1f, true)));
  parts_.tail_low = 1.03f;
  EXPECT_FALSE(is_red(tail(0.7f, 0.9f)));
  EXPECT_TRUE(is_red(window(0.4f, true)));
}

TEST_F(CropCarTail, RoundLightsAreTwoAboveEachOther) {
  parts_.tail_round = 0.06f;
  const auto at = [&](float below_top) {
    return Eigen::Vector3f(at_.boot.x(), at_.boot.y() - below_top, at_.half_width - 0.084f);
  };
  EXPECT_TRUE(is_red(at(0.072f)));
  EXPECT_FALSE(is_red(at(0.138f)));  // between them
  EXPECT_TRUE(is_red(at(0.204f)));
  EXPECT_FALSE(is_red(at(0.28f)));
}

TEST_F(CropCarTail, ThirdLightReflectorsAndWiperAreWhereTheyAreAskedFor) {
  const Eigen::Vector3f third =
      at_.roof_rear.cwiseProduct(Eigen::Vector3f(1, 1, 0)) - Eigen::Vector3f(0.0f, 0.05f, 0.0f);
  const Eigen::Vector3f reflector = tail(0.6f * parts_.bumper_high, 0.7f);
  const float span = at_.roof_rear.y() - at_.rear_window.y();
  Eigen::Vector3f wiper = window(parts_.rear_window_low + (0.02f + 0.25f * 0.1f) / span, false);
  wiper.z() = hash_unit(4, 4, look_.seed) < 0.5f ? 0.1f : -0.1f;
  EXPECT_FALSE(is_red(third));
  EXPECT_FALSE(is_red(reflector));
  const float glass = color(wiper)[0];
  parts_.third_lamp = 0.15f;
  parts_.reflector = 0.02f;
  parts_.wiper = 0.4f;
  EXPECT_TRUE(is_red(third));
  EXPECT_TRUE(is_red(reflector));
  EXPECT_FALSE(is_red(tail(0.6f * parts_.bumper_high, 0.4f)));
  EXPECT_NE(color(wiper)[0], glass);
  EXPECT_NEAR(color(wiper)[0], 0.01f, 1e-6f);
}

TEST_F(CropCarTail, ClearLightsHaveRedStrips) {
  look_.clear_tails = true;
  int red = 0, clear = 0;
  for (float up = 0.55f; up < 0.95f; up += 0.005f) {
    const bool is = is_red(tail(up, 0.9f));
    red += is;
    clear += !is;
  }
  EXPECT_GT(red, 15);
  EXPECT_GT(clear, 25);
}

TEST(CropCars, BumpersOfTheirOwnColourAreAtBothEnds) {
  CropCar car = draw_crop_car(CounterRandom(12), 1);
  CropCarLook& look = car.look;
  look.dirt = 0.0f;
  look.rear_plate = look.front_plate = look.chrome = false;
  look.parts.intake_width = look.parts.reflector = 0.0f;
  look.parts.bumper_high = 0.5f;
  look.paint = Color(0.5f, 0.02f, 0.02f);
  look.bumper = Color::Constant(0.4f);
  for (const bool two_tone : {true, false}) {
    look.two_tone = two_tone;
    look.painted_bumpers = true;
    for (const float end : {-1.0f, 1.0f}) {
      const CropCarPlaces& at = car.places;
      const Eigen::Vector3f &low = end > 0.0f ? at.front_bumper : at.rear_bumper,
                            &high = end > 0.0f ? at.headlight : at.boot;
      Eigen::Vector3f place = low + 0.2f * (high - low);
      place.z() = 0.55f * at.half_width;
      const Color found =
          crop_car_surface(at, look, static_cast<std::uint8_t>(CropCarMaterial::kBody), place,
                           Eigen::Vector3f(end, 0.0f, 0.0f), 0.001f)
              .albedo;
      EXPECT_NEAR(found[1], two_tone ? 0.4f : 0.02f, 1e-3f) << end;
    }
  }
}

TEST(CropCars, TailsVary) {
  int columns = 0, high_alone = 0, round = 0, third = 0, wipers = 0;
  constexpr int kCars = 150;
  for (std::uint64_t i = 0; i < kCars; ++i) {
    const CropCarParts p = draw_crop_car(CounterRandom(12), i).look.parts;
    columns += p.tail_pillar > 0.0f;
    high_alone += p.tail_pillar > 0.0f && p.tail_low > 1.0f;
    round += p.tail_round > 0.0f;
    third += p.third_lamp > 0.0f;
    wipers += p.wiper > 0.0f;
  }
  EXPECT_THAT(columns, ::testing::AllOf(::testing::Ge(kCars / 5), ::testing::Le(kCars / 2)));
  EXPECT_GT(high_alone, 0);
  EXPECT_GT(round, kCars / 30);
  EXPECT_THAT(third, ::testing::AllOf(::testing::Ge(kCars / 2), ::testing::Le(9 * kCars / 10)));
  EXPECT_GT(wipers, kCars / 4);
}

TEST(KeypointCrops, LeftRightFrontAndRearAreWhereTheHeadingPutsThem) {
  int seen[4] = {};
  for (const SynthCrop& crop : make(few(100))) {
    const auto u = [&](int k) { return crop.keypoints[k].x(); };
    const double degrees = crop.azimuth * 180.0 / kPi;
    const auto near = [&](double heading) {
      return std::abs(std::remainder(degrees - heading, 360.0)) < 25.0;
    };
    if (near(0.0)) {  // from the right: the front is on the right
      ++seen[0];
      EXPECT_GT(u(35), u(28));
      EXPECT_GT(u(19), u(18));
    } else if (near(90.0)) {  // from behind: the left side is on the left
      ++seen[1];
      EXPECT_LT(u(11), u(29));
      EXPECT_LT(u(13), u(31));
    } else if (near(180.0)) {
      ++seen[2];
      EXPECT_LT(u(17), u(10));
      EXPECT_LT(u(1), u(0));
    } else if (near(270.0)) {
      ++seen[3];
      EXPECT_GT(u(16), u(34));
      EXPECT_GT(u(14), u(32));
    }
    EXPECT_GE(crop.elevation, -3.01 * kPi / 180.0);
    EXPECT_LE(crop.elevation, 25.01 * kPi / 180.0);
    EXPECT_GE(crop.distance, 4.0 - 1e-5);
    EXPECT_LE(crop.distance, 60.0 + 1e-4);
  }
  for (const int count : seen) EXPECT_GT(count, 2);
}

TEST(KeypointCrops, TheBoxIsInTheMiddleOfTheCrop) {
  for (const SynthCrop& crop : make(few(24))) {
    EXPECT_NEAR(crop.box.center().x(), 31.5, 1e-9);
    EXPECT_NEAR(crop.box.center().y(), 31.5, 1e-9);
    EXPECT_NEAR(std::max(crop.box.width(), crop.box.height()), 64.0 / 1.15, 1e-9);
    // The whole car's box holds all keypoints (in front of the camera they all are).
    for (const Eigen::Vector2d& p : crop.keypoints) {
      EXPECT_TRUE(crop.true_box.grown(1e-3).contains(p)) << p.transpose();
    }
    ASSERT_EQ(crop.image.data.size(), 64u * 64u * 3u);
    const std::set<std::uint8_t> values(crop.image.data.begin(), crop.image.data.end());
    EXPECT_GT(values.size(), 20u);
  }
}

TEST(KeypointCrops, AreTheSameForAnyNumberOfThreadsAndInPieces) {
  KeypointCropOptions options = few(21);
  options.num_threads = 1;
  const auto one = make(options);
  options.num_threads = 3;
  const auto three = make(options);
  options.first = 6;  // in the middle of a car
  options.count = 9;
  const auto piece = make(options);
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].image.data, three[i].image.data);
    EXPECT_EQ(one[i].keypoints, three[i].keypoints);
    EXPECT_EQ(one[i].visibility, three[i].visibility);
  }
  for (std::size_t i = 0; i < piece.size(); ++i) {
    EXPECT_EQ(piece[i].image.data, one[i + 6].image.data);
    EXPECT_EQ(piece[i].keypoints, one[i + 6].keypoints);
    EXPECT_EQ(piece[i].car, one[i + 6].car);
  }
  const auto other = make(few(2, 6));
  EXPECT_NE(other[0].image.data, one[0].image.data);
  EXPECT_NE(one[0].image.data, one[1].image.data);
}

TEST(KeypointCrops, SplitsShareNoCar) {
  KeypointCropOptions options = few(12);
  options.split = CropSplit::kTraining;
  const auto training = make(options);
  options.split = CropSplit::kValidation;
  const auto validation = make(options);
  std::set<int> cars, others;
  for (std::size_t i = 0; i < training.size(); ++i) {
    cars.insert(training[i].car);
    others.insert(validation[i].car);
    EXPECT_EQ(training[i].car % 2, 0);
    EXPECT_EQ(validation[i].car % 2, 1);
    // The same seed and number: another picture.
    EXPECT_NE(training[i].image.data, validation[i].image.data);
    EXPECT_NE(training[i].azimuth, validation[i].azimuth);
  }
  EXPECT_EQ(cars.size(), 3u);
  EXPECT_EQ(others.size(), 3u);
}

TEST(KeypointCrops, AShareOfViewsFromBehindAndAheadIsDrawnOnRequest) {
  constexpr int kCrops = 60;
  KeypointCropOptions options = few(kCrops);
  options.size = 16;
  options.end_on = 1.0;
  int from_behind = 0;
  for (const SynthCrop& crop : make(options)) {
    const double off_axis = std::abs(std::remainder(crop.azimuth - kPi / 2.0, kPi));
    EXPECT_LT(off_axis, 40.0 * kPi / 180.0);  // 5 sigma
    from_behind += crop.azimuth < kPi;
  }
  EXPECT_THAT(from_behind, ::testing::AllOf(::testing::Ge(kCrops / 3), ::testing::Lt(kCrops)));
}

TEST(KeypointCrops, OptionsOutOfRangeAreNamed) {
  const auto message = [](const KeypointCropOptions& options) -> std::string {
    try {
      options.validate();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  KeypointCropOptions options;
  EXPECT_EQ(message(options), "");
  options.count = 0;
  EXPECT_THAT(message(options), ::testing::StartsWith("count: 0"));
  options = {};
  options.first = -1;
  EXPECT_THAT(message(options), ::testing::StartsWith("first: -1"));
  options = {};
  options.size = 15;
  EXPECT_THAT(message(options), ::testing::StartsWith("size: 15"));
  options = {};
  options.end_on = 1.5;
  EXPECT_THAT(message(options), ::testing::StartsWith("end_on: 1.5"));
}

TEST(NpyFile, HeaderAndValuesAreNumPys) {
  const test::TemporaryFolder folder;
  const auto path = folder.path() / "a.npy";
  const float values[6] = {1.0f, 2.0f, 3.0f, 4.0f, 5.0f, 6.0f};
  NpyFile file(path, "a.npy", "<f4", {3, 2});
  file.write(values, 8);
  file.write(values + 2, 16);
  EXPECT_THROW(file.write(values, 4), std::invalid_argument);
  file.close();
  std::ifstream in(path, std::ios::binary);
  const std::string bytes((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  ASSERT_EQ(bytes.size(), 128u + 24u);
  EXPECT_EQ(bytes.substr(0, 10), std::string("\x93NUMPY\x01\x00\x76\x00", 10));
  EXPECT_THAT(bytes.substr(10, 118),
              ::testing::StartsWith("{'descr': '<f4', 'fortran_order': False, 'shape': (3, 2), }"));
  EXPECT_EQ(bytes[127], '\n');
  EXPECT_EQ(bytes.substr(128), std::string(reinterpret_cast<const char*>(values), 24));

  NpyFile row(folder.path() / "b.npy", "b.npy", "|u1", {5});
  EXPECT_THROW(row.close(), OutputError);  // not complete
  EXPECT_THROW(NpyFile(folder.path() / "none" / "c.npy", "c.npy", "|u1", {5}), OutputError);
}

}  // namespace
}  // namespace camber
