#pragma once

#include "camber/pipeline/stages/assemble.h"
#include "camber/pipeline/stages/load.h"

namespace camber::stages {

/// Puts what the camera's intrinsics leave open (scale/camera_uncertainty.h) into every stated
/// uncertainty: of the scale, planes, vehicles and points. Statuses stay: they judge what the
/// images show, and a camera that is known better makes all of it better known. Does nothing where
/// the scene takes its camera for exact.
void include_camera_sigma(const LoadedFrames& frames, AssembledRoad* road);

}  // namespace camber::stages
