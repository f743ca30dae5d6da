#pragma once

#include <vector>

#include "camber/road/detail/ground_cells.h"
#include "camber/road/detail/ground_trend.h"
#include "camber/road/detail/height_grid.h"

/// The ground's surface as a height a cell.
namespace camber::detail {

/// What differs between scans from a vehicle and from the air, whose cells hold few points.
struct GroundRules {
  bool from_air = false;
  float largest_object = 12.0f, slope = 0.2f;
  float step = 0.10f, step_per_metre = 0.08f;  // between neighbouring cells of one piece
  float refine = 0.3f;                         // m, points taken into the surface
};

/// @param cell  m, as below
TrendSizes trend_sizes(const GroundRules& rules, double cell);

/// Cells along an axis to which pieces are judged that stand above their surroundings.
int longest_piece(const GroundRules& rules, double cell);

/// Empty cells that the grid needs about the points: openings look there.
int grid_margin(const GroundRules& rules, double cell);

/// Cells along an axis beyond which no point counts for what is found in one.
int ground_reach(const GroundRules& rules, double cell);

/// The lowest height of each cell that enough points share, and by how many; kNoHeight and 0 where
/// a cell has no points.
struct LowestHeights {
  HeightGrid heights;
  std::vector<int> support;
};

/// The same for any number of threads, as is the surface below.
LowestHeights find_lowest(const GroundCells& cells, int num_threads);

/// Drops reflections below the ground, round by round: few points below the plane through the cells
/// around them, or, from the air, below nearly all of these.
void drop_low(const GroundCells& cells, const GroundRules& rules, LowestHeights& lowest);

/// The ground's surface, in every cell, and the lower third over cells of the points' scatter about
/// it, m; 0 where cells hold few points.
struct GroundSurface {
  HeightGrid heights;
  float noise = 0.0f;
};

/// Takes objects out of the lowest heights, refines what is left by the points, takes out what
/// stands above its surroundings, and fills the gaps.
GroundSurface fit_ground_surface(const GroundCells& cells, const GroundRules& rules,
                                 const HeightGrid& lowest, int num_threads);

}  // namespace camber::detail
