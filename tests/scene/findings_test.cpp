#include "camber/scene/findings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace camber {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

RoadSurface surface_of(std::initializer_list<Status> statuses) {
  RoadSurface surface;
  for (const Status status : statuses) {
    PlanePatch patch;
    patch.kind = PatchKind::kRoad;
    patch.status = status;
    patch.boundary = {{-1.0, 1.5, 4.0}, {1.0, 1.5, 4.0}, {1.0, 1.5, 31.6}};
    surface.patches.push_back(patch);
  }
  return surface;
}

RunDocument metric_run() {
  RunDocument run;
  run.scale_sigma = 0.01;
  run.scale_status = Status::kOk;
  run.constraints = {{"camera_height", "1.4 m", 0.1, true, ""},
                     {"lane_markings", "", 0.0, false, "none"},
                     {"plane_search", "", 0.0, true, ""}};
  return run;
}

TEST(Findings, ACompleteRunNeedsNoExplanation) {
  const RoadSurface surface = surface_of({Status::kOk, Status::kOk});
  VehicleDocument vehicles;
  vehicles.frames.resize(2);
  vehicles.frames[0].vehicles.resize(1);
  vehicles.frames[0].vehicles[0].status = Status::kOk;
  const auto found = findings(metric_run(), &surface, &vehicles);
  ASSERT_EQ(found.size(), 3u);
  EXPECT_EQ(found[0].text, "Road: 2 planar patches, to 32 m ahead.");
  EXPECT_EQ(found[1].text, "Lengths are in metres, known to 1.0 % (1 sigma) (camera height).");
  EXPECT_EQ(found[2].text, "Vehicles: 1 in 2 frames.");
  for (const Finding& finding : found) EXPECT_TRUE(finding.complete) << finding.text;
}

TEST(Findings, StatusesAreExplained) {
  const RoadSurface surface = surface_of({Status::kOk, Status::kWeak, Status::kNotObservable});
  VehicleDocument vehicles;
  vehicles.frames.resize(1);
  vehicles.frames[0].vehicles.resize(2);
  vehicles.frames[0].vehicles[0].status = Status::kFailed;
  vehicles.frames[0].vehicles[1].status = Status::kOk;
  RunDocument run = metric_run();
  run.scale_status = Status::kWeak;
  run.scale_reason = "relative standard deviation above 5 %";
  const auto found = findings(run, &surface, &vehicles);
  EXPECT_THAT(found[0].text, HasSubstr("1 weak (answered, with a large standard deviation), 1 not "
                                       "observable (a fallback stands in: do not rely on it)."));
  EXPECT_THAT(found[1].text, HasSubstr("That is weak: relative standard deviation above 5 %."));
  EXPECT_EQ(found[2].text, "Vehicles: 2 in 1 frame, 1 failed (no answer).");
  for (const Finding& finding : found) EXPECT_FALSE(finding.complete) << finding.text;
}

TEST(Findings, WhatIsMissingNamesTheOptionThatGivesIt) {
  RoadSurface surface = surface_of({Status::kOk});
  surface.metric = false;
  RunDocument run;
  run.metric = false;
  run.scale_status = Status::kNotObservable;
  run.scale_reason = "no source of metres";
  VehicleDocument vehicles;
  vehicles.frames.resize(3);
  auto found = findings(run, &surface, &vehicles);
  EXPECT_THAT(found[0].text, HasSubstr("to 32 units ahead"));
  EXPECT_THAT(found[1].text, HasSubstr("not in metres (no source of metres)"));
  EXPECT_THAT(found[1].text, HasSubstr("--height of camber import"));
  EXPECT_THAT(found[2].text, HasSubstr("--detections FILE of camber import"));
  // Boxes that lie in other frames are no reason to bring a detector.
  vehicles.detections_source = "network";
  found = findings(run, &surface, &vehicles);
  EXPECT_THAT(found[2].text, HasSubstr("none of these frames"));
  EXPECT_THAT(found[2].text, Not(HasSubstr("--detections")));
  surface.patches.clear();
  EXPECT_EQ(findings(run, &surface, nullptr)[0].text, "No road patch was found.");
  EXPECT_EQ(findings(run, nullptr, nullptr).size(), 1u);
}

