#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "camber/export/height_source.h"
#include "camber/export/opencrg.h"
#include "camber/export/smooth_line.h"

namespace camber {

/// How far the ground is seen to either side of a line.
struct SeenWidth {
  std::vector<double> stations;     ///< m along the line, ascending
  std::vector<double> left, right;  ///< m, >= 0; gaps of up to 1 m are passed over
};
/// @param step   m between stations, > 0
/// @param widest m to either side; also nearer than the centre of a bend
SeenWidth seen_width(const HeightSource& ground, const SmoothLine& line, double step, double widest,
                     int num_threads);

/// The line with what of the ground goes on straight beyond its last point: while the ground is
/// seen there, at most `most` metres. Its heights are those of the ground's level (levels_along());
/// points without heights (NaN) get those of the ground where it has one level, and what lies
/// between them elsewhere.
/// @throws as SmoothLine; NoAnswerError where heights are missing and the ground has several levels
/// all along.
SmoothLine line_over_ground(const HeightSource& ground, const std::vector<Eigen::Vector3d>& points,
                            double tolerance, double most, int num_threads);

/// The ground under and above a line.
struct GroundBeside {
  std::size_t stations = 0;  ///< at which it is seen, every metre
  std::size_t far = 0;       ///< of them with no ground within kPointLevelGap of the line's height
  double above = 0.0;        ///< m, of the nearest level over the line, median of the far ones
};
GroundBeside ground_beside(const HeightSource& ground, const SmoothLine& line, int num_threads);

/// Where a line bends so sharply that a strip beside it must end before the ground does.
struct TightBend {
  double station = 0.0;  ///< m along the line
  double radius = 0.0;   ///< m
  bool left = false;     ///< the side of its centre
  double room = 0.0;     ///< m that a strip may go to that side
  double wanted = 0.0;   ///< m that are given, or else seen
};
/// The tightest one; nothing where no bend is in the way.
/// @param left, right  m that are wanted, >= 0; 0: as far as is seen
std::optional<TightBend> tight_bend(const HeightSource& ground, const SmoothLine& line, double left,
                                    double right, double widest);

/// Where the grid of an export stands.
struct CrgGridOptions {
  double step_u = 0.0,
         step_v = 0.0;  ///< m; 0: from the data (0.25 m where their resolution is unknown)
  double right = 0.0, left = 0.0;  ///< m to either side, >= 0; 0: as far as is seen
  double widest = 12.0;            ///< m, limit of what is seen
  bool slope_in_line = true;       ///< elevation of the reference line; else in the grid
  bool banking_in_line = true;
  double smoothing = 5.0;  ///< m of road over which elevation and banking of the line are taken
  CrgEncoding encoding = CrgEncoding::kText;
  int num_threads = 0;

  void validate() const;  ///< throws std::invalid_argument naming field, value and bound
};

/// Steps for data that resolve heights every `resolution` metres: round, in millimetres.
double grid_step(double resolution);

/// The ground beside a line as an OpenCRG road. Grid points are where a reader of the file has
/// them, after its reference line of rounded headings; heights are relative to that line's
/// elevation and banking, so that 4 bytes hold them. What is not seen is unknown.
/// @throws NoAnswerError where the line is shorter than two steps or nothing beside it is seen;
///         UsageError for a step across that is wider than what is seen.
CrgData make_crg(const HeightSource& ground, const SmoothLine& line, const CrgGridOptions& options);

}  // namespace camber
