#pragma once

#include <string>
#include <vector>

#include "camber/render/drive_content.h"
#include "camber/render/plot.h"
#include "camber/road/road_profile.h"

namespace camber {

/// The road's profile along the driven line, every metre, on long drives every four hundredth.
/// Heights count from the first station; their standard deviations are those of the poses along up
/// and of the road under them. Empty where the strip covers nothing.
std::vector<ProfilePoint> drive_profile(const DriveContent& content);

/// Where the frames that have a pose stand along the driven line in plan, m, by index into
/// drive->frames; NaN without a pose.
std::vector<double> frame_stations(const DriveContent& content);

/// Range of the profile's grades for a scale of colours, rise over run: at least six per cent wide,
/// so that noise of a flat road is not loud.
std::pair<double, double> grade_range(const std::vector<ProfilePoint>& profile);

/// The drive from above in the strip's frame (ahead of the start, to its left): the strip coloured
/// by the grade along the line, the driven line with lengths, vehicles' tracks.
/// @throws NoAnswerError where no frame has a pose.
PlotSheet drive_map(const DriveContent& content, const std::vector<ProfilePoint>& profile);

/// Height, grade and bank of the road and the speed along the driven line, with 95 % bands.
/// @throws NoAnswerError where none of them is known.
PlotSheet drive_profile_plots(const DriveContent& content,
                              const std::vector<ProfilePoint>& profile);

/// Height and grade alone, without words beside them: for a film.
PlotSheet drive_film_plots(const std::vector<ProfilePoint>& profile, bool metric);

/// The height of a panel as wide as `width` that shows a map without much empty space, pixels.
int map_height(const PlotSheet& map, int width);

}  // namespace camber
