#pragma once

#include <memory>
#include <vector>

#include "camber/synth/detail/drive_motion.h"
#include "camber/synth/detail/side_limits.h"
#include "camber/synth/synth_world.h"

namespace camber {

/// The cars of a whole drive: parked ones beside the carriageway, oncoming ones, and cars ahead in
/// the own lane that are caught up with, drive ahead for a while (and stand where the camera's car
/// stands) and get away. Each keeps its track number.
class DriveTraffic {
 public:
  /// @param lane  offset of the own lane's middle, m (negative: right of the centreline)
  /// @param road  must outlive it
  DriveTraffic(const RoadModel& road, const std::vector<DriveState>& states, double frame_rate,
               double lane, double density, std::uint64_t seed);
  ~DriveTraffic();

  int count() const;
  /// The cars that come within view of the camera in frames [first, last], with their poses there.
  std::vector<SynthCar> cars_in(int first, int last) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace camber
