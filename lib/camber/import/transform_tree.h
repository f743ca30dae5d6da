#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "camber/geometry/se3.h"
#include "camber/import/formats/ros_messages.h"

namespace camber {

/// The frames of a recording (tf2): each has one parent, to which it is fixed or moves.
class TransformTree {
 public:
  /// A place in a frame that has no parent.
  struct InRoot {
    std::string root;
    SE3 root_from_frame;
  };

  /// A later transform of the same frames replaces a fixed one, and is one more of moving ones.
  void add_fixed(const RosTransform& transform);
  void add_moving(const RosTransform& transform);

  bool knows(const std::string& frame) const;
  bool has_moving() const { return !moving_.empty(); }

  /// Up from a frame to its root at a time; moving frames are interpolated (rotations by slerp).
  /// @return nothing before the first or behind the last of a moving frame's transforms, in a gap
  ///         of more than a second, or in a circle of frames.
  std::optional<InRoot> in_root(const std::string& frame, std::int64_t ns) const;

  /// a_from_b over fixed transforms alone; nothing where they do not join the frames.
  std::optional<SE3> fixed_between(const std::string& a, const std::string& b) const;

 private:
  struct Fixed {
    std::string parent;
    SE3 parent_from_frame;
  };
  struct Moving {
    std::string parent;
    std::map<std::int64_t, SE3> parent_from_frame;
  };
  std::map<std::string, Fixed> fixed_;
  std::map<std::string, Moving> moving_;
};

}  // namespace camber
