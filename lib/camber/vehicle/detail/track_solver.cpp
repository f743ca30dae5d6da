#include "camber/vehicle/detail/track_solver.h"

#include <algorithm>
#include <cmath>

#include "camber/vehicle/detail/heading_hypotheses.h"
#include "camber/vehicle/detail/levenberg_marquardt.h"
#include "camber/vehicle/detail/vehicle_answer.h"

namespace camber::internal {

namespace {

bool has_reliable_keypoints(const VehicleEstimate& e) {
  return std::isfinite(e.reprojection_rmse_px);
}

double center_spread(const VehicleEstimate& e) {
  return e.covariance.topLeftCorner<3, 3>().trace();
}

/// A view of a track and where its vehicle is refined from.
struct ViewStart {
  TrackView view;
  const VehicleEstimate* own = nullptr;
  Eigen::Vector3d ahead;               // the vehicle's heading, world
  std::optional<VehicleState> turned;  // in place of the single fit: the other way round
};

std::vector<ViewStart>::iterator surest(std::vector<ViewStart>* starts) {
  return std::min_element(starts->begin(), starts->end(),
                          [](const ViewStart& a, const ViewStart& b) {
                            return center_spread(*a.own) < center_spread(*b.own);
                          });
}

/// A vehicle's single fit as a state of one view.
VehicleState state_of(const VehicleEstimate& e, const VehiclePosterior& posterior) {
  VehicleState s = posterior.mean_state();
  s.poses.assign(
      1, {e.pose.camera_from_vehicle.rotation_matrix(), e.pose.camera_from_vehicle.translation()});
  const auto count =
      std::min<std::size_t>(e.shape.size(), static_cast<std::size_t>(posterior.num_coefficients()));
  for (std::size_t i = 0; i < count; ++i) s.form.shape[static_cast<Eigen::Index>(i)] = e.shape[i];
  s.form.size = {e.pose.dimensions.length, e.pose.dimensions.width, e.pose.dimensions.height};
  return s;
}

/// Views that see the vehicle the other way round: front and rear of a far one look alike in each
/// of them, but not in all. Both headings are refined in every view, and all take the likelier one;
/// a view that clearly contradicts it is dropped.
void agree_on_heading(const PinholeCamera& camera, const std::vector<TrackFrame>& frames,
                      const VehicleFitOptions& options, const Eigen::Vector3d& ahead,
                      std::vector<ViewStart>* starts) {
  const double most = options.noise.hypotheses.heading_evidence;
  std::vector<HeadingPair> pairs;
  double evidence = 0.0;  // log likelihood of `ahead` over the opposite
  const auto same = [&](const ViewStart& s) { return s.ahead.dot(ahead) > 0.0; };
  for (const ViewStart& start : *starts) {
    const TrackFrame& frame = frames[start.view.frame];
    VehiclePosterior posterior(camera, frame.detections[start.view.detection],
                               frame.supports[start.view.detection], options,
                               options.num_coefficients);
    pairs.push_back(refine_both_headings(posterior, state_of(*start.own, posterior)));
    const double own = std::clamp(pairs.back().turned.cost - pairs.back().own.cost, -most, most);
    evidence += same(start) ? own : -own;
  }
  const bool along = !(evidence < 0.0);
  std::vector<ViewStart> out;
  for (std::size_t i = 0; i < starts->size(); ++i) {
    ViewStart start = (*starts)[i];
    const bool keep = same(start) == along;
    const Hypothesis& chosen = keep ? pairs[i].own : pairs[i].turned;
    const Hypothesis& other = keep ? pairs[i].turned : pairs[i].own;
    if (!(chosen.cost < other.cost + most)) continue;
    if (!keep) start.turned = chosen.state;
    out.push_back(std::move(start));
  }
  *starts = std::move(out);
}

/// Registers every view with the lead, from poses that are right to a few pixels.
void register_views(const std::vector<TrackFrame>& frames, const VehiclePrior& prior,
                    TrackSolution* solution) {
  VehiclePosterior& posterior = *solution->posterior;
  const VehicleState& state = solution->moving;
  const RegistrationNoise& noise = posterior.noise().registration;
  const TrackView& from = solution->lead_view();
  const TrackFrame& first = frames[from.frame];
  posterior.set_registration({});
  if (!first.image) return;
  const ViewPose& here = state.poses[static_cast<std::size_t>(solution->lead)];
  VehicleEstimate vehicle = first.estimates[from.detection];
  write_pose_and_form(prior, here, state.form, &vehicle);
  std::vector<const VehicleEstimate*> nearer;
  for (std::size_t i = 0; i < first.detections.size(); ++i) {
    const VehicleEstimate& other = first.estimates[i];
    if (i == from.detection || other.status == Status::kFailed) continue;
    if (other.pose.bottom_center().norm() < here.translation.norm()) nearer.push_back(&other);
  }
  const auto pixels = VehicleTemplate::cut(posterior.camera(), *first.image, vehicle, nearer, noise,
                                           first.vehicle_mask);
  if (!pixels) return;
  const SE3 vehicle_from_lead = SE3(here.rotation, here.translation).inverse();
  std::vector<RegisteredView> registered;
  for (int k = 0; k < posterior.num_views(); ++k) {
    const TrackFrame& second = frames[solution->views[static_cast<std::size_t>(k)].frame];
    if (k == solution->lead || !second.image) continue;
    const ViewPose& there = state.poses[static_cast<std::size_t>(k)];
    const auto shift =
        pixels->find_in(*second.image, SE3(there.rotation, there.translation) * vehicle_from_lead);
    if (shift) registered.push_back({k, *shift});
  }
  posterior.set_registration(
      {posterior.camera(), noise, solution->lead, here, state.form, registered});
}

/// The state with the vehicle where the lead view has it, in all views.
VehicleState parked_at_lead(const TrackSolution& solution) {
  const MotionPrior& motion = solution.posterior->motion();
  VehicleState out = solution.moving;
  out.motion = Motion::kParked;
  const ViewPose& lead = out.poses[static_cast<std::size_t>(solution.lead)];
  const SE3 world_from_vehicle =
      motion.camera(solution.lead).world_from_camera * SE3(lead.rotation, lead.translation);
  for (int k = 0; k < solution.posterior->num_views(); ++k) {
    const SE3 pose = motion.camera(k).world_from_camera.inverse() * world_from_vehicle;
    out.poses[static_cast<std::size_t>(k)] = {pose.rotation_matrix(), pose.translation()};
  }
  return out;
}

}  // namespace

std::optional<TrackSolution> start_track(const PinholeCamera& camera,
                                         const std::vector<TrackFrame>& frames, const Track& track,
                                         const VehicleFitOptions& options, double scale_sigma,
                                         std::size_t least_views) {
  std::vector<ViewStart> starts;
  for (const TrackView& v : track) {
    const TrackFrame& frame = frames[v.frame];
    const VehicleEstimate& e = frame.estimates[v.detection];
    if (!has_reliable_keypoints(e)) continue;
    starts.push_back(
        {v, &e,
         frame.world_from_camera.rotation() * e.pose.camera_from_vehicle.rotation_matrix().col(0),
         std::nullopt});
  }
  if (starts.size() < std::max<std::size_t>(least_views, 1)) return std::nullopt;
  // The surest view gives the heading, but for its sense; views that see another one are left out.
  const Eigen::Vector3d ahead = surest(&starts)->ahead;
  const double same_axis = options.noise.hypotheses.same_axis;
  starts.erase(
      std::remove_if(starts.begin(), starts.end(),
                     [&](const ViewStart& s) { return std::abs(s.ahead.dot(ahead)) < same_axis; }),
      starts.end());
  if (std::any_of(starts.begin(), starts.end(),
                  [&](const ViewStart& s) { return s.ahead.dot(ahead) < 0.0; })) {
    agree_on_heading(camera, frames, options, ahead, &starts);
  }
  // Its keypoints' names stay swapped here: its own fit knows better.
  if (starts.size() < std::max<std::size_t>(least_views, 1) ||
      (starts.size() == 1 && starts.front().own->reason == kSidesSwapped)) {
    return std::nullopt;
  }

  TrackSolution out;
  std::vector<PosteriorView> views;
  for (const ViewStart& s : starts) {
    const TrackFrame& f = frames[s.view.frame];
    out.views.push_back(s.view);
    views.push_back({&f.detections[s.view.detection],
                     &f.supports[s.view.detection],
                     {f.world_from_camera, f.time_s, f.pose_sigma_turn, f.pose_sigma_shift}});
  }
  out.lead = static_cast<int>(surest(&starts) - starts.begin());
  const auto lead = static_cast<std::size_t>(out.lead);
  out.posterior =
      std::make_unique<VehiclePosterior>(camera, views, views[lead].detection->vehicle_class,
                                         options, options.num_coefficients, scale_sigma);
  out.moving = out.posterior->mean_state();
  for (std::size_t k = 0; k < starts.size(); ++k) {
    const VehicleState own =
        starts[k].turned ? *starts[k].turned : state_of(*starts[k].own, *out.posterior);
    out.moving.poses[k] = own.poses.front();
    // Visibility and noise as the view's own fit shows them; one size and shape for all.
    out.posterior->keypoints(static_cast<int>(k))
        .prepare(BodyView(out.posterior->body(), camera, own.poses.front(), own.form));
    if (k == lead) out.moving.form = own.form;
  }
  return out;
}

void choose_hypothesis(TrackSolution* solution) {
  const VehiclePosterior& posterior = *solution->posterior;
  // Along the viewing ray the valley is long and flat.
  constexpr int kIterations = 60;
  constexpr double kTolerance = 5e-4;
  const double moving_cost = refine(posterior, &solution->moving, kIterations, kTolerance);
  if (posterior.num_views() < 2) return;
  // A parked hypothesis that is pruned need not be refined to the end.
  const double pruned = moving_cost + posterior.noise().hypotheses.parked_pruned;
  double parked_cost = refine(posterior, &solution->parked, 8, 0.01);
  if (parked_cost < pruned) {
    parked_cost = refine(posterior, &solution->parked, kIterations, kTolerance);
  }
  solution->is_parked = parked_cost < pruned && posterior.minus_log_evidence(solution->parked) <
                                                    posterior.minus_log_evidence(solution->moving);
}

void solve_track(const std::vector<TrackFrame>& frames, const VehiclePrior& prior,
                 TrackSolution* solution) {
  // Within a pixel or two, for the registration.
  refine(*solution->posterior, &solution->moving, 10, 0.1);
  register_views(frames, prior, solution);
  solution->parked = parked_at_lead(*solution);
  choose_hypothesis(solution);
}

void write_track(const std::vector<TrackFrame>& frames, const VehiclePrior& prior,
                 const TrackSolution& solution,
                 std::vector<std::vector<VehicleEstimate>>* estimates) {
  const VehiclePosterior& posterior = *solution.posterior;
  PosteriorMean answer = posterior_mean(posterior, solution.answer());
  if (!answer.minimum) return;
  add_contradictions(posterior, solution.answer(), &answer);
  for (int k = 0; k < posterior.num_views(); ++k) {
    const TrackView& v = solution.views[static_cast<std::size_t>(k)];
    const TrackFrame& frame = frames[v.frame];
    VehicleEstimate estimate = frame.estimates[v.detection];
    if (!unreliable_reason(posterior, k, answer.state, frame.detections[v.detection].box).empty()) {
      continue;
    }
    write_answer(posterior, k, prior, answer, std::numeric_limits<double>::infinity(), &estimate);
    if (posterior.num_views() == 1 && estimate.status == Status::kOk &&
        frame.estimates[v.detection].reason == kTwoHeadings) {
      estimate.status = Status::kWeak;
      estimate.reason = kTwoHeadings;
    }
    finish_answer(frame.supports[v.detection], &estimate);
    if (estimate.status != Status::kFailed) (*estimates)[v.frame][v.detection] = estimate;
  }
}

}  // namespace camber::internal
