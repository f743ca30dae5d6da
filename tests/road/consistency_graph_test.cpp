#include "camber/road/consistency_graph.h"

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "camber/core/random.h"
#include "camber/road/cost_functions/height_continuity.h"
#include "camber/road/cost_functions/plane_consistency.h"
#include "camber/road/cost_functions/plane_prior.h"
#include "road/planar_road.h"

namespace camber {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using test::surface_of;

constexpr double kDegree = M_PI / 180.0;

/// A rectangle of road from x0 to x1 with a grade, 8 m wide; its height at x0 is z0.
PlanePatch strip(int id, double x0, double x1, double z0, double grade) {
  return test::rectangle(id, x0, x1, -4.0, 4.0, z0, std::tan(grade), 0.0, {1e-6, 1e-6, 1e-4});
}

TEST(ConsistencyGraph, CreaseIsAValidLinkWithItsAngle) {
  const RoadSurface surface = surface_of({strip(0, 0, 20, 0, 0), strip(1, 20, 40, 0, 5 * kDegree)});
  const auto links = find_links(surface, {});
  ASSERT_EQ(links.size(), 1u);
  EXPECT_TRUE(links[0].valid) << links[0].reason;
  EXPECT_NEAR(links[0].angle, 5 * kDegree, 1e-9);
  EXPECT_NEAR(links[0].height_step, 0.0, 1e-9);
  EXPECT_NEAR(links[0].distance, 0.0, 1e-9);
  EXPECT_NEAR(links[0].weight, 1.0, 1e-9);
}

TEST(ConsistencyGraph, KerbWallAndOverpassAreKeptAsInvalid) {
  RoadSurface surface =
      surface_of({strip(0, 0, 20, 0, 0), strip(1, 20.2, 40, 0.15, 0),
                  strip(2, 40.2, 60, 0.15, 40 * kDegree), strip(3, 2, 18, 5.0, 0)});
  ConsistencyOptions options;
  options.link_distance = 1.0;
  const auto links = find_links(surface, options);
  ASSERT_EQ(links.size(), 3u);
  EXPECT_FALSE(links[0].valid);
  EXPECT_EQ(links[0].reason, "a step of 0.15 m");
  EXPECT_FALSE(links[1].valid);
  EXPECT_EQ(links[1].reason, "one lies 5.00 m above the other");
  EXPECT_FALSE(links[2].valid);
  EXPECT_EQ(links[2].reason, "the normals differ by 40.0 deg");
}

TEST(ConsistencyGraph, FarPatchesAreNoNeighbours) {
  const RoadSurface surface = surface_of({strip(0, 0, 20, 0, 0), strip(1, 28, 40, 0, 0)});
  EXPECT_TRUE(find_links(surface, {}).empty());
  ConsistencyOptions wide;
  wide.link_distance = 9.0;
  EXPECT_EQ(find_links(surface, wide).size(), 1u);
}

/// Patches of 4 to 14 m by 8 m, here and there in 120 x 90 m.
std::vector<PlanePatch> scattered_patches(int count) {
  const CounterRandom random(21);
  std::vector<PlanePatch> out;
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<std::uint64_t>(4 * i);
    const double x = random.uniform(at, 0.0, 120.0), y = random.uniform(at + 1, 0.0, 90.0);
    out.push_back(test::rectangle(i, x, x + random.uniform(at + 2, 4.0, 14.0), y - 4.0, y + 4.0,
                                  random.uniform(at + 3, 0.0, 0.1), 0.0, 0.0, {1e-6, 1e-6, 1e-4}));
  }
  return out;
}

TEST(ConsistencyGraph, LinksOfManyPatchesAreThoseOfEachPairAlone) {
  const std::vector<PlanePatch> patches = scattered_patches(60);
  std::vector<PatchLink> expected;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    for (std::size_t j = i + 1; j < patches.size(); ++j) {
      const auto pair = find_links(surface_of({patches[i], patches[j]}), {});
      expected.insert(expected.end(), pair.begin(), pair.end());
    }
  }
  const auto links = find_links(surface_of(patches), {});
  EXPECT_GT(links.size(), 60u);
  EXPECT_LT(links.size(), 1000u);
  ASSERT_EQ(links.size(), expected.size());
  for (std::size_t k = 0; k < links.size(); ++k) {
    EXPECT_EQ(links[k].a, expected[k].a);
    EXPECT_EQ(links[k].b, expected[k].b);
    EXPECT_EQ(links[k].valid, expected[k].valid);
    EXPECT_EQ(links[k].distance, expected[k].distance);
  }
}

