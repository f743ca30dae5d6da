#include "camber/vehicle/detail/heading_hypotheses.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "camber/vehicle/detail/levenberg_marquardt.h"

namespace camber::internal {

namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr std::size_t kMostStarts = 5;  // refined with the mean shape
constexpr std::size_t kMostEnds = 3;    // refined with all coefficients

void keep_best(std::size_t count, std::vector<Hypothesis>* hypotheses) {
  hypotheses->erase(std::remove_if(hypotheses->begin(), hypotheses->end(),
                                   [](const Hypothesis& h) { return !std::isfinite(h.cost); }),
                    hypotheses->end());
  std::stable_sort(hypotheses->begin(), hypotheses->end(),
                   [](const Hypothesis& a, const Hypothesis& b) { return a.cost < b.cost; });
  if (hypotheses->size() > count) hypotheses->resize(count);
}

double heading(const VehicleState& s) {
  const Eigen::Matrix3d& r = s.poses.front().rotation;
  return std::atan2(r(0, 0), r(2, 0));
}

double wrapped(double angle) { return std::remainder(angle, 2.0 * kPi); }

/// The position with rotation and form held: the linear problem of the keypoints' rays and the
/// plane, reweighted from a wide robust scale to a narrow one (a wrong start must still feel all
/// keypoints).
Eigen::Vector3d linear_position(const VehiclePosterior& posterior, const VehicleState& state) {
  const KeypointLikelihood& keypoints = posterior.keypoints(0);
  const PinholeCamera& camera = posterior.camera();
  const UncertainPlane& support = posterior.contact(0).plane();
  const Plane& plane = support.plane;
  const HypothesisGates& gates = posterior.noise().hypotheses;
  const double contact = posterior.noise().contact.sigma_height;
  const BodyView at = posterior.view(0, state);
  std::vector<Eigen::Vector3d> offsets;  // of the keypoints from the bottom centre, camera frame
  for (const int point : keypoints.points()) {
    offsets.push_back(state.poses.front().rotation * at.in_vehicle(point));
  }
  Eigen::Vector3d position = state.poses.front().translation;
  for (int iteration = 0; iteration < 4; ++iteration) {
    const double scale = gates.start_scales[std::min(iteration, 2)];  // cells
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t j = 0; j < offsets.size(); ++j) {
      const Eigen::Vector3d x = offsets[j] + position;
      const double z = std::max(x.z(), 1.0);
      const Eigen::Vector3d& ray = keypoints.ray(j);
      const Eigen::Vector3d row_u(1.0, 0.0, -ray.x()), row_v(0.0, 1.0, -ray.y());
      const double ku = camera.fx / (z * keypoints.cell_u());
      const double kv = camera.fy / (z * keypoints.cell_v());
      const double ru = ku * row_u.dot(x), rv = kv * row_v.dot(x);
      const double weight = 1.0 / (1.0 + (ru * ru + rv * rv) / (scale * scale)) *
                            (gates.start_min_seen + keypoints.seen_share(j));
      normal +=
          weight * (ku * ku * row_u * row_u.transpose() + kv * kv * row_v * row_v.transpose());
      right -= weight *
               (ku * ku * row_u * row_u.dot(offsets[j]) + kv * kv * row_v * row_v.dot(offsets[j]));
    }
    const double variance = support.height_variance(position) + contact * contact +
                            gates.start_height_sigma * gates.start_height_sigma;
    normal += plane.normal * plane.normal.transpose() / variance;
    right -= plane.normal * plane.offset / variance;
    const Eigen::Vector3d solved = normal.ldlt().solve(right);
    if (!solved.allFinite() || solved.z() < 1.0) break;
    position = solved;
  }
  return position;
}

}  // namespace

Eigen::Matrix3d rotation_at(const Plane& plane, double yaw) {
  const Eigen::Vector3d& n = plane.normal;
  Eigen::Vector3d ahead(0.0, 0.0, 1.0);
  ahead -= ahead.dot(n) * n;
  if (ahead.norm() < 1e-3) ahead = Eigen::Vector3d(1.0, 0.0, 0.0) - n.x() * n;
  ahead.normalize();
  const Eigen::Vector3d right = ahead.cross(n);
  Eigen::Matrix3d r;
  r.col(0) = std::cos(yaw) * ahead + std::sin(yaw) * right;
  r.col(1) = n;
  r.col(2) = r.col(0).cross(n);
  return r;
}

