#pragma once

#include <memory>
#include <string>

#include "camber/cloud/point_stream.h"
#include "camber/import/formats/ros_messages.h"

namespace camber {

/// The points of a PointCloud2 as a stream, attributes by the names of its fields; a field of
/// several values is name_0, name_1, ... Colours packed in a float ("rgb") are colours.
/// @param bytes  of the message; must outlive the stream
/// @param move   applied to x, y, z (which become double) and normals, if given
/// @throws InputError for a message without x and y.
std::unique_ptr<PointSource> make_ros_cloud_source(const RosBytes& bytes,
                                                   const RosPointCloud& cloud,
                                                   const SE3* move = nullptr);

}  // namespace camber
