#pragma once

#include "camber/import/import_rosbag.h"
#include "camber/import/transform_tree.h"

namespace camber {

// What a recording has beside its images. Each gives the frames what belongs to their times and
// adds a phrase to out.found, or, where it has nothing of theirs, to out.missing.

/// The transforms of all topics of tf2.
/// @param moving  those of /tf, too; else those of /tf_static alone
TransformTree read_transforms(BagReader& bag, const std::string& file, bool moving);

/// The fixes of a topic (NavSatFix) as positions of a log; those without a fix are left out.
std::vector<GeoPoint> read_fixes(BagReader& bag, const BagReader::Topic& topic,
                                 const std::string& file);

/// Gravity by the orientation that an IMU states, turned into the camera by the fixed transforms.
void put_recorded_up(BagReader& bag, const BagReader::Topic& topic, const std::string& file,
                     const TransformTree& frames, const std::string& camera, double sigma,
                     OwnImport& out);

/// Speeds of odometry.
void put_recorded_speeds(BagReader& bag, const BagReader::Topic& topic, const std::string& file,
                         OwnImport& out);

/// The camera's height over base_footprint, which REP 120 puts on the ground; nothing where the
/// fixed transforms do not join the two.
std::optional<double> height_over_footprint(const TransformTree& frames, const std::string& camera);

}  // namespace camber
