#pragma once

#include <vector>

#include "camber/pipeline/stages/vehicles.h"
#include "camber/vehicle/paper/joint_fit.h"

namespace camber {

/// Which method a run follows.
enum class Preset {
  kDefault,  ///< Camber's own
  kPaper     ///< the paper's, section III
};
std::string to_string(Preset preset);  ///< "default", "paper"
/// Inverse of to_string. @throws std::invalid_argument for another name.
Preset preset_from_string(const std::string& name);

namespace stages {

/// The paper's vehicles beside VehicleOptions, of which method, support, keypoint set and prior
/// hold here too.
struct PaperVehicleOptions {
  paper::Terms terms = paper::Terms::kMeant;
  paper::Weights weights;
};

/// The joint problem of a method. kJoint: ground planes are unknowns, all at once. kCoplanar: the
/// same with the ego plane held. kFlat: a level plane held, pose and shape in turns (Murthy,
/// Krishna, Chhaya, Madhava Krishna, "Reconstructing Vehicles from a Single Image", ICRA 2017).
/// Printed terms are solved as the paper solves them, by conjugate gradients.
paper::JointFitOptions paper_problem(const VehicleOptions& options,
                                     const PaperVehicleOptions& paper);

/// Places the vehicles of each frame by the paper's joint problem, frame by frame.
/// @param views  with their supports, without estimates.
PlacedVehicles place_paper_vehicles(const PinholeCamera& camera, std::vector<TrackFrame> views,
                                    const VehicleOptions& options,
                                    const PaperVehicleOptions& paper);

}  // namespace stages
}  // namespace camber
