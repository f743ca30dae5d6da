#include "camber/vehicle/fit_vehicle.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

#include "camber/core/threads.h"
#include "camber/vehicle/detail/heading_hypotheses.h"
#include "camber/vehicle/detail/levenberg_marquardt.h"
#include "camber/vehicle/detail/linear_algebra.h"
#include "camber/vehicle/detail/vehicle_answer.h"

namespace camber {

namespace {

using namespace internal;

constexpr double kPi = 3.14159265358979323846;

/// What is known under one of several hypotheses of the heading. Where a box knows nothing of the
/// heading, or where its posterior bends the other way, the heading is within half a step of the
/// hypotheses: without that the inverse of the information is no covariance.
PosteriorMean mean_of_hypothesis(const VehiclePosterior& posterior, const VehicleState& state,
                                 std::size_t hypotheses) {
  PosteriorMean mean = posterior_mean(posterior, state);
  if (mean.covariance.size() == 0) return mean;
  const int heading = posterior.layout().pose(0) + 4;
  const double any = kPi * kPi / 3.0;  // rad^2, uniform over the circle
  if (mean.minimum && mean.covariance(heading, heading) < any) return mean;
  const double step = kPi / static_cast<double>(hypotheses);
  Eigen::MatrixXd information = mean.information;
  const double known = 12.0 / (step * step);
  information(heading, heading) = std::max(information(heading, heading), 0.0) + known;
  mean.covariance = SymmetricFactors(information).inverse();
  Eigen::VectorXd gradient_change = Eigen::VectorXd::Zero(posterior.layout().total());
  gradient_change.segment<kPoseParameters>(posterior.layout().pose(0)) =
      posterior.contact(0).gradient_by_unmodelled(state.poses.front());
  mean.raised = mean.covariance * gradient_change;
  return mean;
}

/// The box alone: every heading is possible, so the answer is the posterior's mean over headings.
/// @return false: no place in front of the camera fits.
bool fit_box(const PinholeCamera& camera, const VehicleDetection& detection,
             const SupportPlane& support, const VehicleFitOptions& options,
             const VehiclePrior& prior, VehicleEstimate* out) {
  VehiclePosterior posterior(camera, detection, support, options, /*num_coefficients=*/0);
  posterior.keypoints(0).clear();
  const std::vector<Hypothesis> hypotheses =
      box_hypotheses(posterior, detection.box, std::max(4, options.num_yaws / 2));
  if (hypotheses.empty()) return false;
  const auto least =
      std::min_element(hypotheses.begin(), hypotheses.end(),
                       [](const Hypothesis& a, const Hypothesis& b) { return a.cost < b.cost; });
  std::vector<double> weights;
  double total = 0.0;
  for (const Hypothesis& h : hypotheses) {
    weights.push_back(std::exp(least->cost - h.cost));
    total += weights.back();
  }
  // Of the box's centre and the size.
  const auto place = [](const VehicleState& s) {
    const ViewPose& pose = s.poses.front();
    Eigen::Matrix<double, 6, 1> x;
    x << pose.translation + 0.5 * s.form.size[2] * pose.rotation.col(1), s.form.size;
    return x;
  };
  Eigen::Matrix<double, 6, 1> mean = Eigen::Matrix<double, 6, 1>::Zero();
  for (std::size_t i = 0; i < hypotheses.size(); ++i) {
    weights[i] /= total;
    mean += weights[i] * place(hypotheses[i].state);
  }
  ReportCovariance covariance = ReportCovariance::Zero();
  for (std::size_t i = 0; i < hypotheses.size(); ++i) {
    const VehicleState& s = hypotheses[i].state;
    const Eigen::MatrixXd own =
        stated_covariance(posterior, 0, mean_of_hypothesis(posterior, s, hypotheses.size()));
    const Eigen::Matrix<double, 6, 1> off = place(s) - mean;
    Eigen::Matrix<double, 9, 1> difference = Eigen::Matrix<double, 9, 1>::Zero();
    difference.head<3>() = off.head<3>();
    difference.tail<3>() << off[3], off[5], off[4];  // length, height, width
    covariance +=
        weights[i] * (report_covariance(s.poses.front(), s.form, own, options.noise.form) +
                      difference * difference.transpose());
  }
  covariance(4, 4) += kPi * kPi / 3.0;  // heading: uniform over the circle
  ViewPose pose = least->state.poses.front();
  Form form = least->state.form;
  form.size = mean.tail<3>();
  pose.translation = mean.head<3>() - 0.5 * form.size[2] * pose.rotation.col(1);
  write_pose_and_form(prior, pose, form, out);
  out->covariance = covariance;
  return true;
}

/// Keypoints under the names of the detection, or with left and right swapped.
struct Naming {
  std::unique_ptr<VehiclePosterior> posterior;
  std::vector<Hypothesis> ends;  // of each heading, best first
  bool swapped = false;
};

/// First the mean shape, then all coefficients for the best headings. A network may take left for
/// right; then the mirrored names fit far better.
Naming choose_naming(const PinholeCamera& camera, const VehicleDetection& detection,
                     const SupportPlane& support, const VehicleFitOptions& options) {
  const double evidence = options.noise.hypotheses.swap_evidence;
  const auto better = [&](const std::vector<Hypothesis>& a, const std::vector<Hypothesis>& b) {
    return !a.empty() && (b.empty() || a.front().cost + evidence < b.front().cost);
  };
  const VehicleDetection mirrored = with_sides_swapped(detection);
  const auto coarse = [&](const VehicleDetection& d) {
    VehiclePosterior posterior(camera, d, support, options, /*num_coefficients=*/0);
    return coarse_starts(posterior, d.box, options.num_yaws);
  };
  const auto fine = [&](const VehicleDetection& d, const std::vector<Hypothesis>& starts) {
    Naming out;
    out.posterior =
        std::make_unique<VehiclePosterior>(camera, d, support, options, options.num_coefficients);
    out.ends = with_coefficients(*out.posterior, starts);
    return out;
  };
  const std::vector<Hypothesis> starts = coarse(detection);
  const std::vector<Hypothesis> mirrored_starts = coarse(mirrored);
  Naming own = fine(detection, starts);
  // Mean shapes distinguish the namings only roughly.
  if (!better(mirrored_starts, starts)) return own;
  Naming other = fine(mirrored, mirrored_starts);
  if (!better(other.ends, own.ends)) return own;
  other.swapped = true;
  return other;
}

/// @return why the keypoints are not used; empty: *out is the answer.
std::string fit_keypoints(const PinholeCamera& camera, const VehicleDetection& detection,
                          const SupportPlane& support, const VehicleFitOptions& options,
                          const VehiclePrior& prior, VehicleEstimate* out) {
  const Naming naming = choose_naming(camera, detection, support, options);
  if (naming.ends.empty()) return "no pose fits the keypoints";
  VehiclePosterior& posterior = *naming.posterior;
  VehicleState best = naming.ends.front().state;
  // Cost above the best of the best other heading.
  const double rival = naming.ends.size() > 1 ? naming.ends[1].cost - naming.ends[0].cost
                                              : std::numeric_limits<double>::infinity();
  KeypointLikelihood& keypoints = posterior.keypoints(0);
  keypoints.update_visibility(posterior.view(0, best));
  keypoints.decide_on_confidence(posterior.view(0, best));
  refine(posterior, &best, 5, 1e-2);
  keypoints.adapt_noise(posterior.view(0, best));
  keypoints.update_visibility(posterior.view(0, best));
  const double cost = refine(posterior, &best, 20, 1e-4);
  if (keypoints_agree(posterior, 0, best)) out->keypoint_cost = cost;
  std::string reason = unreliable_reason(posterior, 0, best, detection.box);
  if (!reason.empty()) return reason;

  const PosteriorMean answer = posterior_mean(posterior, best);
  if (answer.covariance.size() == 0) return "no pose fits the keypoints";
  write_answer(posterior, 0, prior, answer, rival, out);
  if (naming.swapped && out->status == Status::kOk) {
    out->status = Status::kWeak;
    out->reason = kSidesSwapped;
  }
  return "";
}

/// Why a box cannot be answered; empty: it can.
std::string unusable_reason(const PinholeCamera& camera, const Box2& box) {
  const bool finite = std::isfinite(box.x1) && std::isfinite(box.x2) && std::isfinite(box.y1) &&
                      std::isfinite(box.y2);
  if (!finite || !(box.width() > 0.0) || !(box.height() > 0.0)) {
    return "the detection box has no area";
  }
  if (box.x2 < -0.5 || box.y2 < -0.5 || box.x1 > camera.width - 0.5 ||
      box.y1 > camera.height - 0.5) {
    return "the detection box lies outside the image";
  }
  return "";
}

}  // namespace

void VehicleFitOptions::validate() const {
  const auto require = [](bool good, const char* name, int value, const char* bound) {
    if (!good) throw std::invalid_argument(fmt::format("{}: {}, must be {}", name, value, bound));
  };
  noise.validate();
  require(num_coefficients >= 0 && num_coefficients <= kMaxCoefficients, "num_coefficients",
          num_coefficients, "in [0, 20]");
  require(num_yaws >= 4 && num_yaws <= 360, "num_yaws", num_yaws, "in [4, 360]");
  require(keypoint_set == KeypointSet::kSmall14 || keypoint_set == KeypointSet::kAll36,
          "keypoint_set", static_cast<int>(keypoint_set), "14 or 36");
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
  out.reason = unusable_reason(camera, detection.box);
  if (!out.reason.empty()) {
    out.status = Status::kFailed;
    return out;
  }
  const bool any_keypoint =
      std::any_of(detection.keypoints.begin(), detection.keypoints.end(),
                  [](const KeypointObservation& k) { return k.pixel.allFinite(); });
  std::string unreliable;  // why the keypoints are not used
  if (prior.has_shape(detection.vehicle_class) && any_keypoint) {
    unreliable = fit_keypoints(camera, detection, support, options, prior, &out);
  }
  if (out.status == Status::kNotRun) {
    if (!fit_box(camera, detection, support, options, prior, &out)) {
      out.status = Status::kFailed;
      out.reason = "no place in front of the camera fits the box";
      return out;
    }
    out.status = unreliable.empty() ? Status::kWeak : Status::kNotObservable;
    out.reason = unreliable.empty() ? "placed by its box, heading unknown"
                                    : unreliable + "; placed by its box";
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
