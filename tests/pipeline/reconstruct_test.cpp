// The main job on the sample scene, against its truth.

#include "camber/pipeline/reconstruct.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <set>
#include <stdexcept>

#include "camber/core/errors.h"
#include "camber/evaluate/metrics.h"
#include "camber/image/frame_pixels.h"
#include "camber/image/image_io.h"
#include "camber/pipeline/estimate_vehicles.h"
#include "camber/road/plan_polygon.h"
#include "pipeline/half_scene.h"
#include "support/test_data.h"

namespace camber {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
namespace fs = std::filesystem;

Scene sample_scene() { return read_scene(test::source_dir() / "samples" / "steep_hill"); }

SceneMetrics metrics(const Scene& scene, const Reconstruction& result) {
  return evaluate_scene(scene, result.surface, result.vehicles, result.run);
}

double median_height_error(const SceneMetrics& found) {
  std::vector<double> errors;
  for (const VehicleError& v : found.vehicles) errors.push_back(std::abs(v.height_error));
  if (errors.empty()) return std::nan("");
  std::nth_element(errors.begin(), errors.begin() + static_cast<long>(errors.size() / 2),
                   errors.end());
  return errors[errors.size() / 2];
}

/// Runs that several tests look at, made once in a process: of the scene, and of its half size
/// where the test is not of accuracy.
class SteepHillRun : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    if (result_) return;
    scene_ = std::make_unique<Scene>(sample_scene());
    ReconstructOptions options;
    options.num_threads = 1;
    result_ = std::make_unique<Reconstruction>(reconstruct(*scene_, {0, 1, 2}, options));
    folder_of_half_ = std::make_unique<test::TemporaryFolder>();
    half_ = std::make_unique<Scene>(test::half_size(*scene_, folder_of_half_->path()));
    half_result_ = std::make_unique<Reconstruction>(reconstruct(*half_, {0, 1, 2}, options));
  }
  static std::unique_ptr<Scene> scene_, half_;
  static std::unique_ptr<Reconstruction> result_, half_result_;
  static std::unique_ptr<test::TemporaryFolder> folder_of_half_;
};
std::unique_ptr<Scene> SteepHillRun::scene_, SteepHillRun::half_;
std::unique_ptr<Reconstruction> SteepHillRun::result_, SteepHillRun::half_result_;
std::unique_ptr<test::TemporaryFolder> SteepHillRun::folder_of_half_;

TEST_F(SteepHillRun, IsRightAgainstTheTruth) {
  const SceneMetrics found = metrics(*scene_, *result_);
  // The camera's height of 1.65 m is known to about a centimetre of suspension (0.6 %), and the
  // road bends into a 16 % climb before it comes into view.
  EXPECT_LT(std::abs(found.scale_error), 0.03);
  EXPECT_LT(found.rotation_error, 2e-3);  // 1.5 px at this focal length
  EXPECT_LT(found.direction_error, 1e-2);
  EXPECT_LT(std::abs(found.ego_height_error), 0.05);  // the same 3 % of 1.65 m
  // 4 % of the camera's height is the aim for far cars; of five, more than half must be within
  // twice that.
  EXPECT_LT(median_height_error(found), 0.15);
  EXPECT_GE(found.counted, 5);
  // The scene's detections leave two counted cars without a matching box.
  EXPECT_LE(found.missed, 2);
  EXPECT_EQ(found.unanswered, 0);
  EXPECT_GE(found.covered_within_40, 0.95 * found.within_40);
}

