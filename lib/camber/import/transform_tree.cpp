#include "camber/import/transform_tree.h"

#include <iterator>

namespace camber {
namespace {

constexpr int kMostSteps = 64;                       // from a frame to its root
constexpr std::int64_t kLongestGap = 1'000'000'000;  // ns, between two transforms

/// Frames of ROS 1 may begin with a slash, which means nothing.
std::string plain(const std::string& frame) {
  return !frame.empty() && frame[0] == '/' ? frame.substr(1) : frame;
}

}  // namespace

void TransformTree::add_fixed(const RosTransform& transform) {
  fixed_[plain(transform.child)] = {plain(transform.stamp.frame), transform.parent_from_child};
}

void TransformTree::add_moving(const RosTransform& transform) {
  Moving& moving = moving_[plain(transform.child)];
  if (moving.parent_from_frame.empty()) moving.parent = plain(transform.stamp.frame);
  if (moving.parent != plain(transform.stamp.frame)) return;  // the first parent holds
  moving.parent_from_frame[transform.stamp.ns] = transform.parent_from_child;
}

bool TransformTree::knows(const std::string& frame) const {
  return fixed_.count(plain(frame)) > 0 || moving_.count(plain(frame)) > 0;
}

std::optional<TransformTree::InRoot> TransformTree::in_root(const std::string& frame,
                                                            std::int64_t ns) const {
  InRoot out{plain(frame), SE3()};
  for (int step = 0; step < kMostSteps; ++step) {
    if (const auto moving = moving_.find(out.root); moving != moving_.end()) {
      const std::map<std::int64_t, SE3>& track = moving->second.parent_from_frame;
      const auto after = track.lower_bound(ns);
      if (after == track.end()) return {};
      SE3 now = after->second;
      if (after->first != ns) {
        if (after == track.begin()) return {};
        const auto before = std::prev(after);
        const std::int64_t gap = after->first - before->first;
        if (gap > kLongestGap) return {};
        const double share = static_cast<double>(ns - before->first) / static_cast<double>(gap);
        const SE3 &a = before->second, &b = after->second;
        now = SE3(a.rotation().slerp(share, b.rotation()),
                  (1.0 - share) * a.translation() + share * b.translation());
      }
      out.root_from_frame = now * out.root_from_frame;
      out.root = moving->second.parent;
    } else if (const auto fixed = fixed_.find(out.root); fixed != fixed_.end()) {
      out.root_from_frame = fixed->second.parent_from_frame * out.root_from_frame;
      out.root = fixed->second.parent;
    } else {
      return out;
    }
  }
  return {};
}

std::optional<SE3> TransformTree::fixed_between(const std::string& a, const std::string& b) const {
  // All frames above b, then the first of them that is above a.
  std::map<std::string, SE3> above_b;
  SE3 from_b;
  std::string frame = plain(b);
  for (int step = 0; step < kMostSteps; ++step) {
    above_b.emplace(frame, from_b);
    const auto fixed = fixed_.find(frame);
    if (fixed == fixed_.end()) break;
    from_b = fixed->second.parent_from_frame * from_b;
    frame = fixed->second.parent;
  }
  SE3 from_a;
  frame = plain(a);
  for (int step = 0; step < kMostSteps; ++step) {
    if (const auto common = above_b.find(frame); common != above_b.end()) {
      return from_a.inverse() * common->second;
    }
    const auto fixed = fixed_.find(frame);
    if (fixed == fixed_.end()) return {};
    from_a = fixed->second.parent_from_frame * from_a;
    frame = fixed->second.parent;
  }
  return {};
}

}  // namespace camber
