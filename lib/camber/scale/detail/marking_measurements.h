#pragma once

// What strokes of paint of known size measure of a road's shape: which stroke is what, at a shape
// that is roughly known, and the residuals at any shape near it.

#include <Eigen/Core>
#include <vector>

#include "camber/geometry/pinhole_camera.h"
#include "camber/scale/detail/road_shape.h"
#include "camber/scale/lane_marking_detection.h"
#include "camber/scale/painted_strokes.h"
#include "camber/scale/scale_noise.h"

namespace camber::detail {

enum class StrokeKind { kUnknown, kDash, kLine, kStripe };

/// A stroke on a road of some shape.
struct StrokeOnRoad {
  bool valid = false;
  Eigen::Vector3d near, far, middle;         ///< m, camera frame; the middle of the visible piece
  Eigen::Vector3d direction;                 ///< unit, away from the camera, at the middle
  double length = 0.0, width = 0.0;          ///< m
  double near_sigma = 0.0, far_sigma = 0.0;  ///< m along the stroke, of its ends
  double width_sigma = 0.0;                  ///< relative
};

/// One scalar measurement.
struct MarkingMeasurement {
  enum class Kind { kWidth, kSharedWidth, kEnd, kAcross, kAzimuth, kLaneWidth } kind = Kind::kWidth;
  std::size_t stroke = 0;
  std::size_t other = 0;  ///< kLaneWidth: the line on the other side
  double row = 0.0;       ///< px: kWidth, kAzimuth; kEnd: 0 the near one, 1 the far one
  double expected = 0.0;  ///< m: width, place along its line, place across
  int group = -1;         ///< whose common offset is free (the place of a line, ...)
  double weight = 1.0;    ///< robust
};

/// The strokes that take part, with what each is.
struct MarkingAssociation {
  std::vector<StrokeKind> kinds;  ///< one a stroke
  std::vector<MarkingMeasurement> measurements;
  int groups = 0;
  std::vector<std::vector<std::size_t>> lines;      ///< strokes of broken lines, nearest first
  std::vector<std::vector<std::size_t>> crossings;  ///< stripes, from the left
};

class MarkingMeasurements {
 public:
  MarkingMeasurements(const PinholeCamera& camera, const std::vector<PaintedStroke>& strokes,
                      const LaneMarkingSizes& sizes, const ScaleNoise& noise)
      : camera_(camera), strokes_(strokes), sizes_(sizes), noise_(noise) {}

  StrokeOnRoad on_road(const RoadShape& road, const PaintedStroke& stroke) const;

  /// @param slack  relative, by which lengths may be off beside their noise: the shape's own error.
  MarkingAssociation associate(const RoadShape& road, double slack) const;

  /// Residuals in standard deviations, the groups' offsets taken out; NaN-free: where a ray meets
  /// no road, `kLost`. @param sigmas  of each measurement at the shape of association.
  Eigen::VectorXd residuals(const RoadShape& road, const MarkingAssociation& association,
                            const Eigen::VectorXd& sigmas) const;
  /// In the units of each measurement.
  Eigen::VectorXd sigmas(const RoadShape& road, const MarkingAssociation& association) const;

  static constexpr double kLost = 10.0;

 private:
  Eigen::Vector3d point(const RoadShape& road, const Eigen::Vector2d& pixel) const {
    return road.point(camera_.ray(pixel));
  }
  double width_at(const RoadShape& road, const PaintedStroke& stroke, double row) const;
  Eigen::Vector3d direction_at(const RoadShape& road, const PaintedStroke& stroke,
                               double row) const;
  double value(const RoadShape& road, const MarkingMeasurement& m) const;
  void place_ends(const RoadShape& road, const MarkingAssociation& association,
                  Eigen::VectorXd* values) const;
  void find_lines(const std::vector<StrokeOnRoad>& on_road, double slack, int width_group_of_lines,
                  MarkingAssociation* out) const;
  struct BrokenLine {
    std::vector<std::size_t> strokes;
    std::vector<int> numbers;  // of each, in periods from the first
  };
  void add_line(BrokenLine line, int width_group_of_lines, MarkingAssociation* out) const;
  void find_crossings(const std::vector<StrokeOnRoad>& on_road, double slack,
                      MarkingAssociation* out) const;
  void find_long_lines(const std::vector<StrokeOnRoad>& on_road, int width_group_of_lines,
                       MarkingAssociation* out) const;
  void add_widths(std::size_t stroke, double expected, int group, MarkingAssociation* out) const;
  /// A group for widths that share the paint's own error.
  static int width_group(MarkingAssociation* out);
  void add_parallels(const RoadShape& road, const std::vector<StrokeOnRoad>& on_road, double slack,
                     MarkingAssociation* out) const;
  double separation(const RoadShape& road, const PaintedStroke& stroke, const PaintedStroke& other,
                    double row) const;

  const PinholeCamera& camera_;
  const std::vector<PaintedStroke>& strokes_;
  const LaneMarkingSizes& sizes_;
  const ScaleNoise& noise_;
};

}  // namespace camber::detail
