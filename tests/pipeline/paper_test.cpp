// The paper's own stages and its run (preset kPaper).

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "camber/core/errors.h"
#include "camber/evaluate/metrics.h"
#include "camber/pipeline/reconstruct.h"
#include "pipeline/half_scene.h"
#include "pipeline/made_drive.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::HasSubstr;

VehicleDetection detection(int id, const Box2& box) {
  VehicleDetection out;
  out.id = id;
  out.box = box;
  return out;
}

/// Two vehicles over road and one over the end wall's foot alone, in the reference frame.
test::MadeDrive drive_with_vehicles() {
  test::MadeDriveOptions options;
  options.vehicles.resize(3);
  const test::MadeDrive bare = test::make_drive({});
  const PinholeCamera& camera = bare.frames.camera;
  const auto box_at = [&](double x, double z) {
    // On the road: 1.8 m wide, 1.5 m high.
    const Eigen::Vector3d foot = bare.plane.foot(Eigen::Vector3d(x, 0.0, z));
    const Eigen::Vector2d a = *camera.project(foot + Eigen::Vector3d(-0.9, -1.5, 0.0));
    const Eigen::Vector2d b = *camera.project(foot + Eigen::Vector3d(0.9, 0.0, 0.0));
    return Box2{a.x(), a.y(), b.x(), b.y()};
  };
  const Box2 near = box_at(-1.5, 10.0), far = box_at(1.5, 18.0);
  const Box2 sky{near.x2 + 4.0, 1.0, near.x2 + 14.0, 9.0};
  options.vehicles[1] = {detection(0, near), detection(1, far), detection(2, sky)};
  options.vehicles[2] = {detection(0, sky)};
  return test::make_drive(options);
}

double height_at(const Plane& plane, const Plane& truth, const Eigen::Vector3d& place) {
  return std::abs(plane.signed_distance(truth.foot(place)));
}

TEST(PaperGround, FindsThePlaneUnderEachVehicleByItsOwnPointsElseByItsNeighbours) {
  const test::MadeDrive drive = drive_with_vehicles();
  const Ground ground = test::exact_ground(drive);
  const PaperGround found =
      stages::paper_ground(drive.frames, drive.matches, drive.motion, ground, {});
  EXPECT_TRUE(found.metric);
  EXPECT_NEAR(found.metres_per_baseline, drive.metres_per_baseline,
              0.01 * drive.metres_per_baseline);
  ASSERT_EQ(found.planes.size(), 2u);
  EXPECT_EQ(found.own[1], (std::vector<int>{0, 1, -1}));
  EXPECT_EQ(found.under_vehicles[1][2], 1);   // a small box is far away, next to the farther one
  EXPECT_EQ(found.under_vehicles[2][0], -1);  // nobody else in its image
  for (const RansacPlane& plane : found.planes) {
    EXPECT_LT(height_at(plane.plane.plane, drive.plane, {0.0, 1.5, 14.0}), 0.03);
    EXPECT_GE(plane.points, 50);
  }
  const SupportOptions support;
  const FrameGround last =
      stages::ground_of_frame(found, drive.frames, drive.motion, 2, {}, support);
  EXPECT_FALSE(last.local[0].has_value());
  const SE3 pose = metric_pose(drive.motion, 2, found.metres_per_baseline);
  EXPECT_LT(height_at(last.ego->plane.plane, drive.plane.transformed(pose), {0.0, 1.5, 10.0}),
            0.05);
  const FrameGround middle =
      stages::ground_of_frame(found, drive.frames, drive.motion, 1, {}, support);
  EXPECT_EQ(middle.local[1]->source, "patch 2");
  // A neighbour's plane is trusted less.
  EXPECT_GT(middle.local[2]->plane.covariance(2, 2), middle.local[0]->plane.covariance(2, 2));
}

