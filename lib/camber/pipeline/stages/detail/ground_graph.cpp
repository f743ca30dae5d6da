#include "camber/pipeline/stages/detail/ground_graph.h"

#include <algorithm>
#include <utility>

namespace camber::stages::detail {
namespace {

/// Planes with a joint covariance, over all frames: time grows with the third power, memory with
/// the second. Vehicles beyond take their planes from the road, and nothing from one another.
constexpr std::size_t kMostJoinedPlanes = 256;

/// Rows of the detections' planes in the joint covariance, whose size is bounded: of many, those of
/// the tallest boxes.
std::vector<std::vector<Eigen::Index>> rows_of(const std::vector<TrackFrame>& views) {
  std::vector<TrackView> all;
  for (std::size_t k = 0; k < views.size(); ++k) {
    for (std::size_t j = 0; j < views[k].detections.size(); ++j) all.push_back({k, j});
  }
  if (all.size() > kMostJoinedPlanes) {
    std::stable_sort(all.begin(), all.end(), [&](const TrackView& a, const TrackView& b) {
      return views[a.frame].detections[a.detection].box.height() >
             views[b.frame].detections[b.detection].box.height();
    });
    all.resize(kMostJoinedPlanes);
  }
  std::vector<std::vector<Eigen::Index>> out;
  for (const TrackFrame& view : views) out.emplace_back(view.detections.size(), -1);
  for (const TrackView& at : all) out[at.frame][at.detection] = 0;
  Eigen::Index next = 0;
  for (std::vector<Eigen::Index>& of_frame : out) {
    for (Eigen::Index& row : of_frame) {
      if (row < 0) continue;
      row = next;
      next += 3;
    }
  }
  return out;
}

/// Nodes of the graph with the covariance that the road gives them.
class Nodes {
 public:
  /// A plane that is a function of the road.
  /// @param own  variances beside the road's.
  void add(int id, const UncertainPlane& plane, RoadFunctionals functionals, bool spine,
           const Eigen::Vector3d& own) {
    const Eigen::Index row = rows();
    at_.insert(at_.end(), {row, row + 1, row + 2});
    own_.push_back(own);
    functionals_.push_back(std::move(functionals));
    nodes_.push_back({plane, true, spine});
    ids_.push_back(id);
  }

  void add_apart(const UncertainPlane& plane) {
    nodes_.push_back({plane, false, false});
    ids_.push_back(-1);
  }

  Eigen::Index rows() const { return 3 * static_cast<Eigen::Index>(nodes_.size()); }
  const std::vector<PlaneGraphNode>& nodes() const { return nodes_; }
  const std::vector<int>& ids() const { return ids_; }

  Eigen::MatrixXd covariance(const RoadPosterior& road) const {
    std::vector<RoadFunctionals> functionals = functionals_;
    functionals.push_back(road.of_log_scale());
    std::vector<Eigen::Index> at = at_;
    at.push_back(rows());
    Eigen::MatrixXd of_road = road.covariance(joined(functionals));
    for (std::size_t i = 0; i < own_.size(); ++i) {
      of_road.diagonal().segment<3>(3 * static_cast<Eigen::Index>(i)) += own_[i];
    }
    Eigen::MatrixXd out = Eigen::MatrixXd::Zero(rows() + 1, rows() + 1);
    for (std::size_t i = 0; i < nodes_.size(); ++i) {
      const auto row = 3 * static_cast<Eigen::Index>(i);
      if (!nodes_[i].on_road) out.block<3, 3>(row, row) = nodes_[i].plane.covariance;
    }
    out(at, at) = of_road;
    return out;
  }

 private:
  std::vector<PlaneGraphNode> nodes_;
  std::vector<int> ids_;
  std::vector<RoadFunctionals> functionals_;
  std::vector<Eigen::Index> at_;  // rows of the functionals
  std::vector<Eigen::Vector3d> own_;
};

}  // namespace

GroundGraph ground_graph(const RoadPosterior& road, const SurfacePlan& plan,
                         const DetectedGround& detected, bool factorised) {
  Nodes nodes;
  const auto functionals = [&](const LocalPlane& plane) {
    return road.of_inverse_depths(plane.pixels, plane.by_inverse_depth);
  };
  nodes.add(0, road.ego(), road.of_ego(), true, Eigen::Vector3d::Zero());
  for (const PatchFootprint& footprint : plan.road) {
    const LocalPlane& plane = footprint.plane;
    if (plane.status == Status::kFailed) continue;
    nodes.add(footprint.id, plane.plane, functionals(plane), true, Eigen::Vector3d::Zero());
  }
  const Eigen::Index before = nodes.rows();
  GroundGraph out;
  std::size_t next = 0;  // of the detections' planes that are functions of the road
  if (detected.views) out.under_detections.rows = rows_of(*detected.views);
  for (std::size_t k = 0; k < out.under_detections.rows.size(); ++k) {
    for (std::size_t j = 0; j < out.under_detections.rows[k].size(); ++j) {
      const bool on_road = next < detected.at->size() && (*detected.at)[next].frame == k &&
                           (*detected.at)[next].detection == j;
      const LocalPlane* plane = on_road ? &(*detected.planes)[next++] : nullptr;
      if (out.under_detections.rows[k][j] < 0) continue;
      if (plane) {
        nodes.add(plan.under_vehicles[k][j]->id, plane->plane, functionals(*plane), false,
                  detected.local.uneven_variances());
      } else {
        nodes.add_apart((*detected.views)[k].supports[j].plane);
      }
    }
  }
  Eigen::MatrixXd joint = nodes.covariance(road);
  out.planes = make_plane_graph(nodes.nodes(), joint);
  if (!factorised) out.planes.covariance = std::move(joint);
  out.ids = nodes.ids();
  const Eigen::Index left = nodes.rows() + 1 - before;
  out.under_detections.covariance = out.planes.covariance.bottomRightCorner(left, left);
  return out;
}

}  // namespace camber::stages::detail
