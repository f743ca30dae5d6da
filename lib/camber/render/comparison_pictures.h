#pragma once

#include "camber/evaluate/compare.h"
#include "camber/evaluate/m3c2.h"
#include "camber/image/image_io.h"

namespace camber {

/// Histograms of the distances in both directions, of the counted points; the last bar holds all
/// beyond.
Image draw_histogram(const CloudComparison& comparison);

/// Share of the points within a distance, in both directions, over the distance, with the
/// thresholds marked.
Image draw_cumulative(const CloudComparison& comparison);

/// The map of signed height errors, the road's direction, or x, to the right; blue too low, orange
/// too high.
Image draw_height_map(const CloudComparison& comparison);

/// A cloud coloured by its distances (viridis, `largest` m and beyond at the yellow end; grey: not
/// counted), with the scalars "error" and, where known, "error_along_normal".
RoadCloud color_by_distance(const DirectedDistances& directed, double largest);

/// The core points as a cloud: scalars "change", "detection_limit" and "sigma_change", label
/// "significant", normals; coloured by the change where it is significant (blue loss, orange gain),
/// else grey.
RoadCloud change_cloud(const CloudChange& change);

/// Histogram of the signed changes, the significant ones apart.
Image draw_change_histogram(const CloudChange& change);

/// The core points in plan, coloured as change_cloud(), east to the right.
Image draw_change_map(const CloudChange& change);

}  // namespace camber
