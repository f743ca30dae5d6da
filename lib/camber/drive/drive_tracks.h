#pragma once

#include <Eigen/Core>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "camber/drive/trajectory.h"
#include "camber/drive/window_measurement.h"
#include "camber/scene/results.h"

namespace camber {

struct VehiclePrior;

/// One vehicle over a whole drive.
struct DriveTrack {
  int id = 0;  ///< from 1 in order of appearance
  std::string vehicle_class;
  bool parked = false;
  struct View {
    int frame = 0, detection = 0;
    double time_s = 0.0;
    SE3 world_from_vehicle;
  };
  std::vector<View> views;  ///< by frame
  Dimensions dimensions;    ///< one for all views
  /// Of the position in the world (m), of a parked one.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  std::string rejected;  ///< why it is no vehicle; empty: it may be one
};

struct DriveTracks {
  std::vector<DriveTrack> tracks;
  /// Every estimate, frame by frame, with its track and moved to where the track has it; those of
  /// a rejected one are failed, with the reason.
  VehicleDocument vehicles;

  std::size_t num_rejected() const;
};

/// Joins the vehicles of windows into tracks: detections that windows take for one vehicle are one
/// where its motion on the road allows it, never two of one frame; one that was hidden for up to 3
/// s goes on. Parked ones have one place in the world, by all their views. A moving one has the
/// size of its near views, and of its own estimates what agrees with that along each ray. A track
/// of three views or more whose size, height above the road or motion no vehicle has is rejected.
/// @param windows   in the order of their references.
/// @param time_of   s, by frame id.
/// @param image_width  px: a vehicle that a side of the picture cuts is placed by its other views.
/// @param prior     not owned; nullptr: the shipped one.
DriveTracks join_tracks(const std::vector<WindowMeasurement>& windows, const Trajectory& trajectory,
                        const std::map<int, double>& time_of, int image_width,
                        const VehiclePrior* prior = nullptr);

}  // namespace camber
