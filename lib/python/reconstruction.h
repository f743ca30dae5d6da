#pragma once

#include <optional>

#include "camber/pipeline/reconstruct.h"
#include "camber/scene/scene.h"

namespace camber::python {

/// A result with the scene that it is of, for the pictures that are drawn of both.
struct PythonReconstruction : Reconstruction {
  Scene of;
  std::optional<Scene> calibrated;  ///< SceneReconstruction's
};

}  // namespace camber::python