TEST(PaperGround, ScaleByEachPatchIsThatOfTheRoadOnlyWhereTheRoadIsLevel) {
  // Seen by a camera that looks along a level road the median y is the camera's height; on this
  // grade (0.05 rad) the patch ahead is higher in the image.
  const test::MadeDrive drive = drive_with_vehicles();
  const Ground ground = test::exact_ground(drive);
  stages::PaperGroundOptions options;
  options.scale = PaperScale::kPatch;
  const PaperGround found =
      stages::paper_ground(drive.frames, drive.matches, drive.motion, ground, options);
  for (std::size_t k = 0; k < 2; ++k) {
    const RansacPlane& plane = found.planes[k];
    std::vector<double> y;
    for (const int i : plane.inliers) {
      y.push_back(plane.metres_per_baseline *
                  ground.seen.points.point(static_cast<std::size_t>(i)).y());
    }
    std::nth_element(y.begin(), y.begin() + static_cast<std::ptrdiff_t>(y.size() / 2), y.end());
    EXPECT_NEAR(y[y.size() / 2], *drive.frames.known.camera_height, 1e-9);
    EXPECT_GT(std::abs(std::log(plane.metres_per_baseline / found.metres_per_baseline)), 0.1);
  }
}

TEST(PaperGround, AnEgoPlaneThatNoPointCarriesIsNoAnswer) {
  const test::MadeDrive drive = drive_with_vehicles();
  Ground ground = test::exact_ground(drive);
  ground.ego.points = 0;
  EXPECT_THROW(stages::paper_ground(drive.frames, drive.matches, drive.motion, ground, {}),
               NoAnswerError);
}

TEST(PaperNames, AreReadBack) {
  for (const PaperScale scale : {PaperScale::kEgo, PaperScale::kPatch}) {
    EXPECT_EQ(paper_scale_from_string(to_string(scale)), scale);
  }
  for (const Preset preset : {Preset::kDefault, Preset::kPaper}) {
    EXPECT_EQ(preset_from_string(to_string(preset)), preset);
  }
  for (const paper::Terms terms : {paper::Terms::kMeant, paper::Terms::kPrinted}) {
    EXPECT_EQ(paper::terms_from_string(paper::to_string(terms)), terms);
  }
  EXPECT_THROW(paper_scale_from_string("metres"), std::invalid_argument);
  EXPECT_THROW(preset_from_string("printed"), std::invalid_argument);
  EXPECT_THROW(paper::terms_from_string("paper"), std::invalid_argument);
}

class PaperRun : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    scene_ = std::make_unique<Scene>(read_scene(test::source_dir() / "samples" / "steep_hill"));
  }
  static void TearDownTestSuite() { scene_.reset(); }

  static ReconstructOptions paper(VehicleMethod method = VehicleMethod::kJoint) {
    ReconstructOptions out;
    out.preset = Preset::kPaper;
    out.vehicles.method = method;
    return out;
  }

  static double mean_error(const Reconstruction& result) {
    double sum = 0.0, count = 0.0;
    for (const VehicleError& e : evaluate_vehicles(*scene_, result.vehicles).vehicles) {
      sum += e.center_error;
      count += 1.0;
    }
    return sum / count;
  }
  static std::unique_ptr<Scene> scene_;
};
std::unique_ptr<Scene> PaperRun::scene_;

