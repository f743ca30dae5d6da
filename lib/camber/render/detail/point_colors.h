#pragma once

#include <Eigen/Core>

#include "camber/render/picture_space.h"

namespace camber::detail {

/// Colours for the points of a picture, and the colour bar that explains them.
/// @param up  in the reference frame, for heights above the truth
/// @param space  its points, the indices of these and its ranges are complete
/// @throws NoAnswerError if the cloud lacks what the colours mean.
void color_points(const PictureContent& content, const Eigen::Vector3d& up, const PointColor& color,
                  PictureSpace* space);

}  // namespace camber::detail
