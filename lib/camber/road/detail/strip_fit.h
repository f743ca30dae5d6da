#pragma once

#include <functional>
#include <limits>
#include <vector>

#include "camber/road/detail/strip_smoother.h"

namespace camber::detail {

/// A StripSmoother on points some of which are far off: Huber's loss by pseudo-data (Oh, Nychka,
/// Lee, "The role of pseudo data for robust smoothing", Biometrika 2007), points beyond a limit
/// left out; noise by the residuals and the degrees of freedom that are left.
class StripFit {
 public:
  /// @param points      must stay where they are
  /// @param least_trim  m from the smooth ground within which no point is left out
  StripFit(const StripGrid& grid, const std::vector<StripPoint>& points, double least_trim = 0.0);

  /// @return false: too few points
  bool fit(const StripRoughness& roughness);

  const StripSmoother& smoother() const { return smoother_; }
  StripSmoother& smoother() { return smoother_; }
  double noise() const { return noise_; }  ///< m, of a point of weight 1
  const std::vector<char>& used() const { return used_; }

  /// How far to the right and to the left of the line points are seen, m, positive: two numbers for
  /// each of `count` stations a metre apart.
  std::vector<double> seen_across(double first, std::size_t count) const;

 private:
  bool solve(const StripRoughness& roughness);
  void reweigh(bool trim);

  StripSmoother smoother_;
  const std::vector<StripPoint>& points_;
  double least_trim_;
  std::vector<char> used_;
  std::vector<double> heights_;
  double noise_ = 0.05;
};

/// The roughness under which the points of some strips are the most likely. The fits are left with
/// it.
/// @param start  where the search begins, as of the same strips with other nodes; nullptr: nothing
///               is known
StripRoughness estimate_roughness(std::vector<StripFit>* fits, const StripRoughness* start,
                                  int num_threads);

/// Where the ground leaves that of the road by a kerb, a ditch or a bank.
struct Edge {
  double distance = std::numeric_limits<double>::quiet_NaN();  ///< m from the line; NaN: not seen
  double level = 0.0,
         slope = 0.0;  ///< of the road's ground before it: m on the line, rise over run
};
/// @param height  of the smooth ground at a distance, m
/// @param seen    m, how far it is known
Edge find_edge(const std::function<double(double)>& height, double seen, double noise);

/// A point of the ground beside a section.
struct SidePoint {
  double distance = 0.0, height = 0.0;  ///< m
};
/// The edge's distance by the points around it, which smooth ground shows to a node alone.
double refine_edge(const Edge& edge, const std::vector<SidePoint>& points, double noise);

/// Edges at stations a metre apart without those that their neighbours do not have.
void smooth_edges(std::vector<double>* edges);

}  // namespace camber::detail