TEST_F(SteepHillRun, HoldsWhatItPromises) {
  const Reconstruction& r = *result_;
  EXPECT_EQ(r.frame_ids, (std::vector<int>{0, 1, 2}));
  EXPECT_EQ(r.reference_frame, 1);
  EXPECT_TRUE(r.surface.metric);
  EXPECT_TRUE(r.run.metric);
  EXPECT_TRUE(r.vehicles.metric);
  EXPECT_GT(r.surface.scale_sigma, 0.0);
  EXPECT_LT(r.surface.scale_sigma, 0.1);
  EXPECT_EQ(r.vehicles.method, "joint");
  EXPECT_EQ(r.vehicles.detections_source, scene_->detections_source);
  ASSERT_EQ(r.vehicles.frames.size(), 3u);
  for (std::size_t f = 0; f < 3; ++f) {
    const VehicleFrame& frame = r.vehicles.frames[f];
    EXPECT_EQ(frame.id, static_cast<int>(f));
    std::set<int> given, kept;
    for (const VehicleDetection& d : scene_->frames[f].vehicles) given.insert(d.id);
    for (const VehicleEstimate& v : frame.vehicles) kept.insert(v.id);
    EXPECT_EQ(kept, given) << "frame " << f;
  }
  ASSERT_EQ(r.run.cameras.size(), 3u);
  EXPECT_EQ(r.run.cameras[1].reference_from_camera.matrix(), Eigen::Matrix4d::Identity());

  r.cloud.validate();
  EXPECT_GT(r.cloud.size(), 5000u);
  EXPECT_EQ(r.cloud.frame, CloudFrame::kCamera);
  EXPECT_EQ(r.cloud.sigmas.size(), r.cloud.size());
  EXPECT_EQ(r.cloud.colors.size(), r.cloud.size());
  ASSERT_EQ(r.cloud.labels.count("patch"), 1u);
  for (const float sigma : r.cloud.sigmas) ASSERT_TRUE(sigma > 0.0f && std::isfinite(sigma));
  for (const int id : r.cloud.labels.at("patch")) {
    ASSERT_TRUE(id == -1 || r.surface.find(id) != nullptr) << id;
  }
  const PlanePatch* ego = r.surface.find(r.surface.ego_patch);
  ASSERT_NE(ego, nullptr);
  EXPECT_NEAR(ego->plane.plane.offset, 1.65, 0.05);
  for (const PlanePatch& patch : r.surface.patches) {
    EXPECT_NEAR(patch.plane.plane.normal.norm(), 1.0, 1e-9);
    EXPECT_GT(patch.plane.plane.normal.dot(r.surface.up), 0.0);
    EXPECT_GE(patch.boundary.size(), 3u);
  }
}

/// The patch that a vehicle names as its ground; nullptr: it stands on another plane.
const PlanePatch* patch_of(const RoadSurface& surface, const VehicleEstimate& vehicle) {
  if (vehicle.plane_source.rfind("patch ", 0) != 0) return nullptr;
  return surface.find(std::stoi(vehicle.plane_source.substr(6)));
}

TEST_F(SteepHillRun, AGradeIsPositiveOnAClimbUnderOncomingCarsToo) {
  const SceneMetrics found = metrics(*scene_, *result_);
  int oncoming = 0, climbs = 0;
  for (const VehicleError& match : found.vehicles) {
    for (const TruthVehicle& truth : scene_->truth->frames.at(match.frame).vehicles) {
      if (truth.id != match.truth_id) continue;
      const auto& estimates = result_->vehicles.frames.at(match.frame).vehicles;
      const auto estimate = std::find_if(estimates.begin(), estimates.end(),
                                         [&](const auto& e) { return e.id == match.estimate_id; });
      const PlanePatch* patch = patch_of(result_->surface, *estimate);
      if (!patch) continue;
      // Ahead of the camera: the rise of the plane under the car along z.
      const Eigen::Vector3d& n = truth.plane->normal;
      const double grade = std::atan(n.z() / n.y());
      const bool towards = truth.pose.camera_from_vehicle.rotation_matrix()(2, 0) < 0.0;
      oncoming += towards ? 1 : 0;
      EXPECT_GT(patch->plane.axis1.z(), 0.0) << patch->id;
      if (grade < 0.07) continue;  // 4 degrees; less does not tell the sign
      climbs += towards ? 1 : 0;
      EXPECT_GT(patch->grade, 0.0) << "patch " << patch->id << ", truth " << grade;
    }
  }
  EXPECT_GE(oncoming, 4);
  EXPECT_GE(climbs, 4);
  // A link compares the same direction of both.
  for (const PatchLink& link : result_->surface.links) {
    EXPECT_GT(
        result_->surface.find(link.a)->plane.axis1.dot(result_->surface.find(link.b)->plane.axis1),
        0.8)
        << link.a << " and " << link.b;
  }
}

