// What a drive may have beyond a road with cars: each is in the world as it was asked for.

#include "camber/synth/scene_features.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "camber/synth/detections.h"
#include "camber/synth/synthesise.h"

namespace camber {
namespace {

constexpr double kDegree = 3.14159265358979323846 / 180.0;

SynthOptions small_options(std::uint64_t seed) {
  SynthOptions options;
  options.profile = RoadProfileKind::kControl;
  options.seed = seed;
  options.camera = {320, 160, 200.0, 200.0, 159.5, 70.0};
  options.num_frames = 3;
  options.num_threads = 2;
  options.sensor.supersampling = 2;
  return options;
}

SynthWorld bare_world(const SynthOptions& options) {
  WorldOptions world = world_options(options);
  world.scenery = false;
  return make_synth_world(world);
}

/// Height of the drawn ground below a place, by a ray from above.
double drawn_height(const SynthWorld& world, const Eigen::Vector2d& place) {
  const Eigen::Vector3d above(place.x(), place.y(), 60.0);
  const WorldHit hit = cast_ray(world, 0, above, -Eigen::Vector3d::UnitZ());
  return hit.triangle < 0 ? std::nan("") : 60.0 - hit.distance;
}

TruthLabel label_below(const SynthWorld& world, const Eigen::Vector2d& place) {
  const WorldHit hit = cast_ray(world, 0, {place.x(), place.y(), 60.0}, -Eigen::Vector3d::UnitZ());
  if (hit.triangle < 0 || hit.car >= 0) return TruthLabel::kSky;
  const SynthMesh& mesh = world.ground_and_things;
  return mesh.objects[mesh.triangles[hit.triangle].object].label;
}

TEST(Corner, YawRateRadiusAndSpeedAreAsAsked) {
  std::uint64_t seed = 0;
  for (const CornerKind kind : all_corner_kinds()) {
    for (const TurnDirection turn : {TurnDirection::kLeft, TurnDirection::kRight}) {
      SynthOptions options = small_options(++seed);
      const double radius = seed % 2 == 0 ? 14.0 : 6.0;
      options.num_frames = 5;
      options.num_cars = 0;
      options.features.mounting.ahead_of_axle = 1.5;
      CornerOptions& corner = options.features.corner;
      corner.enabled = true;
      corner.kind = kind;
      corner.turn = turn;
      corner.radius = radius;
      corner.yaw_rate = 30.0 * kDegree;
      const SynthWorld world = bare_world(options);
      EXPECT_NEAR(world.speed, radius * 30.0 * kDegree, 1e-12);
      const double sign = turn == TurnDirection::kLeft ? 1.0 : -1.0;
      for (int f = 0; f + 1 < 5; ++f) {
        const SE3 &a = world.views[f].world_from_camera, &b = world.views[f + 1].world_from_camera;
        const auto heading = [](const SE3& pose) {
          const Eigen::Vector3d z = pose.rotation() * Eigen::Vector3d::UnitZ();
          return std::atan2(z.y(), z.x());
        };
        // Springs and grades move it by a tenth of a degree; a slope changes an angle in plan by
        // one part in a hundred.
        EXPECT_NEAR(heading(b) - heading(a), sign * 3.0 * kDegree, 0.3 * kDegree);
        // The camera is 1.5 m before the axle: on a wider circle.
        EXPECT_NEAR((b.translation() - a.translation()).norm(),
                    std::hypot(radius, 1.5) * 3.0 * kDegree, 0.02);
      }
    }
  }
}

TEST(Corner, CameraStaysOnTheCarriagewayAndAtItsHeight) {
  std::uint64_t seed = 100;
  for (const CornerKind kind : all_corner_kinds()) {
    for (const TurnDirection turn : {TurnDirection::kLeft, TurnDirection::kRight}) {
      SynthOptions options = small_options(++seed);
      options.num_frames = 40;  // the whole turn and the streets before and after
      options.num_cars = 0;
      options.camera_height = 1.4;
      options.features.mounting.ahead_of_axle = 1.0;
      CornerOptions& corner = options.features.corner;
      corner.enabled = true;
      corner.kind = kind;
      corner.turn = turn;
      corner.radius = turn == TurnDirection::kLeft ? 12.0 : 8.0;
      corner.yaw_rate = 35.0 * kDegree;
      corner.arm_grade = 0.08;
      const SynthWorld world = bare_world(options);
      double least = 1e9;
      for (const SynthView& view : world.views) {
        const Eigen::Vector3d eye = view.world_from_camera.translation();
        const Eigen::Vector2d st = world.road.profile().locate(eye.head<2>(), eye.x());
        least = std::min(least, -world.road.edge_distance(st.x(), st.y()));
        EXPECT_NEAR(view.ego_plane.signed_distance(eye), 1.4, 0.015);
        const Eigen::Vector3d foot = view.ego_plane.foot(eye);
        // Two metres of a road that bends by 8 % over some ten.
        EXPECT_NEAR(drawn_height(world, foot.head<2>()), foot.z(), 0.015) << to_string(kind);
      }
      EXPECT_GT(least, 0.9) << to_string(kind)
                            << (turn == TurnDirection::kLeft ? " left" : " right");
      const auto direction = [&](int f) -> Eigen::Vector3d {
        return world.views[f].world_from_camera.rotation() * Eigen::Vector3d::UnitZ();
      };
      const Eigen::Vector3d first = direction(0), last = direction(39);
      const double turned = std::atan2(first.x() * last.y() - first.y() * last.x(),
                                       first.head<2>().dot(last.head<2>()));
      EXPECT_NEAR(turned, (turn == TurnDirection::kLeft ? 1.0 : -1.0) * 1.5708, 0.03);
    }
  }
}

TEST(Corner, KerbAndPavementLieStraightAhead) {
  for (const TurnDirection turn : {TurnDirection::kLeft, TurnDirection::kRight}) {
    SynthOptions options = small_options(7);
    options.num_cars = 0;
    options.camera = {640, 320, 320.0, 320.0, 319.5, 120.0};
    CornerOptions& corner = options.features.corner;
    corner.enabled = true;
    corner.turn = turn;
    corner.radius = 8.0;
    corner.phase = 0.3;
    options.features.mounting.pitch = 0.0;
    options.features.mounting.yaw = 0.0;
    const SynthWorld world = bare_world(options);
    const ViewTruth truth = trace_view(world, 1, options.camera, 2);
    // Up the middle column from the lowest row: road, then kerb and pavement nearer than 20 m.
    bool road = false, pavement = false;
    for (int v = 319; v > 125; --v) {
      const std::size_t at = static_cast<std::size_t>(v) * 640 + 320;
      const auto label = static_cast<TruthLabel>(truth.labels[at]);
      if (label == TruthLabel::kRoad) road = true;
      if (road && label == TruthLabel::kPavement && truth.hits[at].distance < 20.0) pavement = true;
    }
    EXPECT_TRUE(road);
    EXPECT_TRUE(pavement);
  }
}

TEST(Corner, DrawnKerbsAreAsHighAsAsked) {
  for (const double height : {0.05, 0.20}) {
    SynthOptions options = small_options(9);
    options.num_cars = 0;
    options.features.corner.enabled = true;
    options.features.corner.kind = CornerKind::kCrossing;
    options.features.roadside.kerb_height = height;
    const SynthWorld world = bare_world(options);
    const RoadModel& road = world.road;
    const Junction& j = *road.layout().junction;
    // Across the kerbs of the four corners, along their diagonals, and of the road's sides.
    int found = 0;
    for (const double side : {1.0, -1.0}) {
      for (const double ahead : {1.0, -1.0}) {
        for (double r = 0.0; r < 30.0; r += 0.01) {
          const double s = j.station + ahead * (0.2 + r), t = side * (0.2 + r);
          const double next = r + 0.01;
          const double s1 = j.station + ahead * (0.2 + next), t1 = side * (0.2 + next);
          if (road.edge_distance(s, t) < 0.0 && road.edge_distance(s1, t1) >= 0.0) {
            const double d = 0.02;
            const Eigen::Vector2d in(s - ahead * d, t - side * d),
                out(s1 + ahead * d, t1 + side * d);
            // Slopes of up to 15 % over the 5 cm between the two.
            EXPECT_NEAR(drawn_height(world, out) - drawn_height(world, in), height, 0.012);
            ++found;
          }
        }
      }
    }
    EXPECT_EQ(found, 4);
  }
}

TEST(Roadside, KerbBesideTheCameraIsAsHighAndAsNearAsAsked) {
  for (const double height : {0.04, 0.12, 0.20}) {
    for (const double distance : {0.9, 1.7}) {
      SynthOptions options = small_options(11);
      options.num_cars = 0;
      options.features.roadside.pavements = Pavements::kRight;
      options.features.roadside.kerb_height = height;
      options.features.roadside.edge_distance = distance;
      const SynthWorld world = bare_world(options);
      const Eigen::Vector3d eye = world.views[0].world_from_camera.translation();
      // The road begins along +x: the right is -y. Step across in centimetres until it rises.
      double edge = std::nan("");
      for (double x = 0.3; x < 3.0; x += 0.01) {
        const double here = drawn_height(world, {eye.x() + 2.0, eye.y() - x});
        const double next = drawn_height(world, {eye.x() + 2.0, eye.y() - x - 0.01});
        if (next - here > 0.5 * height) {
          edge = x;
          EXPECT_NEAR(next - here, height, 0.004);
          break;
        }
      }
      EXPECT_NEAR(edge, distance, 0.03);
      EXPECT_EQ(label_below(world, {eye.x() + 2.0, eye.y() - distance - 0.6}),
                TruthLabel::kPavement);
    }
  }
}

TEST(Roadside, VergesRiseAsAsked) {
  for (const double rise : {-0.05, 0.15}) {
    SynthOptions options = small_options(12);
    options.num_cars = 0;
    options.features.roadside.pavements = Pavements::kNone;
    options.features.roadside.verge_rise = rise;
    options.features.roadside.verge_rise_width = 0.3;
    const SynthWorld world = bare_world(options);
    const double half = world.road.layout().half_width;
    double sum = 0.0;
    int count = 0;
    for (double s = 2.0; s < 40.0; s += 0.5) {
      bool pad = false;
      for (const auto& p : world.road.layout().pads) pad |= s > p.begin - 2.0 && s < p.end + 2.0;
      if (pad) continue;
      for (const double side : {1.0, -1.0}) {
        sum += drawn_height(world, world.road.place(s, side * (half + 0.32))) -
               drawn_height(world, world.road.place(s, side * (half - 0.02)));
        ++count;
        EXPECT_EQ(label_below(world, world.road.place(s, side * (half + 0.32))),
                  TruthLabel::kTerrain);
      }
    }
    ASSERT_GT(count, 40);
    // The slope of the crown and the verge's own unevenness of 4 cm.
    EXPECT_NEAR(sum / count, rise, 0.015);
  }
}

TEST(Bend, RoadTurnsWithItsRadius) {
  for (const TurnDirection turn : {TurnDirection::kLeft, TurnDirection::kRight}) {
    SynthOptions options = small_options(13);
    options.num_cars = 0;
    options.features.bend = {50.0, turn};
    const SynthWorld world = bare_world(options);
    const double sign = turn == TurnDirection::kLeft ? 1.0 : -1.0;
    EXPECT_NEAR(world.road.profile().curvature(5.0), sign / 50.0, 1e-12);
    EXPECT_NEAR(world.road.profile().heading(30.0) - world.road.profile().heading(0.0),
                sign * 30.0 / 50.0, 1e-6);
    // The ground has no hole or fold on the inner side. Far from the road the mesh is too coarse
    // for its hummocks of 7 m; a fold would be off by a metre.
    for (double s = 1.0; s < 50.0; s += 1.7) {
      for (double t = -30.0; t <= 30.0; t += 1.9) {
        const Eigen::Vector2d place = world.road.place(s, t);
        EXPECT_NEAR(drawn_height(world, place), world.road.height(s, t),
                    std::abs(t) < 12.0 ? 0.06 : 0.2)
            << s << " " << t;
      }
    }
  }
}

TEST(LeadCar, KeepsItsDistanceOnRoadsBendsAndCorners) {
  for (int kind = 0; kind < 3; ++kind) {
    SynthOptions options = small_options(20 + kind);
    options.num_frames = 6;
    options.num_cars = 4;
    options.features.mounting.ahead_of_axle = 1.5;
    options.features.lead_car = {true, 8.0};
    if (kind == 1) options.features.bend = {60.0, TurnDirection::kLeft};
    if (kind == 2) {
      options.features.corner.enabled = true;
      options.features.corner.kind = CornerKind::kCrossing;
    }
    const SynthWorld world = bare_world(options);
    ASSERT_GE(world.cars.size(), 1u);
    const SynthCar& lead = world.cars.front();
    EXPECT_TRUE(lead.moving);
    for (int f = 0; f < 6; ++f) {
      const Eigen::Vector3d rear = lead.world_from_vehicle[f] *
                                   Eigen::Vector3d(-0.5 * lead.model.dimensions.length, 0.0, 0.0);
      // On the ground, in space; round a corner of 9 m the chord is shorter.
      const Eigen::Vector3d foot =
          world.views[f].ego_plane.foot(world.views[f].world_from_camera.translation());
      const double apart = (rear - foot).norm();
      EXPECT_NEAR(apart, 8.0, kind == 2 ? 1.0 : 0.15) << "kind " << kind << " frame " << f;
    }
  }
}

TEST(LeadCar, ItsShadowMovesAlong) {
  SynthOptions options = small_options(31);
  options.num_cars = 0;
  options.num_frames = 2;
  options.features.lead_car = {true, 6.0};
  options.features.weather.cloudiness = 0.0;
  options.features.weather.sun_elevation = 0.8;
  options.sensor.noise = 0.0;
  options.sensor.exposure_change = 0.0;
  const SynthWorld with = bare_world(options);
  options.features.lead_car.enabled = false;
  const SynthWorld without = bare_world(options);
  // Ground that is darker with the car than without, in world coordinates.
  Eigen::Vector2d middle[2];
  for (int f = 0; f < 2; ++f) {
    const auto a = render_view(with, f, options.camera, options.sensor, 2);
    const auto b = render_view(without, f, options.camera, options.sensor, 2);
    const ViewTruth truth = trace_view(with, f, options.camera, 2);
    middle[f].setZero();
    int count = 0;
    for (int v = 0; v < options.camera.height; ++v) {
      for (int u = 0; u < options.camera.width; ++u) {
        const std::size_t at = static_cast<std::size_t>(v) * options.camera.width + u;
        if (truth.labels[at] != static_cast<std::uint8_t>(TruthLabel::kRoad)) continue;
        if (truth.hits[at].distance > 25.0 || b[3 * at + 1] - a[3 * at + 1] < 15) continue;
        const Eigen::Vector3d p =
            with.views[f].world_from_camera *
            (truth.hits[at].distance * options.camera.ray(Eigen::Vector2d(u, v)));
        middle[f] += p.head<2>();
        ++count;
      }
    }
    ASSERT_GT(count, 100);
    middle[f] /= count;
  }
  const double driven = (with.views[1].world_from_camera.translation() -
                         with.views[0].world_from_camera.translation())
                            .norm();
  EXPECT_NEAR((middle[1] - middle[0]).norm(), driven, 0.1 * driven);
}

TEST(Traffic, AllWheelsTouchTheGroundOnBendsAndAtCorners) {
  int wheels = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    SynthOptions options = small_options(40 + seed);
    options.num_cars = 6;
    options.features.lead_car = {true, 7.0};
    if (seed % 2 == 0) {
      options.features.corner.enabled = true;
      options.features.corner.kind = all_corner_kinds()[seed / 2 % 4];
      options.features.corner.turn = seed % 4 == 0 ? TurnDirection::kLeft : TurnDirection::kRight;
      options.features.corner.arm_grade = 0.07;
    } else {
      options.features.bend = {45.0, TurnDirection::kRight};
    }
    const SynthWorld world = bare_world(options);
    for (const SynthCar& car : world.cars) {
      for (std::size_t f = 0; f < car.world_from_vehicle.size(); ++f) {
        for (const int wheel : {0, 1, 18, 19}) {
          Eigen::Vector3d foot = car.model.keypoints[wheel];
          foot.y() = 0.0;
          const Eigen::Vector3d p = car.world_from_vehicle[f] * foot;
          // Four wheels on an uneven surface: its warp, up to two centimetres where an arm takes on
          // its grade.
          EXPECT_NEAR(world.road.height_at(p.head<2>(), p.x()), p.z(), 0.02)
              << "seed " << seed << " car " << car.track;
          ++wheels;
        }
        EXPECT_LT(std::abs(car.ground_plane[f].plane.signed_distance(
                      car.world_from_vehicle[f].translation())),
                  0.03);
      }
    }
  }
  EXPECT_GT(wheels, 10 * 3 * 4 * 3);
}

TEST(Traffic, CarsAtACornerKeepClearOfEachOtherAndOfTheCamera) {
  int pairs = 0;
  for (std::uint64_t seed = 0; seed < 4; ++seed) {
    SynthOptions options = small_options(60 + seed);
    options.num_cars = 8;
    options.features.lead_car = {seed % 2 == 0, 7.0};
    options.features.corner.enabled = true;
    options.features.corner.kind = all_corner_kinds()[seed % 4];
    const SynthWorld world = bare_world(options);
    for (int f = 0; f < options.num_frames; ++f) {
      for (const SynthCar& a : world.cars) {
        const Eigen::Vector3d eye =
            a.world_from_vehicle[f].inverse() * world.views[f].world_from_camera.translation();
        EXPECT_TRUE(std::abs(eye.x()) > 0.5 * a.model.dimensions.length ||
                    std::abs(eye.z()) > 0.5 * a.model.dimensions.width);
        for (const SynthCar& b : world.cars) {
          if (a.track == b.track) continue;
          ++pairs;
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
  EXPECT_GT(pairs, 100);
}

TEST(Mounting, AnglesAreAsAsked) {
  SynthOptions options = small_options(80);
  options.features.mounting.pitch = -5.0 * kDegree;
  options.features.mounting.yaw = 2.0 * kDegree;
  options.features.mounting.roll = 4.0 * kDegree;
  const SynthWorld world = bare_world(options);
  for (const SynthView& view : world.views) {
    const Eigen::Vector3d up =
        view.world_from_camera.rotation().conjugate() * view.ego_plane.normal;
    // Springs: 0.1 and 0.06 degrees, four standard deviations.
    EXPECT_NEAR(std::atan2(up.z(), -up.y()), -5.0 * kDegree, 0.4 * kDegree);  // looks down
    EXPECT_NEAR(std::asin(-up.x()), 4.0 * kDegree, 0.4 * kDegree);  // its right side is low
    const Eigen::Vector3d ahead = view.world_from_camera.rotation() * Eigen::Vector3d::UnitZ();
    EXPECT_NEAR(std::atan2(ahead.y(), ahead.x()), -2.0 * kDegree, 0.5 * kDegree);
  }
}

TEST(Markings, NoneMeansNoneInTheManifest) {
  SynthOptions options = small_options(81);
  options.features.markings = Markings::kNone;
  const SynthWorld none = bare_world(options);
  EXPECT_FALSE(none.markings.center_line);
  EXPECT_FALSE(none.markings.edge_lines);
  options.features.markings = Markings::kAll;
  const SynthWorld all = bare_world(options);
  EXPECT_TRUE(all.markings.center_line && all.markings.edge_lines);
  // Paint is the brightest thing on the road.
  options.sensor.noise = 0.0;
  const auto brightest = [&](const SynthWorld& world) {
    const auto image = render_view(world, 0, options.camera, options.sensor, 2);
    const ViewTruth truth = trace_view(world, 0, options.camera, 2);
    int most = 0;
    for (std::size_t i = 0; i < truth.labels.size(); ++i) {
      if (truth.labels[i] == static_cast<std::uint8_t>(TruthLabel::kRoad) &&
          truth.hits[i].distance < 15.0) {
        most = std::max<int>(most, image[3 * i + 1]);
      }
    }
    return most;
  };
  EXPECT_GT(brightest(all), brightest(none) + 30);
}

TEST(SceneFeatures, ValidateNamesWhatIsWrong) {
  const auto broken = [](auto&& change) {
    SynthOptions options;
    change(options.features);
    try {
      options.validate();
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("nothing thrown");
  };
  EXPECT_EQ(broken([](SceneFeatures&) {}), "nothing thrown");
  const auto names = [&](const char* field, auto&& change) {
    EXPECT_NE(broken(change).find(field), std::string::npos) << broken(change);
  };
  names("corner.radius", [](SceneFeatures& f) { f.corner.radius = 4.0; });
  names("corner.yaw_rate", [](SceneFeatures& f) { f.corner.yaw_rate = 2.0; });
  names("corner.phase", [](SceneFeatures& f) { f.corner.phase = -0.1; });
  names("corner.angle", [](SceneFeatures& f) { f.corner.angle = 0.3; });
  names("corner.arm_grade", [](SceneFeatures& f) { f.corner.arm_grade = std::nan(""); });
  names("bend.radius", [](SceneFeatures& f) { f.bend.radius = 12.0; });
  names("bend.radius", [](SceneFeatures& f) {
    f.corner.enabled = true;
    f.bend.radius = 60.0;
  });
  names("roadside.pavements", [](SceneFeatures& f) {
    f.corner.enabled = true;
    f.roadside.pavements = Pavements::kLeft;
  });
  names("lead_car.gap", [](SceneFeatures& f) { f.lead_car.gap = 1.0; });
  names("asphalt.contrast", [](SceneFeatures& f) { f.asphalt.contrast = 0.0; });
  names("asphalt.wetness", [](SceneFeatures& f) { f.asphalt.wetness = 1.5; });
  names("roadside.kerb_height", [](SceneFeatures& f) { f.roadside.kerb_height = 0.5; });
  names("roadside.edge_distance", [](SceneFeatures& f) { f.roadside.edge_distance = 0.1; });
  names("roadside.half_width", [](SceneFeatures& f) { f.roadside.half_width = 1.0; });
  names("roadside.verge_rise", [](SceneFeatures& f) { f.roadside.verge_rise = 1.0; });
  names("roadside.verge_rise_width", [](SceneFeatures& f) { f.roadside.verge_rise_width = 0.0; });
  names("mounting.pitch", [](SceneFeatures& f) { f.mounting.pitch = 1.0; });
  names("mounting.yaw", [](SceneFeatures& f) { f.mounting.yaw = 1.0; });
  names("mounting.roll", [](SceneFeatures& f) { f.mounting.roll = 1.0; });
  names("mounting.ahead_of_axle", [](SceneFeatures& f) { f.mounting.ahead_of_axle = -1.0; });
  names("weather.cloudiness", [](SceneFeatures& f) { f.weather.cloudiness = 2.0; });
  names("weather.sun_elevation", [](SceneFeatures& f) { f.weather.sun_elevation = 0.0; });
  names("weather.haze_distance", [](SceneFeatures& f) { f.weather.haze_distance = 1.0; });
  SynthOptions far = small_options(1);
  far.features.corner.enabled = true;
  far.num_frames = 200;  // 4.5 m/s for 20 s
  EXPECT_THROW(far.validate(), std::invalid_argument);
}

}  // namespace
}  // namespace camber