TEST(ConsistencyGraph, PlanesAndCovariancesDoNotHangOnTheOrderOfElimination) {
  RoadSurface one = surface_of(scattered_patches(60));
  one.links = find_links(one, {});  // which of a pair is named first is not what is asked here
  RoadSurface other = one;
  std::reverse(other.patches.begin(), other.patches.end());
  const std::vector<PlanePatch> before = one.patches;
  for (RoadSurface* surface : {&one, &other}) {
    EXPECT_TRUE(optimise_surface({}, surface).converged);
  }
  std::size_t better = 0;
  for (std::size_t k = 0; k < one.patches.size(); ++k) {
    const UncertainPlane &here = one.patches[k].plane,
                         &there = other.find(one.patches[k].id)->plane;
    EXPECT_LT((here.plane.normal - there.plane.normal).norm(), 1e-9) << k;
    // The axes may differ by what neighbours say of the road: heights along the normal do not.
    EXPECT_NEAR(there.height_variance(here.centroid) / here.height_variance(here.centroid), 1.0,
                1e-6)
        << k;
    better += here.covariance(2, 2) < 0.99 * before[k].plane.covariance(2, 2) ? 1 : 0;
  }
  EXPECT_GT(better, 30u);
}

/// A hundred rows of a hundred patches of 9 m by 9 m, 10 m apart, with heights and slopes that are
/// off by more than they say.
std::vector<PlanePatch> field_of_patches() {
  constexpr int kSide = 100;
  const CounterRandom random(5);
  std::vector<PlanePatch> out;
  for (int i = 0; i < kSide * kSide; ++i) {
    const auto at = static_cast<std::uint64_t>(3 * i);
    const double x = 10.0 * (i % kSide), y = 10.0 * (i / kSide);
    out.push_back(test::rectangle(i, x, x + 9.0, y, y + 9.0, random.uniform(at, 0.0, 0.04),
                                  random.uniform(at + 1, -0.003, 0.003),
                                  random.uniform(at + 2, -0.003, 0.003), {1e-6, 1e-6, 1e-4}));
  }
  return out;
}

/// The same patches by tiles of a field of eight by eight, from the last tile to the first.
std::vector<PlanePatch> by_tiles(const std::vector<PlanePatch>& patches) {
  std::vector<PlanePatch> out;
  for (int tile = 63; tile >= 0; --tile) {
    for (const PlanePatch& patch : patches) {
      const int column = patch.id % 100 * 8 / 100, row = patch.id / 100 * 8 / 100;
      if (row * 8 + column == tile) out.push_back(patch);
    }
  }
  return out;
}

TEST(ConsistencyGraph, TenThousandPatchesByTilesHaveTheCostOfOneField) {
  RoadSurface whole = surface_of(field_of_patches()), tiles = surface_of(by_tiles(whole.patches));
  ASSERT_EQ(tiles.patches.size(), 10000u);
  whole.links = find_links(whole, {});
  // Where two patches lie side by side, the middle between them hangs on which is named first; in a
  // plan of tiles patches are numbered by their places.
  tiles.links = whole.links;
  std::reverse(tiles.links.begin(), tiles.links.end());
  EXPECT_GT(whole.links.size(), 19000u);
  const ConsistencyReport one = optimise_surface({}, &whole), other = optimise_surface({}, &tiles);
  EXPECT_TRUE(one.converged);
  EXPECT_TRUE(other.converged);
  EXPECT_LT(one.final_cost, 0.9 * one.initial_cost);
  EXPECT_NEAR(other.initial_cost / one.initial_cost, 1.0, 1e-9);
  EXPECT_NEAR(other.final_cost / one.final_cost, 1.0, 1e-9);
}

TEST(ConsistencyGraph, ContinuityClosesASmallStepAndKeepsTheAngle) {
  // The second patch is 4 cm too high and known ten times worse.
  RoadSurface surface = surface_of({strip(0, 0, 20, 0, 0), strip(1, 20, 40, 0.04, 0.2 * kDegree)});
  surface.patches[1].plane.covariance = Vector3d(1e-6, 1e-6, 1e-2).asDiagonal();
  surface.links = find_links(surface, {});
  ASSERT_TRUE(surface.links.at(0).valid) << surface.links[0].reason;
  ConsistencyOptions options;
  options.continuity_sigma = 0.002;
  const ConsistencyReport report = optimise_surface(options, &surface);
  EXPECT_TRUE(report.converged);
  EXPECT_LT(report.final_cost, report.initial_cost);
  EXPECT_NEAR(surface.links[0].height_step, 0.0, 0.004);
  EXPECT_NEAR(surface.patches[0].plane.plane.signed_distance({10, 0, 0}), 0.0, 0.002);
  EXPECT_NEAR(surface.links[0].angle, 0.2 * kDegree, 0.05 * kDegree);
  // What was badly known is now known through its neighbour.
  EXPECT_LT(std::sqrt(surface.patches[1].plane.covariance(2, 2)), 0.03);
}