TEST_F(SteepHillRun, ALinkIsAsLongAsTheGapBetweenTheBoundaries) {
  const RoadSurface& surface = result_->surface;
  ASSERT_GE(surface.links.size(), 5u);
  const GroundAxes axes(surface.up);
  // The nearest of many places along both boundaries; 0 where one lies inside the other.
  const auto places = [&](const PlanePatch& patch) {
    PlanPolygon out;
    for (std::size_t i = 0; i < patch.boundary.size(); ++i) {
      const Eigen::Vector3d &from = patch.boundary[i],
                            &to = patch.boundary[(i + 1) % patch.boundary.size()];
      for (int k = 0; k < 100; ++k) out.push_back(axes(from + 0.01 * k * (to - from)));
    }
    return out;
  };
  const auto corners = [&](const PlanePatch& patch) {
    PlanPolygon out;
    for (const Eigen::Vector3d& corner : patch.boundary) out.push_back(axes(corner));
    return out;
  };
  int shorter = 0;
  for (const PatchLink& link : surface.links) {
    const PlanePatch &a = *surface.find(link.a), &b = *surface.find(link.b);
    double gap = std::numeric_limits<double>::infinity();
    for (const auto& [from, to] : {std::pair{&a, &b}, std::pair{&b, &a}}) {
      for (const Eigen::Vector2d& place : places(*from)) {
        gap = std::min(gap, distance_to_polygon(corners(*to), place));
      }
    }
    EXPECT_NEAR(link.distance, gap, 0.1) << link.a << " and " << link.b;  // the step of the places
    shorter += link.distance < 0.8 * (a.plane.centroid - b.plane.centroid).norm() ? 1 : 0;
  }
  EXPECT_GE(shorter, 3);
}

TEST_F(SteepHillRun, TheGraphIsAForestWhoseLinksHoldTheVehiclesToo) {
  const RoadSurface& surface = result_->surface;
  std::map<int, int> root;  // of each patch
  for (const PlanePatch& patch : surface.patches) root[patch.id] = patch.id;
  int valid = 0;
  double squares = 0.0;
  for (const PatchLink& link : surface.links) {
    if (!link.valid) continue;
    ++valid;
    const int from = root.at(link.a), to = root.at(link.b);
    EXPECT_NE(from, to) << "a loop over " << link.a << " and " << link.b;
    for (auto& [id, of] : root) of = of == to ? from : of;
    ASSERT_TRUE(std::isfinite(link.residual_sigma));
    squares += link.residual_sigma * link.residual_sigma;
  }
  // No kerb: one tree over the road and the ground under all vehicles.
  EXPECT_EQ(valid + 1, static_cast<int>(surface.patches.size()));
  // The vehicles have moved it, by no more than was to be expected.
  EXPECT_GT(squares, 0.0);
  EXPECT_LT(squares / valid, 2.0);
}

TEST_F(SteepHillRun, VehiclesJoinedOverFramesNameTheirTrack) {
  const SceneMetrics found = metrics(*scene_, *result_);
  std::map<int, std::set<int>> frames, cars;  // by track
  for (const VehicleFrame& frame : result_->vehicles.frames) {
    for (const VehicleEstimate& v : frame.vehicles) {
      if (v.track < 0) continue;
      EXPECT_TRUE(frames[v.track].insert(frame.id).second) << "track " << v.track << " twice";
      for (const VehicleError& match : found.vehicles) {
        if (match.frame == frame.id && match.estimate_id == v.id) {
          cars[v.track].insert(match.truth_id);
        }
      }
    }
  }
  const auto joined = std::count_if(frames.begin(), frames.end(),
                                    [](const auto& track) { return track.second.size() >= 2; });
  EXPECT_GE(joined, 3);
  for (const auto& [track, of] : cars) EXPECT_EQ(of.size(), 1u) << "track " << track;
  int written = 0;
  const nlohmann::json document = to_json(result_->vehicles);
  for (const auto& frame : document["frames"]) {
    for (const auto& vehicle : frame["vehicles"]) written += vehicle.contains("track") ? 1 : 0;
  }
  EXPECT_GE(written, 6);
}

TEST_F(SteepHillRun, VehiclesAgainOnItsSurfaceFindTheirPatches) {
  EstimateVehiclesOptions options;
  options.surface = &result_->surface;
  options.cameras = &result_->run.cameras;
  const VehicleDocument again = estimate_vehicles(*scene_, {0, 1, 2}, options);
  int vehicles = 0;
  for (std::size_t k = 0; k < again.frames.size(); ++k) {
    for (std::size_t j = 0; j < again.frames[k].vehicles.size(); ++j) {
      const VehicleEstimate& vehicle = again.frames[k].vehicles[j];
      const VehicleEstimate& before = result_->vehicles.frames[k].vehicles[j];
      ++vehicles;
      const PlanePatch* patch = patch_of(result_->surface, vehicle);
      ASSERT_NE(patch, nullptr) << "frame " << k << ", " << vehicle.id << ": on "
                                << vehicle.plane_source;
      // It lies where the vehicle stood: within its own spread and a hand's breadth.
      const SE3& reference_from_camera = result_->run.cameras[k].reference_from_camera;
      const Eigen::Vector3d place = reference_from_camera * before.pose.bottom_center();
      const double sigma =
          std::hypot(std::sqrt(patch->plane.height_variance(place)), before.plane_sigma_height);
      EXPECT_LT(std::abs(patch->plane.plane.signed_distance(place)), 0.1 + 3.0 * sigma)
          << "frame " << k << ", " << vehicle.id;
    }
  }
  EXPECT_EQ(vehicles, 13);
}

