#include "camber/vehicle/vehicle_tracks.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/vehicle/detail/association.h"
#include "camber/vehicle/detail/ground_propagation.h"
#include "camber/vehicle/detail/track_solver.h"
#include "camber/vehicle/detail/vehicle_answer.h"

namespace camber {

namespace {

using namespace internal;

constexpr int kGroundRounds = 2;  // of message passing

/// First row of each detection's plane in a shared ground, [frame][detection].
using GroundRows = std::vector<std::vector<Eigen::Index>>;

GroundRows ground_rows(const std::vector<TrackFrame>& frames, const SharedGround& ground) {
  GroundRows out = ground.rows;
  if (out.empty()) {
    Eigen::Index next = 0;
    for (const TrackFrame& f : frames) {
      out.emplace_back();
      for (std::size_t j = 0; j < f.supports.size(); ++j, next += 3) out.back().push_back(next);
    }
  }
  if (out.size() != frames.size()) {
    throw std::invalid_argument(
        fmt::format("ground.rows: of {} frames, must be of {}", out.size(), frames.size()));
  }
  Eigen::Index size = 1;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (out[k].size() != frames[k].supports.size()) {
      throw std::invalid_argument(fmt::format("ground.rows: {} in frame {}, must be {}",
                                              out[k].size(), k, frames[k].supports.size()));
    }
    for (const Eigen::Index row : out[k]) {
      if (row >= 0) size += 3;
    }
  }
  const Eigen::MatrixXd& covariance = ground.covariance;
  if (covariance.rows() != size || covariance.cols() != size) {
    throw std::invalid_argument(fmt::format("ground.covariance: {} x {}, must be {} square",
                                            covariance.rows(), covariance.cols(), size));
  }
  for (const std::vector<Eigen::Index>& of_frame : out) {
    for (const Eigen::Index row : of_frame) {
      if (row + 3 >= size) {
        throw std::invalid_argument(
            fmt::format("ground.rows: {}, must be below {}", row, size - 3));
      }
    }
  }
  return out;
}

bool has_rows(const GroundRows& rows, const TrackSolution& solution) {
  return std::all_of(solution.views.begin(), solution.views.end(),
                     [&](const TrackView& v) { return rows[v.frame][v.detection] >= 0; });
}

/// One round of message passing: every vehicle's message, and what follows from those of the
/// others.
struct GroundRound {
  std::vector<GroundNode> nodes;     // one a solution
  std::vector<std::string> reasons;  // why a node has no message
  GroundPropagation result;
};

GroundRound pass_messages(const std::vector<TrackFrame>& frames, const Eigen::MatrixXd& covariance,
                          const GroundRows& rows, const VehicleNoise& noise, int num_threads,
                          const std::vector<TrackSolution>& solutions) {
  GroundRound out;
  out.nodes.resize(solutions.size());
  out.reasons.resize(solutions.size());
  parallel_for(solutions.size(), num_threads, [&](std::size_t i) {
    const TrackSolution& solution = solutions[i];
    const VehiclePosterior& posterior = *solution.posterior;
    GroundNode& node = out.nodes[i];
    std::string& reason = out.reasons[i];
    for (const TrackView& v : solution.views) node.rows.push_back(rows[v.frame][v.detection]);
    node.lead = static_cast<std::size_t>(solution.lead);
    const TrackView& lead = solution.lead_view();
    const SupportPlane& support = frames[lead.frame].supports[lead.detection];
    // What no road point shows is the smoothness prior's, which others have already.
    if (support.status == Status::kNotObservable) {
      reason = "the plane below it is not observable";
      return;
    }
    reason = unreliable_reason(posterior, solution.lead, solution.answer(),
                               frames[lead.frame].detections[lead.detection].box);
    if (!reason.empty()) return;
    node.message = ground_message(posterior, solution.answer(), solution.lead, support.plane);
    if (!node.message) reason = "its posterior has no minimum";
  });
  out.result = propagate(covariance, out.nodes, noise.message.gate);
  return out;
}

/// Every vehicle is solved again with what the others' messages leave of its planes' prior.
void solve_with_cavities(const std::vector<TrackFrame>& frames, const GroundRound& round,
                         int num_threads, std::vector<TrackSolution>* solutions) {
  parallel_for(solutions->size(), num_threads, [&](std::size_t i) {
    TrackSolution& solution = (*solutions)[i];
    VehiclePosterior& posterior = *solution.posterior;
    const GroundCavity& cavity = round.result.cavities[i];
    for (int k = 0; k < posterior.num_views(); ++k) {
      const TrackView& v = solution.views[static_cast<std::size_t>(k)];
      UncertainPlane plane =
          changed_plane(frames[v.frame].supports[v.detection].plane, cavity.mean.segment<3>(3 * k));
      plane.covariance = cavity.covariance.block<3, 3>(3 * k, 3 * k);
      posterior.set_plane(k, plane);
    }
    const Eigen::Index last = cavity.mean.size() - 1;
    posterior.set_scale(cavity.mean[last], cavity.covariance(last, last));
    choose_hypothesis(&solution);
  });
}

std::vector<TrackMessage> report_messages(const GroundRound& round,
                                          const std::vector<TrackSolution>& solutions,
                                          const std::vector<std::vector<int>>& tracks) {
  std::vector<TrackMessage> out(solutions.size());
  for (std::size_t i = 0; i < solutions.size(); ++i) {
    const TrackView& lead = solutions[i].lead_view();
    out[i].track = tracks[lead.frame][lead.detection];
    out[i].lead = lead;
    out[i].views = solutions[i].views;
    out[i].reason = round.reasons[i];
    if (!round.nodes[i].message) continue;
    out[i].message = *round.nodes[i].message;
    out[i].weight = round.result.weights[i];
    out[i].mahalanobis = std::sqrt(round.result.squared_distances[i]);
    out[i].accepted = out[i].weight >= 0.5;
    if (!out[i].accepted) {
      out[i].reason = fmt::format("{:.1f} standard deviations off the road and the other vehicles",
                                  out[i].mahalanobis);
    }
  }
  return out;
}

}  // namespace