TEST(ConsistencyGraph, InvalidLinksMoveNothing) {
  RoadSurface surface = surface_of({strip(0, 0, 20, 0, 0), strip(1, 20, 40, 0.3, 0)});
  surface.links = find_links(surface, {});
  ASSERT_FALSE(surface.links.at(0).valid);
  const Plane before = surface.patches[1].plane.plane;
  optimise_surface({}, &surface);
  EXPECT_EQ(surface.patches[1].plane.plane.offset, before.offset);
}

TEST(ConsistencyGraph, PaperConsistencyFlattensBreaksThatContinuityKeeps) {
  // Equation 8 of the paper pulls neighbouring normals together; on a bent road that is wrong.
  const auto made = [] {
    RoadSurface surface = surface_of({strip(0, 0, 20, 0, 0), strip(1, 20, 40, 0, 6 * kDegree)});
    for (PlanePatch& patch : surface.patches) {
      patch.plane.covariance = Vector3d(1e-3, 1e-3, 1e-3).asDiagonal();
    }
    surface.links = find_links(surface, {});
    return surface;
  };
  RoadSurface paper = made(), continuity = made();
  ConsistencyOptions options;
  options.consistency = Consistency::kPaper;
  optimise_surface(options, &paper);
  options.consistency = Consistency::kContinuity;
  optimise_surface(options, &continuity);
  EXPECT_LT(paper.links[0].angle, 5 * kDegree);
  EXPECT_NEAR(continuity.links[0].angle, 6 * kDegree, 0.05 * kDegree);
}

TEST(ConsistencyGraph, GradeAndBankFollowTheDrivenLine) {
  RoadSurface surface = surface_of({strip(0, 0, 20, 0, 5 * kDegree)});
  surface.driven_line = {{0, 0, 0}, {20, 0, 1.75}};
  align_patches_with_road(&surface);
  EXPECT_NEAR(surface.patches[0].grade, 5 * kDegree, 1e-9);
  EXPECT_NEAR(surface.patches[0].bank, 0.0, 1e-9);
  surface.driven_line = {{20, 0, 1.75}, {0, 0, 0}};  // driven the other way: downhill
  align_patches_with_road(&surface);
  EXPECT_NEAR(surface.patches[0].grade, -5 * kDegree, 1e-9);
  surface.driven_line = {{0, -4, 0}, {0, 4, 0}};  // driven across: the slope is to the right
  align_patches_with_road(&surface);
  EXPECT_NEAR(surface.patches[0].grade, 0.0, 1e-9);
  EXPECT_NEAR(surface.patches[0].bank, -5 * kDegree, 1e-9);
}

TEST(ConsistencyGraph, ScalingFarPatchesByTheirOwnHeightIsWrongOnAHill) {
  // A camera 1.65 m above a level road sees it climb at 6 degrees from 15 m on. The reconstruction
  // is 10 % too small. Scaling each patch so that the camera is 1.65 m above it needs the far
  // patch's plane under the camera, which is far below: the graph carries the ego patch's scale on.
  const double scale = 0.9, height = 1.65, grade = 6 * kDegree;
  RoadSurface surface = surface_of({strip(0, 4 * scale, 15 * scale, -height * scale, 0),
                                    strip(1, 15 * scale, 40 * scale, -height * scale, grade)});
  surface.links = find_links(surface, {});
  const double ego_scale = height / surface.patches[0].plane.plane.offset;
  EXPECT_NEAR(ego_scale, 1.0 / scale, 1e-9);
  // The far patch's own "camera height" is (1.65 + 15 tan 6 deg) cos 6 deg, not 1.65.
  const double far_scale = height / surface.patches[1].plane.plane.offset;
  const double truth = height / ((height + 15 * std::tan(grade)) * std::cos(grade) * scale);
  EXPECT_NEAR(far_scale, truth, 1e-9);
  // The error in the far patch's distance: half of it is gone.
  EXPECT_LT(far_scale * scale, 0.52);
  ASSERT_EQ(surface.links.size(), 1u);
  EXPECT_TRUE(surface.links[0].valid);  // so the ego patch's scale holds for it
}

