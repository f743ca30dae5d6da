#include "camber/calibrate/known_sizes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "calibrate/simulated_drive.h"
#include "support/drawn_markings.h"
#include "vehicle/simulated_vehicle.h"

namespace camber {
namespace {

const CameraSource* named(const std::vector<CameraSource>& sources, const std::string& name) {
  for (const CameraSource& source : sources) {
    if (source.name == name) return &source;
  }
  return nullptr;
}

/// The road of a window as it is found with a focal length that is wrong by a factor, in units.
WindowRoad stretched_road(const Plane& plane, double factor) {
  Eigen::Vector3d normal = plane.normal;
  normal.z() /= factor;
  return {normal.normalized(), 0.37, 40, 2.5};
}

/// The way straight on, which the road ahead leaves at an angle, rad.
Eigen::Vector3d way_on(const WindowRoad& road, double bend) {
  const Eigen::Vector3d& up = road.normal;
  const Eigen::Vector3d along = (Eigen::Vector3d::UnitZ() - up * up.z()).normalized();
  return std::cos(bend) * along + std::sin(bend) * up;
}

/// One simulated vehicle a frame, or several views of one, and a camera that is wrong.
struct Street {
  Scene scene;
  std::vector<RoadView> views;
  CameraSoFar so_far;

  Street(double factor, double sigma) : factor_(factor) {
    so_far.focal_sigma = sigma;
    so_far.log_height = std::log(1.65);
    so_far.height_sigma = 0.2;
  }

  void add(const test::SimulatedVehicle& vehicle, int track, double bend = 0.0) {
    scene.camera = vehicle.camera;
    scene.camera.fx *= factor_;
    scene.camera.fy *= factor_;
    so_far.log_focal = std::log(scene.camera.fx);
    SceneFrame frame;
    frame.id = static_cast<int>(scene.frames.size());
    frame.vehicles = {vehicle.detection};
    frame.vehicles.front().track = track;
    RoadView view;
    view.frame_id = frame.id;
    view.road = stretched_road(vehicle.support.plane.plane, factor_);
    view.ahead = way_on(view.road, bend);
    view.along = 20.0 * frame.id;
    views.push_back(view);
    scene.frames.push_back(std::move(frame));
  }

  std::vector<CameraSource> sources(int threads = 2) const {
    KnownSizesOptions options;
    options.num_threads = threads;
    return vehicle_sources(scene, views, so_far, options);
  }

