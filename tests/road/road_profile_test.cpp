#include "camber/road/road_profile.h"

#include <gtest/gtest.h>

#include <cmath>

#include "camber/road/fit_road_surface.h"
#include "plane/curved_road_maker.h"
#include "road/planar_road.h"

namespace camber {
namespace {

using Eigen::Vector3d;
using test::surface_of;

/// A strip of road along x from x0 to x1 with a slope along x and a slope across (left side up),
/// 8 m wide; its height at (x0, 0) is z0. Slopes are rise over run.
PlanePatch strip(int id, double x0, double x1, double z0, double along, double across = 0.0) {
  return test::rectangle(id, x0, x1, -4.0, 4.0, z0, along, across, {4e-6, 1e-6, 1e-4});
}

/// Standard deviations by the planes' covariances alone.
ProfileOptions of_planes_alone() {
  ProfileOptions options;
  options.levelling_sigma = options.drift_sigma = 0.0;
  return options;
}

TEST(RoadProfile, StraightSlope) {
  const RoadSurface surface = surface_of({strip(0, 0, 40, 2.0, 0.05, 0.02)});
  const auto profile = road_profile(surface, {{0, 0, 0}, {40, 0, 0}}, of_planes_alone());
  ASSERT_EQ(profile.size(), 41u);
  for (std::size_t k = 5; k + 5 < profile.size(); ++k) {
    EXPECT_DOUBLE_EQ(profile[k].station, static_cast<double>(k));
    EXPECT_NEAR(profile[k].height, 2.0 + 0.05 * profile[k].station, 1e-9);
    EXPECT_NEAR(profile[k].grade, 0.05, 1e-9);
    EXPECT_NEAR(profile[k].cross_slope, 0.02, 1e-9);
    EXPECT_TRUE(std::isinf(profile[k].vertical_radius));
    EXPECT_EQ(profile[k].patch, 0);
  }
  // A tilt about axis1 (along the road) is a cross slope: 2 mrad; about axis2 a grade: 1 mrad.
  EXPECT_NEAR(profile[20].sigma_cross_slope, 2e-3, 1e-5);
  EXPECT_NEAR(profile[20].sigma_grade, 1e-3, 1e-5);
  EXPECT_NEAR(profile[20].sigma_height, 0.01, 1e-4);
}

TEST(RoadProfile, SigmasHoldWhatPlanesLeaveOutDriftAndLevelling) {
  PlanePatch patch = strip(0, 0, 40, 2.0, 0.0);
  const ProfileOptions alone = of_planes_alone();
  const std::vector<Vector3d> line = {{0, 0, 0}, {40, 0, 0}};
  const auto plane = road_profile(surface_of({patch}), line, alone);
  patch.unmodelled_sigma = 0.03;
  const auto bent = road_profile(surface_of({patch}), line, alone);
  for (const std::size_t k : {5u, 20u, 35u}) {
    EXPECT_NEAR(bent[k].sigma_height, std::hypot(plane[k].sigma_height, 0.03), 1e-12);
    EXPECT_GT(bent[k].sigma_grade, 1.2 * plane[k].sigma_grade);
    EXPECT_GT(bent[k].sigma_cross_slope, 1.2 * plane[k].sigma_cross_slope);
  }
  ProfileOptions options = alone;
  options.levelling_sigma = 0.002;
  const auto levelled = road_profile(surface_of({patch}), line, options);
  // About the middle of the line.
  EXPECT_NEAR(levelled[20].sigma_height, bent[20].sigma_height, 1e-12);
  EXPECT_NEAR(levelled[35].sigma_height, std::hypot(bent[35].sigma_height, 15 * 0.002), 1e-12);
  EXPECT_NEAR(levelled[20].sigma_grade, std::hypot(bent[20].sigma_grade, 0.002), 1e-12);
  EXPECT_NEAR(levelled[20].sigma_cross_slope, std::hypot(bent[20].sigma_cross_slope, 0.002), 1e-12);
  options = alone;
  options.drift_sigma = 0.05;
  const auto drifting = road_profile(surface_of({patch}), line, options);
  EXPECT_NEAR(drifting[20].sigma_height, std::hypot(bent[20].sigma_height, 0.05), 1e-12);
  EXPECT_GT(drifting[20].sigma_grade, bent[20].sigma_grade);
  // Heights that drift apart slowly say less of the grade than ones that err each by itself:
  // 0.05 m over the root of the sum of squares of 11 stations, 1 m apart.
  EXPECT_LT(drifting[20].sigma_grade, std::hypot(bent[20].sigma_grade, 0.05 / std::sqrt(110.0)));
}

TEST(RoadProfile, SigmaOfTheGradeIsThatOfTheHeightsOverItsLength) {
  // One plane's heights err together, and their slope is the plane's: 1 mrad.
  const RoadSurface one = surface_of({strip(0, 0, 40, 0.0, 0.0)});
  const std::vector<Vector3d> line = {{0, 0, 0}, {40, 0, 0}};
  EXPECT_NEAR(road_profile(one, line, of_planes_alone())[20].sigma_grade, 1e-3, 1e-9);
  // Two planes that meet at the station, 10 mm each in height and apart from one another: by their
  // middles 5 m apart, more than either plane's own slope.
  const RoadSurface two = surface_of({strip(0, 0, 19.5, 0.0, 0.0), strip(1, 19.5, 40, 0.0, 0.0)});
  EXPECT_GT(road_profile(two, line, of_planes_alone())[20].sigma_grade, 1.5e-3);
}

TEST(RoadProfile, BandsHoldWhereErrorsAreNotWhatTheFitAssumes) {
  for (const test::RoadNoise noise : test::kRoadNoises) {
    double inside = 0.0, count = 0.0, width = 0.0;
    for (const std::uint64_t seed : {1001u, 1003u, 1005u, 1007u}) {
      test::CurvedRoadOptions made;
      made.seed = seed;
      made.noise = noise;
      made.points = 20000;
      made.length = 100.0;
      const test::CurvedRoad road = test::make_curved_road(made);
      RoadSurfaceOptions options;
      options.driven_line = road.line;
      const auto profile =
          road_profile(fit_road_surface(road.cloud, options).surface, road.line, {});
      ASSERT_EQ(profile.size(), road.line.size());
      for (std::size_t k = 0; k < profile.size(); ++k) {
        if (profile[k].status == Status::kFailed) continue;
        const double error = profile[k].height - road.line[k].z();
        inside += std::abs(error) <= 1.96 * profile[k].sigma_height ? 1.0 : 0.0;
        width += profile[k].sigma_height;
        count += 1.0;
      }
    }
    ASSERT_GT(count, 350.0) << to_string(noise);
    // Four draws with errors in common along 30 m are a dozen independent places.
    EXPECT_GT(inside / count, 0.80) << to_string(noise);
    EXPECT_LT(width / count, 0.05) << to_string(noise);
  }
}

TEST(RoadProfile, SigmaOfTheCrossSlopeHoldsTwist) {
  // Superelevation from 0 to -5 % over 60 m, and planes of 2 to 40 m.
  const auto slope = [](double s) { return -0.05 * std::clamp((s - 80.0) / 60.0, 0.0, 1.0); };
  double inside = 0.0, count = 0.0, width = 0.0;
  for (const double length : {12.0, 25.0, 40.0}) {
    std::vector<PlanePatch> patches;
    for (double from = 0.0; from < 240.0; from += length) {
      double mean = 0.0;
      for (int i = 0; i < 100; ++i) mean += slope(from + (i + 0.5) / 100.0 * length) / 100.0;
      patches.push_back(strip(static_cast<int>(patches.size()), from, from + length, 0, 0, mean));
      patches.back().plane.covariance = Vector3d(1e-7, 1e-7, 1e-6).asDiagonal();
    }
    for (const ProfilePoint& p :
         road_profile(surface_of(patches), {{1, 0, 0}, {239, 0, 0}}, of_planes_alone())) {
      const double error = std::abs(p.cross_slope - slope(p.station));
      inside += error <= 1.96 * p.sigma_cross_slope ? 1.0 : 0.0;
      count += 1.0;
      width = std::max(width, p.sigma_cross_slope);
    }
  }
  EXPECT_GT(inside / count, 0.9);
  EXPECT_LT(width, 0.02);
  // Planes whose cross slopes differ by what they are known to: 0.3 mrad.
  const RoadSurface plain =
      surface_of({strip(0, 0, 40, 0, 0, 0.02), strip(1, 40, 80, 0, 0, 0.0203)});
  for (const ProfilePoint& p : road_profile(plain, {{0, 0, 0}, {80, 0, 0}}, of_planes_alone())) {
    EXPECT_NEAR(p.sigma_cross_slope, 2e-3, 1e-4) << p.station;
  }
}

TEST(RoadProfile, SigmaOfTheCrossSlopeHoldsACrown) {
  const auto half = [](int id, double y0, double y1, double across) {
    PlanePatch patch = strip(id, 0, 60, 0, 0, across);
    patch.boundary = {
        {0, y0, across * y0}, {60, y0, across * y0}, {60, y1, across * y1}, {0, y1, across * y1}};
    patch.plane.covariance = Vector3d(1e-7, 1e-7, 1e-6).asDiagonal();
    return patch;
  };
  const RoadSurface surface = surface_of({half(0, 0, 4, -0.025), half(1, -4, 0, 0.025)});
  const auto at = [&](double y) {
    return road_profile(surface, {{0, y, 0}, {60, y, 0}}, of_planes_alone())[30];
  };
  for (const double y : {-0.1, 0.0, 0.1}) {
    EXPECT_GT(at(y).sigma_cross_slope, 0.05 / 1.96) << y;
    EXPECT_LT(at(y).sigma_cross_slope, 0.05) << y;
  }
  EXPECT_LT(at(0.5).sigma_cross_slope, 1e-3);
  EXPECT_LT(at(-2.0).sigma_cross_slope, 1e-3);
}

TEST(RoadProfile, SignsFollowTheDirectionOfTheLine) {
  const RoadSurface surface = surface_of({strip(0, 0, 40, 2.0, 0.05, 0.02)});
  const auto back = road_profile(surface, {{40, 0, 0}, {0, 0, 0}}, {});
  EXPECT_NEAR(back[20].grade, -0.05, 1e-9);
  EXPECT_NEAR(back[20].cross_slope, -0.02, 1e-9);
}

TEST(RoadProfile, VerticalRadiusOfASagFromShortPatches) {
  // A parabola z = s^2 / (2 R), R = 200 m, in chords of 4 m.
  std::vector<PlanePatch> patches;
  const double radius = 200.0;
  for (int k = 0; k < 10; ++k) {
    const double a = 4.0 * k, b = a + 4.0;
    patches.push_back(strip(k, a, b, a * a / (2 * radius), (a + b) / (2 * radius)));
  }
  ProfileOptions options;
  options.length = 20.0;
  const auto profile = road_profile(surface_of(patches), {{0, 0, 0}, {40, 0, 0}}, options);
  EXPECT_NEAR(profile[20].grade, 20.0 / radius, 1e-3);
  EXPECT_GT(profile[20].vertical_radius, 0.0);
  // Chords lie on the parabola at their ends only: a few per cent.
  EXPECT_NEAR(profile[20].vertical_radius, radius, 0.05 * radius);
}

/// A road's heights over x in pieces of lengths in turn, each the least-squares line of its
/// stretch, with what that leaves out.
template <typename Height>
std::vector<PlanePatch> pieces_of(const Height& height, const std::vector<double>& lengths,
                                  double total) {
  std::vector<PlanePatch> patches;
  double from = 0.0;
  for (int k = 0; from < total; ++k) {
    const double length = lengths[static_cast<std::size_t>(k) % lengths.size()];
    constexpr int kPlaces = 200;
    const auto place = [&](int i) { return (i + 0.5) / kPlaces - 0.5; };  // by the length
    double mean = 0.0, slope = 0.0, left = 0.0;
    for (int i = 0; i < kPlaces; ++i) {
      const double z = height(from + (place(i) + 0.5) * length);
      mean += z / kPlaces;
      slope += 12.0 * place(i) * z / (kPlaces * length);
    }
    for (int i = 0; i < kPlaces; ++i) {
      const double z = height(from + (place(i) + 0.5) * length);
      left += std::pow(z - mean - slope * place(i) * length, 2) / kPlaces;
    }
    patches.push_back(strip(k, from, from + length, mean - 0.5 * length * slope, slope));
    patches.back().plane.covariance = Vector3d(1e-8, 1e-8, 1e-6).asDiagonal();
    patches.back().unmodelled_sigma = std::sqrt(left);
    from += length;
  }
  return patches;
}

TEST(RoadProfile, VerticalRadiusHangsNeitherOnTheStepNorOnThePieces) {
  const double radius = 200.0;
  const auto sag = [&](double x) { return x * x / (2.0 * radius); };
  for (const std::vector<double>& lengths : std::vector<std::vector<double>>{
           {4.0}, {8.0}, {12.0}, {20.0}, {3.0, 17.0, 8.0}, {25.0, 10.0}}) {
    const RoadSurface surface = surface_of(pieces_of(sag, lengths, 120.0));
    for (const double step : {0.1, 0.5, 1.0, 2.5, 5.0, 10.0}) {
      for (const double length : {10.0, 20.0}) {
        ProfileOptions options = of_planes_alone();
        options.step = step;
        options.length = length;
        double count = 0.0;
        for (const ProfilePoint& p : road_profile(surface, {{0, 0, 0}, {120, 0, 0}}, options)) {
          if (p.station < 20.0 || p.station > 100.0) continue;
          const double truth = radius * std::pow(1.0 + std::pow(p.station / radius, 2), 1.5);
          // By a grade that is off by what that of a piece is.
          EXPECT_NEAR(p.vertical_radius, truth, 0.06 * truth)
              << "pieces of " << lengths[0] << ", length " << length << ", step " << step << " at "
              << p.station;
          EXPECT_NEAR(p.vertical_curvature * p.vertical_radius, 1.0, 1e-9);
          count += 1.0;
        }
        EXPECT_GT(count, 0.9 * 80.0 / step);
      }
    }
  }
}

TEST(RoadProfile, PlanesThatHideNothingBendWhereTheyMeet) {
  // 5 % after level: over 10 m that is 15/16 of 5 % by half of 10 m, with 11 heights nearly.
  const RoadSurface surface = surface_of({strip(0, 0, 60, 0.0, 0.0), strip(1, 60, 120, 0.0, 0.05)});
  const auto profile = road_profile(surface, {{0, 0, 0}, {120, 0, 0}}, of_planes_alone());
  EXPECT_NEAR(profile[60].vertical_curvature, 0.05 * 15.0 / 16.0 / 5.0, 1e-3);
  EXPECT_TRUE(std::isinf(profile[50].vertical_radius));
  EXPECT_TRUE(std::isinf(profile[70].vertical_radius));
  // Two standard deviations of 2 mm on 60 m are no vertical curve.
  RoadSurface worn = surface;
  for (PlanePatch& patch : worn.patches) patch.unmodelled_sigma = 0.002;
  const auto uneven = road_profile(worn, {{0, 0, 0}, {120, 0, 0}}, of_planes_alone());
  EXPECT_NEAR(uneven[60].vertical_curvature, profile[60].vertical_curvature, 5e-4);
  EXPECT_LT(std::abs(uneven[50].vertical_curvature), 5e-5);
}

TEST(RoadProfile, SigmaOfTheCurvatureHoldsItsError) {
  const auto hills = [](double x) {
    return 0.6 * std::sin(2.0 * M_PI * x / 60.0) + 0.3 * std::sin(2.0 * M_PI * x / 37.0 + 1.0);
  };
  const auto bend = [](double x) {
    return -0.6 * std::pow(2.0 * M_PI / 60.0, 2) * std::sin(2.0 * M_PI * x / 60.0) -
           0.3 * std::pow(2.0 * M_PI / 37.0, 2) * std::sin(2.0 * M_PI * x / 37.0 + 1.0);
  };
  for (const std::vector<double>& lengths :
       std::vector<std::vector<double>>{{4.0, 5.0}, {6.0, 11.0, 8.0}, {10.0, 18.0}, {20.0}}) {
    const RoadSurface surface = surface_of(pieces_of(hills, lengths, 240.0));
    double squares = 0.0, count = 0.0;
    ProfileOptions options = of_planes_alone();
    for (const ProfilePoint& p : road_profile(surface, {{20, 0, 0}, {220, 0, 0}}, options)) {
      if (!std::isfinite(p.vertical_curvature)) continue;
      ASSERT_GT(p.sigma_vertical_curvature, 0.0);
      const double truth = bend(p.station + 20.0) / std::pow(1.0 + p.grade * p.grade, 1.5);
      squares += std::pow((p.vertical_curvature - truth) / p.sigma_vertical_curvature, 2);
      count += 1.0;
    }
    EXPECT_GT(count, 180.0);
    EXPECT_LT(std::sqrt(squares / count), 1.3) << lengths[0];
    EXPECT_GT(std::sqrt(squares / count), 0.1) << lengths[0];
  }
}

TEST(RoadProfile, SigmaOfTheCurvatureIsThatOfTheHeights) {
  // Planes of 5 m, 10 mm each in height, apart from one another, over 10 m: three whole ones would
  // give 10 mm sqrt(6) / 25 m^2 by their middles.
  std::vector<PlanePatch> level;
  for (int k = 0; k < 8; ++k) {
    level.push_back(strip(k, 5.0 * k, 5.0 * k + 5.0, 0.0, 0.0));
    level.back().plane.covariance = Vector3d(1e-10, 1e-10, 1e-4).asDiagonal();
  }
  const std::vector<Vector3d> line = {{0, 0, 0}, {40, 0, 0}};
  const auto flat = road_profile(surface_of(level), line, of_planes_alone());
  EXPECT_NEAR(flat[22].sigma_vertical_curvature, 0.01 * std::sqrt(6.0) / 25.0, 3e-4);
  // One plane's bend is nothing, whatever its own errors; a cloud turned does not bend.
  const RoadSurface one = surface_of({strip(0, 0, 40, 0.0, 0.0)});
  EXPECT_NEAR(road_profile(one, line, of_planes_alone())[20].sigma_vertical_curvature, 0.0, 1e-9);
  ProfileOptions options = of_planes_alone();
  options.levelling_sigma = 0.002;
  EXPECT_NEAR(road_profile(one, line, options)[20].sigma_vertical_curvature, 0.0, 1e-9);
  options.drift_sigma = 0.05;
  EXPECT_GT(road_profile(one, line, options)[20].sigma_vertical_curvature, 1e-4);
}

TEST(RoadProfile, SaysNotCoveredAndDoesNotExtrapolate) {
  const RoadSurface surface = surface_of({strip(0, 0, 20, 0.0, 0.0), strip(1, 30, 50, 0.0, 0.0)});
  const auto profile = road_profile(surface, {{-5, 0, 0}, {55, 0, 0}}, {});
  for (const ProfilePoint& point : profile) {
    const double x = point.station - 5.0;
    const bool covered = (x >= -0.5 && x <= 20.5) || (x >= 29.5 && x <= 50.5);
    if (covered) {
      EXPECT_NE(point.status, Status::kFailed) << x;
      EXPECT_TRUE(std::isfinite(point.height));
    } else {
      EXPECT_EQ(point.status, Status::kFailed) << x;
      EXPECT_EQ(point.reason, "not covered");
      EXPECT_TRUE(std::isnan(point.height));
      EXPECT_TRUE(std::isnan(point.grade));
    }
  }
}

TEST(RoadProfile, CornersAndRepeatedPointsOfTheLine) {
  const RoadSurface surface = surface_of({strip(0, 0, 40, 0.0, 0.1)});
  const auto profile = road_profile(surface, {{2, -3, 0}, {2, -3, 0}, {12, -3, 0}, {12, 3, 0}}, {});
  EXPECT_DOUBLE_EQ(profile.back().station, 16.0);
  EXPECT_NEAR(profile[5].grade, 0.1, 1e-9);
  EXPECT_NEAR(profile.back().cross_slope, -0.1, 1e-9);  // driven to the left: the slope is behind
}

TEST(RoadProfile, WrongInputIsNamed) {
  const RoadSurface surface = surface_of({strip(0, 0, 40, 0.0, 0.1)});
  EXPECT_THROW(road_profile(surface, {{0, 0, 0}}, {}), std::invalid_argument);
  ProfileOptions options;
  options.step = 0.0;
  EXPECT_THROW(road_profile(surface, {{0, 0, 0}, {1, 0, 0}}, options), std::invalid_argument);
  options = {};
  options.length = 1e-6;
  EXPECT_THROW(road_profile(surface, {{0, 0, 0}, {1, 0, 0}}, options), std::invalid_argument);
  options = {};
  options.levelling_sigma = -1e-3;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = {};
  options.drift_sigma = std::nan("");
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

}  // namespace
}  // namespace camber
