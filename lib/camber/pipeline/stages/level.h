#pragma once

#include "camber/road/road_surface.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber::stages {

/// Turns the surface's up, and the grades and banks of its patches, from the reference camera's
/// level to gravity's, where frames of the run know that (SceneFrame::up): the mean over them by
/// their standard deviations. Their errors are taken to be common (the sensor's mounting), so that
/// more frames do not make it better known. Where the frames contradict each other beyond four
/// standard deviations the level stays the camera's, with a warning in `run`.
void level_by_gravity(const Scene& scene, RunDocument* run, RoadSurface* surface);

}  // namespace camber::stages