TEST_F(PaperRun, IsBetterOnItsOwnPlanesThanOnOneForAllAndNamesItself) {
  const Reconstruction joint = reconstruct(*scene_, {0, 1, 2}, paper());
  const double own = mean_error(joint);
  EXPECT_LT(own, 1.5);
  EXPECT_LT(own, mean_error(reconstruct(*scene_, {0, 1, 2}, paper(VehicleMethod::kFlat))));
  EXPECT_LT(own, mean_error(reconstruct(*scene_, {0, 1, 2}, paper(VehicleMethod::kCoplanar))));
  EXPECT_EQ(joint.vehicles.preset, "paper");
  EXPECT_EQ(joint.vehicles.paper_terms, "meant");
  EXPECT_EQ((*joint.run.options)["preset"], "paper");
  EXPECT_EQ((*joint.run.options)["paper_terms"], "meant");
  EXPECT_EQ((*joint.run.options)["paper_scale"], "ego");
  EXPECT_NEAR(joint.run.scale_sigma, 0.01, 0.05);
  // Every vehicle's plane is a patch of the surface, where the vehicle says.
  EXPECT_GT(joint.surface.patches.size(), 3u);
  int own_planes = 0;
  for (const VehicleEstimate& v : joint.vehicles.frames[1].vehicles) {
    if (v.plane_source.rfind("patch ", 0) != 0) continue;
    const PlanePatch* patch = joint.surface.find(std::stoi(v.plane_source.substr(6)));
    ASSERT_TRUE(patch);
    ++own_planes;
    EXPECT_GE(patch->boundary.size(), 3u);
  }
  EXPECT_GE(own_planes, 2);
  EXPECT_EQ(joint.cloud.labels.at("patch").size(), joint.cloud.size());
  const SceneMetrics metrics = evaluate_scene(*scene_, joint.surface, joint.vehicles, joint.run);
  EXPECT_LT(std::abs(metrics.scale_error), 0.05);
}

TEST_F(PaperRun, SameNumbersForAnyNumberOfThreads) {
  ReconstructOptions one = paper(), four = paper();
  one.num_threads = 1;
  four.num_threads = 4;
  const test::TemporaryFolder folder;
  const Scene scene = test::half_size(*scene_, folder.path());
  const Reconstruction a = reconstruct(scene, {0, 1, 2}, one);
  const Reconstruction b = reconstruct(scene, {0, 1, 2}, four);
  ASSERT_GT(a.vehicles.frames.at(1).vehicles.size(), 2u);
  EXPECT_EQ(to_json(a.surface).dump(), to_json(b.surface).dump());
  EXPECT_EQ(to_json(a.vehicles).dump(), to_json(b.vehicles).dump());
}

TEST_F(PaperRun, TakesAPairAndASingleImage) {
  const Reconstruction pair = reconstruct(*scene_, {1, 2}, paper());
  EXPECT_GT(pair.cloud.size(), 500u);
  EXPECT_LT(mean_error(pair), 3.0);
  const Reconstruction single = reconstruct(*scene_, {1}, paper());
  EXPECT_EQ(single.cloud.size(), 0u);
  ASSERT_EQ(single.surface.patches.size(), 1u);
  EXPECT_EQ(single.surface.patches[0].status, Status::kWeak);
  EXPECT_TRUE(single.run.metric);
  EXPECT_GT(mean_error(single), mean_error(pair));  // a level plane on a hill
  // The planes under the vehicles given: one image is enough.
  Scene given = *scene_;
  for (SceneFrame& frame : given.frames) {
    for (VehicleDetection& d : frame.vehicles) {
      for (const TruthFrame& t : given.truth->frames) {
        if (t.id != frame.id) continue;
        for (const TruthVehicle& v : t.vehicles) {
          if (!(intersection_over_union(v.box, d.box) > 0.5) || !v.plane) continue;
          d.has_plane = true;
          d.given_plane = *v.plane;
        }
      }
    }
  }
  EXPECT_LT(mean_error(reconstruct(given, {1}, paper())), 1.0);
  Scene nothing = *scene_;
  nothing.height_above_road.reset();
  try {
    reconstruct(nothing, {1}, paper());
    FAIL() << "one image without metres";
  } catch (const NoAnswerError& e) {
    EXPECT_THAT(e.what(), HasSubstr("height_above_road"));
  }
  nothing.markings_m.clear();
  EXPECT_THROW(reconstruct(nothing, {1}, {}), NoAnswerError);
}

}  // namespace
}  // namespace camber
