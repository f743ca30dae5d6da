#include "camber/synth/synth_world.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/synth/detections.h"
#include "camber/synth/synthesise.h"

namespace camber {
namespace {

SynthOptions small_options(RoadProfileKind kind, std::uint64_t seed) {
  SynthOptions options;
  options.profile = kind;
  options.seed = seed;
  options.camera = {414, 125, 240.5, 240.5, 202.85, 57.3};
  options.num_frames = 3;
  options.num_threads = 2;
  return options;
}

/// Ground, cars and cameras alone, as the full scene has them.
SynthWorld bare_world(const SynthOptions& options) {
  WorldOptions world = world_options(options);
  world.scenery = false;
  return make_synth_world(world);
}

TEST(SynthWorld, CarsStandOnTheSurfaceWithFourWheels) {
  int cars = 0;
  for (const RoadProfileKind kind : all_road_profile_kinds()) {
    const SynthWorld world = bare_world(small_options(kind, 11));
    for (const SynthCar& car : world.cars) {
      for (const SE3& pose : car.world_from_vehicle) {
        for (const int wheel : {0, 1, 18, 19}) {
          Eigen::Vector3d foot = car.model.keypoints[wheel];
          foot.y() = 0.0;
          const Eigen::Vector3d p = pose * foot;
          // Four wheels on an uneven road: what remains is the road's warp, here up to a
          // centimetre; a pad's own warp near its ramps likewise.
          EXPECT_NEAR(world.road.height_at(p.head<2>(), p.x()), p.z(), 0.012)
              << to_string(kind) << " car " << car.track;
        }
        ++cars;
      }
      for (std::size_t f = 0; f < car.world_from_vehicle.size(); ++f) {
        const RoadModel::LocalPlane& local = car.ground_plane[f];
        EXPECT_LT(local.rms, 0.012);
        EXPECT_LT(std::abs(local.plane.signed_distance(car.world_from_vehicle[f].translation())),
                  0.02);
        const Eigen::Vector3d up = car.world_from_vehicle[f].rotation() * Eigen::Vector3d::UnitY();
        EXPECT_LT(angle_between(up, local.plane.normal), 0.012);
      }
    }
  }
  EXPECT_GT(cars, 8 * 3 * 3);  // at least three cars a scene in the mean
}

TEST(SynthWorld, CameraIsAtItsHeightAboveTheEgoPlane) {
  for (const RoadProfileKind kind : all_road_profile_kinds()) {
    SynthOptions options = small_options(kind, 2);
    options.camera_height = 1.9;
    const SynthWorld world = bare_world(options);
    ASSERT_EQ(world.views.size(), 3u);
    for (const SynthView& view : world.views) {
      const Eigen::Vector3d eye = view.world_from_camera.translation();
      EXPECT_NEAR(view.ego_plane.signed_distance(eye), 1.9, 0.012);  // four standard deviations
      // The plane is that of the road below: its foot lies on the surface.
      const Eigen::Vector3d foot = view.ego_plane.foot(eye);
      EXPECT_NEAR(world.road.height_at(foot.head<2>(), 0.0), foot.z(), 0.01);
      // The camera looks along the road, less than two degrees off.
      const Eigen::Vector3d forward = view.world_from_camera.rotation() * Eigen::Vector3d::UnitZ();
      EXPECT_LT(std::abs(forward.dot(view.ego_plane.normal)), 0.035);
      EXPECT_GT(forward.x(), 0.8);
    }
    const double driven = (world.views[2].world_from_camera.translation() -
                           world.views[0].world_from_camera.translation())
                              .norm();
    EXPECT_NEAR(driven, 2 * options.speed / options.frame_rate, 0.05);
  }
}

TEST(SynthWorld, CarsKeepClearOfEachOther) {
  for (const RoadProfileKind kind : all_road_profile_kinds()) {
    SynthOptions options = small_options(kind, 21);
    options.num_cars = 9;
    const SynthWorld world = bare_world(options);
    for (int f = 0; f < options.num_frames; ++f) {
      for (const SynthCar& a : world.cars) {
        for (const SynthCar& b : world.cars) {
          if (a.track == b.track) continue;
          // No corner of one inside the other, seen from above.
          const auto corners = OrientedBox{b.world_from_vehicle[f], b.model.dimensions}.corners();
          for (int i = 0; i < 4; ++i) {
            const Eigen::Vector3d p =
                a.world_from_vehicle[f].inverse() * Eigen::Vector3d(corners.col(i));
            EXPECT_TRUE(std::abs(p.x()) > 0.5 * a.model.dimensions.length ||
                        std::abs(p.z()) > 0.5 * a.model.dimensions.width);
          }
        }
      }
    }
  }
}

TEST(SynthWorld, DepthLiesOnTheTrueSurface) {
  const SynthOptions options = small_options(RoadProfileKind::kSag, 5);
  const SynthWorld world = bare_world(options);
  const ViewTruth truth = trace_view(world, 1, options.camera, 2);
  const SE3& pose = world.views[1].world_from_camera;
  int checked = 0;
  for (int v = 0; v < options.camera.height; ++v) {
    for (int u = 0; u < options.camera.width; ++u) {
      const std::size_t at = static_cast<std::size_t>(v) * options.camera.width + u;
      const double depth = truth.hits[at].distance;
      if (truth.labels[at] != static_cast<std::uint8_t>(TruthLabel::kRoad) || depth > 80.0)
        continue;
      const Eigen::Vector3d p = pose * (depth * options.camera.ray(Eigen::Vector2d(u, v)));
      const double error = p.z() - world.road.height_at(p.head<2>(), p.x());
      // The drawn surface is made of triangles 0.25 to 0.5 m wide on curves of 60 m and
      // unevenness of a few millimetres.
      EXPECT_NEAR(error, 0.0, 0.003) << u << " " << v << " depth " << depth;
      ++checked;
    }
  }
  EXPECT_GT(checked, 5000);
}

TEST(SynthWorld, OutlinesOfCarsMatchTheirBoxes) {
  int checked = 0;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    const SynthOptions options = small_options(RoadProfileKind::kUphill, seed);
    const SynthWorld world = make_synth_world(world_options(options));
    const ViewTruth truth = trace_view(world, 1, options.camera, 2);
    const std::vector<TruthVehicle> vehicles = true_vehicles(world, 1, options.camera, truth);
    for (const TruthVehicle& vehicle : vehicles) {
      EXPECT_GE(vehicle.occlusion, 0.0);
      EXPECT_LE(vehicle.occlusion, 1.0);
      // Keypoints lie inside the box, wheels and all.
      for (const Eigen::Vector3d& keypoint : vehicle.keypoints) {
        const auto pixel = options.camera.project(keypoint);
        ASSERT_TRUE(pixel.has_value());
        EXPECT_TRUE(vehicle.box.grown(1e-6).contains(*pixel));
      }
      if (vehicle.occlusion > 0.0 || vehicle.truncation > 0.0) continue;
      Box2 seen{1e9, 1e9, -1e9, -1e9};
      for (int v = 0; v < options.camera.height; ++v) {
        for (int u = 0; u < options.camera.width; ++u) {
          const WorldHit& hit = truth.hits[static_cast<std::size_t>(v) * options.camera.width + u];
          if (hit.car < 0 || world.cars[hit.car].track != vehicle.id) continue;
          seen = {std::min<double>(seen.x1, u), std::min<double>(seen.y1, v),
                  std::max<double>(seen.x2, u), std::max<double>(seen.y2, v)};
        }
      }
      // Pixel centres just inside the outline: less than one pixel, but for thin tips.
      EXPECT_NEAR(seen.x1, vehicle.box.x1, 1.3);
      EXPECT_NEAR(seen.y1, vehicle.box.y1, 1.3);
      EXPECT_NEAR(seen.x2, vehicle.box.x2, 1.3);
      EXPECT_NEAR(seen.y2, vehicle.box.y2, 1.3);
      ++checked;
    }
  }
  EXPECT_GT(checked, 5);
}

TEST(SynthWorld, SameSeedSameWorldAnyThreads) {
  const SynthOptions options = small_options(RoadProfileKind::kRolling, 9);
  const SynthWorld a = make_synth_world(world_options(options));
  const SynthWorld b = make_synth_world(world_options(options));
  ASSERT_EQ(a.cars.size(), b.cars.size());
  for (std::size_t i = 0; i < a.cars.size(); ++i) {
    EXPECT_EQ(a.cars[i].world_from_vehicle[2].matrix(), b.cars[i].world_from_vehicle[2].matrix());
  }
  const ViewTruth one = trace_view(a, 2, options.camera, 1);
  const ViewTruth two = trace_view(b, 2, options.camera, 2);
  EXPECT_EQ(one.labels, two.labels);
  EXPECT_EQ(one.visible_pixels, two.visible_pixels);
  for (std::size_t i = 0; i < one.hits.size(); ++i) {
    ASSERT_EQ(one.hits[i].distance, two.hits[i].distance);
    ASSERT_EQ(one.hits[i].triangle, two.hits[i].triangle);
  }
  const SynthWorld bare = bare_world(options);
  ASSERT_EQ(a.cars.size(), bare.cars.size());
  EXPECT_EQ(a.cars[0].world_from_vehicle[1].matrix(), bare.cars[0].world_from_vehicle[1].matrix());
  const SynthWorld other =
      make_synth_world(world_options(small_options(RoadProfileKind::kRolling, 10)));
  EXPECT_NE(a.road.point(30.0, 1.0), other.road.point(30.0, 1.0));
}

TEST(Detections, ErrorsAreWhatTheModelSays) {
  DetectorModel model;
  model.miss_share = 0.0;
  model.false_boxes = 0.0;
  int visible = 0, gross = 0;
  double squares = 0.0;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    SynthOptions options = small_options(RoadProfileKind::kUphill, seed);
    options.camera = {1242, 375, 721.5377, 721.5377, 609.5593, 172.854};
    const SynthWorld world = make_synth_world(world_options(options));
    model.seed = seed;
    const ViewTruth truth = trace_view(world, 0, options.camera, 2);
    const std::vector<TruthVehicle> vehicles = true_vehicles(world, 0, options.camera, truth);
    const auto detections = simulate_detections(world, 0, options.camera, vehicles, model);
    for (std::size_t i = 0; i < detections.size(); ++i) {
      const VehicleDetection& detection = detections[i];
      EXPECT_EQ(detection.id, static_cast<int>(i));
      EXPECT_EQ(detection.track, -1);
      const TruthVehicle* match = nullptr;
      for (const TruthVehicle& vehicle : vehicles) {
        if (intersection_over_union(detection.box, vehicle.box.clipped(1242, 375)) > 0.7) {
          match = &vehicle;
        }
      }
      ASSERT_NE(match, nullptr);
      ASSERT_EQ(detection.keypoints.size(), 36u);
      for (int k = 0; k < 36; ++k) {
        if (detection.keypoints[k].confidence < 0.65) continue;
        const Eigen::Vector2d error =
            detection.keypoints[k].pixel - options.camera.project(match->keypoints[k]).value();
        const Eigen::Vector2d crop(error.x() * 64.0 / detection.box.width(),
                                   error.y() * 64.0 / detection.box.height());
        ++visible;
        if (crop.norm() > 6.0) {
          ++gross;
        } else {
          squares += crop.squaredNorm() / 2.0;
        }
      }
    }
  }
  ASSERT_GT(visible, 100);
  // 4 % outliers, some of them with less confidence or near the right place by chance.
  EXPECT_GT(gross, 0);
  EXPECT_LT(static_cast<double>(gross) / visible, 0.07);
  EXPECT_NEAR(std::sqrt(squares / (visible - gross)), 1.05, 0.25);
}