 private:
  double factor_;
};

test::SimulationOptions near_cars(std::uint64_t seed) {
  test::SimulationOptions out;
  out.seed = seed;
  out.min_distance = 7.0;
  out.max_distance = 15.0;
  out.occluded_share = 0.0;
  return out;
}

Street street_of(double factor, double sigma, std::uint64_t seed, std::uint64_t cars) {
  Street out(factor, sigma);
  for (std::uint64_t i = 0; i < cars; ++i) {
    out.add(test::simulate_vehicle(near_cars(seed), i), static_cast<int>(i));
  }
  return out;
}

TEST(KnownSizes, ProportionsOfVehiclesGiveTheFocalLength) {
  constexpr double kTruth = 721.5377;  // px
  for (const double wrong_by : {0.8, 1.0, 1.3}) {
    double chi = 0.0;
    constexpr int kStreets = 3;
    for (std::uint64_t seed = 1; seed <= kStreets; ++seed) {
      const auto sources = street_of(wrong_by, 0.3, seed, 8).sources();
      const CameraSource* found = named(sources, "vehicle_proportions");
      ASSERT_NE(found, nullptr) << wrong_by << " " << seed;
      const double off = found->value - std::log(kTruth);
      EXPECT_LT(std::abs(off), 3.0 * found->sigma) << wrong_by << " " << seed;
      EXPECT_LT(found->sigma, 0.15) << wrong_by << " " << seed;
      EXPECT_LE(found->common, found->sigma);
      chi += std::pow(off / found->sigma, 2) / kStreets;
    }
    EXPECT_LT(chi, 4.0) << wrong_by;  // of three, 1 in 100 by chance
  }
}

TEST(KnownSizes, SizesOfVehiclesGiveTheHeight) {
  constexpr double kUsual = 0.2;  // how well the height of cars' cameras is known
  int known = 0;
  for (std::uint64_t car = 0; car < 4; ++car) {
    const auto options = near_cars(5);
    const test::SimulatedVehicle first = test::simulate_vehicle(options, car);
    Street street(1.0, 0.02);
    for (int view = 0; view < 4; ++view) {  // as if they were other vehicles
      street.add(test::seen_again(first, options, car, view, SE3(), 0.0), view);
    }
    const auto sources = street.sources();
    const CameraSource* found = named(sources, "vehicle_sizes");
    ASSERT_NE(found, nullptr) << car;
    // With the focal length as it is.
    const double log_height = found->value - found->by_focal * street.so_far.log_focal;
    // One car's size is known to some 5 %.
    EXPECT_NEAR(log_height, std::log(first.true_plane.offset), 3.0 * std::hypot(0.05, found->sigma))
        << car;
    known += found->sigma < kUsual ? 1 : 0;
    EXPECT_LT(std::abs(found->by_focal), 1.0) << car;
  }
  EXPECT_GE(known, 3);  // of four
}

TEST(KnownSizes, SizesCountLessWhereTheRoadBends) {
  constexpr double kBend = 0.2;  // rad
  constexpr int kCars = 6;
  Street flat(1.0, 0.02), bent(1.0, 0.02);
  double information = 0.0;
  for (std::uint64_t car = 0; car < kCars; ++car) {
    const test::SimulatedVehicle vehicle = test::simulate_vehicle(near_cars(3), car);
    flat.add(vehicle, static_cast<int>(car));
    bent.add(vehicle, static_cast<int>(car), kBend);
    const double missed = kBend * vehicle.truth.center().z() / vehicle.true_plane.offset;
    information += 1.0 / (missed * missed);
  }
  EXPECT_NEAR(bend_of_road(bent.views.front()), kBend, 1e-9);
  EXPECT_NEAR(bend_of_road(flat.views.front()), 0.0, 1e-9);
  const auto own_sigma = [](const Street& street) {
    const auto sources = street.sources();
    const CameraSource* found = named(sources, "vehicle_sizes");
    return found ? std::sqrt(std::pow(found->sigma, 2) - std::pow(found->common, 2)) : 0.0;
  };
  const double of_bend = 1.0 / std::sqrt(information);
  EXPECT_LT(own_sigma(flat), 0.3 * of_bend);
  EXPECT_NEAR(own_sigma(bent), of_bend, 0.3 * of_bend);
}

TEST(KnownSizes, AVehicleCountsOnce) {
  const auto options = near_cars(5);
  const test::SimulatedVehicle first = test::simulate_vehicle(options, 1);
  for (const int track : {7, -1}) {  // by its number, by its place in the image
    Street street(1.0, 0.2);
    for (int view = 0; view < 4; ++view) {
      street.add(test::seen_again(first, options, 1, view, SE3(), 0.0), track);
    }
    EXPECT_TRUE(street.sources().empty()) << track;  // one alone may be a van
  }
}

TEST(KnownSizes, NeedKeypointsAndARoad) {
  Street street = street_of(1.0, 0.2, 1, 3);
  for (SceneFrame& frame : street.scene.frames) frame.vehicles.front().keypoints.clear();
  EXPECT_TRUE(street.sources().empty());
  Street blind = street_of(1.0, 0.2, 1, 3);
  blind.views.clear();
  EXPECT_TRUE(blind.sources().empty());
  KnownSizesOptions none;
  none.most_vehicles = 0;
  EXPECT_THROW(vehicle_sources(street.scene, street.views, street.so_far, none),
               std::invalid_argument);
}

TEST(KnownSizes, TheSameForAnyNumberOfThreads) {
  const Street street = street_of(1.2, 0.3, 2, 4);
  const auto one = street.sources(1), four = street.sources(4);
  ASSERT_EQ(one.size(), four.size());
  for (std::size_t i = 0; i < one.size(); ++i) {
    EXPECT_EQ(one[i].value, four[i].value);
    EXPECT_EQ(one[i].sigma, four[i].sigma);
  }
}

/// Two broken lines on a road, in three images, as a wrong camera sees them.
struct PaintedRoad {
  static constexpr double kFocal = 720.0, kHeight = 1.45;
  Scene scene;
  std::vector<RoadView> views;
  CameraSoFar so_far;
  std::map<int, GrayImage> images;

  PaintedRoad(double focal_wrong_by, double height_wrong_by, double focal_sigma,
              double height_sigma) {
    const PinholeCamera camera{960, 320, kFocal, kFocal, 479.5, 130.0};
    const Plane road{Eigen::Vector3d(0.01, -1.0, -0.03).normalized(), kHeight};
    for (int id = 0; id < 3; ++id) {
      const double start = 6.3 + 1.7 * id;
      images[id] = test::draw_markings(
          camera, road,
          [&](double x, double z) {
            return test::dashed(x, z, -1.6, start) || test::dashed(x, z, 1.9, start + 4.0);
          },
          3.0, static_cast<std::uint64_t>(id));
      SceneFrame frame;
      frame.id = id;
      scene.frames.push_back(frame);
      const WindowRoad seen = stretched_road(road, focal_wrong_by);
      views.push_back({id, seen, way_on(seen, 0.0), 0.0});
    }
    scene.camera = camera;
    scene.camera.fx *= focal_wrong_by;
    scene.camera.fy *= focal_wrong_by;
    scene.markings_m = {
        {"dash_length", 3.0}, {"dash_gap", 6.0}, {"line_width", 0.12}, {"lane_width", 3.5}};
    so_far = {std::log(scene.camera.fx), focal_sigma, std::log(kHeight * height_wrong_by),
              height_sigma};
  }