TEST_F(SteepHillRun, PatchesArePavementWhereTheMasksShowIt) {
  const auto count = [](const RoadSurface& surface, PatchKind kind) {
    return std::count_if(surface.patches.begin(), surface.patches.end(),
                         [&](const PlanePatch& patch) { return patch.kind == kind; });
  };
  // All patches along the driven line are road, also where the car ahead hides it.
  std::set<int> under_vehicles;
  for (const VehicleFrame& frame : result_->vehicles.frames) {
    for (const VehicleEstimate& vehicle : frame.vehicles) {
      if (const PlanePatch* patch = patch_of(result_->surface, vehicle)) {
        under_vehicles.insert(patch->id);
      }
    }
  }
  int along = 0;
  for (const PlanePatch& patch : result_->surface.patches) {
    if (under_vehicles.count(patch.id) > 0) continue;
    ++along;
    EXPECT_EQ(patch.kind, PatchKind::kRoad) << patch.id;
  }
  EXPECT_GE(along, 8);
  // The same ground with the labels exchanged: what was road is pavement, and the other way round.
  Scene scene = *half_;
  std::swap(scene.segmentation_classes["road"], scene.segmentation_classes["pavement"]);
  const Reconstruction swapped = reconstruct(scene, {0, 1, 2}, {});
  EXPECT_GT(count(swapped.surface, PatchKind::kPavement),
            count(half_result_->surface, PatchKind::kPavement));
  const nlohmann::json json = to_json(swapped.surface);
  EXPECT_EQ(std::count_if(json["patches"].begin(), json["patches"].end(),
                          [](const nlohmann::json& p) { return p["kind"] == "pavement"; }),
            count(swapped.surface, PatchKind::kPavement));
  const PlanePatch* before = half_result_->surface.find(1);
  const PlanePatch* after = swapped.surface.find(1);
  ASSERT_TRUE(before && after);
  EXPECT_EQ(before->kind, PatchKind::kRoad);
  EXPECT_EQ(after->kind, PatchKind::kPavement);
}

TEST_F(SteepHillRun, NamesItsPresetAndItsKeypoints) {
  EXPECT_EQ((*result_->run.options)["keypoint_set"], 36);
  EXPECT_EQ(result_->vehicles.preset, "default");
  EXPECT_EQ(result_->vehicles.keypoint_set, 36);
  ReconstructOptions options;
  options.vehicles.fit.keypoint_set = KeypointSet::kSmall14;
  const Reconstruction result = reconstruct(*half_, {0, 1}, options);
  EXPECT_EQ((*result.run.options)["keypoint_set"], 14);
  EXPECT_EQ(result.vehicles.keypoint_set, 14);
  const test::TemporaryFolder folder;
  write_json(to_json(result.vehicles), folder.path() / "vehicles.json");
  const VehicleDocument read = read_vehicles(folder.path() / "vehicles.json");
  EXPECT_EQ(read.preset, "default");
  EXPECT_EQ(read.keypoint_set, 14);
}

/// Everything that the two runs found is the same, bit for bit.
void expect_identical(const Reconstruction& a, const Reconstruction& b) {
  // JSON numbers are written so that they read back as the same double.
  EXPECT_EQ(to_json(a.surface).dump(), to_json(b.surface).dump());
  EXPECT_EQ(to_json(a.vehicles).dump(), to_json(b.vehicles).dump());
  EXPECT_EQ(a.run.scale, b.run.scale);
  EXPECT_EQ(a.run.scale_sigma, b.run.scale_sigma);
  EXPECT_EQ(a.run.points_kept, b.run.points_kept);
  EXPECT_EQ(a.run.points_dropped, b.run.points_dropped);
  ASSERT_EQ(a.run.cameras.size(), b.run.cameras.size());
  for (std::size_t i = 0; i < a.run.cameras.size(); ++i) {
    EXPECT_EQ(a.run.cameras[i].reference_from_camera.matrix(),
              b.run.cameras[i].reference_from_camera.matrix());
  }
  EXPECT_EQ(a.cloud.points, b.cloud.points);
  EXPECT_EQ(a.cloud.colors, b.cloud.colors);
  EXPECT_EQ(a.cloud.sigmas, b.cloud.sigmas);
  EXPECT_EQ(a.cloud.covariances, b.cloud.covariances);
  EXPECT_EQ(a.cloud.labels, b.cloud.labels);
  EXPECT_EQ(a.cloud.scalars, b.cloud.scalars);
}

