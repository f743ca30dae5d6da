#include "camber/vehicle/fit_vehicle.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/vehicle/single_view_problem.h"

namespace camber {

namespace {

using namespace internal;

/// The box alone: every heading is possible, so the answer is the posterior's mean over headings.
bool fit_box(SingleViewProblem& problem, const Box2& box, VehicleEstimate* out,
             const VehiclePrior& prior, int num_yaws) {
  const std::vector<Eigen::Vector3d> guesses = problem.position_guesses(box);
  std::vector<Solution> solutions;
  for (int i = 0; i < num_yaws; ++i) {
    // A half turn: front and rear look alike in a box.
    const double yaw = kPi * i / num_yaws;
    Solution best;
    for (const Eigen::Vector3d& guess : guesses) {
      Solution candidate;
      candidate.state = problem.mean_state();
      candidate.state.rotation = problem.rotation_at(yaw);
      candidate.state.translation = guess;
      candidate.cost = problem.refine(&candidate.state, 25, 1e-4);
      if (candidate.cost < best.cost) best = candidate;
    }
    if (std::isfinite(best.cost)) solutions.push_back(best);
  }
  if (solutions.empty()) return false;
  const auto least =
      std::min_element(solutions.begin(), solutions.end(),
                       [](const Solution& a, const Solution& b) { return a.cost < b.cost; });
  const double least_cost = least->cost;
  // Weights: posterior density times the volume of its peak.
  std::vector<double> weights;
  std::vector<Eigen::Matrix<double, 9, 9>> covariances;
  double total = 0.0;
  for (const Solution& s : solutions) {
    Matrix hessian;
    Vector gradient;
    problem.evaluate(s.state, &hessian, &gradient);
    const Matrix covariance = inverse_of(hessian);
    covariances.push_back(report_covariance(s.state, covariance));
    weights.push_back(std::exp(least_cost - s.cost));
    total += weights.back();
  }
  Eigen::Vector3d center = Eigen::Vector3d::Zero(), size = Eigen::Vector3d::Zero();
  auto center_of = [](const State& s) -> Eigen::Vector3d {
    return s.translation + 0.5 * s.size[2] * s.rotation.col(1);
  };
  for (std::size_t i = 0; i < solutions.size(); ++i) {
    weights[i] /= total;
    center += weights[i] * center_of(solutions[i].state);
    size += weights[i] * solutions[i].state.size;
  }
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Zero();
  for (std::size_t i = 0; i < solutions.size(); ++i) {
    Eigen::Matrix<double, 9, 1> difference = Eigen::Matrix<double, 9, 1>::Zero();
    difference.head<3>() = center_of(solutions[i].state) - center;
    difference.tail<3>() = solutions[i].state.size - size;
    covariance += weights[i] * (covariances[i] + difference * difference.transpose());
  }
  covariance(4, 4) += kPi * kPi / 3.0;  // heading: uniform over the circle
  State s = least->state;
  s.size = size;
  s.translation = center - 0.5 * size[2] * s.rotation.col(1);
  write_state(prior, s, out);
  out->covariance = covariance;
  return true;
}

void keep_best(std::size_t count, std::vector<Solution>* solutions) {
  solutions->erase(std::remove_if(solutions->begin(), solutions->end(),
                                  [](const Solution& s) { return !std::isfinite(s.cost); }),
                   solutions->end());
  std::stable_sort(solutions->begin(), solutions->end(),
                   [](const Solution& a, const Solution& b) { return a.cost < b.cost; });
  if (solutions->size() > count) solutions->resize(count);
}

/// The best headings with the mean vehicle, best first.
std::vector<Solution> coarse_starts(SingleViewProblem& coarse, const Box2& box, int num_yaws) {
  const std::vector<Eigen::Vector3d> guesses = coarse.position_guesses(box);
  std::vector<Solution> starts;
  for (int i = 0; i < num_yaws; ++i) {
    Solution s;
    s.cost = coarse.start_at(2.0 * kPi * i / num_yaws, guesses, &s.state);
    if (std::isfinite(s.cost)) starts.push_back(s);
  }
  keep_best(5, &starts);
  for (Solution& s : starts) {
    for (const int iterations : {5, 8}) {
      coarse.update_visibility(s.state);
      s.cost = coarse.refine(&s.state, iterations, 1e-2);
    }
  }
  keep_best(5, &starts);
  return starts;
}

double wrapped(double angle) { return std::remainder(angle, 2.0 * kPi); }

double heading(const State& s) { return std::atan2(s.rotation(0, 0), s.rotation(2, 0)); }

/// The best start of each heading, at most three, refined with all coefficients; best first.
std::vector<Solution> with_coefficients(SingleViewProblem& problem,
                                        const std::vector<Solution>& starts) {
  std::vector<Solution> ends;
  for (const Solution& s : starts) {
    const bool known = std::any_of(ends.begin(), ends.end(), [&](const Solution& other) {
      return std::abs(wrapped(heading(s.state) - heading(other.state))) < 0.35;
    });
    const bool hopeless = !ends.empty() && s.cost > ends.front().cost + 25.0;
    if (!known && !hopeless && ends.size() < 3) ends.push_back(s);
  }
  for (Solution& s : ends) {
    s.state.shape = Vector::Zero(problem.num_coefficients());
    for (const int iterations : {4, 6}) {
      problem.update_visibility(s.state);
      s.cost = problem.refine(&s.state, iterations, 1e-2);
    }
  }
  keep_best(3, &ends);
  return ends;
}

VehicleDetection with_sides_swapped(const VehicleDetection& detection) {
  VehicleDetection out = detection;
  for (int i = 0; i < kNumSideKeypoints; ++i) {
    std::swap(out.keypoints[static_cast<std::size_t>(i)],
              out.keypoints[static_cast<std::size_t>(i + kNumSideKeypoints)]);
  }
  return out;
}

}  // namespace

namespace internal {

void write_answer(const SingleViewProblem& problem, const VehiclePrior& prior, const State& s,
                  const Matrix& covariance, double rival, VehicleEstimate* out) {
  write_state(prior, s, out);
  out->covariance = report_covariance(s, covariance);
  out->plane = problem.posterior_plane(s, covariance, out->covariance.topLeftCorner<3, 3>(),
                                       &out->plane_sigma_height);
  out->reprojection_rmse_px = problem.agreement(s).rmse_px;
  out->status = Status::kOk;
  out->reason.clear();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spread(out->covariance.topLeftCorner<3, 3>(),
                                                              Eigen::EigenvaluesOnly);
  const double sigma = std::sqrt(std::max(spread.eigenvalues().maxCoeff(), 0.0));
  if (rival < 3.0) {
    out->status = Status::kWeak;
    out->reason = kTwoHeadings;
  } else if (problem.plane_mahalanobis(s) > 25.0) {
    out->status = Status::kWeak;
    out->reason = "the keypoints contradict the plane";
  } else if (sigma > 0.08 * s.translation.norm()) {
    out->status = Status::kWeak;
    out->reason = fmt::format("position known to {:.1f} m only", sigma);
  }
}

void finish_answer(const SupportPlane& support, VehicleEstimate* out) {
  if (support.status == Status::kNotObservable || support.status == Status::kFailed) {
    out->status = Status::kNotObservable;
    if (out->reason.empty()) out->reason = "the plane below it is not observable";
  } else if (support.status == Status::kWeak && out->status == Status::kOk) {
    out->status = Status::kWeak;
    out->reason = "the plane below it is weak";
  }
  if (!std::isfinite(out->plane_sigma_height)) {
    out->plane_sigma_height =
        std::sqrt(std::max(support.plane.height_variance(out->pose.bottom_center()), 0.0));
  }
  if (!out->covariance.allFinite() || !out->pose.bottom_center().allFinite()) {
    out->status = Status::kFailed;
    out->reason = "the fit did not converge";
  }
}

}  // namespace internal

void VehicleFitOptions::validate() const {
  auto require = [](bool good, const char* name, double value, const char* bound) {
    if (!good) throw std::invalid_argument(fmt::format("{}: {}, must be {}", name, value, bound));
  };
  require(keypoint_sigma > 0.0 && keypoint_sigma < 1.0, "keypoint_sigma", keypoint_sigma,
          "in (0, 1)");
  require(box_sigma > 0.0 && box_sigma < 1.0, "box_sigma", box_sigma, "in (0, 1)");
  require(num_coefficients >= 0 && num_coefficients <= kMaxCoefficients, "num_coefficients",
          num_coefficients, "in [0, 20]");
  require(num_yaws >= 4 && num_yaws <= 360, "num_yaws", num_yaws, "in [4, 360]");
  require(stance_sigma_height > 0.0, "stance_sigma_height", stance_sigma_height, "> 0");
  require(stance_sigma_tilt > 0.0, "stance_sigma_tilt", stance_sigma_tilt, "> 0");
  require(keypoint_set == 14 || keypoint_set == 36, "keypoint_set", keypoint_set, "14 or 36");
}

VehicleEstimate fit_vehicle(const PinholeCamera& camera, const VehicleDetection& detection,
                            const SupportPlane& support, const VehicleFitOptions& options) {
  options.validate();
  camera.validate();
  if (!detection.keypoints.empty() &&
      detection.keypoints.size() != static_cast<std::size_t>(kNumKeypoints)) {
    throw std::invalid_argument(fmt::format("detection.keypoints: {} rows, must be 0 or {}",
                                            detection.keypoints.size(), kNumKeypoints));
  }
  const VehiclePrior& prior = options.prior ? *options.prior : shipped_vehicle_prior();
  VehicleEstimate out;
  out.id = detection.id;
  out.vehicle_class = detection.vehicle_class;
  out.box = detection.box;
  out.plane = support.plane.plane;
  out.plane_source = support.source;
  const Box2& box = detection.box;
  const bool finite_box = std::isfinite(box.x1) && std::isfinite(box.x2) && std::isfinite(box.y1) &&
                          std::isfinite(box.y2);
  if (!finite_box || !(box.width() > 0.0) || !(box.height() > 0.0)) {
    out.status = Status::kFailed;
    out.reason = "the detection box has no area";
    return out;
  }
  if (box.x2 < -0.5 || box.y2 < -0.5 || box.x1 > camera.width - 0.5 ||
      box.y1 > camera.height - 0.5) {
    out.status = Status::kFailed;
    out.reason = "the detection box lies outside the image";
    return out;
  }

  int finite_keypoints = 0;
  for (const KeypointObservation& k : detection.keypoints) {
    finite_keypoints += k.pixel.allFinite() ? 1 : 0;
  }
  std::string distrust;  // why the keypoints are not used
  if (prior.has_shape(detection.vehicle_class) && finite_keypoints > 0) {
    // First the mean shape, then all coefficients for the best headings.
    SingleViewProblem coarse(camera, detection, support, options, /*use_keypoints=*/true, 0);
    std::vector<Solution> starts = coarse_starts(coarse, box, options.num_yaws);
    // A network may take left for right; then the mirrored names fit far better.
    const VehicleDetection mirrored = with_sides_swapped(detection);
    SingleViewProblem coarse_mirrored(camera, mirrored, support, options, /*use_keypoints=*/true,
                                      0);
    std::vector<Solution> mirrored_starts = coarse_starts(coarse_mirrored, box, options.num_yaws);
    SingleViewProblem own(camera, detection, support, options, /*use_keypoints=*/true,
                          options.num_coefficients);
    std::vector<Solution> ends = with_coefficients(own, starts);
    // Mean shapes tell the namings apart but roughly.
    constexpr double kSwapEvidence = 3.0;  // log likelihood
    std::optional<SingleViewProblem> other;
    if (!mirrored_starts.empty() &&
        (starts.empty() || mirrored_starts.front().cost + kSwapEvidence < starts.front().cost)) {
      other.emplace(camera, mirrored, support, options, /*use_keypoints=*/true,
                    options.num_coefficients);
      std::vector<Solution> mirrored_ends = with_coefficients(*other, mirrored_starts);
      if (!mirrored_ends.empty() &&
          (ends.empty() || mirrored_ends.front().cost + kSwapEvidence < ends.front().cost)) {
        ends = std::move(mirrored_ends);
      } else {
        other.reset();
      }
    }
    const bool swapped = other.has_value();
    SingleViewProblem& problem = swapped ? *other : own;
    if (ends.empty()) {
      distrust = "no pose fits the keypoints";
    } else {
      Solution best = ends.front();
      // Cost above the best of the best other heading.
      const double rival = ends.size() > 1 ? ends[1].cost - best.cost : kInfinity;
      problem.update_visibility(best.state);
      problem.decide_on_confidence(best.state);
      problem.refine(&best.state, 5, 1e-2);
      problem.adapt_noise(best.state);
      problem.update_visibility(best.state);
      best.cost = problem.refine(&best.state, 20, 1e-4);

      distrust = distrust_of(problem, best.state, camera, box);
      if (distrust.empty()) {
        Matrix hessian;
        Vector gradient;
        problem.evaluate(best.state, &hessian, &gradient, /*observed=*/true);
        const Matrix covariance = inverse_of(hessian);
        // The answer is the maximum once the shape is integrated out.
        State answer = best.state;
        const int shape = problem.num_coefficients();
        if (shape > 0) {
          const Matrix of_shape = inverse_of(hessian.bottomRightCorner(shape, shape));
          answer =
              problem.moved(best.state, -covariance.leftCols(kPoseParameters + kSizeParameters) *
                                            problem.shape_pull(best.state, of_shape));
        }
        write_answer(problem, prior, answer, covariance, rival, &out);
        if (swapped && out.status == Status::kOk) {
          out.status = Status::kWeak;
          out.reason = kSidesSwapped;
        }
      }
    }
  }
  if (out.status == Status::kNotRun) {
    SingleViewProblem problem(camera, detection, support, options, /*use_keypoints=*/false, 0);
    if (!fit_box(problem, box, &out, prior, std::max(4, options.num_yaws / 2))) {
      out.status = Status::kFailed;
      out.reason = "no place in front of the camera fits the box";
      return out;
    }
    if (!distrust.empty()) {
      out.status = Status::kNotObservable;
      out.reason = distrust + "; placed by its box";
    } else {
      out.status = Status::kWeak;
      out.reason = "placed by its box, heading unknown";
    }
  }
  finish_answer(support, &out);
  return out;
}

std::vector<VehicleEstimate> fit_vehicles(const PinholeCamera& camera,
                                          const std::vector<VehicleDetection>& detections,
                                          const std::vector<SupportPlane>& supports,
                                          const VehicleFitOptions& options, int num_threads) {
  if (detections.size() != supports.size()) {
    throw std::invalid_argument(
        fmt::format("supports: {} given, {} detections", supports.size(), detections.size()));
  }
  std::vector<VehicleEstimate> out(detections.size());
  parallel_for(detections.size(), num_threads, [&](std::size_t i) {
    out[i] = fit_vehicle(camera, detections[i], supports[i], options);
  });
  return out;
}

}  // namespace camber