std::vector<Eigen::Vector3d> position_guesses(const PinholeCamera& camera, const Plane& plane,
                                              double height, const Box2& box) {
  constexpr double kNearest = 2.0, kFarthest = 300.0;  // m
  std::vector<Eigen::Vector3d> out;
  const double by_size =
      std::clamp(camera.fy * height / std::max(box.height(), 1.0), kNearest, kFarthest);
  out.emplace_back(by_size * camera.ray({box.center().x(), box.y2}));
  // Halfway up the box the vehicle is at half its height above the plane.
  Plane raised = plane;
  raised.offset -= 0.5 * height;
  if (const auto hit = raised.intersect_ray(camera.ray(box.center()))) {
    if (hit->z() > 1.0 && hit->z() < kFarthest) {
      out.emplace_back(*hit - 0.5 * height * plane.normal);
    }
  }
  return out;
}

std::vector<Hypothesis> coarse_starts(VehiclePosterior& coarse, const Box2& box, int num_yaws) {
  const Plane& plane = coarse.contact(0).plane().plane;
  const std::vector<Eigen::Vector3d> guesses =
      position_guesses(coarse.camera(), plane, coarse.mean_size()[2], box);
  std::vector<Hypothesis> starts;
  for (int i = 0; i < num_yaws; ++i) {
    Hypothesis best;
    for (const Eigen::Vector3d& guess : guesses) {
      Hypothesis start;
      start.state = coarse.mean_state();
      ViewPose& pose = start.state.poses.front();
      pose.rotation = rotation_at(plane, 2.0 * kPi * i / num_yaws);
      pose.translation = guess;
      coarse.update_visibility(start.state);
      pose.translation = linear_position(coarse, start.state);
      start.cost = coarse.evaluate(start.state, nullptr);
      if (start.cost < best.cost) best = std::move(start);
    }
    if (std::isfinite(best.cost)) starts.push_back(std::move(best));
  }
  keep_best(kMostStarts, &starts);
  for (Hypothesis& s : starts) {
    for (const int iterations : {5, 8}) {
      coarse.update_visibility(s.state);
      s.cost = refine(coarse, &s.state, iterations, 1e-2);
    }
  }
  keep_best(kMostStarts, &starts);
  return starts;
}

std::vector<Hypothesis> with_coefficients(VehiclePosterior& posterior,
                                          const std::vector<Hypothesis>& starts) {
  const HypothesisGates& gates = posterior.noise().hypotheses;
  std::vector<Hypothesis> ends;
  for (const Hypothesis& s : starts) {
    const bool known = std::any_of(ends.begin(), ends.end(), [&](const Hypothesis& other) {
      return std::abs(wrapped(heading(s.state) - heading(other.state))) < gates.same_heading;
    });
    const bool pruned = !ends.empty() && s.cost > ends.front().cost + gates.pruned;
    if (!known && !pruned && ends.size() < kMostEnds) ends.push_back(s);
  }
  for (Hypothesis& s : ends) {
    s.state.form.shape = Eigen::VectorXd::Zero(posterior.num_coefficients());
    for (const int iterations : {4, 6}) {
      posterior.update_visibility(s.state);
      s.cost = refine(posterior, &s.state, iterations, 1e-2);
    }
  }
  keep_best(kMostEnds, &ends);
  return ends;
}

std::vector<Hypothesis> box_hypotheses(VehiclePosterior& posterior, const Box2& box, int num_yaws) {
  const Plane& plane = posterior.contact(0).plane().plane;
  const std::vector<Eigen::Vector3d> guesses =
      position_guesses(posterior.camera(), plane, posterior.mean_size()[2], box);
  std::vector<Hypothesis> out;
  for (int i = 0; i < num_yaws; ++i) {
    Hypothesis best;
    for (const Eigen::Vector3d& guess : guesses) {
      Hypothesis candidate;
      candidate.state = posterior.mean_state();
      // A half turn: front and rear look alike in a box.
      candidate.state.poses.front() = {rotation_at(plane, kPi * i / num_yaws), guess};
      candidate.cost = refine(posterior, &candidate.state, 25, 1e-4);
      if (candidate.cost < best.cost) best = std::move(candidate);
    }
    if (std::isfinite(best.cost)) out.push_back(std::move(best));
  }
  return out;
}

VehicleDetection with_sides_swapped(const VehicleDetection& detection) {
  VehicleDetection out = detection;
  for (std::size_t i = 0; i < kNumSideKeypoints; ++i) {
    std::swap(out.keypoints[i], out.keypoints[i + kNumSideKeypoints]);
  }
  return out;
}

HeadingPair refine_both_headings(VehiclePosterior& posterior, const VehicleState& own) {
  HeadingPair out;
  out.own.state = out.turned.state = own;
  Eigen::Matrix3d& rotation = out.turned.state.poses.front().rotation;
  rotation.col(0) *= -1.0;
  rotation.col(2) *= -1.0;
  for (Hypothesis* h : {&out.own, &out.turned}) {
    for (int round = 0; round < 3; ++round) {
      posterior.update_visibility(h->state);
      h->cost = refine(posterior, &h->state, 8, 1e-2);
    }
  }
  return out;
}

}  // namespace camber::internal