/// The same points of the same road, whose scale differs by less than its uncertainty.
void expect_same_road(const Reconstruction& a, const Reconstruction& b) {
  EXPECT_LT(std::abs(std::log(a.run.scale / b.run.scale)), 0.5 * a.run.scale_sigma);
  EXPECT_EQ(a.run.points_kept, b.run.points_kept);
  ASSERT_EQ(a.cloud.size(), b.cloud.size());
  for (std::size_t i = 0; i < a.cloud.size(); ++i) {
    const float sigma = std::max(a.cloud.sigmas[i], b.cloud.sigmas[i]);
    ASSERT_LT((a.cloud.points[i] - b.cloud.points[i]).norm(), 3.0f * sigma) << i;
  }
}

TEST_F(SteepHillRun, TruthIsNotReadImagesMayLieInMemoryAndTwoThreadsFindTheSame) {
  Scene blind = *half_;
  blind.truth.reset();
  std::map<int, FramePixels> pixels;
  for (SceneFrame& frame : blind.frames) {
    pixels[frame.id].image = read_color_image(frame.image);
    pixels[frame.id].segmentation = read_label_image(frame.segmentation, blind.camera);
    frame.image.clear();
    frame.segmentation.clear();
  }
  ReconstructOptions options;
  options.num_threads = 2;
  options.load.pixels = pixels_in_memory(pixels);
  EXPECT_EQ(choose_frames(blind, options.load.pixels).ids, choose_frames(*half_).ids);
  const Reconstruction held = reconstruct(blind, {0, 1, 2}, options);
  expect_identical(*half_result_, held);
  EXPECT_EQ(held.images[1].data, half_result_->images[1].data);
}

TEST_F(SteepHillRun, WithoutMasksTheRoadIsFoundByGeometry) {
  ReconstructOptions options;
  options.load.use_masks = false;
  const Reconstruction result = reconstruct(*scene_, {0, 1, 2}, options);
  const SceneMetrics found = metrics(*scene_, result);
  EXPECT_LT(std::abs(found.scale_error), 0.03);
  EXPECT_LT(median_height_error(found), 0.15);
  EXPECT_EQ(result.run.extra["road_width"]["status"], "not used");
  EXPECT_EQ(result.run.extra["road_width"]["reason"], "no mask shows where the road ends");
  // The masks were not read: a scene that has none gives the same.
  Scene bare = *half_;
  for (SceneFrame& frame : bare.frames) {
    frame.segmentation.clear();
    frame.road_mask.clear();
  }
  expect_identical(reconstruct(*half_, {0, 1, 2}, options), reconstruct(bare, {0, 1, 2}, {}));
}

TEST_F(SteepHillRun, TwoFramesAreEnough) {
  const Reconstruction result = reconstruct(*scene_, {0, 1}, {});
  EXPECT_EQ(result.reference_frame, 1);
  const SceneMetrics found = metrics(*scene_, result);
  // Half the baseline, half the matches: twice the bounds of three frames.
  EXPECT_LT(std::abs(found.scale_error), 0.06);
  EXPECT_LT(median_height_error(found), 0.30);
}

TEST_F(SteepHillRun, FlatAndCoplanarPutAllVehiclesOnOnePlane) {
  for (const char* method : {"flat", "coplanar"}) {
    SCOPED_TRACE(method);
    ReconstructOptions options;
    options.vehicles.method = vehicle_method_from_string(method);
    const Reconstruction result = reconstruct(*half_, {0, 1, 2}, options);
    EXPECT_EQ(result.vehicles.method, method);
    // What joint vehicles measure of the road is small beside its own uncertainty.
    expect_same_road(result, *half_result_);
    for (const VehicleFrame& frame : result.vehicles.frames) {
      ASSERT_FALSE(frame.vehicles.empty());
      const Plane& first = frame.vehicles[0].plane;
      for (const VehicleEstimate& v : frame.vehicles) {
        EXPECT_EQ(v.plane.normal, first.normal);
        EXPECT_EQ(v.plane.offset, first.offset);
      }
      if (std::string(method) == "flat") {
        EXPECT_EQ(first.normal, Eigen::Vector3d(0, -1, 0));
        EXPECT_EQ(first.offset, 1.65);
      }
    }
    // On a hill of 12 degrees they are far off where joint is not.
    EXPECT_GT(median_height_error(metrics(*half_, result)), 0.3);
  }
}

