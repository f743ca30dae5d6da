#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace camber::detail {

/// A place along a line in plan and to its left, m.
struct LinePlace {
  double s = 0.0, v = 0.0;
};

/// Coordinates along a polyline in plan that are smooth where it has corners: those of the line's
/// running mean over a length, whose normals turn without steps; stations are the polyline's own.
/// It goes on straight beyond its ends.
class LineFrame {
 public:
  /// @param corners    at least two, different from their neighbours, m
  /// @param smoothing  m to either side of a place over which the line is averaged, > 0
  /// @param beyond     m beyond the ends for which places are found, >= 0
  LineFrame(std::vector<Eigen::Vector2d> corners, double smoothing, double beyond);

  double length() const { return stations_.back(); }
  /// On the polyline.
  Eigen::Vector2d position(double s) const;
  /// Unit, of the averaged line; its left is (-y, x).
  Eigen::Vector2d ahead(double s) const;
  /// All places of a point, at most one on each stretch of the line that passes it, that lie less
  /// than `reach` to the side, and nearer than the centre of the bend.
  void places(const Eigen::Vector2d& point, double reach, std::vector<LinePlace>* out) const;
  /// The place of a point that is known to lie near a station.
  LinePlace place_near(const Eigen::Vector2d& point, double s) const;
  /// Must be called before places() and near(), with the largest reach.
  void prepare(double reach);
  /// Whether the line comes nearer than `reach` to a point, to half a metre.
  bool near(const Eigen::Vector2d& point, double reach) const;

 private:
  struct Node {
    Eigen::Vector2d at, ahead;
  };
  Node node(double s) const;
  double station_of(std::size_t k) const { return first_ + static_cast<double>(k) * spacing_; }
  LinePlace refine(const Eigen::Vector2d& point, double low, double high) const;
  long cell_of(double x, double low) const;

  std::vector<Eigen::Vector2d> corners_;
  std::vector<double> stations_;
  double smoothing_, first_ = 0.0, spacing_ = 0.5;
  std::vector<Node> nodes_;
  // Nodes by cells of a grid: sorted by key.
  double cell_ = 0.0;
  Eigen::Vector2d low_ = Eigen::Vector2d::Zero();
  long columns_ = 0, lines_ = 0;
  std::vector<std::pair<long, int>> cells_;
};

}  // namespace camber::detail