TrackFit fit_tracks(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
                    const VehicleFitOptions& options, int num_threads, double scale_sigma,
                    const SharedGround* ground) {
  options.validate();
  if (!(scale_sigma > 0.0)) {
    throw std::invalid_argument(fmt::format("scale_sigma: {}, must be > 0", scale_sigma));
  }
  const std::size_t pixels =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  for (const TrackFrame& f : frames) {
    if (f.vehicle_mask && f.vehicle_mask->size() != pixels) {
      throw std::invalid_argument(
          fmt::format("vehicle_mask: of {} pixels, must be of {}", f.vehicle_mask->size(), pixels));
    }
  }
  const std::vector<Track> tracks =
      tracks_of(find_tracks(camera, frames, options.noise.association));
  const bool shared = ground && ground->covariance.size() > 0;
  GroundRows rows;
  if (shared) rows = ground_rows(frames, *ground);
  // One view alone has a message and takes those of others where the ground is shared.
  const std::size_t least_views = shared ? 1 : 2;
  const VehiclePrior& prior = options.prior ? *options.prior : shipped_vehicle_prior();
  std::vector<std::optional<TrackSolution>> started(tracks.size());
  parallel_for(tracks.size(), num_threads, [&](std::size_t i) {
    if (tracks[i].size() < least_views) return;
    started[i] = start_track(camera, frames, tracks[i], options, scale_sigma, least_views);
    if (started[i]) solve_track(frames, prior, &*started[i]);
  });
  std::vector<TrackSolution> solutions, alone;
  for (std::optional<TrackSolution>& s : started) {
    if (s) (!shared || has_rows(rows, *s) ? solutions : alone).push_back(std::move(*s));
  }
  TrackFit out;
  out.tracks = reported_numbers(frames, tracks);
  if (shared) {
    const auto round = [&] {
      return pass_messages(frames, ground->covariance, rows, options.noise, num_threads, solutions);
    };
    for (int i = 0; i < kGroundRounds; ++i) {
      solve_with_cavities(frames, round(), num_threads, &solutions);
    }
    out.messages = report_messages(round(), solutions, out.tracks);
  }
  for (const TrackFrame& f : frames) out.estimates.push_back(f.estimates);
  std::move(alone.begin(), alone.end(), std::back_inserter(solutions));
  parallel_for(solutions.size(), num_threads,
               [&](std::size_t i) { write_track(frames, prior, solutions[i], &out.estimates); });
  return out;
}

}  // namespace camber
