#include "camber/pipeline/stages/paper_vehicles.h"

#include <fmt/format.h>

#include <stdexcept>

#include "camber/core/threads.h"

namespace camber {

std::string to_string(Preset preset) { return preset == Preset::kPaper ? "paper" : "default"; }

Preset preset_from_string(const std::string& name) {
  for (const Preset preset : {Preset::kDefault, Preset::kPaper}) {
    if (name == to_string(preset)) return preset;
  }
  throw std::invalid_argument(fmt::format("preset: \"{}\", must be default or paper", name));
}

namespace stages {

paper::JointFitOptions paper_problem(const VehicleOptions& options,
                                     const PaperVehicleOptions& paper) {
  paper::JointFitOptions out;
  out.terms = paper.terms;
  out.weights = paper.weights;
  out.keypoint_set = options.fit.keypoint_set;
  out.prior = options.fit.prior;
  out.planes_fixed = options.method != VehicleMethod::kJoint;
  if (options.method == VehicleMethod::kFlat) out.schedule = paper::Schedule::kAlternating;
  if (paper.terms == paper::Terms::kPrinted) {
    out.solver = paper::LinearSolver::kConjugateGradients;
  }
  return out;
}

PlacedVehicles place_paper_vehicles(const PinholeCamera& camera, std::vector<TrackFrame> views,
                                    const VehicleOptions& options,
                                    const PaperVehicleOptions& paper) {
  const paper::JointFitOptions problem = paper_problem(options, paper);
  PlacedVehicles out;
  out.views = std::move(views);
  out.estimates.resize(out.views.size());
  parallel_for(out.views.size(), options.num_threads, [&](std::size_t k) {
    TrackFrame& view = out.views[k];
    view.estimates = paper::fit_frame(camera, view.detections, view.supports, problem).vehicles;
    out.estimates[k] = view.estimates;
  });
  for (const TrackFrame& view : out.views) {
    out.tracks.emplace_back();
    for (const VehicleDetection& d : view.detections) out.tracks.back().push_back(d.track);
  }
  return out;
}

}  // namespace stages
}  // namespace camber
