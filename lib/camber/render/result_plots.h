#pragma once

#include <map>
#include <string>
#include <vector>

#include "camber/core/stopwatch.h"
#include "camber/evaluate/tables.h"
#include "camber/render/plot.h"
#include "camber/road/road_profile.h"
#include "camber/scene/results.h"

namespace camber {

/// Height, grade and cross slope along a road, each with a band of one standard deviation; slopes
/// in degrees.
/// @throws NoAnswerError if no station is covered.
PlotSheet profile_plots(const std::vector<ProfilePoint>& profile, bool metric,
                        const std::string& title);

/// A bar a stage.
/// @throws NoAnswerError without a stage.
PlotSheet timing_plots(const Timings& timings, const std::string& title);

/// What each source measures of a run's scale by itself, in per cent off the result's, with one
/// standard deviation to each side; the result's below. By `evidence` of run.json; what is not as
/// Camber writes it is left out.
/// @throws NoAnswerError where no source measures the scale.
PlotSheet evidence_plots(const RunDocument& run);

/// What is counted in error plots.
enum class PlottedError {
  kCenter,  ///< distance between true and estimated box centre
  kGround,  ///< height of the plane under the vehicle
};

/// Histogram and cumulative curve of the matched vehicles' errors, all scenes of a method together.
/// The histogram's last bar holds all beyond; unanswered vehicles count in the shares.
/// @throws NoAnswerError if no method has an error.
PlotSheet error_plots(const std::vector<EvaluatedScene>& scenes, PlottedError which);

/// Depth of each true vehicle's centre over time, true (red) and estimated with bars of 1 sigma; a
/// panel a method.
/// @param methods  results for one scene, one a method.
/// @param times    seconds by frame id; empty: over the frames' ids.
/// @throws NoAnswerError if no vehicle is matched.
PlotSheet depth_plots(const std::vector<EvaluatedScene>& methods,
                      const std::map<int, double>& times);

}  // namespace camber
