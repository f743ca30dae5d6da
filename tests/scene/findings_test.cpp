#include "camber/scene/findings.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

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
  EXPECT_EQ(found[1].text,
            "Lengths are in metres, known to 2.0 % with 95 % probability (camera height).");
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

}  // namespace
}  // namespace camber
