#pragma once

// What the outputs of detectors mean.

#include <string>
#include <vector>

#include "camber/detect/network.h"
#include "camber/geometry/box.h"

namespace camber::internal {

/// A box in the input of a network, px from its left upper edge.
struct HeadBox {
  int class_number = 0;
  double score = 0.0;
  Box2 box;
};

/// The shape of the output that a head has; -1: any number.
std::vector<std::vector<int>> head_shapes(const DetectorDescription& description);

/// Boxes of vehicles of at least the least score, in the order of the output. What is not finite or
/// has no area is left out.
/// @param file  of the network, for the message.
/// @throws InputError where the outputs do not have the shape of the description's head.
std::vector<HeadBox> decode_head(const DetectorDescription& description,
                                 const std::vector<Tensor>& outputs, const std::string& file);

}  // namespace camber::internal