TEST(Detections, SegmentationIsRaggedButRight) {
  const SynthOptions options = small_options(RoadProfileKind::kDownhill, 3);
  const SynthWorld world = make_synth_world(world_options(options));
  const ViewTruth truth = trace_view(world, 0, options.camera, 2);
  const std::vector<std::uint8_t> found =
      simulate_segmentation(truth.labels, options.camera.width, options.camera.height, 3, 0);
  std::size_t road = 0, both = 0, either = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const bool truly = truth.labels[i] == static_cast<std::uint8_t>(TruthLabel::kRoad);
    const bool said = found[i] == static_cast<std::uint8_t>(SegmentationClass::kRoad);
    road += truly;
    both += truly && said;
    either += truly || said;
  }
  EXPECT_GT(road, found.size() / 10);
  const double overlap = static_cast<double>(both) / static_cast<double>(either);
  EXPECT_GT(overlap, 0.88);
  EXPECT_LT(overlap, 0.999);
}

TEST(SynthOptions, ValidateNamesWhatIsWrong) {
  const auto broken = [](auto&& change) {
    SynthOptions options;
    change(options);
    try {
      options.validate();
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("nothing thrown");
  };
  EXPECT_EQ(broken([](SynthOptions&) {}), "nothing thrown");
  const auto names = [&](const char* field, auto&& change) {
    EXPECT_NE(broken(change).find(field), std::string::npos) << broken(change);
  };
  names("num_frames", [](SynthOptions& o) { o.num_frames = 0; });
  names("frame_rate", [](SynthOptions& o) { o.frame_rate = 0.0; });
  names("speed", [](SynthOptions& o) { o.speed = std::nan(""); });
  names("driven length", [](SynthOptions& o) { o.num_frames = 900; });
  names("camera_height", [](SynthOptions& o) { o.camera_height = 0.0; });
  names("num_cars", [](SynthOptions& o) { o.num_cars = -1; });
  names("nearest_car", [](SynthOptions& o) { o.nearest_car = 1.0; });
  names("farthest_car", [](SynthOptions& o) { o.farthest_car = 5.0; });
  names("camera.width", [](SynthOptions& o) { o.camera.width = 8; });
  names("fx", [](SynthOptions& o) { o.camera.fx = -1.0; });
  names("supersampling", [](SynthOptions& o) { o.sensor.supersampling = 0; });
  names("blur", [](SynthOptions& o) { o.sensor.blur = -1.0; });
  names("noise", [](SynthOptions& o) { o.sensor.noise = 1e9; });
  names("exposure_change", [](SynthOptions& o) { o.sensor.exposure_change = -0.1; });
  names("vignetting", [](SynthOptions& o) { o.sensor.vignetting = 2.0; });
  names("keypoint_error", [](SynthOptions& o) { o.detector.keypoint_error = -1.0; });
  names("outlier_share", [](SynthOptions& o) { o.detector.outlier_share = 1.5; });
  names("miss_share", [](SynthOptions& o) { o.detector.miss_share = -0.5; });
  names("false_boxes", [](SynthOptions& o) { o.detector.false_boxes = 2.0; });
  names("cloud_points", [](SynthOptions& o) { o.cloud_points = -1; });
}

}  // namespace
}  // namespace camber
