#pragma once

#include "camber/render/loaded_result.h"
#include "camber/render/overlay.h"

namespace camber {

/// The image of one frame of a result's scene with the vehicles of that frame and, as far as the
/// options ask for it, the result's patches in the frame's camera and the frame's road mask.
/// `options.metric` is taken from the result.
/// @throws NoAnswerError without a scene, an image, or what the options want to show; InputError
/// for
///         images that cannot be read; std::invalid_argument as draw_overlay().
Image draw_frame_overlay(const LoadedResult& result, int frame, OverlayOptions options = {});

}  // namespace camber