TEST_F(SteepHillRun, WithoutACameraHeightTheResultIsUpToScale) {
  Scene scene = *half_;
  scene.height_above_road.reset();
  const Reconstruction result = reconstruct(scene, {0, 1, 2}, {});
  EXPECT_FALSE(result.surface.metric);
  EXPECT_FALSE(result.run.metric);
  EXPECT_FALSE(result.vehicles.metric);
  EXPECT_FALSE(result.cloud.metric);
  EXPECT_GT(result.cloud.size(), 5000u);
}

TEST_F(SteepHillRun, GivenPosesGiveTheMetresAndAreCheckedByTheImages) {
  Scene scene = *half_;
  for (SceneFrame& frame : scene.frames) {
    for (const TruthFrame& truth : scene.truth->frames) {
      if (truth.id == frame.id) frame.world_from_camera = truth.world_from_camera;
    }
  }
  scene.height_above_road.reset();
  scene.markings_m.clear();
  ReconstructOptions options;
  options.num_threads = 1;
  const Reconstruction right = reconstruct(scene, {0, 1, 2}, options);
  EXPECT_TRUE(right.run.metric);
  EXPECT_LT(std::abs(metrics(scene, right).scale_error), 0.005);
  EXPECT_THAT(right.run.warnings, IsEmpty());
  // One of them a degree off: the images give the motion, the positions the metres.
  SE3& last = *scene.frames[2].world_from_camera;
  last = last * SE3(rotation_from_vector({0.012, 0.012, 0.0}), Eigen::Vector3d::Zero());
  const Reconstruction wrong = reconstruct(scene, {0, 1, 2}, options);
  ASSERT_FALSE(wrong.run.warnings.empty());
  EXPECT_EQ(wrong.run.warnings[0].code, "poses_contradicted");
  EXPECT_THAT(wrong.run.warnings[0].text, HasSubstr("frame 2: "));
  EXPECT_TRUE(wrong.run.metric);
  EXPECT_LT(wrong.run.scale_sigma, 0.025);
  EXPECT_LT(std::abs(metrics(scene, wrong).scale_error), 2.0 * wrong.run.scale_sigma);
  EXPECT_EQ(wrong.run.extra["scale_from"]["source"], "given positions");
  // All of them turn by more than the images, as poses of another moment do, and are half as far
  // apart: there are no metres in them.
  for (std::size_t k = 0; k < scene.frames.size(); ++k) {
    scene.frames[k].world_from_camera =
        SE3(rotation_from_vector({0.0, 0.021 * static_cast<double>(k), 0.0}),
            Eigen::Vector3d(0.0, 0.0, 0.5 * static_cast<double>(k)));
  }
  const Reconstruction other = reconstruct(scene, {0, 1, 2}, options);
  ASSERT_FALSE(other.run.warnings.empty());
  EXPECT_THAT(other.run.warnings[0].text, HasSubstr("other moments"));
  EXPECT_FALSE(other.run.metric);
}

TEST_F(SteepHillRun, MarkingsSharpenTheScaleAndCanBeLeftOut) {
  EXPECT_EQ(half_result_->run.extra["markings"]["status"], "used");
  EXPECT_GE(half_result_->run.extra["markings"]["dashes"], 2);
  ReconstructOptions options;
  options.scale.use_markings = false;
  const Reconstruction without = reconstruct(*half_, {0, 1, 2}, options);
  EXPECT_EQ(without.run.extra["markings"]["status"], "not run");
  EXPECT_LT(half_result_->surface.scale_sigma, without.surface.scale_sigma);
}

// By a height that is wrong, two far strokes fit a road that bends for them, and the near one,
// which does not, is none of theirs.
TEST_F(SteepHillRun, MarkingsNearTheCameraContradictAWrongHeight) {
  ReconstructOptions options;
  options.vehicles.enabled = false;
  options.num_threads = 1;
  for (const double factor : {0.8, 1.2}) {
    Scene scene = *scene_;
    *scene.height_above_road *= factor;
    const Reconstruction result = reconstruct(scene, {0, 1, 2}, options);
    ASSERT_FALSE(result.run.warnings.empty()) << factor;
    EXPECT_EQ(result.run.warnings[0].code, "scale_contradicted") << factor;
    EXPECT_THAT(result.run.warnings[0].text, HasSubstr("lane_markings")) << factor;
    EXPECT_LT(std::abs(metrics(scene, result).scale_error), 2.0 * result.run.scale_sigma) << factor;
  }
}

