#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <limits>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "camber/cloud/filters.h"
#include "camber/cloud/road_cloud.h"
#include "camber/geometry/pinhole_camera.h"
#include "camber/geometry/se3.h"

namespace camber {

/// One side of a comparison: a cloud, or a mesh on the cloud's points.
struct Shape {
  RoadCloud cloud;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< empty: a cloud

  bool is_mesh() const { return !triangles.empty(); }
};

/// Distances from points to a shape, one entry a point.
struct ShapeDistances {
  std::vector<double> distance;  ///< m; NaN for points that are not finite, or an empty shape
  std::vector<int> nearest;      ///< point or triangle of the shape, -1: none
  /// m, along the normal of what is nearest, positive on the side that it points to; NaN without a
  /// normal; empty if the shape has none at all.
  std::vector<double> along_normal;
};

/// Exact distances, in double, to the nearest point of a cloud or the nearest place on a mesh.
/// @param places in the frame of the shape, its origin included, m
/// Same answer for any num_threads.
ShapeDistances distances_to(const Shape& shape, const std::vector<Eigen::Vector3d>& places,
                            int num_threads);

/// True coordinates of a cloud's points, moved by a 4 x 4 matrix.
std::vector<Eigen::Vector3d> true_points(
    const RoadCloud& cloud, const Eigen::Matrix4d& transform = Eigen::Matrix4d::Identity());

/// Points spread over a mesh by area, as many as the area at the given density has, but no more
/// than `most`. Deterministic. @param density points a square metre
RoadCloud sample_mesh(const Shape& mesh, double density, std::size_t most, std::uint64_t seed);

enum class Alignment { kNone, kScale, kRigid, kSimilarity };

/// A camera that saw the estimate.
struct View {
  PinholeCamera camera;
  SE3 camera_from_estimate;
};

struct CompareOptions {
  std::vector<double> thresholds{0.05, 0.1, 0.2};  ///< m, > 0
  Alignment alignment = Alignment::kNone;          ///< of the estimate, for the comparison alone
  /// Corresponding places (estimate, truth) in their own frames: the alignment is then the closed
  /// form on them (Umeyama, "Least-squares estimation of transformation parameters between two
  /// point patterns", PAMI 1991) instead of ICP. At least 3, of scale at least 1.
  std::vector<std::pair<Eigen::Vector3d, Eigen::Vector3d>> pairs;
  /// Takes truth into the frame of the estimate, before any alignment.
  Eigen::Matrix4d estimate_from_truth = Eigen::Matrix4d::Identity();
  /// m, in the frame of the estimate: what lies outside counts on neither side.
  std::optional<CropBox> region;
  /// Truth that no view holds does not count against completeness; empty: all of it counts.
  std::vector<View> views;
  double farthest = std::numeric_limits<double>::infinity();  ///< m along a view's axis
  /// Where the truth was seen from, in its own frame: estimated points in directions without truth,
  /// or behind it, are in unobserved space and do not count against accuracy (as ETH3D does;
  /// Schoeps et al., "A multi-view stereo benchmark with high-resolution images and multi-camera
  /// videos", CVPR 2017).
  std::optional<Eigen::Vector3d> truth_viewpoint;
  Eigen::Vector3d up{0.0, 0.0, 1.0};         ///< in the frame of the estimate
  Eigen::Vector3d along{1.0, 0.0, 0.0};      ///< the road's direction, level part taken
  std::optional<Eigen::Vector3d> viewpoint;  ///< of the estimate, for bins by distance
  bool road_frame = true;                    ///< split errors, map of heights
  double road_limit = 1.0;                   ///< m, farther points are not split
  double map_cell = 0.5;                     ///< m, of the map of height errors
  double mesh_density = 400.0;               ///< points / m^2 that stand for a mesh
  std::uint64_t seed = 0;
  int num_threads = 0;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// Statistics of absolute values, m; NaN without any.
struct DistanceSummary {
  std::size_t count = 0;
  double mean = std::numeric_limits<double>::quiet_NaN();
  double median = std::numeric_limits<double>::quiet_NaN();
  double rms = std::numeric_limits<double>::quiet_NaN();
  double quantile_90 = std::numeric_limits<double>::quiet_NaN();
  double quantile_95 = std::numeric_limits<double>::quiet_NaN();
  double largest = std::numeric_limits<double>::quiet_NaN();
};
DistanceSummary summarise_distances(const std::vector<double>& values);

/// One direction of a comparison: the points that were measured (a cloud's own, or those that stand
/// for a mesh) and their distances to the other side.
struct DirectedDistances {
  RoadCloud points;                    ///< in the frame of the estimate, aligned
  ShapeDistances distances;            ///< of all points
  std::vector<unsigned char> counted;  ///< 0: not finite, outside the region, or unobserved
  std::size_t not_finite = 0, outside = 0, unobserved = 0;
  DistanceSummary summary, along_normal;  ///< of the counted ones
};

struct ThresholdScore {
  double threshold = 0.0;  ///< m
  double precision = 0.0;  ///< share of the estimate within it of the truth
  double recall = 0.0;     ///< share of the truth within it of the estimate
  double f_score = 0.0;    ///< harmonic mean
};

/// Errors of ground points in the road's own frame: height above the truth's tangent plane, and the
/// level offset to the nearest truth split along and across the road.
struct RoadErrors {
  std::string by;  ///< "all", "distance" or "grade"
  double from = 0.0, to = std::numeric_limits<double>::infinity();  ///< m, or degrees
  std::size_t count = 0;
  double height_mean = std::numeric_limits<double>::quiet_NaN();    ///< m, signed, up is positive
  double height_median = std::numeric_limits<double>::quiet_NaN();  ///< m, of absolute values
  double height_rms = std::numeric_limits<double>::quiet_NaN();
  double along_rms = std::numeric_limits<double>::quiet_NaN();
  double across_rms = std::numeric_limits<double>::quiet_NaN();
};

/// Median signed height error over the plan: u along the road, v to its left. Of a cloud on a map
/// whose road has no direction given these are its x and y.
struct HeightErrorMap {
  double cell = 0.0, u = 0.0, v = 0.0;  ///< m; lower corner of the first cell
  int width = 0, height = 0;            ///< cells along u, along v
  bool of_axes = false;                 ///< u and v are the estimate's x and y
  std::vector<float> error;             ///< m, rows of u; NaN: nothing there
  std::vector<int> count;
};

struct AlignmentResult {
  Alignment alignment = Alignment::kNone;
  bool from_pairs = false;
  Eigen::Matrix4d transform = Eigen::Matrix4d::Identity();  ///< aligned_from_estimate
  double scale = 1.0;
  /// m, rms over its pairs; of shapes that lie apart from the truth's box
  double residual_before = std::numeric_limits<double>::quiet_NaN();
  double residual_after = std::numeric_limits<double>::quiet_NaN();
  std::size_t pairs = 0;
  int iterations = 0;
};

struct CloudComparison {
  /// False: lengths are up to scale. True where both shapes are metric, or the truth alone and the
  /// alignment scales the estimate to it.
  bool metric = true;
  DirectedDistances accuracy;      ///< estimate to truth
  DirectedDistances completeness;  ///< truth to estimate
  std::vector<ThresholdScore> scores;
  std::vector<RoadErrors> road;
  HeightErrorMap map;
  AlignmentResult alignment;
};

/// Measures an estimate against the truth, in both directions.
/// @throws std::invalid_argument for bad options or triangles; NoAnswerError if nothing is left to
/// count on either side, the shapes lie more than 10 km and a hundred times their size apart, the
/// pairs do not fix the alignment, or it shrinks onto a part of the truth. Same answer for any
/// num_threads.
CloudComparison compare_shapes(const Shape& estimate, const Shape& truth,
                               const CompareOptions& options = {});

/// A table for a person, a JSON object, and rows of CSV.
std::string describe(const CloudComparison& comparison);
nlohmann::json to_json(const CloudComparison& comparison);
std::string scores_csv(const CloudComparison& comparison);
std::string road_errors_csv(const CloudComparison& comparison);
std::string height_map_csv(const HeightErrorMap& map);

/// "none", "scale", "rigid", "similarity".
std::string to_string(Alignment alignment);

}  // namespace camber
