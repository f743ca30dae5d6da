#pragma once

// What the steps of a comparison share: searches on shapes, their normals, medians.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "camber/cloud/point_tree.h"
#include "camber/evaluate/compare.h"
#include "camber/evaluate/triangle_tree.h"

namespace camber::detail {

inline Eigen::Vector3d move(const Eigen::Matrix4d& m, const Eigen::Vector3d& p) {
  return m.topLeftCorner<3, 3>() * p + m.topRightCorner<3, 1>();
}

inline Eigen::Vector3d true_point(const RoadCloud& cloud, std::size_t i) {
  return cloud.origin + cloud.points[i].cast<double>();
}

/// A shape made ready for many searches; the shape must outlive it. Its normals may be added later.
class ShapeSearch {
 public:
  ShapeSearch(const Shape& shape, int num_threads);
  ShapeDistances distances(const std::vector<Eigen::Vector3d>& places) const;
  /// The same for the points that stand for another shape, of a cloud all: faster, since that has
  /// its points in order, too.
  ShapeDistances distances_of(const ShapeSearch& other, const RoadCloud& points) const;
  /// nullptr for a mesh.
  const PointTree* point_tree() const { return points_ ? &*points_ : nullptr; }

 private:
  const Shape& shape_;
  int num_threads_;
  std::optional<PointTree> points_;
  std::optional<TriangleTree> triangles_;
};

/// A shape in the frame of the estimate. Meshes and clouds keep their triangles; normals turn.
Shape transformed(const Shape& shape, const Eigen::Matrix4d& m);

/// Places and normals of what is nearest on a shape.
struct Contact {
  Eigen::Vector3d place, normal;  // normal: zero if unknown
};

/// @param nearest  point or triangle of the shape, as ShapeDistances has it.
Contact contact(const Shape& shape, int nearest, const Eigen::Vector3d& place);
/// Fetches what contact() will read into the cache.
void fetch_contact(const Shape& shape, int nearest);

/// Normals of the ground's tangent planes at each point: planes through the neighbours in the cloud
/// thinned to 0.25 m, so that they span some metres also where a laser's lines lie far apart; zero
/// where these leave a tilt open.
/// @param own  the cloud's tree
std::vector<Eigen::Vector3f> tangent_normals(const RoadCloud& cloud, const PointTree& own,
                                             const Eigen::Vector3d& up, int num_threads);

/// Iterated closest points of a sample of the estimate: along the truth's normals, with a little of
/// the whole distance where those leave a direction open (Chen and Medioni, "Object modelling by
/// registration of multiple range images", IVC 1992). Far pairs are left out by the median. Shapes
/// that lie apart start centre on centre, similarities from two scales.
/// @param search  of the truth
/// @throws NoAnswerError for too few pairs, a scale that collapses, and shapes that lie apart and
/// whose pairs reach over a small part of either.
AlignmentResult iterate_closest(const std::vector<Eigen::Vector3d>& estimate, const Shape& truth,
                                const ShapeSearch& search, Alignment alignment);

/// The closed form on given pairs, see CompareOptions::pairs.
AlignmentResult align_pairs(const CompareOptions& options);

/// Fills the errors in the road's own frame and the map of heights of a comparison.
/// @param truth      with normals, as it was compared.
/// @param estimated  the comparison's points.
void add_road_errors(const Shape& truth, const RoadCloud& estimated, const CompareOptions& options,
                     CloudComparison* out);

}  // namespace camber::detail