// The height is the surest source, so that the result lies near it: that it contradicts the rest by
// two standard deviations and more widens the scale by what it differs from the rest.
TEST_F(SteepHillRun, AHeightThatIsALittleOffWidensTheScale) {
  Scene scene = *scene_;
  *scene.height_above_road *= 1.08;
  ReconstructOptions options;
  options.num_threads = 1;
  const Reconstruction result = reconstruct(scene, {0, 1, 2}, options);
  EXPECT_THAT(result.run.warnings, IsEmpty());
  EXPECT_LT(std::abs(metrics(scene, result).scale_error), 1.6 * result.run.scale_sigma);
  EXPECT_LT(result.run.scale_sigma, 2.5 * result_->run.scale_sigma);
}

TEST_F(SteepHillRun, TheRoadsWidthIsUsedWhereAMaskShowsItAndCanBeLeftOut) {
  EXPECT_EQ(result_->run.extra["road_width"]["status"], "used");
  EXPECT_GE(result_->run.extra["road_width"]["places"], 8);
  EXPECT_GT(result_->run.extra["road_width"]["farthest"], 25.0);
  ReconstructOptions options;
  options.scale.use_road_width = false;
  options.vehicles.enabled = false;
  EXPECT_EQ(reconstruct(*half_, {0, 1, 2}, options).run.extra["road_width"]["status"], "not run");
}

TEST_F(SteepHillRun, TheRoadAlone) {
  ReconstructOptions options;
  options.vehicles.enabled = false;
  const Reconstruction result = reconstruct(*half_, {0, 1, 2}, options);
  for (const VehicleFrame& frame : result.vehicles.frames) EXPECT_TRUE(frame.vehicles.empty());
  expect_same_road(result, *half_result_);
}

TEST_F(SteepHillRun, FramesThatCannotAnswerSaySo) {
  Scene unmarked = *half_;
  unmarked.markings_m.clear();
  EXPECT_THROW(reconstruct(unmarked, {1}, {}), NoAnswerError);
  std::vector<int> many(65);
  std::iota(many.begin(), many.end(), 0);
  EXPECT_THROW(reconstruct(*half_, many, {}), std::invalid_argument);
  Scene standing = *half_;
  standing.frames[0].image = standing.frames[1].image;
  try {
    reconstruct(standing, {0, 1}, {});
    ADD_FAILURE() << "a standing camera gave an answer";
  } catch (const NoAnswerError& e) {
    EXPECT_THAT(e.what(), HasSubstr("no parallax"));
  }
  Scene missing = *half_;
  missing.frames[2].image = "no/such/image.png";
  EXPECT_THROW(reconstruct(missing, {0, 1, 2}, {}), InputError);
}

TEST_F(SteepHillRun, ImagesOfAFewPixelsCannotAnswer) {
  Scene tiny = *half_;
  tiny.camera = {8, 6, 5.0, 5.0, 3.5, 2.5};
  for (SceneFrame& frame : tiny.frames) {
    frame.segmentation.clear();
    frame.vehicles.clear();
  }
  ReconstructOptions options;
  options.load.pixels = [](int id) {
    FramePixels out;
    out.image = {8, 6, 1, std::vector<std::uint8_t>(48, static_cast<std::uint8_t>(40 * id))};
    return out;
  };
  try {
    reconstruct(tiny, {0, 1, 2}, options);
    ADD_FAILURE() << "48 pixels gave an answer";
  } catch (const NoAnswerError& e) {
    EXPECT_THAT(e.what(), HasSubstr("0 matched points"));
  }
}

TEST_F(SteepHillRun, ProgressIsToldAndMayInterrupt) {
  std::set<std::string> stages;
  const Progress listen = [&](const std::string& stage, double share) {
    EXPECT_GE(share, 0.0);
    EXPECT_LE(share, 1.0);
    stages.insert(stage);
    if (stage == "motion") throw InterruptedError();
  };
  EXPECT_THROW(reconstruct(*half_, {0, 1, 2}, {}, listen), InterruptedError);
  EXPECT_EQ(stages.count("motion"), 1u);
}

TEST(ReconstructOptions, ValidateNamesTheField) {
  ReconstructOptions options;
  EXPECT_NO_THROW(options.validate());
  try {
    vehicle_method_from_string("best");
    ADD_FAILURE();
  } catch (const std::invalid_argument& e) {
    EXPECT_THAT(e.what(), HasSubstr("best"));
  }
  options.rounds = -1;
  EXPECT_THROW(options.validate(), std::invalid_argument);
  options = {};
  options.surface.patch_length = 0.0;
  EXPECT_THROW(options.validate(), std::invalid_argument);
}

