#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "camber/plane/plane_kernels.h"

namespace camber::detail {

struct PointColumns;

/// The step to which coordinates along an axis were rounded, as a sensor or a file has them, m; 0
/// where there is none, or none above `rounding`, as of real numbers. Most of the values (of three
/// to five levels nearly all) must share theirs with another one, and their levels be equidistant.
/// @param rounding  m, error of a coordinate as a float
double coordinate_step(const std::vector<float>& values, double rounding);

/// How many points of the cloud lie at exactly the place of a point, itself included: the mean over
/// its points, 1 without copies. Of large clouds an estimate from the rows and their neighbours.
/// Leaves in `rows` one of each place if there are copies, and three places or more.
/// @param rows  ascending, of all points or evenly spread over them
double take_copies(const PointColumns& source, std::vector<std::uint32_t>* rows);

/// Makes the influences of points of which there are so many copies those of single ones.
void count_places_once(double copies, plane_kernels::Moments* influence);

/// Standard deviation of a number that was rounded to multiples of a step.
double rounding_deviation(double step);

/// Standard deviation of an error that the heights of a plane's points share since they are
/// rounded: of a sawtooth over the heights that the plane runs through, which noise before the
/// rounding blurs.
/// @param step    m, along the normal
/// @param noise   m, standard deviation of a point, its rounding included
/// @param range   m, that the plane runs through along the axis that is rounded
double shared_rounding(double step, double noise, double range);

}  // namespace camber::detail