TEST(ConsistencyGraph, OptionsAreChecked) {
  ConsistencyOptions options;
  options.link_distance = 0.0;
  EXPECT_THROW(find_links(surface_of({}), options), std::invalid_argument);
  options = {};
  options.continuity_sigma = -1.0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

/// Compares a functor's derivatives with central differences at a random point.
void expect_jacobians_hold(const ceres::CostFunction& cost, std::uint64_t seed) {
  const CounterRandom random(seed, 7);
  std::vector<std::vector<double>> values;
  std::vector<double*> blocks;
  std::uint64_t counter = 0;
  for (const int size : cost.parameter_block_sizes()) {
    values.emplace_back();
    for (int i = 0; i < size; ++i) values.back().push_back(0.02 * random.normal(counter++));
  }
  for (std::vector<double>& value : values) blocks.push_back(value.data());
  const int rows = cost.num_residuals();
  std::vector<double> residual(rows), plus(rows), minus(rows);
  std::vector<std::vector<double>> jacobians;
  std::vector<double*> pointers;
  for (const int size : cost.parameter_block_sizes()) {
    jacobians.emplace_back(static_cast<std::size_t>(rows * size));
  }
  for (std::vector<double>& jacobian : jacobians) pointers.push_back(jacobian.data());
  ASSERT_TRUE(cost.Evaluate(blocks.data(), residual.data(), pointers.data()));
  constexpr double kStep = 1e-6;
  for (std::size_t block = 0; block < values.size(); ++block) {
    for (std::size_t i = 0; i < values[block].size(); ++i) {
      const double middle = values[block][i];
      values[block][i] = middle + kStep;
      cost.Evaluate(blocks.data(), plus.data(), nullptr);
      values[block][i] = middle - kStep;
      cost.Evaluate(blocks.data(), minus.data(), nullptr);
      values[block][i] = middle;
      for (int row = 0; row < rows; ++row) {
        const double numeric = (plus[row] - minus[row]) / (2.0 * kStep);
        const double analytic =
            jacobians[block][static_cast<std::size_t>(row) * values[block].size() + i];
        // Central differences with a step of 1e-6 are good to about 1e-8 of the residual's size.
        EXPECT_NEAR(analytic, numeric, 1e-5 * std::max(1.0, std::abs(numeric)));
      }
    }
  }
}

TEST(ConsistencyGraphJacobian, PlanePrior) {
  Matrix3d root;
  root << 3, 1, 0.5, 0, 2, 0.1, 0, 0, 10;
  const std::unique_ptr<ceres::CostFunction> cost(PlanePrior::create(root));
  expect_jacobians_hold(*cost, 1);
}

TEST(ConsistencyGraphJacobian, HeightContinuity) {
  const std::unique_ptr<ceres::CostFunction> cost(
      HeightContinuity::create(0.03, {5.0, -2.0, 1.0}, {-4.0, 1.0, 1.01}, 0.02));
  expect_jacobians_hold(*cost, 2);
}

TEST(ConsistencyGraphJacobian, PlaneConsistency) {
  const PlanePatch a = strip(0, 0, 20, 0, 0.02), b = strip(1, 20, 40, 0.4, 0.09);
  const std::unique_ptr<ceres::CostFunction> cost(
      PlaneConsistency::create(a.plane, b.plane, {20, 0, 0.4}, 0.05, 0.2));
  expect_jacobians_hold(*cost, 3);
}

TEST(ConsistencyGraphJacobian, HeightJacobianIsThatOfThePerturbedPlane) {
  // The linear step that HeightContinuity takes is that of UncertainPlane::perturbed.
  const PlanePatch patch = strip(0, 0, 20, 1.0, 0.1);
  const Vector3d place(17.0, 3.0, 0.0), up = Vector3d::UnitZ();
  const auto height = [&](const Plane& plane) {
    return -plane.signed_distance(place) / plane.normal.dot(up);
  };
  const Vector3d on_plane = place + height(patch.plane.plane) * up;
  const Eigen::RowVector3d jacobian =
      patch.plane.height_jacobian(on_plane) / patch.plane.plane.normal.dot(up);
  for (int i = 0; i < 3; ++i) {
    constexpr double kStep = 1e-6;
    const double numeric = (height(patch.plane.perturbed(kStep * Vector3d::Unit(i))) -
                            height(patch.plane.perturbed(-kStep * Vector3d::Unit(i)))) /
                           (2.0 * kStep);
    EXPECT_NEAR(jacobian[i], numeric, 1e-6);
  }
}

}  // namespace
}  // namespace camber