std::map<std::string, std::string> files_below(const fs::path& folder) {
  std::map<std::string, std::string> out;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    std::string content = "/";
    if (entry.is_regular_file()) {
      std::ifstream in(entry.path(), std::ios::binary);
      content.assign(std::istreambuf_iterator<char>(in), {});
    }
    out[fs::relative(entry.path(), folder).string()] = content;
  }
  return out;
}

class WriteReconstruction : public SteepHillRun {
 protected:
  WriteReconstruction() { options_.pictures = false; }
  void put(const std::string& name, const std::string& content) {
    fs::create_directories((folder_.path() / name).parent_path());
    std::ofstream(folder_.path() / name) << content;
  }
  Reconstruction result_copy_ = *result_;
  WriteReconstructionOptions options_;
  test::TemporaryFolder folder_;
};

TEST_F(WriteReconstruction, LeavesAForeignFolderAlone) {
  put("out/thesis.txt", "years of work");
  const auto before = files_below(folder_.path());
  EXPECT_THROW(write_reconstruction(*scene_, result_copy_, folder_.path() / "out", options_),
               OutputError);
  EXPECT_EQ(files_below(folder_.path()), before);
  options_.overwrite = true;
  write_reconstruction(*scene_, result_copy_, folder_.path() / "out", options_);
  EXPECT_FALSE(fs::exists(folder_.path() / "out" / "thesis.txt"));
  EXPECT_TRUE(fs::exists(folder_.path() / "out" / "run.json"));
}

TEST_F(WriteReconstruction, ReplacesAnOlderResultWholly) {
  put("out/run.json", "{}");
  put("out/leftover.txt", "old");
  const std::string summary =
      write_reconstruction(*scene_, result_copy_, folder_.path() / "out", options_);
  EXPECT_NE(summary, "");
  const auto after = files_below(folder_.path());
  EXPECT_EQ(after.count("out/leftover.txt"), 0u);
  for (const char* name : {"out/road.ply", "out/surface.json", "out/vehicles.json", "out/run.json",
                           "out/metrics.json"}) {
    EXPECT_EQ(after.count(name), 1u) << name;
  }
  for (const auto& [name, content] : after) {
    EXPECT_THAT(name, ::testing::StartsWith("out")) << "left behind";
  }
  const RoadSurface surface = read_surface(folder_.path() / "out" / "surface.json");
  // Angles are written in degrees: rounding alone.
  ASSERT_EQ(surface.patches.size(), result_->surface.patches.size());
  for (std::size_t i = 0; i < surface.patches.size(); ++i) {
    const Plane& read = surface.patches[i].plane.plane;
    const Plane& written = result_->surface.patches[i].plane.plane;
    EXPECT_LT((read.normal - written.normal).norm(), 1e-12);
    EXPECT_NEAR(read.offset, written.offset, 1e-9);
  }
  const VehicleDocument vehicles = read_vehicles(folder_.path() / "out" / "vehicles.json");
  ASSERT_EQ(vehicles.frames.size(), result_->vehicles.frames.size());
  for (std::size_t f = 0; f < vehicles.frames.size(); ++f) {
    ASSERT_EQ(vehicles.frames[f].vehicles.size(), result_->vehicles.frames[f].vehicles.size());
    for (std::size_t i = 0; i < vehicles.frames[f].vehicles.size(); ++i) {
      EXPECT_LT((vehicles.frames[f].vehicles[i].pose.bottom_center() -
                 result_->vehicles.frames[f].vehicles[i].pose.bottom_center())
                    .norm(),
                1e-9);
    }
  }
  EXPECT_EQ(read_run(folder_.path() / "out" / "run.json").scale, result_->run.scale);
}

TEST_F(WriteReconstruction, WithoutTruthThereAreNoMetrics) {
  Scene blind = *scene_;
  blind.truth.reset();
  const std::string summary =
      write_reconstruction(blind, result_copy_, folder_.path() / "out", options_);
  EXPECT_EQ(summary, "");
  EXPECT_FALSE(fs::exists(folder_.path() / "out" / "metrics.json"));
  EXPECT_TRUE(fs::exists(folder_.path() / "out" / "surface.json"));
}

TEST_F(WriteReconstruction, AnInterruptedWriteLeavesNothing) {
  const Progress interrupt = [](const std::string&, double) { throw InterruptedError(); };
  EXPECT_THROW(
      write_reconstruction(*scene_, result_copy_, folder_.path() / "out", options_, interrupt),
      InterruptedError);
  EXPECT_TRUE(files_below(folder_.path()).empty());
}

}  // namespace
}  // namespace camber
