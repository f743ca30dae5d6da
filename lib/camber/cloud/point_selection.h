#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <vector>

#include "camber/cloud/point_stream.h"

namespace camber {

/// Rings of an area in plan by the even-odd rule: outlines and their holes, in any order. Each is
/// closed from its last corner to its first.
using PlanRings = std::vector<std::vector<Eigen::Vector2d>>;

/// Which points of a survey cloud to keep; all conditions hold together.
struct PointSelection {
  enum class Returns { kAll, kFirst, kLast, kSingle };
  std::vector<int> classes;          ///< of "classification"; empty: all
  std::vector<int> without_classes;  ///< that go
  /// By "return_number" and "number_of_returns": the last of a pulse is the one whose number is
  /// the number of returns (or above it), a single one is the only return of its pulse.
  Returns returns = Returns::kAll;
  PlanRings area;  ///< points outside go; empty: everywhere

  bool selects() const {  ///< whether there is a condition
    return !classes.empty() || !without_classes.empty() || returns != Returns::kAll ||
           !area.empty();
  }
};

/// Whether a place is inside of the rings; on a border as of a half-open area: neighbours that
/// share a border share no point.
bool inside_rings(const PlanRings& rings, const Eigen::Vector2d& place);

/// The points of a source that a selection keeps.
/// @throws InputError where the source lacks an attribute that a condition is on.
/// @param name  of the file, for messages
std::unique_ptr<PointSource> select_points(std::unique_ptr<PointSource> source,
                                           const PointSelection& selection,
                                           const std::string& name);

}  // namespace camber