TEST(Findings, NameTheFieldOfViewWhereThatIsWhatIsNotKnown) {
  RunDocument run = metric_run();
  run.scale_sigma = 0.093;
  EXPECT_THAT(scale_sentence(run), ::testing::EndsWith("known to 9.3 % (1 sigma)"));
  RunDocument::Calibration& camera = run.calibration.emplace();
  camera.sigma.focal = 0.0929;
  camera.field_of_view = 70.0 / 57.2957795;
  camera.field_of_view_sigma = 5.0 / 57.2957795;
  camera.sigma_of_scale = 0.09;
  EXPECT_THAT(
      scale_sentence(run),
      HasSubstr("9.3 % (1 sigma), since the field of view is known to 5 degrees only (70)"));
  EXPECT_THAT(findings(run, nullptr, nullptr)[0].text, HasSubstr("since the field of view"));
  camera.sigma_of_scale = 0.03;  // something else counts more
  EXPECT_THAT(scale_sentence(run), Not(HasSubstr("field of view")));
}

TEST(Shortcomings, ACompleteRunHasNone) {
  const RoadSurface surface = surface_of({Status::kOk});
  EXPECT_TRUE(shortcomings(metric_run(), &surface, nullptr).empty());
}

TEST(Shortcomings, NameStatusReasonAndTheOptionThatChangesThem) {
  RoadSurface surface = surface_of({Status::kOk, Status::kWeak, Status::kWeak});
  for (int i = 0; i < 3; ++i) {
    surface.patches[static_cast<std::size_t>(i)].id = 4 + i;
    surface.patches[static_cast<std::size_t>(i)].reason = i == 0 ? "" : "few pixels";
  }
  VehicleDocument vehicles;
  vehicles.frames.resize(1);
  vehicles.frames[0].id = 7;
  vehicles.frames[0].vehicles.resize(2);
  vehicles.frames[0].vehicles[0].status = Status::kOk;
  vehicles.frames[0].vehicles[1].id = 3;
  vehicles.frames[0].vehicles[1].status = Status::kNotObservable;
  vehicles.frames[0].vehicles[1].reason = "no road near it";
  RunDocument run = metric_run();
  run.scale_status = Status::kWeak;
  run.scale_reason = "relative standard deviation above 5 %";
  run.constraints.push_back({"lane_markings", "", 7.25, false, "contradicts the others"});
  run.warnings.push_back({"up_missing", "no gravity"});
  const auto all = shortcomings(run, &surface, &vehicles);
  ASSERT_EQ(all.size(), 5u);
  EXPECT_EQ(all[0].what, "scale");
  EXPECT_EQ(all[0].status, "weak");
  EXPECT_EQ(all[0].reason, "relative standard deviation above 5 %");
  EXPECT_THAT(all[0].remedy, HasSubstr("--speed"));
  EXPECT_EQ(all[1].what, "source of scale or road: lane markings");
  EXPECT_EQ(all[1].status, "not used");
  EXPECT_EQ(all[1].reason, "contradicts the others; 7.2 sigma from the others");
  EXPECT_EQ(all[2].what, "patch 5, 6");  // the same status and reason
  EXPECT_EQ(all[2].reason, "few pixels");
  EXPECT_THAT(all[2].remedy, HasSubstr("--frames"));
  EXPECT_EQ(all[3].what, "vehicle id 3 of frame 7");
  EXPECT_EQ(all[3].status, "not_observable");
  EXPECT_THAT(all[3].remedy, HasSubstr("--keypoints"));
  EXPECT_EQ(all[4].what, "warning: up missing");
  EXPECT_EQ(all[4].reason, "no gravity");

  // What was given, or is of no use there, is not asked for.
  const std::vector<ConstraintReport> sources = run.constraints;
  run.constraints = {};
  EXPECT_THAT(shortcomings(run, &surface, &vehicles)[0].remedy, HasSubstr("--height"));
  run.constraints = sources;
  EXPECT_THAT(shortcomings(run, &surface, &vehicles)[0].remedy,
              ::testing::AllOf(Not(HasSubstr("--height")), HasSubstr("--speed")));
  EXPECT_THAT(all[2].remedy, HasSubstr("--segmenter"));
  run.extra["road_from"] = "mask";
  EXPECT_THAT(shortcomings(run, &surface, &vehicles)[2].remedy, Not(HasSubstr("--segmenter")));
  surface.frame = "z-up";
  EXPECT_THAT(shortcomings(run, &surface, &vehicles)[2].remedy,
              ::testing::AllOf(Not(HasSubstr("--segmenter")), Not(HasSubstr("--frames"))));
  surface.patches.clear();
  EXPECT_THAT(shortcomings(metric_run(), &surface, nullptr)[0].reason, HasSubstr("no patch"));
}

}  // namespace
}  // namespace camber
