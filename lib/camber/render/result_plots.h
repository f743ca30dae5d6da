#pragma once

#include <map>
#include <string>
#include <vector>

#include "camber/core/stopwatch.h"
#include "camber/evaluate/tables.h"
#include "camber/render/plot.h"
#include "camber/road/cloud_profile.h"
#include "camber/road/road_profile.h"
#include "camber/scene/results.h"

namespace camber {

/// Height, grade and cross slope along a road, each with its 95 % band; slopes in per cent.
/// @throws NoAnswerError if no station is covered.
PlotSheet profile_plots(const std::vector<ProfilePoint>& profile, bool metric,
                        const std::string& title);

/// The same of the ground of a cloud, and left and right of the crest where that was asked for.
PlotSheet cross_section_profile_plots(const CloudProfile& profile, bool metric,
                                      const std::string& title);

/// Up to twelve cross-sections, evenly along the line, each with the line of its cross slope:
/// heights over the one on the line, against metres to the left of it.
/// @throws NoAnswerError if no station has one.
PlotSheet cross_section_plots(const CloudProfile& profile, bool metric, const std::string& title);

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