  std::vector<CameraSource> sources(int threads = 2) const {
    KnownSizesOptions options;
    options.num_threads = threads;
    return marking_sources(
        scene, views,
        [&](const RoadView& view) {
          FrameImage out;
          out.gray = images.at(view.frame_id);
          return out;
        },
        so_far, options);
  }
};

TEST(KnownSizes, BrokenLinesGiveFocalLengthAndHeight) {
  for (const double focal_wrong_by : {0.75, 1.0, 1.4}) {
    for (const double height_wrong_by : {1.0, 1.15}) {
      const PaintedRoad road(focal_wrong_by, height_wrong_by, 0.3, 0.15);
      const auto sources = road.sources();
      const CameraSource* dashes = named(sources, "dashes");
      ASSERT_NE(dashes, nullptr) << focal_wrong_by << " " << height_wrong_by;
      const double truth = std::log(PaintedRoad::kFocal) + std::log(PaintedRoad::kHeight);
      EXPECT_NEAR(dashes->value, truth, 3.0 * dashes->sigma) << focal_wrong_by;
      EXPECT_LT(std::pow(dashes->sigma, 2) - std::pow(dashes->common, 2), 0.05 * 0.05);
      const CameraSource* lanes = named(sources, "lane_widths");
      ASSERT_NE(lanes, nullptr) << focal_wrong_by << " " << height_wrong_by;
      EXPECT_NEAR(lanes->value, std::log(PaintedRoad::kHeight), 3.0 * lanes->sigma);
      EXPECT_LT(lanes->sigma, 0.06);
    }
  }
}

TEST(KnownSizes, LinesCountLessWhereTheRoadBends) {
  PaintedRoad road(1.0, 1.0, 0.05, 0.1);
  // One image has them on a slope, which the camera is higher above than above the road.
  constexpr double kBend = 0.15, kHigher = 1.15;
  const Plane slope{road.views[0].road.normal, kHigher * PaintedRoad::kHeight};
  road.images[0] = test::draw_markings(
      road.scene.camera, slope,
      [](double x, double z) {
        return test::dashed(x, z, -1.6, 6.3) || test::dashed(x, z, 1.9, 10.3);
      },
      3.0, 0);
  const auto off = [&] {
    const auto sources = road.sources();
    const CameraSource* dashes = named(sources, "dashes");
    const double truth = std::log(PaintedRoad::kFocal) + std::log(PaintedRoad::kHeight);
    return dashes ? std::abs(dashes->value - truth) : 1.0;
  };
  const double as_if_flat = off();
  road.views[0].ahead = way_on(road.views[0].road, kBend);
  EXPECT_LT(off(), 0.5 * as_if_flat);
}

TEST(KnownSizes, LinesOfSizesThatAreNotKnownSayNothing) {
  PaintedRoad road(1.0, 1.0, 0.05, 0.05);
  EXPECT_FALSE(road.sources().empty());
  EXPECT_EQ(road.sources(1).front().value, road.sources(4).front().value);
  PaintedRoad unknown = road;
  unknown.scene.markings_m.clear();
  EXPECT_TRUE(unknown.sources().empty());
  PaintedRoad no_lane = road;
  no_lane.scene.markings_m.erase("lane_width");
  EXPECT_EQ(no_lane.sources().size(), 1U);
}

TEST(KnownSizes, RoadsAreThoseOfTheWindows) {
  test::SimulatedDriveOptions options;
  options.lens = {640, 360, 420.0, 319.5, 179.5, 0.0, 0.0};
  options.key_frames = 57;
  std::vector<WindowBundle> windows;
  for (CalibrationWindow& window : test::true_windows(test::simulate_drive(options), 8)) {
    windows.emplace_back(std::move(window));
  }
  std::vector<int> ids;
  for (int k = 0; k < options.key_frames; ++k) ids.push_back(3 * k + 5);
  const std::vector<RoadView> all = road_views(windows, ids, 100);
  ASSERT_GE(all.size(), 6U);
  for (std::size_t i = 0; i < all.size(); ++i) {
    EXPECT_EQ((all[i].frame_id - 5) % 3, 0);
    EXPECT_GT(all[i].ahead.z(), 0.99);
    if (i == 0) continue;
    EXPECT_GT(all[i].frame_id, all[i - 1].frame_id);
    // Windows that follow each other, of seven steps.
    const double steps = (all[i].frame_id - all[i - 1].frame_id) / 3.0;
    if (steps == 7.0) {
      EXPECT_NEAR((all[i].along - all[i - 1].along) * options.height, steps * options.step, 0.4);
    }
  }
  EXPECT_EQ(road_views(windows, ids, 3).size(), 3U);
  EXPECT_TRUE(road_views({}, ids, 3).empty());
}

}  // namespace
}  // namespace camber
