#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "camber/evaluate/compare.h"
#include "camber/scene/results.h"
#include "camber/scene/scene.h"

namespace camber {

/// The frame whose camera is the world of a result: the run's, else the scene's choice.
int frame_of_result(const std::optional<RunDocument>& run, const Scene& scene);

/// The ground that a scene's true depth shows in a frame, its camera, m; beyond 100 m pixels are
/// far apart. SYNTHIA's label images name road and pavement; of other depth everything is taken.
/// @param name  of the scene, for messages.
/// @throws NoAnswerError where that frame has no true depth, or no ground in it.
Shape ground_of_true_depth(const std::string& name, const Scene& scene, int frame);

/// What takes a scene's truth cloud to a frame's camera.
/// @throws NoAnswerError where a true pose is missing for it.
Eigen::Matrix4d frame_from_truth_cloud(const std::string& name, const Scene& scene, int frame);

}  // namespace camber
